//! The arm's side: takes commands, drives the arm behind it, sends states. Never looks at a clock:
//! the caller gives the time.
//!
//! ```text
//!           HELLO                 enable, arm sound              silence: hold, fade, zero
//!  Silent ─────────► Disabled ───────────────────────► Enabled ────────────────────────────► Tripped
//!                      ▲  ▲    enable clear, STOP         │  number that is none ─► Refusing    │
//!                      │  └───────────────────────────────┘                            │        │ enable clear, STOP
//!                      └───────────────────────────────────────────────────────────────┴────────┘
//! ```
//! It is the state machine of open6 (`docs/reference/protocol.md`, section 6), with [`CommandHold`]
//! in the place of the watchdog. It listens to one host, by the token of its HELLO, and to another
//! one only after that one has said STOP, or nothing for a second.
//!
//! The node trusts no host with its arm: force and torque are limited once more, their change too,
//! and nothing pushes while the arm is lost, silent, not homed or hot, or its deadman is not held.

mod payloads;

use core::sync::atomic::Ordering::Relaxed;
use std::sync::Arc;

use glam::DVec3;

use self::payloads::{StateContent, capabilities, state};
use super::command_hold::{CommandHold, HoldTiming, LAG_TICKS};
use super::figures::{LinkPhase, NodeFigures};
use super::packets::{
    COMMAND_1_1_LEN, COMMAND_TOKEN, HELLO_1_1_LEN, HELLO_TOKEN, HostToken, STOP_TOKEN, put, reader,
    steps_ahead, token_at,
};
use crate::protocol::DeclaredLimits;
use crate::protocol::number::f32_at;
use crate::protocol::open6::{
    CAPABILITIES, COMMAND, HELLO, MAGIC, MAJOR, Packet, Packets, STATE, STOP,
};
use crate::transport::{FRAME_MAX, Frame, Transport};
use crate::{Device, DeviceError, lower};
use vps::spatial::{Axes, DeviceSample, SampleStatus, Wrench};

/// Packets of one period. More would let a flood keep the loop.
const READS_MAX: usize = 64;
/// A host that has said nothing for so long may be followed by another one, s.
const OWNER_SILENT_S: f64 = 1.0;
/// Periods without a new sample after which the arm behind the node counts as silent.
const STALE_MAX: u32 = 20;
/// From zero to the limit in so long, s, as a host's default.
const FULL_SLEW_S: f64 = 10e-3;
/// Periods of which the newest command is remembered: longer than the delay of any arm that is
/// driven.
const TAKEN: usize = 64;

/// Error codes of a state.
const NOT_HOMED: u8 = 1;
const NOT_FINITE: u8 = 2;
const TOO_HOT: u8 = 3;
const SENSOR: u8 = 5;
const ARM_GONE: u8 = 6;

/// What a node needs to know of its arm.
#[derive(Clone, Debug)]
pub struct NodeParameters {
    /// Name that it goes by, cut to 32 bytes.
    pub name: String,
    /// Axes that the arm senses.
    pub sensed: Axes,
    /// Axes that it drives.
    pub actuated: Axes,
    /// One period of the node's loop, s.
    pub period_s: f64,
    /// Largest |F|, N.
    pub force_limit_n: f64,
    /// Largest |τ|, N·m.
    pub torque_limit_nm: f64,
    /// Radius of the workspace, m.
    pub workspace_radius_m: f64,
    /// How long a force outlives its command.
    pub timing: HoldTiming,
    /// Button that has to be held for force.
    pub deadman: Option<u8>,
    /// The arm lives only from the first greeting on: a simulated one, whose hand waits for the
    /// host.
    pub starts_with_host: bool,
}

impl NodeParameters {
    /// The same with the limits that the arm declares itself, where those are lower.
    pub fn lowered_by(mut self, declared: Option<DeclaredLimits>) -> Self {
        if let Some(declared) = declared {
            self.force_limit_n = lower(self.force_limit_n, declared.force_n);
            self.torque_limit_nm = lower(self.torque_limit_nm, declared.torque_nm);
        }
        self
    }
}

#[derive(Clone, Copy, Debug)]
struct Owner {
    token: HostToken,
    heard_s: f64,
    /// Number of its newest packet.
    newest: Option<u16>,
}

/// A command, and when it was taken.
#[derive(Clone, Copy, Debug, Default)]
struct Taken {
    sequence: u16,
    at_s: Option<f64>,
}

