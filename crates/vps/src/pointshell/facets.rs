//! A point for each facet: what one face of the mesh leaves in a voxel, with its area and extent.
//!
//! The force of a pointshell, Σ d·n, is an integral over the immersed surface when each point
//! counts with the surface that it stands for: ∫ d n dA, which the divergence theorem makes that
//! over the volume of the overlap. One point for each surface voxel does not: an oblique face has
//! up to √3 times as many of them as one along the grid.
//!
//! ```text
//!   triangle ∩ voxel ─► polygons ─► grouped by direction: facets (area vector, centroid, half axes)
//!   convex edges, corners ─► a probe there, without area
//! ```
//! - **Exact in the plane**: area vectors of a closed mesh add up to nothing, and a face that is
//!   immersed as a whole presses with its area, at its centroid, however it lies in the grid.
//! - **Half axes** are those of the rectangle with the facet's second moment of area: they say how
//!   much of it is immersed where its centroid is not, or not all of it.
//! - **Edges and corners have probes**, as the deepest place of a convex body on a wall is one of
//!   them: they say how deep, and press nothing.
//! - **Voxels with a sharp edge are cut** into eight, and those of the parts that hold the edge once
//!   more: contact begins there, with less than a voxel immersed. **Tips** are cut down to a
//!   sixteenth: the ends of pins, and what curves about the apex of a cone, which has no sharp
//!   edge.
//! - Detail finer than the voxels is several faces in one voxel: at most [`GROUPS`] of them.
//!
//! # Source
//! Ours. The divergence theorem; polygons are clipped by Sutherland and Hodgman's method.

use core::ops::Range;

use glam::{DMat2, DMat3, DVec2, DVec3};

use super::bins::{Bins, cell_range};
use crate::mesh::TriangleMesh;
use crate::voxmap::Volume;
use crate::voxmap::grid::{BRICK_CELLS, BRICK_EDGE, brick_origin};
use crate::voxmap::surface::{Mask, bits};

/// A point of the shell before it is laid out.
#[derive(Clone, Copy, Debug)]
pub(super) struct FacetPoint {
    /// Cell coordinates.
    pub(super) cells: DVec3,
    /// Unit, into the object, map axes.
    pub(super) inward: DVec3,
    /// Surface that it stands for, s²; 0 of a probe.
    pub(super) weight: f64,
    /// Half axes of the rectangle with this second moment of area, s, map axes; the longer first.
    pub(super) half_axes: [DVec3; 2],
    /// Its voxel holds an edge, a corner or a tip.
    pub(super) on_edge: bool,
}

/// Faces of one voxel that are distinguished; others join the one they are nearest to in direction.
const GROUPS: usize = 8;
/// Directions within 30° are one face of a voxel; an edge between faces further apart is sharp.
const SHARP_COSINE: f64 = 0.866;
/// About a tip, directions within 15° are one face.
const ALIKE_COSINE: f64 = 0.966;
/// Volume that the normals about a corner span at least; those about an edge lie in a plane.
const CORNER_VOLUME: f64 = 0.2;
/// The area vector of what turns by no more than 15° is no less than this of its area.
const FLAT: f64 = 0.985;
/// Second invariant of the spread of directions in a voxel that is cut as a tip: some 20° along
/// each of two axes, or a radius of about a voxel.
const ROUND: f64 = 0.002;
/// A facet of no more area joins one beside it, s².
const SLIVER: f64 = 0.4;
/// If both lie within 10°, and are together no larger than a facet can be.
const JOINED_COSINE: f64 = 0.985;
/// The largest plane section of a voxel is √2 s².
const AREA_MAX: f64 = core::f64::consts::SQRT_2;
/// Area below which rounding decides what is in a voxel, s².
const AREA_MIN: f64 = 1e-9;
/// A voxel with a sharp edge is cut into so many parts along each axis …
const PARTS: usize = 2;
/// … and each of these that holds the edge once more: contact begins at edges, and there less than
/// a voxel is immersed.
const EDGE_CUTS: usize = 2;
/// Cuts of a voxel that curves about a tip.
const TIP_CUTS: usize = 4;
/// A brick that holds more of these is rough and has no tips.
const TIPS_OF_BRICK: usize = 48;
/// A tip is a corner whose faces look at least so many ways …
const TIP_WAYS: usize = 6;
/// … and what is about it lies within so many voxels.
const TIP_VOXELS: f64 = 2.5;
/// Corners of one voxel that get a point of their own.
const CORNERS: usize = 4;

