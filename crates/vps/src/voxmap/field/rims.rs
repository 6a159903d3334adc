//! Edges where at least one side curves: the rim of a hole, the crest of a thread.
//!
//! Data in: triangles and exact distances at the centres of cells. Data out: for the cells about
//! such an edge that have no planes, the depths below each patch at the eight samples about them.
//!
//! A patch is the triangles that are joined by turns of less than 20°. How deep a place is below it
//! is said by the plane of its triangle that is nearest: beyond its end a patch goes on as it was
//! there. Below two patches the lesser depth counts, each interpolated by itself, so that the edge
//! between them stays sharp. As in [`moved`](super::moved), depths are moved by what interpolation
//! errs.
//!
//! At an inner edge, between faces that meet in a groove, the greatest depth counts; beside the
//! edge itself, which is nearer than both, that of planes through it between the two.
//!
//! Cost: 32 bytes for a cell and a patch. Bakes: see [`creases`](super::creases).
//!
//! # Source
//! Ours.

#![expect(clippy::indexing_slicing, reason = "start-up: numbers of one array's items index others")]

use core::ops::Range;
use std::collections::HashMap;

use glam::{DVec3, Vec3};

use super::creases::{
    AGREEING_CELLS, AROUND_BRICK, AROUND_CELL, AroundBrick, Edge, Groups, LISTED_CELLS, NEAR_CELLS,
    OfBrick, PLANES, PlaneSet, SMOOTH_COSINE, around,
};
use super::moved::{MOST_MOVED_CELLS, ONE_PATCH};
use super::{BRICK_EDGE, Field, to_vec3, whole};
use crate::mesh::TriangleMesh;
use crate::mesh::closest_point::TriangleProjector;
use crate::mesh::edges::EdgePair;

/// Patches that meet in a cell, at most.
pub(crate) const PATCHES: usize = 4;
/// Samples agree with patches up to this, cells: about a facet that turns by 10° distances are
/// round.
const AGREEING_PATCH_CELLS: f64 = 3.0 * AGREEING_CELLS;
/// How much more patches may say than interpolation, besides what planes do: what they agree up to,
/// and what they are moved by, cells.
pub(super) const OVERSTATED_CELLS: f32 = 0.03 + MOST_MOVED_CELLS;
/// A patch that is nowhere about a cell within this of the one that counts is left out there,
/// cells.
const HIDDEN_CELLS: f64 = 0.5;
/// Smaller patches are passed over: a rough scan has one for each triangle, cells².
const LEAST_PATCH: f64 = 4.0;
/// Longer triangles are looked for in pieces, cells.
const MOST_PIECE: f64 = 2.0 * BRICK_EDGE as f64;
/// Deeper cells are interpolated, cells.
const MOST_DEPTH_CELLS: f32 = 64.0;
/// The triangles of a patch are looked for by cubes of this edge, cells.
const CUBE_CELLS: f64 = 3.0;
/// Smaller triangles have no normal, cells².
const LEAST_AREA: f64 = 1e-6;

/// Depths below a patch at the samples about a cell, x slowest, cells.
pub(crate) type PatchDepths = [f32; 8];

/// Depth below a patch, cells, and its gradient, at a place between the samples, from 0 to 1. RT:
/// safe.
#[inline(always)]
pub(super) fn side([a, b, c, d, e, f, g, h]: &PatchDepths, at: Vec3) -> (f32, Vec3) {
    let mix = |from: f32, to: f32, share: f32| from + share * (to - from);
    // Along z, then y.
    let [a, b, c, d] =
        [(a, b), (c, d), (e, f), (g, h)].map(|(from, to)| (mix(*from, *to, at.z), to - from));
    let low = mix(a.0, b.0, at.y);
    let high = mix(c.0, d.0, at.y);
    let gradient = Vec3::new(
        high - low,
        mix(b.0 - a.0, d.0 - c.0, at.x),
        mix(mix(a.1, b.1, at.y), mix(c.1, d.1, at.y), at.x),
    );
    (mix(low, high, at.x), gradient)
}

/// True of what a bake leaves.
pub(super) fn is_sound(depths: &PatchDepths) -> bool {
    depths.iter().all(|depth| depth.abs() <= MOST_DEPTH_CELLS)
}

/// What a cell has: depths below its patches.
pub(super) struct PatchesOfCell {
    pub(super) patches: Vec<PatchDepths>,
    pub(super) is_inner: bool,
}

/// Middle and radius, cells.
type Ball = (DVec3, f64);

/// A triangle of a patch, cells.
struct Near {
    projector: TriangleProjector,
    /// Out of the object, and offset.
    plane: (DVec3, f64),
}

