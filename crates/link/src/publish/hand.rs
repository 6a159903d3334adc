//! Poses from the network for the hand of a simulated arm: a topic of ROS 2, and a key for programs
//! without ROS.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::{DQuat, DVec3};
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::Subscriber;
use zenoh::{Session, Wait};

use super::plan::{PublishError, refused};
use crate::{Message, PoseStamped, RosNode, subscriber_token, topic_key};
use vps::spatial::Pose;

/// The topic: where the tool shall be.
const TOPIC: &str = "tool/servo_cp";
/// The frame of its poses.
const FRAME: &str = "world";

/// What takes a pose of the tool, `world_from_tool`, or why a message has none. Called on a thread
/// of zenoh.
pub(super) type TakePose = Arc<dyn Fn(Result<Pose, String>) + Send + Sync>;

/// The subscribers of a run; they end with this.
pub(super) struct HandTopics {
    _ros: Subscriber<()>,
    _plain: Subscriber<()>,
    _token: LivelinessToken,
}

impl HandTopics {
    /// Declares them; `number` counts the endpoints of the node from 0.
    pub(super) fn open(
        session: &Session,
        node: &RosNode,
        number: usize,
        take: TakePose,
    ) -> Result<Self, PublishError> {
        let message_type = PoseStamped::TYPE;
        let token = subscriber_token(node, number, TOPIC, &message_type);
        let ros = subscribe(
            session,
            topic_key(node, TOPIC, &message_type),
            pose_of_message,
            take.clone(),
        )?;
        let plain =
            subscribe(session, format!("hapticd/{}/hand", node.namespace), pose_of_json, take)?;
        let token =
            session.liveliness().declare_token(token.clone()).wait().map_err(refused(&token))?;
        Ok(Self { _ros: ros, _plain: plain, _token: token })
    }
}

fn subscribe(
    session: &Session,
    key: String,
    read: fn(&[u8]) -> Result<Pose, String>,
    take: TakePose,
) -> Result<Subscriber<()>, PublishError> {
    let name = key.clone();
    let heard = move |sample: zenoh::sample::Sample| {
        take(read(&sample.payload().to_bytes()).map_err(|why| format!("{name}: {why}")));
    };
    session.declare_subscriber(key.clone()).callback(heard).wait().map_err(refused(&key))
}

/// Reads a `geometry_msgs/PoseStamped`.
fn pose_of_message(message: &[u8]) -> Result<Pose, String> {
    let read = PoseStamped::from_cdr(message)
        .ok_or("the bytes are no geometry_msgs/PoseStamped in little-endian CDR")?;
    match read.header.frame_id {
        FRAME | "" => Ok(read.pose),
        other => Err(format!("`frame_id` is `{other}`; send poses of the tool in `{FRAME}`")),
    }
}

/// Reads a pose as the API has it.
fn pose_of_json(text: &[u8]) -> Result<Pose, String> {
    let wanted = r#"send a pose such as {"p": [0, 0, 0.01], "q": [0, 0, 0, 1]} (m; x, y, z, w)"#;
    let read: BTreeMap<String, Vec<f64>> =
        serde_json::from_slice(text).map_err(|error| format!("{error}; {wanted}"))?;
    let numbers = |key: &str| read.get(key).map_or(&[][..], Vec::as_slice);
    match (numbers("p"), numbers("q"), read.len()) {
        (&[x, y, z], &[qx, qy, qz, qw], 2) => {
            Ok(Pose::new(DQuat::from_xyzw(qx, qy, qz, qw), DVec3::new(x, y, z)))
        }
        _ => Err(wanted.to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Header, Time};

    #[test]
    fn a_pose_is_read_as_ros_and_as_the_api_write_it_and_else_refused_in_words() {
        let pose = Pose::new(DQuat::from_xyzw(0.0, 0.0, 0.6, 0.8), DVec3::new(0.01, -0.02, 0.03));
        let message = |frame_id| {
            PoseStamped { header: Header { stamp: Time { sec: 5, nanosec: 6 }, frame_id }, pose }
                .to_cdr()
        };
        assert_eq!(pose_of_message(&message("world")), Ok(pose));
        assert_eq!(pose_of_message(&message("")), Ok(pose));
        assert_eq!(pose_of_json(br#"{"q": [0, 0, 0.6, 0.8], "p": [0.01, -0.02, 0.03]}"#), Ok(pose));
        let whole = message("world");
        for (read, reported) in [
            (pose_of_message(&message("device")), "poses of the tool in `world`"),
            (pose_of_message(&whole[..whole.len() - 1]), "no geometry_msgs/PoseStamped"),
            (pose_of_message(b""), "no geometry_msgs/PoseStamped"),
            (pose_of_json(br#"{"p": [0, 0, 0.01]}"#), "send a pose such as"),
            (pose_of_json(br#"{"p": [0, 0], "q": [0, 0, 0, 1]}"#), "send a pose such as"),
            (
                pose_of_json(br#"{"p": [0, 0, 0], "q": [0, 0, 0, 1], "f": [1]}"#),
                "send a pose such as",
            ),
            (pose_of_json(b"0 0 0"), "send a pose such as"),
        ] {
            let said = read.expect_err(reported);
            assert!(said.contains(reported), "{said}");
        }
    }
}
