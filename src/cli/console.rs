//! `run --console`: commands as lines, from an operator or a program.

use std::io::BufRead;
use std::sync::Arc;

use crossbeam::channel::Sender;

use super::output;
use crate::daemon::Enable;
use crate::servo::Control;

/// What may be typed.
const WORDS: &str = "enable, disable, stop";

/// Begins to take orders from standard input, one word a line, in a thread of its own. The end of the input is a stop: the operator
/// has gone.
///
/// # Errors
/// The thread could not be started.
pub(super) fn begin(control: Arc<Control>, enables: Sender<Enable>) -> Result<(), std::io::Error> {
    std::thread::Builder::new().name("console".to_owned()).spawn(move || read(std::io::stdin().lock(), &control, &enables))?;
    Ok(())
}

fn read(input: impl BufRead, control: &Control, enables: &Sender<Enable>) {
    for line in input.lines() {
        let Ok(line) = line else { break };
        match line.trim() {
            "" => {}
            "disable" | "d" => control.disable(),
            "stop" | "s" => control.stop(),
            // If the run is over, the order is dropped.
            "enable" | "e" => _ = enables.send(Enable(control.permit())),
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
    use crate::servo::Order;

    #[test]
    fn words_become_orders_and_the_end_a_stop() {
        let (control, (sender, enables)) = (Control::enabled(), bounded(16));
        let permit = control.permit();
        read("enable\n\n d \nfaster\ne\n".as_bytes(), &control, &sender);
        let asked: Vec<Enable> = enables.try_iter().collect();
        assert_eq!(asked, [Enable(permit), Enable(control.permit())]);
        assert_ne!(control.permit(), permit, "d took force away");
        assert_eq!(control.renew(permit), None, "the first word is overtaken");
        assert_eq!(control.order(), Order::Stop);
    }
}
