//! Cases (f) to (j): pointshells of the paper's three models.
//!
//! # Source
//! Sagardia2008, Table 1: points and seconds of the new method. Their growth is about quadratic;
//! ours has to be linear (acceptance test 8).

use super::super::process::Resolution;
use super::super::statistics::growth_exponent;
use super::super::table1::{POINTSHELLS, PointshellCase};
use super::super::{BenchError, Row};
use super::Bench;

pub(super) fn rows(bench: &mut Bench<'_>) -> Result<Vec<Row>, BenchError> {
    let cases = if bench.options.quick { &POINTSHELLS[..1] } else { &POINTSHELLS[..] };
    let mut rows = Vec::new();
    let mut growth = Vec::new();
    for PointshellCase { name, stand_in, size_mm, points: paper_points, new_s: paper_s, .. } in
        cases
    {
        let group = format!("pointshell {name}: {} at {size_mm} mm", stand_in.name());
        let mesh = bench.stand_in(*stand_in)?;
        let bakes = bench.bake(&group, &mesh, Resolution::SizeMm(*size_mm), None)?;
        let points = bakes.count("points");
        let seconds = bakes.sum_s(&["pointshell", "normals"]);
        let rate = points.zip(seconds).map(|(points, seconds)| points / seconds);
        growth.extend(points.zip(seconds));
        rows.push(Row { paper: Some(*paper_points), ..Row::new(&group, "points", points, "") });
        rows.push(Row::new(&group, "points and normals", seconds, "s").beside_paper(*paper_s));
        rows.push(
            Row {
                paper: Some(paper_points / paper_s),
                ..Row::new(&group, "rate", rate, "points/s")
            }
            .at_least(5e6),
        );
        rows.extend(bakes.stage_s("tree").map(|seconds| Row::new(&group, "tree", seconds, "s")));
    }
    let exponent = growth_exponent(&growth);
    let row = Row::new("pointshell: growth", "p of time ~ points^p over the cases", exponent, "");
    let paper = growth_exponent(&POINTSHELLS.map(|case| (case.points, case.new_s)));
    rows.push(Row { paper, ..row });
    Ok(rows)
}
