//! Closed solids, put together like the parts of a CAD assembly: each one closed and outward, free
//! to touch or to enter others.

use core::f64::consts::TAU;

use glam::{DAffine3, DVec2, DVec3};

use vps::mesh::{TriangleMesh, polygon};

/// Parts in one mesh, millimetres.
#[derive(Debug, Default)]
pub(super) struct Assembly {
    mesh: TriangleMesh,
}

impl Assembly {
    /// Triangles so far.
    pub(super) fn n_triangles(&self) -> usize {
        self.mesh.triangles.len()
    }

    /// Stretches the assembly so that its box is `[0, 0, 0]` to `box_mm`, and gives it in metres.
    ///
    /// Callers build to size but for a few per cent, so that round things stay round.
    pub(super) fn fitted(self, box_mm: DVec3) -> TriangleMesh {
        let mut mesh = self.mesh;
        let (low, high) = mesh.bounds().unwrap_or_default();
        let stretch = box_mm / (high - low);
        debug_assert!(
            (stretch - 1.0).abs().max_element() < 0.05,
            "built to size: {low} to {high} for {box_mm}"
        );
        for vertex in &mut mesh.vertices {
            *vertex = (*vertex - low) * stretch * 1e-3;
        }
        mesh
    }

    /// Rings of equally many points, joined in order, with a fan over the first and the last ring.
    /// Rings turn right-handed about the way from first to last, and are convex. `n` points on `k`
    /// rings: `2n(k − 1) + 2(n − 2)` triangles.
    pub(super) fn loft(&mut self, rings: &[Vec<DVec3>]) {
        let (Some(first), Some(last)) = (rings.first(), rings.last()) else { return };
        let n = first.len() as u32;
        let base = self.push_rings(rings);
        for ring in 1..rings.len() as u32 {
            self.push_band(base + (ring - 1) * n, base + ring * n, n);
        }
        let top = base + (rings.len() as u32 - 1) * n;
        debug_assert_eq!(first.len(), last.len());
        for k in 1..n - 1 {
            self.mesh.triangles.push([base, base + k + 1, base + k]);
            self.mesh.triangles.push([top, top + k, top + k + 1]);
        }
    }

    /// Rings joined in order, the last one to the first again: `2nk` triangles.
    pub(super) fn loop_of(&mut self, rings: &[Vec<DVec3>]) {
        let n = rings.first().map_or(0, Vec::len) as u32;
        let k = rings.len() as u32;
        let base = self.push_rings(rings);
        for ring in 0..k {
            self.push_band(base + ring * n, base + (ring + 1) % k * n, n);
        }
    }

    fn push_rings(&mut self, rings: &[Vec<DVec3>]) -> u32 {
        let base = self.mesh.vertices.len() as u32;
        self.mesh.vertices.extend(rings.iter().flatten());
        base
    }

    fn push_band(&mut self, below: u32, above: u32, n: u32) {
        for k in 0..n {
            let next = (k + 1) % n;
            self.mesh.triangles.push([below + k, below + next, above + next]);
            self.mesh.triangles.push([below + k, above + next, above + k]);
        }
    }

    /// A cylinder (or prism) of `n` sides along z of `place`: `4n − 4` triangles.
    pub(super) fn cylinder(
        &mut self,
        place: DAffine3,
        radius: f64,
        [low, high]: [f64; 2],
        n: usize,
    ) {
        self.loft(&[low, high].map(|z| circle(place, radius, z, n)));
    }

    /// A closed profile of (distance from the axis, z), counter-clockwise, turned about z of
    /// `place`: two triangles for each of its corners and `n` steps.
    pub(super) fn revolved(&mut self, place: DAffine3, profile: &[DVec2], n: usize) {
        self.loop_of(
            &profile.iter().map(|corner| circle(place, corner.x, corner.y, n)).collect::<Vec<_>>(),
        );
    }

