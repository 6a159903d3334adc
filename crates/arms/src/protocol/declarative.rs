//! `declarative`: frames that a profile describes as data, both sides. The description is in
//! [`layout`](super::layout).

use core::time::Duration;

use super::dialogue::{Question, ask, hush};
use super::framing::FrameReader;
use super::layout::{BODY_MAX, Field, Framing, Number, Packet, PacketLayout, Role};
use super::number::{Whole, put, words};
use super::{
    ArmReadings, Codec, FeedCounts, Firmware, MAX_AXES, MotorCommand, Outbox, Report, StartError,
};
use crate::Pacing;
use crate::transport::{Frame, Transport};

/// What stands in a command: the host's own, or what the arm has read.
#[derive(Clone, Copy, Debug, Default)]
struct CommandValues {
    motors: [f64; MAX_AXES],
    enabled: bool,
}

/// The values of a packet of either direction.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Values {
    report: Report,
    command: CommandValues,
    counter: Option<u32>,
    whole: [Whole; MAX_AXES],
}

/// How a number that was asked for becomes one of the wire.
#[derive(Clone, Copy, Debug)]
enum Rounding {
    /// Commands: never more than was asked.
    TowardZero,
    /// Readings: the nearest.
    Nearest,
}

/// Bits of a field, the lowest at 0.
fn run_of(field: &Field) -> Option<(u32, u64)> {
    field.mask.map(|mask| {
        (mask.trailing_zeros() & 63, mask.checked_shr(mask.trailing_zeros()).unwrap_or(0))
    })
}

/// A number of a body as it stands there.
fn raw_of(field: &Field, body: &[u8]) -> Option<f64> {
    let n = field.number.n_bytes();
    let mut bytes = [0; 8];
    bytes.get_mut(..n)?.copy_from_slice(body.get(field.offset..)?.get(..n)?);
    if field.big_endian {
        bytes.get_mut(..n)?.reverse();
    }
    let bits = u64::from_le_bytes(bytes);
    let raw = match field.number {
        Number::I8 => f64::from(bits as i8),
        Number::U8 => f64::from(bits as u8),
        Number::I16 => f64::from(bits as i16),
        Number::U16 => f64::from(bits as u16),
        Number::I32 => f64::from(bits as i32),
        Number::U32 => f64::from(bits as u32),
        Number::F32 => f64::from(f32::from_bits(bits as u32)),
        Number::F64 => f64::from_bits(bits),
        Number::Text { .. } => return None,
    };
    match run_of(field) {
        Some((shift, run)) => Some((bits >> shift & run) as f64),
        None => Some(raw),
    }
}

/// Writes a number into a body, beside what other fields have put into the same bytes.
fn put_raw(field: &Field, raw: f64, body: &mut [u8]) {
    let mut bits = match field.number {
        Number::F32 => u64::from((raw as f32).to_bits()),
        Number::F64 => raw.to_bits(),
        _ => raw as i64 as u64,
    };
    if let Some((shift, run)) = run_of(field) {
        bits = (bits & run) << shift;
    }
    let n = field.number.n_bytes();
    let mut bytes = bits.to_le_bytes();
    if let Some(bytes) = bytes.get_mut(..n)
        && field.big_endian
    {
        bytes.reverse();
    }
    for (old, new) in body.iter_mut().skip(field.offset).zip(&bytes[..n]) {
        *old |= *new;
    }
}

