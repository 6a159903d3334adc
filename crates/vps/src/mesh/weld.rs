//! Shared corners from equal or near positions.
//!
//! Data in: positions. Data out: for each, the number of the vertex that stands for it. First come,
//! first numbered, so that the result depends on the order of the input only, not on the number of
//! threads. Cost: linear; positions are brought together by their hash ([`Shards`]), and each shard
//! is a small table in the cache.

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};
use std::sync::atomic::{AtomicU32, Ordering};

use glam::DVec3;

use super::TriangleMesh;
use super::shards::{Shards, shards_for};
use crate::parallel;

/// Triangles that one task reads at a time.
const CHUNK_TRIANGLES: usize = 1 << 15;

/// The bits of a position, 0 and -0 the same.
pub(super) trait Bits: Copy + Default + Eq + Send + Sync {
    /// Depends on every bit in its high and in its low half.
    fn hash(self) -> u64;

    fn position(self) -> DVec3;
}

fn mix(hash: u64, word: u64) -> u64 {
    let mixed = (hash.rotate_left(23) ^ word).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    mixed ^ (mixed >> 32)
}

/// Three numbers of `f32`.
impl Bits for [u32; 3] {
    fn hash(self) -> u64 {
        mix(mix(0, u64::from(self[0]) | (u64::from(self[1]) << 32)), u64::from(self[2]))
    }

    fn position(self) -> DVec3 {
        DVec3::from_array(self.map(|bits| f64::from(f32::from_bits(bits))))
    }
}

/// Three numbers of `f64`.
impl Bits for [u64; 3] {
    fn hash(self) -> u64 {
        self.into_iter().fold(0, mix)
    }

    fn position(self) -> DVec3 {
        DVec3::from_array(self.map(f64::from_bits))
    }
}

/// Triangles over the distinct corners of `corners_of`; `None` when corners or vertices outgrow 32
/// bits.
///
/// Vertices are numbered in the order in which corners first use them.
pub(super) fn weld_exact<B: Bits>(
    n_triangles: usize,
    corners_of: impl Fn(usize) -> [B; 3] + Sync,
) -> Option<TriangleMesh> {
    let n_corners = n_triangles.checked_mul(3)?;
    u32::try_from(n_corners).ok()?;
    let firsts = first_corners(n_triangles, &corners_of);
    let first_of = |corner: usize| firsts[corner].load(Ordering::Relaxed) as usize;

    // The number of a vertex is how many first corners come before its own: bits, with a sum at
    // every word.
    let mut words: Vec<(u64, u32)> = parallel::map(n_corners.div_ceil(64), 1, |word| {
        let corners = 64 * word..n_corners.min(64 * word + 64);
        (
            corners
                .filter(|corner| first_of(*corner) == *corner)
                .fold(0, |bits, corner| bits | (1 << (corner % 64))),
            0,
        )
    });
    let mut n_vertices = 0;
    for (bits, before) in &mut words {
        *before = n_vertices;
        n_vertices += bits.count_ones();
    }
    let number_of = |corner: usize| {
        let (bits, before) = words[corner / 64];
        before + (bits & ((1 << (corner % 64)) - 1)).count_ones()
    };

    let triangles = parallel::map(n_triangles, 1, |k| {
        [3 * k, 3 * k + 1, 3 * k + 2].map(|corner| number_of(first_of(corner)))
    });
    let mut vertices = vec![DVec3::ZERO; n_vertices as usize];
    let mut rest = &mut vertices[..];
    let mut pieces = Vec::new();
    for words in words.chunks(CHUNK_TRIANGLES / 64) {
        let (piece, later) = std::mem::take(&mut rest)
            .split_at_mut(words.iter().map(|(bits, _)| bits.count_ones() as usize).sum());
        pieces.push((piece, words));
        rest = later;
    }
    parallel::map_mut(&mut pieces, 1, |chunk, (piece, words)| {
        let corners = (0..64 * words.len()).filter(|bit| words[bit / 64].0 >> (bit % 64) & 1 == 1);
        for (vertex, bit) in piece.iter_mut().zip(corners) {
            let corner = chunk * (CHUNK_TRIANGLES / 64) * 64 + bit;
            *vertex = corners_of(corner / 3)[corner % 3].position();
        }
    });
    Some(TriangleMesh { vertices, triangles })
}

