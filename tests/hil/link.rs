//! Both processes, and what they say of each other.

use std::io::{BufRead, BufReader, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, ExitStatus, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use serde_json::Value;
use tempfile::TempDir;

/// Longer than any wait that still has hope.
const HUNG: Duration = Duration::from_secs(60);
/// How often something is tried that the machine may spoil.
const ATTEMPTS: u64 = 6;

/// Two tests have a host and an arm at a time, however many run: they wait most of their time, and
/// more of them would be late.
pub(crate) fn turn() -> MutexGuard<'static, ()> {
    static LINES: [Mutex<()>; 2] = [Mutex::new(()), Mutex::new(())];
    let [first, second] = &LINES;
    first.try_lock().unwrap_or_else(|_| second.lock().unwrap_or_else(PoisonError::into_inner))
}

pub(crate) fn root(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(path)
}

pub(crate) fn block_on_plane() -> PathBuf {
    root("config/scenes/block-on-plane.toml")
}

/// A process that does not outlive its test.
pub(crate) struct Running {
    child: Child,
    stdin: Option<ChildStdin>,
    stdout: Option<JoinHandle<String>>,
    stderr: Receiver<String>,
    said: String,
}

/// What a process left behind.
pub(crate) struct Ended {
    status: ExitStatus,
    pub(crate) json: Value,
    pub(crate) stderr: String,
}

impl Ended {
    pub(crate) fn code(&self) -> Option<i32> {
        self.status.code()
    }

    pub(crate) fn number(&self, key: &str) -> f64 {
        self.json[key].as_f64().unwrap_or_else(|| panic!("{key}: {}\n{}", self.json, self.stderr))
    }

    pub(crate) fn faults(&self) -> Vec<&str> {
        self.json["faults"].as_array().into_iter().flatten().filter_map(Value::as_str).collect()
    }
}

impl Running {
    pub(crate) fn start(args: &[&str]) -> Self {
        let mut child = Command::new(env!("CARGO_BIN_EXE_hapticd"))
            .args(args)
            .env("NO_COLOR", "1")
            // Never among the recordings of the user who runs the tests.
            .env("XDG_STATE_HOME", env!("CARGO_TARGET_TMPDIR"))
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("starts");
        let mut out = child.stdout.take().expect("piped");
        let stdout = std::thread::spawn(move || {
            let mut text = String::new();
            out.read_to_string(&mut text).expect("text");
            text
        });
        let err = BufReader::new(child.stderr.take().expect("piped"));
        let (sender, stderr) = channel();
        std::thread::spawn(move || {
            err.lines().map_while(Result::ok).try_for_each(|line| sender.send(line))
        });
        let stdin = child.stdin.take();
        Self { child, stdin, stdout: Some(stdout), stderr, said: String::new() }
    }

    /// Waits for a line of stderr that begins so, from now on.
    pub(crate) fn wait_for(&mut self, wanted: &str) {
        assert!(self.comes_to(wanted), "no `{wanted}` after\n{}", self.said);
    }

    /// The same; `false` if the process ends before.
    pub(crate) fn comes_to(&mut self, wanted: &str) -> bool {
        loop {
            match self.stderr.recv_timeout(HUNG) {
                Ok(line) => {
                    self.said.extend([&line, "\n"]);
                    if line.starts_with(wanted) {
                        return true;
                    }
                }
                Err(RecvTimeoutError::Disconnected) => return false,
                Err(RecvTimeoutError::Timeout) => {
                    panic!("says nothing more, and no `{wanted}` after\n{}", self.said)
                }
            }
        }
    }

    pub(crate) fn say(&mut self, line: &str) {
        writeln!(self.stdin.as_mut().expect("open"), "{line}").expect("listens");
    }

    pub(crate) fn id(&self) -> u32 {
        self.child.id()
    }

    pub(crate) fn signal(&self, name: &str) {
        let status = Command::new("kill")
            .args([format!("-{name}"), self.child.id().to_string()])
            .status()
            .expect("kill");
        assert!(status.success());
    }

