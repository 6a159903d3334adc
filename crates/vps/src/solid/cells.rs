//! What single triangles claim against all others, found by the cells of space between them.
//!
//! Data in: welded triangles that share edges, some of them repeated or turned round. Data out: those
//! that have to be left out or turned, so that the rest bounds bodies.
//!
//! The two sides of each triangle are joined with the nearest sides around its edges: what is joined
//! bounds one cell. Each triangle claims that the winding number falls by one from its back to its
//! front. Between two cells the number holds that contradicts the least area; where cells in a ring
//! contradict each other, the clearest claims hold. Then as many copies of each triangle are left as
//! the winding numbers beside it ask for.
//!
//! Surfaces that pass through each other away from their edges make cells that are none, and changes
//! that help nothing: [`Claims::against_m2`] tells whether they do.
//!
//! Cost: n log n in the triangles that are asked.
//!
//! # Source
//! Zhou2016, section 3, has the cells and their winding numbers, of surfaces without such errors.

use std::collections::{BTreeMap, HashMap, VecDeque};
use std::ops::Range;

use glam::DVec3;

use super::around_edge::around;
use crate::mesh::TriangleMesh;
use crate::mesh::edges::edge_uses;
use crate::sets::Sets;

/// Largest difference of winding numbers between neighbours that is considered.
const MOST: i32 = 3;

/// The part of its area that a triangle adds to what contradicts it for each step away from the sum
/// of its copies, where one copy would do: it decides where nothing else does.
const PREFERENCE: f64 = 1e-6;

/// Triangles with the same corners, in any order.
struct Facet {
    /// In rising order. Its back and its front are those of this order.
    corners: [u32; 3],
    /// Into the sorted copies.
    copies: Range<usize>,
    /// Copies that face as `corners`, and those that face the other way.
    n_alike: i32,
    n_opposite: i32,
    area_m2: f64,
    is_flat: bool,
}

impl Facet {
    fn sum(&self) -> i32 {
        self.n_alike - self.n_opposite
    }

    /// The area of the copies that contradict a fall of the winding number from back to front, m².
    fn against_m2(&self, fall: i32) -> f64 {
        let (low, high) = match (self.n_alike, self.n_opposite) {
            (n, 0) => (1, n),
            (0, n) => (-n, -1),
            (alike, opposite) => (-opposite, alike),
        };
        self.area_m2 * f64::from((low - fall).max(fall - high).max(0))
    }

    fn cost(&self, fall: i32) -> f64 {
        let from_sum = f64::from((fall - self.sum()).abs());
        self.against_m2(fall) + PREFERENCE * self.area_m2 * from_sum
    }
}

const BACK: u32 = 0;

fn side(facet: u32, which: u32) -> u32 {
    2 * facet + which
}

/// What has to happen to a triangle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Change {
    LeaveOut,
    Turn,
}

/// Triangles, and how the winding number changes across them.
pub(super) struct Claims {
    facets: Vec<Facet>,
    /// By facet: their numbers, and whether they face as the facet (1) or the other way (−1).
    copies: Vec<(u32, i32)>,
}

impl Claims {
    /// Of those with the numbers `asked`; `corners` of all.
    pub(super) fn of(mesh: &TriangleMesh, corners: &[[u32; 3]], asked: &[u32]) -> Self {
        let mut items: Vec<([u32; 3], u32)> = asked
            .iter()
            .map(|idx| {
                let mut corners = corners[*idx as usize];
                corners.sort_unstable();
                (corners, *idx)
            })
            .collect();
        items.sort_unstable();
        let mut facets: Vec<Facet> = Vec::new();
        let mut copies = Vec::with_capacity(items.len());
        for same in items.chunk_by(|one, other| one.0 == other.0) {
            let first = copies.len();
            copies.extend(same.iter().map(|(_, idx)| (*idx, way_round(corners[*idx as usize]))));
            let n_alike = copies[first..].iter().filter(|(_, way)| *way > 0).count() as i32;
            let [a, b, c] = same[0].0.map(|vertex| mesh.vertices[vertex as usize]);
            facets.push(Facet {
                corners: same[0].0,
                copies: first..copies.len(),
                n_alike,
                n_opposite: same.len() as i32 - n_alike,
                area_m2: 0.5 * (b - a).cross(c - a).length(),
                is_flat: is_flat([a, b, c]),
            });
        }
        Self { facets, copies }
    }

    /// What contradicts the bodies that were found, m²; `use_of` tells of a triangle whether it
    /// bounds one as it is (1), turned (−1), or not (0).
    pub(super) fn against_m2(&self, use_of: impl Fn(u32) -> i32) -> f64 {
        let against = self.facets.iter().map(|facet| {
            let copies = &self.copies[facet.copies.clone()];
            facet.against_m2(copies.iter().map(|(idx, way)| way * use_of(*idx)).sum())
        });
        against.sum()
    }

