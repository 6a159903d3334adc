//! The structures of the method for a picture: the surface voxels of an object, or its pointshell.
//! A scene keeps the pointshell of its tool and no voxels; all else is baked anew.
//!
//! # Source
//! Sagardia2008, figure 4: polygons, voxmap and pointshell of one model.

use axum::http::StatusCode;
use glam::{DVec3, IVec3, Vec3};
use rayon::{ThreadPool, ThreadPoolBuilder};

use super::problem::RequestError;
use crate::config::setting_names::KEYS;
use crate::daemon::session::SceneView;
use crate::scene;
use rt::schedule::enter_background;
use vps::part::{Part, PartError};
use vps::pointshell;
use vps::pointshell::shell::Shell;
use vps::voxmap::estimate::Products;
use vps::voxmap::{Options, Volume};

/// Marks of one object on a page.
const MOST_MARKS: usize = 120_000;
/// A plane across (1, 1, 1) has √3 times its area in faces of voxels, and no other has more.
const FACES_PER_AREA: f64 = 1.74;
/// By how much voxels grow until few enough faces are left: a rough surface has more than a smooth
/// one.
const GROWTH: f64 = 1.2;
/// Version of the layout.
const VERSION: u32 = 1;
const HEAD_BYTES: usize = 24;
const MARK_BYTES: usize = 16;

/// Which of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Structure {
    Voxels,
    Points,
}

/// A face of a voxel, or a point: where (object's own frame, m), which way it looks, and which of
/// two colours it has.
struct Mark {
    place_m: DVec3,
    outward: DVec3,
    color: u8,
}

/// All of them; the layout is in `docs/reference/api.md`, section 9. Object `object_idx`: the fixed
/// ones in order, then the tool.
///
/// # Errors
/// There is no such object, or it cannot be baked here: its mesh is gone, or memory is short.
pub(super) fn file(
    view: &SceneView,
    object_idx: usize,
    structure: Structure,
) -> Result<Vec<u8>, RequestError> {
    let config = &view.config;
    let request = scene::requests(config)
        .nth(object_idx)
        .ok_or_else(|| RequestError::new(StatusCode::NOT_FOUND, "no such object", ""))?;
    if let Some(scene) = view
        .scene
        .as_ref()
        .filter(|_| structure == Structure::Points && object_idx == config.statics.len())
    {
        return Ok(of_points(
            &scene.tool.shell,
            scene.tool.center_of_mass_tool,
            [config.tool.voxel_size_m; 2],
        ));
    }
    let refused = |error: PartError| {
        RequestError::unavailable(error.to_string(), error.hint(&KEYS).unwrap_or_default())
    };
    let part = scene::load(request.name, request.source, request.spacing).map_err(refused)?;
    let own = request.options(&part);
    let coarse_m = (FACES_PER_AREA * part.area_m2() / MOST_MARKS as f64).sqrt();
    let mut options = Options { voxel_size_m: own.voxel_size_m.max(coarse_m), ..own };
    let pool = background().map_err(|error| {
        RequestError::unavailable(format!("cannot start a thread: {error}"), "ask again")
    })?;
    pool.install(|| {
        loop {
            let map = baked(&part, &options, structure).map_err(refused)?;
            let sizes_m = [options.voxel_size_m, own.voxel_size_m];
            if structure == Structure::Points {
                let (shell, _) =
                    pointshell::build_with(request.points, &part.mesh, &map, DVec3::ZERO);
                return Ok(of_points(&shell, DVec3::ZERO, sizes_m));
            }
            let faces = faces(&map);
            if faces.len() <= MOST_MARKS {
                return Ok(bytes(&faces, map.surface.n_voxels, sizes_m));
            }
            options.voxel_size_m *= GROWTH;
        }
    })
}

/// Threads that a loop beside them does not wait for.
fn background() -> Result<ThreadPool, rayon::ThreadPoolBuildError> {
    ThreadPoolBuilder::new().start_handler(|_| enter_background()).build()
}

