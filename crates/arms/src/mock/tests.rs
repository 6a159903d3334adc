use core::f64::consts::PI;
use core::time::Duration;
use std::fs;
use std::os::unix::fs::FileTypeExt;
use std::path::PathBuf;

use glam::{DQuat, DVec3};

use super::arm::{MockArm, MockParameters};
use super::link::{ArmLink, Loopback};
use super::linkage::Linkage;
use super::pty::Pty;
use super::serve::{ServeEnd, Serving, serve};
use super::trace::TraceFile;
use crate::Device;
use crate::kinematics::{Capstan, Configuration, Kinematics};
use crate::protocol::{ArmReadings, Firmware, MAX_AXES, Outbox};
use crate::simulated::fault;
use crate::simulated::hand::{GripPath, HandPath};
use crate::simulated::{HandParameters, SimArm, SimParameters};
use crate::transmission::{Joint, Motor, Sensor, Transmission};
use crate::transport::{Carriage, SerialLink, Transport, loopback};
use vps::spatial::{Axes, Pose, Wrench};

const T: f64 = 1e-3;
const WATCHDOG_S: f64 = 0.02;

/// Frames of 24 bytes: six 32-bit numbers, a wrench one way and a position the other way.
#[derive(Default)]
struct Plain {
    motors: [f64; MAX_AXES],
    fed_s: f64,
    rest: Vec<u8>,
}

impl Firmware for Plain {
    fn receive(&mut self, bytes: &[u8], now_s: f64, arm: &ArmReadings, out: &mut Outbox) {
        self.rest.extend(bytes);
        while self.rest.len() >= 24 {
            let frame: Vec<u8> = self.rest.drain(..24).collect();
            for (motor, four) in self.motors.iter_mut().zip(frame.chunks(4)) {
                *motor = f32::from_le_bytes(four.try_into().expect("four bytes")).into();
            }
            self.fed_s = now_s;
            out.push((0..6).flat_map(|idx| (arm.readings[idx] as f32).to_le_bytes()).collect());
        }
    }

    fn advance(&mut self, now_s: f64, _: &ArmReadings, _: &mut Outbox) {
        if now_s - self.fed_s > WATCHDOG_S {
            self.motors = [0.0; MAX_AXES];
        }
    }

    fn motors(&self) -> [f64; MAX_AXES] {
        self.motors
    }
}

fn command(force: DVec3) -> Vec<u8> {
    [force.x, force.y, force.z, 0.0, 0.0, 0.0]
        .iter()
        .flat_map(|number| (*number as f32).to_le_bytes())
        .collect()
}

fn cartesian() -> Transmission {
    Transmission {
        joints: core::array::from_fn(|idx| Joint {
            sensor: Some(Sensor {
                reading_idx: idx,
                rad_per_unit: 1.0,
                home: 0.0,
                offset_rad: 0.0,
            }),
            motor: (idx < 6).then_some(Motor {
                motor_idx: idx,
                units_per_nm: 1.0,
                limit_units: 100.0,
            }),
        }),
    }
}

fn hand() -> HandParameters {
    let goal = Pose::new(DQuat::from_rotation_z(0.2), DVec3::new(0.01, -0.02, 0.005));
    HandParameters {
        path: Some(GripPath::in_device_frame(HandPath::fixed(goal))),
        ..HandParameters::default()
    }
}

fn parameters(faults: &[&str]) -> MockParameters {
    MockParameters {
        kinematics: Kinematics::Cartesian,
        transmission: cartesian(),
        device_from_native: DQuat::IDENTITY,
        sensed: Axes::SIX,
        actuated: Axes::SIX,
        is_compensated: false,
        plant: SimParameters::ideal(T).plant,
        hand: Some(hand()),
        hand_delay_s: 0.0,
        period_s: T,
        limits: (100.0, 10.0),
        faults: faults
            .iter()
            .map(|text| ((*text).to_owned(), fault::parse(text).expect("grammar")))
            .collect(),
        seed: 1,
    }
}

fn mock(faults: &[&str]) -> MockArm {
    MockArm::new(parameters(faults), Box::new(Plain::default())).expect("valid")
}

#[test]
fn it_moves_as_the_arm_in_the_process_does() {
    let mut mock = mock(&[]);
    let mut sim = SimArm::new(SimParameters { hand: Some(hand()), ..SimParameters::ideal(T) })
        .expect("valid");
    sim.read().expect("rest");
    let force = DVec3::new(1.5, 0.25, -0.5);
    mock.receive(&command(force), 0.0);
    for tick in 1..=500 {
        sim.write(&Wrench::new(force, DVec3::ZERO)).expect("written");
        sim.read().expect("sample");
        mock.advance(f64::from(tick) * T);
        mock.receive(&command(force), f64::from(tick) * T);
    }
    assert!((mock.pose().translation - sim.true_pose().translation).length() < 1e-7);
    assert!(mock.pose().rotation_to(sim.true_pose()).length() < 1e-7);
    assert!(mock.pose().translation.length() > 0.01);
    let report = mock.report();
    assert_eq!(
        (report.periods, report.frames_received, report.bytes_received),
        (500, 501, 501 * 24)
    );
    assert!((report.largest_force_n - force.length()).abs() < 1e-6 && report.watchdog_trips == 0);
}

