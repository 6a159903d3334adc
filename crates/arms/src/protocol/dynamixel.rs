//! `dynamixel2`: a leader arm of Dynamixel X servos, protocol 2.0. One goal for all and one
//! question to all per exchange; each answers in turn.
//!
//! The bus watchdog of a servo latches, and 40 ms pass quickly between the start and the first
//! exchange. So the first command after a start, and a kick, carry three more packets: watchdog off
//! (clears a trip), goals of zero, watchdog on.

use core::time::Duration;

use super::dialogue::{Question, ask, hush};
use super::gather::Gather;
use super::number::{i32_at, toward_zero_i16, u16_at};
use super::{Codec, FeedCounts, MAX_AXES, MotorCommand, Report, Servo, ServoModel, StartError};
use crate::transport::{Frame, Transport};

/// CRC-16 with polynomial 0x8005, start 0, not reflected.
const CRC: crc::Crc<u16> = crc::Crc::<u16>::new(&crc::CRC_16_UMTS);
const HEADER: [u8; 4] = [0xFF, 0xFF, 0xFD, 0x00];
pub(super) const BROADCAST: u8 = 0xFE;

pub(super) const PING: u8 = 0x01;
pub(super) const WRITE: u8 = 0x03;
pub(super) const STATUS: u8 = 0x55;
pub(super) const SYNC_READ: u8 = 0x82;
pub(super) const SYNC_WRITE: u8 = 0x83;

pub(super) const RETURN_DELAY: u16 = 9;
pub(super) const MODE: u16 = 11;
pub(super) const TORQUE_ENABLE: u16 = 64;
pub(super) const BUS_WATCHDOG: u16 = 98;
pub(super) const GOAL_CURRENT: u16 = 102;
pub(super) const PRESENT: u16 = 126;
/// Current, velocity, position.
pub(super) const PRESENT_LEN: u16 = 10;
/// Header, id, length, instruction and CRC of a packet.
const PACKET_OVERHEAD: usize = 10;

/// A round of so many servos: goal currents, the request, and a status of each with its error byte.
/// Stuffing is rare.
pub(super) const fn exchange_bytes(n_servos: usize) -> usize {
    let write = PACKET_OVERHEAD + 4 + 3 * n_servos;
    let read = PACKET_OVERHEAD + 4 + n_servos;
    write + read + n_servos * (PACKET_OVERHEAD + 1 + PRESENT_LEN as usize)
}
/// 2 × 20 ms.
const WATCHDOG_STEPS: u8 = 2;
/// 0.229 rev/min in 1/4096 turns per second.
pub(super) const VELOCITY_UNIT: f64 = 0.229 / 60.0 * 4096.0;

/// Appends a packet: stuffs instruction and parameters, then counts and checks what came of it.
pub(super) fn put_packet(
    id: u8,
    instruction: u8,
    parameters: impl IntoIterator<Item = u8>,
    put: &mut impl FnMut(u8),
) {
    let mut body = [0_u8; 128];
    let mut n = 0;
    let mut last = [0_u8; 3];
    for byte in core::iter::once(instruction).chain(parameters) {
        last = [last[1], last[2], byte];
        for byte in core::iter::once(byte).chain((last == [0xFF, 0xFF, 0xFD]).then_some(0xFD)) {
            if let Some(slot) = body.get_mut(n) {
                *slot = byte;
                n += 1;
            }
        }
    }
    // The length counts the check too.
    let [low, high] = (n as u16 + 2).to_le_bytes();
    let head = [HEADER[0], HEADER[1], HEADER[2], HEADER[3], id, low, high];
    let body = &body[..n];
    let mut digest = CRC.digest();
    digest.update(&head);
    digest.update(body);
    for byte in head.iter().chain(body).chain(&digest.finalize().to_le_bytes()) {
        put(*byte);
    }
}

/// Finds packets in a stream, either direction.
#[derive(Debug, Default)]
pub(super) struct Packets {
    gather: Gather<192>,
}

/// A sound packet.
#[derive(Debug)]
pub(super) struct Packet<'a> {
    pub(super) id: u8,
    pub(super) instruction: u8,
    pub(super) parameters: &'a [u8],
}

impl Packets {
    pub(super) fn clear(&mut self) {
        self.gather.clear();
    }

