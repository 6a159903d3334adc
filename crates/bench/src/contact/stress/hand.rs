//! A hand that slams, spins and jams a nut: first on the thread, then, unscrewed, all over the
//! bolt.

use core::f64::consts::{PI, TAU};
use core::fmt::Write as _;

use glam::{DQuat, DVec3};

use super::super::super::random::Random;
use document::poses::HEADER;
use vps::spatial::Pose;

/// Between two rows of the path, s.
const ROW_S: f64 = 5e-3;
/// Largest speed of the hand's target, m/s: what is left to the arm's own limit of 1 m/s is for
/// recoil.
const SPEED_M_PER_S: f64 = 0.55;
/// Largest turn of the target, rad/s: a fast wrist.
const TURN_RAD_PER_S: f64 = 12.0;
/// Share of the time on the thread.
const ON_THREAD: f64 = 0.4;
/// Turns that take the nut off the thread, and its pitch, m.
const TURNS_OFF: f64 = 5.0;
const PITCH_M: f64 = 2e-3;
/// Where the nut starts, in phase with the thread, m.
const START_Z_M: f64 = 0.034;
/// Tip of the bolt, m.
const TIP_Z_M: f64 = 0.040;

/// A path under way: rows of `HEADER`, and where the target stands.
struct Path {
    rows: String,
    time_s: f64,
    at: Pose,
    random: Random,
}

/// The path as the text of a hand file: `world_from_tool`, from the start pose of the shipped nut
/// on, for at least `duration_s`. The same for the same seed.
///
/// | what | how |
/// |---|---|
/// | slam | at up to 0.55 m/s against the wall and back, some times in a row |
/// | spin | pressed sideways, turned at up to 12 rad/s |
/// | jam | tilted, and pressed up to 10 mm past the wall, trembling at 8 to 15 Hz |
pub(super) fn path(duration_s: f64, seed: u64) -> String {
    let mut path = Path {
        rows: format!("{HEADER}\n"),
        time_s: 0.0,
        at: Pose::from_translation(DVec3::Z * START_Z_M),
        random: Random::new(seed),
    };
    path.row();
    while path.time_s < ON_THREAD * duration_s {
        // Somewhere on the helix, so that what follows begins without much force.
        let turns = path.random.within(-0.6, 0.6);
        let home = Pose::new(
            DQuat::from_rotation_z(TAU * turns),
            DVec3::Z * (START_Z_M + PITCH_M * turns),
        );
        path.screw_to(turns);
        path.torment(home);
    }
    path.screw_to(0.0);
    path.screw_to(TURNS_OFF);
    path.go(Pose::new(path.at.rotation, DVec3::Z * (TIP_Z_M + 0.02)));
    while path.time_s < duration_s {
        let home = path.beside();
        path.go(home);
        path.torment(home);
        path.go(home);
    }
    path.rows
}

impl Path {
    fn row(&mut self) {
        let ([x, y, z], [qx, qy, qz, qw]) =
            (self.at.translation.to_array(), self.at.rotation.to_array());
        // What cannot be written to a string is not written at all.
        let _ = writeln!(
            self.rows,
            "{:.3},{x:.9},{y:.9},{z:.9},{qx:.9},{qy:.9},{qz:.9},{qw:.9}",
            self.time_s
        );
    }

    /// Along a curve for so long; `at` gets the share of the time.
    fn along(&mut self, long_s: f64, at: impl Fn(f64, f64) -> Pose) {
        let n_rows = (long_s / ROW_S).ceil().max(1.0) as usize;
        for n in 1..=n_rows {
            self.time_s += ROW_S;
            self.at = at(n as f64 / n_rows as f64, n as f64 * ROW_S);
            self.row();
        }
    }

    /// To a pose, from rest to rest, as fast as the hand goes.
    fn go(&mut self, to: Pose) {
        let from = self.at;
        let turn_rad = from.rotation_to(to).length();
        // Minimum jerk: 1.875 times the mean speed at its fastest.
        let long_s = 1.875
            * ((to.translation - from.translation).length() / SPEED_M_PER_S)
                .max(turn_rad / TURN_RAD_PER_S);
        self.along(long_s, |share, _| {
            let smooth = share.powi(3) * (10.0 - 15.0 * share + 6.0 * share * share);
            Pose::new(
                from.rotation.slerp(to.rotation, smooth),
                from.translation.lerp(to.translation, smooth),
            )
        });
    }

    /// Along the thread to so many turns from the start.
    fn screw_to(&mut self, turns: f64) {
        let from = (self.at.translation.z - START_Z_M) / PITCH_M;
        let long_s = 1.875 * (turns - from).abs() * TAU / TURN_RAD_PER_S;
        self.along(long_s.max(0.05), |share, _| {
            let smooth = share.powi(3) * (10.0 - 15.0 * share + 6.0 * share * share);
            let turns = from + (turns - from) * smooth;
            Pose::new(DQuat::from_rotation_z(TAU * turns), DVec3::Z * (START_Z_M + PITCH_M * turns))
        });
    }

