//! The bake cache through the real program: how processes share it, and what becomes of it when
//! they end badly.

use std::fs;
use std::os::unix::process::ExitStatusExt as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant, SystemTime};

use serde_json::Value;
use tempfile::TempDir;

/// Sent to a process that writes beyond the limit on the size of a file.
const SIGXFSZ: i32 = 25;

const PROGRAM: &str = env!("CARGO_BIN_EXE_hapticd");

/// A scene whose static object takes a moment to bake and 0.7 MB to keep.
const SCENE: &str = r#"version = 1
[[static]]
name = "ring"
shape = { torus_mm = [20.0, 5.0] }
voxel_size_mm = 0.8
layers = 4
[tool]
mesh = "part.obj"
units = "mm"
voxel_size_mm = 1.0
mass_g = 100.0
start_position_mm = [0, 0, 30]
[device]
profile = "sim-sigma7"
"#;

/// A block, thick enough for its voxels, so that nothing is warned of.
const PART: &str = "v 0 0 0\nv 11.3 0 0\nv 11.3 9.7 0\nv 0 9.7 0\nv 0 0 8.1\nv 11.3 0 8.1\nv 11.3 \
    9.7 8.1\nv 0 9.7 8.1\nf 4 3 2 1\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n";

fn folder() -> TempDir {
    let dir = tempfile::tempdir().unwrap();
    fs::write(dir.path().join("scene.toml"), SCENE).unwrap();
    fs::write(dir.path().join("part.obj"), PART).unwrap();
    fs::write(
        dir.path().join("poses.csv"),
        "t_s,x_m,y_m,z_m,qx,qy,qz,qw\n0,0.02,0,0.004,0,0,0,1\n",
    )
    .unwrap();
    dir
}

fn program(dir: &Path, line: &str) -> Command {
    let mut command = Command::new(PROGRAM);
    command.current_dir(dir).args(line.split_whitespace()).env("XDG_CACHE_HOME", dir.join("xdg"));
    command.env("XDG_STATE_HOME", dir.join("xdg-state")).stdin(Stdio::null());
    command
}

