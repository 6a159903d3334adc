//! Frames described as data, for arms of a simple fixed or line layout. The codec for them is
//! `declarative`.
//!
//! A frame is a body in a framing. The body of a binary frame is a fixed number of bytes with
//! fields at offsets, its checksum last; the body of a line is numbers in order.

use super::{MAX_AXES, ProtocolError};
use crate::Pacing;
use crate::transport::{Carriage, FRAME_MAX};

/// Longest body, bytes, the checksum included: stuffing may double it, and it has to fit a
/// [`FRAME_MAX`].
pub(super) const BODY_MAX: usize = 120;

/// Most fields of a packet.
const FIELDS_MAX: usize = 40;

/// Both packets of an arm.
#[derive(Clone, Debug, PartialEq)]
pub struct PacketLayout {
    /// Name of the codec in profiles.
    pub name: &'static str,
    /// What the arm sends.
    pub report: Packet,
    /// Host → arm; `None` for an arm that takes no command.
    pub command: Option<Packet>,
    /// Whole frame that wakes the arm and moves nothing; `None`: a zero command does.
    pub kick: Option<Vec<u8>>,
    /// Who sets the rate.
    pub pacing: Pacing,
    /// After how long without a command the arm drops it; `None`: never.
    pub watchdog_ms: Option<u32>,
}

/// How one packet is laid out.
#[derive(Clone, Debug, PartialEq)]
pub struct Packet {
    /// How it is found among the bytes around it.
    pub framing: Framing,
    /// Its check, in the last bytes of the body.
    pub checksum: Option<Checksum>,
    /// What is in it. Bytes of the body that no field names are 0 when sent and ignored when
    /// received.
    pub fields: Vec<Field>,
}

/// How a packet is found among the bytes around it. `len`: bytes of the body, checksum included.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Framing {
    /// A HID report of exactly `len` bytes beside its ID.
    Report {
        /// Report ID where reports are numbered; `None`: 0 before a write, nothing before a read.
        id: Option<u8>,
        /// Bytes of the body.
        len: usize,
    },
    /// Fixed bytes, then the body.
    Sync {
        /// The fixed bytes, at least one.
        sync: Vec<u8>,
        /// Bytes of the body.
        len: usize,
        /// The checksum covers the fixed bytes too.
        covers_sync: bool,
    },
    /// Consistent overhead byte stuffing, a 0 after each frame.
    Cobs {
        /// Bytes of the body.
        len: usize,
    },
    /// SLIP (RFC 1055): 0xC0 after each frame.
    Slip {
        /// Bytes of the body.
        len: usize,
    },
    /// Numbers as text.
    Line(LineFraming),
}

/// A line of numbers: `open n separator n … close`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LineFraming {
    /// Before the first number, such as `[` or `Prm `; may be empty.
    pub open: String,
    /// Between numbers, such as `,`. Runs of blanks count as one when it is a blank.
    pub separator: u8,
    /// After the last number, such as `]` or a line feed. The last byte of it that is no blank ends
    /// the frame, where there is one, else its last byte. Blanks and NULs between frames are
    /// ignored.
    pub close: String,
    /// Padding of a frame that is sent.
    pub pad: Option<LinePad>,
}

/// Padding of short lines.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LinePad {
    /// What to pad with.
    pub byte: u8,
    /// Least bytes of a frame, padding included.
    pub len: usize,
    /// Pad before `close`, not after it.
    pub before_close: bool,
}

/// Check of a body. Sums and CRCs are sent low byte first unless `big_endian` is set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Checksum {
    /// How it is computed.
    pub kind: ChecksumKind,
    /// High byte first.
    pub big_endian: bool,
}

/// Known checks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ChecksumKind {
    /// Sum of the bytes modulo 256.
    Sum8,
    /// Exclusive or of the bytes.
    Xor8,
    /// CRC-8, polynomial 0x07, start 0 (SMBus).
    Crc8,
    /// CRC-16, polynomial 0x1021, start 0xFFFF, not reflected ("CCITT-FALSE").
    Crc16Ccitt,
    /// CRC-16 of Modbus.
    Crc16Modbus,
    /// CRC-32 of Ethernet and zip.
    Crc32,
}