fn capstan() -> (Kinematics, Transmission) {
    let arm = Capstan {
        length_m: [0.080, 0.205, 0.245],
        origin_m: DVec3::new(0.220, 0.0, 0.080),
        gimbal: None,
        links: None,
    };
    let joint = |idx: usize, ratio: f64, sign: f64, offset| Joint {
        sensor: Some(Sensor::encoder(idx, 2000.0, ratio, -1.0, 0.0, offset)),
        motor: Some(Motor::current(idx, ratio, 0.0259, 1.0, sign, 2000.0)),
    };
    let mut transmission = Transmission::default();
    transmission.joints[0] = joint(0, 10.0 / 160.0, 1.0, 0.0);
    transmission.joints[1] = joint(1, 10.0 / 120.0, -1.0, 0.0);
    transmission.joints[2] = joint(2, 10.0 / 120.0, -1.0, PI / 2.0);
    (Kinematics::Capstan(arm), transmission)
}

#[test]
fn encoders_and_motors_of_a_linkage_say_the_same_as_the_host_computes() {
    let (kinematics, transmission) = capstan();
    let mut linkage = Linkage::new(kinematics, transmission, DQuat::IDENTITY, Axes::TRANSLATION);
    assert!(linkage.pose().translation.length() < 1e-9, "it rests in the middle of its workspace");
    let place = DVec3::new(0.02, -0.03, 0.01);
    linkage.follow(Pose::from_translation(place), vps::spatial::Twist::ZERO, T);
    let joints = transmission.angles(&linkage.readings().readings);
    let solved = kinematics.solve(&joints, &Configuration::default()).expect("in reach");
    assert!((solved.native_from_grip.translation - place).length() < 1e-9);
    let force = DVec3::new(0.5, -1.0, 0.75);
    let (motors, scale) =
        transmission.commands(&solved.torques(&Wrench::new(force, DVec3::ZERO)), &[0.0; MAX_AXES]);
    assert!((scale - 1.0).abs() < 1e-12);
    let felt = linkage.wrench(&motors, 0.0);
    assert!((felt.force - force).length() < 1e-6 && felt.torque.length() < 1e-9, "{felt:?}");
    assert_eq!(linkage.wrench(&[0.0; MAX_AXES], 0.0), Wrench::ZERO);
    // Out of reach it stays.
    let before = linkage.readings().readings;
    linkage.follow(Pose::from_translation(DVec3::splat(2.0)), vps::spatial::Twist::ZERO, T);
    assert!(
        linkage.readings().readings.iter().zip(before).all(|(now, then)| (now - then).abs() < 1e-9)
    );
}

/// A host that pushes with 2 N and stops at once when a reply is missing or odd. Gives the replies.
fn converse(arm: &mut MockArm, ticks: u32, stops: bool) -> Vec<Vec<u8>> {
    let mut replies = Vec::new();
    let mut pushing = true;
    for tick in 0..ticks {
        let now_s = f64::from(tick) * T;
        arm.receive(&command(if pushing { DVec3::X * 2.0 } else { DVec3::ZERO }), now_s);
        arm.advance(now_s + T);
        let before = replies.len();
        while let Some(frame) = arm.next_frame(now_s) {
            arm.sent(true);
            replies.push(frame);
        }
        if stops
            && (replies.len() == before || replies.last().is_some_and(|frame| frame.len() != 24))
        {
            pushing = false;
        }
    }
    replies
}

