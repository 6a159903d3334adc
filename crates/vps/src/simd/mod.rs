//! Eight lanes: what the processor can do, and how a kernel is written once for all that it may be able to do.
//!
//! A [`Kernel`] is generic over its lanes. It has one instance that computes lane by lane and one with AVX2 instructions. Both do the
//! same operations in the same order with the same rounding (no fused multiply-add), so results do not depend on which of them ran.
//!
//! A kernel and everything generic that it calls is `#[inline(always)]`, so that it becomes part of the one function that is compiled
//! for AVX2. No operation on lanes stands in a closure: a closure is compiled for any processor, so its instructions would be called
//! and not inlined.

#![expect(unsafe_code, reason = "AVX2 intrinsics, and the call of code compiled for AVX2 after asking for it")]

#[cfg(target_arch = "x86_64")]
mod avx2;
mod portable;
#[cfg(test)]
mod tests;

use core::ops::{Add, BitAnd, BitOr, BitXor, Div, Mul, Sub};

/// Lanes of a kernel.
pub(crate) const LANES: usize = 8;
/// Blocks of points that a kernel fetches before their turn: what lies in the third cache is there in time.
pub(crate) const AHEAD: usize = 4;

/// Instructions that kernels are computed with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SimdLevel {
    /// Those that every processor of the architecture has.
    Portable,
    /// AVX2 as well. Made by [`SimdLevel::best`] only, which asks the processor.
    #[cfg(target_arch = "x86_64")]
    Avx2(HasAvx2),
}

/// Proof that the processor has AVX2.
#[cfg(target_arch = "x86_64")]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HasAvx2(());

impl SimdLevel {
    /// The fastest that this processor has.
    pub fn best() -> Self {
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2") {
            return Self::Avx2(HasAvx2(()));
        }
        Self::Portable
    }

    /// Runs a kernel.
    #[inline]
    pub(crate) fn run<K: Kernel>(self, kernel: K) -> K::Output {
        match self {
            Self::Portable => kernel.run::<portable::Lanes<f32>>(),
            #[cfg(target_arch = "x86_64")]
            // SAFETY: the processor has AVX2, of which `HasAvx2` is the proof.
            Self::Avx2(HasAvx2(())) => unsafe { avx2::run(kernel) },
        }
    }
}

/// Code that is compiled for each [`SimdLevel`], with its arguments.
pub(crate) trait Kernel {
    type Output;

    /// `#[inline(always)]` in every implementation.
    fn run<L: F32x8>(self) -> Self::Output;
}

/// Eight `f32`.
pub(crate) trait F32x8: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self> {
    type Int: I32x8;

    fn splat(value: f32) -> Self;
    fn of_int(int: Self::Int) -> Self;
    fn load(numbers: &[f32; LANES]) -> Self;
    fn store(self, numbers: &mut [f32; LANES]);
    /// The lesser; the second where either is NaN.
    fn min(self, other: Self) -> Self;
    /// The greater; the second where either is NaN.
    fn max(self, other: Self) -> Self;
    fn sqrt(self) -> Self;
    /// Greatest lane; no lane may be NaN.
    fn max_lane(self) -> f32;
    /// Rounded towards zero. NaN becomes 0, what no `i32` holds becomes the largest or the least `i32`, whatever its sign.
    fn truncated(self) -> Self::Int;
    /// A mask: where this is less.
    fn lt(self, other: Self) -> Self::Int;
    /// A mask: where this is no more.
    fn le(self, other: Self) -> Self::Int;
    /// The number where the mask holds, 0 elsewhere.
    fn only(self, mask: Self::Int) -> Self;
    /// `yes` where the mask holds, `no` elsewhere.
    fn select(mask: Self::Int, yes: Self, no: Self) -> Self;
    /// One number of the table per lane.
    ///
    /// # Safety
    /// Every lane of `at` is an index of the table.
    unsafe fn gather(table: &[f32], at: Self::Int) -> Self;
    /// Two neighbours of the table per lane: all the first ones, and all the second ones.
    ///
    /// # Safety
    /// `at` + `offset` and the number after it are indices of the table, in every lane.
    unsafe fn gather_pairs(table: &[f32], at: &[u32; LANES], offset: usize) -> (Self, Self);
}

/// Eight `i32` that wrap around, or a mask: −1 in lanes where it holds, 0 elsewhere.
pub(crate) trait I32x8:
    Copy + Add<Output = Self> + Mul<Output = Self> + BitAnd<Output = Self> + BitOr<Output = Self> + BitXor<Output = Self>
{
    fn splat(value: i32) -> Self;
    /// A mask that holds where the lane's bit is set.
    fn mask(bits: u8) -> Self;
    fn load(words: &[u32; LANES]) -> Self;
    fn store(self, words: &mut [u32; LANES]);
    fn first(self) -> i32;
    fn min(self, other: Self) -> Self;
    /// Divided by 2ⁿ, rounded down.
    fn shifted<const N: i32>(self) -> Self;
    /// A mask: where both are the same.
    fn eq(self, other: Self) -> Self;
    /// A mask: where this is greater.
    fn gt(self, other: Self) -> Self;
    /// `yes` where the mask holds, `no` elsewhere.
    fn select(mask: Self, yes: Self, no: Self) -> Self;
    /// One bit per lane of a mask.
    fn bits(self) -> u8;
    fn is_zero(self) -> bool;
    /// One word of the table per lane.
    ///
    /// # Safety
    /// Every lane of `at` is an index of the table.
    unsafe fn gather(table: &[u32], at: Self) -> Self;
}

/// Begins to bring a block of numbers into the first cache.
#[inline(always)]
pub(crate) fn prefetch<const N: usize>(numbers: &[f32; N]) {
    #[cfg(target_arch = "x86_64")]
    // SAFETY: SSE is part of every x86-64, and a prefetch reads nothing.
    unsafe {
        use core::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        _mm_prefetch::<_MM_HINT_T0>(numbers.as_ptr().cast());
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = numbers;
}

/// Sixteen numbers as the lanes of two.
#[inline(always)]
pub(crate) fn halves(numbers: &[f32; 2 * LANES]) -> &[[f32; LANES]; 2] {
    bytemuck::cast_ref(numbers)
}

/// The same to be written.
#[inline(always)]
pub(crate) fn halves_mut(numbers: &mut [f32; 2 * LANES]) -> &mut [[f32; LANES]; 2] {
    bytemuck::cast_mut(numbers)
}
