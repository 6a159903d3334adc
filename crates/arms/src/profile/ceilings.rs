//! The largest values that a profile may declare. What the loop holds back follows from them, so no
//! number may be so large that nothing is held back; each is well above every arm that is known.

/// Force at the grip, N. Below the 140 N with which ISO/TS 15066 lets a robot press on a hand for
/// long.
pub const FORCE_N: f64 = 100.0;
/// Torque at the grip, N·m.
pub const TORQUE_NM: f64 = 10.0;
/// Rendered stiffness, N/m: a hundred newtons in a millimetre, ten times that of the stiffest arms.
pub(super) const STIFFNESS_N_PER_M: f64 = 1e5;
/// The same in rotation, N·m/rad.
pub(super) const STIFFNESS_NM_PER_RAD: f64 = 100.0;
/// Viscosity, rendered or the arm's own, N·s/m: the force limit at 0.1 m/s. The stability bound
/// grows with it.
pub(super) const DAMPING_N_S_PER_M: f64 = 1000.0;
/// The same in rotation, N·m·s/rad.
pub(super) const DAMPING_NM_S_PER_RAD: f64 = 10.0;
/// Radius of the workspace, m: outside of it no force flows. A room-sized arm has 2 m.
pub(super) const WORKSPACE_RADIUS_M: f64 = 5.0;
/// Apparent mass at the grip, kg.
pub(super) const MASS_KG: f64 = 100.0;
/// Apparent inertia at the grip, kg·m².
pub(super) const INERTIA_KG_M2: f64 = 10.0;
/// Step of a measured position, mm: a pose that repeats is only suspicious where it should have
/// moved by several.
pub(super) const ENCODER_STEP_MM: f64 = 10.0;
/// Step of a measured angle, rad.
pub(super) const ENCODER_STEP_RAD: f64 = 0.1;
/// Silence after which an arm lets go by itself, ms: one that takes longer has no watchdog.
pub(super) const WATCHDOG_MS: u32 = 10_000;
/// Current of a motor, mA.
pub(super) const CURRENT_MA: f64 = 50_000.0;
/// Torque of a joint at the limit of its motor, N·m; force of one that slides, N.
pub(super) const JOINT_NM: f64 = 100.0;
/// Real current or torque per commanded one: more or less is an error of unit.
pub(super) const MOTOR_SCALE: [f64; 2] = [0.1, 10.0];
/// Mass of a link whose weight the motors hold, g.
pub(super) const LINK_MASS_G: f64 = 10_000.0;
/// Distance of a link's centre of mass from its joint, mm.
pub(super) const LINK_CENTER_MM: f64 = 2000.0;
/// Damping that is added to the torque of a joint, N·m·s/rad: fifty times the default.
pub(super) const JOINT_DAMPING_NM_S_PER_RAD: f64 = 1.0;
/// Time constant of a winding, s: that of a motor of several kilograms.
pub(super) const THERMAL_TIME_S: f64 = 600.0;
