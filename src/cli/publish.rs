//! `run --publish` and `run --world`: what a run tells others, and the world that it shares with them.

use std::sync::Arc;

use super::network::HEADING;
use super::{Talk, report};
use crate::config::SceneConfig;
use crate::daemon::session::{SessionHandle, objects};
use crate::error::Exit;
use crate::monitor::Hub;
use crate::publish::{Plan, PublishError, Share, Topics, WorldName};
use crate::servo::ControlError;
use arms::network::Endpoints;
use link::{Domain, Namespace};
use recording::Tap;
use vps::spatial::Axes;

/// Variable of the environment that says which domain is meant.
const DOMAIN_VARIABLE: &str = "ROS_DOMAIN_ID";
/// How often states can be sent, Hz.
const DEFAULT_HZ: f64 = 100.0;
const LEAST_HZ: f64 = 1.0;
const MOST_HZ: f64 = 1000.0;

/// Arguments of what is published and shared.
#[derive(Debug, clap::Args)]
pub(crate) struct PublishArgs {
    /// Publish the run: topics of ROS 2 (rmw_zenoh) under this namespace, and hapticd/NAMESPACE/state for other viewers. Without --listen and
    /// --connect those of this machine find it at udp/127.0.0.1:7447.
    #[arg(long, help_heading = HEADING, value_name = "NAMESPACE", num_args = 0..=1, default_missing_value = "hapticd")]
    publish: Option<Namespace>,
    /// Domain of the topics [default: that of ROS_DOMAIN_ID, else 0].
    #[arg(long, help_heading = HEADING, value_name = "N", requires = "publish")]
    ros_domain: Option<Domain>,
    /// How often messages are sent, and poses of a world, Hz [default: 100].
    #[arg(long, help_heading = HEADING, value_name = "HZ", value_parser = parse_hz)]
    publish_hz: Option<f64>,
    /// Take part in a world that several runs share: movable objects stand where their owners say.
    #[arg(long, help_heading = HEADING, value_name = "NAME")]
    world: Option<WorldName>,
    /// Own these movable objects of the world: the others see them where they stand here.
    #[arg(long, help_heading = HEADING, value_name = "OBJECT,...", value_delimiter = ',', requires = "world")]
    own: Vec<String>,
}

fn parse_hz(text: &str) -> Result<f64, String> {
    let accepted = || format!("write a rate from {LEAST_HZ} to {MOST_HZ} Hz");
    // A NaN is in no range.
    text.parse().ok().filter(|hz| (LEAST_HZ..=MOST_HZ).contains(hz)).ok_or_else(accepted)
}

impl PublishArgs {
    /// True when a session is wanted.
    pub(crate) fn is_wanted(&self) -> bool {
        self.publish.is_some() || self.world.is_some()
    }

    /// Opens a session and claims what is to be owned, before anything takes long. `None`: nothing was asked for.
    pub(crate) fn open(&self, endpoints: Endpoints, config: &SceneConfig, talk: Talk) -> Result<Option<Opened>, Exit> {
        let refuse = |message: &str, hint: &str| {
            report::error(message, Some(hint), talk);
            Err(Exit::Usage)
        };
        if !self.is_wanted() {
            return match self.publish_hz {
                Some(_) => refuse("--publish-hz: nothing is published or shared", "give --publish or --world NAME beside it"),
                None => Ok(None),
            };
        }
        if let Err((problem, hint)) = check_own(&self.own, &objects(config)) {
            return refuse(&format!("--own: {problem}"), hint);
        }
        let domain = match self.domain() {
            Ok(domain) => domain,
            Err(text) => {
                return refuse(
                    &format!("{DOMAIN_VARIABLE}=`{text}` is no number of a domain"),
                    "write one such as 0, or give --ros-domain 0",
                );
            }
        };
        match Opened::open(self.plan(endpoints, config, domain)) {
            Ok(opened) => {
                if let Some(namespace) = &self.publish {
                    report::line(&format!("publishing: /{namespace} in domain {domain}"), talk);
                }
                if let Some(world) = &self.world {
                    let owns = if self.own.is_empty() { "nothing".to_owned() } else { self.own.join(", ") };
                    report::line(&format!("world: {world}, owning {owns}"), talk);
                }
                Ok(Some(opened))
            }
            Err(problem) => {
                let hint = match &problem {
                    PublishError::Owned { .. } => "leave it out of --own to see it where its owner says, or end the other run",
                    _ => "docs/how-to/ros2.md says how endpoints are written and who has to listen",
                };
                refuse(&problem.to_string(), hint)
            }
        }
    }

