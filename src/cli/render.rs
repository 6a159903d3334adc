//! Baking a scene and rendering it on its arm: what `hapticd run` and `hapticd sculpt` share.

mod args;
mod arm;

use std::cell::{Cell, RefCell};
use std::sync::Arc;

pub(crate) use self::args::{CommandOptions, LoopArgs};

use self::args::ClockArg;
use self::arm::tell_of_arm;
use super::error::{CliError, Outcome};
use super::memory::MemoryRule;
use super::outcome::{RunExtras, StartTimes, lets_go_text, result_text};
use super::sculpt_run::{self, SculptRun};
use super::services::{ServiceOptions, Services};
use super::status_line::{FAILED, StatusLine, report_lines};
use super::{OutputOptions, bake, check, drawing, guard, live, output, recording, report};
use crate::config::{self, SceneConfig};
use crate::daemon::drawing::{self as drawing_thread, Drawing};
use crate::daemon::remote::RemoteArm;
use crate::daemon::service::Service;
use crate::daemon::session::SessionHandle;
use crate::daemon::{self, PrepareError, Prepared, RealArmNode, RunSummary, exit_of, prepare_on};
use crate::error::Exit;
use crate::scene::ObjectReport;
use crate::scene::cache::CachePolicy;
use ::recording::RecordSubscribers;
use ::recording::file::Recorder;
use arms::mock::builder;
use arms::protocol::Protocol;
use engine::servo::{Control, ObjectPaths};
use engine::supervisor::{LiveChannels, Notice, RenderJob, RunError, Supervisor};
use rt::clock::{ClockKind, monotonic_ns};
use rt::signals::{self, SignalError};
use vps::mesh;

