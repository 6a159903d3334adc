//! Voxmap in, pointshell out: the stages in order.

use core::ops::Range;
use std::time::{Duration, Instant};

use glam::{DVec3, Vec3};

use super::bins::Bins;
use super::cluster::arrange;
use super::facets::{self, FacetPoint};
use super::levels::{LevelReport, levels};
use super::normals::{BrickSums, normal};
use super::project::Scratch;
use super::shell::Shell;
use crate::halving::Site;
use crate::mesh::TriangleMesh;
use crate::parallel;
use crate::voxmap::Volume;

/// Which points a shell has.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Points {
    /// One for each facet, which is what one face of the mesh leaves in a voxel, with the facet's
    /// area, direction and extent; edges and corners have probes, which are points without area.
    /// Force does not depend on how the part lies in its grid.
    #[default]
    Facets,
    /// One for each surface voxel, all alike, with normals from the layers around it: the way of
    /// Sagardia2008. The force of a face grows with
    /// |n_x| + |n_y| + |n_z|, n its normal in the grid.
    Voxels,
}

impl Points {
    /// The names of the scene file.
    ///
    /// # Examples
    /// ```
    /// # use vps::Points;
    /// let of_text = Points::NAMES.into_iter().find(|(name, _)| *name == "facets");
    /// assert_eq!(of_text, Some(("facets", Points::default())));
    /// ```
    pub const NAMES: [(&'static str, Self); 2] =
        [("facets", Self::Facets), ("voxels", Self::Voxels)];
}

/// What was built.
#[derive(Clone, Debug, Default)]
pub struct ShellReport {
    /// Points.
    pub points: usize,
    /// Points whose projection landed inside a triangle; with facets, the others.
    pub phase1_points: usize,
    /// Points on edges and corners, for voxels that phase 1 left empty; with facets, points of the
    /// voxels that hold an edge or a corner.
    pub phase2_points: usize,
    /// Levels of the tree, from coarse to fine; the last holds all points.
    pub tree_levels: Vec<LevelReport>,
    /// Seconds for projection and layout.
    pub project_s: f64,
    /// Seconds for normals.
    pub normals_s: f64,
    /// Seconds for the order of the points and the tree over them.
    pub tree_s: f64,
}

/// Bricks that one task handles: some thousand points.
const BRICKS_PER_TASK: usize = 32;

/// Points in a brick below which its normals are looked up one by one.
const POINTS_WORTH_SUMS: u32 = 6;

/// Builds the shell of an object about `center_of_mass_tool` (tool frame, m), a point for each
/// surface voxel: the way of the paper.
///
/// Points come in the order of the tree's leaves, so that neighbours in memory are neighbours in
/// space. Runs on the current rayon pool. Cost: linear in the number of points, but for the
/// ordering, which is n log n.
pub fn build(
    mesh: &TriangleMesh,
    map: &Volume,
    center_of_mass_tool: DVec3,
) -> (Shell, ShellReport) {
    build_with(Points::Voxels, mesh, map, center_of_mass_tool)
}

/// The same with points of either kind. A thin skin has no inside that facets could face: its
/// points are those of voxels, which count with the area that a voxel of their face stands for.
pub fn build_with(
    kind: Points,
    mesh: &TriangleMesh,
    map: &Volume,
    center_of_mass_tool: DVec3,
) -> (Shell, ShellReport) {
    let voxel_size_m = map.surface.grid.voxel_size_m;
    let mut since = Instant::now();
    let mut lap_s = || core::mem::replace(&mut since, Instant::now()).elapsed().as_secs_f64();
    let mut placed = Placed::of(kind, mesh, map, center_of_mass_tool);
    for beside in &map.beside {
        placed.append(Placed::of(kind, mesh, &beside.map, center_of_mass_tool));
    }
    let place_s = lap_s();
    arrange(&mut placed.sites);
    let arrange_s = lap_s();
    let shell = Shell::lay_out(&placed, voxel_size_m);
    let Placed { sites, tally, .. } = placed;
    let lay_out_s = lap_s();
    let shell = shell.with_tree();
    let tree_levels = levels(&shell);
    let spheres_s = lap_s();

    // Both are done brick by brick: the time of the pass is shared out as the threads spent it.
    let normals_s = place_s * tally.in_normals.as_secs_f64()
        / (tally.in_normals + tally.in_projection).as_secs_f64().max(1e-9);
    let report = ShellReport {
        points: sites.len(),
        phase1_points: sites.len() - tally.phase2_points,
        phase2_points: tally.phase2_points,
        tree_levels,
        project_s: (place_s - normals_s) + lay_out_s,
        normals_s,
        tree_s: arrange_s + spheres_s,
    };
    (shell, report)
}

/// Points in order of rank.
pub(super) struct Placed {
    pub(super) sites: Vec<Site>,
    /// Inward unit normals, tool axes.
    pub(super) normals: Vec<Vec3>,
    /// Surface that each stands for, s².
    pub(super) weights: Vec<f32>,
    /// Half axes of each, m, tool axes; of points without extent none or zero.
    pub(super) half_axes: Vec<[Vec3; 2]>,
    pub(super) tally: Tally,
}

impl Placed {
    /// The points of one map.
    fn of(kind: Points, mesh: &TriangleMesh, map: &Volume, center_of_mass_tool: DVec3) -> Self {
        let mesh = map.mesh(mesh);
        let bins = Bins::sort(mesh, &map.surface);
        if kind == Points::Facets && !map.thin {
            return place_facets(mesh, map, &bins, center_of_mass_tool);
        }
        let mut placed = place(mesh, map, &bins, center_of_mass_tool).weighted(kind);
        if map.thin {
            // Neither side of a skin is out.
            placed.normals.fill(Vec3::ZERO);
        }
        placed
    }

    /// Adds the points of another map.
    fn append(&mut self, other: Self) {
        let Self { sites, normals, weights, half_axes, tally } = other;
        let n_before = self.sites.len();
        if !half_axes.is_empty() || !self.half_axes.is_empty() {
            self.half_axes.resize(n_before, [Vec3::ZERO; 2]);
            self.half_axes.extend(half_axes);
            self.half_axes.resize(n_before + sites.len(), [Vec3::ZERO; 2]);
        }
        self.sites.extend(sites.iter().map(|site| site.later(n_before as u32)));
        self.normals.extend(normals);
        self.weights.extend(weights);
        self.tally = self.tally.plus(tally);
    }

    /// Points of voxels with what they stand for: all the same in the paper; else what a face has
    /// of area for each voxel that it touches.
    fn weighted(mut self, kind: Points) -> Self {
        let area = |normal: Vec3| {
            if kind == Points::Voxels { 1.0 } else { 1.0 / normal.abs().element_sum() }
        };
        self.weights = parallel::map(self.normals.len(), 1 << 12, |idx| area(self.normals[idx]));
        self
    }
}

/// What every task adds up; no sum depends on its order.
#[derive(Clone, Copy, Default)]
pub(super) struct Tally {
    phase2_points: usize,
    pub(super) radius_m: f64,
    in_projection: Duration,
    in_normals: Duration,
}

impl Tally {
    fn plus(self, other: Self) -> Self {
        Self {
            phase2_points: self.phase2_points + other.phase2_points,
            radius_m: self.radius_m.max(other.radius_m),
            in_projection: self.in_projection + other.in_projection,
            in_normals: self.in_normals + other.in_normals,
        }
    }
}

/// A run of bricks and the places of its points.
struct Task<'a> {
    slots: Range<usize>,
    sites: &'a mut [Site],
    normals: &'a mut [Vec3],
    first_idx: u32,
}

/// Projects and turns to a normal every surface voxel, brick by brick while the brick is in cache.
fn place(mesh: &TriangleMesh, map: &Volume, bins: &Bins, center_of_mass_tool: DVec3) -> Placed {
    let surface = &map.surface;
    let grid = &map.surface.grid;
    let mut sites = parallel::map(surface.n_voxels, 1, |_| Site::default());
    let mut normals = parallel::map(surface.n_voxels, 1, |_| Vec3::ZERO);
    let mut tasks = Vec::with_capacity(surface.bricks.len() / BRICKS_PER_TASK + 1);
    let mut sites_left = &mut sites[..];
    let mut normals_left = &mut normals[..];
    let mut first_idx = 0;
    for first in (0..surface.bricks.len()).step_by(BRICKS_PER_TASK) {
        let slots = first..(first + BRICKS_PER_TASK).min(surface.bricks.len());
        let n_points: usize = surface.masks[slots.clone()]
            .iter()
            .flatten()
            .map(|word| word.count_ones() as usize)
            .sum();
        let (sites, normals);
        (sites, sites_left) = sites_left.split_at_mut(n_points);
        (normals, normals_left) = normals_left.split_at_mut(n_points);
        tasks.push(Task { slots, sites, normals, first_idx });
        first_idx += n_points as u32;
    }
    let run = |(scratch, sums): &mut (Scratch, BrickSums), _, task: &mut Task<'_>| {
        let mut tally = Tally::default();
        let mut places = task.sites.iter_mut().zip(&mut *task.normals).zip(task.first_idx..);
        for slot in task.slots.clone() {
            let start = Instant::now();
            let points = scratch.project(mesh, surface, bins, slot);
            let projected = Instant::now();
            let n_points: u32 = surface.masks[slot].iter().map(|word| word.count_ones()).sum();
            if !map.thin && n_points >= POINTS_WORTH_SUMS {
                sums.form(&map.layers, surface.bricks[slot] as usize);
            }
            for (point, ((site, to), idx)) in points.zip(&mut places) {
                let arm = grid.origin_m + point.cells * grid.voxel_size_m - center_of_mass_tool;
                *site = Site::new(arm.as_vec3(), idx);
                *to = normal(mesh, map, sums, &point).as_vec3();
                tally.radius_m = tally.radius_m.max(arm.length());
                tally.phase2_points += usize::from(point.on_boundary);
            }
            tally.in_projection += projected - start;
            tally.in_normals += projected.elapsed();
        }
        tally
    };
    let tallies = parallel::map_mut_with(&mut tasks, 1, Default::default, run);
    let tally = tallies.into_iter().fold(Tally::default(), Tally::plus);
    Placed { sites, normals, weights: Vec::new(), half_axes: Vec::new(), tally }
}

