//! What a service manager gets to know of a run: systemd, or another one that set `NOTIFY_SOCKET`.
//!
//! Data in: the supervisor's notices. Data out: datagrams of the `sd_notify` protocol; nothing
//! where no manager asked for them. A message that does not arrive is lost: a service manager that
//! has gone is no reason to let an arm go. A thread of its own sends them: the socket of a manager
//! that does not read blocks, and no other thread waits for it.

use core::sync::atomic::{AtomicUsize, Ordering};
use core::time::Duration;
use std::sync::OnceLock;
use std::time::Instant;

use crossbeam::channel::{Sender, bounded};
use sd_notify::NotifyState;

use engine::supervisor::{Notice, Phase};
use haptics::Faults;

/// A watchdog is fed this many times within its time.
const FEEDS: u32 = 4;

/// Reports the state of a run to a service manager.
#[derive(Debug)]
pub struct Service {
    is_ready: bool,
    /// How often the watchdog wants to be fed; `None`: there is none.
    feed_every: Option<Duration>,
    fed: Option<Instant>,
    /// The newest tick that was reported.
    tick: Option<u64>,
}

impl Service {
    /// The one that started this process, if any did.
    pub fn of_environment() -> Self {
        let feed_every = sd_notify::watchdog_enabled().map(|limit| limit / FEEDS);
        Self { is_ready: false, feed_every, fed: None, tick: None }
    }

    /// Passes on what a notice says. Ready is a loop that ticks: force flows, or could. The
    /// watchdog is fed by ticks and by nothing else, so that a loop that stands still is found out.
    pub fn report(&mut self, notice: &Notice<'_>) {
        match notice {
            Notice::Phase(phase) => {
                if matches!(phase, Phase::Enabling | Phase::Enabled) {
                    self.ready();
                }
                if *phase == Phase::Stopped {
                    tell(&[NotifyState::Stopping]);
                }
                status(phase.name());
            }
            Notice::Status(record) => {
                self.ready();
                if self.tick.replace(record.tick) != Some(record.tick) {
                    self.feed();
                }
            }
            Notice::Fault(record) => {
                let faults = record.output.faults;
                let words: Vec<&str> = Faults::TABLE
                    .into_iter()
                    .filter(|(fault, ..)| faults.contains(*fault))
                    .map(|(.., words)| words)
                    .collect();
                status(&format!("fault: {}", words.join("; ")));
            }
            Notice::Waiting(cause) => {
                status(&format!("no force: {} ({})", cause.name(), cause.advice()))
            }
            Notice::Preflight(_) | Notice::Scene(_) | Notice::Link(_) => {}
        }
    }

    fn ready(&mut self) {
        if !self.is_ready {
            self.is_ready = true;
            tell(&[NotifyState::Ready]);
        }
    }

    fn feed(&mut self) {
        let Some(every) = self.feed_every else { return };
        let now = Instant::now();
        if self.fed.is_none_or(|fed| now.duration_since(fed) >= every) {
            self.fed = Some(now);
            tell(&[NotifyState::Watchdog]);
        }
    }
}

/// The scene is being read again.
pub fn reloading() {
    // Without the time the manager takes the message for one of an earlier reload.
    let since = NotifyState::monotonic_usec_now();
    tell(&[NotifyState::Reloading].into_iter().chain(since).collect::<Vec<_>>());
}

/// It was read, and this came of it.
pub fn reloaded(outcome: &str) {
    tell(&[NotifyState::Ready, NotifyState::Status(&one_line(outcome))]);
}

fn status(text: &str) {
    tell(&[NotifyState::Status(&one_line(text))]);
}

/// A message of the protocol ends with its line.
fn one_line(text: &str) -> String {
    text.replace(['\n', '\r'], " ")
}

/// Messages that may wait for the service manager; more are dropped.
const QUEUED: usize = 64;
/// How long the end of the program waits for a service manager to take the last report.
const FLUSH: Duration = Duration::from_millis(500);
/// Messages that were queued and not sent yet.
static WAITING: AtomicUsize = AtomicUsize::new(0);

/// Lets the last messages leave, as long as that is not for ever.
pub fn finish() {
    let begin = Instant::now();
    while WAITING.load(Ordering::Acquire) > 0 && begin.elapsed() < FLUSH {
        std::thread::sleep(Duration::from_millis(1));
    }
}

fn tell(states: &[NotifyState<'_>]) {
    static QUEUE: OnceLock<Option<Sender<String>>> = OnceLock::new();
    let begin = || {
        std::env::var_os("NOTIFY_SOCKET")?;
        let (sender, messages) = bounded::<String>(QUEUED);
        let send = move || {
            for message in messages {
                // The service manager is gone.
                let _ = sd_notify::notify(&[NotifyState::Custom(&message)]);
                WAITING.fetch_sub(1, Ordering::Release);
            }
        };
        std::thread::Builder::new().name("notify".to_owned()).spawn(send).ok()?;
        Some(sender)
    };
    if let Some(queue) = QUEUE.get_or_init(begin) {
        let lines: Vec<String> = states.iter().map(ToString::to_string).collect();
        WAITING.fetch_add(1, Ordering::Relaxed);
        if queue.try_send(lines.join("\n")).is_err() {
            WAITING.fetch_sub(1, Ordering::Relaxed);
        }
    }
}
