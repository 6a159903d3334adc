//! From a profile to an open arm: find its node, open the link, hold the start-up dialogue, and do
//! all that again when it is lost.

use core::time::Duration;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, OnceLock};

use crossbeam::channel::{Receiver, Sender, bounded};
use rtrb::{Consumer, Producer, RingBuffer};

use super::discover::{Holder, holders};
use super::nodes::{self, DeviceFile, NodeKind, Selector};
use crate::guard::{Guard, ZeroFrame};
use crate::parameters::MotorLimits;
use crate::profile::{HomingMode, Match, Profile, RealArm, TransportKind};
use crate::protocol::{Protocol, StartError};
use crate::transport::{
    Carriage, HidLink, HidOpenError, SerialError, SerialLink, ServiceError, ServiceLink, Transport,
};
use crate::vendor::{self, VendorError, VendorProtocol, Words};
use crate::{
    Capabilities, Connection, IoPlacement, Replacements, Timebase, WiredArm, WiredParameters,
    judge_declared,
};
use rt::finding::Root;
use rt::schedule::ThreadRequest;

/// How often a lost arm is looked for.
const LOOK_AGAIN: Duration = Duration::from_millis(200);
/// News of an arm that the receiver has not taken yet; more are dropped.
const NEWS: usize = 16;
/// Why an arm is lost whose guard is missing while force flows.
const NO_GUARD: &str = "its guard was stopped or has ended, and no force flows without it";

/// What an open arm should be like.
#[derive(Clone, Debug)]
pub struct OpenOptions {
    /// Which of several; `None`: the only one that fits the profile.
    pub selector: Option<Selector>,
    /// Scheduling of threads that move bytes, where the transport has any.
    pub io_request: Option<ThreadRequest>,
    /// One tick, s.
    pub period_s: f64,
    /// A `hapticd` to start as the [guard](crate::guard) of the arm, or as the
    /// [worker](crate::vendor) that the library of its maker runs in. Without one an arm has no
    /// guard, and an arm behind such a library does not open.
    pub guard: Option<PathBuf>,
}

