//! Recordings as users make them: with the real program, killed, out of space, replayed, and held
//! against those of earlier versions.

use std::fs;
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::time::{Duration, Instant};

use base64::Engine as _;
use engine::servo::{Control, SceneControls};
use engine::supervisor::{LiveChannels, RenderJob, Supervisor};
use glam::DVec3;
use hapticd::config::LoadOptions;
use hapticd::daemon::session::objects;
use hapticd::daemon::{ReplayError, Replayed, prepare, replay, scene_files};
use haptics::{Faults, LiveParameter};
use recording::file::{Entry, FORCE_LAW_KEY, Facts, Recorder, Recording, SceneFiles};
use recording::{RecordSubscribers, TickRecord, drain};
use rt::clock::ClockKind;
use serde_json::Value;
use tempfile::TempDir;
use vps::spatial::Pose;

use super::program::{hapticd, program};
use super::rig;

/// A process that has not come so far by then hangs.
const HUNG: Duration = Duration::from_secs(120);

/// Killed when its test fails.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

const HAND: &str = "t_s,x_m,y_m,z_m,qx,qy,qz,qw\n0,0,0,0.015,0,0,0,1\n0.3,0,0,0.008,0,0,0,1\n2,0.005,0,0.008,0,0,0,1\n";

/// A box that is pressed onto a plate that may move; what is pushed by a mesh file is there as
/// well.
fn folder() -> TempDir {
    let dir = tempfile::tempdir().expect("a folder");
    let write = |name: &str, text: &str| fs::write(dir.path().join(name), text).expect("written");
    let scene = |plate: &str, more: &str| {
        format!(
            r#"version = 1
[[static]]
name = "plate"
{plate}
voxel_size_mm = 2.0
layers = 4
movable = true
[tool]
shape = {{ box_mm = [20.0, 20.0, 20.0] }}
voxel_size_mm = 2.0
start_position_mm = [0, 0, 15]
[contact]
time_budget_us = 300
friction = {{ static = 0.3, dynamic = 0.2 }}
[device]
profile = "sim-sigma7"
hand = "hands/press.csv"
{more}"#
        )
    };
    fs::create_dir(dir.path().join("hands")).expect("a folder");
    fs::create_dir(dir.path().join("parts")).expect("a folder");
    write("hands/press.csv", HAND);
    write("a.toml", &scene("shape = { plane_mm = [60.0, 60.0] }", ""));
    write("b.toml", &scene("mesh = \"parts/block.obj\"\nunits = \"mm\"", ""));
    write(
        "nan.toml",
        &scene("shape = { plane_mm = [60.0, 60.0] }", "[device.sim]\nfault = \"nan@500ms\"\n"),
    );
    write("up.csv", "t_s,x_m,y_m,z_m,qx,qy,qz,qw\n0,0,0,0,0,0,0,1\n0.5,0,0,0.003,0,0,0,1\n");
    let block =
        rig::folder_of_scenes().parent().expect("a parent").join("models/block-plugged.obj");
    fs::copy(block, dir.path().join("parts/block.obj")).expect("copied");
    dir
}

/// Runs again what was recorded, in this process.
fn again(path: &Path) -> Result<Replayed, ReplayError> {
    replay(path, |config| hapticd::scene::build(config, |_| ()).map(|(scene, _)| scene))
}

