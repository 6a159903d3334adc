//! The contact query: flat and tree, few and many points, few and many touching, small and large
//! static models.
//!
//! `cargo bench -p bench --bench contact` measures; `-- --test` runs each once. For clean figures:
//! `chrt -r 20`, on a processor of its own.
#![expect(clippy::print_stderr, reason = "percentiles, which criterion does not give")]

use std::hint::black_box;
use std::time::Instant;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use glam::{DQuat, DVec3};
use vps::contact::{ContactSum, ForceLaw, Obstacle, SimdLevel, Traversal, TraversalMode};
use vps::mesh::TriangleMesh;
use vps::mesh::primitives::Shape;
use vps::mesh::validate::inspect;
use vps::pointshell::{self, shell::Shell};
use vps::spatial::Pose;
use vps::voxmap::inside_test::InsideTest;
use vps::voxmap::{Options, Volume};

const LAW: ForceLaw = ForceLaw { stiffness_n_per_m: 1000.0, ..ForceLaw::PLAIN };
/// Radius of the tool, a ball, m.
const RADIUS_M: f64 = 0.046;
/// Voxel edge of the obstacles, m.
const VOXEL_M: f64 = 5e-4;
/// Ticks on the path of a tool that slides at 50 mm/s and turns at 1 rad/s.
const PATH_TICKS: usize = 1000;
/// Rounds on it that percentiles are taken of.
const ROUNDS: usize = 3;

fn build(mesh: &TriangleMesh, voxel_size_m: f64, layers: u32) -> Volume {
    let options = Options { voxel_size_m, layers, navigation: None, sides: InsideTest::Auto };
    match Volume::build(mesh, &inspect(mesh), &options, |_| {}) {
        Ok(map) => map,
        Err(error) => panic!("{error}"),
    }
}

/// A ball of about so many points.
fn ball(n_points: f64) -> Shell {
    let mesh = Shape::Sphere { radius_m: RADIUS_M }.tessellate(2e-6);
    // A supercover of area A has 1.5·A/s² voxels.
    let voxel_size_m = (1.5 * 4.0 * core::f64::consts::PI * RADIUS_M * RADIUS_M / n_points).sqrt();
    pointshell::build(&mesh, &build(&mesh, voxel_size_m, 3), DVec3::ZERO).0
}

fn obstacle(mesh: &TriangleMesh) -> Obstacle {
    Obstacle { field: build(mesh, VOXEL_M, 8).field(mesh, false), world_from_map: Pose::IDENTITY }
}

fn slab() -> Obstacle {
    obstacle(&Shape::Plane { x_m: 0.2, y_m: 0.2, thickness_m: 0.02 }.tessellate(1e-5))
}

/// A ring that the ball sits in: contact all around.
fn ring() -> Obstacle {
    obstacle(&Shape::Torus { major_m: 0.045, minor_m: 0.015 }.tessellate(1e-5))
}

/// The height at which this share of the points touches; one and a half voxels above the first
/// contact for none.
fn height_m(obstacle: &[Obstacle], shell: &Shell, share: f64) -> f64 {
    let touching = |z_m: f64| {
        let pose = Pose::from_translation(DVec3::new(0.0, 0.0, z_m));
        f64::from(ContactSum::flat(obstacle, shell, pose, LAW).contacts) / shell.len() as f64
    };
    let mut low = 0.0;
    let mut high = 2.0 * RADIUS_M;
    for _ in 0..30 {
        let middle = 0.5 * (low + high);
        if touching(middle) > share { low = middle } else { high = middle }
    }
    if share == 0.0 { high + 1.5 * VOXEL_M } else { high }
}

fn path(height_m: f64) -> Vec<Pose> {
    (0..PATH_TICKS)
        .map(|tick| {
            let angle = core::f64::consts::TAU * tick as f64 / PATH_TICKS as f64;
            let side_m = 0.05 / core::f64::consts::TAU;
            let about = DVec3::new(0.3, 0.5, 0.8).normalize() * (0.16 * angle.sin());
            Pose::new(
                DQuat::from_scaled_axis(about),
                DVec3::new(side_m * 0.1 * angle.cos(), side_m * 0.1 * angle.sin(), height_m),
            )
        })
        .collect()
}

fn tick(
    traversal: &mut Traversal,
    obstacles: &[Obstacle],
    shell: &Shell,
    pose: Pose,
) -> ContactSum {
    ContactSum::of(traversal, obstacles, shell, pose, LAW, None)
}

