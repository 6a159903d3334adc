//! `dlopen`, and every signature of every library: the one file of the arms' maker code with
//! `unsafe`.
//!
//! Signatures are facts of published headers, typed anew. A pointer that a function only writes to
//! during its call is a reference here, which has the same form; functions thus become safe to call
//! as far as the library does what its header says. What it does not is the reason for the worker.
#![expect(
    unsafe_code,
    reason = "functions of a foreign library are found by name and called by the signature that \
        its header gives"
)]

use core::ffi::{
    CStr, c_char, c_double, c_float, c_int, c_uchar, c_uint, c_ulong, c_ushort, c_void,
};
use core::ptr::NonNull;
use std::ffi::CString;
use std::os::unix::ffi::OsStrExt as _;
use std::path::{Path, PathBuf};

use super::{Family, VendorFault, elf};

/// An opened library. It stays loaded until the process ends: threads of its own may run in it.
#[derive(Debug)]
pub(super) struct Library {
    handle: NonNull<c_void>,
    pub(super) path: PathBuf,
}

// SAFETY: the handle is given to `dlsym` alone, which any thread may call.
unsafe impl Send for Library {}
// SAFETY: as above.
unsafe impl Sync for Library {}

/// What `dlerror` says.
fn last_error() -> String {
    // SAFETY: takes nothing; what it returns is a C string that lives until the next call of this
    // thread.
    let text = unsafe { libc::dlerror() };
    text_of(text).unwrap_or_else(|| "no reason given".to_owned())
}

/// A C string of a library; `None` for a null pointer.
pub(super) fn text_of(text: *const c_char) -> Option<String> {
    // SAFETY: not null, and by the headers of the libraries a C string that outlives the call.
    (!text.is_null()).then(|| unsafe { CStr::from_ptr(text) }.to_string_lossy().into_owned())
}

impl Library {
    /// Opens the first library that is there. `global`: its names are seen by libraries that are
    /// opened later.
    ///
    /// # Errors
    /// It is nowhere, or why what was there could not be opened.
    pub(super) fn open(
        family: Family,
        written: Option<&Path>,
        global: bool,
    ) -> Result<Self, VendorFault> {
        let places = family.places_here(written);
        let mut causes = Vec::new();
        for path in places.iter().filter(|path| path.exists()) {
            let Ok(name) = CString::new(path.as_os_str().as_bytes()) else { continue };
            if let Some(why) = elf::unsuitable_file(path) {
                causes.push(format!("{} {why}", path.display()));
                continue;
            }
            let flags = libc::RTLD_NOW | if global { libc::RTLD_GLOBAL } else { libc::RTLD_LOCAL };
            // SAFETY: a C string; the constructors of the library run, which is what loading it
            // means.
            match NonNull::new(unsafe { libc::dlopen(name.as_ptr(), flags) }) {
                Some(handle) => return Ok(Self { handle, path: path.clone() }),
                None => {
                    let why = last_error();
                    let advice = family
                        .load_advice(&why)
                        .map_or(String::new(), |advice| format!("; {advice}"));
                    causes.push(format!("{} cannot be loaded: {why}{advice}", path.display()));
                }
            }
        }
        Err(VendorFault(if causes.is_empty() {
            family.missing_text(&places)
        } else {
            causes.join("; ")
        }))
    }

    fn symbol(&self, name: &CStr) -> Option<NonNull<c_void>> {
        // SAFETY: an open library and a C string.
        NonNull::new(unsafe { libc::dlsym(self.handle.as_ptr(), name.as_ptr()) })
    }
}

