//! Fields of real meshes beside exact distances: how far V is from what it stands for.

use std::path::Path;

use glam::DVec3;

use super::super::Row;
use super::super::random::Random;
use super::super::statistics::Spread;
use super::{Options, fixture};
use vps::mesh::closest_point::TriangleProjector;
use vps::mesh::primitives::Shape;
use vps::mesh::{self, TriangleMesh};
use vps::voxmap::field::FieldKind;

/// Errors of one field on one mesh.
#[derive(Clone, Copy, Debug)]
pub struct FieldErrors {
    /// The field.
    pub field: FieldKind,
    /// | |V| − distance |, voxels.
    pub voxels: Spread,
}

/// Real meshes that are compared, with metres per unit.
const MODELS: [(&str, f64); 4] = [
    ("rocker-arm.obj", 1.0),
    ("factory_round_peg_8mm_tight.obj", 1.0),
    ("factory_bolt_m16_tight.obj", 1.0),
    ("featuretype.STL", 0.0254),
];
/// Places near the surface at which a field is held against the mesh.
const PLACES: usize = 4000;
/// They are within so many voxels of it: deeper, a point is not in contact any more.
const WITHIN_VOXELS: f64 = 2.0;
/// As the teapot of Sagardia2019: 236 mm at 2 mm.
const VOXELS_ON_LONGEST_AXIS: f64 = 118.0;

/// Every field at `n_places` seeded places within two voxels of the surface. The exact distance is
/// a search over all triangles: cost O(places · triangles). The sign is left out, and with it a
/// field that takes one side for the other.
///
/// # Errors
/// A mesh that cannot be baked.
pub fn field_errors(
    what: &str,
    mesh: &TriangleMesh,
    voxel_size_m: f64,
    n_places: usize,
) -> Result<Vec<FieldErrors>, super::super::BenchError> {
    use rayon::prelude::*;
    let field = fixture::obstacle(what, mesh, voxel_size_m, true)?.field;
    let places = places_near(mesh, WITHIN_VOXELS * voxel_size_m, n_places);
    let projectors: Vec<TriangleProjector> =
        (0..mesh.triangles.len()).map(|idx| TriangleProjector::new(&mesh.corners(idx))).collect();
    let exact: Vec<(DVec3, DVec3, f64)> = places
        .into_par_iter()
        .map(|(place, normal)| {
            let nearest = projectors
                .iter()
                .map(|projector| projector.project(place).distance_squared)
                .fold(f64::INFINITY, f64::min);
            (place, normal, nearest.sqrt())
        })
        .collect();
    let origin = field.origin_map().as_dvec3();
    Ok(FieldKind::NAMES
        .iter()
        .map(|(_, kind)| {
            let errors = exact.iter().map(|(place, normal, distance_m)| {
                let cells = ((*place - origin) / voxel_size_m).as_vec3();
                (f64::from(field.value(*kind, cells, normal.as_vec3())).abs() - distance_m).abs()
                    / voxel_size_m
            });
            FieldErrors { field: *kind, voxels: Spread::of(errors).unwrap_or_default() }
        })
        .collect())
}

/// Seeded places beside the surface, even over its area, each with the triangle's outward normal:
/// what a point of a tool that touches there has as its inward one, and V_L reads.
fn places_near(mesh: &TriangleMesh, within_m: f64, n_places: usize) -> Vec<(DVec3, DVec3)> {
    let normal = |idx: usize| {
        let [a, b, c] = mesh.corners(idx);
        (b - a).cross(c - a)
    };
    let mut up_to_here = Vec::with_capacity(mesh.triangles.len());
    let mut area = 0.0;
    for idx in 0..mesh.triangles.len() {
        area += normal(idx).length();
        up_to_here.push(area);
    }
    let mut random = Random::new(2019);
    (0..n_places)
        .map(|_| {
            let drawn = random.within(0.0, area);
            let idx = up_to_here.partition_point(|sum| *sum <= drawn).min(mesh.triangles.len() - 1);
            let [a, b, c] = mesh.corners(idx);
            let mut u = random.unit();
            let mut v = random.unit();
            if u + v > 1.0 {
                (u, v) = (1.0 - u, 1.0 - v);
            }
            let outward = normal(idx).normalize_or_zero();
            let place =
                a + (b - a) * u + (c - a) * v + outward * random.within(-within_m, within_m);
            (place, outward)
        })
        .collect()
}

pub(super) fn rows(options: &Options, tell: &mut dyn FnMut(&str)) -> Vec<Row> {
    let n_places = if options.quick { PLACES / 8 } else { PLACES };
    let sphere = Shape::Sphere { radius_m: 0.02 }.tessellate(2e-5);
    let mut rows = compared("sphere of 40 voxels", &sphere, Some(1e-3), n_places, tell);
    let Some(folder) = options.models.as_ref().filter(|_| !options.quick) else {
        let why = if options.quick { "--quick" } else { "HAPTICD_MODELS not set" };
        rows.push(Row::new(GROUP, format!("real meshes: skipped: {why}"), None, "voxel"));
        return rows;
    };
    for (name, metres_per_unit) in MODELS {
        match read(&folder.join(name), metres_per_unit) {
            Ok(mesh) => rows.extend(compared(name, &mesh, None, n_places, tell)),
            Err(why) => {
                rows.push(Row::new(GROUP, format!("{name}: skipped: {why}"), None, "voxel"))
            }
        }
    }
    rows
}

const GROUP: &str = "fields beside exact distances, within two voxels of the surface";

fn read(path: &Path, metres_per_unit: f64) -> Result<TriangleMesh, String> {
    mesh::load(path, metres_per_unit).map_err(|error| error.to_string())
}

fn compared(
    name: &str,
    mesh: &TriangleMesh,
    voxel_size_m: Option<f64>,
    n_places: usize,
    tell: &mut dyn FnMut(&str),
) -> Vec<Row> {
    tell(&format!("{name}: fields beside exact distances"));
    let longest_m = mesh.bounds().map_or(1.0, |(low, high)| (high - low).max_element());
    let voxel_size_m = voxel_size_m.unwrap_or(longest_m / VOXELS_ON_LONGEST_AXIS);
    let errors = match field_errors(name, mesh, voxel_size_m, n_places) {
        Ok(errors) => errors,
        Err(error) => return vec![Row::new(GROUP, format!("{name}: {error}"), None, "voxel")],
    };
    let word = |kind: FieldKind| {
        FieldKind::NAMES.iter().find(|(_, named)| *named == kind).map_or("?", |(word, _)| word)
    };
    errors
        .into_iter()
        .flat_map(|FieldErrors { field, voxels }| {
            [("mean", voxels.mean), ("p99", voxels.p99), ("max", voxels.max)].map(
                |(what, value)| {
                    Row::new(
                        GROUP,
                        format!("{name}: {}: error, {what}", word(field)),
                        value,
                        "voxel",
                    )
                },
            )
        })
        .collect()
}
