//! States and events as they go over the wire; `docs/reference/api.md` is their description.

use axum::extract::ws::Message;
use glam::{DQuat, DVec3};
use serde::ser::SerializeStruct as _;
use serde::{Serialize, Serializer};

use super::rows::HistoryRow;
use crate::daemon::session::HandUse;
use engine::supervisor::Phase;
use haptics::{Faults, OffCause};
use recording::TickRecord;
use vps::spatial::{Pose, Wrench};

/// The number of a tick, and its time since the loop began, ns.
pub(super) type At = (u64, i64);

/// Version of the binary layout.
const BINARY_VERSION: u32 = 1;
/// Where the count of states sent stands in the binary layout, and behind it that of dropped ones.
const SEQ_AT: usize = 24;
/// Bytes of a binary state.
const BINARY_BYTES: usize = 344;

/// A state without what differs from client to client.
#[derive(Debug, PartialEq)]
pub(super) enum EncodedState {
    /// An object.
    Text(String),
    /// The binary layout.
    Binary(Vec<u8>),
}

impl EncodedState {
    /// The message for one client.
    pub(super) fn message(&self, seq: u64, dropped: u64) -> Message {
        match self {
            Self::Text(body) => Message::from(with_counts(body, seq, dropped)),
            Self::Binary(body) => {
                let mut bytes = body.clone();
                count_in(&mut bytes, seq, dropped);
                Message::from(bytes)
            }
        }
    }
}

/// Puts the counts into a binary state.
pub(super) fn count_in(bytes: &mut [u8], seq: u64, dropped: u64) {
    for (place, count) in bytes[SEQ_AT..SEQ_AT + 16].chunks_exact_mut(8).zip([seq, dropped]) {
        place.copy_from_slice(&count.to_le_bytes());
    }
}

/// A state with its counts in front.
pub(super) fn with_counts(body: &str, seq: u64, dropped: u64) -> String {
    let rest = body.strip_prefix('{').unwrap_or(body);
    format!("{{\"type\":\"state\",\"seq\":{seq},\"dropped\":{dropped},{rest}")
}

/// A pose: position in m, unit quaternion.
#[derive(Clone, Copy, Debug, Serialize)]
pub(super) struct WirePose {
    p: [f64; 3],
    q: [f64; 4],
}

impl From<Pose> for WirePose {
    fn from(pose: Pose) -> Self {
        Self { p: pose.translation.to_array(), q: pose.rotation.to_array() }
    }
}

impl From<WirePose> for Pose {
    fn from(WirePose { p, q }: WirePose) -> Self {
        WirePose::pose(q, p)
    }
}

impl WirePose {
    /// The pose; as it was written, not normalised.
    pub(super) fn pose([x, y, z, w]: [f64; 4], p: [f64; 3]) -> Pose {
        Pose::new(DQuat::from_xyzw(x, y, z, w), DVec3::from_array(p))
    }
}

#[derive(Clone, Copy, Debug, Serialize)]
struct WireWrench {
    f: [f64; 3],
    t: [f64; 3],
}

impl From<Wrench> for WireWrench {
    fn from(wrench: Wrench) -> Self {
        Self { f: wrench.force.to_array(), t: wrench.torque.to_array() }
    }
}

#[derive(Clone, Copy, Debug, Serialize)]
struct WireTwist {
    v: [f64; 3],
    w: [f64; 3],
}

/// Where a movable object stands, `world_from_object`.
#[derive(Clone, Copy, Debug, Serialize)]
pub(super) struct WireObject {
    pub(super) idx: u32,
    #[serde(flatten)]
    pub(super) pose: WirePose,
}

/// The fault that last took the force.
#[derive(Clone, Copy, Debug)]
pub(super) struct LastFault {
    tick: u64,
    time_ns: i64,
    faults: Faults,
}

impl LastFault {
    pub(super) fn of(record: &TickRecord) -> Self {
        Self { tick: record.tick, time_ns: record.time_ns, faults: record.output.faults }
    }
}

impl Serialize for LastFault {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut object = serializer.serialize_struct("LastFault", 3)?;
        object.serialize_field("tick", &self.tick)?;
        object.serialize_field("time_ns", &self.time_ns)?;
        object.serialize_field("names", &self.faults.names().collect::<Vec<_>>())?;
        object.end()
    }
}

