//! `hapticd doctor`: is this machine, and is this arm, good enough? Every finding says what to
//! type.

use core::sync::atomic::AtomicBool;
use core::time::Duration;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::error::{CliError, Outcome};
use super::findings::{self, finding_json};
use super::{OutputOptions, guard, output, report};
use crate::config::scene::DeviceConfig;
use crate::config::{self, LoadOptions, SceneConfig};
use crate::error::Exit;
use arms::attached::discover;
use arms::attached::libraries::{self, SystemView};
use arms::attached::nodes::{self, Selector};
use arms::attached::open::{self, OpenError, OpenOptions};
use arms::attached::probe::{self, ProbeEnd, Trial};
use arms::profile::{self, Profile};
use arms::transport::ServiceError;
use arms::vendor::VendorError;
use rt::clock::RealClock;
use rt::finding::{Finding, Root, Standing};
use rt::realtime;
use rt::schedule::{self, ThreadRequest};
use rt::wakeup::{self, WakeupTest};
use rt::{duration, machine, signals};

/// Arguments of `hapticd doctor`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Look at what this scene needs: its processor, its priority, its rate, its arm.
    scene: Option<PathBuf>,
    /// Look at what the arm of this profile needs, instead of the scene's: a name or a file.
    #[arg(long, value_name = "PROFILE")]
    device: Option<String>,
    /// How long to measure wake-ups.
    #[arg(long, value_name = "TIME", default_value = "10s", value_parser = duration::parse)]
    duration: Duration,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
    /// Print the udev rules that give access to arms, and do nothing else.
    #[arg(long, conflicts_with_all = ["scene", "device", "json"])]
    udev_rules: bool,
}

/// Rate where no scene names it: the default of scenes.
const DEFAULT_RATE_HZ: u32 = 1000;

/// Upper bounds of the printed histogram, µs.
const BOUNDS_US: [u64; 8] = [10, 20, 50, 100, 200, 500, 1000, 10_000];

/// Share of missed ticks from which a machine is no good.
const MISSED_SHARE: f64 = 1e-3;

pub(crate) fn main(args: &Args, output: OutputOptions) -> Outcome {
    if args.udev_rules {
        output::result(format_args!("{}", discover::UDEV_RULES));
        return Ok(Exit::Ok);
    }
    let load = LoadOptions { device: args.device.clone(), ..LoadOptions::default() };
    let scene = args.scene.as_deref();
    let config = scene.map(|scene| config::load_with(scene, &load)).transpose()?;
    let (request, rate_hz) = wanted(config.as_ref());
    let arm = match (&config, &args.device) {
        (Some(config), _) => {
            let DeviceConfig { profile, selector, .. } = &config.device;
            Some(NamedArm {
                profile: profile.clone(),
                selector: selector.clone(),
                rate_hz,
                is_asked_for: args.device.is_some(),
            })
        }
        (None, None) => None,
        (None, Some(name)) => {
            let profile = profile::find(name, &std::env::current_dir().unwrap_or_default())?;
            let rate_hz = profile.link.rate_hz;
            Some(NamedArm { profile, selector: None, rate_hz, is_asked_for: true })
        }
    };
    let root = Root::default();

    let devices = device_findings(arm.as_ref(), &root);
    let machine = machine::findings(&root, request.cpu);
    report::note(
        &format!(
            "measuring wake-ups for {:.0} s on processor {} (Ctrl-C ends it)",
            args.duration.as_secs_f64(),
            request.cpu
        ),
        output,
    );
    static NEVER: AtomicBool = AtomicBool::new(false);
    // Without a handler Ctrl-C ends the program, which is what it does elsewhere.
    let quit = signals::interrupted().unwrap_or(&NEVER);
    let period = Duration::from_secs(1) / rate_hz;
    let test = wakeup::measure(request, period, args.duration, quit)
        .map_err(|error| CliError::internal(format_args!("cannot measure wake-ups: {error}")))?;
    let program = std::env::current_exe()
        .map_or_else(|_| "hapticd".to_owned(), |path| path.display().to_string());
    let mut rights = machine::rights(&test.entered, &program);
    rights.push(lateness(&test, rate_hz));

    let mut devices = devices;
    let mut trips_us = Vec::new();
    if let Some(arm) = arm.as_ref().filter(|arm| arm.profile.real.is_some()) {
        devices.extend(arm_findings(arm));
        match exchange(arm, request, args.duration, quit, output) {
            Ok(trips) => {
                devices.extend(answers(&trips, rate_hz));
                trips_us = trips;
            }
            Err(finding) => devices.push(finding),
        }
    }

    let exit = verdict(&devices, &rights);
    let sentence = verdict_text(&devices, &machine, &rights, rate_hz);
    if args.json {
        print_json(&[&devices, &machine, &rights], &test, &trips_us, exit, &sentence);
    } else {
        print_text(
            &[("arms", &devices), ("machine", &machine), ("loop", &rights)],
            &test,
            &trips_us,
            exit,
            &sentence,
        );
    }
    Ok(exit)
}

