//! Four nodes or four triangles asked at once, in single precision. Lanes do not depend on the processor.

use core::f32::consts::{FRAC_PI_2, PI};
use core::ops::{Add, Sub};

use glam::{DVec3, Vec3, Vec4};

use super::moments::Moments;

/// Lanes.
pub(super) const WIDTH: usize = 4;

/// Four vectors.
#[derive(Clone, Copy)]
pub(super) struct Wide {
    x: Vec4,
    y: Vec4,
    z: Vec4,
}

impl Wide {
    pub(super) const ZERO: Self = Self { x: Vec4::ZERO, y: Vec4::ZERO, z: Vec4::ZERO };

    pub(super) fn splat(v: Vec3) -> Self {
        Self { x: Vec4::splat(v.x), y: Vec4::splat(v.y), z: Vec4::splat(v.z) }
    }

    pub(super) fn lane(self, lane: usize) -> Vec3 {
        Vec3::new(self.x[lane], self.y[lane], self.z[lane])
    }

    pub(super) fn set(&mut self, lane: usize, v: Vec3) {
        (self.x[lane], self.y[lane], self.z[lane]) = v.into();
    }

    #[inline]
    pub(super) fn dot(self, other: Self) -> Vec4 {
        self.x * other.x + self.y * other.y + self.z * other.z
    }

    #[inline]
    fn length(self) -> Vec4 {
        self.dot(self).sqrt()
    }
}

impl Add for Wide {
    type Output = Self;
    #[inline]
    fn add(self, other: Self) -> Self {
        Self { x: self.x + other.x, y: self.y + other.y, z: self.z + other.z }
    }
}

impl Sub for Wide {
    type Output = Self;
    #[inline]
    fn sub(self, other: Self) -> Self {
        Self { x: self.x - other.x, y: self.y - other.y, z: self.z - other.z }
    }
}

/// Taylor expansions of the solid angles of four nodes, as polynomials of the direction in which they are seen.
#[derive(Clone)]
pub(super) struct Expansions {
    /// x, y, z.
    first: [Vec4; 3],
    /// xx, yy, zz, xy, xz, yz.
    second: [Vec4; 6],
    /// xxx, yyy, zzz, xxy, xxz, xyy, yyz, xzz, yzz, xyz.
    third: [Vec4; 10],
}

impl Expansions {
    pub(super) const ZERO: Self = Self { first: [Vec4::ZERO; 3], second: [Vec4::ZERO; 6], third: [Vec4::ZERO; 10] };

    /// ∫ n·x/|x|³ to third order: with u the direction and r the distance of the centre, N, M and S the moments and t the trace of S
    /// `N·u/r² + (tr M − 3 uMu)/r³ + ½(15 Suuu − 9 t·u)/r⁴`. As uu = 1, traces go into the coefficients of the highest power.
    pub(super) fn set(&mut self, lane: usize, moments: &Moments) {
        let Moments { dipole, second: [mxx, myy, mzz, mxy, mxz, myz], third } = *moments;
        let trace = mxx + myy + mzz;
        let second = [trace - 3.0 * mxx, trace - 3.0 * myy, trace - 3.0 * mzz, -6.0 * mxy, -6.0 * mxz, -6.0 * myz];
        let [xxx, yyy, zzz, xxy, xxz, xyy, yyz, xzz, yzz, xyz] = third;
        let [x, y, z] = [xxx + xyy + xzz, xxy + yyy + yzz, xxz + yyz + zzz].map(|trace| 4.5 * trace);
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
        let kept = self.first.iter_mut().chain(&mut self.second).chain(&mut self.third);
        kept.zip(dipole.iter().chain(&second).chain(&third)).for_each(|(kept, entry)| kept[lane] = *entry as f32);
    }

