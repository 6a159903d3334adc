//! What moves the hand of a simulated arm: its path, or a pose that a client asks for.
//!
//! ```text
//!  path, at its own time ──┐
//!                          ├─► goal ─► at most so fast, at most so far from the tool ─► target ─► spring and damper of the plant
//!  pose of a client ───────┘
//! ```
//! A path is followed exactly. A pose that a client asks for, and the way back to a path, are not:
//! a cursor jumps, and a spring that is stretched without a bound pushes harder than any motor.
//! There the target moves at 0.25 m/s and 3 rad/s at most, and no farther from the tool than the
//! [`Reach`] of the hand: what stops the tool stops the hand.
//!
//! A path's time stands still while no force flows, and its poses hold in the world: at each enable
//! the servo says where the tool stands with the grip where it is. A hand that a client has moved
//! takes the grip home meanwhile: elsewhere it might stand outside of the workspace, where no force
//! may begin to flow and no client could move it.

use glam::DVec3;

use super::hand::GripPath;
use vps::spatial::Pose;

/// How fast a client moves the hand at most, m/s of the grip: an unhurried hand.
const SPEED_M_PER_S: f64 = 0.25;
/// The same for rotation, rad/s.
const SPEED_RAD_PER_S: f64 = 3.0;
/// It slows down in front of the pose that a client asks for, within so much time, s: the grip on
/// its spring would swing beyond it otherwise.
const SLOWING_S: f64 = 0.06;
/// Nearer than this the hand is there, m.
const THERE_M: f64 = 1e-7;
/// From a pose of the path that is nearer than this to the tool the path goes on where it was, m.
const NEAR_M: f64 = 5e-3;
/// A turn by one radian counts as so many metres, where the pose of a path is sought that is
/// nearest to the tool.
const M_PER_RAD: f64 = 0.03;
/// Poses of a path that are compared with the tool's.
const SOUGHT_POSES: u32 = 512;

/// How far a hand that a client moves may be ahead of the tool, in the frame of the arm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reach {
    /// Distance of the grip points, m.
    pub most_m: f64,
    /// Angle, rad.
    pub most_rad: f64,
}

impl Reach {
    /// Where no tool can be in the way.
    const UNLIMITED: Self = Self { most_m: f64::INFINITY, most_rad: f64::INFINITY };
}

impl Default for Reach {
    /// What 2.5 N and 0.3 N·m stretch of the springs of a relaxed grip.
    fn default() -> Self {
        Self { most_m: 5e-3, most_rad: 0.1 }
    }
}

/// Moves the hand of a simulated arm. RT: every method is safe.
#[derive(Clone, Debug)]
pub struct HandControl {
    path: Option<GripPath>,
    /// What a client asks for, `world_from_tool`.
    asked: Option<Pose>,
    /// Where the hand's target was at the end of the last step, `device_from_grip`.
    target: Pose,
    /// The grip that would hold the tool where it is, `device_from_grip`.
    held: Pose,
    /// Where the hand began, `device_from_grip`.
    home: Pose,
    /// A client has moved it from there.
    is_away: bool,
    /// Where the grip was when the path's frame was fixed; `None`: at its zero pose.
    origin: Option<Pose>,
    /// Time of the arm, and by how much the path's time is behind it, s.
    now_s: f64,
    delay_s: f64,
    /// No force flows: the hand waits.
    waits: bool,
    /// The path is one of another scene, and has not begun.
    begins: bool,
    /// On the way back to its path.
    returns: bool,
}

impl HandControl {
    /// A hand at the beginning of its path; without a path at the zero pose. RT: start-up only.
    pub fn new(path: Option<GripPath>) -> Self {
        let target = path.as_ref().map_or(Pose::IDENTITY, |path| path.sample(0.0));
        Self {
            path,
            asked: None,
            target,
            held: target,
            home: target,
            is_away: false,
            origin: None,
            now_s: 0.0,
            delay_s: 0.0,
            waits: false,
            begins: false,
            returns: false,
        }
    }

    /// Asks for a pose of the tool, `world_from_tool`; the hand goes there and stays.
    pub fn move_to(&mut self, world_from_tool: Pose) {
        self.asked = Some(world_from_tool);
        self.is_away = true;
    }

    /// Says where the tool is, `world_from_tool`: once in each period.
    pub fn see(&mut self, world_from_tool: Pose) {
        if let Some(path) = &self.path
            && (self.returns || self.asked.is_some())
        {
            self.held = self.counted_from_origin(path.grip_at(world_from_tool));
        }
    }

