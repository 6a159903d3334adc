//! 3D Systems: Touch, Touch X, Omni, Desktop and Premium through `libHD` of OpenHaptics.
//!
//! ```text
//!   worker's thread ── command, sample ──► Shared ◄── tick, 1 kHz ── the library's scheduler ──► arm
//! ```
//! The library owns the servo loop: it calls [`tick`] a thousand times a second, and the last force
//! stays on until another tick sets one. So the tick counts the turns without a new command itself,
//! and goes to zero. Commands reach the motors in the next tick, and a sample is that of the last
//! one.
//!
//! Frames: the library has x right, y up, z toward the user, mm and mN·m; this program x toward the
//! operator, y right, z up, m and N·m.
//!
//! What the library does for safety stays on: clamping, ramping, its limits of force, impulse and
//! velocity.
//!
//! # Source
//! Facts of the headers `HD/hdDefines.h`, `hdDevice.h` and `hdScheduler.h` 3.0.66; frames and the
//! order of the end as in CHAI3D's `hdPhantom` and in `touch_ros2_control`.

use core::ffi::{c_uint, c_ulong, c_void};
use core::ptr::null;
use core::time::Duration;
use std::ffi::CString;
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::Instant;

use glam::{DMat3, DMat4, DQuat, DVec3};

use super::library::{Hd, Library, text_of};
use super::{Assignment, Family, HostLine, VendorArm, VendorCommand, VendorFault, VendorSample};
use vps::spatial::{Axes, Twist};

const BUTTONS: c_uint = 0x2000;
const VELOCITY: c_uint = 0x2051;
const TRANSFORM: c_uint = 0x2052;
const ANGULAR_VELOCITY: c_uint = 0x2053;
const MODEL: c_uint = 0x2501;
const DRIVER_VERSION: c_uint = 0x2502;
const SERIAL: c_uint = 0x2504;
const OUTPUT_AXES: c_uint = 0x2554;
const CALIBRATION_STYLE: c_uint = 0x2555;
const MAX_FORCE: c_uint = 0x2603;
const MOTOR_TEMPERATURE: c_uint = 0x2605;
const FORCE: c_uint = 0x2700;
/// Marked as deprecated, and what other programs use; only arms with six motors act on it.
const TORQUE: c_uint = 0x2701;

const FORCE_OUTPUT: c_uint = 0x4000;
const CLAMPING: c_uint = 0x4001;
const RAMPING: c_uint = 0x4002;
const FORCE_LIMIT: c_uint = 0x4003;

const CALIBRATION_OK: c_uint = 0x5000;
const CALIBRATION_NEEDS_UPDATE: c_uint = 0x5001;
const CALIBRATION_NEEDS_INPUT: c_uint = 0x5002;
const STYLE_ENCODER_RESET: i32 = 1;
const STYLE_AUTO: i32 = 2;
const STYLE_INKWELL: i32 = 4;

const NO_DEVICE: c_uint = u32::MAX;
const GO_ON: c_uint = 1;
const DONE: c_uint = 0;
const PRIORITY: u16 = 32767;

/// Ticks without a new command after which the tick sets zero. The worker's own turns are 2 ms
/// apart at most.
const HOLD_TICKS: u32 = 20;
/// Ticks between two looks at the calibration while it is not sound, and at the temperature of the
/// motors.
const LOOK_TICKS: u64 = 100;
/// Silence of the scheduler, whose tick is a millisecond, after which its last sample is none any
/// more, and after which the arm is lost.
const LATE: Duration = Duration::from_millis(5);
const SILENCE: Duration = Duration::from_millis(200);
/// As much of a turn of the worker, which takes 2 ms at most, counts as silence: a machine that
/// stood still has kept the scheduler from its tick as well.
const TURN_MAX: Duration = Duration::from_millis(20);
/// After the start, and after the end: the driver closes its port in a thread of its own.
const SETTLE: Duration = Duration::from_millis(300);
/// How long the zero of the end may wait for a turn of the scheduler.
const ZERO_PATIENCE: Duration = Duration::from_millis(50);
/// Share of its limit at which a motor is reported of.
const WARM: f64 = 0.8;
/// Errors that one tick takes off the library's stack.
const ERRORS: usize = 8;

