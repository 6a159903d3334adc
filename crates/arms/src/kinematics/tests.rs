//! Every kind of arm against published numbers, against differences, and against itself.

use core::f64::consts::{FRAC_PI_2, PI};

use glam::{DQuat, DVec2, DVec3};
use proptest::prelude::*;

use super::capstan::CapstanLinks;
use super::five_link::PlaneLink;
use super::*;
use crate::transmission::{Joint, Motor, Sensor, Transmission};

fn joints<const N: usize>(values: [f64; N]) -> [f64; MAX_AXES] {
    let mut joints = [0.0; MAX_AXES];
    joints[..N].copy_from_slice(&values);
    joints
}

fn capstan(length_mm: [f64; 3], origin_m: [f64; 3], gimbal: Option<Gimbal>) -> Kinematics {
    Kinematics::Capstan(Capstan {
        length_m: length_mm.map(|length| length * 1e-3),
        origin_m: DVec3::from_array(origin_m),
        gimbal,
        links: None,
    })
}

fn woodenhaptics() -> Kinematics {
    capstan([80.0, 205.0, 245.0], [0.220, 0.0, 0.080], None)
}

fn vintage(gimbal: Option<Gimbal>) -> Kinematics {
    capstan([0.0, 138.0, 112.0], [0.138, 0.0, -0.097], gimbal)
}

fn polhem_v3(gimbal: Option<Gimbal>) -> Kinematics {
    let link = |mass_g: f64, along_mm: f64, across_mm: f64| PlaneLink {
        mass_kg: mass_g * 1e-3,
        center_m: [along_mm * 1e-3, across_mm * 1e-3],
    };
    Kinematics::FiveLink(FiveLink {
        length_m: [0.034, 0.165, 0.025, 0.190, 0.034, 0.1308],
        origin_m: DVec3::new(0.2045, 0.0, 0.0325),
        gimbal,
        links: Some([
            link(157.64, 30.123, 0.484),
            link(77.33, -4.086, 1.911),
            link(97.67, 87.765, 1.978),
            link(112.65, 61.701, 0.576),
        ]),
    })
}

fn haply(inner_mm: f64, outer_mm: f64, distance_mm: f64, origin_mm: [f64; 2]) -> Kinematics {
    Kinematics::Pantograph(Pantograph {
        inner_m: inner_mm * 1e-3,
        outer_m: outer_mm * 1e-3,
        distance_m: distance_mm * 1e-3,
        origin_m: DVec2::from_array(origin_mm) * 1e-3,
    })
}

fn falcon(origin_z_m: f64) -> Kinematics {
    Kinematics::Delta(Delta {
        driven_m: 0.060,
        rod_m: 0.1025,
        offsets_m: [0.01443, 0.01125, 0.01125, -0.025],
        radius_m: 0.040,
        shift_m: -0.02309,
        azimuth_rad: [105f64, -15.0, -135.0].map(f64::to_radians),
        origin_m: DVec3::new(0.0, 0.0, origin_z_m),
    })
}

/// Six joints of an invented arm on a table, a metre tall: shoulder yaw and pitch, elbow, and a
/// wrist of three.
fn leader() -> Kinematics {
    let joint = |axis: DVec3, point_mm: [f64; 3], home_rad: f64, mass_kg: f64| ChainJoint {
        axis,
        point_m: DVec3::from_array(point_mm) * 1e-3,
        home_rad,
        mass_kg,
        center_m: DVec3::from_array(point_mm) * 1e-3 + DVec3::new(0.03, 0.01, 0.02),
        damping_nm_s_per_rad: 0.02,
        ..ChainJoint::default()
    };
    let chain = Chain::new(
        &[
            joint(DVec3::Z, [0.0, 0.0, 50.0], 0.1, 0.1),
            joint(DVec3::Y, [0.0, 0.0, 80.0], -0.4, 0.1),
            joint(DVec3::Y, [20.0, 0.0, 230.0], 1.2, 0.08),
            joint(DVec3::X, [120.0, 0.0, 230.0], 0.3, 0.05),
            joint(DVec3::Y, [160.0, 0.0, 230.0], 0.6, 0.05),
            joint(DVec3::X, [190.0, 0.0, 230.0], -0.2, 0.03),
        ],
        Pose::new(DQuat::from_rotation_y(0.2), DVec3::new(0.23, 0.0, 0.22)),
        DVec3::new(0.0, 0.0, -GRAVITY_M_PER_S2),
    );
    Kinematics::Chain(chain.expect("six joints fit"))
}

