//! The drive's next state; the picture is in [`drive`](crate::drive).

use super::super::auto_limit::LoopDelay;
use super::super::damper;
use super::super::indexing::Indexing;
use super::super::sample::MOST_TURN_RAD;
use super::super::{Drive, DriveRequest, Faults, OffCause, Parameters, RenderScene};
use super::{State, TickInput};
use vps::spatial::{DeviceSample, SampleStatus};

/// Braking ends early once the arm is slower than this share of the speed limit.
const SLOW_SHARE: f64 = 0.1;

/// Follows the supervisor's request and the arm's gates; `faults` are those of this tick's sample
/// and of the loop.
pub(super) fn advance(
    scene: &RenderScene,
    p: &Parameters,
    state: &mut State,
    input: &TickInput,
    faults: Faults,
) {
    let sample = &input.sample;
    state.interlock.see(sample, &p.safety);
    if state.drive.has_force() && fault_with_force(p, state, sample, faults) {
        return;
    }
    if input.request == DriveRequest::Disable {
        state.at_rest(state.tool.pose());
        state.drive = Drive::Disabled;
        state.faults = Faults::NONE;
        state.interlock.disable();
        return;
    }
    if state.drive == Drive::Fault
        && faults.is_empty()
        && state.interlock.acknowledges(input.request, &p.safety)
    {
        state.drive = Drive::Disabled;
        state.faults = Faults::NONE;
    }
    match (state.drive, input.request) {
        (Drive::Disabled, DriveRequest::Enable) => try_to_enable(scene, state, sample, faults),
        (Drive::Disabled, DriveRequest::Stop) => state.interlock.cause = OffCause::Software,
        (Drive::Enabling | Drive::Enabled, DriveRequest::Stop) => {
            state.drive = Drive::Stopping;
            state.interlock.leave(OffCause::Software, Faults::NONE, false);
        }
        (Drive::Enabling | Drive::Enabled, _) if !state.interlock.is_held() => {
            state.drive = Drive::Stopping;
            state.interlock.leave(OffCause::Deadman, Faults::NONE, true);
        }
        (Drive::Enabling | Drive::Enabled, _) if sample.overheated => {
            state.drive = Drive::Stopping;
            state.interlock.leave(OffCause::Thermal, Faults::THERMAL, false);
        }
        _ => {}
    }
}

/// What faults do to a drive with force: nearly all end it. True when it ended.
fn fault_with_force(
    p: &Parameters,
    state: &mut State,
    sample: &DeviceSample,
    mut faults: Faults,
) -> bool {
    if !sample.homed && !sample.status.is_gone() {
        faults |= Faults::NOT_HOMED;
    }
    let pending = state.interlock.pending;
    if state.drive == Drive::Braking {
        state.interlock.brake_ticks = state.interlock.brake_ticks.saturating_add(1);
        // Half a tick of grace for the rounding of the time.
        let is_over =
            (f64::from(state.interlock.brake_ticks) + 0.5) * p.period_s > p.safety.brake_s;
        let goes_on = (faults | Faults::SPEED) == Faults::SPEED && !is_over && !is_slow(sample, p);
        if !goes_on {
            state.fail(faults | pending);
        }
        return !goes_on;
    }
    if faults == Faults::SPEED && damper::can_damp(&p.arm) && p.safety.brake_s >= p.period_s {
        // The spring may be what drives the arm: it is gone in this tick, and the damper rises by
        // the slew limit.
        state.at_rest(state.tool.pose());
        state.drive = Drive::Braking;
        state.interlock.leave(OffCause::Velocity, pending | Faults::SPEED, false);
        return false;
    }
    if !faults.is_empty() {
        state.fail(faults | pending);
        return true;
    }
    false
}

fn is_slow(sample: &DeviceSample, p: &Parameters) -> bool {
    sample.twist.linear.length() <= SLOW_SHARE * p.limits.speed_m_per_s
        && sample.twist.angular.length() * p.period_s <= SLOW_SHARE * MOST_TURN_RAD
}

/// From `Disabled` to `Enabling`, when every gate is open.
fn try_to_enable(scene: &RenderScene, state: &mut State, sample: &DeviceSample, faults: Faults) {
    if faults.contains(Faults::DEVICE_LOST) || faults.contains(Faults::LINK) {
        state.fail(faults);
        return;
    }
    if let Some(cause) = state.interlock.shut_gate(sample, &scene.parameters.safety) {
        state.interlock.cause = cause;
        return;
    }
    if faults == Faults::STUCK {
        // It ends with the first step of an encoder; until then the pose cannot be trusted.
        state.interlock.cause = OffCause::Stale;
        return;
    }
    if !faults.is_empty() {
        state.fail(faults);
        return;
    }
    // One tick shows whether the tool can move.
    if state.resume.is_some_and(|resume| resume.has_room.is_none()) {
        return;
    }
    // A sample that is old, or never came, cannot be the zero of the indexing.
    if sample.status != SampleStatus::Fresh {
        state.interlock.cause = OffCause::Stale;
        return;
    }
    let resume = state
        .resume
        .take()
        .filter(|resume| resume.has_room == Some(true))
        .map(|resume| resume.body);
    let place = resume
        .or_else(|| (state.interlock.holds_place && state.has_room).then(|| state.tool.pose()));
    state.start = place.unwrap_or(scene.start());
    state.at_rest(state.start);
    state.indexing = Indexing::indexed(sample);
    state.passivity.reset();
    state.power.reset();
    state.delay = LoopDelay::starting_at(sample.delay_ticks);
    match place {
        Some(_) => state.interlock.start(),
        None => state.interlock.start_anew(),
    }
    state.drive = Drive::Enabling;
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::testing::parameters;
    use vps::spatial::Twist;

    #[test]
    fn an_arm_is_slow_below_a_tenth_of_what_it_may() {
        let mut p = parameters();
        p.limits.speed_m_per_s = 3.0;
        p.period_s = 2e-3;
        for (speed_m_per_s, turns_rad_per_s, slow) in
            [(0.29, 24.0, true), (0.31, 24.0, false), (0.29, 26.0, false)]
        {
            let linear = DVec3::new(0.6, 0.0, -0.8) * speed_m_per_s;
            let angular = DVec3::new(0.0, 0.8, 0.6) * turns_rad_per_s;
            let twist = Twist { linear, angular };
            let sample = DeviceSample { twist, ..DeviceSample::default() };
            assert_eq!(is_slow(&sample, &p), slow, "{speed_m_per_s} {turns_rad_per_s}");
        }
    }
}
