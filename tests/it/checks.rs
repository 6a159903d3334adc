//! What is checked before it runs: `hapticd check` and `hapticd run` find the same in hand files,
//! meshes and memory.

use std::fs;
use std::path::Path;

use tempfile::TempDir;

use super::program::hapticd;

/// A plate and a ball of 5 mm that starts 15 mm above it, in the hand of this file.
fn scene(plate: &str, hand: &str) -> String {
    format!(
        r#"version = 1
[[static]]
name = "base"
{plate}
layers = 4
[tool]
shape = {{ sphere_mm = 5.0 }}
voxel_size_mm = 1.0
start_position_mm = [0, 0, 15]
[device]
profile = "sim-sigma7"
{hand}"#
    )
}

const PLANE: &str = "shape = { plane_mm = [60.0, 60.0] }\nvoxel_size_mm = 2.0";

/// A folder with a scene whose hand goes through these lines.
fn with_hand(header: &str, lines: &str) -> TempDir {
    let dir = tempfile::tempdir().unwrap();
    fs::write(dir.path().join("scene.toml"), scene(PLANE, "hand = \"hand.csv\"")).unwrap();
    fs::write(dir.path().join("hand.csv"), format!("{header}\n{lines}")).unwrap();
    dir
}

const METRES: &str = "t_s,x_m,y_m,z_m,qx,qy,qz,qw";
const RUN: &str = "run scene.toml --clock virtual --duration 20ms --cache off";

/// Lines of a kind that both commands print, which are those of `check`.
fn said(dir: &Path, kind: &str, code: i32) -> Vec<String> {
    let [checked, run] = ["check scene.toml", RUN].map(|line| hapticd(dir, line));
    assert_eq!(
        (checked.code, run.code),
        (Some(code), Some(code)),
        "{}\n{}",
        checked.stderr,
        run.stderr
    );
    let of = |text: &str| -> Vec<String> {
        text.lines().filter(|line| line.starts_with(kind)).map(str::to_owned).collect()
    };
    let checked = of(&checked.stderr);
    let run = of(&run.stderr);
    assert!(checked.iter().all(|line| run.contains(line)), "{checked:?}\n{run:?}");
    checked
}

#[test]
fn a_hand_that_may_be_meant_is_warned_of_and_one_in_millimetres_is_refused() {
    for (lines, expected) in [
        ("0,0,0,0.015,0,0,0,1\n1,0.01,0,0.010,0,0,0,1\n", None),
        ("0,0,0,0.015,0,0,0,-1\n1,0,0,0.010,0,0,0,-1\n", None),
        (
            "0,0,0,0.015,0,0,0,1\n1,0,0,-0.1,0,0,0,1\n",
            Some(
                "tool: hand.csv:3: z = -0.1 m: the hand goes 115 mm away from \
                    `tool.start_position_mm`, and the workspace of sim-sigma7 reaches 75 mm; no \
                    force flows there: shorten the path, or `device.world_from_device.scale = \
                    1.61`",
            ),
        ),
        (
            "0,0.02,0,0.015,0,0,0,1\n",
            Some(
                "tool: hand.csv:2: x = 0.02 m: the hand begins 20.0 mm away from \
                    `tool.start_position_mm` and will pull the arm there at once; begin the path \
                    where the tool starts",
            ),
        ),
        (
            "0,0,0,0.015,1,0,0,0\n",
            Some(
                "tool: hand.csv:2: qx,qy,qz,qw = 1, 0, 0, 0: the hand begins turned by 180° \
                    against `tool.start_orientation_xyzw`; is the file in the order w, x, y, z?",
            ),
        ),
        (
            "0,0,0,0.015,0,1,0,0\n",
            Some(
                "tool: hand.csv:2: qx,qy,qz,qw = 0, 1, 0, 0: the hand begins turned by 180° \
                    against `tool.start_orientation_xyzw`; begin the path as the tool starts",
            ),
        ),
    ] {
        let warnings = said(with_hand(METRES, lines).path(), "warning: ", 0);
        let expected: Vec<_> = expected.into_iter().collect();
        assert_eq!(warnings.len(), expected.len(), "{lines}: {warnings:?}");
        assert!(
            warnings
                .iter()
                .zip(expected)
                .all(|(found, start)| found.starts_with(&format!("warning: {start}"))),
            "{warnings:?}"
        );
    }
    let lines = "1700000000000,0,0,0.015,0,0,0,1\n1700000000010,0,0,0.010,0,0,0,1\n";
    let expected = "warning: tool: hand.csv:2: t_s = 1700000000000 s: the hand waits 53870 years at \
        its first pose; the times are probably milliseconds: subtract the first one from all, and \
        divide by 1000";
    assert_eq!(said(with_hand(METRES, lines).path(), "warning: ", 0), [expected]);
    let lines = "0,0,0,15,0,0,0,1\n1,2,0,10,0,0,0,1\n";
    let errors = said(with_hand(METRES, lines).path(), "error: ", 3);
    let expected = "error: hand.csv:2: z = 15 m: the hand goes 14985 mm away from \
        `tool.start_position_mm`, and the workspace of sim-sigma7 reaches 75 mm: the positions are \
        in millimetres";
    assert_eq!(errors, [expected]);
    let in_millimetres = with_hand("t_s,x_mm,y_mm,z_mm,qx,qy,qz,qw", lines);
    assert_eq!(
        said(in_millimetres.path(), "warning: ", 0),
        [""; 0],
        "the header that the hint names"
    );
}

