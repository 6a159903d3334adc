//! The page of what was found, as Markdown. Its prose holds for any machine: what depends on it is
//! a figure.

use core::fmt::Write as _;

use super::super::report::figure;
use super::super::stand_ins::StandIn;
use super::super::statistics::median;
use super::super::table1::{POINTSHELLS, VOXMAPS, crossover_voxels};
use super::projection::PAPER_PERCENT;
use super::spacing::SHARES;
use super::{Figures, LANDING_GEAR, LANDING_GEAR_MM, Step, crossover_voxels_of};

/// Percent of the boundary projections that the paper recovers, from and to.
const PAPER_RECOVERED_PERCENT: [f64; 2] = [0.06, 1.3];

/// The page, with links to the plots in `../pictures`. `machine`: a line about where it was
/// measured.
pub fn page(figures: &Figures, machine: &str) -> String {
    let mut text = String::new();
    text.push_str("# Measured: the tables and plots of Sagardia2008\n\n");
    text.push_str(
        "`cargo run --release -p bench -- sagardia-2008 --docs docs` wrote this page, \
        its tables and its plots, in one run on one machine:\n\n",
    );
    // Writing to a string cannot fail, here and below.
    let _ = write!(text, "{machine}\n\n");
    let _ = write!(
        text,
        "Everything runs on one thread. Seconds are processor time of that thread, medians of {} \
            run{}; what is compared runs in turn.\nThe paper's times are of an Intel D of 3.4 GHz. \
            Its models are private: stand-ins have their grids, their numbers of triangles \
            (less\none where odd), and their numbers of points within 20 %. What the method does \
            and where we deviate: [papers.md](../explanation/papers.md).\n\nThe paper's t_old is \
            the time of the generator before it, on the library SOLID. It is not at hand, so here \
            something else\nstands for it: for voxmaps the naïve way that the paper names, a test \
            of every voxel in each triangle's box; for pointshells the two phases as the paper \
            prints\nthem. So Δ of the paper and Δ here are ratios of the same kind, not of the \
            same programs.\n",
        figures.n_runs,
        if figures.n_runs == 1 { "" } else { "s" },
    );
    models(&mut text, figures);
    voxmaps(&mut text, figures);
    pointshells(&mut text, figures);
    plots(&mut text, figures);
    remarks(&mut text, figures);
    projections(&mut text, figures);
    boundary(&mut text, figures);
    spacing(&mut text, figures);
    text
}

fn models(text: &mut String, figures: &Figures) {
    text.push_str(
        "\n## Figure 4\n\nThe stand-ins as polygons, voxmap and pointshell, as `hapticd \
        bake part.stl --picture-3d part.png` draws any mesh:\n",
    );
    for (stand_in, _) in figures.models() {
        let name = stand_in.name();
        let _ = write!(
            text,
            "\n![The {name}: polygons, surface voxels, \
                points](../pictures/sagardia-2008-{name}.png)\n"
        );
    }
}

