//! What clients do to clay, and the events that all of them get.

use std::sync::{Arc, PoisonError};

use super::super::answer::{Completion, Reply};
use super::super::hub::Hub;
use super::super::problem::RequestError;
use super::{ClayService, TakeAsked};
use crate::daemon::sculpting::OrderError;
use clay::engine::{ClayView, SculptOrder};

/// Another tool or other settings. What the hand feels of that goes through the same limits as all
/// else.
pub(in crate::monitor) fn take(hub: &Arc<Hub>, asked: TakeAsked, reply: Reply) {
    order(hub, |view| asked.checked(view).map(SculptOrder::Adjust), reply);
}

/// An order that is made out of what a client asks for.
pub(in crate::monitor) fn order(
    hub: &Arc<Hub>,
    checked: impl FnOnce(&ClayView) -> Result<SculptOrder, RequestError>,
    reply: Reply,
) {
    match hub.clay().and_then(|clay| Ok((checked(&*clay.view()?)?, clay))) {
        Ok((order, clay)) => clay.access.ask(order, Box::new(|result| reply(answer_of(result)))),
        Err(problem) => reply(Err(problem)),
    }
}

pub(super) fn answer_of(result: Result<(), OrderError>) -> Result<Completion, RequestError> {
    result.map(|()| Completion::Nothing).map_err(|refused| RequestError::from(&refused))
}

/// A stroke back, or forth again.
pub(in crate::monitor) fn step(
    hub: &Arc<Hub>,
    order: SculptOrder,
    word: &'static str,
    reply: Reply,
) {
    let clay = match hub.clay() {
        Ok(clay) => clay,
        Err(problem) => return reply(Err(problem)),
    };
    let hub = hub.clone();
    let answer = Box::new(move |result: Result<(), OrderError>| {
        if result.is_ok() {
            hub.tell("clay", None, &format!("a stroke on the clay was {word}"), &[word]);
        }
        reply(answer_of(result));
    });
    clay.access.ask(order, answer);
}

/// Holds, or lets go, as the button of an arm does.
pub(in crate::monitor) fn hold(hub: &Arc<Hub>, client: u64, is_held: bool, reply: Reply) {
    let clay = match hub.clay() {
        Ok(clay) => clay,
        Err(problem) => return reply(Err(problem)),
    };
    if !is_held {
        // Where it was let go already, by the end of force or after a silence, that is done.
        if hub.hold.let_go(client) {
            clay.let_go(hub);
        }
        return reply(Ok(Completion::Nothing));
    }
    if !hub.hold.hold(client) {
        return reply(Err(RequestError::conflict(
            "another client holds the clay",
            "wait until it lets go",
        )));
    }
    // In this order: the handler of "no force" looks for a hold after that.
    if !hub.has_force() {
        hub.hold.let_go(client);
        return reply(Err(RequestError::conflict(
            "no force flows: nothing can be held",
            "enable first",
        )));
    }
    let holder = hub.clone();
    let held = clay.clone();
    let answer = Box::new(move |result: Result<(), OrderError>| {
        // It may have been held before: what is not watched any more is let go.
        if result.is_err() && holder.hold.let_go(client) {
            held.let_go(&holder);
        }
        reply(answer_of(result));
    });
    clay.access.ask(SculptOrder::Hold(true), answer);
    // An order to let go that came meanwhile was sent before this one.
    if !hub.hold.holds() {
        clay.let_go(hub);
    }
}

impl ClayService {
    /// Sends events of what has changed since the last call, by any client.
    pub(in crate::monitor) fn tell_news(&self, hub: &Hub) {
        // A view is made only for clients that want one.
        let Some(view) = (!hub.clients().is_empty()).then(|| self.access.view()).flatten() else {
            return;
        };
        let (kind, trouble) = {
            let mut last_view = self.last_view.lock().unwrap_or_else(PoisonError::into_inner);
            let before = core::mem::replace(&mut last_view.kind, view.tool.kind);
            let kind = (before != view.tool.kind).then_some(view.tool.kind);
            let before = last_view.trouble.replace(view.trouble.clone()).unwrap_or_default();
            (
                kind,
                (before != view.trouble && !view.trouble.is_empty()).then(|| view.trouble.clone()),
            )
        };
        if let Some(kind) = kind {
            hub.tell(
                "clay",
                None,
                &format!("the tool is for `{kind}` now"),
                &["took", kind.name()],
            );
        }
        if let Some(trouble) = trouble {
            hub.tell("clay", None, &trouble, &["trouble"]);
        }
    }

    /// A client that controls the run is lost: what takes long is not finished for it.
    pub(in crate::monitor) fn cancel(&self) {
        self.access.cancel();
    }

    /// Lets go for a client that does not do so itself. The watchdog repeats an order that found
    /// the queue full.
    pub(in crate::monitor) fn let_go(&self, hub: &Arc<Hub>) {
        let hub = hub.clone();
        let answer = Box::new(move |result: Result<(), OrderError>| {
            if let Err(OrderError::Busy) = result {
                hub.hold.still_held();
            }
        });
        self.access.ask(SculptOrder::Hold(false), answer);
    }
}