/// Finds the facets of each brick.
fn place_facets(
    mesh: &TriangleMesh,
    map: &Volume,
    bins: &Bins,
    center_of_mass_tool: DVec3,
) -> Placed {
    let grid = &map.surface.grid;
    let n_bricks = map.surface.bricks.len();
    let since = Instant::now();
    let found = parallel::map_with(
        n_bricks.div_ceil(BRICKS_PER_TASK),
        1,
        facets::Scratch::default,
        |scratch, task| {
            let mut points: Vec<FacetPoint> = Vec::new();
            for slot in task * BRICKS_PER_TASK..((task + 1) * BRICKS_PER_TASK).min(n_bricks) {
                scratch.find(mesh, map, bins, slot, &mut points);
            }
            points
        },
    );
    let points: Vec<&FacetPoint> = found.iter().flatten().collect();
    let arm =
        |point: &FacetPoint| grid.origin_m + point.cells * grid.voxel_size_m - center_of_mass_tool;
    let tally = Tally {
        phase2_points: points.iter().filter(|point| point.on_edge).count(),
        radius_m: points.iter().map(|point| arm(point).length()).fold(0.0, f64::max),
        in_projection: since.elapsed(),
        in_normals: Duration::ZERO,
    };
    Placed {
        sites: points
            .iter()
            .zip(0..)
            .map(|(point, idx)| Site::new(arm(point).as_vec3(), idx))
            .collect(),
        normals: points.iter().map(|point| point.inward.as_vec3()).collect(),
        weights: points.iter().map(|point| point.weight as f32).collect(),
        half_axes: points
            .iter()
            .map(|point| point.half_axes.map(|axis| (axis * grid.voxel_size_m).as_vec3()))
            .collect(),
        tally,
    }
}
