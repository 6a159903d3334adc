//! The program as a stranger meets it: the real binary, its words, its exit codes, its files, its
//! signals.

use std::collections::BTreeSet;
use std::fs::{self, File};
use std::io::{BufRead as _, BufReader, Read as _};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use serde_json::Value;
use tempfile::TempDir;

use super::program::{Ended, program};

/// A process that has not ended by then hangs.
const HUNG: Duration = Duration::from_secs(120);

const PLANE: &str = "shape = { plane_mm = [60.0, 60.0] }";

/// A scene of two shapes that bakes in no time: `object` is the static one, `more` follows
/// `[device]`.
fn scene(object: &str, voxel_size_mm: &str, more: &str) -> String {
    format!(
        r#"version = 1
[[static]]
name = "base"
{object}
voxel_size_mm = {voxel_size_mm}
layers = 4
[tool]
shape = {{ box_mm = [20.0, 20.0, 20.0] }}
voxel_size_mm = 2.0
mass_g = 100.0
start_position_mm = [0, 0, 15]
[device]
profile = "sim-sigma7"
{more}"#
    )
}

/// A folder with the sound scene `ok.toml` and one file for each thing that can be wrong with a
/// mesh.
fn folder() -> TempDir {
    let dir = tempfile::tempdir().unwrap();
    let write = |name: &str, bytes: &[u8]| fs::write(dir.path().join(name), bytes).unwrap();
    let stl = |announced: u8, body: &[u8]| [&[0_u8; 80][..], &[announced, 0, 0, 0], body].concat();
    write("ok.toml", scene(PLANE, "2.0", "").as_bytes());
    write("faceless.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\n");
    write("nan.obj", b"v 0 0 0\nv nan 0 0\nv 0 1 0\nf 1 2 3\n");
    write("range.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n");
    write("bytes.obj", b"");
    write("nothing.stl", &stl(0, b""));
    write("truncated.stl", &stl(10, b"abc"));
    write("part.step", b"ISO-10303-21;\n");
    write("part", b"v 0 0 0\n");
    write(
        "gear12.obj",
        b"v 0 0 0\nv 12 0 0\nv 0 12 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n",
    );
    fs::create_dir(dir.path().join("folder.obj")).unwrap();
    fs::create_dir(dir.path().join("folder.toml")).unwrap();
    fs::copy(shipped("models/peg.obj"), dir.path().join("peg.obj")).unwrap();
    dir
}

fn shipped(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("config").join(name)
}

/// A process that does not outlive its test.
struct Running {
    child: Child,
    stdout: Option<JoinHandle<String>>,
    /// Lines of stderr as they come.
    stderr: Receiver<String>,
    /// Those taken so far.
    said: String,
}

impl Running {
    fn start(command: &mut Command) -> Self {
        let mut child = command
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut out = child.stdout.take().unwrap();
        let stdout = std::thread::spawn(move || {
            let mut text = String::new();
            out.read_to_string(&mut text).unwrap();
            text
        });
        let err = BufReader::new(child.stderr.take().unwrap());
        let (sender, stderr) = channel();
        std::thread::spawn(move || {
            err.lines().map_while(Result::ok).try_for_each(|line| sender.send(line))
        });
        Self { child, stdout: Some(stdout), stderr, said: String::new() }
    }

    /// Waits for a line of stderr.
    fn wait_for(&mut self, wanted: &str) {
        while !self.said.lines().any(|line| line == wanted) {
            self.take_line(wanted);
        }
    }

    fn take_line(&mut self, wanted: &str) {
        match self.stderr.recv_timeout(HUNG) {
            Ok(line) => self.said.extend([&line, "\n"]),
            Err(error) => panic!("{error}: no `{wanted}` after\n{}", self.said),
        }
    }

    fn signal(&self, name: &str) {
        // The shell's own `kill`: the standard library only knows SIGKILL.
        let sent = Command::new("sh")
            .args(["-c", &format!("kill -{name} {}", self.child.id())])
            .status()
            .unwrap();
        assert!(sent.success());
    }

    fn end(mut self) -> Ended {
        let deadline = Instant::now() + HUNG;
        loop {
            match self.stderr.recv_timeout(deadline.saturating_duration_since(Instant::now())) {
                Ok(line) => self.said.extend([&line, "\n"]),
                Err(RecvTimeoutError::Disconnected) => break,
                Err(RecvTimeoutError::Timeout) => panic!("hangs after\n{}", self.said),
            }
        }
        let stdout = self.stdout.take().unwrap().join().unwrap();
        Ended {
            code: self.child.wait().unwrap().code(),
            stdout,
            stderr: std::mem::take(&mut self.said),
        }
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        // Already reaped after `end`; killed when the test failed on its way there.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn start(dir: &Path, args: &[&str]) -> Running {
    Running::start(program(dir).args(args))
}

fn hapticd(dir: &Path, line: &str) -> Ended {
    start(dir, &line.split_whitespace().collect::<Vec<_>>()).end()
}

/// The command ends with this code, says each fragment on stderr, nothing on stdout, and does not
/// panic.
fn refuses(dir: &Path, line: &str, code: i32, fragments: &[&str]) {
    let ended = hapticd(dir, line);
    assert_eq!(ended.code, Some(code), "{line}\n{}", ended.stderr);
    for fragment in fragments {
        assert!(ended.stderr.contains(fragment), "{line}: no `{fragment}` in\n{}", ended.stderr);
    }
    assert_eq!(ended.stdout, "", "{line}");
    assert!(!ended.stderr.contains("panicked"), "{line}\n{}", ended.stderr);
}

fn keys(value: &Value) -> BTreeSet<&str> {
    value.as_object().unwrap().keys().map(String::as_str).collect()
}

fn set<'k>(keys: &[&'k str]) -> BTreeSet<&'k str> {
    keys.iter().copied().collect()
}

#[test]
fn a_wrong_command_line_is_a_usage_error() {
    let dir = folder();
    for (line, fragments) in [
        ("", &["Usage: hapticd", "run", "bake", "check", "eval"][..]),
        ("runn ok.toml", &["'runn'", "'run'"]),
        ("bench contact --quick", &["cargo run --release -p bench -- contact --quick"]),
        ("start ok.toml", &["'start'", "the command for that is `hapticd run SCENE`"]),
        ("validate ok.toml", &["`hapticd check SCENE`"]),
        ("probe polhem-2022", &["`hapticd devices probe PROFILE`"]),
        ("frobnicate", &["'frobnicate'", "--help"]),
        (
            "devices probe polhem-2022 --sign-check",
            &["--sign-check pushes the grip", "no terminal", "--yes"],
        ),
        ("devices probe polhem-2022 --identify --json", &["--identify pushes the grip", "--yes"]),
        ("eval ok.toml --poses p.csv --out - --contacts-out -", &["stdout takes one of the two"]),
        ("run", &["<SCENE>"]),
        ("run ok.toml --durration 10s", &["'--durration'", "'--duration'"]),
        (
            "run ok.toml --duration 10",
            &["--duration", "`10` is not a duration", "10s, 500ms or 2min"],
        ),
        ("run ok.toml --duration -1s", &["--duration", "`-1s` is not a duration"]),
        ("run ok.toml --clock fast", &["'fast'", "real, virtual"]),
        ("run ok.toml -q -v", &["--quiet", "--verbose"]),
        ("run ok.toml --move lift", &["--move", "plate=hands/plate.csv"]),
        ("run ok.toml --swap b.toml", &["--swap", "b.toml@3s"]),
        ("run ok.toml --swap b.toml@3", &["--swap", "`3` is not a duration"]),
        ("check", &["<SCENE>"]),
        ("bake peg.obj", &["--voxel-size-mm S or --longest-axis-voxels N"]),
        ("bake peg.obj --voxel-size-mm 0.5", &["--voxel-size-mm needs --units m|mm|cm|in"]),
        ("bake peg.obj --voxel-size-mm 0.5 --units furlong", &["'furlong'", "m, mm, cm, in"]),
        (
            "bake peg.obj --voxel-size-mm 0 --units mm",
            &["--voxel-size-mm 0: must be greater than 0"],
        ),
        (
            "bake peg.obj --voxel-size-mm -1 --units mm",
            &["--voxel-size-mm -1: must be greater than 0"],
        ),
        (
            "bake peg.obj --voxel-size-mm nan --units mm",
            &["--voxel-size-mm NaN: must be greater than 0"],
        ),
        ("bake peg.obj --voxel-size-mm inf --units mm", &["at most 1000 mm"]),
        ("bake peg.obj --voxel-size-mm half --units mm", &["'half'", "--voxel-size-mm"]),
        (
            "bake peg.obj --voxel-size-mm 1 --longest-axis-voxels 9 --units mm",
            &["--longest-axis-voxels", "cannot be used with"],
        ),
        ("bake peg.obj --longest-axis-voxels 0", &["--longest-axis-voxels"]),
        ("bake peg.obj --voxel-size-mm 1 --units mm --layers 1", &["--layers", "2..=60"]),
        ("bake peg.obj --voxel-size-mm 1 --units mm --threads 0", &["--threads"]),
        (
            "bake ok.toml --voxel-size-mm 1",
            &["--voxel-size-mm goes with a mesh; a scene says it in its file"],
        ),
        ("bake ok.toml --units mm", &["--units goes with a mesh"]),
        ("bake ok.toml --voxmap-out v.npy", &["--voxmap-out goes with a mesh"]),
        ("bake ok.toml --pointshell-out p.ply", &["--pointshell-out goes with a mesh"]),
    ] {
        refuses(dir.path(), line, 2, fragments);
    }
}

