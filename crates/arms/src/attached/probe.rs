//! Trying an arm out: does it answer, how evenly, do its signs fit, what is it made of. Cold: one
//! arm, one thread, no scene.
//!
//! Nothing here ever commands more than [`FORCE_MAX_N`], or more torque than [`torque_max_nm`].
//! Between two pushes zero commands go out in every tick: arms have watchdogs, and some of them
//! stay off once theirs has tripped.

use core::sync::atomic::{AtomicBool, Ordering};
use core::time::Duration;

use glam::DVec3;

use super::identify::{AxisDynamics, Record, made_of};
use crate::profile::{Profile, UNACTUATED_FORCE_N};
use crate::{Device, DeviceError};
use rt::clock::Clock;
use vps::spatial::{DeviceSample, Pose, SampleStatus, Twist, Wrench};

/// Largest force of any trial, N.
pub const FORCE_MAX_N: f64 = 0.5;
/// Force of the sign check, N, and how long it is on, s. Torque is the same share of the most that
/// may be.
const SIGN_FORCE_N: f64 = 0.3;
const SIGN_S: f64 = 0.2;
/// Least displacements that count as one, m and rad.
const SIGN_MOVED_M: f64 = 1e-4;
const SIGN_TURNED_RAD: f64 = 1e-3;
/// The same in encoder steps.
const SIGN_STEPS: f64 = 2.0;
/// Displacements at which a push has shown enough, m and rad: a light grip that no hand holds is
/// not pushed away.
const SIGN_FAR: [f64; 2] = [0.01, 0.1];
/// Time for hands to come or go before anything is pushed.
const BEFORE_FORCE: Duration = Duration::from_secs(2);
/// Speeds of the grip under a push of the sign check, and under a shake, above which it is let go,
/// m/s and rad/s: what the lightest arm comes to with no hand on it, and half as much again.
const PUSHED_SPEED: [f64; 2] = [0.5, 5.0];
const SHAKEN_SPEED: [f64; 2] = [1.0, 10.0];
/// Longest time between two commands while something is on the motors, ns.
const STALL_NS: i64 = 50_000_000;
/// How much faster the grip may become while nothing pushes it, m/s and rad/s: a hand may, an arm
/// that drives itself does.
const GROWN_SPEED: [f64; 2] = [0.2, 3.0];
/// Share of a watchdog's time after which it counts as tripped: what the host sends late may arrive
/// later still.
const WATCHDOG_SHARE: f64 = 0.75;
/// Force of the identification, N, and how long each axis is shaken, s.
const SHAKE_N: f64 = 0.35;
const SHAKE_S: f64 = 3.0;
/// How often, and how long it rests before, s.
const SHAKES: usize = 4;
const REST_S: f64 = 0.5;
/// Frequencies that it is shaken with, Hz: from where viscosity counts, but a light arm stays
/// within its reach, to where mass does.
const SHAKE_HZ: [f64; 4] = [1.7, 3.1, 5.3, 9.7];

/// Why a trial ended before its time. The arm was sent zero.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProbeEnd {
    /// The arm failed.
    Device(DeviceError),
    /// The caller asked for it.
    Interrupted,
    /// The arm does not know its zero, or sends nothing that would say so: nothing is pushed.
    NotHomed,
    /// The arm reports this error, with which none pushes.
    Reports(u16),
    /// Its watchdog has seen no command for this long, ms, and stays tripped: the motors are off,
    /// or may be.
    Watchdog(u64),
    /// The program stood still for this long, ms, while something was on the motors: the hand may
    /// have let go of the grip.
    Stalled(u64),
    /// The grip moves by itself, or faster than the push can have made it: mm/s and mrad/s.
    Moves(u32, u32),
}

impl From<DeviceError> for ProbeEnd {
    fn from(error: DeviceError) -> Self {
        Self::Device(error)
    }
}

/// Largest torque of any trial, N·m: of the limit, what [`FORCE_MAX_N`] is of the force limit. A
/// run with unverified signs takes as much.
pub fn torque_max_nm(profile: &Profile) -> f64 {
    let force_n =
        if profile.limits.force_n > 0.0 { profile.limits.force_n } else { UNACTUATED_FORCE_N };
    profile.limits.torque_nm * (FORCE_MAX_N / force_n).min(1.0)
}