    /// Back to the beginning of the path, along the path from where it passes nearest to the tool,
    /// and forth again from there.
    pub fn restart(&mut self, world_from_tool: Pose) {
        self.asked = None;
        self.returns = true;
        // A path whose time is negative is gone backwards.
        let time_s = self.path.as_ref().map_or(0.0, |path| path.nearest_s(world_from_tool));
        self.delay_s = self.now_s + time_s;
    }

    /// Says that force flows, or that none does. Until it is said first the hand follows its path.
    pub(crate) fn set_enabled(&mut self, enabled: bool) {
        self.waits = !enabled;
    }

    /// Says where the tool stands, `world_from_tool`, with the grip at `device_from_grip`: from now
    /// on the path's poses hold in the world as it is now. The path goes on where it was; where the
    /// tool is elsewhere, from the pose that is nearest to it; one of another scene begins.
    pub fn index(&mut self, device_from_grip: Pose, world_from_tool: Pose) {
        let Some(path) = &mut self.path else { return };
        // The cursor of a client that pulled before is not for now.
        if self.asked.is_some() {
            self.asked = Some(world_from_tool);
        }
        let moved = distance(self.origin.unwrap_or_default(), device_from_grip)
            + distance(path.start(), world_from_tool);
        if moved < 1e-12 && !self.begins {
            return;
        }
        let is_elsewhere =
            distance(path.tool_at((self.now_s - self.delay_s).abs()), world_from_tool) > NEAR_M;
        self.origin = Some(device_from_grip);
        path.set_start(world_from_tool);
        if self.begins {
            self.delay_s = self.now_s;
        } else if is_elsewhere {
            self.delay_s = self.now_s - path.nearest_s(world_from_tool);
        }
        self.begins = false;
        (self.target, self.held) = (device_from_grip, device_from_grip);
        self.returns = true;
    }

    /// Takes another path, for another scene, and gives back this one; the next enable says where
    /// the tool stands in it.
    pub fn exchange(&mut self, path: &mut Option<GripPath>) {
        core::mem::swap(&mut self.path, path);
        self.asked = None;
        self.begins = true;
    }

    /// Counts the path from where the grip is put.
    pub(crate) fn rest_at(&mut self, device_from_grip: Pose) {
        self.origin = Some(device_from_grip);
        self.target = self
            .path
            .as_ref()
            .map_or(device_from_grip, |path| self.counted_from_origin(path.sample(0.0)));
        self.home = self.target;
    }

    /// Where the target was at the end of the last step, `device_from_grip`.
    pub(crate) fn target(&self) -> Pose {
        self.target
    }

    /// A period of the arm begins, `period_s` long.
    pub(crate) fn begin(&mut self, period_s: f64) {
        if self.waits {
            self.delay_s += period_s;
        }
    }

    /// The target at `time_s` of the arm, one step of length `h` after the last one.
    pub(crate) fn next(&mut self, time_s: f64, h: f64) -> Pose {
        self.now_s = time_s;
        let Some(path) = &self.path else { return self.target };
        if self.waits && self.is_away {
            self.target = self.toward(self.home, 1.0, Reach::UNLIMITED, h);
            self.is_away = self.target != self.home;
        } else if !self.waits {
            self.target = match self.asked {
                Some(asked) => self.toward(
                    self.counted_from_origin(path.grip_at(asked)),
                    h / SLOWING_S,
                    path.reach(),
                    h,
                ),
                None => {
                    let goal = self.counted_from_origin(path.sample((time_s - self.delay_s).abs()));
                    let target =
                        if self.returns { self.toward(goal, 1.0, path.reach(), h) } else { goal };
                    self.returns &= target != goal;
                    target
                }
            };
        }
        self.target
    }

    fn counted_from_origin(&self, pose: Pose) -> Pose {
        match self.origin {
            Some(origin) => {
                Pose::new(pose.rotation * origin.rotation, pose.translation + origin.translation)
            }
            None => pose,
        }
    }

