//! Cases (a) to (e): voxmaps of the paper's three models.
//!
//! # Source
//! Sagardia2008, Table 1 (Intel D, 3.4 GHz, one core presumably): load, initialise, generate (new
//! method), fill.

use super::super::process::{Bakes, Resolution, STAGES};
use super::super::stand_ins::StandIn;
use super::super::table1::{VOXMAPS, VoxmapCase};
use super::super::{BenchError, Row};
use super::Bench;

/// In a quick run: a size at which the bracket takes no time; no figure of the paper is for it.
const QUICK_SIZE_MM: f64 = 8.0;

pub(super) fn rows(bench: &mut Bench<'_>) -> Result<Vec<Row>, BenchError> {
    let mut rows = Vec::new();
    if bench.options.quick {
        let mesh = bench.stand_in(StandIn::Bracket)?;
        for navigation in ["plane-span", "two-sided"] {
            let group = format!("voxmap: bracket at {QUICK_SIZE_MM} mm, {navigation}");
            let bakes =
                bench.bake(&group, &mesh, Resolution::SizeMm(QUICK_SIZE_MM), Some(navigation))?;
            rows.extend(figures(&group, &bakes, None));
        }
        return Ok(rows);
    }
    for case in &VOXMAPS {
        let mesh = bench.stand_in(case.stand_in)?;
        for navigation in ["plane-span", "two-sided", "auto"] {
            let group = format!(
                "voxmap {}: {} at {} mm, {navigation}",
                case.name,
                case.stand_in.name(),
                case.size_mm
            );
            let bakes =
                bench.bake(&group, &mesh, Resolution::SizeMm(case.size_mm), Some(navigation))?;
            rows.extend(figures(&group, &bakes, Some(case)));
        }
    }
    Ok(rows)
}

/// Everything that is known of one case. "Generate" is the surface stage; the paper has no layers,
/// distances, points or tree here.
fn figures(group: &str, bakes: &Bakes, case: Option<&VoxmapCase>) -> Vec<Row> {
    let beside = |row: Row, paper: fn(&VoxmapCase) -> f64| match case {
        Some(case) => row.beside_paper(paper(case)),
        None => row,
    };
    // Counts are facts, not speeds: they have no ratio.
    let counted = |row: Row, paper: fn(&VoxmapCase) -> f64| Row { paper: case.map(paper), ..row };
    let [nx, ny, nz] = bakes.dims_padded_by_one().unwrap_or_default();
    let mut rows = vec![
        counted(Row::new(group, "triangles", bakes.count("triangles"), ""), |case| {
            case.stand_in.paper_triangles() as f64
        }),
        counted(
            Row::new(
                group,
                format!("voxels of {nx} x {ny} x {nz}, padded by one"),
                (nx * ny * nz) as f64,
                "",
            ),
            |case| case.voxels,
        ),
        Row::new(group, "voxels with our padding", bakes.count("voxels"), ""),
        Row::new(group, "SAT tests", bakes.count("sat_tests"), ""),
        Row::new(group, "points, one per surface voxel", bakes.count("points"), ""),
        Row::new(group, "points of phase 2", phase_2_percent(bakes), "%"),
    ];
    let watertight = bakes.is("watertight").map(|is| f64::from(u8::from(is)));
    let thin = if bakes.text("sides") == Some("thin") {
        "; mostly thinner than its voxels, so a skin"
    } else {
        ""
    };
    rows.push(Row::new(group, format!("watertight (1 yes, 0 no){thin}"), watertight, ""));
    for stage in STAGES {
        let Some(seconds) = bakes.stage_s(stage) else { continue };
        let row =
            Row::new(group, if stage == "surface" { "generate" } else { stage }, seconds, "s");
        rows.push(match stage {
            "load" => beside(row, |case| case.load_s),
            "init" => beside(row, |case| case.init_s),
            "surface" => beside(row, |case| case.new_s),
            "fill" => beside(row, |case| case.fill_s),
            _ => row,
        });
    }
    let compared =
        Row::new(group, "init + generate + fill", bakes.sum_s(&["init", "surface", "fill"]), "s");
    let with_load = Row::new(
        group,
        "load + init + generate + fill",
        bakes.sum_s(&["load", "init", "surface", "fill"]),
        "s",
    );
    let with_load = beside(with_load, |case| case.load_s + case.init_s + case.new_s + case.fill_s);
    let largest = case.is_some_and(|case| case.name == 'e');
    if case.is_some() {
        rows.push(
            beside(compared, |case| case.init_s + case.new_s + case.fill_s).at_least_times(100.0),
        );
    } else {
        rows.push(compared);
    }
    rows.push(if largest { with_load.at_most(3.0) } else { with_load });
    rows.push(Row::new(group, "all stages", bakes.sum_s(&STAGES), "s"));
    rows.push(Row::new(group, "process, from start to end", bakes.wall_s(), "s"));
    rows.push(Row::new(group, "peak memory", bakes.peak_mb(), "MB"));
    rows
}

fn phase_2_percent(bakes: &Bakes) -> Option<f64> {
    Some(100.0 * bakes.count("phase2_points")? / bakes.count("points")?)
}
