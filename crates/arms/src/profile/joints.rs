//! `[geometry]`, `[[joint]]` and `[motors]` into kinematics, transmission and heat.

use core::f64::consts::TAU;

use glam::{DQuat, DVec2, DVec3};

use super::written::{Geometry, Joint as WrittenJoint, KinematicsWord, ProfileFile};
use super::{Profile, ceilings};
use crate::Thermal;
use crate::axes::MAX_AXES;
use crate::kinematics::{
    Capstan, CapstanLinks, Chain, ChainJoint, Delta, FiveLink, GRAVITY_M_PER_S2, Gimbal,
    Kinematics, OneAxis, Pantograph, PlaneLink, Rate,
};
use crate::protocol::ServoModel;
use crate::transmission::{Joint, Motor, Sensor, Transmission};
use document::{Checks, FINITE, Interval, NOT_NEGATIVE, Numbers, POSITIVE, show};
use vps::spatial::{Axes, Pose};

/// Damping of chain joints where a profile gives none, N·m·s/rad. *Assumed.*
const DEFAULT_DAMPING_NM_S_PER_RAD: f64 = 0.02;
/// Counts per turn of a Dynamixel servo.
const SERVO_COUNTS_PER_REV: f64 = 4096.0;
const MOTOR_SCALE: Interval = Interval::from(ceilings::MOTOR_SCALE[0]).to(ceilings::MOTOR_SCALE[1]);
const LINK_CENTER: Interval =
    Interval::from(-ceilings::LINK_CENTER_MM).to(ceilings::LINK_CENTER_MM).unit("mm");

/// What the joints of an arm come to.
pub(super) struct Joints {
    pub(super) kinematics: Kinematics,
    pub(super) transmission: Transmission,
    pub(super) thermal: Thermal,
    /// Readings that the sensors ask for.
    pub(super) n_readings: usize,
    /// Motors that the joints ask for.
    pub(super) n_motors: usize,
}

/// Keys that arms with encoders behind capstans and motors share.
const DRIVE_KEYS: [&str; 10] = [
    "capstan_diameter_mm",
    "body_diameter_mm",
    "counts_per_rev",
    "torque_constant_nm_per_a",
    "command_per_nm",
    "encoder_sign",
    "motor_sign",
    "home_counts",
    "joint_offset_rad",
    "current_scale",
];
const WRIST_KEYS: [&str; 4] =
    ["gimbal", "gimbal_counts_per_rev", "gimbal_sign", "gimbal_home_counts"];