const FAULTS: [(c_uint, u8, &str); 5] = [
    (0x200, 128, "its motors are too warm: let it rest, and begin again with less force"),
    (0x201, 129, "the library cut a force above the arm's limit, and switched it off"),
    (0x202, 130, "the library cut a step of force that was too large, and switched it off"),
    (0x203, 131, "the library switched its forces off because it moved too fast"),
    (0x204, 132, "the library reports an error of its forces"),
];

pub(super) fn fault_text(fault: u16) -> Option<&'static str> {
    FAULTS.iter().find(|(_, number, _)| u16::from(*number) == fault).map(|(.., text)| *text)
}

/// What the tick and the worker's thread exchange. One worker has one arm.
struct Shared {
    device: c_uint,
    style: i32,
    /// The arm is held in its reset position: said with `--home`.
    may_reset: bool,
    has_torque: bool,
    command: VendorCommand,
    /// Ticks since the command was set.
    age: u32,
    sample: VendorSample,
    ticks: u64,
    /// The hottest motor, as a share of its limit.
    heat: f64,
    lost: Option<c_uint>,
    is_over: bool,
}

impl Shared {
    /// Counts a tick; what the motors are to make in it.
    fn next(&mut self) -> VendorCommand {
        self.ticks += 1;
        self.age = self.age.saturating_add(1);
        let lives = !self.is_over && self.lost.is_none() && self.age <= HOLD_TICKS;
        if lives { self.command } else { VendorCommand::default() }
    }
}

static HD: OnceLock<Hd> = OnceLock::new();
static SHARED: Mutex<Option<Shared>> = Mutex::new(None);

fn shared() -> MutexGuard<'static, Option<Shared>> {
    SHARED.lock().unwrap_or_else(PoisonError::into_inner)
}

/// From the library's axes to those of this program.
fn device_from_hd() -> DMat3 {
    // Columns: where the library's x, y and z point.
    DMat3::from_cols(DVec3::Y, DVec3::Z, DVec3::X)
}

fn padded(vector: DVec3) -> [f64; 16] {
    let mut values = [0.0; 16];
    values[..3].copy_from_slice(&vector.to_array());
    values
}

/// Pose in the device frame of a matrix as the library writes it: column by column, mm.
fn pose_of(transform: &[f64; 16]) -> (DVec3, DQuat) {
    let p = device_from_hd();
    let matrix = DMat4::from_cols_array(transform);
    let rotation = p * DMat3::from_mat4(matrix) * p.transpose();
    // Small errors of the library make it no rotation, and a quaternion is one.
    let q = DQuat::from_mat3(&rotation);
    (p * matrix.w_axis.truncate() * 1e-3, if q.is_finite() { q.normalize() } else { q })
}

/// The library's callback. Foreign code is below it: nothing may unwind out of it, and nothing in
/// it panics.
extern "C" fn tick(_: *mut c_void) -> c_uint {
    let Some(hd) = HD.get() else { return DONE };
    let mut guard = shared();
    let Some(shared) = guard.as_mut() else { return DONE };
    let VendorCommand { force, torque, .. } = shared.next();
    let hd_from_device = device_from_hd().transpose();

    hd.hdMakeCurrentDevice(shared.device);
    hd.hdBeginFrame(shared.device);
    // A pose that the library does not write is no number, and no arm that rests at its origin.
    let mut transform = [f64::NAN; 16];
    let mut linear = [0.0; 16];
    let mut angular = [0.0; 16];
    let mut buttons = [0; 16];
    hd.hdGetDoublev(TRANSFORM, &mut transform);
    hd.hdGetDoublev(VELOCITY, &mut linear);
    hd.hdGetDoublev(ANGULAR_VELOCITY, &mut angular);
    hd.hdGetIntegerv(BUTTONS, &mut buttons);
    hd.hdSetDoublev(FORCE, &padded(hd_from_device * force));
    if shared.has_torque {
        hd.hdSetDoublev(TORQUE, &padded(hd_from_device * torque * 1e3));
    }
    if shared.ticks.is_multiple_of(LOOK_TICKS) {
        look(hd, shared);
    }
    hd.hdEndFrame(shared.device);

    let p = device_from_hd();
    let sample = &mut shared.sample;
    (sample.position, sample.orientation) = pose_of(&transform);
    let of = |values: &[f64; 16]| p * DVec3::new(values[0], values[1], values[2]);
    sample.twist = Twist { linear: of(&linear) * 1e-3, angular: of(&angular) };
    sample.buttons = buttons[0] as u16;
    for _ in 0..ERRORS {
        let error = hd.hdGetError();
        match error.code {
            0 => break,
            // A fault stays until the host has let go: the command without enable below takes it
            // away.
            code if FAULTS.iter().any(|(known, ..)| *known == code) => {
                sample.fault = FAULTS
                    .iter()
                    .find(|(known, ..)| *known == code)
                    .map_or(0, |(_, number, _)| *number);
            }
            code @ 0x300..=0x304 => shared.lost = Some(code),
            _ => {}
        }
    }
    if shared.is_over { DONE } else { GO_ON }
}

