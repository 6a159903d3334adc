//! Strokes of the brush.

use std::sync::Arc;

use glam::DVec3;

use super::super::paint::{Brush, Coat, Dab, Surfel};
use super::super::{PointSurface, SurfaceError, WorkMeter};
use super::{AdvectedSamples, ClayModel};

/// Radius of a sample's disc, in its spacings: neighbouring discs overlap.
const DISC_SPACINGS: f64 = 0.75;
/// Smallest disc that the rim of a brush leaves, in spacings at the start; and pixels across a
/// picture of the clay.
const SPLIT_SPACINGS: f64 = 0.125;
const PICTURE_PIXELS: f64 = 1000.0;
/// Dabs that the brush has left behind before what is around them is split: the tree of samples is
/// built again each time.
const WAITING_DABS: usize = 16;

/// A press of the brush.
#[derive(Debug)]
pub(super) struct Press {
    brush: Brush,
    coat: Coat,
}

impl ClayModel {
    /// Paints under a brush that is pressed near a place of the surface with a force. Dabs with one
    /// brush are one stroke, until it [ends](Self::end_stroke). Gives how many samples took colour.
    /// Cost: O(samples under the brush).
    ///
    /// # Errors
    /// [`SurfaceError`] where another stroke had to end first, and made no surface; that is taken
    /// back then.
    pub(crate) fn paint(
        &mut self,
        brush: &Brush,
        at_map: DVec3,
        force_n: f64,
    ) -> Result<usize, SurfaceError> {
        let radius_m = brush.radius_m(force_n);
        let Some((at_map, normal_map)) = self.onto(at_map, radius_m) else { return Ok(0) };
        if self.press.as_ref().is_none_or(|press| press.brush != *brush) {
            self.end_stroke()?;
        }
        let dab = Dab { at_map, normal_map, radius_m };
        let mut found = Vec::new();
        self.surface.neighbours().within(at_map, radius_m, &mut found);
        let points = self.surface.points();
        let near = found.iter().map(|near| near.sample);
        let near: Vec<u32> = near.filter(|sample| dab.covers(points, *sample)).collect();
        if near.is_empty() {
            // A touch too light for any sample is no stroke.
            return Ok(0);
        }
        if self.press.is_none() {
            self.remember();
            self.press = Some(Press {
                brush: brush.clone(),
                coat: Coat::over(&self.surface.points().colors),
            });
        }
        let Some(Press { coat, .. }) = &mut self.press else { return Ok(0) };
        let n_colored = coat.dab(Arc::make_mut(&mut self.surface).colors_mut(), &near, brush, dab);
        if coat.waiting().len() >= WAITING_DABS {
            self.split_behind()?;
        }
        Ok(n_colored)
    }

    /// Splits discs at the rim of what the brush has left behind.
    fn split_behind(&mut self) -> Result<(), SurfaceError> {
        let Some(Press { brush, coat, .. }) = &self.press else { return Ok(()) };
        let surface = &self.surface;
        let waiting = coat.waiting();
        let n_dabs = waiting.len();
        let mut found = Vec::new();
        let mut samples = Vec::new();
        for dab in waiting {
            surface.neighbours().within(
                dab.at_map,
                dab.radius_m + 2.0 * DISC_SPACINGS * surface.spacing_m(),
                &mut found,
            );
            samples.extend(found.iter().map(|near| near.sample));
        }
        samples.sort_unstable();
        samples.dedup();
        samples.retain(|sample| !coat.is_at_work(surface.points().positions_map[*sample as usize]));
        let added =
            coat.refined(surface.points(), &self.discs(&samples), brush, |at| onto(surface, at));
        if !added.points.is_empty() {
            Arc::make_mut(&mut self.surface).replace(
                &[],
                &added.points,
                &WorkMeter::unlimited(),
            )?;
        }
        if let Some(Press { coat, .. }) = &mut self.press {
            coat.has_refined(n_dabs);
            coat.extend(added);
        }
        Ok(())
    }

    fn discs(&self, samples: &[u32]) -> Vec<Surfel> {
        let spacings_m = self.surface.spacings_m();
        samples
            .iter()
            .map(|sample| Surfel {
                sample: *sample,
                radius_m: DISC_SPACINGS * spacings_m[*sample as usize],
            })
            .collect()
    }

    /// The press of the brush is over: samples that its rim only half covers are split.
    pub(super) fn lift_brush(&mut self) -> Result<(), SurfaceError> {
        let Some(Press { brush, coat }) = self.press.take() else { return Ok(()) };
        let surface = &self.surface;
        let all: Vec<u32> = (0..surface.points().len() as u32).collect();
        let added = coat
            .refined(surface.points(), &self.discs(&all), &brush, |at| onto(surface, at))
            .points;
        if !added.is_empty()
            && let Err(error) =
                Arc::make_mut(&mut self.surface).replace(&[], &added, &WorkMeter::unlimited())
        {
            self.take_back();
            return Err(error);
        }
        self.region.afloat =
            AdvectedSamples::new(self.surface.points(), self.region.dynamics.now(), 0.0);
        self.settle();
        Ok(())
    }

    /// The smallest disc that the rim of a brush leaves, m: a pixel of a picture that the clay and
    /// the air around it fill, or an eighth of a spacing if that is more, because each sample is
    /// fitted and kept.
    pub(crate) fn smallest_disc_m(&self) -> f64 {
        let (low, high) = self.base.lattice().bounds();
        (SPLIT_SPACINGS * self.gap_m).max((high - low).max_element() / PICTURE_PIXELS)
    }
}

/// A place on the surface, and the normal there.
fn onto(surface: &PointSurface, at_map: DVec3) -> Option<(DVec3, DVec3)> {
    let at_map = surface.project(at_map)?;
    let normal = surface.at(at_map).normal();
    normal.is_normalized().then_some((at_map, normal))
}
