//! Signed distance from cell centres to the true surface, in the band.
//!
//! Layer by layer, every cell takes over the nearest triangles of its inner neighbours as candidates and then walks downhill on the
//! surface: it measures all triangles that touch the voxel of the closest point so far, and goes on from the closer one. What
//! propagates is a starting point, not a value, and every value is an exact point-triangle distance, so no error builds up.

use core::sync::atomic::{AtomicU32, Ordering};

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::grid::{BRICK_CELLS, BRICK_EDGE, Grid, brick_origin};
use super::layers::{DEEP_INSIDE, FAR_OUTSIDE, Layers};
use super::orient::Orientation;
use super::surface::Surface;
use crate::mesh::TriangleMesh;
use crate::mesh::closest_point::TriangleProjector;

/// Below this distance a centre counts as lying on the surface, where an offset has no direction; cells.
const ON_SURFACE_CELLS: f64 = 1e-6;

/// No triangle yet.
const NONE: u32 = u32::MAX;

/// Distances in the bricks of a [`Layers`] map, same slots.
#[derive(Debug)]
pub struct Distances {
    /// `[n_slots][512]`, m: negative outside, positive inside; ±(n_layers + ½)·s beyond the band, which no true distance there
    /// falls below.
    pub values_m: Vec<[f32; BRICK_CELLS]>,
    /// `[n_slots][512]`, unit: direction in which the distance grows, at the closest surface point; empty unless asked for.
    pub gradients: Vec<[Vec3; BRICK_CELLS]>,
}

/// What decides the sign of a distance.
#[derive(Clone, Copy, Debug)]
pub enum Signs<'a> {
    /// A solid: layers give the side, and the orientation of the nearest triangle decides in surface voxels.
    Solid(&'a Orientation),
    /// A thin skin: everything is outside.
    Thin,
}

impl Distances {
    /// Measures every cell of the band.
    ///
    /// Deterministic whatever the number of threads. Cost: O(band cells), some twenty exact triangle distances each.
    pub fn measure(mesh: &TriangleMesh, surface: &Surface, layers: &Layers, signs: Signs<'_>, with_gradients: bool) -> Self {
        let grid = &surface.grid;
        let walk = Walk::new(mesh, surface);
        let seeds: Vec<u32> = (0..surface.n_voxels).into_par_iter().map(|rank| walk.touching(rank)[0]).collect();
        let nearest: Vec<[AtomicU32; BRICK_CELLS]> =
            layers.bricks.iter().map(|_| [const { AtomicU32::new(NONE) }; BRICK_CELLS]).collect();
        let beyond_m = (layers.n_layers as f32 + 0.5) * grid.voxel_size_m as f32;
        let mut values_m: Vec<[f32; BRICK_CELLS]> =
            layers.values.par_iter().map(|cells| cells.map(|layer| if layer < 0 { -beyond_m } else { beyond_m })).collect();
        let mut gradients = if with_gradients { vec![[Vec3::ZERO; BRICK_CELLS]; layers.bricks.len()] } else { Vec::new() };

        for layer in 0..=layers.n_layers as i8 {
            let update = |slot: usize, values: &mut [f32; BRICK_CELLS], mut gradients: Option<&mut [Vec3; BRICK_CELLS]>| {
                if !layers.values[slot].iter().any(|value| value.abs() == layer) {
                    return;
                }
                let around = Around::new(grid, &layers.top, layers.bricks[slot] as usize);
                // Relaxed: written in the pass before, which the join of that pass ended; this pass writes only its own layer.
                let inner = around.gather(|slot, inside, cell| match layer {
                    0 => surface.rank(cell).map_or(NONE, |rank| seeds[rank]),
                    _ if layers.values[slot][inside].abs() == layer - 1 => nearest[slot][inside].load(Ordering::Relaxed),
                    _ => NONE,
                });
                for inside in 0..BRICK_CELLS {
                    if layers.values[slot][inside].abs() != layer {
                        continue;
                    }
                    let cell = around.cell(inside);
                    let center = DVec3::new(cell[0].into(), cell[1].into(), cell[2].into()) + 0.5;
                    let mut closest = Closest::default();
                    let mut candidates = Distinct::default();
                    for candidate in inner.neighbours(inside) {
                        if candidates.is_new(candidate) {
                            walk.consider(&mut closest, center, candidate);
                        }
                    }
                    if closest.triangle_idx == NONE {
                        continue;
                    }
                    walk.downhill(&mut closest, center);
                    // Relaxed: see above.
                    nearest[slot][inside].store(closest.triangle_idx, Ordering::Relaxed);
                    let sign = match (signs, layers.values[slot][inside].signum()) {
                        (Signs::Solid(orientation), 0) if closest.distance > ON_SURFACE_CELLS => {
                            -(closest.side * orientation.sign(closest.triangle_idx)).signum()
                        }
                        (Signs::Solid(_), 1) => 1.0,
                        _ => -1.0,
                    };
                    values[inside] = (sign * closest.distance * grid.voxel_size_m) as f32;
                    if let Some(gradients) = gradients.as_deref_mut() {
                        gradients[inside] = (closest.direction(signs) * sign).as_vec3();
                    }
                }
            };
            if with_gradients {
                values_m
                    .par_iter_mut()
                    .zip(gradients.par_iter_mut())
                    .enumerate()
                    .for_each(|(slot, (values, gradients))| update(slot, values, Some(gradients)));
            } else {
                values_m.par_iter_mut().enumerate().for_each(|(slot, values)| update(slot, values, None));
            }
        }
        Self { values_m, gradients }
    }
}