fn every_arm() -> Vec<(&'static str, Kinematics)> {
    vec![
        ("WoodenHaptics", woodenhaptics()),
        ("vintage", vintage(Some(Gimbal::Yaw))),
        ("Polhem v1", capstan([58.0, 174.0, 133.0], [0.140, 0.0, 0.100], Some(Gimbal::Roll))),
        ("Polhem v3", polhem_v3(Some(Gimbal::Roll))),
        ("Haply v3.1", haply(70.0, 90.0, 38.0, [19.0, 90.0])),
        ("Falcon", falcon(0.1346)),
        ("leader", leader()),
        ("Hapkit", Kinematics::OneAxis(OneAxis { m_per_rad: 0.0042 })),
    ]
}

/// A transmission of encoders and currents as section 6 writes it.
struct Drive {
    capstan_mm: [f64; 3],
    body_mm: [f64; 3],
    cpr: f64,
    encoder_sign: [f64; 3],
    motor_sign: [f64; 3],
    home: [f64; 3],
    offset_rad: [f64; 3],
    kt: [f64; 3],
}

impl Drive {
    fn transmission(&self) -> Transmission {
        let mut transmission = Transmission::default();
        for i in 0..3 {
            let ratio = self.capstan_mm[i] / self.body_mm[i];
            transmission.joints[i] = Joint {
                sensor: Some(Sensor::encoder(
                    i,
                    self.cpr,
                    ratio,
                    self.encoder_sign[i],
                    self.home[i],
                    self.offset_rad[i],
                )),
                motor: Some(Motor::current(i, ratio, self.kt[i], 1.0, self.motor_sign[i], 1e9)),
            };
        }
        transmission
    }
}

fn wooden_drive(
    encoder_sign: [f64; 3],
    motor_sign: [f64; 3],
    home: [f64; 3],
    offset_rad: [f64; 3],
) -> Drive {
    Drive {
        capstan_mm: [10.0; 3],
        body_mm: [160.0, 120.0, 120.0],
        cpr: 2000.0,
        encoder_sign,
        motor_sign,
        home,
        offset_rad,
        kt: [0.0259; 3],
    }
}

fn polhem_v3_drive() -> Drive {
    Drive {
        capstan_mm: [28.8534, 13.6981, 13.7281],
        body_mm: [175.0, 100.0, 100.0],
        cpr: 4096.0,
        encoder_sign: [1.0, -1.0, 1.0],
        motor_sign: [1.0, -1.0, 1.0],
        home: [8312.0, -10366.0, 19764.0],
        offset_rad: [0.0; 3],
        kt: [0.0603, 0.0538, 0.0538],
    }
}

/// One row: counts, angles, position in mm, currents in mA for 1 N along x, y, z.
type Row = ([f64; 3], [f64; 3], [f64; 3], [[f64; 3]; 3]);

fn check_row(
    name: &str,
    kinematics: &Kinematics,
    transmission: &Transmission,
    (counts, angles, position_mm, currents): Row,
) {
    let solved_angles = transmission.angles(&joints(counts));
    for (found, angle) in solved_angles.iter().zip(angles) {
        assert!((found - angle).abs() < 6e-7, "{name} {counts:?}: angles {solved_angles:?}");
    }
    let solved = kinematics.solve(&solved_angles, &Configuration::default()).expect("reachable");
    let found_mm = solved.native_from_grip.translation * 1e3;
    assert!(
        (found_mm - DVec3::from_array(position_mm)).abs().max_element() < 6e-5,
        "{name} {counts:?}: {found_mm}"
    );
    for (axis, currents) in DVec3::AXES.into_iter().zip(currents) {
        let torques = solved.torques(&Wrench::new(axis, DVec3::ZERO));
        let (found, _) = transmission.commands(&torques, &[0.0; MAX_AXES]);
        for (found, current) in found.iter().zip(currents) {
            assert!(
                (found - current).abs() < 6e-4,
                "{name} {counts:?}: {axis} takes {found} mA and not {current}"
            );
        }
    }
}

