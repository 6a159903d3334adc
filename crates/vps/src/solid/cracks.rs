//! Joins cracks: open edges that lie beside each other.
//!
//! Data in: triangles, and how wide a crack may be. Data out: the triangles with the corners of one
//! side moved to those of the other, and cut where a corner of one side lies beside an edge of the
//! other. Only open edges and their ends take part.
//!
//! Corners first: of two that are nearest to each other, the later becomes the earlier, round by
//! round, as three and more can meet. Then each open edge is led through the corners of others that
//! lie beside it: its triangle becomes a fan, whose edges the other side closes. Triangles in the
//! slit would close it too, but look any way, and what lies nearest to them would not know its
//! side.
//!
//! Cost: that of finding the edges, once per round; n log n in the open ones.

use std::collections::{HashMap, HashSet};

use glam::DVec3;

use crate::mesh::TriangleMesh;
use crate::mesh::boxes::Boxes;
use crate::mesh::edges::edge_uses;
use crate::mesh::weld::weld_within;
use crate::parallel;

/// So many sheets meet in a corner of a part, at most, less one.
const ROUNDS: usize = 8;

/// A mesh without the cracks.
#[derive(Debug)]
pub(super) struct Joined {
    /// The vertices of the file; its triangles in their order, those along a crack in parts.
    pub(super) mesh: TriangleMesh,
    /// Edges that were open and are no longer.
    pub(super) n_edges: usize,
}

/// Joins cracks up to `crack_m` wide; `None` when there is none.
pub(super) fn join_cracks(mesh: &TriangleMesh, tolerance_m: f64, crack_m: f64) -> Option<Joined> {
    let vertices = &mesh.vertices;
    let mut stands_for = weld_within(vertices, tolerance_m);
    let mut triangles = mesh.triangles.clone();
    let mut rims = Rims::of(&mut triangles, &stands_for);
    let n_open = rims.edges.len();
    let mut n_rounds = 0;
    while n_rounds < ROUNDS {
        let pairs = rims.nearest_corners(vertices, crack_m);
        if pairs.is_empty() {
            break;
        }
        n_rounds += 1;
        stands_for = (0..vertices.len() as u32).collect();
        for [one, other] in pairs {
            stands_for[other as usize] = one;
        }
        rims = Rims::of(&mut triangles, &stands_for);
    }
    let splits = rims.splits(vertices, crack_m);
    if n_rounds == 0 && splits.is_empty() {
        return None;
    }
    if !splits.is_empty() {
        let whole = core::mem::take(&mut triangles);
        whole.into_iter().for_each(|corners| cut(corners, [true; 3], &splits, &mut triangles));
    }
    let n_left = Rims::of(&mut triangles, &[]).edges.len();
    (n_left < n_open).then(|| Joined {
        mesh: TriangleMesh { vertices: vertices.clone(), triangles },
        n_edges: n_open - n_left,
    })
}

/// Edges of one triangle.
struct Rims {
    /// In the direction of the triangle.
    edges: Vec<[u32; 2]>,
    /// The third corners of these triangles.
    opposite: Vec<u32>,
    /// Their ends, in rising order.
    corners: Vec<u32>,
    /// Ends of triangles at these corners, lower first: what is an edge is no crack.
    neighbours: HashSet<[u32; 2]>,
}

impl Rims {
    /// Gives the corners of triangles the numbers of what they stand for, if any, and finds the
    /// edges that are open then.
    fn of(triangles: &mut [[u32; 3]], stands_for: &[u32]) -> Self {
        if !stands_for.is_empty() {
            for corner in triangles.as_flattened_mut() {
                *corner = stands_for[*corner as usize];
            }
        }
        let whole: Vec<[u32; 3]> =
            triangles.iter().copied().filter(|[a, b, c]| a != b && b != c && c != a).collect();
        let n_vertices = whole.as_flattened().iter().max().map_or(0, |last| *last as usize + 1);
        let uses = edge_uses(&whole, n_vertices);
        let mut rims = Self {
            edges: Vec::new(),
            opposite: Vec::new(),
            corners: Vec::new(),
            neighbours: HashSet::new(),
        };
        for fan in uses.fans.iter().filter(|fan| fan.triangles.len() == 1) {
            let [low, high] = fan.edge;
            let (triangle, forward) = fan.triangles[0];
            let opposite = whole[triangle as usize].into_iter().find(|v| !fan.edge.contains(v));
            rims.edges.push(if forward { [low, high] } else { [high, low] });
            rims.opposite.push(opposite.unwrap_or(low));
            rims.corners.extend(fan.edge);
        }
        rims.corners.sort_unstable();
        rims.corners.dedup();
        if !rims.corners.is_empty() {
            let mut is_rim = vec![false; n_vertices];
            rims.corners.iter().for_each(|corner| is_rim[*corner as usize] = true);
            for [a, b, c] in &whole {
                for [one, other] in [[a, b], [b, c], [c, a]] {
                    if is_rim[*one as usize] && is_rim[*other as usize] {
                        rims.neighbours.insert([*one.min(other), *one.max(other)]);
                    }
                }
            }
        }
        rims
    }

