//! `open6`: the open 6-DoF protocol of `docs/reference/protocol.md`, over HID and serial. This file
//! holds the packets and the host's side.

use core::time::Duration;

use super::dialogue::{Question, ask, hush};
use super::gather::Gather;
use super::number::{f32_at, finite_f32, i16_at, pad, u16_at};
use super::{
    Codec, DeclaredLimits, FeedCounts, MAX_AXES, MotorCommand, Open6Arm, Report, StartError,
};
use crate::transport::{Carriage, Frame, Transport};
use vps::spatial::Axes;

/// Version of the protocol: another major number is another protocol.
pub(crate) const MAJOR: u8 = 1;
/// Minor versions add bytes behind known payloads.
pub(crate) const MINOR: u8 = 0;

/// Added to [`Report::error`] when the arm's watchdog has tripped: a command without enable clears
/// it.
pub(crate) const WATCHDOG_TRIPPED: u32 = 0x100;

/// Bytes of a HID report, and most of a packet.
pub(crate) const REPORT: usize = 64;
pub(crate) const PAYLOAD_MAX: usize = REPORT - 6;
const HEAD: usize = 4;

pub(crate) const HELLO: u8 = 0x01;
pub(crate) const COMMAND: u8 = 0x02;
pub(crate) const STOP: u8 = 0x03;
pub(crate) const CAPABILITIES: u8 = 0x81;
pub(crate) const STATE: u8 = 0x82;

pub(crate) const MAGIC: [u8; 4] = *b"op6d";
pub(crate) const HELLO_LEN: usize = 8;
pub(crate) const COMMAND_LEN: usize = 30;
pub(crate) const CAPABILITIES_LEN: usize = 22 + Open6Arm::NAME_MAX;
pub(crate) const STATE_LEN: usize = 42;
pub(crate) const STATE_WITH_TWIST_LEN: usize = 54;
/// Head and CRC of a packet, the byte that COBS adds and the 0 after it.
const SERIAL_OVERHEAD: usize = HEAD + 2 + 2;
/// A COMMAND and the longest STATE on a serial line.
pub(super) const EXCHANGE_BYTES: usize = COMMAND_LEN + STATE_WITH_TWIST_LEN + 2 * SERIAL_OVERHEAD;

pub(crate) const HOMED: u8 = 1;
pub(crate) const ENABLED: u8 = 2;
pub(crate) const TRIPPED: u8 = 4;
/// Steps per m/s and per rad/s of a velocity on the wire.
pub(crate) const LINEAR_STEPS: f64 = 8192.0;
pub(crate) const ANGULAR_STEPS: f64 = 1024.0;

const CRC: crc::Crc<u16> = crc::Crc::<u16>::new(&crc::CRC_16_IBM_3740);

/// Appends a packet as its carriage wants it. `report_id`: the 0 that the host writes before an
/// unnumbered report.
pub(crate) fn put_packet(
    carriage: Carriage,
    report_id: bool,
    kind: u8,
    sequence: u16,
    payload: &[u8],
    frame: &mut Frame,
) {
    let n = payload.len().min(PAYLOAD_MAX);
    let mut packet = [0; REPORT];
    packet[0] = kind;
    packet[1] = n as u8;
    packet[2..HEAD].copy_from_slice(&sequence.to_le_bytes());
    packet[HEAD..HEAD + n].copy_from_slice(&payload[..n]);
    let crc = CRC.checksum(&packet[..HEAD + n]);
    packet[HEAD + n..HEAD + n + 2].copy_from_slice(&crc.to_le_bytes());
    let packet = &packet[..HEAD + n + 2];
    match carriage {
        Carriage::Reports => {
            if report_id {
                frame.push(0);
            }
            let end = frame.as_slice().len() + REPORT;
            frame.extend(packet);
            pad(frame, 0, end);
        }
        Carriage::Stream => {
            let mut stuffed = [0; REPORT + 2];
            // At most one byte is added to so few.
            if let Ok(n) = cobs::try_encode(packet, &mut stuffed) {
                frame.extend(&stuffed[..n]);
                frame.push(0);
            }
        }
    }
}