#[test]
fn serial_arms_agree_with_the_published_rows() {
    let quarter = [0.0, 0.0, FRAC_PI_2];
    let a = wooden_drive([-1.0; 3], [1.0, -1.0, -1.0], [0.0; 3], quarter).transmission();
    let signs = [1.0, -1.0, -1.0];
    let model_3 = wooden_drive(signs, signs, [0.0, 0.0, -6000.0], [0.0; 3]).transmission();
    let at_home: Row = (
        [0.0; 3],
        [0.0, 0.0, FRAC_PI_2],
        [25.0, 0.0, 205.0],
        [[0.0, -659.588, 0.0], [591.216, 0.0, 0.0], [0.0, 0.0, -788.288]],
    );
    check_row("A", &woodenhaptics(), &a, at_home);
    check_row("D model 3", &woodenhaptics(), &model_3, at_home);
    let moved = [100.0, -200.0, 300.0];
    let currents = [[12.080, -658.557, -61.836], [615.165, 12.932, 1.214], [0.0, 34.520, -785.858]];
    check_row(
        "A",
        &woodenhaptics(),
        &a,
        (moved, [-0.019635, 0.052360, 1.492257], [34.9245, -5.0061, 185.4966], currents),
    );
    let currents =
        [[-12.080, -658.557, -61.836], [615.165, -12.932, -1.214], [0.0, 34.520, -785.858]];
    check_row(
        "D model 3",
        &woodenhaptics(),
        &model_3,
        (moved, [0.019635, 0.052360, 1.492257], [34.9245, 5.0061, 185.4966], currents),
    );

    let signs = [-1.0, 1.0, -1.0];
    let model_2 = Drive {
        capstan_mm: [13.0, 10.0, 10.0],
        body_mm: [117.0, 77.0, 77.0],
        cpr: 4000.0,
        encoder_sign: signs,
        motor_sign: signs,
        home: [0.0, 7700.0, 0.0],
        offset_rad: [0.0; 3],
        kt: [0.0234; 3],
    }
    .transmission();
    let currents = [[0.0, 0.0, -621.601], [-655.271, 0.0, 0.0], [0.0, -765.901, 0.0]];
    check_row(
        "D model 2",
        &vintage(None),
        &model_2,
        ([0.0; 3], [0.0, FRAC_PI_2, 0.0], [0.0, 0.0, -15.0], currents),
    );
    let currents =
        [[-10.859, 31.235, -620.342], [-622.104, -0.545, 10.828], [0.0, -765.263, 38.018]];
    let angles = [-0.017453, 1.529996, -0.061200];
    check_row(
        "D model 2",
        &vintage(None),
        &model_2,
        (moved, angles, [-6.9849, -2.2869, -9.1615], currents),
    );

    let alu = Drive {
        capstan_mm: [13.8, 9.8, 9.8],
        body_mm: [116.0, 76.0, 76.0],
        cpr: 2000.0,
        encoder_sign: [1.0; 3],
        motor_sign: [1.0; 3],
        home: [0.0; 3],
        offset_rad: [0.0; 3],
        kt: [0.0259; 3],
    };
    let currents = [[-0.365, 694.241, 548.172], [9.760, 25.959, 20.497], [0.0, 56.410, 66.996]];
    let row: Row =
        (moved, [0.037374, -0.081020, 0.121530], [-137.8752, 0.0794, 140.3595], currents);
    check_row(
        "AluHaptics v2",
        &capstan([111.0, 140.0, 111.0], [0.140, 0.0, 0.0], None),
        &alu.transmission(),
        row,
    );

    let polhem_v1 = Drive {
        capstan_mm: [10.0; 3],
        body_mm: [180.0, 100.0, 100.0],
        encoder_sign: [-1.0; 3],
        motor_sign: [-1.0; 3],
        home: [0.0, 0.0, -5000.0],
        kt: [0.0538; 3],
        ..alu
    };
    let currents = [[-2.583, -322.733, -23.261], [-147.990, 5.633, 0.406], [0.0, 20.308, -246.115]];
    let row: Row = (moved, [-0.017453, 0.062832, 1.476549], [3.3135, -2.5015, 119.1402], currents);
    check_row(
        "Polhem v1",
        &capstan([58.0, 174.0, 133.0], [0.140, 0.0, 0.100], None),
        &polhem_v1.transmission(),
        row,
    );
}

