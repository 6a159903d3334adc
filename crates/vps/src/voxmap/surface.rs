//! Which voxels does the surface touch? The set of `TriangleSat::hits` over all triangles, found
//! column by column.
//!
//! # Source
//! Sagardia2008, section 3.1: two navigations through the candidates of a triangle, and none, see
//! [`Navigation`].

use core::sync::atomic::{AtomicU64, Ordering};

use glam::DVec3;

pub use super::bricks::Mask;
pub(crate) use super::bricks::bits;
use super::bricks::{BrickSet, MarkedCells, Marks};
use super::columns::{Columns, Run, WholeBox};
use super::grid::{BRICK_EDGE, Grid};
pub use super::navigation::Navigation;
use crate::mesh::TriangleMesh;
use crate::parallel;

/// The voxels that the surface touches, sparse.
#[derive(Debug)]
pub struct Surface {
    /// The grid of the map.
    pub grid: Grid,
    /// Bricks that hold surface.
    index: BrickSet,
    /// `[n_slots]`, ascending: number of the brick in the grid.
    pub bricks: Vec<u32>,
    /// `[n_slots]`: surface cells of the brick.
    pub masks: Vec<Mask>,
    /// `[n_slots][8]`: surface voxels before this word of the brick's mask. More than 2³² do not
    /// fit; `build` refuses them.
    ranks: Vec<[u32; BRICK_EDGE]>,
    /// Number of surface voxels.
    pub n_voxels: usize,
    /// SAT tests that the navigation spent: one for each voxel of a column that it asked about,
    /// however it was answered.
    pub sat_tests: u64,
    /// How the candidates were walked.
    pub navigation: Navigation,
}

/// Columns of a triangle from which on its slabs are shared among the threads.
const LARGE_TRIANGLE_COLUMNS: u64 = 1 << 14;