/// What the faces of one direction leave in a voxel.
#[derive(Clone, Copy)]
struct Group {
    /// Outward area vector, s².
    area: DVec3,
    /// Area, area times centroid, and the second moment of area about the origin of the cells.
    size: f64,
    moment: DVec3,
    second: DMat3,
}

/// What a voxel holds.
#[derive(Clone, Copy)]
struct Cell {
    groups: [Group; GROUPS],
    n_groups: usize,
    /// n nᵀ over all area, s².
    directions: DMat3,
    /// Length of the sharp edges, and length times middle.
    edge_length: f64,
    edge_moment: DVec3,
    corners: [DVec3; CORNERS],
    n_corners: usize,
}

/// A triangle.
#[derive(Clone, Copy)]
struct Face {
    corners: [DVec3; 3],
    vertices: [u32; 3],
    /// Unit, out of the material; zero without area.
    outward: DVec3,
}

/// The facets of one brick, in cache.
#[derive(Default)]
pub(super) struct Scratch {
    whole: Level,
    /// One per cut.
    fine: [Level; TIP_CUTS],
    triangles: Vec<u32>,
}

/// The faces in a block of cells, and what they leave in each.
struct Level {
    cells: Vec<Cell>,
    faces: Vec<Face>,
    /// Vertices or edges and the face that they belong to, sorted.
    shared: Vec<(u64, u32)>,
    /// Where the faces meet in a tip, in the block and about it.
    tips: Vec<DVec3>,
}

impl Default for Level {
    fn default() -> Self {
        let cells = vec![Cell::EMPTY; BRICK_CELLS];
        Self { cells, faces: Vec::new(), shared: Vec::new(), tips: Vec::new() }
    }
}

impl Scratch {
    /// Adds the points of the brick in one slot, in the order of its cells.
    pub(super) fn find(
        &mut self,
        mesh: &TriangleMesh,
        map: &Volume,
        bins: &Bins,
        slot: usize,
        points: &mut Vec<FacetPoint>,
    ) {
        let grid = &map.surface.grid;
        let [x, y, z] =
            brick_origin(grid.brick_coord(map.surface.bricks[slot] as usize)).map(f64::from);
        let brick = Block {
            origin: DVec3::new(x, y, z),
            edge: 1.0,
            mask: map.surface.masks[slot],
            alike: SHARP_COSINE,
        };
        // The bins have no order, and sums have one.
        self.triangles.clear();
        self.triangles.extend(bins.triangles(slot));
        self.triangles.sort_unstable();
        let Self { whole, fine, triangles } = self;
        whole.faces.clear();
        whole.faces.extend(triangles.iter().map(|triangle_idx| {
            let corners = mesh.corners(*triangle_idx as usize).map(|corner| grid.to_cells(corner));
            let winding =
                (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize_or_zero();
            let outward = winding * map.orientation.sign(*triangle_idx);
            Face { corners, vertices: mesh.triangles[*triangle_idx as usize], outward }
        }));
        whole.fill(&brick);
        whole.join_slivers(&brick);
        whole.points(&brick, fine, false, points);
    }
}

impl Level {
    /// Finds what the faces leave in the cells of a block.
    fn fill(&mut self, block: &Block) {
        for (x, word) in block.mask.iter().enumerate() {
            bits(*word).for_each(|bit| self.cells[x << 6 | bit as usize].clear());
        }
        self.tips.clear();
        for face in &self.faces {
            add_face(&mut self.cells, face, block);
        }
        let first = self.faces.first().map_or(DVec3::ZERO, |face| face.outward);
        if self.faces.iter().any(|face| face.outward.dot(first) < SHARP_COSINE) {
            self.add_edges(block);
            self.add_corners(block);
        }
    }

