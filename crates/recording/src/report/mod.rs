//! The page that a lab keeps with its notes: what a recording shows, in one HTML file that needs
//! nothing else.
//!
//! Data in: the entries of a recording, one after another. Data out: the text of the page. It holds
//! no script, loads nothing and prints on two pages. The picture of its scene is drawn elsewhere
//! and given to it: this crate knows no meshes.
//!
//! | file | owns |
//! |---|---|
//! | `trace` | values over time, as envelopes of bounded size |
//! | `bins` | forces over depth and over the path of the tool, the same |
//! | `moments` | when what was largest and where; the path of the tool, for a picture |
//! | [`plots`] | SVG |
//! | `page` | HTML |

mod bins;
mod key_frames;
mod page;
pub mod plots;
mod trace;

use std::collections::BTreeMap;
use std::time::SystemTime;

use serde_json::Value;

use super::file::{Entry, LONGEST_TEXT};
use super::{LoopCounts, RealtimeSummary, Summary, TickRecord, Totals};
use bins::Bins;
use haptics::Faults;
use key_frames::KeyFrames;
use trace::Trace;

pub use key_frames::{KeyFrame, PathPose};

/// A page in the making.
#[derive(Debug)]
pub struct LabReport {
    /// Path of the file.
    file: String,
    run: BTreeMap<String, String>,
    /// By number: manifest, and what the scene came to.
    scenes: BTreeMap<u32, SceneFacts>,
    summary: Summary,
    faults: Vec<FaultSpan>,
    trace: Trace,
    moments: KeyFrames,
    over_depth: Bins,
    over_path: Bins,
    picture: Option<Result<Vec<u8>, String>>,
    end_picture: Option<Vec<u8>>,
    /// What the wall clock showed at the first tick.
    first_tick_at: Option<SystemTime>,
    first: Option<TickRecord>,
    last: Option<TickRecord>,
    missing_ticks: u64,
    dropped: u64,
    is_cut_off: bool,
}

#[derive(Debug, Default)]
struct SceneFacts {
    manifest: BTreeMap<String, String>,
    resolved: Value,
    first_time_s: Option<f64>,
}

/// A time in which faults were active.
#[derive(Debug)]
struct FaultSpan {
    tick: u64,
    time_s: f64,
    faults: Faults,
    cause: &'static str,
}

impl LabReport {
    /// Of a recording at this path.
    pub fn new(file: String) -> Self {
        Self {
            file,
            run: BTreeMap::new(),
            scenes: BTreeMap::new(),
            summary: Summary::new(),
            faults: Vec::new(),
            trace: Trace::default(),
            moments: KeyFrames::default(),
            // Widths at first: a micrometre and a hundredth of a millimetre.
            over_depth: Bins::new(1e-3),
            over_path: Bins::new(1e-2),
            picture: None,
            end_picture: None,
            first_tick_at: None,
            first: None,
            last: None,
            missing_ticks: 0,
            dropped: 0,
            is_cut_off: false,
        }
    }

    /// After the last entry: the file has no end.
    pub fn cut_off(&mut self) {
        self.is_cut_off = true;
    }

    /// Takes the next entry.
    pub fn take(&mut self, entry: &Entry) {
        match entry {
            Entry::Metadata { name, values } if name == "run" => self.run.clone_from(values),
            // Only this counts what was dropped after the last tick.
            Entry::Metadata { name, values } if name == "end" => {
                let dropped = values.get("dropped").and_then(|dropped| dropped.parse().ok());
                self.dropped = dropped.map_or(self.dropped, |dropped| self.dropped.max(dropped));
            }
            Entry::Metadata { name, values } => {
                if let Some(scene_idx) =
                    name.strip_prefix("scenes/").and_then(|idx| idx.parse().ok())
                {
                    self.scenes.entry(scene_idx).or_default().manifest.clone_from(values);
                }
            }
            Entry::Attachment { name, data } => {
                let scene = name
                    .strip_prefix("scenes/")
                    .and_then(|name| name.strip_suffix("/resolved.json"));
                if let Some(scene_idx) = scene.and_then(|idx| idx.parse().ok())
                    && data.len() <= LONGEST_TEXT
                {
                    self.scenes.entry(scene_idx).or_default().resolved =
                        serde_json::from_slice(data).unwrap_or_default();
                }
            }
            Entry::Tick { record, dropped } => self.record(record, *dropped),
        }
    }

