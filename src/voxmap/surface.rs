//! Which voxels does the surface touch? Two navigations through a triangle's candidates, one test.
//!
//! # Source
//! Sagardia2008, section 3.1. Both navigations walk columns of voxels: per slab of the first axis the triangle is clipped, its
//! extent on the second axis gives the columns, and the plane of the triangle over a column's four corners gives the span on
//! the third axis. *Plane-span* tests every voxel of the span; *two-sided* tests inward from both ends up to the first hit and
//! takes everything between (a column meets a convex triangle in one run, see [`TriangleSat`]). We deviate in the third axis:
//! the dominant axis of the normal instead of always z, so that the plane is never steeper than 45°.

use std::sync::atomic::{AtomicUsize, Ordering};

use glam::DVec3;
use rayon::prelude::*;

use super::grid::{BRICK_EDGE, Grid};
use super::sat::TriangleSat;
use crate::mesh::TriangleMesh;

/// One bit per cell of a brick: word x, bit y·8 + z.
pub type Mask = [u64; BRICK_EDGE];

/// How the candidates of a triangle are walked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Navigation {
    /// First approach of the paper: test every voxel of the span over each column.
    PlaneSpan,
    /// Second approach: test from both ends of the span inward, mark what lies between the first hits.
    TwoSided,
    /// Every voxel of the triangle's box: slow, the reference for tests.
    BruteForce,
}

impl Navigation {
    /// The name on the command line and in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::PlaneSpan => "plane-span",
            Self::TwoSided => "two-sided",
            Self::BruteForce => "brute-force",
        }
    }

    /// The choice of `auto`: spans are short unless triangles are much larger than voxels, and a span of up to two voxels costs
    /// the same either way, so the box diagonal of the mean triangle decides.
    ///
    /// The paper gives crossovers in voxels for three models and leaves the rule open; ours is by the ratio that they share,
    /// the edge of the mean triangle over the voxel edge.
    pub fn choose(mesh: &TriangleMesh, grid: &Grid) -> Self {
        let n = mesh.triangles.len().max(1);
        let stride = n.div_ceil(4096);
        let (mut sum, mut count) = (0.0, 0_u32);
        for triangle_idx in (0..n.min(mesh.triangles.len())).step_by(stride) {
            let [a, b, c] = mesh.corners(triangle_idx);
            sum += (b - a).cross(c - a).length();
            count += 1;
        }
        let mean_edge_in_voxels = (sum / f64::from(count.max(1))).sqrt() / grid.voxel_size_m;
        if mean_edge_in_voxels > 8.0 { Self::TwoSided } else { Self::PlaneSpan }
    }
}

/// The voxels that the surface touches, sparse.
#[derive(Debug)]
pub struct Surface {
    /// The grid.
    pub grid: Grid,
    /// `[n_bricks of the grid]`: slot in `bricks` and `masks`, or [`Surface::NO_SLOT`].
    slots: Vec<u32>,
    /// `[n_slots]`, ascending: number of the brick in the grid.
    pub bricks: Vec<u32>,
    /// `[n_slots]`: surface cells of the brick.
    pub masks: Vec<Mask>,
    /// `[n_slots]`: surface voxels in all slots before this one.
    ranks: Vec<u32>,
    /// Surface voxels.
    pub n_voxels: usize,
    /// SAT tests that the navigation spent.
    pub sat_tests: u64,
    /// How the candidates were walked.
    pub navigation: Navigation,
}

impl Surface {
    /// Slot of a brick that holds no surface.
    pub const NO_SLOT: u32 = u32::MAX;

