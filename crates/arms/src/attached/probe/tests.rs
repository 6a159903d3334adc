//! Trials of arms whose making is known.

use super::*;
use crate::Capabilities;
use crate::simulated::fault;
use crate::simulated::{SimArm, SimParameters};
use rt::clock::VirtualClock;
use vps::spatial::Axes;

const T: f64 = 1e-3;
const TORQUE_MAX_NM: f64 = 0.01;
const PUSH: Push =
    Push { force_n: SIGN_FORCE_N, torque_nm: 0.006, moved: [SIGN_MOVED_M, SIGN_TURNED_RAD] };
static NEVER: AtomicBool = AtomicBool::new(false);

fn trial() -> Trial<'static, VirtualClock> {
    Trial::new(VirtualClock::default(), T, &NEVER).with_torque(TORQUE_MAX_NM)
}

fn arm(fault: Option<&str>) -> SimArm {
    let mut parameters = SimParameters {
        hand: None,
        fault: fault.map(|text| fault::parse(text).expect("grammar")),
        ..SimParameters::ideal(T)
    };
    parameters.plant.mass_kg = 0.25;
    parameters.plant.damping_n_s_per_m = 1.6;
    parameters.plant.encoder_step_m = 5e-5;
    parameters.plant.delay_ticks = 2;
    SimArm::new(parameters).expect("valid")
}

#[test]
fn an_arm_is_listened_to() {
    let listen = |fault| {
        let mut answers = Answers::default();
        let ended = listen(&mut arm(fault), &mut trial(), Duration::from_secs(1), &mut answers);
        (answers, ended.err())
    };
    let (sound, ended) = listen(None);
    assert_eq!(
        (sound.ticks, sound.fresh, sound.round_trip_ticks, sound.longest_silence_ticks),
        (1000, 1000, 2, 0)
    );
    assert!(sound.homed && sound.spread_m < 5e-5 && ended.is_none());
    let (late, _) = listen(Some("slow=4ms"));
    assert!(late.fresh == 200 && late.longest_silence_ticks == 4, "{late:?}");
    assert_eq!(listen(Some("garbage@500ms")).0.corrupt, 500);
    let (until_then, ended) = listen(Some("unplug@500ms"));
    assert_eq!((until_then.fresh, ended), (500, Some(ProbeEnd::Device(DeviceError::Lost))));
}

fn signs(
    arm: &mut dyn Device,
    trial: &mut Trial<'_, VirtualClock>,
) -> ([Option<Sign>; 6], Option<ProbeEnd>) {
    let mut signs = [None; 6];
    let ended = check_signs(arm, trial, &PUSH, &mut signs);
    (signs, ended.err())
}

#[test]
fn a_motor_that_pushes_or_turns_the_wrong_way_is_found() {
    let signs = |fault| signs(&mut arm(fault), &mut trial());
    assert_eq!(signs(None), ([Some(Sign::Right); 6], None));
    assert_eq!(signs(Some("sign-flip")), ([Some(Sign::Wrong); 6], None));
    assert_eq!(signs(Some("stuck")), ([Some(Sign::Still); 6], None));
    // An arm that cannot turn is not said to.
    let mut parameters =
        SimParameters { hand: None, actuated: Axes::TRANSLATION, ..SimParameters::ideal(T) };
    parameters.plant.mass_kg = 0.25;
    let (found, _) = self::signs(&mut SimArm::new(parameters).expect("valid"), &mut trial());
    assert_eq!(found, [Some(Sign::Right), Some(Sign::Right), Some(Sign::Right), None, None, None]);
}

/// Only one rotation is wired the wrong way round, and the arm remembers the largest wrench that it
/// was commanded.
struct Miswired(SimArm, Wrench);

impl Device for Miswired {
    fn capabilities(&self) -> Capabilities {
        self.0.capabilities()
    }

    fn read(&mut self) -> Result<DeviceSample, DeviceError> {
        self.0.read()
    }

    fn write(&mut self, wrench: &Wrench) -> Result<Wrench, DeviceError> {
        self.1 = Wrench::new(
            self.1.force.max(wrench.force.abs()),
            self.1.torque.max(wrench.torque.abs()),
        );
        self.0.write(&Wrench::new(wrench.force, wrench.torque * DVec3::new(1.0, -1.0, 1.0)))
    }

    fn stop(&mut self) {
        self.0.stop();
    }
}

