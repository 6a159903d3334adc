//! Triangles in, voxmap out: the stages in order.
//!
//! A file is first taken for what it means, see [`solid`](crate::solid): the border of the solid
//! has one map, and pieces that are not closed have one each, beside it. Under
//! [`InsideTest::Flood`] and [`InsideTest::Thin`] the triangles are taken as they are.

use core::convert::Infallible;
use core::ops::ControlFlow;
use std::borrow::Cow;
use std::time::Instant;

use super::distance::{Distances, Samples, Signs, sample_of};
use super::field::Field;
use super::fill::Sides;
use super::grid::{Grid, GridError, SURFACE_VOXELS_MAX, brick_origin};
use super::hole_cap::CappedMesh;
use super::inside_test::{InsideBasis, InsideTest, Verdict};
use super::layers::Layers;
use super::leak::Leak;
use super::orient::Orientation;
use super::surface::{Navigation, Surface};
use super::union::{Member, union};
use crate::mesh::TriangleMesh;
use crate::mesh::mass::{MassProperties, of_body};
use crate::mesh::validate::{MeshReport, inspect};
use crate::solid::{Solid, SolidOptions, SolidReport};

/// Size and number of the voxels of a bake.
///
/// # Examples
/// ```
/// # use vps::{DVec3, InsideTest, Mesh, Options, Shape, Voxmap};
/// let options = Options { layers: 4, sides: InsideTest::Thin, ..Options::new(1e-3) };
/// # let ball = Mesh::from_shape(&Shape::Sphere { radius_m: 10e-3 }, 1e-5)?;
/// let skin = Voxmap::bake(&ball, &options)?; // of a ball of 10 mm
/// assert!(skin.distance(DVec3::X * 7e-3)?.distance_m > 0.0, "a thin skin has no inside");
/// # Ok::<(), vps::Error>(())
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Voxel edge s, m.
    pub voxel_size_m: f64,
    /// Layers on each side of the surface, 2 to 126 for the types at the root; a
    /// distance is known up to (`layers` − ½) voxels.
    pub layers: u32,
    /// How candidates are walked: `None` takes [`Navigation::AUTO`]. The result is the same.
    #[doc(hidden)]
    pub navigation: Option<Navigation>,
    /// How to distinguish inside and outside.
    pub sides: InsideTest,
}

impl Options {
    /// Layers on each side where none are asked for: those of a scene file.
    pub const DEFAULT_LAYERS: u32 = 8;

    /// Voxels of this edge, m, and for the rest what a scene file has where it says nothing.
    ///
    /// # Examples
    /// ```
    /// # use vps::Options;
    /// let options = Options::new(0.5e-3);
    /// assert_eq!((options.voxel_size_m, options.layers), (0.5e-3, Options::DEFAULT_LAYERS));
    /// ```
    pub fn new(voxel_size_m: f64) -> Self {
        Self {
            voxel_size_m,
            layers: Self::DEFAULT_LAYERS,
            navigation: None,
            sides: InsideTest::Auto,
        }
    }
}

/// A stage of generation, for reports of progress.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BakeStage {
    /// Reading or tessellating, and inspecting.
    Load,
    /// Navigation and SAT.
    Surface,
    /// Flood fill, leak search, lids, orientation.
    Fill,
    /// Layers.
    Layers,
    /// Distances.
    Distance,
    /// What is made of them for the look-up: moved samples, sharp edges.
    Field,
    /// Projection of points.
    Pointshell,
    /// What was baked, measured again.
    Report,
}

impl BakeStage {
    /// Share of a bake of a voxmap or pointshell that is over when the stage begins, by the mean of
    /// what stages take of block, nut and gear of the shipped models with a million to twenty
    /// million cells.
    ///
    /// # Examples
    /// ```
    /// # use vps::BakeStage;
    /// assert_eq!(BakeStage::Load.share(), 0.0);
    /// assert!(BakeStage::Distance.share() < BakeStage::Report.share());
    /// ```
    pub fn share(self) -> f64 {
        match self {
            Self::Load | Self::Surface => 0.0,
            Self::Fill => 0.04,
            Self::Layers => 0.05,
            Self::Distance | Self::Pointshell => 0.07,
            Self::Field => 0.45,
            Self::Report => 0.8,
        }
    }
}

/// What the callback for progress may answer when a stage is about to begin: `()` goes on,
/// [`ControlFlow::Break`] ends the bake.
pub trait Answer {
    /// The bake is to end here.
    fn ends(self) -> bool;
}

impl Answer for () {
    fn ends(self) -> bool {
        false
    }
}

impl Answer for ControlFlow<()> {
    fn ends(self) -> bool {
        self.is_break()
    }
}

