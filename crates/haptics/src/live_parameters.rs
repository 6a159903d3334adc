//! Parameters that may change while the loop runs: which, how far, how fast.
//!
//! Data in: the scene's parameters and at most one [`ParameterChange`] per tick. Data out: the
//! parameters of the tick. A value never jumps: it goes from where it is to where it is asked to be
//! along a straight line, and takes [`FULL_RANGE_S`] for its whole range. A parameter without a
//! change keeps the scene's bits.
//!
//! # Source
//! Ours.

use super::params::{CouplingMode, Parameters};

/// Time in which a value goes through all of its range, s.
const FULL_RANGE_S: f64 = 0.5;
/// A stiffness goes from the scene's divided by this, a small limit too; without stiffness or force
/// there would be nothing to feel ...
const LEAST_DIVISOR: f64 = 20.0;
/// ... and a stiffness to this multiple, or to what the arm can take.
const MOST_STIFFNESS: f64 = 4.0;
/// A force limit goes at least as low as this, N, whatever the scene's: what a person chose in
/// another scene can be kept ...
const LEAST_FORCE_N: f64 = 0.05;
/// ... and a torque limit, N·m.
const LEAST_TORQUE_NM: f64 = 1e-3;
/// Damping of the virtual tool in contact, shares of critical damping.
const MOST_DAMPING_RATIO: f64 = 2.0;
/// Rubber on dry rubber.
const MOST_FRICTION: f64 = 1.5;
/// Lowest cut-off frequency, Hz.
const LEAST_CUTOFF_HZ: f64 = 1.0;
/// Highest one, as a share of the tick rate.
const MOST_CUTOFF: f64 = 0.45;

/// A parameter that can be set while the loop runs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u8)]
pub enum LiveParameter {
    /// Penalty stiffness of one point.
    #[default]
    ContactStiffness = 0,
    /// Damping of the virtual tool in contact.
    ContactDampingRatio = 1,
    /// Coefficient up to which a face holds.
    FrictionStatic = 2,
    /// Coefficient at which it slides; never above the other.
    FrictionDynamic = 3,
    /// Lower end of the shaping filter's cut-off range.
    CutoffLow = 4,
    /// Upper end; never below the lower one.
    CutoffHigh = 5,
    /// Coupling spring.
    CouplingTranslation = 6,
    /// The same in rotation.
    CouplingRotation = 7,
    /// Largest force.
    ForceLimit = 8,
    /// Largest torque.
    TorqueLimit = 9,
}

/// The values that a live parameter may take, SI.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ParameterRange {
    /// Smallest value.
    pub least: f64,
    /// Largest value.
    pub most: f64,
    /// The scene's own.
    pub scene: f64,
}

/// The value that a client asks for.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ParameterChange {
    /// Which.
    pub parameter: LiveParameter,
    /// SI; clamped to the parameter's range. What is not finite is ignored.
    pub value: f64,
}

impl LiveParameter {
    /// All of them, each at its number.
    pub const ALL: [Self; 10] = [
        Self::ContactStiffness,
        Self::ContactDampingRatio,
        Self::FrictionStatic,
        Self::FrictionDynamic,
        Self::CutoffLow,
        Self::CutoffHigh,
        Self::CouplingTranslation,
        Self::CouplingRotation,
        Self::ForceLimit,
        Self::TorqueLimit,
    ];

    /// Those that hold back what the arm does. The others say how a scene feels: they belong to it,
    /// and go with it.
    pub const LIMITS: [Self; 2] = [Self::ForceLimit, Self::TorqueLimit];

    /// One of [`Self::LIMITS`].
    pub fn is_limit(self) -> bool {
        Self::LIMITS.contains(&self)
    }

