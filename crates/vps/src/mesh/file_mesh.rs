//! What a reader gives: a mesh, and what a user should know of its file.

use glam::DVec3;

use super::TriangleMesh;
use super::validate::length_text;

/// A mesh as a file has it.
#[derive(Clone, Debug, Default)]
pub struct FileMesh {
    /// Its triangles.
    pub mesh: TriangleMesh,
    /// What the file has and the mesh has not, and what was read otherwise than the file says; a
    /// sentence each, of one line.
    pub notes: Vec<String>,
    /// How coarse its coordinates are; `None` where they are decimal, whole, or of 64 bits.
    pub rounding: Option<Rounding>,
}

impl From<TriangleMesh> for FileMesh {
    fn from(mesh: TriangleMesh) -> Self {
        Self { mesh, ..Self::default() }
    }
}

/// How coarse coordinates of 32 bits are where they are farthest from the origin of their file.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Rounding {
    /// Largest coordinate, m.
    pub distance_m: f64,
    /// From there to the next number, m.
    pub step_m: f64,
}

impl Rounding {
    /// Of numbers that had 32 bits in the file.
    pub(super) fn of_f32(numbers: &[f64]) -> Self {
        let distance_m = numbers.iter().fold(0.0, |largest: f64, number| largest.max(number.abs()));
        let largest = distance_m as f32;
        Self { distance_m, step_m: f64::from(largest.next_up()) - f64::from(largest) }
    }

    /// Of vertices.
    pub(super) fn of_f32_vertices(vertices: &[DVec3]) -> Self {
        let corner = vertices.iter().fold(DVec3::ZERO, |corner, vertex| corner.max(vertex.abs()));
        Self::of_f32(&corner.to_array())
    }

    /// The same in another unit.
    #[must_use]
    pub(super) fn scaled(self, scale: f64) -> Self {
        Self { distance_m: self.distance_m * scale, step_m: self.step_m * scale }
    }

    #[cfg(feature = "gltf")]
    pub(super) fn coarser(before: Option<Self>, other: Self) -> Option<Self> {
        Some(before.filter(|before| before.step_m >= other.step_m).unwrap_or(other))
    }

    /// What to say where voxels have this edge, m: a surface that is a tenth of a voxel off is felt
    /// as a step.
    pub fn warning(self, voxel_size_m: f64) -> Option<String> {
        let Self { distance_m, step_m } = self;
        (step_m > 0.1 * voxel_size_m).then(|| {
            let [distance, step, voxel] = [distance_m, step_m, voxel_size_m].map(length_text);
            format!(
                "its coordinates reach {distance} from the origin of the file, where numbers of 32 \
                    bits are {step} apart, more than a tenth of a voxel of {voxel}: move the part \
                    to the origin before it is exported"
            )
        })
    }
}

/// Things by their names, for a sentence; a file may have thousands.
#[cfg(any(feature = "gltf", feature = "threemf"))]
pub(super) fn listed(names: &[String]) -> String {
    const MOST_NAMED: usize = 6;
    let named = names[..names.len().min(MOST_NAMED)].join(", ");
    match names.len().saturating_sub(MOST_NAMED) {
        0 => named,
        more => format!("{named} and {more} more"),
    }
}