/// Every tenth of a second: the calibration, until it is sound, and the motors.
fn look(hd: &Hd, shared: &mut Shared) {
    if !shared.sample.homed {
        match hd.hdCheckCalibration() {
            CALIBRATION_OK => shared.sample.homed = true,
            // Where the arm is then becomes its zero, so a person has to have said that it is held
            // there.
            CALIBRATION_NEEDS_UPDATE | CALIBRATION_NEEDS_INPUT
                if shared.style == STYLE_ENCODER_RESET && shared.may_reset =>
            {
                hd.hdUpdateCalibration(shared.style.cast_unsigned());
            }
            CALIBRATION_NEEDS_UPDATE if shared.style != STYLE_ENCODER_RESET => {
                hd.hdUpdateCalibration(shared.style.cast_unsigned());
            }
            _ => {}
        }
    }
    let mut heat = [0.0; 16];
    hd.hdGetDoublev(MOTOR_TEMPERATURE, &mut heat);
    shared.heat = heat[..6]
        .iter()
        .fold(0.0, |hottest, share| if *share > hottest { *share } else { hottest });
}

/// The zero of the end, in a tick of its own.
extern "C" fn zero(_: *mut c_void) -> c_uint {
    let (Some(hd), Some(device)) = (HD.get(), shared().as_ref().map(|shared| shared.device)) else {
        return DONE;
    };
    hd.hdMakeCurrentDevice(device);
    hd.hdBeginFrame(device);
    hd.hdSetDoublev(FORCE, &padded(DVec3::ZERO));
    hd.hdSetDoublev(TORQUE, &padded(DVec3::ZERO));
    hd.hdEndFrame(device);
    DONE
}

impl Hd {
    /// The newest error, with what helps; the rest is taken off the stack.
    fn error(&self) -> Option<String> {
        let first = self.hdGetError();
        for _ in 0..ERRORS {
            if self.hdGetError().code == 0 {
                break;
            }
        }
        if first.code == 0 {
            return None;
        }
        let text = text_of(self.hdGetErrorString(first.code)).unwrap_or_default();
        let help = match first.code {
            0x300 | 0x301 => "; another program uses it: end that first",
            0x302 => {
                "; plug it in and switch it on, and see whether this user may open its port \
                    (/dev/ttyACM… or /dev/hidraw…)"
            }
            0x303 => {
                "; a program that was killed leaves it locked: unplug it, wait and plug it in. A \
                    Touch in another socket has another port: run the maker's setup again. \
                    GTDD_HOME has to name the folder of its configuration"
            }
            _ => "",
        };
        Some(format!(
            "{text} (HD error {:#06x}, internal {}, device {}){help}",
            first.code, first.internal, first.device
        ))
    }

    fn text(&self, name: c_uint) -> String {
        text_of(self.hdGetString(name)).unwrap_or_default()
    }
}

/// An open arm.
pub(super) struct LibraryArm {
    handle: c_ulong,
    identity: String,
    instruction: Option<&'static str>,
    ticks: u64,
    ticked: Instant,
    looked: Instant,
    silent: Duration,
    reported_warm: bool,
    news: Option<String>,
}

