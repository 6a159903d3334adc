//! One line for each figure, for people and for programs.

use core::fmt::Write as _;
use std::path::Path;
use std::process::{Command, Stdio};

use serde::{Serialize, Serializer};

/// What `bench` found, as `bench --json` prints it.
#[derive(Debug, Serialize)]
pub struct BenchReport {
    /// Where it ran.
    pub machine: MachineInfo,
    /// Commit of the checkout that the program stands in, with `-dirty` when files differ from it.
    /// `None`, outside of one, is written as a word.
    #[serde(serialize_with = "commit_or_word")]
    pub commit: Option<String>,
    /// One for each line of the printed tables.
    pub rows: Vec<Row>,
}

/// The machine, as /proc reports it.
#[derive(Debug, Serialize)]
pub struct MachineInfo {
    /// Model of the processor.
    pub cpu: Option<String>,
    /// Processors that this process may use.
    pub cores: usize,
    /// Release of the kernel.
    pub kernel: Option<String>,
    /// Memory of the machine, GiB.
    pub memory_gib: Option<f64>,
}

/// One figure beside what it is compared with.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Row {
    /// Case that it belongs to: one printed table each.
    pub group: String,
    /// What was measured; says why where it was not.
    pub name: String,
    /// The median of the runs.
    pub value: Option<f64>,
    /// Unit of `value`, `paper` and `peer_value`.
    pub unit: &'static str,
    /// What is asked of `value` or of `ratio`.
    pub target: Option<String>,
    /// Whether it is so; `None` where there is no target or nothing was measured.
    pub met: Option<bool>,
    /// The paper's figure.
    pub paper: Option<f64>,
    /// The program measured in the same run; says why where it was not.
    pub peer: Option<String>,
    /// Its figure.
    pub peer_value: Option<f64>,
    /// `paper / value` or `peer_value / value`: how many times faster, or smaller.
    pub ratio: Option<f64>,
}

impl Row {
    /// A figure of our own.
    pub fn new(
        group: &str,
        name: impl Into<String>,
        value: impl Into<Option<f64>>,
        unit: &'static str,
    ) -> Self {
        Self {
            group: group.to_owned(),
            name: name.into(),
            value: value.into(),
            unit,
            ..Self::default()
        }
    }

    /// Beside the paper's.
    #[must_use]
    pub fn beside_paper(mut self, paper: f64) -> Self {
        self.paper = Some(paper);
        self.ratio = self.value.map(|value| paper / value);
        self
    }

    /// Beside a peer's, or the reason why there is none.
    #[must_use]
    pub fn beside_peer(mut self, peer: &str, figure: &Result<f64, String>) -> Self {
        match figure {
            Ok(peer_value) => {
                self.peer = Some(peer.to_owned());
                self.peer_value = Some(*peer_value);
                self.ratio = self.value.map(|value| peer_value / value);
            }
            Err(why) => self.peer = Some(format!("{peer} (skipped: {why})")),
        }
        self
    }

    /// Asks for a ratio.
    #[must_use]
    pub fn at_least_times(mut self, least: f64) -> Self {
        self.target = Some(format!("ratio >= {least}"));
        self.met = self.ratio.map(|ratio| ratio >= least);
        self
    }

    /// Asks for a value.
    #[must_use]
    pub fn at_least(mut self, least: f64) -> Self {
        self.target = Some(format!("value >= {}", figure(least)));
        self.met = self.value.map(|value| value >= least);
        self
    }

    /// Asks for a value.
    #[must_use]
    pub fn at_most(mut self, most: f64) -> Self {
        self.target = Some(format!("value <= {}", figure(most)));
        self.met = self.value.map(|value| value <= most);
        self
    }
    /// Asks for a value that is no farther from zero.
    #[must_use]
    pub fn within(mut self, most: f64) -> Self {
        self.target = Some(format!("value within ±{}", figure(most)));
        self.met = self.value.map(|value| value.abs() <= most);
        self
    }
}

