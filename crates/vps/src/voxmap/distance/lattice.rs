//! Near patches on a coarse lattice, with which the cells between start.
//!
//! Every fourth cell per axis is searched, nearly to the end. A block of 4³ cells measures what the
//! lattice points at its corners have found, and has with that a bound on all its distances, which
//! is what an exact search needs to be short: [`PatchTree::complete`].

use super::block::{Block, CUBES};
use super::kernel::{Cube, NearestOfEight};
use super::patches::{NONE, Patches};
use super::tree::PatchTree;
use crate::parallel;
use crate::simd::{F32x8, I32s, Kernel, LANES, SimdLevel};
use crate::voxmap::grid::{Grid, brick_origin};
use crate::voxmap::layers::{DEEP_INSIDE, FAR_OUTSIDE, Layers};

/// From one lattice point to the next, cells.
const QUARTER: i32 = 4;
/// Bricks that are searched one after the other, so that what one finds does not depend on the
/// number of threads.
const SEARCHED_TOGETHER: usize = 32;
/// Share of a squared distance below which a patch is worth looking for: what the lattice has is a
/// start, and the last few per cent cost more to find than they save.
const CLOSE_SHARE: f32 = 0.7;
/// Patches per surface voxel above which each 2³ cells are searched by themselves: what may be
/// nearest to one of 4³ cells are then too many.
const PATCHES_PER_VOXEL: usize = 3;

/// A near patch of every fourth cell per axis.
pub(super) struct DistanceLattice<'a> {
    tree: PatchTree<'a>,
    /// Every block is searched, none walks.
    searches_all: bool,
    /// `[n_slots][2³]`, z fastest.
    points: Vec<[u32; LANES]>,
    /// `[n_slots]`: slots of the brick and of those after it, indexed x·4 + y·2 + z;
    /// [`FAR_OUTSIDE`] where none is stored.
    after: Vec<[u32; 8]>,
}

impl<'a> DistanceLattice<'a> {
    /// Cost: one search of eight points per brick of the band.
    pub(super) fn new(
        patches: &'a Patches,
        layers: &Layers,
        n_surface_voxels: usize,
        simd_level: SimdLevel,
    ) -> Self {
        let grid = &layers.grid;
        let n_slots = layers.bricks.len();
        let after = parallel::map(n_slots, 64, |slot| bricks_after(layers, layers.bricks[slot]));
        let tree = PatchTree::new(&patches.all);
        let searches_all = patches.all.len() > PATCHES_PER_VOXEL * n_surface_voxels;
        let runs: Vec<_> = layers.bricks.chunks(SEARCHED_TOGETHER).collect();
        let points = parallel::map(runs.len(), 1, |run| {
            simd_level.run(Search { patches, tree: &tree, grid, bricks: runs[run] })
        })
        .concat();
        Self { tree, searches_all, points, after }
    }

    /// Finds the nearest patches of all cells of a brick whose blocks have measured those on offer.
    #[inline(always)]
    pub(super) fn complete<L: F32x8>(&self, blocks: &mut [Block<L>; LANES]) {
        if !self.searches_all {
            self.tree.complete(blocks);
            return;
        }
        for block in blocks.iter_mut().filter(|block| block.is_wanted()) {
            for cube in 0..CUBES {
                block.only_wanted(cube);
                self.tree.search(block.cube(cube), 1.0, &mut block.nearest[cube]);
            }
        }
    }

    /// The lattice points of a brick and the first of those after it, 3³; [`NONE`] where there is
    /// no point.
    pub(super) fn points(&self, slot: usize) -> LatticePoints {
        let bricks =
            self.after[slot].map(|slot| (slot != FAR_OUTSIDE).then(|| &self.points[slot as usize]));
        LatticePoints(core::array::from_fn(|point| {
            let [x, y, z] = [point / 9, point / 3 % 3, point % 3];
            bricks[x / 2 * 4 + y / 2 * 2 + z / 2]
                .map_or(NONE, |points| points[x % 2 * 4 + y % 2 * 2 + z % 2])
        }))
    }
}

/// The lattice points in some bricks, searched one brick after the other.
struct Search<'a> {
    patches: &'a Patches,
    tree: &'a PatchTree<'a>,
    grid: &'a Grid,
    bricks: &'a [u32],
}

impl Kernel for Search<'_> {
    type Output = Vec<[u32; LANES]>;

    #[inline(always)]
    fn run<L: F32x8>(self) -> Self::Output {
        let mut found = Vec::with_capacity(self.bricks.len());
        let mut before = [NONE; LANES];
        for brick in self.bricks {
            let base = brick_origin(self.grid.brick_coord(*brick as usize));
            let cube = Cube { base, step: QUARTER };
            let mut nearest = NearestOfEight::<L>::none();
            // The patches of the brick before are near, or at least a bound.
            for (lane, patch_idx) in before.iter().enumerate() {
                if *patch_idx != NONE && !before[..lane].contains(patch_idx) {
                    nearest.measure_cube(&self.patches.all[*patch_idx as usize], *patch_idx, cube);
                }
            }
            self.tree.search(cube, CLOSE_SHARE, &mut nearest);
            nearest.patch_idx.store(&mut before);
            found.push(before);
        }
        found
    }
}

/// Slots of a brick and of the seven after it.
fn bricks_after(layers: &Layers, brick: u32) -> [u32; 8] {
    let coord = layers.grid.brick_coord(brick as usize);
    core::array::from_fn(|idx| {
        let offset = [idx as i32 >> 2, idx as i32 >> 1 & 1, idx as i32 & 1];
        let entry = layers
            .grid
            .brick_neighbour(coord, offset)
            .map_or(FAR_OUTSIDE, |neighbour| layers.top[neighbour]);
        if entry < DEEP_INSIDE { entry } else { FAR_OUTSIDE }
    })
}

/// Lattice points of a brick and the first of those after it, z fastest.
pub(super) struct LatticePoints([u32; 27]);

impl LatticePoints {
    /// Those at the corners of a block of 4³ cells.
    #[inline(always)]
    pub(super) fn around(&self, [x, y, z]: [usize; 3]) -> [u32; LANES] {
        core::array::from_fn(|corner| {
            self.0[((x + (corner >> 2)) * 3 + y + (corner >> 1 & 1)) * 3 + z + (corner & 1)]
        })
    }
}
