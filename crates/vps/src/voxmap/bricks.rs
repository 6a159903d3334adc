//! Sparse sets of bricks: one bit per brick of the grid, and a number for each brick in the set.

use core::sync::atomic::{AtomicU32, AtomicU64, Ordering};
use rayon::prelude::*;
use std::sync::{Mutex, OnceLock, PoisonError};

use super::grid::BRICK_EDGE;
use crate::parallel;

/// One bit per cell of a brick: word x, bit y·8 + z.
pub type Mask = [u64; BRICK_EDGE];

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

/// 64 bricks of the set.
#[derive(Clone, Copy, Debug, Default)]
struct Word {
    bits: u64,
    /// Bricks of the set in all words before this one.
    before: u32,
}

/// A set of bricks that knows each member's place in ascending order: a quarter of a byte per brick
/// of the grid.
#[derive(Debug, Default)]
pub(super) struct BrickSet {
    words: Vec<Word>,
}

impl BrickSet {
    /// The set whose members are the bits of `words`. Cost: O(words).
    pub(super) fn new(words: impl IntoIterator<Item = u64>) -> Self {
        let mut before = 0;
        let number = |bits: u64| {
            let word = Word { bits, before };
            // At most one per brick of the grid, of which there are fewer than 2³².
            before += bits.count_ones();
            word
        };
        Self { words: words.into_iter().map(number).collect() }
    }

    /// Place of a brick among the members, or `None` for any other.
    #[inline]
    pub(super) fn slot(&self, brick: usize) -> Option<usize> {
        let Word { bits, before } = self.words[brick / 64];
        let bit = brick % 64;
        (bits >> bit & 1 == 1)
            .then(|| before as usize + (bits & ((1 << bit) - 1)).count_ones() as usize)
    }

    /// Members among the bricks `64·word..64·(word + 1)`, as bits.
    #[inline]
    pub(super) fn word(&self, word: usize) -> u64 {
        self.words[word].bits
    }

    /// Members, ascending.
    pub(super) fn members(&self) -> Vec<u32> {
        let n_members = self.words.last().map_or(0, |word| word.before + word.bits.count_ones());
        let mut members = Vec::with_capacity(n_members as usize);
        for (idx, word) in self.words.iter().enumerate() {
            members.extend(bits(word.bits).map(|bit| 64 * idx as u32 + bit));
        }
        members
    }
}

/// Masks that are allocated together.
const SEGMENT: usize = 1024;

/// Cells that many threads mark at once. A brick gets its mask when its first cell is marked.
pub(super) struct Marks {
    /// `[n_bricks of the grid]`: 1 + number of the brick's mask in order of allocation, or 0.
    top: Vec<AtomicU32>,
    /// Bricks in order of allocation.
    bricks: Mutex<Vec<u32>>,
    segments: Vec<OnceLock<Vec<MarkedCells>>>,
}

/// A [`Mask`] that many threads mark.
pub(super) type MarkedCells = [AtomicU64; BRICK_EDGE];

impl Marks {
    /// No marks yet. Cost: 4 bytes per brick of the grid.
    pub(super) fn new(n_bricks: usize) -> Self {
        Self {
            top: (0..n_bricks).map(|_| AtomicU32::new(0)).collect(),
            bricks: Mutex::default(),
            segments: (0..n_bricks.div_ceil(SEGMENT)).map(|_| OnceLock::new()).collect(),
        }
    }

    /// The mask of a brick.
    pub(super) fn cells(&self, brick: usize) -> &MarkedCells {
        // Relaxed: the number is all there is to read; its segment is handed over by the OnceLock.
        let slot = match self.top[brick].load(Ordering::Relaxed) {
            0 => self.allocate(brick),
            slot => slot,
        } as usize
            - 1;
        &self.segments[slot / SEGMENT].get_or_init(|| {
            (0..SEGMENT).map(|_| [const { AtomicU64::new(0) }; BRICK_EDGE]).collect()
        })[slot % SEGMENT]
    }

    #[cold]
    fn allocate(&self, brick: usize) -> u32 {
        // Poisoned or not, the list is whole: pushing is all that is done under the lock.
        let mut bricks = self.bricks.lock().unwrap_or_else(PoisonError::into_inner);
        // Relaxed: written under this lock only.
        match self.top[brick].load(Ordering::Relaxed) {
            0 => {
                bricks.push(brick as u32);
                self.top[brick].store(bricks.len() as u32, Ordering::Relaxed);
                bricks.len() as u32
            }
            slot => slot,
        }
    }

    /// The bricks that were marked and their masks, ascending: the order of allocation does not
    /// show.
    pub(super) fn into_masks(self) -> (BrickSet, Vec<u32>, Vec<Mask>) {
        let Self { top, bricks, segments } = self;
        let n_words = top.len().div_ceil(64);
        drop(top);
        let bricks = bricks.into_inner().unwrap_or_else(PoisonError::into_inner);
        let mut order: Vec<(u64, u32)> = bricks.into_iter().map(u64::from).zip(0..).collect();
        order.par_sort_unstable();
        let masks = parallel::map(order.len(), 1, |place| {
            let slot = order[place].1 as usize;
            let segment = segments[slot / SEGMENT].get();
            // Relaxed: the threads that marked have been joined.
            segment.map_or([0; BRICK_EDGE], |cells| {
                cells[slot % SEGMENT].each_ref().map(|word| word.load(Ordering::Relaxed))
            })
        });
        let bricks: Vec<u32> = order.into_iter().map(|(brick, _)| brick as u32).collect();
        let mut words = vec![0_u64; n_words];
        bricks.iter().for_each(|brick| words[*brick as usize / 64] |= 1 << (brick % 64));
        (BrickSet::new(words), bricks, masks)
    }
}
