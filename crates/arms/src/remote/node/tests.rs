//! The node beside the arm, packet by packet: what a host may ask of it, and what it does when the
//! host falls silent, repeats itself, is not the one it listens to, or wants too much.

use std::sync::{Arc, Mutex};

use crate::protocol::{Codec, MotorCommand, StartError};
use crate::remote::command_hold::HoldTiming;
use crate::remote::figures::{LinkPhase, NodeReport};
use crate::remote::{LinkFigures, Node, NodeFigures, NodeParameters, RemoteHost};
use crate::transport::{
    Frame, LinkQuality, NetworkEnd, SimulatedNetwork, Transport, TransportError,
};
use crate::{Capabilities, Device, DeviceError};
use glam::DVec3;
use vps::spatial::{Axes, DeviceSample, SampleStatus, Wrench};

const T: f64 = 1e-3;
const LIMIT_N: f64 = 5.0;

/// An arm that stands still and writes down its commands.
struct Arm {
    sample: DeviceSample,
    is_gone: bool,
    reported: Wrench,
}

impl Device for Arm {
    fn capabilities(&self) -> Capabilities {
        Capabilities { sensed: Axes::SIX, actuated: Axes::SIX, ..Capabilities::default() }
    }

    fn read(&mut self) -> Result<DeviceSample, DeviceError> {
        self.sample.sequence += 1;
        if self.is_gone { Err(DeviceError::Lost) } else { Ok(self.sample) }
    }

    fn write(&mut self, wrench_device: &Wrench) -> Result<Wrench, DeviceError> {
        self.reported = *wrench_device;
        Ok(*wrench_device)
    }

    fn stop(&mut self) {
        self.reported = Wrench::ZERO;
    }
}

struct Far {
    network: SimulatedNetwork,
    node: Node,
    arm: Arm,
    next_s: f64,
}

impl Far {
    fn advance_to(&mut self, now_s: f64) {
        while self.next_s <= now_s {
            self.network.set_now(self.next_s);
            self.node.step(self.next_s, &mut self.arm);
            self.next_s += T;
        }
        self.network.set_now(now_s);
    }
}

/// A host's end that lets time pass while it waits.
struct Waiting {
    end: NetworkEnd,
    far: Arc<Mutex<Far>>,
}

impl Transport for Waiting {
    fn receive(&mut self, buffer: &mut [u8]) -> Result<usize, TransportError> {
        let n = self.end.receive(buffer)?;
        if n == 0 {
            let mut far = self.far.lock().expect("no panic");
            let now_s = far.network.now_s();
            far.advance_to(now_s + 0.25 * T);
        }
        Ok(n)
    }

    fn send(&mut self, frame: &[u8]) -> Result<(), TransportError> {
        self.end.send(frame)
    }

    fn unread(&mut self) -> usize {
        self.end.unread()
    }

    fn now_ns(&self) -> i64 {
        self.end.now_ns()
    }
}

struct Bench {
    far: Arc<Mutex<Far>>,
    end: NetworkEnd,
    host: RemoteHost,
    figures: Arc<NodeFigures>,
    now_s: f64,
    /// Each packet is sent so often.
    copies: usize,
}

fn host(token: u32) -> RemoteHost {
    RemoteHost::new(Axes::SIX, Axes::SIX, T, token, Arc::new(LinkFigures::default()))
}

impl Bench {
    /// A host that has greeted the node.
    fn new(deadman: Option<u8>) -> Self {
        let network = SimulatedNetwork::new(LinkQuality::default(), 1);
        let (end, arm_end) = network.ends();
        let parameters = NodeParameters {
            name: "left".into(),
            sensed: Axes::SIX,
            actuated: Axes::SIX,
            period_s: T,
            force_limit_n: LIMIT_N,
            torque_limit_nm: 0.1,
            workspace_radius_m: 0.1,
            timing: HoldTiming { hold_s: 10e-3, fade_s: 20e-3 },
            deadman,
            starts_with_host: false,
        };
        let node = Node::new(parameters, Box::new(arm_end));
        let figures = node.figures();
        let sample = DeviceSample { status: SampleStatus::Fresh, ..DeviceSample::default() };
        let arm = Arm { sample, is_gone: false, reported: Wrench::ZERO };
        let far =
            Arc::new(Mutex::new(Far { network: network.clone(), node, arm, next_s: 0.5 * T }));
        let mut host = host(0x1234_0000);
        host.start(&mut Waiting { end: end.clone(), far: far.clone() }).expect("greeted");
        Self { far, end, host, figures, now_s: network.now_s(), copies: 1 }
    }