/// Tells that a stage is about to begin.
pub(crate) fn announce<A: Answer>(
    watch: &mut impl FnMut(BakeStage) -> A,
    stage: BakeStage,
) -> Result<(), GridError> {
    if watch(stage).ends() { Err(GridError::Cancelled) } else { Ok(()) }
}

/// Seconds per stage.
#[derive(Clone, Copy, Debug, Default)]
pub struct StageTimes {
    /// What the triangles mean, and grid set-up.
    pub init_s: f64,
    /// Navigation and SAT.
    pub surface_s: f64,
    /// Flood fill, leak search, lids, orientation.
    pub fill_s: f64,
    /// Layers.
    pub layers_s: f64,
    /// Distances and field.
    pub distance_s: f64,
}

/// A classified volume: which cells are surface, outside, inside, and how far from the surface.
#[derive(Debug)]
pub struct Volume {
    /// Surface voxels; those of lids too.
    pub surface: Surface,
    /// Which of the cells without surface are outside.
    pub sides: Sides,
    /// Which way each triangle faces.
    pub orientation: Orientation,
    /// Layer values of the cells near the surface.
    pub layers: Layers,
    /// How outside and inside were to be distinguished.
    pub sides_asked: InsideTest,
    /// How they were.
    pub basis: InsideBasis,
    /// The fill of the mesh as it is did not leak.
    pub watertight: bool,
    /// Where it leaked; `None`: it did not.
    pub leak: Option<Leak>,
    /// Share of the surface that has outside on both sides, though it does not leak: half of it makes
    /// a skin. 0 of the border of a solid, which is none.
    pub thin_share: f64,
    /// Treated as a thin two-sided skin.
    pub thin: bool,
    /// Share of the places beside the surface with a clear winding number; `None` where it was not
    /// asked.
    pub clear_share: Option<f64>,
    /// The mesh with lids on its holes, where they were needed.
    pub capped: Option<CappedMesh>,
    /// The triangles that the map is of, where they are not those of the file.
    own: Option<TriangleMesh>,
    /// What the triangles of the file were taken for; `None` where they were taken as they are.
    pub solid: Option<SolidReport>,
    /// Volume, centre and inertia: of what lids close, or else [`Solid::mass`]. `None` where it was
    /// not asked what the triangles mean.
    pub mass: Option<MassProperties>,
    /// Maps of pieces that are not closed, beside the solid.
    pub beside: Vec<Beside>,
    /// Seconds per stage.
    pub timings: StageTimes,
}

/// What is known of triangles before they are voxelized.
#[derive(Clone, Copy)]
enum Meaning<'a> {
    /// Nothing but what the inspection found.
    Unknown(&'a MeshReport),
    /// They are the border of a solid.
    Border,
}

/// The map of a piece beside the solid.
#[derive(Debug)]
pub struct Beside {
    /// Its map, whose grid is made of bricks of the whole grid.
    pub map: Volume,
    /// Area of its triangles, m².
    pub area_m2: f64,
    /// Coordinate of its first brick in the whole grid.
    first_brick: [u32; 3],
}

impl Beside {
    /// Its surface voxels, by their cells in the whole grid.
    pub fn surface_cells(&self) -> impl Iterator<Item = [i32; 3]> + '_ {
        let first = brick_origin(self.first_brick);
        self.map
            .surface
            .cells()
            .map(move |cell| core::array::from_fn(|axis| first[axis] + cell[axis]))
    }
}

