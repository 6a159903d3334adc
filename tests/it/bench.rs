//! `hapticd bench` and `bake --picture` as a stranger meets them.

use std::collections::BTreeSet;
use std::path::Path;
use std::process::{Command, Output};

use serde_json::Value;

/// Runs the program in a folder, without any peers or models.
fn hapticd(folder: &Path, arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_hapticd"));
    command.current_dir(folder).args(arguments).env_remove("HAPTICD_MODELS").env_remove("HAPTICD_PEERS").env("TMPDIR", folder);
    // Never the cache of whoever runs the tests.
    command.env("XDG_CACHE_HOME", folder.join("xdg-cache")).env("XDG_STATE_HOME", folder.join("xdg-state"));
    command.output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

fn keys(value: &Value) -> BTreeSet<&str> {
    value.as_object().unwrap().keys().map(String::as_str).collect()
}

#[test]
fn a_quick_bench_prints_one_object_with_a_row_for_each_figure() {
    let folder = tempfile::tempdir().unwrap();
    let ended = hapticd(folder.path(), &["bench", "generation", "--quick", "--json", "--threads", "2"]);
    assert_eq!(ended.status.code(), Some(0), "{}", text(&ended.stderr));
    assert!(text(&ended.stderr).contains("run 1"), "progress goes to stderr");
    let said = text(&ended.stdout);
    assert_eq!(said.lines().count(), 1, "{said}");
    let report: Value = serde_json::from_str(&said).unwrap();
    assert_eq!(keys(&report), BTreeSet::from(["machine", "commit", "rows"]));
    assert_eq!(keys(&report["machine"]), BTreeSet::from(["cpu", "cores", "kernel", "memory_gib"]));
    let rows = report["rows"].as_array().unwrap();
    let expected = ["group", "name", "value", "unit", "target", "met", "paper", "peer", "peer_value", "ratio"];
    for row in rows {
        assert_eq!(keys(row), BTreeSet::from(expected), "{row}");
        assert_eq!(
            row["met"].is_null(),
            row["target"].is_null()
                || (row["value"].is_null() || row["ratio"].is_null() && row["target"].as_str().unwrap().starts_with("ratio")),
            "{row}"
        );
    }
    let value = |group: &str, name: &str| {
        let row =
            rows.iter().find(|row| row["group"].as_str().unwrap().contains(group) && row["name"].as_str().unwrap().contains(name));
        row.unwrap_or_else(|| panic!("no {name} of {group}"))["value"].as_f64()
    };
    assert_eq!(value("settings", "threads"), Some(2.0));
    for navigation in ["plane-span", "two-sided"] {
        assert_eq!(value(navigation, "triangles"), Some(7088.0));
        assert_eq!(value(navigation, "watertight"), Some(1.0));
        for figure in [
            "load",
            "init",
            "generate",
            "fill",
            "layers",
            "distance",
            "pointshell",
            "normals",
            "all stages",
            "peak memory",
            "SAT tests",
        ] {
            assert!(value(navigation, figure) > Some(0.0), "{figure} of {navigation}");
        }
    }
    assert!(value("two-sided", "SAT tests") <= value("plane-span", "SAT tests"));
    let points = value("pointshell f", "points").unwrap();
    assert!((points / 10_954.0 - 1.0).abs() < 0.2, "{points} points");
    // The voxel size halves: four times the points.
    let growth = value("beside twice the size", "points").unwrap();
    assert!((3.0..5.0).contains(&growth), "{growth}");
    let bunny = rows.iter().find(|row| row["group"] == "bunny").unwrap();
    assert!(bunny["value"].is_null() && bunny["name"] == "skipped: HAPTICD_MODELS not set");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "nothing stays in the temporary folder");
}

/// The rows of a bench of the shipped scenes that ended well.
fn rows_of(folder: &Path, arguments: &[&str]) -> Vec<Value> {
    let scenes = Path::new(env!("CARGO_MANIFEST_DIR")).join("config/scenes");
    let ended = hapticd(folder, &[arguments, &["--json", "--quiet", "--scenes", scenes.to_str().unwrap()]].concat());
    assert_eq!(ended.status.code(), Some(0), "{}", text(&ended.stderr));
    let report: Value = serde_json::from_str(&text(&ended.stdout)).unwrap();
    report["rows"].as_array().unwrap().clone()
}

fn find<'a>(rows: &'a [Value], group: &str, name: &str) -> &'a Value {
    let found =
        rows.iter().find(|row| row["group"].as_str().unwrap().starts_with(group) && row["name"].as_str().unwrap().contains(name));
    found.unwrap_or_else(|| panic!("no {name} of {group}"))
}

