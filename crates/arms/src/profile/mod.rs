//! Device profiles: hardware as data.
//!
//! Data in: a TOML file of `devices/`, embedded in the program, or one that a scene names by path.
//! Data out: a checked [`Profile`]. `devices/README.md` describes the format,
//! `devices/profile.schema.json` is for editors.
//!
//! | file | owns |
//! |---|---|
//! | `mod` | what every arm has, and where profiles are found |
//! | `real` | what an arm of metal has beside that |
//! | `written` | the file as it is written |
//! | `resolve` | ranges and cross-checks of what every arm has |
//! | `ceilings` | the largest values that may be declared |
//! | `wiring` | those of match, protocol and link |
//! | `joints` | those of kinematics and transmission |
//! | `packet` | those of frames described as data |
//! | `known_answers` | `[[check]]`: what the rest of the file has to agree with |
//! | `plausibility` | what may be written, and no arm is likely to be |

pub mod ceilings;
mod joints;
mod known_answers;
mod packet;
mod plausibility;
mod real;
mod resolve;
#[cfg(test)]
mod tests;
mod wiring;
mod written;

use std::path::{Path, PathBuf};

pub use plausibility::SlowLink;
pub(crate) use real::{Check, Identified, Saturation};
pub use real::{Homing, HomingMode, Match, RealArm, TransportKind, UsbId};

use crate::Pacing;
use crate::parameters::MotorLimits;
use crate::protocol::Protocol;
use document::{ConfigErrors, Document, Problem, ProblemKind, nearest};
use vps::spatial::Axes;
use vps::storage::regular;

/// JSON schema of a profile file, from the types that read it.
pub fn schema() -> schemars::Schema {
    schemars::schema_for!(written::ProfileFile)
}

/// A loaded profile.
#[derive(Clone, Debug, PartialEq)]
pub struct Profile {
    /// Short name, as scenes write it.
    pub name: String,
    /// The file that it was read from; `None`: a shipped one.
    pub source: Option<PathBuf>,
    /// Name for people.
    pub title: String,
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
    /// What an arm of metal has beside that; `None`: a simulated arm, `codec = "sim"`.
    pub real: Option<RealArm>,
}

impl Profile {
    /// Lets the arm find its zero when it is opened, in the way that is reported: it moves by
    /// itself, or takes the place where it is held. `None` for an arm that needs neither.
    pub fn let_find_zero(&mut self) -> Option<&'static str> {
        let Some(Protocol::Vendor(vendor)) = self.real.as_mut().map(|real| &mut real.protocol)
        else {
            return None;
        };
        let way = vendor.family.way_to_zero()?;
        vendor.home = true;
        Some(way)
    }

    /// What stability is judged by. Of a real arm that is what was measured on it; of one that was
    /// never measured, its twin with half the assumed viscosity.
    pub fn bound_plant(&self) -> Plant {
        let Some(real) = &self.real else { return self.plant };
        match real.identified {
            Some(measured) => Plant {
                mass_kg: measured.mass_kg,
                damping_n_s_per_m: measured.damping_n_s_per_m,
                inertia_kg_m2: measured.inertia_kg_m2.unwrap_or(self.plant.inertia_kg_m2),
                damping_nm_s_per_rad: measured
                    .damping_nm_s_per_rad
                    .unwrap_or(0.5 * self.plant.damping_nm_s_per_rad),
                delay_ticks: measured.round_trip_ticks,
                ..self.plant
            },
            None => Plant {
                damping_n_s_per_m: 0.5 * self.plant.damping_n_s_per_m,
                damping_nm_s_per_rad: 0.5 * self.plant.damping_nm_s_per_rad,
                ..self.plant
            },
        }
    }

    /// How commands name it: a shipped one by its name, any other by its file.
    pub fn given(&self) -> String {
        match &self.source {
            Some(path) => path.display().to_string(),
            None => self.name.clone(),
        }
    }

    /// True for an arm behind a library of its maker, where a file of the user's says so, and no
    /// profile of this program.
    pub fn names_library(&self) -> bool {
        let is_library = |real: &RealArm| matches!(real.protocol, Protocol::Vendor(_));
        self.source.is_some() && self.real.as_ref().is_some_and(is_library)
    }

    /// True for a real arm on which no test has shown that the motors push the way they are
    /// commanded.
    pub fn has_unverified_signs(&self) -> bool {
        self.real.as_ref().is_some_and(|real| !real.signs_verified)
    }

    /// The limits that hold now: those of the profile, or what is left of them until the signs are
    /// verified.
    pub fn limits_now(&self) -> ProfileLimits {
        if self.has_unverified_signs() { self.unverified_limits() } else { self.limits }
    }

    /// The limits until the signs are verified: [`UNVERIFIED_SIGNS_FORCE_N`], and torque in
    /// proportion.
    pub fn unverified_limits(&self) -> ProfileLimits {
        let limits = self.limits;
        let force_n = if limits.force_n > 0.0 { limits.force_n } else { UNACTUATED_FORCE_N };
        let share = (UNVERIFIED_SIGNS_FORCE_N / force_n).min(1.0);
        ProfileLimits {
            force_n: share * limits.force_n,
            torque_nm: share * limits.torque_nm,
            ..limits
        }
    }

    /// True for a real arm that was never measured: its bounds rest on assumptions, and the program
    /// warns of that when it is enabled.
    pub fn is_unidentified(&self) -> bool {
        self.real.as_ref().is_some_and(|real| real.identified.is_none())
    }
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

impl ProfileLimits {
    /// What the motor stage holds to.
    pub(crate) fn of_motors(&self) -> MotorLimits {
        MotorLimits { force_n: self.force_n, torque_nm: self.torque_nm }
    }
}

