//! `falcon-nibble16`: Novint Falcon. Frames of 16 bytes from `<` to `>`, words as four letters,
//! strictly in turn.
//!
//! A Falcon that was just switched on knows no frames until it has been given its firmware, which
//! the user must own:
//!
//! ```text
//! run frames answered? ── yes ──► done
//!       │ no
//!       ▼
//! 9600 baud, 0A 43 0D ──► 0A 44 2C 0D ──► 142857 baud, 41 ──► 41 ──► image in chunks, each echoed ──► 1.5 Mbaud ──► run frames
//!       ▲                                                                                                  │ none
//!       └──────────────────────────────────── at most 10 times ◄───────────────────────────────────────────┘
//! ```

use core::time::Duration;
use std::path::{Path, PathBuf};

use super::dialogue::{Question, ask, hush};
use super::gather::Gather;
use super::number::{low_16, toward_zero_i16};
use super::{
    ArmReadings, Codec, FeedCounts, Firmware, MAX_AXES, MotorCommand, Outbox, Report, StartError,
};
use crate::transport::{Frame, Line, Transport};
use vps::storage::regular;

const LEN: usize = 16;
const COMMAND_MAX: i16 = 4096;
const CHUNK: usize = 62;
const HOMING: u8 = 1;
const GREEN: u8 = 2;
const BLUE: u8 = 4;
const RED: u8 = 8;
const HELLO: [u8; 3] = [0x0A, 0x43, 0x0D];
const HELLO_ANSWER: [u8; 4] = [0x0A, 0x44, 0x2C, 0x0D];

/// Appends a word as four letters, the low one first.
fn put_word(word: i16, mut put: impl FnMut(u8)) {
    for shift in [0, 4, 8, 12] {
        put(0x41 + (word >> shift & 0xF) as u8);
    }
}

/// A run frame of the host.
pub(super) fn put_frame(motors: [i16; 3], bits: u8, frame: &mut Frame) {
    frame.clear();
    frame.push(b'<');
    for motor in motors {
        put_word(motor, |letter| {
            frame.push(letter);
        });
    }
    frame.extend(&[0x41 + bits, 0x41, b'>']);
}

/// The word of four letters; `None` when one of them is none.
fn word_of(letters: &[u8]) -> Option<i16> {
    letters.iter().rev().try_fold(0_i16, |word, letter| {
        let nibble = letter.checked_sub(0x41).filter(|nibble| *nibble < 16)?;
        Some(word << 4 | i16::from(nibble))
    })
}

/// Drops bytes up to a frame: `<` with `>` 15 bytes later. True when one begins the buffer; counts
/// what had to be dropped.
fn align(gather: &mut Gather<64>, dropped: &mut u32) -> bool {
    loop {
        *dropped += gather.skip_to(b'<') as u32;
        match gather.as_slice().get(LEN - 1) {
            None => return false,
            Some(b'>') => return true,
            Some(_) => {
                gather.drop_front(1);
                *dropped += 1;
            }
        }
    }
}

/// The host's side.
#[derive(Debug)]
pub(super) struct HostCodec {
    image: Option<PathBuf>,
    /// How often a firmware load is tried.
    loads: u32,
    /// How often the bootloader is greeted.
    hellos: u32,
    gather: Gather<64>,
    report: Report,
}

impl HostCodec {
    pub(super) fn new(image: Option<PathBuf>) -> Self {
        Self { image, loads: 10, hellos: 100, gather: Gather::default(), report: Report::default() }
    }

    fn read_frame(&mut self) -> bool {
        let frame = self.gather.as_slice();
        let words = [1, 5, 9].map(|at| frame.get(at..at + 4).and_then(word_of));
        let bits =
            frame.get(13).and_then(|byte| byte.checked_sub(0x41)).filter(|bits| *bits < 0x80);
        let ([Some(a), Some(b), Some(c)], Some(bits)) = (words, bits) else { return false };
        for (reading, word) in self.report.readings.iter_mut().zip([a, b, c]) {
            *reading = f64::from(word);
        }
        self.report.buttons = u32::from(bits & 0xF);
        self.report.homed = Some(bits >> 4 == 0b111);
        true
    }

