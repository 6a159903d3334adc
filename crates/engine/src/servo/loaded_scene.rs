//! A scene that is ready to be rendered.
#![expect(clippy::disallowed_types, reason = "made and freed on the cold side")]

use std::sync::Arc;

use super::{DensitySlot, calibration};
use arms::simulated::hand::GripPath;
use haptics::{RenderScene, State};
use rt::clock::{Clock, ClockKind, RealClock, VirtualClock};
use vps::contact::Budget;
use vps::spatial::Pose;

/// How much longer than the ramp a stop may take before the loop ends anyway, s.
const STOP_GRACE_S: f64 = 0.25;

/// A scene that is ready to be rendered: everything that the loop exchanges when it changes from
/// one to another.
#[derive(Debug)]
pub struct LoadedScene {
    pub(super) scene: Arc<RenderScene>,
    pub(super) state: State,
    pub(super) density: Option<DensitySlot>,
    /// Where clients asked its objects to go and the tick has not got yet.
    pub(super) asked_poses: Box<[Option<Pose>]>,
    /// First tick in which it may be rendered.
    pub(super) at_tick: u64,
    /// Path of the hand of a simulated arm in this scene; after the exchange that of the scene
    /// before, to be freed with it.
    pub(super) hand: Option<GripPath>,
    /// The tool begins at its start, and does not stay where it is.
    pub(super) starts_anew: bool,
}

impl LoadedScene {
    /// A scene with its state before the first tick. Allocates; cold.
    pub fn new(scene: Arc<RenderScene>) -> Self {
        let asked_poses = scene.obstacles.iter().map(|_| None).collect();
        Self {
            state: State::new(&scene),
            scene,
            density: None,
            asked_poses,
            at_tick: 0,
            hand: None,
            starts_anew: false,
        }
    }

    /// The same, to be taken from this tick of the loop on.
    #[must_use]
    pub fn at_tick(mut self, at_tick: u64) -> Self {
        self.at_tick = at_tick;
        self
    }

    /// The same with a path for the hand of a simulated arm, which it follows from its next enable
    /// on.
    #[must_use]
    pub fn with_hand(mut self, hand: Option<GripPath>) -> Self {
        self.hand = hand;
        self
    }

    /// The same with the tool at its start: of a scene that takes the place of another it stays
    /// where it is otherwise.
    #[must_use]
    pub fn starting_anew(mut self, starts_anew: bool) -> Self {
        self.starts_anew = starts_anew;
        self
    }

    /// The same with a limit for the contact query, s, turned into a count in this thread. Cost:
    /// about 256 times the limit.
    #[must_use]
    pub fn with_time_budget(mut self, time_budget_s: Option<f64>, clock: ClockKind) -> Self {
        if let Some(time_budget_s) = time_budget_s {
            match clock {
                ClockKind::Real => self.calibrate(&RealClock, time_budget_s),
                ClockKind::Virtual => self.calibrate(&VirtualClock::default(), time_budget_s),
            }
        }
        self
    }

    /// Limits the contact query; for the loop's own start.
    pub(super) fn calibrate(&mut self, clock: &impl Clock, time_budget_s: f64) {
        let budget = calibration::budget(&self.scene, &self.state, clock, time_budget_s);
        self.state.set_budget(budget);
    }

    /// What a contact query may look at; `None`: everything. RT: safe.
    pub(super) fn budget_points(&self) -> Option<u32> {
        match self.state.budget() {
            Budget::Unlimited => None,
            Budget::Points(points) => Some(points),
        }
    }

    /// Ticks that a stop may take.
    pub(super) fn stop_ticks(&self) -> u64 {
        let p = &self.scene.parameters;
        ((p.limits.ramp_down_s() + STOP_GRACE_S) / p.period_s).ceil() as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use haptics::testing::empty_scene;

    #[test]
    fn a_query_is_limited_by_a_count_where_there_is_a_limit() {
        // 10 ns for each point of two queries.
        let points = |time_budget_s: Option<f64>| {
            LoadedScene::new(empty_scene())
                .with_time_budget(time_budget_s, ClockKind::Virtual)
                .budget_points()
        };
        assert_eq!((points(None), points(Some(300e-6))), (None, Some(15_000)));
    }
}
