//! Eight lanes at once: what all kernels share, the chart and the place in registers.
//!
//! # Measured
//! Where one brick holds all points of a block, which is mostly so, it is asked once: its ceiling answers for all of them, or its
//! samples are read with 64-bit loads, in pairs along z, which lie side by side. With gathers the look-ups took 1.4 times as long (share
//! of a profile). What the third cache holds is fetched four blocks before its turn.

mod blocks;
mod spheres;
mod sums;

use core::arch::x86_64::*;

use super::*;

pub(super) use blocks::blocks;
pub(super) use spheres::{above, spheres};
pub(super) use sums::{add, add_all};

const _: () = assert!(size_of::<[f32; APRON_CELLS]>() == 4 * APRON_CELLS);

/// Blocks that are fetched before their turn: what lies in the third cache is there in time.
const AHEAD: usize = 4;

#[inline(always)]
fn prefetch(Lanes3 { x, y, z }: &Lanes3) {
    for lanes in [x, y, z] {
        // SAFETY: SSE is part of every x86-64, and a prefetch reads nothing.
        unsafe { _mm_prefetch::<_MM_HINT_T0>(lanes.0.as_ptr().cast()) };
    }
}

/// The chart in registers.
struct Grid<'a> {
    bounds: &'a BrickBounds,
    dims: [__m256i; 3],
    ny: __m256i,
    nz: __m256i,
    low: __m256,
    high: __m256,
    skin: __m256,
    outside: __m256,
}

impl<'a> Grid<'a> {
    #[target_feature(enable = "avx2")]
    #[inline]
    fn new(bounds: &'a BrickBounds) -> Self {
        let [nx, ny, nz] = bounds.dims();
        Self {
            bounds,
            dims: [_mm256_set1_epi32(nx), _mm256_set1_epi32(ny), _mm256_set1_epi32(nz)],
            ny: _mm256_set1_epi32(ny),
            nz: _mm256_set1_epi32(nz),
            low: _mm256_set1_ps(-bounds.band_m()),
            high: _mm256_set1_ps(bounds.band_m()),
            skin: _mm256_set1_ps(bounds.skin_m()),
            outside: _mm256_set1_ps(bounds.skin_m() - bounds.band_m()),
        }
    }

    /// Number of a brick. The product of the sizes fits, by the chart's invariant.
    #[target_feature(enable = "avx2")]
    #[inline]
    fn brick(&self, [bx, by, bz]: [__m256i; 3]) -> __m256i {
        let plane = _mm256_add_epi32(_mm256_mullo_epi32(bx, self.ny), by);
        _mm256_add_epi32(_mm256_mullo_epi32(plane, self.nz), bz)
    }

    /// The nearest place on the grid, and its cell. What is not a number becomes 0.
    #[target_feature(enable = "avx2")]
    #[inline]
    fn on_grid(&self, lattice: [__m256; 3]) -> ([__m256; 3], [__m256i; 3]) {
        let (zero, one) = (_mm256_setzero_ps(), _mm256_set1_epi32(1));
        let end = |k: usize| _mm256_slli_epi32::<3>(self.dims[k]);
        let clamped = |k: usize| _mm256_min_ps(_mm256_max_ps(lattice[k], zero), _mm256_cvtepi32_ps(end(k)));
        let on_grid = [clamped(0), clamped(1), clamped(2)];
        let whole = |k: usize| _mm256_min_epi32(_mm256_cvttps_epi32(on_grid[k]), _mm256_sub_epi32(end(k), one));
        (on_grid, [whole(0), whole(1), whole(2)])
    }

    /// The brick that all points lie in, if there is one.
    #[target_feature(enable = "avx2")]
    #[inline]
    fn only_brick(&self, [low, high]: [[__m256i; 3]; 2]) -> Option<[i32; 3]> {
        let mut others = _mm256_setzero_si256();
        let mut brick = [0; 3];
        for ((low, high), brick) in low.into_iter().zip(high).zip(&mut brick) {
            let first = _mm256_castsi256_si128(low);
            let all_first = _mm256_broadcastd_epi32(first);
            let differing = _mm256_or_si256(_mm256_xor_si256(low, all_first), _mm256_xor_si256(high, all_first));
            others = _mm256_or_si256(others, differing);
            *brick = _mm_cvtsi128_si32(first) >> 3;
        }
        (_mm256_testz_si256(others, _mm256_set1_epi32(!7)) == 1).then_some(brick)
    }

