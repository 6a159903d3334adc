//! Cuts triangles where they meet others.
//!
//! Data in: faces and the lines of their edges. Data out: fragments over points that all of them
//! share; a face that meets nothing is one fragment.
//!
//! First every pair of faces says what it has in common (`contacts`): points on edges, lines across
//! faces. Points closer than the tolerance become one. Then, face by face, lines are split where
//! they cross or where a point lies on them, and every face with the same line learns of it, until
//! nothing changes. At last each face is triangulated with its lines as edges.
//!
//! Everything is done within a tolerance, as files are written with few digits: faces that were
//! meant to lie on each other do so only nearly.

use core::sync::atomic::{AtomicUsize, Ordering};

use glam::{DVec2, DVec3};
use robust::{Coord, orient2d};

use super::contacts::{Contacts, Key, Pair, position};
use super::faces::{Face, Faces, PieceFaces};
use super::lines::Lines;
use super::triangulate::{Scratch, triangulate};
use crate::mesh::weld::weld_within;
use crate::parallel;

/// How much is cut at most: more would take minutes, and no part has it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Limits {
    /// Pairs of faces whose boxes meet.
    pub(super) pairs: usize,
    /// Lines across faces.
    pub(super) lines: usize,
    /// Crossings of lines, in all faces.
    pub(super) crossings: usize,
}

impl Default for Limits {
    fn default() -> Self {
        Self { pairs: 1_000_000_000, lines: 30_000_000, crossings: 10_000_000 }
    }
}

/// Splitting moves points by up to the tolerance, which can bring new ones near; that ends soon.
const ROUNDS: usize = 4;

/// A part of a face.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Fragment {
    /// Points, in the sense of the face.
    pub(super) points: [u32; 3],
    pub(super) face: u32,
    /// Bit `k` is set when another face meets this one along edge `k`.
    pub(super) meets: u8,
}

/// Faces in fragments.
#[derive(Debug)]
pub(super) struct Cut {
    /// Vertices of the mesh, then new points.
    pub(super) positions: Vec<DVec3>,
    /// In the order of the faces.
    pub(super) fragments: Vec<Fragment>,
}

/// Cuts faces where they meet; `None` when they meet too often.
///
/// Faces of closed pieces are cut by those of other closed pieces, and of their own where a piece
/// meets itself; faces of open pieces by those of closed ones.
pub(super) fn cut(
    faces: &Faces,
    mut lines: Lines,
    vertices: &[DVec3],
    tolerance_m: f64,
    limits: Limits,
) -> Option<Cut> {
    let Contacts { on_edges, across } = contacts(faces, &lines, vertices, tolerance_m, limits)?;

    let keys = Keys::of(
        on_edges.iter().map(|(_, key)| *key).chain(across.iter().flat_map(|(_, ends)| *ends)),
        lines.len(),
    );
    let made = parallel::map(keys.sorted.len(), 64, |k| {
        position(keys.sorted[k], &faces.faces, &lines, vertices)
    });
    let mut points = Points::new(faces, vertices, tolerance_m);
    points.add(made);
    let n_vertices = vertices.len() as u32;
    let number_of = |key: Key| match key {
        [0, vertex, _] => vertex,
        _ => n_vertices + keys.place_of(key),
    };

    // From now on by number.
    let mut across: Vec<(u32, [u32; 2])> = parallel::map(across.len(), 256, |k| {
        let (face, ends) = across[k];
        let [one, other] = ends.map(|key| points.stands_for(number_of(key)));
        (face, [one.min(other), one.max(other)])
    });
    across.retain(|(_, [one, other])| one != other);
    rayon::slice::ParallelSliceMut::par_sort_unstable(&mut across[..]);
    across.dedup();
    lines.add(across.iter().map(|(_, ends)| *ends).collect());
    for (edge, key) in on_edges {
        lines.put_on(edge, number_of(key));
    }
    lines.sort_points(&points.positions, |point| points.stands_for(point));
    let across = Across::new(faces.faces.len(), &across, &lines);

    split_lines(faces, &mut lines, &across, &mut points, limits)?;

    let fragments = parallel::map_with(faces.faces.len(), 16, Scratch::default, |scratch, idx| {
        let face = &faces.faces[idx];
        let across = across.of(idx);
        if across.is_empty() && !face.edges.iter().any(|edge| lines.is_split(*edge)) {
            return Parts::One(Fragment { points: face.vertices, face: idx as u32, meets: 0 });
        }
        Parts::Many(triangulate(scratch, face, idx as u32, &lines, across, &points.positions))
    });
    let mut all = Vec::with_capacity(fragments.len());
    for parts in fragments {
        match parts {
            Parts::One(fragment) => all.push(fragment),
            Parts::Many(mut fragments) => all.append(&mut fragments),
        }
    }
    Some(Cut { positions: points.positions, fragments: all })
}

