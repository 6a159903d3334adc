//! Paths of the simulated hand: where it wants the tool frame to be in the world, over time.
//!
//! A path is a chain of minimum-jerk moves, s(τ) = 10 τ³ − 15 τ⁴ + 6 τ⁵, straight or along an arc,
//! each from rest to rest. All turning of one path is about one axis, so a turn of more than half a
//! revolution is no trouble.

use std::fmt::Write as _;

use glam::{DQuat, DVec3};

/// Time between rows, ms.
pub(crate) const STEP_MS: u64 = 10;

/// One move.
#[derive(Clone, Copy)]
struct Move {
    duration_ms: u64,
    to_mm: DVec3,
    turn_deg: f64,
    /// Along an arc about an upright axis through this point, by so many degrees; otherwise
    /// straight.
    arc: Option<(DVec3, f64)>,
}

impl Move {
    /// The place after a share of the way.
    fn place(&self, from_mm: DVec3, share: f64) -> DVec3 {
        let straight = from_mm.lerp(self.to_mm, share);
        self.arc.map_or(straight, |(center_mm, arc_deg)| {
            around(from_mm, center_mm, arc_deg * share).with_z(straight.z)
        })
    }
}

/// A place turned about an upright axis through another.
fn around(from_mm: DVec3, center_mm: DVec3, angle_deg: f64) -> DVec3 {
    center_mm + DQuat::from_rotation_z(angle_deg.to_radians()) * (from_mm - center_mm)
}

/// A path from a pose of rest, untilted.
pub(crate) struct Hand {
    start_mm: DVec3,
    /// Axis of all turning, world.
    axis: DVec3,
    moves: Vec<Move>,
}

impl Hand {
    pub(crate) fn new(start_mm: DVec3, axis: DVec3) -> Self {
        Self { start_mm, axis: axis.normalize(), moves: Vec::new() }
    }

    /// Goes to `to_mm` and to the angle `turn_deg` about the axis.
    fn go(self, duration_ms: u64, to_mm: DVec3, turn_deg: f64) -> Self {
        self.then(Move { duration_ms, to_mm, turn_deg, arc: None })
    }

    /// Goes to `to_mm` as it is turned now.
    pub(crate) fn to(self, duration_ms: u64, to_mm: DVec3) -> Self {
        let (_, turn_deg) = self.end();
        self.go(duration_ms, to_mm, turn_deg)
    }

    /// Goes around an upright axis through `center_mm`, counter-clockwise seen from above, as it is
    /// turned now.
    pub(crate) fn circle(self, duration_ms: u64, center_mm: DVec3, angle_deg: f64) -> Self {
        let (from_mm, turn_deg) = self.end();
        let to_mm = around(from_mm, center_mm, angle_deg);
        self.then(Move { duration_ms, to_mm, turn_deg, arc: Some((center_mm, angle_deg)) })
    }

    fn then(mut self, next: Move) -> Self {
        assert_eq!(next.duration_ms % STEP_MS, 0, "moves last whole steps");
        self.moves.push(next);
        self
    }

    /// Stays where it is.
    pub(crate) fn hold(self, duration_ms: u64) -> Self {
        let (to_mm, turn_deg) = self.end();
        self.go(duration_ms, to_mm, turn_deg)
    }

    /// Position and turn at the end of the last move.
    pub(crate) fn end(&self) -> (DVec3, f64) {
        self.moves.last().map_or((self.start_mm, 0.0), |last| (last.to_mm, last.turn_deg))
    }

    /// Position and turn `time_ms` after the start.
    pub(crate) fn at(&self, time_ms: u64) -> (DVec3, f64) {
        let mut from = (self.start_mm, 0.0);
        let mut begin_ms = 0;
        for step in &self.moves {
            if time_ms < begin_ms + step.duration_ms {
                let tau = (time_ms - begin_ms) as f64 / step.duration_ms as f64;
                let share = tau * tau * tau * (10.0 + tau * (6.0 * tau - 15.0));
                return (step.place(from.0, share), from.1 + (step.turn_deg - from.1) * share);
            }
            begin_ms += step.duration_ms;
            from = (step.to_mm, step.turn_deg);
        }
        from
    }