impl Surface {
    /// Marks every voxel that a triangle of `mesh` touches.
    ///
    /// Runs on the current rayon pool; the result does not depend on the number of threads (marks
    /// are combined by OR, slots are numbered in grid order). Cost: O(surface voxels), 4 bytes per
    /// brick of the grid while it runs.
    pub fn mark(mesh: &TriangleMesh, grid: &Grid, navigation: Navigation) -> Self {
        let marks = Marks::new(grid.n_bricks());
        let sat_tests = AtomicU64::new(0);
        let count = |tests: u64| _ = sat_tests.fetch_add(tests, Ordering::Relaxed);
        parallel::for_each_range(mesh.triangles.len(), 64, &|range| {
            count(
                range
                    .map(|triangle_idx| {
                        let corners =
                            mesh.corners(triangle_idx).map(|corner| grid.to_cells(corner));
                        if let Some(candidates) =
                            WholeBox::of_navigation(&corners, grid.dims, navigation)
                        {
                            let walk = |slabs, pen: &mut Pen<'_>| {
                                candidates.walk(slabs, |run| pen.draw(run))
                            };
                            return mark_slabs(
                                grid,
                                &marks,
                                candidates.slabs(),
                                candidates.n_columns(),
                                &count,
                                walk,
                            );
                        }
                        let columns = Columns::new(&corners, grid.dims);
                        let walk = |slabs, pen: &mut Pen<'_>| {
                            columns.walk(slabs, navigation, |run| pen.draw(run))
                        };
                        mark_slabs(grid, &marks, columns.slabs(), columns.n_columns(), &count, walk)
                    })
                    .sum(),
            );
        });
        let sat_tests = sat_tests.into_inner();
        let (index, bricks, masks) = marks.into_masks();
        Self::of_masks(grid, index, bricks, masks, sat_tests, navigation)
    }

    /// This surface with the voxels that the triangles of `added` touch: what [`Self::mark`] makes
    /// of both meshes in one.
    pub(super) fn with(&self, added: &TriangleMesh) -> Self {
        let Self { grid, index, navigation, .. } = self;
        let added = Self::mark(added, grid, *navigation);
        let words =
            (0..grid.n_bricks().div_ceil(64)).map(|word| index.word(word) | added.index.word(word));
        let index = BrickSet::new(words);
        let bricks = index.members();
        let mask = |surface: &Self, brick: &u32| {
            surface.slot(*brick as usize).map_or([0; BRICK_EDGE], |slot| surface.masks[slot])
        };
        let masks = parallel::map(bricks.len(), 1, |slot| {
            let one = mask(self, &bricks[slot]);
            let other = mask(&added, &bricks[slot]);
            core::array::from_fn(|x| one[x] | other[x])
        });
        Self::of_masks(grid, index, bricks, masks, self.sat_tests + added.sat_tests, *navigation)
    }

    fn of_masks(
        grid: &Grid,
        index: BrickSet,
        bricks: Vec<u32>,
        masks: Vec<Mask>,
        sat_tests: u64,
        navigation: Navigation,
    ) -> Self {
        let mut n_voxels = 0;
        let ranks = masks
            .iter()
            .map(|mask| {
                mask.map(|word| {
                    let before = n_voxels as u32;
                    n_voxels += word.count_ones() as usize;
                    before
                })
            })
            .collect();
        Self { grid: *grid, index, bricks, masks, ranks, n_voxels, sat_tests, navigation }
    }

    /// Slot of a brick, or `None` where it holds no surface.
    #[inline]
    pub fn slot(&self, brick: usize) -> Option<usize> {
        self.index.slot(brick)
    }

    /// Bricks that hold surface.
    pub(super) fn brick_set(&self) -> &BrickSet {
        &self.index
    }

    /// True for a surface voxel; false outside the grid.
    pub fn contains(&self, cell: [i32; 3]) -> bool {
        self.rank(cell).is_some()
    }

    /// Position of a surface voxel in the order of [`Self::cells`]; `None` for any other cell.
    pub fn rank(&self, cell: [i32; 3]) -> Option<usize> {
        if !self.grid.contains(cell) {
            return None;
        }
        let (brick, inside) = self.grid.locate(cell);
        let slot = self.slot(brick)?;
        let mask = &self.masks[slot];
        let word = inside >> 6;
        let bit = inside & 63;
        if mask[word] >> bit & 1 == 0 {
            return None;
        }
        let within = (mask[word] & ((1 << bit) - 1)).count_ones();
        Some((self.ranks[slot][word] + within) as usize)
    }

    /// `[8]`: rank of the first surface voxel in each word of a slot's mask, or what it would be.
    #[inline]
    pub(super) fn ranks(&self, slot: usize) -> &[u32; BRICK_EDGE] {
        &self.ranks[slot]
    }

    /// Every surface voxel, in order of rank.
    pub fn cells(&self) -> impl Iterator<Item = [i32; 3]> + '_ {
        self.bricks.iter().zip(&self.masks).flat_map(|(brick, mask)| {
            let origin = super::grid::brick_origin(self.grid.brick_coord(*brick as usize));
            mask.iter().enumerate().flat_map(move |(x, word)| {
                bits(*word).map(move |bit| {
                    [
                        origin[0] + x as i32,
                        origin[1] + (bit >> 3) as i32,
                        origin[2] + (bit & 7) as i32,
                    ]
                })
            })
        })
    }
}

/// Calls `visit` once for every voxel that the triangle touches; returns the number of SAT tests.
///
/// `corners` in cell coordinates. Candidate ranges are closed intervals (touching counts), so the
/// set of hits is that of `TriangleSat::hits` over the whole grid, whatever the navigation.
pub fn visit_hits(
    corners: &[DVec3; 3],
    dims: [u32; 3],
    navigation: Navigation,
    mut visit: impl FnMut([i32; 3]),
) -> u64 {
    let each = |run: Run| {
        let mut cell = run.first;
        for w in run.first[run.axis]..=run.last {
            cell[run.axis] = w;
            visit(cell);
        }
    };
    if let Some(candidates) = WholeBox::of_navigation(corners, dims, navigation) {
        return candidates.walk(candidates.slabs(), each);
    }
    let columns = Columns::new(corners, dims);
    columns.walk(columns.slabs(), navigation, each)
}

