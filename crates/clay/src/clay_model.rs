//! The clay that is worked on: its samples, its densities, and every stroke so far.
//!
//! ```text
//!  samples ─► PointSurface ─► base raster ─┬─► region: Dynamics ◄── pulls
//!     ▲                                    │         │ densities
//!     │        stroke ends: distances ◄────┼─────────┤
//!     └── fits from densities (Eq. 5) ◄────┘         └─► samples float along, come and go
//! ```
//! A stroke works on copies; what a look-up of [`ClayModel::surface`] gives changes when it ends.

mod adopt;
mod estimate;
mod lattices;
mod material;
mod painting;
mod settings;
mod undo_history;

use std::sync::Arc;

use glam::DVec3;
use rayon::prelude::*;

use self::adopt::{adopt, faint_m, forget_faint, make_even, moved_by, near_to};
pub(super) use self::estimate::SolidSize;
pub use self::estimate::{MemoryEstimate, WorkEstimate};
use self::lattices::{copy_into, cut, has_room, lattices_after};
pub(super) use self::lattices::{lattices, region_box};
use self::painting::Press;
pub use self::settings::{ClayModelError, Settings};
pub(super) use self::undo_history::{Session, Snapshot};
use super::advect::AdvectedSamples;
use super::boolean::{self, Boolean};
use super::dynamics::{Dynamics, Progress};
use super::emboss::{GreyImage, ImagePlacement, between_steep, cliffs, embossed};
use super::material_map::{MaterialCoat, MaterialMap};
use super::pull::{CurvesPull, PullForce, add_pull};
use super::redistance::redistance;
use super::topology::{euler_number, forget_unsampled};
use super::work_meter::TREE_STEPS;
use super::{Cancel, PointSet, PointSurface, SurfaceError, WorkError, WorkMeter, advect, resample};
use vps::density::{Density, DensityFrame, FrameError, Lattice, Raster};

/// Largest empty circle and closest pair of samples in a region, in spacings of the samples at the
/// start.
const GAP_SPACINGS: f64 = 1.0;
const CLOSE_SPACINGS: f64 = 0.35;
/// A sample has lost its surface where its level is farther than this, spacings of the raster: no
/// step of an update ends so far from it.
const LOST_SPACINGS: f64 = 0.75;
/// One smooth surface goes over the edge of a Boolean so far to both sides, in the largest of all
/// spacings: fits reach no farther.
const BLEND_SPACINGS: f64 = 4.0;
/// Samples so near to both solids of a Boolean may have a gap beside them, in largest empty
/// circles.
const SEAM_GAPS: f64 = 3.0;

/// The part that deforms.
#[derive(Debug)]
struct DynamicRegion {
    /// Its node `[0, 0, 0]` in the base.
    first: [usize; 3],
    dynamics: Dynamics,
    afloat: AdvectedSamples,
}

/// A clay model.
#[derive(Debug)]
pub struct ClayModel {
    /// Shared with what undo goes back to.
    surface: Arc<PointSurface>,
    /// While a stroke lasts: samples under way.
    under_way: Option<PointSet>,
    /// While the brush is pressed; never together with samples under way.
    press: Option<Press>,
    /// Of a press that paints material.
    material_coat: Option<MaterialCoat>,
    /// Measured, as frames want it.
    base: Arc<Raster>,
    /// What was painted, on the nodes of the base.
    material_map: MaterialMap,
    region: DynamicRegion,
    settings: Settings,
    gap_m: f64,
    /// How far samples went since gaps were filled, m.
    went_m: f64,
    past: Vec<Snapshot>,
    undone: Vec<Snapshot>,
    strokes: u64,
    updates: u64,
    /// Ends what takes longer than a touch of the brush.
    cancel: Cancel,
    /// Euler numbers of the region before and after the last stroke that deformed, where they
    /// differ; until they are taken.
    reconnected: Option<(i64, i64)>,
}

