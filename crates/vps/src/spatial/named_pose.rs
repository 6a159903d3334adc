//! A pose as results have it.

use super::Pose;

/// A pose with a name for each component; the frames are named where it is declared.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[expect(missing_docs, reason = "the names are the unit and the component")]
pub struct NamedPose {
    pub x_m: f64,
    pub y_m: f64,
    pub z_m: f64,
    pub qx: f64,
    pub qy: f64,
    pub qz: f64,
    pub qw: f64,
}

impl From<Pose> for NamedPose {
    fn from(pose: Pose) -> Self {
        let ([x_m, y_m, z_m], [qx, qy, qz, qw]) =
            (pose.translation.to_array(), pose.rotation.to_array());
        Self { x_m, y_m, z_m, qx, qy, qz, qw }
    }
}
