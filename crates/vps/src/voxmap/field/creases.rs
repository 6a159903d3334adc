//! The planes of an object's convex edges, which interpolation between samples rounds off.
//!
//! Data in: triangles and exact distances at the centres of cells. Data out: for the cells about
//! such an edge, and down from it between its two faces, the planes of which the least deep one
//! says how deep a place is.
//!
//! ```text
//!   convex edges ─► cells between their two faces, down the band ─► planes of each cell
//!                                      exact samples around it ─► kept where they agree
//! ```
//! A cell has planes only where the exact distances of all samples within a cell of it are those to
//! what the planes bound. Along edges that end where one of their faces goes on as a curve, beside
//! faces that are not listed, and at inner edges it has none: there [`rims`] has depths below
//! patches, or interpolation counts, as everywhere else.
//!
//! Cost, of a bake at 256 voxels on one processor, with the patches: 1.5 times what it was on the
//! Stanford bunny and a block with a hole, 5 on a nut, 6 on a gear. Memory: 2 KiB for a brick with
//! such cells, 32 bytes for a cell and a patch.
//!
//! # Source
//! Ours.

#![expect(clippy::indexing_slicing, reason = "start-up: numbers of one array's items index others")]

use core::ops::Range;
use core::ptr;
use std::collections::{HashMap, HashSet};

use bytemuck::{Pod, Zeroable};
use glam::{DMat3, DVec3, Vec3};

use super::rims::{self, PatchDepths, PatchesOfCell, Rim, Rims};
use super::{
    BRICK_CELLS, BRICK_EDGE, DEEP_INSIDE, Field, Located, MOST_MOVED_CELLS, to_vec3, whole,
};
use crate::mesh::TriangleMesh;
use crate::mesh::edges::{EdgePair, edge_uses};
use crate::parallel;
use crate::storage::SharedSlice;

/// Planes that meet in a cell, at most.
pub(crate) const PLANES: usize = 6;
/// An edge is sharp where its two faces turn by more than 20°: with less they are one that curves.
pub(super) const SMOOTH_COSINE: f64 = 0.9397;
/// Samples agree with planes up to this, cells.
pub(super) const AGREEING_CELLS: f64 = 0.01;
/// Planes are the same where they turn by less than a tenth of a degree, and are as near, cells.
const SAME_COSINE: f64 = 0.999_998_5;
const SAME_CELLS: f64 = 1e-3;
/// Faces smaller than this square and shorter edges are passed over: what is round in small facets
/// has many, and hardly a cell that agrees with them.
const LEAST_CELLS: f64 = 2.0;
/// Faces that meet sharper than this are followed down no further, bands.
const DEEPEST_BANDS: f64 = 4.0;
/// Half the diagonal of a cell, and as much for what a facet of a voxel reaches from its middle: no
/// such facet with its middle in a cell farther from an edge lies over it, cells.
pub(super) const NEAR_CELLS: f64 = 1.7321;
/// Outside as far as this distances are compared, cells, and edges within [`LISTED_CELLS`] of the
/// middle of a cell have the faces that are nearest to what is compared. The facets of a tool whose
/// points are three times as far apart as these voxels reach no farther.
const COMPARED_CELLS: f64 = 1.75;
pub(super) const LISTED_CELLS: f64 = COMPARED_CELLS + 2.6;
/// By how much farther outside interpolation may say that a place is: half the diagonal of a cell,
/// and what samples are moved by, cells.
const OVERSTATED_CELLS: f32 = 0.866_03 + MOST_MOVED_CELLS;
/// Distances outside are known as far as this: what a facet of a voxel reaches, and
/// [`OVERSTATED_CELLS`] of planes and patches.
const LEAST_BAND_CELLS: f32 = 2.0;
/// From the middle of a brick to those of its cells at its corners, at most, cells.
const BRICK_RADIUS: f64 = 6.1;
/// A brick without planes and patches.
const NONE: u32 = u32::MAX;
/// What a cell has are depths below patches, and not planes; of an inner edge; how many less one,
/// and the number of the first.
const PATCHES_BIT: u32 = 1 << 31;
const INNER_BIT: u32 = 1 << 30;
const MANY_SHIFT: u32 = 28;
const FIRST_MASK: u32 = (1 << MANY_SHIFT) - 1;

/// Which depths the number of a cell stands for.
fn patches_of(number: u32) -> Range<usize> {
    let first = (number & FIRST_MASK) as usize;
    first..first + 1 + (number >> MANY_SHIFT & 3) as usize
}

/// Planes, of which the one that is least deep counts. A plane (n, c), n unit and out of the
/// object, is c − n·p deep at a place p, both in cells; c is infinite where there is none.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct PlaneSet {
    planes: [[f64; 4]; PLANES],
}

