//! The kernel's arithmetic, eight cells at a time where the processor can.
//!
//! One generic source, two instances: one takes lanes one by one, the other all eight at once with AVX2. Both do the same
//! operations in the same order with the same rounding (no fused multiply-add), so results do not depend on which of them ran.

#![expect(unsafe_code, reason = "AVX2 intrinsics, and the call of code compiled for AVX2 after asking for it")]

use super::kernel::{Flat, Nearest, nearest};
use super::patches::Patch;
use crate::voxmap::grid::BRICK_CELLS;
use crate::voxmap::surface::Mask;

/// Cells measured together.
pub(super) const LANES: usize = 8;

/// A number per lane.
pub(super) trait Number: Copy {
    fn add(self, other: Self) -> Self;
    fn sub(self, other: Self) -> Self;
    fn mul(self, other: Self) -> Self;
    fn min(self, other: Self) -> Self;
    fn max(self, other: Self) -> Self;
    fn splat(value: f32) -> Self;
    /// 0 where all three are above 0.
    fn zero_where_all_positive(self, three: [Self; 3]) -> Self;
}

/// Distances of eight cells.
#[derive(Clone, Copy, Default)]
pub(super) struct Eight {
    /// Cells².
    pub(super) squared: [f32; LANES],
    /// Distance to the patch's plane, positive on the side of the winding normal, cells.
    pub(super) height: [f32; LANES],
    /// One bit per lane for each edge: the closest point lies on it.
    pub(super) on_edge: [u8; 3],
}

/// How lanes are computed.
#[derive(Clone, Copy, Debug)]
pub(super) enum Machine {
    /// One after the other.
    Portable,
    /// All at once. Invariant: made by [`Machine::best`] only, which asks the processor.
    #[cfg(target_arch = "x86_64")]
    Avx2,
}

impl Machine {
    /// The fastest that this processor has.
    pub(super) fn best() -> Self {
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2") {
            return Self::Avx2;
        }
        Self::Portable
    }

    /// Eight cells of the brick at `origin`, by their numbers inside, each against the patch of its lane.
    #[inline]
    pub(super) fn gathered(self, patches: &[Patch], ids: &[u32; LANES], origin: [i32; 3], cells: &[u32; LANES]) -> Eight {
        match self {
            Self::Portable => portable(|lane| &patches[ids[lane] as usize], origin, cells),
            #[cfg(target_arch = "x86_64")]
            // SAFETY: the processor has AVX2, by the invariant of the variant.
            Self::Avx2 => unsafe { avx2::gathered(patches, ids, origin, cells) },
        }
    }

    /// Eight cells against one patch.
    #[inline]
    pub(super) fn broadcast(self, patch: &Patch, origin: [i32; 3], cells: &[u32; LANES]) -> Eight {
        match self {
            Self::Portable => portable(|_| patch, origin, cells),
            #[cfg(target_arch = "x86_64")]
            // SAFETY: as above.
            Self::Avx2 => unsafe { avx2::broadcast(patch, origin, cells) },
        }
    }

    /// Cells whose layer is ±`layer`.
    #[inline]
    pub(super) fn cells_on_layer(self, values: &[i8; BRICK_CELLS], layer: i8) -> Mask {
        match self {
            Self::Portable => core::array::from_fn(|x| {
                let word = &values[x * 64..(x + 1) * 64];
                word.iter().enumerate().fold(0, |bits, (bit, value)| bits | u64::from(value.abs() == layer) << bit)
            }),
            #[cfg(target_arch = "x86_64")]
            // SAFETY: as above.
            Self::Avx2 => unsafe { avx2::cells_on_layer(values, layer) },
        }
    }
}

fn portable<'a>(patch_of: impl Fn(usize) -> &'a Patch, origin: [i32; 3], cells: &[u32; LANES]) -> Eight {
    let mut eight = Eight::default();
    for (lane, inside) in cells.iter().enumerate() {
        let patch = patch_of(lane);
        let (anchor, inside) = (patch.anchor(), *inside as i32);
        let cell = [inside >> 6, inside >> 3 & 7, inside & 7];
        let way = [0, 1, 2].map(|axis| (origin[axis] + cell[axis] - anchor[axis]) as f32 - patch.number(2 + axis));
        let Nearest { squared, height, on_edge } = nearest(&Flat::new(core::array::from_fn(|k| patch.number(5 + k))), way);
        (eight.squared[lane], eight.height[lane]) = (squared, height);
        for (bits, [edge, limit]) in eight.on_edge.iter_mut().zip(on_edge) {
            *bits |= u8::from(edge <= limit) << lane;
        }
    }
    eight
}

