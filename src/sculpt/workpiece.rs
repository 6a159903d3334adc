//! The piece that is worked on: its samples, its densities, and every stroke so far.
//!
//! ```text
//!  samples ─► PointSurface ─► base raster ─┬─► region: Dynamics ◄── pulls
//!     ▲                                    │         │ densities
//!     │        stroke ends: distances ◄────┼─────────┤
//!     └── fits from densities (Eq. 5) ◄────┘         └─► samples float along, come and go
//! ```
//! A stroke works on copies; what a look-up of [`Workpiece::surface`] gives changes when it ends.

use std::sync::Arc;

use glam::DVec3;

use super::advect::Afloat;
use super::boolean::Boolean;
use super::dynamics::{Dynamics, Integrator, Material, Progress};
use super::emboss::{GreyImage, Laid, embossed};
use super::paint::{Brush, Surfel, paint};
use super::pull::{Pull, add_pull};
use super::redistance::redistance;
use super::{Moved, PointSet, PointSurface, SurfaceError, advect, resample};
use crate::haptics::clay::{Frame, Lattice, Raster};

/// Largest empty circle and closest pair of samples in a region, in spacings of the samples at the start.
const GAP_SPACINGS: f64 = 1.0;
const CLOSE_SPACINGS: f64 = 0.35;
/// Air around all samples in the base raster, in its spacings: room for what is pulled out, beyond what the caller asks for.
const AIR_SPACINGS: f64 = 4.0;
/// Nodes of the base raster at most: 128 MiB.
const NODES_MAX: usize = 1 << 25;
/// Strokes that can be taken back.
const PAST_MAX: usize = 64;
/// Radius of a sample's disc, in its spacings: neighbouring discs overlap.
const DISC_SPACINGS: f64 = 0.75;

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