    /// Name with its unit, as clients and recordings use it.
    pub const fn name(self) -> &'static str {
        match self {
            Self::ContactStiffness => "contact_stiffness_n_per_m",
            Self::ContactDampingRatio => "contact_damping_ratio",
            Self::FrictionStatic => "friction_static",
            Self::FrictionDynamic => "friction_dynamic",
            Self::CutoffLow => "filter_cutoff_low_hz",
            Self::CutoffHigh => "filter_cutoff_high_hz",
            Self::CouplingTranslation => "coupling_stiffness_n_per_m",
            Self::CouplingRotation => "coupling_stiffness_nm_per_rad",
            Self::ForceLimit => "limit_force_n",
            Self::TorqueLimit => "limit_torque_nm",
        }
    }

    /// The range of the parameter in a scene of these parameters; `None` where it would do nothing.
    pub fn range(self, p: &Parameters) -> Option<ParameterRange> {
        let mode = p.coupling.mode;
        let scene = self.read(p);
        let stiffness = |most: f64| {
            // Not more than the arm takes, not less than the scene has: what it allows itself stays
            // reachable.
            let most = most.min(MOST_STIFFNESS * scene).max(scene);
            ParameterRange { least: scene / LEAST_DIVISOR, most, scene }
        };
        let up_to = |most: f64| ParameterRange { least: 0.0, most: most.max(scene), scene };
        let down_to = |least: f64| ParameterRange {
            least: least.min(scene / LEAST_DIVISOR),
            most: scene,
            scene,
        };
        let rubs = p.contact.friction.stiffness_n_per_m > 0.0;
        Some(match self {
            Self::ContactStiffness => match mode {
                CouplingMode::Implicit => stiffness(f64::INFINITY),
                CouplingMode::Constraint => return None,
                // Without a virtual tool the arm feels it.
                CouplingMode::Direct => stiffness(scene),
            },
            // What acts on the virtual tool's velocity needs one.
            Self::ContactDampingRatio if mode.has_mass() => up_to(MOST_DAMPING_RATIO),
            Self::FrictionStatic | Self::FrictionDynamic if rubs => up_to(MOST_FRICTION),
            Self::CutoffLow | Self::CutoffHigh
                if scene.is_finite() && p.filter.cutoff_hz[0].is_finite() =>
            {
                ParameterRange {
                    least: LEAST_CUTOFF_HZ.min(scene),
                    most: (MOST_CUTOFF / p.period_s).max(scene),
                    scene,
                }
            }
            Self::CouplingTranslation if mode != CouplingMode::Direct => {
                stiffness(p.coupling.bound_n_per_m)
            }
            Self::CouplingRotation if mode != CouplingMode::Direct => {
                stiffness(p.coupling.bound_nm_per_rad)
            }
            Self::ForceLimit if scene > 0.0 => down_to(LEAST_FORCE_N),
            Self::TorqueLimit if scene > 0.0 => down_to(LEAST_TORQUE_NM),
            _ => return None,
        })
    }

    /// The value that a set of parameters has.
    pub fn read(self, p: &Parameters) -> f64 {
        let mut copy = *p;
        *self.slot(&mut copy)
    }

    /// Gives `to` the value that `from` has, to the bit, and with it what follows from that value.
    pub fn copy(self, from: &Parameters, to: &mut Parameters) {
        *self.slot(to) = self.read(from);
        if self == Self::ContactStiffness {
            to.contact.friction.stiffness_n_per_m = from.contact.friction.stiffness_n_per_m;
        }
    }

    fn write(self, p: &mut Parameters, value: f64) {
        if self == Self::ContactStiffness {
            // A face that holds stays as much stiffer than one of its points as the scene says.
            p.contact.friction.stiffness_n_per_m *= value / p.contact.stiffness_n_per_m;
        }
        *self.slot(p) = value;
    }

    fn slot(self, p: &mut Parameters) -> &mut f64 {
        match self {
            Self::ContactStiffness => &mut p.contact.stiffness_n_per_m,
            Self::ContactDampingRatio => &mut p.contact.damping_ratio,
            Self::FrictionStatic => &mut p.contact.friction.r#static,
            Self::FrictionDynamic => &mut p.contact.friction.dynamic,
            Self::CutoffLow => &mut p.filter.cutoff_hz[0],
            Self::CutoffHigh => &mut p.filter.cutoff_hz[1],
            Self::CouplingTranslation => &mut p.coupling.stiffness_n_per_m,
            Self::CouplingRotation => &mut p.coupling.stiffness_nm_per_rad,
            Self::ForceLimit => &mut p.limits.force_n,
            Self::TorqueLimit => &mut p.limits.torque_nm,
        }
    }
}

/// One parameter that a change was asked for.
#[derive(Clone, Copy, Debug)]
struct Ramped {
    value: f64,
    target: f64,
    /// Largest change in a tick.
    step: f64,
}

