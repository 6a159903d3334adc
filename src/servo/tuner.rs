//! Parameters, from any thread into the loop.
#![expect(clippy::disallowed_types, reason = "filled on the cold side, never resized")]

use rtrb::{Consumer, Producer, PushError, RingBuffer};

use super::Lowered;
use crate::haptics::{Knob, KnobRange, Parameters, Tune};

/// Tunes under way: a slider that somebody drags gives some tens a second, the loop takes one per tick.
const RING_TUNES: usize = 64;

/// Why a parameter was not set.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum TuneError {
    /// Nothing that can be set here is called so.
    #[error("no parameter of this scene is called `{name}`; known here: {}", known.join(", "))]
    Unknown {
        /// As asked for.
        name: String,
        /// What can be set.
        known: Vec<&'static str>,
    },
    /// Outside of its range, or not a number.
    #[error("`{name}` goes from {} to {}, not to {value}", range.least, range.most)]
    Range {
        /// Which.
        name: &'static str,
        /// As asked for.
        value: f64,
        /// What would do.
        range: KnobRange,
    },
    /// Tunes come faster than one per tick.
    #[error("more changes than ticks: {RING_TUNES} are waiting")]
    Full,
    /// The loop has ended, or renders another scene now.
    #[error("the scene is not rendered any more")]
    Over,
}

/// The cold end: turns the knobs of one scene, and ends with it.
#[derive(Debug)]
pub struct Tuner {
    /// What can be turned, how far, and the last value that was asked for.
    knobs: Vec<(Knob, KnobRange, f64)>,
    ring: Producer<Tune>,
}

impl Tuner {
    /// Both ends, for a scene of these parameters. Allocates.
    pub fn new(parameters: &Parameters) -> (Self, Consumer<Tune>) {
        let (ring, consumer) = RingBuffer::new(RING_TUNES);
        let known = |knob: Knob| knob.range(parameters).map(|range| (knob, range, range.scene));
        (Self { knobs: Knob::ALL.into_iter().filter_map(known).collect(), ring }, consumer)
    }

    /// What can be turned, how far, and where it stands or goes to.
    pub fn knobs(&self) -> &[(Knob, KnobRange, f64)] {
        &self.knobs
    }

    /// The loop has ended, or renders another scene now.
    pub fn is_over(&self) -> bool {
        self.ring.is_abandoned()
    }

    /// Turns a knob, by its name. It gets there along a ramp, see [`Tune`](crate::haptics::Tune). Wait-free.
    ///
    /// # Errors
    /// See [`TuneError`]; nothing changes then.
    pub fn set(&mut self, name: &str, value: f64) -> Result<(), TuneError> {
        self.set_all([(name, value)])
    }

    /// Turns several knobs, or none of them.
    ///
    /// # Errors
    /// As [`Self::set`], for the first one that will not do; nothing changes then.
    pub fn set_all<'n>(&mut self, values: impl IntoIterator<Item = (&'n str, f64)>) -> Result<(), TuneError> {
        let mut tunes = Vec::new();
        for (name, value) in values {
            let Some((place, (knob, range, _))) = self.knobs.iter().enumerate().find(|(_, (knob, ..))| knob.name() == name) else {
                let known = self.knobs.iter().map(|(knob, ..)| knob.name()).collect();
                return Err(TuneError::Unknown { name: name.to_owned(), known });
            };
            // Written so that a NaN is refused as well.
            if !(value >= range.least && value <= range.most) {
                return Err(TuneError::Range { name: knob.name(), value, range: *range });
            }
            tunes.push((place, Tune { knob: *knob, value }));
        }
        if self.ring.is_abandoned() {
            return Err(TuneError::Over);
        }
        if self.ring.slots() < tunes.len() {
            return Err(TuneError::Full);
        }
        for (place, tune) in tunes {
            // There is room, and only this side fills it.
            self.ring.push(tune).map_err(|PushError::Full(_)| TuneError::Full)?;
            if let Some((.., target)) = self.knobs.get_mut(place) {
                *target = tune.value;
            }
        }
        Ok(())
    }

    /// The file of the scene has these values now. Of a limit that is the largest one that clients may ask for.
    pub fn adopt<'n>(&mut self, values: impl IntoIterator<Item = (&'n str, f64)>) {
        for (name, value) in values {
            if let Some((knob, range, _)) = self.knobs.iter_mut().find(|(knob, ..)| knob.name() == name) {
                range.scene = value;
                if knob.is_limit() {
                    range.most = value;
                }
            }
        }
    }

    /// Limits that the loop keeps by itself are where they are kept.
    pub fn show_lowered(&mut self, lowered: &Lowered) {
        for (knob, range, target) in &mut self.knobs {
            *target = lowered.bound(*knob, *target).max(range.least.min(*target));
        }
    }
}

