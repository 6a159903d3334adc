//! A TOML file that remembers where everything stands: syntax, version, and reading into a schema
//! with every problem at once.

use std::ops::Range;
use std::path::Path;

use serde::de::DeserializeOwned;
use toml::Spanned;
use toml::de::{DeTable, DeValue, ValueDeserializer};

use super::problem::{ConfigErrors, Problem, ProblemKind, nearest};
use vps::storage::printable::is_control;

/// The format version that scenes and profiles carry.
const VERSION: i64 = 1;

/// Problems that are reported of one file: more do not help, and finding them takes as long as
/// there are.
pub(super) const PROBLEMS_MAX: usize = 100;

/// Longest value that a message repeats, characters.
const VALUE_CHARS_MAX: usize = 60;

type Value<'t> = Spanned<DeValue<'t>>;

/// A key that files of an earlier version may have.
pub struct GoneKey {
    /// Dotted path.
    pub key: &'static str,
    /// The value that holds now, as TOML writes it: a file that says so is right.
    pub now: &'static str,
    /// What to do about another one.
    pub instead: &'static str,
}

/// A parsed file; borrows its text.
pub struct Document<'t> {
    file: &'t Path,
    text: &'t str,
    /// A table.
    root: Value<'t>,
}

/// One step into a document.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Step {
    Key(String),
    Index(usize),
}

/// Where an entry stands.
struct Place {
    steps: Vec<Step>,
    /// The key, or the element of an array.
    span: Range<usize>,
    /// The value; `None` for a table, whose text says too much.
    value: Option<Range<usize>>,
}

impl<'t> Document<'t> {
    /// Parses the text and checks its version, which is read before anything else: a file of
    /// another version is not judged by our keys.
    ///
    /// # Errors
    /// Text that is no TOML, with its line.
    pub fn parse(file: &'t Path, text: &'t str) -> Result<Self, ConfigErrors> {
        let root = DeTable::parse(text).map_err(|error| {
            let line = error.span().map(|span| line_of(text, span.start));
            let message = error.message().to_owned();
            let is_decimal_comma =
                error.span().is_some_and(|span| is_between_digits(text, span.start, b','));
            let hint = is_decimal_comma.then_some("a decimal point, not a comma");
            ConfigErrors::new(vec![Problem {
                line,
                ..Problem::of_file(file, ProblemKind::Syntax { message, hint })
            }])
        })?;
        let root = Spanned::new(root.span(), DeValue::Table(root.into_inner()));
        let document = Self { file, text, root };
        let problem = match document.find("version").1.map(Spanned::get_ref) {
            Some(DeValue::Integer(number)) if number.as_str() == "1" => {
                let problems = document.control_characters();
                return if problems.is_empty() {
                    Ok(document)
                } else {
                    Err(ConfigErrors::new(problems))
                };
            }
            Some(_) => {
                document.problem("version", ProblemKind::VersionUnknown { supported: VERSION })
            }
            None => document.problem("version", ProblemKind::VersionMissing { supported: VERSION }),
        };
        Err(ConfigErrors::new(vec![problem]))
    }

    /// Keys and strings that would say something to a terminal when they are shown. Bytes of
    /// packets are never shown as they are.
    fn control_characters(&self) -> Vec<Problem> {
        let mut problems = Vec::new();
        walk(&self.root, &mut Vec::new(), &mut |steps, at, value| {
            if problems.len() >= PROBLEMS_MAX || steps[0] == Step::Key("packet".to_owned()) {
                return;
            }
            let in_key = matches!(steps.last(), Some(Step::Key(key)) if key.contains(is_control));
            let in_value =
                matches!(value.get_ref(), DeValue::String(text) if text.contains(is_control));
            if in_key || in_value {
                let accepted =
                    "without control characters, such as an escape or a line break: names are \
                        shown to people"
                        .to_owned();
                problems.push(Problem {
                    file: self.file.to_path_buf(),
                    line: Some(line_of(self.text, at.start)),
                    key: Some(path_of(steps)),
                    value: in_value.then(|| self.text_at(value.span())),
                    kind: ProblemKind::NotAccepted { accepted },
                });
            }
        });
        problems
    }