/// Two scenes whose plate moves, one for another arm, one that cannot be baked, and a path of the
/// plate.
fn folder_of_changes() -> TempDir {
    let dir = folder();
    let movable = |object: &str| {
        scene(object, "2.0", "").replace("layers = 4\n[tool]", "layers = 4\nmovable = true\n[tool]")
    };
    let write = |name: &str, text: &str| fs::write(dir.path().join(name), text).unwrap();
    write("a.toml", &movable(PLANE));
    write("b.toml", &movable("shape = { plane_mm = [40.0, 40.0] }"));
    write("arm.toml", &movable(PLANE).replace("sim-sigma7", "sim-touch"));
    write("rate.toml", &movable(PLANE).replace("[tool]", "[rendering]\nrate_hz = 500\n[tool]"));
    write("held.toml", &movable(PLANE).replace("[tool]", "[safety]\ndeadman = 2\n[tool]"));
    write("unbaked.toml", &scene("mesh = \"faceless.obj\"\nunits = \"mm\"", "2.0", ""));
    write("up.csv", "t_s,x_m,y_m,z_m,qx,qy,qz,qw\n0,0,0,0,0,0,0,1\n0.5,0,0,0.01,0,0,0,1\n");
    write("bad.csv", "t_s,x_m,y_m,z_m,qx,qy,qz,qw\n0,0,0,0,0,0,0,1\n0.5,0,0,up,0,0,0,1\n");
    write("far.csv", "t_s,x_m,y_m,z_m,qx,qy,qz,qw\n0,0,0,5e6,0,0,0,1\n");
    dir
}

#[test]
fn a_part_moves_and_scenes_take_each_others_place_while_a_run_goes_on() {
    let dir = folder_of_changes();
    let line = "run a.toml --cache off --clock virtual --duration 3s --move base=up.csv --swap \
        b.toml@1s --swap a.toml@2s --json";
    let [ended, again] = [hapticd(dir.path(), line), hapticd(dir.path(), line)];
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let round = ["stopping", "disabled", "enabling", "enabled"];
    let states = [
        &["baking", "disabled", "enabling", "enabled"][..],
        &round,
        &round,
        &["stopping", "disabled", "stopped"],
    ]
    .concat();
    assert_eq!(ended.states(), states);
    let json = ended.json();
    assert!(json["object_work_j"].as_f64() > Some(0.0) && json["missed_deadlines"] == 0);
    let swaps = json["swaps"].as_array().unwrap();
    assert_eq!([&swaps[0]["scene"], &swaps[1]["scene"]], ["b.toml", "a.toml"]);
    for (swap, wanted_s) in swaps.iter().zip([1.0, 2.0]) {
        assert!(
            swap["wanted_s"] == wanted_s && swap["tick"].as_f64() > Some(1000.0 * wanted_s),
            "{swap}"
        );
        assert!(swap["at_s"].as_f64() < Some(wanted_s + 0.15), "{swap}");
    }
    let again = again.json();
    assert_eq!(
        (&json["swaps"], &json["final_pose"]),
        (&again["swaps"], &again["final_pose"]),
        "two runs are the same"
    );
    // As fast one after the other as can be.
    let line = "run a.toml --cache off --clock virtual --duration 1s --swap b.toml@100ms --swap \
        a.toml@100ms --swap b.toml@100ms --json";
    let fast: Vec<Value> =
        (0..3).map(|_| hapticd(dir.path(), line).json()["swaps"].clone()).collect();
    assert!(fast[0][2]["tick"].is_u64() && fast.iter().all(|swaps| *swaps == fast[0]), "{fast:?}");
    // Only what was asked for is reported.
    let plain =
        hapticd(dir.path(), "run a.toml --cache off --clock virtual --duration 100ms --json")
            .json();
    assert!(plain.get("swaps").is_none() && plain.get("object_work_j").is_none());
}

#[test]
fn what_cannot_change_is_refused_before_anything_is_baked() {
    let dir = folder_of_changes();
    for (change, fragments) in [
        ("--move bose=up.csv", &["a.toml: no object is called `bose`", "known here: base"][..]),
        (
            "--move base=none.csv",
            &["cannot read pose file none.csv", "--move NAME=FILE takes a CSV file"],
        ),
        ("--move base=bad.csv", &["bad.csv:3: `up` is not a finite number (column z_m)"]),
        ("--move base=far.csv", &["not a pose that `base` can go to", "within 1 km"]),
        ("--move base=up.csv --move base=up.csv", &["`base` is given twice"]),
        ("--swap none.toml@1s", &["none.toml"]),
        (
            "--swap arm.toml@1s",
            &["arm.toml: device.profile = \"sim-touch\", but a.toml has \"sim-sigma7\"", "hint: "],
        ),
        ("--swap rate.toml@1s", &["rate.toml: rendering.rate_hz = 500, but a.toml has 1000"]),
        ("--swap held.toml@1s", &["held.toml: safety.deadman = 2, but a.toml has \"off\""]),
    ] {
        refuses(
            dir.path(),
            &format!("run a.toml --cache off --clock virtual --duration 1s {change}"),
            3,
            fragments,
        );
    }
    refuses(
        dir.path(),
        "run a.toml --cache off --duration 1s --swap b.toml@1s",
        2,
        &["b.toml: at 1s, but the run ends after 1s"],
    );
    refuses(
        dir.path(),
        "run ok.toml --monitor off --cache off --duration 1s --move base=up.csv",
        3,
        &["`base` is not movable; set `movable = true`"],
    );
    // What only baking shows comes when the run is over, which it does not end.
    let ended = hapticd(
        dir.path(),
        "run a.toml --cache off --clock virtual --duration 2s --swap unbaked.toml@1s --json",
    );
    assert_eq!(ended.code, Some(4), "{}", ended.stderr);
    assert!(
        ended.stderr.contains("unbaked.toml was not rendered")
            && ended.stderr.contains("no triangles"),
        "{}",
        ended.stderr
    );
    assert!(
        ended.json()["swaps"][0]["tick"].is_null() && ended.json()["ticks"].as_u64() > Some(2000)
    );
}

