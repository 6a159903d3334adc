//! What was baked, for people and as JSON.

use serde::Serialize;

use super::super::output;
use crate::config::SceneConfig;
use crate::scene::CacheUse;
use crate::scene::{self, ClayReport, ObjectReport};
use document::show;
use haptics::CouplingMode;
use vps::contact::Normalization;
use vps::pointshell::Points;
use vps::voxmap::accuracy::Accuracy;
use vps::voxmap::field::FieldKind;

/// One object, in one line of JSON with the keys in the order of the struct.
pub(in crate::cli) fn print_json(report: &impl Serialize) {
    match serde_json::to_string(report) {
        Ok(text) => output::result(format_args!("{text}\n")),
        // True invariant: numbers, names and flags, no map with odd keys.
        Err(error) => unreachable!("plain data: {error}"),
    }
}

/// An object's figures for people.
pub(in crate::cli) fn report_text(object: &ObjectReport) -> String {
    let [nx, ny, nz] = object.dims;
    let t = &object.timings_s;
    let mut lines = vec![
        format!("{} ({} triangles)", object.name, object.triangles),
        format!(
            "  grid        {nx} x {ny} x {nz} = {} voxels of {} mm",
            object.voxels,
            show(object.voxel_size_m * 1e3)
        ),
        format!(
            "  voxels      {} surface, {} inside, {} outside, {} layers, {}",
            object.surface_voxels,
            object.inside_voxels,
            object.outside_voxels,
            object.layers,
            if object.watertight { "watertight" } else { "leaking" }
        ),
        format!("  navigation  {}, {} SAT tests", object.navigation, object.sat_tests),
    ];
    if object.points > 0 {
        lines.push(format!(
            "  points      {} ({} phase 1, {} phase 2)",
            object.points, object.phase1_points, object.phase2_points
        ));
        let levels: Vec<String> =
            object.tree_levels.iter().map(|level| level.points.to_string()).collect();
        let leaf_mm =
            object.tree_levels.iter().rev().nth(1).map_or(0.0, |level| level.mean_radius_m * 1e3);
        lines.push(format!(
            "  tree        {} points by level, leaf spheres of {leaf_mm:.3} mm on average",
            levels.join(", ")
        ));
    }
    lines.extend(
        accuracy_text(&object.accuracy, object.voxel_size_m)
            .map(|text| format!("  accuracy    {text}")),
    );
    if object.cache == CacheUse::Hit {
        lines.push(format!("  seconds     {:.3} from the bake cache", t.load));
        lines.push(String::new());
        return lines.join("\n");
    }
    lines.push(format!(
        "  seconds     load {:.3}, surface {:.3}, fill {:.3}, layers {:.3}, distance {:.3}, pointshell {:.3}, normals {:.3}, tree {:.3}, total {:.3}",
        t.load, t.surface, t.fill, t.layers, t.distance, t.pointshell, t.normals, t.tree, t.total
    ));
    lines.push(String::new());
    lines.join("\n")
}

/// Facets with more material between them than this are those of a round face, degrees.
const FLAT_DEG: f64 = 170.0;

/// What a part tells apart, in words.
pub(in crate::cli) fn accuracy_text(accuracy: &Accuracy, voxel_size_m: f64) -> Option<String> {
    let &Accuracy {
        sample_error_m,
        surface_error_m,
        unseen_depth_m,
        thinnest_wall_m,
        sharpest_edge_deg,
    } = accuracy;
    let mm = |length_m: f64| format!("{} mm", show((length_m * 1e6).round() * 1e-3));
    let texts = [
        sample_error_m.map(|error_m| format!("samples to {:.0e} voxels", error_m / voxel_size_m)),
        surface_error_m.map(|error_m| format!("surface felt to {}", mm(error_m))),
        unseen_depth_m.map(|depth_m| format!("enters a flat face {} unseen", mm(depth_m))),
        thinnest_wall_m.map(|wall_m| format!("thinnest wall {}", mm(wall_m))),
        sharpest_edge_deg
            .filter(|angle_deg| *angle_deg < FLAT_DEG)
            .map(|angle_deg| format!("sharpest edge {angle_deg:.0}°")),
    ];
    let texts: Vec<String> = texts.into_iter().flatten().collect();
    (!texts.is_empty()).then(|| texts.join(", "))
}

/// What a scene tells from a fit.
pub(in crate::cli) fn overlap_text(
    objects: &[ObjectReport],
    config: &SceneConfig,
) -> Option<String> {
    let overlap_m = scene::smallest_overlap_m(objects)?;
    // Rounded up.
    let overlap_mm = show((overlap_m * 1e6).ceil() * 1e-3);
    let seen = format!("an overlap of less than {overlap_mm} mm may be felt as a fit");
    Some(match press_fit_text(config) {
        Some(press_fit) => format!("{seen}; {press_fit}"),
        None => seen,
    })
}

/// Force on a mm of rim under which [`press_fit_text`] says how much too large a part may be, N.
const ON_A_MM_N: f64 = 1.0;

/// What goes in though it is too large: the law gives the foundation's energy for each length of
/// the rim, ½ κ overlap², as the force that does it. `None` where force follows another law.
pub(in crate::cli) fn press_fit_text(config: &SceneConfig) -> Option<String> {
    let contact = &config.parameters.contact;
    if config.sculpt.is_some()
        || config.parameters.coupling.mode == CouplingMode::Constraint
        || config.tool.points != Points::Facets
        || contact.field != FieldKind::Trilinear
        || contact.normalization != Normalization::None
        || contact.friction.r#static > 0.0
    {
        return None;
    }
    let voxel_mm = config.tool.voxel_size_m * 1e3;
    let n_per_mm3 = contact.stiffness_n_per_m * 1e-3 / (voxel_mm * voxel_mm);
    let overlap_mm = (2.0 * ON_A_MM_N / n_per_mm3).sqrt();
    let to_a_micron = |length_mm: f64| show((length_mm * 1e3).round() * 1e-3);
    Some(format!(
        "a part {} mm too large on each side is pressed in by {ON_A_MM_N} N for each mm of its rim, \
            one {} mm too large by {} N",
        to_a_micron(overlap_mm),
        to_a_micron(0.5 * overlap_mm),
        0.25 * ON_A_MM_N
    ))
}

/// The clay of a scene, for people.
pub(in crate::cli) fn clay_text(clay: &ClayReport) -> String {
    let [nx, ny, nz] = clay.raster;
    let volume =
        clay.volume_m3.map_or("open".to_owned(), |volume_m3| format!("{:.2} mm³", volume_m3 * 1e9));
    let borders = match clay.borders.len() {
        0 => "no border".to_owned(),
        1 => "1 border".to_owned(),
        n => format!("{n} borders"),
    };
    format!(
        "clay ({} samples)\n  surface     {} mm between samples, normals: {}, {}, {borders}, \
            {volume}\n  raster      {nx} x {ny} x {nz} mass points {} mm apart, {} nodes over the \
            whole model\n  seconds     {:.3}\n",
        clay.samples,
        show(clay.spacing_m * 1e3),
        clay.normals,
        if clay.closed { "closed" } else { "a sheet" },
        show(clay.raster_spacing_m * 1e3),
        clay.nodes,
        clay.seconds,
    )
}

/// Largest resident set of this process so far; `None` where /proc does not say.
pub(super) fn peak_rss_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kib: u64 = line.trim().trim_end_matches("kB").trim().parse().ok()?;
    Some(kib * 1024)
}