#[test]
fn the_five_link_agrees_with_the_published_rows() {
    let arm = polhem_v3(None);
    let transmission = polhem_v3_drive().transmission();
    let elevation = |counts: [f64; 3]| {
        let with_wrist = polhem_v3(Some(Gimbal::Roll));
        let solved = with_wrist
            .solve(&transmission.angles(&joints(counts)), &Configuration::default())
            .expect("reachable");
        let bar = solved.native_from_grip.rotation * DVec3::X;
        bar.z.atan2(bar.x.hypot(bar.y))
    };
    let rows: [(Row, f64); 3] = [
        (
            (
                [0.0; 3],
                [2.102250, 2.178168, 4.162030],
                [-222.6413, 30.8593, 37.0523],
                [
                    [-84.378, -309.726, -87.656],
                    [-49.603, 526.860, 149.108],
                    [0.0, 695.785, 296.322],
                ],
            ),
            -0.528351,
        ),
        (
            (
                [100.0, -200.0, 300.0],
                [2.127542, 2.220194, 4.225206],
                [-220.3613, 25.4830, 32.6837],
                [
                    [-69.678, -328.455, -96.072],
                    [-43.369, 527.703, 154.351],
                    [0.0, 742.777, 309.625],
                ],
            ),
            -0.530944,
        ),
        (
            (
                [-8312.0, 6022.0, -8557.0],
                [0.0, 0.912788, 2.360042],
                [-0.0210, 0.0, 0.0016],
                [[0.0, 449.709, 184.692], [559.101, 0.0, 0.0], [0.0, -153.329, 163.079]],
            ),
            -0.847466,
        ),
    ];
    for (row, lambda) in rows {
        check_row("Polhem v3", &arm, &transmission, row);
        assert!((elevation(row.0) - lambda).abs() < 6e-7, "{:?}: {}", row.0, elevation(row.0));
    }
}

#[test]
fn gravity_of_the_five_link_agrees_with_the_published_rows() {
    let arm = polhem_v3(None);
    let transmission = polhem_v3_drive().transmission();
    for (counts, torques, currents) in [
        ([0.0; 3], [0.0, -0.247293, 0.043235], [0.0, 629.636, 110.321]),
        ([-8312.0, 6022.0, -8557.0], [0.0, 0.166129, 0.018334], [0.0, -422.983, 46.783]),
    ] {
        let extra = arm.extra_torques(&transmission.angles(&joints(counts)), &[0.0; MAX_AXES]);
        let (found, _) = transmission.commands(&[0.0; MAX_AXES], &extra);
        for i in 0..3 {
            assert!((extra[i] - torques[i]).abs() < 6e-7, "{counts:?}: {extra:?}");
            assert!((found[i] - currents[i]).abs() < 2e-3, "{counts:?}: {found:?}");
        }
    }
}

