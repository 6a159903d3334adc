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
//! directions fixed in the tool and sums by block are ours.

use glam::Vec3;

use super::contact_block::{ContactBlock, lanes_of};
use crate::pointshell::shell::{LANES, Lanes3, Shell};

/// Of the length of a normal: less does not decide which direction is nearer.
const ALIKE: f32 = 1e-4;

/// Directions that are distinguished: to the faces, edges and corners of a cube.
pub const FACES: usize = 26;

/// The faces of the points of a block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct BlockFaces {
    of_lanes: [u8; LANES],
}

impl BlockFaces {
    /// Of each block of a shell. Cold.
    pub(super) fn of(shell: &Shell, block: usize) -> Self {
        let Some(normals) = shell.normals().get(block) else {
            return Self { of_lanes: [0; LANES] };
        };
        if shell.half_axes().is_empty() {
            return Self { of_lanes: [face_of(normals); LANES] };
        }
        let of_lanes = core::array::from_fn(|lane| {
            let normal = normals.get(lane);
            // Lanes beyond the last point hold NaN.
            nearest_face(if normal.is_nan() { Vec3::ZERO } else { normal })
        });
        Self { of_lanes }
    }

    /// The face that all of these lanes belong to; `None` of several. RT: safe.
    #[inline]
    pub(super) fn only(&self, lanes: u16) -> Option<u8> {
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

/// Number of the face that a block of normals belongs to: the direction nearest to their mean. RT:
/// safe; 26 products.
pub fn face_of(normals: &Lanes3) -> u8 {
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
    use super::*;

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
