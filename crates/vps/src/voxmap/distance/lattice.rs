//! Nearest patches on a coarse lattice, from which the cells between take their choice.
//!
//! Every fourth cell per axis is searched exactly; every second takes the choices of those around it and walks on. A cell is never
//! more than one cell away from lattice points on all sides of it, so both of two surfaces between which it lies are on offer:
//! that is what growing outward from the surface cannot promise, for what is fewest steps away need not be nearest.

use super::group::Group;
use super::kernel::Cube;
use super::patches::{NONE, Patches};
use super::tree::PatchTree;
use crate::parallel;
use crate::simd::SimdLevel;
use crate::voxmap::grid::{BRICK_EDGE, brick_origin};
use crate::voxmap::layers::{DEEP_INSIDE, FAR_OUTSIDE, Layers};

/// From one point of the finer lattice to the next, cells.
const HALF: i32 = 2;
/// The same on the coarser.
const QUARTER: i32 = 4;
/// Bricks that are searched one after the other, so that what one finds does not depend on the number of threads.
const SEARCHED_TOGETHER: usize = 32;
/// Patches per surface voxel above which a search costs little more than a walk, and finds what a walk may miss: on the hollow side
/// of a fine mesh many patches are all but equally far.
const PATCHES_PER_VOXEL: usize = 3;
/// Points of the finer lattice on a brick's edge.
const HALF_EDGE: usize = BRICK_EDGE / HALF as usize;

/// Nearest patch of every second cell per axis.
pub(super) struct Lattice<'a> {
    tree: PatchTree<'a>,
    /// Every group is searched, none walks.
    searches_all: bool,
    /// `[n_slots][4³]`, z fastest.
    half: Vec<[u32; HALF_EDGE * HALF_EDGE * HALF_EDGE]>,
    /// `[n_slots]`: slots of the brick and of those after it, indexed x·4 + y·2 + z; [`FAR_OUTSIDE`] where none is stored.
    after: Vec<[u32; 8]>,
}

impl<'a> Lattice<'a> {
    /// Cost: one exact search and eight walks of a group per brick of the band.
    pub(super) fn new(patches: &'a Patches, layers: &Layers, n_surface_voxels: usize, simd_level: SimdLevel) -> Self {
        let grid = &layers.grid;
        let n_slots = layers.bricks.len();
        let after = parallel::map(n_slots, 64, |slot| bricks_after(layers, layers.bricks[slot]));
        let tree = PatchTree::new(&patches.all, simd_level);
        let searches_all = patches.all.len() > PATCHES_PER_VOXEL * n_surface_voxels;
        let runs: Vec<_> = layers.bricks.chunks(SEARCHED_TOGETHER).collect();
        let quarter = parallel::map_with(
            runs.len(),
            1,
            || Group::new(simd_level),
            |group, run| {
                let mut before = [NONE; 8];
                let search = |brick: &u32| {
                    let base = brick_origin(grid.brick_coord(*brick as usize));
                    group.restart(Cube { base, step: QUARTER }, u8::MAX);
                    // The patches of the brick before are near, or at least a bound.
                    before.iter().for_each(|patch_idx| group.consider(*patch_idx));
                    group.settle(patches);
                    tree.search(group);
                    before = group.nearest.patch_idx;
                    before
                };
                runs[run].iter().map(search).collect::<Vec<_>>()
            },
        )
        .concat();
        let half = parallel::map_with(
            n_slots,
            16,
            || Group::new(simd_level),
            |group, slot| {
                let origin = brick_origin(grid.brick_coord(layers.bricks[slot] as usize));
                let mut half = [NONE; HALF_EDGE * HALF_EDGE * HALF_EDGE];
                let around = Block::<3, 27>::gather(&after[slot], |slot| &quarter[slot]);
                around.each_cube(|[x, y, z], corners| {
                    let first = [0, 1, 2].map(|axis| origin[axis] + QUARTER * [x, y, z][axis] as i32);
                    group.restart(Cube { base: first, step: HALF }, u8::MAX);
                    corners.iter().for_each(|patch_idx| group.consider(*patch_idx));
                    group.settle(patches);
                    for (lane, patch_idx) in group.nearest.patch_idx.iter().enumerate() {
                        half[((2 * x + (lane >> 2)) * HALF_EDGE + 2 * y + (lane >> 1 & 1)) * HALF_EDGE + 2 * z + (lane & 1)] =
                            *patch_idx;
                    }
                });
                half
            },
        );
        Self { tree, searches_all, half, after }
    }

    /// Finds the nearest patches of a group that has considered those on offer: walks, and searches where that is asked for or the walk
    /// did not get to its end.
    pub(super) fn settle(&self, group: &mut Group, patches: &Patches) {
        if !group.settle(patches) || self.searches_all {
            group.only_wanted();
            self.tree.search(group);
        }
    }

    /// Calls `visit(cube, candidates)` for every cube of 2³ cells of a brick, which begins at cell 2·`cube` of the brick: the patches
    /// of the lattice points around it, [`NONE`] where there is no point.
    pub(super) fn each_cube(&self, slot: usize, visit: impl FnMut([usize; 3], [u32; 8])) {
        Block::<{ HALF_EDGE + 1 }, 125>::gather(&self.after[slot], |slot| &self.half[slot]).each_cube(visit);
    }
}

/// Slots of a brick and of the seven after it.
fn bricks_after(layers: &Layers, brick: u32) -> [u32; 8] {
    let coord = layers.grid.brick_coord(brick as usize);
    core::array::from_fn(|idx| {
        let offset = [idx as i32 >> 2, idx as i32 >> 1 & 1, idx as i32 & 1];
        let entry = layers.grid.brick_neighbour(coord, offset).map_or(FAR_OUTSIDE, |neighbour| layers.top[neighbour]);
        if entry < DEEP_INSIDE { entry } else { FAR_OUTSIDE }
    })
}

/// Lattice points of a brick and the first of those after it, `EDGE` on an edge, `POINTS` in all.
struct Block<const EDGE: usize, const POINTS: usize>([u32; POINTS]);

impl<const EDGE: usize, const POINTS: usize> Block<EDGE, POINTS> {
    fn gather<'a, const OWN: usize>(after: &[u32; 8], points: impl Fn(usize) -> &'a [u32; OWN]) -> Self {
        let own = EDGE - 1;
        let bricks = after.map(|slot| (slot != FAR_OUTSIDE).then(|| points(slot as usize)));
        let mut block = Self([NONE; POINTS]);
        for x in 0..EDGE {
            for y in 0..EDGE {
                let row = (x * EDGE + y) * EDGE;
                let brick = x / own * 4 + y / own * 2;
                let there = (x % own * own + y % own) * own;
                if let Some(points) = bricks[brick] {
                    block.0[row..row + own].copy_from_slice(&points[there..there + own]);
                }
                if let Some(points) = bricks[brick + 1] {
                    block.0[row + own] = points[there];
                }
            }
        }
        block
    }

    /// Calls `visit(cube, corners)` for every cube of eight lattice points that begins in the brick.
    fn each_cube(&self, mut visit: impl FnMut([usize; 3], [u32; 8])) {
        for x in 0..EDGE - 1 {
            for y in 0..EDGE - 1 {
                for z in 0..EDGE - 1 {
                    let at = |corner: usize| self.0[((x + (corner >> 2)) * EDGE + y + (corner >> 1 & 1)) * EDGE + z + (corner & 1)];
                    visit([x, y, z], core::array::from_fn(at));
                }
            }
        }
    }
}
