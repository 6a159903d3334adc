//! The piece that is worked on: its samples, its densities, and every stroke so far.
//!
//! ```text
//!  samples ─► PointSurface ─► base raster ─┬─► region: Dynamics ◄── pulls
//!     ▲                                    │         │ densities
//!     │        stroke ends: distances ◄────┼─────────┤
//!     └── fits from densities (Eq. 5) ◄────┘         └─► samples float along, come and go
//! ```
//! A stroke works on copies; what a look-up of [`Workpiece::surface`] gives changes when it ends.

mod adopt;
mod lattices;

use std::sync::Arc;

use glam::DVec3;

use self::adopt::adopt;
use self::lattices::{NODES_MAX, copy_into, cut, first_node, is_part, lattices};
use super::advect::Afloat;
use super::boolean::Boolean;
use super::dynamics::{Dynamics, Integrator, Material, Progress};
use super::emboss::{GreyImage, Laid, embossed};
use super::paint::{Brush, Coat, Dab, Surfel};
use super::pull::{Pull, add_pull};
use super::redistance::redistance;
use super::session::Session;
use super::{PointSet, PointSurface, SurfaceError, advect, resample};
use crate::haptics::clay::{Density, Frame, FrameError, Lattice, Raster};

/// Largest empty circle and closest pair of samples in a region, in spacings of the samples at the start.
const GAP_SPACINGS: f64 = 1.0;
const CLOSE_SPACINGS: f64 = 0.35;
/// Strokes that can be taken back.
const PAST_MAX: usize = 64;
/// Radius of a sample's disc, in its spacings: neighbouring discs overlap.
const DISC_SPACINGS: f64 = 0.75;
/// Smallest disc that the rim of a brush leaves, in spacings at the start: each is split once.
const SPLIT_SPACINGS: f64 = 0.25;

/// How a piece is worked.
#[derive(Clone, Debug)]
pub struct Settings {
    /// Neighbours of a fit.
    pub n_neighbours: usize,
    /// Lowest and highest corner of the region that deforms, map frame, m; `None`: all of the piece, and air around it.
    pub region_map: Option<(DVec3, DVec3)>,
    /// Mass points along x, y, z.
    pub raster: [usize; 3],
    /// Air around the piece that clay may be pulled into, m.
    pub air_m: f64,
    /// What it is made of.
    pub material: Material,
    /// How it moves.
    pub integrator: Integrator,
}

impl Default for Settings {
    /// The paper's largest raster over the whole piece, a centimetre of air, soft clay.
    fn default() -> Self {
        Self {
            n_neighbours: PointSurface::DEFAULT_NEIGHBOURS,
            region_map: None,
            raster: [40; 3],
            air_m: 0.01,
            material: Material::default(),
            integrator: Integrator::default(),
        }
    }
}

/// Why a piece cannot be worked.
#[derive(Debug, thiserror::Error)]
pub enum WorkpieceError {
    /// Samples that make no surface.
    #[error(transparent)]
    Surface(#[from] SurfaceError),
    /// Fewer mass points than there is something to interpolate between.
    #[error("a raster of {0:?} mass points is too small; give at least 4 along every axis")]
    Raster([usize; 3]),
    /// A box without inside.
    #[error("the region from {0} to {1} m is empty; its first corner is the lowest, its second the highest")]
    Region(DVec3, DVec3),
    /// The base would be too large.
    #[error(
        "mass points {spacing_m:.6} m apart make {n_nodes} of them over the whole piece, more than {NODES_MAX}; \
         take fewer in `sculpt.raster`, or a larger `sculpt.region_mm`"
    )]
    TooFine {
        /// Between mass points, m.
        spacing_m: f64,
        /// Over the whole piece.
        n_nodes: f64,
    },
}

/// What was there before a stroke, and which part of it deformed.
#[derive(Clone, Debug)]
pub(super) struct Moment {
    pub(super) points: PointSet,
    /// Measured.
    pub(super) base: Arc<Raster>,
    pub(super) region: Lattice,
    pub(super) region_map: Option<(DVec3, DVec3)>,
}

