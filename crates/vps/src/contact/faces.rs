//! Faces of the tool: which way each block of the shell looks.
//!
//! Contacts are summed by face, so that what presses against one wall can be distinguished from
//! what presses against another: its stiffness need not grow with the area that touches, and it has
//! a friction of its own. A point belongs to one face for good, because normals are constants in tool
//! axes; so nothing jumps from one sum to another while the tool moves. Facets have exact normals, and
//! each belongs to the face that it looks like: a wall is one face up to its edges. Normals of
//! voxels are noisy, and a block of sixteen of them belongs to one face.
//!
//! # Source
//! The idea of clusters on the Gauss map is that of XuBarbic2016, known to us by its abstract;
//! directions fixed in the tool and sums by facet are ours.

use glam::Vec3;

use super::contact_block::{ContactBlock, lanes_of};
use crate::pointshell::shell::{LANES, Lanes3, Shell};

/// Of the length of a normal: less does not decide which direction is nearer.
const ALIKE: f32 = 1e-4;

/// Directions that are distinguished: to the faces, edges and corners of a cube.
pub const FACES: usize = 26;

/// The faces of the points of a block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BlockFaces {
    of_lanes: [u8; LANES],
    /// All are of one.
    is_one: bool,
}

impl BlockFaces {
    /// Of each block of a shell. Cold.
    pub fn all_of(shell: &Shell) -> Box<[Self]> {
        shell.normals().iter().map(|normals| Self::of(shell, normals)).collect()
    }

    /// Of a block of these normals.
    pub(super) fn of(shell: &Shell, normals: &Lanes3) -> Self {
        if shell.half_axes().is_empty() {
            return Self::one(face_of(normals));
        }
        let first = nearest_face(normals.get(0));
        let of_lanes = core::array::from_fn(|lane| {
            let normal = normals.get(lane);
            // Lanes beyond the last point hold NaN.
            if normal.is_nan() { first } else { nearest_face(normal) }
        });
        Self { of_lanes, is_one: of_lanes == [first; LANES] }
    }

    /// All of one face.
    pub(super) const fn one(face: u8) -> Self {
        Self { of_lanes: [face; LANES], is_one: true }
    }

    /// The face that all of these lanes belong to; `None` of several. RT: safe.
    #[inline]
    pub(super) fn only(&self, lanes: u16) -> Option<u8> {
        let [first, ..] = self.of_lanes;
        if self.is_one {
            return Some(first);
        }
        let mut faces = lanes_of(lanes).filter_map(|lane| self.of_lanes.get(lane).copied());
        let first = faces.next()?;
        faces.all(|face| face == first).then_some(first)
    }

    /// What touches of a block, by face. RT: safe.
    #[inline]
    pub(super) fn split(&self, touched: &ContactBlock) -> impl Iterator<Item = (u8, ContactBlock)> {
        let of_lanes = self.of_lanes;
        let touched = *touched;
        let mut left = touched.lanes;
        core::iter::from_fn(move || {
            let face = *of_lanes.get(left.trailing_zeros() as usize)?;
            let own = (0..LANES).zip(of_lanes).filter(|(_, of_lane)| *of_lane == face);
            let own = own.fold(0_u16, |own, (lane, _)| own | 1 << lane);
            left &= !own;
            Some((face, touched.within(own)))
        })
    }
}

/// Number of the face that a block of normals belongs to: the direction nearest to their mean.
fn face_of(normals: &Lanes3) -> u8 {
    let mut mean = Vec3::ZERO;
    for lane in 0..LANES {
        let normal = normals.get(lane);
        // Lanes beyond the last point hold NaN.
        if normal.x.abs() <= 2.0 {
            mean += normal;
        }
    }
    nearest_face(mean)
}

/// Of directions that are as near, but for rounding, the first: a flat wall is one face.
fn nearest_face(mean: Vec3) -> u8 {
    let least = ALIKE * mean.length();
    let mut nearest = 0;
    let mut best = f32::NEG_INFINITY;
    let mut face = 0;
    for idx in 0..27_u8 {
        let direction = Vec3::new(
            f32::from(idx / 9) - 1.0,
            f32::from(idx / 3 % 3) - 1.0,
            f32::from(idx % 3) - 1.0,
        );
        if direction == Vec3::ZERO {
            continue;
        }
        let along = mean.dot(direction) / direction.length();
        if along > best + least {
            (nearest, best) = (face, along);
        }
        face += 1;
    }
    nearest
}

