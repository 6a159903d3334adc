//! Which fragments lie on the border of the union.
//!
//! Data in: fragments. Data out: for each, whether it stays. Fragments that are connected over
//! edges where nothing else meets them have the same on both sides, so one question per patch is
//! enough: it is asked at the widest of its fragments. Where others are near, several are asked.
//!
//! On both sides of the fragment the winding numbers of the other pieces are counted; the piece
//! itself is inside below and outside above, or, of a cavity, nothing below and −1 above. They are
//! asked a little above and a little below. A piece with a face in between, which was not cut with
//! the fragment, is asked on the fragment itself, as it is on the same side of both. A fragment
//! stays where below is inside and above is not, and where no earlier face lies on it that faces the
//! same way. Of a hollow, it is noted which fragments face what is empty of it.

use std::sync::OnceLock;

use glam::DVec3;

use super::cut::{Cut, Fragment};
use super::faces::{Face, Faces, PieceFaces};
use super::nesting::Nesting;
use super::pieces::Piece;
use crate::mesh::closest_point::TriangleProjector;
use crate::mesh::edges::edge_uses;
use crate::parallel;
use crate::sets::Sets;

/// Sides are looked at this many tolerances above and below, so that what lies on a fragment within
/// the tolerance is on its other side.
const OFFSET_TOLERANCES: f64 = 4.0;

/// Where another piece is as near as twice that, so many of the largest fragments of a patch vote by
/// their areas: two patches along each other, that are nearer in one place than in another, then
/// decide alike.
const VOTERS: usize = 31;

/// Cosine of the angle at which faces face the same way.
const SAME_WAY: f64 = 0.5;