impl Moment {
    /// `None` where the region is no part of the base.
    pub(super) fn new(points: PointSet, base: Raster, region: Lattice, region_map: Option<(DVec3, DVec3)>) -> Option<Self> {
        is_part(base.lattice(), &region).then(|| Self { points, base: measured(base), region, region_map })
    }
}

/// A press of the brush.
#[derive(Debug)]
struct Press {
    brush: Brush,
    coat: Coat,
}

/// The part that deforms.
#[derive(Debug)]
struct Region {
    /// Its node `[0, 0, 0]` in the base.
    first: [usize; 3],
    dynamics: Dynamics,
    afloat: Afloat,
}

/// A piece of clay.
#[derive(Debug)]
pub struct Workpiece {
    surface: PointSurface,
    /// While a stroke lasts: samples under way.
    under_way: Option<PointSet>,
    /// While the brush is pressed; never together with samples under way.
    press: Option<Press>,
    /// Measured, as frames want it.
    base: Arc<Raster>,
    region: Region,
    settings: Settings,
    gap_m: f64,
    /// How far samples went since gaps were filled, m.
    went_m: f64,
    past: Vec<Moment>,
    undone: Vec<Moment>,
    strokes: u64,
    updates: u64,
}

impl Workpiece {
    /// A piece from samples. Parallel; cost: a fit per sample, and the nodes of the base raster.
    ///
    /// # Errors
    /// [`WorkpieceError`].
    pub fn new(points: PointSet, settings: Settings) -> Result<Self, WorkpieceError> {
        let surface = PointSurface::build(points, settings.n_neighbours)?;
        let (whole, first, region) = lattices(surface.bounds(), &settings)?;
        let base = measured(surface.rasterize(whole));
        let region = Region::new(surface.points(), &base, first, region, &settings);
        let gap_m = GAP_SPACINGS * surface.spacing_m();
        Ok(Self {
            surface,
            under_way: None,
            press: None,
            base,
            region,
            settings,
            gap_m,
            went_m: 0.0,
            past: Vec::new(),
            undone: Vec::new(),
            strokes: 0,
            updates: 0,
        })
    }

