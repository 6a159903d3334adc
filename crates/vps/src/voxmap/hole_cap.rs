//! Lids over holes: where inside and outside meet without a surface between them, triangles are put
//! in.
//!
//! With them the mesh is closed as far as voxels go: the fill stops there, distances are measured
//! to them, points lie on them. So the field is as continuous over a hole as anywhere else, and a
//! lid is felt like the rest of the surface.
//!
//! Winding numbers are whole apart from what the rims of holes add, so the boundary between inside
//! and outside that is not on the surface begins at the rims. It is followed from there, cell by
//! cell; the rest of the volume is not looked at.
//!
//! # Source
//! Ours. Inside is |winding number| ≥ ½, so that parts may face inward and may overlap. The
//! boundary is drawn as a dual surface: one corner per lattice cell between eight voxel centres
//! (the mean of the crossings on its edges), one quadrilateral per pair of neighbours that differ.
//! Such a quadrilateral always cuts the line between the two centres, hence one of the two voxels
//! becomes surface, and a fill over 6 neighbours cannot pass. Where a lid ends at the surface, two
//! voxels that differ may still touch in an edge or a corner; a small patch between them makes one
//! of them surface, as layers need it.
//!
//! Centres often lie on faces exactly, as parts and grids have the same axes and round sizes. There
//! the winding number is halfway between the two sides, and rounding would tell which. So it is
//! asked some thousandths of a voxel beside each centre.

mod known;

use glam::DVec3;
use rayon::prelude::*;

use self::known::WindingCache;
use super::grid::Grid;
use super::orient::connected_pieces;
use super::surface::Surface;
use super::winding::WindingTree;
use crate::mesh::TriangleMesh;
use crate::mesh::validate::MeshReport;
use crate::parallel;

/// A mesh whose holes are closed.
#[derive(Debug)]
pub struct CappedMesh {
    /// The triangles of the mesh and then those of the lids, over the vertices of the mesh and then
    /// those of the lids.
    pub mesh: TriangleMesh,
    /// Connected lids.
    pub n_lids: usize,
    /// Area of the lids, m².
    pub area_m2: f64,
    /// Cells near lids and rims, and whether their centres are inside: what the nearest triangle
    /// says at an edge of a lid is chance.
    pub(super) near: Vec<([i32; 3], bool)>,
}

/// |winding number| from which a point is inside.
const INSIDE: f64 = 0.5;
/// Cells around a rim in which the search for its lid begins: a hole that is closed by the voxels
/// of its rim has none to find.
const SEED_CELLS: i32 = 2;
/// Halvings of the way between two centres, of which one is in a surface voxel, to tell a boundary
/// from the surface: at the surface the winding number jumps by 1, however short the way.
const BISECTIONS: u32 = 4;
/// Change over the shortest way that counts as a jump.
const JUMP: f64 = 0.6;

/// Closes the holes of a mesh, and marks the lids on its surface; `None` where there is nothing to
/// close.
///
/// The same result whatever the number of threads. Cost: some four winding numbers per cell of the
/// lids, and a hundred per cell of the rims.
pub(super) fn close(
    mesh: &TriangleMesh,
    report: &MeshReport,
    surface: &Surface,
    winding: &WindingTree,
) -> Option<(CappedMesh, Surface)> {
    let rims: Vec<[DVec3; 2]> = report
        .open_edge_vertices
        .iter()
        .map(|edge| edge.map(|vertex| mesh.vertices[vertex as usize]))
        .collect();
    let boundary = Boundary::follow(surface, winding, &rims);
    if boundary.crossings.is_empty() {
        return None;
    }
    let mut lids = boundary.dual(&surface.grid);
    let mut pieces = connected_pieces(lids.vertices.len(), &lids.triangles);
    pieces.sort_unstable();
    pieces.dedup();
    let area_m2 = (0..lids.triangles.len())
        .map(|triangle_idx| {
            let [a, b, c] = lids.corners(triangle_idx);
            0.5 * (b - a).cross(c - a).length()
        })
        .sum();
    let mut with_lids = surface.with(&lids);
    let mut patches = TriangleMesh::default();
    for (inside, outside) in &boundary.diagonals(surface, &with_lids) {
        let first = patches.vertices.len() as u32;
        patches.vertices.extend(patch(&surface.grid, *inside, *outside));
        patches.triangles.push([first, first + 1, first + 2]);
    }
    if !patches.triangles.is_empty() {
        with_lids = with_lids.with(&patches);
        append(&mut lids, patches);
    }
    let n_all =
        [mesh.vertices.len() + lids.vertices.len(), mesh.triangles.len() + lids.triangles.len()];
    let mut closed = TriangleMesh {
        vertices: Vec::with_capacity(n_all[0]),
        triangles: Vec::with_capacity(n_all[1]),
    };
    closed.vertices.extend(&mesh.vertices);
    closed.triangles.extend(&mesh.triangles);
    append(&mut closed, lids);
    let near = boundary
        .known
        .cells()
        .map(|(cell, winding)| (cell, f64::from(winding.abs()) >= INSIDE))
        .collect();
    Some((CappedMesh { mesh: closed, n_lids: pieces.len(), area_m2, near }, with_lids))
}

