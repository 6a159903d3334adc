//! Two machines in simulated time: the host's loop here, the node with its arm and hand there, and
//! a network with delay, jitter and loss between them. `docs/explanation/two-machines.md` has the
//! figures that these tests print.

use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Duration;

use arms::attached::open::{LinkNews, OpenError};
use arms::remote::command_hold::HoldTiming;
use arms::remote::figures::{LinkPhase, NodeReport};
use arms::remote::{LinkFigures, Node, NodeFigures, RemoteOptions, open};
use arms::simulated::hand::{HandMapping, HandPath};
use arms::simulated::{HandParameters, SimArm, SimParameters};
use arms::transport::{LinkQuality, NetworkEnd, SimulatedNetwork, Transport, TransportError};
use arms::{Capabilities, Device, DeviceError, Timebase};
use crossbeam::channel::Receiver;
use engine::servo::{Control, Ending, Order, RunPlan, ServoLoop, Step};
use hapticd::config::SceneConfig;
use hapticd::daemon::device_node::node_parameters;
use hapticd::daemon::prepare_with;
use hapticd::scene::BakeOptions;
use hapticd::scene::cache::Cache;
use haptics::{Drive, Faults, Parameters, RenderScene, TickOutput};
use recording::TickRecord;
use rt::clock::VirtualClock;
use rtrb::Consumer;
use vps::spatial::{DeviceSample, Wrench};

use super::rig;

const T: f64 = 1e-3;
const TIMING: HoldTiming = HoldTiming { hold_s: 10e-3, fade_s: 20e-3 };
/// The hand waits until the host has measured the link and enabled the arm, s.
const HAND_DELAY_S: f64 = 1.0;
/// The node's clock began so much earlier, s.
const CLOCKS_APART_S: f64 = 4000.0;
/// For the thread that looks for a lost node, which runs in real time.
const PATIENCE: Duration = Duration::from_secs(60);

/// The arm beside the node, and its commands with their times.
struct LoggedArm {
    arm: SimArm,
    now_s: f64,
    /// Time and wrench of each write.
    log: Vec<(f64, Wrench)>,
}

impl Device for LoggedArm {
    fn capabilities(&self) -> Capabilities {
        self.arm.capabilities()
    }

    fn read(&mut self) -> Result<DeviceSample, DeviceError> {
        self.arm.read()
    }

    fn write(&mut self, wrench_device: &Wrench) -> Result<Wrench, DeviceError> {
        self.log.push((self.now_s, *wrench_device));
        self.arm.write(wrench_device)
    }

    fn stop(&mut self) {
        self.arm.stop();
    }
}

/// The other machine, and the time of both.
struct World {
    network: SimulatedNetwork,
    node: Node,
    arm: LoggedArm,
    /// When the node's next period begins, s: its periods are not those of the host.
    next_s: f64,
    cut_at_s: Option<f64>,
}

impl World {
    fn advance_to(&mut self, now_s: f64) {
        while self.next_s <= now_s {
            if let Some(cut_s) = self.cut_at_s.filter(|cut_s| *cut_s <= self.next_s) {
                self.network.set_now(cut_s);
                self.network.cut(true);
                self.cut_at_s = None;
            }
            self.network.set_now(self.next_s);
            self.arm.now_s = self.next_s;
            self.node.step(self.next_s + CLOCKS_APART_S, &mut self.arm);
            self.next_s += T;
        }
        self.network.set_now(now_s);
    }
}

type Shared = Arc<Mutex<World>>;

fn locked(world: &Shared) -> MutexGuard<'_, World> {
    world.lock().expect("no panic")
}

/// The host's end. While the host starts, only its look for an answer lets time pass.
struct HostEnd {
    end: NetworkEnd,
    world: Shared,
    is_starting: Arc<Mutex<bool>>,
}

