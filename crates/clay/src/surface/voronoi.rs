//! The nearest sample of every node of a lattice: nodes take it over from their neighbours.
//!
//! Cost: four passes over the lattice, whatever the samples; a tree would look at a large part of
//! them wherever many are almost equally near. Where no node around a node has the right sample, it
//! keeps one that is farther by a small part of the spacing.
//!
//! # Source
//! Danielsson 1980, "Euclidean distance mapping", with all 26 neighbours of a node.

use glam::DVec3;
use rayon::prelude::*;

use crate::{Neighbours, WorkError, WorkMeter};
use vps::density::Lattice;

const NONE: u32 = u32::MAX;

/// `[n_nodes]`: the number of the nearest sample of each node.
pub(super) fn nearest_samples(
    lattice: &Lattice,
    positions_map: &[DVec3],
    near: &Neighbours,
    meter: &WorkMeter,
) -> Result<Vec<u32>, WorkError> {
    let mut map = Map { lattice, positions_map, nearest: vec![NONE; lattice.n_nodes()] };
    if !map.seed() {
        map.seed_faces(near);
    }
    for _ in 0..2 {
        map.pass(false, meter)?;
        map.pass(true, meter)?;
    }
    Ok(map.nearest)
}

struct Map<'a> {
    lattice: &'a Lattice,
    positions_map: &'a [DVec3],
    nearest: Vec<u32>,
}

impl Map<'_> {
    /// Offers every sample to the nodes around it; false when a sample is outside the lattice.
    fn seed(&mut self) -> bool {
        let last = self.lattice.dims.map(|n| n as f64 - 1.0);
        let mut all_within = true;
        for (position_map, sample) in self.positions_map.iter().zip(0..) {
            let at = (position_map - self.lattice.origin_map) / self.lattice.spacing_m;
            if !(at.cmpge(DVec3::ZERO).all() && at.cmple(DVec3::from_array(last)).all()) {
                all_within = false;
                continue;
            }
            let first = at.to_array().map(|at| at as usize);
            for corner in 0..8 {
                let node = [
                    first[0] + (corner >> 2),
                    first[1] + (corner >> 1 & 1),
                    first[2] + (corner & 1),
                ];
                if (0..3).all(|axis| node[axis] < self.lattice.dims[axis]) {
                    self.offer(node, sample);
                }
            }
        }
        all_within
    }

    /// The way to a sample outside goes through the faces of the lattice.
    fn seed_faces(&mut self, near: &Neighbours) {
        let dims = self.lattice.dims;
        let is_face =
            |node: &[usize; 3]| (0..3).any(|axis| node[axis] == 0 || node[axis] + 1 == dims[axis]);
        let lattice = self.lattice;
        let [_, ny, nz] = dims;
        self.nearest.par_iter_mut().enumerate().for_each(|(place, nearest)| {
            let node = [place / nz / ny, place / nz % ny, place % nz];
            if is_face(&node)
                && let Some(found) = near.nearest(lattice.position(node))
            {
                *nearest = found.sample;
            }
        });
    }

    fn key(&self, at_map: DVec3, sample: u32) -> (f64, u32) {
        if sample == NONE {
            return (f64::INFINITY, NONE);
        }
        (self.positions_map[sample as usize].distance_squared(at_map), sample)
    }

    fn offer(&mut self, node: [usize; 3], sample: u32) {
        let place = self.lattice.index(node);
        let at_map = self.lattice.position(node);
        if self.key(at_map, sample) < self.key(at_map, self.nearest[place]) {
            self.nearest[place] = sample;
        }
    }

    /// Every node looks at the 13 neighbours before it; backwards, at those behind it.
    fn pass(&mut self, backwards: bool, meter: &WorkMeter) -> Result<(), WorkError> {
        let dims = self.lattice.dims;
        let sign = if backwards { -1 } else { 1 };
        let before: [[isize; 3]; 13] =
            core::array::from_fn(|k| [k / 9, k / 3 % 3, k % 3].map(|at| sign * (at as isize - 1)));
        let strides = before.map(|[x, y, z]| (x * dims[1] as isize + y) * dims[2] as isize + z);
        let in_turn = |axis: usize| {
            (0..dims[axis]).map(move |n| if backwards { dims[axis] - 1 - n } else { n })
        };
        for (x, y) in in_turn(0).flat_map(|x| in_turn(1).map(move |y| (x, y))) {
            meter.take(dims[2] as u64)?;
            for z in in_turn(2) {
                let node = [x, y, z];
                let place = self.lattice.index(node);
                let at_map = self.lattice.position(node);
                let is_within = (0..3).all(|axis| node[axis] > 0 && node[axis] + 1 < dims[axis]);
                let mut best = self.key(at_map, self.nearest[place]);
                let mut seen = best.1;
                for (offset, stride) in before.iter().zip(strides) {
                    if !is_within
                        && (0..3)
                            .any(|axis| node[axis].wrapping_add_signed(offset[axis]) >= dims[axis])
                    {
                        continue;
                    }
                    let sample = self.nearest[place.wrapping_add_signed(stride)];
                    if sample != NONE && sample != seen && sample != best.1 {
                        seen = sample;
                        let key = self.key(at_map, sample);
                        if key < best {
                            best = key;
                        }
                    }
                }
                self.nearest[place] = best.1;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nearest_samples_are_those_of_the_tree_or_hardly_farther() {
        let positions: Vec<DVec3> = (0..400)
            .map(|k| {
                DVec3::new(
                    (f64::from(k) * 0.7).sin(),
                    (f64::from(k) * 1.3).cos(),
                    (f64::from(k) * 2.1).sin(),
                )
            })
            .collect();
        let near = Neighbours::new(&positions);
        for (origin_map, spacing_m) in
            [(DVec3::splat(-1.2), 0.1), (DVec3::new(-0.3, 0.1, 0.2), 0.03)]
        {
            let lattice = Lattice { origin_map, spacing_m, dims: [25, 24, 23] };
            let found =
                nearest_samples(&lattice, &positions, &near, &WorkMeter::unlimited()).unwrap();
            let mut n_same = 0;
            for (place, sample) in found.iter().enumerate() {
                let at = lattice.position([place / 23 / 24, place / 23 % 24, place % 23]);
                let right = near.nearest(at).unwrap();
                n_same += usize::from(right.sample == *sample);
                let farther =
                    positions[*sample as usize].distance(at) - right.distance_squared_m2.sqrt();
                assert!(farther < 0.2 * spacing_m, "{at}: {farther}");
            }
            assert!(n_same * 100 > found.len() * 99, "{n_same} of {}", found.len());
        }
    }
}
