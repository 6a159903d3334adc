//! On which side of the surface a point far from the samples lies.
//!
//! The samples with their normals and areas are dipoles, whose sum is the winding number: 1 inside
//! a closed surface, 0 outside. Far groups of samples count as one dipole. Unlike the tangent plane
//! of the nearest sample it is right beyond sharp edges and thin walls, and it closes small holes.
//! Only where samples do not go around a body at all (a single sheet) that plane decides.
//!
//! Cost: a look-up takes about a microsecond.
//!
//! # Source
//! Ours here; the sum over a tree is that of Barill et al. 2018, "Fast winding numbers for soups
//! and clouds". Guo2004 gives no sign beyond the shell.

use std::f64::consts::PI;

use glam::DVec3;

use crate::neighbours::Neighbours;

/// Groups count as one dipole from this many of their radii on.
const FAR_RADII: f64 = 2.0;
/// Winding number above which a point is inside.
const INSIDE: f64 = 0.5;
/// Winding numbers in the middle of a ball that leave open on which side all of it is.
const UNSURE: std::ops::Range<f64> = 0.2..0.8;
/// Winding number just below the samples of a closed surface: it would be 1, and is 1/2 below a
/// large sheet.
const CLOSED: f64 = 0.65;
/// How many samples are asked whether the surface is closed.
const ASKED: usize = 256;

#[derive(Clone, Copy, Debug, Default)]
struct Dipole {
    center_map: DVec3,
    /// Σ area · normal, m².
    moment: DVec3,
    /// Squared distance from which on the group counts as one, m².
    far_m2: f64,
}

/// Dipoles of all groups of samples.
#[derive(Clone, Debug, Default)]
pub(super) struct DipoleTree {
    /// One for each node of the tree.
    groups: Vec<Dipole>,
    /// `[n]`, area · normal, m², in the order of the leaves.
    moments: Vec<DVec3>,
    is_closed: bool,
}

impl DipoleTree {
    /// `areas_m2` and `normals` are in the order of the samples.
    pub(super) fn new(near: &Neighbours, normals: &[DVec3], areas_m2: &[f64]) -> Self {
        let moments: Vec<DVec3> = near
            .samples()
            .iter()
            .map(|sample| normals[*sample as usize] * areas_m2[*sample as usize])
            .collect();
        let mut groups = vec![Dipole::default(); near.n_nodes()];
        near.for_each_node(|node, range, low, high| {
            let weights = moments[range.clone()].iter().map(|moment| moment.length());
            let weight: f64 = weights.clone().sum();
            let sum: DVec3 = near.positions()[range.clone()]
                .iter()
                .zip(weights)
                .map(|(at, weight)| *at * weight)
                .sum();
            let center_map = if weight > 0.0 { sum / weight } else { low };
            let radius_m = (high - center_map).max(center_map - low).length();
            let far_m2 = (FAR_RADII * radius_m).powi(2);
            groups[node] = Dipole { center_map, moment: moments[range].iter().sum(), far_m2 };
        });
        let mut side = Self { groups, moments, is_closed: true };
        // Half of those asked are enough, so that neither holes nor walls thinner than the spacing
        // decide.
        let step = near.samples().len().div_ceil(ASKED).max(1);
        let below = (0..near.samples().len()).step_by(step).map(|place| {
            let sample = near.samples()[place] as usize;
            side.winding(near, near.positions()[place] - normals[sample] * areas_m2[sample].sqrt())
        });
        side.is_closed = super::median(below) > CLOSED;
        side
    }

    /// The samples go around a body.
    pub(super) fn is_closed(&self) -> bool {
        self.is_closed
    }

    /// True inside; `plane_says` decides where the samples go around nothing.
    pub(super) fn is_inside(&self, near: &Neighbours, point_map: DVec3, plane_says: bool) -> bool {
        if self.is_closed { self.winding(near, point_map) > INSIDE } else { plane_says }
    }

    /// On which side all points of a ball are whose nearest sample is far from it: true inside;
    /// `None` where each must be asked.
    pub(super) fn of_ball(&self, near: &Neighbours, center_map: DVec3) -> Option<bool> {
        if !self.is_closed {
            return None;
        }
        // Across a hole the number changes gradually.
        let winding = self.winding(near, center_map);
        (!UNSURE.contains(&winding)).then_some(winding > INSIDE)
    }

    fn winding(&self, near: &Neighbours, point_map: DVec3) -> f64 {
        let of = |moment: DVec3, at: DVec3| {
            let way = at - point_map;
            let squared = way.length_squared();
            if squared > 0.0 { moment.dot(way) / (squared * squared.sqrt()) } else { 0.0 }
        };
        let mut sum = 0.0;
        near.descend(|node, range| {
            let group = &self.groups[node];
            if range.is_empty() {
                return false;
            }
            if (group.center_map - point_map).length_squared() > group.far_m2 {
                sum += of(group.moment, group.center_map);
                return false;
            }
            if near.is_leaf(node) {
                sum += range
                    .map(|place| of(self.moments[place], near.positions()[place]))
                    .sum::<f64>();
            }
            true
        });
        sum / (4.0 * PI)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn spread(n: usize) -> Vec<DVec3> {
        let at = |k: usize| {
            let z = 1.0 - (2 * k + 1) as f64 / n as f64;
            let angle = k as f64 * 2.399_963;
            let radius = (1.0 - z * z).sqrt();
            DVec3::new(radius * angle.cos(), radius * angle.sin(), z)
        };
        (0..n).map(at).collect()
    }

    #[test]
    fn a_ball_with_a_hole_is_closed_and_a_cap_is_not() {
        let all = spread(4000);
        for (lowest, is_closed) in [(-2.0, true), (-0.7, true), (0.6, false)] {
            let kept: Vec<DVec3> = all.iter().copied().filter(|at| at.z > lowest).collect();
            let near = Neighbours::new(&kept);
            let side = DipoleTree::new(&near, &kept, &vec![4.0 * PI / 4000.0; kept.len()]);
            assert_eq!(side.is_closed(), is_closed, "{lowest}");
            if is_closed {
                for at in spread(500) {
                    for (radius, inside) in [
                        (0.0, true),
                        (0.5, true),
                        (0.9, true),
                        (1.1, false),
                        (2.0, false),
                        (50.0, false),
                    ] {
                        if at.z > lowest + 0.3 {
                            assert_eq!(
                                side.is_inside(&near, at * radius, !inside),
                                inside,
                                "{at} {radius}"
                            );
                        }
                    }
                }
            } else {
                assert!(
                    side.is_inside(&near, DVec3::ZERO, true)
                        && !side.is_inside(&near, DVec3::ZERO, false)
                );
            }
        }
    }
}
