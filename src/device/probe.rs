//! Trying an arm out: does it answer, how evenly, do its signs fit, what is it made of. Cold: one arm, one thread, no scene.
//!
//! Nothing here ever commands more than [`FORCE_MAX_N`].

use core::sync::atomic::{AtomicBool, Ordering};
use core::time::Duration;

use glam::DVec3;

use super::identify::{Made, Record, made_of};
use super::{Device, DeviceError};
use crate::rt::clock::Clock;
use crate::spatial::{Axes, DeviceSample, SampleStatus, Wrench};

/// Largest force of any trial, N.
pub const FORCE_MAX_N: f64 = 0.5;
/// Force of the sign check, N, and how long it is on, s.
const SIGN_FORCE_N: f64 = 0.3;
const SIGN_S: f64 = 0.2;
/// Displacement that counts as one, m: a few encoder steps.
const SIGN_MOVED_M: f64 = 1e-4;
/// Force of the identification, N, and how long each axis is shaken, s.
const SHAKE_N: f64 = 0.35;
const SHAKE_S: f64 = 3.0;
/// How often, and how long it rests before, s.
pub const SHAKES: usize = 4;
const REST_S: f64 = 0.5;
/// Frequencies that it is shaken with, Hz: from where viscosity counts, but a light arm stays within its reach, to where mass does.
const SHAKE_HZ: [f64; 4] = [1.7, 3.1, 5.3, 9.7];

/// Why a trial ended before its time. The arm was told to stop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ended {
    /// The arm failed.
    Device(DeviceError),
    /// Somebody asked for it.
    Told,
}

impl From<DeviceError> for Ended {
    fn from(error: DeviceError) -> Self {
        Self::Device(error)
    }
}

/// Time and a way out of a trial.
#[derive(Debug)]
pub struct Trial<'a, C> {
    /// The clock.
    pub clock: C,
    /// One tick, s.
    pub period_s: f64,
    /// Ends it when set.
    pub quit: &'a AtomicBool,
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
    /// Largest distance from it on any axis: the noise of the encoders, where nobody touches the grip, m.
    pub spread_m: f64,
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
}

impl<'a, 'q, C: Clock> Bench<'a, 'q, C> {
    fn new(device: &'a mut dyn Device, trial: &'a mut Trial<'q, C>) -> Self {
        let deadline_ns = trial.clock.now_ns();
        Self { device, trial, deadline_ns }
    }

    /// One tick: the sample, then the force; limited here once more.
    fn tick(&mut self, force: DVec3) -> Result<DeviceSample, Ended> {
        let period_ns = ((self.trial.period_s * 1e9) as i64).max(1);
        // A tick that took too long is not made up for.
        self.deadline_ns = (self.deadline_ns + period_ns).max(self.trial.clock.now_ns());
        self.trial.clock.sleep_until(self.deadline_ns);
        if self.trial.quit.load(Ordering::Relaxed) {
            return Err(Ended::Told);
        }
        let sample = match self.device.read() {
            Err(DeviceError::Packet) => DeviceSample { corrupt_packets: 1, ..DeviceSample::default() },
            other => other?,
        };
        self.device.write(&Wrench::new(force.clamp_length_max(FORCE_MAX_N), DVec3::ZERO))?;
        Ok(sample)
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
/// The arm was lost, or somebody asked for an end.
pub fn listen(device: &mut dyn Device, trial: &mut Trial<'_, impl Clock>, duration: Duration) -> Result<Answers, Ended> {
    let n = (duration.as_secs_f64() / trial.period_s) as u64;
    let mut bench = Bench::new(device, trial);
    let mut answers = Answers::default();
    let mut silence = 0;
    let mut bounds = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for _ in 0..n {
        let sample = bench.tick(DVec3::ZERO)?;
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
        (answers.homed, answers.error) = (sample.homed, sample.device_error);
        answers.position_m += sample.pose.translation;
        bounds = (bounds.0.min(sample.pose.translation), bounds.1.max(sample.pose.translation));
    }
    drop(bench);
    if answers.fresh > 0 {
        answers.position_m /= answers.fresh as f64;
        answers.spread_m = (bounds.1 - answers.position_m).max(answers.position_m - bounds.0).max_element();
    }
    Ok(answers)
}

/// Longest wait for the answer to one command, µs.
const ANSWER_US: i64 = 20_000;
/// Pause between two looks, ns.
const LOOK_NS: i64 = 20_000;

/// Times from a zero command to the next sample, µs: of an arm that answers the round trip, of one that sends by itself how long the next sample takes.
/// One that does not come within 20 ms counts as that.
///
/// # Errors
/// The arm was lost, or somebody asked for an end.
pub fn round_trips(device: &mut dyn Device, trial: &mut Trial<'_, impl Clock>, duration: Duration) -> Result<Vec<u64>, Ended> {
    let n = (duration.as_secs_f64() / trial.period_s) as usize;
    let mut bench = Bench::new(device, trial);
    let mut trips_us = Vec::with_capacity(n);
    for _ in 0..n {
        bench.tick(DVec3::ZERO)?;
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
                return Err(Ended::Told);
            }
        }
    }
    Ok(trips_us)
}

