//! The safety table, row by row: samples in, drive and wrench out, ticks counted.
//! `docs/reference/safety.md` names these tests.

use super::*;
use crate::testing::spring_scene;
use crate::{ArmParameters, FreeSpace};
use vps::spatial::SampleStatus;

/// K of the spring between the arm and a tool that does not move.
const K: f64 = 1000.0;
/// Where most tests hold the arm, m, and what it then feels, N.
const X_M: f64 = 4.9e-3;
const PULL_N: f64 = 4.5;
const RAMP_TICKS: usize = 100;
const SLEW_N: f64 = 1.0;

/// An arm on a spring to a tool that nothing moves, and a deadman button 2 where `change` asks for
/// it.
struct Rig {
    scene: RenderScene,
    state: State,
    sample: DeviceSample,
    request: DriveRequest,
}

impl Rig {
    fn new(change: impl FnOnce(&mut Parameters)) -> Self {
        let mut scene = spring_scene(K);
        change(&mut scene.parameters);
        let state = State::new(&scene);
        let sample = DeviceSample { status: SampleStatus::Fresh, ..DeviceSample::default() };
        Self { scene, state, sample, request: DriveRequest::Enable }
    }

    fn with_deadman() -> Self {
        Self::new(|p| p.safety.deadman = Some(2))
    }

    fn input(&self) -> TickInput {
        TickInput { sample: self.sample, request: self.request, ..TickInput::default() }
    }

    fn tick(&mut self) -> TickOutput {
        self.sample.sequence += u64::from(self.sample.status == SampleStatus::Fresh);
        let input = self.input();
        let output = tick(&self.scene, &mut self.state, &input);
        assert!(output.command_device.is_finite());
        // Only a drive with force commands any, or is damped.
        assert!(output.drive.renders() || !output.passivity_active, "{output:?}");
        assert!(output.drive.has_force() || is_zero(&output), "{output:?}");
        output
    }

    /// A tick with another order, which stays.
    fn order(&mut self, request: DriveRequest) -> TickOutput {
        self.request = request;
        self.tick()
    }

    fn ticks(&mut self, n_ticks: usize) -> TickOutput {
        let mut output = TickOutput::default();
        for _ in 0..n_ticks {
            output = self.tick();
        }
        output
    }

    /// The tick, counted from 1, in which `until` holds for the first time.
    fn tick_until(&mut self, most: usize, until: impl Fn(&TickOutput) -> bool) -> usize {
        (1..=most).find(|_| until(&self.tick())).expect("in time")
    }

    /// Enabled, and the arm at [`X_M`], pulled back with [`PULL_N`].
    fn pulling(mut self) -> Self {
        assert_eq!(self.ticks(RAMP_TICKS + 3).drive, Drive::Enabled);
        self.sample.pose.translation.x = X_M;
        let output = self.ticks(20);
        let force = output.command_device.force;
        assert!((force.x + PULL_N).abs() < 0.5 && output.off_cause == OffCause::None, "{force}");
        self
    }

    fn move_by(&mut self, way_m: f64, twist_m_per_s: f64) -> TickOutput {
        self.sample.pose.translation.x += way_m;
        self.sample.twist.linear.x = twist_m_per_s;
        self.tick()
    }

    /// The ramp of a stop: from the first tick on lower and lower, straight to zero, in so many
    /// ticks.
    fn assert_ramp_to_zero(&mut self, start_n: f64) -> TickOutput {
        for n in 1..=RAMP_TICKS {
            let output = self.tick();
            let expected_n = start_n * (1.0 - n as f64 / RAMP_TICKS as f64);
            let force_n = output.command_device.force.length();
            assert!(
                (force_n - expected_n).abs() < 0.02,
                "tick {n}: {force_n} N instead of {expected_n} N"
            );
            if n == RAMP_TICKS {
                assert!(is_zero(&output));
                return output;
            }
        }
        unreachable!("a ramp of no ticks")
    }

    fn force_n(&self) -> f64 {
        self.state.limiter.last.force.length()
    }
}

fn is_zero(output: &TickOutput) -> bool {
    output.command_device == Wrench::ZERO
}

#[track_caller]
fn assert_drive(output: &TickOutput, drive: Drive, faults: Faults, cause: OffCause) {
    assert_eq!((output.drive, output.faults, output.off_cause), (drive, faults, cause));
}

#[track_caller]
fn assert_fault_at_once(output: &TickOutput, faults: Faults, cause: OffCause) {
    assert_drive(output, Drive::Fault, faults, cause);
    assert!(is_zero(output));
}

