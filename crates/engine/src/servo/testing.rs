//! Stand-ins for tests of the loop: an arm that counts, a clock that follows a script.
#![expect(clippy::disallowed_types, reason = "test code outside the loop")]

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use glam::{DMat3, DVec3};

use arms::{Capabilities, Device, DeviceError};
use haptics::testing::parameters;
use haptics::{Inertia, RenderScene, Tool};
use rt::clock::{Clock, ClockKind};
use vps::contact::Obstacle;
use vps::part::Part;
use vps::pointshell::shell::Shell;
use vps::spatial::{DeviceSample, Pose, SampleStatus, Wrench};
use vps::{Options, Shape};

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
        Ok(DeviceSample {
            sequence: n_reads + 1,
            status: SampleStatus::Fresh,
            ..DeviceSample::default()
        })
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
    /// How long the machine is suspended during each sleep, the last one first.
    suspends_ns: Vec<i64>,
    suspended_ns: i64,
}

impl ScriptedClock {
    /// The n-th sleep ends this much late; later ones in time.
    pub(crate) fn late_by(late_ns: &[i64]) -> Self {
        Self { late_ns: late_ns.iter().rev().copied().collect(), ..Self::default() }
    }

    /// The machine is suspended for so long during the n-th sleep.
    pub(crate) fn suspended_for(suspends_ns: &[i64]) -> Self {
        Self { suspends_ns: suspends_ns.iter().rev().copied().collect(), ..Self::default() }
    }
}

impl Clock for ScriptedClock {
    fn kind(&self) -> ClockKind {
        ClockKind::Real
    }

    fn now_ns(&mut self) -> i64 {
        self.now_ns
    }

    fn elapsed_ns(&mut self) -> i64 {
        self.now_ns + self.suspended_ns
    }

    fn sleep_until(&mut self, deadline_ns: i64) {
        self.now_ns = self.now_ns.max(deadline_ns) + self.late_ns.pop().unwrap_or(0);
        self.suspended_ns += self.suspends_ns.pop().unwrap_or(0);
    }
}

/// A plate of points, and what it may touch: a block that is larger, and so many small ones, each
/// of them a metre from the one before.
#[expect(clippy::expect_used, reason = "shapes of a known size")]
pub(crate) fn blocks_and_plate(n_small: u32) -> Arc<RenderScene> {
    let block = |edge_m: f64, voxel_size_m: f64| {
        let shape = Shape::Box { size_m: DVec3::splat(edge_m) };
        let part = Part::of_shape("block", &shape, voxel_size_m);
        part.bake_field(&Options::new(voxel_size_m), false, |_| ()).expect("a small grid").0
    };
    let small = block(4e-3, 1e-3);
    let fields = std::iter::once(block(0.2, 5e-3)).chain((0..n_small).map(|_| small.clone()));
    let obstacles = fields
        .zip(0_u32..)
        .map(|(field, n)| Obstacle {
            field,
            world_from_map: Pose::from_translation(DVec3::X * f64::from(n)),
        })
        .collect();
    // In Z-order: a leaf of the tree of points is a small square.
    let every_second_bit =
        |n: u32| -> u32 { (0..6_u32).map(|bit| ((n >> (2 * bit)) & 1) << bit).sum() };
    let points: Vec<_> = (0..64 * 64_u32)
        .map(|n| {
            let [x, y] = [n, n >> 1].map(|n| f64::from(every_second_bit(n)) - 31.5);
            (DVec3::new(x, y, 0.0) * 2e-3, DVec3::Z)
        })
        .collect();
    let inertia = Inertia { mass_kg: 0.1, body_kg_m2: DMat3::IDENTITY * 1e-5, least_kg_m2: 1e-5 };
    let tool = Tool { shell: Shell::new(&points, 2e-3), inertia, center_of_mass_tool: DVec3::ZERO };
    Arc::new(RenderScene { parameters: parameters(), obstacles, clay: None, tool })
}
