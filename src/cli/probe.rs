//! `hapticd devices probe`: does an arm answer, does it push the right way, what is it made of?

use core::sync::atomic::{AtomicBool, Ordering};
use core::time::Duration;
use std::io::IsTerminal as _;
use std::sync::Arc;

use crossbeam::channel::{Receiver, unbounded};
use serde_json::{Value, json};

use super::error::{CliError, Outcome};
use super::findings::{self, finding_json};
use super::status_line::{FAILED, error_text, report_lines};
use super::{OutputOptions, guard, output, report};
use crate::daemon::PrepareError;
use crate::error::Exit;
use arms::attached::identify::AxisDynamics;
use arms::attached::nodes::Selector;
use arms::attached::open::{self, LinkNews, OpenOptions};
use arms::attached::probe::{
    self, Answers, ProbeEnd, ProbePlan, ProbeResult, ProbeStep, Push, Sign, Trial,
};
use arms::profile::{self, Homing, HomingMode, Profile, RealArm};
use arms::protocol::DeclaredLimits;
use arms::{Device as _, Pacing};
use rt::clock::RealClock;
use rt::finding::{Finding, Standing};
use rt::realtime::{self, Entered};
use rt::schedule::{self, ThreadRequest};
use rt::{duration, signals};
use vps::spatial::Axes;

/// Arguments of `hapticd devices probe`.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Profile of the arm: a name of devices/, or a file.
    profile: String,
    /// Which of several: VID:PID[:SERIAL] in hex, or the path of a node.
    #[arg(long, value_name = "S")]
    selector: Option<Selector>,
    /// Shake each axis with less than 0.5 N and fit mass and viscosity. Let go of the grip.
    #[arg(long)]
    identify: bool,
    /// Push along each axis with a motor with 0.3 N for 0.2 s, turn about each with as little, and
    /// look which way it goes. Hold the grip loosely.
    #[arg(long)]
    sign_check: bool,
    /// Let the arm move by itself to find its zero, where its maker's library does that. Clear the
    /// space around it.
    #[arg(long)]
    home: bool,
    /// Push without asking first: for scripts, whose standard input is no terminal. Someone has to
    /// watch the arm.
    #[arg(long)]
    yes: bool,
    /// How long to listen.
    #[arg(long, value_name = "TIME", default_value = "10s", value_parser = duration::parse)]
    duration: Duration,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

/// What to type to probe the arm of a profile.
pub(super) fn command(profile: &Profile, selector: Option<&Selector>, flag: &str) -> String {
    let selector = selector.map_or(String::new(), |selector| format!(" --selector {selector}"));
    format!("hapticd devices probe {}{selector} {flag}", profile.given())
}

impl Args {
    /// The flag that lets force come, if one does.
    fn pushes(&self) -> Option<&'static str> {
        if self.sign_check { Some("--sign-check") } else { self.identify.then_some("--identify") }
    }
}

/// Times a parked arm may be further from the origin than its workspace reaches.
const PARKED: f64 = 3.0;

/// Number of the gripper among the axes.
const GRIPPER: usize = 6;

/// Priority of the loop under SCHED_FIFO: the default of scenes.
pub(super) const PRIORITY: u8 = 80;

/// What the loop says while it tries the arm out.
enum Said {
    /// What its thread got of the system.
    Entered(Entered),
    /// What comes next.
    Step(ProbeStep),
}

/// What the system refused to the loop.
pub(super) fn tell_refused(entered: &Entered, output: OutputOptions) {
    report_lines(&entered.judge(), true, FAILED).iter().for_each(|line| report::line(line, output));
}

/// What there is to say at the end.
struct ProbeReport<'a> {
    profile: &'a Profile,
    real: &'a RealArm,
    args: &'a Args,
    found: &'a ProbeResult,
    ended: Option<ProbeEnd>,
    identity: Option<String>,
    notice: Option<String>,
    declared: Option<DeclaredLimits>,
    /// Reports that were whole and made no sense.
    refused: u64,
}

