//! Names under which hapticd publishes beside those of ROS 2.
//!
//! ```text
//!  hapticd/NAMESPACE/state                                          the newest state, JSON
//!  hapticd/NAMESPACE/state/binary                                   the same in the binary layout
//!  hapticd/world/WORLD/objects/OBJECT/pose                          {"p":[x,y,z],"q":[x,y,z,w]}, world_from_object
//!  hapticd/world/WORLD/objects/OBJECT/owner/CLAIMED/SESSION/WHO     a liveliness token
//! ```
//! Names of worlds and objects are free text; what a key cannot hold is written as `%` and two hexadecimal digits.

use core::fmt::{Display, Formatter};
use core::str::FromStr;

use percent_encoding::{AsciiSet, NON_ALPHANUMERIC, percent_decode_str, utf8_percent_encode};

use link::Namespace;

/// Everything but letters, digits and these is written as a number.
const ESCAPED: &AsciiSet = &NON_ALPHANUMERIC.remove(b'-').remove(b'_').remove(b'.');
/// Longest name of a world, bytes.
const LONGEST_NAME: usize = 64;
const WORLDS: &str = "hapticd/world";

/// Name of a world that several runs share.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WorldName(String);

/// Why a text is no name of a world.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the name of a world has 1 to {LONGEST_NAME} bytes, such as bench")]
pub struct WorldNameError;

impl FromStr for WorldName {
    type Err = WorldNameError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        if text.is_empty() || text.len() > LONGEST_NAME { Err(WorldNameError) } else { Ok(Self(text.to_owned())) }
    }
}

impl Display for WorldName {
    fn fmt(&self, f: &mut Formatter<'_>) -> core::fmt::Result {
        f.write_str(&self.0)
    }
}

/// Who owns an object of a world, as its token says it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Owner {
    /// What is owned.
    pub object: String,
    /// When it was claimed, ns since 1970: of two that claim at the same time the earlier one has it.
    pub claimed_ns: u64,
    /// The session of the owner.
    pub session: String,
    /// The owner, for people.
    pub who: String,
}

impl Owner {
    /// True when this claim goes before the other. Never both ways, and one way for two sessions.
    pub fn precedes(&self, other: &Self) -> bool {
        (self.claimed_ns, &self.session) < (other.claimed_ns, &other.session)
    }

    /// Reads the key of a token; `None`: it is none of ours.
    pub fn read(key: &str) -> Option<Self> {
        let pieces: Vec<_> = key.strip_prefix(WORLDS)?.split('/').collect();
        let ["", _world, "objects", object, "owner", claimed_ns, session, who] = pieces[..] else { return None };
        Some(Self {
            object: unescaped(object)?,
            claimed_ns: claimed_ns.parse().ok()?,
            session: session.to_owned(),
            who: unescaped(who)?,
        })
    }
}

/// Where the newest state is published as JSON.
pub fn state_key(namespace: &Namespace) -> String {
    format!("hapticd/{namespace}/state")
}

/// Where it is published in the binary layout.
pub fn binary_state_key(namespace: &Namespace) -> String {
    format!("hapticd/{namespace}/state/binary")
}

/// Where the pose of an object is published by its owner.
pub fn pose_key(world: &WorldName, object: &str) -> String {
    format!("{}/pose", object_key(world, &escaped(object)))
}

/// Where the poses of all objects of a world are.
pub fn pose_keys(world: &WorldName) -> String {
    format!("{}/pose", object_key(world, "*"))
}

/// The object whose pose is published there.
pub fn posed_object(key: &str) -> Option<String> {
    let pieces: Vec<_> = key.strip_prefix(WORLDS)?.split('/').collect();
    let ["", _world, "objects", object, "pose"] = pieces[..] else { return None };
    unescaped(object)
}

/// The token of an owner.
pub fn owner_key(world: &WorldName, owner: &Owner) -> String {
    let Owner { object, claimed_ns, session, who } = owner;
    format!("{}/owner/{claimed_ns}/{session}/{}", object_key(world, &escaped(object)), escaped(who))
}

/// Where the tokens of all owners of a world are.
pub fn owner_keys(world: &WorldName) -> String {
    format!("{}/owner/*/*/*", object_key(world, "*"))
}

fn object_key(world: &WorldName, object: &str) -> String {
    format!("{WORLDS}/{}/objects/{object}", escaped(&world.0))
}

fn escaped(name: &str) -> String {
    utf8_percent_encode(name, ESCAPED).to_string()
}

fn unescaped(piece: &str) -> Option<String> {
    percent_decode_str(piece).decode_utf8().ok().map(|name| name.into_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_any_kind_are_one_piece_of_a_key_and_come_back() {
        for name in ["plate", "left plate", "a/b", "*", "$*", "größe", "100 %", "#?"] {
            let world: WorldName = name.parse().unwrap();
            let key = pose_key(&world, name);
            assert!(key.chars().all(|c| c.is_ascii_alphanumeric() || "-_.%/".contains(c)), "{key}");
            assert_eq!(key.split('/').count(), 6, "{key}");
            assert_eq!(posed_object(&key).as_deref(), Some(name));
            let owner =
                Owner { object: name.to_owned(), claimed_ns: 7, session: "a1".to_owned(), who: "press on box (12)".to_owned() };
            let key = owner_key(&world, &owner);
            assert_eq!(key.split('/').count(), 9, "{key}");
            assert_eq!(Owner::read(&key), Some(owner));
        }
        assert_eq!(pose_key(&"bench".parse().unwrap(), "lift"), "hapticd/world/bench/objects/lift/pose");
        for key in ["hapticd/left/state", "hapticd/world/w/objects/o/owner/x/s/w", "hapticd/world/w/objects/o/owner/1/s", "x"] {
            assert_eq!((Owner::read(key), posed_object(key)), (None, None), "{key}");
        }
    }

    #[test]
    fn of_two_claims_exactly_one_goes_before_the_other() {
        let owner = |claimed_ns, session: &str| Owner {
            object: "a".to_owned(),
            claimed_ns,
            session: session.to_owned(),
            who: String::new(),
        };
        for (one, other) in [(owner(1, "b"), owner(2, "a")), (owner(1, "a"), owner(1, "b"))] {
            assert!(one.precedes(&other) && !other.precedes(&one) && !one.precedes(&one));
        }
    }

    #[test]
    fn a_world_has_a_name() {
        assert!("".parse::<WorldName>().is_err() && "x".repeat(65).parse::<WorldName>().is_err());
        let told = WorldNameError.to_string();
        assert!(told.contains("64") && told.contains("bench"), "{told}");
    }
}