    /// A tube of square section: `8n` triangles.
    pub(super) fn tube(
        &mut self,
        place: DAffine3,
        [inner, outer]: [f64; 2],
        [low, high]: [f64; 2],
        n: usize,
    ) {
        self.revolved(
            place,
            &[(inner, low), (outer, low), (outer, high), (inner, high)].map(DVec2::from),
            n,
        );
    }

    /// A box around the origin of `place`: 12 triangles.
    pub(super) fn cuboid(&mut self, place: DAffine3, half: DVec3) {
        let rings = [-1.0, 1.0].map(|z| {
            [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
                .map(|(x, y)| place.transform_point3(half * DVec3::new(x, y, z)))
                .to_vec()
        });
        self.loft(&rings);
    }

    /// A round bar of `n` sides along a path: `2n(points − 1) + 2(n − 2)` triangles.
    pub(super) fn bar(&mut self, path: &[DVec3], radius: f64, n: usize) {
        let mut across = DVec3::ZERO;
        let rings: Vec<Vec<DVec3>> = (0..path.len())
            .map(|k| {
                let ahead = (path[(k + 1).min(path.len() - 1)] - path[k.saturating_sub(1)])
                    .normalize_or(DVec3::Z);
                // Carried along and turned as little as possible, so that the bar does not twist.
                across = (across - ahead * across.dot(ahead))
                    .try_normalize()
                    .unwrap_or_else(|| ahead.any_orthonormal_vector());
                let third = ahead.cross(across);
                let frame = DAffine3::from_cols(across, third, ahead, path[k]);
                circle(frame, radius, 0.0, n)
            })
            .collect();
        self.loft(&rings);
    }

    /// A sheet of constant thickness: `surface(u, v)` over the unit square is its outer face, ∂u ×
    /// ∂v outward. Triangles: `4·nu·nv + 4(nu + nv)`.
    pub(super) fn sheet(
        &mut self,
        [nu, nv]: [usize; 2],
        thickness: f64,
        surface: impl Fn(f64, f64) -> DVec3,
    ) {
        let base = self.mesh.vertices.len() as u32;
        let du = 1.0 / nu as f64;
        let dv = 1.0 / nv as f64;
        for side in [0.0, thickness] {
            for i in 0..=nu {
                for j in 0..=nv {
                    let u = i as f64 * du;
                    let v = j as f64 * dv;
                    let along_u = surface(u + 0.5 * du, v) - surface(u - 0.5 * du, v);
                    let along_v = surface(u, v + 0.5 * dv) - surface(u, v - 0.5 * dv);
                    self.mesh
                        .vertices
                        .push(surface(u, v) - along_u.cross(along_v).normalize_or_zero() * side);
                }
            }
        }
        let back = ((nu + 1) * (nv + 1)) as u32;
        let at = |i: usize, j: usize| base + (i * (nv + 1) + j) as u32;
        let mut quad = |[a, b, c, d]: [u32; 4]| self.mesh.triangles.extend([[a, b, c], [a, c, d]]);
        for i in 0..nu {
            for j in 0..nv {
                let front = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
                quad(front);
                let [a, b, c, d] = front.map(|vertex| vertex + back);
                quad([a, d, c, b]);
            }
        }
        for i in 0..nu {
            for (from, to) in [(at(i, 0), at(i + 1, 0)), (at(i + 1, nv), at(i, nv))] {
                quad([from, from + back, to + back, to]);
            }
        }
        for j in 0..nv {
            for (from, to) in [(at(nu, j), at(nu, j + 1)), (at(0, j + 1), at(0, j))] {
                quad([from, from + back, to + back, to]);
            }
        }
    }

    /// A cushion: a box with round edges, of `n` steps about z and `n / 2` along it, `n` a multiple
    /// of 4. `2n(n/2 − 1)` triangles and a few in the caps.
    pub(super) fn cushion(&mut self, place: DAffine3, half: DVec3, n: usize) {
        // A superellipsoid: powers of sine and cosine flatten the sides.
        let bent = |angle: f64| {
            (
                angle.cos().abs().powf(0.4) * angle.cos().signum(),
                angle.sin().abs().powf(0.4) * angle.sin().signum(),
            )
        };
        let rings: Vec<Vec<DVec3>> = (1..n / 2)
            .map(|k| {
                let (across, z) = bent((k as f64 / (n / 2) as f64 - 0.5) * core::f64::consts::PI);
                (0..n)
                    .map(|j| {
                        let (x, y) = bent((j as f64 + 0.5) / n as f64 * TAU);
                        place.transform_point3(half * DVec3::new(across * x, across * y, z))
                    })
                    .collect()
            })
            .collect();
        self.loft(&rings);
    }

    /// A plate with holes along z of `place`. The outline turns counter-clockwise; so do the holes,
    /// which lie inside it and apart from each other. `V` corners in all and `H` holes: `4(V + H −
    /// 1)` triangles, as CAD programs cut faces.
    pub(super) fn plate(
        &mut self,
        place: DAffine3,
        outline: &[DVec2],
        holes: &[Vec<DVec2>],
        [low, high]: [f64; 2],
    ) {
        let flat: Vec<DVec2> = outline.iter().chain(holes.iter().flatten()).copied().collect();
        let base = self.mesh.vertices.len() as u32;
        let n_flat = flat.len() as u32;
        for z in [low, high] {
            self.mesh
                .vertices
                .extend(flat.iter().map(|corner| place.transform_point3(corner.extend(z))));
        }
        let mut start = n_flat - holes.iter().map(|hole| hole.len() as u32).sum::<u32>();
        let mut loops: Vec<Vec<u32>> = vec![(0..start).collect()];
        for hole in holes {
            let end = start + hole.len() as u32;
            // The other way round: material lies on the left of every loop.
            loops.push((start..end).rev().collect());
            start = end;
        }
        for rim in &loops {
            for (k, from) in rim.iter().enumerate() {
                let from = base + from;
                let to = base + rim[(k + 1) % rim.len()];
                self.mesh
                    .triangles
                    .extend([[from, to, to + n_flat], [from, to + n_flat, from + n_flat]]);
            }
        }
        let spread: Vec<DVec3> = flat.iter().map(|corner| corner.extend(0.0)).collect();
        let mut face = Vec::new();
        polygon::triangulate(&spread, &bridged(&flat, loops), &mut face);
        for [a, b, c] in face {
            self.mesh.triangles.push([a, b, c].map(|corner| base + n_flat + corner));
            self.mesh.triangles.push([c, b, a].map(|corner| base + corner));
        }
    }

    /// A double pyramid over `n` corners, a rivet: `2n` triangles, so that any even number above
    /// four can be had.
    pub(super) fn rivet(&mut self, center: DVec3, radius: f64, n: usize) {
        let base = self.mesh.vertices.len() as u32;
        self.mesh.vertices.extend([center - DVec3::Z * radius, center + DVec3::Z * radius]);
        self.mesh.vertices.extend(circle(DAffine3::from_translation(center), radius, 0.0, n));
        for k in 0..n as u32 {
            let from = base + 2 + k;
            let to = base + 2 + (k + 1) % n as u32;
            self.mesh.triangles.extend([[base, to, from], [base + 1, from, to]]);
        }
    }

    /// Rivets at the places that `place` gives, until there are `n_triangles`. All have the same
    /// number of sides but the last ones.
    ///
    /// # Panics
    /// When there is no room for one rivet, or an odd number is left: closed parts have an even
    /// number of triangles.
    pub(super) fn rivets_up_to(
        &mut self,
        n_triangles: usize,
        sides: usize,
        radius: f64,
        mut place: impl FnMut() -> DVec3,
    ) {
        let mut left = n_triangles
            .checked_sub(self.n_triangles())
            .filter(|left| left % 2 == 0 && *left >= 6)
            .expect("room for rivets");
        while left > 0 {
            // Never leaves less than the smallest rivet.
            let sides = if left >= 2 * sides + 6 { sides } else { left / 2 };
            self.rivet(place(), radius, sides);
            left -= 2 * sides;
        }
    }
}

/// `n` points around z of `place`, counter-clockwise.
pub(super) fn circle(place: DAffine3, radius: f64, z: f64, n: usize) -> Vec<DVec3> {
    ring(DVec2::ZERO, radius, n)
        .into_iter()
        .map(|point| place.transform_point3(point.extend(z)))
        .collect()
}

/// `n` points around a centre, counter-clockwise.
pub(super) fn ring(center: DVec2, radius: f64, n: usize) -> Vec<DVec2> {
    (0..n).map(|k| center + radius * DVec2::from_angle(TAU * k as f64 / n as f64)).collect()
}

/// The outer loop with every hole joined to it by a bridge that is walked both ways.
fn bridged(flat: &[DVec2], mut loops: Vec<Vec<u32>>) -> Vec<u32> {
    let at = |vertex: u32| flat[vertex as usize];
    let mut outer = loops.remove(0);
    // From the right: the bridge of a hole then never needs a hole that is not joined yet.
    let rightmost = |rim: &[u32]| {
        rim.iter().copied().max_by(|a, b| at(*a).x.total_cmp(&at(*b).x)).unwrap_or_default()
    };
    loops.sort_by(|a, b| at(rightmost(b)).x.total_cmp(&at(rightmost(a)).x));
    for idx in 0..loops.len() {
        let rim = &loops[idx];
        let from = rightmost(rim);
        let mut candidates: Vec<usize> = (0..outer.len()).collect();
        candidates.sort_by(|a, b| {
            at(outer[*a])
                .distance_squared(at(from))
                .total_cmp(&at(outer[*b]).distance_squared(at(from)))
        });
        let is_clear = |to: u32| {
            let edges_of = |rim: &[u32]| {
                (0..rim.len()).map(|k| [rim[k], rim[(k + 1) % rim.len()]]).collect::<Vec<_>>()
            };
            edges_of(&outer)
                .into_iter()
                .chain(loops[idx..].iter().flat_map(|rim| edges_of(rim)))
                .all(|[a, b]| {
                    [a, b].iter().any(|end| [from, to].contains(end))
                        || !crosses([at(from), at(to)], [at(a), at(b)])
                })
        };
        let outward = |k: usize| {
            // The bridge must leave the outer loop towards the material, not across its corner from
            // behind.
            let n = outer.len();
            let before = at(outer[(k + n - 1) % n]);
            let here = at(outer[k]);
            let after = at(outer[(k + 1) % n]);
            let bridge = at(from) - here;
            let into = here - before;
            let out = after - here;
            let left_of_in = into.perp_dot(bridge) > 0.0;
            let left_of_out = out.perp_dot(bridge) > 0.0;
            if into.perp_dot(out) >= 0.0 {
                left_of_in && left_of_out
            } else {
                left_of_in || left_of_out
            }
        };
        let Some(to) = candidates.into_iter().find(|k| outward(*k) && is_clear(outer[*k])) else {
            continue;
        };
        let first = rim.iter().position(|vertex| *vertex == from).unwrap_or(0);
        let around = (0..=rim.len()).map(|k| rim[(first + k) % rim.len()]);
        let bridge: Vec<u32> = core::iter::once(outer[to]).chain(around).collect();
        // Before the corner comes its own copy, then the hole, then the corner again.
        outer.splice(to..to, bridge);
    }
    outer
}

/// True when two segments have a point in common.
fn crosses([a, b]: [DVec2; 2], [c, d]: [DVec2; 2]) -> bool {
    let side = |p: DVec2, q: DVec2, r: DVec2| (q - p).perp_dot(r - p);
    side(a, b, c) * side(a, b, d) <= 0.0 && side(c, d, a) * side(c, d, b) <= 0.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use vps::mesh::validate::inspect;

    fn sound(build: impl FnOnce(&mut Assembly), n_triangles: usize, volume_mm3: f64) {
        let mut assembly = Assembly::default();
        build(&mut assembly);
        assert_eq!(assembly.n_triangles(), n_triangles);
        let report = inspect(&assembly.mesh);
        assert!(
            report.closed && report.inconsistent_edges == 0 && report.degenerate_triangles == 0,
            "{report:?}"
        );
        assert!(
            (report.signed_volume_m3 / volume_mm3 - 1.0).abs() < 0.02,
            "{} for {volume_mm3}",
            report.signed_volume_m3
        );
    }

    #[test]
    fn every_solid_is_closed_and_outward() {
        let place = DAffine3::from_axis_angle(DVec3::new(1.0, 2.0, -1.0).normalize(), 0.7);
        let pi = core::f64::consts::PI;
        sound(|a| a.cylinder(place, 3.0, [-1.0, 4.0], 64), 252, pi * 45.0);
        sound(|a| a.tube(place, [2.0, 3.0], [-1.0, 4.0], 64), 512, pi * 25.0);
        sound(|a| a.cuboid(place, DVec3::new(1.0, 2.0, 3.0)), 12, 48.0);
        sound(|a| a.rivet(DVec3::ONE, 2.0, 40), 80, pi * 16.0 / 3.0);
        let arc: Vec<DVec3> = (0..=40)
            .map(|k| DVec2::from_angle(f64::from(k) * 0.05).extend(0.01 * f64::from(k)) * 20.0)
            .collect();
        sound(|a| a.bar(&arc, 1.0, 32), 2 * 32 * 40 + 60, pi * 40.8);
        let dome = |u: f64, v: f64| {
            place.transform_point3(DVec3::new(10.0 * u, 8.0 * v, 1.0 - (u - 0.5).powi(2)))
        };
        sound(|a| a.sheet([20, 10], 0.5, dome), 800 + 120, 40.1);
        sound(|a| a.cushion(place, DVec3::new(3.0, 2.0, 1.0), 32), 2 * 32 * 14 + 60, 41.6);
    }

    #[test]
    fn a_plate_is_covered_once_whatever_its_holes() {
        let outline: Vec<DVec2> = [(0, 0), (60, 0), (60, 20), (20, 20), (20, 50), (0, 50)]
            .map(|(x, y)| DVec2::new(x.into(), y.into()))
            .into();
        for n in [5, 16, 33] {
            let holes: Vec<Vec<DVec2>> =
                [(10.0, 10.0), (25.0, 9.0), (45.0, 10.0), (10.0, 25.0), (9.0, 40.0)]
                    .map(|(x, y)| ring(DVec2::new(x, y), 4.0, n))
                    .into();
            let mut assembly = Assembly::default();
            assembly.plate(DAffine3::IDENTITY, &outline, &holes, [0.0, 5.0]);
            assert_eq!(assembly.n_triangles(), 4 * (6 + 5 * n + 5 - 1));
            let report = inspect(&assembly.mesh);
            assert!(report.closed && report.inconsistent_edges == 0, "{report:?}");
            let hole = 0.5 * n as f64 * 16.0 * (TAU / n as f64).sin();
            let area = 60.0 * 20.0 + 20.0 * 30.0 - 5.0 * hole;
            let walls = 5.0 * (2.0 * 110.0 + 5.0 * n as f64 * 8.0 * (0.5 * TAU / n as f64).sin());
            assert!((report.signed_volume_m3 / (5.0 * area) - 1.0).abs() < 1e-9);
            // Triangles that overlapped would add area and leave the volume.
            assert!(
                (report.area_m2 / (2.0 * area + walls) - 1.0).abs() < 1e-9,
                "{} {}",
                report.area_m2,
                2.0 * area + walls
            );
        }
    }
}