/// The arm that a scene or `--device` names.
struct NamedArm {
    profile: Profile,
    selector: Option<Selector>,
    rate_hz: u32,
    /// The command line names it, and not only the scene.
    is_asked_for: bool,
}

/// What is not known of it.
fn arm_findings(arm: &NamedArm) -> Vec<Finding> {
    let NamedArm { profile, selector, rate_hz, .. } = arm;
    let mut findings = Vec::new();
    if let Err(slow) = profile.link_carries(*rate_hz) {
        let advice = "write another `rate_hz` or `baud`, if the port is not one on USB";
        findings.push(Finding::advice("link", slow.to_string(), advice).by_hand());
    }
    if profile.has_unverified_signs() {
        let found =
            format!("not verified: force stays below {} N", profile.unverified_limits().force_n);
        findings.push(Finding::advice(
            "signs",
            found,
            super::probe::command(profile, selector.as_ref(), "--sign-check"),
        ));
    }
    if profile.is_unidentified() {
        let found = "not identified: stiffness is bounded by half of the assumed damping";
        findings.push(Finding::advice(
            "identified",
            found,
            super::probe::command(profile, selector.as_ref(), "--identify"),
        ));
    }
    findings
}

/// Exchanges zero commands for samples with it.
fn exchange(
    arm: &NamedArm,
    request: ThreadRequest,
    duration: Duration,
    quit: &AtomicBool,
    output: OutputOptions,
) -> Result<Vec<u64>, Finding> {
    let NamedArm { profile, selector, rate_hz, is_asked_for } = arm;
    if profile.names_library() && !is_asked_for {
        let found = format!(
            "not measured: the profile {} of the scene names a library, and to load one runs its \
                code",
            profile.given()
        );
        let file = output::quoted(Path::new(&profile.given()));
        let advice = format!("hapticd doctor --device {file}   # if you trust it");
        return Err(Finding::advice("round trip", found, advice));
    }
    let period_s = 1.0 / f64::from(*rate_hz);
    let options = OpenOptions {
        selector: selector.clone(),
        io_request: Some(request.below()),
        period_s,
        guard: guard::program(),
    };
    let again = "hapticd devices";
    let mut opened = open::open(profile, &options).map_err(|error| match error {
        // Said already, with what stands in its way.
        OpenError::Missing { .. }
        | OpenError::Vendor { cause: VendorError::Missing { .. }, .. }
        | OpenError::Service(ServiceError::Absent { .. })
            if selector.is_none() =>
        {
            Finding::unknown("round trip", "not measured: the arm does not open")
        }
        error => Finding::bad("arm", error.to_string(), error.hint().unwrap_or(again)),
    })?;
    report::note(
        &format!(
            "exchanging zero commands with the {} for {:.0} s",
            profile.title,
            duration.as_secs_f64()
        ),
        output,
    );
    let mut trial = Trial::new(RealClock, period_s, quit);
    // What the system refuses is said of the wake-ups already, which ask for the same.
    let exchange = |_| probe::round_trips(&mut opened.arm, &mut trial, duration);
    let exchanged = realtime::run("probe", request, exchange, || {})
        .map_err(|error| Finding::unknown("round trip", format!("not measured: {error}")))?;
    exchanged.map_err(|ended| match ended {
        ProbeEnd::Interrupted => Finding::unknown("round trip", "not measured: it was interrupted"),
        ended => Finding::bad("round trip", format!("the arm went away: {ended:?}"), again),
    })
}

