//! Closed forms: `∫ depth · normal dA` over the immersed surface of a tool, m³. By the divergence
//! theorem it is `∫ ∇depth dV` over the overlap of tool and part, which is how most of them are
//! found.
//!
//! Derivations: docs/reference/wrench-benchmark.md. The tests hold each against the integral over
//! the meshes of `law`, which shares nothing with them.

use core::f64::consts::PI;

/// Intervals of a quadrature: more change less than 1e-6 of a result.
const INTERVALS: usize = 64;

/// ∫ f over [0, 1] by Simpson's rule.
fn integral(f: impl Fn(f64) -> f64) -> f64 {
    let weight = |k: usize| if k == 0 || k == INTERVALS { 1.0 } else { 2.0 + 2.0 * (k % 2) as f64 };
    (0..=INTERVALS).map(|k| weight(k) * f(k as f64 / INTERVALS as f64)).sum::<f64>()
        / (3.0 * INTERVALS as f64)
}

/// A ball `depth` deep in a larger or smaller ball, along the line of centres; exact.
pub(super) fn ball_in_ball(ball: f64, other: f64, depth: f64) -> f64 {
    let from = other - depth;
    let to = other;
    let distance = ball + other - depth;
    // ∫ (R − s)(D² + r² − s²) s ds over the ball's surface, s: distance from the other's centre.
    let c = distance * distance + ball * ball;
    let at = |s: f64| s * s * (to * c / 2.0 - s * c / 3.0 - to * s * s / 4.0 + s * s * s / 5.0);
    if depth <= 0.0 { 0.0 } else { PI / (distance * distance) * (at(to) - at(from)) }
}

/// Area of the segment that a line cuts off a disc, m²; exact. Times a length: a cylinder that lies
/// on a plane.
pub(super) fn segment(radius: f64, depth: f64) -> f64 {
    let depth = depth.max(0.0);
    let rest = radius - depth;
    radius * radius * (rest / radius).acos() - rest * (2.0 * radius * depth - depth * depth).sqrt()
}

/// A disc `depth` deep in the wall of a larger round hole, m², along the line of centres: `∫ 2 sin
/// θ ρ dρ`, one quadrature.
pub(super) fn crescent(disc: f64, hole: f64, offset: f64) -> f64 {
    let depth = offset + disc - hole;
    if depth <= 0.0 {
        return 0.0;
    }
    // ρ = offset + disc − depth t², so that the root at the tip is smooth.
    integral(|t| {
        let rho = offset + disc - depth * t * t;
        let cos = ((rho * rho + offset * offset - disc * disc) / (2.0 * rho * offset)).min(1.0);
        2.0 * (1.0 - cos * cos).sqrt() * rho * 2.0 * depth * t
    })
}

/// A ball in a round groove: crescents, slice by slice along the groove.
pub(super) fn ball_in_groove(ball: f64, groove: f64, offset: f64) -> f64 {
    let thinnest = groove - offset;
    if ball <= thinnest {
        return 0.0;
    }
    // y = half_length · sin(φ), so that the root where the contact ends is smooth.
    let half_length = (ball * ball - thinnest * thinnest).sqrt();
    integral(|share| {
        let (sin, cos) = (0.5 * PI * share).sin_cos();
        let y = half_length * sin;
        2.0 * crescent((ball * ball - y * y).sqrt(), groove, offset) * half_length * cos * 0.5 * PI
    })
}

/// A frustum of these radii in a conical hole of the same half angle, `lowered` from where they
/// fit, along the axis; exact: the flank's depth is the same everywhere, and what the faces at the
/// ends have in the wall is taken off.
pub(super) fn frustum_in_hole([bottom, top]: [f64; 2], half_angle: f64, lowered: f64) -> f64 {
    let depth = (lowered * half_angle.sin()).max(0.0);
    PI * (top - bottom) * ((top + bottom) * depth - depth * depth / half_angle.cos())
}

/// An edge of a box in a plane, with one face of the box at this angle to the plane, for each metre
/// of edge; exact: the area of a triangle, m², and how far its centroid is from the edge, along the
/// plane.
pub(super) fn edge(depth: f64, angle: f64) -> (f64, f64) {
    let depth = depth.max(0.0);
    let left = depth * angle.tan();
    let right = depth / angle.tan();
    (0.5 * depth * (left + right), (right - left) / 3.0)
}