#[test]
fn deadman_no_force_until_it_is_held_and_a_ramp_down_when_it_is_let_go() {
    let mut rig = Rig::with_deadman();
    let waiting = rig.ticks(50);
    assert_eq!((waiting.drive, waiting.off_cause), (Drive::Disabled, OffCause::Deadman));
    rig.sample.buttons = 0b011;
    assert_eq!(rig.tick().drive, Drive::Disabled);
    rig.sample.buttons = 0b100;
    assert_eq!(rig.tick().drive, Drive::Enabling);
    let mut rig = rig.pulling();
    let held_n = rig.force_n();

    rig.sample.buttons = 0;
    let off = rig.assert_ramp_to_zero(held_n);
    assert_drive(&off, Drive::Disabled, Faults::NONE, OffCause::Deadman);

    // Wherever the arm goes meanwhile: held again it starts from zero there, and the tool stands
    // where it stood.
    let stood = off.world_from_tool;
    for _ in 0..20 {
        rig.move_by(1e-3, 0.0);
    }
    rig.sample.buttons = 0b100;
    let again = rig.tick();
    assert!(again.drive == Drive::Enabling && is_zero(&again) && again.off_cause == OffCause::None);
    assert!((again.world_from_tool.translation - stood.translation).length() < 1e-9);
    assert!(rig.ticks(RAMP_TICKS).command_device.force.length() < 1e-6);
}

#[test]
fn a_rise_of_ten_seconds_does_not_delay_a_fall() {
    let mut rig = Rig::new(|p| {
        p.safety.deadman = Some(2);
        p.limits.ramp_s = 10.0;
    });
    rig.sample.buttons = 1 << 2;
    assert_eq!(rig.ticks(9_900).drive, Drive::Enabling);
    assert_eq!(rig.ticks(103).drive, Drive::Enabled);
    rig.sample.pose.translation.x = X_M;
    rig.ticks(20);
    let held_n = rig.force_n();
    assert!((held_n - PULL_N).abs() < 0.5, "{held_n}");
    rig.sample.buttons = 0;
    assert_eq!(rig.assert_ramp_to_zero(held_n).drive, Drive::Disabled);
}

#[test]
fn a_stop_of_a_drive_without_force_becomes_the_cause_of_there_being_none() {
    let mut rig = Rig::with_deadman();
    assert_eq!(rig.ticks(5).off_cause, OffCause::Deadman);
    let stopped = rig.order(DriveRequest::Stop);
    assert_eq!((stopped.drive, stopped.off_cause), (Drive::Disabled, OffCause::Software));
}

#[test]
fn deadman_let_go_during_the_ramp_up_ends_it_and_a_press_during_the_ramp_down_waits_for_zero() {
    let mut rig = Rig::with_deadman();
    rig.sample.buttons = 0b100;
    assert_eq!(rig.ticks(30).drive, Drive::Enabling);
    rig.sample.buttons = 0;
    assert_eq!(rig.tick().drive, Drive::Stopping);
    rig.sample.buttons = 0b100;
    assert_eq!(rig.tick_until(30, |output| output.drive == Drive::Disabled), 29);
    assert_eq!(rig.tick().drive, Drive::Enabling);
}

#[test]
fn deadman_let_go_and_pressed_acknowledges_a_fault_whose_cause_is_gone() {
    let mut rig = Rig::with_deadman();
    rig.sample.buttons = 0b100;
    let mut rig = rig.pulling();
    rig.sample.device_error = 7;
    assert_fault_at_once(&rig.tick(), Faults::DEVICE_ERROR, OffCause::Protocol);
    // Held all the time: neither the end of the cause nor a new order is an act of the operator.
    rig.sample.device_error = 0;
    assert_eq!(rig.ticks(100).drive, Drive::Fault);
    assert_eq!(rig.order(DriveRequest::Disable).faults, Faults::NONE);
    rig.request = DriveRequest::Enable;
    let waiting = rig.ticks(100);
    assert_eq!((waiting.drive, waiting.off_cause), (Drive::Disabled, OffCause::Deadman));
    rig.sample.buttons = 0;
    rig.tick();
    rig.sample.buttons = 0b100;
    assert_eq!(rig.tick().drive, Drive::Enabling);

    // Let go and pressed while the cause is still there: nothing. Afterwards: the same tick.
    rig.sample.device_error = 7;
    assert_eq!(rig.tick().drive, Drive::Fault);
    rig.sample.buttons = 0;
    rig.tick();
    rig.sample.buttons = 0b100;
    assert_eq!(rig.ticks(10).drive, Drive::Fault);
    rig.sample.device_error = 0;
    let again = rig.tick();
    assert_drive(&again, Drive::Enabling, Faults::NONE, OffCause::None);
}