/// The edge of two triangles of different patches.
pub(super) struct Rim {
    pub(super) edge: Edge,
    patches: [u32; 2],
    is_inner: bool,
}

/// The sharp edges of a mesh, and the patches that they bound.
pub(super) struct Rims {
    pub(super) edges: Vec<Rim>,
    /// Of each brick, the patches and triangles in it.
    triangles: HashMap<[i32; 3], Vec<(u32, u32)>>,
}

impl Rims {
    pub(super) fn new(mesh: &TriangleMesh, field: &Field, pairs: &[EdgePair]) -> Self {
        let of_cells = OfCells::new(mesh, field);
        let planes: Vec<(DVec3, f64)> =
            (0..mesh.triangles.len()).map(|triangle| of_cells.plane(triangle)).collect();
        let normal = |triangle: u32| planes.get(triangle as usize).map_or(DVec3::ZERO, |it| it.0);
        let mut groups = Groups::new(planes.len());
        for EdgePair { triangles: [one, other], same_direction, .. } in pairs {
            if !same_direction && normal(*one).dot(normal(*other)) > SMOOTH_COSINE {
                groups.join(*one, *other);
            }
        }
        let mut areas = vec![0.0; planes.len()];
        for triangle in 0..planes.len() {
            let [a, b, c] = of_cells.corners(triangle);
            areas[groups.first(triangle as u32) as usize] += 0.5 * (b - a).cross(c - a).length();
        }
        let mut edges = Vec::new();
        let mut is_bounded = vec![false; planes.len()];
        for EdgePair { edge, triangles, same_direction } in pairs {
            let patches = triangles.map(|triangle| groups.first(triangle));
            let [one, other] = triangles.map(|triangle| planes[triangle as usize]);
            let turn = one.0.dot(other.0);
            let has_normals = one.0 != DVec3::ZERO && other.0 != DVec3::ZERO;
            let are_large = patches.iter().all(|patch| areas[*patch as usize] >= LEAST_PATCH);
            let is_rim = patches[0] != patches[1] && turn <= SMOOTH_COSINE;
            if *same_direction || !has_normals || !are_large || !is_rim {
                continue;
            }
            let [start, end] = edge.map(|vertex| of_cells.at(mesh.vertices[vertex as usize]));
            let beyond = of_cells.corners(triangles[1] as usize).map(|at| one.0.dot(at) - one.1);
            let is_inner = beyond.iter().sum::<f64>() >= 0.0;
            let along = one.0.cross(other.0).normalize_or_zero();
            let ends = [start.dot(along), end.dot(along)];
            let ends = [ends[0].min(ends[1]), ends[0].max(ends[1])];
            if let Some(edge) = Edge::between([one, other], ends, of_cells.band) {
                let edge = if is_inner { edge.only() } else { edge };
                edges.push(Rim { edge, patches, is_inner });
                patches.iter().for_each(|patch| is_bounded[*patch as usize] = true);
            }
        }
        let mut triangles: HashMap<[i32; 3], Vec<(u32, u32)>> = HashMap::new();
        for (triangle, plane) in (0..).zip(&planes) {
            let patch = groups.first(triangle);
            if !is_bounded[patch as usize] || plane.0 == DVec3::ZERO {
                continue;
            }
            let corners = of_cells.corners(triangle as usize);
            // Large ones in pieces: what encloses them obliquely holds much else.
            let mut pieces = vec![corners];
            while let Some([a, b, c]) = pieces.pop() {
                let sides = [[a, b, c], [b, c, a], [c, a, b]];
                let length = |side: &[DVec3; 3]| side[0].distance_squared(side[1]);
                let longest =
                    sides.iter().max_by(|one, other| length(one).total_cmp(&length(other)));
                let Some(&[a, b, c]) = longest.filter(|side| length(side) > MOST_PIECE.powi(2))
                else {
                    bricks_of([a, b, c], |brick| {
                        let of_brick = triangles.entry(brick).or_default();
                        if of_brick.last() != Some(&(patch, triangle)) {
                            of_brick.push((patch, triangle));
                        }
                    });
                    continue;
                };
                let middle = 0.5 * (a + b);
                pieces.extend([[a, middle, c], [middle, b, c]]);
            }
        }
        Self { edges, triangles }
    }

