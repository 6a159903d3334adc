//! Transmission: readings into joint angles, joint torques into motor commands.
//!
//! Per joint, with the signs, gears and constants of the profile:
//!
//! ```text
//! θ = sign_e · unit · (reading + home) + θ₀            command = sign_m · τ / torque per unit of command
//! ```
//!
//! When any motor would exceed its limit, **all** of them are scaled by one factor, so that the
//! direction of the force stays (devices reference, section 3.4). Torques beside the wrench
//! (gravity compensation) are scaled with it, so the factor is also what is left of the wrench.

use core::f64::consts::TAU;

use super::axes::MAX_AXES;

/// The sensor of a joint: θ = `rad_per_unit` · (reading + `home`) + `offset_rad`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Sensor {
    /// Which reading of the report.
    pub(super) reading_idx: usize,
    /// Angle per unit of the reading, its sign included.
    pub(super) rad_per_unit: f64,
    /// Reading at the zero of the joint, less its sign: added before scaling.
    pub(super) home: f64,
    /// Angle at the home reading.
    pub(super) offset_rad: f64,
}

impl Sensor {
    /// An encoder behind a capstan: θ = sign · 2π · (counts + home) / counts per turn · ratio +
    /// offset, the ratio being that of the diameters of capstan and body.
    pub(super) fn encoder(
        reading_idx: usize,
        counts_per_rev: f64,
        ratio: f64,
        sign: f64,
        home: f64,
        offset_rad: f64,
    ) -> Self {
        Self { reading_idx, rad_per_unit: sign * TAU / counts_per_rev * ratio, home, offset_rad }
    }
}

/// The motor of a joint.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Motor {
    /// Which motor of the command.
    pub(super) motor_idx: usize,
    /// Command per N·m at the joint, its sign included.
    pub(super) units_per_nm: f64,
    /// Largest |command|.
    pub(super) limit_units: f64,
}

impl Motor {
    /// A motor that takes mA, behind a capstan: I = sign · τ · ratio / Kt. `current_scale`: real
    /// amperes per commanded ampere.
    pub(super) fn current(
        motor_idx: usize,
        ratio: f64,
        torque_constant_nm_per_a: f64,
        current_scale: f64,
        sign: f64,
        limit_ma: f64,
    ) -> Self {
        let units_per_nm = sign * 1e3 * ratio / (torque_constant_nm_per_a * current_scale);
        Self { motor_idx, units_per_nm, limit_units: limit_ma }
    }

    /// A motor that takes torque in N·m, times a factor that its sign belongs to.
    pub(super) fn torque(motor_idx: usize, units_per_nm: f64, limit_units: f64) -> Self {
        Self { motor_idx, units_per_nm, limit_units }
    }
}

/// A joint with what belongs to it; a passive one has no motor.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Joint {
    /// Its sensor; `None` for a joint that is not measured, and stays at 0.
    pub(super) sensor: Option<Sensor>,
    /// Its motor.
    pub(super) motor: Option<Motor>,
}

/// The joints of an arm in the order of its kinematics.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Transmission {
    /// `[MAX_AXES]`; joints beyond those of the kinematics are empty.
    pub(super) joints: [Joint; MAX_AXES],
}

impl Transmission {
    /// Joint angles of readings. RT: safe.
    pub(super) fn angles(&self, readings: &[f64; MAX_AXES]) -> [f64; MAX_AXES] {
        self.joints.map(|joint| match joint.sensor {
            Some(Sensor { reading_idx, rad_per_unit, home, offset_rad }) => {
                rad_per_unit * (readings.get(reading_idx).copied().unwrap_or(0.0) + home)
                    + offset_rad
            }
            None => 0.0,
        })
    }

    /// Joint rates of rates of the readings. RT: safe.
    pub(super) fn rates(&self, reading_rates: &[f64; MAX_AXES]) -> [f64; MAX_AXES] {
        self.joints.map(|joint| match joint.sensor {
            Some(sensor) => {
                sensor.rad_per_unit * reading_rates.get(sensor.reading_idx).copied().unwrap_or(0.0)
            }
            None => 0.0,
        })
    }

    /// Rates of the readings at joint rates: the inverse of [`Self::rates`].
    pub(super) fn reading_rates(&self, rates: &[f64; MAX_AXES]) -> [f64; MAX_AXES] {
        let mut reading_rates = [0.0; MAX_AXES];
        for (joint, rate) in self.joints.iter().zip(rates) {
            if let Some(sensor) = joint.sensor
                && let Some(reading_rate) = reading_rates.get_mut(sensor.reading_idx)
            {
                *reading_rate = rate / sensor.rad_per_unit;
            }
        }
        reading_rates
    }

    /// Readings at joint angles: what an arm's encoders would say.
    pub(super) fn readings(&self, angles: &[f64; MAX_AXES]) -> [f64; MAX_AXES] {
        let mut readings = [0.0; MAX_AXES];
        for (joint, angle) in self.joints.iter().zip(angles) {
            if let Some(sensor) = joint.sensor
                && let Some(reading) = readings.get_mut(sensor.reading_idx)
            {
                *reading = (angle - sensor.offset_rad) / sensor.rad_per_unit - sensor.home;
            }
        }
        readings
    }