impl ClayModel {
    /// A clay model from samples. Parallel; cost: a fit per sample, and the nodes of the base
    /// raster.
    ///
    /// # Errors
    /// [`ClayModelError`].
    pub fn new(points: PointSet, settings: Settings) -> Result<Self, ClayModelError> {
        let meter = WorkMeter::unlimited();
        let surface = settings.surface(points, &meter)?;
        let (whole, first, region) = lattices(surface.bounds(), &settings)?;
        let base = measured(surface.rasterize(whole, &meter)?);
        let material_map = MaterialMap::default();
        let region =
            DynamicRegion::new(surface.points(), (&base, &material_map), first, region, &settings);
        region.check_holds_some()?;
        let gap_m = GAP_SPACINGS * surface.spacing_m();
        Ok(Self {
            surface: Arc::new(surface),
            under_way: None,
            press: None,
            material_coat: None,
            base,
            material_map,
            region,
            settings,
            gap_m,
            went_m: 0.0,
            past: Vec::new(),
            undone: Vec::new(),
            strokes: 0,
            updates: 0,
            cancel: Cancel::default(),
            reconnected: None,
        })
    }

    /// From now on this ends Booleans, images, other regions and the like before they are done, and
    /// the clay is as it was. The end of a stroke is not ended: it costs no more than to save it.
    pub fn cancel_when(&mut self, cancel: Cancel) {
        self.cancel = cancel;
    }

    /// The surface as the last stroke left it.
    pub fn surface(&self) -> &PointSurface {
        &self.surface
    }

    /// The samples now, those of a stroke under way among them.
    pub fn points(&self) -> &PointSet {
        self.under_way.as_ref().unwrap_or(self.surface.points())
    }

    /// All of the densities as the last stroke left them.
    pub fn base(&self) -> &Arc<Raster> {
        &self.base
    }

    /// The densities of the region now.
    pub fn region(&self) -> &Raster {
        self.region.dynamics.now()
    }

    /// The largest empty circle between samples that is left open, m.
    pub(super) fn gap_m(&self) -> f64 {
        self.gap_m
    }

    /// How it is worked.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Lowest and highest corner of what deforms, map frame, m.
    pub(super) fn region_map(&self) -> (DVec3, DVec3) {
        self.region().lattice().bounds()
    }

    /// A stroke is under way.
    pub(super) fn is_stroke(&self) -> bool {
        self.under_way.is_some() || self.press.is_some()
    }

    /// Strokes that were begun, without those that made no surface.
    pub fn strokes(&self) -> u64 {
        self.strokes
    }

    /// The nearest place of the surface to a point, and the way out there, as densities have it
    /// now; `None` far from it.
    pub fn onto(&self, point_map: DVec3, within_m: f64) -> Option<(DVec3, DVec3)> {
        advect::onto_level(
            |at| self.density_at(at),
            self.base.lattice().spacing_m,
            (point_map, 0.0),
            within_m,
        )
    }

    /// The place of the surface on a line through a point near it; `None` where the line runs along
    /// the surface, or meets none within a distance.
    pub fn onto_along(&self, point_map: DVec3, direction: DVec3, within_m: f64) -> Option<DVec3> {
        advect::onto_level_along(
            |at| self.density_at(at),
            self.base.lattice().spacing_m,
            (point_map, direction),
            within_m,
        )
    }

    /// As [`Self::onto`], for the places that have a density: the surface is the level 0.
    pub(super) fn onto_level(
        &self,
        (point_map, level_m): (DVec3, f64),
        within_m: f64,
    ) -> Option<DVec3> {
        let onto = advect::onto_level(
            |at| self.density_at(at),
            self.base.lattice().spacing_m,
            (point_map, level_m),
            within_m,
        );
        onto.map(|(there, _)| there)
    }

