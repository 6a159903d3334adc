//! Strokes of the brush.

use std::sync::Arc;

use glam::DVec3;

use super::super::SurfaceError;
use super::super::paint::{Brush, Coat, Dab, Surfel};
use super::{AdvectedSamples, ClayModel};

/// Radius of a sample's disc, in its spacings: neighbouring discs overlap.
const DISC_SPACINGS: f64 = 0.75;
/// Smallest disc that the rim of a brush leaves, in spacings at the start: each is split once.
const SPLIT_SPACINGS: f64 = 0.25;

/// A press of the brush.
#[derive(Debug)]
pub(super) struct Press {
    brush: Brush,
    coat: Coat,
}

impl ClayModel {
    /// Paints under a brush that is pressed near a place of the surface with a force. Dabs with one brush are one stroke, until it
    /// [ends](Self::end_stroke). Gives how many samples took colour. Cost: O(samples under the brush).
    ///
    /// # Errors
    /// [`SurfaceError`] where another stroke had to end first, and made no surface; that is taken back then.
    pub(crate) fn paint(&mut self, brush: &Brush, at_map: DVec3, force_n: f64) -> Result<usize, SurfaceError> {
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
            self.press = Some(Press { brush: brush.clone(), coat: Coat::over(&self.surface.points().colors) });
        }
        let Some(Press { coat, .. }) = &mut self.press else { return Ok(0) };
        Ok(coat.dab(Arc::make_mut(&mut self.surface).colors_mut(), &near, brush, dab))
    }

    /// The press of the brush is over: samples that its rim only half covers are split.
    pub(super) fn lift_brush(&mut self) -> Result<(), SurfaceError> {
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
            self.settle();
            return Ok(());
        }
        if let Err(error) = Arc::make_mut(&mut self.surface).replace(&[], &added) {
            self.take_back();
            return Err(error);
        }
        self.region.afloat = AdvectedSamples::new(self.surface.points(), self.region.dynamics.now(), 0.0);
        self.settle();
        Ok(())
    }

    /// A disc with less than this is not split by the rim of a brush, m.
    pub(crate) fn smallest_disc_m(&self) -> f64 {
        SPLIT_SPACINGS * self.gap_m
    }
}
