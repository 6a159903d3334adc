//! One object: from its source to voxmap, field and pointshell.

use thiserror::Error;

use super::cache::{Baked, Cache, Lookup, Request, Spacing};
use super::loaded_clay::ClayError;
use crate::config::scene::MeshSource;
use crate::config::setting_names::{KEYS, MISSING};
use clay::LoadError;
use clay::clay_model::{ClayModelError, MemoryEstimate};
use vps::mesh::MeshError;
use vps::part::{ExceededLimit, ObjectReport, Part, PartError, PartRole};
use vps::storage::memory::available_bytes;
use vps::voxmap::estimate::{Estimate, Products};
use vps::voxmap::memory_limit::MemoryLimit;
use vps::voxmap::{BakeStage, Options};

/// Why a scene cannot be built.
#[derive(Debug, Error)]
pub enum SceneError {
    /// The mesh or the grid of a part.
    #[error(transparent)]
    Part(#[from] PartError),
    /// Its clay.
    #[error("clay: {0}")]
    Clay(#[from] ClayError),
}

impl SceneError {
    /// What to do about it.
    pub fn hint(&self) -> Option<String> {
        match self {
            Self::Part(PartError::Mesh { source: MeshError::Missing { .. }, .. })
            | Self::Clay(ClayError::Load(LoadError::File(MeshError::Missing { .. }))) => {
                Some(MISSING.to_owned())
            }
            Self::Part(problem) => problem.hint(&KEYS),
            Self::Clay(problem) => problem.hint(),
        }
    }
}

/// What a command lends to baking.
#[derive(Debug)]
pub struct BakeOptions<'a> {
    /// What was baked before, and where to keep what is baked now.
    pub cache: &'a mut Cache,
    /// How much memory the rest may take.
    pub memory: MemoryPlan<'a>,
}

impl<'a> From<&'a mut Cache> for BakeOptions<'a> {
    /// All the memory that it takes.
    fn from(cache: &'a mut Cache) -> Self {
        Self { cache, memory: MemoryPlan::unlimited() }
    }
}

/// How much memory baking may take, and the callback that gets the estimate.
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

/// Gets an object's name and what baking it will take.
type Tell<'a> = dyn FnMut(&str, &Estimate) + 'a;

impl<'a> MemoryPlan<'a> {
    /// All the memory that it takes.
    pub fn unlimited() -> Self {
        Self::new(None, |_, _| ())
    }

    /// A limit, if any, and what to do with each object's name and estimate before its work begins.
    /// The estimate is of this object alone, without what the objects before it keep.
    pub fn new(max_bytes: Option<u64>, tell: impl FnMut(&str, &Estimate) + 'a) -> Self {
        Self { max_bytes, left: None, kept_bytes: 0, tell: Box::new(tell) }
    }

    /// The same, and no object takes more than a part of what the system has left when its turn
    /// comes ([`MemoryLimit::Left`]): for a process that must not be ended for want of memory.
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

    /// The limit that so many bytes exceed, and how many of them may be taken beside what is kept:
    /// an explicit allowance counts that too, and what is left does not.
    fn exceeded_by(&self, needed_bytes: u64) -> Option<(MemoryLimit, u64)> {
        let given = self
            .max_bytes
            .map(|bytes| (MemoryLimit::Given(bytes), bytes.saturating_sub(self.kept_bytes)));
        let left = self.left().map(|limit| (limit, limit.max_bytes()));
        given.into_iter().chain(left).find(|(_, most_bytes)| needed_bytes > *most_bytes)
    }

    /// What the next object may take, bytes: what is allowed, and else what the system has left.
    fn most_bytes(&self) -> Option<u64> {
        let given = self.max_bytes.map(|bytes| bytes.saturating_sub(self.kept_bytes));
        let left = self
            .left()
            .or_else(|| available_bytes().map(MemoryLimit::Left))
            .map(MemoryLimit::max_bytes);
        given.into_iter().chain(left).min()
    }

