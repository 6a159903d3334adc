//! Poses of movable objects, from any thread into the loop.
//!
//! ```text
//!  Placer ──ring──┐  (any thread, any time)
//!                 ├─► Wishes ─► at most one Placement per tick ─► tick
//!  paths ─────────┘  (poses over time, sampled tick by tick)
//! ```
//! A wish of the ring goes first. What a wish becomes, and how fast, is the tick's concern (`haptics::placing`).
#![expect(clippy::disallowed_types, reason = "filled on the cold side, never resized")]

use rtrb::{Consumer, Producer, PushError, RingBuffer};

use super::lowered::{Lowered, LoweredEnd};
use crate::device::simulated::hand::HandPath;
use crate::haptics::{Placement, Tune};
use crate::spatial::Pose;

/// Wishes under way: more than a second of them for one object at 60 Hz.
const RING_WISHES: usize = 64;

/// Why an object was not asked to move.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PlaceError {
    /// No object of the scene is called so.
    #[error("no object is called `{name}`; known here: {}", if known.is_empty() { "none".to_owned() } else { known.join(", ") })]
    Unknown {
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
    /// Not finite, not a rotation, or absurdly far away.
    #[error("not a pose that `{name}` can go to: finite, a unit quaternion, within 1 km of the world's origin")]
    Pose {
        /// As asked for.
        name: String,
    },
    /// Wishes come faster than one per tick.
    #[error("more wishes than ticks: {RING_WISHES} are waiting")]
    Full,
    /// The loop has ended, or renders another scene now.
    #[error("the scene is not rendered any more")]
    Over,
}

/// The cold end: asks objects to move. One per scene; ends with it.
#[derive(Debug)]
pub struct Placer {
    /// Name and whether it moves, in the order of the scene.
    objects: Vec<(String, bool)>,
    ring: Producer<Placement>,
}

impl Placer {
    /// Both ends, for the static objects of a scene in their order: name, and whether it may move. Allocates.
    pub fn new(objects: impl IntoIterator<Item = (String, bool)>) -> (Self, Consumer<Placement>) {
        let (ring, consumer) = RingBuffer::new(RING_WISHES);
        (Self { objects: objects.into_iter().collect(), ring }, consumer)
    }

    /// The loop has ended, or renders another scene now.
    pub fn is_over(&self) -> bool {
        self.ring.is_abandoned()
    }

    /// The movable objects, by name.
    pub fn movable(&self) -> impl Iterator<Item = &str> {
        self.objects.iter().filter(|(_, movable)| *movable).map(|(name, _)| name.as_str())
    }

    /// Asks an object to go to a pose, `world_from_object`. It goes there as fast as it may from the next tick on; a later wish for the same
    /// object replaces this one. Wait-free.
    ///
    /// # Errors
    /// See [`PlaceError`]; nothing moves then.
    pub fn place(&mut self, name: &str, world_from_object: Pose) -> Result<(), PlaceError> {
        let placement = placement(&self.objects, name, world_from_object)?;
        if self.is_over() {
            return Err(PlaceError::Over);
        }
        self.ring.push(placement).map_err(|PushError::Full(_)| PlaceError::Full)
    }
}

/// A checked wish.
fn placement(objects: &[(String, bool)], name: &str, world_from_map: Pose) -> Result<Placement, PlaceError> {
    let Some(obstacle_idx) = objects.iter().position(|(known, _)| known == name) else {
        let known = objects.iter().filter(|(_, movable)| *movable).map(|(name, _)| name.clone()).collect();
        return Err(PlaceError::Unknown { name: name.to_owned(), known });
    };
    if !objects.get(obstacle_idx).is_some_and(|(_, movable)| *movable) {
        return Err(PlaceError::NotMovable { name: name.to_owned() });
    }
    let placement = Placement { obstacle_idx: obstacle_idx as u32, world_from_map };
    if placement.is_sound() { Ok(placement) } else { Err(PlaceError::Pose { name: name.to_owned() }) }
}

/// The loop's end.
#[derive(Debug, Default)]
pub struct Wishes {
    pub(super) ring: Option<Consumer<Placement>>,
    pub(super) tunes: Option<Consumer<Tune>>,
    lowered: Option<LoweredEnd>,
    paths: Vec<(u32, HandPath)>,
    turn: usize,
}

impl Wishes {
    /// Wishes of a placer, if there is one, and objects that follow paths over the loop's time. Cold.
    ///
    /// # Errors
    /// A path of an object that is not there or does not move, or that leads to where it cannot go.
    pub fn new(
        objects: &[(String, bool)],
        ring: Option<Consumer<Placement>>,
        paths: impl IntoIterator<Item = (String, HandPath)>,
    ) -> Result<Self, PlaceError> {
        let mut seen = Vec::new();
        let checked = |(name, path): (String, HandPath)| {
            let mut obstacle_idx = placement(objects, &name, Pose::IDENTITY)?.obstacle_idx;
            for pose in path.poses() {
                obstacle_idx = placement(objects, &name, *pose)?.obstacle_idx;
            }
            if seen.contains(&obstacle_idx) {
                return Err(PlaceError::Twice { name });
            }
            seen.push(obstacle_idx);
            Ok((obstacle_idx, path))
        };
        let paths = paths.into_iter().map(checked).collect::<Result<_, _>>()?;
        Ok(Self { ring, tunes: None, lowered: None, paths, turn: 0 })
    }