/// What the state of a run is made of.
#[derive(Clone, Copy, Debug)]
pub(super) struct StateInput<'a> {
    pub(super) record: &'a TickRecord,
    pub(super) phase: Phase,
    /// Force went off because a client fell silent.
    pub(super) fell_silent: bool,
    /// Until the next enable.
    pub(super) last_fault: Option<LastFault>,
    /// Where the arm wants the tool, `world_from_tool`.
    pub(super) wanted: Option<Pose>,
    /// The newest order for the hand that a tick has used.
    pub(super) hand_use: Option<HandUse>,
    pub(super) objects: &'a [WireObject],
}

/// What only some clients want.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Extras<'a> {
    /// World, m, with the depth; and how many were in contact.
    pub(super) points: Option<(&'a [[f32; 4]], usize)>,
    pub(super) history: Option<&'a [HistoryRow]>,
}

/// An order for the hand that a tick has used.
#[derive(Serialize)]
struct WireHandUse {
    order: u32,
    waited_us: u32,
}

#[derive(Serialize)]
struct State<'a> {
    tick: u64,
    time_ns: i64,
    scene_idx: u32,
    state: &'static str,
    is_busy: bool,
    phase: &'static str,
    off_cause: &'static str,
    advice: &'static str,
    faults: Vec<&'static str>,
    last_fault: Option<LastFault>,
    measured_cp: WirePose,
    measured_cv: WireTwist,
    servo_cf: WireWrench,
    measured_cf: WireWrench,
    tool_cp: WirePose,
    device_cp_world: Option<WirePose>,
    contact_cf: WireWrench,
    contacts: u32,
    max_depth_m: f64,
    depth_is_bound: bool,
    clearance_m: f64,
    energy_j: f64,
    grip_rad: f64,
    buttons: u32,
    wakeup_us: f64,
    compute_us: f64,
    device_us: f64,
    objects: &'a [WireObject],
    #[serde(skip_serializing_if = "Option::is_none")]
    hand: Option<WireHandUse>,
    #[serde(skip_serializing_if = "Option::is_none")]
    points: Option<&'a [[f32; 4]]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    points_of: Option<usize>,
    #[serde(skip_serializing_if = "Option::is_none")]
    history: Option<&'a [HistoryRow]>,
}

/// Name and advice of the cause.
fn off_cause(moment: &StateInput<'_>) -> (&'static str, &'static str) {
    let cause = moment.record.output.off_cause;
    if moment.fell_silent && cause == OffCause::Software {
        return ("heartbeat", "a controlling client fell silent: enable again");
    }
    (cause.name(), cause.advice())
}

/// The state as text.
pub(super) fn text(moment: &StateInput<'_>, extras: Extras<'_>) -> String {
    let record = moment.record;
    let sample = &record.input.sample;
    let output = &record.output;
    let us = |ns: u64| ns as f64 * 1e-3;
    let (off_cause, advice) = off_cause(moment);
    let state = State {
        tick: record.tick,
        time_ns: record.time_ns,
        scene_idx: record.scene_idx,
        state: output.drive.crtk_name(),
        is_busy: output.drive.is_busy(),
        phase: moment.phase.name(),
        off_cause,
        advice,
        faults: output.faults.names().collect(),
        last_fault: moment.last_fault,
        measured_cp: sample.pose.into(),
        measured_cv: WireTwist {
            v: sample.twist.linear.to_array(),
            w: sample.twist.angular.to_array(),
        },
        servo_cf: output.command_device.into(),
        measured_cf: record.rendered_device.into(),
        tool_cp: output.world_from_tool.into(),
        device_cp_world: moment.wanted.map(WirePose::from),
        contact_cf: output.contact_world.into(),
        contacts: output.contacts,
        max_depth_m: output.max_depth_m,
        depth_is_bound: output.depth_is_bound,
        clearance_m: output.clearance_m,
        energy_j: output.energy_j,
        grip_rad: sample.grip_rad,
        buttons: sample.buttons,
        wakeup_us: us(record.wakeup_ns),
        compute_us: us(record.compute_ns),
        device_us: us(record.device_ns),
        objects: moment.objects,
        hand: moment
            .hand_use
            .map(|HandUse { number, waited_us }| WireHandUse { order: number, waited_us }),
        points: extras.points.map(|(points, _)| points),
        points_of: extras.points.map(|(_, n_all)| n_all),
        history: extras.history,
    };
    json(&state)
}

/// Plain data as JSON. What is not a number becomes null.
pub(super) fn json(value: &impl Serialize) -> String {
    match serde_json::to_string(value) {
        Ok(text) => text,
        // True invariant: structs of numbers, words and lists of them.
        Err(error) => unreachable!("plain data: {error}"),
    }
}

