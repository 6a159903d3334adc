//! Bytes of a stream until a frame is whole. Fixed memory; RT: safe.

/// At most `N` bytes that wait for the rest of their frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct Gather<const N: usize> {
    bytes: [u8; N],
    len: usize,
    /// The bytes are handed out: the next one starts anew.
    taken: bool,
    /// Too long: thrown away up to the next end.
    skips: bool,
}

impl<const N: usize> Default for Gather<N> {
    fn default() -> Self {
        Self { bytes: [0; N], len: 0, taken: false, skips: false }
    }
}

impl<const N: usize> Gather<N> {
    /// What waits.
    pub(super) fn as_slice(&self) -> &[u8] {
        self.bytes.get(..self.len).unwrap_or_default()
    }

    /// As [`Self::as_slice`], to decode in place.
    pub(super) fn as_mut_slice(&mut self) -> &mut [u8] {
        self.bytes.get_mut(..self.len).unwrap_or_default()
    }

    /// Forgets everything.
    pub(super) fn clear(&mut self) {
        *self = Self { bytes: self.bytes, ..Self::default() };
    }

    /// Appends a byte; false when it is full.
    pub(super) fn push(&mut self, byte: u8) -> bool {
        match self.bytes.get_mut(self.len) {
            Some(slot) => {
                *slot = byte;
                self.len += 1;
                true
            }
            None => false,
        }
    }

    /// Drops the first `n` bytes.
    pub(super) fn drop_front(&mut self, n: usize) {
        let n = n.min(self.len);
        self.bytes.copy_within(n..self.len, 0);
        self.len -= n;
    }

    /// Drops what is before the first of `byte`, or everything; how many bytes went.
    pub(super) fn skip_to(&mut self, byte: u8) -> usize {
        let n = self.as_slice().iter().position(|found| *found == byte).unwrap_or(self.len);
        self.drop_front(n);
        n
    }

    /// Takes a byte of frames that end in `end`: `Some(true)`: a frame is whole and stays readable
    /// until the next byte, its end left out; `Some(false)`: a frame was too long and is lost.
    pub(super) fn until(&mut self, end: u8, byte: u8) -> Option<bool> {
        if self.taken {
            self.clear();
        }
        if byte == end {
            self.taken = true;
            return Some(!self.skips);
        }
        if !self.push(byte) {
            self.skips = true;
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_end_where_they_end_and_too_long_ones_are_lost_whole() {
        let mut gather = Gather::<4>::default();
        let mut frames = Vec::new();
        for byte in *b"ab;;12345;cd;" {
            match gather.until(b';', byte) {
                Some(true) => frames.push(String::from_utf8_lossy(gather.as_slice()).into_owned()),
                Some(false) => frames.push("lost".to_owned()),
                None => {}
            }
        }
        assert_eq!(frames, ["ab", "", "lost", "cd"]);
    }
}
