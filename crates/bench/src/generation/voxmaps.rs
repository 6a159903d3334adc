//! Cases (a) to (e): voxmaps of the paper's three models.
//!
//! # Source
//! Sagardia2008, Table 1 (Intel D, 3.4 GHz, one core presumably): load, initialise, generate (new method), fill.

use super::super::process::{Bakes, Resolution, STAGES};
use super::super::stand_ins::StandIn;
use super::super::{BenchError, Row};
use super::Bench;

/// A row of the table.
struct Case {
    name: char,
    stand_in: StandIn,
    size_mm: f64,
    voxels: f64,
    /// Seconds of the paper: load, initialise, generate, fill.
    paper_s: [f64; 4],
}

const CASES: [Case; 5] = {
    use StandIn::{Bracket, Brake, Car};
    [
        Case { name: 'a', stand_in: Bracket, size_mm: 0.5, voxels: 237_717_488.0, paper_s: [0.119_0, 1.185_6, 16.562, 2.342_3] },
        Case { name: 'b', stand_in: Brake, size_mm: 1.0, voxels: 38_524_026.0, paper_s: [0.395_4, 0.191_9, 3.614, 0.499_4] },
        Case { name: 'c', stand_in: Brake, size_mm: 0.5, voxels: 302_685_600.0, paper_s: [0.395_4, 1.511_2, 15.684, 3.751_2] },
        Case { name: 'd', stand_in: Car, size_mm: 5.0, voxels: 44_311_554.0, paper_s: [18.972, 0.229_0, 69.179, 0.699_2] },
        Case { name: 'e', stand_in: Car, size_mm: 2.0, voxels: 680_652_000.0, paper_s: [18.972, 3.618_8, 442.29, 9.948_6] },
    ]
};

/// In a quick run: a size at which the bracket takes no time; no figure of the paper is for it.
const QUICK_SIZE_MM: f64 = 8.0;

pub(super) fn rows(bench: &mut Bench<'_>) -> Result<Vec<Row>, BenchError> {
    let mut rows = Vec::new();
    if bench.options.quick {
        let mesh = bench.stand_in(StandIn::Bracket)?;
        for navigation in ["plane-span", "two-sided"] {
            let group = format!("voxmap: bracket at {QUICK_SIZE_MM} mm, {navigation}");
            let bakes = bench.bake(&group, &mesh, Resolution::SizeMm(QUICK_SIZE_MM), Some(navigation))?;
            rows.extend(figures(&group, &bakes, None));
        }
        return Ok(rows);
    }
    for case in &CASES {
        let mesh = bench.stand_in(case.stand_in)?;
        for navigation in ["plane-span", "two-sided"] {
            let group = format!("voxmap {}: {} at {} mm, {navigation}", case.name, case.stand_in.name(), case.size_mm);
            let bakes = bench.bake(&group, &mesh, Resolution::SizeMm(case.size_mm), Some(navigation))?;
            rows.extend(figures(&group, &bakes, Some(case)));
        }
    }
    Ok(rows)
}

/// Everything that is known of one case. "Generate" is the surface stage; the paper has no layers, distances, points or tree here.
fn figures(group: &str, bakes: &Bakes, case: Option<&Case>) -> Vec<Row> {
    let beside = |row: Row, paper: fn(&Case) -> f64| match case {
        Some(case) => row.beside_paper(paper(case)),
        None => row,
    };
    // Counts are facts, not speeds: they have no ratio.
    let counted = |row: Row, paper: fn(&Case) -> f64| Row { paper: case.map(paper), ..row };
    let [nx, ny, nz] = bakes.dims_padded_by_one().unwrap_or_default();
    let mut rows = vec![
        counted(Row::new(group, "triangles", bakes.count("triangles"), ""), |case| case.stand_in.paper_triangles() as f64),
        counted(Row::new(group, format!("voxels of {nx} x {ny} x {nz}, padded by one"), (nx * ny * nz) as f64, ""), |case| {
            case.voxels
        }),
        Row::new(group, "voxels with our padding", bakes.count("voxels"), ""),
        Row::new(group, "SAT tests", bakes.count("sat_tests"), ""),
        Row::new(group, "points, one per surface voxel", bakes.count("points"), ""),
        Row::new(group, "points of phase 2", phase_2_percent(bakes), "%"),
    ];
    let watertight = bakes.is("watertight").map(|is| f64::from(u8::from(is)));
    let thin = if bakes.text("sides") == Some("thin") { "; mostly thinner than its voxels, so a skin" } else { "" };
    rows.push(Row::new(group, format!("watertight (1 yes, 0 no){thin}"), watertight, ""));
    for stage in STAGES {
        let Some(seconds) = bakes.stage_s(stage) else { continue };
        let row = Row::new(group, if stage == "surface" { "generate" } else { stage }, seconds, "s");
        rows.push(match stage {
            "load" => beside(row, |case| case.paper_s[0]),
            "init" => beside(row, |case| case.paper_s[1]),
            "surface" => beside(row, |case| case.paper_s[2]),
            "fill" => beside(row, |case| case.paper_s[3]),
            _ => row,
        });
    }
    let compared = Row::new(group, "init + generate + fill", bakes.sum_s(&["init", "surface", "fill"]), "s");
    let with_load = Row::new(group, "load + init + generate + fill", bakes.sum_s(&["load", "init", "surface", "fill"]), "s");
    let with_load = beside(with_load, |case| case.paper_s.iter().sum());
    let largest = case.is_some_and(|case| case.name == 'e');
    if case.is_some() {
        rows.push(beside(compared, |case| case.paper_s[1..].iter().sum()).at_least_times(100.0));
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