/// Opens the arm of an assignment, whose serial number is the name that the maker's setup gave it.
/// Nothing moves by itself.
pub(super) fn open(
    assignment: &Assignment,
    host: &mut HostLine,
) -> Result<LibraryArm, VendorFault> {
    let library = Library::open(Family::OpenHaptics, assignment.library.as_deref(), true)?;
    let hd = Hd::load(library)?;
    let hd = HD.get_or_init(|| hd);
    let name = assignment.serial.as_ref().map(|name| CString::new(name.as_str())).transpose();
    let name = name.map_err(|_| VendorFault("the name of an arm holds a zero byte".to_owned()))?;
    let device = hd.hdInitDevice(name.as_ref().map_or(null(), |name| name.as_ptr()));
    let error = hd.error();
    if device == NO_DEVICE || error.is_some() {
        // Left open, it would be locked until it is unplugged.
        if device != NO_DEVICE {
            hd.hdDisableDevice(device);
        }
        let called = assignment
            .serial
            .as_deref()
            .map_or("the default arm of its setup".to_owned(), |name| format!("the arm {name}"));
        return Err(VendorFault(format!(
            "the library does not open {called}: {}",
            error.unwrap_or_default()
        )));
    }
    hd.hdMakeCurrentDevice(device);
    let mut output = [0; 16];
    hd.hdGetIntegerv(OUTPUT_AXES, &mut output);
    let has_torque = assignment.arm().actuated.contains(Axes::ROTATION);
    if has_torque && output[0] < 6 {
        hd.hdDisableDevice(device);
        let model = hd.text(MODEL);
        return Err(VendorFault(format!(
            "{model} drives {} axes, and the profile says six: choose another profile",
            output[0]
        )));
    }
    for capability in [FORCE_OUTPUT, CLAMPING, RAMPING, FORCE_LIMIT] {
        hd.hdEnable(capability);
    }
    let mut style = [0; 16];
    hd.hdGetIntegerv(CALIBRATION_STYLE, &mut style);
    let mut most = [0.0; 16];
    hd.hdGetDoublev(MAX_FORCE, &mut most);
    let model = hd.text(MODEL);
    let serial = hd.text(SERIAL);
    let driver = hd.text(DRIVER_VERSION);
    let identity = format!(
        "{model}, serial number {serial}, driver {driver}, at most {:.2} N, {}",
        most[0],
        hd.library.path.display()
    );
    let sample = VendorSample {
        homed: hd.hdCheckCalibration() == CALIBRATION_OK,
        ..VendorSample::default()
    };
    // Of several that an arm offers the library takes one at a time.
    let (style, instruction) = match style[0] {
        bits if bits & STYLE_INKWELL != 0 => {
            (STYLE_INKWELL, "put the stylus into its inkwell until it is calibrated")
        }
        bits if bits & STYLE_ENCODER_RESET != 0 && assignment.home => (
            STYLE_ENCODER_RESET,
            "hold the arm in its reset position, as its manual shows, until it is calibrated",
        ),
        bits if bits & STYLE_ENCODER_RESET != 0 => {
            let how = "hold the arm in its reset position, as its manual shows, and say so: \
                hapticd devices probe PROFILE --home";
            (STYLE_ENCODER_RESET, how)
        }
        _ => (STYLE_AUTO, "move the grip through its workspace until it is calibrated"),
    };
    let instruction = Some(instruction).filter(|_| !sample.homed);
    // What was asked above may have answered with errors of its own, which say nothing of the arm.
    let _ = hd.error();
    *shared() = Some(Shared {
        device,
        style,
        may_reset: assignment.home,
        has_torque,
        command: VendorCommand::default(),
        age: 0,
        sample,
        ticks: 0,
        heat: 0.0,
        lost: None,
        is_over: false,
    });
    let _ = hd.hdSetSchedulerRate(1000);
    let handle = hd.hdScheduleAsynchronous(tick, core::ptr::null_mut(), PRIORITY);
    hd.hdStartScheduler();
    if let Some(text) = instruction {
        host.tell(text);
    }
    std::thread::sleep(SETTLE);
    let now = Instant::now();
    let mut arm = LibraryArm {
        handle,
        identity,
        instruction,
        ticks: 0,
        ticked: now,
        looked: now,
        silent: Duration::ZERO,
        reported_warm: false,
        news: None,
    };
    if shared().as_ref().is_none_or(|shared| shared.ticks == 0) {
        let error = hd.error().unwrap_or_default();
        arm.close();
        return Err(VendorFault(format!("the scheduler of the library does not run {error}")));
    }
    Ok(arm)
}

impl VendorArm for LibraryArm {
    fn identity(&self) -> String {
        self.identity.clone()
    }

    fn command(&mut self, command: &VendorCommand) -> Result<(), VendorFault> {
        if let Some(shared) = shared().as_mut() {
            (shared.command, shared.age) = (*command, 0);
            if !command.enabled {
                shared.sample.fault = 0;
            }
        }
        Ok(())
    }