    /// As [`Self::onto_along`], for the places that have a density.
    pub(super) fn onto_level_along(
        &self,
        (point_map, level_m): (DVec3, f64),
        direction: DVec3,
        within_m: f64,
    ) -> Option<DVec3> {
        let from_level =
            |density: Density| Density { value_m: density.value_m - level_m as f32, ..density };
        let now = |at| self.density_at(at).map(from_level);
        advect::onto_level_along(
            now,
            self.base.lattice().spacing_m,
            (point_map, direction),
            within_m,
        )
    }

    /// The density at a point now, m, greater than 0 inside; `None` far from the clay.
    pub fn density_m(&self, point_map: DVec3) -> Option<f64> {
        self.density_at(point_map).map(|density| f64::from(density.value_m))
    }

    fn density_at(&self, point_map: DVec3) -> Option<Density> {
        self.region().at(point_map).or_else(|| self.base.at(point_map))
    }

    /// Another part is to deform: a stroke under way ends first.
    ///
    /// # Errors
    /// [`ClayModelError::Region`], [`ClayModelError::TooFine`]; nothing has changed then but that
    /// the stroke has ended.
    pub(super) fn choose_region(
        &mut self,
        low_map: DVec3,
        high_map: DVec3,
    ) -> Result<(), ClayModelError> {
        self.end_stroke()?;
        let settings = Settings { region_map: Some((low_map, high_map)), ..self.settings.clone() };
        let (whole, first, region) = lattices(self.surface.bounds(), &settings)?;
        let meter = self.meter(self.estimate_region(&whole, &settings)?)?;
        let base = measured(self.surface.rasterize(whole, &meter)?);
        let material_map = self.material_map.onto(self.base.lattice(), &whole, &settings.material);
        let mut surface = self.surface.clone();
        let inside = AdvectedSamples::new(surface.points(), &cut(&base, first, region), 0.0);
        if !inside.samples().is_empty() {
            let points = surface.points().clone();
            make_even(
                Arc::make_mut(&mut surface),
                &points,
                inside.samples(),
                &base,
                self.gap_m,
                &meter,
            )?;
        }
        let region =
            DynamicRegion::new(surface.points(), (&base, &material_map), first, region, &settings);
        region.check_holds_some()?;
        self.surface = surface;
        (self.base, self.material_map, self.region, self.settings) =
            (base, material_map, region, settings);
        Ok(())
    }

    /// A stroke begins: what is there can be had back. Does nothing during one.
    ///
    /// # Errors
    /// [`SurfaceError`] where the brush was pressed, and what it left makes no surface; that is
    /// taken back then, and no stroke begins.
    pub fn begin_stroke(&mut self) -> Result<(), SurfaceError> {
        if self.under_way.is_none() {
            self.end_stroke()?;
            self.remember();
            self.under_way = Some(self.surface.points().clone());
            self.went_m = 0.0;
        }
        Ok(())
    }

    /// A force on the material for the next update; begins a stroke.
    ///
    /// # Errors
    /// As [`Self::begin_stroke`].
    pub fn pull(&mut self, pull: &PullForce) -> Result<(), SurfaceError> {
        self.pull_curves(pull.into())
    }

    /// A force along several curves for the next update; begins a stroke.
    pub(super) fn pull_curves(&mut self, pull: CurvesPull<'_>) -> Result<(), SurfaceError> {
        self.begin_stroke()?;
        let (now, forces_n) = self.region.dynamics.forces_n_mut();
        add_pull(now, pull, forces_n);
        Ok(())
    }

    /// Lets the material move for a time. Cost: O(nodes and samples of the region); more when gaps
    /// are filled.
    pub fn advance(&mut self, time_s: f64) -> Progress {
        let DynamicRegion { dynamics, afloat, .. } = &mut self.region;
        let progress = dynamics.update(time_s);
        self.updates += 1;
        if let Some(points) = &mut self.under_way {
            self.went_m += afloat.follow(
                points,
                dynamics.now(),
                dynamics.velocities_m_per_s(),
                progress.time_s,
            );
            if self.went_m > self.gap_m {
                self.went_m = 0.0;
                let moved =
                    moved_by(points, self.surface.points(), afloat, faint_m(dynamics.lattice()));
                let meter = WorkMeter::unlimited();
                // Without a limit it does not fail.
                let _ = resample::fill(points, afloat, &moved, dynamics.now(), self.gap_m, &meter);
            }
        }
        progress
    }