    /// Marks every voxel that a triangle of `mesh` touches.
    ///
    /// Runs on the current rayon pool; the result does not depend on the number of threads (marks are combined by OR, slots
    /// are numbered in grid order). Cost: O(surface voxels · s⁻²) tests, one top grid of 4 bytes per brick and thread.
    pub fn mark(mesh: &TriangleMesh, grid: &Grid, navigation: Navigation) -> Self {
        struct Local {
            slots: Vec<u32>,
            bricks: Vec<u32>,
            masks: Vec<Mask>,
            sat_tests: u64,
        }
        const CHUNK: usize = 256;
        let next_chunk = AtomicUsize::new(0);
        let locals: Vec<Local> = (0..rayon::current_num_threads())
            .into_par_iter()
            .map(|_| {
                let mut local =
                    Local { slots: vec![Self::NO_SLOT; grid.n_bricks()], bricks: Vec::new(), masks: Vec::new(), sat_tests: 0 };
                loop {
                    // Relaxed: the counter only hands out work; results meet at the join.
                    let first = next_chunk.fetch_add(1, Ordering::Relaxed) * CHUNK;
                    if first >= mesh.triangles.len() {
                        return local;
                    }
                    for triangle_idx in first..(first + CHUNK).min(mesh.triangles.len()) {
                        let corners = mesh.corners(triangle_idx).map(|corner| grid.to_cells(corner));
                        let (slots, bricks, masks) = (&mut local.slots, &mut local.bricks, &mut local.masks);
                        local.sat_tests += visit_hits(&corners, grid.dims, navigation, |cell| {
                            let (brick, inside) = grid.locate(cell);
                            if slots[brick] == Self::NO_SLOT {
                                slots[brick] = bricks.len() as u32;
                                bricks.push(brick as u32);
                                masks.push([0; BRICK_EDGE]);
                            }
                            masks[slots[brick] as usize][inside >> 6] |= 1 << (inside & 63);
                        });
                    }
                }
            })
            .collect();

        let mut bricks: Vec<u32> = locals.iter().flat_map(|local| &local.bricks).copied().collect();
        bricks.par_sort_unstable();
        bricks.dedup();
        let mut slots = vec![Self::NO_SLOT; grid.n_bricks()];
        let mut masks = vec![[0; BRICK_EDGE]; bricks.len()];
        for (slot, brick) in bricks.iter().enumerate() {
            slots[*brick as usize] = slot as u32;
            for local in &locals {
                if local.slots[*brick as usize] != Self::NO_SLOT {
                    let other = &local.masks[local.slots[*brick as usize] as usize];
                    masks[slot].iter_mut().zip(other).for_each(|(word, more)| *word |= more);
                }
            }
        }
        let mut n_voxels = 0;
        let mut ranks = Vec::with_capacity(masks.len());
        for mask in &masks {
            ranks.push(n_voxels as u32);
            n_voxels += mask.iter().map(|word| word.count_ones() as usize).sum::<usize>();
        }
        let sat_tests = locals.iter().map(|local| local.sat_tests).sum();
        Self { grid: *grid, slots, bricks, masks, ranks, n_voxels, sat_tests, navigation }
    }

    /// Slot of a brick, or `None` where it holds no surface.
    pub fn slot(&self, brick: usize) -> Option<usize> {
        let slot = self.slots[brick];
        (slot != Self::NO_SLOT).then_some(slot as usize)
    }

    /// True for a surface voxel; false outside the grid.
    pub fn contains(&self, cell: [i32; 3]) -> bool {
        self.rank(cell).is_some()
    }

    /// Position of a surface voxel in the order of [`Self::cells`]; `None` for any other cell.
    pub fn rank(&self, cell: [i32; 3]) -> Option<usize> {
        if !self.grid.contains(cell) {
            return None;
        }
        let (brick, inside) = self.grid.locate(cell);
        let slot = self.slot(brick)?;
        let mask = &self.masks[slot];
        let (word, bit) = (inside >> 6, inside & 63);
        if mask[word] >> bit & 1 == 0 {
            return None;
        }
        let before: u32 = mask[..word].iter().map(|word| word.count_ones()).sum();
        let within = (mask[word] & ((1 << bit) - 1)).count_ones();
        Some((self.ranks[slot] + before + within) as usize)
    }