#[test]
fn without_a_deadman_a_fault_takes_a_disable_then_an_enable() {
    let mut rig = Rig::new(|_| ()).pulling();
    rig.sample.device_error = 1;
    rig.tick();
    rig.sample.device_error = 0;
    for request in [DriveRequest::Enable, DriveRequest::Stop, DriveRequest::Enable] {
        rig.request = request;
        assert_eq!(rig.ticks(20).drive, Drive::Fault);
    }
    let off = rig.order(DriveRequest::Disable);
    assert_eq!(
        (off.drive, off.faults, off.off_cause),
        (Drive::Disabled, Faults::NONE, OffCause::Software)
    );
    assert_eq!(rig.order(DriveRequest::Enable).drive, Drive::Enabling);
}

#[test]
fn homing_no_force_before_it_and_a_fault_when_it_is_lost() {
    let mut rig = Rig::new(|_| ());
    rig.sample.homed = false;
    // Before homing the values may be anything.
    rig.sample.pose.translation.x = f64::NAN;
    let waiting = rig.ticks(50);
    assert_drive(&waiting, Drive::Disabled, Faults::NONE, OffCause::NotHomed);
    rig.sample.pose.translation.x = 0.0;
    rig.sample.homed = true;
    let homed = rig.tick();
    assert!(homed.drive == Drive::Enabling && is_zero(&homed));
    let mut rig = rig.pulling();
    rig.sample.homed = false;
    assert_fault_at_once(&rig.tick(), Faults::NOT_HOMED, OffCause::NotHomed);
}

#[test]
fn engage_the_ramp_waits_for_four_ticks_of_small_force_and_as_long_as_it_takes() {
    let engaging = |p: &mut Parameters| (p.safety.engage_share, p.safety.engage_ticks) = (0.1, 3);
    let mut rig = Rig::new(engaging);
    assert_eq!(rig.tick_until(200, |output| output.drive == Drive::Enabled), RAMP_TICKS + 3);

    let mut rig = Rig::new(engaging);
    rig.ticks(2);
    rig.sample.pose.translation.x = X_M;
    let waiting = rig.ticks(5000);
    assert!(is_zero(&waiting) && waiting.drive == Drive::Enabling && waiting.drive.is_busy());
    rig.sample.pose.translation.x = 0.5e-3;
    assert!(is_zero(&rig.ticks(3)));
    let output = rig.tick();
    assert!((output.command_device.force.x + 0.005).abs() < 5e-4, "{:?}", output.command_device);
    assert_eq!(rig.tick_until(200, |output| output.drive == Drive::Enabled), RAMP_TICKS - 1);

    // Waiting is no trap: a stop ends it.
    let mut rig = Rig::new(engaging);
    rig.ticks(2);
    rig.sample.pose.translation.x = X_M;
    rig.ticks(50);
    assert_eq!(rig.order(DriveRequest::Stop).drive, Drive::Disabled);
}

#[test]
fn clay_is_felt_from_when_the_force_may_rise_until_it_is_gone() {
    let mut rig = Rig::new(|p| (p.safety.engage_share, p.safety.engage_ticks) = (0.1, 3));
    assert_eq!(rig.ticks(3).drive, Drive::Enabling);
    assert!(!rig.state.feels_clay());
    rig.tick();
    assert!(rig.state.feels_clay());
    assert_eq!(rig.order(DriveRequest::Stop).drive, Drive::Disabled);
    assert!(!rig.state.feels_clay());
}

#[test]
fn engage_damps_while_the_force_rises_and_leaves_free_space_free() {
    let mut rig = Rig::new(|_| ());
    rig.tick();
    rig.sample.twist.linear.x = 0.1;
    let first = rig.move_by(1e-4, 0.1);
    // 20 N·s/m · 0.1 m/s but for the share that the spring already has, within one step of the slew
    // limit.
    assert!((first.command_device.force.x + SLEW_N).abs() < 1e-9, "{:?}", first.command_device);
    let second = rig.tick();
    assert!(
        (second.command_device.force.x + 2.0 * 0.97).abs() < 0.01,
        "{:?}",
        second.command_device
    );
    let mut rig = Rig::new(|p| p.coupling.free_space = FreeSpace::Zero);
    rig.sample.twist.linear.x = 0.1;
    assert!(is_zero(&rig.ticks(10)));
}

