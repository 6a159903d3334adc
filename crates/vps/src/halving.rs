//! Places in halves, again and again: what trees over points, triangles and boxes are laid out by.
//!
//! Data in: places in single precision, with numbers. Data out: the same places, the lower part
//! before the upper one on every level of the tree. The result is unique: ties go by number, so it
//! is the same for any number of threads. Cost: O(n log n), on the current rayon pool.

use glam::Vec3;

use crate::parallel;

/// Places from which a half is worth a task of its own.
const PARALLEL: usize = 1 << 14;

/// A place, and whose it is.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Site {
    /// Floats as integers that sort like them, because that is what the ordering compares.
    coded: [u32; 3],
    pub(crate) idx: u32,
}

impl Site {
    pub(crate) fn new(position: Vec3, idx: u32) -> Self {
        Self { coded: position.to_array().map(ascending), idx }
    }

    /// The same, numbered behind `n_before` others.
    pub(crate) fn later(self, n_before: u32) -> Self {
        Self { idx: self.idx + n_before, ..self }
    }

    pub(crate) fn position(&self) -> Vec3 {
        Vec3::from_array(self.coded.map(float))
    }

    /// Sorts along an axis; no two sites are equal.
    #[inline]
    fn key(&self, axis: usize) -> u64 {
        u64::from(self.coded[axis]) << 32 | u64::from(self.idx)
    }
}

/// Halves all sites across the longest side of their box, and both halves again. `n_lower` says how
/// many of so many sites, so many levels below the first, are the lower part; `None`: it stays whole.
pub(crate) fn halve(sites: &mut [Site], n_lower: &(impl Fn(usize, u32) -> Option<usize> + Sync)) {
    halve_below(sites, 0, n_lower);
}

fn halve_below(
    sites: &mut [Site],
    level: u32,
    n_lower: &(impl Fn(usize, u32) -> Option<usize> + Sync),
) {
    let Some(n) = n_lower(sites.len(), level).filter(|n| *n < sites.len()) else { return };
    // One instance of the selection per axis: the comparison is all that it does.
    match longest_axis(sites) {
        0 => sites.select_nth_unstable_by_key(n, |site| site.key(0)),
        1 => sites.select_nth_unstable_by_key(n, |site| site.key(1)),
        _ => sites.select_nth_unstable_by_key(n, |site| site.key(2)),
    };
    let is_parallel = sites.len() > PARALLEL;
    let (lower, upper) = sites.split_at_mut(n);
    let level = level + 1;
    if is_parallel {
        parallel::join(&mut || halve_below(lower, level, n_lower), &mut || {
            halve_below(upper, level, n_lower)
        });
    } else {
        halve_below(lower, level, n_lower);
        halve_below(upper, level, n_lower);
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
        fn the_lower_part_is_not_above_the_upper_one_and_the_order_before_does_not_matter(
            places in prop::collection::vec(prop::array::uniform3(-3_i8..3), 0..300)
        ) {
            let sites: Vec<Site> = (0..)
                .zip(&places)
                .map(|(idx, place)| Site::new(Vec3::from_array(place.map(f32::from)), idx))
                .collect();
            let third = |n: usize, level: u32| (level < 2 && n > 2).then_some(n / 3);
            let mut once = sites.clone();
            let mut again = sites;
            again.reverse();
            halve(&mut once, &third);
            halve(&mut again, &third);
            let part = |sites: &[Site], range: core::ops::Range<usize>| {
                let mut numbers: Vec<u32> = sites[range].iter().map(|site| site.idx).collect();
                numbers.sort_unstable();
                numbers
            };
            let n = places.len();
            if n > 2 {
                let lower = 0..n / 3;
                let is_parted = (0..3).any(|axis| {
                    let keys = |range: core::ops::Range<usize>| {
                        once[range].iter().map(move |site| site.key(axis))
                    };
                    keys(lower.clone()).max() < keys(n / 3..n).min()
                });
                prop_assert!(is_parted);
                prop_assert_eq!(part(&once, lower.clone()), part(&again, lower));
            }
            prop_assert!(part(&once, 0..n).into_iter().eq(0..n as u32));
        }
    }
}
