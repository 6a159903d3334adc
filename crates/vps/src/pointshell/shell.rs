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
    /// no inside: these count as edges at any depth.
    normals: SharedSlice<Lanes3>,
    /// Same layout: surface that each point stands for, s².
    weights: SharedSlice<Lanes>,
    /// `[n_blocks]`, one bit per lane: points on edges and corners.
    edges: SharedSlice<u16>,
    tree: Tree,
    n_points: usize,
    radius_m: f64,
    voxel_size_m: f64,
    edge_depth_m: f32,
}

impl Shell {
    /// Lays out points (about the centre of mass, m) and inward unit normals in the order given,
    /// which is also that of the tree's leaves; each stands for one s², none lies on an edge. Cold.
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
            edges: vec![0; positions.len()].into(),
            positions: positions.into(),
            normals: normals.into(),
            weights: weights.into(),
            tree,
            n_points: points.len(),
            radius_m,
            voxel_size_m,
            edge_depth_m: f32::INFINITY,
        }
    }

    /// Lays out arranged sites, and what their numbers name; the tree is still to come. Cold.
    pub(super) fn lay_out(placed: &Placed, voxel_size_m: f64) -> Self {
        let Placed { sites, normals, weights, on_edge, edge_depth_m, tally } = placed;
        let edges = |chunk: &[Site]| {
            (0..).zip(chunk).fold(0, |edges, (lane, site)| {
                edges | u16::from(on_edge[site.idx as usize]) << lane
            })
        };
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
            edges: parallel::map_chunks(sites, LANES, edges).into(),
            tree: Tree::default(),
            n_points: sites.len(),
            radius_m: tally.radius_m,
            voxel_size_m,
            edge_depth_m: *edge_depth_m as f32,
        }
    }

    /// The same shell with the tree over it. Cold.
    pub(super) fn with_tree(mut self) -> Self {
        self.tree = Tree::over(&self.positions, &self.weights, self.n_points);
        self
    }

    /// The same shell, none of its points on an edge. Cold.
    #[must_use]
    pub fn without_edges(self) -> Self {
        Self { edges: vec![0; self.positions.len()].into(), ..self }
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
    /// way of the paper.
    pub fn weights(&self) -> &[Lanes] {
        &self.weights
    }

    /// Depth from which a point on an edge pushes along its own normal, m. Shallower, too little of
    /// the surface around an edge is immersed to say which way is out; deeper, all that is immersed
    /// pushes the tool along the way that its normals have together.
    pub fn edge_depth_m(&self) -> f32 {
        self.edge_depth_m
    }

    /// Points on edges and corners, where no normal says which way is out: one bit per lane of each
    /// block.
    pub fn edges(&self) -> &[u16] {
        &self.edges
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
            edges,
            tree,
            n_points: _,
            radius_m: _,
            voxel_size_m: _,
            edge_depth_m: _,
        } = self;
        size_of_val(&**positions)
            + size_of_val(&**normals)
            + size_of_val(&**weights)
            + size_of_val(&**edges)
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