impl PlaneSet {
    /// Normals and offsets.
    #[inline]
    pub(crate) fn planes(&self) -> impl Iterator<Item = (DVec3, f64)> + '_ {
        self.planes
            .iter()
            .map(|[x, y, z, offset]| (DVec3::new(*x, *y, *z), *offset))
            .take_while(|(_, offset)| offset.is_finite())
    }

    const NONE: Self = Self { planes: [[0.0, 0.0, 0.0, f64::INFINITY]; PLANES] };

    /// These planes; `None` where they are too many.
    pub(super) fn of_planes(planes: impl Iterator<Item = (DVec3, f64)>) -> Option<Self> {
        let mut set = Self::NONE;
        for (n, (normal, offset)) in planes.enumerate() {
            *set.planes.get_mut(n)? = [normal.x, normal.y, normal.z, offset];
        }
        Some(set)
    }

    /// The planes of the faces of some edges, each once; `None` where they are too many. `about`:
    /// where planes are compared, cells.
    fn of_edges(edges: &[&Edge], about: DVec3) -> Option<Self> {
        let mut set = Self::NONE;
        let mut n = 0;
        for (normal, offset) in edges.iter().flat_map(|edge| edge.faces) {
            let is_known = set.planes().any(|(known, known_offset)| {
                let apart = (offset - normal.dot(about)) - (known_offset - known.dot(about));
                known.dot(normal) > SAME_COSINE && apart.abs() < SAME_CELLS
            });
            if !is_known {
                *set.planes.get_mut(n)? = [normal.x, normal.y, normal.z, offset];
                n += 1;
            }
        }
        Some(set)
    }

    /// How deep a place is, cells.
    fn depth(&self, at: DVec3) -> f64 {
        self.planes().map(|(normal, offset)| offset - normal.dot(at)).fold(f64::INFINITY, f64::min)
    }

    /// Those of them that are least deep anywhere about the middle of a cell, as far as faces are
    /// listed.
    fn around(&self, middle: DVec3) -> Self {
        let corners = (0..8_i32).map(|n| {
            let [x, y, z] = [n >> 2, n >> 1, n].map(|bits| f64::from(2 * (bits & 1) - 1));
            middle + LISTED_CELLS * DVec3::new(x, y, z)
        });
        let is_hidden = |own: usize| {
            self.planes().enumerate().any(|(n, (other, other_offset))| {
                let [x, y, z, offset] = self.planes[own];
                // Of two that are as deep all over the first stays.
                n != own
                    && corners.clone().all(|at| {
                        let deeper =
                            (offset - DVec3::new(x, y, z).dot(at)) - (other_offset - other.dot(at));
                        deeper > 0.0 || deeper == 0.0 && n < own
                    })
            })
        };
        let mut kept = Self::NONE;
        let visible = (0..self.planes().count()).filter(|own| !is_hidden(*own));
        for (to, own) in kept.planes.iter_mut().zip(visible) {
            *to = self.planes[own];
        }
        kept
    }

    /// How far outside of what the planes bound a place is, cells: from the nearest point of it on
    /// a plane, on a line of two or in a corner of three; negative inside.
    fn outside(&self, at: DVec3) -> f64 {
        let inside = self.depth(at);
        if inside >= 0.0 {
            return -inside;
        }
        let planes: Vec<(DVec3, f64)> = self.planes().collect();
        let depth = |plane: usize| planes[plane].1 - planes[plane].0.dot(at);
        let mut nearest = f64::INFINITY;
        let mut offer = |by: DVec3| {
            if self.depth(at + by) > -1e-6 {
                nearest = nearest.min(by.length());
            }
        };
        for one in 0..planes.len() {
            let n = planes[one].0;
            offer(n * depth(one));
            for other in 0..one {
                let m = planes[other].0;
                let turn = n.dot(m);
                let by_n = (depth(one) - turn * depth(other)) / (1.0 - turn * turn);
                let by_m = (depth(other) - turn * depth(one)) / (1.0 - turn * turn);
                offer(n * by_n + m * by_m);
                for (third, plane) in planes[..other].iter().enumerate() {
                    let rows = DMat3::from_cols(n, m, plane.0).transpose();
                    let depths = DVec3::new(depth(one), depth(other), depth(third));
                    // What is not a number, of planes along one line, is no place inside.
                    offer(rows.inverse() * depths);
                }
            }
        }
        nearest
    }

    /// True of planes as a grid of at most so many cells along an axis has them.
    fn is_sound(&self, most_cells: f64) -> bool {
        let is_plane = |[x, y, z, offset]: &[f64; 4]| {
            let is_unit = (DVec3::new(*x, *y, *z).length_squared() - 1.0).abs() < 1e-6;
            is_unit && offset.abs() <= 2.0 * most_cells
        };
        let [first, others @ ..] = &self.planes;
        is_plane(first) && others.iter().all(|plane| is_plane(plane) || plane[3] == f64::INFINITY)
    }
}

/// See the module page. A clone is another handle on the same arrays.
#[derive(Clone, Debug, Default)]
pub(crate) struct Creases {
    /// `[n_bricks]`: entry of `cells`, or `u32::MAX`; empty without such cells.
    pub(super) of_brick: SharedSlice<u32>,
    /// `[…][8³]`, z fastest: of an interpolation cell 1 + number of the set, or which patches, with
    /// [`PATCHES_BIT`], or 0.
    pub(super) cells: SharedSlice<[u32; BRICK_CELLS]>,
    pub(super) sets: SharedSlice<PlaneSet>,
    pub(super) patches: SharedSlice<PatchDepths>,
}