    pub(crate) fn ended(mut self) -> Ended {
        let begin = std::time::Instant::now();
        let status = loop {
            match self.child.try_wait().expect("a child") {
                Some(status) => break status,
                None if begin.elapsed() > HUNG => panic!("does not end:\n{}", self.said),
                None => std::thread::sleep(Duration::from_millis(5)),
            }
        };
        let text =
            self.stdout.take().map(|thread| thread.join().expect("reads")).unwrap_or_default();
        let json = if text.is_empty() {
            Value::Null
        } else {
            serde_json::from_str(&text).unwrap_or_else(|e| panic!("{e}: {text}"))
        };
        self.said.extend(self.stderr.iter().flat_map(|line| [line, "\n".to_owned()]));
        Ended { status, json, stderr: core::mem::take(&mut self.said) }
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// A folder with what a test needs, the node of the mock arm among it.
pub(crate) struct Bench {
    pub(crate) folder: TempDir,
    /// Profile that the host uses.
    pub(crate) profile: String,
    /// Scene that the host renders; the hand of the arm is that of block-on-plane.
    pub(crate) scene: PathBuf,
}

impl Bench {
    /// An arm as it is shipped.
    pub(crate) fn shipped(profile: &str) -> Self {
        Self {
            folder: TempDir::new().expect("a folder"),
            profile: profile.to_owned(),
            scene: block_on_plane(),
        }
    }

    /// A shipped arm whose signs count as checked: it may push harder than 0.5 N.
    pub(crate) fn verified(profile: &str) -> Self {
        let bench = Self::shipped(profile);
        let text =
            std::fs::read_to_string(root(&format!("devices/{profile}.toml"))).expect("shipped");
        let text = text.replace("signs_verified = false", "signs_verified = true");
        let path = bench.folder.path().join(format!("{profile}.toml"));
        std::fs::write(&path, text).expect("written");
        Self { profile: path.display().to_string(), ..bench }
    }

    /// A verified open6 arm, so viscous that a link which is some ticks late makes nothing softer:
    /// what it feels does not depend on the machine.
    pub(crate) fn viscous() -> Self {
        Self::verified("open6-serial")
            .changed(&[("damping_n_s_per_m = 1.875", "damping_n_s_per_m = 15.0")])
    }

    fn link(&self) -> String {
        self.folder.path().join("arm").display().to_string()
    }

    /// The arm, ready for a host, until that has gone or it is sent a duration. The hand is that of
    /// block-on-plane.
    pub(crate) fn mock(&self, args: &[&str]) -> Running {
        let hung: &[&str] = if args.contains(&"--duration") { &[] } else { &["--duration", "60s"] };
        self.mock_with(&[&["--once"], hung, args].concat())
    }

    /// The arm, which says itself when it ends.
    pub(crate) fn mock_with(&self, args: &[&str]) -> Running {
        let link = self.link();
        let scene = block_on_plane();
        let scene = scene.to_str().expect("text");
        let mut all = vec!["mock", &self.profile, "--pty", &link, "--json", "--scene", scene];
        all.extend(["--cache", "off"]);
        all.extend(args);
        let mut mock = Running::start(&all);
        mock.wait_for("ready");
        mock
    }

    /// Another arm made of this one: text of its profile replaced.
    pub(crate) fn changed(self, replacements: &[(&str, &str)]) -> Self {
        let mut text = std::fs::read_to_string(&self.profile).expect("a verified arm");
        for (from, to) in replacements {
            assert!(text.contains(from), "{from}: {text}");
            text = text.replacen(from, to, 1);
        }
        std::fs::write(&self.profile, text).expect("written");
        self
    }

    /// The scene with more keys, for the host.
    pub(crate) fn scene_with(mut self, keys: &str) -> Self {
        let text = std::fs::read_to_string(block_on_plane())
            .expect("shipped")
            .replace("hand = \"hands/block-on-plane.csv\"", "");
        self.scene = self.folder.path().join("scene.toml");
        std::fs::write(&self.scene, format!("{text}\n{keys}\n")).expect("written");
        self
    }

    /// A file of poses for the hand of the arm: time in s, x and z of the tool in mm.
    pub(crate) fn hand(&self, knots: &[(f64, f64, f64)]) -> String {
        let path = self.folder.path().join("hand.csv");
        let mut text = "t_s,x_m,y_m,z_m,qx,qy,qz,qw\n".to_owned();
        for (t_s, x_mm, z_mm) in knots {
            text += &format!("{t_s},{},0,{},0,0,0,1\n", x_mm * 1e-3, z_mm * 1e-3);
        }
        std::fs::write(&path, text).expect("written");
        path.display().to_string()
    }

    /// The host, on the scene.
    pub(crate) fn host(&self, args: &[&str]) -> Running {
        let link = self.link();
        let mut all = vec![
            "run",
            self.scene.to_str().expect("text"),
            "--device",
            &self.profile,
            "--json",
            "--selector",
            &link,
        ];
        all.extend(["--cache", "off", "--monitor", "off"]);
        all.extend(args);
        Running::start(&all)
    }
}

/// What `once` returns, from the first time that the machine did not spoil it, or from the last.
/// Each time begins after a longer rest: what keeps a machine busy for some seconds passes. A fault
/// of ours comes every time.
pub(crate) fn repeat<T>(mut once: impl FnMut() -> (T, bool)) -> T {
    let _turn = turn();
    for attempt in 1..ATTEMPTS {
        let (result, is_spoilt) = once();
        if !is_spoilt {
            return result;
        }
        std::thread::sleep(Duration::from_secs(attempt));
    }
    once().0
}

/// Whether this is a fault that a machine makes alone: bytes of a tty pass through a kernel thread
/// of ordinary priority, so a busy machine makes a link late although both of its ends are in time.
pub(crate) fn is_lateness(fault: &str) -> bool {
    matches!(fault, "stale" | "overrun")
}

/// Runs host and arm against each other, again where the host ended for nothing but lateness, or
/// after some, when it should not. `expected`: sets of faults that are as they should be.
pub(crate) fn exchange(
    bench: &Bench,
    mock_args: &[&str],
    host_args: &[&str],
    expected: &[&[&str]],
) -> (Ended, Ended) {
    repeat(|| {
        let mock = bench.mock(mock_args);
        let host = bench.host(host_args).ended();
        let mock = mock.ended();
        let is_expected = expected.iter().any(|faults| host.faults() == *faults);
        // A host that gave up before the arm had its fault says nothing about it.
        let is_early = !expected.contains(&[].as_slice())
            && mock.json["faults"].as_array().is_none_or(Vec::is_empty);
        // An arm whose watchdog tripped says so, as an error of its own.
        let has_tripped = mock.number("watchdog_trips") > 0.0;
        let is_late = host
            .faults()
            .iter()
            .all(|fault| is_lateness(fault) || *fault == "device-error" && has_tripped);
        // A host that slept over several periods saw a fast hand leap.
        let has_slept =
            host.json["wakeup_us"]["max"].as_f64().is_some_and(|late_us| late_us > 3000.0);
        ((host, mock), (is_late || has_slept) && (!is_expected || is_early))
    })
}
