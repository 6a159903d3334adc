//! What the documents point at is there, and the commands that they show are ones that the program
//! takes.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Every Markdown page of the repository, build outputs apart.
fn pages() -> Vec<PathBuf> {
    fn walk(folder: &Path, found: &mut Vec<PathBuf>) {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            let name = path.file_name().unwrap().to_string_lossy().into_owned();
            if path.is_dir() {
                if !name.starts_with('.')
                    && !["target", "node_modules", "corpus"].contains(&name.as_str())
                {
                    walk(&path, found);
                }
            } else if path.extension().is_some_and(|extension| extension == "md") {
                found.push(path);
            }
        }
    }
    let mut found = Vec::new();
    walk(Path::new(env!("CARGO_MANIFEST_DIR")), &mut found);
    found.sort();
    assert!(found.len() > 30, "{}", found.len());
    found
}

/// Lines of a page, each with its number and whether it lies in a block of code.
fn lines(text: &str) -> impl Iterator<Item = (usize, &str, bool)> {
    let mut is_code = false;
    text.lines().enumerate().map(move |(n, line)| {
        let is_fence = line.trim_start().starts_with("```");
        is_code ^= is_fence;
        (n + 1, line, is_code && !is_fence)
    })
}

/// Headings as the usual renderers name them.
fn anchors(text: &str) -> BTreeSet<String> {
    let headings = lines(text)
        .filter(|(.., is_code)| !is_code)
        .filter_map(|(_, line, _)| line.strip_prefix('#'));
    let slug = |heading: &str| {
        let words = heading.trim_start_matches('#').trim().to_lowercase();
        let kept = words.chars().filter(|c| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_'));
        kept.map(|c| if c == ' ' { '-' } else { c }).collect::<String>()
    };
    headings.map(slug).collect()
}

#[test]
fn every_link_leads_somewhere() {
    let mut wrong = Vec::new();
    let mut n_links = 0;
    for page in pages() {
        let text = fs::read_to_string(&page).unwrap();
        for (n, line, is_code) in lines(&text) {
            if is_code {
                continue;
            }
            for (_, rest) in line.match_indices("](").map(|(at, _)| line.split_at(at + 2)) {
                let Some((target, _)) = rest.split_once(')') else { continue };
                if target.contains("://") || target.starts_with("mailto:") {
                    continue;
                }
                n_links += 1;
                let (file, anchor) = target.split_once('#').unwrap_or((target, ""));
                let path =
                    if file.is_empty() { page.clone() } else { page.parent().unwrap().join(file) };
                if !path.exists() {
                    wrong.push(format!("{}:{n}: {target} is not there", page.display()));
                } else if !anchor.is_empty()
                    && !anchors(&fs::read_to_string(&path).unwrap()).contains(anchor)
                {
                    wrong.push(format!("{}:{n}: {target}: no such heading", page.display()));
                }
            }
        }
    }
    assert!(n_links > 100, "{n_links}");
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn every_page_of_docs_is_one_kind_and_in_the_index() {
    let docs = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs");
    let index = fs::read_to_string(docs.join("README.md")).unwrap();
    for page in pages().iter().filter_map(|page| page.strip_prefix(&docs).ok()) {
        let shown = page.to_string_lossy();
        let is_of_a_kind = ["how-to/", "reference/", "explanation/", "adr/"]
            .iter()
            .any(|kind| shown.starts_with(kind));
        assert!(
            is_of_a_kind || ["README.md", "tutorial.md"].contains(&&*shown),
            "{shown} is of no kind"
        );
        assert!(
            shown.starts_with("adr/")
                || shown == "README.md"
                || index.contains(&format!("({shown})")),
            "{shown} is not in docs/README.md"
        );
    }
}

#[test]
fn sentences_of_documents_have_no_persons_that_stand_for_anything() {
    const NEVER: [&str; 6] = ["whoever", "nobody", "somebody", "hangs on", "lives in", "lives on"];
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut wrong = Vec::new();
    for page in pages()
        .iter()
        .filter(|page| !page.starts_with(root.join("tests")) && !page.ends_with("CHANGELOG.md"))
    {
        for (n, line, _) in
            lines(&fs::read_to_string(page).unwrap()).filter(|(.., is_code)| !is_code)
        {
            // Names of files and tests stand between backquotes.
            let prose = line.split('`').step_by(2).collect::<Vec<_>>().join(" ").to_lowercase();
            wrong.extend(
                NEVER
                    .iter()
                    .filter(|word| prose.contains(**word))
                    .map(|word| format!("{}:{n}: {word}", page.display())),
            );
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// What stands between single backquotes outside of blocks of code, line by line.
fn quoted(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let prose = lines(text).filter(|(_, line, is_code)| !is_code && !line.starts_with("```"));
    prose.flat_map(|(n, line, _)| line.split('`').skip(1).step_by(2).map(move |word| (n, word)))
}

#[test]
fn every_file_that_a_document_names_is_there() {
    const OURS: [&str; 11] = [
        "src/",
        "tests/",
        "docs/",
        "config/",
        "devices/",
        "scripts/",
        "examples/",
        "clients/",
        "packaging/",
        "fuzz/",
        "crates/",
    ];
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut wrong = Vec::new();
    let mut n_files = 0;
    for page in pages() {
        let text = fs::read_to_string(&page).unwrap();
        // The page of the papers names the crate, then the file below its `src`.
        let is_of_code = page.ends_with("docs/explanation/papers.md");
        for (n, word) in quoted(&text) {
            let is_file = OURS.iter().any(|start| word.starts_with(start))
                || is_of_code && word.contains('/');
            if !is_file || word.contains([' ', '*', '…']) {
                continue;
            }
            n_files += 1;
            let in_crate = word
                .split_once('/')
                .map(|(of, file)| root.join("crates").join(of).join("src").join(file));
            let is_there = root.join(word).exists()
                || is_of_code && in_crate.is_some_and(|path| path.exists());
            if !is_there {
                wrong.push(format!("{}:{n}: {word} is not there", page.display()));
            }
        }
    }
    assert!(n_files > 100, "{n_files}");
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// Names of the test functions of all crates.
fn tests_of_sources() -> BTreeSet<String> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut folders: Vec<PathBuf> =
        ["crates", "src", "tests"].map(|folder| root.join(folder)).into();
    let mut names = BTreeSet::new();
    while let Some(folder) = folders.pop() {
        for path in fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path()) {
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|ending| ending == "rs") {
                // The name follows the attribute, behind other attributes.
                for rest in fs::read_to_string(&path).unwrap().split("#[test]").skip(1) {
                    let name = rest.split_once("fn ").and_then(|(_, rest)| rest.split_once('('));
                    names.extend(name.map(|(name, _)| name.to_owned()));
                }
            }
        }
    }
    names
}

#[test]
fn every_row_of_the_papers_names_what_shows_it_and_that_is_there() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let page = fs::read_to_string(root.join("docs/explanation/papers.md")).unwrap();
    let known = tests_of_sources();
    let programs =
        fs::read_to_string(root.join("crates/bench/src/main.rs")).unwrap().to_lowercase();
    let mut wrong = Vec::new();
    let mut n_rows = 0;
    let mut is_shown = false;
    for (n, line, _) in lines(&page) {
        let cells = line.strip_suffix('|').and_then(|line| line.rsplit('|').next()).map(str::trim);
        let Some(last) = cells.filter(|_| line.starts_with('|')) else {
            is_shown = false;
            continue;
        };
        if last == "shown by" {
            is_shown = true;
        } else if is_shown && !last.starts_with("---") {
            n_rows += 1;
            let names: Vec<&str> = last.split('`').skip(1).step_by(2).collect();
            let is_there = |name: &&str| match name.strip_prefix("cargo run --release -p bench -- ")
            {
                Some(program) => programs.contains(program),
                None => known.contains(*name),
            };
            wrong.extend(
                names
                    .iter()
                    .filter(|name| !is_there(name))
                    .map(|name| format!("line {n}: no test is called {name}")),
            );
            if names.is_empty()
                && !["none: ", "the page, by eye"].iter().any(|word| last.starts_with(word))
            {
                wrong.push(format!("line {n}: `{last}` names nothing that shows it"));
            }
        }
    }
    assert!(n_rows > 60 && known.len() > 500, "{n_rows} rows, {} tests", known.len());
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// Keys of papers in a text: a name and a year, such as `Guo2004`.
fn keys(text: &str) -> impl Iterator<Item = &str> {
    text.split(|c: char| !c.is_ascii_alphanumeric()).filter(|word| {
        let (name, year) = word.split_at(word.len().saturating_sub(4));
        let is_year = matches!(year.as_bytes(), [b'1', b'9', ..] | [b'2', b'0', ..])
            && year.bytes().all(|digit| digit.is_ascii_digit());
        is_year
            && name.len() > 2
            && name.starts_with(|c: char| c.is_ascii_uppercase())
            && name.bytes().all(|c| c.is_ascii_alphabetic())
    })
}

#[test]
fn every_paper_that_the_code_names_is_in_the_bibliography() {
    fn walk(folder: &Path, named: &mut BTreeSet<String>) {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                walk(&path, named);
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                named.extend(keys(&fs::read_to_string(&path).unwrap()).map(str::to_owned));
            }
        }
    }
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut named = BTreeSet::new();
    walk(&root.join("src"), &mut named);
    walk(&root.join("crates"), &mut named);
    assert!(named.len() > 15, "{named:?}");
    let page = fs::read_to_string(root.join("docs/explanation/papers.md")).unwrap();
    let listed: BTreeSet<String> = page
        .lines()
        .filter_map(|line| line.strip_prefix("- **"))
        .flat_map(keys)
        .map(str::to_owned)
        .collect();
    let missing: Vec<_> = named.difference(&listed).collect();
    assert!(missing.is_empty(), "{missing:?}");
}

#[test]
fn every_dependency_has_a_row_with_its_reason() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let page = fs::read_to_string(root.join("docs/adr/deps.md")).unwrap();
    // `| clap_complete 4.6, clap_mangen 0.3 | ...`: names come before their versions.
    let cells = page.lines().filter_map(|line| line.strip_prefix("| ")?.split(" |").next());
    let rows: BTreeSet<&str> =
        cells.flat_map(|cell| cell.split(", ")).filter_map(|name| name.split(' ').next()).collect();
    let manifest: toml::Table =
        fs::read_to_string(root.join("Cargo.toml")).unwrap().parse().unwrap();
    let tables = [
        &manifest["workspace"]["dependencies"],
        &manifest["dependencies"],
        &manifest["dev-dependencies"],
    ];
    let is_own = |name: &str| root.join("crates").join(name).is_dir();
    let named: BTreeSet<&str> = tables
        .iter()
        .flat_map(|table| table.as_table().unwrap().keys())
        .map(String::as_str)
        .collect();
    let missing: Vec<_> =
        named.iter().filter(|name| !is_own(name) && !rows.contains(*name)).collect();
    assert!(named.len() > 40 && missing.is_empty(), "{missing:?} of {}", named.len());
}

