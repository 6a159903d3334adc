//! The read-only look-up that the tick uses: depth of a point, and its gradient.
//!
//! Data in: a baked map. Data out: V at a point of the map frame (negative outside, 0 on the
//! surface, positive inside).
//!
//! Invariant: immutable, and total: any finite point gives a finite answer, a point that is not a
//! number gives NaN (which is no contact), nothing panics. Cost: one top-grid read plus 1 to 8
//! reads in one or two bricks.

#![deny(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::indexing_slicing)]

pub(crate) mod brick_bounds;
pub(crate) mod creases;
mod file;
mod gradient;
mod moved;
mod rims;

use std::sync::Arc;

use glam::Vec3;

use self::creases::Creases;
pub use super::distance::{APRON_CELLS, APRON_EDGE};
use super::distance::{Samples, sample_of};
use super::grid::{BRICK_CELLS, BRICK_EDGE, Grid};
use super::layers::Layers;
pub use super::layers::{DEEP_INSIDE, FAR_OUTSIDE};
use crate::mesh::TriangleMesh;
use crate::parallel;
use crate::storage::SharedSlice;
pub(crate) use moved::MOST_MOVED_CELLS;

/// Which formula turns the map into a depth at a point.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum FieldKind {
    /// V_L: layer value of the voxel plus the tangent-plane term.
    Layers,
    /// V_S: signed distance to the tangent plane at the surface point closest to the voxel's
    /// centre.
    SurfacePoint,
    /// V_I: first-order expansion from the voxel centre towards the point's octant.
    Octant,
    /// Eight-corner interpolation; continuous everywhere.
    #[default]
    Trilinear,
}

impl FieldKind {
    /// The names of the scene file.
    ///
    /// # Examples
    /// ```
    /// # use vps::FieldKind;
    /// let of_text = FieldKind::NAMES.into_iter().find(|(name, _)| *name == "trilinear");
    /// assert_eq!(of_text, Some(("trilinear", FieldKind::default())));
    /// ```
    pub const NAMES: [(&'static str, Self); 4] = [
        ("layers", Self::Layers),
        ("surface-point", Self::SurfacePoint),
        ("octant", Self::Octant),
        ("trilinear", Self::Trilinear),
    ];
}

/// The sampled field of one object, map frame. A clone is another handle on the same arrays.
#[derive(Clone, Debug)]
pub struct Field {
    /// Lowest corner of cell `[0, 0, 0]`, map frame, m.
    origin: Vec3,
    /// s, m.
    voxel_size_m: f32,
    brick_dims: [i32; 3],
    /// `[n_bricks]`, z fastest: slot, or [`FAR_OUTSIDE`], or [`DEEP_INSIDE`].
    top: SharedSlice<u32>,
    /// `[n_slots][9³]`, z fastest, m: signed distance at cell centres, moved by what interpolation
    /// errs in the mean, with the next bricks' first samples.
    samples_m: SharedSlice<[f32; APRON_CELLS]>,
    /// The same layout: by how many steps of [`moved::STEP_CELLS`] of a cell a sample is less than
    /// the distance; empty where none was moved.
    moves: SharedSlice<[i8; APRON_CELLS]>,
    /// `[n_slots][8³]`, z fastest; of a new field the map's own.
    layers: SharedSlice<[i8; BRICK_CELLS]>,
    /// `[n_slots][8³]`, unit; empty unless `surface-point` is used.
    gradients: SharedSlice<[Vec3; BRICK_CELLS]>,
    /// Planes of its sharp convex edges.
    creases: Creases,
    /// Depth at which the field saturates on both sides, m.
    band_m: f32,
    /// Added to every value, m: 0 for a solid, one voxel for a thin skin.
    skin_m: f32,
}

impl Field {
    /// Assembles the look-up from a baked map. `outward`: the triangles of a solid, all of which
    /// face outwards; `None` of a thin skin. Cold.
    pub(crate) fn new(layers: &Layers, samples: Samples, outward: Option<&TriangleMesh>) -> Self {
        let grid: &Grid = &layers.grid;
        let voxel_size_m = grid.voxel_size_m as f32;
        // Cells on the outermost layer are at least this far away, and so is everything beyond:
        // saturating here makes a brick without band cells and the cells beside it agree.
        let band_m = (layers.n_layers as f32 - 0.5) * voxel_size_m;
        let Samples { values_m: mut samples_m, gradients } = samples;
        // The two sides of a skin are nowhere one patch.
        let moves = match outward {
            None => Vec::new(),
            Some(_) => moved::move_samples(layers, band_m, &mut samples_m),
        };
        fill_aprons(layers, [-band_m, band_m], &mut samples_m);
        let field = Self {
            origin: grid.origin_m.as_vec3(),
            voxel_size_m,
            brick_dims: grid.brick_dims().map(|n| n as i32),
            top: layers.top.clone().into(),
            samples_m: samples_m.into(),
            moves: moves.into(),
            layers: Arc::clone(&layers.values).into(),
            gradients: gradients.into(),
            creases: Creases::default(),
            band_m,
            skin_m: if outward.is_none() { voxel_size_m } else { 0.0 },
        };
        match outward {
            Some(mesh) => Self { creases: Creases::of(mesh, &field), ..field },
            None => field,
        }
    }

