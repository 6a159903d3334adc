//! The command line of the bench.

use std::collections::BTreeSet;
use std::path::Path;
use std::process::{Command, Output};

use serde_json::Value;

/// Runs the bench in a folder, without any peers or models.
fn bench(folder: &Path, arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_bench"));
    command
        .current_dir(folder)
        .args(arguments)
        .env_remove("HAPTICD_MODELS")
        .env_remove("HAPTICD_PEERS")
        .env("TMPDIR", folder);
    // Never the cache of the user.
    command
        .env("XDG_CACHE_HOME", folder.join("xdg-cache"))
        .env("XDG_STATE_HOME", folder.join("xdg-state"));
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
    let ended = bench(folder.path(), &["generation", "--quick", "--json", "--threads", "2"]);
    assert_eq!(ended.status.code(), Some(0), "{}", text(&ended.stderr));
    assert!(text(&ended.stderr).contains("run 1"), "progress goes to stderr");
    let said = text(&ended.stdout);
    assert_eq!(said.lines().count(), 1, "{said}");
    let report: Value = serde_json::from_str(&said).unwrap();
    assert_eq!(keys(&report), BTreeSet::from(["machine", "commit", "rows"]));
    assert_eq!(keys(&report["machine"]), BTreeSet::from(["cpu", "cores", "kernel", "memory_gib"]));
    let rows = report["rows"].as_array().unwrap();
    let expected =
        ["group", "name", "value", "unit", "target", "met", "paper", "peer", "peer_value", "ratio"];
    for row in rows {
        assert_eq!(keys(row), BTreeSet::from(expected), "{row}");
        assert_eq!(
            row["met"].is_null(),
            row["target"].is_null()
                || (row["value"].is_null()
                    || row["ratio"].is_null()
                        && row["target"].as_str().unwrap().starts_with("ratio")),
            "{row}"
        );
    }
    let value = |group: &str, name: &str| {
        let row = rows.iter().find(|row| {
            row["group"].as_str().unwrap().contains(group)
                && row["name"].as_str().unwrap().contains(name)
        });
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
    assert_eq!(
        std::fs::read_dir(folder.path()).unwrap().count(),
        0,
        "nothing stays in the temporary folder"
    );
}

/// The rows of a bench of the shipped scenes that ended well.
fn rows_of(folder: &Path, arguments: &[&str]) -> Vec<Value> {
    let scenes = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/scenes");
    let ended = bench(
        folder,
        &[arguments, &["--json", "--quiet", "--scenes", scenes.to_str().unwrap()]].concat(),
    );
    assert_eq!(ended.status.code(), Some(0), "{}", text(&ended.stderr));
    let report: Value = serde_json::from_str(&text(&ended.stdout)).unwrap();
    report["rows"].as_array().unwrap().clone()
}

fn find<'a>(rows: &'a [Value], group: &str, name: &str) -> &'a Value {
    let found = rows.iter().find(|row| {
        row["group"].as_str().unwrap().starts_with(group)
            && row["name"].as_str().unwrap().contains(name)
    });
    found.unwrap_or_else(|| panic!("no {name} of {group}"))
}

#[test]
fn a_quick_bench_of_contacts_counts_points_and_says_what_it_skips() {
    let folder = tempfile::tempdir().unwrap();
    let rows = rows_of(folder.path(), &["contact", "--quick"]);
    assert_eq!(find(&rows, "pin in a bore", "0 % touching: points in contact")["value"], 0.0);
    assert!(
        find(&rows, "pin in a bore", "flat, 3 % touching: points in contact")["value"].as_f64()
            > Some(200.0)
    );
    assert!(find(&rows, "pin of ", "share")["target"] == "value within ±0.1000");
    let nut = find(&rows, "M16 nut", "skipped");
    assert!(nut["value"].is_null() && nut["met"].is_null());
}

