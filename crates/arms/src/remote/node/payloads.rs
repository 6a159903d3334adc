//! What a node says, byte by byte: CAPABILITIES when it is greeted, STATE in every period
//! (`docs/reference/protocol.md`, sections 5 and 11).

use super::NodeParameters;
use crate::protocol::open6::{
    ANGULAR_STEPS, CAPABILITIES_LEN, ENABLED, HOMED, LINEAR_STEPS, MAJOR, TRIPPED, bits_of,
};
use crate::remote::figures::LinkPhase;
use crate::remote::packets::{
    CAPABILITIES_1_1_LEN, CAPABILITIES_TOKEN, HostToken, MINOR, NO_AGE, STATE_1_1_LEN, STATE_AGE,
    put_timing,
};
use vps::spatial::DeviceSample;

/// Buttons that fit into a state.
const BUTTONS: u8 = 16;

/// What the arm is, and which host is listened to.
pub(super) fn capabilities(
    parameters: &NodeParameters,
    listens_to: HostToken,
) -> [u8; CAPABILITIES_1_1_LEN] {
    let NodeParameters {
        name,
        sensed,
        actuated,
        period_s,
        force_limit_n,
        torque_limit_nm,
        workspace_radius_m,
        timing,
        ..
    } = parameters;
    let mut payload = [0; CAPABILITIES_1_1_LEN];
    payload[..4].copy_from_slice(&[MAJOR, MINOR, bits_of(*sensed), bits_of(*actuated)]);
    payload[4..6].copy_from_slice(&((1.0 / period_s).round() as u16).to_le_bytes());
    for (at, number) in [(8, force_limit_n), (12, torque_limit_nm), (16, workspace_radius_m)] {
        payload[at..at + 4].copy_from_slice(&(*number as f32).to_le_bytes());
    }
    payload[20] = BUTTONS;
    put_timing(timing, &mut payload);
    let n = name.len().min(CAPABILITIES_LEN - 22);
    payload[22..22 + n].copy_from_slice(&name.as_bytes()[..n]);
    payload[CAPABILITIES_TOKEN..].copy_from_slice(&listens_to.0.to_le_bytes());
    payload
}

/// What a state message says.
pub(super) struct StateContent<'n> {
    pub(super) sample: &'n DeviceSample,
    pub(super) now_s: f64,
    /// Number of the command whose force the sample can show, and how long ago that was taken, s.
    pub(super) echo: u16,
    pub(super) echo_age_s: Option<f64>,
    pub(super) mode: LinkPhase,
    pub(super) error: u8,
}

/// Where the arm is, and what became of the commands.
pub(super) fn state(content: &StateContent<'_>) -> [u8; STATE_1_1_LEN] {
    let StateContent { sample, now_s, echo, echo_age_s, mode, error } = *content;
    let place = sample.pose.translation;
    let turn = sample.pose.rotation;
    let numbers = [place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w, sample.grip_rad];
    let mut payload = [0; STATE_1_1_LEN];
    for (four, number) in payload.as_chunks_mut::<4>().0.iter_mut().zip(numbers) {
        *four = (number as f32).to_le_bytes();
    }
    payload[32..36].copy_from_slice(&micros(now_s).to_le_bytes());
    payload[36..38].copy_from_slice(&echo.to_le_bytes());
    payload[38..40].copy_from_slice(&(sample.buttons as u16).to_le_bytes());
    let flag = |bit: u8, is_set: bool| if is_set { bit } else { 0 };
    payload[40] = flag(HOMED, sample.homed)
        | flag(ENABLED, mode == LinkPhase::Enabled)
        | flag(TRIPPED, mode == LinkPhase::Tripped);
    payload[41] = error;
    let rates = [(sample.twist.linear, LINEAR_STEPS), (sample.twist.angular, ANGULAR_STEPS)];
    for (idx, (vector, steps)) in rates.into_iter().enumerate() {
        for (axis, rate) in vector.to_array().into_iter().enumerate() {
            let at = 42 + 6 * idx + 2 * axis;
            // The cast saturates, and makes zero of what is no number.
            payload[at..at + 2].copy_from_slice(&((rate * steps).round() as i16).to_le_bytes());
        }
    }
    let age = echo_age_s.map_or(NO_AGE, |age_s| (age_s * 1e6).round() as u32);
    payload[STATE_AGE..].copy_from_slice(&age.to_le_bytes());
    payload
}

/// Time on the wire: µs, wraps.
fn micros(now_s: f64) -> u32 {
    (now_s * 1e6).round() as u64 as u32
}
