//! What is asked of the wrenches along a trajectory.

use glam::DVec3;
use vps::spatial::Wrench;

use super::super::ripple::{HIGH_PASS_HZ, ripple_rms_above};
use super::super::scenarios::RATE_HZ;
use super::scenes::{Kind, Law, Trajectory};
use crate::statistics::{median, quantile};

/// The second frequency above which a force is called rough, Hz.
const BUZZ_HZ: f64 = 50.0;
/// Least force of the closed form for which direction and size are asked, of its largest along the
/// trajectory.
const LEAST_SHARE: f64 = 0.05;

/// Names and units of [`Samples::figures`].
pub(super) const FIGURES: [(&str, &str); 16] = [
    ("angle to the closed form, median", "°"),
    ("angle, p95", "°"),
    ("line of action off, median", "mm"),
    ("line of action off, p95", "mm"),
    ("size off, p95", "%"),
    ("no force", "%"),
    ("force in a near miss", "%"),
    ("ripple above 10 Hz", "%"),
    ("ripple above 50 Hz", "%"),
    ("largest step", "%"),
    ("work of a loop", "%"),
    ("depth at load off", "%"),
    ("query, p50", "ms"),
    ("query, p99.9", "ms"),
    ("memory", "MB"),
    ("bake", "s"),
];

/// Of one trajectory, or of several together.
#[derive(Clone, Debug, Default)]
pub(super) struct Samples {
    angle_deg: Vec<f64>,
    off_mm: Vec<f64>,
    size_percent: Vec<f64>,
    n_lost: usize,
    n_judged: usize,
    n_missed: usize,
    n_false: usize,
    /// RMS of each trajectory above each frequency.
    ripple_percent: [Vec<f64>; 2],
    step_percent: Vec<f64>,
    work_percent: Vec<f64>,
    load_percent: Vec<f64>,
    query_ms: Vec<f64>,
    pub(super) memory_mb: Vec<f64>,
    pub(super) bake_s: Vec<f64>,
}

/// What every force of a program is multiplied by: the median of closed form over force where the
/// contact is steady. `None` without any force.
pub(super) fn scale<'a>(
    trajectories: impl Iterator<Item = (&'a Trajectory, &'a [Wrench])>,
) -> Option<f64> {
    let steady = trajectories.filter(|(trajectory, _)| trajectory.kind == Kind::Steady);
    let ratios = steady.flat_map(|(trajectory, wrenches)| {
        let ticks = trajectory.ticks.iter().zip(wrenches);
        ticks
            .filter_map(|(tick, wrench)| Some(tick.law?.force.length() / wrench.force.length()))
            .filter(|ratio| ratio.is_finite())
    });
    median(&ratios.collect::<Vec<f64>>())
}

/// Force in % of the closed form after scaling, and angle to it; `None` where one of them has no
/// force.
pub(super) fn beside(law: Option<Law>, wrench: &Wrench, scale: f64) -> Option<[f64; 2]> {
    let law = law?.force;
    let force = wrench.force * scale;
    let is_there = law.length() > 0.0 && force.length() > 1e-6 * law.length();
    is_there.then(|| [100.0 * force.length() / law.length(), force.angle_between(law).to_degrees()])
}

impl Samples {
    /// Adds one trajectory. `query_ns`: empty where it is not known; `wrenches`: where there are
    /// times alone.
    pub(super) fn add(
        &mut self,
        trajectory: &Trajectory,
        wrenches: &[Wrench],
        query_ns: &[f64],
        scale: f64,
    ) {
        self.query_ms.extend(query_ns.iter().map(|ns| ns * 1e-6));
        if wrenches.is_empty() {
            return;
        }
        let law_n = |law: Option<Law>| law.map_or(0.0, |law| law.force.length());
        let most_n = trajectory.ticks.iter().map(|tick| law_n(tick.law)).fold(0.0, f64::max);
        for (tick, wrench) in trajectory.ticks.iter().zip(wrenches) {
            let Some(law) = tick.law.filter(|law| law.force.length() > LEAST_SHARE * most_n) else {
                continue;
            };
            self.n_judged += 1;
            let Some([percent, angle_deg]) = beside(tick.law, wrench, scale) else {
                self.n_lost += 1;
                continue;
            };
            self.angle_deg.push(angle_deg);
            self.size_percent.push((percent - 100.0).abs());
            let missing =
                wrench.torque - Law { force: wrench.force, ..law }.torque(tick.pose.translation);
            self.off_mm.push(1e3 * missing.length() / wrench.force.length());
        }
        match trajectory.kind {
            Kind::Steady => self.smoothness(trajectory, wrenches, scale),
            Kind::Press => {
                self.load_percent.extend(load_percent(trajectory, wrenches, scale, 0.5 * most_n))
            }
            Kind::NearMiss => {
                self.n_missed += wrenches.len();
                self.n_false +=
                    wrenches.iter().filter(|wrench| wrench.force != DVec3::ZERO).count();
            }
            Kind::Loop => self.work_percent.extend(work_percent(trajectory, wrenches)),
        }
    }