/// Sides of a face: against its normal, and along it.
const BELOW: f64 = -1.0;
const ABOVE: f64 = 1.0;

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

    // Few files need them.
    let pieces_at = OnceLock::new();
    let pieces_at = || pieces_at.get_or_init(|| PiecesAt::of(faces, cut));
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
    let members = OnceLock::new();
    let members = || members.get_or_init(|| Members::of(&patches));
    let question = |fragment: u32| {
        let of = &fragments[fragment as usize];
        let at = inner_center(corners_of(fragment as usize));
        let offset_m = OFFSET_TOLERANCES * tolerance_m;
        let beside = beside(of, faces, at, tolerance_m, pieces_at);
        Question { faces, face_idx: of.face, at, offset_m, beside, nesting, is_sum, has_cavities }
    };
    let verdicts = parallel::map(fragments.len(), 16, |k| {
        if patches[k] != k as u32 {
            return Verdict::default();
        }
        let of_widest = question(widest[k]);
        if !of_widest.is_near_another() {
            return of_widest.verdict();
        }
        let members = members().of_patch(k as u32);
        if members.len() == 1 {
            return of_widest.verdict();
        }
        let area = |fragment: u32| {
            let [a, b, c] = corners_of(fragment as usize);
            (b - a).cross(c - a).length()
        };
        let mut voters: Vec<(f64, u32)> =
            members.iter().map(|fragment| (area(*fragment), *fragment)).collect();
        voters.sort_unstable_by(|one, other| other.0.total_cmp(&one.0).then(one.1.cmp(&other.1)));
        let mut votes: Vec<(Verdict, f64)> = Vec::new();
        for (area, fragment) in voters.into_iter().take(VOTERS) {
            let verdict = question(fragment).verdict();
            match votes.iter_mut().find(|(of, _)| *of == verdict) {
                Some((_, sum)) => *sum += area,
                None => votes.push((verdict, area)),
            }
        }
        let most = votes.into_iter().reduce(|most, of| if of.1 > most.1 { of } else { most });
        most.map_or_else(Verdict::default, |(verdict, _)| verdict)
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

/// The fragments of each patch.
struct Members {
    starts: Vec<u32>,
    fragments: Vec<u32>,
}

impl Members {
    /// Of the patch of each fragment.
    fn of(patches: &[u32]) -> Self {
        let mut starts = vec![0; patches.len() + 1];
        patches.iter().for_each(|patch| starts[*patch as usize + 1] += 1);
        for patch in 0..patches.len() {
            starts[patch + 1] += starts[patch];
        }
        let mut next = starts.clone();
        let mut fragments = vec![0; patches.len()];
        for (fragment, patch) in (0..).zip(patches) {
            let place = &mut next[*patch as usize];
            fragments[*place as usize] = fragment;
            *place += 1;
        }
        Self { starts, fragments }
    }

    fn of_patch(&self, patch: u32) -> &[u32] {
        let range = self.starts[patch as usize]..self.starts[patch as usize + 1];
        &self.fragments[range.start as usize..range.end as usize]
    }
}

/// Closed pieces by the points of their fragments.
struct PiecesAt {
    /// `[n_points + 1]`.
    starts: Vec<u32>,
    /// Each in rising order, and repeated.
    pieces: Vec<u32>,
}

impl PiecesAt {
    fn of(faces: &Faces, cut: &Cut) -> Self {
        let closed = || {
            let fragments = cut.fragments.iter().map(|of| (of, &faces.faces[of.face as usize]));
            fragments.filter(|(_, face)| face.closed)
        };
        let mut starts = vec![0; cut.positions.len() + 1];
        for point in closed().flat_map(|(fragment, _)| fragment.points) {
            starts[point as usize + 1] += 1;
        }
        for point in 0..cut.positions.len() {
            starts[point + 1] += starts[point];
        }
        let mut pieces = vec![0; starts[cut.positions.len()] as usize];
        let mut next = starts.clone();
        for (fragment, face) in closed() {
            for point in fragment.points {
                let place = &mut next[point as usize];
                pieces[*place as usize] = face.piece;
                *place += 1;
            }
        }
        for point in 0..cut.positions.len() {
            pieces[starts[point] as usize..starts[point + 1] as usize].sort_unstable();
        }
        Self { starts, pieces }
    }

    fn at(&self, point: u32) -> &[u32] {
        let range = self.starts[point as usize]..self.starts[point as usize + 1];
        &self.pieces[range.start as usize..range.end as usize]
    }
}

/// The closed pieces with a face along a fragment, as near to a place on it as sides are asked at,
/// but not cut with it: not within the tolerance, and without two of its corners.
fn beside<'a>(
    fragment: &Fragment,
    faces: &Faces,
    at: DVec3,
    tolerance_m: f64,
    pieces_at: impl Fn() -> &'a PiecesAt,
) -> Vec<u32> {
    let face = &faces.faces[fragment.face as usize];
    let mut beside = Vec::new();
    if !face.closed {
        // Closed pieces are not cut by it, and have none of its corners.
        return beside;
    }
    let has_two_corners = |piece: u32| {
        let has = |point: &&u32| pieces_at().at(**point).binary_search(&piece).is_ok();
        fragment.points.iter().filter(has).count() >= 2
    };
    let within_m = OFFSET_TOLERANCES * tolerance_m;
    let mut on = Vec::new();
    faces.meeting(at - within_m, at + within_m, |other_idx| {
        let other = &faces.faces[other_idx as usize];
        let is_along = other.closed
            && other.piece != face.piece
            && other.normal.dot(face.normal).abs() > SAME_WAY
            && is_near(other, at, within_m);
        if !is_along {
            return;
        }
        if is_near(other, at, tolerance_m) || has_two_corners(other.piece) {
            on.push(other.piece);
        } else {
            beside.push(other.piece);
        }
    });
    beside.retain(|piece| !on.contains(piece));
    beside
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
#[derive(Clone, Copy, PartialEq)]
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
    /// Closed pieces with a face that is nearer than the sides are asked at, but was not cut with the
    /// fragment.
    beside: Vec<u32>,
    nesting: &'a Nesting,
    /// Winding numbers only add up: none is negative.
    is_sum: bool,
    has_cavities: bool,
}

impl Question<'_> {
    fn verdict(&self) -> Verdict {
        let face = self.face();
        if !face.closed {
            let stays = [BELOW, ABOVE].iter().all(|side| !self.is_inside(*side, None));
            return Verdict { stays, ..Verdict::default() };
        }
        let is_cavity = self.nesting.is_cavity[face.piece as usize];
        // A piece that meets itself is cut there, and counts as the others do.
        let own = |side: i32| (!face.meets_itself).then_some(side - i32::from(is_cavity));
        // Most of what does not stay has inside above.
        if self.is_inside(ABOVE, own(0)) {
            return Verdict::default();
        }
        let is_border = self.is_inside(BELOW, own(1));
        if !(is_border || is_cavity) || self.is_repeated() {
            return Verdict::default();
        }
        let cavity = match (is_cavity, self.has_cavities) {
            (true, _) => face.piece,
            (false, true) => self.cavity_above(),
            (false, false) => NONE,
        };
        Verdict { stays: is_border, cavity }
    }

    /// A face of another piece runs along this one, not much farther away than what counts as on it.
    fn is_near_another(&self) -> bool {
        let face = self.face();
        let within_m = 2.0 * self.offset_m;
        let mut is_near_another = false;
        self.faces.meeting(self.at - within_m, self.at + within_m, |other_idx| {
            let other = &self.faces.faces[other_idx as usize];
            is_near_another |= other_idx != self.face_idx
                && other.closed
                && (other.piece != face.piece || face.meets_itself)
                && other.normal.dot(face.normal).abs() > SAME_WAY
                && is_near(other, self.at, within_m);
        });
        is_near_another
    }

    fn face(&self) -> &Face {
        &self.faces.faces[self.face_idx as usize]
    }

    /// The winding number of a piece on one side of the face.
    fn winding(&self, of: &PieceFaces, side: f64) -> i32 {
        let offset_m = if self.beside.contains(&of.piece) { 0.0 } else { side * self.offset_m };
        self.faces.winding_of(of, self.at + offset_m * self.face().normal)
    }

    /// Inside of the solid is on this side; `own` is the winding number of the piece of the face, if
    /// it is known.
    fn is_inside(&self, side: f64, own: Option<i32>) -> bool {
        let piece = self.face().piece;
        let mut sum = own.unwrap_or(0);
        if self.is_sum && sum >= 1 {
            return true;
        }
        self.faces.closed_pieces_near(self.at, self.offset_m, |of| {
            let is_known = own.is_some() && of.piece == piece;
            if !(is_known || self.is_sum && sum >= 1) {
                sum += self.winding(of, side);
            }
        });
        sum >= 1
    }

    /// A cavity that is above.
    fn cavity_above(&self) -> u32 {
        let mut cavity = NONE;
        self.faces.closed_pieces_near(self.at, self.offset_m, |of| {
            if self.nesting.is_cavity[of.piece as usize] && self.winding(of, ABOVE) != 0 {
                cavity = of.piece;
            }
        });
        cavity
    }

    /// An earlier face of a piece that lies here faces the same way.
    fn is_repeated(&self) -> bool {
        let face = self.face();
        let mut is_repeated = false;
        self.faces.meeting(self.at - self.offset_m, self.at + self.offset_m, |other_idx| {
            let other = &self.faces.faces[other_idx as usize];
            is_repeated |= other_idx < self.face_idx
                && other.closed
                && (other.piece != face.piece || face.meets_itself)
                && !self.beside.contains(&other.piece)
                && other.normal.dot(face.normal) > SAME_WAY
                && is_near(other, self.at, self.offset_m);
        });
        is_repeated
    }
}

fn is_near(face: &Face, point: DVec3, within_m: f64) -> bool {
    let nearest = TriangleProjector::new(&face.corners).project(point).point;
    nearest.distance_squared(point) <= within_m * within_m
}
