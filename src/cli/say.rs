//! Where every word leaves the program: results on stdout, talk on stderr.
//!
//! `println!` panics when the reader is gone (`hapticd check … | head`) or the disk is full. While an arm is being rendered a panic of the
//! talking thread would leave the loop alone, so nothing here panics: lost talk is lost, a lost result becomes the exit code.
//!
//! Talk is text for people, or with `--log-format json` one JSON object per line for programs: `time` (UTC), `level`, `event`, `message` (the
//! text without decoration), and the fields of that event.

use std::fmt;
use std::io::{self, Write as _};
use std::path::Path;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::SystemTime;

use clap::ValueEnum;
use serde::ser::{Serialize, SerializeMap, Serializer};
use serde_json::Value;

use crate::rt::utc::timestamp;

/// Why the first result that did not arrive did not.
static LOST_RESULT: OnceLock<io::Error> = OnceLock::new();

/// Talk is JSON. Set once, before anything is said.
static IS_JSON: AtomicBool = AtomicBool::new(false);

/// What talk looks like.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(crate) enum LogFormat {
    /// Lines for people.
    #[default]
    Text,
    /// One JSON object per line.
    Json,
}

/// How much a line of talk matters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Level {
    /// Something was not done, or force went away.
    Error,
    /// Something may not be as it was meant.
    Warning,
    /// What happens.
    Info,
    /// More of it (`--verbose`).
    Debug,
}

impl Level {
    const fn name(self) -> &'static str {
        match self {
            Self::Error => "error",
            Self::Warning => "warning",
            Self::Info => "info",
            Self::Debug => "debug",
        }
    }
}

/// Names and values that go with an event.
pub(crate) type Fields<'a> = &'a [(&'a str, Value)];

/// Decides what talk looks like from here on. A panic, too, speaks the language that was chosen.
pub(crate) fn use_format(format: LogFormat) {
    if format == LogFormat::Json {
        IS_JSON.store(true, Ordering::Relaxed);
        std::panic::set_hook(Box::new(|info| event(Level::Error, "panic", &info.to_string(), &[])));
    }
}

/// Talk is read by a program.
pub(crate) fn is_json() -> bool {
    IS_JSON.load(Ordering::Relaxed)
}

/// The name of a file as a shell takes it for one word, for commands that somebody is told to type.
pub(crate) fn quoted(file: &Path) -> String {
    let name = file.to_string_lossy();
    let is_plain = |c: char| c.is_alphanumeric() || "/._-+:@%,".contains(c);
    if name.chars().all(is_plain) { name.into_owned() } else { format!("'{}'", name.replace('\'', "'\\''")) }
}

/// Writes a result to stdout.
pub(crate) fn result(text: fmt::Arguments<'_>) {
    if let Err(error) = io::stdout().write_all(text.to_string().as_bytes()) {
        let _ = LOST_RESULT.set(error);
    }
}

/// Writes talk to stderr at once: text as it is, or its lines as events without fields.
pub(crate) fn talk(text: fmt::Arguments<'_>) {
    if is_json() {
        text.to_string().lines().filter(|line| !line.trim().is_empty()).for_each(|line| event(Level::Info, "message", line, &[]));
    } else {
        write(&text.to_string());
    }
}

/// Writes one event to stderr: its text in a line, or an object with its fields.
pub(crate) fn event(level: Level, name: &str, text: &str, fields: Fields<'_>) {
    if is_json() {
        let line = Line { time: &timestamp(SystemTime::now()), level, name, text: text.trim(), fields };
        // True invariant: names and plain values.
        write(&format!("{}\n", serde_json::to_string(&line).unwrap_or_default()));
    } else {
        write(&format!("{text}\n"));
    }
}

fn write(text: &str) {
    // One write, so that lines of other processes do not cut in. If it fails, nobody is left to be told.
    let _ = io::stderr().write_all(text.as_bytes());
}

/// One line of JSON. Written by hand: the order of the keys is for readers.
struct Line<'a> {
    time: &'a str,
    level: Level,
    name: &'a str,
    text: &'a str,
    fields: Fields<'a>,
}

impl Serialize for Line<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(4 + self.fields.len()))?;
        map.serialize_entry("time", self.time)?;
        map.serialize_entry("level", self.level.name())?;
        map.serialize_entry("event", self.name)?;
        map.serialize_entry("message", self.text)?;
        for (key, value) in self.fields {
            map.serialize_entry(key, value)?;
        }
        map.end()
    }
}

/// Why a result could not be delivered, once all is said. A reader that has seen enough is no reason.
pub(crate) fn lost_result() -> Option<&'static io::Error> {
    if let Err(error) = io::stdout().flush() {
        let _ = LOST_RESULT.set(error);
    }
    LOST_RESULT.get().filter(|error| error.kind() != io::ErrorKind::BrokenPipe)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_one_object_with_its_keys_in_order() {
        let fields = [("tick", Value::from(12)), ("fault", Value::from("stale"))];
        let line = Line { time: "t", level: Level::Error, name: "fault", text: "two\nlines \"quoted\"", fields: &fields };
        let text = serde_json::to_string(&line).expect("plain data");
        assert_eq!(
            text,
            r#"{"time":"t","level":"error","event":"fault","message":"two\nlines \"quoted\"","tick":12,"fault":"stale"}"#
        );
    }
}
