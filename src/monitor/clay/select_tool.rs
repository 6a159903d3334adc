//! Another tool, or other settings of the tool on clay, as clients ask for them.

use serde::Deserialize;
use serde_json::Value;

use super::super::problem::RequestError;
use clay::engine::{ClayView, SculptTool, ToolChange};
use clay::falloff::Falloff;
use clay::material_map::Painted;

/// What is to change; what is not given stays.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(in crate::monitor) struct TakeAsked {
    /// The word of the API of version 1 for the kind of tool.
    craft: Option<String>,
    brush_m: Option<f64>,
    /// A word or weights.
    falloff: Option<Value>,
    /// `#rrggbb`.
    color: Option<String>,
    /// All of it: what it does not name is not painted.
    painted: Option<PaintedAsked>,
    depth_m: Option<f64>,
    is_sharp: Option<bool>,
}

/// A material to paint.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct PaintedAsked {
    mass_kg: Option<f32>,
    damping_n_s_per_m: Option<f32>,
    stiffness_n_per_m: Option<f32>,
}

impl TakeAsked {
    /// What is asked for, checked against the clay as it is.
    pub(super) fn checked(self, view: &ClayView) -> Result<ToolChange, RequestError> {
        if self == Self::default() {
            let hint = "`craft`, `brush_m`, `falloff`, `color`, `painted`, `depth_m` or `is_sharp`";
            return Err(RequestError::bad("nothing is to be taken", hint));
        }
        let (least_m, most_m) = brush_range(view);
        if let Some(brush_m) = self.brush_m.filter(|brush_m| !(least_m..=most_m).contains(brush_m))
        {
            let error =
                format!("`brush_m` goes from {least_m:.2e} to {most_m:.2e}, not to {brush_m}");
            return Err(RequestError::bad(
                error,
                "a radius in m, of at least one sample and at most half the region",
            ));
        }
        if let Some(depth_m) =
            self.depth_m.filter(|depth_m| !(*depth_m > 0.0 && *depth_m <= most_m))
        {
            let error = format!("`depth_m` goes above 0 up to {most_m:.2e}, not to {depth_m}");
            return Err(RequestError::bad(error, "engraving sinks by it, embossing raises"));
        }
        let kind = |word: String| {
            SculptTool::of(&word).ok_or_else(|| {
                RequestError::bad(format!("no tool is called `{word}`"), known_tools())
            })
        };
        let color = |text: String| {
            color_of(&text).ok_or_else(|| {
                RequestError::bad(format!("`{text}` is no color #rrggbb"), "such as \"#c83c28\"")
            })
        };
        Ok(ToolChange {
            kind: self.craft.map(kind).transpose()?,
            brush_m: self.brush_m,
            falloff: self.falloff.as_ref().map(falloff_of).transpose()?,
            color: self.color.map(color).transpose()?,
            painted: self.painted.map(painted_of).transpose()?,
            depth_m: self.depth_m,
            image: None,
            solid: None,
            is_sharp: self.is_sharp,
        })
    }
}

pub(super) fn painted_of(asked: PaintedAsked) -> Result<Painted, RequestError> {
    let PaintedAsked { mass_kg, damping_n_s_per_m, stiffness_n_per_m } = asked;
    let painted = Painted { mass_kg, damping_n_s_per_m, stiffness_n_per_m };
    match painted.unsound() {
        Some((name, value, unit)) => Err(RequestError::bad(
            format!("{name} of {value} {unit} cannot be painted"),
            Painted::KNOWN_GOOD,
        )),
        None => Ok(painted),
    }
}

/// Smallest and largest radius of a brush that clients may take, m: a sample, and half of the
/// region.
pub(super) fn brush_range(view: &ClayView) -> (f64, f64) {
    let (low, high) = view.region_map;
    let least_m = view.spacing_m.max(1e-6);
    (least_m, (0.5 * (high - low).max_element()).max(2.0 * least_m))
}

/// A colour as text.
pub(super) fn color_text([red, green, blue]: [u8; 3]) -> String {
    format!("#{red:02x}{green:02x}{blue:02x}")
}

fn color_of(text: &str) -> Option<[u8; 3]> {
    let hex = text
        .strip_prefix('#')
        .filter(|hex| hex.len() == 6 && hex.bytes().all(|digit| digit.is_ascii_hexdigit()))?;
    let [_, red, green, blue] = u32::from_str_radix(hex, 16).ok()?.to_be_bytes();
    Some([red, green, blue])
}

