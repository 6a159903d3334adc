//! What has to be so before force may flow, and what is remembered of why it does not.

use super::drive::DriveRequest;
use super::params::{LimitParameters, SafetyParameters};
use super::{Faults, OffCause};
use vps::spatial::{DeviceSample, SampleStatus, Wrench};

/// Gates and memory of the drive; `tick` moves the drive by them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Interlock {
    /// The deadman in the newest sample that came.
    is_pressed: bool,
    /// There was a fault since the deadman was last seen open: it does not count until it is. That
    /// goes on in a scene that takes the place of another.
    pub(super) must_release: bool,
    /// Fault that the drive enters once it is slow, or at zero.
    pub(super) pending: Faults,
    /// Ticks of braking since it was too fast.
    pub(super) brake_ticks: u32,
    /// Why the drive left the states with force, or stays out of them.
    pub(super) cause: OffCause,
    /// The tool stays where it stands at the next enable.
    pub(super) holds_place: bool,
    /// Ticks in a row with a small wrench.
    quiet_ticks: u32,
    /// Since enable the ramp was let rise.
    pub(super) is_engaged: bool,
    /// The tool was put where the scene has it start, and the hand has held it in clay ever since:
    /// nothing is felt.
    pub(super) must_clear: bool,
}

impl Interlock {
    /// Looks at the deadman. An arm that is gone holds none.
    pub(super) fn see(&mut self, sample: &DeviceSample, safety: &SafetyParameters) {
        let Some(button) = safety.deadman else {
            (self.is_pressed, self.must_release) = (true, false);
            return;
        };
        match sample.status {
            SampleStatus::Fresh => {
                self.is_pressed =
                    sample.buttons.checked_shr(u32::from(button)).unwrap_or(0) & 1 == 1;
                self.must_release &= self.is_pressed;
            }
            SampleStatus::Stale => {}
            SampleStatus::Lost | SampleStatus::LinkLost => self.is_pressed = false,
        }
    }

    /// The user holds the deadman. Without a deadman: always true.
    pub(super) fn is_held(&self) -> bool {
        self.is_pressed && !self.must_release
    }

    /// The user has let go of the deadman since the fault and holds it again: an explicit act.
    /// False without a deadman.
    pub(super) fn acknowledges(&self, request: DriveRequest, safety: &SafetyParameters) -> bool {
        safety.deadman.is_some() && request == DriveRequest::Enable && self.is_held()
    }

    /// The gate that is shut, if any. Faults of the sample are judged by the caller, between these
    /// and the start.
    pub(super) fn shut_gate(
        &self,
        sample: &DeviceSample,
        safety: &SafetyParameters,
    ) -> Option<OffCause> {
        if !self.is_held() {
            Some(OffCause::Deadman)
        } else if !sample.homed {
            Some(OffCause::NotHomed)
        } else if sample.overheated {
            Some(OffCause::Thermal)
        } else if sample.pose.is_finite() && is_outside(sample, safety) {
            // A pose that is not a number is a fault, which the caller sees.
            Some(OffCause::Workspace)
        } else {
            None
        }
    }

    /// Enable: everything of the last time is forgotten.
    pub(super) fn start(&mut self) {
        *self = Self {
            is_pressed: self.is_pressed,
            must_release: self.must_release,
            ..Self::default()
        };
    }

    /// Enable, with the tool where the scene has it start: should that be in clay, it has to come
    /// out of it once.
    pub(super) fn start_anew(&mut self) {
        self.start();
        self.must_clear = true;
    }

    /// Disabled by the supervisor.
    pub(super) fn disable(&mut self) {
        self.start();
        self.cause = OffCause::Software;
    }

    /// A fault, of which the deadman has to know.
    pub(super) fn fail(&mut self, faults: Faults) {
        self.start();
        self.must_release = true;
        self.cause = OffCause::of(faults);
    }

    /// The drive leaves the states with force, or changes its way out of them.
    pub(super) fn leave(&mut self, cause: OffCause, pending: Faults, holds_place: bool) {
        (self.cause, self.pending, self.holds_place, self.brake_ticks) =
            (cause, pending, holds_place, 0);
    }

