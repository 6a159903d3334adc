//! Force Dimension: omega, delta, sigma, lambda, and a Falcon through the same library.
//!
//! Frame and units are those of this program: m, rad, N, N·m; x toward the operator, y right, z up.
//! Calls of one arm come from one thread, since the library keeps its last error per thread.
//!
//! What the library and the firmware do for safety stays as it is: velocity threshold, watchdog and
//! gravity compensation are read and reported, never changed.
//!
//! # Source
//! Facts of the header `dhdc.h` 3.17.5 and of the published documentation of the SDK; order of the
//! start as in ICube's `fd_hardware`.

use core::ffi::{c_char, c_int};
use core::time::Duration;

use glam::{DMat3, DQuat, DVec3};

use super::library::{Dhd, Library, text_of};
use super::{Assignment, Family, HostLine, VendorArm, VendorCommand, VendorFault, VendorSample};
use vps::spatial::Twist;

/// A get that came too soon repeats what it said before; a set that was scaled down to what the
/// motors can.
const TIME_GUARD: c_int = 1;
const SATURATED: c_int = 2;
/// In `dhdGetStatus`.
const STATUS_FORCE: usize = 5;
const STATUS_OFF_CAUSE: usize = 14;
/// Turns between two looks at the status.
const STATUS_TURNS: u32 = 50;
/// Looks at a status without force after it was switched on until that counts as a fault: it takes
/// some to come on.
const OFF_LOOKS: u32 = 4;
/// Answers in a row that repeat the one before, until the arm counts as lost: half a second at 500
/// turns per second.
const REPEATS_MAX: u32 = 250;
/// After the start, for the forces of the brakes to go.
const SETTLE: Duration = Duration::from_millis(100);

/// Fault of a sample: force is off though it was switched on; the cause is added.
const FORCE_OFF: u8 = 128;
const CAUSES: [&str; 7] = [
    "its forces are off, and it does not say why",
    "its forces were switched off by the button on its control unit: press the button, then enable \
        again",
    "its forces were switched off because it moved too fast: press the force button, or enable \
        again",
    "its own watchdog has switched its forces off: commands came too slowly",
    "its forces were switched off by a program",
    "its forces are off because its USB cable was out",
    "its forces are off because its dead-man's switch is open",
];

pub(super) fn fault_text(fault: u16) -> Option<&'static str> {
    CAUSES.get(usize::from(fault.checked_sub(FORCE_OFF.into())?)).copied()
}

/// An open arm.
pub(super) struct LibraryArm {
    dhd: Dhd,
    id: c_char,
    identity: String,
    is_left_handed: bool,
    has_wrist: bool,
    has_gripper: bool,
    homed: bool,
    last: VendorSample,
    /// Force was asked for, as the library was last reported.
    has_force: bool,
    turns: u32,
    off_looks: u32,
    repeats: u32,
    saturated: u64,
    reported_saturated: bool,
    news: Option<String>,
}

impl Dhd {
    fn failed(&self, what: &str) -> VendorFault {
        let text = text_of(self.dhdErrorGetLastStr()).unwrap_or_default();
        VendorFault(format!("{what}: {text} (DHD error {})", self.dhdErrorGetLast()))
    }

    fn done(&self, what: &str, answer: c_int) -> Result<c_int, VendorFault> {
        if answer < 0 { Err(self.failed(what)) } else { Ok(answer) }
    }
}

/// Opens the arm of an assignment. Moves it only where it says `home`.
pub(super) fn open(
    assignment: &Assignment,
    host: &mut HostLine,
) -> Result<LibraryArm, VendorFault> {
    let dhd =
        Dhd::load(Library::open(Family::ForceDimension, assignment.library.as_deref(), false)?)?;
    let id = find(&dhd, assignment.serial.as_deref())?;
    match start(&dhd, id, assignment, host) {
        Ok(homed) => LibraryArm::new(dhd, id, assignment, homed),
        Err(fault) => {
            dhd.dhdStop(id);
            dhd.dhdClose(id);
            Err(fault)
        }
    }
}

/// Opens the arm of a serial number, or the first one.
fn find(dhd: &Dhd, serial: Option<&str>) -> Result<c_char, VendorFault> {
    let (what, answer) = match serial {
        None => ("no arm".to_owned(), dhd.dhdOpen()),
        Some(text) => {
            let number = text.parse().map_err(|_| {
                VendorFault(format!("serial number {text}: a whole number is needed"))
            })?;
            let too_old = || {
                VendorFault(
                    "the library is too old to choose an arm by its serial number: take \
                    3.16 or later"
                        .to_owned(),
                )
            };
            (
                format!("no arm with serial number {number}"),
                dhd.dhdOpenSerial(number).ok_or_else(too_old)?,
            )
        }
    };
    let what = format!(
        "the library finds {what} that it can open; plug it in, switch it on, and end other \
            programs that use it"
    );
    Ok(dhd.done(&what, answer)? as c_char)
}

