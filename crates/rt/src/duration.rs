//! Durations as people write them: `10s`, `500ms`, `2min`.

use std::time::Duration;

/// Units that [`parse`] knows, with their length in seconds.
const UNITS: [(&str, f64); 6] =
    [("us", 1e-6), ("µs", 1e-6), ("ms", 1e-3), ("s", 1.0), ("min", 60.0), ("h", 3600.0)];

/// Longest duration that is accepted, s: a year, far below the 292 years of signed 64-bit
/// nanoseconds.
const LONGEST_S: f64 = 366.0 * 86_400.0;

/// Why a text is not a duration.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "`{text}` is not a duration: write a number and a unit (us, ms, s, min, h), such as 10s, 500ms \
        or 2min"
)]
pub struct DurationError {
    /// The text as given.
    pub text: String,
}

/// Reads a duration: a non-negative decimal number followed by its unit, at most a year.
///
/// # Errors
/// Everything else, a bare number included: a missing unit is the mistake that a unit would have
/// caught.
pub fn parse(text: &str) -> Result<Duration, DurationError> {
    let refused = || DurationError { text: text.to_owned() };
    let trimmed = text.trim();
    let unit_at = trimmed.find(|c: char| !(c.is_ascii_digit() || c == '.')).ok_or_else(refused)?;
    let (number, unit) = trimmed.split_at(unit_at);
    let (_, seconds_per_unit) =
        UNITS.into_iter().find(|(name, _)| *name == unit.trim_start()).ok_or_else(refused)?;
    let seconds = number.parse::<f64>().map_err(|_| refused())? * seconds_per_unit;
    if seconds > LONGEST_S {
        return Err(refused());
    }
    // Whole nanoseconds: "0.1ms" must be 100000 ns, not one less.
    Ok(Duration::from_nanos((seconds * 1e9).round() as u64))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_and_a_unit_make_a_duration() {
        for (text, nanoseconds) in [
            ("10s", 10_000_000_000),
            ("500ms", 500_000_000),
            ("2min", 120_000_000_000),
            ("1h", 3_600_000_000_000),
            ("0.5s", 500_000_000),
            ("0.1ms", 100_000),
            ("250us", 250_000),
            ("250µs", 250_000),
            (" 3 s ", 3_000_000_000),
            ("0s", 0),
        ] {
            assert_eq!(parse(text), Ok(Duration::from_nanos(nanoseconds)), "{text}");
        }
    }

    #[test]
    fn anything_else_is_refused_with_examples() {
        for text in [
            "",
            "10",
            "s",
            "ten s",
            "-1s",
            "1.2.3s",
            "10 parsecs",
            "1e3s",
            "inf s",
            "1000000h",
            "1s2",
        ] {
            let error = parse(text).expect_err(text);
            assert!(error.to_string().contains("500ms"), "{error}");
        }
    }
}
