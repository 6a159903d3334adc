//! The network between machines: how this process takes part in it (feature `zenoh`).
//!
//! Data in: endpoints of the command line, or a file of zenoh's own. Data out: an open session. The
//! packets of an arm on another machine ([`arms::remote`]) travel over `link`.
//!
//! Invariant: nothing is announced to a network that the user did not name, see `session`.

#[cfg(feature = "zenoh")]
pub mod link;
#[cfg(feature = "zenoh")]
pub mod session;

use std::net::IpAddr;
use std::path::PathBuf;

/// Where a process meets others.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Endpoints {
    /// Addresses to listen on, such as `udp/0.0.0.0:7447`.
    pub listen: Vec<String>,
    /// Addresses to connect to, again and again until a peer answers.
    pub connect: Vec<String>,
    /// A zenoh configuration, JSON5, for everything else: interfaces, certificates, scouting.
    pub config_file: Option<PathBuf>,
    /// A file with the key that every peer that connects has to know.
    pub key_file: Option<PathBuf>,
}

/// Characters of a key, at least and at most: no person types them, and a file that is something
/// else is noticed.
const KEY_LEAST: usize = 16;
const KEY_MOST: usize = 512;

/// Where two processes of one machine meet when no endpoint is given. It cannot be reached from
/// outside of the machine.
pub const HERE: &str = "udp/127.0.0.1:7447";

impl Endpoints {
    /// True when no endpoint is given.
    pub fn is_empty(&self) -> bool {
        self.listen.is_empty() && self.connect.is_empty() && self.config_file.is_none()
    }

    /// These, or a listener for processes of this machine alone.
    #[must_use]
    pub fn or_listen_here(self) -> Self {
        if self.is_empty() { Self { listen: vec![HERE.to_owned()], ..self } } else { self }
    }

    /// These, or a peer that listens on this machine.
    #[must_use]
    pub fn or_connect_here(self) -> Self {
        if self.is_empty() { Self { connect: vec![HERE.to_owned()], ..self } } else { self }
    }

    /// An endpoint through which a program on another machine could command an arm of this one. A
    /// key protects what is listened on alone: only the side that listens asks for it. Settings of
    /// zenoh's own are taken for the protection that the user wants.
    pub fn unprotected(&self) -> Option<&str> {
        if self.config_file.is_some() {
            return None;
        }
        let listen = self.listen.iter().filter(|_| self.key_file.is_none());
        listen.chain(&self.connect).map(String::as_str).find(|at| !is_here(at))
    }
}

/// Whether an endpoint is one of this machine alone.
fn is_here(endpoint: &str) -> bool {
    let address = endpoint.split_once('/').map_or(endpoint, |(_, address)| address);
    let address = address.split(['?', '#']).next().unwrap_or_default();
    let host = address.rsplit_once(':').map_or(address, |(host, _)| host);
    let ip = host.trim_start_matches('[').trim_end_matches(']').parse::<IpAddr>();
    host == "localhost" || ip.is_ok_and(|ip| ip.is_loopback())
}

/// Why there is no session.
#[derive(Debug, thiserror::Error)]
pub enum NetworkError {
    /// An endpoint that cannot be read.
    #[error(
        "endpoint `{endpoint}`: {cause}; expected a protocol, a host and a port, such as \
            udp/192.168.1.10:7447 or tcp/[::1]:7447"
    )]
    Endpoint {
        /// As written.
        endpoint: String,
        /// What zenoh says.
        cause: String,
    },
    /// The file of settings.
    #[error("{}: {cause}", .path.display())]
    ConfigFile {
        /// Which.
        path: PathBuf,
        /// What zenoh says.
        cause: String,
    },
    /// The file of the key.
    #[error(
        "key file {}: {cause}; write {KEY_LEAST} to {KEY_MOST} printable ASCII characters without \
            spaces into it, as `openssl rand -hex 24` prints them",
        .path.display()
    )]
    Key {
        /// Which.
        path: PathBuf,
        /// Why.
        cause: String,
    },
    /// The session did not open.
    #[error("cannot open a zenoh session{}: {cause}", if .listen.is_empty() { String::new() } else { format!(" that listens on {}", .listen.join(", ")) })]
    Open {
        /// Where it was to listen.
        listen: Vec<String>,
        /// What zenoh says.
        cause: String,
    },
    /// A link over an open session.
    #[error("cannot reach {name}: {cause}")]
    Link {
        /// Name of the node.
        name: String,
        /// What zenoh or the system says.
        cause: String,
    },
    /// No node of that name.
    #[error(
        "no device node named {name} answered within {waited_s} s; run `hapticd device-node \
            PROFILE --name {name}` beside the arm, and give --connect the address at which it listens"
    )]
    NoNode {
        /// Name.
        name: String,
        /// For how long it was asked for, s.
        waited_s: u64,
    },
    /// A name that cannot be part of a key.
    #[error("`{name}` cannot name a device node: write 1 to 32 letters, digits, `-`, `_` and `.`")]
    Name {
        /// As written.
        name: String,
    },
    /// This program was built without it.
    #[error(
        "this program was built without a network: build with `cargo build --release --features \
            zenoh`"
    )]
    NotBuilt,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_a_word_both_ends_meet_on_this_machine_alone() {
        let node = Endpoints::default().or_listen_here();
        let host = Endpoints::default().or_connect_here();
        assert_eq!((node.listen, host.connect), (vec![HERE.to_owned()], vec![HERE.to_owned()]));
        let named = Endpoints { connect: vec!["tcp/host:1".to_owned()], ..Endpoints::default() };
        assert_eq!(named.clone().or_listen_here(), named);
    }

    #[test]
    fn an_endpoint_that_others_reach_wants_a_key() {
        let listens = |endpoint: &str| Endpoints {
            listen: vec![HERE.to_owned(), endpoint.to_owned()],
            ..Endpoints::default()
        };
        for here in ["udp/127.0.0.1:7447", "tcp/[::1]:7447", "tcp/localhost:1", "udp/127.3.2.1:9"] {
            assert_eq!(listens(here).unprotected(), None, "{here}");
        }
        for there in [
            "udp/0.0.0.0:7447",
            "tcp/[::]:7447",
            "udp/192.168.1.10:7447",
            "tcp/localhost.example.org:1",
            "udp/0.0.0.0:7447#iface=lo",
            "tcp/127.0.0.1.example.org:1",
        ] {
            assert_eq!(listens(there).unprotected(), Some(there));
            let key_file = Some(PathBuf::from("key"));
            let with_key = Endpoints { key_file: key_file.clone(), ..listens(there) };
            assert_eq!(with_key.unprotected(), None);
            // The key does not say who answers there.
            let connect = vec![there.to_owned()];
            let connects = Endpoints { connect, key_file, ..Endpoints::default() };
            assert_eq!(connects.unprotected(), Some(there));
            let config_file = Some(PathBuf::from("zenoh.json5"));
            assert_eq!(Endpoints { config_file, ..connects }.unprotected(), None);
        }
        assert_eq!(Endpoints::default().or_listen_here().unprotected(), None);
    }
}
