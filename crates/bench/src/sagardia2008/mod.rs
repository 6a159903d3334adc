//! The tables and plots of the paper of 2008, measured anew in one run: what its page holds.
//!
//! Everything runs on one thread, so that a ratio compares ways and not how they share work;
//! seconds are processor time of that thread. What is compared runs in turn. [`Figures`] is what
//! was found, [`page()`] the page of it, [`draw_models`] what it was found of.
//!
//! # Source
//! Sagardia2008, section 5: table 1, figures 6 and 7, remarks 1 to 3; section 4 for the two ways of
//! projection.

mod page;
mod picture;
mod points;
mod projection;
mod query;
mod spacing;
mod voxels;

pub use page::page;
pub use picture::draw_models;
pub use points::{Phases, Points};
pub use projection::Projections;
pub use query::Query;
pub use spacing::{SHARES, Spacing};
pub use voxels::{Marking, Step};

use rt::clock::thread_cpu_ns;

use super::export::{TemporaryFolder, write_stl};
use super::stand_ins::StandIn;
use super::statistics::median;
use super::table1::{POINTSHELLS, VOXMAPS, crossover_voxels};
use super::{BenchError, Row};
use vps::mesh;

/// What to measure.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Runs of everything; figures are medians.
    pub n_runs: usize,
    /// The bracket with large voxels only: seconds instead of minutes.
    pub quick: bool,
}

/// What was found.
#[derive(Clone, Debug)]
pub struct Figures {
    /// Runs of everything.
    pub n_runs: usize,
    /// Seconds to read each model.
    pub load_s: Vec<(StandIn, f64)>,
    /// By model, from coarse to fine.
    pub steps: Vec<Step>,
    /// Both ways of projection on triangles and points that know nothing of each other.
    pub projections: Projections,
}

/// Seed of the stand-ins and of random triangles: every run measures the same ones.
const SEED: u64 = 2008;

/// Edge of a voxel with which the car's grid has the 4.59·10⁸ voxels of remark 3.
const LANDING_GEAR_MM: f64 = 2.28;
/// Triangles, voxels and seconds of remark 3, of its reference [10].
const LANDING_GEAR: [f64; 3] = [2.76e6, 4.59e8, 1353.0];

/// Voxel sizes, mm: those of table 1 and remark 3, and others between and above them, for the
/// curves.
const SWEEPS: [(StandIn, &[f64]); 3] = [
    (StandIn::Bracket, &[16.0, 8.0, 4.0, 2.0, 1.0, 0.5]),
    (StandIn::Brake, &[12.0, 6.0, 3.0, 1.5, 1.0, 0.5]),
    (StandIn::Car, &[80.0, 40.0, 20.0, 10.0, 5.0, LANDING_GEAR_MM, 2.0]),
];

/// Measures. `tell` is called with each step.
///
/// Needs the size of the stand-ins (about 155 MB) in the temporary folder. Cost: some minutes.
///
/// # Errors
/// A temporary folder that cannot be written, or a stand-in that cannot be read or baked.
pub fn run(options: Options, mut tell: impl FnMut(&str) + Send) -> Result<Figures, BenchError> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    let pool = pool.map_err(|error| BenchError::Prepare {
        what: "a pool of one thread".to_owned(),
        why: error.to_string(),
    })?;
    // The pool's thread does all the work, that of this function too: its processor time is that of
    // the work.
    pool.install(|| measure(options, &mut tell))
}

fn measure(options: Options, tell: &mut dyn FnMut(&str)) -> Result<Figures, BenchError> {
    let folder = TemporaryFolder::create()
        .map_err(|source| BenchError::Write { path: std::env::temp_dir(), source })?;
    let sweeps =
        if options.quick { &[(StandIn::Bracket, &[16.0, 8.0][..])][..] } else { &SWEEPS[..] };
    let mut load_s = Vec::new();
    let mut steps = Vec::new();
    for (stand_in, sizes_mm) in sweeps {
        tell(&format!("making the {}", stand_in.name()));
        let path = folder.path().join(stand_in.name()).with_extension("stl");
        write_stl(&path, &stand_in.mesh(SEED))
            .map_err(|source| BenchError::Write { path: path.clone(), source })?;
        let refused = |why: String| BenchError::Prepare { what: path.display().to_string(), why };
        let mut seconds = Vec::new();
        let mut loaded = None;
        for _ in 0..options.n_runs {
            let (mesh, mesh_s) = timed(|| mesh::load(&path, 1e-3));
            loaded = Some(mesh.map_err(|error| refused(error.to_string()))?);
            seconds.push(mesh_s);
        }
        let Some(mesh) = loaded else { continue };
        load_s.extend(median(&seconds).map(|seconds| (*stand_in, seconds)));
        for size_mm in *sizes_mm {
            steps.push(voxels::step(*stand_in, &mesh, *size_mm, options, tell)?);
        }
    }
    tell("both ways of projection");
    Ok(Figures { n_runs: options.n_runs, load_s, steps, projections: projection::measure(options) })
}

/// What a piece of work gives, and the processor time of this thread that it takes, s.
fn timed<T>(work: impl FnOnce() -> T) -> (T, f64) {
    let begin_ns = thread_cpu_ns();
    let result = work();
    (result, (thread_cpu_ns() - begin_ns) as f64 * 1e-9)
}

