//! `run --console`: an operator who types, or a program that writes lines.

use std::io::BufRead;

use crossbeam::channel::Sender;

use super::say;
use crate::daemon::OperatorOrder;

/// What may be typed.
const WORDS: &str = "enable, disable, stop";

/// Begins to take orders from standard input, one word a line, in a thread of its own. The end of the input is a stop: whoever gave the orders
/// has gone.
///
/// # Errors
/// The thread could not be started.
pub(super) fn begin(orders: Sender<OperatorOrder>) -> Result<(), std::io::Error> {
    std::thread::Builder::new().name("console".to_owned()).spawn(move || read(std::io::stdin().lock(), &orders))?;
    Ok(())
}

fn read(input: impl BufRead, orders: &Sender<OperatorOrder>) {
    for line in input.lines() {
        let Ok(line) = line else { break };
        let order = match line.trim() {
            "" => continue,
            "enable" | "e" => OperatorOrder::Enable,
            "disable" | "d" => OperatorOrder::Disable,
            "stop" | "s" => OperatorOrder::Stop,
            word => {
                say::talk(format_args!("console: `{word}` is not an order; orders are {WORDS}\n"));
                continue;
            }
        };
        if orders.send(order).is_err() {
            return;
        }
    }
    say::talk(format_args!("console: the input has ended: stop\n"));
    // If the run is over, nobody listens.
    let _ = orders.send(OperatorOrder::Stop);
}

#[cfg(test)]
mod tests {
    use crossbeam::channel::bounded;

    use super::*;

    #[test]
    fn words_become_orders_and_the_end_a_stop() {
        let (sender, receiver) = bounded(16);
        read("enable\n\n d \nfaster\ne\n".as_bytes(), &sender);
        let orders: Vec<_> = receiver.try_iter().collect();
        use OperatorOrder::{Disable, Enable, Stop};
        assert_eq!(orders, [Enable, Disable, Enable, Stop]);
    }
}