/// As [`visit_hits`], by a test of every voxel in the triangle's box: the reference of tests, and
/// what the bench measures the navigations against.
#[cfg(any(test, feature = "testing"))]
pub fn visit_hits_by_brute_force(
    corners: &[DVec3; 3],
    dims: [u32; 3],
    mut visit: impl FnMut([i32; 3]),
) -> u64 {
    let sat = super::sat::TriangleSat::new(corners);
    let (low, high) = sat.bounds;
    let mut tests = 0;
    // A cell more than needed on every side: the reference must not share the candidate ranges that
    // it checks.
    let around = |low: f64, high: f64, n_cells: u32| {
        (low as i32 - 2).max(0)..=(high as i32 + 2).min(n_cells as i32 - 1)
    };
    for x in around(low.x, high.x, dims[0]) {
        for y in around(low.y, high.y, dims[1]) {
            for z in around(low.z, high.z, dims[2]) {
                tests += 1;
                if sat.hits([x, y, z]) {
                    visit([x, y, z]);
                }
            }
        }
    }
    tests
}

/// Marks the slabs of one triangle, those of a large one on all threads; returns the tests that are
/// not counted yet.
#[inline]
fn mark_slabs(
    grid: &Grid,
    marks: &Marks,
    slabs: (i32, i32),
    n_columns: u64,
    count: &(impl Fn(u64) + Sync),
    walk: impl Fn((i32, i32), &mut Pen<'_>) -> u64 + Sync,
) -> u64 {
    if n_columns < LARGE_TRIANGLE_COLUMNS {
        return walk(slabs, &mut Pen::new(grid, marks));
    }
    let edge = BRICK_EDGE as i32;
    let share = |first: i32| {
        walk((first.max(slabs.0), (first + edge - 1).min(slabs.1)), &mut Pen::new(grid, marks))
    };
    let first_brick = slabs.0 / edge;
    let n_bricks = (slabs.1 / edge + 1 - first_brick).max(0) as usize;
    parallel::for_each_range(n_bricks, 1, &|range| {
        count(range.map(|brick| share((first_brick + brick as i32) * edge)).sum());
    });
    0
}

/// Draws runs of voxels into the masks of their bricks; knows the brick it drew in last.
struct Pen<'a> {
    grid: &'a Grid,
    marks: &'a Marks,
    brick: [u32; 3],
    cells: Option<&'a MarkedCells>,
}

impl<'a> Pen<'a> {
    fn new(grid: &'a Grid, marks: &'a Marks) -> Self {
        Self { grid, marks, brick: [0; 3], cells: None }
    }

    #[inline]
    fn draw(&mut self, run: Run) {
        const EDGE: i32 = BRICK_EDGE as i32;
        let mut cell = run.first;
        while cell[run.axis] <= run.last {
            let brick = cell.map(|i| i as u32 / EDGE as u32);
            if brick != self.brick || self.cells.is_none() {
                self.brick = brick;
                self.cells = Some(self.marks.cells(self.grid.brick_index(brick)));
            }
            let Some(cells) = self.cells else { return };
            let [x, y, z] = cell.map(|i| (i % EDGE) as usize);
            let from = cell[run.axis];
            let to = run.last.min(from | (EDGE - 1));
            let n = to - from + 1;
            match run.axis {
                0 => cells[x..x + n as usize]
                    .iter()
                    .for_each(|word| add(word, 1 << (y * BRICK_EDGE + z))),
                1 => add(&cells[x], (FIRST_Z >> (8 * (EDGE - n))) << (y * BRICK_EDGE + z)),
                _ => add(&cells[x], (0xff >> (EDGE - n)) << (y * BRICK_EDGE + z)),
            }
            cell[run.axis] = to + 1;
        }
    }
}

/// Every z = 0 cell of one x-layer of a brick.
pub(super) const FIRST_Z: u64 = 0x0101_0101_0101_0101;