impl Values {
    /// Takes a number of a packet; false when it must not be there. `is_meant`: one that is none
    /// was not garbled on its way.
    fn take(&mut self, field: &Field, raw: f64, is_meant: bool) -> bool {
        if !raw.is_finite() {
            // The arm says so of its readings, and the host has to know.
            if let (Role::Reading(idx), true) = (field.role, is_meant)
                && let Some(slot) = self.report.readings.get_mut(idx)
            {
                *slot = f64::NAN;
                return true;
            }
            return false;
        }
        let slot = |values: &mut [f64; MAX_AXES], idx: usize, value: f64| {
            if let Some(slot) = values.get_mut(idx) {
                *slot = value;
            }
        };
        match field.role {
            Role::Reading(idx) => {
                let whole = match self.whole.get_mut(idx) {
                    Some(whole) if field.wraps => {
                        whole.take(raw as i64, 8 * field.number.n_bytes() as u32) as f64
                    }
                    _ => raw,
                };
                slot(&mut self.report.readings, idx, whole * field.scale);
            }
            Role::Rate(idx) => {
                slot(self.report.rates.get_or_insert_default(), idx, raw * field.scale)
            }
            Role::Buttons(first) => {
                self.report.buttons |= (raw as u32).checked_shl(first.into()).unwrap_or(0)
            }
            Role::Counter => self.counter = Some(raw as u32),
            Role::Error => self.report.error = raw.abs() as u32,
            Role::Homed => self.report.homed = Some(raw != 0.0),
            Role::Motor(idx) => {
                let is_beyond = field.limit.is_some_and(|limit| raw.abs() > limit);
                let motor = if is_beyond { 0.0 } else { raw * field.scale };
                slot(&mut self.command.motors, idx, motor);
            }
            Role::Enabled => self.command.enabled = raw != 0.0,
            Role::Constant(value) => return raw == value as f64,
            Role::Ignored => {}
        }
        true
    }

    /// The number of a field, as it will stand in the packet.
    fn raw(&self, field: &Field) -> f64 {
        let value = |values: &[f64; MAX_AXES], idx: usize| {
            values.get(idx).copied().unwrap_or(0.0) / field.scale
        };
        let (raw, rounding) = match field.role {
            Role::Reading(idx) => (value(&self.report.readings, idx), Rounding::Nearest),
            Role::Rate(idx) => {
                (value(&self.report.rates.unwrap_or_default(), idx), Rounding::Nearest)
            }
            Role::Buttons(first) => (
                f64::from(self.report.buttons.checked_shr(first.into()).unwrap_or(0)),
                Rounding::Nearest,
            ),
            Role::Counter => (f64::from(self.counter.unwrap_or(0)), Rounding::Nearest),
            Role::Error => (f64::from(self.report.error), Rounding::Nearest),
            Role::Homed => {
                (f64::from(u8::from(self.report.homed == Some(true))), Rounding::Nearest)
            }
            Role::Motor(idx) => (value(&self.command.motors, idx), Rounding::TowardZero),
            Role::Enabled => (f64::from(u8::from(self.command.enabled)), Rounding::Nearest),
            Role::Constant(value) => (value as f64, Rounding::Nearest),
            Role::Ignored => (0.0, Rounding::Nearest),
        };
        let limit = field.limit.unwrap_or(f64::INFINITY);
        let raw = raw.clamp(-limit, limit);
        let Some((low, high)) = field.number.range() else {
            let fits = raw.is_finite()
                && (!matches!(field.number, Number::F32) || (raw as f32).is_finite());
            return if fits { raw } else { 0.0 };
        };
        let whole = match rounding {
            Rounding::TowardZero => raw.trunc(),
            Rounding::Nearest => raw.round(),
        };
        if whole.is_nan() {
            return 0.0;
        }
        let bits = 8 * field.number.n_bytes() as u32;
        let cuts = field.wraps || matches!(field.role, Role::Counter | Role::Buttons(_));
        if cuts && (1..=32).contains(&bits) {
            let cut = whole as i64 & ((1 << bits) - 1);
            return if low < 0 && cut > high { (cut - (1 << bits)) as f64 } else { cut as f64 };
        }
        // A motor can be asked for as much one way as the other.
        let low = if matches!(field.role, Role::Motor(_)) { low.max(-high) } else { low };
        whole.clamp(low as f64, high as f64)
    }
}