#[test]
fn a_rotation_of_the_wrong_sign_is_found_with_a_harmless_torque() {
    let mut arm = Miswired(arm(None), Wrench::ZERO);
    let (found, ended) = signs(&mut arm, &mut trial());
    let right = Some(Sign::Right);
    assert_eq!((found, ended), ([right, right, right, right, Some(Sign::Wrong), right], None));
    assert!(
        arm.1.force.max_element() <= SIGN_FORCE_N && arm.1.torque.max_element() <= PUSH.torque_nm
    );
    // No plan can ask for more than the trial allows.
    arm.1 = Wrench::ZERO;
    let _ = check_signs(
        &mut arm,
        &mut trial(),
        &Push { force_n: 3.0, torque_nm: 3.0, ..PUSH },
        &mut [None; 6],
    );
    assert!(
        arm.1.force.max_element() <= FORCE_MAX_N && arm.1.torque.max_element() <= TORQUE_MAX_NM,
        "{:?}",
        arm.1
    );
}

#[test]
fn torque_is_in_proportion_to_the_force_of_unverified_signs() {
    let profile = |name| crate::profile::find(name, std::path::Path::new("")).expect("shipped");
    // 0.2 N·m of 8 N, and 0.5 N may flow.
    assert!((torque_max_nm(&profile("open6-serial")) - 0.0125).abs() < 1e-12);
    assert_eq!(torque_max_nm(&profile("polhem-2022")), 0.0);
    let push = Push::of(&profile("leader-arm-6"));
    assert!((push.torque_nm - 0.015).abs() < 1e-12 && push.force_n == SIGN_FORCE_N, "{push:?}");
}

#[test]
fn what_was_found_before_the_end_is_kept() {
    // Told to end after the second axis: 2 s of listening, 2 s before force, 0.4 s for each.
    static QUIT: AtomicBool = AtomicBool::new(false);
    let mut trial = Trial::new(Says(VirtualClock::default(), 4_900_000_000, &QUIT), T, &QUIT)
        .with_torque(TORQUE_MAX_NM);
    let plan = ProbePlan { listen: Duration::from_secs(2), push: Some(PUSH), identify: true };
    let mut found = ProbeResult::default();
    let mut steps = Vec::new();
    let ended = try_out(&mut arm(None), &mut trial, &plan, &mut found, |step| steps.push(step));
    assert_eq!((ended, steps.as_slice()), (Err(ProbeEnd::Interrupted), &[ProbeStep::Signs][..]));
    assert_eq!(found.answers.fresh, 2000);
    assert_eq!(found.signs, [Some(Sign::Right), Some(Sign::Right), None, None, None, None]);
}

