//! Mass properties of a mesh of even density.
//!
//! Data in: a mesh in metres. Data out: volume, centre and inertia per kilogram, from the
//! divergence theorem over the triangles when they bound a volume; otherwise those of a thin shell
//! of even thickness, and a flag that says so.
//!
//! # Source
//! Ours: sums over the tetrahedra between each triangle and the middle of the bounding box, with
//! the closed form of the second moment of a tetrahedron, `∫ x xᵀ dV = V/20 (Σ vᵢ vᵢᵀ + (Σ vᵢ)(Σ
//! vᵢ)ᵀ)`.

mod file;

use glam::{DMat3, DVec3};

use super::validate::{MeshReport, inspect};
use super::{SUM_TRIANGLES, TriangleMesh};
use crate::parallel;

/// Lids on the holes may change the volume by this part of it at most, by a bound, before a shell
/// is the better guess.
const HOLE_SHARE: f64 = 0.1;
/// A volume below this part of area^1.5 is rounding noise: a sheet of 1 m² and 1 nm.
const FLAT_SHARE: f64 = 1e-9;

/// Volume, centre and inertia of a part of even density.
///
/// # Examples
/// ```
/// # use vps::{Mesh, Shape};
/// let cone = Mesh::from_shape(&Shape::Cone { radius_m: 10e-3, height_m: 40e-3 }, 1e-6)?;
/// let mass = cone.mass_properties();
/// // A quarter of the height above the base, which is 20 mm below the origin.
/// assert!((mass.center_m.z + 10e-3).abs() < 1e-9);
/// assert!(!mass.from_surface);
/// # Ok::<(), vps::Error>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MassProperties {
    /// Volume, m³, positive also when the triangles face inward; 0 when `from_surface`.
    pub volume_m3: f64,
    /// Centre of mass in the mesh file's own frame, m.
    pub center_m: DVec3,
    /// Inertia about the centre of mass in the axes of the file, per kilogram of mass, m².
    pub inertia_per_mass: DMat3,
    /// The mesh bounds no usable volume: mass is spread evenly over its surface.
    pub from_surface: bool,
}

/// Mass properties; inspects the mesh first.
pub fn mass_properties(mesh: &TriangleMesh) -> MassProperties {
    mass_properties_of_inspected(mesh, &inspect(mesh))
}

/// The same, with the report at hand.
///
/// Slits between faces that do not match do no harm and leave the volume in use. Holes of which a
/// lid could change the volume by more than a tenth, and triangles that face opposite ways, do not.
pub fn mass_properties_of_inspected(mesh: &TriangleMesh, report: &MeshReport) -> MassProperties {
    let Some((low, high)) = report.bounds_m else {
        return MassProperties {
            volume_m3: 0.0,
            center_m: DVec3::ZERO,
            inertia_per_mass: DMat3::ZERO,
            from_surface: true,
        };
    };
    let middle = 0.5 * (low + high);
    let hole_area: f64 = report
        .boundary_loops
        .iter()
        .map(|rim| std::f64::consts::FRAC_PI_4 * rim.size_m * rim.size_m)
        .sum();
    // A lid is the base of a cone whose apex is the middle of the box, at most half a diagonal
    // away.
    let missing = hole_area * 0.5 * low.distance(high) / 3.0;
    let volume = report.signed_volume_m3.abs();
    let usable = report.inconsistent_edges == 0
        && missing <= HOLE_SHARE * volume
        && volume > FLAT_SHARE * report.area_m2.powf(1.5);

    let solid = if usable { of_body(mesh, middle) } else { None };
    solid.unwrap_or_else(|| {
        let moments = Moments::of(mesh, middle, |[a, b, c]| TriangleContribution {
            amount: 0.5 * (b - a).cross(c - a).length(),
            center: (a + b + c) / 3.0,
            mean_square: (outer(a) + outer(b) + outer(c) + outer(a + b + c)) * (1.0 / 12.0),
        });
        moments.finish(middle)
    })
}

