//! Arguments of commands that meet other machines.

use std::path::PathBuf;

use crate::network::Endpoints;

/// Where to meet others.
#[derive(Clone, Debug, Default, clap::Args)]
#[command(next_help_heading = "Network (feature zenoh)")]
pub(crate) struct NetworkArgs {
    /// Connect to this address, such as udp/192.168.1.10:7447; may be repeated.
    #[arg(long, value_name = "ENDPOINT")]
    connect: Vec<String>,
    /// Listen on this address, such as udp/0.0.0.0:7447; may be repeated.
    #[arg(long, value_name = "ENDPOINT")]
    listen: Vec<String>,
    /// Zenoh's own settings, JSON5.
    #[arg(long, value_name = "FILE")]
    zenoh_config: Option<PathBuf>,
}

impl NetworkArgs {
    pub(crate) fn endpoints(&self) -> Endpoints {
        let Self { connect, listen, zenoh_config } = self.clone();
        Endpoints { listen, connect, config_file: zenoh_config }
    }
}
