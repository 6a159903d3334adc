//! One rigid part, from its triangles to what a contact query reads: the stages of
//! [`voxmap`](crate::voxmap) and [`pointshell`] in order.
//!
//! Data in: a mesh file, a [`Shape`] or a [`TriangleMesh`]. Data out: a [`Field`] of what is
//! touched or a [`Shell`] of what touches, each with a [`ObjectReport`]. Units and frames: metres
//! and axes of the mesh.
//!
//! Invariant: cold; the same bits for any number of threads of the current rayon pool.

use std::borrow::Cow;
use std::path::Path;
use std::sync::OnceLock;
use std::time::Instant;

use glam::DVec3;
use thiserror::Error;

pub use crate::part_report::{
    CacheUse, HoleCapsReport, LeakReport, ObjectReport, PartRole, SolidFigures, Timings,
};

use crate::mesh::mass::MassProperties;
use crate::mesh::primitives::Shape;
use crate::mesh::validate::{MeshReport, inspect};
use crate::mesh::{self, FileMesh, MeshError, Rounding, TriangleMesh};
use crate::pointshell::shell::Shell;
use crate::pointshell::{self, Points, ShellReport};
use crate::setting_names::SettingNames;
use crate::solid::{Solid, SolidOptions, SolidReport};
use crate::storage::memory::available_bytes;
use crate::voxmap::accuracy::{Accuracy, Truth};
use crate::voxmap::border::Border;
use crate::voxmap::estimate::{Estimate, MeshMeasures, Products, voxel_size_within};
use crate::voxmap::field::Field;
use crate::voxmap::grid::{Grid, GridError};
use crate::voxmap::inside_test::InsideTest;
use crate::voxmap::memory_limit::MemoryLimit;
use crate::voxmap::{Answer, BakeStage, Options, ThinPlace, Volume, announce};

/// Counts up whenever baking gives other bits than before for the same part. A test of the bake
/// cache holds reference bakes against it.
pub const GENERATION: u32 = 15;

/// A tessellation's chord error as a share of the voxel edge, so that the voxel size limits
/// accuracy.
const CHORD_SHARE: f64 = 0.02;

/// Why a part cannot be baked.
#[derive(Debug, Error)]
pub enum PartError {
    /// Its mesh.
    #[error("{name}: {source}")]
    Mesh {
        /// Part.
        name: String,
        /// Cause.
        source: MeshError,
    },
    /// Its grid.
    #[error("{name}: {source}")]
    Grid {
        /// Part.
        name: String,
        /// Cause.
        source: GridError,
    },
}

impl PartError {
    /// What to do about it.
    pub fn hint(&self, names: &SettingNames) -> Option<String> {
        match self {
            Self::Mesh { source, .. } => source.hint(names),
            Self::Grid { source, .. } => Some(source.hint(names)),
        }
    }
}

/// A limit that a bake exceeds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ExceededLimit {
    /// Which.
    pub limit: MemoryLimit,
    /// What it leaves to this bake, bytes.
    pub most_bytes: u64,
    /// What the parts before this one keep, where the limit counts them, bytes.
    pub kept_bytes: u64,
}

/// A rigid part on its way through the stages.
#[derive(Debug)]
pub struct Part {
    name: String,
    /// The mesh, m.
    pub mesh: TriangleMesh,
    /// What is wrong with it.
    inspected: MeshReport,
    /// What it means, however finely it is sampled; on demand.
    meaning: OnceLock<Meaning>,
    /// What it means to voxels, and their edge, m: of the first ones that it was asked for.
    meaning_to_voxels: OnceLock<(f64, Meaning)>,
    /// What a user should know of its file.
    notes: Vec<String>,
    rounding: Option<Rounding>,
    load_s: f64,
    setting_names: SettingNames,
}

/// What the triangles of a part are together.
#[derive(Clone, Debug)]
struct Meaning {
    solid: SolidReport,
    mass: MassProperties,
    shape: Accuracy,
}

impl Meaning {
    fn of(mesh: &TriangleMesh, inspected: &MeshReport, voxel_size_m: Option<f64>) -> Self {
        let solid = Solid::of(mesh, &SolidOptions::resolved_by(voxel_size_m));
        let mass = solid.mass(mesh, inspected);
        Self { solid: solid.report, mass, shape: Accuracy::of_border(&solid.border) }
    }
}