/// How hard the sign check pushes, and what it takes for a motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Push {
    /// Force, N.
    pub force_n: f64,
    /// Torque, N·m.
    pub torque_nm: f64,
    /// Displacements that count as one, m and rad.
    pub moved: [f64; 2],
}

impl Push {
    /// What an arm of this profile can bear, and what its encoders can show.
    pub fn of(profile: &Profile) -> Self {
        let steps = [profile.plant.encoder_step_m, profile.plant.encoder_step_rad]
            .map(|step| SIGN_STEPS * step);
        Self {
            force_n: SIGN_FORCE_N,
            torque_nm: torque_max_nm(profile) * SIGN_FORCE_N / FORCE_MAX_N,
            moved: [steps[0].max(SIGN_MOVED_M), steps[1].max(SIGN_TURNED_RAD)],
        }
    }
}

/// Time and a way out of a trial.
#[derive(Debug)]
pub struct Trial<'a, C> {
    /// What keeps the rate.
    pub clock: C,
    /// One tick, s.
    pub period_s: f64,
    /// Ends it when set.
    pub quit: &'a AtomicBool,
    torque_max_nm: f64,
    /// Set when a person says that force may come.
    go: Option<&'a AtomicBool>,
    last_command_ns: Option<i64>,
    longest_gap_ns: i64,
}

impl<'a, C: Clock> Trial<'a, C> {
    /// A trial of an arm that was just opened, without torque.
    pub fn new(clock: C, period_s: f64, quit: &'a AtomicBool) -> Self {
        Self {
            clock,
            period_s,
            quit,
            torque_max_nm: 0.0,
            go: None,
            last_command_ns: None,
            longest_gap_ns: 0,
        }
    }

    /// The same with torque: at most so much, N·m; see [`torque_max_nm`].
    pub fn with_torque(self, torque_max_nm: f64) -> Self {
        Self { torque_max_nm, ..self }
    }

    /// The same with a person who is asked before anything is pushed: `go` is set when force may
    /// come, and until then zero commands go out.
    pub fn asking(self, go: &'a AtomicBool) -> Self {
        Self { go: Some(go), ..self }
    }

    /// From here on force needs a new answer of the operator.
    fn hold_back(&self) {
        if let Some(go) = self.go {
            go.store(false, Ordering::Relaxed);
        }
    }

    fn commanded(&mut self) {
        self.longest_gap_ns = self.longest_gap_ns.max(self.gap_ns());
        self.last_command_ns = Some(self.clock.elapsed_ns());
    }

    /// Since the last command, a suspend of the machine included.
    fn gap_ns(&mut self) -> i64 {
        let now_ns = self.clock.elapsed_ns();
        self.last_command_ns.map_or(0, |last_ns| now_ns - last_ns)
    }
}

/// What is to be found out of an arm.
#[derive(Clone, Copy, Debug)]
pub struct ProbePlan {
    /// How long to listen.
    pub listen: Duration,
    /// Check the signs with such pushes.
    pub push: Option<Push>,
    /// Find out what it is made of.
    pub identify: bool,
}

/// What was found of an arm, as far as the trial came.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ProbeResult {
    /// How it answers.
    pub answers: Answers,
    /// Where x, y, z, rx, ry and rz go when they are pushed; `None`: not pushed.
    pub signs: [Option<Sign>; 6],
    /// What x, y and z are made of, after [`Self::fit`].
    pub made: [Option<AxisDynamics>; 3],
    /// How they moved when they were shaken.
    pub shakes: [Vec<Record>; 3],
}

impl ProbeResult {
    /// Finds out what the axes that were shaken are made of. It takes long, so it is no work for
    /// the thread of [`try_out`]: threads below that one carry the last zero to the arm.
    pub fn fit(&mut self, period_s: f64) {
        fit(&self.shakes, period_s, &mut self.made);
    }
}

