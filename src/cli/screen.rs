//! stderr of `run`: what stays, and one line that is written over.

use std::io::IsTerminal as _;

use super::{Talk, live, say};
use crate::daemon::Notice;
use crate::device::open::LinkNews;
use crate::haptics::Faults;
use crate::rt::preflight::{self, Report};
use crate::telemetry::TickRecord;

/// stderr while a run goes on: lines that stay, and on a terminal one status line that is written over.
pub(super) struct Screen<'a> {
    under_way: &'a live::UnderWay,
    quiet: bool,
    live: bool,
    /// A status line is on the screen now.
    status_on: bool,
}

impl<'a> Screen<'a> {
    pub(super) fn new(talk: Talk, under_way: &'a live::UnderWay) -> Self {
        Self { under_way, quiet: talk.quiet, live: !talk.quiet && std::io::stderr().is_terminal(), status_on: false }
    }

    pub(super) fn show(&mut self, notice: &Notice<'_>) {
        match notice {
            Notice::Phase(phase) => {
                if !self.quiet {
                    self.line(&format!("state: {}", phase.name()));
                }
            }
            Notice::Preflight(report) => {
                if !self.quiet {
                    for row in report_lines(report, false) {
                        self.line(&row);
                    }
                }
            }
            Notice::Scene(record) => {
                if !self.quiet {
                    let (path, at_s) = (self.under_way.scene(record.scene_idx), record.time_ns as f64 * 1e-9);
                    self.line(&format!("scene: {} from {at_s:.3} s on (tick {})", path.display(), record.tick));
                }
            }
            Notice::Link(news) => {
                self.line(&match news {
                    LinkNews::Lost => "device: gone; looking for it".to_owned(),
                    LinkNews::Back { node, homing } => {
                        let homing = homing.as_ref().map_or(String::new(), |text| {
                            format!(" It counts from where it was switched on, and a wrong place turns the force. {text}")
                        });
                        format!("device: back at {}; it waits for `enable`.{homing}", node.display())
                    }
                    LinkNews::Fails(why) => format!("device: {why}"),
                });
            }
            Notice::Waiting(cause) => {
                if !self.quiet {
                    self.line(&format!("no force: {} ({})", cause.name(), cause.advice()));
                }
            }
            Notice::Fault(record) => {
                for line in fault_lines(record) {
                    self.line(&line);
                }
            }
            Notice::Status(record) => {
                if self.live {
                    // Cut at the edge of the terminal: a line that wraps could not be written over.
                    say::talk(format_args!("\r\x1b[2K\x1b[?7l{}\x1b[?7h", status_text(record)));
                    self.status_on = true;
                }
            }
        }
    }

    fn line(&mut self, text: &str) {
        self.clear_status();
        say::talk(format_args!("{text}\n"));
    }

    fn clear_status(&mut self) {
        if self.status_on {
            say::talk(format_args!("\r\x1b[2K"));
            self.status_on = false;
        }
    }
}

/// Checks of the machine, one line each, with what would help.
pub(super) fn report_lines(report: &Report, failed_only: bool) -> Vec<String> {
    let mut lines = Vec::new();
    for row in &report.rows {
        let mark = match row.outcome {
            preflight::Outcome::Passed => "ok",
            preflight::Outcome::Failed => "FAILED",
            preflight::Outcome::Unknown => "unknown",
        };
        if failed_only && row.outcome != preflight::Outcome::Failed {
            continue;
        }
        lines.push(format!("preflight: {:<12} {mark:<7} {}", row.name, row.found));
        if !row.hint.is_empty() {
            lines.push(format!("           {:<12} hint: {}", "", row.hint));
        }
    }
    lines
}

fn fault_lines(record: &TickRecord) -> impl Iterator<Item = String> {
    let (faults, tick, time_s) = (record.output.faults, record.tick, record.time_ns as f64 * 1e-9);
    Faults::TABLE
        .into_iter()
        .filter(move |(fault, ..)| faults.contains(*fault))
        .map(move |(_, name, text)| format!("fault: {name} at {time_s:.3} s (tick {tick}): {text}"))
}

fn status_text(record: &TickRecord) -> String {
    let output = &record.output;
    format!(
        "tick {:>8}  force {:6.2} N  torque {:6.3} N·m  depth {:6.3} mm  contacts {:>5}  late {:>6.1} µs",
        record.tick,
        output.command_device.force.length(),
        output.command_device.torque.length(),
        output.max_depth_m * 1e3,
        output.contacts,
        record.wakeup_ns as f64 * 1e-3,
    )
}