impl Number for f32 {
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self + other
    }
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self - other
    }
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self * other
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        if self < other { self } else { other }
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        if self > other { self } else { other }
    }
    #[inline(always)]
    fn splat(value: f32) -> Self {
        value
    }
    #[inline(always)]
    fn zero_where_all_positive(self, [a, b, c]: [Self; 3]) -> Self {
        if a > 0.0 && b > 0.0 && c > 0.0 { 0.0 } else { self }
    }
}

#[cfg(target_arch = "x86_64")]
mod avx2 {
    use core::arch::x86_64::*;

    use super::*;

    /// Invariant of every `unsafe` block here: only the functions of this module that are compiled for AVX2 use these.
    impl Number for __m256 {
        #[inline(always)]
        fn add(self, other: Self) -> Self {
            // SAFETY: see above; likewise below.
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
        fn max(self, other: Self) -> Self {
            // SAFETY: as above.
            unsafe { _mm256_max_ps(self, other) }
        }
        #[inline(always)]
        fn splat(value: f32) -> Self {
            // SAFETY: as above.
            unsafe { _mm256_set1_ps(value) }
        }
        #[inline(always)]
        fn zero_where_all_positive(self, [a, b, c]: [Self; 3]) -> Self {
            // SAFETY: as above.
            unsafe {
                let zero = _mm256_setzero_ps();
                let a = _mm256_cmp_ps::<_CMP_GT_OQ>(a, zero);
                let b = _mm256_cmp_ps::<_CMP_GT_OQ>(b, zero);
                let c = _mm256_cmp_ps::<_CMP_GT_OQ>(c, zero);
                _mm256_andnot_ps(_mm256_and_ps(_mm256_and_ps(a, b), c), self)
            }
        }
    }

    #[target_feature(enable = "avx2")]
    pub(super) fn gathered(patches: &[Patch], ids: &[u32; LANES], origin: [i32; 3], cells: &[u32; LANES]) -> Eight {
        let rows: [&Patch; LANES] = [
            &patches[ids[0] as usize],
            &patches[ids[1] as usize],
            &patches[ids[2] as usize],
            &patches[ids[3] as usize],
            &patches[ids[4] as usize],
            &patches[ids[5] as usize],
            &patches[ids[6] as usize],
            &patches[ids[7] as usize],
        ];
        let [w0, w1, w2, w3] = transposed::<0>(&rows);
        let [w4, w5, w6, w7] = transposed::<4>(&rows);
        let [w8, w9, w10, w11] = transposed::<8>(&rows);
        let [w12, w13, w14, w15] = transposed::<12>(&rows);
        let way = way([_mm256_castps_si256(w0), _mm256_castps_si256(w1)], [w2, w3, w4], origin, cells);
        finish(&nearest(&Flat::new([w5, w6, w7, w8, w9, w10, w11, w12, w13, w14, w15]), way))
    }

    #[target_feature(enable = "avx2")]
    pub(super) fn broadcast(patch: &Patch, origin: [i32; 3], cells: &[u32; LANES]) -> Eight {
        let mut words = [_mm256_setzero_ps(); 16];
        for (k, word) in words.iter_mut().enumerate() {
            *word = _mm256_set1_ps(f32::from_bits(patch.words[k]));
        }
        let [w0, w1, w2, w3, w4, rest @ ..] = words;
        let way = way([_mm256_castps_si256(w0), _mm256_castps_si256(w1)], [w2, w3, w4], origin, cells);
        finish(&nearest(&Flat::new(rest), way))
    }

    #[target_feature(enable = "avx2")]
    pub(super) fn cells_on_layer(values: &[i8; BRICK_CELLS], layer: i8) -> Mask {
        let layer = _mm256_set1_epi8(layer);
        let mut mask = [0; 8];
        for (half, values) in values.as_chunks::<32>().0.iter().enumerate() {
            // SAFETY: 32 bytes are read from an array of 32.
            let values = unsafe { _mm256_loadu_si256(values.as_ptr().cast()) };
            let equal = _mm256_movemask_epi8(_mm256_cmpeq_epi8(_mm256_abs_epi8(values), layer));
            mask[half / 2] |= u64::from(equal as u32) << (32 * (half % 2));
        }
        mask
    }

