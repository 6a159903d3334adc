//! Where `rmw_zenoh` looks: the key expression of a topic, the liveliness tokens of its publishers,
//! and what goes with each message.
//!
//! # Source
//! The design document of `rmw_zenoh` (`docs/design.md` of `ros2/rmw_zenoh`), and what its
//! `liveliness_utils.cpp` and `qos.cpp` do beyond it. The words of both are quoted in
//! docs/reference/ros2.md.

use core::fmt::{Display, Formatter};
use core::str::FromStr;

use twox_hash::XxHash3_128;

use super::messages::MessageType;

/// Hermetic part of the key space in which nodes and publishers stand.
const TOKENS: &str = "@ros2_lv";
/// Quality of service of every publisher: reliable, volatile, the last 10, everything else as it
/// comes. Only what differs from the defaults of `rmw_zenoh` is written, and of those only the
/// depth (42) does.
const QUALITY: &str = "::,10:,:,:,,";
/// Longest namespace, bytes: with a topic behind it a name still fits into one of ROS 2.
const LONGEST_NAMESPACE: usize = 200;

/// What keeps the systems of a network apart: `ROS_DOMAIN_ID`.
pub type Domain = u32;

/// What distinguishes publishers.
pub type Gid = [u8; 16];

/// A namespace such as `left/arm`, without a slash at either end.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Namespace(String);

/// Why a text is no namespace.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "`{text}` is no namespace of ROS 2: {why}; expected words of letters, digits and _ with / \
        between, such as left/arm"
)]
pub struct NamespaceError {
    text: String,
    why: &'static str,
}

impl FromStr for Namespace {
    type Err = NamespaceError;

    /// With or without a slash in front.
    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let words = text.strip_prefix('/').unwrap_or(text);
        let is_letter = |c: char| c.is_ascii_alphanumeric() || c == '_';
        let why = if words.len() > LONGEST_NAMESPACE {
            "it is longer than 200 bytes"
        } else if words.split('/').any(str::is_empty) {
            "a word is empty"
        } else if words.split('/').any(|word| word.starts_with(|c: char| c.is_ascii_digit())) {
            "a word begins with a digit"
        } else if !words.split('/').all(|word| word.chars().all(is_letter)) {
            "a word has another character"
        } else {
            return Ok(Self(words.to_owned()));
        };
        Err(NamespaceError { text: text.to_owned(), why })
    }
}

impl Display for Namespace {
    fn fmt(&self, f: &mut Formatter<'_>) -> core::fmt::Result {
        f.write_str(&self.0)
    }
}

/// A node of the graph of ROS 2, of which a session has one.
#[derive(Clone, Debug)]
pub struct RosNode {
    /// `ROS_DOMAIN_ID`.
    pub domain: Domain,
    /// The session, as it writes its own number.
    pub session: String,
    /// In front of its topics.
    pub namespace: Namespace,
    /// Its name.
    pub name: &'static str,
}

/// Number of the only node of a session; its publishers come behind it.
const NODE_ID: usize = 0;

impl RosNode {
    /// What all its tokens have in front.
    fn prefix(&self, entity_id: usize, kind: &str) -> String {
        let Self { domain, session, namespace, name } = self;
        // The second `%` is an enclave that is not set.
        format!(
            "{TOKENS}/{domain}/{session}/{NODE_ID}/{entity_id}/{kind}/%/%{}/{name}",
            mangled(&namespace.0)
        )
    }
}

/// The key expression on which messages of a topic travel; `topic` without the namespace.
pub fn topic_key(node: &RosNode, topic: &str, message_type: &MessageType) -> String {
    format!(
        "{}/{}/{topic}/{}/{}",
        node.domain,
        node.namespace,
        message_type.dds_name(),
        message_type.hash
    )
}

/// The token that says that a node is there.
pub fn node_token(node: &RosNode) -> String {
    node.prefix(NODE_ID, "NN")
}

/// The token that says that a node publishes on a topic. `number` counts its publishers and
/// subscribers from 0.
pub fn publisher_token(
    node: &RosNode,
    number: usize,
    topic: &str,
    message_type: &MessageType,
) -> String {
    endpoint_token(node, number, "MP", topic, message_type)
}

/// The token that says that a node listens to a topic; `number` as in [`publisher_token`].
pub fn subscriber_token(
    node: &RosNode,
    number: usize,
    topic: &str,
    message_type: &MessageType,
) -> String {
    endpoint_token(node, number, "MS", topic, message_type)
}

fn endpoint_token(
    node: &RosNode,
    number: usize,
    kind: &str,
    topic: &str,
    message_type: &MessageType,
) -> String {
    let before = node.prefix(NODE_ID + 1 + number, kind);
    let name = mangled(&format!("{}/{topic}", node.namespace));
    format!("{before}/%{name}/{}/{}/{QUALITY}", message_type.dds_name(), message_type.hash)
}

/// A name as one piece of a key expression.
fn mangled(name: &str) -> String {
    name.replace('/', "%")
}

/// The number by which ROS 2 knows a publisher: a hash of its token, XXH3 of 128 bits, the low half
/// first.
pub fn gid(token: &str) -> Gid {
    XxHash3_128::oneshot(token.as_bytes()).to_le_bytes()
}