#[test]
fn what_a_reader_left_as_it_was_is_said_by_check_and_by_a_bake() {
    let dir = tempfile::tempdir().unwrap();
    // A tetrahedron of 30 mm, a kilometre away, whose number of triangles was not filled in.
    let corners = [[0.0, 0.0, 0.0], [30.0, 0.0, 0.0], [0.0, 30.0, 0.0], [0.0, 0.0, 30.0_f32]];
    let mut stl = vec![0; 84];
    for triangle in [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]] {
        stl.extend([0; 12]);
        let numbers =
            triangle.map(|k: usize| [corners[k][0] + 1_048_576.0, corners[k][1], corners[k][2]]);
        stl.extend(numbers.as_flattened().iter().flat_map(|number| number.to_le_bytes()));
        stl.extend([0; 2]);
    }
    fs::write(dir.path().join("far.stl"), stl).unwrap();
    let part = "mesh = \"far.stl\"\nunits = \"mm\"\nvoxel_size_mm = 1.0";
    fs::write(dir.path().join("scene.toml"), scene(part, "")).unwrap();
    assert_eq!(
        said(dir.path(), "warning: ", 0),
        [
            "warning: base: the number of triangles in the header is 0, and was not filled in: all \
                4 that the file has room for were read",
            "warning: base: its coordinates reach 1049 m from the origin of the file, where numbers \
                of 32 bits are 125 µm apart, more than a tenth of a voxel of 1.00 mm: move the part \
                to the origin before it is exported",
        ]
    );
}

#[test]
fn open_meshes_and_wrong_units_are_reported_before_the_bake() {
    let dir = tempfile::tempdir().unwrap();
    // A tetrahedron without its largest face, 30 units long.
    fs::write(
        dir.path().join("open.obj"),
        "v 0 0 0\nv 30 0 0\nv 0 30 0\nv 0 0 30\nf 1 3 2\nf 1 2 4\nf 1 4 3\n",
    )
    .unwrap();
    let plate = "mesh = \"open.obj\"\nunits = \"mm\"\nvoxel_size_mm = 2.0";
    fs::write(dir.path().join("scene.toml"), scene(plate, "")).unwrap();
    let warnings = said(dir.path(), "warning: ", 0);
    assert_eq!(warnings.len(), 1, "{warnings:?}");
    assert!(
        warnings[0].starts_with("warning: base: 3 edges are open, the widest hole is "),
        "{warnings:?}"
    );
    let scaled = plate.replace("open.obj", "small.obj").replace("2.0", "0.002");
    fs::write(
        dir.path().join("small.obj"),
        "v 0 0 0\nv 0.03 0 0\nv 0 0.03 0\nv 0 0 0.03\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n",
    )
    .unwrap();
    fs::write(dir.path().join("scene.toml"), scene(&scaled, "")).unwrap();
    assert_eq!(
        said(dir.path(), "warning: ", 0),
        ["warning: base: the box is 30.0 µm long: is `units` right?"]
    );
}