/// A sound packet.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Packet<'a> {
    pub(crate) kind: u8,
    pub(crate) sequence: u16,
    pub(crate) payload: &'a [u8],
}

/// The packet at the start of some bytes, whatever follows it.
fn packet_of(bytes: &[u8]) -> Option<Packet<'_>> {
    let n = usize::from(*bytes.get(1)?);
    let checked = bytes.get(..HEAD + n)?;
    bytes.get(HEAD + n..HEAD + n + 2)?;
    let is_sound = CRC.checksum(checked) == u16_at(bytes, HEAD + n);
    is_sound.then(|| Packet {
        kind: bytes[0],
        sequence: u16_at(bytes, 2),
        payload: &checked[HEAD..],
    })
}

/// Finds packets in what a link delivers.
#[derive(Debug)]
pub(crate) struct Packets {
    carriage: Carriage,
    gather: Gather<80>,
}

impl Packets {
    pub(crate) fn new(carriage: Carriage) -> Self {
        Self { carriage, gather: Gather::default() }
    }

    pub(crate) fn clear(&mut self) {
        self.gather.clear();
    }

    /// Takes bytes, hands over each sound packet, gives how many were not.
    pub(crate) fn feed(&mut self, bytes: &[u8], mut take: impl FnMut(Packet<'_>)) -> u32 {
        let mut corrupt = 0;
        match self.carriage {
            Carriage::Reports => {
                match (bytes.len() == REPORT).then(|| packet_of(bytes)).flatten() {
                    Some(packet) => take(packet),
                    None => corrupt += 1,
                }
            }
            Carriage::Stream => {
                for byte in bytes {
                    match self.gather.until(0, *byte) {
                        // Zeros between packets are idle.
                        Some(true) if self.gather.as_slice().is_empty() => {}
                        Some(true) => {
                            let n = cobs::decode_in_place(self.gather.as_mut_slice()).unwrap_or(0);
                            let packet = packet_of(&self.gather.as_slice()[..n])
                                .filter(|packet| HEAD + packet.payload.len() + 2 == n);
                            match packet {
                                Some(packet) => take(packet),
                                None => corrupt += 1,
                            }
                        }
                        Some(false) => corrupt += 1,
                        None => {}
                    }
                }
            }
        }
        corrupt
    }
}

/// Bits of axes on the wire.
pub(crate) fn bits_of(axes: Axes) -> u8 {
    (0..7).filter(|axis| axes.has(*axis)).map(|axis| 1 << axis).sum()
}

pub(crate) fn axes_of(bits: u8) -> Axes {
    let named = Axes::NAMES.iter().enumerate().filter(|(axis, _)| bits >> axis & 1 == 1);
    named.filter_map(|(_, name)| Axes::from_name(name)).fold(Axes::NONE, Axes::union)
}

pub(crate) fn list(axes: Axes) -> String {
    axes.names().collect::<Vec<_>>().join(" ")
}

/// What an arm said of itself.
#[derive(Debug)]
struct Greeting {
    text: String,
    declared: DeclaredLimits,
    watchdog_ms: u16,
}

/// The host's side.
#[derive(Debug)]
pub(super) struct HostCodec {
    arm: Open6Arm,
    carriage: Carriage,
    packets: Packets,
    sequence: u16,
    state_sequence: Option<u16>,
    report: Report,
    said: Option<Greeting>,
    hello_within: Duration,
}

impl HostCodec {
    pub(super) fn new(arm: Open6Arm, carriage: Carriage) -> Self {
        Self {
            arm,
            carriage,
            packets: Packets::new(carriage),
            sequence: 0,
            state_sequence: None,
            report: Report::default(),
            said: None,
            hello_within: Duration::from_millis(3000),
        }
    }

