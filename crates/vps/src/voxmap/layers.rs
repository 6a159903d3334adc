//! Layers: how many voxels is a cell away from the surface?
//!
//! # Source
//! Sagardia2008: values grow by one per layer, negative outside, positive inside, 0 on the surface,
//! up to a chosen number of layers. The metric is ours: 26 neighbours, so a cell on layer q is at
//! least (q − ½)·s away from the surface (its Chebyshev distance in cells is exactly q), which is
//! the bound that culling needs.

use std::sync::Arc;

use super::bricks::BrickSet;
use super::fill::Sides;
use super::grid::{BRICK_CELLS, Grid};
use super::growth;
use super::surface::{Mask, Surface};
use crate::parallel;

/// Marks a brick of the top grid that holds no band cell and lies outside.
pub const FAR_OUTSIDE: u32 = u32::MAX;
/// Marks a brick of the top grid that holds no band cell and lies inside.
pub const DEEP_INSIDE: u32 = u32::MAX - 1;

/// Layer values, sparse: only bricks that the band touches are stored.
#[derive(Clone, Debug)]
pub struct Layers {
    /// The grid of the map.
    pub grid: Grid,
    /// `[n_bricks of the grid]`: slot in `bricks` and `values`, or [`FAR_OUTSIDE`], or
    /// [`DEEP_INSIDE`].
    pub top: Vec<u32>,
    /// `[n_slots]`, ascending: number of the brick in the grid.
    pub bricks: Vec<u32>,
    /// `[n_slots][512]`, z fastest: 0 surface, −q outside, +q inside, ±(n_layers + 1) beyond the
    /// band. Shared with the field.
    pub values: Arc<Vec<[i8; BRICK_CELLS]>>,
    /// Layers on each side.
    pub n_layers: u32,
}

impl Layers {
    /// Grows `n_layers` (at most 126) on both sides of the surface.
    ///
    /// Each brick of the band is worked out by itself from the 27 bricks around it, on the current
    /// rayon pool; the result does not depend on the number of threads. A brick looks no further
    /// than eight cells, so more layers take further rounds. Cost: O(band bricks) per round of
    /// eight layers.
    pub fn grow(surface: &Surface, sides: &Sides, n_layers: u32) -> Self {
        let grid = surface.grid;
        let negate = |brick: u32, cells: &mut [i8; BRICK_CELLS]| {
            growth::negate(cells, &sides.outside_mask(surface, brick as usize));
        };
        let mut reached = Reached::none(&grid);
        for first_layer in (1..=n_layers).step_by(growth::REACH) {
            let n_before = first_layer - 1;
            let n_more = (n_layers - n_before).min(growth::REACH as u32);
            let masks = parallel::map(reached.values.len(), 1, |slot| {
                growth::up_to(&reached.values[slot], n_before as i8)
            });
            let seen = match n_before {
                0 => Seen {
                    index: surface.brick_set(),
                    bricks: &surface.bricks,
                    masks: &surface.masks,
                },
                _ => Seen { index: &reached.index, bricks: &reached.bricks, masks: &masks },
            };
            let last = n_before + n_more == n_layers;
            reached = reached.grown(&grid, &seen, n_before, n_more, |brick, cells| {
                if last {
                    negate(brick, cells);
                }
            });
        }
        let Reached { index: _, bricks, values } = reached;
        let is_outside = |brick: usize| sides.outside_bricks(brick / 64) >> (brick % 64) & 1 == 1;
        let mut top = parallel::map(grid.n_bricks(), 64, |brick| {
            if is_outside(brick) { FAR_OUTSIDE } else { DEEP_INSIDE }
        });
        for (slot, brick) in bricks.iter().enumerate() {
            top[*brick as usize] = slot as u32;
        }
        Self { grid, top, bricks, values: Arc::new(values), n_layers }
    }

    /// Layer value of a cell; cells beyond the grid saturate outside.
    pub fn value(&self, cell: [i32; 3]) -> i8 {
        let beyond = self.n_layers as i8 + 1;
        if !self.grid.contains(cell) {
            return -beyond;
        }
        let (brick, inside) = self.grid.locate(cell);
        match self.top[brick] {
            FAR_OUTSIDE => -beyond,
            DEEP_INSIDE => beyond,
            slot => self.values[slot as usize][inside],
        }
    }

    /// Slot of a brick that the band touches.
    pub fn slot(&self, brick: usize) -> Option<usize> {
        (self.top[brick] < DEEP_INSIDE).then_some(self.top[brick] as usize)
    }
}

/// Cells to grow from, sparse.
struct Seen<'a> {
    index: &'a BrickSet,
    bricks: &'a [u32],
    masks: &'a [Mask],
}

/// The band after some layers, without sides.
struct Reached {
    index: BrickSet,
    bricks: Vec<u32>,
    /// Layers up to the last one grown, and one more for cells not reached.
    values: Vec<[i8; BRICK_CELLS]>,
}

impl Reached {
    fn none(grid: &Grid) -> Self {
        Self {
            index: BrickSet::new((0..grid.n_bricks().div_ceil(64)).map(|_| 0)),
            bricks: Vec::new(),
            values: Vec::new(),
        }
    }

