//! The hand of a simulated arm, moved by clients: it goes through the same loop as any other hand.

use std::sync::Arc;
use std::sync::mpsc::channel;

use engine::servo::{Control, RunPlan, ServoLoop, Step};
use glam::{DQuat, DVec3};
use hapticd::config::{LoadOptions, SceneConfig};
use hapticd::daemon::prepare;
use hapticd::daemon::session::{ControlError, HandOrder, SessionError, SessionHandle};
use hapticd::scene::{BakeOptions, build_with, cache::Cache};
use haptics::{Drive, Faults, TickOutput};
use recording::TickRecord;
use rt::clock::{ClockKind, VirtualClock};
use rtrb::Consumer;
use vps::spatial::Pose;

use super::rig;

type Loop = ServoLoop<Box<dyn arms::Device>, VirtualClock>;

/// A run of a scene in this process, tick by tick, with the session that clients use.
struct Run {
    session: SessionHandle,
    servo: Loop,
    control: Arc<Control>,
    records: Consumer<TickRecord>,
    config: SceneConfig,
    last: TickOutput,
    /// Since the last [`Run::go`] began.
    deepest_m: f64,
    contact_ticks: u64,
    force_n: f64,
}

impl Run {
    fn begin(scene: &str) -> Self {
        let config = rig::load(&rig::shipped(scene));
        let (prepared, reports) = prepare(&config, |_| ()).expect("a scene");
        let session =
            SessionHandle::new(config.clone(), LoadOptions::default(), ClockKind::Virtual, None);
        let baker = |config: &SceneConfig| {
            build_with(config, &mut BakeOptions::from(&mut Cache::off()), |_| ())
        };
        session.begin_baking(Box::new(baker), Vec::new()).expect("a thread");
        let scene = Arc::new(prepared.scene);
        let queue = session.begin(&scene, reports, true);
        let (producer, records) = rtrb::RingBuffer::new(4);
        let control = Arc::new(Control::enabled());
        let servo = ServoLoop::new(
            scene,
            prepared.device,
            VirtualClock::default(),
            control.clone(),
            RunPlan::default(),
            producer,
        );
        let servo = servo.with_commands(queue);
        Self {
            session,
            servo,
            control,
            records,
            config,
            last: TickOutput::default(),
            deepest_m: 0.0,
            contact_ticks: 0,
            force_n: 0.0,
        }
    }

    /// So many ticks; `each` comes before every one of them.
    fn go(&mut self, n_ticks: usize, mut each: impl FnMut(&SessionHandle, usize)) {
        (self.deepest_m, self.contact_ticks, self.force_n) = (0.0, 0, 0.0);
        for n in 0..n_ticks {
            each(&self.session, n);
            assert_eq!(self.servo.step(), Step::Continue);
            while let Ok(record) = self.records.pop() {
                self.last = record.output;
            }
            assert_eq!(self.last.faults, Faults::NONE, "tick {n}");
            self.deepest_m = self.deepest_m.max(self.last.max_depth_m);
            self.contact_ticks += u64::from(self.last.contacts > 0);
            self.force_n = self.force_n.max(self.last.command_device.force.length());
        }
    }

    fn tool_mm(&self) -> DVec3 {
        self.last.world_from_tool.translation * 1e3
    }

    fn start(&self) -> Pose {
        self.config.parameters.mapping.start
    }

    fn enable(&self) {
        self.control.enable(self.control.permit());
    }

    /// Until a scene that was asked for is rendered and has force.
    fn reach(&mut self, scene_idx: u32) {
        for _ in 0..100_000 {
            self.go(1, |_, _| ());
            if self.session.view().scene_idx == scene_idx && self.last.drive == Drive::Enabled {
                return;
            }
        }
        panic!("scene {scene_idx} is not rendered");
    }
}

/// The peg stands on the floor of its hole.
fn assert_at_the_bottom(run: &Run) {
    let tool_mm = run.tool_mm();
    assert!((-20.2..=-19.9).contains(&tool_mm.z), "{tool_mm}");
}

#[test]
fn the_peg_finds_its_hole_again_after_disable_and_enable_and_after_a_restart() {
    let mut run = Run::begin("peg-in-hole");
    run.go(5000, |_, _| ());
    assert_at_the_bottom(&run);
    // The tool begins at its start again, and the hand with it, wherever the grip is.
    run.control.disable();
    run.go(300, |_, _| ());
    assert_eq!(run.last.drive, Drive::Disabled);
    run.enable();
    run.go(200, |_, _| ());
    assert!(
        (run.last.world_from_tool.translation - run.start().translation).length() < 2e-3,
        "{}",
        run.tool_mm()
    );
    run.go(6000, |_, _| ());
    assert_at_the_bottom(&run);
    // Along the path out of the hole to its beginning, and in again.
    run.session.hand(HandOrder::Restart).expect("a simulated arm");
    let mut highest_mm = f64::NEG_INFINITY;
    for _ in 0..100 {
        run.go(100, |_, _| ());
        highest_mm = highest_mm.max(run.tool_mm().z);
    }
    assert!(highest_mm > 14.0, "{highest_mm}");
    assert_at_the_bottom(&run);
}

