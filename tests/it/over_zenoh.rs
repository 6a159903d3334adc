//! The real programs over a real network on this machine's loopback: a node, a host, and one of
//! them killed. What is judged is what they do, not when: where the machine was too late for the
//! link, a run is repeated.

use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use serde_json::Value;

use super::rig;

/// Longest wait for anything, on a machine that does something else.
const PATIENCE: Duration = Duration::from_secs(120);
const TRIES: usize = 4;

fn endpoint() -> String {
    // Free a moment ago; a process that takes it meanwhile makes the node fail, which says so.
    let socket = std::net::UdpSocket::bind("127.0.0.1:0").expect("a port");
    format!("udp/{}", socket.local_addr().expect("an address"))
}

/// A program whose talk is kept line by line.
struct Running {
    child: Child,
    lines: Receiver<String>,
    talk: String,
}

impl Running {
    fn start(dir: &Path, line: &str) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_hapticd"));
        command
            .env("NO_COLOR", "1")
            .env("XDG_CACHE_HOME", dir)
            .env("XDG_STATE_HOME", dir)
            .env_remove("NOTIFY_SOCKET");
        let mut child = command
            .args(line.split_whitespace())
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("starts");
        let stderr = BufReader::new(child.stderr.take().expect("piped"));
        let (sender, lines) = channel();
        std::thread::spawn(move || {
            stderr.lines().map_while(Result::ok).all(|line| sender.send(line).is_ok())
        });
        Self { child, lines, talk: String::new() }
    }

    /// Waits for a line that has these words; false when the program ends, or time does.
    fn hears(&mut self, words: &str) -> bool {
        let begin = Instant::now();
        while begin.elapsed() < PATIENCE {
            let Ok(line) = self.lines.recv_timeout(PATIENCE) else { return false };
            self.talk += &format!("{line}\n");
            if line.contains(words) {
                return true;
            }
        }
        false
    }

    /// Types a line.
    fn say(&mut self, words: &str) {
        let stdin = self.child.stdin.as_mut().expect("piped");
        writeln!(stdin, "{words}").expect("read");
    }

    fn interrupt(&self) {
        let sent = Command::new("sh")
            .args(["-c", &format!("kill -INT {}", self.child.id())])
            .status()
            .expect("sh");
        assert!(sent.success());
    }

    /// Waits for the end: exit code, and the one JSON object.
    fn end(mut self) -> (Option<i32>, Value, String) {
        let mut stdout = String::new();
        self.child.stdout.take().expect("piped").read_to_string(&mut stdout).expect("text");
        let status = self.child.wait().expect("ends");
        self.talk.extend(self.lines.try_iter().map(|line| format!("{line}\n")));
        (status.code(), serde_json::from_str(&stdout).unwrap_or(Value::Null), self.talk.clone())
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// A node with the hand of a scene.
fn node(dir: &Path, endpoint: &str, scene: &str) -> Running {
    let options = "--hand-delay 2s --hold-ms 12 --fade-ms 25 --json --duration 10min";
    let scene = rig::shipped(scene);
    let line = format!(
        "device-node sim-sigma7 --name arm --listen {endpoint} --scene {} {options}",
        scene.display()
    );
    let mut node = Running::start(dir, &line);
    assert!(node.hears("ready zenoh:arm"), "{}", node.talk);
    node
}

/// A host that renders that scene over it.
fn host(dir: &Path, endpoint: &str, scene: &str, options: &str) -> Running {
    let scene = rig::shipped(scene);
    let line = format!(
        "run {} --device zenoh:arm --connect {endpoint} --json --monitor off {options}",
        scene.display()
    );
    Running::start(dir, &line)
}

fn pair(dir: &Path, scene: &str, options: &str) -> (Running, Running) {
    let endpoint = endpoint();
    (node(dir, &endpoint, scene), host(dir, &endpoint, scene, options))
}

fn is_link_fault(result: &Value) -> bool {
    let late = ["link", "stale", "sequence-gap"];
    result["faults"]
        .as_array()
        .is_some_and(|faults| faults.iter().any(|fault| late.iter().any(|name| fault == name)))
}

#[test]
fn a_peg_goes_into_its_hole_over_zenoh() {
    let dir = tempfile::tempdir().expect("a folder");
    let mut talk = String::new();
    for _ in 0..TRIES {
        let (node, host) = pair(dir.path(), "peg-in-hole", "--duration 10s");
        let (code, result, said) = host.end();
        node.interrupt();
        let (node_code, node_result, node_said) = node.end();
        assert_eq!(node_code, Some(0), "{node_said}");
        if is_link_fault(&result) {
            talk += &said;
            continue;
        }
        assert_eq!(code, Some(0), "{said}");
        let tip_mm = result["final_pose"]["z_m"].as_f64().expect("a pose") * 1e3;
        let (link, node) = (&result["link"], &node_result["link"]);
        eprintln!(
            "tip at {tip_mm:.2} mm, {:.2} N; host {link}; node {node}",
            result["max_force_n"].as_f64().unwrap_or(0.0)
        );
        assert!((-21.0..-19.0).contains(&tip_mm), "the peg stands at {tip_mm} mm\n{said}");
        assert!(
            node["commands"].as_u64().expect("a count") > 5000 && node["strange_packets"] == 0,
            "{node}"
        );
        assert_eq!((&link["hold_ms"], &link["fade_ms"]), (&12.into(), &25.into()), "{link}");
        assert!(
            said.contains("lets go 37 ms after the last command (12 held, 25 fading)"),
            "{said}"
        );
        assert!(
            link["there_ms"].as_f64().expect("a time") > 0.0
                && link["back_ms"].as_f64().expect("a time") > 0.0,
            "{link}"
        );
        return;
    }
    panic!("the machine was too late {TRIES} times\n{talk}");
}

/// Figure 7 of the paper: the arm and its hand on a small machine, the material on another.
#[test]
fn clay_is_pulled_by_an_arm_on_another_machine() {
    let dir = tempfile::tempdir().expect("a folder");
    std::fs::write(dir.path().join("hand.csv"), PULLING_HAND).expect("written");
    std::fs::write(dir.path().join("strokes.toml"), PULLING_STROKES).expect("written");
    let scene = dir.path().join("clay.toml");
    std::fs::write(&scene, PULLING_SCENE).expect("written");
    let mut talk = String::new();
    for _ in 0..TRIES {
        let endpoint = endpoint();
        let line = format!(
            "device-node sim-sigma7 --name arm --listen {endpoint} --scene {} --hand-delay 2s \
                --hold-ms 12 --fade-ms 25 --json --duration 10min",
            scene.display()
        );
        let mut node = Running::start(dir.path(), &line);
        assert!(node.hears("ready zenoh:arm"), "{}", node.talk);
        let line = format!(
            "sculpt {} --device zenoh:arm --connect {endpoint} --json --monitor off --duration 7s",
            scene.display()
        );
        let (code, result, said) = Running::start(dir.path(), &line).end();
        node.interrupt();
        let (node_code, node_result, node_said) = node.end();
        assert_eq!(node_code, Some(0), "{node_said}");
        if is_link_fault(&result) {
            talk += &said;
            continue;
        }
        let sculpt = &result["sculpt"];
        eprintln!("{sculpt}; host {}; node {}", result["link"], node_result["link"]);
        if sculpt["failed"].as_array().is_none_or(|failed| !failed.is_empty()) {
            // The hand of the node and the strokes of the host each follow their own time: on a
            // machine that stands still they miss each other.
            talk += &said;
            continue;
        }
        assert_eq!(code, Some(0), "{said}");
        assert_eq!(sculpt["strokes"], 1, "{sculpt}");
        let [before_mm3, after_mm3] =
            ["volume_before_mm3", "volume_mm3"].map(|key| sculpt[key].as_f64().expect("a volume"));
        assert!(after_mm3 > before_mm3 + 50.0, "{before_mm3} mm³ became {after_mm3} mm³");
        assert!(
            result["max_force_n"].as_f64().is_some_and(|force_n| force_n > 0.1),
            "the rope is felt: {result}"
        );
        assert!(
            node_result["link"]["commands"].as_u64().is_some_and(|n| n > 3000),
            "{node_result}"
        );
        return;
    }
    panic!("the machine was too late {TRIES} times\n{talk}");
}

const PULLING_SCENE: &str = r#"version = 1
[sculpt]
shape = { sphere_mm = 15 }
spacing_mm = 1.5
raster = [16, 16, 16]
brush_mm = 6
tool = "pull"
strokes = "strokes.toml"
[tool]
shape = { sphere_mm = 3 }
voxel_size_mm = 1.0
start_position_mm = [0, 0, 19.5]
[device]
profile = "sim-sigma7"
hand = "hand.csv"
"#;

/// Still until the hold has begun, whenever the machine comes to it; then 8 mm up.
const PULLING_HAND: &str = "t_s,x_m,y_m,z_m,qx,qy,qz,qw\n0,0,0,0.0195,0,0,0,1\n2,0,0,0.0195,0,0,0,1\n3,0,0,0.0275,0,0,0,1\n9,0,0,0.0275,0,0,0,1\n";

const PULLING_STROKES: &str = "version = 1\n[[stroke]]\nat_s = 1.5\ndo = \"hold\"\nuntil_s = 6.5\n";

#[test]
fn a_host_that_is_killed_leaves_an_arm_without_force() {
    let dir = tempfile::tempdir().expect("a folder");
    for _ in 0..TRIES {
        let (mut node, mut host) = pair(dir.path(), "block-on-plane", "");
        // The machine may be too late before that, and the host then ends.
        if !host.hears("state: enabled") {
            assert!(host.talk.contains("fault:"), "{}\n{}", node.talk, host.talk);
            continue;
        }
        std::thread::sleep(Duration::from_millis(500));
        host.child.kill().expect("killed");
        assert!(node.hears("the host fell silent"), "{}", node.talk);
        node.interrupt();
        let (code, result, said) = node.end();
        assert_eq!(code, Some(0), "{said}");
        let link = &result["link"];
        eprintln!("{link}");
        if link["link_losses"] == 1 {
            return;
        }
    }
    panic!("the machine was too late {TRIES} times");
}

#[test]
fn a_node_that_is_killed_is_a_fault_of_the_link() {
    let dir = tempfile::tempdir().expect("a folder");
    for _ in 0..TRIES {
        let (mut node, mut host) = pair(dir.path(), "block-on-plane", "");
        if !host.hears("state: enabled") {
            assert!(host.talk.contains("fault:"), "{}", host.talk);
            continue;
        }
        node.child.kill().expect("killed");
        let (code, result, said) = host.end();
        assert_eq!(code, Some(7), "{said}");
        assert_eq!(result["faults"], serde_json::json!(["link"]), "{said}");
        assert!(said.contains("fault: link"), "{said}");
        return;
    }
    panic!("the machine was too late {TRIES} times");
}

#[test]
fn a_node_that_is_started_again_is_found_and_waits_for_the_operator() {
    let dir = tempfile::tempdir().expect("a folder");
    let mut talk = String::new();
    for _ in 0..TRIES {
        let endpoint = endpoint();
        let mut first = node(dir.path(), &endpoint, "block-on-plane");
        let mut host = host(dir.path(), &endpoint, "block-on-plane", "--console");
        if !host.hears("state: enabled") {
            assert!(host.talk.contains("fault:"), "{}", host.talk);
            continue;
        }
        first.child.kill().expect("killed");
        first.child.wait().expect("ended");
        assert!(host.hears("state: fault"), "{}", host.talk);
        let killed = Instant::now();
        let second = node(dir.path(), &endpoint, "block-on-plane");
        assert!(host.hears("device: back at zenoh:arm; it waits for `enable`"), "{}", host.talk);
        eprintln!("found again after {:.1} s", killed.elapsed().as_secs_f64());
        host.say("enable");
        let is_enabled = host.hears("state: enabled");
        host.say("stop");
        let (code, result, said) = host.end();
        second.interrupt();
        let (_, node_result, node_said) = second.end();
        if !is_enabled || !node_result["link"]["commands"].is_u64() {
            talk += &format!("{said}{node_said}");
            continue;
        }
        assert_eq!(code, Some(7), "{said}");
        assert!(is_link_fault(&result), "{result}");
        assert!(node_result["link"]["commands"].as_u64().is_some_and(|n| n > 100), "{node_result}");
        return;
    }
    panic!("the machine was too late {TRIES} times\n{talk}");
}

#[test]
fn a_node_that_a_stranger_could_command_does_not_start() {
    let dir = tempfile::tempdir().expect("a folder");
    for (endpoints, remedy) in [
        ("--listen udp/0.0.0.0:7447", "openssl rand -hex 24"),
        ("--connect udp/192.0.2.1:7447", "not who is met"),
        ("--connect udp/192.0.2.1:7447 --key-file arm.key", "not who is met"),
    ] {
        let line = format!("device-node sim-sigma7 --no-hand {endpoints}");
        let mut node = Running::start(dir.path(), &line);
        assert!(node.hears(remedy), "{endpoints}: {}", node.talk);
        assert_eq!(node.end().0, Some(2), "{endpoints}");
    }
}

#[test]
fn a_name_that_no_node_has_is_an_error_with_a_remedy() {
    let dir = tempfile::tempdir().expect("a folder");
    let scene = rig::shipped("block-on-plane");
    let line = format!(
        "run {} --device zenoh:absent --connect {} --monitor off",
        scene.display(),
        endpoint()
    );
    let (code, _, said) = Running::start(dir.path(), &line).end();
    assert_eq!(code, Some(5), "{said}");
    assert!(
        said.contains("no device node named absent")
            && said.contains("device-node PROFILE --name absent"),
        "{said}"
    );
}
