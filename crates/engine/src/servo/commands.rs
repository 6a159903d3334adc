//! Commands into the loop: parameters, poses of movable objects and of the hand of a simulated arm,
//! other scenes.
//!
//! ```text
//!  cold side                                servo
//!  SceneControls::set, place ──┐            ┌─► at most one ParameterChange and one Placement per tick ─► tick
//!  SceneControls::hand ────────┤            ├─► the newest HandOrder ─► hand of a simulated arm ─► read ─┐
//!  SceneControls::offer ───────┴──ring──► CommandQueue
//!  SceneControls::hand_use ◄─one word─────────────────────────────────────────────────────────────────────┘
//!  SceneControls::take_replaced ◄─ring──────┴─► a scene: ramp down ──► zero force ──► exchange two pointers ──► ramp up
//! ```
//! The newest value of a parameter and the newest pose of an object count. Limits go first. What a
//! value or a pose becomes, and how fast, is the tick's concern (`haptics::live_parameters`,
//! `haptics::moving_obstacles`).
//!
//! The servo moves one box in and one out when scenes are exchanged: nothing is allocated, freed or
//! copied, and no tick is missed. The order of the supervisor goes first: after a stop nothing is
//! exchanged, and after a fault not before it is acknowledged.
#![expect(clippy::disallowed_types, reason = "filled on the cold side, never resized in the loop")]

use core::sync::atomic::{AtomicU64, Ordering};
use std::sync::Arc;

use rtrb::{Consumer, Producer, PushError, RingBuffer};

use super::LoadedScene;
use super::paths::ObjectPaths;
use super::waiting::Waiting;
use arms::simulated::HandControl;
use haptics::{LiveParameter, ParameterChange, ParameterRange, Parameters, Placement};
use rt::clock::{ClockKind, monotonic_ns};
use vps::spatial::Pose;

/// Commands that may wait for the next tick.
const RING_COMMANDS: usize = 64;

/// What the loop is asked for.
#[derive(Debug)]
enum Command {
    /// A parameter of one scene goes to a value. A limit that a person lowered is kept in every
    /// later scene.
    Change { scene_idx: u32, change: ParameterChange, is_kept: bool },
    /// An object of one scene goes to a pose.
    Place { scene_idx: u32, placement: Placement },
    /// The hand of a simulated arm, in one scene.
    Hand { scene_idx: u32, order: HandOrder, sent: Sent },
    /// Another scene, when it is due.
    Render(Box<LoadedScene>),
    /// A scene that was promised will not come.
    Skip,
}

/// What the hand of a simulated arm is asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum HandOrder {
    /// Hold the tool at a pose, `world_from_tool`.
    MoveTo(Pose),
    /// Follow the scene's path again, from its beginning.
    Restart,
}

/// Which order for the hand it is, and when it came.
#[derive(Clone, Copy, Debug)]
struct Sent {
    number: u32,
    /// Stopwatch time, ns.
    at_ns: i64,
}

/// An order for the hand that has become part of the motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HandUse {
    /// Its number, as [`SceneControls::hand`] gave it.
    pub number: u32,
    /// From when it came until a tick had read the first sample of the arm that it moved, µs.
    pub waited_us: u32,
}

/// The newest [`HandUse`] in one word, so that no half of one is read; zero: none. Numbers begin
/// with one.
#[derive(Clone, Debug, Default)]
struct NewestUse(Arc<AtomicU64>);

impl NewestUse {
    fn set(&self, Sent { number, at_ns }: Sent, now_ns: i64) {
        let waited_us = u32::try_from((now_ns - at_ns) / 1000).unwrap_or(if now_ns < at_ns {
            0
        } else {
            u32::MAX
        });
        self.0.store(u64::from(number) << 32 | u64::from(waited_us), Ordering::Relaxed);
    }

    fn get(&self) -> Option<HandUse> {
        let word = self.0.load(Ordering::Relaxed);
        (word != 0).then_some(HandUse { number: (word >> 32) as u32, waited_us: word as u32 })
    }
}