pub(super) fn main(args: &Args, output: OutputOptions) -> Outcome {
    let here = std::env::current_dir().unwrap_or_default();
    let mut profile = profile::find(&args.profile, &here)?;
    let way_to_zero = if args.home { profile.let_find_zero() } else { None };
    if args.home && way_to_zero.is_none() {
        let message = format!("--home: {} finds its zero without it", profile.name);
        return Err(CliError::usage(message)
            .hint("leave it out; [homing] of the profile says how it is homed"));
    }
    let has_terminal = std::io::stdin().is_terminal();
    if let Some(flag) = args.pushes().filter(|_| !args.yes && !has_terminal) {
        let message = format!(
            "{flag} pushes the grip and asks before that, and standard input is no terminal"
        );
        return Err(
            CliError::usage(message).hint("run it on a terminal, or give --yes and watch the arm")
        );
    }
    let period_s = 1.0 / f64::from(profile.link.rate_hz);
    let request = ThreadRequest { cpu: schedule::loop_cpu(None), priority: PRIORITY };
    let options = OpenOptions {
        selector: args.selector.clone(),
        io_request: Some(request.below()),
        period_s,
        guard: guard::program(),
    };
    if let Some(real) = &profile.real {
        // An arm that is not there is not waited for.
        open::look_for(&profile, &options).map_err(PrepareError::from)?;
        home(&real.homing, output);
        if let Some(way) = way_to_zero {
            signals::interrupt_ends();
            report::note(way, output);
        }
    }
    let mut opened = open::open(&profile, &options).map_err(PrepareError::from)?;
    // True invariant: what was opened has a profile of metal.
    let Some(real) = &profile.real else { unreachable!("a simulated arm is not opened") };
    let notice = opened.arm.notice();
    tell_news(opened.news, notice.clone(), output);
    let path = opened.path.display().to_string();
    report::note(
        &format!("{} at {path}: listening for {:.0} s", profile.title, args.duration.as_secs_f64()),
        output,
    );
    // From here on Ctrl-C takes the force off first.
    let quit = signals::interrupted().map_err(CliError::internal)?;
    output::detach().map_err(CliError::thread)?;
    let arm = &mut opened.arm;
    let go = Arc::new(AtomicBool::new(false));
    let mut trial =
        Trial::new(RealClock, period_s, quit).with_torque(probe::torque_max_nm(&profile));
    let asks = has_terminal && !args.yes;
    if asks {
        trial = trial.asking(&go);
    }
    let plan = ProbePlan {
        listen: args.duration,
        push: args.sign_check.then(|| Push::of(&profile)),
        identify: args.identify,
    };
    let mut found = ProbeResult::default();
    let (sender, said) = unbounded();
    let try_out = |entered| {
        // The channel has room without end: this thread waits for no reader.
        let _ = sender.send(Said::Entered(entered));
        let tell = |step| drop(sender.send(Said::Step(step)));
        let ended = probe::try_out(arm, &mut trial, &plan, &mut found, tell).err();
        arm.stop();
        drop(sender);
        ended
    };
    let listen = || {
        for said in said {
            match said {
                Said::Entered(entered) => tell_refused(&entered, output),
                Said::Step(step) => {
                    report::note(step_text(step, &profile), output);
                    if asks {
                        ask(&go, quit);
                    }
                }
            }
        }
    };
    let ended = realtime::run("probe", request, try_out, listen)
        .map_err(|error| CliError::internal(format_args!("cannot try the arm out: {error}")))?;
    output::attach();
    found.fit(period_s);
    let report = ProbeReport {
        profile: &profile,
        real,
        args,
        found: &found,
        ended,
        identity: arm.identity(),
        notice,
        declared: arm.declared(),
        refused: arm.refused(),
    };
    let findings = report.findings();
    if args.json {
        output::result(format_args!("{}\n", report.json(&path, &findings)));
    } else {
        for finding in &findings {
            findings::print(finding, "", 16);
        }
        if ended.is_none() && found.made.iter().any(Option::is_some) {
            output::result(format_args!("{}", identified_text(&found)));
        }
    }
    match ended {
        Some(ProbeEnd::Interrupted) => return Err(CliError::device("interrupted: not finished")),
        Some(ProbeEnd::Device(_)) => {
            return Err(CliError::device(format_args!("the arm at {path} went away"))
                .hint("is its plug loose? `hapticd devices` lists what there is"));
        }
        _ => {}
    }
    let is_bad = findings.iter().any(|finding| finding.standing == Standing::Bad);
    Ok(if is_bad || ended.is_some() || report.is_unproven() { Exit::Device } else { Exit::Ok })
}

