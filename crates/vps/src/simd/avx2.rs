//! All eight lanes in one register, sixteen in two.
//!
//! Invariant of every `unsafe` block: only [`run`], and that of AVX-512, name these types, so
//! nothing of them runs on a processor without AVX2.

use core::arch::x86_64::*;
use core::marker::PhantomData;

use super::twice::Twice;
use super::*;

/// What sixteen lanes are beside these eight.
pub(super) trait Width: Copy {
    type Wide: F32s<WIDE>;
}

/// Two registers.
#[derive(Clone, Copy)]
struct TwoRegisters;

impl Width for TwoRegisters {
    type Wide = Twice<Floats<Self>>;
}

#[derive(Clone, Copy)]
pub(super) struct Floats<W>(pub(super) __m256, PhantomData<W>);

#[derive(Clone, Copy)]
pub(super) struct Ints(__m256i);

/// The words and the numbers of eight pairs.
#[inline(always)]
pub(super) fn unzipped(pairs: [&[Pair; 2]; 4]) -> (__m256, __m256) {
    // SAFETY: by the invariant of the module; each is sixteen bytes.
    unsafe {
        let [a, b, c, d] = [
            _mm_loadu_ps(pairs[0].as_ptr().cast()),
            _mm_loadu_ps(pairs[1].as_ptr().cast()),
            _mm_loadu_ps(pairs[2].as_ptr().cast()),
            _mm_loadu_ps(pairs[3].as_ptr().cast()),
        ];
        let words = _mm256_set_m128(
            _mm_shuffle_ps::<0b10_00_10_00>(c, d),
            _mm_shuffle_ps::<0b10_00_10_00>(a, b),
        );
        (
            words,
            _mm256_set_m128(
                _mm_shuffle_ps::<0b11_01_11_01>(c, d),
                _mm_shuffle_ps::<0b11_01_11_01>(a, b),
            ),
        )
    }
}

impl<W> Floats<W> {
    #[inline(always)]
    fn of(register: __m256) -> Self {
        Self(register, PhantomData)
    }
}

#[target_feature(enable = "avx2")]
pub(super) fn run<K: Kernel>(kernel: K) -> K::Output {
    kernel.run::<Floats<TwoRegisters>>()
}

macro_rules! operators {
    ($parameter:tt $lanes:ty, $of:expr; $($operator:ident $function:ident $instruction:ident),*) => {
        $($crate::simd::avx2::operators!(@one $parameter $lanes, $of; $operator $function $instruction);)*
    };
    (@one [$($parameter:ident)?] $lanes:ty, $of:expr; $operator:ident $function:ident $instruction:ident) => {
        impl$(<$parameter>)? $operator for $lanes {
            type Output = Self;
            #[inline(always)]
            fn $function(self, other: Self) -> Self {
                // SAFETY: by the invariant of the module.
                $of(unsafe { $instruction(self.0, other.0) })
            }
        }
    };
}
pub(super) use operators;
operators!([W] Floats<W>, Self::of; Add add _mm256_add_ps, Sub sub _mm256_sub_ps, Mul mul _mm256_mul_ps, Div div _mm256_div_ps);
operators!(
    [] Ints, Self; Add add _mm256_add_epi32, Mul mul _mm256_mullo_epi32,
    BitAnd bitand _mm256_and_si256, BitOr bitor _mm256_or_si256, BitXor bitxor _mm256_xor_si256
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
pub(super) use instructions;

impl<W: Width> F32x8 for Floats<W> {
    type Wide = W::Wide;
}

impl<W: Copy> F32s<LANES> for Floats<W> {
    type Int = Ints;

    instructions! {
        fn splat(value: f32) -> Self { Self::of(_mm256_set1_ps(value)) }
        fn of_int(int: Ints) -> Self { Self::of(_mm256_cvtepi32_ps(int.0)) }
        fn load(numbers: &[f32; LANES]) -> Self { Self::of(_mm256_loadu_ps(numbers.as_ptr())) }
        fn store(self, numbers: &mut [f32; LANES]) { _mm256_storeu_ps(numbers.as_mut_ptr(), self.0) }
        fn min(self, other: Self) -> Self { Self::of(_mm256_min_ps(self.0, other.0)) }
        fn max(self, other: Self) -> Self { Self::of(_mm256_max_ps(self.0, other.0)) }
        fn sqrt(self) -> Self { Self::of(_mm256_sqrt_ps(self.0)) }
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
        fn only(self, mask: Ints) -> Self { Self::of(_mm256_and_ps(self.0, _mm256_castsi256_ps(mask.0))) }
        fn pick(pairs: [&[Pair; 2]; 4], at: Ints) -> (Ints, Self) {
            let (words, numbers) = unzipped(pairs);
            let words = _mm256_permutevar8x32_epi32(_mm256_castps_si256(words), at.0);
            (Ints(words), Self::of(_mm256_permutevar8x32_ps(numbers, at.0)))
        }
        fn select(mask: Ints, yes: Self, no: Self) -> Self {
            Self::of(_mm256_blendv_ps(no.0, yes.0, _mm256_castsi256_ps(mask.0)))
        }
    }

    #[inline(always)]
    unsafe fn gather(table: &[f32], at: Ints) -> Self {
        // SAFETY: by the invariant of the module and the caller's promise.
        Self::of(unsafe { _mm256_i32gather_ps::<4>(table.as_ptr(), at.0) })
    }

    /// Loads of 64 bits: with gathers the look-ups of points took 1.4 times as long (share of a
    /// profile).
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
            (Self::of(first), Self::of(_mm256_shuffle_ps::<0b11_01_11_01>(early, late)))
        }
    }
}

impl I32s<LANES> for Ints {
    instructions! {
        fn splat(value: i32) -> Self { Self(_mm256_set1_epi32(value)) }
        fn mask(bits: u32) -> Self {
            let each = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
            Self(_mm256_cmpeq_epi32(_mm256_and_si256(_mm256_set1_epi32(bits as i32), each), each))
        }
        fn load(words: &[u32; LANES]) -> Self { Self(_mm256_loadu_si256(words.as_ptr().cast())) }
        fn store(self, words: &mut [u32; LANES]) { _mm256_storeu_si256(words.as_mut_ptr().cast(), self.0) }
        fn first(self) -> i32 { _mm256_cvtsi256_si32(self.0) }
        fn min(self, other: Self) -> Self { Self(_mm256_min_epi32(self.0, other.0)) }
        fn eq(self, other: Self) -> Self { Self(_mm256_cmpeq_epi32(self.0, other.0)) }
        fn gt(self, other: Self) -> Self { Self(_mm256_cmpgt_epi32(self.0, other.0)) }
        fn select(mask: Self, yes: Self, no: Self) -> Self { Self(_mm256_blendv_epi8(no.0, yes.0, mask.0)) }
        fn bits(self) -> u32 { _mm256_movemask_ps(_mm256_castsi256_ps(self.0)) as u32 }
        fn is_zero(self) -> bool { _mm256_testz_si256(self.0, self.0) == 1 }
    }

    #[inline(always)]
    fn shifted<const BY: i32>(self) -> Self {
        // SAFETY: by the invariant of the module.
        Self(unsafe { _mm256_srai_epi32::<BY>(self.0) })
    }

    #[inline(always)]
    unsafe fn gather(table: &[u32], at: Self) -> Self {
        // SAFETY: by the invariant of the module and the caller's promise.
        Self(unsafe { _mm256_i32gather_epi32::<4>(table.as_ptr().cast(), at.0) })
    }
}