/// Why a command was not taken.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ControlError {
    /// The scene has no such parameter.
    #[error("no parameter of this scene is called `{name}`; known here: {}", known.join(", "))]
    UnknownParameter {
        /// As asked for.
        name: String,
        /// What can be set.
        known: Vec<&'static str>,
    },
    /// The value is outside of its range, or not a number.
    #[error("`{name}` goes from {} to {}, not to {value}", range.least, range.most)]
    Range {
        /// Which.
        name: &'static str,
        /// As asked for.
        value: f64,
        /// What is accepted.
        range: ParameterRange,
    },
    /// The scene has no such object.
    #[error("no object is called `{name}`; known here: {}", if known.is_empty() { "none".to_owned() } else { known.join(", ") })]
    UnknownObject {
        /// As asked for.
        name: String,
        /// Names of the movable objects.
        known: Vec<String>,
    },
    /// Two paths for one object.
    #[error("`{name}` is given twice; one path per object")]
    Twice {
        /// As asked for.
        name: String,
    },
    /// The object stands.
    #[error("`{name}` is not movable; set `movable = true` in its [[static]] table")]
    NotMovable {
        /// As asked for.
        name: String,
    },
    /// The pose is not finite, not a rotation, or absurdly far away.
    #[error(
        "not a pose that `{name}` can go to: finite, a unit quaternion, within 1 km of the world's \
            origin"
    )]
    Pose {
        /// As asked for.
        name: String,
    },
    /// A person holds the arm, or no hand does.
    #[error("only the hand of a simulated arm can be moved: {0}")]
    NoHand(&'static str),
    /// The client means another scene than the one that is rendered by now.
    #[error(
        "the pose is of scene {asked}, and scene {rendered} is rendered: read /api/v1/scene again"
    )]
    AnotherScene {
        /// As asked for.
        asked: u32,
        /// What is rendered.
        rendered: u32,
    },
    /// Commands come faster than the loop takes them.
    #[error("{RING_COMMANDS} commands are waiting for the next tick")]
    Full,
    /// The loop has ended.
    #[error("the scene is not rendered any more")]
    Over,
}

/// Why a scene was not sent to the loop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SwapError {
    /// One is waiting already.
    Waiting,
    /// The loop has ended.
    Over,
}

/// One parameter that can be set.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ParameterSetting {
    /// Which.
    pub parameter: LiveParameter,
    /// How far it goes.
    pub range: ParameterRange,
    /// Where it stands or goes to, SI.
    pub value: f64,
}

/// A value of a file that differs from the one that is set.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FileChange {
    /// Name with its unit.
    pub name: &'static str,
    /// Where the parameter was, or was going.
    pub from: f64,
    /// Where it goes.
    pub to: f64,
}

/// Static objects of a scene in their order: name, and whether each may move.
pub type Objects = Vec<(String, bool)>;

/// What can be changed in one scene.
#[derive(Debug, Default)]
struct Controls {
    objects: Objects,
    settings: Vec<ParameterSetting>,
}

impl Controls {
    fn new(parameters: &Parameters, objects: Objects) -> Self {
        let setting = |parameter: LiveParameter| {
            parameter.range(parameters).map(|range| ParameterSetting {
                parameter,
                range,
                value: range.scene,
            })
        };
        Self { objects, settings: LiveParameter::ALL.into_iter().filter_map(setting).collect() }
    }
}

/// The cold end: changes what is rendered, and sends the scene that is to be rendered next. Every
/// method is wait-free.
#[derive(Debug)]
pub struct SceneControls {
    commands: Producer<Command>,
    replaced: Consumer<Box<LoadedScene>>,
    scene_idx: u32,
    rendered: Controls,
    /// Of a scene that was sent and is not rendered yet.
    coming: Option<Controls>,
    /// Orders for the hand so far, and the newest that was used.
    n_hand_orders: u32,
    hand_use: NewestUse,
    /// Limits that a person lowered: no file and no other scene raises them.
    lowered: [Option<f64>; LiveParameter::LIMITS.len()],
}

