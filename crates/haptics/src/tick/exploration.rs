//! Every way of the drive: whatever orders, gates, faults and scene swaps follow on one another, in
//! any order and number.
//!
//! The real [`tick`] is driven breadth-first from the first tick on, with every order together with
//! everything that an arm can show, one of [`ARM`] per tick. Two states count as the same when
//! [`StateKey`] is: the drive and its gates, the steps of every ramp and every counter that decides
//! on anything. All that is new is gone on from until nothing is, so there is no depth beyond which
//! nothing was looked at. What the arm has shown is also noted beside the tick ([`History`]), so
//! that the rules are judged by that and not by the tick's own memory.
//!
//! Left out: `stuck`, `power` and `solver`, which need a motion, and the parameters and obstacles
//! that a client changes. The rules are those of `docs/reference/safety.md`; the time steps are
//! coarse, so that a ramp has three.

use std::collections::HashMap;

use super::*;
use crate::testing::spring_scene;
use crate::{ArmParameters, LimitParameters, SafetyParameters};
use vps::spatial::SampleStatus;

const PERIOD_S: f64 = 0.05;
const RAMP_TICKS: u8 = 3;
const BRAKE_TICKS: u8 = 2;
/// What the slew limit and rounding may add to a ramp.
const GRACE_TICKS: u8 = 2;
/// Steps of the gain that both ramps meet: three up, and two down in a tenth of a second.
const GAIN_STEPS: u8 = 6;
const STALE_TICKS: u8 = 1;
const STALE_FAULT_TICKS: u8 = 3;
const LATE_TICKS: u8 = 2;
/// Garbled packets count for so long: a tenth of a second.
const GARBLED_TICKS: u8 = 2;
const ENGAGE_TICKS: u32 = 1;
const SLEW_N: f64 = 2.5;
const BUTTON: u8 = 2;
/// K of the spring to a tool that does not move, and where the arm may be: at rest, pulled with 3.9
/// N, outside, and somewhere else altogether.
const K_N_PER_M: f64 = 100.0;
const PLACES_M: [f64; 4] = [0.0, 0.039, 0.045, 100.0];
const OUTSIDE: u8 = 2;
const AFAR: u8 = 3;
const FAST_M_PER_S: f64 = 1.2;
/// States beyond which something grows that the abstraction forgot to bound.
const MOST_STATES: usize = 1_000_000;

type TickFunction = fn(&RenderScene, &mut State, &TickInput) -> TickOutput;

/// What the arm shows in a tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Arm {
    /// Nothing is wrong, and it is there.
    At(u8),
    LetGo,
    NotHomed,
    Overheated,
    Stale,
    Lost,
    LinkLost,
    NotANumber,
    Fast,
    Late,
    Error,
    Garbled,
    Gap,
}

const ARM: [Arm; 16] = [
    Arm::At(0),
    Arm::At(1),
    Arm::At(OUTSIDE),
    Arm::At(AFAR),
    Arm::LetGo,
    Arm::NotHomed,
    Arm::Overheated,
    Arm::Stale,
    Arm::Lost,
    Arm::LinkLost,
    Arm::NotANumber,
    Arm::Fast,
    Arm::Late,
    Arm::Error,
    Arm::Garbled,
    Arm::Gap,
];

const ORDERS: [DriveRequest; 3] = [DriveRequest::Disable, DriveRequest::Enable, DriveRequest::Stop];

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Event {
    Tick(DriveRequest, Arm),
    /// Another scene waits to take the place of this one.
    Offered,
}

impl Arm {
    fn status(self) -> SampleStatus {
        match self {
            Self::Stale => SampleStatus::Stale,
            Self::Lost => SampleStatus::Lost,
            Self::LinkLost => SampleStatus::LinkLost,
            _ => SampleStatus::Fresh,
        }
    }

