//! The kernel's arithmetic, eight cells at a time where the processor can.
//!
//! One generic source, two instances: one takes lanes one by one, the other all eight at once with AVX2. Both do the same
//! operations in the same order with the same rounding (no fused multiply-add), so results do not depend on which of them ran.

#![expect(unsafe_code, reason = "AVX2 intrinsics, and the call of code compiled for AVX2 after asking for it")]

use super::kernel::{Flat, Nearest, Number, nearest};
use super::patches::Patch;

/// Cells measured together.
pub(super) const LANES: usize = 8;

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

/// A patch must be nearer by this share to replace another: rounding must not decide which of two that tie is found first.
const NEARER: f32 = 1.0 - 1e-6;
/// Patches that are further away by no more than this share are as near, for a corner is equally far on all patches around it.
const PLATEAU: f32 = 1.0 + 1e-5;
/// The same next to the surface, cells².
const PLATEAU_CELLS_SQUARED: f32 = 1e-9;

/// Eight cells at the corners of a cube.
#[derive(Clone, Copy)]
pub(super) struct Cube {
    /// The first of them.
    pub(super) base: [i32; 3],
    /// From one to the next, cells.
    pub(super) step: i32,
}

/// The nearest patches of eight cells so far.
#[derive(Clone, Copy)]
pub(super) struct NearestOfEight {
    /// Cells².
    pub(super) squared: [f32; LANES],
    pub(super) patch_idx: [u32; LANES],
}

/// A patch as seen by eight cells.
#[derive(Clone, Copy, Default)]
pub(super) struct Measured {
    /// Cells².
    pub(super) squared: [f32; LANES],
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

    /// Eight cells at the corners of a cube against one patch, which replaces the nearest of those that it is nearer to. Lane
    /// x·4 + y·2 + z is the cell `base + step·[x, y, z]`.
    #[inline]
    pub(super) fn group(self, patch: &Patch, patch_idx: u32, cube: Cube, nearest: &mut NearestOfEight, measured: &mut Measured) {
        match self {
            Self::Portable => {
                let [x, y, z] = cube.base;
                let eight = portable(patch, |lane| {
                    let lane = lane as i32;
                    [x + cube.step * (lane >> 2), y + cube.step * (lane >> 1 & 1), z + cube.step * (lane & 1)]
                });
                for lane in 0..LANES {
                    if eight.squared[lane] < nearest.squared[lane] * NEARER {
                        (nearest.squared[lane], nearest.patch_idx[lane]) = (eight.squared[lane], patch_idx);
                    }
                }
                *measured = Measured { squared: eight.squared, on_edge: eight.on_edge };
            }
            #[cfg(target_arch = "x86_64")]
            // SAFETY: the processor has AVX2, by the invariant of the variant.
            Self::Avx2 => unsafe { avx2::group(patch, patch_idx, cube, nearest, measured) },
        }
    }

    /// Runs plain code compiled for the processor: the same operations, only more at once.
    #[inline]
    pub(super) fn run<R>(self, code: impl FnOnce() -> R) -> R {
        match self {
            Self::Portable => code(),
            #[cfg(target_arch = "x86_64")]
            // SAFETY: as above.
            Self::Avx2 => unsafe { avx2::run(code) },
        }
    }

    /// Cells that are as near to a patch as to their nearest, one bit each.
    #[inline]
    pub(super) fn on_plateau(self, squared: &[f32; LANES], nearest: &NearestOfEight) -> u8 {
        match self {
            Self::Portable => (0..LANES).fold(0, |near, lane| {
                near | u8::from(squared[lane] <= nearest.squared[lane] * PLATEAU + PLATEAU_CELLS_SQUARED) << lane
            }),
            #[cfg(target_arch = "x86_64")]
            // SAFETY: as above.
            Self::Avx2 => unsafe { avx2::on_plateau(squared, nearest) },
        }
    }

