//! What crosses between the loop and the threads of the link: little-endian, of fixed length,
//! reported apart by the first byte.
//!
//! | record | bytes |
//! |---|---|
//! | command | `f`, force x y z as f64, N, native |
//! | state | `s`, position x y z in m and orientation x y z w as f64, buttons as u32, homed, error |
//! | greeting | `g`, a line for people, then lines of what changes the force that is felt |
//! | gone | `-`: the service runs, and the arm is not with it any more |
//! | garbled | `x`: a message that made no sense |

use super::super::number::i32_at;
use crate::transport::{FRAME_MAX, Frame};

pub(crate) const COMMAND: u8 = b'f';
const STATE: u8 = b's';
const GREETING: u8 = b'g';
const GONE: u8 = b'-';
const GARBLED: u8 = b'x';

pub(super) const COMMAND_LEN: usize = 1 + 3 * 8;
const STATE_LEN: usize = 1 + 7 * 8 + 4 + 2;

/// A state, as far as an arm needs it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct State {
    /// Position, m, and orientation x y z w, native. Not a number where the service sent none.
    pub(super) pose: [f64; 7],
    pub(super) buttons: u32,
    pub(super) homed: bool,
    /// 0: none.
    pub(super) error: u8,
}

fn f64_at(record: &[u8], at: usize) -> f64 {
    record
        .get(at..)
        .and_then(|rest| rest.first_chunk())
        .map_or(f64::NAN, |bytes| f64::from_le_bytes(*bytes))
}

/// What a record says to the loop.
pub(super) enum Heard<'a> {
    State(State),
    Greeting(&'a str),
    Garbled,
}

impl State {
    pub(super) fn record(&self) -> Vec<u8> {
        let mut record = vec![STATE];
        record.extend(self.pose.iter().flat_map(|number| number.to_le_bytes()));
        record.extend(self.buttons.to_le_bytes());
        record.extend([u8::from(self.homed), self.error]);
        record
    }
}

/// The record of a greeting, cut to what fits.
pub(crate) fn greeting(text: &str) -> Vec<u8> {
    let mut end = text.len().min(FRAME_MAX - 1);
    while !text.is_char_boundary(end) {
        end -= 1;
    }
    [&[GREETING], &text.as_bytes()[..end]].concat()
}

pub(super) fn gone() -> Vec<u8> {
    vec![GONE]
}

/// The arm has left the service.
pub(crate) fn is_gone(record: &[u8]) -> bool {
    record == [GONE]
}

pub(super) fn garbled() -> Vec<u8> {
    vec![GARBLED]
}

/// Makes the record of a command. RT: safe.
pub(super) fn put_command(force_n: [f64; 3], frame: &mut Frame) {
    frame.clear();
    frame.push(COMMAND);
    for component in force_n {
        frame.extend(&(if component.is_finite() { component } else { 0.0 }).to_le_bytes());
    }
}

/// The force of a command, N; `None` for another record.
pub(super) fn force_of(record: &[u8]) -> Option<[f64; 3]> {
    (record.len() == COMMAND_LEN && record[0] == COMMAND)
        .then(|| [0, 1, 2].map(|idx| f64_at(record, 1 + 8 * idx)))
}

/// Reads what came from the link. RT: safe.
pub(super) fn heard(record: &[u8]) -> Heard<'_> {
    match record {
        [STATE, ..] if record.len() == STATE_LEN => {
            let [homed, error] = [record[STATE_LEN - 2], record[STATE_LEN - 1]];
            let pose = core::array::from_fn(|idx| f64_at(record, 1 + 8 * idx));
            Heard::State(State {
                pose,
                buttons: i32_at(record, 57).cast_unsigned(),
                homed: homed != 0,
                error,
            })
        }
        [GREETING, text @ ..] => str::from_utf8(text).map_or(Heard::Garbled, Heard::Greeting),
        _ => Heard::Garbled,
    }
}