    fn are_neighbours(&self, one: u32, other: u32) -> bool {
        self.neighbours.contains(&[one.min(other), one.max(other)])
    }

    /// Pairs of corners that are nearest to each other, the lower first.
    fn nearest_corners(&self, vertices: &[DVec3], crack_m: f64) -> Vec<[u32; 2]> {
        let at = |place: usize| vertices[self.corners[place] as usize];
        let boxes = Boxes::new(self.corners.len(), |place| (at(place), at(place)));
        let nearest = parallel::map(self.corners.len(), 16, |place| {
            let mut best = (crack_m * crack_m, usize::MAX);
            boxes.meeting(at(place) - crack_m, at(place) + crack_m, |other| {
                let other = other as usize;
                let candidate = (at(place).distance_squared(at(other)), other);
                let is_edge = || self.are_neighbours(self.corners[place], self.corners[other]);
                if other != place && candidate < best && !is_edge() {
                    best = candidate;
                }
            });
            best.1
        });
        let pairs = nearest.iter().enumerate().filter(|(place, other)| {
            place < other && nearest.get(**other).is_some_and(|back| back == place)
        });
        pairs.map(|(place, other)| [place, *other].map(|place| self.corners[place])).collect()
    }

    /// Of open edges, in the direction of their triangle, the corners of others beside them, from
    /// their starts on.
    fn splits(&self, vertices: &[DVec3], crack_m: f64) -> HashMap<[u32; 2], Vec<u32>> {
        let at = |vertex: u32| vertices[vertex as usize];
        let boxes = Boxes::new(self.corners.len(), |place| {
            let at = at(self.corners[place]);
            (at, at)
        });
        let splits = parallel::map(self.edges.len(), 16, |place| {
            let [from, to] = self.edges[place];
            let [start, end] = [at(from), at(to)];
            let way = end - start;
            let mut beside = Vec::new();
            let [low, high] = [start.min(end) - crack_m, start.max(end) + crack_m];
            boxes.meeting(low, high, |corner| {
                let corner = self.corners[corner as usize];
                let share = (at(corner) - start).dot(way) / way.length_squared();
                let is_beside = share > 0.0
                    && share < 1.0
                    && at(corner).distance_squared(start + share * way) <= crack_m * crack_m;
                if is_beside && ![from, to, self.opposite[place]].contains(&corner) {
                    beside.push((share, corner));
                }
            });
            beside.sort_by(|one, other| one.0.total_cmp(&other.0).then(one.1.cmp(&other.1)));
            beside.into_iter().map(|(_, corner)| corner).collect::<Vec<u32>>()
        });
        let edges = self.edges.iter().copied().zip(splits);
        edges.filter(|(_, beside)| !beside.is_empty()).collect()
    }
}

/// Appends a triangle, in parts where one of those edges is split that may be.
///
/// Only the edges of the triangle itself may, never those between its parts: an edge between parts
/// can run as an open edge of another triangle does, and cutting along that would have no end.
fn cut(
    corners: [u32; 3],
    may_split: [bool; 3],
    splits: &HashMap<[u32; 2], Vec<u32>>,
    parts: &mut Vec<[u32; 3]>,
) {
    for edge in (0..3).filter(|edge| may_split[*edge]) {
        let [from, to, opposite] = [0, 1, 2].map(|k| corners[(edge + k) % 3]);
        let Some(beside) = splits.get(&[from, to]).filter(|beside| !beside.contains(&opposite))
        else {
            continue;
        };
        let [after, before] = [1, 2].map(|k| may_split[(edge + k) % 3]);
        let mut last = from;
        for corner in beside.iter().copied().chain([to]) {
            // The first part has the edge before this one, the last part the one after it.
            let may_split = [false, after && corner == to, before && last == from];
            cut([last, corner, opposite], may_split, splits, parts);
            last = corner;
        }
        return;
    }
    parts.push(corners);
}
