//! The engine of sculpting: a model of clay, and the tool that works it.
//!
//! Data in: what the tool does, tick by tick, and [`SculptOrder`]s of people, pages and scripts.
//! Data out: frames for the loop, [`ClayView`]s for those who look.
//!
//! ```text
//!  ToolMotion ──► tool: push, pull, paint, … ──────┐
//!  SculptOrder ─► undo, emboss, combine, save, … ──┴─► ClayModel ─► DensityFrame (to the loop), ClayView (to clients)
//! ```
//! Pure: no clock and no thread of its own; the same calls give the same bits.

mod carry_out;
mod clay_view;
mod curves;
mod error;
mod order;
mod sculpt_tool;
mod tool_motion;
mod work;

use std::sync::Arc;

pub use clay_view::ClayView;
pub use error::EngineError;
pub use order::{RopeCurves, SculptOrder};
pub use sculpt_tool::{ChosenSolid, SculptTool, ToolChange, ToolSettings};
pub use tool_motion::{HoldOutcome, ToolBody, ToolMotion};

use self::curves::Curves;
use self::work::{Activity, MotionSummary};
use super::{Cancel, ClayModel, PointSet};
use vps::density::DensityFrame;
use vps::setting_names::SettingNames;
use vps::spatial::Metres;

/// Strokes that were made, and how many can be taken back and done again.
type History = (u64, (usize, usize));

/// Mass points that have come to stand so many times farther apart are reported.
const COARSER: f64 = 1.25;

/// A model of clay and the tool that works it.
#[derive(Debug)]
pub struct SculptEngine {
    model: ClayModel,
    tool: ToolSettings,
    body: ToolBody,
    motion: MotionSummary,
    /// An order holds, as the arm's button does.
    is_held_by_order: bool,
    activity: Activity,
    /// Curves that were drawn, and wait for a hold of pull-curve whatever is done meanwhile.
    waiting: Curves,
    updates: u64,
    /// Of the points that were shown last.
    version: u64,
    /// As they were copied last; `None`: never.
    shown: Option<(Arc<PointSet>, Arc<[f32]>)>,
    /// They have changed since.
    is_outdated: bool,
    /// Strokes, and strokes to be taken back and done again, when a session was saved last.
    saved: History,
    /// Of the last update.
    grip: HoldOutcome,
    /// The loop has not been shown what there is.
    has_changed: bool,
    /// The surface may have gone elsewhere at once since it was shown.
    has_leapt: bool,
    trouble: Arc<str>,
    setting_names: SettingNames,
}

impl SculptEngine {
    /// A clay model, the tool to begin with, and the body in the hand.
    pub fn new(model: ClayModel, tool: ToolSettings, body: ToolBody) -> Self {
        Self {
            saved: past_of(&model),
            model,
            tool,
            body,
            motion: MotionSummary::default(),
            is_held_by_order: false,
            activity: Activity::Nothing,
            waiting: Curves::default(),
            updates: 0,
            version: 0,
            shown: None,
            is_outdated: true,
            grip: HoldOutcome::None,
            has_changed: true,
            has_leapt: false,
            trouble: Arc::from(""),
            setting_names: SettingNames::PLAIN,
        }
    }

    /// The same engine, whose [`Self::trouble`] calls settings by these names.
    #[must_use]
    pub fn with_setting_names(self, setting_names: SettingNames) -> Self {
        Self { setting_names, ..self }
    }

    /// [`ClayModel::cancel_when`].
    pub fn cancel_when(&mut self, cancel: Cancel) {
        self.model.cancel_when(cancel);
    }

    /// The model.
    pub fn model(&self) -> &ClayModel {
        &self.model
    }

    /// Updates of the material so far.
    pub fn updates(&self) -> u64 {
        self.updates
    }

    /// What went wrong last, for people; empty when nothing did since.
    pub fn trouble(&self) -> &Arc<str> {
        &self.trouble
    }