/// What comes next, and wants hands on the grip or off it: nothing is pushed until the person who
/// is [asked](Trial::asking) says so, and for two seconds after that.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProbeStep {
    /// The sign check.
    Signs,
    /// The identification.
    Identify,
}

/// Tries an arm out, from listening to shaking. `found` holds what there is, whatever the end.
///
/// # Errors
/// The trial ended before its time: see [`ProbeEnd`].
pub fn try_out(
    device: &mut dyn Device,
    trial: &mut Trial<'_, impl Clock>,
    plan: &ProbePlan,
    found: &mut ProbeResult,
    mut tell: impl FnMut(ProbeStep),
) -> Result<(), ProbeEnd> {
    listen(device, trial, plan.listen, &mut found.answers)?;
    if let Some(push) = &plan.push {
        trial.hold_back();
        tell(ProbeStep::Signs);
        stand_by(device, trial)?;
        check_signs(device, trial, push, &mut found.signs)?;
    }
    if plan.identify {
        trial.hold_back();
        tell(ProbeStep::Identify);
        stand_by(device, trial)?;
        shake_all(device, trial, &mut found.shakes)?;
    }
    Ok(())
}

/// Waits for hands to come or go, and for a reason to push nothing.
fn stand_by(device: &mut dyn Device, trial: &mut Trial<'_, impl Clock>) -> Result<(), ProbeEnd> {
    if let Some(go) = trial.go {
        let mut bench = Bench::new(device, trial);
        while !go.load(Ordering::Relaxed) {
            bench.tick(Wrench::ZERO)?;
        }
    }
    let mut stood = Answers::default();
    listen(device, trial, BEFORE_FORCE, &mut stood)?;
    match stood {
        Answers { error: 1.., .. } => Err(ProbeEnd::Reports(stood.error)),
        Answers { homed: false, .. } => Err(ProbeEnd::NotHomed),
        _ => Ok(()),
    }
}

/// How an arm answers.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Answers {
    /// Exchanges tried.
    pub ticks: u64,
    /// Those that brought a new sample.
    pub fresh: u64,
    /// Packets that were thrown away.
    pub corrupt: u64,
    /// Packets that the arm says were lost.
    pub lost_packets: u64,
    /// Longest run of ticks without a new sample.
    pub longest_silence_ticks: u64,
    /// Round trip that it measures, ticks.
    pub round_trip_ticks: u32,
    /// It knows where its zero is.
    pub homed: bool,
    /// Error that it reports; 0: none.
    pub error: u16,
    /// Mean position, m.
    pub position_m: DVec3,
    /// Largest distance from it on any axis: the noise of the encoders, where no hand touches the
    /// grip, m.
    pub spread_m: f64,
    /// Angle of the gripper in the last sample, rad; 0 where there is none.
    pub grip_rad: f64,
}

/// How an axis answers to a push.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sign {
    /// The way it was pushed.
    Right,
    /// The other way: force would feed back on itself.
    Wrong,
    /// Too little to tell.
    Still,
}

/// Ticks of an arm under a force.
struct Bench<'a, 'q, C> {
    device: &'a mut dyn Device,
    trial: &'a mut Trial<'q, C>,
    deadline_ns: i64,
    /// What the motors make of the last wrench.
    made: Wrench,
}

impl<'a, 'q, C: Clock> Bench<'a, 'q, C> {
    fn new(device: &'a mut dyn Device, trial: &'a mut Trial<'q, C>) -> Self {
        let deadline_ns = trial.clock.now_ns();
        Self { device, trial, deadline_ns, made: Wrench::ZERO }
    }

