//! A `libHD` without an arm: the functions of 3D Systems' OpenHaptics, over a mock arm of `hapticd
//! mock`.
//!
//! ```sh
//! cargo build -p arms-testing --example mock_hd
//! hapticd mock touch --pty /tmp/arm &
//! HAPTICD_MOCK_ARM=/tmp/arm LD_PRELOAD=target/debug/examples/libmock_hd.so ./my-program
//! ```
//! `HAPTICD_MOCK_FAULT` names what goes wrong, in a list with commas, each with `@` and the seconds
//! after the first force if not at once:
//!
//! | word | what happens |
//! |---|---|
//! | `no-device` | the open fails with COMM_CONFIG, as of an arm that a killed program left locked |
//! | `uncalibrated` | calibration needs a person until 1 s after the start |
//! | `encoder-reset` | as `uncalibrated`, for good: it offers encoder reset and automatic, and takes one of them, not both |
//! | `warm`, `velocity` | the errors WARM_MOTORS, EXCEEDED_MAX_VELOCITY |
//! | `com` | COMM_ERROR, as of a cable that is out |
//! | `garbage` | positions and velocities are numbers without sense |
//! | `still` | the scheduler stands still |
//! | `crash`, `exit`, `hang` | what foreign code may do |
//!
//! `HAPTICD_MOCK_FAULT_FILE` names a file with such a list, which counts from when it is written
//! until it is emptied. An arm that answers three commands in a row with nothing is COMM_ERROR:
//! assumed.
//!
//! Signatures and numbers are facts of the published headers, typed anew; no code of the maker is
//! in here. Functions that are not here were not needed yet.
#![expect(unsafe_code, reason = "symbols without mangling, and arrays of C")]
#![allow(
    missing_docs,
    clippy::missing_docs_in_private_items,
    clippy::missing_safety_doc,
    reason = "the maker's documentation says what they do"
)]

mod mock_link;

use core::ffi::{CStr, c_char, c_double, c_int, c_uint, c_ulong, c_ushort, c_void};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use glam::{DMat4, DQuat, DVec3};

use self::mock_link::{Mock, has_fault};

type Callback = extern "C" fn(*mut c_void) -> c_uint;

#[repr(C)]
pub struct ErrorInfo {
    code: c_uint,
    internal: c_int,
    device: c_uint,
}

struct Arm {
    mock: Mock,
    /// In the axes of the library, N and N·m.
    force: DVec3,
    torque: DVec3,
    errors: Vec<c_uint>,
    calibrated: bool,
    started: Option<Instant>,
    reported: Vec<c_uint>,
}

#[derive(Default)]
struct Scheduler {
    callbacks: Vec<(c_ulong, Callback, usize)>,
    next: c_ulong,
    runs: bool,
    thread: Option<JoinHandle<()>>,
}

static ARM: Mutex<Option<Arm>> = Mutex::new(None);
static SCHEDULER: Mutex<Option<Scheduler>> = Mutex::new(None);
static EARLY: Mutex<Vec<c_uint>> = Mutex::new(Vec::new());

