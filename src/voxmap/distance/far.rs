//! The layers around the surface: each cell takes over the patches of its inner neighbours and walks on from there.

use super::patches::{NONE, Patch, Patches};
use super::simd::{LANES, Machine};
use crate::voxmap::grid::{BRICK_CELLS, BRICK_EDGE};
use crate::voxmap::layers::DEEP_INSIDE;
use crate::voxmap::surface::{Mask, bits};

/// The cells of one layer and their nearest patches, packed: memory follows the layer, not the band.
#[derive(Default)]
pub(super) struct Front {
    /// `[n_slots]`: cells on the layer.
    masks: Vec<Mask>,
    /// `[n_slots + 1]`: where the patches of a slot's cells start.
    starts: Vec<u32>,
    /// `[n_slots]`: from there, where those of each word of its mask start.
    word_starts: Vec<[u16; BRICK_EDGE]>,
    /// Nearest patch, cells in order of slot and number inside.
    patches: Vec<u32>,
}

impl Front {
    pub(super) fn new(masks: Vec<Mask>) -> Self {
        let mut starts = Vec::with_capacity(masks.len() + 1);
        let mut word_starts = Vec::with_capacity(masks.len());
        let mut total = 0;
        for mask in &masks {
            let mut count = 0;
            word_starts.push(mask.map(|word| {
                let start = count;
                count += word.count_ones() as u16;
                start
            }));
            starts.push(total);
            total = u32::checked_add(total, count.into()).expect("fewer than 2^32 cells on a layer");
        }
        starts.push(total);
        Self { masks, starts, word_starts, patches: vec![NONE; total as usize] }
    }

    /// The slots that hold cells of the layer, with room for their patches.
    pub(super) fn parts(&mut self) -> Vec<Option<(&Mask, &mut [u32])>> {
        let mut rest = &mut self.patches[..];
        self.masks
            .iter()
            .zip(self.starts.windows(2))
            .map(|(mask, bounds)| {
                let (part, tail) = core::mem::take(&mut rest).split_at_mut((bounds[1] - bounds[0]) as usize);
                rest = tail;
                (!part.is_empty()).then_some((mask, part))
            })
            .collect()
    }
}

/// Bits of a word at y = 0, and at z = 0.
const FIRST_Y: u64 = 0xff;
const FIRST_Z: u64 = 0x0101_0101_0101_0101;

/// Steps in a [`Rimmed`] to the neighbours of a cell.
const NEIGHBOURS: [isize; 26] =
    [-111, -110, -109, -101, -100, -99, -91, -90, -89, -11, -10, -9, -1, 1, 9, 10, 11, 89, 90, 91, 99, 100, 101, 109, 110, 111];

/// Patches of the inner layer in a brick and in the rim of one cell around it, ten cells on an edge.
///
/// Longer than 10³ by as much as makes an index that is masked always valid.
struct Rimmed([u32; 1024]);

impl Rimmed {
    fn new(around: &[u32; 27], inner: &Front) -> Self {
        let mut rimmed = Self([NONE; 1024]);
        for (idx, slot) in around.iter().enumerate() {
            if *slot >= DEEP_INSIDE {
                continue;
            }
            let slot = *slot as usize;
            let patches = &inner.patches[inner.starts[slot] as usize..inner.starts[slot + 1] as usize];
            if patches.is_empty() {
                continue;
            }
            let idx = idx as i32;
            let offset = [idx / 9 - 1, idx / 3 % 3 - 1, idx % 3 - 1];
            let y = [FIRST_Y << 56, u64::MAX, FIRST_Y][(offset[1] + 1) as usize];
            let z = [FIRST_Z << 7, u64::MAX, FIRST_Z][(offset[2] + 1) as usize];
            let xs = [7..8, 0..8, 0..1][(offset[0] + 1) as usize].clone();
            let first = rimmed_cell([8 * offset[0], 8 * offset[1], 8 * offset[2]]);
            for x in xs {
                let word = inner.masks[slot][x];
                let start = usize::from(inner.word_starts[slot][x]);
                let row = first.wrapping_add(100 * x);
                if y & z == u64::MAX {
                    for (bit, patch_idx) in bits(word).zip(&patches[start..]) {
                        rimmed.put(row, bit, *patch_idx);
                    }
                } else {
                    for bit in bits(word & y & z) {
                        let before = (word & ((1 << bit) - 1)).count_ones() as usize;
                        rimmed.put(row, bit, patches[start + before]);
                    }
                }
            }
        }
        rimmed
    }