/// What a place has at a crease.
pub(crate) struct Crease<'a> {
    planes: Option<&'a PlaneSet>,
    patches: &'a [PatchDepths],
    is_inner: bool,
    cells: Vec3,
    /// Between the samples, from 0 to 1.
    inside: Vec3,
}

impl Crease<'_> {
    /// The greatest depth counts, and not the least.
    #[inline]
    pub(crate) fn is_inner(&self) -> bool {
        self.is_inner
    }

    /// Depth below each side, cells, and its gradient. RT: safe.
    #[inline(always)]
    pub(crate) fn sides(&self) -> impl Iterator<Item = (f32, Vec3)> + '_ {
        let at = self.cells.as_dvec3();
        let planes = self.planes.into_iter().flat_map(PlaneSet::planes);
        let planes = planes.map(move |(n, offset)| ((offset - n.dot(at)) as f32, -n.as_vec3()));
        planes.chain(self.patches.iter().map(|patch| rims::side(patch, self.inside)))
    }
}

impl Creases {
    /// True of an object without such cells.
    pub(crate) fn is_empty(&self) -> bool {
        self.of_brick.is_empty()
    }

    /// What is to be added to the reach of a facet so that none is missed that touches by these
    /// planes, cells.
    pub(crate) fn slack_cells(&self) -> f32 {
        match (self.is_empty(), self.patches.is_empty()) {
            (true, _) => 0.0,
            (false, true) => OVERSTATED_CELLS,
            (false, false) => OVERSTATED_CELLS + rims::OVERSTATED_CELLS,
        }
    }

    /// `[n_bricks]`: `u32::MAX` of bricks without planes and patches; empty if there are none at
    /// all.
    #[inline]
    pub(crate) fn of_brick(&self) -> &[u32] {
        &self.of_brick
    }

    /// See the field of this name.
    #[inline]
    pub(crate) fn cells(&self) -> &[[u32; BRICK_CELLS]] {
        &self.cells
    }

    /// What the interpolation cell has that a place lies in, cells. RT: safe.
    #[inline(always)]
    pub(crate) fn at(&self, brick_dims: [i32; 3], cells: Vec3) -> Option<Crease<'_>> {
        let [x, y, z] = whole(cells - 0.5);
        let [nx, ny, nz] = brick_dims;
        let bx = x >> 3;
        let by = y >> 3;
        let bz = z >> 3;
        if bx as u32 >= nx as u32 || by as u32 >= ny as u32 || bz as u32 >= nz as u32 {
            return None;
        }
        let brick = (bx as usize * ny as usize + by as usize) * nz as usize + bz as usize;
        let of_cells = self.cells.get(*self.of_brick.get(brick)? as usize)?;
        let inside = ((x & 7) << 6 | (y & 7) << 3 | (z & 7)) as usize;
        let number = *of_cells.get(inside)?;
        let inside = cells - 0.5 - to_vec3([x, y, z]);
        if number & PATCHES_BIT != 0 {
            let patches = self.patches.get(patches_of(number))?;
            let is_inner = number & INNER_BIT != 0;
            return Some(Crease { planes: None, patches, is_inner, cells, inside });
        }
        let planes = Some(self.sets.get((number as usize).checked_sub(1)?)?);
        Some(Crease { planes, patches: &[], is_inner: false, cells, inside })
    }

    /// Size of the arrays, bytes.
    pub(super) fn heap_bytes(&self) -> usize {
        let Self { of_brick, cells, sets, patches } = self;
        size_of_val(&**of_brick)
            + size_of_val(&**cells)
            + size_of_val(&**sets)
            + size_of_val(&**patches)
    }

    /// True where the arrays belong to a grid of so many bricks, and kernels can count the cells by
    /// an `i32`.
    pub(super) fn is_consistent(&self, brick_dims: [i32; 3]) -> bool {
        let Self { of_brick, cells, sets, patches } = self;
        let n_bricks: usize = brick_dims.iter().map(|n| *n as usize).product();
        let n_entries = cells.len();
        let most_cells = 8.0 * brick_dims.iter().map(|n| f64::from(*n)).sum::<f64>();
        (of_brick.is_empty() || of_brick.len() == n_bricks && !cells.is_empty())
            && n_entries.checked_mul(BRICK_CELLS).is_some_and(|n| i32::try_from(n).is_ok())
            && of_brick.iter().all(|entry| *entry == NONE || (*entry as usize) < n_entries)
            && cells.iter().flatten().all(|number| match number & PATCHES_BIT {
                0 => *number as usize <= sets.len(),
                _ => patches_of(*number).end <= patches.len(),
            })
            && sets.iter().all(|set| set.is_sound(most_cells))
            && patches.iter().all(rims::is_sound)
    }

    /// Those of an object whose triangles face outwards, with its field's exact distances. Cold.
    pub(super) fn of(mesh: &TriangleMesh, field: &Field) -> Self {
        // Where less is known of the outside, facets that touch could be passed over.
        if field.band_m < LEAST_BAND_CELLS * field.voxel_size_m {
            return Self::default();
        }
        let pairs = edge_uses(&mesh.triangles, mesh.vertices.len()).pairs;
        let rims = Rims::new(mesh, field, &pairs);
        let edges = Edge::all(mesh, field, pairs);
        let mut near: Vec<(u32, u32)> = Vec::new();
        let of_rims = rims.edges.iter().map(|rim| &rim.edge);
        for (number, edge) in (0..).zip(edges.iter().chain(of_rims)) {
            let first = near.len();
            edge.each_brick(field, |brick| {
                if field.top.get(brick as usize).is_some_and(|slot| *slot < DEEP_INSIDE) {
                    near.push((brick, number));
                }
            });
            let own = near.split_off(first);
            near.extend(sorted(own));
        }
        let near = sorted(near);
        let bricks: Vec<&[(u32, u32)]> = near.chunk_by(|one, other| one.0 == other.0).collect();
        let found = parallel::map(bricks.len(), 4, |brick| {
            let near = bricks.get(brick).copied().unwrap_or_default();
            let brick = near.first()?.0;
            let is_plane = |near: &(u32, u32)| (near.1 as usize) < edges.len();
            let (own, of_rims) = near.split_at(near.partition_point(is_plane));
            let own = own.iter().map(|(_, number)| &edges[*number as usize]);
            let of_rims =
                of_rims.iter().map(|(_, number)| &rims.edges[*number as usize - edges.len()]);
            Some((brick, OfBrick::new(mesh, field, brick, own, (&rims, of_rims))?))
        });
        let mut creases = Growing::default();
        for (brick, of_brick) in found.into_iter().flatten() {
            creases.add(brick as usize, field.top.len(), &of_brick);
        }
        let Growing { of_brick, cells, sets, patches, .. } = creases;
        Self {
            of_brick: of_brick.into(),
            cells: cells.into(),
            sets: sets.into(),
            patches: patches.into(),
        }
    }
}

