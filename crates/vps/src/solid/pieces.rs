//! The connected pieces of a file, whether each is closed, and which way it is wound.
//!
//! Data in: the triangles of a file. Data out: for each triangle its piece and its corners after
//! welding, wound consistently within the piece; for each piece its box, volume and area.
//!
//! Pieces are connected over edges of two triangles. Where more meet in an edge, those stay apart
//! that are closed there by themselves: two blocks that touch along an edge are two pieces.
//!
//! Cost: linear; what is sorted is sorted in parallel.

use std::collections::HashMap;

use glam::DVec3;

use super::around_edge::{Wall, around};
use super::damage::{self, Change, way_round};
use crate::mesh::TriangleMesh;
use crate::mesh::edges::{EdgeFan, EdgePair, EdgeUses, edge_uses, repeats};
use crate::mesh::weld::weld_within;
use crate::parallel;
use crate::sets::Sets;

/// The piece of a triangle that was left out.
pub(super) const NO_PIECE: u32 = u32::MAX;

/// A closed piece with less volume than this part of area^1.5 is a sheet with two sides.
const FLAT_SHARE: f64 = 1e-9;

/// Share of the area that has to face one way before it says which way a piece was meant to face;
/// below, the piece is turned outward.
const QUORUM: f64 = 0.75;

/// Triangles that are connected.
#[derive(Clone, Copy, Debug)]
pub(super) struct Piece {
    /// Every edge has an even number of triangles, half of them in each direction.
    pub(super) closed: bool,
    /// Four or more of its triangles share an edge.
    pub(super) meets_itself: bool,
    pub(super) low: DVec3,
    pub(super) high: DVec3,
    /// Positive when the triangles face outward, m³; means little for an open piece.
    pub(super) volume_m3: f64,
    pub(super) area_m2: f64,
    pub(super) n_triangles: usize,
}

/// The triangles of a file by piece.
#[derive(Debug, Default)]
pub(super) struct Pieces {
    /// `[n_triangles]`, after welding and turning.
    pub(super) corners: Vec<[u32; 3]>,
    /// `[n_triangles]`, [`NO_PIECE`] for what was left out.
    pub(super) piece_of: Vec<u32>,
    /// `[n_triangles]`: wound the other way round than in the file.
    pub(super) turned: Vec<bool>,
    /// In the order of their first triangles.
    pub(super) pieces: Vec<Piece>,
    pub(super) n_degenerate: usize,
    pub(super) n_repeats: usize,
    /// Edges of one triangle.
    pub(super) n_open_edges: usize,
    /// The border has the corners after welding, not those of the file.
    pub(super) is_welded: bool,
    /// Triangles whose winding did not agree with their piece.
    pub(super) n_inconsistent: usize,
    /// Pieces with even edges that cannot be wound consistently.
    pub(super) n_not_orientable: usize,
}

impl Pieces {
    /// Vertices closer than `tolerance_m` are one.
    pub(super) fn of(mesh: &TriangleMesh, tolerance_m: f64) -> Self {
        let n_vertices = mesh.vertices.len();
        let welded = weld_within(&mesh.vertices, tolerance_m);
        let corners: Vec<[u32; 3]> = parallel::map(mesh.triangles.len(), 64, |triangle_idx| {
            mesh.triangles[triangle_idx].map(|vertex| welded[vertex as usize])
        });
        let mut kept: Vec<u32> = (0..corners.len() as u32)
            .filter(|idx| !is_degenerate(corners[*idx as usize]))
            .collect();
        let mut triangles: Vec<[u32; 3]> = if kept.len() == corners.len() {
            corners.clone()
        } else {
            kept.iter().map(|triangle_idx| corners[*triangle_idx as usize]).collect()
        };
        let n_kept = kept.len();
        let mut pieces = Self {
            piece_of: vec![NO_PIECE; corners.len()],
            turned: vec![false; corners.len()],
            n_degenerate: corners.len() - n_kept,
            corners,
            ..Self::default()
        };
        let mut uses = edge_uses(&triangles, n_vertices);
        let changes = damage::changes(mesh, &triangles, &uses);
        let mut keep = vec![Keep::Yes; if changes.is_empty() { 0 } else { n_kept }];
        for (triangle, change) in &changes {
            if *change == Change::LeaveOut {
                keep[*triangle as usize] = Keep::No;
            } else {
                triangles[*triangle as usize].swap(1, 2);
                pieces.turn(kept[*triangle as usize] as usize);
                pieces.n_inconsistent += 1;
            }
        }
        retain(&mut kept, &mut triangles, &mut keep);
        pieces.is_welded = !changes.is_empty();
        let repeated = repeats(&triangles, n_vertices);
        if !repeated.is_empty() {
            keep = without_repeats(&triangles, &repeated, n_vertices);
            retain(&mut kept, &mut triangles, &mut keep);
        }
        pieces.n_repeats = n_kept - kept.len();
        if !changes.is_empty() || pieces.n_repeats > 0 {
            uses = edge_uses(&triangles, n_vertices);
        }
        let is_sheet = |triangle: u32| matches!(keep.get(triangle as usize), Some(Keep::AsSheet));
        pieces.connect(mesh, &kept, &triangles, uses, is_sheet);
        if keep.contains(&Keep::AsBody) {
            let mut inward = vec![false; pieces.pieces.len()];
            for (file_idx, _) in kept.iter().zip(&keep).filter(|(_, keep)| **keep == Keep::AsBody) {
                let piece = pieces.piece_of[*file_idx as usize] as usize;
                inward[piece] = pieces.pieces[piece].closed && pieces.pieces[piece].volume_m3 < 0.0;
            }
            pieces.turn_pieces(&inward);
        }
        pieces
    }