/// Users of the libraries have neither a scene nor a command line: a caller gives texts the names of
/// its own settings (`vps::setting_names`).
#[test]
fn no_text_of_a_library_names_a_key_or_a_flag() {
    fn keys(schema: &serde_json::Value, found: &mut BTreeSet<String>) {
        if let Some(properties) = schema.get("properties").and_then(|found| found.as_object()) {
            found.extend(properties.keys().cloned());
        }
        let inside = schema.as_object().into_iter().flat_map(|table| table.values());
        inside.for_each(|value| keys(value, found));
    }
    fn walk(folder: &Path, found: &mut Vec<PathBuf>) {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            let is_test = path.file_stem().is_some_and(|stem| stem == "tests");
            if path.is_dir() {
                walk(&path, found);
            } else if !is_test && path.extension().is_some_and(|extension| extension == "rs") {
                found.push(path);
            }
        }
    }
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let schema = fs::read_to_string(root.join("config/scene.schema.json")).unwrap();
    let mut known = BTreeSet::new();
    keys(&serde_json::from_str(&schema).unwrap(), &mut known);
    assert!(known.len() > 80 && known.contains("units"), "{known:?}");
    let is_key = |quoted: &str| {
        let is_part = |c: char| c.is_alphanumeric() || c == '_';
        !quoted.starts_with('{') && quoted.split(|c| !is_part(c)).any(|word| known.contains(word))
    };
    let is_flag = |word: &str| {
        let word = word.trim_start_matches(['"', '`', '(']);
        word.strip_prefix("--").is_some_and(|name| name.starts_with(char::is_alphabetic))
    };
    let mut paths = Vec::new();
    for library in ["capi", "clay", "python", "vps"] {
        walk(&root.join("crates").join(library).join("src"), &mut paths);
    }
    let mut n_quoted = 0;
    for path in paths {
        let text = fs::read_to_string(&path).unwrap();
        let code = text.split("#[cfg(test)]\nmod tests {").next().unwrap_or_default();
        for line in code.lines().map(str::trim_start) {
            if line.starts_with("//") || line.starts_with("#[ignore") {
                continue;
            }
            let quoted: Vec<&str> = line.split('`').skip(1).step_by(2).collect();
            n_quoted += quoted.len();
            let is_named = quoted.into_iter().any(is_key) || line.split(' ').any(is_flag);
            assert!(!is_named, "{}: {line}", path.display());
        }
    }
    assert!(n_quoted > 40, "{n_quoted}");
}

