//! Contact, filter and coupling.

use super::super::bound;
use super::super::schema::{self, Cutoff};
use super::{MM, Resolve};
use arms::profile::Profile;
use document::{Interval, POSITIVE, ProblemKind};
use engine::arm_rules::{
    StabilityBounds, StiffnessBound, UNBOUNDED_N_PER_M, UNBOUNDED_NM_PER_RAD, or_if_infinite,
};
use haptics::{
    ContactParameters, CouplingMode, CouplingParameters, FilterParameters, FreeSpace,
    FrictionParameters, SpringClamp,
};
use vps::contact::AVERAGED_CONTACTS;
use vps::contact::Normalization;
use vps::voxmap::field::FieldKind;

const DEFAULT_DAMPING_RATIO: f64 = 0.7;
const DEFAULT_CUTOFF_HZ: [f64; 2] = [50.0, 300.0];

impl Resolve<'_> {
    pub(super) fn filter(&mut self, written: &schema::Filter) -> FilterParameters {
        let cutoff_hz = match written.cutoff_hz {
            None => DEFAULT_CUTOFF_HZ,
            Some(Cutoff::Off(_)) => [f64::INFINITY; 2],
            Some(Cutoff::Range(range)) => {
                let range = self.checks.array("filter.cutoff_hz", Some(range), POSITIVE.unit("Hz"));
                let range = range.unwrap_or(DEFAULT_CUTOFF_HZ);
                if range[0] > range[1] {
                    self.checks.not_accepted(
                        "filter.cutoff_hz",
                        "[lowest, highest] in Hz, the lowest first",
                    );
                }
                range
            }
        };
        FilterParameters { cutoff_hz }
    }

    pub(super) fn coupling(
        &mut self,
        written: &schema::Coupling,
        mode: CouplingMode,
        stability: &StabilityBounds,
        scale: f64,
        profile: Option<&Profile>,
    ) -> CouplingParameters {
        let StabilityBounds { translation, rotation, allow_unstable } = *stability;
        let stiffness_n_per_m = match self.checks.optional(
            "coupling.translation_n_per_mm",
            written.translation_n_per_mm,
            POSITIVE.to(1e6).unit("N/mm"),
        ) {
            Some(n_per_mm) => n_per_mm / MM,
            None => or_if_infinite(translation.value() / scale, UNBOUNDED_N_PER_M),
        };
        let stiffness_nm_per_rad = match self.checks.optional(
            "coupling.rotation_nm_per_rad",
            written.rotation_nm_per_rad,
            POSITIVE.to(1e6).unit("N·m/rad"),
        ) {
            Some(nm_per_rad) => nm_per_rad,
            None => or_if_infinite(rotation.value(), UNBOUNDED_NM_PER_RAD),
        };
        // In `direct` mode the arm does not feel the coupling.
        if !allow_unstable && mode != CouplingMode::Direct {
            self.bounded(
                "coupling.translation_n_per_mm",
                stiffness_n_per_m,
                &translation,
                TRANSLATION_UNITS,
                scale,
            );
            self.bounded(
                "coupling.rotation_nm_per_rad",
                stiffness_nm_per_rad,
                &rotation,
                ROTATION_UNITS,
                1.0,
            );
        }
        let damping = profile.and_then(|profile| profile.limits.damping_n_s_per_m);
        let damping_rotation = profile.and_then(|profile| profile.limits.damping_nm_s_per_rad);
        CouplingParameters {
            mode,
            stiffness_n_per_m,
            stiffness_nm_per_rad,
            felt_damping_n_s_per_m: self.felt_damping(
                "coupling.damping_n_s_per_m",
                written.damping_n_s_per_m,
                damping,
                "N·s/m",
                scale,
            ),
            felt_damping_nm_s_per_rad: self.felt_damping(
                "coupling.damping_nm_s_per_rad",
                written.damping_nm_s_per_rad,
                damping_rotation,
                "N·m·s/rad",
                1.0,
            ),
            clamp: written.clamp.map_or(SpringClamp::Saturate, Into::into),
            free_space: written.free_space.map_or(FreeSpace::Zero, Into::into),
            // In world units, like the stiffness that they bound.
            bound_n_per_m: if allow_unstable { f64::INFINITY } else { translation.value() / scale },
            bound_nm_per_rad: if allow_unstable { f64::INFINITY } else { rotation.value() },
        }
    }

    /// Refuses a stiffness (SI, world) that the arm would feel above its bound.
    pub(super) fn bounded(
        &mut self,
        key: &str,
        stiffness: f64,
        bound: &StiffnessBound,
        units: StiffnessUnits,
        scale: f64,
    ) {
        let felt = scale * stiffness;
        if bound.admits(felt) {
            return;
        }
        let accepted = bound.value() / scale * units.key_per_si;
        let kind = ProblemKind::StiffnessAboveBound {
            felt,
            felt_unit: units.si,
            bound: bound.value(),
            rule: bound::rule(bound),
            accepted,
            unit: units.key,
        };
        self.checks.refuse(key, kind);
    }

    fn felt_damping(
        &mut self,
        key: &str,
        written: Option<f64>,
        declared: Option<f64>,
        unit: &'static str,
        scale: f64,
    ) -> f64 {
        let damping = self.checks.number(key, written, 0.0, Interval::from(0.0).to(1e4).unit(unit));
        if let Some(declared) = declared
            && scale * damping > declared
        {
            self.checks.refuse(
                key,
                ProblemKind::DampingAboveProfile { accepted: declared / scale, declared, unit },
            );
        }
        damping
    }

    pub(super) fn contact(
        &mut self,
        written: &schema::Contact,
        field: FieldKind,
        mode: CouplingMode,
        stiffness_n_per_m: f64,
    ) -> ContactParameters {
        let range = Interval::from(0.0).to(1e4).unit("N·s/m");
        let damping_n_s_per_m =
            self.checks.number("contact.damping_n_s_per_m", written.damping_n_s_per_m, 0.0, range);
        let braking = written.braking.unwrap_or(false);
        ContactParameters {
            field,
            stiffness_n_per_m,
            damping_ratio: self.checks.number(
                "contact.damping_ratio",
                written.damping_ratio,
                DEFAULT_DAMPING_RATIO,
                Interval::from(0.0).to(10.0),
            ),
            normalization: written.normalize.map_or(Normalization::None, Into::into),
            friction: self.friction(written.friction.as_ref(), stiffness_n_per_m),
            damping_n_s_per_m: self.of_a_mass(
                mode,
                "contact.damping_n_s_per_m",
                damping_n_s_per_m,
                damping_n_s_per_m > 0.0,
            ),
            braking: self.of_a_mass(mode, "contact.braking", braking, braking),
        }
    }

    /// A value that acts on the velocity of the virtual tool: without mass it has none of its own.
    fn of_a_mass<T>(&mut self, mode: CouplingMode, key: &str, value: T, acts: bool) -> T {
        if acts && !mode.has_mass() {
            let accepted = "left out with this rendering.coupling, whose virtual tool has no mass \
                and so no velocity to take from; that of \"implicit\" has one";
            self.checks.not_accepted(key, accepted);
        }
        value
    }

    /// No friction unless it is written, but the stiffness that it would have: coefficients can be
    /// set later. One counts for both.
    fn friction(
        &mut self,
        written: Option<&schema::Friction>,
        stiffness_n_per_m: f64,
    ) -> FrictionParameters {
        // A face that holds is as stiff along the wall as ten of its points are into it.
        let unwritten = FrictionParameters {
            stiffness_n_per_m: AVERAGED_CONTACTS * stiffness_n_per_m,
            ..FrictionParameters::NONE
        };
        let Some(written) = written else { return unwritten };
        let range = Interval::from(0.0).to(5.0);
        if written.holding.is_none() && written.sliding.is_none() {
            self.checks.missing("contact.friction", "static, dynamic or both; one counts for both");
        }
        let holding = written.holding.or(written.sliding);
        let holding = self.checks.number("contact.friction.static", holding, 0.0, range);
        let sliding = self.checks.number(
            "contact.friction.dynamic",
            written.sliding,
            holding,
            Interval::from(0.0).to(holding),
        );
        FrictionParameters { r#static: holding, dynamic: sliding, ..unwritten }
    }
}

/// Units of a stiffness: inside, and in its key.
#[derive(Clone, Copy)]
pub(super) struct StiffnessUnits {
    pub(super) si: &'static str,
    pub(super) key: &'static str,
    pub(super) key_per_si: f64,
}

pub(super) const TRANSLATION_UNITS: StiffnessUnits =
    StiffnessUnits { si: "N/m", key: "N/mm", key_per_si: MM };
const ROTATION_UNITS: StiffnessUnits =
    StiffnessUnits { si: "N·m/rad", key: "N·m/rad", key_per_si: 1.0 };