/// For each corner, the first corner at the same place (`[3 n_triangles]`).
fn first_corners<B: Bits>(
    n_triangles: usize,
    corners_of: &(impl Fn(usize) -> [B; 3] + Sync),
) -> Vec<AtomicU32> {
    let n_corners = 3 * n_triangles;
    let n_shards = shards_for(n_corners);
    let shard_of = |hash: u64| (hash >> 40) as usize & (n_shards - 1);
    let shards = Shards::new(n_triangles.div_ceil(CHUNK_TRIANGLES), n_shards, |chunk| {
        let triangles = chunk * CHUNK_TRIANGLES..n_triangles.min((chunk + 1) * CHUNK_TRIANGLES);
        triangles.flat_map(|triangle_idx| {
            let mut corner = 3 * triangle_idx as u32;
            corners_of(triangle_idx).map(|bits| {
                corner += 1;
                (shard_of(bits.hash()), (bits, corner - 1))
            })
        })
    });
    // Every place is written once, by the task of its shard; the tasks end before anyone reads.
    let firsts: Vec<AtomicU32> = parallel::map(n_corners, 1, |_| AtomicU32::new(0));
    parallel::map_with(
        shards.n_shards,
        1,
        || (Vec::new(), Vec::new()),
        |(slots, distinct): &mut (Vec<u32>, Vec<(B, u32)>), shard| {
            let mask = (2 * shards.len_of(shard)).next_power_of_two() - 1;
            slots.clear();
            slots.resize(mask + 1, u32::MAX);
            distinct.clear();
            for (bits, corner) in shards.shard(shard) {
                let mut slot = bits.hash() as usize & mask;
                let first = loop {
                    match distinct.get(slots[slot] as usize) {
                        None => {
                            slots[slot] = distinct.len() as u32;
                            distinct.push((bits, corner));
                            break corner;
                        }
                        Some((there, first)) if *there == bits => break *first,
                        Some(_) => slot = (slot + 1) & mask,
                    }
                };
                firsts[corner as usize].store(first, Ordering::Relaxed);
            }
        },
    );
    firsts
}

/// A multiplicative hash for a few machine words: the default one is built against attackers and
/// costs most of the reading time.
#[derive(Default)]
struct WordHasher(u64);

impl Hasher for WordHasher {
    fn finish(&self) -> u64 {
        self.0
    }

    fn write(&mut self, bytes: &[u8]) {
        for byte in bytes {
            self.write_u64(u64::from(*byte));
        }
    }

    fn write_u64(&mut self, word: u64) {
        self.0 = mix(self.0, word);
    }

    fn write_i64(&mut self, word: i64) {
        self.write_u64(word.cast_unsigned());
    }
}

type WordMap<K> = HashMap<K, u32, BuildHasherDefault<WordHasher>>;

/// Cells of the search grid are this many tolerances wide: two cells looked at per position on
/// average, few vertices in each.
const CELL_TOLERANCES: f64 = 8.0;
/// And no more of them lie along an axis, however small the tolerance is: what is not equal is
/// hardly ever nearer.
const MOST_CELLS: f64 = (1_u64 << 40) as f64;

/// The grid in which near positions are looked for.
#[derive(Clone, Copy)]
struct Cells {
    origin: DVec3,
    per_m: f64,
    tolerance: f64,
}

impl Cells {
    fn new(positions: &[DVec3], tolerance: f64) -> Self {
        let boxes = parallel::map_chunks(positions, 1 << 16, |chunk| {
            chunk.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), position| {
                (low.min(*position), high.max(*position))
            })
        });
        let around = |(low, high): (DVec3, DVec3), (other_low, other_high): (DVec3, DVec3)| {
            (low.min(other_low), high.max(other_high))
        };
        let (origin, end) = boxes.into_iter().reduce(around).unwrap_or_default();
        let per_m =
            (CELL_TOLERANCES * tolerance).recip().min(MOST_CELLS / (end - origin).max_element());
        // Of one place.
        let per_m = if per_m.is_finite() { per_m } else { 1.0 };
        Self { origin, per_m, tolerance }
    }

    fn of(self, position: DVec3) -> [i64; 3] {
        ((position - self.origin) * self.per_m).floor().as_i64vec3().to_array()
    }

    /// The cells of all positions within the tolerance: eight at most.
    fn around(self, position: DVec3) -> impl Iterator<Item = [i64; 3]> {
        let local = position - self.origin;
        let cell_of = |local: DVec3| (local * self.per_m).floor().as_i64vec3();
        let low = cell_of(local - self.tolerance);
        let high = cell_of(local + self.tolerance);
        (low.x..=high.x).flat_map(move |x| {
            (low.y..=high.y).flat_map(move |y| (low.z..=high.z).map(move |z| [x, y, z]))
        })
    }
}