    /// The stroke is over: what is there stays. Densities become distances, samples are made even,
    /// and fits are taken from the densities (equation 5). Does nothing without a stroke.
    ///
    /// # Errors
    /// [`SurfaceError`] when the samples make no surface any more; then it is as it was before the
    /// stroke.
    pub fn end_stroke(&mut self) -> Result<(), SurfaceError> {
        self.set_material();
        self.lift_brush()?;
        let Some(mut points) = self.under_way.take() else { return Ok(()) };
        let DynamicRegion { first, dynamics, afloat } = &mut self.region;
        let mut now = dynamics.now().clone();
        redistance(&mut now);
        let lost = afloat.lost(&points, &now, LOST_SPACINGS * now.lattice().spacing_m);
        let is_lost = |sample: &u32| lost.binary_search(sample).is_ok();
        let rest = cut(&self.base, *first, *dynamics.lattice());
        forget_faint(&mut points, self.surface.points(), &mut now, dynamics.now(), &rest);
        let all = 0..points.len() as u32;
        let left_map: Vec<DVec3> =
            all.filter(|n| !is_lost(n)).map(|n| points.positions_map[n as usize]).collect();
        forget_unsampled(&mut now, &left_map);
        if points == *self.surface.points() && lost.is_empty() {
            self.forget_stroke();
            return Ok(());
        }
        let mut moved = moved_by(&points, self.surface.points(), afloat, 0.0);
        moved.retain(|sample| !is_lost(sample));
        let (low, high) = self.base.lattice().bounds();
        // Samples that are lost must not stand for those that are missing.
        let aside: Vec<DVec3> = lost
            .iter()
            .map(|n| {
                core::mem::replace(&mut points.positions_map[*n as usize], 3.0 * high - 2.0 * low)
            })
            .collect();
        let meter = WorkMeter::unlimited();
        resample::fill(&mut points, afloat, &moved, &now, self.gap_m, &meter)?;
        lost.iter().zip(aside).for_each(|(n, at)| points.positions_map[*n as usize] = at);
        let close_m = CLOSE_SPACINGS * self.surface.spacing_m();
        let before = self.surface.points();
        let mut kept = resample::thinned(&points, before, afloat.samples(), close_m, &meter)?;
        kept.retain(|sample| !is_lost(sample));
        let mut base = (*self.base).clone();
        copy_into(&mut base, &now, *first);

        let n_before = self.surface.points().len();
        let result = adopt(Arc::make_mut(&mut self.surface), &points, &kept, n_before, &base);
        if let Err(error) = result {
            self.take_back();
            return Err(error);
        }
        self.base = measured(base);
        let numbers = (euler_number(&rest), euler_number(&now));
        self.reconnected = (numbers.0 != numbers.1).then_some(numbers);
        dynamics.replace(now);
        *afloat = AdvectedSamples::new(self.surface.points(), dynamics.now(), 0.0);
        self.settle();
        Ok(())
    }

    /// The last stroke that deformed has let fronts meet or part: Euler numbers of the material in
    /// the region before and after it. Given once.
    pub(super) fn take_reconnected(&mut self) -> Option<(i64, i64)> {
        self.reconnected.take()
    }

