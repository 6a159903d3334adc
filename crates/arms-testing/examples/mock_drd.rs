//! A `libdrd` without an arm: the functions of Force Dimension's library, over a mock arm of
//! `hapticd mock`.
//!
//! ```text
//!   a program that loads libdrd ─► this library ── open6, a pty ─► hapticd mock omega6 --pty PATH
//! ```
//! Programs that were written for the library run against a simulated arm with it, in CI as well:
//!
//! ```sh
//! cargo build -p arms-testing --example mock_drd
//! hapticd mock omega6 --pty /tmp/arm &
//! HAPTICD_MOCK_ARM=/tmp/arm LD_PRELOAD=target/debug/examples/libmock_drd.so ./my-program
//! ```
//! `HAPTICD_MOCK_FAULT` names what goes wrong, in a list with commas, each with `@` and the seconds
//! after the first force was switched on if not at once:
//!
//! | word | what happens |
//! |---|---|
//! | `no-device`, `in-use` | the open fails |
//! | `uninitialised` | the arm does not know its zero until `drdAutoInit` |
//! | `slow-init` | as `uninitialised`, and `drdAutoInit` pushes for 3 s, until `drdStop` |
//! | `left-handed`, `no-wrist` | it is another arm |
//! | `gripper` | its gripper is open by 0.3 rad |
//! | `time-guard` | every position repeats the one before |
//! | `saturated` | every force is answered with MOTOR_SATURATED |
//! | `button`, `velocity`, `watchdog`, `software`, `usb`, `dead-man` | the forces are off, for this cause |
//! | `com` | every call fails, as without a cable |
//! | `garbage` | positions and velocities are numbers without sense |
//! | `crash`, `exit`, `hang` | what foreign code may do |
//!
//! `HAPTICD_MOCK_FAULT_FILE` names a file with such a list, which counts from when it is written
//! until it is emptied.
//!
//! Signatures and numbers are facts of the published header, typed anew; no code of the maker is in
//! here. Functions that are not here were not needed yet.
#![expect(unsafe_code, reason = "symbols without mangling")]
#![allow(
    missing_docs,
    clippy::missing_docs_in_private_items,
    reason = "the maker's documentation says what they do"
)]

mod mock_link;

use core::ffi::{c_char, c_double, c_int, c_uchar, c_uint, c_ushort};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use self::mock_link::{Mock, has_fault};

const OK: c_int = 0;
const TIME_GUARD: c_int = 1;
const SATURATED: c_int = 2;
const COM: c_int = 2;
const NO_DEVICE: c_int = 5;
const NOT_AVAILABLE: c_int = 6;
const IN_USE: c_int = 20;
const CAUSE_NONE: c_int = 0;
const CAUSE_WATCHDOG: c_int = 3;
const CAUSES: [(&str, c_int); 6] = [
    ("button", 1),
    ("velocity", 2),
    ("watchdog", CAUSE_WATCHDOG),
    ("software", 4),
    ("usb", 5),
    ("dead-man", 6),
];
/// Serial number of the one arm that there is.
const SERIAL: c_ushort = 1;
/// What `slow-init` pushes with, N, and for how long.
const INIT_N: f64 = 0.5;
const INIT_TIME: Duration = Duration::from_secs(3);

struct Arm {
    mock: Mock,
    force_on: bool,
    force: [f64; 7],
    gravity: bool,
    brakes: bool,
    max_n: f64,
    max_nm: f64,
    initialised: bool,
}

struct State {
    arm: Option<Arm>,
    error: c_int,
}

/// `drdStop` was called.
static STOPPED: AtomicBool = AtomicBool::new(false);

static STATE: Mutex<State> = Mutex::new(State { arm: None, error: 0 });

