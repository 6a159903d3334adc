//! Haption: Virtuose 6D and Desktop 6D, in impedance mode.
//!
//! SI throughout; a pose is x, y, z and the quaternion x, y, z, w. How the base frame of the arm
//! stands is not published: the profile says it with `frame.device_from_native`, and it counts as
//! unverified until `devices probe --sign-check` has passed.
//!
//! # Source
//! Facts of the header `VirtuoseAPI.h` 4.03; order of the start as in published nodes for ROS.

use core::ffi::{c_int, c_uint};
use core::ptr::NonNull;

use glam::{DQuat, DVec3};

use super::library::{Context, Library, Virtuose, text_of};
use super::{Assignment, Family, HostLine, VendorArm, VendorCommand, VendorFault, VendorSample};
use vps::spatial::Twist;

/// Of `virtSetIndexingMode` and `virtSetCommandType`.
const INDEXING_NONE: c_int = 2;
const IMPEDANCE: c_int = 3;
/// s; the exchange of the worker.
const TIME_STEP_S: f32 = 1e-3;
/// s after which the controller itself takes the force away. 30 ms is what published nodes use.
const TIMEOUT_S: f32 = 0.03;
const IDENTITY: [f32; 7] = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0];
/// Where the service of the maker listens on this machine, and its port.
const ADDRESS: &str = "127.0.0.1#53210";
pub(crate) const PORT: u16 = 53210;
/// Turns between two looks at switches and alarms.
const STATUS_TURNS: u32 = 20;

const EMERGENCY_STOP: u8 = 128;
const POWER_OFF: u8 = 129;
const FAILURE: u8 = 130;
const OVERHEAT: u8 = 131;
const OVERRUN: u8 = 132;
const POSITION: u8 = 133;
const ALARMS: [(c_uint, u8); 3] = [(0x4000, OVERHEAT), (0x2_0000, OVERRUN), (0x4_0000, POSITION)];
/// Its motors make less than they are sent.
const SATURATE: c_uint = 0x8000;

pub(super) fn fault_text(fault: u16) -> Option<&'static str> {
    Some(match u8::try_from(fault).ok()? {
        EMERGENCY_STOP => "its emergency stop is pressed: release it, then enable again",
        POWER_OFF => {
            "its motors have no power: press the power button of the controller, then enable again"
        }
        FAILURE => {
            "its controller reports a failure of a motor or its electronics: see the maker's own \
                program"
        }
        OVERHEAT => "its motors are too hot: let it rest",
        OVERRUN => "its controller took longer than its period",
        POSITION => {
            "its controller refuses its position: move the grip away from the end of its travel"
        }
        _ => return None,
    })
}

/// An open arm.
pub(super) struct LibraryArm {
    library: Virtuose,
    context: Context,
    identity: String,
    last: VendorSample,
    is_powered: bool,
    turns: u32,
    reported_saturated: bool,
    reported_dead_man: bool,
    news: Option<String>,
}

/// Every call of the library gives 0, or leaves an error code.
fn done(
    library: &Virtuose,
    context: Option<Context>,
    what: &str,
    answer: c_int,
) -> Result<(), VendorFault> {
    if answer == 0 {
        return Ok(());
    }
    let code = library.virtGetErrorCode(context);
    let text = text_of(library.virtGetErrorMessage(code)).unwrap_or_default();
    Err(VendorFault(format!("{what}: {text} (VirtuoseAPI error {code})")))
}

/// Opens the arm of an assignment. It does not move.
pub(super) fn open(assignment: &Assignment, _: &mut HostLine) -> Result<LibraryArm, VendorFault> {
    let library =
        Virtuose::load(Library::open(Family::Virtuose, assignment.library.as_deref(), false)?)?;
    // The address stands where other arms have their serial number.
    let address = assignment.serial.as_deref().unwrap_or(ADDRESS);
    let name = std::ffi::CString::new(address)
        .map_err(|_| VendorFault(format!("address {address:?}: a zero byte is in it")))?;
    let Some(context) = NonNull::new(library.virtOpen(name.as_ptr())).map(Context) else {
        let what = format!(
            "no controller or service answers at {address}; start the maker's service, or name the \
                address with `match.serial`"
        );
        done(&library, None, &what, -1)?;
        return Err(VendorFault(what));
    };
    if let Err(fault) = start(&library, context, assignment) {
        library.virtClose(context);
        return Err(fault);
    }
    let mut kind = 0;
    let mut serial = 0;
    let model = if library.virtGetDeviceID(context, &mut kind, &mut serial) == 0 {
        format!("Virtuose of type {kind}, serial number {serial}")
    } else {
        "Virtuose".to_owned()
    };
    let identity = format!("{model} at {address}, {}", library.library.path.display());
    let last = VendorSample { homed: true, ..VendorSample::default() };
    Ok(LibraryArm {
        library,
        context,
        identity,
        last,
        is_powered: false,
        turns: 0,
        reported_saturated: false,
        reported_dead_man: false,
        news: None,
    })
}