#[test]
fn a_quick_bench_of_contacts_counts_points_and_says_what_it_skips() {
    let folder = tempfile::tempdir().unwrap();
    let rows = rows_of(folder.path(), &["bench", "contact", "--quick"]);
    assert_eq!(find(&rows, "pin in a bore", "0 % touching: points in contact")["value"], 0.0);
    assert!(find(&rows, "pin in a bore", "flat, 3 % touching: points in contact")["value"].as_f64() > Some(200.0));
    assert!(find(&rows, "pin of ", "share")["target"] == "value within ±0.1000");
    let nut = find(&rows, "M16 nut", "skipped");
    assert!(nut["value"].is_null() && nut["met"].is_null());
}

#[test]
fn a_quick_bench_of_quality_writes_its_raw_results() {
    let folder = tempfile::tempdir().unwrap();
    let rows = rows_of(folder.path(), &["bench", "contact", "--quality", "--quick", "--csv", "raw", "--plots", "raw"]);
    for family in ["Q1", "Q2", "Q3"] {
        assert!(
            find(&rows, family, "trilinear: ripple")["value"].as_f64() < find(&rows, family, "layers: ripple")["value"].as_f64()
        );
    }
    assert!(find(&rows, "Q1 up a slope", "implicit, trilinear: delay")["value"].is_number());
    assert!(find(&rows, "smoothness", "block-on-plane: ripple on the hand")["peer_value"].is_number());
    assert!(rows.len() > 100, "{} rows", rows.len());
    for (file, columns, least_lines) in [("q1-q3.csv", 18, 48), ("q1-q3-series.csv", 11, 48 * 240), ("q1-couplings.csv", 7, 9000)] {
        let written = std::fs::read_to_string(folder.path().join("raw").join(file)).unwrap();
        let commas = |line: &str| line.split('"').step_by(2).map(|part| part.matches(',').count()).sum::<usize>();
        assert!(written.lines().all(|line| commas(line) == columns - 1), "{file}");
        assert!(written.lines().count() > least_lines, "{file}: {} lines", written.lines().count());
    }
    let cases = std::fs::read_to_string(folder.path().join("raw/q1-q3.csv")).unwrap();
    assert_eq!(cases.lines().count(), 49, "a line for each case, and the head");
    assert!(std::fs::read(folder.path().join("raw/smoothness-on-the-hand.png")).unwrap().starts_with(b"\x89PNG\r\n\x1a\n"));
}

#[test]
fn a_quick_torture_judges_every_tick() {
    let folder = tempfile::tempdir().unwrap();
    let rows = rows_of(folder.path(), &["bench", "torture", "--quick"]);
    assert!(rows.len() > 30, "{} rows", rows.len());
    assert!(find(&rows, "torture", "ticks")["value"].as_f64() >= Some(20_000.0));
    assert!(find(&rows, "torture", "ticks in contact")["value"].as_f64() > Some(1000.0), "it is violent");
    assert!(find(&rows, "torture", "largest force")["value"].as_f64() > Some(4.0), "it is violent");
    // Times of a busy machine aside.
    for row in rows.iter().filter(|row| row["unit"] != "µs") {
        assert_ne!(row["met"], false, "{row}");
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "nothing stays in the temporary folder");
}

#[test]
fn a_quick_bench_of_the_loop_runs_on_the_real_clock() {
    let folder = tempfile::tempdir().unwrap();
    let rows = rows_of(folder.path(), &["bench", "loop", "--quick"]);
    // A busy machine skips ticks, but not all of them.
    assert!(find(&rows, "block-on-plane", "ticks")["value"].as_f64() > Some(100.0));
    assert!(find(&rows, "block-on-plane", "tick compute, p99.9")["value"].as_f64() > Some(0.0));
    assert!(find(&rows, "block-on-plane", "wake-up, p99")["peer"].as_str().unwrap().starts_with("cyclictest"));
    let rows = hapticd(folder.path(), &["bench", "loop", "--quick", "--json", "--quiet", "--scenes", "nowhere"]);
    assert!(text(&rows.stdout).contains("skipped: no scenes in nowhere"));
}

