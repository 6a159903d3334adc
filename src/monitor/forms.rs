//! How requests are written, for answers to malformed ones.

use serde::de::DeserializeOwned;
use serde_json::{Map, Value};

/// One request of each kind: its `do`, and what goes with it.
const FORMS: [(&str, &str); 24] = [
    ("subscribe", r#""rate_hz": 60, "format": "json", "contacts": true, "history": true"#),
    ("enable", ""),
    ("disable", ""),
    ("stop", ""),
    ("set", r#""parameter": "contact_stiffness_n_per_m", "value": 800"#),
    ("place", r#""object": "lift", "pose": {"p": [0, 0, 0.01], "q": [0, 0, 0, 1]}"#),
    ("hand", r#""pose": {"p": [0, 0, 0.01], "q": [0, 0, 0, 1]}, "scene_idx": 0"#),
    ("restart_hand", ""),
    ("reset", ""),
    ("switch", r#""scene": "peg""#),
    ("record", r#""file": "trial.mcap""#),
    ("end_recording", ""),
    ("heartbeat", r#""timeout_ms": 500"#),
    ("clay_take", r##""craft": "paint", "brush_m": 0.004, "color": "#c83c28""##),
    ("clay_draw", r#""curves_m": [[[-0.005, 0, 0.004], [0.005, 0, 0.004]]]"#),
    (
        "clay_pull",
        r#""curves_m": [[[-0.005, 0, 0.004], [0.005, 0, 0.004]]], "force_n": [0, 0, 3], "time_s": 0.5"#,
    ),
    ("clay_region", r#""min": [-0.01, -0.01, 0], "max": [0.01, 0.01, 0.02]"#),
    (
        "clay_lay",
        r#""painted": {"stiffness_n_per_m": 500}, "ball": {"center": [0, 0, 0.01], "radius_m": 0.005}"#,
    ),
    (
        "clay_combine",
        r#""boolean": "union", "shape": {"sphere_m": 0.005}, "pose": {"p": [0, 0, 0.02], "q": [0, 0, 0, 1]}"#,
    ),
    ("clay_hold", r#""held": true"#),
    ("clay_undo", ""),
    ("clay_redo", ""),
    ("clay_save", r#""kind": "session", "file": "bowl""#),
    ("ping", ""),
];

/// How a request is written, as a hint: over the WebSocket, or as a body.
pub(super) fn such_as(command: &str, has_do: bool) -> String {
    let Some((_, fields)) = FORMS.iter().find(|(known, _)| *known == command) else {
        return String::new();
    };
    let name = if has_do { format!("\"do\": \"{command}\"") } else { String::new() };
    let between = if name.is_empty() || fields.is_empty() { "" } else { ", " };
    format!("such as {{{name}{between}{fields}}}")
}

/// Keys that are looked at one by one for the wrong one.
const MOST_KEYS: usize = 16;

/// Reads an object; what is wrong, and with which key, behind `before`.
pub(super) fn read<T: DeserializeOwned>(
    object: Map<String, Value>,
    before: &str,
) -> Result<T, String> {
    let whole = Value::Object(object);
    let error = match T::deserialize(&whole) {
        Ok(read) => return Ok(read),
        Err(error) => error.to_string(),
    };
    // A value of another type is reported without its key: it is the one without which something
    // else is wrong, or nothing.
    let is_wrong = |key: &&String| {
        let mut others = whole.clone();
        others.as_object_mut().and_then(|others| others.remove(*key));
        *key != "do" && T::deserialize(&others).err().is_none_or(|other| other.to_string() != error)
    };
    let keys = whole
        .as_object()
        .filter(|object| error.starts_with("invalid") && object.len() <= MOST_KEYS);
    Err(match keys.and_then(|object| object.keys().find(is_wrong)) {
        Some(key) => format!("{before}`{key}`: {error}"),
        None => format!("{before}{error}"),
    })
}

#[cfg(test)]
mod tests {
    use super::super::asks::ClientCommand;
    use super::*;

    #[test]
    fn every_form_that_is_shown_is_understood() {
        for (command, _) in FORMS {
            let form = such_as(command, true);
            let asked = ClientCommand::parse(form.strip_prefix("such as ").unwrap().as_bytes()).1;
            assert!(asked.is_ok(), "{form}: {asked:?}");
            assert!(!such_as(command, false).contains("\"do\""));
        }
        let hint_of = |text: &str| ClientCommand::parse(text.as_bytes()).1.unwrap_err().said.hint;
        assert!(hint_of(r#"{"do":"clay_hold"}"#).contains("\"held\": true"));
        assert_eq!(hint_of(r#"{"do":"fly"}"#), "", "the known ones are listed");
    }
}