/// The surface as one walks on it: which triangles touch which voxel.
struct Walk<'a> {
    mesh: &'a TriangleMesh,
    surface: &'a Surface,
    /// `[n_vertices]`, cell coordinates.
    vertices: Vec<DVec3>,
    /// `[n_surface_voxels + 1]`: where a voxel's triangles start in `triangles`.
    starts: Vec<u32>,
    /// Triangles per voxel: the one nearest to the centre first, the rest ascending.
    triangles: Vec<u32>,
}

impl<'a> Walk<'a> {
    fn new(mesh: &'a TriangleMesh, surface: &'a Surface) -> Self {
        let grid = &surface.grid;
        let counts: Vec<AtomicU32> = (0..surface.n_voxels).map(|_| AtomicU32::new(0)).collect();
        // Relaxed, here and below: counters need no order among each other; the joins publish them.
        surface.for_each_hit(
            mesh,
            |_| (),
            |_, (), _, rank| {
                counts[rank].fetch_add(1, Ordering::Relaxed);
            },
        );
        let mut starts = Vec::with_capacity(surface.n_voxels + 1);
        let mut total = 0;
        for count in &counts {
            starts.push(total);
            // A wrap would mix up triangles; 2³² pairs would be 16 GiB of them.
            total = u32::checked_add(total, count.swap(0, Ordering::Relaxed)).expect("fewer than 2^32 touching pairs");
        }
        starts.push(total);
        let filled: Vec<AtomicU32> = (0..total).map(|_| AtomicU32::new(NONE)).collect();
        surface.for_each_hit(
            mesh,
            |_| (),
            |triangle_idx, (), _, rank| {
                let position = starts[rank] + counts[rank].fetch_add(1, Ordering::Relaxed);
                filled[position as usize].store(triangle_idx, Ordering::Relaxed);
            },
        );
        let triangles = filled.into_iter().map(AtomicU32::into_inner).collect();
        let vertices = mesh.vertices.par_iter().map(|vertex| grid.to_cells(*vertex)).collect();
        let mut walk = Self { mesh, surface, vertices, starts, triangles };
        walk.put_nearest_first();
        walk
    }

