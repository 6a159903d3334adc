//! `hapticd mock`: the simulated arm as a process of its own, behind a real link, in the arm's own
//! protocol.

use core::sync::atomic::Ordering;
use core::time::Duration;
use std::net::SocketAddr;
use std::path::PathBuf;

use clap::ArgGroup;
use serde_json::json;

use super::error::{CliError, Outcome};
use super::hand::HandArgs;
use super::{OutputOptions, output, report};
use crate::error::Exit;
use arms::mock::builder::{self, MockSettings};
use arms::mock::gadget::Gadget;
use arms::mock::pty::Pty;
use arms::mock::serve::{ServeEnd, Serving, serve};
use arms::mock::service::{self, ServiceServer};
use arms::mock::trace::TraceFile;
use arms::mock::uhid::Uhid;
use arms::mock::{ArmLink, LinkError, MockArm, MockReport};
use arms::profile::{self, Profile};
use arms::protocol::Protocol;
use arms::simulated::fault::{self, FaultPlan};
use arms::transport::Carriage;
use rt::schedule::{self, ThreadRequest};
use rt::{duration, signals};

/// Arguments of `hapticd mock`.
#[derive(Debug, clap::Args)]
#[command(group = ArgGroup::new("link").required(true))]
pub(crate) struct Args {
    /// Profile of the arm: a name of devices/, or a file. Simulated ones (sim-…) speak open6.
    profile: String,
    /// A pseudo-terminal for arms on a serial port; LINK becomes a symbolic link to it.
    #[arg(long, value_name = "LINK", group = "link")]
    pty: Option<PathBuf>,
    /// A HID device through /dev/uhid, for arms on HID.
    #[arg(long, group = "link")]
    uhid: bool,
    /// The arm's end of a USB gadget: /dev/ttyGS0 or /dev/hidg0.
    #[arg(long, value_name = "NODE", group = "link")]
    gadget: Option<PathBuf>,
    /// A WebSocket server in the place of the Inverse service, for arms behind it; port 0 is any
    /// that is free.
    #[arg(long, value_name = "ADDRESS", group = "link")]
    service: Option<SocketAddr>,
    /// Version that the service says it is: below 3.5 it takes forces as `values` only.
    #[arg(long, value_name = "VERSION", requires = "service", default_value = "3.5.0")]
    service_version: String,
    #[command(flatten)]
    hand: HandArgs,
    /// What goes wrong: drop=P%, stall, deaf, nan, garbage, unplug, slow=TIME, stuck, jump,
    /// truncate, lost-byte, repeat, reorder, sign-flip, saturate, unhome, sleep, skip=COUNT or
    /// no-velocity, then @START[+LENGTH] since the host's first frame, such as unplug@2s+500ms;
    /// press=BUTTON holds a button; may be repeated.
    #[arg(long = "fault", value_name = "SPEC", value_parser = parse_fault)]
    faults: Vec<(String, FaultPlan)>,
    /// End after this time.
    #[arg(long, value_name = "TIME", value_parser = duration::parse)]
    duration: Option<Duration>,
    /// End when the host has gone.
    #[arg(long)]
    once: bool,
    /// Write what the motors do into this file while they do it, a line per change, ten a second
    /// without: t_ns (CLOCK_MONOTONIC), force_n, torque_nm, frames received, late periods, faults
    /// that are there.
    #[arg(long, value_name = "FILE.csv")]
    trace: Option<PathBuf>,
    /// Print one JSON object at the end.
    #[arg(long)]
    json: bool,
}

/// Above any host: firmware does not wait for the host.
const ARM_PRIORITY: u8 = 90;

fn parse_fault(text: &str) -> Result<(String, FaultPlan), fault::FaultError> {
    fault::parse(text).map(|plan| (text.to_owned(), plan))
}

