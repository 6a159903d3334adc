//! The closed five-link of Polhem v3: two cranks in the plane of the arm, a coupler, and a straight
//! bar that carries the grip (devices reference, 6.2).
//!
//! ```text
//! A = (L0/2 + L1·cosθ2, L1·sinθ2)       B = (−L0/2 + L2·cosθ3, L2·sinθ3)       |C − A| = L4, |C − B| = L3
//! E = A + (L5/L4)·(A − C)               p = (E_x·cosθ1, E_x·sinθ1, E_z) − origin
//! ```
//! The columns follow from (C−A)·dC = (C−A)·dA and (C−B)·dC = (C−B)·dB, and grow without bound
//! where A, B and C are in line.

use glam::{DQuat, DVec2, DVec3};

use super::gimbal::Gimbal;
use super::{Configuration, GRAVITY_M_PER_S2};
use crate::axes::MAX_AXES;
use vps::spatial::{Pose, Twist};

/// Smallest sine of the angle at which the two bars of a closed loop may meet. Below it the loop
/// counts as out of reach: a thousandth of a radian from being stretched, where no arm can be
/// driven and no encoder count means anything.
pub(super) const MEETING_SINE_MIN: f64 = 1e-3;

/// Geometry of the five-link.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct FiveLink {
    /// L0 to L5, m.
    pub(crate) length_m: [f64; 6],
    /// Centre of the workspace, m: the native origin.
    pub(crate) origin_m: DVec3,
    /// Wrist; `None`: orientation is not sensed.
    pub(crate) gimbal: Option<Gimbal>,
    /// Gravity of the links is compensated when given: link 1 on crank 2, link 2 on crank 3, link 3
    /// from B to C, and the bar from A to E.
    pub(crate) links: Option<[PlaneLink; 4]>,
}

/// Mass of a link in the plane of the arm.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct PlaneLink {
    /// kg
    pub(crate) mass_kg: f64,
    /// Its centre of mass along and across the link, from the joint that it turns about, m.
    pub(crate) center_m: [f64; 2],
}

/// The loop in its plane: X radial, Y of the vectors is up.
struct Plane {
    e: DVec2,
    /// Unit vector from A to E.
    bar: DVec2,
    /// Unit vector from B to C.
    coupler: DVec2,
    /// Per crank: how A, B, C and E move.
    moves: [Move; 2],
}

#[derive(Clone, Copy)]
struct Move {
    a: DVec2,
    b: DVec2,
    c: DVec2,
    e: DVec2,
}

impl FiveLink {
    fn plane(&self, crank_a: f64, crank_b: f64) -> Option<Plane> {
        let [l0, l1, l2, l3, l4, l5] = self.length_m;
        let direction_a = DVec2::from_angle(crank_a);
        let direction_b = DVec2::from_angle(crank_b);
        let a = DVec2::new(0.5 * l0, 0.0) + l1 * direction_a;
        let b = DVec2::new(-0.5 * l0, 0.0) + l2 * direction_b;
        let distance = a.distance(b);
        let u = (b - a) / distance;
        let along = (l4 * l4 - l3 * l3 + distance * distance) / (2.0 * distance);
        let across_squared = l4 * l4 - along * along;
        if across_squared.is_nan() || across_squared <= 0.0 {
            return None;
        }
        // The branch clockwise from u.
        let c = a + along * u + across_squared.sqrt() * DVec2::new(u.y, -u.x);
        let from_a = c - a;
        let from_b = c - b;
        let area = from_a.perp_dot(from_b);
        if area.abs() < MEETING_SINE_MIN * l3 * l4 {
            return None;
        }
        let k = l5 / l4;
        let moves =
            [(l1 * direction_a.perp(), DVec2::ZERO), (DVec2::ZERO, l2 * direction_b.perp())].map(
                |(da, db)| {
                    let right_a = from_a.dot(da);
                    let right_b = from_b.dot(db);
                    let dc = DVec2::new(
                        right_a * from_b.y - right_b * from_a.y,
                        right_b * from_a.x - right_a * from_b.x,
                    ) / area;
                    Move { a: da, b: db, c: dc, e: (1.0 + k) * da - k * dc }
                },
            );
        Some(Plane { e: a - k * from_a, bar: -from_a / l4, coupler: from_b / l3, moves })
    }