impl Part {
    /// A part of triangles. Cost: one inspection of the mesh.
    pub fn new(name: &str, mesh: TriangleMesh) -> Self {
        Self::since(Instant::now(), name, mesh.into())
    }

    /// A shape, cut finely enough for voxels of this edge, m.
    pub fn of_shape(name: &str, shape: &Shape, voxel_size_m: f64) -> Self {
        Self::since(Instant::now(), name, shape.tessellate(CHORD_SHARE * voxel_size_m).into())
    }

    /// A mesh file whose numbers count `metres_per_unit`: 1e-3 for mm.
    ///
    /// # Errors
    /// A file that cannot be read, or a mesh without area.
    pub fn load(name: &str, path: &Path, metres_per_unit: f64) -> Result<Self, PartError> {
        let failed = |source| PartError::Mesh { name: name.to_owned(), source };
        let since = Instant::now();
        let file = mesh::load_with_notes(path, metres_per_unit).map_err(failed)?;
        let part = Self::since(since, name, file);
        if !part.has_area() {
            return Err(failed(MeshError::NoArea {
                path: path.to_owned(),
                triangles: part.inspected.triangles,
            }));
        }
        Ok(part)
    }

    fn since(since: Instant, name: &str, file: FileMesh) -> Self {
        let FileMesh { mesh, notes, rounding } = file;
        let inspected = inspect(&mesh);
        let load_s = since.elapsed().as_secs_f64();
        Self {
            name: name.to_owned(),
            mesh,
            inspected,
            meaning: OnceLock::new(),
            meaning_to_voxels: OnceLock::new(),
            notes,
            rounding,
            load_s,
            setting_names: SettingNames::PLAIN,
        }
    }

    /// The same part, whose warnings call settings by these names.
    #[must_use]
    pub fn with_setting_names(self, setting_names: SettingNames) -> Self {
        Self { setting_names, ..self }
    }

    /// Some triangle has an area.
    pub(crate) fn has_area(&self) -> bool {
        self.inspected.degenerate_triangles < self.inspected.triangles
    }

    /// Name, for messages and reports.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// What a user should look at in its mesh and its file, a sentence each; what its voxels show
    /// is in the report of the bake. With the edge of its voxels, m, also whether its coordinates
    /// are fine enough for them, and of its cracks those that a bake does not join.
    pub fn mesh_warnings(&self, sides: InsideTest, voxel_size_m: Option<f64>) -> Vec<String> {
        match sides {
            InsideTest::Thin => self.warnings(sides, voxel_size_m, None),
            InsideTest::Auto | InsideTest::Flood | InsideTest::Winding => {
                self.warnings(sides, voxel_size_m, Some(&self.meaning(voxel_size_m).solid))
            }
        }
    }

    /// The same with what its triangles were taken for, which a skin need not know.
    fn warnings(
        &self,
        sides: InsideTest,
        voxel_size_m: Option<f64>,
        solid: Option<&SolidReport>,
    ) -> Vec<String> {
        let coarse =
            self.rounding.zip(voxel_size_m).and_then(|(rounding, size_m)| rounding.warning(size_m));
        let notes = self.notes.iter().cloned();
        let solid = solid.map_or_else(Vec::new, |solid| match sides {
            InsideTest::Auto | InsideTest::Winding => solid.warnings(),
            InsideTest::Flood => {
                let by = self.setting_names.flood;
                let hollows = solid.hollows_text().into_iter();
                hollows.map(|text| format!("{text}: solid, by {by}")).collect()
            }
            InsideTest::Thin => Vec::new(),
        });
        notes
            .chain(self.inspected.warnings(&self.setting_names))
            .chain(solid)
            .chain(coarse)
            .collect()
    }

    fn meaning_of_file(&self) -> &Meaning {
        self.meaning.get_or_init(|| Meaning::of(&self.mesh, &self.inspected, None))
    }