    /// What became of a hold in the last update; [`Self::trouble`] says why nothing did.
    pub fn grip(&self) -> HoldOutcome {
        self.grip
    }

    /// Takes the tool of one tick of the loop; every tick once, in order. O(1).
    pub fn take_motion(&mut self, motion: &ToolMotion) {
        self.motion.add(motion, self.is_held_by_order);
    }

    /// Carries out an order.
    ///
    /// # Errors
    /// [`EngineError`]; the clay is as it was, but that a stroke may have ended.
    pub fn order(&mut self, order: SculptOrder) -> Result<(), EngineError> {
        let spacing_m = self.model.region().lattice().spacing_m;
        let changes_samples = matches!(
            order,
            SculptOrder::Undo
                | SculptOrder::Redo
                | SculptOrder::Combine { .. }
                | SculptOrder::Emboss { .. }
                | SculptOrder::Region { .. }
        );
        let pulled_s = self.pull_left_s();
        let result = self.carry_out(order);
        // An order that fails leaves the samples, but may have changed what else is shown. A stroke
        // that it ends is noted by itself.
        if changes_samples && result.is_ok() {
            self.note_change();
        } else {
            self.show_again();
        }
        result?;
        self.trouble = self.news(spacing_m);
        if let Some(left_s) =
            pulled_s.filter(|_| self.pull_left_s() != pulled_s && self.trouble.is_empty())
        {
            self.trouble =
                format!("this ended the pull that was under way, {left_s:.2} s early").into();
        }
        Ok(())
    }

    /// Lets the hand work, and the material move, for a time. False when nothing has changed since
    /// the update before: then there is nothing new to show.
    pub fn advance(&mut self, time_s: f64) -> bool {
        self.updates += 1;
        let motion = self.motion.take();
        let had_rope = self.rope_map().is_some();
        let strokes_before = self.model.strokes();
        let spacing_m = self.model.region().lattice().spacing_m;
        let worked = self.work(&motion, time_s);
        self.grip = motion.grip(worked.is_ok() || !self.tool.kind.is_held());
        if let Err(error) = worked {
            self.complain(&error);
        } else {
            let news = self.news(spacing_m);
            if self.model.strokes() > strokes_before || !news.is_empty() {
                self.trouble = news;
            }
        }
        let is_stroke = self.model.is_stroke();
        if is_stroke {
            self.model.advance(time_s);
            self.follow();
        }
        if is_stroke
            || self.model.strokes() != strokes_before
            || had_rope != self.rope_map().is_some()
        {
            self.note_change();
        }
        core::mem::take(&mut self.has_changed)
    }

    /// The stroke under way ends, and the rope is let go.
    pub fn finish(&mut self) {
        self.grip = HoldOutcome::None;
        let spacing_m = self.model.region().lattice().spacing_m;
        match self.let_go().map(|()| self.news(spacing_m)) {
            Err(error) => self.complain(&error),
            Ok(news) if !news.is_empty() => self.trouble = news,
            Ok(_) => {}
        }
    }

    /// The rope is let go, and the stroke goes on without it; false where there is none.
    pub fn slacken(&mut self) -> bool {
        let had_rope = self.rope_map().is_some();
        if had_rope {
            self.activity = Activity::Nothing;
        }
        had_rope
    }

    /// The stroke under way has never been: after densities that cannot be touched.
    pub fn give_up_stroke(&mut self, why: &str) {
        self.activity = Activity::Nothing;
        self.has_leapt = true;
        self.model.cancel_stroke();
        self.note_change();
        self.trouble = format!("the stroke was taken back: {why}").into();
    }

    /// Writes what there is into a frame for the loop. Cost: a copy of the region.
    pub fn show(&mut self, frame: &mut DensityFrame) {
        self.model.show(frame);
        frame.sequence = self.updates;
        frame.rope_map = self.rope_map();
        frame.is_leap = core::mem::take(&mut self.has_leapt);
    }

