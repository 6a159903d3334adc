//! Lids on what is left open in a border.
//!
//! Data in: triangles over common points. Data out: triangles that, with these, have as many in one
//! direction as in the other along every edge.
//!
//! What triangles leave open is always made of loops. Each is closed by the narrowest triangles that
//! it allows, one corner after the other, so that a sliver is closed by slivers. Cost: one pass over
//! the edges; quadratic in the length of a loop.

use std::collections::HashMap;

use glam::DVec3;

use crate::mesh::edges::edge_uses;

/// Lids.
#[derive(Debug, Default)]
pub(super) struct Lids {
    pub(super) triangles: Vec<[u32; 3]>,
    /// Edges of loops that had to be closed by triangles wider than allowed.
    pub(super) n_wide_edges: usize,
}

/// Closes what `triangles` leave open; triangles wider than `width_m` are counted.
pub(super) fn lids(triangles: &[[u32; 3]], positions: &[DVec3], width_m: f64) -> Lids {
    let mut lids = Lids::default();
    for rim in loops(unbalanced(triangles, positions.len())) {
        let n_edges = rim.len();
        if close(rim, positions, &mut lids.triangles) > width_m {
            lids.n_wide_edges += n_edges;
        }
    }
    lids
}

/// Edges along which more triangles run one way than the other, in that way and as often.
fn unbalanced(triangles: &[[u32; 3]], n_points: usize) -> Vec<[u32; 2]> {
    let uses = edge_uses(triangles, n_points);
    let mut edges = Vec::new();
    let mut add = |[low, high]: [u32; 2], balance: i32| {
        let edge = if balance > 0 { [low, high] } else { [high, low] };
        edges.extend((0..balance.unsigned_abs()).map(|_| edge));
    };
    for pair in uses.pairs.iter().filter(|pair| pair.same_direction) {
        let [a, b, c] = triangles[pair.triangles[0] as usize];
        let is_forward = [[a, b], [b, c], [c, a]].contains(&pair.edge);
        add(pair.edge, if is_forward { 2 } else { -2 });
    }
    for fan in &uses.fans {
        let ways = fan.triangles.iter().map(|(_, forward)| if *forward { 1 } else { -1 });
        add(fan.edge, ways.sum());
    }
    edges.sort_unstable();
    edges
}

/// Loops over all edges, which are sorted; as many end in each point as begin there.
fn loops(edges: Vec<[u32; 2]>) -> Vec<Vec<u32>> {
    let mut next: HashMap<u32, usize> = HashMap::new();
    for (place, [from, _]) in edges.iter().enumerate() {
        next.entry(*from).or_insert(place);
    }
    // Of each point, the first edge that was not taken yet.
    let mut take = |from: u32| {
        let place = next.get_mut(&from)?;
        let edge = edges.get(*place).filter(|edge| edge[0] == from)?;
        *place += 1;
        Some(edge[1])
    };
    let mut loops = Vec::new();
    for [start, _] in &edges {
        let mut path = vec![*start];
        while let Some(to) = path.last().and_then(|last| take(*last)) {
            match path.iter().rposition(|point| *point == to) {
                None => path.push(to),
                Some(place) => {
                    loops.push(path.drain(place..).collect());
                    path.push(to);
                }
            }
        }
    }
    loops
}

/// Closes a loop; the width of the widest triangle, m.
fn close(mut rim: Vec<u32>, positions: &[DVec3], triangles: &mut Vec<[u32; 3]>) -> f64 {
    let ear = |rim: &[u32], k: usize| {
        let n = rim.len();
        [rim[(k + n - 1) % n], rim[k], rim[(k + 1) % n]]
    };
    let width = |corners: [u32; 3]| {
        let [a, b, c] = corners.map(|point| positions[point as usize]);
        let longest = a.distance(b).max(b.distance(c)).max(c.distance(a));
        if longest > 0.0 { (b - a).cross(c - a).length() / longest } else { 0.0 }
    };
    let mut widest: f64 = 0.0;
    while rim.len() > 2 {
        let (best, narrowest) = (0..rim.len())
            .map(|k| (k, width(ear(&rim, k))))
            .fold((0, f64::INFINITY), |best, ear| if ear.1 < best.1 { ear } else { best });
        let [before, corner, after] = ear(&rim, best);
        triangles.push([after, corner, before]);
        widest = widest.max(narrowest);
        rim.remove(best);
    }
    widest
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::primitives::Shape;

    #[test]
    fn lids_close_whatever_was_taken_away() {
        let mesh = Shape::Sphere { radius_m: 1.0 }.tessellate(0.01);
        for step in [2, 3, 7, 100] {
            let mut triangles = mesh.triangles.clone();
            let mut place = 0;
            triangles.retain(|_| {
                place += 1;
                place % step != 0
            });
            let lids = lids(&triangles, &mesh.vertices, 1e-3);
            assert!(lids.n_wide_edges >= 3 && !lids.triangles.is_empty(), "{step}");
            triangles.extend(lids.triangles);
            assert!(unbalanced(&triangles, mesh.vertices.len()).is_empty(), "{step}");
        }
        assert!(lids(&mesh.triangles, &mesh.vertices, 1e-3).triangles.is_empty());
    }

    #[test]
    fn a_sliver_is_closed_by_slivers() {
        // A quadrangle of 10 by 1, one side of which has a corner 1e-6 off the line.
        let corners = [[0.0, 0.0], [4.0, 1e-6], [10.0, 0.0], [10.0, 1.0], [0.0, 1.0]];
        let positions = corners.map(|[x, y]| DVec3::new(x, y, 0.0));
        let triangles = [[0, 2, 3], [0, 3, 4], [1, 0, 4], [2, 1, 4], [3, 2, 4]];
        let lids = lids(&triangles, &positions, 1e-5);
        assert_eq!((lids.triangles.len(), lids.n_wide_edges), (1, 0));
        let closed = [&triangles[..], &lids.triangles].concat();
        assert!(unbalanced(&closed, 5).is_empty());
    }
}
