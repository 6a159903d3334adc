//! What a client of the service says and hears. Cold, or in the threads of the link: it allocates.

use core::fmt;
use core::str::FromStr;

use serde::Deserialize;
use serde_json::{Map, Value};

use super::record::{self, State};
use super::{HaplyService, Trouble};
use crate::protocol::StartError;

/// Buttons in the order of their bits.
pub(super) const BUTTONS: [&str; 10] =
    ["a", "b", "c", "d", "e", "f", "up", "down", "left", "right"];

/// A version of the service: major and minor.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Version(pub u16, pub u16);

impl FromStr for Version {
    type Err = ();

    fn from_str(text: &str) -> Result<Self, ()> {
        let mut numbers = text.split('.').map(|word| word.parse::<u16>().ok());
        match (numbers.next(), numbers.next()) {
            (Some(Some(major)), Some(Some(minor))) => Ok(Self(major, minor)),
            _ => Err(()),
        }
    }
}

impl fmt::Display for Version {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}.{}", self.0, self.1)
    }
}

/// How a force is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Dialect {
    /// Versions 3.1 to 3.4.
    Values,
    /// From 3.5 on.
    Vector,
}

impl Dialect {
    /// The dialect of a version.
    ///
    /// # Errors
    /// A version that speaks neither.
    pub(crate) fn of(version: Version) -> Result<Self, StartError> {
        match version {
            Version(3, 1..=4) => Ok(Self::Values),
            Version(3, 5..) => Ok(Self::Vector),
            _ => Err(StartError::Refused(format!(
                "the service is version {version}; this program speaks 3.1 to 3.5"
            ))),
        }
    }

    pub(super) const fn key(self) -> &'static str {
        match self {
            Self::Values => "values",
            Self::Vector => "vector",
        }
    }

    /// The version in the answer to `GET /version`, which comes bare or in an envelope.
    pub(crate) fn version_in(body: &str) -> Option<Version> {
        let answer: Value = serde_json::from_str(body).ok()?;
        let version =
            answer.get("project_version").or_else(|| answer.get("data")?.get("project_version"))?;
        version.as_str()?.parse().ok()
    }
}

/// The message of a command; `None` for what is no command.
pub(crate) fn command_text(record: &[u8], arm: &str, dialect: Dialect) -> Option<String> {
    let [x, y, z] = record::force_of(record)?;
    let key = dialect.key();
    // `{:?}`: an id may hold a quotation mark, and Rust's escapes of printable text are those of
    // JSON.
    Some(format!(
        r#"{{"inverse3":[{{"device_id":{arm:?},"commands":{{"set_cursor_force":{{"{key}":{{"x":{x},"y":{y},"z":{z}}}}}}}}}]}}"#
    ))
}

#[derive(Deserialize)]
struct ServiceMessage {
    #[serde(default)]
    inverse3: Vec<ArmEntry>,
    #[serde(default)]
    verse_grip: Vec<GripEntry>,
    #[serde(default)]
    wireless_verse_grip: Vec<GripEntry>,
    #[serde(default)]
    custom_verse_grip: Vec<GripEntry>,
}

impl ServiceMessage {
    /// A grip may be in two lists: those of the first come first.
    fn grips(&self) -> impl Iterator<Item = &GripEntry> {
        self.verse_grip.iter().chain(&self.wireless_verse_grip).chain(&self.custom_verse_grip)
    }
}

#[derive(Deserialize)]
struct ArmEntry {
    device_id: String,
    config: Option<Config>,
    state: Option<ArmState>,
    status: Option<ArmStatus>,
}

#[derive(Deserialize, Default)]
struct Config {
    #[serde(default, rename = "type")]
    kind: String,
    #[serde(default)]
    device_info: Map<String, Value>,
    #[serde(flatten)]
    rest: Map<String, Value>,
}

#[derive(Deserialize)]
struct ArmState {
    cursor_position: Option<Vector>,
}

#[derive(Deserialize, Clone, Copy)]
struct Vector {
    x: Option<f64>,
    y: Option<f64>,
    z: Option<f64>,
}

#[derive(Deserialize, Clone, Copy)]
struct Quaternion {
    x: Option<f64>,
    y: Option<f64>,
    z: Option<f64>,
    w: Option<f64>,
}

#[derive(Deserialize, Clone, Copy)]
struct ArmStatus {
    calibrated: Option<bool>,
    power_supply: Option<bool>,
    ready: Option<bool>,
    started: Option<bool>,
}

#[derive(Deserialize)]
struct GripEntry {
    device_id: String,
    state: Option<GripState>,
    status: Option<GripStatus>,
}

#[derive(Deserialize)]
struct GripState {
    orientation: Option<Quaternion>,
    #[serde(default)]
    buttons: Map<String, Value>,
}

#[derive(Deserialize, Clone, Copy)]
struct GripStatus {
    connected: Option<bool>,
    awake: Option<bool>,
    ready: Option<bool>,
}