    /// Adds the points of a block that was filled, in the order of its cells; cells with a sharp edge
    /// are cut once for each of the `finer` levels, and parts of the first cut have probes.
    /// `on_edge`: the block is part of such a voxel.
    fn points(
        &self,
        block: &Block,
        finer: &mut [Self],
        on_edge: bool,
        points: &mut Vec<FacetPoint>,
    ) {
        let places = || {
            block.mask.iter().enumerate().flat_map(|(x, word)| {
                bits(*word).map(move |bit| [x, (bit >> 3) as usize, (bit & 7) as usize])
            })
        };
        let at = |[x, y, z]: [usize; 3]| &self.cells[x << 6 | y << 3 | z];
        let is_tip = |place: &[usize; 3]| self.is_tip(at(*place), block, *place);
        let has_tips = places().filter(is_tip).count() <= TIPS_OF_BRICK;
        for place in places() {
            let cell = at(place);
            if finer.len() + 1 == TIP_CUTS {
                cell.probes(points);
            }
            let is_tip = has_tips && self.is_tip(cell, block, place);
            let is_cut = is_tip || finer.len() + EDGE_CUTS > TIP_CUTS && cell.is_sharp();
            let Some((fine, finer)) = finer.split_first_mut().filter(|_| is_cut) else {
                cell.facets(on_edge, points);
                continue;
            };
            let alike = if is_tip { ALIKE_COSINE } else { block.alike };
            let parts = block.parts(place, alike);
            fine.faces.clear();
            fine.faces.extend(self.faces.iter().filter(|face| face.reaches(block, place)));
            fine.fill(&parts);
            fine.points(&parts, finer, true, points);
        }
    }

    /// True of a cell that curves about two axes, as the end of a pin, or beside a tip.
    fn is_tip(&self, cell: &Cell, block: &Block, place: [usize; 3]) -> bool {
        let middle = block.corner(place) + 0.5 * block.edge;
        let mut tips = self.tips.iter();
        !cell.is_sharp() && cell.is_round()
            || tips.any(|tip| tip.distance(middle) < TIP_VOXELS) && cell.curves()
    }

    /// Gives what is left of a face in the corner of a voxel to the facet of the same face beside
    /// it: half of the points of an oblique face would stand for next to nothing. Within a block,
    /// in the order of its cells.
    fn join_slivers(&mut self, block: &Block) {
        for (x, word) in block.mask.iter().enumerate() {
            for bit in bits(*word) {
                let inside = x << 6 | bit as usize;
                let cell = &self.cells[inside];
                let sliver = cell.groups[0];
                if cell.n_groups != 1 || cell.is_sharp() || sliver.size > SLIVER {
                    continue;
                }
                let mut best = (0.0, 0);
                for (at, size) in self.beside(inside, block, &sliver) {
                    if size > best.0 {
                        best = (size, at);
                    }
                }
                if best.0 > 0.0 {
                    let group = &mut self.cells[best.1].groups[0];
                    group.area += sliver.area;
                    group.size += sliver.size;
                    group.moment += sliver.moment;
                    group.second += sliver.second;
                    self.cells[inside].n_groups = 0;
                }
            }
        }
    }

    /// Cells across the sides of one that hold the same face and nothing else, and how much of it.
    fn beside(
        &self,
        inside: usize,
        block: &Block,
        of: &Group,
    ) -> impl Iterator<Item = (usize, f64)> {
        let place = [inside >> 6, inside >> 3 & 7, inside & 7];
        let direction = of.area / of.size;
        [(0, 64), (1, 8), (2, 1)].into_iter().flat_map(move |(axis, stride)| {
            let before = (place[axis] > 0).then(|| inside - stride);
            let after = (place[axis] < BRICK_EDGE - 1).then(|| inside + stride);
            [before, after].into_iter().flatten().filter_map(move |at| {
                let cell = &self.cells[at];
                let group = &self.cells[at].groups[0];
                let is_surface = block.mask[at >> 6] >> (at & 63) & 1 == 1;
                let is_alike = || {
                    cell.n_groups == 1
                        && !cell.is_sharp()
                        && group.area.dot(direction) > JOINED_COSINE * group.size
                };
                (is_surface && is_alike() && group.size + of.size <= AREA_MAX)
                    .then_some((at, group.size))
            })
        })
    }

    /// Convex edges between two faces.
    fn add_edges(&mut self, block: &Block) {
        let Self { cells, faces, shared, tips: _ } = self;
        shared.clear();
        for (idx, face) in (0..).zip(faces.iter()) {
            let [a, b, c] = face.vertices;
            shared.extend(
                [[a, b], [b, c], [c, a]].map(|[from, to]| {
                    (u64::from(from.min(to)) << 32 | u64::from(from.max(to)), idx)
                }),
            );
        }
        shared.sort_unstable();
        for edge in shared.chunk_by(|one, other| one.0 == other.0) {
            let &[(ends, one), (_, other)] = edge else { continue };
            let one = &faces[one as usize];
            let other = &faces[other as usize];
            if one.outward.dot(other.outward) >= SHARP_COSINE || !is_below(other, one) {
                continue;
            }
            if let (Some(from), Some(to)) =
                (one.place_of((ends >> 32) as u32), one.place_of(ends as u32))
            {
                add_edge(cells, from, to, block);
            }
        }
    }