fn voxmaps(text: &mut String, figures: &Figures) {
    text.push_str("\n## Table 1: voxmaps\n\nThe paper, seconds:\n\n");
    text.push_str(
        "| case | model | s, mm | voxels | load | initialise | t_old | t_new | filling | \
        Δ = t_old / t_new |\n",
    );
    text.push_str("|---|---|---:|---:|---:|---:|---:|---:|---:|---:|\n");
    for case in &VOXMAPS {
        let _ = writeln!(
            text,
            "| ({}) | {} | {} | {} | {} | {} | {} | {} | {} | {} |",
            case.name,
            paper_name(case.stand_in),
            case.size_mm,
            grouped(case.voxels as u64),
            seconds(case.load_s),
            seconds(case.init_s),
            seconds(case.old_s),
            seconds(case.new_s),
            seconds(case.fill_s),
            times(case.delta())
        );
    }
    text.push_str("\nHere, seconds:\n\n");
    text.push_str(
        "| case | stand-in | voxels | load | initialise | naïve | first navigation | \
        second navigation | filling | Δ = naïve / second |\n",
    );
    text.push_str("|---|---|---:|---:|---:|---:|---:|---:|---:|---:|\n");
    for case in &VOXMAPS {
        let Some(step) = figures.step(case.stand_in, case.size_mm) else { continue };
        let _ = writeln!(
            text,
            "| ({}) | {} | {} | {} | {} | {} | {} | {} | {} | {} |",
            case.name,
            case.stand_in.name(),
            grouped(step.voxels),
            figures.load_s(case.stand_in).map_or_else(String::new, seconds),
            seconds(step.init_s),
            seconds(step.whole_box.median_s()),
            seconds(step.plane_span.median_s()),
            seconds(step.two_sided.median_s()),
            seconds(step.fill_s),
            times(step.delta()),
        );
    }
    left_out(
        text,
        VOXMAPS
            .iter()
            .filter(|case| figures.step(case.stand_in, case.size_mm).is_none())
            .map(|case| case.name),
    );
    text.push_str("\nTests of a triangle and a voxel:\n\n");
    text.push_str(
        "| case | naïve | first navigation | second navigation | surface voxels \
        |\n|---|---:|---:|---:|---:|\n",
    );
    for case in &VOXMAPS {
        let Some(step) = figures.step(case.stand_in, case.size_mm) else { continue };
        let counts = [
            step.whole_box.tests,
            step.plane_span.tests,
            step.two_sided.tests,
            step.surface_voxels as u64,
        ]
        .map(grouped);
        let _ = writeln!(text, "| ({}) | {} |", case.name, counts.join(" | "));
    }
    text.push_str(
        "\nInitialising makes the grid only: a sparse map takes its memory while it is marked. \
            Filling is the flood fill alone.\nA navigation solves for the ends of a column, so \
            that a test takes two comparisons; a test of the naïve way goes through up to 13 axes. \
            But a navigation\nprepares each triangle first: where triangles are smaller than \
            voxels, their boxes hold few, and the naïve way can be the faster one (Δ below 1).\n",
    );
}

fn pointshells(text: &mut String, figures: &Figures) {
    text.push_str("\n## Table 1: pointshells\n\nThe paper, seconds:\n\n");
    text.push_str(
        "| case | model | s, mm | points | t_old | t_new | Δ = t_old / t_new \
        |\n|---|---|---:|---:|---:|---:|---:|\n",
    );
    for case in &POINTSHELLS {
        let _ = writeln!(
            text,
            "| ({}) | {} | {} | {} | {} | {} | {} |",
            case.name,
            paper_name(case.stand_in),
            case.size_mm,
            grouped(case.points as u64),
            seconds(case.old_s),
            seconds(case.new_s),
            times(case.delta())
        );
    }
    text.push_str("\nHere, seconds:\n\n");
    text.push_str(
        "| case | stand-in | points | two phases as printed | points as shipped | Δ = \
        two phases / shipped | whole shell: points, normals, order, tree |\n",
    );
    text.push_str("|---|---|---:|---:|---:|---:|---:|\n");
    for case in &POINTSHELLS {
        let Some(step) = figures.step(case.stand_in, case.size_mm) else { continue };
        let points = &step.points;
        let _ = writeln!(
            text,
            "| ({}) | {} | {} | {} | {} | {} | {} |",
            case.name,
            case.stand_in.name(),
            grouped(step.surface_voxels as u64),
            seconds(points.optimised_s),
            seconds(points.shipped_s),
            times(points.delta()),
            seconds(points.shell_s),
        );
    }
    left_out(
        text,
        POINTSHELLS
            .iter()
            .filter(|case| figures.step(case.stand_in, case.size_mm).is_none())
            .map(|case| case.name),
    );
    text.push_str(
        "\nThe two phases run without normals; the paper does not say whether its times have them. \
            The shipped way keeps one point for each voxel and goes brick by\nbrick, so that any \
            number of threads gives the same points. It prepares a triangle anew in each brick \
            that it meets, which the two phases do once: on one thread, Δ may be below 1.\n",
    );
}