#[test]
fn the_delta_agrees_with_the_published_rows() {
    let arm = falcon(0.0);
    let mut transmission = Transmission::default();
    for i in 0..3 {
        transmission.joints[i] = Joint {
            sensor: Some(Sensor::encoder(i, 1280.0, 14.25 / 110.0, 1.0, 0.0, 35f64.to_radians())),
            motor: Some(Motor::torque(i, -10_000.0, 1e9)),
        };
    }
    let rows: [Row; 4] = [
        (
            [0.0; 3],
            [35.0; 3],
            [0.0, 0.0, 134.6024],
            [[-193.0, 650.0, -457.0], [639.0, -152.0, -487.0], [-249.0; 3]],
        ),
        (
            [100.0, -200.0, 300.0],
            [38.6435, 27.7131, 45.9304],
            [18.2323, 3.9782, 136.1334],
            [[-177.0, 592.0, -496.0], [658.0, -131.0, -554.0], [-240.0, -345.0, -143.0]],
        ),
        (
            [500.0; 3],
            [53.2173; 3],
            [0.0, 0.0, 156.8605],
            [[-219.0, 725.0, -505.0], [710.0, -165.0, -545.0], [-210.0; 3]],
        ),
        (
            [-500.0; 3],
            [16.7827; 3],
            [0.0, 0.0, 110.7545],
            [[-156.0, 531.0, -375.0], [523.0, -126.0, -396.0], [-242.0; 3]],
        ),
    ];
    for (counts, degrees, position_mm, commands) in rows {
        let angles = transmission.angles(&joints(counts));
        for i in 0..3 {
            assert!((angles[i].to_degrees() - degrees[i]).abs() < 1e-4, "{counts:?}: {angles:?}");
        }
        let solved = arm.solve(&angles, &Configuration::default()).expect("reachable");
        let found_mm = solved.native_from_grip.translation * 1e3;
        assert!(
            (found_mm - DVec3::from_array(position_mm)).abs().max_element() < 6e-5,
            "{counts:?}: {found_mm}"
        );
        for (axis, commands) in DVec3::AXES.into_iter().zip(commands) {
            let (found, _) = transmission
                .commands(&solved.torques(&Wrench::new(axis, DVec3::ZERO)), &[0.0; MAX_AXES]);
            assert_eq!(
                [found[0], found[1], found[2]].map(f64::trunc),
                commands,
                "{counts:?} {axis}"
            );
        }
    }
}

#[test]
fn the_pantograph_agrees_with_the_published_rows() {
    let first = haply(50.0, 70.0, 20.0, [0.0; 2]);
    let v2 = haply(70.0, 90.0, 0.0, [0.0; 2]);
    let v3 = haply(70.0, 90.0, 38.0, [0.0; 2]);
    let rows = [
        (first, [180.0, 0.0], [10.0, 36.0555], [[-0.015023, -0.015023], [-0.025, 0.025]]),
        (first, [150.0, 40.0], [4.1342, 76.4770], [[-0.030953, -0.036192], [-0.037816, 0.033351]]),
        (v2, [241.0, -61.0], [0.0, 22.1331], [[-0.011067, -0.011067], [-0.004505, 0.004505]]),
        (v2, [120.0, 40.0], [22.8466, 129.5694], [[-0.071379, -0.058190], [-0.025975, 0.048821]]),
        (v3, [168.0, 12.0], [19.0, 35.7420], [[-0.015570, -0.015570], [-0.064276, 0.064276]]),
        (v3, [150.0, 40.0], [12.3723, 87.6485], [[-0.033641, -0.042295], [-0.062506, 0.058640]]),
    ];
    for (arm, degrees, position_mm, torques) in rows {
        let solved = arm
            .solve(&joints(degrees.map(f64::to_radians)), &Configuration::default())
            .expect("reachable");
        let found_mm = solved.native_from_grip.translation * 1e3;
        assert!(
            (found_mm - DVec3::new(position_mm[0], position_mm[1], 0.0)).abs().max_element() < 6e-5,
            "{degrees:?}: {found_mm}"
        );
        for (axis, torques) in [DVec3::X, DVec3::Y].into_iter().zip(torques) {
            let found = solved.torques(&Wrench::new(axis, DVec3::ZERO));
            assert!(
                (found[0] - torques[0]).abs() < 6e-7 && (found[1] - torques[1]).abs() < 6e-7,
                "{degrees:?} {axis}: {found:?}"
            );
        }
    }
}

/// Joint angles around the middle of each arm: inside what it can do, and away from folded wrists.
fn around_home(arm: &Kinematics, spread: [f64; MAX_AXES]) -> [f64; MAX_AXES] {
    let mut angles = arm.home();
    for (idx, (angle, spread)) in angles.iter_mut().zip(spread).enumerate().take(arm.n_joints()) {
        *angle += spread * 0.35 + if idx == 4 { 0.6 } else { 0.0 };
    }
    angles
}

#[test]
fn every_arm_is_at_its_centre_at_home() {
    for (name, arm) in every_arm() {
        let solved = arm
            .solve(&arm.home(), &Configuration::default())
            .unwrap_or_else(|| panic!("{name}: {:?}", arm.home()));
        if name != "leader" {
            assert!(
                solved.native_from_grip.translation.length() < 1e-9,
                "{name}: {}",
                solved.native_from_grip.translation
            );
        }
    }
}