/// For each position, the index of the first position within `tolerance` of it that stands for
/// itself (`[n_positions]`).
///
/// Greedy: a position joins the first representative that is near, so that chains of near positions
/// do not collapse into one. A tolerance of zero joins equal positions only. Positions without a
/// neighbour stand for themselves and for no other, so the greedy walk, which is sequential, sees
/// only the rest.
pub(crate) fn weld_within(positions: &[DVec3], tolerance: f64) -> Vec<u32> {
    let cells = Cells::new(positions, tolerance);
    let mut representative: Vec<u32> = (0..positions.len() as u32).collect();
    let crowded = crowded(positions, cells);
    let mut in_cell: WordMap<[i64; 3]> =
        WordMap::with_capacity_and_hasher(crowded.len(), BuildHasherDefault::default());
    // The next representative of the same cell, by place in `crowded`.
    const NONE: u32 = u32::MAX;
    let mut next_in_cell = vec![NONE; crowded.len()];
    for (place, number) in (0_u32..).zip(&crowded) {
        let position = positions[*number as usize];
        let mut found = NONE;
        for cell in cells.around(position) {
            let mut candidate = in_cell.get(&cell).copied().unwrap_or(NONE);
            while candidate != NONE {
                let other = positions[crowded[candidate as usize] as usize];
                if candidate < found
                    && other.distance_squared(position) <= cells.tolerance * cells.tolerance
                {
                    found = candidate;
                }
                candidate = next_in_cell[candidate as usize];
            }
        }
        if found == NONE {
            if let Some(previous) = in_cell.insert(cells.of(position), place) {
                next_in_cell[place as usize] = previous;
            }
        } else {
            representative[*number as usize] = crowded[found as usize];
        }
    }
    representative
}