/// Median and 99.9th percentile of some rounds on the path, µs, and what the walk looked at.
fn percentiles(
    what: &str,
    traversal: &mut Traversal,
    obstacles: &[Obstacle],
    shell: &Shell,
    path: &[Pose],
) {
    let mut times_us = Vec::with_capacity(ROUNDS * path.len());
    let mut contacts = 0_u64;
    let mut looked_at = 0_u64;
    for pose in path.iter().cycle().take(ROUNDS * path.len()) {
        let begin = Instant::now();
        let sum = black_box(tick(traversal, obstacles, shell, *pose));
        times_us.push(begin.elapsed().as_secs_f64() * 1e6);
        contacts += u64::from(sum.contacts);
        looked_at += u64::from(sum.looked_at);
    }
    times_us.sort_by(f64::total_cmp);
    let at = |share: f64| times_us[((times_us.len() - 1) as f64 * share) as usize];
    let mean = |n: u64| n as f64 / times_us.len() as f64;
    eprintln!(
        "{what}: {} points, {:.2} % touching, {:.0} looked at: median {:.1} µs, p99.9 {:.1} µs, \
            max {:.1} µs",
        shell.len(),
        100.0 * mean(contacts) / shell.len() as f64,
        mean(looked_at),
        at(0.5),
        at(0.999),
        at(1.0)
    );
}

fn measure(
    criterion: &mut Criterion,
    group: &str,
    name: &str,
    (level, mode): (SimdLevel, TraversalMode),
    (obstacles, shell, path): (&[Obstacle], &Shell, &[Pose]),
) {
    let mut traversal = Traversal::new(level, mode, obstacles, shell);
    percentiles(&format!("{group}, {name}"), &mut traversal, obstacles, shell, path);
    let mut group = criterion.benchmark_group(group);
    group.sample_size(20);
    group.throughput(Throughput::Elements(shell.len() as u64));
    let mut poses = path.iter().cycle();
    group.bench_function(BenchmarkId::from_parameter(name), |bencher| {
        bencher.iter(|| poses.next().map(|pose| tick(&mut traversal, obstacles, shell, *pose)));
    });
    group.finish();
}

fn points(criterion: &mut Criterion) {
    let obstacles = [slab()];
    for n_points in [1e6, 1e5, 8e3] {
        let shell = ball(n_points);
        for share in [0.0, 0.03] {
            let path = path(height_m(&obstacles, &shell, share));
            let name = format!("{n_points:.0e}, {:.0} % touching", 100.0 * share);
            measure(
                criterion,
                "flat",
                &name,
                (SimdLevel::best(), TraversalMode::Flat),
                (&obstacles, &shell, &path),
            );
            if n_points < 1e6 {
                measure(
                    criterion,
                    "flat, portable",
                    &name,
                    (SimdLevel::Portable, TraversalMode::Flat),
                    (&obstacles, &shell, &path),
                );
            }
        }
    }
}

fn tree(criterion: &mut Criterion) {
    let shell = ball(1e6);
    for (what, obstacle) in [("slab", slab()), ("ring", ring())] {
        let obstacles = [obstacle];
        for share in [0.0, 0.01, 0.03] {
            let path = path(height_m(&obstacles, &shell, share));
            let name = format!("{what}, {:.0} % touching", 100.0 * share);
            measure(
                criterion,
                "tree",
                &name,
                (SimdLevel::best(), TraversalMode::Tree),
                (&obstacles, &shell, &path),
            );
        }
    }
}

/// The same sphere of few and of many triangles.
fn static_model(criterion: &mut Criterion) {
    let shell = ball(1e5);
    for tolerance_m in [2.5e-5, 8e-8] {
        let mesh = Shape::Sphere { radius_m: 0.03 }.tessellate(tolerance_m);
        let obstacles = [obstacle(&mesh)];
        let path = path(height_m(&obstacles, &shell, 0.01));
        for (name, mode) in [("flat", TraversalMode::Flat), ("tree", TraversalMode::Tree)] {
            let name = format!("{name}, {} triangles", mesh.triangles.len());
            measure(
                criterion,
                "static model",
                &name,
                (SimdLevel::best(), mode),
                (&obstacles, &shell, &path),
            );
        }
    }
}

criterion_group!(contact, tree, points, static_model);
criterion_main!(contact);
