//! A `libVirtuoseAPI` without an arm: the functions of Haption's library in impedance mode, over a
//! mock arm of `hapticd mock`.
//!
//! ```sh
//! cargo build -p arms-testing --example mock_virtuose
//! hapticd mock virtuose-6d --pty /tmp/arm &
//! HAPTICD_MOCK_ARM=/tmp/arm LD_PRELOAD=target/debug/examples/libmock_virtuose.so ./my-program
//! ```
//! `HAPTICD_MOCK_FAULT` names what goes wrong, in a list with commas, each with `@` and the seconds
//! after the first power if not at once: `no-device` (the open fails), `emergency-stop`, `dead-man`
//! (open), `overheat`, `overrun`, `position`, `failure`, `power` (off), `com` (every call fails),
//! `garbage` (numbers without sense), `crash`, `exit`, `hang`. `HAPTICD_MOCK_FAULT_FILE` names a
//! file with such a list, which counts from when it is written until it is emptied. An arm that
//! answers three commands in a row with nothing is a communication error: assumed.
//!
//! As of the real library, a force is refused with error 17 before everything has been set that it
//! rests on.
//!
//! Signatures and numbers are facts of the published header, typed anew; no code of the maker is in
//! here. Functions that are not here were not needed yet.
#![expect(unsafe_code, reason = "symbols without mangling, and the crash that was asked for")]
#![allow(
    missing_docs,
    clippy::missing_docs_in_private_items,
    reason = "the maker's documentation says what they do"
)]

mod mock_link;

use core::ffi::{c_char, c_float, c_int, c_uint, c_void};
use std::sync::{Mutex, MutexGuard, PoisonError};

use self::mock_link::{Mock, has_fault};

const COMMUNICATION: c_int = 2;
const CONTEXT: c_int = 3;
const WRONG_MODE: c_int = 17;
/// Indexing, force factor, speed factor, time step, base frame, observation frame, its speed,
/// command type.
const ALL_SET: u8 = 0xFF;

struct Arm {
    mock: Mock,
    force: [f64; 7],
    is_powered: bool,
    set: u8,
}

struct State {
    arm: Option<Arm>,
    error: c_int,
}

static STATE: Mutex<State> = Mutex::new(State { arm: None, error: 0 });
/// What a context points to: nothing is behind it.
static CONTEXT_OF_ARM: u8 = 0;

fn state() -> MutexGuard<'static, State> {
    STATE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Does something with the open arm: 0, or −1 and an error code.
fn with(act: impl FnOnce(&mut Arm) -> Result<(), c_int>) -> c_int {
    let mut state = state();
    let result = match state.arm.as_mut() {
        Some(arm) if arm.mock.fault("com") => Err(COMMUNICATION),
        Some(arm) => act(arm),
        None => Err(CONTEXT),
    };
    state.error = result.err().unwrap_or(0);
    if result.is_ok() { 0 } else { -1 }
}

fn set(bit: u8) -> c_int {
    with(|arm| {
        arm.set |= 1 << bit;
        Ok(())
    })
}

fn put<T>(place: Option<&mut T>, value: T) {
    if let Some(place) = place {
        *place = value;
    }
}

