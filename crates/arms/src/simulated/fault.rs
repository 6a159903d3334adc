//! Faults that can be injected into a simulated arm: `nan@2s`, `drop=1%`, `slow=4ms@500ms`,
//! `unplug@2s+500ms`.
//!
//! Grammar: `NAME[=VALUE][@START[+LENGTH]]`. Without a start the fault is there from the beginning,
//! without a length it stays. The end of an `unplug` is the plug going in again. Time is the arm's
//! own: one period per read in the process, its real clock as a mock.
//!
//! | fault | simulated arm in the process | mock arm on a real link |
//! |---|---|---|
//! | `drop=P%` | a sample does not come | a frame is not sent |
//! | `stall` | no fresh samples; commands arrive | sends nothing; commands arrive |
//! | `deaf` | commands are lost; fresh samples | reads nothing, without a hang-up: what the host writes stays in the tty until it wakes. It sends what it sends unasked; with `stall` it hangs. Its watchdog, where it has one, goes on |
//! | `nan` | x of the position is not a number | a reading is not a number; where the wire has whole numbers, it reads 0 |
//! | `garbage` | a corrupt packet | random bytes in place of the frame |
//! | `truncate` | a corrupt packet | the second half of the frame is missing |
//! | `lost-byte` | a corrupt packet | one byte in the middle of the frame is missing |
//! | `repeat` | every other sample is the one before again | a frame is sent twice |
//! | `reorder` | every other sample is the one before again | frames change places two by two |
//! | `unplug` | the arm is gone | the node goes away |
//! | `slow=T` | a sample comes T after it was measured, and none in between | a frame is sent T later |
//! | `stuck` | the encoders repeat their value while the counter runs on | the same |
//! | `jump` | x is off by [`JUMP_M`] | the same |
//! | `sign-flip` | the motors push the wrong way | the same |
//! | `unhome` | the arm has lost its zero | the same, where the protocol says so |
//! | `skip=N` | the arm's counter runs ahead by N, once | the arm answers N more times, once, and all of that is lost |
//! | `no-velocity` | the velocity reads 0 | the same, where the wire has velocities |
//! | `sleep` | nothing: it has no grip of its own | the grip sleeps, and its orientation stands still, where the protocol has such a grip |
//! | `press=N` | no fault: button N, 0 to 31, is held | the same, where the protocol has buttons |
//! | `saturate` | each axis gives [`SATURATED_SHARE`] of the arm's limit at most, and the arm does not say so | the same |

use rt::duration;

/// What goes wrong.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FaultKind {
    /// Each sample is lost with this probability.
    Drop {
        /// 0..=1
        probability: f64,
    },
    /// No fresh samples.
    Stall,
    /// Receives nothing, and the link stays up.
    Deaf,
    /// The x position is not a number.
    Nan,
    /// What comes is not a report.
    Garbage,
    /// The arm is gone.
    Unplug,
    /// Samples come late.
    Slow {
        /// By this much, s.
        delay_s: f64,
    },
    /// The encoders repeat their value while the counter runs on.
    Stuck,
    /// The x position is off by [`JUMP_M`].
    Jump,
    /// Reports end in the middle.
    Truncate,
    /// Reports lack a byte in the middle.
    LostByte,
    /// Reports come twice.
    Repeat,
    /// Reports change places two by two.
    Reorder,
    /// The motors push the wrong way.
    SignFlip,
    /// The motors give [`SATURATED_SHARE`] of the arm's limit per axis at most.
    Saturate,
    /// The arm has lost its zero.
    Unhome,
    /// Samples are lost on the way, all at once, and the arm's counter says so.
    Skip {
        /// How many.
        samples: u16,
    },
    /// The velocity reads 0.
    NoVelocity,
    /// What measures the orientation apart from the arm sleeps.
    Sleep,
    /// No fault, but it happens on demand like one: a button is held.
    Press {
        /// 0..=31
        button: u8,
    },
}

/// Size of a counter jump, m: far beyond what an arm moves in a millisecond, within the workspace
/// of every preset.
pub const JUMP_M: f64 = 0.05;

/// What is left of the motors when they saturate: low enough that ordinary contact runs into it.
pub const SATURATED_SHARE: f64 = 0.25;

/// Longest delay of `slow`, s: beyond it an arm has stalled.
const SLOWEST_S: f64 = 1.0;

/// Most samples that `skip` loses: ten seconds of them, and far from where a counter of 16 bits
/// comes round.
const MOST_SKIPPED: u16 = 10_000;

/// A fault and when it is there. `Copy`: the arm consults it in the loop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FaultPlan {
    /// What goes wrong.
    pub kind: FaultKind,
    /// From when on, s of the arm's time.
    pub start_s: f64,
    /// Until when; infinite: for ever.
    end_s: f64,
}