/// The arm's side of a link. RT: [`Node::step`] is safe.
pub struct Node {
    parameters: NodeParameters,
    link: Box<dyn Transport>,
    packets: Packets,
    mode: LinkPhase,
    error: u8,
    owner: Option<Owner>,
    hold: CommandHold,
    newest: Taken,
    /// `[TAKEN]`, ring: the newest command in each of the last periods.
    taken: [Taken; TAKEN],
    n_steps: u64,
    sample: DeviceSample,
    stale: u32,
    arm_gone: bool,
    enabled: bool,
    written: Wrench,
    /// A greeting was answered in this period.
    has_described: bool,
    sequence: u16,
    frame: Frame,
    figures: Arc<NodeFigures>,
}

impl Node {
    /// A node to which no host has sent HELLO.
    pub fn new(parameters: NodeParameters, link: Box<dyn Transport>) -> Self {
        Self {
            parameters,
            link,
            packets: reader(),
            mode: LinkPhase::Silent,
            error: 0,
            owner: None,
            hold: CommandHold::default(),
            newest: Taken::default(),
            taken: [Taken::default(); TAKEN],
            n_steps: 0,
            sample: DeviceSample::default(),
            stale: 0,
            arm_gone: false,
            enabled: false,
            written: Wrench::ZERO,
            has_described: false,
            sequence: 0,
            frame: Frame::default(),
            figures: Arc::default(),
        }
    }

    /// What it counts.
    pub fn figures(&self) -> Arc<NodeFigures> {
        self.figures.clone()
    }

    /// What the motors were last reported.
    pub fn written(&self) -> Wrench {
        self.written
    }

    /// One period, which begins at `now_s`: packets in, sample, force, state out.
    pub fn step(&mut self, now_s: f64, arm: &mut dyn Device) {
        self.listen(now_s);
        if self.parameters.starts_with_host && self.owner.is_none() {
            return;
        }
        self.read(arm);
        self.n_steps += 1;
        let slot = (self.n_steps % TAKEN as u64) as usize;
        if let Some(entry) = self.taken.get_mut(slot) {
            *entry = self.newest;
        }
        let wrench = self.force(now_s);
        self.write(wrench, arm);
        self.figures.enter(self.mode);
        // An answer to a greeting would be the older of two frames, and a link whose newest frame
        // wins would drop it.
        if self.mode != LinkPhase::Silent && !core::mem::take(&mut self.has_described) {
            self.send_state(now_s);
        }
    }

    /// Zero, on every way out.
    pub fn stop(&mut self, arm: &mut dyn Device) {
        (self.mode, self.enabled, self.written) = (LinkPhase::Disabled, false, Wrench::ZERO);
        self.hold.clear();
        arm.set_enabled(false);
        arm.stop();
    }

    fn listen(&mut self, now_s: f64) {
        let mut buffer = [0; FRAME_MAX];
        for _ in 0..READS_MAX {
            // A link that is gone is a silent one.
            let n = self.link.receive(&mut buffer).unwrap_or(0);
            let Some(bytes) = buffer.get(..n).filter(|bytes| !bytes.is_empty()) else { return };
            // One packet to a datagram; taken out of the reader, which is borrowed while it hands
            // over.
            let mut found = None;
            self.packets.feed(bytes, |packet| {
                let mut payload = [0; FRAME_MAX];
                let n = packet.payload.len().min(FRAME_MAX);
                payload[..n].copy_from_slice(&packet.payload[..n]);
                found = Some((packet.kind, packet.sequence, payload, n));
            });
            if let Some((kind, sequence, payload, n)) = found {
                self.take(&Packet { kind, sequence, payload: &payload[..n] }, now_s);
            }
        }
    }

    fn take(&mut self, packet: &Packet<'_>, now_s: f64) {
        let payload = packet.payload;
        match packet.kind {
            HELLO if payload.len() >= HELLO_1_1_LEN && payload[..4] == MAGIC => {
                if let Some(token) = token_at(payload, HELLO_TOKEN) {
                    self.greet(token, payload[4], packet.sequence, now_s);
                }
            }
            COMMAND
                if payload.len() >= COMMAND_1_1_LEN
                    && self.is_newest(token_at(payload, COMMAND_TOKEN), packet, now_s) =>
            {
                self.command(payload, packet.sequence, now_s);
            }
            STOP if self.is_newest(token_at(payload, STOP_TOKEN), packet, now_s) => {
                self.newest = Taken { sequence: packet.sequence, at_s: Some(now_s) };
                self.disable();
                // It has said good-bye: the next one need not wait.
                if let Some(owner) = &mut self.owner {
                    owner.heard_s = f64::NEG_INFINITY;
                }
            }
            _ => {}
        }
    }

