//! Painted material: mass, damping and stiffness of single mass points.
//!
//! In Guo2004 the user may modify the distribution of mass, damping and stiffness; the paper does
//! not say how, and its brush paints colour only. Here (ours) a brush paints them with the paper's
//! equation of paint. A property q of a node under the brush becomes
//!
//! q = q_b I + q_p (1 − I)
//!
//! as colours do, with q_b that of the brush, q_p that from before the press, and I the weight of
//! the fall-off at the distance of the node from the middle of the brush: a ball, so what is
//! painted has depth. While the brush is pressed a node keeps the largest I that it was given.
//!
//! Invariant: a node that was never painted has the constants of the clay, to the bit. Nodes stay
//! where they are in space, as mass points of the paper do: clay that is pulled away leaves its
//! properties behind.

use std::sync::Arc;

use glam::DVec3;
use rayon::prelude::*;

use super::dynamics::{Material, Quantity};
use super::falloff::Falloff;
use super::paint::Dab;
use super::pull::nodes_within;
use super::work_meter::TREE_STEPS;
use super::{WorkError, WorkMeter};
use vps::density::Lattice;

/// A node that was not painted.
const BARE: f32 = f32::NAN;
/// Mass, damping, stiffness.
const N_PROPERTIES: usize = 3;

/// What a brush makes of the mass points under it; what is `None` stays as it is.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Painted {
    /// Of a mass point, kg.
    pub mass_kg: Option<f32>,
    /// Of a mass point, N·s/m.
    pub damping_n_s_per_m: Option<f32>,
    /// Of the springs of a mass point, N/m.
    pub stiffness_n_per_m: Option<f32>,
}

impl Painted {
    /// Where nothing is said, clay becomes so many times as hard: stiffness and damping, so that it
    /// gives way that much less at its usual pace.
    pub const HARDER: f32 = 10.0;

    /// What mass points may have, in words.
    pub const KNOWN_GOOD: &str = "paint a mass from 1e-9 to 1 kg, a damping from 0 to 10000 N·s/m, \
        a stiffness above 0 up to 1e6 N/m";

    /// Itself; where it says nothing, [so many times](Self::HARDER) the stiffness and damping of
    /// the clay.
    #[must_use]
    pub fn or_harder(self, clay: &Material) -> Self {
        if self != Self::default() {
            return self;
        }
        let harder = |value: f32, most: f64| Some((Self::HARDER * value).min(most as f32));
        Self {
            mass_kg: None,
            damping_n_s_per_m: harder(clay.damping_n_s_per_m, *Material::DAMPING_N_S_PER_M.end()),
            stiffness_n_per_m: harder(clay.stiffness_n_per_m, Material::STIFFNESS_MAX_N_PER_M),
        }
    }

    /// The first property that no mass point may have: its name, value and unit.
    pub fn unsound(&self) -> Option<(&'static str, f32, &'static str)> {
        let Self { mass_kg, damping_n_s_per_m, stiffness_n_per_m } = *self;
        let is_in = |range: &core::ops::RangeInclusive<f64>, value: f32| {
            (*range.start() as f32..=*range.end() as f32).contains(&value)
        };
        let mass = mass_kg
            .filter(|value| !is_in(&Material::MASS_KG, *value))
            .map(|value| ("a mass", value, "kg"));
        let damping =
            damping_n_s_per_m.filter(|value| !is_in(&Material::DAMPING_N_S_PER_M, *value));
        let is_stiffness =
            |value: f32| value > 0.0 && value <= Material::STIFFNESS_MAX_N_PER_M as f32;
        let stiffness = stiffness_n_per_m.filter(|value| !is_stiffness(*value));
        mass.or(damping.map(|value| ("a damping", value, "N·s/m")))
            .or(stiffness.map(|value| ("a stiffness", value, "N/m")))
    }

    fn properties(&self) -> [Option<f32>; N_PROPERTIES] {
        [self.mass_kg, self.damping_n_s_per_m, self.stiffness_n_per_m]
    }
}