    /// A ms in which the host says nothing.
    fn silent_tick(&mut self) -> DVec3 {
        self.now_s += T;
        let mut far = self.far.lock().expect("no panic");
        far.advance_to(self.now_s);
        let reported = far.arm.reported.force;
        drop(far);
        let mut buffer = [0; 256];
        self.host.tell_time(self.now_s);
        while let n @ 1.. = self.end.receive(&mut buffer).expect("open") {
            self.host.feed(&buffer[..n]);
        }
        reported
    }

    /// A ms in which it asks for a force along x.
    fn tick(&mut self, enabled: bool, force_n: f64) -> DVec3 {
        let reported = self.silent_tick();
        let mut frame = Frame::default();
        self.host.encode(
            &MotorCommand::of([force_n, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], enabled),
            &mut frame,
        );
        for _ in 0..self.copies {
            self.end.send(frame.as_slice()).expect("open");
        }
        reported
    }

    fn ticks(&mut self, n: usize, enabled: bool, force_n: f64) -> DVec3 {
        (0..n).map(|_| self.tick(enabled, force_n)).last().expect("ticks")
    }

    fn arm<R>(&self, change: impl FnOnce(&mut Arm) -> R) -> R {
        change(&mut self.far.lock().expect("no panic").arm)
    }

    fn phase(&self) -> LinkPhase {
        self.figures.phase()
    }

    fn report(&self) -> NodeReport {
        self.figures.report()
    }
}

#[test]
fn a_host_that_falls_silent_gets_its_force_back_only_after_it_has_disabled() {
    let mut bench = Bench::new(None);
    assert_eq!(bench.ticks(20, false, 2.0), DVec3::ZERO, "not enabled");
    assert!(
        (bench.ticks(60, true, 2.0).x - 2.0).abs() < 1e-6 && bench.phase() == LinkPhase::Enabled
    );
    let silence: Vec<f64> = (0..60).map(|_| bench.silent_tick().x).collect();
    assert!(silence[..9].iter().all(|force| (force - 2.0).abs() < 1e-6), "held: {silence:?}");
    assert!(
        silence.windows(2).all(|pair| pair[1] <= pair[0])
            && silence[30..].iter().all(|force| *force == 0.0),
        "{silence:?}"
    );
    assert_eq!((bench.phase(), bench.report().link_losses), (LinkPhase::Tripped, 1));
    assert!(
        (28.0..=30.0).contains(&bench.report().zero_after_ms),
        "{} ms",
        bench.report().zero_after_ms
    );
    assert!(bench.host.is_cut(), "the host gets it");
    // It comes back and goes on as if nothing had been.
    assert_eq!(bench.ticks(50, true, 2.0), DVec3::ZERO);
    assert_eq!(bench.phase(), LinkPhase::Tripped);
    bench.ticks(3, false, 0.0);
    assert!(bench.phase() == LinkPhase::Disabled && !bench.host.is_cut());
    assert!((bench.ticks(60, true, 2.0).x - 2.0).abs() < 1e-6);
    assert_eq!(bench.ticks(3, false, 0.0), DVec3::ZERO, "disabled is zero at once");
}

/// What came while the node stood still is as old as the stop, and more of it than is read at once.
#[test]
fn a_node_that_stood_still_obeys_no_force_that_lay_unread() {
    for stop_ms in [31, 100, 500] {
        let mut bench = Bench::new(None);
        assert!((bench.ticks(60, true, 2.0).x - 2.0).abs() < 1e-6);
        let mut frame = Frame::default();
        for _ in 0..stop_ms {
            bench.now_s += T;
            bench.host.tell_time(bench.now_s);
            let push = MotorCommand::of([2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], true);
            bench.host.encode(&push, &mut frame);
            bench.end.send(frame.as_slice()).expect("open");
        }
        bench.far.lock().expect("no panic").next_s = bench.now_s + 0.5 * T;
        let forces: Vec<f64> = (0..100).map(|_| bench.tick(true, 2.0).x).collect();
        // The first period is over before it.
        assert!(forces[1..].iter().all(|force| *force == 0.0), "{stop_ms} ms: {forces:?}");
        assert_eq!(bench.phase(), LinkPhase::Tripped, "{stop_ms} ms");
        bench.ticks(3, false, 0.0);
        assert!((bench.ticks(60, true, 2.0).x - 2.0).abs() < 1e-6, "{stop_ms} ms");
    }
}