/// The state in the binary layout, counts left zero.
pub(super) fn binary(moment: &StateInput<'_>) -> Vec<u8> {
    let record = moment.record;
    let sample = &record.input.sample;
    let output = &record.output;
    let mut bytes = Vec::with_capacity(BINARY_BYTES);
    bytes.extend(b"HSTA");
    bytes.extend(BINARY_VERSION.to_le_bytes());
    bytes.extend(record.tick.to_le_bytes());
    bytes.extend(record.time_ns.to_le_bytes());
    bytes.extend([0; 16]);
    let state = ["DISABLED", "ENABLED", "PAUSED", "FAULT"]
        .iter()
        .position(|name| *name == output.drive.crtk_name());
    let flags = state.unwrap_or(0) as u32
        | u32::from(output.drive.is_busy()) << 3
        | u32::from(output.depth_is_bound) << 4
        | (output.off_cause as u32) << 8;
    bytes.extend(flags.to_le_bytes());
    bytes.extend(output.faults.bits().to_le_bytes());
    let pose = |pose: Pose| {
        let ([x, y, z], [qx, qy, qz, qw]) = (pose.translation.to_array(), pose.rotation.to_array());
        [x, y, z, qx, qy, qz, qw]
    };
    let wrench = |wrench: Wrench| {
        let ([fx, fy, fz], [tx, ty, tz]) = (wrench.force.to_array(), wrench.torque.to_array());
        [fx, fy, fz, tx, ty, tz]
    };
    let numbers = (pose(sample.pose).into_iter())
        .chain(pose(output.world_from_tool))
        .chain(wrench(output.command_device))
        .chain(wrench(record.rendered_device))
        .chain(wrench(output.contact_world))
        .chain([output.max_depth_m, output.clearance_m]);
    numbers.for_each(|number| bytes.extend(number.to_le_bytes()));
    bytes.extend(output.contacts.to_le_bytes());
    for ns in [record.wakeup_ns, record.compute_ns, record.device_ns] {
        bytes.extend(((ns as f64 * 1e-3) as f32).to_le_bytes());
    }
    bytes.extend(record.scene_idx.to_le_bytes());
    bytes.extend(sample.buttons.to_le_bytes());
    bytes
}

/// Something that happened.
#[derive(Clone, Debug, Serialize)]
pub(super) struct MonitorEvent<'a> {
    #[serde(rename = "type")]
    kind: &'static str,
    event: &'static str,
    tick: Option<u64>,
    time_ns: Option<i64>,
    text: &'a str,
    names: &'a [&'a str],
}

impl<'a> MonitorEvent<'a> {
    /// An event in the words of people, and the names that belong to it.
    pub(super) fn new(
        event: &'static str,
        at: Option<At>,
        text: &'a str,
        names: &'a [&'a str],
    ) -> Self {
        Self {
            kind: "event",
            event,
            tick: at.map(|at| at.0),
            time_ns: at.map(|at| at.1),
            text,
            names,
        }
    }
}

/// The faults of a set in plain words.
pub(super) fn fault_words(faults: Faults) -> String {
    let words: Vec<_> = Faults::TABLE
        .into_iter()
        .filter(|(fault, ..)| faults.contains(*fault))
        .map(|(.., text)| text)
        .collect();
    words.join("; ")
}

#[cfg(test)]
mod tests {
    use serde_json::Value;

    use super::*;
    use haptics::{Drive, TickOutput};

    fn record() -> TickRecord {
        let output = TickOutput {
            drive: Drive::Enabling,
            faults: Faults::STALE | Faults::SPEED,
            clearance_m: f64::NAN,
            contacts: 7,
            max_depth_m: 2e-3,
            ..TickOutput::default()
        };
        TickRecord {
            tick: 12,
            time_ns: 12_000_000,
            compute_ns: 1500,
            scene_idx: 3,
            output,
            ..TickRecord::default()
        }
    }