#[test]
fn a_mesh_that_cannot_be_used_is_an_asset_error() {
    let dir = folder();
    let mut cases = vec![
        ("none.obj", vec!["error: none.obj: no such file"]),
        ("faceless.obj", vec!["error: faceless.obj: no triangles", "hint: export a surface mesh"]),
        ("bytes.obj", vec!["error: bytes.obj: no triangles"]),
        ("nothing.stl", vec!["error: nothing.stl: no triangles"]),
        ("nan.obj", vec!["error: nan.obj:2: vertex 2 is not finite", "hint: "]),
        ("range.obj", vec!["error: range.obj:4: face names vertex 9, the file has 3"]),
        (
            "truncated.stl",
            vec![
                "truncated, 584 bytes expected for 10 triangles, 87 found",
                "hint: the file was cut",
            ],
        ),
        (
            "part.step",
            vec![
                "error: part.step: STEP files hold curved surfaces, and a mesh of triangles is \
                    needed",
                "hint: convert it: `gmsh PART.step -2",
            ],
        ),
        ("part", vec!["error: part: no mesh extension, known: obj, stl, ply, gltf, glb, 3mf"]),
        (
            "folder.obj",
            vec!["error: folder.obj: cannot be read: ", "hint: check that it is a file"],
        ),
    ];
    if let Some(name) = unreadable(dir.path()) {
        cases.push((
            name,
            vec![
                "error: unreadable.obj: cannot be read: Permission denied",
                "that this user may read it",
            ],
        ));
    }
    for (mesh, fragments) in &cases {
        refuses(dir.path(), &format!("bake {mesh} --units mm --voxel-size-mm 0.5"), 4, fragments);
    }
    // What the scene file can tell by the name of the mesh is a matter of the scene; its contents
    // are an asset.
    for (mesh, fragments) in cases {
        let object = format!("mesh = \"{mesh}\"\nunits = \"mm\"");
        fs::write(dir.path().join("mesh.toml"), scene(&object, "0.5", "")).unwrap();
        let by_name = ["none.obj", "part.step", "part", "folder.obj"].contains(&mesh);
        let in_scene = format!("mesh.toml:4: static[0].mesh = \"{mesh}\": ");
        let fragments = if by_name {
            vec![in_scene.as_str()]
        } else {
            vec![fragments[0].trim_start_matches("error: ")]
        };
        for command in ["run mesh.toml --clock virtual --duration 1s", "bake mesh.toml"] {
            refuses(dir.path(), command, if by_name { 3 } else { 4 }, &fragments);
        }
    }
}

/// A file that this user may not read; `None` for root, who may.
fn unreadable(dir: &Path) -> Option<&'static str> {
    use std::os::unix::fs::PermissionsExt as _;
    let path = dir.join("unreadable.obj");
    fs::write(&path, "v 0 0 0\n").unwrap();
    fs::set_permissions(&path, fs::Permissions::from_mode(0o000)).unwrap();
    if File::open(&path).is_ok() {
        eprintln!("skipped: this user reads everything");
        return None;
    }
    Some("unreadable.obj")
}

#[test]
fn a_wrong_scene_is_a_configuration_error_of_every_command() {
    let dir = folder();
    let hand = "t_s,x_m,y_m,z_m,qx,qy,qz,qw\n0,0,0,0,0,0,0,1\n1,0,zero,0,0,0,0,1\n";
    fs::write(dir.path().join("hand.csv"), hand).unwrap();
    for (text, fragments) in [
        (
            scene(PLANE, "0.0", ""),
            &["wrong.toml:5: static[0].voxel_size_mm = 0.0: must be greater than 0"][..],
        ),
        (
            scene(PLANE, "2.0", "profil = 1\n"),
            &[
                "wrong.toml:14: device.profil = 1: unknown key; did you mean `profile`?",
                "known here: ",
            ],
        ),
        (
            scene("mesh = \"peg.obj\"\nunits = \"millimetres\"", "1", ""),
            &["wrong.toml:5: static[0].units", "did you mean `mm`?"],
        ),
        (scene("mesh = \"peg.obj\"", "1", ""), &["static[0].units: missing", "factor of 1000"]),
        (
            scene(PLANE, "2.0", "").replace("sim-sigma7", "sim-sigma"),
            &["wrong.toml:13: device.profile = \"sim-sigma\": no device profile of this name; \
                    did you mean `sim-sigma7`?"],
        ),
        (
            scene(PLANE, "2.0", "[coupling]\ntranslation_n_per_mm = 5\n"),
            &[
                "wrong.toml:15: coupling.translation_n_per_mm = 5",
                "stability bound of 4000 N/m",
                "hint: write at most 4 N/mm",
            ],
        ),
        (
            scene(PLANE, "2.0", "hand = \"hand.csv\"\n"),
            &["hand.csv:3: `zero` is not a finite number (column y_m)"],
        ),
        (
            scene(PLANE, "2.0", "hand = \"none.csv\"\n"),
            &["wrong.toml:14: device.hand = \"none.csv\": no such file"],
        ),
        (
            scene(PLANE, "2.0", "hand = \"folder.toml\"\n"),
            &["wrong.toml:14: device.hand = \"folder.toml\": not a file"],
        ),
        (
            scene(PLANE, "2.0", "sim = { fault = \"unplugged@2s\" }\n"),
            &["wrong.toml:14: device.sim.fault", "did you mean `unplug`?"],
        ),
        (
            scene(PLANE, "2.0", "sim = { fault = \"nan@5\" }\n"),
            &["wrong.toml:14: device.sim.fault = \"nan@5\"", "10s, 500ms or 2min"],
        ),
        (
            scene(PLANE, "2.0", "sim = { fault = \"slow@5s\" }\n"),
            &["wrong.toml:14: device.sim.fault", "as in slow=4ms"],
        ),
        (
            scene(PLANE, "2.0", "sim = { fault = \"drop=200%\" }\n"),
            &["wrong.toml:14: device.sim.fault", "from 0% to 100%"],
        ),
        (String::new(), &["wrong.toml: version: missing", "hint: write `version = 1`"]),
        ("version = ".to_owned(), &["wrong.toml:1: not TOML"]),
    ] {
        fs::write(dir.path().join("wrong.toml"), text).unwrap();
        for command in ["check wrong.toml", "run wrong.toml --clock virtual --duration 1s"] {
            refuses(dir.path(), command, 3, fragments);
        }
    }
    for command in ["check", "run", "bake"] {
        refuses(
            dir.path(),
            &format!("{command} none.toml"),
            3,
            &["error: none.toml: no such file", "relative to the working directory"],
        );
        refuses(
            dir.path(),
            &format!("{command} okk.toml"),
            3,
            &["error: okk.toml: no such file", "did you mean `ok.toml`?"],
        );
        refuses(
            dir.path(),
            &format!("{command} folder.toml"),
            3,
            &["error: folder.toml: cannot be read: is a directory"],
        );
    }
    fs::write(dir.path().join("binary.toml"), [0xff, 0xfe, 0]).unwrap();
    refuses(dir.path(), "check binary.toml", 3, &["error: binary.toml: cannot be read"]);
    refuses(
        dir.path(),
        "run ok.toml --device ideal",
        3,
        &["--device = \"ideal\"", "did you mean `sim-ideal`?"],
    );
    refuses(
        dir.path(),
        "run ok.toml --device ./my.toml",
        3,
        &["no such file: ./my.toml", "relative to the working directory"],
    );
}

