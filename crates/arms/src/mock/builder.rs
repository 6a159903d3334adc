//! A mock arm from a profile.

use core::time::Duration;

use glam::DQuat;

use super::arm::MockParameters;
use super::uhid::{HidIdentity, space_mouse_descriptor, vendor_descriptor};
use crate::kinematics::Kinematics;
use crate::profile::Profile;
use crate::protocol::layout::{Framing, Packet};
use crate::protocol::{Open6Arm, Protocol};
use crate::simulated::HandParameters;
use crate::simulated::fault::FaultPlan;
use crate::transmission::{Joint, Motor, Sensor, Transmission};

/// Numbers of the open protocol on USB: those that the pool keeps for tests.
const OPEN6_IDS: (u16, u16) = (0x1209, 0x0006);
/// Usage page and usage of its HID interface.
const OPEN6_USAGE: (u16, u16) = (0xFF6F, 0x36);
/// Bytes of an open6 report.
const OPEN6_REPORT: usize = 64;

/// What a profile does not say.
#[derive(Clone, Debug)]
pub struct MockSettings {
    /// Who holds the grip.
    pub hand: Option<HandParameters>,
    /// How long the hand waits.
    pub hand_delay: Duration,
    /// What goes wrong.
    pub faults: Vec<(String, FaultPlan)>,
    /// Seed of everything random.
    pub seed: u64,
}

/// The mock arm of a profile, and its protocol: open6 for a simulated arm.
pub fn parameters(profile: &Profile, settings: MockSettings) -> (MockParameters, Protocol) {
    let (kinematics, transmission, device_from_native, protocol) = match &profile.real {
        Some(real) => {
            (real.kinematics, real.transmission, real.device_from_native, real.protocol.clone())
        }
        None => (
            Kinematics::Cartesian,
            cartesian(profile),
            DQuat::IDENTITY,
            Protocol::Open6(open6(profile)),
        ),
    };
    let parameters = MockParameters {
        kinematics,
        transmission,
        device_from_native,
        sensed: profile.sensed,
        actuated: profile.actuated,
        is_compensated: !profile.has_unverified_signs(),
        plant: profile.plant,
        hand: settings.hand,
        hand_delay_s: settings.hand_delay.as_secs_f64(),
        period_s: 1.0 / f64::from(profile.link.rate_hz),
        limits: (profile.limits.force_n, profile.limits.torque_nm),
        faults: settings.faults,
        seed: settings.seed,
    };
    (parameters, protocol)
}

/// Readings are the pose, commands the wrench.
pub(crate) fn cartesian(profile: &Profile) -> Transmission {
    let limits = [profile.limits.force_n, profile.limits.torque_nm];
    Transmission {
        joints: core::array::from_fn(|idx| Joint {
            sensor: Some(Sensor {
                reading_idx: idx,
                rad_per_unit: 1.0,
                home: 0.0,
                offset_rad: 0.0,
            }),
            motor: (idx < 6 && profile.actuated.has(idx)).then(|| Motor {
                motor_idx: idx,
                units_per_nm: 1.0,
                limit_units: limits[idx / 3],
            }),
        }),
    }
}

/// What a simulated arm says of itself.
pub fn open6(profile: &Profile) -> Open6Arm {
    Open6Arm {
        name: profile.name.chars().take(Open6Arm::NAME_MAX).collect(),
        sensed: profile.sensed,
        actuated: profile.actuated,
        rate_hz: u16::try_from(profile.link.rate_hz).unwrap_or(u16::MAX),
        watchdog_ms: profile
            .link
            .device_watchdog_ms
            .and_then(|ms| u16::try_from(ms).ok())
            .unwrap_or(100),
        force_n: profile.limits.force_n as f32,
        torque_nm: profile.limits.torque_nm as f32,
        workspace_radius_m: profile.limits.workspace_radius_m as f32,
    }
}

/// Report ID and bytes of a packet beside it.
fn report_of(packet: &Packet) -> Option<(Option<u8>, usize)> {
    match packet.framing {
        Framing::Report { id, len } => Some((id, len)),
        _ => None,
    }
}