    /// Voxel edge s, m.
    pub fn voxel_size_m(&self) -> f32 {
        self.voxel_size_m
    }

    /// Lowest corner of cell `[0, 0, 0]`, map frame, m.
    pub fn origin_map(&self) -> Vec3 {
        self.origin
    }

    /// True for a thin two-sided skin: forces then follow −grad V instead of the point's normal.
    pub fn is_thin(&self) -> bool {
        self.skin_m > 0.0
    }

    /// It can be looked up by [`FieldKind::SurfacePoint`].
    pub(crate) fn has_gradients(&self) -> bool {
        self.gradients.len() == self.samples_m.len()
    }

    /// V of everything outside the grid, m: what every look-up gives there.
    pub fn outside_m(&self) -> f32 {
        -self.band_m + self.skin_m
    }

    /// What is added to every sample, m.
    pub(crate) fn skin_m(&self) -> f32 {
        self.skin_m
    }

    /// Least and largest value, m.
    pub(crate) fn range_m(&self) -> [f32; 2] {
        [-self.band_m, self.band_m].map(|value_m| value_m + self.skin_m)
    }

    /// The depth from which on a look-up says no more, m; interpolation rounds.
    pub fn deepest_m(&self) -> f32 {
        (1.0 - 1e-6) * self.range_m()[1]
    }

    /// How far outside the object distances are known, m.
    pub fn known_outside_m(&self) -> f32 {
        self.band_m - self.skin_m
    }

    /// Bricks per axis.
    pub fn brick_dims(&self) -> [usize; 3] {
        self.brick_dims.map(|n| n as usize)
    }

    /// `[brick_dims]`, z fastest: number of the brick of [`Self::distances_m`], [`FAR_OUTSIDE`] or
    /// [`DEEP_INSIDE`].
    pub fn top(&self) -> &[u32] {
        &self.top
    }

    /// `[9³]`, z fastest, m: the distance at the centres of the cells of brick `slot` of
    /// [`Self::top`], before the skin is added, positive inside; the ninth samples are those of the
    /// next bricks. `None` beyond the last.
    pub fn distances_m(&self, slot: usize) -> Option<[f32; APRON_CELLS]> {
        let mut brick = *self.samples_m.get(slot)?;
        if let Some(moves) = self.moves.get(slot) {
            for (sample_m, steps) in brick.iter_mut().zip(moves) {
                *sample_m += self.move_m(*steps);
            }
        }
        Some(brick)
    }

    /// Bricks that hold samples.
    pub fn n_bricks(&self) -> usize {
        self.samples_m.len()
    }

    /// The farthest that a sample was moved, m.
    pub(crate) fn most_moved_m(&self) -> f32 {
        let steps = self.moves.iter().flatten().map(|steps| steps.unsigned_abs()).max();
        self.step_m() * f32::from(steps.unwrap_or(0))
    }

    fn move_m(&self, steps: i8) -> f32 {
        self.step_m() * f32::from(steps)
    }

    fn step_m(&self) -> f32 {
        self.voxel_size_m * moved::STEP_CELLS
    }

    #[cfg(test)]
    pub(crate) fn samples_m(&self) -> &[[f32; APRON_CELLS]] {
        &self.samples_m
    }

    /// The same with other samples.
    #[cfg(test)]
    pub(crate) fn with_samples(self, samples: Vec<[f32; APRON_CELLS]>) -> Self {
        Self { samples_m: samples.into(), ..self }
    }

    /// Size of the arrays, bytes.
    pub fn heap_bytes(&self) -> usize {
        let Self {
            origin: _,
            voxel_size_m: _,
            brick_dims: _,
            top,
            samples_m,
            moves,
            layers,
            gradients,
            creases,
            band_m: _,
            skin_m: _,
        } = self;
        size_of_val(&**top)
            + size_of_val(&**samples_m)
            + size_of_val(&**moves)
            + size_of_val(&**layers)
            + size_of_val(&**gradients)
            + creases.heap_bytes()
    }

