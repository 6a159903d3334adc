//! What a baked part tells apart, measured on its triangles.
//!
//! Data in: a map, the field and the shell that were made of it. Data out: an [`Accuracy`]. Metres,
//! mesh frame. The field is held against distances that are measured anew, in `f64`, by a search
//! over the triangles that shares nothing with the one that baked it but the closest point of one
//! triangle; the side against winding numbers, where the file is a solid.
//!
//! Invariant: cold; the same figures for any number of threads. Cost: O(n log n) for a tree over n
//! triangles, O(log n) per place, and a pass over corners and points per direction.

use std::borrow::Cow;

use glam::{DVec3, Vec3};

use super::border::{Border, OPPOSITE_COSINE};
use super::field::{DEEP_INSIDE, Field, FieldKind};
use super::grid::BRICK_EDGE;
use super::winding::WindingTree;
use super::{ThinPlace, Volume};
use crate::mesh::TriangleMesh;
use crate::mesh::edges::edge_uses;
use crate::mesh::weld::weld_within;
use crate::parallel;
use crate::pointshell::shell::Shell;

/// Places of the field and of the surface that a bake measures again.
const PLACES: usize = 1000;
/// Directions in which the part is held against a flat face.
const DIRECTIONS: usize = 128;
/// The golden ratio less one, and its like for two dimensions (Roberts 2018): multiples of it
/// spread evenly over 0 … 1.
const GOLDEN: f64 = 0.618_033_988_749_895;
const PLASTIC: [f64; 2] = [0.754_877_666_246_693, 0.569_840_290_998_053];

/// What a baked part tells apart. See the module page.
///
/// # Examples
/// ```
/// # use vps::{Mesh, Options, Shape, Voxmap};
/// # let plane = Shape::Plane { x_m: 20e-3, y_m: 20e-3, thickness_m: 4e-3 };
/// # let plate = Mesh::from_shape(&plane, 1e-5)?;
/// let accuracy = *Voxmap::bake(&plate, &Options::new(1e-3))?.accuracy(); // a plate of 4 mm
/// assert!((accuracy.thinnest_wall_m.unwrap() - 4e-3).abs() < 0.1e-3);
/// assert!((accuracy.sharpest_edge_deg.unwrap() - 90.0).abs() < 0.1);
/// assert_eq!(accuracy.unseen_depth_m, None, "a voxmap has no points");
/// # Ok::<(), vps::Error>(())
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Accuracy {
    /// Largest error of the samples of the field that were measured again, m; `None` without a
    /// field.
    pub sample_error_m: Option<f64>,
    /// Largest error of the field on the surface of the part, m: what interpolation between samples
    /// rounds off at edges.
    pub surface_error_m: Option<f64>,
    /// How deep the part may enter a flat face before one of its points touches, m; `None` without
    /// points.
    pub unseen_depth_m: Option<f64>,
    /// Thinnest wall found, m; `None` of a skin.
    pub thinnest_wall_m: Option<f64>,
    /// Smallest angle of material between two faces, degrees, below 180; `None` without an edge
    /// that stands out.
    pub sharpest_edge_deg: Option<f64>,
}

/// A sample of a field that was measured again.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FieldError {
    /// Samples that were measured.
    pub samples: usize,
    /// Largest error, m.
    pub error_m: f64,
    /// Where, mesh frame, m.
    pub position_m: DVec3,
}

