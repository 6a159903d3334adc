//! Strokes of the brush that paint material.

use glam::DVec3;

use super::super::SurfaceError;
use super::super::dynamics::Material;
#[cfg(test)]
use super::super::material_map::MaterialMap;
use super::super::material_map::{MaterialCoat, Painted};
use super::super::paint::{Brush, Dab};
use super::ClayModel;

impl ClayModel {
    /// Paints colour and material under a brush that is pressed near a place of the surface with a force; without a property given, clay that is
    /// [so many times](Painted::HARDER) as hard. Dabs with one brush and one material are one stroke, until it [ends](Self::end_stroke): from
    /// then on the material counts. Gives how many mass points changed. Cost: O(samples and mass points under the brush).
    ///
    /// # Errors
    /// As [`Self::paint`].
    pub(crate) fn paint_material(
        &mut self,
        brush: &Brush,
        painted: Painted,
        at_map: DVec3,
        force_n: f64,
    ) -> Result<usize, SurfaceError> {
        let painted = painted.or_harder(&self.settings.material);
        if self.material_coat.as_ref().is_none_or(|coat| *coat.painted() != painted) {
            self.end_stroke()?;
        }
        self.paint(brush, at_map, force_n)?;
        let radius_m = brush.radius_m(force_n);
        let Some((at_map, normal_map)) = self.press.as_ref().and_then(|_| self.onto(at_map, radius_m)) else { return Ok(0) };
        let lattice = *self.base.lattice();
        let coat = self.material_coat.get_or_insert_with(|| MaterialCoat::over(&self.material_map, lattice.n_nodes(), painted));
        let dab = Dab { at_map, normal_map, radius_m };
        Ok(coat.dab(&mut self.material_map, (&lattice, &self.settings.material), &brush.falloff, dab))
    }

    /// What was painted, on the nodes of the base.
    #[cfg(test)]
    pub(crate) fn material_map(&self) -> &MaterialMap {
        &self.material_map
    }

    /// What the mass point nearest to a place is made of; far from the piece, what all of it is made of at first.
    pub fn material_at(&self, point_map: DVec3) -> Material {
        let lattice = self.base.lattice();
        let nodes = ((point_map - lattice.origin_map) / lattice.spacing_m).round().to_array();
        let is_in = (0..3).all(|axis| nodes[axis] >= 0.0 && nodes[axis] < lattice.dims[axis] as f64);
        let node = is_in.then(|| lattice.index(nodes.map(|n| n as usize)));
        node.map_or_else(|| self.settings.material.clone(), |node| self.material_map.at(node, &self.settings.material))
    }

    /// The press is over: the region moves as what was painted.
    pub(super) fn set_material(&mut self) {
        if self.material_coat.take().is_some() {
            let lattice = *self.region.dynamics.lattice();
            let of_part = self.material_map.of_part(self.base.lattice(), self.region.first, &lattice, &self.settings.material);
            *self.region.dynamics.material_mut() = of_part;
        }
    }
}

#[cfg(test)]
mod tests;
