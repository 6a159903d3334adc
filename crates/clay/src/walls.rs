//! Whether mass points and samples are near enough to each other for the walls of a solid.
//!
//! # The measure
//! The wall at a place of the border is the way from there, against the normal, to where the solid
//! ends. A place of an area a with a wall t stands for the volume a·t/2. Over both faces of a plate
//! that sums up to its volume; a ball and a cube are counted three times, so thin walls never count
//! too little. Of that volume a wall loses the part `lost(t/d)` where mass points, or samples, are
//! d apart. What all walls lose together is held against the volume of the solid. So an edge, where
//! walls go to 0, counts for the little that it holds.
//!
//! # What walls lose
//! Plates of 20 × 16 × 1 mm: the part of the volume that was lost, the least and the most of eight
//! places of flat ones between the mass points, and of eight attitudes; samples 0.4 mm apart.
//!
//! | wall over the distance of mass points | flat | askew | taken for lost |
//! |---|---|---|---|
//! | 1 | 0.11 to 0.59 | 0.09 to 0.33 | 0.72 |
//! | 1.2 | 0.04 to 0.19 | 0.09 to 0.32 | 0.48 |
//! | 1.4 | 0.03 to 0.10 | 0.05 to 0.20 | 0.29 |
//! | 1.6 | 0.02 to 0.06 | 0.03 to 0.08 | 0.15 |
//! | 1.8 | 0.02 to 0.03 | 0.02 | 0.05 |
//! | 2 | 0.01 to 0.02 | 0.01 to 0.02 | 0.01 |
//! | 3 | 0.00 to −0.01 | −0.01 | 0 |
//!
//! With mass points 0.4 mm apart, of walls of 1, 1.3, 1.6, 2 and 3 times the spacing of the samples:
//! all, −0.07, −0.03, −0.01, 0.01.

use glam::DVec3;
use rayon::prelude::*;

use super::clay_model::{ClayModelError, Settings, lattices, region_box};
use super::load::{area_m2, spacing_of};
use super::sample::MOST_SAMPLES;
use super::{Neighbour, Neighbours, OpenedSolid, PointSet, SurfaceError, sample};
use vps::mesh::TriangleMesh;

/// Walls may lose this part of the volume.
const LOST_SHARE: f64 = 0.05;
/// So many distances of mass points, or of samples, across it, a wall loses nothing.
const WHOLE: f64 = 2.1;
/// With so many fewer it loses all.
const WHOLE_TO_LOST: f64 = 1.3;
/// Places at which walls are measured.
const PROBES: f64 = 4000.0;
/// What is proposed is accepted, in four digits too.
const ACCEPTED: f64 = 0.999;
/// Halvings in the search for a distance.
const HALVINGS: usize = 40;

impl OpenedSolid {
    /// Refuses a raster, and a spacing of samples, with which walls lose more than a twentieth of
    /// the volume. Cost: that of some thousand rays, each over the triangles near it.
    ///
    /// # Errors
    /// [`ClayModelError::ThinWalls`], and those of a raster that cannot be.
    pub fn check_walls(&self, settings: &Settings) -> Result<(), ClayModelError> {
        let Some((border, samples_m)) = self.faces() else { return Ok(()) };
        let Some(bounds) = border.bounds() else { return Ok(()) };
        // Too few samples for a surface, or too many, are refused as such when they are taken.
        let n_samples = area_m2(&border) / (samples_m * samples_m);
        if !(PointSet::LEAST as f64..=MOST_SAMPLES).contains(&n_samples) {
            return Ok(());
        }
        let (whole, ..) = lattices(bounds, settings)?;
        let widest_m = whole.spacing_m.max(samples_m);
        let walls = Walls::new(&border, WHOLE * widest_m)?;
        let lost_share = walls.lost_share(widest_m);
        if lost_share <= LOST_SHARE {
            return Ok(());
        }
        let apart_m = ACCEPTED * walls.held_by_m(widest_m);
        let (low, high) = region_box(bounds, settings);
        let steps = ((high - low) / apart_m).ceil().to_array();
        Err(ClayModelError::ThinWalls {
            wall_m: walls.most_lost_m(widest_m),
            lost_share: lost_share.min(1.0),
            apart_m,
            raster: settings.raster,
            mass_points_m: whole.spacing_m,
            samples_m,
            needed: steps.map(|steps| (steps as usize + 1).max(4)),
        })
    }
}