    /// Takes keys out that are no longer read; gives those that ask for something else than what
    /// holds now.
    pub fn take_gone(&mut self, gone: &[GoneKey]) -> Vec<Problem> {
        let mut problems = Vec::new();
        for GoneKey { key, now, instead } in gone {
            let Some(value) = self.find(key).1 else { continue };
            let written = self.text_at(value.span());
            let number = |text: &str| text.parse::<f64>().ok();
            let is_same =
                written == *now || number(&written).is_some() && number(&written) == number(now);
            if !is_same {
                problems.push(self.problem(key, ProblemKind::Gone { instead }));
            }
            remove(&mut self.root, &steps_of(key));
        }
        problems
    }

    /// Reads the whole document into `T`, whose types refuse unknown keys.
    ///
    /// # Errors
    /// Every entry that cannot be read.
    pub fn read<T: DeserializeOwned>(&self) -> Result<T, ConfigErrors> {
        match self.read_around() {
            (Some(value), problems) if problems.is_empty() => Ok(value),
            (_, problems) => Err(ConfigErrors::new(problems)),
        }
    }

    /// What the document says around the entries that cannot be read, and what is wrong with those.
    ///
    /// serde stops at the first problem. To report all of them, the offending entry is taken out of
    /// a copy and the rest read again.
    pub fn read_around<T: DeserializeOwned>(&self) -> (Option<T>, Vec<Problem>) {
        let mut rest = self.root.clone();
        let mut problems = Vec::new();
        loop {
            let error = match T::deserialize(ValueDeserializer::from(rest.clone())) {
                Ok(value) => return (Some(value), problems),
                Err(error) => error,
            };
            let place = error.span().and_then(|span| self.smallest_around(&rest, span));
            let Some(place) = place else {
                let kind = kind_of(error.message(), "");
                problems.push(Problem::of_file(self.file, kind));
                return (None, problems);
            };
            // A field of a struct that gets a whole table, or more elements than the struct has
            // fields.
            let is_table = ["invalid type: map", "invalid value", "invalid length"]
                .iter()
                .any(|start| error.message().starts_with(start));
            if let Some(place) = self.repeated_table(&rest, &place).filter(|_| is_table) {
                let table = path_of(&place.steps);
                let kind = ProblemKind::Repeated { table: table.clone() };
                problems.push(Problem {
                    line: Some(line_of(self.text, place.span.start)),
                    key: Some(table),
                    ..Problem::of_file(self.file, kind)
                });
                if problems.len() >= PROBLEMS_MAX || remove(&mut rest, &place.steps).is_none() {
                    return (None, problems);
                }
                continue;
            }
            let last_key = place.steps.iter().rev().find_map(|step| match step {
                Step::Key(key) => Some(key.as_str()),
                Step::Index(_) => None,
            });
            let value = place.value.clone().map(|range| self.text_at(range));
            let word = value.as_deref().unwrap_or_default().trim_matches(['"', '\'']);
            let is_unknown_key = error.message().starts_with("unknown field");
            let kind = kind_of(
                error.message(),
                if is_unknown_key { last_key.unwrap_or_default() } else { word },
            );
            problems.push(Problem {
                file: self.file.to_path_buf(),
                line: Some(line_of(self.text, place.span.start)),
                key: Some(path_of(&place.steps)),
                value,
                kind,
            });
            if problems.len() >= PROBLEMS_MAX || remove(&mut rest, &place.steps).is_none() {
                return (None, problems);
            }
        }
    }

    /// The table that is written as `[[table]]` where one table is read: serde takes its first
    /// element for the table's first key.
    fn repeated_table(&self, rest: &Value<'_>, place: &Place) -> Option<Place> {
        let depth =
            place.steps.len() - usize::from(matches!(place.steps.last(), Some(Step::Index(_))));
        let steps = &place.steps[..depth];
        let array = steps.iter().try_fold(rest, |value, step| match (step, value.get_ref()) {
            (Step::Key(key), DeValue::Table(table)) => table.get(key.as_str()),
            (Step::Index(index), DeValue::Array(array)) => array.get(*index),
            _ => None,
        })?;
        let first = array.get_ref().as_array()?.first()?;
        let is_header =
            matches!(first.get_ref(), DeValue::Table(_)) && !is_inline(self.text, first);
        is_header.then(|| Place { steps: steps.to_vec(), span: first.span(), value: None })
    }

