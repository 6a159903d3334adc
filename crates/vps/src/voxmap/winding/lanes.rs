//! What sixteen points see of a node and of a triangle, in single precision. Lanes do not depend on
//! the processor.

use core::f32::consts::{FRAC_PI_2, PI};

use glam::{DVec3, Vec3};

use super::moments::Moments;
use crate::simd::{F32s, WIDE};

/// A vector in each lane.
pub(super) type Vec3s<L> = [L; 3];

#[inline(always)]
pub(super) fn dot<L: F32s<WIDE>>([ax, ay, az]: Vec3s<L>, [bx, by, bz]: Vec3s<L>) -> L {
    ax * bx + ay * by + az * bz
}

/// From the points to the same place.
#[inline(always)]
pub(super) fn from_points<L: F32s<WIDE>>(place: Vec3, [x, y, z]: Vec3s<L>) -> Vec3s<L> {
    [L::splat(place.x) - x, L::splat(place.y) - y, L::splat(place.z) - z]
}

#[inline(always)]
fn plus<L: F32s<WIDE>>(place: Vec3, [x, y, z]: Vec3s<L>) -> Vec3s<L> {
    [L::splat(place.x) + x, L::splat(place.y) + y, L::splat(place.z) + z]
}

/// The Taylor expansion of the solid angle of a node, as polynomials of the direction in which it
/// is seen.
#[derive(Clone)]
pub(super) struct Expansion {
    /// x, y, z.
    first: [f32; 3],
    /// xx, yy, zz, xy, xz, yz.
    second: [f32; 6],
    /// xxx, yyy, zzz, xxy, xxz, xyy, yyz, xzz, yzz, xyz.
    third: [f32; 10],
}

impl Expansion {
    pub(super) const ZERO: Self = Self { first: [0.0; 3], second: [0.0; 6], third: [0.0; 10] };

    /// ∫ n·x/|x|³ to third order: with u the direction and r the distance of the centre, N, M and S
    /// the moments and t the trace of S `N·u/r² + (tr M − 3 uMu)/r³ + ½(15 Suuu − 9 t·u)/r⁴`. As uu
    /// = 1, traces go into the coefficients of the highest power.
    pub(super) fn new(moments: &Moments) -> Self {
        let Moments { dipole, second: [mxx, myy, mzz, mxy, mxz, myz], third } = *moments;
        let trace = mxx + myy + mzz;
        let second = [
            trace - 3.0 * mxx,
            trace - 3.0 * myy,
            trace - 3.0 * mzz,
            -6.0 * mxy,
            -6.0 * mxz,
            -6.0 * myz,
        ];
        let [xxx, yyy, zzz, xxy, xxz, xyy, yyz, xzz, yzz, xyz] = third;
        let [x, y, z] =
            [xxx + xyy + xzz, xxy + yyy + yzz, xxz + yyz + zzz].map(|trace| 4.5 * trace);
        let third = [
            7.5 * xxx - x,
            7.5 * yyy - y,
            7.5 * zzz - z,
            22.5 * xxy - y,
            22.5 * xxz - z,
            22.5 * xyy - x,
            22.5 * yyz - z,
            22.5 * xzz - x,
            22.5 * yzz - y,
            45.0 * xyz,
        ];
        let single = |number: f64| number as f32;
        Self { first: dipole.map(single), second: second.map(single), third: third.map(single) }
    }

    /// `offset` from the points to the centre.
    #[inline(always)]
    pub(super) fn solid_angles<L: F32s<WIDE>>(&self, offset: Vec3s<L>, distance_squared: L) -> L {
        let per_r = L::splat(1.0) / distance_squared.sqrt();
        let [x, y, z] = [offset[0] * per_r, offset[1] * per_r, offset[2] * per_r];
        let [nx, ny, nz] = splat::<L, 3>(&self.first);
        let [mxx, myy, mzz, mxy, mxz, myz] = splat::<L, 6>(&self.second);
        let [xxx, yyy, zzz, xxy, xxz, xyy, yyz, xzz, yzz, xyz] = splat::<L, 10>(&self.third);
        let first = nx * x + ny * y + nz * z;
        let second = x * (mxx * x + mxy * y + mxz * z) + y * (myy * y + myz * z) + mzz * z * z;
        let third = x * x * (xxx * x + xxy * y + xxz * z)
            + y * y * (xyy * x + yyy * y + yyz * z)
            + z * z * (xzz * x + yzz * y + zzz * z)
            + xyz * x * y * z;
        per_r * per_r * (first + per_r * (second + per_r * third))
    }
}

