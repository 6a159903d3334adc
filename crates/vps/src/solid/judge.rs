//! Which fragments lie on the border of the union.
//!
//! Data in: fragments. Data out: for each, whether it stays. Fragments that are connected over
//! edges where nothing else meets them have the same on both sides, so one question per patch is
//! enough: it is asked at the widest of its fragments.
//!
//! A little above and below the fragment the winding numbers of the other pieces are counted; the
//! piece itself is inside below and outside above, or, of a cavity, nothing below and −1 above. A
//! fragment stays where below is inside and above is not, and where no earlier face lies on it that
//! faces the same way. Of a hollow, it is noted which fragments face what is empty of it.

use glam::DVec3;

use super::cut::{Cut, Fragment};
use super::faces::Faces;
use super::nesting::Nesting;
use super::pieces::Piece;

use crate::mesh::edges::edge_uses;
use crate::parallel;
use crate::sets::Sets;

/// Sides are looked at this many tolerances above and below, so that what lies on a fragment within
/// the tolerance is on its other side.
const OFFSET_TOLERANCES: f64 = 4.0;

/// Cosine of the angle at which faces face the same way.
const SAME_WAY: f64 = 0.5;

/// No cavity.
const NONE: u32 = u32::MAX;

/// What was found of the fragments.
#[derive(Debug)]
pub(super) struct Judged {
    /// `[n_fragments]`: it belongs to the border; of open pieces, it lies outside of the solid.
    pub(super) stays: Vec<bool>,
    /// `[n_fragments]`: the cavity whose empty part lies above; [`u32::MAX`] for none. Empty when
    /// there are no cavities.
    cavities: Vec<u32>,
}

impl Judged {
    /// What is empty of each cavity, `[n_pieces]`, m³; 0 for other pieces.
    pub(super) fn empty_m3(&self, cut: &Cut, pieces: &[Piece]) -> Vec<f64> {
        let mut volumes = vec![0.0; pieces.len()];
        for (fragment, cavity) in cut.fragments.iter().zip(&self.cavities) {
            if *cavity != NONE {
                // From a point beside it: far from it the sum would lose digits.
                let origin = pieces[*cavity as usize].low;
                let [a, b, c] = fragment.points.map(|point| cut.positions[point as usize] - origin);
                volumes[*cavity as usize] -= a.dot(b.cross(c)) / 6.0;
            }
        }
        volumes
    }
}

/// Judges all fragments.
pub(super) fn judge(faces: &Faces, cut: &Cut, nesting: &Nesting, tolerance_m: f64) -> Judged {
    let has_cavities = nesting.is_cavity.contains(&true);
    // Without cavities no winding number is negative, and the first body that holds a point says
    // that it is inside.
    let is_sum = !has_cavities && !faces.faces.iter().any(|face| face.meets_itself);
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
    let verdicts = parallel::map(fragments.len(), 16, |k| {
        if patches[k] != k as u32 {
            return Verdict::default();
        }
        let widest = widest[k] as usize;
        let face_idx = fragments[widest].face;
        Question {
            faces,
            face_idx,
            at: inner_center(corners_of(widest)),
            offset_m: OFFSET_TOLERANCES * tolerance_m,
            nesting,
            is_sum,
            has_cavities,
        }
        .verdict()
    });
    Judged {
        stays: patches.iter().map(|patch| verdicts[*patch as usize].stays).collect(),
        cavities: if has_cavities {
            patches.iter().map(|patch| verdicts[*patch as usize].cavity).collect()
        } else {
            Vec::new()
        },
    }
}

/// The centre of the circle that fits into a triangle.
fn inner_center([a, b, c]: [DVec3; 3]) -> DVec3 {
    let to_a = b.distance(c);
    let to_b = c.distance(a);
    let to_c = a.distance(b);
    let sum = to_a + to_b + to_c;
    if sum > 0.0 { (a * to_a + b * to_b + c * to_c) / sum } else { a }
}

/// What is true of a patch.
#[derive(Clone, Copy)]
struct Verdict {
    stays: bool,
    cavity: u32,
}

impl Default for Verdict {
    fn default() -> Self {
        Self { stays: false, cavity: NONE }
    }
}

/// A place on a face.
struct Question<'a> {
    faces: &'a Faces,
    face_idx: u32,
    at: DVec3,
    offset_m: f64,
    nesting: &'a Nesting,
    /// Winding numbers only add up: none is negative.
    is_sum: bool,
    has_cavities: bool,
}

impl Question<'_> {
    fn verdict(&self) -> Verdict {
        let face = &self.faces.faces[self.face_idx as usize];
        let offset = self.offset_m * face.normal;
        let [below, above] = [self.at - offset, self.at + offset];
        if !face.closed {
            let stays = [below, above].iter().all(|point| !self.is_inside(*point, None));
            return Verdict { stays, ..Verdict::default() };
        }
        let is_cavity = self.nesting.is_cavity[face.piece as usize];
        // A piece that meets itself is cut there, and counts as the others do.
        let own = |side: i32| (!face.meets_itself).then_some(side - i32::from(is_cavity));
        // Most of what does not stay has inside above.
        if self.is_inside(above, own(0)) {
            return Verdict::default();
        }
        let is_border = self.is_inside(below, own(1));
        if !(is_border || is_cavity) || self.is_repeated() {
            return Verdict::default();
        }
        let cavity = match (is_cavity, self.has_cavities) {
            (true, _) => face.piece,
            (false, true) => self.cavity_at(above),
            (false, false) => NONE,
        };
        Verdict { stays: is_border, cavity }
    }

    /// The point is inside of the solid; `own` is the winding number of the piece of the face, if
    /// it is known.
    fn is_inside(&self, point: DVec3, own: Option<i32>) -> bool {
        let piece = self.faces.faces[self.face_idx as usize].piece;
        let mut sum = own.unwrap_or(0);
        if self.is_sum && sum >= 1 {
            return true;
        }
        self.faces.windings(point, |other, winding| {
            let is_known = own.is_some() && other == piece;
            if !(is_known || self.is_sum && sum >= 1) {
                sum += winding();
            }
        });
        sum >= 1
    }

    /// A cavity that holds the point.
    fn cavity_at(&self, point: DVec3) -> u32 {
        let mut cavity = NONE;
        self.faces.windings(point, |piece, winding| {
            if self.nesting.is_cavity[piece as usize] && winding() != 0 {
                cavity = piece;
            }
        });
        cavity
    }

    /// An earlier face of another piece lies here and faces the same way.
    fn is_repeated(&self) -> bool {
        let face = &self.faces.faces[self.face_idx as usize];
        let mut is_repeated = false;
        self.faces.meeting(self.at - self.offset_m, self.at + self.offset_m, |other_idx| {
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