/// Ten million voxels wide: refused from the box alone. The address space is limited, so that a
/// grid could not even be asked for.
#[test]
fn an_absurd_grid_is_refused_before_it_is_allocated() {
    let dir = folder();
    fs::write(dir.path().join("absurd.toml"), scene(PLANE, "0.000006", "")).unwrap();
    for (line, hint) in [
        ("run absurd.toml --monitor off", "hint: use a voxel size of at least "),
        ("bake absurd.toml", "hint: use a voxel size of at least "),
        ("bake peg.obj --units mm --voxel-size-mm 0.000004", "mm, or check --units"),
        ("bake peg.obj --units mm --voxel-size-mm 1e-300", "mm, or check --units"),
        (
            "bake peg.obj --units mm --longest-axis-voxels 10000000",
            "hint: ask for fewer --longest-axis-voxels",
        ),
    ] {
        let limited =
            format!("ulimit -v 4000000 && exec '{}' {line}", env!("CARGO_BIN_EXE_hapticd"));
        let ended = Running::start(
            Command::new("sh")
                .args(["-c", &limited])
                .current_dir(dir.path())
                .env("XDG_CACHE_HOME", dir.path()),
        )
        .end();
        assert_eq!(ended.code, Some(3), "{line}\n{}", ended.stderr);
        assert!(
            ended.stderr.contains(" voxels is too large (at most 32768 per axis"),
            "{line}\n{}",
            ended.stderr
        );
        assert!(ended.stderr.contains(hint), "{line}\n{}", ended.stderr);
    }
}

#[test]
fn a_gear_of_twelve_metres_is_asked_about() {
    let dir = folder();
    let ended = hapticd(dir.path(), "bake gear12.obj --units m --voxel-size-mm 500");
    assert_eq!(ended.code, Some(0));
    assert!(
        ended.stderr.contains("warning: gear12: the box is 12.0 m long: is --units right?"),
        "{}",
        ended.stderr
    );
    let ended = hapticd(dir.path(), "bake gear12.obj --units mm --voxel-size-mm 0.5");
    assert!(!ended.stderr.contains("units"), "{}", ended.stderr);
    let ended = hapticd(dir.path(), "bake -q gear12.obj --units m --voxel-size-mm 500");
    assert_eq!((ended.code, ended.stderr.as_str()), (Some(0), ""));
}

#[test]
fn an_output_that_cannot_be_written_is_reported_by_name() {
    let dir = folder();
    for (flag, path, fragment) in [
        ("--voxmap-out", "/nonexistent/x.npy", "hint: the folder must exist"),
        ("--field-out", "/nonexistent/x.npy", "hint: the folder must exist"),
        ("--pointshell-out", "/nonexistent/x.ply", "hint: the folder must exist"),
        ("--voxmap-out", "folder.obj", "hint: give a file name"),
        ("--voxmap-out", "peg.obj/x.npy", "peg.obj is no folder"),
        ("--voxmap-out", "/dev/full", "No space left"),
        ("--pointshell-out", "/dev/full", "No space left"),
    ] {
        let line = format!("bake peg.obj --units mm --voxel-size-mm 1 {flag} {path}");
        refuses(dir.path(), &line, 4, &[&format!("error: cannot write {path}: "), fragment]);
    }
    let line = "mock open6-serial --pty arm --no-hand --trace none/t.csv";
    refuses(dir.path(), line, 4, &["error: cannot write none/t.csv: ", "the folder must exist"]);
}

#[test]
fn a_bake_does_not_overwrite_its_own_mesh() {
    let dir = folder();
    let before = std::fs::read(dir.path().join("peg.obj")).unwrap();
    for flag in ["--voxmap-out", "--field-out", "--pointshell-out"] {
        let line = format!("bake peg.obj --units mm --voxel-size-mm 1 {flag} ./peg.obj");
        refuses(dir.path(), &line, 2, &["error: ./peg.obj is the mesh itself"]);
    }
    assert_eq!(std::fs::read(dir.path().join("peg.obj")).unwrap(), before);
}

#[test]
fn profiles_are_checked_like_scenes() {
    let dir = folder();
    let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("devices/polhem-2022.toml");
    let ended = hapticd(dir.path(), &format!("check {}", shipped.display()));
    assert_eq!((ended.code, ended.stderr.as_str()), (Some(0), ""));
    assert!(
        ended.stdout.starts_with("ok ") && ended.stdout.contains("signs not verified"),
        "{}",
        ended.stdout
    );
    let text = std::fs::read_to_string(&shipped).unwrap();
    std::fs::write(
        dir.path().join("mine.toml"),
        text.replace("signs_verified = false", "signs_verifed = true"),
    )
    .unwrap();
    let ended = hapticd(dir.path(), "check mine.toml");
    assert_eq!((ended.code, ended.stdout.as_str()), (Some(3), ""));
    for fragment in ["mine.toml:", "device.signs_verifed", "did you mean `signs_verified`"] {
        assert!(ended.stderr.contains(fragment), "{fragment}: {}", ended.stderr);
    }
}

#[test]
fn built_in_profiles_are_listed_and_can_be_copied() {
    let dir = folder();
    let listed = hapticd(dir.path(), "devices profiles");
    assert_eq!((listed.code, listed.stderr.as_str()), (Some(0), ""));
    let names: Vec<&str> =
        listed.stdout.lines().filter_map(|line| line.split_whitespace().next()).collect();
    assert_eq!(names, arms::profile::names().collect::<Vec<_>>());
    let json = hapticd(dir.path(), "devices --json profiles").json();
    assert_eq!(json["profiles"].as_array().map(Vec::len), Some(names.len()));
    let one = hapticd(dir.path(), "devices profiles polhem-2022");
    let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("devices/polhem-2022.toml");
    assert_eq!((one.code, one.stdout), (Some(0), std::fs::read_to_string(shipped).unwrap()));
    refuses(
        dir.path(),
        "devices profiles polhem",
        3,
        &["error: polhem: no device profile of this name", "polhem-2022"],
    );
}

#[test]
fn help_is_a_result() {
    let dir = folder();
    for command in ["", "run", "bake", "check", "eval"] {
        let ended = hapticd(dir.path(), &format!("{command} --help"));
        assert_eq!((ended.code, ended.stderr.as_str()), (Some(0), ""));
        assert!(ended.stdout.contains("Usage: hapticd"), "{}", ended.stdout);
    }
    let ended = hapticd(dir.path(), "--version");
    assert_eq!(ended.stdout, format!("hapticd {}\n", env!("CARGO_PKG_VERSION")));
}

const RUN_KEYS: [&str; 15] = [
    "ticks",
    "duration_s",
    "rate_hz",
    "missed_deadlines",
    "wakeup_us",
    "compute_us",
    "device_us",
    "max_force_n",
    "max_torque_nm",
    "max_depth_m",
    "depth_is_bound",
    "contact_ticks",
    "faults",
    "realtime",
    "final_pose",
];
/// Beyond the contract.
const RUN_KEYS_EXTRA: [&str; 13] = [
    "clock",
    "corrupt_packets",
    "contact_budget_points",
    "delay_ticks",
    "dropped_records",
    "histograms_us",
    "lost_packets",
    "lowest_energy_j",
    "passivity_ticks",
    "points_left_out",
    "rendered",
    "stale_samples",
    "start_s",
];

fn assert_run_keys(json: &Value) {
    let documented = set(&RUN_KEYS);
    let extra = set(&RUN_KEYS_EXTRA);
    assert_eq!(keys(json), documented.union(&extra).copied().collect());
    for latency in ["wakeup_us", "compute_us", "device_us"] {
        assert_eq!(keys(&json[latency]), set(&["p50", "p99", "p999", "max"]), "{latency}");
    }
    assert_eq!(
        keys(&json["realtime"]),
        set(&["policy", "priority", "cpu", "memory_locked", "kernel_rt"])
    );
    assert_eq!(keys(&json["final_pose"]), set(&["x_m", "y_m", "z_m", "qx", "qy", "qz", "qw"]));
}