#[test]
fn a_part_as_large_as_a_house_has_its_unit_doubted_first() {
    let dir = tempfile::tempdir().unwrap();
    let tetrahedron = "v 0 0 0\nv 30 0 0\nv 0 30 0\nv 0 0 30\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n";
    fs::write(dir.path().join("part.obj"), tetrahedron).unwrap();
    let write = |plate: &str| fs::write(dir.path().join("scene.toml"), scene(plate, "")).unwrap();
    write("mesh = \"part.obj\"\nunits = \"m\"\nvoxel_size_mm = 0.5");
    let errors = said(dir.path(), "error: ", 3);
    assert!(
        errors[0].starts_with(
            "error: scene.toml:5: static[0].units = \"m\": base is 30 m long: a grid of "
        ),
        "{errors:?}"
    );
    let hints = said(dir.path(), "  hint: ", 3);
    let first = "  hint: check the unit first: with \"mm\" the part is 30 mm long; if the part is so large, use a voxel size of at least ";
    assert!(hints[0].starts_with(first) && !hints[0].contains("or check"), "{hints:?}");
    fs::write(dir.path().join("poses.csv"), format!("{METRES}\n0,0,0,0.015,0,0,0,1\n")).unwrap();
    for line in
        ["bake scene.toml --cache off", "eval scene.toml --poses poses.csv --out - --cache off"]
    {
        assert!(hapticd(dir.path(), line).stderr.contains(&errors[0]), "{line}");
    }
    // Large, but not so large: the voxels are the mistake.
    write("mesh = \"part.obj\"\nunits = \"cm\"\nvoxel_size_mm = 0.001");
    assert!(said(dir.path(), "error: ", 3)[0].starts_with("error: base: a grid of "));
    // The tool's as well.
    let tool = scene(PLANE, "")
        .replace("shape = { sphere_mm = 5.0 }", "mesh = \"part.obj\"\nunits = \"in\"")
        .replace("_mm = 1.0", "_mm = 0.001");
    fs::write(dir.path().join("scene.toml"), tool.replace("\"in\"", "\"m\"")).unwrap();
    assert!(
        said(dir.path(), "error: ", 3)[0]
            .starts_with("error: scene.toml:9: tool.units = \"m\": tool is 30 m long: ")
    );
}

#[test]
fn a_stiffness_that_is_likely_in_another_unit_is_warned_of_and_accepted() {
    let dir = tempfile::tempdir().unwrap();
    let write = |text: &str| fs::write(dir.path().join("scene.toml"), scene(PLANE, text)).unwrap();
    let warning = |value: &str| {
        format!(
            "warning: scene.toml:14: contact.stiffness_n_per_mm3 = {value}: far from the default of \
                20 N/mm³; write 1 to 400 N/mm³; is the unit right? 1 N/mm³ is 1e9 N/m³"
        )
    };
    for (value, is_reported) in
        [("0.99", true), ("1", false), ("400", false), ("401", true), ("500000", true)]
    {
        write(&format!("[contact]\nstiffness_n_per_mm3 = {value}\n"));
        let expected = if is_reported { vec![warning(value)] } else { Vec::new() };
        assert_eq!(said(dir.path(), "warning: ", 0), expected);
    }
    let json = hapticd(dir.path(), "check scene.toml --json").json();
    let reported = &json["files"][0]["problems"][0];
    for (key, value) in [
        ("severity", "warning"),
        ("key", "contact.stiffness_n_per_mm3"),
        ("value", "500000"),
        ("file", "scene.toml"),
    ] {
        assert_eq!(reported[key], value, "{reported}");
    }
    assert!(
        reported["line"] == 14
            && reported["hint"].as_str().unwrap().starts_with("write 1 to 400 N/mm³"),
        "{reported}"
    );
    // There it does nothing.
    write("[contact]\nstiffness_n_per_mm3 = 500000\n[rendering]\ncoupling = \"constraint\"\n");
    assert_eq!(said(dir.path(), "warning: ", 0), Vec::<String>::new());
    // What the arm takes is the default there, and no reason to warn.
    for voxel_mm in ["0.25", "1.0", "4.0"] {
        let text = scene(PLANE, "[rendering]\ncoupling = \"direct\"\n")
            .replace("_mm = 1.0", &format!("_mm = {voxel_mm}"));
        fs::write(dir.path().join("scene.toml"), text).unwrap();
        assert_eq!(said(dir.path(), "warning: ", 0), Vec::<String>::new());
    }
}