    /// Finds the pieces of `triangles`, whose numbers in the file are `kept`.
    fn connect(
        &mut self,
        mesh: &TriangleMesh,
        kept: &[u32],
        triangles: &[[u32; 3]],
        mut uses: EdgeUses,
        is_sheet: impl Fn(u32) -> bool + Copy,
    ) {
        self.n_open_edges = uses.fans.iter().filter(|fan| fan.triangles.len() == 1).count();
        if (0..triangles.len() as u32).any(is_sheet) {
            separate_sheets(&mut uses, is_sheet);
        }
        let mut sets = Sets::new(triangles.len());
        for pair in &uses.pairs {
            sets.join(pair.triangles[0], pair.triangles[1]);
        }
        for fan in &uses.fans {
            // What is closed here by itself stays apart, whichever way it faces.
            let open_sets = open_sets(&fan.triangles, &mut sets);
            let mut open = fan.triangles.clone();
            open.retain(|(triangle, _)| open_sets.contains(&sets.lowest(*triangle)));
            let open = EdgeFan { edge: fan.edge, triangles: open };
            if let Some(walls) = walls_of_bodies(mesh, &open, triangles) {
                walls.into_iter().for_each(|[one, other]| sets.join(one, other));
                continue;
            }
            let mut open = open_sets.into_iter();
            if let Some(first) = open.next() {
                open.for_each(|other| sets.join(first, other));
            }
        }

        let mut piece_of: Vec<u32> = vec![NO_PIECE; triangles.len()];
        for triangle in 0..triangles.len() as u32 {
            let lowest = sets.lowest(triangle);
            if lowest == triangle {
                piece_of[triangle as usize] = self.pieces.len() as u32;
                self.pieces.push(Piece {
                    closed: !is_sheet(triangle),
                    meets_itself: false,
                    low: DVec3::INFINITY,
                    high: DVec3::NEG_INFINITY,
                    volume_m3: 0.0,
                    area_m2: 0.0,
                    n_triangles: 0,
                });
            } else {
                piece_of[triangle as usize] = piece_of[lowest as usize];
            }
        }
        let mut to_repair = vec![false; self.pieces.len()];
        for pair in uses.pairs.iter().filter(|pair| pair.same_direction) {
            to_repair[piece_of[pair.triangles[0] as usize] as usize] = true;
        }
        for fan in &uses.fans {
            for (piece, n_triangles, balance) in by_piece(&fan.triangles, &piece_of) {
                let piece_idx = piece as usize;
                self.pieces[piece_idx].closed &= n_triangles % 2 == 0;
                self.pieces[piece_idx].meets_itself |= n_triangles >= 4;
                to_repair[piece_idx] |= n_triangles % 2 == 0 && balance != 0;
            }
        }
        for (triangle, file_idx) in kept.iter().enumerate() {
            self.piece_of[*file_idx as usize] = piece_of[triangle];
        }
        if to_repair.contains(&true) {
            self.repair(mesh, kept, &piece_of, &uses, &to_repair);
        }
        self.measure(mesh);
        for piece in &mut self.pieces {
            piece.closed &= piece.volume_m3.abs() > FLAT_SHARE * piece.area_m2.powf(1.5);
        }
    }