#[test]
fn faults_of_the_wire_are_on_the_wire() {
    let sound = converse(&mut mock(&[]), 100, false);
    assert_eq!(sound.len(), 100);
    let of = |spec: &str| converse(&mut mock(&[spec]), 100, false);
    assert_eq!(of("stall@50ms").len(), 50);
    let dropped = of("drop=20%").len();
    assert!((60..95).contains(&dropped), "{dropped}");
    let cut = of("truncate@50ms");
    assert!(cut[..50] == sound[..50] && cut[50..].iter().all(|frame| frame.len() == 12));
    let garbled = of("garbage@50ms+10ms");
    assert!(garbled[50..60].iter().zip(&sound[50..60]).all(|(a, b)| a != b && a.len() == 24));
    assert_eq!(garbled[60..], sound[60..]);
    let short = of("lost-byte@50ms");
    assert!(short[..50] == sound[..50] && short[50..].iter().all(|frame| frame.len() == 23));
    let twice = of("repeat@50ms+10ms");
    assert!(twice.len() == 110 && (50..70).step_by(2).all(|n| twice[n] == twice[n + 1]));
    let swapped = of("reorder@50ms+10ms");
    assert!((50..60).step_by(2).all(|n| swapped[n] == sound[n + 1] && swapped[n + 1] == sound[n]));
    assert_eq!(swapped[60..], sound[60..]);
    assert_eq!(of("slow=4ms").len(), 96);
    let x = |frame: &Vec<u8>| f32::from_le_bytes(frame[..4].try_into().expect("four bytes"));
    assert!(x(&of("nan@50ms")[60]).is_nan());
    let jump = of("jump@50ms");
    assert!((x(&jump[60]) - x(&sound[60]) - 0.05).abs() < 1e-6);
    let stuck = of("stuck@50ms");
    assert_eq!(stuck[99], stuck[60]);
    assert_ne!(sound[99], sound[60]);
    assert!(x(&of("sign-flip")[99]) < x(&sound[99]));
}

#[test]
fn it_tells_how_soon_the_host_let_go() {
    let mut arm = mock(&["stall@50ms"]);
    converse(&mut arm, 100, true);
    let report = arm.report();
    let fault = &report.faults[0];
    assert_eq!((fault.fault.as_str(), report.faults.len()), ("stall@50ms", 1));
    assert!((fault.force_before_n - 2.0).abs() < 1e-6);
    assert!(fault.zero_after_ticks.is_some_and(|ticks| (1..=3).contains(&ticks)), "{fault:?}");
    assert_eq!(fault.force_again_after_ticks, None);
    assert!((fault.largest_force_n - 2.0).abs() < 1e-6);
    // A host that does not notice.
    let mut arm = mock(&["stall@50ms"]);
    converse(&mut arm, 100, false);
    assert_eq!(arm.report().faults[0].zero_after_ticks, None);
    // A host that is killed: the watchdog of the arm lets go.
    for tick in 100..200 {
        arm.advance(f64::from(tick) * T);
    }
    let report = arm.report();
    assert_eq!((report.watchdog_trips, report.last_command.fx_n), (1, 0.0));
    let zero_after = report.faults[0].zero_after_ticks.expect("the watchdog");
    assert!((50 + 20..50 + 24).contains(&zero_after), "{zero_after}");
}

fn link_path(folder: &tempfile::TempDir) -> PathBuf {
    folder.path().join("arm")
}

