//! What was there before each stroke, and the way back.

use std::sync::Arc;

use glam::DVec3;

use super::super::dynamics::Material;
use super::super::material_map::MaterialMap;
use super::super::{Cancel, PointSet, PointSurface, SurfaceError, WorkMeter};
use super::lattices::{first_node, is_part};
use super::{ClayModel, ClayModelError, DynamicRegion, Settings, measured};
use vps::density::{Lattice, Raster};

/// Strokes that can be taken back, and the memory that they take, bytes: of a large model there are
/// fewer of them.
const PAST_MAX: usize = 64;
const PAST_BYTES_MAX: usize = 1 << 30;

/// What was there before a stroke, and which part of it deformed.
#[derive(Clone, Debug)]
pub(in super::super) struct Snapshot {
    pub(in super::super) samples: SnapshotSamples,
    /// Measured.
    pub(in super::super) base: Arc<Raster>,
    pub(in super::super) material_map: MaterialMap,
    pub(in super::super) region: Lattice,
    pub(in super::super) region_map: Option<(DVec3, DVec3)>,
    /// Of what was not painted.
    pub(in super::super) material: Material,
}

/// Samples of a moment.
#[derive(Clone, Debug)]
pub(in super::super) enum SnapshotSamples {
    /// With their fits: what is gone back to is what it was, at once.
    Fitted(Arc<PointSurface>),
    /// Out of a file, which keeps no fits.
    Bare(PointSet),
}

impl SnapshotSamples {
    pub(in super::super) fn points(&self) -> &PointSet {
        match self {
            Self::Fitted(surface) => surface.points(),
            Self::Bare(points) => points,
        }
    }

    fn fitted(
        &self,
        settings: &Settings,
        meter: &WorkMeter,
    ) -> Result<Arc<PointSurface>, SurfaceError> {
        match self {
            Self::Fitted(surface) => Ok(surface.clone()),
            Self::Bare(points) => settings.surface(points.clone(), meter).map(Arc::new),
        }
    }

    /// Samples that have no fits yet.
    pub(super) fn n_bare(&self) -> usize {
        match self {
            Self::Fitted(_) => 0,
            Self::Bare(points) => points.len(),
        }
    }

    /// What it takes in memory, bytes.
    fn n_bytes(&self) -> usize {
        match self {
            Self::Fitted(surface) => surface.n_bytes(),
            Self::Bare(points) => points.n_bytes(),
        }
    }
}

impl Snapshot {
    /// Of the default material. `None` where the region is no part of the base.
    pub(in super::super) fn new(
        points: PointSet,
        base: Raster,
        material_map: MaterialMap,
        region: Lattice,
        region_map: Option<(DVec3, DVec3)>,
    ) -> Option<Self> {
        let material = Material::default();
        let samples = SnapshotSamples::Bare(points);
        is_part(base.lattice(), &region).then(|| Self {
            samples,
            base: measured(base),
            material_map,
            region,
            region_map,
            material,
        })
    }

    /// What it takes in a session, bytes.
    pub(in super::super) fn n_bytes_in_session(&self) -> usize {
        self.samples.points().n_bytes()
            + size_of_val(self.base.values_m())
            + self.material_map.n_bytes()
    }

    /// What it takes in memory beside one that is newer, bytes: paint leaves the densities as they
    /// are, all but paint leaves the material, and what is before it and after it shares them.
    pub(super) fn n_bytes(&self, newer: Option<&Self>) -> usize {
        let is_shared = newer.is_some_and(|newer| Arc::ptr_eq(&newer.base, &self.base));
        let material_bytes = newer.map_or_else(
            || self.material_map.n_bytes(),
            |newer| self.material_map.n_bytes_beside(&newer.material_map),
        );
        self.samples.n_bytes()
            + material_bytes
            + if is_shared { 0 } else { size_of_val(self.base.values_m()) }
    }
}

/// A clay model with its past, as a file keeps it.
pub(in super::super) struct Session {
    pub(in super::super) now: Snapshot,
    pub(in super::super) past: Vec<Snapshot>,
    pub(in super::super) undone: Vec<Snapshot>,
    pub(in super::super) settings: Settings,
    pub(in super::super) gap_m: f64,
}

impl ClayModel {
    /// The clay of a session.
    pub(in super::super) fn resume(session: Session) -> Result<Self, ClayModelError> {
        let Session { now, past, undone, settings, gap_m } = session;
        let surface = now.samples.fitted(&settings, &WorkMeter::unlimited())?;
        for moment in past.iter().chain(&undone) {
            moment.samples.points().check()?;
        }
        let first = first_node(now.base.lattice(), &now.region);
        let region = DynamicRegion::new(
            surface.points(),
            (&now.base, &now.material_map),
            first,
            now.region,
            &settings,
        );
        Ok(Self {
            surface,
            under_way: None,
            press: None,
            material_coat: None,
            base: now.base,
            material_map: now.material_map,
            region,
            settings,
            gap_m,
            went_m: 0.0,
            past,
            undone,
            strokes: 0,
            updates: 0,
            cancel: Cancel::default(),
            reconnected: None,
        })
    }