#[test]
fn no_host_gets_more_than_the_arm_may_give_nor_faster() {
    let mut bench = Bench::new(None);
    let mut before = 0.0;
    for n in 0..200 {
        let force = bench.tick(true, if n % 40 < 20 { 1e6 } else { -1e6 }).x;
        assert!(force.abs() <= LIMIT_N * (1.0 + 1e-12), "tick {n}: {force} N");
        assert!(
            (force - before).abs() <= 0.1 * LIMIT_N * (1.0 + 1e-9),
            "tick {n}: from {before} to {force} N in a ms"
        );
        before = force;
    }
    assert!(bench.report().commands > 190);
}

#[test]
fn packets_that_come_twice_or_late_change_nothing() {
    let mut bench = Bench::new(None);
    bench.copies = 3;
    assert!((bench.ticks(100, true, 1.0).x - 1.0).abs() < 1e-6);
    let NodeReport { commands, old_packets, lost_packets, .. } = bench.report();
    assert!(old_packets >= 198 && lost_packets == 0, "{old_packets} old of {commands}");
    // One of before, kept back on its way while force was on: it must not bring force back after a
    // disable.
    let mut kept = Frame::default();
    bench.host.encode(&MotorCommand::of([4.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], true), &mut kept);
    bench.copies = 1;
    bench.ticks(5, false, 0.0);
    bench.end.send(kept.as_slice()).expect("open");
    assert_eq!((bench.ticks(3, false, 0.0), bench.phase()), (DVec3::ZERO, LinkPhase::Disabled));
}

#[test]
fn a_node_listens_to_one_host_until_that_one_has_been_silent_for_a_second() {
    let mut bench = Bench::new(None);
    bench.ticks(20, true, 1.0);
    let mut second = host(0x4321_0000);
    let mut link = Waiting { end: bench.end.clone(), far: bench.far.clone() };
    let refused = second.start(&mut link).expect_err("another one is there");
    assert!(
        matches!(&refused, StartError::Refused(text) if text.contains("listens to another host")),
        "{refused}"
    );
    // A command of its own does nothing either.
    let mut frame = Frame::default();
    second.encode(&MotorCommand::of([3.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], true), &mut frame);
    link.send(frame.as_slice()).expect("open");
    bench.now_s = bench.far.lock().expect("no panic").network.now_s();
    assert!(bench.ticks(10, true, 1.0).x <= 1.0 + 1e-6 && bench.report().strange_packets >= 2);
    for _ in 0..1100 {
        bench.silent_tick();
    }
    second.start(&mut link).expect("the first one is gone");
    assert_eq!(bench.phase(), LinkPhase::Disabled);
    bench.now_s = bench.far.lock().expect("no panic").network.now_s();
    assert_eq!(
        (bench.ticks(20, true, 1.0), bench.phase()),
        (DVec3::ZERO, LinkPhase::Disabled),
        "the node does not accept the first one any more"
    );
}

#[test]
fn an_arm_that_is_gone_silent_hot_or_without_its_zero_takes_no_force() {
    type Harm = fn(&mut Arm);
    let rows: [(&str, u32, Harm); 4] = [
        ("gone", 6, |arm| arm.is_gone = true),
        ("silent", 5, |arm| arm.sample.status = SampleStatus::Stale),
        ("hot", 3, |arm| arm.sample.overheated = true),
        ("its zero lost", 1, |arm| arm.sample.homed = false),
    ];
    for (name, error, harm) in rows {
        let mut bench = Bench::new(None);
        assert!(bench.ticks(50, true, 1.0).x > 0.9, "{name}");
        bench.arm(harm);
        assert_eq!(bench.ticks(30, true, 1.0), DVec3::ZERO, "{name}");
        assert_eq!(
            (bench.phase(), bench.host.newest().error),
            (LinkPhase::Refusing, error),
            "{name}"
        );
        bench.arm(|arm| {
            arm.is_gone = false;
            arm.sample = DeviceSample { status: SampleStatus::Fresh, ..DeviceSample::default() };
        });
        assert_eq!(bench.ticks(30, true, 1.0), DVec3::ZERO, "{name}: not acknowledged yet");
        bench.ticks(3, false, 0.0);
        assert!(bench.ticks(50, true, 1.0).x > 0.9, "{name}: well again");
    }
}

#[test]
fn a_deadman_is_held_to_at_the_arm_itself() {
    let mut bench = Bench::new(Some(1));
    assert_eq!(bench.ticks(50, true, 1.0), DVec3::ZERO);
    bench.arm(|arm| arm.sample.buttons = 0b10);
    assert!(bench.ticks(50, true, 1.0).x > 0.9);
    bench.arm(|arm| arm.sample.buttons = 0b01);
    assert_eq!(bench.ticks(15, true, 1.0), DVec3::ZERO);
}