impl Arm {
    fn exchange(&mut self) -> Result<(), c_int> {
        let holds = ["emergency-stop", "dead-man", "power", "failure"]
            .iter()
            .any(|fault| self.mock.fault(fault));
        let is_on = self.is_powered && !holds && !self.mock.has_tripped();
        if self.mock.exchange(&self.force, is_on) && !self.mock.is_silent {
            Ok(())
        } else {
            Err(COMMUNICATION)
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
    fn virtOpen(_host: *const c_char) -> *mut c_void {
        let mut state = state();
        let mock = if has_fault("no-device") { None } else { Mock::open() };
        let Some(mock) = mock else {
            state.error = COMMUNICATION;
            return core::ptr::null_mut();
        };
        state.arm = Some(Arm { mock, force: [0.0; 7], is_powered: false, set: 0 });
        (&raw const CONTEXT_OF_ARM).cast_mut().cast()
    }
    fn virtClose(_context: *mut c_void) -> c_int {
        state().arm = None;
        0
    }
    fn virtGetErrorCode(_context: *mut c_void) -> c_int { state().error }
    fn virtGetErrorMessage(error: c_int) -> *const c_char {
        match error {
            0 => c"no error",
            COMMUNICATION => c"communication error",
            CONTEXT => c"no context",
            WRONG_MODE => c"wrong mode",
            _ => c"error",
        }.as_ptr()
    }
    fn virtAPIVersion(major: Option<&mut c_int>, minor: Option<&mut c_int>) -> c_int {
        put(major, 4);
        put(minor, 3);
        0
    }
    fn virtGetDeviceID(_context: *mut c_void, kind: Option<&mut c_int>, serial: Option<&mut c_int>) -> c_int {
        put(kind, 0);
        put(serial, 1);
        with(|_| Ok(()))
    }
    fn virtSetIndexingMode(_context: *mut c_void, _mode: c_int) -> c_int { set(0) }
    fn virtSetForceFactor(_context: *mut c_void, _factor: c_float) -> c_int { set(1) }
    fn virtSetSpeedFactor(_context: *mut c_void, _factor: c_float) -> c_int { set(2) }
    fn virtSetTimeStep(_context: *mut c_void, _step_s: c_float) -> c_int { set(3) }
    fn virtSetBaseFrame(_context: *mut c_void, _pose: Option<&[c_float; 7]>) -> c_int { set(4) }
    fn virtSetObservationFrame(_context: *mut c_void, _pose: Option<&[c_float; 7]>) -> c_int { set(5) }
    fn virtSetObservationFrameSpeed(_context: *mut c_void, _twist: Option<&[c_float; 6]>) -> c_int { set(6) }
    fn virtSetCommandType(_context: *mut c_void, kind: c_int) -> c_int {
        if kind == 3 { set(7) } else { with(|_| Err(WRONG_MODE)) }
    }
    fn virtSetTimeoutValue(_context: *mut c_void, _timeout_s: c_float) -> c_int { with(|_| Ok(())) }
    fn virtSaturateTorque(_context: *mut c_void, _newtons: c_float, _newton_metres: c_float) -> c_int { with(|_| Ok(())) }
    fn virtSetPowerOn(_context: *mut c_void, on: c_int) -> c_int {
        with(|arm| {
            (arm.is_powered, arm.force) = (on != 0, [0.0; 7]);
            if arm.is_powered {
                arm.mock.force_comes();
            }
            // Without enable first: what its watchdog switched off comes back on no other way.
            if arm.mock.exchange(&[0.0; 7], false) { Ok(()) } else { Err(COMMUNICATION) }
        })
    }
    fn virtGetPowerOn(_context: *mut c_void, on: Option<&mut c_int>) -> c_int {
        with(|arm| {
            put(on, (arm.is_powered && !arm.mock.fault("power")).into());
            Ok(())
        })
    }
    fn virtGetPosition(_context: *mut c_void, pose: Option<&mut [c_float; 7]>) -> c_int {
        with(|arm| {
            // Without a force nothing else brings a new state.
            if !arm.is_powered {
                arm.exchange()?;
            }
            put(pose, core::array::from_fn(|idx| arm.mock.pose[idx] as f32));
            Ok(())
        })
    }
    fn virtGetPhysicalPosition(context: *mut c_void, pose: Option<&mut [c_float; 7]>) -> c_int { virtGetPosition(context, pose) }
    fn virtGetPhysicalSpeed(_context: *mut c_void, twist: Option<&mut [c_float; 6]>) -> c_int {
        with(|arm| {
            put(twist, arm.mock.twist.map(|component| component as f32));
            Ok(())
        })
    }
    fn virtGetSpeed(context: *mut c_void, twist: Option<&mut [c_float; 6]>) -> c_int { virtGetPhysicalSpeed(context, twist) }
    fn virtSetForce(_context: *mut c_void, force: Option<&[c_float; 6]>) -> c_int {
        with(|arm| {
            let Some(force) = force.filter(|_| arm.set == ALL_SET) else { return Err(WRONG_MODE) };
            arm.force = core::array::from_fn(|idx| force.get(idx).map_or(0.0, |component| f64::from(*component)));
            arm.exchange()
        })
    }
    fn virtGetButton(_context: *mut c_void, index: c_int, pressed: Option<&mut c_int>) -> c_int {
        with(|arm| {
            put(pressed, (arm.mock.buttons >> ((index - 1) & 15) & 1).into());
            Ok(())
        })
    }
    fn virtGetDeadMan(_context: *mut c_void, held: Option<&mut c_int>) -> c_int {
        with(|arm| {
            put(held, (!arm.mock.fault("dead-man")).into());
            Ok(())
        })
    }
    fn virtGetEmergencyStop(_context: *mut c_void, pressed: Option<&mut c_int>) -> c_int {
        with(|arm| {
            put(pressed, arm.mock.fault("emergency-stop").into());
            Ok(())
        })
    }
    fn virtGetAlarm(_context: *mut c_void, alarms: Option<&mut c_uint>) -> c_int {
        with(|arm| {
            let bits = [("overheat", 0x4000), ("overrun", 0x2_0000), ("position", 0x4_0000)];
            put(alarms, bits.iter().filter(|(fault, _)| arm.mock.fault(fault)).map(|(_, bit)| *bit).sum());
            Ok(())
        })
    }
    fn virtGetFailure(_context: *mut c_void, failures: Option<&mut c_uint>) -> c_int {
        with(|arm| {
            put(failures, arm.mock.fault("failure").into());
            Ok(())
        })
    }
}
