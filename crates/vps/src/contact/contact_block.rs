//! What a traversal hands to the contact model: the blocks of the shell that touch, and how deep.
//!
//! A contact model reads them as they are, sixteen lanes at a time, or one [`Contact`] after the
//! other; how they were found is not its concern.

use glam::{Vec2, Vec3};

use super::clip::{CreasesAt, OverPlanes, Pressed};
use super::immersion::FacetRange;
use super::kernel::Place;
use crate::pointshell::shell::{LANES, Lanes, Lanes3, Shell};
use crate::spatial::Pose;
use crate::voxmap::field::Field;

/// One point or facet in contact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contact {
    /// Number of the point in the shell.
    pub point_idx: u32,
    /// V at the point, m, greater than 0; of a facet whose centroid is outside, that at its deepest
    /// place.
    pub depth_m: f32,
    /// Mean over the facet of how deep it is immersed, m, which is what its force counts; of a
    /// point and of a facet that is immersed as a whole `depth_m`.
    pub mean_depth_m: f32,
    /// It is a facet whose centroid is outside.
    pub is_in_part: bool,
    /// Surface that it stands for, s²; with a budget that of others as well, of a probe on an edge
    /// or a corner of the tool 0.
    pub weight: f32,
    /// Where it is that deep, about the centre of mass, tool axes, m.
    pub arm_body: Vec3,
    /// Where its force acts: there, or of a facet that is immersed in part the middle of what
    /// presses, about the centre of mass, tool axes, m.
    pub pressed_body: Vec3,
    /// Unit direction that pushes the tool out, tool axes: the point's normal, or −grad V of a
    /// probe, of a point without a normal, and where the obstacle is a thin skin.
    pub normal_body: Vec3,
    /// Unit −grad V there, tool axes: the obstacle's own way out; zero where it is not known.
    pub way_out_body: Vec3,
}

impl Contact {
    /// How deep the point is, m, or the facet in the mean where that is more or its centroid is
    /// outside: what `ContactSum::max_value_m` is the most of. The deepest place of a facet may lie
    /// beyond the surface that it stands for, whose edges and corners probes note.
    pub fn noted_depth_m(&self) -> f32 {
        let point_m = if self.is_in_part { 0.0 } else { self.depth_m };
        point_m.max(self.mean_depth_m)
    }

    /// Of a point without extent that stands for one s².
    pub fn of_point(point_idx: u32, depth_m: f32, arm_body: Vec3, normal_body: Vec3) -> Self {
        Self {
            point_idx,
            depth_m,
            mean_depth_m: depth_m,
            is_in_part: false,
            weight: 1.0,
            arm_body,
            pressed_body: arm_body,
            normal_body,
            way_out_body: normal_body,
        }
    }
}

/// A block of the shell with points in contact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContactBlock {
    /// Number of the block.
    pub block: u32,
    /// One bit per lane in contact; never 0.
    pub lanes: u16,
    /// Those of them whose facets lie over an edge of the obstacle: its planes say how deep they are,
    /// not what stands here of them.
    pub clipped: u16,
    /// What of the surface each of them stands for counts; with a budget points stand for others as
    /// well.
    pub weight: f32,
    /// The depth ranges by no more than this over a facet to both sides of its centroid, m.
    pub limit_m: f32,
    /// V, m, in these lanes greater than 0, or of a facet greater than minus what the depth ranges
    /// by over it.
    pub depths_m: [f32; LANES],
    /// Gradient of V in these lanes, m/m, tool axes; zero where it is not known.
    pub gradients: Lanes3,
    /// By how much less deep the two ends of a facet are than its gradient says, m, at most 0: see
    /// `immersion`.
    pub shortfalls_m: [Lanes; 2],
}

impl ContactBlock {
    /// Nothing of the first block touches.
    pub(super) const NONE: Self = Self {
        block: 0,
        lanes: 0,
        clipped: 0,
        weight: 1.0,
        limit_m: 0.0,
        depths_m: [0.0; LANES],
        gradients: Lanes3::ZERO,
        shortfalls_m: [Lanes([0.0; LANES]); 2],
    };

