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
    /// `[n_pieces]`: faces inward, outside of every body; to be turned round.
    pub(super) to_turn: Vec<bool>,
    /// Every closed piece faces inward.
    pub(super) is_inside_out: bool,
}

/// Decides by the sign of the volume and, for what faces inward, by exact winding numbers of the
/// others beside it. Larger pieces come first: what lies in a piece that was turned is inside of a
/// body.
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
    let mut of_inward: Vec<Vec<&Face>> = vec![Vec::new(); n_pieces];
    for face in faces.faces.iter().filter(|face| is_inward(&pieces.pieces[face.piece as usize])) {
        of_inward[face.piece as usize].push(face);
    }
    for idx in inward {
        let of_piece = &of_inward[idx];
        let step = of_piece.len().div_ceil(PLACES).max(1);
        let is_inside = |face: &&Face| {
            let center: DVec3 = face.corners.iter().sum::<DVec3>() / 3.0;
            // On the side that is material if this is a cavity.
            let winding = faces.winding(center - offset_m * face.normal, |other| {
                let other = other as usize;
                if other == idx {
                    0
                } else if nesting.to_turn[other] {
                    -1
                } else {
                    1
                }
            });
            winding >= 1
        };
        if !of_piece.is_empty() && of_piece.iter().step_by(step).all(is_inside) {
            nesting.is_cavity[idx] = true;
        } else {
            nesting.to_turn[idx] = true;
        }
    }
    nesting
}
