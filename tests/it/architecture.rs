//! What Cargo and lints cannot hold: files that others name are opened by `vps::storage::regular`, which opens regular files only.
//!
//! Which crate uses which is the business of Cargo; `unsafe` and printing are denied by lints where no file expects them with a reason.

use std::path::{Path, PathBuf};

/// Prefixes of the files that may open files by themselves: those of the system, and those that the program wrote.
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

/// Where a file opens another by its name, outside of comments and of the test module at its end.
fn opens(text: &str) -> Vec<(usize, &str)> {
    let end = text.find("\n#[cfg(test)]\nmod tests").or_else(|| text.find("\n#[cfg(test)]\n#[expect")).unwrap_or(text.len());
    let is_open = |line: &str| {
        let code = line.split("//").next().unwrap_or_default();
        ["File::open(", "fs::read(", "fs::read_to_string("].iter().any(|call| code.contains(call))
    };
    (1..).zip(text[..end].lines()).filter(|(_, line)| is_open(line)).collect()
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
        if is_test || OPENS_ALLOWED.iter().any(|allowed| file.starts_with(allowed)) {
            continue;
        }
        let text = std::fs::read_to_string(path).expect("text");
        broken.extend(opens(&text).into_iter().map(|(line, code)| format!("{file}:{line}: {}", code.trim())));
    }
    assert!(broken.is_empty(), "open these by `vps::storage::regular`:\n{}", broken.join("\n"));
}

#[test]
fn a_planted_opening_is_found() {
    let text = "// fs::read(path)\nfn f() { fs::read(path); }\nfn g() { File::open(path) }\n\n#[cfg(test)]\nmod tests { fn h() { fs::read(path); } }";
    assert_eq!(opens(text).iter().map(|(line, _)| *line).collect::<Vec<_>>(), [2, 3]);
    assert!(opens("fn f() { fs::read_dir(path); }").is_empty());
}
