//! The services beside one run: the monitor, the console, what is published, and reading the scene
//! again.

use std::io;
use std::path::Path;
use std::sync::{Arc, OnceLock};

use crossbeam::channel::unbounded;

use super::{OutputOptions, console, publish, reload};
use crate::config::SceneConfig;
use crate::daemon::reload::{KnownFiles, ReloadNotice, Reloader};
use crate::daemon::sculpting::ClayHandle;
use crate::daemon::session::SessionHandle;
use crate::monitor::{BoundMonitor, ClayParts, Hub, HubParts, Monitor, RecordingControl};
use engine::servo::Control;
use engine::supervisor::{Enable, LiveChannels, Notice, Operator};
use recording::metrics::metrics_subscriber;
use rt::clock::ClockKind;
use rt::signals::hangups;

/// What services are wanted, and what they need.
pub(crate) struct ServiceOptions<'a> {
    pub(crate) config: &'a SceneConfig,
    pub(crate) session: &'a SessionHandle,
    pub(crate) clock: ClockKind,
    /// The address of the monitor, if there is one.
    pub(crate) bound: Option<BoundMonitor>,
    /// What is to be published, if anything.
    pub(crate) opened: Option<publish::OpenedPublisher>,
    /// Takes force away.
    pub(crate) control: &'a Arc<Control>,
    pub(crate) has_console: bool,
    pub(crate) enables_at_start: bool,
    /// Records when clients ask for it.
    pub(crate) recorder: Option<Box<dyn RecordingControl>>,
    pub(crate) output: OutputOptions,
}

/// The services beside one run.
#[derive(Default)]
pub(crate) struct Services {
    hub: Option<Arc<Hub>>,
    /// Held until the run is over.
    monitor: Option<Monitor>,
    sender: Option<publish::Sender>,
    known: Option<KnownFiles>,
    /// What the console works on.
    clay: Arc<OnceLock<ClayHandle>>,
}

impl Services {
    /// Begins them, and gives the supervisor its ends of their queues. Until the first scene is
    /// baked clients see that.
    pub(crate) fn open(options: ServiceOptions<'_>, live: &mut LiveChannels) -> io::Result<Self> {
        let ServiceOptions {
            config,
            session,
            clock,
            bound,
            opened,
            control,
            has_console,
            enables_at_start,
            recorder,
            output,
        } = options;
        let (enables, taken) = unbounded::<Enable>();
        let clay = Arc::new(OnceLock::new());
        if has_console {
            console::begin(control.clone(), enables.clone(), session.clone(), clay.clone())?;
        }
        let is_asked = has_console || bound.is_some();
        live.operator = Operator {
            enables_at_start,
            waits_after_fault: is_asked,
            holds_back: config.heartbeat.is_some(),
            enables: is_asked.then_some(taken),
        };
        let mut services = Self { known: Some(KnownFiles::of(config)), clay, ..Self::default() };
        if bound.is_none() && opened.is_none() {
            return Ok(services);
        }
        let (metrics, counts) = metrics_subscriber(config.rate_hz);
        live.subscribers.add(counts);
        let hub = Hub::new(HubParts {
            session: session.clone(),
            control: control.clone(),
            enables,
            heartbeat: config.heartbeat,
            clock,
            recorder,
            metrics: Some(metrics),
        });
        if let Some(bound) = bound {
            let (monitor, subscriber) = bound.serve(hub.clone())?;
            live.subscribers.add(subscriber);
            services.monitor = Some(monitor);
        }
        if let Some(opened) = opened {
            let (sender, subscriber) = opened.serve(&hub, session, output)?;
            live.subscribers.add(subscriber);
            services.sender = Some(sender);
        }
        services.hub = Some(hub);
        Ok(services)
    }

    /// The node of a real arm that was opened.
    pub(crate) fn attached(&self, node: &Path) {
        if let Some(hub) = &self.hub {
            hub.attached(node);
        }
    }

    /// Clients and the console see this clay from now on, and work on it.
    pub(crate) fn sculpts(&self, handle: Option<&ClayHandle>, clay: Option<ClayParts>) {
        if let Some(handle) = handle {
            // It is set once.
            _ = self.clay.set(handle.clone());
        }
        if let (Some(hub), Some(clay)) = (&self.hub, clay) {
            hub.sculpts(clay);
        }
    }

    /// Begins to read the scene again when SIGHUP asks for it, and where wished when its files
    /// change. After signals are caught.
    pub(crate) fn reload(&mut self, session: &SessionHandle, watches: bool, output: OutputOptions) {
        let Some(known) = self.known.take() else { return };
        let hub = self.hub.clone();
        let rendered = session.clone();
        let tell = Box::new(move |news: &ReloadNotice| {
            reload::tell(news, output);
            if let (ReloadNotice::Refused(refusal), Some(hub)) = (news, &hub) {
                let path = &rendered.view().config.path;
                hub.scene_refused(
                    &path.file_stem().unwrap_or_default().to_string_lossy(),
                    &refusal.to_string(),
                );
            }
        });
        Reloader::new(hangups(), watches, known, tell).begin(session);
    }

    /// Passes on notices of the supervisor.
    pub(crate) fn notice_handler(&self) -> impl Fn(&Notice<'_>) + use<> {
        let hub = self.hub.clone();
        move |notice| {
            if let Some(hub) = &hub {
                hub.notice(notice);
            }
        }
    }
}
