//! The other end: what the service answers over a simulated arm. JSON as its clients get it;
//! [`Adapted`] puts records in its place.
//!
//! It takes both dialects, as the service of 3.5 does. How long the service waits for the next
//! message before it lets the arm go is not published; here it is [`IDLE_S`].

use core::time::Duration;

use serde_json::{Value, json};

use super::message::BUTTONS;
use super::{COMMAND, Dialect, HaplyService, Reader, Version, command_text};
use crate::protocol::{ArmReadings, Firmware, MAX_AXES, Outbox};

/// A client that says nothing for so long has let the arm go: assumed.
pub(in crate::protocol) const IDLE: Duration = Duration::from_millis(100);
/// What stands for a client that has just connected: it gets the inventory.
pub(crate) const HELLO: &[u8] = b"\0";
/// Ids of the published examples.
const ARM: &str = "049D";
const GRIP: &str = "1402";

/// The service with one arm and one grip.
#[derive(Debug)]
pub(crate) struct Service {
    version: Version,
    arm: String,
    grip: String,
    force_n: [f64; 3],
    fed_s: f64,
    /// Orientation of a grip that went to sleep.
    asleep_at: Option<[f64; 4]>,
}

impl Service {
    /// The service that a profile looks for.
    pub(crate) fn new(wanted: &HaplyService, version: Version) -> Self {
        let arm = wanted.arm.clone().unwrap_or_else(|| ARM.to_owned());
        let grip = wanted.grip.clone().unwrap_or_else(|| GRIP.to_owned());
        Self { version, arm, grip, force_n: [0.0; 3], fed_s: f64::NEG_INFINITY, asleep_at: None }
    }

    /// A frame, with `config` where the client asked for all of it.
    fn frame(&mut self, arm: &ArmReadings, is_full: bool) -> String {
        let vector = |numbers: &[f64]| json!({ "x": numbers[0], "y": numbers[1], "z": numbers[2] });
        let here = &arm.readings;
        let orientation = [here[3], here[4], here[5], here[6]];
        let turned = match arm.asleep {
            true => *self.asleep_at.get_or_insert(orientation),
            false => {
                self.asleep_at = None;
                orientation
            }
        };
        let control_mode = if self.fed_s.is_finite() { "force" } else { "idle" };
        let buttons: serde_json::Map<String, Value> = BUTTONS
            .iter()
            .enumerate()
            .map(|(bit, name)| ((*name).to_owned(), (arm.buttons >> bit & 1 == 1).into()))
            .collect();
        let zero = vector(&[0.0; 3]);
        let still = json!({ "a0": 0.0, "a1": 0.0, "a2": 0.0 });
        let upright = json!({ "w": 1.0, "x": 0.0, "y": 0.0, "z": 0.0 });
        let mut inverse3 = json!({
            "device_id": self.arm,
            "state": {
                "cursor_position": vector(here),
                "cursor_velocity": vector(&arm.rates),
                "angular_position": still, "angular_velocity": still,
                "body_orientation": upright,
                "current_cursor_force": vector(&self.force_n),
                "current_cursor_position": zero,
                "current_angular_torques": still, "current_angular_position": still,
                "control_domain": "cartesian", "control_mode": control_mode, "mode": "idle",
                "transform": {},
            },
            "status": { "calibrated": arm.homed, "in_use": self.fed_s.is_finite(), "power_supply": true, "ready": true, "started": true },
        });
        let mut grip = json!({
            "device_id": self.grip,
            "state": {
                "battery_voltage": 4.1, "battery_level": 0.9,
                "buttons": buttons, "hall": 0,
                "orientation": { "x": turned[0], "y": turned[1], "z": turned[2], "w": turned[3] },
                "transform": {}, "transform_velocity": {},
            },
            "status": { "connected": true, "awake": !arm.asleep, "ready": true },
        });
        let mut frame = json!({ "session_id": 1 });
        if is_full {
            inverse3["config"] = json!({
                "type": "inverse3", "port": "mock",
                "device_info": { "major_version": 7, "minor_version": 4, "id": self.arm, "device_type": 4, "uuid": "00000000-0000-0000-0000-000000000000" },
                "extended_device_id": self.arm, "extended_firmware_version": "mock",
                "gravity_compensation": { "enabled": true, "scaling_factor": 1.0 },
                "handedness": "right", "streaming_mode": "USB",
                "torque_scaling": { "enabled": true }, "home_return": { "enabled": false },
                "preset": "defaults", "basis": { "permutation": "XYZ" },
                "mount": { "position": zero, "rotation": upright, "scale": vector(&[1.0; 3]) },
                "filters": { "force_gate": { "gain": 0.3 }, "damping": { "scalar": 0.0 } },
            });
            grip["config"] = json!({
                "port": "mock", "type": "wireless_verse_grip", "major_version": 2, "minor_version": 2, "hardware_version": 1,
                "streaming_mode": "Radio", "preset": "defaults", "basis": { "permutation": "XYZ" }, "mount": {},
            });
            frame["session"] = json!({ "session_id": 1, "config": { "profile": { "name": "default" } }, "started_time": "2026-01-01 00:00:00" });
        }
        frame["inverse3"] = json!([inverse3]);
        frame["verse_grip"] = json!([]);
        frame["wireless_verse_grip"] = json!([grip]);
        frame["custom_verse_grip"] = json!([]);
        frame.to_string()
    }