#[test]
fn a_quick_bench_of_quality_writes_its_raw_results() {
    let folder = tempfile::tempdir().unwrap();
    let rows = rows_of(
        folder.path(),
        &["contact", "--quality", "--quick", "--csv", "raw", "--plots", "raw"],
    );
    for family in ["Q1", "Q2", "Q3"] {
        assert!(
            find(&rows, family, "trilinear: ripple")["value"].as_f64()
                < find(&rows, family, "layers: ripple")["value"].as_f64()
        );
    }
    assert!(find(&rows, "Q1 up a slope", "implicit, trilinear: delay")["value"].is_number());
    assert!(
        find(&rows, "smoothness", "block-on-plane: ripple on the hand")["peer_value"].is_number()
    );
    let cube = "a cube of 10 mm at random";
    assert_eq!(
        find(&rows, cube, "facets: a face in 25 attitudes: force / law, least")["met"],
        true
    );
    assert_eq!(find(&rows, cube, "facets: a corner is first felt at, worst")["met"], true);
    assert!(
        find(&rows, cube, "voxels: a corner is first felt at, worst")["value"].as_f64() > Some(0.1)
    );
    assert!(rows.len() > 100, "{} rows", rows.len());
    for (file, columns, least_lines) in
        [("q1-q3.csv", 18, 40), ("q1-q3-series.csv", 11, 40 * 240), ("q1-couplings.csv", 7, 9000)]
    {
        let written = std::fs::read_to_string(folder.path().join("raw").join(file)).unwrap();
        let commas = |line: &str| {
            line.split('"').step_by(2).map(|part| part.matches(',').count()).sum::<usize>()
        };
        assert!(written.lines().all(|line| commas(line) == columns - 1), "{file}");
        assert!(written.lines().count() > least_lines, "{file}: {} lines", written.lines().count());
    }
    let cases = std::fs::read_to_string(folder.path().join("raw/q1-q3.csv")).unwrap();
    assert_eq!(cases.lines().count(), 41, "a line for each case, and the head");
    let plot =
        std::fs::read_to_string(folder.path().join("raw/smoothness-on-the-hand.svg")).unwrap();
    assert!(
        plot.starts_with("<svg") && plot.contains("block-on-plane, N") && !plot.contains("NaN"),
        "{plot}"
    );
}

#[test]
fn a_quick_bench_of_insertions_lets_in_what_fits_and_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let rows = rows_of(folder.path(), &["insertions", "--quick"]);
    for hand in ["straight", "0.2 mm beside, 1° tilted"] {
        let found = |what: &str| {
            find(
                &rows,
                "insertions",
                &format!("{what} mm of clearance, voxels of 0.2 mm, {hand}: is in"),
            )["value"]
                .clone()
        };
        assert_eq!((found("peg, 0.1"), found("peg, -0.1")), (1.0.into(), 0.0.into()), "{hand}");
    }
    assert_eq!(
        std::fs::read_dir(folder.path()).unwrap().count(),
        0,
        "nothing stays in the temporary folder"
    );
    let skipped = bench(
        folder.path(),
        &["insertions", "--quick", "--json", "--quiet", "--scenes", "nowhere"],
    );
    assert!(
        text(&skipped.stdout).contains("skipped: no scenes in nowhere"),
        "{}",
        text(&skipped.stderr)
    );
}

#[test]
fn a_quick_stress_judges_every_tick() {
    let folder = tempfile::tempdir().unwrap();
    let rows = rows_of(folder.path(), &["stress", "--quick"]);
    assert!(rows.len() > 30, "{} rows", rows.len());
    assert!(find(&rows, "stress", "ticks")["value"].as_f64() >= Some(20_000.0));
    assert!(
        find(&rows, "stress", "ticks in contact")["value"].as_f64() > Some(1000.0),
        "it is violent"
    );
    assert!(find(&rows, "stress", "largest force")["value"].as_f64() > Some(4.0), "it is violent");
    // Times of a busy machine aside.
    for row in rows.iter().filter(|row| row["unit"] != "µs") {
        assert_ne!(row["met"], false, "{row}");
    }
    assert_eq!(
        std::fs::read_dir(folder.path()).unwrap().count(),
        0,
        "nothing stays in the temporary folder"
    );
}

#[test]
fn a_quick_bench_of_the_loop_runs_on_the_real_clock() {
    let folder = tempfile::tempdir().unwrap();
    let rows = rows_of(folder.path(), &["loop", "--quick"]);
    // A busy machine skips ticks, but not all of them.
    assert!(find(&rows, "block-on-plane", "ticks")["value"].as_f64() > Some(100.0));
    assert!(find(&rows, "block-on-plane", "tick compute, p99.9")["value"].as_f64() > Some(0.0));
    assert!(
        find(&rows, "block-on-plane", "wake-up, p99")["peer"]
            .as_str()
            .unwrap()
            .starts_with("cyclictest")
    );
    let rows =
        bench(folder.path(), &["loop", "--quick", "--json", "--quiet", "--scenes", "nowhere"]);
    assert!(text(&rows.stdout).contains("skipped: no scenes in nowhere"));
}