/// The ramps of all live parameters. No heap.
#[derive(Clone, Debug, Default)]
pub(super) struct ParameterRamps {
    /// In the order of [`LiveParameter::ALL`].
    ramped: [Option<Ramped>; LiveParameter::ALL.len()],
    is_used: bool,
}

impl ParameterRamps {
    /// The parameters of a tick; a change counts from the next tick on. A limit without force
    /// cannot jump in a hand: it takes its new value at once, so that a scene that takes the place
    /// of another begins with the limits that a person has chosen. RT: safe, O(1).
    pub(super) fn next(
        &mut self,
        scene: &Parameters,
        change: Option<ParameterChange>,
        has_force: bool,
    ) -> Parameters {
        match change {
            Some(ParameterChange { parameter, .. }) if parameter.is_limit() && !has_force => {
                self.take(scene, change);
                if let Some(ramped) =
                    self.ramped.get_mut(parameter as usize).and_then(Option::as_mut)
                {
                    ramped.value = ramped.target;
                }
                self.parameters(scene)
            }
            _ => {
                let p = self.parameters(scene);
                self.take(scene, change);
                p
            }
        }
    }

    /// Every ramp a step further.
    fn parameters(&mut self, scene: &Parameters) -> Parameters {
        let mut p = *scene;
        if self.is_used {
            for (parameter, ramped) in LiveParameter::ALL.into_iter().zip(&mut self.ramped) {
                if let Some(ramped) = ramped {
                    ramped.value += (ramped.target - ramped.value).clamp(-ramped.step, ramped.step);
                    parameter.write(&mut p, ramped.value);
                }
            }
            p.contact.friction.dynamic =
                p.contact.friction.dynamic.min(p.contact.friction.r#static);
            p.filter.cutoff_hz[1] = p.filter.cutoff_hz[1].max(p.filter.cutoff_hz[0]);
        }
        p
    }

    fn take(&mut self, scene: &Parameters, change: Option<ParameterChange>) {
        let Some(ParameterChange { parameter, value }) =
            change.filter(|change| change.value.is_finite())
        else {
            return;
        };
        let (Some(range), Some(ramped)) =
            (parameter.range(scene), self.ramped.get_mut(parameter as usize))
        else {
            return;
        };
        let step = (range.most - range.least) * scene.period_s / FULL_RANGE_S;
        let ramped = ramped.get_or_insert(Ramped { value: range.scene, target: range.scene, step });
        ramped.target = value.clamp(range.least, range.most);
        self.is_used = true;
    }
}

#[cfg(test)]
#[expect(
    clippy::float_cmp,
    clippy::expect_used,
    reason = "test code; values that are copied or reached exactly"
)]
mod tests {
    use super::*;
    use crate::FrictionParameters;
    use crate::testing::parameters;