    /// A problem at a dotted key path; where nothing is written there, at the innermost table that
    /// is.
    pub fn problem(&self, path: &str, kind: ProblemKind) -> Problem {
        let (span, value) = self.locate(path);
        Problem {
            file: self.file.to_path_buf(),
            line: span.map(|span| line_of(self.text, span.start)),
            key: Some(path.to_owned()),
            value: value.map(|range| self.text_at(range)),
            kind,
        }
    }

    /// The line of a dotted key path.
    pub fn line(&self, path: &str) -> Option<usize> {
        self.locate(path).0.map(|span| line_of(self.text, span.start))
    }

    /// It has this key at its top.
    pub fn has(&self, key: &str) -> bool {
        self.find(key).1.is_some()
    }

    /// What is written at a dotted key path, on one line, cut when long.
    pub fn written(&self, path: &str) -> Option<String> {
        self.locate(path).1.map(|range| self.text_at(range))
    }

    /// The string at a dotted key path, read without any schema.
    pub fn string(&self, path: &str) -> Option<&str> {
        match self.find(path).1?.get_ref() {
            DeValue::String(text) => Some(text.as_ref()),
            _ => None,
        }
    }

    /// Where the innermost entry on the path stands that exists, and the value at its end.
    fn find(&self, path: &str) -> (Option<Range<usize>>, Option<&Value<'t>>) {
        let mut at = None;
        let mut value = &self.root;
        for step in steps_of(path) {
            let child = match (&step, value.get_ref()) {
                (Step::Key(key), DeValue::Table(table)) => {
                    table.get_key_value(key.as_str()).map(|(key, value)| (key.span(), value))
                }
                (Step::Index(index), DeValue::Array(array)) => {
                    array.get(*index).map(|element| (element.span(), element))
                }
                _ => None,
            };
            let Some((span, child)) = child else { return (at, None) };
            (at, value) = (Some(span), child);
        }
        (at, Some(value))
    }

    /// The spans of what [`find`](Self::find) finds; of a value only when it can be shown.
    fn locate(&self, path: &str) -> (Option<Range<usize>>, Option<Range<usize>>) {
        let (at, value) = self.find(path);
        (at, value.filter(|value| is_inline(self.text, value)).map(Spanned::span))
    }

    /// The entry with the smallest span around `span`; the innermost of equals.
    fn smallest_around(&self, root: &Value<'_>, span: Range<usize>) -> Option<Place> {
        let mut best: Option<(usize, Place)> = None;
        walk(root, &mut Vec::new(), &mut |steps, at, value| {
            for outer in [at.clone(), value.span()] {
                let encloses = outer.start <= span.start && span.end <= outer.end;
                if encloses && best.as_ref().is_none_or(|(shortest, _)| outer.len() <= *shortest) {
                    let value = is_inline(self.text, value).then(|| value.span());
                    best = Some((
                        outer.len(),
                        Place { steps: steps.to_vec(), span: at.clone(), value },
                    ));
                }
            }
        });
        best.map(|(_, place)| place)
    }

    /// Source text on one line, cut when long.
    fn text_at(&self, range: Range<usize>) -> String {
        let text = self
            .text
            .get(range)
            .unwrap_or_default()
            .split_whitespace()
            .collect::<Vec<_>>()
            .join(" ");
        if text.chars().count() <= VALUE_CHARS_MAX {
            return text;
        }
        text.chars().take(VALUE_CHARS_MAX).chain(['…']).collect()
    }
}

/// Shows `see` every entry below a value, the outer ones first: the way to it, where its key or
/// element stands, and its value.
fn walk<'t>(
    value: &Value<'t>,
    steps: &mut Vec<Step>,
    see: &mut impl FnMut(&[Step], &Range<usize>, &Value<'t>),
) {
    let mut enter = |step, at: Range<usize>, value: &Value<'t>| {
        steps.push(step);
        see(steps, &at, value);
        walk(value, steps, see);
        steps.pop();
    };
    match value.get_ref() {
        DeValue::Table(table) => {
            table.iter().for_each(|(key, value)| {
                enter(Step::Key(key.get_ref().to_string()), key.span(), value)
            });
        }
        DeValue::Array(array) => {
            array
                .iter()
                .enumerate()
                .for_each(|(index, element)| enter(Step::Index(index), element.span(), element));
        }
        _ => {}
    }
}