/// Renders; `own` is what the command adds.
pub(crate) fn main(
    args: &LoopArgs,
    own: &CommandOptions<'_>,
    output: OutputOptions,
    started_ns: i64,
) -> Outcome {
    // Before any thread that loads parts begins: some of them do while force flows.
    mesh::copy_only();
    // From the first word on: no thread that takes orders or renders waits for a reader.
    output::detach().map_err(CliError::thread)?;
    let since_start_s = |ns: i64| (ns - started_ns) as f64 * 1e-9;
    let baked_s = Cell::new(0.0);
    let figures = RefCell::new(None);
    let names_node =
        args.device.as_deref().is_some_and(|device| RemoteArm::name_in(device).is_some());
    if names_node && args.clock == ClockArg::Virtual {
        return Err(needs_real_clock("an arm on another machine"));
    }
    let remote = args.remote()?;
    let overrides = args.overrides(remote.as_ref());
    if own.clay.is_some() && args.scene.is_file() && sculpt_run::is_source(&args.scene) {
        let message =
            format!("{}: this is a file of points or a mesh, not a scene", args.scene.display());
        let file = output::quoted(&args.scene);
        let hint = format!("`hapticd init --clay {file}` writes a scene that sculpts it");
        return Err(CliError::configuration(message).hint(&*hint));
    }
    // Before anything is announced: a scene that cannot be read bakes nothing.
    let config = config::load_with(&args.scene, &overrides)?;
    report::scene_warnings(&config, output);
    let clock = args.clock.kind();
    let mut sculpt_run =
        SculptRun::plan(&config, own.clay, own.overwrite, clock, args.recording.file(), output)?;
    args.check(&config, remote.as_ref())?;
    let changes = own.live.check(&config, &overrides, args.duration)?;
    let drawn = own.drawing.map(|drawing| drawing.plan(&config, own.overwrite, output));
    let drawn = drawn.transpose()?.flatten();
    let bound = args.monitor.open(&config, clock, output)?;
    if let Some(real) = &config.device.profile.real {
        check_operator(args, &config, bound.is_some(), output)?;
        tell_of_arm(&config, real, output);
    }
    if output.verbose > 0 {
        output::message(format_args!("{}\n", check::summary(&config)));
    }
    let subscribers = RecordSubscribers::default();
    let recordings = args.recording.begin(
        &config,
        &overrides,
        own.overwrite,
        clock,
        subscribers.clone(),
        output,
    )?;
    let audience = args.foxglove.begin(&config, clock, &recordings.recorder, output)?;
    let opened = args.publish.open(args.network.endpoints(), &config, output)?;
    let bake = || {
        let memory = MemoryRule::Given(&args.memory);
        // A copy: no other program may take memory away from the loop.
        let prepared = args.cache.bake(CachePolicy::Copy, memory, output, |options, progress| {
            prepare_on(&config, options, remote.as_ref(), guard::program(), |event| {
                progress.tell(&event)
            })
        });
        let (prepared, reports) = prepared?;
        figures.replace(prepared.attached.as_ref().and_then(|attached| attached.link.clone()));
        tell_of_bake(&prepared, &reports, &config, output);
        baked_s.set(since_start_s(monotonic_ns()));
        Ok((prepared, reports))
    };
    // Under the virtual clock a scene changes as it was planned, unless clients can ask for more.
    let is_open = clock == ClockKind::Real || bound.is_some() || opened.is_some() || own.live.watch;
    let control = Arc::new(Control::new());
    let session = SessionHandle::new(
        config.clone(),
        overrides.clone(),
        clock,
        Some(recordings.recorder.clone()),
    );
    let (paths, swaps) = changes
        .begin(&session, &args.cache, &args.memory, is_open, output)
        .map_err(CliError::thread)?;
    let mut live = LiveChannels { subscribers, ..LiveChannels::default() };
    let options = ServiceOptions {
        config: &config,
        session: &session,
        clock,
        bound,
        opened,
        control: &control,
        has_console: args.console,
        enables_at_start: args.enables_at_start(&config),
        recorder: Some(Box::new(recordings.for_clients(output))),
        output,
    };
    let mut services = Services::open(options, &mut live).map_err(CliError::thread)?;
    let draw = |plan| drawing_thread::begin(plan, session.clone(), &live.subscribers, clock);
    let drawing = drawn.map(draw).transpose().map_err(CliError::thread)?;
    // The node sends the text for its arm.
    let spoken = remote.as_ref().map(|_| Protocol::Open6(builder::open6(&config.device.profile)));
    let protocol =
        spoken.as_ref().or(config.device.profile.real.as_ref().map(|real| &real.protocol));
    let beside = Beside {
        live,
        paths,
        session: &session,
        recorder: Some(&recordings.recorder),
        protocol,
        services: &mut services,
        sculpt_run: sculpt_run.as_mut(),
        may_be_late: config.device.profile.real.is_none() && !config.realtime.enforce,
        reloads: is_open,
        watches: own.live.watch,
    };
    let rendered = run(args, output, beside, &control, signals::end_by_signals, bake);
    // Force is off: from here on words may wait for their reader.
    output::attach();
    // Whatever became of the loop: what hands made is not lost with it.
    let clay = sculpt_run.and_then(|sculpt_run| sculpt_run.close(output));
    let drawn = drawing.map(Drawing::end);
    let outcome = rendered?;
    let first_tick = outcome.report.first_tick_ns.map_or(0.0, since_start_s);
    let start_s = StartTimes { baked: baked_s.get(), first_tick };
    if let Some(audience) = audience {
        audience.end();
    }
    let swaps = swaps.reports(&session, &outcome.swaps);
    let recording = recordings.end(&outcome.report);
    let link = figures.borrow().as_ref().map(|figures| figures.report());
    let more = RunExtras {
        swaps: &swaps,
        recording: recording.as_ref(),
        sculpt: clay.as_ref(),
        drawn: drawn.as_ref(),
        link,
    };
    if args.json || !output.quiet {
        let text = result_text(&outcome.totals, start_s, &more, args.json);
        output::result(format_args!("{text}"));
    }
    let not_drawn = drawn.and_then(|drawn| drawing::failure(&drawn, output));
    let failures = [
        Some(outcome.exit()),
        live::failure(&session, output),
        clay.map(|clay| clay.exit()),
        not_drawn,
    ];
    Ok(failures.into_iter().flatten().find(|exit| *exit != Exit::Ok).unwrap_or(Exit::Ok))
}

fn needs_real_clock(arm: &str) -> CliError {
    CliError::usage(format_args!("{arm} needs `--clock real`"))
        .hint("leave out --clock virtual, or name a simulated arm with --device")
}

/// Refuses a real arm that could never get force, and says who gives it.
fn check_operator(
    args: &LoopArgs,
    config: &SceneConfig,
    has_monitor: bool,
    output: OutputOptions,
) -> Result<(), CliError> {
    if args.clock == ClockArg::Virtual {
        return Err(needs_real_clock("a real arm"));
    }
    if args.enables_at_start(config) {
        return Ok(());
    }
    let by = match (args.console, has_monitor) {
        (true, _) => "you type `enable`",
        (false, true) => "it is enabled on the monitor page or by a client",
        (false, false) => return Err(not_run(RunError::NoOperator, output)),
    };
    report::note(&format!("no force until {by}; with --enable it flows from the start"), output);
    Ok(())
}

