//! Orders, carried out.

use glam::DVec3;

use super::super::boolean::Boolean;
use super::super::clay_model::SolidSize;
use super::super::emboss::{GreyImage, ImagePlacement};
use super::super::material_map::{MaterialPlace, Painted};
use super::super::{SolidSource, export, save};
use super::{EngineError, SculptEngine, SculptOrder, ToolSettings};
use vps::spatial::Pose;

impl SculptEngine {
    pub(super) fn carry_out(&mut self, order: SculptOrder) -> Result<(), EngineError> {
        match order {
            SculptOrder::Take(tool) => self.take(tool),
            SculptOrder::Adjust(change) => self.take(change.onto(&self.tool)),
            SculptOrder::Hold(is_held) => {
                self.is_held_by_order = is_held;
                self.motion.hold(is_held);
                Ok(())
            }
            SculptOrder::Undo => {
                self.let_go()?;
                self.has_leapt = true;
                if self.model.undo()? { Ok(()) } else { Err(EngineError::NothingToUndo) }
            }
            SculptOrder::Redo => {
                self.let_go()?;
                self.has_leapt = true;
                if self.model.redo()? { Ok(()) } else { Err(EngineError::NothingToRedo) }
            }
            SculptOrder::Region { low_map, high_map } => {
                self.let_go()?;
                self.has_leapt = true;
                Ok(self.model.choose_region(low_map, high_map)?)
            }
            SculptOrder::Combine { boolean, with, map_from_body, is_sharp } => {
                self.let_go()?;
                self.combine(boolean, &with, &map_from_body, is_sharp)
            }
            SculptOrder::Emboss { image, placement, depth_m } => {
                self.let_go()?;
                self.emboss(&image, &placement, depth_m)
            }
            SculptOrder::Lay { painted, place } => self.lay(painted, &place),
            SculptOrder::Draw(curves) => self.lay_curves(curves),
            SculptOrder::Pull { curves, force_map, time_s, brush_m } => {
                self.begin_pull(curves, force_map, time_s, brush_m)
            }
            SculptOrder::SavePoints(path) => save::save(&path, self.model.points())
                .map_err(|source| EngineError::write(&path, source)),
            SculptOrder::SaveSession(path) => {
                self.let_go()?;
                self.model.save_session(&path)?;
                self.saved = super::past_of(&self.model);
                Ok(())
            }
            SculptOrder::Export(path) => {
                self.let_go()?;
                let mesh = self.model.mesh()?;
                export::write_mesh(&path, &mesh).map_err(|source| EngineError::write(&path, source))
            }
        }
    }

    fn take(&mut self, tool: ToolSettings) -> Result<(), EngineError> {
        for (name, value, is_sound) in [
            ("a brush", tool.brush_m, tool.brush_m > 0.0),
            ("a depth of images", tool.depth_m, tool.depth_m >= 0.0),
        ] {
            if !(is_sound && value.is_finite()) {
                return Err(EngineError::Length { name, value });
            }
        }
        check_painted(&tool.painted)?;
        // The stroke of the tool before; if it made no surface it is taken back, and the new tool
        // is taken all the same.
        let ended = self.let_go();
        self.tool = tool;
        ended
    }

    fn lay(&mut self, painted: Painted, place: &MaterialPlace) -> Result<(), EngineError> {
        check_painted(&painted)?;
        if let MaterialPlace::Values { painted, .. } = place {
            painted.iter().try_for_each(check_painted)?;
        }
        if let Some(what) = place.unsound() {
            return Err(EngineError::Place { what });
        }
        self.let_go()?;
        if self.model.lay_material(painted, place)? == 0 {
            return Err(EngineError::NothingLaid);
        }
        Ok(())
    }

    pub(super) fn combine(
        &mut self,
        boolean: Boolean,
        with: &SolidSource,
        map_from_body: &Pose,
        is_sharp: bool,
    ) -> Result<(), EngineError> {
        let bounds = with.bounds_map(map_from_body).unwrap_or_default();
        if boolean == Boolean::Difference && !overlap(self.model.surface().bounds(), bounds) {
            return Err(EngineError::Beside);
        }
        let clay_spacing_m = self.model.surface().spacing_m();
        let (samples, spacing_m) = with.samples_beside(clay_spacing_m);
        let solid = SolidSize { samples, spacing_m, bounds };
        let meter = self.model.meter(self.model.estimate_combine(boolean, solid, is_sharp)?)?;
        let points = with.beside(clay_spacing_m, &meter)?.placed(map_from_body);
        let other = self.model.settings().surface(points, &meter)?;
        self.has_leapt = true;
        self.model.combine(boolean, &other, is_sharp)?;
        Ok(())
    }

    pub(super) fn emboss(
        &mut self,
        image: &GreyImage,
        placement: &ImagePlacement,
        depth_m: f64,
    ) -> Result<(), EngineError> {
        if !depth_m.is_finite() {
            return Err(EngineError::Length { name: "a depth of images", value: depth_m });
        }
        self.has_leapt = true;
        let n_moved = self.model.emboss(image, placement, depth_m)?;
        if n_moved > 0 { Ok(()) } else { Err(EngineError::Nothing("image")) }
    }
}

fn check_painted(painted: &Painted) -> Result<(), EngineError> {
    painted
        .unsound()
        .map_or(Ok(()), |(name, value, unit)| Err(EngineError::Property { name, value, unit }))
}

/// Two boxes have a place in common.
fn overlap((low, high): (DVec3, DVec3), (other_low, other_high): (DVec3, DVec3)) -> bool {
    low.cmple(other_high).all() && other_low.cmple(high).all()
}