#[test]
fn a_pty_is_a_serial_port_that_can_be_pulled_and_put_in_again() {
    let folder = tempfile::tempdir().expect("folder");
    let path = link_path(&folder);
    let mut pty = Pty::new(&path).expect("pty");
    assert!(fs::metadata(&path).expect("node").file_type().is_char_device());
    let mut host = SerialLink::open(&path, 115_200).expect("opened");
    host.send(b"\x00\x0d\x0a\x11\xff!").expect("sent");
    let mut buffer = [0; 64];
    pty.wait(Duration::from_secs(1));
    let n = pty.receive(&mut buffer);
    assert_eq!(&buffer[..n], b"\x00\x0d\x0a\x11\xff!", "bytes as they are");
    assert!(pty.send(b"\x0a\x0d\x03"));
    let mut got = Vec::new();
    for _ in 0..200 {
        let n = host.receive(&mut buffer).expect("there");
        got.extend_from_slice(&buffer[..n]);
        if got.len() == 3 {
            break;
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    assert_eq!(got, b"\x0a\x0d\x03");
    assert!(!pty.is_host_gone());

    pty.unplug().expect("pulled");
    assert!(!path.exists() && !pty.send(b"x"));
    let lost = (0..200).any(|_| {
        std::thread::sleep(Duration::from_millis(1));
        host.receive(&mut buffer).is_err()
    });
    assert!(lost, "the host sees that the arm is gone");
    pty.replug().expect("put in");
    let mut host = SerialLink::open(&path, 115_200).expect("opened again");
    host.send(b"?").expect("sent");
    pty.wait(Duration::from_secs(1));
    assert_eq!(pty.receive(&mut buffer), 1);
    drop(host);
    pty.wait(Duration::from_millis(200));
    assert_eq!((pty.receive(&mut buffer), pty.is_host_gone()), (0, true));
    // The next host finds an arm.
    drop(SerialLink::open(&path, 115_200).expect("opened a third time"));
    drop(pty);
    assert!(fs::symlink_metadata(&path).is_err(), "nothing stays behind");
}

#[test]
fn a_link_that_leads_to_another_arm_is_left_alone() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("arm");
    let first = Pty::new(&path).expect("pty");
    let refused = Pty::new(&path).err().expect("taken").to_string();
    assert!(refused.contains("which another program has open"), "{refused}");
    let leads_to = std::fs::read_link(&path).expect("still there");
    drop(first);
    assert!(!path.exists() && !leads_to.exists());
    // What leads nowhere is replaced, and what is not ours any more stays.
    std::os::unix::fs::symlink("/nowhere", &path).expect("linked");
    let second = Pty::new(&path).expect("pty");
    std::fs::remove_file(&path).expect("removed");
    std::os::unix::fs::symlink("/elsewhere", &path).expect("linked");
    drop(second);
    assert_eq!(std::fs::read_link(&path).expect("not ours").to_str(), Some("/elsewhere"));
}

#[test]
fn it_serves_a_host_over_a_pty_until_that_has_gone() {
    let folder = tempfile::tempdir().expect("folder");
    let path = link_path(&folder);
    let mut pty = Pty::new(&path).expect("pty");
    let host = std::thread::spawn(move || {
        let mut link = SerialLink::open(&path, 115_200).expect("opened");
        let mut replies = 0;
        let mut buffer = [0; 256];
        // A busy machine takes longer for it; an arm that stopped answering would never get there.
        for _ in 0..5000 {
            link.send(&command(DVec3::X)).expect("sent");
            std::thread::sleep(Duration::from_millis(2));
            replies += link.receive(&mut buffer).expect("there");
            if replies >= 90 * 24 {
                break;
            }
        }
        replies
    });
    let mut arm = mock(&[]);
    let serving =
        Serving { period_s: T, duration: Some(Duration::from_secs(20)), until_host_gone: true };
    let ended = serve(&mut arm, &mut pty, serving, None, || false).expect("served");
    assert_eq!(ended, ServeEnd::HostGone);
    let replies = host.join().expect("no panic");
    let report = arm.report();
    assert!(replies >= 90 * 24 && report.frames_sent >= 90, "{replies} bytes, {report:?}");
    assert!((report.largest_force_n - 1.0).abs() < 1e-6 && report.periods > 100);
}

#[test]
fn a_plug_that_is_pulled_in_memory_is_out() {
    let (mut host, end) = loopback(Carriage::Stream);
    let mut link = Loopback(end);
    let mut arm = mock(&["unplug@20ms"]);
    host.send(&command(DVec3::X)).expect("open");
    let serving =
        Serving { period_s: T, duration: Some(Duration::from_millis(60)), until_host_gone: false };
    assert_eq!(
        serve(&mut arm, &mut link, serving, None, || false).expect("served"),
        ServeEnd::Duration
    );
    assert!(host.send(&command(DVec3::X)).is_err());
    assert_eq!(arm.report().watchdog_trips, 1);
}

#[test]
fn a_deaf_arm_leaves_what_it_is_reported_in_the_tty_and_hears_it_when_it_wakes() {
    let folder = tempfile::tempdir().expect("folder");
    let path = link_path(&folder);
    let traced = folder.path().join("trace.csv");
    let mut pty = Pty::new(&path).expect("pty");
    let mut arm = mock(&["deaf@100ms+300ms"]);
    let mut trace = TraceFile::create(&traced).expect("made");
    let host = std::thread::spawn(move || {
        let mut link = SerialLink::open(&path, 115_200).expect("opened");
        for _ in 0..3 {
            link.send(&command(DVec3::X)).expect("sent");
            std::thread::sleep(Duration::from_millis(10));
        }
        // It is deaf now, and whatever the machine does it is still deaf when these are written, or
        // gets them awake.
        std::thread::sleep(Duration::from_millis(150));
        link.send(&command(DVec3::X * 3.0)).expect("the link is up");
        std::thread::sleep(Duration::from_millis(400));
        drop(link);
    });
    let serving =
        Serving { period_s: T, duration: Some(Duration::from_secs(20)), until_host_gone: true };
    assert_eq!(
        serve(&mut arm, &mut pty, serving, Some(&mut trace), || false).expect("served"),
        ServeEnd::HostGone
    );
    host.join().expect("no panic");
    let report = arm.report();
    assert!(
        (report.largest_force_n - 3.0).abs() < 1e-6,
        "what was written meanwhile is read at last: {report:?}"
    );
    let text = fs::read_to_string(&traced).expect("text");
    let rows: Vec<Vec<f64>> = text
        .lines()
        .skip(1)
        .map(|line| line.split(',').map(|cell| cell.parse().expect("a number")).collect())
        .collect();
    let heard = rows.iter().find(|row| (row[1] - 3.0).abs() < 1e-3).expect("in the trace");
    let deaf = rows.iter().find(|row| row[5] > 0.0).expect("in the trace");
    assert!(heard[5] == 0.0 && heard[0] - deaf[0] > 0.25e9, "only when it is awake: {text}");
}
