//! How long a contact query takes: against points and contact share, over all points and down the
//! tree, and against triangles.
//!
//! Tools move as a hand moves them, 50 mm/s and 1 rad/s, so that a walk may use what it knows from
//! the tick before. Times are processor time of the thread: what a query costs, not what else the
//! machine did meanwhile.

use core::f64::consts::TAU;
use std::hint::black_box;

use glam::{DQuat, DVec3};

use super::super::statistics::{median, quantile};
use super::super::{BenchError, Row};
use super::Options;
use super::fields::contact;
use super::fixture::{self, Tube};
use rt::clock::thread_cpu_ns;
use vps::contact::{Budget, ContactSum, Obstacle, SimdLevel, Traversal, TraversalMode};
use vps::mesh::primitives::Shape;
use vps::pointshell::Points;
use vps::pointshell::shell::Shell;
use vps::spatial::Pose;
use vps::voxmap::field::FieldKind;

/// Voxel of the static parts, m; the tool's is what gives the wanted number of points.
const VOXEL_M: f64 = 5e-4;
const BORE_M: f64 = 0.02;
/// Between pin and bore: every point of the pin's side is inside the band.
const GAP_M: f64 = 1e-3;
const PIN_HEIGHT_M: f64 = 0.16;
const BALL_M: f64 = 0.046;
/// A round on the path of a tool, ticks.
const PATH_TICKS: usize = 1000;
/// Percentiles want so many queries at least, and so much time, s.
const QUERIES_MIN: usize = 3 * PATH_TICKS;
const MEASURED_S: f64 = 0.2;
const MODES: [TraversalMode; 2] = [TraversalMode::Flat, TraversalMode::Tree];
const SHARES: [f64; 3] = [0.0, 0.01, 0.03];

pub(super) fn name(mode: TraversalMode) -> &'static str {
    match mode {
        TraversalMode::Flat => "flat",
        TraversalMode::Tree => "tree",
    }
}

pub(super) fn rows(options: &Options, tell: &mut dyn FnMut(&str)) -> Result<Vec<Row>, BenchError> {
    let mut rows = Vec::new();
    for fit in [Fit::PinInBore, Fit::BallOnSlab] {
        rows.extend(points_and_share(fit, options, tell)?);
    }
    rows.extend(triangles(options, tell)?);
    Ok(rows)
}

/// What touches what.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Fit {
    /// A pin that is nowhere farther from its bore than the band: no point may be passed over
    /// unseen. The worst of a tree.
    PinInBore,
    /// A ball on a slab: contact in one place, and most of the tool far from it.
    BallOnSlab,
}