enum Parts {
    One(Fragment),
    Many(Vec<Fragment>),
}

/// Faces of one piece that are looked at by one task.
const TASK_FACES: usize = 256;

/// Some faces of one piece.
struct Task<'a> {
    place: u32,
    one: &'a PieceFaces,
    faces: &'a [u32],
}

impl<'a> Task<'a> {
    fn all(faces: &'a Faces) -> Vec<Self> {
        let pieces = (0..).zip(&faces.by_piece);
        pieces
            .flat_map(|(place, one)| {
                one.faces.chunks(TASK_FACES).map(move |faces| Self { place, one, faces })
            })
            .collect()
    }

    /// The task compares its faces with those of this piece: of two pieces, the one with fewer
    /// faces is compared with the other.
    fn is_compared(&self, place: u32, other: &PieceFaces, all: &Faces) -> bool {
        if place == self.place {
            return other.closed && all.faces[self.faces[0] as usize].meets_itself;
        }
        let rank = |place: u32, of: &PieceFaces| (of.faces.len(), place);
        (self.one.closed || other.closed) && rank(self.place, self.one) < rank(place, other)
    }
}

/// What all pairs of faces have in common.
fn contacts(
    faces: &Faces,
    lines: &Lines,
    vertices: &[DVec3],
    tolerance_m: f64,
    limits: Limits,
) -> Option<Contacts> {
    let n_pairs = AtomicUsize::new(0);
    let n_across = AtomicUsize::new(0);
    // Both only rise: whether they end beyond the limits does not depend on the threads.
    let is_tangled = || {
        n_pairs.load(Ordering::Relaxed) > limits.pairs
            || n_across.load(Ordering::Relaxed) > limits.lines
    };
    let tasks = Task::all(faces);
    let scratch = || (Vec::new(), Vec::new());
    let found = parallel::map_with(tasks.len(), 4, scratch, |(others, common), number| {
        let others: &mut Vec<u32> = others;
        let mut found = Contacts::default();
        let task = &tasks[number];
        let low_of = |face: u32| faces.faces[face as usize].low() - tolerance_m;
        let high_of = |face: u32| faces.faces[face as usize].high() + tolerance_m;
        let low = task.faces.iter().map(|face| low_of(*face)).fold(DVec3::INFINITY, DVec3::min);
        let high =
            task.faces.iter().map(|face| high_of(*face)).fold(DVec3::NEG_INFINITY, DVec3::max);
        faces.piece_boxes.meeting(low, high, |place| {
            let other = &faces.by_piece[place as usize];
            if is_tangled() || !task.is_compared(place, other, faces) {
                return;
            }
            let mut n_lines = found.across.len();
            n_pairs.fetch_add(1, Ordering::Relaxed);
            for number in task.faces {
                let [low, high] = [low_of(*number), high_of(*number)];
                if !(low.cmple(other.high).all() && other.low.cmple(high).all()) {
                    continue;
                }
                others.clear();
                faces.meeting_in(other, low, high, |with| {
                    // Pairs of one piece are met twice.
                    if place != task.place || with > *number {
                        others.push(with);
                    }
                });
                n_pairs.fetch_add(others.len(), Ordering::Relaxed);
                for with in others.iter() {
                    // What is found does not depend on which piece has fewer faces.
                    let numbers = [*number.min(with), *number.max(with)];
                    let pair = numbers.map(|number| &faces.faces[number as usize]);
                    let pair = Pair {
                        faces: pair,
                        numbers,
                        lines,
                        positions: vertices,
                        tolerance_m,
                        is_cut: [pair[1].closed, pair[0].closed],
                    };
                    pair.find(common, &mut found);
                }
                n_across.fetch_add(found.across.len() - n_lines, Ordering::Relaxed);
                n_lines = found.across.len();
                if is_tangled() {
                    return;
                }
            }
        });
        found
    });
    if is_tangled() {
        return None;
    }
    let mut all = Contacts::default();
    for mut found in found {
        all.on_edges.append(&mut found.on_edges);
        all.across.append(&mut found.across);
    }
    Some(all)
}

