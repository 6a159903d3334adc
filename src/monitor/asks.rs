//! What a client may ask for, the same over WebSocket and HTTP.

use core::time::Duration;
use std::sync::Arc;

use serde::Deserialize;
use serde_json::Value;

use super::answer::{Completion, Reply};
use super::clay::{
    self, CombineAsked, DrawAsked, LayAsked, PullAsked, RegionAsked, SaveKind, TakeAsked,
};
use super::client::{Client, Subscription};
use super::encode::WirePose;
use super::forms::{read, such_as};
use super::hub::Hub;
use super::problem::RequestError;
use super::recorder::{RecorderError, RecorderStatus};
use super::worker::Worker;
use crate::daemon::session::{HandOrder, SessionError};
use ::clay::engine::SculptOrder;
use engine::drive_watchdog::{LONGEST, SHORTEST};
use vps::spatial::Pose;

/// Fastest and slowest stream.
const MOST_RATE_HZ: f64 = 1000.0;
const LEAST_RATE_HZ: f64 = 0.1;

/// One request. A key that is not known is refused: a misspelt one would otherwise pass for none.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(tag = "do", rename_all = "snake_case", deny_unknown_fields)]
pub(super) enum ClientCommand {
    /// A stream of states; 0 Hz: none.
    Subscribe {
        rate_hz: f64,
        #[serde(default)]
        format: StateFormat,
        #[serde(default)]
        contacts: bool,
        #[serde(default = "yes")]
        history: bool,
    },
    Enable {},
    Disable {},
    Stop {},
    /// A parameter, SI.
    Set {
        parameter: String,
        value: f64,
    },
    /// A movable object.
    Place {
        object: String,
        pose: PoseAsked,
    },
    /// The hand of a simulated arm goes to a pose of the tool, `world_from_tool`, and stays there.
    Hand {
        pose: PoseAsked,
        /// The scene that the client means; without it the one that is rendered.
        scene_idx: Option<u32>,
    },
    /// It follows the scene's path again.
    RestartHand {},
    /// The scene as it was at its beginning.
    Reset {},
    /// Another scene.
    Switch {
        scene: String,
    },
    /// A recording begins.
    Record {
        #[serde(default)]
        file: Option<String>,
    },
    /// It ends.
    EndRecording {},
    /// A sign of life, and how long to wait for the next one.
    Heartbeat {
        #[serde(default)]
        timeout_ms: Option<f64>,
    },
    /// Another tool of the tool on clay, or other settings.
    ClayTake(TakeAsked),
    /// Curves wait for the next hold of the curve rope.
    ClayDraw(DrawAsked),
    /// Curves are pulled.
    ClayPull(PullAsked),
    /// Another part of the clay deforms.
    ClayRegion(RegionAsked),
    /// Material is laid at once.
    ClayLay(LayAsked),
    /// A Boolean with a solid at a place.
    ClayCombine(CombineAsked),
    /// As if the arm's first button were held or let go.
    ClayHold {
        held: bool,
    },
    /// A stroke back.
    ClayUndo {},
    /// And forth again.
    ClayRedo {},
    /// The clay into a file.
    ClaySave {
        kind: SaveKind,
        #[serde(default)]
        file: Option<String>,
    },
    /// Nothing but an answer.
    Ping {},
}

fn yes() -> bool {
    true
}

/// How states are written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum StateFormat {
    #[default]
    Json,
    Binary,
}

/// `world_from_object`.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct PoseAsked {
    p: [f64; 3],
    q: [f64; 4],
}

impl From<PoseAsked> for Pose {
    fn from(PoseAsked { p, q }: PoseAsked) -> Self {
        WirePose::pose(q, p)
    }
}

/// Longest `id` of a request as text, bytes: it is kept until the answer.
const LONGEST_ID: usize = 256;

impl ClientCommand {
    /// True for what switches force off, and is done on a connection that is being closed, too.
    pub(super) fn is_off(&self) -> bool {
        matches!(self, Self::Disable {} | Self::Stop {})
    }

    /// True for what switches force off or is a sign of life: done however much else waits.
    pub(super) fn is_always_heard(&self) -> bool {
        matches!(self, Self::Heartbeat { .. } | Self::ClayHold { held: false } | Self::Ping {})
            || self.is_off()
    }

