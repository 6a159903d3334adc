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
//! surface, and a fill over 6 neighbours cannot pass. Where a lid ends at the surface, two voxels that differ may still touch in
//! an edge or a corner; a small patch between them makes one of them surface, as layers need it.

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
    /// Cells near lids and rims, and whether their centres are inside: what the nearest triangle says at an edge of a lid is chance.
    pub(super) near: Vec<([i32; 3], bool)>,
}

/// |winding number| from which a point is inside.
const INSIDE: f64 = 0.5;
/// Cells around a rim in which the search for its lid begins: a hole that is closed by the voxels of its rim has none to find.
const SEED_CELLS: i32 = 2;
/// Halvings of the way between two centres, of which one is in a surface voxel, to tell a boundary from the surface: at the surface
/// the winding number jumps by 1, however short the way.
const BISECTIONS: u32 = 4;
/// Change over the shortest way that counts as a jump.
const JUMP: f64 = 0.6;

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
    let triangles = quads.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).collect();
    let mut lids = TriangleMesh { vertices, triangles };
    let mut pieces = connected_pieces(lids.vertices.len(), &lids.triangles);
    pieces.sort_unstable();
    pieces.dedup();
    let area_m2 = (0..lids.triangles.len())
        .map(|triangle_idx| {
            let [a, b, c] = lids.corners(triangle_idx);
            0.5 * (b - a).cross(c - a).length()
        })
        .sum();
    for (inside, outside) in &boundary.diagonals(surface) {
        let first = lids.vertices.len() as u32;
        lids.vertices.extend(patch(grid, *inside, *outside));
        lids.triangles.push([first, first + 1, first + 2]);
    }
    let first = mesh.vertices.len() as u32;
    let mut closed = mesh.clone();
    closed.vertices.extend(lids.vertices);
    closed.triangles.extend(lids.triangles.iter().map(|triangle| triangle.map(|vertex| vertex + first)));
    let mut near: Vec<_> = boundary.known.iter().map(|(cell, winding)| (*cell, winding.abs() >= INSIDE)).collect();
    near.sort_unstable();
    Some(Lidded { mesh: closed, n_lids: pieces.len(), area_m2, near })
}

/// Points along an edge, at most half a unit apart, both ends included.
fn along([from, to]: [DVec3; 2]) -> impl Iterator<Item = DVec3> {
    let n_steps = (2.0 * from.distance(to)).ceil().max(1.0) as u32;
    (0..=n_steps).map(move |k| from.lerp(to, f64::from(k) / f64::from(n_steps)))
}

/// The way from a cell to the next along an axis.
type Step = ([i32; 3], usize);

/// The part of the boundary between inside and outside that lies off the surface.
struct Boundary {
    /// Winding number at the centres of cells near it and near the rims.
    known: HashMap<[i32; 3], f64>,
    /// Where on the way, 0 to 1, the boundary is crossed; `None` where the surface itself lies between.
    crossings: HashMap<Step, Option<f64>>,
    /// Steps that cross it. Ascending.
    pairs: Vec<Step>,
}

impl Boundary {
    /// Follows the boundary from the rims on.
    fn follow(surface: &Surface, winding: &WindingTree<'_>, rims: &[[DVec3; 2]]) -> Self {
        let grid = &surface.grid;
        let mut rim_cells: Vec<[i32; 3]> = rims
            .iter()
            .flat_map(|rim| along(rim.map(|end| grid.to_cells(end))))
            .map(|point| point.floor().as_ivec3().to_array())
            .collect();
        rim_cells.sort_unstable();
        rim_cells.dedup();
        let n_around = 2 * SEED_CELLS + 1;
        let around = (0..n_around.pow(3))
            .map(|idx| [idx / (n_around * n_around), idx / n_around % n_around, idx % n_around].map(|step| step - SEED_CELLS));
        let mut wave: Vec<[i32; 3]> = rim_cells.iter().flat_map(|cell| around.clone().map(|step| moved(*cell, step))).collect();
        let mut boundary = Self { known: HashMap::new(), crossings: HashMap::new(), pairs: Vec::new() };
        while !wave.is_empty() {
            wave.sort_unstable();
            wave.dedup();
            let new: Vec<([i32; 3], f64)> = wave
                .par_iter()
                .filter(|cell| grid.contains(**cell) && !boundary.known.contains_key(*cell))
                .map(|cell| (*cell, winding.at(grid.center_map(*cell))))
                .collect();
            boundary.known.extend(new.iter().copied());
            let mut steps: Vec<Step> = new
                .iter()
                .flat_map(|(cell, _)| {
                    (0..3).flat_map(|axis| {
                        let mut before = *cell;
                        before[axis] -= 1;
                        [(*cell, axis), (before, axis)]
                    })
                })
                .collect();
            steps.sort_unstable();
            steps.dedup();
            let crossings: Vec<(Step, Option<f64>)> =
                steps.into_par_iter().filter_map(|step| Some((step, boundary.cross(surface, winding, step)?))).collect();
            boundary.crossings.extend(crossings.iter().copied());
            boundary.pairs.extend(crossings.iter().filter(|(_, share)| share.is_some()).map(|(step, _)| *step));
            wave = crossings.iter().filter(|(_, share)| share.is_some()).flat_map(|(step, _)| around_step(*step)).collect();
        }
        boundary.pairs.sort_unstable();
        boundary
    }