fn lock<T>(mutex: &'static Mutex<T>) -> MutexGuard<'static, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The library has x right, y up and z toward the user.
fn to_library(v: DVec3) -> DVec3 {
    DVec3::new(v.y, v.z, v.x)
}

fn from_library(v: DVec3) -> DVec3 {
    DVec3::new(v.z, v.x, v.y)
}

impl Arm {
    fn open() -> Option<Self> {
        if has_fault("no-device") {
            return None;
        }
        Some(Self {
            mock: Mock::open()?,
            force: DVec3::ZERO,
            torque: DVec3::ZERO,
            errors: Vec::new(),
            calibrated: !has_fault("uncalibrated") && !has_fault("encoder-reset"),
            started: None,
            reported: Vec::new(),
        })
    }

    /// A millisecond: the last force stays on.
    fn turn(&mut self) {
        let force = from_library(self.force);
        let torque = from_library(self.torque);
        let is_asked = self.force != DVec3::ZERO || self.torque != DVec3::ZERO;
        if is_asked {
            self.mock.force_comes();
        }
        // Without enable first: what its watchdog switched off comes back on no other way.
        let is_on = is_asked && !self.mock.has_tripped();
        let is_there = self
            .mock
            .exchange(&[force.x, force.y, force.z, torque.x, torque.y, torque.z, 0.0], is_on);
        let is_gone = !is_there || self.mock.is_silent;
        for (is_so, code) in [
            (self.mock.fault("warm"), 0x200),
            (self.mock.fault("velocity"), 0x203),
            (is_gone, 0x302),
        ] {
            // Each is reported once, as long as it lasts.
            if is_so && !self.reported.contains(&code) {
                self.errors.push(code);
                self.reported.push(code);
            } else if !is_so {
                self.reported.retain(|reported| *reported != code);
            }
        }
        self.calibrated |= !has_fault("encoder-reset")
            && self.started.is_some_and(|started| started.elapsed() > Duration::from_secs(1));
    }

    /// What a name of three or sixteen numbers stands for.
    fn doubles(&self, name: c_uint) -> Option<Vec<f64>> {
        let [x, y, z, qx, qy, qz, qw, _] = self.mock.pose;
        let [vx, vy, vz, wx, wy, wz] = self.mock.twist;
        let three = |x, y, z| to_library(DVec3::new(x, y, z));
        let position = three(x, y, z) * 1e3;
        Some(match name {
            0x2050 => position.to_array().to_vec(),
            0x2051 => (three(vx, vy, vz) * 1e3).to_array().to_vec(),
            0x2052 => {
                let turned = three(qx, qy, qz);
                let rotation = DQuat::from_xyzw(turned.x, turned.y, turned.z, qw);
                DMat4::from_rotation_translation(rotation, position).to_cols_array().to_vec()
            }
            0x2053 => three(wx, wy, wz).to_array().to_vec(),
            0x2603 => vec![3.3],
            0x2605 => vec![if self.mock.fault("warm") { 1.0 } else { 0.1 }; 6],
            _ => return None,
        })
    }

    fn has_torque(&self) -> bool {
        self.mock.actuated >> 3 & 7 != 0
    }
}

fn with<T: Default>(then: impl FnOnce(&mut Arm) -> T) -> T {
    lock(&ARM).as_mut().map(then).unwrap_or_default()
}

fn is_still() -> bool {
    with(|arm| {
        arm.mock.look();
        arm.mock.fault("still")
    })
}

/// Runs everything that is scheduled, once a millisecond. Callbacks call the functions below, so
/// nothing is locked meanwhile.
fn schedule() {
    let mut deadline = Instant::now();
    loop {
        deadline += Duration::from_millis(1);
        std::thread::sleep(deadline.saturating_duration_since(Instant::now()));
        if is_still() {
            continue;
        }
        let callbacks = match lock(&SCHEDULER).as_ref() {
            Some(scheduler) if scheduler.runs => scheduler.callbacks.clone(),
            _ => return,
        };
        for (handle, callback, data) in callbacks {
            if callback(data as *mut c_void) == 0
                && let Some(scheduler) = lock(&SCHEDULER).as_mut()
            {
                scheduler.callbacks.retain(|(other, ..)| *other != handle);
            }
        }
        with(Arm::turn);
    }
}

#[unsafe(no_mangle)]
pub extern "C" fn hdInitDevice(_name: *const c_char) -> c_uint {
    let arm = Arm::open();
    if arm.is_none() {
        lock(&EARLY).push(0x303);
        return u32::MAX;
    }
    *lock(&ARM) = arm;
    0
}

#[unsafe(no_mangle)]
pub extern "C" fn hdGetCurrentDevice() -> c_uint {
    0
}

#[unsafe(no_mangle)]
pub extern "C" fn hdMakeCurrentDevice(_device: c_uint) {}

#[unsafe(no_mangle)]
pub extern "C" fn hdDisableDevice(_device: c_uint) {
    *lock(&ARM) = None;
}

#[unsafe(no_mangle)]
pub extern "C" fn hdBeginFrame(_device: c_uint) {}

#[unsafe(no_mangle)]
pub extern "C" fn hdEndFrame(_device: c_uint) {}

#[unsafe(no_mangle)]
pub extern "C" fn hdGetError() -> ErrorInfo {
    let code = lock(&EARLY).pop().or_else(|| with(|arm| arm.errors.pop())).unwrap_or(0);
    ErrorInfo { code, internal: 0, device: 0 }
}

#[unsafe(no_mangle)]
pub extern "C" fn hdGetErrorString(code: c_uint) -> *const c_char {
    let text: &CStr = match code {
        0x200 => c"warm motors",
        0x203 => c"exceeded maximum velocity",
        0x302 => c"communication error",
        0x303 => c"communication configuration error",
        _ => c"error",
    };
    text.as_ptr()
}

#[unsafe(no_mangle)]
pub extern "C" fn hdGetString(name: c_uint) -> *const c_char {
    let text: &CStr = match name {
        0x2501 => c"Mock Touch",
        0x2502 => c"0.0",
        0x2503 => c"hapticd",
        _ => c"mock",
    };
    text.as_ptr()
}

#[unsafe(no_mangle)]
pub extern "C" fn hdEnable(_capability: c_uint) {}

#[unsafe(no_mangle)]
pub extern "C" fn hdDisable(_capability: c_uint) {}

#[unsafe(no_mangle)]
pub extern "C" fn hdIsEnabled(_capability: c_uint) -> u8 {
    1
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hdGetIntegerv(name: c_uint, values: *mut c_int) {
    let value = match name {
        0x2000 => with(|arm| arm.mock.buttons.into()),
        0x2553 => 6,
        0x2554 => with(|arm| if arm.has_torque() { 6 } else { 3 }),
        0x2555 => styles(),
        _ => return with(|arm| arm.errors.push(0x100)),
    };
    // SAFETY: the caller has room for what the name stands for: one number.
    unsafe { values.write(value) };
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hdGetDoublev(name: c_uint, values: *mut c_double) {
    match with(|arm| arm.doubles(name)) {
        // SAFETY: the caller has room for what the name stands for.
        Some(numbers) => unsafe {
            values.copy_from_nonoverlapping(numbers.as_ptr(), numbers.len())
        },
        None => with(|arm| arm.errors.push(0x100)),
    }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hdSetDoublev(name: c_uint, values: *const c_double) {
    // SAFETY: the caller gives three numbers for each of these names.
    let given = unsafe { DVec3::from_array(values.cast::<[f64; 3]>().read_unaligned()) };
    with(|arm| match name {
        0x2700 => arm.force = given,
        0x2701 => arm.torque = given * 1e-3,
        _ => arm.errors.push(0x100),
    });
}

#[unsafe(no_mangle)]
pub extern "C" fn hdCheckCalibration() -> c_uint {
    if with(|arm| arm.calibrated) { 0x5000 } else { 0x5002 }
}

#[unsafe(no_mangle)]
pub extern "C" fn hdUpdateCalibration(style: c_uint) {
    with(|arm| {
        if style.is_power_of_two() && style & styles().cast_unsigned() != 0 {
            arm.calibrated |= style == 1;
        } else {
            arm.errors.push(0x101);
        }
    });
}

/// Encoder reset 1, automatic 2, inkwell 4.
fn styles() -> c_int {
    if has_fault("encoder-reset") { 3 } else { 4 }
}

#[unsafe(no_mangle)]
pub extern "C" fn hdSetSchedulerRate(_hz: c_ulong) {}

#[unsafe(no_mangle)]
pub extern "C" fn hdStartScheduler() {
    with(|arm| arm.started = Some(Instant::now()));
    let mut scheduler = lock(&SCHEDULER);
    let scheduler = scheduler.get_or_insert_default();
    scheduler.runs = true;
    scheduler.thread.get_or_insert_with(|| std::thread::spawn(schedule));
}

#[unsafe(no_mangle)]
pub extern "C" fn hdStopScheduler() {
    let thread = lock(&SCHEDULER).as_mut().and_then(|scheduler| {
        scheduler.runs = false;
        scheduler.thread.take()
    });
    // One that stands still does not come to an end.
    if let Some(thread) = thread.filter(|_| !is_still()) {
        let _ = thread.join();
    }
}

#[unsafe(no_mangle)]
pub extern "C" fn hdScheduleAsynchronous(
    callback: Callback,
    data: *mut c_void,
    _priority: c_ushort,
) -> c_ulong {
    let mut scheduler = lock(&SCHEDULER);
    let scheduler = scheduler.get_or_insert_default();
    scheduler.next += 1;
    scheduler.callbacks.push((scheduler.next, callback, data as usize));
    scheduler.next
}

#[unsafe(no_mangle)]
pub extern "C" fn hdScheduleSynchronous(
    callback: Callback,
    data: *mut c_void,
    _priority: c_ushort,
) {
    callback(data);
    with(Arm::turn);
}

#[unsafe(no_mangle)]
pub extern "C" fn hdUnschedule(handle: c_ulong) {
    if let Some(scheduler) = lock(&SCHEDULER).as_mut() {
        scheduler.callbacks.retain(|(other, ..)| *other != handle);
    }
}
