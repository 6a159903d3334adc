//! `hapticd device-node`: drives an arm for a host on another machine.

use core::time::Duration;

use super::hand::HandArgs;
use super::network::NetworkArgs;
use super::{OutputOptions, report};
use crate::error::Exit;
use arms::attached::nodes::Selector;
use rt::duration;

/// Arguments of `hapticd device-node`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Profile of the arm beside this machine: a name of devices/, or a file. Simulated ones
    /// (sim-…) run in this process.
    profile: String,
    /// Name by which hosts find it (`run --device zenoh:NAME`) [default: the profile's].
    #[arg(long, value_name = "NAME")]
    name: Option<String>,
    /// Which of several arms: VID:PID[:SERIAL] in hex, or the path of its node.
    #[arg(long, value_name = "SELECTOR")]
    selector: Option<Selector>,
    /// Let hosts put force on a real arm. Without it only an arm with a deadman takes any.
    /// Simulated arms need no leave.
    #[arg(long)]
    enable: bool,
    /// How long the last force is held when the host falls silent.
    #[arg(long, value_name = "MS", default_value_t = 10, value_parser = clap::value_parser!(u16).range(2..=100))]
    hold_ms: u16,
    /// Within what time it then fades to zero.
    #[arg(long, value_name = "MS", default_value_t = 20, value_parser = clap::value_parser!(u16).range(1..=100))]
    fade_ms: u16,
    #[command(flatten)]
    network: NetworkArgs,
    #[command(flatten)]
    hand: HandArgs,
    /// Processor to pin the loop to [default: the last one that no other loop is pinned to].
    #[arg(long, value_name = "CPU")]
    cpu: Option<usize>,
    /// Priority of the loop under SCHED_FIFO, where the system allows it.
    #[arg(long, value_name = "PRIORITY", default_value_t = 80, value_parser = clap::value_parser!(u8).range(1..=99))]
    priority: u8,
    /// End after this time [default: on Ctrl-C].
    #[arg(long, value_name = "TIME", value_parser = duration::parse)]
    duration: Option<Duration>,
    /// Print one JSON object at the end.
    #[arg(long)]
    json: bool,
}

pub(crate) fn main(args: &Args, output: OutputOptions) -> Exit {
    match over_network::node(args, output) {
        Ok(exit) => exit,
        Err((exit, message, hint)) => {
            if !message.is_empty() {
                report::error(&message, hint, output);
            }
            exit
        }
    }
}