    /// Makes the winding of some pieces consistent: over edges of two triangles, then by area, and
    /// where the areas do not say it, by the sign of the volume.
    fn repair(
        &mut self,
        mesh: &TriangleMesh,
        kept: &[u32],
        piece_of: &[u32],
        uses: &EdgeUses,
        to_repair: &[bool],
    ) {
        let is_to_repair = |triangle: u32| to_repair[piece_of[triangle as usize] as usize];
        let mut neighbours: HashMap<u32, Vec<(u32, bool)>> = HashMap::new();
        for pair in uses.pairs.iter().filter(|pair| is_to_repair(pair.triangles[0])) {
            let [one, other] = pair.triangles;
            neighbours.entry(one).or_default().push((other, pair.same_direction));
            neighbours.entry(other).or_default().push((one, pair.same_direction));
        }
        let area_of = |triangle: u32| {
            let [a, b, c] = mesh.corners(kept[triangle as usize] as usize);
            0.5 * (b - a).cross(c - a).length()
        };
        let mut flipped = vec![false; kept.len()];
        let mut seen = vec![false; kept.len()];
        let mut doubtful = vec![false; to_repair.len()];
        let mut twisted = vec![false; to_repair.len()];
        for start in (0..kept.len() as u32).filter(|triangle| is_to_repair(*triangle)) {
            if std::mem::replace(&mut seen[start as usize], true) {
                continue;
            }
            let mut patch = vec![start];
            let mut next = 0;
            let mut area = [0.0; 2];
            while let Some(triangle) = patch.get(next).copied() {
                next += 1;
                area[usize::from(flipped[triangle as usize])] += area_of(triangle);
                for (other, same_direction) in neighbours.get(&triangle).into_iter().flatten() {
                    let flip = flipped[triangle as usize] ^ same_direction;
                    if !std::mem::replace(&mut seen[*other as usize], true) {
                        flipped[*other as usize] = flip;
                        patch.push(*other);
                    } else if flipped[*other as usize] != flip {
                        twisted[piece_of[start as usize] as usize] = true;
                    }
                }
            }
            if area[1] > area[0] {
                patch.iter().for_each(|triangle| flipped[*triangle as usize] ^= true);
            }
            doubtful[piece_of[start as usize] as usize] |=
                area[0].max(area[1]) < QUORUM * (area[0] + area[1]);
        }
        for fan in &uses.fans {
            let turned = fan
                .triangles
                .iter()
                .map(|(triangle, forward)| (*triangle, forward ^ flipped[*triangle as usize]));
            for (piece, n_triangles, balance) in by_piece(&turned.collect::<Vec<_>>(), piece_of) {
                twisted[piece as usize] |= n_triangles % 2 == 0 && balance != 0;
            }
        }
        for (triangle, flip) in (0..).zip(&mut flipped) {
            let piece_idx = piece_of[triangle as usize] as usize;
            // What cannot be wound consistently stays as it is, and is a skin.
            *flip &= !twisted[piece_idx];
            if *flip {
                self.turn(kept[triangle as usize] as usize);
                self.n_inconsistent += 1;
            }
        }
        for (piece, twisted) in self.pieces.iter_mut().zip(&twisted) {
            self.n_not_orientable += usize::from(*twisted && piece.closed);
            piece.closed &= !twisted;
        }
        if doubtful.contains(&true) {
            self.measure(mesh);
            let inward: Vec<bool> = self
                .pieces
                .iter()
                .zip(&doubtful)
                .map(|(piece, doubtful)| *doubtful && piece.closed && piece.volume_m3 < 0.0)
                .collect();
            self.turn_pieces(&inward);
        }
    }

    /// Turns one triangle round.
    fn turn(&mut self, file_idx: usize) {
        self.corners[file_idx].swap(1, 2);
        self.turned[file_idx] ^= true;
    }

    /// Turns whole pieces round.
    pub(super) fn turn_pieces(&mut self, which: &[bool]) {
        for file_idx in 0..self.piece_of.len() {
            if which.get(self.piece_of[file_idx] as usize) == Some(&true) {
                self.turn(file_idx);
            }
        }
        for (piece, turned) in self.pieces.iter_mut().zip(which) {
            if *turned {
                piece.volume_m3 = -piece.volume_m3;
            }
        }
    }