/// What was there before a stroke.
#[derive(Clone, Debug)]
struct Past {
    points: PointSet,
    base: Arc<Raster>,
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
    base: Arc<Raster>,
    region: Region,
    settings: Settings,
    gap_m: f64,
    /// How far samples went since gaps were filled, m.
    went_m: f64,
    past: Vec<Past>,
    undone: Vec<Past>,
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
        let base = Arc::new(surface.rasterize(whole));
        let region = Region::new(surface.points(), &base, first, region, &settings);
        let gap_m = GAP_SPACINGS * surface.spacing_m();
        Ok(Self {
            surface,
            under_way: None,
            base,
            region,
            settings,
            gap_m,
            went_m: 0.0,
            past: Vec::new(),
            undone: Vec::new(),
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

    /// What it is made of; changes take effect with the next update.
    pub fn material_mut(&mut self) -> &mut Material {
        self.region.dynamics.material_mut()
    }

    /// The nearest place of the surface to a point, and the way out there, as densities have it now; `None` far from it.
    pub fn onto(&self, point_map: DVec3, within_m: f64) -> Option<(DVec3, DVec3)> {
        advect::onto_level(self.densities_at(point_map), point_map, 0.0, within_m)
    }

    fn densities_at(&self, point_map: DVec3) -> &Raster {
        if self.region().at(point_map).is_some() { self.region() } else { &self.base }
    }

    /// Another part is to deform: a stroke under way ends first.
    ///
    /// # Errors
    /// [`WorkpieceError::Region`], [`WorkpieceError::TooFine`]; nothing has changed then but that the stroke has ended.
    pub fn choose_region(&mut self, low_map: DVec3, high_map: DVec3) -> Result<(), WorkpieceError> {
        self.end_stroke()?;
        let settings = Settings { region_map: Some((low_map, high_map)), ..self.settings.clone() };
        let (whole, first, region) = lattices(self.surface.bounds(), &settings)?;
        self.base = Arc::new(self.surface.rasterize(whole));
        self.region = Region::new(self.surface.points(), &self.base, first, region, &settings);
        self.settings = settings;
        Ok(())
    }

    /// A stroke begins: what is there can be had back. Does nothing during one.
    pub fn begin_stroke(&mut self) {
        if self.under_way.is_none() {
            self.remember();
            self.under_way = Some(self.surface.points().clone());
            self.went_m = 0.0;
        }
    }

    /// A force on the material for the next update; begins a stroke.
    pub fn pull(&mut self, pull: &Pull) {
        self.begin_stroke();
        let (now, forces_n) = self.region.dynamics.forces_n_mut();
        add_pull(now, pull, forces_n);
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
        self.base = Arc::new(base);
        dynamics.replace(now);
        *afloat = Afloat::new(self.surface.points(), dynamics.now(), 0.0);
        Ok(())
    }

    /// Paints under a brush that is pressed at a place with a force: a part of a stroke, or one by itself when none is under way. Gives how
    /// many samples were added.
    ///
    /// # Errors
    /// [`SurfaceError`]; nothing has changed then.
    pub fn paint(&mut self, brush: &Brush, at_map: DVec3, force_n: f64) -> Result<usize, SurfaceError> {
        self.end_stroke()?;
        let mut found = Vec::new();
        let reach_m = brush.radius_m(force_n) + DISC_SPACINGS * self.surface.spacing_m();
        self.surface.neighbours().within(at_map, reach_m, &mut found);
        let disc_m = |sample: u32| DISC_SPACINGS * self.surface.spacings_m()[sample as usize];
        let near: Vec<Surfel> = found.iter().map(|near| Surfel { sample: near.sample, radius_m: disc_m(near.sample) }).collect();
        let mut points = self.surface.points().clone();
        let n_before = points.len() as u32;
        let surface = &self.surface;
        let onto = |at: DVec3| {
            let at = surface.project(at)?;
            let normal = surface.at(at).normal();
            normal.is_normalized().then_some((at, normal))
        };
        let added = paint(&mut points, &near, brush, (at_map, force_n), onto);
        self.surface.colors_mut().copy_from_slice(&points.colors[..n_before as usize]);
        if !added.is_empty() {
            let new = points.select(n_before..points.len() as u32);
            self.surface.replace(&[], &new)?;
            self.region.afloat = Afloat::new(self.surface.points(), self.region.dynamics.now(), 0.0);
        }
        Ok(added.len())
    }

    /// Raises the surface by an image, or sinks it in: one stroke.
    ///
    /// # Errors
    /// [`SurfaceError`]; then it is as before.
    pub fn emboss(&mut self, image: &GreyImage, laid: &Laid, depth_m: f64) -> Result<usize, SurfaceError> {
        self.end_stroke()?;
        self.remember();
        let moved = embossed(&self.surface, image, laid, depth_m);
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
        let base = if is_sharp {
            boolean.densities(&self.surface.rasterize(whole), &other.rasterize(whole))
        } else {
            surface.rasterize(whole)
        };
        self.remember();
        self.surface = surface;
        self.base = Arc::new(base);
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
        self.undone.push(Past { points: self.surface.points().clone(), base: self.base.clone() });
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
        self.past.push(Past { points: self.surface.points().clone(), base: self.base.clone() });
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

    fn remember(&mut self) {
        self.past.push(Past { points: self.surface.points().clone(), base: self.base.clone() });
        if self.past.len() > PAST_MAX {
            self.past.remove(0);
        }
        self.undone.clear();
    }

    /// Back to before a stroke that failed.
    fn take_back(&mut self) {
        if let Some(past) = self.past.pop() {
            // It was a surface before.
            let _ = self.go_to(past);
        }
    }

    fn go_to(&mut self, Past { points, base }: Past) -> Result<(), SurfaceError> {
        self.surface = PointSurface::build(points, self.settings.n_neighbours)?;
        self.base = base;
        self.cut_region_again();
        Ok(())
    }

    fn rasterize_again(&mut self) {
        self.base = Arc::new(self.surface.rasterize(*self.base.lattice()));
        self.cut_region_again();
    }

    /// The region out of another base.
    fn cut_region_again(&mut self) {
        // A Boolean may have given the base another lattice: then the region is chosen anew.
        let lattice = *self.region.dynamics.lattice();
        let first = first_node(self.base.lattice(), &lattice);
        self.region = Region::new(self.surface.points(), &self.base, first, lattice, &self.settings);
    }
}

impl Region {
    fn new(points: &PointSet, base: &Raster, first: [usize; 3], lattice: Lattice, settings: &Settings) -> Self {
        let now = cut(base, first, lattice);
        let afloat = Afloat::new(points, &now, 0.0);
        Self { first, dynamics: Dynamics::new(now, settings.material.clone(), settings.integrator), afloat }
    }
}

/// The lattice of the base, the first node of the region in it, and the lattice of the region.
fn lattices((low, high): (DVec3, DVec3), settings: &Settings) -> Result<(Lattice, [usize; 3], Lattice), WorkpieceError> {
    let dims = settings.raster;
    if dims.iter().any(|n| *n < 4) {
        return Err(WorkpieceError::Raster(dims));
    }
    let (low, high) = (low - settings.air_m, high + settings.air_m);
    let (region_low, region_high) = settings.region_map.unwrap_or((low, high));
    if !(region_high.cmpgt(region_low).all() && region_low.is_finite() && region_high.is_finite()) {
        return Err(WorkpieceError::Region(region_low, region_high));
    }
    // One spacing for all axes; the box grows about its middle to hold whole steps of it.
    let steps = DVec3::from_array(dims.map(|n| (n - 1) as f64));
    let spacing_m = ((region_high - region_low) / steps).max_element();
    let origin = 0.5 * (region_low + region_high) - 0.5 * spacing_m * steps;
    let region = Lattice { origin_map: origin, spacing_m, dims };
    // The base goes on from there to all sides.
    let nodes_below = ((origin - low) / spacing_m + AIR_SPACINGS).ceil().max(DVec3::ZERO);
    let last = origin + spacing_m * steps;
    let nodes_above = ((high - last) / spacing_m + AIR_SPACINGS).ceil().max(DVec3::ZERO);
    let nodes = nodes_below + steps + nodes_above + 1.0;
    let n_nodes = nodes.element_product();
    let fits = n_nodes <= NODES_MAX as f64;
    if !fits {
        return Err(WorkpieceError::TooFine { spacing_m, n_nodes });
    }
    let whole = Lattice { origin_map: origin - nodes_below * spacing_m, spacing_m, dims: nodes.to_array().map(|n| n as usize) };
    Ok((whole, nodes_below.to_array().map(|n| n as usize), region))
}

fn first_node(whole: &Lattice, part: &Lattice) -> [usize; 3] {
    ((part.origin_map - whole.origin_map) / whole.spacing_m).round().to_array().map(|n| n.max(0.0) as usize)
}

/// A part of a raster.
fn cut(whole: &Raster, first: [usize; 3], part: Lattice) -> Raster {
    let mut raster = Raster::uniform(part, 0.0);
    let [nx, ny, nz] = part.dims;
    for x in 0..nx {
        for y in 0..ny {
            let from = whole.lattice().index([first[0] + x, first[1] + y, first[2]]);
            let to = part.index([x, y, 0]);
            raster.values_m_mut()[to..to + nz].copy_from_slice(&whole.values_m()[from..from + nz]);
        }
    }
    raster
}

/// Puts a part back to where it was cut out.
fn copy_into(whole: &mut Raster, part: &Raster, first: [usize; 3]) {
    let [nx, ny, nz] = part.lattice().dims;
    for x in 0..nx {
        for y in 0..ny {
            let to = whole.lattice().index([first[0] + x, first[1] + y, first[2]]);
            let from = part.lattice().index([x, y, 0]);
            whole.values_m_mut()[to..to + nz].copy_from_slice(&part.values_m()[from..from + nz]);
        }
    }
}

/// Lets a surface have the samples of a stroke: those that moved, without those that go, and with those that came.
fn adopt(surface: &mut PointSurface, points: &PointSet, kept: &[u32], n_before: usize, base: &Raster) -> Result<(), SurfaceError> {
    let before = surface.points();
    let moved: Vec<Moved> = (0..n_before)
        .filter(|sample| before.positions_map[*sample] != points.positions_map[*sample])
        .map(|sample| Moved {
            sample: sample as u32,
            position_map: points.positions_map[sample],
            normal_map: points.normals_map[sample],
        })
        .collect();
    let mut stays = vec![false; points.len()];
    kept.iter().for_each(|sample| stays[*sample as usize] = true);
    let removed: Vec<u32> = (0..n_before as u32).filter(|sample| !stays[*sample as usize]).collect();
    let added = points.select(kept.iter().copied().filter(|sample| *sample as usize >= n_before));
    surface.move_samples(&moved)?;
    surface.replace(&removed, &added)?;
    // Those that moved have numbers of their own now: those that stay kept their order.
    let mut number = 0;
    let mut refreshed = Vec::new();
    let mut moved = moved.iter().map(|moved| moved.sample).peekable();
    for sample in 0..n_before as u32 {
        let has_moved = moved.next_if_eq(&sample).is_some();
        if stays[sample as usize] {
            if has_moved {
                refreshed.push(number);
            }
            number += 1;
        }
    }
    surface.refresh(&refreshed, |at| base.at(at).map(|density| f64::from(density.value_m)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sculpt::falloff::Falloff;
    use crate::sculpt::shapes::sphere;

    const R: f64 = 0.02;

    fn settings() -> Settings {
        Settings {
            region_map: Some((DVec3::new(-0.012, -0.012, 0.008), DVec3::new(0.012, 0.012, 0.032))),
            raster: [31; 3],
            air_m: 5e-3,
            material: Material { creep_s: 0.05, acceleration_max_m_per_s2: f64::INFINITY, ..Material::default() },
            ..Settings::default()
        }
    }

    fn ball() -> Workpiece {
        Workpiece::new(sphere(4000, R), settings()).unwrap()
    }

    /// Pulls the pole up, or pushes it down, in 50 updates.
    fn stroke(piece: &mut Workpiece, force_n: f64) {
        for _ in 0..50 {
            let top = piece.onto(DVec3::Z * R, 0.01).map_or(DVec3::Z * R, |(at, _)| at);
            piece.pull(&Pull {
                along_map: vec![top],
                force_n: DVec3::Z * force_n,
                reach_m: 3e-3,
                radius_m: 5e-3,
                falloff: Falloff::Gaussian,
            });
            piece.advance(4e-3);
        }
        piece.end_stroke().unwrap();
    }

    fn top_m(piece: &Workpiece) -> f64 {
        piece.points().positions_map.iter().map(|at| at.z).fold(0.0, f64::max)
    }

    #[test]
    fn a_stroke_moves_the_surface_its_samples_and_its_fits_together() {
        for force_n in [10.0, -10.0] {
            let mut piece = ball();
            stroke(&mut piece, force_n);
            let moved = piece.onto(DVec3::Z * R, 0.01).unwrap().0.z - R;
            assert!(moved * force_n.signum() > 1e-3, "{force_n} N moved it by {moved} m");
            let samples: Vec<u32> = (0..piece.points().len() as u32).collect();
            assert!(resample::largest_gap_m(piece.points(), &samples, piece.gap_m()) <= piece.gap_m());
            for (at, normal) in piece.points().positions_map.iter().zip(&piece.points().normals_map) {
                let off = f64::from(piece.densities_at(*at).at(*at).unwrap().value_m);
                assert!(off.abs() < 0.1 * piece.region().lattice().spacing_m, "{at}: {off} m off in the densities");
                let fitted = piece.surface().at(*at).value_m;
                assert!(fitted.abs() < 0.2 * piece.surface().spacing_m(), "{at}: {fitted} m off in the fits");
                assert!(normal.is_normalized());
            }
            // Far from the stroke nothing has moved.
            let before = sphere(4000, R);
            let far = before.positions_map.iter().filter(|at| at.z < 0.0);
            assert!(far.clone().all(|at| piece.points().positions_map.contains(at)));
        }
    }

    #[test]
    fn strokes_are_taken_back_and_done_again() {
        let mut piece = ball();
        let start = (piece.points().clone(), piece.base().clone());
        stroke(&mut piece, 10.0);
        let first = (piece.points().clone(), piece.base().clone());
        stroke(&mut piece, -5.0);
        let second = (piece.points().clone(), piece.base().clone());
        assert_eq!(piece.history(), (2, 0));
        let is = |piece: &Workpiece, (points, base): &(PointSet, Arc<Raster>)| {
            piece.points() == points && piece.base().values_m() == base.values_m()
        };
        assert!(piece.undo().unwrap() && is(&piece, &first));
        assert!(piece.undo().unwrap() && is(&piece, &start));
        assert!(!piece.undo().unwrap());
        assert!(piece.redo().unwrap() && is(&piece, &first));
        assert!(piece.redo().unwrap() && is(&piece, &second));
        assert!(!piece.redo().unwrap());
        piece.undo().unwrap();
        stroke(&mut piece, 3.0);
        assert_eq!(piece.history(), (2, 0), "a new stroke leaves nothing to be done again");
    }

    #[test]
    fn the_same_strokes_give_the_same_bits_on_any_number_of_threads() {
        let on = |threads: usize| {
            rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(|| {
                let mut piece = ball();
                stroke(&mut piece, 10.0);
                (piece.points().clone(), piece.base().values_m().to_vec())
            })
        };
        assert!(on(1) == on(4));
    }

    #[test]
    fn a_bite_is_taken_out_and_an_image_stands_out() {
        let mut piece = ball();
        let bite = PointSurface::build(
            {
                let mut points = sphere(2000, 0.01);
                points.positions_map.iter_mut().for_each(|at| *at += DVec3::X * R);
                points
            },
            PointSurface::DEFAULT_NEIGHBOURS,
        )
        .unwrap();
        for is_sharp in [false, true] {
            piece.combine(Boolean::Difference, &bite, is_sharp).unwrap();
            let middle = piece.base().at(DVec3::X * 0.015).unwrap().value_m;
            assert!(middle < -3e-3, "{middle} m where the bite was");
            let left = piece.base().at(-DVec3::X * 0.015).unwrap().value_m;
            assert!(left > 3e-3, "{left} m where nothing was taken");
            assert!(piece.undo().unwrap());
        }
        let white = GreyImage::new(2, 2, vec![1.0; 4]).unwrap();
        let laid = Laid::Around { center_map: DVec3::ZERO, north_map: DVec3::Z, front_map: DVec3::X };
        assert_eq!(piece.emboss(&white, &laid, 1e-3).unwrap(), 4000);
        assert!((top_m(&piece) - (R + 1e-3)).abs() < 1e-4, "{}", top_m(&piece));
    }

    #[test]
    fn a_frame_shows_the_region_as_it_is() {
        let mut piece = ball();
        let lattice = Lattice { origin_map: DVec3::ZERO, spacing_m: 1.0, dims: [2; 3] };
        let nothing = Raster::uniform(lattice, 0.0);
        let mut frame = Frame { sequence: 0, base: Arc::new(nothing.clone()), region: nothing, rope_map: None };
        for sequence in 1..4 {
            piece.advance(4e-3);
            piece.show(&mut frame);
            assert_eq!((frame.sequence, frame.region.values_m()), (sequence, piece.region().values_m()));
            assert!(Arc::ptr_eq(&frame.base, piece.base()));
            // Nodes of the region are nodes of the base, with its densities where nothing moves.
            let corner = frame.region.lattice().position([0, 0, 0]);
            assert_eq!(frame.region.at(corner).unwrap().value_m, frame.base.at(corner).unwrap().value_m);
        }
    }

    #[test]
    fn what_cannot_be_worked_is_refused() {
        let refused = |change: fn(&mut Settings)| {
            let mut settings = settings();
            change(&mut settings);
            Workpiece::new(sphere(500, R), settings).map(drop).unwrap_err()
        };
        assert!(matches!(refused(|settings| settings.raster = [3, 10, 10]), WorkpieceError::Raster(_)));
        assert!(matches!(refused(|settings| settings.region_map = Some((DVec3::ONE, DVec3::ZERO))), WorkpieceError::Region(..)));
        assert!(matches!(refused(|settings| settings.region_map = Some((DVec3::NAN, DVec3::ZERO))), WorkpieceError::Region(..)));
        let fine = refused(|settings| settings.region_map = Some((DVec3::ZERO, DVec3::splat(1e-4))));
        assert!(matches!(fine, WorkpieceError::TooFine { .. }), "{fine}");
        let few = Workpiece::new(sphere(3, R), settings()).map(drop).unwrap_err();
        assert!(matches!(few, WorkpieceError::Surface(SurfaceError::TooFew { found: 3 })), "{few}");
    }
}
