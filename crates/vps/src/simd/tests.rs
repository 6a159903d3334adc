//! Every operation gives the same bits on every level, for numbers of all kinds.

use super::*;

/// What all operations make of two sets of lanes.
struct Everything {
    a: [f32; LANES],
    b: [f32; LANES],
    i: [u32; LANES],
    j: [u32; LANES],
}

fn floats<L: F32x8>(lanes: L, found: &mut Vec<u32>) {
    let mut numbers = [0.0; LANES];
    lanes.store(&mut numbers);
    // The sign and payload of a NaN are not specified.
    found.extend(numbers.map(|number| if number.is_nan() { f32::NAN.to_bits() } else { number.to_bits() }));
}

fn ints<I: I32x8>(lanes: I, found: &mut Vec<u32>) {
    let mut words = [0; LANES];
    lanes.store(&mut words);
    found.extend(words);
}

impl Kernel for Everything {
    type Output = Vec<u32>;

    #[inline(always)]
    fn run<L: F32x8>(self) -> Vec<u32> {
        let (a, b, i, j) = (L::load(&self.a), L::load(&self.b), L::Int::load(&self.i), L::Int::load(&self.j));
        let mut found = Vec::new();
        for lanes in [a + b, a - b, a * b, a / b, a.min(b), a.max(b), a.sqrt(), L::of_int(i), L::splat(self.b[1])] {
            floats(lanes, &mut found);
        }
        let (lt, le) = (a.lt(b), a.le(b));
        floats(a.only(lt), &mut found);
        floats(L::select(le, a, b), &mut found);
        // What no `i32` holds may become either end.
        let fits = L::splat(-2e9).lt(a) & a.lt(L::splat(2e9));
        for lanes in
            [lt, le, i + j, i * j, i & j, i | j, i ^ j, i.min(j), i.eq(j), i.gt(j), i.shifted::<3>(), a.only(fits).truncated()]
        {
            ints(lanes, &mut found);
        }
        ints(L::splat(f32::NAN).truncated(), &mut found);
        ints(L::Int::select(i.gt(j), i, j), &mut found);
        ints(L::Int::mask(self.i[0] as u8), &mut found);
        found.push(L::select(L::splat(f32::NEG_INFINITY).lt(a), a, L::splat(0.0)).max_lane().to_bits());
        found.extend([
            i.first() as u32,
            lt.bits().into(),
            u32::from((i ^ j).is_zero()),
            u32::from((i ^ L::Int::load(&self.i)).is_zero()),
        ]);
        let table: [f32; 64] = core::array::from_fn(|k| k as f32);
        let words: [u32; 64] = core::array::from_fn(|k| 3 * k as u32);
        let at = i & L::Int::splat(31);
        let mut places = [0; LANES];
        at.store(&mut places);
        // SAFETY: places below 32 in tables of 64.
        let (one, pairs, word) =
            unsafe { (L::gather(&table, at), L::gather_pairs(&table, &places, 17), L::Int::gather(&words, at)) };
        for lanes in [one, pairs.0, pairs.1] {
            floats(lanes, &mut found);
        }
        ints(word, &mut found);
        found
    }
}

#[test]
fn every_operation_gives_the_same_bits_on_every_level() {
    const NUMBERS: [f32; 14] =
        [0.0, -0.0, 1.0, -1.5, 7.75, -8.25, 1e-39, 3e9, -3e9, f32::MAX, f32::INFINITY, f32::NEG_INFINITY, f32::NAN, 0.333_333_34];
    const WORDS: [u32; 7] = [0, 1, 7, 0x8000_0000, u32::MAX, 0x7fff_ffff, 12_345];
    for shift in 0..NUMBERS.len() * WORDS.len() {
        let everything = |level: SimdLevel| {
            level.run(Everything {
                a: core::array::from_fn(|lane| NUMBERS[(lane + shift) % NUMBERS.len()]),
                b: core::array::from_fn(|lane| NUMBERS[(3 * lane + shift / NUMBERS.len()) % NUMBERS.len()]),
                i: core::array::from_fn(|lane| WORDS[(lane + shift) % WORDS.len()]),
                j: core::array::from_fn(|lane| WORDS[(5 * lane + shift / WORDS.len()) % WORDS.len()]),
            })
        };
        assert_eq!(everything(SimdLevel::Portable), everything(SimdLevel::best()), "{shift}");
    }
}