#[test]
fn the_stiffness_of_a_voxel_is_accepted_with_the_line_to_write() {
    let dir = tempfile::tempdir().unwrap();
    let write = |text: &str| fs::write(dir.path().join("scene.toml"), text).unwrap();
    let old = "[contact]\nstiffness_n_per_mm = 5.0\n";
    for (voxel_mm, line) in [
        ("0.5", "stiffness_n_per_mm3 = 20.0"),
        ("1.0", "stiffness_n_per_mm3 = 5.0"),
        ("1.5", "stiffness_n_per_mm3 = 2.222222222222222"),
    ] {
        let text = scene(PLANE, old).replace("_mm = 1.0", &format!("_mm = {voxel_mm}"));
        write(&text);
        let warning = format!(
            "warning: scene.toml:14: contact.stiffness_n_per_mm = 5.0: holds for one square of the tool's \
                voxel edge, so that another voxel size feels different; write {line}"
        );
        assert_eq!(said(dir.path(), "warning: ", 0), [warning]);
        write(&text.replace("stiffness_n_per_mm = 5.0", line));
        assert_eq!(said(dir.path(), "warning: ", 0), Vec::<String>::new());
    }
    write(&scene(PLANE, "[contact]\nstiffness_n_per_mm = 500\n"));
    let warnings = said(dir.path(), "warning: ", 0);
    let outside = "contact.stiffness_n_per_mm = 500: that is 500 N/mm³, far from";
    assert!(warnings.len() == 2 && warnings[1].contains(outside), "{warnings:?}");
}

#[test]
fn a_spring_whose_late_force_the_arm_cannot_damp_is_warned_of_and_accepted() {
    let dir = tempfile::tempdir().unwrap();
    let write = |profile: &str, stiffness: &str| {
        let text = scene(PLANE, &format!("[coupling]\ntranslation_n_per_mm = {stiffness}\n"))
            .replace("sim-sigma7", profile);
        assert!(text.contains(profile));
        fs::write(dir.path().join("scene.toml"), text).unwrap();
    };
    // 1 N·s/m of damping over 1.5 ms.
    let warning = "warning: scene.toml:14: coupling.translation_n_per_mm = 0.7: 700 N/m felt 1.5 \
        ms late needs 1.05 N·s/m of damping to give no energy, and this arm takes 1: after a hard \
        landing it gets less force than the contact has, until the hand presses on; write 0.66 \
        N/mm at most, or know of it";
    for (profile, stiffness, expected) in [
        ("sim-polhem", "0.7", vec![warning]),
        ("sim-polhem", "0.66", Vec::new()),
        ("sim-sigma7", "4", Vec::new()),
    ] {
        write(profile, stiffness);
        assert_eq!(said(dir.path(), "warning: ", 0), expected, "{profile} {stiffness}");
    }
}

#[test]
fn check_says_of_each_shape_what_its_bake_says() {
    for shape in [
        "box_mm = [5.0, 7.0, 9.0]",
        "sphere_mm = 5.0",
        "sphere_mm = 0.4",
        "ellipsoid_mm = [5.0, 8.0, 3.0]",
        "cylinder_mm = [4.0, 12.0]",
        "cone_mm = [4.0, 12.0]",
        "capsule_mm = [4.0, 12.0]",
        "torus_mm = [20.0, 5.0]",
    ] {
        let dir = tempfile::tempdir().unwrap();
        let text = scene(PLANE, "").replace("sphere_mm = 5.0", shape);
        fs::write(dir.path().join("scene.toml"), text).unwrap();
        let checked = hapticd(dir.path(), "check scene.toml --json").json();
        let baked = hapticd(dir.path(), "bake scene.toml --cache off --json").json();
        for part in [0, 1] {
            let of_check = &checked["files"][0]["parts"][part];
            let of_bake = &baked["objects"][part];
            for figure in ["thinnest_wall_m", "sharpest_edge_deg"] {
                let found = &of_check[figure];
                assert_eq!(found, &of_bake["accuracy"][figure], "{shape}: {figure} of {of_check}");
            }
            assert!(of_check["sharpest_edge_deg"].is_number(), "{shape}: {of_check}");
        }
    }
}