    /// The planes of its sharp convex edges.
    pub(crate) fn creases(&self) -> &Creases {
        &self.creases
    }

    /// V at a point, m. `cells`: the point in cell coordinates; `normal`: the pointshell's inward
    /// normal in map axes, read by [`FieldKind::Layers`] only.
    ///
    /// RT: safe. Saturates at ± the band; −band outside the grid.
    #[inline]
    pub fn value(&self, kind: FieldKind, cells: Vec3, normal: Vec3) -> f32 {
        match kind {
            FieldKind::Trilinear => self.trilinear::<true>(cells),
            FieldKind::Layers => self.by_layer(cells, normal),
            FieldKind::SurfacePoint => self.by_surface_point(cells),
            FieldKind::Octant => self.by_octant(cells),
        }
    }

    /// Distance at a point, m, positive inside, and its gradient, m/m, map axes: interpolated between
    /// exact distances at the centres of cells, where [`FieldKind::Trilinear`] reads samples that
    /// are moved so that a curved surface is felt where it is. Saturates like it. RT: safe.
    pub fn distance(&self, cells: Vec3) -> (f32, Vec3) {
        (self.trilinear::<false>(cells), self.slopes_of::<false>(cells) / self.voxel_size_m)
    }

    /// Eight-corner interpolation of the samples at cell centres, `MOVED` or as they were measured,
    /// m. RT: safe.
    #[inline]
    fn trilinear<const MOVED: bool>(&self, cells: Vec3) -> f32 {
        let lattice = cells - 0.5;
        let base = whole(lattice);
        let t = lattice - to_vec3(base);
        match self.corners::<MOVED>(base) {
            Corners::Samples(c) => {
                let z00 = c[0] + (c[1] - c[0]) * t.z;
                let z01 = c[2] + (c[3] - c[2]) * t.z;
                let z10 = c[4] + (c[5] - c[4]) * t.z;
                let z11 = c[6] + (c[7] - c[6]) * t.z;
                let y0 = z00 + (z01 - z00) * t.y;
                let y1 = z10 + (z11 - z10) * t.y;
                (y0 + (y1 - y0) * t.x).clamp(-self.band_m, self.band_m) + self.skin_m
            }
            Corners::Uniform(value) => value + self.skin_m,
        }
    }

    /// Gradient of [`FieldKind::Trilinear`], m/m, map axes; zero where the field is uniform. RT:
    /// safe.
    pub fn gradient(&self, cells: Vec3) -> Vec3 {
        self.slopes(cells) / self.voxel_size_m
    }

    /// The same per cell in place of per metre. RT: safe.
    #[inline]
    pub(crate) fn slopes(&self, cells: Vec3) -> Vec3 {
        self.slopes_of::<true>(cells)
    }

    #[inline]
    fn slopes_of<const MOVED: bool>(&self, cells: Vec3) -> Vec3 {
        let lattice = cells - 0.5;
        let base = whole(lattice);
        let t = lattice - to_vec3(base);
        let Corners::Samples(c) = self.corners::<MOVED>(base) else { return Vec3::ZERO };
        let mix = |a: f32, b: f32, t: f32| a + (b - a) * t;
        let z00 = mix(c[0], c[1], t.z);
        let z01 = mix(c[2], c[3], t.z);
        let z10 = mix(c[4], c[5], t.z);
        let z11 = mix(c[6], c[7], t.z);
        Vec3::new(
            mix(z10 - z00, z11 - z01, t.y),
            mix(z01 - z00, z11 - z10, t.x),
            mix(mix(c[1] - c[0], c[3] - c[2], t.y), mix(c[5] - c[4], c[7] - c[6], t.y), t.x),
        )
    }

    /// V_L = s·v(C) + n·(C − P).
    fn by_layer(&self, cells: Vec3, normal: Vec3) -> f32 {
        let cell = whole(cells);
        match self.locate(cell) {
            Located::Cell(slot, inside) => {
                let layer =
                    self.layers.get(slot).and_then(|brick| brick.get(inside)).copied().unwrap_or(0);
                let to_center = to_vec3(cell) + 0.5 - cells;
                let value = self.voxel_size_m * (f32::from(layer) + normal.dot(to_center));
                value.clamp(-self.band_m, self.band_m) + self.skin_m
            }
            Located::Uniform(value) => value + self.skin_m,
        }
    }