    /// Motor commands for the joint torques of a wrench and those beside it, and the factor ≤ 1 by
    /// which all of them were scaled: what the motors make of the wrench. All commands and the
    /// factor are zero when a torque is not a number. RT: safe.
    pub(super) fn commands(
        &self,
        torques_nm: &[f64; MAX_AXES],
        extra_nm: &[f64; MAX_AXES],
    ) -> ([f64; MAX_AXES], f64) {
        let mut commands = [0.0; MAX_AXES];
        let mut scale = 1.0_f64;
        for ((joint, torque_nm), extra_nm) in self.joints.iter().zip(torques_nm).zip(extra_nm) {
            if let Some(motor) = joint.motor
                && let Some(command) = commands.get_mut(motor.motor_idx)
            {
                *command = motor.units_per_nm * (torque_nm + extra_nm);
                if !command.is_finite() {
                    return ([0.0; MAX_AXES], 0.0);
                }
                if command.abs() > motor.limit_units {
                    scale = scale.min(motor.limit_units / command.abs());
                }
            }
        }
        (commands.map(|command| command * scale), scale)
    }

    /// Joint torques that motor commands make: the inverse of [`Self::commands`] without a limit,
    /// for simulated arms.
    pub(super) fn torques(&self, commands: &[f64; MAX_AXES]) -> [f64; MAX_AXES] {
        self.joints.map(|joint| match joint.motor {
            Some(motor) if motor.units_per_nm != 0.0 => {
                commands.get(motor.motor_idx).copied().unwrap_or(0.0) / motor.units_per_nm
            }
            _ => 0.0,
        })
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn arm() -> Transmission {
        let mut transmission = Transmission::default();
        for (idx, (cpr, ratio, sign)) in
            [(2000.0, 10.0 / 160.0, -1.0), (2000.0, 10.0 / 120.0, 1.0), (4096.0, 0.137, -1.0)]
                .into_iter()
                .enumerate()
        {
            transmission.joints[idx] = Joint {
                sensor: Some(Sensor::encoder(idx, cpr, ratio, sign, 100.0 * idx as f64, 0.5)),
                motor: Some(Motor::current(2 - idx, ratio, 0.0259, 1.0, sign, 2000.0)),
            };
        }
        // A passive joint reads another place of the report than its own number.
        transmission.joints[3].sensor = Some(Sensor::encoder(5, 1024.0, 1.0, -1.0, 30.0, 0.0));
        transmission
    }

    proptest! {
        #[test]
        fn readings_and_angles_are_inverse(angles in proptest::array::uniform4(-7.0..7.0f64)) {
            let mut joints = [0.0; MAX_AXES];
            joints[..4].copy_from_slice(&angles);
            let back = arm().angles(&arm().readings(&joints));
            let rates = arm().rates(&arm().reading_rates(&joints));
            for idx in 0..MAX_AXES {
                prop_assert!((back[idx] - joints[idx]).abs() < 1e-12);
                prop_assert!((rates[idx] - joints[idx]).abs() < 1e-12);
            }
        }

        #[test]
        fn torques_and_commands_are_inverse_up_to_one_factor(
            torques in proptest::array::uniform3(-2.0..2.0f64),
            extra in proptest::array::uniform3(-0.3..0.3f64),
        ) {
            let mut wanted = [0.0; MAX_AXES];
            let mut beside = [0.0; MAX_AXES];
            wanted[..3].copy_from_slice(&torques);
            beside[..3].copy_from_slice(&extra);
            let (commands, scale) = arm().commands(&wanted, &beside);
            prop_assert!(scale > 0.0 && scale <= 1.0);
            prop_assert!(commands.iter().all(|command| command.abs() <= 2000.0 * (1.0 + 1e-12)));
            prop_assert!(scale == 1.0 || commands.iter().any(|command| command.abs() > 2000.0 * (1.0 - 1e-12)));
            let made = arm().torques(&commands);
            for idx in 0..MAX_AXES {
                prop_assert!((made[idx] - scale * (wanted[idx] + beside[idx])).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn an_encoder_and_a_current_follow_the_formulas() {
        // Polhem 2022, axis A: 100 counts past home are 0.02529 rad, and 1 N·m is 2734.3 mA.
        let ratio = 28.8534 / 175.0;
        let mut transmission = Transmission::default();
        transmission.joints[0] = Joint {
            sensor: Some(Sensor::encoder(0, 4096.0, ratio, 1.0, 8312.0, 0.0)),
            motor: Some(Motor::current(0, ratio, 0.0603, 0.5, 1.0, 1e9)),
        };
        let mut readings = [0.0; MAX_AXES];
        readings[0] = 100.0;
        assert!((transmission.angles(&readings)[0] - 2.127_542).abs() < 1e-6);
        let mut torques = [0.0; MAX_AXES];
        torques[0] = 1.0;
        let (commands, _) = transmission.commands(&torques, &[0.0; MAX_AXES]);
        assert!(
            (commands[0] - 2.0 * 2734.2715).abs() < 0.01,
            "half the amperes arrive, so twice as many are asked for: {}",
            commands[0]
        );
    }

    #[test]
    fn what_is_not_a_number_moves_no_motor() {
        let mut torques = [0.1; MAX_AXES];
        torques[1] = f64::NAN;
        assert_eq!(arm().commands(&torques, &[0.0; MAX_AXES]), ([0.0; MAX_AXES], 0.0));
        assert_eq!(
            arm().commands(&[0.1; MAX_AXES], &[f64::INFINITY; MAX_AXES]),
            ([0.0; MAX_AXES], 0.0)
        );
    }
}
