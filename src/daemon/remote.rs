//! The workstation's way to an arm that a `device-node` drives: `--device zenoh:NAME`.
//!
//! The node says what its arm is: its profile comes over the network and is a file for the rest of
//! the program, so that scenes, recordings and reloads need to know nothing of it.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use tempfile::TempDir;

use arms::attached::open::{OpenError, OpenedArm};
use arms::profile::Profile;
use arms::remote::LinkFigures;
use link::network::{Endpoints, NetworkError};
use rt::schedule::ThreadRequest;

/// What `--device` has before the name of a node.
const PREFIX: &str = "zenoh:";

/// A node that was found.
pub struct RemoteArm {
    name: String,
    profile_file: PathBuf,
    /// Holds the file.
    _folder: TempDir,
    #[cfg(feature = "zenoh")]
    session: zenoh::Session,
}

impl RemoteArm {
    /// The name of a node, if that is what the word for a device means.
    pub fn name_in(device: &str) -> Option<&str> {
        device.strip_prefix(PREFIX)
    }

    /// Its name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The profile of its arm.
    pub fn profile_file(&self) -> &Path {
        &self.profile_file
    }
}

#[cfg(not(feature = "zenoh"))]
impl RemoteArm {
    /// Refuses: this program has no network.
    ///
    /// # Errors
    /// Always.
    pub fn find(_: &str, _: &Endpoints) -> Result<Self, NetworkError> {
        Err(NetworkError::NotBuilt)
    }

    /// Refuses as well.
    ///
    /// # Errors
    /// Always.
    pub fn open(
        &self,
        _: &Profile,
        _: f64,
        _: Option<ThreadRequest>,
    ) -> Result<(OpenedArm, Arc<LinkFigures>), OpenError> {
        Err(OpenError::Link(Box::new(NetworkError::NotBuilt)))
    }
}

#[cfg(feature = "zenoh")]
mod over_zenoh {
    use core::time::Duration;

    use super::*;
    use arms::Timebase;
    use arms::remote::{Dial, RemoteOptions, open};
    use arms::transport::Transport;
    use link::network::link::{ZenohLink, ask_profile, is_name};
    use link::network::session;

    /// How long a node may take to answer.
    const FIND_WITHIN: Duration = Duration::from_secs(10);

    impl RemoteArm {
        /// Opens a session and asks the node of that name for its profile. Cold.
        ///
        /// # Errors
        /// No session, or no node of that name.
        pub fn find(name: &str, endpoints: &Endpoints) -> Result<Self, NetworkError> {
            let failed = |cause: std::io::Error| NetworkError::Link {
                name: name.to_owned(),
                cause: cause.to_string(),
            };
            if !is_name(name) {
                return Err(NetworkError::Name { name: name.to_owned() });
            }
            let session = session::open(&endpoints.clone().or_connect_here())?;
            let toml = ask_profile(&session, name, FIND_WITHIN)?;
            let folder = tempfile::tempdir().map_err(failed)?;
            let profile_file = folder.path().join(format!("{name}.toml"));
            std::fs::write(&profile_file, toml).map_err(failed)?;
            Ok(Self { name: name.to_owned(), profile_file, _folder: folder, session })
        }

        /// Greets the node, measures the link, and gives the driver of its arm. Cold.
        ///
        /// # Errors
        /// See [`open`].
        pub fn open(
            &self,
            profile: &Profile,
            period_s: f64,
            request: Option<ThreadRequest>,
        ) -> Result<(OpenedArm, Arc<LinkFigures>), OpenError> {
            let session = self.session.clone();
            let name = self.name.clone();
            let dial: Dial = Box::new(move || {
                let link = ZenohLink::to_node(&session, &name, request)
                    .map_err(|error| OpenError::Link(Box::new(error)))?;
                Ok(Box::new(link) as Box<dyn Transport>)
            });
            let options =
                RemoteOptions { name: self.name.clone(), period_s, timebase: Timebase::Monotonic };
            open(profile, &options, dial)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_device_that_begins_with_zenoh_is_a_node() {
        assert_eq!(RemoteArm::name_in("zenoh:left"), Some("left"));
        assert_eq!(RemoteArm::name_in("sim-sigma7"), None);
    }
}