/// Words of a command line, up to where the shell takes over.
fn words(line: &str) -> Vec<String> {
    let mut words = Vec::new();
    let mut word = String::new();
    let mut quote = None;
    let mut is_word = false;
    for c in line.chars() {
        match (quote, c) {
            (Some(open), c) if c == open => quote = None,
            (Some(_), c) => word.push(c),
            (None, '\'' | '"') => (quote, is_word) = (Some(c), true),
            (None, '|' | '&' | ';' | '>' | '<') => break,
            (None, '#') if !is_word => break,
            (None, c) if c.is_whitespace() => {
                if is_word {
                    words.push(core::mem::take(&mut word));
                }
                is_word = false;
            }
            (None, c) => {
                word.push(c);
                is_word = true;
            }
        }
    }
    if is_word {
        words.push(word);
    }
    words
}

/// Command lines of the program in a page: those in blocks of code, continued lines joined, and
/// those in the text.
fn commands(text: &str) -> Vec<(usize, Vec<String>)> {
    let mut found = Vec::new();
    for (n, line, _) in
        lines(text).filter(|(_, line, is_code)| !is_code && !line.starts_with("```"))
    {
        let inline =
            line.split('`').skip(1).step_by(2).filter_map(|code| code.strip_prefix("hapticd "));
        found.extend(inline.map(|arguments| (n, words(arguments))));
    }
    let mut code = lines(text).filter(|(.., is_code)| *is_code).peekable();
    while let Some((n, line, _)) = code.next() {
        let mut whole = line.trim().trim_start_matches("$ ").to_owned();
        while whole.ends_with('\\') {
            whole.pop();
            whole.push_str(code.next().map_or("", |(_, line, _)| line.trim()));
        }
        let own = ["hapticd ", "cargo run --release -- ", "target/release/hapticd "];
        if let Some(arguments) = own.iter().find_map(|start| whole.strip_prefix(start)) {
            found.push((n, words(arguments)));
        }
    }
    found
}

