//! Pointshells: the two phases as the paper prints them, with both ways of projection, beside what
//! is shipped.
//!
//! # Source
//! Sagardia2008, section 4. The first phase goes through all triangles and projects the centres of
//! the voxels that each touches; it keeps what lands inside the triangle and puts the rest aside.
//! The second phase goes through the rest and keeps the first one of each voxel that is still
//! without a point. What is shipped goes brick by brick and keeps one point for each voxel.

use glam::{DVec3, Vec3};

use super::super::statistics::median;
use super::super::{BenchError, Row};
use super::query::{self, Query};
use super::spacing::Spacing;
use super::{Options, timed};
use vps::mesh::TriangleMesh;
use vps::mesh::closest_point::{Projection, TriangleProjector, project_by_voronoi_clamp};
use vps::mesh::validate::inspect;
use vps::pointshell;
use vps::pointshell::project::project;
use vps::voxmap::inside_test::InsideTest;
use vps::voxmap::surface::{Navigation, Surface, visit_hits};
use vps::voxmap::{self, Volume};

/// Layers of the map: those that scenes give to a tool.
const LAYERS: u32 = 4;
/// Points up to which a query is timed: those of the cases of remark 2.
const QUERY_POINTS_MAX: usize = 20_000;

/// What was found at one voxel size.
#[derive(Clone, Debug, Default)]
pub struct Points {
    /// What the two phases make of the projections.
    pub phases: Phases,
    /// The two phases with the first way of projection, s.
    pub clamped_s: f64,
    /// The two phases with the second way of projection, s.
    pub optimised_s: f64,
    /// What is shipped, points only, s.
    pub shipped_s: f64,
    /// The whole shell as shipped: points, normals, order and tree, s.
    pub shell_s: f64,
    /// Distances of neighbours.
    pub spacing: Spacing,
    /// One contact query over all points; `None` where they are too many.
    pub query: Option<Query>,
}

/// How many projections there are, and what comes of them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Phases {
    /// Projections that land inside a triangle.
    pub interior: u64,
    /// Projections on edges and corners.
    pub boundary: u64,
    /// Of these, what the second phase keeps.
    pub recovered: u64,
}

impl Phases {
    /// One for each triangle and voxel that touch.
    pub fn projections(&self) -> u64 {
        self.interior + self.boundary
    }

    /// Points after both phases.
    pub fn points(&self) -> u64 {
        self.interior + self.recovered
    }

    /// The paper's ratio: recovered of the boundary projections, %.
    pub fn recovered_percent(&self) -> f64 {
        100.0 * self.recovered as f64 / self.boundary as f64
    }
}

impl Points {
    /// Δ as it can be measured here: the two phases as printed over what is shipped.
    pub fn delta(&self) -> f64 {
        self.optimised_s / self.shipped_s
    }

    pub(super) fn rows(&self, group: &str) -> Vec<Row> {
        let Self { phases, spacing, .. } = self;
        let mut rows = vec![
            Row::new(group, "two phases, first way of projection", self.clamped_s, "s"),
            Row::new(group, "two phases, second way of projection", self.optimised_s, "s"),
            Row::new(group, "points as shipped", self.shipped_s, "s"),
            Row::new(group, "shell as shipped: points, normals, order, tree", self.shell_s, "s"),
            Row::new(group, "projections", phases.projections() as f64, ""),
            Row::new(group, "points after both phases", phases.points() as f64, ""),
            Row::new(group, "boundary projections", phases.boundary as f64, ""),
            Row::new(
                group,
                "boundary projections that are recovered",
                phases.recovered_percent(),
                "%",
            ),
            Row::new(group, "distance of neighbours, median", spacing.median(), "voxels"),
            Row::new(group, "distance of neighbours, largest", spacing.largest(), "voxels"),
        ];
        if let Some(query) = &self.query {
            rows.push(Row::new(
                group,
                format!("query over all {} points", query.n_points),
                query.median_us,
                "µs",
            ));
        }
        rows
    }
}