impl ChecksumKind {
    /// Bytes that it takes.
    pub(crate) const fn n_bytes(self) -> usize {
        match self {
            Self::Sum8 | Self::Xor8 | Self::Crc8 => 1,
            Self::Crc16Ccitt | Self::Crc16Modbus => 2,
            Self::Crc32 => 4,
        }
    }

    /// Its value over some parts in order. RT: safe.
    pub(crate) fn compute(self, parts: [&[u8]; 2]) -> u32 {
        const CRC8: crc::Crc<u8> = crc::Crc::<u8>::new(&crc::CRC_8_SMBUS);
        const CCITT: crc::Crc<u16> = crc::Crc::<u16>::new(&crc::CRC_16_IBM_3740);
        const MODBUS: crc::Crc<u16> = crc::Crc::<u16>::new(&crc::CRC_16_MODBUS);
        const CRC32: crc::Crc<u32> = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC);
        macro_rules! digest {
            ($crc:expr) => {{
                let mut digest = $crc.digest();
                for part in parts {
                    digest.update(part);
                }
                u32::from(digest.finalize())
            }};
        }
        let bytes = || parts.into_iter().flatten().copied();
        match self {
            Self::Sum8 => u32::from(bytes().fold(0_u8, u8::wrapping_add)),
            Self::Xor8 => u32::from(bytes().fold(0_u8, |sum, byte| sum ^ byte)),
            Self::Crc8 => digest!(CRC8),
            Self::Crc16Ccitt => digest!(CCITT),
            Self::Crc16Modbus => digest!(MODBUS),
            Self::Crc32 => digest!(CRC32),
        }
    }
}

/// One value of a packet.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Field {
    /// What the field means.
    pub role: Role,
    /// First byte in the body; of a line, which number, from 0.
    pub offset: usize,
    /// How it is written.
    pub number: Number,
    /// High byte first.
    pub big_endian: bool,
    /// Reading, rate or motor = number · scale. 1 for other roles.
    pub scale: f64,
    /// Bits of a whole number that belong to the field, the lowest of them bit 0 of its value;
    /// `None`: all.
    pub mask: Option<u64>,
    /// The number is the low end of a longer count: made whole again from step to step. Of whole
    /// numbers up to 32 bits, for readings.
    pub wraps: bool,
    /// Largest number of a motor, either way: more is never sent, and moves no arm. `None`: what
    /// the wire holds.
    pub limit: Option<f64>,
}

impl Field {
    /// A field with scale 1, low byte first, no mask.
    pub const fn new(role: Role, offset: usize, number: Number) -> Self {
        Self {
            role,
            offset,
            number,
            big_endian: false,
            scale: 1.0,
            mask: None,
            wraps: false,
            limit: None,
        }
    }
}

/// What a field is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// Report: reading of that index.
    Reading(usize),
    /// Report: rate of the reading of that index, per second.
    Rate(usize),
    /// Report: button bits, the first of them at this bit of the button word.
    Buttons(u8),
    /// Report: counts reports, by one, and wraps: gaps and repeats are seen in it. An unsigned
    /// whole number.
    Counter,
    /// Report: error code, 0: none.
    Error,
    /// Report: other than 0 once the arm has found its zero.
    Homed,
    /// Command: motor of that index.
    Motor(usize),
    /// Command: 1 while force is on.
    Enabled,
    /// Both: always this number; another one makes a report corrupt.
    Constant(i64),
    /// Both: a number of a line that means nothing here; sent as 0.
    Ignored,
}

/// How a number is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[expect(missing_docs, reason = "the names of the types say it")]
pub enum Number {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
    /// Decimal text, of lines only, sent with so many places after the point; 0: whole.
    Text {
        places: u8,
    },
}

