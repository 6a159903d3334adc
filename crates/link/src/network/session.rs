//! Opening a zenoh session.
//!
//! Two rules differ from what zenoh does by itself. Nothing is looked for by multicast or gossip: a
//! program that moves an arm connects only to the endpoints it was given, and two test runs on one
//! machine never find each other. And a session listens only at the endpoints it was given.

use zenoh::{Config, Session, Wait};

use super::{Endpoints, NetworkError};

/// Opens a session of a peer. Endpoints where no peer answers yet are tried again in the background
/// until the session ends. Cold; starts zenoh's own threads.
///
/// # Errors
/// An endpoint or a file that cannot be read, or an address that cannot be listened on.
pub fn open(endpoints: &Endpoints) -> Result<Session, NetworkError> {
    let Endpoints { listen, connect, config_file } = endpoints;
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
    let opened = with_endpoints(config, endpoints)
        .and_then(|config| zenoh::open(config).wait().map_err(|cause| words(&cause)));
    opened.map_err(|cause| NetworkError::Open { listen: listen.clone(), cause })
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

    #[test]
    fn two_sessions_meet_where_they_were_ordered_to_and_nowhere_else() {
        let free = std::net::UdpSocket::bind("127.0.0.1:0")
            .and_then(|socket| socket.local_addr())
            .expect("a port");
        let endpoint = vec![format!("udp/{free}")];
        let one =
            open(&Endpoints { listen: endpoint.clone(), ..Endpoints::default() }).expect("listens");
        let other =
            open(&Endpoints { connect: endpoint, ..Endpoints::default() }).expect("connects");
        let alone = open(&Endpoints::default()).expect("alone");
        let peers = |session: &Session| session.info().peers_zid().wait().count();
        let begin = std::time::Instant::now();
        while peers(&one) == 0 && begin.elapsed().as_secs() < 20 {
            std::thread::sleep(std::time::Duration::from_millis(20));
        }
        assert_eq!((peers(&one), peers(&other), peers(&alone)), (1, 1, 0));
    }
}
