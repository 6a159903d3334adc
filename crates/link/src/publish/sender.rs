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

use super::hand::HandTopics;
use super::plan::{PublishError, PublishPlan, refused};
use super::ros_topics::RosTopics;
use crate::Namespace;
use crate::network::session;
use recording::TickRecord;
use vps::spatial::Pose;

/// What a run shows of itself at one moment.
#[derive(Clone, Debug)]
pub struct RunState {
    /// Its newest record.
    pub record: TickRecord,
    /// The state as `docs/api.md` has it, JSON.
    pub text: String,
    /// The same in the binary layout.
    pub binary: Vec<u8>,
}

/// Everything that a plan needs of the network, before the run.
pub struct OpenedPublisher {
    period: Duration,
    states: States,
    ros: RosTopics,
    has_hand: bool,
    session: Session,
}

impl OpenedPublisher {
    /// Opens a session and announces the topics; takes some seconds at most. Cold.
    ///
    /// # Errors
    /// See [`PublishError`]; nothing is announced any more then.
    pub fn open(plan: &PublishPlan) -> Result<Self, PublishError> {
        let session = session::open(&plan.endpoints)?;
        let states = States::open(&session, &plan.namespace)?;
        let ros = RosTopics::open(&session, plan)?;
        Ok(Self {
            period: Duration::from_secs_f64(1.0 / plan.rate_hz),
            states,
            ros,
            has_hand: plan.has_hand,
            session,
        })
    }

    /// Begins to send, in a thread of its own. `look` is called once a period with the number of
    /// the next state, from 1; it gives `None` when there was no record since the last call, and
    /// must not wait. `take_pose` gets where the hand of a simulated arm shall bring the tool
    /// (`world_from_tool`, m; the quaternion as it was written), or why a message has no such pose;
    /// it is called on a thread of zenoh and must not wait.
    ///
    /// # Errors
    /// The session refuses a key, or the thread could not be started.
    pub fn serve(
        self,
        look: impl FnMut(u64) -> Option<RunState> + Send + 'static,
        take_pose: impl Fn(Result<Pose, String>) + Send + Sync + 'static,
    ) -> io::Result<Sender> {
        let (node, n_publishers) = self.ros.node();
        let open = || HandTopics::open(&self.session, node, n_publishers, Arc::new(take_pose));
        let hand = self.has_hand.then(open).transpose().map_err(io::Error::other)?;
        let (stop, stopped) = bounded(0);
        let run = move || self.run(hand, look, &stopped);
        let thread = std::thread::Builder::new().name("sender".to_owned()).spawn(run)?;
        Ok(Sender { stop: Some(stop), thread: Some(thread) })
    }

    fn run(
        self,
        hand: Option<HandTopics>,
        mut look: impl FnMut(u64) -> Option<RunState>,
        stopped: &channel::Receiver<()>,
    ) {
        let Self { period, states, mut ros, session, .. } = self;
        let mut next = Instant::now();
        let mut seq = 1;
        while let Err(RecvTimeoutError::Timeout) = stopped.recv_deadline(next) {
            let now = Instant::now();
            // What was late is left out.
            next = (next + period).max(now);
            let Some(newest) = look(seq) else { continue };
            seq += 1;
            ros.publish(&newest.record, now);
            states.publish(newest);
        }
        drop((hand, states, ros));
        // Other peers learn at once that this run has gone.
        let _ = session.close().wait();
    }
}

/// The newest state for viewers that are not of ROS 2.
struct States {
    text: Publisher<'static>,
    binary: Publisher<'static>,
}

impl States {
    fn open(session: &Session, namespace: &Namespace) -> Result<Self, PublishError> {
        let open = |key: String, encoding| {
            let publisher = session
                .declare_publisher(key.clone())
                .congestion_control(CongestionControl::Drop)
                .encoding(encoding);
            publisher.wait().map_err(refused(&key))
        };
        let text = open(format!("hapticd/{namespace}/state"), Encoding::APPLICATION_JSON)?;
        let binary =
            open(format!("hapticd/{namespace}/state/binary"), Encoding::APPLICATION_OCTET_STREAM)?;
        Ok(Self { text, binary })
    }

    fn publish(&self, newest: RunState) {
        // A closed session has no subscribers.
        let _ = self.text.put(newest.text).wait();
        let _ = self.binary.put(newest.binary).wait();
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