/// The exit code, with what is still to be said, and what to do about it.
type Failure = (Exit, String, Option<&'static str>);

#[cfg(not(feature = "zenoh"))]
mod over_network {
    use super::*;
    use link::network::NetworkError;

    pub(super) fn node(args: &Args, _: OutputOptions) -> Result<Exit, Failure> {
        let Args {
            profile: _,
            name: _,
            selector: _,
            enable: _,
            hold_ms: _,
            fade_ms: _,
            network: _,
            ..
        } = args;
        Err((Exit::Usage, NetworkError::NotBuilt.to_string(), None))
    }
}

#[cfg(feature = "zenoh")]
mod over_network {
    use std::sync::Arc;

    use serde_json::json;

    use super::super::error::CliError;
    use super::super::network::exit_of;
    use super::super::status_line::{FAILED, report_lines};
    use super::super::{guard, output, probe};
    use super::*;
    use crate::daemon::device_node::{
        NodeArm, NodeJob, NodeNotice, NodeOutcome, node_parameters, open_arm, run_node,
    };
    use arms::attached::open::LinkNews;
    use arms::profile::{self, Profile, ProfileError};
    use arms::remote::Node;
    use arms::remote::command_hold::HoldTiming;
    use arms::remote::figures::{LinkPhase, NodeReport};
    use arms::simulated::hand::GripPath;
    use engine::servo::Control;
    use link::network::link::{ZenohLink, is_name, serve_profile};
    use link::network::{NetworkError, session};
    use rt::schedule::{self, ThreadRequest};
    use rt::signals;
    use vps::spatial::Axes;

    fn no_network(error: NetworkError) -> Failure {
        (exit_of(&error), error.to_string(), None)
    }

    pub(super) fn node(args: &Args, output: OutputOptions) -> Result<Exit, Failure> {
        let here = std::env::current_dir().unwrap_or_default();
        let profile = profile::find(&args.profile, &here).map_err(|error| match error {
            ProfileError::Invalid(errors) => {
                (report::config_errors(&errors, output), String::new(), None)
            }
            error => (Exit::Configuration, error.to_string(), None),
        })?;
        let name = args.name.clone().unwrap_or_else(|| profile.name.clone());
        if !is_name(&name) {
            return Err(no_network(NetworkError::Name { name }));
        }
        may_push(args, &profile, output)?;
        let hand = args
            .hand
            .hand(output)
            .map_err(|error| (error.report(output), String::new(), None))?
            .map(|mut hand| {
                hand.path =
                    hand.path.map(|path: GripPath| path.delayed(args.hand.delay().as_secs_f64()));
                hand
            });
        let request = ThreadRequest { cpu: schedule::loop_cpu(args.cpu), priority: args.priority };
        let period_s = 1.0 / f64::from(profile.link.rate_hz);
        let timing = HoldTiming {
            hold_s: f64::from(args.hold_ms) * 1e-3,
            fade_s: f64::from(args.fade_ms) * 1e-3,
        };

        let endpoints = args.network.endpoints().or_listen_here();
        if let Some(endpoint) = endpoints.unprotected() {
            let hint = "give --key-file FILE here and on the other machine, with the same key; \
                `openssl rand -hex 24` prints one";
            let message =
                format!("any program that meets this node at {endpoint} could drive the arm");
            return Err((Exit::Usage, message, Some(hint)));
        }
        let session = session::open(&endpoints).map_err(no_network)?;
        let NodeArm { device: arm, attached, declared } =
            open_arm(&profile, hand, args.selector.clone(), period_s, request, guard::program())
                .map_err(|error| (CliError::from(error).report(output), String::new(), None))?;
        let link =
            ZenohLink::to_host(&session, &name, Some(request.below())).map_err(no_network)?;
        let control = Arc::new(Control::new());
        signals::end_by_signals(&control)
            .map_err(|error| (Exit::Internal, error.to_string(), None))?;
        let parameters = node_parameters(&profile, &name, period_s, timing).lowered_by(declared);
        let node = Node::new(parameters, Box::new(link));
        // From here on hosts find it.
        let toml = profile::text(&args.profile, &here).unwrap_or_default();
        let _profile = serve_profile(&session, &name, toml).map_err(no_network)?;

        let meets = [endpoints.listen.join(", "), endpoints.connect.join(", ")].join(" ");
        let ready = format!("ready zenoh:{name} on {}\n", meets.trim());
        if args.json {
            output::message(format_args!("{ready}"));
        } else {
            output::result(format_args!("{ready}"));
            let _ = std::io::Write::flush(&mut std::io::stdout());
        }
        let news = attached.map(|attached| attached.news);
        let job = NodeJob { node, arm, news, period_s, request, duration: args.duration };
        let no_thread = |error: std::io::Error| {
            (Exit::Internal, format!("cannot start a thread: {error}"), None)
        };
        output::detach().map_err(no_thread)?;
        let outcome = run_node(job, &control, |notice| tell(&notice, output)).map_err(no_thread)?;
        output::attach();
        result(&outcome, &profile, &name, args.json);
        if outcome.panicked {
            return Err((
                Exit::Internal,
                "the loop of the node stopped on an internal error; the arm got zero".to_owned(),
                None,
            ));
        }
        Ok(Exit::Ok)
    }

    /// A real arm needs an explicit permission on this side too.
    fn may_push(args: &Args, profile: &Profile, output: OutputOptions) -> Result<(), Failure> {
        let Some(real) = &profile.real else { return Ok(()) };
        if profile.actuated != Axes::NONE && !args.enable && real.deadman_button.is_none() {
            let hint =
                "give --enable to let hosts put force on it; a profile with a deadman needs none";
            return Err((
                Exit::Device,
                "this is a real arm, and no operator can let force flow".to_owned(),
                Some(hint),
            ));
        }
        if let Some(instruction) = &real.homing.instruction {
            report::note(&format!("homing: {instruction}"), output);
        }
        if profile.has_unverified_signs() {
            let command = probe::command(profile, args.selector.as_ref(), "--sign-check");
            report::warning(
                &format!("signs not verified: force stays below 0.5 N ({command})"),
                output,
            );
        }
        Ok(())
    }

    fn tell(notice: &NodeNotice<'_>, output: OutputOptions) {
        if output.quiet {
            return;
        }
        match notice {
            NodeNotice::Phase(LinkPhase::Tripped, report) => {
                let ms = report.zero_after_ms;
                let text = format!(
                    "link: the host fell silent; no force {ms:.1} ms after its last command, until \
                        it has disabled"
                );
                output::event(
                    output::Level::Warning,
                    "link",
                    &text,
                    &[("link", "lost".into()), ("zero_after_ms", ms.into())],
                );
            }
            NodeNotice::Phase(phase, _) => {
                output::event(
                    output::Level::Info,
                    "node",
                    &format!("node: {}", phase.name()),
                    &[("phase", phase.name().into())],
                );
            }
            NodeNotice::Preflight(report) => {
                for line in report_lines(report, true, FAILED) {
                    output::event(output::Level::Warning, "preflight", &line, &[]);
                }
            }
            NodeNotice::Link(LinkNews::Lost) => {
                output::event(output::Level::Warning, "arm", "device: gone; looking for it", &[])
            }
            NodeNotice::Link(LinkNews::Back { node, .. }) => {
                output::event(
                    output::Level::Info,
                    "arm",
                    &format!("device: back at {}", node.display()),
                    &[],
                );
            }
            NodeNotice::Link(LinkNews::Fails(why)) => {
                output::event(output::Level::Warning, "arm", &format!("device: {why}"), &[])
            }
            NodeNotice::Link(LinkNews::Told(text)) => {
                output::event(output::Level::Warning, "arm", &format!("device: {text}"), &[])
            }
            NodeNotice::Link(LinkNews::Unguarded(why)) => {
                output::event(output::Level::Warning, "arm", &guard::missing_text(why), &[])
            }
        }
    }

    fn result(outcome: &NodeOutcome, profile: &Profile, name: &str, as_json: bool) {
        let NodeOutcome { report, periods, missed_periods, panicked, entered } = outcome;
        if as_json {
            let standing = entered.map(|entered| entered.standing).unwrap_or_default();
            let object = json!({
                "name": name, "profile": profile.name, "periods": periods, "missed_periods": missed_periods, "panicked": panicked,
                "fifo": standing.fifo, "cpu": standing.cpu, "link": report,
            });
            return output::result(format_args!("{object}\n"));
        }
        let NodeReport {
            commands,
            old_packets,
            lost_packets,
            strange_packets,
            link_losses,
            zero_after_ms,
            longest_gap_ms,
            ..
        } = report;
        output::result(format_args!(
            "periods            {periods}, {missed_periods} missed\ncommands           {commands}; \
                {lost_packets} lost, {old_packets} too late, {strange_packets} of other \
                hosts\nlongest gap        {longest_gap_ms:.1} ms with force on\nlink \
                losses        {link_losses}{}\n",
            if *link_losses > 0 {
                format!("; zero {zero_after_ms:.1} ms after the last command")
            } else {
                String::new()
            },
        ));
    }
}
