//! All output of the program: results on stdout, messages on stderr.
//!
//! `println!` panics when the reader is gone (`hapticd check … | head`) or the disk is full. While
//! an arm is being rendered a panic of the talking thread would leave the loop alone, so nothing
//! here panics: a lost message is lost, a lost result becomes the exit code.
//!
//! Messages are text for people, or with `--log-format json` one JSON object per line for programs:
//! `time` (UTC), `level`, `event`, `message` (the text without decoration), and the fields of that
//! event.
//!
//! While force may flow no thread waits for a reader: from [`detach`] to [`attach`] a thread of its
//! own writes, behind a queue that drops the oldest lines and says how many. A terminal that is
//! stopped, or a program that reads no more, costs words and nothing else.

use std::backtrace::{Backtrace, BacktraceStatus};
use std::fmt;
use std::io::{self, Write as _};
use std::panic::PanicHookInfo;
use std::path::Path;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::Thread;
use std::time::{Duration, Instant, SystemTime};

use clap::ValueEnum;
use crossbeam::queue::ArrayQueue;
use serde::ser::{Serialize, SerializeMap, Serializer};
use serde_json::Value;

use rt::utc::timestamp;
use vps::storage::printable::printable;

/// Why the first result that did not arrive did not.
static LOST_RESULT: OnceLock<io::Error> = OnceLock::new();

/// Messages are JSON. Set once, before anything is said.
static IS_JSON: AtomicBool = AtomicBool::new(false);

/// What messages look like.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(crate) enum LogFormat {
    /// Lines for people.
    #[default]
    Text,
    /// One JSON object per line.
    Json,
}

/// How much a message matters.
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

/// Decides what messages look like from here on. A panic, too, uses the chosen format, and waits
/// for no reader.
pub(crate) fn use_format(format: LogFormat) {
    IS_JSON.store(format == LogFormat::Json, Ordering::Relaxed);
    std::panic::set_hook(Box::new(panicked));
}

/// Reports a panic, before the stack of its thread is unwound and an arm gets its zero: it must not
/// block.
fn panicked(info: &PanicHookInfo<'_>) {
    let thread = std::thread::current();
    let mut text = format!("thread '{}' {info}", thread.name().unwrap_or("unnamed"));
    // A trace is looked up in the file of the program, which takes long: not while an arm waits for
    // its zero.
    let has_arm = matches!(thread.name(), Some("servo" | "device-node"));
    let trace = if has_arm { Backtrace::disabled() } else { Backtrace::capture() };
    if trace.status() == BacktraceStatus::Captured {
        text += &format!("\n{trace}");
    }
    event(Level::Error, "panic", &text, &[]);
}

/// Lines that may wait for the reader of stderr.
const QUEUED_LINES: usize = 1024;
/// How long [`attach`] waits for a reader.
const FLUSH: Duration = Duration::from_secs(1);

/// Lines on their way to stderr.
struct Queue {
    lines: ArrayQueue<String>,
    /// Lines that were dropped for newer ones and are not reported yet.
    lost: AtomicU64,
    /// Lines that were queued and neither written nor dropped.
    waiting: AtomicU64,
    writer: Thread,
}

static QUEUE: OnceLock<Queue> = OnceLock::new();
/// Messages go through the queue.
static IS_DETACHED: AtomicBool = AtomicBool::new(false);

/// From now on messages wait for no reader.
///
/// # Errors
/// The thread that writes cannot be started.
pub(crate) fn detach() -> io::Result<()> {
    if QUEUE.get().is_none() {
        let thread = std::thread::Builder::new()
            .name("output".to_owned())
            .spawn(|| write_queued(QUEUE.wait()))?;
        let lines = ArrayQueue::new(QUEUED_LINES);
        let queue = Queue {
            lines,
            lost: AtomicU64::new(0),
            waiting: AtomicU64::new(0),
            writer: thread.thread().clone(),
        };
        // Only this thread sets it.
        let _ = QUEUE.set(queue);
    }
    IS_DETACHED.store(true, Ordering::Relaxed);
    Ok(())
}