    fn input(self, request: DriveRequest, history: &History) -> TickInput {
        let place = if let Self::At(place) = self { place } else { history.place };
        let mut sample = DeviceSample {
            status: self.status(),
            buttons: u32::from(self != Self::LetGo) << BUTTON,
            homed: self != Self::NotHomed,
            overheated: self == Self::Overheated,
            device_error: u16::from(self == Self::Error),
            corrupt_packets: if self == Self::Garbled { 11 } else { 0 },
            lost_packets: if self == Self::Gap { u16::from(STALE_FAULT_TICKS) } else { 0 },
            ..DeviceSample::default()
        };
        sample.pose.translation.x = PLACES_M[usize::from(place)];
        if self == Self::NotANumber {
            sample.pose.translation.y = f64::NAN;
        }
        if self == Self::Fast {
            sample.twist.linear.x = FAST_M_PER_S;
        }
        TickInput { sample, request, overrun: self == Self::Late, ..TickInput::default() }
    }
}

/// What was shown and ordered until now, as far as rules ask for it. Counters stop where no rule
/// asks any further.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct History {
    place: u8,
    /// Where it was at enable: what pulls now follows from both.
    zero: u8,
    /// Where the last sample was that can be compared with; what a jump is.
    compared: Option<bool>,
    stale: u8,
    late: u8,
    since_garbled: u8,
    /// The deadman was seen open since the last fault.
    was_let_go: bool,
    is_offered: bool,
    /// Ticks in a row in which something takes the force away, and in `Stopping`.
    down: u8,
    stopping: u8,
    /// Ticks in a row in `Enabling`.
    enabling: u8,
}

const START: History = History {
    place: 0,
    zero: 0,
    compared: None,
    stale: 0,
    late: 0,
    since_garbled: GARBLED_TICKS,
    was_let_go: true,
    is_offered: false,
    down: 0,
    stopping: 0,
    enabling: 0,
};

/// Ticks in a row in which something is so, as far as they are counted.
fn count(is_so: bool, ticks: u8, most: u8) -> u8 {
    if is_so { (ticks + 1).min(most) } else { 0 }
}

impl History {
    /// The same after the arm has shown this.
    fn after(mut self, arm: Arm, request: DriveRequest, has_deadman: bool) -> Self {
        if let Arm::At(place) = arm {
            self.place = place;
        }
        let is_gone = arm.status().is_gone();
        self.late = count(arm == Arm::Late, self.late, LATE_TICKS);
        self.stale = count(arm.status() != SampleStatus::Fresh, self.stale, STALE_FAULT_TICKS + 1);
        self.since_garbled =
            if arm == Arm::Garbled { 0 } else { (self.since_garbled + 1).min(GARBLED_TICKS) };
        if is_gone {
            (self.since_garbled, self.compared) = (GARBLED_TICKS, None);
        } else if arm.status() == SampleStatus::Fresh && arm != Arm::NotANumber {
            self.compared = Some(self.place == AFAR);
        }
        self.was_let_go |= arm == Arm::LetGo;
        let takes_away = request == DriveRequest::Stop
            || arm == Arm::Overheated
            || has_deadman && arm == Arm::LetGo
            || self.place >= OUTSIDE
            || self.stale > STALE_TICKS;
        self.down = count(takes_away, self.down, u8::MAX);
        self
    }

    /// Faults other than `speed` that a drive with force has to have after the arm has shown this,
    /// at once.
    fn faults(&self, before: &Self, arm: Arm) -> Faults {
        let jumped = arm.status() == SampleStatus::Fresh
            && arm != Arm::NotANumber
            && before.compared.is_some_and(|was_afar| was_afar != (self.place == AFAR));
        let is_gone = arm.status().is_gone();
        [
            (arm == Arm::Lost, Faults::DEVICE_LOST),
            (arm == Arm::LinkLost, Faults::LINK),
            (arm == Arm::NotHomed, Faults::NOT_HOMED),
            (arm == Arm::NotANumber, Faults::NON_FINITE),
            (arm == Arm::Error, Faults::DEVICE_ERROR),
            (arm == Arm::Gap, Faults::SEQUENCE_GAP),
            (self.since_garbled < GARBLED_TICKS && !is_gone, Faults::PROTOCOL),
            (self.late >= LATE_TICKS, Faults::OVERRUN),
            (arm == Arm::Stale && self.stale > STALE_FAULT_TICKS, Faults::STALE),
            (jumped, Faults::POSITION_JUMP),
        ]
        .into_iter()
        .filter(|(is_so, _)| *is_so)
        .fold(Faults::NONE, |faults, (_, fault)| faults | fault)
    }
}