/// Why an arm cannot be opened.
#[derive(Debug, thiserror::Error)]
pub enum OpenError {
    /// The profile is that of a simulated arm.
    #[error("profile {profile} is a simulated arm: it needs no link")]
    Simulated {
        /// Name.
        profile: String,
    },
    /// No node fits.
    #[error("nothing attached fits the profile of {title}{}{}", looked_for(.matching), attached(.found))]
    Missing {
        /// Name for people.
        title: String,
        /// What was looked for.
        matching: Box<Match>,
        /// What is attached.
        found: Vec<DeviceFile>,
    },
    /// Several nodes fit.
    #[error("{} attached devices could be the {title}: {}; name one with --selector or \
        `device.selector`", .candidates.len(), paths(.candidates))]
    Several {
        /// Name for people.
        title: String,
        /// Which.
        candidates: Vec<DeviceFile>,
    },
    /// Another program has the node.
    #[error("{} is held by {}: end that first", .path.display(), names(.holders))]
    Held {
        /// The node.
        path: PathBuf,
        /// Who has it open, as far as this user may see.
        holders: Vec<Holder>,
    },
    /// A serial port.
    #[error(transparent)]
    Serial(#[from] SerialError),
    /// A hidraw node.
    #[error(transparent)]
    Hid(#[from] HidOpenError),
    /// A program that serves the arm.
    #[error(transparent)]
    Service(#[from] ServiceError),
    /// USB bulk endpoints.
    #[cfg(feature = "usb")]
    #[error(transparent)]
    Usb(#[from] crate::transport::UsbError),
    /// A library of the maker, and what it says.
    #[error("the {title}: {cause}")]
    Vendor {
        /// Name for people.
        title: String,
        /// Why.
        cause: VendorError,
    },
    /// The selector means nothing that this arm could be.
    #[error("{selector} does not choose the {title}: {why}")]
    Selector {
        /// Name for people.
        title: String,
        /// What the user wrote.
        selector: Selector,
        /// What chooses such an arm.
        why: String,
    },
    /// This program was built without USB bulk transfers.
    #[error(
        "the {title} answers on USB bulk endpoints only: build with `cargo build --release \
            --features usb`"
    )]
    NoUsb {
        /// Name for people.
        title: String,
    },
    /// The start-up dialogue.
    #[error("{} is open, but the arm does not start: {cause}; {}", .path.display(), advice(.path))]
    Start {
        /// Node.
        path: PathBuf,
        /// Why.
        cause: StartError,
    },
    /// The link to an arm on another machine.
    #[error("{0}")]
    Link(Box<dyn std::error::Error + Send + Sync>),
    /// The thread that looks for a lost arm.
    #[error("cannot start a thread: {0}")]
    Thread(std::io::Error),
}

impl OpenError {
    /// What to do, line by line, where there is more to say than the error itself does.
    pub fn hint(&self) -> Option<&str> {
        match self {
            Self::Vendor { cause, .. } => cause.hint(),
            _ => None,
        }
    }
}

fn advice(path: &Path) -> &'static str {
    match path.to_string_lossy().starts_with("zenoh:") {
        true => {
            "`hapticd device-node` has to run beside the arm, under that name and where --connect \
                leads to"
        }
        false => "if it is the right arm, switch it off and on, and try again",
    }
}

fn names(holders: &[Holder]) -> String {
    if holders.is_empty() {
        // `hapticd` alone locks a hidraw node.
        return "another hapticd".to_owned();
    }
    holders
        .iter()
        .map(|holder| format!("{} (process {})", holder.name, holder.pid))
        .collect::<Vec<_>>()
        .join(", ")
}

fn paths(nodes: &[DeviceFile]) -> String {
    nodes.iter().map(|node| node.path.display().to_string()).collect::<Vec<_>>().join(", ")
}

fn looked_for(matching: &Match) -> String {
    let mut words: Vec<String> =
        matching.ids.iter().map(|id| format!("USB {:04x}:{:04x}", id.vendor, id.product)).collect();
    words.extend(matching.serial.as_ref().map(|serial| format!("serial number {serial}")));
    words.extend(matching.by_id.as_ref().map(|by_id| format!("a port named …{by_id}…")));
    if words.is_empty() {
        ", which names no device by itself".into()
    } else {
        format!(" ({})", words.join(", "))
    }
}

fn attached(nodes: &[DeviceFile]) -> String {
    if nodes.is_empty() {
        return "; no HID device or serial port is attached at all. Name the node of a mock arm or \
            adapter with --selector PATH"
            .into();
    }
    format!(
        "; attached: {}. `hapticd devices` says more; --selector PATH names a node yourself",
        paths(nodes)
    )
}

/// What becomes of a link after it was opened.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum LinkNews {
    /// The arm is gone; it is looked for.
    Lost,
    /// It is back.
    Back {
        /// At this node.
        node: PathBuf,
        /// What a person has to see to, if the arm counts from where it was switched on.
        homing: Option<String>,
    },
    /// It is there, and does not start.
    Fails(String),
    /// What there is to know of it, or to do.
    Reported(String),
    /// It has no guard: the force stays when this process is killed or stands still.
    Unguarded(String),
}

/// An arm that was opened.
pub struct OpenedArm {
    /// The driver, ready for the loop.
    pub arm: WiredArm,
    /// The device node that it was opened at.
    pub path: PathBuf,
    /// What becomes of the link: lost, back, too late.
    pub news: Receiver<LinkNews>,
}

/// Looks whether the arm of a profile is there, and opens nothing. Cold, and quick.
///
/// # Errors
/// As [`open`], as far as that can be known.
pub fn look_for(profile: &Profile, options: &OpenOptions) -> Result<(), OpenError> {
    let real = profile
        .real
        .as_ref()
        .ok_or_else(|| OpenError::Simulated { profile: profile.name.clone() })?;
    let connector = Connector::new(profile, real, options);
    match (&real.protocol, real.matching.transport) {
        (Protocol::Vendor(protocol), _) => {
            let (protocol, _) = connector.chosen(protocol)?;
            vendor::look_for(&protocol)
                .map_err(|cause| OpenError::Vendor { title: profile.title.clone(), cause })
        }
        (Protocol::HaplyService(_), _) => connector.has_no_selector(),
        (_, TransportKind::Usb) => Ok(()),
        _ => connector.node().map(|_| ()),
    }
}

/// Opens the arm of a profile. Cold; the dialogue of some arms takes seconds.
///
/// # Errors
/// See [`OpenError`].
pub fn open(profile: &Profile, options: &OpenOptions) -> Result<OpenedArm, OpenError> {
    let real = profile
        .real
        .as_ref()
        .ok_or_else(|| OpenError::Simulated { profile: profile.name.clone() })?;
    let connector = Connector::new(profile, real, options);
    // Where bytes are moved is known of the link alone, and the driver asks it.
    let io = IoPlacement::default();
    open_with(connector, wired_parameters(profile, real, options.period_s, io))
}