impl SceneControls {
    /// Both ends, for a scene of these parameters and objects. Allocates.
    pub fn new(parameters: &Parameters, objects: Objects) -> (Self, CommandQueue) {
        let (commands_in, commands) = RingBuffer::new(RING_COMMANDS);
        let (replaced_in, replaced) = RingBuffer::new(1);
        let rendered = Controls::new(parameters, objects);
        let queue = CommandQueue::of(commands, replaced_in);
        let controls = Self {
            commands: commands_in,
            replaced,
            scene_idx: 0,
            rendered,
            coming: None,
            n_hand_orders: 0,
            hand_use: queue.hand_use.clone(),
            lowered: [None; 2],
        };
        (controls, queue)
    }

    /// The loop has ended.
    pub fn is_over(&self) -> bool {
        self.commands.is_abandoned()
    }

    /// How many scenes were rendered before this one.
    pub fn scene_idx(&self) -> u32 {
        self.scene_idx
    }

    /// What can be set.
    pub fn settings(&self) -> &[ParameterSetting] {
        &self.rendered.settings
    }

    /// The movable objects, by name.
    pub fn movable(&self) -> impl Iterator<Item = &str> {
        self.rendered.objects.iter().filter(|(_, movable)| *movable).map(|(name, _)| name.as_str())
    }

    /// Sets a parameter, by its name, as a person asks. It gets there along a ramp, see
    /// [`ParameterChange`](haptics::ParameterChange).
    ///
    /// # Errors
    /// [`ControlError`]; nothing changes then.
    pub fn set(&mut self, name: &str, value: f64) -> Result<(), ControlError> {
        let Some(setting) =
            self.rendered.settings.iter_mut().find(|setting| setting.parameter.name() == name)
        else {
            let known =
                self.rendered.settings.iter().map(|setting| setting.parameter.name()).collect();
            return Err(ControlError::UnknownParameter { name: name.to_owned(), known });
        };
        let ParameterSetting { parameter, range, .. } = *setting;
        // Written so that a NaN is refused as well.
        if !(value >= range.least && value <= range.most) {
            return Err(ControlError::Range { name: parameter.name(), value, range });
        }
        let lowered = limit_idx(parameter).and_then(|idx| self.lowered.get_mut(idx));
        let lowered = lowered.filter(|lowered| lowered.is_some() || value < range.scene);
        let command = Command::Change {
            scene_idx: self.scene_idx,
            change: ParameterChange { parameter, value },
            is_kept: lowered.is_some(),
        };
        send(&mut self.commands, command)?;
        setting.value = value;
        if let Some(lowered) = lowered {
            *lowered = Some(value);
        }
        Ok(())
    }

    /// What is to be set so that what is rendered is what a file with these parameters says, and no
    /// limit is raised that a person lowered; `None` where a value is out of range.
    pub fn file_changes(&self, file: &Parameters) -> Option<Vec<FileChange>> {
        let mut changes = Vec::new();
        for ParameterSetting { parameter, range, value } in &self.rendered.settings {
            let to = parameter.read(file);
            if !(to >= range.least && to <= range.most) {
                return None;
            }
            let to = bound(&self.lowered, *parameter, to).max(range.least);
            // Bits: what is the same stays the same.
            if to.to_bits() != value.to_bits() {
                changes.push(FileChange { name: parameter.name(), from: *value, to });
            }
        }
        Some(changes)
    }

    /// Sets [`Self::file_changes`] together, or none of them. Of a limit the value of the file is
    /// the largest one that clients may ask for.
    ///
    /// # Errors
    /// [`ControlError`]; nothing changes then.
    pub fn follow_file(
        &mut self,
        file: &Parameters,
        changes: &[FileChange],
    ) -> Result<(), ControlError> {
        if self.is_over() {
            return Err(ControlError::Over);
        }
        if self.commands.slots() < changes.len() {
            return Err(ControlError::Full);
        }
        for setting in &mut self.rendered.settings {
            let parameter = setting.parameter;
            if let Some(change) = changes.iter().find(|change| change.name == parameter.name()) {
                let change = ParameterChange { parameter, value: change.to };
                send(
                    &mut self.commands,
                    Command::Change { scene_idx: self.scene_idx, change, is_kept: false },
                )?;
                setting.value = change.value;
            }
            setting.range.scene = parameter.read(file);
            if parameter.is_limit() {
                setting.range.most = setting.range.scene;
            }
        }
        Ok(())
    }

