//! The surface voxels: every triangle that is near one is measured, which also tells on which side
//! of the surface the centre lies.

use core::sync::atomic::{AtomicU32, Ordering};

use super::kernel::WidePatch;
use super::patches::{NONE, Patch, Patches};
use crate::parallel;
use crate::simd::{F32x8, Kernel, LANES, SimdLevel};
use crate::voxmap::grid::{BRICK_CELLS, BRICK_EDGE, brick_origin};
use crate::voxmap::surface::{Mask, Surface, bits};

/// Below this distance a centre counts as lying on the surface, where an offset has no direction;
/// cells.
pub(super) const ON_SURFACE_CELLS: f32 = 1e-6;

/// A triangle that touches a voxel comes at least this close to its centre (√3/2), and the nearest
/// does; cells.
const REACH_CELLS: f32 = 0.8661;
/// Distances that differ by no more count as equal: the closest point lies on an edge or corner
/// that the triangles have in common. Twice what each may be rounded by; cells.
const TIE_CELLS: f32 = 2e-5;
/// A triangle this thin has no normal but rounding: the faces beside it, which are no farther than
/// it is thin, know the side; cells.
const NO_NORMAL_CELLS: f32 = 1e-3;
/// By so much more squarely must a centre face the plane of a triangle to prefer it to one that
/// ties, cells.
const FACING_CELLS: f32 = 1e-4;

/// Which patches come near the surface voxels of which brick.
struct Bins {
    /// `[n_surface_slots + 1]`.
    starts: Vec<u32>,
    patches: Vec<u32>,
}

impl Bins {
    /// Cost: O(patches), a brick or four each.
    fn new(patches: &Patches, surface: &Surface) -> Self {
        let counts: Vec<AtomicU32> = surface.bricks.iter().map(|_| AtomicU32::new(0)).collect();
        let each = |visit: &(dyn Fn(usize, u32) + Sync)| {
            parallel::for_each_range(patches.all.len(), 256, &|range| {
                range.for_each(|patch_idx| {
                    each_brick(&patches.all[patch_idx], surface, |slot| {
                        visit(slot, patch_idx as u32)
                    })
                });
            });
        };
        // Relaxed, here and below: counters need no order among each other; the joins publish them.
        each(&|slot, _| {
            counts[slot].fetch_add(1, Ordering::Relaxed);
        });
        let mut starts = Vec::with_capacity(counts.len() + 1);
        let mut total = 0;
        for count in &counts {
            starts.push(total);
            // A wrap would mix up bricks; 2³² pairs would be 16 GiB of them.
            total = u32::checked_add(total, count.swap(0, Ordering::Relaxed))
                .expect("fewer than 2^32 pairs of triangle and brick");
        }
        starts.push(total);
        let filled: Vec<AtomicU32> = (0..total).map(|_| AtomicU32::new(NONE)).collect();
        each(&|slot, patch_idx| {
            let place = starts[slot] + counts[slot].fetch_add(1, Ordering::Relaxed);
            filled[place as usize].store(patch_idx, Ordering::Relaxed);
        });
        Self { starts, patches: filled.into_iter().map(AtomicU32::into_inner).collect() }
    }

    /// Patches near a brick, ascending: the order in which threads came does not show.
    fn sorted(&self, surface_slot: usize) -> Vec<u32> {
        let mut near = self.patches
            [self.starts[surface_slot] as usize..self.starts[surface_slot + 1] as usize]
            .to_vec();
        near.sort_unstable();
        near
    }
}

/// Calls `visit(surface_slot)` for the bricks that a patch may come near.
fn each_brick(patch: &Patch, surface: &Surface, mut visit: impl FnMut(usize)) {
    let dims = surface.grid.brick_dims();
    let edge = BRICK_EDGE as i32;
    let cells = patch.cells_near(REACH_CELLS);
    let [xs, ys, zs] = [0, 1, 2].map(|axis| {
        let low = cells[axis].start().div_euclid(edge);
        let high = cells[axis].end().div_euclid(edge);
        low.max(0)..=high.min(dims[axis] as i32 - 1)
    });
    let is_one = xs.start() == xs.end() && ys.start() == ys.end() && zs.start() == zs.end();
    let reach = REACH_CELLS + 0.01 + 0.5 * (edge - 1) as f32 * patch.normal().abs().element_sum();
    for x in xs {
        for y in ys.clone() {
            for z in zs.clone() {
                let Some(slot) =
                    surface.slot(surface.grid.brick_index([x as u32, y as u32, z as u32]))
                else {
                    continue;
                };
                let middle =
                    glam::IVec3::new(x, y, z).as_vec3() * edge as f32 + 0.5 * (edge - 1) as f32;
                if is_one || patch.height_of(middle).abs() <= reach {
                    visit(slot);
                }
            }
        }
    }
}