/// Points by what makes them, in rising order, without vertices.
struct Keys {
    sorted: Vec<Key>,
    /// `[2 n_lines + 1]`: where those begin that an edge makes with faces, and with edges: few each.
    starts: Vec<u32>,
    n_lines: usize,
}

impl Keys {
    fn of(keys: impl Iterator<Item = Key>, n_lines: usize) -> Self {
        let mut sorted: Vec<Key> = keys.filter(|key| key[0] != 0).collect();
        rayon::slice::ParallelSliceMut::par_sort_unstable(&mut sorted[..]);
        sorted.dedup();
        let mut keys = Self { sorted, starts: vec![0; 2 * n_lines + 1], n_lines };
        for place in 0..keys.sorted.len() {
            let slot = keys.slot(keys.sorted[place]);
            keys.starts[slot + 1] += 1;
        }
        for slot in 0..2 * n_lines {
            keys.starts[slot + 1] += keys.starts[slot];
        }
        keys
    }

    fn slot(&self, [kind, edge, _]: Key) -> usize {
        (kind as usize - 1) * self.n_lines + edge as usize
    }

    fn place_of(&self, key: Key) -> u32 {
        let slot = self.slot(key);
        let first = self.starts[slot];
        let of_edge = &self.sorted[first as usize..self.starts[slot + 1] as usize];
        first + of_edge.binary_search(&key).map_or(0, |place| place as u32)
    }
}

/// Points by number; near ones are represented by the first of them.
struct Points {
    /// Vertices of the mesh, then new points.
    positions: Vec<DVec3>,
    n_vertices: usize,
    /// By new point.
    stands_for: Vec<u32>,
    /// Numbers of those that stand for themselves and can be near a new one.
    distinct: Vec<u32>,
    tolerance_m: f64,
}

impl Points {
    fn new(faces: &Faces, vertices: &[DVec3], tolerance_m: f64) -> Self {
        let mut is_used = vec![false; vertices.len()];
        faces
            .faces
            .iter()
            .flat_map(|face| face.vertices)
            .for_each(|vertex| is_used[vertex as usize] = true);
        let distinct = (0..vertices.len() as u32).filter(|vertex| is_used[*vertex as usize]);
        Self {
            positions: vertices.to_vec(),
            n_vertices: vertices.len(),
            stands_for: Vec::new(),
            distinct: distinct.collect(),
            tolerance_m,
        }
    }

    fn stands_for(&self, point: u32) -> u32 {
        let new = (point as usize).checked_sub(self.n_vertices);
        new.map_or(point, |new| self.stands_for[new])
    }

    /// Adds points, which are numbered from the count of positions on.
    fn add(&mut self, new: Vec<DVec3>) {
        let first = self.positions.len() as u32;
        self.positions.extend(new);
        let mut numbers = self.distinct.clone();
        numbers.extend(first..self.positions.len() as u32);
        let all = parallel::map(numbers.len(), 256, |k| self.positions[numbers[k] as usize]);
        let near = weld_within(&all, self.tolerance_m);
        for place in self.distinct.len()..numbers.len() {
            let stands_for = numbers[near[place] as usize];
            self.stands_for.push(stands_for);
            if stands_for == numbers[place] {
                self.distinct.push(stands_for);
            }
        }
    }
}

