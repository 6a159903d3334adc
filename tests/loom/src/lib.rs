//! What threads share, under every interleaving and every order of memory that the language allows:
//! `cargo test --manifest-path tests/loom/Cargo.toml`.
//!
//! The file of the program itself is included, with the atomics of the model checker in place of
//! the machine's.
#![cfg(test)]

mod atomics {
    pub(super) use loom::sync::atomic::{AtomicU8, AtomicU64, Ordering};
}

#[path = "../../../crates/rt/src/control.rs"]
#[expect(dead_code, reason = "the models need a part of it")]
mod control;

use control::{Control, Order, Permit};
use loom::sync::Arc;
use loom::thread;

/// The supervisor enables while a client takes force away: once both are done, and the permit was
/// drawn before the off, there is no force.
#[test]
fn an_off_is_never_lost_to_an_enable_that_was_under_way() {
    loom::model(|| {
        let control = Arc::new(Control::new());
        let permit = control.permit();
        let supervisor = {
            let control = control.clone();
            thread::spawn(move || control.enable(permit))
        };
        control.disable();
        supervisor.join().unwrap();
        assert_eq!(control.order(), Order::Disable);
    });
}

/// A loop that has seen an off sees no force again by an old permit.
#[test]
fn the_loop_sees_no_force_between_an_off_and_the_next_permit() {
    loom::model(|| {
        let control = Arc::new(Control::enabled());
        let client = {
            let control = control.clone();
            thread::spawn(move || control.disable())
        };
        let seen: Vec<Order> = (0..3).map(|_| control.order()).collect();
        client.join().unwrap();
        assert_eq!(control.order(), Order::Disable);
        let off = seen.iter().position(|order| *order == Order::Disable);
        assert!(
            off.is_none_or(|off| seen[off..].iter().all(|order| *order == Order::Disable)),
            "{seen:?}"
        );
    });
}

/// Two clients take force away at once and the supervisor enables with a permit from before:
/// neither is lost.
#[test]
fn offs_of_two_clients_and_an_enable_end_without_force() {
    loom::model(|| {
        let control = Arc::new(Control::enabled());
        let clients: Vec<_> = (0..2)
            .map(|_| {
                let control = control.clone();
                thread::spawn(move || control.disable())
            })
            .collect();
        control.enable(Permit::FIRST);
        for client in clients {
            client.join().unwrap();
        }
        assert_eq!(control.order(), Order::Disable);
    });
}

/// Two enables are under way, with a disable between their permits: the newer one counts, whichever
/// of them is stored last.
#[test]
fn an_enable_with_an_older_permit_does_not_take_back_a_newer_one() {
    loom::model(|| {
        let control = Arc::new(Control::new());
        let old = control.permit();
        let late = {
            let control = control.clone();
            thread::spawn(move || control.enable(old))
        };
        control.disable();
        control.enable(control.permit());
        late.join().unwrap();
        assert_eq!(control.order(), Order::Enable);
    });
}

/// Ends only grow, whatever asks for them, and no enable takes one back.
#[test]
fn an_end_is_kept_beside_everything_else() {
    loom::model(|| {
        let control = Arc::new(Control::enabled());
        let signals = {
            let control = control.clone();
            thread::spawn(move || {
                control.interrupt();
                control.interrupt();
            })
        };
        let page = {
            let control = control.clone();
            thread::spawn(move || control.stop())
        };
        control.enable(control.permit());
        let first = control.order();
        let second = control.order();
        assert!(first != Order::Quit || second == Order::Quit);
        assert!(first != Order::Stop || matches!(second, Order::Stop | Order::Quit));
        signals.join().unwrap();
        page.join().unwrap();
        assert_eq!(control.order(), Order::Quit);
    });
}

/// An operator asks for force and then takes it away; the supervisor takes the first word whenever
/// it comes to it. There is no force.
#[test]
fn an_off_after_an_enable_that_still_waits_is_obeyed() {
    loom::model(|| {
        let control = Arc::new(Control::new());
        let asked = control.permit();
        let supervisor = {
            let control = control.clone();
            thread::spawn(move || {
                if let Some(permit) = control.renew(asked) {
                    control.enable(permit);
                }
            })
        };
        control.disable();
        supervisor.join().unwrap();
        assert_eq!(control.order(), Order::Disable);
    });
}
