//! Orders, carried out.

use glam::DVec3;

use super::super::boolean::Boolean;
use super::super::emboss::{GreyImage, Laid};
use super::super::{PointSet, PointSurface, export, save};
use super::{Order, Studio, StudioError, ToolSettings};

impl Studio {
    pub(super) fn carry_out(&mut self, order: Order) -> Result<(), StudioError> {
        // Even one that fails may have changed what is shown; a stroke that it ends says so by itself.
        match order {
            Order::Undo | Order::Redo | Order::Combine { .. } | Order::Emboss { .. } => self.note_change(),
            _ => self.show_again(),
        }
        match order {
            Order::Take(tool) => self.take(tool),
            Order::Adjust(change) => self.take(change.onto(&self.tool)),
            Order::Hold(is_held) => {
                self.is_held_by_order = is_held;
                self.heard.hold(is_held);
                Ok(())
            }
            Order::Undo => {
                self.let_go()?;
                self.has_leapt = true;
                if self.piece.undo()? { Ok(()) } else { Err(StudioError::NothingToUndo) }
            }
            Order::Redo => {
                self.let_go()?;
                self.has_leapt = true;
                if self.piece.redo()? { Ok(()) } else { Err(StudioError::NothingToRedo) }
            }
            Order::Region { low_map, high_map } => {
                self.let_go()?;
                self.has_leapt = true;
                Ok(self.piece.choose_region(low_map, high_map)?)
            }
            Order::Combine { boolean, with, map_from_body, is_sharp } => {
                self.let_go()?;
                let with = with.beside(self.piece.surface().spacing_m())?.placed(&map_from_body);
                self.combine(boolean, with, is_sharp)
            }
            Order::Emboss { image, laid, depth_m } => {
                self.let_go()?;
                self.emboss(&image, &laid, depth_m)
            }
            Order::SavePoints(path) => save::save(&path, self.piece.points()).map_err(|source| StudioError::write(&path, source)),
            Order::SaveSession(path) => {
                self.let_go()?;
                self.piece.save_session(&path)?;
                self.saved = super::past_of(&self.piece);
                Ok(())
            }
            Order::Export(path) => {
                self.let_go()?;
                let mesh = self.piece.mesh()?;
                export::write_mesh(&path, &mesh).map_err(|source| StudioError::write(&path, source))
            }
        }
    }

    fn take(&mut self, tool: ToolSettings) -> Result<(), StudioError> {
        for (name, value, is_sound) in
            [("a brush", tool.brush_m, tool.brush_m > 0.0), ("a depth of images", tool.depth_m, tool.depth_m >= 0.0)]
        {
            if !(is_sound && value.is_finite()) {
                return Err(StudioError::Length { name, value });
            }
        }
        if let Some((name, value, unit)) = tool.painted.unsound() {
            return Err(StudioError::Property { name, value, unit });
        }
        // The stroke of the tool before; if it made no surface it is taken back, and the new tool is taken all the same.
        let ended = self.let_go();
        self.tool = tool;
        ended
    }

    pub(super) fn combine(&mut self, boolean: Boolean, with: PointSet, is_sharp: bool) -> Result<(), StudioError> {
        if boolean == Boolean::Difference && !with.bounds().is_some_and(|other| overlap(self.piece.surface().bounds(), other)) {
            return Err(StudioError::Beside);
        }
        let other = PointSurface::build(with, self.piece.settings().n_neighbours)?;
        self.has_leapt = true;
        self.piece.combine(boolean, &other, is_sharp)?;
        Ok(())
    }

    pub(super) fn emboss(&mut self, image: &GreyImage, laid: &Laid, depth_m: f64) -> Result<(), StudioError> {
        if !depth_m.is_finite() {
            return Err(StudioError::Length { name: "a depth of images", value: depth_m });
        }
        self.has_leapt = true;
        let n_moved = self.piece.emboss(image, laid, depth_m)?;
        if n_moved > 0 { Ok(()) } else { Err(StudioError::Nothing("image")) }
    }
}

/// Two boxes have a place in common.
fn overlap((low, high): (DVec3, DVec3), (other_low, other_high): (DVec3, DVec3)) -> bool {
    low.cmple(other_high).all() && other_low.cmple(high).all()
}
