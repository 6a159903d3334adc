//! stderr of `run`: what stays, and one line that is written over.

use std::io::IsTerminal as _;
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use super::output::{self, Fields, Level};
use super::{OutputOptions, guard};
use crate::daemon::session::SessionHandle;
use arms::attached::open::LinkNews;
use arms::protocol::Protocol;
use engine::supervisor::{Notice, Phase};
use haptics::Faults;
use recording::TickRecord;
use rt::preflight::{self, PreflightReport};
use vps::storage::printable::shown;

/// How often `--log-format json -v` has the newest tick.
const STATUS_EVERY: Duration = Duration::from_secs(1);
/// A check of the machine that failed.
pub(super) const FAILED: &str = "FAILED";
/// The same for a simulated arm that may be late: no hand feels it.
const GOOD_ENOUGH: &str = "not real time; good enough to try:";

/// stderr while a run goes on: lines that stay, and on a terminal one status line that is written
/// over.
pub(super) struct StatusLine<'a> {
    session: &'a SessionHandle,
    /// Protocol of a real arm: it has texts for its errors.
    protocol: Option<&'a Protocol>,
    quiet: bool,
    live: bool,
    /// What stands at a check of the machine that failed.
    failed_mark: &'static str,
    /// A fault does not end the run.
    waits_after_fault: bool,
    /// A status line is on the screen now.
    status_on: bool,
    /// When the next status is due as an event; `None`: never.
    next_status: Option<Instant>,
}

impl<'a> StatusLine<'a> {
    pub(super) fn new(
        output: OutputOptions,
        session: &'a SessionHandle,
        protocol: Option<&'a Protocol>,
        may_be_late: bool,
        waits_after_fault: bool,
    ) -> Self {
        let failed_mark = if may_be_late { GOOD_ENOUGH } else { FAILED };
        let live = !output.quiet && !output::is_json() && std::io::stderr().is_terminal();
        let next_status = (output::is_json() && output.verbose > 0).then(Instant::now);
        Self {
            session,
            protocol,
            quiet: output.quiet,
            live,
            failed_mark,
            waits_after_fault,
            status_on: false,
            next_status,
        }
    }

    pub(super) fn show(&mut self, notice: &Notice<'_>) {
        match notice {
            Notice::Phase(phase) => {
                if !self.quiet {
                    let name = phase.name();
                    let waits = self.waits_after_fault && *phase == Phase::Fault;
                    let what_now = if waits {
                        "; no force until the next enable, Ctrl-C ends the run"
                    } else {
                        ""
                    };
                    self.line(
                        Level::Info,
                        "phase",
                        &format!("state: {name}{what_now}"),
                        &[("phase", name.into())],
                    );
                }
            }
            Notice::Preflight(report) => {
                if !self.quiet {
                    self.preflight(report);
                }
            }
            Notice::Scene(record) => {
                if !self.quiet {
                    let path = self
                        .session
                        .sent_file(record.scene_idx)
                        .unwrap_or_else(|| "another scene".into());
                    let at_s = record.time_ns as f64 * 1e-9;
                    let [tick, time] = at(record);
                    let text = format!(
                        "scene: {} from {at_s:.3} s on (tick {})",
                        shown(&path),
                        record.tick
                    );
                    self.line(
                        Level::Info,
                        "scene",
                        &text,
                        &[("file", path.to_string_lossy().into()), tick, time],
                    );
                }
            }
            Notice::Link(news) => {
                let (level, state, text) = link_line(news);
                self.line(level, "link", &text, &[("link", state.into())]);
            }
            Notice::Waiting(cause) => {
                if !self.quiet {
                    let name = cause.name();
                    let advice = cause.advice();
                    let fields = [("off_cause", name.into()), ("advice", advice.into())];
                    self.line(
                        Level::Warning,
                        "waiting",
                        &format!("no force: {name} ({advice})"),
                        &fields,
                    );
                }
            }
            Notice::Fault(record) => {
                for (name, text) in fault_words(record, self.protocol) {
                    let [tick, time] = at(record);
                    self.line(Level::Error, "fault", &text, &[("fault", name.into()), tick, time]);
                }
            }
            Notice::Status(record) => {
                if self.live {
                    output::write_over(&status_text(record));
                    self.status_on = true;
                }
                if self.next_status.is_some_and(|due| Instant::now() >= due) {
                    self.next_status = Some(Instant::now() + STATUS_EVERY);
                    self.line(Level::Debug, "status", &status_text(record), &status_fields(record));
                }
            }
        }
    }

    fn preflight(&mut self, report: &PreflightReport) {
        if !output::is_json() {
            report_lines(report, false, self.failed_mark)
                .iter()
                .for_each(|row| self.line(Level::Info, "preflight", row, &[]));
            return;
        }
        for row in &report.rows {
            let level = if row.outcome == preflight::CheckOutcome::Failed {
                Level::Warning
            } else {
                Level::Info
            };
            let fields = [
                ("check", Value::from(row.name)),
                ("outcome", row.outcome.name().into()),
                ("found", row.found.as_str().into()),
                ("hint", row.hint.into()),
            ];
            self.line(
                level,
                "preflight",
                &format!("preflight: {}: {}", row.name, row.found),
                &fields,
            );
        }
    }

    fn line(&mut self, level: Level, event: &str, text: &str, fields: Fields<'_>) {
        self.clear_status();
        output::event(level, event, text, fields);
    }

    fn clear_status(&mut self) {
        if self.status_on {
            output::write_over("");
            self.status_on = false;
        }
    }
}