impl Accuracy {
    /// Measures at some thousand places. `shell` has points about this centre of mass, mesh frame.
    pub(crate) fn of(
        truth: &Truth<'_>,
        field: Option<&Field>,
        shell: Option<(&Shell, DVec3)>,
    ) -> Self {
        let Member { map, border, .. } = &truth.first;
        let surface = &border.mesh;
        let places = places_on(surface, PLACES);
        let on_surface = |field: &Field| {
            let errors = parallel::map(places.len(), 16, |idx| {
                let place_m = places[idx].0;
                let voxel_size_m = f64::from(field.voxel_size_m());
                let cells = (place_m - field.origin_map().as_dvec3()) / voxel_size_m;
                let value_m = field.value(FieldKind::Trilinear, cells.as_vec3(), Vec3::ZERO);
                truth.error_m(place_m, value_m.into(), field, None)
            });
            errors.into_iter().fold(0.0, f64::max)
        };
        Self {
            sample_error_m: field.map(|field| truth.worst(field, PLACES).error_m),
            surface_error_m: field.map(on_surface),
            unseen_depth_m: shell.and_then(|(shell, center)| unseen_m(surface, shell, center)),
            thinnest_wall_m: truth.thinnest_wall_m(&places),
            sharpest_edge_deg: if map.thin { None } else { sharpest_edge_deg(surface) },
        }
    }
}

impl Accuracy {
    /// What the border of a solid shows without a bake: its thinnest wall and its sharpest edge.
    pub(crate) fn of_border(mesh: &TriangleMesh) -> Self {
        let border = Border::of_triangles(Cow::Borrowed(mesh));
        Self {
            thinnest_wall_m: thinnest_wall_m(&border, &places_on(mesh, PLACES)),
            sharpest_edge_deg: sharpest_edge_deg(mesh),
            ..Self::default()
        }
    }

    /// Names of [`Self::figures`].
    pub const NAMES: [&'static str; 5] = [
        "sample_error_m",
        "surface_error_m",
        "unseen_depth_m",
        "thinnest_wall_m",
        "sharpest_edge_deg",
    ];

    /// All figures, in the order of the struct.
    ///
    /// # Examples
    /// ```
    /// # use vps::Accuracy;
    /// let accuracy = Accuracy { surface_error_m: Some(1e-5), ..Accuracy::default() };
    /// let mut figures = Accuracy::NAMES.into_iter().zip(accuracy.figures());
    /// assert_eq!(figures.nth(1), Some(("surface_error_m", Some(1e-5))));
    /// ```
    pub fn figures(&self) -> [Option<f64>; 5] {
        let Self {
            sample_error_m,
            surface_error_m,
            unseen_depth_m,
            thinnest_wall_m,
            sharpest_edge_deg,
        } = *self;
        [sample_error_m, surface_error_m, unseen_depth_m, thinnest_wall_m, sharpest_edge_deg]
    }

    /// From the figures of a file, where none is NaN.
    pub(crate) fn of_figures(figures: [f64; 5]) -> Self {
        let known = figures.map(|figure| figure.is_finite().then_some(figure));
        let [sample_error_m, surface_error_m, unseen_depth_m, thinnest_wall_m, sharpest_edge_deg] =
            known;
        Self { sample_error_m, surface_error_m, unseen_depth_m, thinnest_wall_m, sharpest_edge_deg }
    }
}

impl Volume {
    /// Measures so many samples of the field that was made of this map again, evenly spread, with
    /// their sides where the file is a solid; all of them if there are no more. `mesh` is the one
    /// that the map was built of.
    pub fn verify(&self, mesh: &TriangleMesh, field: &Field, n_samples: usize) -> FieldError {
        Truth::with_sides(self, mesh).worst(field, n_samples)
    }
}

/// What a field should say.
pub(crate) struct Truth<'a> {
    first: Member<'a>,
    /// What is beside the solid.
    beside: Vec<Member<'a>>,
    /// Winding numbers of the first member, which is the border of a solid.
    winding: Option<WindingTree>,
}

/// Triangles that are one solid or one skin.
struct Member<'a> {
    map: &'a Volume,
    border: Border<'a>,
    /// A two-sided skin, which is felt so much earlier, m.
    skin_m: Option<f64>,
}