/// Most that motors of unverified signs make at the grip, N; torque in proportion. One that pushes
/// the wrong way is positive feedback.
pub const UNVERIFIED_SIGNS_FORCE_N: f64 = 0.5;
/// Force limit that a scene assumes of an arm that has none, N: what torque is in proportion to
/// there.
pub(crate) const UNACTUATED_FORCE_N: f64 = 10.0;

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
    /// Step of a measured angle, rad: the rotation vector from the zero pose is rounded per axis;
    /// 0: continuous.
    pub encoder_step_rad: f64,
    /// Ticks from a command to its force; at 0 it acts in the period after the `write`.
    pub delay_ticks: u32,
}

/// The shipped profiles: name and text, in alphabetical order.
macro_rules! shipped {
    ($($name:literal),+ $(,)?) => { [$(($name, include_str!(concat!("../../devices/", $name, ".toml")))),+] };
}

const EMBEDDED: &[(&str, &str)] = &shipped![
    "delta3",
    "falcon-fd",
    "hapkit",
    "haply-2diy",
    "haply-2diy-first",
    "haply-2diy-v2",
    "haptikfabriken-aluhaptics2",
    "haptikfabriken-woodenhaptics",
    "inverse3",
    "inverse3-no-grip",
    "lambda7",
    "leader-arm-6",
    "novint-falcon",
    "omega3",
    "omega6",
    "omega7",
    "open6-hid",
    "open6-serial",
    "phantom-desktop",
    "phantom-omni",
    "polhem-2019",
    "polhem-2020",
    "polhem-2022",
    "polhem-v1",
    "premium15-6dof",
    "premium30-6dof",
    "sigma7",
    "sim-2diy",
    "sim-delta3",
    "sim-desktop",
    "sim-falcon",
    "sim-ideal",
    "sim-inverse3",
    "sim-lambda7",
    "sim-omega3",
    "sim-omega6",
    "sim-omega7",
    "sim-omni",
    "sim-polhem",
    "sim-premium15-6dof",
    "sim-premium30-6dof",
    "sim-sigma7",
    "sim-touch",
    "sim-woodenhaptics",
    "spacemouse",
    "spacenav",
    "touch",
    "touch-x",
    "vintage-2022",
    "virtuose-6d",
    "woodenhaptics-2022",
    "woodenhaptics-v15",
];

/// Names of the shipped profiles, in alphabetical order.
pub fn names() -> impl Iterator<Item = &'static str> {
    EMBEDDED.iter().map(|(name, _)| *name)
}

/// Why a profile was not found or not accepted.
#[derive(Debug, thiserror::Error)]
pub enum ProfileError {
    /// No shipped profile of that name.
    #[error("no device profile of this name{}; known: {}", document::did_you_mean(.nearest), .known.join(", "))]
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

/// Finds a profile: a value with a `/` or ending in `.toml` is a path from `base_dir`, anything
/// else the name of a shipped profile.
///
/// # Errors
/// [`ProfileError`]: nothing of that name or path, or every problem of the first pass over it that
/// found any.
pub fn find(name_or_path: &str, base_dir: &Path) -> Result<Profile, ProfileError> {
    if name_or_path.contains('/') || name_or_path.ends_with(".toml") {
        let path = base_dir.join(name_or_path);
        // What is there and no file is refused by its kind, when it is read.
        if !path.exists() {
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

/// A profile as it is written: that of an embedded one, or of a file that a scene in `base_dir`
/// names by path. `None` where there is none.
pub fn text(name_or_path: &str, base_dir: &Path) -> Option<String> {
    if name_or_path.contains('/') || name_or_path.ends_with(".toml") {
        return regular::written(&base_dir.join(name_or_path)).ok();
    }
    EMBEDDED.iter().find(|(name, _)| *name == name_or_path).map(|(_, text)| (*text).to_owned())
}

/// True for a file that says what codec an arm speaks, as profiles do and scenes do not. False for
/// one that is no TOML.
pub fn is_profile(path: &Path) -> bool {
    let table = regular::written(path).ok().and_then(|text| text.parse::<toml::Table>().ok());
    table.is_some_and(|table| table.get("device").and_then(|device| device.get("codec")).is_some())
}

/// Loads a profile file.
///
/// # Errors
/// Every problem of the first pass that found any.
pub fn load(path: &Path) -> Result<Profile, ConfigErrors> {
    let text = regular::written(path).map_err(|cause| {
        ConfigErrors::new(vec![Problem::of_file(path, ProblemKind::Unreadable { cause })])
    })?;
    Ok(Profile { source: Some(path.to_owned()), ..parse(path, &text)? })
}

fn parse(path: &Path, text: &str) -> Result<Profile, ConfigErrors> {
    let document = Document::parse(path, text)?;
    if document.line("tool").is_some() && document.string("device.codec").is_none() {
        return Err(ConfigErrors::new(vec![Problem::of_file(path, ProblemKind::IsScene)]));
    }
    // A known arm that this program cannot drive is refused before its tables are judged by our
    // keys.
    if let Some((_, accepted)) = document
        .string("device.codec")
        .and_then(|codec| OTHER_CODECS.iter().find(|(other, _)| *other == codec))
    {
        let accepted = (*accepted).to_owned();
        return Err(ConfigErrors::new(vec![
            document.problem("device.codec", ProblemKind::NotAvailable { accepted }),
        ]));
    }
    resolve::profile(&document, path.parent().unwrap_or(Path::new("")), &document.read()?)
}

/// Protocols that exist and that this version does not speak.
const OTHER_CODECS: [(&str, &str); 1] = [(
    "openffboard-hid",
    "an arm with firmware of one's own speaks \"open6\", see docs/reference/protocol.md",
)];