    /// Boxes, volumes and areas.
    fn measure(&mut self, mesh: &TriangleMesh) {
        for piece in &mut self.pieces {
            piece.low = DVec3::INFINITY;
            piece.high = DVec3::NEG_INFINITY;
            piece.volume_m3 = 0.0;
            piece.area_m2 = 0.0;
            piece.n_triangles = 0;
        }
        // Volumes are taken from the first corner of the piece: far from it the sum would lose
        // digits.
        let mut origins = vec![DVec3::NAN; self.pieces.len()];
        for (file_idx, piece_idx) in self.piece_of.iter().enumerate() {
            let Some(piece) = self.pieces.get_mut(*piece_idx as usize) else { continue };
            let [a, b, c] = self.corners[file_idx].map(|vertex| mesh.vertices[vertex as usize]);
            let origin = &mut origins[*piece_idx as usize];
            if piece.n_triangles == 0 {
                *origin = a;
            }
            piece.n_triangles += 1;
            piece.low = piece.low.min(a).min(b).min(c);
            piece.high = piece.high.max(a).max(b).max(c);
            let a = a - *origin;
            let b = b - *origin;
            let c = c - *origin;
            piece.volume_m3 += a.dot(b.cross(c)) / 6.0;
            piece.area_m2 += 0.5 * (b - a).cross(c - a).length();
        }
    }
}

/// Takes out what does not stay; all stays where `keep` is empty.
fn retain(kept: &mut Vec<u32>, triangles: &mut Vec<[u32; 3]>, keep: &mut Vec<Keep>) {
    let mut each = keep.iter();
    kept.retain(|_| each.next() != Some(&Keep::No));
    let mut each = keep.iter();
    triangles.retain(|_| each.next() != Some(&Keep::No));
    keep.retain(|keep| *keep != Keep::No);
}

/// Two corners fall together.
fn is_degenerate([a, b, c]: [u32; 3]) -> bool {
    a == b || b == c || c == a
}

/// Takes sheets out of the edges of what they stand on: two triangles remain a pair where a sheet
/// ends on them.
fn separate_sheets(uses: &mut EdgeUses, is_sheet: impl Fn(u32) -> bool) {
    let mut all: Vec<EdgeFan> = std::mem::take(&mut uses.fans);
    uses.pairs.retain(|pair| {
        let [one, other] = pair.triangles;
        let stays = is_sheet(one) == is_sheet(other);
        if !stays {
            // The directions of an open edge tell nothing.
            all.push(EdgeFan { edge: pair.edge, triangles: vec![(one, true)] });
            all.push(EdgeFan { edge: pair.edge, triangles: vec![(other, true)] });
        }
        stays
    });
    for fan in all {
        for of_sheet in [false, true] {
            let triangles: Vec<(u32, bool)> = fan
                .triangles
                .iter()
                .copied()
                .filter(|(triangle, _)| is_sheet(*triangle) == of_sheet)
                .collect();
            match triangles[..] {
                [] => {}
                [(one, forward), (other, other_forward)] => uses.pairs.push(EdgePair {
                    edge: fan.edge,
                    triangles: [one, other],
                    same_direction: forward == other_forward,
                }),
                _ => uses.fans.push(EdgeFan { edge: fan.edge, triangles }),
            }
        }
    }
}

/// In an edge of several bodies: pairs of triangles with material between them. `None` unless as
/// many run forward as back.
///
/// Going round the edge, material begins at a triangle that runs back and ends at one that runs
/// forward. What begins last ends first; in one plane, ends come before beginnings, so that bodies
/// that touch there stay apart.
fn walls_of_bodies(
    mesh: &TriangleMesh,
    fan: &EdgeFan,
    triangles: &[[u32; 3]],
) -> Option<Vec<[u32; 2]>> {
    let n_forward = fan.triangles.iter().filter(|(_, forward)| *forward).count();
    if 2 * n_forward != fan.triangles.len() {
        return None;
    }
    let mut walls = around(mesh, fan, triangles)?;
    let n = walls.len();
    walls.sort_unstable_by(|one, other| {
        let ends_first = other.ends.cmp(&one.ends);
        // The last to begin is the lowest, which ends at the lowest.
        let by_number = one.triangle.cmp(&other.triangle);
        let lowest = if one.ends { by_number } else { by_number.reverse() };
        one.plane.cmp(&other.plane).then(ends_first).then(lowest)
    });
    // A second round closes what began before the seam.
    let mut begun = Vec::new();
    let mut pairs = Vec::new();
    let mut is_paired = vec![false; n];
    for (round, k) in (0..2 * n).map(|k| (k / n, k % n)) {
        let Wall { ends, triangle, .. } = walls[k];
        if !ends && round == 0 {
            begun.push(k);
        } else if ends
            && !is_paired[k]
            && let Some(begin) = begun.pop()
        {
            is_paired[k] = true;
            pairs.push([walls[begin].triangle, triangle]);
        }
    }
    Some(pairs)
}

