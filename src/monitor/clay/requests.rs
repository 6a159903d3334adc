//! What clients do to clay, and what all of them hear of it.

use core::sync::atomic::Ordering;
use std::sync::{Arc, PoisonError};
use std::time::Instant;

use super::super::answer::{Done, Reply};
use super::super::hub::Hub;
use super::super::problem::Problem;
use super::{Asked, Clay, TakeAsked};
use crate::daemon::studio::Refused;
use clay::studio::Order;

/// Another craft or other settings. What the hand feels of that goes through the same limits as all else.
pub(in crate::monitor) fn take(hub: &Arc<Hub>, asked: TakeAsked, reply: Reply) {
    let taken = hub.clay().and_then(|clay| {
        let view = clay.view()?;
        let tool = asked.onto(clay.tool(&view), &view)?;
        // Relaxed: it only counts.
        let number = clay.next_asked.fetch_add(1, Ordering::Relaxed);
        *clay.asked() = Some(Asked { tool: tool.clone(), at: Instant::now(), number });
        Ok((clay, tool, number))
    });
    let (clay, tool, number) = match taken {
        Ok(taken) => taken,
        Err(problem) => return reply(Err(problem)),
    };
    let asker = clay.clone();
    let answer = Box::new(move |result: Result<(), Refused>| {
        if result.is_err() {
            // What the studio has then is in a view; what was asked for since counts on.
            asker.asked().take_if(|asked| asked.number == number);
        }
        reply(result.map(|()| Done::Nothing).map_err(|refused| Problem::from(&refused)));
    });
    clay.door.ask(Order::Take(tool), answer);
}

/// A stroke back, or forth again.
pub(in crate::monitor) fn step(hub: &Arc<Hub>, order: Order, word: &'static str, reply: Reply) {
    let clay = match hub.clay() {
        Ok(clay) => clay,
        Err(problem) => return reply(Err(problem)),
    };
    let hub = hub.clone();
    let answer = Box::new(move |result: Result<(), Refused>| {
        if result.is_ok() {
            hub.tell("clay", None, &format!("a stroke on the clay was {word}"), &[word]);
        }
        reply(result.map(|()| Done::Nothing).map_err(|refused| Problem::from(&refused)));
    });
    clay.door.ask(order, answer);
}

/// Holds, or lets go, as the button of an arm does.
pub(in crate::monitor) fn hold(hub: &Arc<Hub>, client: u64, is_held: bool, reply: Reply) {
    let clay = match hub.clay() {
        Ok(clay) => clay,
        Err(problem) => return reply(Err(problem)),
    };
    if !is_held {
        // Where it was let go already, by the end of force or after a silence, that is done.
        if hub.watchdog.let_go(client) {
            clay.let_go(hub);
        }
        return reply(Ok(Done::Nothing));
    }
    if !hub.watchdog.hold(client) {
        return reply(Err(Problem::conflict("another client holds the clay", "wait until it lets go")));
    }
    // In this order: whoever takes the force away looks for a hold after that.
    if !hub.has_force() {
        hub.watchdog.let_go(client);
        return reply(Err(Problem::conflict("no force flows: nothing can be held", "enable first")));
    }
    let (holder, held) = (hub.clone(), clay.clone());
    let answer = Box::new(move |result: Result<(), Refused>| {
        // It may have been held before: what is not watched any more is let go.
        if result.is_err() && holder.watchdog.let_go(client) {
            held.let_go(&holder);
        }
        reply(result.map(|()| Done::Nothing).map_err(|refused| Problem::from(&refused)));
    });
    clay.door.ask(Order::Hold(true), answer);
    // Whoever took the hold away meanwhile has asked for that before this was asked.
    if !hub.watchdog.holds() {
        clay.let_go(hub);
    }
}

impl Clay {
    /// Tells what has changed since the last call, whoever changed it.
    pub(in crate::monitor) fn tell_news(&self, hub: &Hub) {
        // A view is made only for those who look.
        let Some(view) = (!hub.clients().is_empty()).then(|| self.door.view()).flatten() else { return };
        let (craft, trouble) = {
            let mut told = self.told.lock().unwrap_or_else(PoisonError::into_inner);
            let before = core::mem::replace(&mut told.craft, view.tool.craft);
            let craft = (before != view.tool.craft).then_some(view.tool.craft);
            let before = told.trouble.replace(view.trouble.clone()).unwrap_or_default();
            (craft, (before != view.trouble && !view.trouble.is_empty()).then(|| view.trouble.clone()))
        };
        if let Some(craft) = craft {
            hub.tell("clay", None, &format!("the tool is for `{craft}` now"), &["took", craft.name()]);
        }
        if let Some(trouble) = trouble {
            hub.tell("clay", None, &trouble, &["trouble"]);
        }
    }

    /// Lets go for a client that does not do so itself. An order that found no room is given again by whoever watches.
    pub(in crate::monitor) fn let_go(&self, hub: &Arc<Hub>) {
        let hub = hub.clone();
        let answer = Box::new(move |result: Result<(), Refused>| {
            if let Err(Refused::Busy) = result {
                hub.watchdog.still_held();
            }
        });
        self.door.ask(Order::Hold(false), answer);
    }
}
