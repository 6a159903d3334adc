//! Every tool as a scripted scene, held against what is known in closed form; and the clay scenes
//! that are shipped.
//!
//! A ball of clay with a radius of 15 mm stands at the origin, the ball in the hand comes from
//! above. With `CLAY_PICTURES` naming a folder, each leaves its pictures there: those of
//! `docs/reference/gallery.md`.

use std::collections::HashSet;
use std::f64::consts::PI;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use clay::{self, PointSet};
use glam::DVec3;
use serde_json::Value;
use tempfile::TempDir;

const RADIUS_MM: f64 = 15.0;
const SPACING_MM: f64 = 0.7;

/// One tool at work.
struct SculptTool<'a> {
    /// Lines under `[sculpt]`, beside what all have.
    sculpt: &'a str,
    /// Radius of the ball in the hand, mm.
    tool_mm: f64,
    /// Lines under `[contact]`.
    contact: &'a str,
    /// Times of the hand and where it wants the middle of its ball to be, s and mm.
    hand: &'a [(f64, [f64; 3])],
    /// The file of strokes, behind its version.
    strokes: &'a str,
}

/// What became of it.
struct Worked {
    json: Value,
    before: PointSet,
    after: PointSet,
    /// The end of the run, and the mesh that was exported.
    dir: TempDir,
}

impl Worked {
    fn number(&self, key: &str) -> f64 {
        self.json["sculpt"][key].as_f64().unwrap_or_else(|| panic!("{key} in {}", self.json))
    }

    fn strokes(&self) -> f64 {
        self.number("strokes")
    }

    /// The height of the surface over a place, mm: of the highest sample within a spacing and a
    /// half around the upright there.
    fn height_mm(&self, x_mm: f64, y_mm: f64) -> f64 {
        let beside = DVec3::new(x_mm, y_mm, 0.0);
        let near = |at: &DVec3| (*at * 1e3 - beside).truncate().length() < 1.5 * SPACING_MM;
        self.after
            .positions_map
            .iter()
            .filter(|at| near(at))
            .map(|at| at.z * 1e3)
            .fold(f64::NEG_INFINITY, f64::max)
    }

    /// The lowest and the highest sample, mm.
    fn reach_mm(&self) -> (f64, f64) {
        let (low, high) = self.after.bounds().unwrap();
        (low.z * 1e3, high.z * 1e3)
    }

    /// Nothing has moved beyond the region.
    fn far_side_is_as_it_was(&self) {
        let far = self.before.positions_map.iter().filter(|at| at.z < 0.0);
        assert!(far.clone().all(|at| self.after.positions_map.contains(at)), "{}", self.json);
    }
}

fn hapticd(dir: &Path, arguments: &[&str]) -> Value {
    let mut command = Command::new(env!("CARGO_BIN_EXE_hapticd"));
    command.current_dir(dir).args(arguments).env("RUST_BACKTRACE", "0");
    command
        .env("XDG_CACHE_HOME", dir.join("xdg-cache"))
        .env("XDG_STATE_HOME", dir.join("xdg-state"));
    let output = command.output().unwrap();
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{arguments:?}\n{stderr}");
    serde_json::from_slice(&output.stdout)
        .unwrap_or_else(|error| panic!("{error}: {arguments:?}\n{stderr}"))
}

fn samples(path: &Path) -> PointSet {
    clay::load(path, 1.0, None).unwrap().points
}