    /// Asks an object to go to a pose, `world_from_object`. It goes there as fast as it may from
    /// the next tick on; a later command for the same object replaces this one.
    ///
    /// # Errors
    /// [`ControlError`]; nothing moves then.
    pub fn place(&mut self, name: &str, world_from_object: Pose) -> Result<(), ControlError> {
        let placement = checked(&self.rendered.objects, name, world_from_object)?;
        send(&mut self.commands, Command::Place { scene_idx: self.scene_idx, placement })
    }

    /// Asks the hand of a simulated arm for something, and gives the number of this order. The hand
    /// goes to a pose as fast as it may; a later order replaces this one.
    ///
    /// # Errors
    /// [`ControlError`]; nothing moves then.
    pub fn hand(&mut self, order: HandOrder) -> Result<u32, ControlError> {
        if let HandOrder::MoveTo(world_from_map) = order
            && !(Placement { obstacle_idx: 0, world_from_map }).is_sound()
        {
            return Err(ControlError::Pose { name: "hand".to_owned() });
        }
        let sent =
            Sent { number: self.n_hand_orders.wrapping_add(1).max(1), at_ns: monotonic_ns() };
        send(&mut self.commands, Command::Hand { scene_idx: self.scene_idx, order, sent })?;
        self.n_hand_orders = sent.number;
        Ok(sent.number)
    }

    /// The newest order for the hand that a tick has used.
    pub fn hand_use(&self) -> Option<HandUse> {
        self.hand_use.get()
    }

    /// Sends a scene that takes the place of the one that is rendered; it must have been made for
    /// the same period and arm.
    ///
    /// # Errors
    /// The scene comes back when another one is waiting, and when the loop has ended.
    pub fn offer(
        &mut self,
        scene: Box<LoadedScene>,
        objects: Objects,
    ) -> Result<(), (SwapError, Box<LoadedScene>)> {
        if self.is_over() {
            return Err((SwapError::Over, scene));
        }
        if self.coming.is_some() || self.commands.slots() == 0 {
            return Err((SwapError::Waiting, scene));
        }
        let coming = Controls::new(&scene.scene.parameters, objects);
        // There is a free place, and only this side fills it.
        if self.commands.push(Command::Render(scene)).is_ok() {
            self.coming = Some(coming);
        }
        Ok(())
    }

    /// A scene that was promised will not come: simulated time does not wait for it.
    ///
    /// # Errors
    /// [`ControlError::Full`] and [`ControlError::Over`].
    pub fn skip(&mut self) -> Result<(), ControlError> {
        send(&mut self.commands, Command::Skip)
    }

    /// The scene that was rendered before, to be freed here; from then on these controls are those
    /// of the one that took its place.
    pub fn take_replaced(&mut self) -> Option<Box<LoadedScene>> {
        let replaced = self.replaced.pop().ok()?;
        self.rendered = self.coming.take().unwrap_or_default();
        self.scene_idx += 1;
        for ParameterSetting { parameter, range, value } in &mut self.rendered.settings {
            *value = bound(&self.lowered, *parameter, *value).max(range.least.min(*value));
        }
        Some(replaced)
    }
}

fn send(commands: &mut Producer<Command>, command: Command) -> Result<(), ControlError> {
    if commands.is_abandoned() {
        return Err(ControlError::Over);
    }
    commands.push(command).map_err(|PushError::Full(_)| ControlError::Full)
}

fn limit_idx(parameter: LiveParameter) -> Option<usize> {
    LiveParameter::LIMITS.into_iter().position(|limit| limit == parameter)
}

/// What a scene or a file may have of a value where persons lowered limits.
fn bound(
    lowered: &[Option<f64>; LiveParameter::LIMITS.len()],
    parameter: LiveParameter,
    value: f64,
) -> f64 {
    let lowered = limit_idx(parameter).and_then(|idx| lowered.get(idx).copied().flatten());
    lowered.map_or(value, |lowered| value.min(lowered))
}

