//! Protocols: what the bytes of an arm mean. Pure encode and decode; no I/O but the start-up
//! dialogue, no clock but the one handed in.
//!
//! Each protocol has two sides, in one file: a [`Codec`], which the host speaks, and a
//! [`Firmware`], which answers like the arm does. The second makes the mock arms of `hapticd mock`,
//! and tests every codec against something that is not itself.
//!
//! Units here are those of the wire (counts, mA, degrees): the transmission turns them into SI.
//!
//! Sources: the maker's published facts only; no code of theirs was read.
//!
//! | file | owns |
//! |---|---|
//! | `mod` | both traits and what they exchange |
//! | [`Protocol`] in `choice` | which protocol, with what a profile supplies |
//! | `haply` | the service of another program |
//! | [`layout`], `declarative`, `framing` | frames described as data, what speaks them |
//! | `hid14`, `hapi`, `falcon`, `hapkit`, `space_mouse`, `dynamixel` | one protocol each, both sides |
//! | `open6`, `open6_arm` | our own protocol, both sides |
//! | `dynamixel_bus` | the servos of a leader arm |
//! | `number`, `gather`, `dialogue` | numbers on the wire, unfinished frames, waiting for answers |

use core::time::Duration;

mod choice;
mod declarative;
pub(crate) mod dialogue;
mod dynamixel;
mod dynamixel_bus;
mod falcon;
mod framing;
mod gather;
mod hapi;
mod hapkit;
pub(crate) mod haply;
mod hid14;
pub mod layout;
pub(crate) mod number;
pub(crate) mod open6;
pub(crate) mod open6_arm;
mod space_mouse;
mod supplied;
#[cfg(test)]
mod tests;

pub use choice::Protocol;
pub use haply::{HaplyService, Version as ServiceVersion};
pub use layout::PacketLayout;
pub use supplied::{
    HapiBoard, HapiEncoder, Hid14Carrier, Open6Arm, ProtocolError, Servo, ServoModel, Turn,
};

pub use super::axes::MAX_AXES;
pub use super::motor_stage::MotorCommand;
use super::transport::{Frame, Transport, TransportError};

/// What one report says, before kinematics.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Report {
    /// Readings in the units of the wire and the order of the protocol. A counter that the wire
    /// cuts to 16 bits is whole again here. Arms that report a pose: x, y, z in m, the orientation
    /// x, y, z, w, then the grip in rad.
    pub readings: [f64; MAX_AXES],
    /// Rates of the readings per second, where the arm sends them. Arms that report a pose:
    /// velocity in m/s, angular velocity in rad/s, 0, then the grip in rad/s.
    pub rates: Option<[f64; MAX_AXES]>,
    /// Button states, bit 0 first.
    pub buttons: u32,
    /// Whether the arm has found its zero; `None` where the protocol does not say.
    pub homed: Option<bool>,
    /// Error code of the arm; 0: none.
    pub error: u32,
    /// [`Codec::sequence`] of the newest command that the arm had taken when it made this report,
    /// where it says so: measures the round trip.
    pub echo: Option<u16>,
}

impl Default for Report {
    fn default() -> Self {
        Self {
            readings: [0.0; MAX_AXES],
            rates: None,
            buttons: 0,
            homed: None,
            error: 0,
            echo: None,
        }
    }
}

/// What some bytes contained.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FeedCounts {
    /// Whole, sound reports; the newest of them is [`Codec::newest`].
    pub reports: u32,
    /// Reports that were short, long, garbled, or failed their check.
    pub corrupt: u32,
    /// Those of the corrupt ones whose check held and whose content made no sense.
    pub refused: u32,
    /// Reports that the arm's own counter says were lost before the last one.
    pub gap: u32,
    /// Reports that repeat the one before: the arm's counter stood still.
    pub repeated: u32,
}

impl core::ops::AddAssign for FeedCounts {
    fn add_assign(&mut self, other: Self) {
        self.reports = self.reports.saturating_add(other.reports);
        self.corrupt = self.corrupt.saturating_add(other.corrupt);
        self.refused = self.refused.saturating_add(other.refused);
        self.gap = self.gap.saturating_add(other.gap);
        self.repeated = self.repeated.saturating_add(other.repeated);
    }
}

/// What an arm says that it can do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DeclaredLimits {
    /// Exchanges per second that it takes.
    pub rate_hz: u16,
    /// Largest force, N.
    pub force_n: f64,
    /// Largest torque, N·m.
    pub torque_nm: f64,
    /// Radius of its workspace, m.
    pub workspace_radius_m: f64,
}

/// Why an arm could not be brought to speak. With text: cold.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum StartError {
    /// The transport failed.
    #[error("the link failed at the start: {0:?}")]
    Transport(TransportError),
    /// Nothing, or nothing of use, came in time.
    #[error("{step}: no answer within {} ms{}", .waited.as_millis(), if .seen.is_empty() { String::new() } else { format!("; saw {}", .seen) })]
    Silent {
        /// What was asked of the arm.
        step: &'static str,
        /// For how long.
        waited: Duration,
        /// What came instead, as hex, cut to what fits a line; empty: nothing.
        seen: String,
    },
    /// The arm answered something that rules it out.
    #[error("{0}")]
    Refused(String),
}

/// The host's side of a protocol.
///
/// RT: everything but `start` and `finish` is safe: no allocation, no panic on any bytes.
pub trait Codec: Send {
    /// The dialogue that leads from an opened link to an arm that sends reports. Cold; may wait.
    /// Never lets a motor move.
    ///
    /// # Errors
    /// See [`StartError`].
    fn start(&mut self, link: &mut dyn Transport) -> Result<(), StartError> {
        let _ = link;
        Ok(())
    }