    /// Adds what the cells of one brick have that have no planes.
    pub(super) fn add<'a>(
        &self,
        (mesh, field): (&TriangleMesh, &Field),
        (first, samples): ([i32; 3], &AroundBrick),
        edges: impl Iterator<Item = &'a Rim> + Clone,
        found: &mut OfBrick,
    ) {
        let mut brick: Option<AboutBrick> = None;
        let edges: Vec<&Rim> = edges.collect();
        for block in 0..64 {
            let corner = [block >> 4, block >> 2 & 3, block & 3].map(|k| 2 * k);
            let middle_of = |at: [usize; 3]| {
                to_vec3(core::array::from_fn(|k| first[k] + at[k] as i32)).as_dvec3()
            };
            // Of its eight cells the middles are at most so far from its own.
            let about = middle_of(corner) + 1.5;
            let is_listed = |rim: &&&Rim| rim.edge.is_near(about, LISTED_CELLS + 0.5);
            let edges: Vec<&Rim> = edges.iter().filter(is_listed).copied().collect();
            if edges.is_empty() {
                continue;
            }
            for beside in 0..8 {
                let at = [0, 1, 2].map(|k| corner[k] + (beside >> (2 - k) & 1));
                let cell = at[0] << 6 | at[1] << 3 | at[2];
                let middle = middle_of(at) + 1.0;
                if found.cells[cell] != 0 {
                    continue;
                }
                for is_inner in [true, false] {
                    let own = || edges.iter().filter(|rim| rim.is_inner == is_inner);
                    if !own().any(|rim| rim.edge.is_near(middle, NEAR_CELLS)) {
                        continue;
                    }
                    let listed = own().filter(|rim| rim.edge.is_near(middle, LISTED_CELLS));
                    let mut patches: Vec<u32> = Vec::new();
                    for patch in listed.flat_map(|rim| rim.patches) {
                        if !patches.contains(&patch) {
                            patches.push(patch);
                        }
                        if patches.len() > PLANES {
                            break;
                        }
                    }
                    patches.sort_unstable();
                    let brick = brick.get_or_insert_with(|| AboutBrick {
                        rims: self,
                        of_cells: OfCells::new(mesh, field),
                        first,
                        samples,
                        patches: Vec::new(),
                        known: HashMap::new(),
                    });
                    if let Some(depths) = brick.depths(is_inner, patches, at) {
                        found.set_patches(cell, depths);
                        break;
                    }
                }
            }
        }
    }

    fn patch(&self, number: u32, first: [i32; 3], of_cells: &OfCells) -> Patch {
        let brick = first.map(|k| k.div_euclid(BRICK_EDGE as i32));
        let mut triangles: Vec<u32> = (0..27)
            .filter_map(|beside| {
                let beside = [beside / 9 - 1, beside / 3 % 3 - 1, beside % 3 - 1];
                self.triangles.get(&core::array::from_fn(|k| brick[k] + beside[k]))
            })
            .flatten()
            .filter(|(patch, _)| *patch == number)
            .map(|(_, triangle)| *triangle)
            .collect();
        triangles.sort_unstable();
        triangles.dedup();
        let cube = |ball: &Ball| whole((ball.0 / CUBE_CELLS).as_vec3());
        let mut own: Vec<(Ball, u32)> =
            triangles.into_iter().map(|triangle| (of_cells.ball(triangle), triangle)).collect();
        own.sort_by_key(|(ball, triangle)| (cube(ball), *triangle));
        let mut cubes = Vec::new();
        let mut from = 0;
        for cube in own.chunk_by(|(one, _), (other, _)| cube(one) == cube(other)) {
            let middle = cube.iter().map(|(ball, _)| ball.0).sum::<DVec3>() / cube.len() as f64;
            let reach = |(ball, _): &(Ball, u32)| ball.0.distance(middle) + ball.1;
            let radius = cube.iter().map(reach).fold(0.0, f64::max);
            cubes.push(((middle, radius), from..from + cube.len()));
            from += cube.len();
        }
        let triangles = own.iter().map(|(_, triangle)| of_cells.near(*triangle)).collect();
        let balls = own.into_iter().map(|(ball, _)| ball).collect();
        Patch { number, triangles, balls, cubes, planes: vec![None; AROUND_BRICK], last: 0 }
    }
}

/// What is known of a brick so far.
struct AboutBrick<'a> {
    rims: &'a Rims,
    of_cells: OfCells<'a>,
    first: [i32; 3],
    samples: &'a AroundBrick,
    patches: Vec<Patch>,
    /// Which samples agree with which patches, as those of an inner edge or of an outer one.
    known: HashMap<(bool, Vec<u32>), Vec<Option<bool>>>,
}

/// Of one patch, what says how deep the samples about a cell are, and how deep they are.
type Planes = [(DVec3, f64); AROUND_CELL];
type Depths = [f64; AROUND_CELL];

