//! Limits that a person lowered: they stay lowered in every scene that takes the place of another, until a person raises them.
//!
//! ```text
//!  desk ──keep──► Lowered ──► each stage that was made for another scene: at most one Tune per tick
//! ```
//! Not a ring: a stage may wait for minutes until it is taken, and the newest value is what counts. What the loop makes of it enters the tick as a
//! [`Tune`], so that recordings have it.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use crate::haptics::{Knob, Tune};

const N: usize = Knob::LIMITS.len();

/// The largest values that a person lets limits have; no limit where none was lowered. Clones share them.
#[derive(Clone, Debug)]
pub struct Lowered(Arc<[AtomicU64; N]>);

impl Default for Lowered {
    /// Nothing is lowered.
    fn default() -> Self {
        Self(Arc::new([NOT_LOWERED; N].map(|value| AtomicU64::new(value.to_bits()))))
    }
}

/// Above what any scene has, and finite: a knob that goes there goes as far as its scene lets it.
const NOT_LOWERED: f64 = f64::MAX;

impl Lowered {
    /// A person has set a knob in a scene that has a value of its own for it. From the first time that a limit is lowered on, what persons set is
    /// what holds.
    pub fn keep(&self, knob: Knob, value: f64, scene: f64) {
        // A NaN is no value.
        if let Some(kept) = self.of(knob)
            && value.is_finite()
            && (value < scene || read(kept) < NOT_LOWERED)
        {
            // `Relaxed`: nothing else is published with it.
            kept.store(value.to_bits(), Ordering::Relaxed);
        }
    }

    /// What a scene or a file may have of this value.
    pub fn bound(&self, knob: Knob, value: f64) -> f64 {
        self.of(knob).map_or(value, |kept| value.min(read(kept)))
    }

    fn of(&self, knob: Knob) -> Option<&AtomicU64> {
        Knob::LIMITS.into_iter().zip(&*self.0).find(|(limit, _)| *limit == knob).map(|(_, kept)| kept)
    }
}

fn read(kept: &AtomicU64) -> f64 {
    f64::from_bits(kept.load(Ordering::Relaxed))
}

/// The loop's end, for one stage.
#[derive(Debug)]
pub(super) struct LoweredEnd {
    lowered: Lowered,
    /// What the stage was told.
    told: [f64; N],
}

impl LoweredEnd {
    pub(super) fn new(lowered: Lowered) -> Self {
        Self { lowered, told: [NOT_LOWERED; N] }
    }

    /// What the stage has not been told yet. RT: safe.
    pub(super) fn next(&mut self) -> Option<Tune> {
        for ((knob, kept), told) in Knob::LIMITS.into_iter().zip(&*self.lowered.0).zip(&mut self.told) {
            let value = read(kept);
            if value.to_bits() != told.to_bits() {
                *told = value;
                return Some(Tune { knob, value });
            }
        }
        None
    }
}

#[cfg(test)]
#[expect(clippy::float_cmp, reason = "test code; values that are copied")]
mod tests {
    use super::*;

    #[test]
    fn what_a_person_lowered_holds_until_a_person_raises_it() {
        let lowered = Lowered::default();
        let mut early = LoweredEnd::new(lowered.clone());
        lowered.keep(Knob::ForceLimit, 1.8, 1.8);
        assert_eq!((early.next(), lowered.bound(Knob::ForceLimit, 3.0)), (None, 3.0), "not lowered");
        lowered.keep(Knob::ForceLimit, 0.7, 1.8);
        lowered.keep(Knob::TorqueLimit, 0.1, 0.2);
        // Not a limit.
        lowered.keep(Knob::ContactStiffness, 1.0, 2.0);
        for end in [&mut early, &mut LoweredEnd::new(lowered.clone())] {
            assert_eq!(end.next(), Some(Tune { knob: Knob::ForceLimit, value: 0.7 }));
            assert_eq!(end.next(), Some(Tune { knob: Knob::TorqueLimit, value: 0.1 }));
            assert_eq!(end.next(), None);
        }
        assert_eq!([1.8, 0.5].map(|file| lowered.bound(Knob::ForceLimit, file)), [0.7, 0.5]);
        assert_eq!(lowered.bound(Knob::ContactStiffness, 2.0), 2.0);
        lowered.keep(Knob::ForceLimit, f64::NAN, 1.8);
        assert_eq!(lowered.bound(Knob::ForceLimit, 9.0), 0.7);
        // Raised to all that this scene has: no more than that in the next one.
        lowered.keep(Knob::ForceLimit, 1.8, 1.8);
        assert_eq!((early.next(), early.next()), (Some(Tune { knob: Knob::ForceLimit, value: 1.8 }), None));
        assert_eq!(lowered.bound(Knob::ForceLimit, 3.0), 1.8);
    }
}
