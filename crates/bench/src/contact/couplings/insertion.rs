//! The shipped peg, inserted with every coupling.

use super::super::super::{BenchError, Row};
use super::super::scenarios::RATE_HZ;
use super::super::scenes::{self, Played};
use super::{Bench, COUPLINGS, Tried, changes, commanded, coupled, ripple_over, windows};
use recording::TickRecord;

/// The shipped peg with one coupling.
pub(super) struct InsertionResult {
    pub(super) coupling: &'static str,
    pub(super) figures: Tried<InsertionFigures>,
}

pub(super) struct InsertionFigures {
    pub(super) depth_mm: f64,
    /// When the tip was half a millimetre above the floor first.
    pub(super) inserted_s: Option<f64>,
    pub(super) peak_n: f64,
    pub(super) ripple_n: Option<f64>,
    /// How often contact came or went in the last 0.9 s, with the hand at rest.
    pub(super) changes_at_rest: usize,
    pub(super) faults: String,
}

impl InsertionFigures {
    const NEARLY_DOWN_M: f64 = -0.0195;

    fn of(played: &Played) -> Self {
        let records = played.before_stop();
        let height = |record: &TickRecord| record.output.world_from_tool.translation.z;
        let rest = &records[records.len().saturating_sub(900)..];
        Self {
            depth_mm: records.last().map_or(0.0, |record| -height(record) * 1e3),
            inserted_s: records
                .iter()
                .position(|record| height(record) < Self::NEARLY_DOWN_M)
                .map(|tick| tick as f64 / RATE_HZ),
            peak_n: records.iter().map(|record| commanded(record).length()).fold(0.0, f64::max),
            ripple_n: ripple_over(
                &windows(records),
                &records.iter().map(commanded).collect::<Vec<_>>(),
            ),
            changes_at_rest: changes(rest),
            faults: if played.faults.is_empty() {
                String::new()
            } else {
                format!("{:?}", played.faults)
            },
        }
    }
}

impl InsertionResult {
    pub(super) fn rows(&self) -> Vec<Row> {
        const GROUP: &str = "peg in hole, simulated sigma.7-class arm";
        let name = self.coupling;
        match &self.figures {
            Err(why) => vec![Row::new(GROUP, format!("{name}: skipped: {why}"), None, "")],
            Ok(figures) => {
                let InsertionFigures {
                    depth_mm,
                    inserted_s,
                    peak_n,
                    ripple_n,
                    changes_at_rest,
                    faults,
                } = figures;
                let mut rows = vec![
                    Row::new(GROUP, format!("{name}: depth reached of 20 mm"), *depth_mm, "mm"),
                    Row::new(GROUP, format!("{name}: time to 19.5 mm"), *inserted_s, "s"),
                    Row::new(GROUP, format!("{name}: largest force on the hand"), *peak_n, "N"),
                    Row::new(
                        GROUP,
                        format!("{name}: ripple above 10 Hz in contact, RMS"),
                        *ripple_n,
                        "N",
                    ),
                    Row::new(
                        GROUP,
                        format!("{name}: contact came or went, last 0.9 s"),
                        *changes_at_rest as f64,
                        "",
                    ),
                ];
                if !faults.is_empty() {
                    rows.push(Row::new(GROUP, format!("{name}: ended by {faults}"), None, ""));
                }
                rows
            }
        }
    }
}

impl Bench<'_> {
    pub(super) fn insertions(&mut self) -> Result<Vec<InsertionResult>, BenchError> {
        let Some(scene) = scenes::shipped(&self.options.scenes)
            .into_iter()
            .find(|path| scenes::name(path) == "peg-in-hole")
        else {
            return Ok(vec![InsertionResult { coupling: "-", figures: Err(self.no_scenes()) }]);
        };
        if self.options.quick {
            return Ok(vec![InsertionResult { coupling: "-", figures: Err("--quick".to_owned()) }]);
        }
        let mut insertions = Vec::new();
        for coupling in COUPLINGS {
            self.tell(&format!("peg in hole, {coupling}"));
            let edits = self.as_stiff_as_allowed(&scene, vec![coupled(coupling)]);
            let played = self.played(&scene, &edits)?;
            let figures = played.map(|played| InsertionFigures::of(&played));
            insertions.push(InsertionResult { coupling, figures });
        }
        Ok(insertions)
    }
}
