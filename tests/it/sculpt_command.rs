//! `hapticd sculpt` as a stranger meets it: strokes, files, and every mistake that is easily made.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use serde_json::Value;
use tempfile::TempDir;

use super::program::{Ended, hapticd};

/// A ball of clay of 15 mm, coarse enough for a second of work in a fraction of one.
const CLAY: &str = "shape = { sphere_mm = 15 }\nspacing_mm = 1.2\n";
const WORKED: &str = "raster = [20, 20, 20]\nair_mm = 6\nupdate_hz = 100\n";
const RIGID: &str = "[[static]]\nshape = { sphere_mm = 5 }\nvoxel_size_mm = 1\n";

/// A scene with these lines under `[sculpt]`.
fn scene(sculpt: &str) -> String {
    format!(
        "version = 1\n[tool]\nshape = {{ sphere_mm = 3 }}\nvoxel_size_mm = 0.5\nstart_position_mm \
            = [0, 0, 22]\n[device]\nprofile = \"sim-sigma7\"\nhand = \
            \"press.csv\"\n[sculpt]\n{sculpt}"
    )
}

/// A folder with the sound scene `ball.toml`, the rigid one `rigid.toml`, a hand that presses, and
/// strokes.
fn folder() -> TempDir {
    let dir = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| fs::write(dir.path().join(name), text).unwrap();
    write("ball.toml", &scene(&format!("{CLAY}{WORKED}")));
    let rigid = scene("").replace("[sculpt]\n", RIGID);
    write("rigid.toml", &rigid);
    let stay = "0,0,0,1";
    let path = [(0.0, 22), (0.2, 22), (0.6, 14), (0.9, 14), (1.2, 22)];
    let lines: String = path.iter().fold(String::new(), |mut text, (t_s, z_mm)| {
        writeln!(text, "{t_s},0,0,0.0{z_mm},{stay}").unwrap();
        text
    });
    write("press.csv", &format!("t_s,x_m,y_m,z_m,qx,qy,qz,qw\n{lines}"));
    write(
        "strokes.toml",
        "version = 1\n[[stroke]]\nat_s = 1.4\ndo = \"union\"\nshape = { sphere_mm = 6 \
            }\nspacing_mm = 1.2\nposition_mm = [15, 0, 0]\n[[stroke]]\nat_s = 1.5\ndo = \
            \"save-points\"\nfile = \"mid.ply\"\n",
    );
    dir
}

/// The command ends with this code and says each fragment on stderr.
fn says(dir: &Path, line: &str, code: i32, fragments: &[&str]) -> Ended {
    let ended = hapticd(dir, line);
    assert_eq!(ended.code, Some(code), "{line}\n{}", ended.stderr);
    for fragment in fragments {
        assert!(ended.stderr.contains(fragment), "{line}: no `{fragment}` in\n{}", ended.stderr);
    }
    assert!(!ended.stderr.contains("panicked"), "{line}\n{}", ended.stderr);
    ended
}

/// The same, with nothing on stdout.
fn refuses(dir: &Path, line: &str, code: i32, fragments: &[&str]) {
    assert_eq!(says(dir, line, code, fragments).stdout, "", "{line}");
}

/// The message about a scene with these lines under `[sculpt]`.
fn refused(dir: &Path, sculpt: &str, code: i32, fragments: &[&str]) {
    fs::write(dir.join("wrong.toml"), scene(sculpt)).unwrap();
    refuses(dir, "sculpt wrong.toml --clock virtual --duration 100ms", code, fragments);
}

const VIRTUAL: &str = "--clock virtual --duration 1600ms --json";