    /// Neighbours over an edge or a corner, inside and outside, with surface beside them: the boundary may end between them and
    /// leave the way free. Ascending.
    fn diagonals(&self, surface: &Surface) -> Vec<([i32; 3], [i32; 3])> {
        let mut near: Vec<[i32; 3]> = self.pairs.iter().flat_map(|step| around_step(*step)).collect();
        near.sort_unstable();
        near.dedup();
        near.retain(|cell| self.is_inside(*cell) == Some(true) && !surface.contains(*cell));
        near.par_iter()
            .flat_map_iter(|cell| {
                (0..27).filter_map(|idx| {
                    let offset = [idx / 9 - 1, idx / 3 % 3 - 1, idx % 3 - 1];
                    let other = moved(*cell, offset);
                    let is_surface = |part: usize| {
                        let kept = core::array::from_fn(|axis| if part >> axis & 1 == 1 { offset[axis] } else { 0 });
                        surface.contains(moved(*cell, kept))
                    };
                    let is_free = self.is_inside(other) == Some(false) && !surface.contains(other);
                    (is_free && (1..7).any(is_surface)).then_some((*cell, other))
                })
            })
            .collect()
    }

    fn is_inside(&self, cell: [i32; 3]) -> Option<bool> {
        self.known.get(&cell).map(|winding| winding.abs() >= INSIDE)
    }

    /// Where the boundary is crossed on the way of a step, if it is; `Some(None)` where that is the surface itself.
    fn cross(&self, surface: &Surface, winding: &WindingTree<'_>, (low, axis): Step) -> Option<Option<f64>> {
        let mut high = low;
        high[axis] += 1;
        let (mut from, mut to) = (*self.known.get(&low)?, *self.known.get(&high)?);
        if (from.abs() >= INSIDE) == (to.abs() >= INSIDE) {
            return None;
        }
        let (mut near, mut far) = (0.0, 1.0);
        if surface.contains(low) || surface.contains(high) {
            let grid = &surface.grid;
            for _ in 0..BISECTIONS {
                let middle = 0.5 * (near + far);
                let at = winding.at(grid.center_map(low) + DVec3::AXES[axis] * (middle * grid.voxel_size_m));
                if (at.abs() >= INSIDE) == (from.abs() >= INSIDE) {
                    (near, from) = (middle, at);
                } else {
                    (far, to) = (middle, at);
                }
            }
            if (to - from).abs() > JUMP {
                return Some(None);
            }
        }
        let share = ((INSIDE - from.abs()) / (to.abs() - from.abs())).clamp(0.0, 1.0);
        Some(Some(near + (far - near) * share))
    }

    /// Corner of the boundary in the lattice cell between eight voxel centres, mesh frame, m.
    fn corner(&self, grid: &Grid, lowest: [i32; 3]) -> DVec3 {
        let (mut sum, mut count) = (DVec3::ZERO, 0.0);
        for (axis, k) in (0..3).flat_map(|axis| (0..4).map(move |k| (axis, k))) {
            let mut low = lowest;
            low[(axis + 1) % 3] += k & 1;
            low[(axis + 2) % 3] += k >> 1;
            if let Some(Some(share)) = self.crossings.get(&(low, axis)) {
                sum += grid.center_map(low) + DVec3::AXES[axis] * (share * grid.voxel_size_m);
                count += 1.0;
            }
        }
        sum / count
    }
}

/// A small face between two cells that touch in an edge or a corner, just within the first and facing the other.
fn patch(grid: &Grid, from: [i32; 3], to: [i32; 3]) -> [DVec3; 3] {
    let [from, to] = [from, to].map(|cell| grid.center_map(cell));
    let way = to - from;
    let (x_axis, y_axis) = way.normalize().any_orthonormal_pair();
    let center = from + 0.45 * way;
    // Counter-clockwise seen from `to`: x × y = way.
    [0.0, 1.0, 2.0].map(|third| {
        let angle = third * core::f64::consts::TAU / 3.0;
        center + 0.3 * grid.voxel_size_m * (x_axis * angle.cos() + y_axis * angle.sin())
    })
}

fn moved(cell: [i32; 3], by: [i32; 3]) -> [i32; 3] {
    core::array::from_fn(|axis| cell[axis] + by[axis])
}

/// The 18 cells of the four lattice cells around a step.
fn around_step((low, axis): Step) -> impl Iterator<Item = [i32; 3]> {
    (0..18).map(move |idx| {
        let mut cell = low;
        cell[axis] += idx % 2;
        cell[(axis + 1) % 3] += idx / 2 % 3 - 1;
        cell[(axis + 2) % 3] += idx / 6 - 1;
        cell
    })
}