/// What distinguishes two states.
#[derive(PartialEq, Eq, Hash)]
struct StateKey {
    drive: u8,
    interlock: (u32, [u32; 2], [bool; 5]),
    gain_steps: u8,
    force_steps: u8,
    resume: Option<Option<bool>>,
    history: History,
}

#[derive(Clone)]
struct Node {
    state: State,
    history: History,
    last: TickOutput,
}

impl Node {
    fn seen(&self) -> StateKey {
        let Self { state, history, .. } = self;
        StateKey {
            drive: state.drive as u8,
            interlock: state.interlock.decides(ENGAGE_TICKS + 1),
            gain_steps: (state.enable_gain.gain * f64::from(GAIN_STEPS)).round() as u8,
            force_steps: (state.limiter.last.force.length() / SLEW_N).ceil() as u8,
            resume: state.resume.map(|resume| resume.has_room),
            history: *history,
        }
    }
}

/// What is explored: an arm on a spring to a tool that nothing moves, and the rule whether a swap
/// may happen.
struct World {
    scene: RenderScene,
    tick: TickFunction,
    may_swap: fn(&TickOutput) -> bool,
    hand_over: fn(&State, &RenderScene) -> Handover,
}

/// As the loop has it (`swap_at_zero` in `servo/step.rs`).
fn is_at_zero(output: &TickOutput) -> bool {
    output.drive == Drive::Disabled
        && output.command_device == Wrench::ZERO
        && output.faults.is_empty()
}

/// A rule that was broken.
type Broken = &'static str;

impl World {
    fn new(change: impl FnOnce(&mut Parameters)) -> Self {
        let mut scene = spring_scene(K_N_PER_M);
        let p = &mut scene.parameters;
        p.period_s = PERIOD_S;
        p.limits = LimitParameters {
            slew_n_per_s: SLEW_N / PERIOD_S,
            ramp_s: f64::from(RAMP_TICKS) * PERIOD_S,
            stale_ticks_max: u32::from(STALE_TICKS),
            stale_fault_ticks: u32::from(STALE_FAULT_TICKS),
            overrun_fault_ticks: u32::from(LATE_TICKS),
            ..p.limits
        };
        p.safety = SafetyParameters {
            deadman: Some(BUTTON),
            workspace_radius_m: 0.04,
            brake_s: f64::from(BRAKE_TICKS) * PERIOD_S,
            engage_share: 0.1,
            engage_ticks: ENGAGE_TICKS,
            ..p.safety
        };
        change(p);
        Self { scene, tick, may_swap: is_at_zero, hand_over: |state, _| state.handover() }
    }

    fn has_deadman(&self) -> bool {
        self.scene.parameters.safety.deadman.is_some()
    }

    fn start(&self) -> Node {
        Node { state: State::new(&self.scene), history: START, last: TickOutput::default() }
    }

    /// One event. `None`: it changes nothing.
    fn follow(&self, node: &Node, event: Event) -> Result<Option<Node>, Broken> {
        let mut next = node.clone();
        let Event::Tick(order, arm) = event else {
            next.history.is_offered = true;
            return Ok((!node.history.is_offered).then_some(next));
        };
        // As in the loop: a swap that is due ramps down first, and waits while a stop or a fault
        // goes before it.
        let swaps = node.history.is_offered
            && matches!(order, DriveRequest::Enable | DriveRequest::Disable)
            && node.last.faults.is_empty();
        let request =
            if swaps && order == DriveRequest::Enable { DriveRequest::Stop } else { order };
        next.history = node.history.after(arm, request, self.has_deadman());
        let input = arm.input(request, &next.history);
        let output = (self.tick)(&self.scene, &mut next.state, &input);
        next.last = output;
        self.judge(node, &next.history, (request, arm), &output)?;

        next.history.enabling =
            count(output.drive == Drive::Enabling, node.history.enabling, RAMP_TICKS);
        next.history.stopping =
            count(output.drive == Drive::Stopping, node.history.stopping, u8::MAX);
        if output.command_device == Wrench::ZERO {
            next.history.down = 0;
        }
        match output.drive {
            Drive::Enabling if node.last.drive != Drive::Enabling => {
                next.history.zero = next.history.place
            }
            // Without force nothing pulls.
            drive if !drive.has_force() => next.history.zero = 0,
            _ => {}
        }
        // A fault counts from its own tick on.
        if output.drive == Drive::Fault && node.last.drive != Drive::Fault {
            next.history.was_let_go = false;
        }
        if swaps && (self.may_swap)(&output) {
            if output.command_device != Wrench::ZERO || output.drive != Drive::Disabled {
                return Err("a swap under force");
            }
            let mut state = State::new(&self.scene);
            state.resume_at(
                &self.scene,
                Some(output.world_from_tool),
                (self.hand_over)(&next.state, &self.scene),
            );
            next = Node {
                state,
                history: History {
                    is_offered: false,
                    was_let_go: next.history.was_let_go,
                    ..START
                },
                last: output,
            };
            next.history.place = node.history.place;
        }
        Ok(Some(next))
    }