/// True for a value that is written in place. A table under a `[header]` is not: its text would say
/// too much or too little.
fn is_inline(text: &str, value: &Spanned<DeValue<'_>>) -> bool {
    match value.get_ref() {
        DeValue::Table(_) => text.get(value.span()).is_some_and(|written| written.starts_with('{')),
        DeValue::Array(array) => array.iter().all(|element| is_inline(text, element)),
        _ => true,
    }
}

/// Takes the entry out; for an element of an array of numbers, the whole array. `None` when nothing
/// was there.
fn remove(root: &mut Value<'_>, steps: &[Step]) -> Option<()> {
    let last = steps.iter().rposition(|step| matches!(step, Step::Key(_)))?;
    let mut value = root.get_mut();
    for step in &steps[..last] {
        value = match (step, value) {
            (Step::Key(key), DeValue::Table(table)) => table.get_mut(key.as_str())?.get_mut(),
            (Step::Index(index), DeValue::Array(array)) => array.get_mut(*index)?.get_mut(),
            _ => return None,
        };
    }
    match (&steps[last], value) {
        (Step::Key(key), DeValue::Table(table)) => table.remove(key.as_str()).map(|_| ()),
        _ => None,
    }
}

/// Turns serde's sentence into one of our kinds. `word` is the key or value that it complains
/// about.
fn kind_of(message: &str, word: &str) -> ProblemKind {
    let listed = |start: &str| {
        let (_, expected) = message.strip_prefix(start)?.split_once(", expected ")?;
        let known = in_backticks(expected);
        Some((nearest(word, known.iter().map(String::as_str)), known))
    };
    if let Some((nearest, known)) = listed("unknown field ") {
        return ProblemKind::UnknownKey { nearest, known };
    }
    if let Some((nearest, known)) = listed("unknown variant ") {
        return ProblemKind::UnknownWord { nearest, known };
    }
    if let Some((_, expected)) =
        message.strip_prefix("invalid ").and_then(|rest| rest.rsplit_once(", expected "))
    {
        return ProblemKind::WrongType { expected: in_our_words(expected).to_owned() };
    }
    ProblemKind::Syntax { message: message.to_owned(), hint: None }
}

/// Whether the byte at that place is this one, with a digit before and behind it.
fn is_between_digits(text: &str, at: usize, byte: u8) -> bool {
    let around = at.checked_sub(1).and_then(|before| text.as_bytes().get(before..before + 3));
    matches!(around, Some([before, here, behind]) if before.is_ascii_digit() && *here == byte && behind.is_ascii_digit())
}

fn in_backticks(text: &str) -> Vec<String> {
    text.split('`').skip(1).step_by(2).map(str::to_owned).collect()
}

/// serde names Rust types; the reader of a scene knows none of them.
fn in_our_words(expected: &str) -> &str {
    match expected {
        "f64" => "a number",
        "u32" | "u64" => "a whole number, 0 or more",
        "a boolean" => "true or false",
        "a string" => "a string in quotes",
        "a sequence" => "an array",
        other => other,
    }
}

/// Splits `static[0].voxel_size_mm`; our own key paths only, so nothing is quoted.
fn steps_of(path: &str) -> Vec<Step> {
    let mut steps = Vec::new();
    for part in path.split('.') {
        let mut pieces = part.split('[');
        steps.extend(pieces.next().map(|key| Step::Key(key.to_owned())));
        steps.extend(
            pieces.filter_map(|index| index.trim_end_matches(']').parse().ok().map(Step::Index)),
        );
    }
    steps
}

fn path_of(steps: &[Step]) -> String {
    let mut path = String::new();
    for step in steps {
        match step {
            Step::Key(key) => {
                if !path.is_empty() {
                    path.push('.');
                }
                path.push_str(key);
            }
            Step::Index(index) => path.push_str(&format!("[{index}]")),
        }
    }
    path
}