pub(super) fn joints(
    checks: &mut Checks<'_>,
    written: &ProfileFile,
    profile: &Profile,
    device_from_native: DQuat,
) -> Option<Joints> {
    let accepted = "how the joints move the grip, such as \"serial-capstan\", or \"cartesian\" for \
        an arm that reports a pose";
    let word = checks.given("device.kinematics", written.device.kinematics, accepted)?;
    let nothing = Geometry::default();
    let geometry = written.geometry.as_ref().unwrap_or(&nothing);
    refuse_others(checks, geometry, word);
    if word != KinematicsWord::Chain && !written.joint.is_empty() {
        checks.not_accepted("joint", "left out: only kinematics \"chain\" has [[joint]] tables");
    }
    let is_driven = profile.actuated != Axes::NONE;
    let mut drive = Drive {
        checks,
        geometry,
        written,
        is_driven,
        transmission: Transmission::default(),
        continuous: [0.0; MAX_AXES],
    };
    let kinematics = match word {
        KinematicsWord::Cartesian => {
            drive.pose(profile.actuated);
            Some(Kinematics::Cartesian)
        }
        KinematicsWord::SerialCapstan => drive.capstan().map(Kinematics::Capstan),
        KinematicsWord::PolhemFiveLink => drive.five_link().map(Kinematics::FiveLink),
        KinematicsWord::Pantograph => drive.pantograph().map(Kinematics::Pantograph),
        KinematicsWord::FalconDelta => drive.delta().map(Kinematics::Delta),
        KinematicsWord::Chain => drive.chain(device_from_native).map(Kinematics::Chain),
        KinematicsWord::OneAxis => drive.one_axis(profile).map(Kinematics::OneAxis),
        KinematicsWord::None => drive.rate(profile).map(Kinematics::Rate),
    };
    let Drive { transmission, continuous, .. } = drive;
    let thermal_time_s = written.motors.as_ref().and_then(|motors| motors.thermal_time_s);
    let time_s = checks
        .optional(
            "motors.thermal_time_s",
            thermal_time_s,
            POSITIVE.to(ceilings::THERMAL_TIME_S).unit("s"),
        )
        .unwrap_or(0.0);
    if continuous.iter().any(|units| *units > 0.0) && thermal_time_s.is_none() {
        checks.missing("motors.thermal_time_s", "the time constant of the winding, s");
    }
    let sensors = transmission
        .joints
        .iter()
        .filter_map(|joint| joint.sensor.map(|sensor| sensor.reading_idx + 1));
    let motors =
        transmission.joints.iter().filter_map(|joint| joint.motor.map(|motor| motor.motor_idx + 1));
    let n_readings = sensors.max().unwrap_or(0);
    let n_motors = motors.max().unwrap_or(0);
    Some(Joints {
        kinematics: kinematics?,
        transmission,
        thermal: Thermal::new(continuous, time_s),
        n_readings,
        n_motors,
    })
}

/// Geometry that this kind of arm does not have: it would silently do nothing.
fn refuse_others(checks: &mut Checks<'_>, geometry: &Geometry, word: KinematicsWord) {
    let g = geometry;
    let keys = [
        ("capstan_diameter_mm", g.capstan_diameter_mm.is_some()),
        ("body_diameter_mm", g.body_diameter_mm.is_some()),
        ("length_mm", g.length_mm.is_some()),
        ("origin_m", g.origin_m.is_some()),
        ("counts_per_rev", g.counts_per_rev.is_some()),
        ("torque_constant_nm_per_a", g.torque_constant_nm_per_a.is_some()),
        ("command_per_nm", g.command_per_nm.is_some()),
        ("encoder_sign", g.encoder_sign.is_some()),
        ("motor_sign", g.motor_sign.is_some()),
        ("home_counts", g.home_counts.is_some()),
        ("joint_offset_rad", g.joint_offset_rad.is_some()),
        ("current_scale", g.current_scale.is_some()),
        ("gimbal", g.gimbal.is_some()),
        ("gimbal_counts_per_rev", g.gimbal_counts_per_rev.is_some()),
        ("gimbal_sign", g.gimbal_sign.is_some()),
        ("gimbal_home_counts", g.gimbal_home_counts.is_some()),
        ("gravity_compensation", g.gravity_compensation.is_some()),
        ("link_mass_g", g.link_mass_g.is_some()),
        ("link_along_mm", g.link_along_mm.is_some()),
        ("link_across_mm", g.link_across_mm.is_some()),
        ("inner_mm", g.inner_mm.is_some()),
        ("outer_mm", g.outer_mm.is_some()),
        ("distance_mm", g.distance_mm.is_some()),
        ("arm_port", g.arm_port.is_some()),
        ("torque_scale", g.torque_scale.is_some()),
        ("driven_mm", g.driven_mm.is_some()),
        ("rod_mm", g.rod_mm.is_some()),
        ("offset_mm", g.offset_mm.is_some()),
        ("radius_mm", g.radius_mm.is_some()),
        ("shift_mm", g.shift_mm.is_some()),
        ("azimuth_deg", g.azimuth_deg.is_some()),
        ("grip_position_m", g.grip_position_m.is_some()),
        ("grip_orientation_xyzw", g.grip_orientation_xyzw.is_some()),
        ("m_per_rad", g.m_per_rad.is_some()),
        ("full_scale", g.full_scale.is_some()),
        ("linear_mm_per_s", g.linear_mm_per_s.is_some()),
        ("angular_deg_per_s", g.angular_deg_per_s.is_some()),
    ];
    let own: &[&str] = match word {
        KinematicsWord::Cartesian => &["origin_m"],
        KinematicsWord::SerialCapstan => {
            &["length_mm", "origin_m", "gravity_compensation", "link_mass_g", "link_along_mm"]
        }
        KinematicsWord::PolhemFiveLink => &[
            "length_mm",
            "origin_m",
            "gravity_compensation",
            "link_mass_g",
            "link_along_mm",
            "link_across_mm",
        ],
        KinematicsWord::Pantograph => {
            &["inner_mm", "outer_mm", "distance_mm", "origin_m", "arm_port", "torque_scale"]
        }
        KinematicsWord::FalconDelta => &[
            "driven_mm",
            "rod_mm",
            "offset_mm",
            "radius_mm",
            "shift_mm",
            "azimuth_deg",
            "origin_m",
        ],
        KinematicsWord::Chain => {
            &["grip_position_m", "grip_orientation_xyzw", "gravity_compensation"]
        }
        KinematicsWord::OneAxis => &["m_per_rad"],
        KinematicsWord::None => &["full_scale", "linear_mm_per_s", "angular_deg_per_s"],
    };
    let is_capstan = matches!(word, KinematicsWord::SerialCapstan | KinematicsWord::PolhemFiveLink);
    let has_drive =
        is_capstan || matches!(word, KinematicsWord::FalconDelta | KinematicsWord::OneAxis);
    let belongs = |key: &str| {
        own.contains(&key)
            || has_drive && DRIVE_KEYS.contains(&key)
            || is_capstan && WRIST_KEYS.contains(&key)
    };
    for (key, _) in keys.into_iter().filter(|(key, is_written)| *is_written && !belongs(key)) {
        checks.not_accepted(
            &format!("geometry.{key}"),
            format_args!("left out: kinematics \"{}\" has none", word),
        );
    }
}