impl FaultPlan {
    /// A fault that stays.
    pub fn from(kind: FaultKind, start_s: f64) -> Self {
        Self { kind, start_s, end_s: f64::INFINITY }
    }

    /// What is wrong in the tick at `now_s`. RT: safe.
    pub(crate) fn active(&self, now_s: f64, period_s: f64) -> Option<FaultKind> {
        // Half a period early: the tick that is nearest to the time asked for.
        let now_s = now_s + 0.5 * period_s;
        (now_s >= self.start_s && now_s < self.end_s).then_some(self.kind)
    }

    /// True in the first tick of the fault. RT: safe.
    pub(super) fn begins(&self, now_s: f64, period_s: f64) -> bool {
        self.active(now_s, period_s).is_some() && (now_s - 0.5 * period_s < self.start_s)
    }
}

/// Names of the grammar.
pub const NAMES: [&str; 19] = [
    "drop",
    "stall",
    "deaf",
    "nan",
    "garbage",
    "unplug",
    "slow",
    "stuck",
    "jump",
    "truncate",
    "lost-byte",
    "repeat",
    "reorder",
    "sign-flip",
    "saturate",
    "unhome",
    "skip",
    "no-velocity",
    "press",
];

/// Names with the values that some of them take, for people.
const USAGE: &str = "drop=P%, stall, deaf, nan, garbage, unplug, slow=TIME, stuck, jump, truncate, \
    lost-byte, repeat, reorder, sign-flip, saturate, unhome, skip=COUNT, no-velocity, press=BUTTON";

/// Why a fault specification was refused.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FaultError {
    /// Not a name of the grammar.
    #[error(
        "`{name}` is not a fault: use one of {USAGE}, optionally from a time on and for how long, \
            as in nan@2s or unplug@2s+500ms"
    )]
    Unknown {
        /// The name as given.
        name: String,
    },
    /// The part after `@`, or a length, is not a duration.
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
    /// `slow` without a delay, or one that is zero or too long.
    #[error("fault `slow` needs a delay above 0 and up to 1s, as in slow=4ms")]
    Delay,
    /// `skip` without a count, or one that the counter of no arm can show.
    #[error("fault `skip` needs a number of samples from 1 to 10000, as in skip=40@2s")]
    Count,
    /// `press` without a button, or one that there is not.
    #[error("`press` needs the number of a button from 0 to 31, as in press=0@1s+500ms")]
    Button,
    /// A fault that ends when it begins.
    #[error("fault `{name}` needs a length above 0, as in {name}@2s+500ms")]
    Length {
        /// Name of the fault.
        name: String,
    },
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
        "drop" => FaultKind::Drop { probability: value.and_then(share).ok_or(FaultError::Share)? },
        "stall" => FaultKind::Stall,
        "deaf" => FaultKind::Deaf,
        "nan" => FaultKind::Nan,
        "garbage" => FaultKind::Garbage,
        "unplug" => FaultKind::Unplug,
        "slow" => FaultKind::Slow { delay_s: value.and_then(delay).ok_or(FaultError::Delay)? },
        "stuck" => FaultKind::Stuck,
        "jump" => FaultKind::Jump,
        "truncate" => FaultKind::Truncate,
        "lost-byte" => FaultKind::LostByte,
        "repeat" => FaultKind::Repeat,
        "reorder" => FaultKind::Reorder,
        "sign-flip" => FaultKind::SignFlip,
        "saturate" => FaultKind::Saturate,
        "unhome" => FaultKind::Unhome,
        "skip" => FaultKind::Skip { samples: value.and_then(count).ok_or(FaultError::Count)? },
        "no-velocity" => FaultKind::NoVelocity,
        "sleep" => FaultKind::Sleep,
        "press" => FaultKind::Press { button: value.and_then(button).ok_or(FaultError::Button)? },
        name => return Err(FaultError::Unknown { name: name.to_owned() }),
    };
    let takes_value = matches!(
        kind,
        FaultKind::Drop { .. }
            | FaultKind::Slow { .. }
            | FaultKind::Skip { .. }
            | FaultKind::Press { .. }
    );
    if value.is_some() && !takes_value {
        return Err(FaultError::Value { name: name.to_owned() });
    }
    let seconds = |text: &str| match duration::parse(text) {
        Ok(time) => Ok(time.as_secs_f64()),
        Err(source) => Err(FaultError::Time { name: name.to_owned(), source }),
    };
    let (start_s, end_s) = match time.map(|time| {
        time.split_once('+').map_or((time, None), |(start, length)| (start, Some(length)))
    }) {
        None => (0.0, f64::INFINITY),
        Some((start, None)) => (seconds(start)?, f64::INFINITY),
        Some((start, Some(length))) => {
            let start_s = seconds(start)?;
            let length_s = seconds(length)?;
            if length_s == 0.0 {
                return Err(FaultError::Length { name: name.to_owned() });
            }
            (start_s, start_s + length_s)
        }
    };
    Ok(FaultPlan { kind, start_s, end_s })
}