#[test]
fn a_clay_model_is_pressed_joined_saved_and_gone_on_with() {
    let dir = folder();
    let line = format!(
        "sculpt ball.toml {VIRTUAL} --strokes strokes.toml --save end.ply --session end.session \
            --export mesh.ply"
    );
    let first = says(dir.path(), &line, 0, &[]).json();
    let again = says(dir.path(), &format!("{line} --overwrite"), 0, &[]).json();
    let sculpt = &first["sculpt"];
    assert_eq!(*sculpt, again["sculpt"]);
    assert_eq!(first["faults"].as_array().unwrap().len(), 0);
    assert_eq!(first["final_pose"], again["final_pose"]);
    assert!(first["contact_ticks"].as_u64().unwrap() > 100, "{first}");
    let number = |key: &str| sculpt[key].as_f64().unwrap_or_else(|| panic!("{key} in {sculpt}"));
    let pressed = says(dir.path(), &format!("sculpt ball.toml {VIRTUAL}"), 0, &[]).json();
    let pressed_mm3 = pressed["sculpt"]["volume_mm3"].as_f64().unwrap();
    assert!(pressed_mm3 < number("volume_before_mm3"), "{pressed}");
    // The press and the union.
    assert_eq!(number("strokes"), 2.0, "{sculpt}");
    assert_eq!((number("update_hz"), number("late")), (100.0, 0.0));
    assert!(number("updates") >= 160.0, "{sculpt}");
    let ball_mm3 = 4.0 / 3.0 * std::f64::consts::PI * 15.0_f64.powi(3);
    assert!(
        (number("volume_before_mm3") / ball_mm3 - 1.0).abs() < 0.03,
        "{sculpt} beside {ball_mm3}"
    );
    // A ball of 6 mm half way in adds about half of itself.
    let added_mm3 = number("volume_mm3") - pressed_mm3;
    let half_mm3 = 2.0 / 3.0 * std::f64::consts::PI * 6.0_f64.powi(3);
    assert!(added_mm3 > 0.5 * half_mm3 && added_mm3 < 1.6 * half_mm3, "{added_mm3} of {half_mm3}");
    let kinds: Vec<&str> = sculpt["saved"]
        .as_array()
        .unwrap()
        .iter()
        .map(|saved| saved["kind"].as_str().unwrap())
        .collect();
    // What strokes wrote comes first.
    assert_eq!(kinds, ["points", "session", "points", "mesh"]);
    assert_eq!(
        (&sculpt["saved"][0]["file"], &sculpt["taken_back"]),
        (&"mid.ply".into(), &0.into())
    );
    assert_eq!(
        sculpt["failed"].as_array().unwrap().len() + sculpt["unsaved"].as_array().unwrap().len(),
        0
    );
    assert!(dir.path().join("mid.ply").is_file());

    // A rigid part of it.
    let baked = says(dir.path(), "bake mesh.ply --voxel-size-mm 1 --units m --json", 0, &[]).json();
    assert_eq!(baked["watertight"], true, "{baked}");
    // Clay again, from the samples and from the session.
    for source in [
        format!("points = \"end.ply\"\nunits = \"m\"\n{WORKED}"),
        "session = \"end.session\"\n".to_owned(),
    ] {
        fs::write(dir.path().join("next.toml"), scene(&source)).unwrap();
        let next =
            says(dir.path(), "sculpt next.toml --clock virtual --duration 50ms --json", 0, &[])
                .json();
        assert_eq!(next["sculpt"]["samples"], sculpt["samples"]);
        let volume_mm3 = next["sculpt"]["volume_mm3"].as_f64().unwrap();
        assert!(
            (volume_mm3 / number("volume_mm3") - 1.0).abs() < 0.03,
            "{volume_mm3} after {sculpt}"
        );
    }
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn people_read_what_became_of_the_clay() {
    let dir = folder();
    let ended = says(
        dir.path(),
        "sculpt ball.toml --clock virtual --duration 1300ms",
        0,
        &["the strokes were not kept", "--session FILE"],
    );
    for row in ["clay               1 stroke,", "volume ", "updates ", "at 100 Hz, 0 left out"] {
        assert!(ended.stdout.contains(row), "no `{row}` in\n{}", ended.stdout);
    }
    fs::write(dir.path().join("undo.toml"), "version = 1\n[[stroke]]\nat_s = 1.5\ndo = \"undo\"\n")
        .unwrap();
    let line =
        "sculpt ball.toml --clock virtual --duration 1600ms --strokes undo.toml --pictures drawn";
    let ended = says(dir.path(), line, 0, &["made the folder drawn"]);
    assert!(ended.stdout.contains("1 stroke (1 taken back),"), "{}", ended.stdout);
    let ended = says(
        dir.path(),
        "-v sculpt ball.toml --clock virtual --duration 20ms",
        0,
        &["clay (", "mass points", "closed, no border"],
    );
    assert!(!ended.stderr.contains("were not kept"), "{}", ended.stderr);
}

#[test]
fn commands_for_rigid_scenes_and_for_clay_name_each_other() {
    let dir = folder();
    fs::write(dir.path().join("poses.csv"), "t_s,x_m,y_m,z_m,qx,qy,qz,qw\n0,0,0,0.022,0,0,0,1\n")
        .unwrap();
    refuses(
        dir.path(),
        "run ball.toml --clock virtual --duration 10ms",
        3,
        &["has clay", "`hapticd sculpt ball.toml`"],
    );
    refuses(
        dir.path(),
        "sculpt rigid.toml --clock virtual --duration 10ms",
        3,
        &["no clay", "`hapticd run rigid.toml`"],
    );
    refuses(
        dir.path(),
        "eval ball.toml --poses poses.csv --out o.csv",
        3,
        &["rigid parts only", "`hapticd sculpt ball.toml`"],
    );
    refuses(
        dir.path(),
        "run rigid.toml --clock virtual --duration 1s --swap ball.toml@500ms",
        3,
        &["ball.toml: sculpt = clay, but rigid.toml has none"],
    );
    refuses(
        dir.path(),
        "sculpt ball.toml --swap rigid.toml@1s",
        2,
        &["--swap is for rigid scenes", "save a session"],
    );
    refuses(dir.path(), "sculpt ball.toml --watch", 2, &["--watch is for rigid scenes", "SIGHUP"]);
    says(dir.path(), "sculpt ball.toml --clock virtual --duration 50ms --record clay.mcap", 0, &[]);
    refuses(dir.path(), "replay clay.mcap", 4, &["touched clay", "hapticd report"]);
    says(dir.path(), "report clay.mcap -o page.html", 0, &[]);
}

#[test]
fn check_knows_clay_and_its_strokes() {
    let dir = folder();
    let ended = says(dir.path(), "check ball.toml", 0, &[]);
    assert!(
        ended.stdout.contains("0 static + tool + clay")
            && ended.stdout.contains("raster 20 x 20 x 20 updated at 100 Hz, push in the hand"),
        "{}",
        ended.stdout
    );
    fs::write(
        dir.path().join("bad.toml"),
        "version = 1\n[[stroke]]\nat_s = 1\ndo = \"undo\"\nbrush_mm = 3\n",
    )
    .unwrap();
    fs::write(dir.path().join("scene.toml"), scene(&format!("{CLAY}strokes = \"bad.toml\"\n")))
        .unwrap();
    for line in [
        "check scene.toml",
        "sculpt scene.toml --clock virtual",
        "sculpt ball.toml --clock virtual --strokes bad.toml",
    ] {
        refuses(
            dir.path(),
            line,
            3,
            &["bad.toml:5: stroke at 1 s (line 2): brush_mm = 3: must be left out beside do = \
                    \"undo\""],
        );
    }
    refuses(
        dir.path(),
        "sculpt ball.toml --clock virtual --strokes none.toml",
        3,
        &["none.toml: no such file; it would hold the strokes of the clay"],
    );
    fs::write(dir.path().join("bad.toml"), "[[stroke]]\nat_s = 1\n").unwrap();
    refuses(dir.path(), "check scene.toml", 3, &["bad.toml: version: missing"]);
    fs::write(dir.path().join("bad.toml"), "version = 1\n[[stroke]\n").unwrap();
    refuses(dir.path(), "check scene.toml", 3, &["bad.toml:2: not TOML"]);
    let bake = says(dir.path(), "bake ball.toml --json", 0, &[]).json();
    assert_eq!(
        (&bake["clay"]["normals"], &bake["clay"]["closed"]),
        (&"faces".into(), &true.into())
    );
}

#[test]
fn every_key_is_held_against_its_range_in_the_words_of_the_scene() {
    let dir = folder();
    fs::write(dir.path().join("three.xyz"), "0 0 0\n1 0 0\n0 1 0\n").unwrap();
    fs::write(dir.path().join("notes.png"), "no image").unwrap();
    let with = |lines: &str| format!("{CLAY}{lines}");
    for (sculpt, message) in [
        (
            String::new(),
            "sculpt.points: missing; give points, a mesh, a shape such as shape = { sphere_mm = 20 \
                }, or session",
        ),
        ("points = \"three.xyz\"\n".into(), "sculpt.units: missing; give the unit of the points"),
        (
            "points = \"three.xyz\"\nunits = \"km\"\n".into(),
            "sculpt.units = \"km\": must be \"m\", \"mm\", \"cm\" or \"in\"",
        ),
        (
            "points = \"none.ply\"\nunits = \"mm\"\n".into(),
            "sculpt.points = \"none.ply\": no such file: none.ply",
        ),
        (
            "points = \"scan.las\"\nunits = \"mm\"\n".into(),
            "must be a file of points whose name ends in .obj",
        ),
        ("mesh = \"three.xyz\"\nunits = \"mm\"\n".into(), "must be a mesh file whose name ends in"),
        ("session = \"none.session\"\n".into(), "no such file: none.session"),
        (
            "session = \"three.xyz\"\nraster = [9, 9, 9]\n".into(),
            "must be left out beside sculpt.session, which brings its own",
        ),
        (
            with("points = \"three.xyz\"\n"),
            "sculpt.shape = { sphere_mm = 15 }: cannot stand beside sculpt.points",
        ),
        (with("units = \"mm\"\n"), "sculpt.units = \"mm\": must be left out beside a shape"),
        (with("tool = \"psh\"\n"), "sculpt.tool = \"psh\": must be \"touch\", \"push\", \"pull\""),
        (with("tool = \"psh\"\n"), "did you mean `push`?"),
        (with("brush_mm = 0\n"), "sculpt.brush_mm = 0: must be greater than 0 and at most 1000 mm"),
        (
            with("falloff = \"soft\"\n"),
            "must be \"gaussian\", \"constant\", \"spherical\", { rate = 2.0 } or an array of \
                weights",
        ),
        (
            with("falloff = [0, 2]\n"),
            "weight 2 of the fall-off is 2; weights are numbers from 0 to 1",
        ),
        (with("color = \"blue\"\n"), "must be a colour as \"#rrggbb\""),
        (with("image = \"notes.png\"\n"), "notes.png is no PNG image that can be read"),
        (
            with("raster = [3, 20, 20]\n"),
            "must be three whole numbers of mass points, each from 4 to 256",
        ),
        (with("raster = [20.5, 20, 20]\n"), "must be three whole numbers of mass points"),
        (
            with("raster = [256, 256, 256]\n"),
            "at most 2097152 mass points in all, such as 128 along each axis; these are 16777216",
        ),
        (
            with("region_mm = [[0, 0, 0], [0, 1, 1]]\n"),
            "the lowest corner first and every edge longer than 0 mm",
        ),
        (
            with("region_mm = [[0, 0, 0]]\n"),
            "the lowest corner first and every edge longer than 0 mm",
        ),
        (with("update_hz = 5\n"), "sculpt.update_hz = 5: must be from 10 to 1000 Hz"),
        (
            with("update_hz = 700\n"),
            "must be near to what whole ticks at 1000 Hz make, such as 500 or 1000",
        ),
        (with("mass = 0\n"), "sculpt.mass = 0: must be from 0.000000001 to 1 kg"),
        (with("damping = -1\n"), "sculpt.damping = -1: must be from 0 to 10000 N·s/m"),
        (
            with("stiffness = 0\n"),
            "sculpt.stiffness = 0: must be greater than 0 and at most 1000000 N/m",
        ),
        (
            with("painted = { stiffness = 0 }\n"),
            "sculpt.painted.stiffness = 0: must be greater than 0 and at most 1000000 N/m",
        ),
        (
            with("painted = { mass = 2 }\n"),
            "sculpt.painted.mass = 2: must be from 0.000000001 to 1 kg",
        ),
        (with("painted = { hardness = 2 }\n"), "sculpt.painted.hardness = 2: unknown key"),
        (with("painted = 10\n"), "must be a table such as { stiffness = 500.0 }"),
        (with("creep_ms = \"never\"\n"), "must be a number of milliseconds or \"off\""),
        (with("creep_ms = -5\n"), "must be from 1 to 1000000 ms, or \"off\""),
        (
            with("integrator = \"explicit\"\n"),
            "sculpt.integrator = \"explicit\": is no longer a key; leave it out: mass points are \
                stepped implicitly",
        ),
        (with("neighbours = 2\n"), "must be a whole number from 8 to 128"),
        (with("strokes = \"none.toml\"\n"), "no such file: none.toml"),
        (
            with("colour = \"#000000\"\n"),
            "sculpt.colour = \"#000000\": unknown key; did you mean `color`?",
        ),
        (
            with("[rendering]\ncoupling = \"constraint\"\n"),
            "rendering.coupling = \"constraint\": must be another coupling",
        ),
    ] {
        refused(dir.path(), &sculpt, 3, &[message]);
    }
}

#[test]
fn a_fine_tip_and_a_slow_loop_need_no_more_keys() {
    let dir = folder();
    // A ball that has no sample at the spacing of the clay, and a loop that 100 updates a second do
    // not divide.
    let fine = scene(CLAY)
        .replace("sphere_mm = 3 }\nvoxel_size_mm = 0.5", "sphere_mm = 0.3 }\nvoxel_size_mm = 0.05");
    let strokes = "version = 1\n[[stroke]]\nat_s = 0.01\ndo = \"take\"\ntool = \"union\"\n\
                   [[stroke]]\nat_s = 0.02\ndo = \"hold\"\nuntil_s = 0.05\n";
    fs::write(
        dir.path().join("fine.toml"),
        format!("{fine}{WORKED}").replace("update_hz = 100\n", "[rendering]\nrate_hz = 250\n"),
    )
    .unwrap();
    fs::write(dir.path().join("strokes.toml"), strokes).unwrap();
    let line = "sculpt fine.toml --clock virtual --duration 100ms --json --strokes strokes.toml";
    let sculpt = says(dir.path(), line, 0, &[]).json()["sculpt"].clone();
    assert!((sculpt["update_hz"].as_f64().unwrap() - 250.0 / 3.0).abs() < 1e-9, "{sculpt}");
    assert_eq!(sculpt["failed"], Value::Array(Vec::new()), "{sculpt}");
}

/// Points on a sphere of 15 mm, in mm, where `keep` says so.
fn sphere(n: u32, keep: impl Fn(f64, f64, f64) -> bool) -> String {
    let mut text = String::new();
    for i in 0..n {
        let z = 1.0 - (2.0 * f64::from(i) + 1.0) / f64::from(n);
        let (sin, cos) = (f64::from(i) * 2.399_963_229_728_653).sin_cos();
        let across = (1.0 - z * z).sqrt();
        if keep(across * cos, across * sin, z) {
            writeln!(text, "{:.6} {:.6} {:.6}", 15.0 * across * cos, 15.0 * across * sin, 15.0 * z)
                .unwrap();
        }
    }
    text
}

const POINTS: &str = "points = \"scan.xyz\"\nunits = \"mm\"\n";

#[test]
fn points_that_make_no_surface_are_refused_in_words() {
    let dir = folder();
    let line: String = (0..100).fold(String::new(), |text, k| text + &format!("{k} 0 0\n"));
    for (points, message, hint) in [
        (
            "0 0 0\n1 0 0\n0 1 0\n".to_owned(),
            "scan.xyz: 3 points, at least 32 are needed",
            "more densely",
        ),
        ("1 2 3\n".repeat(100), "scan.xyz: all 100 points are at one place", "check the columns"),
        (line, "lie with their neighbours on a line", "lines of points"),
        ("1 2 x\n".to_owned(), "scan.xyz:1: `x` is no number", ""),
        (String::new(), "scan.xyz: 0 points", ""),
    ] {
        fs::write(dir.path().join("scan.xyz"), points).unwrap();
        refused(dir.path(), &format!("{POINTS}{WORKED}"), 4, &[message, hint]);
    }
    fs::write(dir.path().join("old.session"), "no session").unwrap();
    refused(dir.path(), "session = \"old.session\"\n", 4, &["old.session", "hint:"]);
}

#[test]
fn what_a_scan_lacks_is_made_good_and_said() {
    let dir = folder();
    fs::write(dir.path().join("scene.toml"), scene(&format!("{POINTS}{WORKED}"))).unwrap();
    let line =
        "sculpt scene.toml --clock virtual --duration 100ms --json --export mesh.ply --overwrite";
    // No normals, and some points twice.
    let points = sphere(2500, |_, _, _| true);
    let twice: String =
        points.lines().take(10).fold(points.clone(), |text, line| text + line + "\n");
    fs::write(dir.path().join("scan.xyz"), twice).unwrap();
    let whole =
        says(dir.path(), line, 0, &["clay: 10 points at the place of another one were left out"])
            .json();
    assert_eq!(whole["sculpt"]["samples"], 2500);
    let ended = hapticd(dir.path(), "bake scene.toml --json").json();
    assert_eq!(
        (&ended["clay"]["normals"], &ended["clay"]["merged"]),
        (&"estimated".into(), &10.into())
    );
    // A hole of about 6 mm in radius around +z: closed by a cap, and the export says so.
    fs::write(dir.path().join("scan.xyz"), sphere(2500, |_, _, z| z < 0.92)).unwrap();
    let fragments = [
        "clay: the surface is open: a border ",
        " mm long around (",
        "as a cap of no certain shape, in an export too",
    ];
    let open = says(dir.path(), line, 0, &fragments);
    assert_eq!(open.json()["sculpt"]["saved"][0]["kind"], "mesh");
    let baked = says(dir.path(), "bake mesh.ply --voxel-size-mm 1 --units m --json", 0, &[]).json();
    assert_eq!(baked["watertight"], true, "{baked}");
    // A sheet goes around nothing.
    let mut sheet = String::new();
    for x in 0..40 {
        for y in 0..40 {
            writeln!(sheet, "{x} {y} {:.3}", 0.01 * f64::from(x * x)).unwrap();
        }
    }
    fs::write(dir.path().join("scan.xyz"), sheet).unwrap();
    let sheet = hapticd(dir.path(), line);
    assert!(sheet.stderr.contains("do not go around a body"), "{}", sheet.stderr);
    assert!(
        !sheet.stderr.contains("panicked") && matches!(sheet.code, Some(0 | 4)),
        "{:?}\n{}",
        sheet.code,
        sheet.stderr
    );
}

/// A box around the origin as a binary STL, mm; `is_inward`: it faces inward.
fn stl_box(half_mm: [f32; 3], is_inward: bool) -> Vec<u8> {
    let mut triangles: Vec<[[f32; 3]; 3]> = Vec::new();
    for axis in 0..3 {
        for side in [-1.0, 1.0_f32] {
            let corner = |u: f32, v: f32| {
                let mut at = [0.0; 3];
                at[axis] = side * half_mm[axis];
                at[(axis + 1) % 3] = u * half_mm[(axis + 1) % 3];
                at[(axis + 2) % 3] = v * half_mm[(axis + 2) % 3];
                at
            };
            let face = [corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)];
            for [a, b, c] in [[0, 1, 2], [0, 2, 3]] {
                let is_turned = (side < 0.0) != is_inward;
                let [b, c] = if is_turned { [c, b] } else { [b, c] };
                triangles.push([face[a], face[b], face[c]]);
            }
        }
    }
    let mut bytes = vec![0; 80];
    bytes.extend((triangles.len() as u32).to_le_bytes());
    for triangle in triangles {
        bytes.extend([0; 12]);
        bytes.extend(triangle.as_flattened().iter().flat_map(|number| number.to_le_bytes()));
        bytes.extend([0; 2]);
    }
    bytes
}

