//! How far are the distances from an exact search over all triangles? On real meshes and on meshes
//! much finer than the voxels.

use glam::DVec3;
use vps::mesh::TriangleMesh;
use vps::mesh::closest_point::TriangleProjector;
use vps::mesh::primitives::Shape;
use vps::voxmap::grid::cell_of;

use super::{build, models};

/// Cells that are searched per mesh.
const SAMPLES: usize = 20_000;

/// Boxes in boxes, for a search that shares nothing with the code under test but the distance to
/// one triangle.
struct Tree {
    nodes: Vec<Node>,
    triangles: Vec<[DVec3; 3]>,
}

struct Node {
    low: DVec3,
    high: DVec3,
    /// Triangles of a leaf; children otherwise.
    first: usize,
    n_triangles: usize,
}

impl Tree {
    fn new(mesh: &TriangleMesh) -> Self {
        let triangles =
            (0..mesh.triangles.len()).map(|triangle_idx| mesh.corners(triangle_idx)).collect();
        let mut tree = Self {
            nodes: vec![Node { low: DVec3::ZERO, high: DVec3::ZERO, first: 0, n_triangles: 0 }],
            triangles,
        };
        tree.split(0, 0, mesh.triangles.len());
        tree
    }

    fn split(&mut self, node: usize, first: usize, last: usize) {
        let corners = self.triangles[first..last].as_flattened();
        let low = corners.iter().copied().reduce(DVec3::min).expect("not empty");
        let high = corners.iter().copied().reduce(DVec3::max).expect("not empty");
        self.nodes[node] = Node { low, high, first, n_triangles: last - first };
        if last - first <= 8 {
            return;
        }
        let axis = (0..3)
            .max_by(|a, b| (high - low)[*a].total_cmp(&(high - low)[*b]))
            .expect("three axes");
        let middle = (last - first) / 2;
        let sum = |corners: &[DVec3; 3]| corners[0][axis] + corners[1][axis] + corners[2][axis];
        self.triangles[first..last]
            .select_nth_unstable_by(middle, |a, b| sum(a).total_cmp(&sum(b)));
        let children = self.nodes.len();
        for _ in 0..2 {
            self.nodes.push(Node { low, high, first: 0, n_triangles: 0 });
        }
        (self.nodes[node].first, self.nodes[node].n_triangles) = (children, 0);
        self.split(children, first, first + middle);
        self.split(children + 1, first + middle, last);
    }

    fn distance(&self, point: DVec3) -> f64 {
        let mut best = f64::INFINITY;
        let mut stack = vec![(0, 0.0)];
        let to_box = |node: &Node| (point - point.clamp(node.low, node.high)).length_squared();
        while let Some((node_idx, bound)) = stack.pop() {
            if bound >= best {
                continue;
            }
            let node: &Node = &self.nodes[node_idx];
            if node.n_triangles > 0 {
                for corners in &self.triangles[node.first..node.first + node.n_triangles] {
                    best =
                        best.min(TriangleProjector::new(corners).project(point).distance_squared);
                }
                continue;
            }
            let mut children =
                [node.first, node.first + 1].map(|child| (child, to_box(&self.nodes[child])));
            children.sort_by(|a, b| b.1.total_cmp(&a.1));
            stack.extend(children);
        }
        best.sqrt()
    }
}

/// Errors over sampled cells of the band, voxels.
struct Errors {
    mean: f64,
    p99: f64,
    worst: f64,
    cells: usize,
}