/// Lines across faces.
pub(super) struct Across {
    starts: Vec<u32>,
    lines: Vec<u32>,
}

impl Across {
    /// Of faces and ends of lines, sorted by face.
    fn new(n_faces: usize, across: &[(u32, [u32; 2])], lines: &Lines) -> Self {
        let mut starts = vec![0; n_faces + 1];
        across.iter().for_each(|(face, _)| starts[*face as usize + 1] += 1);
        for face in 0..n_faces {
            starts[face + 1] += starts[face];
        }
        let lines =
            parallel::map(across.len(), 256, |k| lines.number_of(across[k].1).unwrap_or_default());
        Self { starts, lines }
    }

    fn of(&self, face: usize) -> &[u32] {
        &self.lines[self.starts[face] as usize..self.starts[face + 1] as usize]
    }
}

/// Splits lines where they cross others in a face, or where a point of the face lies on them.
fn split_lines(
    faces: &Faces,
    lines: &mut Lines,
    across: &Across,
    points: &mut Points,
    limits: Limits,
) -> Option<()> {
    let mut is_changed: Option<Vec<bool>> = None;
    let mut n_crossings = 0;
    for _ in 0..ROUNDS {
        let splits = parallel::map_with(faces.faces.len(), 16, Sweep::default, |sweep, idx| {
            let face = &faces.faces[idx];
            let across = across.of(idx);
            let has_news = |line: &u32| {
                is_changed
                    .as_ref()
                    .is_none_or(|is_changed| is_changed.get(*line as usize) == Some(&true))
            };
            if across.is_empty() || !(across.iter().chain(&face.edges).any(has_news)) {
                return Splits::default();
            }
            sweep.splits(face, lines, across, points)
        });
        n_crossings += splits.iter().map(|splits| splits.crossings.len()).sum::<usize>();
        if n_crossings > limits.crossings {
            return None;
        }
        let mut changed = vec![false; lines.len()];
        let mut new = Vec::new();
        let mut is_any = false;
        for splits in splits {
            for (line, point) in splits.on_lines {
                lines.put_on(line, point);
                changed[line as usize] = true;
                is_any = true;
            }
            for (of_crossing, at) in splits.crossings {
                let number = (points.positions.len() + new.len()) as u32;
                new.push(at);
                for line in of_crossing {
                    lines.put_on(line, number);
                    changed[line as usize] = true;
                    is_any = true;
                }
            }
        }
        if !is_any {
            break;
        }
        if !new.is_empty() {
            points.add(new);
        }
        lines.sort_points(&points.positions, |point| points.stands_for(point));
        is_changed = Some(changed);
    }
    Some(())
}

/// Where lines of a face are to be split.
#[derive(Default)]
struct Splits {
    /// A line, and a point on it.
    on_lines: Vec<(u32, u32)>,
    /// Two lines that cross, and where.
    crossings: Vec<([u32; 2], DVec3)>,
}

/// Two axes of a plane, such that a face is seen counter-clockwise.
#[derive(Clone, Copy)]
pub(super) struct Axes([usize; 2]);

impl Axes {
    /// Those on which the face is seen largest.
    pub(super) fn of(face: &Face) -> Self {
        let longest = face.normal.abs().max_position();
        let u = (longest + 1) % 3;
        let v = (longest + 2) % 3;
        Self(if face.normal[longest] > 0.0 { [u, v] } else { [v, u] })
    }

    pub(super) fn flat(self, point: DVec3) -> DVec2 {
        DVec2::new(point[self.0[0]], point[self.0[1]])
    }
}

fn side(from: DVec2, to: DVec2, point: DVec2) -> f64 {
    let coord = |p: DVec2| Coord { x: p.x, y: p.y };
    orient2d(coord(from), coord(to), coord(point))
}

