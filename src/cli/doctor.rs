//! `hapticd doctor`: is this machine, and is this arm, good enough? Every finding says what to type.

use core::sync::atomic::{AtomicBool, Ordering};
use core::time::Duration;
use std::path::PathBuf;

use serde_json::json;

use super::devices::finding_json;
use super::{Talk, report, say};
use crate::config::{self, SceneConfig};
use crate::device::discover;
use crate::device::nodes;
use crate::error::Exit;
use crate::rt::finding::{Finding, Root, Standing};
use crate::rt::schedule::{self, ThreadRequest};
use crate::rt::wakeup::{self, WakeupTest};
use crate::rt::{duration, machine, signals};

/// Arguments of `hapticd doctor`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Look at what this scene needs: its processor, its priority, its rate, its arm.
    scene: Option<PathBuf>,
    /// How long to measure wake-ups.
    #[arg(long, value_name = "TIME", default_value = "10s", value_parser = duration::parse)]
    duration: Duration,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
    /// Print the udev rules that give access to arms, and do nothing else.
    #[arg(long, conflicts_with_all = ["scene", "json"])]
    udev_rules: bool,
}

/// Priority and rate where no scene names them: the defaults of scenes.
const DEFAULT_PRIORITY: u8 = 80;
const DEFAULT_RATE_HZ: u32 = 1000;

/// Upper bounds of the printed histogram, µs.
const BOUNDS_US: [u64; 8] = [10, 20, 50, 100, 200, 500, 1000, 10_000];

/// Share of missed ticks from which a machine is no good.
const MISSED_SHARE: f64 = 1e-3;

pub(crate) fn main(args: &Args, talk: Talk) -> Exit {
    if args.udev_rules {
        say::result(format_args!("{}", discover::UDEV_RULES));
        return Exit::Ok;
    }
    let config = match args.scene.as_deref().map(config::load).transpose() {
        Ok(config) => config,
        Err(errors) => return report::config_errors(&errors, talk),
    };
    let (request, rate_hz) = wanted(config.as_ref());
    let root = Root::default();

    let devices = device_findings(config.as_ref(), &root);
    let machine = machine::findings(&root, request.cpu);
    report::note(
        &format!("measuring wake-ups for {:.0} s on processor {} (Ctrl-C ends it)", args.duration.as_secs_f64(), request.cpu),
        talk,
    );
    let quit = AtomicBool::new(false);
    let test = match measure(request, rate_hz, args.duration, &quit) {
        Ok(test) => test,
        Err(error) => {
            report::error(&format!("cannot measure wake-ups: {error}"), None, talk);
            return Exit::Internal;
        }
    };
    let program = std::env::current_exe().map_or_else(|_| "hapticd".to_owned(), |path| path.display().to_string());
    let mut rights = machine::rights(request, test.standing, test.memory, &program);
    rights.push(lateness(&test, rate_hz));

    let exit = verdict(&devices, &rights);
    if args.json {
        print_json(&[&devices, &machine, &rights], &test, exit);
    } else {
        print_text(&[("arms", &devices), ("machine", &machine), ("loop", &rights)], &test, exit);
    }
    exit
}

fn wanted(config: Option<&SceneConfig>) -> (ThreadRequest, u32) {
    let realtime = config.map(|config| config.realtime);
    let cpu = realtime.and_then(|realtime| realtime.cpu).unwrap_or_else(schedule::default_cpu);
    let priority = realtime.map_or(DEFAULT_PRIORITY, |realtime| realtime.priority);
    (ThreadRequest { cpu, priority }, config.map_or(DEFAULT_RATE_HZ, |config| config.rate_hz))
}

fn measure(request: ThreadRequest, rate_hz: u32, duration: Duration, quit: &AtomicBool) -> std::io::Result<WakeupTest> {
    let done = AtomicBool::new(false);
    std::thread::scope(|scope| {
        // Without a handler Ctrl-C ends the program, which is what it does elsewhere.
        if let Ok(interrupts) = signals::interrupts() {
            let (done, quit) = (&done, quit);
            scope.spawn(move || {
                while !done.load(Ordering::Relaxed) {
                    if interrupts.recv_timeout(Duration::from_millis(50)).is_ok() {
                        quit.store(true, Ordering::Relaxed);
                    }
                }
            });
            let test = wakeup::measure(request, Duration::from_secs(1) / rate_hz, duration, quit);
            done.store(true, Ordering::Relaxed);
            return test;
        }
        wakeup::measure(request, Duration::from_secs(1) / rate_hz, duration, quit)
    })
}