proptest! {
    #[test]
    fn columns_are_what_differences_say(spread in proptest::array::uniform8(-1.0..1.0f64)) {
        let step = 1e-6;
        for (name, arm) in every_arm() {
            let angles = around_home(&arm, spread);
            let near = Configuration::default();
            let here = arm.solve(&angles, &near).expect("inside");
            for idx in 0..arm.n_joints() {
                let at = |change: f64| {
                    let mut moved = angles;
                    moved[idx] += change;
                    arm.solve(&moved, &here).expect("inside").native_from_grip
                };
                let before = at(-step);
                let after = at(step);
                let linear = (after.translation - before.translation) / (2.0 * step);
                let angular = 2.0 * (after.rotation * before.rotation.conjugate()).xyz() / (2.0 * step);
                prop_assert!((linear - here.columns[idx].linear).length() < 1e-7, "{name} {idx}: {linear} {}", here.columns[idx].linear);
                prop_assert!((angular - here.columns[idx].angular).length() < 1e-7, "{name} {idx}: {angular} {}", here.columns[idx].angular);
            }
        }
    }

    /// τᵀ·dθ = Fᵀ·dp: what the motors do, the hand feels.
    #[test]
    fn power_is_the_same_at_the_joints_and_at_the_grip(
        spread in proptest::array::uniform8(-1.0..1.0f64),
        rates in proptest::array::uniform8(-2.0..2.0f64),
        force in proptest::array::uniform3(-5.0..5.0f64),
        torque in proptest::array::uniform3(-0.2..0.2f64),
    ) {
        let step = 1e-6;
        for (name, arm) in every_arm() {
            let angles = around_home(&arm, spread);
            let here = arm.solve(&angles, &Configuration::default()).expect("inside");
            let wrench = Wrench::new(DVec3::from_array(force), DVec3::from_array(torque));
            let at_the_joints: f64 = here.torques(&wrench).iter().zip(rates).take(arm.n_joints()).map(|(torque, rate)| torque * rate).sum();
            let at = |time: f64| {
                let mut moved = angles;
                for (angle, rate) in moved.iter_mut().zip(rates).take(arm.n_joints()) {
                    *angle += time * rate;
                }
                arm.solve(&moved, &here).expect("inside").native_from_grip
            };
            let before = at(-step);
            let after = at(step);
            let motion = Twist {
                linear: (after.translation - before.translation) / (2.0 * step),
                angular: 2.0 * (after.rotation * before.rotation.conjugate()).xyz() / (2.0 * step),
            };
            prop_assert!((at_the_joints - wrench.power(motion)).abs() < 1e-6, "{name}: {at_the_joints} {}", wrench.power(motion));
            let mut in_use = rates;
            in_use[arm.n_joints()..].fill(0.0);
            prop_assert!((at_the_joints - wrench.power(here.twist(&in_use))).abs() < 1e-9, "{name}");
        }
    }

    #[test]
    fn the_inverse_of_a_pose_is_where_it_came_from(spread in proptest::array::uniform8(-1.0..1.0f64)) {
        for (name, arm) in every_arm() {
            let angles = around_home(&arm, spread);
            let here = arm.solve(&angles, &Configuration::default()).expect("inside");
            let near = angles.map(|angle| angle + 0.01);
            let found = arm.inverse(&here.native_from_grip, &near).unwrap_or_else(|| panic!("{name}: {angles:?}"));
            for idx in 0..arm.n_joints() {
                prop_assert!((found[idx] - angles[idx]).abs() < 1e-6, "{name} {idx}: {found:?} and \
                    not {angles:?}");
            }
            // From the middle of the workspace another branch may be found, but one that reaches
            // the pose.
            let found = arm.inverse(&here.native_from_grip, &arm.home()).unwrap_or_else(|| panic!("{name}: {angles:?}"));
            let there = arm.solve(&found, &here).expect("inside");
            prop_assert!((there.native_from_grip.translation - here.native_from_grip.translation).length() < 1e-9, "{name}");
            let turn = there.native_from_grip.rotation * here.native_from_grip.rotation.conjugate();
            prop_assert!(turn.xyz().length() < 1e-7, "{name}");
        }
    }

    /// Gravity torques are the derivative of a potential, so their curl is zero; damping takes
    /// power out.
    #[test]
    fn extra_torques_hold_a_potential_and_damp(spread in proptest::array::uniform8(-1.0..1.0f64), rates in proptest::array::uniform8(-2.0..2.0f64)) {
        let links = CapstanLinks { mass_kg: [0.170, 0.110], center_m: [0.051, 0.091] };
        let Kinematics::Capstan(wooden) = woodenhaptics() else { panic!("a capstan arm") };
        for arm in [Kinematics::Capstan(Capstan { links: Some(links), ..wooden }), polhem_v3(None), leader()] {
            let angles = around_home(&arm, spread);
            let torques = |angles: &[f64; MAX_AXES]| arm.extra_torques(angles, &[0.0; MAX_AXES]);
            let step = 1e-5;
            let change = |of: usize, by: usize| {
                let mut before = angles;
                let mut after = angles;
                before[by] -= step;
                after[by] += step;
                (torques(&after)[of] - torques(&before)[of]) / (2.0 * step)
            };
            for i in 0..arm.n_joints() {
                for j in 0..i {
                    prop_assert!((change(i, j) - change(j, i)).abs() < 1e-8, "{i} {j}: {} {}", change(i, j), change(j, i));
                }
            }
            let moving = arm.extra_torques(&angles, &rates);
            let resting = torques(&angles);
            let power: f64 = (0..arm.n_joints()).map(|i| (moving[i] - resting[i]) * rates[i]).sum();
            prop_assert!(power <= 0.0);
        }
    }

    #[test]
    fn no_reading_gives_a_number_that_is_none(wild in proptest::array::uniform8(proptest::num::f64::ANY), tame in proptest::array::uniform8(-10.0..10.0f64)) {
        for (name, arm) in every_arm().into_iter().chain([("pose", Kinematics::Cartesian)]) {
            for joints in [wild, tame] {
                if let Some(solved) = arm.solve(&joints, &Configuration::default()) {
                    let torques = solved.torques(&Wrench::new(DVec3::ONE, DVec3::ONE));
                    prop_assert!(solved.is_finite() && torques.iter().all(|torque| torque.is_finite()), "{name}");
                }
                prop_assert!(arm.extra_torques(&joints, &wild).iter().all(|torque| torque.is_finite()), "{name}");
            }
        }
    }

    #[test]
    fn rates_come_back_from_their_readings(linear in proptest::array::uniform3(-0.2..0.2f64), angular in proptest::array::uniform3(-1.0..1.0f64)) {
        let input = Kinematics::Rate(Rate { full_scale: 350.0, dead_band: 10.0, linear_m_per_s: 0.2, angular_rad_per_s: 1.0 });
        let twist = Twist { linear: DVec3::from_array(linear), angular: DVec3::from_array(angular) };
        let readings = input.rate_joints(&twist).expect("a rate input");
        let found = input.rate_twist(&readings).expect("a rate input");
        prop_assert!((found.linear - twist.linear).length() < 1e-12 && (found.angular - twist.angular).length() < 1e-12);
    }
}

