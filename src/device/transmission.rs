//! Transmission: readings into joint angles, joint torques into motor commands.
//!
//! Per joint, with the signs, gears and constants of the profile:
//!
//! ```text
//! θ = sign_e · unit · (reading + home) + θ₀            command = sign_m · τ / torque per unit of command
//! ```
//!
//! When any motor would exceed its limit, **all** of them are scaled by one factor, so that the direction of the force stays (devices
//! reference, section 3.4).

use super::protocol::MAX_AXES;

/// The sensor of a joint: θ = `rad_per_unit` · (reading + `home`) + `offset_rad`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sensor {
    /// Which reading of the report.
    pub reading_idx: usize,
    /// Angle per unit of the reading, its sign included.
    pub rad_per_unit: f64,
    /// Reading at the zero of the joint, less its sign: added before scaling.
    pub home: f64,
    /// Angle at the home reading.
    pub offset_rad: f64,
}

/// The motor of a joint.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Motor {
    /// Which motor of the command.
    pub motor_idx: usize,
    /// Command per N·m at the joint, its sign included.
    pub units_per_nm: f64,
    /// Largest |command|.
    pub limit_units: f64,
}

/// A joint with what belongs to it; a passive one has no motor.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Joint {
    /// Its sensor; `None` for a joint that is not measured, and stays at 0.
    pub sensor: Option<Sensor>,
    /// Its motor.
    pub motor: Option<Motor>,
}

/// The joints of an arm in the order of its kinematics.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Transmission {
    /// `[MAX_AXES]`; joints beyond those of the kinematics are empty.
    pub joints: [Joint; MAX_AXES],
}

impl Transmission {
    /// Joint angles of readings. RT: safe.
    pub fn angles(&self, readings: &[f64; MAX_AXES]) -> [f64; MAX_AXES] {
        self.joints.map(|joint| match joint.sensor {
            Some(Sensor { reading_idx, rad_per_unit, home, offset_rad }) => {
                rad_per_unit * (readings.get(reading_idx).copied().unwrap_or(0.0) + home) + offset_rad
            }
            None => 0.0,
        })
    }

    /// Readings at joint angles: what an arm's encoders would say.
    pub fn readings(&self, angles: &[f64; MAX_AXES]) -> [f64; MAX_AXES] {
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

    /// Motor commands for joint torques and the factor ≤ 1 by which all of them were scaled. RT: safe.
    pub fn commands(&self, torques_nm: &[f64; MAX_AXES]) -> ([f64; MAX_AXES], f64) {
        let mut commands = [0.0; MAX_AXES];
        let mut scale = 1.0_f64;
        for (joint, torque_nm) in self.joints.iter().zip(torques_nm) {
            if let Some(motor) = joint.motor
                && let Some(command) = commands.get_mut(motor.motor_idx)
            {
                *command = motor.units_per_nm * torque_nm;
                if command.abs() > motor.limit_units {
                    scale = scale.min(motor.limit_units / command.abs());
                }
            }
        }
        (commands.map(|command| command * scale), scale)
    }

    /// Joint torques that motor commands make: the inverse of [`Self::commands`] without a limit, for simulated arms.
    pub fn torques(&self, commands: &[f64; MAX_AXES]) -> [f64; MAX_AXES] {
        self.joints.map(|joint| match joint.motor {
            Some(motor) if motor.units_per_nm != 0.0 => commands.get(motor.motor_idx).copied().unwrap_or(0.0) / motor.units_per_nm,
            _ => 0.0,
        })
    }
}
