//! A whole loop on an arm, with every gate, limit and fault of the program:
//! `cargo run -p engine --example arm -- [PROFILE [NODE]]`, without words a simulated arm. A real arm
//! gets its force by the word `enable` on standard input. Ctrl-C and the end of standard input end
//! the run with zero force.
#![expect(clippy::print_stdout, clippy::print_stderr, reason = "what an example is for")]

use std::error::Error;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Duration;

use arms::attached::open::{OpenOptions, open};
use arms::simulated::hand::{HandMapping, HandPath};
use arms::simulated::{HandParameters, SimArm, SimParameters};
use arms::{Device, profile};
use crossbeam::channel::{Receiver, unbounded};
use document::poses::TimedPose;
use engine::arm_rules;
use engine::servo::LoopReport;
use engine::supervisor::{Enable, LiveChannels, Notice, Operator, RenderJob, Supervisor};
use haptics::{SceneBuilder, ToolOptions};
use rt::clock::ClockKind;
use rt::control::Control;
use rt::schedule::{RealtimeConfig, ThreadRequest, loop_cpu};
use vps::{DVec3, Options, Pose, Shape, part::Part};

const RATE_HZ: u32 = 1000;
const PERIOD_S: f64 = 1e-3;
const PRIORITY: u8 = 80;

/// Renders a ball at the grip, two millimetres above a block, until `control` or the time ends it.
pub(crate) fn run(
    [profile, node]: [Option<&str>; 2],
    clock: ClockKind,
    duration: Duration,
    control: &Arc<Control>,
    enables: Receiver<Enable>,
) -> Result<LoopReport, Box<dyn Error>> {
    let profile = profile::find(profile.unwrap_or("sim-sigma7"), ".".as_ref())?;
    profile.link_carries(RATE_HZ)?;
    let mut builder = SceneBuilder::new(arm_rules::parameters(&profile, PERIOD_S));
    let block = Part::of_shape("block", &Shape::Box { size_m: DVec3::splat(40e-3) }, 1e-3);
    builder.add_part(&block, &Options::new(1e-3), Pose::from_translation(DVec3::Z * -32e-3))?;
    let ball = Part::of_shape("ball", &Shape::Sphere { radius_m: 10e-3 }, 1e-3);
    let (scene, _) = builder.finish(&ball, &Options::new(1e-3), &ToolOptions::new(0.1))?;

    let (device, news): (Box<dyn Device>, _) = if profile.real.is_some() {
        let selector = node.map(str::parse).transpose()?;
        let guard = Some("/proc/self/exe".into());
        let servo = ThreadRequest { cpu: loop_cpu(None), priority: PRIORITY };
        let io_request = Some(servo.below());
        let options = OpenOptions { selector, io_request, period_s: PERIOD_S, guard };
        let opened = open(&profile, &options)?;
        (Box::new(opened.arm), Some(opened.news))
    } else {
        // After half a second it wants to be two millimetres deep.
        let down = |time_s, z_m| TimedPose {
            time_s,
            pose: Pose::from_translation(DVec3::Z * z_m),
            line: 0,
        };
        let poses = [down(0.5, 0.0), down(1.0, -4e-3)];
        let mapping = HandMapping {
            world_from_device: Pose::IDENTITY,
            scale: 1.0,
            start: Pose::IDENTITY,
            grip_tool: DVec3::ZERO,
        };
        let path = HandPath::from_poses(&poses, "the example".as_ref())?.to_device(mapping);
        let hand = Some(HandParameters { path: Some(path), ..HandParameters::default() });
        (Box::new(SimArm::new(SimParameters::of(&profile, hand, PERIOD_S))?), None)
    };
    let operator =
        Operator { waits_after_fault: true, enables: Some(enables), ..Operator::default() };
    let live = LiveChannels { operator, news, ..LiveChannels::default() };
    // Every record of a tick comes by a ring to a thread of its own.
    let mut largest_n = 0.1;
    live.subscribers.add(Box::new(move |record| {
        let force_n = record.output.command_device.force.length();
        if force_n > 1.5 * largest_n {
            largest_n = force_n;
            println!("tick {}: {force_n:.2} N", record.tick);
        }
        true
    }));
    let realtime = RealtimeConfig { enforce: false, cpu: None, priority: PRIORITY };
    let job = RenderJob {
        scene: Arc::new(scene),
        device,
        realtime,
        time_budget_s: None,
        clock,
        duration: Some(duration),
    };
    let mut supervisor = Supervisor::new(|notice| match notice {
        Notice::Phase(phase) => println!("{}", phase.name()),
        Notice::Fault(record) => {
            println!("fault: {}", record.output.faults.names().collect::<Vec<_>>().join(", "));
        }
        _ => {}
    });
    Ok(supervisor.render_live(job, live, control)?.report)
}

#[cfg_attr(test, expect(dead_code, reason = "a test runs it under another clock"))]
fn main() -> ExitCode {
    match press() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

fn press() -> Result<(), Box<dyn Error>> {
    // This program is its own guard: it starts itself beside a real arm.
    if let Some(watched) = arms::guard::watch_if_asked() {
        return Ok(watched?);
    }
    let words: Vec<String> = std::env::args().skip(1).collect();
    let control = Arc::new(Control::new());
    rt::signals::end_by_signals(&control)?;
    let (enable, enables) = unbounded();
    let asked = control.clone();
    std::thread::spawn(move || {
        for line in std::io::stdin().lines().map_while(Result::ok) {
            match line.trim() {
                "enable" => drop(enable.send(Enable(asked.permit()))),
                _ => asked.disable(),
            }
        }
        asked.stop();
    });
    let words = [0, 1].map(|word| words.get(word).map(String::as_str));
    let report = run(words, ClockKind::Real, Duration::from_secs(10), &control, enables)?;
    println!("{} ticks, {:?}, {:?}", report.ticks, report.ending, report.faults);
    Ok(())
}