    /// The same, with limits that hold from scene to scene.
    #[must_use]
    pub fn with_lowered(mut self, lowered: &Lowered) -> Self {
        self.lowered = Some(LoweredEnd::new(lowered.clone()));
        self
    }

    /// What a parameter is to become. RT: safe.
    pub(super) fn next_tune(&mut self) -> Option<Tune> {
        // Limits go first: of a scene that takes the place of another they count before its first force.
        let lowered = self.lowered.as_mut().and_then(LoweredEnd::next);
        lowered.or_else(|| self.tunes.as_mut().and_then(|ring| ring.pop().ok()))
    }

    /// Where an object is to go. RT: safe; O(log n) in the length of a path.
    pub(super) fn next_place(&mut self, time_s: f64) -> Option<Placement> {
        if let Some(wish) = self.ring.as_mut().and_then(|ring| ring.pop().ok()) {
            return Some(wish);
        }
        // Turn by turn.
        self.turn = if self.turn + 1 < self.paths.len() { self.turn + 1 } else { 0 };
        let (obstacle_idx, path) = self.paths.get(self.turn)?;
        Some(Placement { obstacle_idx: *obstacle_idx, world_from_map: path.sample(time_s) })
    }
}

#[cfg(test)]
#[expect(clippy::disallowed_macros, clippy::expect_used, reason = "test code")]
mod tests {
    use glam::{DQuat, DVec3};

    use super::*;

    fn objects() -> Vec<(String, bool)> {
        vec![("floor".to_owned(), false), ("plate".to_owned(), true)]
    }

    #[test]
    fn a_wish_comes_out_once_and_a_bad_one_never_goes_in() {
        let (mut placer, ring) = Placer::new(objects());
        let mut wishes = Wishes::new(&objects(), Some(ring), []).expect("sound");
        let pose = Pose::from_translation(DVec3::X);
        assert_eq!(wishes.next_place(0.0), None);
        assert_eq!(placer.place("plate", pose), Ok(()));
        assert_eq!(wishes.next_place(0.0), Some(Placement { obstacle_idx: 1, world_from_map: pose }));
        assert_eq!(wishes.next_place(0.0), None);
        assert_eq!(placer.place("floor", pose), Err(PlaceError::NotMovable { name: "floor".to_owned() }));
        let unknown = placer.place("plaet", pose).expect_err("unknown");
        assert_eq!(unknown.to_string(), "no object is called `plaet`; known here: plate");
        for wrong in [
            Pose::from_translation(DVec3::NAN),
            Pose::from_translation(DVec3::X * 1e9),
            Pose::new(DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0), DVec3::ZERO),
            Pose::new(DQuat::from_xyzw(0.0, 0.0, 0.0, 1.1), DVec3::ZERO),
            Pose::new(DQuat::from_xyzw(f64::NAN, 0.0, 0.0, 1.0), DVec3::ZERO),
        ] {
            assert_eq!(placer.place("plate", wrong), Err(PlaceError::Pose { name: "plate".to_owned() }));
        }
        assert_eq!(wishes.next_place(0.0), None);
        for _ in 0..RING_WISHES {
            assert_eq!(placer.place("plate", pose), Ok(()));
        }
        assert_eq!(placer.place("plate", pose), Err(PlaceError::Full));
        drop(wishes);
        assert_eq!(placer.place("plate", pose), Err(PlaceError::Over));
    }

    #[test]
    fn paths_take_turns_and_a_placer_goes_first() {
        let named = vec![("a".to_owned(), true), ("b".to_owned(), true)];
        let (mut placer, ring) = Placer::new(named.clone());
        let at = |x_m: f64| HandPath::fixed(Pose::from_translation(DVec3::X * x_m));
        let mut wishes = Wishes::new(&named, Some(ring), [("a".to_owned(), at(1.0)), ("b".to_owned(), at(2.0))]).expect("sound");
        let mut next = || wishes.next_place(0.0).map(|wish| (wish.obstacle_idx, wish.world_from_map.translation.x));
        assert_eq!([next(), next(), next()], [Some((1, 2.0)), Some((0, 1.0)), Some((1, 2.0))]);
        placer.place("b", Pose::from_translation(DVec3::X * 3.0)).expect("room");
        assert_eq!([next(), next()], [Some((1, 3.0)), Some((0, 1.0))]);
        assert!(matches!(Wishes::new(&named, None, [("c".to_owned(), at(0.0))]), Err(PlaceError::Unknown { .. })));
    }
}