    /// What has to be changed so that the triangles say of each cell what most of them say.
    pub(super) fn changes(&self, mesh: &TriangleMesh) -> Vec<(u32, Change)> {
        // In a file whose bodies face inward, those that touch overlap.
        let falls = [true, false].map(|touch| {
            let cells = Cells::of(mesh, self, touch);
            let windings = cells.windings(&self.facets);
            let falls: Vec<Option<i32>> = (0..self.facets.len() as u32)
                .map(|facet| {
                    let [back, front] = cells.beside(facet);
                    (back != front).then(|| windings[back] - windings[front])
                })
                .collect();
            let against = self.facets.iter().zip(&falls);
            let against_m2 = against.map(|(facet, fall)| facet.against_m2(fall.unwrap_or(0)));
            (against_m2.sum::<f64>(), falls)
        });
        let [touching, overlapping] = falls;
        let (_, falls) = if touching.0 <= overlapping.0 { touching } else { overlapping };
        let mut changes = Vec::new();
        for (facet, fall) in self.facets.iter().zip(falls) {
            let Some(mut excess) = fall.map(|fall| facet.sum() - fall) else { continue };
            for (idx, way) in &self.copies[facet.copies.clone()] {
                if *way != excess.signum() {
                    continue;
                }
                if excess % 2 == 0 {
                    changes.push((*idx, Change::Turn));
                    excess -= 2 * way;
                } else {
                    changes.push((*idx, Change::LeaveOut));
                    excess -= way;
                }
            }
        }
        changes
    }
}

/// A triangle lower than this part of its longest edge lies in no plane.
const FLAT_SHARE: f64 = 1e-6;

fn is_flat([a, b, c]: [DVec3; 3]) -> bool {
    let longest = (b - a).length_squared().max((c - b).length_squared());
    (b - a).cross(c - a).length() < FLAT_SHARE * longest.max((a - c).length_squared())
}

struct Cells {
    /// `[2 * n_facets]`: the cell of the back and of the front of each facet.
    cell_of: Vec<u32>,
    /// `[n_cells]`: of the component around all others.
    is_outer: Vec<bool>,
}

impl Cells {
    /// `touch`: bodies whose faces lie on each other touch there; they overlap otherwise.
    fn of(mesh: &TriangleMesh, claims: &Claims, touch: bool) -> Self {
        let Claims { facets, copies } = claims;
        let corners: Vec<[u32; 3]> = facets.iter().map(|facet| facet.corners).collect();
        let uses = edge_uses(&corners, mesh.vertices.len());
        let mut sides = Sets::new(2 * facets.len());
        let mut components = Sets::new(facets.len());
        // Of sorted corners, only the edge of the first and the last runs back. Turning about an
        // edge from low to high, one comes to the back of what runs forward.
        let runs_forward = |facet: u32, edge: [u32; 2]| {
            let [first, _, last] = facets[facet as usize].corners;
            edge != [first, last]
        };
        let mut join = |edge: [u32; 2], from: u32, to: u32| {
            let leaves = side(from, u32::from(runs_forward(from, edge)));
            let enters = side(to, u32::from(!runs_forward(to, edge)));
            sides.join(leaves, enters);
            components.join(from, to);
        };
        let mut neighbours: HashMap<(u32, [u32; 2]), u32> = HashMap::new();
        for pair in &uses.pairs {
            let [one, other] = pair.triangles;
            for (of, next) in [(one, other), (other, one)] {
                if facets[of as usize].is_flat {
                    neighbours.insert((of, pair.edge), next);
                }
            }
            join(pair.edge, one, other);
            join(pair.edge, other, one);
        }
        for fan in &uses.fans {
            let far = |facet: u32| far_corner(facets, &neighbours, facet, fan.edge);
            let order: Vec<u32> = match around(mesh, fan.edge, &fan.triangles, far) {
                None => fan.triangles.iter().map(|(facet, _)| *facet).collect(),
                Some(mut walls) => {
                    // Of bodies in each other, whose faces lie on each other, the one that comes
                    // first in the file is the innermost.
                    walls.sort_by_key(|wall| {
                        let facet = &facets[wall.triangle as usize];
                        let ends = facet.sum().signum() * if wall.ends { 1 } else { -1 };
                        let first = i64::from(copies[facet.copies.start].0);
                        let place = if touch { -ends } else { ends };
                        (wall.plane, place, if ends > 0 { first } else { -first })
                    });
                    walls.iter().map(|wall| wall.triangle).collect()
                }
            };
            for k in 0..order.len() {
                join(fan.edge, order[k], order[(k + 1) % order.len()]);
            }
        }

        let mut numbers = vec![u32::MAX; 2 * facets.len()];
        let mut component_of = Vec::new();
        let mut volumes = Vec::new();
        let mut cell_of = Vec::with_capacity(2 * facets.len());
        for place in 0..2 * facets.len() as u32 {
            let lowest = sides.lowest(place) as usize;
            if numbers[lowest] == u32::MAX {
                numbers[lowest] = volumes.len() as u32;
                volumes.push(0.0);
                component_of.push(components.lowest(place / 2));
            }
            let cell = numbers[lowest];
            cell_of.push(cell);
            // From a corner of the component: far from it the sum would lose digits.
            let origin = facets[components.lowest(place / 2) as usize].corners[0];
            let [a, b, c] = facets[place as usize / 2]
                .corners
                .map(|vertex| mesh.vertices[vertex as usize] - mesh.vertices[origin as usize]);
            let sign = if place % 2 == BACK { 1.0 } else { -1.0 };
            volumes[cell as usize] += sign * a.dot(b.cross(c));
        }
        // The cell around a component has the negative of what the others have.
        let mut outer: BTreeMap<u32, usize> = BTreeMap::new();
        for (cell, component) in component_of.iter().enumerate() {
            let least = outer.entry(*component).or_insert(cell);
            if volumes[cell] < volumes[*least] {
                *least = cell;
            }
        }
        let mut is_outer = vec![false; volumes.len()];
        outer.values().for_each(|cell| is_outer[*cell] = true);
        Self { cell_of, is_outer }
    }

