//! A node of ROS 2 as `rmw_zenoh` sees it: a token for itself, and for each topic a token and a
//! publisher.

use core::time::Duration;
use std::time::{Instant, SystemTime, UNIX_EPOCH};

use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::Publisher;
use zenoh::qos::CongestionControl;
use zenoh::{Session, Wait};

use super::plan::{PublishError, PublishPlan, refused};
use crate::{
    Attachment, Gid, RosNode, Topic, TopicInput, gid, node_token, publisher_token, topic_key,
};
use recording::TickRecord;

/// Name of the node.
const NAME: &str = "hapticd";
/// What changes now and then is sent at once when it does, and this often when it does not.
const OCCASION: Duration = Duration::from_millis(100);

/// The publishers of a run.
pub(super) struct RosTopics {
    arm: String,
    topics: Vec<RosTopic>,
    node: RosNode,
    /// The node is there for as long.
    _token: LivelinessToken,
}

struct RosTopic {
    topic: Topic,
    publisher: Publisher<'static>,
    gid: Gid,
    sent: i64,
    /// What was sent last, and when.
    reported: Option<(u64, Instant)>,
    /// The publisher is there for as long.
    _token: LivelinessToken,
}

impl RosTopics {
    /// Declares the node and its publishers.
    pub(super) fn open(session: &Session, plan: &PublishPlan) -> Result<Self, PublishError> {
        let PublishPlan { namespace, domain, arm, has_gripper, .. } = plan;
        let node = RosNode {
            domain: *domain,
            session: session.zid().to_string(),
            namespace: namespace.clone(),
            name: NAME,
        };
        let declare = |key: &str| {
            session.liveliness().declare_token(key.to_owned()).wait().map_err(refused(key))
        };
        let token = declare(&node_token(&node))?;
        let wanted = Topic::ALL
            .into_iter()
            .filter(|topic| *has_gripper || *topic != Topic::GripperMeasuredJs);
        let open = |(number, topic): (usize, Topic)| {
            let message_type = topic.message_type();
            let key = topic_key(&node, topic.name(), &message_type);
            let token = publisher_token(&node, number, topic.name(), &message_type);
            let publisher = session
                .declare_publisher(key.clone())
                .congestion_control(CongestionControl::Drop)
                .wait();
            let publisher = publisher.map_err(refused(&key))?;
            Ok(RosTopic {
                topic,
                publisher,
                gid: gid(&token),
                sent: 0,
                reported: None,
                _token: declare(&token)?,
            })
        };
        let topics = wanted.enumerate().map(open).collect::<Result<_, PublishError>>()?;
        Ok(Self { arm: arm.clone(), topics, node, _token: token })
    }

    /// The node, and how many endpoints it has.
    pub(super) fn node(&self) -> (&RosNode, usize) {
        (&self.node, self.topics.len())
    }

    /// Sends what is due of a record.
    pub(super) fn publish(&mut self, record: &TickRecord, now: Instant) {
        let clock = SystemTime::now();
        let moment = TopicInput { record, stamp: clock.into(), arm: &self.arm };
        let since = clock.duration_since(UNIX_EPOCH).unwrap_or_default();
        let source_timestamp_ns = since.as_nanos().try_into().unwrap_or(i64::MAX);
        for topic in self.topics.iter_mut().filter(|topic| topic.is_due(record, now)) {
            topic.send(&moment, source_timestamp_ns, now);
        }
    }
}

impl RosTopic {
    fn is_due(&self, record: &TickRecord, now: Instant) -> bool {
        let is_old = |(reported, at): (u64, Instant)| {
            reported != self.topic.news(record) || now.duration_since(at) >= OCCASION
        };
        !self.topic.is_occasional() || self.reported.is_none_or(is_old)
    }

    fn send(&mut self, moment: &TopicInput<'_>, source_timestamp_ns: i64, now: Instant) {
        let Some(message) = self.topic.message(moment) else { return };
        self.sent += 1;
        self.reported = Some((self.topic.news(moment.record), now));
        let attachment =
            Attachment { sequence_number: self.sent, source_timestamp_ns, source_gid: self.gid };
        // A closed session has no subscribers.
        let _ = self.publisher.put(message).attachment(attachment.to_bytes().as_slice()).wait();
    }
}
