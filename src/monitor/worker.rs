//! A thread that does one thing after the other, for what would hold up every client.

use std::sync::mpsc::{Sender, channel};

use tokio::sync::oneshot;

type Job = Box<dyn FnOnce() + Send>;

/// Sends work to its thread. The thread ends with the last sender.
#[derive(Clone, Debug)]
pub(super) struct Worker(Sender<Job>);

impl Worker {
    /// Begins the thread.
    pub(super) fn new(name: &str) -> std::io::Result<Self> {
        let (sender, jobs) = channel::<Job>();
        std::thread::Builder::new().name(name.to_owned()).spawn(move || {
            for job in jobs {
                // A caller that waits learns of a panic by the end of its channel; the next job
                // must still run.
                let _ = std::panic::catch_unwind(std::panic::AssertUnwindSafe(job));
            }
        })?;
        Ok(Self(sender))
    }

    /// Does `work` there, and does not wait.
    pub(super) fn post(&self, work: impl FnOnce() + Send + 'static) {
        // The thread outlives its senders.
        let _ = self.0.send(Box::new(work));
    }

    /// Does `work` there; `None` where the work panicked, or the thread is gone.
    pub(super) async fn run<T: Send + 'static>(
        &self,
        work: impl FnOnce() -> T + Send + 'static,
    ) -> Option<T> {
        let (sender, done) = oneshot::channel();
        let job = Box::new(move || drop(sender.send(work())));
        self.0.send(job).ok()?;
        done.await.ok()
    }
}