/// What was before a connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum PreviousLink {
    /// Nothing.
    Nothing,
    /// A link that was lost, and the arm may have been without power.
    Unplugged,
    /// A link that was lost because the arm fell silent: its plug was never out.
    Silent,
}

/// How to come to an arm, once and again.
pub(crate) trait ConnectMethod: Send + 'static {
    /// Opens the link and starts the arm.
    fn connect(&self, before: PreviousLink) -> Result<(PathBuf, Connection), OpenError>;

    /// What an arm that may have lost its power cannot know by itself.
    fn homing(&self) -> Option<String>;

    /// What there is to know of it since the last call.
    fn reported(&self) -> Option<String> {
        None
    }

    /// True for an error that only says that the arm is not there yet.
    fn is_absent(&self, error: &OpenError) -> bool;
}

/// Opens the arm at the end of a way, and keeps a thread that finds it again.
pub(crate) fn open_with(
    connector: impl ConnectMethod,
    parameters: WiredParameters,
) -> Result<OpenedArm, OpenError> {
    let connector = CheckedConnector {
        inner: connector,
        limits: parameters.limits,
        period_s: parameters.period_s,
    };
    let (path, connection, lower) = connector.connect(PreviousLink::Nothing)?;
    let (to_arm, fresh) = RingBuffer::new(1);
    let (spent, from_arm) = RingBuffer::new(1);
    let (teller, news) = bounded(NEWS);
    if let Err(cause) = &connection.guard {
        let _ = teller.try_send(LinkNews::Unguarded(cause.to_string()));
    }
    for notice in [connection.codec.notice(), lower].into_iter().flatten() {
        let _ = teller.try_send(LinkNews::Reported(notice));
    }
    let replacements = Replacements { fresh, spent };
    std::thread::Builder::new()
        .name("reconnect".to_owned())
        .spawn(move || reconnect_loop(&connector, to_arm, from_arm, &teller))
        .map_err(OpenError::Thread)?;
    let arm = WiredArm::new(connection, replacements, parameters);
    Ok(OpenedArm { arm, path, news })
}

/// The same for arms that declare no less than the loop needs.
struct CheckedConnector<C> {
    inner: C,
    /// Of the profile.
    limits: MotorLimits,
    /// One tick, s.
    period_s: f64,
}

impl<C: ConnectMethod> CheckedConnector<C> {
    /// The connection, and what the arm declares below its profile.
    fn connect(
        &self,
        before: PreviousLink,
    ) -> Result<(PathBuf, Connection, Option<String>), OpenError> {
        let (path, connection) = self.inner.connect(before)?;
        match judge_declared(&*connection.codec, self.limits, self.period_s) {
            Ok(lower) => Ok((path, connection, lower)),
            Err(cause) => {
                connection.close();
                Err(OpenError::Start { path, cause })
            }
        }
    }
}

/// What the driver needs of a profile.
pub(crate) fn wired_parameters(
    profile: &Profile,
    real: &RealArm,
    period_s: f64,
    io: IoPlacement,
) -> WiredParameters {
    WiredParameters {
        kinematics: real.kinematics,
        transmission: real.transmission,
        motor_step: real.protocol.motor_step(),
        device_from_native: real.device_from_native,
        capabilities: Capabilities {
            sensed: profile.sensed,
            actuated: profile.actuated,
            pacing: profile.link.pacing,
            io,
            watchdog_ms: profile.link.device_watchdog_ms,
            watchdog_latched: real.watchdog_latched,
            holds_last_command: profile.link.holds_last_command,
            simulated: false,
        },
        signs_verified: !profile.has_unverified_signs(),
        limits: profile.limits.of_motors(),
        unverified_limits: profile.unverified_limits().of_motors(),
        velocity_window_s: profile.velocity_window_ms.map(|window_ms| window_ms * 1e-3),
        kick_s: real.kick_ms.map(|kick_ms| f64::from(kick_ms) * 1e-3),
        delay_ticks: profile.bound_plant().delay_ticks,
        thermal: real.thermal,
        period_s,
        timebase: Timebase::Monotonic,
        link_silence_s: None,
    }
}

