//! Holds a pose that goes back and forth by one step of the encoder in a hand at rest.
//!
//! Data in: the measured pose and velocity, the arm's encoder steps. Data out: the pose and
//! velocity that the tool follows.
//!
//! A hand whose balance lies between two steps sees one or the other, the coupling answers each
//! with a step of force, and that moves the hand back: a limit cycle that gives energy (friction in
//! the joint of half a step times the stiffness would end it; a wrist has none). A pose that is
//! held makes a force that is held, which gives nothing over a cycle, and within a step no better
//! is known of where the hand is.
//!
//! Each component is on its own. It is at rest once it has stayed within one step for [`REST_S`];
//! what is followed then goes towards what is measured, by less with each change and for a second
//! at most, until it stands. One that leaves that step is followed at once but for the distance to
//! what was held, which goes within [`RELEASE_S`], so nothing lags in motion and nothing jumps.
//!
//! # Source
//! Diolaiti2006 for the energy of a quantised spring and the friction that bounds it; the hold is
//! ours.

use glam::DVec3;

use super::params::ArmParameters;
use vps::spatial::{DeviceSample, Pose, SampleStatus, Twist};

/// Time within one step after which a component is at rest, s. A hand that moves by two steps in
/// this time is followed directly.
const REST_S: f64 = 0.1;

/// Time in which a step that was taken at rest is followed; the n-th change counts n² times less,
/// s.
const CREEP_S: f64 = 0.1;

/// Time after a change, s, for which what is followed still goes: a force that creeps on for tens
/// of seconds within one step of the encoder is no nearer to where the hand is, and never at rest.
const CREEPS_FOR_S: f64 = 1.0;

/// Changes at rest after which it stands: what they still moved it by would be felt for ever, and
/// give energy.
const STANDS_AFTER: u32 = 8;

/// Time in which a component that moves again gets rid of one step of distance to what was held, s.
const RELEASE_S: f64 = 0.02;

/// Poses are multiples of the step up to rounding.
const ONE_STEP: f64 = 1.01;

/// Share of a step that is none: less than 0.1 mN on any arm.
const NOTHING: f64 = 1e-4;

/// One component.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Component {
    /// What is followed.
    held: f64,
    /// What was measured last, and the span since it was last left.
    last: f64,
    low: f64,
    high: f64,
    /// Time within that span, s, and changes since the rest began.
    within_s: f64,
    changes: u32,
    /// Time since the last change, s.
    unchanged_s: f64,
}

impl Component {
    fn at(measured: f64) -> Self {
        Self { held: measured, last: measured, low: measured, high: measured, ..Self::default() }
    }

    fn rests(&self) -> bool {
        self.within_s >= REST_S
    }

    fn follow(&mut self, measured: f64, step: f64, period_s: f64) {
        let low = self.low.min(measured);
        let high = self.high.max(measured);
        let rested = self.rests();
        let lag = self.held - self.last;
        let changed = measured != self.last;
        self.last = measured;
        if measured.is_finite() && high - low <= ONE_STEP * step {
            (self.low, self.high) = (low, high);
            self.within_s += period_s;
            self.unchanged_s = if changed { 0.0 } else { self.unchanged_s + period_s };
        } else {
            *self = Self { held: self.held, ..Self::at(measured) };
        }
        if self.rests() {
            self.changes = self.changes.saturating_add(u32::from(changed));
            if self.changes < STANDS_AFTER && self.unchanged_s < CREEPS_FOR_S {
                let share = period_s / (CREEP_S * f64::from(self.changes.max(1)).powi(2));
                let way = measured - self.held;
                self.held =
                    if way.abs() <= NOTHING * step { measured } else { self.held + way * share };
            }
            return;
        }
        let lag = if rested { self.held - measured } else { lag };
        let most = step * period_s / RELEASE_S;
        let left = lag - lag.clamp(-most, most);
        // What was held is never further away: a NaN and a leap are followed at once.
        let is_near = left.abs() > NOTHING * step && left.abs() <= 2.0 * ONE_STEP * step;
        self.held = if is_near { measured + left } else { measured };
    }
}