impl MachineInfo {
    /// Reads /proc; what it does not say is `None`.
    pub fn read() -> Self {
        let field = |file: &str, name: &str| {
            let text = std::fs::read_to_string(file).ok()?;
            let line = text.lines().find(|line| line.starts_with(name))?;
            Some(line.split_once(':')?.1.trim().to_owned())
        };
        let memory_kib = field("/proc/meminfo", "MemTotal")
            .and_then(|text| text.split(' ').next()?.parse::<f64>().ok());
        Self {
            cpu: field("/proc/cpuinfo", "model name"),
            cores: std::thread::available_parallelism().map_or(1, usize::from),
            kernel: std::fs::read_to_string("/proc/sys/kernel/osrelease")
                .ok()
                .map(|text| text.trim().to_owned()),
            memory_gib: memory_kib.map(|kib| (kib / 1024.0 / 1024.0 * 10.0).round() / 10.0),
        }
    }

    /// One line about the machine and the commit that was measured.
    pub fn facts(&self, commit: Option<&str>) -> String {
        let Self { cpu, cores, kernel, memory_gib } = self;
        let said = |text: Option<&str>| text.unwrap_or("unknown").to_owned();
        let memory = memory_gib.map_or_else(|| "unknown".to_owned(), |gib| format!("{gib} GiB"));
        let cpu = said(cpu.as_deref());
        let kernel = said(kernel.as_deref());
        let commit = said(commit);
        format!("cpu {cpu}, cores {cores}, memory {memory}, kernel {kernel}, commit {commit}")
    }
}

/// The commit of the checkout that `program` stands in; `None` outside one, or without git.
pub fn commit_of(program: &Path) -> Option<String> {
    let mut git = Command::new("git");
    git.arg("-C").arg(program.parent()?).args([
        "describe",
        "--always",
        "--dirty",
        "--abbrev=12",
        "--exclude=*",
    ]);
    let said = git.stderr(Stdio::null()).output().ok().filter(|said| said.status.success())?;
    Some(String::from_utf8(said.stdout).ok()?.trim().to_owned()).filter(|commit| !commit.is_empty())
}

#[expect(clippy::ref_option, reason = "the signature that serde asks for")]
fn commit_or_word<S: Serializer>(
    commit: &Option<String>,
    serializer: S,
) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(commit.as_deref().unwrap_or("unknown: not in a git checkout"))
}

impl BenchReport {
    /// The rows as markdown tables, one for each group, under the facts of the machine.
    pub fn markdown(&self) -> String {
        let mut text = self.machine.facts(self.commit.as_deref()) + "\n";
        let mut group = None;
        for row in &self.rows {
            if group != Some(&row.group) {
                group = Some(&row.group);
                let _ = write!(text, "\n## {}\n\n", row.group);
                text.push_str(
                    "| figure | value | unit | target | met | paper | peer | peer's \
                    value | ratio |\n",
                );
                text.push_str("|---|---:|---|---|---|---:|---|---:|---:|\n");
            }
            let number = |value: Option<f64>| value.map(figure).unwrap_or_default();
            let met = row.met.map_or("", |met| if met { "yes" } else { "**no**" });
            let _ = writeln!(
                text,
                "| {} | {} | {} | {} | {met} | {} | {} | {} | {} |",
                row.name,
                number(row.value),
                row.unit,
                row.target.as_deref().unwrap_or_default(),
                number(row.paper),
                row.peer.as_deref().unwrap_or_default().replace('|', "/"),
                number(row.peer_value),
                number(row.ratio)
            );
        }
        self.targets(&mut text);
        text
    }

