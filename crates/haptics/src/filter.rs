//! Dynamic shaping filter: a low-pass on the net contact wrench.
//!
//! Data in: the raw contact wrench of one tick. Data out: the wrench that goes on to the coupling.
//! The raw wrench stays what is reported as contact wrench.
//!
//! # Source
//! Our formulation, inspired by the one-line description of Renz et al. ("a dynamic shaping filter
//! was implemented to soften the force discontinuities"); neither the equations nor the constants
//! are theirs. It has the form of the force smoothing in Guo2004, E_(i+1) = α E_i + (1−α) F_i.

use core::f64::consts::TAU;

use super::FilterParameters;
use vps::spatial::Wrench;

/// Cut-off as a fraction of the voxel line |v|/s: a point that slides at v over voxels
/// of edge s excites the frequency v/s, so 0.3 of it removes the line and keeps what the hand does
/// more slowly.
const LINE_FRACTION: f64 = 0.3;

/// Pole α = exp(−2π f_c T) of a first-order low-pass; 0 (pass-through) for an infinite cut-off.
///
/// RT: safe.
pub fn low_pass_alpha(cutoff_hz: f64, period_s: f64) -> f64 {
    (-TAU * cutoff_hz * period_s).exp()
}

/// What makes the filter dynamic.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Slide {
    /// Tangential speed of the contact, m/s.
    pub speed_m_per_s: f64,
    /// Edge of the voxels that it slides over, m.
    pub voxel_size_m: f64,
    /// √(K/m), the frequency of the virtual tool on the contact, rad/s; 0 where the force goes to
    /// the arm.
    pub contact_rad_per_s: f64,
}

/// y_k = α y_(k−1) + (1−α) W_k on a contact wrench whose frame and reduction point do not
/// change between ticks.
///
/// - The first contact sample sets the state, so a contact does not start with a lag from zero.
/// - The first tick without contact gives exactly zero, so a release is not sticky.
/// - Inside the loop of the virtual tool the filter must not be slower than the contact itself: a
///   stiff contact on two sides (a nut in its thread, a peg in its hole) is then still pushed by
///   the wall that it has left, and never comes to rest. So its time constant is no longer than
///   √(m/K) of the tool on the contact, at any rate: soft contacts get the whole filter, stiff ones
///   next to none. Ours; found on the nut that is pressed without being turned.
/// - The lag of a slow force is T α/(1−α): it counts in the stability budget of the arm when the
///   contact wrench goes to the arm directly, see
///   [`filter_delay_s`](super::stability::filter_delay_s).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ShapingFilter {
    output: Wrench,
    alpha: f64,
    in_contact: bool,
}

impl ShapingFilter {
    /// One tick.
    ///
    /// RT: safe, O(1). A non-finite `raw` gives a non-finite result, which the finite check turns
    /// into a fault; the state is clean again after [`reset`](Self::reset) or one tick without
    /// contact. A speed that is not a number counts as rest.
    pub fn update(
        &mut self,
        raw: Wrench,
        slide: Slide,
        in_contact: bool,
        params: &FilterParameters,
        period_s: f64,
    ) -> Wrench {
        if !in_contact {
            self.reset();
            return Wrench::ZERO;
        }
        self.alpha = if self.in_contact {
            let cutoff_hz = cutoff_hz(slide.speed_m_per_s, slide.voxel_size_m, params);
            low_pass_alpha(cutoff_hz.max(slide.contact_rad_per_s / TAU), period_s)
        } else {
            0.0
        };
        self.in_contact = true;
        // The state stays out of a pass-through: 0 · ∞ would be a NaN, and an off filter returns
        // the very bits it was given.
        self.output = if self.alpha == 0.0 {
            raw
        } else {
            self.output * self.alpha + raw * (1.0 - self.alpha)
        };
        self.output
    }

    /// α of the last tick; the share 1 − α of the contact stiffness acts within the tick, which the
    /// implicit step needs.
    pub fn alpha(&self) -> f64 {
        self.alpha
    }

    /// Forgets everything: for a fault, a stop and the first tick after enable.
    pub fn reset(&mut self) {
        *self = Self::default();
    }
}