/// The hold of one arm.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct EncoderHold {
    /// x, y, z of the translation, then of the rotation vector; `None` before the first pose.
    components: Option<[Component; 6]>,
}

impl EncoderHold {
    /// Forgets everything: the next pose is followed as it is.
    pub(super) fn reset(&mut self) {
        self.components = None;
    }

    /// The pose and the velocity to follow, the very bits that came in where nothing is held. RT:
    /// safe, O(1).
    pub(super) fn steady(
        &mut self,
        sample: &DeviceSample,
        arm: &ArmParameters,
        period_s: f64,
    ) -> (Pose, Twist) {
        let pose = sample.pose;
        let twist = sample.twist;
        let is_fresh = sample.status == SampleStatus::Fresh;
        let step_m = arm.encoder_step_m;
        let step_rad = arm.encoder_step_rad;
        let turn = Pose::IDENTITY.rotation_to(pose);
        let [x, y, z] = pose.translation.to_array();
        let [rx, ry, rz] = turn.to_array();
        let measured = [x, y, z, rx, ry, rz];
        let steps = [step_m, step_m, step_m, step_rad, step_rad, step_rad];
        let Some(components) = &mut self.components else {
            self.components = Some(measured.map(Component::at));
            return (pose, twist);
        };
        // What is not fresh says nothing.
        let period_s = if is_fresh { period_s } else { 0.0 };
        for ((component, measured), step) in components.iter_mut().zip(measured).zip(steps) {
            if step > 0.0 {
                component.follow(measured, step, period_s);
            } else {
                *component = Component::at(measured);
            }
        }
        let [x, y, z, rx, ry, rz] = components;
        let held = |[a, b, c]: [&Component; 3]| DVec3::new(a.held, b.held, c.held);
        let moving = |[a, b, c]: [&Component; 3]| DVec3::new(moves(a), moves(b), moves(c));
        let translation = held([x, y, z]);
        let turned = held([rx, ry, rz]);
        let rotation = if turned == turn {
            pose.rotation
        } else {
            glam::DQuat::from_scaled_axis(turned).normalize()
        };
        let linear = twist.linear * moving([x, y, z]);
        // A rotation about one axis moves all components of the vector a little.
        let angular = if moving([rx, ry, rz]) == DVec3::ZERO { DVec3::ZERO } else { twist.angular };
        (Pose { rotation, translation }, Twist { linear, angular })
    }
}

/// 1 for a component that is followed directly, 0 for one at rest: the velocity of a held one is
/// that of its steps.
fn moves(component: &Component) -> f64 {
    f64::from(u8::from(!component.rests()))
}

#[cfg(test)]
#[expect(clippy::disallowed_types, clippy::indexing_slicing, reason = "test code")]
mod tests {
    use super::*;
    use glam::DQuat;

    const PERIOD_S: f64 = 1e-3;
    const STEP_M: f64 = 4e-5;
    const STEP_RAD: f64 = 6e-3;

    fn arm() -> ArmParameters {
        ArmParameters {
            encoder_step_m: STEP_M,
            encoder_step_rad: STEP_RAD,
            ..ArmParameters::default()
        }
    }

    fn sample((pose, twist): (Pose, Twist)) -> DeviceSample {
        DeviceSample { pose, twist, status: SampleStatus::Fresh, ..DeviceSample::default() }
    }

    /// What becomes of a path in steps, x and rotation about z alike.
    fn steadied(path: impl Iterator<Item = i32>) -> impl Iterator<Item = (f64, f64, Twist)> {
        let mut hold = EncoderHold::default();
        path.map(move |steps| {
            let steps = f64::from(steps);
            let pose =
                Pose::new(DQuat::from_rotation_z(STEP_RAD * steps), DVec3::X * (STEP_M * steps));
            let twist = Twist { linear: DVec3::X, angular: DVec3::Z };
            let (held, twist) = hold.steady(&sample((pose, twist)), &arm(), PERIOD_S);
            (held.translation.x / STEP_M, Pose::IDENTITY.rotation_to(held).z / STEP_RAD, twist)
        })
    }