    /// Told before [`Self::start`] by a host that has started this very arm before and lost the
    /// link to it: an arm that takes its pose at the start for its home pose is asked first whether
    /// it still knows the old one. `kept_power`: it only fell silent, its plug was never out, so it
    /// does. Cold.
    fn started_before(&mut self, kept_power: bool) {
        let _ = kept_power;
    }

    /// Takes one report (HID) or any piece of a stream; keeps what is left of an unfinished frame
    /// for the next call.
    fn feed(&mut self, bytes: &[u8]) -> FeedCounts;

    /// The newest sound report; the default one before the first.
    fn newest(&self) -> &Report;

    /// Writes the frame for a command, whatever else the protocol asks for in each exchange
    /// included. Non-finite numbers are zero. Leaves the frame empty when nothing is to be sent
    /// now: a lamp that stays as it is, or [`Self::silence`].
    fn encode(&mut self, command: &MotorCommand, frame: &mut Frame);

    /// Frame that wakes an arm which has fallen silent, and moves nothing; `false` when the
    /// protocol knows none.
    fn kick(&mut self, frame: &mut Frame) -> bool {
        self.encode(&MotorCommand::default(), frame);
        !frame.is_empty()
    }

    /// Sequence number of the last command that was encoded, where the protocol carries one;
    /// compare [`Report::echo`].
    fn sequence(&self) -> Option<u16> {
        None
    }

    /// The stream has lost its frames and cannot find them by itself. `Some`: send
    /// [`Self::zero_out_of_step`] once, then nothing for this long, throw away what is received,
    /// then call [`Self::resume`] and send a zero command. Needed a second time without a sound
    /// report in between, the arm is lost.
    fn silence(&self) -> Option<Duration> {
        None
    }

    /// A zero command for when it is unknown where in a frame the arm is: before a
    /// [`Self::silence`], and while the arm owes a reply. It takes force away where it can, and
    /// does no harm where the arm reads it as something else. Leaves the frame empty where the
    /// ordinary zero does as well.
    fn zero_out_of_step(&mut self, frame: &mut Frame) {
        frame.clear();
    }

    /// How many commands left since the arm last said that it had received one, where it says so:
    /// an arm may send and receive nothing.
    fn unheard(&self) -> Option<u32> {
        None
    }

    /// Forgets unfinished frames: after [`Self::silence`], and after bytes were thrown away.
    fn resume(&mut self) {}

    /// What time it is, s, reported before frames are taken or made: for protocols that compare
    /// clocks. It never goes back.
    fn tell_time(&mut self, now_s: f64) {
        let _ = now_s;
    }

    /// The other machine has taken the force away because it received nothing for too long. Over a
    /// network only.
    fn is_cut(&self) -> bool {
        false
    }

    /// Round trip that was measured at the start, s. Cold.
    fn round_trip_s(&self) -> Option<f64> {
        None
    }

    /// What the arm said of itself at the start, in one line for people. Cold.
    fn identity(&self) -> Option<String> {
        None
    }

    /// What a person should know before force flows, where the arm said so at the start. Cold.
    fn notice(&self) -> Option<String> {
        None
    }

    /// What the arm declared at the start, where its protocol lets it. RT: safe.
    fn declared(&self) -> Option<DeclaredLimits> {
        None
    }

    /// Silence after which the arm said that it lets go, ms. RT: safe.
    fn watchdog_ms(&self) -> Option<u32> {
        None
    }

    /// What follows the zero commands when the link is closed for good, such as switching torque
    /// off. Cold, short, must not panic.
    fn finish(&mut self, link: &mut dyn Transport) {
        let _ = link;
    }

    /// The same for a link that was lost and is to be opened again: what the arm got at its start
    /// stays. Cold, short, must not panic.
    fn finish_lost(&mut self, link: &mut dyn Transport) {
        self.finish(link);
    }
}

/// The readings of a simulated arm, as its encoders would give them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ArmReadings {
    /// As in [`Report::readings`], not yet cut to the wire.
    pub readings: [f64; MAX_AXES],
    /// Their rates per second.
    pub rates: [f64; MAX_AXES],
    /// Button states.
    pub buttons: u32,
    /// The arm has found its zero.
    pub homed: bool,
    /// What measures the orientation apart from the arm is asleep.
    pub asleep: bool,
}

/// Frames that an arm sends, in order. Cold: it allocates.
pub type Outbox = Vec<Vec<u8>>;

/// The arm's side of a protocol: what its firmware does with the bytes of the host.
pub trait Firmware: Send {
    /// Takes bytes from the host at `now_s` of the arm's time; answers go to `out`. Of HID: one
    /// report as the host wrote it; the 0 before an unnumbered one may be there or not. Answers are
    /// reports as the host reads them: no ID before unnumbered ones.
    fn receive(&mut self, bytes: &[u8], now_s: f64, arm: &ArmReadings, out: &mut Outbox);

    /// One period of the arm: reports that it sends by itself, and its watchdog.
    fn advance(&mut self, now_s: f64, arm: &ArmReadings, out: &mut Outbox);

    /// What the motors are driven with now, as in [`MotorCommand::motors`]; zero where the
    /// watchdog, a missing enable or an error says so.
    fn motors(&self) -> [f64; MAX_AXES];
}
