//! One object: from its source to voxmap, field and pointshell.

use std::time::Instant;

use glam::DVec3;
use thiserror::Error;

use super::cache::{Baked, Cache, Lookup, Request, Spacing};
use super::report::{ObjectReport, Role};
use crate::config::scene::MeshSource;
use clay::LoadError;
use clay::clay_model::{ClayModelError, Foreseen};
use clay::session::SessionError;
use vps::density::FrameError;
use vps::mesh::mass::{MassProperties, mass_properties_of_inspected};
use vps::mesh::validate::{MeshReport, inspect};
use vps::mesh::{self, MeshError, TriangleMesh};
use vps::pointshell::shell::Shell;
use vps::pointshell::{self, ShellReport};
use vps::voxmap::estimate::{Estimate, MeshMeasures, Products, voxel_size_within};
use vps::voxmap::field::Field;
use vps::voxmap::grid::{Grid, GridError};
use vps::voxmap::memory_limit::MemoryLimit;
use vps::voxmap::{Options, Stage, Voxmap};

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
    /// The source of the clay, or of the tool as a solid.
    #[error("clay: {0}")]
    Load(#[from] LoadError),
    /// The clay itself.
    #[error("clay: {0}")]
    Piece(#[from] ClayModelError),
    /// It would take too much memory.
    #[error(
        "clay: {} samples and {} nodes of the raster take about {}", foreseen.samples, foreseen.nodes, limit.exceeded_by(foreseen.bytes)
    )]
    ClayMemory {
        /// What it would take, with what objects keep.
        foreseen: Foreseen,
        /// What may be taken.
        limit: MemoryLimit,
    },
    /// A session that was saved.
    #[error("clay: {0}")]
    Session(#[from] SessionError),
    /// What the tick would touch of it.
    #[error("clay: {0}")]
    Frame(#[from] FrameError),
}

impl SceneError {
    /// What to do about it.
    pub fn hint(&self) -> Option<String> {
        match self {
            Self::Mesh { source, .. } => source.hint().map(str::to_owned),
            Self::Grid { source, .. } => Some(source.hint()),
            Self::Load(problem) => problem.hint().map(str::to_owned),
            Self::Piece(ClayModelError::Surface(problem)) => Some(problem.hint().to_owned()),
            Self::Session(_) => Some("give a file of `hapticd sculpt --session`, or another source of clay".to_owned()),
            Self::Piece(ClayModelError::Beside(..)) => {
                Some("give `sculpt.region_mm` in the frame of the piece's file, and check `sculpt.units`".to_owned())
            }
            Self::ClayMemory { limit, .. } => {
                Some(format!("take fewer mass points in `sculpt.raster`, a larger `sculpt.spacing_mm`, or {}", limit.remedy()))
            }
            Self::Piece(_) | Self::Frame(_) => None,
        }
    }
}

/// What a command lends to baking.
#[derive(Debug)]
pub struct BakeMeans<'a> {
    /// What was baked before, and where to keep what is baked now.
    pub cache: &'a mut Cache,
    /// How much memory the rest may take.
    pub memory: MemoryPlan<'a>,
}

impl<'a> From<&'a mut Cache> for BakeMeans<'a> {
    /// All the memory that it takes.
    fn from(cache: &'a mut Cache) -> Self {
        Self { cache, memory: MemoryPlan::new(None, |_, _| ()) }
    }
}

/// How much memory baking may take, and who is told how much it will.
pub struct MemoryPlan<'a> {
    /// Most bytes held at a time, by estimate; `None`: no limit.
    max_bytes: Option<u64>,
    /// Asked before each object what the system has left; `None`: not a matter of the plan.
    left: Option<Box<Left<'a>>>,
    /// What the objects done so far keep: by estimate, or by their size where the cache had them.
    kept_bytes: u64,
    tell: Box<Tell<'a>>,
}

/// What the system has left, bytes; `None` where it does not say.
type Left<'a> = dyn Fn() -> Option<u64> + 'a;