/// Builds sensors and motors while it reads the geometry.
struct Drive<'a, 'd> {
    checks: &'a mut Checks<'d>,
    geometry: &'a Geometry,
    written: &'a ProfileFile,
    is_driven: bool,
    transmission: Transmission,
    continuous: [f64; MAX_AXES],
}

impl Drive<'_, '_> {
    /// `n` numbers of an array; the default for all of them when it is left out, a problem without
    /// a default.
    fn list(
        &mut self,
        key: &str,
        written: Option<&Vec<f64>>,
        n: usize,
        default: Option<f64>,
        interval: Interval,
    ) -> Vec<f64> {
        let Some(numbers) = written else {
            if default.is_none() {
                self.checks.missing(key, format_args!("an array of {n} numbers, each {interval}"));
            }
            return vec![default.unwrap_or(1.0); n];
        };
        if numbers.len() != n {
            self.checks
                .not_accepted(key, format_args!("an array of {n} numbers, one for each joint"));
            return vec![default.unwrap_or(1.0); n];
        }
        numbers
            .iter()
            .enumerate()
            .map(|(idx, number)| {
                self.checks.number(
                    &format!("{key}[{idx}]"),
                    Some(*number),
                    default.unwrap_or(1.0),
                    interval,
                )
            })
            .collect()
    }

    fn signs(&mut self, key: &str, written: Option<&Vec<f64>>, n: usize) -> Vec<f64> {
        let signs = self.list(key, written, n, None, FINITE);
        for (idx, sign) in signs.iter().enumerate().filter(|(_, sign)| sign.abs() != 1.0) {
            let _ = sign;
            self.checks.not_accepted(&format!("{key}[{idx}]"), "1 or -1");
        }
        signs
    }