    #[test]
    fn a_step_back_and_forth_comes_to_stand_whatever_its_frequency() {
        for half_period in [1, 7, 16, 70] {
            let outputs: Vec<_> = steadied((0..3000).map(|n| n / half_period % 2)).collect();
            let (x, turn, _) = outputs[1000];
            for (at, (later_x, later_turn, twist)) in outputs[1000..].iter().enumerate() {
                assert!(
                    *later_x == x && *later_turn == turn,
                    "{half_period}: tick {at}, {later_x} {later_turn}"
                );
                assert_eq!(*twist, Twist::ZERO, "{half_period}");
            }
            assert!(
                (-1e-9..=1.0 + 1e-9).contains(&x) && (x - turn).abs() < 1e-9,
                "{half_period}: {x} {turn}"
            );
        }
    }

    #[test]
    fn a_second_after_the_last_step_what_is_followed_stands() {
        for changes in 1..9 {
            let path = (0..9000).map(|n: i32| (n / 300).min(changes) % 2);
            let outputs: Vec<_> = steadied(path).map(|(x, turn, _)| (x, turn)).collect();
            let last = changes as usize * 300;
            assert!(
                outputs[last + 1010..].iter().all(|output| *output == outputs[8999]),
                "{changes} changes"
            );
            assert!(
                changes > 7 || outputs[last + 10] != outputs[last + 900],
                "{changes} changes: it goes on for a while"
            );
        }
    }

    #[test]
    fn what_moves_is_followed_to_the_bit_and_a_rest_is_left_without_a_jump() {
        // Two steps in 100 ms and more: 0.8 mm/s.
        for ticks in [1, 10, 49] {
            for (n, (x, _, twist)) in steadied((0..2000).map(|n| n / ticks)).enumerate().skip(10) {
                let measured = f64::from(n as i32 / ticks);
                assert!(
                    (x - measured).abs() < 1e-9 && twist.linear.x == 1.0,
                    "{ticks}: tick {n}, {x} of {measured}"
                );
            }
        }
        // There and back by some steps, at a stand between.
        let stands = [0, 3, 2, 5, 1, 0];
        let mut before = 0.0;
        for (n, (x, turn, _)) in steadied((0..6000).map(|n| stands[n / 1000])).enumerate() {
            let measured = f64::from(stands[n / 1000]);
            assert!((x - turn).abs() < 1e-9, "tick {n}: {x} {turn}");
            assert!(
                n % 1000 < 950 || (x - measured).abs() < 1e-3,
                "tick {n}: {x} of {measured} after most of a second"
            );
            // More than two steps at once are a leap, which is followed.
            let leaps =
                n % 1000 == 0 && n > 0 && (measured - f64::from(stands[n / 1000 - 1])).abs() > 2.0;
            assert!(leaps || (x - before).abs() <= 0.051, "tick {n}: {before} to {x}");
            before = x;
        }
    }

    #[test]
    fn without_steps_with_old_samples_and_with_what_is_no_number_nothing_is_held() {
        let still = (
            Pose::new(DQuat::from_rotation_x(0.3), DVec3::ONE),
            Twist { linear: DVec3::X, angular: DVec3::Y },
        );
        let mut hold = EncoderHold::default();
        for _ in 0..500 {
            assert_eq!(hold.steady(&sample(still), &ArmParameters::default(), PERIOD_S), still);
        }
        let mut hold = EncoderHold::default();
        for _ in 0..500 {
            let old = DeviceSample { status: SampleStatus::Stale, ..sample(still) };
            assert_eq!(hold.steady(&old, &arm(), PERIOD_S), still);
        }
        for _ in 0..500 {
            hold.steady(&sample(still), &arm(), PERIOD_S);
        }
        assert_eq!(hold.steady(&sample(still), &arm(), PERIOD_S).1, Twist::ZERO);
        let lost = Pose { translation: DVec3::NAN, ..still.0 };
        assert!(
            hold.steady(&sample((lost, still.1)), &arm(), PERIOD_S).0.translation.is_nan(),
            "for the finite check to see"
        );
        let (pose, twist) = hold.steady(&sample(still), &arm(), PERIOD_S);
        assert_eq!((pose, twist.linear), (still.0, still.1.linear), "and it leaves no trace");
    }

