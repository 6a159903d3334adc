//! What is asked for, and why it cannot be.

use crate::network::{Endpoints, NetworkError};
use crate::{Domain, Namespace};

/// What a run publishes: topics of ROS 2, and states for other viewers.
#[derive(Clone, Debug)]
pub struct PublishPlan {
    /// Where others are met.
    pub endpoints: Endpoints,
    /// How often the newest record is looked at, Hz.
    pub rate_hz: f64,
    /// In front of all topics.
    pub namespace: Namespace,
    /// `ROS_DOMAIN_ID`.
    pub domain: Domain,
    /// The arm, by its profile.
    pub arm: String,
    /// It senses how far its gripper is open.
    pub has_gripper: bool,
    /// It is simulated: its hand takes poses.
    pub has_hand: bool,
}

/// Why nothing can be published.
#[derive(Debug, thiserror::Error)]
pub enum PublishError {
    /// There is no session.
    #[error("{0}")]
    Network(#[from] NetworkError),
    /// The session refuses.
    #[error("the network refuses `{key}`: {cause}")]
    Refused {
        /// A key expression.
        key: String,
        /// What zenoh says.
        cause: String,
    },
}

/// What a session says about a key, as an error.
#[cfg(feature = "zenoh")]
pub(super) fn refused(key: &str) -> impl FnOnce(zenoh::Error) -> PublishError {
    let key = key.to_owned();
    move |cause| PublishError::Refused { key, cause: cause.to_string() }
}
