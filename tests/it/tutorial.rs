//! The ten steps of `docs/tutorial.md` work as they stand in the page.

use std::fs;
use std::path::Path;
use std::process::Command;

const PAGE: &str = include_str!("../../docs/tutorial.md");

/// One numbered section of the page.
#[derive(Default)]
struct Step<'a> {
    title: &'a str,
    /// Its block of commands.
    commands: String,
    /// Lines that the page says one sees; `…` stands for anything.
    shown: Vec<&'a str>,
    /// Files that its text names.
    files: Vec<&'a str>,
}

fn steps(page: &str) -> Vec<Step<'_>> {
    let mut steps: Vec<Step<'_>> = Vec::new();
    let mut block = None;
    for line in page.lines() {
        if let Some(fence) = line.strip_prefix("```") {
            block = (!fence.is_empty()).then_some(fence);
        } else if block.is_none()
            && let Some(title) = line.strip_prefix("## ")
        {
            steps.push(Step { title, ..Step::default() });
        } else if let Some(step) = steps.last_mut() {
            match block {
                Some("sh") => step.commands += &format!("{line}\n"),
                Some(_) => step.shown.push(line),
                None => {
                    let words = line.split('`').skip(1).step_by(2);
                    let is_file =
                        |word: &&str| !word.contains(' ') && Path::new(word).extension().is_some();
                    step.files.extend(words.filter(is_file));
                }
            }
        }
    }
    steps.retain(|step| !step.commands.is_empty());
    steps
}

/// `line` is in `output`, with anything in the place of each `…`.
fn is_in(output: &str, line: &str) -> bool {
    let holds = |printed: &str| {
        line.split('…')
            .map(str::trim)
            .try_fold(printed, |rest, part| rest.find(part).map(|at| &rest[at + part.len()..]))
            .is_some()
    };
    output.lines().any(holds)
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn the_ten_steps_of_the_tutorial_give_what_the_page_says() {
    let steps = steps(PAGE);
    assert_eq!(steps.len(), 10);
    assert!(
        steps.iter().enumerate().all(|(n, step)| step.title.starts_with(&format!("{}. ", n + 1)))
    );
    let folder = tempfile::tempdir().unwrap();
    let program = Path::new(env!("CARGO_BIN_EXE_hapticd")).parent().unwrap();
    let path = format!("{}:{}", program.display(), std::env::var("PATH").unwrap());
    let mut n_shown = 0;
    let mut n_files = 0;
    for Step { title, commands, shown, files } in steps {
        let ended = Command::new("sh")
            .args(["-e", "-c", &commands])
            .current_dir(folder.path())
            .env("PATH", &path)
            .env("XDG_CACHE_HOME", folder.path().join("cache"))
            .env("XDG_STATE_HOME", folder.path().join("state"))
            .output()
            .unwrap();
        let output =
            [&ended.stdout, &ended.stderr].map(|bytes| String::from_utf8_lossy(bytes)).concat();
        assert!(ended.status.success(), "step {title}: {}\n{output}", ended.status);
        for line in shown {
            assert!(is_in(&output, line), "step {title} does not print {line:?}:\n{output}");
            n_shown += 1;
        }
        for file in files {
            let size = fs::metadata(folder.path().join(file)).map_or(0, |is| is.len());
            assert!(size > 0, "step {title} leaves no {file}");
            n_files += 1;
        }
    }
    assert!(n_shown >= 14 && n_files >= 6, "{n_shown} lines, {n_files} files");
}

#[test]
fn a_line_that_is_not_printed_is_missed() {
    assert!(is_in("a\nlargest command    0.615 N", "largest command    0.… N"));
    assert!(!is_in("largest\ncommand", "largest … command"));
    assert!(!is_in("points 1", "points 2"));
}
