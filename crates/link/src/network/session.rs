//! Opening a zenoh session.
//!
//! A peer that connects to us proves that it has the key (zenoh's challenge and HMAC); a peer to
//! which we connect proves nothing.
//!
//! Two rules differ from what zenoh does by itself. Nothing is looked for by multicast or gossip: a
//! program that moves an arm connects only to the endpoints it was given, and two test runs on one
//! machine never find each other. And a session listens only at the endpoints it was given.

use std::io::{self, Write as _};
use std::path::Path;

use tempfile::NamedTempFile;
use zenoh::{Config, Session, Wait};

use super::{Endpoints, KEY_LEAST, KEY_MOST, NetworkError};
use vps::storage::regular;

/// Opens a session of a peer. Endpoints where no peer answers yet are tried again in the background
/// until the session ends. Cold; starts zenoh's own threads.
///
/// # Errors
/// An endpoint or a file that cannot be read, or an address that cannot be listened on.
pub fn open(endpoints: &Endpoints) -> Result<Session, NetworkError> {
    let Endpoints { listen, connect, config_file, key_file } = endpoints;
    let key = key_file.as_deref().map(key).transpose()?;
    for endpoint in listen.iter().chain(connect) {
        endpoint.parse::<zenoh::config::EndPoint>().map_err(|cause| NetworkError::Endpoint {
            endpoint: endpoint.clone(),
            cause: words(&cause),
        })?;
    }
    let config = match config_file {
        Some(path) => Config::from_file(path).map_err(|cause| NetworkError::ConfigFile {
            path: path.clone(),
            cause: words(&cause),
        })?,
        None => quiet().map_err(|cause| NetworkError::Open { listen: listen.clone(), cause })?,
    };
    // Zenoh reads the file while it opens.
    let mut known = None;
    let opened = with_endpoints(config, endpoints)
        .and_then(|config| match &key {
            Some(key) => {
                let file = dictionary(key).map_err(|error| error.to_string())?;
                with_key(config, key, known.insert(file).path())
            }
            None => Ok(config),
        })
        .and_then(|config| zenoh::open(config).wait().map_err(|cause| words(&cause)));
    opened.map_err(|cause| NetworkError::Open { listen: listen.clone(), cause })
}

/// Who has the key, for zenoh.
const USER: &str = "hapticd";

/// The key that a file holds.
fn key(path: &Path) -> Result<String, NetworkError> {
    let refused = |cause: String| NetworkError::Key { path: path.to_owned(), cause };
    // There may be blanks around it.
    let text =
        regular::text(path, 2 * KEY_MOST as u64).map_err(|error| refused(error.to_string()))?;
    let key = text.trim();
    let is_sound = (KEY_LEAST..=KEY_MOST).contains(&key.len())
        && key.bytes().all(|byte| byte.is_ascii_graphic());
    if is_sound { Ok(key.to_owned()) } else { Err(refused("it holds no key".to_owned())) }
}

/// The peers that are let in, as zenoh reads them: a file of this user alone.
fn dictionary(key: &str) -> io::Result<NamedTempFile> {
    let mut file = NamedTempFile::new()?;
    writeln!(file, "{USER}:{key}")?;
    Ok(file)
}

fn with_key(mut config: Config, key: &str, dictionary: &Path) -> Result<Config, String> {
    let dictionary = dictionary.to_string_lossy();
    for (name, value) in [("user", USER), ("password", key), ("dictionary_file", &*dictionary)] {
        let quoted = serde_json::Value::from(value).to_string();
        // What zenoh says of it may hold the key.
        config
            .insert_json5(&format!("transport/auth/usrpwd/{name}"), &quoted)
            .map_err(|_| format!("zenoh takes no {name} of the key"))?;
    }
    Ok(config)
}

/// What zenoh says, without where in its own source it says so.
fn words(cause: &impl core::fmt::Display) -> String {
    let text = cause.to_string();
    text.split(" at /").next().unwrap_or_default().to_owned()
}

