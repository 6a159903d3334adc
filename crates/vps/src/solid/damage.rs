//! Single triangles that stand once too often or face the wrong way.
//!
//! Data in: welded triangles. Data out: those that have to be left out or turned, so that along
//! every edge as many run one way as the other.
//!
//! So it is in closed pieces, however they touch, overlap or repeat each other. A triangle that was
//! repeated or turned afterwards leaves a rest in its three edges, and no other triangle leaves it
//! there. For edges with a rest that share vertices, the fewest changes are searched that leave
//! none in any of them, and of these the ones with the least area; where that takes too many, those
//! that take away the rest of one edge and leave none in the edges of what they change. What has a
//! rest that few changes do not take away, as the rim of a hole, stays. In a file where no more
//! than two triangles share an edge, their areas tell which are turned, and nothing is changed here.
//!
//! Cost: linear in the edges with a rest; [`MOST_STEPS`] bounds the search.
//!
//! # Source
//! Chains and their boundaries, as in Munkres1984, section 5: a file is a chain with whole numbers,
//! and the changes are a small one with the same boundary.

use std::collections::{BTreeMap, HashMap};

use crate::mesh::TriangleMesh;
use crate::mesh::edges::EdgeUses;
use crate::sets::Sets;

/// So many triangles that share edges are changed together at most.
const MOST_CHANGES: usize = 8;

/// So many steps are tried for edges that share vertices, and from one edge, for each number of
/// changes.
const STEPS_PER_GROUP: usize = 20_000;
const STEPS_PER_EDGE: usize = 1000;

/// So many steps are tried in a file: a second or two.
const MOST_STEPS: usize = 1_000_000;

/// What has to happen to a triangle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Change {
    LeaveOut,
    Turn,
}

impl Change {
    /// What it takes away in each edge of the triangle.
    fn share(self) -> i32 {
        match self {
            Self::LeaveOut => 1,
            Self::Turn => 2,
        }
    }
}

/// Triangles with the same corners, in any order.
struct Facet {
    /// In rising order.
    corners: [u32; 3],
    /// Triangles that face as `corners`, and those that face the other way, in rising order; none
    /// that is changed.
    copies: [Vec<u32>; 2],
    area_m2: f64,
}

impl Facet {
    /// Its edges, lower vertex first, and 1 where `corners` run along it, −1 where they run back.
    fn edges(&self) -> [([u32; 2], i32); 3] {
        let [a, b, c] = self.corners;
        [([a, b], 1), ([b, c], 1), ([a, c], -1)]
    }

    fn n_copies(&self) -> usize {
        self.copies[0].len() + self.copies[1].len()
    }
}

/// What has to be changed in `triangles`; `uses` are those of their edges.
pub(super) fn changes(
    mesh: &TriangleMesh,
    triangles: &[[u32; 3]],
    uses: &EdgeUses,
) -> Vec<(u32, Change)> {
    if uses.fans.iter().all(|fan| fan.triangles.len() == 1) {
        return Vec::new();
    }
    let mut starts = Vec::new();
    let mut rests = HashMap::new();
    let mut asked: Vec<u32> = Vec::new();
    for fan in &uses.fans {
        let rest: i32 = fan.triangles.iter().map(|(_, way)| if *way { 1 } else { -1 }).sum();
        if rest != 0 {
            starts.push(fan.edge);
            rests.insert(fan.edge, rest);
            asked.extend(fan.triangles.iter().map(|(triangle, _)| triangle));
        }
    }
    for pair in uses.pairs.iter().filter(|pair| pair.same_direction) {
        let corners = triangles[pair.triangles[0] as usize];
        let is_forward = (0..3).any(|k| [corners[k], corners[(k + 1) % 3]] == pair.edge);
        starts.push(pair.edge);
        rests.insert(pair.edge, if is_forward { 2 } else { -2 });
        asked.extend(pair.triangles);
    }
    let facets = facets_of(mesh, triangles, asked);
    let mut at: HashMap<[u32; 2], Vec<u32>> = HashMap::new();
    for (number, facet) in (0..).zip(&facets) {
        facet.edges().iter().for_each(|(edge, _)| at.entry(*edge).or_default().push(number));
    }
    let mut search =
        Search { facets, at, rests, wanted: Vec::new(), steps: Vec::new(), n_left: 0, best: None };
    let mut n_left = MOST_STEPS;
    let mut changes = Vec::new();
    let alone: Vec<_> = starts.iter().map(|start| vec![*start]).collect();
    for (groups, n_steps) in [(groups(&starts), STEPS_PER_GROUP), (alone, STEPS_PER_EDGE)] {
        let mut groups = groups;
        // What takes few changes is the most certain, and comes first.
        for n_changes in 1..=MOST_CHANGES {
            for group in &groups {
                search.n_left = n_left.min(n_steps);
                n_left -= search.n_left;
                let steps = search.fewest(group, n_changes);
                n_left += search.n_left;
                changes.extend(steps.iter().map(|step| (step.triangle, step.change)));
                if n_left == 0 {
                    return changes;
                }
            }
            groups.retain(|group| group.iter().any(|edge| search.rests[edge] != 0));
        }
    }
    changes
}

/// Edges that share vertices, directly or by others, and are few enough that as many changes as are
/// tried can take away all their rests.
fn groups(edges: &[[u32; 2]]) -> Vec<Vec<[u32; 2]>> {
    let mut number_of = HashMap::new();
    for edge in edges {
        for vertex in edge {
            let next = number_of.len() as u32;
            number_of.entry(*vertex).or_insert(next);
        }
    }
    let mut sets = Sets::new(number_of.len());
    edges.iter().for_each(|[a, b]| sets.join(number_of[a], number_of[b]));
    let mut by_set: BTreeMap<u32, Vec<[u32; 2]>> = BTreeMap::new();
    for edge in edges {
        by_set.entry(sets.lowest(number_of[&edge[0]])).or_default().push(*edge);
    }
    by_set.into_values().filter(|group| group.len() <= 3 * MOST_CHANGES).collect()
}