#[test]
fn a_run_gives_one_json_object_and_talks_on_stderr() {
    let dir = folder();
    let ended = hapticd(dir.path(), "run ok.toml --clock virtual --duration 300ms --json");
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let json = ended.json();
    assert_run_keys(&json);
    assert_eq!((json["rate_hz"].as_u64(), json["clock"].as_str()), (Some(1000), Some("virtual")));
    assert_eq!(json["faults"].as_array().map(Vec::len), Some(0));
    // 300 ms and the ramp down.
    assert!(json["ticks"].as_u64() > Some(300));
    assert_eq!(
        ended.states(),
        ["baking", "disabled", "enabling", "enabled", "stopping", "disabled", "stopped"]
    );
    assert!(ended.stderr.contains("preflight: "));
    assert!(
        !ended.stderr.contains('\x1b') && !ended.stderr.contains("tick "),
        "no status line on a pipe: {}",
        ended.stderr
    );

    let ended = hapticd(dir.path(), "run ok.toml --clock virtual --duration 300ms");
    for row in [
        "ticks ",
        "missed deadlines ",
        "wake-up ",
        "largest command ",
        "tool at the end ",
        "faults             none",
    ] {
        assert!(ended.stdout.lines().any(|line| line.starts_with(row)), "{row}: {}", ended.stdout);
    }
}

#[test]
fn quiet_is_quiet_verbose_says_more_and_colour_is_colour() {
    let dir = folder();
    for clock in ["virtual", "real"] {
        let ended = hapticd(
            dir.path(),
            &format!(
                "run -q ok.toml --clock {clock} --duration 100ms --json --monitor off --realtime \
                    best-effort"
            ),
        );
        assert_eq!((ended.code, ended.stderr.as_str()), (Some(0), ""));
        assert_run_keys(&ended.json());
    }
    let ended = hapticd(dir.path(), "check -q ok.toml");
    assert_eq!((ended.code, ended.stdout.as_str(), ended.stderr.as_str()), (Some(0), "", ""));
    let ended = hapticd(dir.path(), "run -q none.toml");
    assert!(
        ended.stderr.starts_with("error: none.toml"),
        "errors are said to the quiet too: {}",
        ended.stderr
    );

    let ended = hapticd(dir.path(), "run -v ok.toml --clock virtual --duration 100ms --json");
    ended.json();
    for fragment in
        ["sim-sigma7 at 1000 Hz, implicit, 4000 N/m", "base (12 triangles)", "tool (12 triangles)"]
    {
        assert!(ended.stderr.contains(fragment), "{fragment}: {}", ended.stderr);
    }

    let ended = hapticd(dir.path(), "--color always run none.toml");
    assert!(ended.stderr.contains("\x1b[1;31merror:\x1b[0m none.toml"), "{}", ended.stderr);
    let ended = hapticd(dir.path(), "bake --color=always gear12.obj --units m --voxel-size-mm 500");
    assert!(ended.stderr.contains("\x1b[1;33mwarning:\x1b[0m "), "{}", ended.stderr);
}

/// A reader that went away, or never came, is no reason to panic; the arm still comes to rest.
#[test]
fn a_closed_pipe_and_a_full_disk_do_not_panic() {
    let dir = folder();
    let bake = "bake peg.obj --units mm --voxel-size-mm 1";
    let run = "run ok.toml --clock virtual --duration 100ms";
    for line in [
        "check ok.toml",
        bake,
        "bake ok.toml --json",
        run,
        "run ok.toml --clock virtual --duration 100ms --json",
    ] {
        let (out_reader, out) = std::io::pipe().unwrap();
        let (err_reader, err) = std::io::pipe().unwrap();
        drop(out_reader);
        // First stdout alone, then both.
        let mut running = Running::start_into(
            program(dir.path()).args(line.split_whitespace()),
            out.try_clone().unwrap().into(),
        );
        let stderr = running.rest_of_stderr();
        assert!(!stderr.contains("panicked") && !stderr.contains("error"), "{line}: {stderr}");
        assert_eq!(running.child.wait().unwrap().code(), Some(0), "{line}");
        drop(err_reader);
        let mut child = program(dir.path())
            .args(line.split_whitespace())
            .stdin(Stdio::null())
            .stdout(out)
            .stderr(err)
            .spawn()
            .unwrap();
        assert_eq!(child.wait().unwrap().code(), Some(0), "{line}, no reader");

        let full = || File::options().write(true).open("/dev/full").unwrap();
        let mut running =
            Running::start_into(program(dir.path()).args(line.split_whitespace()), full().into());
        let stderr = running.rest_of_stderr();
        assert!(
            stderr.ends_with(
                "error: cannot write the result to stdout: No space left on device (os error 28)\n"
            ),
            "{line}: {stderr}"
        );
        assert_eq!(running.child.wait().unwrap().code(), Some(4), "{line}");
    }
}

impl Running {
    /// Starts with stdout elsewhere.
    fn start_into(command: &mut Command, stdout: Stdio) -> Self {
        let mut child =
            command.stdin(Stdio::null()).stdout(stdout).stderr(Stdio::piped()).spawn().unwrap();
        let err = BufReader::new(child.stderr.take().unwrap());
        let (sender, stderr) = channel();
        std::thread::spawn(move || {
            err.lines().map_while(Result::ok).try_for_each(|line| sender.send(line))
        });
        Self { child, stdout: None, stderr, said: String::new() }
    }

    fn rest_of_stderr(&mut self) -> String {
        let deadline = Instant::now() + HUNG;
        while let Ok(line) =
            self.stderr.recv_timeout(deadline.saturating_duration_since(Instant::now()))
        {
            self.said.extend([&line, "\n"]);
        }
        self.said.clone()
    }
}

#[test]
fn a_signal_brings_the_arm_to_rest() {
    let scene = shipped("scenes/block-on-plane.toml");
    let args =
        ["run", scene.to_str().unwrap(), "--json", "--monitor", "off", "--realtime", "best-effort"];
    for signal in ["INT", "TERM"] {
        let mut running = start(Path::new("."), &args);
        running.wait_for("state: enabled");
        // In the middle of the descent; not a condition of anything below.
        std::thread::sleep(Duration::from_millis(900));
        running.signal(signal);
        let ended = running.end();
        assert_eq!(ended.code, Some(0), "{signal}: {}", ended.stderr);
        assert_eq!(
            ended.states(),
            ["baking", "disabled", "enabling", "enabled", "stopping", "disabled", "stopped"],
            "{signal}"
        );
        let json = ended.json();
        assert_run_keys(&json);
        assert!(json["ticks"].as_u64() > Some(0));
        assert_eq!(json["clock"], "real");
        assert_eq!(json["faults"].as_array().map(Vec::len), Some(0));
    }
}

/// A shell without job control starts what is in the background with SIGINT ignored, and `nohup`
/// does so with SIGHUP.
#[test]
fn a_background_job_stops_when_asked_and_survives_a_hangup_under_nohup() {
    let dir = folder();
    let ignoring = |signal: &str| {
        let line = format!(
            "trap '' {signal}; exec '{}' run ok.toml --json --monitor off --realtime best-effort",
            env!("CARGO_BIN_EXE_hapticd")
        );
        let mut running = Running::start(
            Command::new("sh")
                .args(["-c", &line])
                .current_dir(dir.path())
                .env("XDG_CACHE_HOME", dir.path())
                .env("XDG_STATE_HOME", dir.path()),
        );
        running.wait_for("state: enabled");
        running
    };
    let running = ignoring("INT");
    running.signal("INT");
    let ended = running.end();
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);

    let mut running = ignoring("HUP");
    running.signal("HUP");
    match running.stderr.recv_timeout(Duration::from_millis(500)) {
        Err(RecvTimeoutError::Timeout) => {}
        other => panic!("stopped on an ignored hangup: {other:?}"),
    }
    running.signal("TERM");
    running.wait_for("state: stopped");
    assert_eq!(running.end().code, Some(0));
}

