//! What lies between the grip of a simulated arm and its board: joints, encoders, motors.

use glam::DQuat;

use crate::kinematics::{Configuration, Kinematics};
use crate::protocol::{ArmReadings, MAX_AXES};
use crate::transmission::Transmission;
use vps::spatial::{Axes, Pose, Twist, Wrench};

/// The mechanics of an arm, seen from its board.
#[derive(Clone, Debug)]
pub(crate) struct Linkage {
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
    pub(crate) fn new(
        kinematics: Kinematics,
        transmission: Transmission,
        device_from_native: DQuat,
        actuated: Axes,
    ) -> Self {
        let joints = kinematics.home();
        let configuration =
            kinematics.solve(&joints, &Configuration::default()).unwrap_or_default();
        Self {
            kinematics,
            transmission,
            device_from_native,
            actuated,
            joints,
            joint_rates: [0.0; MAX_AXES],
            configuration,
        }
    }

    /// Where the grip is, `device_from_grip`, in the device frame.
    pub(crate) fn pose(&self) -> Pose {
        let native = self.configuration.native_from_grip;
        let turned =
            self.device_from_native * native.rotation * self.device_from_native.conjugate();
        Pose::new(turned.normalize(), self.device_from_native * native.translation)
    }

    /// Moves the joints to where the grip is after a period; they stay where they are when it is
    /// out of reach.
    pub(crate) fn follow(&mut self, device_from_grip: Pose, twist: Twist, period_s: f64) {
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
        let solved = found.and_then(|joints| {
            Some((joints, self.kinematics.solve(&joints, &self.configuration)?))
        });
        let Some((joints, configuration)) = solved else {
            self.joint_rates = [0.0; MAX_AXES];
            return;
        };
        self.joint_rates = match self.kinematics {
            Kinematics::Cartesian => {
                let ([vx, vy, vz], [wx, wy, wz]) =
                    (twist_native.linear.to_array(), twist_native.angular.to_array());
                [vx, vy, vz, wx, wy, wz, 0.0, 0.0]
            }
            _ => core::array::from_fn(|idx| (joints[idx] - self.joints[idx]) / period_s),
        };
        self.joints = joints;
        self.configuration = configuration;
    }

    /// What the encoders say.
    pub(crate) fn readings(&self) -> ArmReadings {
        ArmReadings {
            readings: self.transmission.readings(&self.joints),
            rates: self.transmission.reading_rates(&self.joint_rates),
            buttons: 0,
            homed: true,
            asleep: false,
        }
    }

    /// What the motors do to the grip: device axes, at the grip point. The plant knows no weight,
    /// so of what a command holds against the weight of the links `held`, a share in 0..=1, is
    /// taken off; without a command there is nothing.
    pub(crate) fn wrench(&self, motors: &[f64; MAX_AXES], held: f64) -> Wrench {
        if motors.iter().all(|motor| *motor == 0.0) {
            return Wrench::ZERO;
        }
        let weight = self.kinematics.extra_torques(&self.joints, &[0.0; MAX_AXES]);
        let has_motor = |idx: usize| {
            self.transmission.joints.get(idx).is_some_and(|joint| joint.motor.is_some())
        };
        let Some(pushes) =
            self.configuration.pushes(has_motor, self.device_from_native, self.actuated)
        else {
            return Wrench::ZERO;
        };
        let torques = self.transmission.torques(motors);
        let each = pushes.iter().zip(torques).zip(weight);
        each.fold(Wrench::ZERO, |wrench, ((push, torque), weight)| {
            wrench + *push * (torque - held * weight)
        })
    }
}
