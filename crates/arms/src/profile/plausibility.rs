//! What a profile may say, and an arm is unlikely to be: `hapticd check` warns of it, nothing
//! refuses it.

use core::array::from_fn;

use super::{Profile, ProfileLimits, RealArm, TransportKind};
use crate::Pacing;
use crate::axes::MAX_AXES;
use crate::kinematics::{Configuration, Kinematics, M_PER_RAD};
use crate::motor_stage::{BESIDE_SHARE, at_grip};
use vps::spatial::{Axes, Wrench};

/// A joint that moves the grip this little off the way of the joints before it, as a share of its
/// own, adds no direction.
const ALIKE: f64 = 1e-3;
/// Share of a period that an exchange may take on a serial line: the arm has to measure and to
/// answer in the rest.
const LINE_SHARE: f64 = 0.8;
/// Bits of a byte on a serial line: start, eight of data, stop.
const BITS_PER_BYTE: f64 = 10.0;
/// Poses that are looked at beside home.
const N_POSES: u32 = 16;

/// Why a link does not carry the rate of a loop.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SlowLink {
    /// The arm exchanges fewer packets.
    #[error(
        "the link of {profile} carries {most_hz} exchanges per second (`link.rate_hz`), the loop \
            asks for {rate_hz}"
    )]
    Rate {
        /// Of the loop, Hz.
        rate_hz: u32,
        /// Nominal rate of the link, Hz.
        most_hz: u32,
        /// Whose link.
        profile: String,
    },
    /// A UART of this baud rate would not carry the bytes; a port on USB has no such limit.
    #[error(
        "match.baud = {baud} does not carry {rate_hz} exchanges of {n_bytes} bytes per second: a \
            UART needs {needed_baud:.0} or more, a lower `rate_hz` less; a port on USB ignores it"
    )]
    Line {
        /// Of the profile.
        baud: u32,
        /// Of the loop, Hz.
        rate_hz: u32,
        /// Of a command and its answer.
        n_bytes: usize,
        /// What carries them.
        needed_baud: f64,
    },
}

impl Profile {
    /// What deserves a second look, each as a sentence. Nothing for simulated arms; geometry is not
    /// looked at of those that report a pose.
    ///
    /// Cold: some 20 configurations are solved.
    pub fn plausibility_warnings(&self) -> Vec<String> {
        let Some(real) = &self.real else { return Vec::new() };
        let mut plausibility_warnings: Vec<String> = self
            .link_carries(self.link.rate_hz)
            .err()
            .map(|slow| slow.to_string())
            .into_iter()
            .collect();
        if !matches!(real.kinematics, Kinematics::Cartesian | Kinematics::Rate(_)) {
            plausibility_warnings.extend(self.of_geometry(real));
        }
        plausibility_warnings
    }

    /// Whether the link of the arm carries a loop of this rate. A simulated arm has none, and one
    /// that sends on change sets no rate.
    ///
    /// # Errors
    /// Why not, in numbers.
    pub fn link_carries(&self, rate_hz: u32) -> Result<(), SlowLink> {
        let Some(real) = self.real.as_ref().filter(|_| self.link.pacing != Pacing::Event) else {
            return Ok(());
        };
        let most_hz = self.link.rate_hz;
        if rate_hz > most_hz {
            return Err(SlowLink::Rate { rate_hz, most_hz, profile: self.name.clone() });
        }
        let is_serial = real.matching.transport == TransportKind::Serial;
        let Some(n_bytes) = real.protocol.exchange_bytes().filter(|_| is_serial) else {
            return Ok(());
        };
        let baud = real.matching.baud;
        let needed_baud = BITS_PER_BYTE * n_bytes as f64 * f64::from(rate_hz) / LINE_SHARE;
        if f64::from(baud) < needed_baud {
            return Err(SlowLink::Line { baud, rate_hz, n_bytes, needed_baud });
        }
        Ok(())
    }

