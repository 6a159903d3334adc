//! How much memory will a bake take? Answered from the triangles and the voxel size, before any
//! voxel is marked.
//!
//! A convex body of area A and a random position and direction touches on average `1 + ¾·p/s +
//! 1½·A/s²` cells, where p is the perimeter of a triangle (for a closed surface only the last term
//! is left). A brick holds a cell of the band where the surface meets the brick grown by L cells on
//! every side, a box of edge `8 + 2L` cells; there is one such box per 8³ cells, so there are
//! `1½·A/s² · (8 + 2L)/8³` of them. Parts that overlap count twice and a surface folded within its
//! own band counts more than it takes, so both counts are capped by the box. With the counts, the
//! arrays of each stage add up; the largest stage is the peak.
//!
//! Measured on a scanned figure of 1,024 voxels and 3,592,616 surface voxels, ±8 layers: 56,095
//! bricks with surface where these voxels foretell 56,135, and 168,001 bricks of the band where
//! they foretell 168,404. Coarse grids, edges and corners take more than that, folds less: the
//! tests hold counts and arrays of small shapes to within a half.
//!
//! # Source
//! The mean number of lattice cells that a convex body touches: rotation sums of intrinsic volumes
//! (Santaló, *Integral Geometry and Geometric Probability*, III.13); the constants are those of the
//! unit cube.

use core::mem::size_of;

use glam::{DVec3, Vec3};

use super::grid::{BRICK_CELLS, BRICK_EDGE, Grid};
use super::surface::Mask;
use crate::mesh::TriangleMesh;

/// What the estimate needs to know of a mesh.
#[derive(Clone, Copy, Debug)]
pub struct MeshMeasures {
    /// Lowest and highest corner of the mesh, m.
    pub bounds_m: (DVec3, DVec3),
    /// Sum of the triangles' areas, m².
    pub area_m2: f64,
    /// Sum of the triangles' perimeters, m.
    perimeter_m: f64,
    /// Triangles.
    pub n_triangles: u64,
    /// Vertices.
    pub n_vertices: u64,
}

impl MeshMeasures {
    /// Measures a mesh. Cost: O(triangles).
    pub fn of(mesh: &TriangleMesh) -> Self {
        let mut area_m2 = 0.0;
        let mut perimeter_m = 0.0;
        for triangle_idx in 0..mesh.triangles.len() {
            let [a, b, c] = mesh.corners(triangle_idx);
            area_m2 += 0.5 * (b - a).cross(c - a).length();
            perimeter_m += (b - a).length() + (c - b).length() + (a - c).length();
        }
        Self {
            bounds_m: mesh.bounds().unwrap_or_default(),
            area_m2,
            perimeter_m,
            n_triangles: mesh.triangles.len() as u64,
            n_vertices: mesh.vertices.len() as u64,
        }
    }
}

/// What is baked of an object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Products {
    /// The field of an obstacle.
    pub field: bool,
    /// Gradients in the field.
    pub gradients: bool,
    /// The pointshell of a tool.
    pub shell: bool,
}

/// What a bake will take.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Cells in the box.
    pub voxels: u64,
    /// Surface voxels.
    pub surface_voxels: u64,
    /// Pairs of a triangle and a voxel that it touches.
    touching_pairs: u64,
    /// Bricks that the band touches.
    band_bricks: u64,
    /// Most bytes held at a time.
    pub peak_bytes: u64,
    /// Bytes held when the object is done: its field, its shell.
    pub kept_bytes: u64,
}

/// Surface and layers, per brick of the grid: the top grid of the layers (that of the marking is
/// gone by then) and bit sets.
const PER_BRICK: f64 = size_of::<u32>() as f64 + 0.5;
/// Per brick with surface: mask, outside, ranks, number; the marks of the threads are gone when the
/// rest comes.
const PER_SURFACE_BRICK: f64 =
    (2 * size_of::<Mask>() + BRICK_EDGE * size_of::<u32>() + size_of::<u32>()) as f64;
/// Per brick of the band: layer values and number.
const PER_BAND_BRICK: f64 = (BRICK_CELLS + size_of::<u32>()) as f64;
/// Per brick of the band while distances are measured: the choices on the lattices and where their
/// neighbours are.
const MEASURING: f64 = ((64 + 8 + 8) * size_of::<u32>()) as f64;
/// Per triangle while distances are measured: a patch, what is across its edges, its triangle and
/// its share of the search tree.
const PATCH: f64 = (64 + 4 * size_of::<u32>() + 30) as f64;
/// Per brick of the band: gradients.
const GRADIENTS: f64 = (BRICK_CELLS * size_of::<Vec3>()) as f64;
/// Per brick of the band: what the field keeps, samples with the neighbours' first ones, by how much
/// they were moved, and layers.
const FIELD: f64 = ((BRICK_EDGE + 1) * (BRICK_EDGE + 1) * (BRICK_EDGE + 1) * (size_of::<f32>() + 1)
    + BRICK_CELLS) as f64;