fn plots(text: &mut String, figures: &Figures) {
    text.push_str("\n## Figures 6 and 7\n\n");
    text.push_str(
        "![Points against voxels for each model: all projections, the two phases, one \
        for each voxel](../pictures/sagardia-2008-points.svg)\n\n",
    );
    text.push_str(
        "*All projections* keeps one for each triangle and voxel that touch, *two phases* what the \
            printed phases keep, *shipped* one for each voxel. The paper's curve for \
            the\ngenerator before it lies above that of the new one in the same way.\n\n",
    );
    text.push_str(
        "| stand-in | s, mm | voxels | all projections | two phases | shipped \
        |\n|---|---:|---:|---:|---:|---:|\n",
    );
    for step in &figures.steps {
        let points = &step.points;
        let counts = [
            step.voxels,
            points.phases.projections(),
            points.phases.points(),
            step.surface_voxels as u64,
        ]
        .map(grouped);
        let _ = writeln!(
            text,
            "| {} | {} | {} |",
            step.stand_in.name(),
            step.size_mm,
            counts.join(" | ")
        );
    }
    text.push_str(
        "\n![Ratios of times against voxels, and the paper's by \
        letter](../pictures/sagardia-2008-ratios.svg)\n\n",
    );
    text.push_str("### Where the second navigation becomes the faster one\n\n");
    text.push_str(
        "| stand-in | from this many voxels on | the paper | first / second, from coarse to fine \
            |\n|---|---:|---:|---|\n",
    );
    for (stand_in, steps) in figures.models() {
        let ratios: Vec<String> =
            steps.iter().map(|step| format!("{:.3}", step.first_over_second())).collect();
        let _ = writeln!(
            text,
            "| {} | {} | {} | {} |",
            stand_in.name(),
            crossover_voxels_of(&steps)
                .map_or_else(|| "none".to_owned(), |voxels| grouped(voxels as u64)),
            grouped(crossover_voxels(stand_in) as u64),
            ratios.join(", "),
        );
    }
    let differences = figures.steps.iter().map(|step| (step.first_over_second() - 1.0).abs());
    let _ = writeln!(
        text,
        "\nAbove 1 the second one is faster; the first column of figures wants every run of it to \
            be faster, at this size and at all finer ones, which chance can do too. The largest \
            difference\nof medians is {:.1} %: with ends that are solved for, a column has hardly \
            a voxel between them that the second navigation could leave out.",
        100.0 * differences.fold(0.0, f64::max)
    );
}