pub(super) fn falloff_of(asked: &Value) -> Result<Falloff, RequestError> {
    let hint = "\"gaussian\", \"constant\", \"spherical\", { \"rate\": 2 } or a list of at least \
        two weights from 0 to 1";
    let refused = |what: &str| RequestError::bad(what, hint);
    match asked {
        Value::String(word) => [Falloff::Gaussian, Falloff::Constant, Falloff::Spherical]
            .into_iter()
            .find(|known| known.to_string() == *word)
            .ok_or_else(|| refused(&format!("no fall-off is called `{word}`"))),
        Value::Array(weights) => {
            let weights: Option<Vec<_>> = weights.iter().map(Value::as_f64).collect();
            let weights = weights.ok_or_else(|| refused("weights of a fall-off are numbers"))?;
            Falloff::table(weights).map_err(|error| refused(&error.to_string()))
        }
        Value::Object(table) if table.len() == 1 && table.contains_key("rate") => {
            let rate = asked["rate"]
                .as_f64()
                .ok_or_else(|| refused("the rate of a fall-off is a number"))?;
            Falloff::rate(rate).map_err(|error| refused(&error.to_string()))
        }
        _ => Err(refused("`falloff` is a word, a rate or a list of weights")),
    }
}

fn known_tools() -> String {
    let names: Vec<_> = SculptTool::NAMES.iter().map(|(name, _)| *name).collect();
    format!("known: {}", names.join(", "))
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::super::tests::view_of;
    use super::*;
    use clay::PointSet;
    use clay::engine::ToolSettings;

    fn taken(asked: Value) -> Result<ToolSettings, String> {
        taken_after(ToolSettings::default(), asked)
    }

    fn taken_after(before: ToolSettings, asked: Value) -> Result<ToolSettings, String> {
        let asked = TakeAsked::deserialize(asked).map_err(|error| error.to_string())?;
        let change = asked
            .checked(&view_of(PointSet::default(), 1))
            .map_err(|problem| problem.said.error)?;
        Ok(change.onto(&before))
    }

    #[test]
    fn what_is_not_given_stays() {
        let before = ToolSettings::default();
        assert_eq!(
            taken(json!({ "craft": "pull-curve" })),
            Ok(ToolSettings { kind: SculptTool::PullCurve, ..before.clone() })
        );
        assert_eq!(
            taken(
                json!({ "brush_m": 0.004, "color": "#0aFF10", "falloff": [1, 0.5], "is_sharp": true, "depth_m": 0.002, "painted": { "mass_kg": 1e-3 } })
            ),
            Ok(ToolSettings {
                painted: Painted { mass_kg: Some(1e-3), ..Painted::default() },
                brush_m: 0.004,
                color: [10, 255, 16],
                falloff: Falloff::Table(vec![1.0, 0.5]),
                is_sharp: true,
                depth_m: 0.002,
                ..before
            })
        );
        let forgotten = ToolSettings {
            painted: Painted { mass_kg: Some(1e-3), ..Painted::default() },
            ..ToolSettings::default()
        };
        let taken = taken_after(forgotten, json!({ "painted": { "damping_n_s_per_m": null } }));
        assert_eq!(
            taken.map(|tool| tool.painted),
            Ok(Painted::default()),
            "a material is taken as a whole"
        );
        assert_eq!(color_text([10, 255, 16]), "#0aff10");
    }

    #[test]
    fn what_makes_no_sense_is_refused_in_words() {
        for (asked, expected) in [
            (json!({}), "nothing"),
            (json!({ "craft": "knit" }), "knit"),
            (json!({ "brush": 1 }), "brush"),
            (json!({ "brush_m": 0.0 }), "brush_m"),
            (json!({ "brush_m": 5 }), "brush_m"),
            (json!({ "brush_m": "wide" }), "wide"),
            (json!({ "depth_m": -1e-3 }), "depth_m"),
            (json!({ "color": "red" }), "#rrggbb"),
            (json!({ "color": "#ff00ß" }), "#rrggbb"),
            (json!({ "color": "#+12345" }), "#rrggbb"),
            (json!({ "painted": { "stiffness_n_per_m": 0.0 } }), "a stiffness of 0 N/m"),
            (json!({ "painted": { "mass_kg": 2.0 } }), "a mass of 2 kg"),
            (json!({ "painted": { "damping_n_s_per_m": -1 } }), "a damping of -1 N·s/m"),
            (json!({ "painted": { "stiffness": 10 } }), "stiffness"),
            (json!({ "painted": 10 }), "10"),
            (json!({ "falloff": "square" }), "square"),
            (json!({ "falloff": [1] }), "at least 2"),
            (json!({ "falloff": [1, "half"] }), "numbers"),
            (json!({ "falloff": 3 }), "a word"),
            (json!({ "falloff": { "rate": 0 } }), "from 0.1 to 100"),
            (json!({ "falloff": { "rate": "steep" } }), "a number"),
            (json!({ "falloff": { "power": 2 } }), "a word"),
        ] {
            let error = taken(asked.clone()).expect_err(&asked.to_string());
            assert!(error.contains(expected), "{asked}: {error}");
        }
    }
}
