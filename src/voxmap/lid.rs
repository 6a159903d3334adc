//! Lids over holes: where inside and outside meet without a surface between them, triangles are put in.
//!
//! With them the mesh is closed as far as voxels go: the fill stops there, distances are measured to them, points lie on them. So
//! the field is as continuous over a hole as anywhere else, and a lid is felt like the rest of the surface.
//!
//! Winding numbers are whole apart from what the rims of holes add, so the boundary between inside and outside that is not on the
//! surface begins at the rims. It is followed from there, cell by cell; the rest of the volume is not looked at.
//!
//! # Source
//! Ours. Inside is |winding number| ≥ ½, so that parts may face inward and may overlap. The boundary is drawn as a dual surface:
//! one corner per lattice cell between eight voxel centres (the mean of the crossings on its edges), one quadrilateral per pair of
//! neighbours that differ. Such a quadrilateral always cuts the line between the two centres, hence one of the two voxels becomes
//! surface, and a fill over 6 neighbours cannot pass.

use std::collections::HashMap;

use glam::DVec3;
use rayon::prelude::*;

use super::grid::Grid;
use super::orient::connected_pieces;
use super::surface::Surface;
use super::winding::WindingTree;
use crate::mesh::TriangleMesh;
use crate::mesh::validate::MeshReport;

/// A mesh whose holes are closed.
#[derive(Debug)]
pub struct Lidded {
    /// The triangles of the mesh and then those of the lids, over the vertices of the mesh and then those of the lids.
    pub mesh: TriangleMesh,
    /// Connected lids.
    pub n_lids: usize,
    /// Area of the lids, m².
    pub area_m2: f64,
}

/// |winding number| from which a point is inside.
const INSIDE: f64 = 0.5;
/// Cells around a rim in which the search for its lid begins: a hole that is closed by the voxels of its rim has none to find.
const SEED_CELLS: i32 = 2;
/// Voxels between the edge of a lid and the rim up to which the two are joined.
const JOIN_VOXELS: f64 = 4.0;

/// Closes the holes of a mesh; `None` where there is nothing to close.
///
/// The same result whatever the number of threads. Cost: some four winding numbers per cell of the lids, and a hundred per cell
/// of the rims.
pub(super) fn close(mesh: &TriangleMesh, report: &MeshReport, surface: &Surface, winding: &WindingTree<'_>) -> Option<Lidded> {
    let rims: Vec<[DVec3; 2]> =
        report.open_edge_vertices.iter().map(|edge| edge.map(|vertex| mesh.vertices[vertex as usize])).collect();
    let boundary = Boundary::follow(surface, winding, &rims);
    if boundary.pairs.is_empty() {
        return None;
    }
    let grid = &surface.grid;
    let (mut vertices, mut quads) = (Vec::new(), Vec::with_capacity(boundary.pairs.len()));
    let mut numbers: HashMap<[i32; 3], u32> = HashMap::new();
    for (low, axis) in &boundary.pairs {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let mut quad = [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(back_u, back_v)| {
            let mut corner = *low;
            corner[u] -= back_u;
            corner[v] -= back_v;
            *numbers.entry(corner).or_insert_with(|| {
                vertices.push(boundary.corner(grid, corner));
                vertices.len() as u32 - 1
            })
        });
        if !boundary.is_inside(*low).unwrap_or(false) {
            // Faces outward, like the mesh is meant to.
            quad.reverse();
        }
        quads.push(quad);
    }
    let mut triangles: Vec<[u32; 3]> = quads.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).collect();
    let mut roots = connected_pieces(vertices.len(), &triangles);
    roots.sort_unstable();
    roots.dedup();
    join(&quads, &rims, JOIN_VOXELS * grid.voxel_size_m, &mut vertices, &mut triangles);

    let lids = TriangleMesh { vertices, triangles };
    let area_m2 = (0..lids.triangles.len())
        .map(|triangle_idx| {
            let [a, b, c] = lids.corners(triangle_idx);
            0.5 * (b - a).cross(c - a).length()
        })
        .sum();
    let first = mesh.vertices.len() as u32;
    let mut closed = mesh.clone();
    closed.vertices.extend(lids.vertices);
    closed.triangles.extend(lids.triangles.iter().map(|triangle| triangle.map(|vertex| vertex + first)));
    Some(Lidded { mesh: closed, n_lids: roots.len(), area_m2 })
}

