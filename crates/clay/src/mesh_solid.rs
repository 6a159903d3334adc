//! The solid that the triangles of a file bound, as far as clay is made of it.

use super::load::{DEFAULT_SAMPLES, area_m2, spacing_of};
use vps::mesh::{FileMesh, TriangleMesh};
use vps::solid::{self, SolidOptions};

/// The border of a solid, and what a user should know of its file.
#[derive(Clone, Debug)]
pub(super) struct MeshSolid {
    /// Closed and outward, m; open where most of the file's area is.
    pub(super) border: TriangleMesh,
    /// A sentence each.
    pub(super) warnings: Vec<String>,
}

impl MeshSolid {
    /// The solid of a file that is sampled so finely, m; `None`: by about as many samples as a file
    /// that says nothing gets. Cost: that of [`solid::Solid::of`].
    pub(super) fn new(file: FileMesh, spacing_m: Option<f64>) -> Self {
        let spacing_m = spacing_m.unwrap_or_else(|| spacing_of(&file.mesh, DEFAULT_SAMPLES));
        let solid::Solid { mut border, skins, report } =
            solid::Solid::of(&file.mesh, &SolidOptions::resolved_by(Some(spacing_m)));
        let mut warnings = file.notes;
        warnings.extend(report.warnings());
        // A scan with a hole is a skin: closed crumbs that float beside it do not take its place.
        if area_m2(&skins) > area_m2(&border) {
            let first = border.vertices.len() as u32;
            border.vertices.extend(skins.vertices);
            let triangles = skins.triangles.into_iter();
            border.triangles.extend(triangles.map(|corners| corners.map(|corner| corner + first)));
        } else if !skins.triangles.is_empty() {
            warnings.push(
                "clay is made of closed pieces alone: skins beside them were left out".to_owned(),
            );
        }
        Self { border, warnings }
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use glam::DVec3;

    use super::*;
    use crate::clay_model::Settings;
    use crate::{ClayModel, sample};
    use vps::mesh::primitives::Shape;
    use vps::mesh::validate::inspect;

    const MM: f64 = 1e-3;

    fn ball(radius_mm: f64, x_mm: f64) -> TriangleMesh {
        let mut mesh = Shape::Sphere { radius_m: radius_mm * MM }.tessellate(0.01 * MM);
        mesh.vertices.iter_mut().for_each(|at| at.x += x_mm * MM);
        mesh
    }

    fn inward(mut mesh: TriangleMesh) -> TriangleMesh {
        mesh.triangles.iter_mut().for_each(|corners| corners.swap(0, 1));
        mesh
    }

    fn together(meshes: impl IntoIterator<Item = TriangleMesh>) -> MeshSolid {
        let mut all = TriangleMesh::default();
        for mesh in meshes {
            let first = all.vertices.len() as u32;
            all.vertices.extend(mesh.vertices);
            let triangles = mesh.triangles.into_iter();
            all.triangles.extend(triangles.map(|corners| corners.map(|corner| corner + first)));
        }
        MeshSolid::new(FileMesh::from(all), None)
    }

    fn clay(solid: &MeshSolid) -> ClayModel {
        let settings = Settings { raster: [48; 3], air_m: 3.0 * MM, ..Settings::default() };
        ClayModel::new(sample(&solid.border, 0.6 * MM).unwrap(), settings).unwrap()
    }

    fn ball_mm3(radius_mm: f64) -> f64 {
        4.0 / 3.0 * PI * radius_mm.powi(3)
    }

    #[test]
    fn clay_of_several_pieces_is_the_clay_of_their_solid() {
        // Caps of height h of balls of 10 and 8 mm, 8 mm apart, that meet in the plane x = 6.25.
        let cap_mm3 = |radius_mm: f64, h_mm: f64| PI * h_mm * h_mm * (radius_mm - h_mm / 3.0);
        let lens_mm3 = cap_mm3(10.0, 3.75) + cap_mm3(8.0, 6.25);
        let union_mm3 = ball_mm3(10.0) + ball_mm3(8.0) - lens_mm3;
        assert!((union_mm3 - 5221.0).abs() < 1.0, "{union_mm3}");
        let cases = [
            ("two that overlap", vec![ball(10.0, 0.0), ball(8.0, 8.0)], union_mm3, 1),
            ("one in the other", vec![ball(10.0, 0.0), ball(6.0, 1.0)], ball_mm3(10.0), 1),
            ("one that faces inward", vec![inward(ball(10.0, 0.0))], ball_mm3(10.0), 1),
            (
                "a hollow one",
                vec![ball(10.0, 0.0), inward(ball(6.0, 1.0))],
                ball_mm3(10.0) - ball_mm3(6.0),
                1,
            ),
            ("one alone", vec![ball(10.0, 0.0)], ball_mm3(10.0), 0),
        ];
        for (what, balls, right_mm3, n_warnings) in cases {
            let solid = together(balls);
            assert_eq!(solid.warnings.len(), n_warnings, "{what}: {:?}", solid.warnings);
            let clay = clay(&solid);
            let found_mm3 = clay.volume_m3().unwrap() * 1e9;
            assert!(
                (found_mm3 / right_mm3 - 1.0).abs() < 0.01,
                "{what}: {found_mm3} mm³ of {right_mm3}"
            );
            let report = inspect(&clay.mesh().unwrap());
            assert_eq!((report.open_edges, report.non_manifold_edges), (0, 0), "{what}");
        }
    }

    #[test]
    fn cracks_are_joined_as_far_as_the_samples_do_not_show_them() {
        // Each face ends 0.015 mm before its edges, so 0.021 mm are between two.
        let whole = Shape::Box { size_m: DVec3::splat(20.0 * MM) }.tessellate(MM);
        let faces = whole.triangles.iter().map(|triangle| {
            let corners = triangle.map(|vertex| whole.vertices[vertex as usize]);
            let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize();
            let inner = DVec3::splat(9.985 * MM);
            let ends = corners.map(|at| at.clamp(-inner, inner) + normal * (0.015 * MM));
            TriangleMesh { vertices: ends.to_vec(), triangles: vec![[0, 1, 2]] }
        });
        let all = faces.fold(TriangleMesh::default(), |mut all, face| {
            let first = all.vertices.len() as u32;
            all.vertices.extend(face.vertices);
            all.triangles.push([first, first + 1, first + 2]);
            all
        });
        // Without a word, samples are some 0.35 mm apart.
        for (spacing_mm, is_joined) in [(None, true), (Some(0.3), true), (Some(0.15), false)] {
            let spacing_m = spacing_mm.map(|spacing_mm: f64| spacing_mm * MM);
            let solid = MeshSolid::new(FileMesh::from(all.clone()), spacing_m);
            let is_closed = inspect(&solid.border).open_edges == 0;
            assert_eq!(is_closed, is_joined, "{spacing_mm:?}: {:?}", solid.warnings);
            let is_said = solid.warnings.iter().any(|text| text.contains("were joined with them"));
            assert_eq!(is_said, is_joined, "{spacing_mm:?}: {:?}", solid.warnings);
        }
    }

    #[test]
    fn skins_beside_bodies_are_left_out_a_scan_with_holes_is_not_and_readers_are_heard() {
        let sheet = |edge_mm: f64| TriangleMesh {
            vertices: [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
                .map(|[y, z]| DVec3::new(30.0, y * edge_mm, z * edge_mm) * MM)
                .to_vec(),
            triangles: vec![[0, 1, 2], [0, 2, 3]],
        };
        let n_of_ball = ball(10.0, 0.0).triangles.len();
        let small = together([ball(10.0, 0.0), sheet(6.0)]);
        assert_eq!(small.border.triangles.len(), n_of_ball);
        let left_out = |solid: &MeshSolid| {
            solid.warnings.iter().any(|text| text.ends_with("skins beside them were left out"))
        };
        assert!(left_out(&small), "{:?}", small.warnings);
        // A ball with a hole, and a crumb beside it.
        let mut open = ball(10.0, 0.0);
        open.triangles.truncate(n_of_ball - 20);
        let scan = together([ball(0.5, 30.0), open]);
        let n_of_crumb = ball(0.5, 30.0).triangles.len();
        assert_eq!(scan.border.triangles.len(), n_of_crumb + n_of_ball - 20);
        assert!(!left_out(&scan), "{:?}", scan.warnings);
        let noted = FileMesh {
            mesh: ball(10.0, 0.0),
            notes: vec!["a note".to_owned()],
            ..FileMesh::default()
        };
        assert_eq!(MeshSolid::new(noted, None).warnings, ["a note"]);
        let sheet_alone = together([sheet(6.0)]);
        assert_eq!(sheet_alone.border.triangles.len(), 2);
    }
}
