//! Which triangles may touch a brick? A counting sort of triangles by the surface bricks that they
//! pass through.

use core::ops::Range;
use core::sync::atomic::{AtomicU32, Ordering};

use glam::DVec3;

use crate::mesh::TriangleMesh;
use crate::parallel;
use crate::voxmap::grid::BRICK_EDGE;
use crate::voxmap::surface::Surface;

/// Triangles by brick of the surface: a superset of those that touch one of its voxels.
pub(super) struct Bins {
    /// `[n_slots + 1]`: where the triangles of each slot start.
    firsts: Vec<usize>,
    /// `[n_pairs]`, in no order within a slot: atomic because any thread writes anywhere, once.
    triangles: Vec<AtomicU32>,
}

impl Bins {
    /// Sorts the triangles. Runs on the current rayon pool. Cost: two passes over pairs of triangle
    /// and brick; 4 bytes per pair.
    pub(super) fn sort(mesh: &TriangleMesh, surface: &Surface) -> Self {
        let for_each_pair = |visit: &(dyn Fn(u32, usize) + Sync)| {
            parallel::for_each_range(mesh.triangles.len(), 256, &|range| {
                range.for_each(|triangle_idx| {
                    let corners =
                        mesh.corners(triangle_idx).map(|corner| surface.grid.to_cells(corner));
                    for_each_brick(&corners, surface.grid.brick_dims(), |brick| {
                        if let Some(slot) = surface.slot(surface.grid.brick_index(brick)) {
                            visit(triangle_idx as u32, slot);
                        }
                    });
                })
            });
        };
        // Relaxed throughout: the joins publish what the passes wrote.
        let counts: Vec<AtomicU32> = surface.bricks.iter().map(|_| AtomicU32::new(0)).collect();
        for_each_pair(&|_, slot| {
            counts[slot].fetch_add(1, Ordering::Relaxed);
        });
        let mut n_pairs = 0;
        let mut firsts = Vec::with_capacity(counts.len() + 1);
        firsts.push(0);
        for count in &counts {
            n_pairs += count.load(Ordering::Relaxed) as usize;
            firsts.push(n_pairs);
        }
        let triangles: Vec<AtomicU32> = (0..n_pairs).map(|_| AtomicU32::new(0)).collect();
        // What is still to come of each slot: filled from the back.
        for_each_pair(&|triangle_idx, slot| {
            let rest = counts[slot].fetch_sub(1, Ordering::Relaxed) as usize;
            triangles[firsts[slot] + rest - 1].store(triangle_idx, Ordering::Relaxed);
        });
        Self { firsts, triangles }
    }

    /// Triangles that may touch the brick in a slot, in no order.
    pub(super) fn triangles(&self, slot: usize) -> impl Iterator<Item = u32> + '_ {
        self.triangles[self.firsts[slot]..self.firsts[slot + 1]]
            .iter()
            .map(|triangle| triangle.load(Ordering::Relaxed))
    }
}

/// Bricks that may hold a voxel touched by the triangle: those of its box, less those that a plane
/// through it separates.
fn for_each_brick(corners: &[DVec3; 3], brick_dims: [u32; 3], mut visit: impl FnMut([u32; 3])) {
    let edge = BRICK_EDGE as i32;
    let [x, y, z] = [0, 1, 2].map(|axis| {
        let (low, high) = cell_range(corners, axis);
        (low.max(0) / edge) as u32..(high / edge + 1).clamp(0, brick_dims[axis] as i32) as u32
    });
    if [&x, &y, &z].iter().any(|range| range.len() > 2) {
        return for_each_brick_of_large(corners, [x, y, z], visit);
    }
    for x in x {
        for y in y.clone() {
            z.clone().for_each(|z| visit([x, y, z]));
        }
    }
}

/// By itself: where it stood in the loops above, the compiler multiplied slabs that were not there
/// by what memory held, which takes hundreds of cycles where it is no normal number (bunny, 200
/// voxels: 86 ms of a bake).
#[inline(never)]
fn for_each_brick_of_large(
    corners: &[DVec3; 3],
    [x, y, z]: [Range<u32>; 3],
    mut visit: impl FnMut([u32; 3]),
) {
    let separators = Separators::new(corners);
    for x in x {
        for y in y.clone() {
            for z in separators.column(x, y, z.clone()) {
                if !separators.separates([x, y, z]) {
                    visit([x, y, z]);
                }
            }
        }
    }
}

/// Slabs that hold a large triangle: that of its plane, and one along each edge.
struct Separators([SharedSlice; 4]);

/// A triangle lies between `low` and `high` along `axis`, both widened by half a brick.
struct SharedSlice {
    axis: DVec3,
    low: f64,
    high: f64,
}

/// Half a brick and far more than rounding, cells.
const HALF_BRICK_CELLS: f64 = 0.5 * BRICK_EDGE as f64 + 1e-5;

impl Separators {
    fn new(corners: &[DVec3; 3]) -> Self {
        let edges = [corners[1] - corners[0], corners[2] - corners[1], corners[0] - corners[2]];
        let normal = edges[0].cross(edges[1]).normalize_or_zero();
        // Any axis separates rightly, whatever rounding did to it, because the corners are measured
        // along it too.
        Self([normal, normal.cross(edges[0]), normal.cross(edges[1]), normal.cross(edges[2])].map(
            |axis| {
                let axis = axis.normalize_or_zero();
                let along = corners.map(|corner| axis.dot(corner));
                let half_width = HALF_BRICK_CELLS * axis.abs().element_sum();
                SharedSlice {
                    axis,
                    low: along[0].min(along[1]).min(along[2]) - half_width,
                    high: along[0].max(along[1]).max(along[2]) + half_width,
                }
            },
        ))
    }

    fn separates(&self, brick: [u32; 3]) -> bool {
        let center = center_cells(brick);
        self.0.iter().any(|SharedSlice { axis, low, high }| {
            let along = axis.dot(center);
            along < *low || along > *high
        })
    }

    /// Bricks of a column along z between which the triangle's plane lies.
    fn column(&self, x: u32, y: u32, z: core::ops::Range<u32>) -> core::ops::Range<u32> {
        let SharedSlice { axis, low, high } = &self.0[0];
        // A steeper plane runs along the column: the other tests are enough.
        if axis.z.abs() < 0.1 {
            return z;
        }
        let base = axis.dot(center_cells([x, y, 0]));
        let per_brick = axis.z * BRICK_EDGE as f64;
        let [first, last] = if per_brick > 0.0 { [low, high] } else { [high, low] }
            .map(|bound| (bound - base) / per_brick);
        z.start.max(first.floor().max(0.0) as u32)..z.end.min((last.ceil() + 1.0).max(0.0) as u32)
    }
}

fn center_cells(brick: [u32; 3]) -> DVec3 {
    (DVec3::new(brick[0].into(), brick[1].into(), brick[2].into()) + 0.5) * BRICK_EDGE as f64
}

/// First and last cell on an axis whose closed extent meets the triangle's: exactly the box part of
/// the touch test.
pub(super) fn cell_range(corners: &[DVec3; 3], axis: usize) -> (i32, i32) {
    let [a, b, c] = [corners[0][axis], corners[1][axis], corners[2][axis]];
    (a.min(b).min(c).ceil() as i32 - 1, a.max(b).max(c).floor() as i32)
}
