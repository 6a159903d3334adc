//! What the hand does to the clay: one function per kind of tool.

use std::sync::Arc;

use glam::DVec3;

use super::super::emboss::{GreyImage, ImagePlacement};
use super::super::paint::Brush;
use super::super::pull::{CurvesPull, PullForce};
use super::super::{SolidSource, SurfaceError};
use super::curves::Curves;
use super::{
    EngineError, HoldOutcome, RopeCurves, SculptEngine, SculptTool, ToolMotion, ToolSettings,
};

/// A stroke of push, paint or material is over when the tool has left for so long, s: a hand that
/// trembles makes one stroke.
const LEFT_S: f64 = 0.2;
/// Less force does nothing, N: the resolution of a light hand.
const LEAST_N: f64 = 1e-3;
/// Length of the force vector in brushes, and in spacings of the raster at least.
const REACH_BRUSHES: f64 = 0.6;
const REACH_SPACINGS: f64 = 2.0;
/// Corners of a drawn curve are so far apart, in spacings of the raster; and there are no more of
/// them than this.
pub(super) const CORNER_SPACINGS: f64 = 1.0;
const CORNERS_MAX: usize = 512;
/// Samples of the tool that are asked where it touches.
const ASKED_MAX: usize = 4096;
/// Pixels along an edge of the dome that is embossed without an image.
const DOME_PIXELS: usize = 48;

/// Motion of the tool in the ticks since the last update.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct MotionSummary {
    n: u32,
    force_map: DVec3,
    rope_map: DVec3,
    touches: bool,
    pub(super) last: ToolMotion,
    /// Held in the last tick, by the arm's button or an order.
    is_held: bool,
    /// It has been taken hold of since the last update.
    has_risen: bool,
}

impl MotionSummary {
    pub(super) fn add(&mut self, motion: &ToolMotion, is_held_by_order: bool) {
        self.n += 1;
        self.force_map += motion.force_map;
        self.rope_map += motion.rope_map;
        self.touches |= motion.touches;
        self.last = *motion;
        self.set_held(motion.is_held || is_held_by_order);
    }

    pub(super) fn hold(&mut self, is_held_by_order: bool) {
        self.set_held(is_held_by_order || self.last.is_held);
    }

    /// What came of the work on this.
    pub(super) fn grip(&self, has_worked: bool) -> HoldOutcome {
        match (self.has_risen && self.n > 0, has_worked) {
            (false, _) => HoldOutcome::None,
            (true, true) => HoldOutcome::Taken,
            (true, false) => HoldOutcome::Missed,
        }
    }

    fn set_held(&mut self, is_held: bool) {
        self.has_risen |= is_held && !self.is_held;
        self.is_held = is_held;
    }

    /// What there is to work on, forces as means; only where the hand is stays for the next update.
    pub(super) fn take(&mut self) -> Self {
        let mut motion = *self;
        if self.n == 0 {
            // Nothing is known of the hand: what it takes hold of waits.
            return motion;
        }
        let share = 1.0 / f64::from(self.n);
        motion.force_map *= share;
        motion.rope_map *= share;
        *self = Self { last: self.last, is_held: self.is_held, ..Self::default() };
        motion
    }
}

/// What is under way.
#[derive(Clone, Debug, Default)]
pub(super) enum Activity {
    #[default]
    Nothing,
    /// Push, paint or material; for so long the tool has not touched, s.
    Pressing { left_s: f64 },
    /// A rope to a place of the surface.
    Pulling { anchor_map: DVec3 },
    /// A curve is being drawn, beside those that wait.
    Drawing { curve_map: Vec<DVec3> },
    /// A rope to one corner of one of the curves; all of them are pulled.
    PullingCurves { curves: Curves, curve: usize, corner: usize },
    /// Curves that an order pulls, for so long still, s.
    Driven { curves: Curves, force_map: DVec3, brush_m: f64, left_s: f64 },
    /// A box for the region is being spanned from here, map frame, m.
    Spanning { from_map: DVec3 },
    /// The rope is let go; the stroke, whose end takes long, is over with the next update: the hand
    /// is not to feel a rope until then.
    LettingGo,
}

