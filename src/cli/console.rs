//! `run --console`: commands as lines, from an operator or a program.

use std::io::BufRead;
use std::sync::Arc;

use crossbeam::channel::Sender;

use super::output;
use crate::daemon::Enable;
use crate::daemon::session::{HandOrder, SessionError, SessionHandle};
use crate::servo::Control;

/// What may be typed.
const WORDS: &str = "enable, disable, stop, restart (the hand), reset (the scene)";

/// Begins to take orders from standard input, one word a line, in a thread of its own. The end of the input is a stop: the operator
/// has gone.
///
/// # Errors
/// The thread could not be started.
pub(super) fn begin(control: Arc<Control>, enables: Sender<Enable>, session: SessionHandle) -> Result<(), std::io::Error> {
    let orders = move || read(std::io::stdin().lock(), &control, &enables, &session);
    std::thread::Builder::new().name("console".to_owned()).spawn(orders)?;
    Ok(())
}

fn read(input: impl BufRead, control: &Control, enables: &Sender<Enable>, session: &SessionHandle) {
    let tell = |word: &'static str| {
        move |result: Result<(), SessionError>| {
            if let Err(error) = result {
                output::message(format_args!("console: {word}: {error}\n"));
            }
        }
    };
    for line in input.lines() {
        let Ok(line) = line else { break };
        match line.trim() {
            "" => {}
            "disable" | "d" => control.disable(),
            "stop" | "s" => control.stop(),
            // If the run is over, the order is dropped.
            "enable" | "e" => _ = enables.send(Enable(control.permit())),
            "restart" => tell("restart")(session.hand(HandOrder::Restart).map(drop)),
            "reset" => session.reset(Box::new(tell("reset"))),
            word => output::message(format_args!("console: `{word}` is not an order; orders are {WORDS}\n")),
        }
    }
    // First the order, then the words.
    control.stop();
    output::message(format_args!("console: the input has ended: stop\n"));
}

#[cfg(test)]
mod tests {
    use crossbeam::channel::bounded;

    use super::*;
    use crate::config::LoadOptions;
    use crate::daemon::testing::{SCENE, scene};
    use crate::servo::Order;
    use rt::clock::ClockKind;

    #[test]
    fn words_become_orders_and_the_end_a_stop() {
        let (control, (sender, enables)) = (Control::enabled(), bounded(16));
        let permit = control.permit();
        let config = scene(SCENE);
        let session = SessionHandle::new(config, LoadOptions::default(), ClockKind::Virtual, None);
        read("enable\n\n d \nrestart\nreset\nfaster\ne\n".as_bytes(), &control, &sender, &session);
        let asked: Vec<Enable> = enables.try_iter().collect();
        assert_eq!(asked, [Enable(permit), Enable(control.permit())]);
        assert_ne!(control.permit(), permit, "d took force away");
        assert_eq!(control.renew(permit), None, "the first word is overtaken");
        assert_eq!(control.order(), Order::Stop);
    }
}
