//! All eight lanes in one register.
//!
//! Invariant of every `unsafe` block: only [`run`] names these types, so nothing of them runs on a processor without AVX2.

use core::arch::x86_64::*;

use super::*;

#[derive(Clone, Copy)]
struct Floats(__m256);

#[derive(Clone, Copy)]
struct Ints(__m256i);

#[target_feature(enable = "avx2")]
pub(super) fn run<K: Kernel>(kernel: K) -> K::Output {
    kernel.run::<Floats>()
}

macro_rules! operators {
    ($($lanes:ident: $operator:ident $function:ident $instruction:ident),*) => {$(
        impl $operator for $lanes {
            type Output = Self;
            #[inline(always)]
            fn $function(self, other: Self) -> Self {
                // SAFETY: by the invariant of the module.
                Self(unsafe { $instruction(self.0, other.0) })
            }
        }
    )*};
}
operators!(
    Floats: Add add _mm256_add_ps, Floats: Sub sub _mm256_sub_ps, Floats: Mul mul _mm256_mul_ps, Floats: Div div _mm256_div_ps,
    Ints: Add add _mm256_add_epi32, Ints: Mul mul _mm256_mullo_epi32,
    Ints: BitAnd bitand _mm256_and_si256, Ints: BitOr bitor _mm256_or_si256, Ints: BitXor bitxor _mm256_xor_si256
);

/// Functions made of instructions.
macro_rules! instructions {
    ($(fn $name:ident $arguments:tt $(-> $result:ty)? { $($body:tt)* })*) => {$(
        #[inline(always)]
        fn $name $arguments $(-> $result)? {
            // SAFETY: by the invariant of the module; arrays hold eight numbers.
            unsafe { $($body)* }
        }
    )*};
}

impl F32x8 for Floats {
    type Int = Ints;

    instructions! {
        fn splat(value: f32) -> Self { Self(_mm256_set1_ps(value)) }
        fn of_int(int: Ints) -> Self { Self(_mm256_cvtepi32_ps(int.0)) }
        fn load(numbers: &[f32; LANES]) -> Self { Self(_mm256_loadu_ps(numbers.as_ptr())) }
        fn store(self, numbers: &mut [f32; LANES]) { _mm256_storeu_ps(numbers.as_mut_ptr(), self.0) }
        fn min(self, other: Self) -> Self { Self(_mm256_min_ps(self.0, other.0)) }
        fn max(self, other: Self) -> Self { Self(_mm256_max_ps(self.0, other.0)) }
        fn sqrt(self) -> Self { Self(_mm256_sqrt_ps(self.0)) }
        fn max_lane(self) -> f32 {
            let four = _mm_max_ps(_mm256_castps256_ps128(self.0), _mm256_extractf128_ps::<1>(self.0));
            let two = _mm_max_ps(four, _mm_movehl_ps(four, four));
            _mm_cvtss_f32(_mm_max_ss(two, _mm_shuffle_ps::<1>(two, two)))
        }
        fn truncated(self) -> Ints {
            let is_number = _mm256_castps_si256(_mm256_cmp_ps::<_CMP_ORD_Q>(self.0, self.0));
            Ints(_mm256_and_si256(_mm256_cvttps_epi32(self.0), is_number))
        }
        fn lt(self, other: Self) -> Ints { Ints(_mm256_castps_si256(_mm256_cmp_ps::<_CMP_LT_OQ>(self.0, other.0))) }
        fn le(self, other: Self) -> Ints { Ints(_mm256_castps_si256(_mm256_cmp_ps::<_CMP_LE_OQ>(self.0, other.0))) }
        fn only(self, mask: Ints) -> Self { Self(_mm256_and_ps(self.0, _mm256_castsi256_ps(mask.0))) }
        fn select(mask: Ints, yes: Self, no: Self) -> Self {
            Self(_mm256_blendv_ps(no.0, yes.0, _mm256_castsi256_ps(mask.0)))
        }
    }

    #[inline(always)]
    unsafe fn gather(table: &[f32], at: Ints) -> Self {
        // SAFETY: by the invariant of the module and the caller's promise.
        Self(unsafe { _mm256_i32gather_ps::<4>(table.as_ptr(), at.0) })
    }

    /// Loads of 64 bits: with gathers the look-ups of points took 1.4 times as long (share of a profile).
    #[inline(always)]
    unsafe fn gather_pairs(table: &[f32], at: &[u32; LANES], offset: usize) -> (Self, Self) {
        let [a, b, c, d, e, f, g, h] = at.map(|at| at as usize + offset);
        // SAFETY: as above.
        unsafe {
            let pair = |at: usize| table.as_ptr().add(at).cast::<f64>().read_unaligned();
            let [ab, cd] = [_mm_setr_pd(pair(a), pair(b)), _mm_setr_pd(pair(c), pair(d))];
            let [ef, gh] = [_mm_setr_pd(pair(e), pair(f)), _mm_setr_pd(pair(g), pair(h))];
            let early = _mm256_castpd_ps(_mm256_set_m128d(ef, ab));
            let late = _mm256_castpd_ps(_mm256_set_m128d(gh, cd));
            let first = _mm256_shuffle_ps::<0b10_00_10_00>(early, late);
            (Self(first), Self(_mm256_shuffle_ps::<0b11_01_11_01>(early, late)))
        }
    }
}

impl I32x8 for Ints {
    instructions! {
        fn splat(value: i32) -> Self { Self(_mm256_set1_epi32(value)) }
        fn mask(bits: u8) -> Self {
            let each = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
            Self(_mm256_cmpeq_epi32(_mm256_and_si256(_mm256_set1_epi32(i32::from(bits)), each), each))
        }
        fn load(words: &[u32; LANES]) -> Self { Self(_mm256_loadu_si256(words.as_ptr().cast())) }
        fn store(self, words: &mut [u32; LANES]) { _mm256_storeu_si256(words.as_mut_ptr().cast(), self.0) }
        fn first(self) -> i32 { _mm256_cvtsi256_si32(self.0) }
        fn min(self, other: Self) -> Self { Self(_mm256_min_epi32(self.0, other.0)) }
        fn eq(self, other: Self) -> Self { Self(_mm256_cmpeq_epi32(self.0, other.0)) }
        fn gt(self, other: Self) -> Self { Self(_mm256_cmpgt_epi32(self.0, other.0)) }
        fn select(mask: Self, yes: Self, no: Self) -> Self { Self(_mm256_blendv_epi8(no.0, yes.0, mask.0)) }
        fn bits(self) -> u8 { _mm256_movemask_ps(_mm256_castsi256_ps(self.0)) as u8 }
        fn is_zero(self) -> bool { _mm256_testz_si256(self.0, self.0) == 1 }
    }

    #[inline(always)]
    fn shifted<const N: i32>(self) -> Self {
        // SAFETY: by the invariant of the module.
        Self(unsafe { _mm256_srai_epi32::<N>(self.0) })
    }

    #[inline(always)]
    unsafe fn gather(table: &[u32], at: Self) -> Self {
        // SAFETY: by the invariant of the module and the caller's promise.
        Self(unsafe { _mm256_i32gather_epi32::<4>(table.as_ptr().cast(), at.0) })
    }
}