/// Says what there is to know of what was baked.
fn tell_of_bake(
    prepared: &Prepared,
    reports: &[ObjectReport],
    config: &SceneConfig,
    output: OutputOptions,
) {
    report::bake_warnings(reports, output);
    if let Some(text) = bake::overlap_text(reports, config) {
        report::note(&text, output);
    }
    let clay = prepared.model.as_ref().map(|model| &model.report);
    clay.inspect(|clay| report::clay_warnings(clay, output));
    if output.verbose > 0 {
        clay.inspect(|clay| output::message(format_args!("{}", bake::clay_text(clay))));
        for object in reports {
            output::message(format_args!("{}", bake::report_text(object)));
        }
    }
}

/// Why a scene that is ready was not rendered.
fn not_run(error: RunError, output: OutputOptions) -> CliError {
    let hint = match &error {
        RunError::Refused(checks) => {
            if output.quiet {
                for row in report_lines(checks, true, FAILED) {
                    output::message(format_args!("{row}\n"));
                }
            }
            Some("--realtime best-effort runs anyway, with the latency that this machine gives")
        }
        RunError::NoOperator => Some(HOW_TO_ENABLE),
        _ => None,
    };
    CliError::new(exit_of(&error), &error).hint(hint)
}

const HOW_TO_ENABLE: &str = "give --enable to let force flow from the start, --console to type \
    `enable`, or --monitor for its page; with `safety.deadman` in the scene force flows while that \
    button is held";

/// What there is beside the loop.
struct Beside<'a> {
    live: LiveChannels,
    /// Objects that follow paths.
    paths: ObjectPaths,
    session: &'a SessionHandle,
    recorder: Option<&'a Recorder>,
    protocol: Option<&'a Protocol>,
    services: &'a mut Services,
    sculpt_run: Option<&'a mut SculptRun>,
    /// No hand feels it when the loop is late: the arm is simulated, and real time is not enforced.
    may_be_late: bool,
    /// The scene is read again when SIGHUP asks for it.
    reloads: bool,
    /// The scene is read again when its files change.
    watches: bool,
}

fn run(
    args: &LoopArgs,
    output: OutputOptions,
    beside: Beside<'_>,
    control: &Arc<Control>,
    end_by_signals: impl FnOnce(&Arc<Control>) -> Result<(), SignalError>,
    bake: impl FnOnce() -> Result<(Prepared, Vec<ObjectReport>), PrepareError>,
) -> Result<RunSummary, CliError> {
    let Beside {
        mut live,
        paths,
        session,
        recorder,
        protocol,
        services,
        sculpt_run,
        may_be_late,
        reloads,
        watches,
    } = beside;
    let mut screen =
        StatusLine::new(output, session, protocol, may_be_late, live.operator.waits_after_fault);
    let handle = services.notice_handler();
    let mut service = Service::of_environment();
    let mut supervisor = Supervisor::new(|notice| {
        if let (Notice::Preflight(machine), Some(recorder)) = (&notice, recorder) {
            recording::note_machine(recorder, machine);
        }
        handle(&notice);
        service.report(&notice);
        screen.show(&notice);
    });
    let (prepared, reports) = supervisor.bake(bake)?;
    let scene = Arc::new(prepared.scene);
    if let (Some(sculpt_run), Some(model)) = (sculpt_run, prepared.model) {
        sculpt_run.fit(&model, output)?;
        sculpt_run
            .open(model, &scene, &mut live, control)
            .map_err(|error| not_run(error.into(), output))?;
        services.sculpts(sculpt_run.handle(), sculpt_run.for_clients(&scene));
    }
    live.commands = session.begin(&scene, reports, prepared.attached.is_none()).with_paths(paths);
    let view = session.view();
    // What works clay said so before.
    if view.has_hand && view.config.device.hand.is_none() && view.config.sculpt.is_none() {
        report::note(
            "the scene has no path for its hand: it waits until the tool is moved on the monitor \
                page; `device.hand` names a path",
            output,
        );
    }
    if let Some(RealArmNode { node, news, link }) = prepared.attached {
        services.attached(&node);
        if !output.quiet {
            let lets_go = link
                .map_or(String::new(), |link| format!(", and {}", lets_go_text(&link.report())));
            output::message(format_args!("device: {} is ready{lets_go}\n", node.display()));
        }
        live.news = Some(news);
    }
    let job = RenderJob {
        scene,
        device: prepared.device,
        realtime: prepared.realtime,
        time_budget_s: prepared.time_budget_s,
        clock: args.clock.kind(),
        duration: args.duration,
    };
    // Only now: until here no force can flow, and Ctrl-C ends a long bake at once as it does
    // everywhere.
    end_by_signals(control).map_err(CliError::internal)?;
    signals::suspend_without_force();
    if reloads {
        services.reload(session, watches, output);
    }
    daemon::render(&mut supervisor, job, prepared.rate_hz, live, control)
        .map_err(|error| not_run(error, output))
}

#[cfg(test)]
mod tests;
