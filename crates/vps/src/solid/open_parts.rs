//! Which open pieces belong together.

use super::Solid;

use crate::mesh::TriangleMesh;
use crate::mesh::boxes::Boxes;
use crate::mesh::validate::WELD_SHARE;
use crate::mesh::weld::weld_within;
use crate::sets::Sets;

impl Solid {
    /// The skins in groups: pieces whose boxes come within `gap_m` of each other may be faces of
    /// one part and are judged together. In the order of their first triangles. Cost: n log n in
    /// the triangles of the skins.
    pub fn open_parts(&self, gap_m: f64) -> Vec<TriangleMesh> {
        let skins = &self.skins;
        let (low, high) = skins.bounds().unwrap_or_default();
        let welded = weld_within(&skins.vertices, WELD_SHARE * low.distance(high));
        let mut sets = Sets::new(skins.vertices.len());
        for triangle in &skins.triangles {
            let [a, b, c] = triangle.map(|vertex| welded[vertex as usize]);
            sets.join(a, b);
            sets.join(b, c);
        }
        let mut numbers = vec![u32::MAX; skins.vertices.len()];
        let mut boxes = Vec::new();
        let pieces: Vec<u32> = skins
            .triangles
            .iter()
            .enumerate()
            .map(|(triangle_idx, corners)| {
                let number = &mut numbers[sets.lowest(welded[corners[0] as usize]) as usize];
                if *number == u32::MAX {
                    *number = boxes.len() as u32;
                    boxes.push((glam::DVec3::INFINITY, glam::DVec3::NEG_INFINITY));
                }
                let (low, high) = &mut boxes[*number as usize];
                for corner in skins.corners(triangle_idx) {
                    *low = low.min(corner);
                    *high = high.max(corner);
                }
                *number
            })
            .collect();
        let tree = Boxes::new(boxes.len(), |piece| boxes[piece]);
        let mut groups = Sets::new(boxes.len());
        for (piece, (low, high)) in (0..).zip(&boxes) {
            tree.meeting(*low - gap_m, *high + gap_m, |other| groups.join(piece, other));
        }
        let mut parts: Vec<Vec<[u32; 3]>> = Vec::new();
        let mut places = vec![usize::MAX; boxes.len()];
        for (triangle, piece) in skins.triangles.iter().zip(pieces) {
            let place = &mut places[groups.lowest(piece) as usize];
            if *place == usize::MAX {
                *place = parts.len();
                parts.push(Vec::new());
            }
            parts[*place].push(*triangle);
        }
        parts.into_iter().map(|triangles| only_used(skins, triangles)).collect()
    }
}

/// These triangles, and of the vertices those in use, in the order of their use.
fn only_used(mesh: &TriangleMesh, mut triangles: Vec<[u32; 3]>) -> TriangleMesh {
    let mut numbers = std::collections::HashMap::new();
    let mut vertices = Vec::new();
    for vertex in triangles.as_flattened_mut() {
        *vertex = *numbers.entry(*vertex).or_insert_with(|| {
            vertices.push(mesh.vertices[*vertex as usize]);
            vertices.len() as u32 - 1
        });
    }
    TriangleMesh { vertices, triangles }
}