impl<'a> Truth<'a> {
    /// Of a map and the mesh that it was built of.
    pub(crate) fn of(map: &'a Volume, mesh: &'a TriangleMesh) -> Self {
        let member = |map: &'a Volume| Member {
            map,
            border: Border::of(map, mesh),
            skin_m: map.thin.then_some(map.surface.grid.voxel_size_m),
        };
        let beside = map.beside.iter().map(|beside| member(&beside.map)).collect();
        Self { first: member(map), beside, winding: None }
    }

    /// The same with the sides that are known.
    fn with_sides(map: &'a Volume, mesh: &'a TriangleMesh) -> Self {
        // Beside a lid the side is a guess, and of triangles that are taken as they are the fill
        // says it.
        let is_solid = map.solid.as_ref().is_some_and(|solid| solid.bodies > 0);
        let winding = is_solid.then(|| WindingTree::new(map.mesh(mesh)));
        Self { winding, ..Self::of(map, mesh) }
    }

    fn members(&self) -> impl Iterator<Item = &Member<'a>> {
        std::iter::once(&self.first).chain(&self.beside)
    }

    /// What the voxels do not resolve.
    pub(crate) fn thin_places(&self) -> Vec<ThinPlace> {
        ThinPlace::of(self.members().map(|member| (member.map, &member.border)))
    }

    /// How far a value of the field at a place is from the true one, m; with the side of the first
    /// member, where it is known.
    fn error_m(&self, place_m: DVec3, value_m: f64, field: &Field, inside: Option<bool>) -> f64 {
        let [least_m, most_m] = field.range_m().map(f64::from);
        let clamped = |value_m: f64| value_m.max(least_m).min(most_m);
        let farthest_m = 2.0 * most_m - least_m;
        // What the union may be: where a side is not known, either.
        let mut values_m = vec![f64::NEG_INFINITY];
        // Of what lies beside the solid none is.
        let sides = std::iter::once(inside).chain(std::iter::repeat(None));
        for (member, inside) in self.members().zip(sides) {
            let distance_m = member.border.distance_m(place_m, farthest_m);
            let own = match (member.skin_m, inside) {
                (Some(skin_m), _) => vec![skin_m - distance_m],
                (None, Some(true)) => vec![distance_m],
                (None, Some(false)) => vec![-distance_m],
                (None, None) => vec![distance_m, -distance_m],
            };
            let both = values_m
                .iter()
                .flat_map(|value_m| own.iter().map(move |own_m| value_m.max(*own_m)));
            values_m = both.collect();
            values_m.dedup();
        }
        let errors = values_m.into_iter().map(|true_m| (clamped(true_m) - clamped(value_m)).abs());
        errors.fold(f64::INFINITY, f64::min)
    }

    /// The worst of so many samples.
    fn worst(&self, field: &Field, n_samples: usize) -> FieldError {
        let [_, ny, nz] = field.brick_dims();
        let bricks: Vec<(usize, u32)> = (0..)
            .zip(field.top())
            .filter(|(_, slot)| **slot < DEEP_INSIDE)
            .map(|(brick, slot)| (brick, *slot))
            .collect();
        let n_cells = bricks.len() * BRICK_EDGE.pow(3);
        let n_samples = n_samples.min(n_cells);
        let voxel_size_m = f64::from(field.voxel_size_m());
        let sample = |idx: usize| {
            // Every so many cells, so that none comes twice.
            let cell = (idx as u128 * n_cells as u128 / n_samples as u128) as usize;
            let (brick, slot) = bricks[cell / BRICK_EDGE.pow(3)];
            let coord = [brick / (ny * nz), brick / nz % ny, brick % nz];
            let inside = cell % BRICK_EDGE.pow(3);
            let own = [inside >> 6, inside >> 3 & 7, inside & 7];
            let cells: [f64; 3] =
                core::array::from_fn(|axis| (BRICK_EDGE * coord[axis] + own[axis]) as f64 + 0.5);
            let place_m = field.origin_map().as_dvec3() + voxel_size_m * DVec3::from_array(cells);
            (place_m, f64::from(field.sample(slot as usize, inside) + field.skin_m()))
        };
        let samples: Vec<(DVec3, f64)> = parallel::map(n_samples, 256, sample);
        let sides = self.winding.as_ref().map(|winding| {
            let places: Vec<DVec3> = samples.iter().map(|(place_m, _)| *place_m).collect();
            winding.at(&places)
        });
        let errors = parallel::map(n_samples, 16, |idx| {
            let (place_m, value_m) = samples[idx];
            let inside = sides.as_ref().map(|sides| sides[idx] > 0.5);
            self.error_m(place_m, value_m, field, inside)
        });
        let worst = errors.iter().zip(&samples).max_by(|(a, _), (b, _)| a.total_cmp(b));
        let (error_m, position_m) =
            worst.map_or((0.0, DVec3::ZERO), |(error_m, (place_m, _))| (*error_m, *place_m));
        FieldError { samples: n_samples, error_m, position_m }
    }

    /// That of the solid; `None` of a skin.
    fn thinnest_wall_m(&self, places: &[(DVec3, DVec3)]) -> Option<f64> {
        let Member { border, skin_m, .. } = &self.first;
        skin_m.is_none().then(|| thinnest_wall_m(border, places)).flatten()
    }
}

