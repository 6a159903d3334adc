//! The field at all nodes of a lattice.
//!
//! Every sample adds itself to the nodes in its ball, one plane of the lattice after the other;
//! what no ball reaches is filled from the nearest samples. Cost: proportional to the nodes, and to
//! the nodes in the balls of all samples.

use rayon::prelude::*;

use super::super::local_fit::LocalFit;
use super::super::work_meter::SIDE_STEPS;
use super::super::{Patch, WorkError, WorkMeter};
use super::PointSurface;
use super::blend::{Blend, is_next, patch_shares};
use super::voronoi::nearest_samples;
use vps::density::{Lattice, Raster};

/// Steps of a node: it is looked at six times, and few are asked by themselves on which side they
/// are.
pub(crate) const NODE_STEPS: u64 = 6 + SIDE_STEPS / 2;
/// Nodes along the edge of a block beyond the shell, which is on one side as a whole.
const BLOCK: usize = 4;

/// Sums of equation 3 over one plane of the lattice.
#[derive(Default)]
struct PlaneSums {
    weights: Vec<f64>,
    sums_m: Vec<f64>,
    /// Nodes to which samples were added.
    steps: u64,
    /// What the patches before this one have made, where there are several.
    joined: Vec<Joined>,
}

/// Of one node: the field of the patches so far.
#[derive(Clone, Copy, Default)]
struct Joined {
    weight: f64,
    value_m: f64,
    presence: f64,
}

impl PlaneSums {
    fn clear(&mut self, n: usize) {
        self.steps = 0;
        for sums in [&mut self.weights, &mut self.sums_m] {
            sums.clear();
            sums.resize(n, 0.0);
        }
    }

    /// The sums so far are those of a patch: they are joined with the patches before it.
    fn end_patch(&mut self, patch: Patch) {
        for ((joined, weight), sum_m) in
            self.joined.iter_mut().zip(&mut self.weights).zip(&mut self.sums_m)
        {
            if *weight > 0.0 {
                let now_m = joined.value_m;
                let next_m = *sum_m / *weight;
                let ([before, alone, both], presence) = patch_shares(joined.presence, *weight);
                let decides_m = if is_next(patch, now_m, next_m) { next_m } else { now_m };
                joined.value_m = before * now_m + alone * next_m + both * decides_m;
                joined.presence = presence;
                joined.weight += *weight;
                (*weight, *sum_m) = (0.0, 0.0);
            }
        }
    }

    /// The sums are those of all patches.
    fn end_patches(&mut self) {
        for ((joined, weight), sum_m) in
            self.joined.iter().zip(&mut self.weights).zip(&mut self.sums_m)
        {
            (*weight, *sum_m) = (joined.weight, joined.weight * joined.value_m);
        }
    }
}

impl PointSurface {
    /// The field at every node, as [`Self::at`] gives it. Far from the surface it may be off by a
    /// small part of the lattice's spacing, and there it depends on the lattice: a region is cut
    /// out of the raster of the whole, not rasterized by itself.
    pub(crate) fn rasterize(
        &self,
        lattice: Lattice,
        meter: &WorkMeter,
    ) -> Result<Raster, WorkError> {
        let mut raster = Raster::uniform(lattice, f32::NAN);
        let [_, ny, nz] = lattice.dims;
        let by_plane = self.samples_by_plane(&lattice);
        let nearest = nearest_samples(&lattice, &self.points.positions_map, &self.near, meter)?;
        let planes = raster.values_m_mut().par_chunks_mut((ny * nz).max(1)).enumerate();
        planes.try_for_each_init(PlaneSums::default, |sums, (x, values_m)| {
            sums.clear(ny * nz);
            if self.has_patches {
                self.add_patches(&by_plane[x], &lattice, x, sums);
            } else {
                for sample in &by_plane[x] {
                    self.add(*sample, &lattice, x, sums);
                }
            }
            meter.take(sums.steps + (ny * nz) as u64)?;
            self.near_shell(&lattice, x, sums, values_m);
            Ok(())
        })?;
        let slabs = raster.values_m_mut().par_chunks_mut((BLOCK * ny * nz).max(1)).enumerate();
        slabs.try_for_each(|(slab, values_m)| {
            let n_asked = self.far_from_shell(&lattice, slab * BLOCK, &nearest, values_m);
            meter.take(SIDE_STEPS * n_asked + values_m.len() as u64)
        })?;
        Ok(raster)
    }

