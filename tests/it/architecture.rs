//! The import rules of the house, read from the source: [`MAY_USE`], which `ARCHITECTURE.md` lists with the reasons.
//!
//! `unsafe` stands in `rt`, in the serial transport, in the two SIMD kernels, where mesh files are mapped and in the storage of arrays only;
//! only `cli` prints; files that others name are opened by `storage::regular`. Tests are exempt.

use std::path::{Path, PathBuf};

/// What each room may use beside itself: whole rooms, or single modules of one. A room that is not listed may use everything but the
/// [`LAST`] ones.
const MAY_USE: [(&str, &[&str]); 18] = [
    ("error", &[]),
    ("spatial", &[]),
    ("rt", &[]),
    ("storage", &[]),
    ("network", &[]),
    ("document", &["spatial", "storage::regular", "storage::printable"]),
    ("mesh", &["spatial", "storage"]),
    ("voxmap", &["mesh", "spatial", "storage"]),
    ("pointshell", &["mesh", "voxmap", "spatial", "storage"]),
    ("haptics", &["spatial", "voxmap::field", "pointshell::shell", "pointshell::tree"]),
    ("sculpt", &["mesh", "spatial", "storage", "haptics::clay"]),
    ("device", &["document", "network", "spatial", "storage::regular", "rt"]),
    ("config", &["document", "device", "haptics", "mesh", "sculpt", "spatial", "storage::regular", "voxmap"]),
    ("scene", &["config", "haptics", "mesh", "pointshell", "sculpt", "spatial", "storage", "voxmap"]),
    ("telemetry", &["haptics", "rt", "spatial", "storage::regular"]),
    ("ros", &["haptics", "spatial", "telemetry"]),
    ("servo", &["device", "haptics", "rt", "spatial", "telemetry"]),
    ("picture", &["mesh", "pointshell", "spatial", "storage", "voxmap", "sculpt::PointSet", "sculpt::Neighbours"]),
];
/// Rooms that only `cli` uses.
const LAST: [&str; 2] = ["cli", "picture"];
/// Prefixes of the files that may hold `unsafe`.
const UNSAFE_ALLOWED: [&str; 6] =
    ["rt/", "device/transport/serial", "haptics/contact/simd", "voxmap/distance/simd", "mesh/source", "storage/slab"];

/// Prefixes of the files that may open files by themselves: those of the system, and those that the program wrote.
const OPENS_ALLOWED: [&str; 9] = [
    "storage/",
    "rt/",
    "cli/bake/figures",
    "cli/publish",
    "daemon/unpacked",
    "device/attached/discover",
    "device/guard",
    "scene/cache/folder",
    "telemetry/recording/write",
];

/// Why a file of `room` must not use `path` (from the crate root on); `None` when it may.
fn refusal(room: &str, path: &[String]) -> Option<String> {
    let first = path.first().map_or("", String::as_str);
    if first == room || matches!(room, "lib" | "main") {
        return None;
    }
    if first == "cli" || LAST.contains(&first) && room != "cli" {
        return Some(if first == "cli" { "nobody uses `cli`" } else { "nobody but `cli` uses `picture`" }.to_owned());
    }
    if matches!(room, "monitor" | "publish") && first == "servo" {
        return Some("`monitor` and `publish` never call into `servo`".to_owned());
    }
    let (_, may) = MAY_USE.iter().find(|(name, _)| *name == room)?;
    let is_in = |allowed: &&str| {
        allowed.split("::").zip(path).all(|(part, word)| part == word) && allowed.split("::").count() <= path.len()
    };
    (!may.iter().any(is_in)).then(|| format!("`{room}` may use only: {}", may.join(", ")))
}

