//! The workstation's side: a codec of open6 1.2, one packet to a datagram.
//!
//! It asks for a node, measures the link before any force can flow, and goes on measuring: each
//! state says which command it can show and how old that was, so that the round trip needs no clock
//! in common and the ways themselves only an estimate of the offset.

use core::sync::atomic::Ordering::Relaxed;
use core::time::Duration;
use std::sync::Arc;

use super::clock::{Exchange, LinkClock};
use super::figures::LinkFigures;
use super::packets::{
    CAPABILITIES_TOKEN, COMMAND_1_1_LEN, COMMAND_TOKEN, HELLO_1_1_LEN, HELLO_TOKEN, HostToken,
    MINOR, NO_AGE, STATE_AGE, put, reader, steps_ahead, timing_at, token_at, u32_at,
};
use crate::protocol::dialogue::{Question, ask};
use crate::protocol::number::{f32_at, finite_f32, u16_at};
use crate::protocol::open6::{
    CAPABILITIES, CAPABILITIES_LEN, COMMAND, HELLO, MAGIC, MAJOR, Packets, STATE, STOP,
    WATCHDOG_TRIPPED, axes_of, list, report_of,
};
use crate::protocol::{Codec, DeclaredLimits, FeedCounts, MotorCommand, Report, StartError};
use crate::transport::{FRAME_MAX, Frame, Transport, TransportError};
use vps::spatial::Axes;

/// How long a node may take to answer.
const HELLO_WITHIN: Duration = Duration::from_secs(3);
/// Exchanges that the delay at the start is taken from.
const EXCHANGES: usize = 200;
/// Longest that a node's force may outlive its command, ms: what `device-node` takes at most, hold
/// and fade together.
const OUTLIVES_MAX_MS: u16 = 200;
/// How long that may take, by the clock of the link, s.
const MEASURE_WITHIN_S: f64 = 3.0;
/// Share of these exchanges that may have taken longer than what is said to be the delay.
const LATE_SHARE: f64 = 0.05;
/// Pause between two looks at a link.
const LOOK: Duration = Duration::from_micros(200);
/// Commands of which it is known when they left: a second, at 1 kHz.
const SENT: usize = 1024;

/// What a node said of itself.
struct Greeting {
    text: String,
    declared: DeclaredLimits,
    /// It holds the last force for so long, ms,
    hold_ms: u32,
    /// and has let go after so long, ms.
    all_ms: u32,
}

/// The host's side.
pub struct RemoteHost {
    sensed: Axes,
    actuated: Axes,
    period_s: f64,
    token: HostToken,
    packets: Packets,
    sequence: u16,
    state_sequence: Option<u16>,
    report: Report,
    /// The node took the force away because it received nothing.
    is_cut: bool,
    said: Option<Greeting>,
    now_s: f64,
    /// `[SENT]`, by sequence: when a command left, s; NaN: before the clock that runs now.
    sent_at_s: Box<[f64]>,
    /// The node's clock, which wraps, made whole: µs.
    node_us: Option<(u32, f64)>,
    clock: LinkClock,
    trip_s: Option<f64>,
    newest_trip_s: Option<f64>,
    figures: Arc<LinkFigures>,
}

impl RemoteHost {
    /// For an arm that senses and drives at least this. `token` names the sender; each host process
    /// has its own.
    pub fn new(
        sensed: Axes,
        actuated: Axes,
        period_s: f64,
        token: u32,
        figures: Arc<LinkFigures>,
    ) -> Self {
        Self {
            sensed,
            actuated,
            period_s,
            token: HostToken(token),
            packets: reader(),
            sequence: 0,
            state_sequence: None,
            report: Report::default(),
            is_cut: false,
            said: None,
            now_s: 0.0,
            sent_at_s: vec![f64::NAN; SENT].into_boxed_slice(),
            node_us: None,
            clock: LinkClock::default(),
            trip_s: None,
            newest_trip_s: None,
            figures,
        }
    }