fn assert_identical(path: &Path, n_ticks: u64) -> Replayed {
    let replayed = again(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    assert!(replayed.is_identical(), "{}: {replayed:?}", path.display());
    assert_eq!((replayed.ticks, replayed.changed.len()), (n_ticks, 0), "{replayed:?}");
    replayed
}

fn entries(path: &Path) -> Vec<Entry> {
    let mut recording = Recording::open(path).expect("a file");
    let mut entries = Vec::new();
    while let Some(entry) = recording.next_entry().expect("a recording") {
        entries.push(entry);
    }
    entries
}

fn records(path: &Path) -> Vec<TickRecord> {
    let tick = |entry| if let Entry::Tick { record, .. } = entry { Some(*record) } else { None };
    entries(path).into_iter().filter_map(tick).collect()
}

#[test]
fn a_run_with_a_moving_part_and_other_scenes_replays_bit_for_bit_without_its_files() {
    let dir = folder();
    let line = "run a.toml --clock virtual --duration 2s --move plate=up.csv --swap b.toml@1s \
        --swap a.toml@1500ms --record r.mcap --json";
    let ended = hapticd(dir.path(), line);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let json = ended.json();
    let n_ticks = json["ticks"].as_u64().expect("a count");
    let recording = &json["recording"];
    assert_eq!((&recording["records"], &recording["dropped"]), (&json["ticks"], &Value::from(0)));
    assert!(recording["file"] == "r.mcap" && recording["error"].is_null(), "{recording}");
    assert!(
        json["contact_ticks"].as_u64() > Some(500) && json["object_work_j"].as_f64() > Some(0.0),
        "{json}"
    );
    // Elsewhere, and nothing of the scene is left.
    let elsewhere = tempfile::tempdir().expect("a folder");
    let moved = elsewhere.path().join("r.mcap");
    fs::rename(dir.path().join("r.mcap"), &moved).expect("moved");
    for gone in ["a.toml", "b.toml", "hands/press.csv", "parts/block.obj"] {
        fs::remove_file(dir.path().join(gone)).expect("removed");
    }
    assert_eq!(assert_identical(&moved, n_ticks).scenes, 3);
    let ended = hapticd(elsewhere.path(), "replay r.mcap --json --cache off");
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let json = ended.json();
    assert!(
        json["identical"] == true && json["ticks"] == n_ticks && json["whole"] == true,
        "{json}"
    );
    let ended = hapticd(elsewhere.path(), "replay r.mcap --cache off");
    assert_eq!(ended.stdout, format!("bit-identical, {n_ticks} ticks\n"), "{}", ended.stderr);
    let ended = hapticd(elsewhere.path(), "report r.mcap -o r.html");
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    // A page that is there is kept, and the recording is never written over.
    for (line, code, fragment) in [
        ("report r.mcap -o r.html", 2, "r.html exists already"),
        ("report r.mcap --out ./r.mcap --overwrite", 2, "is the recording itself"),
        ("report r.mcap -o none/r.html", 4, "hint: the folder must exist"),
    ] {
        let refused = hapticd(elsewhere.path(), line);
        assert_eq!(refused.code, Some(code), "{line}: {}", refused.stderr);
        assert!(refused.stderr.contains(fragment), "{line}: {}", refused.stderr);
    }
    let ended = hapticd(elsewhere.path(), "report r.mcap -o r.html --overwrite");
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    assert_identical(&moved, n_ticks);
    let page = fs::read_to_string(elsewhere.path().join("r.html")).expect("a page");
    assert!(page.contains("Scene 2: a") && page.contains("<polygon") && !page.contains("<script"));
    // Drawn from the meshes that the recording brings along: those of the scene are gone.
    let picture = page
        .split_once("src=\"data:image/png;base64,")
        .and_then(|(_, rest)| rest.split_once('"'))
        .expect("a picture")
        .0;
    let picture = base64::engine::general_purpose::STANDARD.decode(picture).expect("base64");
    let pixels = tiny_skia::Pixmap::decode_png(&picture).expect("a PNG");
    assert_eq!((pixels.width(), pixels.height()), (1100, 460));
}

/// Runs a scene in this process and records it; `turn` has its parameters and parts in hand before
/// the first tick.
fn record(
    scene: &Path,
    duration: Duration,
    path: &Path,
    turn: impl FnOnce(&mut SceneControls),
) -> u64 {
    record_with(scene, duration, path, turn, |_| ())
}

/// The same, with other facts noted about the run.
fn record_with(
    scene: &Path,
    duration: Duration,
    path: &Path,
    turn: impl FnOnce(&mut SceneControls),
    note: impl FnOnce(&Facts),
) -> u64 {
    let config = rig::load(scene);
    let (prepared, _) = prepare(&config, |_| ()).expect("a scene");
    let (mut controls, commands) = SceneControls::new(&prepared.scene.parameters, objects(&config));
    turn(&mut controls);
    let subscribers = RecordSubscribers::default();
    let recorder = Recorder::new(subscribers.clone(), true);
    recorder.facts.note("rate_hz", config.rate_hz);
    note(&recorder.facts);
    let mut files = scene_files(&config, &LoadOptions::default());
    // A recording that is shared does not say where the file was on this machine.
    files.path = files.path.file_name().map(PathBuf::from).expect("a name");
    recorder.scenes.add(files);
    let handle = recorder.start(path, true, Box::new(|error| panic!("{error}"))).expect("started");
    let job = RenderJob {
        scene: Arc::new(prepared.scene),
        device: prepared.device,
        realtime: prepared.realtime,
        time_budget_s: prepared.time_budget_s,
        clock: ClockKind::Virtual,
        duration: Some(duration),
    };
    let live = LiveChannels { commands, subscribers, ..LiveChannels::default() };
    let outcome = Supervisor::new(|_| ())
        .render_live(job, live, &Arc::new(Control::new()))
        .expect("an outcome");
    let summary = handle.stop();
    assert_eq!(
        (summary.records, summary.error, outcome.report.faults),
        (outcome.report.ticks, None, Faults::NONE)
    );
    outcome.report.ticks
}

/// Every parameter that acts, to its least value, and a part to another place.
fn turn_everything(controls: &mut SceneControls) {
    for setting in controls.settings().to_vec() {
        controls.set(setting.parameter.name(), setting.range.least).expect("in range");
    }
    let movable: Vec<String> = controls.movable().map(str::to_owned).collect();
    for name in movable {
        controls.place(&name, Pose::from_translation(DVec3::Z * 0.004)).expect("movable");
    }
}

#[test]
fn turned_parameters_and_placed_parts_are_in_the_recording() {
    let dir = folder();
    let path = dir.path().join("turned.mcap");
    let n_ticks =
        record(&dir.path().join("a.toml"), Duration::from_millis(1500), &path, turn_everything);
    assert_identical(&path, n_ticks);
    let records = records(&path);
    let turned: Vec<LiveParameter> = records
        .iter()
        .filter_map(|record| record.input.parameter_change.map(|change| change.parameter))
        .collect();
    assert!(turned.len() > 6, "{turned:?}");
    assert!(
        records.iter().any(|record| record.output.object.is_some())
            && records[0].input.place.is_some()
    );
    // A recorder that forgot them would be found out.
    let other = dir.path().join("untouched.mcap");
    record(&dir.path().join("a.toml"), Duration::from_millis(1500), &other, |_| ());
    let differ = records
        .iter()
        .zip(self::records(&other))
        .any(|(turned, plain)| turned.output.command_device != plain.output.command_device);
    assert!(differ);
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn a_fault_is_recorded_replayed_and_kept_by_the_flight_recorder() {
    let dir = folder();
    let ended = hapticd(
        dir.path(),
        "run nan.toml --clock virtual --duration 2s --record r.mcap --flight faults --json",
    );
    assert_eq!(ended.code, Some(7), "{}", ended.stderr);
    let n_ticks = ended.json()["ticks"].as_u64().expect("a count");
    assert_identical(&dir.path().join("r.mcap"), n_ticks);
    let recorded = records(&dir.path().join("r.mcap"));
    let nan = recorded.iter().find(|record| !record.output.faults.is_empty()).expect("a fault");
    assert!(
        nan.input.sample.pose.translation.is_nan() || !nan.input.sample.pose.is_finite(),
        "{nan:?}"
    );
    // The file of the flight recorder names its cause, and goes back far enough here to be run
    // again as well.
    let files: Vec<PathBuf> = fs::read_dir(dir.path().join("faults"))
        .expect("a folder")
        .map(|file| file.expect("a file").path())
        .collect();
    assert_eq!(files.len(), 1, "{files:?}");
    let name = files[0].file_name().expect("a name").to_string_lossy();
    assert!(name.starts_with("fault-20") && name.ends_with("-non-finite.mcap"), "{name}");
    assert!(ended.stderr.contains(&format!("flight recorder: faults/{name}")), "{}", ended.stderr);
    assert_identical(&files[0], n_ticks);
    let named = entries(&files[0])
        .into_iter()
        .any(|entry| matches!(entry, Entry::Metadata { name, values } if name == "fault" && values["faults"] == "non-finite"));
    assert!(named);
    // Simulated time leaves nothing behind unless asked for, and off is off.
    assert!(!dir.path().join("xdg-state").exists());
    hapticd(dir.path(), "run nan.toml --duration 2s --realtime best-effort --flight off --json");
    assert!(!dir.path().join("xdg-state").exists());
    hapticd(dir.path(), "run nan.toml --duration 2s --realtime best-effort --json");
    assert_eq!(
        fs::read_dir(dir.path().join("xdg-state/hapticd/faults")).expect("a folder").count(),
        1
    );
}

#[test]
fn what_a_killed_run_leaves_behind_replays_to_its_last_chunk() {
    let dir = folder();
    let path = dir.path().join("r.mcap");
    let line = "run a.toml --clock virtual --duration 3600s --record r.mcap --json";
    let child = program(dir.path())
        .args(line.split(' '))
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .expect("started");
    let mut running = Running(child);
    let begun = Instant::now();
    while fs::metadata(&path).map_or(0, |file| file.len()) < 3 << 20 {
        assert!(begun.elapsed() < HUNG, "nothing is written");
        std::thread::sleep(Duration::from_millis(5));
    }
    running.0.kill().expect("killed");
    running.0.wait().expect("reaped");
    let ended = hapticd(dir.path(), "replay r.mcap --json --cache off");
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let json = ended.json();
    assert!(
        json["identical"] == true && json["whole"] == false && json["ticks"].as_u64() > Some(1000),
        "{json}"
    );
    assert!(ended.stderr.contains("the file has no end"), "{}", ended.stderr);
    let ended = hapticd(dir.path(), "report r.mcap");
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn a_folder_or_disk_that_takes_nothing_is_reported_and_never_ends_a_run() {
    let dir = folder();
    for (line, code, fragments) in [
        ("--record /proc/r.mcap", 4, &["--record: cannot create /proc/r.mcap"][..]),
        ("--record none/r.mcap", 4, &["cannot create none/r.mcap", "the folder must exist"]),
        ("--record /dev/full --overwrite", 4, &["cannot write /dev/full: No space left"]),
        ("--record a.toml", 2, &["a.toml exists already", "--overwrite"]),
        ("--overwrite", 2, &["--record"]),
    ] {
        let ended =
            hapticd(dir.path(), &format!("run a.toml --clock virtual --duration 1s {line}"));
        assert_eq!(ended.code, Some(code), "{line}: {}", ended.stderr);
        for fragment in fragments {
            assert!(ended.stderr.contains(fragment), "{line}: no `{fragment}` in {}", ended.stderr);
        }
        assert!(
            !ended.stderr.contains("state: baking"),
            "{line}: reported before anything is baked"
        );
    }
    // A disk that is full in the middle: here a limit on the size of files.
    let exe = env!("CARGO_BIN_EXE_hapticd");
    for clock in ["--clock virtual", "--realtime best-effort"] {
        let line = format!(
            "ulimit -f 400; exec '{exe}' run a.toml {clock} --duration 3s --cache off --flight off \
                --record r.mcap --overwrite --json"
        );
        let output = Command::new("bash")
            .args(["-c", &line])
            .current_dir(dir.path())
            .stdin(Stdio::null())
            .output()
            .expect("started");
        let stdout = String::from_utf8_lossy(&output.stdout);
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(0), "{clock}: {stderr}");
        let json: Value = serde_json::from_str(&stdout).expect("json");
        assert!(
            json["recording"]["error"]
                .as_str()
                .is_some_and(|error| error.contains("cannot write r.mcap")),
            "{json}"
        );
        let due =
            json["ticks"].as_u64().unwrap_or(0) + json["missed_deadlines"].as_u64().unwrap_or(0);
        assert!(json["faults"].as_array().is_some_and(Vec::is_empty) && due > 3000, "{json}");
        assert_eq!(stderr.matches("recording ended early").count(), 1, "{stderr}");
        // What was written before can be used.
        let replayed = again(&dir.path().join("r.mcap")).expect("a recording");
        assert!(replayed.is_identical() && !replayed.whole && replayed.ticks > 100, "{replayed:?}");
        // Every tick is counted: in the file for certain, or missing.
        let [kept, dropped] =
            ["records", "dropped"].map(|key| json["recording"][key].as_u64().unwrap_or(0));
        assert!(kept > 100 && kept <= replayed.ticks, "{json}: {replayed:?}");
        assert_eq!(kept + dropped, json["ticks"].as_u64().unwrap_or(0), "{json}");
    }
    // A run that never begins leaves no file behind in which there is nothing.
    fs::write(
        dir.path().join("parts/block.obj"),
        "v 0 0 0
",
    )
    .expect("written");
    let ended = hapticd(dir.path(), "run b.toml --clock virtual --duration 1s --record never.mcap");
    assert_eq!(ended.code, Some(4), "{}", ended.stderr);
    assert!(!dir.path().join("never.mcap").exists());
}

#[test]
fn what_cannot_be_replayed_is_reported() {
    let dir = folder();
    fs::write(dir.path().join("empty.mcap"), b"").expect("written");
    fs::write(dir.path().join("begun.mcap"), b"\x89MCAP0\r\n").expect("written");
    for (line, fragments) in [
        ("replay none.mcap", &["cannot read none.mcap"][..]),
        ("replay hands", &["cannot read hands"]),
        ("replay a.toml", &["a.toml is no recording", "does not begin as an MCAP file", "hint: "]),
        ("replay empty.mcap", &["empty.mcap is no recording", "it is empty"]),
        ("replay begun.mcap", &["begun.mcap ends before its first tick"]),
        ("report begun.mcap -o x.html", &["begun.mcap ends before its first tick"]),
        ("report empty.mcap -o x.html", &["it is empty"]),
        ("report a.toml -o x.html", &["a.toml is no recording", "hint: "]),
    ] {
        let ended = hapticd(dir.path(), line);
        assert_eq!(ended.code, Some(4), "{line}: {}", ended.stderr);
        for fragment in fragments {
            assert!(ended.stderr.contains(fragment), "{line}: no `{fragment}` in {}", ended.stderr);
        }
    }
    // Ticks before the first record, and a gap.
    let path = dir.path().join("r.mcap");
    record(&dir.path().join("a.toml"), Duration::from_millis(300), &path, |_| ());
    let rewrite =
        |name: &str, keep: &dyn Fn(&TickRecord) -> bool, change: &dyn Fn(&mut TickRecord)| {
            let subscribers = RecordSubscribers::default();
            let recorder = Recorder::new(subscribers.clone(), true);
            recorder
                .scenes
                .add(scene_files(&rig::load(&dir.path().join("a.toml")), &LoadOptions::default()));
            let to = dir.path().join(name);
            let handle =
                recorder.start(&to, true, Box::new(|error| panic!("{error}"))).expect("started");
            let (mut producer, consumer) = rtrb::RingBuffer::new(1000);
            for mut record in records(&path).into_iter().filter(|record| keep(record)) {
                change(&mut record);
                producer.push(record).expect("room");
            }
            drop(producer);
            recording::drain(consumer, &subscribers, |_| ());
            assert_eq!(handle.stop().error, None);
            to
        };
    let late = rewrite("late.mcap", &|record| record.tick >= 7, &|_| ());
    assert!(matches!(again(&late), Err(ReplayError::BeganLate(7))));
    rewrite("gap.mcap", &|record| !(100..110).contains(&record.tick), &|_| ());
    let ended = hapticd(dir.path(), "replay gap.mcap --cache off");
    assert_eq!(ended.code, Some(4), "{}", ended.stderr);
    assert!(
        ended
            .stdout
            .starts_with("bit-identical up to a gap: 100 ticks; 10 ticks from 100 on are missing"),
        "{}",
        ended.stdout
    );
    // One bit of one value.
    let bit = |record: &mut TickRecord| {
        if record.tick == 200 {
            let energy = &mut record.output.energy_j;
            *energy = f64::from_bits(energy.to_bits() ^ 1);
        }
    };
    rewrite("bit.mcap", &|_| true, &bit);
    let ended = hapticd(dir.path(), "replay bit.mcap --cache off");
    assert_eq!(ended.code, Some(4), "{}", ended.stderr);
    assert!(
        ended.stdout.starts_with("differs in tick 200, scene 0: energy_j\n  recorded "),
        "{}",
        ended.stdout
    );
    let json = hapticd(dir.path(), "replay bit.mcap --cache off --json").json();
    assert!(
        json["identical"] == false
            && json["difference"]["field"] == "energy_j"
            && json["ticks"] == 200,
        "{json}"
    );
}

/// One request over HTTP: status and body.
fn ask(address: &str, method: &str, path: &str, body: &str) -> (u16, String) {
    let mut stream = TcpStream::connect(address).expect("connected");
    let head = format!(
        "{method} {path} HTTP/1.1\r\nHost: {address}\r\nContent-Type: \
            application/json\r\nConnection: close\r\n"
    );
    write!(stream, "{head}Content-Length: {}\r\n\r\n{body}", body.len()).expect("sent");
    let mut answer = String::new();
    stream.read_to_string(&mut answer).expect("an answer");
    let status = answer.split(' ').nth(1).and_then(|status| status.parse().ok()).expect("a status");
    (status, answer.split_once("\r\n\r\n").map_or_else(String::new, |(_, body)| body.to_owned()))
}

#[test]
fn a_client_begins_and_ends_a_recording_in_a_folder_of_its_own() {
    let dir = folder();
    let line = "run a.toml --realtime best-effort --monitor 127.0.0.1:0 --flight off --json";
    let mut child = program(dir.path())
        .args(line.split(' '))
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("started");
    let mut said =
        BufReader::new(child.stderr.take().expect("piped")).lines().map_while(Result::ok);
    let stdout = child.stdout.take().expect("piped");
    let mut running = Running(child);
    let address = said
        .find_map(|line| {
            Some(line.strip_prefix("monitor: http://")?.trim_end_matches('/').to_owned())
        })
        .expect("an address");
    said.find(|line| line == "state: enabled").expect("enabled");
    let record = |body: &str| ask(&address, "POST", "/api/v1/recording", body);
    for refused in
        [r#"{"file": "../r.mcap"}"#, r#"{"file": "/tmp/r.mcap"}"#, r#"{"file": ".mcap"}"#]
    {
        let (status, body) = record(refused);
        assert!(
            status == 400 && body.contains("a recording takes a name"),
            "{refused}: {status} {body}"
        );
    }
    assert_eq!(ask(&address, "DELETE", "/api/v1/recording", "").0, 409);
    assert_eq!(record(r#"{"file": "mine.mcap"}"#).0 / 100, 2);
    let (status, body) = record("{}");
    assert!(status == 409 && body.contains("under way"), "{status} {body}");
    std::thread::sleep(Duration::from_millis(300));
    assert_eq!(ask(&address, "DELETE", "/api/v1/recording", "").0 / 100, 2);
    let (status, body) = record(r#"{"file": "mine.mcap"}"#);
    assert!(status == 409 && body.contains("exists already"), "{status} {body}");
    let stop =
        Command::new("kill").args(["-INT", &running.0.id().to_string()]).status().expect("kill");
    assert!(stop.success());
    let json: Value = serde_json::from_reader(stdout).expect("json");
    assert!(running.0.wait().expect("reaped").success());
    let file = dir.path().join("xdg-state/hapticd/recordings/mine.mcap");
    let records = records(&file);
    assert_eq!(json["recording"]["records"], records.len());
    assert!(records.len() > 10 && records.windows(2).all(|pair| pair[0].tick < pair[1].tick));
    assert!(matches!(again(&file), Err(ReplayError::BeganLate(_))));
}

/// Recordings of shipped scenes, and how they are made.
const FIXTURES: [(&str, &str, Duration); 2] = [
    ("block-on-plane.mcap", "block-on-plane", Duration::from_millis(950)),
    ("lift-with-block.mcap", "lift-with-block", Duration::from_millis(750)),
];

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures").join(name)
}

#[test]
fn recordings_of_this_force_law_replay_bit_for_bit() {
    for (name, _, duration) in FIXTURES {
        let replayed = again(&fixture(name)).unwrap_or_else(|error| panic!("{name}: {error}"));
        assert!(
            replayed.is_identical()
                && replayed.whole
                && replayed.ticks > duration.as_millis() as u64,
            "{name}: {replayed:#?}\nif the change of forces is meant: count haptics::FORCE_LAW up \
                where a release has it, and HAPTICD_REWRITE=1 cargo test --test it \
                rewrite_the_recordings -- --ignored"
        );
    }
}

#[test]
fn a_recording_of_another_force_law_is_refused_by_name_and_still_reported() {
    for (name, ..) in FIXTURES {
        let dir = tempfile::tempdir().expect("a folder");
        let old = fixture(&format!("v0.1.0/recordings/{name}"));
        match again(&old) {
            Err(ReplayError::OtherForceLaw { program, law: None }) => {
                assert_eq!(program, "hapticd 0.1.0")
            }
            other => panic!("{name}: {other:?}"),
        }
        std::fs::copy(&old, dir.path().join("old.mcap")).expect("copied");
        let ended = hapticd(dir.path(), "replay old.mcap --cache off");
        assert_eq!((ended.code, ended.stdout.as_str()), (Some(4), ""), "{}", ended.stderr);
        let law = format!("force law {}", haptics::FORCE_LAW);
        for said in [
            "recorded by hapticd 0.1.0",
            "the first force law",
            &law,
            "replay it with the version",
            "hapticd report",
        ] {
            assert!(ended.stderr.contains(said), "no `{said}` in {}", ended.stderr);
        }
        let ended = hapticd(dir.path(), "report old.mcap -o old.html");
        assert_eq!(ended.code, Some(0), "{}", ended.stderr);
        let page = std::fs::read_to_string(dir.path().join("old.html")).expect("a page");
        assert!(page.contains("<svg") && page.contains("hapticd 0.1.0"), "{name}");
    }
}

#[test]
fn a_recording_of_a_later_force_law_is_refused() {
    let dir = folder();
    let path = dir.path().join("later.mcap");
    for later in ["999", "-", ""] {
        record_with(
            &rig::shipped("block-on-plane"),
            Duration::from_millis(20),
            &path,
            |_| (),
            |facts| facts.note(FORCE_LAW_KEY, later),
        );
        match again(&path) {
            Err(ReplayError::OtherForceLaw { law, .. }) => assert_eq!(law.as_deref(), Some(later)),
            other => panic!("{later}: {other:?}"),
        }
    }
}

#[test]
#[ignore = "writes files of the repository: HAPTICD_REWRITE=1 cargo test --test it \
    rewrite_the_recordings -- --ignored"]
fn rewrite_the_recordings() {
    // Long tests are run with all ignored ones: files are written only where this variable asks for
    // it.
    if std::env::var_os("HAPTICD_REWRITE").is_none() {
        return;
    }
    for (name, scene, duration) in FIXTURES {
        record(&rig::shipped(scene), duration, &fixture(name), turn_everything);
    }
    let seeds = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/corpus/recording");
    fs::create_dir_all(&seeds).expect("a folder");
    let packed = a_few_ticks();
    fs::write(seeds.join("plain"), plain(&packed)).expect("written");
    fs::write(seeds.join("packed"), packed).expect("written");
}

/// A recording that is as short as one comes, as every byte more makes a fuzzer slower.
fn a_few_ticks() -> Vec<u8> {
    let dir = tempfile::tempdir().expect("a folder");
    let path = dir.path().join("few.mcap");
    let recorder = Recorder::new(RecordSubscribers::default(), true);
    recorder.facts.note("rate_hz", 1000);
    let resolved_json =
        r#"{"statics": [{"name": "plate"}], "parameters": {"limits": {"force_n": 8.0}}}"#
            .to_owned();
    recorder.scenes.add(SceneFiles {
        name: "few".to_owned(),
        resolved_json,
        ..SceneFiles::default()
    });
    let handle =
        recorder.start(&path, false, Box::new(|error| panic!("{error}"))).expect("started");
    let (mut producer, consumer) = rtrb::RingBuffer::new(4);
    for tick in 0..4 {
        let mut record = TickRecord {
            tick,
            time_ns: tick as i64 * 1_000_000,
            compute_ns: 7000,
            ..TickRecord::default()
        };
        record.output.command_device.force = DVec3::new(0.1, -0.0, tick as f64);
        record.output.faults = Faults::from_bits(u32::from(tick == 2));
        producer.push(record).expect("room");
    }
    drop(producer);
    drain(consumer, recorder.subscribers(), |_| ());
    handle.stop();
    fs::read(&path).expect("bytes")
}

/// The same messages neither packed nor summed up: a byte that a fuzzer changes comes through to
/// the reader.
fn plain(packed: &[u8]) -> Vec<u8> {
    let options = mcap::WriteOptions::new()
        .compression(None)
        .calculate_chunk_crcs(false)
        .calculate_data_section_crc(false);
    let options = options.calculate_summary_section_crc(false).calculate_attachment_crcs(false);
    let mut writer = options.create(std::io::Cursor::new(Vec::new())).expect("begun");
    for message in mcap::MessageStream::new(packed).expect("a recording") {
        writer.write(&message.expect("sound")).expect("written");
    }
    writer.finish().expect("ended");
    writer.into_inner().into_inner()
}

#[test]
fn every_shipped_scene_replays_bit_for_bit() {
    let dir = tempfile::tempdir().expect("a folder");
    for scene in ["block-on-plane", "lift-with-block", "peg-in-hole"] {
        let path = dir.path().join(scene).with_extension("mcap");
        let n_ticks = record(&rig::shipped(scene), Duration::from_secs(2), &path, |_| ());
        assert_identical(&path, n_ticks);
    }
}