impl Fit {
    fn name(self) -> &'static str {
        match self {
            Self::PinInBore => "pin in a bore, all points within the band",
            Self::BallOnSlab => "ball on a slab",
        }
    }

    fn obstacle(self) -> Result<Obstacle, BenchError> {
        match self {
            Self::PinInBore => fixture::obstacle("the bore", &bore([1, 1]).mesh(), VOXEL_M, false),
            Self::BallOnSlab => {
                let slab = Shape::Plane { x_m: 0.2, y_m: 0.2, thickness_m: 0.02 };
                fixture::obstacle("the slab", &fixture::tessellated(slab, VOXEL_M), VOXEL_M, false)
            }
        }
    }

    /// With about so many points.
    fn tool(self, n_points: f64) -> Result<Shell, BenchError> {
        let (shape, area_m2) = match self {
            Self::PinInBore => {
                let radius_m = BORE_M - GAP_M;
                (
                    Shape::Cylinder { radius_m, height_m: PIN_HEIGHT_M },
                    TAU * radius_m * (PIN_HEIGHT_M + radius_m),
                )
            }
            Self::BallOnSlab => (Shape::Sphere { radius_m: BALL_M }, 2.0 * TAU * BALL_M * BALL_M),
        };
        // Of the kind that scenes have by default.
        let shell = |voxel_size_m: f64| {
            fixture::shell_of(
                self.name(),
                &fixture::tessellated(shape, voxel_size_m),
                voxel_size_m,
                Points::default(),
            )
        };
        // How many facets a voxel of area has depends on the part: the second size meets the
        // number.
        let guess_m = (area_m2 / n_points).sqrt();
        shell(guess_m * (shell(guess_m)?.len() as f64 / n_points).sqrt())
    }

    /// The path of a tool that has been moved so far towards the wall.
    fn path(self, towards_m: f64) -> impl Iterator<Item = Pose> + Clone {
        (0..PATH_TICKS).map(move |tick| {
            let angle = TAU * tick as f64 / PATH_TICKS as f64;
            match self {
                Self::PinInBore => {
                    let aside = DVec3::new(0.8, 0.6, 0.0) * towards_m;
                    Pose::new(
                        DQuat::from_rotation_z(0.16 * angle.sin()),
                        aside + DVec3::Z * (8e-3 * angle.sin()),
                    )
                }
                Self::BallOnSlab => {
                    let about = DVec3::new(0.3, 0.5, 0.8).normalize() * (0.16 * angle.sin());
                    let around = DVec3::new(angle.cos(), angle.sin(), 0.0) * 8e-3;
                    Pose::new(
                        DQuat::from_scaled_axis(about),
                        around + DVec3::Z * (BALL_M - towards_m),
                    )
                }
            }
        })
    }

    /// The path on which this share of the points touches; half a gap or a voxel and a half away
    /// for none.
    fn path_at(self, obstacles: &[Obstacle], shell: &Shell, share: f64) -> Vec<Pose> {
        let (free_m, mut low_m, mut high_m) = match self {
            Self::PinInBore => (0.5 * GAP_M, 0.5 * GAP_M, 2.0 * GAP_M),
            Self::BallOnSlab => (-1.5 * VOXEL_M, -VOXEL_M, 0.2 * BALL_M),
        };
        if share > 0.0 {
            let mut asking = Asking::new(TraversalMode::Flat, obstacles, shell);
            for _ in 0..20 {
                let middle_m = 0.5 * (low_m + high_m);
                let touching = asking.mean_contacts(self.path(middle_m));
                if touching < share * shell.len() as f64 {
                    low_m = middle_m
                } else {
                    high_m = middle_m
                }
            }
        }
        self.path(if share > 0.0 { high_m } else { free_m }).collect()
    }
}

fn bore(pieces: [usize; 2]) -> Tube {
    // As long as the pin and a band more on both sides, thicker than two bands.
    let sides = Tube::sides_for(BORE_M, VOXEL_M);
    Tube {
        inner_m: BORE_M,
        outer_m: BORE_M + 30.0 * VOXEL_M,
        height_m: PIN_HEIGHT_M + 60.0 * VOXEL_M,
        sides,
        pieces,
    }
}

/// Contact queries one after the other.
pub(super) struct Asking<'a> {
    obstacles: &'a [Obstacle],
    shell: &'a Shell,
    traversal: Traversal,
}

impl<'a> Asking<'a> {
    pub(super) fn new(mode: TraversalMode, obstacles: &'a [Obstacle], shell: &'a Shell) -> Self {
        Self {
            obstacles,
            shell,
            traversal: Traversal::new(SimdLevel::best(), mode, obstacles, shell),
        }
    }

    pub(super) fn ask(&mut self, pose: Pose) -> ContactSum {
        ContactSum::of(
            &mut self.traversal,
            self.obstacles,
            self.shell,
            pose,
            contact(FieldKind::Trilinear),
            None,
        )
    }

    /// Points in contact on some of the poses of a path, mean: facets of a round part come and go.
    fn mean_contacts(&mut self, path: impl Iterator<Item = Pose>) -> f64 {
        let mut sum = 0.0;
        let mut n = 0.0;
        for pose in path.step_by(PATH_TICKS / 8) {
            sum += f64::from(self.ask(pose).contacts);
            n += 1.0;
        }
        sum / f64::max(n, 1.0)
    }

    /// Times of queries along a path by a clock in ns, sorted, µs.
    pub(super) fn times_us(
        &mut self,
        path: &[Pose],
        clock_ns: fn() -> i64,
        options: &Options,
    ) -> Vec<f64> {
        let (n_queries, long_s) =
            if options.quick { (64, 0.01) } else { (QUERIES_MIN, MEASURED_S) };
        let mut times_us = Vec::with_capacity(n_queries);
        let mut spent_us = 0.0;
        for pose in path.iter().cycle() {
            if times_us.len() >= n_queries && spent_us >= 1e6 * long_s {
                break;
            }
            let begin_ns = clock_ns();
            black_box(self.ask(black_box(*pose)));
            let time_us = (clock_ns() - begin_ns) as f64 * 1e-3;
            spent_us += time_us;
            times_us.push(time_us);
        }
        times_us.sort_by(f64::total_cmp);
        times_us
    }
}