/// Findings about arms: those attached, and the one that a scene names.
fn device_findings(config: Option<&SceneConfig>, root: &Root) -> Vec<Finding> {
    let mut findings = vec![discover::udev(root), discover::modem_manager(root)];
    let profile = config.map(|config| &config.device.profile);
    let attached = discover::attached(nodes::list(), &discover::known_arms(), root, discover::may_use);
    let mut found_wanted = false;
    for node in &attached {
        let is_wanted = profile.is_some_and(|profile| node.profiles.contains(&profile.name));
        found_wanted |= is_wanted;
        let is_arm = !node.profiles.is_empty() || !node.beside.is_empty();
        if is_wanted || profile.is_none() && is_arm {
            findings.extend(discover::findings(node, root));
        }
    }
    findings.extend(profile.and_then(|profile| discover::scene_arm(profile, found_wanted)));
    if profile.is_none() && !attached.iter().any(|node| !node.profiles.is_empty()) {
        let seen = attached.len();
        findings
            .push(Finding::unknown("arm", format!("none attached that a profile knows; {seen} other nodes (`hapticd devices`)")));
    }
    findings
}

fn lateness(test: &WakeupTest, rate_hz: u32) -> Finding {
    let period_us = 1e6 / f64::from(rate_hz);
    let found = format!(
        "p50 {:.0} µs, p99 {:.0} µs, p99.9 {:.0} µs, largest {:.0} µs; {} of {} ticks missed at {rate_hz} Hz",
        test.quantile_us(0.5),
        test.quantile_us(0.99),
        test.quantile_us(0.999),
        test.max_us(),
        test.missed,
        test.wakeups + test.missed
    );
    let share = test.missed as f64 / (test.wakeups + test.missed).max(1) as f64;
    let advice = "close what keeps the processors busy (`top`), follow the advice above, then: hapticd doctor";
    if share > MISSED_SHARE || test.quantile_us(0.99) > 0.5 * period_us {
        Finding::bad("wake-up", found, advice)
    } else if test.missed > 0 || test.max_us() > 0.5 * period_us {
        Finding::advice("wake-up", found, advice)
    } else {
        Finding::good("wake-up", found)
    }
}

fn verdict(devices: &[Finding], rights: &[Finding]) -> Exit {
    let is_bad = |findings: &[Finding]| findings.iter().any(|finding| finding.standing == Standing::Bad);
    match (is_bad(devices), is_bad(rights)) {
        (true, _) => Exit::Device,
        (false, true) => Exit::RealtimeRefused,
        (false, false) => Exit::Ok,
    }
}

fn verdict_text(exit: Exit) -> &'static str {
    match exit {
        Exit::Ok => "good",
        Exit::Device => "an arm cannot be used as it is: see `bad` under arms",
        _ => "this machine does not keep 1 ms as it is: see `bad` under loop",
    }
}

fn print_text(groups: &[(&str, &[Finding])], test: &WakeupTest, exit: Exit) {
    for (title, findings) in groups {
        say::result(format_args!("{title}\n"));
        for finding in *findings {
            say::result(format_args!("  {:<8} {:<20} {}\n", finding.standing.name(), finding.name, finding.found));
            let mut lead = "type:";
            for line in finding.advice.lines() {
                say::result(format_args!("  {:<8} {:<20} {lead} {line}\n", "", ""));
                lead = "     ";
            }
        }
    }
    say::result(format_args!("late wake-ups\n"));
    let bins = test.bins(&BOUNDS_US);
    let most = bins.iter().copied().max().unwrap_or(1).max(1);
    for (idx, count) in bins.iter().enumerate() {
        let label = match BOUNDS_US.get(idx) {
            Some(bound) => format!("up to {bound} µs"),
            None => "later".to_owned(),
        };
        let bar = "#".repeat((count * 40).div_ceil(most) as usize);
        say::result(format_args!("  {label:<16} {count:>8}  {bar}\n"));
    }
    say::result(format_args!("verdict: {} (exit {})\n", verdict_text(exit), exit as u8));
}

fn print_json(groups: &[&[Finding]], test: &WakeupTest, exit: Exit) {
    let findings: Vec<_> = groups.iter().flat_map(|findings| findings.iter()).map(finding_json).collect();
    let bins: Vec<_> = test
        .bins(&BOUNDS_US)
        .iter()
        .enumerate()
        .map(|(idx, count)| json!({ "up_to_us": BOUNDS_US.get(idx), "wakeups": count }))
        .collect();
    let object = json!({
        "verdict": match exit { Exit::Ok => "good", Exit::Device => "device", _ => "realtime" },
        "exit_code": exit as u8,
        "findings": findings,
        "wakeup_us": {
            "p50": test.quantile_us(0.5), "p99": test.quantile_us(0.99), "p999": test.quantile_us(0.999), "max": test.max_us(),
        },
        "wakeups": test.wakeups,
        "missed": test.missed,
        "histogram": bins,
    });
    say::result(format_args!("{object}\n"));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_verdict_is_that_of_the_worst_that_counts() {
        let good = [Finding::good("a", "b"), Finding::advice("a", "b", "c")];
        let bad = [Finding::bad("a", "b", "c")];
        assert_eq!(verdict(&good, &good), Exit::Ok);
        assert_eq!(verdict(&good, &bad), Exit::RealtimeRefused);
        assert_eq!(verdict(&bad, &bad), Exit::Device);
    }
}
