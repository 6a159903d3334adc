//! Lane by lane.

use core::num::Wrapping;

use super::*;

#[derive(Clone, Copy)]
pub(super) struct Lanes<T, const N: usize>([T; N]);

pub(super) type Floats = Lanes<f32, LANES>;
type Ints<const N: usize> = Lanes<Wrapping<i32>, N>;

impl<T: Copy, const N: usize> Lanes<T, N> {
    #[inline(always)]
    fn map<U>(self, of: impl Fn(T) -> U) -> Lanes<U, N> {
        Lanes(self.0.map(of))
    }

    #[inline(always)]
    fn zip<U: Copy, V>(self, other: Lanes<U, N>, of: impl Fn(T, U) -> V) -> Lanes<V, N> {
        Lanes(core::array::from_fn(|lane| of(self.0[lane], other.0[lane])))
    }

    #[inline(always)]
    fn choose(mask: Ints<N>, yes: Self, no: Self) -> Self {
        mask.zip(
            yes.zip(no, |yes, no| (yes, no)),
            |mask, (yes, no)| if mask.0 < 0 { yes } else { no },
        )
    }
}

macro_rules! operators {
    ($($operator:ident $function:ident),*) => {$(
        impl<T: Copy + $operator<Output = T>, const N: usize> $operator for Lanes<T, N> {
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
    type Wide = Lanes<f32, WIDE>;
}

impl<const N: usize> F32s<N> for Lanes<f32, N> {
    type Int = Ints<N>;

    inlined! {
        fn splat(value: f32) -> Self { Self([value; N]) }
        fn of_int(int: Ints<N>) -> Self { int.map(|lane| lane.0 as f32) }
        fn load(numbers: &[f32; N]) -> Self { Self(*numbers) }
        fn store(self, numbers: &mut [f32; N]) { *numbers = self.0; }
        fn min(self, other: Self) -> Self { self.zip(other, |a, b| if a < b { a } else { b }) }
        fn max(self, other: Self) -> Self { self.zip(other, greater) }
        fn sqrt(self) -> Self { self.map(f32::sqrt) }
        fn max_lane(self) -> f32 {
            // In halves, as instructions do it: which of 0 and −0 is found depends on the order.
            let mut lanes = self.0;
            let mut half = N / 2;
            while half > 0 {
                for lane in 0..half {
                    lanes[lane] = greater(lanes[lane], lanes[lane + half]);
                }
                half /= 2;
            }
            lanes[0]
        }
        fn truncated(self) -> Ints<N> { self.map(|lane| Wrapping(lane as i32)) }
        fn lt(self, other: Self) -> Ints<N> { self.zip(other, |a, b| mask_of(a < b)) }
        fn le(self, other: Self) -> Ints<N> { self.zip(other, |a, b| mask_of(a <= b)) }
        fn only(self, mask: Ints<N>) -> Self { Self::choose(mask, self, Self::splat(0.0)) }
        fn pick(pairs: [&[Pair; 2]; 4], at: Ints<N>) -> (Ints<N>, Self) {
            let picked = at.map(|at| pairs[at.0 as usize >> 1 & 3][at.0 as usize & 1]);
            (picked.map(|[word, _]| Wrapping(word as i32)), picked.map(|[_, bits]| f32::from_bits(bits)))
        }
        fn select(mask: Ints<N>, yes: Self, no: Self) -> Self { Self::choose(mask, yes, no) }
    }

    #[inline(always)]
    unsafe fn gather(table: &[f32], at: Ints<N>) -> Self {
        at.map(|at| table[at.0 as usize])
    }

    #[inline(always)]
    unsafe fn gather_pairs(table: &[f32], at: &[u32; N], offset: usize) -> (Self, Self) {
        let after = |n: usize| Lanes(at.map(|at| table[at as usize + offset + n]));
        (after(0), after(1))
    }
}

impl<const N: usize> I32s<N> for Ints<N> {
    inlined! {
        fn splat(value: i32) -> Self { Self([Wrapping(value); N]) }
        fn mask(bits: u32) -> Self { Self(core::array::from_fn(|lane| mask_of(bits >> lane & 1 == 1))) }
        fn load(words: &[u32; N]) -> Self { Self(words.map(|word| Wrapping(word as i32))) }
        fn store(self, words: &mut [u32; N]) { *words = self.0.map(|lane| lane.0 as u32); }
        fn first(self) -> i32 { self.0[0].0 }
        fn min(self, other: Self) -> Self { self.zip(other, Ord::min) }
        fn eq(self, other: Self) -> Self { self.zip(other, |a, b| mask_of(a == b)) }
        fn gt(self, other: Self) -> Self { self.zip(other, |a, b| mask_of(a > b)) }
        fn select(mask: Self, yes: Self, no: Self) -> Self { Self::choose(mask, yes, no) }
        fn bits(self) -> u32 { self.0.iter().rev().fold(0, |bits, lane| bits << 1 | u32::from(lane.0 < 0)) }
        fn is_zero(self) -> bool { self.0.iter().all(|lane| lane.0 == 0) }
    }

    #[inline(always)]
    fn shifted<const BY: i32>(self) -> Self {
        self.map(|lane| lane >> BY as usize)
    }

    #[inline(always)]
    unsafe fn gather(table: &[u32], at: Self) -> Self {
        at.map(|at| Wrapping(table[at.0 as usize] as i32))
    }
}