#[test]
fn check_prints_its_problems_as_json() {
    let dir = with_hand(METRES, "0,0.02,0,0.015,0,0,0,1\n");
    fs::write(dir.path().join("wrong.toml"), scene(PLANE, "profil = \"sim-sigma7\"")).unwrap();
    let ended = hapticd(dir.path(), "check scene.toml wrong.toml sim-touch --json");
    assert_eq!((ended.code, ended.stderr.as_str()), (Some(3), ""));
    let json = ended.json();
    assert_eq!((&json["ok"], json["files"].as_array().unwrap().len()), (&false.into(), 3));
    let [first, second, third] = [0, 1, 2].map(|n| &json["files"][n]);
    assert!(
        first["ok"] == true
            && first["kind"] == "scene"
            && first["summary"].as_str().unwrap().contains("sim-sigma7"),
        "{first}"
    );
    let tool = &first["parts"][1];
    assert!(
        first["parts"].as_array().unwrap().len() == 2
            && tool["name"] == "tool"
            && (tool["thinnest_wall_m"].as_f64().unwrap() - 0.01).abs() < 1e-3
            && tool["sharpest_edge_deg"].as_f64().unwrap() > 150.0,
        "{first}"
    );
    let warning = &first["problems"][0];
    for (key, value) in
        [("severity", "warning"), ("file", "hand.csv"), ("key", "x"), ("value", "0.02 m")]
    {
        assert_eq!(warning[key], value, "{warning}");
    }
    assert!(
        warning["line"] == 2
            && warning["hint"].as_str().unwrap().contains("tool.start_position_mm"),
        "{warning}"
    );
    assert!(
        second["ok"] == false && second["exit_code"] == 3 && second["summary"].is_null(),
        "{second}"
    );
    let error = &second["problems"][0];
    for (key, value) in [("severity", "error"), ("file", "wrong.toml"), ("key", "device.profil")] {
        assert_eq!(error[key], value, "{error}");
    }
    assert!(
        error["line"] == 13
            && error["message"].as_str().unwrap().contains("did you mean `profile`"),
        "{error}"
    );
    assert!(third["kind"] == "profile" && third["problems"] == serde_json::json!([]), "{third}");
}

#[test]
fn every_shipped_scene_is_checked_without_a_warning() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    for folder in ["config/scenes", "config/clay"] {
        let scenes = fs::read_dir(root.join(folder)).unwrap().map(|entry| entry.unwrap().path());
        for scene in
            scenes.filter(|path| path.extension().is_some_and(|extension| extension == "toml"))
        {
            let ended = hapticd(root, &format!("check {}", scene.display()));
            assert_eq!((ended.code, ended.stderr.as_str()), (Some(0), ""), "{}", scene.display());
        }
    }
}

#[test]
fn a_part_is_reported_its_own_memory_and_a_voxel_size_that_the_memory_holds() {
    let dir = tempfile::tempdir().unwrap();
    let plate = "shape = { box_mm = [60.0, 60.0, 60.0] }\nvoxel_size_mm = 0.25";
    fs::write(dir.path().join("scene.toml"), scene(plate, "")).unwrap();
    let memory_of = |scene: &str| -> Vec<String> {
        let ended = hapticd(dir.path(), &format!("bake -v {scene} --cache off"));
        assert_eq!(ended.code, Some(0), "{}", ended.stderr);
        ended
            .stderr
            .lines()
            .filter(|line| line.starts_with("memory: tool "))
            .map(str::to_owned)
            .collect()
    };
    let beside_large = memory_of("scene.toml");
    fs::write(dir.path().join("small.toml"), scene(PLANE, "")).unwrap();
    assert_eq!(
        (beside_large.len(), &beside_large),
        (1, &memory_of("small.toml")),
        "a ball takes what it takes beside any part"
    );

    // What the part before it keeps counts where a limit is given, and is named.
    let refused = hapticd(dir.path(), "bake scene.toml --cache off --max-memory 100kB");
    assert!(
        refused.code == Some(3) && refused.stderr.contains("base: baking takes about "),
        "{}",
        refused.stderr
    );

    fs::write(dir.path().join("absurd.toml"), scene(&plate.replace("0.25", "0.000001"), ""))
        .unwrap();
    let refused = hapticd(dir.path(), "bake absurd.toml --cache off --max-memory 50MB");
    let size_mm: f64 = refused
        .stderr
        .split("at least ")
        .nth(1)
        .and_then(|rest| rest.split(' ').next())
        .unwrap()
        .parse()
        .unwrap();
    fs::write(
        dir.path().join("fits.toml"),
        scene(&plate.replace("0.25", &size_mm.to_string()), ""),
    )
    .unwrap();
    let ended = hapticd(dir.path(), "bake fits.toml --cache off --max-memory 50MB");
    assert_eq!(ended.code, Some(0), "{size_mm} mm: {}", ended.stderr);
    // Without a limit the memory of this machine is one.
    let checked = hapticd(dir.path(), "check absurd.toml");
    assert!(
        checked.code == Some(3) && checked.stderr.contains("hint: use a voxel size of at least "),
        "{}",
        checked.stderr
    );
}

