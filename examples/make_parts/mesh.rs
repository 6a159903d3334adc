//! Triangles over welded vertices, and the two file formats.

use std::collections::HashMap;
use std::fmt::Write as _;

use glam::DVec3;

/// Vertices live on a grid of this many steps per mm. Coordinates below 64 mm stay apart as `f32`,
/// so a reader of the STL files can weld them again.
pub(crate) const GRID_PER_MM: f64 = 1e5;

/// A mesh under construction, millimetres.
#[derive(Default)]
pub(crate) struct Mesh {
    pub(crate) vertices: Vec<DVec3>,
    pub(crate) triangles: Vec<[u32; 3]>,
    vertex_at: HashMap<[i64; 3], u32>,
}

impl Mesh {
    /// Index of the vertex at `point`, the existing one where there is one.
    pub(crate) fn vertex(&mut self, point: DVec3) -> u32 {
        let cell = point.to_array().map(|coordinate| (coordinate * GRID_PER_MM).round() as i64);
        let vertices = &mut self.vertices;
        *self.vertex_at.entry(cell).or_insert_with(|| {
            // Division keeps the decimal value nearest; an integer numerator cannot give -0.0.
            vertices.push(DVec3::from_array(cell.map(|steps| steps as f64 / GRID_PER_MM)));
            u32::try_from(vertices.len() - 1).expect("a part has fewer than 2^32 vertices")
        })
    }

    /// Adds a triangle, counter-clockwise seen from outside; one that welding collapsed is left
    /// out.
    pub(crate) fn triangle(&mut self, corners: [u32; 3]) {
        let [a, b, c] = corners;
        if a != b && b != c && c != a {
            self.triangles.push(corners);
        }
    }

    /// Adds a quadrilateral, counter-clockwise seen from outside, split between its first and third
    /// corner.
    pub(crate) fn quad(&mut self, corners: [DVec3; 4]) {
        let [a, b, c, d] = corners.map(|point| self.vertex(point));
        self.triangle([a, b, c]);
        self.triangle([a, c, d]);
    }

    /// The corners of triangle `triangle_idx`.
    pub(crate) fn corners(&self, triangle_idx: usize) -> [DVec3; 3] {
        self.triangles[triangle_idx].map(|vertex| self.vertices[vertex as usize])
    }

    /// Wavefront OBJ.
    pub(crate) fn to_obj(&self, title: &str) -> Vec<u8> {
        let mut text =
            format!("# hapticd part: {title}\n# units: mm; written by examples/make_parts\n");
        for DVec3 { x, y, z } in &self.vertices {
            writeln!(text, "v {x} {y} {z}").expect("a string takes every write");
        }
        for [a, b, c] in &self.triangles {
            writeln!(text, "f {} {} {}", a + 1, b + 1, c + 1).expect("a string takes every write");
        }
        text.into_bytes()
    }

    /// Binary STL.
    pub(crate) fn to_stl(&self, title: &str) -> Vec<u8> {
        let mut header = format!("hapticd part: {title}; units: mm").into_bytes();
        assert!(header.len() <= 80, "the STL header holds 80 bytes: {title}");
        header.resize(80, b' ');
        let mut bytes = header;
        let n_triangles =
            u32::try_from(self.triangles.len()).expect("a part has fewer than 2^32 triangles");
        bytes.extend(n_triangles.to_le_bytes());
        for triangle_idx in 0..self.triangles.len() {
            let [a, b, c] = self.corners(triangle_idx);
            // Adding zero turns -0.0 into 0.0. Six decimals, so that the last bit of a square root
            // cannot show.
            let normal =
                ((b - a).cross(c - a).normalize_or_zero() * 1e6).round() / 1e6 + DVec3::ZERO;
            for vector in [normal, a, b, c] {
                for coordinate in vector.to_array() {
                    bytes.extend((coordinate as f32).to_le_bytes());
                }
            }
            bytes.extend([0, 0]);
        }
        bytes
    }
}