fn share(text: &str) -> Option<f64> {
    let percent: f64 = text.trim().strip_suffix('%')?.trim_end().parse().ok()?;
    (0.0..=100.0).contains(&percent).then_some(percent / 100.0)
}

fn button(text: &str) -> Option<u8> {
    text.trim().parse().ok().filter(|button| u32::from(*button) < u32::BITS)
}

fn count(text: &str) -> Option<u16> {
    text.trim().parse().ok().filter(|count| (1..=MOST_SKIPPED).contains(count))
}

fn delay(text: &str) -> Option<f64> {
    let delay_s = duration::parse(text).ok()?.as_secs_f64();
    (delay_s > 0.0 && delay_s <= SLOWEST_S).then_some(delay_s)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_grammar_is_read() {
        const EVER: f64 = f64::INFINITY;
        for (text, kind, start_s, end_s) in [
            ("nan@2s", FaultKind::Nan, 2.0, EVER),
            ("stuck@500ms", FaultKind::Stuck, 0.5, EVER),
            ("jump@2s+1ms", FaultKind::Jump, 2.0, 2.001),
            ("unplug", FaultKind::Unplug, 0.0, EVER),
            ("unplug@2s+500ms", FaultKind::Unplug, 2.0, 2.5),
            ("stall@1min", FaultKind::Stall, 60.0, EVER),
            ("drop=1%", FaultKind::Drop { probability: 0.01 }, 0.0, EVER),
            ("drop=20%@3s+1s", FaultKind::Drop { probability: 0.2 }, 3.0, 4.0),
            ("slow=4ms", FaultKind::Slow { delay_s: 0.004 }, 0.0, EVER),
            ("slow=4ms@1s", FaultKind::Slow { delay_s: 0.004 }, 1.0, EVER),
            ("garbage@2s", FaultKind::Garbage, 2.0, EVER),
            ("truncate", FaultKind::Truncate, 0.0, EVER),
            ("deaf@2s+500ms", FaultKind::Deaf, 2.0, 2.5),
            ("lost-byte@2s+1ms", FaultKind::LostByte, 2.0, 2.001),
            ("repeat@2s", FaultKind::Repeat, 2.0, EVER),
            ("reorder@2s", FaultKind::Reorder, 2.0, EVER),
            ("sign-flip@2s", FaultKind::SignFlip, 2.0, EVER),
            ("saturate@2s", FaultKind::Saturate, 2.0, EVER),
            ("skip=40@2s", FaultKind::Skip { samples: 40 }, 2.0, EVER),
            ("no-velocity@1s", FaultKind::NoVelocity, 1.0, EVER),
        ] {
            assert_eq!(parse(text), Ok(FaultPlan { kind, start_s, end_s }), "{text}");
        }
    }

    #[test]
    fn every_name_is_in_the_grammar_and_in_its_help() {
        for name in NAMES {
            let error = parse(&format!("{name}=?")).expect_err(name).to_string();
            assert!(!error.contains("is not a fault"), "{error}");
            assert!(USAGE.contains(name));
        }
    }

    #[test]
    fn a_fault_is_there_from_its_first_tick_to_its_last() {
        let plan = parse("stall@10ms+5ms").expect("grammar");
        let active: Vec<u32> =
            (0..30).filter(|&n| plan.active(f64::from(n) * 1e-3, 1e-3).is_some()).collect();
        assert_eq!(active, [10, 11, 12, 13, 14]);
        let first: Vec<u32> = (0..30).filter(|&n| plan.begins(f64::from(n) * 1e-3, 1e-3)).collect();
        assert_eq!(first, [10]);
        assert!(parse("stall").expect("grammar").begins(0.0, 1e-3));
    }

    #[test]
    fn refusals_say_what_would_do() {
        for (text, fragment) in [
            ("melt@2s", "`melt` is not a fault"),
            ("", "is not a fault"),
            ("slow", "slow=4ms"),
            ("slow=2s", "up to 1s"),
            ("slow=0ms", "above 0"),
            ("drop", "drop=1%"),
            ("drop=101%", "0% to 100%"),
            ("drop=0.5", "0% to 100%"),
            ("drop=nan%", "0% to 100%"),
            ("nan@2", "is not a duration"),
            ("nan@2s+5", "is not a duration"),
            ("nan@2s+0s", "nan@2s+500ms"),
            ("nan=3@2s", "takes no value"),
            ("press", "press=0"),
            ("press=32", "0 to 31"),
            ("unhome=1", "takes no value"),
            ("skip", "skip=40"),
            ("skip=0", "from 1 to 10000"),
            ("skip=10001", "from 1 to 10000"),
            ("no-velocity=1", "takes no value"),
        ] {
            let error = parse(text).expect_err(text).to_string();
            assert!(error.contains(fragment), "{text}: {error}");
        }
    }
}
