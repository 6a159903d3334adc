//! The driver at a link in memory.

use super::*;
use crate::device::IoPlacement;
use crate::device::attached::open::wired_parameters;
use crate::device::profile;
use crate::device::protocol::{ArmReadings, Firmware};
use crate::device::transport::{Carriage, LoopbackEnd, Transport as _, loopback};

const PERIOD_S: f64 = 1e-3;

/// The board of a shipped arm, and its end of the link.
struct Board {
    firmware: Box<dyn Firmware>,
    end: LoopbackEnd,
    now_s: f64,
}

impl Board {
    /// A period, in which the firmware may speak. `heard`: whether that reaches the link.
    fn advance(&mut self, heard: bool) {
        self.now_s += PERIOD_S;
        let mut out = Vec::new();
        let still = ArmReadings { readings: [0.0; MAX_AXES], rates: [0.0; MAX_AXES], buttons: 0, homed: true };
        self.firmware.advance(self.now_s, &still, &mut out);
        for report in out.into_iter().filter(|_| heard) {
            self.end.send(&report).expect("open");
        }
    }
}

fn attached(name: &str) -> (WiredArm, Board) {
    let profile = profile::find(name, std::path::Path::new("")).expect(name);
    let real = profile.real.as_ref().expect("a real arm");
    let (host, end) = loopback(Carriage::Reports);
    let board = Board { firmware: real.protocol.firmware(Carriage::Reports), end, now_s: 0.0 };
    let connection = Connection { link: Box::new(host), codec: real.protocol.codec(Carriage::Reports) };
    let parameters = wired_parameters(&profile, real, PERIOD_S, IoPlacement::OwnThread);
    (WiredArm::new(connection, None, parameters), board)
}

/// An arm that streams fills the queues while the program is still starting: what overflows then is no loss of the link.
#[test]
fn what_came_before_the_first_tick_was_not_lost() {
    let (mut arm, mut board) = attached("woodenhaptics-v15");
    for _ in 0..READS_MAX {
        board.advance(true);
    }
    for _ in 0..800 {
        board.advance(false);
    }
    for tick in 0..20 {
        board.advance(true);
        let sample = arm.read().expect("attached");
        assert_eq!((sample.lost_packets, sample.status), (0, SampleStatus::Fresh), "tick {tick}");
    }
    // From now on a gap is one.
    for _ in 0..30 {
        board.advance(false);
    }
    board.advance(true);
    assert_eq!(arm.read().expect("attached").lost_packets, 30);
}

#[test]
fn a_rate_input_has_no_zero_to_find() {
    let (mut arm, _) = attached("spacemouse");
    let sample = arm.read().expect("attached");
    assert!(sample.homed && sample.status == SampleStatus::Fresh);
}