    /// About how many steps [`Self::rasterize`] takes. Cost: O(samples).
    pub(crate) fn steps_of_raster(&self, lattice: &Lattice) -> u64 {
        let n_nodes = |fit: &LocalFit| -> u64 {
            let n = [0, 1, 2].map(|axis| {
                let low_map = fit.center_map[axis] - fit.half_m;
                let (from, to) = nodes_within(lattice, axis, low_map, low_map + 2.0 * fit.half_m);
                (to - from) as u64
            });
            n.iter().product()
        };
        NODE_STEPS * lattice.n_nodes() as u64 + self.fits.iter().map(n_nodes).sum::<u64>()
    }

    /// The samples whose ball reaches into each plane x, in ascending order.
    fn samples_by_plane(&self, lattice: &Lattice) -> Vec<Vec<u32>> {
        let mut planes = vec![Vec::new(); lattice.dims[0]];
        let (low, high) = lattice.bounds();
        for (fit, sample) in self.fits.iter().zip(0..) {
            let lowest = fit.center_map - fit.half_m;
            let highest = fit.center_map + fit.half_m;
            if lowest.cmple(high).all() && highest.cmpge(low).all() {
                let (from, to) = nodes_within(lattice, 0, lowest.x, highest.x);
                planes[from..to].iter_mut().for_each(|plane| plane.push(sample));
            }
        }
        planes
    }

    /// The samples of a plane, patch after patch.
    fn add_patches(&self, samples: &[u32], lattice: &Lattice, x: usize, sums: &mut PlaneSums) {
        let mut samples: Vec<(Patch, u32)> =
            samples.iter().map(|sample| (self.points.patch(*sample), *sample)).collect();
        samples.sort_unstable();
        sums.joined.clear();
        sums.joined.resize(sums.weights.len(), Joined::default());
        for of_patch in samples.chunk_by(|(one, _), (other, _)| one == other) {
            for (_, sample) in of_patch {
                self.add(*sample, lattice, x, sums);
            }
            sums.end_patch(of_patch[0].0);
        }
        sums.end_patches();
    }

    fn add(
        &self,
        sample: u32,
        lattice: &Lattice,
        x: usize,
        PlaneSums { weights, sums_m, steps, .. }: &mut PlaneSums,
    ) {
        let fit = &self.fits[sample as usize];
        let center = fit.center_map;
        let nz = lattice.dims[2];
        let x_map = lattice.origin_map.x + x as f64 * lattice.spacing_m;
        let left = fit.half_m * fit.half_m - (x_map - center.x).powi(2);
        if left <= 0.0 {
            return;
        }
        let reach_y = left.sqrt();
        let (from_y, to_y) = nodes_within(lattice, 1, center.y - reach_y, center.y + reach_y);
        for y in from_y..to_y {
            let y_map = lattice.origin_map.y + y as f64 * lattice.spacing_m;
            let off_squared = (x_map - center.x).powi(2) + (y_map - center.y).powi(2);
            let left = fit.half_m * fit.half_m - off_squared;
            if left <= 0.0 {
                continue;
            }
            let reach_z = left.sqrt();
            let (from_z, to_z) = nodes_within(lattice, 2, center.z - reach_z, center.z + reach_z);
            let line = fit.along_z(x_map, y_map);
            *steps += (to_z - from_z) as u64;
            for z in from_z..to_z {
                let off = lattice.origin_map.z + z as f64 * lattice.spacing_m - center.z;
                let (weight, _) = self.weight(fit, off_squared + off * off);
                weights[y * nz + z] += weight;
                sums_m[y * nz + z] += weight * (line[0] + off * (line[1] + off * line[2]));
            }
        }
    }

