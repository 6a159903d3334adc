//! Triangles in, voxmap out: the stages in order.

use core::ops::ControlFlow;
use std::time::Instant;

use super::distance::{Distances, Samples, Signs, sample_of};
use super::field::Field;
use super::fill::Sides;
use super::grid::{Grid, GridError, SURFACE_VOXELS_MAX};
use super::hole_cap::CappedMesh;
use super::inside_test::{InsideBasis, InsideTest, Verdict};
use super::layers::Layers;
use super::leak::Leak;
use super::orient::Orientation;
use super::surface::{Navigation, Surface};
use crate::mesh::TriangleMesh;
use crate::mesh::validate::MeshReport;

/// What to build.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Voxel edge s, m.
    pub voxel_size_m: f64,
    /// Layers on each side, 1 to 126.
    pub layers: u32,
    /// How candidates are walked: `None` takes [`Navigation::AUTO`]. The result is the same.
    pub navigation: Option<Navigation>,
    /// How to distinguish inside and outside.
    pub sides: InsideTest,
}

impl Options {
    /// Layers on each side where none are asked for: those of a scene file.
    pub const DEFAULT_LAYERS: u32 = 8;

    /// Voxels of this edge, m, and for the rest what a scene file has where it says nothing.
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
    /// Distances and field.
    Distance,
    /// Projection of points.
    Pointshell,
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
    /// Grid set-up.
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
    /// How outside and inside were distinguished.
    pub basis: InsideBasis,
    /// The fill of the mesh as it is did not leak.
    pub watertight: bool,
    /// Where it leaked; `None`: it did not.
    pub leak: Option<Leak>,
    /// Share of the surface that is thinner than the voxels resolve.
    pub thin_share: f64,
    /// Treated as a thin two-sided skin.
    pub thin: bool,
    /// Share of the places beside the surface with a clear winding number; `None` where it was not
    /// asked.
    pub clear_share: Option<f64>,
    /// The mesh with lids on its holes, where they were needed.
    pub capped: Option<CappedMesh>,
    /// Seconds per stage.
    pub timings: StageTimes,
}

impl Volume {
    /// Classifies the volume of a mesh: surface, fill, leak check, orientation, layers.
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
        let mut timings = StageTimes::default();
        let mut since = Instant::now();
        let mut lap = || {
            let lap_s = since.elapsed().as_secs_f64();
            since = Instant::now();
            lap_s
        };
        let (low, high) = mesh.bounds().unwrap_or_default();
        let grid = Grid::around(low, high, options.voxel_size_m, options.layers)?;
        let navigation = options.navigation.unwrap_or(Navigation::AUTO);
        timings.init_s = lap();
        announce(&mut watch, BakeStage::Surface)?;
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
        announce(&mut watch, BakeStage::Fill)?;
        let verdict = Verdict::reach(mesh, report, surface, options.sides);
        let Verdict { surface, sides, basis, leak, thin_share, clear_share, capped } = verdict;
        let thin = basis == InsideBasis::Thin;
        let mesh = capped.as_ref().map_or(mesh, |capped| &capped.mesh);
        let orientation = if thin {
            Orientation::as_filed(mesh.triangles.len())
        } else {
            Orientation::judge(mesh, report, &surface, &sides)
        };
        timings.fill_s = lap();
        announce(&mut watch, BakeStage::Layers)?;
        let layers = Layers::grow(&surface, &sides, options.layers);
        timings.layers_s = lap();
        Ok(Self {
            surface,
            sides,
            orientation,
            layers,
            basis,
            watertight: leak.is_none(),
            leak,
            thin_share,
            thin,
            clear_share,
            capped,
            timings,
        })
    }

    /// The triangles that the surface voxels are of: `mesh`, which the map was built from, or the
    /// one with lids instead.
    pub fn mesh<'a>(&'a self, mesh: &'a TriangleMesh) -> &'a TriangleMesh {
        self.capped.as_ref().map_or(mesh, |capped| &capped.mesh)
    }

    /// Measures distances and assembles the look-up for the tick. `with_gradients` is needed for
    /// `field = "surface-point"`.
    pub fn field(&mut self, mesh: &TriangleMesh, with_gradients: bool) -> Field {
        let since = Instant::now();
        let samples = self.samples(mesh, with_gradients);
        let field = Field::new(&self.layers, samples, self.thin);
        self.timings.distance_s = since.elapsed().as_secs_f64();
        field
    }

    /// Signed distances at cell centres in the band.
    pub fn distances(&self, mesh: &TriangleMesh, with_gradients: bool) -> Distances {
        self.samples(mesh, with_gradients).into()
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
