//! The order of a shell: points that are near in space come near in memory, on every scale of the
//! tree.

use super::lanes::LANES;
use super::tree::CHILDREN;
use crate::halving::{Site, halve};
use crate::parallel;

/// Reorders points so that each node of a [`super::tree::Tree`] over them is a compact cluster:
/// halves each part across the longest side of its box, at a multiple of the size of a child, down
/// to blocks of [`LANES`].
///
/// The result is unique: ties go by number, and a block is sorted by number. Runs on the current
/// rayon pool. Cost: O(n log n).
pub(super) fn arrange(sites: &mut [Site]) {
    halve(sites, &|n_sites, _| {
        let mut child = LANES;
        while child * CHILDREN < n_sites {
            child *= CHILDREN;
        }
        (n_sites > LANES).then(|| n_sites.div_ceil(child).div_ceil(2) * child)
    });
    let mut blocks: Vec<&mut [Site]> = sites.chunks_mut(LANES).collect();
    parallel::map_mut(&mut blocks, 1024, |_, block| block.sort_unstable_by_key(|site| site.idx));
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use proptest::prelude::*;

    use super::*;

    proptest! {
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