/// [`Creases`] while bricks are added.
#[derive(Default)]
struct Growing {
    of_brick: Vec<u32>,
    cells: Vec<[u32; BRICK_CELLS]>,
    sets: Vec<PlaneSet>,
    patches: Vec<PatchDepths>,
    /// Where each set is.
    numbers: HashMap<[[u64; 4]; PLANES], u32>,
}

impl Growing {
    fn add(&mut self, brick: usize, n_bricks: usize, found: &OfBrick) {
        let numbers: Vec<u32> = found.sets.iter().map(|set| self.number(set)).collect();
        let first_patches = u32::try_from(self.patches.len()).unwrap_or(u32::MAX);
        self.patches.extend(&found.patches);
        self.of_brick.resize(n_bricks, NONE);
        if let Some(entry) = self.of_brick.get_mut(brick) {
            *entry = self.cells.len() as u32;
            self.cells.push(found.cells.map(|own| match own {
                0 => 0,
                own if own & PATCHES_BIT == 0 => {
                    numbers.get(own as usize - 1).copied().unwrap_or(0)
                }
                // More than numbers hold count as interpolation has them.
                own => match (own & FIRST_MASK).checked_add(first_patches) {
                    Some(first) if first < FIRST_MASK - 3 => own & !FIRST_MASK | first,
                    _ => 0,
                },
            }));
        }
    }

    /// 1 + the number of a set.
    fn number(&mut self, set: &PlaneSet) -> u32 {
        let bits = set.planes.map(|plane| plane.map(f64::to_bits));
        *self.numbers.entry(bits).or_insert_with(|| {
            self.sets.push(*set);
            self.sets.len() as u32
        })
    }
}

/// What the cells of one brick have.
pub(super) struct OfBrick {
    /// As those of [`Creases`].
    pub(super) cells: [u32; BRICK_CELLS],
    sets: Vec<PlaneSet>,
    patches: Vec<PatchDepths>,
}