impl GripStatus {
    fn sleeps(self) -> bool {
        [self.connected, self.awake, self.ready].contains(&Some(false))
    }
}

/// An arm as the first frame of the service describes it.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ArmOfService {
    /// Its id.
    pub(crate) id: String,
    /// `inverse3`, `inverse3x` and the like.
    pub(crate) kind: String,
    firmware: Option<String>,
    /// What is set in the service and changes the force that is felt, each with its key.
    filters: Vec<String>,
    /// What turns or moves the frame of its positions.
    frame: Vec<String>,
}

/// The first frame of the service.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Inventory {
    /// Arms.
    pub(crate) arms: Vec<ArmOfService>,
    /// Ids of grips.
    pub(crate) grips: Vec<String>,
}

impl Inventory {
    /// Reads it; `None` for another message.
    pub(crate) fn read(text: &str) -> Option<Self> {
        let frame: ServiceMessage = serde_json::from_str(text).ok()?;
        let mut grips: Vec<String> = Vec::new();
        for grip in frame.grips() {
            if !grips.contains(&grip.device_id) {
                grips.push(grip.device_id.clone());
            }
        }
        let arms = frame
            .inverse3
            .into_iter()
            .map(|arm| ArmOfService::of(arm.device_id, &arm.config.unwrap_or_default()))
            .collect();
        Some(Self { arms, grips })
    }

    /// The arm and the grip that a profile means.
    ///
    /// # Errors
    /// None, or several, or one in a frame that is not its own.
    pub(crate) fn choose(
        &self,
        wanted: &HaplyService,
    ) -> Result<(&ArmOfService, Option<&String>), StartError> {
        let ids: Vec<&String> = self.arms.iter().map(|arm| &arm.id).collect();
        let arm_idx = one_of(&ids, wanted.arm.as_ref(), "arm", "protocol.arm")?;
        let arm = &self.arms[arm_idx];
        if let Some(what) = arm.frame.first() {
            let text = format!(
                "the service turns or moves the frame of {}: {what}; set it back in the service",
                arm.id
            );
            return Err(StartError::Refused(text));
        }
        let grips: Vec<&String> = self.grips.iter().collect();
        let grip = match wanted.has_grip {
            true => {
                Some(&self.grips[one_of(&grips, wanted.grip.as_ref(), "grip", "protocol.grip")?])
            }
            false => None,
        };
        Ok((arm, grip))
    }
}

fn one_of(
    ids: &[&String],
    wanted: Option<&String>,
    what: &str,
    key: &str,
) -> Result<usize, StartError> {
    let listed = || ids.iter().map(|id| id.as_str()).collect::<Vec<_>>().join(", ");
    let refuse = |text: String| Err(StartError::Refused(text));
    match (wanted, ids) {
        (_, []) => refuse(format!(
            "the service knows no {what}: plug it in, switch it on and look at the service's own \
                page"
        )),
        (Some(wanted), _) => match ids.iter().position(|id| *id == wanted) {
            Some(idx) => Ok(idx),
            None => refuse(format!(
                "the service knows no {what} {wanted}; it knows {}: name one of them in {key}",
                listed()
            )),
        },
        (None, [_]) => Ok(0),
        (None, _) => refuse(format!(
            "the service knows several: {}; name one in {key} of a profile of your own",
            listed()
        )),
    }
}

impl ArmOfService {
    fn of(id: String, config: &Config) -> Self {
        let info = |key: &str| config.device_info.get(key).and_then(Value::as_u64);
        let firmware = info("major_version")
            .zip(info("minor_version"))
            .map(|(major, minor)| format!("{major}.{minor}"));
        let at = |path: &str| {
            path.split('.')
                .try_fold(None, |at: Option<&Value>, key| {
                    match at {
                        None => config.rest.get(key),
                        Some(value) => value.get(key),
                    }
                    .map(Some)
                })
                .flatten()
        };
        let mut filters = Vec::new();
        // Each with the value at which it changes nothing.
        for (key, neutral) in [
            ("filters.force_gate.gain", 0.0),
            ("filters.damping.scalar", 0.0),
            ("gravity_compensation.scaling_factor", 1.0),
        ] {
            if let Some(value) = at(key).and_then(Value::as_f64).filter(|value| *value != neutral) {
                filters.push(format!("{key} is {value}"));
            }
        }
        for (key, neutral) in [
            ("gravity_compensation.enabled", true),
            ("home_return.enabled", false),
            ("torque_scaling.enabled", false),
        ] {
            if let Some(value) = at(key).and_then(Value::as_bool).filter(|value| *value != neutral)
            {
                filters.push(format!("{key} is {value}"));
            }
        }
        let mut frame = Vec::new();
        frame.extend(
            at("basis.permutation")
                .and_then(Value::as_str)
                .filter(|basis| *basis != "XYZ")
                .map(|basis| format!("basis.permutation is {basis}")),
        );
        let is_unit =
            |path: &str, unit: f64| at(path).is_none_or(|value| value.as_f64() == Some(unit));
        let is_mounted = ["x", "y", "z"].iter().any(|axis| {
            !is_unit(&format!("mount.position.{axis}"), 0.0)
                || !is_unit(&format!("mount.rotation.{axis}"), 0.0)
                || !is_unit(&format!("mount.scale.{axis}"), 1.0)
                || !is_unit(&format!("cursor_offset.{axis}"), 0.0)
        });
        frame.extend(is_mounted.then(|| "mount or cursor_offset moves it".to_owned()));
        Self { id, kind: config.kind.clone(), firmware, filters, frame }
    }