    /// V_S = w_C + g·(P − C), g the unit gradient at the closest surface point of the voxel.
    fn by_surface_point(&self, cells: Vec3) -> f32 {
        let cell = whole(cells);
        match self.locate(cell) {
            Located::Cell(slot, inside) => {
                let gradient = self
                    .gradients
                    .get(slot)
                    .and_then(|brick| brick.get(inside))
                    .copied()
                    .unwrap_or(Vec3::ZERO);
                let from_center = cells - to_vec3(cell) - 0.5;
                let value =
                    self.sample(slot, inside) + self.voxel_size_m * gradient.dot(from_center);
                value.clamp(-self.band_m, self.band_m) + self.skin_m
            }
            Located::Uniform(value) => value + self.skin_m,
        }
    }

    /// V_I = w_C + grad_w·(P − C) with one-sided differences towards the octant that holds P.
    fn by_octant(&self, cells: Vec3) -> f32 {
        let cell = whole(cells);
        let center = match self.locate(cell) {
            Located::Cell(slot, inside) => self.sample(slot, inside),
            Located::Uniform(value) => return value + self.skin_m,
        };
        let from_center = cells - to_vec3(cell) - 0.5;
        let [x, y, z] = cell;
        let towards = |along: f32| if along >= 0.0 { 1 } else { -1 };
        let neighbours = [
            (from_center.x, [x.saturating_add(towards(from_center.x)), y, z]),
            (from_center.y, [x, y.saturating_add(towards(from_center.y)), z]),
            (from_center.z, [x, y, z.saturating_add(towards(from_center.z))]),
        ];
        let mut value = center;
        for (along, neighbour) in neighbours {
            let beside = match self.locate(neighbour) {
                Located::Cell(slot, inside) => self.sample(slot, inside),
                Located::Uniform(value) => value,
            };
            // (w_x − w_C)/d_X · along: the sign of d_X and of `along` agree, so the product takes
            // the magnitude.
            value += (beside - center) * along.abs();
        }
        value.clamp(-self.band_m, self.band_m) + self.skin_m
    }

    /// The distance at the centre of a cell, m, before the skin is added.
    pub(crate) fn sample(&self, slot: usize, inside: usize) -> f32 {
        let place = sample_of(inside);
        let sample_m = self.samples_m.get(slot).and_then(|brick| brick.get(place));
        let steps = self.moves.get(slot).and_then(|brick| brick.get(place));
        sample_m.map_or(-self.band_m, |sample_m| sample_m + self.move_m(steps.map_or(0, |n| *n)))
    }

    /// The eight samples around a lattice cell whose lowest corner is the centre of cell `base`.
    #[inline]
    fn corners<const MOVED: bool>(&self, base: [i32; 3]) -> Corners {
        let (slot, inside) = match self.locate(base) {
            Located::Cell(slot, inside) => (slot, inside),
            Located::Uniform(value) => return Corners::Uniform(value),
        };
        const ROW: usize = APRON_EDGE;
        const PLANE: usize = APRON_EDGE * APRON_EDGE;
        let first = (inside >> 6) * PLANE + (inside >> 3 & 7) * ROW + (inside & 7);
        let brick = self.samples_m.get(slot).and_then(|brick| brick.get(first..));
        let Some(samples) = brick.and_then(|samples| samples.first_chunk::<{ PLANE + ROW + 2 }>())
        else {
            return Corners::Uniform(-self.band_m);
        };
        let mut corners = [
            samples[0],
            samples[1],
            samples[ROW],
            samples[ROW + 1],
            samples[PLANE],
            samples[PLANE + 1],
            samples[PLANE + ROW],
            samples[PLANE + ROW + 1],
        ];
        if !MOVED && let Some(moves) = self.moves.get(slot) {
            let places = [0, 1, ROW, ROW + 1, PLANE, PLANE + 1, PLANE + ROW, PLANE + ROW + 1];
            for (corner, place) in corners.iter_mut().zip(places) {
                *corner += moves.get(first + place).map_or(0.0, |steps| self.move_m(*steps));
            }
        }
        Corners::Samples(corners)
    }