/// Brings an opened arm to where it takes commands; whether it knows its zero.
fn start(
    dhd: &Dhd,
    id: c_char,
    assignment: &Assignment,
    host: &mut HostLine,
) -> Result<bool, VendorFault> {
    let is_initialised = || {
        dhd.drdOpenID(id);
        dhd.drdIsInitialized(id).map(|answer| answer != 0)
    };
    let mut homed = is_initialised();
    if homed == Some(false) {
        if !assignment.home {
            return Err(VendorFault(
                "the arm does not know where it is since it was switched on, and finds that out by \
                    moving by itself. Clear the space around it, then let it: hapticd devices \
                    probe PROFILE --home; or use the maker's own program"
                    .to_owned(),
            ));
        }
        host.tell("the arm moves by itself now, to find its zero");
        let stop = || {
            // `false`: with its brakes.
            dhd.drdStop(0, id);
            dhd.dhdStop(id);
        };
        let answer = host.during(|| dhd.drdAutoInit(id), stop);
        dhd.done("the arm could not find its zero", answer.unwrap_or(-1))?;
        // `true`: stays able to make forces.
        dhd.drdStop(1, id);
        homed = is_initialised();
    }
    dhd.done("the largest force cannot be set", dhd.dhdSetMaxForce(assignment.force_n.into(), id))?;
    if assignment.torque_nm > 0.0 {
        dhd.done(
            "the largest torque cannot be set",
            dhd.dhdSetMaxTorque(assignment.torque_nm.into(), id),
        )?;
    }
    dhd.done("the brakes cannot be released", dhd.dhdSetBrakes(0, id))?;
    dhd.done("gravity compensation cannot be switched on", dhd.dhdSetGravityCompensation(1, id))?;
    // The search for the zero leaves forces on, and nothing has enabled any.
    dhd.done("its forces cannot be switched off", dhd.dhdEnableForce(0, id))?;
    std::thread::sleep(SETTLE);
    // `libdhd` alone cannot say; arms that need no start are at home.
    Ok(homed.unwrap_or(true))
}

impl LibraryArm {
    fn new(
        dhd: Dhd,
        id: c_char,
        assignment: &Assignment,
        homed: bool,
    ) -> Result<Self, VendorFault> {
        let name = text_of(dhd.dhdGetSystemName(id))
            .unwrap_or_else(|| format!("type {}", dhd.dhdGetSystemType(id)));
        let mut serial = 0;
        let serial = if dhd.dhdGetSerialNumber(&mut serial, id) >= 0 {
            format!(", serial number {serial}")
        } else {
            String::new()
        };
        let version = dhd
            .dhdGetSDKVersionStr()
            .and_then(text_of)
            .map(|text| format!(", DHD {text}"))
            .unwrap_or_default();
        let mut eighths_ms = 0;
        let watchdog = match dhd.dhdGetWatchdog(&mut eighths_ms, id) {
            Some(0..) if eighths_ms == 0 => ", its own watchdog off".to_owned(),
            Some(0..) => format!(", its own watchdog {} ms", f64::from(eighths_ms) * 0.125),
            _ => String::new(),
        };
        let has_wrist = dhd.dhdHasWrist(id) != 0;
        let has_gripper = dhd.dhdHasGripper(id) != 0;
        let is_left_handed = dhd.dhdIsLeftHanded(id) != 0;
        let wants = assignment.arm();
        let rotation = vps::spatial::Axes::ROTATION;
        if wants.sensed.contains(rotation) && !has_wrist {
            dhd.dhdStop(id);
            dhd.dhdClose(id);
            return Err(VendorFault(format!(
                "{name} has no wrist, and the profile says that it measures rx ry rz: choose \
                    another profile"
            )));
        }
        let left = if is_left_handed { ", left-handed" } else { "" };
        let identity =
            format!("{name}{left}{serial}{version}{watchdog}, {}", dhd.library.path.display());
        Ok(Self {
            dhd,
            id,
            identity,
            is_left_handed,
            has_wrist,
            has_gripper,
            homed,
            last: VendorSample::default(),
            has_force: false,
            turns: 0,
            off_looks: 0,
            repeats: 0,
            saturated: 0,
            reported_saturated: false,
            news: None,
        })
    }

    /// Angle and force of the gripper have the other sign on a left-handed arm.
    fn hand_sign(&self) -> f64 {
        if self.is_left_handed { -1.0 } else { 1.0 }
    }