/// Per brick of the band while samples are moved: what the samples around each say.
const MOVING: f64 = (2 * BRICK_CELLS) as f64;
/// Per point of the shell while it is built: position, place in the order, normal.
const POINT: f64 = (size_of::<Vec3>() * 2 + size_of::<u32>()) as f64;
/// Per point of the shell: position, normal and its share of the tree.
const POINT_KEPT: f64 = (2 * size_of::<Vec3>()) as f64 + 2.0;

impl Estimate {
    /// Takes the counts of `measures` on `grid` together. Cost: constant.
    pub fn new(measures: &MeshMeasures, grid: &Grid, n_layers: u32, products: Products) -> Self {
        let s = grid.voxel_size_m;
        let edge = BRICK_EDGE as f64;
        let n_bricks = grid.n_bricks() as f64;
        let n_cells = grid.n_cells() as f64;
        let area_in_cells = measures.area_m2 / (s * s);
        let pairs =
            measures.n_triangles as f64 + 0.75 * measures.perimeter_m / s + 1.5 * area_in_cells;
        let surface_voxels = (1.5 * area_in_cells).min(n_cells);
        let surface_bricks = (surface_voxels / (edge * edge)).max(1.0).min(n_bricks);
        let band_bricks = (1.5 * area_in_cells * (edge + 2.0 * f64::from(n_layers)) / edge.powi(3))
            .max(1.0)
            .min(n_bricks);

        let mesh = (2 * measures.n_vertices) as f64 * size_of::<DVec3>() as f64
            + 12.0 * measures.n_triangles as f64;
        let map = PER_BRICK * n_bricks
            + PER_SURFACE_BRICK * surface_bricks
            + PER_BAND_BRICK * band_bricks;
        let gradients = if products.gradients { GRADIENTS } else { 0.0 };
        let mut field = 0.0;
        let mut shell = 0.0;
        let mut peak = mesh + map;
        // The field shares the layers of the map.
        let shared = if products.field { BRICK_CELLS as f64 * band_bricks } else { 0.0 };
        if products.field {
            field = (FIELD + gradients) * band_bricks + size_of::<u32>() as f64 * n_bricks;
            let measuring = MEASURING * band_bricks + PATCH * measures.n_triangles as f64;
            peak = mesh + map + field - shared + measuring.max(MOVING * band_bricks);
        }
        if products.shell {
            shell = POINT_KEPT * surface_voxels;
            peak = peak.max(
                mesh + map + field - shared
                    + shell
                    + POINT * surface_voxels
                    + size_of::<u32>() as f64 * pairs,
            );
        }
        Self {
            voxels: grid.n_cells(),
            surface_voxels: surface_voxels as u64,
            touching_pairs: pairs as u64,
            band_bricks: band_bricks as u64,
            peak_bytes: peak as u64,
            kept_bytes: (field + shell) as u64,
        }
    }
}