/// What has to be set before the library takes a force.
fn start(library: &Virtuose, context: Context, assignment: &Assignment) -> Result<(), VendorFault> {
    let settle = |what: &str, answer: c_int| {
        done(library, Some(context), &format!("the {what} cannot be set"), answer)
    };
    settle("indexing mode", library.virtSetIndexingMode(context, INDEXING_NONE))?;
    settle("scale of force", library.virtSetForceFactor(context, 1.0))?;
    settle("scale of speed", library.virtSetSpeedFactor(context, 1.0))?;
    settle("time step", library.virtSetTimeStep(context, TIME_STEP_S))?;
    settle("base frame", library.virtSetBaseFrame(context, &mut IDENTITY.clone()))?;
    settle("observation frame", library.virtSetObservationFrame(context, &mut IDENTITY.clone()))?;
    settle(
        "speed of the observation frame",
        library.virtSetObservationFrameSpeed(context, &mut [0.0; 6]),
    )?;
    settle("impedance mode", library.virtSetCommandType(context, IMPEDANCE))?;
    // Older libraries have neither; the limits of the motor stage hold in any case.
    if let Some(answer) = library.virtSetTimeoutValue(context, TIMEOUT_S) {
        settle("time-out of the controller", answer)?;
    }
    if let Some(answer) =
        library.virtSaturateTorque(context, assignment.force_n, assignment.torque_nm)
    {
        settle("largest force", answer)?;
    }
    Ok(())
}

impl LibraryArm {
    fn done(&self, what: &str, answer: c_int) -> Result<(), VendorFault> {
        done(&self.library, Some(self.context), what, answer)
    }

    /// Switches, alarms and failures; why there is no force.
    fn look_at_status(&mut self) -> Result<(), VendorFault> {
        let mut stop = 0;
        let mut power = 0;
        let mut dead_man = 0;
        let mut alarms = 0;
        let mut failures = 0;
        self.done(
            "its emergency stop cannot be read",
            self.library.virtGetEmergencyStop(self.context, &mut stop),
        )?;
        self.done(
            "its power cannot be read",
            self.library.virtGetPowerOn(self.context, &mut power),
        )?;
        self.done(
            "its dead-man's switch cannot be read",
            self.library.virtGetDeadMan(self.context, &mut dead_man),
        )?;
        self.done(
            "its alarms cannot be read",
            self.library.virtGetAlarm(self.context, &mut alarms),
        )?;
        self.done(
            "its failures cannot be read",
            self.library.virtGetFailure(self.context, &mut failures),
        )?;
        let alarm = ALARMS.iter().find(|(bit, _)| alarms & bit != 0).map_or(0, |(_, fault)| *fault);
        self.last.fault = match () {
            () if stop != 0 => EMERGENCY_STOP,
            () if failures != 0 => FAILURE,
            () if self.is_powered && power == 0 => POWER_OFF,
            () => alarm,
        };
        if alarms & SATURATE != 0 && !self.reported_saturated {
            self.reported_saturated = true;
            self.news = Some(
                "its motors are at their limits: it makes less than it was ordered".to_owned(),
            );
        }
        if self.is_powered && dead_man == 0 && !self.reported_dead_man {
            self.reported_dead_man = true;
            self.news = Some(
                "its dead-man's switch is open: it makes no force before the grip is held"
                    .to_owned(),
            );
        }
        Ok(())
    }
}

impl VendorArm for LibraryArm {
    fn identity(&self) -> String {
        self.identity.clone()
    }

    fn command(&mut self, command: &VendorCommand) -> Result<(), VendorFault> {
        if command.enabled != self.is_powered {
            // Zero before the switch on both ways: a controller may keep the force that it was
            // given last. Without power it may refuse one.
            self.library.virtSetForce(self.context, &mut [0.0; 6]);
            let answer = self.library.virtSetPowerOn(self.context, command.enabled.into());
            self.done("its motors cannot be switched", answer)?;
            self.is_powered = command.enabled;
            self.reported_dead_man = false;
        }
        if !self.is_powered {
            return Ok(());
        }
        let VendorCommand { force, torque, .. } = command;
        let mut wrench = [force.x, force.y, force.z, torque.x, torque.y, torque.z]
            .map(|component| component as f32);
        self.done("it takes no force", self.library.virtSetForce(self.context, &mut wrench))
    }

    fn sample(&mut self) -> Result<VendorSample, VendorFault> {
        let mut pose = [0.0; 7];
        let mut speed = [0.0; 6];
        let mut button = 0;
        self.done(
            "its position cannot be read",
            self.library.virtGetPosition(self.context, &mut pose),
        )?;
        self.done(
            "its velocity cannot be read",
            self.library.virtGetPhysicalSpeed(self.context, &mut speed),
        )?;
        let [x, y, z, qx, qy, qz, qw] = pose.map(f64::from);
        self.last.position = DVec3::new(x, y, z);
        let q = DQuat::from_xyzw(qx, qy, qz, qw);
        self.last.orientation = if q.is_finite() && q.length() > 0.5 { q.normalize() } else { q };
        let [vx, vy, vz, wx, wy, wz] = speed.map(f64::from);
        self.last.twist = Twist { linear: DVec3::new(vx, vy, vz), angular: DVec3::new(wx, wy, wz) };
        self.last.buttons = 0;
        // The library counts its buttons from 1.
        for index in 1..=3 {
            if self.library.virtGetButton(self.context, index, &mut button) == 0 && button != 0 {
                self.last.buttons |= 1 << (index - 1);
            }
        }
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
        // What fails here has failed for good: the controller's time-out is what is left.
        if self.is_powered {
            self.library.virtSetForce(self.context, &mut [0.0; 6]);
            self.library.virtSetPowerOn(self.context, 0);
        }
        self.library.virtClose(self.context);
    }
}
