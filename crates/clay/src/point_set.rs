//! The samples of a surface.

use glam::DVec3;

use super::SurfaceError;
use vps::spatial::Pose;

/// Samples of a closed surface, each with its normal and colour. All arrays are of one length.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PointSet {
    /// `[n]`, map frame, m.
    pub positions_map: Vec<DVec3>,
    /// `[n]`, unit, **out** of the material.
    pub normals_map: Vec<DVec3>,
    /// `[n]`: red, green, blue in sRGB, 0 to 255.
    pub colors: Vec<[u8; 3]>,
}

impl PointSet {
    /// Fewest samples that can go around a body.
    pub const LEAST: usize = 32;
    /// How far the length of a normal may be from 1.
    const UNIT_TOLERANCE: f64 = 1e-6;

    /// Number of samples.
    pub fn len(&self) -> usize {
        self.positions_map.len()
    }

    /// True when it holds no sample.
    pub fn is_empty(&self) -> bool {
        self.positions_map.is_empty()
    }

    /// What the samples take in memory, bytes.
    pub(super) fn n_bytes(&self) -> usize {
        self.len() * (2 * size_of::<DVec3>() + size_of::<[u8; 3]>())
    }

    /// Appends a sample: place (m) and outward unit normal in the map frame, sRGB colour.
    pub fn push(&mut self, position_map: DVec3, normal_map: DVec3, color: [u8; 3]) {
        self.positions_map.push(position_map);
        self.normals_map.push(normal_map);
        self.colors.push(color);
    }

    /// The samples of another set behind these.
    pub(super) fn append(&mut self, other: &Self) {
        self.positions_map.extend_from_slice(&other.positions_map);
        self.normals_map.extend_from_slice(&other.normals_map);
        self.colors.extend_from_slice(&other.colors);
    }

    /// The samples with these numbers, in this order. Panics on a number that is not there.
    pub(super) fn select(&self, samples: impl Iterator<Item = u32> + Clone) -> Self {
        Self {
            positions_map: samples.clone().map(|sample| self.positions_map[sample as usize]).collect(),
            normals_map: samples.clone().map(|sample| self.normals_map[sample as usize]).collect(),
            colors: samples.map(|sample| self.colors[sample as usize]).collect(),
        }
    }

    /// The samples where a body stands of which these are in its own frame.
    pub fn placed(&self, map_from_body: &Pose) -> Self {
        Self {
            positions_map: self.positions_map.iter().map(|at| map_from_body.transform_point(*at)).collect(),
            normals_map: self
                .normals_map
                .iter()
                .map(|normal| map_from_body.transform_vector(*normal).normalize_or_zero())
                .collect(),
            colors: self.colors.clone(),
        }
    }

    /// Lowest and highest corner of the box around the samples, map frame, m; `None` when there are none.
    pub fn bounds(&self) -> Option<(DVec3, DVec3)> {
        let first = *self.positions_map.first()?;
        Some(self.positions_map.iter().fold((first, first), |(low, high), at| (low.min(*at), high.max(*at))))
    }

    /// Whether a surface can be made of these samples, as far as each of them shows by itself.
    ///
    /// # Errors
    /// [`SurfaceError`], naming the first sample that is wrong.
    pub(super) fn check(&self) -> Result<(), SurfaceError> {
        let (positions, normals, colors) = (self.len(), self.normals_map.len(), self.colors.len());
        if normals != positions || colors != positions {
            return Err(SurfaceError::UnequalArrays { positions, normals, colors });
        }
        if positions < Self::LEAST {
            return Err(SurfaceError::TooFew { found: positions });
        }
        let mut samples = self.positions_map.iter().zip(&self.normals_map).enumerate();
        samples.try_for_each(|(sample, (position_map, normal_map))| Self::check_sample(sample, *position_map, *normal_map))
    }

    /// The same for one sample.
    pub(super) fn check_sample(sample: usize, position_map: DVec3, normal_map: DVec3) -> Result<(), SurfaceError> {
        if !position_map.is_finite() {
            return Err(SurfaceError::NonFinite { sample, position_map });
        }
        // False for NaN as well.
        let is_unit = (normal_map.length_squared() - 1.0).abs() <= Self::UNIT_TOLERANCE;
        if is_unit { Ok(()) } else { Err(SurfaceError::BadNormal { sample, normal_map }) }
    }
}
