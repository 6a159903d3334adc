//! `run --foxglove`: where the Foxglove app finds a run.

use std::net::SocketAddr;

use super::error::CliError;
use super::{OutputOptions, report};
use crate::config::SceneConfig;
use crate::config::{FOXGLOVE_ACCEPTED, parse_foxglove};
use crate::error::Exit;
use recording::file::Recorder;
use rt::clock::ClockKind;

/// Arguments of the server for the Foxglove app.
#[derive(Debug, clap::Args)]
pub(crate) struct FoxgloveArgs {
    /// Let the Foxglove app watch the run at this address of this machine, such as 127.0.0.1:8765,
    /// or "off" [default: as the scene says; off under --clock virtual].
    #[arg(long, value_name = "ADDR|off", value_parser = parse)]
    foxglove: Option<Listen>,
}

/// An address, or off.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Listen(Option<SocketAddr>);

fn parse(text: &str) -> Result<Listen, String> {
    parse_foxglove(text).map(Listen).ok_or_else(|| format!("write {FOXGLOVE_ACCEPTED}"))
}

impl FoxgloveArgs {
    /// Begins to answer, before anything takes long.
    pub(crate) fn begin(
        &self,
        config: &SceneConfig,
        clock: ClockKind,
        recorder: &Recorder,
        output: OutputOptions,
    ) -> Result<Option<FoxgloveServer>, CliError> {
        let listen = match (self.foxglove, clock) {
            (Some(Listen(listen)), _) => listen,
            (None, ClockKind::Virtual) => None,
            (None, ClockKind::Real) => config.monitor.foxglove,
        };
        let Some(address) = listen else { return Ok(None) };
        let exit = if self.foxglove.is_some() { Exit::Usage } else { Exit::Configuration };
        FoxgloveServer::open(address, config, recorder, output)
            .map(Some)
            .map_err(|error| error.exit(exit))
    }
}

/// The server for connected Foxglove apps.
pub(crate) struct FoxgloveServer {
    server: recording::file::live::LiveServer,
    output: OutputOptions,
}

impl FoxgloveServer {
    fn open(
        address: SocketAddr,
        config: &SceneConfig,
        recorder: &Recorder,
        output: OutputOptions,
    ) -> Result<Self, CliError> {
        let bound = recording::file::live::BoundLiveServer::bind(address);
        let served = bound.and_then(|bound| {
            let address = bound.address();
            Ok((address, bound.serve(recorder, config.monitor.origins.clone())?))
        });
        let (address, server) = served.map_err(|error| {
            CliError::usage(format_args!(
                "the server for Foxglove cannot listen at {address}: {error}"
            ))
            .hint("give another one with --foxglove, such as 127.0.0.1:0 for any port that is free")
        })?;
        report::line(&format!("foxglove: ws://{address}"), output);
        Ok(Self { server, output })
    }

    /// After the last tick: reports what reached no client.
    pub(crate) fn end(self) {
        let summary = self.server.status();
        let reported = [
            ("ticks dropped before they could be shown", summary.dropped),
            ("connections turned away", summary.turned_away),
            ("clients cut off because they took nothing", summary.cut_off),
        ];
        for (what, count) in reported {
            if count > 0 {
                report::note(&format!("foxglove: {what}: {count}"), self.output);
            }
        }
    }
}
