//! Which fragments lie on the border of the union.
//!
//! Data in: fragments. Data out: for each, whether it stays. Fragments that are connected over
//! edges where nothing else meets them have the same on both sides, so one question per patch is
//! enough: it is asked at the widest of its fragments.
//!
//! A little above and below the fragment the winding numbers of the other pieces are counted; the
//! piece itself is inside below and outside above, or, of a cavity, nothing below and −1 above. A
//! fragment stays where below is inside and above is not, and where no earlier face lies on it that
//! faces the same way.

use glam::DVec3;

use super::cut::{Cut, Fragment};
use super::faces::Faces;
use super::sets::Sets;
use crate::mesh::edges::edge_uses;
use crate::parallel;

/// Sides are looked at this many tolerances above and below, so that what lies on a fragment within
/// the tolerance is on its other side.
const OFFSET_TOLERANCES: f64 = 4.0;

/// Cosine of the angle at which faces face the same way.
const SAME_WAY: f64 = 0.5;

/// For each fragment, whether it belongs to the border; of open pieces, whether it lies outside of
/// the solid.
pub(super) fn judge(
    faces: &Faces,
    cut: &Cut,
    is_cavity: impl Fn(u32) -> bool + Sync,
    tolerance_m: f64,
) -> Vec<bool> {
    let fragments = &cut.fragments;
    let triangles = parallel::map(fragments.len(), 256, |k| fragments[k].points);
    let uses = edge_uses(&triangles, cut.positions.len());
    let piece_of = |fragment: u32| faces.faces[fragments[fragment as usize].face as usize].piece;
    let mut sets = Sets::new(fragments.len());
    for pair in &uses.pairs {
        let [one, other] = pair.triangles;
        let meets = |fragment: u32| {
            let Fragment { points, meets, .. } = &fragments[fragment as usize];
            (0..3).any(|k| {
                let ends = [points[k], points[(k + 1) % 3]];
                meets >> k & 1 == 1 && (ends == pair.edge || [ends[1], ends[0]] == pair.edge)
            })
        };
        if !pair.same_direction && piece_of(one) == piece_of(other) && !meets(one) && !meets(other)
        {
            sets.join(one, other);
        }
    }

    let corners_of = |k: usize| triangles[k].map(|point| cut.positions[point as usize]);
    let width = parallel::map(fragments.len(), 256, |k| {
        let [a, b, c] = corners_of(k);
        let around = a.distance(b) + b.distance(c) + c.distance(a);
        if around > 0.0 { (b - a).cross(c - a).length() / around } else { 0.0 }
    });
    let mut patches: Vec<u32> = (0..fragments.len() as u32).collect();
    let mut widest: Vec<u32> = patches.clone();
    for fragment in 0..fragments.len() as u32 {
        let patch = sets.lowest(fragment);
        patches[fragment as usize] = patch;
        let best = &mut widest[patch as usize];
        if width[fragment as usize] > width[*best as usize] {
            *best = fragment;
        }
    }
    let stays = parallel::map(fragments.len(), 16, |k| {
        if patches[k] != k as u32 {
            return false;
        }
        let widest = widest[k] as usize;
        let face_idx = fragments[widest].face;
        Question {
            faces,
            face_idx,
            at: inner_center(corners_of(widest)),
            offset_m: OFFSET_TOLERANCES * tolerance_m,
        }
        .stays(&is_cavity)
    });
    patches.iter().map(|patch| stays[*patch as usize]).collect()
}

/// The centre of the circle that fits into a triangle.
fn inner_center([a, b, c]: [DVec3; 3]) -> DVec3 {
    let (to_a, to_b, to_c) = (b.distance(c), c.distance(a), a.distance(b));
    let sum = to_a + to_b + to_c;
    if sum > 0.0 { (a * to_a + b * to_b + c * to_c) / sum } else { a }
}

/// A place on a face.
struct Question<'a> {
    faces: &'a Faces,
    face_idx: u32,
    at: DVec3,
    offset_m: f64,
}

impl Question<'_> {
    fn stays(&self, is_cavity: &impl Fn(u32) -> bool) -> bool {
        let face = &self.faces.faces[self.face_idx as usize];
        let offset = self.offset_m * face.normal;
        let [below, above] = [self.at - offset, self.at + offset];
        if !face.closed {
            return [below, above].iter().all(|point| self.faces.winding(*point, |_| 1) < 1);
        }
        // A piece that meets itself is cut there, and counts as the others do.
        let winding = |point: DVec3, own: i32| {
            if face.meets_itself {
                self.faces.winding(point, |_| 1)
            } else {
                own + self.faces.winding(point, |other| i32::from(other != face.piece))
            }
        };
        let (own_below, own_above) = if is_cavity(face.piece) { (0, -1) } else { (1, 0) };
        // Most of what does not stay has inside above.
        winding(above, own_above) < 1 && winding(below, own_below) >= 1 && !self.is_repeated()
    }

    /// An earlier face of another piece lies here and faces the same way.
    fn is_repeated(&self) -> bool {
        let face = &self.faces.faces[self.face_idx as usize];
        let mut is_repeated = false;
        self.faces.boxes.meeting(self.at - self.offset_m, self.at + self.offset_m, |other_idx| {
            let other = &self.faces.faces[other_idx as usize];
            is_repeated |= other_idx < self.face_idx
                && other.closed
                && (other.piece != face.piece || face.meets_itself)
                && other.normal.dot(face.normal) > SAME_WAY
                && other.height(self.at).abs() <= self.offset_m
                && other.is_over(self.at);
        });
        is_repeated
    }
}