/// Is told an object's name and what baking it will take.
type Tell<'a> = dyn FnMut(&str, &Estimate) + 'a;

impl<'a> MemoryPlan<'a> {
    /// A limit, if any, and what to do with each object's name and estimate before its work begins. The peak includes what the
    /// objects before it keep.
    pub fn new(max_bytes: Option<u64>, tell: impl FnMut(&str, &Estimate) + 'a) -> Self {
        Self { max_bytes, left: None, kept_bytes: 0, tell: Box::new(tell) }
    }

    /// The same, and no object takes more than a part of what the system has left when its turn comes ([`MemoryLimit::Left`]): for a process that
    /// must not be ended for want of memory.
    #[must_use]
    pub fn within(self, left: impl Fn() -> Option<u64> + 'a) -> Self {
        Self { left: Some(Box::new(left)), ..self }
    }

    /// There is a limit to keep.
    pub(super) fn is_limited(&self) -> bool {
        self.max_bytes.is_some() || self.left.is_some()
    }

    /// What the system leaves the next object; `None`: whatever it takes.
    fn left(&self) -> Option<MemoryLimit> {
        self.left.as_ref()?().map(MemoryLimit::Left)
    }

    /// The limit that so many bytes exceed, and how many of them may be taken beside what is kept: an explicit allowance counts that too, and what
    /// is left does not.
    fn exceeded_by(&self, needed_bytes: u64) -> Option<(MemoryLimit, u64)> {
        let given = self.max_bytes.map(|bytes| (MemoryLimit::Given(bytes), bytes.saturating_sub(self.kept_bytes)));
        let left = self.left().map(|limit| (limit, limit.max_bytes()));
        given.into_iter().chain(left).find(|(_, most_bytes)| needed_bytes > *most_bytes)
    }

    /// Judges the clay, beside what the objects before it keep.
    pub(super) fn judge_clay(&self, mut foreseen: Foreseen) -> Result<(), SceneError> {
        let Some((limit, _)) = self.exceeded_by(foreseen.bytes) else { return Ok(()) };
        if let MemoryLimit::Given(_) = limit {
            foreseen.bytes = foreseen.bytes.saturating_add(self.kept_bytes);
        }
        Err(SceneError::ClayMemory { foreseen, limit })
    }
}

impl core::fmt::Debug for MemoryPlan<'_> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let Self { max_bytes, kept_bytes, left: _, tell: _ } = self;
        f.debug_struct("MemoryPlan").field("max_bytes", max_bytes).field("kept_bytes", kept_bytes).finish_non_exhaustive()
    }
}

/// Takes an object from the cache, or bakes it and keeps it there. Memory is judged for what is baked only.
///
/// # Errors
/// A mesh that cannot be used, a grid that is too large, or too much memory.
pub(super) fn obtain(
    request: &Request<'_>,
    BakeMeans { cache, memory }: &mut BakeMeans<'_>,
    mut tell: impl FnMut(Stage),
) -> Result<Baked, SceneError> {
    tell(Stage::Load);
    // What the cache has is read whole.
    let most_bytes = memory.left().map_or(u64::MAX, MemoryLimit::max_bytes);
    let slot = match cache.look_up(request, most_bytes) {
        Lookup::Hit(baked) => {
            memory.kept_bytes += baked.heap_bytes() as u64;
            return Ok(*baked);
        }
        Lookup::Bake(slot) => slot,
    };
    let mut baked = bake(request, memory, tell)?;
    baked.report.cache = slot.cache;
    cache.store(&slot, request, &baked);
    Ok(baked)
}