    /// Every surface voxel, in order of rank.
    pub fn cells(&self) -> impl Iterator<Item = [i32; 3]> + '_ {
        self.bricks.iter().zip(&self.masks).flat_map(|(brick, mask)| {
            let origin = super::grid::brick_origin(self.grid.brick_coord(*brick as usize));
            mask.iter().enumerate().flat_map(move |(x, word)| {
                bits(*word).map(move |bit| [origin[0] + x as i32, origin[1] + (bit >> 3) as i32, origin[2] + (bit & 7) as i32])
            })
        })
    }

    /// Calls `visit(triangle_idx, prepared, cell, rank)` for every touching pair of triangle and voxel, in parallel over triangles;
    /// `prepare` sees the corners in cell coordinates once per triangle.
    pub fn for_each_hit<P>(
        &self,
        mesh: &TriangleMesh,
        prepare: impl Fn(&[DVec3; 3]) -> P + Sync,
        visit: impl Fn(u32, &P, [i32; 3], usize) + Sync,
    ) {
        (0..mesh.triangles.len()).into_par_iter().with_min_len(64).for_each(|triangle_idx| {
            let corners = mesh.corners(triangle_idx).map(|corner| self.grid.to_cells(corner));
            let prepared = prepare(&corners);
            visit_hits(&corners, self.grid.dims, self.navigation, |cell| {
                if let Some(rank) = self.rank(cell) {
                    visit(triangle_idx as u32, &prepared, cell, rank);
                }
            });
        });
    }
}

/// Numbers of the set bits, ascending.
pub(crate) fn bits(word: u64) -> impl Iterator<Item = u32> {
    let mut rest = word;
    core::iter::from_fn(move || {
        (rest != 0).then(|| {
            let bit = rest.trailing_zeros();
            rest &= rest - 1;
            bit
        })
    })
}

/// Calls `visit` once for every voxel that the triangle touches; returns the number of SAT tests.
///
/// `corners` in cell coordinates. Candidate ranges are closed intervals (touching counts) widened by a rounding allowance, so
/// the set of hits is that of [`TriangleSat::hits`] over the whole grid, whatever the navigation.
pub fn visit_hits(corners: &[DVec3; 3], dims: [u32; 3], navigation: Navigation, mut visit: impl FnMut([i32; 3])) -> u64 {
    let sat = TriangleSat::new(corners);
    let (low, high) = sat.bounds;
    let mut tests = 0;
    if navigation == Navigation::BruteForce {
        // A cell more than needed on every side: the reference must not share the candidate ranges that it checks.
        let around = |low: f64, high: f64, n_cells: u32| (low as i32 - 2).max(0)..=(high as i32 + 2).min(n_cells as i32 - 1);
        for x in around(low.x, high.x, dims[0]) {
            for y in around(low.y, high.y, dims[1]) {
                for z in around(low.z, high.z, dims[2]) {
                    tests += 1;
                    if sat.hits([x, y, z]) {
                        visit([x, y, z]);
                    }
                }
            }
        }
        return tests;
    }

    // Columns run along the dominant axis of the normal: there the plane is at most 45° steep.
    let normal = sat.normal;
    let steepness = normal.abs();
    let column_axis = if steepness.z >= steepness.x && steepness.z >= steepness.y {
        2
    } else if steepness.y >= steepness.x {
        1
    } else {
        0
    };
    let (u_axis, v_axis) = ((column_axis + 1) % 3, (column_axis + 2) % 3);
    let span = PlaneSpan::new(corners, normal, [u_axis, v_axis, column_axis], high - low);

    for u in closed_range(low[u_axis], high[u_axis], dims[u_axis]) {
        let Some((v_low, v_high)) = slab_extent(corners, u_axis, v_axis, f64::from(u)) else { continue };
        for v in closed_range(v_low, v_high, dims[v_axis]) {
            let (w_low, w_high) = span.over_column(f64::from(u), f64::from(v));
            let column = closed_range(w_low.max(low[column_axis]), w_high.min(high[column_axis]), dims[column_axis]);
            let cell_at = |w: i32| {
                let mut cell = [0; 3];
                (cell[u_axis], cell[v_axis], cell[column_axis]) = (u, v, w);
                cell
            };
            let mut hits = |w: i32| {
                tests += 1;
                sat.hits(cell_at(w))
            };
            if navigation == Navigation::TwoSided {
                let Some(first) = column.clone().find(|w| hits(*w)) else { continue };
                let last = (first + 1..=*column.end()).rev().find(|w| hits(*w)).unwrap_or(first);
                (first..=last).for_each(|w| visit(cell_at(w)));
            } else {
                column.filter(|w| hits(*w)).for_each(|w| visit(cell_at(w)));
            }
        }
    }
    tests
}