#[test]
fn a_second_signal_ends_the_run_as_well() {
    let dir = folder();
    fs::write(dir.path().join("scene.toml"), scene(PLANE, "2.0", "")).unwrap();
    let mut running = start(
        dir.path(),
        &["run", "scene.toml", "--json", "--monitor", "off", "--realtime", "best-effort"],
    );
    running.wait_for("state: enabled");
    running.signal("INT");
    running.signal("INT");
    let ended = running.end();
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    assert_eq!(ended.states().last(), Some(&"stopped"));
}

#[test]
fn a_rise_of_ten_seconds_ends_within_a_tenth_of_one() {
    let dir = folder();
    fs::write(dir.path().join("slow.toml"), scene(PLANE, "2.0", "[safety]\nramp_ms = 10000\n"))
        .unwrap();
    let ended = hapticd(dir.path(), "run slow.toml --json --clock virtual --duration 5s");
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    // Half of the rise, which takes half of a fall.
    let ticks = ended.json()["ticks"].as_u64().unwrap();
    assert!((5045..=5055).contains(&ticks), "{ticks} ticks");
}

#[test]
fn an_injected_fault_ends_with_its_name_and_7() {
    let dir = folder();
    for (spec, fault) in [("nan@500ms", "non-finite"), ("unplug@500ms", "disconnected")] {
        let text = scene(PLANE, "2.0", &format!("[device.sim]\nfault = \"{spec}\"\n"));
        fs::write(dir.path().join("fault.toml"), text).unwrap();
        for line in [
            "run fault.toml --json --monitor off --realtime best-effort --duration 10s",
            "run -q fault.toml --json --clock virtual --duration 10s",
        ] {
            let ended = hapticd(dir.path(), line);
            assert_eq!(ended.code, Some(7), "{line}: {}", ended.stderr);
            let json = ended.json();
            assert_run_keys(&json);
            let named = json["faults"].as_array().unwrap().iter().any(|name| name == fault);
            assert!(named, "{spec}: {}", json["faults"]);
            assert!(
                ended.stderr.contains(&format!("fault: {fault} at ")),
                "{spec}: {}",
                ended.stderr
            );
            // 500 ms of the arm's own time.
            assert!(json["ticks"].as_u64() >= Some(500));
        }
        let ended = hapticd(
            dir.path(),
            "run fault.toml --json --monitor off --realtime best-effort --duration 10s",
        );
        assert_eq!(ended.states().last(), Some(&"fault"));
    }
}

#[test]
fn enforce_refuses_a_machine_that_fails_a_check() {
    let dir = folder();
    let ended =
        hapticd(dir.path(), "run ok.toml --monitor off --realtime enforce --duration 100ms --json");
    match ended.code {
        // Or 7: every check passed, and then the machine was late, which `enforce` takes for a
        // fault.
        Some(0 | 7) => {
            ended.json();
            assert!(!ended.stderr.contains("FAILED"), "{}", ended.stderr);
        }
        Some(6) => {
            assert_eq!(ended.stdout, "");
            for fragment in [
                "FAILED",
                "hint: ",
                "error: real-time preflight refused: ",
                "--realtime best-effort",
            ] {
                assert!(ended.stderr.contains(fragment), "{fragment}: {}", ended.stderr);
            }
            let quiet = hapticd(
                dir.path(),
                "run -q ok.toml --monitor off --realtime enforce --duration 100ms --json",
            );
            assert_eq!(quiet.code, Some(6));
            assert!(
                quiet.stderr.starts_with("preflight: ") && !quiet.stderr.contains("state: "),
                "{}",
                quiet.stderr
            );
        }
        other => panic!("{other:?}: {}", ended.stderr),
    }
}

#[test]
fn a_simulated_arm_is_good_enough_to_try_on_any_machine() {
    let dir = folder();
    let ended =
        hapticd(dir.path(), "run ok.toml --monitor off --realtime best-effort --duration 100ms");
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let kernel =
        ended.stderr.lines().find(|line| line.starts_with("preflight: kernel")).expect("a row");
    let mark = if kernel.contains("not PREEMPT_RT") {
        "not real time; good enough to try: "
    } else {
        " ok "
    };
    assert!(kernel.contains(mark) && !ended.stderr.contains("FAILED"), "{}", ended.stderr);
}

const BAKE_KEYS: [&str; 22] = [
    "triangles",
    "voxel_size_m",
    "origin_m",
    "dims",
    "voxels",
    "surface_voxels",
    "inside_voxels",
    "outside_voxels",
    "layers",
    "watertight",
    "navigation",
    "sat_tests",
    "points",
    "phase1_points",
    "phase2_points",
    "sides",
    "leak",
    "open_edges",
    "threads",
    "timings_s",
    "peak_rss_bytes",
    "warnings",
];
/// Documented, and absent until the tree and the cache are built.
const BAKE_KEYS_LATER: [&str; 2] = ["tree_levels", "cache"];
/// Beyond the contract.
const BAKE_KEYS_EXTRA: [&str; 8] = [
    "name",
    "role",
    "solid",
    "accuracy",
    "clear_winding_share",
    "lids",
    "field_bytes",
    "pointshell_bytes",
];
const TIMINGS: [&str; 9] =
    ["load", "init", "surface", "fill", "layers", "distance", "pointshell", "normals", "total"];

/// A `.npy` file of version 1: its header and its data.
fn npy(path: &Path) -> (String, Vec<u8>) {
    let bytes = fs::read(path).unwrap();
    assert_eq!(&bytes[..8], b"\x93NUMPY\x01\x00");
    let length = usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    assert_eq!((10 + length) % 64, 0, "data is aligned");
    let header = String::from_utf8(bytes[10..10 + length].to_vec()).unwrap();
    assert!(header.ends_with('\n'));
    (header.trim_end().to_owned(), bytes[10 + length..].to_vec())
}

fn count(json: &Value, key: &str) -> usize {
    usize::try_from(json[key].as_u64().unwrap_or_else(|| panic!("{key}: {json}"))).unwrap()
}

