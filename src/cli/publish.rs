//! `run --publish`: topics of a run on a network.

use std::sync::Arc;
#[cfg(feature = "zenoh")]
use std::sync::{Mutex, PoisonError};

use super::error::CliError;
use super::network::{HEADING, exit_of};
use super::{OutputOptions, report};
use crate::config::SceneConfig;
#[cfg(feature = "zenoh")]
use crate::daemon::session::HandOrder;
use crate::daemon::session::SessionHandle;
use crate::error::Exit;
use crate::monitor::Hub;
#[cfg(feature = "zenoh")]
use crate::monitor::Observer;
use link::network::Endpoints;
#[cfg(feature = "zenoh")]
use link::publish::RunState;
use link::publish::{PublishError, PublishPlan};
use link::{Domain, Namespace};
use recording::Subscriber;
use vps::spatial::Axes;
#[cfg(feature = "zenoh")]
use vps::spatial::Pose;

/// Variable of the environment that says which domain is meant.
const DOMAIN_VARIABLE: &str = "ROS_DOMAIN_ID";
/// How often states can be sent, Hz.
const LEAST_HZ: f64 = 1.0;
const MOST_HZ: f64 = 1000.0;

/// Arguments of what is published.
#[derive(Debug, clap::Args)]
pub(crate) struct PublishArgs {
    /// Publish the run: topics of ROS 2 (rmw_zenoh) under this namespace, and
    /// hapticd/NAMESPACE/state for other viewers; the hand of a simulated arm takes poses from
    /// tool/servo_cp and hapticd/NAMESPACE/hand. Without --listen and --connect those of this
    /// machine find it at udp/127.0.0.1:7447.
    #[arg(long, help_heading = HEADING, value_name = "NAMESPACE", num_args = 0..=1, default_missing_value = "hapticd")]
    publish: Option<Namespace>,
    /// Domain of the topics [default: that of ROS_DOMAIN_ID, else 0].
    #[arg(long, help_heading = HEADING, value_name = "N", requires = "publish")]
    ros_domain: Option<Domain>,
    /// How often messages are sent, Hz.
    #[arg(long, help_heading = HEADING, value_name = "HZ", value_parser = parse_hz, default_value = "100", requires = "publish")]
    publish_hz: f64,
}

fn parse_hz(text: &str) -> Result<f64, String> {
    let accepted = || format!("write a rate from {LEAST_HZ} to {MOST_HZ} Hz");
    // A NaN is in no range.
    text.parse().ok().filter(|hz| (LEAST_HZ..=MOST_HZ).contains(hz)).ok_or_else(accepted)
}

impl PublishArgs {
    /// True when a session is wanted.
    pub(crate) fn is_wanted(&self) -> bool {
        self.publish.is_some()
    }

    /// Opens a session and announces the topics, before anything takes long. `None`: nothing was
    /// asked for.
    pub(crate) fn open(
        &self,
        endpoints: Endpoints,
        config: &SceneConfig,
        output: OutputOptions,
    ) -> Result<Option<OpenedPublisher>, CliError> {
        let Some(namespace) = &self.publish else { return Ok(None) };
        let domain = self.domain()?;
        let profile = &config.device.profile;
        let plan = PublishPlan {
            endpoints: endpoints.or_listen_here(),
            rate_hz: self.publish_hz,
            namespace: namespace.clone(),
            domain,
            arm: profile.name.clone(),
            has_gripper: Axes::from_name("grip").is_some_and(|grip| profile.sensed.contains(grip)),
            has_hand: profile.real.is_none(),
        };
        let opened = OpenedPublisher::open(&plan).map_err(|error| {
            let exit = match &error {
                PublishError::Network(error) => exit_of(error),
                PublishError::Refused { .. } => Exit::Device,
            };
            CliError::new(exit, error).hint(
                "docs/how-to/ros2.md says how endpoints are written and which side has to listen",
            )
        })?;
        report::line(&format!("publishing: /{namespace} in domain {domain}"), output);
        Ok(Some(opened))
    }

