//! Stand-ins for tests of the loop: an arm that counts, a clock that follows a script, a scene without objects.
#![expect(clippy::disallowed_types, reason = "test code outside the loop")]

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use glam::{DMat3, DVec3};

use crate::device::{Capabilities, Device, DeviceError};
use crate::haptics::{CouplingParameters, FilterParameters, Inertia, LimitParameters, Parameters, RenderScene, Tool};
use crate::pointshell::shell::Shell;
use crate::rt::clock::{Clock, ClockKind};
use crate::spatial::{DeviceSample, SampleStatus, Wrench};

/// Parameters of a 1 kHz scene with nothing in it.
pub(crate) fn parameters() -> Parameters {
    Parameters {
        coupling: CouplingParameters { stiffness_nm_per_rad: 0.3, ..CouplingParameters::PLAIN },
        filter: FilterParameters { spatial: true, cutoff_hz: [f64::INFINITY, f64::INFINITY] },
        limits: LimitParameters {
            force_n: 10.0,
            torque_nm: 0.2,
            speed_m_per_s: 1.0,
            slew_n_per_s: 1000.0,
            slew_nm_per_s: 20.0,
            power_w: 5.0,
            stall_s: 0.05,
            ..LimitParameters::NONE
        },
        ..Parameters::unlimited(1e-3)
    }
}

/// A scene without objects. The one place to extend when `RenderScene` grows.
pub(crate) fn empty_scene() -> Arc<RenderScene> {
    let inertia = Inertia { mass_kg: 0.1, body_kg_m2: DMat3::IDENTITY * 1e-5, least_kg_m2: 1e-5 };
    let tool = Tool { shell: Shell::new(&[], 1e-3), inertia, center_of_mass_tool: DVec3::ZERO };
    Arc::new(RenderScene { parameters: parameters(), obstacles: Vec::new(), clay: None, tool })
}

/// What happened to a [`CountingArm`]; outlives it.
#[derive(Debug, Default)]
pub(crate) struct ArmLog {
    pub(crate) reads: AtomicU64,
    pub(crate) writes: AtomicU64,
    pub(crate) stops: AtomicU64,
    /// The newest force x, as bits; what the motors would hold.
    held_bits: AtomicU64,
}

impl ArmLog {
    pub(crate) fn held_force_x(&self) -> f64 {
        f64::from_bits(self.held_bits.load(Ordering::SeqCst))
    }
}

/// An arm that counts calls and fails on demand.
#[derive(Debug, Default)]
pub(crate) struct CountingArm {
    pub(crate) log: Arc<ArmLog>,
    pub(crate) capabilities: Capabilities,
    pub(crate) lost_from_read: Option<u64>,
    /// Back again from this read on.
    pub(crate) back_from_read: Option<u64>,
    pub(crate) refuse_write_from: Option<u64>,
}

impl Device for CountingArm {
    fn capabilities(&self) -> Capabilities {
        self.capabilities
    }

    fn read(&mut self) -> Result<DeviceSample, DeviceError> {
        let n_reads = self.log.reads.fetch_add(1, Ordering::SeqCst);
        let back = self.back_from_read.is_some_and(|first| n_reads >= first);
        if !back && self.lost_from_read.is_some_and(|first| n_reads >= first) {
            return Err(DeviceError::Lost);
        }
        Ok(DeviceSample { sequence: n_reads + 1, status: SampleStatus::Fresh, ..DeviceSample::default() })
    }

    fn write(&mut self, wrench_device: &Wrench) -> Result<Wrench, DeviceError> {
        let n_writes = self.log.writes.fetch_add(1, Ordering::SeqCst);
        if self.refuse_write_from.is_some_and(|first| n_writes >= first) {
            return Err(DeviceError::Os(5));
        }
        self.log.held_bits.store(wrench_device.force.x.to_bits(), Ordering::SeqCst);
        Ok(*wrench_device)
    }

    fn stop(&mut self) {
        self.log.stops.fetch_add(1, Ordering::SeqCst);
        self.log.held_bits.store(0, Ordering::SeqCst);
    }
}

/// A clock that wakes late by script and whose time a test may move.
#[derive(Debug, Default)]
pub(crate) struct ScriptedClock {
    pub(crate) now_ns: i64,
    late_ns: Vec<i64>,
}

impl ScriptedClock {
    /// The n-th sleep ends this much late; later ones in time.
    pub(crate) fn late_by(late_ns: &[i64]) -> Self {
        Self { now_ns: 0, late_ns: late_ns.iter().rev().copied().collect() }
    }
}

impl Clock for ScriptedClock {
    fn kind(&self) -> ClockKind {
        ClockKind::Real
    }

    fn now_ns(&mut self) -> i64 {
        self.now_ns
    }

    fn sleep_until(&mut self, deadline_ns: i64) {
        self.now_ns = self.now_ns.max(deadline_ns) + self.late_ns.pop().unwrap_or(0);
    }
}