/// Where material is laid at once, rather than painted. Ours: the paper says that users modify the
/// distributions "directly", and not how.
#[derive(Clone, Debug, PartialEq)]
pub enum MaterialPlace {
    /// What all of the clay is made of where nothing was painted or laid.
    Everywhere,
    /// Mass points in a box, map frame, m.
    Box {
        /// Lowest corner.
        low_map: DVec3,
        /// Highest corner.
        high_map: DVec3,
    },
    /// Mass points in a ball, in full in its middle and less towards its rim.
    Ball {
        /// Its middle, map frame, m.
        center_map: DVec3,
        /// m.
        radius_m: f64,
        /// How.
        falloff: Falloff,
    },
    /// All mass points: as they are before `from_map`, in full beyond `to_map`, and evenly in
    /// between along that way.
    Gradient {
        /// Map frame, m.
        from_map: DVec3,
        /// Map frame, m.
        to_map: DVec3,
    },
    /// Each mass point becomes what the nearest of these places says, if one is near enough.
    Values {
        /// Places, map frame, m.
        places_map: Arc<[DVec3]>,
        /// What each of them says.
        painted: Arc<[Painted]>,
        /// Farther places say nothing, m.
        within_m: f64,
    },
}

impl MaterialPlace {
    /// Places with values at most.
    pub const VALUES_MAX: usize = 1_000_000;

    /// The first line of a text of values.
    pub const VALUES_HEADER: &str = "x_mm,y_mm,z_mm,mass,damping,stiffness";

    /// How a text of values is written.
    pub fn values_hint() -> String {
        let header = Self::VALUES_HEADER;
        let good = Painted::KNOWN_GOOD;
        format!("write `{header}`, then a line for each place; what is left empty stays. {good}")
    }

    /// Reads values: [`Self::VALUES_HEADER`], then a line for each place, mm, kg, N·s/m and N/m;
    /// what is left empty stays.
    ///
    /// # Errors
    /// What is wrong, with the number of its line.
    pub fn values(text: &[u8], within_m: f64) -> Result<Self, String> {
        let text = core::str::from_utf8(text).map_err(|_| "it is no text".to_owned())?;
        // Spreadsheets begin a text with a mark.
        let mut lines = text
            .trim_start_matches('\u{feff}')
            .lines()
            .enumerate()
            .filter(|(_, line)| !line.trim().is_empty());
        if lines.next().is_none_or(|(_, line)| line.trim() != Self::VALUES_HEADER) {
            return Err(format!("the first line is not `{}`", Self::VALUES_HEADER));
        }
        let mut places_map = Vec::new();
        let mut painted = Vec::new();
        for (index, line) in lines {
            let wrong = |what: String| Err(format!("line {}: {what}", index + 1));
            // One cell too many is enough to see that there are too many.
            let cells = line.split(',').map(str::trim).take(7);
            let numbers: Option<Vec<Option<f64>>> = cells
                .map(|cell| if cell.is_empty() { Some(None) } else { cell.parse().ok().map(Some) })
                .collect();
            let Some(&[Some(x), Some(y), Some(z), mass, damping, stiffness]) = numbers.as_deref()
            else {
                let begin: String = line.chars().take(80).collect();
                return wrong(format!(
                    "`{begin}` is not three coordinates and up to three properties"
                ));
            };
            let at_map = DVec3::new(x, y, z) * 1e-3;
            let [mass_kg, damping_n_s_per_m, stiffness_n_per_m] =
                [mass, damping, stiffness].map(|value| value.map(|value| value as f32));
            let said = Painted { mass_kg, damping_n_s_per_m, stiffness_n_per_m };
            if let Some((what, value, unit)) = said.unsound() {
                return wrong(format!("{what} of {value} {unit}"));
            }
            if !at_map.is_finite() || places_map.len() == Self::VALUES_MAX {
                return wrong(format!("no place, or one more than {}", Self::VALUES_MAX));
            }
            places_map.push(at_map);
            painted.push(said);
        }
        if places_map.is_empty() {
            return Err("it has no place".to_owned());
        }
        Ok(Self::Values { places_map: places_map.into(), painted: painted.into(), within_m })
    }

