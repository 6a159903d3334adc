//! The program as a process in a folder of its test: never the cache of the user who runs the
//! tests, nor their recordings of faults.

use std::path::Path;
use std::process::{Command, Output, Stdio};

use serde_json::Value;

/// What a process left behind.
pub(crate) struct Ended {
    pub(crate) code: Option<i32>,
    pub(crate) stdout: String,
    pub(crate) stderr: String,
}

impl Ended {
    /// stdout as the one JSON object that it must be.
    pub(crate) fn json(&self) -> Value {
        assert_eq!(
            self.stdout.lines().count(),
            1,
            "one object in one line: {}\n{}",
            self.stdout,
            self.stderr
        );
        let json: Value = serde_json::from_str(&self.stdout)
            .unwrap_or_else(|error| panic!("{error}: {}", self.stdout));
        assert!(json.is_object());
        json
    }

    /// The phases that stderr names, in order.
    pub(crate) fn states(&self) -> Vec<&str> {
        self.stderr.lines().filter_map(|line| line.strip_prefix("state: ")).collect()
    }
}

impl From<Output> for Ended {
    fn from(output: Output) -> Self {
        let text = |bytes: Vec<u8>| String::from_utf8(bytes).expect("text");
        Self {
            code: output.status.code(),
            stdout: text(output.stdout),
            stderr: text(output.stderr),
        }
    }
}

/// `hapticd`, to be given its arguments.
pub(crate) fn program(dir: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_hapticd"));
    command
        .current_dir(dir)
        .env("XDG_CACHE_HOME", dir.join("xdg-cache"))
        .env("XDG_STATE_HOME", dir.join("xdg-state"));
    command
        .env_remove("NO_COLOR")
        .env_remove("CLICOLOR_FORCE")
        .env("RUST_BACKTRACE", "0")
        .stdin(Stdio::null());
    command
}

/// Runs a command line to its end.
pub(crate) fn hapticd(dir: &Path, line: &str) -> Ended {
    program(dir).args(line.split_whitespace()).output().expect("started").into()
}