    /// Encoders and motors of `n` joints.
    fn drives(&mut self, n: usize) {
        let g = self.geometry;
        let ratio: Vec<f64> = match (&g.capstan_diameter_mm, &g.body_diameter_mm) {
            (None, None) => vec![1.0; n],
            (capstan, body) => {
                let capstan = self.list(
                    "geometry.capstan_diameter_mm",
                    capstan.as_ref(),
                    n,
                    None,
                    POSITIVE.unit("mm"),
                );
                let body = self.list(
                    "geometry.body_diameter_mm",
                    body.as_ref(),
                    n,
                    None,
                    POSITIVE.unit("mm"),
                );
                capstan.iter().zip(body).map(|(capstan, body)| capstan / body).collect()
            }
        };
        let counts =
            self.list("geometry.counts_per_rev", g.counts_per_rev.as_ref(), n, None, POSITIVE);
        let signs = self.signs("geometry.encoder_sign", g.encoder_sign.as_ref(), n);
        let homes = self.list("geometry.home_counts", g.home_counts.as_ref(), n, Some(0.0), FINITE);
        let offsets = self.list(
            "geometry.joint_offset_rad",
            g.joint_offset_rad.as_ref(),
            n,
            Some(0.0),
            FINITE,
        );
        for idx in 0..n {
            self.transmission.joints[idx].sensor = Some(Sensor::encoder(
                idx,
                counts[idx],
                ratio[idx],
                signs[idx],
                homes[idx],
                offsets[idx],
            ));
        }
        if !self.is_driven {
            return;
        }
        let scale = self.checks.number("geometry.current_scale", g.current_scale, 1.0, MOTOR_SCALE);
        let link = &self.written.link;
        let motors = self.written.motors.as_ref();
        let continuous = if let Some(per_nm) = &g.command_per_nm {
            let per_nm = self.list("geometry.command_per_nm", Some(per_nm), n, None, FINITE);
            let limits =
                self.list("link.command_limit", link.command_limit.as_ref(), n, None, POSITIVE);
            for idx in 0..n {
                if per_nm[idx] == 0.0 {
                    self.checks
                        .not_accepted(&format!("geometry.command_per_nm[{idx}]"), "other than 0");
                }
                let motor = Motor::torque(idx, per_nm[idx], limits[idx]);
                self.within_reach(&format!("link.command_limit[{idx}]"), &motor);
                self.transmission.joints[idx].motor = Some(motor);
            }
            let continuous = motors.and_then(|motors| motors.continuous_command.as_ref());
            self.list("motors.continuous_command", continuous, n, Some(0.0), NOT_NEGATIVE)
        } else {
            let constants = self.list(
                "geometry.torque_constant_nm_per_a",
                g.torque_constant_nm_per_a.as_ref(),
                n,
                None,
                POSITIVE,
            );
            let signs = self.signs("geometry.motor_sign", g.motor_sign.as_ref(), n);
            let limits = self.list(
                "link.current_limit_ma",
                link.current_limit_ma.as_ref(),
                n,
                None,
                POSITIVE.to(ceilings::CURRENT_MA).unit("mA"),
            );
            for idx in 0..n {
                let motor =
                    Motor::current(idx, ratio[idx], constants[idx], scale, signs[idx], limits[idx]);
                self.within_reach(&format!("link.current_limit_ma[{idx}]"), &motor);
                self.transmission.joints[idx].motor = Some(motor);
            }
            let continuous = motors.and_then(|motors| motors.continuous_current_ma.as_ref());
            self.list(
                "motors.continuous_current_ma",
                continuous,
                n,
                Some(0.0),
                NOT_NEGATIVE.unit("mA"),
            )
        };
        self.continuous[..n].copy_from_slice(&continuous);
    }