    /// Takes the last stroke back; false when there is none.
    ///
    /// # Errors
    /// It was cancelled, or was longer than a change of this clay may be: nothing has changed then.
    pub fn undo(&mut self) -> Result<bool, ClayModelError> {
        self.end_stroke()?;
        let surface = self.past.last().map(|past| self.fits_of(past)).transpose()?;
        let (Some(surface), Some(past)) = (surface, self.past.pop()) else { return Ok(false) };
        self.undone.push(self.moment());
        self.go_to(past, surface);
        Ok(true)
    }

    /// Does again what was taken back last; false when nothing was since the last stroke.
    ///
    /// # Errors
    /// As [`Self::undo`].
    pub fn redo(&mut self) -> Result<bool, ClayModelError> {
        self.end_stroke()?;
        let surface = self.undone.last().map(|next| self.fits_of(next)).transpose()?;
        let (Some(surface), Some(next)) = (surface, self.undone.pop()) else { return Ok(false) };
        self.past.push(self.moment());
        self.go_to(next, surface);
        Ok(true)
    }

    fn fits_of(&self, moment: &Snapshot) -> Result<Arc<PointSurface>, ClayModelError> {
        let meter = self.meter(self.estimate_fits(moment))?;
        Ok(moment.samples.fitted(&self.settings, &meter)?)
    }

    /// Strokes that can be taken back, and those that can be done again.
    pub fn history(&self) -> (usize, usize) {
        (self.past.len(), if self.is_stroke() { 0 } else { self.undone.len() })
    }

    /// The stroke under way has never been: what was there before it is there again. Does nothing
    /// without a stroke.
    pub fn cancel_stroke(&mut self) {
        if self.is_stroke() {
            self.take_back();
        }
    }

    /// What undo and redo go to, each with the nearest at its end.
    pub(in super::super) fn moments(&self) -> (&[Snapshot], &[Snapshot]) {
        (&self.past, &self.undone)
    }

    /// What is there, a stroke under way apart.
    pub(in super::super) fn moment(&self) -> Snapshot {
        Snapshot {
            samples: SnapshotSamples::Fitted(self.surface.clone()),
            base: self.base.clone(),
            material_map: self.material_map.clone(),
            region: *self.region.dynamics.lattice(),
            region_map: self.settings.region_map,
            material: self.settings.material.clone(),
        }
    }

    pub(super) fn remember(&mut self) {
        self.past.push(self.moment());
        self.strokes += 1;
        forget(&mut self.past, PAST_BYTES_MAX);
    }

    /// The stroke is part of the clay: what was undone before it cannot be done again.
    pub(super) fn settle(&mut self) {
        self.undone.clear();
    }

    /// Back to before a stroke that failed.
    pub(super) fn take_back(&mut self) {
        (self.under_way, self.press, self.material_coat) = (None, None, None);
        self.strokes = self.strokes.saturating_sub(1);
        // It was a surface before.
        if let Some(moment) = self.past.pop()
            && let Ok(surface) = moment.samples.fitted(&self.settings, &WorkMeter::unlimited())
        {
            self.go_to(moment, surface);
        }
    }

    /// The stroke under way has changed nothing: it has never been, and what was undone before it
    /// can be done again still.
    pub(super) fn forget_stroke(&mut self) {
        (self.under_way, self.press, self.material_coat) = (None, None, None);
        self.strokes = self.strokes.saturating_sub(1);
        self.past.pop();
        self.cut_region(*self.region.dynamics.lattice());
    }

    fn go_to(&mut self, moment: Snapshot, surface: Arc<PointSurface>) {
        let Snapshot { samples: _, base, material_map, region, region_map, material } = moment;
        self.surface = surface;
        (self.base, self.material_map) = (base, material_map);
        (self.settings.region_map, self.settings.material) = (region_map, material);
        self.cut_region(region);
        // What met or parted is as it was.
        self.reconnected = None;
    }

    /// The region out of the base, on nodes of it.
    pub(super) fn cut_region(&mut self, lattice: Lattice) {
        let first = first_node(self.base.lattice(), &lattice);
        self.region = DynamicRegion::new(
            self.surface.points(),
            (&self.base, &self.material_map),
            first,
            lattice,
            &self.settings,
        );
    }
}

/// Leaves the newest, as many as fit, and the last one in any case.
pub(super) fn forget(past: &mut Vec<Snapshot>, bytes_max: usize) {
    let mut n = 0;
    let mut bytes = 0;
    let mut newer: Option<&Snapshot> = None;
    for moment in past.iter().rev() {
        bytes += moment.n_bytes(newer);
        if n == PAST_MAX || n > 0 && bytes > bytes_max {
            break;
        }
        n += 1;
        newer = Some(moment);
    }
    past.drain(..past.len() - n);
}
