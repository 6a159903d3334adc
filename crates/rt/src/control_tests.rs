//! The control word in one thread; `tests/loom` has it in several.

use super::control::{Control, Order};

#[test]
fn force_flows_only_by_a_permit_that_is_still_worth_something() {
    let control = Control::new();
    assert_eq!(control.order(), Order::Disable);
    let old = control.permit();
    control.disable();
    control.enable(old);
    assert_eq!(control.order(), Order::Disable, "it was drawn before the last off");
    control.enable(control.permit());
    assert_eq!(control.order(), Order::Enable);
    control.disable();
    assert_eq!(control.order(), Order::Disable);
}

#[test]
fn a_permit_that_is_stored_late_does_not_replace_a_newer_one() {
    let control = Control::new();
    let old = control.permit();
    control.disable();
    control.enable(control.permit());
    control.enable(old);
    assert_eq!(control.order(), Order::Enable);
}

#[test]
fn an_end_is_never_taken_back() {
    let control = Control::enabled();
    control.interrupt();
    assert_eq!(control.order(), Order::Stop);
    control.enable(control.permit());
    control.disable();
    control.stop();
    assert_eq!(control.order(), Order::Stop);
    control.interrupt();
    assert_eq!(control.order(), Order::Quit);
    control.interrupt();
    control.stop();
    assert_eq!(control.order(), Order::Quit);
}