#[test]
fn stale_ramps_down_after_three_ticks_faults_after_twenty_and_ramps_up_again_before() {
    let mut rig = Rig::new(|_| ()).pulling();
    let held_n = rig.force_n();
    rig.sample.status = SampleStatus::Stale;
    rig.ticks(3);
    assert!((rig.force_n() - held_n).abs() < 0.01);
    for n in 1..=10 {
        let output = rig.tick();
        assert!((rig.force_n() - held_n * (1.0 - 0.01 * f64::from(n))).abs() < 0.02);
        assert_eq!((output.drive, output.off_cause), (Drive::Enabled, OffCause::Stale));
    }
    rig.sample.status = SampleStatus::Fresh;
    for n in 1..=10 {
        let output = rig.tick();
        assert!((rig.force_n() - held_n * (0.9 + 0.01 * f64::from(n))).abs() < 0.02);
        assert_eq!(output.off_cause, OffCause::None);
    }
    rig.sample.status = SampleStatus::Stale;
    assert_eq!(rig.ticks(20).drive, Drive::Enabled);
    assert_fault_at_once(&rig.tick(), Faults::STALE, OffCause::Stale);
}

#[test]
fn speed_brakes_with_a_damper_alone_for_a_tenth_of_a_second_then_faults() {
    let mut rig = Rig::new(|_| ()).pulling();
    let first = rig.move_by(1.2e-3, 1.2);
    assert_drive(&first, Drive::Braking, Faults::NONE, OffCause::Velocity);
    assert_eq!(first.drive.crtk_name(), "PAUSED");
    // The spring of 4.5 N is gone; the damper has begun to rise.
    assert!((first.command_device.force.x + SLEW_N).abs() < 1e-9, "{:?}", first.command_device);
    for n in 2..=100 {
        let output = rig.move_by(0.8e-3, 0.8);
        assert_eq!((output.drive, output.faults), (Drive::Braking, Faults::NONE), "tick {n}");
        if n > 10 {
            // min(10, 20) N·s/m, whatever the spring's stretch is.
            assert!(
                (output.command_device.force.x + 8.0).abs() < 1e-9,
                "{:?}",
                output.command_device
            );
        }
    }
    assert_fault_at_once(&rig.move_by(0.8e-3, 0.8), Faults::SPEED, OffCause::Velocity);
}

#[test]
fn speed_ends_braking_when_the_arm_is_slow_and_at_once_with_any_other_fault() {
    let mut rig = Rig::new(|_| ()).pulling();
    rig.move_by(1.2e-3, 1.2);
    assert_eq!(rig.move_by(0.5e-3, 0.5).drive, Drive::Braking);
    assert_fault_at_once(&rig.move_by(0.1e-3, 0.1), Faults::SPEED, OffCause::Velocity);

    let mut rig = Rig::new(|_| ()).pulling();
    rig.move_by(1.2e-3, 1.2);
    rig.sample.status = SampleStatus::Lost;
    assert_fault_at_once(&rig.tick(), Faults::SPEED | Faults::DEVICE_LOST, OffCause::Disconnected);

    // An arm that takes no damping, or a scene without braking: at once.
    for change in [
        |p: &mut Parameters| p.arm = ArmParameters::default(),
        |p: &mut Parameters| p.safety.brake_s = 0.0,
    ] {
        let mut rig = Rig::new(change).pulling();
        assert_fault_at_once(&rig.move_by(1.2e-3, 1.2), Faults::SPEED, OffCause::Velocity);
    }
}

#[test]
fn speed_a_disable_ends_braking_in_its_tick() {
    let mut rig = Rig::new(|_| ()).pulling();
    assert_eq!(rig.move_by(1.2e-3, 1.2).drive, Drive::Braking);
    rig.request = DriveRequest::Disable;
    let off = rig.move_by(0.8e-3, 0.8);
    assert_drive(&off, Drive::Disabled, Faults::NONE, OffCause::Software);
    assert!(is_zero(&off));
}