/// The shortest way through a solid, from some places of its surface against their normals to where
/// it ends at a face that looks the other way, m.
fn thinnest_wall_m(border: &Border<'_>, places: &[(DVec3, DVec3)]) -> Option<f64> {
    let exits = parallel::map(places.len(), 16, |idx| {
        border.exit(places[idx].0, -places[idx].1, f64::INFINITY)
    });
    let opposite = exits.into_iter().flatten().filter(|exit| exit.cosine > OPPOSITE_COSINE);
    opposite.map(|exit| exit.at_m).min_by(f64::total_cmp)
}

/// Places of the surface and its normals there, evenly spread by area.
fn places_on(mesh: &TriangleMesh, n_places: usize) -> Vec<(DVec3, DVec3)> {
    let normals: Vec<DVec3> = (0..mesh.triangles.len())
        .map(|triangle| {
            let [a, b, c] = mesh.corners(triangle);
            (b - a).cross(c - a)
        })
        .collect();
    let whole = normals.iter().fold(0.0, |sum, normal| sum + normal.length());
    let mut places = Vec::with_capacity(n_places);
    let mut area = 0.0;
    for (triangle, normal) in normals.iter().enumerate() {
        let [a, b, c] = mesh.corners(triangle);
        area += normal.length();
        while ((places.len() as f64 + 0.5) * whole) < area * n_places as f64 {
            let [s, t] = PLASTIC.map(|step| (places.len() as f64 * step).fract());
            let [s, t] = if s + t > 1.0 { [1.0 - s, 1.0 - t] } else { [s, t] };
            places.push((a + s * (b - a) + t * (c - a), normal.normalize_or_zero()));
        }
    }
    places
}

/// How much farther the corners of a surface reach than the points on it, in the worst of some
/// directions, m.
fn unseen_m(mesh: &TriangleMesh, shell: &Shell, center_m: DVec3) -> Option<f64> {
    let points: Vec<DVec3> = shell.points().map(|(point, _)| point.as_dvec3() + center_m).collect();
    if points.is_empty() {
        return None;
    }
    let ways: [DVec3; DIRECTIONS] = core::array::from_fn(|idx| {
        let up = 1.0 - 2.0 * (idx as f64 + 0.5) / DIRECTIONS as f64;
        let (sin, cos) = (core::f64::consts::TAU * GOLDEN * idx as f64).sin_cos();
        let level = (1.0 - up * up).sqrt();
        DVec3::new(level * cos, level * sin, up)
    });
    let of_mesh_m = reaches_m(&mesh.vertices, &ways);
    let of_points_m = reaches_m(&points, &ways);
    let unseen_m = of_mesh_m.iter().zip(&of_points_m).map(|(of_mesh, of_point)| of_mesh - of_point);
    unseen_m.max_by(f64::total_cmp).map(|unseen_m| unseen_m.max(0.0))
}