    /// What it means to voxels of this edge, m.
    fn meaning(&self, voxel_size_m: Option<f64>) -> Cow<'_, Meaning> {
        let of_file = self.meaning_of_file();
        // Without an open edge there is no crack, and voxels of any size make no difference.
        let Some(asked_m) = voxel_size_m.filter(|_| of_file.solid.open_pieces > 0) else {
            return Cow::Borrowed(of_file);
        };
        let to_voxels = || Meaning::of(&self.mesh, &self.inspected, voxel_size_m);
        let (first_m, first) = self.meaning_to_voxels.get_or_init(|| (asked_m, to_voxels()));
        if *first_m == asked_m { Cow::Borrowed(first) } else { Cow::Owned(to_voxels()) }
    }

    /// What its triangles were taken for: pieces, bodies, cavities, skins; no cracks are joined, as
    /// only voxels say which gaps are. Cost: of the first call that of [`Solid::of`].
    pub fn solid(&self) -> &SolidReport {
        &self.meaning_of_file().solid
    }

    /// Thinnest wall and sharpest edge of the solid that its triangles make to voxels of this edge,
    /// m, without a bake. Cost: of the first call that of [`Solid::of`].
    pub fn walls_and_edges(&self, voxel_size_m: f64) -> Accuracy {
        self.meaning(Some(voxel_size_m)).shape
    }

    /// Bakes what other parts touch; `with_gradients` for
    /// [`FieldKind::SurfacePoint`](crate::voxmap::field::FieldKind::SurfacePoint) alone. Cost: that
    /// of the voxels near the surface.
    ///
    /// # Errors
    /// A grid that is too large, or `watch` ended it.
    pub fn bake_field<A: Answer>(
        &self,
        options: &Options,
        with_gradients: bool,
        mut watch: impl FnMut(BakeStage) -> A,
    ) -> Result<(Field, ObjectReport), PartError> {
        let mut map = self.voxmap(options, &mut watch)?;
        let mut begin = |stage| announce(&mut watch, stage).map_err(|source| self.refused(source));
        begin(BakeStage::Distance)?;
        let field = map.field_with(&self.mesh, with_gradients, || begin(BakeStage::Field))?;
        begin(BakeStage::Report)?;
        let of_shell = ShellReport::default();
        let report = self.report(PartRole::Static, &map, Some(&field), None, &of_shell);
        Ok((field, report))
    }

    /// Bakes what touches other parts: points of this kind about a centre of mass (mesh frame, m;
    /// `None`: that of the mesh), and the mass of the mesh.
    ///
    /// # Errors
    /// A grid that is too large, or `watch` ended it.
    pub fn bake_shell<A: Answer>(
        &self,
        options: &Options,
        points: Points,
        center_of_mass: Option<DVec3>,
        mut watch: impl FnMut(BakeStage) -> A,
    ) -> Result<(Shell, MassProperties, ObjectReport), PartError> {
        let map = self.voxmap(options, &mut watch)?;
        let mass = self.mass_of(&map);
        announce(&mut watch, BakeStage::Pointshell).map_err(|source| self.refused(source))?;
        let center_m = center_of_mass.unwrap_or(mass.center_m);
        let (shell, of_shell) = pointshell::build_with(points, &self.mesh, &map, center_m);
        announce(&mut watch, BakeStage::Report).map_err(|source| self.refused(source))?;
        let points = Some((&shell, center_m));
        let report = self.report(PartRole::Tool, &map, None, points, &of_shell);
        Ok((shell, mass, report))
    }

    /// Its surface, for distances beyond the layers of a map. Cost: that of [`Self::voxmap`].
    ///
    /// # Errors
    /// A grid that is too large.
    pub fn border(&self, options: &Options) -> Result<Border<'static>, PartError> {
        let map = self.voxmap(options, |_| ())?;
        Ok(Border::of(&map, &self.mesh).into_owned())
    }

    /// Area of its triangles, m².
    pub fn area_m2(&self) -> f64 {
        self.inspected.area_m2
    }

    /// Whether it can be baked here: what runs out of memory ends the process.
    ///
    /// # Errors
    /// What does not fit into one map, or into the memory that the system has left.
    pub fn fits(&self, options: &Options, products: Products) -> Result<(), PartError> {
        let left = available_bytes().map(MemoryLimit::Left);
        let most_bytes = left.map(MemoryLimit::max_bytes);
        self.judge(options, products, most_bytes, |estimate| {
            let limit = left.filter(|limit| estimate.peak_bytes > limit.max_bytes())?;
            Some(ExceededLimit { limit, most_bytes: limit.max_bytes(), kept_bytes: 0 })
        })
    }

    /// Whether it can be baked within the limits of the caller. `exceeded` gets what baking takes,
    /// and gives the limit that this exceeds; `most_bytes` is what a bake may take under all of
    /// them, for the voxel size that an error advises.
    ///
    /// # Errors
    /// What does not fit into one map, or exceeds a limit.
    pub fn judge(
        &self,
        options: &Options,
        products: Products,
        most_bytes: Option<u64>,
        exceeded: impl FnOnce(&Estimate) -> Option<ExceededLimit>,
    ) -> Result<(), PartError> {
        let measures = MeshMeasures::of(&self.mesh);
        let (low, high) = measures.bounds_m;
        let &Options { voxel_size_m: asked_m, layers, .. } = options;
        let fitting =
            |from_m, most_bytes| voxel_size_within(&measures, from_m, layers, products, most_bytes);
        let grid = Grid::around(low, high, asked_m, layers).map_err(|error| {
            self.refused(match error {
                // The finest voxels of one map may take a hundred times the memory that there is.
                GridError::TooLarge { dims, voxel_size_m: finest_m } => {
                    let fitting_m = most_bytes.and_then(|most_bytes| fitting(finest_m, most_bytes));
                    GridError::TooLarge { dims, voxel_size_m: fitting_m.unwrap_or(finest_m) }
                }
                error => error,
            })
        })?;
        let estimate = Estimate::new(&measures, &grid, layers, products);
        let Some(ExceededLimit { limit, most_bytes, kept_bytes }) = exceeded(&estimate) else {
            return Ok(());
        };
        Err(self.refused(GridError::Memory {
            needed_bytes: estimate.peak_bytes.saturating_add(kept_bytes),
            kept_bytes,
            limit,
            asked_m,
            voxel_size_m: fitting(asked_m, most_bytes),
        }))
    }

    /// Classifies the part's volume.
    ///
    /// # Errors
    /// A grid that is too large, or `watch` ended it.
    pub fn voxmap<A: Answer>(
        &self,
        options: &Options,
        watch: impl FnMut(BakeStage) -> A,
    ) -> Result<Volume, PartError> {
        Volume::build(&self.mesh, &self.inspected, options, watch)
            .map_err(|source| self.refused(source))
    }

    fn refused(&self, source: GridError) -> PartError {
        PartError::Grid { name: self.name.clone(), source }
    }

    /// Volume, centre and inertia of the solid, which counts once what lies in several bodies, and
    /// hollows not at all; of the surface where the mesh is open. Frame and units of
    /// [`MassProperties`].
    pub fn mass_properties(&self) -> MassProperties {
        self.meaning_of_file().mass
    }

    /// The same, by a map of it, whose voxels say which cracks are joined.
    pub fn mass_of(&self, map: &Volume) -> MassProperties {
        map.mass.unwrap_or_else(|| self.mass_properties())
    }

    /// The figures of what was built, and what it tells apart: the field, and points about this
    /// centre of mass, mesh frame, m.
    pub fn report(
        &self,
        role: PartRole,
        map: &Volume,
        field: Option<&Field>,
        shell: Option<(&Shell, DVec3)>,
        of_shell: &ShellReport,
    ) -> ObjectReport {
        let voxel_size_m = Some(map.surface.grid.voxel_size_m);
        let mut warnings = match &map.solid {
            Some(solid) => self.warnings(map.sides_asked, voxel_size_m, Some(solid)),
            None => self.mesh_warnings(map.sides_asked, voxel_size_m),
        };
        let truth = Truth::of(map, &self.mesh);
        // Points of a tool lie on both faces of a wall, however thin it is.
        if role != PartRole::Tool {
            warnings.extend(ThinPlace::warning(&truth.thin_places(), &self.setting_names));
        }
        ObjectReport {
            accuracy: Accuracy::of(&truth, field, shell),
            ..ObjectReport::new(
                &self.name,
                role,
                &self.inspected,
                warnings,
                map,
                of_shell,
                self.load_s,
            )
        }
    }
}