    /// What touches in these lanes.
    #[inline]
    pub(super) fn within(&self, lanes: u16) -> Self {
        Self { lanes: self.lanes & lanes, clipped: self.clipped & lanes, ..*self }
    }

    /// Lanes in contact, rising.
    #[inline]
    pub fn lanes(&self) -> impl Iterator<Item = usize> + use<> {
        lanes_of(self.lanes)
    }

    #[inline]
    pub(super) fn set_shortfalls(&mut self, lane: usize, shortfalls_m: [f32; 2]) {
        for (of, shortfall_m) in self.shortfalls_m.iter_mut().zip(shortfalls_m) {
            if let Some(of_lane) = of.0.get_mut(lane) {
                *of_lane = shortfall_m;
            }
        }
    }

    /// V in a lane, m, and how it ranges over the facet.
    #[inline]
    fn depth_and_range(&self, shell: &Shell, lane: usize) -> (f32, FacetRange) {
        let half_axes = shell.half_axes().get(self.block as usize);
        let half_axes = half_axes.map(|[a, b]| [a.get(lane), b.get(lane)]);
        let depth_m = self.depths_m.get(lane).copied().unwrap_or(0.0);
        let shortfalls_m = self.shortfalls_m.map(|of| of.0.get(lane).copied().unwrap_or(0.0));
        let range = FacetRange::of(half_axes, self.gradients.get(lane), self.limit_m);
        (depth_m, range.with_shortfalls(shortfalls_m))
    }

    /// What the planes of an obstacle's edges press on a lane, and its half axes; `None` where it
    /// does not lie over an edge.
    #[inline]
    fn pressed(
        &self,
        shell: &Shell,
        at: &CreasesAt<'_>,
        lane: usize,
    ) -> Option<(Pressed, [Vec3; 2])> {
        if self.clipped >> lane & 1 == 0 {
            return None;
        }
        let block = self.block as usize;
        let middle = shell.positions().get(block)?.get(lane);
        let half_axes = shell.half_axes().get(block)?.each_ref().map(|axis| axis.get(lane));
        let mut over = OverPlanes::NONE;
        at.over(middle, half_axes, &mut over).then(|| (over.pressed(), half_axes))
    }

    /// The sum of how deep the lanes in contact are immersed in the mean, each by its weight, m.
    #[inline]
    pub(super) fn depth_m(&self, shell: &Shell, at: &CreasesAt<'_>) -> f64 {
        let weighted = |lane: usize| {
            let mean_depth_m = match self.pressed(shell, at, lane) {
                Some((pressed, _)) => pressed.mean_depth_m,
                None => {
                    let (depth_m, range) = self.depth_and_range(shell, lane);
                    range.mean_depth_m(depth_m)
                }
            };
            f64::from(mean_depth_m * self.weight_of(shell, lane))
        };
        self.lanes().map(weighted).sum()
    }

    /// Surface that a lane stands for, s².
    #[inline]
    pub(super) fn weight_of(&self, shell: &Shell, lane: usize) -> f32 {
        let weights = shell.weights().get(self.block as usize);
        self.weight * weights.and_then(|weights| weights.0.get(lane)).copied().unwrap_or(0.0)
    }

    /// Unit −grad V in a lane in contact, tool axes; `None` where it vanishes or is not known.
    #[inline]
    pub(super) fn way_out(&self, lane: usize) -> Option<Vec3> {
        (-self.gradients.get(lane)).try_normalize()
    }