impl SculptEngine {
    /// One update's worth of work.
    pub(super) fn work(&mut self, motion: &MotionSummary, time_s: f64) -> Result<(), EngineError> {
        if let Activity::Driven { .. } = self.activity {
            self.drive(time_s)?;
            return if motion.has_risen && self.tool.kind.is_held() {
                Err(EngineError::PullUnderWay)
            } else {
                Ok(())
            };
        }
        if motion.n == 0 {
            return Ok(());
        }
        if !motion.last.has_force {
            self.let_go()?;
            return if motion.has_risen && self.tool.kind.is_held() {
                Err(EngineError::NoForce)
            } else {
                Ok(())
            };
        }
        match self.tool.kind {
            SculptTool::Touch => Ok(()),
            SculptTool::Push | SculptTool::Paint | SculptTool::Material => {
                self.press(motion, time_s)
            }
            SculptTool::Pull | SculptTool::PullCurve => self.rope(motion),
            SculptTool::Region => self.span_region(motion),
            SculptTool::Emboss | SculptTool::Engrave if motion.has_risen => self.stamp(motion),
            SculptTool::Union | SculptTool::Intersection | SculptTool::Difference
                if motion.has_risen =>
            {
                self.join(motion)
            }
            SculptTool::Emboss
            | SculptTool::Engrave
            | SculptTool::Union
            | SculptTool::Intersection
            | SculptTool::Difference => Ok(()),
        }
    }

    /// Where a rope is tied to the surface, map frame.
    pub(super) fn rope_map(&self) -> Option<DVec3> {
        match &self.activity {
            Activity::Pulling { anchor_map } => Some(*anchor_map),
            Activity::PullingCurves { curves, curve, corner } => {
                curves.map.get(*curve).and_then(|curve| curve.get(*corner)).copied()
            }
            _ => None,
        }
    }

    /// The stroke under way ends, whatever it is.
    pub(super) fn let_go(&mut self) -> Result<(), EngineError> {
        self.activity = Activity::Nothing;
        if self.model.is_stroke() {
            self.note_change();
            if let Err(error) = self.model.end_stroke() {
                // The stroke has been taken back.
                self.has_leapt = true;
                return Err(error.into());
            }
        }
        Ok(())
    }

    /// What was grabbed goes along with the material: along the rope, so that it does not drift off
    /// sideways, or along the normal where the rope runs along the surface.
    pub(super) fn follow(&mut self) {
        let model = &self.model;
        let within_m = self.tool.brush_m;
        let tip_map = self.body.tip_map(&self.motion.last);
        let along = |from: DVec3| (tip_map - from).normalize_or_zero();
        let follow = |at: &mut DVec3, along: DVec3| {
            let there = model.onto_along(*at, along, within_m);
            if let Some(there) = there.or_else(|| model.onto(*at, within_m).map(|(there, _)| there))
            {
                *at = there;
            }
        };
        match &mut self.activity {
            Activity::Pulling { anchor_map } => follow(anchor_map, along(*anchor_map)),
            Activity::PullingCurves { curves, curve, corner } => {
                let anchor_map = curves.map.get(*curve).and_then(|curve| curve.get(*corner));
                let along = anchor_map.map_or(DVec3::ZERO, |anchor_map| along(*anchor_map));
                curves.follow(model, along, within_m);
            }
            Activity::Driven { curves, force_map, brush_m, .. } => {
                curves.follow(model, force_map.normalize_or_zero(), *brush_m)
            }
            _ => {}
        }
    }

    /// Push, paint and material: what the hand presses on.
    fn press(&mut self, motion: &MotionSummary, time_s: f64) -> Result<(), EngineError> {
        let force_map = -motion.force_map;
        let place = if motion.touches && force_map.length() > LEAST_N {
            self.touched(&motion.last)
        } else {
            None
        };
        let Some((at_map, normal_map)) = place else {
            if let Activity::Pressing { left_s } = &mut self.activity {
                *left_s = if motion.touches { 0.0 } else { *left_s + time_s };
                if *left_s > LEFT_S {
                    return self.let_go();
                }
            }
            return Ok(());
        };
        self.activity = Activity::Pressing { left_s: 0.0 };
        let force_n = force_map.length();
        match self.tool.kind {
            SculptTool::Paint => {
                self.model.paint(&self.brush(), at_map, force_n)?;
                return Ok(());
            }
            SculptTool::Material => {
                self.model.paint_material(&self.brush(), self.tool.painted, at_map, force_n)?;
                return Ok(());
            }
            _ => {}
        }
        self.check_region(at_map)?;
        let inward_n = force_map.dot(-normal_map).max(0.0);
        self.pull(vec![at_map], -normal_map * inward_n)?;
        Ok(())
    }

