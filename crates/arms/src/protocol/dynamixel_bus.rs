//! The servos of `dynamixel2` on their bus, as far as a leader arm uses them.

use super::dynamixel::{
    BROADCAST, BUS_WATCHDOG, GOAL_CURRENT, MODE, PING, PRESENT, PRESENT_LEN, Packets, STATUS,
    SYNC_READ, SYNC_WRITE, TORQUE_ENABLE, VELOCITY_UNIT, WRITE, put_packet,
};
use super::number::{count_32, i16_at, u16_at};
use super::{ArmReadings, Firmware, MAX_AXES, Outbox, Servo};

/// The address cannot be written now.
const ACCESS: u8 = 7;
const RANGE: u8 = 4;
const INSTRUCTION: u8 = 2;

/// One servo: what of its control table matters.
#[derive(Debug)]
struct ServoState {
    servo: Servo,
    torque: bool,
    mode: u8,
    goal: i16,
    /// 20 ms each; 0: off; 255: tripped.
    watchdog: u8,
    /// Its error byte says that it has stopped itself.
    alert: bool,
}

impl ServoState {
    /// Writes a stretch of the table; gives the error.
    fn write(&mut self, address: u16, data: &[u8]) -> u8 {
        let is_tripped = self.watchdog == 255;
        match (address, data) {
            (BUS_WATCHDOG, [steps @ 0..=127]) => self.watchdog = *steps,
            (BUS_WATCHDOG, _) => return RANGE,
            (TORQUE_ENABLE, [on @ 0..=1]) => {
                self.torque = *on == 1;
                if !self.torque {
                    self.goal = 0;
                }
            }
            (GOAL_CURRENT, [_, _]) if is_tripped => return ACCESS,
            (GOAL_CURRENT, [_, _]) => {
                let goal = i16_at(data, 0);
                if goal.unsigned_abs() > self.servo.model.limit_counts().unsigned_abs() {
                    return RANGE;
                }
                self.goal = goal;
            }
            (0..64, _) if self.torque => return ACCESS,
            (MODE, [mode]) => self.mode = *mode,
            (0..64, _) => {}
            _ => return ACCESS,
        }
        0
    }

    fn motor(&self) -> f64 {
        if self.torque && self.mode == 0 && self.watchdog != 255 && !self.alert {
            f64::from(self.goal)
        } else {
            0.0
        }
    }
}

/// The arm's side: servos that share a bus, each with a watchdog of its own that latches.
#[derive(Debug, Default)]
pub(super) struct ArmFirmware {
    packets: Packets,
    servos: Vec<ServoState>,
    fed_s: f64,
}

impl ArmFirmware {
    pub(super) fn new(servos: &[Servo]) -> Self {
        // As the maker ships them: position mode, torque off, watchdog off.
        let state = |servo: &Servo| ServoState {
            servo: *servo,
            torque: false,
            mode: 3,
            goal: 0,
            watchdog: 0,
            alert: false,
        };
        Self {
            packets: Packets::default(),
            servos: servos.iter().take(MAX_AXES).map(state).collect(),
            fed_s: 0.0,
        }
    }

    #[cfg(test)]
    pub(super) fn alert(&mut self, idx: usize) {
        self.servos[idx].alert = true;
    }

    fn take(
        &mut self,
        id: u8,
        instruction: u8,
        parameters: &[u8],
        arm: &ArmReadings,
        out: &mut Outbox,
    ) {
        let mut answer = |servo: &ServoState, error: u8, data: &[u8]| {
            let mut packet = Vec::new();
            let error = error | if servo.alert { 0x80 } else { 0 };
            put_packet(
                servo.servo.id,
                STATUS,
                core::iter::once(error).chain(data.iter().copied()),
                &mut |byte| packet.push(byte),
            );
            out.push(packet);
        };
        let address = u16_at(parameters, 0);
        match instruction {
            PING => {
                for servo in
                    self.servos.iter().filter(|servo| id == BROADCAST || servo.servo.id == id)
                {
                    let [low, high] = servo.servo.model.number().to_le_bytes();
                    answer(servo, 0, &[low, high, 45]);
                }
            }
            WRITE if parameters.len() > 2 => {
                for servo in self.servos.iter_mut().filter(|servo| servo.servo.id == id) {
                    let error = servo.write(address, &parameters[2..]);
                    answer(servo, error, &[]);
                }
            }
            SYNC_WRITE if parameters.len() > 4 => {
                let len = usize::from(u16_at(parameters, 2));
                for part in parameters[4..].chunks_exact(1 + len) {
                    for servo in self.servos.iter_mut().filter(|servo| servo.servo.id == part[0]) {
                        servo.write(address, &part[1..]);
                    }
                }
            }
            SYNC_READ if address == PRESENT && u16_at(parameters, 2) == PRESENT_LEN => {
                for id in &parameters[4..] {
                    for (idx, servo) in
                        self.servos.iter().enumerate().filter(|(_, servo)| servo.servo.id == *id)
                    {
                        let mut data = Vec::with_capacity(PRESENT_LEN.into());
                        data.extend((servo.motor() as i16).to_le_bytes());
                        data.extend(
                            ((arm.rates[idx] / VELOCITY_UNIT).round() as i32).to_le_bytes(),
                        );
                        data.extend(count_32(arm.readings[idx]).to_le_bytes());
                        answer(servo, 0, &data);
                    }
                }
            }
            STATUS => {}
            _ => {
                for servo in self.servos.iter().filter(|servo| servo.servo.id == id) {
                    answer(servo, INSTRUCTION, &[]);
                }
            }
        }
    }
}

impl Firmware for ArmFirmware {
    fn receive(&mut self, bytes: &[u8], now_s: f64, arm: &ArmReadings, out: &mut Outbox) {
        for byte in bytes {
            let mut found = Vec::new();
            self.packets.push(*byte, |packet| {
                found.push((packet.id, packet.instruction, packet.parameters.to_vec()))
            });
            for (id, instruction, parameters) in found {
                // Any instruction on the bus feeds every watchdog.
                self.fed_s = now_s;
                self.take(id, instruction, &parameters, arm, out);
            }
        }
    }

    fn advance(&mut self, now_s: f64, _: &ArmReadings, _: &mut Outbox) {
        for servo in &mut self.servos {
            if (1..=127).contains(&servo.watchdog)
                && now_s - self.fed_s > 0.02 * f64::from(servo.watchdog)
            {
                servo.watchdog = 255;
                servo.goal = 0;
            }
        }
    }

    fn motors(&self) -> [f64; MAX_AXES] {
        let mut motors = [0.0; MAX_AXES];
        for (motor, servo) in motors.iter_mut().zip(&self.servos) {
            *motor = servo.motor();
        }
        motors
    }
}