/// The sets that are open in an edge: more of their triangles run one way than the other.
fn open_sets(triangles: &[(u32, bool)], sets: &mut Sets) -> Vec<u32> {
    let mut lowest: Vec<(u32, i32)> = triangles
        .iter()
        .map(|(triangle, forward)| (sets.lowest(*triangle), if *forward { 1 } else { -1 }))
        .collect();
    lowest.sort_unstable();
    lowest
        .chunk_by(|one, other| one.0 == other.0)
        .filter(|same| same.iter().map(|(_, way)| way).sum::<i32>() != 0)
        .map(|same| same[0].0)
        .collect()
}

/// For each piece in an edge: how many triangles, and how many more of them run forward than back.
fn by_piece(triangles: &[(u32, bool)], piece_of: &[u32]) -> Vec<(u32, usize, i32)> {
    let mut uses: Vec<(u32, i32)> = triangles
        .iter()
        .map(|(triangle, forward)| (piece_of[*triangle as usize], if *forward { 1 } else { -1 }))
        .collect();
    uses.sort_unstable();
    uses.chunk_by(|a, b| a.0 == b.0)
        .map(|same| (same[0].0, same.len(), same.iter().map(|(_, way)| way).sum()))
        .collect()
}

/// What becomes of a triangle among repeats.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Keep {
    Yes,
    /// Repeats one that stays.
    Repeat,
    No,
    /// By itself: what it stands on is closed without it.
    AsSheet,
    /// Of a body that stands twice, once facing inward: outside of others that is one body, and
    /// inside of them it is full.
    AsBody,
}

/// Decides which of triangles with the same corners stay.
///
/// Copies that face opposite ways in equal numbers are the common wall of two blocks, or a fin of
/// no thickness, where the rest is closed without them; then one is a sheet. Where the rest is open
/// without them, or nothing else is there, one of them closes it.
///
/// Of other copies one stays, unless the copies belong to different closed surfaces, which would
/// be open without them: then all stay, and the union finds them on each other.
fn without_repeats(triangles: &[[u32; 3]], repeated: &[[u32; 2]], n_vertices: usize) -> Vec<Keep> {
    let mut keep = vec![Keep::Yes; triangles.len()];
    let mut sets = Sets::new(triangles.len());
    for [one, other] in repeated {
        sets.join(*one, *other);
    }
    let mut groups: Vec<(u32, u32)> =
        repeated.iter().flatten().map(|triangle| (sets.lowest(*triangle), *triangle)).collect();
    groups.sort_unstable();
    groups.dedup();
    let mut walls = Vec::new();
    for group in groups.chunk_by(|a, b| a.0 == b.0) {
        let ways: Vec<i32> =
            group.iter().map(|(_, triangle)| way_round(triangles[*triangle as usize])).collect();
        let net: i32 = ways.iter().sum();
        let mut stays = ways.iter().position(|way| net == 0 || *way == net.signum());
        for (place, (_, triangle)) in group.iter().enumerate() {
            if Some(place) == stays {
                stays = None;
                if net == 0 {
                    walls.push(*triangle);
                    keep[*triangle as usize] = Keep::AsSheet;
                }
            } else {
                keep[*triangle as usize] = if net == 0 { Keep::No } else { Keep::Repeat };
            }
        }
    }
    if !walls.is_empty() {
        judge_walls(triangles, &walls, &mut keep);
    }
    if keep.contains(&Keep::Repeat) {
        judge_repeats(triangles, n_vertices, &mut keep);
    }
    keep
}