/// All configurations on a grid of joint angles, far beyond what the arms can do.
fn sweep(arm: &Kinematics, mut visit: impl FnMut(&[f64; MAX_AXES], Option<Configuration>)) {
    let n = arm.n_joints().min(3);
    let steps = 36;
    for index in 0..usize::pow(steps, n as u32) {
        let mut angles = [0.0; MAX_AXES];
        let mut rest = index;
        for angle in angles.iter_mut().take(n) {
            *angle = -PI + 2.0 * PI * (rest % steps) as f64 / steps as f64;
            rest /= steps;
        }
        visit(&angles, arm.solve(&angles, &Configuration::default()));
    }
}

#[test]
fn no_configuration_asks_for_a_torque_beyond_reason() {
    // A column is at most the reach of the arm; those of closed loops are cut off a thousandth of a
    // radian from their singularities.
    let bounds_m = [
        ("WoodenHaptics", 0.46),
        ("vintage", 0.26),
        ("Polhem v1", 0.31),
        ("Polhem v3", 700.0),
        ("Haply v3.1", 70.0),
        ("Falcon", 2.0),
    ];
    for (name, bound_m) in bounds_m {
        let (_, arm) = every_arm().into_iter().find(|(known, _)| *known == name).expect("listed");
        let mut n_reached = 0;
        let mut longest_m = 0.0f64;
        sweep(&arm, |_, solved| {
            if let Some(solved) = solved {
                n_reached += 1;
                longest_m = solved
                    .columns
                    .iter()
                    .fold(longest_m, |longest, column| longest.max(column.linear.length()));
            }
        });
        assert!(
            n_reached > 20 && longest_m <= bound_m,
            "{name}: {n_reached} configurations, column of {longest_m} m"
        );
    }
}