/// Walls of a solid that are thinner than some limit.
struct Walls {
    /// Thinnest first, m.
    thicknesses_m: Vec<f64>,
    /// Area of the border for which each stands, over the volume of the solid, 1/m.
    area_per_m: f64,
}

impl Walls {
    fn new(border: &TriangleMesh, below_m: f64) -> Result<Self, SurfaceError> {
        let volume_m3 = volume_m3(border);
        // What is no body has no walls.
        if volume_m3 <= 0.0 {
            return Ok(Self { thicknesses_m: Vec::new(), area_per_m: 0.0 });
        }
        let probes = sample(border, spacing_of(border, PROBES))?;
        let exits = Exits::new(border, below_m);
        let places = probes.positions_map.par_iter().zip(&probes.normals_map);
        let walls_m: Vec<Option<f64>> = places
            .map_init(Vec::new, |near, (at, normal)| exits.wall_m(*at, -*normal, near))
            .collect();
        let mut thicknesses_m: Vec<f64> = walls_m.into_iter().flatten().collect();
        thicknesses_m.sort_unstable_by(f64::total_cmp);
        let area_per_m = area_m2(border) / (probes.len() as f64 * volume_m3);
        Ok(Self { thicknesses_m, area_per_m })
    }

    /// The part of the volume that each wall loses with mass points or samples so far apart, m.
    fn losses(&self, apart_m: f64) -> impl Iterator<Item = f64> {
        let loss = move |wall_m: &f64| 0.5 * self.area_per_m * wall_m * lost(wall_m / apart_m);
        self.thicknesses_m.iter().map(loss)
    }

    /// What all of them lose.
    fn lost_share(&self, apart_m: f64) -> f64 {
        self.losses(apart_m).sum()
    }

    /// The largest distance that holds them, where this one, m, does not.
    fn held_by_m(&self, apart_m: f64) -> f64 {
        let mut held_m = 0.0;
        let mut not_held_m = apart_m;
        for _ in 0..HALVINGS {
            let middle_m = 0.5 * (held_m + not_held_m);
            if self.lost_share(middle_m) <= LOST_SHARE {
                held_m = middle_m;
            } else {
                not_held_m = middle_m;
            }
        }
        held_m
    }

    /// The wall, m, below which half of what is lost lies.
    fn most_lost_m(&self, apart_m: f64) -> f64 {
        let half = 0.5 * self.lost_share(apart_m);
        let mut sum = 0.0;
        let mut pairs = self.thicknesses_m.iter().zip(self.losses(apart_m));
        let middle = pairs.find(|(_, loss)| {
            sum += loss;
            sum >= half
        });
        middle.map_or(0.0, |(wall_m, _)| *wall_m)
    }
}

/// The part of its volume that a wall loses, over its thickness in distances of mass points.
fn lost(thickness: f64) -> f64 {
    ((WHOLE - thickness) / WHOLE_TO_LOST).clamp(0.0, 1.0).powi(2)
}

/// What triangles enclose; less than 0 where they face inward.
fn volume_m3(mesh: &TriangleMesh) -> f64 {
    let origin = mesh.vertices.first().copied().unwrap_or_default();
    let of = |triangle| {
        let [a, b, c] = mesh.corners(triangle).map(|corner| corner - origin);
        a.dot(b.cross(c)) / 6.0
    };
    (0..mesh.triangles.len()).map(of).sum()
}

/// Where rays end that start on the border of a solid and go into it.
struct Exits<'a> {
    border: &'a TriangleMesh,
    /// The middles of the triangles.
    middles: Neighbours,
    /// Of each node of that tree, m: the middle of a ray that a triangle of it may meet is no
    /// farther from the middle of that triangle.
    reaches_m: Vec<f64>,
    /// The longest ray.
    below_m: f64,
}