    /// The samples are others than [`Self::view`] shows.
    pub fn has_new_samples(&self) -> bool {
        self.is_outdated
    }

    /// From now on [`Self::view`] shows the samples as they are. Cost: a copy of them where they
    /// have changed.
    pub fn copy_samples(&mut self) {
        if core::mem::take(&mut self.is_outdated) || self.shown.is_none() {
            self.version += 1;
            let spacings_m = self
                .model
                .surface()
                .spacings_m()
                .iter()
                .map(|spacing_m| *spacing_m as f32)
                .collect();
            self.shown = Some((Arc::new(self.model.points().clone()), spacings_m));
        }
    }

    /// What clients see: all as it is, but during a stroke the samples are those of the last
    /// [`Self::copy_samples`]. Without a stroke they are those of now, so that a client which reads
    /// that a stroke has ended, or was undone, reads its samples as well. Cost: little; a copy of
    /// the samples where they have changed without a stroke.
    pub fn view(&mut self) -> ClayView {
        if self.shown.is_none() || !self.model.is_stroke() {
            self.copy_samples();
        }
        let (points, spacings_m) = self.shown.clone().unwrap_or_default();
        let (n_undo, n_redo) = self.model.history();
        ClayView {
            version: self.version,
            points,
            spacings_m,
            spacing_m: self.model.surface().spacing_m(),
            region_map: self.model.region_map(),
            raster: self.model.region().lattice().dims,
            curves_map: self.drawn_map(),
            tool: self.tool.clone(),
            material: self.model.settings().material.clone(),
            is_stroke: self.model.is_stroke(),
            is_unsaved: self.is_unsaved(),
            is_over: false,
            n_undo,
            n_redo,
            updates: self.updates,
            update_s: 0.0,
            late: 0,
            trouble: self.trouble.clone(),
        }
    }

    /// Strokes were made, taken back or done again since a session was saved, or since the start.
    pub(crate) fn is_unsaved(&self) -> bool {
        self.model.is_stroke() || past_of(&self.model) != self.saved
    }

    /// What there is has not been shown: the next [`Self::advance`] says so.
    pub fn show_again(&mut self) {
        self.has_changed = true;
    }

    /// What to say after something was done; empty: nothing.
    fn news(&mut self, before_m: f64) -> Arc<str> {
        let reconnected = self.model.take_reconnected();
        match (self.coarser_than(before_m), reconnected) {
            (coarser, Some((before, after))) if coarser.is_empty() => format!(
                "{} (the Euler number of the clay in the region went from {before} to {after}); \
                    undo if that was not meant",
                if after < before {
                    "fronts of the clay have met and are one body now, or a hole has gone through \
                        it"
                } else {
                    "a part of the clay has come off, or a hole has closed"
                }
            )
            .into(),
            (coarser, _) => coarser,
        }
    }

    /// What to say of mass points that have come to stand farther apart, such as after a union with
    /// something far away; empty: nothing.
    fn coarser_than(&self, before_m: f64) -> Arc<str> {
        let now_m = self.model.region().lattice().spacing_m;
        if now_m <= COARSER * before_m {
            return Arc::from("");
        }
        let before = Metres(before_m);
        let now = Metres(now_m);
        format!(
            "the model has grown, and its mass points are {now} apart instead of {before}: what is \
                finer than that is lost; undo, or choose a region around what is worked"
        )
        .into()
    }

    fn note_change(&mut self) {
        self.is_outdated = true;
        self.has_changed = true;
    }

    fn complain(&mut self, error: &EngineError) {
        let trouble = format!("{error}; {}", error.hint(&self.setting_names));
        if *self.trouble != *trouble {
            self.show_again();
            self.trouble = trouble.into();
        }
    }
}

fn past_of(model: &ClayModel) -> History {
    (model.strokes(), model.history())
}

#[cfg(test)]
mod limits;
#[cfg(test)]
mod tests;
