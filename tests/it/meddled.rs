//! An arm whose samples a test changes on their way; shared with the test of allocations.

use arms::{Capabilities, Device, DeviceError};
use vps::spatial::{DeviceSample, Wrench};

/// The simulated arm, and what a test does to its samples (tick, sample).
pub(crate) struct Meddled<F> {
    pub(crate) arm: Box<dyn Device>,
    pub(crate) n_reads: u64,
    pub(crate) meddle: F,
}

impl<F: Fn(u64, &mut DeviceSample) + Send> Device for Meddled<F> {
    fn capabilities(&self) -> Capabilities {
        self.arm.capabilities()
    }

    fn read(&mut self) -> Result<DeviceSample, DeviceError> {
        let mut sample = self.arm.read()?;
        (self.meddle)(self.n_reads, &mut sample);
        self.n_reads += 1;
        Ok(sample)
    }

    fn write(&mut self, wrench_device: &Wrench) -> Result<Wrench, DeviceError> {
        self.arm.write(wrench_device)
    }

    fn set_enabled(&mut self, enabled: bool) {
        self.arm.set_enabled(enabled);
    }

    fn stop(&mut self) {
        self.arm.stop();
    }
}