/// Pushes along x, y and z, as far as they have motors, and looks which way the grip goes.
///
/// # Errors
/// The arm was lost, or somebody asked for an end.
pub fn check_signs(device: &mut dyn Device, trial: &mut Trial<'_, impl Clock>) -> Result<[Option<Sign>; 3], Ended> {
    let actuated = device.capabilities().actuated;
    let n = (SIGN_S / trial.period_s) as u32;
    let mut signs = [None; 3];
    // Arms with an enable bit take no force without it, and others hold their own weight only with it.
    device.set_enabled(true);
    let mut bench = Bench::new(device, trial);
    for (idx, axis) in DVec3::AXES.into_iter().enumerate().filter(|(idx, _)| actuated.has(*idx)) {
        let mut rest = DVec3::ZERO;
        for _ in 0..n {
            rest = bench.tick(DVec3::ZERO)?.pose.translation;
        }
        let mut pushed = rest;
        for tick in 0..n {
            // Comes in over the first half.
            let share = (2.0 * f64::from(tick) / f64::from(n)).min(1.0);
            let sample = bench.tick(axis * (SIGN_FORCE_N * share))?;
            if sample.status == SampleStatus::Fresh {
                pushed = sample.pose.translation;
            }
        }
        let moved_m = (pushed - rest).dot(axis);
        signs[idx] = Some(match moved_m {
            moved if moved > SIGN_MOVED_M => Sign::Right,
            moved if moved < -SIGN_MOVED_M => Sign::Wrong,
            _ => Sign::Still,
        });
    }
    Ok(signs)
}

/// Shakes each axis with a motor [`SHAKES`] times and finds out what it is made of. Nobody may hold the grip. `None`: no axis, or it did not move.
///
/// # Errors
/// The arm was lost, or somebody asked for an end.
pub fn identify(device: &mut dyn Device, trial: &mut Trial<'_, impl Clock>) -> Result<[Option<Made>; 3], Ended> {
    let actuated = device.capabilities().actuated;
    let mut made = [None; 3];
    for (idx, axis) in DVec3::AXES.into_iter().enumerate().filter(|(idx, _)| actuated.has(*idx)) {
        let mut records = Vec::with_capacity(SHAKES);
        for shake in 0..SHAKES {
            records.push(shaken(device, trial, axis, shake)?);
        }
        made[idx] = made_of(&records, trial.period_s);
    }
    Ok(made)
}