    fn moment(record: &TickRecord) -> StateInput<'_> {
        StateInput {
            record,
            phase: Phase::Enabling,
            fell_silent: false,
            last_fault: None,
            wanted: None,
            hand_use: None,
            objects: &[],
        }
    }

    #[test]
    fn a_state_is_an_object_with_null_for_what_is_no_number() {
        let rows = [HistoryRow { time_s: 0.012, values: [1.0, 2.0, 1.5, 0.25] }];
        let extras = Extras { points: Some((&[[0.5, 0.0, 1.0, 0.25]], 3)), history: Some(&rows) };
        let message = EncodedState::Text(text(&moment(&record()), extras)).message(5, 2);
        let json: Value = serde_json::from_str(message.to_text().expect("text")).expect("JSON");
        assert_eq!(
            (&json["type"], &json["seq"], &json["dropped"]),
            (&"state".into(), &5.into(), &2.into())
        );
        assert_eq!(
            (&json["state"], &json["is_busy"], &json["phase"]),
            (&"ENABLED".into(), &true.into(), &"enabling".into())
        );
        assert_eq!(json["faults"], serde_json::json!(["speed", "stale"]));
        assert_eq!(json["clearance_m"], Value::Null);
        assert_eq!(
            json["measured_cp"],
            serde_json::json!({ "p": [0.0, 0.0, 0.0], "q": [0.0, 0.0, 0.0, 1.0] })
        );
        assert_eq!(json["history"], serde_json::json!([[0.012, 1.0, 2.0, 1.5, 0.25]]));
        assert_eq!(
            (&json["points"], &json["points_of"]),
            (&serde_json::json!([[0.5, 0.0, 1.0, 0.25]]), &3.into())
        );
        assert_eq!(json["device_cp_world"], Value::Null);
    }

    #[test]
    fn a_fault_stays_known_after_it_was_acknowledged() {
        let now = TickRecord::default();
        let after = StateInput { last_fault: Some(LastFault::of(&record())), ..moment(&now) };
        let json: Value = serde_json::from_str(&text(&after, Extras::default())).expect("JSON");
        assert_eq!(json["faults"], serde_json::json!([]));
        let expected =
            serde_json::json!({ "tick": 12, "time_ns": 12_000_000, "names": ["speed", "stale"] });
        assert_eq!(json["last_fault"], expected);
    }

    #[test]
    fn a_state_says_which_order_for_the_hand_was_used() {
        let record = record();
        let said = |hand_use| {
            let json: Value = serde_json::from_str(&text(
                &StateInput { hand_use, ..moment(&record) },
                Extras::default(),
            ))
            .expect("JSON");
            json["hand"].clone()
        };
        assert_eq!(said(None), Value::Null);
        assert_eq!(
            said(Some(HandUse { number: 7, waited_us: 1250 })),
            serde_json::json!({ "order": 7, "waited_us": 1250 })
        );
    }

    #[test]
    fn the_numbers_of_a_binary_state_are_the_documented_ones() {
        let page = include_str!("../../docs/reference/api.md");
        for (number, cause) in OffCause::ALL.into_iter().enumerate() {
            assert_eq!(cause as usize, number);
            assert!(
                page.contains(&format!("{number} `{}`", cause.name())),
                "{number} {}",
                cause.name()
            );
        }
        for (fault, name, _) in Faults::TABLE {
            assert!(
                page.contains(&format!("{} `{name}`", fault.bits().trailing_zeros())),
                "{name}"
            );
        }
    }

    #[test]
    fn silence_has_a_cause_of_its_own() {
        let mut record = record();
        record.output.off_cause = OffCause::Software;
        let silent = StateInput { fell_silent: true, ..moment(&record) };
        assert_eq!(off_cause(&silent).0, "heartbeat");
        record.output.off_cause = OffCause::Deadman;
        assert_eq!(off_cause(&StateInput { fell_silent: true, ..moment(&record) }).0, "deadman");
    }

    #[test]
    fn the_binary_layout_is_the_documented_one() {
        let body = binary(&moment(&record()));
        assert_eq!(body.len(), BINARY_BYTES);
        let message = EncodedState::Binary(body).message(5, 2).into_data();
        let u64_at = |at: usize| u64::from_le_bytes(message[at..at + 8].try_into().expect("eight"));
        let u32_at = |at: usize| u32::from_le_bytes(message[at..at + 4].try_into().expect("four"));
        assert_eq!(&message[..4], b"HSTA");
        assert_eq!(
            (u32_at(4), u64_at(8), u64_at(16), u64_at(24), u64_at(32)),
            (1, 12, 12_000_000, 5, 2)
        );
        assert_eq!((u32_at(40), u32_at(44)), (1 | 1 << 3, 0b110));
        // measured_cp ends with qw, the depth stands behind 7 + 7 + 6 + 6 + 6 numbers.
        assert_eq!(f64::from_bits(u64_at(48 + 6 * 8)), 1.0);
        assert_eq!(f64::from_bits(u64_at(48 + 32 * 8)), 2e-3);
        assert_eq!((u32_at(320), f32::from_bits(u32_at(328)), u32_at(336)), (7, 1.5, 3));
    }
}