/// A clock that sets a flag at a given time, as an operator would.
struct Says(VirtualClock, i64, &'static AtomicBool);

impl Clock for Says {
    fn kind(&self) -> rt::clock::ClockKind {
        self.0.kind()
    }
    fn now_ns(&mut self) -> i64 {
        self.0.now_ns()
    }
    fn sleep_until(&mut self, deadline_ns: i64) {
        self.0.sleep_until(deadline_ns);
        if deadline_ns >= self.1 {
            self.2.store(true, Ordering::Relaxed);
        }
    }
}

#[test]
fn nothing_is_pushed_before_a_person_says_so() {
    static GO: AtomicBool = AtomicBool::new(false);
    static QUIT: AtomicBool = AtomicBool::new(false);
    let plan = ProbePlan { listen: Duration::from_millis(100), push: Some(PUSH), identify: false };
    let says = |at_ns, flag| {
        let mut arm = Miswired(arm(None), Wrench::ZERO);
        let mut trial = Trial::new(Says(VirtualClock::default(), at_ns, flag), T, &QUIT)
            .with_torque(TORQUE_MAX_NM)
            .asking(&GO);
        // An answer to an earlier question is none to this one.
        GO.store(true, Ordering::Relaxed);
        let ended = try_out(&mut arm, &mut trial, &plan, &mut ProbeResult::default(), |_| {}).err();
        (ended, arm.1 != Wrench::ZERO, trial.clock.now_ns())
    };
    let (ended, is_pushed, end_ns) = says(30_000_000_000, &GO);
    // Half a minute, two seconds, and six axes of 0.4 s at most.
    assert!(
        ended.is_none() && is_pushed && (32_000_000_000..35_000_000_000).contains(&end_ns),
        "{ended:?}, {end_ns} ns"
    );
    let (ended, is_pushed, _) = says(10_000_000_000, &QUIT);
    assert_eq!((ended, is_pushed), (Some(ProbeEnd::Interrupted), false));
}

/// An arm that drives itself on once force is on: a motor pushes along with the motion.
struct SelfDriven(SimArm, Wrench, bool);

impl Device for SelfDriven {
    fn capabilities(&self) -> Capabilities {
        self.0.capabilities()
    }

    fn read(&mut self) -> Result<DeviceSample, DeviceError> {
        let sample = self.0.read()?;
        self.1 = Wrench::new(sample.twist.linear * 12.0 + DVec3::Y * 0.02, DVec3::ZERO);
        Ok(sample)
    }

    fn write(&mut self, wrench: &Wrench) -> Result<Wrench, DeviceError> {
        self.0.write(&if self.2 { *wrench + self.1 } else { *wrench })?;
        Ok(*wrench)
    }

    fn set_enabled(&mut self, enabled: bool) {
        self.2 = enabled;
    }

    fn stop(&mut self) {
        self.0.stop();
    }
}

#[test]
fn a_grip_that_gets_faster_by_itself_is_let_go() {
    let mut driven = SelfDriven(arm(None), Wrench::ZERO, false);
    let (found, ended) = signs(&mut driven, &mut trial());
    let Some(ProbeEnd::Moves(mm_per_s, _)) = ended else { panic!("{ended:?}, {found:?}") };
    assert!((200..600).contains(&mm_per_s) && !driven.2, "{mm_per_s} mm/s");
    let mut driven = SelfDriven(arm(None), Wrench::ZERO, false);
    let mut made = [None; 3];
    let ended = identify(&mut driven, &mut trial(), &mut made);
    assert!(matches!(ended, Err(ProbeEnd::Moves(200..600, _))) && made == [None; 3], "{ended:?}");
}

#[test]
fn an_arm_without_its_zero_is_not_pushed() {
    let mut parameters = SimParameters { hand: None, homed: false, ..SimParameters::ideal(T) };
    parameters.plant.mass_kg = 0.25;
    let mut arm = Miswired(SimArm::new(parameters).expect("valid"), Wrench::ZERO);
    for (push, identify) in [(Some(PUSH), false), (None, true)] {
        let plan = ProbePlan { listen: Duration::from_millis(100), push, identify };
        let mut found = ProbeResult::default();
        assert_eq!(
            try_out(&mut arm, &mut trial(), &plan, &mut found, |_| {}),
            Err(ProbeEnd::NotHomed)
        );
        assert_eq!((found.signs, found.made, arm.1), ([None; 6], [None; 3], Wrench::ZERO));
    }
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn what_an_axis_is_made_of_is_found_in_spite_of_steps_and_dry_friction() {
    for (mass_kg, damping, coulomb_n, step_m, delay_ticks) in [
        (0.25, 3.75, 0.05, 4.5e-5, 1),
        (0.25, 1.6, 0.0, 5e-5, 2),
        (0.2, 1.875, 0.05, 2e-5, 1),
        (0.05, 0.5625, 0.05, 4e-5, 1),
        (0.3, 8.0, 0.1, 4.5e-5, 2),
        (0.1, 0.8, 0.1, 0.0, 0),
        (0.5, 2.0, 0.02, 1e-4, 3),
    ] {
        let mut parameters = SimParameters { hand: None, ..SimParameters::ideal(T) };
        parameters.plant.mass_kg = mass_kg;
        parameters.plant.damping_n_s_per_m = damping;
        parameters.plant.coulomb_n = coulomb_n;
        parameters.plant.encoder_step_m = step_m;
        parameters.plant.delay_ticks = delay_ticks;
        parameters.actuated = Axes::from_name("x").expect("an axis");
        let mut arm = SimArm::new(parameters).expect("valid");
        let mut made = [None; 3];
        identify(&mut arm, &mut trial(), &mut made).expect("there");
        let made = made[0].expect("moved");
        let bound = made.damping_bound_n_s_per_m;
        assert!(
            bound <= 1.02 * damping && bound >= 0.6 * damping,
            "{mass_kg} {damping} {coulomb_n}: {made:?}"
        );
        assert!(
            (made.mass_kg / mass_kg - 1.0).abs() < 0.05,
            "{mass_kg} {damping} {coulomb_n}: {made:?}"
        );
        assert!(
            (made.coulomb_n - coulomb_n).abs() < 0.02,
            "{mass_kg} {damping} {coulomb_n}: {made:?}"
        );
    }
    let mut made = [None; 3];
    identify(&mut arm(Some("stuck")), &mut trial(), &mut made).expect("there");
    assert_eq!(made, [None; 3]);
}