impl Volume {
    /// Classifies the volume of a mesh: solid and skins, surface, fill, leak check, orientation,
    /// layers.
    ///
    /// # Errors
    /// A grid that cannot be built, more surface voxels than can be numbered, or `watch` ended it.
    /// The mesh must not be empty (its bounds would be a point at the origin).
    pub fn build<A: Answer>(
        mesh: &TriangleMesh,
        report: &MeshReport,
        options: &Options,
        mut watch: impl FnMut(BakeStage) -> A,
    ) -> Result<Self, GridError> {
        let since = Instant::now();
        let (low, high) = mesh.bounds().unwrap_or_default();
        let grid = Grid::around(low, high, options.voxel_size_m, options.layers)?;
        if matches!(options.sides, InsideTest::Flood | InsideTest::Thin) {
            let init_s = since.elapsed().as_secs_f64();
            let meaning = Meaning::Unknown(report);
            let mut map = Self::of_triangles(mesh, meaning, grid, options, &mut watch)?;
            map.timings.init_s = init_s;
            return Ok(map);
        }
        let solid = Solid::of(mesh, &SolidOptions::resolved_by(Some(options.voxel_size_m)));
        let border = &solid.border;
        let mass = solid.mass(mesh, report);
        let init_s = since.elapsed().as_secs_f64();
        let parts = || solid.open_parts(options.voxel_size_m);
        let mut map = if border.triangles.is_empty() {
            let map =
                Self::of_triangles(mesh, Meaning::Unknown(report), grid, options, &mut watch)?;
            // One loose sheet among them must not make a skin of a part that has an inside.
            let parts = if map.thin { parts() } else { Vec::new() };
            let mut beside = if parts.len() > 1 {
                Self::beside_of(parts, &grid, options, &mut watch)?
            } else {
                Vec::new()
            };
            match beside.iter().position(|beside| !beside.map.thin) {
                None => map,
                Some(place) => {
                    let own = beside.remove(place).map.own.unwrap_or_default();
                    let report = inspect(&own);
                    let meaning = Meaning::Unknown(&report);
                    let mut map = Self::of_triangles(&own, meaning, grid, options, &mut watch)?;
                    map.own = Some(own);
                    map.beside = beside;
                    map
                }
            }
        } else {
            let mut map = Self::of_triangles(border, Meaning::Border, grid, options, &mut watch)?;
            map.beside = Self::beside_of(parts(), &grid, options, &mut watch)?;
            map.own = Some(solid.border);
            map
        };
        map.timings.init_s = init_s;
        map.solid = Some(solid.report);
        map.mass = Some(map.mass_with_lids().unwrap_or(mass));
        Ok(map)
    }

    /// Volume, centre and inertia of what lids close; `None` without lids.
    fn mass_with_lids(&self) -> Option<MassProperties> {
        let outward = self.outward_mesh(&self.capped.as_ref()?.mesh);
        let (low, high) = outward.bounds()?;
        of_body(&outward, 0.5 * (low + high))
    }

    /// Maps of parts that are not closed, each by itself.
    fn beside_of<A: Answer>(
        parts: Vec<TriangleMesh>,
        grid: &Grid,
        options: &Options,
        watch: &mut impl FnMut(BakeStage) -> A,
    ) -> Result<Vec<Beside>, GridError> {
        let beside = |own: TriangleMesh| {
            let (low, high) = own.bounds().unwrap_or_default();
            let (grid, first_brick) = grid.part_around(low, high, options.layers);
            let report = inspect(&own);
            let meaning = Meaning::Unknown(&report);
            let mut map = Self::of_triangles(&own, meaning, grid, options, &mut *watch)?;
            map.own = Some(own);
            Ok(Beside { map, area_m2: report.area_m2, first_brick })
        };
        parts.into_iter().map(beside).collect()
    }

    /// Classifies the volume of triangles that all belong together.
    fn of_triangles<A: Answer>(
        mesh: &TriangleMesh,
        meaning: Meaning<'_>,
        grid: Grid,
        options: &Options,
        watch: &mut impl FnMut(BakeStage) -> A,
    ) -> Result<Self, GridError> {
        let mut timings = StageTimes::default();
        let mut since = Instant::now();
        let mut lap = || {
            let lap_s = since.elapsed().as_secs_f64();
            since = Instant::now();
            lap_s
        };
        announce(watch, BakeStage::Surface)?;
        let navigation = options.navigation.unwrap_or(Navigation::AUTO);
        let surface = Surface::mark(mesh, &grid, navigation);
        if surface.n_voxels as u64 > SURFACE_VOXELS_MAX {
            let n_voxels = surface.n_voxels as u64;
            // Surface voxels go with the square of the resolution.
            let coarser = 1.02 * (n_voxels as f64 / SURFACE_VOXELS_MAX as f64).sqrt();
            return Err(GridError::Surface {
                n_voxels,
                voxel_size_m: coarser * options.voxel_size_m,
            });
        }
        timings.surface_s = lap();
        announce(watch, BakeStage::Fill)?;
        let verdict = match meaning {
            Meaning::Unknown(report) => Verdict::reach(mesh, report, surface, options.sides),
            Meaning::Border => Verdict::of_border(mesh, surface, options.sides),
        };
        let Verdict { surface, sides, basis, leak, thin_share, clear_share, capped } = verdict;
        let thin = basis == InsideBasis::Thin;
        let closed = capped.as_ref().map_or(mesh, |capped| &capped.mesh);
        let orientation = match meaning {
            Meaning::Unknown(report) if !thin => {
                Orientation::judge(closed, report, &surface, &sides)
            }
            _ => Orientation::as_filed(closed.triangles.len()),
        };
        timings.fill_s = lap();
        announce(watch, BakeStage::Layers)?;
        let layers = Layers::grow(&surface, &sides, options.layers);
        timings.layers_s = lap();
        Ok(Self {
            surface,
            sides,
            orientation,
            layers,
            sides_asked: options.sides,
            basis,
            watertight: leak.is_none(),
            leak,
            thin_share,
            thin,
            clear_share,
            capped,
            own: None,
            solid: None,
            mass: None,
            beside: Vec::new(),
            timings,
        })
    }

