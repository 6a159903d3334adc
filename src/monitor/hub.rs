//! Where a run and its clients meet.

use core::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use core::time::Duration;
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

use crossbeam::channel::Sender;
use serde_json::{Value, json};

use super::clay::{ClayParts, ClayService, HoldWatchdog, no_clay};
use super::client::Client;
use super::connection_slots::ConnectionState;
use super::encode::{
    self, At, EncodedState, Extras, LastFault, MonitorEvent, StateInput, WireObject,
};
use super::feed::FeedRecord;
use super::info::{API, RunInfo, has_force};
use super::outbox::AWAY;
use super::problem::RequestError;
use super::recorder::RecordingControl;
use crate::daemon::session::{SceneView, SessionError, SessionHandle};
use arms::attached::open::LinkNews;
use engine::drive_watchdog::{DriveWatchdog, OffReason, OffReport};
use engine::supervisor::{Enable, Notice, Phase};
use recording::metrics::{Metrics, RecordingCounts};
use rt::clock::ClockKind;
use rt::control::Control;
use vps::spatial::Pose;

/// What a hub is made of.
pub struct HubParts {
    /// What is rendered, and what changes it.
    pub session: SessionHandle,
    /// Takes force away and ends the run.
    pub control: Arc<Control>,
    /// To the supervisor, which lets force flow.
    pub enables: Sender<Enable>,
    /// Longest silence of the client that drives; without such a client no force flows.
    pub heartbeat: Option<Duration>,
    /// Which time the run follows.
    pub clock: ClockKind,
    /// Begins and ends recordings; `None`: this run has none.
    pub recorder: Option<Box<dyn RecordingControl>>,
    /// The run in the text format of Prometheus.
    pub metrics: Option<Metrics>,
}

/// The newest record, with what the publisher knows beside it.
#[derive(Clone, Debug)]
pub(super) struct NewestState {
    pub(super) fed: FeedRecord,
    pub(super) wanted: Option<Pose>,
    pub(super) objects: Arc<[WireObject]>,
}

/// Everything that the clients of a run share.
pub struct Hub {
    pub(super) session: SessionHandle,
    /// Clients that drive: their silence switches force off.
    pub(super) drive: Arc<DriveWatchdog>,
    /// The client that holds the clay.
    pub(super) hold: HoldWatchdog,
    pub(super) clock: ClockKind,
    pub(super) recorder: Option<Arc<dyn RecordingControl>>,
    clay: OnceLock<Arc<ClayService>>,
    metrics: Option<Metrics>,
    newest: Mutex<Option<NewestState>>,
    /// Whatever takes force away goes here, and nowhere else first.
    pub(super) control: Arc<Control>,
    enables: Sender<Enable>,
    clients: Mutex<Vec<Arc<Client>>>,
    next_client: AtomicU64,
    facts: Mutex<RunInfo>,
    /// Force went off because a client fell silent. Read and written with `Relaxed`: it is a word
    /// for people and orders nothing.
    fell_silent: AtomicBool,
    started_unix_s: u64,
}