    /// The cells behind and in front of a facet.
    fn beside(&self, facet: u32) -> [usize; 2] {
        [0, 1].map(|which| self.cell_of[side(facet, which) as usize] as usize)
    }

    /// `[n_cells]`: the winding number of each; 0 outside.
    fn windings(&self, facets: &[Facet]) -> Vec<i32> {
        const N: usize = 2 * MOST as usize + 1;
        let mut costs: BTreeMap<[usize; 2], [f64; N]> = BTreeMap::new();
        for (number, facet) in (0..).zip(facets) {
            let [back, front] = self.beside(number);
            if back == front {
                continue;
            }
            let sign = if back < front { 1 } else { -1 };
            let of_pair = costs.entry([back.min(front), back.max(front)]).or_default();
            for (cost, fall) in of_pair.iter_mut().zip(-MOST..) {
                *cost += facet.cost(sign * fall);
            }
        }
        // The clearest first: how much more area contradicts the second best.
        let mut claims: Vec<(f64, [usize; 2], i32)> = costs
            .into_iter()
            .map(|(pair, costs)| {
                let best = (0..N).fold(0, |best, k| if costs[k] < costs[best] { k } else { best });
                let others = (0..N).filter(|k| *k != best).map(|k| costs[k]);
                let second = others.fold(f64::INFINITY, f64::min);
                (second - costs[best], pair, best as i32 - MOST)
            })
            .collect();
        claims.sort_by(|one, other| other.0.total_cmp(&one.0).then(one.1.cmp(&other.1)));
        let mut joined = Sets::new(self.is_outer.len());
        let mut neighbours: Vec<Vec<(usize, i32)>> = vec![Vec::new(); self.is_outer.len()];
        for (_, [one, other], fall) in claims {
            if joined.lowest(one as u32) != joined.lowest(other as u32) {
                joined.join(one as u32, other as u32);
                neighbours[one].push((other, -fall));
                neighbours[other].push((one, fall));
            }
        }
        let mut windings = vec![None; self.is_outer.len()];
        let outer = (0..self.is_outer.len()).filter(|cell| self.is_outer[*cell]);
        let mut queue: VecDeque<(usize, i32)> = outer.map(|cell| (cell, 0)).collect();
        while let Some((cell, winding)) = queue.pop_front() {
            if windings[cell].is_none() {
                windings[cell] = Some(winding);
                queue.extend(neighbours[cell].iter().map(|(next, rise)| (*next, winding + rise)));
            }
        }
        windings.into_iter().map(Option::unwrap_or_default).collect()
    }
}

/// The corner that says where a facet lies beside an edge: of a flat one, that of what lies beyond.
fn far_corner(
    facets: &[Facet],
    neighbours: &HashMap<(u32, [u32; 2]), u32>,
    mut facet: u32,
    mut edge: [u32; 2],
) -> Option<u32> {
    // As many flat ones may follow each other.
    const MOST_FLAT: usize = 64;
    for _ in 0..MOST_FLAT {
        let Facet { corners: [a, b, c], is_flat, .. } = facets[facet as usize];
        if !is_flat {
            break;
        }
        let others = [[a, b], [b, c], [a, c]].into_iter().filter(|other| *other != edge);
        let mut next = others.filter_map(|other| Some((*neighbours.get(&(facet, other))?, other)));
        match next.next() {
            Some(found) => (facet, edge) = found,
            None => break,
        }
    }
    facets[facet as usize].corners.into_iter().find(|corner| !edge.contains(corner))
}

/// +1 when the corners rise in the order of the triangle, −1 when they fall.
pub(super) fn way_round([a, b, c]: [u32; 3]) -> i32 {
    // Of the three steps, one falls when the corners rise and two when they fall.
    let n_falls = [a > b, b > c, c > a].into_iter().filter(|falls| *falls).count();
    if n_falls == 1 { 1 } else { -1 }
}