/// What the surface voxels found.
pub(super) struct Near {
    /// Of [`MEASURED_TOGETHER`] bricks each, in order of rank.
    bricks: Vec<Vec<NearVoxel>>,
}

/// A surface voxel and the patch nearest to its centre.
#[derive(Clone, Copy)]
pub(super) struct NearVoxel {
    /// [`NONE`] where nothing came near.
    pub(super) patch_idx: u32,
    /// Distance to it, cells, 0 without one; negative outside, as if the surface had an inside.
    pub(super) signed_cells: f32,
}

/// Bricks that share a list.
const MEASURED_TOGETHER: usize = 64;

impl Near {
    /// Measures all surface voxels. `outward`: 1 for a patch whose winding normal points out, −1
    /// for one where it points in.
    ///
    /// Cost: O(pairs of a patch and a surface voxel near it).
    pub(super) fn new(
        simd_level: SimdLevel,
        patches: &Patches,
        surface: &Surface,
        outward: impl Fn(u32) -> f32 + Sync,
    ) -> Self {
        let bins = Bins::new(patches, surface);
        let slots: Vec<usize> = (0..surface.bricks.len()).collect();
        let list = |slots: &[usize]| {
            simd_level.run(NearBricks { patches, bins: &bins, surface, slots, outward: &outward })
        };
        Self { bricks: parallel::map_chunks(&slots, MEASURED_TOGETHER, list) }
    }

    /// The surface voxels of a brick, in order of rank.
    pub(super) fn voxels(&self, surface: &Surface, surface_slot: usize) -> &[NearVoxel] {
        let first = (surface.ranks(surface_slot)[0]
            - surface.ranks(surface_slot - surface_slot % MEASURED_TOGETHER)[0])
            as usize;
        &self.bricks[surface_slot / MEASURED_TOGETHER]
            [first..first + n_cells(&surface.masks[surface_slot])]
    }
}

/// Measures the surface voxels of some bricks; gives them in order of rank.
struct NearBricks<'a, O> {
    patches: &'a Patches,
    bins: &'a Bins,
    surface: &'a Surface,
    slots: &'a [usize],
    outward: &'a O,
}

impl<O: Fn(u32) -> f32> Kernel for NearBricks<'_, O> {
    type Output = Vec<NearVoxel>;

    #[inline(always)]
    fn run<L: F32x8>(self) -> Self::Output {
        let Self { patches, bins, surface, slots, outward } = self;
        let mut voxels =
            Vec::with_capacity(slots.iter().map(|slot| n_cells(&surface.masks[*slot])).sum());
        for slot in slots {
            let found = Nearby::measure::<L>(patches, bins, surface, *slot, outward);
            voxels.extend(cells(&surface.masks[*slot]).map(|inside| found.voxel(inside)));
        }
        voxels
    }
}

/// The nearest patch of every surface voxel of a brick.
struct Nearby {
    patch_idx: [u32; BRICK_CELLS],
    /// Cells².
    squared: [f32; BRICK_CELLS],
    /// [`farthest_tied`] of it.
    tied: [f32; BRICK_CELLS],
    /// The patch has a normal.
    has_normal: [bool; BRICK_CELLS],
    /// Along the outward normal of the patch that the centre faces most squarely, cells. Where two
    /// faces lie on each other, inside of one is inside: parts that touch are one solid.
    height: [f32; BRICK_CELLS],
}