    /// Ticks so far.
    pub fn ticks(&self) -> u64 {
        self.summary.ticks()
    }

    /// What the wall clock showed at the first tick, where it is known.
    pub fn begun_at(&mut self, first_tick_at: SystemTime) {
        self.first_tick_at = Some(first_tick_at);
    }

    fn record(&mut self, of_run: &TickRecord, dropped: u64) {
        let first = *self.first.get_or_insert(*of_run);
        // A recording may begin in the middle of a run: its page counts from the recording's first
        // tick.
        let record =
            &TickRecord { time_ns: of_run.time_ns.saturating_sub(first.time_ns), ..*of_run };
        let time_s = record.time_ns as f64 * 1e-9;
        if let Some(last) = &self.last {
            self.missing_ticks += record.tick.saturating_sub(last.tick.saturating_add(1));
        }
        let faults = record.output.faults;
        if !faults.is_empty() && self.last.is_none_or(|last| last.output.faults != faults) {
            let cause = record.output.off_cause.name();
            self.faults.push(FaultSpan { tick: record.tick, time_s, faults, cause });
        }
        self.scenes.entry(record.scene_idx).or_default().first_time_s.get_or_insert(time_s);
        self.summary.add(record);
        self.trace.add(record);
        self.moments.add(record);
        let output = &record.output;
        let forces = [output.contact_world.force.length(), output.command_device.force.length()];
        if output.contacts > 0 {
            self.over_depth.add(output.max_depth_m * 1e3, forces);
        }
        self.over_path.add(self.moments.arc_m * 1e3, forces);
        self.dropped = dropped;
        self.last = Some(*record);
    }

    /// What a picture is to show: the moment in which the tool was deepest; the last one if it
    /// touched nothing. `None`: there is no tick.
    pub fn moment(&self) -> Option<&KeyFrame> {
        self.moments.shown.as_ref()
    }

    /// How it ended, where that is another pose than that of [`Self::moment`].
    pub fn end(&self) -> Option<KeyFrame> {
        self.moments.end()
    }

    /// The path of the tool through a scene, at most 2000 poses in the order of time.
    pub fn path(&self, scene_idx: u32) -> &[PathPose] {
        self.moments.path(scene_idx)
    }

    /// Puts a picture of [`Self::moment`] at the top of the page, a PNG file; or why there is none.
    pub fn put_picture(&mut self, picture: Result<Vec<u8>, String>) {
        self.picture = Some(picture);
    }

    /// Puts a picture of [`Self::end`] beside it.
    pub fn put_end_picture(&mut self, png: Vec<u8>) {
        self.end_picture = Some(png);
    }

    /// The finished page: HTML that loads nothing.
    pub fn page(&self) -> String {
        page::page(self)
    }

    /// Period of a tick, s.
    fn period_s(&self) -> f64 {
        let rate_hz: f64 =
            self.run.get("rate_hz").and_then(|rate_hz| rate_hz.parse().ok()).unwrap_or(1000.0);
        rate_hz.recip()
    }

    /// The run followed the machine's clock.
    fn keeps_time(&self) -> bool {
        self.run.get("clock").is_none_or(|clock| clock != "virtual")
    }

