//! Meshes for display, decimated.

use std::collections::{HashMap, HashSet};

use glam::DVec3;

use super::compressed::Compressed;
use crate::config::SceneConfig;
use crate::config::scene::MeshSource;
use vps::mesh::{self, TriangleMesh};

/// Triangles of one object on a page.
const MOST_TRIANGLES: usize = 100_000;
/// By how much cells grow until few enough triangles are left.
const GROWTH: f64 = 1.2;
/// How finely round shapes are cut, voxels.
const CHORD_VOXELS: f64 = 0.25;

/// What a page draws of one object.
#[derive(Debug)]
pub(super) struct Visual {
    /// `HMSH`, version, counts, positions (object's own frame, m), indices; little-endian.
    pub(super) file: Compressed,
    /// Of the object.
    pub(super) triangles: usize,
    /// In `file`.
    pub(super) shown_triangles: usize,
    /// Box of the object, m.
    pub(super) bounds: Option<[DVec3; 2]>,
}

/// Object `object_idx` of a scene: the static ones in order, then the tool. `None`: there is no
/// such object, or its mesh is gone.
pub(super) fn make(config: &SceneConfig, object_idx: usize) -> Option<Visual> {
    let (source, voxel_size_m) = match config.statics.get(object_idx) {
        Some(object) => (&object.source, object.voxel_size_m),
        None if object_idx == config.statics.len() => {
            (&config.tool.source, config.tool.voxel_size_m)
        }
        None => return None,
    };
    let mesh = match source {
        MeshSource::File { path, metres_per_unit } => mesh::load(path, *metres_per_unit).ok()?,
        MeshSource::Shape(shape) => shape.tessellate(CHORD_VOXELS * voxel_size_m),
    };
    Some(visual(&mesh, MOST_TRIANGLES))
}

fn visual(mesh: &TriangleMesh, most: usize) -> Visual {
    let bounds = mesh.vertices.iter().fold(None, |bounds: Option<[DVec3; 2]>, vertex| {
        Some(bounds.map_or([*vertex; 2], |[low, high]| [low.min(*vertex), high.max(*vertex)]))
    });
    let (vertices, triangles) = decimated(mesh, most);
    let mut bytes = Vec::with_capacity(16 + 12 * (vertices.len() + triangles.len()));
    bytes.extend(b"HMSH");
    for number in [1, vertices.len() as u32, 3 * triangles.len() as u32] {
        bytes.extend(number.to_le_bytes());
    }
    for coordinate in vertices.iter().flatten() {
        bytes.extend(coordinate.to_le_bytes());
    }
    for vertex in triangles.iter().flatten() {
        bytes.extend(vertex.to_le_bytes());
    }
    Visual {
        file: Compressed::new(bytes.into()),
        triangles: mesh.triangles.len(),
        shown_triangles: triangles.len(),
        bounds,
    }
}

/// At most `most` triangles that look like the mesh: vertices that share a cell become one, in the
/// middle of them.
fn decimated(mesh: &TriangleMesh, most: usize) -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
    if mesh.triangles.len() <= most {
        return (
            mesh.vertices.iter().map(|vertex| vertex.as_vec3().to_array()).collect(),
            mesh.triangles.clone(),
        );
    }
    let area_m2: f64 = (0..mesh.triangles.len())
        .map(|n| {
            let [a, b, c] = mesh.corners(n);
            0.5 * (b - a).cross(c - a).length()
        })
        .sum();
    // Two triangles to a cell of a flat surface.
    let mut cell_m = (2.0 * area_m2 / most as f64).sqrt();
    loop {
        let (vertices, triangles) = clustered(mesh, cell_m);
        if triangles.len() <= most || !cell_m.is_normal() {
            return (vertices, triangles);
        }
        cell_m *= GROWTH;
    }
}

fn clustered(mesh: &TriangleMesh, cell_m: f64) -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
    let mut cells: HashMap<[i64; 3], u32> = HashMap::new();
    let mut sums: Vec<(DVec3, u32)> = Vec::new();
    let cell_of: Vec<u32> = mesh
        .vertices
        .iter()
        .map(|vertex| {
            let key = (*vertex / cell_m).floor().to_array().map(|coordinate| coordinate as i64);
            let cell = *cells.entry(key).or_insert(sums.len() as u32);
            match sums.get_mut(cell as usize) {
                Some((sum, n)) => (*sum, *n) = (*sum + *vertex, *n + 1),
                None => sums.push((*vertex, 1)),
            }
            cell
        })
        .collect();
    let mut seen = HashSet::new();
    let mut triangles = Vec::new();
    for triangle in &mesh.triangles {
        let corners = triangle.map(|vertex| cell_of[vertex as usize]);
        let mut sorted = corners;
        sorted.sort_unstable();
        let [a, b, c] = sorted;
        if a != b && b != c && seen.insert(sorted) {
            triangles.push(corners);
        }
    }
    (
        sums.into_iter().map(|(sum, n)| (sum / f64::from(n)).as_vec3().to_array()).collect(),
        triangles,
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use vps::mesh::primitives::Shape;

    #[test]
    fn a_fine_sphere_becomes_a_coarse_one_of_the_same_size() {
        let mesh = Shape::Sphere { radius_m: 0.05 }.tessellate(1e-7);
        assert!(mesh.triangles.len() > 100_000, "{}", mesh.triangles.len());
        let shown = visual(&mesh, 5000);
        assert_eq!(shown.triangles, mesh.triangles.len());
        assert!((1000..=5000).contains(&shown.shown_triangles), "{}", shown.shown_triangles);
        let [low, high] = shown.bounds.expect("a box");
        assert!((high - low - DVec3::splat(0.1)).abs().max_element() < 1e-4);
        let word =
            |at: usize| u32::from_le_bytes(shown.file.plain[at..at + 4].try_into().expect("four"));
        let n_vertices = word(8) as usize;
        let n_indices = word(12) as usize;
        assert_eq!(
            (&shown.file.plain[..4], word(4), n_indices),
            (&b"HMSH"[..], 1, 3 * shown.shown_triangles)
        );
        assert_eq!(shown.file.plain.len(), 16 + 12 * n_vertices + 4 * n_indices);
        for at in (16..16 + 12 * n_vertices).step_by(12) {
            let radius_m = [0, 4, 8]
                .map(|axis| f64::from(f32::from_bits(word(at + axis))).powi(2))
                .iter()
                .sum::<f64>()
                .sqrt();
            assert!((radius_m - 0.05).abs() < 2e-3, "{radius_m}");
        }
        assert!(
            (16 + 12 * n_vertices..shown.file.plain.len())
                .step_by(4)
                .all(|at| (word(at) as usize) < n_vertices)
        );
    }

    #[test]
    fn what_is_small_stays_as_it_is() {
        let mesh = Shape::Box { size_m: DVec3::ONE }.tessellate(0.0);
        let shown = visual(&mesh, MOST_TRIANGLES);
        assert_eq!(
            (shown.triangles, shown.shown_triangles),
            (mesh.triangles.len(), mesh.triangles.len())
        );
    }
}
