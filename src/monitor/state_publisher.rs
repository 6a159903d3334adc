//! From records to states: takes what was fed, encodes once for all clients that want the same, and
//! fills their outboxes.

use core::time::Duration;
use std::sync::Arc;
use std::time::Instant;

use rtrb::Consumer;
use tokio::sync::oneshot;
use tokio::sync::oneshot::error::TryRecvError;

use super::client::{Client, Subscription};
use super::encode::{At, Extras};
use super::feed::FeedRecord;
use super::hub::{Hub, NewestState};
use super::rows::{HistoryRow, reduced};
use super::scene_tracker::SceneTracker;
use super::worker::Worker;
use haptics::RenderScene;
use recording::TickRecord;
use rt::clock::ClockKind;
use vps::contact;
use vps::spatial::Pose;

/// Pauses between two looks at the ring: for clients that want every tick, for others, and without
/// clients.
const SOON: Duration = Duration::from_millis(1);
const LATER: Duration = Duration::from_millis(4);
const LATEST: Duration = Duration::from_millis(20);
/// From this rate on a client gets the shortest pause.
const SOON_HZ: f64 = 125.0;
/// How often the session is compared with what clients were sent.
const SESSION_EVERY: Duration = Duration::from_millis(50);
/// How often over-runs are reported.
const OVERRUNS_EVERY: Duration = Duration::from_millis(100);
/// How often contact points are looked for at most; and what share of a thread that may take.
const POINTS_EVERY: Duration = Duration::from_millis(33);
const POINTS_SHARE: u32 = 10;
/// Contact points of a state.
const MOST_POINTS: usize = 512;
/// Rows of a history, and rows that are kept for one.
const MOST_ROWS: usize = 100;
const KEPT_ROWS: usize = 1 << 14;

/// When a stream of states is due, in ticks: its rate need not divide that of the loop.
#[derive(Clone, Copy, Debug, Default)]
struct Rhythm {
    /// `None`: with the first tick that comes.
    next: Option<f64>,
}

impl Rhythm {
    /// A tick has come: `None` while nothing is due, else how many states were due since the last
    /// one that was and cannot come any more.
    fn due(&mut self, tick: u64, period_ticks: f64) -> Option<u64> {
        let next = self.next.unwrap_or(tick as f64);
        let late = tick as f64 - next;
        if late < 0.0 {
            return None;
        }
        let missed = (late / period_ticks).floor();
        self.next = Some(next + (missed + 1.0) * period_ticks);
        Some(missed as u64)
    }
}

/// Clients that want the same.
struct Group {
    wanted: Subscription,
    rhythm: Rhythm,
    /// Under the virtual clock ticks say nothing of the time of a client.
    next_at: Instant,
    history: Vec<HistoryRow>,
    /// Number of the points that were sent last.
    points: u64,
}

/// Points in contact, numbered by when they were found.
#[derive(Default)]
struct Points {
    number: u64,
    found: Vec<[f32; 4]>,
    /// How many were in contact.
    n_all: usize,
}

/// Points that were found, of how many, and how long that took.
type Found = (Vec<[f32; 4]>, usize, Duration);

pub(super) struct StatePublisher {
    hub: Arc<Hub>,
    /// For what a large scene takes long for: this thread has to serve every client meanwhile.
    apart: Worker,
    tracker: SceneTracker,
    session_at: Instant,
    groups: Vec<Group>,
    points: Points,
    points_at: Instant,
    /// Points that are being looked for.
    sought: Option<oneshot::Receiver<Found>>,
    n_overruns: u32,
    /// The last of them.
    overrun_at: Option<At>,
    overruns_at: Instant,
}

impl StatePublisher {
    pub(super) fn new(hub: Arc<Hub>, apart: Worker) -> Self {
        let tracker = SceneTracker::new(hub.session.view());
        let now = Instant::now();
        Self {
            hub,
            apart,
            tracker,
            session_at: now,
            groups: Vec::new(),
            points: Points::default(),
            points_at: now,
            sought: None,
            n_overruns: 0,
            overrun_at: None,
            overruns_at: now,
        }
    }

    /// Works until the run is over.
    pub(super) async fn run(mut self, mut fed: Consumer<FeedRecord>) {
        loop {
            tokio::time::sleep(self.pause()).await;
            self.turn(&mut fed);
        }
    }

    fn pause(&self) -> Duration {
        let fastest = self.groups.iter().map(|group| group.wanted.rate_hz).fold(0.0, f64::max);
        if fastest >= SOON_HZ {
            SOON
        } else if fastest > 0.0 {
            LATER
        } else {
            LATEST
        }
    }