/// The same text with comments and the insides of literals blanked out; lines stay where they are.
fn without_comments_and_literals(text: &str) -> Vec<char> {
    let chars: Vec<char> = text.chars().collect();
    let at = |i: usize| chars.get(i).copied().unwrap_or('\0');
    let mut code = chars.clone();
    let mut blank = |from: usize, to: usize| {
        for c in code.iter_mut().take(to).skip(from).filter(|c| **c != '\n') {
            *c = ' ';
        }
    };
    let mut i = 0;
    while i < chars.len() {
        let from = i;
        let starts_word = i == 0 || !is_word(at(i - 1));
        let hashes = (i + 1..).take_while(|&k| at(k) == '#').count();
        match (at(i), at(i + 1)) {
            ('/', '/') => {
                while i < chars.len() && at(i) != '\n' {
                    i += 1;
                }
            }
            ('/', '*') => {
                let mut depth = 0;
                while i < chars.len() {
                    match (at(i), at(i + 1)) {
                        ('/', '*') => (depth, i) = (depth + 1, i + 2),
                        ('*', '/') => (depth, i) = (depth - 1, i + 2),
                        _ => i += 1,
                    }
                    if depth == 0 {
                        break;
                    }
                }
            }
            ('r', '"' | '#') if starts_word && at(i + 1 + hashes) == '"' => {
                i += 2 + hashes;
                while i < chars.len() && !(at(i) == '"' && (1..=hashes).all(|k| at(i + k) == '#')) {
                    i += 1;
                }
                i += 1 + hashes;
            }
            ('"', _) => {
                i += 1;
                while i < chars.len() && at(i) != '"' {
                    i += if at(i) == '\\' { 2 } else { 1 };
                }
                i += 1;
            }
            // A lifetime has no closing quote; `'{'` has.
            ('\'', '\\') => {
                i += 3;
                while i < chars.len() && at(i) != '\'' {
                    i += 1;
                }
                i += 1;
            }
            ('\'', _) if at(i + 2) == '\'' => i += 3,
            _ => {
                i += 1;
                continue;
            }
        }
        blank(from, i);
    }
    code
}

