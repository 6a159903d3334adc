//! Lane by lane.

use core::num::Wrapping;

use super::*;

#[derive(Clone, Copy)]
pub(super) struct Lanes<T>([T; LANES]);

type Floats = Lanes<f32>;
type Ints = Lanes<Wrapping<i32>>;

impl<T: Copy> Lanes<T> {
    #[inline(always)]
    fn map<U>(self, of: impl Fn(T) -> U) -> Lanes<U> {
        Lanes(self.0.map(of))
    }

    #[inline(always)]
    fn zip<U: Copy, V>(self, other: Lanes<U>, of: impl Fn(T, U) -> V) -> Lanes<V> {
        Lanes(core::array::from_fn(|lane| of(self.0[lane], other.0[lane])))
    }

    #[inline(always)]
    fn choose(mask: Ints, yes: Self, no: Self) -> Self {
        mask.zip(yes.zip(no, |yes, no| (yes, no)), |mask, (yes, no)| if mask.0 < 0 { yes } else { no })
    }
}

macro_rules! operators {
    ($($operator:ident $function:ident),*) => {$(
        impl<T: Copy + $operator<Output = T>> $operator for Lanes<T> {
            type Output = Self;
            #[inline(always)]
            fn $function(self, other: Self) -> Self {
                self.zip(other, T::$function)
            }
        }
    )*};
}
operators!(Add add, Sub sub, Mul mul, Div div, BitAnd bitand, BitOr bitor, BitXor bitxor);

macro_rules! inlined {
    ($(fn $name:ident $arguments:tt $(-> $result:ty)? $body:block)*) => {$(
        #[inline(always)]
        fn $name $arguments $(-> $result)? $body
    )*};
}

#[inline(always)]
fn mask_of(holds: bool) -> Wrapping<i32> {
    Wrapping(-i32::from(holds))
}

#[inline(always)]
fn greater(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

impl F32x8 for Floats {
    type Int = Ints;

    inlined! {
        fn splat(value: f32) -> Self { Self([value; LANES]) }
        fn of_int(int: Ints) -> Self { int.map(|lane| lane.0 as f32) }
        fn load(numbers: &[f32; LANES]) -> Self { Self(*numbers) }
        fn store(self, numbers: &mut [f32; LANES]) { *numbers = self.0; }
        fn min(self, other: Self) -> Self { self.zip(other, |a, b| if a < b { a } else { b }) }
        fn max(self, other: Self) -> Self { self.zip(other, greater) }
        fn sqrt(self) -> Self { self.map(f32::sqrt) }
        fn max_lane(self) -> f32 {
            // In halves, as instructions do it: which of 0 and −0 is found depends on the order.
            let [a, b, c, d, e, f, g, h] = self.0;
            greater(greater(greater(a, e), greater(c, g)), greater(greater(b, f), greater(d, h)))
        }
        fn truncated(self) -> Ints { self.map(|lane| Wrapping(lane as i32)) }
        fn lt(self, other: Self) -> Ints { self.zip(other, |a, b| mask_of(a < b)) }
        fn le(self, other: Self) -> Ints { self.zip(other, |a, b| mask_of(a <= b)) }
        fn only(self, mask: Ints) -> Self { Self::choose(mask, self, Self::splat(0.0)) }
        fn select(mask: Ints, yes: Self, no: Self) -> Self { Self::choose(mask, yes, no) }
    }

    #[inline(always)]
    unsafe fn gather(table: &[f32], at: Ints) -> Self {
        at.map(|at| table[at.0 as usize])
    }

    #[inline(always)]
    unsafe fn gather_pairs(table: &[f32], at: &[u32; LANES], offset: usize) -> (Self, Self) {
        let after = |n: usize| Lanes(at.map(|at| table[at as usize + offset + n]));
        (after(0), after(1))
    }
}

impl I32x8 for Ints {
    inlined! {
        fn splat(value: i32) -> Self { Self([Wrapping(value); LANES]) }
        fn mask(bits: u8) -> Self { Self(core::array::from_fn(|lane| mask_of(bits >> lane & 1 == 1))) }
        fn load(words: &[u32; LANES]) -> Self { Self(words.map(|word| Wrapping(word as i32))) }
        fn store(self, words: &mut [u32; LANES]) { *words = self.0.map(|lane| lane.0 as u32); }
        fn first(self) -> i32 { self.0[0].0 }
        fn min(self, other: Self) -> Self { self.zip(other, Ord::min) }
        fn eq(self, other: Self) -> Self { self.zip(other, |a, b| mask_of(a == b)) }
        fn gt(self, other: Self) -> Self { self.zip(other, |a, b| mask_of(a > b)) }
        fn select(mask: Self, yes: Self, no: Self) -> Self { Self::choose(mask, yes, no) }
        fn bits(self) -> u8 { self.0.iter().rev().fold(0, |bits, lane| bits << 1 | u8::from(lane.0 < 0)) }
        fn is_zero(self) -> bool { self.0.iter().all(|lane| lane.0 == 0) }
    }

    #[inline(always)]
    fn shifted<const N: i32>(self) -> Self {
        self.map(|lane| lane >> N as usize)
    }

    #[inline(always)]
    unsafe fn gather(table: &[u32], at: Self) -> Self {
        at.map(|at| Wrapping(table[at.0 as usize] as i32))
    }
}