    /// One step from the target toward a goal: a share of the way, no faster than a client may move
    /// the hand, and no farther from the tool.
    fn toward(&self, goal: Pose, share: f64, reach: Reach, h: f64) -> Pose {
        let way = goal.translation - self.target.translation;
        let turn = self.target.rotation_to(goal);
        let step = way * share;
        let spin = turn * share;
        let step = step.clamp_length_max(SPEED_M_PER_S * h);
        let spin = spin.clamp_length_max(SPEED_RAD_PER_S * h);
        let is_near = way.length() < THERE_M && turn.length() * M_PER_RAD < THERE_M;
        let is_there = is_near || step == way && spin == turn;
        let stepped = if is_there { goal } else { self.target.stepped(step, spin) };
        let ahead = stepped.translation - self.held.translation;
        let turned = self.held.rotation_to(stepped);
        let translation = if ahead.length() > reach.most_m {
            self.held.translation + ahead.clamp_length_max(reach.most_m)
        } else {
            stepped.translation
        };
        let rotation = if turned.length() > reach.most_rad {
            self.held.stepped(DVec3::ZERO, turned.clamp_length_max(reach.most_rad)).rotation
        } else {
            stepped.rotation
        };
        Pose::new(rotation, translation)
    }
}

/// How far two poses are apart, m.
fn distance(a: Pose, b: Pose) -> f64 {
    (b.translation - a.translation).length() + M_PER_RAD * a.rotation_to(b).length()
}

impl GripPath {
    /// Time of the path, s, at which it passes nearest to a pose of the tool; the earliest of
    /// several. O(`SOUGHT_POSES` · log n).
    fn nearest_s(&self, world_from_tool: Pose) -> f64 {
        let (first_s, last_s) = self.span_s();
        let time_s = |n: u32| first_s + (last_s - first_s) * f64::from(n) / f64::from(SOUGHT_POSES);
        let mut nearest = (f64::INFINITY, first_s);
        for n in 0..=SOUGHT_POSES {
            let away = distance(self.tool_at(time_s(n)), world_from_tool);
            // The path stands still in places: what differs by less than a step of an encoder is
            // the same place.
            if away < nearest.0 - 1e-6 {
                nearest = (away, time_s(n));
            }
        }
        nearest.1
    }
}

#[cfg(test)]
mod tests {
    use core::f64::consts::FRAC_PI_2;

    use glam::DQuat;

    use super::*;
    use crate::simulated::hand::{HandMapping, HandPath};
    use document::poses::TimedPose;

    const H: f64 = 1e-4;

    /// 0.1 m down in a second, then still for a second.
    fn down() -> GripPath {
        let at = |time_s: f64, z: f64| TimedPose { line: 0, time_s, pose: tool(z) };
        let path =
            HandPath::from_poses(&[at(0.0, 0.5), at(1.0, 0.4), at(2.0, 0.4)], "x.csv".as_ref())
                .expect("rises");
        path.to_device(HandMapping {
            world_from_device: Pose::IDENTITY,
            scale: 1.0,
            start: tool(0.5),
            grip_tool: DVec3::ZERO,
        })
    }

    fn tool(z: f64) -> Pose {
        Pose::from_translation(DVec3::new(0.0, 0.0, z))
    }

    /// The tool follows without any weight.
    fn run(hand: &mut HandControl, from_s: f64, to_s: f64) -> Pose {
        for n in (from_s / H).round() as u64..(to_s / H).round() as u64 {
            if n.is_multiple_of(10) {
                hand.begin(10.0 * H);
                hand.held = hand.target();
            }
            hand.next((n + 1) as f64 * H, H);
        }
        hand.target()
    }

    #[test]
    fn a_hand_that_is_reported_nothing_follows_its_path_to_the_bit() {
        let mut hand = HandControl::new(Some(down()));
        for n in 1..20_000 {
            let time_s = f64::from(n) * H;
            assert_eq!(hand.next(time_s, H), down().sample(time_s));
        }
    }

    #[test]
    fn a_client_moves_it_no_faster_and_no_farther_than_it_may() {
        let mut hand = HandControl::new(Some(down()));
        hand.move_to(tool(0.2));
        let before = hand.target();
        // The tool is held: the target goes as far as its reach.
        let mut last = before;
        for n in 1..10_000 {
            hand.see(tool(0.5));
            let now = hand.next(f64::from(n) * H, H);
            assert!(
                (now.translation - last.translation).length() <= SPEED_M_PER_S * H * (1.0 + 1e-9)
            );
            last = now;
        }
        assert!(
            ((last.translation - before.translation).length() - Reach::default().most_m).abs()
                < 1e-9,
            "{last:?}"
        );
        let reached = run(&mut hand, 1.0, 3.0);
        assert!((reached.translation.z + 0.3).abs() < 1e-12, "{reached:?}");
        hand.move_to(Pose::new(DQuat::from_rotation_x(FRAC_PI_2), tool(0.2).translation));
        let turned = run(&mut hand, 3.0, 5.0);
        assert!((Pose::IDENTITY.rotation_to(turned).x - FRAC_PI_2).abs() < 1e-9);
    }

