//! The arm's side of `open6`: the state machine of `docs/reference/protocol.md`, as the reference
//! for firmware.
//!
//! ```text
//!            HELLO                 enable, homed               no COMMAND for the watchdog time
//!  SILENT ──────────► DISABLED ──────────────────► ENABLED ──────────────────────────────────► TRIPPED
//!                        ▲  ▲     enable clear, STOP   │  number that is none ──► ERROR 2          │
//!                        │  └──────────────────────────┘                            │ enable clear │ enable clear
//!                        └─────────────────────────────────────────────────────────┴──────────────┘
//! ```
//! HELLO leads to DISABLED from everywhere. Motors are driven in ENABLED alone.

use super::number::{f32_at, u16_at};
use super::open6::{
    ANGULAR_STEPS, CAPABILITIES, CAPABILITIES_LEN, COMMAND, COMMAND_LEN, ENABLED, HELLO, HELLO_LEN,
    HOMED, LINEAR_STEPS, MAGIC, MAJOR, MINOR, Packet, Packets, REPORT, STATE, STATE_WITH_TWIST_LEN,
    STOP, TRIPPED, bits_of, put_packet,
};
use super::{ArmReadings, Firmware, MAX_AXES, Open6Arm, Outbox};
use crate::transport::{Carriage, Frame};

/// Error codes of a state.
const NOT_HOMED: u8 = 1;
const NOT_FINITE: u8 = 2;

/// Sends a twist with every state.
const SENDS_TWIST: u8 = 1;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Mode {
    Silent,
    Disabled,
    Enabled,
    Tripped,
    /// A command was senseless; motors stay off until one without enable.
    Refusing,
}

/// The arm's side.
#[derive(Debug)]
pub(crate) struct ArmFirmware {
    arm: Open6Arm,
    carriage: Carriage,
    packets: Packets,
    mode: Mode,
    motors: [f64; MAX_AXES],
    watchdog_ms: u16,
    fed_s: f64,
    echo: u16,
    sequence: u16,
    error: u8,
}

impl ArmFirmware {
    pub(crate) fn new(arm: Open6Arm, carriage: Carriage) -> Self {
        let watchdog_ms = arm.watchdog_ms;
        let packets = Packets::new(carriage);
        Self {
            arm,
            carriage,
            packets,
            mode: Mode::Silent,
            motors: [0.0; MAX_AXES],
            watchdog_ms,
            fed_s: 0.0,
            echo: 0,
            sequence: 0,
            error: 0,
        }
    }

    fn send(&self, kind: u8, sequence: u16, payload: &[u8], out: &mut Outbox) {
        let mut frame = Frame::default();
        put_packet(self.carriage, false, kind, sequence, payload, &mut frame);
        out.push(frame.as_slice().to_vec());
    }

    /// Takes bytes of the host; whether it is owed a [`Self::state`]. An arm whose sensors are slow
    /// sets its motors in between.
    pub(crate) fn hear(&mut self, bytes: &[u8], now_s: f64, homed: bool, out: &mut Outbox) -> bool {
        let mut owes = false;
        for (kind, sequence, payload) in self.packets_of(bytes) {
            owes |= self.take(Packet { kind, sequence, payload: &payload }, now_s, homed, out);
        }
        owes
    }

    fn packets_of(&mut self, bytes: &[u8]) -> Vec<(u8, u16, Vec<u8>)> {
        let bytes = match (self.carriage, bytes) {
            (Carriage::Reports, [0, report @ ..]) if report.len() == REPORT => report,
            _ => bytes,
        };
        let mut found = Vec::new();
        self.packets.feed(bytes, |packet| {
            found.push((packet.kind, packet.sequence, packet.payload.to_vec()))
        });
        found
    }

    /// Its watchdog.
    pub(crate) fn watch(&mut self, now_s: f64) {
        if self.mode == Mode::Enabled && now_s - self.fed_s > f64::from(self.watchdog_ms) * 1e-3 {
            self.mode = Mode::Tripped;
            self.motors = [0.0; MAX_AXES];
        }
    }

    /// The host has enabled the motors, and nothing has switched them off since.
    pub(crate) fn is_enabled(&self) -> bool {
        self.mode == Mode::Enabled
    }

    /// Takes one packet; whether a state is owed.
    fn take(&mut self, packet: Packet<'_>, now_s: f64, homed: bool, out: &mut Outbox) -> bool {
        let Packet { kind, sequence, payload } = packet;
        match kind {
            HELLO if payload.len() >= HELLO_LEN && payload[..4] == MAGIC => {
                // Another major version gets our version and nothing else.
                self.mode = if payload[4] == MAJOR { Mode::Disabled } else { Mode::Silent };
                self.motors = [0.0; MAX_AXES];
                (self.echo, self.error) = (0, 0);
                let asked = u16_at(payload, 6);
                self.watchdog_ms =
                    if asked == 0 { self.arm.watchdog_ms } else { asked.min(self.arm.watchdog_ms) };
                self.describe(sequence, out);
                return false;
            }
            COMMAND if payload.len() >= COMMAND_LEN && self.mode != Mode::Silent => {
                self.echo = sequence;
                self.fed_s = now_s;
                self.command(payload, homed);
            }
            STOP if self.mode != Mode::Silent => {
                self.echo = sequence;
                self.motors = [0.0; MAX_AXES];
                (self.mode, self.error) = (Mode::Disabled, 0);
            }
            _ => return false,
        }
        true
    }