    /// Of what the closed form does not have where there is one, else of the force itself; in % of
    /// the mean.
    fn smoothness(&mut self, trajectory: &Trajectory, wrenches: &[Wrench], scale: f64) {
        let ticks = || trajectory.ticks.iter().zip(wrenches);
        let law = |law: Option<Law>| law.map_or(DVec3::ZERO, |law| law.force);
        let own: Vec<DVec3> =
            ticks().map(|(tick, wrench)| wrench.force * scale - law(tick.law)).collect();
        let of_mean = ticks()
            .map(|(tick, wrench)| tick.law.map_or(wrench.force * scale, |law| law.force).length());
        let mean_n = of_mean.sum::<f64>() / trajectory.ticks.len() as f64;
        if mean_n <= 0.0 {
            return;
        }
        for (found, above_hz) in self.ripple_percent.iter_mut().zip([HIGH_PASS_HZ, BUZZ_HZ]) {
            found.extend(
                ripple_rms_above(&own, RATE_HZ, above_hz).map(|rms_n| 100.0 * rms_n / mean_n),
            );
        }
        let step_n = own.windows(2).map(|pair| (pair[1] - pair[0]).length()).fold(0.0, f64::max);
        self.step_percent.push(100.0 * step_n / mean_n);
    }

    /// In the order of [`FIGURES`].
    pub(super) fn figures(&self) -> [Option<f64>; FIGURES.len()] {
        let share = |values: &[f64], share: f64| {
            let mut sorted = values.to_vec();
            sorted.sort_by(f64::total_cmp);
            quantile(&sorted, share)
        };
        let percent = |n: usize, of: usize| (of > 0).then(|| 100.0 * n as f64 / of as f64);
        let most = |values: &[f64]| values.iter().copied().reduce(f64::max);
        let rms = |values: &[f64]| {
            (!values.is_empty()).then(|| {
                (values.iter().map(|value| value * value).sum::<f64>() / values.len() as f64).sqrt()
            })
        };
        [
            median(&self.angle_deg),
            share(&self.angle_deg, 0.95),
            median(&self.off_mm),
            share(&self.off_mm, 0.95),
            share(&self.size_percent, 0.95),
            percent(self.n_lost, self.n_judged),
            percent(self.n_false, self.n_missed),
            rms(&self.ripple_percent[0]),
            rms(&self.ripple_percent[1]),
            most(&self.step_percent),
            most(&self.work_percent),
            most(&self.load_percent),
            median(&self.query_ms),
            share(&self.query_ms, 0.999),
            most(&self.memory_mb),
            median(&self.bake_s),
        ]
    }
}

/// How far the depth at which the load is reached is from that of the closed form, %; infinite if
/// it never is.
fn load_percent(
    trajectory: &Trajectory,
    wrenches: &[Wrench],
    scale: f64,
    load_n: f64,
) -> Option<f64> {
    let depth_at = |forces: &[f64]| {
        let after = forces.iter().position(|force| *force >= load_n)?.max(1);
        let [(low, from), (high, to)] =
            [after - 1, after].map(|idx| (forces[idx], trajectory.ticks[idx].depth_m));
        Some(from + (to - from) * ((load_n - low) / (high - low)).clamp(0.0, 1.0))
    };
    let law: Vec<f64> = trajectory
        .ticks
        .iter()
        .map(|tick| Some(tick.law?.force.length()))
        .collect::<Option<_>>()?;
    let forces: Vec<f64> = wrenches.iter().map(|wrench| wrench.force.length() * scale).collect();
    let of_law = depth_at(&law).filter(|depth_m| *depth_m > 0.0)?;
    Some(depth_at(&forces).map_or(f64::INFINITY, |depth_m| 100.0 * (depth_m / of_law - 1.0).abs()))
}

/// Work of a closed path, % of what goes to and fro along it.
fn work_percent(trajectory: &Trajectory, wrenches: &[Wrench]) -> Option<f64> {
    let mut sum = 0.0;
    let mut moved = 0.0;
    for (ticks, wrenches) in trajectory.ticks.windows(2).zip(wrenches.windows(2)) {
        let [from, to] = [ticks[0].pose, ticks[1].pose];
        let force = 0.5 * (wrenches[0].force + wrenches[1].force);
        let torque = 0.5 * (wrenches[0].torque + wrenches[1].torque);
        let work_j =
            force.dot(to.translation - from.translation) + torque.dot(from.rotation_to(to));
        sum += work_j;
        moved += work_j.abs();
    }
    (moved > 0.0).then(|| 100.0 * sum.abs() / moved)
}