    #[inline]
    fn put(&mut self, row: usize, bit: u32, patch_idx: u32) {
        self.0[row.wrapping_add(10 * (bit >> 3) as usize + (bit & 7) as usize) & 1023] = patch_idx;
    }

    /// Patches at some of the cells around one.
    #[inline]
    fn around<const N: usize>(&self, inside: usize, steps: &[isize; N]) -> [u32; N] {
        let cell = 111 + (inside >> 6) * 100 + (inside >> 3 & 7) * 10 + (inside & 7);
        steps.map(|step| self.0[cell.wrapping_add_signed(step) & 1023])
    }

    /// The lowest and the highest patch among the inner neighbours of a cell. Mostly they are the same.
    #[inline]
    fn offers(&self, inside: usize) -> (u32, u32) {
        match extent(self.around(inside, &NEIGHBOURS)) {
            (NONE, _) => (0, 0),
            found => found,
        }
    }

    /// All that [`Self::offers`] spans.
    fn each_offer(&self, inside: usize, visit: impl FnMut(u32)) {
        self.around(inside, &NEIGHBOURS).into_iter().filter(|id| *id != NONE).for_each(visit);
    }
}

/// Lowest and highest number, [`NONE`] apart; without branches, as they could not be foreseen.
#[inline]
fn extent<const N: usize>(ids: [u32; N]) -> (u32, u32) {
    let lowest = ids.iter().fold(NONE, |lowest, id| lowest.min(*id));
    // `NONE` is the highest number there is, and 0 when one more.
    let highest = ids.iter().fold(0, |highest, id| id.wrapping_add(1).max(highest)).wrapping_sub(1);
    (lowest, highest)
}

/// Index in a [`Rimmed`] of a cell given relative to the brick; may wrap, as a base for others.
fn rimmed_cell([x, y, z]: [i32; 3]) -> usize {
    ((x + 1) * 100 + (y + 1) * 10 + z + 1) as isize as usize
}

/// Patches that a cell remembers having been measured against; older ones may be measured again.
const REMEMBERED: usize = 8;
/// Steps across edges at most; from a neighbour's closest point it is a voxel's way, so only very fine meshes need many.
const WALK_STEPS: usize = 64;
/// A step must shorten the squared distance by this share.
const PROGRESS: f32 = 1.0 - 1e-6;

/// The cells of a layer in one brick while they look for their patches.
pub(super) struct Search {
    machine: Machine,
    n_cells: usize,
    cells: [u32; BRICK_CELLS],
    squared: [f32; BRICK_CELLS],
    patch_idx: [u32; BRICK_CELLS],
    on_edge: [u8; BRICK_CELLS],
    measured: [[u32; REMEMBERED]; BRICK_CELLS],
    n_measured: [u8; BRICK_CELLS],
    /// Positions of cells whose neighbours do not agree.
    divided: [u16; BRICK_CELLS + 1],
    /// Waiting to be measured: position in `cells`, patch.
    queue_cells: [u32; LANES],
    queue_places: [u32; LANES],
    queue_patches: [u32; LANES],
    n_queued: usize,
}

impl Search {
    pub(super) fn new(machine: Machine) -> Self {
        Self {
            machine,
            n_cells: 0,
            cells: [0; BRICK_CELLS],
            squared: [f32::INFINITY; BRICK_CELLS],
            patch_idx: [NONE; BRICK_CELLS],
            on_edge: [0; BRICK_CELLS],
            measured: [[NONE; REMEMBERED]; BRICK_CELLS],
            n_measured: [0; BRICK_CELLS],
            divided: [0; BRICK_CELLS + 1],
            queue_cells: [0; LANES],
            queue_places: [0; LANES],
            queue_patches: [0; LANES],
            n_queued: 0,
        }
    }

    /// Measures the cells of `mask`, which lie in the brick at `origin` one layer out from `inner`. `around`: slots of that brick and
    /// of the 26 next to it.
    pub(super) fn measure(&mut self, patches: &Patches, origin: [i32; 3], around: &[u32; 27], mask: &Mask, inner: &Front) {
        let rimmed = Rimmed::new(around, inner);
        self.reset(mask);
        // A cell that finds nothing is measured against patch 0, which is as true as any.
        let mut n_divided = 0;
        for place in 0..self.n_cells {
            let (nearest, highest) = rimmed.offers(self.cells[place] as usize);
            self.patch_idx[place] = nearest;
            self.measured[place] = [nearest, NONE, NONE, NONE, NONE, NONE, NONE, NONE];
            self.divided[n_divided] = place as u16;
            n_divided += usize::from(highest != nearest);
        }
        self.measure_first(&patches.all, origin);
        for idx in 0..n_divided {
            let place = usize::from(self.divided[idx]);
            rimmed.each_offer(self.cells[place] as usize, |patch_idx| self.push(&patches.all, origin, place, patch_idx));
        }
        self.flush(&patches.all, origin);
        self.walk(patches, origin);
    }

