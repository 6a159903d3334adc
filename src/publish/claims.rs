//! Who owns which object of a world: a liveliness token for each, which goes with the session of its owner.
//!
//! Whoever claims looks first, declares, and looks again: of two that claim at the same time the earlier one stays ([`Owner::precedes`]). Runs that
//! meet only later find out from each other's tokens in the same way.

use core::time::Duration;
use std::time::{SystemTime, UNIX_EPOCH};

use crossbeam::channel::{Receiver, bounded};
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::Subscriber;
use zenoh::sample::SampleKind;
use zenoh::{Session, Wait};

use super::keys::{Owner, WorldName, owner_key, owner_keys};
use super::plan::PublishError;
use super::plan::refused;

/// How long owners have to say that they are there.
const LOOK: Duration = Duration::from_secs(1);
/// News of owners that wait to be read; more are left out.
const MOST_NEWS: usize = 1024;

/// An owner came or went.
#[derive(Clone, Debug)]
pub(super) struct News {
    pub(super) owner: Owner,
    pub(super) is_there: bool,
}

/// The objects that are owned here, and news of other owners.
pub(super) struct Claims {
    ours: Vec<(Owner, LivelinessToken)>,
    news: Receiver<News>,
    session: String,
    /// Ends with it.
    _watch: Subscriber<()>,
}

impl Claims {
    /// Claims all of them, or none. Takes up to a second for each look.
    pub(super) fn make(session: &Session, world: &WorldName, own: &[String], who: &str) -> Result<Self, PublishError> {
        let id = session.zid().to_string();
        let others = || -> Result<Vec<Owner>, PublishError> {
            if own.is_empty() {
                return Ok(Vec::new());
            }
            let mut owners = owners(session, world)?;
            owners.retain(|owner| owner.session != id && own.contains(&owner.object));
            Ok(owners)
        };
        let owned = |owner| PublishError::Owned { world: world.clone(), owner };
        if let Some(owner) = others()?.into_iter().next() {
            return Err(owned(owner));
        }
        let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let claimed_ns = since.as_nanos().try_into().unwrap_or(u64::MAX);
        let mut ours = Vec::new();
        for object in own {
            let owner = Owner { object: object.clone(), claimed_ns, session: id.clone(), who: who.to_owned() };
            let key = owner_key(world, &owner);
            let token = session.liveliness().declare_token(&key).wait().map_err(refused(&key))?;
            ours.push((owner, token));
        }
        // The tokens go with this list when somebody else was first.
        for other in others()? {
            if ours.iter().any(|(our, _)| our.object == other.object && other.precedes(our)) {
                return Err(owned(other));
            }
        }
        let (sender, news) = bounded(MOST_NEWS);
        let key = owner_keys(world);
        let watch = session.liveliness().declare_subscriber(&key).history(true).callback(move |sample| {
            let is_there = sample.kind() == SampleKind::Put;
            if let Some(owner) = Owner::read(sample.key_expr().as_str()) {
                let _ = sender.try_send(News { owner, is_there });
            }
        });
        Ok(Self { ours, news, session: id, _watch: watch.wait().map_err(refused(&key))? })
    }

    /// True when this run decides where the object is.
    pub(super) fn has(&self, object: &str) -> bool {
        self.ours.iter().any(|(owner, _)| owner.object == object)
    }

    /// What has become of other owners since the last look. An object that somebody else claimed first is given up; the news of it comes too.
    pub(super) fn news(&mut self) -> Vec<News> {
        let others = self.news.try_iter().filter(|news| news.owner.session != self.session);
        let mut told = Vec::new();
        for news in others {
            let ours = self.ours.iter().position(|(owner, _)| owner.object == news.owner.object);
            match ours {
                Some(idx) if news.is_there && news.owner.precedes(&self.ours[idx].0) => drop(self.ours.remove(idx)),
                // Whoever comes later gives way.
                Some(_) => continue,
                None => {}
            }
            told.push(news);
        }
        told
    }
}

/// Everybody who owns something in a world.
fn owners(session: &Session, world: &WorldName) -> Result<Vec<Owner>, PublishError> {
    let key = owner_keys(world);
    let replies = session.liveliness().get(&key).timeout(LOOK).wait().map_err(refused(&key))?;
    Ok(replies.into_iter().filter_map(|reply| Owner::read(reply.result().ok()?.key_expr().as_str())).collect())
}