    /// What an arm says of itself, held against what the profile says.
    fn greet(&self, payload: &[u8]) -> Result<Greeting, StartError> {
        let refuse = |text: String| Err(StartError::Refused(text));
        let major = payload.first().copied().unwrap_or(0);
        let minor = payload.get(1).copied().unwrap_or(0);
        if major != MAJOR {
            return refuse(format!(
                "the arm speaks open6 {major}.{minor}, this program {MAJOR}.{MINOR}: update the \
                    older of the two"
            ));
        }
        if payload.len() < CAPABILITIES_LEN {
            return refuse(format!(
                "the arm describes itself in {} bytes, at least {CAPABILITIES_LEN} expected",
                payload.len()
            ));
        }
        let name = String::from_utf8_lossy(
            payload[22..CAPABILITIES_LEN].split(|byte| *byte == 0).next().unwrap_or_default(),
        )
        .into_owned();
        let sensed = axes_of(payload[2]);
        let actuated = axes_of(payload[3]);
        for (what, has, wants) in
            [("senses", sensed, self.arm.sensed), ("drives", actuated, self.arm.actuated)]
        {
            if !has.contains(wants) {
                return refuse(format!(
                    "{name} {what} {}, and the profile says {}: correct the profile",
                    list(has),
                    list(wants)
                ));
            }
        }
        let watchdog_ms = u16_at(payload, 6);
        if watchdog_ms == 0 || watchdog_ms > self.arm.watchdog_ms {
            return refuse(format!(
                "{name} has a watchdog of {watchdog_ms} ms, and the profile asks for {} ms at \
                    most; 0 is none, which the protocol does not allow",
                self.arm.watchdog_ms
            ));
        }
        let declared = DeclaredLimits {
            rate_hz: u16_at(payload, 4),
            force_n: f32_at(payload, 8).into(),
            torque_nm: f32_at(payload, 12).into(),
            workspace_radius_m: f32_at(payload, 16).into(),
        };
        let DeclaredLimits { rate_hz, force_n, torque_nm, workspace_radius_m } = declared;
        let text = format!(
            "{name}, open6 {major}.{minor}, senses {}, drives {}, {rate_hz} Hz, watchdog \
                {watchdog_ms} ms, {force_n:.3} N, {torque_nm:.4} N·m, radius \
                {workspace_radius_m:.3} m",
            list(sensed),
            list(actuated),
        );
        Ok(Greeting { text, declared, watchdog_ms })
    }
}

/// What an error code of a state means.
pub(super) fn error_text(error: u16) -> String {
    if u32::from(error) & WATCHDOG_TRIPPED != 0 {
        return "its watchdog has tripped: it got no command in time".to_owned();
    }
    let words = match error {
        1 => "it is not homed",
        2 => "it got a command that is not a number",
        3 => "it is too hot",
        4 => "a motor driver has failed",
        5 => "a sensor has failed",
        6 => "the arm behind its node is gone",
        128.. => "its maker defines this number: see its manual",
        _ => "open6 does not define this number",
    };
    words.to_owned()
}

/// The report of a state; `None` when its numbers make no sense.
pub(crate) fn report_of(payload: &[u8]) -> Option<Report> {
    if payload.len() < STATE_LEN {
        return None;
    }
    let mut readings = [0.0; MAX_AXES];
    for (idx, reading) in readings.iter_mut().enumerate() {
        *reading = f64::from(f32_at(payload, 4 * idx));
    }
    // A state whose check holds and whose numbers are none was not garbled on its way: the arm says
    // so, and the host has to know.
    let norm = readings[3..7].iter().map(|q| q * q).sum::<f64>();
    if norm.is_finite() && !(0.9..1.1).contains(&norm) {
        return None;
    }
    let rates = (payload.len() >= STATE_WITH_TWIST_LEN).then(|| {
        let mut rates = [0.0; MAX_AXES];
        for (idx, rate) in rates[..6].iter_mut().enumerate() {
            *rate = f64::from(i16_at(payload, STATE_LEN + 2 * idx))
                / if idx < 3 { LINEAR_STEPS } else { ANGULAR_STEPS };
        }
        rates
    });
    let flags = payload[40];
    let error = payload[41];
    Some(Report {
        readings,
        rates,
        buttons: u32::from(u16_at(payload, 38)),
        homed: Some(flags & HOMED != 0),
        error: u32::from(error) | if flags & TRIPPED != 0 { WATCHDOG_TRIPPED } else { 0 },
        echo: Some(u16_at(payload, 36)),
    })
}

impl Codec for HostCodec {
    fn start(&mut self, link: &mut dyn Transport) -> Result<(), StartError> {
        *self =
            Self { hello_within: self.hello_within, ..Self::new(self.arm.clone(), self.carriage) };
        let mut hello = Frame::default();
        if self.carriage == Carriage::Stream {
            // Ends whatever the arm was in the middle of.
            hello.push(0);
        }
        let mut payload = [0; HELLO_LEN];
        payload[..4].copy_from_slice(&MAGIC);
        payload[4..6].copy_from_slice(&[MAJOR, MINOR]);
        payload[6..].copy_from_slice(&self.arm.watchdog_ms.to_le_bytes());
        put_packet(self.carriage, true, HELLO, 0, &payload, &mut hello);
        let question = Question {
            step: "hello",
            frame: hello.as_slice(),
            every: Duration::from_millis(100),
            within: self.hello_within,
        };
        let mut packets = Packets::new(self.carriage);
        let said = ask(link, &question, |bytes| {
            let mut answer = None;
            packets.feed(bytes, |packet| {
                if packet.kind == CAPABILITIES {
                    answer = Some(self.greet(packet.payload));
                }
            });
            answer
        })?;
        self.said = Some(said);
        hush(link, Duration::from_millis(10))?;
        Ok(())
    }