    /// Refuses a limit with which a motor would make more than any joint of an arm for a hand.
    fn within_reach(&mut self, key: &str, motor: &Motor) {
        let joint_nm = motor.limit_units / motor.units_per_nm.abs();
        // A constant of 0 is refused for itself.
        if joint_nm > ceilings::JOINT_NM && joint_nm.is_finite() {
            let most = show(motor.limit_units * ceilings::JOINT_NM / joint_nm);
            let joint_nm = show(joint_nm);
            self.checks.not_accepted(
                key,
                format_args!(
                    "at most {most}: with the constants beside it the motor would make {joint_nm} \
                        N·m at the joint, and {} is the most",
                    ceilings::JOINT_NM
                ),
            );
        }
    }

    /// Seven readings of a pose, six commands of a wrench; its limits are those of [limits].
    fn pose(&mut self, actuated: Axes) {
        let origin = self.geometry.origin_m.map_or(DVec3::ZERO, |_| self.origin());
        // A frame may exchange axes of one kind: which of three there is no telling here.
        let has_motor =
            |idx: usize| idx < 6 && (0..3).any(|axis_idx| actuated.has(idx / 3 * 3 + axis_idx));
        for idx in 0..7 {
            let home = origin.to_array().get(idx).map_or(0.0, |origin_m| -origin_m);
            self.transmission.joints[idx] = Joint {
                sensor: Some(Sensor { reading_idx: idx, rad_per_unit: 1.0, home, offset_rad: 0.0 }),
                motor: has_motor(idx).then(|| Motor::torque(idx, 1.0, f64::INFINITY)),
            };
        }
    }

    fn gimbal(&mut self) -> Option<Gimbal> {
        let g = self.geometry;
        let gimbal = g.gimbal?.into();
        let counts = self.list(
            "geometry.gimbal_counts_per_rev",
            g.gimbal_counts_per_rev.as_ref(),
            3,
            None,
            POSITIVE,
        );
        let signs = self.signs("geometry.gimbal_sign", g.gimbal_sign.as_ref(), 3);
        let homes = self.list(
            "geometry.gimbal_home_counts",
            g.gimbal_home_counts.as_ref(),
            3,
            Some(0.0),
            FINITE,
        );
        for idx in 0..3 {
            self.transmission.joints[3 + idx].sensor =
                Some(Sensor::encoder(3 + idx, counts[idx], 1.0, signs[idx], homes[idx], 0.0));
        }
        Some(gimbal)
    }

    fn lengths(&mut self, n: usize, interval: Interval) -> Vec<f64> {
        let lengths = self.list(
            "geometry.length_mm",
            self.geometry.length_mm.as_ref(),
            n,
            None,
            interval.unit("mm"),
        );
        lengths.iter().map(|length| length * 1e-3).collect()
    }

    fn origin(&mut self) -> DVec3 {
        self.checks.position("geometry.origin_m", self.geometry.origin_m)
    }

    /// Masses in kg and centres in m of links, along and across.
    fn links(&mut self, n: usize, has_across: bool, default_on: bool) -> Option<Vec<PlaneLink>> {
        let g = self.geometry;
        if !g.gravity_compensation.unwrap_or(default_on && g.link_mass_g.is_some()) {
            return None;
        }
        let mass = self.list(
            "geometry.link_mass_g",
            g.link_mass_g.as_ref(),
            n,
            None,
            NOT_NEGATIVE.to(ceilings::LINK_MASS_G).unit("g"),
        );
        let along =
            self.list("geometry.link_along_mm", g.link_along_mm.as_ref(), n, None, LINK_CENTER);
        let across = if has_across {
            self.list("geometry.link_across_mm", g.link_across_mm.as_ref(), n, None, LINK_CENTER)
        } else {
            vec![0.0; n]
        };
        let link = |idx: usize| PlaneLink {
            mass_kg: mass[idx] * 1e-3,
            center_m: [along[idx] * 1e-3, across[idx] * 1e-3],
        };
        Some((0..n).map(link).collect())
    }

