//! The samples of a surface.

use glam::DVec3;

/// Samples of a closed surface, each with its normal and colour. All arrays are of one length.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PointSet {
    /// `[n]`, map frame, m.
    pub positions_map: Vec<DVec3>,
    /// `[n]`, unit, **out** of the material.
    pub normals_map: Vec<DVec3>,
    /// `[n]`, sRGB.
    pub colors: Vec<[u8; 3]>,
}

impl PointSet {
    /// Number of samples.
    pub fn len(&self) -> usize {
        self.positions_map.len()
    }

    /// There are none.
    pub fn is_empty(&self) -> bool {
        self.positions_map.is_empty()
    }
}