/// f_c = clamp(γ |v|/s, f_min, f_max), total on every input (`f64::clamp` panics on bounds out of
/// order).
fn cutoff_hz(slide_speed_m_per_s: f64, voxel_size_m: f64, params: &FilterParameters) -> f64 {
    let [min_hz, max_hz] = params.cutoff_hz;
    (LINE_FRACTION * slide_speed_m_per_s.abs() / voxel_size_m).max(min_hz).min(max_hz)
}

#[cfg(test)]
#[expect(clippy::disallowed_macros, reason = "test code")]
mod tests {
    use glam::DVec3;
    use proptest::prelude::*;

    use super::*;

    const PERIOD_S: f64 = 1e-3;
    const VOXEL_M: f64 = 1e-3;

    fn fixed(cutoff_hz: f64) -> FilterParameters {
        FilterParameters { cutoff_hz: [cutoff_hz, cutoff_hz] }
    }

    fn push(force_n: f64) -> Wrench {
        Wrench::new(DVec3::new(force_n, 0.0, 0.0), DVec3::new(0.0, 0.1 * force_n, 0.0))
    }

    fn slide(speed_m_per_s: f64) -> Slide {
        Slide { speed_m_per_s, voxel_size_m: VOXEL_M, contact_rad_per_s: 0.0 }
    }

    fn started(at_force_n: f64, params: &FilterParameters) -> ShapingFilter {
        let mut filter = ShapingFilter::default();
        filter.update(push(at_force_n), slide(0.0), true, params, PERIOD_S);
        filter
    }

    #[test]
    fn the_pole_and_the_step_response_are_those_of_the_table() {
        for (cutoff_hz, alpha, ticks) in [
            (f64::INFINITY, 0.0, 1),
            (300.0, 0.1518, 2),
            (200.0, 0.2846, 2),
            (100.0, 0.5335, 4),
            (50.0, 0.7304, 8),
        ] {
            let params = fixed(cutoff_hz);
            let mut filter = started(0.0, &params);
            let mut n_ticks = 0;
            loop {
                n_ticks += 1;
                let output = filter.update(push(1.0), slide(0.0), true, &params, PERIOD_S);
                if output.force.x >= 0.9 {
                    break;
                }
            }
            assert_eq!(n_ticks, ticks, "{cutoff_hz} Hz");
            assert!((filter.alpha() - alpha).abs() < 5e-5, "{cutoff_hz} Hz");
        }
    }

    #[test]
    fn a_contact_stiffer_than_the_step_is_hardly_filtered() {
        let params = fixed(50.0);
        // 2π · 50 rad/s are 314 of them.
        for (contact_rad_per_s, alpha) in
            [(0.0, 0.7304), (300.0, 0.7304), (1000.0, 0.3679), (3000.0, 0.0498), (1e6, 0.0)]
        {
            let mut filter = started(0.0, &params);
            let stiff = Slide { contact_rad_per_s, ..slide(0.0) };
            let output = filter.update(push(1.0), stiff, true, &params, PERIOD_S);
            assert!((filter.alpha() - alpha).abs() < 5e-5, "{contact_rad_per_s}");
            assert!((output.force.x - (1.0 - filter.alpha())).abs() < 1e-12);
        }
    }

    #[test]
    fn the_gain_at_rest_is_one() {
        let params = fixed(50.0);
        let mut filter = started(0.0, &params);
        let mut output = Wrench::ZERO;
        for _ in 0..200 {
            output = filter.update(push(3.0), slide(0.0), true, &params, PERIOD_S);
        }
        assert!((output.force.x - 3.0).abs() < 1e-12 && (output.torque.y - 0.3).abs() < 1e-12);
    }

