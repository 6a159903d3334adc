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
        for apart in [
            ball_in_ball(5.0, 9.0, 0.0),
            crescent(4.0, 4.2, 0.15),
            ball_in_groove(4.0, 5.0, 1.0),
            edge(-0.1, 0.3).0,
        ] {
            assert!(apart == 0.0);
        }
    }
}
