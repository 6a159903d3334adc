//! Eight lanes in two registers of aarch64, sixteen in four. Every processor of that architecture
//! has these instructions.

use core::arch::aarch64::*;

use super::twice::Twice;
use super::*;

#[derive(Clone, Copy)]
pub(super) struct Floats(float32x4_t, float32x4_t);

#[derive(Clone, Copy)]
pub(super) struct Ints(int32x4_t, int32x4_t);

macro_rules! operators {
    ($lanes:ident; $($operator:ident $function:ident $instruction:ident),*) => {$(
        impl $operator for $lanes {
            type Output = Self;
            #[inline(always)]
            fn $function(self, other: Self) -> Self {
                // SAFETY: part of every aarch64.
                unsafe { Self($instruction(self.0, other.0), $instruction(self.1, other.1)) }
            }
        }
    )*};
}
operators!(Floats; Add add vaddq_f32, Sub sub vsubq_f32, Mul mul vmulq_f32, Div div vdivq_f32);
operators!(Ints; Add add vaddq_s32, Mul mul vmulq_s32, BitAnd bitand vandq_s32, BitOr bitor vorrq_s32, BitXor bitxor veorq_s32);

/// Functions made of instructions.
macro_rules! instructions {
    ($(fn $name:ident $arguments:tt $(-> $result:ty)? { $($body:tt)* })*) => {$(
        #[inline(always)]
        fn $name $arguments $(-> $result)? {
            // SAFETY: part of every aarch64; arrays hold eight numbers.
            unsafe { $($body)* }
        }
    )*};
}

/// The greater of each, the second where either is NaN.
#[inline(always)]
fn greater(a: float32x4_t, b: float32x4_t) -> float32x4_t {
    // SAFETY: part of every aarch64.
    unsafe { vbslq_f32(vcgtq_f32(a, b), a, b) }
}

impl F32x8 for Floats {
    type Wide = Twice<Self>;
}

impl F32s<LANES> for Floats {
    type Int = Ints;

    instructions! {
        fn splat(value: f32) -> Self { Self(vdupq_n_f32(value), vdupq_n_f32(value)) }
        fn of_int(int: Ints) -> Self { Self(vcvtq_f32_s32(int.0), vcvtq_f32_s32(int.1)) }
        fn load(numbers: &[f32; LANES]) -> Self { Self(vld1q_f32(numbers.as_ptr()), vld1q_f32(numbers.as_ptr().add(4))) }
        fn store(self, numbers: &mut [f32; LANES]) {
            vst1q_f32(numbers.as_mut_ptr(), self.0);
            vst1q_f32(numbers.as_mut_ptr().add(4), self.1);
        }
        fn min(self, other: Self) -> Self {
            let lesser = [vcltq_f32(self.0, other.0), vcltq_f32(self.1, other.1)];
            Self(vbslq_f32(lesser[0], self.0, other.0), vbslq_f32(lesser[1], self.1, other.1))
        }
        fn sqrt(self) -> Self { Self(vsqrtq_f32(self.0), vsqrtq_f32(self.1)) }
        fn max_lane(self) -> f32 {
            let four = greater(self.0, self.1);
            let two = greater(four, vextq_f32::<2>(four, four));
            vgetq_lane_f32::<0>(greater(two, vextq_f32::<1>(two, two)))
        }
        fn truncated(self) -> Ints { Ints(vcvtq_s32_f32(self.0), vcvtq_s32_f32(self.1)) }
        fn lt(self, other: Self) -> Ints { Ints::of_masks(vcltq_f32(self.0, other.0), vcltq_f32(self.1, other.1)) }
        fn le(self, other: Self) -> Ints { Ints::of_masks(vcleq_f32(self.0, other.0), vcleq_f32(self.1, other.1)) }
        fn select(mask: Ints, yes: Self, no: Self) -> Self {
            let [low, high] = mask.masks();
            Self(vbslq_f32(low, yes.0, no.0), vbslq_f32(high, yes.1, no.1))
        }
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self(greater(self.0, other.0), greater(self.1, other.1))
    }

    #[inline(always)]
    fn only(self, mask: Ints) -> Self {
        Self::select(mask, self, Self::splat(0.0))
    }

    #[inline(always)]
    fn pick(pairs: [&[Pair; 2]; 4], at: Ints) -> (Ints, Self) {
        let mut lanes = [0; LANES];
        at.store(&mut lanes);
        let mut words = [0; LANES];
        let mut numbers = [0.0; LANES];
        for ((lane, word), number) in lanes.into_iter().zip(&mut words).zip(&mut numbers) {
            let [picked, bits] = pairs[lane as usize >> 1 & 3][lane as usize & 1];
            (*word, *number) = (picked, f32::from_bits(bits));
        }
        (Ints::load(&words), Self::load(&numbers))
    }