    /// What a brick says of points in it, of interest only above the floor.
    #[inline]
    fn brick_alone(&self, [bx, by, bz]: [i32; 3], floor_m: f32) -> Alone<'a> {
        let (bounds, [nx, ny, nz]) = (self.bounds, self.bounds.dims());
        if bx as u32 >= nx as u32 || by as u32 >= ny as u32 || bz as u32 >= nz as u32 {
            return Alone::Uniform(bounds.skin_m() - bounds.band_m());
        }
        let brick = ((bx * ny + by) * nz + bz) as usize;
        let ceiling_m = bounds.max_depth_m().get(brick).copied().unwrap_or(f32::INFINITY);
        let samples = || bounds.samples_m().get(bounds.top().get(brick).copied()? as usize);
        if ceiling_m <= floor_m { None } else { samples() }.map_or(Alone::Uniform(ceiling_m), Alone::Samples)
    }

    /// V of eight points.
    #[target_feature(enable = "avx2")]
    #[inline]
    fn eight(&self, lattice: [__m256; 3], base: [__m256i; 3], floor_m: __m256) -> __m256 {
        let bricks = eighths(base);
        // Below the size, and not negative: as unsigned numbers.
        let within = |k: usize| {
            let last = _mm256_sub_epi32(self.dims[k], _mm256_set1_epi32(1));
            _mm256_cmpeq_epi32(_mm256_min_epu32(bricks[k], last), bricks[k])
        };
        let on_grid = _mm256_and_si256(_mm256_and_si256(within(0), within(1)), within(2));
        let brick = _mm256_and_si256(self.brick(bricks), on_grid);
        // SAFETY: lanes that are not on the grid read entry 0; by the chart's invariant there is one entry per brick.
        let ceilings = unsafe { _mm256_i32gather_ps::<4>(self.bounds.max_depth_m().as_ptr(), brick) };
        let ceilings = _mm256_blendv_ps(self.outside, ceilings, _mm256_castsi256_ps(on_grid));
        let wanted = _mm256_and_ps(_mm256_cmp_ps::<_CMP_NLE_UQ>(ceilings, floor_m), _mm256_castsi256_ps(on_grid));
        if _mm256_movemask_ps(wanted) == 0 {
            return ceilings;
        }
        // SAFETY: as above.
        let slots = unsafe { _mm256_i32gather_epi32::<4>(self.bounds.top().as_ptr().cast(), brick) };
        // The two marks are −1 and −2 as signed numbers; slots are not negative.
        let is_slot = _mm256_cmpgt_epi32(slots, _mm256_set1_epi32(-1));
        let wanted = _mm256_and_ps(wanted, _mm256_castsi256_ps(is_slot));
        if _mm256_movemask_ps(wanted) == 0 {
            return ceilings;
        }
        let slots = _mm256_and_si256(slots, _mm256_castps_si256(wanted));
        // SAFETY: a slot of `top`, or 0 where none is wanted; as one is wanted, there are samples.
        let corners = unsafe { self.corners(slots, base) };
        _mm256_blendv_ps(ceilings, self.finished(corners, fractions(lattice, base)), wanted)
    }

    /// Corners of interpolation cells of any bricks.
    ///
    /// # Safety
    /// Each slot is below the number of bricks with samples.
    #[target_feature(enable = "avx2")]
    #[inline]
    unsafe fn corners(&self, slots: __m256i, base: [__m256i; 3]) -> [(__m256, __m256); 4] {
        let bricks = _mm256_mullo_epi32(slots, _mm256_set1_epi32(APRON_CELLS as i32));
        // SAFETY: whole bricks, by the caller's word; the sum is an `i32` by the chart's invariant.
        unsafe { corners(self.bounds.samples_m().as_ptr().cast(), _mm256_add_epi32(bricks, inside(base))) }
    }

    /// V from the corners and the place between them.
    #[target_feature(enable = "avx2")]
    #[inline]
    fn finished(&self, corners: [(__m256, __m256); 4], t: [__m256; 3]) -> __m256 {
        // Limit first: what is not a number stays what it is.
        let clamped = _mm256_min_ps(self.high, _mm256_max_ps(self.low, mixed(corners, t)));
        _mm256_add_ps(clamped, self.skin)
    }
}

/// What one brick says of all points of a block.
#[derive(Clone, Copy)]
enum Alone<'a> {
    Uniform(f32),
    Samples(&'a [f32; APRON_CELLS]),
}

/// Cells. What is not a number becomes cell 0; what is too large becomes the least `i32`, which is in no brick either.
#[target_feature(enable = "avx2")]
#[inline]
fn whole(lattice: [__m256; 3]) -> [__m256i; 3] {
    let whole = |at: __m256| {
        let is_number = _mm256_castps_si256(_mm256_cmp_ps::<_CMP_ORD_Q>(at, at));
        _mm256_and_si256(_mm256_cvttps_epi32(at), is_number)
    };
    [whole(lattice[0]), whole(lattice[1]), whole(lattice[2])]
}