fn append(mesh: &mut TriangleMesh, other: TriangleMesh) {
    let first = mesh.vertices.len() as u32;
    mesh.vertices.extend(other.vertices);
    mesh.triangles
        .extend(other.triangles.into_iter().map(|triangle| triangle.map(|vertex| vertex + first)));
}

/// Where the winding number of a point is asked, in voxels beside it: along no axis or diagonal,
/// further than single precision blurs triangles of thousands of voxels, and nearer than any
/// distance that is felt.
const BESIDE_CELLS: DVec3 = DVec3::new(4.1e-3, 2.7e-3, 3.5e-3);

/// The point just beside the centre of a cell, or further along an axis, voxels, at which the
/// winding number is asked.
fn asked_at(grid: &Grid, cell: [i32; 3], further_cells: DVec3) -> DVec3 {
    grid.center_map(cell) + (further_cells + BESIDE_CELLS) * grid.voxel_size_m
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
    /// Winding numbers near it and near the rims.
    known: WindingCache,
    /// Steps that cross it, and where on the way, 0 to 1. Ascending.
    crossings: Vec<(Step, f64)>,
}

impl Boundary {
    /// Follows the boundary from the rims on.
    fn follow(surface: &Surface, winding: &WindingTree, rims: &[[DVec3; 2]]) -> Self {
        let grid = &surface.grid;
        let mut rim_cells: Vec<[i32; 3]> = rims
            .iter()
            .flat_map(|rim| along(rim.map(|end| grid.to_cells(end))))
            .map(|point| point.floor().as_ivec3().to_array())
            .collect();
        rim_cells.sort_unstable();
        rim_cells.dedup();
        let n_around = 2 * SEED_CELLS + 1;
        let around = (0..n_around.pow(3)).map(|idx| {
            [idx / (n_around * n_around), idx / n_around % n_around, idx % n_around]
                .map(|step| step - SEED_CELLS)
        });
        let mut boundary = Self { known: WindingCache::new(grid), crossings: Vec::new() };
        let mut wave = boundary
            .known
            .ask(rim_cells.iter().flat_map(|cell| around.clone().map(|step| moved(*cell, step))));
        while !wave.is_empty() {
            let points: Vec<DVec3> =
                wave.iter().map(|cell| asked_at(grid, *cell, DVec3::ZERO)).collect();
            let mut differing: Vec<Step> = Vec::new();
            for (cell, winding) in wave.iter().zip(winding.at(&points)) {
                boundary.known.set(*cell, winding as f32);
                // Each step once: when the second of its cells becomes known.
                differing.extend(steps_of(*cell).filter(|step| boundary.differs(*step)));
            }
            let crossed = boundary.cross(surface, winding, &differing);
            wave = boundary.known.ask(crossed.iter().flat_map(|(step, _)| around_step(*step)));
            boundary.crossings.extend(crossed);
        }
        boundary.crossings.par_sort_unstable_by_key(|(step, _)| *step);
        boundary
    }