    #[test]
    fn it_waits_without_force_and_its_path_holds_in_the_world_after_an_enable() {
        let mut hand = HandControl::new(Some(down()));
        run(&mut hand, 0.0, 0.5);
        hand.set_enabled(false);
        let waiting = run(&mut hand, 0.5, 5.0);
        assert!((waiting.translation.z + 0.05).abs() < 1e-9, "{waiting:?}");
        // The grip was pushed aside meanwhile, and the tool stands where the path begins.
        let pushed = Pose::from_translation(DVec3::new(0.07, 0.0, 0.0));
        hand.index(pushed, tool(0.5));
        hand.set_enabled(true);
        assert_eq!(hand.target(), pushed);
        // From the beginning: 0.1 m down from where the grip was.
        let end = run(&mut hand, 5.0, 6.5);
        assert!((end.translation - DVec3::new(0.07, 0.0, -0.1)).length() < 1e-9, "{end:?}");
    }

    #[test]
    fn a_hand_that_a_client_moved_takes_the_grip_home_while_no_force_flows() {
        let mut hand = HandControl::new(Some(down()));
        hand.move_to(Pose::new(DQuat::from_rotation_x(FRAC_PI_2), tool(0.3).translation));
        let away = run(&mut hand, 0.0, 2.0);
        assert!((away.translation.z + 0.2).abs() < 1e-9, "{away:?}");
        hand.set_enabled(false);
        let before = hand.target();
        let soon = hand.next(2.0 + H, H);
        assert!(
            (soon.translation - before.translation).length() <= SPEED_M_PER_S * H * (1.0 + 1e-9)
        );
        assert_eq!(run(&mut hand, 2.0, 4.0), Pose::IDENTITY);
        // And stays there, whatever is asked for meanwhile.
        hand.move_to(tool(0.2));
        assert_eq!(run(&mut hand, 4.0, 5.0), Pose::IDENTITY);
        hand.index(Pose::IDENTITY, tool(0.5));
        hand.set_enabled(true);
        assert_eq!(
            run(&mut hand, 5.0, 6.0),
            Pose::IDENTITY,
            "what a client pulled at before is not for now"
        );
    }

    #[test]
    fn where_the_tool_kept_its_place_the_path_goes_on() {
        let mut hand = HandControl::new(Some(down()));
        run(&mut hand, 0.0, 0.5);
        hand.set_enabled(false);
        run(&mut hand, 0.5, 1.0);
        hand.index(tool(0.0), tool(0.451));
        hand.set_enabled(true);
        let soon = run(&mut hand, 1.0, 1.3);
        assert!((soon.translation.z + 0.031).abs() < 1e-3, "{soon:?}");
    }

    #[test]
    fn a_restart_goes_back_along_the_path_and_forth_again() {
        let mut hand = HandControl::new(Some(down()));
        run(&mut hand, 0.0, 0.9);
        hand.restart(tool(0.41));
        let back = run(&mut hand, 0.9, 1.4);
        assert!((back.translation.z + 0.04).abs() < 1e-3, "{back:?}");
        let again = run(&mut hand, 1.4, 2.3);
        assert!((again.translation.z + 0.05).abs() < 1e-3, "{again:?}");
    }

    #[test]
    fn paths_are_exchanged_with_their_scenes() {
        let mut hand = HandControl::new(Some(down()));
        run(&mut hand, 0.0, 0.5);
        hand.set_enabled(false);
        let mut other = Some(down());
        hand.exchange(&mut other);
        assert!(other.is_some());
        hand.index(tool(0.0), tool(0.5));
        hand.set_enabled(true);
        let grip = run(&mut hand, 0.5, 1.0);
        assert!((grip.translation.z + 0.05).abs() < 1e-3, "{grip:?}");
        let mut none = None;
        hand.exchange(&mut none);
        hand.move_to(tool(0.0));
        assert_eq!(run(&mut hand, 1.0, 1.1), grip);
    }
}