#[test]
fn a_quick_bench_of_sculpting_times_builds_and_updates_and_draws_the_force() {
    let folder = tempfile::tempdir().unwrap();
    let rows = rows_of(folder.path(), &["sculpt", "--quick", "--plots", "pictures"]);
    assert!(find(&rows, "building a surface", "4500 samples")["paper"].as_f64() == Some(8.177_936));
    assert!(
        find(&rows, "updating a clay model", "20³ mass points, 6060 samples, implicit")["value"]
            .as_f64()
            > Some(0.0)
    );
    assert!(
        find(&rows, "largest step of the force", "updates at 60 Hz, extrapolated")["value"]
            .as_f64()
            > Some(0.0)
    );
    assert!(folder.path().join("pictures/receding-clay.svg").is_file());
}

/// Headings of a page, in order.
fn headings(page: &str) -> Vec<&str> {
    page.lines().filter(|line| line.starts_with('#')).collect()
}

#[test]
fn a_quick_bench_of_the_paper_of_2008_writes_its_page_and_plots() {
    let folder = tempfile::tempdir().unwrap();
    let rows = rows_of(folder.path(), &["sagardia-2008", "--quick", "--docs", "docs"]);
    let group = "paper of 2008: bracket at 8 mm";
    for figure in [
        "first navigation",
        "second navigation",
        "every voxel of each box",
        "two phases, second way",
        "points as shipped",
    ] {
        assert!(find(&rows, group, figure)["value"].as_f64() > Some(0.0), "{figure}");
    }
    let tests = |name: &str| find(&rows, group, name)["value"].as_f64().unwrap();
    assert!(tests("second navigation: tests") <= tests("first navigation: tests"));
    assert!(tests("first navigation: tests") < tests("each box: tests"));
    assert!(tests("points after both phases") <= tests("projections"));
    assert!(
        find(&rows, "paper of 2008: one projection", "second of the first, prepared for every")["paper"]
            == 37.0
    );
    let page =
        std::fs::read_to_string(folder.path().join("docs/reference/sagardia-2008.md")).unwrap();
    let shipped =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/reference/sagardia-2008.md");
    assert_eq!(
        headings(&page),
        headings(&std::fs::read_to_string(shipped).unwrap()),
        "the page of docs is what the command writes"
    );
    assert!(
        page.contains("| (f) | bracket |")
            && page.contains("Not measured in this run: (a), (b), (c), (d), (e)."),
        "{page}"
    );
    assert!(!page.contains("NaN") && !page.contains("inf"), "{page}");
    assert!(folder.path().join("docs/pictures/sagardia-2008-bracket.png").is_file());
    for plot in ["points", "ratios"] {
        let drawn = std::fs::read_to_string(
            folder.path().join(format!("docs/pictures/sagardia-2008-{plot}.svg")),
        )
        .unwrap();
        assert!(
            drawn.starts_with("<svg")
                && drawn.contains("(f)")
                && drawn.contains(">2·10⁴<")
                && !drawn.contains("NaN"),
            "{drawn}"
        );
        assert!(page.contains(&format!("(../pictures/sagardia-2008-{plot}.svg)")));
    }
    let temporary =
        std::fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name());
    assert_eq!(temporary.collect::<Vec<_>>(), ["docs"], "nothing stays in the temporary folder");
    let misplaced = bench(folder.path(), &["loop", "--quick", "--docs", "docs"]);
    assert!(
        misplaced.status.code() == Some(2)
            && text(&misplaced.stderr).contains("bench sagardia-2008 --docs")
    );
}

