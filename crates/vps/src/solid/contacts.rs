//! What two triangles have in common: points, and the lines between them.
//!
//! Data in: two faces. Data out: points on edges, and lines across faces.
//!
//! A point is known by what makes it: a vertex, an edge through a face, or two edges. Whether it
//! exists is decided from these alone, within a tolerance, so that all triangles around agree. The
//! order of questions is: vertices on edges, vertices on faces, edges that meet, edges through
//! faces; what an earlier one answers is not asked again.

use glam::DVec3;

use super::faces::Face;
use super::lines::Lines;

/// A point by what makes it.
pub(super) type Key = [u32; 3];

pub(super) fn vertex_key(vertex: u32) -> Key {
    [0, vertex, 0]
}

/// An edge (line) through a face.
fn edge_face_key(edge: u32, face: u32) -> Key {
    [1, edge, face]
}

/// Two edges (lines).
fn edge_edge_key(one: u32, other: u32) -> Key {
    [2, one.min(other), one.max(other)]
}

/// What was found between pairs of faces.
#[derive(Debug, Default)]
pub(super) struct Contacts {
    /// An edge (line), and a point on it.
    pub(super) on_edges: Vec<(u32, Key)>,
    /// A face, and the ends of a line across it or along one of its edges.
    pub(super) across: Vec<(u32, [Key; 2])>,
}

/// A point that both faces have in common; bit `k` of a mask is set when it lies on edge `k`.
#[derive(Clone, Copy)]
pub(super) struct Common {
    key: Key,
    at: DVec3,
    edges: [u8; 2],
}

/// Edges that begin or end in corner `k`.
fn edges_at(corner: usize) -> u8 {
    (1 << corner) | (1 << ((corner + 2) % 3))
}

/// Foot of a point on a segment, when it is no end of it and within the tolerance.
fn is_on_segment(point: DVec3, [from, to]: [DVec3; 2], tolerance_m: f64) -> bool {
    let way = to - from;
    let share = (point - from).dot(way) / way.length_squared();
    share > 0.0
        && share < 1.0
        && (from + share * way).distance_squared(point) <= tolerance_m * tolerance_m
}

/// Where two segments come closest, as shares of both; `None` for parallel ones.
fn closest([a, b]: [DVec3; 2], [c, d]: [DVec3; 2]) -> Option<(f64, f64)> {
    let u = b - a;
    let v = d - c;
    let w = a - c;
    let uu = u.length_squared();
    let uv = u.dot(v);
    let vv = v.length_squared();
    let det = uu * vv - uv * uv;
    if det <= 1e-14 * uu * vv {
        return None;
    }
    let uw = u.dot(w);
    let vw = v.dot(w);
    Some(((uv * vw - vv * uw) / det, (uu * vw - uv * uw) / det))
}

/// Looks for what two faces have in common.
#[derive(Clone, Copy)]
pub(super) struct Pair<'a> {
    pub(super) faces: [&'a Face; 2],
    /// Their numbers.
    pub(super) numbers: [u32; 2],
    pub(super) lines: &'a Lines,
    /// Of all vertices.
    pub(super) positions: &'a [DVec3],
    pub(super) tolerance_m: f64,
    /// Which of the two is cut.
    pub(super) is_cut: [bool; 2],
}