    /// One tick: the sample, then the wrench; limited here once more.
    fn tick(&mut self, wrench: Wrench) -> Result<DeviceSample, ProbeEnd> {
        let period_ns = ((self.trial.period_s * 1e9) as i64).max(1);
        // A tick that took too long is not made up for.
        self.deadline_ns = (self.deadline_ns + period_ns).max(self.trial.clock.now_ns());
        self.trial.clock.sleep_until(self.deadline_ns);
        if self.trial.quit.load(Ordering::Relaxed) {
            return Err(ProbeEnd::Interrupted);
        }
        let gap_ns = self.trial.gap_ns();
        if gap_ns > STALL_NS && self.made != Wrench::ZERO {
            return Err(ProbeEnd::Stalled(gap_ns.unsigned_abs() / 1_000_000));
        }
        let sample = match self.device.read() {
            Err(DeviceError::Packet) => {
                DeviceSample { corrupt_packets: 1, ..DeviceSample::default() }
            }
            other => other?,
        };
        let force = wrench.force.clamp_length_max(FORCE_MAX_N);
        let written = self
            .device
            .write(&Wrench::new(force, wrench.torque.clamp_length_max(self.trial.torque_max_nm)));
        self.made = match written {
            Err(DeviceError::Stalled) => {
                return Err(ProbeEnd::Stalled(gap_ns.unsigned_abs() / 1_000_000));
            }
            made => made?,
        };
        self.trial.commanded();
        Ok(sample)
    }

    /// `n` ticks under a zero command, in which the grip may move as it did, but not start to.
    /// Gives where it is then.
    fn rest(&mut self, n: u32) -> Result<Pose, ProbeEnd> {
        let mut pose = Pose::IDENTITY;
        let mut most = [f64::INFINITY; 2];
        for _ in 0..n {
            let sample = self.push(Wrench::ZERO, most)?;
            if sample.status == SampleStatus::Fresh && most[0].is_infinite() {
                let speeds = self.speeds(&sample);
                most = [speeds[0] + GROWN_SPEED[0], speeds[1] + GROWN_SPEED[1]];
            }
            pose = sample.pose;
        }
        Ok(pose)
    }

    /// How fast the grip is on the axes that have motors, m/s and rad/s: a wrist without any is
    /// moved by the hand that holds it.
    fn speeds(&self, sample: &DeviceSample) -> [f64; 2] {
        let actuated = self.device.capabilities().actuated;
        let Twist { linear, angular } = sample.twist;
        [(linear * actuated.linear_mask()).length(), (angular * actuated.angular_mask()).length()]
    }

    /// A tick of a push, as long as the arm can be pushed and is not faster than `most`, m/s and
    /// rad/s.
    fn push(&mut self, wrench: Wrench, most: [f64; 2]) -> Result<DeviceSample, ProbeEnd> {
        let sample = self.tick(wrench)?;
        let speeds = self.speeds(&sample);
        if sample.status == SampleStatus::Fresh && (speeds[0] > most[0] || speeds[1] > most[1]) {
            let [mm_per_s, mrad_per_s] = speeds.map(|speed| (speed * 1e3) as u32);
            return Err(ProbeEnd::Moves(mm_per_s, mrad_per_s));
        }
        let capabilities = self.device.capabilities();
        let gap_ms = self.trial.longest_gap_ns.unsigned_abs() / 1_000_000;
        let patience_ms =
            capabilities.watchdog_ms.map(|watchdog_ms| WATCHDOG_SHARE * f64::from(watchdog_ms));
        if capabilities.watchdog_latched
            && patience_ms.is_some_and(|patience_ms| gap_ms as f64 > patience_ms)
        {
            return Err(ProbeEnd::Watchdog(gap_ms));
        }
        match (sample.status, sample.device_error, sample.homed) {
            (SampleStatus::Fresh, error @ 1.., _) => Err(ProbeEnd::Reports(error)),
            (SampleStatus::Fresh, _, false) => Err(ProbeEnd::NotHomed),
            _ => Ok(sample),
        }
    }
}

impl<C> Drop for Bench<'_, '_, C> {
    /// Whatever way a trial ends, nothing is left on the motors.
    fn drop(&mut self) {
        self.device.stop();
        self.device.set_enabled(false);
    }
}

