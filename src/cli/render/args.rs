//! Arguments of every command that renders.

use std::path::PathBuf;
use std::time::Duration;

use clap::ValueEnum;

use super::super::error::CliError;
use super::super::sculpt_run::ClayArgs;
use super::super::{cache, drawing, foxglove, live, memory, monitor, network, publish, recording};
use crate::config::{LoadOptions, SceneConfig};
use crate::daemon::remote::RemoteArm;
use arms::attached::nodes::Selector;
use link::network::NetworkError;
use rt::clock::ClockKind;
use rt::duration;

/// Arguments of every command that renders.
#[derive(Debug, clap::Args)]
pub(crate) struct LoopArgs {
    /// Scene file.
    pub(in crate::cli) scene: PathBuf,
    /// How long to render before the safe stop, such as 10s, 500ms or 2min [default: until Ctrl-C].
    #[arg(long, value_name = "TIME", value_parser = duration::parse, allow_hyphen_values = true)]
    pub(super) duration: Option<Duration>,
    /// What to do when a real-time check fails [default: as the scene says].
    #[arg(long, value_name = "MODE")]
    pub(super) realtime: Option<RealtimeMode>,
    /// Device profile instead of the scene's: a name or a file; zenoh:NAME for an arm that `hapticd
    /// device-node` drives.
    #[arg(long, value_name = "PROFILE")]
    pub(super) device: Option<String>,
    /// Which of several arms: VID:PID[:SERIAL] in hex, or the path of its node.
    #[arg(long, value_name = "SELECTOR")]
    pub(super) selector: Option<Selector>,
    /// Time that the run follows; virtual is simulated and as fast as it goes.
    #[arg(long, value_name = "CLOCK", default_value = "real")]
    pub(super) clock: ClockArg,
    /// Simulated arms: let the hand of the scene go its path there and back, again and again.
    #[arg(long)]
    pub(super) hand_repeat: bool,
    /// Let force flow on a real arm from the start on; with a deadman, while it is held. Simulated
    /// arms need no leave.
    #[arg(long)]
    pub(super) enable: bool,
    /// Take `enable`, `disable` and `stop` as lines on standard input (with clay also tools, images
    /// and solids), and wait for `enable` after a fault instead of ending. The end of the input is
    /// a stop.
    #[arg(long)]
    pub(super) console: bool,
    #[command(flatten)]
    pub(super) monitor: monitor::MonitorArgs,
    #[command(flatten)]
    pub(super) recording: recording::RecordingArgs,
    #[command(flatten)]
    pub(super) foxglove: foxglove::FoxgloveArgs,
    #[command(flatten)]
    pub(super) publish: publish::PublishArgs,
    #[command(flatten)]
    pub(super) memory: memory::MemoryArgs,
    #[command(flatten)]
    pub(super) network: network::NetworkArgs,
    #[command(flatten)]
    pub(super) cache: cache::CacheArgs,
    /// Print the result as one JSON object.
    #[arg(long)]
    pub(super) json: bool,
}

/// What a command adds to them.
pub(crate) struct CommandOptions<'a> {
    /// What changes while it renders.
    pub(in crate::cli) live: &'a live::LiveArgs,
    /// What is to be drawn; `None`: the command draws something else.
    pub(in crate::cli) drawing: Option<&'a drawing::DrawingArgs>,
    /// What is to become of the clay; `None`: the command is for scenes without.
    pub(in crate::cli) clay: Option<&'a ClayArgs>,
    /// Files may be written over.
    pub(in crate::cli) overwrite: bool,
}

/// What to do when a real-time check fails.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum RealtimeMode {
    /// Refuse to run.
    Enforce,
    /// Run and say what was given up.
    BestEffort,
}

/// Time that a run follows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum ClockArg {
    /// The machine's monotonic clock.
    Real,
    /// Simulated time.
    Virtual,
}

impl ClockArg {
    pub(super) fn kind(self) -> ClockKind {
        match self {
            Self::Real => ClockKind::Real,
            Self::Virtual => ClockKind::Virtual,
        }
    }
}

impl LoopArgs {
    /// The arm on another machine that `--device` names, if it does.
    pub(super) fn remote(&self) -> Result<Option<RemoteArm>, NetworkError> {
        let name = self.device.as_deref().and_then(RemoteArm::name_in);
        name.map(|name| RemoteArm::find(name, &self.network.endpoints())).transpose()
    }

    /// What the command line sets over the scene.
    pub(super) fn overrides(&self, remote: Option<&RemoteArm>) -> LoadOptions {
        let profile = remote.map(|remote| remote.profile_file().display().to_string());
        LoadOptions {
            device: profile.or_else(|| self.device.clone()),
            selector: self.selector.clone(),
            enforce: self.realtime.map(|mode| mode == RealtimeMode::Enforce),
            hand_repeat: self.hand_repeat,
        }
    }

    /// Refuses what does not go with the arm, and endpoints that nothing uses.
    pub(super) fn check(
        &self,
        config: &SceneConfig,
        remote: Option<&RemoteArm>,
    ) -> Result<(), CliError> {
        let profile = &config.device.profile;
        if let Some(selector) = &self.selector {
            let selector = format_args!("--selector {selector}");
            if let Some(remote) = remote {
                let at =
                    format_args!("the arm is attached to the machine of zenoh:{}", remote.name());
                return Err(CliError::usage(format_args!("{selector}: {at}"))
                    .hint("give it to `hapticd device-node`"));
            }
            if profile.real.is_none() {
                let name = &profile.name;
                return Err(CliError::usage(format_args!(
                    "{selector}: {name} is simulated in this process and has no node"
                ))
                .hint("name the profile of a real arm with --device"));
            }
        }
        if !self.network.endpoints().is_empty() && !self.publish.is_wanted() && remote.is_none() {
            return Err(CliError::usage(
                "--connect, --listen and --zenoh-config say where to meet others, and nothing is \
                    published",
            )
            .hint("give --publish beside them"));
        }
        Ok(())
    }

    /// A deadman is an enable in the operator's hand.
    pub(super) fn enables_at_start(&self, config: &SceneConfig) -> bool {
        self.enable || config.parameters.safety.deadman.is_some() && !self.console
    }
}