impl OfBrick {
    /// `None` where no cell has any.
    fn new<'a>(
        mesh: &TriangleMesh,
        field: &Field,
        brick: u32,
        edges: impl Iterator<Item = &'a Edge> + Clone,
        (rims, of_rims): (&Rims, impl Iterator<Item = &'a Rim> + Clone),
    ) -> Option<Self> {
        let [_, ny, nz] = field.brick_dims.map(|n| n as u32);
        let first = [brick / (ny * nz), brick / nz % ny, brick % nz].map(|n| 8 * n as i32);
        let samples = AroundBrick::new(field, first);
        let mut found = Self { cells: [0; BRICK_CELLS], sets: Vec::new(), patches: Vec::new() };
        // Cells beside each other have mostly the same edges.
        let mut candidates: Vec<(Vec<&Edge>, Option<Candidate>)> = Vec::new();
        let mut own: Vec<&Edge> = Vec::new();
        for (inside, number) in found.cells.iter_mut().enumerate() {
            let at = [inside >> 6, inside >> 3 & 7, inside & 7];
            let cell = core::array::from_fn(|k| first[k] + at[k] as i32);
            // Between the centres of eight cells.
            let middle = to_vec3(cell).as_dvec3() + 1.0;
            if !edges.clone().any(|edge| edge.is_near(middle, NEAR_CELLS)) {
                continue;
            }
            own.clear();
            own.extend(edges.clone().filter(|edge| edge.is_near(middle, LISTED_CELLS)));
            let known = candidates.iter().position(|(edges, _)| {
                edges.len() == own.len() && edges.iter().zip(&own).all(|(a, b)| ptr::eq(*a, *b))
            });
            let place = known.unwrap_or_else(|| {
                let set = PlaneSet::of_edges(&own, middle);
                candidates.push((own.clone(), set.map(Candidate::new)));
                candidates.len() - 1
            });
            let Some((_, Some(candidate))) = candidates.get_mut(place) else { continue };
            if !around(at).all(|place| candidate.agrees(&samples, place)) {
                continue;
            }
            let set = candidate.set.around(middle);
            let set_place = found.sets.iter().position(|known| *known == set);
            let set_place = set_place.unwrap_or_else(|| {
                found.sets.push(set);
                found.sets.len() - 1
            });
            *number = set_place as u32 + 1;
        }
        rims.add((mesh, field), (first, &samples), of_rims, &mut found);
        (!found.sets.is_empty() || !found.patches.is_empty()).then_some(found)
    }

    pub(super) fn set_patches(&mut self, cell: usize, own: PatchesOfCell) {
        let many = own.patches.len().saturating_sub(1) as u32;
        let inner = if own.is_inner { INNER_BIT } else { 0 };
        let first = self.patches.len() as u32;
        self.cells[cell] = PATCHES_BIT | inner | many << MANY_SHIFT | first;
        self.patches.extend(own.patches);
    }
}

/// Samples on the edge of what is around a brick: its own, one before, and two behind.
const AROUND_EDGE: usize = BRICK_EDGE + 3;
pub(super) const AROUND_BRICK: usize = AROUND_EDGE * AROUND_EDGE * AROUND_EDGE;
/// Samples within a cell of an interpolation cell.
pub(super) const AROUND_CELL: usize = 64;

/// Places of the samples within a cell of an interpolation cell of a brick: its own eight, and
/// those beside them.
pub(super) fn around([x, y, z]: [usize; 3]) -> impl Iterator<Item = usize> {
    (0..AROUND_CELL)
        .map(move |n| ((x + (n >> 4)) * AROUND_EDGE + y + (n >> 2 & 3)) * AROUND_EDGE + z + (n & 3))
}

/// Exact distances in a brick and around it.
pub(super) struct AroundBrick {
    /// Centre of the first cell, cells.
    first: DVec3,
    /// `[11³]`, z fastest, cells.
    distances: Vec<f64>,
    /// Where they saturate, cells.
    band: f64,
}

impl AroundBrick {
    pub(super) fn new(field: &Field, [x, y, z]: [i32; 3]) -> Self {
        let per_voxel = 1.0 / f64::from(field.voxel_size_m);
        let edge = AROUND_EDGE as i32;
        let cells = (0..edge * edge * edge)
            .map(|n| [x + n / (edge * edge) - 1, y + n / edge % edge - 1, z + n % edge - 1]);
        let distance_m = |cell| match field.locate(cell) {
            Located::Cell(slot, inside) => field.sample(slot, inside),
            Located::Uniform(value_m) => value_m,
        };
        Self {
            first: to_vec3([x, y, z]).as_dvec3() - 0.5,
            distances: cells.map(|cell| f64::from(distance_m(cell)) * per_voxel).collect(),
            band: f64::from(field.band_m) * per_voxel - AGREEING_CELLS,
        }
    }

    /// The same of what is deep by the most of these planes: an inner edge, seen from outside.
    pub(super) fn agrees_inside(&self, set: &PlaneSet, place: usize, up_to: f64) -> bool {
        let exact = self.distances[place];
        let flipped = PlaneSet::of_planes(set.planes().map(|(normal, offset)| (-normal, -offset)));
        let depth = flipped.map_or(f64::NAN, |flipped| flipped.outside(self.at(place)));
        exact.abs() < self.band && (depth - exact).abs() <= up_to
    }

    /// Where a sample is, cells.
    pub(super) fn at(&self, place: usize) -> DVec3 {
        let row = place / AROUND_EDGE;
        let at = [row / AROUND_EDGE, row % AROUND_EDGE, place % AROUND_EDGE];
        self.first + DVec3::from_array(at.map(|k| k as f64))
    }

    /// True of a sample that is no deeper than distances are known.
    pub(super) fn is_in_band(&self, place: usize) -> bool {
        self.distances[place] < self.band
    }