/// Bytes without a check may be anything, words and reports are whole.
fn is_meant(packet: &Packet) -> bool {
    packet.checksum.is_some() || matches!(packet.framing, Framing::Line(_) | Framing::Report { .. })
}

/// A constant that is another one, of a packet whose form is right.
fn other_constant(packet: &Packet, body: &[u8]) -> Option<(i64, f64)> {
    let mut words: Vec<&str> = Vec::new();
    if let Framing::Line(line) = &packet.framing {
        words.extend(self::words(body, line.separator));
        if words.len() != packet.fields.len() {
            return None;
        }
    }
    packet.fields.iter().find_map(|field| {
        let Role::Constant(expected) = field.role else { return None };
        let found = match words.get(field.offset) {
            Some(word) => word.parse().ok(),
            None => raw_of(field, body),
        };
        found.filter(|found| *found != expected as f64).map(|found| (expected, found))
    })
}

/// What a packet holds, on top of what was known: the counts that wrap. `None` when it is not
/// sound.
fn decode(packet: &Packet, body: &[u8], known: &Values) -> Option<Values> {
    let mut values = Values { whole: known.whole, ..Values::default() };
    let is_meant = is_meant(packet);
    if let Framing::Line(line) = &packet.framing {
        let mut n = 0;
        for (idx, word) in words(body, line.separator).enumerate() {
            n += 1;
            let field = packet.fields.iter().find(|field| field.offset == idx)?;
            let raw = match field.number {
                Number::Text { places: 0 } => f64::from(word.parse::<i32>().ok()?),
                _ => word.parse::<f64>().ok()?,
            };
            if !values.take(field, raw, is_meant) {
                return None;
            }
        }
        return (n == packet.fields.len()).then_some(values);
    }
    for field in &packet.fields {
        if !values.take(field, raw_of(field, body)?, is_meant) {
            return None;
        }
    }
    Some(values)
}

/// Writes a packet in its framing.
fn encode(packet: &Packet, values: &Values, from_host: bool, frame: &mut Frame) {
    frame.clear();
    if let Framing::Line(line) = &packet.framing {
        frame.extend(line.open.as_bytes());
        for idx in 0..packet.fields.len() {
            if idx > 0 {
                frame.push(line.separator);
            }
            let Some(field) = packet.fields.iter().find(|field| field.offset == idx) else {
                continue;
            };
            let places =
                if let Number::Text { places } = field.number { usize::from(places) } else { 0 };
            let raw = values.raw(field);
            let raw = match field.role {
                // Not more than was asked for, in the last place either.
                Role::Motor(_) => {
                    let steps = 10_f64.powi(places as i32);
                    (raw * steps).trunc() / steps
                }
                _ => raw,
            };
            put!(frame, "{:.places$}", raw + 0.0);
        }
        super::framing::close_line(line, frame);
        return;
    }
    let mut body = [0; BODY_MAX];
    let Some(body) = body.get_mut(..packet.n_bytes()) else { return };
    for field in &packet.fields {
        put_raw(field, values.raw(field), body);
    }
    super::framing::put_body(packet, body, from_host, frame);
}

/// The host's side.
#[derive(Debug)]
pub(super) struct HostCodec {
    layout: PacketLayout,
    reader: FrameReader,
    values: Values,
    counter: Option<u32>,
}

/// For how long the first report is waited for.
const FIRST_WITHIN: Duration = Duration::from_millis(3000);

impl HostCodec {
    pub(super) fn new(layout: PacketLayout) -> Self {
        Self { layout, reader: FrameReader::default(), values: Values::default(), counter: None }
    }