#[test]
fn a_quick_bench_of_sculpting_times_builds_and_updates_and_draws_the_force() {
    let folder = tempfile::tempdir().unwrap();
    let rows = rows_of(folder.path(), &["bench", "sculpt", "--quick", "--plots", "pictures"]);
    assert!(find(&rows, "building a surface", "4500 samples")["paper"].as_f64() == Some(8.177_936));
    assert!(find(&rows, "updating a piece", "20³ mass points, 6060 samples, implicit")["value"].as_f64() > Some(0.0));
    assert!(find(&rows, "largest step of the force", "updates at 60 Hz, extrapolated")["value"].as_f64() > Some(0.0));
    assert!(folder.path().join("pictures/receding-clay.png").is_file());
}

#[test]
fn groups_that_are_not_there_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let ended = hapticd(folder.path(), &["bench", "speed", "--quick"]);
    assert_eq!(ended.status.code(), Some(2));
    assert!(text(&ended.stderr).contains("sculpt") && ended.stdout.is_empty(), "{}", text(&ended.stderr));
    let pictures = hapticd(folder.path(), &["bench", "loop", "--quick", "--plots", "here"]);
    assert!(pictures.status.code() == Some(2) && text(&pictures.stderr).contains("bench sculpt --plots"));
    let misplaced = hapticd(folder.path(), &["bench", "loop", "--quality", "--quick"]);
    assert!(misplaced.status.code() == Some(2) && text(&misplaced.stderr).contains("bench contact --quality"));
}

#[test]
fn a_picture_is_a_png_with_the_surface_on_it() {
    let folder = tempfile::tempdir().unwrap();
    let peg = Path::new(env!("CARGO_MANIFEST_DIR")).join("config/models/peg.obj");
    let peg = peg.to_str().unwrap();
    let bake = |voxel_size_mm: &str, picture: &str| {
        hapticd(
            folder.path(),
            &["bake", peg, "--units", "mm", "--voxel-size-mm", voxel_size_mm, "--layers", "3", "--json", "--picture", picture],
        )
    };
    for (voxel_size_mm, picture) in [("1", "fine.png"), ("30", "COARSE.PNG")] {
        let ended = bake(voxel_size_mm, picture);
        assert_eq!(ended.status.code(), Some(0), "{}", text(&ended.stderr));
        let pixels = tiny_skia::Pixmap::load_png(folder.path().join(picture)).unwrap();
        assert!(
            (900..=1600).contains(&pixels.width()) && (300..=1300).contains(&pixels.height()),
            "{} x {}",
            pixels.width(),
            pixels.height()
        );
        let share = |is: fn([u8; 3]) -> bool| {
            let n = pixels.pixels().iter().filter(|pixel| is([pixel.red(), pixel.green(), pixel.blue()])).count();
            n as f64 / pixels.pixels().len() as f64
        };
        let dark = share(|[red, green, blue]| red < 60 && green < 60 && blue < 60);
        let blue = share(|[red, _, blue]| i16::from(blue) - i16::from(red) > 60);
        let orange = share(|[red, _, blue]| i16::from(red) - i16::from(blue) > 60);
        assert!(dark > 0.01 && blue > 0.02, "{picture}: {dark} dark, {blue} blue");
        // Voxels larger than the peg have no inside, but the legend has one.
        assert!(orange > if voxel_size_mm == "1" { 0.05 } else { 0.0005 }, "{picture}: {orange} orange");
    }
    let same = || bake("1", "again.png");
    same();
    let [first, again] = ["fine.png", "again.png"].map(|name| std::fs::read(folder.path().join(name)).unwrap());
    assert!(first == again, "the same bake draws the same bytes");
}

#[test]
fn a_picture_that_cannot_be_drawn_is_refused_before_the_work() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("part.obj"), "v 0 0 0\nv 9 0 0\nv 0 9 0\nv 0 0 9\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n")
        .unwrap();
    std::fs::create_dir(folder.path().join("folder.png")).unwrap();
    let cases = [
        ("cut.jpg", 2, "a picture is a .png"),
        ("none/cut.png", 4, "the folder must exist"),
        ("folder.png", 4, "give a file name"),
    ];
    for (picture, code, fragment) in cases {
        let ended = hapticd(folder.path(), &["bake", "part.obj", "--units", "mm", "--voxel-size-mm", "1", "--picture", picture]);
        assert_eq!(ended.status.code(), Some(code), "{picture}: {}", text(&ended.stderr));
        assert!(text(&ended.stderr).contains(fragment) && ended.stdout.is_empty(), "{picture}: {}", text(&ended.stderr));
    }
    let ended = hapticd(folder.path(), &["bake", "scene.toml", "--picture", "cut.png"]);
    assert_eq!(ended.status.code(), Some(2));
    assert!(text(&ended.stderr).contains("--picture goes with a mesh"), "{}", text(&ended.stderr));
}
