//! Eight or sixteen lanes: what the processor can do, and how a kernel is written once for all that
//! it may be able to do.
//!
//! A [`Kernel`] is generic over its lanes. It has one instance that computes lane by lane, one with
//! AVX2 instructions, and one with those of AVX-512; on aarch64 one with those of NEON. All do the
//! same operations in the same order with the same rounding (no fused multiply-add), so results do
//! not depend on which of them ran. Where a register holds eight lanes, sixteen are [two of
//! them](twice).
//!
//! A kernel and everything generic that it calls is `#[inline(always)]`, so that it becomes part of
//! the one function that is compiled for these instructions. No operation on lanes stands in a
//! closure: a closure is compiled for any processor, so its instructions would be called and not
//! inlined.

#![expect(
    unsafe_code,
    reason = "intrinsics, and the call of code compiled for them after asking for it"
)]

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
#[cfg(target_arch = "aarch64")]
mod neon;
mod portable;
#[cfg(test)]
mod tests;
mod twice;

use core::ops::{Add, BitAnd, BitOr, BitXor, Div, Mul, Sub};

/// Lanes of most kernels.
pub(crate) const LANES: usize = 8;
/// Lanes of kernels over blocks of points.
pub(crate) const WIDE: usize = 16;
/// Blocks of points that a kernel fetches before their turn: what lies in the third cache is there
/// in time.
pub(crate) const AHEAD: usize = 4;

/// Instructions that kernels are computed with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SimdLevel {
    /// Those that every processor of the architecture has.
    Portable,
    /// AVX2 as well. Made by [`SimdLevel::available`] only, which asks the processor.
    #[cfg(target_arch = "x86_64")]
    Avx2(Has),
    /// AVX-512 as well (F, VL, BW and DQ). Made by [`SimdLevel::available`] only, which asks the
    /// processor.
    #[cfg(target_arch = "x86_64")]
    Avx512(Has),
    /// Those of NEON.
    #[cfg(target_arch = "aarch64")]
    Neon,
}

#[cfg(target_arch = "x86_64")]
fn is_of_intel() -> bool {
    let vendor = core::arch::x86_64::__cpuid(0);
    [vendor.ebx, vendor.edx, vendor.ecx].map(u32::to_le_bytes).as_flattened() == b"GenuineIntel"
}

/// Proof that the processor has these instructions.
#[cfg(target_arch = "x86_64")]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Has(());

impl SimdLevel {
    /// The one to use on this processor: its widest, but for AVX-512 of Intel, whose clock goes
    /// down with it (docs/reference/measured.md).
    pub fn best() -> Self {
        #[cfg(target_arch = "x86_64")]
        let is_slower = |level: &Self| matches!(level, Self::Avx512(_)) && is_of_intel();
        #[cfg(not(target_arch = "x86_64"))]
        let is_slower = |_: &Self| false;
        Self::available().filter(|level| !is_slower(level)).last().unwrap_or(Self::Portable)
    }

    /// All that this processor has, from the narrowest to the widest.
    pub fn available() -> impl Iterator<Item = Self> {
        #[cfg(target_arch = "x86_64")]
        let more = {
            let has_avx2 = is_x86_feature_detected!("avx2");
            let has_avx512 = has_avx2
                && is_x86_feature_detected!("avx512f")
                && is_x86_feature_detected!("avx512vl")
                && is_x86_feature_detected!("avx512bw")
                && is_x86_feature_detected!("avx512dq");
            [has_avx2.then_some(Self::Avx2(Has(()))), has_avx512.then_some(Self::Avx512(Has(())))]
        };
        #[cfg(target_arch = "aarch64")]
        let more = [Some(Self::Neon)];
        #[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
        let more: [Option<Self>; 0] = [];
        core::iter::once(Self::Portable).chain(more.into_iter().flatten())
    }

    /// Runs a kernel.
    #[inline]
    pub(crate) fn run<K: Kernel>(self, kernel: K) -> K::Output {
        match self {
            Self::Portable => kernel.run::<portable::Floats>(),
            #[cfg(target_arch = "x86_64")]
            // SAFETY: the processor has AVX2, of which `Has` is the proof.
            Self::Avx2(Has(())) => unsafe { avx2::run(kernel) },
            #[cfg(target_arch = "x86_64")]
            // SAFETY: the processor has AVX-512, of which `Has` is the proof.
            Self::Avx512(Has(())) => unsafe { avx512::run(kernel) },
            #[cfg(target_arch = "aarch64")]
            Self::Neon => kernel.run::<neon::Floats>(),
        }
    }
}

/// Code that is compiled for each [`SimdLevel`], with its arguments.
pub(crate) trait Kernel {
    type Output;

    /// `#[inline(always)]` in every implementation.
    fn run<L: F32x8>(self) -> Self::Output;
}