    /// A line for people, then what changes the force that is felt.
    pub(crate) fn greeting(&self, version: Version, grip: Option<&String>) -> String {
        let mut text = format!(
            "Inverse service {version}, {} {}",
            if self.kind.is_empty() { "arm" } else { &self.kind },
            self.id
        );
        if let Some(firmware) = &self.firmware {
            text += &format!(", firmware {firmware}");
        }
        text += &grip.map_or(", no grip".to_owned(), |grip| format!(", grip {grip}"));
        if !self.filters.is_empty() {
            text += &format!("\nthe service changes the force: {}", self.filters.join(", "));
        }
        text
    }
}

/// Reads the states of one arm and its grip.
pub(crate) struct Reader {
    arm: String,
    grip: Option<String>,
    /// What the last frame that spoke of it said.
    arm_status: Option<ArmStatus>,
    grip_status: Option<GripStatus>,
    /// x y z w; of a grip that sleeps the last one. `None`: not heard yet.
    orientation: Option<[f64; 4]>,
    buttons: u32,
}

impl Reader {
    /// Of this arm and this grip.
    pub(crate) fn new(arm: &str, grip: Option<&str>) -> Self {
        Self {
            arm: arm.to_owned(),
            grip: grip.map(str::to_owned),
            arm_status: None,
            grip_status: None,
            orientation: None,
            buttons: 0,
        }
    }

    /// The record of a message.
    pub(crate) fn record(&mut self, text: &[u8]) -> Vec<u8> {
        let Ok(frame) = serde_json::from_slice::<ServiceMessage>(text) else {
            return record::garbled();
        };
        let Some(arm) = frame.inverse3.iter().find(|arm| arm.device_id == self.arm) else {
            return record::gone();
        };
        let Some(position) = arm.state.as_ref().and_then(|state| state.cursor_position) else {
            return record::garbled();
        };
        self.arm_status = arm.status.or(self.arm_status);
        let grip_trouble = self.hear_grip(&frame);
        let or_nan = |number: Option<f64>| number.unwrap_or(f64::NAN);
        let mut pose =
            [or_nan(position.x), or_nan(position.y), or_nan(position.z), 0.0, 0.0, 0.0, 0.0];
        pose[3..].copy_from_slice(&self.orientation.unwrap_or([0.0, 0.0, 0.0, 1.0]));
        // Of an arm whose status was never heard nothing is good; a flag that a service does not
        // have is.
        let is = |flag: fn(&ArmStatus) -> Option<bool>| {
            self.arm_status.as_ref().is_some_and(|status| flag(status) != Some(false))
        };
        let trouble = match () {
            () if self.arm_status.is_none() => Some(Trouble::NotReady),
            () if !is(|status| status.power_supply) => Some(Trouble::NoPower),
            () if !is(|status| status.ready) || !is(|status| status.started) => {
                Some(Trouble::NotReady)
            }
            () => grip_trouble,
        };
        let homed = is(|status| status.calibrated);
        State {
            pose,
            buttons: self.buttons,
            homed,
            error: trouble.map_or(0, |trouble| trouble as u8),
        }
        .record()
    }

    fn hear_grip(&mut self, frame: &ServiceMessage) -> Option<Trouble> {
        let wanted = self.grip.as_ref()?;
        let Some(grip) = frame.grips().find(|grip| grip.device_id == *wanted) else {
            return Some(Trouble::GripGone);
        };
        self.grip_status = grip.status.or(self.grip_status);
        if self.grip_status.is_some_and(GripStatus::sleeps) {
            return Some(Trouble::GripAsleep);
        }
        if let Some(state) = &grip.state {
            if let Some(Quaternion { x, y, z, w }) = state.orientation {
                self.orientation = Some([x, y, z, w].map(|part| part.unwrap_or(f64::NAN)));
            }
            let is_held =
                |name: &&str| state.buttons.get(*name).and_then(Value::as_bool) == Some(true);
            self.buttons = BUTTONS
                .iter()
                .enumerate()
                .filter(|(_, name)| is_held(name))
                .fold(0, |bits, (bit, _)| bits | 1 << bit);
        }
        // A grip without a direction has not begun to send.
        self.orientation.is_none().then_some(Trouble::GripAsleep)
    }
}