/// Mass properties of what closed, consistently wound triangles bound; `middle` is a point near
/// them.
pub(crate) fn of_closed(mesh: &TriangleMesh, middle: DVec3) -> MassProperties {
    let moments = Moments::of(mesh, middle, |[a, b, c]| TriangleContribution {
        amount: a.dot(b.cross(c)) / 6.0,
        // A tetrahedron has its fourth corner at the origin.
        center: (a + b + c) / 4.0,
        mean_square: (outer(a) + outer(b) + outer(c) + outer(a + b + c)) * (1.0 / 20.0),
    });
    MassProperties {
        volume_m3: moments.amount.abs(),
        from_surface: false,
        ..moments.finish(middle)
    }
}

/// The same of triangles that nearly do; `None` where no body has these moments: patches that face
/// inward without a shared edge can leave such ones.
pub(crate) fn of_body(mesh: &TriangleMesh, middle: DVec3) -> Option<MassProperties> {
    Some(of_closed(mesh, middle)).filter(is_a_body)
}

/// Mass properties of bodies together, which do not overlap; each bounds a volume.
pub(crate) fn of_all(bodies: impl Iterator<Item = MassProperties>) -> MassProperties {
    let plus = |all: MassProperties, body: MassProperties| {
        let volume_m3 = all.volume_m3 + body.volume_m3;
        let [one, other] = [&all, &body].map(|part| part.volume_m3 / volume_m3);
        let center_m = all.center_m * one + body.center_m * other;
        let about = |part: &MassProperties| {
            let away = part.center_m - center_m;
            part.inertia_per_mass + DMat3::from_diagonal(DVec3::splat(away.length_squared()))
                - outer(away)
        };
        let inertia_per_mass = about(&all) * one + about(&body) * other;
        MassProperties { volume_m3, center_m, inertia_per_mass, from_surface: false }
    };
    bodies.reduce(plus).unwrap_or(MassProperties {
        volume_m3: 0.0,
        center_m: DVec3::ZERO,
        inertia_per_mass: DMat3::ZERO,
        from_surface: true,
    })
}

/// Any principal moment of a body is at most the sum of the other two; on the axes of the file this
/// is necessary.
fn is_a_body(properties: &MassProperties) -> bool {
    let inertia = properties.inertia_per_mass;
    let [x, y, z] = [inertia.x_axis.x, inertia.y_axis.y, inertia.z_axis.z];
    let slack = 1e-9 * (x + y + z);
    inertia.is_finite()
        && x > 0.0
        && y > 0.0
        && z > 0.0
        && x <= y + z + slack
        && y <= z + x + slack
        && z <= x + y + slack
}

/// What one triangle adds: an amount (volume or area), its centre, and the mean of `x xᵀ` over it.
struct TriangleContribution {
    amount: f64,
    center: DVec3,
    mean_square: DMat3,
}

/// Sums over the triangles, about the middle of the box.
#[derive(Default)]
struct Moments {
    amount: f64,
    first: DVec3,
    second: DMat3,
}

impl Moments {
    fn of(
        mesh: &TriangleMesh,
        middle: DVec3,
        contribution: impl Fn([DVec3; 3]) -> TriangleContribution + Sync,
    ) -> Self {
        let sum_of = |corners: &[[u32; 3]]| {
            let mut sum = Self { second: DMat3::ZERO, ..Default::default() };
            for corners in corners {
                let corners = corners.map(|vertex| mesh.vertices[vertex as usize] - middle);
                let TriangleContribution { amount, center, mean_square } = contribution(corners);
                sum.amount += amount;
                sum.first += center * amount;
                sum.second += mean_square * amount;
            }
            sum
        };
        let sums = parallel::map_chunks(&mesh.triangles, SUM_TRIANGLES, sum_of);
        sums.into_iter().fold(Self { second: DMat3::ZERO, ..Default::default() }, |sum, part| {
            Self {
                amount: sum.amount + part.amount,
                first: sum.first + part.first,
                second: sum.second + part.second,
            }
        })
    }

    /// Without any amount (every triangle degenerate) the centre is the middle of the box and the
    /// inertia zero.
    fn finish(self, middle: DVec3) -> MassProperties {
        let (center, mean_square) = if self.amount == 0.0 {
            (DVec3::ZERO, DMat3::ZERO)
        } else {
            (self.first / self.amount, self.second / self.amount)
        };
        let spread = mean_square - outer(center);
        let trace = spread.x_axis.x + spread.y_axis.y + spread.z_axis.z;
        MassProperties {
            volume_m3: 0.0,
            center_m: middle + center,
            inertia_per_mass: DMat3::from_diagonal(DVec3::splat(trace)) - spread,
            from_surface: true,
        }
    }
}

