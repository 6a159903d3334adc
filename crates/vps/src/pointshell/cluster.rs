//! The order of a shell: points that are near in space come near in memory, on every scale of the
//! tree.

use glam::Vec3;

use super::lanes::LANES;
use super::tree::CHILDREN;
use crate::parallel;

/// A point on its way to its place in the shell.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Site {
    /// About the centre of mass, m: floats as integers that sort like them, because that is what
    /// the ordering compares.
    coded: [u32; 3],
    /// Number before the ordering: the rank of its voxel.
    pub(super) idx: u32,
}

impl Site {
    pub(super) fn new(position: Vec3, idx: u32) -> Self {
        Self { coded: position.to_array().map(ascending), idx }
    }

    /// The same, numbered behind `n_before` others.
    pub(super) fn later(self, n_before: u32) -> Self {
        Self { idx: self.idx + n_before, ..self }
    }

    /// About the centre of mass, m.
    pub(super) fn position(&self) -> Vec3 {
        Vec3::from_array(self.coded.map(float))
    }

    /// Sorts along an axis; no two sites are equal.
    #[inline]
    fn key(&self, axis: usize) -> u64 {
        u64::from(self.coded[axis]) << 32 | u64::from(self.idx)
    }
}

/// Points from which a part is worth a task of its own.
const PARALLEL: usize = 1 << 14;

/// Reorders points so that each node of a [`super::tree::Tree`] over them is a compact cluster:
/// halves each part across the longest side of its box, at a multiple of the size of a child, down
/// to blocks of [`LANES`].
///
/// The result is unique: ties go by number, and a block is sorted by number. Runs on the current
/// rayon pool. Cost: O(n log n).
pub(super) fn arrange(sites: &mut [Site]) {
    let mut child = LANES;
    while child < sites.len() {
        child *= CHILDREN;
    }
    halve(sites, child);
}

fn halve(sites: &mut [Site], mut child: usize) {
    if sites.len() <= LANES {
        sites.sort_unstable_by_key(|site| site.idx);
        return;
    }
    while child >= sites.len() {
        child /= CHILDREN;
    }
    let left = sites.len().div_ceil(child).div_ceil(2) * child;
    // One instance of the selection per axis: the comparison is all that it does.
    match longest_axis(sites) {
        0 => sites.select_nth_unstable_by_key(left, |site| site.key(0)),
        1 => sites.select_nth_unstable_by_key(left, |site| site.key(1)),
        _ => sites.select_nth_unstable_by_key(left, |site| site.key(2)),
    };
    let is_parallel = sites.len() > PARALLEL;
    let (left, right) = sites.split_at_mut(left);
    if is_parallel {
        parallel::join(&mut || halve(left, child), &mut || halve(right, child));
    } else {
        halve(left, child);
        halve(right, child);
    }
}

fn longest_axis(sites: &[Site]) -> usize {
    let mut low = [u32::MAX; 3];
    let mut high = [0; 3];
    for site in sites {
        for axis in 0..3 {
            low[axis] = low[axis].min(site.coded[axis]);
            high[axis] = high[axis].max(site.coded[axis]);
        }
    }
    let [x, y, z] = [0, 1, 2].map(|axis| float(high[axis]) - float(low[axis]));
    if x >= y && x >= z {
        0
    } else if y >= z {
        1
    } else {
        2
    }
}

/// The number's place among all floats, as an integer.
#[inline]
fn ascending(number: f32) -> u32 {
    let bits = number.to_bits();
    if bits >> 31 == 1 { !bits } else { bits | 1 << 31 }
}

/// The float at a place.
#[inline]
fn float(ascending: u32) -> f32 {
    f32::from_bits(if ascending >> 31 == 1 { ascending & !(1 << 31) } else { !ascending })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn integers_sort_like_their_floats(a: f32, b: f32) {
            prop_assume!(!a.is_nan() && !b.is_nan());
            prop_assert_eq!(float(ascending(a)).to_bits(), a.to_bits());
            prop_assert_eq!(ascending(a).cmp(&ascending(b)), a.total_cmp(&b));
        }

        #[test]
        fn ordering_loses_no_point_and_does_not_depend_on_the_order_of_equal_parts(
            points in prop::collection::vec(prop::array::uniform3(-3_i8..3), 0..700)
        ) {
            let sites: Vec<Site> = points
                .iter()
                .zip(0..)
                .map(|(point, idx)| Site::new(Vec3::from_array(point.map(f32::from)), idx))
                .collect();
            let mut once = sites.clone();
            let mut again = sites;
            again.reverse();
            arrange(&mut once);
            arrange(&mut again);
            let numbers = |sites: &[Site]| sites.iter().map(|site| site.idx).collect::<Vec<_>>();
            prop_assert_eq!(numbers(&once), numbers(&again));
            let mut sorted = numbers(&once);
            sorted.sort_unstable();
            prop_assert!(sorted.into_iter().eq(0..points.len() as u32));
        }
    }
}