/// Tells what becomes of the link while the arm is tried out, until the arm is closed. What is a
/// finding at the end (`notice`) is not reported twice.
fn tell_news(news: Receiver<LinkNews>, notice: Option<String>, output: OutputOptions) {
    std::thread::spawn(move || {
        for news in news {
            match news {
                LinkNews::Unguarded(why) => report::warning(&guard::missing_text(&why), output),
                LinkNews::Reported(text) if notice.as_ref() != Some(&text) => {
                    report::note(&format!("device: {text}"), output)
                }
                // A lost arm ends the trial.
                LinkNews::Reported(_)
                | LinkNews::Lost
                | LinkNews::Back { .. }
                | LinkNews::Fails(_) => {}
            }
        }
    });
}

/// What to do where an axis did not move; an arm whose dead-man's switch is open makes no force.
const LOOSELY: &str =
    "hold the grip more loosely, with its dead-man's switch closed if it has one, and check again";
const LET_GO: &str = "let go of the grip, or let it move with its dead-man's switch closed if it \
    has one, and try again";

/// What a person has to do before the arm is opened. On a terminal it is waited for where the arm
/// counts from that pose.
fn home(homing: &Homing, output: OutputOptions) {
    let Some(instruction) = &homing.instruction else { return };
    report::note(&format!("homing: {instruction}"), output);
    if homing.mode == HomingMode::PowerOnPose && std::io::stdin().is_terminal() {
        output::message(format_args!("Enter when it is so: "));
        // The end of the input is an answer as good as any.
        let _ = std::io::stdin().read_line(&mut String::new());
    }
}

/// Asks a person whether force may come, and does not wait: until the answer is there the arm gets
/// zero in every tick.
fn ask(go: &Arc<AtomicBool>, quit: &'static AtomicBool) {
    output::message(format_args!("Enter when you are ready, Ctrl-C to end it: "));
    let go = go.clone();
    std::thread::spawn(move || {
        // The end of the input is no answer.
        let is_answer = std::io::stdin().read_line(&mut String::new()).is_ok_and(|n| n > 0);
        if is_answer {
            go.store(true, Ordering::Relaxed)
        } else {
            quit.store(true, Ordering::Relaxed)
        }
    });
}

fn step_text(step: ProbeStep, profile: &Profile) -> &'static str {
    match step {
        ProbeStep::Signs if profile.limits.torque_nm > 0.0 => {
            "sign check: hold the grip loosely; a push of 0.3 N along each axis follows, and a \
                small turn about each that has a motor"
        }
        ProbeStep::Signs => {
            "sign check: hold the grip loosely; a push of 0.3 N along each axis follows"
        }
        ProbeStep::Identify => "identification: let go of the grip; each axis is shaken for 14 s",
    }
}