    /// Convex corners: vertices whose faces look three ways.
    fn add_corners(&mut self, block: &Block) {
        let Self { cells, faces, shared, tips } = self;
        shared.clear();
        for (idx, face) in (0..).zip(faces.iter()) {
            shared.extend(face.vertices.map(|vertex| (u64::from(vertex), idx)));
        }
        shared.sort_unstable();
        for around in shared.chunk_by(|one, other| one.0 == other.0) {
            let vertex = around[0].0 as u32;
            let of = |(_, idx): &(u64, u32)| &faces[*idx as usize];
            let Some(place) = of(&around[0]).place_of(vertex) else { continue };
            let normals = || around.iter().map(|item| of(item).outward);
            let first = of(&around[0]).outward;
            let second = farthest(normals(), |normal| first.cross(normal).length_squared());
            let pair = first.cross(second);
            let third = farthest(normals(), |normal| pair.dot(normal).abs());
            let mean = normals().sum::<DVec3>();
            let is_convex = || {
                around
                    .iter()
                    .flat_map(|item| of(item).corners)
                    .all(|corner| (corner - place).dot(mean) <= 0.0)
            };
            if pair.dot(third).abs() < CORNER_VOLUME || !is_convex() {
                continue;
            }
            if ways(normals()) >= TIP_WAYS {
                tips.push(place);
            }
            // A corner on the boundary of a cell belongs to the one that holds its faces.
            let own = block.inside(place).filter(|inside| cells[*inside].n_groups > 0);
            let beside = || block.inside(place - mean.normalize_or_zero() * (1e-3 * block.edge));
            if let Some(inside) = own.or_else(beside) {
                let cell = &mut cells[inside];
                if cell.n_corners < CORNERS {
                    cell.corners[cell.n_corners] = place;
                    cell.n_corners += 1;
                }
            }
        }
    }
}

impl Face {
    /// True when the triangle's box touches a cell of a block.
    fn reaches(&self, block: &Block, cell: [usize; 3]) -> bool {
        let [a, b, c] = self.corners;
        let origin = block.corner(cell);
        a.min(b).min(c).cmple(origin + block.edge).all() && a.max(b).max(c).cmpge(origin).all()
    }

    fn place_of(&self, vertex: u32) -> Option<DVec3> {
        (0..3).find(|at| self.vertices[*at] == vertex).map(|at| self.corners[at])
    }
}

/// True where the second face falls away behind the first: the edge between them is convex.
fn is_below(face: &Face, of: &Face) -> bool {
    let beyond =
        face.corners.iter().zip(face.vertices).filter(|(_, vertex)| !of.vertices.contains(vertex));
    beyond.map(|(corner, _)| (*corner - of.corners[0]).dot(of.outward)).all(|height| height < 0.0)
}

/// How many ways normals look, each more than 15° from all others, up to [`TIP_WAYS`].
fn ways(normals: impl Iterator<Item = DVec3>) -> usize {
    let mut known = [DVec3::ZERO; TIP_WAYS];
    let mut n_known = 0;
    for normal in normals {
        if n_known < TIP_WAYS && known[..n_known].iter().all(|it| it.dot(normal) < ALIKE_COSINE) {
            known[n_known] = normal;
            n_known += 1;
        }
    }
    n_known
}

fn farthest(normals: impl Iterator<Item = DVec3>, by: impl Fn(DVec3) -> f64) -> DVec3 {
    normals
        .map(|normal| (by(normal), normal))
        .fold((-1.0, DVec3::ZERO), |best, next| if next.0 > best.0 { next } else { best })
        .1
}

impl Cell {
    const EMPTY: Self = Self {
        groups: [Group::NOTHING; GROUPS],
        n_groups: 0,
        directions: DMat3::ZERO,
        edge_length: 0.0,
        edge_moment: DVec3::ZERO,
        corners: [DVec3::ZERO; CORNERS],
        n_corners: 0,
    };

