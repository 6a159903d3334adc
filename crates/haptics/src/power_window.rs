//! The power into the hand, averaged over a window.
//!
//! Data in: the energy that the command put into the hand in one tick, counted over what is known
//! exactly (the command that acted, and the displacement over which it acted). Data out: whether
//! that is too much. The limiter of the output judges each command by the measured velocity, which
//! is late and coarse; what slips past it shows here.

/// Longest window, ticks: 50 ms at 10 kHz and a little more.
const N_MAX: usize = 512;

/// The limiter already holds the power at its limit by a velocity that is half a window of
/// differentiation old. Its own error is no fault: only what is further above the limit than this
/// factor is.
const MARGIN: f64 = 1.25;

/// Energy of the last ticks. 4 KiB, no heap.
#[derive(Clone, Debug)]
pub(super) struct PowerWindow {
    /// `[N_MAX]`, J; a ring over the first `n` of the window.
    given_j: [f64; N_MAX],
    next: usize,
    sum_j: f64,
}

impl Default for PowerWindow {
    fn default() -> Self {
        Self { given_j: [0.0; N_MAX], next: 0, sum_j: 0.0 }
    }
}

impl PowerWindow {
    /// Takes the energy of one tick; true when the mean power over the window is above the limit. A
    /// window of less than one tick judges nothing, nor does a NaN. RT: safe, O(1), and O(window)
    /// once per window.
    pub(super) fn exceeds(
        &mut self,
        given_j: f64,
        limit_w: f64,
        window_s: f64,
        period_s: f64,
    ) -> bool {
        let n_ticks = ((window_s / period_s).round() as usize).min(N_MAX);
        let given_j = if given_j.is_finite() { given_j } else { 0.0 };
        self.next = if self.next + 1 < n_ticks { self.next + 1 } else { 0 };
        let Some(slot) = self.given_j.get_mut(self.next).filter(|_| n_ticks > 0) else {
            return false;
        };
        self.sum_j += given_j - core::mem::replace(slot, given_j);
        if self.next == 0 {
            // Rounding does not add up.
            self.sum_j = self.given_j.iter().take(n_ticks).sum();
        }
        self.sum_j > MARGIN * limit_w * (n_ticks as f64 * period_s)
    }

    /// Forgets everything.
    pub(super) fn reset(&mut self) {
        *self = Self::default();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mean_counts_not_the_peak() {
        // 5 W over 50 ms are 0.25 J, and a quarter more is allowed for.
        let trips_at = |per_tick_j: f64| {
            let mut window = PowerWindow::default();
            (1..=1000).find(|_| window.exceeds(per_tick_j, 5.0, 0.05, 1e-3))
        };
        assert_eq!(trips_at(5e-3), None);
        assert_eq!(trips_at(6.2e-3), None);
        assert_eq!(trips_at(6.3e-3), Some(50));
        assert_eq!(trips_at(12.4e-3), Some(26));
        let mut window = PowerWindow::default();
        assert!(!window.exceeds(0.3, 5.0, 0.05, 1e-3));
        assert!(!(0..1000).any(|_| window.exceeds(0.0, 5.0, 0.05, 1e-3)));
        // What comes back is subtracted; after a window everything is forgotten.
        assert!(!(0..1000).any(|n| window.exceeds(
            if n % 2 == 0 { 0.1 } else { -0.1 },
            5.0,
            0.05,
            1e-3
        )));
        assert!((0..60).any(|_| window.exceeds(6.3e-3, 5.0, 0.05, 1e-3)));
    }

    #[test]
    fn nothing_is_judged_without_a_window_a_limit_or_a_number() {
        for (given_j, limit_w, window_s) in [
            (1.0, 5.0, 0.0),
            (1.0, f64::INFINITY, 0.05),
            (f64::NAN, 5.0, 0.05),
            (1.0, 5.0, f64::NAN),
        ] {
            let mut window = PowerWindow::default();
            assert!(
                !(0..1000).any(|_| window.exceeds(given_j, limit_w, window_s, 1e-3)),
                "{given_j} {limit_w} {window_s}"
            );
        }
        // Longer than the ring: as long as the ring.
        let mut window = PowerWindow::default();
        assert!((0..600).any(|_| window.exceeds(1.0, 5.0, 1e9, 1e-3)));
    }

    #[test]
    fn energy_counts_for_exactly_as_many_ticks_as_the_window_has() {
        // Together 0.4 J, where 0.3125 J are allowed.
        for first in 0..120 {
            for (apart, trips) in [(1, true), (49, true), (50, false), (51, false)] {
                let mut window = PowerWindow::default();
                let tripped = (0..300).any(|n| {
                    let is_pulse = n == first || n == first + apart;
                    window.exceeds(if is_pulse { 0.2 } else { 0.0 }, 5.0, 0.05, 1e-3)
                });
                assert_eq!(tripped, trips, "pulses at {first} and {apart} later");
            }
        }
    }

    #[test]
    fn as_much_as_is_allowed_is_no_fault() {
        // Two ticks of a quarter of a second at 4 W and a quarter more: 2.5 J.
        let mut window = PowerWindow::default();
        assert!(!window.exceeds(1.25, 4.0, 0.5, 0.25) && !window.exceeds(1.25, 4.0, 0.5, 0.25));
        assert!(window.exceeds(1.26, 4.0, 0.5, 0.25));
    }

    #[test]
    fn a_reset_forgets_what_was_given() {
        let mut window = PowerWindow::default();
        assert!(!window.exceeds(0.2, 5.0, 0.05, 1e-3));
        window.reset();
        assert!(!window.exceeds(0.2, 5.0, 0.05, 1e-3));
        assert!(window.exceeds(0.2, 5.0, 0.05, 1e-3));
    }
}
