//! Velocity from positions, over a time window and never over one sample.
//!
//! The difference of the newest pose and the oldest one inside the window, divided by their
//! distance in time. One encoder step then shows as step/window instead of step/T, at the price of
//! half a window of delay.

use vps::spatial::{Pose, Twist};

/// Default window of the linear velocity, s (CHAI3D's choice).
pub(super) const DEFAULT_WINDOW_LINEAR_S: f64 = 0.015;
/// Default window of the angular velocity, s (CHAI3D's choice).
pub(super) const DEFAULT_WINDOW_ANGULAR_S: f64 = 0.030;

#[derive(Clone, Copy, Debug, Default)]
struct Entry {
    time_s: f64,
    pose: Pose,
}

/// Differentiates poses over two windows, one for each kind of motion.
///
/// RT: `push` is safe; the ring is allocated by [`VelocityWindow::new`]. Cost: amortised constant.
#[derive(Clone, Debug)]
pub(super) struct VelocityWindow {
    /// `[capacity]`, ring of poses in arrival order; `device_from_grip`.
    ring: Box<[Entry]>,
    /// How many poses were ever pushed; the newest is at `(n_pushed - 1) % capacity`.
    n_pushed: usize,
    linear_tail: usize,
    angular_tail: usize,
    window_linear_s: f64,
    window_angular_s: f64,
}

impl VelocityWindow {
    /// Windows of these lengths for poses that come about every `period_s`. A window below one
    /// period becomes one period.
    pub(super) fn new(window_linear_s: f64, window_angular_s: f64, period_s: f64) -> Self {
        // Half a period of slack: the pose that is exactly one window old belongs to the window,
        // whatever the rounding of its time.
        let slack_s = 0.5 * period_s;
        let window_linear_s = window_linear_s.max(period_s) + slack_s;
        let window_angular_s = window_angular_s.max(period_s) + slack_s;
        let n_intervals = (window_linear_s.max(window_angular_s) / period_s).ceil() as usize;
        Self {
            ring: vec![Entry::default(); n_intervals + 2].into_boxed_slice(),
            n_pushed: 0,
            linear_tail: 0,
            angular_tail: 0,
            window_linear_s,
            window_angular_s,
        }
    }

    /// Forgets every pose: what follows has nothing to do with what was. RT: safe.
    pub(super) fn restart(&mut self) {
        (self.n_pushed, self.linear_tail, self.angular_tail) = (0, 0, 0);
    }

    /// Takes the newest pose and gives the twist of the grip in device axes. The first pose gives
    /// zero; until a window is full, it is as short as it is. Times must not run backwards.
    pub(super) fn push(&mut self, time_s: f64, pose: Pose) -> Twist {
        let newest_idx = self.n_pushed;
        *self.entry_mut(newest_idx) = Entry { time_s, pose };
        self.n_pushed += 1;
        // Poses may come more often than promised: what the ring has overwritten is out of the
        // window.
        let oldest_kept = self.n_pushed.saturating_sub(self.ring.len());
        self.linear_tail =
            self.advance_tail(self.linear_tail.max(oldest_kept), time_s - self.window_linear_s);
        self.angular_tail =
            self.advance_tail(self.angular_tail.max(oldest_kept), time_s - self.window_angular_s);
        let linear_from = self.entry(self.linear_tail);
        let angular_from = self.entry(self.angular_tail);
        let mut twist = Twist::ZERO;
        if time_s > linear_from.time_s {
            twist.linear =
                (pose.translation - linear_from.pose.translation) / (time_s - linear_from.time_s);
        }
        if time_s > angular_from.time_s {
            twist.angular = angular_from.pose.rotation_to(pose) / (time_s - angular_from.time_s);
        }
        twist
    }

    fn advance_tail(&self, mut tail: usize, oldest_time_s: f64) -> usize {
        // One interval always stays: a sample after a long gap still has a velocity, that of the
        // gap.
        while tail + 2 < self.n_pushed && self.entry(tail).time_s < oldest_time_s {
            tail += 1;
        }
        tail
    }

    fn entry(&self, idx: usize) -> Entry {
        self.ring[idx % self.ring.len()]
    }

    fn entry_mut(&mut self, idx: usize) -> &mut Entry {
        let capacity = self.ring.len();
        &mut self.ring[idx % capacity]
    }
}

#[cfg(test)]
mod tests {
    use glam::{DQuat, DVec3};

    use super::*;

    const T: f64 = 1e-3;

    fn moving(time_s: f64) -> Pose {
        Pose::new(DQuat::from_rotation_z(0.5 * time_s), DVec3::new(0.2 * time_s, 0.0, 0.0))
    }

    #[test]
    fn a_steady_motion_gives_its_speed_from_the_second_sample_on() {
        let mut window = VelocityWindow::new(0.015, 0.030, T);
        assert_eq!(window.push(0.0, moving(0.0)), Twist::ZERO);
        for n in 1..500 {
            let time_s = f64::from(n) * T;
            let twist = window.push(time_s, moving(time_s));
            assert!((twist.linear - DVec3::new(0.2, 0.0, 0.0)).length() < 1e-9, "{n}: {twist:?}");
            assert!((twist.angular - DVec3::new(0.0, 0.0, 0.5)).length() < 1e-6, "{n}: {twist:?}");
        }
    }

    #[test]
    fn a_step_is_seen_for_exactly_one_window() {
        let mut window = VelocityWindow::new(0.015, 0.030, T);
        for n in 0..100 {
            let x = if n >= 50 { 0.0015 } else { 0.0 };
            let twist =
                window.push(f64::from(n) * T, Pose::from_translation(DVec3::new(x, 0.0, 0.0)));
            let expected = if (50..65).contains(&n) { 0.1 } else { 0.0 };
            assert!((twist.linear.x - expected).abs() < 1e-9, "{n}: {twist:?}");
        }
    }

    #[test]
    fn a_gap_longer_than_the_window_is_bridged() {
        let mut window = VelocityWindow::new(0.015, 0.030, T);
        window.push(0.0, moving(0.0));
        window.push(T, moving(T));
        let twist = window.push(0.2, moving(0.2));
        assert!((twist.linear.x - 0.2).abs() < 1e-9);
    }
}
