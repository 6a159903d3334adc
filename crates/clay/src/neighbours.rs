//! Which samples are near a point: a balanced k-d tree with tight boxes.
//!
//! Invariant: answers depend on the positions alone, never on the shape of the tree or the number
//! of threads; of equally near samples the one with the lower number comes first. Cost: building
//! O(n log n), in parallel; looking up O(log n) near the samples, and little more far away, as
//! every node knows the box around its own samples.

use std::ops::Range;

use glam::DVec3;

/// Samples in a leaf at most.
const LEAF: usize = 8;
/// Parts with more samples are built by threads of their own.
const PARALLEL_FROM: usize = 4096;
/// No tree of 2³² samples is deeper.
const DEEPEST: usize = 40;

/// A sample and how far it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Neighbour {
    /// Number of the sample.
    pub sample: u32,
    /// Squared distance, m².
    pub distance_squared_m2: f64,
}

impl Neighbour {
    /// Nearer ones come first.
    fn key(&self) -> (f64, u32) {
        (self.distance_squared_m2, self.sample)
    }

    fn is_before(&self, other: &Self) -> bool {
        self.key() < other.key()
    }
}

#[derive(Clone, Copy, Debug)]
struct Box3 {
    low: DVec3,
    high: DVec3,
}

impl Box3 {
    const EMPTY: Self = Self { low: DVec3::INFINITY, high: DVec3::NEG_INFINITY };

    fn distance_squared(&self, point: DVec3) -> f64 {
        (point - point.clamp(self.low, self.high)).length_squared()
    }
}

/// Where samples are. Changes with none of them: it is built again.
#[derive(Clone, Debug, Default)]
pub struct Neighbours {
    /// `[n]`, in the order of the leaves.
    positions: Vec<DVec3>,
    /// `[n]`, numbers of those samples.
    samples: Vec<u32>,
    /// `[2^(depth + 1) − 1]`: children of node k are 2k + 1 and 2k + 2; each has half of its
    /// parent's samples.
    boxes: Vec<Box3>,
}

impl Neighbours {
    /// Sorts finite positions into a tree.
    pub fn new(positions: &[DVec3]) -> Self {
        let mut sorted: Vec<(DVec3, u32)> = positions.iter().copied().zip(0..).collect();
        let n_leaves = positions.len().div_ceil(LEAF).next_power_of_two();
        let mut boxes = vec![Box3::EMPTY; 2 * n_leaves - 1];
        // Nodes of one subtree are not next to each other, so each thread fills arrays of its own.
        for (node, bounds) in build(&mut sorted, 0, n_leaves) {
            boxes[node] = bounds;
        }
        let (positions, samples) = sorted.into_iter().unzip();
        Self { positions, samples, boxes }
    }

    /// The nearest sample; `None` when there are none.
    pub(super) fn nearest(&self, point: DVec3) -> Option<Neighbour> {
        let mut best = Neighbour { sample: u32::MAX, distance_squared_m2: f64::INFINITY };
        self.walk(
            point,
            &mut best,
            |best| best.distance_squared_m2,
            |best, found| {
                if found.is_before(best) {
                    *best = found;
                }
            },
        );
        (best.sample != u32::MAX).then_some(best)
    }

    /// The `n` nearest samples, nearest first; fewer when there are fewer. `found` is emptied
    /// first.
    pub fn nearest_n(&self, point: DVec3, n: usize, found: &mut Vec<Neighbour>) {
        found.clear();
        if n == 0 {
            return;
        }
        self.walk(
            point,
            found,
            |found| if found.len() < n { f64::INFINITY } else { found[n - 1].distance_squared_m2 },
            |found, new| {
                if found.len() == n {
                    if !new.is_before(&found[n - 1]) {
                        return;
                    }
                    found.pop();
                }
                let place =
                    found.iter().rposition(|old| old.is_before(&new)).map_or(0, |place| place + 1);
                found.insert(place, new);
            },
        );
    }

