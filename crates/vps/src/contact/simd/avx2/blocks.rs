//! Looks up blocks of sixteen points.

use super::*;

#[target_feature(enable = "avx2")]
pub(in super::super) fn blocks(
    bounds: &BrickBounds,
    place: &Place,
    positions: &[Lanes3],
    which: impl Iterator<Item = u32> + Clone,
    floor: impl Fn(f32) -> f32,
    mut found: impl FnMut(u32, &Depths),
) -> f32 {
    let (grid, place) = (Grid::new(bounds), Axes::new(place));
    let mut max_m = f32::NEG_INFINITY;
    let mut soon = which.clone().skip(AHEAD);
    for block in which {
        if let Some(points) = soon.next().and_then(|block| positions.get(block as usize)) {
            prefetch(points);
        }
        let Some(points) = positions.get(block as usize) else { continue };
        let floor_m = floor(max_m);
        let Lanes3 { x: Lanes(x), y: Lanes(y), z: Lanes(z) } = points;
        let mut depths = Depths { depths_m: Lanes([0.0; LANES]), touching: 0, max_m: f32::NEG_INFINITY };
        let mut highest = _mm256_set1_ps(f32::NEG_INFINITY);
        let lattice = |from: usize| place.lattice([load(x, from), load(y, from), load(z, from)]);
        let halves = [lattice(0), lattice(LANES / 2)].map(|lattice| (lattice, whole(lattice)));
        // Points of a block are neighbours: mostly one brick holds them all, and one load is cheaper than sixteen.
        let alone = grid.only_brick([halves[0].1, halves[1].1]);
        let alone = alone.map(|brick| grid.brick_alone(brick, floor_m));
        for (from, (lattice, base)) in [0, LANES / 2].into_iter().zip(halves) {
            let values = match alone {
                None => grid.eight(lattice, base, _mm256_set1_ps(floor_m)),
                Some(Alone::Uniform(value_m)) => _mm256_set1_ps(value_m),
                Some(Alone::Samples(samples)) => {
                    // SAFETY: one whole brick, and numbers of cells in it.
                    let corners = unsafe { corners(samples.as_ptr(), inside(base)) };
                    grid.finished(corners, fractions(lattice, base))
                }
            };
            // The second where either is not a number.
            highest = _mm256_max_ps(values, highest);
            let touching = _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_GT_OQ>(values, _mm256_setzero_ps()));
            depths.touching |= (touching as u16) << from;
            // SAFETY: eight of sixteen numbers, from the first or the eighth on.
            unsafe { _mm256_storeu_ps(depths.depths_m.0.as_mut_ptr().add(from), values) };
        }
        depths.max_m = largest(highest);
        max_m = greater(depths.max_m, max_m);
        found(block, &depths);
    }
    max_m
}

#[target_feature(enable = "avx2")]
#[inline]
fn load(lanes: &[f32; LANES], from: usize) -> __m256 {
    debug_assert!(from + 8 <= LANES);
    // SAFETY: eight of sixteen numbers, from the first or the eighth on.
    unsafe { _mm256_loadu_ps(lanes.as_ptr().add(from)) }
}

/// Largest lane; none may be not a number.
#[target_feature(enable = "avx2")]
#[inline]
fn largest(eight: __m256) -> f32 {
    let four = _mm_max_ps(_mm256_castps256_ps128(eight), _mm256_extractf128_ps::<1>(eight));
    let two = _mm_max_ps(four, _mm_movehl_ps(four, four));
    _mm_cvtss_f32(_mm_max_ss(two, _mm_shuffle_ps::<1>(two, two)))
}