    fn probe(&mut self, link: &mut dyn Transport, step: &'static str) -> Result<(), StartError> {
        let mut zero = Frame::default();
        self.encode(&MotorCommand::default(), &mut zero);
        self.gather.clear();
        let question = Question {
            step,
            frame: zero.as_slice(),
            every: Duration::from_millis(20),
            // Ten frames.
            within: Duration::from_millis(200),
        };
        ask(link, &question, |bytes| (self.feed(bytes).reports > 0).then_some(Ok(())))
    }

    fn load(&mut self, link: &mut dyn Transport, image: &[u8]) -> Result<(), StartError> {
        let lines = [
            Line::PurgeReceived,
            Line::PurgeSent,
            Line::LatencyMs(16),
            Line::Baud(9600),
            Line::Plain8N1,
        ];
        for line in lines.into_iter().chain([Line::Rts(false), Line::Dtr(false), Line::Dtr(true)]) {
            link.line(line)?;
        }
        let every = Duration::from_millis(20);
        let mut seen = Gather::<64>::default();
        let question = Question {
            step: "greeting the bootloader (0A 43 0D)",
            frame: &HELLO,
            every,
            within: every * self.hellos,
        };
        ask(link, &question, |bytes| {
            for byte in bytes {
                if !seen.push(*byte) {
                    seen.drop_front(1);
                    seen.push(*byte);
                }
            }
            seen.as_slice().ends_with(&HELLO_ANSWER).then_some(Ok(()))
        })?;
        link.line(Line::Dtr(false))?;
        link.line(Line::Baud(142_857))?;
        // More than one greeting may be answered.
        hush(link, Duration::from_millis(20))?;
        let once = |step, frame| Question {
            step,
            frame,
            every: Duration::MAX,
            within: Duration::from_millis(500),
        };
        ask(link, &once("handing over the image (41)", &[0x41]), |bytes| {
            bytes.ends_with(&[0x41]).then_some(Ok(()))
        })?;
        for (idx, chunk) in image.chunks(CHUNK).enumerate() {
            let mut echoed = Vec::with_capacity(CHUNK);
            ask(link, &once("loading the image", chunk), |bytes| {
                echoed.extend_from_slice(bytes);
                if echoed.len() < chunk.len() {
                    None
                } else if echoed == chunk {
                    Some(Ok(()))
                } else {
                    Some(Err(StartError::Refused(format!(
                        "the image came back changed in chunk {idx} of {}",
                        image.len().div_ceil(CHUNK)
                    ))))
                }
            })?;
        }
        for line in
            [Line::LatencyMs(1), Line::Baud(1_500_000), Line::PurgeReceived, Line::PurgeSent]
        {
            link.line(line)?;
        }
        self.probe(link, "run frames after the load")
    }

    fn read_image(&self) -> Result<Vec<u8>, StartError> {
        let Some(path) = &self.image else {
            return Err(StartError::Refused(
                "the Falcon answers no run frames: it was just switched on and needs its firmware, \
                    which may not be shipped with this program; name the image that came with the \
                    device in the profile, or start it once with the maker's own program"
                    .to_owned(),
            ));
        };
        read_image_file(path)
    }
}

/// Bytes of a firmware image at most.
const LONGEST_IMAGE: u64 = 1 << 20;

fn read_image_file(path: &Path) -> Result<Vec<u8>, StartError> {
    match regular::bytes(path, LONGEST_IMAGE) {
        Ok(image) if !image.is_empty() => Ok(image),
        Ok(image) => Err(StartError::Refused(format!(
            "{}: {} bytes are no Falcon firmware image",
            path.display(),
            image.len()
        ))),
        Err(cause) => Err(StartError::Refused(format!(
            "cannot read the Falcon firmware image {}: {cause}",
            path.display()
        ))),
    }
}

impl Codec for HostCodec {
    fn start(&mut self, link: &mut dyn Transport) -> Result<(), StartError> {
        for line in [
            Line::LatencyMs(1),
            Line::Baud(1_500_000),
            Line::Plain8N1,
            Line::PurgeReceived,
            Line::PurgeSent,
        ] {
            link.line(line)?;
        }
        match self.probe(link, "run frames") {
            Err(StartError::Silent { .. }) => {}
            done => return done,
        }
        let image = self.read_image()?;
        let mut last = None;
        for _ in 0..self.loads.max(1) {
            match self.load(link, &image) {
                Err(StartError::Transport(error)) => return Err(StartError::Transport(error)),
                Err(error) => last = Some(error),
                Ok(()) => return Ok(()),
            }
        }
        let last = last.map_or_else(String::new, |error| error.to_string());
        Err(StartError::Refused(format!(
            "the firmware could not be loaded in {} tries; the last one ended with: {last}. Plug \
                the Falcon into a port of the computer, not a hub, and check its power",
            self.loads
        )))
    }

