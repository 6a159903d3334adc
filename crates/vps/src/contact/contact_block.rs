//! What a traversal hands to the contact model: the blocks of the shell that touch, and how deep.
//!
//! A contact model reads them as they are, sixteen lanes at a time, or one [`Contact`] after the
//! other; how they were found is not its concern.

use glam::{Mat3, Vec3};

use super::kernel::Place;
use crate::pointshell::shell::{LANES, Lanes, Lanes3, Shell};
use crate::spatial::Pose;
use crate::voxmap::field::Field;

/// One point in contact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contact {
    /// Number of the point in the shell.
    pub point_idx: u32,
    /// V at the point, m, greater than 0.
    pub depth_m: f32,
    /// Surface that it stands for, s²; with a budget that of others as well, on an edge of the tool
    /// the share that pushes its way.
    pub weight: f32,
    /// Point about the centre of mass, tool axes, m.
    pub arm_body: Vec3,
    /// Unit direction that pushes the tool out, tool axes: the point's normal, or −grad V where the
    /// point lies on an edge of the tool or the obstacle is a thin skin.
    pub normal_body: Vec3,
}

/// A block of the shell with points in contact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContactBlock {
    /// Number of the block.
    pub block: u32,
    /// One bit per lane in contact; never 0.
    pub lanes: u16,
    /// What of the surface each of them stands for counts; with a budget points stand for others as
    /// well.
    pub weight: f32,
    /// V, m, greater than 0 in these lanes.
    pub depths_m: [f32; LANES],
    /// Gradient of V in these lanes, m/m, tool axes; zero where it is not known.
    pub gradients: Lanes3,
}

impl ContactBlock {
    /// Lanes in contact, rising.
    #[inline]
    pub fn lanes(&self) -> impl Iterator<Item = usize> + use<> {
        lanes_of(self.lanes)
    }

    /// The sum of what the lanes in contact are deep, each by its weight, m.
    #[inline]
    pub(super) fn depth_m(&self, weights: &Lanes) -> f64 {
        let weighted =
            |lane: usize| Some(f64::from(self.depths_m.get(lane)? * weights.0.get(lane)?));
        self.lanes().filter_map(weighted).sum()
    }

    /// Surface that each lane stands for, s².
    #[inline]
    pub(super) fn weights(&self, shell: &Shell) -> Option<Lanes> {
        Some(Lanes(shell.weights().get(self.block as usize)?.0.map(|weight| weight * self.weight)))
    }

    /// Lanes in contact whose own normal does not say which way is out, rising.
    #[inline]
    pub(super) fn bent_lanes(
        &self,
        field: &Field,
        shell: &Shell,
    ) -> impl Iterator<Item = usize> + use<> {
        lanes_of(self.bent(field, shell))
    }

    /// The same, one bit per lane.
    #[inline]
    fn bent(&self, field: &Field, shell: &Shell) -> u16 {
        // A thin skin pushes away from its middle; an edge has no normal of its own, and the mean
        // of those beside it would push along the wall.
        if field.is_thin() {
            return self.lanes;
        }
        let edges = self.lanes & shell.edges().get(self.block as usize).copied().unwrap_or(0);
        if edges == 0 {
            return 0;
        }
        let normals = shell.normals().get(self.block as usize);
        lanes_of(edges).fold(0, |bent, lane| {
            let is_shallow =
                self.depths_m.get(lane).is_some_and(|depth_m| *depth_m < shell.edge_depth_m());
            // A point of a skin has none.
            let has_normal = normals.is_some_and(|normals| normals.get(lane) != Vec3::ZERO);
            bent | u16::from(is_shallow || !has_normal) << lane
        })
    }

    /// True when some direction is not the point's own normal.
    #[inline]
    pub(super) fn bends(&self, field: &Field, shell: &Shell) -> bool {
        self.bent(field, shell) != 0
    }

    /// How the lanes of the block push. `gradient` gives [`Wall::gradient`] at the next of
    /// [`Self::bent_lanes`], where it is.
    #[inline]
    pub(super) fn pushes(
        &self,
        wall: &Wall<'_>,
        shell: &Shell,
        mut gradient: impl FnMut(Vec3) -> Option<Vec3>,
    ) -> Option<ContactDirections> {
        let block = self.block as usize;
        let positions = *shell.positions().get(block)?;
        let normals = *shell.normals().get(block)?;
        let weights = self.weights(shell)?;
        let mut pushes = ContactDirections { positions, normals, areas: weights, weights };
        for lane in self.bent_lanes(wall.field, shell) {
            let depth_m = self.depths_m.get(lane).copied().unwrap_or(0.0);
            let gradient = gradient(positions.get(lane))?;
            let (direction, share) =
                wall.push(gradient, normals.get(lane), depth_m / shell.edge_depth_m());
            pushes.normals.set(lane, direction);
            if let Some(weight) = pushes.weights.0.get_mut(lane) {
                *weight *= share;
            }
        }
        Some(pushes)
    }