#[test]
fn power_over_a_window_faults_where_the_limiter_does_not_see_the_speed() {
    // Out slowly, 60 mm, then back with 0.9 m/s: 10 N would give 9 W. The limiter holds it at 5 W
    // while the velocity is right.
    let run = |twist_m_per_s: f64| {
        let mut rig = Rig::new(|p| p.arm = ArmParameters::default());
        rig.ticks(RAMP_TICKS + 3);
        for _ in 0..600 {
            rig.move_by(1e-4, 0.1);
        }
        assert!(rig.force_n() > 9.0);
        (1..=60).find_map(|n| {
            let output = rig.move_by(-0.9e-3, twist_m_per_s);
            (output.drive == Drive::Fault).then(|| {
                assert_fault_at_once(&output, Faults::POWER, OffCause::Power);
                n
            })
        })
    };
    assert_eq!(run(-0.9), None);
    // 6.25 W · 50 ms at 9 W, and what it took back on the way out.
    let n = run(0.0).expect("a fault");
    assert!((30..=51).contains(&n), "{n}");
}

#[test]
fn stuck_samples_ramp_down_from_the_fifth_repeat_and_fault_after_twenty() {
    let mut rig = Rig::new(|p| {
        (p.safety.stuck_move_m, p.safety.stuck_turn_rad) = (1.8e-4, 0.018);
        // The ramp is measured against the spring alone, without the damper of a hand that moves.
        p.arm = ArmParameters::default();
    });
    rig.ticks(RAMP_TICKS + 3);
    for _ in 0..25 {
        rig.move_by(2e-4, 0.2);
    }
    let held_n = rig.force_n();
    for repeat in 1..=20 {
        let output = rig.tick();
        assert_eq!((output.drive, output.faults), (Drive::Enabled, Faults::NONE));
        assert_eq!(
            output.off_cause,
            if repeat < 5 { OffCause::None } else { OffCause::Stale },
            "{repeat}"
        );
    }
    assert!((rig.force_n() - 0.84 * held_n).abs() < 0.05, "{} of {held_n}", rig.force_n());
    assert_fault_at_once(&rig.tick(), Faults::STUCK, OffCause::Stale);
    // Not enabled before the encoder moves.
    rig.order(DriveRequest::Disable);
    rig.request = DriveRequest::Enable;
    let waiting = rig.ticks(50);
    assert_eq!((waiting.drive, waiting.off_cause), (Drive::Disabled, OffCause::Stale));
    assert_eq!(rig.move_by(4e-5, 0.0).drive, Drive::Enabling);
}

#[test]
fn packets_ramp_down_after_five_and_fault_after_ten_in_a_tenth_of_a_second() {
    let mut rig = Rig::new(|_| ()).pulling();
    let held_n = rig.force_n();
    rig.sample.corrupt_packets = 1;
    assert_eq!(rig.ticks(5).off_cause, OffCause::None);
    assert!((rig.force_n() - held_n).abs() < 0.01);
    assert_eq!(rig.ticks(5).off_cause, OffCause::Protocol);
    assert!((rig.force_n() - 0.95 * held_n).abs() < 0.02);
    assert_fault_at_once(&rig.tick(), Faults::PROTOCOL, OffCause::Protocol);

    // A burst that ends: down while there are too many within the window, then up again.
    let mut rig = Rig::new(|_| ()).pulling();
    rig.sample.corrupt_packets = 8;
    rig.tick();
    rig.sample.corrupt_packets = 0;
    let output = rig.ticks(99);
    assert!(
        is_zero(&output)
            && output.drive == Drive::Enabled
            && output.off_cause == OffCause::Protocol
    );
    assert!((rig.ticks(RAMP_TICKS).command_device.force.x + held_n).abs() < 0.01);
}

#[test]
fn sequence_gap_of_the_stale_limit_faults_and_a_shorter_one_is_a_stale_tick() {
    let mut rig = Rig::new(|_| ()).pulling();
    rig.sample.lost_packets = 19;
    let output = rig.tick();
    assert_eq!((output.drive, output.off_cause), (Drive::Enabled, OffCause::Stale));
    rig.sample.lost_packets = 20;
    assert_fault_at_once(&rig.tick(), Faults::SEQUENCE_GAP, OffCause::Protocol);
}

#[test]
fn device_error_faults_at_once() {
    let mut rig = Rig::new(|_| ()).pulling();
    rig.sample.device_error = 1;
    assert_fault_at_once(&rig.tick(), Faults::DEVICE_ERROR, OffCause::Protocol);
}