    /// Every sample within a distance, in ascending order of their numbers. `found` is emptied
    /// first.
    pub fn within(&self, point: DVec3, distance_m: f64, found: &mut Vec<Neighbour>) {
        found.clear();
        let most_m2 = distance_m * distance_m;
        self.walk(
            point,
            found,
            |_| most_m2,
            |found, new| {
                if new.distance_squared_m2 <= most_m2 {
                    found.push(new);
                }
            },
        );
        found.sort_unstable_by_key(|neighbour| neighbour.sample);
    }

    /// Every sample whose ball has the point in it, and some others, in ascending order of their
    /// numbers. `reaches_m`: of each node, the largest radius of a ball of its samples. `found` is
    /// emptied first. Cost: that of the balls around the point, whatever the others are.
    pub(super) fn covering(&self, point: DVec3, reaches_m: &[f64], found: &mut Vec<Neighbour>) {
        found.clear();
        if !point.is_finite() {
            return;
        }
        self.descend(|node, range| {
            let most_m2 = reaches_m[node] * reaches_m[node];
            let is_reached =
                !range.is_empty() && self.boxes[node].distance_squared(point) <= most_m2;
            if is_reached && self.is_leaf(node) {
                let near = self.positions[range.clone()].iter().zip(&self.samples[range]);
                let near = near.map(|(position, sample)| Neighbour {
                    sample: *sample,
                    distance_squared_m2: position.distance_squared(point),
                });
                found.extend(near.filter(|near| near.distance_squared_m2 <= most_m2));
            }
            is_reached
        });
        found.sort_unstable_by_key(|neighbour| neighbour.sample);
    }

    /// Numbers of the samples in the order of the leaves.
    pub(super) fn samples(&self) -> &[u32] {
        &self.samples
    }

    /// Positions in that order, m.
    pub(super) fn positions(&self) -> &[DVec3] {
        &self.positions
    }

    /// Number of nodes of the tree.
    pub(super) fn n_nodes(&self) -> usize {
        self.boxes.len()
    }

    /// The node has no children.
    pub(super) fn is_leaf(&self, node: usize) -> bool {
        node >= self.boxes.len() / 2
    }

    /// Shows nodes from the root on, with the places of their samples, and the children of those
    /// for which `visit` is true.
    pub(super) fn descend(&self, mut visit: impl FnMut(usize, Range<usize>) -> bool) {
        if self.boxes.is_empty() {
            return;
        }
        let mut stack = [(0_usize, 0_usize, 0_usize); DEEPEST];
        stack[0] = (0, 0, self.positions.len());
        let mut depth = 1;
        while depth > 0 {
            depth -= 1;
            let (node, begin, end) = stack[depth];
            if visit(node, begin..end) && !self.is_leaf(node) {
                let middle = begin.midpoint(end);
                stack[depth] = (2 * node + 2, middle, end);
                stack[depth + 1] = (2 * node + 1, begin, middle);
                depth += 2;
            }
        }
    }

    /// Shows every node that has samples: its number, their places, and the corners of the box
    /// around them.
    pub(super) fn for_each_node(&self, mut see: impl FnMut(usize, Range<usize>, DVec3, DVec3)) {
        self.descend(|node, range| {
            let has_samples = !range.is_empty();
            if has_samples {
                see(node, range, self.boxes[node].low, self.boxes[node].high);
            }
            has_samples
        });
    }

    /// Shows every sample that is not farther than `reach` says, nearer boxes first.
    fn walk<T>(
        &self,
        point: DVec3,
        state: &mut T,
        reach: impl Fn(&T) -> f64,
        mut take: impl FnMut(&mut T, Neighbour),
    ) {
        if self.positions.is_empty() || !point.is_finite() {
            return;
        }
        let mut stack = [(0_usize, 0_usize, 0_usize, 0.0_f64); DEEPEST];
        stack[0] = (0, 0, self.positions.len(), self.boxes[0].distance_squared(point));
        let mut depth = 1;
        while depth > 0 {
            depth -= 1;
            let (mut node, mut begin, mut end, distance) = stack[depth];
            if distance > reach(state) {
                continue;
            }
            while !self.is_leaf(node) {
                let middle = begin.midpoint(end);
                let [left, right] = [2 * node + 1, 2 * node + 2]
                    .map(|child| self.boxes[child].distance_squared(point));
                let near = (2 * node + 1, begin, middle, left);
                let far = (2 * node + 2, middle, end, right);
                let (near, far) = if right < left { (far, near) } else { (near, far) };
                stack[depth] = far;
                depth += 1;
                (node, begin, end, _) = near;
            }
            for (position, sample) in
                self.positions[begin..end].iter().zip(&self.samples[begin..end])
            {
                take(
                    state,
                    Neighbour {
                        sample: *sample,
                        distance_squared_m2: position.distance_squared(point),
                    },
                );
            }
        }
    }
}