    /// Takes a byte; hands each packet that ends with it to `take`. Gives how many things were
    /// wrong.
    pub(super) fn push(&mut self, byte: u8, mut take: impl FnMut(Packet<'_>)) -> u32 {
        let mut corrupt = 0;
        self.gather.push(byte);
        loop {
            let bytes = self.gather.as_slice();
            let n = bytes.len().min(4);
            if bytes[..n] != HEADER[..n] {
                // Anything up to the next header is lost; once is enough to say so.
                corrupt |= 1;
                self.gather.drop_front(1);
                self.gather.skip_to(0xFF);
                continue;
            }
            if bytes.len() < 7 {
                return corrupt;
            }
            let len = usize::from(u16_at(bytes, 5));
            if !(3..=128).contains(&len) {
                corrupt += 1;
                self.gather.drop_front(1);
                continue;
            }
            if bytes.len() < 7 + len {
                return corrupt;
            }
            let (checked, check) = bytes[..7 + len].split_at(5 + len);
            if CRC.checksum(checked).to_le_bytes() != check {
                corrupt += 1;
                self.gather.drop_front(1);
                continue;
            }
            let id = bytes[4];
            let bytes = self.gather.as_mut_slice();
            let n = unstuff(&mut bytes[7..5 + len]);
            if let Some((instruction, parameters)) = bytes[7..7 + n].split_first() {
                take(Packet { id, instruction: *instruction, parameters });
            }
            self.gather.drop_front(7 + len);
        }
    }
}

/// Takes the stuffing out in place; gives the length that is left.
fn unstuff(body: &mut [u8]) -> usize {
    let mut n = 0;
    let mut last = [0_u8; 3];
    for at in 0..body.len() {
        let byte = body[at];
        if last == [0xFF, 0xFF, 0xFD] && byte == 0xFD {
            last = [0; 3];
            continue;
        }
        last = [last[1], last[2], byte];
        body[n] = byte;
        n += 1;
    }
    n
}

/// The servos of an arm, without the heap.
#[derive(Clone, Copy, Debug)]
struct Chain {
    servos: [Servo; MAX_AXES],
    n: usize,
}

impl Chain {
    fn as_slice(&self) -> &[Servo] {
        &self.servos[..self.n]
    }
}

/// The host's side.
#[derive(Debug)]
pub(super) struct HostCodec {
    chain: Chain,
    packets: Packets,
    /// Which servo answers next; `None`: the round is spoilt, up to the first one.
    next: Option<usize>,
    round: Report,
    report: Report,
    /// A command went out in the middle of the round. What a busy host reads late may still end it,
    /// before the next command.
    is_late: bool,
    /// Rounds that were begun and never ended.
    unfinished: u32,
    arm_watchdog: bool,
    answer_within: Duration,
}

impl HostCodec {
    pub(super) fn new(servos: &[Servo]) -> Self {
        let n = servos.len().min(MAX_AXES);
        let mut chain =
            Chain { servos: [Servo { id: 0, model: ServoModel::Xc330T288 }; MAX_AXES], n };
        chain.servos[..n].copy_from_slice(&servos[..n]);
        Self {
            chain,
            packets: Packets::default(),
            next: Some(0),
            round: Report::default(),
            report: Report::default(),
            is_late: false,
            unfinished: 0,
            arm_watchdog: false,
            answer_within: Duration::from_millis(100),
        }
    }

    /// The same packet to all servos: `data` of each at an address.
    fn sync_write<const N: usize>(
        &self,
        address: u16,
        data: impl Fn(usize, &Servo) -> [u8; N],
        frame: &mut Frame,
    ) {
        let [low, high] = address.to_le_bytes();
        let each = self
            .chain
            .as_slice()
            .iter()
            .enumerate()
            .flat_map(|(idx, servo)| core::iter::once(servo.id).chain(data(idx, servo)));
        put_packet(
            BROADCAST,
            SYNC_WRITE,
            [low, high, N as u8, 0].into_iter().chain(each),
            &mut |byte| {
                frame.push(byte);
            },
        );
    }

    fn sync_read(&self, frame: &mut Frame) {
        let [low, high] = PRESENT.to_le_bytes();
        let ids = self.chain.as_slice().iter().map(|servo| servo.id);
        put_packet(
            BROADCAST,
            SYNC_READ,
            [low, high, PRESENT_LEN as u8, 0].into_iter().chain(ids),
            &mut |byte| {
                frame.push(byte);
            },
        );
    }

    fn rearm(&self, frame: &mut Frame) {
        self.sync_write(BUS_WATCHDOG, |_, _| [0], frame);
        self.sync_write(GOAL_CURRENT, |_, _| [0, 0], frame);
        self.sync_write(BUS_WATCHDOG, |_, _| [WATCHDOG_STEPS], frame);
    }