/// How far places reach in each direction, m.
fn reaches_m(places: &[DVec3], ways: &[DVec3; DIRECTIONS]) -> [f64; DIRECTIONS] {
    const NONE: [f64; DIRECTIONS] = [f64::NEG_INFINITY; DIRECTIONS];
    let [x, y, z] = [0, 1, 2].map(|axis| ways.map(|way| way[axis]));
    let farther = |mut reaches: [f64; DIRECTIONS], others: &[f64; DIRECTIONS]| {
        for (reach, other) in reaches.iter_mut().zip(others) {
            *reach = if *other > *reach { *other } else { *reach };
        }
        reaches
    };
    // Directions in the inner loop: it has no chain of maxima, and takes less than half the time.
    let of_chunks = parallel::map_chunks(places, 4096, |places| {
        let mut reaches = NONE;
        for place in places {
            for (((reach, x), y), z) in reaches.iter_mut().zip(&x).zip(&y).zip(&z) {
                let along = x * place.x + y * place.y + z * place.z;
                *reach = if along > *reach { along } else { *reach };
            }
        }
        reaches
    });
    of_chunks.iter().fold(NONE, farther)
}

/// The smallest angle of material at an edge that stands out, degrees.
fn sharpest_edge_deg(mesh: &TriangleMesh) -> Option<f64> {
    let same = weld_within(&mesh.vertices, 0.0);
    let triangles: Vec<[u32; 3]> =
        mesh.triangles.iter().map(|corners| corners.map(|corner| same[corner as usize])).collect();
    let normals: Vec<DVec3> = parallel::map(triangles.len(), 1024, |triangle| {
        let [a, b, c] = mesh.corners(triangle);
        (b - a).cross(c - a).normalize_or_zero()
    });
    let sharp = edge_uses(&triangles, mesh.vertices.len()).pairs.into_iter().filter_map(|pair| {
        let [n, m] = pair.triangles.map(|triangle| normals[triangle as usize]);
        let on_edge = mesh.vertices[pair.edge[0] as usize];
        let [a, b, c] = mesh.corners(pair.triangles[1] as usize);
        let stands_out = n.dot(a + b + c - 3.0 * on_edge) < 0.0;
        let is_edge = !pair.same_direction && n != DVec3::ZERO && m != DVec3::ZERO;
        (is_edge && stands_out).then(|| n.dot(m))
    });
    sharp.min_by(f64::total_cmp).map(|cosine| 180.0 - cosine.clamp(-1.0, 1.0).acos().to_degrees())
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::mesh::primitives::Shape;
    use crate::mesh::validate::inspect;
    use crate::pointshell;
    use crate::spatial::testing::Random;
    use crate::voxmap::Options;
    use crate::voxmap::distance::sample_of;
    use glam::DQuat;

    const VOXEL_M: f64 = 5e-4;

    pub(in crate::voxmap) fn block(size_mm: [f64; 3]) -> TriangleMesh {
        Shape::Box { size_m: DVec3::from_array(size_mm) * 1e-3 }.tessellate(1.0)
    }

    /// Both, the second one behind the first.
    pub(in crate::voxmap) fn with(mut mesh: TriangleMesh, other: TriangleMesh) -> TriangleMesh {
        let first = mesh.vertices.len() as u32;
        mesh.vertices.extend(other.vertices);
        mesh.triangles.extend(other.triangles.iter().map(|corners| corners.map(|at| at + first)));
        mesh
    }

    fn baked(mesh: &TriangleMesh) -> (Volume, Field) {
        let options = Options { layers: 6, ..Options::new(VOXEL_M) };
        let mut map = Volume::build(mesh, &inspect(mesh), &options, |_| ()).expect("a small grid");
        let field = map.field(mesh, false);
        (map, field)
    }

    fn measured(mesh: &TriangleMesh) -> Accuracy {
        let (map, field) = baked(mesh);
        let center_m = DVec3::splat(1e-3);
        let shell = pointshell::build(mesh, &map, center_m).0;
        Accuracy::of(&Truth::of(&map, mesh), Some(&field), Some((&shell, center_m)))
    }

    #[test]
    fn a_block_in_any_attitude_has_right_edges_and_its_least_side_as_wall() {
        let mut random = Random(3);
        for _ in 0..6 {
            let mut mesh = block([14.0, 10.0, 6.0]);
            let turn = DQuat::from_scaled_axis(random.in_box(-2.0, 2.0));
            mesh.vertices.iter_mut().for_each(|at| *at = turn * *at);
            let card = measured(&mesh);
            assert!(card.sample_error_m.expect("a field") < 1e-4 * VOXEL_M, "{card:?}");
            let wall_m = card.thinnest_wall_m.expect("a body");
            assert!((wall_m - 6e-3).abs() < 1e-9, "{card:?}");
            assert!((card.sharpest_edge_deg.expect("edges") - 90.0).abs() < 1e-6, "{card:?}");
            // A right edge is rounded off by less than half a voxel, and not by nothing.
            let surface = card.surface_error_m.expect("a field") / VOXEL_M;
            assert!((0.02..0.5).contains(&surface), "{card:?}");
            // The points of a corner lie on its three facets in its voxel.
            let unseen = card.unseen_depth_m.expect("points") / VOXEL_M;
            assert!((0.05..1.0).contains(&unseen), "{card:?}");
        }
    }

    #[test]
    fn a_wrong_sample_is_found_with_its_place_and_so_is_a_wrong_side() {
        let mesh = block([14.0, 10.0, 6.0]);
        let (map, field) = baked(&mesh);
        let n_samples = field.n_bricks() * BRICK_EDGE.pow(3);
        let sound = map.verify(&mesh, &field, usize::MAX);
        assert_eq!(sound.samples, n_samples);
        assert!(sound.error_m < 1e-4 * VOXEL_M, "{sound:?}");
        let near = |value_m: f32| (f64::from(value_m) / VOXEL_M + 2.5).abs() < 0.4;
        for change in [|value_m: f32| value_m - 4e-4, |value_m: f32| -value_m] {
            let mut samples = field.samples_m().to_vec();
            let slot = samples.len() / 2;
            let inside = (0..BRICK_EDGE.pow(3))
                .find(|inside| near(samples[slot][sample_of(*inside)]))
                .expect("a sample there");
            let value_m = &mut samples[slot][sample_of(inside)];
            let was_m = *value_m;
            *value_m = change(was_m);
            let by_m = f64::from((*value_m - was_m).abs());
            let wrong = field.clone().with_samples(samples);
            let found = map.verify(&mesh, &wrong, usize::MAX);
            assert!((found.error_m - by_m).abs() < 1e-6 * VOXEL_M, "{found:?} for {by_m}");
            let far_m = (found.position_m.abs() - DVec3::new(7e-3, 5e-3, 3e-3)).max(DVec3::ZERO);
            assert!((far_m.length() + f64::from(was_m)).abs() < 1e-6, "{found:?}");
        }
    }

    #[test]
    fn a_hollow_box_has_its_wall_and_a_skin_beside_a_body_is_where_it_should_be() {
        let mut inner = block([12.0, 8.0, 4.5]);
        inner.triangles.iter_mut().for_each(|corners| corners.swap(0, 1));
        let hollow = measured(&with(block([14.0, 10.0, 6.0]), inner));
        let wall_m = hollow.thinnest_wall_m.expect("a body");
        assert!((wall_m - 0.75e-3).abs() < 1e-9, "{hollow:?}");
        let sheet = TriangleMesh {
            vertices: [[9.0, -3.0, 0.0], [15.0, -3.0, 0.0], [9.0, 3.0, 2.0]]
                .map(|at| DVec3::from_array(at) * 1e-3)
                .to_vec(),
            triangles: vec![[0, 1, 2]],
        };
        for mesh in [with(block([14.0, 10.0, 6.0]), sheet.clone()), sheet] {
            let (map, field) = baked(&mesh);
            let found = map.verify(&mesh, &field, usize::MAX);
            assert!(found.error_m < 1e-4 * VOXEL_M, "{found:?}");
        }
    }

    #[test]
    fn a_wedge_has_its_angle() {
        for angle_deg in [15.0_f64, 40.0, 75.0] {
            let (sin, cos) = angle_deg.to_radians().sin_cos();
            let corner = |y: f64| {
                [DVec3::Y * y, DVec3::new(0.02, y, 0.0), DVec3::new(0.02 * cos, y, 0.02 * sin)]
            };
            let wedge = TriangleMesh {
                vertices: [corner(0.0), corner(0.01)].concat(),
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
            let found_deg = sharpest_edge_deg(&wedge).expect("edges");
            // Its sides are as long as each other, so its other two edges have the same angle.
            let least_deg = angle_deg.min(0.5 * (180.0 - angle_deg));
            assert!((found_deg - least_deg).abs() < 1e-9, "{found_deg} for {angle_deg}");
        }
    }

    /// As CAD programs write what was cut face by face: corners on an edge of a face that the face
    /// beside it does not have.
    #[test]
    fn corners_on_an_edge_of_another_face_change_no_side() {
        let mut random = Random(9);
        for n in 0..12 {
            let mut mesh = block([14.0, 10.0, 6.0]);
            // Without its upper face, which becomes a fan.
            let is_upper = |mesh: &TriangleMesh, triangle: usize| {
                mesh.corners(triangle).iter().all(|at| at.z > 2.9e-3)
            };
            let kept = (0..mesh.triangles.len()).filter(|triangle| !is_upper(&mesh, *triangle));
            let mut triangles: Vec<[u32; 3]> =
                kept.map(|triangle| mesh.triangles[triangle]).collect();
            let around = [[-7.0, -5.0], [7.0, -5.0], [7.0, 5.0], [-7.0, 5.0]];
            let mut rim = Vec::new();
            for side in 0..4 {
                let from = around[side];
                let to = around[(side + 1) % 4];
                let mut shares: Vec<f64> = (0..4).map(|_| random.unit()).collect();
                shares[0] = 0.0;
                shares.sort_by(f64::total_cmp);
                rim.extend(shares.into_iter().map(|share| {
                    let at = |axis: usize| from[axis] + share * (to[axis] - from[axis]);
                    DVec3::new(at(0), at(1), 3.0)
                }));
            }
            let first = mesh.vertices.len() as u32;
            let n_rim = rim.len() as u32;
            mesh.vertices.extend(rim);
            mesh.vertices[first as usize..].iter_mut().for_each(|at| *at *= 1e-3);
            mesh.vertices.push(DVec3::new(1e-3, 0.5e-3, 3e-3));
            triangles
                .extend((0..n_rim).map(|k| [first + k, first + (k + 1) % n_rim, first + n_rim]));
            mesh.triangles = triangles;
            // In the second half, the six digits of a text file, askew.
            let turn = DQuat::from_scaled_axis(random.in_box(-2.0, 2.0));
            // Voxel centres in the plane of a face, and at random.
            let shift = random.in_box(-1e-3, 1e-3);
            for at in &mut mesh.vertices {
                if n >= 6 {
                    *at = ((turn * *at + shift) * 1e6).round() * 1e-6;
                } else {
                    *at += DVec3::Z * shift.z;
                }
            }
            let (map, field) = baked(&mesh);
            let found = map.verify(&mesh, &field, usize::MAX);
            assert!(
                found.error_m < 1e-4 * VOXEL_M,
                "{n}: {:.3} {found:?}",
                found.error_m / VOXEL_M
            );
        }
    }
}