#[expect(clippy::print_stdout, reason = "the figures are the purpose")]
fn errors(name: &str, mesh: &TriangleMesh, cells_on_longest_axis: f64, layers: u32) -> Errors {
    let (low, high) = mesh.bounds().expect("not empty");
    let voxel_size_m = (high - low).max_element() / cells_on_longest_axis;
    let map = build(mesh, voxel_size_m, layers);
    let distances = map.distances(mesh, false);
    let tree = Tree::new(map.mesh(mesh));
    let in_band = |(_, layer): &(usize, &i8)| layer.unsigned_abs() <= layers as u8;
    let all = || map.layers.values.iter().flatten().enumerate().filter(in_band);
    let stride = (all().count() / SAMPLES).max(1);
    let mut errors: Vec<f64> = all()
        .step_by(stride)
        .map(|(cell, _)| {
            let slot = cell / 512;
            let inside = cell % 512;
            let grid = &map.surface.grid;
            let center = grid
                .center_map(cell_of(grid.brick_coord(map.layers.bricks[slot] as usize), inside));
            let measured = f64::from(distances.values_m[slot][inside]).abs();
            assert!(measured.is_finite(), "{name}: {measured} at {center}");
            (measured - tree.distance(center)).abs() / voxel_size_m
        })
        .collect();
    errors.sort_by(f64::total_cmp);
    let found = Errors {
        mean: errors.iter().sum::<f64>() / errors.len() as f64,
        p99: errors[errors.len() * 99 / 100],
        worst: errors[errors.len() - 1],
        cells: errors.len(),
    };
    let Errors { mean, p99, worst, cells } = found;
    println!(
        "{name}, {} triangles, {cells_on_longest_axis} voxels, {layers} layers: mean {mean:.6}, \
            p99 {p99:.6}, worst {worst:.4} voxel over {cells} cells",
        mesh.triangles.len()
    );
    found
}

/// Largest mean error and 99th percentile, voxels; ten times less than what is asked for.
const MEAN: f64 = 0.002;
const P99: f64 = 0.02;

fn check_within(
    p99_max: f64,
    name: &str,
    mesh: &TriangleMesh,
    cells_on_longest_axis: f64,
    layers: u32,
) {
    let Errors { mean, p99, worst, cells } = errors(name, mesh, cells_on_longest_axis, layers);
    assert!(cells > 1000, "{name}: {cells} cells");
    assert!(mean <= MEAN && p99 <= p99_max, "{name}: mean {mean}, p99 {p99}, worst {worst} voxel");
}

fn check(name: &str, mesh: &TriangleMesh, cells_on_longest_axis: f64, layers: u32) {
    check_within(P99, name, mesh, cells_on_longest_axis, layers);
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn distances_on_real_meshes_are_those_of_an_exact_search() {
    for (name, mesh) in models::all() {
        check(name, &mesh, 48.0, 6);
        check(name, &mesh, 160.0, 8);
    }
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn distances_hold_on_meshes_finer_and_coarser_than_the_voxels() {
    let torus = Shape::Torus { major_m: 0.02, minor_m: 0.006 };
    let cone = Shape::Cone { radius_m: 0.01, height_m: 0.02 };
    for (name, shape) in [("torus", torus), ("cone", cone)] {
        for chord_m in [1e-7, 1e-6, 1e-4] {
            // Facets of several voxels that meet at small angles have ties everywhere inside the
            // torus.
            let p99_max = if chord_m > 1e-5 { 0.03 } else { P99 };
            check_within(
                p99_max,
                &format!("{name}, chord {chord_m} m"),
                &shape.tessellate(chord_m),
                60.0,
                8,
            );
        }
    }
    // Triangles that are cut: sixty voxels and more, and a deep band.
    let block = Shape::Box { size_m: DVec3::new(0.03, 0.02, 0.01) }.tessellate(1e-5);
    check("box", &block, 150.0, 20);
    check("torus, deep band", &torus.tessellate(1e-5), 100.0, 60);
}

/// Every triangle on corners of its own, shaken apart by a tenth of a voxel: nothing to walk along.
#[test]
fn distances_hold_on_a_soup() {
    let shape = Shape::Torus { major_m: 0.02, minor_m: 0.006 }.tessellate(1e-5);
    let mut soup = TriangleMesh::default();
    for triangle_idx in 0..shape.triangles.len() {
        let first = soup.vertices.len() as u32;
        let shake =
            DVec3::new(triangle_idx as f64, (triangle_idx * 7) as f64, (triangle_idx * 13) as f64)
                .map(|x| x.sin() * 2e-5);
        soup.vertices.extend(shape.corners(triangle_idx).map(|corner| corner + shake));
        soup.triangles.push([first, first + 1, first + 2]);
    }
    let Errors { mean, p99, .. } = errors("soup", &soup, 120.0, 8);
    assert!(mean <= MEAN && p99 <= P99, "mean {mean}, p99 {p99}");
}
