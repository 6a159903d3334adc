//! The tables that say what to choose.

use core::fmt::Write as _;

use super::super::super::report::figure;
use super::super::fields::{Depths, Measured};
use super::COUPLINGS;
use super::insertion::InsertionResult;
use super::slides::{SlideFigures, SlideResult};

/// Two short tables: fields, then couplings.
pub(super) fn choice(
    measured: &[Measured],
    slides: &[SlideResult],
    insertions: &[InsertionResult],
) -> String {
    let number = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), figure);
    let worst = |family: &str, depths: Depths, of: &dyn Fn(&Measured) -> Option<f64>| {
        let here = measured.iter().filter(|m| m.depths == depths && m.family.starts_with(family));
        number(here.filter_map(of).reduce(f64::max))
    };
    let mut text = String::from("\n## what to choose\n\nWorst paths of Q1 to Q3.\n\n");
    text.push_str(
        "| field | Q1 angle, mean ° | Q1 ripple % | Q2 angle, mean ° | Q2 ripple % | Q3 \
        force, mean % | Q3 ripple % | query, mean µs |\n",
    );
    text.push_str("|---|---:|---:|---:|---:|---:|---:|---:|\n");
    for depths in Depths::ALL {
        let angle = |m: &Measured| m.angle_deg.map(|spread| spread.mean);
        let ripple = |m: &Measured| m.ripple_percent;
        let _ = writeln!(
            text,
            "| {} | {} | {} | {} | {} | {} | {} | {} |",
            depths.name(),
            worst("Q1", depths, &angle),
            worst("Q1", depths, &ripple),
            worst("Q2", depths, &angle),
            worst("Q2", depths, &ripple),
            worst("Q3", depths, &|m| Some(m.magnitude_percent.mean)),
            worst("Q3", depths, &ripple),
            worst("", depths, &|m| m.query_us.map(|spread| spread.mean)),
        );
    }
    text.push_str(
        "\nQ1 up a slope of 10° on the ideal arm; the peg on the simulated sigma.7-class \
        arm.\n\n",
    );
    text.push_str(
        "| coupling | ripple, trilinear % | raw % | delay, trilinear ms | low-pass off \
        ms | peg: depth mm | time s | peak N | ripple N | contact changes |\n",
    );
    text.push_str("|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|\n");
    for coupling in COUPLINGS {
        let slid = |what: &str| {
            let here =
                slides.iter().find(|slid| slid.coupling == coupling && slid.what.starts_with(what));
            here.and_then(|slid| slid.figures.as_ref().ok())
        };
        let delay = |figures: &SlideFigures| figures.delay_s.map(|delay_s| delay_s * 1e3);
        let peg = insertions
            .iter()
            .find(|peg| peg.coupling == coupling)
            .and_then(|peg| peg.figures.as_ref().ok());
        let _ = writeln!(
            text,
            "| {coupling} | {} | {} | {} | {} | {} | {} | {} | {} | {} |",
            number(slid("trilinear").and_then(|figures| figures.ripple_percent)),
            number(slid("raw").and_then(|figures| figures.ripple_percent)),
            number(slid("trilinear").and_then(delay)),
            number(slid("trilinear, low-pass off").and_then(delay)),
            number(peg.map(|peg| peg.depth_mm)),
            number(peg.and_then(|peg| peg.inserted_s)),
            number(peg.map(|peg| peg.peak_n)),
            number(peg.and_then(|peg| peg.ripple_n)),
            number(peg.map(|peg| peg.changes_at_rest as f64)),
        );
    }
    text
}
