//! Pairs of bodies with faces that nearly lie on each other, as rounded decimals make them.
//!
//! What is right is known from the pieces alone: along straight lines, where their winding numbers
//! add up to 1 or more; outside, the distance to the nearest of them.

use std::f64::consts::TAU;

use glam::{DQuat, DVec3};

use super::columns::crossing;
use super::tests::{
    assert_closed, cube, inside_out, moved, random, signed_distance, together, volume,
};
use super::*;
use crate::mesh::TriangleMesh;
use crate::mesh::primitives::Shape;

const MM: f64 = 1e-3;

/// Random numbers.
struct Random(u64);

impl Random {
    fn of(seed: u64) -> Self {
        let mut random = Self(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ 0x5bd1_e995);
        (0..4).for_each(|_| _ = random.unit());
        random
    }

    fn unit(&mut self) -> f64 {
        random(&mut self.0)
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    fn below(&mut self, n: usize) -> usize {
        ((self.unit() * n as f64) as usize).min(n - 1)
    }

    fn vector(&mut self) -> DVec3 {
        DVec3::new(self.between(-1.0, 1.0), self.between(-1.0, 1.0), self.between(-1.0, 1.0))
    }
}

/// Rings of a body of revolution about z: radius and height, mm; the profile is closed.
fn turned(profile: &[[f64; 2]], n: usize, phase: f64) -> TriangleMesh {
    let mut mesh = TriangleMesh::default();
    for [radius, z] in profile {
        for k in 0..n {
            let angle = TAU * (k as f64 + phase) / n as f64;
            mesh.vertices.push(DVec3::new(radius * angle.cos(), radius * angle.sin(), *z) * MM);
        }
    }
    let n_rings = profile.len();
    for ring in 0..n_rings {
        let next = (ring + 1) % n_rings;
        for k in 0..n {
            let at = |ring: usize, k: usize| (ring * n + k % n) as u32;
            let [a, b, c, d] = [at(ring, k), at(ring, k + 1), at(next, k + 1), at(next, k)];
            // A ring of no radius is one point.
            mesh.triangles.extend((profile[ring][0] > 0.0).then_some([a, b, c]));
            mesh.triangles.extend((profile[next][0] > 0.0).then_some([a, c, d]));
        }
    }
    mesh
}

fn pin(radius: f64, low: f64, high: f64, n: usize, phase: f64) -> TriangleMesh {
    turned(&[[0.0, low], [radius, low], [radius, high], [0.0, high]], n, phase)
}

fn bush(inner: f64, outer: f64, low: f64, high: f64, n: usize, phase: f64) -> TriangleMesh {
    turned(&[[inner, low], [outer, low], [outer, high], [inner, high]], n, phase)
}

fn ball(radius_mm: f64, center_mm: [f64; 3]) -> TriangleMesh {
    let mesh = Shape::Sphere { radius_m: radius_mm * MM }.tessellate(0.1 * MM);
    moved(mesh, DVec3::from_array(center_mm) * MM)
}

/// Two pieces or three, and what kind of pair they are.
fn pair(random: &mut Random) -> (String, Vec<TriangleMesh>) {
    // About the diagonal of the pairs, mm.
    let size = 40.0;
    let gap = match random.below(3) {
        0 => size * 10_f64.powf(random.between(-9.0, -3.0)),
        _ => size * 1e-6 * 10_f64.powf(random.between(-1.0, 1.5)),
    } * if random.below(2) == 0 { 1.0 } else { -1.0 };
    let n = 8 + random.below(40);
    let other_n = if random.below(2) == 0 { n } else { 8 + random.below(40) };
    let phase = if random.below(2) == 0 { 0.0 } else { random.unit() };
    let radius = random.between(4.0, 10.0);
    let kind = random.below(10);
    let mut pieces = match kind {
        0 => vec![ball(radius, [0.0; 3]), ball(radius + gap, [0.0; 3])],
        1 => {
            let by = gap * random.vector() * MM;
            vec![ball(radius, [0.0; 3]), moved(ball(radius, [0.0; 3]), by)]
        }
        // In a bore of the same diameter: longer, flush, shorter.
        2 | 3 => {
            let [low, high] =
                [[-12.0, 12.0], [-6.0, 6.0], [-6.0, 12.0], [-3.0, 3.0]][random.below(4)];
            let inner = pin(radius + gap, low, high, other_n, phase);
            vec![bush(radius, radius + 6.0, -6.0, 6.0, n, 0.0), inner]
        }
        // One on the other, with a narrower one or the same.
        4 => {
            let share = if random.below(2) == 0 { 1.0 } else { random.between(0.4, 1.0) };
            let upper = pin(share * radius, 5.0 + gap, 12.0, other_n, phase);
            vec![pin(radius, -5.0, 5.0, n, 0.0), upper]
        }
        // The same radius, one a part of the other or beyond it.
        5 => {
            let upper = pin(radius + gap, -2.0, random.between(2.0, 9.0), other_n, phase);
            vec![pin(radius, -5.0, 5.0, n, 0.0), upper]
        }
        // Boxes beside each other, one a little askew.
        6 => {
            let turn = DQuat::from_scaled_axis(random.vector() * gap / 10.0);
            let by = DVec3::new(2.0 * radius + gap, random.between(-4.0, 4.0), 0.0) * MM;
            let mut other = cube(radius);
            other.vertices.iter_mut().for_each(|vertex| *vertex = turn * *vertex + by);
            vec![cube(radius), other]
        }
        // The same box, nearly.
        7 => {
            let turn = DQuat::from_scaled_axis(random.vector() * gap / 10.0);
            let mut other = cube(radius + gap * random.unit());
            other.vertices.iter_mut().for_each(|vertex| *vertex = turn * *vertex);
            vec![cube(radius), other]
        }
        // A hollow and what fills it.
        8 => vec![
            cube(14.0),
            inside_out(pin(radius, -8.0, 8.0, n, 0.0)),
            pin(radius + gap, -8.0 - gap, 8.0 + gap * random.unit(), other_n, phase),
        ],
        _ => vec![
            ball(14.0, [0.0; 3]),
            inside_out(ball(radius, [0.0; 3])),
            moved(ball(radius + gap, [0.0; 3]), gap * random.vector() * MM),
        ],
    };
    if random.below(2) == 0 {
        let turn = DQuat::from_scaled_axis(3.0 * random.vector());
        let by = 20.0 * random.vector() * MM;
        for piece in &mut pieces {
            piece.vertices.iter_mut().for_each(|vertex| *vertex = turn * *vertex + by);
        }
    }
    let decimals = [None, Some(3), Some(4), Some(5), Some(6)][random.below(5)];
    if let Some(decimals) = decimals {
        let steps = 10_f64.powi(decimals) / MM;
        for vertex in pieces.iter_mut().flat_map(|piece| &mut piece.vertices) {
            *vertex = (*vertex * steps).round() / steps;
        }
    }
    if random.below(2) == 0 && kind < 8 {
        pieces.reverse();
    }
    let said = format!("kind {kind}, gap {gap:.2e} mm, {n} and {other_n}, decimals {decimals:?}");
    (said, pieces)
}

/// Where a line along z passes through triangles: heights and ways, upward.
fn crossings(meshes: &[&TriangleMesh], x: f64, y: f64) -> Vec<(f64, i32)> {
    let mut found = Vec::new();
    let start = DVec3::new(x, y, -1.0);
    for mesh in meshes {
        for idx in 0..mesh.triangles.len() {
            let corners = mesh.corners(idx);
            // +1 leaves.
            let way = crossing(&corners, start);
            if way != 0 {
                let [a, b, c] = corners;
                let normal = (b - a).cross(c - a);
                let z = a.z + (normal.x * (a.x - x) + normal.y * (a.y - y)) / normal.z;
                let low = a.z.min(b.z).min(c.z);
                let high = a.z.max(b.z).max(c.z);
                found.push((z.clamp(low, high), -way));
            }
        }
    }
    found.sort_by(|one, other| one.0.total_cmp(&other.0));
    found
}

/// How much of a line lies in one of the two solids only.
fn differing(pieces: &[&TriangleMesh], border: &TriangleMesh, x: f64, y: f64) -> f64 {
    let mut events: Vec<(f64, i32, i32)> =
        crossings(pieces, x, y).into_iter().map(|(z, way)| (z, way, 0)).collect();
    events.extend(crossings(&[border], x, y).into_iter().map(|(z, way)| (z, 0, way)));
    events.sort_by(|one, other| one.0.total_cmp(&other.0));
    let mut sums = [0, 0];
    let mut last = 0.0;
    let mut length = 0.0;
    for (z, of_pieces, of_border) in events {
        if (sums[0] >= 1) != (sums[1] == 1) || sums[1] > 1 || sums[1] < 0 {
            length += z - last;
        }
        sums[0] += of_pieces;
        sums[1] += of_border;
        last = z;
    }
    length
}

fn area_m2(mesh: &TriangleMesh) -> f64 {
    let areas = (0..mesh.triangles.len()).map(|idx| {
        let [a, b, c] = mesh.corners(idx);
        0.5 * (b - a).cross(c - a).length()
    });
    areas.sum()
}

/// So many tolerances the border may be off.
const ALLOWED: f64 = 16.0;

/// What is wrong with the solid of a pair.
fn wrong(seed: u64) -> Result<(), String> {
    let mut random = Random::of(seed);
    let (said, pieces) = pair(&mut random);
    let mesh = together(pieces.clone());
    let (low, high) = mesh.bounds().unwrap();
    let tolerance_m = 1e-6 * low.distance(high);
    let found = Solid::of(&mesh, &SolidOptions::resolved_by(None));
    let border = &found.border;
    let fails = |what: String| Err(format!("{seed}: {said}: {what}; {:?}", found.report));
    if std::panic::catch_unwind(|| assert_closed(border)).is_err() {
        return fails("not closed".to_owned());
    }
    let pieces: Vec<&TriangleMesh> = pieces.iter().collect();
    let n_lines = 200;
    let mut length = 0.0;
    for _ in 0..n_lines {
        let share = DVec3::new(random.unit(), random.unit(), 0.0);
        let at = low + share * (high - low);
        length += differing(&pieces, border, at.x, at.y);
    }
    let size = high - low;
    let off = length / f64::from(n_lines) * size.x * size.y;
    let area: f64 = pieces.iter().map(|piece| area_m2(piece)).sum();
    if off > ALLOWED * tolerance_m * area {
        let whole: f64 = size.x * size.y * size.z;
        let explained = off / (tolerance_m * area);
        return fails(format!(
            "{:.2e} of the box is wrong, {explained:.0} tolerances",
            off / whole
        ));
    }
    for _ in 0..30 {
        let share = DVec3::new(random.unit(), random.unit(), random.unit()) * 1.4 - 0.2;
        let point = low + share * (high - low);
        let of_border = signed_distance(border, point);
        let each = pieces.iter().map(|piece| signed_distance(piece, point));
        let is_plain = pieces.len() == 2;
        let right = each.fold(f64::INFINITY, f64::min);
        let slack = ALLOWED * tolerance_m;
        let is_wrong = if right > 0.0 {
            (of_border - right).abs() > slack
        } else {
            is_plain && of_border > right + slack
        };
        if is_wrong {
            return fails(format!("{of_border} for {right} at {point}"));
        }
    }
    if let Some(text) = found.report.hollows_text().filter(|text| text.contains(" 0.00 ")) {
        return fails(text);
    }
    if !found.skins.triangles.is_empty() || found.report.volume_of_pieces_m3.is_some() {
        return fails("skins, or another volume".to_owned());
    }
    if found.report.open_edges > 0 {
        return fails("guesses".to_owned());
    }
    Ok(())
}

/// Of random pairs with these numbers, those that are wrong.
fn all_wrong(seeds: core::ops::Range<u64>) -> Vec<String> {
    let n = (seeds.end - seeds.start) as usize;
    let results = crate::parallel::map(n, 4, |k| wrong(seeds.start + k as u64).err());
    results.into_iter().flatten().collect()
}

#[test]
fn bodies_with_faces_that_nearly_lie_on_each_other_are_their_union() {
    let wrong = all_wrong(0..200);
    assert!(wrong.is_empty(), "{} of 200: {wrong:#?}", wrong.len());
}

#[test]
fn lines_that_are_parts_of_their_own_parts_are_looked_into_once() {
    // It took hours.
    assert_eq!(wrong(1584), Ok(()));
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn thousands_of_such_pairs_are_their_union() {
    let wrong = all_wrong(1000..3000);
    assert!(wrong.is_empty(), "{} of 2000: {wrong:#?}", wrong.len());
}

#[test]
fn a_ball_that_stands_twice_is_one_however_far_the_copies_are_apart() {
    let one = ball(10.0, [0.0; 3]);
    let right = volume(&one);
    let tolerance_m = 1e-6 * 20.0 * MM * 3.0_f64.sqrt();
    for tolerances in [0.01, 0.3, 0.8, 1.0, 1.2, 2.0, 3.5, 4.0, 4.5, 6.0, 7.0, 9.0, 30.0] {
        let by_m = tolerances * tolerance_m;
        let mut wider = one.clone();
        wider.vertices.iter_mut().for_each(|vertex| *vertex *= 1.0 + by_m / (10.0 * MM));
        let beside = moved(one.clone(), DVec3::new(0.6, -0.5, 0.62) * by_m);
        for other in [wider, beside] {
            let found =
                Solid::of(&together([one.clone(), other]), &SolidOptions::resolved_by(None));
            assert_closed(&found.border);
            let off = (volume(&found.border) - right).abs() / area_m2(&one);
            let allowed = by_m + 4.0 * tolerance_m;
            assert!(off <= allowed, "{tolerances}: {off} {:?}", found.report);
            assert_eq!(found.report.open_edges, 0, "{tolerances}");
        }
    }
}

#[test]
fn pins_in_bores_of_the_same_diameter_are_full_in_three_decimals() {
    for k in 0..60 {
        let mut random = Random::of(k);
        let n = 12 + random.below(40);
        let other_n = if k % 3 == 0 { 12 + random.below(40) } else { n };
        let radius = random.between(3.0, 8.0);
        let bore = bush(radius, radius + 6.0, -6.0, 6.0, n, 0.0);
        let mut mesh = together([bore, pin(radius, -9.0, 9.0, other_n, random.unit())]);
        mesh.vertices.iter_mut().for_each(|vertex| *vertex = (*vertex * 1e6).round() / 1e6);
        let found = Solid::of(&mesh, &SolidOptions::resolved_by(None));
        assert_closed(&found.border);
        let circle =
            |n: usize, radius: f64| 0.5 * n as f64 * (TAU / n as f64).sin() * radius.powi(2);
        // The pin ends on the chords of the bore or beyond them.
        let outer = 12.0 * circle(n, radius + 6.0) + 6.0 * circle(other_n, radius);
        let narrower = circle(n, radius).min(circle(other_n, radius));
        let gap = 12.0 * (0.5 * TAU * radius.powi(2) - narrower);
        let found_mm3 = volume(&found.border) / MM.powi(3);
        let slack = 1e-5 * outer;
        assert!(found_mm3 <= outer + slack, "{k}: {found_mm3} {outer}");
        assert!(found_mm3 >= outer - gap - slack, "{k}: {found_mm3} {outer} {gap}");
        assert_eq!((found.report.open_edges, found.report.volume_of_pieces_m3), (0, None), "{k}");
    }
}
