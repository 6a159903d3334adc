//! An arm under test with what lies behind it.

use std::collections::VecDeque;
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard};

use arms::inspection::{self, Plug};
use arms::mock::builder::{self, MockSettings};
use arms::mock::{FaultReport, MockArm};
use arms::profile::{self, Profile, RealArm};
use arms::protocol::{Codec, MAX_AXES, Protocol};
use arms::simulated::fault::{self, FaultKind};
use arms::simulated::hand::{GripPath, HandPath};
use arms::simulated::{HandParameters, SimArm, SimParameters};
use arms::transport::{Carriage, LoopbackEnd, Transport, TransportError, loopback};
use arms::{Device, WiredArm};
use glam::{DQuat, DVec3};
use vps::spatial::{Pose, Wrench};

/// What goes wrong on command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InjectedFault {
    /// Nothing.
    None,
    /// The plug.
    Cut,
    /// Every frame of the arm is half as long.
    Cropped,
    /// Every frame of the arm comes four periods late.
    Late,
}

/// By how much, periods.
const LATE_TICKS: f64 = 4.0;

/// An arm as the servo has it, and the truth about it.
pub trait Rig: Send {
    /// What the host knows of it.
    fn profile(&self) -> &Profile;
    /// The driver.
    fn device(&mut self) -> &mut dyn Device;
    /// The arm's side of a period.
    fn advance(&mut self);
    /// What the motors make.
    fn felt(&self) -> Wrench;
    /// The same with the weight of the links that they hold.
    fn made_by_motors(&self) -> Wrench {
        self.felt()
    }
    /// True while any motor has a command.
    fn is_driven(&self) -> bool;
    /// True pose, `device_from_grip`.
    fn pose(&self) -> Pose;
    /// Force and torque that one step of every motor amounts to.
    fn rounding(&self) -> (f64, f64);
    /// Whether it reports rates and no pose.
    fn is_rate_input(&self) -> bool;
    /// Begins the injected fault.
    fn raise_fault(&mut self);
    /// Ends it, where it can end.
    fn clear_fault(&mut self);
    /// A fault of the arm that stays, of those that a mock arm has; an arm without a wire has none
    /// here.
    fn fail(&mut self, _: FaultKind, _: &str) {}
    /// What came of it.
    fn felt_fault(&self) -> Option<FaultReport> {
        None
    }
    /// Joint torques that a wrench asks of the motors, N·m or N, each with what one step of its
    /// motor on the wire makes, and what it takes to hold the weight of the links.
    fn torques(&self, wrench: &Wrench) -> Vec<(f64, f64, f64)>;
    /// Frames that the host sent so far.
    fn n_sent(&self) -> u32;
    /// Another plug for a lost arm; false where there is none.
    fn reconnect(&mut self) -> bool;
    /// The end of the arm.
    fn close(&mut self);

    /// Name of the profile.
    fn name(&self) -> String {
        self.profile().name.clone()
    }
}

fn hand_at(place: DVec3) -> HandParameters {
    let path = GripPath::in_device_frame(HandPath::fixed(Pose::from_translation(place)));
    HandParameters { path: Some(path), ..HandParameters::default() }
}

/// Makes an arm: held there, or free.
pub type Make = dyn Fn(Option<DVec3>, InjectedFault) -> Box<dyn Rig>;

/// Every shipped arm, simulated and real, its signs verified: what is left of the force of those
/// whose signs are not is tried in `wrong_signs`.
pub fn every_arm() -> Vec<Box<Make>> {
    arms(true)
}

/// The same with unverified signs, as they are shipped.
pub fn every_arm_as_shipped() -> Vec<Box<Make>> {
    arms(false)
}

fn arms(signs_verified: bool) -> Vec<Box<Make>> {
    profile::names()
        .map(|name| {
            let mut profile = profile::find(name, Path::new("")).expect(name);
            if let Some(real) = &mut profile.real {
                real.signs_verified = signs_verified;
            }
            Box::new(move |hand, trouble| -> Box<dyn Rig> {
                match &profile.real {
                    Some(real) => Box::new(WiredRig::new(&profile, real, hand, trouble)),
                    None => Box::new(SimRig::new(&profile, hand, trouble)),
                }
            }) as Box<Make>
        })
        .collect()
}