/// How soon the arm answers. An arm that sends on change only sends nothing while no hand touches
/// it.
fn answers(trips_us: &[u64], rate_hz: u32) -> Option<Finding> {
    let mut sorted = trips_us.to_vec();
    sorted.sort_unstable();
    let quantile =
        |share: f64| sorted.get((share * (sorted.len() as f64 - 1.0)).round() as usize).copied();
    let half = quantile(0.5)?;
    let most = quantile(0.99)?;
    let longest = quantile(1.0)?;
    let found =
        format!("p50 {half} µs, p99 {most} µs, largest {longest} µs; {} exchanges", sorted.len());
    let period_us = 1_000_000 / u64::from(rate_hz.max(1));
    let advice = "latency timer, autosuspend and hubs are the usual causes: follow the advice \
        above, then: hapticd doctor SCENE";
    Some(if most > 2 * period_us {
        Finding::advice("round trip", found, advice).by_hand()
    } else {
        Finding::good("round trip", found)
    })
}

/// How many of them fall under each of the printed bounds, and beyond the last.
fn bins_of(trips_us: &[u64]) -> [u64; BOUNDS_US.len() + 1] {
    let mut bins = [0; BOUNDS_US.len() + 1];
    for trip_us in trips_us {
        bins[BOUNDS_US.partition_point(|bound| bound < trip_us)] += 1;
    }
    bins
}

fn wanted(config: Option<&SceneConfig>) -> (ThreadRequest, u32) {
    let realtime = config.map(|config| config.realtime);
    let cpu = schedule::loop_cpu(realtime.and_then(|realtime| realtime.cpu));
    let priority = realtime.map_or(super::probe::PRIORITY, |realtime| realtime.priority);
    (ThreadRequest { cpu, priority }, config.map_or(DEFAULT_RATE_HZ, |config| config.rate_hz))
}

/// Findings about arms: those attached, and the one that is named.
fn device_findings(arm: Option<&NamedArm>, root: &Root) -> Vec<Finding> {
    let mut findings = vec![discover::udev(root), discover::modem_manager(root)];
    let machine =
        SystemView { root, variable: &|name| std::env::var_os(name), may_use: &discover::may_use };
    let profile = arm.map(|arm| &arm.profile);
    if let Some(of_maker) = profile.and_then(|profile| libraries::arm_findings(&machine, profile)) {
        findings.extend(of_maker);
        return findings;
    }
    let attached =
        discover::attached(nodes::list(), &discover::known_arms(), root, discover::may_use);
    let mut found_wanted = false;
    for node in &attached {
        let is_wanted = profile.is_some_and(|profile| node.profiles.contains(&profile.name));
        found_wanted |= is_wanted;
        let is_arm = !node.profiles.is_empty() || !node.beside.is_empty();
        if is_wanted || profile.is_none() && is_arm {
            findings.extend(discover::findings(node, root));
        }
    }
    let makers = if profile.is_none() { libraries::makers_libraries(&machine) } else { Vec::new() };
    findings.extend(
        makers.iter().flat_map(|found| libraries::findings(&machine, found.family, None, None)),
    );
    // A node that the scene names itself need not be one that its profile knows: whether it is
    // there shows when it is opened.
    let is_named = arm.is_some_and(|arm| arm.selector.is_some());
    findings
        .extend(profile.and_then(|profile| discover::scene_arm(profile, found_wanted || is_named)));
    let is_none_known = makers.is_empty() && !attached.iter().any(|node| !node.profiles.is_empty());
    if profile.is_none() && is_none_known {
        let seen = attached.len();
        findings.push(Finding::unknown(
            "arm",
            format!("none attached that a profile knows; {seen} other nodes (`hapticd devices`)"),
        ));
    }
    findings
}