#[inline]
fn add(word: &AtomicU64, cells: u64) {
    // Relaxed: marks need no order among each other; the join publishes them. Triangles share most
    // of the cells along their edges, and a look is cheaper than an atomic OR.
    if word.load(Ordering::Relaxed) & cells != cells {
        word.fetch_or(cells, Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Triangles in the middle of a grid of 40³ cells, some in bricks of their own.
    fn shards(n: usize, seed: f64) -> TriangleMesh {
        let number = |k: usize| (seed + 0.618_034 * k as f64).fract();
        let vertices: Vec<DVec3> = (0..3 * n)
            .map(|k| {
                DVec3::new(number(3 * k), number(3 * k + 1), number(3 * k + 2))
                    * if k % 3 == 0 { 36.0 } else { 9.0 }
            })
            .collect();
        let vertices = vertices
            .chunks(3)
            .flat_map(|v| [v[0], v[0] + v[1], v[0] + v[2]].map(|v| v.min(DVec3::splat(40.0))))
            .collect();
        TriangleMesh {
            vertices,
            triangles: (0..n as u32).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect(),
        }
    }

    #[test]
    fn marking_more_is_marking_both_at_once() {
        let grid = Grid::around(DVec3::ZERO, DVec3::splat(40.0), 1.0, 2).expect("a grid that fits");
        for (n, n_more) in [(12, 7), (3, 40), (5, 0), (0, 5)] {
            let one = shards(n, 0.1);
            let more = shards(n_more, 0.7);
            let mut both = one.clone();
            let first = both.vertices.len() as u32;
            both.vertices.extend(&more.vertices);
            both.triangles.extend(
                more.triangles.iter().map(|triangle| triangle.map(|vertex| vertex + first)),
            );
            let added = Surface::mark(&one, &grid, Navigation::TwoSided).with(&more);
            let at_once = Surface::mark(&both, &grid, Navigation::TwoSided);
            assert!(n + n_more == 0 || at_once.n_voxels > 0);
            assert!(
                n == 0
                    || n_more == 0
                    || at_once.n_voxels > Surface::mark(&one, &grid, Navigation::TwoSided).n_voxels
            );
            let Surface {
                grid: _,
                index: _,
                bricks,
                masks,
                ranks,
                n_voxels,
                sat_tests,
                navigation,
            } = &added;
            assert_eq!((bricks, masks, ranks), (&at_once.bricks, &at_once.masks, &at_once.ranks));
            assert_eq!(
                (*n_voxels, *sat_tests, *navigation),
                (at_once.n_voxels, at_once.sat_tests, at_once.navigation)
            );
            let cells: Vec<[i32; 3]> = at_once.cells().collect();
            assert!(cells.iter().enumerate().all(|(rank, cell)| added.rank(*cell) == Some(rank)));
            assert_eq!(added.index.members(), at_once.index.members());
        }
    }

    #[test]
    fn a_triangle_large_enough_to_be_shared_marks_the_cells_of_its_walk() {
        let corners = [
            DVec3::new(3.1, 4.2, 5.3),
            DVec3::new(380.7, 20.4, 90.1),
            DVec3::new(40.6, 410.9, 200.5),
        ];
        let mesh = TriangleMesh { vertices: corners.to_vec(), triangles: vec![[0, 1, 2]] };
        let grid = Grid::around(corners[0], corners[0].max(corners[1]).max(corners[2]), 1.0, 1)
            .expect("a grid that fits");
        let in_cells = corners.map(|corner| grid.to_cells(corner));
        assert!(Columns::new(&in_cells, grid.dims).n_columns() > LARGE_TRIANGLE_COLUMNS);
        for navigation in
            [Navigation::PlaneSpan, Navigation::TwoSided, Navigation::Auto, Navigation::WholeBox]
        {
            let surface = Surface::mark(&mesh, &grid, navigation);
            let mut walked = Vec::new();
            let tests = visit_hits(&in_cells, grid.dims, navigation, |cell| walked.push(cell));
            assert_eq!(surface.sat_tests, tests);
            walked.sort_unstable();
            let mut marked: Vec<[i32; 3]> = surface.cells().collect();
            for (rank, cell) in marked.iter().enumerate() {
                assert_eq!(surface.rank(*cell), Some(rank));
            }
            marked.sort_unstable();
            assert_eq!(marked, walked);
        }
    }
}