/// Eight `f32`, and sixteen of the same level.
pub(crate) trait F32x8: F32s<8> {
    type Wide: F32s<16>;
}

/// A word, and the bits of a number.
pub(crate) type Pair = [u32; 2];

/// `N` lanes of `f32`.
pub(crate) trait F32s<const N: usize>:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self>
{
    type Int: I32s<N>;

    fn splat(value: f32) -> Self;
    fn of_int(int: Self::Int) -> Self;
    fn load(numbers: &[f32; N]) -> Self;
    fn store(self, numbers: &mut [f32; N]);
    /// The lesser; the second where either is NaN.
    fn min(self, other: Self) -> Self;
    /// The greater; the second where either is NaN.
    fn max(self, other: Self) -> Self;
    fn sqrt(self) -> Self;
    /// Greatest lane; no lane may be NaN.
    fn max_lane(self) -> f32;
    /// Rounded towards zero. NaN becomes 0, what no `i32` holds becomes the largest or the least
    /// `i32`, whatever its sign.
    fn truncated(self) -> Self::Int;

    /// Rounded down; else as [`Self::truncated`], but that what is too small for an `i32` may become
    /// the largest.
    #[inline(always)]
    fn floored(self) -> Self::Int {
        let truncated = self.truncated();
        // The mask is −1 where it holds.
        truncated + self.lt(Self::of_int(truncated))
    }

    /// A mask: where this is less.
    fn lt(self, other: Self) -> Self::Int;
    /// A mask: where this is no more.
    fn le(self, other: Self) -> Self::Int;
    /// The number where the mask holds, 0 elsewhere.
    fn only(self, mask: Self::Int) -> Self;
    /// `yes` where the mask holds, `no` elsewhere.
    fn select(mask: Self::Int, yes: Self, no: Self) -> Self;
    /// [`Self::packed`] and [`Self::unpacked`] take one instruction.
    const PACKS: bool = false;

    /// These lanes first, in their order, and `rest` in the others.
    #[inline(always)]
    fn packed(self, lanes: u32, rest: Self) -> Self {
        let [mut from, mut packed] = [[0.0; N]; 2];
        self.store(&mut from);
        rest.store(&mut packed);
        let mut to = packed.iter_mut();
        for (lane, number) in from.iter().enumerate() {
            if lanes >> lane & 1 == 1
                && let Some(to) = to.next()
            {
                *to = *number;
            }
        }
        Self::load(&packed)
    }
    /// The first lanes where these are, in their order, and 0 in the others.
    #[inline(always)]
    fn unpacked(self, lanes: u32) -> Self {
        let [mut packed, mut unpacked] = [[0.0; N]; 2];
        self.store(&mut packed);
        let mut from = packed.iter();
        for (lane, number) in unpacked.iter_mut().enumerate() {
            if lanes >> lane & 1 == 1
                && let Some(from) = from.next()
            {
                *number = *from;
            }
        }
        Self::load(&unpacked)
    }
    /// One of eight pairs per lane, by the lowest three bits of `at`: the words, and the numbers.
    fn pick(pairs: [&[Pair; 2]; 4], at: Self::Int) -> (Self::Int, Self);
    /// One number of the table per lane.
    ///
    /// # Safety
    /// Every lane of `at` is an index of the table.
    unsafe fn gather(table: &[f32], at: Self::Int) -> Self;
    /// Two neighbours of the table per lane: all the first ones, and all the second ones.
    ///
    /// # Safety
    /// `at` + `offset` and the number after it are indices of the table, in every lane.
    unsafe fn gather_pairs(table: &[f32], at: &[u32; N], offset: usize) -> (Self, Self);
}

/// `N` lanes of `i32` that wrap around, or a mask: −1 in lanes where it holds, 0 elsewhere.
pub(crate) trait I32s<const N: usize>:
    Copy
    + Add<Output = Self>
    + Mul<Output = Self>
    + BitAnd<Output = Self>
    + BitOr<Output = Self>
    + BitXor<Output = Self>
{
    fn splat(value: i32) -> Self;
    /// A mask that holds where the lane's bit is set.
    fn mask(bits: u32) -> Self;
    fn load(words: &[u32; N]) -> Self;
    fn store(self, words: &mut [u32; N]);
    fn first(self) -> i32;
    fn min(self, other: Self) -> Self;
    /// Divided by 2ⁿ, rounded down.
    fn shifted<const BY: i32>(self) -> Self;
    /// A mask: where both are the same.
    fn eq(self, other: Self) -> Self;
    /// A mask: where this is greater.
    fn gt(self, other: Self) -> Self;
    /// `yes` where the mask holds, `no` elsewhere.
    fn select(mask: Self, yes: Self, no: Self) -> Self;
    /// One bit per lane of a mask.
    fn bits(self) -> u32;
    /// Those of the first eight lanes.
    #[inline(always)]
    fn byte(self) -> u8 {
        self.bits() as u8
    }
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