#[test]
fn singular_poses_of_serial_arms_take_finite_torques() {
    // r = 0: straight above the base; and both links in line.
    let above = joints([0.7, 0.0, 0.0]);
    let stretched = joints([0.7, 1.0, PI - 1.0]);
    for angles in [above, stretched] {
        let solved = woodenhaptics()
            .solve(&angles, &Configuration::default())
            .expect("a serial arm is everywhere");
        let torques = solved.torques(&Wrench::new(DVec3::new(3.0, -2.0, 4.0), DVec3::ZERO));
        assert!(torques.iter().all(|torque| torque.abs() < 5.4 * 0.46), "{torques:?}");
    }
    // A leader arm stretched out, its wrist axes in line.
    let solved =
        leader().solve(&[0.0; MAX_AXES], &Configuration::default()).expect("a chain is everywhere");
    assert!(
        solved
            .torques(&Wrench::new(DVec3::ONE, DVec3::ONE))
            .iter()
            .all(|torque| torque.abs() < 3.0)
    );
}

#[test]
fn what_cannot_be_reached_is_none() {
    let near = Configuration::default();
    // Falcon: no solution above about 72°, and a count that is no angle at all.
    assert!(falcon(0.0).solve(&joints([80f64.to_radians(); 3]), &near).is_none());
    assert!(falcon(0.0).solve(&joints([f64::NAN, 0.6, 0.6]), &near).is_none());
    // It still finds its way from a bad last pose.
    let lost = Configuration {
        native_from_grip: Pose::from_translation(DVec3::new(5.0, f64::NAN, 0.0)),
        ..near
    };
    assert!(falcon(0.0).solve(&joints([0.6; 3]), &lost).is_some());
    // Pantograph: arms too far apart, and both on one point.
    assert!(haply(50.0, 40.0, 20.0, [0.0; 2]).solve(&joints([PI, 0.0]), &near).is_none());
    assert!(haply(70.0, 90.0, 0.0, [0.0; 2]).solve(&joints([1.0, 1.0]), &near).is_none());
    // Five-link: both cranks up bring A and B closer than the coupler lets them.
    assert!(polhem_v3(None).solve(&joints([0.0, FRAC_PI_2, FRAC_PI_2]), &near).is_none());
    // A quaternion of no length.
    assert!(Kinematics::Cartesian.solve(&[0.0; MAX_AXES], &near).is_none());
    // And no inverse a metre away.
    for (name, arm) in every_arm() {
        if name != "Hapkit" {
            assert!(
                arm.inverse(&Pose::from_translation(DVec3::splat(1.0)), &arm.home()).is_none(),
                "{name}"
            );
        }
        assert!(
            arm.inverse(&Pose::from_translation(DVec3::splat(f64::NAN)), &arm.home()).is_none(),
            "{name}"
        );
    }
}

#[test]
fn a_reported_pose_is_taken_as_it_is_and_its_wrench_too() {
    let pose = Pose::new(
        DQuat::from_scaled_axis(DVec3::new(0.3, -0.2, 0.9)),
        DVec3::new(0.01, 0.02, -0.03),
    );
    let readings = Kinematics::Cartesian.inverse(&pose, &[0.0; MAX_AXES]).expect("any pose");
    let solved = Kinematics::Cartesian.solve(&readings, &Configuration::default()).expect("a pose");
    assert!((solved.native_from_grip.translation - pose.translation).length() < 1e-15);
    let torques =
        solved.torques(&Wrench::new(DVec3::new(1.0, 2.0, 3.0), DVec3::new(4.0, 5.0, 6.0)));
    assert_eq!(torques, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 0.0, 0.0]);
}