    /// What is wrong with it, in words; `None`: nothing.
    pub fn unsound(&self) -> Option<String> {
        match self {
            Self::Everywhere => None,
            Self::Box { low_map, high_map } => {
                let is_box =
                    low_map.is_finite() && high_map.is_finite() && low_map.cmplt(*high_map).all();
                (!is_box).then(|| "a box whose first corner is not the lowest".to_owned())
            }
            Self::Ball { center_map, radius_m, .. } => {
                let is_ball = center_map.is_finite() && *radius_m > 0.0 && radius_m.is_finite();
                (!is_ball).then(|| format!("a ball with a radius of {radius_m} m"))
            }
            Self::Gradient { from_map, to_map } => {
                let is_way = from_map.is_finite() && to_map.is_finite() && from_map != to_map;
                (!is_way).then(|| "a gradient between two places that are one".to_owned())
            }
            Self::Values { places_map, painted, within_m } => {
                let is_sound = places_map.len() == painted.len()
                    && (1..=Self::VALUES_MAX).contains(&painted.len())
                    && places_map.iter().all(|at| at.is_finite())
                    && *within_m > 0.0
                    && within_m.is_finite();
                (!is_sound)
                    .then(|| format!("{} values of material, or one at no place", painted.len()))
            }
        }
    }
}

/// `[n_nodes]` of one property, NaN where bare.
pub(super) type Layer = Arc<[f32]>;

fn constants(clay: &Material) -> [f32; N_PROPERTIES] {
    [clay.mass_kg, clay.damping_n_s_per_m, clay.stiffness_n_per_m]
}

/// What was painted on the nodes of a lattice. Cheap to clone: values are shared until one changes.
#[derive(Clone, Debug, Default)]
pub(super) struct MaterialMap {
    /// Mass kg, damping N·s/m, stiffness N/m; `None` where none of it was painted.
    layers: [Option<Layer>; N_PROPERTIES],
}

impl MaterialMap {
    pub(super) fn new(layers: [Option<Layer>; N_PROPERTIES]) -> Self {
        Self { layers }
    }

    pub(super) fn layers(&self) -> &[Option<Layer>; N_PROPERTIES] {
        &self.layers
    }

    /// Nothing was painted.
    #[cfg(test)]
    pub(super) fn is_bare(&self) -> bool {
        self.layers.iter().all(Option::is_none)
    }

    /// What it takes in memory, bytes.
    pub(super) fn n_bytes(&self) -> usize {
        self.layers.iter().flatten().map(|layer| size_of_val(&**layer)).sum()
    }

    /// What it takes beside another with which it may share values, bytes.
    pub(super) fn n_bytes_beside(&self, other: &Self) -> usize {
        let is_own = |(own, other): &(&Option<Layer>, &Option<Layer>)| match (own, other) {
            (Some(own), Some(other)) => !Arc::ptr_eq(own, other),
            (own, _) => own.is_some(),
        };
        let own = self.layers.iter().zip(&other.layers).filter(is_own);
        own.filter_map(|(own, _)| own.as_deref()).map(size_of_val).sum()
    }

    /// The same nodes, to the bit, have the same values.
    #[cfg(test)]
    pub(super) fn is_same(&self, other: &Self) -> bool {
        self.layers.iter().zip(&other.layers).all(|(one, other)| match (one, other) {
            (Some(one), Some(other)) => {
                Arc::ptr_eq(one, other)
                    || one.len() == other.len()
                        && one
                            .iter()
                            .zip(&**other)
                            .all(|(one, other)| one.to_bits() == other.to_bits())
            }
            (one, other) => one.is_none() && other.is_none(),
        })
    }

    /// The material of a node of its lattice.
    pub(super) fn at(&self, node: usize, clay: &Material) -> Material {
        let [mass_kg, damping_n_s_per_m, stiffness_n_per_m] = self.values(node, clay);
        Material { mass_kg, damping_n_s_per_m, stiffness_n_per_m, ..clay.clone() }
    }

    fn values(&self, node: usize, clay: &Material) -> [f32; N_PROPERTIES] {
        let mut values = constants(clay);
        for (value, layer) in values.iter_mut().zip(&self.layers) {
            *value = layer.as_deref().map_or(*value, |layer| or_bare(layer[node], *value));
        }
        values
    }