    /// The force that a message asks for; `None`: it asks for none. Versions before 3.5 know one
    /// dialect.
    fn asked(&self, message: &Value) -> Option<[f64; 3]> {
        let arm = message["inverse3"]
            .as_array()?
            .iter()
            .find(|arm| arm["device_id"] == self.arm.as_str())?;
        let command = arm["commands"]
            .get("set_cursor_force")
            .filter(|command| command["execute"] != false)?;
        let vector = command.get(Dialect::Vector.key()).filter(|_| self.version >= Version(3, 5));
        let force = vector.or_else(|| command.get(Dialect::Values.key()))?;
        Some(["x", "y", "z"].map(|axis| force[axis].as_f64().unwrap_or(0.0)))
    }
}

impl Firmware for Service {
    fn receive(&mut self, bytes: &[u8], now_s: f64, arm: &ArmReadings, out: &mut Outbox) {
        if bytes == HELLO {
            out.push(self.frame(arm, true).into_bytes());
            return;
        }
        let Ok(message) = serde_json::from_slice::<Value>(bytes) else { return };
        // A command is one of this message: without one there is no force.
        self.force_n = self.asked(&message).unwrap_or_default();
        self.fed_s = now_s;
        let is_full = message["session"].get("force_render_full_state").is_some();
        out.push(self.frame(arm, is_full).into_bytes());
    }

    fn advance(&mut self, now_s: f64, _: &ArmReadings, _: &mut Outbox) {
        if now_s - self.fed_s > IDLE.as_secs_f64() {
            (self.force_n, self.fed_s) = ([0.0; 3], f64::NEG_INFINITY);
        }
    }

    fn motors(&self) -> [f64; MAX_AXES] {
        let mut motors = [0.0; MAX_AXES];
        motors[..3].copy_from_slice(&self.force_n);
        motors
    }
}

/// The same as the loop has it: records in the place of messages, by the code that the threads of
/// the link run.
pub(in crate::protocol) struct Adapted {
    service: Service,
    reader: Reader,
    messages: Outbox,
}

impl Adapted {
    pub(in crate::protocol) fn new(wanted: &HaplyService) -> Self {
        let service = Service::new(wanted, Version(3, 5));
        let reader = Reader::new(&service.arm, wanted.has_grip.then_some(service.grip.as_str()));
        Self { service, reader, messages: Outbox::new() }
    }
}

impl Firmware for Adapted {
    fn receive(&mut self, bytes: &[u8], now_s: f64, arm: &ArmReadings, out: &mut Outbox) {
        if bytes.first() == Some(&COMMAND)
            && let Some(text) = command_text(bytes, &self.service.arm, Dialect::Vector)
        {
            self.service.receive(text.as_bytes(), now_s, arm, &mut self.messages);
            out.extend(self.messages.drain(..).map(|message| self.reader.record(&message)));
        }
    }

    fn advance(&mut self, now_s: f64, arm: &ArmReadings, out: &mut Outbox) {
        self.service.advance(now_s, arm, out);
    }

    fn motors(&self) -> [f64; MAX_AXES] {
        self.service.motors()
    }
}