    fn feed(&mut self, bytes: &[u8]) -> FeedCounts {
        let mut fed = FeedCounts::default();
        let mut dropped = 0;
        for byte in bytes {
            self.gather.push(*byte);
            if align(&mut self.gather, &mut dropped) {
                if self.read_frame() {
                    fed.reports += 1;
                    self.gather.drop_front(LEN);
                } else {
                    // A `<` and a `>` that were not a frame: the frame may begin between them.
                    fed.corrupt += 1;
                    self.gather.drop_front(1);
                }
            }
        }
        fed.corrupt += u32::from(dropped > 0 && fed.corrupt == 0);
        fed
    }

    fn newest(&self) -> &Report {
        &self.report
    }

    fn encode(&mut self, command: &MotorCommand, frame: &mut Frame) {
        let lamp = match (command.is_enabled(), self.report.homed) {
            (true, _) => GREEN,
            (false, Some(true)) => BLUE,
            _ => RED,
        };
        let motors = [0, 1, 2].map(|idx| toward_zero_i16(command.motors()[idx], COMMAND_MAX));
        put_frame(motors, HOMING | lamp, frame);
    }

    fn resume(&mut self) {
        self.gather.clear();
    }
}

/// The arm's side. Holds its last command: what the device does without a host is not published.
#[derive(Debug, Default)]
pub(super) struct ArmFirmware {
    gather: Gather<64>,
    motors: [f64; MAX_AXES],
    /// What is missing before run frames are understood.
    boot: Option<Boot>,
}

/// A Falcon that was just switched on: how far its loader is.
#[derive(Debug)]
struct Boot {
    hello: bool,
    handed_over: bool,
    /// Bytes of the image that are still to come.
    left: usize,
}

impl ArmFirmware {
    /// One that waits for an image of that size.
    #[cfg(test)]
    pub(super) fn switched_on(image_len: usize) -> Self {
        Self {
            boot: Some(Boot { hello: false, handed_over: false, left: image_len }),
            ..Self::default()
        }
    }

    fn load(&mut self, bytes: &[u8], out: &mut Outbox) {
        let Some(boot) = &mut self.boot else { return };
        if bytes == HELLO {
            boot.hello = true;
            out.push([&[0], &HELLO_ANSWER[..]].concat());
        } else if boot.hello && !boot.handed_over {
            if bytes == [0x41] {
                boot.handed_over = true;
                out.push(vec![0x41]);
            }
        } else if boot.handed_over {
            boot.left = boot.left.saturating_sub(bytes.len());
            out.push(bytes.to_vec());
            if boot.left == 0 {
                self.boot = None;
            }
        }
    }
}

impl Firmware for ArmFirmware {
    fn receive(&mut self, bytes: &[u8], _: f64, arm: &ArmReadings, out: &mut Outbox) {
        if self.boot.is_some() {
            return self.load(bytes, out);
        }
        for byte in bytes {
            self.gather.push(*byte);
            if !align(&mut self.gather, &mut 0) {
                continue;
            }
            let frame = self.gather.as_slice();
            let words = [1, 5, 9].map(|at| frame.get(at..at + 4).and_then(word_of));
            if let [Some(a), Some(b), Some(c)] = words {
                self.motors[..3].copy_from_slice(&[a, b, c].map(f64::from));
                let mut reply = vec![b'<'];
                for reading in &arm.readings[..3] {
                    put_word(low_16(*reading), |letter| reply.push(letter));
                }
                let homed = if arm.homed { 0b111 } else { 0 };
                reply.extend([0x41 + (arm.buttons as u8 & 0xF | homed << 4), 0x41, b'>']);
                out.push(reply);
                self.gather.drop_front(LEN);
            } else {
                self.gather.drop_front(1);
            }
        }
    }

    fn advance(&mut self, _: f64, _: &ArmReadings, _: &mut Outbox) {}

    fn motors(&self) -> [f64; MAX_AXES] {
        self.motors
    }
}