/// A table of functions: each line is a signature, and becomes a field that `load` fills and a
/// method that calls it. One behind `optional` may be missing in older libraries, and answers
/// `None` then.
macro_rules! functions {
    (
        $(#[$doc:meta])* $table:ident;
        $(fn $name:ident($($arg:ident: $kind:ty),*) $(-> $result:ty)?;)*
        optional $(fn $may:ident($($may_arg:ident: $may_kind:ty),*) -> $may_result:ty;)*
    ) => {
        $(#[$doc])*
        #[expect(non_snake_case, reason = "names of a foreign library")]
        pub(super) struct $table {
            pub(super) library: Library,
            $($name: unsafe extern "C" fn($($kind),*) $(-> $result)?,)*
            $($may: Option<unsafe extern "C" fn($($may_kind),*) -> $may_result>,)*
        }

        #[expect(non_snake_case, reason = "names of a foreign library")]
        #[allow(clippy::too_many_arguments, reason = "signatures of a foreign library, of which \
            some tables have long ones")]
        impl $table {
            /// Finds every function.
            ///
            /// # Errors
            /// Those that are missing.
            pub(super) fn load(library: Library) -> Result<Self, VendorFault> {
                let mut missing: Vec<&str> = Vec::new();
                $(
                    let name = concat!(stringify!($name), "\0");
                    let $name = CStr::from_bytes_with_nul(name.as_bytes()).ok().and_then(|name| library.symbol(name));
                    if $name.is_none() {
                        missing.push(stringify!($name));
                    }
                )*
                $(
                    let name = concat!(stringify!($may), "\0");
                    let $may = CStr::from_bytes_with_nul(name.as_bytes()).ok().and_then(|name| library.symbol(name));
                )*
                match ($($name,)*) {
                    ($(Some($name),)*) => Ok(Self {
                        // SAFETY: the function of this name in this library has this signature, by
                        // the header of its maker.
                        $($name: unsafe { core::mem::transmute::<NonNull<c_void>, unsafe extern "C" fn($($kind),*) $(-> $result)?>($name) },)*
                        // SAFETY: as above.
                        $($may: $may.map(|found| unsafe { core::mem::transmute::<NonNull<c_void>, unsafe extern "C" fn($($may_kind),*) -> $may_result>(found) }),)*
                        library,
                    }),
                    _ => Err(VendorFault(format!("{} has no {}: it is too old, or another library", library.path.display(), missing.join(", ")))),
                }
            }

            $(pub(super) fn $name(&self, $($arg: $kind),*) $(-> $result)? {
                // SAFETY: the signature is that of the header, and what is passed lives for as long
                // as the call.
                unsafe { (self.$name)($($arg),*) }
            })*

            $(pub(super) fn $may(&self, $($may_arg: $may_kind),*) -> Option<$may_result> {
                // SAFETY: as above.
                self.$may.map(|call| unsafe { call($($may_arg),*) })
            })*
        }
    };
}

functions! {
    /// Force Dimension, DHD 3 (`dhdc.h`, 3.17.5). `id`: the arm. A C++ `bool` is one byte.
    Dhd;
    fn dhdErrorGetLast() -> c_int;
    fn dhdErrorGetLastStr() -> *const c_char;
    fn dhdOpen() -> c_int;
    fn dhdClose(id: c_char) -> c_int;
    fn dhdStop(id: c_char) -> c_int;
    fn dhdGetSystemType(id: c_char) -> c_int;
    fn dhdGetSystemName(id: c_char) -> *const c_char;
    fn dhdGetSerialNumber(serial: &mut c_ushort, id: c_char) -> c_int;
    fn dhdIsLeftHanded(id: c_char) -> u8;
    fn dhdHasWrist(id: c_char) -> u8;
    fn dhdHasGripper(id: c_char) -> u8;
    fn dhdGetStatus(status: &mut [c_int; 17], id: c_char) -> c_int;
    fn dhdGetButtonMask(id: c_char) -> c_uint;
    fn dhdEnableForce(on: c_uchar, id: c_char) -> c_int;
    fn dhdSetBrakes(on: c_int, id: c_char) -> c_int;
    fn dhdSetGravityCompensation(on: c_int, id: c_char) -> c_int;
    fn dhdGetPositionAndOrientationFrame(x: &mut c_double, y: &mut c_double, z: &mut c_double, rows: &mut [[c_double; 3]; 3], id: c_char) -> c_int;
    fn dhdGetLinearVelocity(x: &mut c_double, y: &mut c_double, z: &mut c_double, id: c_char) -> c_int;
    fn dhdSetForceAndTorqueAndGripperForce(fx: c_double, fy: c_double, fz: c_double, tx: c_double, ty: c_double, tz: c_double, grip: c_double, id: c_char) -> c_int;
    fn dhdSetMaxForce(newtons: c_double, id: c_char) -> c_int;
    fn dhdSetMaxTorque(newton_metres: c_double, id: c_char) -> c_int;
    optional
    fn dhdOpenSerial(serial: c_int) -> c_int;
    fn dhdGetSDKVersionStr() -> *const c_char;
    fn dhdGetAngularVelocityRad(x: &mut c_double, y: &mut c_double, z: &mut c_double, id: c_char) -> c_int;
    fn dhdGetGripperAngleRad(angle: &mut c_double, id: c_char) -> c_int;
    fn dhdGetGripperAngularVelocityRad(rate: &mut c_double, id: c_char) -> c_int;
    fn dhdGetWatchdog(eighths_ms: &mut c_uchar, id: c_char) -> c_int;
    fn drdOpenID(id: c_char) -> c_int;
    fn drdIsInitialized(id: c_char) -> u8;
    fn drdAutoInit(id: c_char) -> c_int;
    fn drdStop(force_mode: u8, id: c_char) -> c_int;
}

/// What `hdGetError` gives, by value.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub(super) struct HdError {
    pub(super) code: c_uint,
    pub(super) internal: c_int,
    pub(super) device: c_uint,
}

/// A callback of the scheduler: 0 ends it, 1 goes on.
pub(super) type HdCallback = extern "C" fn(*mut c_void) -> c_uint;

functions! {
    /// 3D Systems, OpenHaptics 3 (`HD/hdDevice.h`, `HD/hdScheduler.h`, 3.0.66). Arrays have room
    /// for the longest answer, 16 numbers.
    Hd;
    fn hdInitDevice(name: *const c_char) -> c_uint;
    fn hdMakeCurrentDevice(device: c_uint);
    fn hdDisableDevice(device: c_uint);
    fn hdBeginFrame(device: c_uint);
    fn hdEndFrame(device: c_uint);
    fn hdGetError() -> HdError;
    fn hdGetErrorString(code: c_uint) -> *const c_char;
    fn hdGetString(name: c_uint) -> *const c_char;
    fn hdEnable(capability: c_uint);
    fn hdGetIntegerv(name: c_uint, values: &mut [c_int; 16]);
    fn hdGetDoublev(name: c_uint, values: &mut [c_double; 16]);
    fn hdSetDoublev(name: c_uint, values: &[c_double; 16]);
    fn hdCheckCalibration() -> c_uint;
    fn hdUpdateCalibration(style: c_uint);
    fn hdStartScheduler();
    fn hdStopScheduler();
    fn hdScheduleSynchronous(callback: HdCallback, data: *mut c_void, priority: c_ushort);
    fn hdScheduleAsynchronous(callback: HdCallback, data: *mut c_void, priority: c_ushort) -> c_ulong;
    fn hdUnschedule(handle: c_ulong);
    optional
    fn hdSetSchedulerRate(hz: c_ulong) -> ();
}

/// An open arm of Haption: a pointer that only its library looks behind.
#[derive(Clone, Copy, Debug)]
#[repr(transparent)]
pub(super) struct Context(pub(super) NonNull<c_void>);

functions! {
    /// Haption, VirtuoseAPI 4 (`VirtuoseAPI.h`, 4.03). A pose is x, y, z in m and the quaternion x,
    /// y, z, w.
    Virtuose;
    fn virtOpen(host: *const c_char) -> *mut c_void;
    fn virtClose(arm: Context) -> c_int;
    fn virtGetErrorCode(arm: Option<Context>) -> c_int;
    fn virtGetErrorMessage(code: c_int) -> *const c_char;
    fn virtGetDeviceID(arm: Context, kind: &mut c_int, serial: &mut c_int) -> c_int;
    fn virtSetIndexingMode(arm: Context, mode: c_int) -> c_int;
    fn virtSetForceFactor(arm: Context, factor: c_float) -> c_int;
    fn virtSetSpeedFactor(arm: Context, factor: c_float) -> c_int;
    fn virtSetTimeStep(arm: Context, seconds: c_float) -> c_int;
    fn virtSetBaseFrame(arm: Context, pose: &mut [c_float; 7]) -> c_int;
    fn virtSetObservationFrame(arm: Context, pose: &mut [c_float; 7]) -> c_int;
    fn virtSetObservationFrameSpeed(arm: Context, twist: &mut [c_float; 6]) -> c_int;
    fn virtSetCommandType(arm: Context, kind: c_int) -> c_int;
    fn virtSetPowerOn(arm: Context, on: c_int) -> c_int;
    fn virtGetPowerOn(arm: Context, on: &mut c_int) -> c_int;
    fn virtGetPosition(arm: Context, pose: &mut [c_float; 7]) -> c_int;
    fn virtGetPhysicalSpeed(arm: Context, twist: &mut [c_float; 6]) -> c_int;
    fn virtSetForce(arm: Context, wrench: &mut [c_float; 6]) -> c_int;
    fn virtGetButton(arm: Context, number: c_int, pressed: &mut c_int) -> c_int;
    fn virtGetDeadMan(arm: Context, held: &mut c_int) -> c_int;
    fn virtGetEmergencyStop(arm: Context, pressed: &mut c_int) -> c_int;
    fn virtGetAlarm(arm: Context, alarms: &mut c_uint) -> c_int;
    fn virtGetFailure(arm: Context, failures: &mut c_uint) -> c_int;
    optional
    fn virtSetTimeoutValue(arm: Context, seconds: c_float) -> c_int;
    fn virtSaturateTorque(arm: Context, newtons: c_float, newton_metres: c_float) -> c_int;
}