/// Of planes that turn from one face of an inner edge to the other, the shares of both faces'
/// depths, by the cosine between their normals.
fn shares(cosine: f64) -> [[f64; 2]; PATCHES] {
    let turn = cosine.clamp(-1.0, 1.0).acos();
    core::array::from_fn(|k| {
        let share = k as f64 / (PATCHES - 1) as f64;
        [1.0 - share, share].map(|share| (share * turn).sin() / turn.sin())
    })
}

impl AboutBrick<'_> {
    /// The depths below these patches in a cell, if the samples around it agree with them.
    fn depths(
        &mut self,
        is_inner: bool,
        numbers: Vec<u32>,
        cell: [usize; 3],
    ) -> Option<PatchesOfCell> {
        if numbers.len() > PLANES {
            return None;
        }
        let own: Vec<usize> = numbers.iter().map(|number| self.patch(*number)).collect();
        let Self { samples, patches, known, .. } = self;
        let known = known.entry((is_inner, numbers)).or_insert_with(|| vec![None; AROUND_BRICK]);
        let agree = around(cell).all(|place| {
            *known[place].get_or_insert_with(|| {
                if !samples.is_in_band(place) {
                    return false;
                }
                let at = samples.at(place);
                let planes = own.iter().map(|patch| patches[*patch].plane(place, at));
                PlaneSet::of_planes(planes).is_some_and(|set| match is_inner {
                    true => samples.agrees_inside(&set, place, AGREEING_PATCH_CELLS),
                    false => samples.agrees(&set, place, AGREEING_PATCH_CELLS),
                })
            })
        });
        if !agree {
            return None;
        }
        let mut places = around(cell);
        let places: [usize; AROUND_CELL] =
            core::array::from_fn(|_| places.next().unwrap_or_default());
        let mut planes = |patch: &usize| -> Planes {
            places.map(|place| patches[*patch].plane(place, samples.at(place)))
        };
        let planes: Vec<Planes> = own.iter().map(&mut planes).collect();
        let at = places.map(|place| samples.at(place));
        let below =
            |own: &Planes| -> Depths { core::array::from_fn(|n| own[n].1 - own[n].0.dot(at[n])) };
        let depths: Vec<Depths> = planes.iter().map(below).collect();
        let counts = |own: &Depths| {
            (0..AROUND_CELL).any(|n| {
                depths.iter().all(|other| {
                    let spare = other[n] - own[n];
                    if is_inner { -spare > -HIDDEN_CELLS } else { spare > -HIDDEN_CELLS }
                })
            })
        };
        let counting: Vec<usize> = (0..depths.len()).filter(|own| counts(&depths[*own])).collect();
        let patches: Vec<PatchDepths> = match (is_inner, counting.as_slice()) {
            (false, [_, _, ..]) if counting.len() <= PATCHES => {
                counting.iter().map(|own| moved(&depths[*own])).collect()
            }
            // Beside the two faces planes through the edge, of what is nearest to the edge itself.
            // They say less than it is deep by a share of up to 1 - cos(turn / 6): 3 % at a right
            // angle.
            (true, [one, other]) => {
                let mut fan = [[0.0; AROUND_CELL]; PATCHES];
                let mut last = (f64::NAN, [[0.0; 2]; PATCHES]);
                for n in 0..AROUND_CELL {
                    let turn = planes[*one][n].0.dot(planes[*other][n].0);
                    if turn != last.0 {
                        last = (turn, shares(turn));
                    }
                    for (to, [of_one, of_other]) in fan.iter_mut().zip(last.1) {
                        to[n] = of_one * depths[*one][n] + of_other * depths[*other][n];
                    }
                }
                fan.iter().map(moved).collect()
            }
            _ => return None,
        };
        // Faces that meet in a slit without width have no such planes.
        patches.iter().all(is_sound).then_some(PatchesOfCell { patches, is_inner })
    }

    fn patch(&mut self, number: u32) -> usize {
        self.patches.iter().position(|known| known.number == number).unwrap_or_else(|| {
            self.patches.push(self.rims.patch(number, self.first, &self.of_cells));
            self.patches.len() - 1
        })
    }
}

/// Visits the bricks that the box around a triangle lies in.
fn bricks_of(corners: [DVec3; 3], mut visit: impl FnMut([i32; 3])) {
    let low = corners.into_iter().reduce(DVec3::min).unwrap_or_default();
    let high = corners.into_iter().reduce(DVec3::max).unwrap_or_default();
    let [low, high] = [low, high].map(|at| whole((at / BRICK_EDGE as f64).as_vec3()));
    for x in low[0]..=high[0] {
        for y in low[1]..=high[1] {
            (low[2]..=high[2]).for_each(|z| visit([x, y, z]));
        }
    }
}

