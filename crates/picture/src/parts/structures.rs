//! A mesh and what was baked of it, side by side in three dimensions: polygons, surface voxels,
//! points.
//!
//! # Source
//! Sagardia2008, figure 4: the same three, for the models of the paper.

use std::io;
use std::path::Path;

use glam::DVec3;

use super::super::canvas::{Align, Canvas};
use super::super::palette::{BACKDROP, INK, Rgb};
use super::super::shade::{self, FINER, halved};
use super::super::sheet::{grouped, shortened};
use super::super::subject::BakedObject;
use super::super::view::{Camera, RenderedView};
use super::{PART_COLORS, TOOL_COLOR, TOWARD, outlined, raster};
use recording::report::plots::short;
use vps::mesh::TriangleMesh;
use vps::spatial::Pose;
use vps::storage::whole_file::write_bytes;

/// Of each view, pixels; and what is around them.
const VIEW: [i32; 2] = [520, 560];
const GAP: i32 = 12;
const CAPTION: i32 = 40;
/// Share of a view that the part takes up at most.
const FILLED: f64 = 0.86;
/// Neighbouring voxels in turn, as on a board: a face of many would be one area otherwise.
const VOXEL_COLORS: [Rgb; 2] = [[205, 160, 96], [232, 200, 150]];
/// Of the disc that stands for a point, voxels: a fourth of the distance of most neighbours, so
/// that discs lie apart.
const DISC_VOXELS: f64 = 0.25;
/// Discs stand out of the polygons by this, voxels, else both would be seen in turn.
const RAISED_VOXELS: f64 = 0.05;
const DISC_CORNERS: usize = 6;
/// Voxels or points that are made triangles of at a time.
const AT_A_TIME: usize = 4096;

/// Draws the sheet and writes it as a PNG, 1584 pixels wide. `mesh`: what was baked, in the frame
/// of the map.
///
/// # Errors
/// Any error of the file system.
pub fn write_structures(
    path: &Path,
    mesh: &TriangleMesh,
    subject: &BakedObject<'_>,
) -> io::Result<()> {
    write_bytes(path, &png(mesh, subject)?)
}

fn png(mesh: &TriangleMesh, subject: &BakedObject<'_>) -> io::Result<Vec<u8>> {
    let [width, height] = VIEW;
    let mut canvas = Canvas::new((3 * width + 2 * GAP) as u32, (height + CAPTION) as u32)
        .ok_or_else(|| io::Error::other("no memory for a sheet of pixels"))?;
    let fine = VIEW.map(|edge| (edge * FINER) as usize);
    let camera = Camera::over(TOWARD, mesh.vertices.iter().copied(), fine, FILLED);
    let mut polygons = RenderedView::empty(fine);
    raster::put(&mut polygons, &camera, mesh, Pose::IDENTITY, PART_COLORS[0]);
    let mut voxels = RenderedView::empty(fine);
    put_voxels(&mut voxels, &camera, subject);
    // What is behind the part stays behind it.
    let mut points = polygons.clone();
    put_points(&mut points, &camera, subject);
    let size_mm = short(subject.surface.grid.voxel_size_m * 1e3);
    let captions = [
        format!("{}: {} triangles", shortened(subject.name, 24), grouped(mesh.triangles.len())),
        format!("voxmap: {} surface voxels of {size_mm} mm", grouped(subject.surface.n_voxels)),
        format!("pointshell: {} points", grouped(subject.shell.len())),
    ];
    for (n, (view, caption)) in [polygons, voxels, points].iter().zip(captions).enumerate() {
        let left = n as i32 * (width + GAP);
        canvas.image(
            [left, 0],
            VIEW,
            &halved(&outlined(view, shade::lit(view, BACKDROP)), fine[0]),
        );
        canvas.scale_bar([left, 0], VIEW, camera.pixels_per_m() / f64::from(FINER));
        canvas.text(
            [f64::from(left + width / 2), f64::from(height + 26)],
            15.0,
            Align::Middle,
            INK,
            &caption,
        );
    }
    canvas.png()
}

/// Faces of surface voxels that look towards the viewer and have no other surface voxel in front of
/// them.
fn put_voxels(view: &mut RenderedView, camera: &Camera, subject: &BakedObject<'_>) {
    let surface = subject.surface;
    let mut meshes = VOXEL_COLORS.map(|_| TriangleMesh::default());
    for (n, cell) in surface.cells().enumerate() {
        let mesh = &mut meshes[(cell.iter().sum::<i32>() & 1) as usize];
        for axis in 0..3 {
            let way = TOWARD[axis].signum();
            let mut beside = cell;
            beside[axis] += way as i32;
            if surface.contains(beside) {
                continue;
            }
            let center = surface.grid.center_map(cell);
            let half_m = 0.5 * surface.grid.voxel_size_m;
            let [out, along, across] =
                [0, 1, 2].map(|turn| DVec3::AXES[(axis + turn) % 3] * half_m);
            let middle = center + out * way;
            put_quad(
                mesh,
                [
                    middle - along - across,
                    middle + along - across,
                    middle + along + across,
                    middle - along + across,
                ],
            );
        }
        if n % AT_A_TIME == AT_A_TIME - 1 {
            flush(view, camera, &mut meshes);
        }
    }
    flush(view, camera, &mut meshes);
}