    /// The rules.
    fn judge(
        &self,
        before: &Node,
        history: &History,
        (request, arm): (DriveRequest, Arm),
        output: &TickOutput,
    ) -> Result<(), Broken> {
        let was = before.last.drive;
        let is = output.drive;
        let force_n = output.command_device.force.length();
        let before_n = before.last.command_device.force.length();
        let is_zero = output.command_device == Wrench::ZERO;
        let has_deadman = self.has_deadman();
        let rules = [
            ("a command that is not a number", output.command_device.is_finite()),
            ("force in a state without", is.has_force() || is_zero),
            (
                "force while a fault is active",
                output.faults.is_empty() || is_zero && is == Drive::Fault,
            ),
            (
                "a disable that is not obeyed in its tick",
                request != DriveRequest::Disable || is_zero && !is.has_force(),
            ),
            (
                "force too long after it was taken away",
                is_zero || history.down <= RAMP_TICKS + BRAKE_TICKS + GRACE_TICKS,
            ),
            (
                "a stop that takes longer than its ramp",
                is != Drive::Stopping || before.history.stopping < RAMP_TICKS + GRACE_TICKS,
            ),
            (
                "full force without a ramp",
                is != Drive::Enabled
                    || was == Drive::Enabled
                    || before.history.enabling >= RAMP_TICKS - 1,
            ),
            ("a step of the force", is_zero || force_n <= before_n + SLEW_N * (1.0 + 1e-9)),
            (
                "a ramp that begins with force",
                is != Drive::Enabling || was == Drive::Enabling || is_zero,
            ),
        ];
        let broken = rules.into_iter().find(|(_, holds)| !holds);
        broken.map_or(Ok(()), |(rule, _)| Err(rule))?;

        let sudden = history.faults(&before.history, arm);
        if was.has_force()
            && !sudden.is_empty()
            && (is != Drive::Fault || !output.faults.contains(sudden))
        {
            return Err("a fault that does not end the force in its tick");
        }
        if was.has_force() && arm == Arm::Fast && is.renders() {
            return Err("the scene goes on driving an arm that is too fast");
        }
        let takes_away = request == DriveRequest::Stop
            || arm == Arm::Overheated
            || has_deadman && arm == Arm::LetGo;
        if takes_away && matches!(is, Drive::Enabling | Drive::Enabled) {
            return Err("a drive that goes on although a stop, heat or an open deadman says no");
        }
        if was == Drive::Fault && is != Drive::Fault && request != DriveRequest::Disable {
            let is_acknowledged = has_deadman
                && history.was_let_go
                && arm != Arm::LetGo
                && request == DriveRequest::Enable;
            // Homing is a gate for a drive without force.
            if !is_acknowledged || !sudden.without(Faults::NOT_HOMED).is_empty() {
                return Err("a fault is gone without an acknowledgement");
            }
        }
        if is == Drive::Enabling && was != Drive::Enabling {
            if !matches!(was, Drive::Disabled | Drive::Fault) || request != DriveRequest::Enable {
                return Err("enabled out of turn");
            }
            let is_open =
                matches!(arm, Arm::At(_) | Arm::Late) || arm == Arm::LetGo && !has_deadman;
            let is_sound = is_open && sudden.is_empty() && history.place < OUTSIDE;
            if !is_sound {
                return Err("enabled behind a shut gate");
            }
            if has_deadman && !history.was_let_go {
                return Err("enabled by a deadman that was not let go since the fault");
            }
        }
        Ok(())
    }