fn is_word(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

/// Where `word` stands alone in the code.
fn places(code: &[char], word: &str) -> Vec<usize> {
    let word: Vec<char> = word.chars().collect();
    let edge = |i: Option<usize>| i.and_then(|i| code.get(i)).is_none_or(|c| !is_word(*c));
    (0..code.len().saturating_sub(word.len() - 1))
        .filter(|&i| code[i..].starts_with(&word) && edge(i.checked_sub(1)) && edge(Some(i + word.len())))
        .collect()
}

/// Index just behind the bracket that closes the one at `open`.
fn behind_bracket(code: &[char], open: usize) -> usize {
    let mut depth = 0;
    for (i, c) in code.iter().enumerate().skip(open) {
        match c {
            '{' | '[' | '(' => depth += 1,
            '}' | ']' | ')' => depth -= 1,
            _ => {}
        }
        if depth == 0 {
            return i + 1;
        }
    }
    code.len()
}

/// Blanks out every item under `#[cfg(test)]`; gives the names of modules that are files of their own.
fn blank_tests(code: &mut [char]) -> Vec<String> {
    let attribute: Vec<char> = "#[cfg(test)]".chars().collect();
    let mut modules = Vec::new();
    while let Some(from) = (0..code.len()).find(|&i| code[i..].starts_with(&attribute)) {
        let mut i = from;
        // This attribute and those that follow.
        while code.get(i) == Some(&'#') {
            i = behind_bracket(code, i + 1);
            i += code[i..].iter().take_while(|c| c.is_whitespace()).count();
        }
        let end = (i..code.len()).find(|&k| matches!(code[k], '{' | ';')).unwrap_or(code.len());
        let head: String = code[i..end].iter().collect();
        let to = if code.get(end) == Some(&'{') { behind_bracket(code, end) } else { end + 1 };
        if code.get(end) == Some(&';')
            && let Some((_, name)) = head.split_once("mod ")
        {
            modules.push(name.trim().to_owned());
        }
        let to = to.min(code.len());
        code[from..to].iter_mut().filter(|c| **c != '\n').for_each(|c| *c = ' ');
    }
    modules
}

/// Every path of a use tree that goes on at `i`, appended to `prefix`. Works as well on a plain path in code.
fn tree(code: &[char], mut i: usize, prefix: &[String], paths: &mut Vec<Vec<String>>) -> usize {
    let skip = |i: usize| i + code[i..].iter().take_while(|c| c.is_whitespace()).count();
    let mut path = prefix.to_vec();
    loop {
        i = skip(i);
        if code.get(i) == Some(&'{') {
            let close = behind_bracket(code, i);
            i = skip(i + 1);
            while i + 1 < close {
                i = tree(code, i, &path, paths);
                // Behind a name or a rename, up to the next branch.
                while i + 1 < close && code[i] != ',' {
                    i += 1;
                }
                i = skip((i + 1).min(close - 1));
            }
            return close;
        }
        let word: String = code[i..].iter().take_while(|c| is_word(**c)).collect();
        i += word.chars().count();
        if !word.is_empty() {
            path.push(word);
        }
        let next = skip(i);
        if code[next..].starts_with(&[':', ':']) && !path.is_empty() {
            i = next + 2;
        } else {
            paths.push(path);
            return i;
        }
    }
}

/// Every path to another room, from the crate root on, with the place where it is written.
fn imports(code: &[char], module: &[String]) -> Vec<(usize, Vec<String>)> {
    let mut found = Vec::new();
    let mut take = |from: usize, rest: usize, base: &[String]| {
        let mut paths = Vec::new();
        tree(code, rest, base, &mut paths);
        found.extend(paths.into_iter().map(|path| (from, path)));
    };
    for i in places(code, "crate") {
        if code[i + 5..].starts_with(&[':', ':']) {
            take(i, i + 7, &[]);
        }
    }
    for i in places(code, "super") {
        let chained = i >= 2 && code[i - 2..i] == [':', ':'];
        let (mut rest, mut up) = (i, 0);
        while code[rest..].starts_with(&['s', 'u', 'p', 'e', 'r', ':', ':']) {
            (rest, up) = (rest + 7, up + 1);
        }
        if !chained && up > 0 {
            take(i, rest, &module[..module.len().saturating_sub(up)]);
        }
    }
    found
}

/// Every rule that one file breaks. `file` is relative to `src`, with `/`.
fn violations(file: &str, text: &str) -> (Vec<String>, Vec<String>) {
    let mut code = without_comments_and_literals(text);
    let test_modules = blank_tests(&mut code);
    let line = |i: usize| 1 + code[..i].iter().filter(|c| **c == '\n').count();
    let module: Vec<String> =
        file.trim_end_matches(".rs").split('/').filter(|part| !matches!(*part, "mod" | "lib")).map(str::to_owned).collect();
    let room = module.first().map_or("lib", String::as_str);
    let mut broken = Vec::new();
    for (i, path) in imports(&code, &module) {
        if let Some(why) = refusal(room, &path) {
            broken.push(format!("src/{file}:{}: crate::{}: {why}", line(i), path.join("::")));
        }
    }
    if !UNSAFE_ALLOWED.iter().any(|allowed| file.starts_with(allowed)) {
        for i in places(&code, "unsafe") {
            broken
                .push(format!("src/{file}:{}: `unsafe` outside `rt`, the transports, the SIMD kernel and `storage/slab`", line(i)));
        }
    }
    if !OPENS_ALLOWED.iter().any(|allowed| file.starts_with(allowed)) {
        for (owner, name) in [("fs", "read"), ("fs", "read_to_string"), ("File", "open")] {
            for i in places(&code, owner) {
                let word: Vec<char> = format!("{owner}::{name}(").chars().collect();
                if code[i..].starts_with(&word) {
                    broken
                        .push(format!("src/{file}:{}: `{owner}::{name}`: a foreign name is opened by `storage::regular`", line(i)));
                }
            }
        }
    }
    if room != "cli" {
        for name in ["print", "println", "eprint", "eprintln", "dbg"] {
            for i in places(&code, name).into_iter().filter(|i| code.get(i + name.len()) == Some(&'!')) {
                broken.push(format!("src/{file}:{}: `{name}!`: only `cli` prints", line(i)));
            }
        }
    }
    (broken, test_modules)
}

fn source_files(folder: &Path, files: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).expect("src") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            source_files(&path, files);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            files.push(path);
        }
    }
}

#[test]
fn rooms_use_only_what_they_may() {
    let src = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut files = Vec::new();
    source_files(&src, &mut files);
    files.sort();
    assert!(files.len() > 50, "{} files", files.len());
    let (mut broken, mut of_tests) = (Vec::new(), Vec::new());
    for path in &files {
        let file = path.strip_prefix(&src).expect("in src").to_string_lossy().replace('\\', "/");
        let (found, test_modules) = violations(&file, &std::fs::read_to_string(path).expect("text"));
        // `a/mod.rs` keeps its modules in `a`, `a/b.rs` in `a/b`.
        let stem = file.trim_end_matches(".rs");
        let folder = stem.strip_suffix("/mod").unwrap_or(stem).to_owned();
        of_tests.extend(test_modules.into_iter().map(|name| format!("src/{folder}/{name}.rs:")));
        broken.extend(found);
    }
    // A module that only tests have, in a file of its own.
    broken.retain(|line| !of_tests.iter().any(|file| line.starts_with(file)));
    assert!(broken.is_empty(), "\n{}", broken.join("\n"));
}