/// Listens with zero commands.
///
/// # Errors
/// The arm was lost, or the caller asked for an end; `answers` holds what came until then.
pub fn listen(
    device: &mut dyn Device,
    trial: &mut Trial<'_, impl Clock>,
    duration: Duration,
    answers: &mut Answers,
) -> Result<(), ProbeEnd> {
    let n = (duration.as_secs_f64() / trial.period_s) as u64;
    let mut bench = Bench::new(device, trial);
    let mut silence = 0;
    let mut bounds = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for _ in 0..n {
        let sample = bench.tick(Wrench::ZERO)?;
        answers.ticks += 1;
        answers.corrupt += u64::from(sample.corrupt_packets);
        answers.lost_packets += u64::from(sample.lost_packets);
        if sample.status != SampleStatus::Fresh {
            silence += 1;
            answers.longest_silence_ticks = answers.longest_silence_ticks.max(silence);
            continue;
        }
        silence = 0;
        answers.fresh += 1;
        answers.round_trip_ticks = sample.delay_ticks;
        (answers.homed, answers.error, answers.grip_rad) =
            (sample.homed, sample.device_error, sample.grip_rad);
        let place = sample.pose.translation;
        answers.position_m += (place - answers.position_m) / answers.fresh as f64;
        bounds = (bounds.0.min(place), bounds.1.max(place));
        answers.spread_m =
            (bounds.1 - answers.position_m).max(answers.position_m - bounds.0).max_element();
    }
    Ok(())
}

/// Longest wait for the answer to one command, µs.
const ANSWER_US: i64 = 20_000;
/// Pause between two looks, ns.
const LOOK_NS: i64 = 20_000;

/// Times from a zero command to the next sample, µs: of an arm that answers the round trip, of one
/// that sends by itself how long the next sample takes. One that does not come within 20 ms counts
/// as that.
///
/// # Errors
/// The arm was lost, or the caller asked for an end.
pub fn round_trips(
    device: &mut dyn Device,
    trial: &mut Trial<'_, impl Clock>,
    duration: Duration,
) -> Result<Vec<u64>, ProbeEnd> {
    let n = (duration.as_secs_f64() / trial.period_s) as usize;
    let mut bench = Bench::new(device, trial);
    let mut trips_us = Vec::with_capacity(n);
    for _ in 0..n {
        bench.tick(Wrench::ZERO)?;
        let begin_ns = bench.trial.clock.now_ns();
        loop {
            let now_ns = bench.trial.clock.now_ns();
            bench.trial.clock.sleep_until(now_ns + LOOK_NS);
            let is_fresh = match bench.device.read() {
                Ok(sample) => sample.status == SampleStatus::Fresh,
                Err(DeviceError::Packet) => false,
                Err(error) => return Err(error.into()),
            };
            let waited_us = (bench.trial.clock.now_ns() - begin_ns) / 1000;
            if is_fresh || waited_us >= ANSWER_US {
                trips_us.push(waited_us.unsigned_abs());
                break;
            }
            if bench.trial.quit.load(Ordering::Relaxed) {
                return Err(ProbeEnd::Interrupted);
            }
        }
    }
    Ok(trips_us)
}

/// Pushes along and about x, y and z, as far as they have motors, and looks which way the grip
/// goes.
///
/// # Errors
/// The trial ended before its time; `signs` holds the axes that were pushed until then.
pub fn check_signs(
    device: &mut dyn Device,
    trial: &mut Trial<'_, impl Clock>,
    push: &Push,
    signs: &mut [Option<Sign>; 6],
) -> Result<(), ProbeEnd> {
    let actuated = device.capabilities().actuated;
    let n = (SIGN_S / trial.period_s) as u32;
    // Whatever the profile says of them: that is what is tried.
    device.doubt_signs(true);
    // Arms with an enable bit take no force without it.
    device.set_enabled(true);
    let mut bench = Bench::new(device, trial);
    for (idx, sign) in signs.iter_mut().enumerate().filter(|(idx, _)| actuated.has(*idx)) {
        let axis = DVec3::AXES[idx % 3];
        let is_turn = idx >= 3;
        let full = if is_turn {
            Wrench::new(DVec3::ZERO, axis * push.torque_nm)
        } else {
            Wrench::new(axis * push.force_n, DVec3::ZERO)
        };
        let way = |from: Pose, to: Pose| {
            if is_turn { from.rotation_to(to) } else { to.translation - from.translation }.dot(axis)
        };
        let rest = bench.rest(n)?;
        let mut moved = 0.0_f64;
        for tick in 0..n {
            // Comes in over the first half.
            let share = (2.0 * f64::from(tick) / f64::from(n)).min(1.0);
            let sample = bench.push(full * share, PUSHED_SPEED)?;
            if sample.status == SampleStatus::Fresh {
                moved = way(rest, sample.pose);
            }
            if moved.abs() >= SIGN_FAR[usize::from(is_turn)] {
                break;
            }
        }
        let enough = push.moved[usize::from(is_turn)];
        *sign = Some(match moved {
            moved if moved > enough => Sign::Right,
            moved if moved < -enough => Sign::Wrong,
            _ => Sign::Still,
        });
    }
    drop(bench);
    device.doubt_signs(false);
    Ok(())
}