    /// What a node says of itself, held against what the profile says.
    fn greet(&self, payload: &[u8]) -> Result<Greeting, StartError> {
        let refuse = |text: String| Err(StartError::Refused(text));
        let major = payload.first().copied().unwrap_or(0);
        let minor = payload.get(1).copied().unwrap_or(0);
        if major != MAJOR || minor < MINOR {
            return refuse(format!(
                "the node speaks open6 {major}.{minor}, this program {MAJOR}.{MINOR}: update the \
                    older of the two"
            ));
        }
        let Some(listens_to) = token_at(payload, CAPABILITIES_TOKEN) else {
            return refuse(format!(
                "the node describes itself in {} bytes, too few",
                payload.len()
            ));
        };
        let name = String::from_utf8_lossy(
            payload[22..CAPABILITIES_LEN].split(|byte| *byte == 0).next().unwrap_or_default(),
        )
        .into_owned();
        if listens_to != self.token {
            return refuse(format!(
                "{name} listens to another host; end that one first, or wait until it has been \
                    silent for a second"
            ));
        }
        let sensed = axes_of(payload[2]);
        let actuated = axes_of(payload[3]);
        for (what, has, wants) in
            [("senses", sensed, self.sensed), ("drives", actuated, self.actuated)]
        {
            if !has.contains(wants) {
                return refuse(format!(
                    "{name} {what} {}, and its profile says {}: correct the profile",
                    list(has),
                    list(wants)
                ));
            }
        }
        let (hold_ms, all_ms) = timing_at(payload);
        if !(1..=OUTLIVES_MAX_MS).contains(&all_ms) || hold_ms > all_ms {
            return refuse(format!(
                "{name} says that its force outlives a command by {all_ms} ms, {hold_ms} of them \
                    held; 1 to {OUTLIVES_MAX_MS} ms are taken: give it other --hold-ms and \
                    --fade-ms"
            ));
        }
        let declared = DeclaredLimits {
            rate_hz: u16_at(payload, 4),
            force_n: f32_at(payload, 8).into(),
            torque_nm: f32_at(payload, 12).into(),
            workspace_radius_m: f32_at(payload, 16).into(),
        };
        let text = format!(
            "{name}, open6 {major}.{minor} over a network, drives {}, {} Hz, zero within {all_ms} \
                ms of silence, {:.3} N, {:.4} N·m",
            list(actuated),
            declared.rate_hz,
            declared.force_n,
            declared.torque_nm,
        );
        Ok(Greeting { text, declared, hold_ms: hold_ms.into(), all_ms: all_ms.into() })
    }

    /// Exchanges commands without enable for as long as it takes to know how far away the arm is.
    fn measure(&mut self, link: &mut dyn Transport) -> Result<f64, StartError> {
        let begin_ns = link.now_ns();
        let now_s = |link: &dyn Transport| (link.now_ns() - begin_ns) as f64 * 1e-9;
        let mut trips_s = Vec::with_capacity(EXCHANGES);
        let mut next_s = 0.0;
        let mut frame = Frame::default();
        let mut buffer = [0; FRAME_MAX];
        while trips_s.len() < EXCHANGES && now_s(link) < MEASURE_WITHIN_S {
            self.tell_time(now_s(link));
            if self.now_s >= next_s {
                next_s += self.period_s;
                self.encode(&MotorCommand::default(), &mut frame);
                match link.send(frame.as_slice()) {
                    // A link that is full for a moment loses a command, as it may.
                    Ok(()) | Err(TransportError::Full) => {}
                    Err(error) => return Err(error.into()),
                }
            }
            let n = link.receive(&mut buffer)?;
            if n == 0 {
                std::thread::sleep(LOOK);
                continue;
            }
            self.tell_time(now_s(link));
            self.newest_trip_s = None;
            self.feed(&buffer[..n]);
            trips_s.extend(self.newest_trip_s);
        }
        if trips_s.len() < EXCHANGES / 2 {
            return Err(StartError::Refused(format!(
                "only {} of {EXCHANGES} exchanges came back within {MEASURE_WITHIN_S} s: the \
                    network loses too much, or is too slow",
                trips_s.len()
            )));
        }
        trips_s.sort_by(f64::total_cmp);
        let late = (LATE_SHARE * trips_s.len() as f64) as usize;
        Ok(trips_s.get(trips_s.len() - 1 - late).copied().unwrap_or(0.0))
    }