    /// Goes every way. What was reached, or the shortest way to a broken rule.
    fn explore(&self) -> Result<Reached, (Broken, Vec<Event>)> {
        let events: Vec<Event> =
            ORDERS.into_iter().flat_map(|order| ARM.map(|arm| Event::Tick(order, arm))).collect();
        // By number: where it was come from, and how.
        let mut steps: Vec<(usize, Event)> = Vec::new();
        let mut seen = HashMap::new();
        let start = self.start();
        seen.insert(start.seen(), 0);
        let mut reached = Reached::default();
        let mut ring = vec![(0, start)];
        let mut number = 0;
        while !ring.is_empty() {
            reached.depth += 1;
            let mut next_ring = Vec::new();
            for (from, node) in ring {
                for event in events.iter().copied().chain([Event::Offered]) {
                    let next = match self.follow(&node, event) {
                        Ok(Some(next)) => next,
                        Ok(None) => continue,
                        Err(rule) => return Err((rule, way(&steps, from, event))),
                    };
                    reached.ticks += 1;
                    reached.drives |= 1 << next.state.drive as u8;
                    reached.faults |= next.last.faults;
                    reached.most_n = reached.most_n.max(next.last.command_device.force.length());
                    if let std::collections::hash_map::Entry::Vacant(place) =
                        seen.entry(next.seen())
                    {
                        number += 1;
                        place.insert(number);
                        steps.push((from, event));
                        next_ring.push((number, next));
                    }
                }
            }
            assert!(seen.len() < MOST_STATES, "something grows without end");
            ring = next_ring;
        }
        reached.states = seen.len();
        Ok(reached)
    }
}

fn way(steps: &[(usize, Event)], mut from: usize, last: Event) -> Vec<Event> {
    let mut way = vec![last];
    while let Some((before, event)) = from.checked_sub(1).and_then(|idx| steps.get(idx)) {
        way.push(*event);
        from = *before;
    }
    way.reverse();
    way
}

#[derive(Debug, Default)]
struct Reached {
    states: usize,
    ticks: usize,
    /// Longest of the shortest ways.
    depth: usize,
    drives: u8,
    faults: Faults,
    most_n: f64,
}

/// All that the arm can show leads to.
const ALL_FAULTS: [Faults; 12] = [
    Faults::NON_FINITE,
    Faults::SPEED,
    Faults::STALE,
    Faults::DEVICE_LOST,
    Faults::OVERRUN,
    Faults::POSITION_JUMP,
    Faults::NOT_HOMED,
    Faults::PROTOCOL,
    Faults::DEVICE_ERROR,
    Faults::SEQUENCE_GAP,
    Faults::THERMAL,
    Faults::LINK,
];

fn assert_explored(world: &World, drives: &[Drive]) {
    let reached = world.explore().unwrap_or_else(|(rule, way)| panic!("{rule}, after {way:#?}"));
    let wanted = drives.iter().fold(0, |drives, drive| drives | 1 << *drive as u8);
    assert_eq!(reached.drives, wanted, "{reached:?}");
    assert!(ALL_FAULTS.into_iter().all(|fault| reached.faults.contains(fault)), "{reached:?}");
    assert!(reached.most_n > 1.0, "no force to speak of: {reached:?}");
    assert!(
        reached.depth > usize::from(2 * RAMP_TICKS),
        "no ramp up and down fits in: {reached:?}"
    );
}

const ALL: [Drive; 6] = [
    Drive::Disabled,
    Drive::Enabling,
    Drive::Enabled,
    Drive::Stopping,
    Drive::Fault,
    Drive::Braking,
];

#[test]
fn no_order_gate_fault_or_swap_leads_to_force_where_none_may_be() {
    assert_explored(&World::new(|_| ()), &ALL);
}

