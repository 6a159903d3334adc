//! Device profiles: hardware as data.
//!
//! Data in: a TOML file of `devices/`, embedded in the program, or one that a scene names by path. Data out: a checked [`Profile`].
//! `devices/README.md` describes the format.

use std::fs;
use std::path::{Path, PathBuf};

use serde::Deserialize;
use serde::de::IgnoredAny;

use crate::config::checks::{Checks, FINITE, Interval};
use crate::config::document::Document;
use crate::config::problem::{ConfigErrors, Problem, ProblemKind, nearest};
use crate::config::schema::{Numbers, words};
use crate::device::Pacing;
use crate::spatial::Axes;

/// A loaded profile.
#[derive(Clone, Debug, PartialEq)]
pub struct Profile {
    /// Short name, as scenes write it.
    pub name: String,
    /// Name for people.
    pub title: String,
    /// Which driver speaks to the arm.
    pub codec: Codec,
    /// Axes that the arm senses.
    pub sensed: Axes,
    /// Axes that the arm actuates; a subset of `sensed`.
    pub actuated: Axes,
    /// What the arm takes.
    pub limits: ProfileLimits,
    /// How reports and commands travel.
    pub link: Link,
    /// Windows over which position and orientation are differentiated, ms.
    pub velocity_window_ms: [f64; 2],
    /// What the simulated twin is made of.
    pub plant: Plant,
}

/// A driver.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Codec {
    /// The in-process simulated arm.
    Sim,
}

/// Hard limits of an arm, declared by its maker.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ProfileLimits {
    /// Largest |F|, N; 0 where no translation is actuated.
    pub force_n: f64,
    /// Largest |τ|, N·m; 0 where no rotation is actuated.
    pub torque_nm: f64,
    /// Largest translational stiffness, N/m; `None`: no bound, for an ideal arm only.
    pub stiffness_n_per_m: Option<f64>,
    /// Largest rotational stiffness, N·m/rad; `None`: no bound.
    pub stiffness_nm_per_rad: Option<f64>,
    /// Largest rendered damping, N·s/m; `None`: no bound.
    pub damping_n_s_per_m: Option<f64>,
    /// Largest rendered rotational damping, N·m·s/rad; `None`: no bound.
    pub damping_nm_s_per_rad: Option<f64>,
    /// Radius of the ball around the device origin in which the grip moves, m.
    pub workspace_radius_m: f64,
}

/// How reports and commands travel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Link {
    /// Who sets the rate.
    pub pacing: Pacing,
    /// Nominal rate, Hz.
    pub rate_hz: u32,
    /// Silence after which the device itself lets go, ms; `None`: never, the last command stays on.
    pub device_watchdog_ms: Option<u32>,
    /// True when the motors keep the last command after the link closes.
    pub holds_last_command: bool,
}

/// A simulated arm: mass and viscosity at the grip, friction, sensor steps, delay.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plant {
    /// Apparent mass, kg.
    pub mass_kg: f64,
    /// Viscosity b, N·s/m.
    pub damping_n_s_per_m: f64,
    /// Apparent inertia, kg·m².
    pub inertia_kg_m2: f64,
    /// Rotational viscosity, N·m·s/rad.
    pub damping_nm_s_per_rad: f64,
    /// Coulomb friction, N.
    pub coulomb_n: f64,
    /// Coulomb friction, N·m.
    pub coulomb_nm: f64,
    /// Step of a measured position, m; 0: continuous.
    pub encoder_step_m: f64,
    /// Step of a measured angle, rad: the rotation vector from the zero pose is rounded per axis; 0: continuous.
    pub encoder_step_rad: f64,
    /// Ticks from a command to its force; at 0 it acts in the period after the `write`.
    pub delay_ticks: u32,
}

/// The shipped profiles: name and text.
const EMBEDDED: [(&str, &str); 5] = [
    ("sim-ideal", include_str!("../../devices/sim-ideal.toml")),
    ("sim-polhem", include_str!("../../devices/sim-polhem.toml")),
    ("sim-premium15-6dof", include_str!("../../devices/sim-premium15-6dof.toml")),
    ("sim-sigma7", include_str!("../../devices/sim-sigma7.toml")),
    ("sim-touch", include_str!("../../devices/sim-touch.toml")),
];

/// Names of the shipped profiles, in alphabetical order.
pub fn names() -> impl Iterator<Item = &'static str> {
    EMBEDDED.iter().map(|(name, _)| *name)
}