#[test]
fn overheated_ramps_down_then_faults_and_is_a_gate() {
    let mut rig = Rig::new(|_| ()).pulling();
    let held_n = rig.force_n();
    rig.sample.overheated = true;
    let last = rig.assert_ramp_to_zero(held_n);
    assert_fault_at_once(&last, Faults::THERMAL, OffCause::Thermal);
    rig.order(DriveRequest::Disable);
    rig.request = DriveRequest::Enable;
    let waiting = rig.ticks(50);
    assert_eq!((waiting.drive, waiting.off_cause), (Drive::Disabled, OffCause::Thermal));
    rig.sample.overheated = false;
    assert_eq!(rig.tick().drive, Drive::Enabling);
}

#[test]
fn workspace_force_starts_inside_of_it_fades_outside_and_comes_back() {
    let mut rig = Rig::new(|p| p.safety.workspace_radius_m = 4e-3);
    // A parked arm is outside: that is no fault, and no force either.
    rig.sample.pose.translation.z = 0.207;
    let waiting = rig.ticks(50);
    assert_drive(&waiting, Drive::Disabled, Faults::NONE, OffCause::Workspace);
    while rig.sample.pose.translation.z > 1e-3 {
        rig.sample.pose.translation.z -= 1e-3;
        rig.tick();
    }
    rig.sample.pose.translation.z = 0.0;
    assert_eq!(rig.ticks(RAMP_TICKS + 3).drive, Drive::Enabled);
    rig.sample.pose.translation.x = 3.9e-3;
    rig.ticks(20);
    let inside_n = rig.force_n();
    rig.sample.pose.translation.x = 4.1e-3;
    let output = rig.ticks(50);
    assert_eq!((output.drive, output.off_cause), (Drive::Enabled, OffCause::Workspace));
    assert!((rig.force_n() - 0.5 * inside_n).abs() < 0.2);
    assert!(is_zero(&rig.ticks(50)) && rig.tick().faults == Faults::NONE);
    rig.sample.pose.translation.x = 3.9e-3;
    assert!(rig.tick().command_device.force.length() < 0.06);
    let output = rig.ticks(RAMP_TICKS);
    assert!((rig.force_n() - inside_n).abs() < 0.01 && output.off_cause == OffCause::None);
}

#[test]
fn an_arm_that_sends_no_numbers_is_not_enabled_then_or_later() {
    let mut rig = Rig::new(|p| p.safety.workspace_radius_m = 4e-3);
    rig.sample.pose.translation.y = f64::NAN;
    let refused = rig.tick();
    assert_drive(&refused, Drive::Fault, Faults::NON_FINITE, OffCause::NonFinite);
    rig.sample.pose.translation.y = 0.0;
    assert_eq!(rig.ticks(200).drive, Drive::Fault);
}

#[test]
fn lost_non_finite_overrun_and_jump_fault_at_once() {
    let mut rig = Rig::new(|_| ()).pulling();
    rig.sample.status = SampleStatus::Lost;
    assert_fault_at_once(&rig.tick(), Faults::DEVICE_LOST, OffCause::Disconnected);

    let mut rig = Rig::new(|_| ()).pulling();
    rig.sample.pose.translation.y = f64::NAN;
    assert_fault_at_once(&rig.tick(), Faults::NON_FINITE, OffCause::NonFinite);

    let mut rig = Rig::new(|_| ()).pulling();
    rig.sample.pose.translation.y = 0.05;
    assert_fault_at_once(&rig.tick(), Faults::POSITION_JUMP, OffCause::Velocity);

    let mut rig = Rig::new(|p| p.limits.overrun_fault_ticks = 3).pulling();
    let late = |rig: &mut Rig| {
        let input = TickInput { overrun: true, ..rig.input() };
        tick(&rig.scene, &mut rig.state, &input)
    };
    assert!((0..2).all(|_| late(&mut rig).drive == Drive::Enabled));
    assert_fault_at_once(&late(&mut rig), Faults::OVERRUN, OffCause::Overrun);

    // A loop that stood still while the motors made something.
    let mut rig = Rig::new(|_| ()).pulling();
    let input = TickInput { stalled: true, ..rig.input() };
    let output = tick(&rig.scene, &mut rig.state, &input);
    assert_fault_at_once(&output, Faults::OVERRUN, OffCause::Overrun);
}

#[test]
fn a_lost_arm_is_a_fault_even_behind_a_gate() {
    let mut rig = Rig::with_deadman();
    rig.ticks(10);
    rig.sample.status = SampleStatus::Lost;
    assert_fault_at_once(&rig.tick(), Faults::DEVICE_LOST, OffCause::Disconnected);
}