#[cfg(test)]
#[expect(clippy::expect_used, clippy::indexing_slicing, reason = "test code")]
mod tests {
    use super::*;
    use crate::servo::testing::parameters;

    #[test]
    fn several_go_in_together_or_none_does() {
        let (mut tuner, mut ring) = Tuner::new(&parameters());
        let [(first, range, was), (second, other, _)] = [tuner.knobs()[0], tuner.knobs()[1]];
        let refused = tuner.set_all([(first.name(), range.least), (second.name(), 2.0 * other.most)]);
        assert!(matches!(refused, Err(TuneError::Range { name, .. }) if name == second.name()), "{refused:?}");
        assert!(ring.pop().is_err() && tuner.knobs()[0].2 == was, "the first went in before the second was refused");
        assert_eq!(tuner.set_all([(first.name(), range.least), (second.name(), other.least)]), Ok(()));
        assert_eq!([ring.pop(), ring.pop()].map(|tune| tune.expect("a tune").knob), [first, second]);
        for _ in 1..RING_TUNES {
            assert_eq!(tuner.set(first.name(), range.most), Ok(()));
        }
        assert_eq!(tuner.set_all([(first.name(), range.least), (second.name(), other.most)]), Err(TuneError::Full));
        assert_eq!((ring.slots(), tuner.knobs()[0].2), (RING_TUNES - 1, range.most));
        assert_eq!(tuner.knobs()[0].1, range);
        tuner.adopt([(first.name(), range.most)]);
        assert_eq!(tuner.knobs()[0].1, KnobRange { scene: range.most, ..range });
    }

    #[test]
    fn a_client_asks_for_no_larger_limit_than_the_file_has_now() {
        let (mut tuner, _ring) = Tuner::new(&parameters());
        let name = Knob::ForceLimit.name();
        let found = |tuner: &Tuner| *tuner.knobs().iter().find(|(knob, ..)| knob.name() == name).expect("a knob");
        let scene = found(&tuner).1.scene;
        tuner.adopt([(name, 0.5 * scene)]);
        assert!(matches!(tuner.set(name, 0.6 * scene), Err(TuneError::Range { .. })));
        assert_eq!(tuner.set(name, 0.4 * scene), Ok(()));
        let lowered = Lowered::default();
        lowered.keep(Knob::ForceLimit, 0.3 * scene, scene);
        tuner.show_lowered(&lowered);
        assert_eq!(found(&tuner).2, 0.3 * scene);
    }

    #[test]
    fn a_value_within_its_range_goes_in_and_nothing_else() {
        let (mut tuner, mut ring) = Tuner::new(&parameters());
        let (knob, range, _) = tuner.knobs()[0];
        let half = 0.5 * (range.least + range.most);
        assert_eq!(tuner.set(knob.name(), half), Ok(()));
        assert_eq!(ring.pop(), Ok(Tune { knob, value: half }));
        assert_eq!(tuner.knobs()[0], (knob, range, half));
        for value in [f64::NAN, range.most * 1.001, -1.0, f64::INFINITY] {
            assert!(matches!(tuner.set(knob.name(), value), Err(TuneError::Range { .. })), "{value}");
        }
        let unknown = tuner.set("stiffness", 1.0).expect_err("unknown").to_string();
        assert!(unknown.contains("contact_stiffness_n_per_m"), "{unknown}");
        for _ in 0..RING_TUNES {
            assert_eq!(tuner.set(knob.name(), half), Ok(()));
        }
        assert_eq!(tuner.set(knob.name(), half), Err(TuneError::Full));
        drop(ring);
        assert!(tuner.is_over());
        assert_eq!(tuner.set(knob.name(), half), Err(TuneError::Over));
    }
}