#[test]
fn nor_does_any_without_a_deadman() {
    assert_explored(&World::new(|p| p.safety.deadman = None), &ALL);
}

#[test]
fn nor_does_any_with_an_arm_that_takes_no_damping() {
    let all_but_braking = &ALL[..5];
    assert_explored(&World::new(|p| p.arm = ArmParameters::default()), all_but_braking);
}

/// Ticks that are wrong in one way each, and the rule that they break.
#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn a_tick_that_breaks_a_rule_is_found_out() {
    /// Holds the last command where it has to be zero.
    fn hold(
        (scene, state): (&RenderScene, &mut State),
        input: &TickInput,
        holds: fn(&TickInput, &TickOutput) -> bool,
    ) -> TickOutput {
        let last = state.limiter.last;
        let output = tick(scene, state, input);
        let command_device = if holds(input, &output) { last } else { output.command_device };
        TickOutput { command_device, ..output }
    }
    let broken: [(TickFunction, Broken); 9] = [
        (
            |scene, state, input| {
                hold((scene, state), input, |input, _| input.request == DriveRequest::Disable)
            },
            "force in a state without",
        ),
        (
            |scene, state, input| {
                hold((scene, state), input, |_, output| output.drive == Drive::Fault)
            },
            "force in a state without",
        ),
        (
            |scene, state, input| {
                let is_on = state.drive == Drive::Enabled;
                let request = if is_on && input.request == DriveRequest::Disable {
                    DriveRequest::Stop
                } else {
                    input.request
                };
                tick(scene, state, &TickInput { request, ..*input })
            },
            "a disable that is not obeyed in its tick",
        ),
        (
            |scene, state, input| {
                let request = if input.request == DriveRequest::Stop {
                    DriveRequest::Enable
                } else {
                    input.request
                };
                tick(scene, state, &TickInput { request, ..*input })
            },
            "a drive that goes on although a stop, heat or an open deadman says no",
        ),
        (
            |scene, state, input| {
                if state.drive == Drive::Stopping {
                    state.enable_gain.advance(
                        true,
                        scene.parameters.limits.ramp_down_s(),
                        scene.parameters.period_s,
                    );
                }
                tick(scene, state, input)
            },
            "a stop that takes longer than its ramp",
        ),
        (
            |scene, state, input| {
                if state.drive == Drive::Enabling {
                    state.enable_gain.advance(true, 0.0, scene.parameters.period_s);
                }
                tick(scene, state, input)
            },
            "full force without a ramp",
        ),
        (
            |scene, state, input| {
                let device_error =
                    if state.drive.has_force() { 0 } else { input.sample.device_error };
                let sample = DeviceSample { device_error, ..input.sample };
                tick(scene, state, &TickInput { sample, ..*input })
            },
            "a fault that does not end the force in its tick",
        ),
        (
            |scene, state, input| {
                if state.drive == Drive::Fault && input.request == DriveRequest::Stop {
                    (state.drive, state.faults) = (Drive::Disabled, Faults::NONE);
                }
                tick(scene, state, input)
            },
            "a fault is gone without an acknowledgement",
        ),
        (
            |scene, state, input| {
                let sample = DeviceSample { homed: true, ..input.sample };
                tick(scene, state, &TickInput { sample, ..*input })
            },
            "enabled behind a shut gate",
        ),
    ];
    for (idx, (tick, rule)) in broken.into_iter().enumerate() {
        let found = World { tick, ..World::new(|_| ()) }.explore();
        assert_eq!(found.map_err(|(rule, _)| rule).err(), Some(rule), "tick {idx}");
    }
    let forgetful =
        World { hand_over: |_, scene| State::new(scene).handover(), ..World::new(|_| ()) };
    let rule = "enabled by a deadman that was not let go since the fault";
    assert_eq!(forgetful.explore().map_err(|(rule, _)| rule).err(), Some(rule));
    let careless = World {
        may_swap: |output| output.faults.is_empty() && output.drive != Drive::Fault,
        ..World::new(|_| ())
    };
    assert_eq!(careless.explore().map_err(|(rule, _)| rule).err(), Some("a swap under force"));
}
