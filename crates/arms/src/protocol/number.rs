//! Numbers on the wire: rounding, counts that wrap, decimal text. RT: everything here is safe.

use core::fmt;

use crate::transport::Frame;

/// Cuts toward zero to a whole number of at most `limit` either way; what is not a number is 0.
pub(super) fn toward_zero(value: f64, limit: u32) -> i32 {
    let limit = f64::from(limit).min(f64::from(i32::MAX));
    // A cast of NaN is 0.
    value.clamp(-limit, limit) as i32
}

/// As [`toward_zero`], to 16 bits.
pub(super) fn toward_zero_i16(value: f64, limit: i16) -> i16 {
    toward_zero(value, u32::from(limit.unsigned_abs())) as i16
}

/// A number for the wire; 0 for what is none.
pub(crate) fn finite_f32(value: f64) -> f32 {
    let cut = value as f32;
    if cut.is_finite() { cut } else { 0.0 }
}

/// What an encoder counts, cut to the 16 bits of the wire.
pub(super) fn low_16(reading: f64) -> i16 {
    reading.round() as i64 as i16
}

/// What an encoder counts, as far as 32 bits go.
pub(super) fn count_32(reading: f64) -> i32 {
    reading.round() as i32
}

/// A count that the wire cuts to its low bits, made whole again.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Whole {
    last: Option<i64>,
}

impl Whole {
    /// The whole count nearest to the last one whose low `bits` are those of `cut`; the first one
    /// is taken as it is.
    pub(super) fn take(&mut self, cut: i64, bits: u32) -> i64 {
        let whole = match self.last {
            None => cut,
            Some(last) => {
                let shift = 64 - bits.clamp(1, 63);
                // The step, sign-extended from its low bits.
                last.wrapping_add((cut.wrapping_sub(last) << shift) >> shift)
            }
        };
        self.last = Some(whole);
        whole
    }

    /// As [`Self::take`], of 16 bits.
    pub(super) fn take_16(&mut self, cut: i16) -> f64 {
        self.take(i64::from(cut), 16) as f64
    }
}

/// Little-endian i16 at `at`; 0 behind the end.
pub(super) fn i16_at(bytes: &[u8], at: usize) -> i16 {
    bytes.get(at..at + 2).and_then(|two| two.try_into().ok()).map_or(0, i16::from_le_bytes)
}

/// Little-endian u16 at `at`; 0 behind the end.
pub(crate) fn u16_at(bytes: &[u8], at: usize) -> u16 {
    i16_at(bytes, at) as u16
}

/// Little-endian i32 at `at`; 0 behind the end.
pub(super) fn i32_at(bytes: &[u8], at: usize) -> i32 {
    bytes.get(at..at + 4).and_then(|four| four.try_into().ok()).map_or(0, i32::from_le_bytes)
}

/// Little-endian f32 at `at`; 0 behind the end.
pub(crate) fn f32_at(bytes: &[u8], at: usize) -> f32 {
    f32::from_bits(i32_at(bytes, at) as u32)
}

/// Text into a frame, without the heap. What does not fit is left out.
pub(super) struct Text<'a>(pub(super) &'a mut Frame);

impl fmt::Write for Text<'_> {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        if self.0.extend(text.as_bytes()) { Ok(()) } else { Err(fmt::Error) }
    }
}

/// Appends text to a frame.
macro_rules! put {
    ($frame:expr, $($argument:tt)*) => {{
        use core::fmt::Write;
        // A frame that is full keeps what it has; no protocol here writes text that long.
        let _ = write!(crate::protocol::number::Text($frame), $($argument)*);
    }};
}
pub(super) use put;

/// Pads a frame to a length.
pub(super) fn pad(frame: &mut Frame, byte: u8, len: usize) {
    while frame.as_slice().len() < len && frame.push(byte) {}
}

/// The words of a line; a word that is not text is empty, which no number is.
pub(super) fn words(line: &[u8], separator: u8) -> impl Iterator<Item = &str> {
    line.split(move |byte| *byte == separator)
        .filter(move |word| separator != b' ' || !word.is_empty())
        .map(|word| core::str::from_utf8(word).unwrap_or_default())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounding_goes_toward_zero_and_never_wraps() {
        assert_eq!(
            [1.9, -1.9, 4e9, -4e9, f64::NAN, f64::INFINITY].map(|x| toward_zero(x, 4096)),
            [1, -1, 4096, -4096, 0, 4096]
        );
        assert_eq!([1e9, -1e9].map(|x| toward_zero_i16(x, i16::MAX)), [32767, -32767]);
        assert_eq!([1e300, f64::NAN, 0.5].map(finite_f32), [0.0, 0.0, 0.5]);
    }

    #[test]
    fn cut_counts_are_made_whole() {
        let mut whole = Whole::default();
        let steps = [
            32_000_i64, 32_767, 32_768, 40_000, 70_000, 65_536, 40_000, 10_000, -20_000, -40_000,
            -10_000, -100, 0,
        ];
        for count in steps {
            assert_eq!(whole.take_16(count as i16), count as f64);
        }
    }
}
