//! Frames of densities into the loop, and where the tool is out of it.
//!
//! ```text
//!  simulation                              servo
//!  DensityFeed::spare, fill, publish ──ring──► newest one ──► State::exchange ──► tick
//!  DensityFeed::spare ◄──────────────────ring── older ones, and the one before the last
//!  DensityFeed::next_state ◄─────────────ring── one ToolState per tick
//! ```
//! Frames are boxes that go round: the servo moves pointers, and nothing is allocated, freed or
//! copied there.
//!
//! Real time does not wait: a frame that is late is touched late, a state that finds the queue full
//! is dropped and counted. Simulated time waits in every `update_ticks`-th tick for one frame, so
//! that two runs are the same. A simulation that has gone is not waited for: the tick goes on with
//! the last frame.
#![expect(clippy::disallowed_types, reason = "made and freed on the cold side")]

use std::sync::Arc;

use glam::DVec3;
use rtrb::{Consumer, Producer, PushError, RingBuffer};

use super::waiting::Waiting;
use haptics::{FrameInUse, State, TickOutput};
use rt::clock::ClockKind;
use vps::density::{DensityFrame, FrameError, Raster};
use vps::spatial::Pose;

/// Frames made for the simulation, next to the two that the tick holds: one that is filled, one
/// under way, one on its way back.
const SPARES: usize = 3;
/// Capacity of the queues there and back: for all of them, and for some that the simulation may
/// have made itself.
const RING_FRAMES: usize = 8;
/// Tool states under way: at 1 kHz a second, ten times the longest sensible update.
const RING_STATES: usize = 1024;

/// What a tick sends to the simulation.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ToolState {
    /// Tick of the loop, counted from 0.
    pub tick: u64,
    /// Pose of the tool (mesh file frame) in the map frame of the densities, after the tick.
    pub map_from_tool: Pose,
    /// Force of their surface on the tool as it is felt, friction and rope apart, map axes, N.
    /// On them acts the opposite.
    pub force_map: DVec3,
    /// Force of the rope on the tool, map axes, N.
    pub rope_map: DVec3,
    /// Points of the tool in them.
    pub contacts: u32,
    /// Buttons of the arm, bit 0 first.
    pub buttons: u32,
    /// Force flows ([`State::feels_clay`]): without, the hand does not feel what it does.
    pub has_force: bool,
    /// Number of the frame that was touched.
    pub sequence: u64,
    /// States that found the queue full before this one.
    pub dropped: u64,
}

/// Why a frame was not taken. It comes back.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum FramePublishError {
    /// It cannot be touched.
    #[error("{0}")]
    Frame(#[from] FrameError),
    /// More frames than the loop has looked at.
    #[error(
        "{RING_FRAMES} frames are waiting for the loop; publish fewer, or wait for a spare \
            one"
    )]
    Full,
    /// The loop has ended, or renders another scene now.
    #[error("the density is not rendered any more")]
    Over,
}

/// The simulation's end.
#[derive(Debug)]
pub struct DensityFeed {
    frames: Producer<Box<DensityFrame>>,
    spares: Consumer<Box<DensityFrame>>,
    states: Consumer<ToolState>,
    /// The base of the last frame, which needs no second check.
    base: Option<Arc<Raster>>,
}

impl DensityFeed {
    /// A frame that no tick touches any more, to be filled: it has some earlier content. `None`
    /// while all are under way. Wait-free.
    pub fn spare(&mut self) -> Option<Box<DensityFrame>> {
        self.spares.pop().ok()
    }

    /// Checks and measures a frame, then sends it. Wait-free for the loop; here O(nodes of the
    /// region).
    ///
    /// # Errors
    /// See [`FramePublishError`]; the frame comes back.
    pub fn publish(
        &mut self,
        mut frame: Box<DensityFrame>,
    ) -> Result<(), (FramePublishError, Box<DensityFrame>)> {
        if self.is_over() {
            return Err((FramePublishError::Over, frame));
        }
        if let Err(error) = frame.make_ready(self.base.as_ref()) {
            return Err((error.into(), frame));
        }
        if !self.base.as_ref().is_some_and(|base| Arc::ptr_eq(base, &frame.base)) {
            self.base = Some(frame.base.clone());
        }
        self.frames.push(frame).map_err(|PushError::Full(frame)| (FramePublishError::Full, frame))
    }

    /// The state of the oldest tick that was not taken yet; `None` when all are taken. Wait-free.
    pub fn next_state(&mut self) -> Option<ToolState> {
        self.states.pop().ok()
    }

    /// The loop has ended, or renders another scene now.
    pub fn is_over(&self) -> bool {
        self.frames.is_abandoned()
    }
}

/// The loop's end.
#[derive(Debug)]
pub struct DensitySlot {
    frames: Consumer<Box<DensityFrame>>,
    spares: Producer<Box<DensityFrame>>,
    states: Producer<ToolState>,
    map_from_world: Pose,
    update_ticks: u64,
    /// Ticks in which it was rendered.
    ticks: u64,
    dropped: u64,
}

