//! One description of a message, three uses: its schema, its bytes, and the way back.
//!
//! Messages are protobuf. Every field is written, also where it is zero: the usual encoders leave out what equals zero, and minus zero does.
//! Numbers of fields follow from their order, so a field is only ever added at the end of its message.

use glam::{DQuat, DVec3};

use vps::spatial::{Pose, Twist, Wrench};

/// What a description is walked with.
pub(super) trait Fields: Sized {
    /// A number, every bit of it.
    fn double(&mut self, name: &'static str, value: &mut f64);

    /// A whole number of a [`Kind`].
    fn whole(&mut self, name: &'static str, kind: Kind, value: &mut u64);

    /// One of several words: its place among them.
    fn word(&mut self, name: &'static str, words: &Words, place: &mut u64);

    /// A text.
    fn text(&mut self, name: &'static str, value: &mut String);

    /// A message within the message; a `type_name` of another package is known already.
    fn message<T>(&mut self, name: &'static str, type_name: &'static str, value: &mut T, body: impl Fn(&mut Self, &mut T));

    /// A field that may be missing; `inner` writes that one field.
    fn optional<T: Copy + Default>(&mut self, value: &mut Option<T>, inner: impl Fn(&mut Self, &mut T));

    /// A whole number of any width that is not signed.
    fn count<T: Copy + Into<u64> + TryFrom<u64>>(&mut self, name: &'static str, value: &mut T) {
        let kind = if size_of::<T>() < 8 { Kind::Short } else { Kind::Long };
        let mut wide: u64 = (*value).into();
        self.whole(name, kind, &mut wide);
        if let Ok(narrow) = T::try_from(wide) {
            *value = narrow;
        }
    }

    /// A yes or no.
    fn flag(&mut self, name: &'static str, value: &mut bool) {
        let mut wide = u64::from(*value);
        self.whole(name, Kind::Flag, &mut wide);
        *value = wide != 0;
    }

    /// One of several values that have names.
    fn choice<T: Copy + PartialEq>(
        &mut self,
        name: &'static str,
        type_name: &'static str,
        all: &[(T, &'static str)],
        value: &mut T,
    ) {
        let names: Vec<&'static str> = all.iter().map(|(_, name)| *name).collect();
        let mut place = all.iter().position(|(known, _)| known == value).unwrap_or(0) as u64;
        self.word(name, &Words { type_name, names: &names }, &mut place);
        if let Some((known, _)) = usize::try_from(place).ok().and_then(|place| all.get(place)) {
            *value = *known;
        }
    }

    /// Three numbers.
    fn vector(&mut self, name: &'static str, value: &mut DVec3) {
        self.message(name, ".foxglove.Vector3", value, |f, v| {
            f.double("x", &mut v.x);
            f.double("y", &mut v.y);
            f.double("z", &mut v.z);
        });
    }

    /// A pose.
    fn pose(&mut self, name: &'static str, value: &mut Pose) {
        self.message(name, ".foxglove.Pose", value, |f, pose| {
            f.vector("position", &mut pose.translation);
            f.message("orientation", ".foxglove.Quaternion", &mut pose.rotation, |f, q: &mut DQuat| {
                f.double("x", &mut q.x);
                f.double("y", &mut q.y);
                f.double("z", &mut q.z);
                f.double("w", &mut q.w);
            });
        });
    }

    /// Velocities, m/s and rad/s.
    fn twist(&mut self, names: [&'static str; 2], value: &mut Twist) {
        self.vector(names[0], &mut value.linear);
        self.vector(names[1], &mut value.angular);
    }

    /// A force, N, and a torque, N·m.
    fn wrench(&mut self, names: [&'static str; 2], value: &mut Wrench) {
        self.vector(names[0], &mut value.force);
        self.vector(names[1], &mut value.torque);
    }
}

/// Whole numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// Up to 32 bits.
    Short,
    /// Up to 64 bits.
    Long,
    /// 64 bits, two's complement.
    Signed,
    /// Yes or no.
    Flag,
}

/// The words of an enumeration, in the order of their numbers.
pub(super) struct Words<'w> {
    pub(super) type_name: &'static str,
    pub(super) names: &'w [&'static str],
}

const VARINT: u64 = 0;
const FIXED64: u64 = 1;
const BYTES: u64 = 2;
const FIXED32: u64 = 5;

/// Writes a message.
#[derive(Debug, Default)]
pub(super) struct Writer {
    bytes: Vec<u8>,
    n_fields: u64,
}

impl Writer {
    /// What was written.
    pub(super) fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// Begins another message.
    pub(super) fn clear(&mut self) {
        self.bytes.clear();
        self.n_fields = 0;
    }

    /// The next field, by its place.
    fn next(&mut self, wire: u64) {
        self.n_fields += 1;
        varint(&mut self.bytes, self.n_fields << 3 | wire);
    }

    /// A field with a number of its own: of messages that somebody else has laid out.
    pub(super) fn number(&mut self, field: u64, value: u64) {
        varint(&mut self.bytes, field << 3 | VARINT);
        varint(&mut self.bytes, value);
    }

    /// The same for bytes.
    pub(super) fn block(&mut self, field: u64, value: &[u8]) {
        varint(&mut self.bytes, field << 3 | BYTES);
        varint(&mut self.bytes, value.len() as u64);
        self.bytes.extend_from_slice(value);
    }
}

fn varint(bytes: &mut Vec<u8>, mut value: u64) {
    while value >= 0x80 {
        bytes.push(value as u8 | 0x80);
        value >>= 7;
    }
    bytes.push(value as u8);
}

impl Fields for Writer {
    fn double(&mut self, _: &'static str, value: &mut f64) {
        self.next(FIXED64);
        self.bytes.extend_from_slice(&value.to_le_bytes());
    }

    fn whole(&mut self, _: &'static str, _: Kind, value: &mut u64) {
        self.next(VARINT);
        varint(&mut self.bytes, *value);
    }

    fn word(&mut self, name: &'static str, _: &Words, place: &mut u64) {
        self.whole(name, Kind::Short, place);
    }

    fn text(&mut self, _: &'static str, value: &mut String) {
        self.next(BYTES);
        varint(&mut self.bytes, value.len() as u64);
        self.bytes.extend_from_slice(value.as_bytes());
    }

    fn message<T>(&mut self, _: &'static str, _: &'static str, value: &mut T, body: impl Fn(&mut Self, &mut T)) {
        self.next(BYTES);
        let (begin, outer) = (self.bytes.len(), core::mem::take(&mut self.n_fields));
        body(self, value);
        self.n_fields = outer;
        let mut length = Vec::new();
        varint(&mut length, (self.bytes.len() - begin) as u64);
        self.bytes.splice(begin..begin, length);
    }

    fn optional<T: Copy + Default>(&mut self, value: &mut Option<T>, inner: impl Fn(&mut Self, &mut T)) {
        match value {
            Some(value) => inner(self, value),
            None => self.n_fields += 1,
        }
    }
}

/// Something that is no message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Garbled;

#[derive(Clone, Copy)]
enum Value<'b> {
    Number(u64),
    Bytes(&'b [u8]),
}

/// Reads a message. What it lacks keeps its value: it was written before that field was there.
pub(super) struct Reader<'b> {
    fields: Vec<(u64, Value<'b>)>,
    n_fields: u64,
    is_garbled: bool,
}

impl<'b> Reader<'b> {
    /// # Errors
    /// The bytes are no message.
    pub(super) fn new(mut bytes: &'b [u8]) -> Result<Self, Garbled> {
        let mut fields = Vec::new();
        while !bytes.is_empty() {
            let tag = take_varint(&mut bytes)?;
            let value = match tag & 7 {
                VARINT => Value::Number(take_varint(&mut bytes)?),
                FIXED64 => {
                    let (number, rest) = bytes.split_first_chunk().ok_or(Garbled)?;
                    bytes = rest;
                    Value::Number(u64::from_le_bytes(*number))
                }
                FIXED32 => {
                    let (number, rest) = bytes.split_first_chunk().ok_or(Garbled)?;
                    bytes = rest;
                    Value::Number(u64::from(u32::from_le_bytes(*number)))
                }
                BYTES => {
                    let length = usize::try_from(take_varint(&mut bytes)?).map_err(|_| Garbled)?;
                    let (block, rest) = bytes.split_at_checked(length).ok_or(Garbled)?;
                    bytes = rest;
                    Value::Bytes(block)
                }
                _ => return Err(Garbled),
            };
            fields.push((tag >> 3, value));
        }
        Ok(Self { fields, n_fields: 0, is_garbled: false })
    }

    /// After the description was walked.
    ///
    /// # Errors
    /// A field was not what the description says.
    pub(super) fn finish(self) -> Result<(), Garbled> {
        if self.is_garbled { Err(Garbled) } else { Ok(()) }
    }

    fn peek(&self) -> Option<Value<'b>> {
        let number = self.n_fields + 1;
        // The last one counts, as protobuf has it.
        self.fields.iter().rev().find(|(field, _)| *field == number).map(|(_, value)| *value)
    }

    fn next_number(&mut self) -> Option<u64> {
        let value = self.peek();
        self.n_fields += 1;
        match value {
            Some(Value::Number(number)) => Some(number),
            Some(Value::Bytes(_)) => {
                self.is_garbled = true;
                None
            }
            None => None,
        }
    }

    fn next_bytes(&mut self) -> Option<&'b [u8]> {
        let value = self.peek();
        self.n_fields += 1;
        match value {
            Some(Value::Bytes(bytes)) => Some(bytes),
            Some(Value::Number(_)) => {
                self.is_garbled = true;
                None
            }
            None => None,
        }
    }
}

fn take_varint(bytes: &mut &[u8]) -> Result<u64, Garbled> {
    let mut value = 0_u64;
    for shift in (0..64).step_by(7) {
        let (byte, rest) = bytes.split_first().ok_or(Garbled)?;
        *bytes = rest;
        value |= u64::from(byte & 0x7f) << shift;
        if byte & 0x80 == 0 {
            return Ok(value);
        }
    }
    Err(Garbled)
}

impl Fields for Reader<'_> {
    fn double(&mut self, _: &'static str, value: &mut f64) {
        if let Some(bits) = self.next_number() {
            *value = f64::from_bits(bits);
        }
    }

    fn whole(&mut self, _: &'static str, _: Kind, value: &mut u64) {
        if let Some(number) = self.next_number() {
            *value = number;
        }
    }

    fn word(&mut self, name: &'static str, words: &Words, place: &mut u64) {
        self.whole(name, Kind::Short, place);
        self.is_garbled |= *place >= words.names.len() as u64;
    }

    fn text(&mut self, _: &'static str, value: &mut String) {
        if let Some(bytes) = self.next_bytes() {
            match core::str::from_utf8(bytes) {
                Ok(text) => text.clone_into(value),
                Err(_) => self.is_garbled = true,
            }
        }
    }

    fn message<T>(&mut self, _: &'static str, _: &'static str, value: &mut T, body: impl Fn(&mut Self, &mut T)) {
        let Some(bytes) = self.next_bytes() else { return };
        match Self::new(bytes) {
            Ok(mut inner) => {
                body(&mut inner, value);
                self.is_garbled |= inner.is_garbled;
            }
            Err(Garbled) => self.is_garbled = true,
        }
    }

    fn optional<T: Copy + Default>(&mut self, value: &mut Option<T>, inner: impl Fn(&mut Self, &mut T)) {
        if self.peek().is_none() {
            self.n_fields += 1;
            *value = None;
            return;
        }
        let mut known = T::default();
        inner(self, &mut known);
        *value = Some(known);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Clone, Copy, Debug, Default, PartialEq)]
    enum Colour {
        #[default]
        Red,
        Green,
    }

    #[derive(Clone, Debug, Default)]
    struct Everything {
        number: f64,
        count: u16,
        signed: i64,
        flag: bool,
        colour: Colour,
        missing: Option<u32>,
        there: Option<u32>,
        pose: Pose,
        text: String,
    }

    fn body<F: Fields>(f: &mut F, v: &mut Everything) {
        f.double("number", &mut v.number);
        f.count("count", &mut v.count);
        let mut signed = v.signed.cast_unsigned();
        f.whole("signed", Kind::Signed, &mut signed);
        v.signed = signed.cast_signed();
        f.flag("flag", &mut v.flag);
        f.choice("colour", "Colour", &[(Colour::Red, "RED"), (Colour::Green, "GREEN")], &mut v.colour);
        f.optional(&mut v.missing, |f, v| f.count("missing", v));
        f.optional(&mut v.there, |f, v| f.count("there", v));
        f.pose("pose", &mut v.pose);
        f.text("text", &mut v.text);
    }

    #[test]
    fn every_bit_comes_back() {
        for bits in [0, 1 << 63, 0x7ff8_0000_0000_0001, 0xfff4_dead_beef_0001, f64::INFINITY.to_bits(), 1] {
            let mut written = Everything {
                number: f64::from_bits(bits),
                count: 65_535,
                signed: -3,
                flag: true,
                colour: Colour::Green,
                missing: None,
                there: Some(0),
                pose: Pose::new(DQuat::from_xyzw(-0.0, 0.0, -0.0, 1.0), DVec3::new(f64::MIN_POSITIVE, -0.0, 3.0)),
                text: "a".repeat(300),
            };
            let mut writer = Writer::default();
            body(&mut writer, &mut written);
            let mut read = Everything { missing: Some(3), ..Everything::default() };
            let mut reader = Reader::new(writer.bytes()).expect("a message");
            body(&mut reader, &mut read);
            assert_eq!(reader.finish(), Ok(()));
            assert_eq!(read.number.to_bits(), bits);
            assert_eq!((read.count, read.signed, read.flag, read.colour), (65_535, -3, true, Colour::Green));
            assert_eq!((read.missing, read.there, read.text), (None, Some(0), written.text));
            let bits_of = |pose: Pose| (pose.rotation.to_array().map(f64::to_bits), pose.translation.to_array().map(f64::to_bits));
            assert_eq!(bits_of(read.pose), bits_of(written.pose));
        }
    }

    #[test]
    fn garbage_is_refused_and_never_panics() {
        let mut writer = Writer::default();
        body(&mut writer, &mut Everything { there: Some(7), text: "text".to_owned(), ..Everything::default() });
        let whole = writer.bytes().to_vec();
        for n in 0..whole.len() {
            for byte in [0, 0x7f, 0x80, 0xff] {
                let mut broken = whole.clone();
                broken[n] = byte;
                for bytes in [&broken[..], &broken[..n]] {
                    if let Ok(mut reader) = Reader::new(bytes) {
                        body(&mut reader, &mut Everything::default());
                        let _ = reader.finish();
                    }
                }
            }
        }
        // A colour that nobody knows.
        let mut writer = Writer::default();
        writer.number(5, 9);
        let mut reader = Reader::new(writer.bytes()).expect("a message");
        body(&mut reader, &mut Everything::default());
        assert_eq!(reader.finish(), Err(Garbled));
    }
}