#[cfg(test)]
mod tests {
    use super::super::scenes::{TICKS, Tick, closed_forms};
    use super::*;

    fn index(name: &str) -> usize {
        FIGURES.iter().position(|(figure, _)| *figure == name).unwrap()
    }

    /// The closed form itself, changed by `with`, over all of its trajectories.
    fn judged(with: impl Fn(usize, Wrench) -> Wrench) -> [Option<f64>; FIGURES.len()] {
        let scenes = closed_forms();
        let mut all = Samples::default();
        let trajectories = scenes
            .iter()
            .flat_map(|scene| &scene.trajectories)
            .filter(|of| of.ticks[0].law.is_some());
        let answers: Vec<(&Trajectory, Vec<Wrench>)> = trajectories
            .map(|trajectory| {
                let ticks = trajectory.ticks.iter().enumerate();
                let wrench = |tick: &Tick| {
                    let law = tick.law.unwrap();
                    Wrench::new(law.force, law.torque(tick.pose.translation))
                };
                (trajectory, ticks.map(|(n, tick)| with(n, wrench(tick))).collect())
            })
            .collect();
        let scale =
            scale(answers.iter().map(|(trajectory, wrenches)| (*trajectory, &wrenches[..])))
                .unwrap();
        for (trajectory, wrenches) in &answers {
            all.add(trajectory, wrenches, &[], scale);
        }
        all.figures()
    }

    #[test]
    fn the_closed_form_itself_is_without_fault_whatever_its_unit_of_force() {
        let figures = judged(|_, wrench| Wrench::new(wrench.force * 7.0, wrench.torque * 7.0));
        for (value, (name, _)) in figures.iter().zip(FIGURES).take(index("work of a loop")) {
            assert!(value.unwrap() < 2e-6, "{name}: {value:?}");
        }
        assert!(figures[index("depth at load off")].unwrap() < 1e-6);
    }

    #[test]
    fn each_fault_shows_in_its_figure() {
        let value =
            |figures: [Option<f64>; FIGURES.len()], name: &str| figures[index(name)].unwrap();
        let aside = |force: DVec3| {
            1e-3 * force.length() * force.normalize_or(DVec3::X).any_orthonormal_vector()
        };
        let pushed =
            judged(|_, wrench| Wrench::new(wrench.force, wrench.torque + aside(wrench.force)));
        assert!(
            (value(pushed, "line of action off, median") - 1.0).abs() < 1e-6
                && value(pushed, "angle, p95") < 1e-5
        );
        let pushed = Wrench::new(DVec3::X, DVec3::ZERO);
        let false_force = judged(|n, wrench| if n < TICKS / 4 { pushed } else { wrench });
        assert!((value(false_force, "force in a near miss") - 25.0).abs() < 1.0);
        let lost = judged(|n, wrench| if n.is_multiple_of(4) { Wrench::ZERO } else { wrench });
        assert!((value(lost, "no force") - 25.0).abs() < 1.0 && value(lost, "largest step") > 99.0);
        let buzz = |every: usize| {
            move |n: usize, wrench: Wrench| {
                wrench * if (n / every).is_multiple_of(2) { 1.1 } else { 0.9 }
            }
        };
        let slow = judged(buzz(25));
        assert!(
            value(slow, "ripple above 10 Hz") > 2.0 * value(slow, "ripple above 50 Hz"),
            "{slow:?}"
        );
        let fast = judged(buzz(2));
        for name in ["ripple above 50 Hz", "size off, p95"] {
            assert!((value(fast, name) - 10.0).abs() < 2.0, "{name}: {fast:?}");
        }
        let hard = judged(|n, wrench| wrench * (1.0 + 0.5 * (n as f64 / TICKS as f64 - 0.5)));
        assert!(value(hard, "depth at load off") > 2.0);
    }

    #[test]
    fn only_a_force_that_follows_no_energy_does_work_around_a_loop() {
        let scenes = closed_forms();
        let trajectory = scenes[0].trajectories.iter().find(|of| of.kind == Kind::Loop).unwrap();
        let middle = trajectory.ticks[0].pose.translation;
        let spring = |side: DVec3| -> Vec<Wrench> {
            let at = trajectory.ticks.iter().map(|tick| tick.pose.translation - middle);
            at.map(|at| Wrench::new(-1e4 * at + 1e4 * side.cross(at), DVec3::ZERO)).collect()
        };
        let axis = (trajectory.ticks[100].pose.translation - middle)
            .cross(trajectory.ticks[200].pose.translation - middle);
        assert!(work_percent(trajectory, &spring(DVec3::ZERO)).unwrap() < 1e-6);
        assert!(work_percent(trajectory, &spring(axis.normalize())).unwrap() > 30.0);
        assert_eq!(work_percent(trajectory, &[Wrench::ZERO; TICKS]), None);
    }
}