/// The same with another frame: no shipped arm with a wrist has one of its own.
///
/// # Panics
/// The profile is not the one that is shipped.
pub fn turned_arm() -> Box<dyn Rig> {
    let mut profile = profile::find("polhem-2022", Path::new("")).expect("shipped");
    if let Some(real) = &mut profile.real {
        real.signs_verified = true;
        real.device_from_native = DQuat::from_rotation_z(core::f64::consts::FRAC_PI_2);
    }
    let real = profile.real.clone().expect("real");
    Box::new(WiredRig::new(
        &profile,
        &real,
        Some(DVec3::new(0.01, -0.02, 0.015)),
        InjectedFault::None,
    ))
}

/// Reads before the trouble of a simulated arm.
const TROUBLE_TICK: u32 = 2000;

struct SimRig {
    profile: Profile,
    arm: SimArm,
    n_reads_left: u32,
}

impl SimRig {
    fn new(profile: &Profile, hand: Option<DVec3>, trouble: InjectedFault) -> Self {
        let period_s = 1.0 / f64::from(profile.link.rate_hz);
        let begin_ms = f64::from(TROUBLE_TICK) * period_s * 1e3;
        let fault = match trouble {
            InjectedFault::None => None,
            InjectedFault::Late => Some(format!("slow={}ms", LATE_TICKS * period_s * 1e3)),
            InjectedFault::Cut => Some(format!("unplug@{begin_ms}ms")),
            InjectedFault::Cropped => {
                Some(format!("truncate@{begin_ms}ms+{}ms", 20.0 * period_s * 1e3))
            }
        };
        let parameters = SimParameters {
            period_s,
            plant: profile.plant,
            hand: hand.map(hand_at),
            sensed: profile.sensed,
            actuated: profile.actuated,
            force_limit_n: profile.limits.force_n,
            torque_limit_nm: profile.limits.torque_nm,
            watchdog_ms: profile.link.device_watchdog_ms,
            holds_last_command: profile.link.holds_last_command,
            fault: fault.map(|text| fault::parse(&text).expect("grammar")),
            ..SimParameters::ideal(period_s)
        };
        Self {
            profile: profile.clone(),
            arm: SimArm::new(parameters).expect("valid"),
            n_reads_left: TROUBLE_TICK,
        }
    }
}

impl Rig for SimRig {
    fn profile(&self) -> &Profile {
        &self.profile
    }

    fn device(&mut self) -> &mut dyn Device {
        &mut self.arm
    }

    fn advance(&mut self) {
        self.n_reads_left = self.n_reads_left.saturating_sub(1);
    }

    fn felt(&self) -> Wrench {
        self.arm.command()
    }

    fn is_driven(&self) -> bool {
        self.arm.command() != Wrench::ZERO
    }

    fn pose(&self) -> Pose {
        self.arm.true_pose()
    }

    fn rounding(&self) -> (f64, f64) {
        (0.0, 0.0)
    }

    fn torques(&self, wrench: &Wrench) -> Vec<(f64, f64, f64)> {
        wrench
            .force
            .to_array()
            .into_iter()
            .chain(wrench.torque.to_array())
            .map(|torque| (torque, 0.0, 0.0))
            .collect()
    }

    fn n_sent(&self) -> u32 {
        0
    }

    fn is_rate_input(&self) -> bool {
        false
    }

    fn raise_fault(&mut self) {
        for _ in 0..self.n_reads_left {
            self.arm.read().expect("sound so far");
        }
    }

    fn clear_fault(&mut self) {}

    fn reconnect(&mut self) -> bool {
        false
    }

    fn close(&mut self) {
        self.arm.stop();
    }
}

/// The arm's end of the wire.
struct Side {
    mock: MockArm,
    there: LoopbackEnd,
    period_s: f64,
    now_s: f64,
    /// Every look at the wire takes a period: the host waits for answers.
    is_in_dialogue: bool,
    is_cropped: bool,
    is_late: bool,
    /// Frames on their slow way to the host.
    late: VecDeque<(f64, Vec<u8>)>,
    n_sent: u32,
}