    /// Why these bytes are not of the arm that the layout describes, where they say so. Cold.
    fn why_other(&self, bytes: &[u8]) -> Option<StartError> {
        let report = &self.layout.report;
        if let Framing::Report { id: None, len } = report.framing
            && bytes.len() != len
        {
            return Some(StartError::Refused(format!(
                "reports of {} bytes, and the profile describes {len}: this board, with the same \
                    USB ids, needs another profile",
                bytes.len()
            )));
        }
        let mut other = None;
        FrameReader::default().feed(report, bytes, true, |body| {
            other = other.or(other_constant(report, body));
            true
        });
        let (expected, found) = other.filter(|_| is_meant(report))?;
        Some(StartError::Refused(format!(
            "the arm reports {found} where its profile has {expected}: this arm needs another \
                profile"
        )))
    }
}

impl Codec for HostCodec {
    fn start(&mut self, link: &mut dyn Transport) -> Result<(), StartError> {
        *self = Self::new(self.layout.clone());
        match self.layout.pacing {
            Pacing::Event => return hush(link, Duration::from_millis(10)).map_err(Into::into),
            // Answers to another host. What an arm sends by itself tells another arm apart.
            Pacing::PingPong => hush(link, Duration::from_millis(10))?,
            Pacing::Stream => {}
        }
        let mut kick = Frame::default();
        self.kick(&mut kick);
        // An arm that sends by itself is asked for nothing but its kick frame.
        let asks = self.layout.pacing == Pacing::PingPong || self.layout.kick.is_some();
        let question = Question {
            step: if asks {
                "waiting for the first report"
            } else {
                "waiting for the first report, which the arm sends by itself (a board that waits \
                    for the host needs another profile)"
            },
            frame: if asks { kick.as_slice() } else { &[] },
            every: Duration::from_millis(100),
            within: FIRST_WITHIN,
        };
        ask(link, &question, |bytes| {
            if self.feed(bytes).reports > 0 {
                return Some(Ok(()));
            }
            self.why_other(bytes).map(Err)
        })?;
        match self.layout.pacing {
            // What is late of the answers to several questions.
            Pacing::PingPong => hush(link, Duration::from_millis(20))?,
            // Until its watchdog trips the arm holds what a host before us asked for.
            _ => {
                self.encode(&MotorCommand::default(), &mut kick);
                if !kick.is_empty() {
                    link.send(kick.as_slice())?;
                }
            }
        }
        self.reader.clear();
        Ok(())
    }

    fn feed(&mut self, bytes: &[u8]) -> FeedCounts {
        let Self { layout, reader, values, counter, .. } = self;
        let packet = &layout.report;
        let mut fed = FeedCounts::default();
        let corrupt = reader.feed(packet, bytes, true, |body| {
            let Some(new) = decode(packet, body, values) else { return false };
            *values = new;
            if let Some(count) = new.counter {
                let bits = packet
                    .fields
                    .iter()
                    .find(|field| field.role == Role::Counter)
                    .map_or(32, |field| 8 * field.number.n_bytes());
                let step = counter.map_or(1, |last| {
                    count.wrapping_sub(last) & (u32::MAX >> (32_usize.saturating_sub(bits)).min(31))
                });
                fed.gap = fed.gap.saturating_add(step.saturating_sub(1));
                fed.repeated += u32::from(step == 0);
                *counter = Some(count);
            }
            fed.reports += 1;
            true
        });
        fed.corrupt = corrupt;
        fed
    }

    fn newest(&self) -> &Report {
        &self.values.report
    }

    fn encode(&mut self, command: &MotorCommand, frame: &mut Frame) {
        frame.clear();
        if let Some(packet) = &self.layout.command {
            let command =
                CommandValues { motors: *command.motors(), enabled: command.is_enabled() };
            encode(packet, &Values { command, ..Values::default() }, true, frame);
        } else if let (Some(kick), Pacing::PingPong) = (&self.layout.kick, self.layout.pacing) {
            // Nothing to command, and yet it wants to be asked.
            frame.extend(kick);
        }
    }

    fn kick(&mut self, frame: &mut Frame) -> bool {
        match &self.layout.kick {
            Some(kick) => {
                frame.clear();
                frame.extend(kick);
            }
            None => self.encode(&MotorCommand::default(), frame),
        }
        !frame.is_empty()
    }