/// Line of a byte offset, from 1.
fn line_of(text: &str, offset: usize) -> usize {
    1 + text.bytes().take(offset).filter(|byte| *byte == b'\n').count()
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "version = 1\n\n[[static]]\nname = \"a\"\nposition_mm = \
        [\n  1,\n  2,\n]\n[[static]]\nname = \"b\"\n[tool]\nshape = { sphere_mm = 3 }\n";

    #[test]
    fn a_key_path_knows_its_line_and_value() {
        let document = Document::parse(Path::new("x.toml"), TEXT).unwrap();
        let kind = || ProblemKind::IsMesh;
        let at = |path: &str| {
            let problem = document.problem(path, kind());
            (problem.line, problem.value)
        };
        assert_eq!(at("static[1].name"), (Some(10), Some("\"b\"".into())));
        assert_eq!(at("static[0].position_mm"), (Some(5), Some("[ 1, 2, ]".into())));
        assert_eq!(at("static[0].position_mm[1]"), (Some(7), Some("2".into())));
        assert_eq!(at("static[1].mesh"), (Some(9), None));
        assert_eq!(at("static[1]"), (Some(9), None));
        assert_eq!(at("static").1, None);
        assert_eq!(at("tool"), (Some(11), None));
        assert_eq!(at("tool.shape"), (Some(12), Some("{ sphere_mm = 3 }".into())));
        assert_eq!(at("rendering.rate_hz"), (None, None));
    }

    /// serde takes the table for the value of its only key, and says what is wrong with that.
    #[test]
    fn one_table_that_is_written_as_many_is_named_and_not_its_only_key() {
        #[derive(Debug, serde::Deserialize)]
        #[serde(untagged, expecting = "invalid value, expected a number or a word")]
        #[expect(dead_code, reason = "only whether it can be read is asked")]
        enum Cutoff {
            Number(f64),
            Word(String),
        }
        #[derive(Debug, serde::Deserialize)]
        #[expect(dead_code, reason = "as above")]
        struct Filter {
            cutoff: Cutoff,
        }
        #[derive(Debug, serde::Deserialize)]
        #[expect(dead_code, reason = "as above")]
        struct Scene {
            filter: Filter,
        }
        for (text, expected) in [
            (
                "version = 1\n[[filter]]\ncutoff = 3.0\n",
                "filter: is one table: write [filter], once, in place of [[filter]]",
            ),
            ("version = 1\n[filter]\ncutoff = true\n", "filter.cutoff = true: "),
        ] {
            let document = Document::parse(Path::new("x.toml"), text).unwrap();
            let (_, problems) = document.read_around::<Scene>();
            let said = problems[0].to_string();
            assert!(said.contains(expected), "{said}");
        }
    }

    #[test]
    fn names_that_speak_to_a_terminal_are_refused_and_shown_escaped() {
        let text = concat!(
            "version = 1\nname = \"gear\\u001b[2J\"\n\"a\\u0007\" = 2\n[[static]]\nmesh = \
                \"\"\"\na\nstate: disabled\"\"\"\n",
            "[packet.report]\nclose = \"\\r\\n\"\n[device]\nprofile = \"plain\"\n"
        );
        let errors = Document::parse(Path::new("x\u{1b}.toml"), text).err().unwrap().to_string();
        let accepted = "must be without control characters, such as an escape or a line break: \
            names are shown to people";
        let expected = format!(
            "error: x\\u001b.toml:2: name = \"gear\\u001b[2J\": {accepted}\nerror: \
                x\\u001b.toml:3: a\\u0007: {accepted}\nerror: x\\u001b.toml:5: static[0].mesh \
                = \"\"\" a state: disabled\"\"\": {accepted}"
        );
        assert_eq!(errors, expected);
    }

    #[test]
    fn problems_come_to_an_end() {
        #[derive(serde::Deserialize)]
        #[serde(deny_unknown_fields)]
        struct Nothing {
            #[serde(rename = "version")]
            _version: i64,
        }
        let text =
            (0..1000).fold("version = 1\n".to_owned(), |text, n| format!("{text}key_{n} = 1\n"));
        let document = Document::parse(Path::new("x.toml"), &text).unwrap();
        let (read, problems) = document.read_around::<Nothing>();
        assert!(read.is_none() && problems.len() == PROBLEMS_MAX, "{}", problems.len());
    }

    #[test]
    fn entries_are_taken_out_one_by_one() {
        let mut root = Document::parse(Path::new("x.toml"), TEXT).unwrap().root;
        let mut takes = |path: &str| remove(&mut root, &steps_of(path)).is_some();
        assert!(takes("static[0].position_mm[1]"));
        assert!(!takes("static[0].position_mm"));
        assert!(takes("tool.shape.sphere_mm"));
        assert!(takes("static"));
        assert!(!takes("static[0].name"));
    }
}
