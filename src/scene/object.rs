//! One object: from its source to voxmap, field and pointshell.

use std::time::Instant;

use glam::DVec3;
use thiserror::Error;

use super::report::{ObjectReport, Role};
use crate::config::resolve::MeshSource;
use crate::mesh::mass::{MassProperties, mass_properties_of_inspected};
use crate::mesh::validate::{MeshReport, inspect};
use crate::mesh::{self, MeshError, TriangleMesh};
use crate::pointshell::shell::Shell;
use crate::pointshell::{self, ShellReport};
use crate::voxmap::estimate::{Estimate, MeshMeasures, Products, voxel_size_within};
use crate::voxmap::field::Field;
use crate::voxmap::grid::{Grid, GridError};
use crate::voxmap::{Options, Stage, Voxmap};

/// Why an object cannot be built.
#[derive(Debug, Error)]
pub enum SceneError {
    /// Its mesh.
    #[error("{name}: {source}")]
    Mesh {
        /// Object.
        name: String,
        /// Cause.
        source: MeshError,
    },
    /// Its grid.
    #[error("{name}: {source}")]
    Grid {
        /// Object.
        name: String,
        /// Cause.
        source: GridError,
    },
}

impl SceneError {
    /// What to do about it.
    pub fn hint(&self) -> Option<String> {
        match self {
            Self::Mesh { source, .. } => source.hint().map(str::to_owned),
            Self::Grid { source, .. } => Some(source.hint()),
        }
    }
}

/// How much memory baking may take, and who is told how much it will.
pub struct MemoryPlan<'a> {
    /// Most bytes held at a time, by estimate; `None`: no limit.
    max_bytes: Option<u64>,
    /// What the objects done so far keep, by estimate.
    kept_bytes: u64,
    tell: &'a mut dyn FnMut(&str, &Estimate),
}

impl<'a> MemoryPlan<'a> {
    /// A limit, if any, and what to do with each object's name and estimate before its work begins. The peak includes what the
    /// objects before it keep.
    pub fn new(max_bytes: Option<u64>, tell: &'a mut dyn FnMut(&str, &Estimate)) -> Self {
        Self { max_bytes, kept_bytes: 0, tell }
    }
}

/// A tessellation's chord error as a share of the voxel edge, so that the voxel size limits accuracy.
const CHORD_SHARE: f64 = 0.02;

/// An object on its way through the stages.
pub struct Geometry {
    name: String,
    role: Role,
    /// Triangles, m.
    pub mesh: TriangleMesh,
    /// What is wrong with them.
    pub inspected: MeshReport,
    load_s: f64,
}

impl Geometry {
    /// Reads or tessellates an object and inspects it.
    ///
    /// # Errors
    /// A mesh that cannot be used.
    pub fn load(name: &str, role: Role, source: &MeshSource, voxel_size_m: f64) -> Result<Self, SceneError> {
        let since = Instant::now();
        let mesh = match source {
            MeshSource::File { path, metres_per_unit } => {
                mesh::load(path, *metres_per_unit).map_err(|source| SceneError::Mesh { name: name.to_owned(), source })?
            }
            MeshSource::Shape(shape) => shape.tessellate(CHORD_SHARE * voxel_size_m),
        };
        let inspected = inspect(&mesh);
        Ok(Self { name: name.to_owned(), role, mesh, inspected, load_s: since.elapsed().as_secs_f64() })
    }

    /// What baking the object will take; refused where that is more than `memory` allows.
    ///
    /// # Errors
    /// A grid that is too large, or too much memory.
    pub fn foresee(&self, options: &Options, products: Products, memory: &mut MemoryPlan<'_>) -> Result<(), SceneError> {
        let measures = MeshMeasures::of(&self.mesh);
        let (low, high) = measures.bounds_m;
        let grid = |source| SceneError::Grid { name: self.name.clone(), source };
        let around = Grid::around(low, high, options.voxel_size_m, options.layers).map_err(grid)?;
        let mut estimate = Estimate::new(&measures, &around, options.layers, products);
        estimate.peak_bytes += memory.kept_bytes;
        memory.kept_bytes += estimate.kept_bytes;
        (memory.tell)(&self.name, &estimate);
        match memory.max_bytes {
            Some(max_bytes) if estimate.peak_bytes > max_bytes => {
                let kept_bytes = memory.kept_bytes - estimate.kept_bytes;
                let left_bytes = max_bytes.saturating_sub(kept_bytes);
                let voxel_size_m = voxel_size_within(&measures, options.voxel_size_m, options.layers, products, left_bytes);
                Err(grid(GridError::Memory {
                    needed_bytes: estimate.peak_bytes,
                    max_bytes,
                    asked_m: options.voxel_size_m,
                    voxel_size_m,
                }))
            }
            _ => Ok(()),
        }
    }

    /// Classifies the object's volume.
    ///
    /// # Errors
    /// A grid that is too large.
    pub fn voxmap(&self, options: &Options, watch: impl FnMut(Stage)) -> Result<Voxmap, SceneError> {
        Voxmap::build(&self.mesh, &self.inspected, options, watch)
            .map_err(|source| SceneError::Grid { name: self.name.clone(), source })
    }

    /// The field that the tick reads.
    pub fn field(&self, map: &mut Voxmap, with_gradients: bool) -> Field {
        map.field(&self.mesh, with_gradients)
    }

    /// The pointshell about a centre of mass (mesh frame, m).
    pub fn shell(&self, map: &Voxmap, center_of_mass: DVec3) -> (Shell, ShellReport) {
        pointshell::build(&self.mesh, map, center_of_mass)
    }

    /// Volume, centre and inertia.
    pub fn mass_properties(&self) -> MassProperties {
        mass_properties_of_inspected(&self.mesh, &self.inspected)
    }

    /// What was built.
    pub fn report(&self, map: &Voxmap, shell: &ShellReport) -> ObjectReport {
        ObjectReport::new(&self.name, self.role, &self.inspected, map, shell, self.load_s)
    }
}
