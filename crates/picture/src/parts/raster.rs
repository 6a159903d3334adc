//! Triangles on a view: which is nearest to the viewer in each pixel.

use glam::{DVec2, DVec3};

use super::super::palette::{Rgb, to_linear};
use super::super::view::{Camera, PixelSample, RenderedView};
use vps::mesh::TriangleMesh;
use vps::spatial::Pose;

/// Puts a mesh onto a view, in one colour. Both sides of a triangle are seen: files that are wound
/// the wrong way look as others do.
pub(super) fn put(
    view: &mut RenderedView,
    camera: &Camera,
    mesh: &TriangleMesh,
    world_from_mesh: Pose,
    color: Rgb,
) {
    let color = color.map(to_linear);
    let [width, height] = view.size();
    let places: Vec<DVec3> = mesh
        .vertices
        .iter()
        .map(|vertex| {
            let (pixel, height_m) = camera.place(world_from_mesh.transform_point(*vertex));
            pixel.extend(height_m * camera.pixels_per_m())
        })
        .collect();
    for triangle in &mesh.triangles {
        let [a, b, c] = triangle.map(|vertex| places[vertex as usize]);
        // Pixels have y down.
        let across = (b - a).cross(c - a);
        let area = across.z;
        if area == 0.0 || !across.is_finite() {
            continue;
        }
        let normal =
            (DVec3::new(across.x, -across.y, across.z) * area.signum()).normalize().as_vec3();
        let low = a.min(b).min(c);
        let high = a.max(b).max(c);
        let range = |low: f64, high: f64, n_pixels: usize| {
            let clamped = |pixel: f64| pixel.clamp(0.0, n_pixels as f64) as usize;
            clamped((low - 0.5).ceil())..clamped((high - 0.5).floor() + 1.0)
        };
        let columns = range(low.x, high.x, width);
        for y in range(low.y, high.y, height) {
            for x in columns.clone() {
                let at = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
                let share = |from: DVec3, to: DVec3| {
                    (to.truncate() - from.truncate()).perp_dot(at - from.truncate()) / area
                };
                let [of_a, of_b, of_c] = [share(b, c), share(c, a), share(a, b)];
                if of_a < 0.0 || of_b < 0.0 || of_c < 0.0 {
                    continue;
                }
                let height = (of_a * a.z + of_b * b.z + of_c * c.z) as f32;
                let pixel = &mut view.pixels[y * width + x];
                if height > pixel.height {
                    *pixel = PixelSample { height, normal, color };
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vps::mesh::primitives::Shape;

    /// Looks from above onto things around the origin, 100 pixels to 0.1 m.
    fn camera() -> Camera {
        let corners = [-0.05, 0.05].map(|edge| DVec3::new(edge, edge, 0.0));
        Camera::over(DVec3::Z, corners.into_iter(), [100, 100], 1.0)
    }

    #[test]
    fn a_box_covers_its_pixels_and_what_is_nearer_covers_it() {
        let mut view = RenderedView::empty([100, 100]);
        let camera = camera();
        let plate = Shape::Box { size_m: DVec3::new(0.04, 0.02, 0.01) }.tessellate(1e-4);
        put(&mut view, &camera, &plate, Pose::IDENTITY, [255, 0, 0]);
        let covered = |view: &RenderedView| {
            view.pixels.iter().filter(|pixel| pixel.height > f32::NEG_INFINITY).count()
        };
        assert_eq!(covered(&view), 40 * 20);
        let at = |view: &RenderedView, x: usize, y: usize| view.pixels[y * 100 + x];
        // Its upper face is 5 mm, five pixels, above the origin, and looks up.
        assert!(
            (at(&view, 50, 50).height - 5.0).abs() < 1e-5 && at(&view, 50, 50).normal.z > 0.999
        );
        let ball = Shape::Sphere { radius_m: 0.008 }.tessellate(1e-5);
        put(
            &mut view,
            &camera,
            &ball,
            Pose::from_translation(DVec3::new(0.01, 0.0, 0.0)),
            [0, 255, 0],
        );
        // 8 mm high in its middle, at x = 60; farther out it is below the face.
        assert!(
            (at(&view, 60, 50).height - 8.0).abs() < 0.1
                && at(&view, 60, 50).color == [0.0, 1.0, 0.0]
        );
        assert_eq!(at(&view, 67, 50).color, [1.0, 0.0, 0.0]);
        assert_eq!(covered(&view), 40 * 20);
    }

    #[test]
    fn a_mesh_that_is_wound_the_wrong_way_looks_the_same() {
        let ball = Shape::Sphere { radius_m: 0.03 }.tessellate(1e-4);
        let turned = TriangleMesh {
            triangles: ball.triangles.iter().map(|[a, b, c]| [*a, *c, *b]).collect(),
            ..ball.clone()
        };
        let seen = |mesh: &TriangleMesh| {
            let mut view = RenderedView::empty([100, 100]);
            put(&mut view, &camera(), mesh, Pose::IDENTITY, [200; 3]);
            view
        };
        for (one, other) in seen(&ball).pixels.iter().zip(&seen(&turned).pixels) {
            let is_same = one.height.is_infinite() || one.normal.distance(other.normal) < 1e-5;
            assert!(
                one.height == other.height || (one.height - other.height).abs() < 1e-3,
                "{one:?} {other:?}"
            );
            assert!(is_same, "{one:?} {other:?}");
        }
    }

    #[test]
    fn what_is_no_number_or_far_outside_covers_nothing() {
        let mesh = TriangleMesh {
            vertices: vec![
                DVec3::NAN,
                DVec3::X,
                DVec3::Y,
                DVec3::splat(1e300),
                DVec3::splat(7.0),
                DVec3::new(8.0, 7.0, 7.0),
                DVec3::new(7.0, 8.0, 7.0),
            ],
            triangles: vec![[0, 1, 2], [3, 1, 2], [4, 5, 6], [1, 1, 1]],
        };
        let mut view = RenderedView::empty([100, 100]);
        put(&mut view, &camera(), &mesh, Pose::IDENTITY, [200; 3]);
        let outside = view.pixels.iter().filter(|pixel| pixel.height.is_nan()).count();
        assert_eq!(outside, 0);
    }
}