/// Measures the points of a surface, the ways in turn.
pub(super) fn measure(
    what: &str,
    mesh: &TriangleMesh,
    surface: Surface,
    options: Options,
) -> Result<Points, BenchError> {
    let refused = |why: String| BenchError::Prepare { what: what.to_owned(), why };
    let voxel_size_m = surface.grid.voxel_size_m;
    let [mut clamped_s, mut optimised_s, mut shipped_s, mut shell_s] = [const { Vec::new() }; 4];
    let map_options =
        voxmap::Options { voxel_size_m, layers: LAYERS, navigation: None, sides: InsideTest::Auto };
    let map = Volume::build(mesh, &inspect(mesh), &map_options, |_| ())
        .map_err(|error| refused(error.to_string()))?;
    let mut phases = Phases::default();
    let mut placed = Vec::new();
    for _ in 0..options.n_runs {
        clamped_s.push(timed(|| two_phases(mesh, &surface, clamped)).1);
        let seconds;
        (phases, seconds) = timed(|| two_phases(mesh, &surface, optimised));
        optimised_s.push(seconds);
        let seconds;
        (placed, seconds) = timed(|| project(mesh, &surface));
        shipped_s.push(seconds);
        shell_s.push(timed(|| pointshell::build(mesh, &map, DVec3::ZERO)).1);
    }
    let spacing = Spacing::of(&surface, &placed);
    drop((placed, surface));
    let query =
        (map.surface.n_voxels <= QUERY_POINTS_MAX).then(|| query::measure(mesh, map, options));
    let of = |seconds: &[f64]| median(seconds).unwrap_or_default();
    Ok(Points {
        phases,
        clamped_s: of(&clamped_s),
        optimised_s: of(&optimised_s),
        shipped_s: of(&shipped_s),
        shell_s: of(&shell_s),
        spacing,
        query,
    })
}

/// The first way of projection: onto the plane, then by Voronoi region.
pub(super) fn clamped(corners: &[DVec3; 3]) -> impl Fn(DVec3) -> Projection + use<> {
    let corners = *corners;
    move |point| project_by_voronoi_clamp(&corners, point)
}

/// The second way of projection: the constrained minimum.
pub(super) fn optimised(corners: &[DVec3; 3]) -> impl Fn(DVec3) -> Projection + use<> {
    let projector = TriangleProjector::new(corners);
    move |point| projector.project(point)
}

/// The two phases as printed. `prepare` makes a projection onto a triangle, cell coordinates.
fn two_phases<P: Fn(DVec3) -> Projection>(
    mesh: &TriangleMesh,
    surface: &Surface,
    prepare: impl Fn(&[DVec3; 3]) -> P,
) -> Phases {
    let (mut points, mut boundary): (Vec<Vec3>, Vec<(u32, Vec3)>) = (Vec::new(), Vec::new());
    let mut is_projected = vec![false; surface.n_voxels];
    for triangle_idx in 0..mesh.triangles.len() {
        let corners = mesh.corners(triangle_idx).map(|corner| surface.grid.to_cells(corner));
        let project = prepare(&corners);
        visit_hits(&corners, surface.grid.dims, Navigation::AUTO, |cell| {
            let Some(rank) = surface.rank(cell) else { return };
            let projection = project(DVec3::from_array(cell.map(f64::from)) + 0.5);
            if projection.feature.is_interior() {
                points.push(projection.point.as_vec3());
                is_projected[rank] = true;
            } else {
                boundary.push((rank as u32, projection.point.as_vec3()));
            }
        });
    }
    let mut phases =
        Phases { interior: points.len() as u64, boundary: boundary.len() as u64, recovered: 0 };
    for (rank, point) in boundary {
        if !is_projected[rank as usize] {
            is_projected[rank as usize] = true;
            points.push(point);
            phases.recovered += 1;
        }
    }
    // The points are the product: they must not be optimised away.
    std::hint::black_box(points);
    phases
}

#[cfg(test)]
mod tests {
    use super::super::super::stand_ins::StandIn;
    use super::super::SEED;
    use super::*;
    use vps::voxmap::grid::Grid;

    /// The second phase keeps a point for exactly the voxels to which the shipped way gives one on
    /// an edge or a corner.
    #[test]
    fn both_ways_recover_the_same_voxels() {
        let mesh = StandIn::Brake.mesh(SEED);
        let (low, high) = mesh.bounds().unwrap();
        let surface =
            Surface::mark(&mesh, &Grid::around(low, high, 12e-3, 1).unwrap(), Navigation::AUTO);
        let placed = project(&mesh, &surface);
        let phases = two_phases(&mesh, &surface, optimised);
        assert_eq!(
            phases.recovered,
            placed.iter().filter(|point| point.on_boundary).count() as u64
        );
        assert!(
            phases.points() > placed.len() as u64 && phases.boundary > phases.interior,
            "{phases:?}"
        );
        let clamped = two_phases(&mesh, &surface, clamped);
        assert_eq!(clamped.projections(), phases.projections());
        // Rounding decides otherwise only where a projection lies on an edge.
        assert!(
            clamped.interior.abs_diff(phases.interior) < phases.interior / 100,
            "{clamped:?} {phases:?}"
        );
    }
}
