//! What obstacles cost that the tool is nowhere near: 1, 10 and 200 of them, with the broad phase
//! and without.

use std::hint::black_box;
use std::time::Instant;

use glam::{DQuat, DVec3};

use super::super::statistics::{median, quantile};
use super::super::{BenchError, Row};
use super::fields::contact;
use super::{Options, fixture};
use vps::contact::{ContactSum, Obstacle, SimdLevel, Traversal, TraversalMode};
use vps::mesh::primitives::Shape;
use vps::pointshell::Points;
use vps::pointshell::shell::Shell;
use vps::spatial::Pose;
use vps::voxmap::field::FieldKind;

const VOXEL_M: f64 = 5e-4;
/// The tool, a ball.
const RADIUS_M: f64 = 0.02;
const TOOL_VOXEL_M: f64 = 1e-3;
/// Edge of the obstacles that are far away, and how far they are from each other, m.
const FAR_EDGE_M: f64 = 0.01;
const FAR_EVERY_M: f64 = 0.03;
/// Queries on a path over the slab, and rounds on it.
const PATH_TICKS: usize = 1000;

pub(super) fn rows(options: &Options, tell: &mut dyn FnMut(&str)) -> Result<Vec<Row>, BenchError> {
    let ball = fixture::tessellated(Shape::Sphere { radius_m: RADIUS_M }, TOOL_VOXEL_M);
    let shell = fixture::shell_of("a ball", &ball, TOOL_VOXEL_M, Points::default())?;
    let group =
        format!("a ball of {} points slides over a slab, other objects far away", shell.len());
    let mut rows = Vec::new();
    for n_obstacles in [1, 10, 200] {
        tell(&format!("{n_obstacles} objects"));
        let obstacles = scene(n_obstacles)?;
        let mut times_us = [Vec::new(), Vec::new()];
        let mut near = 0;
        for _ in 0..options.n_runs.max(2) {
            // In turn, so that a busy moment of the machine meets both.
            for (broad_phase, times_us) in [true, false].into_iter().zip(&mut times_us) {
                let mut traversal =
                    Traversal::new(SimdLevel::best(), TraversalMode::Tree, &obstacles, &shell)
                        .with_broad_phase(broad_phase);
                times_us.extend(slide(&mut traversal, &obstacles, &shell));
                near = if broad_phase { traversal.n_near() } else { near };
            }
        }
        for (name, mut times_us) in ["with", "without"].into_iter().zip(times_us) {
            times_us.sort_by(f64::total_cmp);
            let row = |what: &str, us: Option<f64>| {
                Row::new(
                    &group,
                    format!("{n_obstacles} objects, {name} broad phase: {what}"),
                    us,
                    "µs",
                )
            };
            rows.extend([
                row("one query, median", median(&times_us)),
                row("one query, p99", quantile(&times_us, 0.99)),
            ]);
        }
        rows.push(Row::new(
            &group,
            format!("{n_obstacles} objects: asked in the last query"),
            near as f64,
            "",
        ));
    }
    Ok(rows)
}

/// A slab whose top is z = 0, and cubes on a lattice above it, none of them near the path.
fn scene(n_obstacles: usize) -> Result<Vec<Obstacle>, BenchError> {
    let slab =
        fixture::tessellated(Shape::Plane { x_m: 0.1, y_m: 0.1, thickness_m: 0.02 }, VOXEL_M);
    let cube = fixture::tessellated(Shape::Box { size_m: DVec3::splat(FAR_EDGE_M) }, VOXEL_M);
    let mut obstacles = vec![fixture::obstacle("a slab", &slab, VOXEL_M, false)?];
    for n in 1..n_obstacles {
        let place = DVec3::new((n % 6) as f64 - 2.5, (n / 6 % 6) as f64 - 2.5, (n / 36) as f64)
            * FAR_EVERY_M;
        let turn = DQuat::from_scaled_axis(DVec3::new(1.3, 0.4, 2.1) * n as f64);
        let mut far = fixture::obstacle("a cube", &cube, VOXEL_M, false)?;
        far.world_from_map = Pose::new(turn, place + DVec3::Z * 5.0 * RADIUS_M);
        obstacles.push(far);
    }
    Ok(obstacles)
}

/// Times of the queries along the path, at 50 mm/s and one turn a second, half a voxel deep, µs.
fn slide(traversal: &mut Traversal, obstacles: &[Obstacle], shell: &Shell) -> Vec<f64> {
    let law = contact(FieldKind::Trilinear);
    let pose = |n: usize| {
        let t = n as f64 * 1e-3;
        let place =
            DVec3::new(0.025 * (2.0 * t).sin(), 0.025 * (2.0 * t).cos(), RADIUS_M - 0.5 * VOXEL_M);
        Pose::new(DQuat::from_rotation_z(core::f64::consts::TAU * t), place)
    };
    let mut ask = |n: usize| {
        let pose = pose(n);
        let since = Instant::now();
        black_box(ContactSum::of(traversal, obstacles, shell, black_box(pose), law, None));
        since.elapsed().as_secs_f64() * 1e6
    };
    (0..PATH_TICKS).map(&mut ask).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_of_ten_is_near_and_it_is_touched() {
        let obstacles = scene(10).unwrap();
        let shell = fixture::shell_of(
            "a ball",
            &fixture::tessellated(Shape::Sphere { radius_m: RADIUS_M }, TOOL_VOXEL_M),
            TOOL_VOXEL_M,
            Points::default(),
        )
        .unwrap();
        let mut traversal =
            Traversal::new(SimdLevel::best(), TraversalMode::Tree, &obstacles, &shell);
        assert_eq!(slide(&mut traversal, &obstacles, &shell).len(), PATH_TICKS);
        assert!(traversal.n_near() == 1 && !traversal.touched().is_empty());
    }
}
