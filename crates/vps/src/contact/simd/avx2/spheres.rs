//! Looks up blocks of eight spheres.

use super::*;

#[target_feature(enable = "avx2")]
#[inline]
fn numbers(numbers: &[f32; CHILDREN]) -> __m256 {
    // SAFETY: eight numbers.
    unsafe { _mm256_loadu_ps(numbers.as_ptr()) }
}

#[target_feature(enable = "avx2")]
pub(in super::super) fn above(bounds: &BrickBounds, place: &Place, spheres: &Spheres, floor_m: f32, margin_cells: f32) -> u8 {
    let (grid, place) = (Grid::new(bounds), Axes::new(place));
    let lattice = place.lattice([numbers(&spheres.x), numbers(&spheres.y), numbers(&spheres.z)]);
    let (on_grid, base) = grid.on_grid(lattice);
    let radius = _mm256_div_ps(numbers(&spheres.radius), _mm256_set1_ps(bounds.voxel_size_m()));
    let extent = _mm256_add_ps(radius, _mm256_set1_ps(margin_cells));
    // SAFETY: each is a brick of the grid, and by the chart's invariant there is one entry for it.
    let around = unsafe { _mm256_i32gather_ps::<4>(bounds.max_depth_nearby_m().as_ptr(), grid.brick(eighths(base))) };
    // One cell more: casts that round towards zero let the first cell reach out of the grid.
    let far = _mm256_add_ps(extent, _mm256_set1_ps(1.0));
    let away = |k: usize| {
        let away = _mm256_andnot_ps(_mm256_set1_ps(-0.0), _mm256_sub_ps(lattice[k], on_grid[k]));
        _mm256_cmp_ps::<_CMP_GT_OQ>(away, far)
    };
    let off = _mm256_or_ps(_mm256_or_ps(away(0), away(1)), away(2));
    let highest = _mm256_blendv_ps(around, grid.outside, off);
    let below = _mm256_cmp_ps::<_CMP_LE_OQ>(highest, _mm256_set1_ps(floor_m));
    let small = _mm256_or_ps(off, _mm256_cmp_ps::<_CMP_LT_OQ>(extent, _mm256_set1_ps(AROUND_CELLS)));
    !(_mm256_movemask_ps(_mm256_and_ps(below, small)) as u8)
}

#[target_feature(enable = "avx2")]
pub(in super::super) fn spheres(bounds: &BrickBounds, place: &Place, spheres: &Spheres, margin_cells: f32) -> [f32; CHILDREN] {
    let (grid, place) = (Grid::new(bounds), Axes::new(place));
    let (zero, radius) = (_mm256_setzero_ps(), numbers(&spheres.radius));
    let lattice = place.lattice([numbers(&spheres.x), numbers(&spheres.y), numbers(&spheres.z)]);
    let (on_grid, base) = grid.on_grid(lattice);
    let brick = grid.brick(eighths(base));
    // SAFETY: each is a brick of the grid, and by the chart's invariant there is one entry for it in each array.
    let (rooms, ceilings, slots) = unsafe {
        (
            _mm256_i32gather_ps::<4>(bounds.clearance_cells().as_ptr(), brick),
            _mm256_i32gather_ps::<4>(bounds.max_depth_m().as_ptr(), brick),
            _mm256_i32gather_epi32::<4>(bounds.top().as_ptr().cast(), brick),
        )
    };
    let is_slot = _mm256_castsi256_ps(_mm256_cmpgt_epi32(slots, _mm256_set1_epi32(-1)));
    let mut values = ceilings;
    if _mm256_movemask_ps(is_slot) != 0 {
        let slots = _mm256_and_si256(slots, _mm256_castps_si256(is_slot));
        // SAFETY: a slot of `top`, or 0 beside one.
        let corners = unsafe { grid.corners(slots, base) };
        let [c00, c01, c10, c11] = corners;
        let limited = |(a, b): (__m256, __m256)| (_mm256_max_ps(grid.low, a), _mm256_max_ps(grid.low, b));
        let corners = [limited(c00), limited(c01), limited(c10), limited(c11)];
        let t = fractions(on_grid, base);
        values = _mm256_blendv_ps(values, _mm256_add_ps(mixed(corners, t), grid.skin), is_slot);
    }
    let size = _mm256_set1_ps(bounds.voxel_size_m());
    let negated = _mm256_xor_ps(values, _mm256_set1_ps(-0.0));
    let depth = _mm256_sub_ps(_mm256_div_ps(negated, size), _mm256_set1_ps(bounds.jump_cells()));
    let depth = _mm256_max_ps(depth, zero);
    let squared = _mm256_sub_ps(_mm256_mul_ps(depth, depth), _mm256_set1_ps(SPREAD_CELLS_SQUARED));
    let by_spread = _mm256_sqrt_ps(_mm256_max_ps(squared, zero));
    let free = _mm256_max_ps(by_spread, _mm256_mul_ps(depth, _mm256_set1_ps(LEAST_SLOPE)));
    let free = _mm256_max_ps(rooms, free);
    let away = |k: usize| {
        let away = _mm256_sub_ps(lattice[k], on_grid[k]);
        _mm256_mul_ps(away, away)
    };
    let squared = _mm256_add_ps(_mm256_add_ps(_mm256_add_ps(away(0), away(1)), away(2)), _mm256_mul_ps(free, free));
    let taken = _mm256_add_ps(_mm256_div_ps(radius, size), _mm256_set1_ps(margin_cells));
    let mut result = [0.0; CHILDREN];
    // SAFETY: eight numbers.
    unsafe { _mm256_storeu_ps(result.as_mut_ptr(), _mm256_sub_ps(_mm256_sqrt_ps(squared), taken)) };
    result
}
