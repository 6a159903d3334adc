//! Findings of `doctor`, `devices` and `devices probe`: for people, and as JSON.

use serde_json::{Value, json};

use super::output;
use rt::finding::Finding;
use vps::storage::printable::one_line;

/// One finding as an object.
pub(super) fn finding_json(finding: &Finding) -> Value {
    json!({ "name": finding.name, "standing": finding.standing.name(), "found": finding.found, "advice": finding.advice })
}

/// One finding in columns, with its advice below it. `name_width`: of the column of names.
pub(super) fn print(finding: &Finding, indent: &str, name_width: usize) {
    // What devices call themselves may be in it.
    let row = |standing: &str, name: &str, text: &str| {
        output::result(format_args!(
            "{indent}{standing:<8} {name:<name_width$} {}\n",
            one_line(text)
        ));
    };
    row(finding.standing.name(), &finding.name, &finding.found);
    finding.advice_lines().for_each(|line| row("", "", &line));
}