fn hapticd(dir: &Path, line: &str) -> Output {
    program(dir, line).output().unwrap()
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn json(output: &Output) -> Value {
    assert_eq!(output.status.code(), Some(0), "{}", stderr(output));
    serde_json::from_slice(&output.stdout).unwrap()
}

/// What the cache did for each object of `bake scene.toml --json`.
fn uses(report: &Value) -> Vec<String> {
    report["objects"]
        .as_array()
        .unwrap()
        .iter()
        .map(|object| object["cache"].as_str().unwrap().to_owned())
        .collect()
}

fn names(folder: &Path) -> Vec<String> {
    let Ok(entries) = fs::read_dir(folder) else { return Vec::new() };
    let mut names: Vec<_> =
        entries.map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

fn extension(folder: &Path, extension: &str) -> Vec<PathBuf> {
    names(folder)
        .iter()
        .map(|name| folder.join(name))
        .filter(|path| path.extension().is_some_and(|e| e == extension))
        .collect()
}

/// Bakes again; everything must come from the cache, and nothing be said.
fn assert_warm(dir: &Path, cache: &Path) {
    let output = hapticd(dir, &format!("bake scene.toml --json --cache {}", cache.display()));
    assert_eq!((uses(&json(&output)), stderr(&output).as_str()), (vec!["hit".to_owned(); 2], ""));
}

/// An object without what differs between a bake and a hit.
fn figures(mut object: Value) -> Value {
    for key in ["cache", "timings_s", "peak_rss_bytes"] {
        object.as_object_mut().unwrap().remove(key);
    }
    object
}

#[test]
fn bake_run_and_eval_share_the_cache_of_the_user() {
    let dir = folder();
    let first = hapticd(dir.path(), "bake scene.toml --json");
    assert_eq!((uses(&json(&first)), stderr(&first).as_str()), (vec!["miss".to_owned(); 2], ""));
    assert_eq!(names(&dir.path().join("xdg")), ["hapticd"]);
    assert_eq!(names(&dir.path().join("xdg/hapticd")).len(), 2);
    let second = json(&hapticd(dir.path(), "bake scene.toml --json"));
    assert_eq!(uses(&second), ["hit"; 2]);
    for (baked, hit) in json(&first)["objects"]
        .as_array()
        .unwrap()
        .iter()
        .zip(second["objects"].as_array().unwrap())
    {
        assert_eq!(figures(baked.clone()), figures(hit.clone()));
        let times = |object: &Value, key: &str| object["timings_s"][key].as_f64().unwrap();
        assert!(
            times(baked, "surface") > 0.0 && times(hit, "surface") == 0.0,
            "timings are those of this run"
        );
        assert!(times(hit, "load") > 0.0 && times(hit, "total") == times(hit, "load"));
    }
    let people = String::from_utf8(hapticd(dir.path(), "bake scene.toml").stdout).unwrap();
    assert_eq!(people.matches(" from the bake cache").count(), 2, "{people}");

    // The other two find what `bake` kept: nothing new appears, and the results are those of no
    // cache at all.
    let eval = |cache: &str| {
        let output = hapticd(
            dir.path(),
            &format!("eval scene.toml --poses poses.csv --out out.csv {cache}"),
        );
        assert_eq!((output.status.code(), stderr(&output).as_str()), (Some(0), ""));
        let table = fs::read_to_string(dir.path().join("out.csv")).unwrap();
        // The last column is how long it took.
        table.lines().map(|line| line.rsplit_once(',').unwrap().0.to_owned()).collect::<Vec<_>>()
    };
    let run = |cache: &str| {
        let output = hapticd(
            dir.path(),
            &format!("run scene.toml --clock virtual --duration 100ms --json {cache}"),
        );
        let report = json(&output);
        let [baked, first_tick] =
            ["baked", "first_tick"].map(|key| report["start_s"][key].as_f64().unwrap());
        assert!(0.0 < baked && baked < first_tick, "{}", report["start_s"]);
        report["final_pose"].clone()
    };
    assert_eq!(eval(""), eval("--cache off"));
    assert_eq!(run(""), run("--cache off"));
    assert_eq!(names(&dir.path().join("xdg/hapticd")).len(), 2);
    run("--cache other");
    assert_eq!(names(&dir.path().join("other")).len(), 2);
    assert_warm(dir.path(), &dir.path().join("other"));
}

#[test]
fn a_mesh_is_kept_too_unless_more_is_asked_for_than_the_cache_has() {
    let dir = folder();
    let bake = |more: &str| {
        json(&hapticd(
            dir.path(),
            &format!("bake part.obj --units mm --voxel-size-mm 0.5 --json {more}"),
        ))
    };
    let first = bake("");
    assert_eq!(first["cache"], "miss");
    let second = bake("");
    assert_eq!(second["cache"], "hit");
    assert_eq!(figures(first), figures(second));
    let outputs = [
        "--field-out f.npy",
        "--voxmap-out v.npy",
        "--pointshell-out p.ply",
        "--picture p.png",
        "--picture-3d d.png",
    ];
    for more in outputs.into_iter().chain(["--navigation two-sided", "--cache off"]) {
        assert_eq!(bake(more)["cache"], "off", "{more}");
    }
    assert_eq!(bake("--navigation auto")["cache"], "hit");
    let by_number = "bake part.obj --longest-axis-voxels 20 --json";
    assert_eq!(json(&hapticd(dir.path(), by_number))["cache"], "miss");
    assert_eq!(json(&hapticd(dir.path(), by_number))["cache"], "hit");
}

#[test]
fn memory_is_judged_for_what_is_baked_and_not_for_what_the_cache_has() {
    let dir = folder();
    for line in ["bake scene.toml --json", "bake part.obj --units mm --voxel-size-mm 0.5 --json"] {
        let limited = format!("{line} --max-memory 10kB");
        let refused = hapticd(dir.path(), &limited);
        assert_eq!(refused.status.code(), Some(3), "{}", stderr(&refused));
        let baked = hapticd(dir.path(), line);
        assert_eq!((baked.status.code(), stderr(&baked).as_str()), (Some(0), ""));
        let hit = hapticd(dir.path(), &limited);
        assert_eq!((hit.status.code(), stderr(&hit).as_str()), (Some(0), ""));
        let past_the_cache = hapticd(dir.path(), &format!("{limited} --cache off"));
        assert_eq!(past_the_cache.status.code(), Some(3), "{}", stderr(&past_the_cache));
    }
    // What the cache had is held beside what is baked.
    let warm = hapticd(
        dir.path(),
        "run scene.toml --clock virtual --duration 20ms --json --max-memory 10kB",
    );
    assert!(json(&warm)["ticks"].as_u64() > Some(10));
    fs::write(
        dir.path().join("scene.toml"),
        SCENE.replace("voxel_size_mm = 1.0", "voxel_size_mm = 1.1"),
    )
    .unwrap();
    let half = hapticd(
        dir.path(),
        "run scene.toml --clock virtual --duration 20ms --json --max-memory 500kB",
    );
    assert_eq!(half.status.code(), Some(3), "the ring alone takes more: {}", stderr(&half));
    assert!(stderr(&half).contains("tool"), "{}", stderr(&half));
}

#[test]
fn a_mesh_without_an_end_is_refused_before_it_is_hashed() {
    let dir = folder();
    std::os::unix::fs::symlink("/dev/zero", dir.path().join("endless.obj")).unwrap();
    let output = hapticd(dir.path(), "bake endless.obj --longest-axis-voxels 20");
    assert!(
        !output.status.success() && stderr(&output).contains("a device"),
        "{}",
        stderr(&output)
    );
    assert_eq!(names(&dir.path().join("xdg")), [""; 0]);
}

#[test]
fn without_a_home_there_is_no_cache() {
    let dir = folder();
    let homeless = |line: &str, home: Option<&str>| {
        let mut command = program(dir.path(), line);
        command.env_remove("XDG_CACHE_HOME").env_remove("HOME");
        if let Some(home) = home {
            // A relative path is to be ignored, says the specification.
            command.env("XDG_CACHE_HOME", "relative").env("HOME", home);
        }
        command.output().unwrap()
    };
    let output = homeless("bake scene.toml --json", None);
    assert_eq!((uses(&json(&output)), stderr(&output).as_str()), (vec!["off".to_owned(); 2], ""));
    assert!(
        stderr(&homeless("bake scene.toml -v", None))
            .contains("bake cache: off, as neither XDG_CACHE_HOME nor HOME")
    );
    let home = dir.path().join("home");
    assert_eq!(uses(&json(&homeless("bake scene.toml --json", home.to_str()))), ["miss"; 2]);
    assert_eq!(names(&home.join(".cache/hapticd")).len(), 2);
    assert!(!dir.path().join("relative").exists());
}

/// Whatever stands under its final name is whole; gives how many temporary files there are.
fn assert_nothing_broken(what: &str, cache: &Path) -> usize {
    for path in extension(cache, "bake") {
        let bytes = fs::read(&path).unwrap();
        assert!(hapticd::scene::cache::read(&bytes).is_ok(), "{what}: {}", path.display());
    }
    extension(cache, "tmp").len()
}

#[test]
fn a_bake_that_is_killed_leaves_no_broken_cache() {
    let dir = folder();
    let cache = dir.path().join("cache");
    let line = "bake scene.toml --json --cache cache";
    // Killed by a signal in the middle of a write, at a place that is not left to chance: the limit
    // on the size of a file, in blocks of 512 bytes.
    for blocks in [0, 1, 40, 300] {
        let script = format!("ulimit -c 0; ulimit -f {blocks}; exec '{PROGRAM}' {line}");
        let status = Command::new("sh")
            .args(["-c", &script])
            .current_dir(dir.path())
            .output()
            .unwrap()
            .status;
        assert_eq!(status.signal(), Some(SIGXFSZ), "{blocks} blocks: {status}");
        assert_eq!(assert_nothing_broken("limit", &cache), 1, "{blocks} blocks");
        let half = extension(&cache, "tmp").remove(0);
        assert!(fs::metadata(&half).unwrap().len() <= blocks * 512, "{blocks} blocks");
        fs::remove_file(half).unwrap();
    }
    assert_eq!(names(&cache), [""; 0]);
    // SIGKILL, whenever it comes.
    let since = Instant::now();
    assert!(hapticd(dir.path(), line).status.success());
    let whole = since.elapsed();
    let mut killed = 0;
    let mut left_behind = 0;
    for round in 0..8_u32 {
        fs::remove_dir_all(&cache).unwrap();
        let mut child =
            program(dir.path(), line).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        if round % 2 == 0 {
            // As soon as the child is writing.
            while extension(&cache, "tmp").is_empty() && child.try_wait().unwrap().is_none() {}
        } else {
            std::thread::sleep(whole * round / 8);
        }
        child.kill().unwrap();
        killed += u32::from(!child.wait().unwrap().success());
        left_behind += assert_nothing_broken("SIGKILL", &cache);
        if round % 4 == 0 {
            let after = hapticd(dir.path(), line);
            assert_eq!(stderr(&after), "", "nothing damaged was found");
            assert!(uses(&json(&after)).iter().all(|cache| cache == "hit" || cache == "miss"));
            assert_warm(dir.path(), &cache);
        }
        fs::create_dir_all(&cache).unwrap();
    }
    eprintln!("{killed} of 8 killed, {left_behind} temporary files left behind");
    // What they left behind goes, once it is certain that no process writes to it any more.
    fs::remove_dir_all(&cache).unwrap();
    fs::create_dir(&cache).unwrap();
    fs::write(cache.join("0.1-0.tmp"), "half").unwrap();
    let long_ago = SystemTime::now() - Duration::from_secs(3600);
    fs::File::open(cache.join("0.1-0.tmp")).unwrap().set_modified(long_ago).unwrap();
    assert!(hapticd(dir.path(), line).status.success());
    assert_eq!((extension(&cache, "tmp").len(), extension(&cache, "bake").len()), (0, 2));
}

#[test]
fn several_bakes_at_once_all_succeed() {
    let dir = folder();
    let line = "bake scene.toml --json --cache cache";
    let children: Vec<_> = (0..4)
        .map(|_| {
            program(dir.path(), line).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
        })
        .collect();
    for child in children {
        let output = child.wait_with_output().unwrap();
        assert_eq!(
            (json(&output)["objects"].as_array().unwrap().len(), stderr(&output).as_str()),
            (2, "")
        );
    }
    assert_eq!(
        (
            names(&dir.path().join("cache")).len(),
            extension(&dir.path().join("cache"), "bake").len()
        ),
        (2, 2)
    );
    assert_warm(dir.path(), &dir.path().join("cache"));
}

/// The bake succeeds without the cache and says so once, in plain words.
fn assert_goes_on(what: &str, output: &Output, words: &str) {
    assert_eq!(uses(&json(output)), ["miss"; 2], "{what}");
    let said = stderr(output);
    assert_eq!(said.lines().count(), 1, "{what}: {said}");
    for fragment in [
        "warning: the bake cache ",
        " cannot be written (",
        words,
        "nothing is kept for the next start",
        "--cache off",
    ] {
        assert!(said.contains(fragment), "{what}: no `{fragment}` in {said}");
    }
}

/// Runs shell commands in a mount namespace of their own, so that nothing stays mounted; `None`
/// where that is not allowed.
fn with_mounts(dir: &Path, script: &str) -> Option<Output> {
    let shell = |script: &str| {
        let mut command = Command::new("unshare");
        command
            .args(["--mount", "--map-root-user", "sh", "-ec", script])
            .current_dir(dir)
            .env("HAPTICD", PROGRAM);
        command.output().ok()
    };
    let possible = shell("mkdir -p probe && mount -t tmpfs -o size=64k tmpfs probe")
        .is_some_and(|output| output.status.success());
    if !possible {
        eprintln!("SKIPPED: file systems cannot be mounted here (unshare --mount --map-root-user)");
        return None;
    }
    shell(script)
}

#[test]
fn a_full_disk_is_reported_and_the_work_goes_on() {
    let dir = folder();
    let script = "mkdir full && mount -t tmpfs -o size=600k tmpfs full
        \"$HAPTICD\" bake scene.toml --json --cache full
        ls -A full >after.txt
        \"$HAPTICD\" run scene.toml --clock virtual --duration 50ms --json --cache full >run.json";
    if let Some(output) = with_mounts(dir.path(), script) {
        let said = stderr(&output);
        let (bake, run) = said.split_once('\n').unwrap();
        let bake = Output { stderr: bake.into(), ..output };
        assert_goes_on("tmpfs", &bake, "No space left on device");
        assert!(run.contains("No space left on device"), "{run}");
        assert_eq!(
            fs::read_to_string(dir.path().join("after.txt")).unwrap(),
            "",
            "neither a broken nor a temporary file"
        );
        let run: Value =
            serde_json::from_slice(&fs::read(dir.path().join("run.json")).unwrap()).unwrap();
        assert!(run["ticks"].as_u64() > Some(50));
    }
    // Without any rights: a limit on the size of files. In blocks of 512 bytes.
    let script = format!(
        "trap '' XFSZ; ulimit -f 64; exec '{PROGRAM}' bake scene.toml --json --cache limited"
    );
    let output = Command::new("sh").args(["-c", &script]).current_dir(dir.path()).output().unwrap();
    assert_goes_on("ulimit", &output, "File too large");
    assert_eq!(
        names(&dir.path().join("limited")),
        [""; 0],
        "neither a broken nor a temporary file"
    );
    assert_eq!(
        uses(&json(&hapticd(dir.path(), "bake scene.toml --json --cache limited"))),
        ["miss"; 2]
    );
    assert_warm(dir.path(), &dir.path().join("limited"));
}

#[test]
fn a_folder_that_cannot_be_written_is_reported_and_what_is_in_it_still_serves() {
    let dir = folder();
    fs::write(dir.path().join("file"), "").unwrap();
    assert_goes_on(
        "a file",
        &hapticd(dir.path(), "bake scene.toml --json --cache file"),
        "File exists",
    );
    assert_goes_on(
        "in a file",
        &hapticd(dir.path(), "bake scene.toml --json --cache file/folder"),
        "Not a directory",
    );
    // No user may create anything there, not even root.
    let output = hapticd(dir.path(), "bake scene.toml --json --cache /proc/hapticd-cache");
    assert_goes_on("/proc", &output, "No such file or directory");

    assert_eq!(
        uses(&json(&hapticd(dir.path(), "bake scene.toml --json --cache cache"))),
        ["miss"; 2]
    );
    let script = "mount --bind cache cache && mount -o remount,bind,ro cache
        \"$HAPTICD\" bake scene.toml --json --cache cache >hit.json
        sed -i 's/layers = 4/layers = 3/; s/voxel_size_mm = 1.0/voxel_size_mm = 1.1/' scene.toml
        \"$HAPTICD\" bake scene.toml --json --cache cache";
    if let Some(output) = with_mounts(dir.path(), script) {
        assert_goes_on("read-only", &output, "Read-only file system");
        let hit: Value =
            serde_json::from_slice(&fs::read(dir.path().join("hit.json")).unwrap()).unwrap();
        assert_eq!(uses(&hit), ["hit"; 2]);
    }
}

#[test]
fn a_damaged_or_foreign_file_is_reported_on_stderr_and_baked_anew() {
    let dir = folder();
    let line = "bake scene.toml --json --cache cache";
    assert!(hapticd(dir.path(), line).status.success());
    let files = extension(&dir.path().join("cache"), "bake");
    for path in &files {
        let bytes = fs::read(path).unwrap();
        fs::remove_file(path).unwrap();
        fs::write(path, &bytes[..bytes.len() / 2]).unwrap();
    }
    let output = hapticd(dir.path(), line);
    assert_eq!(uses(&json(&output)), ["rebaked"; 2]);
    let said = stderr(&output);
    assert_eq!(said.lines().count(), 2, "{said}");
    assert!(said.lines().all(|line| line.starts_with("warning: the cache file cache/")
        && line.contains("is damaged (its length)")));
    assert!(
        said.contains(": ring is baked anew and the file replaced")
            && said.contains(": tool is baked anew"),
        "{said}"
    );
    assert_warm(dir.path(), &dir.path().join("cache"));
}

#[test]
fn a_pipe_in_the_cache_is_refused_and_replaced() {
    let dir = folder();
    let line = "bake scene.toml --json --cache cache";
    assert!(hapticd(dir.path(), line).status.success());
    let file = extension(&dir.path().join("cache"), "bake").remove(0);
    fs::remove_file(&file).unwrap();
    assert!(Command::new("mkfifo").arg(&file).status().is_ok_and(|made| made.success()), "mkfifo");
    // Would wait for a writer for ever.
    let output = hapticd(dir.path(), line);
    assert!(
        output.status.success() && stderr(&output).contains("not a regular file"),
        "{}",
        stderr(&output)
    );
    assert_warm(dir.path(), &dir.path().join("cache"));
}

#[test]
fn advice_on_a_cache_that_cannot_be_written_fits_the_cause() {
    let dir = folder();
    fs::write(dir.path().join("file"), "").unwrap();
    let said = stderr(&hapticd(dir.path(), "bake scene.toml --json --cache file"));
    assert!(
        said.contains("move away the file that stands where the folder should be")
            && !said.contains("make room"),
        "{said}"
    );
}
