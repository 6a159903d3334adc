//! What open6 1.2 adds to the payloads of 1.0 (`docs/reference/protocol.md`, section 11). A packet
//! fills a report of 64 bytes, which is one datagram.

use super::command_hold::HoldTiming;
use crate::protocol::number::u16_at;
use crate::protocol::open6::{
    CAPABILITIES_LEN, COMMAND_LEN, HELLO_LEN, Packets, STATE_WITH_TWIST_LEN, put_packet,
};
use crate::transport::{Carriage, Frame};

/// Minor version over a network.
pub(super) const MINOR: u8 = 2;

/// Where the token of the host stands: in HELLO, COMMAND, STOP and CAPABILITIES.
pub(super) const HELLO_TOKEN: usize = HELLO_LEN;
pub(super) const COMMAND_TOKEN: usize = COMMAND_LEN;
pub(super) const STOP_TOKEN: usize = 0;
pub(super) const CAPABILITIES_TOKEN: usize = CAPABILITIES_LEN;
/// Where a state says how old the echoed command was when the arm was measured, µs.
pub(super) const STATE_AGE: usize = STATE_WITH_TWIST_LEN;

pub(super) const HELLO_1_1_LEN: usize = HELLO_TOKEN + 4;
pub(super) const COMMAND_1_1_LEN: usize = COMMAND_TOKEN + 4;
pub(super) const CAPABILITIES_1_1_LEN: usize = CAPABILITIES_TOKEN + 4;
pub(super) const STATE_1_1_LEN: usize = STATE_AGE + 4;

/// Where CAPABILITIES has open6's watchdog, ms: hold and fade together.
const WATCHDOG: usize = 6;
/// Where it says for how long force is held, ms: the seven bits above the flag of a twist.
const HOLD: usize = 21;
const WITH_TWIST: u8 = 1;
const HOLD_MAX_MS: u8 = 127;

/// No command was taken yet.
pub(super) const NO_AGE: u32 = u32::MAX;

/// Who speaks: the upper half is the process, the lower one counts its greetings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct HostToken(pub(super) u32);

impl HostToken {
    pub(super) fn is_of_process(self, other: Self) -> bool {
        self.0 >> 16 == other.0 >> 16
    }

    /// The same process, another greeting.
    pub(super) fn next(self) -> Self {
        Self(self.0 & 0xFFFF_0000 | self.0.wrapping_add(1) & 0xFFFF)
    }
}

/// The number at that place, if the payload is that long.
pub(super) fn u32_at(payload: &[u8], at: usize) -> Option<u32> {
    payload.get(at..at + 4)?.try_into().ok().map(u32::from_le_bytes)
}

pub(super) fn token_at(payload: &[u8], at: usize) -> Option<HostToken> {
    u32_at(payload, at).map(HostToken)
}

/// True for a packet that is newer than the newest one so far. Counters wrap; half of their range
/// is ahead, half behind.
pub(super) fn steps_ahead(newest: u16, sequence: u16) -> Option<u16> {
    let steps = sequence.wrapping_sub(newest);
    (1..=u16::MAX / 2).contains(&steps).then_some(steps)
}

/// Writes into CAPABILITIES how long a force outlives its command, and that a twist comes with each
/// state.
pub(super) fn put_timing(timing: &HoldTiming, payload: &mut [u8; CAPABILITIES_1_1_LEN]) {
    let hold_ms = ((timing.hold_s * 1e3).round() as u8).min(HOLD_MAX_MS);
    // Up: it is never longer than is said. Less than a µs is the rounding of a sum.
    let all_ms = ((timing.hold_s + timing.fade_s) * 1e3 - 1e-3).ceil() as u16;
    payload[WATCHDOG..WATCHDOG + 2].copy_from_slice(&all_ms.to_le_bytes());
    payload[HOLD] = WITH_TWIST | hold_ms << 1;
}

/// The same, read: how long force is held, and how long it lasts in all, ms.
pub(super) fn timing_at(payload: &[u8]) -> (u16, u16) {
    (u16::from(payload.get(HOLD).copied().unwrap_or(0) >> 1), u16_at(payload, WATCHDOG))
}

/// A reader of datagrams.
pub(super) fn reader() -> Packets {
    Packets::new(Carriage::Reports)
}

/// Makes a datagram of a packet.
pub(super) fn put(kind: u8, sequence: u16, payload: &[u8], frame: &mut Frame) {
    frame.clear();
    put_packet(Carriage::Reports, false, kind, sequence, payload, frame);
}