    /// The boundary as triangles that face outward, mesh frame, m.
    fn dual(&self, grid: &Grid) -> TriangleMesh {
        // Lattice cells around each crossing, counter-clockwise around its axis.
        let lattice_cells = |((low, axis), _): &(Step, f64)| {
            let u = (axis + 1) % 3;
            let v = (axis + 2) % 3;
            [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(back_u, back_v)| {
                let mut lattice_cell = *low;
                lattice_cell[u] -= back_u;
                lattice_cell[v] -= back_v;
                lattice_cell
            })
        };
        let mut users: Vec<([i32; 3], usize)> = self
            .crossings
            .iter()
            .enumerate()
            .flat_map(|(crossing_idx, crossing)| {
                lattice_cells(crossing).into_iter().zip(4 * crossing_idx..)
            })
            .collect();
        users.par_sort_unstable();
        let mut vertices = Vec::new();
        let mut quads = vec![[0_u32; 4]; self.crossings.len()];
        for users in users.chunk_by(|(one, _), (other, _)| one == other) {
            let points = users.iter().map(|(_, corner_idx)| {
                let ((low, axis), share) = self.crossings[corner_idx / 4];
                grid.center_map(low)
                    + (DVec3::AXES[axis] * share + BESIDE_CELLS) * grid.voxel_size_m
            });
            for (_, corner_idx) in users {
                quads[corner_idx / 4][corner_idx % 4] = vertices.len() as u32;
            }
            vertices.push(points.sum::<DVec3>() / users.len() as f64);
        }
        for (quad, ((low, _), _)) in quads.iter_mut().zip(&self.crossings) {
            if self.is_inside(*low) != Some(true) {
                quad.reverse();
            }
        }
        let triangles =
            quads.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).collect();
        TriangleMesh { vertices, triangles }
    }

    /// Neighbours over an edge or a corner, inside and outside, with surface beside them: the
    /// boundary may end between them and leave the way free. Those that a lid has made surface are
    /// not free. Ascending.
    fn diagonals(&self, surface: &Surface, with_lids: &Surface) -> Vec<([i32; 3], [i32; 3])> {
        let around = self.crossings.iter().flat_map(|(step, _)| around_step(*step));
        let mut near: Vec<[i32; 3]> = around
            .filter(|cell| self.is_inside(*cell) == Some(true) && !with_lids.contains(*cell))
            .collect();
        near.sort_unstable();
        near.dedup();
        let beside = |cell: [i32; 3]| {
            let free = (0..27).filter_map(|idx| {
                let offset = [idx / 9 - 1, idx / 3 % 3 - 1, idx % 3 - 1];
                let other = moved(cell, offset);
                let is_surface = |part: usize| {
                    let kept =
                        core::array::from_fn(
                            |axis| if part >> axis & 1 == 1 { offset[axis] } else { 0 },
                        );
                    surface.contains(moved(cell, kept))
                };
                let is_free = self.is_inside(other) == Some(false) && !with_lids.contains(other);
                (is_free && (1..7).any(is_surface)).then_some((cell, other))
            });
            free.collect::<Vec<_>>()
        };
        parallel::map(near.len(), 64, |place| beside(near[place])).into_iter().flatten().collect()
    }

    fn is_inside(&self, cell: [i32; 3]) -> Option<bool> {
        self.known.get(cell).map(|winding| winding.abs() >= INSIDE)
    }

    /// True for a step between cells that are known to be on different sides.
    fn differs(&self, (low, axis): Step) -> bool {
        let high = next(low, axis);
        self.is_inside(low).zip(self.is_inside(high)).is_some_and(|(low, high)| low != high)
    }

    /// Of steps between cells that differ those that cross the boundary, and where on the way; the
    /// others cross the surface itself.
    fn cross(
        &self,
        surface: &Surface,
        winding: &WindingTree,
        differing: &[Step],
    ) -> Vec<(Step, f64)> {
        let way = |step: &Step| {
            let from = self.known.get(step.0)?;
            let to = self.known.get(next(step.0, step.1))?;
            let on_surface = surface.contains(step.0) || surface.contains(next(step.0, step.1));
            Some(Way { step: *step, on_surface, windings: [from, to], ends: [0.0, 1.0] })
        };
        let mut ways: Vec<Way> = differing.iter().filter_map(way).collect();
        for _ in 0..BISECTIONS {
            let middle = |way: &Way| {
                asked_at(&surface.grid, way.step.0, DVec3::AXES[way.step.1] * way.middle())
            };
            let points: Vec<DVec3> = ways.iter().filter(|way| way.on_surface).map(middle).collect();
            let halved = ways.iter_mut().filter(|way| way.on_surface);
            halved.zip(winding.at(&points)).for_each(|(way, winding)| way.halve(winding));
        }
        ways.iter().filter(|way| !way.jumps()).map(|way| (way.step, way.crossing())).collect()
    }
}

/// The part of a step on which inside and outside meet.
struct Way {
    step: Step,
    /// One of the cells holds surface.
    on_surface: bool,
    /// Winding numbers at its ends.
    windings: [f64; 2],
    /// Where it begins and ends, 0 to 1.
    ends: [f64; 2],
}

impl Way {
    fn middle(&self) -> f64 {
        0.5 * (self.ends[0] + self.ends[1])
    }

    fn halve(&mut self, winding: f64) {
        let end = usize::from((winding.abs() >= INSIDE) != (self.windings[0].abs() >= INSIDE));
        (self.ends[end], self.windings[end]) = (self.middle(), winding);
    }

    /// Where that is at the surface.
    fn jumps(&self) -> bool {
        self.on_surface && (self.windings[1] - self.windings[0]).abs() > JUMP
    }

    fn crossing(&self) -> f64 {
        let [from, to] = self.windings.map(f64::abs);
        let share = ((INSIDE - from) / (to - from)).clamp(0.0, 1.0);
        self.ends[0] + (self.ends[1] - self.ends[0]) * share
    }
}

/// A small face between two cells that touch in an edge or a corner, just within the first and
/// facing the other.
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

fn next(cell: [i32; 3], axis: usize) -> [i32; 3] {
    let mut next = cell;
    next[axis] += 1;
    next
}

/// The six steps from and to a cell.
fn steps_of(cell: [i32; 3]) -> impl Iterator<Item = Step> {
    (0..3).flat_map(move |axis| {
        let mut before = cell;
        before[axis] -= 1;
        [(cell, axis), (before, axis)]
    })
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