    /// Pull and pull-curve: what is grabbed.
    fn rope(&mut self, motion: &MotionSummary) -> Result<(), EngineError> {
        if motion.has_risen {
            self.grab(motion)?;
        }
        if !motion.is_held {
            return match core::mem::take(&mut self.activity) {
                Activity::Drawing { curve_map } => {
                    // A hold that was let go at once has drawn nothing.
                    if curve_map.len() > 1 {
                        self.waiting.push(curve_map);
                    }
                    self.show_again();
                    Ok(())
                }
                driven @ Activity::Driven { .. } => {
                    self.activity = driven;
                    Ok(())
                }
                Activity::Pulling { .. } | Activity::PullingCurves { .. } => {
                    self.activity = Activity::LettingGo;
                    Ok(())
                }
                Activity::Nothing
                | Activity::Pressing { .. }
                | Activity::Spanning { .. }
                | Activity::LettingGo => self.let_go(),
            };
        }
        let force_map = -motion.rope_map;
        match &mut self.activity {
            Activity::Pulling { anchor_map } => {
                let along_map = vec![*anchor_map];
                self.pull(along_map, force_map)?;
            }
            Activity::PullingCurves { curves, .. } => {
                let curves = curves.clone();
                self.pull_curves(&curves, force_map, self.tool.brush_m)?;
            }
            Activity::Drawing { curve_map, .. } => {
                let least_m = CORNER_SPACINGS * self.model.region().lattice().spacing_m;
                let corner = self.model.onto(self.body.tip_map(&motion.last), self.tool.brush_m);
                if let Some((at, _)) = corner
                    && curve_map.len() < CORNERS_MAX
                    && curve_map.last().is_none_or(|last| last.distance(at) >= least_m)
                {
                    curve_map.push(at);
                }
            }
            _ => {}
        }
        Ok(())
    }

    /// A hold begins.
    fn grab(&mut self, motion: &MotionSummary) -> Result<(), EngineError> {
        self.let_go()?;
        let tip_map = self.body.tip_map(&motion.last);
        let anchor_map = match self.model.onto(tip_map, self.tool.brush_m) {
            Some((anchor_map, _)) => self.check_region(anchor_map).map(|()| anchor_map),
            None => Err(EngineError::OutOfReach),
        };
        let anchor_map = anchor_map?;
        if self.tool.kind == SculptTool::Pull {
            self.model.begin_stroke()?;
            self.activity = Activity::Pulling { anchor_map };
            return Ok(());
        }
        let curves = &mut self.waiting;
        let within_m = self.tool.brush_m;
        // Other strokes may have moved the surface meanwhile.
        curves.follow(&self.model, DVec3::ZERO, within_m);
        self.activity = match curves
            .nearest(anchor_map)
            .filter(|(_, _, distance_m)| curves.is_free || *distance_m <= within_m)
        {
            Some((curve, corner, _)) => {
                self.model.begin_stroke()?;
                Activity::PullingCurves {
                    curves: core::mem::take(&mut self.waiting),
                    curve,
                    corner,
                }
            }
            None if curves.map.len() >= RopeCurves::CURVES_MAX => {
                return Err(EngineError::Curves {
                    what: format!("{} curves are drawn already", RopeCurves::CURVES_MAX),
                });
            }
            None => Activity::Drawing { curve_map: vec![anchor_map] },
        };
        Ok(())
    }

    /// Region: the box between where the hold began and where it ends.
    fn span_region(&mut self, motion: &MotionSummary) -> Result<(), EngineError> {
        let tip_map = self.body.tip_map(&motion.last);
        if motion.has_risen {
            self.let_go()?;
            self.activity = Activity::Spanning { from_map: tip_map };
        }
        let Activity::Spanning { from_map } = self.activity else { return Ok(()) };
        if motion.is_held {
            return Ok(());
        }
        self.activity = Activity::Nothing;
        let low_map = from_map.min(tip_map);
        let high_map = from_map.max(tip_map);
        self.has_leapt = true;
        // Samples are filled and thinned for the raster of the region.
        self.note_change();
        Ok(self.model.choose_region(low_map, high_map)?)
    }

    /// Emboss and engrave: the image in the tangent plane, as wide as the brush, its upper edge
    /// towards +z of the map (+y where the surface faces along z).
    fn stamp(&mut self, motion: &MotionSummary) -> Result<(), EngineError> {
        let place = self.touched(&motion.last);
        let (middle_map, normal_map) = place.ok_or(EngineError::OutOfReach)?;
        let upward = if normal_map.z.abs() < 0.9 { DVec3::Z } else { DVec3::Y };
        let up = upward.reject_from_normalized(normal_map).normalize_or_zero();
        let right = up.cross(normal_map);
        let ToolSettings { image, brush_m, depth_m, kind, .. } = &self.tool;
        let depth_m = if *kind == SculptTool::Engrave { -depth_m } else { *depth_m };
        let image = match image {
            Some(image) => image.clone(),
            None => dome().ok_or(EngineError::Nothing("image"))?.into(),
        };
        let half_m = image.half_edges() * *brush_m;
        let placement =
            ImagePlacement::Flat { middle_map, right_map: right * half_m.x, up_map: up * half_m.y };
        self.let_go()?;
        self.note_change();
        self.emboss(&image, &placement, depth_m)
    }