    fn take(&mut self, byte: u8, fed: &mut FeedCounts) {
        let Self { chain, packets, next, round, report, is_late, .. } = self;
        fed.corrupt += packets.push(byte, |packet| {
            if packet.instruction != STATUS {
                // The echo of our own packets on a half-duplex bus.
                return;
            }
            let Some((error, data)) = packet.parameters.split_first() else {
                fed.corrupt += 1;
                return;
            };
            let is_answer = data.len() == usize::from(PRESENT_LEN);
            let expected = next.and_then(|idx| chain.as_slice().get(idx));
            let idx = match expected {
                Some(servo) if servo.id == packet.id => next.unwrap_or(0),
                _ => {
                    // A servo is missing or out of turn: the round is lost, and the first servo
                    // begins a new one.
                    fed.corrupt += u32::from(
                        *next != Some(0)
                            || chain.as_slice().first().is_none_or(|first| first.id != packet.id),
                    );
                    *next = None;
                    if chain.as_slice().first().is_none_or(|first| first.id != packet.id) {
                        return;
                    }
                    0
                }
            };
            if !is_answer {
                fed.corrupt += 1;
                *next = None;
                return;
            }
            if idx == 0 {
                *is_late = false;
                *round = Report { rates: Some([0.0; MAX_AXES]), ..Report::default() };
            }
            round.readings[idx] = f64::from(i32_at(data, 6));
            if let Some(rates) = &mut round.rates {
                rates[idx] = f64::from(i32_at(data, 2)) * VELOCITY_UNIT;
            }
            if *error != 0 && round.error == 0 {
                // Which servo, and what it says: 0x80 is its hardware alert.
                round.error = u32::from(packet.id) << 8 | u32::from(*error);
            }
            *next = Some(idx + 1);
            if idx + 1 == chain.n {
                *report = *round;
                *next = Some(0);
                fed.reports += 1;
            }
        });
    }

    /// One write or ping to one servo, answered by its status.
    fn tell(
        &mut self,
        link: &mut dyn Transport,
        id: u8,
        step: &'static str,
        instruction: u8,
        parameters: &[u8],
    ) -> Result<u16, StartError> {
        let mut frame = Frame::default();
        put_packet(id, instruction, parameters.iter().copied(), &mut |byte| {
            frame.push(byte);
        });
        self.packets.clear();
        let packets = &mut self.packets;
        let question = Question {
            step,
            frame: frame.as_slice(),
            every: self.answer_within,
            within: self.answer_within * 3,
        };
        let answer = ask(link, &question, |bytes| {
            let mut answer = None;
            for byte in bytes {
                packets.push(*byte, |packet| {
                    if (packet.id, packet.instruction) == (id, STATUS) {
                        answer = packet
                            .parameters
                            .split_first()
                            .map(|(error, data)| (*error, u16_at(data, 0)));
                    }
                });
            }
            answer.map(Ok)
        });
        match answer {
            Ok((error, word)) if error & 0x7F == 0 && (error == 0 || instruction == PING) => {
                Ok(word)
            }
            Ok((error, _)) => {
                Err(StartError::Refused(format!("servo {id}, {step}: {}", error_text(error))))
            }
            Err(StartError::Silent { waited, seen, .. }) => Err(StartError::Refused(format!(
                "servo {id}, {step}: no answer within {} ms{}{seen}; check its power, its id, and \
                    that every servo and the port have the same baud rate",
                waited.as_millis(),
                if seen.is_empty() { "" } else { "; saw " },
            ))),
            Err(error) => Err(error),
        }
    }