fn outer(v: DVec3) -> DMat3 {
    DMat3::from_cols(v * v.x, v * v.y, v * v.z)
}

#[cfg(test)]
mod tests {
    use super::super::primitives::Shape;
    use super::*;

    fn assert_inertia(found: DMat3, expected: DVec3, tolerance: f64) {
        let difference = found - DMat3::from_diagonal(expected);
        let worst =
            difference.to_cols_array().iter().fold(0.0_f64, |worst, entry| worst.max(entry.abs()));
        assert!(worst <= tolerance * expected.max_element(), "{found:?} instead of {expected:?}");
    }

    #[test]
    fn shapes_have_their_textbook_moments() {
        let r = 0.02;
        let h = 0.05;
        let cases = [
            (
                Shape::Box { size_m: DVec3::new(0.1, 0.2, 0.3) },
                DVec3::ZERO,
                DVec3::new(0.13, 0.10, 0.05) / 12.0,
                0.006,
            ),
            (
                Shape::Sphere { radius_m: r },
                DVec3::ZERO,
                DVec3::splat(0.4 * r * r),
                4.0 / 3.0 * std::f64::consts::PI * r * r * r,
            ),
            (
                Shape::Cone { radius_m: r, height_m: h },
                DVec3::new(0.0, 0.0, -0.25 * h),
                DVec3::new(
                    0.15 * r * r + 0.0375 * h * h,
                    0.15 * r * r + 0.0375 * h * h,
                    0.3 * r * r,
                ),
                std::f64::consts::PI * r * r * h / 3.0,
            ),
        ];
        for (shape, center, inertia, volume) in cases {
            let mut mesh = shape.tessellate(1e-6);
            let far = DVec3::new(1.0, -2.0, 3.0);
            mesh.vertices.iter_mut().for_each(|vertex| *vertex += far);
            for _ in 0..2 {
                let found = mass_properties(&mesh);
                assert!(!found.from_surface);
                assert!((found.volume_m3 / volume - 1.0).abs() < 1e-3, "{found:?}");
                assert!(found.center_m.distance(far + center) < 1e-5, "{found:?}");
                assert_inertia(found.inertia_per_mass, inertia, 1e-3);
                // Inside out, the same part.
                mesh.triangles.iter_mut().for_each(|corners| corners.swap(0, 1));
            }
        }
    }

    #[test]
    fn open_and_flat_meshes_are_shells() {
        let mut open = Shape::Sphere { radius_m: 0.03 }.tessellate(1e-6);
        open.triangles.retain(|corners| corners.iter().all(|vertex| *vertex != 0));
        let few_missing = mass_properties(&open);
        assert!(!few_missing.from_surface, "a pinhole leaves the volume usable");
        let sphere = Shape::Sphere { radius_m: 0.03 }.tessellate(1e-6);
        let mut half = sphere.clone();
        half.triangles.retain(|corners| {
            corners.iter().all(|vertex| sphere.vertices[*vertex as usize].z <= 1e-12)
        });
        let shell = mass_properties(&half);
        assert!(shell.from_surface && shell.volume_m3 == 0.0);
        assert!((shell.center_m.z + 0.015).abs() < 1e-4, "{shell:?}");

        let sheet = TriangleMesh {
            vertices: vec![DVec3::ZERO, DVec3::X, DVec3::new(1.0, 1.0, 0.0), DVec3::Y],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
        };
        let found = mass_properties(&sheet);
        assert!(found.from_surface && found.center_m.distance(DVec3::new(0.5, 0.5, 0.0)) < 1e-15);
        assert_inertia(found.inertia_per_mass, DVec3::new(1.0, 1.0, 2.0) / 12.0, 1e-12);
        assert!(mass_properties(&TriangleMesh::default()).from_surface);
    }

    #[test]
    fn triangles_that_face_opposite_ways_give_a_shell() {
        let mut mesh = Shape::Box { size_m: DVec3::ONE }.tessellate(1.0);
        mesh.triangles[3].swap(0, 1);
        assert!(mass_properties(&mesh).from_surface);
    }
}