/// A pose that an object of a scene can go to.
pub(super) fn checked(
    objects: &[(String, bool)],
    name: &str,
    world_from_map: Pose,
) -> Result<Placement, ControlError> {
    let Some(obstacle_idx) = objects.iter().position(|(known, _)| known == name) else {
        let known =
            objects.iter().filter(|(_, movable)| *movable).map(|(name, _)| name.clone()).collect();
        return Err(ControlError::UnknownObject { name: name.to_owned(), known });
    };
    if !objects.get(obstacle_idx).is_some_and(|(_, movable)| *movable) {
        return Err(ControlError::NotMovable { name: name.to_owned() });
    }
    let placement = Placement { obstacle_idx: obstacle_idx as u32, world_from_map };
    if placement.is_sound() {
        Ok(placement)
    } else {
        Err(ControlError::Pose { name: name.to_owned() })
    }
}

/// The loop's end.
#[derive(Debug)]
pub struct CommandQueue {
    commands: Consumer<Command>,
    replaced: Producer<Box<LoadedScene>>,
    /// Values that the tick has not got yet, in the order of [`LiveParameter::ALL`].
    changes: [Option<f64>; LiveParameter::ALL.len()],
    /// Limits that a person lowered.
    kept: [Option<f64>; LiveParameter::LIMITS.len()],
    /// What the hand has not been reported yet, and what it was ordered since the arm was read.
    hand: Option<(HandOrder, Sent)>,
    reported: Option<Sent>,
    hand_use: NewestUse,
    next_scene: Option<Box<LoadedScene>>,
    paths: ObjectPaths,
    /// Ticks at which simulated time waits for a scene that has been promised, rising; and how many
    /// scenes there have been.
    promised_ticks: Box<[u64]>,
    n_scenes: usize,
}

impl Default for CommandQueue {
    /// Nothing is asked for.
    fn default() -> Self {
        Self::of(RingBuffer::new(1).1, RingBuffer::new(1).0)
    }
}

impl CommandQueue {
    fn of(commands: Consumer<Command>, replaced: Producer<Box<LoadedScene>>) -> Self {
        Self {
            commands,
            replaced,
            changes: [None; LiveParameter::ALL.len()],
            kept: [None; LiveParameter::LIMITS.len()],
            hand: None,
            reported: None,
            hand_use: NewestUse::default(),
            next_scene: None,
            paths: ObjectPaths::default(),
            promised_ticks: Box::default(),
            n_scenes: 0,
        }
    }

    /// The same, while objects of the first scene follow paths.
    #[must_use]
    pub fn with_paths(mut self, paths: ObjectPaths) -> Self {
        self.paths = paths;
        self
    }

    /// The same, with scenes that will come. Real time does not wait: a scene that is late is taken
    /// late. Simulated time waits at these ticks (rising), so that two runs are the same.
    #[must_use]
    pub fn with_promised(mut self, promised_ticks: Box<[u64]>) -> Self {
        self.promised_ticks = promised_ticks;
        self
    }

    /// Takes every command that is there; those of a scene that is not rendered any more are
    /// dropped, but for limits that a person lowered. RT: safe, at most as many as the ring holds.
    pub(super) fn receive(&mut self, rendered: &mut LoadedScene, rendered_idx: u32) {
        for _ in 0..RING_COMMANDS {
            let Ok(command) = self.commands.pop() else { return };
            match command {
                Command::Change {
                    scene_idx,
                    change: ParameterChange { parameter, value },
                    is_kept,
                } => {
                    if is_kept
                        && let Some(kept) =
                            limit_idx(parameter).and_then(|idx| self.kept.get_mut(idx))
                    {
                        *kept = Some(value);
                    }
                    if (is_kept || scene_idx == rendered_idx)
                        && let Some(change) = self.changes.get_mut(parameter as usize)
                    {
                        *change = Some(value);
                    }
                }
                Command::Place {
                    scene_idx,
                    placement: Placement { obstacle_idx, world_from_map },
                } => {
                    if scene_idx == rendered_idx
                        && let Some(pose) = rendered.asked_poses.get_mut(obstacle_idx as usize)
                    {
                        *pose = Some(world_from_map);
                    }
                }
                Command::Hand { scene_idx, order, sent } if scene_idx == rendered_idx => {
                    self.hand = Some((order, sent))
                }
                Command::Hand { .. } => {}
                Command::Render(scene) => {
                    self.n_scenes += 1;
                    if let Some(unseen) = self.next_scene.replace(scene) {
                        // Cannot be: the cold side sends one at a time. Kept rather than freed.
                        core::mem::forget(unseen);
                    }
                }
                Command::Skip => self.n_scenes += 1,
            }
        }
    }