fn remarks(text: &mut String, figures: &Figures) {
    text.push_str("\n## Remarks\n\n**1: ratios of one computer, not times.** ");
    if figures.n_runs > 1 {
        let spread = |step: &Step| step.delta_range()[1] / step.delta_range()[0] - 1.0;
        let mut spreads: Vec<f64> = figures.steps.iter().map(spread).collect();
        spreads.sort_by(f64::total_cmp);
        let _ = writeln!(
            text,
            "From the least to the largest of {} runs, Δ of the voxmaps differs by {:.0} % (median \
                of all steps; at most {:.0} %).\nWhat another computer does to it is not measured \
                here; the command prints the same page there.",
            figures.n_runs,
            100.0 * median(&spreads).unwrap_or_default(),
            100.0 * spreads.last().copied().unwrap_or_default()
        );
    } else {
        text.push_str(
            "There was one run of each, so nothing says how far a ratio differs between runs.\n",
        );
    }
    text.push_str(
        "\n**2: what fits into a millisecond.** The paper's cases (f), (h) and (j) have about the \
            points that its computer could query in 1 ms. One query over all points, without the \
            tree, of\nthe stand-in against its own voxmap, half a voxel aside:\n\n",
    );
    text.push_str(
        "| case | points | in contact | one query, µs | for one point, ns \
        |\n|---|---:|---:|---:|---:|\n",
    );
    for case in POINTSHELLS.iter().filter(|case| ['f', 'h', 'j'].contains(&case.name)) {
        let query = figures.step(case.stand_in, case.size_mm).and_then(|step| step.points.query);
        let Some(query) = query else { continue };
        let _ = writeln!(
            text,
            "| ({}) | {} | {} | {:.1} | {:.1} |",
            case.name,
            grouped(query.n_points as u64),
            grouped(query.touching.into()),
            query.median_us,
            1e3 * query.median_us / query.n_points as f64
        );
    }
    let [triangles, voxels, paper_s] = LANDING_GEAR;
    let _ = write!(
        text,
        "\n**3: the landing gear.** The paper's [10] voxelises {:.2}·10⁶ triangles into {:.2}·10⁸ \
            voxels in {} s (two Xeons of 2.8 GHz), beside 442.29 s of case (e). ",
        triangles * 1e-6,
        voxels * 1e-8,
        grouped(paper_s as u64)
    );
    match figures.step(StandIn::Car, LANDING_GEAR_MM) {
        Some(step) => {
            let _ = writeln!(
                text,
                "The car, with {:.2}·10⁶\ntriangles, into {} voxels ({} mm) takes {} s by the \
                    first navigation, {} s by the second and {} s the naïve way; loading, \
                    initialising and filling {} s more.",
                StandIn::Car.paper_triangles() as f64 * 1e-6,
                grouped(step.voxels),
                step.size_mm,
                seconds(step.plane_span.median_s()),
                seconds(step.two_sided.median_s()),
                seconds(step.whole_box.median_s()),
                seconds(
                    figures.load_s(StandIn::Car).unwrap_or_default() + step.init_s + step.fill_s
                ),
            );
        }
        None => text.push_str("Not measured in this run.\n"),
    }
}

fn projections(text: &mut String, figures: &Figures) {
    let of = &figures.projections;
    let [optimised, prepared] = of.percent();
    text.push_str("\n## The two ways of projection\n\n");
    text.push_str(
        "The first way goes onto the plane and then by Voronoi region, the second solves \
        the constrained minimum. Arbitrary triangles and points:\n\n",
    );
    text.push_str(
        "| way | one projection, ns | of the first | the paper |\n|---|---:|---:|---:|\n",
    );
    let _ = writeln!(text, "| first | {:.1} | | |", of.clamped_ns);
    let _ = writeln!(
        text,
        "| second, prepared for every point | {:.1} | {optimised:.0} % | {PAPER_PERCENT:.0} % |",
        of.optimised_ns
    );
    let _ = writeln!(
        text,
        "| second, prepared once for each triangle | {:.1} | {prepared:.0} % | |",
        of.prepared_ns
    );
    text.push_str("\nThe two phases with each, going through triangles and voxels included:\n\n");
    text.push_str(
        "| case | projections | first way, s | second way, s | of the first \
        |\n|---|---:|---:|---:|---:|\n",
    );
    for case in &POINTSHELLS {
        let Some(points) = figures.step(case.stand_in, case.size_mm).map(|step| &step.points)
        else {
            continue;
        };
        let _ = writeln!(
            text,
            "| ({}) | {} | {} | {} | {:.0} % |",
            case.name,
            grouped(points.phases.projections()),
            seconds(points.clamped_s),
            seconds(points.optimised_s),
            100.0 * points.optimised_s / points.clamped_s
        );
    }
}

fn boundary(text: &mut String, figures: &Figures) {
    let [least, most] = PAPER_RECOVERED_PERCENT;
    let _ = write!(
        text,
        "\n## Boundary projections\n\nShare of the projections on edges and corners that the \
            second phase recovers. The paper: {least} to {most} %.\n\n"
    );
    text.push_str(
        "| stand-in | s, mm | inside a triangle | on edges and corners | recovered | share | of \
            all points as shipped |\n",
    );
    text.push_str("|---|---:|---:|---:|---:|---:|---:|\n");
    let mut range = [f64::INFINITY, 0.0];
    for step in &figures.steps {
        let points = &step.points;
        let phases = &points.phases;
        let percent = phases.recovered_percent();
        range = [f64::min(range[0], percent), f64::max(range[1], percent)];
        let _ = writeln!(
            text,
            "| {} | {} | {} | {} | {} | {} % | {} % |",
            step.stand_in.name(),
            step.size_mm,
            grouped(phases.interior),
            grouped(phases.boundary),
            grouped(phases.recovered),
            percent_text(percent),
            percent_text(100.0 * phases.recovered as f64 / step.surface_voxels as f64)
        );
    }
    let _ = writeln!(text, "\nHere: {} to {} %.", percent_text(range[0]), percent_text(range[1]));
}

