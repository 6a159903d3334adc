//! The page of results, as Markdown. Its prose holds for any machine: what depends on it is a
//! figure.

use core::fmt::Write as _;

use super::Figures;
use super::metrics::FIGURES;
use super::scenes::{Scene, Trajectory};
use crate::report::figure;

/// Tables over several scenes, and whether something sharp touches in them.
pub(super) const KINDS: [(&str, bool); 2] =
    [("Scenes with closed forms", false), ("Tips, edges and wedges with closed forms", true)];
/// Figures of the tables of single scenes.
const OF_A_SCENE: [&str; 5] =
    ["angle, p95", "size off, p95", "ripple above 10 Hz", "work of a loop", "query, p50"];
const WITHOUT_LAW: [&str; 7] = [
    "ripple above 10 Hz",
    "ripple above 50 Hz",
    "largest step",
    "work of a loop",
    "query, p50",
    "memory",
    "bake",
];

/// The page, with links to the plots in `../pictures`. `machine`: a line about where it was
/// measured.
pub fn page(figures: &Figures, machine: &str) -> String {
    let mut text = String::from("# Measured: contact wrenches of several programs\n\n");
    text.push_str(
        "`cargo run --release -p bench -- wrench --docs docs` wrote this page and its \
        plots, on one machine:\n\n",
    );
    let with = |has_law: bool| {
        let scenes = figures.scenes.iter();
        let there = scenes
            .filter(move |scene| scene.trajectories.iter().any(|of| scene.has_law(of) == has_law));
        there.map(|scene| scene.name)
    };
    // Writing to a string cannot fail, here and below.
    let _ = write!(text, "{machine}\n\n");
    text.push_str(
        "What is compared, the closed forms, the meaning of each figure and how to join: \
            [wrench-benchmark.md](wrench-benchmark.md).\nEvery query runs on one processor.\n",
    );
    let _ = writeln!(
        text,
        "Hash of the scenes with closed forms (XXH3 of their files): `{:016x}`.",
        figures.hash
    );
    for (title, is_sharp) in KINDS {
        let _ = write!(text, "\n## {title}\n\n");
        table(&mut text, figures, &FIGURES.map(|(name, _)| name), |scene, trajectory| {
            scene.has_law(trajectory) && scene.is_sharp() == is_sharp
        });
    }
    text.push_str(
        "\n## Settings\n\nForces are multiplied by the scale, one number for each program, before \
            sizes are compared.\n\n",
    );
    text.push_str("| program | scale | settings |\n|---|---:|---|\n");
    for program in &figures.programs {
        let settings = program
            .answers
            .iter()
            .map(|answer| &answer.about.settings)
            .find(|settings| !settings.is_empty());
        let settings = settings.map_or_else(String::new, |settings| settings.replace('|', "/"));
        let _ = writeln!(text, "| {} | {} | {settings} |", program.name, number(program.scale));
    }
    text.push_str(
        "\n## Plots\n\nThe first contact of each scene that is held: force after scaling, and \
            angle to the closed form.\n",
    );
    for (file, what) in [
        ("size", "Force after scaling, % of the closed form"),
        ("angle", "Angle to the closed form, °"),
    ] {
        let _ = write!(text, "\n![{what}](../pictures/wrench-{file}.svg)\n");
    }
    text.push_str("\n## Scene by scene\n");
    for name in with(true) {
        let _ = write!(text, "\n### {name}\n\n");
        table(&mut text, figures, &OF_A_SCENE, |scene, trajectory| {
            scene.name == name && scene.has_law(trajectory)
        });
    }
    text.push_str(
        "\n## Without a closed form\n\nRipple and steps are those of the force itself, \
        in % of its mean.\n",
    );
    for name in with(false) {
        let _ = write!(
            text,
            "\n### {name}{}\n\n",
            if with(true).any(|other| other == name) { ": insertion and jam" } else { "" }
        );
        table(&mut text, figures, &WITHOUT_LAW, |scene, trajectory| {
            scene.name == name && !scene.has_law(trajectory)
        });
    }
    if !figures.skipped.is_empty() {
        text.push_str("\n## Not measured\n\n");
        figures.skipped.iter().for_each(|why| text.push_str(&format!("- {why}\n")));
    }
    text
}

fn number(value: Option<f64>) -> String {
    match value {
        None => "–".to_owned(),
        Some(value) if value.is_infinite() => "never".to_owned(),
        Some(value) => figure(value),
    }
}

/// A line for each program that answered, a column for each figure.
fn table(
    text: &mut String,
    figures: &Figures,
    wanted: &[&str],
    trajectories: impl Fn(&Scene, &Trajectory) -> bool,
) {
    let columns: Vec<usize> =
        (0..FIGURES.len()).filter(|idx| wanted.contains(&FIGURES[*idx].0)).collect();
    text.push_str("| program | scenes |");
    columns
        .iter()
        .for_each(|idx| text.push_str(&format!(" {}, {} |", FIGURES[*idx].0, FIGURES[*idx].1)));
    let _ = write!(text, "\n|---|{}\n", "---:|".repeat(1 + columns.len()));
    for program in &figures.programs {
        let Some(values) = figures.of(program, &trajectories) else { continue };
        let wanted = figures
            .scenes
            .iter()
            .zip(&program.answers)
            .filter(|(scene, _)| scene.trajectories.iter().any(|of| trajectories(scene, of)));
        let there: Vec<bool> = wanted.map(|(_, answer)| answer.is_there()).collect();
        let n_there = there.iter().filter(|is_there| **is_there).count();
        let _ = write!(text, "| {} | {n_there} of {} |", program.name, there.len());
        columns.iter().for_each(|idx| text.push_str(&format!(" {} |", number(values[*idx]))));
        text.push('\n');
    }
}