/// Keeps those walls that close something.
fn judge_walls(triangles: &[[u32; 3]], walls: &[u32], keep: &mut [Keep]) {
    // How many walls, and how many other triangles, share an edge.
    let edges_of = |[a, b, c]: [u32; 3]| {
        [[a, b], [b, c], [c, a]].map(|[from, to]| [from.min(to), from.max(to)])
    };
    let mut by_edge: HashMap<[u32; 2], (Vec<u32>, usize)> = HashMap::new();
    for (place, wall) in (0_u32..).zip(walls) {
        for edge in edges_of(triangles[*wall as usize]) {
            by_edge.entry(edge).or_default().0.push(place);
        }
    }
    let others = triangles.iter().zip(&*keep);
    for (triangle, _) in others.filter(|(_, keep)| [Keep::Yes, Keep::Repeat].contains(keep)) {
        for edge in edges_of(*triangle) {
            if let Some((_, n_others)) = by_edge.get_mut(&edge) {
                *n_others += 1;
            }
        }
    }
    let mut patches = Sets::new(walls.len());
    for (of_edge, _) in by_edge.values() {
        of_edge.iter().for_each(|place| patches.join(of_edge[0], *place));
    }
    let mut has_rim = vec![false; walls.len()];
    let mut closes = vec![false; walls.len()];
    for (of_edge, n_others) in by_edge.values().filter(|(of_edge, _)| of_edge.len() % 2 == 1) {
        let patch = patches.lowest(of_edge[0]) as usize;
        has_rim[patch] = true;
        closes[patch] |= n_others % 2 == 1;
    }
    for (place, wall) in (0_u32..).zip(walls) {
        let patch = patches.lowest(place) as usize;
        if closes[patch] {
            keep[*wall as usize] = Keep::Yes;
        } else if !has_rim[patch] {
            keep[*wall as usize] = Keep::AsBody;
        }
    }
}

/// Keeps all repeats of what is closed with them and open without.
fn judge_repeats(triangles: &[[u32; 3]], n_vertices: usize, keep: &mut [Keep]) {
    let which: Vec<u32> = (0..triangles.len() as u32)
        .filter(|triangle| {
            [Keep::Yes, Keep::AsBody, Keep::Repeat].contains(&keep[*triangle as usize])
        })
        .collect();
    let chosen: Vec<[u32; 3]> =
        which.iter().map(|triangle| triangles[*triangle as usize]).collect();
    let uses = edge_uses(&chosen, n_vertices);
    // The triangles of an edge, and +1 or −1 for their directions along it.
    let mut edges: Vec<Vec<(u32, i32)>> = Vec::with_capacity(uses.pairs.len() + uses.fans.len());
    for pair in &uses.pairs {
        let [one, other] = pair.triangles;
        edges.push(vec![(one, 1), (other, if pair.same_direction { 1 } else { -1 })]);
    }
    for fan in &uses.fans {
        let ways = fan.triangles.iter().map(|(idx, forward)| (*idx, if *forward { 1 } else { -1 }));
        edges.push(ways.collect());
    }
    let mut sets = Sets::new(chosen.len());
    for edge in &edges {
        edge.iter().for_each(|(triangle, _)| sets.join(edge[0].0, *triangle));
    }
    let is_first = |triangle: &u32| keep[which[*triangle as usize] as usize] != Keep::Repeat;
    // Closed, and as many triangles in each direction: with repeats, and without.
    let mut is_open = vec![[false; 2]; chosen.len()];
    let mut is_unbalanced = vec![[false; 2]; chosen.len()];
    for edge in &edges {
        let set = sets.lowest(edge[0].0) as usize;
        let firsts: Vec<i32> =
            edge.iter().filter(|(triangle, _)| is_first(triangle)).map(|(_, way)| *way).collect();
        is_open[set][0] |= edge.len() % 2 == 1;
        is_open[set][1] |= firsts.len() % 2 == 1;
        is_unbalanced[set][0] |= edge.iter().map(|(_, way)| way).sum::<i32>() != 0;
        is_unbalanced[set][1] |= firsts.iter().sum::<i32>() != 0;
    }
    let needs_repeats = |set: usize| {
        let is_worse = |[with, without]: [bool; 2]| without && !with;
        !is_open[set][0] && (is_open[set][1] || is_worse(is_unbalanced[set]))
    };
    for (place, triangle) in (0_u32..).zip(&which) {
        let keep = &mut keep[*triangle as usize];
        if *keep == Keep::Repeat {
            let set = sets.lowest(place) as usize;
            *keep = if needs_repeats(set) { Keep::Yes } else { Keep::No };
        }
    }
}
