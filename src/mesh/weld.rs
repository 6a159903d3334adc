//! Shared corners from equal or near positions: hash tables over positions.
//!
//! Data in: positions. Data out: for each, the number of the vertex that stands for it. First come, first numbered, so that the
//! result depends on the order of the input only. Cost: about one look-up per position exact, two within a tolerance.

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};

use glam::DVec3;

/// A multiplicative hash for a few machine words: the default one is built against attackers and costs most of the reading time.
#[derive(Default)]
struct WordHasher(u64);

impl Hasher for WordHasher {
    fn finish(&self) -> u64 {
        // The table takes its bucket from the low bits and its tag from the high ones: both must depend on every word.
        self.0 ^ (self.0 >> 32)
    }

    fn write(&mut self, bytes: &[u8]) {
        for byte in bytes {
            self.write_u64(u64::from(*byte));
        }
    }

    fn write_u64(&mut self, word: u64) {
        self.0 = (self.0.rotate_left(23) ^ word).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        self.0 ^= self.0 >> 29;
    }

    fn write_i64(&mut self, word: i64) {
        self.write_u64(word.cast_unsigned());
    }
}

type WordMap<K> = HashMap<K, u32, BuildHasherDefault<WordHasher>>;

/// Numbers positions, the same number for bitwise equal ones (0 and -0 count as equal).
pub(super) struct ExactWeld {
    numbers: WordMap<(u64, u64, u64)>,
    /// The distinct positions, by number.
    pub(super) vertices: Vec<DVec3>,
}

impl ExactWeld {
    /// Room for the vertices of a closed mesh with this many triangles.
    pub(super) fn with_triangles(n_triangles: usize) -> Self {
        let n_vertices = n_triangles / 2 + 2;
        Self {
            numbers: WordMap::with_capacity_and_hasher(n_vertices, BuildHasherDefault::default()),
            vertices: Vec::with_capacity(n_vertices),
        }
    }

    /// Number of `position`; `None` when 2³² vertices are in use.
    pub(super) fn insert(&mut self, position: DVec3) -> Option<u32> {
        // Adding zero turns -0 into 0 and leaves every other number as it is.
        let position = position + DVec3::ZERO;
        let next = u32::try_from(self.vertices.len()).ok()?;
        let number = *self.numbers.entry((position.x.to_bits(), position.y.to_bits(), position.z.to_bits())).or_insert(next);
        if number == next {
            self.vertices.push(position);
        }
        Some(number)
    }
}

/// Cells of the search grid are this many tolerances wide: two cells looked at per position on average, few vertices in each.
const CELL_TOLERANCES: f64 = 8.0;

/// For each position, the index of the first position within `tolerance` of it that stands for itself (`[n_positions]`).
///
/// Greedy: a position joins the first representative that is near, so that chains of near positions do not collapse into one.
/// A tolerance of zero joins equal positions only.
pub(super) fn weld_within(positions: &[DVec3], tolerance: f64) -> Vec<u32> {
    const NONE: u32 = u32::MAX;
    let origin = positions.iter().copied().reduce(DVec3::min).unwrap_or_default();
    let per_cell = if tolerance > 0.0 { (CELL_TOLERANCES * tolerance).recip() } else { 1.0 };
    let mut first_of_cell: WordMap<(i64, i64, i64)> =
        WordMap::with_capacity_and_hasher(positions.len(), BuildHasherDefault::default());
    // The next representative of the same cell.
    let mut next_in_cell = vec![NONE; positions.len()];
    let mut representative = Vec::with_capacity(positions.len());
    for (number, position) in (0_u32..).zip(positions) {
        let local = *position - origin;
        let cell_of = |point: DVec3| (point * per_cell).floor().as_i64vec3();
        let (low, high) = (cell_of(local - tolerance), cell_of(local + tolerance));
        let mut found = NONE;
        for x in low.x..=high.x {
            for y in low.y..=high.y {
                for z in low.z..=high.z {
                    let mut candidate = first_of_cell.get(&(x, y, z)).copied().unwrap_or(NONE);
                    while candidate != NONE {
                        if candidate < found && positions[candidate as usize].distance_squared(*position) <= tolerance * tolerance {
                            found = candidate;
                        }
                        candidate = next_in_cell[candidate as usize];
                    }
                }
            }
        }
        if found == NONE {
            let own = cell_of(local);
            if let Some(previous) = first_of_cell.insert((own.x, own.y, own.z), number) {
                next_in_cell[number as usize] = previous;
            }
            found = number;
        }
        representative.push(found);
    }
    representative
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exact_weld_joins_equal_bits_and_both_zeros() {
        let mut weld = ExactWeld::with_triangles(1);
        assert_eq!(weld.insert(DVec3::ZERO), Some(0));
        assert_eq!(weld.insert(DVec3::new(-0.0, 0.0, -0.0)), Some(0));
        assert_eq!(weld.insert(DVec3::new(f64::MIN_POSITIVE, 0.0, 0.0)), Some(1));
        assert_eq!(weld.vertices.len(), 2);
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
    fn zero_tolerance_joins_equal_positions_only() {
        assert_eq!(weld_within(&[DVec3::X, DVec3::X, DVec3::X * (1.0 + f64::EPSILON)], 0.0), [0, 0, 2]);
        assert!(weld_within(&[], 0.0).is_empty());
    }
}
