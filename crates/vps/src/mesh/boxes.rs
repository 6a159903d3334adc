//! A tree of boxes: which of them meet a given box, or a ray, or are nearest to a point.
//!
//! Data in: the boxes. Data out: their numbers. The tree halves the boxes at the median of their
//! centres, level by level and in parallel; ties go by number, so it is the same for any number of
//! threads. Cost: O(n log n) to build, O(log n + found) to ask.

use core::ops::Range;

use glam::DVec3;

use crate::halving::{Site, halve};
use crate::parallel;

/// Boxes of a leaf, at most.
const LEAF: usize = 4;

/// Boxes, sorted.
#[derive(Debug, Default)]
pub(crate) struct Boxes {
    /// Of a complete binary tree: the halves of node `k` are `2 k + 1` and `2 k + 2`.
    nodes: Vec<Node>,
    /// By leaf.
    items: Vec<Item>,
    n_inner: usize,
}

#[derive(Clone, Copy, Debug, Default)]
struct Node {
    low: DVec3,
    high: DVec3,
    first: u32,
    end: u32,
}

#[derive(Clone, Copy, Debug, Default)]
struct Item {
    low: DVec3,
    high: DVec3,
    number: u32,
}

impl Boxes {
    /// Boxes `0..n`, from their lowest to their highest corners.
    pub(crate) fn new(n: usize, box_of: impl Fn(usize) -> (DVec3, DVec3) + Sync) -> Self {
        let boxes: Vec<(DVec3, DVec3)> = parallel::map(n, 64, box_of);
        let around = |boxes: &mut dyn Iterator<Item = (DVec3, DVec3)>| {
            boxes.fold(EMPTY, |(low, high), one| (one.0.min(low), one.1.max(high)))
        };
        let (low, high) = around(&mut boxes.iter().copied());
        let mut sites = parallel::map(n, 64, |number| {
            let (one, other) = boxes[number];
            // About the middle: single precision is enough to sort by.
            Site::new(((one - low) - (high - other)).as_vec3(), number as u32)
        });
        let mut depth = 0;
        while n > LEAF << depth {
            depth += 1;
        }
        halve(&mut sites, &|n, level| (level < depth).then_some(n / 2));
        let items: Vec<Item> = parallel::map(n, 64, |place| {
            let number = sites[place].idx;
            let (low, high) = boxes[number as usize];
            Item { low, high, number }
        });
        let mut ranges: Vec<Range<usize>> = std::iter::once(0..n).collect();
        for _ in 0..depth {
            let halves = ranges.into_iter().flat_map(|range| {
                let middle = range.start + range.len() / 2;
                [range.start..middle, middle..range.end]
            });
            ranges = halves.collect();
        }
        let n_inner = (1 << depth) - 1;
        let mut nodes = vec![Node::default(); n_inner];
        nodes.extend(parallel::map(ranges.len(), 16, |leaf| {
            let range = ranges[leaf].clone();
            let (low, high) = around(&mut items[range.clone()].iter().map(|at| (at.low, at.high)));
            Node { low, high, first: range.start as u32, end: range.end as u32 }
        }));
        for node in (0..n_inner).rev() {
            let one = nodes[2 * node + 1];
            let other = nodes[2 * node + 2];
            nodes[node] = Node {
                low: one.low.min(other.low),
                high: one.high.max(other.high),
                first: one.first,
                end: other.end,
            };
        }
        Self { nodes, items, n_inner }
    }

    /// Calls `found` with the number of every box that meets the box from `low` to `high`.
    pub(crate) fn meeting(&self, low: DVec3, high: DVec3, found: impl FnMut(u32)) {
        self.visit(
            |box_low, box_high| box_low.cmple(high).all() && low.cmple(box_high).all(),
            found,
        );
    }

    /// Calls `found` with the number of every box that is of interest: one whose corners, lowest
    /// and highest, `enters` accepts, which accepts every box around it too.
    pub(crate) fn visit(&self, enters: impl Fn(DVec3, DVec3) -> bool, mut found: impl FnMut(u32)) {
        // One waits at every level; there are fewer levels than bits.
        let mut waiting = [0_u32; 64];
        let mut n_waiting = 1;
        while n_waiting > 0 {
            n_waiting -= 1;
            let number = waiting[n_waiting] as usize;
            let node = &self.nodes[number];
            if !enters(node.low, node.high) {
                continue;
            }
            if number < self.n_inner {
                waiting[n_waiting] = 2 * number as u32 + 2;
                waiting[n_waiting + 1] = 2 * number as u32 + 1;
                n_waiting += 2;
            } else {
                for item in &self.items[node.first as usize..node.end as usize] {
                    if enters(item.low, item.high) {
                        found(item.number);
                    }
                }
            }
        }
    }
}

const EMPTY: (DVec3, DVec3) = (DVec3::INFINITY, DVec3::NEG_INFINITY);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_tree_finds_what_a_loop_over_all_boxes_finds() {
        for n in [0_usize, 1, 4, 5, 9, 333] {
            let corner = |k: usize, m: usize| ((k * 7919 + m * 104_729) % 1009) as f64 / 1009.0;
            let box_of = |k: usize| {
                let low = DVec3::new(corner(k, 1), corner(k, 2), corner(k, 3));
                (low, low + 0.2 * DVec3::new(corner(k, 4), corner(k, 5), corner(k, 6)))
            };
            let tree = Boxes::new(n, box_of);
            for k in 0..50 {
                let (low, high) = box_of(1000 + k);
                let mut found = Vec::new();
                tree.meeting(low, high, |number| found.push(number));
                found.sort_unstable();
                let expected: Vec<u32> = (0..n as u32)
                    .filter(|number| {
                        let (other_low, other_high) = box_of(*number as usize);
                        low.cmple(other_high).all() && other_low.cmple(high).all()
                    })
                    .collect();
                assert_eq!(found, expected);
            }
        }
    }
}
