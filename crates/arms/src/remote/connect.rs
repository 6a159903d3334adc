//! How a host comes to a node, and back to it.

use core::sync::atomic::{AtomicU32, Ordering};
use core::time::Duration;
use std::hash::{BuildHasher as _, RandomState};
use std::path::PathBuf;
use std::sync::{Arc, OnceLock};

use glam::DQuat;

use super::{LinkFigures, RemoteHost};
use crate::attached::open::{ConnectMethod, OpenError, OpenedArm, PreviousLink, open_with};
use crate::kinematics::Kinematics;
use crate::mock::builder::cartesian;
use crate::profile::{HomingMode, Profile};
use crate::protocol::{Codec as _, DeclaredLimits, StartError};
use crate::transport::Transport;
use crate::{Capabilities, Connection, IoPlacement, Pacing, Thermal, Timebase, WiredParameters};

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

struct RemoteConnector {
    profile: Profile,
    options: RemoteOptions,
    dial: Dial,
    /// Upper half: this process. Lower half: counts greetings.
    token: AtomicU32,
    /// What the node declared when the run began: the scene was made for that arm.
    declared: OnceLock<DeclaredLimits>,
    figures: Arc<LinkFigures>,
}

impl ConnectMethod for RemoteConnector {
    fn connect(&self, _: PreviousLink) -> Result<(PathBuf, Connection), OpenError> {
        let Profile { sensed, actuated, .. } = self.profile;
        let path = PathBuf::from(format!("zenoh:{}", self.options.name));
        let mut link = (self.dial)()?;
        // Relaxed: only one thread at a time connects.
        let token = self.token.fetch_add(1, Ordering::Relaxed);
        let mut codec =
            RemoteHost::new(sensed, actuated, self.options.period_s, token, self.figures.clone());
        if let Err(cause) = codec.start(&mut *link) {
            codec.finish(&mut *link);
            return Err(OpenError::Start { path, cause });
        }
        if let Some(declared) = codec.declared()
            && *self.declared.get_or_init(|| declared) != declared
        {
            codec.finish(&mut *link);
            let text = "it declares another rate, force, torque or workspace than when the run \
                began: end the run, and start it again";
            return Err(OpenError::Start { path, cause: StartError::Refused(text.to_owned()) });
        }
        // The machine beside the arm has a guard of its own.
        Ok((path, Connection { link, codec: Box::new(codec), guard: Ok(None) }))
    }

    /// The node may have been started again because the arm lost its power; nothing on the network
    /// shows it.
    fn homing(&self) -> Option<String> {
        let homing = &self.profile.real.as_ref()?.homing;
        homing.instruction.clone().filter(|_| homing.mode == HomingMode::PowerOnPose)
    }

    fn is_absent(&self, error: &OpenError) -> bool {
        matches!(error, OpenError::Start { cause: StartError::Silent { .. }, .. })
    }
}

/// Greets the node that drives the arm of this profile, and measures the way to it. Cold; takes
/// some tenths of a second.
///
/// # Errors
/// No node answers, the node listens to another host, or its arm is not that of the profile.
pub fn open(
    profile: &Profile,
    options: &RemoteOptions,
    dial: Dial,
) -> Result<(OpenedArm, Arc<LinkFigures>), OpenError> {
    let figures = Arc::new(LinkFigures::default());
    let process = RandomState::new().hash_one(std::process::id()) as u32;
    let connector = RemoteConnector {
        profile: profile.clone(),
        options: options.clone(),
        dial,
        token: AtomicU32::new(process & 0xFFFF_0000),
        declared: OnceLock::new(),
        figures: figures.clone(),
    };
    Ok((open_with(connector, parameters(profile, options))?, figures))
}

/// What the driver needs: an arm that reports the pose of its grip and takes a wrench, whatever is
/// behind the node.
fn parameters(profile: &Profile, options: &RemoteOptions) -> WiredParameters {
    WiredParameters {
        kinematics: Kinematics::Cartesian,
        transmission: cartesian(profile),
        motor_step: 0.0,
        device_from_native: DQuat::IDENTITY,
        capabilities: Capabilities {
            sensed: profile.sensed,
            actuated: profile.actuated,
            pacing: Pacing::Stream,
            io: IoPlacement::OwnThread,
            // The node says it itself.
            watchdog_ms: None,
            watchdog_latched: true,
            holds_last_command: false,
            simulated: profile.real.is_none(),
        },
        // The node sees to the motors of its arm; what goes there is a wrench.
        signs_verified: true,
        limits: profile.limits.of_motors(),
        unverified_limits: profile.unverified_limits().of_motors(),
        velocity_window_s: profile.velocity_window_ms.map(|window_ms| window_ms * 1e-3),
        kick_s: None,
        delay_ticks: profile.bound_plant().delay_ticks,
        thermal: Thermal::default(),
        period_s: options.period_s,
        timebase: options.timebase,
        link_silence_s: Some(LINK_SILENCE.as_secs_f64()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::profile;

    #[test]
    fn an_arm_that_counts_from_where_it_was_switched_on_is_reported_so_when_its_node_is_back() {
        let homing = |name: &str| {
            let connector = RemoteConnector {
                profile: profile::find(name, std::path::Path::new("")).expect(name),
                options: RemoteOptions {
                    name: "left".into(),
                    period_s: 1e-3,
                    timebase: Timebase::Counted,
                },
                dial: Box::new(|| Err(OpenError::Link("no link".into()))),
                token: AtomicU32::new(0),
                declared: OnceLock::new(),
                figures: Arc::default(),
            };
            connector.homing()
        };
        assert!(homing("haptikfabriken-woodenhaptics").is_some_and(|text| !text.is_empty()));
        assert_eq!((homing("open6-serial"), homing("sim-sigma7")), (None, None));
    }
}
