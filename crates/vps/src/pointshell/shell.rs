//! The pointshell as the tick reads it.

mod file;

use glam::{DVec3, Vec3};

use super::build::Placed;
pub use super::lanes::{LANES, Lanes, Lanes3};
use super::tree::Tree;
use crate::halving::Site;
use crate::parallel;
use crate::storage::SharedSlice;

/// Points and normals of the tool, and the tree over them.
///
/// Frame: tool axes, origin at the **centre of mass**, so that an arm r_i is the point itself.
/// Units: m. A clone is another handle on the same arrays.
#[derive(Clone, Debug)]
pub struct Shell {
    /// `[n_points / 16, rounded up]`, 64-byte aligned: positions, m. Unused lanes of the last block
    /// hold NaN, which is no contact.
    positions: SharedSlice<Lanes3>,
    /// Same layout: unit normals, pointing **into** the tool; zero for points of a skin, which has
    /// no inside.
    normals: SharedSlice<Lanes3>,
    /// Same layout: surface that each point stands for, s²; 0 of probes.
    weights: SharedSlice<Lanes>,
    /// Same layout: half axes of facets, m; zero of points without extent and in unused lanes.
    /// Empty where no point has any.
    half_axes: SharedSlice<[Lanes3; 2]>,
    /// `[n_blocks]`, or empty likewise, m: see [`Self::reaches_m`].
    reaches_m: SharedSlice<f32>,
    tree: Tree,
    n_points: usize,
    radius_m: f64,
    voxel_size_m: f64,
    /// Some points have no normal.
    is_skin: bool,
    /// The longest of the reaches, m.
    reach_m: f32,
}

/// An interpolated distance grows by no more than this with the way: √3 between exact samples, and
/// by a tenth of that more where these are moved.
pub(crate) const STEEPEST: f32 = 1.732_051 * (1.0 + 2.0 * crate::voxmap::field::MOST_MOVED_CELLS);
/// What rounding may take from a reach.
const REACH_MARGIN: f32 = 1.0 + 1e-5;

impl Shell {
    /// Lays out points (about the centre of mass, m) and inward unit normals in the order given,
    /// which is also that of the tree's leaves; each stands for one s² and has no extent. Cold.
    pub fn new(points: &[(DVec3, DVec3)], voxel_size_m: f64) -> Self {
        let blocks = |of: fn(&(DVec3, DVec3)) -> DVec3| {
            points
                .chunks(LANES)
                .map(|chunk| block(chunk, |point| of(point).as_vec3()))
                .collect::<Vec<_>>()
        };
        let positions = blocks(|point| point.0);
        let normals = blocks(|point| point.1);
        let weights = vec![Lanes([1.0; LANES]); positions.len()];
        let tree = Tree::over(&positions, &weights, points.len());
        let radius_m = points.iter().map(|point| point.0.length()).fold(0.0, f64::max);
        Self {
            positions: positions.into(),
            normals: normals.into(),
            weights: weights.into(),
            half_axes: Vec::new().into(),
            reaches_m: Vec::new().into(),
            tree,
            n_points: points.len(),
            radius_m,
            voxel_size_m,
            is_skin: points.iter().any(|point| point.1 == DVec3::ZERO),
            reach_m: 0.0,
        }
    }

    /// Lays out arranged sites, and what their numbers name; the tree is still to come. Cold.
    pub(super) fn lay_out(placed: &Placed, voxel_size_m: f64) -> Self {
        let Placed { sites, normals, weights, half_axes, tally } = placed;
        let axes = |chunk: &[Site]| {
            [0, 1].map(|which| {
                let mut lanes = Lanes3::ZERO;
                for (lane, site) in chunk.iter().enumerate() {
                    lanes.set(lane, half_axes[site.idx as usize][which]);
                }
                lanes
            })
        };
        let half_axes: Vec<[Lanes3; 2]> = if half_axes.is_empty() {
            Vec::new()
        } else {
            parallel::map_chunks(sites, LANES, axes)
        };
        let reaches_m: Vec<f32> = half_axes.iter().map(reach_m).collect();
        Self {
            positions: parallel::map_chunks(sites, LANES, |chunk| block(chunk, Site::position))
                .into(),
            normals: parallel::map_chunks(sites, LANES, |chunk| {
                block(chunk, |site| normals[site.idx as usize])
            })
            .into(),
            weights: parallel::map_chunks(sites, LANES, |chunk| {
                Lanes(core::array::from_fn(|lane| {
                    chunk.get(lane).map_or(0.0, |site| weights[site.idx as usize])
                }))
            })
            .into(),
            reach_m: longest_m(&reaches_m),
            half_axes: half_axes.into(),
            reaches_m: reaches_m.into(),
            tree: Tree::default(),
            n_points: sites.len(),
            radius_m: tally.radius_m,
            voxel_size_m,
            is_skin: normals.contains(&Vec3::ZERO),
        }
    }