    /// Takes a message apart: its `id`, whatever that is, and the request.
    pub(super) fn parse(message: &[u8]) -> (Value, Result<Self, RequestError>) {
        let mut object = match serde_json::from_slice(message) {
            Ok(Value::Object(object)) => object,
            Ok(_) => {
                return (
                    Value::Null,
                    Err(RequestError::bad(
                        "a request is an object",
                        "such as {\"id\":1,\"do\":\"ping\"}",
                    )),
                );
            }
            Err(error) => {
                return (
                    Value::Null,
                    Err(RequestError::bad(
                        format!("no JSON: {error}"),
                        "send one object in each message",
                    )),
                );
            }
        };
        let id = object.remove("id").unwrap_or(Value::Null);
        if !is_short(&id) {
            return (
                Value::Null,
                Err(RequestError::bad(
                    format!("an `id` has at most {LONGEST_ID} bytes"),
                    "a number will do",
                )),
            );
        }
        let command = object.get("do").and_then(Value::as_str).unwrap_or_default().to_owned();
        let asked =
            read(object, "").map_err(|error| RequestError::bad(error, such_as(&command, true)));
        (id, asked)
    }
}

fn is_short(id: &Value) -> bool {
    !matches!(id, Value::String(_) | Value::Array(_) | Value::Object(_))
        || id.to_string().len() <= LONGEST_ID
}

/// Does what a client asks for; `client` where it has a connection. The reply may come from another
/// thread.
pub(super) fn perform(
    hub: &Arc<Hub>,
    files: &Worker,
    client: Option<&Client>,
    asked: ClientCommand,
    reply: Reply,
) {
    match asked {
        ClientCommand::Enable {} => reply(hub.enable(client.map(|client| client.id)).map(nothing)),
        ClientCommand::Disable {} => {
            hub.control.disable();
            reply(Ok(Completion::Nothing));
        }
        ClientCommand::Stop {} => {
            hub.control.stop();
            reply(Ok(Completion::Nothing));
        }
        ClientCommand::Set { parameter, value } => {
            reply(done(hub.session.set(&parameter, value)));
        }
        ClientCommand::Place { object, pose } => {
            reply(done(hub.session.place(&object, pose.into())));
        }
        ClientCommand::Hand { pose, scene_idx } => {
            reply(hand(hub, scene_idx, HandOrder::MoveTo(pose.into())))
        }
        ClientCommand::RestartHand {} => reply(hand(hub, None, HandOrder::Restart)),
        ClientCommand::Reset {} => hub.session.reset(Box::new(move |result| reply(done(result)))),
        ClientCommand::Switch { scene } => switch(hub, scene, reply),
        ClientCommand::Record { file } => record(hub, files, Some(file), reply),
        ClientCommand::EndRecording {} => record(hub, files, None, reply),
        ClientCommand::Ping {} => reply(Ok(Completion::Nothing)),
        ClientCommand::Subscribe { rate_hz, format, contacts, history } => reply(match client {
            Some(client) => wanted(rate_hz, format, contacts, history).map(|wanted| {
                client.want(wanted);
                Completion::Nothing
            }),
            None => Err(needs_connection()),
        }),
        ClientCommand::Heartbeat { timeout_ms } => reply(match client {
            Some(client) => longest(timeout_ms).map(|longest| {
                hub.drive.beat(client.id, longest, client.heard());
                Completion::Nothing
            }),
            None => Err(needs_connection()),
        }),
        ClientCommand::ClayTake(asked) => clay::take(hub, asked, reply),
        ClientCommand::ClayDraw(asked) => clay::order(hub, |_| asked.checked(), reply),
        ClientCommand::ClayPull(asked) => clay::order(hub, |_| asked.checked(), reply),
        ClientCommand::ClayRegion(asked) => clay::order(hub, |_| asked.checked(), reply),
        ClientCommand::ClayLay(asked) => clay::order(hub, |_| asked.checked(), reply),
        ClientCommand::ClayCombine(asked) => clay::order(hub, |view| asked.checked(view), reply),
        ClientCommand::ClayHold { held } => match client {
            Some(client) => clay::hold(hub, client.id, held, reply),
            None => reply(Err(needs_connection())),
        },
        ClientCommand::ClayUndo {} => clay::step(hub, SculptOrder::Undo, "undone", reply),
        ClientCommand::ClayRedo {} => clay::step(hub, SculptOrder::Redo, "redone", reply),
        ClientCommand::ClaySave { kind, file } => clay::save(hub, files, kind, file, reply),
    }
}

fn nothing((): ()) -> Completion {
    Completion::Nothing
}

fn needs_connection() -> RequestError {
    RequestError::bad("this needs a connection", "use the WebSocket")
}

fn done(result: Result<(), SessionError>) -> Result<Completion, RequestError> {
    Ok(nothing(result?))
}

fn hand(hub: &Hub, scene_idx: Option<u32>, order: HandOrder) -> Result<Completion, RequestError> {
    Ok(Completion::HandOrder(hub.session.hand_in(scene_idx, order)?))
}

