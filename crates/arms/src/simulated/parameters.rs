//! What a simulated arm and its hand are made of, and which numbers the plant can follow.

use crate::profile::{Plant, Profile};
use crate::simulated::fault::FaultPlan;
use crate::simulated::hand::GripPath;
use crate::velocity::{DEFAULT_WINDOW_ANGULAR_S, DEFAULT_WINDOW_LINEAR_S};
use vps::spatial::Axes;

/// The hand that holds the grip.
#[derive(Clone, Debug, PartialEq)]
pub struct HandParameters {
    /// Stiffness between the hand's target and the grip, N/m.
    pub stiffness_n_per_m: f64,
    /// Damping, N·s/m.
    pub damping_n_s_per_m: f64,
    /// Mass of the hand that moves with the grip, kg.
    pub mass_kg: f64,
    /// Rotational stiffness, N·m/rad.
    pub stiffness_nm_per_rad: f64,
    /// Rotational damping, N·m·s/rad.
    pub damping_nm_s_per_rad: f64,
    /// Inertia of the hand that turns with the grip, kg·m².
    pub inertia_kg_m2: f64,
    /// Where the hand wants to be; `None`: at the zero pose.
    pub path: Option<GripPath>,
}

impl Default for HandParameters {
    /// A relaxed grip. The linear values are those of the device reference (assumed there; human
    /// hand damping is quoted as 1–10 N·s/m). The rotational ones are assumed: 3 N·m/rad and 0.03
    /// N·m·s/rad turn the grip with about 12 Hz and ζ = 0.4 against the hand's inertia of 5·10⁻⁴
    /// kg·m², a wrist that holds a pen.
    fn default() -> Self {
        Self {
            stiffness_n_per_m: 500.0,
            damping_n_s_per_m: 5.0,
            mass_kg: 0.15,
            stiffness_nm_per_rad: 3.0,
            damping_nm_s_per_rad: 0.03,
            inertia_kg_m2: 5e-4,
            path: None,
        }
    }
}

/// Everything that makes one simulated arm.
#[derive(Clone, Debug, PartialEq)]
pub struct SimParameters {
    /// Time that one `read` takes in the simulated world, s.
    pub period_s: f64,
    /// What the arm is made of.
    pub plant: Plant,
    /// The hand; `None`: no hand holds the grip.
    pub hand: Option<HandParameters>,
    /// Axes that exist and are measured.
    pub sensed: Axes,
    /// Axes with a motor.
    pub actuated: Axes,
    /// Largest |F| of the motors, N.
    pub force_limit_n: f64,
    /// Largest |τ| of the motors, N·m.
    pub torque_limit_nm: f64,
    /// Window of the linear velocity, s.
    pub window_linear_s: f64,
    /// Window of the angular velocity, s.
    pub window_angular_s: f64,
    /// The arm drops its command when none came for this long.
    pub watchdog_ms: Option<u32>,
    /// Reported as is: the motors would keep the last command if the host went away.
    pub holds_last_command: bool,
    /// Homed at power-on.
    pub homed: bool,
    /// What goes wrong, if anything.
    pub fault: Option<FaultPlan>,
    /// Seed of everything random.
    pub seed: u64,
}

impl SimParameters {
    /// The twin of a profile's arm, at home and sound.
    pub fn of(profile: &Profile, hand: Option<HandParameters>, period_s: f64) -> Self {
        let [window_linear_s, window_angular_s] =
            profile.velocity_window_ms.map(|window_ms| window_ms * 1e-3);
        Self {
            period_s,
            plant: profile.plant,
            hand,
            sensed: profile.sensed,
            actuated: profile.actuated,
            force_limit_n: profile.limits.force_n,
            torque_limit_nm: profile.limits.torque_nm,
            window_linear_s,
            window_angular_s,
            watchdog_ms: profile.link.device_watchdog_ms,
            holds_last_command: profile.link.holds_last_command,
            homed: true,
            fault: None,
            seed: 0,
        }
    }