    /// Union, intersection, difference with the tool's own shape.
    fn join(&mut self, motion: &MotionSummary) -> Result<(), EngineError> {
        let Some(boolean) = self.tool.kind.boolean() else { return Ok(()) };
        let pose = motion.last.map_from_tool;
        let with = match (&self.tool.solid, &self.body.shape) {
            (Some(solid), _) => solid.source.clone(),
            (None, Some(shape)) => Arc::new(SolidSource::Samples((**shape).clone())),
            (None, None) => return Err(EngineError::NoShape),
        };
        self.let_go()?;
        self.note_change();
        self.combine(boolean, &with, &pose, self.tool.is_sharp)
    }

    fn check_region(&self, at_map: DVec3) -> Result<(), EngineError> {
        let (low, high) = self.model.region_map();
        if at_map.cmpgt(low).all() && at_map.cmplt(high).all() {
            Ok(())
        } else {
            Err(EngineError::OutsideRegion)
        }
    }

    fn pull(&mut self, along_map: Vec<DVec3>, force_n: DVec3) -> Result<(), SurfaceError> {
        if force_n.length() <= LEAST_N {
            return Ok(());
        }
        let ToolSettings { brush_m, falloff, .. } = &self.tool;
        let reach_m =
            (REACH_BRUSHES * brush_m).max(REACH_SPACINGS * self.model.region().lattice().spacing_m);
        self.model.pull(&PullForce {
            along_map,
            force_n,
            reach_m,
            radius_m: *brush_m,
            falloff: falloff.clone(),
        })
    }

    pub(super) fn pull_curves(
        &mut self,
        curves: &Curves,
        force_n: DVec3,
        brush_m: f64,
    ) -> Result<(), SurfaceError> {
        if force_n.length() <= LEAST_N {
            return Ok(());
        }
        let reach_m =
            (REACH_BRUSHES * brush_m).max(REACH_SPACINGS * self.model.region().lattice().spacing_m);
        let falloff = &self.tool.falloff;
        let curves_map = &*curves.map;
        let is_free = curves.is_free;
        self.model.pull_curves(CurvesPull {
            curves_map,
            force_n,
            reach_m,
            radius_m: brush_m,
            falloff,
            is_free,
        })
    }

    fn brush(&self) -> Brush {
        let ToolSettings { brush_m, falloff, color, .. } = &self.tool;
        Brush {
            color: *color,
            radius_m_per_n: brush_m / ToolSettings::FULL_FORCE_N,
            radius_max_m: *brush_m,
            falloff: falloff.clone(),
            smallest_m: self.model.smallest_disc_m(),
        }
    }

    /// The place of the surface that the tool touches, and the normal there: below the middle of
    /// what is inside, deeper samples first; for a tool without a shape, or one that only nears,
    /// the place nearest to its middle. `None` where none is within the brush.
    fn touched(&self, motion: &ToolMotion) -> Option<(DVec3, DVec3)> {
        let mut sum = (DVec3::ZERO, 0.0);
        if let Some(shape) = &self.body.shape {
            for at in shape.positions_map.iter().step_by(shape.len().div_ceil(ASKED_MAX).max(1)) {
                let at = motion.map_from_tool.transform_point(*at);
                let depth_m = self.model.density_m(at).unwrap_or(0.0).max(0.0);
                sum = (sum.0 + at * depth_m, sum.1 + depth_m);
            }
        }
        let middle = if sum.1 > 0.0 { sum.0 / sum.1 } else { self.body.tip_map(motion) };
        self.model.onto(middle, self.tool.brush_m)
    }
}

/// A round hill: 1 in the middle, level there and at its rim.
fn dome() -> Option<GreyImage> {
    let along = |n: usize| (n as f64 + 0.5) / DOME_PIXELS as f64 * 2.0 - 1.0;
    let grey = |n: usize| {
        let outside = (along(n % DOME_PIXELS).powi(2) + along(n / DOME_PIXELS).powi(2)).min(1.0);
        ((1.0 - outside) * (1.0 - outside)) as f32
    };
    GreyImage::new(DOME_PIXELS, DOME_PIXELS, (0..DOME_PIXELS * DOME_PIXELS).map(grey).collect())
        .ok()
}