fn put_quad(mesh: &mut TriangleMesh, corners: [DVec3; 4]) {
    let first = mesh.vertices.len() as u32;
    mesh.vertices.extend(corners);
    mesh.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
}

/// Draws what was gathered, each in its colour.
fn flush(view: &mut RenderedView, camera: &Camera, meshes: &mut [TriangleMesh; 2]) {
    for (mesh, color) in meshes.iter_mut().zip(VOXEL_COLORS) {
        raster::put(view, camera, mesh, Pose::IDENTITY, color);
        mesh.vertices.clear();
        mesh.triangles.clear();
    }
}

/// A disc across the normal of each point.
fn put_points(view: &mut RenderedView, camera: &Camera, subject: &BakedObject<'_>) {
    let voxel_size_m = subject.surface.grid.voxel_size_m;
    let mut mesh = TriangleMesh::default();
    for (n, (arm, inward)) in subject.shell.points().enumerate() {
        let Some(outward) = (-inward.as_dvec3()).try_normalize() else { continue };
        let (along, across) = outward.any_orthonormal_pair();
        let middle =
            subject.center_of_mass_tool + arm.as_dvec3() + outward * RAISED_VOXELS * voxel_size_m;
        let first = mesh.vertices.len() as u32;
        let corner = |k: usize| {
            let (sin, cos) = (core::f64::consts::TAU * k as f64 / DISC_CORNERS as f64).sin_cos();
            middle + (along * cos + across * sin) * DISC_VOXELS * voxel_size_m
        };
        mesh.vertices.extend((0..DISC_CORNERS).map(corner));
        mesh.triangles.extend((2..DISC_CORNERS as u32).map(|k| [first, first + k - 1, first + k]));
        if n % AT_A_TIME == AT_A_TIME - 1 {
            raster::put(view, camera, &mesh, Pose::IDENTITY, TOOL_COLOR);
            mesh = TriangleMesh::default();
        }
    }
    raster::put(view, camera, &mesh, Pose::IDENTITY, TOOL_COLOR);
}

#[cfg(test)]
mod tests {
    use super::super::super::palette::to_linear;
    use super::super::super::view::PixelSample;
    use super::*;
    use crate::subject::tests::with_baked_box;

    #[test]
    fn each_view_shows_its_own_structure_where_the_part_is() {
        with_baked_box(DVec3::splat(0.02), 2e-3, each_view_shows_its_own_structure);
    }

    fn each_view_shows_its_own_structure(mesh: &TriangleMesh, subject: &BakedObject<'_>) {
        let size = [120, 120];
        let camera = Camera::over(TOWARD, mesh.vertices.iter().copied(), size, 0.8);
        let n_of = |view: &RenderedView, color: Rgb| {
            let is_of = |pixel: &&PixelSample| {
                pixel.height.is_finite() && pixel.color == color.map(to_linear)
            };
            view.pixels.iter().filter(is_of).count()
        };
        let mut polygons = RenderedView::empty(size);
        raster::put(&mut polygons, &camera, mesh, Pose::IDENTITY, PART_COLORS[0]);
        let n_part = n_of(&polygons, PART_COLORS[0]);
        let mut voxels = RenderedView::empty(size);
        put_voxels(&mut voxels, &camera, subject);
        // Voxels of the surface stand out of it by a half of them, and none is missing.
        let n_voxels = VOXEL_COLORS.map(|color| n_of(&voxels, color));
        assert!(
            n_voxels.iter().all(|n| *n > n_part / 3) && n_voxels[0] + n_voxels[1] > n_part,
            "{n_voxels:?} over {n_part}"
        );
        let mut points = polygons.clone();
        put_points(&mut points, &camera, subject);
        let n_points = n_of(&points, TOOL_COLOR);
        assert!((n_part / 20..n_part / 2).contains(&n_points), "{n_points} over {n_part}");
        let drawn = png(mesh, subject).unwrap();
        let pixels = tiny_skia::Pixmap::decode_png(&drawn).unwrap();
        assert_eq!([pixels.width(), pixels.height()], [1584, 600]);
    }
}