    /// True of a sample that is as deep as these planes say, or as far outside of what they bound,
    /// up to so many cells.
    pub(super) fn agrees(&self, set: &PlaneSet, place: usize, up_to: f64) -> bool {
        let exact = self.distances[place];
        let at = self.at(place);
        if !self.is_in_band(place) {
            // Depths grow no more here, as planes do.
            false
        } else if exact > -COMPARED_CELLS {
            (set.outside(at) + exact).abs() <= up_to
        } else {
            set.depth(at) <= up_to
        }
    }
}

/// Planes, and what is known so far of which samples agree with them.
struct Candidate {
    set: PlaneSet,
    known: Vec<Option<bool>>,
}

impl Candidate {
    fn new(set: PlaneSet) -> Self {
        Self { set, known: vec![None; AROUND_BRICK] }
    }

    fn agrees(&mut self, samples: &AroundBrick, place: usize) -> bool {
        *self.known[place].get_or_insert_with(|| samples.agrees(&self.set, place, AGREEING_CELLS))
    }
}

/// A sharp convex edge, cells.
pub(super) struct Edge {
    start: DVec3,
    /// Unit.
    along: DVec3,
    length: f64,
    /// Unit: into the object between the faces, and across from one to the other.
    down: DVec3,
    across: DVec3,
    /// How far down it is followed.
    deepest: f64,
    /// Normals out of the object, and offsets.
    faces: [(DVec3, f64); 2],
}

impl Edge {
    /// Those of a mesh, each from one end to the other, however it is cut into triangles.
    fn all(mesh: &TriangleMesh, field: &Field, pairs: Vec<EdgePair>) -> Vec<Self> {
        let per_metre = 1.0 / f64::from(field.voxel_size_m);
        let to_cells = |at: DVec3| (at - field.origin.as_dvec3()) * per_metre;
        let band = f64::from(field.band_m) * per_metre;
        let faces = Faces::new(mesh, pairs, per_metre * per_metre);
        // Where a face is one of a surface that curves: vertices, and the face.
        let mut curved: HashSet<(u32, u32)> = HashSet::new();
        for EdgePair { edge, triangles, .. } in &faces.pairs {
            let [(one_number, one), (other_number, other)] =
                triangles.map(|triangle| faces.of_triangle(triangle));
            if one_number != other_number && one.normal.dot(other.normal) > SMOOTH_COSINE {
                let both = edge.iter().flat_map(|at| [(*at, one_number), (*at, other_number)]);
                curved.extend(both);
            }
        }
        let mut parts: Vec<([u32; 2], f64, f64, bool)> = Vec::new();
        for EdgePair { edge, triangles, same_direction } in &faces.pairs {
            let [(one_number, one), (other_number, other)] =
                triangles.map(|triangle| faces.of_triangle(triangle));
            let is_large = |face: &Face| face.area >= LEAST_CELLS * LEAST_CELLS;
            if one_number == other_number || *same_direction || !is_large(one) || !is_large(other) {
                continue;
            }
            let turn = one.normal.dot(other.normal);
            let [_, second] = triangles.map(|triangle| mesh.corners(triangle as usize));
            let [start, end] = edge.map(|vertex| mesh.vertices[vertex as usize]);
            let beyond = second.iter().map(|corner| one.normal.dot(*corner - start)).sum::<f64>();
            if turn > SMOOTH_COSINE || beyond >= 0.0 {
                continue;
            }
            let numbers = [one_number.min(other_number), one_number.max(other_number)];
            let [one, other] = numbers.map(|number| faces.of_triangle(number).1);
            let along = one.normal.cross(other.normal).normalize_or_zero();
            let ends = [to_cells(start).dot(along), to_cells(end).dot(along)];
            let is_of_curve =
                edge.iter().any(|at| numbers.iter().any(|face| curved.contains(&(*at, *face))));
            parts.push((numbers, ends[0].min(ends[1]), ends[0].max(ends[1]), is_of_curve));
        }
        parts.sort_unstable_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
        // Two planes meet in one line.
        let mut edges = Vec::new();
        for of_faces in parts.chunk_by(|one, other| one.0 == other.0 && other.1 <= one.2 + 1e-6) {
            let ([one, other], from, ..) = of_faces[0];
            let to = of_faces.iter().map(|part| part.2).fold(from, f64::max);
            // Along a rim some cells would have planes and the next have none.
            if to - from < LEAST_CELLS || of_faces.iter().any(|part| part.3) {
                continue;
            }
            let sides = [one, other].map(|number| {
                let (_, face) = faces.of_triangle(number);
                (face.normal, face.normal.dot(to_cells(face.on_it)))
            });
            edges.extend(Self::between(sides, [from, to], band));
        }
        edges
    }

    /// The part of the line that two planes meet in.
    pub(super) fn between(
        faces: [(DVec3, f64); 2],
        [from, to]: [f64; 2],
        band: f64,
    ) -> Option<Self> {
        let [(one, one_offset), (other, other_offset)] = faces;
        let along = one.cross(other).try_normalize()?;
        // The place on both planes that is nearest to the origin.
        let turn = one.dot(other);
        let by_one = (one_offset - turn * other_offset) / (1.0 - turn * turn);
        let by_other = (other_offset - turn * one_offset) / (1.0 - turn * turn);
        // Half the sum is as long as depth grows per cell.
        let mean = 0.5 * (one + other);
        Some(Self {
            start: one * by_one + other * by_other + along * from,
            along,
            length: to - from,
            down: -mean.try_normalize()?,
            across: (one - other).try_normalize()?,
            deepest: (band / mean.length()).min(DEEPEST_BANDS * band),
            faces,
        })
    }