#[test]
fn every_command_in_a_document_is_one_that_the_program_takes() {
    let mut wrong = Vec::new();
    let mut n_commands = 0;
    for page in pages() {
        let text = fs::read_to_string(&page).unwrap();
        for (n, arguments) in commands(&text) {
            // A line of a synopsis, one that was cut short, or a word that stands for one of
            // several.
            let is_form = |word: &String| {
                word.starts_with('[')
                    || word.contains('…')
                    || ["COMMAND", "SHELL"].contains(&&**word)
            };
            if arguments.iter().any(is_form) {
                continue;
            }
            n_commands += 1;
            // Everything before `--help` is read and judged, and nothing is done.
            let shown = Command::new(env!("CARGO_BIN_EXE_hapticd"))
                .args(&arguments)
                .arg("--help")
                .output()
                .unwrap();
            if !shown.status.success() {
                wrong.push(format!(
                    "{}:{n}: {}: {}",
                    page.display(),
                    arguments.join(" "),
                    String::from_utf8_lossy(&shown.stderr)
                ));
            }
            for word in arguments
                .iter()
                .filter(|word| word.starts_with("config/") || word.starts_with("devices/"))
            {
                if !word.contains('*') && !Path::new(env!("CARGO_MANIFEST_DIR")).join(word).exists()
                {
                    wrong.push(format!("{}:{n}: {word} is not there", page.display()));
                }
            }
        }
    }
    assert!(n_commands > 80, "{n_commands}");
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn words_end_where_the_shell_begins() {
    assert_eq!(words("run a.toml --hand 'x y' # why"), ["run", "a.toml", "--hand", "x y"]);
    assert_eq!(words("doctor --json | jq ."), ["doctor", "--json"]);
    let found =
        commands("```text\n$ hapticd run a \\\n  --json\n```\nhapticd none, `hapticd check b`\n");
    let [check, run] = [["check", "b"].as_slice(), &["run", "a", "--json"]]
        .map(|words| words.iter().map(|word| (*word).to_owned()).collect());
    assert_eq!(found, [(5, check), (2, run)]);
    assert!(anchors("# A b\n```\n# not\n```\n## 3. It's `x`\n").iter().eq(["3-its-x", "a-b"]));
}
