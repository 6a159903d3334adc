//! Another scene while the loop runs.
//!
//! ```text
//!  cold thread                          servo
//!  bake, State::new, calibrate
//!  Swapper::offer ────── slot ────────► due? ──► ramp down ──► zero force ──► exchange two pointers ──► ramp up
//!  Swapper::take_back ◄── slot ───────────────────────────────── the old scene and its state
//!  (freed here)
//! ```
//! The servo moves one box in and one out: nothing is allocated, freed or copied, and no tick is missed. The order of the supervisor goes
//! first: after a stop nothing is exchanged, and after a fault not before it is acknowledged.
#![expect(clippy::disallowed_types, reason = "made and freed on the cold side")]

use std::sync::Arc;

use rtrb::{Consumer, Producer, PushError, RingBuffer};

use super::{ClaySlot, Wishes, calibration};
use crate::haptics::contact::Budget;
use crate::haptics::{RenderScene, State};
use crate::rt::clock::{Clock, ClockKind, RealClock, VirtualClock};

/// How much longer than the ramp a stop may take before the loop ends anyway, s.
const STOP_GRACE_S: f64 = 0.25;

/// A scene that is ready to be rendered: everything that the loop exchanges when it changes from one to another.
#[derive(Debug)]
pub struct Stage {
    pub(super) scene: Arc<RenderScene>,
    pub(super) state: State,
    pub(super) wishes: Wishes,
    pub(super) clay: Option<ClaySlot>,
    /// First tick in which it may be exchanged for another.
    at_tick: u64,
}

impl Stage {
    /// A scene with its state before the first tick. Allocates; cold.
    pub fn new(scene: Arc<RenderScene>) -> Self {
        Self { state: State::new(&scene), scene, wishes: Wishes::default(), clay: None, at_tick: 0 }
    }

    /// The same with wishes for its movable objects.
    #[must_use]
    pub fn with_wishes(mut self, wishes: Wishes) -> Self {
        self.wishes = wishes;
        self
    }

    /// The same with a slot for frames of its clay.
    #[must_use]
    pub fn with_clay(mut self, clay: ClaySlot) -> Self {
        self.clay = Some(clay);
        self
    }

    /// The same, to be taken from this tick of the loop on.
    #[must_use]
    pub fn at_tick(mut self, at_tick: u64) -> Self {
        self.at_tick = at_tick;
        self
    }

    /// The same with a limit for the contact query, s, turned into a count in this thread. Cost: about 256 times the limit.
    #[must_use]
    pub fn with_time_budget(mut self, time_budget_s: Option<f64>, clock: ClockKind) -> Self {
        if let Some(time_budget_s) = time_budget_s {
            let budget = match clock {
                ClockKind::Real => calibration::budget(&self.scene, &self.state, &RealClock, time_budget_s),
                ClockKind::Virtual => calibration::budget(&self.scene, &self.state, &VirtualClock::default(), time_budget_s),
            };
            self.state.set_budget(budget);
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
        ((p.limits.ramp_s + STOP_GRACE_S) / p.period_s).ceil() as u64
    }
}

/// Why a scene cannot take the place of another.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refused {
    /// One is waiting already.
    Waiting,
    /// The loop has ended.
    Over,
}

/// The cold end.
#[derive(Debug)]
pub struct Swapper {
    offers: Producer<Box<Stage>>,
    returned: Consumer<Box<Stage>>,
}

impl Swapper {
    /// Offers a scene; it must have been made for the same period and arm as the one that is rendered. Wait-free.
    ///
    /// # Errors
    /// The stage comes back when there is no room, or nobody to take it.
    pub fn offer(&mut self, stage: Box<Stage>) -> Result<(), (Refused, Box<Stage>)> {
        if self.is_over() {
            return Err((Refused::Over, stage));
        }
        self.offers.push(stage).map_err(|PushError::Full(stage)| (Refused::Waiting, stage))
    }

    /// The stage that was rendered before, to be freed here.
    pub fn take_back(&mut self) -> Option<Box<Stage>> {
        self.returned.pop().ok()
    }

    /// The loop has ended.
    pub fn is_over(&self) -> bool {
        self.offers.is_abandoned()
    }
}

/// The loop's end.
#[derive(Debug)]
pub struct SwapSlot {
    offers: Consumer<Box<Stage>>,
    returned: Producer<Box<Stage>>,
    waiting: Option<Box<Stage>>,
    /// Ticks at which simulated time waits for an offer that has been promised, rising; and how many offers there have been.
    promised_ticks: Box<[u64]>,
    n_offers: usize,
}

impl SwapSlot {
    /// Both ends. Real time waits for nobody: an offer that is late is taken late. Simulated time waits at the promised ticks (rising), so
    /// that two runs are the same.
    pub fn new(promised_ticks: Box<[u64]>) -> (Swapper, Self) {
        let (offers_in, offers) = RingBuffer::new(1);
        let (returned, returned_out) = RingBuffer::new(1);
        let slot = Self { offers, returned, waiting: None, promised_ticks, n_offers: 0 };
        (Swapper { offers: offers_in, returned: returned_out }, slot)
    }

    /// True when there is a stage to be taken in this tick. RT: safe.
    pub(super) fn is_due(&mut self, tick: u64, clock: ClockKind) -> bool {
        if self.waiting.is_none() {
            let promised = self.promised_ticks.get(self.n_offers).is_some_and(|promised| tick >= *promised);
            while promised && clock == ClockKind::Virtual && self.offers.is_empty() && !self.offers.is_abandoned() {
                std::thread::yield_now();
            }
            self.waiting = self.offers.pop().ok();
            self.n_offers += usize::from(self.waiting.is_some());
        }
        let due = self.waiting.as_ref().is_some_and(|stage| tick >= stage.at_tick);
        // Without room for the old one the new one waits: nothing is ever freed here. Simulated time waits for the room.
        while due && clock == ClockKind::Virtual && self.returned.slots() == 0 && !self.returned.is_abandoned() {
            std::thread::yield_now();
        }
        due && self.returned.slots() > 0
    }

    /// Exchanges the stage that is waiting for the one that is rendered. RT: safe; two pointers.
    pub(super) fn exchange(&mut self, rendered: &mut Box<Stage>) -> bool {
        let Some(next) = self.waiting.take() else { return false };
        let old = core::mem::replace(rendered, next);
        match self.returned.push(old) {
            Ok(()) => {}
            // Cannot be: `is_due` saw room, and only this side fills it. Kept rather than freed.
            Err(PushError::Full(old)) => core::mem::forget(old),
        }
        true
    }
}
