//! All sixteen lanes in one register; eight are those of AVX2, with twice as many registers.
//!
//! Invariant of every `unsafe` block: only [`run`] names these types, so nothing of them runs on a
//! processor without AVX-512.

use core::arch::x86_64::*;

use super::avx2::{self, Width, instructions, operators, unzipped};
use super::*;

/// One register.
#[derive(Clone, Copy)]
struct OneRegister;

impl Width for OneRegister {
    type Wide = Floats;
}

#[derive(Clone, Copy)]
struct Floats(__m512);

#[derive(Clone, Copy)]
struct Ints(__m512i);

#[target_feature(enable = "avx2,avx512f,avx512vl,avx512bw,avx512dq")]
pub(super) fn run<K: Kernel>(kernel: K) -> K::Output {
    kernel.run::<avx2::Floats<OneRegister>>()
}

operators!([] Floats, Self; Add add _mm512_add_ps, Sub sub _mm512_sub_ps, Mul mul _mm512_mul_ps, Div div _mm512_div_ps);
operators!(
    [] Ints, Self; Add add _mm512_add_epi32, Mul mul _mm512_mullo_epi32,
    BitAnd bitand _mm512_and_si512, BitOr bitor _mm512_or_si512, BitXor bitxor _mm512_xor_si512
);

impl F32s<WIDE> for Floats {
    type Int = Ints;
    const PACKS: bool = true;

    instructions! {
        fn splat(value: f32) -> Self { Self(_mm512_set1_ps(value)) }
        fn of_int(int: Ints) -> Self { Self(_mm512_cvtepi32_ps(int.0)) }
        fn load(numbers: &[f32; WIDE]) -> Self { Self(_mm512_loadu_ps(numbers.as_ptr())) }
        fn store(self, numbers: &mut [f32; WIDE]) { _mm512_storeu_ps(numbers.as_mut_ptr(), self.0) }
        fn min(self, other: Self) -> Self { Self(_mm512_min_ps(self.0, other.0)) }
        fn max(self, other: Self) -> Self { Self(_mm512_max_ps(self.0, other.0)) }
        fn sqrt(self) -> Self { Self(_mm512_sqrt_ps(self.0)) }
        fn max_lane(self) -> f32 {
            let eight = _mm256_max_ps(_mm512_castps512_ps256(self.0), _mm512_extractf32x8_ps::<1>(self.0));
            let four = _mm_max_ps(_mm256_castps256_ps128(eight), _mm256_extractf128_ps::<1>(eight));
            let two = _mm_max_ps(four, _mm_movehl_ps(four, four));
            _mm_cvtss_f32(_mm_max_ss(two, _mm_shuffle_ps::<1>(two, two)))
        }
        fn truncated(self) -> Ints {
            let is_number = _mm512_cmp_ps_mask::<_CMP_ORD_Q>(self.0, self.0);
            Ints(_mm512_maskz_cvttps_epi32(is_number, self.0))
        }
        fn floored(self) -> Ints {
            let is_number = _mm512_cmp_ps_mask::<_CMP_ORD_Q>(self.0, self.0);
            const DOWN: i32 = _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC;
            Ints(_mm512_maskz_cvt_roundps_epi32::<DOWN>(is_number, self.0))
        }
        fn lt(self, other: Self) -> Ints { Ints(_mm512_movm_epi32(_mm512_cmp_ps_mask::<_CMP_LT_OQ>(self.0, other.0))) }
        fn le(self, other: Self) -> Ints { Ints(_mm512_movm_epi32(_mm512_cmp_ps_mask::<_CMP_LE_OQ>(self.0, other.0))) }
        fn only(self, mask: Ints) -> Self { Self(_mm512_maskz_mov_ps(_mm512_movepi32_mask(mask.0), self.0)) }
        fn pick(pairs: [&[Pair; 2]; 4], at: Ints) -> (Ints, Self) {
            let (words, numbers) = unzipped(pairs);
            let at = _mm512_and_si512(at.0, _mm512_set1_epi32(7));
            let words = _mm512_permutexvar_epi32(at, _mm512_castps_si512(_mm512_castps256_ps512(words)));
            (Ints(words), Self(_mm512_permutexvar_ps(at, _mm512_castps256_ps512(numbers))))
        }
        fn packed(self, lanes: u32, rest: Self) -> Self {
            Self(_mm512_mask_compress_ps(rest.0, lanes as u16, self.0))
        }
        fn unpacked(self, lanes: u32) -> Self { Self(_mm512_maskz_expand_ps(lanes as u16, self.0)) }
        fn select(mask: Ints, yes: Self, no: Self) -> Self { Self(_mm512_mask_blend_ps(_mm512_movepi32_mask(mask.0), no.0, yes.0)) }
    }