    /// `n_more` layers on top of `n_before`, grown from the cells that were `seen`; `finish` has
    /// the last word on a brick's values.
    fn grown(
        &self,
        grid: &Grid,
        seen: &Seen<'_>,
        n_before: u32,
        n_more: u32,
        finish: impl Fn(u32, &mut [i8; BRICK_CELLS]) + Sync,
    ) -> Self {
        let mut words = vec![0_u64; grid.n_bricks().div_ceil(64)];
        for (brick, mask) in seen.bricks.iter().zip(seen.masks) {
            let coord = grid.brick_coord(*brick as usize);
            for offset in growth::bricks_within(mask, n_more) {
                if let Some(neighbour) = grid.brick_neighbour(coord, offset) {
                    words[neighbour / 64] |= 1 << (neighbour % 64);
                }
            }
        }
        let wider = BrickSet::new(words);
        let bricks = wider.members();
        let values = parallel::map(bricks.len(), 1, |slot| {
            let brick = bricks[slot];
            let coord = grid.brick_coord(brick as usize);
            let around: [Option<&Mask>; 27] = core::array::from_fn(|idx| {
                let neighbour = grid.brick_neighbour(coord, growth::offset(idx))?;
                seen.index.slot(neighbour).map(|slot| &seen.masks[slot])
            });
            let mut cells = growth::distances(&around, n_more);
            if n_before > 0 {
                let before = self.index.slot(brick as usize).map(|slot| &self.values[slot]);
                growth::stack(&mut cells, before, n_before as i8);
            }
            finish(brick, &mut cells);
            cells
        });
        Self { index: wider, bricks, values }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::primitives::Shape;
    use crate::voxmap::surface::Navigation;

    /// Breadth-first over a dense box, 26 neighbours: the definition.
    fn by_definition(surface: &Surface, sides: &Sides, n_layers: i32) -> Vec<i8> {
        let [nx, ny, nz] = surface.grid.brick_dims().map(|n| 8 * n as i32);
        let index = |[x, y, z]: [i32; 3]| ((x * ny + y) * nz + z) as usize;
        let mut values = vec![n_layers as i8 + 1; (nx * ny * nz) as usize];
        let mut front: Vec<[i32; 3]> = surface.cells().collect();
        front.iter().for_each(|cell| values[index(*cell)] = 0);
        for layer in 1..=n_layers {
            for [x, y, z] in core::mem::take(&mut front) {
                for i in 0..27 {
                    let next = [x + i / 9 - 1, y + i / 3 % 3 - 1, z + i % 3 - 1];
                    let inside =
                        (0..3).all(|axis| next[axis] >= 0 && next[axis] < [nx, ny, nz][axis]);
                    if inside && values[index(next)] == n_layers as i8 + 1 {
                        values[index(next)] = layer as i8;
                        front.push(next);
                    }
                }
            }
        }
        for (brick, cells) in
            (0..surface.grid.n_bricks()).map(|brick| (brick, sides.outside_mask(surface, brick)))
        {
            for inside in
                (0..BRICK_CELLS).filter(|inside| cells[inside >> 6] >> (inside & 63) & 1 == 1)
            {
                let cell = crate::voxmap::grid::cell_of(surface.grid.brick_coord(brick), inside);
                values[index(cell)] *= -1;
            }
        }
        values
    }

    #[test]
    fn layers_equal_their_definition_within_and_beyond_one_round() {
        let speck = |at: f64| {
            // A shape that leaves most bricks empty: three specks far apart.
            let mut mesh = Shape::Sphere { radius_m: 0.4 }.tessellate(0.2);
            let n = mesh.vertices.len() as u32;
            for k in 1..3_u32 {
                let shift = glam::DVec3::new(at, at * 0.4, at * 0.7) * f64::from(k);
                mesh.vertices.extend_from_within(..n as usize);
                mesh.vertices.iter_mut().rev().take(n as usize).for_each(|vertex| *vertex += shift);
                let added: Vec<_> = mesh
                    .triangles
                    .iter()
                    .take(mesh.triangles.len() / k as usize)
                    .copied()
                    .collect();
                mesh.triangles.extend(
                    added.into_iter().map(|triangle| triangle.map(|vertex| vertex + k * n)),
                );
            }
            mesh
        };
        let ball = Shape::Sphere { radius_m: 23.3 }.tessellate(0.1);
        for mesh in [speck(9.0), speck(31.0), ball] {
            for n_layers in [1, 2, 5, 7, 8, 9, 17, 30] {
                let (low, high) = mesh.bounds().expect("not empty");
                let grid = Grid::around(low, high, 1.0, n_layers).expect("a grid that fits");
                let surface = Surface::mark(&mesh, &grid, Navigation::TwoSided);
                let sides = Sides::flood(&surface);
                let layers = Layers::grow(&surface, &sides, n_layers);
                let expected = by_definition(&surface, &sides, n_layers as i32);
                let dims = grid.brick_dims().map(|n| 8 * n as usize);
                for brick in 0..grid.n_bricks() {
                    let coord = grid.brick_coord(brick);
                    let cells: Vec<i8> = (0..BRICK_CELLS)
                        .map(|inside| {
                            let [x, y, z] =
                                crate::voxmap::grid::cell_of(coord, inside).map(|i| i as usize);
                            expected[(x * dims[1] + y) * dims[2] + z]
                        })
                        .collect();
                    let beyond = n_layers as i8 + 1;
                    match layers.top[brick] {
                        FAR_OUTSIDE => {
                            assert!(cells.iter().all(|value| *value == -beyond), "{coord:?}")
                        }
                        DEEP_INSIDE => {
                            assert!(cells.iter().all(|value| *value == beyond), "{coord:?}")
                        }
                        slot => {
                            assert_eq!(
                                layers.values[slot as usize].as_slice(),
                                cells,
                                "{coord:?}, {n_layers} layers"
                            );
                            assert!(
                                cells.iter().any(|value| value.abs() < beyond),
                                "{coord:?} holds no band cell"
                            );
                            assert_eq!(layers.bricks[slot as usize] as usize, brick);
                        }
                    }
                }
                assert!(layers.bricks.is_sorted());
            }
        }
    }
}
