//! Points side by side, as SIMD reads them.

use bytemuck::{Pod, Zeroable};
use glam::Vec3;

use crate::simd;

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
    pub(crate) const ZERO: Self = {
        let zero = Lanes([0.0; LANES]);
        Self { x: zero, y: zero, z: zero }
    };

    /// Begins to bring the block into the first cache.
    #[inline(always)]
    pub(crate) fn prefetch(&self) {
        simd::prefetch(&self.x.0);
        simd::prefetch(&self.y.0);
        simd::prefetch(&self.z.0);
    }

    /// The vector in one lane; NaN beyond the block.
    #[inline]
    pub fn get(&self, lane: usize) -> Vec3 {
        let at = |lanes: &Lanes| lanes.0.get(lane).copied().unwrap_or(f32::NAN);
        Vec3::new(at(&self.x), at(&self.y), at(&self.z))
    }

    /// Replaces the vector in one lane; does nothing beyond the block.
    #[inline]
    pub fn set(&mut self, lane: usize, vector: Vec3) {
        for (lanes, coordinate) in
            [&mut self.x, &mut self.y, &mut self.z].into_iter().zip(vector.to_array())
        {
            if let Some(place) = lanes.0.get_mut(lane) {
                *place = coordinate;
            }
        }
    }
}