    /// Says what baking a part will take, and refuses it where that is too much.
    ///
    /// # Errors
    /// A grid that is too large, or too much memory.
    pub fn judge(
        &mut self,
        part: &Part,
        options: &Options,
        products: Products,
    ) -> Result<(), PartError> {
        let most_bytes = self.most_bytes();
        part.judge(options, products, most_bytes, |estimate| {
            let exceeded = self.exceeded_by(estimate.peak_bytes);
            let kept_bytes = self.kept_bytes;
            self.kept_bytes += estimate.kept_bytes;
            (self.tell)(part.name(), estimate);
            let (limit, most_bytes) = exceeded?;
            let kept_bytes = if let MemoryLimit::Given(_) = limit { kept_bytes } else { 0 };
            Some(ExceededLimit { limit, most_bytes, kept_bytes })
        })
    }

    /// Judges the clay, beside what the objects before it keep.
    pub(super) fn judge_clay(&self, mut estimate: MemoryEstimate) -> Result<(), ClayModelError> {
        let Some((limit, _)) = self.exceeded_by(estimate.bytes) else { return Ok(()) };
        if let MemoryLimit::Given(_) = limit {
            estimate.bytes = estimate.bytes.saturating_add(self.kept_bytes);
        }
        Err(ClayModelError::Memory { estimate, limit })
    }
}

impl core::fmt::Debug for MemoryPlan<'_> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let Self { max_bytes, kept_bytes, left: _, tell: _ } = self;
        f.debug_struct("MemoryPlan")
            .field("max_bytes", max_bytes)
            .field("kept_bytes", kept_bytes)
            .finish_non_exhaustive()
    }
}

/// Takes an object from the cache, or bakes it and keeps it there. Memory is judged for what is
/// baked only.
///
/// # Errors
/// A mesh that cannot be used, a grid that is too large, or too much memory.
pub(super) fn obtain(
    request: &Request<'_>,
    BakeOptions { cache, memory }: &mut BakeOptions<'_>,
    mut tell: impl FnMut(BakeStage),
) -> Result<Baked, PartError> {
    tell(BakeStage::Load);
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

fn bake(
    request: &Request<'_>,
    memory: &mut MemoryPlan<'_>,
    tell: impl FnMut(BakeStage),
) -> Result<Baked, PartError> {
    let part = load(request.name, request.source, request.spacing)?;
    let options = request.options(&part);
    memory.judge(&part, &options, request.products())?;
    if request.role == PartRole::Static {
        let (field, report) = part.bake_field(&options, request.with_gradients, tell)?;
        return Ok(Baked { field: Some(field), shell: None, mass: None, report });
    }
    let (shell, mass, report) =
        part.bake_shell(&options, request.points, request.center_of_mass, tell)?;
    Ok(Baked { field: None, shell: Some(shell), mass: Some(mass), report })
}

/// The least overlap of the tool with a part of the scene that is felt wherever it is, m: how deep
/// the tool enters unseen, and how far off the surface of the worst part is felt. `None` where one
/// of them was not measured.
pub fn smallest_overlap_m(reports: &[ObjectReport]) -> Option<f64> {
    let unseen_m = reports.iter().find_map(|object| object.accuracy.unseen_depth_m)?;
    let errors_m = reports.iter().filter_map(|object| object.accuracy.surface_error_m);
    Some(unseen_m + errors_m.max_by(f64::total_cmp)?)
}

/// Reads or tessellates an object and inspects it.
///
/// # Errors
/// A mesh that cannot be used.
pub fn load(name: &str, source: &MeshSource, spacing: Spacing) -> Result<Part, PartError> {
    let part = match (source, spacing) {
        (MeshSource::File { path, metres_per_unit }, _) => {
            Part::load(name, path, *metres_per_unit)?
        }
        (MeshSource::Shape(shape), Spacing::Size(voxel_size_m)) => {
            Part::of_shape(name, shape, voxel_size_m)
        }
        // The box of a shape hardly depends on how finely it is cut; only a size of voxels can be
        // too fine for a coarse cut.
        (MeshSource::Shape(shape), Spacing::LongestAxis(_)) => Part::of_shape(name, shape, 0.0),
    };
    Ok(part.with_setting_names(KEYS))
}