    fn take_state(&mut self, sequence: u16, payload: &[u8], fed: &mut FeedCounts) {
        let steps = self.state_sequence.map_or(Some(1), |newest| steps_ahead(newest, sequence));
        let Some(steps) = steps else {
            self.figures.old.fetch_add(1, Relaxed);
            return;
        };
        let Some(report) = report_of(payload) else {
            fed.corrupt += 1;
            fed.refused += 1;
            return;
        };
        self.state_sequence = Some(sequence);
        self.figures.lost.fetch_add(u64::from(steps - 1), Relaxed);
        fed.gap += u32::from(steps - 1);
        fed.reports += 1;
        // Silence on the way there is no error of the arm.
        self.is_cut = report.error & WATCHDOG_TRIPPED != 0;
        self.report = Report { error: report.error & !WATCHDOG_TRIPPED, ..report };
        if let (Some(echo), Some(age_us)) =
            (report.echo, u32_at(payload, STATE_AGE).filter(|age_us| *age_us != NO_AGE))
        {
            self.compare_clocks(echo, u32_at(payload, 32).unwrap_or(0), age_us);
        }
    }

    fn compare_clocks(&mut self, echo: u16, node_us: u32, age_us: u32) {
        let whole_us = match self.node_us {
            Some((last_us, whole_us)) => whole_us + f64::from(node_us.wrapping_sub(last_us) as i32),
            None => f64::from(node_us),
        };
        self.node_us = Some((node_us, whole_us));
        let t1 = self.sent_at_s.get(usize::from(echo) % SENT).copied().unwrap_or(f64::NAN);
        let t3 = whole_us * 1e-6;
        let exchange = Exchange { t1, t2: t3 - f64::from(age_us) * 1e-6, t3, t4: self.now_s };
        if self.clock.observe(&exchange).is_none() {
            return;
        }
        self.newest_trip_s = Some(exchange.t4 - exchange.t1);
        let longest = self.clock.longest();
        let us = |way_s: f64| (way_s.max(0.0) * 1e6) as u32;
        self.figures.there_us.store(us(longest.there_s), Relaxed);
        self.figures.back_us.store(us(longest.back_s), Relaxed);
        self.figures.offset_us.store((self.clock.offset_s() * 1e6) as i64, Relaxed);
    }
}

impl Codec for RemoteHost {
    fn start(&mut self, link: &mut dyn Transport) -> Result<(), StartError> {
        let Self { sensed, actuated, period_s, token, .. } = *self;
        *self = Self::new(sensed, actuated, period_s, token.next().0, self.figures.clone());
        let mut payload = [0; HELLO_1_1_LEN];
        payload[..4].copy_from_slice(&MAGIC);
        payload[4..6].copy_from_slice(&[MAJOR, MINOR]);
        payload[HELLO_TOKEN..].copy_from_slice(&self.token.0.to_le_bytes());
        let mut hello = Frame::default();
        put(HELLO, 0, &payload, &mut hello);
        let question = Question {
            step: "hello",
            frame: hello.as_slice(),
            every: Duration::from_millis(100),
            within: HELLO_WITHIN,
        };
        let mut packets = reader();
        let said = ask(link, &question, |bytes| {
            let mut answer = None;
            packets.feed(bytes, |packet| {
                if packet.kind == CAPABILITIES {
                    answer = Some(self.greet(packet.payload));
                }
            });
            answer
        })?;
        self.figures.hold_ms.store(said.hold_ms, Relaxed);
        self.figures.fade_ms.store(said.all_ms - said.hold_ms, Relaxed);
        self.said = Some(said);
        let trip_s = self.measure(link)?;
        self.trip_s = Some(trip_s);
        // From here on another clock runs.
        self.sent_at_s.fill(f64::NAN);
        (self.clock, self.now_s) = (LinkClock::default(), 0.0);
        Ok(())
    }

    fn tell_time(&mut self, now_s: f64) {
        self.now_s = now_s;
    }

    fn feed(&mut self, bytes: &[u8]) -> FeedCounts {
        let mut fed = FeedCounts::default();
        let mut found = None;
        fed.corrupt = self.packets.feed(bytes, |packet| {
            if packet.kind == STATE {
                let mut payload = [0; FRAME_MAX];
                let n = packet.payload.len().min(FRAME_MAX);
                payload[..n].copy_from_slice(&packet.payload[..n]);
                found = Some((packet.sequence, payload, n));
            }
        });
        if let Some((sequence, payload, n)) = found {
            self.take_state(sequence, &payload[..n], &mut fed);
        }
        fed
    }