fn spacing(text: &mut String, figures: &Figures) {
    text.push_str(
        "\n## Spacing of points\n\nDistance of each point to its nearest neighbour, in voxels, of \
            the shipped pointshells. A column says the distance that this share of the points \
            does\nnot exceed.\n\n",
    );
    text.push_str("| case | points |");
    for share in SHARES {
        let head = match share {
            share if share <= 0.0 => " least |".to_owned(),
            share if share >= 1.0 => " largest |".to_owned(),
            share => format!(" {:.0} % |", 100.0 * share),
        };
        text.push_str(&head);
    }
    text.push_str(" below 0.1 |\n|---|---:|");
    text.push_str(&"---:|".repeat(SHARES.len() + 1));
    text.push('\n');
    for case in &POINTSHELLS {
        let Some(step) = figures.step(case.stand_in, case.size_mm) else { continue };
        let points = &step.points;
        let _ = write!(text, "| ({}) | {} |", case.name, grouped(step.surface_voxels as u64));
        for voxels in points.spacing.voxels {
            let _ = write!(text, " {voxels:.3} |");
        }
        let _ = writeln!(text, " {} % |", percent_text(100.0 * points.spacing.same_place_share));
    }
    text.push_str(
        "\nOn a flat face every touched voxel has a touched neighbour across one of its sides, so \
            no point is farther than one voxel from another. Two voxels on\nboth sides of a \
            slightly tilted face project to nearly the same place, which makes the short \
            distances. `crates/vps/tests/acceptance/data_structures.rs` holds both (acceptance \
            test 6).\n",
    );
}

fn paper_name(stand_in: StandIn) -> &'static str {
    match stand_in {
        StandIn::Bracket => "artificial",
        StandIn::Brake => "brake",
        StandIn::Car => "VW Polo",
    }
}

/// Says which cases were not measured.
fn left_out(text: &mut String, names: impl Iterator<Item = char>) {
    let names: Vec<String> = names.map(|name| format!("({name})")).collect();
    if !names.is_empty() {
        let _ = writeln!(text, "\nNot measured in this run: {}.", names.join(", "));
    }
}

/// A ratio of times.
fn times(ratio: f64) -> String {
    if ratio >= 10.0 { format!("{ratio:.1}") } else { format!("{ratio:.2}") }
}

/// Seconds, to what a clock and a reader can tell apart.
fn seconds(seconds: f64) -> String {
    if seconds < 1e-4 { "< 0.0001".to_owned() } else { figure((seconds * 1e6).round() * 1e-6) }
}

fn percent_text(percent: f64) -> String {
    if percent >= 10.0 { format!("{percent:.0}") } else { format!("{percent:.2}") }
}

/// A count with a comma at each thousand.
fn grouped(count: u64) -> String {
    let digits = count.to_string();
    let mut text = String::new();
    for (n, digit) in digits.chars().enumerate() {
        if n > 0 && (digits.len() - n).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_and_times_are_short() {
        assert_eq!([0, 999, 1000, 1_234_567].map(grouped), ["0", "999", "1,000", "1,234,567"]);
        assert_eq!(
            [2e-5, 0.012_345_6, 9860.0, 1.185_6].map(seconds),
            ["< 0.0001", "0.01235", "9860", "1.186"]
        );
        assert_eq!([0.061, 1.3, 42.4].map(percent_text), ["0.06", "1.30", "42"]);
    }
}