fn lateness(test: &WakeupTest, rate_hz: u32) -> Finding {
    let period_us = 1e6 / f64::from(rate_hz);
    let found = format!(
        "p50 {:.0} µs, p99 {:.0} µs, p99.9 {:.0} µs, largest {:.0} µs; {} of {} ticks missed at \
            {rate_hz} Hz",
        test.quantile_us(0.5),
        test.quantile_us(0.99),
        test.quantile_us(0.999),
        test.max_us(),
        test.missed,
        test.wakeups + test.missed
    );
    let share = test.missed as f64 / (test.wakeups + test.missed).max(1) as f64;
    let advice = "close what keeps the processors busy (`top`), follow the advice above, then: \
        hapticd doctor";
    if share > MISSED_SHARE || test.quantile_us(0.99) > 0.5 * period_us {
        Finding::bad("wake-up", found, advice).by_hand()
    } else if test.missed > 0 || test.max_us() > 0.5 * period_us {
        Finding::advice("wake-up", found, advice).by_hand()
    } else {
        Finding::good("wake-up", found)
    }
}

fn verdict(devices: &[Finding], rights: &[Finding]) -> Exit {
    let is_bad =
        |findings: &[Finding]| findings.iter().any(|finding| finding.standing == Standing::Bad);
    match (is_bad(devices), is_bad(rights)) {
        (true, _) => Exit::Device,
        (false, true) => Exit::RealtimeRefused,
        (false, false) => Exit::Ok,
    }
}

/// What it comes to, with its reason: the first finding that decides it.
fn verdict_text(
    devices: &[Finding],
    machine: &[Finding],
    rights: &[Finding],
    rate_hz: u32,
) -> String {
    let reason = |findings: &[Finding]| {
        let mut bad = findings.iter().filter(|finding| finding.standing == Standing::Bad);
        let first = bad.next().map(|finding| format!("{}: {}", finding.name, finding.found))?;
        Some(match bad.count() {
            0 => first,
            1 => format!("{first}; and 1 more is `bad`"),
            n => format!("{first}; and {n} more are `bad`"),
        })
    };
    if let Some(reason) = reason(devices) {
        return format!("an arm cannot be used as it is, because of {reason}");
    }
    if let Some(reason) = reason(rights) {
        return format!("this machine does not keep {rate_hz} Hz as it is, because of {reason}");
    }
    let groups = [devices, machine, rights];
    let all = groups.iter().flat_map(|findings| findings.iter());
    let better: Vec<&str> = all
        .filter(|finding| finding.standing >= Standing::Advice)
        .map(|finding| finding.name.as_str())
        .collect();
    let good = format!("this machine keeps {rate_hz} Hz, because nothing that counts is `bad`");
    if better.is_empty() { good } else { format!("{good}; better would be: {}", better.join(", ")) }
}

fn print_text(
    groups: &[(&str, &[Finding])],
    test: &WakeupTest,
    trips_us: &[u64],
    exit: Exit,
    sentence: &str,
) {
    for (title, findings) in groups {
        output::result(format_args!("{title}\n"));
        for finding in *findings {
            findings::print(finding, "  ", 20);
        }
    }
    print_bins("late wake-ups", &test.bins(&BOUNDS_US));
    if !trips_us.is_empty() {
        print_bins("round trips of the arm", &bins_of(trips_us));
    }
    output::result(format_args!("verdict: {sentence} (exit {})\n", exit as u8));
}