    /// Raises the surface by an image, or sinks it in: one stroke, or none where the image reaches
    /// no sample. Gives how many samples it moved.
    ///
    /// A relief that does not fit into the raster gets a larger one.
    ///
    /// # Errors
    /// [`SurfaceError`], and a raster that would be too large; then it is as before.
    pub(super) fn emboss(
        &mut self,
        image: &GreyImage,
        placement: &ImagePlacement,
        depth_m: f64,
    ) -> Result<usize, ClayModelError> {
        self.end_stroke()?;
        let meter = self.meter(self.estimate_emboss(image, placement, depth_m)?)?;
        let mut surface = (*self.surface).clone();
        let between = between_steep(&surface, image, placement, depth_m, &meter);
        surface.replace(&[], &between?, &meter)?;
        let moved = embossed(&surface, image, placement, depth_m, &meter)?;
        if moved.is_empty() {
            return Ok(0);
        }
        let earlier = surface.clone();
        let cliffs = cliffs(surface.points(), &moved, surface.spacing_m(), self.gap_m, &meter)?;
        let flat = surface.points().clone();
        surface.move_and_refit(&moved, &meter)?;
        surface.replace(&[], &cliffs, &meter)?;
        let now = *self.base.lattice();
        let larger = if has_room(&now, surface.bounds()) {
            None
        } else {
            Some(lattices(surface.bounds(), &self.settings)?)
        };
        let lattice = larger.map_or(now, |(whole, ..)| whole);
        let mut base = changed(
            &self.densities_on(lattice, &meter)?,
            &earlier.rasterize(lattice, &meter)?,
            &surface.rasterize(lattice, &meter)?,
        );
        forget_unsampled(&mut base, &surface.points().positions_map);
        let base = measured(base);
        let n_cliffs =
            (surface.points().len() - cliffs.len()) as u32..surface.points().len() as u32;
        let looked_at: Vec<u32> = moved.iter().map(|moved| moved.sample).chain(n_cliffs).collect();
        make_even(&mut surface, &flat, &looked_at, &base, self.gap_m, &meter)?;
        self.remember();
        self.surface = Arc::new(surface);
        self.material_map = self.material_map.onto(&now, &lattice, &self.settings.material);
        self.base = base;
        match larger {
            None => self.cut_region(*self.region.dynamics.lattice()),
            Some((_, _, region)) => self.cut_region(region),
        }
        self.settle();
        Ok(moved.len())
    }

    /// Joins the clay with another solid, or cuts one by the other: one stroke.
    ///
    /// `is_sharp`: the edge between both stays, as far as the raster holds it; otherwise one smooth
    /// surface goes over it.
    ///
    /// # Errors
    /// [`SurfaceError`] when nothing is left that makes a surface; then it is as before.
    pub(super) fn combine(
        &mut self,
        boolean: Boolean,
        other: &PointSurface,
        is_sharp: bool,
    ) -> Result<(), ClayModelError> {
        self.end_stroke()?;
        let solid = SolidSize {
            samples: other.points().len() as u64,
            spacing_m: other.spacing_m(),
            bounds: other.bounds(),
        };
        let meter = self.meter(self.estimate_combine(boolean, solid, is_sharp)?)?;
        let points = boolean.samples(&self.surface, other, is_sharp, &meter)?;
        if points.len() < PointSet::LEAST {
            return Err(ClayModelError::NothingLeft);
        }
        let mut surface = self.settings.surface(points, &meter)?;
        let now = (self.base.lattice(), self.region.dynamics.lattice());
        let (whole, first, region) = lattices_after(now, surface.bounds(), &self.settings)?;
        let of_first = self.densities_on(whole, &meter)?;
        let of_second = other.rasterize(whole, &meter)?;
        let mut left = boolean.densities(&of_first, &of_second);
        if !is_sharp {
            let width_m = BLEND_SPACINGS
                * self.surface.spacing_m().max(other.spacing_m()).max(whole.spacing_m);
            let smooth = surface.rasterize(whole, &meter)?;
            boolean::blend(&mut left, [&of_first, &of_second], &smooth, width_m);
        }
        forget_unsampled(&mut left, &surface.points().positions_map);
        let base = measured(left);
        meter.take(2 * TREE_STEPS * surface.points().len() as u64)?;
        // Near both, where the seam is; what each was elsewhere it stays.
        let [near_first, near_second] = [self.surface.neighbours(), other.neighbours()]
            .map(|tree| near_to(surface.points(), tree, SEAM_GAPS * self.gap_m));
        let beside: Vec<u32> = near_first
            .into_iter()
            .filter(|sample| near_second.binary_search(sample).is_ok())
            .collect();
        let cut = surface.points().clone();
        make_even(&mut surface, &cut, &beside, &base, self.gap_m, &meter)?;
        self.remember();
        self.surface = Arc::new(surface);
        self.material_map =
            self.material_map.onto(self.base.lattice(), &whole, &self.settings.material);
        self.base = base;
        self.region = DynamicRegion::new(
            self.surface.points(),
            (&self.base, &self.material_map),
            first,
            region,
            &self.settings,
        );
        self.settle();
        Ok(())
    }