/// How to come to the arm, once and again.
struct Connector {
    title: String,
    real: RealArm,
    options: OpenOptions,
    /// The node that was opened first: later ones have to be of the same device.
    first: OnceLock<DeviceFile>,
    /// What the worker of a maker's library says.
    words: Mutex<Option<Words>>,
}

/// The node of the device that was opened first: at the path that the user named, or wherever the
/// device has come back. `None`: it is not there.
fn again(first: &DeviceFile, path: &Path, attached: &[DeviceFile]) -> Option<DeviceFile> {
    if !first.has_identity() {
        return Some(DeviceFile::at(path));
    }
    let same: Vec<&DeviceFile> = attached.iter().filter(|node| node.is_of_device(first)).collect();
    // One adapter with several ports: their paths may have changed places.
    let by_name = same.iter().find(|node| first.by_id.is_some() && node.by_id == first.by_id);
    let at_path = || same.iter().find(|node| node.path == *path);
    let only = || if let [node] = same.as_slice() { Some(node) } else { None };
    by_name.or_else(at_path).or_else(only).map(|node| (*node).clone())
}

/// The error for a node that another process holds names that process.
fn held(path: &Path, error: OpenError) -> OpenError {
    let is_held = match &error {
        OpenError::Serial(SerialError::Open { cause, .. }) => {
            cause.kind() == serialport::ErrorKind::NoDevice
        }
        OpenError::Hid(HidOpenError::Locked { .. }) => true,
        _ => false,
    };
    let holders = if is_held { holders(&Root::default(), path) } else { Vec::new() };
    let is_known = !holders.is_empty() || matches!(error, OpenError::Hid(_));
    if is_held && is_known { OpenError::Held { path: path.to_owned(), holders } } else { error }
}

impl Connector {
    fn new(profile: &Profile, real: &RealArm, options: &OpenOptions) -> Self {
        Self {
            title: profile.title.clone(),
            real: real.clone(),
            options: options.clone(),
            first: OnceLock::new(),
            words: Mutex::new(None),
        }
    }

    fn node(&self) -> Result<DeviceFile, OpenError> {
        let selector = self.options.selector.as_ref();
        let attached = nodes::list();
        if let Some(Selector::Path(path)) = selector {
            let path = resolved(path);
            let node = match self.first.get() {
                Some(first) => again(first, &path, &attached),
                None => Some(
                    attached
                        .iter()
                        .find(|node| node.path == path)
                        .cloned()
                        .unwrap_or_else(|| DeviceFile::at(&path)),
                ),
            };
            return node.ok_or_else(|| OpenError::Missing {
                title: self.title.clone(),
                matching: Box::new(self.real.matching.clone()),
                found: attached,
            });
        }
        // Numbers of the user's own stand in for those of the profile: boards are sold under many.
        let matching = match selector {
            Some(Selector::Usb { .. }) => {
                Match { ids: Vec::new(), by_id: None, ..self.real.matching.clone() }
            }
            _ => self.real.matching.clone(),
        };
        let fits = |node: &&DeviceFile| match selector {
            Some(selector) => selector.means(node) && matching.has_form_of(node),
            None => matching.admits(node),
        };
        let mut candidates: Vec<DeviceFile> = attached.iter().filter(fits).cloned().collect();
        match candidates.len() {
            1 => Ok(candidates.remove(0)),
            0 => Err(OpenError::Missing {
                title: self.title.clone(),
                matching: Box::new(self.real.matching.clone()),
                found: attached,
            }),
            _ => Err(OpenError::Several { title: self.title.clone(), candidates }),
        }
    }

    fn link(
        &self,
        before: PreviousLink,
    ) -> Result<(PathBuf, Box<dyn Transport>, Carriage), OpenError> {
        #[cfg(feature = "usb")]
        if self.real.matching.transport == TransportKind::Usb {
            return self.usb();
        }
        #[cfg(not(feature = "usb"))]
        if self.real.matching.transport == TransportKind::Usb {
            return Err(OpenError::NoUsb { title: self.title.clone() });
        }
        if let Protocol::HaplyService(service) = &self.real.protocol {
            self.has_no_selector()?;
            let link = ServiceLink::open(service, self.options.io_request)?;
            return Ok((PathBuf::from(&service.address), Box::new(link), Carriage::Reports));
        }
        if let Protocol::Vendor(protocol) = &self.real.protocol {
            return self.worker(protocol, before);
        }
        let node = self.node()?;
        let (link, carriage) = self.link_at(&node).map_err(|error| held(&node.path, error))?;
        let path = node.path.clone();
        let _ = self.first.set(node);
        Ok((path, link, carriage))
    }