    /// Groups are cleared when they are opened: a brick of them is large.
    fn clear(&mut self) {
        let Self {
            groups: _,
            n_groups,
            directions,
            edge_length,
            edge_moment,
            corners: _,
            n_corners,
        } = self;
        (*n_groups, *edge_length, *edge_moment, *n_corners) = (0, 0.0, DVec3::ZERO, 0);
        *directions = DMat3::ZERO;
    }

    fn add(&mut self, outward: DVec3, alike: f64, Moments { size, first, second }: Moments) {
        let direction = outward;
        let nearness =
            |group: &Group| group.area.dot(direction) / group.area.length().max(AREA_MIN);
        let used = &mut self.groups[..self.n_groups];
        let nearest =
            used.iter_mut().max_by(|one, other| nearness(one).total_cmp(&nearness(other)));
        let is_full = self.n_groups == GROUPS;
        let group = match nearest {
            Some(group) if is_full || nearness(group) >= alike => group,
            _ => {
                self.n_groups += 1;
                let group = &mut self.groups[self.n_groups - 1];
                *group = Group::NOTHING;
                group
            }
        };
        self.directions += outer(outward) * size;
        group.area += outward * size;
        group.size += size;
        group.moment += first;
        group.second += second;
    }

    fn is_sharp(&self) -> bool {
        self.edge_length > 0.0 || self.n_corners > 0
    }

    /// Its faces turn about two axes: see [`ROUND`].
    fn is_round(&self) -> bool {
        let mut size = 0.0;
        let mut area = DVec3::ZERO;
        for group in self.groups() {
            size += group.size;
            area += group.area;
        }
        let spread = self.directions * (1.0 / size) - outer(area / size);
        let trace = spread.x_axis.x + spread.y_axis.y + spread.z_axis.z;
        let squares = spread.x_axis.length_squared()
            + spread.y_axis.length_squared()
            + spread.z_axis.length_squared();
        0.5 * (trace * trace - squares) > ROUND
    }

    /// Two of its faces turn by less than a right angle, or one is not flat.
    fn curves(&self) -> bool {
        let turns = |(n, one): (usize, &Group)| {
            self.groups().take(n).any(|other| one.area.dot(other.area) > 0.0)
        };
        self.groups().any(|group| group.area.length() < FLAT * group.size)
            || self.groups().enumerate().any(turns)
    }

    fn groups(&self) -> impl Iterator<Item = &Group> {
        self.groups[..self.n_groups].iter().filter(|group| group.area.length() > AREA_MIN)
    }

    /// A point for each face.
    fn facets(&self, on_edge: bool, points: &mut Vec<FacetPoint>) {
        points.extend(self.groups().map(|group| {
            let weight = group.area.length();
            let inward = -group.area / weight;
            FacetPoint {
                cells: group.moment / group.size,
                inward,
                weight,
                half_axes: group.half_axes(inward),
                on_edge,
            }
        }));
    }

    /// A probe in each corner, or in the middle of the edge where there is none.
    fn probes(&self, points: &mut Vec<FacetPoint>) {
        let middle = (self.edge_length > 0.0).then(|| self.edge_moment / self.edge_length);
        let corners = &self.corners[..self.n_corners];
        let places = if corners.is_empty() { middle.as_slice() } else { corners };
        let outward: DVec3 = self.groups().map(|group| group.area).sum();
        if let Some(inward) = (-outward).try_normalize() {
            points.extend(places.iter().map(|cells| FacetPoint {
                cells: *cells,
                inward,
                weight: 0.0,
                half_axes: [DVec3::ZERO; 2],
                on_edge: true,
            }));
        }
    }
}

/// Area of a polygon, times its centroid, and its second moment about the origin.
#[derive(Clone, Copy)]
struct Moments {
    size: f64,
    first: DVec3,
    second: DMat3,
}

impl Moments {
    const NOTHING: Self = Self { size: 0.0, first: DVec3::ZERO, second: DMat3::ZERO };

    fn add_triangle(&mut self, [a, b, c]: [DVec3; 3], size: f64) {
        let sum = a + b + c;
        self.size += size;
        self.first += sum * (size / 3.0);
        let squares = outer(a) + outer(b) + outer(c) + outer(sum);
        self.second += squares * (size / 12.0);
    }
}

/// v vᵀ.
fn outer(v: DVec3) -> DMat3 {
    DMat3::from_cols(v * v.x, v * v.y, v * v.z)
}

impl Group {
    const NOTHING: Self =
        Self { area: DVec3::ZERO, size: 0.0, moment: DVec3::ZERO, second: DMat3::ZERO };