impl Number {
    /// Bytes in a body; 0 for text.
    pub(crate) const fn n_bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
            Self::Text { .. } => 0,
        }
    }

    /// Smallest and largest whole number; `None` for floating point.
    pub(crate) const fn range(self) -> Option<(i64, i64)> {
        match self {
            Self::I8 => Some((i8::MIN as i64, i8::MAX as i64)),
            Self::U8 => Some((0, u8::MAX as i64)),
            Self::I16 => Some((i16::MIN as i64, i16::MAX as i64)),
            Self::U16 => Some((0, u16::MAX as i64)),
            Self::I32 | Self::Text { places: 0 } => Some((i32::MIN as i64, i32::MAX as i64)),
            Self::U32 => Some((0, u32::MAX as i64)),
            Self::F32 | Self::F64 | Self::Text { .. } => None,
        }
    }

    /// What two neighbours are apart; 0 for floating point.
    fn step(self) -> f64 {
        match self {
            Self::F32 | Self::F64 => 0.0,
            Self::Text { places } => 10_f64.powi(places.into()).recip(),
            _ => 1.0,
        }
    }

    const fn is_unsigned(self) -> bool {
        matches!(self, Self::U8 | Self::U16 | Self::U32)
    }
}

impl Packet {
    /// Bytes of the body, checksum included; of a line, how many numbers.
    pub(crate) fn n_bytes(&self) -> usize {
        match &self.framing {
            Framing::Report { len, .. }
            | Framing::Sync { len, .. }
            | Framing::Cobs { len }
            | Framing::Slip { len } => *len,
            Framing::Line(_) => self.fields.len(),
        }
    }

    fn check(&self, name: &str, is_report: bool) -> Result<(), String> {
        let checksum_len = self.checksum.map_or(0, |checksum| checksum.kind.n_bytes());
        let is_line = matches!(self.framing, Framing::Line(_));
        if self.fields.is_empty() || self.fields.len() > FIELDS_MAX {
            return Err(format!("{name} has {} fields: 1 to {FIELDS_MAX}", self.fields.len()));
        }
        match &self.framing {
            Framing::Line(line) => {
                if self.checksum.is_some() {
                    return Err(format!("{name} is a line with a checksum: lines have none"));
                }
                line.check(name)?;
            }
            Framing::Sync { sync, .. } if sync.is_empty() || sync.len() > 8 => {
                return Err(format!("{name} starts with {} sync bytes: 1 to 8", sync.len()));
            }
            _ if self.n_bytes() <= checksum_len || self.n_bytes() > BODY_MAX => {
                return Err(format!(
                    "{name} has a body of {} bytes: more than its checksum and at most {BODY_MAX}",
                    self.n_bytes()
                ));
            }
            _ => {}
        }
        for (idx, field) in self.fields.iter().enumerate() {
            let at = format!("{name}, field {idx}");
            if matches!(field.number, Number::Text { .. }) != is_line {
                return Err(format!("{at}: text is for lines, and lines have nothing else"));
            }
            field.check(&at, is_report)?;
            let room = self.n_bytes() - checksum_len;
            if field.offset >= room || field.number.n_bytes() > room - field.offset {
                return Err(format!(
                    "{at} ends behind the body, which has {room} places for fields"
                ));
            }
            if is_line && self.fields[..idx].iter().any(|other| other.offset == field.offset) {
                return Err(format!("{at}: number {} of the line has two meanings", field.offset));
            }
            let unique =
                !matches!(field.role, Role::Constant(_) | Role::Ignored | Role::Buttons(_));
            if unique && self.fields[..idx].iter().any(|other| other.role == field.role) {
                return Err(format!("{at}: {:?} is there twice", field.role));
            }
        }
        Ok(())
    }

    fn indices(&self, index: impl Fn(Role) -> Option<usize>) -> (usize, usize) {
        let indices = || self.fields.iter().filter_map(|field| index(field.role));
        (indices().count(), indices().max().map_or(0, |largest| largest + 1))
    }
}