    fn capstan(&mut self) -> Option<Capstan> {
        self.drives(3);
        // A shoulder at the height of the base has length 0.
        let length_m = <[f64; 3]>::try_from(self.lengths(3, NOT_NEGATIVE)).ok()?;
        let links = self.links(2, false, false).map(|links| CapstanLinks {
            mass_kg: [links[0].mass_kg, links[1].mass_kg],
            center_m: [links[0].center_m[0], links[1].center_m[0]],
        });
        Some(Capstan { length_m, origin_m: self.origin(), gimbal: self.gimbal(), links })
    }

    fn five_link(&mut self) -> Option<FiveLink> {
        self.drives(3);
        let length_m = <[f64; 6]>::try_from(self.lengths(6, POSITIVE)).ok()?;
        let links =
            self.links(4, true, true).and_then(|links| <[PlaneLink; 4]>::try_from(links).ok());
        Some(FiveLink { length_m, origin_m: self.origin(), gimbal: self.gimbal(), links })
    }

    fn pantograph(&mut self) -> Option<Pantograph> {
        let g = self.geometry;
        let mut length = |key: &str, written: Option<f64>, interval: Interval| {
            self.checks.required(&format!("geometry.{key}"), written, interval.unit("mm")) * 1e-3
        };
        let inner_m = length("inner_mm", g.inner_mm, POSITIVE);
        let outer_m = length("outer_mm", g.outer_mm, POSITIVE);
        let distance_m = length("distance_mm", g.distance_mm, NOT_NEGATIVE);
        let ports = match g.arm_port.as_deref() {
            None => [1, 2],
            Some([first @ 1..=4, second @ 1..=4]) if first != second => {
                [*first as usize, *second as usize]
            }
            Some(_) => {
                self.checks.not_accepted(
                    "geometry.arm_port",
                    "the ports of arm 1 and arm 2, two different numbers from 1 to 4",
                );
                [1, 2]
            }
        };
        let scale = self.checks.number("geometry.torque_scale", g.torque_scale, 1.0, MOTOR_SCALE);
        let limits = if self.is_driven {
            self.list(
                "link.command_limit",
                self.written.link.command_limit.as_ref(),
                2,
                None,
                POSITIVE.to(ceilings::JOINT_NM).unit("N·m"),
            )
        } else {
            Vec::new()
        };
        let continuous =
            self.written.motors.as_ref().and_then(|motors| motors.continuous_command.as_ref());
        let continuous =
            self.list("motors.continuous_command", continuous, 2, Some(0.0), NOT_NEGATIVE);
        for (idx, port) in ports.into_iter().enumerate() {
            // The board counts in degrees from its start angle, so there is nothing left to do but
            // to say so in radians.
            let sensor = Sensor {
                reading_idx: port - 1,
                rad_per_unit: 1f64.to_radians(),
                home: 0.0,
                offset_rad: 0.0,
            };
            let motor = limits.get(idx).map(|limit| Motor::torque(port - 1, scale, *limit));
            self.transmission.joints[idx] = Joint { sensor: Some(sensor), motor };
            self.continuous[port - 1] = continuous[idx];
        }
        let origin = self.origin();
        Some(Pantograph { inner_m, outer_m, distance_m, origin_m: DVec2::new(origin.x, origin.y) })
    }

    fn delta(&mut self) -> Option<Delta> {
        self.drives(3);
        let g = self.geometry;
        let mut length = |key: &str, written: Option<f64>, interval: Interval| {
            self.checks.required(&format!("geometry.{key}"), written, interval.unit("mm")) * 1e-3
        };
        let driven_m = length("driven_mm", g.driven_mm, POSITIVE);
        let rod_m = length("rod_mm", g.rod_mm, POSITIVE);
        let radius_m = length("radius_mm", g.radius_mm, POSITIVE);
        let shift_m = length("shift_mm", g.shift_mm, FINITE);
        let offset_mm =
            self.checks.given("geometry.offset_mm", g.offset_mm, "c, d, e, f of the legs, mm");
        let azimuth_deg = self.checks.given(
            "geometry.azimuth_deg",
            g.azimuth_deg,
            "the azimuth of the three legs, degrees",
        );
        let offsets_m = self
            .checks
            .array("geometry.offset_mm", offset_mm, FINITE)
            .map(|offsets| offsets.map(|offset| offset * 1e-3));
        let azimuth_rad = self
            .checks
            .array("geometry.azimuth_deg", azimuth_deg, FINITE)
            .map(|angles| angles.map(f64::to_radians));
        let origin_m = self.origin();
        Some(Delta {
            driven_m,
            rod_m,
            offsets_m: offsets_m?,
            radius_m,
            shift_m,
            azimuth_rad: azimuth_rad?,
            origin_m,
        })
    }