    fn rest(&mut self, long_s: f64) {
        let at = self.at;
        self.along(long_s, |_, _| at);
    }

    fn direction(&mut self) -> DVec3 {
        let z = self.random.within(-1.0, 1.0);
        let turn = self.random.within(0.0, TAU);
        ((1.0 - z * z).sqrt() * DVec3::new(turn.cos(), turn.sin(), 0.0)).with_z(z)
    }

    /// Free of the bolt, in any orientation, 5 to 20 mm before its shaft or above its tip.
    fn beside(&mut self) -> Pose {
        let turn = self.random.within(0.0, TAU);
        let axis = self.direction();
        let rotation = DQuat::from_axis_angle(axis, self.random.within(0.0, PI));
        let position = if self.random.unit() < 0.5 {
            let radius_m = self.random.within(0.028, 0.045);
            DVec3::new(
                radius_m * turn.cos(),
                radius_m * turn.sin(),
                self.random.within(0.012, 0.036),
            )
        } else {
            DVec3::new(
                self.random.within(-0.01, 0.01),
                self.random.within(-0.01, 0.01),
                TIP_Z_M + self.random.within(0.02, 0.035),
            )
        };
        Pose::new(rotation, position)
    }

    /// One of the three, from a pose, and back to it.
    fn torment(&mut self, home: Pose) {
        // On the thread the wall is all around, elsewhere it is where the bolt is.
        let on_thread = home.translation.truncate().length() < 1e-9;
        let reach_m = if on_thread {
            0.0
        } else {
            home.translation.truncate().length().max(home.translation.z - TIP_Z_M)
        };
        let towards = |path: &mut Self| match on_thread {
            true => path.direction(),
            false => (DVec3::Z * path.random.within(0.015, TIP_Z_M) - home.translation).normalize(),
        };
        match (3.0 * self.random.unit()) as u32 {
            0 => {
                for _ in 0..4 {
                    let to = towards(self) * (0.3 * reach_m + self.random.within(0.004, 0.014));
                    self.go(Pose::new(home.rotation, home.translation + to));
                    let long_s = self.random.within(0.0, 0.15);
                    self.rest(long_s);
                    self.go(home);
                }
            }
            1 => {
                let press = towards(self) * (0.7 * reach_m + self.random.within(0.001, 0.004));
                self.go(Pose::new(home.rotation, home.translation + press));
                let axis = if on_thread { DVec3::Z } else { self.direction() };
                let rate = self.random.within(4.0, TURN_RAD_PER_S);
                let long_s = self.random.within(0.5, 2.0);
                let from = self.at;
                // Forth and back, without a step of the speed at either end.
                let swing = |share: f64| 0.5 * rate * long_s / PI * (1.0 - (TAU * share).cos());
                self.along(long_s, |share, _| {
                    Pose::new(
                        DQuat::from_axis_angle(axis, swing(share)) * from.rotation,
                        from.translation,
                    )
                });
                self.go(home);
            }
            _ => {
                let press = towards(self) * (0.7 * reach_m + self.random.within(0.004, 0.01));
                let tilt = DQuat::from_axis_angle(self.direction(), self.random.within(0.05, 0.3));
                self.go(Pose::new(tilt * home.rotation, home.translation + press));
                let aside = self.direction();
                let frequency_hz = self.random.within(8.0, 15.0);
                let long_s = self.random.within(0.5, 2.0);
                let from = self.at;
                self.along(long_s, |_, time_s| {
                    let tremor = (TAU * frequency_hz * time_s).sin();
                    let turn = DQuat::from_axis_angle(aside, 0.03 * tremor);
                    Pose::new(turn * from.rotation, from.translation + aside * (5e-4 * tremor))
                });
                self.go(home);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use document::poses;

    #[test]
    fn the_hand_is_fast_but_not_faster_than_an_arm_and_always_the_same() {
        let text = path(60.0, 7);
        assert!(text == path(60.0, 7) && text != path(60.0, 8));
        let rows = poses::parse(&text, Path::new("hand")).unwrap();
        assert!(rows.last().unwrap().time_s >= 60.0);
        let mut fastest = 0.0_f64;
        let mut fastest_turn = 0.0_f64;
        for pair in rows.windows(2) {
            let long_s = pair[1].time_s - pair[0].time_s;
            assert!((long_s - ROW_S).abs() < 1e-9, "rows are even, line {}", pair[1].line);
            fastest = fastest
                .max((pair[1].pose.translation - pair[0].pose.translation).length() / long_s);
            fastest_turn =
                fastest_turn.max(pair[0].pose.rotation_to(pair[1].pose).length() / long_s);
        }
        assert!(fastest > 0.4 && fastest < 1.01 * SPEED_M_PER_S, "{fastest} m/s");
        assert!(fastest_turn > 8.0 && fastest_turn < 1.01 * TURN_RAD_PER_S, "{fastest_turn} rad/s");
    }
}