impl Figures {
    /// The step of a case of table 1.
    fn step(&self, stand_in: StandIn, size_mm: f64) -> Option<&Step> {
        self.steps
            .iter()
            .find(|step| step.stand_in == stand_in && step.size_mm.total_cmp(&size_mm).is_eq())
    }

    fn load_s(&self, stand_in: StandIn) -> Option<f64> {
        self.load_s.iter().find(|(of, _)| *of == stand_in).map(|(_, seconds)| *seconds)
    }

    /// The models that were measured, and their steps.
    pub fn models(&self) -> impl Iterator<Item = (StandIn, Vec<&Step>)> {
        let of = |stand_in: StandIn| {
            self.steps.iter().filter(|step| step.stand_in == stand_in).collect::<Vec<_>>()
        };
        StandIn::ALL
            .into_iter()
            .map(move |stand_in| (stand_in, of(stand_in)))
            .filter(|(_, steps)| !steps.is_empty())
    }

    /// Δ of the paper for a model: the letter of a case of table 1, voxels in our grid, t_old /
    /// t_new. Cases that were not measured are left out.
    pub fn paper_voxmap_deltas(&self, stand_in: StandIn) -> Vec<(char, f64, f64)> {
        let cases = VOXMAPS.iter().filter(|case| case.stand_in == stand_in);
        cases
            .filter_map(|case| {
                Some((case.name, self.step(stand_in, case.size_mm)?.voxels as f64, case.delta()))
            })
            .collect()
    }

    /// As [`Self::paper_voxmap_deltas`] for pointshells, with the paper's points last.
    pub fn paper_pointshell_deltas(&self, stand_in: StandIn) -> Vec<(char, f64, f64, f64)> {
        let cases = POINTSHELLS.iter().filter(|case| case.stand_in == stand_in);
        let place = |size_mm| Some(self.step(stand_in, size_mm)?.voxels as f64);
        cases
            .filter_map(|case| Some((case.name, place(case.size_mm)?, case.delta(), case.points)))
            .collect()
    }

    /// The figures one to a line.
    pub fn rows(&self) -> Vec<Row> {
        let mut rows = Vec::new();
        for (stand_in, seconds) in &self.load_s {
            rows.push(Row::new("paper of 2008: load", stand_in.name(), *seconds, "s"));
        }
        for step in &self.steps {
            let group = format!(
                "paper of 2008: {} at {} mm, {} voxels",
                step.stand_in.name(),
                step.size_mm,
                step.voxels
            );
            rows.extend(step.rows(&group));
        }
        for (stand_in, steps) in self.models() {
            let found = crossover_voxels_of(&steps);
            let name = found.map_or(
                "the second navigation is never the faster one",
                |_| "the second navigation is faster from here on",
            );
            let row = Row::new(
                &format!("paper of 2008: crossover, {}", stand_in.name()),
                name,
                found,
                "voxels",
            );
            rows.push(Row { paper: Some(crossover_voxels(stand_in)), ..row });
        }
        rows.extend(self.projections.rows());
        rows
    }
}

/// The fewest voxels of a sweep from which on the second navigation is the faster one at every
/// finer size.
fn crossover_voxels_of(steps: &[&Step]) -> Option<f64> {
    steps
        .iter()
        .rev()
        .take_while(|step| step.is_second_faster())
        .last()
        .map(|step| step.voxels as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_crossover_holds_to_the_end_of_the_sweep() {
        let at = |swept: &[(u64, f64, f64)]| {
            let marked = |seconds: f64| Marking { runs_s: vec![seconds], tests: 1 };
            let step = |(voxels, plane_span_s, two_sided_s): &(u64, f64, f64)| Step {
                voxels: *voxels,
                plane_span: marked(*plane_span_s),
                two_sided: marked(*two_sided_s),
                ..Step::of(StandIn::Bracket, 1.0)
            };
            let steps: Vec<Step> = swept.iter().map(step).collect();
            crossover_voxels_of(&steps.iter().collect::<Vec<_>>())
        };
        assert_eq!(at(&[(1, 1.0, 2.0), (2, 2.0, 1.0), (3, 3.0, 2.0)]), Some(2.0));
        assert_eq!(at(&[(1, 2.0, 1.0), (2, 1.0, 2.0), (3, 3.0, 2.0)]), Some(3.0));
        assert_eq!(at(&[(1, 2.0, 1.0), (2, 1.0, 2.0)]), None);
        assert_eq!(at(&[]), None);
    }

    #[test]
    fn every_case_of_the_table_is_a_step_of_a_sweep() {
        let is_swept = |stand_in, size_mm: f64| {
            let sizes_mm =
                SWEEPS.iter().filter(|(of, _)| *of == stand_in).flat_map(|(_, sizes_mm)| *sizes_mm);
            sizes_mm.copied().any(|of| of.total_cmp(&size_mm).is_eq())
        };
        assert!(VOXMAPS.iter().all(|case| is_swept(case.stand_in, case.size_mm)));
        assert!(POINTSHELLS.iter().all(|case| is_swept(case.stand_in, case.size_mm)));
    }
}
