//! Strokes of the brush that paint material.

use glam::DVec3;

use super::super::dynamics::Material;
#[cfg(test)]
use super::super::material_map::MaterialMap;
use super::super::material_map::{MaterialCoat, MaterialPlace, Painted};
use super::super::paint::{Brush, Dab};
use super::super::work_meter::TREE_STEPS;
use super::super::{Neighbours, SurfaceError};
use super::{ClayModel, ClayModelError};

impl ClayModel {
    /// Paints colour and material under a brush that is pressed near a place of the surface with a
    /// force; without a property given, clay that is [so many times](Painted::HARDER) as hard. Dabs
    /// with one brush and one material are one stroke, until it [ends](Self::end_stroke): from then
    /// on the material counts. Gives how many mass points changed. Cost: O(samples and mass points
    /// under the brush).
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
        let Some((at_map, normal_map)) =
            self.press.as_ref().and_then(|_| self.onto(at_map, radius_m))
        else {
            return Ok(0);
        };
        let lattice = *self.base.lattice();
        let coat = self.material_coat.get_or_insert_with(|| {
            MaterialCoat::over(&self.material_map, lattice.n_nodes(), painted)
        });
        let dab = Dab { at_map, normal_map, radius_m };
        Ok(coat.dab(
            &mut self.material_map,
            (&lattice, &self.settings.material),
            &brush.falloff,
            dab,
        ))
    }

    /// Lays a material, [`MaterialPlace::Everywhere`] or on the mass points of a place: one stroke.
    /// Without a property given, clay that is [so many times](Painted::HARDER) as hard. Gives how
    /// many mass points it reached; 0: nothing has changed. Cost: O(mass points).
    ///
    /// # Errors
    /// Another stroke had to end first, and made no surface: that is taken back then. Or it was
    /// cancelled, or takes too much work.
    pub(crate) fn lay_material(
        &mut self,
        painted: Painted,
        place: &MaterialPlace,
    ) -> Result<usize, ClayModelError> {
        self.end_stroke()?;
        let meter = self.meter(self.estimate_nodes(TREE_STEPS))?;
        let clay = self.settings.material.clone();
        let painted = painted.or_harder(&clay);
        let lattice = *self.base.lattice();
        let mut map = self.material_map.clone();
        let mut after = clay.clone();
        let n_reached = match place {
            MaterialPlace::Everywhere => {
                after.mass_kg = painted.mass_kg.unwrap_or(clay.mass_kg);
                after.damping_n_s_per_m =
                    painted.damping_n_s_per_m.unwrap_or(clay.damping_n_s_per_m);
                after.stiffness_n_per_m =
                    painted.stiffness_n_per_m.unwrap_or(clay.stiffness_n_per_m);
                if after == clay { 0 } else { lattice.n_nodes() }
            }
            MaterialPlace::Box { low_map, high_map } => {
                let is_in = |at: DVec3| at.cmpge(*low_map).all() && at.cmple(*high_map).all();
                map.lay((&lattice, &clay), |at| is_in(at).then_some((painted, 1.0)), &meter)?
            }
            MaterialPlace::Ball { center_map, radius_m, falloff } => {
                let weight = |at: DVec3| falloff.weight(at.distance(*center_map) / radius_m) as f32;
                map.lay((&lattice, &clay), |at| Some((painted, weight(at))), &meter)?
            }
            MaterialPlace::Gradient { from_map, to_map } => {
                let way = *to_map - *from_map;
                let share =
                    |at: DVec3| ((at - *from_map).dot(way) / way.length_squared()).clamp(0.0, 1.0);
                map.lay((&lattice, &clay), |at| Some((painted, share(at) as f32)), &meter)?
            }
            MaterialPlace::Values { places_map, painted, within_m } => {
                let near = Neighbours::new(places_map);
                let nearest = |at: DVec3| {
                    let nearest = near.nearest(at)?;
                    let sample = nearest.sample as usize;
                    (places_map[sample].distance(at) <= *within_m).then(|| (painted[sample], 1.0))
                };
                map.lay((&lattice, &clay), nearest, &meter)?
            }
        };
        if n_reached > 0 {
            self.remember();
            (self.settings.material, self.material_map) = (after, map);
            self.renew_material();
            self.settle();
        }
        Ok(n_reached)
    }

    /// What was painted, on the nodes of the base.
    #[cfg(test)]
    pub(crate) fn material_map(&self) -> &MaterialMap {
        &self.material_map
    }

    /// What the mass point nearest to a place is made of; far from the clay, what all of it is
    /// made of at first.
    pub fn material_at(&self, point_map: DVec3) -> Material {
        let lattice = self.base.lattice();
        let nodes = ((point_map - lattice.origin_map) / lattice.spacing_m).round().to_array();
        let is_in =
            (0..3).all(|axis| nodes[axis] >= 0.0 && nodes[axis] < lattice.dims[axis] as f64);
        let node = is_in.then(|| lattice.index(nodes.map(|n| n as usize)));
        node.map_or_else(
            || self.settings.material.clone(),
            |node| self.material_map.at(node, &self.settings.material),
        )
    }

    /// The press is over: the region moves as what was painted.
    pub(super) fn set_material(&mut self) {
        if self.material_coat.take().is_some() {
            self.renew_material();
        }
    }

    fn renew_material(&mut self) {
        let lattice = *self.region.dynamics.lattice();
        let of_part = self.material_map.of_part(
            self.base.lattice(),
            self.region.first,
            &lattice,
            &self.settings.material,
        );
        *self.region.dynamics.material_mut() = of_part;
    }
}

#[cfg(test)]
mod tests;