    fn command(&mut self, payload: &[u8], homed: bool) {
        let enable = payload[28] & 1 != 0;
        let wrench: [f64; 7] = core::array::from_fn(|idx| f64::from(f32_at(payload, 4 * idx)));
        self.motors = [0.0; MAX_AXES];
        if !enable {
            (self.mode, self.error) = (Mode::Disabled, 0);
            return;
        }
        if !matches!(self.mode, Mode::Disabled | Mode::Enabled) {
            return;
        }
        if !wrench.iter().all(|number| number.is_finite()) {
            (self.mode, self.error) = (Mode::Refusing, NOT_FINITE);
            return;
        }
        if !homed {
            (self.mode, self.error) = (Mode::Disabled, NOT_HOMED);
            return;
        }
        (self.mode, self.error) = (Mode::Enabled, 0);
        // Limits by magnitude, direction kept; axes without a motor take nothing.
        for (axes, limit) in [(0..3, self.arm.force_n), (3..6, self.arm.torque_nm)] {
            let driven = axes
                .clone()
                .map(|axis| if self.arm.actuated.has(axis) { wrench[axis] } else { 0.0 });
            let norm = driven.clone().map(|component| component * component).sum::<f64>().sqrt();
            let scale = if norm > f64::from(limit) { f64::from(limit) / norm } else { 1.0 };
            for (axis, component) in axes.zip(driven) {
                self.motors[axis] = component * scale;
            }
        }
        self.motors[6] = if self.arm.actuated.has(6) { wrench[6] } else { 0.0 };
    }

    fn describe(&self, sequence: u16, out: &mut Outbox) {
        let Open6Arm {
            name,
            sensed,
            actuated,
            rate_hz,
            force_n,
            torque_nm,
            workspace_radius_m,
            ..
        } = &self.arm;
        let mut payload = vec![MAJOR, MINOR, bits_of(*sensed), bits_of(*actuated)];
        payload.extend(rate_hz.to_le_bytes());
        payload.extend(self.watchdog_ms.to_le_bytes());
        for limit in [force_n, torque_nm, workspace_radius_m] {
            payload.extend(limit.to_le_bytes());
        }
        payload.extend([16, SENDS_TWIST]);
        payload.extend(name.bytes().take(Open6Arm::NAME_MAX));
        payload.resize(CAPABILITIES_LEN, 0);
        self.send(CAPABILITIES, sequence, &payload, out);
    }

    /// Appends a state. `fault`: an error code of the arm's own; 0: none.
    pub(crate) fn state(&mut self, now_s: f64, arm: &ArmReadings, fault: u8, out: &mut Outbox) {
        let mut payload = Vec::with_capacity(STATE_WITH_TWIST_LEN);
        for reading in &arm.readings {
            payload.extend((*reading as f32).to_le_bytes());
        }
        payload.extend(((now_s * 1e6) as u64 as u32).to_le_bytes());
        payload.extend(self.echo.to_le_bytes());
        payload.extend((arm.buttons as u16).to_le_bytes());
        let flag = |bit: u8, is_set: bool| if is_set { bit } else { 0 };
        payload.push(
            flag(HOMED, arm.homed)
                | flag(ENABLED, self.mode == Mode::Enabled)
                | flag(TRIPPED, self.mode == Mode::Tripped),
        );
        payload.push(if self.error == 0 { fault } else { self.error });
        for (idx, rate) in arm.rates[..6].iter().enumerate() {
            let steps = if idx < 3 { LINEAR_STEPS } else { ANGULAR_STEPS };
            payload.extend(((rate * steps).round() as i16).to_le_bytes());
        }
        self.sequence = self.sequence.wrapping_add(1);
        self.send(STATE, self.sequence, &payload, out);
    }
}

impl Firmware for ArmFirmware {
    fn receive(&mut self, bytes: &[u8], now_s: f64, arm: &ArmReadings, out: &mut Outbox) {
        for (kind, sequence, payload) in self.packets_of(bytes) {
            if self.take(Packet { kind, sequence, payload: &payload }, now_s, arm.homed, out) {
                self.state(now_s, arm, 0, out);
            }
        }
    }

    fn advance(&mut self, now_s: f64, _: &ArmReadings, _: &mut Outbox) {
        self.watch(now_s);
    }

    fn motors(&self) -> [f64; MAX_AXES] {
        self.motors
    }
}