#[test]
fn the_files_of_a_bake_agree_with_its_figures() {
    let dir = folder();
    let line = "bake peg.obj --units mm --voxel-size-mm 0.5 --layers 4 --json \
                --voxmap-out v.npy --field-out f.npy --pointshell-out p.ply";
    let ended = hapticd(dir.path(), line);
    assert_eq!((ended.code, ended.stderr.as_str()), (Some(0), ""));
    let json = ended.json();
    let [documented, later, extra] =
        [set(&BAKE_KEYS), set(&BAKE_KEYS_LATER), set(&BAKE_KEYS_EXTRA)];
    let found: BTreeSet<&str> = keys(&json).difference(&later).copied().collect();
    assert_eq!(found, documented.union(&extra).copied().collect());
    assert_eq!(
        keys(&json["timings_s"]).into_iter().filter(|key| *key != "tree").collect::<BTreeSet<_>>(),
        set(&TIMINGS)
    );
    assert_eq!(
        (count(&json, "layers"), count(&json, "open_edges"), json["watertight"].as_bool()),
        (4, 0, Some(true))
    );
    assert_eq!(json["leak"], Value::Null);
    assert!((json["voxel_size_m"].as_f64().unwrap() - 5e-4).abs() < 1e-15);

    let dims: Vec<usize> = json["dims"]
        .as_array()
        .unwrap()
        .iter()
        .map(|n| usize::try_from(n.as_u64().unwrap()).unwrap())
        .collect();
    let shape = format!("'shape': ({}, {}, {})", dims[0], dims[1], dims[2]);
    let n_voxels = dims.iter().product::<usize>();
    assert_eq!(count(&json, "voxels"), n_voxels);

    let (header, layers) = npy(&dir.path().join("v.npy"));
    assert_eq!(header, format!("{{'descr': '|i1', 'fortran_order': False, {shape}, }}"));
    assert_eq!(layers.len(), n_voxels);
    let layers: Vec<i8> = layers.into_iter().map(|byte| i8::from_le_bytes([byte])).collect();
    let n_where = |test: fn(i8) -> bool| layers.iter().filter(|value| test(**value)).count();
    assert_eq!(n_where(|value| value == 0), count(&json, "surface_voxels"));
    assert_eq!(n_where(|value| value > 0), count(&json, "inside_voxels"));
    assert_eq!(n_where(|value| value < 0), count(&json, "outside_voxels"));
    assert_eq!(n_where(|value| !(-5..=5).contains(&value)), 0, "saturated at layers + 1");
    // C order: the peg stands in the middle of its padding, so the first and the last plane of each
    // axis are outside.
    let at = |i: usize, j: usize, k: usize| layers[(i * dims[1] + j) * dims[2] + k];
    assert!(at(dims[0] / 2, dims[1] / 2, dims[2] / 2) > 0);
    for k in 0..dims[2] {
        assert!(at(0, dims[1] / 2, k) < 0 && at(dims[0] - 1, dims[1] / 2, k) < 0);
    }

    let (header, field) = npy(&dir.path().join("f.npy"));
    assert_eq!(header, format!("{{'descr': '<f4', 'fortran_order': False, {shape}, }}"));
    let field: Vec<f32> =
        field.chunks_exact(4).map(|bytes| f32::from_le_bytes(bytes.try_into().unwrap())).collect();
    assert_eq!(field.len(), n_voxels);
    for (layer, distance_m) in layers.iter().zip(&field) {
        assert_eq!(distance_m.is_nan(), layer.abs() == 5, "NaN beyond the band and nowhere else");
        // Voxels of layer n > 1 are separated from the surface by others; a voxel is sqrt(3)/2 from
        // its corners.
        if !distance_m.is_nan() {
            assert!(
                f64::from(distance_m.abs()) <= 5e-4 * (f64::from(layer.abs()) + 1.0) * 3_f64.sqrt(),
                "{layer}: {distance_m}"
            );
        }
    }
    let inside: Vec<f32> = sign_of(&layers, &field, |layer| layer >= 2);
    let outside: Vec<f32> = sign_of(&layers, &field, |layer| layer <= -2);
    assert!(!inside.is_empty() && !outside.is_empty());
    assert!(
        inside.iter().all(|sign| *sign == inside[0])
            && outside.iter().all(|sign| *sign == -inside[0]),
        "one sign for each side"
    );

    let ply = fs::read(dir.path().join("p.ply")).unwrap();
    let end = ply.windows(11).position(|window| window == b"end_header\n").unwrap() + 11;
    let header = String::from_utf8(ply[..end].to_vec()).unwrap();
    let n_points = count(&json, "points");
    assert!(header.starts_with("ply\nformat binary_little_endian 1.0\n"), "{header}");
    assert!(header.contains(&format!("element vertex {n_points}\n")), "{header}");
    let properties: Vec<&str> =
        header.lines().filter(|line| line.starts_with("property")).collect();
    assert_eq!(
        properties,
        ["x", "y", "z", "nx", "ny", "nz"].map(|name| format!("property float {name}"))
    );
    assert_eq!(ply.len() - end, n_points * 24);
    assert_eq!(n_points, count(&json, "phase1_points") + count(&json, "phase2_points"));
    let origin_m: Vec<f64> =
        json["origin_m"].as_array().unwrap().iter().map(|n| n.as_f64().unwrap()).collect();
    for point in ply[end..].chunks_exact(24) {
        let number = |index: usize| {
            f64::from(f32::from_le_bytes(point[4 * index..4 * index + 4].try_into().unwrap()))
        };
        let in_voxels: Vec<f64> =
            (0..3).map(|axis| (number(axis) - origin_m[axis]) / 5e-4).collect();
        let normal: f64 = (3..6).map(|index| number(index) * number(index)).sum();
        assert!((normal - 1.0).abs() < 1e-4, "unit normals");
        // One voxel of slack: a point is projected onto the surface, which may be in the next
        // voxel.
        let near_surface =
            in_voxels.iter().zip(&dims).all(|(cell, n)| *cell > 4.0 && *cell < (*n - 4) as f64);
        assert!(near_surface, "within the padding: {in_voxels:?}");
    }
}

fn sign_of(layers: &[i8], field: &[f32], side: fn(i8) -> bool) -> Vec<f32> {
    layers
        .iter()
        .zip(field)
        .filter(|(layer, distance)| side(**layer) && !distance.is_nan())
        .map(|(_, d)| d.signum())
        .collect()
}

#[test]
fn the_number_of_threads_changes_no_byte() {
    let dir = folder();
    let part = shipped("models/gear-tool.stl");
    let bake = |threads: u32| {
        let line = format!(
            "bake {} --units mm --longest-axis-voxels 60 --threads {threads} --json --voxmap-out \
                v{threads}.npy --field-out f{threads}.npy --pointshell-out p{threads}.ply",
            part.display()
        );
        let ended = hapticd(dir.path(), &line);
        assert_eq!(ended.code, Some(0), "{}", ended.stderr);
        let json = ended.json();
        assert_eq!(count(&json, "threads"), threads as usize);
        json
    };
    let [one, two] = [1, 2].map(bake);
    for name in ["v#.npy", "f#.npy", "p#.ply"] {
        let [one, two] = ["1", "2"]
            .map(|threads| fs::read(dir.path().join(name.replace('#', threads))).unwrap());
        assert!(one == two, "{name} differs");
    }
    for key in BAKE_KEYS
        .into_iter()
        .filter(|key| !["threads", "timings_s", "peak_rss_bytes"].contains(key))
    {
        assert_eq!(one[key], two[key], "{key}");
    }
    // 60 voxels on the longest edge, the padding of eight layers and one, and the half voxel at
    // each end.
    let longest = one["dims"].as_array().unwrap().iter().filter_map(Value::as_u64).max().unwrap();
    assert_eq!(longest, 60 + 1 + 2 * 9);
}

#[test]
fn a_bake_measures_its_field_again_where_it_is_asked_to() {
    let dir = folder();
    let line = "bake peg.obj --units mm --voxel-size-mm 0.5 --verify";
    let ended = hapticd(dir.path(), line);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let said = "peg: the worst of 100000 samples is off by ";
    let error =
        ended.stderr.split_once(said).and_then(|(_, rest)| rest.split_once(" voxels, at ("));
    let error: f64 = error.expect("a sentence with the error").0.parse().unwrap();
    assert!(error < 1e-4, "{error}");
    assert!(ended.stdout.contains("  accuracy    samples to "), "{}", ended.stdout);
    let ended = hapticd(dir.path(), "bake ok.toml --verify");
    assert_eq!(ended.code, Some(2), "{}", ended.stderr);
}