/// Joins the edges of lids to the rims near them, so that the seam has no gap.
fn join(quads: &[[u32; 4]], rims: &[[DVec3; 2]], reach_m: f64, vertices: &mut Vec<DVec3>, triangles: &mut Vec<[u32; 3]>) {
    let directed = |quad: &[u32; 4]| {
        let [a, b, c, d] = *quad;
        [(a, b), (b, c), (c, d), (d, a)]
    };
    let mut edges: Vec<(u32, u32)> = quads.iter().flat_map(directed).collect();
    edges.sort_unstable();
    let free: Vec<(u32, u32)> = edges.iter().filter(|(from, to)| edges.binary_search(&(*to, *from)).is_err()).copied().collect();
    let mut ends: Vec<u32> = free.iter().flat_map(|(from, to)| [*from, *to]).collect();
    ends.sort_unstable();
    ends.dedup();
    let buckets = RimBuckets::new(rims, reach_m);
    let feet: Vec<Option<DVec3>> = ends.par_iter().map(|vertex| buckets.nearest(vertices[*vertex as usize])).collect();
    let numbers: Vec<Option<u32>> = feet
        .into_iter()
        .map(|foot| {
            vertices.push(foot?);
            Some(vertices.len() as u32 - 1)
        })
        .collect();
    let foot_of = |vertex: u32| ends.binary_search(&vertex).ok().and_then(|end_idx| numbers[end_idx]);
    for (from, to) in free {
        // The strip runs along the edge the other way round, as a neighbour does.
        let (Some(foot_from), Some(foot_to)) = (foot_of(from), foot_of(to)) else { continue };
        triangles.extend([[to, from, foot_from], [to, foot_from, foot_to]]);
    }
}

/// Rims by place, to find those near a point.
struct RimBuckets<'a> {
    rims: &'a [[DVec3; 2]],
    reach_m: f64,
    buckets: HashMap<[i64; 3], Vec<u32>>,
}

impl<'a> RimBuckets<'a> {
    fn new(rims: &'a [[DVec3; 2]], reach_m: f64) -> Self {
        let mut buckets: HashMap<[i64; 3], Vec<u32>> = HashMap::new();
        for (rim_idx, rim) in (0_u32..).zip(rims) {
            for place in along(*rim, reach_m) {
                let bucket = buckets.entry(Self::place(place, reach_m)).or_default();
                if bucket.last() != Some(&rim_idx) {
                    bucket.push(rim_idx);
                }
            }
        }
        Self { rims, reach_m, buckets }
    }

    fn place(point: DVec3, reach_m: f64) -> [i64; 3] {
        (point / reach_m).floor().as_i64vec3().to_array()
    }

