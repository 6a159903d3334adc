//! Sixteen lanes where a register holds eight: the low eight and the high eight.

use super::*;

#[derive(Clone, Copy)]
pub(super) struct Twice<T>(T, T);

macro_rules! operators {
    ($($operator:ident $function:ident),*) => {$(
        impl<T: $operator<Output = T>> $operator for Twice<T> {
            type Output = Self;
            #[inline(always)]
            fn $function(self, other: Self) -> Self {
                Self(self.0.$function(other.0), self.1.$function(other.1))
            }
        }
    )*};
}
operators!(Add add, Sub sub, Mul mul, Div div, BitAnd bitand, BitOr bitor, BitXor bitxor);

#[inline(always)]
fn split<T: bytemuck::Pod>(all: &[T; WIDE]) -> &[[T; LANES]; 2] {
    bytemuck::cast_ref(all)
}

#[inline(always)]
fn split_mut<T: bytemuck::Pod>(all: &mut [T; WIDE]) -> &mut [[T; LANES]; 2] {
    bytemuck::cast_mut(all)
}

impl<T: F32x8> F32s<WIDE> for Twice<T> {
    type Int = Twice<T::Int>;

    #[inline(always)]
    fn splat(value: f32) -> Self {
        Self(T::splat(value), T::splat(value))
    }

    #[inline(always)]
    fn of_int(int: Self::Int) -> Self {
        Self(T::of_int(int.0), T::of_int(int.1))
    }

    #[inline(always)]
    fn load(numbers: &[f32; WIDE]) -> Self {
        let [low, high] = split(numbers);
        Self(T::load(low), T::load(high))
    }

    #[inline(always)]
    fn store(self, numbers: &mut [f32; WIDE]) {
        let [low, high] = split_mut(numbers);
        self.0.store(low);
        self.1.store(high);
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Self(self.0.min(other.0), self.1.min(other.1))
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self(self.0.max(other.0), self.1.max(other.1))
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(self.0.sqrt(), self.1.sqrt())
    }

    #[inline(always)]
    fn max_lane(self) -> f32 {
        self.0.max(self.1).max_lane()
    }

    #[inline(always)]
    fn truncated(self) -> Self::Int {
        Twice(self.0.truncated(), self.1.truncated())
    }

    #[inline(always)]
    fn lt(self, other: Self) -> Self::Int {
        Twice(self.0.lt(other.0), self.1.lt(other.1))
    }

    #[inline(always)]
    fn le(self, other: Self) -> Self::Int {
        Twice(self.0.le(other.0), self.1.le(other.1))
    }

    #[inline(always)]
    fn only(self, mask: Self::Int) -> Self {
        Self(self.0.only(mask.0), self.1.only(mask.1))
    }

    #[inline(always)]
    fn pick(pairs: [&[Pair; 2]; 4], at: Self::Int) -> (Self::Int, Self) {
        let low = T::pick(pairs, at.0);
        let high = T::pick(pairs, at.1);
        (Twice(low.0, high.0), Self(low.1, high.1))
    }

    #[inline(always)]
    fn select(mask: Self::Int, yes: Self, no: Self) -> Self {
        Self(T::select(mask.0, yes.0, no.0), T::select(mask.1, yes.1, no.1))
    }

    #[inline(always)]
    unsafe fn gather(table: &[f32], at: Self::Int) -> Self {
        // SAFETY: by the caller's promise.
        unsafe { Self(T::gather(table, at.0), T::gather(table, at.1)) }
    }

    #[inline(always)]
    unsafe fn gather_pairs(table: &[f32], at: &[u32; WIDE], offset: usize) -> (Self, Self) {
        let [low, high] = split(at);
        // SAFETY: by the caller's promise.
        let (low, high) =
            unsafe { (T::gather_pairs(table, low, offset), T::gather_pairs(table, high, offset)) };
        (Self(low.0, high.0), Self(low.1, high.1))
    }
}

impl<T: I32s<LANES>> I32s<WIDE> for Twice<T> {
    #[inline(always)]
    fn splat(value: i32) -> Self {
        Self(T::splat(value), T::splat(value))
    }

    #[inline(always)]
    fn mask(bits: u32) -> Self {
        Self(T::mask(bits), T::mask(bits >> LANES))
    }

    #[inline(always)]
    fn load(words: &[u32; WIDE]) -> Self {
        let [low, high] = split(words);
        Self(T::load(low), T::load(high))
    }

    #[inline(always)]
    fn store(self, words: &mut [u32; WIDE]) {
        let [low, high] = split_mut(words);
        self.0.store(low);
        self.1.store(high);
    }

    #[inline(always)]
    fn first(self) -> i32 {
        self.0.first()
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Self(self.0.min(other.0), self.1.min(other.1))
    }

    #[inline(always)]
    fn shifted<const BY: i32>(self) -> Self {
        Self(self.0.shifted::<BY>(), self.1.shifted::<BY>())
    }

    #[inline(always)]
    fn eq(self, other: Self) -> Self {
        Self(self.0.eq(other.0), self.1.eq(other.1))
    }

    #[inline(always)]
    fn gt(self, other: Self) -> Self {
        Self(self.0.gt(other.0), self.1.gt(other.1))
    }

    #[inline(always)]
    fn select(mask: Self, yes: Self, no: Self) -> Self {
        Self(T::select(mask.0, yes.0, no.0), T::select(mask.1, yes.1, no.1))
    }

    #[inline(always)]
    fn bits(self) -> u32 {
        self.0.bits() | self.1.bits() << LANES
    }

    #[inline(always)]
    fn is_zero(self) -> bool {
        (self.0 | self.1).is_zero()
    }

    #[inline(always)]
    unsafe fn gather(table: &[u32], at: Self) -> Self {
        // SAFETY: by the caller's promise.
        unsafe { Self(T::gather(table, at.0), T::gather(table, at.1)) }
    }
}