fn switch(hub: &Arc<Hub>, scene: String, reply: Reply) {
    let reported = hub.clone();
    let name = scene.clone();
    let answer = move |result: Result<(), SessionError>| {
        // Every client got the event that it is being baked.
        if let Err(error @ (SessionError::Scene(_) | SessionError::Over)) = &result {
            reported.scene_refused(&name, &error.to_string());
        }
        reply(done(result));
    };
    hub.session.switch(scene, Box::new(answer));
}

fn wanted(
    rate_hz: f64,
    format: StateFormat,
    contacts: bool,
    history: bool,
) -> Result<Option<Subscription>, RequestError> {
    if rate_hz == 0.0 {
        return Ok(None);
    }
    // A NaN is in no range.
    if !(LEAST_RATE_HZ..=MOST_RATE_HZ).contains(&rate_hz) {
        let hint = "0 ends the stream";
        return Err(RequestError::bad(
            format!("`rate_hz` goes from {LEAST_RATE_HZ} to {MOST_RATE_HZ}, not to {rate_hz}"),
            hint,
        ));
    }
    let is_binary = format == StateFormat::Binary;
    Ok(Some(Subscription {
        rate_hz,
        is_binary,
        contacts: contacts && !is_binary,
        history: history && !is_binary,
    }))
}

fn longest(timeout_ms: Option<f64>) -> Result<Option<Duration>, RequestError> {
    let Some(timeout_ms) = timeout_ms else { return Ok(None) };
    let [least_ms, most_ms] = [SHORTEST, LONGEST].map(|longest| longest.as_secs_f64() * 1e3);
    let is_sound = timeout_ms == 0.0 || timeout_ms >= least_ms && timeout_ms <= most_ms;
    if !is_sound {
        let error = format!("`timeout_ms` goes from {least_ms} to {most_ms}, not to {timeout_ms}");
        return Err(RequestError::bad(error, "0 ends the heartbeat"));
    }
    Ok(Some(Duration::from_secs_f64(timeout_ms * 1e-3)))
}

