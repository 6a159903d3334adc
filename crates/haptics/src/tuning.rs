//! Parameters that may change while the loop runs: which, how far, how fast.
//!
//! Data in: the scene's parameters and at most one [`Tune`] per tick. Data out: the parameters of the tick. A value is a wish, never a jump: it
//! goes from where it is to where it is asked to be along a straight line, and takes [`FULL_RANGE_S`] for its whole range. What nobody has
//! turned keeps the scene's bits.
//!
//! # Source
//! Ours.

use super::params::{CouplingMode, Parameters};

/// Time in which a value goes through all of its range, s.
const FULL_RANGE_S: f64 = 0.5;
/// A stiffness goes from the scene's divided by this, a small limit too; without stiffness or force there would be nothing to feel ...
const LEAST_DIVISOR: f64 = 20.0;
/// ... and a stiffness to this multiple, or to what the arm can take.
const MOST_STIFFNESS: f64 = 4.0;
/// A force limit goes at least as low as this, N, whatever the scene's: what a person chose in another scene can be kept ...
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
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Knob {
    /// Penalty stiffness of one point.
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

/// Where a knob stands and how far it goes, SI.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KnobRange {
    /// Smallest value.
    pub least: f64,
    /// Largest value.
    pub most: f64,
    /// The scene's own.
    pub scene: f64,
}

/// What a knob is asked to become.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tune {
    /// Which.
    pub knob: Knob,
    /// SI; clamped to the knob's range. What is not finite is ignored.
    pub value: f64,
}

impl Knob {
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

    /// Those that hold back what the arm does. The others say how a scene feels: they belong to it, and go with it.
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

    /// How far the knob goes in a scene of these parameters; `None` where it would do nothing.
    pub fn range(self, p: &Parameters) -> Option<KnobRange> {
        let mode = p.coupling.mode;
        let scene = self.read(p);
        let stiffness = |most: f64| {
            // Not more than the arm takes, not less than the scene has: what it allows itself stays reachable.
            let most = most.min(MOST_STIFFNESS * scene).max(scene);
            KnobRange { least: scene / LEAST_DIVISOR, most, scene }
        };
        let up_to = |most: f64| KnobRange { least: 0.0, most: most.max(scene), scene };
        let acts = match self {
            // What acts on the virtual tool's velocity needs one.
            Self::ContactDampingRatio => mode.has_mass(),
            Self::FrictionStatic | Self::FrictionDynamic => {
                p.contact.friction.stiffness_n_per_m > 0.0 && mode != CouplingMode::Constraint
            }
            Self::CutoffLow | Self::CutoffHigh => scene.is_finite() && p.filter.cutoff_hz[0].is_finite(),
            Self::CouplingTranslation | Self::CouplingRotation => mode != CouplingMode::Direct,
            Self::ContactStiffness => mode != CouplingMode::Constraint,
            Self::ForceLimit | Self::TorqueLimit => scene > 0.0,
        };
        acts.then(|| match self {
            // Without a virtual tool the arm feels it.
            Self::ContactStiffness if mode == CouplingMode::Direct => stiffness(scene),
            Self::ContactStiffness => stiffness(f64::INFINITY),
            Self::ContactDampingRatio => up_to(MOST_DAMPING_RATIO),
            Self::FrictionStatic | Self::FrictionDynamic => up_to(MOST_FRICTION),
            Self::CutoffLow | Self::CutoffHigh => {
                KnobRange { least: LEAST_CUTOFF_HZ.min(scene), most: (MOST_CUTOFF / p.period_s).max(scene), scene }
            }
            // The tool's mass was chosen for the scene's.
            Self::CouplingTranslation | Self::CouplingRotation if mode == CouplingMode::SemiImplicit => stiffness(scene),
            Self::CouplingTranslation => stiffness(p.coupling.bound_n_per_m),
            Self::CouplingRotation => stiffness(p.coupling.bound_nm_per_rad),
            Self::ForceLimit => KnobRange { least: LEAST_FORCE_N.min(scene / LEAST_DIVISOR), most: scene, scene },
            Self::TorqueLimit => KnobRange { least: LEAST_TORQUE_NM.min(scene / LEAST_DIVISOR), most: scene, scene },
        })
    }

    /// The value that a set of parameters has.
    pub fn read(self, p: &Parameters) -> f64 {
        match self {
            Self::ContactStiffness => p.contact.stiffness_n_per_m,
            Self::ContactDampingRatio => p.contact.damping_ratio,
            Self::FrictionStatic => p.contact.friction.r#static,
            Self::FrictionDynamic => p.contact.friction.dynamic,
            Self::CutoffLow => p.filter.cutoff_hz[0],
            Self::CutoffHigh => p.filter.cutoff_hz[1],
            Self::CouplingTranslation => p.coupling.stiffness_n_per_m,
            Self::CouplingRotation => p.coupling.stiffness_nm_per_rad,
            Self::ForceLimit => p.limits.force_n,
            Self::TorqueLimit => p.limits.torque_nm,
        }
    }