#[test]
fn what_was_found_in_a_mesh_is_said_by_every_command_and_the_clay_is_its_solid() {
    let dir = folder();
    let mut inward = stl_box([10.0, 8.0, 5.0], true);
    // Not filled in by the program that wrote it: a note of the reader.
    inward[80..84].copy_from_slice(&0_u32.to_le_bytes());
    fs::write(dir.path().join("box.stl"), inward).unwrap();
    let mesh = "mesh = \"box.stl\"\nunits = \"mm\"\nspacing_mm = 0.7\n";
    let raster = "raster = [40, 40, 40]\nair_mm = 3\n";
    fs::write(dir.path().join("scene.toml"), scene(&format!("{mesh}{raster}"))).unwrap();
    let fragments = [
        "clay: the number of triangles in the header is 0, and was not filled in",
        "clay: every closed piece faced inward: all were turned",
    ];
    says(dir.path(), "check scene.toml", 0, &fragments);
    let baked = says(dir.path(), "bake scene.toml --json", 0, &fragments).json();
    let volume_mm3 = baked["clay"]["volume_m3"].as_f64().unwrap() * 1e9;
    assert!((volume_mm3 / 3200.0 - 1.0).abs() < 0.03, "{volume_mm3} mm³ of 3200");
    let line = "sculpt scene.toml --clock virtual --duration 20ms --json --export box.ply";
    let sculpted = says(dir.path(), line, 0, &fragments).json();
    assert_eq!(sculpted["sculpt"]["saved"][0]["kind"], "mesh", "{sculpted}");

    let strokes = "version = 1\n[[stroke]]\nat_s = 0.01\ndo = \"difference\"\nmesh = \
        \"box.stl\"\nunits = \"mm\"\nposition_mm = [15, 0, 0]\n";
    fs::write(dir.path().join("strokes.toml"), strokes).unwrap();
    let fragments = [
        "strokes.toml:5: stroke at 0.01 s (line 2): mesh = \"box.stl\": the number of triangles",
        "strokes.toml:5: stroke at 0.01 s (line 2): mesh = \"box.stl\": every closed piece faced inward",
    ];
    says(dir.path(), "check strokes.toml", 0, &fragments);
    let line = "sculpt ball.toml --clock virtual --duration 50ms --strokes strokes.toml";
    says(dir.path(), line, 0, &fragments);
}