pub(crate) fn main(args: &Args, output: OutputOptions) -> Outcome {
    let here = std::env::current_dir().unwrap_or_default();
    let profile = profile::find(&args.profile, &here)?;
    let name = &profile.name;
    let carriage =
        if args.pty.is_some() { Carriage::Stream } else { gadget_carriage(args.gadget.as_deref()) };
    if args.gadget.is_some()
        && args.faults.iter().any(|(_, plan)| plan.kind == fault::FaultKind::Unplug)
    {
        return Err(CliError::usage("the plug of a gadget cannot be pulled from its own side")
            .hint("write an empty line to the UDC file of the gadget, or use --pty or --uhid"));
    }
    let settings = MockSettings {
        hand: args.hand.hand(output)?,
        hand_delay: args.hand.delay(),
        faults: args.faults.clone(),
        seed: 0,
    };
    let (parameters, protocol) = builder::parameters(&profile, settings);
    let is_behind_service = matches!(protocol, Protocol::HaplyService(_));
    let mismatch = if is_behind_service != args.service.is_some() {
        Some(match is_behind_service {
            true => ("is behind the Inverse service", "use --service 127.0.0.1:10001"),
            false => {
                ("is not behind the Inverse service", "use --pty LINK, --uhid or --gadget NODE")
            }
        })
    } else if !protocol.carriages().contains(&carriage) {
        Some(match carriage {
            Carriage::Stream => ("speaks HID reports", "use --uhid, or --gadget /dev/hidg0"),
            Carriage::Reports => {
                ("speaks over a serial port", "use --pty LINK, or --gadget /dev/ttyGS0")
            }
        })
    } else {
        None
    };
    if let Some((what, hint)) = mismatch {
        return Err(CliError::usage(format_args!("{name} {what}")).hint(hint));
    }
    let period_s = parameters.period_s;
    let firmware = match args.service {
        Some(_) => service::firmware(&protocol, &args.service_version).map_err(CliError::usage)?,
        None => protocol.firmware(carriage),
    };
    let mut arm = MockArm::new(parameters, firmware).map_err(CliError::configuration)?;
    let trace = args.trace.as_ref().map(|path| {
        TraceFile::create(path).map_err(|error| CliError::write(path.display(), &error))
    });
    let mut trace = trace.transpose()?;
    let interrupted = signals::interrupted().map_err(CliError::internal)?;
    let (mut link, name) = open(args, &profile, &protocol)
        .map_err(|error| CliError::device(error).hint(link_hint(args)))?;

    let ready = format!("ready {name}\n");
    if args.json {
        output::message(format_args!("{ready}"));
    } else {
        output::result(format_args!("{ready}"));
        let _ = std::io::Write::flush(&mut std::io::stdout());
    }
    // An arm keeps its time whatever else the machine does. Where that is not allowed, its late
    // periods are counted.
    let cpu = schedule::allowed_cpus().first().copied().unwrap_or(0);
    schedule::enter_realtime(ThreadRequest { cpu, priority: ARM_PRIORITY });
    let serving = Serving { period_s, duration: args.duration, until_host_gone: args.once };
    let ended = serve(&mut arm, &mut *link, serving, trace.as_mut(), || {
        interrupted.load(Ordering::Relaxed)
    })
    .map_err(CliError::device)?;
    // The node goes away before the output comes: its reader may check that.
    drop(link);
    if let (Some(path), Some(cause)) = (&args.trace, trace.as_ref().and_then(TraceFile::ended)) {
        report::warning(&format!("{} does not go to the end: {cause}", path.display()), output);
    }
    tell(&arm.report(), &profile, protocol.name(), &name, ended, args.json, output);
    Ok(Exit::Ok)
}

fn gadget_carriage(node: Option<&std::path::Path>) -> Carriage {
    match node.and_then(|node| node.file_name()) {
        Some(name) if name.to_string_lossy().starts_with("tty") => Carriage::Stream,
        _ => Carriage::Reports,
    }
}

fn link_hint(args: &Args) -> Option<&'static str> {
    if args.uhid {
        return Some(
            "sudo modprobe uhid, and run as root; scripts/hil-vm has one for machines whose kernel \
                lacks it",
        );
    }
    args.gadget.is_some().then_some("make the gadget first: scripts/hil-vm shows how")
}

fn open(
    args: &Args,
    profile: &Profile,
    protocol: &Protocol,
) -> Result<(Box<dyn ArmLink>, String), LinkError> {
    if let Some(link) = &args.pty {
        return Ok((Box::new(Pty::new(link)?), link.display().to_string()));
    }
    if let Some(address) = args.service {
        let server = ServiceServer::new(address, &args.service_version)?;
        let name = server.address().to_string();
        return Ok((Box::new(server), name));
    }
    if let Some(node) = &args.gadget {
        return Ok((Box::new(Gadget::open(node)?), node.display().to_string()));
    }
    let identity = builder::identity(profile, protocol);
    let name = format!("uhid {:04x}:{:04x}", identity.vendor_id, identity.product_id);
    Ok((Box::new(Uhid::new(identity)?), name))
}

fn tell(
    report: &MockReport,
    profile: &Profile,
    protocol: &str,
    link: &str,
    ended: ServeEnd,
    as_json: bool,
    output: OutputOptions,
) {
    if as_json {
        let mut object = json!({ "profile": profile.name, "protocol": protocol, "link": link, "ended": ended.name() });
        if let (Some(object), Ok(serde_json::Value::Object(felt))) =
            (object.as_object_mut(), serde_json::to_value(report))
        {
            object.extend(felt);
        }
        output::result(format_args!("{object}\n"));
        return;
    }
    report::note(&format!("{} over {link}: {}", profile.name, ended.name()), output);
    output::result(format_args!(
        "received           {} frames, {} bytes; longest gap {:.1} ms, {} gaps\n\
         sent               {} frames; {} lost\n\
         periods            {}, {} of them late\n\
         largest            {:.3} N, {:.4} N·m\n\
         watchdog trips     {}\n",
        report.frames_received,
        report.bytes_received,
        report.longest_gap_ms,
        report.gaps,
        report.frames_sent,
        report.frames_lost,
        report.periods,
        report.late_periods,
        report.largest_force_n,
        report.largest_torque_nm,
        report.watchdog_trips,
    ));
    for fault in &report.faults {
        let zero = match fault.zero_after_ticks {
            Some(ticks) => format!("no force after {ticks} periods"),
            None => "the force never stopped".to_owned(),
        };
        output::result(format_args!(
            "fault              {} at {:.3} s: {zero}; {:.3} N before, {:.3} N at most\n",
            fault.fault, fault.began_s, fault.force_before_n, fault.largest_force_n
        ));
    }
    let pose = report.final_pose;
    output::result(format_args!(
        "grip at the end    {:.3} {:.3} {:.3} mm\n",
        pose.x_m * 1e3,
        pose.y_m * 1e3,
        pose.z_m * 1e3
    ));
}
