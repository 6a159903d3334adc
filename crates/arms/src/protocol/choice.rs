//! Which protocol an arm speaks, with what its profile has to supply. Plain data.

#[cfg(test)]
use core::time::Duration;
use std::path::PathBuf;

use super::{
    Codec, Firmware, HapiBoard, HapiEncoder, HaplyService, Hid14Carrier, MAX_AXES, MotorCommand,
    Open6Arm, PacketLayout, ProtocolError, Servo, declarative, dynamixel, dynamixel_bus, falcon,
    hapi, hapkit, haply, hid14, open6, open6_arm, space_mouse,
};
use crate::Pacing;
use crate::transport::{Carriage, Frame};
use crate::vendor::VendorProtocol;

/// The protocol of an arm. The docs of each variant name its readings ([`Report::readings`]) and
/// its motors ([`MotorCommand::motors`]) in order, in the units of the wire.
///
/// [`Report::readings`]: super::Report::readings
/// [`MotorCommand::motors`]: super::MotorCommand::motors
#[derive(Clone, Debug, PartialEq)]
pub enum Protocol {
    /// Haptikfabriken boards of 2019, HID, one reply per command, kick-start. Readings 0–2:
    /// encoders a, b, c; 3–5: gimbal joints D, E, F (on the wire in the reverse order, as f, e, d);
    /// counts, unwrapped. Motors 0–2: a, b, c, mA. Button bit 0: grip; bit 1: the calibration
    /// button was pressed.
    HaptikfabrikenHid14 {
        /// Size of the reports.
        carrier: Hid14Carrier,
    },
    /// Haply 2DIY and other boards with the hAPI firmware, one reply per command.
    /// Readings: one per encoder in port order, degrees. Motors: one per motor in port order, N·m.
    HapiF32(HapiBoard),
    /// Novint Falcon, FTDI over USB bulk, one reply per command.
    /// Readings 0–2: encoders 1, 2, 3, counts. Motors 0–2: counts of −10⁻⁴ N·m, at most ±4096.
    /// Button bits 0–3: plus, forward, centre, minus.
    FalconNibble16 {
        /// The firmware image that the user owns; without one, a Falcon that was just switched on
        /// cannot be started.
        image: Option<PathBuf>,
    },
    /// Hapkit, one axis, lines of text, the arm sends by itself.
    /// Reading 0: position, m, with its rate in m/s. Motor 0: force, N. Button bit 0.
    HapkitAscii,
    /// SpaceMouse family, HID, reports on change, no motors. Readings 0–5: x, y, z, rx, ry, rz,
    /// counts of about ±350 at full scale; they are rates, not a pose.
    SpaceMouse {
        /// Counts of an axis up to this are 0.
        dead_band: u16,
    },
    /// A SpaceMouse through the socket of spacenavd: readings as [`Self::SpaceMouse`], already
    /// shaped by the daemon.
    Spacenav,
    /// A leader arm of Dynamixel X servos, one exchange per command. Readings: position of each
    /// servo, 1/4096 turn, with rates. Motors: goal current of each, counts of its model.
    Dynamixel2 {
        /// The servos from base to grip: at most [`MAX_AXES`], ids unique.
        servos: Vec<Servo>,
    },
    /// The open protocol of `docs/reference/protocol.md`, HID or serial, one state per command.
    /// Readings 0–2: x, y, z, m; 3–6: orientation x, y, z, w; 7: grip, rad. Rates: velocity, m/s;
    /// angular velocity, rad/s; 7: grip, rad/s (0 where not sent). Motors 0–2: force, N; 3–5:
    /// torque, N·m; 6: grip torque, N·m.
    Open6(Open6Arm),
    /// The Inverse service of Haply, one state per command. Readings 0–2: x, y, z, m; 3–6:
    /// orientation of the grip x, y, z, w. Motors 0–2: force, N. Button bits 0–9: a to f, up, down,
    /// left, right.
    HaplyService(HaplyService),
    /// Frames described as data.
    Declarative(PacketLayout),
    /// A library of the arm's maker, in a worker that speaks [`Self::Open6`]: the same readings and
    /// motors.
    Vendor(VendorProtocol),
}