    /// Reports each lane in contact.
    #[inline]
    pub fn contacts(
        &self,
        field: &Field,
        shell: &Shell,
        map_from_body: Pose,
        mut touch: impl FnMut(&Contact),
    ) {
        let wall = Wall::new(field, map_from_body);
        let pushes = self.pushes(&wall, shell, |position| Some(wall.gradient(position)));
        let Some(ContactDirections { positions, normals, weights, .. }) = pushes else { return };
        for lane in self.lanes() {
            touch(&Contact {
                point_idx: self.block * LANES as u32 + lane as u32,
                depth_m: self.depths_m.get(lane).copied().unwrap_or(0.0),
                weight: weights.0.get(lane).copied().unwrap_or(0.0),
                arm_body: positions.get(lane),
                normal_body: normals.get(lane).normalize_or_zero(),
            });
        }
    }
}

/// How the sixteen points of a block push.
pub(super) struct ContactDirections {
    /// Tool axes, m.
    pub(super) positions: Lanes3,
    /// Unit directions, tool axes.
    pub(super) normals: Lanes3,
    /// Surface that each stands for, s².
    pub(super) areas: Lanes,
    /// What of it pushes this way.
    pub(super) weights: Lanes,
}

/// 0 to 1 with depth, without a kink at either end.
#[inline]
fn smooth(t: f32) -> f32 {
    let t = t.min(1.0);
    t * t * (3.0 - (t + t))
}

/// Numbers of the set bits, rising.
fn lanes_of(mut left: u16) -> impl Iterator<Item = usize> {
    core::iter::from_fn(move || {
        let lane = left.trailing_zeros() as usize;
        left &= left.wrapping_sub(1);
        (lane < LANES).then_some(lane)
    })
}

/// Which way is out of an obstacle.
pub(super) struct Wall<'a> {
    pub(super) field: &'a Field,
    map_axes: Mat3,
    pub(super) place: Place,
}

impl<'a> Wall<'a> {
    pub(super) fn new(field: &'a Field, map_from_body: Pose) -> Self {
        Self {
            field,
            map_axes: map_from_body.rotation_matrix().as_mat3(),
            place: Place::new(field, map_from_body),
        }
    }

    /// Unit −grad V in tool axes; `None` where it vanishes, as in the middle of a skin.
    pub(super) fn way_out(&self, position: Vec3) -> Option<Vec3> {
        self.against(self.field.gradient(self.place.cells(position)))
    }

    /// What says which way a point without a normal of its own pushes, m/m, map axes: of a skin the
    /// gradient, of a solid its mean over a cell, which does not turn in steps.
    pub(super) fn gradient(&self, position: Vec3) -> Vec3 {
        let cells = self.place.cells(position);
        if self.field.is_thin() {
            self.field.gradient(cells)
        } else {
            self.field.mean_gradient(cells)
        }
    }

    /// Direction and share with which such a point pushes. A skin pushes, and is pushed, along the
    /// way out. So is an edge, with the share that its mean normal has along it: no more than the
    /// faces beside it.
    /// Where there is no way out, the point's own normal.
    fn push(&self, gradient_map: Vec3, normal_body: Vec3, depth: f32) -> (Vec3, f32) {
        let Some(out) = self.against(gradient_map) else { return (normal_body, 1.0) };
        if self.field.is_thin() || normal_body == Vec3::ZERO {
            return (out, 1.0);
        }
        let across = out.dot(normal_body);
        let fading = smooth(depth);
        let push = out * (across * fading + across.max(0.0) * (1.0 - fading))
            + (normal_body - out * across) * fading;
        let share = push.length();
        if share > 0.0 { (push / share, share) } else { (out, 0.0) }
    }

    fn against(&self, gradient_map: Vec3) -> Option<Vec3> {
        (self.map_axes.transpose() * -gradient_map).try_normalize()
    }
}