impl Side {
    fn exchange(&mut self) {
        let mut buffer = [0; 1024];
        while let Ok(n @ 1..) = self.there.receive(&mut buffer) {
            self.mock.receive(&buffer[..n], self.now_s);
        }
        while let Some(frame) = self.mock.next_frame(self.now_s) {
            let late_s = if self.is_late { LATE_TICKS * self.period_s } else { 0.0 };
            self.late.push_back((self.now_s + late_s - 0.5 * self.period_s, frame));
        }
        while let Some((_, frame)) = self.late.pop_front_if(|(due_s, _)| *due_s <= self.now_s) {
            let n = if self.is_cropped { frame.len() / 2 } else { frame.len() };
            // Into a link that was cut: it does not arrive.
            let _ = self.there.send(&frame[..n]);
        }
    }

    fn advance(&mut self) {
        self.exchange();
        self.now_s += self.period_s;
        self.mock.advance(self.now_s);
        self.exchange();
    }
}

/// The host's end of the wire. The arm answers at once.
struct WireEnd {
    here: LoopbackEnd,
    side: Arc<Mutex<Side>>,
}

impl Transport for WireEnd {
    fn receive(&mut self, buffer: &mut [u8]) -> Result<usize, TransportError> {
        {
            let mut side = self.side.lock().expect("no panic");
            if side.is_in_dialogue {
                side.advance();
            } else {
                side.exchange();
            }
        }
        self.here.receive(buffer)
    }

    fn send(&mut self, frame: &[u8]) -> Result<(), TransportError> {
        self.side.lock().expect("no panic").n_sent += 1;
        self.here.send(frame)
    }

    fn send_now(&mut self, frame: &[u8]) -> Result<(), TransportError> {
        self.side.lock().expect("no panic").n_sent += 1;
        self.here.send_now(frame)
    }

    fn unread(&mut self) -> usize {
        self.here.unread()
    }
}

/// An arm on a wire and its mock at the other end.
pub struct WiredRig {
    profile: Profile,
    protocol: Protocol,
    carriage: Carriage,
    side: Arc<Mutex<Side>>,
    /// Before the arm: its end waits until the lost connection has no place to be any more.
    plug: Plug,
    arm: Option<WiredArm>,
    trouble: InjectedFault,
    is_rate_input: bool,
}

impl WiredRig {
    fn new(profile: &Profile, real: &RealArm, hand: Option<DVec3>, trouble: InjectedFault) -> Self {
        Self::unlike(profile, real, profile, hand, trouble)
    }

    /// An arm that is another one than the profile of its host says.
    ///
    /// # Panics
    /// The profile is that of a simulated arm.
    pub fn miswired(profile: &Profile, arm: &Profile, hand: Option<DVec3>) -> Self {
        Self::unlike(profile, profile.real.as_ref().expect("real"), arm, hand, InjectedFault::None)
    }

    fn unlike(
        profile: &Profile,
        real: &RealArm,
        arm: &Profile,
        hand: Option<DVec3>,
        trouble: InjectedFault,
    ) -> Self {
        let settings = MockSettings {
            hand: hand.map(hand_at),
            hand_delay: core::time::Duration::ZERO,
            faults: Vec::new(),
            seed: 1,
        };
        let (parameters, protocol) = builder::parameters(arm, settings);
        let carriage = real.matching.transport.carriage();
        let period_s = parameters.period_s;
        let mock = MockArm::new(parameters, protocol.firmware(carriage)).expect("valid");
        let there = loopback(carriage).1;
        let side = Arc::new(Mutex::new(Side {
            mock,
            there,
            period_s,
            now_s: 0.0,
            is_in_dialogue: false,
            is_cropped: false,
            is_late: false,
            late: VecDeque::new(),
            n_sent: 0,
        }));
        let (link, codec) = plugged(&side, &protocol, carriage, false);
        let (wired, plug) = inspection::wired(profile, real, period_s, link, codec);
        Self {
            profile: profile.clone(),
            protocol,
            carriage,
            side,
            arm: Some(wired),
            trouble,
            is_rate_input: real.is_rate_input(),
            plug,
        }
    }

    fn side(&self) -> MutexGuard<'_, Side> {
        self.side.lock().expect("no panic")
    }

    /// One step of a motor on the wire.
    fn motor_step(&self) -> f64 {
        match &self.protocol {
            Protocol::HapkitAscii => 1e-5,
            other => other.motor_step().max(1e-6),
        }
    }
}

