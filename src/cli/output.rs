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
//! Nothing but text leaves: what control characters a name, a file or an arm has brought along are
//! escaped here, in what is for people and in JSON. The few that a terminal is steered with are
//! constants of this file.
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
    let has_arm = matches!(thread.name(), Some("servo" | "device-node" | "probe"));
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
    lines: ArrayQueue<Shown>,
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
    fn push(&self, text: Shown) {
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

/// The word before a message, in its colour.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Lead {
    /// What it says.
    pub(crate) word: &'static str,
    /// Its colour on a terminal; empty: none.
    pub(crate) colour: &'static str,
}

/// Colours of leads.
pub(crate) const RED: &str = "\x1b[1;31m";
pub(crate) const YELLOW: &str = "\x1b[1;33m";
pub(crate) const CYAN: &str = "\x1b[1;36m";
const PLAIN: &str = "\x1b[0m";
/// Begins the line anew, and cuts what follows at the edge of the terminal: a line that wraps could
/// not be written over.
const OVER: &str = "\r\x1b[2K\x1b[?7l";
const WRAP_AGAIN: &str = "\x1b[?7h";

/// What may go to a terminal.
struct Shown(String);

impl Shown {
    /// Text, its control characters escaped but for line breaks and tabs.
    fn text(text: &str) -> Self {
        Self(printable(text).into_owned())
    }

    /// One message: where it has several lines, none but the first begins at the edge, so that no
    /// text from outside looks like a message of this program.
    fn message(text: &str) -> Self {
        Self(format!("{}\n", printable(text.trim_end()).replace('\n', "\n  ")))
    }

    /// Between constants of this file.
    fn between(before: &'static str, text: &str, after: &'static str) -> Self {
        Self([before, &printable(text), after].concat())
    }

    /// A message behind its lead.
    fn led(lead: Lead, text: &str) -> Self {
        let plain = if lead.colour.is_empty() { "" } else { PLAIN };
        let Self(text) = Self::message(text);
        Self([lead.colour, lead.word, plain, " ", &text].concat())
    }
}

/// Writes a result to stdout.
pub(crate) fn result(text: fmt::Arguments<'_>) {
    let Shown(text) = Shown::text(&text.to_string());
    if let Err(error) = io::stdout().write_all(text.as_bytes()) {
        let _ = LOST_RESULT.set(error);
    }
}

/// Writes a message behind its lead to stderr.
pub(crate) fn led(lead: Lead, text: &str) {
    write(Shown::led(lead, text));
}

/// Writes a line of a terminal over.
pub(crate) fn write_over(text: &str) {
    write(Shown::between(OVER, text, WRAP_AGAIN));
}

/// Writes messages to stderr at once: text as it is, or its lines as events without fields.
pub(crate) fn message(text: fmt::Arguments<'_>) {
    if is_json() {
        text.to_string()
            .lines()
            .filter(|line| !line.trim().is_empty())
            .for_each(|line| event(Level::Info, "message", line, &[]));
    } else {
        write(Shown::text(&text.to_string()));
    }
}

/// Writes one event to stderr: its text in a line, or an object with its fields.
pub(crate) fn event(level: Level, name: &str, text: &str, fields: Fields<'_>) {
    write(line_of(level, name, text, fields));
}

fn line_of(level: Level, name: &str, text: &str, fields: Fields<'_>) -> Shown {
    if !is_json() {
        return Shown::message(text);
    }
    let line = Line { time: &timestamp(SystemTime::now()), level, name, text: text.trim(), fields };
    line.shown()
}

fn write(shown: Shown) {
    match QUEUE.get().filter(|_| IS_DETACHED.load(Ordering::Relaxed)) {
        Some(queue) => queue.push(shown),
        None => write_now(&shown),
    }
}

fn write_now(Shown(text): &Shown) {
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

impl Line<'_> {
    fn shown(&self) -> Shown {
        // True invariant: names and plain values.
        Shown::message(&serde_json::to_string(self).unwrap_or_default())
    }
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

    /// Texts of characters that steer a terminal, end a line or turn the direction of writing,
    /// between others.
    fn foreign_texts() -> impl Iterator<Item = String> {
        let controls = (0..0x20).chain(0x7f..0xa0).chain([0x61c, 0x200e, 0x200f]);
        let controls = controls.chain(0x2028..0x202f).chain(0x2066..0x206a);
        let controls: Vec<char> = controls.filter_map(char::from_u32).collect();
        let others = ['a', '[', ']', '2', ';', 'm', 'K', 'é', '歯', '\\', '"', ' '];
        let mut seed = 1_u64;
        let mut next = move |n: usize| {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (seed >> 33) as usize % n
        };
        (0..2000).map(move |_| {
            let length = next(40);
            let mut letter = || match next(2) {
                0 => controls[next(controls.len())],
                _ => others[next(others.len())],
            };
            (0..length).map(|_| letter()).collect()
        })
    }

    #[test]
    fn no_character_that_steers_a_terminal_leaves_but_ours() {
        let steers = |text: &str| {
            let text = text.replace(['\n', '\t'], "");
            text.contains(vps::storage::printable::is_control)
        };
        let is_one_message = |text: &str| {
            let mut lines = text.strip_suffix('\n').expect("ended").split('\n');
            lines.next();
            lines.all(|line| line.starts_with("  "))
        };
        for foreign in foreign_texts() {
            let Shown(text) = Shown::text(&foreign);
            let Shown(message) = Shown::message(&foreign);
            let Shown(led) = Shown::led(Lead { word: "error:", colour: RED }, &foreign);
            let led = led.strip_prefix("\x1b[1;31merror:\x1b[0m ").expect("its lead");
            let Shown(over) = Shown::between(OVER, &foreign, WRAP_AGAIN);
            let over = over.strip_prefix(OVER).and_then(|text| text.strip_suffix(WRAP_AGAIN));
            for text in [&text, &message, led, over.expect("ours")] {
                assert!(!steers(text), "{text:?}");
            }
            assert!(is_one_message(&message) && is_one_message(led), "{message:?}");
            let fields = [("said", Value::from(foreign.as_str()))];
            let line =
                Line { time: "t", level: Level::Info, name: "n", text: &foreign, fields: &fields };
            let Shown(json) = line.shown();
            assert!(!steers(&json) && json.lines().count() == 1, "{json:?}");
            let read: Value = serde_json::from_str(&json).expect("JSON");
            assert_eq!(
                (read["message"].as_str(), read["said"].as_str()),
                (Some(&*foreign), Some(&*foreign))
            );
        }
    }

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
