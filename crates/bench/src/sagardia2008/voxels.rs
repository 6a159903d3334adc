//! One model at one voxel size: the grid, the surface by each navigation, the fill; and its points,
//! where they are not too many.
//!
//! # Source
//! Sagardia2008, section 3.1.

use super::super::stand_ins::StandIn;
use super::super::statistics::median;
use super::super::{BenchError, Row};
use super::points::{self, Points};
use super::{Options, timed};
use vps::mesh::TriangleMesh;
use vps::voxmap::fill::Sides;
use vps::voxmap::grid::Grid;
use vps::voxmap::surface::{Navigation, Surface};

/// What was found at one voxel size.
#[derive(Clone, Debug)]
pub struct Step {
    /// The model.
    pub stand_in: StandIn,
    /// Edge of a voxel.
    pub size_mm: f64,
    /// Of the grid, padded by one on each side as the paper's.
    pub voxels: u64,
    /// Those that the surface touches.
    pub surface_voxels: usize,
    /// Bounds of the mesh and the grid around them, s.
    pub init_s: f64,
    /// Flood fill, s.
    pub fill_s: f64,
    /// The naïve way: every voxel in the box of each triangle.
    pub whole_box: Marking,
    /// The first navigation.
    pub plane_span: Marking,
    /// The second navigation.
    pub two_sided: Marking,
    /// Pointshell.
    pub points: Points,
}

/// The surface found in one way.
#[derive(Clone, Debug, Default)]
pub struct Marking {
    /// Seconds of each run.
    pub runs_s: Vec<f64>,
    /// Tests of a triangle and a voxel.
    pub tests: u64,
}

impl Marking {
    /// Median of the runs, s.
    pub fn median_s(&self) -> f64 {
        median(&self.runs_s).unwrap_or(f64::NAN)
    }

    fn run(&mut self, mesh: &TriangleMesh, grid: &Grid, navigation: Navigation) -> Surface {
        let (surface, seconds) = timed(|| Surface::mark(mesh, grid, navigation));
        self.runs_s.push(seconds);
        self.tests = surface.sat_tests;
        surface
    }
}

impl Step {
    /// A step without figures.
    pub(super) fn of(stand_in: StandIn, size_mm: f64) -> Self {
        Self {
            stand_in,
            size_mm,
            voxels: 0,
            surface_voxels: 0,
            init_s: 0.0,
            fill_s: 0.0,
            whole_box: Marking::default(),
            plane_span: Marking::default(),
            two_sided: Marking::default(),
            points: Points::default(),
        }
    }

    /// Δ as it can be measured here: time of the naïve way over that of the second navigation.
    pub fn delta(&self) -> f64 {
        self.whole_box.median_s() / self.two_sided.median_s()
    }

    /// Least and largest Δ of single runs.
    pub(super) fn delta_range(&self) -> [f64; 2] {
        let deltas = self
            .whole_box
            .runs_s
            .iter()
            .zip(&self.two_sided.runs_s)
            .map(|(old_s, new_s)| old_s / new_s);
        deltas.fold([f64::INFINITY, 0.0], |[least, most], delta| {
            [f64::min(least, delta), f64::max(most, delta)]
        })
    }

    /// Time of the first navigation over that of the second: above 1 the second one is the faster
    /// one.
    pub fn first_over_second(&self) -> f64 {
        self.plane_span.median_s() / self.two_sided.median_s()
    }

    /// Every run of the second navigation was faster than every run of the first: a difference of
    /// medians alone may be chance.
    pub(super) fn is_second_faster(&self) -> bool {
        let slowest_s = self.two_sided.runs_s.iter().copied().fold(0.0, f64::max);
        self.plane_span.runs_s.iter().all(|first_s| slowest_s < *first_s)
    }

    pub(super) fn rows(&self, group: &str) -> Vec<Row> {
        let mut rows = vec![
            Row::new(group, "initialise", self.init_s, "s"),
            Row::new(group, "fill", self.fill_s, "s"),
        ];
        let ways = [
            ("every voxel of each box", &self.whole_box),
            ("first navigation", &self.plane_span),
            ("second navigation", &self.two_sided),
        ];
        for (name, marking) in ways {
            rows.push(Row::new(group, name, marking.median_s(), "s"));
            rows.push(Row::new(group, format!("{name}: tests"), marking.tests as f64, ""));
        }
        rows.extend(self.points.rows(group));
        rows
    }
}

/// Measures one step, the ways in turn.
pub(super) fn step(
    stand_in: StandIn,
    mesh: &TriangleMesh,
    size_mm: f64,
    options: Options,
    tell: &mut dyn FnMut(&str),
) -> Result<Step, BenchError> {
    let what = format!("{} at {size_mm} mm", stand_in.name());
    let mut step = Step::of(stand_in, size_mm);
    let mut init_s = Vec::new();
    let mut fill_s = Vec::new();
    let mut marked = None;
    for run in 0..options.n_runs {
        tell(&format!("{what}, run {}", run + 1));
        let (grid, seconds) = timed(|| {
            let (low, high) = mesh.bounds().unwrap_or_default();
            Grid::around(low, high, size_mm * 1e-3, 1)
        });
        let grid = grid
            .map_err(|error| BenchError::Prepare { what: what.clone(), why: error.to_string() })?;
        init_s.push(seconds);
        step.voxels = grid.dims.map(|n| u64::from(n) - 2).iter().product();
        step.whole_box.run(mesh, &grid, Navigation::WholeBox);
        step.plane_span.run(mesh, &grid, Navigation::PlaneSpan);
        let surface = step.two_sided.run(mesh, &grid, Navigation::TwoSided);
        fill_s.push(timed(|| Sides::flood(&surface)).1);
        marked = Some(surface);
    }
    step.init_s = median(&init_s).unwrap_or_default();
    step.fill_s = median(&fill_s).unwrap_or_default();
    if let Some(surface) = marked {
        step.surface_voxels = surface.n_voxels;
        tell(&format!("{what}, points"));
        step.points = points::measure(&what, mesh, surface, options)?;
    }
    Ok(step)
}

#[cfg(test)]
mod tests {
    use super::super::SEED;
    use super::*;

    /// In the box of a triangle of any shape there are voxels that it does not touch, and the naïve
    /// way asks about each.
    #[test]
    fn the_naive_way_marks_the_same_by_more_tests() {
        let mesh = StandIn::Bracket.mesh(SEED);
        let (low, high) = mesh.bounds().unwrap();
        let grid = Grid::around(low, high, 16e-3, 1).unwrap();
        let [whole_box, two_sided] = [Navigation::WholeBox, Navigation::TwoSided]
            .map(|way| Surface::mark(&mesh, &grid, way));
        assert!(whole_box.cells().eq(two_sided.cells()));
        let in_boxes = |idx: usize| {
            let [a, b, c] = mesh.corners(idx).map(|corner| grid.to_cells(corner));
            let cells = a.max(b).max(c).floor() - a.min(b).min(c).ceil() + 2.0;
            (cells.x * cells.y * cells.z) as u64
        };
        assert_eq!(whole_box.sat_tests, (0..mesh.triangles.len()).map(in_boxes).sum::<u64>());
        assert!(whole_box.sat_tests > two_sided.sat_tests);
    }
}