    fn link_at(&self, node: &DeviceFile) -> Result<(Box<dyn Transport>, Carriage), OpenError> {
        Ok(match node.kind {
            NodeKind::Hid => {
                (Box::new(HidLink::open(&node.path, self.options.io_request)?), Carriage::Reports)
            }
            NodeKind::Serial => {
                (Box::new(SerialLink::open(&node.path, self.real.matching.baud)?), Carriage::Stream)
            }
        })
    }

    /// The library and the serial number that a selector chooses beside those of the profile.
    fn chosen(
        &self,
        protocol: &VendorProtocol,
    ) -> Result<(VendorProtocol, Option<String>), OpenError> {
        let mut protocol = protocol.clone();
        let mut serial = self.real.matching.serial.clone();
        let refused = |selector: &Selector, why: String| {
            Err(OpenError::Selector { title: self.title.clone(), selector: selector.clone(), why })
        };
        match &self.options.selector {
            None => {}
            // A path names the library, as it names the node of another arm.
            Some(selector @ Selector::Path(path)) if path.starts_with("/dev") => {
                return refused(
                    selector,
                    "a path names the library of its maker, and the library finds the node"
                        .to_owned(),
                );
            }
            Some(Selector::Path(path)) => protocol.library = Some(path.clone()),
            Some(selector @ Selector::Usb { vendor_id, product_id, serial: wanted }) => {
                if !protocol.family.has_usb(*vendor_id, *product_id) {
                    return refused(selector, protocol.family.selector_advice().to_owned());
                }
                // Without one it is any that the library finds, or the one of the profile.
                serial = wanted.clone().or(serial);
            }
        }
        Ok((protocol, serial))
    }

    /// An arm behind a service is chosen by keys of its profile: a selector that was passed over
    /// could choose another arm than the one that moves.
    fn has_no_selector(&self) -> Result<(), OpenError> {
        match &self.options.selector {
            None => Ok(()),
            Some(selector) => Err(OpenError::Selector {
                title: self.title.clone(),
                selector: selector.clone(),
                why: "write `address`, `arm` and `grip` under [protocol] of a copy of the profile"
                    .to_owned(),
            }),
        }
    }

    /// A worker with the library of the arm's maker. It takes the force away by itself when this
    /// process no longer can, and so needs no guard.
    fn worker(
        &self,
        protocol: &VendorProtocol,
        before: PreviousLink,
    ) -> Result<(PathBuf, Box<dyn Transport>, Carriage), OpenError> {
        let (mut protocol, serial) = self.chosen(protocol)?;
        // A person cleared the space around the arm for the first opening. An arm that comes back
        // does not move by itself.
        protocol.home &= before == PreviousLink::Nothing;
        let started = vendor::start(
            self.options.guard.as_deref(),
            &protocol,
            serial,
            self.options.io_request,
        )
        .map_err(|cause| OpenError::Vendor { title: self.title.clone(), cause })?;
        if let Ok(mut words) = self.words.lock() {
            *words = Some(started.words);
        }
        Ok((PathBuf::from(started.identity), Box::new(started.link), Carriage::Reports))
    }

    /// Starts the guard of the arm at this link, if one is asked for and there are motors.
    fn guard(&self, link: &dyn Transport, carriage: Carriage) -> std::io::Result<Option<Guard>> {
        if matches!(self.real.protocol, Protocol::Vendor(_)) {
            return Ok(None);
        }
        let zero = self.real.protocol.zero_frame(carriage);
        let Some(program) = self.options.guard.as_ref().filter(|_| !zero.is_empty()) else {
            return Ok(None);
        };
        // Above the loop, which is one above the threads of its link.
        let priority =
            self.options.io_request.map(|request| request.priority.saturating_add(2).min(99));
        Guard::start(
            program,
            link.descriptor()?,
            &ZeroFrame(link.on_wire(zero.as_slice())),
            priority,
        )
        .map(Some)
    }