    fn greet(&mut self, token: HostToken, major: u8, sequence: u16, now_s: f64) {
        let is_taken = self.owner.is_some_and(|owner| {
            !owner.token.is_of_process(token)
                && now_s - owner.heard_s < OWNER_SILENT_S
                && self.mode != LinkPhase::Silent
        });
        let is_known = self.owner.is_some_and(|owner| owner.token == token);
        // Another major version gets our version and nothing else; so does a second host, which
        // gets the name of the first one. A greeting that was repeated on its way changes nothing.
        if major == MAJOR && !is_taken && !is_known {
            self.owner = Some(Owner { token, heard_s: now_s, newest: None });
            (self.newest, self.taken) = (Taken::default(), [Taken::default(); TAKEN]);
            self.disable();
        }
        if is_taken {
            self.figures.foreign_packets.fetch_add(1, Relaxed);
        }
        self.describe(sequence);
    }

    /// True for a packet of the host that this node listens to that is newer than what it has sent
    /// so far.
    fn is_newest(&mut self, token: Option<HostToken>, packet: &Packet<'_>, now_s: f64) -> bool {
        let Some(owner) = self.owner.as_mut().filter(|owner| Some(owner.token) == token) else {
            self.figures.foreign_packets.fetch_add(1, Relaxed);
            return false;
        };
        owner.heard_s = now_s;
        let steps = owner.newest.map_or(Some(1), |newest| steps_ahead(newest, packet.sequence));
        match steps {
            Some(steps) => {
                owner.newest = Some(packet.sequence);
                self.figures.lost.fetch_add(u64::from(steps - 1), Relaxed);
                true
            }
            None => {
                self.figures.old.fetch_add(1, Relaxed);
                false
            }
        }
    }

    fn disable(&mut self) {
        (self.mode, self.error) = (LinkPhase::Disabled, 0);
        self.hold.clear();
    }

    fn command(&mut self, payload: &[u8], sequence: u16, now_s: f64) {
        self.figures.commands.fetch_add(1, Relaxed);
        let mut is_after_stall = false;
        if let (LinkPhase::Enabled, Some(before_s)) = (self.mode, self.newest.at_s) {
            self.figures.longest_gap_us.fetch_max(((now_s - before_s) * 1e6) as u32, Relaxed);
            let HoldTiming { hold_s, fade_s } = self.parameters.timing;
            is_after_stall = now_s - before_s > hold_s + fade_s;
        }
        self.newest = Taken { sequence, at_s: Some(now_s) };
        if payload[28] & 1 == 0 {
            self.disable();
            return;
        }
        if is_after_stall {
            // The node stood still, or it would have let go. What lay unread meanwhile is as old.
            self.mode = LinkPhase::Tripped;
            self.hold.clear();
            self.figures.link_losses.fetch_add(1, Relaxed);
        }
        if !matches!(self.mode, LinkPhase::Disabled | LinkPhase::Enabled) {
            return;
        }
        let number = |idx: usize| f64::from(f32_at(payload, 4 * idx));
        let vector = |first: usize| DVec3::new(number(first), number(first + 1), number(first + 2));
        let wanted = Wrench::new(vector(0), vector(3));
        if !(wanted.is_finite() && number(6).is_finite()) {
            (self.mode, self.error) = (LinkPhase::Refusing, NOT_FINITE);
            self.hold.clear();
            return;
        }
        self.mode = LinkPhase::Enabled;
        let NodeParameters { force_limit_n, torque_limit_nm, .. } = self.parameters;
        self.hold.take(
            Wrench::new(
                limited(wanted.force, force_limit_n),
                limited(wanted.torque, torque_limit_nm),
            ),
            now_s,
        );
    }

    fn read(&mut self, arm: &mut dyn Device) {
        match arm.read() {
            Ok(sample) => (self.sample, self.arm_gone) = (sample, false),
            Err(DeviceError::Packet | DeviceError::NonFinite) => {
                self.sample.status = SampleStatus::Stale
            }
            Err(_) => {
                if !core::mem::replace(&mut self.arm_gone, true) {
                    self.figures.arm_losses.fetch_add(1, Relaxed);
                }
            }
        }
        self.stale = if self.sample.status == SampleStatus::Fresh {
            0
        } else {
            self.stale.saturating_add(1)
        };
    }

