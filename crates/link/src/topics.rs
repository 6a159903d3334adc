//! Which part of a record is which message, on which topic: the table of `docs/reference/ros2.md`.

use super::messages::{
    DiagnosticArray, DiagnosticLevel, DiagnosticStatus, Header, JointState, Joy, Message,
    MessageType, OperatingState, PoseStamped, Time, TwistStamped, WrenchStamped,
};
use haptics::{Faults, OffCause};
use recording::TickRecord;
use vps::spatial::{Pose, Wrench};

/// Frames of a run.
const DEVICE: &str = "device";
const WORLD: &str = "world";
/// Name of the only joint that is published: the gripper.
const GRIPPER: [&str; 1] = ["gripper"];
/// Buttons of a `Joy`.
const N_BUTTONS: u32 = 8;

/// A topic, behind the namespace of its run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Topic {
    /// Pose of the grip.
    MeasuredCp,
    /// Its velocity.
    MeasuredCv,
    /// What the motors made of the command.
    MeasuredCf,
    /// The command.
    ServoCf,
    /// Pose of the tool.
    ToolMeasuredCp,
    /// Raw contact on the tool.
    ToolContactCf,
    /// Opening of the gripper.
    GripperMeasuredJs,
    /// State of the drive.
    OperatingState,
    /// Faults, and why no force flows.
    Diagnostics,
    /// Buttons.
    Joy,
}

/// A record, and what its messages need beside it.
#[derive(Clone, Copy, Debug)]
pub struct TopicInput<'a> {
    /// The newest record.
    pub record: &'a TickRecord,
    /// When its messages leave.
    pub stamp: Time,
    /// The arm, by its profile.
    pub arm: &'a str,
}

impl Topic {
    /// All of them.
    pub const ALL: [Self; 10] = [
        Self::MeasuredCp,
        Self::MeasuredCv,
        Self::MeasuredCf,
        Self::ServoCf,
        Self::ToolMeasuredCp,
        Self::ToolContactCf,
        Self::GripperMeasuredJs,
        Self::OperatingState,
        Self::Diagnostics,
        Self::Joy,
    ];

    /// Its name, in the words of CRTK.
    pub const fn name(self) -> &'static str {
        match self {
            Self::MeasuredCp => "measured_cp",
            Self::MeasuredCv => "measured_cv",
            Self::MeasuredCf => "measured_cf",
            Self::ServoCf => "servo_cf",
            Self::ToolMeasuredCp => "tool/measured_cp",
            Self::ToolContactCf => "tool/contact_cf",
            Self::GripperMeasuredJs => "gripper/measured_js",
            Self::OperatingState => "operating_state",
            Self::Diagnostics => "diagnostics",
            Self::Joy => "joy",
        }
    }

    /// What its messages are.
    pub const fn message_type(self) -> MessageType {
        match self {
            Self::MeasuredCp | Self::ToolMeasuredCp => PoseStamped::TYPE,
            Self::MeasuredCv => TwistStamped::TYPE,
            Self::MeasuredCf | Self::ServoCf | Self::ToolContactCf => WrenchStamped::TYPE,
            Self::GripperMeasuredJs => JointState::TYPE,
            Self::OperatingState => OperatingState::TYPE,
            Self::Diagnostics => DiagnosticArray::TYPE,
            Self::Joy => Joy::TYPE,
        }
    }

    /// True of what changes now and then; the others differ from tick to tick.
    pub const fn is_occasional(self) -> bool {
        matches!(self, Self::OperatingState | Self::Diagnostics | Self::Joy)
    }

    /// Its message; `None` where a number of it is none: ROS 2 has no word for that.
    pub fn message(self, moment: &TopicInput<'_>) -> Option<Vec<u8>> {
        let TopicInput { record, stamp, .. } = *moment;
        let sample = &record.input.sample;
        let output = &record.output;
        let at = |frame_id| Header { stamp, frame_id };
        let pose = |frame_id, pose: Pose| {
            pose.is_finite().then(|| PoseStamped { header: at(frame_id), pose }.to_cdr())
        };
        let wrench = |frame_id, wrench: Wrench| {
            wrench.is_finite().then(|| WrenchStamped { header: at(frame_id), wrench }.to_cdr())
        };
        match self {
            Self::MeasuredCp => pose(DEVICE, sample.pose),
            Self::MeasuredCv => sample
                .twist
                .is_finite()
                .then(|| TwistStamped { header: at(DEVICE), twist: sample.twist }.to_cdr()),
            Self::MeasuredCf => wrench(DEVICE, record.rendered_device),
            Self::ServoCf => wrench(DEVICE, output.command_device),
            Self::ToolMeasuredCp => pose(WORLD, output.world_from_tool),
            Self::ToolContactCf => wrench(WORLD, output.contact_world),
            Self::GripperMeasuredJs => sample.grip_rad.is_finite().then(|| {
                let position = [sample.grip_rad];
                JointState {
                    header: at(""),
                    name: &GRIPPER,
                    position: &position,
                    velocity: &[],
                    effort: &[],
                }
                .to_cdr()
            }),
            Self::OperatingState => {
                let state = output.drive.crtk_name();
                let is_busy = output.drive.is_busy();
                Some(
                    OperatingState { header: at(""), state, is_homed: sample.homed, is_busy }
                        .to_cdr(),
                )
            }
            Self::Diagnostics => Some(diagnostics(moment).to_cdr()),
            Self::Joy => {
                let buttons: Vec<_> =
                    (0..N_BUTTONS).map(|bit| (sample.buttons >> bit & 1) as i32).collect();
                Some(Joy { header: at(""), axes: &[], buttons: &buttons }.to_cdr())
            }
        }
    }

    /// What has to be sent at once when it differs from before; the same number for topics that do
    /// not wait for that.
    pub fn news(self, record: &TickRecord) -> u64 {
        let sample = &record.input.sample;
        let output = &record.output;
        match self {
            Self::OperatingState => {
                u64::from(sample.homed)
                    | u64::from(output.drive.is_busy()) << 1
                    | u64::from(output.drive as u8) << 2
            }
            Self::Diagnostics => {
                u64::from(output.faults.bits()) << 8 | u64::from(output.off_cause as u8)
            }
            Self::Joy => sample.buttons.into(),
            _ => 0,
        }
    }
}