fn print_bins(title: &str, bins: &[u64]) {
    output::result(format_args!("{title}\n"));
    let most = bins.iter().copied().max().unwrap_or(1).max(1);
    for (idx, count) in bins.iter().enumerate() {
        let label = match BOUNDS_US.get(idx) {
            Some(bound) => format!("up to {bound} µs"),
            None => "later".to_owned(),
        };
        let bar = "#".repeat((count * 40).div_ceil(most) as usize);
        output::result(format_args!("  {label:<16} {count:>8}  {bar}\n"));
    }
}

fn print_json(
    groups: &[&[Finding]],
    test: &WakeupTest,
    trips_us: &[u64],
    exit: Exit,
    sentence: &str,
) {
    let findings: Vec<_> =
        groups.iter().flat_map(|findings| findings.iter()).map(finding_json).collect();
    let bins = bins_json(&test.bins(&BOUNDS_US), "wakeups");
    let trips = bins_json(&bins_of(trips_us), "exchanges");
    let object = json!({
        "verdict": match exit { Exit::Ok => "good", Exit::Device => "device", _ => "realtime" },
        "reason": sentence,
        "exit_code": exit as u8,
        "findings": findings,
        "wakeup_us": {
            "p50": test.quantile_us(0.5), "p99": test.quantile_us(0.99), "p999": test.quantile_us(0.999), "max": test.max_us(),
        },
        "wakeups": test.wakeups,
        "missed": test.missed,
        "histogram": bins,
        "round_trips": if trips_us.is_empty() { Value::Null } else { trips },
    });
    output::result(format_args!("{object}\n"));
}

fn bins_json(bins: &[u64], counted: &str) -> Value {
    bins.iter()
        .enumerate()
        .map(|(idx, count)| json!({ "up_to_us": BOUNDS_US.get(idx), counted: count }))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn round_trips_are_judged_by_the_period() {
        assert_eq!(answers(&[], 1000), None);
        let mut trips_us = vec![300; 99];
        trips_us.push(9000);
        assert_eq!(answers(&trips_us, 1000).map(|finding| finding.standing), Some(Standing::Good));
        assert_eq!(
            answers(&[2100; 100], 1000).map(|finding| finding.standing),
            Some(Standing::Advice)
        );
        let bins = bins_of(&trips_us);
        assert_eq!((bins[5], bins[7], bins.iter().sum::<u64>()), (99, 1, 100));
        assert_eq!(bins_of(&[10, 11, 20_000]), [1, 1, 0, 0, 0, 0, 0, 0, 1]);
    }

    #[test]
    fn the_verdict_is_that_of_the_worst_that_counts() {
        let good = [Finding::good("a", "b"), Finding::advice("a", "b", "c")];
        let bad = [Finding::bad("a", "b", "c")];
        assert_eq!(verdict(&good, &good), Exit::Ok);
        assert_eq!(verdict(&good, &bad), Exit::RealtimeRefused);
        assert_eq!(verdict(&bad, &bad), Exit::Device);
    }

    #[test]
    fn the_verdict_is_a_sentence_with_its_reason() {
        let good = [Finding::good("wake-up", "p50 8 µs")];
        let late = [
            Finding::bad("wake-up", "300 of 10000 ticks missed", "c"),
            Finding::bad("schedule", "normal", "c"),
        ];
        let fast = [Finding::advice("processor", "powersave", "c")];
        assert_eq!(
            verdict_text(&good, &good, &good, 1000),
            "this machine keeps 1000 Hz, because nothing that counts is `bad`"
        );
        let sentence = "this machine keeps 500 Hz, because nothing that counts is `bad`; better \
            would be: processor";
        assert_eq!(verdict_text(&good, &fast, &good, 500), sentence);
        let reason = "because of wake-up: 300 of 10000 ticks missed; and 1 more is `bad`";
        assert_eq!(
            verdict_text(&good, &fast, &late, 1000),
            format!("this machine does not keep 1000 Hz as it is, {reason}")
        );
        assert_eq!(
            verdict_text(&late, &fast, &late, 1000),
            format!("an arm cannot be used as it is, {reason}")
        );
    }
}