impl<'a> Exits<'a> {
    fn new(border: &'a TriangleMesh, below_m: f64) -> Self {
        let n_triangles = border.triangles.len();
        let middle = |triangle: usize| border.corners(triangle).iter().sum::<DVec3>() / 3.0;
        let positions: Vec<DVec3> = (0..n_triangles).map(middle).collect();
        let middles = Neighbours::new(&positions);
        let radius_m = |triangle: &u32| {
            let at = positions[*triangle as usize];
            let corners = border.corners(*triangle as usize);
            corners.iter().map(|corner| corner.distance(at)).fold(0.0, f64::max)
        };
        let mut reaches_m = vec![0.0; middles.n_nodes()];
        middles.for_each_node(|node, range, _, _| {
            let largest_m = middles.samples()[range].iter().map(radius_m).fold(0.0, f64::max);
            reaches_m[node] = largest_m + 0.5 * below_m;
        });
        Self { border, middles, reaches_m, below_m }
    }

    /// The length of a ray, m; `None` where it is not shorter than the longest. `near` is for the
    /// triangles around it.
    fn wall_m(&self, from: DVec3, inward: DVec3, near: &mut Vec<Neighbour>) -> Option<f64> {
        self.middles.covering(from + 0.5 * self.below_m * inward, &self.reaches_m, near);
        let ends_m = near
            .iter()
            .filter_map(|other| end_m(self.border.corners(other.sample as usize), from, inward));
        let end_m = ends_m.fold(self.below_m, f64::min);
        (end_m < self.below_m).then_some(end_m)
    }
}