fn worked(kind: &SculptTool<'_>) -> Worked {
    let dir = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| fs::write(dir.path().join(name), text).unwrap();
    let SculptTool { sculpt, tool_mm, contact, hand, strokes } = kind;
    let (_, [x, y, z]) = hand[0];
    let name = sculpt.split('"').nth(1).unwrap_or("script");
    let scene = format!(
        "version = 1\nname = \"{name}\"\n[sculpt]\nshape = {{ sphere_mm = {RADIUS_MM} \
            }}\nspacing_mm = {SPACING_MM}\nregion_mm = [[-12, -12, 4], [12, 12, 28]]\nraster = \
            [36, 36, 36]\nair_mm = 10\nupdate_hz = 100\nstrokes = \
            \"strokes.toml\"\n{sculpt}\n[tool]\nshape = {{ sphere_mm = {tool_mm} }}\nvoxel_size_mm \
            = 0.5\nmass_g = 50\nstart_position_mm = [{x}, {y}, \
            {z}]\n[contact]\n{contact}\n[device]\nprofile = \"sim-sigma7\"\nhand = \"hand.csv\"\n"
    );
    write("scene.toml", &scene);
    // Before anything else, what there is.
    write(
        "strokes.toml",
        &format!(
            "version = 1\n[[stroke]]\nat_s = 0\ndo = \"save-points\"\nfile = \
                \"before.ply\"\n{strokes}"
        ),
    );
    let rows = hand.iter().fold(
        String::from("t_s,x_m,y_m,z_m,qx,qy,qz,qw\n"),
        |mut text, (t_s, [x, y, z])| {
            writeln!(text, "{t_s},{},{},{},0,0,0,1", x / 1e3, y / 1e3, z / 1e3).unwrap();
            text
        },
    );
    write("hand.csv", &rows);
    let duration = format!("{}s", hand.last().unwrap().0);
    let mut line = vec![
        "sculpt",
        "scene.toml",
        "--clock",
        "virtual",
        "--json",
        "--duration",
        &duration,
        "--save",
        "end.ply",
        "--export",
        "mesh.ply",
    ];
    let pictures = std::env::var_os("CLAY_PICTURES");
    if pictures.is_some() {
        line.extend(["--pictures", "."]);
    }
    let json = hapticd(dir.path(), &line);
    if let Some(folder) = pictures {
        fs::copy(
            dir.path().join("scene-after.png"),
            Path::new(&folder).join(format!("clay-{name}.png")),
        )
        .unwrap();
    }
    assert_eq!(json["faults"], Value::Array(Vec::new()), "{json}");
    assert_eq!(json["sculpt"]["failed"], Value::Array(Vec::new()), "{json}");
    Worked {
        json,
        before: samples(&dir.path().join("before.ply")),
        after: samples(&dir.path().join("end.ply")),
        dir,
    }
}

/// Down to where the middle of a ball of 3 mm wants to be, to stay there, and up again.
fn press(to_mm: f64) -> [(f64, [f64; 3]); 4] {
    [
        (0.0, [0.0, 0.0, 21.0]),
        (0.4, [0.0, 0.0, to_mm]),
        (0.9, [0.0, 0.0, to_mm]),
        (1.4, [0.0, 0.0, 22.0]),
    ]
}

