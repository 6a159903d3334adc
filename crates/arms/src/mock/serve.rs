//! The mock arm on the real clock: absolute deadlines for the plant, answers at once in between.

use core::time::Duration;

use super::arm::MockArm;
use super::link::{ArmLink, LinkError};
use super::trace::TraceFile;
use rt::clock::monotonic_ns;

/// Longest frame of a host: a message to a service may hold settings.
pub(super) const BUFFER: usize = 4096;

/// How long to serve.
#[derive(Clone, Copy, Debug, Default)]
pub struct Serving {
    /// One period, s.
    pub period_s: f64,
    /// End after this; `None`: never.
    pub duration: Option<Duration>,
    /// End when the host has gone.
    pub until_host_gone: bool,
}

/// Why serving ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ServeEnd {
    /// The caller asked for it.
    Interrupted,
    /// The time is over.
    Duration,
    /// The host has gone.
    HostGone,
}

impl ServeEnd {
    /// Word for reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Interrupted => "interrupted",
            Self::Duration => "duration",
            Self::HostGone => "host-gone",
        }
    }
}

/// Serves until `quit` says so or `serving` does, and writes down in `trace` what the motors do.
///
/// # Errors
/// The plug cannot be pulled, or not be put in again.
pub fn serve(
    arm: &mut MockArm,
    link: &mut dyn ArmLink,
    serving: Serving,
    mut trace: Option<&mut TraceFile>,
    mut quit: impl FnMut() -> bool,
) -> Result<ServeEnd, LinkError> {
    let period_ns = (serving.period_s * 1e9) as i64;
    let start_ns = monotonic_ns();
    let mut deadline_ns = start_ns;
    let mut is_unplugged = false;
    let mut was_gone = link.is_host_gone();
    let mut buffer = [0; BUFFER];
    let mut has_backlog = false;
    loop {
        let now_ns = monotonic_ns();
        let now_s = (now_ns - start_ns) as f64 * 1e-9;
        if quit() {
            return Ok(ServeEnd::Interrupted);
        }
        if serving.duration.is_some_and(|duration| now_s >= duration.as_secs_f64()) {
            return Ok(ServeEnd::Duration);
        }
        if serving.until_host_gone && link.is_host_gone() && !was_gone && !is_unplugged {
            return Ok(ServeEnd::HostGone);
        }
        was_gone &= link.is_host_gone();
        if arm.is_unplugged(now_s) != is_unplugged {
            is_unplugged = !is_unplugged;
            if is_unplugged {
                arm.discard();
                link.unplug()?;
            } else {
                link.replug()?;
                // The host that lost the plug has not gone; the next one may.
                was_gone = true;
            }
        }
        while now_ns >= deadline_ns {
            // Its own lateness is made up for, so that the plant keeps the machine's time; it is
            // counted, so that it is not mistaken for the host's.
            if now_ns - deadline_ns > period_ns / 2 {
                arm.late();
            }
            arm.advance((deadline_ns - start_ns) as f64 * 1e-9);
            deadline_ns += period_ns;
            if let Some(trace) = &mut trace {
                trace.note(monotonic_ns(), &arm.trace_sample(now_s));
            }
        }
        let is_deaf = arm.is_deaf(now_s);
        link.set_deaf(is_deaf);
        has_backlog |= is_deaf;
        let most = if has_backlog { link.backlog_share() } else { BUFFER };
        loop {
            let n = if is_deaf { 0 } else { link.receive(&mut buffer[..most]) };
            has_backlog &= is_deaf || n > 0;
            if n == 0 {
                break;
            }
            arm.receive(&buffer[..n], now_s);
            if has_backlog {
                break;
            }
        }
        let mut due_ns = deadline_ns;
        while let Some(frame) = arm.next_frame((monotonic_ns() - start_ns) as f64 * 1e-9) {
            let was_taken = link.send(&frame);
            arm.sent(was_taken);
        }
        if let Some(due_s) = arm.next_due_s() {
            due_ns = due_ns.min(start_ns + (due_s * 1e9).ceil() as i64);
        }
        let left_ns = due_ns - monotonic_ns();
        if left_ns > 0 {
            let left = Duration::from_nanos(left_ns as u64);
            // What has come and is not looked at yet would end the wait at once.
            if is_deaf || has_backlog { std::thread::sleep(left) } else { link.wait(left) }
        }
    }
}
