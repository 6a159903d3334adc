//! The samples of a surface.

use glam::DVec3;

use super::SurfaceError;
use vps::spatial::Pose;

/// A part of a surface that ends at sharp edges, as a sharp Boolean leaves it: the field of the
/// surface is put together from those of its patches, in the order of their numbers, as the smaller
/// or the larger of what is there and the patch.
///
/// # Source
/// Guo2004, Boolean operations: "two different patches of an implicit surface".
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, bytemuck::Pod, bytemuck::Zeroable,
)]
#[repr(transparent)]
pub(super) struct Patch(u16);

impl Patch {
    /// The patch after this one; the surface is the smaller field of both (an edge that stands out)
    /// or the larger (a valley). Beyond 2¹⁵ patches the last one grows.
    pub(super) fn next(self, is_smaller: bool) -> Self {
        Self(((self.0 >> 1) + 1).min(u16::MAX >> 1) << 1 | u16::from(is_smaller))
    }

    /// Where this patch meets those before it, the smaller field is the surface's.
    pub(super) fn is_smaller(self) -> bool {
        self.0 & 1 == 1
    }
}

/// Samples of a closed surface, each with its normal and colour. All arrays are of one length.
#[derive(Clone, Debug, Default)]
pub struct PointSet {
    /// `[n]`, map frame, m.
    pub positions_map: Vec<DVec3>,
    /// `[n]`, unit, **out** of the material.
    pub normals_map: Vec<DVec3>,
    /// `[n]`: red, green, blue in sRGB, 0 to 255.
    pub colors: Vec<[u8; 3]>,
    /// Which patch each is of; those beyond its end are of the first one.
    pub(super) patches: Vec<Patch>,
}

impl PartialEq for PointSet {
    fn eq(&self, other: &Self) -> bool {
        let are_same = self.positions_map == other.positions_map
            && self.normals_map == other.normals_map
            && self.colors == other.colors;
        // Patches that are left out are the first one.
        are_same
            && (0..self.len().max(other.len()) as u32)
                .all(|sample| self.patch(sample) == other.patch(sample))
    }
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
            + size_of_val(self.patches.as_slice())
    }

    /// Appends a sample: place (m) and outward unit normal in the map frame, sRGB colour.
    pub fn push(&mut self, position_map: DVec3, normal_map: DVec3, color: [u8; 3]) {
        self.positions_map.push(position_map);
        self.normals_map.push(normal_map);
        self.colors.push(color);
    }

    /// The patch of a sample.
    pub(super) fn patch(&self, sample: u32) -> Patch {
        self.patches.get(sample as usize).copied().unwrap_or_default()
    }

    /// The last patch there is.
    pub(super) fn last_patch(&self) -> Patch {
        self.patches.iter().copied().max().unwrap_or_default()
    }

    /// Says of which patch a sample is.
    pub(super) fn set_patch(&mut self, sample: u32, patch: Patch) {
        if patch != self.patch(sample) {
            self.patches.resize(self.len(), Patch::default());
            self.patches[sample as usize] = patch;
        }
    }

    /// The samples of another set behind these.
    pub(super) fn append(&mut self, other: &Self) {
        if !other.patches.is_empty() {
            self.patches.resize(self.len(), Patch::default());
            self.patches.extend_from_slice(&other.patches);
        }
        self.positions_map.extend_from_slice(&other.positions_map);
        self.normals_map.extend_from_slice(&other.normals_map);
        self.colors.extend_from_slice(&other.colors);
    }

    /// The samples with these numbers, in this order. Panics on a number that is not there.
    pub(super) fn select(&self, samples: impl Iterator<Item = u32> + Clone) -> Self {
        Self {
            positions_map: samples
                .clone()
                .map(|sample| self.positions_map[sample as usize])
                .collect(),
            normals_map: samples.clone().map(|sample| self.normals_map[sample as usize]).collect(),
            colors: samples.clone().map(|sample| self.colors[sample as usize]).collect(),
            patches: if self.patches.is_empty() {
                Vec::new()
            } else {
                samples.map(|sample| self.patch(sample)).collect()
            },
        }
    }

    /// The samples where a body stands of which these are in its own frame.
    pub fn placed(&self, map_from_body: &Pose) -> Self {
        Self {
            positions_map: self
                .positions_map
                .iter()
                .map(|at| map_from_body.transform_point(*at))
                .collect(),
            normals_map: self
                .normals_map
                .iter()
                .map(|normal| map_from_body.transform_vector(*normal).normalize_or_zero())
                .collect(),
            colors: self.colors.clone(),
            patches: self.patches.clone(),
        }
    }

    /// The same, stretched along x, y and z. Factors are above 0.
    pub(super) fn scaled(mut self, factors: DVec3) -> Self {
        self.positions_map.iter_mut().for_each(|at| *at *= factors);
        self.normals_map
            .iter_mut()
            .for_each(|normal| *normal = (*normal / factors).normalize_or_zero());
        self
    }

    /// Lowest and highest corner of the box around the samples, map frame, m; `None` when there are
    /// none.
    pub fn bounds(&self) -> Option<(DVec3, DVec3)> {
        let first = *self.positions_map.first()?;
        Some(
            self.positions_map
                .iter()
                .fold((first, first), |(low, high), at| (low.min(*at), high.max(*at))),
        )
    }

    /// Whether a surface can be made of these samples, as far as each of them shows by itself.
    ///
    /// # Errors
    /// [`SurfaceError`], naming the first sample that is wrong.
    pub(super) fn check(&self) -> Result<(), SurfaceError> {
        let positions = self.len();
        let normals = self.normals_map.len();
        let colors = self.colors.len();
        if normals != positions || colors != positions {
            return Err(SurfaceError::UnequalArrays { positions, normals, colors });
        }
        if positions < Self::LEAST {
            return Err(SurfaceError::TooFew { found: positions });
        }
        let mut samples = self.positions_map.iter().zip(&self.normals_map).enumerate();
        samples.try_for_each(|(sample, (position_map, normal_map))| {
            Self::check_sample(sample, *position_map, *normal_map)
        })
    }

    /// The same for one sample.
    pub(super) fn check_sample(
        sample: usize,
        position_map: DVec3,
        normal_map: DVec3,
    ) -> Result<(), SurfaceError> {
        if !position_map.is_finite() {
            return Err(SurfaceError::NonFinite { sample, position_map });
        }
        // False for NaN as well.
        let is_unit = (normal_map.length_squared() - 1.0).abs() <= Self::UNIT_TOLERANCE;
        if is_unit { Ok(()) } else { Err(SurfaceError::BadNormal { sample, normal_map }) }
    }
}