    /// The piece of a session.
    pub(super) fn resume(session: Session) -> Result<Self, WorkpieceError> {
        let Session { now, past, undone, settings, gap_m } = session;
        let surface = PointSurface::build(now.points, settings.n_neighbours)?;
        for moment in past.iter().chain(&undone) {
            moment.points.check()?;
        }
        let first = first_node(now.base.lattice(), &now.region);
        let region = Region::new(surface.points(), &now.base, first, now.region, &settings);
        Ok(Self {
            surface,
            under_way: None,
            press: None,
            base: now.base,
            region,
            settings,
            gap_m,
            went_m: 0.0,
            past,
            undone,
            strokes: 0,
            updates: 0,
        })
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

    /// Samples in the region.
    pub fn n_afloat(&self) -> usize {
        self.region.afloat.samples().len()
    }

    /// The largest empty circle between samples that is left open, m.
    pub fn gap_m(&self) -> f64 {
        self.gap_m
    }

    /// How it is worked.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Lowest and highest corner of what deforms, map frame, m.
    pub fn region_map(&self) -> (DVec3, DVec3) {
        self.region().lattice().bounds()
    }

    /// Another material, from the next update on.
    pub fn set_material(&mut self, material: Material) {
        *self.region.dynamics.material_mut() = material.clone();
        self.settings.material = material;
    }

    /// A stroke is under way.
    pub fn is_stroke(&self) -> bool {
        self.under_way.is_some() || self.press.is_some()
    }

    /// Strokes that were begun, without those that made no surface.
    pub fn strokes(&self) -> u64 {
        self.strokes
    }

    /// The nearest place of the surface to a point, and the way out there, as densities have it now; `None` far from it.
    pub fn onto(&self, point_map: DVec3, within_m: f64) -> Option<(DVec3, DVec3)> {
        advect::onto_level(|at| self.density_at(at), self.base.lattice().spacing_m, (point_map, 0.0), within_m)
    }

    /// The place of the surface on a line through a point near it; `None` where the line runs along the surface, or meets none within a distance.
    pub fn onto_along(&self, point_map: DVec3, direction: DVec3, within_m: f64) -> Option<DVec3> {
        advect::onto_level_along(|at| self.density_at(at), self.base.lattice().spacing_m, (point_map, direction), within_m)
    }

    /// The density at a point now, m, greater than 0 inside; `None` far from the piece.
    pub fn density_m(&self, point_map: DVec3) -> Option<f64> {
        self.density_at(point_map).map(|density| f64::from(density.value_m))
    }

    fn density_at(&self, point_map: DVec3) -> Option<Density> {
        self.region().at(point_map).or_else(|| self.base.at(point_map))
    }

    /// Another part is to deform: a stroke under way ends first.
    ///
    /// # Errors
    /// [`WorkpieceError::Region`], [`WorkpieceError::TooFine`]; nothing has changed then but that the stroke has ended.
    pub fn choose_region(&mut self, low_map: DVec3, high_map: DVec3) -> Result<(), WorkpieceError> {
        self.end_stroke()?;
        let settings = Settings { region_map: Some((low_map, high_map)), ..self.settings.clone() };
        let (whole, first, region) = lattices(self.surface.bounds(), &settings)?;
        self.base = measured(self.surface.rasterize(whole));
        self.region = Region::new(self.surface.points(), &self.base, first, region, &settings);
        self.settings = settings;
        Ok(())
    }

    /// A stroke begins: what is there can be had back. Does nothing during one.
    ///
    /// # Errors
    /// [`SurfaceError`] where the brush was pressed, and what it left makes no surface; that is taken back then, and no stroke begins.
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
    pub fn pull(&mut self, pull: &Pull) -> Result<(), SurfaceError> {
        self.begin_stroke()?;
        let (now, forces_n) = self.region.dynamics.forces_n_mut();
        add_pull(now, pull, forces_n);
        Ok(())
    }

    /// Lets the material move for a time. Cost: O(nodes and samples of the region); more when gaps are filled.
    pub fn advance(&mut self, time_s: f64) -> Progress {
        let Region { dynamics, afloat, .. } = &mut self.region;
        let progress = dynamics.update(time_s);
        self.updates += 1;
        if let Some(points) = &mut self.under_way {
            self.went_m += afloat.follow(points, dynamics.now(), dynamics.velocities_m_per_s(), progress.time_s);
            if self.went_m > self.gap_m {
                self.went_m = 0.0;
                resample::fill(points, afloat, dynamics.now(), self.gap_m);
            }
        }
        progress
    }

    /// The stroke is over: what is there stays. Densities become distances, samples are made even, and fits are taken from the densities
    /// (equation 5). Does nothing without a stroke.
    ///
    /// # Errors
    /// [`SurfaceError`] when the samples make no surface any more; then it is as it was before the stroke.
    pub fn end_stroke(&mut self) -> Result<(), SurfaceError> {
        self.lift_brush()?;
        let Some(mut points) = self.under_way.take() else { return Ok(()) };
        let Region { first, dynamics, afloat } = &mut self.region;
        resample::fill(&mut points, afloat, dynamics.now(), self.gap_m);
        let kept = resample::thinned(&points, afloat, CLOSE_SPACINGS * self.surface.spacing_m());
        let mut now = dynamics.now().clone();
        redistance(&mut now);
        let mut base = (*self.base).clone();
        copy_into(&mut base, &now, *first);

        let n_before = self.surface.points().len();
        let result = adopt(&mut self.surface, &points, &kept, n_before, &base);
        if let Err(error) = result {
            self.take_back();
            return Err(error);
        }
        self.base = measured(base);
        dynamics.replace(now);
        *afloat = Afloat::new(self.surface.points(), dynamics.now(), 0.0);
        Ok(())
    }

    /// The stroke under way has never been: what was there before it is there again. Does nothing without a stroke.
    pub fn cancel_stroke(&mut self) {
        if self.is_stroke() {
            self.take_back();
        }
    }

    /// Paints under a brush that is pressed near a place of the surface with a force. Dabs with one brush are one stroke, until it
    /// [ends](Self::end_stroke). Gives how many samples took colour. Cost: O(samples under the brush).
    ///
    /// # Errors
    /// [`SurfaceError`] where another stroke had to end first, and made no surface; that is taken back then.
    pub fn paint(&mut self, brush: &Brush, at_map: DVec3, force_n: f64) -> Result<usize, SurfaceError> {
        let radius_m = brush.radius_m(force_n);
        let Some((at_map, normal_map)) = self.onto(at_map, radius_m) else { return Ok(0) };
        if self.press.as_ref().is_none_or(|press| press.brush != *brush) {
            self.end_stroke()?;
            self.remember();
            self.press = Some(Press { brush: brush.clone(), coat: Coat::over(&self.surface.points().colors) });
        }
        let Some(Press { coat, .. }) = &mut self.press else { return Ok(0) };
        let mut found = Vec::new();
        self.surface.neighbours().within(at_map, radius_m, &mut found);
        let near: Vec<u32> = found.iter().map(|near| near.sample).collect();
        Ok(coat.dab(self.surface.colors_mut(), &near, brush, Dab { at_map, normal_map, radius_m }))
    }

    /// The press of the brush is over: samples that its rim only half covers are split.
    fn lift_brush(&mut self) -> Result<(), SurfaceError> {
        let Some(Press { brush, coat }) = self.press.take() else { return Ok(()) };
        let surface = &self.surface;
        let surfel = |(sample, spacing_m): (usize, &f64)| Surfel { sample: sample as u32, radius_m: DISC_SPACINGS * spacing_m };
        let discs: Vec<Surfel> = surface.spacings_m().iter().enumerate().map(surfel).collect();
        let onto = |at: DVec3| {
            let at = surface.project(at)?;
            let normal = surface.at(at).normal();
            normal.is_normalized().then_some((at, normal))
        };
        let added = coat.refined(surface.points(), &discs, &brush, onto);
        if added.is_empty() {
            return Ok(());
        }
        if let Err(error) = self.surface.replace(&[], &added) {
            self.take_back();
            return Err(error);
        }
        self.region.afloat = Afloat::new(self.surface.points(), self.region.dynamics.now(), 0.0);
        Ok(())
    }

    /// A disc with less than this is not split by the rim of a brush, m.
    pub fn smallest_disc_m(&self) -> f64 {
        SPLIT_SPACINGS * self.gap_m
    }

    /// Raises the surface by an image, or sinks it in: one stroke, or none where the image reaches no sample. Gives how many samples it moved.
    ///
    /// # Errors
    /// [`SurfaceError`]; then it is as before.
    pub fn emboss(&mut self, image: &GreyImage, laid: &Laid, depth_m: f64) -> Result<usize, SurfaceError> {
        self.end_stroke()?;
        let moved = embossed(&self.surface, image, laid, depth_m);
        if moved.is_empty() {
            return Ok(0);
        }
        self.remember();
        let samples: Vec<u32> = (0..self.surface.points().len() as u32).collect();
        let result = self.surface.move_samples(&moved).and_then(|()| self.surface.refit(&samples));
        if let Err(error) = result {
            self.take_back();
            return Err(error);
        }
        self.rasterize_again();
        Ok(moved.len())
    }

    /// Joins the piece with another solid, or cuts one by the other: one stroke.
    ///
    /// `is_sharp`: the edge between both stays, as far as the raster holds it; otherwise one smooth surface goes over it.
    ///
    /// # Errors
    /// [`SurfaceError`] when nothing is left that makes a surface; then it is as before.
    pub fn combine(&mut self, boolean: Boolean, other: &PointSurface, is_sharp: bool) -> Result<(), WorkpieceError> {
        self.end_stroke()?;
        let points = boolean.samples(&self.surface, other, is_sharp);
        let surface = PointSurface::build(points, self.settings.n_neighbours)?;
        let (whole, first, region) = lattices(surface.bounds(), &self.settings)?;
        let base = measured(if is_sharp {
            boolean.densities(&self.surface.rasterize(whole), &other.rasterize(whole))
        } else {
            surface.rasterize(whole)
        });
        self.remember();
        self.surface = surface;
        self.base = base;
        self.region = Region::new(self.surface.points(), &self.base, first, region, &self.settings);
        Ok(())
    }

    /// Takes the last stroke back; false when there is none.
    ///
    /// # Errors
    /// [`SurfaceError`]; what was a surface is one again, so this is a defect of the program.
    pub fn undo(&mut self) -> Result<bool, SurfaceError> {
        self.end_stroke()?;
        let Some(past) = self.past.pop() else { return Ok(false) };
        self.undone.push(self.moment());
        self.go_to(past)?;
        Ok(true)
    }

    /// Does again what was taken back last; false when nothing was since the last stroke.
    ///
    /// # Errors
    /// As [`Self::undo`].
    pub fn redo(&mut self) -> Result<bool, SurfaceError> {
        self.end_stroke()?;
        let Some(next) = self.undone.pop() else { return Ok(false) };
        self.past.push(self.moment());
        self.go_to(next)?;
        Ok(true)
    }

    /// Strokes that can be taken back, and those that can be done again.
    pub fn history(&self) -> (usize, usize) {
        (self.past.len(), self.undone.len())
    }

    /// Writes the densities into a frame for the tick. Cost: a copy of the region.
    pub fn show(&self, frame: &mut Frame) {
        frame.sequence = self.updates;
        frame.base = self.base.clone();
        let now = self.region.dynamics.now();
        if frame.region.lattice() == now.lattice() {
            frame.region.values_m_mut().copy_from_slice(now.values_m());
        } else {
            frame.region = now.clone();
        }
    }

    /// A frame of its own, such as a scene begins with. Allocates; [`Self::show`] fills it again.
    ///
    /// # Errors
    /// [`FrameError`], which no piece gives that could be made.
    pub fn frame(&self) -> Result<Frame, FrameError> {
        let mut frame = Frame { sequence: self.updates, base: self.base.clone(), region: self.region().clone(), rope_map: None };
        frame.make_ready(None)?;
        Ok(frame)
    }

    /// What undo and redo go to, each with the nearest at its end.
    pub(super) fn moments(&self) -> (&[Moment], &[Moment]) {
        (&self.past, &self.undone)
    }

    /// What is there, a stroke under way apart.
    pub(super) fn moment(&self) -> Moment {
        Moment {
            points: self.surface.points().clone(),
            base: self.base.clone(),
            region: *self.region.dynamics.lattice(),
            region_map: self.settings.region_map,
        }
    }

    fn remember(&mut self) {
        self.past.push(self.moment());
        self.strokes += 1;
        if self.past.len() > PAST_MAX {
            self.past.remove(0);
        }
        self.undone.clear();
    }

    /// Back to before a stroke that failed.
    fn take_back(&mut self) {
        (self.under_way, self.press) = (None, None);
        self.strokes = self.strokes.saturating_sub(1);
        if let Some(moment) = self.past.pop() {
            // It was a surface before.
            let _ = self.go_to(moment);
        }
    }

    fn go_to(&mut self, Moment { points, base, region, region_map }: Moment) -> Result<(), SurfaceError> {
        self.surface = PointSurface::build(points, self.settings.n_neighbours)?;
        self.base = base;
        self.settings.region_map = region_map;
        self.cut_region(region);
        Ok(())
    }

    fn rasterize_again(&mut self) {
        self.base = measured(self.surface.rasterize(*self.base.lattice()));
        self.cut_region(*self.region.dynamics.lattice());
    }

    /// The region out of the base, on nodes of it.
    fn cut_region(&mut self, lattice: Lattice) {
        let first = first_node(self.base.lattice(), &lattice);
        self.region = Region::new(self.surface.points(), &self.base, first, lattice, &self.settings);
    }
}

/// How steep it is has to be known before it is shared.
fn measured(mut raster: Raster) -> Arc<Raster> {
    raster.measure();
    Arc::new(raster)
}

impl Region {
    fn new(points: &PointSet, base: &Raster, first: [usize; 3], lattice: Lattice, settings: &Settings) -> Self {
        let now = cut(base, first, lattice);
        let afloat = Afloat::new(points, &now, 0.0);
        Self { first, dynamics: Dynamics::new(now, settings.material.clone(), settings.integrator), afloat }
    }
}

#[cfg(test)]
mod tests;