    #[test]
    fn a_rest_that_is_left_by_two_steps_is_followed_from_where_it_was_held() {
        for steps in [2, -2] {
            let path = (0..300).map(|n| if n < 200 { 0 } else { steps });
            let outputs: Vec<_> = steadied(path).collect();
            let sign = f64::from(steps.signum());
            for (n, (x, turn, twist)) in outputs[200..240].iter().enumerate() {
                // A step in 20 ms.
                let expected = (sign * 0.05 * (n as f64 + 1.0), f64::from(steps));
                let expected = expected.0.clamp(expected.1.min(0.0), expected.1.max(0.0));
                assert!((x - expected).abs() < 1e-9, "tick {n}: {x} and not {expected}");
                assert!((turn - expected).abs() < 1e-6, "tick {n}: {turn} and not {expected}");
                assert_eq!((twist.linear, twist.angular), (DVec3::X, DVec3::Z));
            }
        }
    }

    #[test]
    fn a_step_at_rest_is_crept_to_within_a_tenth_of_a_second_and_later_ones_more_slowly() {
        let path = (0..420).map(|n| i32::from((200..300).contains(&n)));
        let outputs: Vec<_> = steadied(path).collect();
        let mut held = 0.0;
        for (n, (x, ..)) in outputs[200..300].iter().enumerate() {
            held += (1.0 - held) * 0.01;
            assert!((x - held).abs() < 1e-9, "tick {n}: {x} and not {held}");
        }
        for (n, (x, ..)) in outputs[300..400].iter().enumerate() {
            held -= held * 0.01 / 4.0;
            assert!((x - held).abs() < 1e-9, "tick {n}: {x} and not {held}");
        }
    }

    #[test]
    fn each_component_is_held_on_its_own() {
        let mut hold = EncoderHold::default();
        let mut last = (Pose::IDENTITY, Twist::ZERO);
        let measured = |n: u32| {
            let trembles = f64::from(n / 7 % 2);
            let goes = f64::from(n);
            let translation = DVec3::new(trembles, goes, 5.0) * STEP_M;
            let turn = DVec3::new(0.0, trembles, goes) * (0.1 * STEP_RAD);
            Pose::new(DQuat::from_scaled_axis(turn), translation)
        };
        for n in 0..400 {
            let twist = Twist { linear: DVec3::ONE, angular: DVec3::ONE };
            last = hold.steady(&sample((measured(n), twist)), &arm(), PERIOD_S);
        }
        let (pose, twist) = last;
        assert_eq!(twist, Twist { linear: DVec3::Y, angular: DVec3::ONE });
        let steps = pose.translation / STEP_M;
        assert!((steps.y - 399.0).abs() < 1e-9 && (steps.z - 5.0).abs() < 1e-12, "{steps}");
        assert!(steps.x > 0.0 && steps.x < 1.0, "{steps}");
    }

    #[test]
    fn a_reset_follows_the_next_pose_as_it_is() {
        let mut hold = EncoderHold::default();
        let at = |steps: f64| (Pose::from_translation(DVec3::X * (STEP_M * steps)), Twist::ZERO);
        for _ in 0..300 {
            hold.steady(&sample(at(0.0)), &arm(), PERIOD_S);
        }
        assert!(hold.steady(&sample(at(1.0)), &arm(), PERIOD_S).0.translation.x < 0.1 * STEP_M);
        hold.reset();
        assert_eq!(hold.steady(&sample(at(1.0)), &arm(), PERIOD_S).0, at(1.0).0);
    }
}
