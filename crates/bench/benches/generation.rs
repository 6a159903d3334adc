//! Kernels of generation, one at a time. `cargo bench -p bench --bench generation` measures; `--
//! --test` runs each once.

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use glam::DVec3;
use vps::mesh::TriangleMesh;
use vps::mesh::closest_point::{TriangleProjector, project_by_voronoi_clamp};
use vps::mesh::primitives::Shape;
use vps::mesh::validate::inspect;
use vps::pointshell;
use vps::voxmap::fill::Sides;
use vps::voxmap::grid::Grid;
use vps::voxmap::inside_test::InsideTest;
use vps::voxmap::layers::Layers;
use vps::voxmap::surface::{Navigation, Surface, visit_hits, visit_hits_by_brute_force};
use vps::voxmap::{Options, Volume};

/// A tilted triangle with edges of about this many voxels, in the middle of a grid of 512³.
fn triangle(edge_cells: f64) -> [DVec3; 3] {
    let center = DVec3::new(256.3, 255.8, 256.1);
    [DVec3::new(0.5, -0.2, 0.1), DVec3::new(-0.3, 0.5, 0.25), DVec3::new(-0.25, -0.35, -0.4)]
        .map(|arm| center + arm * edge_cells)
}

/// A sphere of this radius in voxels of a millimetre.
fn sphere(radius_cells: f64) -> TriangleMesh {
    Shape::Sphere { radius_m: radius_cells * 1e-3 }.tessellate(1e-4)
}

fn navigation(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("navigation");
    for edge_cells in [0.5, 2.0, 8.0, 32.0, 128.0] {
        let corners = triangle(edge_cells);
        for navigation in [Navigation::PlaneSpan, Navigation::TwoSided] {
            let mut n_hits = 0;
            visit_hits(&corners, [512; 3], navigation, |_| n_hits += 1);
            group.throughput(Throughput::Elements(n_hits));
            group.bench_with_input(
                BenchmarkId::new(navigation.name(), edge_cells),
                &corners,
                |bencher, corners| {
                    bencher.iter(|| {
                        let mut checksum = 0;
                        visit_hits(black_box(corners), [512; 3], navigation, |[x, y, z]| {
                            checksum ^= x ^ y ^ z
                        });
                        checksum
                    });
                },
            );
        }
        // The naive baseline.
        group.bench_with_input(
            BenchmarkId::new("brute force", edge_cells),
            &corners,
            |bencher, corners| {
                bencher.iter(|| {
                    let mut checksum = 0;
                    visit_hits_by_brute_force(black_box(corners), [512; 3], |[x, y, z]| {
                        checksum ^= x ^ y ^ z
                    });
                    checksum
                });
            },
        );
    }
    group.finish();
}

/// Method A of the paper clamps by Voronoi regions, method B solves for the multipliers: 37 % of
/// A's time there.
fn closest_point(criterion: &mut Criterion) {
    let corners = triangle(2.0);
    // All around the triangle, so that every region is met.
    let points: Vec<DVec3> = (0..512)
        .map(|k| {
            corners[0]
                + 3.0
                    * (DVec3::new((k % 8).into(), (k / 8 % 8).into(), (k / 64).into()) / 7.0 - 0.5)
        })
        .collect();
    let mut group = criterion.benchmark_group("closest point");
    group.throughput(Throughput::Elements(points.len() as u64));
    group.bench_function("A, clamped", |bencher| {
        bencher.iter(|| {
            points
                .iter()
                .map(|point| project_by_voronoi_clamp(black_box(&corners), *point).distance_squared)
                .sum::<f64>()
        });
    });
    group.bench_function("B, prepared", |bencher| {
        let projector = TriangleProjector::new(&corners);
        bencher.iter(|| {
            points
                .iter()
                .map(|point| black_box(&projector).project(*point).distance_squared)
                .sum::<f64>()
        });
    });
    group.bench_function("B", |bencher| {
        bencher.iter(|| {
            points
                .iter()
                .map(|point| {
                    TriangleProjector::new(black_box(&corners)).project(*point).distance_squared
                })
                .sum::<f64>()
        });
    });
    group.finish();
}

fn map_and_shell(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("sphere");
    group.sample_size(10);
    for radius_cells in [16.0, 64.0] {
        let mesh = sphere(radius_cells);
        let (low, high) = mesh.bounds().unwrap_or_default();
        let Ok(grid) = Grid::around(low, high, 1e-3, 8) else { continue };
        let surface = Surface::mark(&mesh, &grid, Navigation::PlaneSpan);
        let sides = Sides::flood(&surface);
        group.throughput(Throughput::Elements(surface.n_voxels as u64));
        group.bench_function(BenchmarkId::new("surface", radius_cells), |bencher| {
            bencher.iter(|| Surface::mark(&mesh, &grid, Navigation::PlaneSpan));
        });
        group.bench_function(BenchmarkId::new("fill", radius_cells), |bencher| {
            bencher.iter(|| Sides::flood(&surface))
        });
        group.bench_function(BenchmarkId::new("layers", radius_cells), |bencher| {
            bencher.iter(|| Layers::grow(&surface, &sides, 8))
        });
        let options =
            Options { voxel_size_m: 1e-3, layers: 8, navigation: None, sides: InsideTest::Auto };
        let Ok(map) = Volume::build(&mesh, &inspect(&mesh), &options, |_| {}) else { continue };
        group.bench_function(BenchmarkId::new("shell", radius_cells), |bencher| {
            bencher.iter(|| pointshell::build(&mesh, &map, DVec3::ZERO));
        });
    }
    group.finish();
}

criterion_group!(kernels, navigation, closest_point, map_and_shell);
criterion_main!(kernels);