/// What the kernel gets of the HID device of a mock.
pub fn identity(profile: &Profile, protocol: &Protocol) -> HidIdentity {
    let matching = profile.real.as_ref().map(|real| &real.matching);
    // The interface that the profile looks for is the one that its arm has.
    let usage = (
        matching.and_then(|matching| matching.usage_page).unwrap_or(OPEN6_USAGE.0),
        matching.and_then(|matching| matching.usage).unwrap_or(OPEN6_USAGE.1),
    );
    let descriptor = match protocol {
        Protocol::HaptikfabrikenHid14 { carrier } => {
            let report = (None, carrier.report_len());
            vendor_descriptor(usage, report, report)
        }
        Protocol::SpaceMouse { .. } => space_mouse_descriptor(),
        Protocol::Declarative(layout) => {
            let input = report_of(&layout.report).unwrap_or((None, OPEN6_REPORT));
            vendor_descriptor(
                usage,
                input,
                layout.command.as_ref().and_then(report_of).unwrap_or(input),
            )
        }
        _ => vendor_descriptor(usage, (None, OPEN6_REPORT), (None, OPEN6_REPORT)),
    };
    let (vendor_id, product_id) = matching
        .and_then(|matching| matching.ids.first())
        .map_or(OPEN6_IDS, |id| (id.vendor, id.product));
    let serial =
        matching.and_then(|matching| matching.serial.clone()).unwrap_or_else(|| "mock".to_owned());
    let product = matching
        .and_then(|matching| matching.product.clone())
        .unwrap_or_else(|| profile.title.clone());
    HidIdentity { name: product, serial, vendor_id, product_id, descriptor }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::attached::nodes::{DeviceFile, NodeKind};
    use crate::mock::MockArm;
    use crate::profile::{self, TransportKind};
    use vps::spatial::Axes;

    /// What the kernel makes of a report descriptor that begins as ours do: usage page and usage of
    /// its collection.
    fn usage_of(descriptor: &[u8]) -> (u16, u16) {
        let mut page = 0;
        let mut usage = 0;
        let mut rest = descriptor;
        while let [item, ..] = rest {
            let n = [0, 1, 2, 4][usize::from(item & 3)];
            let value =
                rest[1..=n].iter().rev().fold(0, |value, byte| value << 8 | u16::from(*byte));
            match item & 0xFC {
                0x04 => page = value,
                0x08 => usage = value,
                0xA0 => return (page, usage),
                _ => {}
            }
            rest = &rest[1 + n..];
        }
        panic!("no collection")
    }

    #[test]
    fn a_profile_finds_the_device_of_its_mock() {
        let mut n_hid = 0;
        for name in profile::names() {
            let profile = profile::find(name, Path::new("")).expect(name);
            let Some(real) =
                profile.real.as_ref().filter(|real| real.matching.transport == TransportKind::Hid)
            else {
                continue;
            };
            let identity = identity(&profile, &real.protocol);
            let node = DeviceFile {
                vendor_id: identity.vendor_id,
                product_id: identity.product_id,
                serial: identity.serial,
                product: identity.name,
                usages: vec![usage_of(&identity.descriptor)],
                ..DeviceFile::at(Path::new("/dev/hidraw0"))
            };
            assert!(node.kind == NodeKind::Hid && real.matching.admits(&node), "{name}: {node:?}");
            n_hid += 1;
        }
        assert!(n_hid >= 4, "{n_hid}");
    }

    #[test]
    fn every_shipped_profile_has_a_mock_that_moves_and_feels() {
        for name in profile::names() {
            let profile = profile::find(name, Path::new("")).expect(name);
            let settings = MockSettings {
                hand: Some(HandParameters::default()),
                hand_delay: Duration::ZERO,
                faults: Vec::new(),
                seed: 0,
            };
            let (parameters, protocol) = parameters(&profile, settings);
            assert_eq!(
                parameters.transmission.joints.iter().any(|joint| joint.motor.is_some()),
                profile.actuated != Axes::NONE
            );
            for carriage in protocol.carriages() {
                let mut arm =
                    MockArm::new(parameters.clone(), protocol.firmware(*carriage)).expect(name);
                let home = arm.pose();
                for tick in 0..20 {
                    arm.advance(f64::from(tick) * parameters.period_s);
                }
                // Held by a hand that stays, and with no host: nothing happens.
                assert!((arm.pose().translation - home.translation).length() < 1e-9, "{name}");
                assert_eq!((arm.report().watchdog_trips, arm.report().periods), (0, 20), "{name}");
            }
            assert!(identity(&profile, &protocol).descriptor.len() > 20, "{name}");
        }
    }
}