    /// Gives `to` the value that `from` has, to the bit, and with it what follows from that value.
    pub fn copy(self, from: &Parameters, to: &mut Parameters) {
        self.write(to, self.read(from));
        if self == Self::ContactStiffness {
            to.contact.friction.stiffness_n_per_m = from.contact.friction.stiffness_n_per_m;
        }
    }

    fn write(self, p: &mut Parameters, value: f64) {
        match self {
            Self::ContactStiffness => {
                // A face that holds stays as much stiffer than one of its points as the scene says.
                p.contact.friction.stiffness_n_per_m *= value / p.contact.stiffness_n_per_m;
                p.contact.stiffness_n_per_m = value;
            }
            Self::ContactDampingRatio => p.contact.damping_ratio = value,
            Self::FrictionStatic => p.contact.friction.r#static = value,
            Self::FrictionDynamic => p.contact.friction.dynamic = value,
            Self::CutoffLow => p.filter.cutoff_hz[0] = value,
            Self::CutoffHigh => p.filter.cutoff_hz[1] = value,
            Self::CouplingTranslation => p.coupling.stiffness_n_per_m = value,
            Self::CouplingRotation => p.coupling.stiffness_nm_per_rad = value,
            Self::ForceLimit => p.limits.force_n = value,
            Self::TorqueLimit => p.limits.torque_nm = value,
        }
    }
}

/// One knob that somebody has turned.
#[derive(Clone, Copy, Debug)]
struct Turned {
    value: f64,
    target: f64,
    /// Largest change in a tick.
    step: f64,
}

/// Where the knobs stand. No heap.
#[derive(Clone, Debug, Default)]
pub(super) struct Tuning {
    /// In the order of [`Knob::ALL`].
    turned: [Option<Turned>; Knob::ALL.len()],
    is_used: bool,
}

impl Tuning {
    /// The parameters of a tick; a wish counts from the next tick on. A limit without force cannot jump in anybody's hand: it is where it is wished
    /// at once, so that a scene that takes the place of another begins with the limits that a person has chosen. RT: safe, O(1).
    pub(super) fn next(&mut self, scene: &Parameters, wish: Option<Tune>, has_force: bool) -> Parameters {
        match wish {
            Some(Tune { knob, .. }) if knob.is_limit() && !has_force => {
                self.take(scene, wish);
                if let Some(turned) = self.turned.get_mut(knob as usize).and_then(Option::as_mut) {
                    turned.value = turned.target;
                }
                self.parameters(scene)
            }
            _ => {
                let p = self.parameters(scene);
                self.take(scene, wish);
                p
            }
        }
    }

    /// Every knob a step further.
    fn parameters(&mut self, scene: &Parameters) -> Parameters {
        let mut p = *scene;
        if self.is_used {
            for (knob, turned) in Knob::ALL.into_iter().zip(&mut self.turned) {
                if let Some(turned) = turned {
                    turned.value += (turned.target - turned.value).clamp(-turned.step, turned.step);
                    knob.write(&mut p, turned.value);
                }
            }
            p.contact.friction.dynamic = p.contact.friction.dynamic.min(p.contact.friction.r#static);
            p.filter.cutoff_hz[1] = p.filter.cutoff_hz[1].max(p.filter.cutoff_hz[0]);
        }
        p
    }

    fn take(&mut self, scene: &Parameters, wish: Option<Tune>) {
        let Some(Tune { knob, value }) = wish.filter(|wish| wish.value.is_finite()) else { return };
        let (Some(range), Some(turned)) = (knob.range(scene), self.turned.get_mut(knob as usize)) else { return };
        let step = (range.most - range.least) * scene.period_s / FULL_RANGE_S;
        let turned = turned.get_or_insert(Turned { value: range.scene, target: range.scene, step });
        turned.target = value.clamp(range.least, range.most);
        self.is_used = true;
    }
}

#[cfg(test)]
#[expect(clippy::float_cmp, clippy::expect_used, reason = "test code; values that are copied or reached exactly")]
mod tests {
    use super::*;
    use crate::FrictionParameters;
    use crate::testing::parameters;

