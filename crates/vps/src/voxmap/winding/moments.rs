//! What a node of the tree knows of its triangles, and how parents learn it from their children.

use glam::DVec3;

/// ∫ n, sym ∫ δ n and sym ∫ δ δ n over triangles, δ the offset from the centre.
#[derive(Clone, Copy, Default)]
pub(super) struct Moments {
    /// x, y, z.
    pub(super) dipole: [f64; 3],
    /// xx, yy, zz, xy, xz, yz.
    pub(super) second: [f64; 6],
    /// xxx, yyy, zzz, xxy, xxz, xyy, yyz, xzz, yzz, xyz.
    pub(super) third: [f64; 10],
}

/// What a parent needs to know of a subtree.
pub(super) struct SubtreeSummary {
    pub(super) n_triangles: usize,
    area: f64,
    pub(super) center: DVec3,
    /// Around the centre, holds every triangle.
    pub(super) radius: f64,
    low: DVec3,
    high: DVec3,
    pub(super) moments: Moments,
}

impl SubtreeSummary {
    pub(super) fn of_triangles(triangles: impl Iterator<Item = [DVec3; 3]> + Clone) -> Self {
        let mut area = 0.0;
        let mut weighted = DVec3::ZERO;
        let mut n_triangles = 0;
        let mut low = DVec3::INFINITY;
        let mut high = DVec3::NEG_INFINITY;
        let mut middle = DVec3::ZERO;
        for [a, b, c] in triangles.clone() {
            let double_area = (b - a).cross(c - a).length();
            area += 0.5 * double_area;
            weighted += (a + b + c) * (double_area / 6.0);
            middle += (a + b + c) / 3.0;
            n_triangles += 1;
            low = low.min(a).min(b).min(c);
            high = high.max(a).max(b).max(c);
        }
        // Triangles without area have a place but no weight.
        let center =
            if area > 0.0 { weighted / area } else { middle / f64::from(n_triangles.max(1)) };
        let mut radius_squared = 0.0_f64;
        let mut moments = Moments::default();
        for corners in triangles {
            let [a, b, c] = corners.map(|corner| corner - center);
            radius_squared = radius_squared
                .max(a.length_squared())
                .max(b.length_squared())
                .max(c.length_squared());
            let normal = 0.5 * (b - a).cross(c - a);
            let sum = a + b + c;
            let spread: [f64; 6] = {
                let squares = [a, b, c, sum].map(square);
                core::array::from_fn(|k| squares.iter().map(|entry| entry[k]).sum::<f64>() / 12.0)
            };
            moments.add(normal, product(sum / 3.0, normal), triple(normal, &spread));
        }
        Self {
            n_triangles: n_triangles as usize,
            area,
            center,
            radius: radius_squared.sqrt(),
            low,
            high,
            moments,
        }
    }

    pub(super) fn of_parts(parts: &[Self]) -> Self {
        let n_triangles = parts.iter().map(|part| part.n_triangles).sum();
        let area: f64 = parts.iter().map(|part| part.area).sum();
        let by_count = n_triangles as f64;
        let share = |part: &Self| {
            if area > 0.0 { part.area / area } else { part.n_triangles as f64 / by_count.max(1.0) }
        };
        let center: DVec3 = parts.iter().map(|part| share(part) * part.center).sum();
        let mut low = DVec3::INFINITY;
        let mut high = DVec3::NEG_INFINITY;
        let mut moments = Moments::default();
        let mut radius = 0.0_f64;
        for part in parts.iter().filter(|part| part.n_triangles > 0) {
            (low, high) = (low.min(part.low), high.max(part.high));
            let shift = part.center - center;
            radius = radius.max(part.radius + shift.length());
            let Moments { dipole, second, third } = part.moments;
            let dipole = DVec3::from_array(dipole);
            let moved = product(shift, dipole);
            let doubled = second.map(|entry| 2.0 * entry);
            let mixed = triple(shift, &doubled);
            let far = triple(dipole, &square(shift));
            moments.add(
                dipole,
                core::array::from_fn(|k| second[k] + moved[k]),
                core::array::from_fn(|k| third[k] + mixed[k] + far[k]),
            );
        }
        let to_corner = (high - center).max(center - low).length();
        Self { n_triangles, area, center, radius: radius.min(to_corner), low, high, moments }
    }
}

impl Moments {
    fn add(&mut self, dipole: DVec3, second: [f64; 6], third: [f64; 10]) {
        self.dipole.iter_mut().zip(dipole.to_array()).for_each(|(sum, entry)| *sum += entry);
        self.second.iter_mut().zip(second).for_each(|(sum, entry)| *sum += entry);
        self.third.iter_mut().zip(third).for_each(|(sum, entry)| *sum += entry);
    }
}

/// v vᵀ: xx, yy, zz, xy, xz, yz.
fn square(v: DVec3) -> [f64; 6] {
    product(v, v)
}

/// Symmetric part of u vᵀ.
fn product(u: DVec3, v: DVec3) -> [f64; 6] {
    let mixed = |i: usize, j: usize| 0.5 * (u[i] * v[j] + u[j] * v[i]);
    [u.x * v.x, u.y * v.y, u.z * v.z, mixed(0, 1), mixed(0, 2), mixed(1, 2)]
}

/// Symmetric part of u ⊗ c for a symmetric c.
fn triple(u: DVec3, c: &[f64; 6]) -> [f64; 10] {
    let [xx, yy, zz, xy, xz, yz] = *c;
    let twice =
        |one: f64, mixed: f64, other: f64, square: f64| (2.0 * one * mixed + other * square) / 3.0;
    [
        u.x * xx,
        u.y * yy,
        u.z * zz,
        twice(u.x, xy, u.y, xx),
        twice(u.x, xz, u.z, xx),
        twice(u.y, xy, u.x, yy),
        twice(u.y, yz, u.z, yy),
        twice(u.z, xz, u.x, zz),
        twice(u.z, yz, u.y, zz),
        (u.x * yz + u.y * xz + u.z * xy) / 3.0,
    ]
}