    fn write(
        &mut self,
        link: &mut dyn Transport,
        id: u8,
        step: &'static str,
        address: u16,
        data: &[u8],
    ) -> Result<(), StartError> {
        let [low, high] = address.to_le_bytes();
        let mut parameters = [low, high, 0, 0, 0, 0];
        let end = 2 + data.len().min(4);
        parameters[2..end].copy_from_slice(&data[..end - 2]);
        self.tell(link, id, step, WRITE, &parameters[..end]).map(|_| ())
    }
}

/// What the error of a report means: which servo, and what it says.
pub(super) fn report_error_text(error: u16) -> String {
    let [error, id] = error.to_le_bytes();
    format!("servo {id}: {}", error_text(error))
}

fn error_text(error: u8) -> String {
    if error & 0x80 != 0 {
        return "hardware alert (overload, heat, voltage or encoder): switch the servo off and on, \
            and look at address 70 with the maker's tool".to_owned();
    }
    let what = match error {
        1 => "it could not",
        2 => "unknown instruction",
        3 => "the check of the packet was wrong",
        4 => "the value is out of range",
        5 => "the length is wrong",
        6 => "the value is beyond its limit",
        7 => "the address cannot be written now",
        _ => "unknown error",
    };
    format!("error {error}, {what}")
}

impl Codec for HostCodec {
    fn start(&mut self, link: &mut dyn Transport) -> Result<(), StartError> {
        *self = Self { answer_within: self.answer_within, ..Self::new(self.chain.as_slice()) };
        hush(link, Duration::from_millis(5))?;
        let chain = self.chain;
        for Servo { id, model } in chain.as_slice().iter().copied() {
            // A watchdog that tripped keeps the rest of the table shut.
            self.write(link, id, "bus watchdog off", BUS_WATCHDOG, &[0])?;
            self.write(link, id, "torque off", TORQUE_ENABLE, &[0])?;
            let number = self.tell(link, id, "asking for its model", PING, &[])?;
            if number != model.number() {
                let known = ServoModel::ALL
                    .into_iter()
                    .find(|known| known.number() == number)
                    .map_or("unknown here", ServoModel::name);
                return Err(StartError::Refused(format!(
                    "servo {id} is model {number} ({known}), and the profile says {} ({}): its \
                        torque would be another one",
                    model.name(),
                    model.number()
                )));
            }
            self.write(link, id, "current mode", MODE, &[0])?;
            self.write(link, id, "return delay 0", RETURN_DELAY, &[0])?;
        }
        for Servo { id, .. } in chain.as_slice().iter().copied() {
            self.write(link, id, "goal current 0", GOAL_CURRENT, &[0, 0])?;
            self.write(link, id, "torque on", TORQUE_ENABLE, &[1])?;
        }
        for Servo { id, .. } in chain.as_slice().iter().copied() {
            self.write(link, id, "bus watchdog 40 ms", BUS_WATCHDOG, &[WATCHDOG_STEPS])?;
        }
        self.packets.clear();
        self.arm_watchdog = true;
        Ok(())
    }

    fn feed(&mut self, bytes: &[u8]) -> FeedCounts {
        let mut fed =
            FeedCounts { corrupt: core::mem::take(&mut self.unfinished), ..FeedCounts::default() };
        for byte in bytes {
            self.take(*byte, &mut fed);
        }
        fed
    }

    fn newest(&self) -> &Report {
        &self.report
    }

    fn encode(&mut self, command: &MotorCommand, frame: &mut Frame) {
        frame.clear();
        match self.next {
            Some(0) => {}
            Some(_) if !self.is_late => self.is_late = true,
            _ => {
                self.unfinished = 1;
                self.next = Some(0);
            }
        }
        if core::mem::take(&mut self.arm_watchdog) {
            self.rearm(frame);
        }
        // The goals first: they are not answered, and answers must not meet another packet on the
        // bus.
        self.sync_write(
            GOAL_CURRENT,
            |idx, servo| {
                toward_zero_i16(command.motors()[idx], servo.model.limit_counts()).to_le_bytes()
            },
            frame,
        );
        self.sync_read(frame);
    }

    fn kick(&mut self, frame: &mut Frame) -> bool {
        self.arm_watchdog = true;
        self.encode(&MotorCommand::default(), frame);
        true
    }

    fn resume(&mut self) {
        self.packets.clear();
        self.next = Some(0);
    }

    fn identity(&self) -> Option<String> {
        let servos: Vec<_> = self
            .chain
            .as_slice()
            .iter()
            .map(|servo| format!("{} {}", servo.id, servo.model.name()))
            .collect();
        Some(format!("servos {}", servos.join(", ")))
    }

    fn finish(&mut self, link: &mut dyn Transport) {
        let mut zero = Frame::default();
        self.sync_write(GOAL_CURRENT, |_, _| [0, 0], &mut zero);
        let _ = link.send(zero.as_slice());
        let chain = self.chain;
        let mut answers = true;
        let patience = self.answer_within;
        for Servo { id, .. } in chain.as_slice().iter().copied() {
            // A tripped watchdog has opened the motor already; torque off goes through either way.
            // Once one is silent, the others get it and not waited for.
            if !answers {
                self.answer_within = Duration::from_millis(1);
            }
            answers &= self.write(link, id, "torque off", TORQUE_ENABLE, &[0]).is_ok();
        }
        self.answer_within = patience;
    }
}