impl Hub {
    /// A hub without clients.
    pub fn new(parts: HubParts) -> Arc<Self> {
        let HubParts { session, control, enables, heartbeat, clock, recorder, metrics } = parts;
        let since = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH);
        Arc::new(Self {
            session,
            drive: Arc::new(DriveWatchdog::new(control.clone(), heartbeat)),
            hold: HoldWatchdog::default(),
            clock,
            recorder: recorder.map(Arc::from),
            clay: OnceLock::new(),
            metrics,
            newest: Mutex::default(),
            control,
            enables,
            clients: Mutex::default(),
            next_client: AtomicU64::new(1),
            facts: Mutex::default(),
            fell_silent: AtomicBool::new(false),
            started_unix_s: since.map_or(0, |since| since.as_secs()),
        })
    }

    /// Takes a notice of the supervisor.
    pub fn notice(self: &Arc<Self>, notice: &Notice<'_>) {
        match notice {
            Notice::Phase(phase) => {
                self.drive.note_force(has_force(*phase));
                self.facts().phase = *phase;
                if !has_force(*phase) && self.hold.let_all_go() {
                    self.let_clay_go("no force flows: the clay was let go");
                }
                if *phase == Phase::Enabling {
                    // What was switched off before this is news of before.
                    self.tell_silences();
                    self.facts().last_fault = None;
                    self.fell_silent.store(false, Ordering::Relaxed);
                }
                self.tell("state", None, phase.name(), &[phase.name()]);
            }
            Notice::Preflight(report) => self.facts().checked(report),
            Notice::Fault(record) => {
                let faults = record.output.faults;
                let names: Vec<_> = faults.names().collect();
                self.facts().last_fault = Some(LastFault::of(record));
                self.tell(
                    "fault",
                    Some((record.tick, record.time_ns)),
                    &encode::fault_words(faults),
                    &names,
                );
            }
            Notice::Link(news) => {
                let (word, text) = match news {
                    LinkNews::Lost => ("lost", "the arm is gone; it is looked for".to_owned()),
                    LinkNews::Back { node, homing } => {
                        self.facts().node = Some(node.clone());
                        let homing = homing.as_deref().unwrap_or_default();
                        (
                            "up",
                            format!(
                                "the arm is back at {}; it waits to be enabled. {homing}",
                                node.display()
                            ),
                        )
                    }
                    LinkNews::Fails(why) => ("fails", why.clone()),
                    LinkNews::Reported(text) => ("up", text.clone()),
                    LinkNews::Unguarded(why) => ("up", format!("the arm has no guard: {why}")),
                };
                self.facts().link = word;
                self.tell("link", None, text.trim_end(), &[word]);
            }
            Notice::Waiting(cause) => self.tell("waiting", None, cause.advice(), &[cause.name()]),
            // The publisher announces a scene once the session shows it, and of states at the rates
            // of the clients.
            Notice::Scene(_) | Notice::Status(_) => {}
        }
    }

    /// The node of a real arm that was opened.
    pub fn attached(&self, node: &Path) {
        let mut facts = self.facts();
        (facts.node, facts.link) = (Some(node.to_owned()), "up");
    }

    /// From now on clients see this clay and work on it. Once in a run.
    pub fn sculpts(&self, parts: ClayParts) {
        // A run has one model.
        let _ = self.clay.set(Arc::new(ClayService::new(parts)));
    }

    /// The clay of the scene that is rendered.
    pub(super) fn clay(&self) -> Result<Arc<ClayService>, RequestError> {
        match self.clay.get() {
            Some(clay) => Ok(clay.clone()),
            None if self.is_baking() => Err(RequestError::unavailable(
                "the scene is being baked: nothing is rendered yet",
                "wait for the event `scene`",
            )),
            None => Err(no_clay()),
        }
    }

    fn let_clay_go(self: &Arc<Self>, why: &str) {
        if let Some(clay) = self.clay.get() {
            clay.let_go(self);
            self.tell("clay", None, why, &["let-go"]);
        }
    }

    /// A scene that was asked for is not rendered, and why.
    pub fn scene_refused(&self, name: &str, why: &str) {
        self.tell("scene", None, &format!("{name} is not rendered: {why}"), &["refused", name]);
    }

    /// Sends an event to every client. `at`: of the newest tick where it is of none.
    pub(super) fn tell(&self, event: &'static str, at: Option<At>, text: &str, names: &[&str]) {
        let newest = || {
            self.newest().as_ref().map(|newest| (newest.fed.record.tick, newest.fed.record.time_ns))
        };
        let at = at.or_else(newest);
        let words = encode::json(&MonitorEvent::new(event, at, text, names));
        for client in self.clients().iter() {
            client.outbox.say(words.clone());
        }
    }

    /// A new client, greeted.
    pub(super) fn join(&self, connection: Arc<ConnectionState>) -> Arc<Client> {
        let id = self.next_client.fetch_add(1, Ordering::Relaxed);
        let client = Arc::new(Client::new(id, self.drive.clone(), connection));
        let view = self.session.view();
        client.outbox.say(encode::json(&json!({
            "type": "hello",
            "api": API,
            "version": env!("CARGO_PKG_VERSION"),
            "tick_rate_hz": view.config.rate_hz,
            "phase": self.phase().name(),
            "scene_idx": view.scene_idx,
        })));
        self.clients().push(client.clone());
        client
    }

    /// The connection of a client has ended.
    pub(super) fn part(&self, id: u64) {
        // First: it may switch force off.
        self.drive.lose(id);
        self.hold.lose(id);
        self.clients().retain(|client| client.id != id);
    }

    /// A client sent a message: a sign of life.
    pub(super) fn note_message(&self, client: &Client) {
        let heard = client.heard();
        self.drive.note_message(client.id, heard);
        self.hold.note_message(client.id, heard);
    }

    /// The run in the text format of Prometheus; `None`: it has no figures.
    pub(super) fn metrics(&self) -> Option<String> {
        let metrics = self.metrics.as_ref()?;
        metrics.set_clients(self.clients().len());
        let recording = self.recorder.as_ref().and_then(|recorder| recorder.status());
        metrics.set_recording(
            recording
                .map(|status| RecordingCounts { records: status.records, dropped: status.dropped }),
        );
        Some(metrics.text())
    }

    /// The clients of this moment.
    pub(super) fn clients(&self) -> MutexGuard<'_, Vec<Arc<Client>>> {
        self.clients.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Says good-bye.
    pub(super) fn end(&self) {
        self.drive.end();
        self.hold.end();
        for client in self.clients().iter() {
            client.outbox.end(AWAY, "the run is over");
        }
    }

    /// Asks the supervisor to let force flow.
    pub(super) fn enable(&self, client: Option<u64>) -> Result<(), RequestError> {
        // First: a heartbeat that ends from now on counts for more.
        let permit = self.control.permit();
        if !self.drive.lets_enable(client) {
            return Err(RequestError::conflict(
                "this scene needs a client that sends heartbeats (`safety.heartbeat_ms`), and this \
                    client sends none",
                "send {\"do\":\"heartbeat\"} over a WebSocket, again and again, then enable",
            ));
        }
        if self.is_baking() {
            return Err(RequestError::conflict(
                "the scene is being baked: nothing is rendered yet",
                "wait for the event `scene`",
            ));
        }
        self.enables.send(Enable(permit)).map_err(|_| RequestError::from(SessionError::Over))
    }

    /// Watches the client that holds the clay; for a thread of its own.
    pub(super) fn watch_hold(self: &Arc<Self>) {
        self.hold.watch(|is_news| {
            if is_news {
                self.let_clay_go("the client that held the clay fell silent: it was let go");
            } else if let Some(clay) = self.clay.get() {
                clay.let_go(self);
            }
        });
    }

    /// Tells clients what the watchdog has switched off since the last call.
    pub(super) fn tell_silences(&self) {
        for OffReport { reason, had_force } in self.drive.take_reports() {
            // Its orders for clay end with the client.
            if let Some(clay) = self.clay.get() {
                clay.cancel();
            }
            if had_force {
                self.fell_silent.store(true, Ordering::Relaxed);
            }
            let text = match reason {
                OffReason::Silent(longest) => format!(
                    "a controlling client was silent for {} ms: force off",
                    longest.as_millis()
                ),
                OffReason::Lost => "a controlling client has gone: force off".to_owned(),
                OffReason::NoClient => {
                    "no client sends heartbeats, and this scene needs one that does: force off"
                        .to_owned()
                }
                OffReason::Expelled(why) => {
                    format!("the connection of a client was closed ({why}): force off")
                }
            };
            self.tell("heartbeat", None, &text, &[]);
        }
    }

    /// Where the run stands.
    pub(super) fn phase(&self) -> Phase {
        self.facts().phase
    }

    /// Force may flow.
    pub(super) fn has_force(&self) -> bool {
        has_force(self.phase())
    }

    /// Nothing is rendered yet.
    pub(super) fn is_baking(&self) -> bool {
        matches!(self.phase(), Phase::Init | Phase::Baking)
    }

    /// The newest state as text, without counts.
    pub(super) fn state_text(&self) -> Option<String> {
        let newest = self.newest().clone()?;
        Some(self.text(&newest, Extras::default()))
    }

    /// The newest record.
    pub(super) fn newest(&self) -> MutexGuard<'_, Option<NewestState>> {
        self.newest.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The newest state in one of both formats.
    pub(super) fn body(
        &self,
        newest: &NewestState,
        is_binary: bool,
        extras: Extras<'_>,
    ) -> EncodedState {
        if is_binary {
            EncodedState::Binary(self.binary(newest))
        } else {
            EncodedState::Text(self.text(newest, extras))
        }
    }

    /// The newest state as text, without counts.
    pub(super) fn text(&self, newest: &NewestState, extras: Extras<'_>) -> String {
        encode::text(&self.moment(newest), extras)
    }

    /// The newest state in the binary layout, without counts.
    pub(super) fn binary(&self, newest: &NewestState) -> Vec<u8> {
        encode::binary(&self.moment(newest))
    }

    fn moment<'a>(&self, newest: &'a NewestState) -> StateInput<'a> {
        StateInput {
            record: &newest.fed.record,
            phase: self.phase(),
            fell_silent: self.fell_silent.load(Ordering::Relaxed),
            last_fault: self.facts().last_fault,
            wanted: newest.wanted,
            hand_use: self.session.hand_use(),
            objects: &newest.objects,
        }
    }

    /// `/api/v1/info`.
    pub(super) fn info(&self) -> Value {
        let SceneView { config, .. } = self.session.view();
        let recording = self.recorder.as_ref().and_then(|recorder| recorder.status());
        let mut info = self.facts().info(&config);
        info["clock"] = self.clock.name().into();
        info["started_unix_s"] = self.started_unix_s.into();
        info["recording"] = recording.map(|status| status.json()).into();
        info
    }

    fn facts(&self) -> MutexGuard<'_, RunInfo> {
        self.facts.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