/// Positions that may have another within the tolerance: those that share the hash of a cell around
/// them. In rising order.
fn crowded(positions: &[DVec3], cells: Cells) -> Vec<u32> {
    const CHUNK: usize = 1 << 16;
    let n_shards = shards_for(2 * positions.len());
    let shards = Shards::new(positions.len().div_ceil(CHUNK), n_shards, |chunk| {
        let numbers = chunk * CHUNK..positions.len().min((chunk + 1) * CHUNK);
        numbers.flat_map(|number| {
            cells.around(positions[number]).map(move |cell| {
                let hash = cell.into_iter().fold(0, |hash, axis| mix(hash, axis.cast_unsigned()));
                ((hash >> 40) as usize & (n_shards - 1), (hash as u32, number as u32))
            })
        })
    });
    let crowded = parallel::map_with(
        shards.n_shards,
        1,
        || (Vec::new(), Vec::new()),
        |(slots, firsts): &mut (Vec<u32>, Vec<(u32, u32, bool)>), shard| {
            let mask = (2 * shards.len_of(shard)).next_power_of_two() - 1;
            slots.clear();
            slots.resize(mask + 1, u32::MAX);
            firsts.clear();
            let mut crowded = Vec::new();
            for (hash, number) in shards.shard(shard) {
                let mut slot = hash as usize & mask;
                loop {
                    match firsts.get_mut(slots[slot] as usize) {
                        None => {
                            slots[slot] = firsts.len() as u32;
                            firsts.push((hash, number, false));
                        }
                        Some((there, ..)) if *there != hash => {
                            slot = (slot + 1) & mask;
                            continue;
                        }
                        // Two cells around one position that share a hash.
                        Some((_, first, _)) if *first == number => {}
                        Some((_, first, is_known)) => {
                            if !std::mem::replace(is_known, true) {
                                crowded.push(*first);
                            }
                            crowded.push(number);
                        }
                    }
                    break;
                }
            }
            crowded
        },
    );
    let mut is_crowded = vec![false; positions.len()];
    crowded.iter().flatten().for_each(|number| is_crowded[*number as usize] = true);
    (0..).zip(is_crowded).filter_map(|(number, is_crowded)| is_crowded.then_some(number)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spatial::testing::Random;

    /// The corners, each with its own copy of a position, as a triangle soup of three per triangle.
    fn welded<B: Bits>(corners: &[B]) -> TriangleMesh {
        weld_exact(corners.len() / 3, |k| [corners[3 * k], corners[3 * k + 1], corners[3 * k + 2]])
            .unwrap()
    }

    #[test]
    fn exact_weld_joins_equal_bits_only() {
        let corners = [1.0, 1.0 + f64::EPSILON, 1.0, f64::MIN_POSITIVE, 0.0, 1.0]
            .map(|x| [x.to_bits(), 0, 0]);
        let mesh = welded(&corners);
        assert_eq!(mesh.triangles, [[0, 1, 0], [2, 3, 0]]);
        assert_eq!(mesh.vertices[2], DVec3::new(f64::MIN_POSITIVE, 0.0, 0.0));
        assert!(welded::<[u32; 3]>(&[]).triangles.is_empty());
    }

    #[test]
    fn many_corners_are_numbered_by_first_use_on_any_number_of_threads() {
        // Several chunks and shards; the order of first use is found again by a plain table.
        let n_corners = 3 * (2 * CHUNK_TRIANGLES + 77);
        let corners: Vec<[u32; 3]> = (0..n_corners as u32)
            .map(|k| {
                let place = k.wrapping_mul(2_654_435_761) >> 15;
                [(place as f32).to_bits(), (-(place as f32)).to_bits(), place % 3]
            })
            .collect();
        let mut numbers = HashMap::new();
        let expected: Vec<u32> = corners
            .iter()
            .map(|bits| {
                let next = numbers.len() as u32;
                *numbers.entry(*bits).or_insert(next)
            })
            .collect();
        for n_threads in [1, 2, 5] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().unwrap();
            let mesh = pool.install(|| welded(&corners));
            assert_eq!(mesh.triangles.as_flattened(), expected);
            assert_eq!(mesh.vertices.len(), numbers.len());
            assert!(
                corners
                    .iter()
                    .zip(&expected)
                    .all(|(bits, number)| mesh.vertices[*number as usize] == bits.position())
            );
        }
    }

    #[test]
    fn near_positions_join_across_cell_borders() {
        let tolerance = 1e-3;
        let mut positions = Vec::new();
        for k in 0..1000 {
            let x = f64::from(k) * 3.7 * tolerance;
            positions.push(DVec3::new(x, -x, 0.5 * x));
            positions.push(DVec3::new(x + 0.5 * tolerance, -x - 0.5 * tolerance, 0.5 * x));
        }
        let representative = weld_within(&positions, tolerance);
        for k in 0..1000 {
            assert_eq!(representative[2 * k..2 * k + 2], [2 * k as u32, 2 * k as u32]);
        }
    }

    #[test]
    fn few_positions_share_a_cell_whatever_the_tolerance_is() {
        for size_m in [1e-9, 0.03, 1e9] {
            for tolerance in [0.0, 1e-320, 1e-30, 1e-12 * size_m] {
                let mut random = Random(7);
                let positions: Vec<DVec3> =
                    (0..5000).map(|_| random.in_box(-1.0, 1.0) * size_m).collect();
                let cells = Cells::new(&positions, tolerance);
                let taken: std::collections::HashSet<_> =
                    positions.iter().map(|position| cells.of(*position)).collect();
                assert!(taken.len() > 4990, "{size_m} {tolerance}: {}", taken.len());
            }
        }
    }

    #[test]
    fn zero_tolerance_joins_equal_positions_only() {
        assert_eq!(
            weld_within(&[DVec3::X, DVec3::X, DVec3::X * (1.0 + f64::EPSILON)], 0.0),
            [0, 0, 2]
        );
        assert!(weld_within(&[], 0.0).is_empty());
    }
}