fn state() -> MutexGuard<'static, State> {
    STATE.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Arm {
    fn open() -> Result<Self, c_int> {
        if has_fault("no-device") {
            return Err(NO_DEVICE);
        }
        if has_fault("in-use") {
            return Err(IN_USE);
        }
        Ok(Self {
            mock: Mock::open().ok_or(NO_DEVICE)?,
            force_on: false,
            force: [0.0; 7],
            gravity: true,
            brakes: true,
            max_n: -1.0,
            max_nm: -1.0,
            initialised: !has_fault("uninitialised") && !has_fault("slow-init"),
        })
    }

    fn off_cause(&self) -> c_int {
        let named = CAUSES.iter().find(|(word, _)| self.mock.fault(word)).map(|(_, cause)| *cause);
        named.unwrap_or(if self.mock.has_tripped() { CAUSE_WATCHDOG } else { CAUSE_NONE })
    }

    /// Sends the force and takes where the arm is then.
    fn exchange(&mut self) -> Result<c_int, c_int> {
        let is_on = self.force_on && self.off_cause() == CAUSE_NONE;
        let within =
            |force: f64, limit: f64| if limit >= 0.0 { force.clamp(-limit, limit) } else { force };
        let limits = [self.max_n, self.max_nm];
        let force =
            core::array::from_fn(|axis| within(self.force[axis], limits[usize::from(axis >= 3)]));
        if !self.mock.exchange(&force, is_on) {
            return Err(COM);
        }
        Ok(if self.mock.fault("saturated") { SATURATED } else { OK })
    }

    fn kind(&self) -> c_int {
        let is_left = has_fault("left-handed");
        let find = |part: &str| self.mock.name.contains(part);
        match () {
            () if find("omega6") => 34 + 2 * c_int::from(is_left),
            () if find("omega7") => 35 + 2 * c_int::from(is_left),
            () if find("sigma7") => 104 + c_int::from(is_left),
            () if find("lambda7") => 108 + c_int::from(is_left),
            () if find("delta3") => 63,
            () if find("falcon") => 60,
            () => 33,
        }
    }

    fn rows(&self) -> [[f64; 3]; 3] {
        let [_, _, _, x, y, z, w, _] = self.mock.pose;
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
        ]
    }

    /// What a get answers.
    fn get(&self) -> Result<c_int, c_int> {
        if self.mock.fault("com") {
            return Err(COM);
        }
        Ok(if self.mock.is_fresh && !self.mock.fault("time-guard") { OK } else { TIME_GUARD })
    }
}

fn put<T>(place: Option<&mut T>, value: T) {
    if let Some(place) = place {
        *place = value;
    }
}

/// Does something with the open arm; −1 and the last error where there is none, or where it fails.
fn with(act: impl FnOnce(&mut Arm) -> Result<c_int, c_int>) -> c_int {
    let mut state = state();
    let result = state.arm.as_mut().map_or(Err(NOT_AVAILABLE), act);
    match result {
        Ok(answer) => answer,
        Err(error) => {
            state.error = error;
            -1
        }
    }
}

fn open() -> c_int {
    let mut state = state();
    if state.arm.is_some() {
        return 0;
    }
    match Arm::open() {
        Ok(arm) => {
            state.arm = Some(arm);
            0
        }
        Err(error) => {
            state.error = error;
            -1
        }
    }
}

macro_rules! exported {
    ($(fn $name:ident($($arg:ident: $kind:ty),*) -> $result:ty $body:block)*) => {
        $(
            // SAFETY: no other library of a process has these names, but for the one that this one
            // takes the place of.
            #[unsafe(no_mangle)]
            pub extern "C" fn $name($($arg: $kind),*) -> $result $body
        )*
    };
}