/// The smallest voxel edge (m, within 1 %) with which an object stays within `max_bytes`; `None`
/// where no sensible one does.
pub fn voxel_size_within(
    measures: &MeshMeasures,
    voxel_size_m: f64,
    n_layers: u32,
    products: Products,
    max_bytes: u64,
) -> Option<f64> {
    let (low, high) = measures.bounds_m;
    let fits = |size_m: f64| {
        let grid = Grid::around(low, high, size_m, n_layers).ok()?;
        (Estimate::new(measures, &grid, n_layers, products).peak_bytes <= max_bytes)
            .then_some(size_m)
    };
    // Beyond the object's own size there is nothing left to coarsen.
    let mut size_m = voxel_size_m;
    while size_m <= (high - low).max_element() {
        if let Some(size_m) = fits(size_m) {
            return Some(size_m);
        }
        size_m *= 1.01;
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::primitives::Shape;
    use crate::mesh::validate::inspect;
    use crate::pointshell;
    use crate::voxmap::inside_test::InsideTest;
    use crate::voxmap::surface::visit_hits;
    use crate::voxmap::{Options, Volume};

    /// Both within a factor.
    fn close(estimated: u64, truth: usize, factor: f64) -> bool {
        let ratio = estimated as f64 / truth as f64;
        ratio < factor && ratio > 1.0 / factor
    }

    #[test]
    fn counts_and_arrays_are_foreseen_within_a_half() {
        let shapes = [
            Shape::Sphere { radius_m: 0.5 },
            Shape::Box { size_m: DVec3::new(1.0, 0.7, 0.2) },
            Shape::Torus { major_m: 0.4, minor_m: 0.1 },
            Shape::Cylinder { radius_m: 0.1, height_m: 1.0 },
        ];
        for shape in shapes {
            // Tilted: a face along the grid takes a third less than the mean over all directions.
            let mut mesh = shape.tessellate(0.003);
            let turn = glam::DQuat::from_scaled_axis(DVec3::new(0.5, -0.4, 0.9));
            mesh.vertices.iter_mut().for_each(|vertex| *vertex = turn * *vertex);
            for (cells, n_layers) in [(100.0, 3), (120.0, 8)] {
                let options = Options {
                    voxel_size_m: 1.0 / cells,
                    layers: n_layers,
                    navigation: None,
                    sides: InsideTest::Auto,
                };
                let mut map = Volume::build(&mesh, &inspect(&mesh), &options, |_| ())
                    .expect("a grid that fits");
                let grid = map.surface.grid;
                let products = Products { field: true, gradients: false, shell: true };
                let estimate = Estimate::new(&MeshMeasures::of(&mesh), &grid, n_layers, products);
                assert!(
                    close(estimate.surface_voxels, map.surface.n_voxels, 1.2),
                    "{shape:?} at {cells}: {estimate:?}"
                );
                assert!(
                    close(estimate.band_bricks, map.layers.bricks.len(), 1.5),
                    "{shape:?} at {cells}: {estimate:?}"
                );
                let mut pairs = 0;
                for triangle_idx in 0..mesh.triangles.len() {
                    let corners = mesh.corners(triangle_idx).map(|corner| grid.to_cells(corner));
                    visit_hits(&corners, grid.dims, map.surface.navigation, |_| pairs += 1);
                }
                assert!(
                    close(estimate.touching_pairs, pairs, 1.2),
                    "{shape:?} at {cells}: {estimate:?}, {pairs} pairs"
                );

                let layers = size_of_val(&*map.layers.values)
                    + size_of_val(&*map.layers.top)
                    + size_of_val(&*map.layers.bricks);
                let measuring = map.layers.bricks.len() * 320 + mesh.triangles.len() * 110;
                let field = map.field(&mesh, false).heap_bytes();
                let shell = pointshell::build(&mesh, &map, DVec3::ZERO).0.heap_bytes();
                let mesh_bytes = 2 * size_of_val(&*mesh.vertices) + size_of_val(&*mesh.triangles);
                assert!(
                    close(estimate.kept_bytes, field + shell, 1.5),
                    "{shape:?} at {cells}: {estimate:?}, {field} + {shell}"
                );
                let shared = mesh_bytes + 2 * size_of_val(&*map.surface.masks) + layers + field;
                // The layers are the field's own; points take twice their size while they are put
                // in order.
                let peak = shared - size_of_val(&*map.layers.values) + measuring.max(2 * shell);
                assert!(
                    close(estimate.peak_bytes, peak, 1.5),
                    "{shape:?} at {cells}: {estimate:?}, {peak} bytes"
                );
            }
        }
    }

    #[test]
    fn the_voxel_size_that_fits_fits_and_a_finer_one_does_not() {
        let mesh = Shape::Sphere { radius_m: 0.5 }.tessellate(0.01);
        let measures = MeshMeasures::of(&mesh);
        let products = Products { field: true, gradients: true, shell: false };
        let peak = |size_m| {
            let grid = Grid::around(measures.bounds_m.0, measures.bounds_m.1, size_m, 8)
                .expect("a grid that fits");
            Estimate::new(&measures, &grid, 8, products).peak_bytes
        };
        for max_bytes in [10_000_000, 100_000_000, 2_000_000_000] {
            let size_m =
                voxel_size_within(&measures, 2e-4, 8, products, max_bytes).expect("a size");
            assert!(
                peak(size_m) <= max_bytes && peak(size_m / 1.02) > max_bytes,
                "{max_bytes}: {size_m}"
            );
        }
        assert_eq!(voxel_size_within(&measures, 1e-3, 8, products, 1000), None);
    }
}