/// Depths at the eight samples of a cell, moved by what interpolation errs there.
fn moved(around: &[f64; AROUND_CELL]) -> [f32; 8] {
    core::array::from_fn(|corner| {
        let place = 16 * (1 + (corner >> 2)) + 4 * (1 + (corner >> 1 & 1)) + 1 + (corner & 1);
        let own = around[place];
        let bends = [16, 4, 1].map(|step| around[place - step] - 2.0 * own + around[place + step]);
        let is_smooth = bends.iter().all(|bend| bend.abs() < f64::from(ONE_PATCH));
        let most = f64::from(MOST_MOVED_CELLS);
        let by =
            if is_smooth { (bends.iter().sum::<f64>() / 12.0).clamp(-most, most) } else { 0.0 };
        (own - by) as f32
    })
}

/// A patch about a brick.
struct Patch {
    number: u32,
    triangles: Vec<Near>,
    /// Of each, a ball around it. Most are passed over by these alone.
    balls: Vec<Ball>,
    /// Balls around those in one cube, and which these are.
    cubes: Vec<(Ball, Range<usize>)>,
    /// Of the triangle that is nearest to each sample, once it is known.
    planes: Vec<Option<(DVec3, f64)>>,
    /// The triangle that was nearest last: the next sample is mostly beside it.
    last: usize,
}

impl Patch {
    fn plane(&mut self, place: usize, at: DVec3) -> (DVec3, f64) {
        if let Some(known) = self.planes[place] {
            return known;
        }
        let mut best = (f64::INFINITY, 0.0_f64, self.last);
        let mut offer = |number: usize, triangle: &Near| {
            let away = triangle.projector.project(at).point.distance(at);
            let height = (triangle.plane.1 - triangle.plane.0.dot(at)).abs();
            // Of two that share what is nearest the one that faces the place.
            if away < best.0 - 1e-9 || away < best.0 + 1e-9 && height > best.1 {
                best = (away, height, number);
            }
            best.0
        };
        let mut nearest =
            self.triangles.get(self.last).map_or(f64::INFINITY, |it| offer(self.last, it));
        let is_beyond = |(middle, radius): &Ball, nearest: f64| {
            let reach = nearest + radius;
            at.distance_squared(*middle) > reach * reach
        };
        for (ball, numbers) in &self.cubes {
            if is_beyond(ball, nearest) {
                continue;
            }
            for number in numbers.clone() {
                if !is_beyond(&self.balls[number], nearest) {
                    nearest = offer(number, &self.triangles[number]);
                }
            }
        }
        self.last = best.2;
        let plane = self.triangles.get(best.2).map_or((DVec3::ZERO, f64::NAN), |it| it.plane);
        self.planes[place] = Some(plane);
        plane
    }
}

/// A mesh, cells.
struct OfCells<'a> {
    mesh: &'a TriangleMesh,
    origin: DVec3,
    per_metre: f64,
    band: f64,
}

impl<'a> OfCells<'a> {
    fn new(mesh: &'a TriangleMesh, field: &Field) -> Self {
        let per_metre = 1.0 / f64::from(field.voxel_size_m);
        let band = f64::from(field.band_m) * per_metre;
        Self { mesh, origin: field.origin.as_dvec3(), per_metre, band }
    }

    fn at(&self, place: DVec3) -> DVec3 {
        (place - self.origin) * self.per_metre
    }

    fn corners(&self, triangle: usize) -> [DVec3; 3] {
        self.mesh.corners(triangle).map(|corner| self.at(corner))
    }

    /// Normal out of the object and offset; none of a triangle without area.
    fn plane(&self, triangle: usize) -> (DVec3, f64) {
        let [a, b, c] = self.corners(triangle);
        let doubled = (b - a).cross(c - a);
        if doubled.length() < 2.0 * LEAST_AREA {
            return (DVec3::ZERO, 0.0);
        }
        let normal = doubled.normalize();
        (normal, normal.dot(a))
    }

    fn ball(&self, triangle: u32) -> Ball {
        let corners = self.corners(triangle as usize);
        let middle = corners.iter().sum::<DVec3>() / 3.0;
        (middle, corners.iter().map(|at| at.distance(middle)).fold(0.0, f64::max))
    }

    fn near(&self, triangle: u32) -> Near {
        let projector = TriangleProjector::new(&self.corners(triangle as usize));
        Near { projector, plane: self.plane(triangle as usize) }
    }
}