    fn rubbing() -> Parameters {
        let mut p = parameters();
        p.contact.friction = FrictionParameters { r#static: 0.3, dynamic: 0.2, stiffness_n_per_m: 1e4 };
        p.filter.cutoff_hz = [50.0, 300.0];
        p
    }

    #[test]
    fn numbers_and_names_are_those_of_their_place() {
        for (idx, knob) in Knob::ALL.into_iter().enumerate() {
            assert_eq!(knob as usize, idx);
            assert_eq!(Knob::ALL.iter().filter(|other| other.name() == knob.name()).count(), 1);
        }
    }

    #[test]
    fn what_nobody_turned_keeps_its_bits() {
        let p = rubbing();
        let mut tuning = Tuning::default();
        assert_eq!(tuning.next(&p, None, true), p);
        for value in [f64::NAN, f64::INFINITY] {
            tuning.next(&p, Some(Tune { knob: Knob::ContactStiffness, value }), true);
            assert_eq!(tuning.next(&p, None, true), p);
        }
    }

    #[test]
    fn every_knob_goes_to_both_ends_in_time_without_a_jump_and_moves_nothing_else() {
        let p = rubbing();
        for knob in Knob::ALL {
            let range = knob.range(&p).expect("every knob acts in this scene");
            assert!(range.least <= range.scene && range.scene <= range.most, "{knob:?}: {range:?}");
            let mut tuning = Tuning::default();
            for (asked, reached) in [(-1e9, range.least), (1e9, range.most), (range.scene, range.scene)] {
                let mut before = knob.read(&tuning.next(&p, Some(Tune { knob, value: asked }), true));
                for _ in 0..501 {
                    let now = knob.read(&tuning.next(&p, None, true));
                    assert!((now - before).abs() <= (range.most - range.least) / 500.0 * (1.0 + 1e-9), "{knob:?}");
                    before = now;
                }
                // The other one of a pair, which nobody turned, holds these two.
                let reached = match knob {
                    Knob::FrictionDynamic => reached.min(p.contact.friction.r#static),
                    Knob::CutoffHigh => reached.max(p.filter.cutoff_hz[0]),
                    _ => reached,
                };
                assert!(before == reached, "{knob:?}: {before} and not {reached}");
            }
            if knob != Knob::ContactStiffness {
                assert_eq!(tuning.next(&p, None, true), p, "{knob:?}");
            }
        }
    }

    #[test]
    fn a_knob_that_is_copied_is_the_other_s_and_all_of_them_are_what_can_be_turned() {
        let p = rubbing();
        for knob in Knob::ALL {
            let mut other = p;
            knob.write(&mut other, 0.7 * knob.read(&p));
            assert_ne!(other, p, "{knob:?}");
            knob.copy(&p, &mut other);
            assert_eq!(other, p, "{knob:?}");
        }
    }

    #[test]
    fn pairs_hold_each_other_and_friction_stiffness_follows() {
        let p = rubbing();
        let mut tuning = Tuning::default();
        tuning.next(&p, Some(Tune { knob: Knob::FrictionStatic, value: 0.1 }), true);
        tuning.next(&p, Some(Tune { knob: Knob::ContactStiffness, value: 0.5 * p.contact.stiffness_n_per_m }), true);
        let settled = (0..600).map(|_| tuning.next(&p, None, true)).last().expect("ticks");
        assert_eq!((settled.contact.friction.r#static, settled.contact.friction.dynamic), (0.1, 0.1));
        assert_eq!(settled.contact.stiffness_n_per_m, 0.5 * p.contact.stiffness_n_per_m);
        assert_eq!(settled.contact.friction.stiffness_n_per_m, 0.5 * p.contact.friction.stiffness_n_per_m);
    }

    #[test]
    fn a_low_cut_off_that_passes_the_high_one_takes_it_along() {
        let p = rubbing();
        let mut tuning = Tuning::default();
        tuning.next(&p, Some(Tune { knob: Knob::CutoffLow, value: 400.0 }), true);
        let cutoffs: [[f64; 2]; 600] = core::array::from_fn(|_| tuning.next(&p, None, true).filter.cutoff_hz);
        assert!(cutoffs.iter().all(|[low, high]| *high == low.max(300.0)));
        assert!(cutoffs.iter().any(|[low, _]| *low > 300.0 && *low < 400.0) && cutoffs.last() == Some(&[400.0, 400.0]));
    }

    #[test]
    fn without_force_a_limit_is_where_it_is_wished_at_once_and_nothing_else_is() {
        let p = rubbing();
        for knob in Knob::ALL {
            let range = knob.range(&p).expect("acts");
            let low = knob.read(&Tuning::default().next(&p, Some(Tune { knob, value: range.least }), false));
            assert_eq!(low, if knob.is_limit() { range.least } else { range.scene }, "{knob:?}");
        }
        let mut tuning = Tuning::default();
        tuning.next(&p, Some(Tune { knob: Knob::ForceLimit, value: 0.05 }), false);
        assert_eq!(tuning.next(&p, None, true).limits.force_n, 0.05);
        assert_eq!(tuning.next(&p, Some(Tune { knob: Knob::ForceLimit, value: f64::MAX }), false), p);
        assert!(Knob::LIMITS.into_iter().all(|knob| knob.range(&p).is_some_and(|range| range.least <= 0.05)));
    }

    #[test]
    fn nothing_exceeds_what_the_arm_takes() {
        let mut p = rubbing();
        (p.coupling.stiffness_n_per_m, p.coupling.bound_n_per_m) = (800.0, 1000.0);
        assert_eq!(Knob::CouplingTranslation.range(&p).expect("acts").most, 1000.0);
        p.coupling.mode = CouplingMode::SemiImplicit;
        assert_eq!(Knob::CouplingTranslation.range(&p).expect("acts").most, 800.0);
        p.coupling.mode = CouplingMode::Direct;
        assert_eq!(Knob::CouplingTranslation.range(&p), None);
        assert_eq!(Knob::ContactStiffness.range(&p).expect("acts").most, p.contact.stiffness_n_per_m);
        assert_eq!(Knob::ForceLimit.range(&p).expect("acts").most, p.limits.force_n);
    }
}