impl Protocol {
    /// Name in profiles.
    pub const fn name(&self) -> &'static str {
        match self {
            Self::HaptikfabrikenHid14 { .. } => "haptikfabriken-hid14",
            Self::HapiF32(_) => "hapi-f32",
            Self::FalconNibble16 { .. } => "falcon-nibble16",
            Self::HapkitAscii => "hapkit-ascii",
            Self::SpaceMouse { .. } => "3dconnexion-hid",
            Self::Spacenav => "spacenav",
            Self::Dynamixel2 { .. } => "dynamixel2",
            Self::Open6(_) => "open6",
            Self::HaplyService(_) => "haply-service",
            Self::Declarative(layout) => layout.name,
            Self::Vendor(vendor) => vendor.family.name(),
        }
    }

    /// What the error code of a sample means, where the protocol has words for it.
    pub fn error_text(&self, error: u16) -> Option<String> {
        match self {
            Self::Open6(_) => Some(open6::error_text(error)),
            Self::HaplyService(_) => Some(haply::error_text(error)),
            Self::Vendor(vendor) => Some(
                vendor
                    .family
                    .fault_text(error)
                    .map_or_else(|| open6::error_text(error), str::to_owned),
            ),
            Self::Dynamixel2 { .. } => Some(dynamixel::report_error_text(error)),
            _ => None,
        }
    }

    /// Bytes of one command and its answer on a serial line, stuffing and checks included; `None`
    /// for boards that are ports of USB by themselves, which ignore the baud rate, and for lines of
    /// text, which have no one length.
    pub fn exchange_bytes(&self) -> Option<usize> {
        match self {
            Self::Open6(_) => Some(open6::EXCHANGE_BYTES),
            Self::Dynamixel2 { servos } => Some(dynamixel::exchange_bytes(servos.len())),
            Self::Declarative(layout) => layout.exchange_bytes(),
            _ => None,
        }
    }

    /// Step of motor commands on the wire, in their units; 0 where it is too fine to matter.
    pub fn motor_step(&self) -> f64 {
        match self {
            Self::HapiF32(_)
            | Self::HapkitAscii
            | Self::Open6(_)
            | Self::HaplyService(_)
            | Self::SpaceMouse { .. }
            | Self::Spacenav
            | Self::Vendor(_) => 0.0,
            Self::Declarative(layout) => layout.motor_step(),
            Self::HaptikfabrikenHid14 { .. }
            | Self::FalconNibble16 { .. }
            | Self::Dynamixel2 { .. } => 1.0,
        }
    }

    /// How many readings a report has.
    pub(crate) fn n_readings(&self) -> usize {
        match self {
            Self::FalconNibble16 { .. } => 3,
            Self::HaptikfabrikenHid14 { .. } | Self::SpaceMouse { .. } | Self::Spacenav => 6,
            Self::HapiF32(board) => board.encoders.len(),
            Self::HapkitAscii => 1,
            Self::Dynamixel2 { servos } => servos.len(),
            Self::Open6(_) | Self::Vendor(_) => 8,
            Self::HaplyService(_) => 7,
            Self::Declarative(layout) => layout.n_readings(),
        }
    }

    /// How many motors a command has.
    pub(crate) fn n_motors(&self) -> usize {
        match self {
            Self::HaptikfabrikenHid14 { .. } | Self::FalconNibble16 { .. } => 3,
            Self::SpaceMouse { .. } | Self::Spacenav => 0,
            Self::HapiF32(board) => board.motors.len(),
            Self::HapkitAscii => 1,
            Self::Dynamixel2 { servos } => servos.len(),
            Self::Open6(_) | Self::Vendor(_) => 7,
            Self::HaplyService(_) => 3,
            Self::Declarative(layout) => layout.n_motors(),
        }
    }

    /// A frame that takes the force away, whatever was exchanged before it; empty where there are
    /// no motors. Cold.
    pub(crate) fn zero_frame(&self, carriage: Carriage) -> Frame {
        let mut frame = Frame::default();
        if self.n_motors() > 0 {
            let mut codec = self.codec(carriage);
            codec.zero_out_of_step(&mut frame);
            if frame.is_empty() {
                codec.encode(&MotorCommand::default(), &mut frame);
            }
        }
        frame
    }

    /// How its bytes may travel.
    pub fn carriages(&self) -> &'static [Carriage] {
        match self {
            Self::HaptikfabrikenHid14 { .. } | Self::SpaceMouse { .. } | Self::HaplyService(_) => {
                &[Carriage::Reports]
            }
            Self::HapiF32(_)
            | Self::FalconNibble16 { .. }
            | Self::HapkitAscii
            | Self::Spacenav
            | Self::Dynamixel2 { .. } => &[Carriage::Stream],
            Self::Open6(_) | Self::Vendor(_) => &[Carriage::Reports, Carriage::Stream],
            Self::Declarative(layout) => layout.carriages(),
        }
    }

    /// Who sets the rate.
    pub(crate) fn pacing(&self) -> Pacing {
        match self {
            Self::HapkitAscii => Pacing::Stream,
            Self::SpaceMouse { .. } | Self::Spacenav => Pacing::Event,
            Self::Declarative(layout) => layout.pacing,
            _ => Pacing::PingPong,
        }
    }

    /// After how long without a command the arm drops it by itself; `None`: never, or not known.
    #[cfg(test)]
    pub(super) fn watchdog(&self) -> Option<Duration> {
        match self {
            Self::HaptikfabrikenHid14 { .. } => Some(Duration::from_millis(500)),
            Self::Dynamixel2 { .. } => Some(Duration::from_millis(40)),
            Self::Open6(arm) | Self::Vendor(VendorProtocol { arm, .. }) => {
                Some(Duration::from_millis(arm.watchdog_ms.into()))
            }
            Self::HaplyService(_) => Some(haply::service::IDLE),
            Self::Declarative(layout) => {
                layout.watchdog_ms.map(|ms| Duration::from_millis(ms.into()))
            }
            _ => None,
        }
    }

    /// The host's side. `carriage`: one of [`Self::carriages`]; only `open6` has a choice.
    pub fn codec(&self, carriage: Carriage) -> Box<dyn Codec> {
        match self {
            Self::HaptikfabrikenHid14 { carrier } => Box::new(hid14::HostCodec::new(*carrier)),
            Self::HapiF32(board) => Box::new(hapi::HostCodec::new(board.clone())),
            Self::FalconNibble16 { image } => Box::new(falcon::HostCodec::new(image.clone())),
            Self::HapkitAscii => Box::new(hapkit::HostCodec::default()),
            Self::SpaceMouse { dead_band } => Box::new(space_mouse::HostCodec::new(*dead_band)),
            Self::Spacenav => Box::new(space_mouse::SocketHost::default()),
            Self::Dynamixel2 { servos } => Box::new(dynamixel::HostCodec::new(servos)),
            Self::Open6(arm) | Self::Vendor(VendorProtocol { arm, .. }) => {
                Box::new(open6::HostCodec::new(arm.clone(), carriage))
            }
            Self::HaplyService(_) => Box::new(haply::HostCodec::default()),
            Self::Declarative(layout) => Box::new(declarative::HostCodec::new(layout.clone())),
        }
    }

    /// The arm's side: what a simulated arm answers with.
    pub fn firmware(&self, carriage: Carriage) -> Box<dyn Firmware> {
        match self {
            Self::HaptikfabrikenHid14 { carrier } => Box::new(hid14::ArmFirmware::new(*carrier)),
            Self::HapiF32(_) => Box::new(hapi::ArmFirmware::default()),
            Self::FalconNibble16 { .. } => Box::new(falcon::ArmFirmware::default()),
            Self::HapkitAscii => Box::new(hapkit::ArmFirmware::default()),
            Self::SpaceMouse { .. } => Box::new(space_mouse::Puck::new(true)),
            Self::Spacenav => Box::new(space_mouse::SocketPuck::default()),
            Self::Dynamixel2 { servos } => Box::new(dynamixel_bus::ArmFirmware::new(servos)),
            Self::Open6(arm) | Self::Vendor(VendorProtocol { arm, .. }) => {
                Box::new(open6_arm::ArmFirmware::new(arm.clone(), carriage))
            }
            Self::HaplyService(service) => Box::new(haply::Adapted::new(service)),
            Self::Declarative(layout) => Box::new(declarative::ArmFirmware::new(layout.clone())),
        }
    }

    /// Checks what the profile supplied.
    ///
    /// # Errors
    /// [`ProtocolError`] says what is not accepted and what would be.
    pub(crate) fn check(&self) -> Result<(), ProtocolError> {
        let refuse = |text: String| Err(ProtocolError(text));
        match self {
            Self::HapiF32(board) => {
                let n_motors = board.motors.len();
                let n_encoders = board.encoders.len();
                if !(1..=4).contains(&n_motors) || !(1..=4).contains(&n_encoders) {
                    return refuse(format!(
                        "{n_motors} motors and {n_encoders} encoders: 1 to 4 of each"
                    ));
                }
                let sound = |encoder: &HapiEncoder| {
                    encoder.start_deg.is_finite()
                        && encoder.counts_per_rev.is_finite()
                        && encoder.counts_per_rev > 0.0
                };
                match board.encoders.iter().position(|encoder| !sound(encoder)) {
                    Some(idx) => refuse(format!(
                        "encoder at port {}: the start angle has to be a number and the counts per \
                            turn more than 0",
                        idx + 1
                    )),
                    None => Ok(()),
                }
            }
            Self::Dynamixel2 { servos } => {
                if !(1..=MAX_AXES).contains(&servos.len()) {
                    return refuse(format!("{} servos: 1 to {MAX_AXES}", servos.len()));
                }
                for (idx, servo) in servos.iter().enumerate() {
                    if servo.id > 252 {
                        return refuse(format!("servo id {}: 0 to 252", servo.id));
                    }
                    if servos[..idx].iter().any(|other| other.id == servo.id) {
                        return refuse(format!(
                            "servo id {} is there twice: every servo on a bus has its own id",
                            servo.id
                        ));
                    }
                }
                Ok(())
            }
            Self::Open6(arm) | Self::Vendor(VendorProtocol { arm, .. }) => {
                if arm.name.len() > Open6Arm::NAME_MAX {
                    return refuse(format!(
                        "name of {} bytes: at most {}",
                        arm.name.len(),
                        Open6Arm::NAME_MAX
                    ));
                }
                if arm.watchdog_ms == 0 {
                    return refuse(
                        "watchdog of 0 ms: at least 1, since an arm of this protocol has one"
                            .to_owned(),
                    );
                }
                let limits = [arm.force_n, arm.torque_nm, arm.workspace_radius_m];
                if limits.iter().any(|limit| !limit.is_finite() || *limit < 0.0) {
                    return refuse(
                        "limits of force, torque and workspace have to be numbers of at least 0"
                            .to_owned(),
                    );
                }
                Ok(())
            }
            Self::Declarative(layout) => layout.check(),
            _ => Ok(()),
        }
    }
}