    fn rubbing() -> Parameters {
        let mut p = parameters();
        p.contact.friction =
            FrictionParameters { r#static: 0.3, dynamic: 0.2, stiffness_n_per_m: 1e4 };
        p.filter.cutoff_hz = [50.0, 300.0];
        p
    }

    fn change(parameter: LiveParameter, value: f64) -> Option<ParameterChange> {
        Some(ParameterChange { parameter, value })
    }

    #[test]
    fn numbers_and_names_are_those_of_their_place() {
        for (idx, parameter) in LiveParameter::ALL.into_iter().enumerate() {
            assert_eq!(parameter as usize, idx);
            assert_eq!(
                LiveParameter::ALL.iter().filter(|other| other.name() == parameter.name()).count(),
                1
            );
        }
    }

    #[test]
    fn without_a_change_the_bits_stay() {
        let p = rubbing();
        let mut ramps = ParameterRamps::default();
        assert_eq!(ramps.next(&p, None, true), p);
        for value in [f64::NAN, f64::INFINITY] {
            ramps.next(&p, change(LiveParameter::ContactStiffness, value), true);
            assert_eq!(ramps.next(&p, None, true), p);
        }
    }

    #[test]
    fn every_knob_goes_to_both_ends_in_time_without_a_jump_and_moves_nothing_else() {
        let p = rubbing();
        for parameter in LiveParameter::ALL {
            let range = parameter.range(&p).expect("every parameter acts in this scene");
            assert!(
                range.least <= range.scene && range.scene <= range.most,
                "{parameter:?}: {range:?}"
            );
            let mut ramps = ParameterRamps::default();
            for (asked, reached) in
                [(-1e9, range.least), (1e9, range.most), (range.scene, range.scene)]
            {
                let mut before = parameter.read(&ramps.next(&p, change(parameter, asked), true));
                for _ in 0..501 {
                    let now = parameter.read(&ramps.next(&p, None, true));
                    assert!(
                        (now - before).abs() <= (range.most - range.least) / 500.0 * (1.0 + 1e-9),
                        "{parameter:?}"
                    );
                    before = now;
                }
                // The other one of a pair, which has not changed, limits these two.
                let reached = match parameter {
                    LiveParameter::FrictionDynamic => reached.min(p.contact.friction.r#static),
                    LiveParameter::CutoffHigh => reached.max(p.filter.cutoff_hz[0]),
                    _ => reached,
                };
                assert!(before == reached, "{parameter:?}: {before} and not {reached}");
            }
            if parameter != LiveParameter::ContactStiffness {
                assert_eq!(ramps.next(&p, None, true), p, "{parameter:?}");
            }
        }
    }

    #[test]
    fn a_copy_takes_its_parameter_and_with_that_of_contact_the_stiffness_of_friction() {
        let p = rubbing();
        for parameter in LiveParameter::ALL {
            let mut other = p;
            parameter.write(&mut other, 0.7 * parameter.read(&p));
            assert_ne!(other, p, "{parameter:?}");
            parameter.copy(&p, &mut other);
            assert_eq!(other, p, "{parameter:?}");
            other.contact.friction.stiffness_n_per_m = 7e3;
            parameter.copy(&p, &mut other);
            let expected = if parameter == LiveParameter::ContactStiffness { 1e4 } else { 7e3 };
            assert_eq!(other.contact.friction.stiffness_n_per_m, expected, "{parameter:?}");
        }
    }

    #[test]
    fn pairs_hold_each_other_and_friction_stiffness_follows() {
        let p = rubbing();
        let mut ramps = ParameterRamps::default();
        let half_n_per_m = 0.5 * p.contact.stiffness_n_per_m;
        ramps.next(&p, change(LiveParameter::FrictionStatic, 0.1), true);
        ramps.next(&p, change(LiveParameter::ContactStiffness, half_n_per_m), true);
        let settled = (0..600).map(|_| ramps.next(&p, None, true)).last().expect("ticks");
        let expected =
            FrictionParameters { r#static: 0.1, dynamic: 0.1, stiffness_n_per_m: 0.5 * 1e4 };
        assert_eq!(settled.contact.friction, expected);
        assert_eq!(settled.contact.stiffness_n_per_m, half_n_per_m);
    }

    #[test]
    fn a_low_cut_off_that_passes_the_high_one_takes_it_along() {
        let p = rubbing();
        let mut ramps = ParameterRamps::default();
        ramps.next(&p, change(LiveParameter::CutoffLow, 400.0), true);
        let cutoffs: [[f64; 2]; 600] =
            core::array::from_fn(|_| ramps.next(&p, None, true).filter.cutoff_hz);
        assert!(cutoffs.iter().all(|[low, high]| *high == low.max(300.0)));
        assert!(
            cutoffs.iter().any(|[low, _]| *low > 300.0 && *low < 400.0)
                && cutoffs.last() == Some(&[400.0, 400.0])
        );
    }

    #[test]
    fn without_force_a_limit_gets_its_value_at_once_and_nothing_else_does() {
        let p = rubbing();
        for parameter in LiveParameter::ALL {
            let range = parameter.range(&p).expect("acts");
            let expected = if parameter.is_limit() { range.least } else { range.scene };
            let low = ParameterRamps::default().next(&p, change(parameter, range.least), false);
            assert_eq!(parameter.read(&low), expected, "{parameter:?}");
        }
        let mut ramps = ParameterRamps::default();
        ramps.next(&p, change(LiveParameter::ForceLimit, 0.05), false);
        assert_eq!(ramps.next(&p, None, true).limits.force_n, 0.05);
        assert_eq!(ramps.next(&p, change(LiveParameter::ForceLimit, f64::MAX), false), p);
        assert!(
            LiveParameter::LIMITS
                .into_iter()
                .all(|parameter| parameter.range(&p).is_some_and(|range| range.least <= 0.05))
        );
    }

    #[test]
    fn nothing_exceeds_what_the_arm_takes() {
        let mut p = rubbing();
        (p.coupling.stiffness_n_per_m, p.coupling.bound_n_per_m) = (800.0, 1000.0);
        assert_eq!(LiveParameter::CouplingTranslation.range(&p).expect("acts").most, 1000.0);
        p.coupling.mode = CouplingMode::Direct;
        assert_eq!(LiveParameter::CouplingTranslation.range(&p), None);
        assert_eq!(
            LiveParameter::ContactStiffness.range(&p).expect("acts").most,
            p.contact.stiffness_n_per_m
        );
        assert_eq!(LiveParameter::ForceLimit.range(&p).expect("acts").most, p.limits.force_n);
    }

    #[test]
    fn ranges_are_those_of_the_reference() {
        let mut p = rubbing();
        p.contact.stiffness_n_per_m = 600.0;
        p.contact.damping_ratio = 0.7;
        p.coupling.stiffness_n_per_m = 800.0;
        p.coupling.bound_n_per_m = 3000.0;
        p.coupling.stiffness_nm_per_rad = 0.6;
        p.coupling.bound_nm_per_rad = 5.0;
        p.limits.force_n = 8.0;
        p.limits.torque_nm = 0.4;
        let bounds = |parameter: LiveParameter, p: &Parameters| {
            parameter.range(p).map(|range| (range.least, range.most))
        };
        for (parameter, expected) in [
            (LiveParameter::ContactStiffness, (30.0, 2400.0)),
            (LiveParameter::ContactDampingRatio, (0.0, 2.0)),
            (LiveParameter::FrictionStatic, (0.0, 1.5)),
            (LiveParameter::FrictionDynamic, (0.0, 1.5)),
            (LiveParameter::CutoffLow, (1.0, 450.0)),
            (LiveParameter::CutoffHigh, (1.0, 450.0)),
            (LiveParameter::CouplingTranslation, (40.0, 3000.0)),
            (LiveParameter::CouplingRotation, (0.03, 2.4)),
            (LiveParameter::ForceLimit, (0.05, 8.0)),
            (LiveParameter::TorqueLimit, (1e-3, 0.4)),
        ] {
            let (least, most) = bounds(parameter, &p).expect("acts");
            assert!((least / expected.0 - 1.0).abs() < 1e-12 || least == expected.0);
            assert!((most / expected.1 - 1.0).abs() < 1e-12, "{parameter:?}: {most}");
        }
        p.limits.force_n = 0.4;
        p.limits.torque_nm = 0.01;
        assert_eq!(bounds(LiveParameter::ForceLimit, &p), Some((0.4 / 20.0, 0.4)));
        assert_eq!(bounds(LiveParameter::TorqueLimit, &p), Some((0.01 / 20.0, 0.01)));
        p.limits.torque_nm = 0.0;
        assert_eq!(bounds(LiveParameter::TorqueLimit, &p), None);
        let acts = |parameter: LiveParameter, p: &Parameters| parameter.range(p).is_some();
        let mut smooth = p;
        smooth.contact.friction.stiffness_n_per_m = 0.0;
        assert!(!acts(LiveParameter::FrictionStatic, &smooth));
        for cutoff_hz in [[f64::INFINITY, 300.0], [50.0, f64::INFINITY]] {
            p.filter.cutoff_hz = cutoff_hz;
            let [low, high] = cutoff_hz.map(f64::is_finite);
            assert_eq!(acts(LiveParameter::CutoffLow, &p), low, "{cutoff_hz:?}");
            assert_eq!(acts(LiveParameter::CutoffHigh, &p), low && high, "{cutoff_hz:?}");
        }
        for (mode, acting) in [
            (CouplingMode::Implicit, [true, true, true]),
            (CouplingMode::Constraint, [false, true, false]),
            (CouplingMode::Direct, [false, true, true]),
        ] {
            p.coupling.mode = mode;
            let parameters = [
                LiveParameter::ContactDampingRatio,
                LiveParameter::FrictionStatic,
                LiveParameter::ContactStiffness,
            ];
            assert_eq!(parameters.map(|parameter| acts(parameter, &p)), acting, "{mode:?}");
        }
    }
}
