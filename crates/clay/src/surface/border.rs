//! Where the samples end: holes of a scan, the rim of a sheet.

use std::f64::consts::TAU;

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::PointSurface;

/// Neighbours up to this distance surround a sample, in spacings.
const AROUND_SPACINGS: f64 = 2.2;
/// A sample without neighbours over such an angle is at a border: at a straight one it is half a
/// turn.
const GAP: f64 = 0.37 * TAU;

impl PointSurface {
    /// Samples at the border of what was sampled, in ascending order. The field goes on there, as a
    /// cap of no certain shape over a small hole. Sharp edges are no borders. Parallel; costs about
    /// as much as a tenth of [`Self::build`].
    pub fn border(&self) -> Vec<u32> {
        let samples = (0..self.points.len() as u32).into_par_iter();
        samples
            .map_init(Vec::new, |found, sample| (sample, self.is_border(sample, found)))
            .filter(|(_, is)| *is)
            .map(|(k, _)| k)
            .collect()
    }

    fn is_border(&self, sample: u32, found: &mut Vec<super::Neighbour>) -> bool {
        let (position_map, normal) = self.oriented(sample);
        self.near.within(position_map, AROUND_SPACINGS * self.spacings_m[sample as usize], found);
        found.retain(|other| !self.is_opposite(sample, other.sample));
        // Seen along the mean normal, the other side of a sharp edge lies beside this one.
        let mean: DVec3 = found.iter().map(|other| self.oriented(other.sample).1).sum();
        let (u, v) = mean.try_normalize().unwrap_or(normal).any_orthonormal_pair();
        let on_plane = found.iter().map(|other| {
            let way = self.oriented(other.sample).0 - position_map;
            DVec2::new(way.dot(u), way.dot(v))
        });
        let mut angles: Vec<f64> =
            on_plane.filter(|way| *way != DVec2::ZERO).map(|way| way.to_angle()).collect();
        angles.sort_unstable_by(f64::total_cmp);
        let (Some(first), Some(last)) = (angles.first(), angles.last()) else {
            return true;
        };
        let across = first + TAU - last;
        angles.windows(2).map(|pair| pair[1] - pair[0]).fold(across, f64::max) > GAP
    }
}