    /// All that decides on what the drive does next, with ticks counted up to so many only.
    #[cfg(test)]
    pub(super) fn decides(&self, most_quiet_ticks: u32) -> (u32, [u32; 2], [bool; 5]) {
        let Self {
            is_pressed,
            must_release,
            pending,
            brake_ticks,
            cause: _,
            holds_place,
            quiet_ticks,
            is_engaged,
            must_clear,
        } = *self;
        let ticks = [brake_ticks, quiet_ticks.min(most_quiet_ticks)];
        (pending.bits(), ticks, [is_pressed, must_release, holds_place, is_engaged, must_clear])
    }

    /// The ramp after enable may rise: the wrench was small for long enough, now or before, and the
    /// hand does not hold the tool in clay still.
    pub(super) fn engages(
        &mut self,
        wanted: Wrench,
        is_in_clay: bool,
        limits: &LimitParameters,
        safety: &SafetyParameters,
    ) -> bool {
        let LimitParameters { force_n, torque_nm, .. } = *limits;
        let share = safety.engage_share;
        self.must_clear &= is_in_clay && share < f64::INFINITY;
        let is_small = share == f64::INFINITY
            || (wanted.force.length() <= share * force_n
                && wanted.torque.length() <= share * torque_nm);
        self.quiet_ticks = if is_small { self.quiet_ticks.saturating_add(1) } else { 0 };
        self.is_engaged |= self.quiet_ticks > safety.engage_ticks && !self.must_clear;
        self.is_engaged
    }
}

/// The grip is further from the device origin than the workspace reaches. A NaN is outside.
pub(super) fn is_outside(sample: &DeviceSample, safety: &SafetyParameters) -> bool {
    let is_inside = sample.pose.translation.length() <= safety.workspace_radius_m;
    !is_inside && safety.workspace_radius_m.is_finite()
}

#[cfg(test)]
mod tests {
    use super::super::Parameters;
    use super::*;
    use crate::testing::parameters;

    #[test]
    fn a_tool_that_starts_in_clay_has_to_come_out_once() {
        let mut interlock = Interlock::default();
        let Parameters { limits, safety, .. } = parameters();
        let safety = SafetyParameters { engage_share: 0.1, ..safety };
        let engages = |interlock: &mut Interlock, is_in_clay| {
            interlock.engages(Wrench::ZERO, is_in_clay, &limits, &safety)
        };
        interlock.start_anew();
        assert!((0..1000).all(|_| !engages(&mut interlock, true)) && !interlock.is_engaged);
        engages(&mut interlock, false);
        assert!((0..1000).any(|_| engages(&mut interlock, true)) && interlock.is_engaged);
        // Where it stood before it may stand in it.
        interlock.start();
        assert!((0..1000).any(|_| engages(&mut interlock, true)));
    }

    #[test]
    fn force_and_torque_have_to_be_small_for_as_many_ticks_as_the_scene_says() {
        let limits = LimitParameters { force_n: 8.0, torque_nm: 0.4, ..parameters().limits };
        let safety =
            SafetyParameters { engage_share: 0.25, engage_ticks: 2, ..SafetyParameters::default() };
        let wrench =
            |force_n, torque_nm| Wrench::new(glam::DVec3::X * force_n, glam::DVec3::Y * torque_nm);
        for (wanted, is_small) in
            [(wrench(1.99, 0.099), true), (wrench(2.01, 0.05), false), (wrench(0.5, 0.101), false)]
        {
            let mut interlock = Interlock::default();
            let mut engaged = [false; 4];
            for engages in &mut engaged {
                *engages = interlock.engages(wanted, false, &limits, &safety);
            }
            assert_eq!(engaged, [false, false, is_small, is_small], "{wanted:?}");
        }
        let mut interlock = Interlock::default();
        interlock.fail(Faults::SPEED);
        assert_eq!((interlock.must_release, interlock.cause), (true, OffCause::Velocity));
    }

    #[test]
    fn a_start_forgets_all_but_the_deadman() {
        let safety = SafetyParameters { deadman: Some(3), ..SafetyParameters::default() };
        let sample = DeviceSample {
            buttons: 0b1000,
            status: SampleStatus::Fresh,
            ..DeviceSample::default()
        };
        let mut interlock = Interlock::default();
        interlock.see(&sample, &safety);
        interlock.leave(OffCause::Thermal, Faults::THERMAL, true);
        interlock.start();
        assert!(interlock.is_held() && interlock.pending.is_empty() && !interlock.holds_place);
        assert_eq!((interlock.cause, interlock.must_clear), (OffCause::None, false));
        interlock.start_anew();
        assert!(interlock.must_clear && interlock.is_held());
    }
}