    /// Measures every cell against the patch that it starts with.
    fn measure_first(&mut self, patches: &[Patch], origin: [i32; 3]) {
        let batches = self.n_cells.div_ceil(LANES);
        // Lanes behind the last cell repeat it.
        for place in self.n_cells..batches * LANES {
            self.cells[place] = self.cells[self.n_cells - 1];
            self.patch_idx[place] = self.patch_idx[self.n_cells - 1];
        }
        let (cells, ids) = (self.cells.as_chunks::<LANES>().0, self.patch_idx.as_chunks::<LANES>().0);
        let (squared, on_edge) = (self.squared.as_chunks_mut::<LANES>().0, self.on_edge.as_chunks_mut::<LANES>().0);
        for batch in 0..batches {
            let found = self.machine.gathered(patches, &ids[batch], origin, &cells[batch]);
            squared[batch] = found.squared;
            for (lane, on_edge) in on_edge[batch].iter_mut().enumerate() {
                let [a, b, c] = found.on_edge.map(|bits| bits >> lane & 1);
                *on_edge = a | b << 1 | c << 2;
            }
        }
    }

    fn reset(&mut self, mask: &Mask) {
        self.n_cells = 0;
        for (x, word) in mask.iter().enumerate() {
            for bit in bits(*word) {
                self.cells[self.n_cells] = (x as u32) << 6 | bit;
                self.n_cells += 1;
            }
        }
        self.n_measured[..self.n_cells].fill(1);
    }

    /// Number inside the brick, nearest patch and squared distance (cells²) of every cell.
    pub(super) fn results(&self) -> impl Iterator<Item = (usize, u32, f32)> + '_ {
        (0..self.n_cells).map(|place| (self.cells[place] as usize, self.patch_idx[place], self.squared[place]))
    }

    #[inline]
    fn push(&mut self, patches: &[Patch], origin: [i32; 3], place: usize, patch_idx: u32) {
        let measured = &mut self.measured[place];
        if measured.contains(&patch_idx) {
            return;
        }
        let n_measured = &mut self.n_measured[place];
        measured[usize::from(*n_measured) % REMEMBERED] = patch_idx;
        *n_measured = n_measured.wrapping_add(1);
        let queued = self.n_queued % LANES;
        self.queue_cells[queued] = self.cells[place];
        self.queue_places[queued] = place as u32;
        self.queue_patches[queued] = patch_idx;
        self.n_queued = queued + 1;
        if self.n_queued == LANES {
            self.flush(patches, origin);
        }
    }

    fn flush(&mut self, patches: &[Patch], origin: [i32; 3]) {
        if self.n_queued == 0 {
            return;
        }
        let found = self.machine.gathered(patches, &self.queue_patches, origin, &self.queue_cells);
        for lane in 0..self.n_queued {
            let place = self.queue_places[lane] as usize % BRICK_CELLS;
            if found.squared[lane] < self.squared[place] * PROGRESS {
                self.squared[place] = found.squared[lane];
                self.patch_idx[place] = self.queue_patches[lane];
                let [a, b, c] = found.on_edge.map(|bits| bits >> lane & 1);
                self.on_edge[place] = a | b << 1 | c << 2;
            }
        }
        self.n_queued = 0;
    }

    /// Steps across the edges on which closest points lie, as long as that leads closer.
    fn walk(&mut self, patches: &Patches, origin: [i32; 3]) {
        let mut places = [0_u16; BRICK_CELLS];
        let mut n_places = self.n_cells;
        for step in 0..WALK_STEPS {
            let mut n_walking = 0;
            for idx in 0..n_places {
                let place = if step == 0 { idx } else { usize::from(places[idx]) };
                let on_edge = self.on_edge[place];
                if on_edge == 0 {
                    continue;
                }
                // Until it improves there is nothing more to try.
                self.on_edge[place] = 0;
                places[n_walking] = place as u16;
                n_walking += 1;
                let patch_idx = self.patch_idx[place];
                for edge in 0..3 {
                    if on_edge >> edge & 1 == 1 {
                        let across = patches.across(patch_idx, edge);
                        if across != NONE {
                            self.push(&patches.all, origin, place, across);
                        }
                    }
                }
            }
            self.flush(&patches.all, origin);
            n_places = n_walking;
            if n_places == 0 {
                return;
            }
        }
    }
}
