//! What halving the voxel size costs: time and memory, stage by stage (acceptance test 8).

use super::super::process::{Bakes, Resolution, STAGES};
use super::super::stand_ins::StandIn;
use super::super::statistics::growth_exponent;
use super::super::{BenchError, Row};
use super::Bench;

pub(super) fn rows(bench: &mut Bench<'_>) -> Result<Vec<Row>, BenchError> {
    let quick = bench.options.quick;
    // Four halvings. The bunny is scanned: triangles of one size, no face along an axis.
    let (name, mesh, steps) = match bench.bunny() {
        Ok(mesh) if !quick => {
            ("bunny", mesh, [64, 128, 256, 512, 1024].map(Resolution::LongestAxis))
        }
        _ => (
            "bracket",
            bench.stand_in(StandIn::Bracket)?,
            [8.0, 4.0, 2.0, 1.0, 0.5].map(Resolution::SizeMm),
        ),
    };
    let steps = if quick { &steps[..2] } else { &steps[..] };
    let mut baked = Vec::new();
    let mut rows = Vec::new();
    for step in steps {
        let group = match step {
            Resolution::SizeMm(size_mm) => format!("scaling: {name} at {size_mm} mm"),
            Resolution::LongestAxis(n) => {
                format!("scaling: {name}, {n} voxels on the longest axis")
            }
        };
        let bakes = bench.bake(&group, &mesh, *step, None)?;
        rows.push(Row::new(&group, "voxels", bakes.count("voxels"), ""));
        rows.push(Row::new(&group, "points", bakes.count("points"), ""));
        rows.extend(STAGES[1..].iter().filter_map(|stage| {
            Some(Row::new(
                &group,
                if *stage == "surface" { "generate" } else { stage },
                bakes.stage_s(stage)?,
                "s",
            ))
        }));
        rows.push(Row::new(&group, "all stages but load", generation_s(&bakes), "s"));
        rows.push(Row::new(&group, "peak memory", bakes.peak_mb(), "MB"));
        baked.push((group, bakes));
    }
    for pair in baked.windows(2) {
        let [(_, coarse), (group, fine)] = pair else { continue };
        let times = |of: &dyn Fn(&Bakes) -> Option<f64>| {
            of(fine).zip(of(coarse)).map(|(fine, coarse)| fine / coarse)
        };
        let group = format!("{group}, beside twice the size");
        rows.push(Row::new(&group, "voxels inside the padding", times(&inner_voxels), "times"));
        rows.push(Row::new(&group, "points", times(&|bakes| bakes.count("points")), "times"));
        rows.push(Row::new(&group, "time", times(&generation_s), "times").at_most(4.6));
        rows.push(Row::new(&group, "memory", times(&Bakes::peak_mb), "times").at_most(4.6));
    }
    let over_points: Vec<(f64, f64)> = baked
        .iter()
        .filter_map(|(_, bakes)| bakes.count("points").zip(generation_s(bakes)))
        .collect();
    let exponent = growth_exponent(&over_points);
    rows.push(
        Row::new(&format!("scaling: {name}, all sizes"), "p of time ~ points^p", exponent, "")
            .at_most(1.15),
    );
    Ok(rows)
}

/// Everything but reading the mesh, which does not depend on the voxel size.
fn generation_s(bakes: &Bakes) -> Option<f64> {
    bakes.sum_s(&STAGES[1..])
}

/// Voxels without the padding, which is a number of layers and not of metres.
fn inner_voxels(bakes: &Bakes) -> Option<f64> {
    bakes.dims_padded_by_one().map(|dims| dims.iter().map(|n| n.saturating_sub(2) as f64).product())
}
