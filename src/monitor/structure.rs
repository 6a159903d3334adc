//! What contact works with, for a picture: the surface voxels of an object, or its points. Both are baked anew, as a scene keeps neither voxels nor the points
//! of its fixed parts.
//!
//! # Source
//! Sagardia2008, figure 4: polygons, voxmap and pointshell of one model.

use glam::{DVec3, IVec3};

use crate::config::SceneConfig;
use crate::scene::{self, MemoryPlan};
use vps::mesh::TriangleMesh;
use vps::pointshell;
use vps::storage::memory;
use vps::voxmap::{Options, Volume};

/// Faces or points of one object on a page.
const MOST_FACES: usize = 120_000;
/// Faces of voxels that look outward to a face of a voxel of surface, where it lies at its worst in the grid: √3.
const FACES_PER_AREA: f64 = 1.74;
/// By how much voxels grow until few enough faces are left: a rough surface has more than a smooth one.
const GROWTH: f64 = 1.2;
/// Version of the layout.
const VERSION: u32 = 1;
const HEAD_BYTES: usize = 24;
const FACE_BYTES: usize = 16;

/// Which of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Structure {
    Voxels,
    Points,
}

/// A square of a voxel, or what stands for a point: where (object's own frame, m), which way it looks, and which of two colours it has.
struct Face {
    place_m: DVec3,
    outward: DVec3,
    color: u8,
}

/// All of them; the layout is in `docs/reference/api.md`, section 9. `None`: there is no such object, its mesh is gone, or there is no memory for it.
pub(super) fn file(config: &SceneConfig, object_idx: usize, structure: Structure) -> Option<Vec<u8>> {
    let request = scene::requests(config).nth(object_idx)?;
    let part = scene::load(request.name, request.source, request.spacing).ok()?;
    let own = request.options(&part);
    let coarse_m = (FACES_PER_AREA * area_m2(&part.mesh) / MOST_FACES as f64).sqrt();
    let mut options = Options { voxel_size_m: own.voxel_size_m.max(coarse_m), ..own };
    loop {
        MemoryPlan::new(None, |_, _| {}).within(memory::available_bytes).judge(&part, &options, request.products()).ok()?;
        let map = part.voxmap(&options, |_| {}).ok()?;
        let (n, faces) = match structure {
            Structure::Voxels => (map.surface.n_voxels, voxel_faces(&map)),
            Structure::Points => {
                let (shell, _) = pointshell::build_with(request.points, &part.mesh, &map, DVec3::ZERO);
                (shell.len(), shell.points().map(|(place, inward)| Face::of_point(place.as_dvec3(), inward.as_dvec3())).collect())
            }
        };
        // A mesh of many facets has a point for each, however large its voxels are: of these one in so many is drawn.
        if structure == Structure::Points || faces.len() <= MOST_FACES {
            return Some(bytes(&faces, n, [options.voxel_size_m, own.voxel_size_m]));
        }
        options.voxel_size_m *= GROWTH;
    }
}

impl Face {
    fn of_point(place_m: DVec3, inward: DVec3) -> Self {
        Self { place_m, outward: -inward, color: 0 }
    }
}

fn area_m2(mesh: &TriangleMesh) -> f64 {
    let area_m2 = |n| {
        let [a, b, c] = mesh.corners(n);
        0.5 * (b - a).cross(c - a).length()
    };
    (0..mesh.triangles.len()).map(area_m2).sum()
}

/// Faces of surface voxels with neither another one nor the inside beyond.
fn voxel_faces(map: &Volume) -> Vec<Face> {
    let surface = &map.surface;
    let half_m = 0.5 * surface.grid.voxel_size_m;
    let mut faces = Vec::new();
    for cell in surface.cells() {
        let place_m = surface.grid.center_map(cell);
        // Neighbouring voxels in turn, as on a board: a wall of them would be one area otherwise.
        let color = (cell.iter().sum::<i32>() & 1) as u8;
        for way in [IVec3::X, IVec3::Y, IVec3::Z].into_iter().flat_map(|axis| [axis, -axis]) {
            let beyond = (IVec3::from(cell) + way).to_array();
            if !surface.contains(beyond) && map.layers.value(beyond) < 0 {
                let outward = way.as_dvec3();
                faces.push(Face { place_m: place_m + outward * half_m, outward, color });
            }
        }
    }
    faces
}

/// `n`: voxels or points that there are; `sizes_m`: of the voxels here, and of those of the scene.
fn bytes(faces: &[Face], n: usize, sizes_m: [f64; 2]) -> Vec<u8> {
    let step = faces.len().div_ceil(MOST_FACES).max(1);
    let n_faces = faces.len().div_ceil(step);
    let mut bytes = Vec::with_capacity(HEAD_BYTES + FACE_BYTES * n_faces);
    bytes.extend(b"HVPS");
    for number in [VERSION, n_faces as u32, n as u32] {
        bytes.extend(number.to_le_bytes());
    }
    for size_m in sizes_m {
        bytes.extend((size_m as f32).to_le_bytes());
    }
    for Face { place_m, outward, color } in faces.iter().step_by(step) {
        for coordinate in place_m.as_vec3().to_array() {
            bytes.extend(coordinate.to_le_bytes());
        }
        bytes.extend((127.0 * *outward).to_array().map(|part| (part.round() as i8).to_le_bytes()[0]));
        bytes.push(*color);
    }
    bytes
}

#[cfg(test)]
mod tests {
    use vps::mesh::primitives::Shape;
    use vps::mesh::validate::inspect;
    use vps::voxmap::inside_test::InsideTest;

    use super::*;

    #[test]
    fn faces_of_voxels_are_those_of_the_outside_alone() {
        let mesh = Shape::Box { size_m: DVec3::splat(0.01) }.tessellate(1e-4);
        let options = Options { voxel_size_m: 1e-3, layers: 2, navigation: None, sides: InsideTest::Auto };
        let map = Volume::build(&mesh, &inspect(&mesh), &options, |_| {}).expect("small");
        let faces = voxel_faces(&map);
        // A cube of 11 voxels, whose hollow nobody sees.
        assert_eq!((map.surface.n_voxels, faces.len()), (11_usize.pow(3) - 9_usize.pow(3), 6 * 11 * 11));
        for Face { place_m, outward, .. } in &faces {
            assert!((place_m.dot(*outward) - 5.5e-3).abs() < 1e-9, "{place_m} {outward}");
        }
        let n_dark = faces.iter().filter(|face| face.color == 0).count();
        assert!([6 * 60, 6 * 61].contains(&n_dark), "{n_dark}");
    }

    #[test]
    fn many_points_are_thinned_and_counted() {
        let points: Vec<_> = (0..2 * MOST_FACES + 1).map(|n| Face::of_point(DVec3::X * n as f64, DVec3::NEG_Z)).collect();
        let bytes = bytes(&points, points.len(), [2e-3, 1e-3]);
        let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().expect("four"));
        let n_faces = word(8) as usize;
        assert!(n_faces <= MOST_FACES && bytes.len() == HEAD_BYTES + FACE_BYTES * n_faces, "{n_faces}");
        assert_eq!((&bytes[..4], word(4), word(12)), (&b"HVPS"[..], VERSION, points.len() as u32));
        assert_eq!([16, 20, HEAD_BYTES + FACE_BYTES].map(|at| f32::from_bits(word(at))), [2e-3, 1e-3, 3.0]);
        assert_eq!(bytes[HEAD_BYTES + 12..HEAD_BYTES + 16], [0, 0, 127, 0]);
    }
}