#[test]
fn planted_violations_are_caught() {
    for (file, text, expected) in [
        (
            "haptics/tick.rs",
            "use crate::spatial::Pose;\nuse crate::voxmap::{field::Field, grid::Grid};",
            Some("tick.rs:2: crate::voxmap::grid::Grid"),
        ),
        ("haptics/mod.rs", "use crate::{spatial::{Pose, Twist}, servo};", Some("crate::servo")),
        ("haptics/contact/flat.rs", "fn f() { super::super::super::mesh::load(); }", Some("crate::mesh::load")),
        ("haptics/tick.rs", "use crate::pointshell::{self, shell};", Some("crate::pointshell::self")),
        ("haptics/tick.rs", "use crate::voxmap::*;", Some("crate::voxmap")),
        ("haptics/tick.rs", "use crate::pointshell::{shell::{Lanes, Shell}, tree as hierarchy};\nuse super::Faults;", None),
        ("device/sim.rs", "let x = crate::haptics::Faults::NONE;", Some("`device` may use only")),
        ("device/profile/mod.rs", "use crate::config::SceneConfig;", Some("`device` may use only")),
        ("document/checks.rs", "use crate::spatial::Pose;\nuse crate::mesh::Format;", Some("checks.rs:2: crate::mesh::Format")),
        ("telemetry/drain.rs", "use crate::servo::Order;", Some("`telemetry` may use only")),
        ("monitor/hub.rs", "use crate::servo::Order;", Some("never call into `servo`")),
        ("voxmap/grid.rs", "use crate::config::SceneConfig;", Some("`voxmap` may use only")),
        ("spatial/pose.rs", "use crate::mesh::TriangleMesh;", Some("may use only")),
        ("storage/slab.rs", "use crate::spatial::Pose;", Some("may use only")),
        ("network/mod.rs", "use crate::spatial::Pose;", Some("may use only")),
        ("ros/names.rs", "use crate::monitor::Seen;\nuse crate::telemetry::TickRecord;", Some("crate::monitor::Seen")),
        ("publish/world.rs", "use crate::monitor::Seen;\nuse crate::servo::Pace;", Some("crate::servo::Pace")),
        ("scene/build.rs", "use crate::cli::Talk;", Some("nobody uses `cli`")),
        ("voxmap/build.rs", "use crate::picture::Subject;", Some("nobody but `cli`")),
        ("mesh/obj.rs", "fn f() { unsafe { g() } }", Some("`unsafe`")),
        ("mesh/obj.rs", "#![expect(unsafe_code)] // unsafe\nconst X: &str = \"unsafe println!\"; const C: char = '\"';", None),
        ("mesh/obj.rs", "const S: &str = r#\"a \" unsafe\"#; fn f<'a>(x: &'a str) { unsafe {} }", Some("`unsafe`")),
        ("config/strokes.rs", "fn f() { std::fs::read_to_string(path); }", Some("strokes.rs:1: `fs::read_to_string`")),
        ("config/strokes.rs", "fn f() { fs::read(path); fs::read_dir(path); }", Some("`fs::read`")),
        ("mesh/obj.rs", "fn f() {\n    File::open(path); }", Some("obj.rs:2: `File::open`")),
        ("rt/machine.rs", "fn f() { fs::read_to_string(path); }", None),
        ("rt/clock.rs", "fn f() { unsafe { g() } }", None),
        ("daemon/mod.rs", "fn f() {\n    eprintln!(\"x\");\n}", Some("mod.rs:2: `eprintln!`")),
        ("cli/run.rs", "fn f() { println!(\"{}\", 1); }", None),
        ("mesh/mod.rs", "/// println!(\"x\")\n/* crate::servo /* nested */ unsafe */", None),
        (
            "mesh/mod.rs",
            "#[cfg(test)]\n#[expect(x)]\nmod tests { use crate::servo::Order; fn f() { println!(\"}\"); } }\nfn g() {}",
            None,
        ),
        ("mesh/mod.rs", "#[cfg(test)]\nmod tests { }\nuse crate::servo::Order;", Some("mod.rs:3")),
    ] {
        let (broken, _) = violations(file, text);
        match expected {
            Some(fragment) => assert!(broken.len() == 1 && broken[0].contains(fragment), "{text}\n{broken:?}"),
            None => assert!(broken.is_empty(), "{text}\n{broken:?}"),
        }
    }
    let (_, modules) = violations("servo/mod.rs", "#[cfg(test)]\npub(crate) mod testing;\nmod pace;");
    assert_eq!(modules, ["testing"]);
}
