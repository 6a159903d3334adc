//! Every operation gives the same bits on every level, for numbers of all kinds.

use super::*;

/// What all operations make of two sets of lanes.
struct Everything {
    a: [f32; WIDE],
    b: [f32; WIDE],
    i: [u32; WIDE],
    j: [u32; WIDE],
}

fn floats<L: F32s<N>, const N: usize>(lanes: L, found: &mut Vec<u32>) {
    let mut numbers = [0.0; N];
    lanes.store(&mut numbers);
    // The sign and payload of a NaN are not specified.
    found.extend(
        numbers.map(|number| if number.is_nan() { f32::NAN.to_bits() } else { number.to_bits() }),
    );
}

fn ints<I: I32s<N>, const N: usize>(lanes: I, found: &mut Vec<u32>) {
    let mut words = [0; N];
    lanes.store(&mut words);
    found.extend(words);
}

/// The operations on `N` lanes.
#[inline(always)]
fn all<L: F32s<N>, const N: usize>(
    a: &[f32; N],
    b: &[f32; N],
    words_of_i: &[u32; N],
    j: &[u32; N],
    found: &mut Vec<u32>,
) {
    let a = L::load(a);
    let b = L::load(b);
    let bits = words_of_i[0];
    let i = L::Int::load(words_of_i);
    let j = L::Int::load(j);
    for lanes in
        [a + b, a - b, a * b, a / b, a.min(b), a.max(b), a.sqrt(), L::of_int(i), L::splat(0.1)]
    {
        floats(lanes, found);
    }
    let lt = a.lt(b);
    let le = a.le(b);
    floats(a.only(lt), found);
    floats(L::select(le, a, b), found);
    floats(a.packed(bits, b), found);
    floats(a.unpacked(bits), found);
    // What no `i32` holds may become either end.
    let fits = L::splat(-2e9).lt(a) & a.lt(L::splat(2e9));
    let small = L::Int::mask(bits);
    for lanes in [
        lt,
        le,
        i + j,
        i * j,
        i & j,
        i | j,
        i ^ j,
        i.min(j),
        i.eq(j),
        i.gt(j),
        i.shifted::<3>(),
        small,
        a.only(fits).truncated(),
        a.only(fits).floored(),
    ] {
        ints(lanes, found);
    }
    ints(L::splat(f32::NAN).truncated(), found);
    ints(L::splat(f32::NAN).floored(), found);
    ints(L::Int::select(i.gt(j), i, j), found);
    found.push(L::select(L::splat(f32::NEG_INFINITY).lt(a), a, L::splat(0.0)).max_lane().to_bits());
    found.extend([
        i.first() as u32,
        lt.bits(),
        u32::from((i ^ j).is_zero()),
        u32::from((i ^ L::Int::load(words_of_i)).is_zero()),
    ]);
    let table: [f32; 64] = core::array::from_fn(|k| k as f32);
    let words: [u32; 64] = core::array::from_fn(|k| 3 * k as u32);
    let at = i & L::Int::splat(31);
    let mut places = [0; N];
    at.store(&mut places);
    // SAFETY: places below 32 in tables of 64.
    let (one, pairs, word) = unsafe {
        (L::gather(&table, at), L::gather_pairs(&table, &places, 17), L::Int::gather(&words, at))
    };
    let eight: [[Pair; 2]; 4] = core::array::from_fn(|k| {
        [[5 * k as u32, (k as f32).to_bits()], [7 * k as u32, (-(k as f32)).to_bits()]]
    });
    let picked = L::pick(eight.each_ref(), i);
    for lanes in [one, pairs.0, pairs.1, picked.1] {
        floats(lanes, found);
    }
    for lanes in [word, picked.0] {
        ints(lanes, found);
    }
}

impl Kernel for Everything {
    type Output = Vec<u32>;

    #[inline(always)]
    fn run<L: F32x8>(self) -> Vec<u32> {
        let Self { a, b, i, j } = &self;
        let mut found = Vec::new();
        let ([a_low, _], [b_low, _]): (&[[f32; LANES]; 2], &[[f32; LANES]; 2]) =
            (bytemuck::cast_ref(a), bytemuck::cast_ref(b));
        let ([i_low, _], [j_low, _]): (&[[u32; LANES]; 2], &[[u32; LANES]; 2]) =
            (bytemuck::cast_ref(i), bytemuck::cast_ref(j));
        all::<L, LANES>(a_low, b_low, i_low, j_low, &mut found);
        all::<L::Wide, WIDE>(a, b, i, j, &mut found);
        found
    }
}

#[test]
fn every_operation_gives_the_same_bits_on_every_level() {
    const NUMBERS: [f32; 14] = [
        0.0,
        -0.0,
        1.0,
        -1.5,
        7.75,
        -8.25,
        1e-39,
        3e9,
        -3e9,
        f32::MAX,
        f32::INFINITY,
        f32::NEG_INFINITY,
        f32::NAN,
        0.333_333_34,
    ];
    const WORDS: [u32; 7] = [0, 1, 7, 0x8000_0000, u32::MAX, 0x7fff_ffff, 12_345];
    for shift in 0..NUMBERS.len() * WORDS.len() {
        let everything = |level: SimdLevel| {
            level.run(Everything {
                a: core::array::from_fn(|lane| NUMBERS[(lane + shift) % NUMBERS.len()]),
                b: core::array::from_fn(|lane| {
                    NUMBERS[(3 * lane + shift / NUMBERS.len()) % NUMBERS.len()]
                }),
                i: core::array::from_fn(|lane| WORDS[(lane + shift) % WORDS.len()]),
                j: core::array::from_fn(|lane| {
                    WORDS[(5 * lane + shift / WORDS.len()) % WORDS.len()]
                }),
            })
        };
        for level in SimdLevel::available() {
            assert_eq!(everything(SimdLevel::Portable), everything(level), "{level:?}, {shift}");
        }
    }
}

#[test]
fn packed_lanes_come_first_in_their_order_and_unpacked_ones_go_back() {
    struct Packed(u32);
    impl Kernel for Packed {
        type Output = [[f32; WIDE]; 2];

        #[inline(always)]
        fn run<L: F32x8>(self) -> Self::Output {
            let lanes = L::Wide::load(&core::array::from_fn(|lane| lane as f32));
            let mut found = [[0.0; WIDE]; 2];
            let packed = lanes.packed(self.0, L::Wide::splat(-1.0));
            packed.store(&mut found[0]);
            packed.unpacked(self.0).store(&mut found[1]);
            found
        }
    }
    for bits in [0, 1, 0b1000_0000_0010_0110, 0b0101_1011_0110_1101, 0xffff] {
        let mut of_packed: Vec<f32> =
            (0_u8..16).filter(|lane| bits >> lane & 1 == 1).map(f32::from).collect();
        let back: Vec<f32> = (0_u8..16)
            .map(|lane| if bits >> lane & 1 == 1 { f32::from(lane) } else { 0.0 })
            .collect();
        of_packed.resize(WIDE, -1.0);
        for level in SimdLevel::available() {
            let [packed, unpacked] = level.run(Packed(bits));
            assert_eq!(packed.as_slice(), of_packed, "{level:?}, {bits:b}");
            assert_eq!(unpacked.as_slice(), back, "{level:?}, {bits:b}");
        }
    }
}