/// A part of a line between two points, or a point, in the plane of a face.
#[derive(Clone, Copy)]
struct Part {
    low: DVec2,
    high: DVec2,
    line: u32,
    ends: [u32; 2],
    is_edge: bool,
}

/// Scratch memory of one face.
#[derive(Default)]
struct Sweep {
    parts: Vec<Part>,
    points: Vec<u32>,
    all_points: Vec<u32>,
}

impl Sweep {
    fn splits(&mut self, face: &Face, lines: &Lines, across: &[u32], points: &Points) -> Splits {
        let positions = &points.positions;
        let tolerance = points.tolerance_m;
        let at = |point: u32| positions[point as usize];
        let axes = Axes::of(face);
        self.parts.clear();
        self.all_points.clear();
        for (place, line) in face.edges.iter().chain(across).enumerate() {
            let is_edge = place < 3;
            if !is_edge && face.edges.contains(line) {
                continue;
            }
            lines.points(*line, &mut self.points);
            self.all_points.extend_from_slice(&self.points);
            for ends in self.points.windows(2) {
                let ends = [ends[0], ends[1]];
                let [from, to] = ends.map(|end| axes.flat(at(end)));
                let low = from.min(to) - tolerance;
                let high = from.max(to) + tolerance;
                self.parts.push(Part { low, high, line: *line, ends, is_edge });
            }
        }
        self.all_points.sort_unstable();
        self.all_points.dedup();
        for point in &self.all_points {
            let flat = axes.flat(at(*point));
            let ends = [*point; 2];
            self.parts.push(Part { low: flat, high: flat, line: u32::MAX, ends, is_edge: true });
        }
        self.parts.sort_unstable_by(|one, other| {
            one.low
                .x
                .total_cmp(&other.low.x)
                .then((one.line, one.ends).cmp(&(other.line, other.ends)))
        });

        let mut splits = Splits::default();
        let is_near = |point: u32, [from, to]: [DVec3; 2]| {
            let point = at(point);
            let way = to - from;
            let share = ((point - from).dot(way) / way.length_squared()).clamp(0.0, 1.0);
            (from + share * way).distance_squared(point) <= tolerance * tolerance
        };
        for (place, one) in self.parts.iter().enumerate() {
            for other in &self.parts[place + 1..] {
                if other.low.x > one.high.x {
                    break;
                }
                let is_apart = one.low.y > other.high.y || other.low.y > one.high.y;
                let touches = one.ends.iter().any(|end| other.ends.contains(end));
                if is_apart || touches {
                    continue;
                }
                match (one.line == u32::MAX, other.line == u32::MAX) {
                    (true, true) => {}
                    (false, true) => {
                        if is_near(other.ends[0], one.ends.map(at)) {
                            splits.on_lines.push((one.line, other.ends[0]));
                        }
                    }
                    (true, false) => {
                        if is_near(one.ends[0], other.ends.map(at)) {
                            splits.on_lines.push((other.line, one.ends[0]));
                        }
                    }
                    (false, false) if one.is_edge || other.is_edge => {}
                    (false, false) => {
                        let [a, b] = one.ends.map(|end| axes.flat(at(end)));
                        let [c, d] = other.ends.map(|end| axes.flat(at(end)));
                        let to_a = side(c, d, a);
                        let to_b = side(c, d, b);
                        let to_c = side(a, b, c);
                        let to_d = side(a, b, d);
                        if to_a * to_b >= 0.0 || to_c * to_d >= 0.0 {
                            continue;
                        }
                        // Ends that are near were or will be found as points on a line.
                        if one.ends.iter().any(|end| is_near(*end, other.ends.map(at)))
                            || other.ends.iter().any(|end| is_near(*end, one.ends.map(at)))
                        {
                            continue;
                        }
                        let crossing = at(one.ends[0]).lerp(at(one.ends[1]), to_a / (to_a - to_b));
                        splits.crossings.push(([one.line, other.line], crossing));
                    }
                }
            }
        }
        splits
    }
}
