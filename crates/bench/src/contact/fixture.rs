//! Parts for the contact bench, made and baked in memory.

use core::f64::consts::TAU;
use std::collections::HashMap;

use glam::{DQuat, DVec2, DVec3};

use super::super::BenchError;
use vps::contact::Obstacle;
use vps::mesh::primitives::Shape;
use vps::mesh::{TriangleMesh, validate};
use vps::pointshell::{self, Points, shell::Shell};
use vps::spatial::Pose;
use vps::voxmap::inside_test::InsideTest;
use vps::voxmap::{Options, Volume};

/// A tessellation's distance from its shape as a share of the voxel edge: as scenes have it.
const CHORD_SHARE: f64 = 0.02;
/// Layers of static parts and of tools: the defaults of scenes.
pub(super) const STATIC_LAYERS: u32 = 8;
const TOOL_LAYERS: u32 = 4;

/// A static part at the world's origin. `with_gradients`: for the surface-point field.
pub(super) fn obstacle(
    what: &str,
    mesh: &TriangleMesh,
    voxel_size_m: f64,
    with_gradients: bool,
) -> Result<Obstacle, BenchError> {
    let mut map = voxmap(what, mesh, voxel_size_m, STATIC_LAYERS)?;
    Ok(Obstacle { field: map.field(mesh, with_gradients), world_from_map: Pose::IDENTITY })
}

/// The points of a tool about the origin of its mesh, one for each voxel.
pub(super) fn shell(
    what: &str,
    mesh: &TriangleMesh,
    voxel_size_m: f64,
) -> Result<Shell, BenchError> {
    shell_of(what, mesh, voxel_size_m, Points::Voxels)
}

/// The same with points of either kind.
pub(super) fn shell_of(
    what: &str,
    mesh: &TriangleMesh,
    voxel_size_m: f64,
    points: Points,
) -> Result<Shell, BenchError> {
    Ok(pointshell::build_with(
        points,
        mesh,
        &voxmap(what, mesh, voxel_size_m, TOOL_LAYERS)?,
        DVec3::ZERO,
    )
    .0)
}

fn voxmap(
    what: &str,
    mesh: &TriangleMesh,
    voxel_size_m: f64,
    layers: u32,
) -> Result<Volume, BenchError> {
    let options = Options { voxel_size_m, layers, navigation: None, sides: InsideTest::Auto };
    let refused = |why: String| BenchError::Prepare { what: what.to_owned(), why };
    Volume::build(mesh, &validate::inspect(mesh), &options, |_| ())
        .map_err(|error| refused(error.to_string()))
}

/// A shape as a mesh that is fine enough for voxels of this size.
pub(super) fn tessellated(shape: Shape, voxel_size_m: f64) -> TriangleMesh {
    shape.tessellate(CHORD_SHARE * voxel_size_m)
}

/// The same mesh, turned about its origin.
pub(super) fn turned(mut mesh: TriangleMesh, by: DQuat) -> TriangleMesh {
    mesh.vertices.iter_mut().for_each(|vertex| *vertex = by * *vertex);
    mesh
}

/// A box about the origin whose edges and corners are rounded, within a tolerance of the shape.
pub(super) fn filleted_box(size_m: DVec3, fillet_m: f64, tolerance_m: f64) -> TriangleMesh {
    // Chord height r (1 − cos(θ/2)), and half a right angle on each side of an edge of the box.
    let pieces = (TAU / 8.0 / (2.0 * (1.0 - tolerance_m / fillet_m).acos())).ceil() as i32;
    let inner = 0.5 * size_m - fillet_m;
    // Lines of a lattice on the box: close together in the fillets, one piece over each flat.
    let last = 2 * pieces + 1;
    let line = |axis: usize, k: i32| {
        let (side, from_flat) =
            if k <= pieces { (-1.0, pieces - k) } else { (1.0, k - pieces - 1) };
        side * (inner[axis]
            + fillet_m * (TAU / 8.0 * f64::from(from_flat) / f64::from(pieces)).tan())
    };
    let mut mesh = TriangleMesh::default();
    let mut numbers: HashMap<[i32; 3], u32> = HashMap::new();
    let mut vertex = |lattice: [i32; 3]| {
        *numbers.entry(lattice).or_insert_with(|| {
            let on_box = DVec3::from_array([0, 1, 2].map(|axis| line(axis, lattice[axis])));
            let flat = on_box.clamp(-inner, inner);
            mesh.vertices.push(flat + (on_box - flat).normalize() * fillet_m);
            mesh.vertices.len() as u32 - 1
        })
    };
    let mut triangles = Vec::new();
    for axis in 0..3 {
        for (side, (u, v)) in [0, last]
            .into_iter()
            .flat_map(|side| (0..last).flat_map(move |u| (0..last).map(move |v| (side, (u, v)))))
        {
            let at = |u: i32, v: i32| {
                let mut lattice = [side; 3];
                (lattice[(axis + 1) % 3], lattice[(axis + 2) % 3]) = (u, v);
                lattice
            };
            let [a, b, c, d] =
                [at(u, v), at(u + 1, v), at(u + 1, v + 1), at(u, v + 1)].map(&mut vertex);
            triangles.extend(if side == 0 {
                [[a, c, b], [a, d, c]]
            } else {
                [[a, b, c], [a, c, d]]
            });
        }
    }
    mesh.triangles = triangles;
    mesh
}

