//! Arms for tests: every shipped profile over a link in memory against its mock, and a clock that
//! steps with it.
//!
//! What every arm has to do is in `tests/conformance/`; `examples/` has stand-ins for libraries of
//! makers.

pub mod rig;

use std::sync::{Arc, Mutex, MutexGuard};

use arms::{Capabilities, Device, DeviceError};
use glam::DVec3;
use rt::clock::{Clock, ClockKind};
use vps::spatial::{DeviceSample, Wrench};

use self::rig::Rig;

/// Where a hand holds the grip.
pub const HELD_M: DVec3 = DVec3::new(0.008, -0.012, 0.006);

/// An arm and its time, which goes on whatever the host does meanwhile.
#[derive(Clone)]
pub struct TimedRig(Arc<Mutex<Box<dyn Rig>>>, i64);

impl TimedRig {
    /// At time 0.
    pub fn of(rig: Box<dyn Rig>) -> Self {
        Self(Arc::new(Mutex::new(rig)), 0)
    }

    /// The arm, for a look at it.
    ///
    /// # Panics
    /// Where another thread panicked while it had the arm.
    pub fn rig(&self) -> MutexGuard<'_, Box<dyn Rig>> {
        self.0.lock().expect("no panic")
    }
}

impl Device for TimedRig {
    fn capabilities(&self) -> Capabilities {
        self.rig().device().capabilities()
    }

    fn read(&mut self) -> Result<DeviceSample, DeviceError> {
        self.rig().device().read()
    }

    fn write(&mut self, wrench_device: &Wrench) -> Result<Wrench, DeviceError> {
        self.rig().device().write(wrench_device)
    }

    fn set_enabled(&mut self, enabled: bool) {
        self.rig().device().set_enabled(enabled);
    }

    fn doubt_signs(&mut self, doubted: bool) {
        self.rig().device().doubt_signs(doubted);
    }

    fn stop(&mut self) {
        self.rig().device().stop();
    }
}

impl Clock for TimedRig {
    fn kind(&self) -> ClockKind {
        ClockKind::Virtual
    }

    fn now_ns(&mut self) -> i64 {
        self.1
    }

    fn sleep_until(&mut self, deadline_ns: i64) {
        let mut rig = self.0.lock().expect("no panic");
        let period_ns = 1_000_000_000 / i64::from(rig.profile().link.rate_hz);
        while self.1 < deadline_ns {
            rig.advance();
            self.1 += period_ns;
        }
    }
}
