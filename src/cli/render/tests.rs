use std::time::Duration;

use clap::Parser;

use super::args::RealtimeMode;
use super::*;
use crate::cli::When;
use crate::cli::output::LogFormat;
use crate::daemon::testing;
use ::recording::Totals;
use arms::simulated::{SimArm, SimParameters};
use haptics::testing::empty_scene;
use rt::schedule::RealtimeConfig;

#[derive(Debug, Parser)]
struct Command {
    #[command(flatten)]
    args: LoopArgs,
}

fn args(line: &str) -> Result<LoopArgs, clap::Error> {
    Command::try_parse_from(["run"].into_iter().chain(line.split_whitespace()))
        .map(|command| command.args)
}

fn synthetic() -> Prepared {
    Prepared {
        scene: Arc::try_unwrap(empty_scene()).expect("not shared"),
        model: None,
        device: Box::new(SimArm::new(SimParameters::ideal(1e-3)).expect("valid")),
        attached: None,
        realtime: RealtimeConfig { enforce: true, cpu: None, priority: 80 },
        rate_hz: 1000,
        time_budget_s: None,
    }
}

/// A run in which nothing changes.
fn run(
    args: &LoopArgs,
    output: OutputOptions,
    bake: impl FnOnce() -> Result<(Prepared, Vec<ObjectReport>), PrepareError>,
) -> Result<RunSummary, CliError> {
    let session = testing::session(args.clock.kind());
    let beside = Beside {
        live: LiveChannels::default(),
        paths: ObjectPaths::default(),
        session: &session,
        recorder: None,
        protocol: None,
        services: &mut Services::default(),
        sculpt_run: None,
        may_be_late: true,
        reloads: false,
        watches: false,
    };
    super::run(args, output, beside, &Arc::new(Control::new()), |_| Ok(()), bake)
}

fn result_text(totals: &Totals, start_s: StartTimes, json: bool) -> String {
    super::result_text(totals, start_s, &RunExtras::default(), json)
}

const QUIET: OutputOptions =
    OutputOptions { verbose: 0, quiet: true, color: When::Never, log_format: LogFormat::Text };

#[test]
fn the_command_line_is_read() {
    let args = args(
        "scene.toml --duration 500ms --realtime best-effort --device sim-touch --clock \
        virtual --json",
    )
    .expect("valid");
    assert_eq!(args.duration, Some(Duration::from_millis(500)));
    assert_eq!((args.realtime, args.clock), (Some(RealtimeMode::BestEffort), ClockArg::Virtual));
    assert_eq!((args.device.as_deref(), args.json), (Some("sim-touch"), true));
}

#[test]
fn a_virtual_run_prints_one_json_object() {
    let args = args("s.toml --duration 2s --clock virtual --json").expect("valid");
    let outcome = run(&args, QUIET, || Ok((synthetic(), Vec::new()))).expect("an outcome");
    assert_eq!(outcome.exit(), Exit::Ok);
    let text = result_text(&outcome.totals, StartTimes::default(), true);
    assert_eq!(text.lines().count(), 1);
    let json: serde_json::Value = serde_json::from_str(&text).expect("json");
    assert!(json["ticks"].as_u64().expect("a count") > 2000);
    assert_eq!(json["realtime"]["policy"], "other");
}

#[test]
fn a_time_budget_is_a_fixed_count_under_the_virtual_clock() {
    let args = args("s.toml --duration 100ms --clock virtual --json").expect("valid");
    for (time_budget_s, expected) in [(None, serde_json::Value::Null), (Some(100e-6), 5_000.into())]
    {
        let prepared = Prepared { time_budget_s, ..synthetic() };
        let outcome = run(&args, QUIET, || Ok((prepared, Vec::new()))).expect("an outcome");
        let text = result_text(&outcome.totals, StartTimes::default(), true);
        let json: serde_json::Value = serde_json::from_str(&text).expect("json");
        assert_eq!(json["contact_budget_points"], expected);
        assert_eq!(json["points_left_out"], 0);
    }
}

#[test]
fn the_human_summary_names_what_happened() {
    let args = args("s.toml --duration 100ms --clock virtual").expect("valid");
    let outcome = run(&args, QUIET, || Ok((synthetic(), Vec::new()))).expect("an outcome");
    let text = result_text(&outcome.totals, StartTimes::default(), false);
    for fragment in ["virtual clock", "missed deadlines", "p99.9", "faults", "none"] {
        assert!(text.contains(fragment), "{text}");
    }
}
