//! What a clay model takes in memory, and a change of it in work, before anything is done.

use glam::DVec3;

use super::super::WorkMeter;
use super::super::boolean::Boolean;
use super::super::emboss::{GreyImage, ImagePlacement, samples_under};
use super::super::sample::steps_of;
use super::super::surface::NODE_STEPS;
use super::super::work_meter::{FIT_STEPS, TREE_STEPS};
use super::lattices::{has_room, lattices, lattices_after};
use super::{ClayModel, ClayModelError, Settings, Snapshot};
use vps::density::Lattice;
use vps::storage::memory::available_bytes;
use vps::voxmap::memory_limit::MemoryLimit;

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

/// A change of the clay takes so many steps at most, some ten seconds on two cores. Of a large model
/// it may take so many times what it took to make it.
const STEPS_MAX: u64 = 300_000_000;
const STEPS_OF_OWN: u64 = 16;
/// Work is ended that takes so many times the steps that were estimated.
const STEPS_OVER: u64 = 4;
/// Steps of an empty circle that is looked for at a sample, and of the edge of a sharp Boolean, for
/// each of all samples.
const GAP_STEPS: u64 = 128;
const EDGE_STEPS: u64 = 200;

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

impl MemoryEstimate {
    /// Refuses what takes more than there is.
    ///
    /// # Errors
    /// [`ClayModelError::Memory`].
    pub fn within(self, limit: Option<MemoryLimit>) -> Result<(), ClayModelError> {
        match limit.filter(|limit| self.bytes > limit.max_bytes()) {
            Some(limit) => Err(ClayModelError::Memory { estimate: self, limit }),
            None => Ok(()),
        }
    }
}

/// About what a change of the clay takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WorkEstimate {
    /// The model after it.
    pub memory: MemoryEstimate,
    /// Looks at a sample, a node or a neighbour.
    pub steps: u64,
}

/// A solid, before it is sampled or after.
#[derive(Clone, Copy, Debug)]
pub(in super::super) struct SolidSize {
    pub(in super::super) samples: u64,
    pub(in super::super) spacing_m: f64,
    /// Lowest and highest corner, map frame, m.
    pub(in super::super) bounds: (DVec3, DVec3),
}

/// Steps of a surface through so many samples.
fn steps_of_surface(samples: u64, n_neighbours: usize) -> u64 {
    samples.saturating_mul(2 * TREE_STEPS + (1 + FIT_STEPS) * n_neighbours as u64)
}

impl ClayModel {
    /// The meter of a change that was estimated.
    ///
    /// # Errors
    /// [`ClayModelError::TooMuchWork`], [`ClayModelError::Memory`].
    pub(in super::super) fn meter(
        &self,
        estimate: WorkEstimate,
    ) -> Result<WorkMeter, ClayModelError> {
        let n_samples = self.surface.points().len() as u64;
        let own_steps = steps_of_surface(n_samples, self.settings.n_neighbours)
            + NODE_STEPS * self.base.lattice().n_nodes() as u64;
        let most = STEPS_MAX.max(STEPS_OF_OWN * own_steps);
        if estimate.steps > most {
            return Err(ClayModelError::TooMuchWork { estimate, most });
        }
        estimate.memory.within(available_bytes().map(MemoryLimit::Left))?;
        Ok(WorkMeter::new(self.cancel.clone(), STEPS_OVER * estimate.steps))
    }

    /// Of a Boolean with a solid that is to be sampled and fitted first.
    pub(in super::super) fn estimate_combine(
        &self,
        boolean: Boolean,
        solid: SolidSize,
        is_sharp: bool,
    ) -> Result<WorkEstimate, ClayModelError> {
        let (low, high) = self.surface.bounds();
        let bounds = if boolean == Boolean::Union {
            (low.min(solid.bounds.0), high.max(solid.bounds.1))
        } else {
            (low, high)
        };
        let now = (self.base.lattice(), self.region.dynamics.lattice());
        let (whole, ..) = lattices_after(now, bounds, &self.settings)?;
        let samples = solid.samples.saturating_add(self.surface.points().len() as u64);
        let of_sample = self.look_up_steps() + GAP_STEPS + if is_sharp { EDGE_STEPS } else { 0 };
        let rasters = self.surface.steps_of_raster(&whole).saturating_add(
            solid.samples.saturating_mul(self.nodes_of_domain(solid.spacing_m, &whole)),
        );
        let steps = steps_of(solid.samples)
            .saturating_add(self.steps_of_surfaces(solid.samples.saturating_add(2 * samples)))
            .saturating_add(samples.saturating_mul(of_sample))
            .saturating_add(rasters.saturating_mul(3));
        self.estimate(samples, bounds, steps)
    }