exported! {
    fn dhdErrorGetLast() -> c_int { state().error }
    fn dhdErrorGetLastStr() -> *const c_char { dhdErrorGetStr(state().error) }
    fn dhdErrorGetStr(error: c_int) -> *const c_char {
        match error {
            0 => c"no error",
            COM => c"communication error",
            NO_DEVICE => c"no device found",
            NOT_AVAILABLE => c"not available",
            IN_USE => c"device in use",
            _ => c"error",
        }.as_ptr()
    }
    fn dhdGetSDKVersion(major: Option<&mut c_int>, minor: Option<&mut c_int>, release: Option<&mut c_int>, revision: Option<&mut c_int>) -> () {
        put(major, 3);
        put(minor, 17);
        put(release, 5);
        put(revision, 0);
    }
    fn dhdGetSDKVersionStr() -> *const c_char { c"3.17.5 (mock)".as_ptr() }
    fn dhdEnableSimulator(_on: bool) -> () {}
    fn dhdGetDeviceCount() -> c_int { c_int::from(std::env::var_os("HAPTICD_MOCK_ARM").is_some()) }
    fn dhdGetAvailableCount() -> c_int { dhdGetDeviceCount() }
    fn dhdGetDeviceID() -> c_int { with(|_| Ok(0)) }
    fn dhdSetDevice(_id: c_char) -> c_int { with(|_| Ok(OK)) }
    fn dhdOpen() -> c_int { open() }
    fn dhdOpenID(_id: c_char) -> c_int { open() }
    fn dhdOpenSerial(serial: c_int) -> c_int {
        if serial == SERIAL.into() { return open() }
        state().error = NO_DEVICE;
        -1
    }
    fn dhdOpenType(_kind: c_int) -> c_int { open() }
    fn dhdClose(_id: c_char) -> c_int {
        state().arm = None;
        OK
    }
    fn dhdStop(_id: c_char) -> c_int {
        with(|arm| {
            (arm.force, arm.force_on) = ([0.0; 7], false);
            arm.exchange()
        })
    }
    fn dhdGetSystemType(_id: c_char) -> c_int { with(|arm| Ok(arm.kind())) }
    fn dhdGetSystemName(id: c_char) -> *const c_char {
        match dhdGetSystemType(id) {
            34 | 36 => c"omega.6 (mock)",
            35 | 37 => c"omega.7 (mock)",
            63 => c"delta.3 (mock)",
            104 | 105 => c"sigma.7 (mock)",
            108 | 109 => c"lambda.7 (mock)",
            60 => c"Falcon (mock)",
            _ => c"omega.3 (mock)",
        }.as_ptr()
    }
    fn dhdGetSerialNumber(serial: Option<&mut c_ushort>, _id: c_char) -> c_int {
        put(serial, SERIAL);
        with(|_| Ok(OK))
    }
    fn dhdGetVersion(version: Option<&mut c_double>, _id: c_char) -> c_int {
        put(version, 3.0);
        with(|_| Ok(OK))
    }
    fn dhdIsLeftHanded(_id: c_char) -> bool { has_fault("left-handed") }
    fn dhdHasBase(_id: c_char) -> bool { true }
    fn dhdHasWrist(_id: c_char) -> bool { !has_fault("no-wrist") && with(|arm| Ok((arm.mock.sensed >> 3 & 7).into())) == 7 }
    fn dhdHasActiveWrist(id: c_char) -> bool { matches!(dhdGetSystemType(id), 104 | 105 | 108 | 109) }
    fn dhdHasGripper(_id: c_char) -> bool { with(|arm| Ok((arm.mock.sensed >> 6 & 1).into())) == 1 }
    fn dhdHasActiveGripper(id: c_char) -> bool { dhdHasGripper(id) }
    fn dhdGetStatus(status: Option<&mut [c_int; 17]>, _id: c_char) -> c_int {
        with(|arm| {
            let cause = arm.off_cause();
            let mut found = [0; 17];
            // Power, connected, started; force, brake; wrist, gravity, cause.
            (found[0], found[1], found[2]) = (1, 1, 1);
            found[5] = (arm.force_on && cause == CAUSE_NONE).into();
            found[6] = arm.brakes.into();
            found[10] = arm.gravity.into();
            found[14] = if arm.force_on { cause } else { 4 };
            put(status, found);
            Ok(OK)
        })
    }
    fn dhdGetButtonMask(_id: c_char) -> c_uint { with(|arm| Ok(arm.mock.buttons.into())).max(0) as c_uint }
    fn dhdGetButton(index: c_int, _id: c_char) -> c_int { with(|arm| Ok((arm.mock.buttons >> (index & 15) & 1).into())) }
    fn dhdEmulateButton(_on: c_uchar, _id: c_char) -> c_int { with(|_| Ok(OK)) }
    fn dhdEnableForce(on: c_uchar, _id: c_char) -> c_int {
        with(|arm| {
            arm.force_on = on != 0;
            if arm.force_on {
                arm.mock.force_comes();
            }
            arm.force = [0.0; 7];
            // Without enable first: what its watchdog switched off comes back on no other way.
            if arm.force_on { Ok(OK) } else { arm.exchange().map(|_| OK) }
        })
    }
    fn dhdEnableGripperForce(_on: c_uchar, _id: c_char) -> c_int { with(|_| Ok(OK)) }
    fn dhdSetBrakes(on: c_int, _id: c_char) -> c_int {
        with(|arm| {
            arm.brakes = on != 0;
            Ok(OK)
        })
    }
    fn dhdSetGravityCompensation(on: c_int, _id: c_char) -> c_int {
        with(|arm| {
            arm.gravity = on != 0;
            Ok(OK)
        })
    }
    fn dhdGetPosition(x: Option<&mut c_double>, y: Option<&mut c_double>, z: Option<&mut c_double>, _id: c_char) -> c_int {
        with(|arm| {
            put(x, arm.mock.pose[0]);
            put(y, arm.mock.pose[1]);
            put(z, arm.mock.pose[2]);
            arm.get()
        })
    }
    fn dhdGetOrientationFrame(rows: Option<&mut [[c_double; 3]; 3]>, _id: c_char) -> c_int {
        with(|arm| {
            put(rows, arm.rows());
            arm.get()
        })
    }
    fn dhdGetPositionAndOrientationFrame(x: Option<&mut c_double>, y: Option<&mut c_double>, z: Option<&mut c_double>, rows: Option<&mut [[c_double; 3]; 3]>, id: c_char) -> c_int {
        dhdGetOrientationFrame(rows, id);
        dhdGetPosition(x, y, z, id)
    }
    fn dhdConfigLinearVelocity(_ms: c_int, _mode: c_int, _id: c_char) -> c_int { with(|_| Ok(OK)) }
    fn dhdGetLinearVelocity(x: Option<&mut c_double>, y: Option<&mut c_double>, z: Option<&mut c_double>, _id: c_char) -> c_int {
        with(|arm| {
            put(x, arm.mock.twist[0]);
            put(y, arm.mock.twist[1]);
            put(z, arm.mock.twist[2]);
            arm.get()
        })
    }
    fn dhdGetAngularVelocityRad(x: Option<&mut c_double>, y: Option<&mut c_double>, z: Option<&mut c_double>, _id: c_char) -> c_int {
        with(|arm| {
            put(x, arm.mock.twist[3]);
            put(y, arm.mock.twist[4]);
            put(z, arm.mock.twist[5]);
            arm.get()
        })
    }
    fn dhdGetGripperAngleRad(angle: Option<&mut c_double>, _id: c_char) -> c_int {
        with(|arm| {
            let opened = arm.mock.pose[7] + if has_fault("gripper") { 0.3 } else { 0.0 };
            put(angle, if has_fault("left-handed") { -opened } else { opened });
            arm.get()
        })
    }
    fn dhdGetGripperAngularVelocityRad(rate: Option<&mut c_double>, _id: c_char) -> c_int {
        put(rate, 0.0);
        with(|arm| arm.get())
    }
    fn dhdSetForceAndTorqueAndGripperForce(fx: c_double, fy: c_double, fz: c_double, tx: c_double, ty: c_double, tz: c_double, grip: c_double, _id: c_char) -> c_int {
        with(|arm| {
            arm.force = [fx, fy, fz, tx, ty, tz, grip];
            arm.exchange()
        })
    }
    fn dhdSetForceAndGripperForce(fx: c_double, fy: c_double, fz: c_double, grip: c_double, id: c_char) -> c_int {
        dhdSetForceAndTorqueAndGripperForce(fx, fy, fz, 0.0, 0.0, 0.0, grip, id)
    }
    fn dhdSetForce(fx: c_double, fy: c_double, fz: c_double, id: c_char) -> c_int {
        dhdSetForceAndTorqueAndGripperForce(fx, fy, fz, 0.0, 0.0, 0.0, 0.0, id)
    }
    fn dhdSetMaxForce(newtons: c_double, _id: c_char) -> c_int {
        with(|arm| {
            arm.max_n = newtons;
            Ok(OK)
        })
    }
    fn dhdSetMaxTorque(newton_metres: c_double, _id: c_char) -> c_int {
        with(|arm| {
            arm.max_nm = newton_metres;
            Ok(OK)
        })
    }
    fn dhdGetMaxForce(_id: c_char) -> c_double { state().arm.as_ref().map_or(-1.0, |arm| arm.max_n) }
    fn dhdGetMaxTorque(_id: c_char) -> c_double { state().arm.as_ref().map_or(-1.0, |arm| arm.max_nm) }
    fn dhdGetComMode(_id: c_char) -> c_int { with(|_| Ok(1)) }
    fn dhdGetComFreq(_id: c_char) -> c_double { 1.0 }
    fn dhdGetWatchdog(eighths_ms: Option<&mut c_uchar>, _id: c_char) -> c_int {
        with(|arm| {
            put(eighths_ms, u8::try_from(8 * arm.mock.watchdog_ms).unwrap_or(u8::MAX));
            Ok(OK)
        })
    }
    fn dhdGetVelocityThreshold(threshold: Option<&mut c_uint>, _id: c_char) -> c_int {
        put(threshold, 40);
        with(|_| Ok(OK))
    }
    fn drdOpen() -> c_int { open() }
    fn drdOpenID(_id: c_char) -> c_int { open() }
    fn drdIsSupported(_id: c_char) -> bool { true }
    fn drdIsInitialized(_id: c_char) -> bool { with(|arm| Ok(arm.initialised.into())) == 1 }
    fn drdAutoInit(_id: c_char) -> c_int {
        STOPPED.store(false, Ordering::Relaxed);
        let begin = Instant::now();
        while has_fault("slow-init") && begin.elapsed() < INIT_TIME && !STOPPED.load(Ordering::Relaxed) {
            // No lock meanwhile: the stop comes from another thread.
            let pushed = with(|arm| if arm.mock.exchange(&[0.0, 0.0, INIT_N, 0.0, 0.0, 0.0, 0.0], true) { Ok(OK) } else { Err(COM) });
            if pushed < 0 { return pushed }
            std::thread::sleep(Duration::from_millis(2));
        }
        with(|arm| {
            arm.initialised = !STOPPED.load(Ordering::Relaxed);
            if arm.mock.exchange(&[0.0; 7], false) { Ok(OK) } else { Err(COM) }
        })
    }
    fn drdStop(_force_mode: bool, _id: c_char) -> c_int {
        STOPPED.store(true, Ordering::Relaxed);
        with(|_| Ok(OK))
    }
    fn drdClose(id: c_char) -> c_int { dhdClose(id) }
}