    /// Nearest point of a rim within reach.
    fn nearest(&self, point: DVec3) -> Option<DVec3> {
        let [x, y, z] = Self::place(point, self.reach_m);
        let around = (0..27).map(|idx| [x + idx / 9 - 1, y + idx / 3 % 3 - 1, z + idx % 3 - 1]);
        let near = around.filter_map(|place| self.buckets.get(&place)).flatten().map(|rim_idx| {
            let [from, to] = self.rims[*rim_idx as usize];
            let edge = to - from;
            let share = (edge.dot(point - from) / edge.length_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
            from + share * edge
        });
        near.min_by(|one, other| one.distance_squared(point).total_cmp(&other.distance_squared(point)))
            .filter(|foot| foot.distance(point) <= self.reach_m)
    }
}

/// Points along an edge, at most half a step apart, both ends included.
fn along([from, to]: [DVec3; 2], step: f64) -> impl Iterator<Item = DVec3> {
    let n_steps = (from.distance(to) / (0.5 * step)).ceil().max(1.0) as u32;
    (0..=n_steps).map(move |k| from.lerp(to, f64::from(k) / f64::from(n_steps)))
}

/// The part of the boundary between inside and outside that lies off the surface.
struct Boundary {
    /// |winding number| at the centres of free cells near it.
    known: HashMap<[i32; 3], f64>,
    /// Neighbours of which one is inside and one is not: the lower cell, and the axis. Ascending.
    pairs: Vec<([i32; 3], usize)>,
}

impl Boundary {
    /// Follows the boundary from the rims on.
    fn follow(surface: &Surface, winding: &WindingTree<'_>, rims: &[[DVec3; 2]]) -> Self {
        let grid = &surface.grid;
        let mut rim_cells: Vec<[i32; 3]> = rims
            .iter()
            .flat_map(|rim| along(rim.map(|end| grid.to_cells(end)), 1.0))
            .map(|point| point.floor().as_ivec3().to_array())
            .collect();
        rim_cells.sort_unstable();
        rim_cells.dedup();
        let mut wave: Vec<[i32; 3]> = rim_cells
            .iter()
            .flat_map(|[x, y, z]| {
                let reach = -SEED_CELLS..=SEED_CELLS;
                reach.clone().flat_map(move |dx| {
                    reach.clone().flat_map({
                        let reach = reach.clone();
                        move |dy| reach.clone().map(move |dz| [x + dx, y + dy, z + dz])
                    })
                })
            })
            .collect();
        let mut boundary = Self { known: HashMap::new(), pairs: Vec::new() };
        while !wave.is_empty() {
            wave.sort_unstable();
            wave.dedup();
            let new: Vec<([i32; 3], f64)> = wave
                .par_iter()
                .filter(|cell| grid.contains(**cell) && !boundary.known.contains_key(*cell) && !surface.contains(**cell))
                .map(|cell| (*cell, winding.at(grid.center_map(*cell)).abs()))
                .collect();
            boundary.known.extend(new.iter().copied());
            wave.clear();
            for (cell, _) in new {
                for (axis, step) in (0..3).flat_map(|axis| [(axis, 0), (axis, -1)]) {
                    let mut low = cell;
                    low[axis] += step;
                    if boundary.crossing(low, axis).is_some() {
                        boundary.pairs.push((low, axis));
                        wave.extend(around_pair(low, axis));
                    }
                }
            }
        }
        boundary.pairs.sort_unstable();
        boundary.pairs.dedup();
        boundary
    }

    fn is_inside(&self, cell: [i32; 3]) -> Option<bool> {
        self.known.get(&cell).map(|winding| *winding >= INSIDE)
    }

    /// Where on the way from a cell to the next along an axis the boundary is crossed, 0 to 1; `None` where it is not.
    fn crossing(&self, low: [i32; 3], axis: usize) -> Option<f64> {
        let mut high = low;
        high[axis] += 1;
        let (from, to) = (*self.known.get(&low)?, *self.known.get(&high)?);
        ((from >= INSIDE) != (to >= INSIDE)).then(|| ((INSIDE - from) / (to - from)).clamp(0.0, 1.0))
    }

    /// Corner of the boundary in the lattice cell between eight voxel centres, mesh frame, m.
    fn corner(&self, grid: &Grid, lowest: [i32; 3]) -> DVec3 {
        let (mut sum, mut count) = (DVec3::ZERO, 0.0);
        for (axis, k) in (0..3).flat_map(|axis| (0..4).map(move |k| (axis, k))) {
            let mut low = lowest;
            low[(axis + 1) % 3] += k & 1;
            low[(axis + 2) % 3] += k >> 1;
            if let Some(share) = self.crossing(low, axis) {
                sum += grid.center_map(low) + DVec3::AXES[axis] * (share * grid.voxel_size_m);
                count += 1.0;
            }
        }
        sum / count
    }
}

/// The 18 cells of the four lattice cells around a pair of neighbours.
fn around_pair(low: [i32; 3], axis: usize) -> impl Iterator<Item = [i32; 3]> {
    (0..18).map(move |idx| {
        let mut cell = low;
        cell[axis] += idx % 2;
        cell[(axis + 1) % 3] += idx / 2 % 3 - 1;
        cell[(axis + 2) % 3] += idx / 6 - 1;
        cell
    })
}