    /// Sorts each voxel's triangles, so that the order in which threads came does not show, and moves the nearest to the front.
    fn put_nearest_first(&mut self) {
        let mut lists: Vec<(&mut [u32], [i32; 3])> = Vec::with_capacity(self.surface.n_voxels);
        let mut triangles = core::mem::take(&mut self.triangles);
        let mut rest: &mut [u32] = &mut triangles;
        for (rank, cell) in self.surface.cells().enumerate() {
            let (list, tail) = rest.split_at_mut((self.starts[rank + 1] - self.starts[rank]) as usize);
            lists.push((list, cell));
            rest = tail;
        }
        lists.into_par_iter().for_each(|(list, cell)| {
            list.sort_unstable();
            let center = DVec3::new(cell[0].into(), cell[1].into(), cell[2].into()) + 0.5;
            let mut closest = Closest::default();
            list.iter().for_each(|triangle_idx| self.consider(&mut closest, center, *triangle_idx));
            if let Some(position) = list.iter().position(|triangle_idx| *triangle_idx == closest.triangle_idx) {
                list[..=position].rotate_right(1);
            }
        });
        self.triangles = triangles;
    }

    /// Triangles that touch the surface voxel of this rank.
    fn touching(&self, rank: usize) -> &[u32] {
        &self.triangles[self.starts[rank] as usize..self.starts[rank + 1] as usize]
    }

    /// Takes the triangle if it is closer to `center` (cells) than the closest so far.
    ///
    /// Among triangles that tie because the closest point lies on an edge or corner that they share, the one that the centre
    /// faces most squarely wins: its plane, not a neighbour's, tells the side.
    fn consider(&self, closest: &mut Closest, center: DVec3, triangle_idx: u32) {
        let corners = self.mesh.triangles[triangle_idx as usize].map(|vertex| self.vertices[vertex as usize]);
        let point = TriangleProjector::new(&corners).project(center).point;
        let offset = center - point;
        let distance = offset.length();
        if distance > closest.distance + TIE_CELLS {
            return;
        }
        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize_or_zero();
        let side = if distance > 0.0 { normal.dot(offset) / distance } else { 0.0 };
        let tie = distance >= closest.distance - TIE_CELLS;
        if !tie || side.abs() > closest.side.abs() + 1e-12 {
            *closest = Closest { triangle_idx, point, distance, offset, normal, side };
        }
    }

    /// Goes on from the closest point to closer ones on the triangles around it until there is none.
    fn downhill(&self, closest: &mut Closest, center: DVec3) {
        for _ in 0..DOWNHILL_STEPS {
            let before = closest.distance;
            let cell = closest.point.floor();
            let Some(rank) = self.surface.rank([cell.x as i32, cell.y as i32, cell.z as i32]) else { return };
            for triangle_idx in self.touching(rank) {
                if *triangle_idx != closest.triangle_idx {
                    self.consider(closest, center, *triangle_idx);
                }
            }
            if closest.distance >= before - TIE_CELLS {
                return;
            }
        }
    }
}

/// Distances that differ by less count as equal, cells.
const TIE_CELLS: f64 = 1e-9;
/// Voxels to walk at most; candidates are within a voxel or two of the foot point, so this is never reached in practice.
const DOWNHILL_STEPS: usize = 16;

/// The closest of several triangles.
struct Closest {
    triangle_idx: u32,
    /// Closest point, cells.
    point: DVec3,
    /// Cells.
    distance: f64,
    /// From the closest point to the centre, cells.
    offset: DVec3,
    /// Unit winding normal of the triangle.
    normal: DVec3,
    /// Component of the offset's direction along the winding normal.
    side: f64,
}

impl Default for Closest {
    fn default() -> Self {
        Self {
            triangle_idx: NONE,
            point: DVec3::ZERO,
            distance: f64::INFINITY,
            offset: DVec3::ZERO,
            normal: DVec3::ZERO,
            side: 0.0,
        }
    }
}

impl Closest {
    /// Unit vector away from the surface on the side of the centre, so that sign · direction is the gradient of the signed distance.
    fn direction(&self, signs: Signs<'_>) -> DVec3 {
        if self.distance > ON_SURFACE_CELLS {
            return self.offset / self.distance;
        }
        // On the surface itself the offset has no direction; a sign of −1 there means "outward".
        match signs {
            Signs::Solid(orientation) => self.normal * orientation.sign(self.triangle_idx),
            Signs::Thin => self.normal,
        }
    }
}

