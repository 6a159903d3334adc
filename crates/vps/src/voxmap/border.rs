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

/// Two faces are those of a wall where their normals are opposite within this cosine: 25°.
pub(super) const OPPOSITE_COSINE: f64 = 0.9;

/// Where a ray through a solid leaves it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Exit {
    /// How far that is, m.
    pub(super) at_m: f64,
    /// Of the angle between the ray and the normal of the face there.
    pub(super) cosine: f64,
}

/// The triangles that bound a solid, or are a skin. See the module page.
#[derive(Debug)]
pub struct Border<'a> {
    pub(super) mesh: Cow<'a, TriangleMesh>,
    pub(super) boxes: Boxes,
}

impl<'a> Border<'a> {
    /// Of what a map is of, without what lies beside the solid; `mesh` is the one that the map was
    /// built of. Its triangles face outward, as far as that is known.
    pub fn of(map: &'a Volume, mesh: &'a TriangleMesh) -> Self {
        Self::of_triangles(map.outward_mesh(mesh))
    }

    pub(super) fn of_triangles(mesh: Cow<'a, TriangleMesh>) -> Self {
        let box_of = |triangle| {
            let [a, b, c] = mesh.corners(triangle);
            (a.min(b).min(c), a.max(b).max(c))
        };
        let boxes = Boxes::new(mesh.triangles.len(), box_of);
        Self { mesh, boxes }
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

    /// Where a ray from a place of the surface, this way, leaves the solid; `None` where that is
    /// farther than `most_m`.
    pub(super) fn exit(&self, from: DVec3, way: DVec3, most_m: f64) -> Option<Exit> {
        let nearest = Cell::new(Exit { at_m: most_m, cosine: 0.0 });
        let inverse = way.recip();
        let enters = |low: DVec3, high: DVec3| {
            let one = (low - from) * inverse;
            let other = (high - from) * inverse;
            // Along an axis in which the ray stands still a product may be no number, which
            // `min` and `max` of the other drop.
            let begin_m = one.min(other).max_element().max(0.0);
            begin_m <= one.max(other).min_element().min(nearest.get().at_m)
        };
        self.boxes.visit(enters, |triangle| {
            let [a, b, c] = self.mesh.corners(triangle as usize);
            let normal = (b - a).cross(c - a);
            let along = normal.dot(way);
            // The face that it starts on looks back.
            if along <= 0.0 {
                return;
            }
            let at_m = normal.dot(a - from) / along;
            let place = from + at_m * way;
            let is_within = [(a, b), (b, c), (c, a)]
                .into_iter()
                .all(|(from, to)| (to - from).cross(place - from).dot(normal) >= 0.0);
            if is_within && at_m > 0.0 && at_m < nearest.get().at_m {
                nearest.set(Exit { at_m, cosine: along / normal.length() });
            }
        });
        Some(nearest.get()).filter(|exit| exit.cosine > 0.0)
    }
}
