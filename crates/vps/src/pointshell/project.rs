//! One point per surface voxel: the closest point of the surface to the voxel's centre, in two
//! phases.
//!
//! Work goes brick by brick. Triangles are sorted into the bricks that they may touch; a brick then
//! walks its own few triangles with 512 keys and points of its own, in cache, without a lock or an
//! atomic, and any number of bricks runs at once.
//!
//! # Source
//! Sagardia2008, section 4. Phase 1 keeps projections that land inside a triangle; phase 2 takes a
//! projection on an edge or corner only for a voxel that phase 1 left without a point. The paper is
//! silent on several phase-1 points in one voxel; ours keeps the one nearest to the voxel's centre
//! and lets the lowest triangle number win a tie, in both phases, which makes the result
//! independent of the order of work.

use glam::{DVec3, Vec4};

use super::bins::{Bins, cell_range};
use crate::mesh::TriangleMesh;
use crate::mesh::closest_point::TriangleProjector;
use crate::parallel;
use crate::voxmap::grid::{BRICK_CELLS, BRICK_EDGE, brick_origin};
use crate::voxmap::sat::TriangleSat;
use crate::voxmap::surface::{Surface, bits};

/// The point of one surface voxel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// The voxel it belongs to.
    pub cell: [i32; 3],
    /// Position, cell coordinates.
    pub cells: DVec3,
    /// Triangle it lies on.
    pub triangle_idx: u32,
    /// It lies on an edge or a corner: found in phase 2.
    pub on_boundary: bool,
}

/// Set in the key of a projection on an edge or corner, so that any interior projection sorts
/// before it.
const BOUNDARY: u64 = 1 << 63;

/// Far above the rounding of any coordinate (10⁻¹¹ cells), far below what a point may be off.
const TOLERANCE_CELLS: f64 = 1e-6;

/// Projects every surface voxel's centre on the triangles that touch the voxel and keeps one point
/// each, in order of rank.
///
/// Runs on the current rayon pool. Cost: at most one projection per pair of triangle and surface
/// voxel in the triangle's box.
pub fn project(mesh: &TriangleMesh, surface: &Surface) -> Vec<SurfacePoint> {
    let bins = Bins::sort(mesh, surface);
    let brick = |scratch: &mut Scratch, slot| {
        scratch.project(mesh, surface, &bins, slot).collect::<Vec<_>>()
    };
    parallel::map_with(surface.bricks.len(), 1, Scratch::default, brick).concat()
}

/// The best projections of one brick so far, for each of its cells.
pub(super) struct Scratch {
    /// Phase, then squared distance, then triangle: the smallest key wins, which does both phases
    /// and breaks ties.
    keys: [u64; BRICK_CELLS],
    /// Distance of the best projection inside a triangle, cells, rounded up; infinite where there
    /// is none.
    reach: [f32; BRICK_CELLS],
    points: [DVec3; BRICK_CELLS],
}

impl Default for Scratch {
    fn default() -> Self {
        Self {
            keys: [u64::MAX; BRICK_CELLS],
            reach: [f32::INFINITY; BRICK_CELLS],
            points: [DVec3::ZERO; BRICK_CELLS],
        }
    }
}