impl Transport for HostEnd {
    fn receive(&mut self, buffer: &mut [u8]) -> Result<usize, TransportError> {
        let n = self.end.receive(buffer)?;
        if n == 0 && *self.is_starting.lock().expect("no panic") {
            let mut world = locked(&self.world);
            let now_s = world.network.now_s();
            world.advance_to(now_s + 0.25 * T);
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

/// The arm as the host's loop sees it: each read is a tick later.
struct Remote {
    arm: arms::WiredArm,
    world: Shared,
    now_s: f64,
}

impl Device for Remote {
    fn capabilities(&self) -> Capabilities {
        self.arm.capabilities()
    }

    fn read(&mut self) -> Result<DeviceSample, DeviceError> {
        self.now_s += T;
        locked(&self.world).advance_to(self.now_s);
        self.arm.read()
    }

    fn write(&mut self, wrench_device: &Wrench) -> Result<Wrench, DeviceError> {
        self.arm.write(wrench_device)
    }

    fn set_enabled(&mut self, enabled: bool) {
        self.arm.set_enabled(enabled);
    }

    fn stop(&mut self) {
        self.arm.stop();
    }
}

struct Played {
    records: Vec<TickRecord>,
    faults: Faults,
    ending: Ending,
    /// Commands to the node's arm.
    reported: Vec<(f64, Wrench)>,
    report: NodeReport,
    phase: LinkPhase,
    link: Arc<LinkFigures>,
    /// What the host's driver says of the node's watchdog.
    watchdog_ms: Option<u32>,
    last_command_s: f64,
    /// When the host's loop began, s.
    begin_s: f64,
}

/// A scene that was baked once.
struct TwoMachines {
    config: SceneConfig,
    scene: Arc<RenderScene>,
    /// The node's `--hold-ms` and `--fade-ms`.
    timing: HoldTiming,
}

impl TwoMachines {
    fn of(config: SceneConfig) -> Self {
        Self::with(config, |_| ())
    }

    fn with(config: SceneConfig, change: impl FnOnce(&mut Parameters)) -> Self {
        let (mut prepared, _) =
            prepare_with(&config, &mut BakeOptions::from(&mut Cache::off()), |_| ())
                .expect("a scene");
        change(&mut prepared.scene.parameters);
        Self { config, scene: Arc::new(prepared.scene), timing: TIMING }
    }

    /// The simulated arm with the scene's hand, for the other machine.
    fn arm(&self) -> SimArm {
        let device = &self.config.device;
        let mapping = &self.config.parameters.mapping;
        let hand_mapping = HandMapping {
            world_from_device: mapping.world_from_device,
            scale: mapping.scale,
            start: mapping.start,
            grip_tool: self.scene.tool.center_of_mass_tool,
        };
        let path = HandPath::read(device.hand.as_deref().expect("a hand"))
            .expect("a hand file")
            .to_device(hand_mapping);
        let hand =
            HandParameters { path: Some(path.delayed(HAND_DELAY_S)), ..HandParameters::default() };
        SimArm::new(SimParameters::of(&device.profile, Some(hand), T)).expect("an arm")
    }

    fn node(&self, link: NetworkEnd) -> Node {
        Node::new(
            node_parameters(&self.config.device.profile, "arm", T, self.timing),
            Box::new(link),
        )
    }

    /// Two machines that have met, before the first tick. `phase`: where in the host's tick the
    /// node's period begins.
    fn begin(&self, quality: LinkQuality, plan: RunPlan, phase: f64, n_records: usize) -> Playing {
        let network = SimulatedNetwork::new(quality, 11);
        let (host_end, arm_end) = network.ends();
        let node = self.node(arm_end);
        let figures = node.figures();
        let arm = LoggedArm { arm: self.arm(), now_s: 0.0, log: Vec::new() };
        let world: Shared = Arc::new(Mutex::new(World {
            network: network.clone(),
            node,
            arm,
            next_s: phase * T,
            cut_at_s: None,
        }));
        let is_starting = Arc::new(Mutex::new(true));
        let options =
            RemoteOptions { name: "arm".into(), period_s: T, timebase: Timebase::Counted };
        let far = world.clone();
        let may_start = is_starting.clone();
        // The host finds the lost link again when the test says so.
        let dial = move || match *may_start.lock().expect("no panic") {
            true => {
                let end = HostEnd {
                    end: host_end.clone(),
                    world: far.clone(),
                    is_starting: may_start.clone(),
                };
                Ok(Box::new(end) as Box<dyn Transport>)
            }
            false => Err(OpenError::Link("cut".into())),
        };
        let (opened, link) =
            open(&self.config.device.profile, &options, Box::new(dial)).expect("a node");
        *is_starting.lock().expect("no panic") = false;
        let begin_s = network.now_s();
        let watchdog_ms = opened.arm.capabilities().watchdog_ms;
        let device = Remote { arm: opened.arm, world: world.clone(), now_s: begin_s };
        let (producer, records) = rtrb::RingBuffer::new(n_records);
        let control = Arc::new(Control::enabled());
        let mut servo = ServoLoop::new(
            self.scene.clone(),
            device,
            VirtualClock::default(),
            control.clone(),
            plan,
            producer,
        );
        servo.warm_up();
        Playing {
            servo,
            control,
            records,
            world,
            is_starting,
            news: opened.news,
            figures,
            link,
            watchdog_ms,
            begin_s,
        }
    }

    /// Renders for so many ticks. `cut_after_s`: loop time at which the cable is cut.
    fn play(
        &self,
        quality: LinkQuality,
        n_ticks: u64,
        phase: f64,
        cut_after_s: Option<f64>,
    ) -> Played {
        let plan = RunPlan { stop_at_tick: Some(n_ticks), ..RunPlan::default() };
        let mut playing = self.begin(quality, plan, phase, n_ticks as usize + 2000);
        locked(&playing.world).cut_at_s = cut_after_s.map(|after_s| playing.begin_s + after_s);
        while playing.servo.step() == Step::Continue {}
        let Playing { servo, mut records, world, figures, link, watchdog_ms, begin_s, .. } =
            playing;
        let report = servo.finish();
        let records = core::iter::from_fn(|| records.pop().ok()).collect();
        // The node goes on without a host.
        let mut world = locked(&world);
        let end_s = world.network.now_s() + 0.1;
        world.advance_to(end_s);
        Played {
            records,
            faults: report.faults,
            ending: report.ending,
            reported: core::mem::take(&mut world.arm.log),
            report: figures.report(),
            phase: figures.phase(),
            link,
            watchdog_ms,
            last_command_s: world.network.last_to_arm_s(),
            begin_s,
        }
    }
}

/// A run under way.
struct Playing {
    servo: ServoLoop<Remote, VirtualClock>,
    control: Arc<Control>,
    records: Consumer<TickRecord>,
    world: Shared,
    is_starting: Arc<Mutex<bool>>,
    news: Receiver<LinkNews>,
    figures: Arc<NodeFigures>,
    link: Arc<LinkFigures>,
    watchdog_ms: Option<u32>,
    begin_s: f64,
}

impl Playing {
    /// So many ticks under an order; what each gave, and the largest force that the arm was sent
    /// meanwhile, N.
    fn ticks(&mut self, n: usize, order: Order) -> (Vec<TickOutput>, f64) {
        match order {
            Order::Disable => self.control.disable(),
            _ => self.control.enable(self.control.permit()),
        }
        locked(&self.world).arm.log.clear();
        let outputs = (0..n).map(|_| {
            assert_eq!(self.servo.step(), Step::Continue);
            self.records.pop().expect("a record").output
        });
        let outputs: Vec<_> = outputs.collect();
        let world = locked(&self.world);
        (outputs, world.arm.log.iter().map(|(_, wrench)| wrench.force.length()).fold(0.0, f64::max))
    }

    fn drive(&mut self, n: usize, order: Order) -> (Drive, f64) {
        let (outputs, force_n) = self.ticks(n, order);
        (outputs.last().expect("ticks").drive, force_n)
    }

    /// Lets the host's search find the lost node. Time goes on for the node alone.
    fn meet_again(&mut self) -> LinkNews {
        let lost = self.news.recv_timeout(PATIENCE).expect("the host looks for it");
        assert_eq!(lost, LinkNews::Lost);
        *self.is_starting.lock().expect("no panic") = true;
        let news = loop {
            match self.news.recv_timeout(PATIENCE).expect("news") {
                // From before it was let.
                LinkNews::Fails(why) if why.contains("cut") => {}
                news => break news,
            }
        };
        *self.is_starting.lock().expect("no panic") = false;
        let world = locked(&self.world);
        assert!(
            world.arm.log.iter().all(|(_, wrench)| *wrench == Wrench::ZERO),
            "a greeting moves nothing"
        );
        self.servo.device().now_s = world.network.now_s();
        drop(world);
        news
    }
}

fn quality(delay_ms: f64) -> LinkQuality {
    LinkQuality { delay_s: delay_ms * 1e-3, jitter_s: 1e-3, loss: 0.01 }
}

/// How much the force at the arm goes up and down over some of its writes, N: the standard
/// deviation.
fn unrest_n(reported: &[(f64, Wrench)]) -> f64 {
    let n = reported.len() as f64;
    let mean = reported.iter().map(|(_, wrench)| wrench.force).sum::<glam::DVec3>() / n;
    (reported.iter().map(|(_, wrench)| (wrench.force - mean).length_squared()).sum::<f64>() / n)
        .sqrt()
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn a_peg_goes_into_its_hole_over_every_delay_as_stiff_as_that_delay_allows() {
    let stage = TwoMachines::of(rig::load(&rig::shipped("peg-in-hole")));
    let arm = stage.scene.parameters.arm;
    let n_ticks = ((rig::hand_end_s(&stage.config) + HAND_DELAY_S + 1.0) / T).round() as u64;
    let mut stiffness_before = f64::INFINITY;
    for delay_ms in [0.0, 2.0, 10.0, 50.0] {
        let Played { records, faults, ending, reported, report, link, .. } =
            stage.play(quality(delay_ms), n_ticks, 0.37, None);
        let name = format!("{delay_ms} ms each way");
        let at_end = &records[n_ticks as usize - 1].output;
        let ticks = at_end.delay_ticks;
        let stiffness = (arm.stiffness_lag_n_s_per_m / ((0.5 + f64::from(ticks)) * T))
            .min(stage.scene.parameters.coupling.stiffness_n_per_m);
        let largest = reported.iter().map(|(_, wrench)| wrench.force.length()).fold(0.0, f64::max);
        // The last second in the hole, and the second before.
        let stop = reported.len() - 250;
        let early = unrest_n(&reported[stop - 1000..stop - 500]);
        let late = unrest_n(&reported[stop - 500..stop]);
        let ways = link.report();
        let mm = at_end.world_from_tool.translation * 1e3;
        eprintln!(
            "{name}: round trip {ticks} ticks, at most {stiffness:.0} N/m; largest {largest:.2} N; \
                unrest {early:.4} then {late:.4} N; tip at {mm:.3} mm; {:.2} ms there, {:.2} ms \
                back, {} of {} commands lost, {} too late; gap {:.1} ms",
            ways.there_ms,
            ways.back_ms,
            report.lost_packets,
            report.commands,
            report.old_packets,
            report.longest_gap_ms,
        );
        assert_eq!(
            (faults, ending),
            (Faults::NONE, Ending::Stopped),
            "{name}: {:?}",
            faults.names().collect::<Vec<_>>()
        );
        assert_eq!(report.link_losses, 0, "{name}");
        // Both ways, the jitter of both, the period of the node, the average there, the tick of the
        // host and of the arm: between 2 and 9 more.
        let least = 2.0 * delay_ms;
        assert!((least + 2.0..least + 9.0).contains(&f64::from(ticks)), "{name}: {ticks} ticks");
        assert!(
            (delay_ms..delay_ms + 2.5).contains(&ways.there_ms)
                && (delay_ms..delay_ms + 2.5).contains(&ways.back_ms),
            "{name}"
        );
        assert!(report.lost_packets > 0 && ways.lost_packets > 0, "{name}: 1 % is lost");
        assert!((-20.2..=-19.8).contains(&mm.z), "{name}: the peg stands at {} mm", mm.z);
        assert!(largest > 0.03 && largest < 12.0, "{name}: {largest} N");
        // At rest against the floor: a loop that is not stable grows, or rings at its limits.
        assert!(late < 0.02 && late < 2.0 * early + 0.005, "{name}: {early} N, then {late} N");
        assert!(stiffness <= stiffness_before, "{name}");
        stiffness_before = stiffness;
    }
    assert!(
        stiffness_before < 0.05 * stage.scene.parameters.coupling.stiffness_n_per_m,
        "50 ms soften: {stiffness_before} N/m"
    );
}

/// The force at the arm while the hand presses the block onto the plane, 10 ms each way: how much
/// it goes up and down, N.
fn pressed_unrest_n(change: impl FnOnce(&mut Parameters)) -> f64 {
    let stage = TwoMachines::with(rig::load(&rig::shipped("block-on-plane")), change);
    let reported = stage.play(quality(10.0), 2900, 0.37, None).reported;
    let pressing =
        reported.iter().rev().skip_while(|(_, wrench)| *wrench == Wrench::ZERO).skip(100).take(300);
    unrest_n(&pressing.copied().collect::<Vec<_>>())
}

#[test]
fn without_softening_the_same_link_would_tremble() {
    let softened = pressed_unrest_n(|_| ());
    // As if the distance to the arm had not been measured.
    let stiff = pressed_unrest_n(|p| {
        p.arm.stiffness_lag_n_s_per_m = f64::INFINITY;
        p.arm.stiffness_lag_nm_s_per_rad = f64::INFINITY;
    });
    eprintln!("pressed over 10 ms each way: unrest {softened:.4} N softened, {stiff:.4} N without");
    assert!(
        softened < 0.05 && stiff > 5.0 * softened.max(0.01),
        "{softened} N softened, {stiff} N without"
    );
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn a_cut_cable_is_zero_at_the_arm_within_hold_and_fade_and_a_fault_of_the_link_at_the_host() {
    let stage = TwoMachines::of(rig::load(&rig::shipped("block-on-plane")));
    let arm_s = f64::from(stage.config.device.profile.plant.delay_ticks) * T;
    // The hand presses from 1.2 s of its path on.
    let mut least_ms = f64::INFINITY;
    let mut most_ms = 0.0_f64;
    for (delay_ms, n) in [(0.0, 20), (10.0, 10)] {
        for idx in 0..n {
            let share = f64::from(idx) / f64::from(n);
            let cut_s = 2.4 + share * 7e-3;
            let quality = LinkQuality { loss: 0.0, ..quality(delay_ms) };
            let played = stage.play(quality, 2700, share, Some(cut_s));
            let name = format!("{delay_ms} ms each way, cut at {cut_s:.4} s");
            let cut_s = played.begin_s + cut_s;
            let before =
                played.reported.iter().rev().find(|(at_s, _)| *at_s <= cut_s).expect("writes").1;
            assert!(before.force.length() > 0.1, "{name}: {} N in contact", before.force.length());
            let last_force_s = played
                .reported
                .iter()
                .rev()
                .find(|(_, wrench)| *wrench != Wrench::ZERO)
                .expect("force")
                .0;
            // The write after it was zero, and reached the motors after the arm's own delay.
            let zero_s = last_force_s + T + arm_s;
            let after_ms = (zero_s - played.last_command_s) * 1e3;
            assert!(after_ms <= 30.0 + 1e-6, "{name}: zero {after_ms} ms after the last command");
            assert!(
                (zero_s - cut_s) * 1e3 <= 30.0 + 1e-6,
                "{name}: zero {} ms after the cut",
                (zero_s - cut_s) * 1e3
            );
            (least_ms, most_ms) = (least_ms.min(after_ms), most_ms.max(after_ms));
            assert_eq!(
                (played.report.link_losses, played.phase),
                (1, LinkPhase::Tripped),
                "{name}"
            );
            assert!(
                (played.report.zero_after_ms - 29.5).abs() < 1.0,
                "{name}: it says {} ms",
                played.report.zero_after_ms
            );
            let names: Vec<_> = played.faults.names().collect();
            assert_eq!((names, played.ending), (vec!["link"], Ending::Faulted), "{name}");
            let last = played.records.last().expect("records");
            assert!(rig::is_bit_zero(last.output.command_device), "{name}");
        }
    }
    eprintln!(
        "zero at the arm {least_ms:.2} to {most_ms:.2} ms after the last command that it heard"
    );
    assert!(least_ms > 25.0, "it holds as long as it says: {least_ms} ms");
}

#[test]
fn the_host_knows_how_long_the_node_holds_its_force_whatever_that_is() {
    let mut stage = TwoMachines::of(rig::load(&rig::shipped("block-on-plane")));
    stage.timing = HoldTiming { hold_s: 4e-3, fade_s: 9e-3 };
    let played = stage.play(LinkQuality::default(), 2500, 0.37, Some(2.4));
    let link = played.link.report();
    assert_eq!((played.watchdog_ms, link.hold_ms, link.fade_ms), (Some(13), 4, 9));
    let zero_ms = played.report.zero_after_ms;
    assert!((12.0..=13.0).contains(&zero_ms), "zero {zero_ms} ms after the last command");
    assert_eq!(played.faults.names().collect::<Vec<_>>(), ["link"]);
}

/// The block pressed onto the plane, then 150 ms of a cut cable.
fn lost_in_contact(stage: &TwoMachines) -> Playing {
    let plan = RunPlan { outlives_faults: true, ..RunPlan::default() };
    let mut playing = stage.begin(LinkQuality { loss: 0.0, ..quality(2.0) }, plan, 0.37, 64);
    let (drive, force_n) = playing.drive(2400, Order::Enable);
    assert!(drive == Drive::Enabled && force_n > 0.1, "{drive:?}, {force_n} N");
    locked(&playing.world).network.cut(true);
    let (outputs, _) = playing.ticks(50, Order::Enable);
    assert!(
        outputs.iter().any(|output| output.faults.names().eq(["link"])),
        "{:?}",
        outputs.last()
    );
    let (drive, force_n) = playing.drive(100, Order::Enable);
    assert_eq!((drive, force_n, playing.figures.phase()), (Drive::Fault, 0.0, LinkPhase::Tripped));
    playing
}

#[test]
fn a_node_whose_cable_is_back_gives_no_force_before_the_next_enable() {
    let stage = TwoMachines::of(rig::load(&rig::shipped("block-on-plane")));
    let mut playing = lost_in_contact(&stage);
    // No node answers: an enable leads to the same fault.
    assert_eq!(playing.drive(50, Order::Disable).1, 0.0);
    assert_eq!(playing.drive(50, Order::Enable), (Drive::Fault, 0.0));
    locked(&playing.world).network.cut(false);
    let news = playing.meet_again();
    assert!(
        matches!(&news, LinkNews::Back { node, homing: None } if node.ends_with("zenoh:arm")),
        "{news:?}"
    );
    // The order is still *enable*, and the arm is there: it waits all the same.
    assert_eq!(playing.drive(300, Order::Enable), (Drive::Fault, 0.0));
    assert_eq!(playing.figures.phase(), LinkPhase::Disabled);
    assert_eq!(playing.drive(20, Order::Disable), (Drive::Disabled, 0.0));
    let (outputs, _) = playing.ticks(300, Order::Enable);
    assert!(rig::is_bit_zero(outputs[0].command_device), "it rises from zero");
    let last = outputs.last().expect("ticks");
    assert_eq!(
        (last.drive, last.faults, playing.figures.phase()),
        (Drive::Enabled, Faults::NONE, LinkPhase::Enabled)
    );
}

#[test]
fn a_node_that_was_started_again_is_greeted_and_gives_force_after_an_enable() {
    let mut stage = TwoMachines::of(rig::load(&rig::shipped("block-on-plane")));
    let mut playing = lost_in_contact(&stage);
    // Another process, with other times, and a hand that begins anew.
    stage.timing = HoldTiming { hold_s: 5e-3, fade_s: 10e-3 };
    {
        let mut world = locked(&playing.world);
        world.node = stage.node(world.network.ends().1);
        world.arm.arm = stage.arm();
        playing.figures = world.node.figures();
        world.network.cut(false);
    }
    assert!(matches!(playing.meet_again(), LinkNews::Back { .. }));
    assert_eq!(playing.drive(100, Order::Enable), (Drive::Fault, 0.0));
    let link = playing.link.report();
    assert_eq!((playing.figures.phase(), link.hold_ms, link.fade_ms), (LinkPhase::Disabled, 5, 10));
    assert_eq!(playing.drive(20, Order::Disable), (Drive::Disabled, 0.0));
    let (drive, force_n) = playing.drive(2200, Order::Enable);
    assert!(drive == Drive::Enabled && force_n > 0.1, "pressed again: {drive:?}, {force_n} N");
    assert_eq!(playing.servo.device().capabilities().watchdog_ms, Some(15));
}

#[test]
fn another_arm_under_the_name_of_a_lost_one_is_refused() {
    let stage = TwoMachines::of(rig::load(&rig::shipped("block-on-plane")));
    let mut playing = lost_in_contact(&stage);
    let mut config = rig::load(&rig::shipped("block-on-plane"));
    config.device.profile.limits.force_n *= 0.5;
    {
        let mut world = locked(&playing.world);
        let parameters = node_parameters(&config.device.profile, "arm", T, TIMING);
        world.node = Node::new(parameters, Box::new(world.network.ends().1));
        world.network.cut(false);
    }
    let news = playing.meet_again();
    assert!(
        matches!(&news, LinkNews::Fails(why) if why.contains("declares another rate, force")),
        "{news:?}"
    );
    assert_eq!(playing.drive(50, Order::Disable).1, 0.0);
    assert_eq!(playing.drive(50, Order::Enable), (Drive::Fault, 0.0));
}