#[test]
fn a_scene_that_is_reset_begins_anew() {
    let mut run = Run::begin("peg-in-hole");
    run.session.set("limit_force_n", 6.0).expect("within its range");
    run.session.set("contact_stiffness_n_per_m", 15_000.0).expect("within its range");
    run.go(5000, |_, _| ());
    assert_at_the_bottom(&run);
    let (sender, heard) = channel();
    run.session.reset(Box::new(move |result| sender.send(result).expect("heard")));
    heard.recv().expect("answered").expect("reset");
    run.reach(1);
    assert!(
        (run.last.world_from_tool.translation - run.start().translation).length() < 2e-3,
        "{}",
        run.tool_mm()
    );
    let value = |name: &str| {
        run.session
            .view()
            .settings
            .iter()
            .find(|setting| setting.parameter.name() == name)
            .expect(name)
            .value
    };
    assert_eq!(
        (value("limit_force_n"), value("contact_stiffness_n_per_m")),
        (6.0, 20_000.0),
        "a limit that was lowered stays"
    );
    run.go(5500, |_, _| ());
    assert_at_the_bottom(&run);
}

#[test]
fn no_client_drags_the_peg_through_the_block_at_any_speed() {
    let mut run = Run::begin("peg-in-hole");
    let limit_n = run.config.parameters.limits.force_n;
    let start = run.start();
    let at = |x_mm: f64, y_mm: f64, z_mm: f64| {
        HandOrder::MoveTo(Pose::new(start.rotation, DVec3::new(x_mm, y_mm, z_mm) * 1e-3))
    };
    let order = |session: &SessionHandle, order| _ = session.hand(order).expect("a simulated arm");
    // Straight down beside the hole, at once: it stops at the top face.
    run.go(3000, |session, n| {
        if n == 0 {
            order(session, at(12.0, -8.0, -40.0))
        }
    });
    assert!(
        run.tool_mm().z > -0.5 && run.contact_ticks > 1000 && run.force_n > 1.0,
        "{} {}",
        run.tool_mm(),
        run.force_n
    );
    assert!(run.deepest_m < 0.5e-3 && run.force_n <= limit_n * (1.0 + 1e-9), "{} m", run.deepest_m);
    // A cursor that jumps from one end of the screen to the other.
    run.go(4000, |session, n| {
        if n % 7 == 0 {
            let side = if n % 14 == 0 { 1.0 } else { -1.0 };
            order(session, at(300.0 * side, -300.0 * side, -500.0));
        }
    });
    assert!(run.tool_mm().z > -0.5 && run.deepest_m < 1e-3, "{} {}", run.tool_mm(), run.deepest_m);
    // Sideways out of the hole, through its wall.
    run.go(2500, |session, n| {
        if n == 0 {
            order(session, at(0.0, 0.0, 5.0))
        }
    });
    run.go(2500, |session, n| {
        if n == 0 {
            order(session, at(0.0, 0.0, -15.0))
        }
    });
    assert!((run.tool_mm() - DVec3::new(0.0, 0.0, -15.0)).length() < 0.5, "{}", run.tool_mm());
    run.go(3000, |session, n| {
        if n == 0 {
            order(session, at(80.0, 0.0, -15.0))
        }
    });
    assert!(run.tool_mm().x < 0.6 && run.deepest_m < 1e-3, "{} {}", run.tool_mm(), run.deepest_m);
    // It stays where it was ordered to be, also when no client says anything any more.
    run.go(2000, |session, n| {
        if n == 0 {
            order(session, at(0.0, 0.0, 30.0))
        }
    });
    let there_mm = run.tool_mm();
    run.go(1000, |_, _| ());
    assert!(
        (run.tool_mm() - there_mm).length() < 0.1 && (there_mm.z - 30.0).abs() < 0.2,
        "{there_mm}"
    );
    let turned =
        HandOrder::MoveTo(Pose::new(DQuat::from_rotation_x(0.5), DVec3::new(0.0, 0.0, 0.03)));
    run.go(1500, |session, n| {
        if n == 0 {
            order(session, turned)
        }
    });
    assert!(
        (DQuat::IDENTITY.angle_between(run.last.world_from_tool.rotation) - 0.5).abs() < 0.01,
        "{:?}",
        run.last.world_from_tool
    );
}

#[test]
fn each_scene_brings_its_own_hand() {
    let mut run = Run::begin("block-on-plane");
    run.go(500, |_, _| ());
    for (n, name) in ["lift-with-block", "block-on-plane"].into_iter().enumerate() {
        let (sender, heard) = channel();
        run.session
            .switch(name.to_owned(), Box::new(move |result| sender.send(result).expect("heard")));
        heard.recv().expect("answered").expect("a scene");
        run.reach(n as u32 + 1);
        run.go(4000, |_, _| ());
        assert!(run.contact_ticks > 500, "{name}: {} ticks in contact", run.contact_ticks);
    }
}

#[test]
fn only_the_hand_of_a_simulated_arm_is_moved_and_only_to_poses() {
    let run = Run::begin("block-on-plane");
    for wrong in [DVec3::new(f64::NAN, 0.0, 0.0), DVec3::new(2e3, 0.0, 0.0)] {
        let refused = run.session.hand(HandOrder::MoveTo(Pose::from_translation(wrong)));
        assert!(
            matches!(refused, Err(SessionError::Control(ControlError::Pose { .. }))),
            "{wrong}: {refused:?}"
        );
    }
    let real =
        SessionHandle::new(run.config.clone(), LoadOptions::default(), ClockKind::Virtual, None);
    let (prepared, _) = prepare(&run.config, |_| ()).expect("a scene");
    let _queue = real.begin(&Arc::new(prepared.scene), Vec::new(), false);
    let refused = real.hand(HandOrder::Restart).expect_err("a person holds it").to_string();
    assert_eq!(refused, "only the hand of a simulated arm can be moved: a person holds this one");
    assert!(!real.view().has_hand);
}
