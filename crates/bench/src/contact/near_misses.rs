//! Time of a query that gives the clearance, just before contact beside just in it: by the clock of
//! the thread.

use glam::{DQuat, DVec3};

use super::super::statistics::median;
use super::super::{BenchError, Row};
use super::fields::contact;
use super::{Options, fixture};
use rt::clock::thread_cpu_ns;
use vps::contact::{ContactSum, Obstacle, SimdLevel, Traversal, TraversalMode};
use vps::mesh::primitives::Shape;
use vps::pointshell::Points;
use vps::pointshell::shell::Shell;
use vps::spatial::Pose;
use vps::voxmap::field::FieldKind;

const GROUP: &str = "near misses: a query with its clearance, of the same in contact";
/// Voxels of the fixed part.
const GAPS: [f64; 6] = [0.01, 0.03, 0.1, 0.3, 1.0, 3.0];
const DEPTH_VOXELS: f64 = 0.5;
const VOXEL_M: f64 = 5e-4;
const POSES: u32 = 64;

pub(super) fn rows(options: &Options, tell: &mut dyn FnMut(&str)) -> Result<Vec<Row>, BenchError> {
    tell("near misses");
    let block = Shape::Box { size_m: DVec3::new(0.08, 0.08, 0.02) }.tessellate(1e-5);
    let obstacles = [fixture::obstacle("block", &block, VOXEL_M, false)?];
    let radius_m = 0.03;
    let ball = Shape::Sphere { radius_m };
    let edge = Shape::Box { size_m: DVec3::splat(radius_m) };
    let mut rows = Vec::new();
    for (name, shape, turn) in [
        ("ball on a block", ball, DQuat::IDENTITY),
        ("box flat on a block", edge, DQuat::IDENTITY),
        ("box on its corner", edge, DQuat::from_rotation_arc(DVec3::ONE.normalize(), DVec3::NEG_Z)),
    ] {
        let mesh = shape.tessellate(0.02 * VOXEL_M);
        let shell = fixture::shell_of(name, &mesh, VOXEL_M, Points::default())?;
        let lowest_m = mesh.vertices.iter().map(|vertex| (turn * *vertex).z).fold(0.0, f64::min);
        let at = |gap_voxels: f64| {
            (0..POSES).map(move |n| {
                // Never twice at one place of the grid.
                let aside = DVec3::new(1.3e-5 * f64::from(n), 0.7e-5 * f64::from(n), 0.0);
                let height_m = 0.01 - lowest_m + gap_voxels * VOXEL_M;
                Pose::new(turn, aside + DVec3::Z * height_m)
            })
        };
        let touching_us = time_us(&obstacles, &shell, at(-DEPTH_VOXELS), options);
        for gap in GAPS {
            let apart_us = time_us(&obstacles, &shell, at(gap), options);
            let share = apart_us.zip(touching_us).map(|(apart, touching)| apart / touching);
            let what = format!("{name}, {} points: {gap} voxels above it", shell.len());
            rows.push(Row::new(GROUP, what, share, "times").at_most(2.0));
        }
    }
    Ok(rows)
}

/// Median of the time of a query, each pose asked by a traversal that knows nothing, µs.
fn time_us(
    obstacles: &[Obstacle],
    shell: &Shell,
    poses: impl Iterator<Item = Pose>,
    options: &Options,
) -> Option<f64> {
    let mut traversal = Traversal::new(SimdLevel::best(), TraversalMode::Tree, obstacles, shell);
    let mut times_us = Vec::new();
    for pose in poses {
        for _ in 0..options.n_runs.max(3) {
            traversal.forget();
            let begin_ns = thread_cpu_ns();
            let law = contact(FieldKind::Trilinear);
            core::hint::black_box(ContactSum::with_clearance(
                &mut traversal,
                obstacles,
                shell,
                core::hint::black_box(pose),
                law,
                None,
            ));
            times_us.push((thread_cpu_ns() - begin_ns) as f64 * 1e-3);
        }
    }
    median(&times_us)
}
