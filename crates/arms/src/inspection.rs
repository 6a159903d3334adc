//! What tests of whole arms (`crates/arms-testing`) need beside the interface: an arm over a link
//! of theirs, what its motors carry, motors that are wired the wrong way round. No part of the
//! interface, and nothing here makes a command.

use rtrb::{Consumer, Producer, RingBuffer};

use crate::attached::open::wired_parameters;
use crate::axes::MAX_AXES;
use crate::kinematics::Configuration;
use crate::profile::{Profile, RealArm};
use crate::protocol::Codec;
use crate::transport::Transport;
use crate::wired::{Connection, Replacements};
use crate::{IoPlacement, Timebase, WiredArm};
use vps::spatial::Wrench;

/// The part of the reconnect thread: takes lost links away and plugs others in.
pub struct Plug {
    to_arm: Producer<Connection>,
    lost: Consumer<Connection>,
}

impl Plug {
    /// Closes the lost link; false where the arm has not handed it over.
    pub fn take_lost(&mut self) -> bool {
        self.lost.pop().is_ok()
    }

    /// Plugs a link in whose codec has been through its start; false where another one waits.
    pub fn connect(&mut self, link: Box<dyn Transport>, codec: Box<dyn Codec>) -> bool {
        self.to_arm.push(connection(link, codec)).is_ok()
    }
}

fn connection(link: Box<dyn Transport>, codec: Box<dyn Codec>) -> Connection {
    Connection { link, codec, guard: Ok(None) }
}

/// The driver of an arm over a link whose codec has been through its start. Its time goes on by a
/// period a read.
pub fn wired(
    profile: &Profile,
    real: &RealArm,
    period_s: f64,
    link: Box<dyn Transport>,
    codec: Box<dyn Codec>,
) -> (WiredArm, Plug) {
    let (to_arm, fresh) = RingBuffer::new(1);
    let (spent, lost) = RingBuffer::new(1);
    let mut parameters = wired_parameters(profile, real, period_s, IoPlacement::InLoop);
    parameters.timebase = Timebase::Counted;
    let arm = WiredArm::new(connection(link, codec), Replacements { fresh, spent }, parameters);
    (arm, Plug { to_arm, lost })
}

/// What a wrench asks of one motor.
#[derive(Clone, Copy, Debug)]
pub struct MotorLoad {
    /// Torque at the joint, N·m, or force of a slide, N.
    pub torque_nm: f64,
    /// What holds the weight of the links there.
    pub weight_nm: f64,
    /// Units of the wire for 1 N·m.
    pub units_per_nm: f64,
}

/// What a wrench in the device frame asks of each motor where the encoders say `readings`; nothing
/// where that is no pose.
pub fn motor_loads(
    real: &RealArm,
    readings: &[f64; MAX_AXES],
    wrench_device: &Wrench,
) -> Vec<MotorLoad> {
    let joints = real.transmission.angles(readings);
    let Some(configuration) = real.kinematics.solve(&joints, &Configuration::default()) else {
        return Vec::new();
    };
    let back = real.device_from_native.conjugate();
    let wrench = Wrench::new(back * wrench_device.force, back * wrench_device.torque);
    let torques = configuration.torques(&wrench);
    let weights = real.kinematics.extra_torques(&joints, &[0.0; MAX_AXES]);
    let joints = torques.iter().zip(weights).zip(&real.transmission.joints);
    joints
        .filter_map(|((torque_nm, weight_nm), joint)| {
            let units_per_nm = joint.motor?.units_per_nm;
            Some(MotorLoad { torque_nm: *torque_nm, weight_nm, units_per_nm })
        })
        .collect()
}

/// Whether the host compensates or damps: whether motors make something beside the command.
pub fn compensates(real: &RealArm) -> bool {
    let torques = real.kinematics.extra_torques(&real.kinematics.home(), &[1.0; MAX_AXES]);
    torques.iter().any(|torque| *torque != 0.0)
}

/// The numbers of the motors, in the order of the joints.
pub fn motors(real: &RealArm) -> Vec<usize> {
    real.transmission.joints.iter().filter_map(|joint| Some(joint.motor?.motor_idx)).collect()
}

/// Wires these motors the wrong way round.
pub fn reverse_motors(real: &mut RealArm, motors: &[usize]) {
    for joint in &mut real.transmission.joints {
        if let Some(motor) = joint.motor.as_mut().filter(|motor| motors.contains(&motor.motor_idx))
        {
            motor.units_per_nm = -motor.units_per_nm;
        }
    }
}
