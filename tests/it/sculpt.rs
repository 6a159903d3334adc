//! A clay model from samples to a rigid part that is touched.

use std::fs;
use std::path::Path;
use std::process::Command;

use clay::clay_model::Settings;
use clay::dynamics::Material;
use clay::export::write_mesh;
use clay::falloff::Falloff;
use clay::pull::PullForce;
use clay::{ClayModel, PointSet};
use glam::DVec3;

const RADIUS_M: f64 = 0.02;

fn ball() -> ClayModel {
    let mut points = PointSet::default();
    let n_samples = 3000;
    for n in 0..n_samples {
        let z = 1.0 - f64::from(2 * n + 1) / f64::from(n_samples);
        let (sin, cos) = (f64::from(n) * 2.399_963_229_728_653).sin_cos();
        let across = (1.0 - z * z).sqrt();
        let normal = DVec3::new(across * cos, across * sin, z).normalize();
        points.push(normal * RADIUS_M, normal, [200; 3]);
    }
    let settings = Settings {
        region_map: Some((DVec3::new(-0.012, -0.012, 0.008), DVec3::new(0.012, 0.012, 0.032))),
        raster: [31; 3],
        air_m: 6e-3,
        material: Material {
            creep_s: 0.05,
            acceleration_max_m_per_s2: f64::INFINITY,
            ..Material::default()
        },
        ..Settings::default()
    };
    ClayModel::new(points, settings).unwrap()
}

/// Contacts of a ball of 5 mm radius at these places.
fn contacts(folder: &Path, places: &[DVec3]) -> Vec<u32> {
    let rows = places
        .iter()
        .enumerate()
        .map(|(n, at)| format!("{n},{},{},{},0,0,0,1\n", at.x, at.y, at.z));
    fs::write(
        folder.join("poses.csv"),
        format!("t_s,x_m,y_m,z_m,qx,qy,qz,qw\n{}", rows.collect::<String>()),
    )
    .unwrap();
    let mut eval = Command::new(env!("CARGO_BIN_EXE_hapticd"));
    eval.args([
        "eval",
        "scene.toml",
        "--poses",
        "poses.csv",
        "--out",
        "wrenches.csv",
        "--cache",
        "off",
    ]);
    let ended = eval.current_dir(folder).output().unwrap();
    assert!(ended.status.success(), "{}", String::from_utf8_lossy(&ended.stderr));
    let table = fs::read_to_string(folder.join("wrenches.csv")).unwrap();
    let column =
        table.lines().next().unwrap().split(',').position(|name| name == "contacts").unwrap();
    table.lines().skip(1).map(|row| row.split(',').nth(column).unwrap().parse().unwrap()).collect()
}

#[test]
fn what_was_pulled_out_is_baked_and_touched_as_a_rigid_part() {
    let mut model = ball();
    for _ in 0..60 {
        let top = model.onto(DVec3::Z * RADIUS_M, 0.01).map_or(DVec3::Z * RADIUS_M, |(at, _)| at);
        model
            .pull(&PullForce {
                along_map: vec![top],
                force_n: DVec3::Z * 10.0,
                reach_m: 3e-3,
                radius_m: 5e-3,
                falloff: Falloff::Gaussian,
            })
            .unwrap();
        model.advance(4e-3);
    }
    model.end_stroke().unwrap();
    let top_m = model.points().positions_map.iter().map(|at| at.z).fold(0.0, f64::max);
    assert!(top_m > RADIUS_M + 1e-3, "{top_m}");

    let folder = tempfile::tempdir().unwrap();
    write_mesh(&folder.path().join("piece.ply"), &model.mesh().unwrap()).unwrap();
    let scene = "version = 1\n[[static]]\nname = \"piece\"\nmesh = \"piece.ply\"\nunits = \
        \"m\"\nvoxel_size_mm = 0.5\n[tool]\nshape = { sphere_mm = 5.0 }\nvoxel_size_mm = \
        0.5\n[device]\nprofile = \"sim-sigma7\"\n";
    fs::write(folder.path().join("scene.toml"), scene).unwrap();

    let mut bake = Command::new(env!("CARGO_BIN_EXE_hapticd"));
    bake.args([
        "bake",
        "piece.ply",
        "--units",
        "m",
        "--voxel-size-mm",
        "0.5",
        "--json",
        "--cache",
        "off",
    ]);
    let baked = bake.current_dir(folder.path()).output().unwrap();
    let report: serde_json::Value = serde_json::from_slice(&baked.stdout).unwrap();
    assert!(report["watertight"] == true && report["open_edges"] == 0, "{report}");

    // Above the sphere as it was there is clay now; beside it there is none.
    let above = DVec3::Z * (top_m + 4.5e-3);
    let beside = DVec3::X * (RADIUS_M + 5.5e-3);
    let into_the_side = DVec3::X * (RADIUS_M + 4.5e-3);
    let found = contacts(folder.path(), &[above, beside, into_the_side]);
    assert!(found[0] > 0 && found[1] == 0 && found[2] > 0, "{found:?}");
}