    /// The material of a part of its lattice, whose first node is `first`. Cost: O(nodes of the
    /// part) for each property that was painted.
    pub(super) fn of_part(
        &self,
        whole: &Lattice,
        first: [usize; 3],
        part: &Lattice,
        clay: &Material,
    ) -> Material<Quantity> {
        let [nx, ny, nz] = part.dims;
        let quantity = |layer: &Option<Layer>, constant: f32| {
            let Some(layer) = layer else { return Quantity::Constant(constant) };
            let mut values = Vec::with_capacity(part.n_nodes());
            for x in 0..nx {
                for y in 0..ny {
                    let from = whole.index([first[0] + x, first[1] + y, first[2]]);
                    values.extend(
                        layer[from..from + nz].iter().map(|value| or_bare(*value, constant)),
                    );
                }
            }
            // One number for all is faster.
            if values.iter().all(|value| *value == constant) {
                return Quantity::Constant(constant);
            }
            Quantity::PerNode(values.into_boxed_slice())
        };
        let [mass, damping, stiffness] = &self.layers;
        Material {
            mass_kg: quantity(mass, clay.mass_kg),
            damping_n_s_per_m: quantity(damping, clay.damping_n_s_per_m),
            stiffness_n_per_m: quantity(stiffness, clay.stiffness_n_per_m),
            creep_s: clay.creep_s,
            acceleration_max_m_per_s2: clay.acceleration_max_m_per_s2,
        }
    }

    /// Lays a material on the nodes of its lattice: q = q_b I + q_p (1 − I), as the brush does.
    /// Gives how many nodes it reached. Parallel; cost: O(nodes).
    pub(super) fn lay(
        &mut self,
        (lattice, clay): (&Lattice, &Material),
        of_place: impl Fn(DVec3) -> Option<(Painted, f32)> + Sync,
        meter: &WorkMeter,
    ) -> Result<usize, WorkError> {
        let [nx, ny, nz] = lattice.dims;
        let of_node = |x: usize, yz: usize| {
            let (painted, weight) = of_place(lattice.position([x, yz / nz, yz % nz]))?;
            (weight > 0.0).then_some((x * ny * nz + yz, painted, weight))
        };
        let of_plane = |x: usize| {
            meter.take(TREE_STEPS * (ny * nz) as u64)?;
            Ok((0..ny * nz).filter_map(|yz| of_node(x, yz)).collect())
        };
        let planes: Vec<Vec<(usize, Painted, f32)>> =
            (0..nx).into_par_iter().map(of_plane).collect::<Result<_, WorkError>>()?;
        let reached = planes.concat();
        let under = self.clone();
        for (property, layer) in self.layers.iter_mut().enumerate() {
            let given = || {
                reached.iter().filter_map(|(node, painted, weight)| {
                    Some((*node, painted.properties()[property]?, *weight))
                })
            };
            if given().next().is_none() {
                continue;
            }
            let values =
                Arc::make_mut(layer.get_or_insert_with(|| vec![BARE; lattice.n_nodes()].into()));
            for (node, value, weight) in given() {
                values[node] = value * weight + under.values(node, clay)[property] * (1.0 - weight);
            }
        }
        Ok(reached.len())
    }

    /// The same on another lattice, interpolated between eight nodes, bare ones among them with the
    /// constants; bare where none of the eight was painted, and beyond the lattice before.
    /// Parallel; cost: O(nodes of both) for each property that was painted.
    #[must_use]
    pub(super) fn onto(&self, from: &Lattice, to: &Lattice, clay: &Material) -> Self {
        if from == to {
            return self.clone();
        }
        let plane_nodes = to.dims[1] * to.dims[2];
        let layers = core::array::from_fn(|property| {
            let layer = self.layers[property].as_deref()?;
            let constant = constants(clay)[property];
            let mut moved = vec![BARE; to.n_nodes()];
            moved.par_chunks_mut(plane_nodes.max(1)).enumerate().for_each(|(x, plane)| {
                for (yz, value) in plane.iter_mut().enumerate() {
                    let at = to.position([x, yz / to.dims[2], yz % to.dims[2]]);
                    *value = interpolated(from, layer, from.nodes(at).to_array(), constant);
                }
            });
            moved.iter().any(|value| !value.is_nan()).then(|| Arc::from(moved))
        });
        Self { layers }
    }
}