    /// One axis behind an encoder; without `counts_per_rev` the reading is a way in m and the
    /// command a force in N.
    fn one_axis(&mut self, profile: &Profile) -> Option<OneAxis> {
        let m_per_rad =
            self.checks.number("geometry.m_per_rad", self.geometry.m_per_rad, 1.0, POSITIVE);
        if self.geometry.counts_per_rev.is_some() {
            self.drives(1);
        } else {
            self.transmission.joints[0] = Joint {
                sensor: Some(Sensor {
                    reading_idx: 0,
                    rad_per_unit: 1.0 / m_per_rad,
                    home: 0.0,
                    offset_rad: 0.0,
                }),
                motor: self
                    .is_driven
                    .then(|| Motor::torque(0, 1.0 / m_per_rad, profile.limits.force_n)),
            };
        }
        Some(OneAxis { m_per_rad })
    }

    fn rate(&mut self, profile: &Profile) -> Option<Rate> {
        if profile.actuated != Axes::NONE {
            self.checks.not_accepted(
                "device.actuated",
                "empty: an input of kinematics \"none\" has no motors",
            );
        }
        for idx in 0..6 {
            self.transmission.joints[idx].sensor =
                Some(Sensor { reading_idx: idx, rad_per_unit: 1.0, home: 0.0, offset_rad: 0.0 });
        }
        let g = self.geometry;
        Some(Rate {
            full_scale: self.checks.required("geometry.full_scale", g.full_scale, POSITIVE),
            // The codec has already taken rest for zero.
            dead_band: 0.0,
            linear_m_per_s: self.checks.required(
                "geometry.linear_mm_per_s",
                g.linear_mm_per_s,
                POSITIVE.unit("mm/s"),
            ) * 1e-3,
            angular_rad_per_s: self
                .checks
                .required("geometry.angular_deg_per_s", g.angular_deg_per_s, POSITIVE)
                .to_radians(),
        })
    }

    fn chain(&mut self, device_from_native: DQuat) -> Option<Chain> {
        let n = self.written.joint.len();
        if !(3..=7).contains(&n) {
            self.checks.missing("joint", "three to seven [[joint]] tables, from base to grip");
            return None;
        }
        let mut joints = Vec::with_capacity(n);
        for (idx, joint) in self.written.joint.iter().enumerate() {
            joints.push(self.chain_joint(idx, joint));
        }
        let g = self.geometry;
        let position = self.checks.given(
            "geometry.grip_position_m",
            g.grip_position_m,
            "the grip point at zero angles, m",
        );
        let position = self.checks.position("geometry.grip_position_m", position);
        let orientation =
            self.checks.orientation("geometry.grip_orientation_xyzw", g.grip_orientation_xyzw);
        let gravity = if g.gravity_compensation.unwrap_or(false) {
            device_from_native.conjugate() * DVec3::new(0.0, 0.0, -GRAVITY_M_PER_S2)
        } else {
            DVec3::ZERO
        };
        Chain::new(&joints, Pose::new(orientation, position), gravity)
    }