/// Why a profile was not found or not accepted.
#[derive(Debug, thiserror::Error)]
pub enum ProfileError {
    /// No shipped profile of that name.
    #[error("no device profile of this name; known: {}", .known.join(", "))]
    Unknown {
        /// The known name that looks most like it.
        nearest: Option<String>,
        /// All known names.
        known: Vec<String>,
    },
    /// No file at that path.
    #[error("no such file: {}", .path.display())]
    FileMissing {
        /// The path as looked up.
        path: PathBuf,
    },
    /// The profile itself is wrong.
    #[error(transparent)]
    Invalid(#[from] ConfigErrors),
}

/// Finds a profile: a value with a `/` or ending in `.toml` is a path from `base_dir`, anything else the name of a shipped profile.
///
/// # Errors
/// [`ProfileError`]: nothing of that name or path, or every problem of the first pass over it that found any.
pub fn find(name_or_path: &str, base_dir: &Path) -> Result<Profile, ProfileError> {
    if name_or_path.contains('/') || name_or_path.ends_with(".toml") {
        let path = base_dir.join(name_or_path);
        if !path.is_file() {
            return Err(ProfileError::FileMissing { path });
        }
        return Ok(load(&path)?);
    }
    match EMBEDDED.iter().find(|(name, _)| *name == name_or_path) {
        Some((name, text)) => Ok(parse(&PathBuf::from(format!("devices/{name}.toml")), text)?),
        None => {
            let known = names().map(str::to_owned).collect();
            Err(ProfileError::Unknown { nearest: nearest(name_or_path, names()), known })
        }
    }
}

/// Loads a profile file.
///
/// # Errors
/// Every problem of the first pass that found any.
pub fn load(path: &Path) -> Result<Profile, ConfigErrors> {
    let text = fs::read_to_string(path)
        .map_err(|cause| ConfigErrors::new(vec![Problem::of_file(path, ProblemKind::Unreadable { cause })]))?;
    parse(path, &text)
}

fn parse(path: &Path, text: &str) -> Result<Profile, ConfigErrors> {
    let document = Document::parse(path, text)?;
    // The codec decides which tables a profile has, so it is read before them.
    if let Some(codec) = document.string("device.codec")
        && LATER_CODECS.contains(&codec)
    {
        let accepted = "this version drives simulated arms, codec \"sim\"".to_owned();
        return Err(ConfigErrors::new(vec![document.problem("device.codec", ProblemKind::NotAvailable { accepted })]));
    }
    resolve(&document, &document.read()?)
}

/// Drivers that the format knows and this version lacks.
const LATER_CODECS: [&str; 12] = [
    "woodenhaptics-hid8",
    "haptikfabriken-hid14",
    "polhem-ascii64",
    "haptikfabriken-brackets",
    "hapi-f32",
    "haply-service",
    "falcon-nibble16",
    "hapkit-ascii",
    "3dconnexion-hid",
    "dynamixel2",
    "openffboard-hid",
    "declarative",
];

/// The file as written.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "a device profile")]
struct Written {
    #[serde(rename = "version")]
    _version: Option<IgnoredAny>,
    device: WrittenDevice,
    link: WrittenLink,
    limits: WrittenLimits,
    signal: WrittenSignal,
    plant: WrittenPlant,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "a table, written [device]")]
struct WrittenDevice {
    name: Option<String>,
    title: Option<String>,
    codec: Option<CodecWord>,
    sensed: Option<Vec<String>>,
    actuated: Option<Vec<String>>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "a table, written [link]")]
struct WrittenLink {
    pacing: Option<PacingWord>,
    rate_hz: Option<u32>,
    device_watchdog_ms: Option<u32>,
    holds_last_command: Option<bool>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "a table, written [limits]")]
struct WrittenLimits {
    force_n: Option<f64>,
    torque_nm: Option<f64>,
    stiffness_n_per_m: Option<f64>,
    stiffness_nm_per_rad: Option<f64>,
    damping_n_s_per_m: Option<f64>,
    damping_nm_s_per_rad: Option<f64>,
    workspace_radius_m: Option<f64>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "a table, written [signal]")]
struct WrittenSignal {
    velocity_window_ms: Option<Numbers<2>>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "a table, written [plant]")]
struct WrittenPlant {
    mass_kg: Option<f64>,
    damping_n_s_per_m: Option<f64>,
    inertia_kg_m2: Option<f64>,
    damping_nm_s_per_rad: Option<f64>,
    coulomb_n: Option<f64>,
    coulomb_nm: Option<f64>,
    encoder_step_mm: Option<f64>,
    encoder_step_rad: Option<f64>,
    delay_ticks: Option<u32>,
}

words! {
    CodecWord { Sim = "sim" }
    PacingWord { PingPong = "ping-pong", Stream = "stream", Event = "event", Service = "service" }
}