/// A fresh link to the arm, started, with nothing left on it.
fn plugged(
    side: &Arc<Mutex<Side>>,
    protocol: &Protocol,
    carriage: Carriage,
    again: bool,
) -> (Box<dyn Transport>, Box<dyn Codec>) {
    let (here, there) = loopback(carriage);
    {
        let mut side = side.lock().expect("no panic");
        side.there = there;
        side.is_in_dialogue = true;
    }
    let mut link = WireEnd { here, side: side.clone() };
    let mut codec = protocol.codec(carriage);
    if again {
        codec.started_before(false);
    }
    codec.start(&mut link).unwrap_or_else(|error| panic!("{}: {error}", protocol.name()));
    side.lock().expect("no panic").is_in_dialogue = false;
    let mut buffer = [0; 256];
    while link.receive(&mut buffer).expect("plugged") > 0 {}
    (Box::new(link), codec)
}

impl Rig for WiredRig {
    fn profile(&self) -> &Profile {
        &self.profile
    }

    fn device(&mut self) -> &mut dyn Device {
        self.arm.as_mut().expect("open")
    }

    fn advance(&mut self) {
        self.side().advance();
    }

    fn felt(&self) -> Wrench {
        let named = self.side().mock.report().last_command;
        Wrench::new(
            DVec3::new(named.fx_n, named.fy_n, named.fz_n),
            DVec3::new(named.tx_nm, named.ty_nm, named.tz_nm),
        )
    }

    fn made_by_motors(&self) -> Wrench {
        let side = self.side();
        side.mock.wrench_of(&side.mock.motors())
    }

    fn is_driven(&self) -> bool {
        self.side().mock.motors() != [0.0; MAX_AXES]
    }

    fn pose(&self) -> Pose {
        self.side().mock.pose()
    }

    fn rounding(&self) -> (f64, f64) {
        let side = self.side();
        let motors = [1.0; MAX_AXES];
        let base = side.mock.wrench_of(&motors);
        (0..MAX_AXES).fold((0.0, 0.0), |(force_n, torque_nm), idx| {
            let mut stepped = motors;
            stepped[idx] += self.motor_step();
            let wrench = side.mock.wrench_of(&stepped);
            (
                force_n + (wrench.force - base.force).length(),
                torque_nm + (wrench.torque - base.torque).length(),
            )
        })
    }

    fn torques(&self, wrench: &Wrench) -> Vec<(f64, f64, f64)> {
        let real = self.profile.real.as_ref().expect("real");
        let readings = self.side().mock.readings().readings;
        let loads = inspection::motor_loads(real, &readings, wrench);
        let step = self.motor_step();
        loads
            .iter()
            .map(|load| (load.torque_nm, step / load.units_per_nm.abs(), load.weight_nm))
            .collect()
    }

    fn n_sent(&self) -> u32 {
        self.side().n_sent
    }

    fn is_rate_input(&self) -> bool {
        self.is_rate_input
    }

    fn raise_fault(&mut self) {
        let mut side = self.side();
        match self.trouble {
            InjectedFault::Cut => side.there.cut(),
            InjectedFault::Late => side.is_late = true,
            _ => side.is_cropped = true,
        }
    }

    fn clear_fault(&mut self) {
        let mut side = self.side();
        side.is_cropped = false;
        side.is_late = false;
    }

    fn fail(&mut self, fault: FaultKind, name: &str) {
        let mut side = self.side();
        let now_s = side.now_s;
        side.mock.fail(fault, name, now_s);
    }

    fn felt_fault(&self) -> Option<FaultReport> {
        self.side().mock.report().faults.pop()
    }

    fn reconnect(&mut self) -> bool {
        assert!(self.plug.take_lost(), "{}: the lost connection was not handed over", self.name());
        let (link, codec) = plugged(&self.side, &self.protocol, self.carriage, true);
        assert!(self.plug.connect(link, codec), "{}: the last one was not taken", self.name());
        true
    }

    fn close(&mut self) {
        self.side().is_in_dialogue = true;
        drop(self.arm.take());
        self.side().is_in_dialogue = false;
    }
}