/// Number of a cell's first sample within its brick: 9·(9·x + y) + z.
#[target_feature(enable = "avx2")]
#[inline]
fn inside([x, y, z]: [__m256i; 3]) -> __m256i {
    let seven = _mm256_set1_epi32(7);
    let (x, y, z) = (_mm256_and_si256(x, seven), _mm256_and_si256(y, seven), _mm256_and_si256(z, seven));
    let nine_times = |v: __m256i| _mm256_add_epi32(_mm256_slli_epi32::<3>(v), v);
    _mm256_add_epi32(nine_times(_mm256_add_epi32(nine_times(x), y)), z)
}

/// Corners of interpolation cells, in pairs along z: `(first, second)` of rows 00, 01, 10, 11.
///
/// # Safety
/// `samples` are whole bricks, and each number is that of a cell's [`inside`] one of them.
#[target_feature(enable = "avx2")]
#[inline]
unsafe fn corners(samples: *const f32, first: __m256i) -> [(__m256, __m256); 4] {
    let mut firsts = [0_u32; 8];
    // SAFETY: eight numbers.
    unsafe { _mm256_storeu_si256(firsts.as_mut_ptr().cast(), first) };
    let row = |row: usize| {
        // SAFETY: in a brick x, y, z are at most 7, so the last number read is 7·91 + 91 = 728 of its 729.
        let pairs = |a: usize, b: usize| unsafe {
            let at = |point: usize| samples.add(firsts[point] as usize + row).cast::<f64>().read_unaligned();
            _mm_setr_pd(at(a), at(b))
        };
        let early = _mm256_castpd_ps(_mm256_set_m128d(pairs(4, 5), pairs(0, 1)));
        let late = _mm256_castpd_ps(_mm256_set_m128d(pairs(6, 7), pairs(2, 3)));
        (_mm256_shuffle_ps::<0b10_00_10_00>(early, late), _mm256_shuffle_ps::<0b11_01_11_01>(early, late))
    };
    [row(0), row(ROW), row(PLANE), row(PLANE + ROW)]
}

/// The place in registers.
struct Axes {
    x: [__m256; 3],
    y: [__m256; 3],
    z: [__m256; 3],
    origin: [__m256; 3],
}

impl Axes {
    #[target_feature(enable = "avx2")]
    #[inline]
    fn new(place: &Place) -> Self {
        let all = |v: Vec3| [_mm256_set1_ps(v.x), _mm256_set1_ps(v.y), _mm256_set1_ps(v.z)];
        let Mat3 { x_axis, y_axis, z_axis } = place.axes;
        Self { x: all(x_axis), y: all(y_axis), z: all(z_axis), origin: all(place.origin) }
    }

    /// Coordinates on the lattice of cell centres.
    #[target_feature(enable = "avx2")]
    #[inline]
    fn lattice(&self, [x, y, z]: [__m256; 3]) -> [__m256; 3] {
        let half = _mm256_set1_ps(0.5);
        let along = |k: usize| {
            let xy = _mm256_add_ps(_mm256_mul_ps(self.x[k], x), _mm256_mul_ps(self.y[k], y));
            let xyz = _mm256_add_ps(xy, _mm256_mul_ps(self.z[k], z));
            _mm256_sub_ps(_mm256_add_ps(xyz, self.origin[k]), half)
        };
        [along(0), along(1), along(2)]
    }
}

/// Interpolation: z, then y, then x.
#[target_feature(enable = "avx2")]
#[inline]
fn mixed([c00, c01, c10, c11]: [(__m256, __m256); 4], [tx, ty, tz]: [__m256; 3]) -> __m256 {
    let mix = |(a, b): (__m256, __m256), t| _mm256_add_ps(a, _mm256_mul_ps(_mm256_sub_ps(b, a), t));
    let y0 = mix((mix(c00, tz), mix(c01, tz)), ty);
    let y1 = mix((mix(c10, tz), mix(c11, tz)), ty);
    mix((y0, y1), tx)
}

/// Numbers of the bricks, per axis.
#[target_feature(enable = "avx2")]
#[inline]
fn eighths([x, y, z]: [__m256i; 3]) -> [__m256i; 3] {
    [_mm256_srai_epi32::<3>(x), _mm256_srai_epi32::<3>(y), _mm256_srai_epi32::<3>(z)]
}

#[target_feature(enable = "avx2")]
#[inline]
fn fractions(at: [__m256; 3], base: [__m256i; 3]) -> [__m256; 3] {
    let fraction = |k: usize| _mm256_sub_ps(at[k], _mm256_cvtepi32_ps(base[k]));
    [fraction(0), fraction(1), fraction(2)]
}
