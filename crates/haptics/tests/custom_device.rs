//! The example of a loop on an arm of one's own, under a clock that does not wait.

#[path = "../examples/custom_device.rs"]
mod custom_device;

#[test]
fn the_block_holds_what_the_hand_presses() {
    let (height_m, force_n) = custom_device::run(rt::clock::VirtualClock::default()).unwrap();
    assert!((force_n - 1.0).abs() < 0.02, "{force_n} N against 1 N of the hand");
    // The ball touches the block at −5 mm; the coupling of 1 N/mm gives way by about a millimetre.
    assert!((-7e-3..-5e-3).contains(&height_m), "{height_m} m");
}