    fn turn(&mut self, fed: &mut Consumer<FeedRecord>) {
        let now = Instant::now();
        self.hub.tell_silences();
        if now >= self.session_at {
            self.session_at = now + SESSION_EVERY;
            self.look_at_session();
        }
        let clients: Vec<_> = self.hub.clients().clone();
        self.regroup(&clients, now);
        // No more than there are now: under the virtual clock the ring fills as fast as it empties.
        let mut left = fed.slots();
        while let Some(fed) = (left > 0).then(|| fed.pop().ok()).flatten() {
            left -= 1;
            self.take(fed, left == 0, &clients, now);
        }
        if self.n_overruns > 0 && now >= self.overruns_at {
            self.overruns_at = now + OVERRUNS_EVERY;
            let n_late = core::mem::take(&mut self.n_overruns).to_string();
            let text = if n_late == "1" {
                "1 tick began late".to_owned()
            } else {
                format!("{n_late} ticks began late")
            };
            self.hub.tell("overrun", self.overrun_at, &text, &[&n_late]);
        }
    }

    fn take(&mut self, fed: FeedRecord, is_newest: bool, clients: &[Arc<Client>], now: Instant) {
        let record = &fed.record;
        if record.input.overrun {
            self.n_overruns += 1;
            self.overrun_at = Some((record.tick, record.time_ns));
        }
        self.tracker.see(record);
        let row = HistoryRow::of(record);
        let is_virtual = self.hub.clock == ClockKind::Virtual;
        let rate_hz = f64::from(self.tracker.view().config.rate_hz);
        let mut due = Vec::new();
        for (idx, group) in self.groups.iter_mut().enumerate() {
            if group.wanted.history {
                if group.history.len() >= KEPT_ROWS {
                    group.history = reduced(&group.history, KEPT_ROWS / 2);
                }
                group.history.push(row);
            }
            let missed = if is_virtual {
                (is_newest && now >= group.next_at).then_some(0)
            } else {
                group.rhythm.due(record.tick, (rate_hz / group.wanted.rate_hz).max(1.0))
            };
            due.extend(missed.map(|missed| (idx, missed)));
        }
        if due.is_empty() && !is_newest {
            return;
        }
        let newest = self.tracker.newest(fed);
        if due.iter().any(|(idx, _)| self.groups[*idx].wanted.contacts) {
            self.find_points(&newest.fed.record, now);
        }
        for (idx, missed) in due {
            self.send(idx, missed, &newest, clients, now);
        }
        if is_newest {
            *self.hub.newest() = Some(newest);
        }
    }

    fn send(
        &mut self,
        idx: usize,
        missed: u64,
        newest: &NewestState,
        clients: &[Arc<Client>],
        now: Instant,
    ) {
        let group = &mut self.groups[idx];
        let Subscription { rate_hz, is_binary, .. } = group.wanted;
        group.next_at = now + Duration::from_secs_f64(1.0 / rate_hz);
        let rows = group.wanted.history.then(|| reduced(&group.history, MOST_ROWS));
        group.history.clear();
        let has_new_points = group.wanted.contacts && group.points != self.points.number;
        group.points = self.points.number;
        let points = has_new_points.then_some((&self.points.found[..], self.points.n_all));
        let extras = Extras { points, history: rows.as_deref() };
        let wanted = group.wanted;
        let body = Arc::new(self.hub.body(newest, is_binary, extras));
        for client in clients.iter().filter(|client| client.wants() == Some(wanted)) {
            client.outbox.show(body.clone(), rate_hz, missed);
        }
    }

    /// Groups for what clients want now.
    fn regroup(&mut self, clients: &[Arc<Client>], now: Instant) {
        let wanted: Vec<_> = clients.iter().filter_map(|client| client.wants()).collect();
        self.groups.retain(|group| wanted.contains(&group.wanted));
        for wanted in wanted {
            if !self.groups.iter().any(|group| group.wanted == wanted) {
                self.groups.push(Group {
                    wanted,
                    rhythm: Rhythm::default(),
                    next_at: now,
                    history: Vec::new(),
                    points: 0,
                });
            }
        }
    }