    /// The edge without what is below it.
    pub(super) fn only(self) -> Self {
        Self { deepest: 0.0, ..self }
    }

    /// True within so far of what lies between the faces, from the edge down.
    pub(super) fn is_near(&self, at: DVec3, by: f64) -> bool {
        let from = at - self.start;
        from.dot(self.across).abs() <= by
            && (-by..=self.length + by).contains(&from.dot(self.along))
            && (-by..=self.deepest + by).contains(&from.dot(self.down))
    }

    /// Visits the bricks that a cell near the edge may be in; some of them more than once.
    fn each_brick(&self, field: &Field, mut visit: impl FnMut(u32)) {
        const STEP: f64 = BRICK_EDGE as f64;
        let steps = |length: f64| (length / STEP).ceil() as usize;
        for n in 0..=steps(self.length) {
            for m in 0..=steps(self.deepest) {
                let along = (n as f64 * STEP).min(self.length);
                let down = (m as f64 * STEP).min(self.deepest);
                let at = self.start + self.along * along + self.down * down;
                let [x, y, z] = whole((at / STEP).as_vec3());
                for beside in 0..27 {
                    let brick = [x + beside / 9 - 1, y + beside / 3 % 3 - 1, z + beside % 3 - 1];
                    let middle = to_vec3(brick).as_dvec3() * STEP + (0.5 * STEP + 0.5);
                    if self.is_near(middle, LISTED_CELLS + BRICK_RADIUS)
                        && let Some(brick) = field.brick(brick)
                    {
                        visit(brick as u32);
                    }
                }
            }
        }
    }
}

/// A plane face of a mesh.
#[derive(Clone, Copy)]
struct Face {
    /// Unit, out of the object; zero of a face without area.
    normal: DVec3,
    on_it: DVec3,
    /// Cells².
    area: f64,
}

/// Triangles that belong together.
pub(super) struct Groups {
    /// Of each triangle another one of its group, at last the first.
    next: Vec<u32>,
}

impl Groups {
    pub(super) fn new(n_triangles: usize) -> Self {
        Self { next: (0..n_triangles as u32).collect() }
    }

    /// The lowest triangle of a group.
    pub(super) fn first(&mut self, mut triangle: u32) -> u32 {
        while self.next[triangle as usize] != triangle {
            // Halving the way keeps it short.
            let next = self.next[self.next[triangle as usize] as usize];
            self.next[triangle as usize] = next;
            triangle = next;
        }
        triangle
    }

    pub(super) fn join(&mut self, one: u32, other: u32) {
        let firsts = [self.first(one), self.first(other)];
        self.next[firsts[0].max(firsts[1]) as usize] = firsts[0].min(firsts[1]);
    }
}

/// The plane faces of a mesh: triangles that lie in one plane and are joined by edges.
struct Faces {
    pairs: Vec<EdgePair>,
    groups: Groups,
    /// Of each triangle; what is known of a face stands at its first.
    faces: Vec<Face>,
}

impl Faces {
    fn new(mesh: &TriangleMesh, pairs: Vec<EdgePair>, per_square_metre: f64) -> Self {
        let of_triangle = |triangle: usize| {
            let [a, b, c] = mesh.corners(triangle);
            let doubled = (b - a).cross(c - a);
            let area = 0.5 * doubled.length() * per_square_metre;
            Face { normal: doubled.normalize_or_zero(), on_it: a, area }
        };
        let n_triangles = mesh.triangles.len();
        let mut groups = Groups::new(n_triangles);
        let mut faces: Vec<Face> = (0..n_triangles).map(of_triangle).collect();
        for pair in pairs.iter().filter(|pair| !pair.same_direction) {
            let [one, other] = pair.triangles.map(|triangle| groups.first(triangle));
            let [first, second] = [one.min(other), one.max(other)];
            let [kept, joined] = [first, second].map(|face| faces[face as usize]);
            if first != second && kept.normal.dot(joined.normal) > SAME_COSINE {
                // The larger one knows the plane best.
                let larger = if joined.area > kept.area { joined } else { kept };
                faces[first as usize] = Face { area: kept.area + joined.area, ..larger };
                groups.join(first, second);
            }
        }
        for triangle in 0..n_triangles as u32 {
            groups.next[triangle as usize] = groups.first(triangle);
        }
        Self { pairs, groups, faces }
    }

    /// The number of a triangle's face, and the face.
    fn of_triangle(&self, triangle: u32) -> (u32, &Face) {
        let first = self.groups.next[triangle as usize];
        (first, &self.faces[first as usize])
    }
}

fn sorted(mut pairs: Vec<(u32, u32)>) -> Vec<(u32, u32)> {
    pairs.sort_unstable();
    pairs.dedup();
    pairs
}