    #[inline(always)]
    unsafe fn gather(table: &[f32], at: Ints) -> Self {
        let mut lanes = [0; LANES];
        at.store(&mut lanes);
        // SAFETY: by the caller's promise.
        Self::load(&lanes.map(|lane| unsafe { *table.get_unchecked(lane as usize) }))
    }

    #[inline(always)]
    unsafe fn gather_pairs(table: &[f32], at: &[u32; LANES], offset: usize) -> (Self, Self) {
        let [a, b, c, d, e, f, g, h] = at.map(|at| at as usize + offset);
        let from = table.as_ptr();
        // SAFETY: by the caller's promise.
        unsafe {
            let ab = vcombine_f32(vld1_f32(from.add(a)), vld1_f32(from.add(b)));
            let cd = vcombine_f32(vld1_f32(from.add(c)), vld1_f32(from.add(d)));
            let ef = vcombine_f32(vld1_f32(from.add(e)), vld1_f32(from.add(f)));
            let gh = vcombine_f32(vld1_f32(from.add(g)), vld1_f32(from.add(h)));
            (
                Self(vuzp1q_f32(ab, cd), vuzp1q_f32(ef, gh)),
                Self(vuzp2q_f32(ab, cd), vuzp2q_f32(ef, gh)),
            )
        }
    }
}

impl Ints {
    instructions! {
        fn of_masks(low: uint32x4_t, high: uint32x4_t) -> Self { Self(vreinterpretq_s32_u32(low), vreinterpretq_s32_u32(high)) }
        fn masks(self) -> [uint32x4_t; 2] { [vreinterpretq_u32_s32(self.0), vreinterpretq_u32_s32(self.1)] }
    }
}

impl I32s<LANES> for Ints {
    instructions! {
        fn splat(value: i32) -> Self { Self(vdupq_n_s32(value), vdupq_n_s32(value)) }
        fn load(words: &[u32; LANES]) -> Self {
            Self::of_masks(vld1q_u32(words.as_ptr()), vld1q_u32(words.as_ptr().add(4)))
        }
        fn store(self, words: &mut [u32; LANES]) {
            let [low, high] = self.masks();
            vst1q_u32(words.as_mut_ptr(), low);
            vst1q_u32(words.as_mut_ptr().add(4), high);
        }
        fn first(self) -> i32 { vgetq_lane_s32::<0>(self.0) }
        fn min(self, other: Self) -> Self { Self(vminq_s32(self.0, other.0), vminq_s32(self.1, other.1)) }
        fn eq(self, other: Self) -> Self { Self::of_masks(vceqq_s32(self.0, other.0), vceqq_s32(self.1, other.1)) }
        fn gt(self, other: Self) -> Self { Self::of_masks(vcgtq_s32(self.0, other.0), vcgtq_s32(self.1, other.1)) }
        fn select(mask: Self, yes: Self, no: Self) -> Self {
            let [low, high] = mask.masks();
            Self(vbslq_s32(low, yes.0, no.0), vbslq_s32(high, yes.1, no.1))
        }
        fn bits(self) -> u32 {
            let [low, high] = (self & Self::load(&[1, 2, 4, 8, 16, 32, 64, 128])).masks();
            vaddvq_u32(vorrq_u32(low, high))
        }
        fn is_zero(self) -> bool {
            let [low, high] = self.masks();
            vmaxvq_u32(vorrq_u32(low, high)) == 0
        }
    }

    #[inline(always)]
    fn mask(bits: u32) -> Self {
        let each = Self::load(&[1, 2, 4, 8, 16, 32, 64, 128]);
        (Self::splat(bits as i32) & each).eq(each)
    }

    #[inline(always)]
    fn shifted<const BY: i32>(self) -> Self {
        // SAFETY: part of every aarch64.
        unsafe { Self(vshrq_n_s32::<BY>(self.0), vshrq_n_s32::<BY>(self.1)) }
    }

    #[inline(always)]
    unsafe fn gather(table: &[u32], at: Self) -> Self {
        let mut lanes = [0; LANES];
        at.store(&mut lanes);
        // SAFETY: by the caller's promise.
        Self::load(&lanes.map(|lane| unsafe { *table.get_unchecked(lane as usize) }))
    }
}