impl LineFraming {
    fn check(&self, name: &str) -> Result<(), String> {
        let is_number = |byte: u8| byte.is_ascii_digit() || b"+-.eE".contains(&byte);
        if self.close.is_empty() || self.open.len() > 16 || self.close.len() > 16 {
            return Err(format!(
                "{name}: `close` has to end the line, such as \"\\n\" or \"]\", and neither end is \
                    longer than 16 bytes"
            ));
        }
        if !self.open.is_ascii()
            || !self.close.is_ascii()
            || self.separator == 0
            || !self.separator.is_ascii()
        {
            return Err(format!("{name}: the ends and the separator of a line are ASCII"));
        }
        if is_number(self.separator)
            || self.close.bytes().any(|byte| is_number(byte) || byte == self.separator)
        {
            return Err(format!(
                "{name}: a separator or an end of a line that is part of a number or of the other \
                    cannot be distinguished"
            ));
        }
        match self.pad {
            Some(pad) if pad.len > FRAME_MAX => {
                Err(format!("{name} is padded to {} bytes: at most {FRAME_MAX}", pad.len))
            }
            Some(pad) if !matches!(pad.byte, 0 | b' ') => {
                Err(format!("{name} is padded with byte {}: 0 or 32 (blank)", pad.byte))
            }
            _ => Ok(()),
        }
    }
}

impl Field {
    fn check(&self, at: &str, is_report: bool) -> Result<(), String> {
        let belongs = match self.role {
            Role::Motor(_) | Role::Enabled => !is_report,
            Role::Constant(_) | Role::Ignored => true,
            _ => is_report,
        };
        if !belongs {
            let has = if is_report {
                "a report has readings, rates, buttons and states"
            } else {
                "a command has motors and `enabled`"
            };
            return Err(format!("{at}: {:?} does not belong there: {has}", self.role));
        }
        if let Role::Reading(idx) | Role::Rate(idx) | Role::Motor(idx) = self.role
            && idx >= MAX_AXES
        {
            return Err(format!("{at}: number {idx}, and the largest is {}", MAX_AXES - 1));
        }
        let is_scaled = matches!(self.role, Role::Reading(_) | Role::Rate(_) | Role::Motor(_));
        if !self.scale.is_finite() || self.scale == 0.0 || (!is_scaled && self.scale != 1.0) {
            return Err(format!(
                "{at}: scale {}: a number other than 0, and only for readings, rates and motors",
                self.scale
            ));
        }
        let range = self.number.range();
        if !is_scaled && range.is_none() && self.role != Role::Ignored {
            return Err(format!("{at}: {:?} is a whole number", self.role));
        }
        if let Some(mask) = self.mask {
            let bits = 8 * self.number.n_bytes();
            if range.is_none() || bits == 0 || mask == 0 || (bits < 64 && mask >> bits != 0) {
                return Err(format!(
                    "{at}: mask {mask:#x}: bits of a binary whole number of {bits} bits, at least \
                        one"
                ));
            }
            if !self.number.is_unsigned() {
                return Err(format!("{at}: masks are for unsigned numbers"));
            }
            let run = mask >> mask.trailing_zeros();
            if run & (run + 1) != 0 {
                return Err(format!("{at}: mask {mask:#x} has a hole: its bits are one run"));
            }
        }
        if self.wraps
            && (!matches!(self.role, Role::Reading(_))
                || range.is_none()
                || self.number.n_bytes() == 0
                || self.mask.is_some())
        {
            return Err(format!(
                "{at}: only a reading that is a whole binary number without a mask wraps"
            ));
        }
        if let Some(limit) = self.limit
            && !(matches!(self.role, Role::Motor(_)) && limit.is_finite() && limit > 0.0)
        {
            return Err(format!("{at}: limit {limit}: a number above 0, and only for motors"));
        }
        match (self.role, range) {
            (Role::Counter, _) if !self.number.is_unsigned() || self.mask.is_some() => {
                Err(format!("{at}: a counter is u8, u16 or u32, without a mask"))
            }
            (Role::Buttons(first), _) if first > 31 => {
                Err(format!("{at}: button {first}, and the largest is 31"))
            }
            (Role::Constant(value), Some((low, high))) if !(low..=high).contains(&value) => {
                Err(format!("{at}: {value} does not fit {:?}, {low} to {high}", self.number))
            }
            (Role::Constant(value), _)
                if self.mask.is_some_and(|mask| {
                    value < 0 || value as u64 > mask >> mask.trailing_zeros()
                }) =>
            {
                Err(format!("{at}: {value} does not fit its mask"))
            }
            _ => Ok(()),
        }
    }
}