fn bake(request: &Request<'_>, memory: &mut MemoryPlan<'_>, mut tell: impl FnMut(Stage)) -> Result<Baked, SceneError> {
    let geometry = Geometry::load(request.name, request.role, request.source, request.spacing)?;
    let voxel_size_m = geometry.voxel_size_m(request.spacing);
    let options = Options { voxel_size_m, layers: request.layers, navigation: None, sides: request.sides };
    geometry.foresee(&options, request.products(), memory)?;
    let mut map = geometry.voxmap(&options, &mut tell)?;
    if request.role == Role::Static {
        tell(Stage::Distance);
        let field = geometry.field(&mut map, request.with_gradients);
        let report = geometry.report(&map, &ShellReport::default());
        return Ok(Baked { field: Some(field), shell: None, mass: None, report });
    }
    let mass = geometry.mass_properties();
    tell(Stage::Pointshell);
    let (shell, shell_report) = geometry.shell(&map, request.center_of_mass.unwrap_or(mass.center_m));
    let report = geometry.report(&map, &shell_report);
    Ok(Baked { field: None, shell: Some(shell), mass: Some(mass), report })
}

/// A tessellation's chord error as a share of the voxel edge, so that the voxel size limits accuracy.
const CHORD_SHARE: f64 = 0.02;

/// An object on its way through the stages.
pub struct Geometry {
    name: String,
    role: Role,
    /// The mesh, in metres and in its file's frame.
    pub mesh: TriangleMesh,
    /// What is wrong with them.
    inspected: MeshReport,
    load_s: f64,
}

impl Geometry {
    /// Reads or tessellates an object and inspects it.
    ///
    /// # Errors
    /// A mesh that cannot be used.
    pub fn load(name: &str, role: Role, source: &MeshSource, spacing: Spacing) -> Result<Self, SceneError> {
        let since = Instant::now();
        let mesh = match source {
            MeshSource::File { path, metres_per_unit } => {
                mesh::load(path, *metres_per_unit).map_err(|source| SceneError::Mesh { name: name.to_owned(), source })?
            }
            // The box of a shape hardly depends on how finely it is cut; only a size of voxels can be too fine for a coarse cut.
            MeshSource::Shape(shape) => match spacing {
                Spacing::Size(voxel_size_m) => shape.tessellate(CHORD_SHARE * voxel_size_m),
                Spacing::LongestAxis(_) => shape.tessellate(0.0),
            },
        };
        let inspected = inspect(&mesh);
        if let MeshSource::File { path, .. } = source
            && inspected.degenerate_triangles == inspected.triangles
        {
            let source = MeshError::NoArea { path: path.clone(), triangles: inspected.triangles };
            return Err(SceneError::Mesh { name: name.to_owned(), source });
        }
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
        let own_bytes = estimate.peak_bytes;
        let exceeded = memory.exceeded_by(own_bytes);
        estimate.peak_bytes += memory.kept_bytes;
        memory.kept_bytes += estimate.kept_bytes;
        (memory.tell)(&self.name, &estimate);
        let Some((limit, most_bytes)) = exceeded else { return Ok(()) };
        Err(grid(GridError::Memory {
            needed_bytes: if let MemoryLimit::Given(_) = limit { estimate.peak_bytes } else { own_bytes },
            limit,
            asked_m: options.voxel_size_m,
            voxel_size_m: voxel_size_within(&measures, options.voxel_size_m, options.layers, products, most_bytes),
        }))
    }

    /// Voxel edge s, m.
    pub fn voxel_size_m(&self, spacing: Spacing) -> f64 {
        spacing.voxel_size_m(self.mesh.bounds().map_or(DVec3::ZERO, |(low, high)| high - low))
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

    /// Volume, centre and inertia; of the surface where the mesh is open. Frame and units of [`MassProperties`].
    pub fn mass_properties(&self) -> MassProperties {
        mass_properties_of_inspected(&self.mesh, &self.inspected)
    }

    /// The figures of what was built, for people and `--json`.
    pub fn report(&self, map: &Voxmap, shell: &ShellReport) -> ObjectReport {
        ObjectReport::new(&self.name, self.role, &self.inspected, map, shell, self.load_s)
    }
}
