//! Little-endian plain CDR (`docs/reference/ros2.md`, *Messages as bytes*).

/// The encapsulation header: plain CDR, little-endian.
const ENCAPSULATION: [u8; 4] = [0, 1, 0, 0];

/// Reads one message, field by field.
#[derive(Debug)]
pub(super) struct CdrReader<'a> {
    /// Behind the encapsulation header.
    body: &'a [u8],
    read: usize,
}

impl<'a> CdrReader<'a> {
    /// `None`: no plain CDR in little-endian.
    pub(super) fn new(message: &'a [u8]) -> Option<Self> {
        // The two bytes of options belong to other encodings.
        let (encapsulation, body) = message.split_first_chunk::<4>()?;
        (encapsulation[..2] == ENCAPSULATION[..2]).then_some(Self { body, read: 0 })
    }

    pub(super) fn i32(&mut self) -> Option<i32> {
        self.number().map(i32::from_le_bytes)
    }

    pub(super) fn u32(&mut self) -> Option<u32> {
        self.number().map(u32::from_le_bytes)
    }

    pub(super) fn f64(&mut self) -> Option<f64> {
        self.number().map(f64::from_le_bytes)
    }

    /// Without the zero at its end.
    pub(super) fn string(&mut self) -> Option<&'a str> {
        let length = usize::try_from(self.u32()?).ok()?;
        let (end, text) = self.take(length)?.split_last()?;
        if *end == 0 { core::str::from_utf8(text).ok() } else { None }
    }

    fn number<const N: usize>(&mut self) -> Option<[u8; N]> {
        self.read = self.read.next_multiple_of(N);
        self.take(N)?.try_into().ok()
    }

    fn take(&mut self, length: usize) -> Option<&'a [u8]> {
        let taken = self.body.get(self.read..)?.get(..length)?;
        self.read += length;
        Some(taken)
    }
}

/// Writes one message, field by field.
#[derive(Debug)]
pub(super) struct CdrWriter {
    bytes: Vec<u8>,
}

impl CdrWriter {
    /// An empty message.
    pub(super) fn new() -> Self {
        Self { bytes: ENCAPSULATION.to_vec() }
    }

    /// Its bytes, encapsulation header included.
    pub(super) fn finish(self) -> Vec<u8> {
        self.bytes
    }

    pub(super) fn u8(&mut self, value: u8) {
        self.bytes.push(value);
    }

    pub(super) fn bool(&mut self, value: bool) {
        self.u8(value.into());
    }

    pub(super) fn i32(&mut self, value: i32) {
        self.number(value.to_le_bytes());
    }

    pub(super) fn u32(&mut self, value: u32) {
        self.number(value.to_le_bytes());
    }

    pub(super) fn f32(&mut self, value: f32) {
        self.number(value.to_le_bytes());
    }

    pub(super) fn f64(&mut self, value: f64) {
        self.number(value.to_le_bytes());
    }

    /// Length with the end, the bytes, and a zero as the end.
    pub(super) fn string(&mut self, text: &str) {
        self.u32(text.len() as u32 + 1);
        self.bytes.extend(text.as_bytes());
        self.u8(0);
    }

    /// Number of the items, and the items. Without any there are no zeros for their alignment
    /// either.
    pub(super) fn sequence<T>(&mut self, items: &[T], mut write: impl FnMut(&mut Self, &T)) {
        self.u32(items.len() as u32);
        items.iter().for_each(|item| write(self, item));
    }

    /// A number of `N` bytes begins at a multiple of `N`, counted from behind the encapsulation
    /// header.
    fn number<const N: usize>(&mut self, little_endian: [u8; N]) {
        let at = self.bytes.len() - ENCAPSULATION.len();
        self.bytes.resize(ENCAPSULATION.len() + at.next_multiple_of(N), 0);
        self.bytes.extend(little_endian);
    }
}
