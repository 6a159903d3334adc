//! Solids from stacks of rings.
//!
//! A ring is a loop of points, counter-clockwise seen from +z. All rings of a loft have the same
//! number of points, and point `i` of one ring is joined to point `i` of the next. Going up on the
//! outside, over the top and down on the inside gives outward orientation. A ring of equal points
//! is a tip: welding turns its strip into a fan.

use std::f64::consts::TAU;

use glam::DVec3;

use crate::mesh::Mesh;

/// A loop of points.
pub(crate) type Ring = Vec<DVec3>;

/// `n_points` equal steps around, starting at angle 0.
pub(crate) fn even_angles(n_points: usize) -> Vec<f64> {
    (0..n_points).map(|point_idx| TAU * point_idx as f64 / n_points as f64).collect()
}

/// Circle of `radius_mm` at height `z_mm` with a point at each angle.
pub(crate) fn circle(angles: &[f64], radius_mm: f64, z_mm: f64) -> Ring {
    angles
        .iter()
        .map(|angle| DVec3::new(radius_mm * angle.cos(), radius_mm * angle.sin(), z_mm))
        .collect()
}

/// The point of the axis at height `z_mm`, `n_points` times.
pub(crate) fn tip(n_points: usize, z_mm: f64) -> Ring {
    vec![DVec3::new(0.0, 0.0, z_mm); n_points]
}

/// Regular hexagon with flats `across_flats_mm` apart and a corner on +x. Exact where the angles
/// contain all multiples of 60°.
pub(crate) fn hexagon(angles: &[f64], across_flats_mm: f64, z_mm: f64) -> Ring {
    let sixth = TAU / 6.0;
    angles
        .iter()
        .map(|angle| {
            let from_flat = angle.rem_euclid(sixth) - sixth / 2.0;
            let radius_mm = across_flats_mm / 2.0 / from_flat.cos();
            DVec3::new(radius_mm * angle.cos(), radius_mm * angle.sin(), z_mm)
        })
        .collect()
}

/// An axis-parallel rectangle around the z axis (which need not be in its middle).
#[derive(Clone, Copy)]
pub(crate) struct Rectangle {
    /// `[low, high]` along x, mm.
    pub(crate) x_mm: [f64; 2],
    /// `[low, high]` along y, mm.
    pub(crate) y_mm: [f64; 2],
}

impl Rectangle {
    /// About `n_points` angles around the axis, as even as four corners allow; every corner is hit.
    pub(crate) fn angles(&self, n_points: usize) -> Vec<f64> {
        let ([x_low, x_high], [y_low, y_high]) = (self.x_mm, self.y_mm);
        let corners = [
            y_low.atan2(x_high),
            y_high.atan2(x_high),
            y_high.atan2(x_low),
            y_low.atan2(x_low) + TAU,
        ];
        let mut angles = Vec::new();
        for (corner_idx, start) in corners.iter().enumerate() {
            let end = if corner_idx == 3 { corners[0] + TAU } else { corners[corner_idx + 1] };
            let n_steps = (((end - start) / TAU * n_points as f64).round() as usize).max(1);
            angles.extend(
                (0..n_steps).map(|step| start + (end - start) * step as f64 / n_steps as f64),
            );
        }
        angles
    }

    /// The outline at height `z_mm`, where the rays of these angles leave it.
    pub(crate) fn ring(&self, angles: &[f64], z_mm: f64) -> Ring {
        angles
            .iter()
            .map(|angle| {
                let (sin, cos) = angle.sin_cos();
                let reach = |component: f64, [low, high]: [f64; 2]| {
                    // A ray along an axis never leaves through the sides parallel to it.
                    if component.abs() < 1e-12 {
                        f64::INFINITY
                    } else {
                        (if component > 0.0 { high } else { low }) / component
                    }
                };
                let length = reach(cos, self.x_mm).min(reach(sin, self.y_mm));
                DVec3::new(length * cos, length * sin, z_mm)
            })
            .collect()
    }
}

/// A square centred on the axis.
pub(crate) fn square(edge_mm: f64) -> Rectangle {
    Rectangle { x_mm: [-edge_mm / 2.0, edge_mm / 2.0], y_mm: [-edge_mm / 2.0, edge_mm / 2.0] }
}

/// Joins each ring to the next; `closed` joins the last to the first as well.
pub(crate) fn loft(mesh: &mut Mesh, rings: &[Ring], closed: bool) {
    let n_points = rings[0].len();
    assert!(
        rings.iter().all(|ring| ring.len() == n_points),
        "rings of a loft have equal point counts"
    );
    let n_strips = if closed { rings.len() } else { rings.len() - 1 };
    for strip in 0..n_strips {
        let lower = &rings[strip];
        let upper = &rings[(strip + 1) % rings.len()];
        for point in 0..n_points {
            let next = (point + 1) % n_points;
            mesh.quad([lower[point], lower[next], upper[next], upper[point]]);
        }
    }
}

/// A closed solid from `rings`: between two tips, or ring-shaped when `closed`.
pub(crate) fn solid(rings: &[Ring], closed: bool) -> Mesh {
    let mut mesh = Mesh::default();
    loft(&mut mesh, rings, closed);
    mesh
}