    /// What was asked, in one table: every row with a target that could be judged.
    fn targets(&self, text: &mut String) {
        let judged: Vec<(&Row, bool)> =
            self.rows.iter().filter_map(|row| Some((row, row.met?))).collect();
        if judged.is_empty() {
            return;
        }
        let n_met = judged.iter().filter(|(_, met)| *met).count();
        let _ = write!(text, "\n## targets: {n_met} of {} met\n\n", judged.len());
        text.push_str(
            "| case | figure | target | ours | beside | its figure | ratio | met \
                |\n|---|---|---|---:|---|---:|---:|---|\n",
        );
        for (row, met) in judged {
            let number = |value: Option<f64>| value.map(figure).unwrap_or_default();
            let _ = writeln!(
                text,
                "| {} | {} | {} | {} {} | {} | {} | {} | {} |",
                row.group,
                row.name,
                row.target.as_deref().unwrap_or_default(),
                number(row.value),
                row.unit,
                row.peer.as_deref().or(row.paper.map(|_| "the paper")).unwrap_or_default(),
                number(row.peer_value.or(row.paper)),
                number(row.ratio),
                if met { "yes" } else { "**no**" },
            );
        }
    }
}

/// Four significant digits, counts in full.
pub(super) fn figure(value: f64) -> String {
    if value.fract() == 0.0 && value.abs() < 1e15 {
        return format!("{value:.0}");
    }
    let decimals = (3.0 - value.abs().log10().floor()).clamp(0.0, 6.0) as usize;
    format!("{value:.decimals$}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ratios_and_targets_follow_the_values() {
        let row = Row::new("a", "generate", 0.5, "s").beside_paper(60.0).at_least_times(100.0);
        assert_eq!((row.ratio, row.met), (Some(120.0), Some(true)));
        let row =
            Row::new("a", "surface", 2.0, "s").beside_peer("other", &Ok(10.0)).at_least_times(10.0);
        assert_eq!((row.ratio, row.met), (Some(5.0), Some(false)));
        let row = Row::new("a", "surface", 2.0, "s")
            .beside_peer("other", &Err("not there".into()))
            .at_least_times(10.0);
        assert_eq!(
            (row.peer.as_deref(), row.peer_value, row.met),
            (Some("other (skipped: not there)"), None, None)
        );
        assert_eq!(Row::new("a", "rate", None, "1/s").at_least(5.0).met, None);
        assert_eq!(Row::new("a", "rate", 4.0, "1/s").at_most(5.0).met, Some(true));
    }

    #[test]
    fn targets_come_again_in_one_table() {
        let rows = vec![
            Row::new("a", "fast", 4.0, "s").at_most(5.0),
            Row::new("b", "slow", 6.0, "s").at_most(5.0),
            Row::new("b", "not asked", 6.0, "s"),
            Row::new("b", "not measured", None, "s").at_most(5.0),
        ];
        let text = BenchReport { machine: MachineInfo::read(), commit: None, rows }.markdown();
        let (_, table) = text.split_once("## targets: 1 of 2 met").unwrap();
        assert_eq!(table.lines().filter(|line| line.contains("<= 5")).count(), 2);
        assert!(
            table.contains("| b | slow | value <= 5 | 6 s |  |  |  | **no** |")
                && !table.contains("not asked"),
            "{table}"
        );
    }

    #[test]
    fn numbers_are_short_and_counts_are_whole() {
        let cases = [
            (0.0, "0"),
            (237_717_488.0, "237717488"),
            (0.012_346, "0.01235"),
            (12.3456, "12.35"),
            (98_765.4, "98765"),
        ];
        for (value, text) in cases {
            assert_eq!(figure(value), text);
        }
    }

    #[test]
    fn the_tables_have_a_line_for_each_row() {
        let rows = vec![
            Row::new("a", "x", 1.0, "s"),
            Row::new("a", "y", None, "s"),
            Row::new("b", "z", 1.5, "s"),
        ];
        let text = BenchReport { machine: MachineInfo::read(), commit: None, rows }.markdown();
        assert_eq!(text.lines().filter(|line| line.starts_with("## ")).count(), 2);
        assert_eq!(
            text.lines()
                .filter(|line| line.starts_with("| x |") || line.starts_with("| y |"))
                .count(),
            2
        );
        let json = serde_json::to_value(BenchReport {
            machine: MachineInfo::read(),
            commit: None,
            rows: Vec::new(),
        })
        .unwrap();
        assert_eq!(json["commit"], "unknown: not in a git checkout");
        assert!(text.contains("| z | 1.500 | s |") && text.starts_with("cpu "), "{text}");
    }
}