#[test]
fn a_quick_bench_of_wrenches_judges_hapticd_and_what_joins_with_a_csv() {
    let folder = tempfile::tempdir().unwrap();
    // A program that answers one scene, and feels nothing there.
    let joined = folder.path().join("files/wrenches/zero");
    std::fs::create_dir_all(&joined).unwrap();
    let nothing =
        "fx_n,fy_n,fz_n,tx_nm,ty_nm,tz_nm\n".to_owned() + &"0,0,0,0,0,0\n".repeat(5 * 300);
    std::fs::write(joined.join("box-on-edge.csv"), &nothing).unwrap();
    let rows =
        rows_of(folder.path(), &["wrench", "--quick", "--folder", "files", "--docs", "docs"]);
    // Direction, line of action, size, ripple, steps and work beside the closed forms.
    let judged = |group: &str| {
        let judged: Vec<&Value> = rows
            .iter()
            .filter(|row| row["group"] == format!("wrench: hapticd, {group}"))
            .filter(|row| !row["met"].is_null())
            .collect();
        judged
    };
    let of_faces = judged("scenes with closed forms");
    assert_eq!(of_faces.len(), 7);
    for row in of_faces {
        assert_eq!(row["met"], true, "{row}");
    }
    // The tip of a part is rounded off by its field, so size and work miss what is asked.
    let of_tips = judged("tips, edges and wedges with closed forms");
    assert_eq!(of_tips.len(), 5);
    let is_known = |row: &Value| row["name"] == "size off, p95" || row["name"] == "work of a loop";
    for row in of_tips.into_iter().filter(|row| !is_known(row)) {
        assert_eq!(row["met"], true, "{row}");
    }
    assert!(
        (find(&rows, "wrench: hapticd", "scale")["value"].as_f64().unwrap() - 1.0).abs() < 0.05
    );
    assert_eq!(find(&rows, "wrench: zero", "no force")["value"], 100.0);
    // The scenes are those of the page of docs, and its tables those that the command writes.
    let page =
        std::fs::read_to_string(folder.path().join("docs/reference/wrench-results.md")).unwrap();
    let shipped =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/reference/wrench-results.md");
    let shipped = std::fs::read_to_string(shipped).unwrap();
    let hash = |page: &str| {
        page.lines().find(|line| line.starts_with("Hash of the scenes")).unwrap().to_owned()
    };
    assert_eq!(hash(&page), hash(&shipped), "the scenes have changed: write the page again");
    assert!(
        headings(&page)
            .iter()
            .all(|heading| *heading == "## Not measured" || headings(&shipped).contains(heading))
    );
    assert!(!page.contains("NaN") && !page.contains("inf"), "{page}");
    for plot in ["size", "angle"] {
        let drawn =
            std::fs::read_to_string(folder.path().join(format!("docs/pictures/wrench-{plot}.svg")))
                .unwrap();
        assert!(
            drawn.starts_with("<svg")
                && drawn.contains("sphere-on-sphere, slide")
                && !drawn.contains("NaN"),
            "{drawn}"
        );
    }
    // So is what is of no scene.
    std::fs::write(joined.join("box_on_edge.csv"), &nothing).unwrap();
    let misnamed = bench(folder.path(), &["wrench", "--quick", "--quiet", "--folder", "files"]);
    let said = text(&misnamed.stderr);
    assert!(
        misnamed.status.code() == Some(4)
            && said.contains("box_on_edge.csv")
            && said.contains("name it after a folder"),
        "{said}"
    );
    std::fs::remove_file(joined.join("box_on_edge.csv")).unwrap();
    // What does not fit its poses is refused, with the file and the remedy.
    std::fs::write(joined.join("box-on-edge.csv"), &nothing[..nothing.len() - 12]).unwrap();
    let refused = bench(folder.path(), &["wrench", "--quick", "--folder", "files"]);
    let said = text(&refused.stderr);
    assert!(
        refused.status.code() == Some(4)
            && said.contains("zero/box-on-edge.csv")
            && said.contains("one line for each pose"),
        "{said}"
    );
    let misplaced = bench(folder.path(), &["loop", "--quick", "--folder", "files"]);
    assert!(
        misplaced.status.code() == Some(2)
            && text(&misplaced.stderr).contains("bench wrench --folder")
    );
}

#[test]
fn groups_that_are_not_there_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let ended = bench(folder.path(), &["speed", "--quick"]);
    assert_eq!(ended.status.code(), Some(2));
    assert!(
        text(&ended.stderr).contains("sculpt") && ended.stdout.is_empty(),
        "{}",
        text(&ended.stderr)
    );
    let pictures = bench(folder.path(), &["loop", "--quick", "--plots", "here"]);
    assert!(
        pictures.status.code() == Some(2)
            && text(&pictures.stderr).contains("bench sculpt --plots")
    );
    let misplaced = bench(folder.path(), &["loop", "--quality", "--quick"]);
    assert!(
        misplaced.status.code() == Some(2)
            && text(&misplaced.stderr).contains("bench contact --quality")
    );
}

#[test]
fn every_command_of_the_bench_in_a_document_is_one_that_it_takes() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let folders = ["", "docs", "docs/adr", "docs/explanation", "docs/how-to", "docs/reference"]
        .map(|folder| root.join(folder));
    let pages = folders
        .iter()
        .flat_map(|folder| std::fs::read_dir(folder).unwrap())
        .map(|entry| entry.unwrap().path());
    let mut n_commands = 0;
    for page in pages.filter(|page| page.extension().is_some_and(|extension| extension == "md")) {
        let text = std::fs::read_to_string(&page).unwrap();
        for command in text.split("cargo run --release -p bench -- ").skip(1) {
            n_commands += 1;
            let arguments = command.split(['`', '\n', '#']).next().unwrap().split_whitespace();
            let shown = Command::new(env!("CARGO_BIN_EXE_bench"))
                .args(arguments)
                .arg("--help")
                .output()
                .unwrap();
            assert!(shown.status.success(), "{}: {command}", page.display());
        }
    }
    assert!(n_commands > 5, "{n_commands}");
}