    /// An arm without mass to speak of, friction, steps, delay or limits that matter: six axes, for
    /// analytic checks.
    pub fn ideal(period_s: f64) -> Self {
        Self {
            period_s,
            plant: Plant {
                mass_kg: 1e-3,
                damping_n_s_per_m: 0.0,
                inertia_kg_m2: 2e-4,
                damping_nm_s_per_rad: 0.0,
                coulomb_n: 0.0,
                coulomb_nm: 0.0,
                encoder_step_m: 0.0,
                encoder_step_rad: 0.0,
                delay_ticks: 0,
            },
            hand: Some(HandParameters::default()),
            sensed: Axes::SIX,
            actuated: Axes::SIX,
            force_limit_n: 100.0,
            torque_limit_nm: 10.0,
            window_linear_s: DEFAULT_WINDOW_LINEAR_S,
            window_angular_s: DEFAULT_WINDOW_ANGULAR_S,
            watchdog_ms: Some(100),
            holds_last_command: false,
            homed: true,
            fault: None,
            seed: 0,
        }
    }
}

/// Why an arm cannot be simulated.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum SimError {
    /// A value is negative, zero where it must not be, or not finite.
    #[error("simulated arm: {name} = {value} must be {expected}")]
    Range {
        /// Name of the value.
        name: &'static str,
        /// The value.
        value: f64,
        /// What would be accepted.
        expected: &'static str,
    },
    /// The hand is too stiff for the mass it holds.
    #[error("simulated arm: {name} = {value} is too stiff for the moving mass, at most {largest}")]
    TooStiff {
        /// Name of the value.
        name: &'static str,
        /// The value.
        value: f64,
        /// Largest value that the plant's step can follow.
        largest: f64,
    },
}

/// What a value must be.
#[derive(Clone, Copy)]
enum Must {
    BePositive,
    NotBeNegative,
}

/// The numbers of a plant and its hand, with what each must be.
fn numbers_of(
    period_s: f64,
    plant: &Plant,
    hand: &HandParameters,
) -> [(&'static str, f64, Must); 15] {
    use Must::{BePositive, NotBeNegative};
    [
        ("period_s", period_s, BePositive),
        ("mass_kg", plant.mass_kg, BePositive),
        ("inertia_kg_m2", plant.inertia_kg_m2, BePositive),
        ("damping_n_s_per_m", plant.damping_n_s_per_m, NotBeNegative),
        ("damping_nm_s_per_rad", plant.damping_nm_s_per_rad, NotBeNegative),
        ("coulomb_n", plant.coulomb_n, NotBeNegative),
        ("coulomb_nm", plant.coulomb_nm, NotBeNegative),
        ("encoder_step_m", plant.encoder_step_m, NotBeNegative),
        ("encoder_step_rad", plant.encoder_step_rad, NotBeNegative),
        ("hand_stiffness_n_per_m", hand.stiffness_n_per_m, NotBeNegative),
        ("hand_damping_n_s_per_m", hand.damping_n_s_per_m, NotBeNegative),
        ("hand_mass_kg", hand.mass_kg, NotBeNegative),
        ("hand_stiffness_nm_per_rad", hand.stiffness_nm_per_rad, NotBeNegative),
        ("hand_damping_nm_s_per_rad", hand.damping_nm_s_per_rad, NotBeNegative),
        ("hand_inertia_kg_m2", hand.inertia_kg_m2, NotBeNegative),
    ]
}

/// Checks what the plant's step takes.
pub(super) fn check_plant(
    period_s: f64,
    plant: &Plant,
    hand: &HandParameters,
) -> Result<(), SimError> {
    check_ranges(&numbers_of(period_s, plant, hand))
}

/// Checks the windows of the velocity.
pub(super) fn check_windows(linear_s: f64, angular_s: f64) -> Result<(), SimError> {
    check_ranges(&[
        ("velocity_window_linear_s", linear_s, Must::NotBeNegative),
        ("velocity_window_angular_s", angular_s, Must::NotBeNegative),
    ])
}

fn check_ranges(values: &[(&'static str, f64, Must)]) -> Result<(), SimError> {
    for &(name, value, must) in values {
        let (fine, expected) = match must {
            Must::BePositive => (value > 0.0, "above zero"),
            Must::NotBeNegative => (value >= 0.0, "zero or above"),
        };
        if !(fine && value.is_finite()) {
            return Err(SimError::Range { name, value, expected });
        }
    }
    Ok(())
}