impl Field {
    /// Number of a brick of the grid.
    fn brick(&self, [x, y, z]: [i32; 3]) -> Option<usize> {
        let [nx, ny, nz] = self.brick_dims;
        let is_in = (0..nx).contains(&x) && (0..ny).contains(&y) && (0..nz).contains(&z);
        is_in.then(|| (x as usize * ny as usize + y as usize) * nz as usize + z as usize)
    }
}

#[cfg(test)]
#[expect(clippy::expect_used, reason = "test code")]
mod tests {
    use super::*;
    use crate::mesh::closest_point::TriangleProjector;
    use crate::mesh::validate::inspect;
    use crate::spatial::testing::Random;
    use crate::voxmap::inside_test::InsideTest;
    use crate::voxmap::{Options, Volume};

    const VOXEL_M: f64 = 1e-3;

    /// A prism over a profile, turned and moved anyhow.
    fn prism(profile: &[[f64; 2]], height: f64, random: &mut Random) -> TriangleMesh {
        let n = profile.len() as u32;
        let turn = glam::DQuat::from_scaled_axis(random.in_box(-2.0, 2.0));
        let aside = random.in_box(-VOXEL_M, VOXEL_M);
        let at = |z: f64| {
            profile.iter().map(move |[x, y]| aside + turn * (DVec3::new(*x, *y, z) * VOXEL_M))
        };
        let vertices = at(0.0).chain(at(height)).collect();
        let sides = (0..n).flat_map(|k| {
            let next = (k + 1) % n;
            [[k, next, n + next], [k, n + next, n + k]]
        });
        // The profile is seen from its first corner.
        let lids = (1..n - 1).flat_map(|k| [[0, k + 1, k], [n, n + k, n + k + 1]]);
        TriangleMesh { vertices, triangles: sides.chain(lids).collect() }
    }

    /// How deep a place is, by all triangles; the one that is nearest and faces it says the side.
    fn depth_m(mesh: &TriangleMesh, at: DVec3) -> f64 {
        let mut best = (f64::INFINITY, 0.0_f64);
        for triangle in 0..mesh.triangles.len() {
            let [a, b, c] = mesh.corners(triangle);
            let closest = TriangleProjector::new(&[a, b, c]).project(at).point;
            let away = at - closest;
            let height = away.dot((b - a).cross(c - a).normalize());
            let squared = away.length_squared();
            if squared < best.0 - 1e-15 || squared < best.0 + 1e-15 && height.abs() > best.1.abs() {
                best = (squared, height);
            }
        }
        -best.1.signum() * best.0.sqrt()
    }

    #[test]
    fn planes_say_how_deep_a_place_is_and_only_where_they_do() {
        let block = [[0.0, 0.0], [14.0, 0.0], [14.0, 11.0], [0.0, 11.0]];
        let wedge = [[0.0, 0.0], [20.0, 0.0], [0.0, 9.0]];
        let step = [[0.0, 0.0], [18.0, 0.0], [18.0, 9.0], [9.0, 9.0], [9.0, 18.0], [0.0, 18.0]];
        let mut random = Random(20);
        for (name, profile, share) in
            [("block", &block[..], 0.9), ("wedge", &wedge, 0.5), ("step", &step, 0.5)]
        {
            let mesh = prism(profile, 12.0, &mut random);
            let options = Options { layers: 8, ..Options::new(VOXEL_M) };
            let options = Options { sides: InsideTest::Auto, ..options };
            let field = Volume::build(&mesh, &inspect(&mesh), &options, |_| ())
                .expect("a small grid")
                .field(&mesh, false);
            let low = DVec3::splat(-2.0 * VOXEL_M);
            let mut n_at_edges = 0;
            let mut n_with_planes = 0;
            for _ in 0..4000 {
                let triangle = (random.unit() * mesh.triangles.len() as f64) as usize;
                let [a, b, _] = mesh.corners(triangle);
                let at = a.lerp(b, random.unit()) + random.in_box(low.x, -low.x);
                let truth = depth_m(&mesh, at) / VOXEL_M;
                let cells = (at - field.origin.as_dvec3()) / VOXEL_M;
                let set = field.creases.at(field.brick_dims, cells.as_vec3());
                n_at_edges += 1;
                let Some(set) = set else { continue };
                n_with_planes += 1;
                let depths = set.sides().map(|(depth, _)| f64::from(depth));
                let depth = match set.is_inner() {
                    true => depths.fold(f64::NEG_INFINITY, f64::max),
                    false => depths.fold(f64::INFINITY, f64::min),
                };
                let is_right = if truth > 0.0 {
                    (depth - truth).abs() < 2.0 * AGREEING_CELLS
                } else {
                    depth < 2.0 * AGREEING_CELLS && depth > truth - 2.0 * AGREEING_CELLS
                };
                assert!(is_right, "{name}, {cells}: {depth} and not {truth}");
            }
            let found = f64::from(n_with_planes) / f64::from(n_at_edges);
            assert!(found > 0.3 * share, "{name}: {found} of the places at edges have planes");
        }
    }
}