    /// The filter's half of acceptance test 15: step at most (1−α) of the raw jump, lag of a ramp
    /// α/(1−α) T.
    #[test]
    fn acceptance_15_a_jump_is_softened_by_alpha_and_a_ramp_lags_by_the_stated_delay() {
        for cutoff_hz in [50.0, 100.0, 200.0, 300.0] {
            let params = fixed(cutoff_hz);
            let alpha = low_pass_alpha(cutoff_hz, PERIOD_S);
            let mut filter = started(1.0, &params);
            let jumped = filter.update(push(1.7), slide(0.0), true, &params, PERIOD_S);
            assert!((jumped.force.x - 1.0 - (1.0 - alpha) * 0.7).abs() < 1e-12);

            let rate_n_per_s = 40.0;
            let mut lagging = Wrench::ZERO;
            let mut force_n = 0.0;
            for tick_idx in 0..500 {
                force_n = rate_n_per_s * f64::from(tick_idx) * PERIOD_S;
                lagging = filter.update(push(force_n), slide(0.0), true, &params, PERIOD_S);
            }
            let lag_s = (force_n - lagging.force.x) / rate_n_per_s;
            let stated_s = PERIOD_S * alpha / (1.0 - alpha);
            assert!((lag_s - stated_s).abs() < 1e-9, "{cutoff_hz} Hz: {lag_s}");
        }
    }

    #[test]
    fn the_first_contact_sample_passes_and_the_release_is_exactly_zero() {
        let params = fixed(50.0);
        let mut filter = ShapingFilter::default();
        assert_eq!(filter.update(push(4.0), slide(0.0), true, &params, PERIOD_S), push(4.0));
        assert_eq!(filter.alpha(), 0.0);
        filter.update(push(5.0), slide(0.0), true, &params, PERIOD_S);
        let released = filter.update(Wrench::ZERO, slide(0.0), false, &params, PERIOD_S);
        assert_eq!(released.force.to_array().map(f64::to_bits), [0; 3]);
        assert_eq!(released.torque.to_array().map(f64::to_bits), [0; 3]);
        // The next contact starts afresh: nothing is left of the one before.
        assert_eq!(filter.update(push(-2.0), slide(0.0), true, &params, PERIOD_S), push(-2.0));
    }

    #[test]
    fn an_infinite_cut_off_returns_the_same_bits() {
        let params = fixed(f64::INFINITY);
        let mut filter = started(1.0, &params);
        for force_n in [0.3, -0.7, 1e-300, f64::INFINITY, 2.5] {
            let output = filter.update(push(force_n), slide(0.1), true, &params, PERIOD_S);
            assert_eq!(output, push(force_n));
        }
    }

    #[test]
    fn the_cut_off_follows_the_sliding_speed_between_its_bounds() {
        let params = FilterParameters { cutoff_hz: [50.0, 300.0] };
        for (speed_m_per_s, expected_hz) in
            [(0.0, 50.0), (0.1, 50.0), (0.5, 150.0), (-0.5, 150.0), (2.0, 300.0), (f64::NAN, 50.0)]
        {
            let mut filter = started(0.0, &params);
            filter.update(push(1.0), slide(speed_m_per_s), true, &params, PERIOD_S);
            let alpha = low_pass_alpha(expected_hz, PERIOD_S);
            assert!((filter.alpha() - alpha).abs() < 1e-15, "{speed_m_per_s} m/s");
        }
    }

    #[test]
    fn a_non_finite_wrench_shows_and_a_reset_recovers() {
        let params = fixed(50.0);
        let mut filter = started(1.0, &params);
        assert!(!filter.update(push(f64::NAN), slide(0.0), true, &params, PERIOD_S).is_finite());
        assert!(!filter.update(push(1.0), slide(0.0), true, &params, PERIOD_S).is_finite());
        filter.reset();
        assert_eq!(filter.update(push(1.0), slide(0.0), true, &params, PERIOD_S), push(1.0));
    }

    proptest! {
        #[test]
        fn the_filter_never_amplifies(forces in prop::collection::vec(prop::array::uniform6(-20.0_f64..20.0), 1..60), cutoff_hz in 1.0_f64..1000.0) {
            let params = fixed(cutoff_hz);
            let mut filter = ShapingFilter::default();
            let mut force_max = 0.0_f64;
            let mut torque_max = 0.0_f64;
            for [fx, fy, fz, tx, ty, tz] in forces {
                let raw = Wrench::new(DVec3::new(fx, fy, fz), DVec3::new(tx, ty, tz));
                force_max = force_max.max(raw.force.length());
                torque_max = torque_max.max(raw.torque.length());
                let output = filter.update(raw, slide(0.0), true, &params, PERIOD_S);
                prop_assert!(output.force.length() <= force_max * (1.0 + 1e-14));
                prop_assert!(output.torque.length() <= torque_max * (1.0 + 1e-14));
            }
        }
    }
}