    /// Nodes that a ball reaches; all others are left.
    fn near_shell(
        &self,
        lattice: &Lattice,
        x: usize,
        PlaneSums { weights, sums_m, .. }: &PlaneSums,
        values_m: &mut [f32],
    ) {
        let nz = lattice.dims[2];
        for (place, ((value_m, weight), sum_m)) in
            values_m.iter_mut().zip(weights).zip(sums_m).enumerate()
        {
            let blend = Blend::of(*weight, *sum_m);
            if blend.is_full() {
                *value_m = (sum_m / weight) as f32;
            } else if *weight > 0.0 {
                let point_map = lattice.position([x, place / nz, place % nz]);
                if let Some(nearest) = self.near.nearest(point_map) {
                    *value_m = blend.fade(self.far(nearest.sample, point_map)).value_m as f32;
                }
            }
        }
    }

    /// Fills what is left in a slab of planes from `from_x` on. Gives how often it was asked on
    /// which side a place is.
    fn far_from_shell(
        &self,
        lattice: &Lattice,
        from_x: usize,
        nearest: &[u32],
        values_m: &mut [f32],
    ) -> u64 {
        let mut n_asked = 0;
        let [_, ny, nz] = lattice.dims;
        let n_planes = values_m.len() / (ny * nz);
        let nearest = &nearest[from_x * ny * nz..][..values_m.len()];
        for from_y in (0..ny).step_by(BLOCK) {
            for from_z in (0..nz).step_by(BLOCK) {
                let to_y = (from_y + BLOCK).min(ny);
                let to_z = (from_z + BLOCK).min(nz);
                let nodes = || {
                    (0..n_planes).flat_map(move |x| {
                        (from_y..to_y).flat_map(move |y| (from_z..to_z).map(move |z| [x, y, z]))
                    })
                };
                let place = |[x, y, z]: [usize; 3]| (x * ny + y) * nz + z;
                let left = nodes().filter(|node| values_m[place(*node)].is_nan()).count();
                if left == 0 {
                    continue;
                }
                let middle = [n_planes / 2, (from_y + to_y) / 2, (from_z + to_z) / 2];
                let side = if left == nodes().count() {
                    n_asked += 1;
                    self.side_of_block(lattice, from_x, middle, nearest[place(middle)])
                } else {
                    None
                };
                for node @ [x, y, z] in nodes() {
                    let place = place(node);
                    if values_m[place].is_nan() {
                        let sample = nearest[place];
                        let point_map = lattice.position([from_x + x, y, z]);
                        let distance_m =
                            self.points.positions_map[sample as usize].distance(point_map);
                        let is_inside = side.unwrap_or_else(|| {
                            n_asked += 1;
                            self.is_inside(sample, point_map)
                        });
                        values_m[place] = if is_inside { distance_m } else { -distance_m } as f32;
                    }
                }
            }
        }
        n_asked
    }

    /// The side of all nodes of a block, where that is certain from its middle.
    fn side_of_block(
        &self,
        lattice: &Lattice,
        from_x: usize,
        [x, y, z]: [usize; 3],
        nearest: u32,
    ) -> Option<bool> {
        let middle_map = lattice.position([from_x + x, y, z]);
        let (position_map, _) = self.oriented(nearest);
        let radius_m = BLOCK as f64 * 3.0_f64.sqrt() / 2.0 * lattice.spacing_m;
        let is_far = middle_map.distance(position_map) > 2.0 * radius_m;
        if is_far { self.side.of_ball(&self.near, middle_map) } else { None }
    }
}

/// Nodes along an axis whose coordinate lies between two, m: the first, and one past the last.
fn nodes_within(lattice: &Lattice, axis: usize, low_map: f64, high_map: f64) -> (usize, usize) {
    let node = |at: f64| (at - lattice.origin_map[axis]) / lattice.spacing_m;
    let from = node(low_map).ceil().max(0.0) as usize;
    let to = (node(high_map).floor() + 1.0).max(0.0) as usize;
    let to = to.min(lattice.dims[axis]);
    (from.min(to), to)
}
