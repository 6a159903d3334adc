//! Same scene, same hand: same bits, run after run and whatever the number of threads that baked
//! it.

use recording::TickRecord;
use vps::spatial::{Pose, Twist, Wrench};

use super::rig;

const TICKS: u64 = 3000;

/// Everything of a tick but the times that this machine took, as bits: a NaN is equal to itself, −0
/// is not 0.
pub(crate) fn bits(record: &TickRecord) -> Vec<u64> {
    let mut bits = Vec::new();
    let mut put = |numbers: &[f64]| bits.extend(numbers.iter().map(|number| number.to_bits()));
    let TickRecord {
        tick,
        time_ns,
        wakeup_ns: _,
        compute_ns: _,
        device_ns: _,
        input,
        output,
        scene_idx,
        rendered_device,
        beside_device,
        contact_budget_points: _,
    } = record;
    let mut pose = |Pose { rotation, translation }: Pose| {
        put(&rotation.to_array());
        put(&translation.to_array());
    };
    pose(input.sample.pose);
    pose(output.world_from_tool);
    let Twist { linear, angular } = input.sample.twist;
    put(&linear.to_array());
    put(&angular.to_array());
    for Wrench { force, torque } in [
        output.command_device,
        output.commanded_device,
        output.contact_world,
        *rendered_device,
        *beside_device,
    ] {
        put(&force.to_array());
        put(&torque.to_array());
    }
    put(&[
        output.max_depth_m,
        output.clearance_m,
        output.energy_j,
        output.object_work_j,
        input.sample.grip_rad,
    ]);
    let contacts = u64::from(output.contacts);
    let faults = u64::from(output.faults.bits());
    bits.extend([
        *tick,
        time_ns.unsigned_abs(),
        input.sample.sequence,
        contacts,
        faults,
        output.drive as u64,
        u64::from(*scene_idx),
    ]);
    bits
}

fn on_threads(n_threads: usize, name: &str) -> Vec<Vec<u64>> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().expect("a pool");
    let run = pool.install(|| rig::run_ticks(&rig::load(&rig::shipped(name)), TICKS));
    assert!(
        run.records.iter().any(|record| record.output.contacts > 0),
        "{name}: nothing was touched"
    );
    run.records.iter().map(bits).collect()
}

fn assert_same(name: &str) {
    let first = on_threads(1, name);
    for n_threads in [1, 2] {
        let again = on_threads(n_threads, name);
        assert_eq!(first.len(), again.len(), "{name}");
        let differs = first.iter().zip(&again).position(|(a, b)| a != b);
        assert_eq!(
            differs, None,
            "{name}: first tick that differs, baked on {n_threads} thread(s)"
        );
    }
}

#[test]
fn block_on_plane_gives_the_same_bits_again() {
    assert_same("block-on-plane");
}

#[test]
fn peg_in_hole_gives_the_same_bits_again() {
    assert_same("peg-in-hole");
}