    /// Has the points in contact looked for, now and then, and no more than a share of the time.
    fn find_points(&mut self, record: &TickRecord, now: Instant) {
        match self.sought.as_mut().map(oneshot::Receiver::try_recv) {
            Some(Err(TryRecvError::Empty)) if record.output.contacts > 0 => return,
            Some(Ok((found, n_all, took))) => {
                self.points = Points { number: self.points.number + 1, found, n_all };
                self.points_at = now + (took * POINTS_SHARE).max(POINTS_EVERY);
            }
            // Nothing touches any more, or the search panicked.
            Some(Err(_)) | None => {}
        }
        self.sought = None;
        if now < self.points_at {
            return;
        }
        let Some(scene) = self.tracker.scene_of(record).cloned() else { return };
        if record.output.contacts == 0 {
            self.points = Points { number: self.points.number + 1, ..Points::default() };
            self.points_at = now + POINTS_EVERY;
            return;
        }
        let (reported, sought) = oneshot::channel();
        let poses = self.tracker.poses().to_vec();
        let world_from_tool = record.output.world_from_tool;
        self.apart.post(move || {
            let began = Instant::now();
            let (found, n_all) = points(&scene, &poses, world_from_tool);
            // The client that asked may have gone.
            let _ = reported.send((found, n_all, began.elapsed()));
        });
        self.sought = Some(sought);
    }

    /// Sends what has changed in the session.
    fn look_at_session(&mut self) {
        if let Ok(clay) = self.hub.clay() {
            clay.tell_news(&self.hub);
        }
        let (before, is_another) = self.tracker.look_at(self.hub.session.view());
        let view = self.tracker.view();
        if is_another {
            let text = format!("{} is rendered", view.config.name);
            self.hub.tell("scene", None, &text, &["rendered", &view.config.name]);
        }
        if before.switching_to != view.switching_to {
            let name = |path: &std::path::Path| {
                path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
            };
            // The handler of the request says why a scene is refused.
            if let Some(path) = &view.switching_to {
                self.hub.tell(
                    "scene",
                    None,
                    &format!("{} is being baked", name(path)),
                    &["baking", &name(path)],
                );
            }
        }
        if before.scene_idx == view.scene_idx && before.scene.is_some() {
            for (before, now) in before.settings.iter().zip(&view.settings) {
                if before.value != now.value {
                    let name = now.parameter.name();
                    let value = now.value.to_string();
                    self.hub.tell(
                        "parameter",
                        None,
                        &format!("{name} goes to {value}"),
                        &[name, &value],
                    );
                }
            }
        }
        if is_another {
            // The thread that drops a large scene last frees it, which takes a while.
            self.apart.post(move || drop(before));
        }
    }
}

/// Some of the points in contact, and how deep they are, m; and how many all are.
fn points(scene: &RenderScene, poses: &[Pose], world_from_tool: Pose) -> (Vec<[f32; 4]>, usize) {
    let world_from_body = world_from_tool * Pose::from_translation(scene.tool.center_of_mass_tool);
    let mut found = Vec::new();
    for (obstacle, world_from_map) in scene.obstacles.iter().zip(poses) {
        let map_from_body = world_from_map.inverse() * world_from_body;
        let kind = scene.parameters.contact.field;
        contact::visit(&obstacle.field, kind, &scene.tool.shell, map_from_body, |touching| {
            let point = world_from_body.transform_point(touching.arm_body.as_dvec3()).as_vec3();
            found.push([point.x, point.y, point.z, touching.depth_m]);
        });
    }
    let n_all = found.len();
    let step = n_all.div_ceil(MOST_POINTS).max(1);
    (found.into_iter().step_by(step).collect(), n_all)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sent(ticks: impl Iterator<Item = u64>, period_ticks: f64) -> Vec<(u64, u64)> {
        let mut rhythm = Rhythm::default();
        ticks
            .filter_map(|tick| rhythm.due(tick, period_ticks).map(|missed| (tick, missed)))
            .collect()
    }

    #[test]
    fn a_stream_has_the_rate_that_was_asked_for() {
        for (rate_hz, expected) in
            [(1000.0, 10_000), (700.0, 7000), (400.0, 4000), (333.0, 3330), (60.0, 600), (0.1, 1)]
        {
            let sent = sent(5000..15_000, 1000.0 / rate_hz);
            assert!(sent.len().abs_diff(expected) <= 1, "{rate_hz} Hz: {}", sent.len());
            assert!(sent.iter().all(|(_, missed)| *missed == 0), "{rate_hz} Hz");
        }
    }

    #[test]
    fn states_of_ticks_that_never_came_are_missed() {
        // Twelve ticks are gone.
        let ticks = || (0..10).chain(22..30);
        let all = sent(ticks(), 1.0);
        assert_eq!((all.len(), all[9], all[10], all[11]), (18, (9, 0), (22, 12), (23, 0)));
        // Every fourth of them was due: 12, 16 and 20, and 20 comes late.
        assert_eq!(sent(ticks(), 4.0), [(0, 0), (4, 0), (8, 0), (22, 2), (24, 0), (28, 0)]);
    }
}