    /// Of an image that is laid over the surface.
    pub(super) fn estimate_emboss(
        &self,
        image: &GreyImage,
        placement: &ImagePlacement,
        depth_m: f64,
    ) -> Result<WorkEstimate, ClayModelError> {
        let (n_under, n_added) =
            samples_under(&self.surface, image, placement, depth_m, self.gap_m);
        let changed = n_under.saturating_add(n_added);
        let samples = n_added.saturating_add(self.surface.points().len() as u64);
        let (low, high) = self.surface.bounds();
        let bounds = if n_under > 0 {
            (low - depth_m.max(0.0), high + depth_m.max(0.0))
        } else {
            (low, high)
        };
        let now = *self.base.lattice();
        let whole = if has_room(&now, bounds) { now } else { lattices(bounds, &self.settings)?.0 };
        let of_sample = self.look_up_steps() + 8 * TREE_STEPS;
        let rasters = self.surface.steps_of_raster(&whole).saturating_add(
            changed.saturating_mul(self.nodes_of_domain(self.surface.spacing_m(), &whole)),
        );
        let steps = self
            .steps_of_surfaces(changed.saturating_mul(4))
            .saturating_add(n_under.saturating_mul(GAP_STEPS))
            .saturating_add(n_added.saturating_mul(8 * GAP_STEPS))
            .saturating_add(samples.saturating_mul(of_sample))
            .saturating_add(rasters.saturating_mul(3));
        self.estimate(samples, bounds, steps)
    }

    /// Of another region.
    pub(super) fn estimate_region(
        &self,
        whole: &Lattice,
        settings: &Settings,
    ) -> Result<WorkEstimate, ClayModelError> {
        let samples = self.surface.points().len() as u64;
        let steps = self.surface.steps_of_raster(whole)
            + self.steps_of_surfaces(samples)
            + samples * (GAP_STEPS + 4 * TREE_STEPS);
        Ok(WorkEstimate {
            memory: MemoryEstimate::of(samples, self.surface.bounds(), settings)?,
            steps,
        })
    }

    /// Of a moment that is gone back to.
    pub(super) fn estimate_fits(&self, moment: &Snapshot) -> WorkEstimate {
        let samples = moment.samples.points().len() as u64;
        let nodes = moment.base.lattice().n_nodes() as u64;
        let steps = self.steps_of_surfaces(moment.samples.n_bare() as u64) + nodes;
        let bytes = PER_SAMPLE * moment.samples.n_bare() as u64;
        WorkEstimate { memory: MemoryEstimate { samples, nodes, bytes }, steps }
    }

    /// Of a material that is laid, with so many steps for each node.
    pub(super) fn estimate_nodes(&self, steps_of_node: u64) -> WorkEstimate {
        let samples = self.surface.points().len() as u64;
        let nodes = self.base.lattice().n_nodes() as u64;
        let memory = MemoryEstimate { samples, nodes, bytes: PER_NODE * nodes };
        WorkEstimate { memory, steps: steps_of_node * nodes }
    }

    fn estimate(
        &self,
        samples: u64,
        bounds: (DVec3, DVec3),
        steps: u64,
    ) -> Result<WorkEstimate, ClayModelError> {
        let memory = MemoryEstimate::of(samples, bounds, &self.settings)?;
        Ok(WorkEstimate { memory, steps })
    }

    fn steps_of_surfaces(&self, samples: u64) -> u64 {
        steps_of_surface(samples, self.settings.n_neighbours)
    }

    /// A place is in the domains of about as many samples as a fit has neighbours.
    fn look_up_steps(&self) -> u64 {
        2 * self.settings.n_neighbours as u64
    }

    /// Nodes of a lattice in the domain of a sample.
    fn nodes_of_domain(&self, spacing_m: f64, lattice: &Lattice) -> u64 {
        let radius_m =
            spacing_m * (self.settings.n_neighbours as f64 / core::f64::consts::PI).sqrt();
        let edge = 1.0 + 2.0 * radius_m / lattice.spacing_m;
        edge.powi(3).min(lattice.n_nodes() as f64) as u64
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
