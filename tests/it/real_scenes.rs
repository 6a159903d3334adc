//! Scenes over real CAD meshes: not closed, not ours, found through `HAPTICD_MODELS`.

use core::f64::consts::TAU;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use document::poses::HEADER;
use glam::{DQuat, DVec3};
use hapticd::config::SceneConfig;
use hapticd::daemon::prepare;
use vps::contact::ContactSum;
use vps::mesh::{self, validate};
use vps::spatial::Pose;
use vps::voxmap::inside_test::InsideTest;
use vps::voxmap::{Options, Volume};

use super::rig::{self, Run};

const MM: f64 = 1e-3;

/// A static mesh and a tool mesh, both in metres, in a scene of their own; the files live as long
/// as this does.
struct Bench {
    config: SceneConfig,
    hand: PathBuf,
    _folder: tempfile::TempDir,
}

impl Bench {
    fn new(
        models: &Path,
        (fixed, fixed_voxel_mm): (&str, f64),
        (tool, tool_voxel_mm): (&str, f64),
    ) -> Self {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let hand = folder.path().join("hand.csv");
        let text = format!(
            "version = 1\nname = \"real meshes\"\n\n[[static]]\nname = \"fixed\"\nmesh = \
                {:?}\nunits = \"m\"\nvoxel_size_mm = {fixed_voxel_mm:?}\nlayers = \
                8\n\n[tool]\nmesh = {:?}\nunits = \"m\"\nvoxel_size_mm = {tool_voxel_mm:?}\nmass_g \
                = 80.0\n\n[contact]\nstiffness_n_per_mm3 = {:?}\ndamping_ratio = \
                0.7\n\n[device]\nprofile = \"sim-sigma7\"\nhand = {:?}\n",
            models.join(fixed),
            models.join(tool),
            5.0 / (tool_voxel_mm * tool_voxel_mm),
            hand,
        );
        std::fs::write(&hand, format!("{HEADER}\n0,0,0,0,0,0,0,1\n")).expect("written");
        let path = folder.path().join("scene.toml");
        std::fs::write(&path, text).expect("written");
        Self { config: rig::load(&path), hand, _folder: folder }
    }

    /// Runs along way-points (seconds to get there, pose), in smooth moves from rest to rest. The
    /// first one is the start.
    fn run(&mut self, name: &str, way: &[(f64, Pose)]) -> Run {
        let mut text = format!("{HEADER}\n");
        let mut put = |time_s: f64, pose: Pose| {
            let ([x, y, z], [qx, qy, qz, qw]) =
                (pose.translation.to_array(), pose.rotation.to_array());
            let _ =
                writeln!(text, "{time_s:.4},{x:.9},{y:.9},{z:.9},{qx:.9},{qy:.9},{qz:.9},{qw:.9}");
        };
        put(0.0, way[0].1);
        let mut time_s = 0.0;
        for pair in way.windows(2) {
            let ((_, from), (takes_s, to)) = (pair[0], pair[1]);
            let rows = (takes_s * 100.0).round();
            for row in 1..=rows as u32 {
                let t = f64::from(row) / rows;
                let share = t * t * t * (10.0 + t * (6.0 * t - 15.0));
                let pose = Pose::new(
                    from.rotation.slerp(to.rotation, share),
                    from.translation.lerp(to.translation, share),
                );
                put(time_s + takes_s * t, pose);
            }
            time_s += takes_s;
        }
        std::fs::write(&self.hand, text).expect("written");
        self.config.parameters.mapping.start = way[0].1;
        let run = rig::run(&self.config);
        for report in &run.reports {
            // What is left inside of a solid is most of it: a fill that got in leaves pockets.
            let volume_mm3 = report.inside_voxels as f64 * (report.voxel_size_m / MM).powi(3);
            assert!(volume_mm3 > 500.0, "{name}, {}: only {volume_mm3} mm³ inside", report.name);
            // Not closed is no excuse: such a mesh must not leak at this voxel size.
            assert!(
                report.watertight && report.sides == "flood",
                "{name}, {}: {:?}",
                report.name,
                report.warnings
            );
        }
        run.assert_sound(name);
        run
    }

