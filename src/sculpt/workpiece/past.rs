//! What was there before each stroke, and the way back.

use std::sync::Arc;

use glam::DVec3;

use super::super::session::Session;
use super::super::{PointSet, PointSurface, SurfaceError};
use super::lattices::{first_node, is_part};
use super::{Region, Workpiece, WorkpieceError, measured};
use crate::haptics::clay::{Lattice, Raster};

/// Strokes that can be taken back, and the memory that they take, bytes: of a large piece there are fewer of them.
const PAST_MAX: usize = 64;
const PAST_BYTES_MAX: usize = 1 << 30;

/// What was there before a stroke, and which part of it deformed.
#[derive(Clone, Debug)]
pub(in super::super) struct Moment {
    pub(in super::super) points: PointSet,
    /// Measured.
    pub(in super::super) base: Arc<Raster>,
    pub(in super::super) region: Lattice,
    pub(in super::super) region_map: Option<(DVec3, DVec3)>,
}

impl Moment {
    /// `None` where the region is no part of the base.
    pub(in super::super) fn new(
        points: PointSet,
        base: Raster,
        region: Lattice,
        region_map: Option<(DVec3, DVec3)>,
    ) -> Option<Self> {
        is_part(base.lattice(), &region).then(|| Self { points, base: measured(base), region, region_map })
    }

    /// What it takes in memory, and in a session, bytes.
    pub(in super::super) fn n_bytes(&self) -> usize {
        self.points.n_bytes() + size_of_val(self.base.values_m())
    }
}

impl Workpiece {
    /// The piece of a session.
    pub(in super::super) fn resume(session: Session) -> Result<Self, WorkpieceError> {
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

    /// The stroke under way has never been: what was there before it is there again. Does nothing without a stroke.
    pub fn cancel_stroke(&mut self) {
        if self.is_stroke() {
            self.take_back();
        }
    }

    /// What undo and redo go to, each with the nearest at its end.
    pub(in super::super) fn moments(&self) -> (&[Moment], &[Moment]) {
        (&self.past, &self.undone)
    }

    /// What is there, a stroke under way apart.
    pub(in super::super) fn moment(&self) -> Moment {
        Moment {
            points: self.surface.points().clone(),
            base: self.base.clone(),
            region: *self.region.dynamics.lattice(),
            region_map: self.settings.region_map,
        }
    }

    pub(super) fn remember(&mut self) {
        self.past.push(self.moment());
        self.strokes += 1;
        forget(&mut self.past, PAST_BYTES_MAX);
        self.undone.clear();
    }

    /// Back to before a stroke that failed.
    pub(super) fn take_back(&mut self) {
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

    /// The region out of the base, on nodes of it.
    pub(super) fn cut_region(&mut self, lattice: Lattice) {
        let first = first_node(self.base.lattice(), &lattice);
        self.region = Region::new(self.surface.points(), &self.base, first, lattice, &self.settings);
    }
}

/// Leaves the newest, as many as there is room for, and the last one in any case.
pub(super) fn forget(past: &mut Vec<Moment>, bytes_max: usize) {
    let (mut n, mut bytes) = (0, 0);
    let mut newer: Option<&Moment> = None;
    for moment in past.iter().rev() {
        // Paint leaves the densities as they are, and what is before it and after it shares them.
        let is_shared = newer.is_some_and(|newer| Arc::ptr_eq(&newer.base, &moment.base));
        bytes += if is_shared { moment.points.n_bytes() } else { moment.n_bytes() };
        if n == PAST_MAX || n > 0 && bytes > bytes_max {
            break;
        }
        n += 1;
        newer = Some(moment);
    }
    past.drain(..past.len() - n);
}
