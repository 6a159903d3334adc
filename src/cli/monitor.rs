//! `run --monitor`: where the page and its API are, and which clients have access.

use std::net::SocketAddr;
use std::path::PathBuf;

use super::error::CliError;
use super::{OutputOptions, report};
use crate::config::SceneConfig;
use crate::config::{LISTEN_ACCEPTED, parse_listen};
use crate::error::Exit;
use crate::monitor::{Access, BoundMonitor, Token, TokenError};
use rt::clock::ClockKind;

/// Variable of the environment that holds a token.
const TOKEN_VARIABLE: &str = "HAPTICD_TOKEN";

/// Arguments of the monitor.
#[derive(Debug, clap::Args)]
pub(crate) struct MonitorArgs {
    /// Serve the page and its API at this address, such as 127.0.0.1:7878, or "off" [default: as
    /// the scene says; off under --clock virtual]. An address that is not of this machine alone
    /// needs a token.
    #[arg(long, value_name = "ADDR|off", value_parser = parse)]
    monitor: Option<Listen>,
    /// File with the token that clients of the monitor have to know [default: that of
    /// HAPTICD_TOKEN, else of the scene, else for a real arm a new one, which is printed].
    #[arg(long, value_name = "FILE")]
    monitor_token: Option<PathBuf>,
}

/// An address, or off.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Listen(Option<SocketAddr>);

fn parse(text: &str) -> Result<Listen, String> {
    parse_listen(text).map(Listen).ok_or_else(|| format!("write {LISTEN_ACCEPTED}"))
}

impl MonitorArgs {
    /// Takes the address, before anything takes long. `None`: no monitor. A default that cannot be
    /// had is a warning, what was asked for an error.
    pub(crate) fn open(
        &self,
        config: &SceneConfig,
        clock: ClockKind,
        output: OutputOptions,
    ) -> Result<Option<BoundMonitor>, CliError> {
        let listen = match (self.monitor, clock) {
            (Some(Listen(listen)), _) => listen,
            (None, ClockKind::Virtual) => None,
            (None, ClockKind::Real) => config.monitor.listen,
        };
        let needed = config.heartbeat.is_some();
        let Some(address) = listen else {
            if needed {
                return Err(CliError::usage(
                    "the scene wants a client with a heartbeat, and the monitor is off",
                )
                .hint("give --monitor 127.0.0.1:7878, or leave out `safety.heartbeat_ms`"));
            }
            return Ok(None);
        };
        let refused = |error: TokenError| {
            CliError::usage(error).hint("`openssl rand -hex 24 > monitor.token` makes one")
        };
        let token = self.token(config).map_err(refused)?;
        if !Access::is_safe(address, token.as_ref()) {
            let exit = if self.monitor.is_some() { Exit::Usage } else { Exit::Configuration };
            let message = format_args!(
                "the monitor at {address} can be reached from other machines, and has no token"
            );
            return Err(CliError::new(exit, message).hint(
                "give --monitor-token FILE, or set HAPTICD_TOKEN: any machine that reaches this \
                    address could drive the arm",
            ));
        }
        // Every account of this machine reaches a loopback address.
        let is_open = token.is_none() && config.device.profile.real.is_some();
        let made = is_open.then(Token::random).transpose().map_err(refused)?;
        let secret = made.as_ref().map_or(String::new(), |made| format!("#token={}", made.text()));
        match BoundMonitor::bind(address, token.or(made), config.monitor.origins.clone()) {
            Ok(bound) => {
                // Without this line no operator would know the token that was made.
                let output = OutputOptions { quiet: output.quiet && secret.is_empty(), ..output };
                report::line(&format!("monitor: http://{}/{secret}", bound.address()), output);
                Ok(Some(bound))
            }
            Err(error) if self.monitor.is_none() && !needed => {
                let message = format!(
                    "no monitor: cannot listen at {address}: {error} (--monitor ADDR takes another)"
                );
                report::warning(&message, output);
                Ok(None)
            }
            Err(error) => Err(CliError::usage(format_args!(
                "the monitor cannot listen at {address}: {error}"
            ))
            .hint(
                "give another one with --monitor, such as 127.0.0.1:0 for any port that is free",
            )),
        }
    }

    fn token(&self, config: &SceneConfig) -> Result<Option<Token>, TokenError> {
        if let Some(file) = &self.monitor_token {
            return Token::read(file).map(Some);
        }
        match (std::env::var(TOKEN_VARIABLE), &config.monitor.token_file) {
            (Ok(text), _) if !text.is_empty() => Token::new(&text, TOKEN_VARIABLE).map(Some),
            (_, Some(file)) => Token::read(file).map(Some),
            _ => Ok(None),
        }
    }
}
