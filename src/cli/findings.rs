//! Findings of `doctor`, `devices` and `devices probe` as JSON.

use serde_json::{Value, json};

use rt::finding::Finding;

/// One finding as an object.
pub(super) fn finding_json(finding: &Finding) -> Value {
    json!({ "name": finding.name, "standing": finding.standing.name(), "found": finding.found, "advice": finding.advice })
}