/// The tip of a cone in a plane whose normal is tilted against the cone's axis by `tilt`; exact:
/// the volume, m³, and where its centroid is from the tip, m: along the cone's axis, and across it,
/// on the side to which the plane's normal leans.
pub(super) fn tip(half_angle: f64, depth: f64, tilt: f64) -> (f64, [f64; 2]) {
    let depth = depth.max(0.0);
    let tan2 = half_angle.tan().powi(2);
    let (sin, cos) = tilt.sin_cos();
    let shape = cos * cos - tan2 * sin * sin;
    // Three quarters of the way to the middle of the ellipse that the plane cuts.
    let centroid = [cos, -tan2 * sin].map(|part| 0.75 * depth * part / shape);
    (PI / 3.0 * depth.powi(3) * tan2 / shape.powf(1.5), centroid)
}

/// The corner of a box in a plane, m³; exact: a tetrahedron. `cosines`: of the angles between its
/// three edges and the plane's normal.
pub(super) fn corner(depth: f64, cosines: [f64; 3]) -> f64 {
    depth.max(0.0).powi(3) / (6.0 * cosines.iter().product::<f64>())
}

/// Two right angles whose edges cross at right angles, each symmetric about the line through both;
/// exact: the volume of a tetrahedron, of which each face of the part pushes half at 45°.
pub(super) fn crossed_edges(overlap: f64) -> f64 {
    let volume = 2.0 / 3.0 * overlap.max(0.0).powi(3);
    volume * core::f64::consts::FRAC_1_SQRT_2
}

/// A wedge in a groove of the same half angle, `lowered` from where they fit, for each metre of the
/// groove, m²; exact: both flanks' parts along the middle. What the faces at the ends of the flanks
/// have in the walls cancels.
pub(super) fn wedge_in_groove(height: f64, half_angle: f64, lowered: f64) -> f64 {
    let flank = height / half_angle.cos();
    2.0 * flank * lowered.max(0.0) * half_angle.sin() * half_angle.sin()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_are_those_of_the_textbook() {
        // A ball on a much larger one is a ball on a plane: the volume of a cap.
        let cap = PI * 0.04 * (5.0 - 0.2 / 3.0);
        assert!(
            (ball_in_ball(5.0, 1e3, 0.2) / cap - 1.0).abs() < 1e-2,
            "{}",
            ball_in_ball(5.0, 1e3, 0.2) / cap
        );
        // A disc in a much larger hole is one on a line.
        assert!((crescent(5.0, 1e6, 1e6 - 5.0 + 0.2) / segment(5.0, 0.2) - 1.0).abs() < 1e-4);
        assert!((ball_in_groove(5.0, 1e6, 1e6 - 5.0 + 0.2) / cap - 1.0).abs() < 1e-4);
        // A face at 45°: half of a square.
        let (area, aside) = edge(0.3, 0.25 * PI);
        assert!((area - 0.09).abs() < 1e-12 && aside.abs() < 1e-12);
        // Upright: the volume of a cone and its centroid.
        let (volume, [along, across]) = tip(0.5, 0.3, 0.0);
        assert!((volume - PI / 3.0 * 0.027 * 0.5_f64.tan().powi(2)).abs() < 1e-12);
        assert!((along - 0.225).abs() < 1e-12 && across == 0.0);
        // Three edges at the same angle to the normal.
        let cosine = (1.0_f64 / 3.0).sqrt();
        assert!((corner(0.3, [cosine; 3]) - 0.027 * 3.0_f64.sqrt() / 2.0).abs() < 1e-12);
        for apart in [
            tip(0.5, -0.1, 0.2).0,
            corner(-0.1, [0.5; 3]),
            crossed_edges(-0.1),
            wedge_in_groove(1.0, 0.5, -0.1),
            ball_in_ball(5.0, 9.0, 0.0),
            crescent(4.0, 4.2, 0.15),
            ball_in_groove(4.0, 5.0, 1.0),
            edge(-0.1, 0.3).0,
        ] {
            assert!(apart == 0.0);
        }
    }
}