#[inline(always)]
fn splat<L: F32s<WIDE>, const N: usize>(numbers: &[f32; N]) -> [L; N] {
    let mut lanes = [L::splat(0.0); N];
    for (lanes, number) in lanes.iter_mut().zip(numbers) {
        *lanes = L::splat(*number);
    }
    lanes
}

/// A triangle, relative to the centre of its leaf.
#[derive(Clone)]
pub(super) struct Triangle {
    corners: [Vec3; 3],
    /// Of the length of twice the area.
    normal: Vec3,
}

impl Triangle {
    pub(super) const EMPTY: Self = Self { corners: [Vec3::ZERO; 3], normal: Vec3::ZERO };

    pub(super) fn new([a, b, c]: [DVec3; 3]) -> Self {
        Self {
            corners: [a.as_vec3(), b.as_vec3(), c.as_vec3()],
            normal: (b - a).cross(c - a).as_vec3(),
        }
    }

    /// Signed solid angles, `offset` from the points to the centre of the leaf; 0 from a point in
    /// the plane of the triangle.
    #[inline(always)]
    pub(super) fn solid_angles<L: F32s<WIDE>>(&self, offset: Vec3s<L>) -> L {
        let [a, b, c] = self.corners;
        let a = plus(a, offset);
        let b = plus(b, offset);
        let c = plus(c, offset);
        let la = dot(a, a).sqrt();
        let lb = dot(b, b).sqrt();
        let lc = dot(c, c).sqrt();
        let denominator = la * lb * lc + dot(a, b) * lc + dot(b, c) * la + dot(c, a) * lb;
        let normal = splat::<L, 3>(&self.normal.to_array());
        L::splat(2.0) * atan2(dot(a, normal), denominator)
    }
}

#[inline(always)]
fn abs<L: F32s<WIDE>>(number: L) -> L {
    let zero = L::splat(0.0);
    L::select(number.lt(zero), zero - number, number)
}

/// The angle of (x, y), to 10⁻⁶; 0 for y = 0, whatever x.
///
/// # Source
/// Abramowitz and Stegun 1964, formula 4.4.49.
#[inline(always)]
fn atan2<L: F32s<WIDE>>(y: L, x: L) -> L {
    let zero = L::splat(0.0);
    let opposite = abs(y);
    let adjacent = abs(x);
    let t = opposite.min(adjacent) / opposite.max(adjacent);
    let s = t * t;
    let mut sum = L::splat(0.002_866_225_7);
    for coefficient in [
        -0.016_165_737,
        0.042_909_614,
        -0.075_289_64,
        0.106_562_64,
        -0.142_089,
        0.199_935_51,
        -0.333_331_45,
        1.0_f32,
    ] {
        sum = sum * s + L::splat(coefficient);
    }
    let angle = t * sum;
    let angle = L::select(adjacent.lt(opposite), L::splat(FRAC_PI_2) - angle, angle);
    let angle = L::select(x.lt(zero), L::splat(PI) - angle, angle);
    L::select(y.lt(zero), zero - angle, L::select(zero.lt(y), angle, zero))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::{F32x8, Kernel, SimdLevel};

    struct Angles([f32; WIDE], [f32; WIDE]);

    impl Kernel for Angles {
        type Output = [f32; WIDE];

        #[inline(always)]
        fn run<L: F32x8>(self) -> [f32; WIDE] {
            let mut angles = [0.0; WIDE];
            atan2(L::Wide::load(&self.0), L::Wide::load(&self.1)).store(&mut angles);
            angles
        }
    }

    #[test]
    fn angles_are_right_to_a_millionth_all_around() {
        let of = |y: f32, x: f32| SimdLevel::best().run(Angles([y; WIDE], [x; WIDE]))[0];
        for k in 0..3600 {
            for radius in [1e-6, 1.0, 1e6] {
                let (sin, cos) = (0.1 * f64::from(k) + 0.01).to_radians().sin_cos();
                let y = (radius * sin) as f32;
                let x = (radius * cos) as f32;
                let angle = of(y, x);
                assert!((angle - y.atan2(x)).abs() < 1e-6, "{y} {x}: {angle}");
            }
        }
        assert_eq!([-1.0, 0.0, 1.0, f32::MIN_POSITIVE].map(|x| of(0.0, x)), [0.0; 4]);
    }
}
