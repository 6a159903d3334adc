//! Faults that a simulated arm can be told to have: `nan@2s`, `drop=1%`, `drop=20%@500ms`.
//!
//! Grammar: `NAME[=VALUE][@TIME]`. Without a time the fault is there from the start; once there, it stays. Time is the arm's own: one
//! period per read.

use crate::rt::duration;

/// What goes wrong.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FaultKind {
    /// The x position is not a number.
    Nan,
    /// The encoders repeat their value while the counter runs on.
    Stuck,
    /// The x position is off by [`JUMP_M`].
    Jump,
    /// The arm is gone.
    Unplug,
    /// No fresh samples.
    Stall,
    /// Each sample is lost with this probability.
    Drop {
        /// 0..=1
        probability: f64,
    },
    /// The motors push the wrong way.
    SignFlip,
}

/// Size of a counter jump, m: far beyond what an arm moves in a millisecond, within the workspace of every preset.
pub const JUMP_M: f64 = 0.05;

/// A fault and when it begins. `Copy`: the arm consults it in the loop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FaultPlan {
    /// What.
    pub kind: FaultKind,
    /// From when on, s of the arm's time.
    pub start_s: f64,
}

/// Names that this simulated arm can play.
const AVAILABLE: &str = "nan, stuck, jump, unplug, stall, drop=P%, sign-flip";
/// Names of the grammar that need a transport, a motor model or a late reply.
const NOT_AVAILABLE: [&str; 4] = ["garbage", "truncate", "slow", "saturate"];

/// Why a fault specification was refused.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FaultError {
    /// Not a name of the grammar.
    #[error("`{name}` is not a fault: use one of {AVAILABLE}, optionally from a time on, as in nan@2s")]
    Unknown {
        /// The name as given.
        name: String,
    },
    /// A name of the grammar that this arm cannot play.
    #[error("fault `{name}` is not available in this version for a simulated arm: use one of {AVAILABLE}")]
    NotAvailable {
        /// The name as given.
        name: String,
    },
    /// The part after `@` is not a duration.
    #[error("fault `{name}`: {source}")]
    Time {
        /// Name of the fault.
        name: String,
        /// Why.
        source: duration::DurationError,
    },
    /// `drop` without a percentage, or one outside 0..=100.
    #[error("fault `drop` needs a share of the samples from 0% to 100%, as in drop=1%")]
    Share,
    /// A value where none belongs.
    #[error("fault `{name}` takes no value")]
    Value {
        /// Name of the fault.
        name: String,
    },
}

/// Reads a fault specification.
///
/// # Errors
/// See [`FaultError`].
pub fn parse(text: &str) -> Result<FaultPlan, FaultError> {
    let (what, time) = match text.split_once('@') {
        Some((what, time)) => (what, Some(time)),
        None => (text, None),
    };
    let (name, value) = match what.split_once('=') {
        Some((name, value)) => (name.trim(), Some(value)),
        None => (what.trim(), None),
    };
    let kind = match name {
        "nan" => FaultKind::Nan,
        "stuck" => FaultKind::Stuck,
        "jump" => FaultKind::Jump,
        "unplug" => FaultKind::Unplug,
        "stall" => FaultKind::Stall,
        "drop" => FaultKind::Drop { probability: value.and_then(share).ok_or(FaultError::Share)? },
        "sign-flip" => FaultKind::SignFlip,
        name if NOT_AVAILABLE.contains(&name) => return Err(FaultError::NotAvailable { name: name.to_owned() }),
        name => return Err(FaultError::Unknown { name: name.to_owned() }),
    };
    if value.is_some() && !matches!(kind, FaultKind::Drop { .. }) {
        return Err(FaultError::Value { name: name.to_owned() });
    }
    let start_s = match time {
        Some(time) => duration::parse(time).map_err(|source| FaultError::Time { name: name.to_owned(), source })?.as_secs_f64(),
        None => 0.0,
    };
    Ok(FaultPlan { kind, start_s })
}

fn share(text: &str) -> Option<f64> {
    let percent: f64 = text.trim().strip_suffix('%')?.trim_end().parse().ok()?;
    (0.0..=100.0).contains(&percent).then_some(percent / 100.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_grammar_is_read() {
        for (text, kind, start_s) in [
            ("nan@2s", FaultKind::Nan, 2.0),
            ("stuck@500ms", FaultKind::Stuck, 0.5),
            ("jump@2s", FaultKind::Jump, 2.0),
            ("unplug", FaultKind::Unplug, 0.0),
            ("stall@1min", FaultKind::Stall, 60.0),
            ("drop=1%", FaultKind::Drop { probability: 0.01 }, 0.0),
            ("drop=20%@3s", FaultKind::Drop { probability: 0.2 }, 3.0),
            ("sign-flip@2s", FaultKind::SignFlip, 2.0),
        ] {
            assert_eq!(parse(text), Ok(FaultPlan { kind, start_s }), "{text}");
        }
    }

    #[test]
    fn refusals_say_what_would_do() {
        for (text, fragment) in [
            ("melt@2s", "`melt` is not a fault"),
            ("", "is not a fault"),
            ("slow=4ms", "not available in this version"),
            ("garbage@2s", "not available in this version"),
            ("drop", "drop=1%"),
            ("drop=101%", "0% to 100%"),
            ("drop=0.5", "0% to 100%"),
            ("drop=nan%", "0% to 100%"),
            ("nan@2", "is not a duration"),
            ("nan=3@2s", "takes no value"),
        ] {
            let error = parse(text).expect_err(text).to_string();
            assert!(error.contains(fragment), "{text}: {error}");
        }
    }
}