    fn chain_joint(&mut self, idx: usize, joint: &WrittenJoint) -> ChainJoint {
        let key = |name: &str| format!("joint[{idx}].{name}");
        let vector =
            |checks: &mut Checks<'_>, name: &str, written: Option<Numbers<3>>, accepted: &str| {
                let written = checks.given(&key(name), written, accepted);
                checks.position(&key(name), written)
            };
        let axis =
            vector(self.checks, "axis", joint.axis, "the axis at zero angles, such as [0, 0, 1]")
                .try_normalize();
        if axis.is_none() && joint.axis.is_some() {
            self.checks.not_accepted(&key("axis"), "a vector with a length");
        }
        let point_m =
            vector(self.checks, "point_m", joint.point_m, "a point on the axis at zero angles, m");
        let sign = self.checks.number(&key("sign"), joint.sign, 1.0, FINITE);
        if sign.abs() != 1.0 {
            self.checks.not_accepted(&key("sign"), "1 or -1");
        }
        // Without it a servo has its own, and any other reading is an angle in rad or a way in m.
        let default = if joint.servo_model.is_some() { SERVO_COUNTS_PER_REV } else { TAU };
        let counts_per_rev =
            self.checks.number(&key("counts_per_rev"), joint.counts_per_rev, default, POSITIVE);
        let home = self.checks.number(&key("home_counts"), joint.home_counts, 0.0, FINITE);
        let offset_rad = self.checks.number(&key("offset_rad"), joint.offset_rad, 0.0, FINITE);
        let servo = joint.servo_model.map(ServoModel::from);
        let per_nm = self
            .checks
            .optional(&key("counts_per_nm"), joint.counts_per_nm, NOT_NEGATIVE)
            .or(servo.map(|servo| servo.counts_per_nm()));
        let limit = self
            .checks
            .optional(&key("limit_counts"), joint.limit_counts, POSITIVE)
            .or(servo.map(|servo| servo.limit_counts().into()));
        if let (Some(limit), Some(servo)) = (limit, servo)
            && limit > f64::from(servo.limit_counts())
        {
            let largest = servo.limit_counts();
            self.checks.not_accepted(
                &key("limit_counts"),
                format_args!("at most {largest}, the largest goal current of {}", servo.name()),
            );
        }
        let motor = match (per_nm, limit) {
            _ if !self.is_driven => None,
            (Some(0.0), _) => None,
            (Some(per_nm), Some(limit)) => {
                let motor = Motor::torque(idx, sign * per_nm, limit);
                self.within_reach(&key("limit_counts"), &motor);
                Some(motor)
            }
            (None, _) => {
                self.checks.missing(&key("counts_per_nm"), "the command per N·m, or servo_model");
                None
            }
            (_, None) => {
                self.checks.missing(&key("limit_counts"), "the largest command, or servo_model");
                None
            }
        };
        self.transmission.joints[idx] = Joint {
            sensor: Some(Sensor::encoder(idx, counts_per_rev, 1.0, sign, home, offset_rad)),
            motor,
        };
        self.continuous[idx] = self.checks.number(
            &key("continuous_counts"),
            joint.continuous_counts,
            0.0,
            NOT_NEGATIVE,
        );
        ChainJoint {
            axis: axis.unwrap_or(DVec3::Z),
            point_m,
            slides: joint.slides.unwrap_or(false),
            mass_kg: self.checks.number(
                &key("mass_g"),
                joint.mass_g,
                0.0,
                NOT_NEGATIVE.to(ceilings::LINK_MASS_G).unit("g"),
            ) * 1e-3,
            center_m: self.checks.position(&key("center_m"), joint.center_m),
            damping_nm_s_per_rad: self.checks.number(
                &key("damping_nm_s_per_rad"),
                joint.damping_nm_s_per_rad,
                DEFAULT_DAMPING_NM_S_PER_RAD,
                NOT_NEGATIVE.to(ceilings::JOINT_DAMPING_NM_S_PER_RAD).unit("N·m·s/rad"),
            ),
            home_rad: self.checks.number(&key("home_rad"), joint.home_rad, 0.0, FINITE),
        }
    }
}