/// Median and p99.9 of queries along a path: medians of some runs, µs.
fn percentiles_us(
    mode: TraversalMode,
    obstacles: &[Obstacle],
    shell: &Shell,
    path: &[Pose],
    options: &Options,
) -> [f64; 2] {
    let mut asking = Asking::new(mode, obstacles, shell);
    let runs: Vec<Vec<f64>> =
        (0..options.n_runs).map(|_| asking.times_us(path, thread_cpu_ns, options)).collect();
    [0.5, 0.999].map(|share| {
        let of_runs: Vec<f64> =
            runs.iter().filter_map(|times_us| quantile(times_us, share)).collect();
        median(&of_runs).unwrap_or_default()
    })
}

/// Poses of a path at which the tree gives another wrench than the flat sum, in any bit.
fn n_different(obstacles: &[Obstacle], shell: &Shell, path: &[Pose]) -> usize {
    let [mut flat, mut tree] = MODES.map(|mode| Asking::new(mode, obstacles, shell));
    let bits = |sum: &ContactSum| {
        (
            sum.contacts,
            sum.wrench.force.to_array().map(f64::to_bits),
            sum.wrench.torque.to_array().map(f64::to_bits),
        )
    };
    path.iter().filter(|pose| bits(&flat.ask(**pose)) != bits(&tree.ask(**pose))).count()
}

/// Mean error of the force when each query of a path may look at half of what it takes, as a share
/// of the mean force.
fn error_with_half(obstacles: &[Obstacle], shell: &Shell, path: &[Pose]) -> f64 {
    let [mut whole, mut half] =
        [TraversalMode::Tree; 2].map(|mode| Asking::new(mode, obstacles, shell));
    let mut error = 0.0;
    let mut force = 0.0;
    for pose in path {
        let sum = whole.ask(*pose);
        half.traversal.set_budget(Budget::Points(sum.looked_at / 2));
        error += (half.ask(*pose).wrench.force - sum.wrench.force).length();
        force += sum.wrench.force.length();
    }
    error / force.max(f64::MIN_POSITIVE)
}

fn points_and_share(
    fit: Fit,
    options: &Options,
    tell: &mut dyn FnMut(&str),
) -> Result<Vec<Row>, BenchError> {
    let obstacles = [fit.obstacle()?];
    let sizes: &[f64] = if options.quick { &[8e3] } else { &[8e3, 1e5, 1e6] };
    let mut rows = Vec::new();
    for wanted in sizes {
        let shell = fit.tool(*wanted)?;
        let is_paper = *wanted == 8e3;
        let is_million = *wanted == 1e6;
        let group = format!("{}: {} points, trilinear", fit.name(), shell.len());
        for share in SHARES {
            tell(&format!("{}: {} points, {} % touching", fit.name(), shell.len(), 100.0 * share));
            let path = fit.path_at(&obstacles, &shell, share);
            let touching = Asking::new(TraversalMode::Flat, &obstacles, &shell)
                .mean_contacts(path.iter().copied());
            let percent = format!("{} % touching", 100.0 * share);
            for mode in MODES {
                let [median_us, p999_us] = percentiles_us(mode, &obstacles, &shell, &path, options);
                let row = |what: &str, value: f64, unit| {
                    Row::new(&group, format!("{}, {percent}: {what}", name(mode)), value, unit)
                };
                let whole = row("one query, median", median_us, "µs");
                let slow = row("one query, p99.9", p999_us, "µs");
                let per_point = row("for one point", 1e3 * median_us / shell.len() as f64, "ns");
                rows.extend(match (fit, mode) {
                    (_, TraversalMode::Flat) if is_paper => {
                        [whole.beside_paper(1000.0).at_most(16.0), slow, per_point]
                    }
                    (_, TraversalMode::Flat) if is_million => [whole, slow, per_point.at_most(1.2)],
                    (Fit::BallOnSlab, TraversalMode::Tree) if is_million => {
                        [whole.at_most(150.0), slow.at_most(300.0), per_point]
                    }
                    _ => [whole, slow, per_point],
                });
                rows.push(row("points in contact", touching, ""));
            }
            if share > 0.0 {
                let error = error_with_half(&obstacles, &shell, &path);
                let row = Row::new(
                    &group,
                    format!("tree, {percent}: error of the force at half the budget"),
                    100.0 * error,
                    "%",
                );
                rows.push(row.at_most(10.0));
            }
            let n_poses = if is_million { 50 } else { path.len() };
            let n_different = n_different(&obstacles, &shell, &path[..n_poses.min(path.len())]);
            rows.push(
                Row::new(
                    &group,
                    format!("{percent}: poses at which tree and flat differ"),
                    n_different as f64,
                    "",
                )
                .at_most(0.0),
            );
        }
    }
    Ok(rows)
}