    /// The height near the origin, at most `reach_mm` away, at which the tool has most room; with
    /// its clearance in mm.
    fn roomiest_height(&self, base_mm: f64, reach_mm: f64) -> (f64, f64) {
        let (prepared, _) = prepare(&self.config, |_| ()).unwrap_or_else(|error| panic!("{error}"));
        let scene = prepared.scene;
        let p = &scene.parameters;
        let clearance_mm = |height_mm: f64| {
            let pose =
                Pose::from_translation(DVec3::Z * height_mm * MM + scene.tool.center_of_mass_tool);
            -ContactSum::flat(&scene.obstacles, &scene.tool.shell, pose, p.force_law()).max_value_m
                / MM
        };
        let heights = (-100..=100).map(|step| base_mm + reach_mm * 0.01 * f64::from(step));
        let best = heights
            .map(|height_mm| (height_mm, clearance_mm(height_mm)))
            .max_by(|a, b| a.1.total_cmp(&b.1));
        best.expect("heights")
    }
}

fn at(x_mm: f64, y_mm: f64, z_mm: f64) -> Pose {
    Pose::from_translation(DVec3::new(x_mm, y_mm, z_mm) * MM)
}

/// The folder of real meshes; says so and gives `None` where the variable is unset.
fn folder() -> Option<PathBuf> {
    let folder = std::env::var_os("HAPTICD_MODELS").map(PathBuf::from);
    if folder.is_none() {
        eprintln!("skipped: HAPTICD_MODELS not set");
    }
    folder
}

fn end_mm(run: &Run) -> [f64; 3] {
    (run.final_pose().translation / MM).to_array()
}

