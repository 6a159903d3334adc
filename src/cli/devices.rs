//! `hapticd devices`: which arms are attached, and what stands in their way.

use core::sync::atomic::{AtomicBool, Ordering};
use core::time::Duration;
use std::sync::Arc;

use clap::Subcommand;
use serde_json::{Value, json};

use super::{Talk, report, say};
use crate::device::discover::{self, Attached};
use crate::device::identify::Made;
use crate::device::nodes::{self, Selector};
use crate::device::open::{self, OpenOptions};
use crate::device::probe::{self, Answers, Sign, Trial};
use crate::device::profile::{self, Profile, ProfileError};
use crate::device::{Device, Pacing};
use crate::error::Exit;
use crate::rt::clock::RealClock;
use crate::rt::finding::{Finding, Root, Standing};
use crate::rt::{duration, signals};

/// Arguments of `hapticd devices`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    #[command(subcommand)]
    command: Option<DevicesCommand>,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Subcommand)]
enum DevicesCommand {
    /// List hidraw nodes and serial ports, with the profiles that they fit.
    List {
        /// Print one JSON object.
        #[arg(long)]
        json: bool,
    },
    /// Open an arm and try it out: listens for 10 s with zero commands.
    Probe(Probe),
}

/// Arguments of `hapticd devices probe`.
#[derive(Debug, clap::Args)]
struct Probe {
    /// Profile of the arm: a name of devices/, or a file.
    profile: String,
    /// Which of several: VID:PID[:SERIAL] in hex, or the path of a node.
    #[arg(long, value_name = "S")]
    selector: Option<Selector>,
    /// Shake each axis with less than 0.5 N and fit mass and viscosity. Let go of the grip.
    #[arg(long)]
    identify: bool,
    /// Push each axis with 0.3 N for 0.2 s and look which way it goes. Hold the grip loosely.
    #[arg(long)]
    sign_check: bool,
    /// How long to listen.
    #[arg(long, value_name = "TIME", default_value = "10s", value_parser = duration::parse)]
    duration: Duration,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

pub(crate) fn main(args: &Args, talk: Talk) -> Exit {
    if let Some(DevicesCommand::Probe(args)) = &args.command {
        return probe(args, talk).unwrap_or_else(|exit| exit);
    }
    let as_json = args.json || matches!(args.command, Some(DevicesCommand::List { json: true }));
    let root = Root::default();
    let attached = discover::attached(nodes::list(), &discover::known_arms(), &root, discover::may_use);
    if as_json {
        let nodes: Vec<Value> = attached.iter().map(|found| node_json(found, &root)).collect();
        say::result(format_args!("{}\n", json!({ "nodes": nodes })));
        return Exit::Ok;
    }
    if attached.is_empty() {
        report::note(
            "no hidraw node and no serial port: is the arm plugged in and switched on? `hapticd doctor` looks further",
            talk,
        );
        return Exit::Ok;
    }
    for found in &attached {
        say::result(format_args!("{}\n", node_line(found)));
        for finding in troubles(found, &root) {
            say::result(format_args!("    {}: {}\n        type: {}\n", finding.name, finding.found, finding.advice));
        }
    }
    Exit::Ok
}

fn probe(args: &Probe, talk: Talk) -> Result<Exit, Exit> {
    let fail = |exit: Exit, message: String| {
        report::error(&message, None, talk);
        exit
    };
    let here = std::env::current_dir().unwrap_or_default();
    let profile = profile::find(&args.profile, &here).map_err(|error| match error {
        ProfileError::Invalid(errors) => report::config_errors(&errors, talk),
        error => fail(Exit::Configuration, error.to_string()),
    })?;
    let period_s = 1.0 / f64::from(profile.link.rate_hz);
    let options = OpenOptions { selector: args.selector.clone(), io_request: None, period_s };
    let mut opened = open::open(&profile, &options).map_err(|error| fail(Exit::Device, error.to_string()))?;
    let path = opened.path.display().to_string();
    report::note(&format!("{} at {path}: listening for {:.0} s", profile.title, args.duration.as_secs_f64()), talk);
    let lost = |ended| match ended {
        probe::Ended::Told => Exit::Ok,
        probe::Ended::Device(_) => {
            let hint = "is its plug loose? `hapticd devices` lists what there is";
            fail(Exit::Device, format!("the arm at {path} went away; {hint}"))
        }
    };
    // From here on Ctrl-C takes the force off first.
    let quit = Arc::new(AtomicBool::new(false));
    let interrupts = signals::interrupts().map_err(|error| fail(Exit::Internal, error.to_string()))?;
    let flag = quit.clone();
    std::thread::spawn(move || {
        if interrupts.recv().is_ok() {
            flag.store(true, Ordering::Relaxed);
        }
    });
    let arm = &mut opened.arm;
    let trial = &mut Trial { clock: RealClock, period_s, quit: &quit };
    let answers = probe::listen(arm, trial, args.duration).map_err(lost)?;
    let (mut signs, mut made) = ([None; 3], [None; 3]);
    if args.sign_check {
        report::note("sign check: hold the grip loosely; three pushes of 0.3 N follow", talk);
        std::thread::sleep(BEFORE_FORCE);
        signs = probe::check_signs(arm, trial).map_err(lost)?;
    }
    if args.identify {
        report::note("identification: let go of the grip; each axis is shaken for 14 s", talk);
        std::thread::sleep(BEFORE_FORCE);
        made = probe::identify(arm, trial).map_err(lost)?;
    }
    arm.stop();
    let findings = probe_findings(&profile, &answers, args, signs, made);
    if args.json {
        say::result(format_args!("{}\n", probe_json(&profile, &path, &answers, signs, made, &findings)));
    } else {
        for finding in &findings {
            say::result(format_args!("{:<8} {:<16} {}\n", finding.standing.name(), finding.name, finding.found));
            if !finding.advice.is_empty() {
                say::result(format_args!("{:<8} {:<16} type: {}\n", "", "", finding.advice));
            }
        }
        if args.identify && made.iter().any(Option::is_some) {
            say::result(format_args!("{}", identified_text(&answers, made)));
        }
    }
    let is_bad = findings.iter().any(|finding| finding.standing == Standing::Bad);
    Ok(if is_bad { Exit::Device } else { Exit::Ok })
}

/// Time for hands to come or go.
const BEFORE_FORCE: Duration = Duration::from_secs(2);

fn probe_findings(
    profile: &Profile,
    answers: &Answers,
    args: &Probe,
    signs: [Option<Sign>; 3],
    made: [Option<Made>; 3],
) -> Vec<Finding> {
    let mut findings = Vec::new();
    let share = answers.fresh as f64 / answers.ticks.max(1) as f64;
    let found = format!(
        "{} of {} ticks brought a sample; longest silence {} ticks; round trip {} ticks",
        answers.fresh, answers.ticks, answers.longest_silence_ticks, answers.round_trip_ticks
    );
    let is_event = profile.link.pacing == Pacing::Event;
    findings.push(if answers.fresh == 0 && !is_event {
        Finding::bad("answers", found, "hapticd doctor; switch the arm off and on, then try again")
    } else if share < 0.99 && !is_event {
        Finding::advice("answers", found, "hapticd doctor: latency timer, autosuspend and wake-ups are the usual causes")
    } else {
        Finding::good("answers", found)
    });
    let found = format!("{} corrupt packets, {} lost ones", answers.corrupt, answers.lost_packets);
    findings.push(if answers.corrupt + answers.lost_packets == 0 {
        Finding::good("packets", found)
    } else {
        Finding::advice("packets", found, "try another cable, and a port of the machine itself instead of a hub")
    });
    findings.push(match (answers.homed, answers.error) {
        (_, error) if error != 0 => Finding::bad("arm", format!("reports error {error}"), "switch the arm off and on"),
        (false, _) if answers.fresh > 0 => {
            let homing = profile.real.as_ref().and_then(|real| real.homing.instruction.clone()).unwrap_or_default();
            Finding::advice("arm", "is not homed", if homing.is_empty() { "home it".to_owned() } else { homing })
        }
        _ => Finding::good("arm", "homed, no error"),
    });
    let [x, y, z] = answers.position_m.to_array().map(|way| way * 1e3);
    let found = format!("({x:.2}, {y:.2}, {z:.2}) mm; it moved by at most {:.3} mm while listening", answers.spread_m * 1e3);
    findings.push(Finding::good("position", found));
    if args.sign_check {
        for (axis, sign) in probe::AXIS_NAMES.iter().zip(signs) {
            findings.extend(sign.map(|sign| match sign {
                Sign::Right => Finding::good(format!("sign of {axis}"), "goes the way it is pushed"),
                Sign::Wrong => Finding::bad(
                    format!("sign of {axis}"),
                    "goes against the push: force would feed back on itself",
                    "change motor_sign or encoder_sign of the joints behind this axis in a copy of the profile, and check again",
                ),
                Sign::Still => {
                    Finding::advice(format!("sign of {axis}"), "hardly moved", "hold the grip more loosely and check again")
                }
            }));
        }
        if signs.iter().flatten().all(|sign| *sign == Sign::Right) && signs.iter().any(Option::is_some) {
            findings.push(Finding::good("signs", "all right: set signs_verified = true in a copy of the profile"));
        }
    }
    if args.identify {
        for (axis, made) in probe::AXIS_NAMES.iter().zip(made) {
            findings.extend(made.map(|made| {
                let Made { mass_kg, mass_spread_kg, damping_n_s_per_m, damping_spread_n_s_per_m, coulomb_n, .. } = made;
                let found = format!(
                    "{mass_kg:.3} ± {mass_spread_kg:.3} kg, {damping_n_s_per_m:.2} ± {damping_spread_n_s_per_m:.2} N·s/m, dry friction {coulomb_n:.3} N"
                );
                Finding::good(format!("made of, {axis}"), found)
            }));
        }
        if made.iter().all(Option::is_none) {
            findings.push(Finding::advice("made of", "no axis moved", "let go of the grip and try again"));
        }
    }
    findings
}

/// What to add to a copy of the profile: the lightest and the least damped axis, which is what stability is judged by. Of the viscosity only what is sure.
fn identified_text(answers: &Answers, made: [Option<Made>; 3]) -> String {
    let least = |of: fn(&Made) -> f64| made.iter().flatten().map(of).fold(f64::INFINITY, f64::min);
    format!(
        "add to a copy of the profile (the damping is what was found less twice its spread):\n\n[identified]\nround_trip_ticks = {}\nmass_kg = {:.4}\ndamping_n_s_per_m = {:.3}\n",
        answers.round_trip_ticks,
        least(|made| made.mass_kg),
        least(|made| made.damping_bound_n_s_per_m)
    )
}

fn probe_json(
    profile: &Profile,
    path: &str,
    answers: &Answers,
    signs: [Option<Sign>; 3],
    made: [Option<Made>; 3],
    findings: &[Finding],
) -> Value {
    let sign_name = |sign: Sign| match sign {
        Sign::Right => "right",
        Sign::Wrong => "wrong",
        Sign::Still => "still",
    };
    let made_json = |made: Made| {
        json!({
            "mass_kg": made.mass_kg,
            "mass_spread_kg": made.mass_spread_kg,
            "damping_n_s_per_m": made.damping_n_s_per_m,
            "damping_spread_n_s_per_m": made.damping_spread_n_s_per_m,
            "damping_bound_n_s_per_m": made.damping_bound_n_s_per_m,
            "coulomb_n": made.coulomb_n,
        })
    };
    json!({
        "profile": profile.name,
        "path": path,
        "ticks": answers.ticks,
        "fresh": answers.fresh,
        "corrupt_packets": answers.corrupt,
        "lost_packets": answers.lost_packets,
        "longest_silence_ticks": answers.longest_silence_ticks,
        "round_trip_ticks": answers.round_trip_ticks,
        "homed": answers.homed,
        "device_error": answers.error,
        "position_m": answers.position_m.to_array(),
        "spread_m": answers.spread_m,
        "signs": signs.map(|sign| sign.map(sign_name)),
        "identified": made.map(|made| made.map(made_json)),
        "findings": findings.iter().map(finding_json).collect::<Vec<_>>(),
    })
}

/// Troubles are told of arms only: what becomes of other nodes is nobody's concern here.
fn troubles(found: &Attached, root: &Root) -> Vec<Finding> {
    if found.profiles.is_empty() && found.beside.is_empty() {
        return Vec::new();
    }
    discover::findings(found, root).into_iter().filter(|finding| finding.standing >= Standing::Advice).collect()
}

fn node_line(found: &Attached) -> String {
    let node = &found.node;
    let mut words = vec![format!("{:<16} {:<6}", node.path.display(), node.kind.name())];
    if node.vendor_id != 0 {
        words.push(format!("{:04x}:{:04x}", node.vendor_id, node.product_id));
    }
    words.extend(node.interface.map(|interface| format!("interface {interface}")));
    words.extend(node.usages.first().map(|(page, usage)| format!("usage {page:04x}:{usage:04x}")));
    words.extend([&node.product, &node.serial].into_iter().filter(|text| !text.is_empty()).map(|text| format!("\"{text}\"")));
    words.extend(node.by_id.as_ref().map(|name| name.display().to_string()));
    words.push(match (found.profiles.as_slice(), found.beside.as_slice()) {
        ([], []) => "no profile".to_owned(),
        ([], beside) => format!("beside {}", beside.join(", ")),
        (profiles, _) => format!("profile {}", profiles.join(", ")),
    });
    if !found.permitted {
        words.push("no permission".to_owned());
    }
    words.extend(found.holders.iter().map(|holder| format!("held by {} ({})", holder.name, holder.pid)));
    words.join("  ")
}

pub(super) fn node_json(found: &Attached, root: &Root) -> Value {
    let node = &found.node;
    json!({
        "path": node.path,
        "kind": node.kind.name(),
        "by_id": node.by_id,
        "vendor_id": node.vendor_id,
        "product_id": node.product_id,
        "serial": node.serial,
        "product": node.product,
        "interface": node.interface,
        "usages": node.usages.iter().map(|(page, usage)| json!({ "page": page, "usage": usage })).collect::<Vec<_>>(),
        "permitted": found.permitted,
        "holders": found.holders.iter().map(|holder| json!({ "pid": holder.pid, "name": holder.name })).collect::<Vec<_>>(),
        "profiles": found.profiles,
        "beside": found.beside,
        "findings": troubles(found, root).iter().map(finding_json).collect::<Vec<_>>(),
    })
}

pub(super) fn finding_json(finding: &Finding) -> Value {
    json!({ "name": finding.name, "standing": finding.standing.name(), "found": finding.found, "advice": finding.advice })
}
