//! The example of a whole loop on an arm, under a clock that does not wait.

use core::time::Duration;
use std::sync::Arc;

use crossbeam::channel::never;
use engine::servo::Ending;
use rt::clock::ClockKind;
use rt::control::Control;

#[path = "../examples/arm.rs"]
mod arm;

#[test]
fn the_example_presses_and_ends_at_rest() {
    let control = Arc::new(Control::new());
    let virtual_clock = ClockKind::Virtual;
    let report = arm::run([None; 2], virtual_clock, Duration::from_secs(2), &control, never())
        .expect("a simulated arm");
    assert_eq!((report.ending, report.faults.is_empty()), (Ending::Stopped, true));
    assert!(report.flight.records().any(|record| record.output.command_device.force.z > 0.5));
}