/// A peer that looks for no other and listens nowhere.
fn quiet() -> Result<Config, String> {
    let mut config = Config::default();
    for (key, value) in [
        ("mode", "\"peer\""),
        ("scouting/multicast/enabled", "false"),
        ("scouting/gossip/enabled", "false"),
        ("listen/endpoints", "[]"),
        (
            "connect/retry",
            "{ period_init_ms: 200, period_max_ms: 1000, period_increase_factor: 2 }",
        ),
    ] {
        config.insert_json5(key, value).map_err(|cause| format!("{key}: {}", words(&cause)))?;
    }
    Ok(config)
}

fn with_endpoints(mut config: Config, endpoints: &Endpoints) -> Result<Config, String> {
    for (key, list) in
        [("listen/endpoints", &endpoints.listen), ("connect/endpoints", &endpoints.connect)]
    {
        if !list.is_empty() {
            let quoted = serde_json::Value::from(list.clone()).to_string();
            config
                .insert_json5(key, &quoted)
                .map_err(|cause| format!("{key}: {}", words(&cause)))?;
        }
    }
    Ok(config)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_endpoint_that_is_none_is_named() {
        let endpoints = Endpoints { connect: vec!["7447".to_owned()], ..Endpoints::default() };
        let text = open(&endpoints).expect_err("no endpoint").to_string();
        assert!(
            text.starts_with("endpoint `7447`") && text.contains("udp/192.168.1.10:7447"),
            "{text}"
        );
    }

    fn free_endpoint() -> Vec<String> {
        let free = std::net::UdpSocket::bind("127.0.0.1:0")
            .and_then(|socket| socket.local_addr())
            .expect("a port");
        vec![format!("udp/{free}")]
    }

    fn peers(session: &Session) -> usize {
        session.info().peers_zid().wait().count()
    }

    fn wait_for_peers(session: &Session) {
        let begin = std::time::Instant::now();
        while peers(session) == 0 && begin.elapsed().as_secs() < 20 {
            std::thread::sleep(std::time::Duration::from_millis(20));
        }
    }

    #[test]
    fn two_sessions_meet_where_they_were_ordered_to_and_nowhere_else() {
        let endpoint = free_endpoint();
        let one =
            open(&Endpoints { listen: endpoint.clone(), ..Endpoints::default() }).expect("listens");
        let other =
            open(&Endpoints { connect: endpoint, ..Endpoints::default() }).expect("connects");
        let alone = open(&Endpoints::default()).expect("alone");
        wait_for_peers(&one);
        assert_eq!((peers(&one), peers(&other), peers(&alone)), (1, 1, 0));
    }

    #[test]
    fn a_peer_without_the_key_is_not_let_in() {
        let folder = tempfile::tempdir().expect("a folder");
        let written = |name: &str, text: &str| {
            let path = folder.path().join(name);
            std::fs::write(&path, text).expect("written");
            Some(path)
        };
        let key_file = written("key", "0123456789abcdef0123\n");
        let other_key = written("other", "0123456789abcdef0124\n");
        let listen = free_endpoint();
        let connect = listen.clone();
        let node = Endpoints { listen, key_file: key_file.clone(), ..Endpoints::default() };
        let node = open(&node).expect("listens");
        let host =
            |key_file| Endpoints { connect: connect.clone(), key_file, ..Endpoints::default() };
        let without = open(&host(None)).expect("tries");
        let with_other = open(&host(other_key)).expect("tries");
        // They try five times a second, from before the one that is let in.
        let with_key = open(&host(key_file)).expect("connects");
        wait_for_peers(&with_key);
        std::thread::sleep(std::time::Duration::from_millis(500));
        assert_eq!([&with_key, &without, &with_other, &node].map(peers), [1, 0, 0, 1]);
        for text in ["", "too short", "0123456789 0123456789", "0123456789abcdefé"] {
            let refused = open(&host(written("bad", text))).expect_err("no key").to_string();
            assert!(refused.contains("openssl rand -hex 24"), "{refused}");
        }
    }
}