    /// What is wrong with the arm, as a state says it; 0: nothing.
    fn arm_error(&self) -> u8 {
        if self.arm_gone {
            ARM_GONE
        } else if self.stale > STALE_MAX || self.sample.device_error != 0 {
            SENSOR
        } else if self.sample.overheated {
            TOO_HOT
        } else if !self.sample.homed {
            NOT_HOMED
        } else {
            0
        }
    }

    fn is_held(&self) -> bool {
        self.parameters.deadman.is_none_or(|button| {
            self.sample.buttons.checked_shr(u32::from(button)).unwrap_or(0) & 1 == 1
        })
    }

    /// The force of this period.
    fn force(&mut self, now_s: f64) -> Wrench {
        if self.mode != LinkPhase::Enabled {
            return Wrench::ZERO;
        }
        let arm_error = self.arm_error();
        if arm_error != 0 {
            (self.mode, self.error) = (LinkPhase::Refusing, arm_error);
            self.hold.clear();
            return Wrench::ZERO;
        }
        let NodeParameters { period_s, timing, .. } = self.parameters;
        let arm_s = f64::from(1 + self.sample.delay_ticks) * period_s;
        let Some(felt) = self.hold.next(now_s, &timing, arm_s) else {
            self.mode = LinkPhase::Tripped;
            self.figures.link_losses.fetch_add(1, Relaxed);
            let silent_s = now_s - self.newest.at_s.unwrap_or(now_s);
            self.figures.zero_after_us.store(((silent_s + arm_s) * 1e6).round() as u32, Relaxed);
            return Wrench::ZERO;
        };
        let wanted = if self.is_held() { felt } else { Wrench::ZERO };
        let NodeParameters { force_limit_n, torque_limit_nm, .. } = self.parameters;
        let share = period_s / FULL_SLEW_S;
        Wrench::new(
            towards(self.written.force, wanted.force, share * force_limit_n),
            towards(self.written.torque, wanted.torque, share * torque_limit_nm),
        )
    }

    fn write(&mut self, wrench: Wrench, arm: &mut dyn Device) {
        let enabled = self.mode == LinkPhase::Enabled;
        if enabled != self.enabled {
            self.enabled = enabled;
            arm.set_enabled(enabled);
        }
        // An arm that is gone, or refused, makes no force; what it says on the next read counts.
        let is_sound = wrench.is_finite();
        self.written = if is_sound { wrench } else { Wrench::ZERO };
        if arm.write(&self.written).is_err() {
            self.written = Wrench::ZERO;
        }
    }

    fn describe(&mut self, sequence: u16) {
        let listens_to = self.owner.map_or(HostToken(0), |owner| owner.token);
        self.has_described = true;
        put(CAPABILITIES, sequence, &capabilities(&self.parameters, listens_to), &mut self.frame);
        let _ = self.link.send(self.frame.as_slice());
    }

    /// The command whose force this period's sample can show.
    fn echoed(&self) -> Taken {
        let back =
            u64::from(self.sample.delay_ticks + LAG_TICKS).min(TAKEN as u64 - 1).min(self.n_steps);
        let slot = ((self.n_steps - back) % TAKEN as u64) as usize;
        self.taken.get(slot).copied().unwrap_or_default()
    }

    fn send_state(&mut self, now_s: f64) {
        let Taken { sequence: echo, at_s } = self.echoed();
        let payload = state(&StateContent {
            sample: &self.sample,
            now_s,
            echo,
            echo_age_s: at_s.map(|at_s| now_s - at_s),
            mode: self.mode,
            error: if self.error == 0 { self.reported_error() } else { self.error },
        });
        self.sequence = self.sequence.wrapping_add(1);
        put(STATE, self.sequence, &payload, &mut self.frame);
        // Full or gone: the next one says more.
        let _ = self.link.send(self.frame.as_slice());
    }

    /// What is sent of the arm while nothing pushes. An arm without a zero says so by its flag.
    fn reported_error(&self) -> u8 {
        match self.arm_error() {
            NOT_HOMED => 0,
            error => error,
        }
    }
}

/// The vector, shortened to `limit`, direction kept.
fn limited(vector: DVec3, limit: f64) -> DVec3 {
    let length = vector.length();
    if length > limit { vector * (limit / length) } else { vector }
}

/// `from` moved straight towards `to` by at most `step`.
fn towards(from: DVec3, to: DVec3, step: f64) -> DVec3 {
    let change = to - from;
    let length = change.length();
    if length <= step { to } else { from + change * (step / length) }
}

#[cfg(test)]
mod tests;