    /// Whether force is off that was switched on, and why.
    fn look_at_status(&mut self) -> Result<(), VendorFault> {
        let mut status = [0; 17];
        self.dhd.done("its status cannot be read", self.dhd.dhdGetStatus(&mut status, self.id))?;
        let is_off = self.has_force && status[STATUS_FORCE] == 0;
        self.off_looks = if is_off { self.off_looks + 1 } else { 0 };
        let cause = u8::try_from(status[STATUS_OFF_CAUSE])
            .ok()
            .filter(|cause| usize::from(*cause) < CAUSES.len())
            .unwrap_or(0);
        self.last.fault = if self.off_looks >= OFF_LOOKS { FORCE_OFF + cause } else { 0 };
        Ok(())
    }
}

impl VendorArm for LibraryArm {
    fn identity(&self) -> String {
        self.identity.clone()
    }

    fn command(&mut self, command: &VendorCommand) -> Result<(), VendorFault> {
        if command.enabled != self.has_force {
            self.has_force = command.enabled;
            self.off_looks = 0;
            self.turns = 0;
            let answer = self.dhd.dhdEnableForce(command.enabled.into(), self.id);
            self.dhd.done("its forces cannot be switched", answer)?;
        }
        let VendorCommand { force, torque, .. } = command;
        // The gripper's motor gets zero: nothing computes a grip force, and no limit holds one.
        let answer = self.dhd.dhdSetForceAndTorqueAndGripperForce(
            force.x, force.y, force.z, torque.x, torque.y, torque.z, 0.0, self.id,
        );
        if self.dhd.done("it takes no force", answer)? == SATURATED {
            self.saturated += 1;
            if !self.reported_saturated {
                self.reported_saturated = true;
                self.news = Some(
                    "its motors are at their limits: it makes less than it was ordered, in the \
                        same direction"
                        .to_owned(),
                );
            }
        }
        Ok(())
    }

    fn sample(&mut self) -> Result<VendorSample, VendorFault> {
        let id = self.id;
        let dhd = &self.dhd;
        let mut x = 0.0;
        let mut y = 0.0;
        let mut z = 0.0;
        let mut rows = [[0.0; 3]; 3];
        let answer = dhd.done(
            "its position cannot be read",
            dhd.dhdGetPositionAndOrientationFrame(&mut x, &mut y, &mut z, &mut rows, id),
        )?;
        self.repeats = if answer == TIME_GUARD { self.repeats + 1 } else { 0 };
        if self.repeats >= REPEATS_MAX {
            return Err(VendorFault(
                "it repeats its last position and gives no new one".to_owned(),
            ));
        }
        self.last.is_repeat = answer == TIME_GUARD;
        self.last.position = DVec3::new(x, y, z);
        if self.has_wrist {
            // Row by row; small errors of its own make it no rotation, and a quaternion is one.
            let q = DQuat::from_mat3(&DMat3::from_cols_array_2d(&rows).transpose());
            self.last.orientation = if q.is_finite() { q.normalize() } else { q };
        }
        dhd.done(
            "its velocity cannot be read",
            dhd.dhdGetLinearVelocity(&mut x, &mut y, &mut z, id),
        )?;
        let linear = DVec3::new(x, y, z);
        let mut x = 0.0;
        let mut y = 0.0;
        let mut z = 0.0;
        if self.has_wrist
            && dhd
                .dhdGetAngularVelocityRad(&mut x, &mut y, &mut z, id)
                .is_none_or(|answer| answer < 0)
        {
            (x, y, z) = (0.0, 0.0, 0.0);
        }
        self.last.twist = Twist { linear, angular: DVec3::new(x, y, z) };
        if self.has_gripper {
            let mut angle = 0.0;
            let mut rate = 0.0;
            dhd.dhdGetGripperAngleRad(&mut angle, id);
            dhd.dhdGetGripperAngularVelocityRad(&mut rate, id);
            self.last.grip = [self.hand_sign() * angle, self.hand_sign() * rate];
        }
        self.last.buttons = dhd.dhdGetButtonMask(id) as u16;
        self.last.homed = self.homed;
        self.turns += 1;
        if self.turns.is_multiple_of(STATUS_TURNS) {
            self.look_at_status()?;
        }
        Ok(self.last)
    }

    fn news(&mut self) -> Option<String> {
        self.news.take()
    }

    fn close(&mut self) {
        // What fails here has failed for good: the firmware's watchdog is what is left.
        for _ in 0..2 {
            self.dhd
                .dhdSetForceAndTorqueAndGripperForce(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, self.id);
        }
        self.dhd.dhdEnableForce(0, self.id);
        self.dhd.dhdStop(self.id);
        self.dhd.dhdClose(self.id);
    }
}