/// Shakes each of x, y and z that has a motor `SHAKES` times and finds out what it is made of. No
/// hand may hold the grip. `None`: no axis, or it did not move.
///
/// # Errors
/// The trial ended before its time; `made` holds the axes that were shaken until then.
pub fn identify(
    device: &mut dyn Device,
    trial: &mut Trial<'_, impl Clock>,
    made: &mut [Option<AxisDynamics>; 3],
) -> Result<(), ProbeEnd> {
    let mut records: [Vec<Record>; 3] = Default::default();
    let ended = shake_all(device, trial, &mut records);
    fit(&records, trial.period_s, made);
    ended
}

fn fit(records: &[Vec<Record>; 3], period_s: f64, made: &mut [Option<AxisDynamics>; 3]) {
    for (made, records) in
        made.iter_mut().zip(records).filter(|(_, records)| records.len() == SHAKES)
    {
        *made = made_of(records, period_s);
    }
}

fn shake_all(
    device: &mut dyn Device,
    trial: &mut Trial<'_, impl Clock>,
    records: &mut [Vec<Record>; 3],
) -> Result<(), ProbeEnd> {
    let actuated = device.capabilities().actuated;
    for (idx, records) in records.iter_mut().enumerate().filter(|(idx, _)| actuated.has(*idx)) {
        for shake in 0..SHAKES {
            records.push(shaken(device, trial, DVec3::AXES[idx], shake)?);
        }
    }
    Ok(())
}

/// One trial along an axis. Each has other phases, so that they are not wrong in the same way.
fn shaken(
    device: &mut dyn Device,
    trial: &mut Trial<'_, impl Clock>,
    axis: DVec3,
    shake: usize,
) -> Result<Record, ProbeEnd> {
    let period_s = trial.period_s;
    let n = (SHAKE_S / period_s) as usize;
    let mut record =
        Record { forces_n: Vec::with_capacity(n), ways_m: Vec::with_capacity(n), delay_ticks: 0 };
    // No hand holds it, so an arm whose signs are verified holds the weight of its links; another
    // one may fall, and is let go then.
    device.set_enabled(true);
    let mut bench = Bench::new(device, trial);
    // What the trial before left of motion dies away first.
    bench.rest((REST_S / period_s) as u32)?;
    for tick in 0..n {
        let time_s = tick as f64 * period_s;
        // In and out over a fifth of the time, so that nothing jerks.
        let window = (5.0 * time_s / SHAKE_S).min(5.0 * (1.0 - time_s / SHAKE_S)).clamp(0.0, 1.0);
        let sum: f64 = SHAKE_HZ
            .iter()
            .enumerate()
            .map(|(idx, hz)| {
                (core::f64::consts::TAU * (hz * time_s + (idx * shake) as f64 * 0.618)).sin()
            })
            .sum();
        let force_n =
            (SHAKE_N * window * sum / SHAKE_HZ.len() as f64 * 2.0).clamp(-FORCE_MAX_N, FORCE_MAX_N);
        let sample = bench.push(Wrench::new(axis * force_n, DVec3::ZERO), SHAKEN_SPEED)?;
        record.delay_ticks = sample.delay_ticks as usize;
        // A motor at its limit, or a cap, leaves less than was asked for.
        record.forces_n.push(bench.made.force.dot(axis));
        record.ways_m.push(
            (sample.status == SampleStatus::Fresh).then(|| sample.pose.translation.dot(axis)),
        );
    }
    Ok(record)
}

#[cfg(test)]
mod tests;