#[cfg(test)]
mod tests {
    use glam::{DQuat, DVec3};

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
        let touched = ContactBlock {
            block: 2,
            lanes: 0b10_1000,
            weight: 3.0,
            depths_m: core::array::from_fn(|lane| 1e-4 * lane as f32),
            gradients: Lanes3::ZERO,
        };
        let mut contacts = Vec::new();
        touched.contacts(&plate().field, &Shell::new(&points, 1e-3), Pose::IDENTITY, |contact| {
            contacts.push(*contact)
        });
        // Lanes 3 and 5 of block 2 are points 2 · 16 + 3 and 2 · 16 + 5, of one s² each.
        let expected = [(3_u8, 35), (5, 37)].map(|(lane, point_idx)| Contact {
            point_idx,
            depth_m: 1e-4 * f32::from(lane),
            weight: 3.0,
            arm_body: (DVec3::X * (f64::from(point_idx) * 1e-3)).as_vec3(),
            normal_body: Vec3::Z,
        });
        assert_eq!(contacts, expected);
    }

    #[test]
    fn points_on_an_edge_bend_until_they_are_as_deep_as_its_depth_and_no_others_do() {
        let (mesh, map) = block(DVec3::splat(0.02), 1e-3);
        let shell = build_with(Points::Facets, &mesh, &map, DVec3::ZERO).0;
        let field = plate().field;
        // Lanes in turn: half as deep as an edge bends, just as deep, twice as deep.
        const SHALLOW: u16 = 0b1001_0010_0100_1001;
        const TOUCHING: u16 = 0b0101_1010_1111_0011;
        let deep = [0.5, 1.0, 2.0].map(|share| share * shell.edge_depth_m());
        let depths_m = core::array::from_fn(|lane| deep[lane % 3]);
        let mut n_bent = 0;
        for (block, edges) in (0..).zip(shell.edges()) {
            let gradients = Lanes3::ZERO;
            let touched = ContactBlock { block, lanes: TOUCHING, weight: 1.0, depths_m, gradients };
            let expected = TOUCHING & edges & SHALLOW;
            assert_eq!(touched.bent(&field, &shell), expected, "block {block}");
            assert_eq!(touched.bends(&field, &shell), expected != 0, "block {block}");
            n_bent += u32::from(expected != 0);
        }
        assert!((1..shell.edges().len() as u32).contains(&n_bent), "{n_bent}");
    }

    #[test]
    fn an_edge_pushes_out_of_the_wall_and_the_deeper_the_more_along_its_own_normal() {
        let field = plate().field;
        let turn = DQuat::from_scaled_axis(DVec3::new(0.4, -0.9, 0.6));
        let wall = Wall::new(&field, Pose::new(turn, DVec3::ZERO));
        // The way out is z of the tool.
        let gradient_map = (turn * DVec3::NEG_Z * 2.0).as_vec3();
        let outwards = Vec3::new(0.6, 0.0, 0.8);
        let inwards = Vec3::new(0.6, 0.0, -0.8);
        // With f = t² (3 − 2t) at depth t: along the way out what the normal has along it, where
        // that is negative f of it; across f of what it has across. f(1/4) = (3 − 1/2) / 16 = 5/32.
        let f = 5.0 / 32.0;
        for (normal, depth, push) in [
            (outwards, 0.0, Vec3::new(0.0, 0.0, 0.8)),
            (outwards, 0.25, Vec3::new(0.6 * f, 0.0, 0.8)),
            (outwards, 1.0, outwards),
            (outwards, 7.0, outwards),
            (inwards, 0.25, Vec3::new(0.6 * f, 0.0, -0.8 * f)),
            (inwards, 1.0, inwards),
        ] {
            let (direction, share) = wall.push(gradient_map, normal, depth);
            assert!(
                (direction * share - push).length() < 1e-6
                    && (direction.length() - 1.0).abs() < 1e-6,
                "{normal} at {depth}: {direction} {share}"
            );
        }
        // What would push further in has no share, and a direction nevertheless.
        let (direction, share) = wall.push(gradient_map, inwards, 0.0);
        assert!((direction - Vec3::Z).length() < 1e-6 && share == 0.0, "{direction} {share}");
        assert_eq!(wall.push(Vec3::ZERO, inwards, 0.5), (inwards, 1.0));
    }

    #[test]
    fn a_point_at_a_skin_or_of_one_pushes_along_the_gradient_whatever_its_depth() {
        let (mesh, _) = block(DVec3::splat(0.02), 1e-3);
        let options = Options { sides: InsideTest::Thin, ..Options::new(1e-3) };
        let mut map =
            Volume::build(&mesh, &inspect(&mesh), &options, |_| ()).expect("a small grid");
        let skin = map.field(&mesh, false);
        let solid = plate().field;
        let askew = Vec3::new(0.6, 0.0, 0.8);
        for (field, normal) in [(&skin, askew), (&solid, Vec3::ZERO), (&skin, Vec3::ZERO)] {
            let wall = Wall::new(field, Pose::IDENTITY);
            for depth in [0.0, 0.3, 2.0] {
                let (direction, share) = wall.push(Vec3::NEG_Z * 2.0, normal, depth);
                assert!((direction - Vec3::Z).length() < 1e-6 && share == 1.0, "{normal} {depth}");
            }
        }
    }
}
