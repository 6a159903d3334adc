//! What an administrator sees of a run: logs, manual pages, completions, first scenes, service
//! managers, reloads.

use std::fs;
use std::io::{BufRead as _, BufReader, Read as _};
use std::os::unix::net::UnixDatagram;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Output, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::thread::JoinHandle;
use std::time::Duration;

use serde_json::Value;
use tempfile::TempDir;

/// A process that has not said or done by then what it should, hangs.
const HUNG: Duration = Duration::from_secs(120);

fn program(dir: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_hapticd"));
    command
        .current_dir(dir)
        .env("NO_COLOR", "1")
        .env("RUST_BACKTRACE", "0")
        .env("XDG_CACHE_HOME", dir.join("xdg-cache"));
    command.env("XDG_STATE_HOME", dir.join("xdg-state"));
    command.env_remove("NOTIFY_SOCKET").env_remove("WATCHDOG_USEC").env_remove("WATCHDOG_PID");
    command
}

fn hapticd(dir: &Path, line: &str) -> Output {
    program(dir).args(line.split_whitespace()).stdin(Stdio::null()).output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

/// A scene of two shapes that bakes in no time, on the virtual or the real clock.
const SCENE: &str = r#"version = 1
[[static]]
name = "base"
shape = { plane_mm = [60.0, 60.0] }
voxel_size_mm = 2.0
layers = 4
[tool]
shape = { box_mm = [20.0, 20.0, 20.0] }
voxel_size_mm = 2.0
start_position_mm = [0, 0, 15]
[contact]
stiffness_n_per_mm3 = 1.25
[device]
profile = "sim-sigma7"
"#;

fn folder() -> TempDir {
    let dir = tempfile::tempdir().unwrap();
    fs::write(dir.path().join("a.toml"), SCENE).unwrap();
    dir
}

fn shipped(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("config/models").join(name)
}

/// A process that does not outlive its test.
struct Running {
    child: Child,
    stdout: Option<JoinHandle<String>>,
    stderr: Receiver<String>,
    said: Vec<String>,
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
        let err = BufReader::new(child.stderr.take().unwrap());
        let stdout = std::thread::spawn(move || {
            let mut text = String::new();
            out.read_to_string(&mut text).unwrap();
            text
        });
        let (sender, stderr) = channel();
        std::thread::spawn(move || {
            err.lines().map_while(Result::ok).try_for_each(|line| sender.send(line))
        });
        Self { child, stdout: Some(stdout), stderr, said: Vec::new() }
    }

    /// Waits for a line of stderr that has this in it, from here on, and gives it.
    fn wait_for(&mut self, wanted: &str) -> String {
        loop {
            match self.stderr.recv_timeout(HUNG) {
                Ok(line) => {
                    self.said.push(line.clone());
                    if line.contains(wanted) {
                        return line;
                    }
                }
                Err(error) => panic!("{error}: no `{wanted}` after\n{}", self.said.join("\n")),
            }
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

    /// Waits for its end: how it ended, its stdout, and all of its stderr.
    fn end(mut self) -> (ExitStatus, String, String) {
        while let Ok(line) = self.stderr.recv_timeout(HUNG) {
            self.said.push(line);
        }
        let stdout = self.stdout.take().unwrap().join().unwrap();
        (self.child.wait().unwrap(), stdout, std::mem::take(&mut self.said).join("\n"))
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The commands that `--help` lists.
fn commands(dir: &Path) -> Vec<String> {
    let help = text(&hapticd(dir, "--help").stdout);
    let (_, list) = help.split_once("Commands:\n").unwrap();
    let names = list
        .lines()
        .map_while(|line| line.strip_prefix("  "))
        .filter(|line| !line.starts_with(' '));
    names.filter_map(|line| line.split_whitespace().next()).map(str::to_owned).collect()
}

#[test]
fn every_command_has_a_manual_page() {
    let dir = folder();
    let names = commands(dir.path());
    assert!(
        names.len() > 8
            && ["run", "init", "help"].iter().all(|name| names.iter().any(|known| known == name)),
        "{names:?}"
    );
    let ended = hapticd(dir.path(), "man man/man1");
    assert!(ended.status.success(), "{}", text(&ended.stderr));
    for name in names.iter().filter(|name| *name != "help") {
        let page = fs::read_to_string(dir.path().join(format!("man/man1/hapticd-{name}.1")))
            .unwrap_or_else(|error| panic!("{name}: {error}"));
        assert!(
            page.contains(".TH") && page.contains(".SH SYNOPSIS") && page.contains("hapticd"),
            "{name}:\n{page}"
        );
        assert!(
            page.contains(".SH EXAMPLES\n") && page.ends_with(".SH \"SEE ALSO\"\nhapticd(1)\n"),
            "{name}:\n{page}"
        );
    }
    let main = text(&hapticd(dir.path(), "man").stdout);
    assert!(
        main.contains(".SH \"EXIT STATUS\"\n.TP\n0\n") && main.contains(".SH FILES\n.TP\n"),
        "{main}"
    );
    for section in ["EXAMPLES", "ENVIRONMENT", "\"SEE ALSO\""] {
        assert_eq!(main.matches(&format!(".SH {section}\n")).count(), 1, "{section}\n{main}");
    }
    assert!(main.contains("HAPTICD_TOKEN") && main.contains("hapticd\\-run(1)"), "{main}");
    assert_eq!(main, fs::read_to_string(dir.path().join("man/man1/hapticd.1")).unwrap());

    fs::write(dir.path().join("file"), "").unwrap();
    let ended = hapticd(dir.path(), "man file/man1");
    assert_eq!(ended.status.code(), Some(4));
    assert!(text(&ended.stderr).contains("file/man1"));
}

#[test]
fn shells_take_their_completions() {
    let dir = folder();
    for shell in ["bash", "zsh", "fish"] {
        let ended = hapticd(dir.path(), &format!("completions {shell}"));
        assert!(ended.status.success() && ended.stderr.is_empty());
        let script = text(&ended.stdout);
        assert!(commands(dir.path()).iter().all(|name| script.contains(name.as_str())), "{shell}");
        fs::write(dir.path().join(shell), script).unwrap();
        // Those that are here.
        match Command::new(shell).arg("-n").arg(dir.path().join(shell)).output() {
            Ok(checked) => assert!(checked.status.success(), "{shell}: {}", text(&checked.stderr)),
            Err(error) => assert_ne!(shell, "bash", "{error}"),
        }
    }
    // Profiles and files where a profile is asked for.
    fs::write(dir.path().join("sim-mine.toml"), "").unwrap();
    let complete = |words: &str, cur: &str, prev: &str| {
        let n = words.split(' ').count() - 1;
        let script = format!(
            "source ./bash; COMP_WORDS=({words}); COMP_CWORD={n}; _hapticd hapticd {cur} {prev}; \
                printf '%s\\n' \"${{COMPREPLY[@]}}\""
        );
        let ended =
            Command::new("bash").args(["-c", &script]).current_dir(dir.path()).output().unwrap();
        text(&ended.stdout).lines().map(str::to_owned).collect::<Vec<_>>()
    };
    let offered = complete("hapticd run --device sim-", "sim-", "--device");
    assert!(
        ["sim-sigma7", "sim-touch", "sim-mine.toml"]
            .iter()
            .all(|name| offered.iter().any(|word| word == name)),
        "{offered:?}"
    );
    let offered = complete("hapticd devices probe pol", "pol", "probe");
    assert!(offered.iter().any(|word| word == "polhem-2022"), "{offered:?}");
    let [zsh, fish] =
        ["zsh", "fish"].map(|shell| fs::read_to_string(dir.path().join(shell)).unwrap());
    assert!(
        zsh.matches("{compadd ").count() == 6
            && zsh.contains("sim-sigma7")
            && zsh.contains("; _files}'"),
        "{zsh}"
    );
    assert!(
        fish.lines().any(|line| line.contains(" -l device ") && line.contains(" -r -F -a \"")),
        "{fish}"
    );
    assert_eq!(hapticd(dir.path(), "completions tcsh").status.code(), Some(2));
}

/// Every line of stderr as an object.
fn events(stderr: &[u8]) -> Vec<Value> {
    let events: Vec<Value> = text(stderr)
        .lines()
        .map(|line| serde_json::from_str(line).unwrap_or_else(|error| panic!("{error}: {line}")))
        .collect();
    for event in &events {
        let time = event["time"].as_str().unwrap();
        assert!(time.len() == 24 && time.ends_with('Z') && time.as_bytes()[10] == b'T', "{event}");
        assert!(
            ["error", "warning", "info", "debug"].contains(&event["level"].as_str().unwrap()),
            "{event}"
        );
        assert!(
            !event["message"].as_str().unwrap().is_empty()
                && !event["event"].as_str().unwrap().is_empty(),
            "{event}"
        );
    }
    events
}

fn of<'e>(events: &'e [Value], name: &str) -> Vec<&'e Value> {
    events.iter().filter(|event| event["event"] == name).collect()
}

#[test]
fn json_logs_have_one_object_per_line_and_levels() {
    let dir = folder();
    let run = "run a.toml --cache off --clock virtual --duration 500ms --log-format json";
    let ended = hapticd(dir.path(), run);
    assert!(ended.status.success());
    let said = events(&ended.stderr);
    let phases: Vec<_> =
        of(&said, "phase").iter().map(|event| event["phase"].as_str().unwrap()).collect();
    assert_eq!(
        phases,
        ["baking", "disabled", "enabling", "enabled", "stopping", "disabled", "stopped"]
    );
    assert!(
        of(&said, "preflight")
            .iter()
            .all(|event| event["check"].is_string() && event["outcome"].is_string())
    );
    assert!(of(&said, "status").is_empty(), "debug only");
    assert!(text(&ended.stdout).starts_with("ticks "), "results stay text");

    let verbose = hapticd(dir.path(), &format!("{run} -v"));
    assert!(!of(&events(&verbose.stderr), "message").is_empty(), "what the scene resolves to");
    let quiet = hapticd(dir.path(), &format!("{run} -q"));
    assert!(events(&quiet.stderr).is_empty());

    fs::write(
        dir.path().join("fault.toml"),
        format!("{SCENE}[device.sim]\nfault = \"nan@50ms\"\n"),
    )
    .unwrap();
    let ended = hapticd(
        dir.path(),
        "run fault.toml --cache off --clock virtual --duration 1s --log-format json -q",
    );
    assert_eq!(ended.status.code(), Some(7));
    let said = events(&ended.stderr);
    let [fault] = of(&said, "fault")[..] else { panic!("{said:?}") };
    assert!(
        fault["level"] == "error"
            && fault["fault"] == "non-finite"
            && fault["tick"].as_u64() > Some(40),
        "{fault}"
    );

    fs::write(dir.path().join("wrong.toml"), SCENE.replace("layers = 4", "layers = 400")).unwrap();
    let said = events(&hapticd(dir.path(), "check wrong.toml --log-format json").stderr);
    let [error] = of(&said, "error")[..] else { panic!("{said:?}") };
    assert!(
        error["level"] == "error"
            && error["message"].as_str().unwrap().contains("static[0].layers"),
        "{error}"
    );
    assert_eq!(hapticd(dir.path(), "check a.toml --log-format xml").status.code(), Some(2));
}

/// Two shipped parts, files that are none, and one that is damaged.
fn parts() -> TempDir {
    let dir = tempfile::tempdir().unwrap();
    let parts = dir.path().join("parts");
    fs::create_dir(&parts).unwrap();
    for name in ["peg.obj", "block-hole.obj"] {
        fs::copy(shipped(name), parts.join(name)).unwrap();
    }
    fs::write(parts.join("notes.txt"), "not a mesh").unwrap();
    dir
}

#[test]
fn a_folder_of_meshes_becomes_a_scene_that_runs() {
    let dir = parts();
    let ended = hapticd(dir.path(), "init parts");
    assert!(ended.status.success(), "{}", text(&ended.stderr));
    let out = text(&ended.stdout);
    let err = text(&ended.stderr);
    assert!(
        err.contains(
            "note: units are taken as mm: the largest part is then 40 mm long; \
        --units says otherwise"
        ),
        "{err}"
    );
    assert!(
        out.contains("tool    peg (peg.obj), points every 0.4 mm")
            && out.contains("static  block-hole (block-hole.obj)"),
        "{out}"
    );
    assert!(
        out.contains("memory  baking takes about ")
            && out.contains("`hapticd run parts/scene.toml` renders it"),
        "{out}"
    );

    let scene = fs::read_to_string(dir.path().join("parts/scene.toml")).unwrap();
    assert!(
        scene.contains("units = \"mm\"")
            && scene.contains("guessed")
            && scene.contains("mesh = \"peg.obj\""),
        "{scene}"
    );
    let checked = hapticd(dir.path(), "check parts/scene.toml");
    assert!(checked.status.success(), "{}", text(&checked.stderr));
    let run = hapticd(dir.path(), "run parts/scene.toml --clock virtual --duration 1s --json");
    assert!(run.status.success(), "{}", text(&run.stderr));
    let result: Value = serde_json::from_slice(&run.stdout).unwrap();
    assert_eq!(result["faults"], Value::Array(Vec::new()));
    assert_eq!(
        (&result["contact_ticks"], result["ticks"].as_u64() > Some(1000)),
        (&Value::from(0), true),
        "begins outside of everything"
    );
}

#[test]
fn init_writes_elsewhere_and_over_nothing_unless_reported() {
    let dir = parts();
    fs::create_dir_all(dir.path().join("scenes/mine")).unwrap();
    let line = "init parts -o scenes/mine/a.toml --tool block-hole.obj --units cm";
    assert!(hapticd(dir.path(), line).status.success());
    let scene = fs::read_to_string(dir.path().join("scenes/mine/a.toml")).unwrap();
    let (statics, tool) = scene.split_once("[tool]").unwrap();
    assert!(
        statics.contains("mesh = \"../../parts/peg.obj\"")
            && tool.contains("mesh = \"../../parts/block-hole.obj\""),
        "{scene}"
    );
    assert!(tool.contains("units = \"cm\"") && !tool.contains("scale = 1.0"), "{scene}");
    assert!(hapticd(dir.path(), "check scenes/mine/a.toml").status.success());

    fs::write(dir.path().join("scenes/mine/a.toml"), "mine").unwrap();
    let refused = hapticd(dir.path(), line);
    assert_eq!(refused.status.code(), Some(2));
    assert!(
        text(&refused.stderr).contains("is there already")
            && text(&refused.stderr).contains("--overwrite")
    );
    assert_eq!(fs::read_to_string(dir.path().join("scenes/mine/a.toml")).unwrap(), "mine");
    assert!(hapticd(dir.path(), &format!("{line} --overwrite")).status.success());
    assert_eq!(fs::read_to_string(dir.path().join("scenes/mine/a.toml")).unwrap(), scene);
}

#[test]
fn init_prints_a_scene_and_quotes_names_with_blanks() {
    let dir = parts();
    let printed = hapticd(dir.path(), "init parts -o -");
    assert!(printed.status.success(), "{}", text(&printed.stderr));
    assert!(
        text(&printed.stderr).contains("memory  baking takes about "),
        "{}",
        text(&printed.stderr)
    );
    fs::write(dir.path().join("scene.toml"), &printed.stdout).unwrap();
    assert!(
        text(&printed.stdout).contains("mesh = \"parts/peg.obj\""),
        "{}",
        text(&printed.stdout)
    );
    let checked = hapticd(dir.path(), "check scene.toml");
    assert!(checked.status.success(), "{}", text(&checked.stderr));

    fs::rename(dir.path().join("parts"), dir.path().join("my parts")).unwrap();
    let line = ["init", "my parts", "--output", "my parts/scene.toml"];
    let ended = Command::new(env!("CARGO_BIN_EXE_hapticd"))
        .current_dir(dir.path())
        .args(line)
        .output()
        .unwrap();
    assert!(ended.status.success(), "{}", text(&ended.stderr));
    let scene = fs::read_to_string(dir.path().join("my parts/scene.toml")).unwrap();
    assert!(scene.contains("#   hapticd check 'my parts/scene.toml'"), "{scene}");
    // The folder in place of the scene.
    let ended = Command::new(env!("CARGO_BIN_EXE_hapticd"))
        .current_dir(dir.path())
        .args(["check", "my parts"])
        .output()
        .unwrap();
    assert!(
        text(&ended.stderr).contains("hint: did you mean my parts/scene.toml?"),
        "{}",
        text(&ended.stderr)
    );
}

#[test]
fn check_warns_of_a_part_of_many_metres() {
    let dir = parts();
    assert!(hapticd(dir.path(), "init parts --units m").status.success());
    let checked = hapticd(dir.path(), "check parts/scene.toml");
    let said = text(&checked.stderr);
    assert!(
        checked.status.success()
            && said.contains("warning: block-hole: ")
            && said.contains("the box is 40.0 m long: is `units` right?"),
        "{said}"
    );
    assert!(hapticd(dir.path(), "init parts --units mm --overwrite").status.success());
    assert_eq!(text(&hapticd(dir.path(), "check parts/scene.toml").stderr), "");
}

#[test]
fn one_part_is_touched_by_a_ball() {
    let dir = parts();
    fs::remove_file(dir.path().join("parts/peg.obj")).unwrap();
    assert!(hapticd(dir.path(), "init parts").status.success());
    let scene = fs::read_to_string(dir.path().join("parts/scene.toml")).unwrap();
    assert!(scene.contains("shape = { sphere_mm = 2.0 }"), "{scene}");
    assert!(hapticd(dir.path(), "check parts/scene.toml").status.success());
    let refused = hapticd(dir.path(), "init parts --force --tool block-hole.obj");
    assert_eq!(refused.status.code(), Some(2));
    assert!(text(&refused.stderr).contains("one part only"));
}

#[test]
fn init_names_what_it_cannot_use() {
    let dir = parts();
    fs::create_dir(dir.path().join("empty")).unwrap();
    fs::create_dir(dir.path().join("bad")).unwrap();
    fs::write(dir.path().join("bad/one.obj"), "v 0 0 0\n").unwrap();
    fs::write(dir.path().join("bad/two.stl"), "").unwrap();
    for (line, code, fragments) in [
        ("init nowhere", 4, &["nowhere", "folder with mesh files"][..]),
        ("init empty", 4, &["empty: no mesh files here", "3mf"]),
        ("init bad", 4, &["one.obj", "two.stl", "none of its meshes can be read"]),
        ("init parts --tool wheel.obj", 2, &["--tool wheel.obj", "peg.obj"]),
        ("init parts --units furlong", 2, &["'furlong'"]),
        ("init parts -o parts/scene", 2, &["a scene is a .toml file"]),
        ("init parts -o nowhere/scene.toml", 4, &["nowhere"]),
    ] {
        let refused = hapticd(dir.path(), line);
        let said = text(&refused.stderr);
        assert_eq!(refused.status.code(), Some(code), "{line}: {said}");
        assert!(fragments.iter().all(|fragment| said.contains(fragment)), "{line}: {said}");
        assert!(refused.stdout.is_empty(), "{line}");
    }
    // One that is damaged does not spoil the others.
    fs::copy(dir.path().join("bad/one.obj"), dir.path().join("parts/one.obj")).unwrap();
    let ended = hapticd(dir.path(), "init parts");
    assert!(ended.status.success());
    let said = text(&ended.stderr);
    assert!(
        said.contains("warning") && said.contains("one.obj") && said.contains("left out"),
        "{said}"
    );
    assert!(!fs::read_to_string(dir.path().join("parts/scene.toml")).unwrap().contains("one.obj"));
}

/// What a service manager receives, message by message.
struct Manager {
    socket: UnixDatagram,
    path: PathBuf,
}

impl Manager {
    fn new(dir: &Path) -> Self {
        let path = dir.join("notify");
        let socket = UnixDatagram::bind(&path).unwrap();
        socket.set_read_timeout(Some(HUNG)).unwrap();
        Self { socket, path }
    }

    /// The lines of the next message.
    fn hear(&self) -> Vec<String> {
        let mut bytes = [0; 4096];
        let n = self.socket.recv(&mut bytes).expect("a message in time");
        text(&bytes[..n]).lines().map(str::to_owned).collect()
    }

    /// Every line up to the one that is waited for.
    fn hear_until(&self, wanted: &str) -> Vec<String> {
        let mut heard = Vec::new();
        while !heard.iter().any(|line| line == wanted) {
            heard.extend(self.hear());
        }
        heard
    }
}

#[test]
fn a_service_manager_hears_when_it_is_ready_that_it_ticks_and_that_it_stops() {
    let dir = folder();
    let manager = Manager::new(dir.path());
    let mut command = program(dir.path());
    command.args(["run", "a.toml", "--cache", "off", "--realtime", "best-effort"]);
    command.env("NOTIFY_SOCKET", &manager.path).env("WATCHDOG_USEC", "1000000");
    let running = Running::start(&mut command);
    let before = manager.hear_until("READY=1");
    assert!(
        before.contains(&"STATUS=baking".to_owned())
            && !before.iter().any(|line| line == "WATCHDOG=1"),
        "{before:?}"
    );
    for _ in 0..3 {
        manager.hear_until("WATCHDOG=1");
    }
    running.signal("TERM");
    let after = manager.hear_until("STOPPING=1");
    assert!(
        after.contains(&"STATUS=stopping".to_owned()) && !after.contains(&"READY=1".to_owned()),
        "{after:?}"
    );
    let (status, ..) = running.end();
    assert!(status.success());
}

#[test]
fn a_service_manager_hears_of_a_fault_and_without_a_watchdog_nothing_is_fed() {
    let dir = folder();
    fs::write(
        dir.path().join("fault.toml"),
        format!("{SCENE}[device.sim]\nfault = \"nan@50ms\"\n"),
    )
    .unwrap();
    let manager = Manager::new(dir.path());
    let mut command = program(dir.path());
    command.args(["run", "fault.toml", "--cache", "off", "--clock", "virtual", "--duration", "1s"]);
    let running = Running::start(command.env("NOTIFY_SOCKET", &manager.path));
    let heard = manager.hear_until("STATUS=fault: a pose or a force was not a number");
    assert!(
        heard.contains(&"READY=1".to_owned()) && !heard.contains(&"WATCHDOG=1".to_owned()),
        "{heard:?}"
    );
    assert_eq!(running.end().0.code(), Some(7));
}

/// Whether what started this test ignores SIGHUP: its children inherit that.
fn is_hangup_ignored() -> bool {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status
        .lines()
        .find_map(|line| u64::from_str_radix(line.strip_prefix("SigIgn:")?.trim(), 16).ok());
    // Signal 1 is the lowest bit.
    let ignored = mask.is_some_and(|mask| mask & 1 == 1);
    if ignored {
        eprintln!("skipped: SIGHUP is ignored here (nohup), and stays so in what this test starts");
    }
    ignored
}

fn running(dir: &Path, more: &str) -> Running {
    let line = format!("run a.toml --cache off --realtime best-effort --monitor off {more}");
    let mut running = Running::start(program(dir).args(line.split_whitespace()));
    running.wait_for("state: enabled");
    running
}

fn write(dir: &Path, from: &str, to: &str) {
    assert!(SCENE.contains(from));
    fs::write(dir.join("a.toml"), SCENE.replace(from, to)).unwrap();
}

#[test]
fn a_hangup_reads_the_scene_again() {
    if is_hangup_ignored() {
        return;
    }
    let dir = folder();
    let mut run = running(dir.path(), "");
    run.signal("HUP");
    run.wait_for("reload: nothing has changed");

    write(dir.path(), "= 1.25", "= 1.0\nfriction = { static = 0.3, dynamic = 0.2 }");
    run.signal("HUP");
    let tuned = "reload: contact_stiffness_n_per_m 5000 -> 4000, friction_static 0 -> 0.3, \
        friction_dynamic 0 -> 0.2";
    assert_eq!(run.wait_for("reload: contact"), tuned);

    write(dir.path(), "[60.0, 60.0]", "[50.0, 60.0]");
    run.signal("HUP");
    run.wait_for("reload: a.toml is baked and comes next");
    run.wait_for("scene: a.toml from ");
    run.wait_for("state: enabled");
    assert!(!run.said.iter().any(|line| line.contains("fault")), "{:?}", run.said);

    // What is wrong, or for another arm, changes nothing.
    for (from, to, words) in [
        ("voxel_size_mm = 2.0\nlayers", "voxel_size_mm = -2.0\nlayers", "static[0].voxel_size_mm"),
        ("version = 1", "version = = 1", "a.toml"),
        (
            "sim-sigma7",
            "sim-touch",
            "device.profile = \"sim-touch\", but the scene that is rendered has \"sim-sigma7\"",
        ),
        ("[contact]", "[rendering]\nrate_hz = 500\n[contact]", "rendering.rate_hz = 500"),
        (
            "[contact]",
            "[safety]\ndeadman = 2\n[contact]",
            "safety.deadman = 2, but the scene that is rendered has \"off\"",
        ),
        ("[contact]", "[safety]\nheartbeat_ms = 250\n[contact]", "safety.heartbeat_ms = 250"),
        (
            "[contact]",
            "[realtime]\npriority = 70\n[contact]",
            "realtime.priority = 70, but the scene that is rendered has 80",
        ),
    ] {
        write(dir.path(), from, to);
        run.signal("HUP");
        run.wait_for(words);
        run.wait_for("reload: refused, the old scene stays");
    }
    fs::remove_file(dir.path().join("a.toml")).unwrap();
    run.signal("HUP");
    run.wait_for("reload: refused, the old scene stays");

    run.signal("TERM");
    let (status, out, err) = run.end();
    assert!(status.success(), "{err}");
    assert!(out.contains("faults             none"), "{out}");
}

#[test]
fn a_hangup_takes_parameters_of_a_scene_with_clay_and_leaves_the_clay() {
    if is_hangup_ignored() {
        return;
    }
    let dir = folder();
    let clay = "[sculpt]\nshape = { sphere_mm = 5 }\nspacing_mm = 1\nraster = [12, 12, \
        12]\nposition_mm = [0, 0, -60]\n";
    let write = |text: &str| fs::write(dir.path().join("a.toml"), text).unwrap();
    let scene = format!("{SCENE}{clay}");
    write(&scene);
    let line = "sculpt a.toml --cache off --realtime best-effort --monitor off";
    let mut run = Running::start(program(dir.path()).args(line.split_whitespace()));
    run.wait_for("state: enabled");
    write(&scene.replace("= 1.25", "= 1.0"));
    run.signal("HUP");
    run.wait_for("reload: contact_stiffness_n_per_m 5000 -> 4000");
    write(&scene.replace("raster = [12", "raster = [16"));
    run.signal("HUP");
    let refused = run.wait_for("a run with clay takes only changes of parameters (");
    assert!(refused.contains("contact_stiffness_n_per_m"), "{refused}");
    run.wait_for("reload: refused, the old scene stays");
    run.signal("TERM");
    assert!(run.end().0.success());
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn a_watched_scene_follows_its_files() {
    let dir = folder();
    fs::copy(shipped("peg.obj"), dir.path().join("part.obj")).unwrap();
    let scene = SCENE
        .replace("shape = { plane_mm = [60.0, 60.0] }", "mesh = \"part.obj\"\nunits = \"mm\"")
        .replace("15]", "35]");
    fs::write(dir.path().join("a.toml"), &scene).unwrap();
    let mut run = running(dir.path(), "--watch");
    fs::write(dir.path().join("a.toml"), scene.replace("= 1.25", "= 0.75")).unwrap();
    run.wait_for("reload: a file has changed");
    run.wait_for("reload: contact_stiffness_n_per_m 5000 -> 3000");
    // A mesh that an editor writes anew, under the same name.
    fs::copy(shipped("block-hole.obj"), dir.path().join("new.obj")).unwrap();
    fs::rename(dir.path().join("new.obj"), dir.path().join("part.obj")).unwrap();
    run.wait_for("reload: a file has changed");
    run.wait_for("reload: a.toml is baked and comes next");
    run.wait_for("scene: a.toml from ");
    // One that cannot be read is refused, and the next one taken.
    fs::write(dir.path().join("part.obj"), "v 0 0 0\n").unwrap();
    run.wait_for("reload: refused, the old scene stays");
    fs::copy(shipped("peg.obj"), dir.path().join("part.obj")).unwrap();
    run.wait_for("reload: a.toml is baked and comes next");
    run.signal("TERM");
    assert!(run.end().0.success());
}

#[test]
fn a_service_manager_hears_of_a_reload() {
    if is_hangup_ignored() {
        return;
    }
    let dir = folder();
    let manager = Manager::new(dir.path());
    let mut command = program(dir.path());
    command.args([
        "run",
        "a.toml",
        "--cache",
        "off",
        "--realtime",
        "best-effort",
        "--monitor",
        "off",
        "--log-format",
        "json",
    ]);
    let run = Running::start(command.env("NOTIFY_SOCKET", &manager.path));
    manager.hear_until("READY=1");
    manager.hear_until("STATUS=enabled");
    write(dir.path(), "= 1.25", "= 1.0");
    run.signal("HUP");
    let message = loop {
        let message = manager.hear();
        if message[0] == "RELOADING=1" {
            break message;
        }
    };
    assert!(
        message[1].strip_prefix("MONOTONIC_USEC=").is_some_and(|time| time.parse::<u64>().is_ok()),
        "{message:?}"
    );
    assert_eq!(
        manager.hear(),
        ["READY=1", "STATUS=reload: contact_stiffness_n_per_m 5000 -> 4000"]
    );
    run.signal("TERM");
    manager.hear_until("STOPPING=1");
    let (status, _, err) = run.end();
    assert!(status.success());
    let said = events(err.as_bytes());
    let [begun, done] = of(&said, "reload")[..] else { panic!("{said:?}") };
    assert!(begun["cause"] == "signal" && done["outcome"] == "tuned", "{begun} {done}");
    assert_eq!(done["changes"]["contact_stiffness_n_per_m"], 4000.0);
}

/// `script` gives the program a terminal of its own; killing it is what a closed window does.
#[test]
fn a_terminal_that_goes_away_is_a_stop() {
    if is_hangup_ignored() || Command::new("script").arg("--version").output().is_err() {
        return;
    }
    let dir = folder();
    let line = format!(
        "exec '{}' run a.toml --cache off --realtime best-effort --monitor off --json > out 2> err",
        env!("CARGO_BIN_EXE_hapticd")
    );
    let mut terminal = Command::new("script")
        .args(["-qec", &line, "/dev/null"])
        .current_dir(dir.path())
        .env("SHELL", "/bin/sh")
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    let read = |name: &str| fs::read_to_string(dir.path().join(name)).unwrap_or_default();
    let wait_for = |name: &str, wanted: &str| {
        let since = std::time::Instant::now();
        while !read(name).contains(wanted) {
            assert!(since.elapsed() < HUNG, "no `{wanted}` in\n{}", read(name));
            std::thread::sleep(Duration::from_millis(20));
        }
    };
    wait_for("err", "state: enabled");
    terminal.kill().unwrap();
    terminal.wait().unwrap();
    wait_for("err", "stop: the terminal has gone");
    wait_for("err", "state: stopped");
    wait_for("out", "\"faults\":[]");
    assert!(!read("err").contains("reload"), "{}", read("err"));
}

#[test]
fn the_unit_is_one_that_systemd_takes() {
    let unit = fs::read_to_string(
        Path::new(env!("CARGO_MANIFEST_DIR")).join("scripts/systemd/hapticd@.service"),
    )
    .unwrap();
    let lines = [
        "Type=notify",
        "WatchdogSec=3s",
        "LimitRTPRIO=95",
        "LimitMEMLOCK=infinity",
        "RestrictRealtime=no",
        "Restart=no",
    ];
    // What kills the guard of the arm together with the program leaves force on it.
    for line in lines.into_iter().chain([
        "KillMode=process",
        "OOMPolicy=continue",
        "ManagedOOMPreference=omit",
    ]) {
        assert!(unit.lines().any(|written| written == line), "{line}");
    }
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("hapticd@desk.service");
    fs::write(
        &path,
        unit.replace("ExecStart=hapticd", concat!("ExecStart=", env!("CARGO_BIN_EXE_hapticd"))),
    )
    .unwrap();
    let Ok(checked) =
        Command::new("systemd-analyze").args(["verify", "--man=no"]).arg(&path).output()
    else {
        eprintln!("skipped: no systemd-analyze here");
        return;
    };
    // It says what it does not know, and ends well all the same.
    assert!(checked.status.success() && checked.stderr.is_empty(), "{}", text(&checked.stderr));
}
