//! Zero force on every way out.

use core::ops::{Deref, DerefMut};

use arms::Device;

/// Owns the arm and writes a zero command when it goes: at the end of the loop, on an early return,
/// while a panic unwinds.
///
/// Needs `panic = "unwind"`: under `abort` no guard runs.
#[derive(Debug)]
pub struct StopGuard<D: Device>(D);

impl<D: Device> StopGuard<D> {
    /// Takes the arm.
    pub const fn new(device: D) -> Self {
        Self(device)
    }
}

impl<D: Device> Deref for StopGuard<D> {
    type Target = D;
    fn deref(&self) -> &D {
        &self.0
    }
}

impl<D: Device> DerefMut for StopGuard<D> {
    fn deref_mut(&mut self) -> &mut D {
        &mut self.0
    }
}

impl<D: Device> Drop for StopGuard<D> {
    fn drop(&mut self) {
        self.0.stop();
    }
}
