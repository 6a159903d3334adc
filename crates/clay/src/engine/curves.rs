//! Curves for the rope that come as data, and what goes along with them.

use std::sync::Arc;

use glam::DVec3;

use super::super::ClayModel;
use super::work::{Activity, CORNER_SPACINGS};
use super::{EngineError, RopeCurves, SculptEngine};

/// A pull that ends by so much less than its time, s, is not cut short: two updates at 50 Hz.
const CUT_S: f64 = 0.04;

/// Curves on the surface, or free ones in the region.
#[derive(Clone, Debug, Default)]
pub(super) struct Curves {
    pub(super) map: Vec<Vec<DVec3>>,
    /// Of free ones: the density of each corner when they were laid, m.
    levels_m: Vec<Vec<f64>>,
    pub(super) is_free: bool,
}

impl Curves {
    /// One more, which lies on the surface.
    pub(super) fn push(&mut self, curve_map: Vec<DVec3>) {
        self.levels_m.push(vec![0.0; curve_map.len()]);
        self.map.push(curve_map);
    }

    /// The curve and the corner nearest to a place, and how far it is, m.
    pub(super) fn nearest(&self, place_map: DVec3) -> Option<(usize, usize, f64)> {
        let corners = self.map.iter().enumerate().flat_map(|(curve, corners)| {
            corners
                .iter()
                .enumerate()
                .map(move |(corner, at)| (curve, corner, at.distance(place_map)))
        });
        corners.min_by(|(_, _, one_m), (_, _, other_m)| one_m.total_cmp(other_m))
    }

    /// Every corner goes along with the level that it lies on: along a direction, or along the
    /// normal where that runs along the level.
    pub(super) fn follow(&mut self, model: &ClayModel, along: DVec3, within_m: f64) {
        for (at, level_m) in self.map.iter_mut().flatten().zip(self.levels_m.iter().flatten()) {
            let there = model.onto_level_along((*at, *level_m), along, within_m);
            if let Some(there) = there.or_else(|| model.onto_level((*at, *level_m), within_m)) {
                *at = there;
            }
        }
    }
}

impl SculptEngine {
    /// Curves that wait or are pulled, for those who look.
    pub(super) fn drawn_map(&self) -> Arc<[Vec<DVec3>]> {
        match &self.activity {
            Activity::PullingCurves { curves, .. } | Activity::Driven { curves, .. } => {
                self.waiting.map.iter().chain(&curves.map).cloned().collect()
            }
            Activity::Drawing { curve_map } => {
                self.waiting.map.iter().chain([curve_map]).cloned().collect()
            }
            _ => self.waiting.map.as_slice().into(),
        }
    }

    /// [`SculptOrder::Draw`](super::SculptOrder::Draw).
    pub(super) fn lay_curves(&mut self, curves: RopeCurves) -> Result<(), EngineError> {
        self.let_go()?;
        self.waiting = if curves.curves_map.is_empty() {
            Curves::default()
        } else {
            self.laid(curves, self.tool.brush_m)?
        };
        Ok(())
    }

    /// [`SculptOrder::Pull`](super::SculptOrder::Pull).
    pub(super) fn begin_pull(
        &mut self,
        curves: RopeCurves,
        force_map: DVec3,
        time_s: f64,
        brush_m: Option<f64>,
    ) -> Result<(), EngineError> {
        let brush_m = brush_m.unwrap_or(self.tool.brush_m);
        let wrong = |what: String| Err(EngineError::Curves { what });
        let is_force = force_map.is_finite()
            && force_map.length() > 0.0
            && force_map.length() <= RopeCurves::FORCE_MAX_N;
        if !is_force {
            return wrong(format!("a pull of {} N", force_map.length()));
        }
        if !(time_s > 0.0 && time_s <= RopeCurves::TIME_MAX_S) {
            return wrong(format!("a pull of {time_s} s"));
        }
        if !(brush_m > 0.0 && brush_m.is_finite()) {
            return Err(EngineError::Length { name: "a brush", value: brush_m });
        }
        self.let_go()?;
        let curves = self.laid(curves, brush_m)?;
        self.model.begin_stroke()?;
        self.activity = Activity::Driven { curves, force_map, brush_m, left_s: time_s };
        Ok(())
    }