    fn of_geometry(&self, real: &RealArm) -> Vec<String> {
        let mut plausibility_warnings = Vec::new();
        if real.checks.is_empty() {
            plausibility_warnings.push(
                "no [[check]]: nothing holds geometry and signs against a position that you know"
                    .to_owned(),
            );
        }
        let home = real.kinematics.home();
        let Some(at_home) = real.kinematics.solve(&home, &Configuration::default()) else {
            plausibility_warnings.push(
                "the arm cannot be at home: geometry, signs or `home_rad` are wrong".to_owned(),
            );
            return plausibility_warnings;
        };
        let away_m = at_home.native_from_grip.translation.length();
        if away_m > self.limits.workspace_radius_m {
            plausibility_warnings.push(format!(
                "at home the grip is {:.0} mm from the origin, outside of `workspace_radius_m` = \
                    {}: the origin is the middle of the workspace",
                away_m * 1e3,
                self.limits.workspace_radius_m
            ));
        }
        plausibility_warnings.extend(self.heavy(real, &at_home));
        let mut never = self.lacking(real, &at_home);
        let lacking_at_home = never.clone();
        for round in 1..=N_POSES {
            if let Some(there) =
                real.kinematics.solve(&real.kinematics.around(&home, round), &at_home)
            {
                let lacking = self.lacking(real, &there);
                never.retain(|axis| lacking.contains(axis));
            }
        }
        if !never.is_empty() {
            plausibility_warnings.push(format!(
                "the motors push along {} nowhere: `axis` of a joint is wrong, or a motor is \
                    missing",
                never.join(", ")
            ));
        } else if !lacking_at_home.is_empty() {
            plausibility_warnings.push(format!(
                "at home the motors cannot push along {}: the arm is stretched out or folded \
                    there, and a joint without `home_rad` stands at 0",
                lacking_at_home.join(", ")
            ));
        }
        plausibility_warnings
    }

    /// More compensation at home than the motor stage lets through.
    fn heavy(&self, real: &RealArm, at_home: &Configuration) -> Option<String> {
        let has_motor = |idx: usize| {
            real.transmission.joints.get(idx).is_some_and(|joint| joint.motor.is_some())
        };
        let pushes = at_home.pushes(has_motor, real.device_from_native, self.actuated)?;
        let torques = real.kinematics.extra_torques(&real.kinematics.home(), &[0.0; MAX_AXES]);
        let Wrench { force, torque } = at_grip(&pushes, &torques);
        let force_n = force.length();
        let torque_nm = torque.length();
        let ProfileLimits { force_n: most_n, torque_nm: most_nm, .. } = self.limits;
        (force_n > BESIDE_SHARE * most_n || torque_nm > BESIDE_SHARE * most_nm).then(|| {
            format!(
                "at home gravity compensation makes {force_n:.2} N and {torque_nm:.3} N·m at the \
                    grip, the limits are {most_n} N and {most_nm} N·m: more than {:.0} % of them \
                    does not go out; masses and centres of the links?",
                100.0 * BESIDE_SHARE
            )
        })
    }

    /// Actuated axes along which the motors cannot push by themselves, the grip being there.
    fn lacking(&self, real: &RealArm, there: &Configuration) -> Vec<&'static str> {
        let mut directions: Vec<Push> = Vec::new();
        for (joint, column) in real.transmission.joints.iter().zip(there.columns) {
            let [linear, angular] = [column.linear, M_PER_RAD * column.angular]
                .map(|part| real.device_from_native * part);
            let mut push: Push = from_fn(|axis| match axis {
                _ if !self.actuated.has(axis) => 0.0,
                0..3 => linear[axis],
                _ => angular[axis - 3],
            });
            let own = norm(&push);
            for known in &directions {
                let along: f64 = push.iter().zip(known).map(|(push, known)| push * known).sum();
                push = from_fn(|axis| push[axis] - along * known[axis]);
            }
            let left = norm(&push);
            if joint.motor.is_some() && left > ALIKE * own {
                directions.push(push.map(|part| part / left));
            }
        }
        let share = |axis: usize| directions.iter().map(|push| push[axis].powi(2)).sum::<f64>();
        (0..6)
            .filter(|axis| self.actuated.has(*axis) && share(*axis) < 1.0 - ALIKE)
            .map(|axis| Axes::NAMES[axis])
            .collect()
    }
}

/// A push along x, y, z and about them.
type Push = [f64; 6];

fn norm(push: &Push) -> f64 {
    push.iter().map(|part| part * part).sum::<f64>().sqrt()
}
