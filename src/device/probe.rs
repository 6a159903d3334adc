//! Trying an arm out: does it answer, how evenly, do its signs fit, what is it made of. Cold: one arm, one thread, no scene.
//!
//! Nothing here ever commands more than [`FORCE_MAX_N`].

use core::sync::atomic::{AtomicBool, Ordering};
use core::time::Duration;

use glam::DVec3;

use super::{Device, DeviceError};
use crate::rt::clock::Clock;
use crate::spatial::{Axes, DeviceSample, Mat6, SampleStatus, Wrench};

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
/// Frequencies that it is shaken with, Hz: from where viscosity counts to where mass does.
const SHAKE_HZ: [f64; 4] = [0.7, 1.9, 4.3, 9.1];

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

/// What an arm is made of, as far as one axis shows it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Made {
    /// Effective mass, kg.
    pub mass_kg: f64,
    /// Viscosity, N·s/m.
    pub damping_n_s_per_m: f64,
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

/// Shakes each axis with a motor and fits mass and viscosity to what it does. Nobody may hold the grip firmly. `None`: no axis, or it did not move.
///
/// The fit is of the equation of motion, integrated twice: ∬F = m·x + b·∫x + k·∬x + straight parts. No position is ever differentiated, so the
/// steps of an encoder hardly matter. Dry friction is not fitted: what an arm has of it shows up as mass and viscosity that are too large.
///
/// # Errors
/// The arm was lost, or somebody asked for an end.
pub fn identify(device: &mut dyn Device, trial: &mut Trial<'_, impl Clock>) -> Result<[Option<Made>; 3], Ended> {
    let actuated = device.capabilities().actuated;
    let mut made = [None; 3];
    let period_s = trial.period_s;
    for (idx, axis) in DVec3::AXES.into_iter().enumerate().filter(|(idx, _)| actuated.has(*idx)) {
        let n = (SHAKE_S / period_s) as usize;
        let (mut forces, mut ways) = (Vec::with_capacity(n), Vec::with_capacity(n));
        device.set_enabled(true);
        let mut bench = Bench::new(&mut *device, &mut *trial);
        let mut delay = 0;
        for tick in 0..n {
            let time_s = tick as f64 * period_s;
            // In and out over a fifth of the time, so that nothing jerks.
            let window = (5.0 * time_s / SHAKE_S).min(5.0 * (1.0 - time_s / SHAKE_S)).clamp(0.0, 1.0);
            let sum: f64 = SHAKE_HZ.iter().map(|hz| (core::f64::consts::TAU * hz * time_s).sin()).sum();
            let force_n = SHAKE_N * window * sum / SHAKE_HZ.len() as f64 * 2.0;
            let sample = bench.tick(axis * force_n)?;
            delay = sample.delay_ticks as usize;
            forces.push(force_n.clamp(-FORCE_MAX_N, FORCE_MAX_N));
            ways.push(sample.pose.translation.dot(axis));
        }
        drop(bench);
        made[idx] = fit(&forces, &ways, delay, period_s);
    }
    Ok(made)
}

fn fit(forces: &[f64], ways: &[f64], delay: usize, period_s: f64) -> Option<Made> {
    let first = *ways.first()?;
    if ways.iter().all(|way| (way - first).abs() < SIGN_MOVED_M) {
        return None;
    }
    // Six regressors, each over its own scale so that the matrix is well posed: x, ∫x, ∬x, t², t, 1.
    let length_s = forces.len() as f64 * period_s;
    let (mut x1, mut x2, mut f1, mut f2) = (0.0, 0.0, 0.0, 0.0);
    let rows: Vec<([f64; 6], f64)> = (0..ways.len())
        .map(|tick| {
            let way = ways[tick] - first;
            // The force written in a tick acts from then on, after the delay.
            let force = tick.checked_sub(1 + delay).map_or(0.0, |at| forces[at]);
            f1 += force * period_s;
            f2 += f1 * period_s;
            x1 += way * period_s;
            x2 += x1 * period_s;
            let time = tick as f64 * period_s / length_s;
            ([way, x1, x2, time * time, time, 1.0], f2)
        })
        .collect();
    let scale: [f64; 6] =
        core::array::from_fn(|idx| rows.iter().map(|(row, _)| row[idx] * row[idx]).sum::<f64>().sqrt().max(f64::MIN_POSITIVE));
    let mut normal = Mat6::ZERO;
    let mut right = Wrench::ZERO;
    for (row, target) in &rows {
        let [a, b, c, d, e, f] = core::array::from_fn(|idx| row[idx] / scale[idx]);
        let (linear, angular) = (DVec3::new(a, b, c), DVec3::new(d, e, f));
        normal.add_outer(1.0, linear, angular);
        right.force += linear * *target;
        right.torque += angular * *target;
    }
    let (solved, _) = normal.solve_spd(right)?;
    let made = Made { mass_kg: solved.x / scale[0], damping_n_s_per_m: solved.y / scale[1] };
    (made.mass_kg.is_finite() && made.mass_kg > 0.0 && made.damping_n_s_per_m.is_finite()).then_some(made)
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
    fn mass_and_viscosity_are_found_in_spite_of_encoder_steps() {
        let made = identify(&mut arm(None), &mut trial()).expect("there");
        for axis in made {
            let axis = axis.expect("moved");
            assert!((axis.mass_kg - 0.25).abs() < 0.02 && (axis.damping_n_s_per_m - 1.6).abs() < 0.25, "{axis:?}");
        }
        assert_eq!(identify(&mut arm(Some("stuck")), &mut trial()).expect("there"), [None; 3]);
    }
}