    fn domain(&self) -> Result<Domain, CliError> {
        match (self.ros_domain, std::env::var(DOMAIN_VARIABLE)) {
            (Some(domain), _) => Ok(domain),
            (None, Ok(text)) if !text.is_empty() => text.parse().map_err(|_| {
                CliError::usage(format_args!("{DOMAIN_VARIABLE}=`{text}` is no number of a domain"))
                    .hint("write one such as 0, or give --ros-domain 0")
            }),
            (None, _) => Ok(0),
        }
    }
}

/// What is open before the run begins.
#[cfg(feature = "zenoh")]
pub(crate) struct OpenedPublisher(link::publish::OpenedPublisher);

/// A run that is published; it ends when this is dropped.
#[cfg(feature = "zenoh")]
pub(crate) use link::publish::Sender;

#[cfg(feature = "zenoh")]
impl OpenedPublisher {
    fn open(plan: &PublishPlan) -> Result<Self, PublishError> {
        link::publish::OpenedPublisher::open(plan).map(Self)
    }

    /// Begins to send what the hub shows, and moves the hand of a simulated arm. What is refused is
    /// reported once, until something else is.
    pub(crate) fn serve(
        self,
        hub: &Arc<Hub>,
        session: &SessionHandle,
        output: OutputOptions,
    ) -> std::io::Result<(Sender, Subscriber)> {
        let (mut observer, subscriber) = Observer::new(hub.clone());
        let look = move |seq| {
            let seen = observer.look()?;
            Some(RunState {
                record: *seen.record(),
                text: seen.text(seq),
                binary: seen.binary(seq),
            })
        };
        let session = session.clone();
        let reported = Mutex::new(String::new());
        let take_pose = move |pose: Result<Pose, String>| {
            let moved = pose.and_then(|pose| {
                session.hand(HandOrder::MoveTo(pose)).map_err(|refusal| format!("hand: {refusal}"))
            });
            let mut reported = reported.lock().unwrap_or_else(PoisonError::into_inner);
            if let Err(refusal) = moved
                && *reported != refusal
            {
                report::note(&format!("publishing: {refusal}"), output);
                *reported = refusal;
            }
        };
        Ok((self.0.serve(look, take_pose)?, subscriber))
    }
}

/// Nothing: the program was built without a network.
#[cfg(not(feature = "zenoh"))]
pub(crate) enum OpenedPublisher {}

/// Empty: the program was built without a network.
#[cfg(not(feature = "zenoh"))]
pub(crate) enum Sender {}

#[cfg(not(feature = "zenoh"))]
impl OpenedPublisher {
    fn open(_: &PublishPlan) -> Result<Self, PublishError> {
        Err(link::network::NetworkError::NotBuilt.into())
    }

    pub(crate) fn serve(
        self,
        _: &Arc<Hub>,
        _: &SessionHandle,
        _: OutputOptions,
    ) -> std::io::Result<(Sender, Subscriber)> {
        match self {}
    }
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Debug, Parser)]
    struct Command {
        #[command(flatten)]
        args: PublishArgs,
    }

    fn args(line: &str) -> Result<PublishArgs, clap::Error> {
        Command::try_parse_from(["run"].into_iter().chain(line.split_whitespace()))
            .map(|command| command.args)
    }

    #[test]
    fn names_and_rates_are_checked_where_they_are_written() {
        let publish =
            |line: &str| args(line).expect(line).publish.map(|namespace| namespace.to_string());
        assert_eq!(
            (publish(""), publish("--publish"), publish("--publish /left/arm")),
            (None, Some("hapticd".to_owned()), Some("left/arm".to_owned()))
        );
        for (line, reported) in [
            ("--publish scene.toml", "no namespace"),
            ("--publish-hz 0", "from 1 to 1000 Hz"),
            ("--publish-hz nan", "from 1 to 1000 Hz"),
            ("--ros-domain 1", "--publish"),
            ("--publish-hz 10", "--publish"),
        ] {
            let error = args(line).expect_err(line).to_string();
            assert!(error.contains(reported), "{line}: {error}");
        }
    }
}
