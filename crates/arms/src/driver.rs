//! The one interface between the servo and an arm.

use crate::simulated::HandControl;
use vps::spatial::{Axes, DeviceSample, Wrench};

/// Who sets the rate of the exchange with the arm.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Pacing {
    /// One reply per command; never two commands in flight.
    #[default]
    PingPong,
    /// The arm sends by itself.
    Stream,
    /// Reports arrive on change only: no report means unchanged, not stale.
    Event,
}

/// Where the bytes of a transport are moved.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum IoPlacement {
    /// In the servo thread: `read` and `write` never block.
    #[default]
    InLoop,
    /// In a thread of the driver's own (HID, whose write can block): `read` and `write` exchange
    /// newest values with it.
    OwnThread,
}

/// What an arm can do. A `Copy` record that does not change while the arm is open; one that was
/// lost may come back with another watchdog.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Capabilities {
    /// Axes that are measured.
    pub sensed: Axes,
    /// Axes with a motor.
    pub actuated: Axes,
    /// Who sets the rate.
    pub pacing: Pacing,
    /// In which thread bytes are moved.
    pub io: IoPlacement,
    /// The arm drops its command when none came for this long; `None`: never, the last command
    /// stays on.
    pub watchdog_ms: Option<u32>,
    /// After the watchdog tripped, the next command does not enable the motors by itself.
    pub watchdog_latched: bool,
    /// The motors keep the last command when the host goes away.
    pub holds_last_command: bool,
    /// A simulated arm: may be enabled without an operator.
    pub simulated: bool,
}

/// Why the edge to the arm failed. `Copy`, nothing on the heap: only the cold side makes text of
/// it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DeviceError {
    /// The arm is gone; nothing more will come.
    #[error("the arm is gone")]
    Lost,
    /// The network between this machine and the arm's is silent, or was for too long; nothing is
    /// known of the arm.
    #[error("the network between this machine and the arm's is silent")]
    Link,
    /// A report was short, garbled or failed its check; the last good sample still stands.
    #[error("a report of the arm was garbled")]
    Packet,
    /// The command had a component that is not a finite number; a zero command was sent in its
    /// place.
    #[error("the command was not finite, and zero was sent in its place")]
    NonFinite,
    /// The loop stood still with force on, and the guard of the arm has reported it zero meanwhile;
    /// zero was sent again in place of the command.
    #[error("the loop stood still with force on, and the arm was sent zero meanwhile")]
    Stalled,
    /// The operating system refused with this errno.
    #[error("the operating system refused the arm's link: {}", std::io::Error::from_raw_os_error(*.0))]
    Os(i32),
}

/// An open arm. One owner, one thread: the servo.
///
/// # The exchange
/// Each tick the servo calls `read`, then `write`. Both rhythms of real arms fit:
/// - *host-paced* (ping-pong, service): `read` takes the reply to the command of the tick before,
///   `write` sends the next one;
/// - *device-paced* (stream, event): `read` drains the queue and keeps the newest report, `write`
///   sends whenever the tick is done.
///
/// A `write` always follows a successful `read`, so a driver never has two commands in flight.
/// After [`DeviceError::Lost`] the servo keeps calling; the driver keeps answering `Lost`.
///
/// RT: `read`, `write` and `stop` run in the servo thread. They do not allocate, lock, print or
/// panic, and make at most a fixed number of non-blocking system calls.
pub trait Device: Send {
    /// What the arm can do.
    fn capabilities(&self) -> Capabilities;

    /// The newest sample: grip pose in the device frame. Fresh when a report arrived since the last
    /// call, else the last values again with status stale.
    ///
    /// # Errors
    /// [`DeviceError::Packet`]: the sample is stale this time. Anything else: the arm is lost.
    fn read(&mut self) -> Result<DeviceSample, DeviceError>;

    /// Sends a wrench: device axes, reduced at the grip point. The last code before the motors:
    /// drops axes without a motor and repeats the profile's hard limits, magnitude first and
    /// direction kept. Answers with the wrench that the motors really make: what is left after that
    /// and after the common scaling of motors at their limits.
    ///
    /// # Errors
    /// [`DeviceError::NonFinite`], [`DeviceError::Stalled`]: a zero command went out instead.
    /// Anything else: the arm is lost.
    fn write(&mut self, wrench_device: &Wrench) -> Result<Wrench, DeviceError>;

    /// What the motors make beside the command of the last `write`, as a wrench at the grip:
    /// gravity compensation and damping of joints. The hand feels it where a link weighs less than
    /// its profile says, or where a motor pushes the wrong way. The default is none.
    fn beside_device(&self) -> Wrench {
        Wrench::ZERO
    }

    /// Told by the servo whether force may flow from the next `write` on, each time that changes.
    /// Arms with an enable bit pass it on, and only then does gravity compensation push. The
    /// default ignores it.
    fn set_enabled(&mut self, enabled: bool) {
        let _ = enabled;
    }

    /// Told before a trial of the signs: `true`, and they count as unverified whatever the profile
    /// says, until `false`. The motors then make the command and nothing beside it, and no more of
    /// it than the cap. The default ignores it, as simulated arms may.
    fn doubt_signs(&mut self, doubted: bool) {
        let _ = doubted;
    }

    /// What moves the hand of a simulated arm; `None`: a person holds it.
    fn hand(&mut self) -> Option<&mut HandControl> {
        None
    }

    /// Sends the zero command, as well as it can: the last thing that happens to an arm, on every
    /// way out. Idempotent; may be called at any time, after any error and from a drop guard while
    /// a panic unwinds, so it must not panic. A driver whose transport can lose a frame sends it
    /// twice.
    fn stop(&mut self);
}

impl<T: Device + ?Sized> Device for Box<T> {
    fn capabilities(&self) -> Capabilities {
        (**self).capabilities()
    }

    fn read(&mut self) -> Result<DeviceSample, DeviceError> {
        (**self).read()
    }

    fn write(&mut self, wrench_device: &Wrench) -> Result<Wrench, DeviceError> {
        (**self).write(wrench_device)
    }

    fn beside_device(&self) -> Wrench {
        (**self).beside_device()
    }

    fn set_enabled(&mut self, enabled: bool) {
        (**self).set_enabled(enabled);
    }

    fn doubt_signs(&mut self, doubted: bool) {
        (**self).doubt_signs(doubted);
    }

    fn hand(&mut self) -> Option<&mut HandControl> {
        (**self).hand()
    }

    fn stop(&mut self) {
        (**self).stop();
    }
}