#[test]
fn a_raster_that_loses_walls_is_refused_with_one_that_holds_them() {
    let dir = folder();
    let sheet = |raster: &str| {
        scene(&format!(
            "shape = {{ box_mm = [40, 30, 1] }}\nspacing_mm = 0.5\nair_mm = 2\n{raster}"
        ))
    };
    fs::write(dir.path().join("sheet.toml"), sheet("raster = [20, 20, 20]\n")).unwrap();
    let fragments = [
        "clay: walls of about 1 mm may lose ",
        "% of its volume: mass points of its raster [20, 20, 20] are ",
        "hint: give `sculpt.raster = [",
    ];
    for line in ["check sheet.toml", "sculpt sheet.toml --clock virtual --duration 20ms"] {
        refuses(dir.path(), line, 3, &fragments);
    }
    let said = hapticd(dir.path(), "bake sheet.toml");
    let (_, hint) = said.stderr.split_once("give `sculpt.").unwrap();
    let (raster, _) = hint.split_once('`').unwrap();
    fs::write(dir.path().join("sheet.toml"), sheet(&format!("{raster}\n"))).unwrap();
    let baked = says(dir.path(), "bake sheet.toml --json", 0, &[]).json();
    let volume_mm3 = baked["clay"]["volume_m3"].as_f64().unwrap() * 1e9;
    assert!((volume_mm3 / 1200.0 - 1.0).abs() < 0.05, "{raster}: {volume_mm3} mm³ of 1200");
    // So thin that no raster of all of it is fine enough.
    let thin = sheet("").replace("30, 1]", "30, 0.1]").replace("0.5", "0.3");
    fs::write(dir.path().join("sheet.toml"), thin).unwrap();
    let fragments = ["walls of about 0.1 mm", "at most 256 along an axis", "`sculpt.region_mm`"];
    refuses(dir.path(), "check sheet.toml", 3, &fragments);
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn many_points_in_a_coarse_raster_work_and_say_so() {
    const N: u32 = 100_000;
    let dir = folder();
    fs::write(dir.path().join("scan.xyz"), sphere(N, |_, _, _| true)).unwrap();
    fs::write(dir.path().join("scene.toml"), scene(&format!("{POINTS}raster = [16, 16, 16]\n")))
        .unwrap();
    let fragments = [
        "mass points stand ",
        "times as far as samples",
        "take more in `sculpt.raster` ([16, 16, 16] now)",
    ];
    let ended =
        says(dir.path(), "sculpt scene.toml --clock virtual --duration 20ms --json", 0, &fragments)
            .json();
    assert_eq!(ended["sculpt"]["samples"], N);
    let ball_mm3 = 4.0 / 3.0 * std::f64::consts::PI * 15.0_f64.powi(3);
    let volume_mm3 = ended["sculpt"]["volume_mm3"].as_f64().unwrap();
    assert!((volume_mm3 / ball_mm3 - 1.0).abs() < 0.1, "{volume_mm3} of {ball_mm3}");
}

#[test]
fn files_are_looked_at_before_the_work_and_nothing_is_written_over_unasked() {
    let dir = folder();
    fs::write(dir.path().join("there.ply"), "mine").unwrap();
    let sculpt = |rest: &str| format!("sculpt ball.toml --clock virtual --duration 1600ms {rest}");
    for (rest, code, fragment) in [
        ("--save there.ply", 2, "there.ply is there already"),
        ("--export there.ply", 2, "give --overwrite"),
        ("--save end.xyz", 2, "end.xyz: samples and meshes are .ply files"),
        ("--save no/such/end.ply", 4, "cannot write no/such/end.ply"),
        ("--save a.ply --export a.ply", 2, "a.ply would be written twice"),
        ("--save a.ply --export xdg/../a.ply", 2, "a.ply would be written twice"),
        ("--session xdg", 4, "cannot write xdg"),
        ("--pictures there.ply", 4, "cannot make the folder there.ply"),
        ("--pictures there.ply/pictures", 4, "cannot make the folder there.ply/pictures"),
        ("--save there.ply/end.ply", 4, "cannot write there.ply/end.ply"),
        ("--save /proc/end.ply", 4, "cannot write /proc/end.ply"),
        ("--record no/such/clay.mcap", 4, "hint: the folder must exist"),
        ("--session same --record same", 2, "same would be written twice"),
        ("--session press.csv --overwrite", 2, "press.csv is what the scene is read from"),
        ("--record press.csv --overwrite", 2, "press.csv is what the scene is read from"),
        (
            "--strokes strokes.toml --session strokes.toml --overwrite",
            2,
            "strokes.toml is what the scene is read from",
        ),
        ("--session ball.toml --overwrite", 2, "ball.toml is what the scene is read from"),
    ] {
        fs::create_dir_all(dir.path().join("xdg")).unwrap();
        refuses(dir.path(), &sculpt(rest), code, &[fragment]);
    }
    assert_eq!(fs::read_to_string(dir.path().join("there.ply")).unwrap(), "mine");
    // A long name is no late surprise, and what is looked at leaves nothing behind.
    refuses(
        dir.path(),
        &sculpt(&format!("--save {}.ply", "x".repeat(300))),
        4,
        &["cannot write xxx"],
    );
    refuses(
        dir.path(),
        &sculpt("--session one --save there.ply"),
        2,
        &["there.ply is there already"],
    );
    assert!(!dir.path().join("one").exists());
    // Strokes that write as well.
    fs::write(dir.path().join("mid.ply"), "mine").unwrap();
    refuses(dir.path(), &sculpt("--strokes strokes.toml"), 2, &["mid.ply is there already"]);
    says(dir.path(), &sculpt("--strokes strokes.toml --overwrite"), 0, &[]);
    assert_ne!(fs::read(dir.path().join("mid.ply")).unwrap(), b"mine");
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn a_session_that_cannot_be_written_is_kept_elsewhere() {
    let dir = folder();
    // What is written breaks off: a pipe whose reader goes away each time.
    let pipe = dir.path().join("full.ply");
    assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    std::thread::spawn(move || {
        while let Ok(reader) = fs::File::open(&pipe) {
            drop(reader);
            std::thread::sleep(std::time::Duration::from_millis(100));
        }
    });
    let sculpt = |output: &str| {
        format!("sculpt ball.toml --clock virtual --duration 1300ms --json --overwrite {output}")
    };
    let ended = says(
        dir.path(),
        &sculpt("--save full.ply"),
        4,
        &["cannot write", "nothing is lost: the whole session is in"],
    );
    let sculpted = &ended.json()["sculpt"];
    assert_eq!(
        (&sculpted["unsaved"][0]["kind"], &sculpted["saved"]),
        (&"points".into(), &Value::Array(Vec::new()))
    );
    let rescued = Path::new(sculpted["rescued"].as_str().unwrap());
    assert!(rescued.starts_with(dir.path().join("xdg-state")), "{}", rescued.display());
    // A session that was written is enough.
    let ended =
        says(dir.path(), &sculpt("--save full.ply --session fine.session"), 4, &["cannot write"]);
    assert!(ended.json()["sculpt"]["rescued"].is_null(), "{}", ended.stdout);
    assert_eq!(fs::read(rescued).unwrap(), fs::read(dir.path().join("fine.session")).unwrap());
    fs::write(
        dir.path().join("next.toml"),
        scene(&format!("session = \"{}\"\n", rescued.display())),
    )
    .unwrap();
    let next =
        says(dir.path(), "sculpt next.toml --clock virtual --duration 20ms --json", 0, &[]).json();
    assert_eq!(next["sculpt"]["samples"], sculpted["samples"]);
    // So is what only the strokes were to save.
    let strokes =
        "version = 1\n[[stroke]]\nat_s = 0.05\ndo = \"save-points\"\nfile = \"full.ply\"\n";
    fs::write(dir.path().join("strokes.toml"), strokes).unwrap();
    let ended = says(
        dir.path(),
        &sculpt("--strokes strokes.toml"),
        4,
        &["stroke not carried out: save-points at 0.05 s", "nothing is lost"],
    );
    assert!(ended.json()["sculpt"]["rescued"].is_string(), "{}", ended.stdout);
}

#[test]
fn strokes_that_cannot_be_carried_out_are_named_and_the_run_is_no_success() {
    let dir = folder();
    let strokes = "version = 1\n[[stroke]]\nat_s = 0.05\ndo = \"undo\"\n[[stroke]]\nat_s = \
        0.06\ndo = \"difference\"\nshape = { sphere_mm = 30 }\nspacing_mm = 3\n[[stroke]]\nat_s = \
        9\ndo = \"undo\"\n";
    fs::write(dir.path().join("strokes.toml"), strokes).unwrap();
    let line = "sculpt ball.toml --clock virtual --duration 100ms --json --strokes strokes.toml";
    let ended = says(
        dir.path(),
        line,
        4,
        &[
            "stroke not carried out",
            "strokes.toml:2: stroke not carried out: undo at 0.05 s",
            "no stroke to take back",
            "before 1 stroke was due",
        ],
    );
    let sculpt = &ended.json()["sculpt"];
    assert_eq!(sculpt["failed"].as_array().unwrap().len(), 2, "{sculpt}");
    assert_eq!(
        (&sculpt["failed"][0]["tick"], &sculpt["failed"][0]["scripted"]),
        (&50.into(), &true.into())
    );
    assert_eq!((&sculpt["left_over"], &sculpt["samples"]), (&1.into(), &sculpt["samples_before"]));
}

#[test]
fn a_hold_that_grabs_nothing_is_a_stroke_that_failed() {
    let dir = folder();
    // The tool is 4 mm away, and takes hold within 1 mm.
    let hold = |brush_mm: u32| {
        format!(
            "version = 1\n[[stroke]]\nat_s = 0.01\ndo = \"take\"\ntool = \"pull\"\nbrush_mm = \
                {brush_mm}\n[[stroke]]\nat_s = 0.05\ndo = \"hold\"\nuntil_s = \
                0.08\n[[stroke]]\nat_s = 8\ndo = \"hold\"\nuntil_s = 9\n"
        )
    };
    let line = "sculpt ball.toml --clock virtual --duration 100ms --json --strokes strokes.toml";
    fs::write(dir.path().join("strokes.toml"), hold(1)).unwrap();
    let fragments = [
        "strokes.toml:7: stroke not carried out: hold at 0.05 s: there is no surface within the \
            brush",
        "before 1 stroke was due",
    ];
    let sculpt = says(dir.path(), line, 4, &fragments).json()["sculpt"].clone();
    assert_eq!(
        (sculpt["failed"].as_array().unwrap().len(), &sculpt["failed"][0]["line"]),
        (1, &7.into()),
        "{sculpt}"
    );
    assert_eq!(
        (&sculpt["left_over"], &sculpt["troubles"]),
        (&1.into(), &Value::Array(Vec::new())),
        "{sculpt}"
    );
    fs::write(dir.path().join("strokes.toml"), hold(10)).unwrap();
    let sculpt = says(dir.path(), line, 0, &["before 1 stroke was due"]).json()["sculpt"].clone();
    assert_eq!(
        (&sculpt["failed"], &sculpt["strokes"]),
        (&Value::Array(Vec::new()), &1.into()),
        "{sculpt}"
    );
}

#[test]
fn a_solid_without_a_spacing_is_as_dense_as_the_clay() {
    let dir = folder();
    let strokes = "version = 1\n[[stroke]]\nat_s = 0.01\ndo = \"union\"\nshape = { sphere_mm = 8 \
        }\nposition_mm = [15, 0, 0]\n";
    fs::write(dir.path().join("strokes.toml"), strokes).unwrap();
    let line = "sculpt ball.toml --clock virtual --duration 50ms --json --strokes strokes.toml \
        --export mesh.ply";
    let sculpt = says(dir.path(), line, 0, &[]).json()["sculpt"].clone();
    // Half of a ball of 8 mm beside one of 15 mm.
    let before = sculpt["samples_before"].as_f64().unwrap();
    let after = sculpt["samples"].as_f64().unwrap();
    assert!(after > before && after < 1.3 * before, "{sculpt}");
    assert!(sculpt["volume_mm3"].is_f64(), "{sculpt}");
}

#[test]
fn solids_of_a_wrong_unit_are_refused_before_the_loop() {
    let dir = folder();
    fs::write(dir.path().join("scan.xyz"), sphere(2000, |_, _, _| true)).unwrap();
    let strokes = |units: &str| {
        format!(
            "version = 1\n[[stroke]]\nat_s = 0.01\ndo = \"union\"\npoints = \"scan.xyz\"\nunits = \
                \"{units}\"\nposition_mm = [9, 0, 0]\n"
        )
    };
    let line = "sculpt ball.toml --clock virtual --duration 50ms --strokes strokes.toml";
    fs::write(dir.path().join("strokes.toml"), strokes("m")).unwrap();
    let message = "strokes.toml:6: stroke at 0.01 s (line 2): units = \"m\": the solid is 29.99 m \
        across, the clay 29.98 mm";
    refuses(dir.path(), line, 3, &[message, "is this unit right"]);
    fs::write(dir.path().join("strokes.toml"), strokes("mm")).unwrap();
    says(dir.path(), line, 0, &[]);
}

#[test]
fn a_clay_model_of_a_wrong_unit_is_reported_by_its_size() {
    let dir = folder();
    fs::write(dir.path().join("scan.xyz"), sphere(2000, |_, _, _| true)).unwrap();
    let scan =
        |units: &str| scene(&format!("points = \"scan.xyz\"\nunits = \"{units}\"\n{WORKED}"));
    fs::write(dir.path().join("scene.toml"), scan("m")).unwrap();
    let bake = "bake scene.toml --json";
    says(dir.path(), bake, 0, &["clay: the clay is 29.99 m across; is `sculpt.units` right?"]);
    fs::write(dir.path().join("scene.toml"), scan("mm")).unwrap();
    assert!(!says(dir.path(), bake, 0, &[]).stderr.contains("sculpt.units"));
    fs::write(
        dir.path().join("part.obj"),
        "v 0 0 0\nv 10 0 0\nv 0 10 0\nv 0 0 10\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n",
    )
    .unwrap();
    let mesh = |units: &str, spacing_mm: f64| {
        format!("mesh = \"part.obj\"\nunits = \"{units}\"\nspacing_mm = {spacing_mm}\n{WORKED}")
    };
    refused(
        dir.path(),
        &mesh("mm", 20.0),
        4,
        &["part.obj: it is 10 mm across, so a spacing of 20 mm gives", "is `units` right?"],
    );
    refused(
        dir.path(),
        &mesh("m", 0.5),
        4,
        &[
            "part.obj: it is 10 m across, and a spacing of 0.5 mm makes too many points",
            "is `units` right?",
        ],
    );
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn a_tool_that_starts_in_the_clay_works_nothing_before_it_was_outside() {
    let dir = folder();
    let inside = |z_mm: u32| {
        fs::read_to_string(dir.path().join("ball.toml"))
            .unwrap()
            .replace("[0, 0, 22]", &format!("[0, 0, {z_mm}]"))
    };
    // A tool that is let alone is pushed out, of a large model from far inside too: the hand is
    // inside still.
    for (z_mm, radius_mm) in [(0, 15.0), (5, 15.0), (12, 15.0), (16, 15.0), (25, 300.0)] {
        let ball =
            format!("shape = {{ sphere_mm = {radius_mm} }}\nspacing_mm = {}\n", 0.08 * radius_mm);
        let still = inside(z_mm).replace("hand = \"press.csv\"\n", "").replace(CLAY, &ball);
        fs::write(dir.path().join("inside.toml"), still).unwrap();
        let fragments =
            ["it starts inside the clay", "nothing is worked before it has been outside"];
        let ended = says(
            dir.path(),
            "sculpt inside.toml --clock virtual --duration 1s --json",
            0,
            &fragments,
        )
        .json();
        let sculpt = &ended["sculpt"];
        assert_eq!(
            (&sculpt["strokes"], &sculpt["samples"]),
            (&0.into(), &sculpt["samples_before"]),
            "{z_mm} mm: {ended}"
        );
        assert_eq!(
            (&sculpt["volume_mm3"], ended["max_force_n"].as_f64()),
            (&sculpt["volume_before_mm3"], Some(0.0)),
            "{z_mm} mm: {ended}"
        );
    }
    // Drawn out, and pressed in again: one stroke.
    let path = [(0.0, 12), (0.1, 12), (0.3, 22), (0.5, 22), (0.9, 14), (1.2, 14), (1.5, 22)];
    let lines = path
        .iter()
        .fold(String::new(), |text, (t_s, z_mm)| text + &format!("{t_s},0,0,0.0{z_mm},0,0,0,1\n"));
    fs::write(dir.path().join("press.csv"), format!("t_s,x_m,y_m,z_m,qx,qy,qz,qw\n{lines}"))
        .unwrap();
    fs::write(dir.path().join("inside.toml"), inside(12)).unwrap();
    let ended =
        says(dir.path(), "sculpt inside.toml --clock virtual --duration 1800ms --json", 0, &[])
            .json();
    assert_eq!(ended["sculpt"]["strokes"], 1, "{ended}");
    assert!(
        ended["max_force_n"].as_f64().unwrap() > 0.1
            && ended["faults"].as_array().unwrap().is_empty(),
        "{ended}"
    );
}

#[test]
fn quiet_is_quiet_and_a_still_arm_is_said() {
    let dir = folder();
    let quiet = says(dir.path(), "-q sculpt ball.toml --clock virtual --duration 20ms", 0, &[]);
    assert_eq!((&*quiet.stdout, &*quiet.stderr), ("", ""));
    let still = fs::read_to_string(dir.path().join("ball.toml"))
        .unwrap()
        .replace("hand = \"press.csv\"\n", "");
    fs::write(dir.path().join("still.toml"), still).unwrap();
    let line = "sculpt still.toml --clock virtual --duration 20ms";
    says(
        dir.path(),
        line,
        0,
        &["note: no path moves the simulated arm, only a client such as the page: `hand` under \
                [device] leads it along a path"],
    );
    let led = says(dir.path(), &format!("{line} --strokes strokes.toml --overwrite"), 0, &[]);
    assert!(!led.stderr.contains("no path moves"), "{}", led.stderr);
}

#[test]
fn files_that_are_no_scene_say_what_they_are_for() {
    let dir = folder();
    let checked = says(dir.path(), "check strokes.toml", 0, &[]);
    assert_eq!(checked.stdout, "ok strokes.toml: 2 orders from 1.4 s to 1.5 s\n");
    refuses(
        dir.path(),
        "sculpt strokes.toml",
        3,
        &["this is a file of strokes, not a scene", "--strokes FILE"],
    );
    fs::write(dir.path().join("two.xyz"), "0 0\n").unwrap();
    refused(
        dir.path(),
        "points = \"two.xyz\"\nunits = \"mm\"\n",
        4,
        &["two.xyz:1: 2 columns of numbers found, understood are 3 (x y z)"],
    );
    // Points, a mesh, and a scene for either.
    fs::write(dir.path().join("Schüssel.xyz"), sphere(2000, |_, _, _| true)).unwrap();
    let hint = "`hapticd init --clay Schüssel.xyz` writes a scene that sculpts it";
    refuses(
        dir.path(),
        "sculpt Schüssel.xyz",
        3,
        &["this is a file of points or a mesh, not a scene", hint],
    );
    refuses(dir.path(), "init Schüssel.xyz", 2, &["not a folder", "--clay"]);
    refuses(dir.path(), "init . --clay", 2, &["--clay takes one file"]);
    let reported = says(
        dir.path(),
        "init --clay Schüssel.xyz",
        0,
        &["units are taken as mm: the clay is then 29.9"],
    );
    assert!(
        reported.stdout.contains("`hapticd sculpt Schüssel.toml` works it"),
        "{}",
        reported.stdout
    );
    refuses(dir.path(), "init --clay Schüssel.xyz", 2, &["Schüssel.toml is there already"]);
    let line =
        "sculpt Schüssel.toml --clock virtual --duration 20ms --json --session Übung.session";
    let sculpted = says(dir.path(), line, 0, &["no path moves the simulated arm"]).json();
    assert_eq!(
        (&sculpted["sculpt"]["samples"], &sculpted["sculpt"]["saved"][0]["file"]),
        (&2000.into(), &"Übung.session".into())
    );
    for command in ["check", "sculpt"] {
        let fragments =
            ["this is a saved session of clay, not a scene", "`session` under [sculpt] names it"];
        refuses(dir.path(), &format!("{command} Übung.session"), 3, &fragments);
    }
    refuses(
        dir.path(),
        "sculpt ball.toml --strokes ball.toml",
        3,
        &["this is a scene, not a file of strokes", "[[stroke]]"],
    );
    // What is to be typed can be.
    fs::write(dir.path().join("it's.xyz"), "0 0 0\n").unwrap();
    refuses(dir.path(), "sculpt it's.xyz", 3, &["`hapticd init --clay 'it'\\''s.xyz'` writes"]);
}

#[test]
fn clay_counts_towards_the_memory_that_is_allowed() {
    let dir = folder();
    let fine = scene("shape = { sphere_mm = 15 }\nspacing_mm = 0.05\nraster = [20, 20, 20]\n");
    fs::write(dir.path().join("fine.toml"), fine).unwrap();
    let fragments = [
        " nodes of the raster take about 1.",
        "more than the 954 MiB that are allowed",
        "fewer mass points in `sculpt.raster`",
    ];
    for command in ["bake fine.toml", "sculpt fine.toml --clock virtual --duration 20ms"] {
        refuses(dir.path(), &format!("{command} --max-memory 1GB"), 3, &fragments);
    }
    says(dir.path(), "bake ball.toml --max-memory 1GB", 0, &[]);
}