const ONLY_HAND: SculptTool<'_> = SculptTool {
    sculpt: "",
    tool_mm: 3.0,
    contact: "stiffness_n_per_mm3 = 4.0",
    hand: &[],
    strokes: "",
};

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn touch_leaves_everything_as_it_was() {
    let worked =
        worked(&SculptTool { sculpt: "tool = \"touch\"", hand: &press(13.0), ..ONLY_HAND });
    assert!(worked.json["contact_ticks"].as_u64().unwrap() > 300, "{}", worked.json);
    assert!(worked.json["max_force_n"].as_f64().unwrap() > 1.0, "{}", worked.json);
    assert_eq!(worked.strokes(), 0.0);
    assert!(worked.before == worked.after);
    assert_eq!(worked.number("volume_before_mm3"), worked.number("volume_mm3"));
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn push_dents_no_deeper_than_the_hand_goes() {
    let worked = worked(&SculptTool {
        sculpt: "tool = \"push\"\nbrush_mm = 4",
        hand: &press(12.0),
        ..ONLY_HAND
    });
    assert_eq!(worked.strokes(), 1.0);
    // The lower end of the hand's ball wants to be at 9 mm.
    let top_mm = worked
        .after
        .positions_map
        .iter()
        .filter(|at| at.truncate().length() < 1e-3)
        .map(|at| at.z * 1e3);
    let top_mm = top_mm.fold(f64::NEG_INFINITY, f64::max);
    assert!((9.0..RADIUS_MM - 0.5).contains(&top_mm), "the middle is at {top_mm} mm");
    assert!(
        worked.number("volume_mm3") < worked.number("volume_before_mm3") - 5.0,
        "{}",
        worked.json
    );
    worked.far_side_is_as_it_was();
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn pull_lengthens_no_farther_than_the_hand_goes() {
    let hand = [
        (0.0, [0.0, 0.0, 19.0]),
        (0.4, [0.0, 0.0, 19.0]),
        (1.2, [0.0, 0.0, 27.0]),
        (1.7, [0.0, 0.0, 27.0]),
    ];
    let strokes = "[[stroke]]\nat_s = 0.3\ndo = \"hold\"\nuntil_s = 1.6\n";
    let worked = worked(&SculptTool {
        sculpt: "tool = \"pull\"\nbrush_mm = 5",
        hand: &hand,
        strokes,
        ..ONLY_HAND
    });
    assert_eq!(worked.strokes(), 1.0);
    let (_, top_mm) = worked.reach_mm();
    assert!((RADIUS_MM + 1.5..27.0).contains(&top_mm), "pulled up to {top_mm} mm");
    assert!(
        worked.number("volume_mm3") > worked.number("volume_before_mm3") + 5.0,
        "{}",
        worked.json
    );
    worked.far_side_is_as_it_was();
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn pull_curve_raises_a_ridge_and_leaves_both_sides() {
    let above = |x: f64| [x, 0.0, (RADIUS_MM * RADIUS_MM - x * x).sqrt() + 3.4];
    let hand = [
        (0.0, above(-6.0)),
        (0.3, above(-6.0)),
        (0.6, above(-3.0)),
        (0.9, above(0.0)),
        (1.2, above(3.0)),
        (1.5, above(6.0)),
        (1.8, above(6.0)),
        (2.2, above(0.0)),
        (2.5, above(0.0)),
        (3.3, [0.0, 0.0, 28.0]),
        (3.8, [0.0, 0.0, 28.0]),
    ];
    let strokes = "[[stroke]]\nat_s = 0.25\ndo = \"hold\"\nuntil_s = 1.6\n[[stroke]]\nat_s = \
        2.3\ndo = \"hold\"\nuntil_s = 3.7\n";
    let worked = worked(&SculptTool {
        sculpt: "tool = \"pull-curve\"\nbrush_mm = 4",
        hand: &hand,
        strokes,
        ..ONLY_HAND
    });
    assert_eq!(worked.strokes(), 1.0, "drawing alone is no stroke: {}", worked.json);
    let ball_mm = |x: f64, y: f64| (RADIUS_MM * RADIUS_MM - x * x - y * y).sqrt();
    for x_mm in [-4.0, 0.0, 4.0] {
        let height_mm = worked.height_mm(x_mm, 0.0);
        assert!(height_mm > ball_mm(x_mm, 0.0) + 0.7, "{height_mm} mm at x = {x_mm} mm");
    }
    for y_mm in [-9.0, 9.0] {
        let highest_mm = ball_mm(0.0, f64::abs(y_mm) - 1.5 * SPACING_MM);
        assert!(
            worked.height_mm(0.0, y_mm) < highest_mm + 0.05,
            "{} mm at y = {y_mm} mm",
            worked.height_mm(0.0, y_mm)
        );
    }
    worked.far_side_is_as_it_was();
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn paint_covers_the_disc_of_a_brush_that_is_pressed_hard() {
    // Eight millimetres into a millimetre per newton: more than the two newtons of the full brush.
    let sculpt = "tool = \"paint\"\nbrush_mm = 5\nfalloff = \"constant\"\ncolor = \"#c80000\"";
    let worked = worked(&SculptTool { sculpt, hand: &press(10.0), ..ONLY_HAND });
    assert!(worked.json["max_force_n"].as_f64().unwrap() > 2.0, "{}", worked.json);
    assert_eq!(worked.strokes(), 1.0);
    assert_eq!(
        worked.number("volume_before_mm3"),
        worked.number("volume_mm3"),
        "paint moves nothing"
    );
    let top = DVec3::Z * RADIUS_MM * 1e-3;
    let away_mm = |is_red: bool| {
        let all = worked.after.positions_map.iter().zip(&worked.after.colors);
        all.filter(move |(_, color)| (**color == [200, 0, 0]) == is_red)
            .map(|(at, _)| at.distance(top) * 1e3)
    };
    let farthest_red_mm = away_mm(true).fold(0.0, f64::max);
    let nearest_grey_mm = away_mm(false).fold(f64::INFINITY, f64::min);
    // Discs at the rim are split until they are a fraction of the spacing.
    assert!((farthest_red_mm - 5.0).abs() < 0.3 * SPACING_MM, "red up to {farthest_red_mm} mm");
    assert!((nearest_grey_mm - 5.0).abs() < 0.3 * SPACING_MM, "grey from {nearest_grey_mm} mm");
    assert!(worked.after.len() > worked.before.len(), "discs that the rim cuts are split");
    // A cap with a chord of r has the area π r², of a ball's 4 π R².
    let share = worked.before.positions_map.iter().filter(|at| at.distance(top) < 5e-3).count()
        as f64
        / worked.before.len() as f64;
    let expected = 25.0 / (4.0 * RADIUS_MM * RADIUS_MM);
    assert!((share / expected - 1.0).abs() < 0.15, "{share} of the ball, expected {expected}");
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn material_that_is_painted_gives_way_less_to_the_same_hand() {
    // Blue and hard on the right, then the same press into both sides.
    let at = |x: f64, above: f64| [x, 0.0, (RADIUS_MM * RADIUS_MM - x * x).sqrt() + above];
    let press = |from_s: f64, x: f64, to: f64, until_s: f64| {
        [
            (from_s, at(x, 4.0)),
            (from_s + 0.3, at(x, to)),
            (until_s, at(x, to)),
            (until_s + 0.2, at(x, 4.0)),
        ]
    };
    let hand =
        [press(0.0, 5.0, 0.5, 0.5), press(1.2, 5.0, 0.5, 2.2), press(2.9, -5.0, 0.5, 3.9)].concat();
    let strokes = "[[stroke]]\nat_s = 1.0\ndo = \"take\"\ntool = \"push\"\nbrush_mm = 3\nfalloff = \
        \"gaussian\"\n";
    let sculpt = "tool = \"material\"\nbrush_mm = 5\nfalloff = \"constant\"\ncolor = \
        \"#4060c8\"\npainted = { stiffness = 500.0, damping = 5.0 }";
    let worked = worked(&SculptTool { sculpt, hand: &hand, strokes, ..ONLY_HAND });
    assert_eq!(worked.strokes(), 3.0, "{}", worked.json);
    let dent_mm = |x_mm: f64| {
        let near = |at: &&DVec3| (at.x * 1e3 - x_mm).hypot(at.y * 1e3) < 2.0 * SPACING_MM;
        worked
            .after
            .positions_map
            .iter()
            .filter(near)
            .map(|at| RADIUS_MM - at.length() * 1e3)
            .fold(0.0, f64::max)
    };
    let hard_mm = dent_mm(5.0);
    let soft_mm = dent_mm(-5.0);
    assert!(soft_mm > 0.5 && hard_mm < 0.5 * soft_mm, "{hard_mm} mm of {soft_mm} mm");
    let is_blue = |color: &[u8; 3]| *color == [0x40, 0x60, 0xc8];
    let samples = worked.after.positions_map.iter().zip(&worked.after.colors);
    assert!(samples.clone().filter(|(_, color)| is_blue(color)).count() > 100);
    assert!(
        samples.filter(|(at, _)| at.x < 0.0).all(|(_, color)| !is_blue(color)),
        "what is soft has its colour"
    );
    worked.far_side_is_as_it_was();
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn emboss_and_engrave_reach_their_depth() {
    for (tool, sign) in [("emboss", 1.0), ("engrave", -1.0)] {
        let sculpt = format!("tool = \"{tool}\"\nbrush_mm = 6\ndepth_mm = 1.5");
        let strokes = "[[stroke]]\nat_s = 0.6\ndo = \"hold\"\nuntil_s = 0.7\n";
        let worked =
            worked(&SculptTool { sculpt: &sculpt, hand: &press(16.0), strokes, ..ONLY_HAND });
        assert_eq!(worked.strokes(), 1.0, "{tool}");
        let depth_mm = |at: &&DVec3| sign * (at.length() * 1e3 - RADIUS_MM);
        let deepest = worked
            .after
            .positions_map
            .iter()
            .max_by(|one, other| depth_mm(one).total_cmp(&depth_mm(other)))
            .unwrap();
        assert!((depth_mm(&deepest) - 1.5).abs() < 0.1, "{tool}: {} mm", depth_mm(&deepest));
        // The sample nearest to the middle of the dome, at most a spacing off.
        assert!(deepest.truncate().length() < 1.2e-3, "{tool}: {deepest}");
        let beyond = worked
            .after
            .positions_map
            .iter()
            .filter(|at| at.truncate().length() > 6.5e-3 || at.z < 0.0);
        beyond.for_each(|at| assert!(depth_mm(&at).abs() < 0.05, "{tool}: {at}"));
    }
}

/// What two balls have in common, their middles so far apart, mm and mm³.
fn lens_mm3(one_mm: f64, other_mm: f64, apart_mm: f64) -> f64 {
    let r = one_mm;
    let s = other_mm;
    let d = apart_mm;
    PI * (r + s - d).powi(2) * (d * d + 2.0 * d * (r + s) - 3.0 * (r - s).powi(2)) / (12.0 * d)
}

fn ball_mm3(radius_mm: f64) -> f64 {
    4.0 / 3.0 * PI * radius_mm.powi(3)
}

/// Volume of what is left of two balls, mm³.
fn left_mm3(boolean: &str, one_mm: f64, other_mm: f64, apart_mm: f64) -> f64 {
    let common_mm3 = lens_mm3(one_mm, other_mm, apart_mm);
    match boolean {
        "union" => ball_mm3(one_mm) + ball_mm3(other_mm) - common_mm3,
        "intersection" => common_mm3,
        _ => ball_mm3(one_mm) - common_mm3,
    }
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn booleans_by_script_leave_the_volume_of_the_lens_formula() {
    let hand = [(0.0, [0.0, 0.0, 40.0]), (0.3, [0.0, 0.0, 40.0])];
    for boolean in ["union", "intersection", "difference"] {
        for sharp in [false, true] {
            let strokes = format!(
                "[[stroke]]\nat_s = 0.1\ndo = \"{boolean}\"\nshape = {{ sphere_mm = 10 \
                    }}\nspacing_mm = 1\nposition_mm = [13, 0, 0]\nsharp = {sharp}\n"
            );
            let worked = worked(&SculptTool { hand: &hand, strokes: &strokes, ..ONLY_HAND });
            let found = worked.number("volume_mm3");
            let expected = left_mm3(boolean, RADIUS_MM, 10.0, 13.0);
            assert!(
                (found / expected - 1.0).abs() < 0.02,
                "{boolean}, sharp = {sharp}: {found} mm³, expected {expected}"
            );
        }
    }
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn booleans_by_hand_join_and_cut_the_ball_in_the_hand() {
    // Soft contact: the hand's ball is far in the clay when it is held.
    let contact = "stiffness_n_per_mm3 = 0.02";
    let hand = [
        (0.0, [0.0, 0.0, 27.0]),
        (0.5, [0.0, 0.0, 10.0]),
        (1.0, [0.0, 0.0, 10.0]),
        (1.5, [0.0, 0.0, 40.0]),
    ];
    let strokes = "[[stroke]]\nat_s = 0.9\ndo = \"hold\"\nuntil_s = 1.0\n";
    for boolean in ["union", "intersection", "difference"] {
        let sculpt = format!("tool = \"{boolean}\"");
        let worked =
            worked(&SculptTool { sculpt: &sculpt, tool_mm: 10.0, contact, hand: &hand, strokes });
        assert_eq!(worked.strokes(), 1.0, "{boolean}");
        // How far apart both were shows in what is left.
        let (low_mm, high_mm) = worked.reach_mm();
        let pole_mm = worked
            .after
            .positions_map
            .iter()
            .filter(|at| at.z > 0.0 && at.truncate().length() < 1e-3);
        let apart_mm = match boolean {
            "union" => high_mm - 10.0,
            "intersection" => low_mm + 10.0,
            _ => pole_mm.map(|at| at.z * 1e3).fold(f64::INFINITY, f64::min) + 10.0,
        };
        assert!((12.0..22.0).contains(&apart_mm), "{boolean}: {apart_mm} mm apart");
        let found = worked.number("volume_mm3");
        let expected = left_mm3(boolean, RADIUS_MM, 10.0, apart_mm);
        let tolerance_mm3 = 0.02 * ball_mm3(RADIUS_MM).min(20.0 * expected);
        assert!(
            (found - expected).abs() < tolerance_mm3,
            "{boolean}: {found} mm³, expected {expected} at {apart_mm} mm"
        );
    }
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn what_was_made_is_a_closed_mesh() {
    let worked = worked(&SculptTool {
        sculpt: "tool = \"push\"\nbrush_mm = 4",
        hand: &press(12.0),
        ..ONLY_HAND
    });
    is_watertight(worked.dir.path(), "mesh.ply");
}

fn is_watertight(dir: &Path, mesh: &str) {
    let baked = hapticd(
        dir,
        &["bake", mesh, "--units", "m", "--voxel-size-mm", "1", "--json", "--cache", "off"],
    );
    assert!(baked["watertight"] == true && baked["open_edges"] == 0, "{mesh}: {baked}");
}

/// Runs a shipped scene with a hand twice, and bakes what it leaves.
fn shipped(name: &str, duration: &str) -> Value {
    let (json, _) = shipped_with(name, duration);
    assert!(json["contact_ticks"].as_u64().unwrap() > 500, "{name}: {json}");
    json
}

/// V − E + F of a mesh: 2 for one closed surface without a hole.
fn euler_number(mesh: &vps::mesh::TriangleMesh) -> i64 {
    let edges = mesh.triangles.iter().flat_map(|[a, b, c]| [(a, b), (b, c), (c, a)]);
    let edges: HashSet<_> = edges.map(|(from, to)| (from.min(to), from.max(to))).collect();
    let corners: HashSet<_> = mesh.triangles.iter().flatten().collect();
    corners.len() as i64 - edges.len() as i64 + mesh.triangles.len() as i64
}

/// The same of a scene that may have no hand; its samples too.
fn shipped_with(name: &str, duration: &str) -> (Value, PointSet) {
    let (json, points, _) = shipped_of(name, duration);
    (json, points)
}

/// And the Euler number of its mesh.
fn shipped_of(name: &str, duration: &str) -> (Value, PointSet, i64) {
    let scene =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("config/clay").join(name).with_extension("toml");
    let dir = tempfile::tempdir().unwrap();
    let line = [
        "sculpt",
        scene.to_str().unwrap(),
        "--clock",
        "virtual",
        "--json",
        "--duration",
        duration,
        "--overwrite",
    ];
    let run = || {
        hapticd(dir.path(), &[&line[..], &["--save", "end.ply", "--export", "mesh.ply"]].concat())
    };
    let first = run();
    let points = fs::read(dir.path().join("end.ply")).unwrap();
    let again = run();
    assert_eq!(first["sculpt"], again["sculpt"], "{name}");
    assert_eq!(first["final_pose"], again["final_pose"], "{name}");
    assert!(
        points == fs::read(dir.path().join("end.ply")).unwrap(),
        "{name}: other samples the second time"
    );
    assert_eq!(first["faults"], Value::Array(Vec::new()), "{name}: {first}");
    for nothing in ["failed", "unsaved"] {
        assert_eq!(first["sculpt"][nothing], Value::Array(Vec::new()), "{name}: {first}");
    }
    // Strokes of the logo's characters grow together.
    let troubles = first["sculpt"]["troubles"].as_array().unwrap();
    let reported = |words: &str| {
        troubles.iter().filter(|trouble| trouble.as_str().unwrap().contains(words)).count()
    };
    assert_eq!(
        (troubles.len(), reported("fronts of the clay have met")),
        if name == "logo" { (1, 1) } else { (0, 0) },
        "{name}: {first}"
    );
    assert_eq!(
        (&first["sculpt"]["left_over"], &first["sculpt"]["late"]),
        (&0.into(), &0.into()),
        "{name}: {first}"
    );
    is_watertight(dir.path(), "mesh.ply");
    let mesh = vps::mesh::load(&dir.path().join("mesh.ply"), 1.0).unwrap();
    (first, clay::load(&dir.path().join("end.ply"), 1.0, None).unwrap().points, euler_number(&mesh))
}

/// The height of the highest sample within 1.5 mm of an upright, mm.
fn highest_mm(points: &PointSet, x_mm: f64, y_mm: f64) -> f64 {
    let beside = |at: &DVec3| (*at * 1e3 - DVec3::new(x_mm, y_mm, 0.0)).truncate().length();
    points
        .positions_map
        .iter()
        .filter(|at| beside(at) < 1.5)
        .map(|at| at.z * 1e3)
        .fold(f64::NEG_INFINITY, f64::max)
}

fn strokes_of(json: &Value) -> u64 {
    json["sculpt"]["strokes"].as_u64().unwrap()
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn the_letter_is_embossed_painted_and_underlined() {
    // The image, two strokes of paint, the line.
    assert_eq!(strokes_of(&shipped("letter", "12s")), 4);
}

#[test]
fn the_letter_of_figure_2b_stands_out_along_its_curve_and_nowhere_else() {
    let (json, points) = shipped_with("letter-g", "2s");
    assert_eq!(strokes_of(&json), 1);
    // The arc has a radius of 13 mm around the middle; the plate ends in z = 4.
    let along: Vec<f64> = [90.0, 150.0, 210.0, 270.0, 330.0]
        .iter()
        .map(|degrees: &f64| {
            highest_mm(
                &points,
                13.0 * degrees.to_radians().cos(),
                13.0 * degrees.to_radians().sin(),
            ) - 4.0
        })
        .collect();
    let (least, most) = along
        .iter()
        .fold((f64::INFINITY, 0.0_f64), |(least, most), mm| (least.min(*mm), most.max(*mm)));
    assert!(least > 1.0 && most - least < 0.3 * most, "as high all along: {along:?} mm");
    // In the gap of the letter, inside of it, and in a corner of the plate.
    for (x_mm, y_mm) in [(12.0, 5.0), (-4.0, 0.0), (19.0, -19.0)] {
        let height_mm = highest_mm(&points, x_mm, y_mm) - 4.0;
        assert!(
            height_mm < 0.5 * least,
            "{height_mm} mm over the plate at {x_mm}, {y_mm}; the letter has {least} mm"
        );
    }
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn a_character_stands_on_each_of_the_five_blocks() {
    let (json, points) = shipped_with("logo", "2s");
    // Five Booleans and the pull.
    assert_eq!(strokes_of(&json), 6);
    // On a stroke of P, O, I, N and T; each block ends in z = 12.
    for (x_mm, y_mm) in [(-56.0, 0.0), (-20.6, 0.0), (0.0, 0.0), (21.0, 0.0), (52.0, 0.0)] {
        let height_mm = highest_mm(&points, x_mm, y_mm) - 12.0;
        assert!(height_mm > 1.0, "{height_mm} mm at {x_mm}, {y_mm}");
    }
    // The O is hollow, and beside the I the block is nearly as it was.
    let ring_mm = highest_mm(&points, -20.6, 0.0) - 12.0;
    let hollow_mm = highest_mm(&points, -26.0, 0.0) - 12.0;
    assert!(hollow_mm < ring_mm - 0.5, "{hollow_mm} mm in the O, {ring_mm} mm on it");
    let beside_mm = highest_mm(&points, 9.0, 0.0) - 12.0;
    assert!(beside_mm < 1.0, "{beside_mm} mm beside the I");
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn the_character_is_joined_pulled_painted_and_poked() {
    // Six Booleans, the nose, two eyes, the belly.
    assert_eq!(strokes_of(&shipped("character", "12s")), 10);
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn the_lemon_has_limbs_that_were_pulled_and_hangs_together() {
    let (json, points, euler_number) = shipped_of("lemon", "8s");
    // The bump and four limbs; hands, feet, a nose, two eyes and a mouth.
    assert_eq!(strokes_of(&json), 13);
    // One body without a hole: hands and feet would be pieces of their own if limbs did not reach
    // them.
    assert_eq!(euler_number, 2);
    let all_mm: Vec<DVec3> = points.positions_map.iter().map(|at| *at * 1e3).collect();
    let reach_mm = |way: DVec3, within: &dyn Fn(DVec3) -> bool| {
        all_mm
            .iter()
            .filter(|at| within(**at))
            .map(|at| at.dot(way))
            .fold(f64::NEG_INFINITY, f64::max)
    };
    let arms_mm = [DVec3::X, DVec3::NEG_X].map(|way| reach_mm(way, &|_| true));
    let legs_mm = [1.0, -1.0].map(|side| reach_mm(DVec3::NEG_Z, &|at| at.x * side > 2.0));
    // Both sides alike; the ellipsoid ends at 10 and 14 mm.
    for [right_mm, left_mm] in [arms_mm, legs_mm] {
        assert!(right_mm > 20.0 && (right_mm - left_mm).abs() < 0.5, "{arms_mm:?}, {legs_mm:?}");
    }
    // Limbs are no sheets: half-way an arm, and a leg, is thinner than the body and as thick as it
    // is wide, within a factor of 2.
    for (middle, axis, across) in [
        (DVec3::new(14.0, 0.0, 0.0), DVec3::X, [DVec3::Y, DVec3::Z]),
        (DVec3::new(-14.0, 0.0, 0.0), DVec3::X, [DVec3::Y, DVec3::Z]),
        (DVec3::new(5.0, 0.0, -17.0), DVec3::Z, [DVec3::X, DVec3::Y]),
        (DVec3::new(-5.0, 0.0, -17.0), DVec3::Z, [DVec3::X, DVec3::Y]),
    ] {
        let of_limb =
            |at: DVec3| (at - middle).dot(axis).abs() < 1.0 && (at - middle).length() < 6.0;
        let [a_mm, b_mm] = across.map(|way| reach_mm(way, &of_limb) + reach_mm(-way, &of_limb));
        assert!(
            a_mm.min(b_mm) > 3.0 && a_mm.max(b_mm) < 9.0 && a_mm.max(b_mm) < 2.0 * a_mm.min(b_mm),
            "{middle}: {a_mm}, {b_mm} mm"
        );
    }
    let bump_mm = reach_mm(DVec3::Z, &|_| true) - 14.0;
    assert!(bump_mm > 1.5, "{bump_mm} mm");
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn the_globe_is_embossed_painted_and_pulled() {
    // The image, ice, sand, mountains.
    assert_eq!(strokes_of(&shipped("globe", "11s")), 4);
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn the_bowl_is_painted_three_times_around() {
    let json = shipped("bowl", "14s");
    assert_eq!(strokes_of(&json), 3);
    let volume = |key: &str| json["sculpt"][key].as_f64().unwrap();
    assert_eq!(volume("volume_before_mm3"), volume("volume_mm3"), "paint moves nothing");
}

#[test]
fn every_clay_scene_is_tried_here() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("config/clay");
    let is_scene = |path: &PathBuf| path.extension().is_some_and(|ending| ending == "toml");
    let mut names: Vec<String> = fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(is_scene)
        .map(|path| path.file_stem().unwrap().to_string_lossy().into_owned())
        .collect();
    names.sort();
    assert_eq!(names, ["bowl", "character", "globe", "lemon", "letter", "letter-g", "logo"]);
}
