//! A world that several runs share: each object is moved by its owner, and seen where the owner says by everybody else.
//!
//! Invariants: a pose that comes from the network goes the way of one that a client asks for (`place`), with the same checks. Of each object the
//! newest one is kept until the next turn, and of no more than [`MOST_OBJECTS`]. An owner that goes leaves its objects where they are.

use core::time::Duration;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use zenoh::pubsub::{Publisher, Subscriber};
use zenoh::qos::CongestionControl;
use zenoh::{Session, Wait};

use super::claims::{Claims, News};
use super::keys::{Owner, WorldName, pose_key, pose_keys, posed_object};
use super::plan::{PublishError, Share, refused};
use crate::daemon::session::SessionHandle;
use crate::monitor::{Seen, read_pose};

/// Objects of a world whose poses wait to be looked at.
const MOST_OBJECTS: usize = 256;
/// Longest pose and longest name, bytes; what is longer is none.
const LONGEST: usize = 512;
/// An object that rests is told so often: whoever joins later hears of it.
const AGAIN: Duration = Duration::from_millis(500);

/// Hears what people should know: a sentence, and the names in it.
pub type Tell = Arc<dyn Fn(&str, &[&str]) + Send + Sync>;

type Shared<T> = Arc<Mutex<BTreeMap<String, T>>>;

/// A run in a world.
pub(super) struct World {
    name: WorldName,
    claims: Claims,
    ours: Vec<Ours>,
    /// Owners of the others, as far as they are known.
    owners: BTreeMap<String, Owner>,
    /// The newest pose of each object, as it came.
    inbox: Shared<Vec<u8>>,
    /// Why a pose of an object was refused last: told once.
    refused: Shared<String>,
    /// Ends with it.
    _subscriber: Subscriber<()>,
}

/// An object that is owned here.
struct Ours {
    object: String,
    publisher: Publisher<'static>,
    /// What was told last, and when.
    told: Option<(String, Instant)>,
}

impl World {
    /// Claims what is to be owned, and listens.
    pub(super) fn join(session: &Session, share: Share, who: &str) -> Result<Self, PublishError> {
        let Share { world: name, own } = share;
        let claims = Claims::make(session, &name, &own, who)?;
        let publish = |object: String| {
            let key = pose_key(&name, &object);
            let publisher = session.declare_publisher(key.clone()).congestion_control(CongestionControl::Drop).wait();
            Ok(Ours { publisher: publisher.map_err(refused(&key))?, object, told: None })
        };
        let ours = own.into_iter().map(publish).collect::<Result<_, PublishError>>()?;
        let inbox: Shared<Vec<u8>> = Arc::default();
        let (filled, key) = (inbox.clone(), pose_keys(&name));
        let subscriber = session.declare_subscriber(&key).callback(move |sample| {
            let Some(object) = posed_object(sample.key_expr().as_str()) else { return };
            let pose = sample.payload().to_bytes();
            if pose.len() > LONGEST || object.len() > LONGEST {
                return;
            }
            let mut filled = lock(&filled);
            if filled.len() < MOST_OBJECTS || filled.contains_key(&object) {
                filled.insert(object, pose.into_owned());
            }
        });
        let subscriber = subscriber.wait().map_err(refused(&key))?;
        Ok(Self { name, claims, ours, owners: BTreeMap::new(), inbox, refused: Arc::default(), _subscriber: subscriber })
    }

    /// One look at the newest record.
    pub(super) fn turn(&mut self, seen: &Seen<'_>, now: Instant, session: &SessionHandle, tell: &Tell) {
        let objects: BTreeMap<_, _> = seen.objects().collect();
        for news in self.claims.news() {
            self.note(news, objects.keys().copied(), tell);
        }
        let claims = &self.claims;
        self.ours.retain(|ours| claims.has(&ours.object));
        for ours in &mut self.ours {
            if let Some(pose) = objects.get(ours.object.as_str()) {
                ours.tell(pose, now);
            }
        }
        let came = core::mem::take(&mut *lock(&self.inbox));
        for (object, pose) in came {
            if objects.contains_key(object.as_str()) && !self.claims.has(&object) {
                self.place(object, &pose, session, tell);
            }
        }
    }

    /// An owner came or went; of objects that this scene does not have nobody has to hear.
    fn note<'o>(&mut self, News { owner, is_there }: News, mut objects: impl Iterator<Item = &'o str>, tell: &Tell) {
        let object = owner.object.clone();
        let is_known = objects.any(|known| known == object);
        let (name, who) = (&self.name, owner.who.clone());
        let (word, text) = if is_there {
            self.owners.insert(object.clone(), owner);
            ("owned", format!("`{object}` of world `{name}` follows {who}"))
        } else if self.owners.get(&object) == Some(&owner) {
            self.owners.remove(&object);
            ("left", format!("{who}, who owned `{object}` of world `{name}`, has gone: it stays where it is"))
        } else {
            return;
        };
        if is_known {
            tell(&text, &[word, &object]);
        }
    }

    /// Asks the session, as a client does.
    fn place(&self, object: String, pose: &[u8], session: &SessionHandle, tell: &Tell) {
        let (refused, tell, name) = (self.refused.clone(), tell.clone(), self.name.clone());
        let complain = move |object: String, why: Option<String>| {
            let mut refused = lock(&refused);
            let Some(why) = why else {
                refused.remove(&object);
                return;
            };
            if refused.get(&object) != Some(&why) && refused.len() < MOST_OBJECTS {
                tell(&format!("a pose of `{object}` of world `{name}` is not taken: {why}"), &["refused", &object]);
                refused.insert(object, why);
            }
        };
        match read_pose(pose) {
            Ok(world_from_object) => {
                let placed = session.place(&object, world_from_object);
                complain(object, placed.err().map(|error| error.to_string()));
            }
            Err(why) => complain(object, Some(why)),
        }
    }
}

impl Ours {
    /// Where it stands, when that is new, and now and then when it is not.
    fn tell(&mut self, pose: &str, now: Instant) {
        if self.told.as_ref().is_some_and(|(told, at)| told == pose && now.duration_since(*at) < AGAIN) {
            return;
        }
        // A session that is closed has nobody to tell.
        let _ = self.publisher.put(pose).wait();
        self.told = Some((pose.to_owned(), now));
    }
}

fn lock<T>(shared: &Mutex<T>) -> MutexGuard<'_, T> {
    // A map of plain data is whole whoever panicked.
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}
