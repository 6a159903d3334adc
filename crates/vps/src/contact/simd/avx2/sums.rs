//! Adds up blocks that touch.

use super::*;

/// Invariant of every `unsafe` block here: only `add`, which is compiled for AVX2, uses these.
impl Eight for __m256 {
    #[inline(always)]
    fn splat(value: f32) -> Self {
        // SAFETY: see above; likewise below.
        unsafe { _mm256_set1_ps(value) }
    }
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        // SAFETY: as above.
        unsafe { _mm256_add_ps(self, other) }
    }
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        // SAFETY: as above.
        unsafe { _mm256_sub_ps(self, other) }
    }
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        // SAFETY: as above.
        unsafe { _mm256_mul_ps(self, other) }
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        // SAFETY: as above.
        unsafe { _mm256_min_ps(self, other) }
    }
    #[inline(always)]
    fn load(lanes: &[f32; LANES], high: bool, wanted: u16) -> Self {
        let first = if high { APART } else { 0 };
        // SAFETY: as above; and half of sixteen numbers is eight.
        unsafe {
            let bits = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
            let own = _mm256_set1_epi32(i32::from(wanted) >> first);
            let wanted = _mm256_castsi256_ps(_mm256_cmpeq_epi32(_mm256_and_si256(own, bits), bits));
            _mm256_and_ps(_mm256_loadu_ps(lanes.as_ptr().add(first)), wanted)
        }
    }
    #[inline(always)]
    fn add_to(self, sum: &mut [f32; APART]) {
        // SAFETY: as above; and eight numbers.
        unsafe { _mm256_storeu_ps(sum.as_mut_ptr(), _mm256_add_ps(_mm256_loadu_ps(sum.as_ptr()), self)) }
    }
    #[inline(always)]
    fn settle(part: &mut [f32; APART], sum: &mut [f64; APART]) {
        // SAFETY: as above; and two times four numbers.
        unsafe {
            let (low, high) = (sum.as_mut_ptr(), sum.as_mut_ptr().add(4));
            _mm256_storeu_pd(low, _mm256_add_pd(_mm256_loadu_pd(low), _mm256_cvtps_pd(_mm_loadu_ps(part.as_ptr()))));
            _mm256_storeu_pd(high, _mm256_add_pd(_mm256_loadu_pd(high), _mm256_cvtps_pd(_mm_loadu_ps(part.as_ptr().add(4)))));
            _mm256_storeu_ps(part.as_mut_ptr(), _mm256_setzero_ps());
        }
    }
}

#[target_feature(enable = "avx2")]
pub(in super::super) fn add(sums: &mut Sums, touched: &ContactBlock, pushes: &Pushes, by: Weighting) {
    sums.add::<__m256>(touched, (&pushes.positions, &pushes.normals), Some(&pushes.weights), by);
}

#[target_feature(enable = "avx2")]
pub(in super::super) fn add_all<'a>(
    sums: &mut Sums,
    touched: &[ContactBlock],
    geometry: impl Fn(&ContactBlock) -> Option<(&'a Lanes3, &'a Lanes3)>,
    by: Weighting,
) {
    let mut soon = touched.iter().skip(AHEAD);
    for touched in touched {
        if let Some((positions, normals)) = soon.next().and_then(&geometry) {
            prefetch(positions);
            prefetch(normals);
        }
        if let Some((positions, normals)) = geometry(touched) {
            sums.add::<__m256>(touched, (positions, normals), None, by);
        }
    }
}