/// A tube along z around the origin.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tube {
    pub(super) inner_m: f64,
    pub(super) outer_m: f64,
    pub(super) height_m: f64,
    /// Flats around it.
    pub(super) sides: usize,
    /// Pieces of each flat around, and of the walls along z: more triangles, the same solid.
    pub(super) pieces: [usize; 2],
}

impl Tube {
    /// Flats that stay within the tolerance of scenes.
    pub(super) fn sides_for(radius_m: f64, voxel_size_m: f64) -> usize {
        // Chord height r (1 − cos(π/n)) ≈ r π²/(2 n²).
        let n = TAU / 2.0 * (radius_m / (2.0 * CHORD_SHARE * voxel_size_m)).sqrt();
        (n.ceil() as usize).max(16)
    }

    pub(super) fn mesh(&self) -> TriangleMesh {
        let [around, along] = self.pieces;
        let z = 0.5 * self.height_m;
        // Counter-clockwise in the half plane (r, z): outward when it is swept around z.
        let rise = |radius: f64, from: f64, to: f64| {
            (0..=along)
                .map(move |k| DVec2::new(radius, from + (to - from) * k as f64 / along as f64))
        };
        let profile: Vec<DVec2> =
            rise(self.outer_m, -z, z).chain(rise(self.inner_m, z, -z)).collect();
        let corner =
            |k: usize| DVec2::from_angle(TAU * (k % self.sides) as f64 / self.sides as f64);
        let n_around = self.sides * around;
        let n_profile = profile.len();
        let mut vertices = Vec::with_capacity(n_around * n_profile);
        for k in 0..n_around {
            let side = k / around;
            let share = (k % around) as f64 / around as f64;
            let direction = corner(side).lerp(corner(side + 1), share);
            vertices.extend(profile.iter().map(|place| (direction * place.x).extend(place.y)));
        }
        let at = |k: usize, p: usize| ((k % n_around) * n_profile + p % n_profile) as u32;
        let mut triangles = Vec::with_capacity(2 * n_around * n_profile);
        for k in 0..n_around {
            for p in 0..n_profile {
                let [a, b, c, d] = [at(k, p), at(k + 1, p), at(k + 1, p + 1), at(k, p + 1)];
                triangles.extend([[a, b, c], [a, c, d]]);
            }
        }
        TriangleMesh { vertices, triangles }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_filleted_box_is_closed_and_outward() {
        let mesh = filleted_box(DVec3::new(0.024, 0.02, 0.016), 0.002, 4e-6);
        let report = validate::inspect(&mesh);
        let [x, y, z, r] = [0.02, 0.016, 0.012, 0.002_f64];
        let volume_m3 = x * y * z
            + 2.0 * r * (x * y + y * z + z * x)
            + TAU / 2.0 * r * r * (x + y + z)
            + 2.0 / 3.0 * TAU * r.powi(3);
        assert!(
            report.closed && (report.signed_volume_m3 / volume_m3 - 1.0).abs() < 1e-3,
            "{report:?}"
        );
    }

    #[test]
    fn a_tube_is_closed_and_outward_however_finely_it_is_cut() {
        let volume = |pieces| {
            let mesh =
                Tube { inner_m: 0.01, outer_m: 0.02, height_m: 0.03, sides: 48, pieces }.mesh();
            let report = validate::inspect(&mesh);
            assert!(report.closed, "{pieces:?}");
            (mesh.triangles.len(), report.signed_volume_m3)
        };
        let (n_coarse, coarse_m3) = volume([1, 2]);
        let (n_fine, fine_m3) = volume([3, 10]);
        assert_eq!((n_coarse, n_fine), (2 * 48 * 6, 2 * 144 * 22));
        let prism_m3 = 0.5 * 48.0 * (TAU / 48.0).sin() * (4e-4 - 1e-4) * 0.03;
        assert!(
            (coarse_m3 / prism_m3 - 1.0).abs() < 1e-9 && (fine_m3 / prism_m3 - 1.0).abs() < 1e-9,
            "{coarse_m3} {prism_m3}"
        );
    }
}
