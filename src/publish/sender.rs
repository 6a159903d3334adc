//! The thread that looks at the run and sends, and what it takes to begin it.

use core::time::Duration;
use std::io;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Instant;

use crossbeam::channel::{self, RecvTimeoutError, bounded};
use zenoh::bytes::Encoding;
use zenoh::pubsub::Publisher;
use zenoh::qos::CongestionControl;
use zenoh::{Session, Wait};

use super::keys::{binary_state_key, state_key};
use super::plan::{Plan, PublishError, refused};
use super::ros_topics::RosTopics;
use super::world::{Tell, World};
use crate::daemon::session::SessionHandle;
use crate::monitor::{Hub, Observer, Seen};
use arms::network::session;
use link::Namespace;
use recording::Subscriber;

/// Everything that a plan needs of the network, before the run.
pub struct Opened {
    period: Duration,
    states: Option<States>,
    ros: Option<RosTopics>,
    world: Option<World>,
    session: Session,
}

impl Opened {
    /// Opens a session and claims what is to be owned; takes some seconds at most. Cold.
    ///
    /// # Errors
    /// See [`PublishError`]; nothing is announced any more then.
    pub fn open(plan: Plan) -> Result<Self, PublishError> {
        let Plan { endpoints, rate_hz, topics, share, who } = plan;
        let session = session::open(&endpoints)?;
        let world = share.map(|share| World::join(&session, share, &who)).transpose()?;
        let states = topics.as_ref().map(|topics| States::open(&session, &topics.namespace)).transpose()?;
        let ros = topics.as_ref().map(|topics| RosTopics::open(&session, topics)).transpose()?;
        Ok(Self { period: Duration::from_secs_f64(1.0 / rate_hz), states, ros, world, session })
    }

    /// Begins to send, in a thread of its own; `tell` hears beside the clients of the hub.
    ///
    /// # Errors
    /// The thread could not be started.
    pub fn serve(self, hub: &Arc<Hub>, session: SessionHandle, tell: Tell) -> io::Result<(Sender, Subscriber)> {
        let (observer, subscriber) = Observer::new(hub.clone());
        let heard = hub.clone();
        let tell: Tell = Arc::new(move |text, names| {
            tell(text, names);
            heard.world(text, names);
        });
        let (stop, stopped) = bounded(0);
        let run = move || self.run(observer, &session, &tell, &stopped);
        let thread = std::thread::Builder::new().name("sender".to_owned()).spawn(run)?;
        Ok((Sender { stop: Some(stop), thread: Some(thread) }, subscriber))
    }

    fn run(self, mut observer: Observer, session: &SessionHandle, tell: &Tell, stopped: &channel::Receiver<()>) {
        let Self { period, mut states, mut ros, mut world, session: network } = self;
        let mut next = Instant::now();
        while let Err(RecvTimeoutError::Timeout) = stopped.recv_deadline(next) {
            let now = Instant::now();
            // What was late is left out.
            next = (next + period).max(now);
            let Some(seen) = observer.look() else { continue };
            if let Some(ros) = &mut ros {
                ros.publish(seen.record(), now);
            }
            if let Some(states) = &mut states {
                states.publish(&seen);
            }
            if let Some(world) = &mut world {
                world.turn(&seen, now, session, tell);
            }
        }
        drop((states, ros, world));
        // Others hear at once that this run has gone.
        let _ = network.close().wait();
    }
}

/// The newest state for viewers that are not of ROS 2.
struct States {
    text: Publisher<'static>,
    binary: Publisher<'static>,
    sent: u64,
}

impl States {
    fn open(session: &Session, namespace: &Namespace) -> Result<Self, PublishError> {
        let open = |key: String, encoding| {
            let publisher = session.declare_publisher(key.clone()).congestion_control(CongestionControl::Drop).encoding(encoding);
            publisher.wait().map_err(refused(&key))
        };
        let text = open(state_key(namespace), Encoding::APPLICATION_JSON)?;
        Ok(Self { text, binary: open(binary_state_key(namespace), Encoding::APPLICATION_OCTET_STREAM)?, sent: 0 })
    }

    fn publish(&mut self, seen: &Seen<'_>) {
        self.sent += 1;
        // A session that is closed has no receiver.
        let _ = self.text.put(seen.text(self.sent)).wait();
        let _ = self.binary.put(seen.binary(self.sent)).wait();
    }
}

/// A run that is published. It ends, and its session with it, when this is dropped.
#[derive(Debug)]
pub struct Sender {
    stop: Option<channel::Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl Drop for Sender {
    fn drop(&mut self) {
        drop(self.stop.take());
        if let Some(thread) = self.thread.take() {
            // A thread that panicked has nothing more to say.
            let _ = thread.join();
        }
    }
}