#[test]
fn a_real_peg_goes_through_a_real_hole_and_not_beside_it() {
    // Peg d 7.995, tip at its z = 0, chamfer 0.5; through hole d 8.1 along z, from 8.992 down to 0:
    // 0.05 mm all around.
    let Some(folder) = folder() else { return };
    let hole = ("factory_round_hole_8mm_subdiv_3x.obj", 0.2);
    let mut bench = Bench::new(&folder, hole, ("factory_round_peg_8mm_tight.obj", 0.5));
    let tilt = DQuat::from_rotation_y(0.4_f64.to_radians());
    let tilted = |pose: Pose| Pose::new(tilt, pose.translation);
    let start = at(3.0, -2.0, 14.0);
    let way =
        [(0.0, start), (0.5, tilted(at(0.2, -0.15, 10.0))), (1.5, tilted(at(0.2, -0.15, 1.0)))];
    let run = bench.run("real peg", &way);
    let [x, y, z] = end_mm(&run);
    // No floor: where the hand wants it, less what friction in the arm (0.1 N at 500 N/m) keeps.
    assert!((z - 1.0).abs() < 0.3, "the peg stands at {z} mm");
    let depth_mm = run.at_end().output.max_depth_m / MM;
    assert!(depth_mm < 0.05 && x.hypot(y) < 0.12, "{x}, {y} mm, {depth_mm} mm deep");

    let run = bench.run(
        "real peg, beside the hole",
        &[(0.0, start), (0.5, at(8.2, 0.0, 11.0)), (1.5, at(8.2, 0.0, 1.0))],
    );
    let lowest_mm = run
        .records
        .iter()
        .map(|record| record.output.world_from_tool.translation.z / MM)
        .fold(f64::INFINITY, f64::min);
    assert!(
        lowest_mm > 8.992 - 0.15 && end_mm(&run)[2] < 9.2,
        "lowest {lowest_mm} mm, at the end {} mm",
        end_mm(&run)[2]
    );
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn a_real_gear_slides_down_a_real_shaft() {
    // Both in the frame of the assembly: seated at the identity, lower face on the plate at z = 5.
    // Shaft d 10.0 at x = 20 mm up to z = 25, bore d 10.0 with 0.3 mm chamfers: no clearance at
    // all. Other shafts are further away than the gear's tips.
    let Some(folder) = folder() else { return };
    let base = ("factory_gear_base_tight_space_5e-4_subdiv_4x.obj", 0.25);
    let mut bench = Bench::new(&folder, base, ("factory_gear_medium_space_5e-4.obj", 0.7));
    let way = [(0.0, at(3.0, 2.0, 26.0)), (0.6, at(0.15, 0.1, 21.0)), (2.0, at(0.15, 0.1, -2.0))];
    let run = bench.run("real gear", &way);
    let [x, y, z] = end_mm(&run);
    assert!((-0.15..0.05).contains(&z), "the gear stands at {z} mm");
    assert!(x.abs() < 0.1 && y.abs() < 0.1, "on its shaft: {x}, {y} mm");

    let way = [(0.0, at(0.0, 10.0, 26.0)), (0.6, at(0.0, 10.0, 21.0)), (1.0, at(0.0, 10.0, 13.0))];
    let run = bench.run("real gear, beside the shaft", &way);
    let lowest_mm = run
        .records
        .iter()
        .map(|record| record.output.world_from_tool.translation.z / MM)
        .fold(f64::INFINITY, f64::min);
    assert!(lowest_mm > 19.0, "beside its shaft the gear stays up: {lowest_mm} mm");
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn a_real_nut_is_held_by_its_thread_and_follows_it() {
    // Bolt thread z = 16 to 41, nut z = 16 to 29 in its file; pitch 2 mm.
    let Some(folder) = folder() else { return };
    let bolt = ("factory_bolt_m16_tight.obj", 0.2);
    let mut bench = Bench::new(&folder, bolt, ("factory_nut_m16_tight_subdiv_3x.obj", 0.5));
    let (start_mm, clearance_mm) = bench.roomiest_height(8.0, 1.0);
    eprintln!("real nut: most room at {start_mm:.2} mm, {clearance_mm:.4} mm");
    assert!(clearance_mm > -0.05, "{clearance_mm} mm of room in phase");

    let start = at(0.0, 0.0, start_mm);
    let run = bench.run(
        "real nut, pressed",
        &[(0.0, start), (0.3, start), (1.5, at(0.0, 0.0, start_mm - 3.0))],
    );
    let lowest_mm = run
        .records
        .iter()
        .map(|record| record.output.world_from_tool.translation.z / MM)
        .fold(f64::INFINITY, f64::min);
    assert!(lowest_mm > start_mm - 0.2, "the thread holds: {lowest_mm} mm of {start_mm} mm");

    // One turn clockwise, 2 mm down, in quarters so that the interpolation knows which way round.
    let mut way = vec![(0.0, start), (0.3, start)];
    way.extend((1..=4).map(|quarter| {
        let share = f64::from(quarter) / 4.0;
        (
            1.0,
            Pose::new(
                DQuat::from_rotation_z(-TAU * share),
                DVec3::Z * (start_mm - 2.0 * share) * MM,
            ),
        )
    }));
    let run = bench.run("real nut, turned", &way);
    let [x, y, z] = end_mm(&run);
    assert!((z - (start_mm - 2.0)).abs() < 0.15, "a turn is a pitch: {z} mm from {start_mm} mm");
    assert!(x.hypot(y) < 0.3, "{x}, {y} mm");
}
#[test]
fn the_inside_of_a_real_gear_does_not_depend_on_the_layers() {
    let Some(folder) = folder() else { return };
    let mesh = mesh::load(&folder.join("factory_gear_medium_space_5e-4.obj"), 1.0).expect("a mesh");
    let report = validate::inspect(&mesh);
    // With 3, 4 and 5 layers a face lies on a cell boundary, but for rounding.
    for layers in 2..=8 {
        let options =
            Options { voxel_size_m: 8e-4, layers, navigation: None, sides: InsideTest::Auto };
        let map = Volume::build(&mesh, &report, &options, |_| ()).expect("a grid that fits");
        let inside = map.sides.count_inside(&map.surface);
        assert!(
            inside > 28_000 && map.watertight,
            "{layers} layers: {inside} voxels inside, watertight: {}",
            map.watertight
        );
    }
}
