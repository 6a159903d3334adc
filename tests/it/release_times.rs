//! How long an arm pushes on after something went wrong, for every arm on a wire: the loop with its
//! real tick against the mock arm, a period per tick.

use std::sync::Arc;

use glam::DVec3;
use rtrb::RingBuffer;

use arms::mock::FaultReport;
use arms::simulated::fault::FaultKind;
use arms_testing::rig::{InjectedFault, Make, every_arm};
use arms_testing::{HELD_M, TimedRig};
use engine::servo::{Control, RunPlan, ServoLoop};
use haptics::testing::empty_scene;
use haptics::{self, Drive, RenderScene, State, TickInput, TickOutput};
use vps::spatial::{Axes, Wrench};

/// More than what friction holds, less than what an arm with unverified signs makes.
const PUSH: Wrench = Wrench { force: DVec3::new(0.2, 0.3, -0.2), torque: DVec3::ZERO };

/// A tick whose drive pushes for as long as it is enabled, whatever is ramped down before a fault:
/// the longest that the rules allow.
fn pushing(scene: &RenderScene, state: &mut State, input: &TickInput) -> TickOutput {
    let output = haptics::tick(scene, state, input);
    let pushes = output.drive == Drive::Enabled && output.faults.is_empty();
    TickOutput { command_device: if pushes { PUSH } else { output.command_device }, ..output }
}

/// What the arm felt of a fault while it pushed.
fn felt(make: &Make, fault: FaultKind, name: &str) -> FaultReport {
    let arm = TimedRig::of(make(Some(HELD_M), InjectedFault::None));
    let control = Arc::new(Control::enabled());
    let plan = RunPlan { outlives_faults: true, ..RunPlan::default() };
    let (records, _drained) = RingBuffer::new(1 << 16);
    let mut servo = ServoLoop::new(empty_scene(), arm.clone(), arm.clone(), control, plan, records)
        .with_tick(pushing);
    servo.warm_up();
    for _ in 0..600 {
        servo.step();
    }
    arm.rig().fail(fault, name);
    for _ in 0..300 {
        servo.step();
    }
    arm.rig().felt_fault().expect("it began")
}

/// What goes wrong, in the order of [`WITHIN`].
const FAULTS: [(&str, FaultKind); 6] = [
    ("nan", FaultKind::Nan),
    ("jump", FaultKind::Jump),
    ("unhome", FaultKind::Unhome),
    ("stall", FaultKind::Stall),
    ("garbage", FaultKind::Garbage),
    ("truncate", FaultKind::Truncate),
];

/// Ticks from the fault to the first period without force, at most, by protocol; `None`: the wire
/// cannot say it. On whole numbers a number that is none reads 0, which is a jump. A link adds what
/// is on its way: a reply, and a frame. `docs/reference/safety.md` repeats this table.
const WITHIN: [(&str, [Option<u64>; 6]); 13] = [
    ("dynamixel2", [Some(2), Some(2), None, Some(21), Some(21), Some(21)]),
    ("falcon-nibble16", [None, Some(2), Some(2), Some(21), Some(21), Some(21)]),
    // Without frame marks: what is not answered in 5 ms is asked again with a zero.
    ("force-dimension", [Some(2), Some(2), Some(2), Some(21), Some(21), Some(21)]),
    ("haply-service", [Some(2), Some(2), Some(2), Some(21), Some(21), Some(21)]),
    ("virtuose", [Some(2), Some(2), Some(2), Some(21), Some(21), Some(21)]),
    ("open-haptics", [Some(2), Some(2), Some(2), Some(21), Some(21), Some(21)]),
    ("hapi-f32", [Some(2), Some(2), None, Some(6), Some(21), Some(6)]),
    ("hapkit-ascii", [Some(2), None, None, Some(21), Some(21), Some(21)]),
    ("haptikfabriken-brackets", [Some(2), Some(2), None, Some(21), Some(21), Some(21)]),
    // It is woken after 10 ms, with a zero.
    ("haptikfabriken-hid14", [Some(2), Some(2), None, Some(11), Some(21), Some(12)]),
    ("open6", [Some(2), Some(2), Some(2), Some(21), Some(21), Some(21)]),
    ("polhem-ascii64", [Some(2), Some(2), None, Some(21), Some(21), Some(21)]),
    ("woodenhaptics-hid8", [Some(2), Some(2), None, Some(21), Some(21), Some(21)]),
];
/// Arms whose grip cannot be where the jump would put it, so that there is none.
const TOO_FAR: [&str; 3] = ["haply-2diy", "haply-2diy-first", "novint-falcon"];

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn every_arm_lets_go_within_the_time_of_its_protocol() {
    for make in every_arm() {
        let profile = make(None, InjectedFault::None).profile().clone();
        let Some(real) = profile.real.as_ref().filter(|_| profile.actuated != Axes::NONE) else {
            continue;
        };
        let name = &profile.name;
        let protocol = real.protocol.name();
        let (_, within) = WITHIN
            .iter()
            .find(|(known, _)| *known == protocol)
            .unwrap_or_else(|| panic!("{name}: no row for {protocol}"));
        for ((what, fault), within) in FAULTS.into_iter().zip(within) {
            if what == "jump" && TOO_FAR.contains(&name.as_str()) {
                continue;
            }
            let felt = felt(&*make, fault, what);
            assert!(felt.force_before_n > 0.1, "{name}, {what}: {felt:?}");
            assert_eq!(
                felt.zero_after_ticks.is_some(),
                within.is_some(),
                "{name}, {what}: {felt:?}"
            );
            assert!(
                felt.zero_after_ticks <= *within,
                "{name}, {what}: within {within:?}, {felt:?}"
            );
            assert_eq!(felt.force_again_after_ticks, None, "{name}, {what}: {felt:?}");
        }
    }
}
