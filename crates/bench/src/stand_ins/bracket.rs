//! A C-shaped bracket with bores, cut from one block: few, long triangles, most of them across
//! whole faces.

use glam::{DAffine3, DVec2, DVec3};

use super::super::random::Random;
use super::solids::{Assembly, ring};
use vps::mesh::TriangleMesh;

const BOX_MM: DVec3 = DVec3::new(242.6, 149.6, 805.1);
/// Corners of a bore.
const BORE_CORNERS: usize = 64;

/// One solid of 7,088 triangles.
pub(super) fn bracket(random: &mut Random) -> TriangleMesh {
    let DVec3 { x: width, y: depth, z: height } = BOX_MM;
    // The C in the plane of x and z, with no face on a voxel boundary at the sizes of the tables,
    // where it would mark two layers; the radius that rounds each corner, and points on it. Their
    // sum makes the number of triangles.
    let corners = [
        ((0.0, 0.0), 12.0, 43),
        ((width, 0.0), 12.0, 43),
        ((width, 110.7), 18.0, 43),
        ((85.3, 110.7), 24.0, 43),
        ((85.3, 701.3), 24.0, 43),
        ((200.0, 701.3), 18.0, 43),
        ((200.0, height), 12.0, 43),
        ((0.0, height), 12.0, 42),
    ];
    let at = |k: usize| DVec2::from(corners[k % corners.len()].0);
    let outline: Vec<DVec2> = (0..corners.len())
        .flat_map(|k| {
            let (_, radius, n) = corners[k];
            rounded([at(k + corners.len() - 1), at(k), at(k + 1)], radius, n)
        })
        .collect();

    let mut bores = Vec::new();
    let mut bore = |center: (f64, f64), jitter: f64, radii: [f64; 2]| {
        let center = DVec2::from(center)
            + jitter * DVec2::new(random.within(-1.0, 1.0), random.within(-1.0, 1.0));
        bores.push(ring(center, random.within(radii[0], radii[1]), BORE_CORNERS));
    };
    for row in 0..9 {
        for x in [23.0, 61.0] {
            bore((x, 150.0 + 63.0 * f64::from(row)), 4.0, [5.0, 8.0]);
        }
    }
    for x in [120.0, 165.0, 210.0] {
        bore((x, 55.0), 4.0, [8.0, 12.0]);
    }
    bore((150.0, 752.0), 6.0, [9.0, 14.0]);

    let mut assembly = Assembly::default();
    // (x, z) of the profile to x and z of the part: y of the part runs against z of the plate.
    let place = DAffine3::from_cols(DVec3::X, DVec3::Z, DVec3::NEG_Y, DVec3::Y * depth);
    assembly.plate(place, &outline, &bores, [0.0, depth]);
    assembly.fitted(BOX_MM)
}

/// The corner of an outline, rounded by `n` points on a circle that touches both edges.
fn rounded(
    [before, here, after]: [DVec2; 3],
    radius: f64,
    n: usize,
) -> impl Iterator<Item = DVec2> {
    let back = (before - here).normalize();
    let ahead = (after - here).normalize();
    // Edges meet at right angles.
    let center = here + radius * (back + ahead);
    (0..n).map(move |k| {
        let (sin, cos) = (core::f64::consts::FRAC_PI_2 * k as f64 / (n - 1) as f64).sin_cos();
        center - radius * (ahead * cos + back * sin)
    })
}