    /// The same shell with the tree over it. Cold.
    pub(super) fn with_tree(mut self) -> Self {
        self.tree = Tree::over(&self.positions, &self.weights, self.n_points);
        self
    }

    /// The tree: spheres around runs of points.
    pub fn tree(&self) -> &Tree {
        &self.tree
    }

    /// Positions, 16 in a block, m; unused lanes of the last block hold NaN.
    pub fn positions(&self) -> &[Lanes3] {
        &self.positions
    }

    /// Inward unit normals, laid out like [`Self::positions`]; zero for points of a skin.
    pub fn normals(&self) -> &[Lanes3] {
        &self.normals
    }

    /// Surface that each point stands for, s², laid out like [`Self::positions`]; 1 of each in the
    /// way of the paper, 0 of probes, which lie on edges and corners and press nothing.
    pub fn weights(&self) -> &[Lanes] {
        &self.weights
    }

    /// Half axes of the rectangle that a facet counts as, m, 16 in a block, laid out like
    /// [`Self::positions`]; zero of points without extent. Empty where no point has any.
    pub fn half_axes(&self) -> &[[Lanes3; 2]] {
        &self.half_axes
    }

    /// Of each block the depth, m, that a corner of one of its facets may have beyond that of its
    /// centroid in any field, at most: 1.1·√3 times the longest half diagonal. Empty where no point has
    /// an extent.
    pub fn reaches_m(&self) -> &[f32] {
        &self.reaches_m
    }

    /// The longest of [`Self::reaches_m`], m; 0 where no point has an extent.
    pub fn reach_m(&self) -> f32 {
        self.reach_m
    }

    /// True when some points have no normal: those of a thin skin.
    pub fn is_skin(&self) -> bool {
        self.is_skin
    }

    /// Blocks of positions and of normals, side by side.
    pub fn blocks(&self) -> impl Iterator<Item = (&Lanes3, &Lanes3)> {
        self.positions.iter().zip(self.normals.iter())
    }

    /// Position (about the centre of mass, m) and inward normal of each point.
    pub fn points(&self) -> impl Iterator<Item = (Vec3, Vec3)> + '_ {
        self.blocks()
            .flat_map(|(positions, normals)| {
                (0..LANES).map(move |lane| (positions.get(lane), normals.get(lane)))
            })
            .take(self.n_points)
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.n_points
    }

    /// True when there is no point.
    pub fn is_empty(&self) -> bool {
        self.n_points == 0
    }

    /// r_max, the largest distance of a point from the centre of mass, m.
    pub fn radius_m(&self) -> f64 {
        self.radius_m
    }

    /// Spacing of the points: the voxel edge of the map that they come from, m.
    pub fn voxel_size_m(&self) -> f64 {
        self.voxel_size_m
    }

    /// Size of the arrays, bytes.
    pub fn heap_bytes(&self) -> usize {
        let Self {
            positions,
            normals,
            weights,
            half_axes,
            reaches_m,
            tree,
            n_points: _,
            radius_m: _,
            voxel_size_m: _,
            is_skin: _,
            reach_m: _,
        } = self;
        size_of_val(&**positions)
            + size_of_val(&**normals)
            + size_of_val(&**weights)
            + size_of_val(&**half_axes)
            + size_of_val(&**reaches_m)
            + tree.heap_bytes()
    }
}

/// One block of up to [`LANES`] vectors, NaN beyond them.
fn block<T>(chunk: &[T], of: impl Fn(&T) -> Vec3) -> Lanes3 {
    let mut lanes = [[f32::NAN; LANES]; 3];
    for (lane, item) in chunk.iter().enumerate() {
        for (lanes, coordinate) in lanes.iter_mut().zip(of(item).to_array()) {
            lanes[lane] = coordinate;
        }
    }
    let [x, y, z] = lanes.map(Lanes);
    Lanes3 { x, y, z }
}

/// See [`Shell::reaches_m`].
fn reach_m([a, b]: &[Lanes3; 2]) -> f32 {
    let squares =
        (0..LANES).map(|lane| a.get(lane).length_squared() + b.get(lane).length_squared());
    STEEPEST * REACH_MARGIN * squares.fold(0.0, f32::max).sqrt()
}

fn longest_m(reaches_m: &[f32]) -> f32 {
    reaches_m.iter().copied().fold(0.0, f32::max)
}