fn resolve(document: &Document<'_>, written: &Written) -> Result<Profile, ConfigErrors> {
    const NOT_NEGATIVE: Interval = Interval::from(0.0);
    const POSITIVE: Interval = Interval::above(0.0);
    let mut checks = Checks::new(document);
    let Written { device, link, limits, signal, plant, .. } = written;

    let name = device.name.clone().unwrap_or_default();
    if name.is_empty() {
        checks.missing("device.name", "the name that scenes write");
    }
    let codec = match device.codec {
        Some(CodecWord::Sim) => Codec::Sim,
        None => {
            checks.missing("device.codec", "\"sim\"");
            Codec::Sim
        }
    };
    let sensed = axes(&mut checks, "device.sensed", device.sensed.as_deref());
    let actuated = axes(&mut checks, "device.actuated", device.actuated.as_deref());
    if !sensed.contains(actuated) {
        let sensed: Vec<&str> = sensed.names().collect();
        checks.not_accepted("device.actuated", format_args!("a subset of device.sensed, {}", sensed.join(" ")));
    }

    let force_n = limit(&mut checks, "limits.force_n", limits.force_n, actuated, Axes::TRANSLATION);
    let torque_nm = limit(&mut checks, "limits.torque_nm", limits.torque_nm, actuated, Axes::ROTATION);
    let limits = ProfileLimits {
        force_n,
        torque_nm,
        stiffness_n_per_m: checks.optional("limits.stiffness_n_per_m", limits.stiffness_n_per_m, POSITIVE),
        stiffness_nm_per_rad: checks.optional("limits.stiffness_nm_per_rad", limits.stiffness_nm_per_rad, POSITIVE),
        damping_n_s_per_m: checks.optional("limits.damping_n_s_per_m", limits.damping_n_s_per_m, NOT_NEGATIVE),
        damping_nm_s_per_rad: checks.optional("limits.damping_nm_s_per_rad", limits.damping_nm_s_per_rad, NOT_NEGATIVE),
        workspace_radius_m: checks.required("limits.workspace_radius_m", limits.workspace_radius_m, POSITIVE.to(10.0).unit("m")),
    };

    let pacing = match link.pacing {
        Some(PacingWord::PingPong) => Pacing::PingPong,
        Some(PacingWord::Stream) => Pacing::Stream,
        Some(PacingWord::Event) => Pacing::Event,
        Some(PacingWord::Service) => Pacing::Service,
        None => {
            checks.missing("link.pacing", "who sets the rate: \"ping-pong\", \"stream\", \"event\" or \"service\"");
            Pacing::Stream
        }
    };
    if link.holds_last_command.is_none() {
        checks.missing("link.holds_last_command", "true or false: whether the motors keep the last command when the link closes");
    }
    let link = Link {
        pacing,
        rate_hz: checks.whole("link.rate_hz", link.rate_hz, 1000, 1, 10_000),
        device_watchdog_ms: link.device_watchdog_ms,
        holds_last_command: link.holds_last_command.unwrap_or(true),
    };

    let window = Interval::from(0.0).to(1000.0).unit("ms");
    let velocity_window_ms = checks.array("signal.velocity_window_ms", signal.velocity_window_ms, window).unwrap_or([15.0, 30.0]);

    let plant = Plant {
        mass_kg: checks.required("plant.mass_kg", plant.mass_kg, POSITIVE),
        damping_n_s_per_m: checks.required("plant.damping_n_s_per_m", plant.damping_n_s_per_m, NOT_NEGATIVE),
        inertia_kg_m2: checks.required("plant.inertia_kg_m2", plant.inertia_kg_m2, POSITIVE),
        damping_nm_s_per_rad: checks.required("plant.damping_nm_s_per_rad", plant.damping_nm_s_per_rad, NOT_NEGATIVE),
        coulomb_n: checks.required("plant.coulomb_n", plant.coulomb_n, NOT_NEGATIVE),
        coulomb_nm: checks.required("plant.coulomb_nm", plant.coulomb_nm, NOT_NEGATIVE),
        encoder_step_m: checks.required("plant.encoder_step_mm", plant.encoder_step_mm, NOT_NEGATIVE) * 1e-3,
        encoder_step_rad: checks.required("plant.encoder_step_rad", plant.encoder_step_rad, NOT_NEGATIVE),
        delay_ticks: checks.whole("plant.delay_ticks", plant.delay_ticks, 1, 0, 100),
    };
    checks.finish()?;
    let title = device.title.clone().unwrap_or_else(|| name.clone());
    Ok(Profile { name, title, codec, sensed, actuated, limits, link, velocity_window_ms, plant })
}

fn axes(checks: &mut Checks<'_>, key: &str, written: Option<&[String]>) -> Axes {
    let Some(names) = written else {
        checks.missing(key, "an array of axes out of x, y, z, rx, ry, rz, grip");
        return Axes::NONE;
    };
    let mut axes = Axes::NONE;
    for (index, name) in names.iter().enumerate() {
        let key = format!("{key}[{index}]");
        match Axes::from_name(name) {
            Some(axis) if axes.contains(axis) => checks.not_accepted(&key, "an axis that was not named before"),
            Some(axis) => axes = axes.union(axis),
            None => {
                let known = Axes::NAMES.map(str::to_owned).to_vec();
                checks.refuse(&key, ProblemKind::UnknownWord { nearest: nearest(name, Axes::NAMES), known });
            }
        }
    }
    axes
}

/// A force or torque limit: zero exactly where none of the axes is actuated.
fn limit(checks: &mut Checks<'_>, key: &str, written: Option<f64>, actuated: Axes, axes: Axes) -> f64 {
    let is_actuated = axes.names().any(|name| Axes::from_name(name).is_some_and(|axis| actuated.contains(axis)));
    let number = checks.required(key, written, FINITE);
    if is_actuated && number <= 0.0 {
        checks.not_accepted(key, "greater than 0: device.actuated names axes that it limits");
    } else if !is_actuated && number != 0.0 && number.is_finite() {
        checks.not_accepted(key, "0: device.actuated names none of its axes");
    }
    number
}