/// Allowance for rounding in candidate ranges, cells. Coordinates stay below 2¹⁵, so 10⁻⁹ is a thousand times their rounding;
/// it only adds candidates, never hits.
const ROUNDING_CELLS: f64 = 1e-9;

/// Cells whose closed extent meets the closed interval `[low, high]`, clamped to the grid.
fn closed_range(low: f64, high: f64, n_cells: u32) -> core::ops::RangeInclusive<i32> {
    let first = (low - ROUNDING_CELLS).ceil() as i32 - 1;
    let last = (high + ROUNDING_CELLS).floor() as i32;
    first.max(0)..=last.min(n_cells as i32 - 1)
}

/// Extent on `v_axis` of the part of the triangle inside the slab `[u, u + 1]`; `None` when no part is.
fn slab_extent(corners: &[DVec3; 3], u_axis: usize, v_axis: usize, u: f64) -> Option<(f64, f64)> {
    let (slab_low, slab_high) = (u - ROUNDING_CELLS, u + 1.0 + ROUNDING_CELLS);
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    let mut include = |v: f64| {
        low = low.min(v);
        high = high.max(v);
    };
    for (corner_idx, from) in corners.iter().enumerate() {
        let to = corners[(corner_idx + 1) % 3];
        if from[u_axis] >= slab_low && from[u_axis] <= slab_high {
            include(from[v_axis]);
        }
        let rise = to[u_axis] - from[u_axis];
        for plane in [slab_low, slab_high] {
            let along = (plane - from[u_axis]) / rise;
            if along > 0.0 && along < 1.0 {
                include(from[v_axis] + along * (to[v_axis] - from[v_axis]));
            }
        }
    }
    (low <= high).then_some((low, high))
}

/// Height of the triangle's plane over a column, as an interval.
struct PlaneSpan {
    base: f64,
    slope_u: f64,
    slope_v: f64,
    origin_u: f64,
    origin_v: f64,
    allowance: f64,
}

impl PlaneSpan {
    fn new(corners: &[DVec3; 3], normal: DVec3, [u, v, w]: [usize; 3], extent: DVec3) -> Self {
        let origin = corners[0];
        let (e0, e1) = (corners[1] - origin, corners[2] - origin);
        // Rounding of the cross product tilts the plane of a sliver; where the tilt is not negligible the span is unbounded and
        // the triangle's own box limits the column.
        let tilt = 16.0 * f64::EPSILON * e0.length() * e1.length() / normal[w].abs();
        let error = tilt * (extent.element_sum() + 2.0);
        let allowance = if error < 1e-3 { ROUNDING_CELLS + error } else { f64::INFINITY };
        let (slope_u, slope_v) = if allowance.is_finite() { (-normal[u] / normal[w], -normal[v] / normal[w]) } else { (0.0, 0.0) };
        Self { base: origin[w], slope_u, slope_v, origin_u: origin[u], origin_v: origin[v], allowance }
    }

    fn over_column(&self, u: f64, v: f64) -> (f64, f64) {
        let at_corner = self.base + self.slope_u * (u - self.origin_u) + self.slope_v * (v - self.origin_v);
        let low = at_corner + self.slope_u.min(0.0) + self.slope_v.min(0.0);
        let high = at_corner + self.slope_u.max(0.0) + self.slope_v.max(0.0);
        (low - self.allowance, high + self.allowance)
    }
}