    /// What a parameter is to become; limits first: of a scene that takes the place of another they
    /// count before its first force. RT: safe.
    pub(super) fn next_change(&mut self) -> Option<ParameterChange> {
        let mut order = LiveParameter::LIMITS.into_iter().chain(LiveParameter::ALL);
        order.find_map(|parameter| {
            Some(ParameterChange {
                parameter,
                value: self.changes.get_mut(parameter as usize)?.take()?,
            })
        })
    }

    /// Where an object is to go: what a client asked for, then the paths. RT: safe; O(objects),
    /// O(log n) in the length of a path.
    pub(super) fn next_placement(
        &mut self,
        rendered: &mut LoadedScene,
        time_s: f64,
    ) -> Option<Placement> {
        let mut asked = rendered.asked_poses.iter_mut().zip(0_u32..);
        let asked = asked.find_map(|(pose, obstacle_idx)| {
            Some(Placement { obstacle_idx, world_from_map: pose.take()? })
        });
        asked.or_else(|| self.paths.next(time_s))
    }

    /// Passes on what the hand of a simulated arm is asked for, and where the tool is. RT: safe.
    pub(super) fn guide_hand(&mut self, hand: Option<&mut HandControl>, world_from_tool: Pose) {
        let order = self.hand.take();
        let Some(hand) = hand else { return };
        if let Some((order, sent)) = order {
            self.reported = Some(sent);
            match order {
                HandOrder::MoveTo(pose) => hand.move_to(pose),
                HandOrder::Restart => hand.restart(world_from_tool),
            }
        }
        hand.see(world_from_tool);
    }

    /// The arm has been read at `now_ns` of the stopwatch: what the hand was sent has moved it. RT:
    /// safe.
    pub(super) fn note_read(&mut self, now_ns: i64) {
        if let Some(sent) = self.reported.take() {
            self.hand_use.set(sent, now_ns);
        }
    }

    /// True when there is a scene to be rendered in this tick. Simulated time waits for one that is
    /// promised, unless `is_hurried`. RT: safe.
    pub(super) fn is_scene_due(
        &mut self,
        rendered: &mut LoadedScene,
        (tick, rendered_idx): (u64, u32),
        clock: ClockKind,
        is_hurried: impl Fn() -> bool,
    ) -> bool {
        let waiting = Waiting::new();
        while clock == ClockKind::Virtual
            && self.next_scene.is_none()
            && self.promised_ticks.get(self.n_scenes).is_some_and(|promised| tick >= *promised)
            && !(self.commands.is_abandoned() && self.commands.is_empty())
            && !is_hurried()
        {
            self.receive(rendered, rendered_idx);
            waiting.pause();
        }
        // Without a free place for the old one the new one waits: nothing is ever freed here.
        self.next_scene.as_ref().is_some_and(|next| tick >= next.at_tick)
            && self.replaced.slots() > 0
    }

    /// Exchanges the scene that is waiting for the one that is rendered. RT: safe; two pointers.
    pub(super) fn exchange(&mut self, rendered: &mut Box<LoadedScene>) -> bool {
        let Some(next) = self.next_scene.take() else { return false };
        let old = core::mem::replace(rendered, next);
        if let Err(PushError::Full(old)) = self.replaced.push(old) {
            // Cannot be: `is_scene_due` saw a free place, and only this side fills it. Kept rather
            // than freed.
            core::mem::forget(old);
        }
        self.changes = [None; LiveParameter::ALL.len()];
        for (limit, kept) in LiveParameter::LIMITS.into_iter().zip(self.kept) {
            if let Some(change) = self.changes.get_mut(limit as usize) {
                *change = kept;
            }
        }
        self.hand = None;
        self.paths.stop();
        true
    }
}

#[cfg(test)]
mod tests;