#[cfg(test)]
mod tests {
    use glam::{DQuat, DVec3};

    use super::*;
    use crate::mesh::primitives::Shape;
    use crate::mesh::validate::inspect;
    use crate::pointshell::{Points, build_with};
    use crate::spatial::testing::Random;
    use crate::voxmap::{Options, Volume};

    /// The face of a block of so many points.
    fn face_of_some(normals: &[Vec3]) -> u8 {
        let mut lanes = Lanes3 {
            x: crate::pointshell::shell::Lanes([f32::NAN; LANES]),
            ..bytemuck::Zeroable::zeroed()
        };
        for (lane, normal) in normals.iter().enumerate() {
            lanes.set(lane, *normal);
        }
        face_of(&lanes)
    }

    /// As many facets look each way as a wall has, also where a block holds an edge; each lane is of one
    /// face.
    #[test]
    fn a_wall_is_one_face_up_to_its_edges_however_it_lies() {
        let mut random = Random(61);
        for _ in 0..20 {
            let turn = DQuat::from_scaled_axis(random.in_box(-3.0, 3.0));
            let mut mesh = Shape::Box { size_m: DVec3::new(0.012, 0.01, 0.009) }.tessellate(0.0);
            mesh.vertices.iter_mut().for_each(|vertex| *vertex = turn * *vertex);
            let options = Options { layers: 3, ..Options::new(1e-3) };
            let map =
                Volume::build(&mesh, &inspect(&mesh), &options, |_| ()).expect("a small grid");
            let shell = build_with(Points::Facets, &mesh, &map, DVec3::ZERO).0;
            let faces = BlockFaces::all_of(&shell);
            for side in [DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y, DVec3::Z, DVec3::NEG_Z] {
                let inward = (turn * side).as_vec3();
                let mut found = None;
                let mut n_facets = 0;
                for ((block, normals), weights) in (0..).zip(shell.normals()).zip(shell.weights()) {
                    let all = ContactBlock { block, lanes: u16::MAX, ..ContactBlock::NONE };
                    let mut lanes = 0;
                    for (face, own) in faces[block as usize].split(&all) {
                        assert!(
                            own.lanes & lanes == 0
                                && faces[block as usize].only(own.lanes) == Some(face)
                        );
                        lanes |= own.lanes;
                        for lane in own.lanes() {
                            let looks = normals.get(lane).dot(inward) > 0.999;
                            if looks && weights.0[lane] > 0.0 {
                                assert_eq!(*found.get_or_insert(face), face, "{turn}");
                                n_facets += 1;
                            }
                        }
                    }
                    assert_eq!(lanes, u16::MAX);
                }
                assert!(n_facets > 80, "{n_facets}");
            }
        }
    }

    #[test]
    fn blocks_that_look_the_same_way_are_of_one_face_and_walls_of_a_box_are_not() {
        let block = |normal: Vec3| face_of_some(&[normal.normalize(); 5]);
        let mut seen = 0_u32;
        for axis in [Vec3::X, Vec3::Y, Vec3::Z] {
            for side in [axis, -axis] {
                let face = block(side);
                assert!(seen >> face & 1 == 0, "two walls of a box share face {face}");
                seen |= 1 << face;
                for tilt in [Vec3::new(0.1, 0.2, -0.1), Vec3::new(-0.2, 0.05, 0.2)] {
                    assert_eq!(block(side + tilt), face);
                }
            }
        }
        assert!(usize::from(block(Vec3::new(1.0, 1.0, 1.0))) < FACES);
    }

    #[test]
    fn faces_are_counted_from_low_to_high_along_x_then_y_then_z() {
        let mut face = 0;
        for x in [-1.0, 0.0, 1.0] {
            for y in [-1.0, 0.0, 1.0] {
                for z in [-1.0, 0.0, 1.0] {
                    let direction = Vec3::new(x, y, z);
                    if direction != Vec3::ZERO {
                        assert_eq!(face_of_some(&[direction.normalize(); 5]), face, "{direction}");
                        face += 1;
                    }
                }
            }
        }
        assert_eq!(usize::from(face), FACES);
    }

    #[test]
    fn a_block_that_looks_nowhere_is_of_the_first_face() {
        assert_eq!(face_of_some(&[Vec3::X, Vec3::NEG_X]), 0);
    }
}