fn facets_of(mesh: &TriangleMesh, triangles: &[[u32; 3]], mut asked: Vec<u32>) -> Vec<Facet> {
    let sorted = |triangle: u32| {
        let mut corners = triangles[triangle as usize];
        corners.sort_unstable();
        corners
    };
    asked.sort_unstable_by_key(|triangle| (sorted(*triangle), *triangle));
    asked.dedup();
    let facets = asked.chunk_by(|one, other| sorted(*one) == sorted(*other)).map(|same| {
        let corners = sorted(same[0]);
        let [a, b, c] = corners.map(|vertex| mesh.vertices[vertex as usize]);
        let mut copies = [Vec::new(), Vec::new()];
        for triangle in same {
            let way = way_round(triangles[*triangle as usize]);
            copies[usize::from(way < 0)].push(*triangle);
        }
        Facet { corners, copies, area_m2: 0.5 * (b - a).cross(c - a).length() }
    });
    facets.collect()
}

/// A search for the fewest changes that take a rest away.
struct Search {
    facets: Vec<Facet>,
    /// The facets of each edge.
    at: HashMap<[u32; 2], Vec<u32>>,
    /// How many more triangles run along an edge than back.
    rests: HashMap<[u32; 2], i32>,
    /// Edges that have to end without one.
    wanted: Vec<[u32; 2]>,
    steps: Vec<Step>,
    /// Steps that may still be tried.
    n_left: usize,
    /// Area of the changes, m², and they.
    best: Option<(f64, Vec<Step>)>,
}

#[derive(Clone, Copy)]
struct Step {
    facet: u32,
    triangle: u32,
    /// Which way it faces: into the copies.
    side: usize,
    change: Change,
}

impl Search {
    /// Makes so many changes that take the rests of these edges away and leave none elsewhere, if
    /// there are such.
    fn fewest(&mut self, wanted: &[[u32; 2]], n_changes: usize) -> Vec<Step> {
        self.wanted = wanted.to_vec();
        if wanted.iter().any(|edge| self.rests[edge] != 0) {
            self.search(n_changes);
        }
        let steps = self.best.take().map(|(_, steps)| steps).unwrap_or_default();
        steps.iter().for_each(|step| self.make(*step));
        steps
    }

    fn search(&mut self, n_changes: usize) {
        let of_steps = self.steps.iter().flat_map(|step| self.facets[step.facet as usize].edges());
        let edges = of_steps.map(|(edge, _)| edge).chain(self.wanted.iter().copied());
        let mut open: Vec<([u32; 2], i32)> = edges
            .map(|edge| (edge, self.rests.get(&edge).copied().unwrap_or_default()))
            .filter(|(_, rest)| *rest != 0)
            .collect();
        open.sort_unstable();
        open.dedup();
        let Some((edge, rest)) = open.first().copied() else {
            let area = |step: &Step| {
                self.facets[step.facet as usize].area_m2 * f64::from(step.change.share())
            };
            let area_m2 = self.steps.iter().map(area).sum();
            if self.best.as_ref().is_none_or(|(least_m2, _)| area_m2 < *least_m2) {
                self.best = Some((area_m2, self.steps.clone()));
            }
            return;
        };
        let sum: i32 = open.iter().map(|(_, rest)| rest.abs()).sum();
        if sum as usize > 3 * Change::Turn.share() as usize * n_changes {
            return;
        }
        // Only what is left out makes an odd rest even, and one of the copies has to stay.
        let has_copies = |facet: &u32| self.facets[*facet as usize].n_copies() > 1;
        if rest % 2 != 0 && !self.at[&edge].iter().any(has_copies) {
            return;
        }
        // Some triangle that is changed runs along this edge in the direction that is too many.
        for place in 0..self.at[&edge].len() {
            let facet = self.at[&edge][place];
            let of = &self.facets[facet as usize];
            let is_along = of.edges().contains(&(edge, rest.signum()));
            let side = usize::from(!is_along);
            // The last in the file, which most likely was added.
            let Some(triangle) = of.copies[side].last().copied() else { continue };
            let first = if of.n_copies() > 1 { Some(Change::LeaveOut) } else { None };
            for change in first.into_iter().chain([Change::Turn]) {
                if self.n_left == 0 {
                    return;
                }
                self.n_left -= 1;
                let step = Step { facet, triangle, side, change };
                self.make(step);
                self.steps.push(step);
                self.search(n_changes - 1);
                self.steps.pop();
                self.undo(step);
            }
        }
    }

    fn make(&mut self, step: Step) {
        self.facets[step.facet as usize].copies[step.side].pop();
        self.add(step, -step.change.share());
    }

    fn undo(&mut self, step: Step) {
        self.facets[step.facet as usize].copies[step.side].push(step.triangle);
        self.add(step, step.change.share());
    }

    /// Adds copies of a triangle to the rests.
    fn add(&mut self, step: Step, n: i32) {
        let n = if step.side == 0 { n } else { -n };
        for (edge, way) in self.facets[step.facet as usize].edges() {
            *self.rests.entry(edge).or_default() += way * n;
        }
    }
}

/// +1 when the corners rise in the order of the triangle, −1 when they fall.
pub(super) fn way_round([a, b, c]: [u32; 3]) -> i32 {
    // Of the three steps, one falls when the corners rise and two when they fall.
    let n_falls = [a > b, b > c, c > a].into_iter().filter(|falls| *falls).count();
    if n_falls == 1 { 1 } else { -1 }
}