    fn feed(&mut self, bytes: &[u8]) -> FeedCounts {
        let Self { packets, report, state_sequence, .. } = self;
        let mut fed = FeedCounts::default();
        let mut senseless = 0;
        let corrupt = packets.feed(bytes, |packet| {
            if packet.kind != STATE {
                return;
            }
            match report_of(packet.payload) {
                Some(new) => *report = new,
                None => {
                    senseless += 1;
                    return;
                }
            }
            let step = state_sequence.map_or(1, |last| packet.sequence.wrapping_sub(last));
            *state_sequence = Some(packet.sequence);
            fed.gap += u32::from(step.saturating_sub(1));
            fed.repeated += u32::from(step == 0);
            fed.reports += 1;
        });
        fed.corrupt = corrupt + senseless;
        fed.refused = senseless;
        fed
    }

    fn newest(&self) -> &Report {
        &self.report
    }

    fn encode(&mut self, command: &MotorCommand, frame: &mut Frame) {
        self.sequence = self.sequence.wrapping_add(1);
        let mut payload = [0; COMMAND_LEN];
        for (four, motor) in payload.as_chunks_mut::<4>().0.iter_mut().zip(&command.motors()[..7]) {
            *four = finite_f32(*motor).to_le_bytes();
        }
        payload[28] = u8::from(command.is_enabled());
        frame.clear();
        put_packet(self.carriage, true, COMMAND, self.sequence, &payload, frame);
    }

    fn sequence(&self) -> Option<u16> {
        Some(self.sequence)
    }

    fn resume(&mut self) {
        self.packets.clear();
        self.state_sequence = None;
    }

    fn identity(&self) -> Option<String> {
        self.said.as_ref().map(|said| said.text.clone())
    }

    fn declared(&self) -> Option<DeclaredLimits> {
        self.said.as_ref().map(|said| said.declared)
    }

    fn watchdog_ms(&self) -> Option<u32> {
        self.said.as_ref().map(|said| said.watchdog_ms.into())
    }

    fn finish(&mut self, link: &mut dyn Transport) {
        self.sequence = self.sequence.wrapping_add(1);
        let mut stop = Frame::default();
        put_packet(self.carriage, true, STOP, self.sequence, &[], &mut stop);
        let _ = link.send(stop.as_slice());
    }
}