#[test]
fn wrenches_go_to_stdout_and_to_a_file_alike() {
    let dir = with_hand(METRES, "0,0,0,0.015,0,0,0,1\n1,0,0,0.004,0,0,0,1\n");
    let eval = |out: &str| {
        let ended = hapticd(
            dir.path(),
            &format!("eval scene.toml --poses hand.csv --cache off --out {out}"),
        );
        assert_eq!((ended.code, ended.stderr.as_str()), (Some(0), ""));
        ended.stdout
    };
    // The last column is the time that a query took.
    let without_time = |table: &str| -> Vec<String> {
        table.lines().map(|line| line.rsplit_once(',').unwrap().0.to_owned()).collect()
    };
    let printed = eval("-");
    assert_eq!(eval("out.csv"), "");
    let written = fs::read_to_string(dir.path().join("out.csv")).unwrap();
    assert_eq!(without_time(&printed), without_time(&written));
    assert!(printed.lines().count() == 3 && printed.starts_with("t_s,fx_n,"), "{printed}");
    assert!(!dir.path().join("-").exists());
    let refused =
        hapticd(dir.path(), "eval scene.toml --poses hand.csv --cache off --out none/out.csv");
    assert!(
        refused.code == Some(4) && refused.stderr.contains("there is no folder none"),
        "{}",
        refused.stderr
    );
}

#[test]
fn a_depth_beyond_the_layers_is_measured_on_the_triangles() {
    let dir = with_hand(METRES, "0,0,0,0.021,0,0,0,1\n1,0,0,0.010,0,0,0,1\n2,0.02,0,0,0,0,0,1\n");
    // Four layers of 1 mm know depths up to 3.5 mm.
    let block = "shape = { box_mm = [60.0, 60.0, 40.0] }\nvoxel_size_mm = 1.0";
    let scene = scene(block, "").replace("[0, 0, 15]", "[0, 0, 40]");
    fs::write(dir.path().join("scene.toml"), scene).unwrap();
    let ended = hapticd(dir.path(), "eval scene.toml --poses hand.csv --cache off --out -");
    assert_eq!((ended.code, ended.stderr.as_str()), (Some(0), ""));
    let rows = ended.stdout.lines().skip(1).map(|line| line.split(',').collect::<Vec<_>>());
    // The point of the ball that is farthest from the nearest side: its lowest one, and at last
    // that which is farthest from the side that it is near.
    for (row, right_mm) in rows.zip([4.0, 15.0, 15.0]) {
        let [depth_m, clearance_m] =
            [8, 9].map(|column: usize| row[column].parse::<f64>().unwrap());
        assert!((depth_m * 1e3 - right_mm).abs() < 0.1, "{depth_m} m for {right_mm} mm");
        assert!(clearance_m.to_bits() == (-depth_m).to_bits(), "{clearance_m}");
    }
}

#[test]
fn files_of_cad_programs_are_refused_with_the_command_that_converts_them() {
    let dir = tempfile::tempdir().unwrap();
    for name in ["part.step", "part.IGS"] {
        fs::write(dir.path().join(name), "ISO-10303-21;\n").unwrap();
    }
    let plate = "mesh = \"part.step\"\nunits = \"mm\"\nvoxel_size_mm = 2.0";
    fs::write(dir.path().join("scene.toml"), scene(plate, "")).unwrap();
    for (line, code, start) in [
        (
            "check scene.toml",
            3,
            "error: scene.toml:4: static[0].mesh = \"part.step\": STEP files hold curved surfaces",
        ),
        ("check part.step", 3, "error: part.step: STEP files hold curved surfaces"),
        ("run part.IGS", 3, "error: part.IGS: IGES files hold curved surfaces"),
        (
            "bake part.step --units mm --voxel-size-mm 1",
            4,
            "error: part.step: STEP files hold curved surfaces",
        ),
        ("init .", 4, "error: .: no mesh files here"),
    ] {
        let ended = hapticd(dir.path(), line);
        assert!(
            ended.code == Some(code) && ended.stderr.starts_with(start),
            "{line}: {}",
            ended.stderr
        );
        assert!(
            ended.stderr.contains("hint: convert it: `gmsh PART.step -2 -clmax 1 -o PART.stl`"),
            "{line}: {}",
            ended.stderr
        );
    }
}
