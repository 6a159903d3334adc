//! `hapticd device-node`: drives an arm for a host on another machine.

use core::time::Duration;

use super::OutputOptions;
use super::error::Outcome;
use super::hand::HandArgs;
use super::network::NetworkArgs;
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

pub(crate) fn main(args: &Args, output: OutputOptions) -> Outcome {
    over_network::node(args, output)
}

#[cfg(not(feature = "zenoh"))]
mod over_network {
    use super::*;
    use link::network::NetworkError;

    pub(super) fn node(args: &Args, _: OutputOptions) -> Outcome {
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
        Err(NetworkError::NotBuilt.into())
    }
}

#[cfg(feature = "zenoh")]
mod over_network {
    use std::sync::Arc;

    use serde_json::json;

    use super::super::error::CliError;
    use super::super::status_line::{FAILED, link_line, report_lines};
    use super::super::{guard, output, probe, report};
    use super::*;
    use crate::daemon::device_node::{
        NodeArm, NodeJob, NodeNotice, NodeOutcome, node_parameters, open_arm, run_node,
    };
    use crate::error::Exit;
    use arms::profile::{self, Profile};
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

    pub(super) fn node(args: &Args, output: OutputOptions) -> Outcome {
        let here = std::env::current_dir().unwrap_or_default();
        let profile = profile::find(&args.profile, &here)?;
        let name = args.name.clone().unwrap_or_else(|| profile.name.clone());
        if !is_name(&name) {
            return Err(NetworkError::Name { name }.into());
        }
        may_push(args, &profile, output)?;
        let hand = args.hand.hand(output)?.map(|mut hand| {
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
            let hint = if endpoints.connect.iter().any(|known| known == endpoint) {
                "a key proves who comes in, not who is met: let the node listen, with --listen and \
                    --key-file FILE, or give --zenoh-config FILE with certificates"
            } else {
                "give --key-file FILE here and on the other machine, with the same key; `openssl \
                    rand -hex 24` prints one"
            };
            return Err(CliError::usage(format_args!(
                "any program that meets this node at {endpoint} could drive the arm"
            ))
            .hint(hint));
        }
        let session = session::open(&endpoints)?;
        let NodeArm { device: arm, attached, declared } =
            open_arm(&profile, hand, args.selector.clone(), period_s, request, guard::program())?;
        let link = ZenohLink::to_host(&session, &name, Some(request.below()))?;
        let control = Arc::new(Control::new());
        signals::end_by_signals(&control).map_err(CliError::internal)?;
        let parameters = node_parameters(&profile, &name, period_s, timing).lowered_by(declared);
        let node = Node::new(parameters, Box::new(link));
        // From here on hosts find it.
        let toml = profile::text(&args.profile, &here).unwrap_or_default();
        let _profile = serve_profile(&session, &name, toml)?;

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
        output::detach().map_err(CliError::thread)?;
        let outcome =
            run_node(job, &control, |notice| tell(&notice, output)).map_err(CliError::thread)?;
        output::attach();
        result(&outcome, &profile, &name, args.json);
        if outcome.panicked {
            return Err(CliError::internal(
                "the loop of the node stopped on an internal error; the arm got zero",
            ));
        }
        Ok(Exit::Ok)
    }

    /// A real arm needs an explicit permission on this side too.
    fn may_push(args: &Args, profile: &Profile, output: OutputOptions) -> Result<(), CliError> {
        let Some(real) = &profile.real else { return Ok(()) };
        if profile.actuated != Axes::NONE && !args.enable && real.deadman_button.is_none() {
            let hint =
                "give --enable to let hosts put force on it; a profile with a deadman needs none";
            let error = CliError::device("this is a real arm, and no operator can let force flow");
            return Err(error.hint(hint));
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
            NodeNotice::Link(news) => {
                let (level, state, text) = link_line(news);
                output::event(level, "arm", &text, &[("link", state.into())]);
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