#[test]
fn a_scene_is_baked_into_a_list_of_objects() {
    let dir = folder();
    let ended = hapticd(dir.path(), "bake ok.toml --json");
    assert_eq!((ended.code, ended.stderr.as_str()), (Some(0), ""));
    let json = ended.json();
    assert_eq!(keys(&json), set(&["objects", "smallest_overlap_m", "timings_s", "peak_rss_bytes"]));
    // What the points of the tool leave unseen, and how far off the surface of the part is felt.
    let accuracy = |idx: usize, key: &str| json["objects"][idx]["accuracy"][key].as_f64();
    let overlap_m =
        accuracy(1, "unseen_depth_m").unwrap() + accuracy(0, "surface_error_m").unwrap();
    assert_eq!(json["smallest_overlap_m"].as_f64(), Some(overlap_m));
    assert_eq!(accuracy(1, "sample_error_m"), None);
    assert!(json["timings_s"]["total"].as_f64() > Some(0.0));
    assert!(json["peak_rss_bytes"].as_u64() > Some(1 << 20));
    let objects = json["objects"].as_array().unwrap();
    let roles: Vec<_> = objects
        .iter()
        .map(|object| (object["name"].as_str().unwrap(), object["role"].as_str().unwrap()))
        .collect();
    assert_eq!(roles, [("base", "static"), ("tool", "tool")]);
    for object in objects {
        let found = keys(object);
        // One number for the process, not for each object.
        let missing: Vec<_> = BAKE_KEYS
            .into_iter()
            .filter(|key| *key != "peak_rss_bytes" && !found.contains(key))
            .collect();
        assert!(missing.is_empty(), "{missing:?}");
    }
    assert_eq!(count(&objects[0], "points"), 0);
    assert!(count(&objects[1], "points") > 0);
    let ended = hapticd(dir.path(), "bake ok.toml");
    assert!(
        ended.stdout.contains("base (12 triangles)\n") && ended.stdout.contains("2 objects in "),
        "{}",
        ended.stdout
    );
}

#[test]
fn a_bake_beyond_max_memory_is_refused_before_the_work_with_a_size_that_fits() {
    let dir = folder();
    for line in [
        "bake peg.obj --units mm --voxel-size-mm 1 --max-memory 2",
        "run ok.toml --max-memory lots",
    ] {
        refuses(dir.path(), line, 2, &["--max-memory", "800M, 2GB or 1.5GiB"]);
    }
    let fine = "bake peg.obj --units mm --voxel-size-mm 0.01 --max-memory 20MB";
    let numbers = ["peg.obj: baking takes about ", "GiB, more than the 19 MiB that are allowed"];
    refuses(
        dir.path(),
        fine,
        3,
        &[
            &numbers[..],
            &["hint: use a voxel size of at least ", "fewer layers, or a larger --max-memory"],
        ]
        .concat(),
    );
    // The advice works when it is copied, and its bake really stays near the limit.
    let reported = hapticd(dir.path(), fine).stderr;
    let size_mm =
        reported.split("at least ").nth(1).and_then(|rest| rest.split(' ').next()).unwrap();
    let ended = hapticd(
        dir.path(),
        &format!("bake peg.obj --units mm --voxel-size-mm {size_mm} --max-memory 20MB --json"),
    );
    assert_eq!((ended.code, ended.stderr.as_str()), (Some(0), ""), "{size_mm}");
    let json = ended.json();
    let kept = count(&json, "field_bytes") + count(&json, "pointshell_bytes");
    assert!(kept < 20_000_000 && kept > 4_000_000, "{kept}");
    let in_voxels = "bake peg.obj --longest-axis-voxels 3000 --max-memory 20MB";
    refuses(dir.path(), in_voxels, 3, &["use at most --longest-axis-voxels "]);
    let reported = hapticd(dir.path(), in_voxels).stderr;
    let n = reported
        .split("--longest-axis-voxels ")
        .nth(1)
        .and_then(|rest| rest.split(',').next())
        .unwrap();
    let ended = hapticd(
        dir.path(),
        &format!("bake peg.obj --longest-axis-voxels {n} --max-memory 20MB --json"),
    );
    assert_eq!(ended.code, Some(0), "{n}: {}", ended.stderr);

    // A scene: judged object by object, in `bake` and in `run`.
    for command in ["bake", "run"] {
        refuses(
            dir.path(),
            &format!("{command} ok.toml --max-memory 1kB"),
            3,
            &["that are allowed", "hint: ", "--max-memory"],
        );
    }
    let ended = hapticd(dir.path(), "bake -v peg.obj --units mm --voxel-size-mm 1 --max-memory 1G");
    assert_eq!(ended.code, Some(0));
    assert!(ended.stderr.contains("memory: peg takes about "), "{}", ended.stderr);
}

/// Each obvious mistake gives one message that says what to do instead.
#[test]
fn obvious_mistakes_are_named_with_their_remedy() {
    let dir = folder();
    let write = |name: &str, bytes: &[u8]| fs::write(dir.path().join(name), bytes).unwrap();
    write("flat.obj", b"v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n");
    write(
        "scan.stl",
        b"ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\nend_header\n............................",
    );
    let mesh = &[
        "error: peg.obj: this is a mesh file, not a scene",
        "hint: `hapticd bake` takes it as it is",
    ];
    for (line, code, fragments) in [
        ("check peg.obj", 3, &mesh[..]),
        ("run peg.obj", 3, mesh),
        (
            "bake flat.obj --units mm --voxel-size-mm 1",
            4,
            &["flat.obj: none of the 1 triangles has an area", "hint: export the part"],
        ),
        (
            "bake scan.stl --units mm --voxel-size-mm 1",
            4,
            &["this is a file of the format PLY", "hint: rename it so that it ends in .ply"],
        ),
        ("bake peg.obj --units mm --voxel-size-mm 1 --max-memory -5", 2, &["`-5` is not a size"]),
        ("bake peg.obj --units mm --voxel-size-mm 0.01 --max-memory 20M", 3, &[" GB and 20 MB)"]),
    ] {
        refuses(dir.path(), line, code, fragments);
    }
    for line in ["run none.toml", "run peg.obj"] {
        let said = hapticd(dir.path(), line).stderr;
        assert!(!said.contains("state:"), "nothing was baked: {said}");
    }
}

#[test]
fn what_a_bake_assumes_is_said_once() {
    let dir = folder();
    let said = |line: &str| {
        let ended = hapticd(dir.path(), line);
        assert_eq!(ended.code, Some(0), "{line}: {}", ended.stderr);
        ended.stderr
    };
    let metres = "note: the numbers of the mesh file are taken as metres";
    assert!(said("bake gear12.obj --longest-axis-voxels 20").contains(metres));
    assert!(!said("bake gear12.obj --longest-axis-voxels 20 --units mm").contains("note:"));
    let without_cache = "note: baked without the cache";
    assert!(
        said("bake peg.obj --units mm --voxel-size-mm 1 --voxmap-out v.npy")
            .contains(without_cache)
    );
    assert!(
        !said("bake peg.obj --units mm --voxel-size-mm 1 --voxmap-out v.npy --cache off")
            .contains("note:")
    );
    // Inside out: one warning, not two.
    fs::write(
        dir.path().join("inward.obj"),
        "v 0 0 0\nv 12 0 0\nv 0 12 0\nv 0 0 12\nf 1 2 3\nf 1 4 2\nf 2 4 3\nf 3 4 1\n",
    )
    .unwrap();
    let warnings = said("bake inward.obj --units mm --voxel-size-mm 0.5");
    assert_eq!(warnings.matches("face inward").count(), 1, "{warnings}");
    let ended = Running::start(
        program(dir.path()).env("XDG_CACHE_HOME", "relative").env_remove("HOME").args([
            "bake",
            "gear12.obj",
            "--units",
            "mm",
            "--voxel-size-mm",
            "1",
        ]),
    )
    .end();
    assert_eq!(
        ended
            .stderr
            .matches("warning: XDG_CACHE_HOME is ignored, as relative is not an absolute path")
            .count(),
        1,
        "{}",
        ended.stderr
    );
}
