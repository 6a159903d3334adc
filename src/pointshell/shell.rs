//! The pointshell as the tick reads it.

mod file;

use bytemuck::{Pod, Zeroable};
use glam::{DVec3, Vec3};

use crate::storage::Slab;

/// Points in one block: two AVX2 registers, one AVX-512 register, one cache line of `f32`.
pub const LANES: usize = 16;

/// One coordinate of [`LANES`] points.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C, align(64))]
pub struct Lanes(pub [f32; LANES]);

/// Three coordinates of [`LANES`] points.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C, align(64))]
pub struct Lanes3 {
    /// x of each lane.
    pub x: Lanes,
    /// y of each lane.
    pub y: Lanes,
    /// z of each lane.
    pub z: Lanes,
}

impl Lanes3 {
    /// The vector in one lane; NaN beyond the block.
    #[inline]
    pub fn get(&self, lane: usize) -> Vec3 {
        let at = |lanes: &Lanes| lanes.0.get(lane).copied().unwrap_or(f32::NAN);
        Vec3::new(at(&self.x), at(&self.y), at(&self.z))
    }
}

/// Points and normals of the tool.
///
/// Frame: tool axes, origin at the **centre of mass**, so that an arm r_i is the point itself. Units: m.
#[derive(Debug)]
pub struct Shell {
    /// `[n_points / 16, rounded up]`, 64-byte aligned: positions, m. Unused lanes of the last block hold NaN, which is no contact.
    positions: Slab<Lanes3>,
    /// Same layout: unit normals, pointing **into** the tool.
    normals: Slab<Lanes3>,
    n_points: usize,
    radius_m: f64,
    voxel_size_m: f64,
}

impl Shell {
    /// Lays out points (about the centre of mass, m) and inward unit normals. Cold.
    pub fn new(points: &[(DVec3, DVec3)], voxel_size_m: f64) -> Self {
        let blocks = |of: fn(&(DVec3, DVec3)) -> DVec3| {
            let block = |chunk: &[(DVec3, DVec3)]| {
                let lane =
                    |axis: usize| Lanes(core::array::from_fn(|lane| chunk.get(lane).map_or(f32::NAN, |p| of(p)[axis] as f32)));
                Lanes3 { x: lane(0), y: lane(1), z: lane(2) }
            };
            points.chunks(LANES).map(block).collect::<Vec<_>>()
        };
        Self {
            positions: blocks(|point| point.0).into(),
            normals: blocks(|point| point.1).into(),
            n_points: points.len(),
            radius_m: points.iter().map(|point| point.0.length()).fold(0.0, f64::max),
            voxel_size_m,
        }
    }

    /// Blocks of positions and of normals, side by side.
    pub fn blocks(&self) -> impl Iterator<Item = (&Lanes3, &Lanes3)> {
        self.positions.iter().zip(self.normals.iter())
    }

    /// Position (about the centre of mass, m) and inward normal of each point.
    pub fn points(&self) -> impl Iterator<Item = (Vec3, Vec3)> + '_ {
        self.blocks()
            .flat_map(|(positions, normals)| (0..LANES).map(move |lane| (positions.get(lane), normals.get(lane))))
            .take(self.n_points)
    }

    /// Points.
    pub fn len(&self) -> usize {
        self.n_points
    }

    /// True when there is no point.
    pub fn is_empty(&self) -> bool {
        self.n_points == 0
    }

    /// r_max, the largest distance of a point from the centre of mass, m.
    pub fn radius_m(&self) -> f64 {
        self.radius_m
    }

    /// Spacing of the points: the voxel edge of the map that they come from, m.
    pub fn voxel_size_m(&self) -> f64 {
        self.voxel_size_m
    }

    /// Size of the arrays, bytes.
    pub fn heap_bytes(&self) -> usize {
        let Self { positions, normals, n_points: _, radius_m: _, voxel_size_m: _ } = self;
        size_of_val(&**positions) + size_of_val(&**normals)
    }
}