    /// Reports each lane in contact with this field, found with the tool at this pose.
    #[inline]
    pub fn contacts(
        &self,
        field: &Field,
        shell: &Shell,
        map_from_body: Pose,
        mut touch: impl FnMut(&Contact),
    ) {
        let place = (self.clipped != 0).then(|| Place::new(field, map_from_body));
        let creases = place.as_ref().map(|place| CreasesAt::new(field, place));
        let block = self.block as usize;
        let (Some(positions), Some(normals)) =
            (shell.positions().get(block), shell.normals().get(block))
        else {
            return;
        };
        for lane in self.lanes() {
            let (depth_m, range) = self.depth_and_range(shell, lane);
            let (deepest_m, there) = range.depth_there(depth_m);
            let position = positions.get(lane);
            let weight = self.weight_of(shell, lane);
            let normal = normals.get(lane);
            let way_out = self.way_out(lane);
            // Neither a skin nor an edge has a direction of its own.
            let bends = field.is_thin() || weight == 0.0 || normal == Vec3::ZERO;
            let mut contact = Contact {
                point_idx: self.block * LANES as u32 + lane as u32,
                depth_m: deepest_m,
                mean_depth_m: range.mean_depth_m(depth_m),
                is_in_part: depth_m <= 0.0,
                weight,
                arm_body: position + there,
                pressed_body: position + range.lever_m(depth_m),
                normal_body: way_out.filter(|_| bends).unwrap_or(normal),
                way_out_body: way_out.unwrap_or(Vec3::ZERO),
            };
            let pressed = creases.as_ref().and_then(|creases| self.pressed(shell, creases, lane));
            if let Some((pressed, [a, b])) = pressed {
                let on_facet = |at: Vec2| position + a * at.x + b * at.y;
                if depth_m <= 0.0 {
                    contact.depth_m = pressed.deepest_m;
                    contact.arm_body = on_facet(pressed.deepest_at);
                    contact.way_out_body = (-pressed.gradient).normalize_or_zero();
                } else {
                    contact.depth_m = depth_m;
                    contact.arm_body = position;
                }
                contact.mean_depth_m = pressed.mean_depth_m;
                contact.pressed_body = on_facet(pressed.at);
            }
            touch(&contact);
        }
    }
}