/// From now on each thread writes its own messages, behind what is still queued; a reader that
/// takes nothing for a second gets none of it.
pub(crate) fn attach() {
    let Some(queue) = QUEUE.get().filter(|_| IS_DETACHED.load(Ordering::Relaxed)) else { return };
    let begin = Instant::now();
    while queue.waiting.load(Ordering::Acquire) > 0 {
        if begin.elapsed() > FLUSH {
            return;
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    IS_DETACHED.store(false, Ordering::Relaxed);
}

impl Queue {
    /// Never blocks.
    fn push(&self, text: String) {
        self.waiting.fetch_add(1, Ordering::Relaxed);
        if self.lines.force_push(text).is_some() {
            self.lost.fetch_add(1, Ordering::Relaxed);
            self.waiting.fetch_sub(1, Ordering::Relaxed);
        }
        self.writer.unpark();
    }
}

fn write_queued(queue: &Queue) {
    loop {
        while let Some(text) = queue.lines.pop() {
            let lost = queue.lost.swap(0, Ordering::Relaxed);
            if lost > 0 {
                write_now(&line_of(
                    Level::Warning,
                    "lost-output",
                    &format!("{lost} lines were lost: stderr was not read"),
                    &[],
                ));
            }
            write_now(&text);
            queue.waiting.fetch_sub(1, Ordering::Release);
        }
        std::thread::park();
    }
}

/// A program reads the messages.
pub(crate) fn is_json() -> bool {
    IS_JSON.load(Ordering::Relaxed)
}

/// The name of a file as a shell takes it for one word, for commands that a message tells the user
/// to type.
pub(crate) fn quoted(file: &Path) -> String {
    let name = file.to_string_lossy();
    let is_plain = |c: char| c.is_alphanumeric() || "/._-+:@%,".contains(c);
    if name.chars().all(is_plain) {
        name.into_owned()
    } else {
        format!("'{}'", name.replace('\'', "'\\''"))
    }
}

/// Writes a result to stdout.
pub(crate) fn result(text: fmt::Arguments<'_>) {
    if let Err(error) = io::stdout().write_all(text.to_string().as_bytes()) {
        let _ = LOST_RESULT.set(error);
    }
}

/// Writes messages to stderr at once: text as it is, or its lines as events without fields.
pub(crate) fn message(text: fmt::Arguments<'_>) {
    if is_json() {
        text.to_string()
            .lines()
            .filter(|line| !line.trim().is_empty())
            .for_each(|line| event(Level::Info, "message", line, &[]));
    } else {
        write(text.to_string());
    }
}

/// Writes a line over the one that stands on the terminal, cut at its edge: a line that wraps could
/// not be written over.
pub(crate) fn overwrite(line: &str) {
    write(format!("\r\x1b[2K\x1b[?7l{}\x1b[?7h", printable(line)));
}

/// Writes one event to stderr: its text in a line, or an object with its fields.
pub(crate) fn event(level: Level, name: &str, text: &str, fields: Fields<'_>) {
    write(line_of(level, name, text, fields));
}

fn line_of(level: Level, name: &str, text: &str, fields: Fields<'_>) -> String {
    if !is_json() {
        return format!("{}\n", printable(text));
    }
    let line = Line { time: &timestamp(SystemTime::now()), level, name, text: text.trim(), fields };
    // True invariant: names and plain values.
    format!("{}\n", serde_json::to_string(&line).unwrap_or_default())
}

fn write(text: String) {
    match QUEUE.get().filter(|_| IS_DETACHED.load(Ordering::Relaxed)) {
        Some(queue) => queue.push(text),
        None => write_now(&text),
    }
}

fn write_now(text: &str) {
    // One write, so that lines of other processes do not cut in. If it fails, there is no other
    // output to report it on.
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

/// Why a result could not be delivered, once all is said. A reader that has seen enough is no
/// reason.
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
        let line = Line {
            time: "t",
            level: Level::Error,
            name: "fault",
            text: "two\nlines \"quoted\"",
            fields: &fields,
        };
        let text = serde_json::to_string(&line).expect("plain data");
        assert_eq!(
            text,
            r#"{"time":"t","level":"error","event":"fault","message":"two\nlines \"quoted\"","tick":12,"fault":"stale"}"#
        );
    }
}