/// One trial along an axis. Each has other phases, so that they are not wrong in the same way.
fn shaken(device: &mut dyn Device, trial: &mut Trial<'_, impl Clock>, axis: DVec3, shake: usize) -> Result<Record, Ended> {
    let period_s = trial.period_s;
    let n = (SHAKE_S / period_s) as usize;
    let mut record = Record { forces_n: Vec::with_capacity(n), ways_m: Vec::with_capacity(n), delay_ticks: 0 };
    device.set_enabled(true);
    let mut bench = Bench::new(device, trial);
    // What the trial before left of motion dies away first.
    for _ in 0..(REST_S / period_s) as usize {
        bench.tick(DVec3::ZERO)?;
    }
    for tick in 0..n {
        let time_s = tick as f64 * period_s;
        // In and out over a fifth of the time, so that nothing jerks.
        let window = (5.0 * time_s / SHAKE_S).min(5.0 * (1.0 - time_s / SHAKE_S)).clamp(0.0, 1.0);
        let sum: f64 = SHAKE_HZ
            .iter()
            .enumerate()
            .map(|(idx, hz)| (core::f64::consts::TAU * (hz * time_s + (idx * shake) as f64 * 0.618)).sin())
            .sum();
        let force_n = (SHAKE_N * window * sum / SHAKE_HZ.len() as f64 * 2.0).clamp(-FORCE_MAX_N, FORCE_MAX_N);
        let sample = bench.tick(axis * force_n)?;
        record.delay_ticks = sample.delay_ticks as usize;
        record.forces_n.push(force_n);
        record.ways_m.push((sample.status == SampleStatus::Fresh).then(|| sample.pose.translation.dot(axis)));
    }
    Ok(record)
}

/// Names of the axes that signs and fits are of.
pub const AXIS_NAMES: [&str; 3] = [Axes::NAMES[0], Axes::NAMES[1], Axes::NAMES[2]];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::fault;
    use crate::device::sim::{SimArm, SimParameters};
    use crate::rt::clock::VirtualClock;

    const T: f64 = 1e-3;
    static NEVER: AtomicBool = AtomicBool::new(false);

    fn trial() -> Trial<'static, VirtualClock> {
        Trial { clock: VirtualClock::default(), period_s: T, quit: &NEVER }
    }

    fn arm(fault: Option<&str>) -> SimArm {
        let mut parameters =
            SimParameters { hand: None, fault: fault.map(|text| fault::parse(text).expect("grammar")), ..SimParameters::ideal(T) };
        parameters.plant.mass_kg = 0.25;
        parameters.plant.damping_n_s_per_m = 1.6;
        parameters.plant.encoder_step_m = 5e-5;
        parameters.plant.delay_ticks = 2;
        SimArm::new(parameters).expect("valid")
    }

    #[test]
    fn an_arm_is_listened_to() {
        let listen = |fault| listen(&mut arm(fault), &mut trial(), Duration::from_secs(1));
        let sound = listen(None).expect("there");
        assert_eq!((sound.ticks, sound.fresh, sound.round_trip_ticks, sound.longest_silence_ticks), (1000, 1000, 2, 0));
        assert!(sound.homed && sound.spread_m < 5e-5);
        let late = listen(Some("slow=4ms")).expect("there");
        assert!(late.fresh == 200 && late.longest_silence_ticks == 4, "{late:?}");
        assert_eq!(listen(Some("garbage@500ms")).expect("there").corrupt, 500);
        assert_eq!(listen(Some("unplug@500ms")), Err(Ended::Device(DeviceError::Lost)));
        let quit = AtomicBool::new(true);
        let mut told = Trial { clock: VirtualClock::default(), period_s: T, quit: &quit };
        assert_eq!(check_signs(&mut arm(None), &mut told), Err(Ended::Told));
    }

    #[test]
    fn a_motor_that_pushes_the_wrong_way_is_found() {
        let signs = |fault| check_signs(&mut arm(fault), &mut trial()).expect("there");
        assert_eq!(signs(None), [Some(Sign::Right); 3]);
        assert_eq!(signs(Some("sign-flip")), [Some(Sign::Wrong); 3]);
        assert_eq!(signs(Some("stuck")), [Some(Sign::Still); 3]);
    }

    #[test]
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
            let made = identify(&mut arm, &mut trial()).expect("there")[0].expect("moved");
            let bound = made.damping_bound_n_s_per_m;
            assert!(bound <= 1.02 * damping && bound >= 0.6 * damping, "{mass_kg} {damping} {coulomb_n}: {made:?}");
            assert!((made.mass_kg / mass_kg - 1.0).abs() < 0.05, "{mass_kg} {damping} {coulomb_n}: {made:?}");
            assert!((made.coulomb_n - coulomb_n).abs() < 0.02, "{mass_kg} {damping} {coulomb_n}: {made:?}");
        }
        assert_eq!(identify(&mut arm(Some("stuck")), &mut trial()).expect("there"), [None; 3]);
    }
}