impl Scratch {
    /// The points of the brick in one slot, in order of rank.
    pub(super) fn project<'a>(
        &'a mut self,
        mesh: &TriangleMesh,
        surface: &'a Surface,
        bins: &Bins,
        slot: usize,
    ) -> impl Iterator<Item = SurfacePoint> + 'a {
        self.keys.fill(u64::MAX);
        self.reach.fill(f32::INFINITY);
        let origin = brick_origin(surface.grid.brick_coord(surface.bricks[slot] as usize));
        let mask = &surface.masks[slot];
        for triangle_idx in bins.triangles(slot) {
            let corners =
                mesh.corners(triangle_idx as usize).map(|corner| surface.grid.to_cells(corner));
            self.add(triangle_idx, &corners, origin, mask);
        }
        let this = &*self;
        mask.iter().enumerate().flat_map(move |(x, word)| {
            bits(*word).map(move |bit| {
                let inside = x << 6 | bit as usize;
                let key = this.keys[inside];
                // The surface was marked with the same test, so some triangle of the bin touches
                // the cell.
                assert!(key != u64::MAX, "a surface voxel that no triangle touches");
                SurfacePoint {
                    cell: [
                        origin[0] + x as i32,
                        origin[1] + (bit >> 3) as i32,
                        origin[2] + (bit & 7) as i32,
                    ],
                    cells: this.points[inside],
                    triangle_idx: key as u32,
                    on_boundary: key & BOUNDARY != 0,
                }
            })
        })
    }

    /// Offers one triangle to the surface cells of the brick that it touches.
    fn add(
        &mut self,
        triangle_idx: u32,
        corners: &[DVec3; 3],
        origin: [i32; 3],
        mask: &[u64; BRICK_EDGE],
    ) {
        let [x, y, z] = [0, 1, 2].map(|axis| {
            let (low, high) = cell_range(corners, axis);
            (low - origin[axis]).max(0) as usize
                ..((high - origin[axis]).min(BRICK_EDGE as i32 - 1) + 1).max(0) as usize
        });
        if x.is_empty() || y.is_empty() || z.is_empty() {
            return;
        }
        // Bit y·8 + z: the range of z in one row, repeated for the range of y.
        let row = (0xff_u64 >> (BRICK_EDGE - z.len())) << z.start;
        let rows = (u64::MAX >> (64 - 8 * y.len())) << (8 * y.start);
        let in_box = (row * 0x0101_0101_0101_0101) & rows;
        if x.clone().all(|x| mask[x] & in_box == 0) {
            return;
        }
        let first = DVec3::new(origin[0].into(), origin[1].into(), origin[2].into()) + 0.5;
        let planes = Planes::new(corners, first);
        let projector = TriangleProjector::new(corners);
        let mut sat = None;
        for x in x {
            for bit in bits(mask[x] & in_box) {
                let inside = x << 6 | bit as usize;
                let local = [x as i32, (bit >> 3) as i32, (bit & 7) as i32];
                if planes.dismiss(local, self.reach[inside]) {
                    continue;
                }
                let cell = [origin[0] + local[0], origin[1] + local[1], origin[2] + local[2]];
                let center = DVec3::new(cell[0].into(), cell[1].into(), cell[2].into()) + 0.5;
                let projection = projector.project(center);
                let is_interior = projection.feature.is_interior();
                let distance = u64::from((projection.distance_squared as f32).to_bits()) << 32;
                let key =
                    if is_interior { 0 } else { BOUNDARY } | distance | u64::from(triangle_idx);
                if key >= self.keys[inside] {
                    continue;
                }
                // A triangle with a point well inside the voxel passes the test for certain; it
                // decides the rest.
                let is_inside =
                    (projection.point - center).abs().max_element() < 0.5 - TOLERANCE_CELLS;
                if is_inside || sat.get_or_insert_with(|| TriangleSat::new(corners)).hits(cell) {
                    self.keys[inside] = key;
                    self.points[inside] = projection.point;
                    if is_interior {
                        // Rounded up by far more than f32 loses: a tie still meets the comparison
                        // of keys.
                        self.reach[inside] =
                            (projection.distance_squared.sqrt() + TOLERANCE_CELLS) as f32;
                    }
                }
            }
        }
    }
}

/// Four planes of a triangle, to dismiss cells of a brick: its own, and along each edge the one
/// that stands on it. Never dismisses a cell that the triangle touches and would win.
struct Planes {
    /// Normals by coordinate, and values at the brick's first cell: height above the triangle, then
    /// how far beyond each edge.
    x: Vec4,
    y: Vec4,
    z: Vec4,
    at_first: Vec4,
    /// Values beyond which a voxel does not touch the triangle.
    touching: Vec4,
    /// Values beyond which a voxel's centre does not project inside; the first is what rounding
    /// adds to a height.
    interior: Vec4,
}

impl Planes {
    fn new(corners: &[DVec3; 3], first: DVec3) -> Self {
        let edges = [corners[1] - corners[0], corners[2] - corners[1], corners[0] - corners[2]];
        let normal = edges[0].cross(edges[1]);
        let length_squared = normal.length_squared();
        // A thinner triangle's planes, and what its projections call inside, are off by too much to
        // dismiss anything.
        if length_squared.is_nan()
            || length_squared <= 1e-4 * edges[0].length_squared() * edges[1].length_squared()
        {
            let nothing = Vec4::ZERO;
            let all = Vec4::INFINITY;
            return Self {
                x: nothing,
                y: nothing,
                z: nothing,
                at_first: nothing,
                touching: all,
                interior: all,
            };
        }
        let normal = normal / length_squared.sqrt();
        let normals =
            [normal, edges[0].cross(normal), edges[1].cross(normal), edges[2].cross(normal)];
        let mut values = [[0.0; 4]; 6];
        for (k, normal) in normals.iter().enumerate() {
            let at_first = normal.dot(first - corners[k.saturating_sub(1)]);
            let extent = normal.abs().element_sum();
            // Ten times what `f32` loses within a brick, and of a large value outside.
            let slack = 1e-5 * extent + 1e-6 * at_first.abs();
            let value = [normal.x, normal.y, normal.z, at_first, 0.5 * extent + slack, slack];
            (0..6).for_each(|idx| values[idx][k] = value[idx] as f32);
        }
        let [x, y, z, at_first, touching, interior] = values.map(Vec4::from_array);
        Self { x, y, z, at_first, touching, interior }
    }

    /// `reach` is the distance of the best projection inside a triangle so far.
    #[inline]
    fn dismiss(&self, local: [i32; 3], reach: f32) -> bool {
        let [x, y, z] = local.map(|i| i as f32);
        let values = self.x * x + self.y * y + self.z * z + self.at_first;
        let limits = if reach < f32::INFINITY {
            self.interior + Vec4::new(reach, 0.0, 0.0, 0.0)
        } else {
            self.touching
        };
        values.cmpgt(limits).any() || values.x < -limits.x
    }
}