impl ProbeReport<'_> {
    fn findings(&self) -> Vec<Finding> {
        let mut findings = vec![self.answers(), self.packets(), self.arm(), self.position()];
        findings.extend(self.gripper());
        findings.extend(
            self.identity
                .as_ref()
                .map(|identity| Finding::good("says of itself", identity.clone())),
        );
        findings.extend(self.notice.as_ref().map(|notice| {
            let advice =
                "set it to what changes nothing on the service's own page, or know that what you \
                    feel is not what was commanded";
            Finding::advice("its own filters", notice.clone(), advice).by_hand()
        }));
        findings.extend(self.declared.and_then(|declared| self.asks_too_much(declared)));
        if self.args.sign_check {
            findings.extend(self.signs());
        }
        if self.args.identify {
            findings.extend(self.made());
        }
        findings.extend(self.end());
        findings
    }

    fn answers(&self) -> Finding {
        let answers = &self.found.answers;
        let share = answers.fresh as f64 / answers.ticks.max(1) as f64;
        let found = format!(
            "{} of {} ticks brought a sample; longest silence {} ticks; round trip {} ticks",
            answers.fresh, answers.ticks, answers.longest_silence_ticks, answers.round_trip_ticks
        );
        let is_event = self.profile.link.pacing == Pacing::Event;
        if answers.fresh == 0 && !is_event {
            Finding::bad(
                "answers",
                found,
                "switch the arm off and on, then try again; `hapticd doctor` looks further",
            )
            .by_hand()
        } else if share < 0.99 && !is_event {
            let advice =
                "hapticd doctor   # latency timer, autosuspend and wake-ups are the usual causes";
            Finding::advice("answers", found, advice)
        } else {
            Finding::good("answers", found)
        }
    }

    fn packets(&self) -> Finding {
        let Answers { corrupt, lost_packets, .. } = self.found.answers;
        let mut found = format!("{corrupt} corrupt packets, {lost_packets} lost ones");
        if self.refused > 0 {
            found += &format!(
                "; {} came whole, but no arm can be where they say: is it the right profile?",
                self.refused
            );
        }
        if corrupt + lost_packets + self.refused == 0 {
            return Finding::good("packets", found);
        }
        Finding::advice(
            "packets",
            found,
            "try another cable, and a port of the machine itself instead of a hub",
        )
        .by_hand()
    }

    fn arm(&self) -> Finding {
        match self.found.answers {
            Answers { fresh: 0, .. } => {
                Finding::unknown("arm", "no sample came: whether it is homed is unknown")
            }
            Answers { error: error @ 1.., .. } => Finding::bad(
                "arm",
                error_text(error, Some(&self.real.protocol)),
                "switch the arm off and on",
            )
            .by_hand(),
            Answers { homed: false, .. } => {
                Finding::advice("arm", "is not homed", self.homing()).by_hand()
            }
            _ => Finding::good("arm", "homed, no error"),
        }
    }

    fn homing(&self) -> String {
        self.real.homing.instruction.clone().unwrap_or_else(|| "home it".to_owned())
    }

    fn position(&self) -> Finding {
        let Answers { fresh, position_m, spread_m, .. } = self.found.answers;
        if fresh == 0 {
            return Finding::unknown("position", "no sample came");
        }
        let [x, y, z] = position_m.to_array().map(|way| way * 1e3);
        let found = format!(
            "({x:.2}, {y:.2}, {z:.2}) mm; it moved by at most {:.3} mm while listening",
            spread_m * 1e3
        );
        let away_m = position_m.length();
        let radius_m = self.profile.limits.workspace_radius_m;
        // A rate input has no place, and goes where it is sent.
        if away_m <= radius_m || self.real.is_rate_input() {
            return Finding::good("position", found);
        }
        let found =
            format!("{found}; {away_m:.3} m from the origin, the workspace is {radius_m} m");
        if self.real.homing.mode == HomingMode::PowerOnPose && away_m <= PARKED * radius_m {
            return Finding::advice(
                "position",
                found,
                "move the grip into the workspace: force flows only there",
            )
            .by_hand();
        }
        Finding::bad(
            "position",
            found + ": units, scale, home_counts or park pose?",
            self.homing_or_profile(),
        )
        .by_hand()
    }

    fn gripper(&self) -> Option<Finding> {
        let Answers { fresh: 1.., grip_rad, .. } = self.found.answers else { return None };
        let is_sensed = self.profile.sensed.has(GRIPPER);
        is_sensed.then(|| {
            Finding::good(
                "gripper",
                format!("{grip_rad:.3} rad; measured, and its motor is not driven"),
            )
        })
    }

    fn homing_or_profile(&self) -> String {
        match &self.real.homing.instruction {
            Some(instruction) => format!("home it again, or correct the profile. {instruction}"),
            None => "correct the profile".to_owned(),
        }
    }

    /// Where the profile asks for more than the arm says that it can.
    fn asks_too_much(&self, declared: DeclaredLimits) -> Option<Finding> {
        let limits = &self.profile.limits;
        let rows = [
            ("limits.force_n", limits.force_n, declared.force_n, "N"),
            ("limits.torque_nm", limits.torque_nm, declared.torque_nm, "N·m"),
            (
                "limits.workspace_radius_m",
                limits.workspace_radius_m,
                declared.workspace_radius_m,
                "m",
            ),
            ("link.rate_hz", self.profile.link.rate_hz.into(), declared.rate_hz.into(), "Hz"),
        ];
        // What the wire rounds is not more.
        let more = rows.into_iter().filter(|(_, asked, has, _)| *asked > has * (1.0 + 1e-6));
        let more: Vec<String> = more
            .map(|(key, asked, has, unit)| format!("{key} = {asked}, the arm has {has:.4} {unit}"))
            .collect();
        let advice = "write into the profile what the arm has";
        (!more.is_empty())
            .then(|| Finding::advice("profile asks more", more.join("; "), advice).by_hand())
    }

    fn signs(&self) -> Vec<Finding> {
        let mut findings = Vec::new();
        let signs = &self.found.signs;
        for (axis, sign) in Axes::NAMES.iter().zip(signs) {
            let name = format!("sign of {axis}");
            findings.extend(sign.map(|sign| {
                match sign {
                Sign::Right => Finding::good(name, "goes the way it is pushed"),
                Sign::Wrong => Finding::bad(
                    name,
                    "goes against the push: force would feed back on itself",
                    "change motor_sign or encoder_sign of the joints behind this axis in a copy of \
                        the profile, and check again",
                )
                .by_hand(),
                Sign::Still => Finding::advice(name, "hardly moved", LOOSELY).by_hand(),
            }
            }));
        }
        if self.pushed().next().is_none() {
            findings
                .push(Finding::unknown("signs", "the arm has no motors that could push the grip"));
        } else if !self.is_unsigned() {
            let found = "all right: set signs_verified = true in a copy of the profile";
            findings.push(Finding::good("signs", found));
        } else if self.args.sign_check && self.ended.is_none() {
            findings
                .push(Finding::unknown("signs", "not all are right: signs_verified stays false"));
        }
        findings
    }

    fn made(&self) -> Vec<Finding> {
        let mut findings = Vec::new();
        for (axis, made) in Axes::NAMES.iter().zip(self.found.made) {
            findings.extend(made.map(|made| {
                let AxisDynamics {
                    mass_kg,
                    mass_spread_kg,
                    damping_n_s_per_m,
                    damping_spread_n_s_per_m,
                    coulomb_n,
                    ..
                } = made;
                let found = format!(
                    "{mass_kg:.3} ± {mass_spread_kg:.3} kg, {damping_n_s_per_m:.2} ± \
                        {damping_spread_n_s_per_m:.2} N·s/m, dry friction {coulomb_n:.3} N"
                );
                Finding::good(format!("made of, {axis}"), found)
            }));
        }
        if self.ended.is_none() && findings.is_empty() {
            findings.push(Finding::advice("made of", "no axis moved", LET_GO).by_hand());
        }
        findings
    }

    /// Signs of the axes that have a motor to be pushed with.
    fn pushed(&self) -> impl Iterator<Item = Option<Sign>> {
        let ProbeReport { profile, found, .. } = self;
        found
            .signs
            .iter()
            .enumerate()
            .filter(|(axis, _)| profile.actuated.has(*axis))
            .map(|(_, sign)| *sign)
    }

    fn is_unsigned(&self) -> bool {
        self.pushed().any(|sign| sign != Some(Sign::Right))
    }

    /// It was to show something, and has not: an axis did not move.
    fn is_unproven(&self) -> bool {
        let mut made = self.found.made.iter().enumerate();
        self.args.sign_check && self.is_unsigned()
            || self.args.identify
                && made.any(|(axis, made)| self.profile.actuated.has(axis) && made.is_none())
    }

    /// Why it ended before its time.
    fn end(&self) -> Option<Finding> {
        let has_pushed = self.found.signs.iter().any(Option::is_some)
            || self.found.made.iter().any(Option::is_some);
        let rest = if has_pushed { "the rest was not pushed" } else { "nothing pushed" };
        Some(match self.ended? {
            ProbeEnd::Interrupted | ProbeEnd::Device(_) => Finding::unknown("not finished", rest),
            ProbeEnd::NotHomed => Finding::bad("not homed", rest, self.homing()).by_hand(),
            ProbeEnd::Reports(error) => {
                let found = format!("{}: {rest}", error_text(error, Some(&self.real.protocol)));
                Finding::bad("arm's error", found, "switch the arm off and on, and try again")
                    .by_hand()
            }
            ProbeEnd::Watchdog(gap_ms) => {
                let watchdog_ms = self.profile.link.device_watchdog_ms.unwrap_or_default();
                let found = format!(
                    "the arm has switched itself off, or may have: no command for {gap_ms} ms, and \
                        its watchdog waits for {watchdog_ms} ms; {rest}"
                );
                Finding::bad(
                    "watchdog",
                    found,
                    "close what keeps the processors busy, and try again",
                )
                .by_hand()
            }
            ProbeEnd::Stalled(gap_ms) => {
                let found =
                    format!("the program stood still for {gap_ms} ms during a push; {rest}");
                Finding::bad(
                    "stalled",
                    found,
                    "close what keeps the processors busy, and try again",
                )
                .by_hand()
            }
            ProbeEnd::Moves(mm_per_s, mrad_per_s) => {
                let found = format!(
                    "the grip came to {:.2} m/s and {:.1} rad/s, which no push of this trial does: \
                        let go; {rest}",
                    f64::from(mm_per_s) * 1e-3,
                    f64::from(mrad_per_s) * 1e-3
                );
                let advice = "hold the grip still and try again; if it moves by itself, look at \
                    motor_sign, encoder_sign and the masses of the links";
                Finding::bad("moves by itself", found, advice).by_hand()
            }
        })
    }

    fn json(&self, path: &str, findings: &[Finding]) -> Value {
        let ProbeResult { answers, signs, made, .. } = self.found;
        let sign_name = |sign: Sign| match sign {
            Sign::Right => "right",
            Sign::Wrong => "wrong",
            Sign::Still => "still",
        };
        let ended = self.ended.map(|ended| match ended {
            ProbeEnd::Interrupted => "interrupted",
            ProbeEnd::Device(_) => "disconnected",
            ProbeEnd::NotHomed => "not-homed",
            ProbeEnd::Reports(_) => "device-error",
            ProbeEnd::Watchdog(_) => "watchdog",
            ProbeEnd::Stalled(_) => "stalled",
            ProbeEnd::Moves(..) => "moves",
        });
        json!({
            "profile": self.profile.name,
            "path": path,
            "ended_early": ended,
            "identity": self.identity,
            "notice": self.notice,
            "ticks": answers.ticks,
            "fresh": answers.fresh,
            "corrupt_packets": answers.corrupt,
            "refused_packets": self.refused,
            "lost_packets": answers.lost_packets,
            "longest_silence_ticks": answers.longest_silence_ticks,
            "round_trip_ticks": answers.round_trip_ticks,
            "homed": answers.homed,
            "device_error": answers.error,
            "position_m": answers.position_m.to_array(),
            "spread_m": answers.spread_m,
            "grip_rad": answers.grip_rad,
            "signs": signs.map(|sign| sign.map(sign_name)),
            "identified": made.map(|made| made.map(made_json)),
            "findings": findings.iter().map(finding_json).collect::<Vec<_>>(),
        })
    }
}

fn made_json(made: AxisDynamics) -> Value {
    json!({
        "mass_kg": made.mass_kg,
        "mass_spread_kg": made.mass_spread_kg,
        "damping_n_s_per_m": made.damping_n_s_per_m,
        "damping_spread_n_s_per_m": made.damping_spread_n_s_per_m,
        "damping_bound_n_s_per_m": made.damping_bound_n_s_per_m,
        "coulomb_n": made.coulomb_n,
    })
}

/// What to add to a copy of the profile: the lightest and the least damped axis, which is what
/// stability is judged by. Of the viscosity only what is sure.
fn identified_text(found: &ProbeResult) -> String {
    let least = |of: fn(&AxisDynamics) -> f64| {
        found.made.iter().flatten().map(of).fold(f64::INFINITY, f64::min)
    };
    format!(
        "add to a copy of the profile (the damping is what was found less twice its \
            spread):\n\n[identified]\nround_trip_ticks = {}\nmass_kg = {:.4}\ndamping_n_s_per_m = \
            {:.3}\n",
        found.answers.round_trip_ticks,
        least(|made| made.mass_kg),
        least(|made| made.damping_bound_n_s_per_m)
    )
}

#[cfg(test)]
mod tests;