    /// Half axes of the rectangle with the same second moment of area in the plane across `inward`.
    fn half_axes(&self, inward: DVec3) -> [DVec3; 2] {
        let centroid = self.moment / self.size;
        let second = self.second * (1.0 / self.size) - outer(centroid);
        let [u, v] = <[DVec3; 2]>::from(inward.any_orthonormal_pair());
        let plane = DMat2::from_cols(
            DVec2::new(u.dot(second * u), u.dot(second * v)),
            DVec2::new(u.dot(second * v), v.dot(second * v)),
        );
        let half_sum = 0.5 * (plane.x_axis.x + plane.y_axis.y);
        let half_difference = 0.5 * (plane.x_axis.x - plane.y_axis.y);
        let beside = plane.x_axis.y;
        let spread = (half_difference * half_difference + beside * beside).sqrt();
        // Half the angle of (half_difference, beside), by square roots: they round alike on every
        // machine.
        let larger = (0.5 * (1.0 + half_difference.abs() / spread)).sqrt();
        let smaller = 0.5 * beside / (spread * larger);
        let (cos, sin) = if spread <= 0.0 {
            (1.0, 0.0)
        } else if half_difference >= 0.0 {
            (larger, smaller)
        } else {
            (smaller.abs(), larger.copysign(beside))
        };
        let length = |moment: f64| (3.0 * moment.max(0.0)).sqrt();
        [
            (u * cos + v * sin) * length(half_sum + spread),
            (v * cos - u * sin) * length(half_sum - spread),
        ]
    }
}

/// A block of 8³ cells, voxels or parts of one, and which of them are looked at.
struct Block {
    /// Cell coordinates.
    origin: DVec3,
    /// Edge of its cells, s.
    edge: f64,
    mask: Mask,
    /// Cosine of what two directions turn by at most that are one face.
    alike: f64,
}

impl Block {
    /// The lowest corner of a cell.
    fn corner(&self, [x, y, z]: [usize; 3]) -> DVec3 {
        self.origin + DVec3::new(x as f64, y as f64, z as f64) * self.edge
    }

    /// The parts of a cell.
    fn parts(&self, cell: [usize; 3], alike: f64) -> Self {
        let row = (1_u64 << PARTS) - 1;
        let plane = (0..PARTS).fold(0, |plane, y| plane | row << (8 * y));
        Self {
            origin: self.corner(cell),
            edge: self.edge / PARTS as f64,
            mask: core::array::from_fn(|x| if x < PARTS { plane } else { 0 }),
            alike,
        }
    }

    /// Cells whose closed extent meets that of these corners.
    fn cells(&self, axis: usize, corners: &[DVec3; 3]) -> Range<usize> {
        let local = corners.map(|corner| (corner - self.origin) / self.edge);
        let (low, high) = cell_range(&local, axis);
        low.max(0) as usize..(high.min(BRICK_EDGE as i32 - 1) + 1).max(0) as usize
    }

    /// Number of the surface cell that a place lies in.
    fn inside(&self, place: DVec3) -> Option<usize> {
        let [x, y, z] = [0, 1, 2]
            .map(|axis| ((place[axis] - self.origin[axis]) / self.edge).floor() as i32 as usize);
        let is_own = x < BRICK_EDGE && y < BRICK_EDGE && z < BRICK_EDGE;
        (is_own && self.mask[x] >> (y << 3 | z) & 1 == 1).then_some(x << 6 | y << 3 | z)
    }

    fn bound(&self, axis: usize, cell: usize) -> f64 {
        self.origin[axis] + cell as f64 * self.edge
    }
}

/// A convex polygon: a triangle cut by six planes at most.
#[derive(Clone, Copy)]
struct Polygon {
    corners: [DVec3; 9],
    n: usize,
}

impl Polygon {
    fn corners(&self) -> &[DVec3] {
        &self.corners[..self.n]
    }