impl Nearby {
    /// Measures the surface voxels of one brick.
    #[inline(always)]
    fn measure<L: F32x8>(
        patches: &Patches,
        bins: &Bins,
        surface: &Surface,
        surface_slot: usize,
        outward: impl Fn(u32) -> f32,
    ) -> Self {
        let origin = brick_origin(surface.grid.brick_coord(surface.bricks[surface_slot] as usize));
        let mask = &surface.masks[surface_slot];
        let mut best = Self {
            patch_idx: [NONE; BRICK_CELLS],
            squared: [f32::INFINITY; BRICK_CELLS],
            tied: [f32::INFINITY; BRICK_CELLS],
            has_normal: [false; BRICK_CELLS],
            height: [0.0; BRICK_CELLS],
        };
        let mut cells = [0; BRICK_CELLS];
        for patch_idx in bins.sorted(surface_slot) {
            let patch = &patches.all[patch_idx as usize];
            let has_normal = patch.height() >= NO_NORMAL_CELLS;
            let outward = if has_normal { outward(patch_idx) } else { 0.0 };
            let tie_cells = TIE_CELLS + if has_normal { 0.0 } else { patch.height() };
            let n_cells = gather(patch, mask, origin, &mut cells);
            let patch = WidePatch::<L>::new(patch);
            for batch in
                cells[..n_cells.next_multiple_of(LANES)].as_chunks::<LANES>().0.iter().enumerate()
            {
                let (batch_idx, batch) = batch;
                let (all_squared, heights) = patch.measure_cells(origin, batch);
                for (lane, cell) in batch.iter().enumerate().take(n_cells - batch_idx * LANES) {
                    let cell = *cell as usize;
                    let squared = all_squared[lane];
                    let height = heights[lane] * outward;
                    let so_far = best.squared[cell];
                    if squared > best.tied[cell] {
                        continue;
                    }
                    let tied = farthest_tied(squared, tie_cells);
                    let is_tie = so_far <= tied;
                    let facing = height.abs() - best.height[cell].abs();
                    let is_square = facing > FACING_CELLS
                        || (facing >= -FACING_CELLS && height < best.height[cell]);
                    let so_far_has = best.has_normal[cell];
                    let is_better = if has_normal == so_far_has { is_square } else { has_normal };
                    if !is_tie || is_better {
                        best.patch_idx[cell] = patch_idx;
                        best.height[cell] = height;
                        best.has_normal[cell] = has_normal;
                    }
                    if squared < so_far {
                        (best.squared[cell], best.tied[cell]) = (squared, tied);
                    }
                }
            }
        }
        best
    }

    fn voxel(&self, inside: usize) -> NearVoxel {
        if self.patch_idx[inside] == NONE {
            return NearVoxel { patch_idx: NONE, signed_cells: 0.0 };
        }
        let distance = self.squared[inside].sqrt();
        let is_inside = distance > ON_SURFACE_CELLS && self.height[inside] < 0.0;
        let sign = if is_inside { 1.0 } else { -1.0 };
        NearVoxel { patch_idx: self.patch_idx[inside], signed_cells: sign * distance }
    }
}

/// The square of the largest distance that ties with one of this square, cells².
fn farthest_tied(squared: f32, tie_cells: f32) -> f32 {
    let distance = squared.sqrt() + tie_cells;
    distance * distance
}

fn n_cells(mask: &Mask) -> usize {
    mask.iter().map(|word| word.count_ones() as usize).sum()
}

/// Numbers of a mask's cells inside the brick, ascending.
pub(super) fn cells(mask: &Mask) -> impl Iterator<Item = usize> + '_ {
    mask.iter().enumerate().flat_map(|(x, word)| bits(*word).map(move |bit| x << 6 | bit as usize))
}

/// Lists the surface voxels in reach of a patch; returns how many there are.
#[inline(always)]
fn gather(patch: &Patch, mask: &Mask, origin: [i32; 3], cells: &mut [u32; BRICK_CELLS]) -> usize {
    let near = patch.cells_near(REACH_CELLS);
    let last = BRICK_EDGE as i32 - 1;
    let local = |axis: usize| {
        ((near[axis].start() - origin[axis]).max(0), (near[axis].end() - origin[axis]).min(last))
    };
    let [xs, ys, zs] = [local(0), local(1), local(2)];
    if ys.0 > ys.1 || zs.0 > zs.1 {
        return 0;
    }
    let row = (0xff_u64 >> (last - zs.1)) & (0xff << zs.0);
    let plane = (row * 0x0101_0101_0101_0101)
        & (u64::MAX >> (8 * (last - ys.1)))
        & (u64::MAX << (8 * ys.0));
    let mut n_cells = 0;
    for x in xs.0..=xs.1 {
        for bit in bits(mask[x as usize] & plane) {
            cells[n_cells] = (x as u32) << 6 | bit;
            n_cells += 1;
        }
    }
    n_cells
}