    pub(super) fn solve(&self, joints: &[f64; MAX_AXES]) -> Option<Configuration> {
        let [turn, crank_a, crank_b, ..] = *joints;
        let Plane { e, bar, moves, .. } = self.plane(crank_a, crank_b)?;
        let (sin, cos) = turn.sin_cos();
        let lifted = |v: DVec2| DVec3::new(v.x * cos, v.x * sin, v.y);
        let mut configuration = Configuration {
            native_from_grip: Pose::from_translation(lifted(e) - self.origin_m),
            ..Configuration::default()
        };
        configuration.columns[0].linear = DVec3::new(-sin * e.x, cos * e.x, 0.0);
        for (column, motion) in configuration.columns[1..3].iter_mut().zip(moves) {
            column.linear = lifted(motion.e);
        }
        if let Some(gimbal) = self.gimbal {
            configuration.columns[0].angular = DVec3::Z;
            for (column, motion) in configuration.columns[1..3].iter_mut().zip(moves) {
                let pitch_rate = bar.perp_dot(motion.e - motion.a) / self.length_m[5];
                *column = Twist { angular: DVec3::new(-sin, cos, 0.0) * -pitch_rate, ..*column };
            }
            gimbal.apply(native_from_bar(turn, bar), joints, &mut configuration);
        }
        Some(configuration)
    }

    /// Orientation of the bar; `None` where the loop cannot be.
    pub(super) fn native_from_link(&self, joints: &[f64; MAX_AXES]) -> Option<DQuat> {
        let [turn, crank_a, crank_b, ..] = *joints;
        self.plane(crank_a, crank_b).map(|plane| native_from_bar(turn, plane.bar))
    }

    /// Derivative of the potential of all links.
    pub(super) fn gravity_torques(&self, joints: &[f64; MAX_AXES]) -> [f64; MAX_AXES] {
        let mut torques_nm = [0.0; MAX_AXES];
        let [_, crank_a, crank_b, ..] = *joints;
        let (Some(links), Some(Plane { bar, coupler, moves, .. })) =
            (self.links, self.plane(crank_a, crank_b))
        else {
            return torques_nm;
        };
        // Height per radian of a link that points along `direction`: z = along·sin + across·cos.
        let rise = |link: PlaneLink, direction: DVec2| {
            link.center_m[0] * direction.x - link.center_m[1] * direction.y
        };
        let [link_1, link_2, link_3, link_bar] = links;
        for (idx, motion) in moves.iter().enumerate() {
            let crank = if idx == 0 {
                link_1.mass_kg * rise(link_1, DVec2::from_angle(crank_a))
            } else {
                link_2.mass_kg * rise(link_2, DVec2::from_angle(crank_b))
            };
            let coupler_rate = coupler.perp_dot(motion.c - motion.b) / self.length_m[3];
            let bar_rate = bar.perp_dot(motion.e - motion.a) / self.length_m[5];
            let coupler = link_3.mass_kg * (motion.b.y + coupler_rate * rise(link_3, coupler));
            let bar = link_bar.mass_kg * (motion.a.y + bar_rate * rise(link_bar, bar));
            torques_nm[idx + 1] = GRAVITY_M_PER_S2 * (crank + coupler + bar);
        }
        torques_nm
    }
}

/// Rz(θA)·Ry(−λ), λ the elevation of the bar.
fn native_from_bar(turn: f64, bar: DVec2) -> DQuat {
    DQuat::from_rotation_z(turn) * DQuat::from_rotation_y(-bar.to_angle())
}
