//! Which closed pieces are bodies, which are cavities, and which face the wrong way.

use glam::DVec3;

use super::faces::{Face, Faces};
use super::pieces::{Piece, Pieces};

/// Places at which a piece is asked whether it lies inside of others.
const PLACES: usize = 64;

/// What was decided.
#[derive(Debug, Default)]
pub(super) struct Nesting {
    /// `[n_pieces]`: faces inward, inside of a body.
    pub(super) is_cavity: Vec<bool>,
    /// `[n_pieces]`: faces the wrong way; to be turned round.
    pub(super) to_turn: Vec<bool>,
    /// Every closed piece faces inward.
    pub(super) is_inside_out: bool,
}

/// Decides by the sign of the volume and, for what faces inward, by exact winding numbers of the
/// others beside it. Larger pieces come first: what lies in a piece that was turned is inside of a
/// body.
///
/// A piece that faces inward is a cavity if it lies inside of bodies, and not all of it in a cavity
/// of them; else it is turned. Where it is the outermost, a hollow part was written inside out: what
/// lies in it and in nothing else, and faces outward, becomes its cavity.
pub(super) fn nest(pieces: &Pieces, faces: &Faces, offset_m: f64) -> Nesting {
    let n_pieces = pieces.pieces.len();
    let is_inward = |piece: &Piece| piece.closed && piece.volume_m3 < 0.0;
    let n_closed = pieces.pieces.iter().filter(|piece| piece.closed).count();
    let mut inward: Vec<usize> =
        (0..n_pieces).filter(|idx| is_inward(&pieces.pieces[*idx])).collect();
    let mut nesting = Nesting {
        is_cavity: vec![false; n_pieces],
        to_turn: vec![false; n_pieces],
        is_inside_out: n_closed > 0 && inward.len() == n_closed,
    };
    if nesting.is_inside_out {
        inward.iter().for_each(|idx| nesting.to_turn[*idx] = true);
        return nesting;
    }
    if inward.is_empty() {
        return nesting;
    }
    inward.sort_by(|one, other| {
        pieces.pieces[*one].volume_m3.total_cmp(&pieces.pieces[*other].volume_m3)
    });
    let mut places = Places { of_piece: vec![Vec::new(); n_pieces], offset_m };
    for face in faces.faces.iter().filter(|face| face.closed) {
        places.of_piece[face.piece as usize].push(face);
    }
    for idx in inward {
        let mut in_bodies = true;
        let mut in_cavities = true;
        let mut in_nothing = true;
        // On the side that is material if this is a cavity.
        for place in places.of(idx, -1.0) {
            let mut bodies = 0;
            let mut all = 0;
            faces.windings(place, |other, winding| {
                let other = other as usize;
                if other != idx {
                    let turned = nesting.to_turn[other];
                    let winding = if turned { -winding() } else { winding() };
                    all += winding;
                    if is_inward(&pieces.pieces[other]) == turned {
                        bodies += winding;
                    }
                }
            });
            in_bodies &= bodies >= 1;
            in_cavities &= all < 1;
            in_nothing &= all == 0;
        }
        let has_places = !places.of_piece[idx].is_empty();
        if has_places && in_bodies && !in_cavities {
            nesting.is_cavity[idx] = true;
            continue;
        }
        nesting.to_turn[idx] = true;
        if !has_places || !in_nothing {
            continue;
        }
        for inner in 0..n_pieces {
            let Piece { closed, volume_m3, low, high, .. } = pieces.pieces[inner];
            let of = &pieces.pieces[idx];
            let is_within = of.low.cmple(low).all() && high.cmple(of.high).all();
            let is_body = closed && volume_m3 > 0.0 && !nesting.to_turn[inner];
            if is_body && is_within && places.lies_in(faces, inner, idx) {
                nesting.to_turn[inner] = true;
                nesting.is_cavity[inner] = true;
            }
        }
    }
    nesting
}

/// Where pieces are asked what they lie in.
struct Places<'a> {
    of_piece: Vec<Vec<&'a Face>>,
    /// From the surface, m.
    offset_m: f64,
}

impl Places<'_> {
    /// Some places beside a piece, on the side of its normals or on the other.
    fn of(&self, piece: usize, side: f64) -> impl Iterator<Item = DVec3> {
        let of_piece = &self.of_piece[piece];
        let step = of_piece.len().div_ceil(PLACES).max(1);
        of_piece.iter().step_by(step).map(move |face| {
            let center: DVec3 = face.corners.iter().sum::<DVec3>() / 3.0;
            center + side * self.offset_m * face.normal
        })
    }

    /// All of a body lies in another piece, and not all of it in a third one.
    fn lies_in(&self, faces: &Faces, body: usize, around: usize) -> bool {
        let mut in_others: Option<Vec<u32>> = None;
        for place in self.of(body, 1.0) {
            let mut is_in = false;
            let mut others = Vec::new();
            faces.windings(place, |other, winding| {
                if other as usize == around {
                    is_in = winding() != 0;
                } else if other as usize != body && winding() != 0 {
                    others.push(other);
                }
            });
            if !is_in {
                return false;
            }
            in_others = Some(match in_others {
                None => others,
                Some(all) => all.into_iter().filter(|other| others.contains(other)).collect(),
            });
        }
        in_others.is_some_and(|others| others.is_empty())
    }
}