    /// Eight cells of the brick at `origin`, by their numbers inside, against one patch.
    #[inline]
    pub(super) fn broadcast(self, patch: &Patch, origin: [i32; 3], cells: &[u32; LANES]) -> Eight {
        match self {
            Self::Portable => portable(patch, |lane| {
                let inside = cells[lane] as i32;
                [origin[0] + (inside >> 6), origin[1] + (inside >> 3 & 7), origin[2] + (inside & 7)]
            }),
            #[cfg(target_arch = "x86_64")]
            // SAFETY: as above.
            Self::Avx2 => unsafe { avx2::broadcast(patch, origin, cells) },
        }
    }
}

fn portable(patch: &Patch, cell_of: impl Fn(usize) -> [i32; 3]) -> Eight {
    let mut eight = Eight::default();
    let anchor = patch.anchor();
    for lane in 0..LANES {
        let cell = cell_of(lane);
        let way = [0, 1, 2].map(|axis| (cell[axis] - anchor[axis]) as f32 - patch.number(2 + axis));
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
    pub(super) fn group(patch: &Patch, patch_idx: u32, cube: Cube, so_far: &mut NearestOfEight, measured: &mut Measured) {
        let (anchor, step) = (patch.anchor(), cube.step);
        let [x, y, z] = [0, 1, 2].map(|axis| _mm256_set1_epi32(cube.base[axis] - anchor[axis]));
        let x = _mm256_add_epi32(x, _mm256_setr_epi32(0, 0, 0, 0, step, step, step, step));
        let y = _mm256_add_epi32(y, _mm256_setr_epi32(0, 0, step, step, 0, 0, step, step));
        let z = _mm256_add_epi32(z, _mm256_setr_epi32(0, step, 0, step, 0, step, 0, step));
        let word = |k: usize| _mm256_set1_ps(f32::from_bits(patch.words[k]));
        let way = [
            _mm256_sub_ps(_mm256_cvtepi32_ps(x), word(2)),
            _mm256_sub_ps(_mm256_cvtepi32_ps(y), word(3)),
            _mm256_sub_ps(_mm256_cvtepi32_ps(z), word(4)),
        ];
        let flat = [word(5), word(6), word(7), word(8), word(9), word(10), word(11), word(12), word(13), word(14), word(15)];
        let found = nearest(&Flat::new(flat), way);
        // SAFETY: every array holds eight numbers.
        unsafe {
            let squared = _mm256_loadu_ps(so_far.squared.as_ptr());
            let patches = _mm256_loadu_ps(so_far.patch_idx.as_ptr().cast());
            let is_nearer = _mm256_cmp_ps::<_CMP_LT_OQ>(found.squared, _mm256_mul_ps(squared, _mm256_set1_ps(NEARER)));
            let own = _mm256_castsi256_ps(_mm256_set1_epi32(patch_idx as i32));
            _mm256_storeu_ps(so_far.squared.as_mut_ptr(), _mm256_blendv_ps(squared, found.squared, is_nearer));
            _mm256_storeu_ps(so_far.patch_idx.as_mut_ptr().cast(), _mm256_blendv_ps(patches, own, is_nearer));
            _mm256_storeu_ps(measured.squared.as_mut_ptr(), found.squared);
        }
        for (bits, [edge, limit]) in measured.on_edge.iter_mut().zip(&found.on_edge) {
            *bits = _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(*edge, *limit)) as u8;
        }
    }

    #[target_feature(enable = "avx2")]
    pub(super) fn run<R>(code: impl FnOnce() -> R) -> R {
        code()
    }

    #[target_feature(enable = "avx2")]
    pub(super) fn on_plateau(squared: &[f32; LANES], so_far: &NearestOfEight) -> u8 {
        // SAFETY: both arrays hold eight numbers.
        let (squared, nearest) = unsafe { (_mm256_loadu_ps(squared.as_ptr()), _mm256_loadu_ps(so_far.squared.as_ptr())) };
        let limit = _mm256_add_ps(_mm256_mul_ps(nearest, _mm256_set1_ps(PLATEAU)), _mm256_set1_ps(PLATEAU_CELLS_SQUARED));
        _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(squared, limit)) as u8
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
