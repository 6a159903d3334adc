//! Straight lines between two points, and the points that lie on them.
//!
//! An edge of a triangle is a line, and so is what two triangles have in common. All triangles
//! with the same line are cut at the same points, so that their fragments fit together.

use glam::DVec3;
use rayon::slice::ParallelSliceMut;

use crate::parallel;

/// Parts of lines that are lines with points of their own are looked into this many times.
const DEPTH: usize = 8;

/// Lines, known by the numbers of their ends.
#[derive(Debug, Default)]
pub(super) struct Lines {
    /// Lower end first; in rising order up to `n_edges`, and from there.
    ends: Vec<[u32; 2]>,
    /// The edges, and the lines that were added, by their lower ends.
    by_lower: [ByLower; 2],
    /// Line, point: in any order and repeated, until they are sorted.
    on: Vec<(u32, u32)>,
    /// `[n_lines + 1]`: where the points of each line begin in `on`, as sorted last.
    starts: Vec<u32>,
}

fn lower_first([one, other]: [u32; 2]) -> [u32; 2] {
    [one.min(other), one.max(other)]
}

fn sort_ends(ends: &mut Vec<[u32; 2]>) {
    ends.iter_mut().for_each(|ends| *ends = lower_first(*ends));
    ends.par_sort_unstable_by_key(|[low, high]| u64::from(*low) << 32 | u64::from(*high));
    ends.dedup();
}

/// Where the lines with the same lower end are among sorted ones: few share one, so that looking
/// there takes a step or two instead of the logarithm of all lines.
#[derive(Debug, Default)]
struct ByLower {
    first: usize,
    /// By lower end, up to the highest, relative to `first`.
    starts: Vec<u32>,
}

impl ByLower {
    /// Of sorted lines, the first of which has the number `first`.
    fn of(ends: &[[u32; 2]], first: usize) -> Self {
        let n_points = ends.last().map_or(0, |[low, _]| *low as usize + 1);
        let mut starts = vec![0; n_points + 1];
        ends.iter().for_each(|[low, _]| starts[*low as usize + 1] += 1);
        for point in 0..n_points {
            starts[point + 1] += starts[point];
        }
        Self { first, starts }
    }

    fn number_of(&self, all: &[[u32; 2]], ends: [u32; 2]) -> Option<u32> {
        let low = ends[0] as usize;
        let start = self.first + *self.starts.get(low)? as usize;
        let end = self.first + *self.starts.get(low + 1)? as usize;
        let place = all[start..end].binary_search_by_key(&ends[1], |ends| ends[1]).ok()?;
        Some((start + place) as u32)
    }
}

impl Lines {
    /// The edges of triangles, in any order and repeated.
    pub(super) fn of(mut edges: Vec<[u32; 2]>) -> Self {
        sort_ends(&mut edges);
        let starts = vec![0; edges.len() + 1];
        let by_lower = [ByLower::of(&edges, 0), ByLower::default()];
        Self { by_lower, ends: edges, on: Vec::new(), starts }
    }

    /// Adds lines, once, which may be edges.
    pub(super) fn add(&mut self, mut ends: Vec<[u32; 2]>) {
        sort_ends(&mut ends);
        ends.retain(|ends| self.number_of(*ends).is_none());
        self.by_lower[1] = ByLower::of(&ends, self.ends.len());
        self.ends.append(&mut ends);
    }

    pub(super) fn len(&self) -> usize {
        self.ends.len()
    }

    /// Lower end first.
    pub(super) fn ends(&self, line: u32) -> [u32; 2] {
        self.ends[line as usize]
    }

    /// The line between two points.
    pub(super) fn number_of(&self, ends: [u32; 2]) -> Option<u32> {
        let ends = lower_first(ends);
        let [edges, added] = &self.by_lower;
        edges.number_of(&self.ends, ends).or_else(|| added.number_of(&self.ends, ends))
    }

    /// Says that a point lies on a line.
    pub(super) fn put_on(&mut self, line: u32, point: u32) {
        self.on.push((line, point));
    }

    /// Sorts the points that were put on lines, and gives them their last numbers.
    pub(super) fn sort_points(
        &mut self,
        positions: &[DVec3],
        number_of: impl Fn(u32) -> u32 + Sync,
    ) {
        let on = std::mem::take(&mut self.on);
        let mut sorted = parallel::map(on.len(), 256, |k| {
            let (line, point) = on[k];
            let point = number_of(point);
            let [from, to] = self.ends(line);
            let start = positions[from as usize];
            let way = positions[to as usize] - start;
            (line, (positions[point as usize] - start).dot(way), point)
        });
        sorted.retain(|(line, _, point)| !self.ends(*line).contains(point));
        sorted.par_sort_unstable_by(|one, other| {
            one.0.cmp(&other.0).then(one.1.total_cmp(&other.1)).then(one.2.cmp(&other.2))
        });
        sorted.dedup_by_key(|(line, _, point)| (*line, *point));
        self.starts.clear();
        self.starts.resize(self.ends.len() + 1, 0);
        sorted.iter().for_each(|(line, ..)| self.starts[*line as usize + 1] += 1);
        for line in 0..self.ends.len() {
            self.starts[line + 1] += self.starts[line];
        }
        self.on = sorted.into_iter().map(|(line, _, point)| (line, point)).collect();
    }

    fn between(&self, line: u32) -> &[(u32, u32)] {
        &self.on[self.starts[line as usize] as usize..self.starts[line as usize + 1] as usize]
    }

    /// Points lie between the ends, as sorted last.
    pub(super) fn is_split(&self, line: u32) -> bool {
        !self.between(line).is_empty()
    }

    /// The points from the lower end to the higher, both included, as sorted last. A part of the
    /// line that has points as a line of its own is split there too.
    pub(super) fn points(&self, line: u32, points: &mut Vec<u32>) {
        points.clear();
        self.append(&Within { line, outer: None, depth: 0 }, points);
        points.push(self.ends(line)[1]);
    }

    /// All points but the higher end.
    fn append(&self, within: &Within<'_>, points: &mut Vec<u32>) {
        let &Within { line, depth, .. } = within;
        let [mut last, end] = self.ends(line);
        let between = self.between(line);
        if between.is_empty() {
            points.push(last);
            return;
        }
        for next in between.iter().map(|(_, point)| *point).chain([end]) {
            let part = if depth < DEPTH { self.number_of([last, next]) } else { None };
            match part.filter(|part| self.is_split(*part) && !within.holds(*part)) {
                None => points.push(last),
                Some(part) => {
                    let place = points.len();
                    let inner = Within { line: part, outer: Some(within), depth: depth + 1 };
                    self.append(&inner, points);
                    if last > next {
                        // It came from `next`, and without `last`.
                        points.remove(place);
                        points.push(last);
                        points[place..].reverse();
                    }
                }
            }
            last = next;
        }
    }
}

/// A line, and those that it is a part of. Ends within the tolerance of each other can make a line a
/// part of its own part: looked into again and again, that would double its points every time.
struct Within<'a> {
    line: u32,
    outer: Option<&'a Within<'a>>,
    depth: usize,
}

impl Within<'_> {
    fn holds(&self, line: u32) -> bool {
        self.line == line || self.outer.is_some_and(|outer| outer.holds(line))
    }
}