    fn newest(&self) -> &Report {
        &self.report
    }

    fn encode(&mut self, command: &MotorCommand, frame: &mut Frame) {
        self.sequence = self.sequence.wrapping_add(1);
        let mut payload = [0; COMMAND_1_1_LEN];
        for (four, motor) in payload.as_chunks_mut::<4>().0.iter_mut().zip(&command.motors()[..7]) {
            *four = finite_f32(*motor).to_le_bytes();
        }
        payload[28] = u8::from(command.is_enabled());
        payload[COMMAND_TOKEN..].copy_from_slice(&self.token.0.to_le_bytes());
        if let Some(sent_at_s) = self.sent_at_s.get_mut(usize::from(self.sequence) % SENT) {
            *sent_at_s = self.now_s;
        }
        put(COMMAND, self.sequence, &payload, frame);
    }

    fn sequence(&self) -> Option<u16> {
        Some(self.sequence)
    }

    fn resume(&mut self) {
        self.packets.clear();
        self.state_sequence = None;
    }

    fn is_cut(&self) -> bool {
        self.is_cut
    }

    fn round_trip_s(&self) -> Option<f64> {
        self.trip_s
    }

    fn identity(&self) -> Option<String> {
        self.said.as_ref().map(|said| said.text.clone())
    }

    fn declared(&self) -> Option<DeclaredLimits> {
        self.said.as_ref().map(|said| said.declared)
    }

    fn watchdog_ms(&self) -> Option<u32> {
        self.said.as_ref().map(|said| said.all_ms)
    }

    fn finish(&mut self, link: &mut dyn Transport) {
        self.sequence = self.sequence.wrapping_add(1);
        let mut stop = Frame::default();
        put(STOP, self.sequence, &self.token.0.to_le_bytes(), &mut stop);
        let _ = link.send(stop.as_slice());
    }
}

#[cfg(test)]
mod tests {
    use super::super::packets::{CAPABILITIES_1_1_LEN, put_timing};
    use super::*;
    use crate::protocol::open6::bits_of;
    use crate::remote::command_hold::HoldTiming;

    const TOKEN: u32 = 7 << 16;

    /// What the greeted node says, with this minor version and these times.
    fn greeted(minor: u8, hold_ms: f64, fade_ms: f64) -> Result<Greeting, StartError> {
        let mut payload = [0; CAPABILITIES_1_1_LEN];
        payload[..4].copy_from_slice(&[MAJOR, minor, bits_of(Axes::SIX), bits_of(Axes::SIX)]);
        put_timing(&HoldTiming { hold_s: hold_ms * 1e-3, fade_s: fade_ms * 1e-3 }, &mut payload);
        payload[22..26].copy_from_slice(b"left");
        payload[CAPABILITIES_TOKEN..].copy_from_slice(&TOKEN.to_le_bytes());
        RemoteHost::new(Axes::SIX, Axes::SIX, 1e-3, TOKEN, Arc::default()).greet(&payload)
    }

    #[test]
    fn a_node_says_how_long_its_force_outlives_the_link() {
        for (hold_ms, fade_ms) in [(10, 20), (2, 1), (7, 22), (100, 100)] {
            let said = greeted(MINOR, hold_ms.into(), fade_ms.into())
                .map_err(|error| error.to_string())
                .expect("taken");
            assert_eq!((said.hold_ms, said.all_ms), (hold_ms, hold_ms + fade_ms));
        }
    }

    #[test]
    fn an_older_node_and_one_that_holds_its_force_for_too_long_are_refused_with_words() {
        let text = |minor, hold_ms, fade_ms| {
            greeted(minor, hold_ms, fade_ms).err().expect("refused").to_string()
        };
        let old = text(1, 10.0, 20.0);
        assert!(
            old.contains("open6 1.1, this program 1.2")
                && old.contains("update the older of the two"),
            "{old}"
        );
        for (hold_ms, fade_ms) in [(0.0, 0.0), (120.0, 100.0), (10.0, f64::INFINITY)] {
            let long = text(MINOR, hold_ms, fade_ms);
            assert!(
                long.contains("left says that its force outlives")
                    && long.contains("--hold-ms and --fade-ms"),
                "{long}"
            );
        }
    }
}
