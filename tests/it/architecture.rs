//! What Cargo and lints cannot hold: files that others name are opened by `vps::storage::regular`,
//! which opens regular files only, and results are written by `vps::storage::whole_file`, which
//! leaves no half of one.
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

/// Prefixes of the files that may write to files by themselves: those of the system, those in
/// folders that go away, and those that grow with a run and are read while they do.
const WRITES_ALLOWED: [&str; 8] = [
    "crates/vps/src/storage/",
    "crates/rt/src/",
    "crates/bench/src/",
    "crates/arms/src/guard",
    "crates/arms/src/mock/trace",
    "crates/recording/src/file/",
    "src/daemon/unpacked",
    "src/daemon/remote",
];

const WRITES: [&str; 2] = ["File::create(", "fs::write("];

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
            "fn f() { fs::read_dir(path); File::create_new(path); }",
            &[&OPENS[..], &WRITES[..]].concat()
        )
        .is_empty()
    );
    let text = "fn f() { std::fs::write(path, text) }\nfn g() { TraceFile::create(path) }\nlet \
        file = File::create(path)?;";
    assert_eq!(calls(text, &WRITES).iter().map(|(line, _)| *line).collect::<Vec<_>>(), [1, 3]);
}