impl Pair<'_> {
    fn segment(&self, edge: u32) -> [DVec3; 2] {
        self.lines.ends(edge).map(|vertex| self.positions[vertex as usize])
    }

    /// Where two edges come within the tolerance of each other, between their ends.
    fn meet(&self, one: u32, other: u32) -> Option<DVec3> {
        let first = self.segment(one.min(other));
        let second = self.segment(one.max(other));
        let (s, t) = closest(first, second)?;
        if !(s > 0.0 && s < 1.0 && t > 0.0 && t < 1.0) {
            return None;
        }
        let p = first[0].lerp(first[1], s);
        let q = second[0].lerp(second[1], t);
        let tolerance = self.tolerance_m;
        (p.distance_squared(q) <= tolerance * tolerance).then(|| 0.5 * (p + q))
    }

    /// Adds what the pair has in common; `common` is memory that is used again.
    pub(super) fn find(&self, common: &mut Vec<Common>, found: &mut Contacts) {
        let tolerance = self.tolerance_m;
        let shares = |side: usize, k: usize| {
            self.faces[1 - side].vertices.contains(&self.faces[side].vertices[k])
        };
        // Heights of the corners of each over the plane of the other.
        let heights = [0, 1].map(|side| {
            [0, 1, 2].map(|k| {
                if shares(side, k) {
                    0.0
                } else {
                    self.faces[1 - side].height(self.faces[side].corners[k])
                }
            })
        });
        if heights.iter().any(|of| {
            of.iter().all(|height| *height > tolerance)
                || of.iter().all(|height| *height < -tolerance)
        }) {
            return;
        }

        common.clear();
        // Corners that lie on the other: on its edges (a mask), or within it.
        let mut on_edges = [[0_u8; 3]; 2];
        let mut is_on = [[false; 3]; 2];
        for side in [0, 1] {
            let face = self.faces[side];
            let other = self.faces[1 - side];
            for k in 0..3 {
                let vertex = face.vertices[k];
                let at = face.corners[k];
                if let Some(shared) = other.vertices.iter().position(|other| *other == vertex) {
                    is_on[side][k] = true;
                    on_edges[side][k] = edges_at(shared);
                    if side == 0 {
                        let edges = [edges_at(k), edges_at(shared)];
                        common.push(Common { key: vertex_key(vertex), at, edges });
                    }
                    continue;
                }
                if heights[side][k].abs() > tolerance {
                    continue;
                }
                for edge in 0..3 {
                    if is_on_segment(at, self.segment(other.edges[edge]), tolerance) {
                        on_edges[side][k] |= 1 << edge;
                        if self.is_cut[1 - side] {
                            found.on_edges.push((other.edges[edge], vertex_key(vertex)));
                        }
                    }
                }
                if on_edges[side][k] != 0 || other.is_over(at) {
                    is_on[side][k] = true;
                    let mut edges = [edges_at(k), on_edges[side][k]];
                    if side == 1 {
                        edges.reverse();
                    }
                    common.push(Common { key: vertex_key(vertex), at, edges });
                }
            }
        }

        let first_meeting = common.len();
        for one in 0..3 {
            let [from, to] = [one, (one + 1) % 3];
            if heights[0][from].min(heights[0][to]) > tolerance
                || heights[0][from].max(heights[0][to]) < -tolerance
            {
                continue;
            }
            for other in 0..3 {
                let ends = [other, (other + 1) % 3];
                let touches = on_edges[0][from] | on_edges[0][to];
                if touches >> other & 1 == 1
                    || ends.iter().any(|end| on_edges[1][*end] >> one & 1 == 1)
                {
                    continue;
                }
                let edges = [self.faces[0].edges[one], self.faces[1].edges[other]];
                let Some(at) = self.meet(edges[0], edges[1]) else { continue };
                let key = edge_edge_key(edges[0], edges[1]);
                common.push(Common { key, at, edges: [1 << one, 1 << other] });
                for side in [0, 1] {
                    if self.is_cut[side] {
                        found.on_edges.push((edges[side], key));
                    }
                }
            }
        }

        for side in [0, 1] {
            let face = self.faces[side];
            let other = self.faces[1 - side];
            for k in 0..3 {
                let ends = [k, (k + 1) % 3];
                let [over, under] = ends.map(|end| heights[side][end]);
                if over * under >= 0.0 {
                    continue;
                }
                let segment = self.segment(face.edges[k]);
                let [from, to] = segment.map(|end| other.height(end));
                let at = segment[0].lerp(segment[1], from / (from - to));
                let is_near =
                    |point: DVec3| point.distance_squared(at) <= 16.0 * tolerance * tolerance;
                let is_known =
                    ends.iter().any(|end| is_on[side][*end] && is_near(face.corners[*end]))
                        || common[first_meeting..].iter().any(|meeting| {
                            meeting.edges[side] >> k & 1 == 1 && is_near(meeting.at)
                        });
                if is_known || !other.is_over(at) {
                    continue;
                }
                let key = edge_face_key(face.edges[k], self.numbers[1 - side]);
                let mut edges = [1 << k, 0];
                if side == 1 {
                    edges.reverse();
                }
                common.push(Common { key, at, edges });
                if self.is_cut[side] {
                    found.on_edges.push((face.edges[k], key));
                }
            }
        }
        // Neighbours have their edge in common, and are not cut there.
        let n_shared = (0..3).filter(|k| shares(0, *k)).count();
        if common.len() >= 2 && common.len() > n_shared {
            self.draw(common, &heights, found);
        }
    }

    /// Lines between the common points: along the edges of either, and where the planes meet.
    fn draw(&self, common: &[Common], heights: &[[f64; 3]; 2], found: &mut Contacts) {
        let ends_along = |way: DVec3, edge: Option<(usize, usize)>| {
            let mut ends: Option<[(f64, Key); 2]> = None;
            for point in common {
                if edge.is_some_and(|(side, k)| point.edges[side] >> k & 1 == 0) {
                    continue;
                }
                let place = (point.at.dot(way), point.key);
                ends = Some(ends.map_or([place; 2], |[first, last]| {
                    [
                        if place < first { place } else { first },
                        if place > last { place } else { last },
                    ]
                }));
            }
            ends.map(|ends| ends.map(|(_, key)| key)).filter(|[first, last]| first != last)
        };
        for side in [0, 1] {
            // Edges of this face are lines across the other.
            let face = self.faces[side];
            for k in 0..3 {
                let way = face.corners[(k + 1) % 3] - face.corners[k];
                if let Some(ends) = ends_along(way, Some((side, k))) {
                    for cut in [1 - side, side] {
                        if self.is_cut[cut] {
                            found.across.push((self.numbers[cut], ends));
                        }
                    }
                }
            }
        }
        let is_coplanar =
            heights.iter().any(|of| of.iter().all(|height| height.abs() <= 2.0 * self.tolerance_m));
        if is_coplanar {
            return;
        }
        let way = self.faces[0].normal.cross(self.faces[1].normal);
        if let Some(ends) = ends_along(way, None) {
            for side in [0, 1] {
                if self.is_cut[side] {
                    found.across.push((self.numbers[side], ends));
                }
            }
        }
    }
}

/// Where a point lies.
pub(super) fn position(key: Key, faces: &[Face], lines: &Lines, positions: &[DVec3]) -> DVec3 {
    let segment = |edge: u32| lines.ends(edge).map(|vertex| positions[vertex as usize]);
    match key {
        [1, edge, face] => {
            let segment = segment(edge);
            let [from, to] = segment.map(|end| faces[face as usize].height(end));
            segment[0].lerp(segment[1], (from / (from - to)).clamp(0.0, 1.0))
        }
        [2, one, other] => {
            let first = segment(one);
            let second = segment(other);
            let (s, t) = closest(first, second).unwrap_or((0.5, 0.5));
            0.5 * (first[0].lerp(first[1], s) + second[0].lerp(second[1], t))
        }
        [_, vertex, _] => positions[vertex as usize],
    }
}