    pub(crate) fn duration_ms(&self) -> u64 {
        self.moves.iter().map(|step| step.duration_ms).sum()
    }

    /// The hand CSV of the scene format: seconds, metres, unit quaternions.
    pub(crate) fn to_csv(&self) -> Vec<u8> {
        let mut text = String::from("t_s,x_m,y_m,z_m,qx,qy,qz,qw\n");
        for time_ms in (0..=self.duration_ms()).step_by(STEP_MS as usize) {
            let (position_mm, turn_deg) = self.at(time_ms);
            let rotation = DQuat::from_axis_angle(self.axis, turn_deg.to_radians());
            write!(text, "{:.3}", time_ms as f64 / 1000.0).expect("a string takes every write");
            for number in (position_mm / 1000.0).to_array().into_iter().chain(rotation.to_array()) {
                // Rounded first and added to zero, or tiny negative numbers print as -0.
                let rounded = (number * 1e9).round() / 1e9 + 0.0;
                write!(text, ",{rounded:.9}").expect("a string takes every write");
            }
            text.push('\n');
        }
        text.into_bytes()
    }
}

/// To the hole with 0.3 mm of lateral error and 0.8° of tilt, then down to 2 mm below the hole's
/// floor.
pub(crate) fn peg_in_hole() -> Hand {
    let aside = |z_mm: f64| DVec3::new(0.24, -0.18, z_mm);
    Hand::new(DVec3::new(12.0, -8.0, 15.0), DVec3::new(0.8, 0.6, 0.0))
        .hold(200)
        .go(1000, aside(5.0), 0.8)
        .go(2300, aside(-22.0), 0.8)
        .hold(700)
}

/// Over the shaft with 0.25 mm of lateral error, 0.6° of tilt and 0.4° of tooth error, down the
/// shaft, into mesh, 2 mm below the seat; there the hand gives up its turn, as a hand that feels a
/// face does.
pub(crate) fn gear_on_shaft() -> Hand {
    let aside = |z_mm: f64| DVec3::new(0.2, -0.15, z_mm);
    let error_deg = DVec3::new(0.48, -0.36, 0.4);
    Hand::new(DVec3::new(18.0, 12.0, 36.0), error_deg)
        .hold(200)
        .go(1200, aside(27.0), error_deg.length())
        .go(1200, aside(14.0), error_deg.length())
        .go(1600, aside(2.0), error_deg.length())
        .go(600, aside(2.0), 0.0)
        .hold(400)
}

/// Height of the nut at the start, mm: a multiple of the pitch, 6 mm of overlap with the bolt.
pub(crate) const NUT_START_MM: f64 = 34.0;

/// Screws the nut on: 1.5 turns clockwise from above and 1.5 pitches down, in step.
pub(crate) fn nut_on_bolt() -> Hand {
    Hand::new(DVec3::new(0.0, 0.0, NUT_START_MM), DVec3::Z)
        .hold(500)
        .go(7000, DVec3::new(0.0, 0.0, NUT_START_MM - 3.0), -540.0)
        .hold(500)
}

/// Pushes the nut 3 mm down without turning it: the thread has to hold it.
pub(crate) fn nut_press() -> Hand {
    Hand::new(DVec3::new(0.0, 0.0, NUT_START_MM), DVec3::Z)
        .hold(300)
        .go(1500, DVec3::new(0.0, 0.0, NUT_START_MM - 3.0), 0.0)
        .hold(1200)
}

/// Down until the box would be 1.5 mm inside the plane, 10 mm along x, up again.
pub(crate) fn block_on_plane() -> Hand {
    Hand::new(DVec3::new(0.0, 0.0, 15.0), DVec3::Z)
        .hold(200)
        .go(1000, DVec3::new(0.0, 0.0, 8.5), 0.0)
        .go(1200, DVec3::new(10.0, 0.0, 8.5), 0.0)
        .go(1000, DVec3::new(10.0, 0.0, 15.0), 0.0)
        .hold(600)
}