/// The same bore cut into few and into many triangles.
fn triangles(options: &Options, tell: &mut dyn FnMut(&str)) -> Result<Vec<Row>, BenchError> {
    let fit = Fit::PinInBore;
    let shell = fit.tool(if options.quick { 8e3 } else { 1e5 })?;
    let group =
        format!("pin of {} points in the same bore, cut into few and many triangles", shell.len());
    let sides = bore([1, 1]).sides;
    // Two triangles for each piece around and each step of the profile.
    let pieces = |n_triangles: usize, around: usize| {
        [around, (n_triangles / (4 * sides * around)).max(2) - 1]
    };
    let few = pieces(10_000, 1);
    let many = if options.quick { pieces(100_000, 2) } else { pieces(3_000_000, 8) };
    let mut bake = |pieces| {
        let mesh = bore(pieces).mesh();
        tell(&format!("bore of {} triangles", mesh.triangles.len()));
        fixture::obstacle("the bore", &mesh, VOXEL_M, false)
            .map(|obstacle| (mesh.triangles.len(), [obstacle]))
    };
    let baked = [bake(few)?, bake(many)?];
    let mut rows = Vec::new();
    for mode in MODES {
        let path = fit.path_at(&baked[0].1, &shell, 0.03);
        // In turn, so that a busy moment of the machine meets both.
        let mut times_us = [Vec::new(), Vec::new()];
        let mut asking =
            baked.each_ref().map(|(_, obstacles)| Asking::new(mode, obstacles, &shell));
        for _ in 0..2 * options.n_runs.max(2) {
            for (asking, times_us) in asking.iter_mut().zip(&mut times_us) {
                times_us.extend(median(&asking.times_us(&path, thread_cpu_ns, options)));
            }
        }
        let medians = times_us.map(|times_us| median(&times_us).unwrap_or_default());
        for ((n, _), median_us) in baked.iter().zip(medians) {
            rows.push(Row::new(
                &group,
                format!("{}, {n} triangles: one query, median", name(mode)),
                median_us,
                "µs",
            ));
        }
        let more = medians[1] / medians[0] - 1.0;
        rows.push(
            Row::new(
                &group,
                format!("{}: more time with many triangles, share", name(mode)),
                more,
                "",
            )
            .within(0.1),
        );
    }
    Ok(rows)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_of_a_budget_errs_by_less_than_a_tenth() {
        for fit in [Fit::PinInBore, Fit::BallOnSlab] {
            let obstacles = [fit.obstacle().unwrap()];
            let shell = fit.tool(8e3).unwrap();
            for share in SHARES.into_iter().filter(|share| *share > 0.0) {
                let error =
                    error_with_half(&obstacles, &shell, &fit.path_at(&obstacles, &shell, share));
                assert!(error > 0.0 && error < 0.1, "{}, {share}: {error}", fit.name());
            }
        }
    }

    #[test]
    fn shares_are_met_on_the_path_and_both_ways_agree() {
        for fit in [Fit::PinInBore, Fit::BallOnSlab] {
            let obstacles = [fit.obstacle().unwrap()];
            let shell = fit.tool(8e3).unwrap();
            assert!((shell.len() as f64 / 8e3 - 1.0).abs() < 0.3, "{} points", shell.len());
            for share in SHARES {
                let path = fit.path_at(&obstacles, &shell, share);
                let found = Asking::new(TraversalMode::Flat, &obstacles, &shell)
                    .mean_contacts(path.iter().copied())
                    / shell.len() as f64;
                assert!(
                    (found == 0.0) == (share == 0.0) && (found - share).abs() < 0.01,
                    "{fit:?}, {share}: {found}"
                );
                assert_eq!(n_different(&obstacles, &shell, &path), 0, "{fit:?}, {share}");
            }
        }
    }
}
