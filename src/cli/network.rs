//! Arguments of commands that meet other machines.

use std::path::PathBuf;

use crate::error::Exit;
use link::network::{Endpoints, NetworkError};

/// Where `--help` lists what needs the feature.
pub(super) const HEADING: &str = "Network (feature zenoh)";

/// Where to meet others.
#[derive(Clone, Debug, Default, clap::Args)]
pub(crate) struct NetworkArgs {
    /// Connect to this address, such as udp/192.168.1.10:7447; may be repeated.
    #[arg(long, help_heading = HEADING, value_name = "ENDPOINT")]
    connect: Vec<String>,
    /// Listen on this address, such as udp/0.0.0.0:7447; may be repeated.
    #[arg(long, help_heading = HEADING, value_name = "ENDPOINT")]
    listen: Vec<String>,
    /// Zenoh's own settings, JSON5.
    #[arg(long, help_heading = HEADING, value_name = "FILE")]
    zenoh_config: Option<PathBuf>,
    /// File with the key that a peer that connects has to know; a device-node that listens to other
    /// machines needs one.
    #[arg(long, help_heading = HEADING, value_name = "FILE")]
    key_file: Option<PathBuf>,
}

impl NetworkArgs {
    pub(crate) fn endpoints(&self) -> Endpoints {
        let Self { connect, listen, zenoh_config, key_file } = self.clone();
        Endpoints { listen, connect, config_file: zenoh_config, key_file }
    }
}

/// The exit code of a network that fails.
pub(crate) fn exit_of(error: &NetworkError) -> Exit {
    match error {
        NetworkError::Endpoint { .. }
        | NetworkError::Key { .. }
        | NetworkError::Name { .. }
        | NetworkError::NotBuilt => Exit::Usage,
        NetworkError::ConfigFile { .. } => Exit::Configuration,
        NetworkError::Open { .. } | NetworkError::Link { .. } | NetworkError::NoNode { .. } => {
            Exit::Device
        }
    }
}
