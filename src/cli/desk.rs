//! Who is with a run: the desk that takes what clients ask for, the monitor through which they ask, and the console.

use std::io;
use std::path::Path;
use std::sync::{Arc, OnceLock};

use crossbeam::channel::{Sender, unbounded};

use super::{Talk, console, live, publish, reload};
use crate::config::{LoadOptions, SceneConfig};
use crate::daemon::desk::{Board, Counter, Desk, Tools};
use crate::daemon::reload::{Known, News, Reloader};
use crate::daemon::switch::{Offered, Switch, objects};
use crate::daemon::{Enable, Live, Notice, Operator};
use crate::haptics::RenderScene;
use crate::monitor::{Bound, ClayParts, Hub, HubParts, Monitor, Recorder};
use crate::rt::clock::ClockKind;
use crate::rt::signals::hangups;
use crate::servo::{Control, Lowered, Reins};
use crate::telemetry::metrics::metrics_tap;

/// Where a desk that is not there yet will take what is offered.
#[derive(Clone, Default)]
pub(crate) struct Opening(Arc<OnceLock<Counter>>);

impl Opening {
    /// For [`live::Changes::begin`]: scenes that were planned are told to the desk.
    pub(crate) fn hears(&self) -> live::Hears {
        let counter = self.0.clone();
        Box::new(move |offered: Offered| counter.wait().offered(offered))
    }
}

/// What a desk needs to open.
pub(crate) struct Means<'a> {
    pub(crate) config: &'a SceneConfig,
    pub(crate) options: &'a LoadOptions,
    pub(crate) clock: ClockKind,
    /// The address of the monitor, if there is one.
    pub(crate) bound: Option<Bound>,
    /// What is to be published and shared, if anything.
    pub(crate) opened: Option<publish::Opened>,
    pub(crate) talk: Talk,
    /// Takes force away.
    pub(crate) control: &'a Arc<Control>,
    pub(crate) has_console: bool,
    pub(crate) enables_at_start: bool,
    pub(crate) switches: Option<Sender<Switch>>,
    /// Limits that every scene keeps once a client lowered them.
    pub(crate) lowered: Lowered,
    /// The scenes that the loop will take, in order.
    pub(crate) offered: live::OfferedScenes,
    /// Records when clients ask for it.
    pub(crate) recorder: Option<Box<dyn Recorder>>,
}

/// Everybody who is with one run.
#[derive(Default)]
pub(crate) struct Company {
    desk: Option<Desk>,
    counter: Option<Counter>,
    hub: Option<Arc<Hub>>,
    monitor: Option<Monitor>,
    sender: Option<publish::Sender>,
    config: Option<SceneConfig>,
    board: Option<Board>,
    known: Option<Known>,
    lowered: Lowered,
}

impl Company {
    /// Opens the desk and the monitor; gives what the supervisor hears of them. Until [`Self::begin`] clients see a scene that is baked.
    pub(crate) fn open(means: Means<'_>, opening: &Opening, live: &mut Live) -> io::Result<Self> {
        let Means {
            config,
            options,
            clock,
            bound,
            opened,
            talk,
            control,
            has_console,
            enables_at_start,
            switches,
            lowered,
            offered,
            recorder,
        } = means;
        let (enables, taken) = unbounded::<Enable>();
        if has_console {
            console::begin(control.clone(), enables.clone())?;
        }
        let is_asked = has_console || bound.is_some();
        live.operator = Operator {
            enables_at_start,
            waits_after_fault: is_asked,
            holds_back: config.heartbeat.is_some(),
            enables: is_asked.then_some(taken),
        };
        if switches.is_none() {
            return Ok(Self::default());
        }
        let board = Board::new(config.clone());
        let look = Arc::new(move |config: &SceneConfig| offered.look(config, None));
        let tools = Tools { board: board.clone(), switches, options: options.clone(), lowered: lowered.clone(), look };
        let (desk, counter) = Desk::new(tools);
        // Set once: there is one desk.
        let _ = opening.0.set(counter.clone());
        let mut company = Self {
            desk: Some(desk),
            counter: Some(counter.clone()),
            config: Some(config.clone()),
            board: Some(board.clone()),
            known: Some(Known::of(config)),
            lowered,
            ..Self::default()
        };
        if bound.is_none() && opened.is_none() {
            return Ok(company);
        }
        let heartbeat = config.heartbeat;
        let (metrics, counts) = metrics_tap(config.rate_hz);
        live.taps.add(counts);
        let control = control.clone();
        let parts =
            HubParts { board, counter: counter.clone(), control, enables, heartbeat, clock, recorder, metrics: Some(metrics) };
        let hub = Hub::new(parts);
        if let Some(bound) = bound {
            let (monitor, tap) = bound.serve(hub.clone())?;
            live.taps.add(tap);
            company.monitor = Some(monitor);
        }
        if let Some(opened) = opened {
            let (sender, tap) = opened.serve(&hub, counter, talk)?;
            live.taps.add(tap);
            company.sender = Some(sender);
        }
        company.hub = Some(hub);
        Ok(company)
    }

    /// The first scene is ready: from now on what clients ask for is done. `node`: where a real arm hangs.
    pub(crate) fn begin(&mut self, scene: &Arc<RenderScene>, node: Option<&Path>, live: &mut Live) -> io::Result<()> {
        if let (Some(hub), Some(node)) = (&self.hub, node) {
            hub.attached(node);
        }
        let (Some(desk), Some(config)) = (self.desk.take(), self.config.take()) else { return Ok(()) };
        let (reins, ends) = Reins::new(&scene.parameters, objects(&config));
        live.wishes = core::mem::take(&mut live.wishes).with_reins(ends);
        desk.serve(config, scene.clone(), reins)
    }

    /// Clients see this clay from now on, and work on it.
    pub(crate) fn sculpts(&self, clay: Option<ClayParts>) {
        if let (Some(hub), Some(clay)) = (&self.hub, clay) {
            hub.sculpts(clay);
        }
    }

    /// Begins to read the scene again when SIGHUP asks for it, and where wished when its files change. After signals are caught.
    pub(crate) fn reload(&mut self, options: LoadOptions, watches: bool, talk: Talk) -> io::Result<()> {
        let (Some(counter), Some(board), Some(known)) = (self.counter.clone(), self.board.take(), self.known.take()) else {
            return Ok(());
        };
        let (hub, rendered) = (self.hub.clone(), board.clone());
        let tell = Box::new(move |news: &News| {
            reload::tell(news, talk);
            if let (News::Refused(refusal), Some(hub)) = (news, &hub) {
                let path = &rendered.view().config.path;
                hub.scene_refused(&path.file_stem().unwrap_or_default().to_string_lossy(), &refusal.to_string());
            }
        });
        let lowered = self.lowered.clone();
        Reloader { options, counter, board, hangups: hangups(), watches, known, lowered, tell }.spawn()
    }

    /// Ears for what the supervisor tells.
    pub(crate) fn ears(&self) -> impl Fn(&Notice<'_>) + use<> {
        let (counter, hub) = (self.counter.clone(), self.hub.clone());
        move |notice| {
            if let (Notice::Scene(record), Some(counter)) = (notice, &counter) {
                counter.rendered(record.scene_idx);
            }
            if let Some(hub) = &hub {
                hub.notice(notice);
            }
        }
    }
}