    fn sample(&mut self) -> Result<VendorSample, VendorFault> {
        let guard = shared();
        let Some(shared) = guard.as_ref() else {
            return Err(VendorFault("the arm is closed".to_owned()));
        };
        if let Some(code) = shared.lost {
            return Err(VendorFault(format!(
                "the library has lost it (HD error {code:#06x}): see its cable and its power"
            )));
        }
        let now = Instant::now();
        self.silent += now.duration_since(self.looked).min(TURN_MAX);
        self.looked = now;
        if shared.ticks != self.ticks {
            (self.ticks, self.ticked, self.silent) = (shared.ticks, now, Duration::ZERO);
        } else if self.silent > SILENCE {
            return Err(VendorFault("the scheduler of the library stands still".to_owned()));
        }
        let is_repeat = now.duration_since(self.ticked) > LATE;
        if shared.sample.homed && self.instruction.take().is_some() {
            self.news = Some("it is calibrated now".to_owned());
        }
        if shared.heat >= WARM && !self.reported_warm {
            self.reported_warm = true;
            self.news = Some(format!(
                "a motor is at {:.0} % of the heat that it may have",
                shared.heat * 1e2
            ));
        }
        self.reported_warm &= shared.heat > 0.9 * WARM;
        Ok(VendorSample { is_repeat, ..shared.sample })
    }

    fn news(&mut self) -> Option<String> {
        self.news.take()
    }

    fn close(&mut self) {
        let Some(hd) = HD.get() else { return };
        if let Some(shared) = shared().as_mut() {
            (shared.command, shared.is_over) = (VendorCommand::default(), true);
        }
        // It waits for the scheduler, which may be what is broken: the tick has been ordered to
        // make zero, and the stop must come.
        let (done, has_done) = std::sync::mpsc::channel();
        let zeroes = move || {
            hd.hdScheduleSynchronous(zero, core::ptr::null_mut(), PRIORITY);
            let _ = done.send(());
        };
        // Without a thread the channel has no sender left, and nothing is waited for.
        let _ = std::thread::Builder::new().spawn(zeroes);
        let _ = has_done.recv_timeout(ZERO_PATIENCE);
        hd.hdStopScheduler();
        hd.hdUnschedule(self.handle);
        let closed = shared().take();
        if let Some(closed) = closed {
            hd.hdDisableDevice(closed.device);
        }
        std::thread::sleep(SETTLE);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_of_the_library_are_turned_into_those_of_the_program() {
        // The library: x right, y up, z toward the user; mm.
        let mut transform = DMat4::from_rotation_y(0.3).to_cols_array();
        transform[12..15].copy_from_slice(&[10.0, 20.0, 30.0]);
        let (position, orientation) = pose_of(&transform);
        assert!(
            (position - DVec3::new(0.03, 0.01, 0.02)).length() < 1e-12,
            "toward the operator, right, up: {position}"
        );
        assert!(
            orientation.angle_between(DQuat::from_rotation_z(0.3)) < 1e-9,
            "a turn about up: {orientation}"
        );
        let force = device_from_hd().transpose() * DVec3::new(1.0, 2.0, 3.0);
        assert_eq!(force, DVec3::new(2.0, 3.0, 1.0));
        assert!((device_from_hd().determinant() - 1.0).abs() < 1e-12);
    }

    #[test]
    fn the_tick_goes_to_zero_by_itself_without_new_commands_and_once_the_arm_is_lost() {
        let command = VendorCommand { force: DVec3::X, enabled: true, ..VendorCommand::default() };
        let sample = VendorSample::default();
        let fresh = |lost, is_over| Shared {
            device: 0,
            style: 0,
            may_reset: false,
            has_torque: false,
            command,
            age: 0,
            sample,
            ticks: 0,
            heat: 0.0,
            lost,
            is_over,
        };
        let mut shared = fresh(None, false);
        for n in 1..100 {
            assert_eq!(
                shared.next().force,
                if n <= HOLD_TICKS { DVec3::X } else { DVec3::ZERO },
                "{n}"
            );
        }
        shared.age = 0;
        assert_eq!(shared.next().force, DVec3::X, "a new command");
        assert_eq!(
            (fresh(Some(0x302), false).next().force, fresh(None, true).next().force),
            (DVec3::ZERO, DVec3::ZERO)
        );
    }

    #[test]
    fn every_error_of_its_forces_has_words() {
        for (_, number, _) in FAULTS {
            assert!(fault_text(number.into()).is_some());
        }
        assert_eq!((fault_text(0), fault_text(127), fault_text(133)), (None, None, None));
    }
}
