//! What a clay model takes in memory, before it is made.

use glam::DVec3;

use super::lattices::lattices;
use super::{ClayModelError, Settings};

/// Of each sample, bytes: itself in the surface, in a stroke, before it and in the view, its fit of
/// 27 coefficients, its share of the search trees; and what it is chosen from where a mesh is
/// sampled. Measured: 1,450 with one stroke on a ball of 2,000 to 20,000.
const PER_SAMPLE: u64 = 1500;
/// Of each node of the whole model, bytes: its density, twice while a stroke ends, and in the
/// frames.
const PER_NODE: u64 = 12;
/// Of each mass point of the region, bytes: eleven numbers of its motion, and its density in the
/// frames that go round.
const PER_MASS_POINT: u64 = 64;

/// About what a clay model takes while it is made and worked; strokes that can be taken back apart,
/// which are bounded by themselves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MemoryEstimate {
    /// Samples.
    pub samples: u64,
    /// Nodes of the raster over the whole model.
    pub nodes: u64,
    /// All of it.
    pub bytes: u64,
}

impl MemoryEstimate {
    /// Of a clay model of so many samples in a box (map frame, m).
    ///
    /// # Errors
    /// [`ClayModelError`] of a raster that cannot be.
    pub fn of(
        samples: u64,
        bounds: (DVec3, DVec3),
        settings: &Settings,
    ) -> Result<Self, ClayModelError> {
        let (whole, _, region) = lattices(bounds, settings)?;
        let nodes = whole.n_nodes() as u64;
        let mass_points = region.n_nodes() as u64;
        let bytes = PER_SAMPLE
            .saturating_mul(samples)
            .saturating_add(PER_NODE * nodes + PER_MASS_POINT * mass_points);
        Ok(Self { samples, nodes, bytes })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn more_samples_and_finer_rasters_take_more() {
        let bounds = (DVec3::splat(-0.02), DVec3::splat(0.02));
        let of = |samples, n| {
            MemoryEstimate::of(samples, bounds, &Settings { raster: [n; 3], ..Settings::default() })
                .unwrap()
        };
        let one = of(1000, 40);
        let other = of(101_000, 40);
        let finer = of(1000, 80);
        assert_eq!(other.bytes - one.bytes, 150_000_000);
        // Eight times the mass points, and nearly so many nodes.
        assert!(
            finer.nodes > 6 * one.nodes && finer.bytes > 6 * (one.bytes - 1_500_000),
            "{finer:?} of {one:?}"
        );
        assert_eq!(of(u64::MAX, 40).bytes, u64::MAX);
    }
}