/// Sorts the part under a node that has `n_leaves` leaves; gives the boxes of all its nodes.
fn build(part: &mut [(DVec3, u32)], node: usize, n_leaves: usize) -> Vec<(usize, Box3)> {
    let around = |bounds: Box3, (position, _): &(DVec3, u32)| Box3 {
        low: bounds.low.min(*position),
        high: bounds.high.max(*position),
    };
    let bounds = part.iter().fold(Box3::EMPTY, around);
    if n_leaves == 1 {
        return vec![(node, bounds)];
    }
    let extent = bounds.high - bounds.low;
    let axis = if extent.x >= extent.y && extent.x >= extent.z {
        0
    } else if extent.y >= extent.z {
        1
    } else {
        2
    };
    let is_parallel = part.len() > PARALLEL_FROM;
    // The same middle as in the walk, from any beginning.
    let middle = part.len() / 2;
    if middle < part.len() {
        part.select_nth_unstable_by(middle, |(a, i), (b, j)| {
            a[axis].total_cmp(&b[axis]).then(i.cmp(j))
        });
    }
    let (low, high) = part.split_at_mut(middle);
    let left = 2 * node + 1;
    let right = 2 * node + 2;
    let (mut boxes, more) = if is_parallel {
        rayon::join(|| build(low, left, n_leaves / 2), || build(high, right, n_leaves / 2))
    } else {
        (build(low, left, n_leaves / 2), build(high, right, n_leaves / 2))
    };
    boxes.extend(more);
    boxes.push((node, bounds));
    boxes
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Scattered, on a grid with many equal coordinates, on a line, and all at one place.
    fn clouds() -> Vec<Vec<DVec3>> {
        let scattered = |k: i32| {
            DVec3::new(
                (f64::from(k) * 12.9).sin(),
                (f64::from(k) * 78.2).sin(),
                (f64::from(k) * 37.7).sin(),
            )
        };
        vec![
            (0..700).map(scattered).collect(),
            (0..600).map(|k| DVec3::new(f64::from(k % 25), f64::from(k / 25), 0.0) * 0.1).collect(),
            (0..100).map(|k| DVec3::X * f64::from(k) * 0.02).collect(),
            vec![DVec3::splat(0.3); 90],
            vec![DVec3::ONE; 1],
            Vec::new(),
        ]
    }

    #[test]
    fn answers_are_those_of_a_search_through_all() {
        for positions in clouds() {
            let near = Neighbours::new(&positions);
            let mut found = Vec::new();
            for k in 0..200 {
                let at =
                    DVec3::new(f64::from(k % 6), f64::from(k / 6 % 6), f64::from(k / 36) - 1.0)
                        * 0.37
                        - 0.4;
                let mut all: Vec<Neighbour> = (0..)
                    .zip(&positions)
                    .map(|(sample, position)| Neighbour {
                        sample,
                        distance_squared_m2: position.distance_squared(at),
                    })
                    .collect();
                all.sort_by(|a, b| a.key().partial_cmp(&b.key()).unwrap());
                assert_eq!(near.nearest(at), all.first().copied());
                for n in [0, 1, 7, 24, 1000] {
                    near.nearest_n(at, n, &mut found);
                    assert_eq!(found, all[..n.min(all.len())], "{at}");
                }
                near.within(at, 0.8, &mut found);
                let mut within: Vec<Neighbour> = all
                    .into_iter()
                    .filter(|other| other.distance_squared_m2 <= 0.8 * 0.8)
                    .collect();
                within.sort_by_key(|other| other.sample);
                assert_eq!(found, within, "{at}");
            }
            assert_eq!(near.nearest(DVec3::NAN), None);
        }
    }
}
