//! `[monitor]`, and the heartbeat that its clients owe.

use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::time::Duration;

use super::super::scene::MonitorConfig;
use super::super::schema;
use super::Resolve;
use document::Interval;

/// Where the monitor listens when neither the scene nor the command line gives an address.
const DEFAULT_LISTEN: SocketAddr = SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), 7878);

/// What `listen` and `--monitor` take.
pub(crate) const LISTEN_ACCEPTED: &str =
    "an address with its port such as 127.0.0.1:7878, [::1]:7878 or localhost:7878, or \"off\"";

/// Reads an address, or `off`. `None`: neither.
pub(crate) fn parse_listen(text: &str) -> Option<Option<SocketAddr>> {
    if text == "off" {
        return Some(None);
    }
    let address = match text.strip_prefix("localhost:") {
        Some(port) => port.parse().ok().map(|port: u16| (Ipv4Addr::LOCALHOST, port).into()),
        None => text.parse().ok(),
    };
    address.map(Some)
}

/// What `foxglove` and `--foxglove` take.
pub(crate) const FOXGLOVE_ACCEPTED: &str = "an address that only this machine can reach, for the \
    protocol carries no token, such as 127.0.0.1:8765, or \"off\"";

/// Reads an address of this machine alone, or `off`. `None`: neither.
pub(crate) fn parse_foxglove(text: &str) -> Option<Option<SocketAddr>> {
    parse_listen(text).filter(|listen| listen.is_none_or(|address| address.ip().is_loopback()))
}

impl Resolve<'_> {
    pub(super) fn monitor(&mut self, written: &schema::Monitor) -> MonitorConfig {
        let listen = match written.listen.as_deref().map(parse_listen) {
            None => Some(DEFAULT_LISTEN),
            Some(Some(listen)) => listen,
            Some(None) => {
                self.checks.not_accepted("monitor.listen", LISTEN_ACCEPTED);
                None
            }
        };
        let token_file = written
            .token_file
            .as_deref()
            .and_then(|file| self.checks.file("monitor.token_file", file, self.dir));
        let origins = written.origins.clone().unwrap_or_default();
        for (idx, origin) in origins.iter().enumerate() {
            let name = origin.strip_prefix("http://").or(origin.strip_prefix("https://"));
            if !name.is_some_and(|name| !name.is_empty() && !name.contains('/')) {
                let accepted =
                    "a scheme and a host, and a port if it has one, such as http://localhost:8000";
                self.checks.not_accepted(&format!("monitor.origins[{idx}]"), accepted);
            }
        }
        let foxglove = match written.foxglove.as_deref().map(parse_foxglove) {
            None => None,
            Some(Some(foxglove)) => foxglove,
            Some(None) => {
                self.checks.not_accepted("monitor.foxglove", FOXGLOVE_ACCEPTED);
                None
            }
        };
        MonitorConfig { listen, token_file, origins, foxglove }
    }

    pub(super) fn heartbeat(&mut self, written: &schema::Safety) -> Option<Duration> {
        let interval = Interval::from(20.0).to(10_000.0).unit("ms");
        let longest_ms =
            self.checks.optional("safety.heartbeat_ms", written.heartbeat_ms, interval)?;
        // Within the interval, or there is no scene.
        Duration::try_from_secs_f64(longest_ms * 1e-3).ok()
    }
}
