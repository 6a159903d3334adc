//! What lies between the grip of a simulated arm and its board: joints, encoders, motors.

use glam::{DQuat, DVec3};

use crate::device::kinematics::{Configuration, Kinematics};
use crate::device::protocol::{ArmReadings, MAX_AXES};
use crate::device::transmission::Transmission;
use crate::spatial::{Axes, Mat6, Pose, Twist, Wrench};

/// Share of the mean stiffness that keeps the solve for a wrench well posed: far below what any wire resolves.
const RIDGE: f64 = 1e-10;

/// The mechanics of an arm, seen from its board.
#[derive(Clone, Debug)]
pub(in crate::device) struct Linkage {
    kinematics: Kinematics,
    transmission: Transmission,
    device_from_native: DQuat,
    actuated: Axes,
    joints: [f64; MAX_AXES],
    joint_rates: [f64; MAX_AXES],
    configuration: Configuration,
}

impl Linkage {
    /// At rest at its home pose. `device_from_native`: from the frame of the kinematics.
    pub(in crate::device) fn new(
        kinematics: Kinematics,
        transmission: Transmission,
        device_from_native: DQuat,
        actuated: Axes,
    ) -> Self {
        let joints = kinematics.home();
        let configuration = kinematics.solve(&joints, &Configuration::default()).unwrap_or_default();
        Self { kinematics, transmission, device_from_native, actuated, joints, joint_rates: [0.0; MAX_AXES], configuration }
    }

    /// Where the grip is, `device_from_grip`, in the device frame.
    pub(in crate::device) fn pose(&self) -> Pose {
        let native = self.configuration.native_from_grip;
        let turned = self.device_from_native * native.rotation * self.device_from_native.conjugate();
        Pose::new(turned.normalize(), self.device_from_native * native.translation)
    }

    /// Moves the joints to where the grip is after a period; they stay where they are when it is out of reach.
    pub(in crate::device) fn follow(&mut self, device_from_grip: Pose, twist: Twist, period_s: f64) {
        let back = self.device_from_native.conjugate();
        let native = Pose::new(
            (back * device_from_grip.rotation * self.device_from_native).normalize(),
            back * device_from_grip.translation,
        );
        let twist_native = Twist { linear: back * twist.linear, angular: back * twist.angular };
        if let Some(joints) = self.kinematics.rate_joints(&twist_native) {
            self.joints = joints;
            return;
        }
        let found = self.kinematics.inverse(&native, &self.joints);
        let solved = found.and_then(|joints| Some((joints, self.kinematics.solve(&joints, &self.configuration)?)));
        let Some((joints, configuration)) = solved else {
            self.joint_rates = [0.0; MAX_AXES];
            return;
        };
        self.joint_rates = match self.kinematics {
            Kinematics::Cartesian => {
                let ([vx, vy, vz], [wx, wy, wz]) = (twist_native.linear.to_array(), twist_native.angular.to_array());
                [vx, vy, vz, wx, wy, wz, 0.0, 0.0]
            }
            _ => core::array::from_fn(|idx| (joints[idx] - self.joints[idx]) / period_s),
        };
        self.joints = joints;
        self.configuration = configuration;
    }

    /// What the encoders say.
    pub(in crate::device) fn readings(&self) -> ArmReadings {
        ArmReadings {
            readings: self.transmission.readings(&self.joints),
            rates: self.transmission.reading_rates(&self.joint_rates),
            buttons: 0,
            homed: true,
        }
    }

    /// What the motors do to the grip: device axes, at the grip point. The plant knows no weight, so what a command holds against the weight of the
    /// links is taken off; without a command there is nothing.
    pub(in crate::device) fn wrench(&self, motors: &[f64; MAX_AXES]) -> Wrench {
        if motors.iter().all(|motor| *motor == 0.0) {
            return Wrench::ZERO;
        }
        let weight = self.kinematics.extra_torques(&self.joints, &[0.0; MAX_AXES]);
        let torques = self.transmission.torques(motors);
        let (forced, turned) = (self.actuated.linear_mask(), self.actuated.angular_mask());
        // The least wrench W with JᵀW = τ: (J·Jᵀ)·W = J·τ, over the axes that have a motor.
        let mut stiffness = Mat6::ZERO;
        let mut pushed = Wrench::ZERO;
        for (idx, column) in self.configuration.columns.iter().enumerate() {
            if self.transmission.joints[idx].motor.is_none() {
                continue;
            }
            let linear = self.device_from_native * column.linear * forced;
            let angular = self.device_from_native * column.angular * turned;
            stiffness.add_outer(1.0, linear, angular);
            let torque = torques[idx] - weight[idx];
            pushed.force += linear * torque;
            pushed.torque += angular * torque;
        }
        let trace: f64 = (0..6).map(|idx| stiffness.0[idx][idx]).sum();
        for idx in 0..6 {
            stiffness.0[idx][idx] += RIDGE * trace.max(f64::MIN_POSITIVE);
        }
        match stiffness.solve_spd(pushed) {
            Some((force, torque)) if force.is_finite() && torque.is_finite() => Wrench::new(force, torque),
            _ => Wrench::new(DVec3::ZERO, DVec3::ZERO),
        }
    }
}