    #[cfg(feature = "usb")]
    fn usb(&self) -> Result<(PathBuf, Box<dyn Transport>, Carriage), OpenError> {
        let (id, serial) = match &self.options.selector {
            Some(Selector::Usb { vendor_id, product_id, serial }) => {
                ((*vendor_id, *product_id), serial.as_deref())
            }
            _ => {
                let id =
                    self.real.matching.ids.first().map_or((0, 0), |id| (id.vendor, id.product));
                (id, self.real.matching.serial.as_deref())
            }
        };
        let link = crate::transport::UsbLink::open(id.0, id.1, serial, self.options.io_request)?;
        Ok((
            PathBuf::from(format!("USB {:04x}:{:04x}", id.0, id.1)),
            Box::new(link),
            Carriage::Stream,
        ))
    }
}

impl ConnectMethod for Connector {
    fn connect(&self, before: PreviousLink) -> Result<(PathBuf, Connection), OpenError> {
        let (path, mut link, carriage) = self.link(before)?;
        let mut codec = self.real.protocol.codec(carriage);
        if before != PreviousLink::Nothing {
            codec.started_before(before == PreviousLink::Silent);
        }
        if let Err(cause) = codec.start(&mut *link) {
            // Zero on every failed start: the dialogue may have woken motors.
            if before != PreviousLink::Nothing {
                Connection { link, codec, guard: Ok(None) }.let_go();
            } else {
                codec.finish(&mut *link);
            }
            return Err(OpenError::Start { path, cause });
        }
        let guard = self.guard(&*link, carriage);
        Ok((path, Connection { link, codec, guard }))
    }

    fn homing(&self) -> Option<String> {
        let homing = &self.real.homing;
        homing.instruction.clone().filter(|_| homing.mode == HomingMode::PowerOnPose)
    }

    fn reported(&self) -> Option<String> {
        self.words.lock().ok()?.as_mut()?.reported()
    }

    fn is_absent(&self, error: &OpenError) -> bool {
        matches!(
            error,
            OpenError::Missing { .. }
                | OpenError::Serial(SerialError::Open { .. })
                | OpenError::Service(ServiceError::Absent { .. })
        )
    }
}

/// The node behind a link, so that a link that is made anew for another node is followed.
fn resolved(path: &Path) -> PathBuf {
    std::fs::canonicalize(path).unwrap_or_else(|_| path.to_owned())
}

/// Brings a lost arm back, until the driver has gone. The lost connection comes first: its arm may
/// still make the last force, and its port is held by ourselves until it is closed.
fn reconnect_loop(
    connector: &CheckedConnector<impl ConnectMethod>,
    mut to_arm: Producer<Connection>,
    mut from_arm: Consumer<Connection>,
    teller: &Sender<LinkNews>,
) {
    let mut reported: Option<LinkNews> = None;
    let mut looks_for: Option<PreviousLink> = None;
    let mut tell = |news: LinkNews| {
        if reported.as_ref() != Some(&news) {
            // The receiver may be gone or slow: news are for display only.
            let _ = teller.try_send(news.clone());
            reported = Some(news);
        }
    };
    while !to_arm.is_abandoned() {
        if let Ok(lost) = from_arm.pop() {
            // Once: an arm that is there and does not start is not lost again with each try.
            tell(LinkNews::Lost);
            if lost.has_lost_guard() {
                tell(LinkNews::Reported(NO_GUARD.to_owned()));
            }
            looks_for =
                Some(if lost.let_go() { PreviousLink::Silent } else { PreviousLink::Unplugged });
        }
        // Before the next connection, whose words take the place of those of the lost one: why it
        // was lost is among them.
        while let Some(text) = connector.inner.reported() {
            tell(LinkNews::Reported(text));
        }
        if let Some(before) = looks_for {
            match connector.connect(before) {
                // The driver has gone meanwhile.
                Ok((_, connection, _)) if to_arm.is_abandoned() => connection.close(),
                Ok((path, connection, lower)) => {
                    let unguarded = connection
                        .guard
                        .as_ref()
                        .err()
                        .map(|cause| LinkNews::Unguarded(cause.to_string()));
                    let _ = to_arm.push(connection);
                    looks_for = None;
                    tell(LinkNews::Back { node: path, homing: connector.inner.homing() });
                    unguarded.map(&mut tell);
                    lower.map(LinkNews::Reported).map(&mut tell);
                }
                Err(error) if connector.inner.is_absent(&error) => {
                    looks_for = Some(PreviousLink::Unplugged)
                }
                Err(error) => tell(LinkNews::Fails(error.to_string())),
            }
        }
        std::thread::sleep(LOOK_AGAIN);
    }
    if let Ok(lost) = from_arm.pop() {
        lost.let_go();
    }
}

#[cfg(test)]
mod tests;
