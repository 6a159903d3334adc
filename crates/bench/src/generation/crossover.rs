//! From how many voxels on does the two-sided navigation pay?
//!
//! # Source
//! Sagardia2008, section 5: crossovers of 1.98·10⁸ voxels (Artificial), 6.1·10⁷ (brake) and 4.66·10⁷ (Polo).

use std::time::Instant;

use super::super::stand_ins::StandIn;
use super::super::statistics::median;
use super::super::{BenchError, Row};
use super::{Bench, SEED};
use vps::voxmap::grid::Grid;
use vps::voxmap::surface::{Navigation, Surface};

/// Voxel sizes from coarse to the finest of the paper.
const SWEEPS: [(StandIn, [f64; 6], f64); 2] =
    [(StandIn::Bracket, [16.0, 8.0, 4.0, 2.0, 1.0, 0.5], 1.98e8), (StandIn::Brake, [16.0, 8.0, 4.0, 2.0, 1.0, 0.5], 6.1e7)];

/// Seconds and SAT tests of one navigation.
struct Marked {
    seconds: f64,
    sat_tests: u64,
}

/// The surface stage alone, in this process, the two navigations in turn.
pub(super) fn rows(bench: &mut Bench<'_>) -> Result<Vec<Row>, BenchError> {
    let (sweeps, n_sizes) = if bench.options.quick { (&SWEEPS[..1], 2) } else { (&SWEEPS[..], 6) };
    let n_runs = bench.options.n_runs;
    let mut rows = Vec::new();
    for (stand_in, sizes_mm, paper_voxels) in sweeps {
        let mesh = stand_in.mesh(SEED);
        let (low, high) = mesh.bounds().unwrap_or_default();
        let group = format!("crossover: {}, surface stage", stand_in.name());
        let mut swept = Vec::new();
        for size_mm in &sizes_mm[..n_sizes] {
            let Ok(grid) = Grid::around(low, high, size_mm * 1e-3, 1) else { continue };
            (bench.tell)(&format!("{group} at {size_mm} mm"));
            let mut seconds = [Vec::new(), Vec::new()];
            let mut sat_tests = [0; 2];
            for _ in 0..n_runs {
                for (idx, navigation) in [Navigation::PlaneSpan, Navigation::TwoSided].into_iter().enumerate() {
                    let since = Instant::now();
                    sat_tests[idx] = Surface::mark(&mesh, &grid, navigation).sat_tests;
                    seconds[idx].push(since.elapsed().as_secs_f64());
                }
            }
            let marked = |idx: usize| Some(Marked { seconds: median(&seconds[idx])?, sat_tests: sat_tests[idx] });
            let (Some(span), Some(two_sided)) = (marked(0), marked(1)) else { continue };
            let voxels = grid.n_cells();
            for (name, marked) in [("plane-span", &span), ("two-sided", &two_sided)] {
                rows.push(Row::new(&group, format!("{name} at {size_mm} mm, {voxels} voxels"), marked.seconds, "s"));
                rows.push(Row::new(&group, format!("{name} at {size_mm} mm"), marked.sat_tests as f64, "SAT tests"));
            }
            swept.push((voxels as f64, span.seconds, two_sided.seconds));
        }
        rows.push(crossover_row(&group, &swept, *paper_voxels));
    }
    Ok(rows)
}

/// The fewest voxels of the sweep from which on two-sided is the faster one at every finer size.
fn crossover_row(group: &str, swept: &[(f64, f64, f64)], paper_voxels: f64) -> Row {
    let faster = swept.iter().rev().take_while(|(_, span_s, two_sided_s)| two_sided_s < span_s).last();
    let name = match faster {
        Some(_) => "two-sided is faster from here on".to_owned(),
        None => format!("two-sided is never faster, up to {:.0} voxels", swept.last().map_or(0.0, |step| step.0)),
    };
    Row { paper: Some(paper_voxels), ..Row::new(group, name, faster.map(|(voxels, ..)| *voxels), "voxels") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_crossover_holds_to_the_end_of_the_sweep() {
        let at = |swept: &[(f64, f64, f64)]| crossover_row("x", swept, 1.0).value;
        assert_eq!(at(&[(1.0, 1.0, 2.0), (2.0, 2.0, 1.0), (3.0, 3.0, 2.0)]), Some(2.0));
        assert_eq!(at(&[(1.0, 2.0, 1.0), (2.0, 1.0, 2.0), (3.0, 3.0, 2.0)]), Some(3.0));
        assert_eq!(at(&[(1.0, 2.0, 1.0), (2.0, 1.0, 2.0)]), None);
        assert_eq!(at(&[]), None);
    }
}