fn baked(part: &Part, options: &Options, structure: Structure) -> Result<Volume, PartError> {
    part.fits(
        options,
        Products { field: false, gradients: false, shell: structure == Structure::Points },
    )?;
    part.voxmap(options, |_| {})
}

/// Of more points than are to be drawn one in so many.
fn of_points(shell: &Shell, origin_m: DVec3, sizes_m: [f64; 2]) -> Vec<u8> {
    let step = shell.len().div_ceil(MOST_MARKS).max(1);
    let mark = |(place, inward): (Vec3, Vec3)| Mark {
        place_m: origin_m + place.as_dvec3(),
        outward: -inward.as_dvec3(),
        color: 0,
    };
    let marks: Vec<Mark> = shell.points().step_by(step).map(mark).collect();
    bytes(&marks, shell.len(), sizes_m)
}

/// Faces of surface voxels with neither another one nor the inside beyond.
fn faces(map: &Volume) -> Vec<Mark> {
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
                faces.push(Mark { place_m: place_m + outward * half_m, outward, color });
            }
        }
    }
    faces
}

/// `n`: voxels or points that there are; `sizes_m`: edges of the voxels that were baked, and of
/// those of the scene.
fn bytes(marks: &[Mark], n: usize, sizes_m: [f64; 2]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(HEAD_BYTES + MARK_BYTES * marks.len());
    bytes.extend(b"HVPS");
    for number in [VERSION, marks.len() as u32, n as u32] {
        bytes.extend(number.to_le_bytes());
    }
    for size_m in sizes_m {
        bytes.extend((size_m as f32).to_le_bytes());
    }
    for Mark { place_m, outward, color } in marks {
        for coordinate in place_m.as_vec3().to_array() {
            bytes.extend(coordinate.to_le_bytes());
        }
        bytes.extend(
            (127.0 * *outward).to_array().map(|part| (part.round() as i8).to_le_bytes()[0]),
        );
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
        let options =
            Options { voxel_size_m: 1e-3, layers: 2, navigation: None, sides: InsideTest::Auto };
        let map = Volume::build(&mesh, &inspect(&mesh), &options, |_| {}).expect("small");
        let faces = faces(&map);
        // A cube of 11 voxels; its hollow has no faces.
        assert_eq!(
            (map.surface.n_voxels, faces.len()),
            (11_usize.pow(3) - 9_usize.pow(3), 6 * 11 * 11)
        );
        for Mark { place_m, outward, .. } in &faces {
            assert!((place_m.dot(*outward) - 5.5e-3).abs() < 1e-9, "{place_m} {outward}");
        }
        let n_dark = faces.iter().filter(|face| face.color == 0).count();
        assert!([6 * 60, 6 * 61].contains(&n_dark), "{n_dark}");
    }

    #[test]
    fn many_points_are_thinned_and_counted() {
        let n = 2 * MOST_MARKS + 1;
        let points: Vec<_> = (0..n).map(|k| (DVec3::X * k as f64, DVec3::Z)).collect();
        let bytes = of_points(&Shell::new(&points, 2.0), DVec3::Y, [2.0, 1.0]);
        let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().expect("four"));
        let number = |at: usize| f32::from_bits(word(at));
        let n_marks = word(8) as usize;
        assert!(n_marks > MOST_MARKS / 2 && n_marks <= MOST_MARKS, "{n_marks}");
        assert_eq!((&bytes[..4], word(4), word(12) as usize), (&b"HVPS"[..], VERSION, n));
        assert_eq!(
            (bytes.len(), [16, 20].map(number)),
            (HEAD_BYTES + MARK_BYTES * n_marks, [2.0, 1.0])
        );
        for mark in (HEAD_BYTES..bytes.len()).step_by(MARK_BYTES) {
            assert_eq!(
                (number(mark + 4), number(mark + 8), &bytes[mark + 12..mark + 16]),
                (1.0, 0.0, &[0, 0, 0x81, 0][..])
            );
        }
    }
}