/// What goes with every message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Attachment {
    /// Counts the messages of a publisher from 1.
    pub sequence_number: i64,
    /// When it left, ns since 1970.
    pub source_timestamp_ns: i64,
    /// The publisher that sent it.
    pub source_gid: Gid,
}

impl Attachment {
    /// 33 bytes: both numbers little-endian, the length of the gid, and the gid.
    pub fn to_bytes(&self) -> [u8; 33] {
        let mut bytes = [0; 33];
        bytes[..8].copy_from_slice(&self.sequence_number.to_le_bytes());
        bytes[8..16].copy_from_slice(&self.source_timestamp_ns.to_le_bytes());
        bytes[16] = self.source_gid.len() as u8;
        bytes[17..].copy_from_slice(&self.source_gid);
        bytes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STRING: MessageType = MessageType {
        package: "std_msgs",
        name: "String",
        hash: "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18",
    };

    fn node(domain: Domain, session: &str, namespace: &str) -> RosNode {
        RosNode {
            domain,
            session: session.to_owned(),
            namespace: namespace.parse().expect("a namespace"),
            name: "talker",
        }
    }

    #[test]
    fn keys_and_tokens_have_the_form_of_the_examples_of_the_design_document() {
        // It has `chatter` without a namespace and with `/robot1`.
        let robot = node(0, "8b20917502ee955ac4476e0266340d5c", "/robot1");
        assert_eq!(
            topic_key(&robot, "chatter", &STRING),
            "0/robot1/chatter/std_msgs::msg::dds_::String_/RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
        );
        let robot = node(2, "8b20917502ee955ac4476e0266340d5c", "robot1");
        assert_eq!(
            node_token(&robot),
            "@ros2_lv/2/8b20917502ee955ac4476e0266340d5c/0/0/NN/%/%robot1/talker"
        );
        // Beside the namespace and the depth it is the publisher of the document.
        let expected = "@ros2_lv/2/8b20917502ee955ac4476e0266340d5c/0/10/MP/%/%robot1/talker/%robot1%chatter/std_msgs::msg::dds_::String_/\
                        RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18/::,10:,:,:,,";
        assert_eq!(publisher_token(&robot, 9, "chatter", &STRING), expected);
        assert_eq!(
            subscriber_token(&robot, 9, "chatter", &STRING),
            expected.replace("/MP/", "/MS/")
        );
        let nested = node(0, "a", "left/arm");
        assert!(
            publisher_token(&nested, 0, "tool/contact_cf", &STRING)
                .contains("/0/1/MP/%/%left%arm/talker/%left%arm%tool%contact_cf/")
        );
        assert!(
            topic_key(&nested, "tool/contact_cf", &STRING)
                .starts_with("0/left/arm/tool/contact_cf/std_msgs::msg::dds_::String_/")
        );
    }

    #[test]
    fn a_gid_is_the_one_that_rmw_zenoh_makes_of_the_token() {
        // Captured from its own hash by others (docs/reference/ros2.md).
        let hash = STRING.hash;
        for (token, expected) in [
            (
                format!("@ros2_lv/0/1/0/0/MP/%/%/a/%b/a::msg::dds_::B_/{hash}/::,:,:,:,,"),
                "d6944d1f878b2ccca940730c04a67353",
            ),
            (
                format!(
                    "@ros2_lv/23/aac3178e146ba6f1fc6e6a4085e77f21/0/1/MP/%/%raft_test/raft_fixture/%raft_test%chatter/std_msgs::msg::dds_::String_/{hash}/2::,5:,:,:,,"
                ),
                "e4f56c26790a63265397a613657e3aab",
            ),
        ] {
            let hex: String = gid(&token).iter().map(|byte| format!("{byte:02x}")).collect();
            assert_eq!(hex, expected, "{token}");
        }
    }

    #[test]
    fn an_attachment_is_33_bytes_without_padding() {
        let source_gid = core::array::from_fn(|n| n as u8 * 0x11);
        let attachment = Attachment {
            sequence_number: 0x0102_0304_0506_0708,
            source_timestamp_ns: 0x1112_1314_1516_1718,
            source_gid,
        };
        let hex: String = attachment.to_bytes().iter().map(|byte| format!("{byte:02x}")).collect();
        assert_eq!(hex, "080706050403020118171615141312111000112233445566778899aabbccddeeff");
    }

    #[test]
    fn only_names_of_ros_are_namespaces() {
        for text in ["hapticd", "/left/arm", "_a/b2", "A_b"] {
            let namespace: Namespace = text.parse().expect(text);
            assert_eq!(namespace.to_string(), text.trim_start_matches('/'));
        }
        let long = "a".repeat(201);
        for (text, why) in [
            ("", "empty"),
            ("/", "empty"),
            ("a//b", "empty"),
            ("a/", "empty"),
            ("2d", "digit"),
            ("a/2d", "digit"),
            ("scene.toml", "another character"),
            ("a b", "another character"),
            ("a/*", "another character"),
            ("größe", "another character"),
            (&long, "200 bytes"),
        ] {
            let reported = text.parse::<Namespace>().expect_err(text).to_string();
            assert!(reported.contains(why) && reported.contains("left/arm"), "{text}: {reported}");
        }
    }
}