impl DensitySlot {
    /// Both ends, for frames like this one in a map that stands there. `update_ticks` (at least 1): ticks from one frame to the
    /// next under simulated time, where the simulation owes one frame for so many states.
    /// Allocates.
    pub fn new(
        frame: &DensityFrame,
        world_from_map: &Pose,
        update_ticks: u64,
    ) -> (DensityFeed, Self) {
        let (frames_in, frames) = RingBuffer::new(RING_FRAMES);
        let (mut spares, spares_out) = RingBuffer::new(RING_FRAMES);
        let (states, states_out) = RingBuffer::new(RING_STATES.max(2 * update_ticks as usize));
        for _ in 0..SPARES {
            give_back(&mut spares, Box::new(frame.clone()));
        }
        let base = Some(frame.base.clone());
        let map_from_world = world_from_map.inverse();
        let slot = Self {
            frames,
            spares,
            states,
            map_from_world,
            update_ticks: update_ticks.max(1),
            ticks: 0,
            dropped: 0,
        };
        (DensityFeed { frames: frames_in, spares: spares_out, states: states_out, base }, slot)
    }

    /// Before a tick: gives it the newest frame, and those that it does not need back. Simulated
    /// time waits for the frame that is owed, unless `is_hurried`. RT: safe.
    pub(super) fn exchange(
        &mut self,
        state: &mut State,
        clock: ClockKind,
        is_hurried: impl Fn() -> bool,
    ) {
        let is_owed = self.ticks > 0 && self.ticks.is_multiple_of(self.update_ticks);
        self.ticks += 1;
        let mut newest = None;
        match clock {
            ClockKind::Virtual => {
                let waits = |slot: &Self| {
                    let for_frame = slot.frames.is_empty() && !slot.frames.is_abandoned();
                    for_frame || slot.spares.slots() == 0 && !slot.spares.is_abandoned()
                };
                let waiting = Waiting::new();
                while is_owed && waits(self) && !is_hurried() {
                    waiting.pause();
                }
                if is_owed && self.spares.slots() > 0 {
                    newest = self.frames.pop().ok();
                }
            }
            ClockKind::Real => {
                let mut has_leapt = false;
                // Without a free place for what comes back a frame stays where it is: nothing is
                // ever freed here.
                while self.spares.slots() > usize::from(newest.is_some()) {
                    let Ok(mut frame) = self.frames.pop() else { break };
                    // A leap in a frame that no tick has touched is still to come.
                    has_leapt |= frame.is_leap;
                    frame.is_leap = has_leapt;
                    if let Some(older) = newest.replace(frame) {
                        give_back(&mut self.spares, older);
                    }
                }
            }
        }
        if let Some(newest) = newest {
            give_back(&mut self.spares, state.exchange(newest));
        }
    }

    /// The simulation has gone, and no frame is waiting, or none can be taken for want of a place
    /// for what it sends back. RT: safe.
    pub(super) fn is_abandoned(&self) -> bool {
        self.frames.is_abandoned() && (self.frames.is_empty() || self.spares.slots() == 0)
    }

    /// After a tick: sends its state to the simulation. RT: safe; simulated time waits for a free
    /// place.
    pub(super) fn tell(
        &mut self,
        tick: u64,
        buttons: u32,
        state: &State,
        output: &TickOutput,
        clock: ClockKind,
    ) {
        let forces = state.clay_forces();
        let mut reported = ToolState {
            tick,
            map_from_tool: self.map_from_world * output.world_from_tool,
            force_map: self.map_from_world.transform_vector(forces.contact_world.force),
            rope_map: self.map_from_world.transform_vector(forces.rope_world),
            contacts: forces.contacts,
            buttons,
            has_force: state.feels_clay(),
            sequence: state.frame_sequence().unwrap_or(0),
            dropped: self.dropped,
        };
        let waiting = Waiting::new();
        while let Err(PushError::Full(back)) = self.states.push(reported) {
            if clock == ClockKind::Real || self.states.is_abandoned() {
                self.dropped += 1;
                return;
            }
            reported = back;
            waiting.pause();
        }
    }
}

/// What the record of a tick says of them.
pub(super) fn frame_in_use(slot: Option<&DensitySlot>, state: &State) -> Option<FrameInUse> {
    state.frame_sequence().map(|sequence| FrameInUse {
        sequence,
        is_last: slot.is_none_or(DensitySlot::is_abandoned),
    })
}

fn give_back(spares: &mut Producer<Box<DensityFrame>>, frame: Box<DensityFrame>) {
    if let Err(PushError::Full(frame)) = spares.push(frame) {
        // Cannot be: there was a free place, and only this side fills it. Kept rather than freed.
        core::mem::forget(frame);
    }
}