    /// How long a pull by order goes on still, s; nothing in its last updates, as orders come
    /// between two of them.
    pub(super) fn pull_left_s(&self) -> Option<f64> {
        if let Activity::Driven { left_s, .. } = self.activity {
            Some(left_s).filter(|left_s| *left_s > CUT_S)
        } else {
            None
        }
    }

    /// One update of a pull by order.
    pub(super) fn drive(&mut self, time_s: f64) -> Result<(), EngineError> {
        let Activity::Driven { curves, force_map, brush_m, left_s } = &mut self.activity else {
            return Ok(());
        };
        if *left_s <= 0.0 {
            return self.let_go();
        }
        *left_s -= time_s;
        let curves = curves.clone();
        let force_map = *force_map;
        let brush_m = *brush_m;
        self.pull_curves(&curves, force_map, brush_m)?;
        Ok(())
    }

    /// Corners as close together as mass points are, on the surface or, of free curves, where they
    /// are.
    fn laid(
        &self,
        RopeCurves { curves_map, is_free }: RopeCurves,
        brush_m: f64,
    ) -> Result<Curves, EngineError> {
        let wrong = |what: String| Err(EngineError::Curves { what });
        if curves_map.is_empty() || curves_map.len() > RopeCurves::CURVES_MAX {
            return wrong(format!("{} curves at once", curves_map.len()));
        }
        if let Some(curve) = curves_map
            .iter()
            .position(|curve| curve.is_empty() || !curve.iter().all(|at| at.is_finite()))
        {
            return wrong(format!("curve {} has no place, or one that is no place", curve + 1));
        }
        let apart_m = CORNER_SPACINGS * self.model.region().lattice().spacing_m;
        let (low, high) = self.model.region_map();
        let mut laid = Curves { is_free, ..Curves::default() };
        let mut n_corners = 0;
        for curve in curves_map {
            let pieces =
                curve.windows(2).map(|ends| (ends[0].distance(ends[1]) / apart_m).ceil().max(1.0));
            n_corners += 1 + pieces.sum::<f64>().min(1e9) as usize;
            if n_corners > RopeCurves::CORNERS_MAX {
                let n_max = RopeCurves::CORNERS_MAX;
                return wrong(format!(
                    "with a corner for every mass point along them the curves have more than \
                        {n_max} corners"
                ));
            }
            let mut map = Vec::new();
            let mut levels_m = Vec::new();
            for at in between(&curve, apart_m) {
                let there =
                    if is_free { Some(at) } else { self.model.onto_level((at, 0.0), brush_m) };
                let there = there.ok_or(EngineError::CurveOutOfReach(at))?;
                let density_m = self
                    .model
                    .density_m(there)
                    .filter(|_| there.cmpgt(low).all() && there.cmplt(high).all());
                let density_m = density_m.ok_or(EngineError::CurveOutsideRegion(at))?;
                map.push(there);
                levels_m.push(if is_free { density_m } else { 0.0 });
            }
            laid.map.push(map);
            laid.levels_m.push(levels_m);
        }
        Ok(laid)
    }
}

/// The corners of a curve and, where two are farther apart, places on the line between them.
fn between(curve: &[DVec3], apart_m: f64) -> Vec<DVec3> {
    let mut places: Vec<DVec3> = curve.first().copied().into_iter().collect();
    for ends in curve.windows(2) {
        let n = (ends[0].distance(ends[1]) / apart_m).ceil().max(1.0) as usize;
        places.extend((1..=n).map(|step| ends[0].lerp(ends[1], step as f64 / n as f64)));
    }
    places
}