/// A recording begins (`Some`: with this file, if it is named) or ends, on the thread for files.
fn record(hub: &Arc<Hub>, files: &Worker, begins: Option<Option<String>>, reply: Reply) {
    let Some(recorder) = hub.recorder.clone() else {
        return reply(Err(RequestError::unavailable("this run has no recorder", "")));
    };
    let hub = hub.clone();
    files.post(move || {
        let result = match &begins {
            Some(file) => recorder.start(file.as_deref()),
            None => recorder.stop(),
        };
        if let Ok(RecorderStatus { file, records, .. }) = &result {
            let file = file.to_string_lossy();
            match begins {
                Some(_) => hub.tell(
                    "recording",
                    None,
                    &format!("recording into {file}"),
                    &["begun", &file],
                ),
                None => hub.tell(
                    "recording",
                    None,
                    &format!("{records} ticks are recorded in {file}"),
                    &["ended", &file],
                ),
            }
        }
        reply(result.map(Completion::Recording).map_err(|error| match &error {
            RecorderError::File(_) => RequestError::bad(error.to_string(), ""),
            RecorderError::State(_) => RequestError::conflict(error.to_string(), ""),
        }));
    });
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn parsed(text: &str) -> (Value, Result<ClientCommand, String>) {
        let (id, asked) = ClientCommand::parse(text.as_bytes());
        (id, asked.map_err(|problem| problem.said.error))
    }

    #[test]
    fn requests_are_read_and_misspelt_ones_refused() {
        assert_eq!(parsed(r#"{"id":7,"do":"enable"}"#), (7.into(), Ok(ClientCommand::Enable {})));
        assert_eq!(
            parsed(r#"{"do":"heartbeat"}"#),
            (Value::Null, Ok(ClientCommand::Heartbeat { timeout_ms: None }))
        );
        let subscribe = ClientCommand::Subscribe {
            rate_hz: 60.0,
            format: StateFormat::Json,
            contacts: true,
            history: true,
        };
        assert_eq!(parsed(r#"{"do":"subscribe","rate_hz":60,"contacts":true}"#).1, Ok(subscribe));
        let long = "x".repeat(300);
        for id in [json!(long), json!([long]), json!({ long: 1 })] {
            let (kept, asked) = parsed(&json!({ "id": id, "do": "ping" }).to_string());
            assert!(kept.is_null() && asked.is_err_and(|error| error.contains("256")), "{id}");
        }
        assert_eq!(
            parsed(r#"{"id":[1,{"a":2}],"do":"ping"}"#),
            (json!([1, { "a": 2 }]), Ok(ClientCommand::Ping {}))
        );
        let place = r#"{"id":"a","do":"place","object":"lift","pose":{"p":[0,0,1],"q":[0,0,0,1]}}"#;
        assert!(matches!(parsed(place), (Value::String(_), Ok(ClientCommand::Place { .. }))));
        assert!(matches!(
            parsed(r#"{"do":"clay_take","craft":"paint","brush_m":0.003}"#).1,
            Ok(ClientCommand::ClayTake(_))
        ));
        assert_eq!(
            parsed(r#"{"do":"clay_hold","held":true}"#).1,
            Ok(ClientCommand::ClayHold { held: true })
        );
        let save =
            ClientCommand::ClaySave { kind: SaveKind::Export, file: Some("bowl".to_owned()) };
        assert_eq!(parsed(r#"{"do":"clay_save","kind":"export","file":"bowl"}"#).1, Ok(save));
        for (wrong, expected) in [
            ("", "no JSON"),
            ("[1]", "an object"),
            ("{}", "do"),
            (r#"{"do":"fly"}"#, "fly"),
            (r#"{"do":"enable","now":true}"#, "now"),
            (r#"{"do":"heartbeat","timeout":5}"#, "timeout"),
            (r#"{"do":"set","parameter":"x"}"#, "value"),
            (r#"{"do":"set","parameter":"x","value":1e999}"#, "range"),
            (r#"{"do":"place","object":"x","pose":{"p":[0,0],"q":[0,0,0,1]}}"#, "length"),
            (r#"{"do":"subscribe","rate_hz":60,"format":"xml"}"#, "xml"),
            (r#"{"do":"clay_take","brush":0.003}"#, "brush"),
            (r#"{"do":"clay_hold"}"#, "held"),
            (r#"{"do":"clay_undo","strokes":3}"#, "strokes"),
            (r#"{"do":"clay_draw","curves":[]}"#, "curves"),
            (r#"{"do":"clay_pull","curves_m":[[[0,0]]],"force_n":[0,0,1],"time_s":1}"#, "length"),
            (r#"{"do":"clay_region","min":[0,0,0]}"#, "max"),
            (r#"{"do":"clay_lay","ball":{"center":[0,0,0]}}"#, "radius_m"),
            (r#"{"do":"clay_combine","boolean":"xor"}"#, "xor"),
            (r#"{"do":"clay_save","kind":"photo"}"#, "photo"),
        ] {
            let error = parsed(wrong).1.expect_err(wrong);
            assert!(error.contains(expected), "{wrong}: {error}");
        }
        // A value of another type is reported with its key.
        for (wrong, expected) in [
            (r#"{"do":"clay_take","brush_m":"wide","craft":"paint"}"#, "`brush_m`"),
            (r#"{"do":"clay_hold","held":"yes"}"#, "`held`"),
            (r#"{"do":"set","parameter":3,"value":4}"#, "`parameter`"),
            (r#"{"do":"place","object":"x","pose":7}"#, "`pose`"),
        ] {
            let error = parsed(wrong).1.expect_err(wrong);
            assert!(error.starts_with(expected), "{wrong}: {error}");
        }
    }

    #[test]
    fn a_pose_is_read_whole_or_not_at_all() {
        let read_pose = |text: &[u8]| serde_json::from_slice::<PoseAsked>(text).map(Pose::from);
        let pose = read_pose(br#"{"p":[1,2,3],"q":[0,0,0,1]}"#).unwrap();
        assert_eq!(pose, Pose::from_translation(glam::DVec3::new(1.0, 2.0, 3.0)));
        for wrong in [
            "",
            "{}",
            r#"{"p":[1,2],"q":[0,0,0,1]}"#,
            r#"{"p":[1,2,1e999],"q":[0,0,0,1]}"#,
            r#"{"p":[1,2,3],"q":[0,0,0,1],"v":1}"#,
        ] {
            assert!(read_pose(wrong.as_bytes()).is_err(), "{wrong}");
        }
    }

    #[test]
    fn rates_and_silences_have_bounds() {
        for rate_hz in [-1.0, 0.05, 1000.5, f64::NAN, f64::INFINITY] {
            assert!(wanted(rate_hz, StateFormat::Json, false, true).is_err(), "{rate_hz}");
        }
        assert_eq!(wanted(0.0, StateFormat::Json, false, true), Ok(None));
        let binary =
            Subscription { rate_hz: 1000.0, is_binary: true, contacts: false, history: false };
        assert_eq!(wanted(1000.0, StateFormat::Binary, true, true), Ok(Some(binary)));
        assert_eq!(longest(Some(0.0)), Ok(Some(Duration::ZERO)));
        assert!(
            longest(Some(1.0)).is_err()
                && longest(Some(1e9)).is_err()
                && longest(Some(f64::NAN)).is_err()
        );
    }
}