/// How far a ray is from its start to a triangle through which it leaves the solid; `None` where it
/// does not.
///
/// # Source
/// Möller and Trumbore 1997, "Fast, minimum storage ray-triangle intersection".
fn end_m([a, b, c]: [DVec3; 3], from: DVec3, way: DVec3) -> Option<f64> {
    /// So that no ray slips through between two triangles.
    const SLACK: f64 = 1e-9;
    let to_b = b - a;
    let to_c = c - a;
    let across = way.cross(to_c);
    let determinant = to_b.dot(across);
    // Less than 0: along the normal of the triangle. The face that it starts on is the other way.
    if determinant >= 0.0 {
        return None;
    }
    let start = from - a;
    let along_b = start.dot(across) / determinant;
    let turned = start.cross(to_b);
    let along_c = way.dot(turned) / determinant;
    let end_m = to_c.dot(turned) / determinant;
    let is_hit = along_b >= -SLACK && along_c >= -SLACK && along_b + along_c <= 1.0 + SLACK;
    (is_hit && end_m > 0.0).then_some(end_m)
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use glam::DQuat;

    use super::*;
    use crate::export::write_mesh;
    use crate::mesh_solid::MeshSolid;
    use crate::{ClayModel, Solid};
    use vps::mesh::FileMesh;
    use vps::mesh::primitives::Shape;

    const MM: f64 = 1e-3;

    fn plate(size_mm: [f64; 3], turn: DQuat) -> TriangleMesh {
        let size_m = DVec3::from_array(size_mm) * MM;
        let mut mesh = Shape::Box { size_m }.tessellate(1.0);
        mesh.vertices.iter_mut().for_each(|at| *at = turn * *at);
        mesh
    }

    fn opened(dir: &Path, mesh: &TriangleMesh, spacing_mm: f64) -> OpenedSolid {
        let path = dir.join("part.ply");
        write_mesh(&path, mesh).unwrap();
        let spacing_m = Some(spacing_mm * MM);
        Solid::File { path, metres_per_unit: 1.0, scale: DVec3::ONE, spacing_m }.open().unwrap()
    }

    /// The first one as it lies.
    fn attitude(k: u32) -> DQuat {
        let part = |step: f64| (f64::from(k) * step).fract() - 0.5;
        let axis = DVec3::new(part(0.754_877_7), part(0.569_840_3), part(0.430_159_7));
        DQuat::from_axis_angle(axis.normalize(), 3.0 * f64::from(k) * 0.618_034)
    }

    /// Mass points so far apart, the first one a part of that from the middle of the solid.
    fn settings(mesh: &TriangleMesh, spacing_mm: f64, phase: f64) -> Settings {
        let spacing_m = spacing_mm * MM;
        let (low, high) = mesh.bounds().unwrap();
        let steps = ((high - low) / spacing_m).ceil() + 6.0;
        let middle = 0.5 * (low + high) + phase * spacing_m;
        let half = 0.5 * steps * spacing_m;
        Settings {
            region_map: Some((middle - half, middle + half)),
            raster: steps.to_array().map(|n| n as usize + 1),
            air_m: 0.0,
            ..Settings::default()
        }
    }

    /// The wall below which half of the walls lie that are thinner than this, and the part of the
    /// volume that they hold.
    fn walls(mesh: &TriangleMesh, below_mm: f64) -> Option<(f64, f64)> {
        let walls = Walls::new(mesh, below_mm * MM).unwrap();
        let middle_m = *walls.thicknesses_m.get(walls.thicknesses_m.len() / 2)?;
        let share = 0.5 * walls.area_per_m * walls.thicknesses_m.iter().sum::<f64>();
        Some((middle_m / MM, share))
    }

    #[test]
    fn walls_are_those_of_the_closed_form() {
        for k in 0..4 {
            let sheet = plate([20.0, 16.0, 1.0], attitude(k));
            let (wall_mm, share) = walls(&sheet, 5.0).unwrap();
            assert!(
                (wall_mm - 1.0).abs() < 1e-9 && (share - 1.0).abs() < 0.03,
                "{wall_mm} {share}"
            );
            assert_eq!(walls(&sheet, 0.999), None);
        }
        let ball =
            |radius_mm: f64| Shape::Sphere { radius_m: radius_mm * MM }.tessellate(0.005 * MM);
        assert_eq!(walls(&ball(10.0), 19.0), None);
        let mut hollow = ball(10.0);
        let first = hollow.vertices.len() as u32;
        let inner = ball(8.5);
        hollow.vertices.extend(inner.vertices);
        let turned = |[a, b, c]: [u32; 3]| [first + a, first + c, first + b];
        hollow.triangles.extend(inner.triangles.into_iter().map(turned));
        let (wall_mm, share) = walls(&hollow, 5.0).unwrap();
        let expected = 0.75 * 4.0 * (100.0 + 72.25) / (4.0 / 3.0 * (1000.0 - 614.125));
        assert!((wall_mm - 1.5).abs() < 0.02 && (share / expected - 1.0).abs() < 0.02, "{share}");

        // 10 mm long, 5 mm high at its back: a hundredth of its volume lies before its first
        // millimetre, and is counted from below and from above.
        let corner = |x: f64, y: f64, z: f64| DVec3::new(x, y, z) * MM;
        let wedge = TriangleMesh {
            vertices: [0.0, 10.0]
                .map(|y| [corner(0.0, y, 0.0), corner(10.0, y, 0.0), corner(10.0, y, 5.0)])
                .concat(),
            triangles: vec![
                [0, 1, 2],
                [3, 5, 4],
                [0, 3, 4],
                [0, 4, 1],
                [1, 4, 5],
                [1, 5, 2],
                [2, 5, 3],
                [2, 3, 0],
            ],
        };
        let (_, share) = walls(&wedge, 0.5).unwrap();
        assert!((0.005..0.02).contains(&share), "{share}");
        assert!(Walls::new(&wedge, 1.05 * MM).unwrap().lost_share(0.5 * MM) < LOST_SHARE);
    }

    #[test]
    fn samples_that_make_no_surface_are_not_the_walls_fault() {
        let dir = tempfile::tempdir().unwrap();
        let sheet = plate([20.0, 16.0, 1.0], DQuat::IDENTITY);
        let settings = settings(&sheet, 0.5, 0.0);
        for (spacing_mm, is_refused) in [(10.0, false), (2.0, true), (0.5, false), (0.01, false)] {
            let checked = opened(dir.path(), &sheet, spacing_mm).check_walls(&settings);
            assert_eq!(checked.is_err(), is_refused, "{spacing_mm} mm");
        }
        // A corner of a cube has edges, and no walls.
        let corner = TriangleMesh {
            vertices: vec![DVec3::ZERO, DVec3::X * 0.01, DVec3::Y * 0.01, DVec3::Z * 0.01],
            triangles: vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
        };
        let share = Walls::new(&corner, 1.1 * MM).unwrap().lost_share(10.0 / 19.0 * MM);
        assert!(share < LOST_SHARE, "{share}");
    }

    #[test]
    fn fins_on_a_block_lose_what_they_hold() {
        // A cube of 20 mm and fins of 0.5 mm on it, 19 mm of which stand out: 190 mm³ each.
        let lost = |n: u32| {
            let mut all = plate([20.0; 3], DQuat::IDENTITY);
            for fin in 0..n {
                let first = all.vertices.len() as u32;
                let part = plate([0.5, 20.0, 20.0], DQuat::IDENTITY);
                let by = DVec3::new(f64::from(fin) * 4.0 - 4.0, 0.0, 19.0) * MM;
                all.vertices.extend(part.vertices.iter().map(|at| *at + by));
                let corners = part.triangles.iter().map(|corners| corners.map(|at| at + first));
                all.triangles.extend(corners);
            }
            let border = MeshSolid::new(FileMesh::from(all), None).border;
            Walls::new(&border, 2.1 * MM).unwrap().lost_share(MM)
        };
        assert_eq!(lost(0), 0.0);
        for n in 1..4 {
            let fins_mm3 = 190.0 * f64::from(n);
            let share = lost(n) * (8000.0 + fins_mm3) / fins_mm3;
            assert!((share - 1.0).abs() < 0.1, "{n}: {share}");
        }
    }

    #[test]
    fn a_plate_keeps_its_volume_in_any_attitude_or_is_refused() {
        let dir = tempfile::tempdir().unwrap();
        for (n, wall_mm) in [0.5, 1.0, 2.0].into_iter().enumerate() {
            for (k, [mass_points, samples]) in
                [[1.75, 3.0], [3.0, 1.75], [1.83, 1.83], [3.0, 1.83], [1.83, 3.0]]
                    .iter()
                    .enumerate()
            {
                let turn = attitude((5 * n + k) as u32);
                let mesh = plate([16.0 * wall_mm, 12.0 * wall_mm, wall_mm], turn);
                let solid = opened(dir.path(), &mesh, wall_mm / samples);
                let phase = (k as f64 * 0.618_034).fract();
                let settings = settings(&mesh, wall_mm / mass_points, phase);
                let checked = solid.check_walls(&settings);
                if mass_points.min(*samples) < 1.8 {
                    let Err(ClayModelError::ThinWalls { wall_m, apart_m, needed, .. }) = checked
                    else {
                        panic!("{mass_points} {samples}: {checked:?}")
                    };
                    assert!((wall_m / MM / wall_mm - 1.0).abs() < 1e-9, "{wall_m}");
                    let fine = Settings { raster: needed, ..settings };
                    let dense = opened(dir.path(), &mesh, apart_m / MM);
                    assert!(dense.check_walls(&fine).is_ok(), "{needed:?}");
                    continue;
                }
                checked.unwrap();
                let points = solid.load().unwrap().points;
                let volume_m3 = ClayModel::new(points, settings).unwrap().volume_m3().unwrap();
                let kept = volume_m3 / (192.0 * (wall_mm * MM).powi(3));
                assert!(
                    (kept - 1.0).abs() < LOST_SHARE,
                    "{wall_mm} {mass_points} {samples}: {kept}"
                );
            }
        }
    }
}