    #[inline(always)]
    unsafe fn gather(table: &[f32], at: Ints) -> Self {
        // SAFETY: by the invariant of the module and the caller's promise.
        Self(unsafe { _mm512_i32gather_ps::<4>(at.0, table.as_ptr()) })
    }

    /// Loads of 64 bits, as with AVX2.
    #[inline(always)]
    unsafe fn gather_pairs(table: &[f32], at: &[u32; WIDE], offset: usize) -> (Self, Self) {
        let [a, b, c, d, e, f, g, h, i, j, k, l, m, n, o, p] = at.map(|at| at as usize + offset);
        // SAFETY: as above.
        unsafe {
            let pair = |at: usize| table.as_ptr().add(at).cast::<f64>().read_unaligned();
            let [ab, cd] = [_mm_setr_pd(pair(a), pair(b)), _mm_setr_pd(pair(c), pair(d))];
            let [ef, gh] = [_mm_setr_pd(pair(e), pair(f)), _mm_setr_pd(pair(g), pair(h))];
            let [ij, kl] = [_mm_setr_pd(pair(i), pair(j)), _mm_setr_pd(pair(k), pair(l))];
            let [mn, op] = [_mm_setr_pd(pair(m), pair(n)), _mm_setr_pd(pair(o), pair(p))];
            let early = _mm512_insertf64x4::<1>(
                _mm512_castpd256_pd512(_mm256_set_m128d(ef, ab)),
                _mm256_set_m128d(mn, ij),
            );
            let late = _mm512_insertf64x4::<1>(
                _mm512_castpd256_pd512(_mm256_set_m128d(gh, cd)),
                _mm256_set_m128d(op, kl),
            );
            let early = _mm512_castpd_ps(early);
            let late = _mm512_castpd_ps(late);
            let first = _mm512_shuffle_ps::<0b10_00_10_00>(early, late);
            (Self(first), Self(_mm512_shuffle_ps::<0b11_01_11_01>(early, late)))
        }
    }
}

impl I32s<WIDE> for Ints {
    instructions! {
        fn splat(value: i32) -> Self { Self(_mm512_set1_epi32(value)) }
        fn mask(bits: u32) -> Self { Self(_mm512_movm_epi32(bits as u16)) }
        fn load(words: &[u32; WIDE]) -> Self { Self(_mm512_loadu_si512(words.as_ptr().cast())) }
        fn store(self, words: &mut [u32; WIDE]) { _mm512_storeu_si512(words.as_mut_ptr().cast(), self.0) }
        fn first(self) -> i32 { _mm_cvtsi128_si32(_mm512_castsi512_si128(self.0)) }
        fn min(self, other: Self) -> Self { Self(_mm512_min_epi32(self.0, other.0)) }
        fn eq(self, other: Self) -> Self { Self(_mm512_movm_epi32(_mm512_cmpeq_epi32_mask(self.0, other.0))) }
        fn gt(self, other: Self) -> Self { Self(_mm512_movm_epi32(_mm512_cmpgt_epi32_mask(self.0, other.0))) }
        fn select(mask: Self, yes: Self, no: Self) -> Self { Self(_mm512_mask_blend_epi32(_mm512_movepi32_mask(mask.0), no.0, yes.0)) }
        fn bits(self) -> u32 { _mm512_movepi32_mask(self.0).into() }
        fn is_zero(self) -> bool { _mm512_test_epi32_mask(self.0, self.0) == 0 }
    }

    #[inline(always)]
    fn shifted<const BY: i32>(self) -> Self {
        // SAFETY: by the invariant of the module. The same constant as a vector: the instruction
        // wants another type than that of AVX2.
        Self(unsafe { _mm512_srav_epi32(self.0, _mm512_set1_epi32(BY)) })
    }

    #[inline(always)]
    unsafe fn gather(table: &[u32], at: Self) -> Self {
        // SAFETY: by the invariant of the module and the caller's promise.
        Self(unsafe { _mm512_i32gather_epi32::<4>(at.0, table.as_ptr().cast()) })
    }
}