    /// Words `FIRST` to `FIRST + 3` of eight patches: one register per word.
    #[target_feature(enable = "avx2")]
    #[inline]
    fn transposed<const FIRST: usize>(rows: &[&Patch; LANES]) -> [__m256; 4] {
        let low01 = _mm256_unpacklo_ps(pair::<FIRST>(rows, 0), pair::<FIRST>(rows, 1));
        let high01 = _mm256_unpackhi_ps(pair::<FIRST>(rows, 0), pair::<FIRST>(rows, 1));
        let low23 = _mm256_unpacklo_ps(pair::<FIRST>(rows, 2), pair::<FIRST>(rows, 3));
        let high23 = _mm256_unpackhi_ps(pair::<FIRST>(rows, 2), pair::<FIRST>(rows, 3));
        [
            _mm256_shuffle_ps::<0x44>(low01, low23),
            _mm256_shuffle_ps::<0xee>(low01, low23),
            _mm256_shuffle_ps::<0x44>(high01, high23),
            _mm256_shuffle_ps::<0xee>(high01, high23),
        ]
    }

    /// Four words of patch `lane` and the same of patch `lane + 4`.
    #[target_feature(enable = "avx2")]
    #[inline]
    fn pair<const FIRST: usize>(rows: &[&Patch; LANES], lane: usize) -> __m256 {
        const { assert!(FIRST + 4 <= 16) };
        // SAFETY: the sixteen words hold four from `FIRST` on.
        let (low, high) = unsafe {
            (
                _mm_loadu_ps(rows[lane].words.as_ptr().add(FIRST).cast()),
                _mm_loadu_ps(rows[lane + 4].words.as_ptr().add(FIRST).cast()),
            )
        };
        _mm256_insertf128_ps::<1>(_mm256_castps128_ps256(low), high)
    }

    /// Ways from first corners to cell centres. Whole cells are subtracted as whole numbers, which is exact.
    #[target_feature(enable = "avx2")]
    #[inline]
    fn way([xy, z]: [__m256i; 2], offset: [__m256; 3], origin: [i32; 3], cells: &[u32; LANES]) -> [__m256; 3] {
        // SAFETY: the array holds eight words.
        let inside = unsafe { _mm256_loadu_si256(cells.as_ptr().cast()) };
        let (low_half, seven) = (_mm256_set1_epi32(0xffff), _mm256_set1_epi32(7));
        let x = _mm256_sub_epi32(_mm256_srli_epi32::<6>(inside), _mm256_and_si256(xy, low_half));
        let y = _mm256_sub_epi32(_mm256_and_si256(_mm256_srli_epi32::<3>(inside), seven), _mm256_srli_epi32::<16>(xy));
        let z = _mm256_sub_epi32(_mm256_and_si256(inside, seven), _mm256_and_si256(z, low_half));
        [
            _mm256_sub_ps(_mm256_cvtepi32_ps(_mm256_add_epi32(x, _mm256_set1_epi32(origin[0]))), offset[0]),
            _mm256_sub_ps(_mm256_cvtepi32_ps(_mm256_add_epi32(y, _mm256_set1_epi32(origin[1]))), offset[1]),
            _mm256_sub_ps(_mm256_cvtepi32_ps(_mm256_add_epi32(z, _mm256_set1_epi32(origin[2]))), offset[2]),
        ]
    }

    #[target_feature(enable = "avx2")]
    #[inline]
    fn finish(found: &Nearest<__m256>) -> Eight {
        let mut eight = Eight::default();
        // SAFETY: the arrays hold eight numbers each.
        unsafe {
            _mm256_storeu_ps(eight.squared.as_mut_ptr(), found.squared);
            _mm256_storeu_ps(eight.height.as_mut_ptr(), found.height);
        }
        for (bits, [edge, limit]) in eight.on_edge.iter_mut().zip(&found.on_edge) {
            *bits = _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(*edge, *limit)) as u8;
        }
        eight
    }
}