    /// The parts below and above a plane across an axis; a polygon in the plane is part of both.
    fn cut(&self, axis: usize, at: f64) -> [Self; 2] {
        let mut parts = [Self { corners: [DVec3::ZERO; 9], n: 0 }; 2];
        let mut put = |part: usize, corner: DVec3| {
            // Rounding may make one corner more of a thin polygon: it is none.
            if let Some(place) = parts[part].corners.get_mut(parts[part].n) {
                *place = corner;
                parts[part].n += 1;
            }
        };
        let Some(mut from) = self.corners().last().copied() else { return parts };
        for to in self.corners() {
            let before = from[axis] - at;
            let after = to[axis] - at;
            if before * after < 0.0 {
                let mut crossing = from + (*to - from) * (before / (before - after));
                crossing[axis] = at;
                put(0, crossing);
                put(1, crossing);
            }
            if after <= 0.0 {
                put(0, *to);
            }
            if after >= 0.0 {
                put(1, *to);
            }
            from = *to;
        }
        parts
    }

    /// The parts in each cell of a range along an axis.
    fn sliced(
        mut self,
        axis: usize,
        cells: Range<usize>,
        block: &Block,
        mut each: impl FnMut(usize, Self),
    ) {
        if self.corners().iter().any(|corner| corner[axis] < block.bound(axis, cells.start)) {
            self = self.cut(axis, block.bound(axis, cells.start))[1];
        }
        for cell in cells {
            if self.n < 3 {
                return;
            }
            let [below, above] = self.cut(axis, block.bound(axis, cell + 1));
            if below.n >= 3 {
                each(cell, below);
            }
            self = above;
        }
    }

    /// True when all of it lies in a plane between two cells: each has half.
    fn is_between(&self, axis: usize, block: &Block) -> bool {
        let first = self.corners[0][axis];
        let cells = (first - block.origin[axis]) / block.edge;
        cells == cells.floor() && self.corners().iter().all(|corner| corner[axis] == first)
    }
}

fn add_face(cells: &mut [Cell], face: &Face, block: &Block) {
    let [x, y, z] = [0, 1, 2].map(|axis| block.cells(axis, &face.corners));
    if face.outward == DVec3::ZERO || x.is_empty() || y.is_empty() || z.is_empty() {
        return;
    }
    let [a, b, c] = face.corners;
    let triangle = Polygon { corners: [a, b, c, c, c, c, c, c, c], n: 3 };
    triangle.sliced(0, x, block, |x, slab| {
        slab.sliced(1, y.clone(), block, |y, column| {
            if block.mask[x] >> (8 * y) & 0xff == 0 {
                return;
            }
            column.sliced(2, z.clone(), block, |z, polygon| {
                if block.mask[x] >> (y << 3 | z) & 1 == 1 {
                    add_polygon(&mut cells[x << 6 | y << 3 | z], &polygon, face.outward, block);
                }
            });
        });
    });
}

fn add_polygon(cell: &mut Cell, polygon: &Polygon, outward: DVec3, block: &Block) {
    let share = [0, 1, 2]
        .map(|axis| if polygon.is_between(axis, block) { 0.5 } else { 1.0 })
        .iter()
        .product::<f64>();
    let first = polygon.corners[0];
    let mut moments = Moments::NOTHING;
    for pair in polygon.corners()[1..].windows(2) {
        let twice = (pair[0] - first).cross(pair[1] - first).dot(outward).abs();
        moments.add_triangle([first, pair[0], pair[1]], 0.5 * share * twice);
    }
    if moments.size > AREA_MIN {
        cell.add(outward, block.alike, moments);
    }
}

fn add_edge(cells: &mut [Cell], from: DVec3, to: DVec3, block: &Block) {
    // An edge is a polygon of two corners, whose parts are cut the same way.
    let ends = [from, to, to];
    let [x, y, z] = [0, 1, 2].map(|axis| block.cells(axis, &ends));
    for x in x {
        for y in y.clone() {
            for z in z.clone() {
                if block.mask[x] >> (y << 3 | z) & 1 == 0 {
                    continue;
                }
                // The interval of the edge in the closed cell.
                let mut first = 0.0_f64;
                let mut last = 1.0_f64;
                for (axis, cell) in [x, y, z].into_iter().enumerate() {
                    let low = block.bound(axis, cell) - from[axis];
                    let way = to[axis] - from[axis];
                    if way == 0.0 {
                        continue;
                    }
                    let enter = low / way;
                    let leave = (low + block.edge) / way;
                    first = first.max(enter.min(leave));
                    last = last.min(enter.max(leave));
                }
                if last > first {
                    let cell = &mut cells[x << 6 | y << 3 | z];
                    let length = (to - from).length() * (last - first);
                    cell.edge_length += length;
                    cell.edge_moment += from.lerp(to, 0.5 * (first + last)) * length;
                }
            }
        }
    }
}