/// Distinct triangle numbers met around one cell.
struct Distinct {
    ids: [u32; 27],
    len: usize,
}

impl Default for Distinct {
    fn default() -> Self {
        Self { ids: [NONE; 27], len: 0 }
    }
}

impl Distinct {
    fn is_new(&mut self, triangle_idx: u32) -> bool {
        if triangle_idx == NONE || self.ids[..self.len].contains(&triangle_idx) {
            return false;
        }
        self.ids[self.len] = triangle_idx;
        self.len += 1;
        true
    }
}

/// The 27 bricks around one.
pub(crate) struct Around {
    origin: [i32; 3],
    slots: [u32; 27],
}

impl Around {
    pub(crate) fn new(grid: &Grid, top: &[u32], brick: usize) -> Self {
        let coord = grid.brick_coord(brick);
        let slots = core::array::from_fn(|idx| {
            let offset = [idx as i32 / 9 - 1, idx as i32 / 3 % 3 - 1, idx as i32 % 3 - 1];
            grid.brick_neighbour(coord, offset).map_or(FAR_OUTSIDE, |neighbour| top[neighbour])
        });
        Self { origin: brick_origin(coord), slots }
    }

    fn cell(&self, inside: usize) -> [i32; 3] {
        [self.origin[0] + (inside >> 6) as i32, self.origin[1] + (inside >> 3 & 7) as i32, self.origin[2] + (inside & 7) as i32]
    }

    /// Entry of the top grid and cell number for a cell given relative to the centre brick, each coordinate in −8..16.
    pub(crate) fn entry(&self, relative: [i32; 3]) -> (u32, usize) {
        let edge = BRICK_EDGE as i32;
        let brick = relative.map(|i| (i.div_euclid(edge) + 1) as usize);
        let inside = relative.map(|i| i.rem_euclid(edge) as usize);
        (self.slots[brick[0] * 9 + brick[1] * 3 + brick[2]], (inside[0] * BRICK_EDGE + inside[1]) * BRICK_EDGE + inside[2])
    }

    /// One value for each cell of the brick and of the rim of one cell around it; [`NONE`] where no brick is stored.
    fn gather(&self, value: impl Fn(usize, usize, [i32; 3]) -> u32) -> Rimmed {
        let mut rimmed = Rimmed([NONE; RIMMED_EDGE * RIMMED_EDGE * RIMMED_EDGE]);
        for (idx, entry) in rimmed.0.iter_mut().enumerate() {
            let relative =
                [idx / (RIMMED_EDGE * RIMMED_EDGE), idx / RIMMED_EDGE % RIMMED_EDGE, idx % RIMMED_EDGE].map(|i| i as i32 - 1);
            let (slot, inside) = self.entry(relative);
            if slot < DEEP_INSIDE {
                let cell = core::array::from_fn(|axis| self.origin[axis] + relative[axis]);
                *entry = value(slot as usize, inside, cell);
            }
        }
        rimmed
    }
}

/// Cells on the edge of a brick with its rim.
const RIMMED_EDGE: usize = BRICK_EDGE + 2;

/// Values of a brick's cells and of the cells around it, so that neighbours are found by adding an offset.
struct Rimmed([u32; RIMMED_EDGE * RIMMED_EDGE * RIMMED_EDGE]);

impl Rimmed {
    /// Values of a cell and its 26 neighbours.
    fn neighbours(&self, inside: usize) -> impl Iterator<Item = u32> + '_ {
        let corner = ((inside >> 6) * RIMMED_EDGE + (inside >> 3 & 7)) * RIMMED_EDGE + (inside & 7);
        (0..3)
            .flat_map(move |x| (0..3).map(move |y| corner + (x * RIMMED_EDGE + y) * RIMMED_EDGE))
            .flat_map(|row| self.0[row..row + 3].iter().copied())
    }
}