/// What became of the link of an arm: how much it matters, its word, and the line that tells of it.
pub(super) fn link_line(news: &LinkNews) -> (Level, &'static str, String) {
    match news {
        LinkNews::Lost => (Level::Warning, "lost", "device: gone; looking for it".to_owned()),
        LinkNews::Back { node, homing } => {
            let homing = homing.as_ref().map_or(String::new(), |text| {
                format!(
                    " It counts from where it was switched on, and a wrong place turns the force. \
                        {text}"
                )
            });
            let node = node.display();
            (Level::Info, "back", format!("device: back at {node}; it waits for `enable`.{homing}"))
        }
        LinkNews::Fails(why) => (Level::Warning, "fails", format!("device: {why}")),
        LinkNews::Reported(text) => (Level::Warning, "told", format!("device: {text}")),
        LinkNews::Unguarded(why) => (Level::Warning, "unguarded", guard::missing_text(why)),
    }
}

/// When something happened.
fn at(record: &TickRecord) -> [(&'static str, Value); 2] {
    [("tick", record.tick.into()), ("loop_s", (record.time_ns as f64 / 1e9).into())]
}

/// Checks of the machine, one line each, with what would help.
pub(super) fn report_lines(
    report: &PreflightReport,
    failed_only: bool,
    failed_mark: &str,
) -> Vec<String> {
    let mut lines = Vec::new();
    for row in &report.rows {
        let mark = match row.outcome {
            preflight::CheckOutcome::Passed => "ok",
            preflight::CheckOutcome::Failed => failed_mark,
            preflight::CheckOutcome::Unknown => "unknown",
        };
        if failed_only && row.outcome != preflight::CheckOutcome::Failed {
            continue;
        }
        lines.push(format!("preflight: {:<12} {mark:<7} {}", row.name, row.found));
        if !row.hint.is_empty() {
            lines.push(format!("           {:<12} hint: {}", "", row.hint));
        }
    }
    lines
}

/// Names of the faults of a record, and the lines that tell of them.
fn fault_words(
    record: &TickRecord,
    protocol: Option<&Protocol>,
) -> impl Iterator<Item = (&'static str, String)> {
    let faults = record.output.faults;
    let tick = record.tick;
    let time_s = record.time_ns as f64 * 1e-9;
    let error = record.input.sample.device_error;
    Faults::TABLE.into_iter().filter(move |(fault, ..)| faults.contains(*fault)).map(
        move |(fault, name, text)| {
            let text = if fault == Faults::DEVICE_ERROR && error != 0 {
                error_text(error, protocol)
            } else {
                text.to_owned()
            };
            (name, format!("fault: {name} at {time_s:.3} s (tick {tick}): {text}"))
        },
    )
}

/// What an arm says is wrong with it, with the words of its protocol.
pub(super) fn error_text(error: u16, protocol: Option<&Protocol>) -> String {
    match protocol.and_then(|protocol| protocol.error_text(error)) {
        Some(words) => format!("the arm reports error {error}: {words}"),
        None => format!("the arm reports error {error}: see its manual"),
    }
}

fn status_text(record: &TickRecord) -> String {
    let output = &record.output;
    format!(
        "tick {:>8}  force {:6.2} N  torque {:6.3} N·m  depth {}{:6.3} mm  contacts {:>5}  late \
            {:>6.1} µs",
        record.tick,
        output.command_device.force.length(),
        output.command_device.torque.length(),
        if output.depth_is_bound { '≥' } else { ' ' },
        output.max_depth_m * 1e3,
        output.contacts,
        record.wakeup_ns as f64 * 1e-3,
    )
}

fn status_fields(record: &TickRecord) -> [(&'static str, Value); 8] {
    let output = &record.output;
    let [tick, time] = at(record);
    [
        tick,
        time,
        ("force_n", json!(output.command_device.force.length())),
        ("torque_nm", json!(output.command_device.torque.length())),
        ("depth_m", json!(output.max_depth_m)),
        ("depth_is_bound", output.depth_is_bound.into()),
        ("contacts", output.contacts.into()),
        ("wakeup_us", json!(record.wakeup_ns as f64 / 1e3)),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use arms::profile;
    use haptics::{TickInput, TickOutput};
    use vps::spatial::DeviceSample;

    #[test]
    fn an_error_of_the_arm_is_reported_with_its_number_and_its_words() {
        let line = |name: &str, device_error: u16| {
            let profile = profile::find(name, std::path::Path::new("")).expect(name);
            let record = TickRecord {
                input: TickInput {
                    sample: DeviceSample { device_error, ..DeviceSample::default() },
                    ..TickInput::default()
                },
                output: TickOutput { faults: Faults::DEVICE_ERROR, ..TickOutput::default() },
                ..TickRecord::default()
            };
            let lines = fault_words(&record, profile.real.as_ref().map(|real| &real.protocol))
                .map(|(_, line)| line);
            lines.collect::<Vec<_>>().join("\n")
        };
        let lead = "fault: device-error at 0.000 s (tick 0): the arm reports error";
        assert_eq!(line("open6-serial", 3), format!("{lead} 3: it is too hot"));
        assert_eq!(
            line("open6-serial", 0x100),
            format!("{lead} 256: its watchdog has tripped: it got no command in time")
        );
        assert_eq!(
            line("open6-hid", 200),
            format!("{lead} 200: its maker defines this number: see its manual")
        );
        assert!(
            line("leader-arm-6", 0x0380)
                .starts_with(&format!("{lead} 896: servo 3: hardware alert"))
        );
        assert_eq!(line("sim-sigma7", 7), format!("{lead} 7: see its manual"));
    }
}