/// Faults, why no force flows, and the contact.
fn diagnostics<'a>(&TopicInput { record, stamp, arm }: &TopicInput<'a>) -> DiagnosticArray<'a> {
    let faults = record.output.faults;
    let cause = record.output.off_cause;
    let status = |level, name, message, values| DiagnosticStatus {
        level,
        name,
        message,
        hardware_id: arm,
        values,
    };
    let present = || Faults::TABLE.into_iter().filter(|(fault, ..)| faults.contains(*fault));
    let words: Vec<_> = present().map(|(.., words)| words).collect();
    let named = present().map(|(_, name, words)| (name, words.to_owned())).collect();
    let fault_level = if faults.is_empty() { DiagnosticLevel::Ok } else { DiagnosticLevel::Error };
    let force_level =
        if cause == OffCause::None { DiagnosticLevel::Ok } else { DiagnosticLevel::Warn };
    let depth = Some(record.output.max_depth_m).filter(|depth_m| depth_m.is_finite());
    let depth = depth.map(|depth_m| ("max_depth_m", depth_m.to_string())).into_iter().collect();
    DiagnosticArray {
        header: Header { stamp, frame_id: "" },
        status: vec![
            status(fault_level, "hapticd: faults", words.join("; "), named),
            status(
                force_level,
                "hapticd: force",
                cause.name().to_owned(),
                vec![("advice", cause.advice().to_owned())],
            ),
            status(DiagnosticLevel::Ok, "hapticd: contact", String::new(), depth),
        ],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use haptics::{Drive, TickInput, TickOutput};
    use vps::spatial::DeviceSample;

    fn record() -> TickRecord {
        let sample = DeviceSample { buttons: 0b101, grip_rad: 0.25, ..DeviceSample::default() };
        let output = TickOutput {
            drive: Drive::Fault,
            faults: Faults::SPEED | Faults::STALE,
            off_cause: OffCause::Velocity,
            ..TickOutput::default()
        };
        TickRecord {
            input: TickInput { sample, ..TickInput::default() },
            output,
            ..TickRecord::default()
        }
    }

    fn message(topic: Topic, record: &TickRecord) -> Option<Vec<u8>> {
        topic.message(&TopicInput { record, stamp: Time { sec: 7, nanosec: 9 }, arm: "sim-sigma7" })
    }

    fn text(topic: Topic, record: &TickRecord) -> String {
        String::from_utf8_lossy(&message(topic, record).expect("a message")).into_owned()
    }

    #[test]
    fn every_topic_is_in_the_table_with_its_type() {
        let page = include_str!("../../../docs/reference/ros2.md");
        for topic in Topic::ALL {
            let row = format!(
                "`{}` | `{}/{}`",
                topic.name(),
                topic.message_type().package,
                topic.message_type().name
            );
            assert!(page.contains(&row), "{row}");
        }
    }

    #[test]
    fn every_topic_has_a_message_and_none_with_what_is_no_number() {
        let mut record = record();
        assert!(Topic::ALL.into_iter().all(|topic| message(topic, &record).is_some()));
        record.input.sample.pose.translation.x = f64::NAN;
        record.input.sample.twist.angular.z = f64::INFINITY;
        record.output.contact_world.force.y = f64::NAN;
        record.output.max_depth_m = f64::NAN;
        let missing: Vec<_> =
            Topic::ALL.into_iter().filter(|topic| message(*topic, &record).is_none()).collect();
        assert_eq!(missing, [Topic::MeasuredCp, Topic::MeasuredCv, Topic::ToolContactCf]);
        assert!(!text(Topic::Diagnostics, &record).contains("max_depth_m"));
    }

    #[test]
    fn a_fault_and_its_cause_are_reported_in_names_and_words() {
        let reported = text(Topic::Diagnostics, &record());
        for wanted in [
            "hapticd: faults",
            "speed\0",
            "stale\0",
            "faster than the speed limit",
            "hapticd: force",
            "velocity\0",
            "sim-sigma7",
        ] {
            assert!(reported.contains(wanted), "{wanted}: {reported}");
        }
        assert!(text(Topic::OperatingState, &record()).contains("FAULT\0"));
        let calm = text(Topic::Diagnostics, &TickRecord::default());
        assert!(!calm.contains("speed\0") && calm.contains("none\0"));
    }

    #[test]
    fn what_is_sent_at_once_is_what_a_subscriber_waits_for() {
        let before = record();
        let mut after = record();
        let changed = |after: &TickRecord| {
            Topic::ALL
                .into_iter()
                .filter(|topic| topic.news(&before) != topic.news(after))
                .collect::<Vec<_>>()
        };
        after.input.sample.pose.translation.x += 1.0;
        after.output.max_depth_m += 1.0;
        assert_eq!(changed(&after), []);
        after.output.off_cause = OffCause::Software;
        assert_eq!(changed(&after), [Topic::Diagnostics]);
        after.output.drive = Drive::Disabled;
        after.input.sample.buttons = 0;
        assert_eq!(changed(&after), [Topic::OperatingState, Topic::Diagnostics, Topic::Joy]);
        assert!(changed(&after).into_iter().all(Topic::is_occasional));
    }
}