/// A node whose number is all but whole is asked alone: lattices that share nodes share values.
const ON_NODE: f32 = 1e-3;

fn interpolated(lattice: &Lattice, layer: &[f32], nodes: [f32; 3], constant: f32) -> f32 {
    let mut low = [0; 3];
    let mut share = [0.0; 3];
    for axis in 0..3 {
        let last = lattice.dims[axis] as f32 - 1.0;
        let on_node = nodes[axis].round();
        let node = if (nodes[axis] - on_node).abs() < ON_NODE { on_node } else { nodes[axis] };
        if !(node >= 0.0 && node <= last) {
            return BARE;
        }
        let below = node.floor().min(last - 1.0).max(0.0);
        (low[axis], share[axis]) = (below as usize, node - below);
    }
    let mut sum = 0.0;
    let mut is_bare = true;
    for corner in 0..8_usize {
        let offset = [corner >> 2 & 1, corner >> 1 & 1, corner & 1];
        let weight: f32 = (0..3)
            .map(|axis| if offset[axis] == 1 { share[axis] } else { 1.0 - share[axis] })
            .product();
        if weight > 0.0 {
            let value = layer[lattice.index([0, 1, 2].map(|axis| low[axis] + offset[axis]))];
            is_bare &= value.is_nan();
            sum += weight * or_bare(value, constant);
        }
    }
    if is_bare { BARE } else { sum }
}

fn or_bare(value: f32, constant: f32) -> f32 {
    if value.is_nan() { constant } else { value }
}

/// What one press of a brush has put over the material before.
#[derive(Clone, Debug)]
pub(super) struct MaterialCoat {
    painted: Painted,
    under: MaterialMap,
    /// `[n_nodes]`: the largest I so far, 0 to 1.
    weights: Box<[f32]>,
}

impl MaterialCoat {
    /// Nothing yet, over a map of so many nodes.
    pub(super) fn over(under: &MaterialMap, n_nodes: usize, painted: Painted) -> Self {
        Self { painted, under: under.clone(), weights: vec![0.0; n_nodes].into_boxed_slice() }
    }

    /// What it paints.
    pub(super) fn painted(&self) -> &Painted {
        &self.painted
    }

    /// Paints the nodes in the ball of a dab, of any side: those within one spacing at least, so
    /// that a brush finer than the lattice paints too. Gives how many changed. Cost: O(nodes in the
    /// ball); in the first dab of a press also a copy of what was painted.
    pub(super) fn dab(
        &mut self,
        map: &mut MaterialMap,
        (lattice, clay): (&Lattice, &Material),
        falloff: &Falloff,
        dab: Dab,
    ) -> usize {
        let can_paint = dab.radius_m > 0.0 && dab.radius_m.is_finite() && dab.at_map.is_finite();
        if !can_paint {
            return 0;
        }
        let radius_m = dab.radius_m.max(lattice.spacing_m);
        let (first, last) = nodes_within(lattice, dab.at_map - radius_m, dab.at_map + radius_m);
        let mut n_painted = 0;
        for x in first[0]..=last[0] {
            for y in first[1]..=last[1] {
                for z in first[2]..=last[2] {
                    let distance_m = lattice.position([x, y, z]).distance(dab.at_map);
                    let weight = falloff.weight(distance_m / radius_m) as f32;
                    let node = lattice.index([x, y, z]);
                    if weight > self.weights[node] {
                        self.weights[node] = weight;
                        self.put(map, node, weight, clay);
                        n_painted += 1;
                    }
                }
            }
        }
        n_painted
    }

    fn put(&self, map: &mut MaterialMap, node: usize, weight: f32, clay: &Material) {
        let under = self.under.values(node, clay);
        for ((layer, painted), under) in
            map.layers.iter_mut().zip(self.painted.properties()).zip(under)
        {
            let Some(painted) = painted else { continue };
            let layer = layer.get_or_insert_with(|| vec![BARE; self.weights.len()].into());
            Arc::make_mut(layer)[node] = painted * weight + under * (1.0 - weight);
        }
    }
}

#[cfg(test)]
mod tests;
