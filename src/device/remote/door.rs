//! How a host comes to a node, and back to it.

use core::sync::atomic::{AtomicU32, Ordering};
use core::time::Duration;
use std::hash::{BuildHasher as _, RandomState};
use std::path::PathBuf;
use std::sync::Arc;

use glam::DQuat;

use super::{Host, LinkFigures};
use crate::device::attached::open::{OpenError, Opened, Way, open_way};
use crate::device::kinematics::Kinematics;
use crate::device::mock::profiled::cartesian;
use crate::device::profile::Profile;
use crate::device::protocol::Codec as _;
use crate::device::transport::Transport;
use crate::device::{Capabilities, Connection, IoPlacement, Pacing, Thermal, Timebase, Wakeup, WiredParameters};

/// Silence after which the link counts as lost: what a tick calls `stale` begins there too.
const LINK_SILENCE: Duration = Duration::from_millis(20);

/// Opens a link to the node, once and again: a transport of datagrams, or why not.
pub type Dial = Box<dyn Fn() -> Result<Box<dyn Transport>, OpenError> + Send>;

/// Which arm, and how.
#[derive(Clone, Debug)]
pub struct RemoteOptions {
    /// Name of the node.
    pub name: String,
    /// One tick of the host, s.
    pub period_s: f64,
    /// Time of samples.
    pub timebase: Timebase,
}

struct Door {
    profile: Profile,
    options: RemoteOptions,
    dial: Dial,
    /// Upper half: this process. Lower half: counts greetings.
    token: AtomicU32,
    figures: Arc<LinkFigures>,
}

impl Way for Door {
    fn connect(&self, _: bool) -> Result<(PathBuf, Connection), OpenError> {
        let Profile { sensed, actuated, .. } = self.profile;
        let path = PathBuf::from(format!("zenoh:{}", self.options.name));
        let mut link = (self.dial)()?;
        // Relaxed: only one thread at a time connects.
        let token = self.token.fetch_add(1, Ordering::Relaxed);
        let mut codec = Host::new(sensed, actuated, self.options.period_s, token, self.figures.clone());
        if let Err(cause) = codec.start(&mut *link) {
            codec.finish(&mut *link);
            return Err(OpenError::Start { path, cause });
        }
        Ok((path, Connection { link, codec: Box::new(codec) }))
    }

    fn homing(&self) -> Option<String> {
        None
    }

    fn is_absent(&self, error: &OpenError) -> bool {
        use crate::device::protocol::StartError;
        matches!(error, OpenError::Start { cause: StartError::Silent { .. }, .. })
    }
}

/// Greets the node that drives the arm of this profile, and measures the way to it. Cold; takes some tenths of a second.
///
/// # Errors
/// Nobody answers, the node listens to another host, or its arm is not that of the profile.
pub fn open(profile: &Profile, options: &RemoteOptions, dial: Dial) -> Result<(Opened, Arc<LinkFigures>), OpenError> {
    let figures = Arc::new(LinkFigures::default());
    let process = RandomState::new().hash_one(std::process::id()) as u32;
    let door = Door {
        profile: profile.clone(),
        options: options.clone(),
        dial,
        token: AtomicU32::new(process & 0xFFFF_0000),
        figures: figures.clone(),
    };
    let parameters = |io| parameters(profile, options, io);
    Ok((open_way(door, parameters)?, figures))
}

/// What the driver is told: an arm that reports the pose of its grip and takes a wrench, whatever is behind the node.
pub(super) fn parameters(profile: &Profile, options: &RemoteOptions, io: IoPlacement) -> WiredParameters {
    WiredParameters {
        kinematics: Kinematics::Cartesian,
        transmission: cartesian(profile),
        device_from_native: DQuat::IDENTITY,
        capabilities: Capabilities {
            sensed: profile.sensed,
            actuated: profile.actuated,
            pacing: Pacing::Stream,
            io,
            wakeup: Wakeup::Clock,
            // The node says it itself.
            watchdog_ms: None,
            watchdog_latched: true,
            holds_last_command: false,
            simulated: profile.real.is_none(),
        },
        force_limit_n: profile.limits.force_n,
        torque_limit_nm: profile.limits.torque_nm,
        velocity_window_s: profile.velocity_window_ms.map(|window_ms| window_ms * 1e-3),
        kick_s: None,
        delay_ticks: profile.bound_plant().delay_ticks,
        thermal: Thermal::default(),
        period_s: options.period_s,
        timebase: options.timebase,
        link_silence_s: Some(LINK_SILENCE.as_secs_f64()),
    }
}
