//! What Cargo and lints cannot hold: files that others name are opened by `vps::storage::regular`,
//! which opens regular files only; files that are left to a person are made by
//! `vps::storage::whole_file`, which refuses links and leaves no half of one; a loop that commands an
//! arm enters real time by `rt::realtime`; and text reaches a terminal by `cli::output`, which escapes
//! it.
//!
//! Which crate uses which is the business of Cargo; `unsafe` and printing are denied by lints where
//! no file expects them with a reason.

use std::path::{Path, PathBuf};

/// Prefixes of the files that may open files by themselves: those of the system, and those that the
/// program wrote.
const OPENS_ALLOWED: [&str; 10] = [
    "crates/vps/src/storage/",
    "crates/rt/src/",
    "crates/bench/src/",
    "crates/arms/src/attached/discover",
    "crates/arms/src/guard",
    "crates/recording/src/file/write",
    "src/cli/bake/figures",
    "src/cli/publish",
    "src/daemon/unpacked",
    "src/scene/cache/folder",
];

const OPENS: [&str; 3] = ["File::open(", "fs::read(", "fs::read_to_string("];

/// Prefixes of the files that may make files or write to them by themselves: those of the system and
/// its devices, those in folders that go away, those of the cache, and manual pages of a build.
const WRITES_ALLOWED: [&str; 11] = [
    "crates/vps/src/storage/",
    "crates/rt/src/",
    "crates/bench/src/",
    "crates/arms/src/guard",
    "crates/arms/src/transport/",
    "crates/arms/src/vendor/worker",
    "crates/link/src/network/session",
    "src/cli/man",
    "src/daemon/unpacked",
    "src/daemon/remote",
    "src/scene/cache/folder",
];

const WRITES: [&str; 7] = [
    "File::create(",
    "File::create_new(",
    "File::options(",
    "OpenOptions::new(",
    "NamedTempFile",
    "fs::write(",
    "fs::rename(",
];

/// Loops enter real time by `rt::realtime`; threads that carry their bytes, a guard and a mock arm
/// command none.
const REALTIME_ALLOWED: [&str; 5] = [
    "crates/rt/src/",
    "crates/bench/src/",
    "crates/arms/src/guard",
    "crates/arms/src/transport/threaded",
    "src/cli/mock",
];

const REALTIME: [&str; 3] = ["enter_realtime(", "enter_fifo(", "lock_memory("];

/// Numbers without names go to stdout in bulk.
const PRINTS_ALLOWED: [&str; 3] = ["crates/bench/src/", "src/cli/output", "src/cli/eval"];

const PRINTS: [&str; 4] = ["stdout().write", "stderr().write", "stdout().lock(", "stderr().lock("];

/// Where a file makes one of these calls, outside of comments and of the test module at its end.
fn calls<'t>(text: &'t str, names: &[&str]) -> Vec<(usize, &'t str)> {
    let end = text
        .find("\n#[cfg(test)]\nmod tests")
        .or_else(|| text.find("\n#[cfg(test)]\n#[expect"))
        .unwrap_or(text.len());
    let is_call = |line: &str| {
        let code = line.split("//").next().unwrap_or_default();
        // `TraceFile::create(` is another one.
        let is_whole = |at: usize| !code[..at].ends_with(|c: char| c.is_alphanumeric());
        names.iter().any(|call| code.match_indices(call).any(|(at, _)| is_whole(at)))
    };
    (1..).zip(text[..end].lines()).filter(|(_, line)| is_call(line)).collect()
}

fn source_files(folder: &Path, files: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            source_files(&path, files);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            files.push(path);
        }
    }
}

#[test]
fn foreign_names_are_opened_in_one_place() {
    let broken = broken(&OPENS, &OPENS_ALLOWED);
    assert!(broken.is_empty(), "open these by `vps::storage::regular`:\n{}", broken.join("\n"));
}

#[test]
fn results_are_written_whole_in_one_place() {
    let broken = broken(&WRITES, &WRITES_ALLOWED);
    assert!(broken.is_empty(), "write these by `vps::storage::whole_file`:\n{}", broken.join("\n"));
}

#[test]
fn a_loop_enters_real_time_in_one_place() {
    let broken = broken(&REALTIME, &REALTIME_ALLOWED);
    assert!(broken.is_empty(), "enter by `rt::realtime`:\n{}", broken.join("\n"));
}

#[test]
fn text_reaches_a_terminal_in_one_place() {
    let broken = broken(&PRINTS, &PRINTS_ALLOWED);
    assert!(broken.is_empty(), "print these by `cli::output`:\n{}", broken.join("\n"));
}

/// Calls of these outside of tests and of the files that may make them.
fn broken(names: &[&str], allowed: &[&str]) -> Vec<String> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut files = Vec::new();
    source_files(&root.join("src"), &mut files);
    for package in std::fs::read_dir(root.join("crates")).expect("crates") {
        source_files(&package.expect("an entry").path().join("src"), &mut files);
    }
    assert!(files.len() > 300, "{} files", files.len());
    let mut broken = Vec::new();
    for path in &files {
        let file = path.strip_prefix(root).expect("below the root").to_string_lossy();
        let is_test = ["tests.rs", "testing.rs"].iter().any(|end| file.ends_with(end))
            || ["/tests/", "/testing/", "/conformance/"].iter().any(|part| file.contains(part));
        if is_test || allowed.iter().any(|allowed| file.starts_with(allowed)) {
            continue;
        }
        let text = std::fs::read_to_string(path).expect("text");
        broken.extend(
            calls(&text, names)
                .into_iter()
                .map(|(line, code)| format!("{file}:{line}: {}", code.trim())),
        );
    }
    broken
}

#[test]
fn a_planted_call_is_found() {
    let text = "// fs::read(path)\nfn f() { fs::read(path); }\nfn g() { File::open(path) \
        }\n\n#[cfg(test)]\nmod tests { fn h() { fs::read(path); } }";
    assert_eq!(calls(text, &OPENS).iter().map(|(line, _)| *line).collect::<Vec<_>>(), [2, 3]);
    assert!(
        calls(
            "fn f() { fs::read_dir(path); fs::remove_file(path); }",
            &[&OPENS[..], &WRITES[..]].concat()
        )
        .is_empty()
    );
    let text = "fn f() { std::fs::write(path, text) }\nfn g() { TraceFile::create(path) }\nlet \
        file = File::create(path)?;";
    assert_eq!(calls(text, &WRITES).iter().map(|(line, _)| *line).collect::<Vec<_>>(), [1, 3]);
}