impl PacketLayout {
    /// Bytes of a command and a report on a line, escapes of SLIP left out; `None` for text.
    pub(super) fn exchange_bytes(&self) -> Option<usize> {
        let n_bytes = |packet: &Packet| match &packet.framing {
            Framing::Report { len, .. } => Some(*len),
            Framing::Sync { sync, len, .. } => Some(sync.len() + len),
            Framing::Cobs { len } | Framing::Slip { len } => Some(len + 2),
            Framing::Line(_) => None,
        };
        Some(n_bytes(&self.report)? + self.command.as_ref().map_or(Some(0), n_bytes)?)
    }

    /// How many readings a report has.
    pub(crate) fn n_readings(&self) -> usize {
        self.report.indices(|role| if let Role::Reading(idx) = role { Some(idx) } else { None }).1
    }

    /// How many motors a command has.
    pub(crate) fn n_motors(&self) -> usize {
        let motor = |role| if let Role::Motor(idx) = role { Some(idx) } else { None };
        self.command.as_ref().map_or(0, |command| command.indices(motor).1)
    }

    /// The step of motor commands, in their units, where all motors have the same; else 0.
    pub(super) fn motor_step(&self) -> f64 {
        let motors = self.command.iter().flat_map(|command| &command.fields);
        let mut steps = motors
            .filter(|field| matches!(field.role, Role::Motor(_)))
            .map(|field| field.number.step() * field.scale.abs());
        let first = steps.next().unwrap_or(0.0);
        if steps.all(|step| step == first) { first } else { 0.0 }
    }

    /// How its bytes travel.
    pub fn carriages(&self) -> &'static [Carriage] {
        match self.report.framing {
            Framing::Report { .. } => &[Carriage::Reports],
            _ => &[Carriage::Stream],
        }
    }

    /// Checks that everything fits together; a layout that passes can be spoken.
    ///
    /// # Errors
    /// [`ProtocolError`] names the packet, the field and what is accepted.
    pub(crate) fn check(&self) -> Result<(), ProtocolError> {
        self.check_text().map_err(ProtocolError)
    }

    fn check_text(&self) -> Result<(), String> {
        self.report.check("the report", true)?;
        let (n, largest) = self
            .report
            .indices(|role| if let Role::Reading(idx) = role { Some(idx) } else { None });
        if n == 0 || n != largest {
            return Err(format!(
                "the report has {n} readings up to number {largest}: at least one, numbered from 0 \
                    without a hole"
            ));
        }
        let (_, largest_rate) =
            self.report.indices(|role| if let Role::Rate(idx) = role { Some(idx) } else { None });
        if largest_rate > n {
            return Err(format!(
                "the report has a rate of reading {}, and no such reading",
                largest_rate - 1
            ));
        }
        if let Some(command) = &self.command {
            command.check("the command", false)?;
            let (n, largest) =
                command.indices(|role| if let Role::Motor(idx) = role { Some(idx) } else { None });
            if n != largest {
                return Err(format!(
                    "the command has {n} motors up to number {largest}: numbered from 0 without a \
                        hole"
                ));
            }
            let is_report = |framing: &Framing| matches!(framing, Framing::Report { .. });
            if is_report(&self.report.framing) != is_report(&command.framing) {
                return Err("one packet is a HID report and the other a part of a stream: an arm \
                    has one link"
                    .to_owned());
            }
        }
        if self.kick.as_ref().is_some_and(|kick| kick.is_empty() || kick.len() > FRAME_MAX) {
            return Err(format!("the kick frame is empty or longer than {FRAME_MAX} bytes"));
        }
        if let (Some(command), Some(kick)) = (&self.command, &self.kick)
            && super::declarative::moves(command, kick)
        {
            return Err(
                "the kick frame is a command that moves a motor: write one of zeros, as it \
                passes no limit"
                    .to_owned(),
            );
        }
        match self.pacing {
            Pacing::PingPong if self.command.is_none() && self.kick.is_none() => Err(
                "pacing \"ping-pong\" without a command or a kick frame: nothing would ask the arm"
                    .to_owned(),
            ),
            _ => Ok(()),
        }
    }
}