    fn resume(&mut self) {
        self.reader.clear();
        self.counter = None;
    }
}

/// The arm's side.
#[derive(Debug)]
pub(super) struct ArmFirmware {
    layout: PacketLayout,
    reader: FrameReader,
    command: CommandValues,
    counter: u32,
    fed_s: f64,
    said: Option<Vec<u8>>,
}

/// True where the arm would take these bytes for a command that moves a motor.
pub(super) fn moves(command: &Packet, bytes: &[u8]) -> bool {
    let mut moves = false;
    FrameReader::default().feed(command, bytes, false, |body| {
        let values = decode(command, body, &Values::default());
        moves |= values
            .as_ref()
            .is_some_and(|values| values.command.motors.iter().any(|motor| *motor != 0.0));
        values.is_some()
    });
    moves
}

impl ArmFirmware {
    pub(super) fn new(layout: PacketLayout) -> Self {
        Self {
            layout,
            reader: FrameReader::default(),
            command: CommandValues::default(),
            counter: 0,
            fed_s: 0.0,
            said: None,
        }
    }

    fn report(&mut self, arm: &ArmReadings) -> Vec<u8> {
        let report = Report {
            readings: arm.readings,
            rates: Some(arm.rates),
            buttons: arm.buttons,
            homed: Some(arm.homed),
            ..Report::default()
        };
        let mut frame = Frame::default();
        let values = Values { report, counter: Some(self.counter), ..Values::default() };
        encode(&self.layout.report, &values, false, &mut frame);
        frame.as_slice().to_vec()
    }
}

impl Firmware for ArmFirmware {
    fn receive(&mut self, bytes: &[u8], now_s: f64, arm: &ArmReadings, out: &mut Outbox) {
        let is_kick = self.layout.kick.as_deref() == Some(bytes);
        let mut asked = 0;
        if let Some(packet) = &self.layout.command {
            let Self { reader, command, fed_s, .. } = self;
            // A kick is often no frame of the layout; where it is one, it is a command.
            let mut apart = FrameReader::default();
            let reader = if is_kick { &mut apart } else { reader };
            reader.feed(packet, bytes, false, |body| {
                let Some(values) = decode(packet, body, &Values::default()) else { return false };
                *command = values.command;
                *fed_s = now_s;
                asked += 1;
                true
            });
        }
        if is_kick {
            asked = 1;
        }
        if self.layout.pacing == Pacing::PingPong {
            for _ in 0..asked {
                self.counter = self.counter.wrapping_add(1);
                out.push(self.report(arm));
            }
        }
    }

    fn advance(&mut self, now_s: f64, arm: &ArmReadings, out: &mut Outbox) {
        if self.layout.watchdog_ms.is_some_and(|ms| now_s - self.fed_s > f64::from(ms) * 1e-3) {
            self.command = CommandValues::default();
        }
        match self.layout.pacing {
            Pacing::Stream => {
                self.counter = self.counter.wrapping_add(1);
                out.push(self.report(arm));
            }
            Pacing::Event => {
                // Compared with the counter as it stood, or every report would be a new one.
                let report = self.report(arm);
                if self.said.as_ref().is_none_or(|said| *said != report) {
                    self.counter = self.counter.wrapping_add(1);
                    out.push(self.report(arm));
                    self.said = Some(self.report(arm));
                }
            }
            Pacing::PingPong => {}
        }
    }

    fn motors(&self) -> [f64; MAX_AXES] {
        // An arm that gets a bit for force on keeps still while it is off.
        let reported =
            self.layout.command.as_ref().is_some_and(|packet| {
                packet.fields.iter().any(|field| field.role == Role::Enabled)
            });
        if reported && !self.command.enabled { [0.0; MAX_AXES] } else { self.command.motors }
    }
}