    /// Slot and cell number of a cell.
    #[inline]
    fn locate(&self, [x, y, z]: [i32; 3]) -> Located {
        let bx = x >> 3;
        let by = y >> 3;
        let bz = z >> 3;
        let [nx, ny, nz] = self.brick_dims;
        if (bx as u32) >= nx as u32 || (by as u32) >= ny as u32 || (bz as u32) >= nz as u32 {
            return Located::Uniform(-self.band_m);
        }
        let brick = (bx as usize * ny as usize + by as usize) * nz as usize + bz as usize;
        match self.top.get(brick).copied().unwrap_or(FAR_OUTSIDE) {
            FAR_OUTSIDE => Located::Uniform(-self.band_m),
            DEEP_INSIDE => Located::Uniform(self.band_m),
            slot => Located::Cell(slot as usize, ((x & 7) << 6 | (y & 7) << 3 | (z & 7)) as usize),
        }
    }
}

/// Bricks whose aprons are filled together: the buffer between reading neighbours and writing stays
/// in the cache.
const APRON_CHUNK: usize = 4096;
/// Samples of a brick that are its neighbours'.
const BORROWED: usize = APRON_CELLS - BRICK_CELLS;

/// Calls `visit` for every row along z that holds borrowed samples of a brick: with the row's first
/// sample, which of the seven next bricks owns what lies beside the brick in x or y (bits x, y; 0:
/// only the row's end is borrowed), and the place of the row there.
fn each_apron_row(mut visit: impl FnMut(usize, usize, usize)) {
    for x in 0..APRON_EDGE {
        for y in 0..APRON_EDGE {
            let owner = 4 * (x / BRICK_EDGE) + 2 * (y / BRICK_EDGE);
            visit(
                (x * APRON_EDGE + y) * APRON_EDGE,
                owner,
                ((x % BRICK_EDGE) * APRON_EDGE + y % BRICK_EDGE) * APRON_EDGE,
            );
        }
    }
}

/// Copies the first samples of the next bricks into each brick; far outside and deep inside all are
/// the same. Cold.
#[expect(
    clippy::indexing_slicing,
    reason = "start-up: slots of one map index the arrays of the other"
)]
fn fill_aprons<T: Copy + Send + Sync>(
    layers: &Layers,
    [outside, inside]: [T; 2],
    samples: &mut [[T; APRON_CELLS]],
) {
    let nothing = outside;
    let outside = [outside; APRON_CELLS];
    let inside = [inside; APRON_CELLS];
    for first in (0..samples.len()).step_by(APRON_CHUNK) {
        let bricks = &layers.bricks[first..layers.bricks.len().min(first + APRON_CHUNK)];
        let borrowed = parallel::map(bricks.len(), 16, |place| {
            let coord = layers.grid.brick_coord(bricks[place] as usize);
            let owners: [&[T; APRON_CELLS]; 8] = core::array::from_fn(|owner| {
                let offset = [owner >> 2 & 1, owner >> 1 & 1, owner & 1].map(|i| i as i32);
                match layers
                    .grid
                    .brick_neighbour(coord, offset)
                    .map_or(FAR_OUTSIDE, |neighbour| layers.top[neighbour])
                {
                    FAR_OUTSIDE => &outside,
                    DEEP_INSIDE => &inside,
                    slot => &samples[slot as usize],
                }
            });
            let mut borrowed = [nothing; BORROWED];
            let mut n = 0;
            each_apron_row(|_, owner, there| {
                if owner != 0 {
                    borrowed[n..n + BRICK_EDGE]
                        .copy_from_slice(&owners[owner][there..there + BRICK_EDGE]);
                    n += BRICK_EDGE;
                }
                borrowed[n] = owners[owner + 1][there];
                n += 1;
            });
            borrowed
        });
        parallel::map_mut(&mut samples[first..][..bricks.len()], 16, |place, samples| {
            let borrowed = &borrowed[place];
            let mut n = 0;
            each_apron_row(|first, owner, _| {
                if owner != 0 {
                    samples[first..first + BRICK_EDGE]
                        .copy_from_slice(&borrowed[n..n + BRICK_EDGE]);
                    n += BRICK_EDGE;
                }
                samples[first + BRICK_EDGE] = borrowed[n];
                n += 1;
            });
        });
    }
}

/// Cell that a point lies in: coordinates rounded down, by a cast and a comparison where `floor` is
/// a function call.
///
/// Casts saturate: far points become indices that the range check refuses, NaN becomes 0.
#[inline]
fn whole(cells: Vec3) -> [i32; 3] {
    let floor = |cell: f32| {
        let truncated = cell as i32;
        truncated.saturating_sub(i32::from(truncated as f32 > cell))
    };
    [floor(cells.x), floor(cells.y), floor(cells.z)]
}

#[inline]
fn to_vec3([x, y, z]: [i32; 3]) -> Vec3 {
    Vec3::new(x as f32, y as f32, z as f32)
}

enum Corners {
    /// Indexed x·4 + y·2 + z.
    Samples([f32; 8]),
    Uniform(f32),
}

enum Located {
    Cell(usize, usize),
    Uniform(f32),
}