    /// The triangles that the map is of: those of the file, `mesh`, or what was made of them.
    pub fn mesh<'a>(&'a self, mesh: &'a TriangleMesh) -> &'a TriangleMesh {
        let own = self.own.as_ref().unwrap_or(mesh);
        self.capped.as_ref().map_or(own, |capped| &capped.mesh)
    }

    /// The same with all of them facing outward, as far as that is known.
    pub(super) fn outward_mesh<'a>(&'a self, mesh: &'a TriangleMesh) -> Cow<'a, TriangleMesh> {
        let mut outward = Cow::Borrowed(self.mesh(mesh));
        for triangle in 0..outward.triangles.len() {
            if self.orientation.sign(triangle as u32) < 0.0 {
                outward.to_mut().triangles[triangle].swap(1, 2);
            }
        }
        outward
    }

    /// Measures distances and assembles the look-up for the tick. `with_gradients` is needed for
    /// `field = "surface-point"`.
    pub fn field(&mut self, mesh: &TriangleMesh, with_gradients: bool) -> Field {
        match self.field_with(mesh, with_gradients, || Ok::<(), Infallible>(())) {
            Ok(field) => field,
        }
    }

    /// The same; `measured` is called when the distances are there, and may end it.
    pub(crate) fn field_with<E>(
        &mut self,
        mesh: &TriangleMesh,
        with_gradients: bool,
        measured: impl FnOnce() -> Result<(), E>,
    ) -> Result<Field, E> {
        let since = Instant::now();
        let field = if self.beside.is_empty() {
            let samples = self.samples(mesh, with_gradients);
            measured()?;
            let outward = (!self.thin).then(|| self.outward_mesh(mesh));
            Field::new(&self.layers, samples, outward.as_deref())
        } else {
            let (layers, samples) = self.union(mesh, with_gradients);
            measured()?;
            Field::new(&layers, samples, Some(&self.outward_mesh(mesh)))
        };
        self.timings.distance_s = since.elapsed().as_secs_f64();
        Ok(field)
    }

    /// Signed distances at cell centres in the band of [`Self::layers`]; of the map alone, without
    /// those beside it.
    pub fn distances(&self, mesh: &TriangleMesh, with_gradients: bool) -> Distances {
        self.samples(mesh, with_gradients).into()
    }

    /// Layers and distances of the whole part, what is beside the solid among it.
    pub fn of_whole(&self, mesh: &TriangleMesh) -> (Layers, Distances) {
        if self.beside.is_empty() {
            return (self.layers.clone(), self.distances(mesh, false));
        }
        let (layers, samples) = self.union(mesh, false);
        (layers, samples.into())
    }

    fn union(&self, mesh: &TriangleMesh, with_gradients: bool) -> (Layers, Samples) {
        let grid = self.layers.grid;
        let beside = self.beside.iter().map(|beside| (&beside.map, beside.first_brick));
        let members: Vec<Member<'_>> = std::iter::once((self, [0; 3]))
            .chain(beside)
            .map(|(map, first_brick)| Member {
                layers: &map.layers,
                samples: map.samples(mesh, with_gradients),
                first_brick,
                thin: map.thin,
            })
            .collect();
        union(grid, &members)
    }

    fn samples(&self, mesh: &TriangleMesh, with_gradients: bool) -> Samples {
        let signs = if self.thin { Signs::Thin } else { Signs::Solid(&self.orientation) };
        let mut samples =
            Samples::measure(self.mesh(mesh), &self.surface, &self.layers, signs, with_gradients);
        // Beside a lid the winding numbers know the side, not the nearest triangle.
        for (cell, is_inside) in self.capped.iter().flat_map(|capped| &capped.near) {
            let (brick, inside) = self.layers.grid.locate(*cell);
            let Some(slot) = self.layers.slot(brick).filter(|_| self.surface.contains(*cell))
            else {
                continue;
            };
            let value_m = &mut samples.values_m[slot][sample_of(inside)];
            if (*value_m > 0.0) != *is_inside {
                *value_m = -*value_m;
                if let Some(gradients) = samples.gradients.get_mut(slot) {
                    gradients[inside] = -gradients[inside];
                }
            }
        }
        samples
    }
}