    fn totals(&self) -> Totals {
        self.summary.totals(LoopCounts {
            ticks: self.summary.ticks(),
            rate_hz: (1.0 / self.period_s()).round() as u32,
            clock: if self.keeps_time() { "real" } else { "virtual" },
            missed_deadlines: 0,
            dropped_records: self.dropped,
            contact_budget_points: self.last.and_then(|record| record.contact_budget_points),
            faults: Faults::NONE,
            realtime: RealtimeSummary::default(),
        })
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use glam::DVec3;

    use super::*;
    use haptics::{TickInput, TickOutput};
    use vps::spatial::{Pose, Wrench};

    fn tick(tick: u64, faults: Faults) -> Entry {
        let output = TickOutput {
            command_device: Wrench::new(DVec3::Z * (tick as f64 * 0.01), DVec3::ZERO),
            max_depth_m: 1e-4,
            faults,
            ..TickOutput::default()
        };
        let record = TickRecord {
            tick,
            time_ns: tick as i64 * 1_000_000,
            compute_ns: 7000,
            output,
            ..TickRecord::default()
        };
        Entry::Tick { record: Box::new(record), dropped: 0 }
    }

    #[test]
    fn a_page_stands_alone_and_says_what_happened() {
        let mut report = LabReport::new("<b>.mcap".to_owned());
        let begun = [("begun".to_owned(), "2026-01-31T12:34:56.789Z".to_owned())].into();
        report.take(&Entry::Metadata { name: "run".to_owned(), values: begun });
        let values = [("name".to_owned(), "peg & hole <script>".to_owned())].into();
        report.take(&Entry::Metadata { name: "scenes/0".to_owned(), values });
        let resolved =
            br#"{"statics": [{"name": "plate"}], "parameters": {"limits": {"force_n": 8.0}}}"#
                .to_vec();
        report
            .take(&Entry::Attachment { name: "scenes/0/resolved.json".to_owned(), data: resolved });
        (0..500).for_each(|n| report.take(&tick(n, Faults::NONE)));
        (510..520).for_each(|n| report.take(&tick(n, Faults::STALE)));
        let page = report.page();
        for fragment in [
            "peg &amp; hole &lt;script&gt;",
            "&lt;b&gt;.mcap · begun 2026-01-31T12:34:56.789Z",
            "stale",
            "no new sample for too long",
            "plate",
            "10 ticks are missing",
        ] {
            assert!(page.contains(fragment), "{fragment}\n{page}");
        }
        for loads in ["<script", "http://", "https://", "src=", "url(", "@import", "NaN"] {
            assert!(!page.replace("http://www.w3.org/2000/svg", "").contains(loads), "{loads}");
        }
        assert_eq!(page.matches("<svg").count(), page.matches("</svg>").count());
    }

    #[test]
    fn a_page_begins_with_the_picture_and_the_verdict_and_ends_with_the_keys_folded() {
        let mut report = LabReport::new("f.mcap".to_owned());
        let resolved = br#"{"parameters": {"limits": {"force_n": 8.0}}}"#.to_vec();
        report
            .take(&Entry::Attachment { name: "scenes/0/resolved.json".to_owned(), data: resolved });
        // Down by a micrometre a tick, into a plate after half of the ticks: 2 N/mm of contact,
        // half of it commanded.
        for n in 0..1000_u64 {
            let depth_m = n.saturating_sub(500) as f64 * 1e-6;
            let force = DVec3::Z * (2e3 * depth_m);
            let output = TickOutput {
                contact_world: Wrench::new(force, DVec3::X * (0.01 * force.z)),
                command_device: Wrench::new(0.5 * force, DVec3::ZERO),
                world_from_tool: Pose::from_translation(DVec3::Z * (n as f64 * -1e-6)),
                contacts: u32::from(depth_m > 0.0),
                max_depth_m: depth_m,
                ..TickOutput::default()
            };
            let input = TickInput { overrun: n == 7, ..TickInput::default() };
            let record = TickRecord {
                tick: n,
                time_ns: n as i64 * 1_000_000,
                input,
                output,
                ..TickRecord::default()
            };
            report.take(&Entry::Tick { record: Box::new(record), dropped: 0 });
        }
        assert!(!report.page().contains("<img"));
        report.put_picture(Ok(vec![1, 2, 3]));
        let page = report.page();
        let after =
            |fragment: &str| page.find(fragment).unwrap_or_else(|| panic!("{fragment}\n{page}"));
        let order = [
            "src=\"data:image/png;base64,AQID\"",
            "at its deepest contact (0.499 mm), 0.999 s",
            "<strong>The tool touched something</strong>, first at 0.501 s, and for 499 of 1000 \
                ticks; at most 0.499 mm deep.",
            "<strong>no fault</strong>",
            "<strong>1 tick was late</strong>",
            "contact force</th><td>0.998 N</td><td>0.999 s</td><td>0, 0, \u{2212}0.999 mm",
            "commanded force</th><td>0.499 N",
            "contact torque</th><td>9.98 mN·m",
            "commanded torque</th><td>0 mN·m</td><td>–",
            "Force over depth, N",
            "Force over the path of the tool, N",
            "Contact force, N",
            "Commanded torque, mN·m",
            "<details>",
            "limits.force_n",
        ];
        assert!(order.map(after).is_sorted(), "{:?}", order.map(after));
        assert_eq!(page.matches("src=").count(), 1);
        assert_eq!(page.matches("<details>").count(), page.matches("</details>").count());
        report.put_picture(Err("`a<b.obj` is <gone>".to_owned()));
        assert!(
            report
                .page()
                .contains("There is no picture of the scene: `a&lt;b.obj` is &lt;gone&gt;.")
        );
    }

    #[test]
    fn a_recording_that_begins_in_a_run_counts_from_its_own_first_tick() {
        let page_of = |first: u64| {
            let mut report = LabReport::new("f.mcap".to_owned());
            let begun = [("begun".to_owned(), "2026-01-31T12:00:00.000Z".to_owned())].into();
            report.take(&Entry::Metadata { name: "run".to_owned(), values: begun });
            report.begun_at(SystemTime::UNIX_EPOCH + Duration::from_secs(1));
            (first..first + 500).for_each(|n| {
                report.take(&tick(n, if n == first + 7 { Faults::STALE } else { Faults::NONE }))
            });
            report.page()
        };
        let whole = page_of(0);
        let later = page_of(170_000);
        assert!(
            whole.contains(" · begun 2026-01-31T12:00:00.000Z</p>")
                && !whole.contains("recording begun"),
            "{whole}"
        );
        let begun = " · recording begun 1970-01-01T00:00:01.000Z, 170.000 s after the first tick of the run · run begun 2026-01-31T12:00:00.000Z</p>";
        for fragment in [
            begun,
            "<td>0.007 s</td><td>170007</td>",
            "<td>0.499 s</td>",
            "is 0.500 s long",
            "with tick 170000, 170.000 s after",
        ] {
            assert!(later.contains(fragment), "{fragment}\n{later}");
        }
        let over_time = |page: &str| {
            page[page.find("Over time").expect("curves")..page.find("Counts").expect("counts")]
                .to_owned()
        };
        // The forces differ, and their time axes do not.
        let depth = |page: &str| {
            over_time(page)[over_time(page).find("Depth, mm").expect("a plot")..].to_owned()
        };
        assert_eq!(depth(&whole), depth(&later));
    }

    #[test]
    fn two_pictures_stand_beside_each_other_where_the_end_is_another_pose() {
        let mut report = LabReport::new("f.mcap".to_owned());
        for n in 0..3_u64 {
            let output = TickOutput {
                world_from_tool: Pose::from_translation(DVec3::X * (n as f64 * 1e-3)),
                contacts: u32::from(n > 0),
                max_depth_m: [0.0, 3e-5, 1e-5][n as usize],
                depth_is_bound: n == 1,
                ..TickOutput::default()
            };
            report.take(&Entry::Tick {
                record: Box::new(TickRecord {
                    tick: n,
                    time_ns: n as i64 * 1_000_000,
                    output,
                    ..TickRecord::default()
                }),
                dropped: 0,
            });
        }
        let end = report.end().expect("another pose");
        assert_eq!(
            (end.time_s, end.world_from_tool.translation.x, end.depth_m),
            (2e-3, 2e-3, 1e-5)
        );
        report.put_picture(Ok(vec![1]));
        assert_eq!(report.page().matches("<img").count(), 1);
        report.put_end_picture(vec![2]);
        let page = report.page();
        for fragment in [
            "The tool at its deepest contact (at least 0.03 mm), 0.001 s, and the path",
            "The tool at the end, 0.002 s, 0.01 mm deep.",
        ] {
            assert!(page.contains(fragment), "{fragment}\n{page}");
        }
        assert_eq!(page.matches("<img").count(), 2);
    }

    #[test]
    fn a_page_says_what_the_recording_lacks() {
        let mut report = LabReport::new("f.mcap".to_owned());
        (0..500).for_each(|n| report.take(&tick(n, Faults::NONE)));
        assert!(!report.page().contains("class=\"warning\""));
        let values =
            [("records".to_owned(), "500".to_owned()), ("dropped".to_owned(), "23".to_owned())]
                .into();
        report.take(&Entry::Metadata { name: "end".to_owned(), values });
        assert!(report.page().contains("23 ticks were dropped"));
        report.cut_off();
        assert!(report.page().contains("has no end"));
    }

    #[test]
    fn nothing_and_nonsense_make_a_page_too() {
        let mut report = LabReport::new("f.mcap".to_owned());
        assert!(report.page().contains("no tick"));
        let mut entry = tick(0, Faults::NONE);
        if let Entry::Tick { record, .. } = &mut entry {
            record.output.command_device.force.x = f64::NAN;
            record.output.clearance_m = f64::INFINITY;
        }
        report.take(&entry);
        let page = report.page();
        assert!(!page.contains("NaN") && !page.contains("inf "), "{page}");
    }
}