    /// The densities on another lattice: those that are known, and beyond them what fits say.
    fn densities_on(&self, lattice: Lattice, meter: &WorkMeter) -> Result<Raster, WorkError> {
        let known = |node| self.base.at(lattice.position(node)).map(|density| density.value_m);
        if *self.base.lattice() == lattice {
            return Ok((*self.base).clone());
        }
        let mut raster = self.surface.rasterize(lattice, meter)?;
        let [nx, ny, nz] = lattice.dims;
        raster.values_m_mut().par_chunks_mut(ny * nz).enumerate().take(nx).for_each(
            |(x, plane)| {
                for (n, value_m) in plane.iter_mut().enumerate() {
                    *value_m = known([x, n / nz, n % nz]).unwrap_or(*value_m);
                }
            },
        );
        Ok(raster)
    }

    /// Writes the densities into a frame for the tick. Cost: a copy of the region.
    pub(super) fn show(&self, frame: &mut DensityFrame) {
        frame.sequence = self.updates;
        frame.base = self.base.clone();
        let now = self.region.dynamics.now();
        if frame.region.lattice() == now.lattice() {
            frame.region.values_m_mut().copy_from_slice(now.values_m());
        } else {
            frame.region = now.clone();
        }
    }

    /// A frame of its own, such as a scene begins with. Allocates; `show` fills it again.
    ///
    /// # Errors
    /// [`FrameError`], which no clay model gives that could be made.
    pub fn frame(&self) -> Result<DensityFrame, FrameError> {
        let mut frame = DensityFrame {
            sequence: self.updates,
            base: self.base.clone(),
            region: self.region().clone(),
            rope_map: None,
            is_leap: false,
        };
        frame.make_ready(None)?;
        Ok(frame)
    }
}

/// What a raster is after a change that fits know of: where they have not changed it is as before,
/// and keeps edges and relief that are finer than fits are.
fn changed(raster: &Raster, before: &Raster, after: &Raster) -> Raster {
    let mut changed = raster.clone();
    for ((value_m, before_m), after_m) in
        changed.values_m_mut().iter_mut().zip(before.values_m()).zip(after.values_m())
    {
        *value_m += after_m - before_m;
    }
    changed
}

/// How steep it is has to be known before it is shared.
fn measured(mut raster: Raster) -> Arc<Raster> {
    raster.measure();
    Arc::new(raster)
}

impl DynamicRegion {
    fn new(
        points: &PointSet,
        (base, map): (&Raster, &MaterialMap),
        first: [usize; 3],
        lattice: Lattice,
        settings: &Settings,
    ) -> Self {
        let now = cut(base, first, lattice);
        let afloat = AdvectedSamples::new(points, &now, 0.0);
        let material = map.of_part(base.lattice(), first, &lattice, &settings.material);
        Self { first, dynamics: Dynamics::new(now, material, settings.integrator), afloat }
    }

    fn check_holds_some(&self) -> Result<(), ClayModelError> {
        if !self.afloat.samples().is_empty() {
            return Ok(());
        }
        let lattice = self.dynamics.lattice();
        let last = lattice.dims.map(|n| n - 1);
        Err(ClayModelError::Beside(lattice.position([0; 3]), lattice.position(last)))
    }
}

#[cfg(test)]
mod tests;