    fn plan(&self, endpoints: Endpoints, config: &SceneConfig, domain: Domain) -> Plan {
        let profile = &config.device.profile;
        let has_gripper = Axes::from_name("grip").is_some_and(|grip| profile.sensed.contains(grip));
        let topics = self.publish.clone().map(|namespace| Topics { namespace, domain, arm: profile.name.clone(), has_gripper });
        let host = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
        Plan {
            endpoints: endpoints.or_listen_here(),
            rate_hz: self.publish_hz.unwrap_or(DEFAULT_HZ),
            topics,
            share: self.world.clone().map(|world| Share { world, own: self.own.clone() }),
            who: format!("{} on {} (process {})", config.name, host.trim(), std::process::id()),
        }
    }

    /// The domain; what the variable says when that is none.
    fn domain(&self) -> Result<Domain, String> {
        match (self.ros_domain, std::env::var(DOMAIN_VARIABLE)) {
            (Some(domain), _) => Ok(domain),
            (None, Ok(text)) if !text.is_empty() => text.parse().map_err(|_| text),
            (None, _) => Ok(0),
        }
    }
}

/// Looks whether a scene has the objects that a run is to own; `objects` are its static ones, with whether they may move.
fn check_own(own: &[String], objects: &[(String, bool)]) -> Result<(), (String, &'static str)> {
    let hint = "--own takes names of movable objects, with commas between";
    for (idx, name) in own.iter().enumerate() {
        let name = name.clone();
        if own[..idx].contains(&name) {
            return Err((format!("`{name}` is given twice"), hint));
        }
        let known = objects.iter().find(|(known, _)| *known == name);
        let problem = match known {
            Some((_, true)) => continue,
            Some((_, false)) => ControlError::NotMovable { name },
            None => {
                let known = objects.iter().filter(|(_, movable)| *movable).map(|(name, _)| name.clone()).collect();
                ControlError::UnknownObject { name, known }
            }
        };
        return Err((problem.to_string(), hint));
    }
    Ok(())
}

/// What is open before the run begins.
#[cfg(feature = "zenoh")]
pub(crate) struct Opened(crate::publish::Opened);

/// A run that is published; it ends when this is dropped.
#[cfg(feature = "zenoh")]
pub(crate) use crate::publish::Sender;

#[cfg(feature = "zenoh")]
impl Opened {
    fn open(plan: Plan) -> Result<Self, PublishError> {
        crate::publish::Opened::open(plan).map(Self)
    }

    /// Begins to send.
    pub(crate) fn serve(self, hub: &Arc<Hub>, session: SessionHandle, talk: Talk) -> std::io::Result<(Sender, Tap)> {
        self.0.serve(hub, session, Arc::new(move |text, _| report::note(text, talk)))
    }
}

/// Nothing: the program was built without a network.
#[cfg(not(feature = "zenoh"))]
pub(crate) enum Opened {}

/// Nobody.
#[cfg(not(feature = "zenoh"))]
pub(crate) enum Sender {}

#[cfg(not(feature = "zenoh"))]
impl Opened {
    fn open(_: Plan) -> Result<Self, PublishError> {
        Err(arms::network::NetworkError::NotBuilt.into())
    }

    pub(crate) fn serve(self, _: &Arc<Hub>, _: SessionHandle, _: Talk) -> std::io::Result<(Sender, Tap)> {
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
        Command::try_parse_from(["run"].into_iter().chain(line.split_whitespace())).map(|command| command.args)
    }

    #[test]
    fn names_and_rates_are_checked_where_they_are_written() {
        let publish = |line: &str| args(line).expect(line).publish.map(|namespace| namespace.to_string());
        assert_eq!(
            (publish(""), publish("--publish"), publish("--publish /left/arm")),
            (None, Some("hapticd".to_owned()), Some("left/arm".to_owned()))
        );
        assert_eq!(args("--world bench --own a,b --own c").expect("sound").own, ["a", "b", "c"]);
        for (line, told) in [
            ("--publish scene.toml", "no namespace"),
            ("--publish-hz 0", "from 1 to 1000 Hz"),
            ("--publish-hz nan", "from 1 to 1000 Hz"),
            ("--own a", "--world"),
            ("--ros-domain 1", "--publish"),
            ("--world= --own a", "64 bytes"),
        ] {
            let error = args(line).expect_err(line).to_string();
            assert!(error.contains(told), "{line}: {error}");
        }
    }

    #[test]
    fn only_what_is_there_and_moves_can_be_owned() {
        let objects = [("plate".to_owned(), true), ("floor".to_owned(), false)];
        let check = |own: &[&str]| check_own(&own.iter().map(|&name| name.to_owned()).collect::<Vec<_>>(), &objects);
        assert!(check(&["plate"]).is_ok() && check(&[]).is_ok());
        let told = |own: &[&str]| check(own).expect_err("refused").0;
        assert!(told(&["plaet"]).contains("known here: plate"));
        assert!(told(&["floor"]).contains("not movable"));
        assert!(told(&["plate", "plate"]).contains("twice"));
    }
}
