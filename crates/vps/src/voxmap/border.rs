//! Exact distances to the surface of a part, beyond the layers of its map.
//!
//! Data in: the triangles that a map is of. Data out: the distance of any place to them. Metres,
//! mesh frame. Cost: O(n log n) for a tree over n triangles, O(log n) per place.

use std::borrow::Cow;
use std::cell::Cell;

use glam::DVec3;

use super::Volume;
use crate::mesh::TriangleMesh;
use crate::mesh::boxes::Boxes;
use crate::mesh::closest_point::TriangleProjector;

/// The triangles that bound a solid, or are a skin. See the module page.
#[derive(Debug)]
pub struct Border<'a> {
    pub(super) mesh: Cow<'a, TriangleMesh>,
    pub(super) boxes: Boxes,
}

impl<'a> Border<'a> {
    /// Of what a map is of, without what lies beside the solid; `mesh` is the one that the map was
    /// built of.
    pub fn of(map: &'a Volume, mesh: &'a TriangleMesh) -> Self {
        Self::of_triangles(map.mesh(mesh))
    }

    pub(super) fn of_triangles(mesh: &'a TriangleMesh) -> Self {
        let box_of = |triangle| {
            let [a, b, c] = mesh.corners(triangle);
            (a.min(b).min(c), a.max(b).max(c))
        };
        Self { mesh: Cow::Borrowed(mesh), boxes: Boxes::new(mesh.triangles.len(), box_of) }
    }

    /// The same, with a copy of the triangles.
    pub fn into_owned(self) -> Border<'static> {
        Border { mesh: Cow::Owned(self.mesh.into_owned()), boxes: self.boxes }
    }

    /// From a place to the nearest triangle, m; exact up to `most_m`, and `most_m` beyond it.
    pub fn distance_m(&self, place_m: DVec3, most_m: f64) -> f64 {
        let nearest = Cell::new(most_m * most_m);
        let squared = |low: DVec3, high: DVec3| {
            (low - place_m).max(place_m - high).max(DVec3::ZERO).length_squared()
        };
        self.boxes.visit(
            |low, high| squared(low, high) < nearest.get(),
            |triangle| {
                let corners = self.mesh.corners(triangle as usize);
                let found = TriangleProjector::new(&corners).project(place_m).distance_squared;
                nearest.set(nearest.get().min(found));
            },
        );
        nearest.get().sqrt()
    }
}