    /// `offset` from the point to the centres.
    #[inline]
    pub(super) fn solid_angles(&self, offset: Wide, distance_squared: Vec4) -> Vec4 {
        let per_r = distance_squared.sqrt().recip();
        let (x, y, z) = (offset.x * per_r, offset.y * per_r, offset.z * per_r);
        let Self { first: [nx, ny, nz], second: [mxx, myy, mzz, mxy, mxz, myz], third } = self;
        let [xxx, yyy, zzz, xxy, xxz, xyy, yyz, xzz, yzz, xyz] = third;
        let first = *nx * x + *ny * y + *nz * z;
        let second = x * (*mxx * x + *mxy * y + *mxz * z) + y * (*myy * y + *myz * z) + *mzz * z * z;
        let third = x * x * (*xxx * x + *xxy * y + *xxz * z)
            + y * y * (*xyy * x + *yyy * y + *yyz * z)
            + z * z * (*xzz * x + *yzz * y + *zzz * z)
            + *xyz * x * y * z;
        per_r * per_r * (first + per_r * (second + per_r * third))
    }
}

/// Four triangles, relative to the centre of their leaf. Missing ones have no area.
#[derive(Clone)]
pub(super) struct Block {
    corners: [Wide; 3],
    /// Of the length of twice the area.
    normal: Wide,
}

impl Block {
    pub(super) const EMPTY: Self = Self { corners: [Wide::ZERO; 3], normal: Wide::ZERO };

    pub(super) fn of_triangles(triangles: impl Iterator<Item = [DVec3; 3]>) -> Self {
        let mut block = Self::EMPTY;
        for (lane, [a, b, c]) in triangles.enumerate() {
            block.normal.set(lane, (b - a).cross(c - a).as_vec3());
            block.corners.iter_mut().zip([a, b, c]).for_each(|(wide, corner)| wide.set(lane, corner.as_vec3()));
        }
        block
    }

    /// Signed solid angles, `offset` from the point to the centre of the leaf; 0 from a point in the plane of a triangle.
    #[inline]
    pub(super) fn solid_angles(&self, offset: Wide) -> Vec4 {
        let [a, b, c] = self.corners.map(|corner| corner + offset);
        let (la, lb, lc) = (a.length(), b.length(), c.length());
        let denominator = la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb;
        2.0 * atan2(a.dot(self.normal), denominator)
    }
}

/// The angle of (x, y), to 10⁻⁶; 0 for y = 0, whatever x.
///
/// # Source
/// Abramowitz and Stegun 1964, formula 4.4.49.
#[inline]
fn atan2(y: Vec4, x: Vec4) -> Vec4 {
    let (opposite, adjacent) = (y.abs(), x.abs());
    let steep = opposite.cmpgt(adjacent);
    let t = opposite.min(adjacent) / opposite.max(adjacent);
    let s = t * t;
    let mut sum = Vec4::splat(0.002_866_225_7);
    for coefficient in
        [-0.016_165_737, 0.042_909_614, -0.075_289_64, 0.106_562_64, -0.142_089, 0.199_935_51, -0.333_331_45, 1.0_f32]
    {
        sum = sum * s + Vec4::splat(coefficient);
    }
    let angle = t * sum;
    let angle = Vec4::select(steep, Vec4::splat(FRAC_PI_2) - angle, angle);
    let angle = Vec4::select(x.cmplt(Vec4::ZERO), Vec4::splat(PI) - angle, angle);
    Vec4::select(y.cmpeq(Vec4::ZERO), Vec4::ZERO, angle.copysign(y))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_are_right_to_a_millionth_all_around() {
        for k in 0..3600 {
            for radius in [1e-6, 1.0, 1e6] {
                let (sin, cos) = (0.1 * f64::from(k) + 0.01).to_radians().sin_cos();
                let (y, x) = ((radius * sin) as f32, (radius * cos) as f32);
                let angle = atan2(Vec4::splat(y), Vec4::splat(x)).x;
                assert!((angle - y.atan2(x)).abs() < 1e-6, "{y} {x}: {angle}");
            }
        }
        assert_eq!(atan2(Vec4::ZERO, Vec4::new(-1.0, 0.0, 1.0, f32::MIN_POSITIVE)), Vec4::ZERO);
    }
}