/// Numbers of the set bits, rising.
pub(super) fn lanes_of(mut left: u16) -> impl Iterator<Item = usize> {
    core::iter::from_fn(move || {
        let lane = left.trailing_zeros() as usize;
        left &= left.wrapping_sub(1);
        (lane < LANES).then_some(lane)
    })
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::contact::tests::{block, plate};
    use crate::mesh::validate::inspect;
    use crate::pointshell::{Points, build_with};
    use crate::voxmap::inside_test::InsideTest;
    use crate::voxmap::{Options, Volume};

    #[test]
    fn contacts_are_the_points_of_the_lanes_with_their_depths_and_what_they_stand_for() {
        let points: [(DVec3, DVec3); 40] =
            core::array::from_fn(|n| (DVec3::X * (n as f64 * 1e-3), DVec3::Z));
        let mut gradients = Lanes3::ZERO;
        gradients.set(3, Vec3::NEG_Y * 0.75);
        let touched = ContactBlock {
            block: 2,
            lanes: 0b10_1000,
            weight: 3.0,
            limit_m: 1e-3,
            depths_m: core::array::from_fn(|lane| 1e-4 * lane as f32),
            gradients,
            ..ContactBlock::NONE
        };
        let mut contacts = Vec::new();
        touched.contacts(&plate().field, &Shell::new(&points, 1e-3), Pose::IDENTITY, |contact| {
            contacts.push(*contact)
        });
        // Lanes 3 and 5 of block 2 are points 2 · 16 + 3 and 2 · 16 + 5, of one s² each.
        let ways = [(3_u8, 35, Vec3::Y), (5, 37, Vec3::ZERO)];
        let expected = ways.map(|(lane, point_idx, way_out_body)| {
            let arm_body = (DVec3::X * (f64::from(point_idx) * 1e-3)).as_vec3();
            let contact = Contact::of_point(point_idx, 1e-4 * f32::from(lane), arm_body, Vec3::Z);
            Contact { weight: 3.0, way_out_body, ..contact }
        });
        assert_eq!(contacts, expected);
    }

    /// Upright facets of a cube, half of each in a wall below, and the probes on its edges.
    #[test]
    fn a_facet_in_part_is_as_deep_as_its_deepest_place_and_presses_where_it_is_immersed() {
        let (mesh, map) = block(DVec3::splat(0.02), 1e-3);
        let shell = build_with(Points::Facets, &mesh, &map, DVec3::ZERO).0;
        let field = plate().field;
        let mut n_facets = 0;
        let mut n_probes = 0;
        for (block, positions) in (0..).zip(shell.positions()) {
            let mut gradients = Lanes3::ZERO;
            (0..LANES).for_each(|lane| gradients.set(lane, Vec3::NEG_Z));
            let touched = ContactBlock {
                block,
                lanes: u16::MAX,
                limit_m: 1e-3,
                gradients,
                ..ContactBlock::NONE
            };
            touched.contacts(&field, &shell, Pose::IDENTITY, |contact| {
                let lane = contact.point_idx as usize % LANES;
                let normals = &shell.normals()[block as usize];
                let place = positions.get(lane);
                if place.is_nan() {
                    return;
                }
                if contact.weight == 0.0 {
                    assert_eq!((contact.depth_m, contact.arm_body), (0.0, place));
                    assert!((contact.normal_body - Vec3::Z).length() < 1e-6, "{contact:?}");
                    n_probes += 1;
                    return;
                }
                assert_eq!(contact.normal_body, normals.get(lane));
                if normals.get(lane).z.abs() < 0.01 {
                    // Of a rectangle that is half immersed with a side along the surface: h deep
                    // below its middle, a quarter of that in the mean, two thirds of h down.
                    let half_m = contact.depth_m;
                    assert!((contact.arm_body - place + Vec3::Z * half_m).length() < 1e-4 * half_m);
                    assert!((contact.mean_depth_m - 0.25 * half_m).abs() < 1e-4 * half_m);
                    let lever = contact.pressed_body - place;
                    assert!(
                        (lever + Vec3::Z * (half_m * 2.0 / 3.0)).length() < 1e-3 * half_m,
                        "{lever} of {half_m}"
                    );
                    n_facets += 1;
                }
            });
        }
        assert!(n_facets > 1000 && n_probes > 100, "{n_facets} {n_probes}");
    }

    #[test]
    fn a_point_at_a_skin_or_of_one_pushes_along_the_gradient() {
        let (mesh, _) = block(DVec3::splat(0.02), 1e-3);
        let options = Options { sides: InsideTest::Thin, ..Options::new(1e-3) };
        let mut map =
            Volume::build(&mesh, &inspect(&mesh), &options, |_| ()).expect("a small grid");
        let skin = map.field(&mesh, false);
        let solid = plate().field;
        let askew = DVec3::new(0.6, 0.0, 0.8);
        for (field, normal, expected) in [
            (&skin, askew, Vec3::Z),
            (&solid, DVec3::ZERO, Vec3::Z),
            (&skin, DVec3::ZERO, Vec3::Z),
            (&solid, askew, askew.as_vec3()),
        ] {
            let shell = Shell::new(&[(DVec3::ZERO, normal)], 1e-3);
            let mut touched = ContactBlock {
                lanes: 1,
                limit_m: 1e-3,
                depths_m: [1e-4; LANES],
                ..ContactBlock::NONE
            };
            // Where no way out is known, along its own normal.
            touched.contacts(field, &shell, Pose::IDENTITY, |contact| {
                assert_eq!(contact.normal_body, normal.as_vec3());
            });
            touched.gradients.set(0, Vec3::NEG_Z * 2.0);
            touched.contacts(field, &shell, Pose::IDENTITY, |contact| {
                assert!((contact.normal_body - expected).length() < 1e-6, "{contact:?}");
            });
        }
    }
}
