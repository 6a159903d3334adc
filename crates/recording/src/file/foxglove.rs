//! Foxglove's own messages, as far as they are filled here, and their schemas.

use super::wire::{Pose, Quaternion, Timestamp, Vector3};

/// `FileDescriptorSet` of `foxglove.FrameTransform`.
pub(super) const FRAME_TRANSFORM: &[u8] = include_bytes!("foxglove/FrameTransform.bin");
/// The same of `foxglove.Log`.
pub(super) const LOG: &[u8] = include_bytes!("foxglove/Log.bin");
/// The same of `foxglove.PoseInFrame`, with the vectors and poses that messages of ours name.
pub(super) const POSE_IN_FRAME: &[u8] = include_bytes!("foxglove/PoseInFrame.bin");
/// The same of `foxglove.SceneUpdate`.
pub(super) const SCENE_UPDATE: &[u8] = include_bytes!("foxglove/SceneUpdate.bin");

/// `foxglove.Log.Level`.
pub(super) const LEVEL_INFO: i32 = 2;
/// `foxglove.Log.Level`.
pub(super) const LEVEL_ERROR: i32 = 4;
/// `foxglove.SceneEntityDeletion.Type`: all entities.
pub(super) const DELETE_ALL: i32 = 1;

macro_rules! messages {
    ($($message:ident {
        $($label:ident $kind:ident $field:ident: $type:ty = $number:literal,)+
    })+) => {$(
        #[derive(Clone, PartialEq, prost::Message)]
        pub(super) struct $message {
            $(#[prost($kind, $label, tag = $number)] pub(super) $field: $type,)+
        }
    )+};
}

messages! {
    Color {
        required double r: f64 = 1,
        required double g: f64 = 2,
        required double b: f64 = 3,
        required double a: f64 = 4,
    }
    KeyValuePair {
        required string key: String = 1,
        required string value: String = 2,
    }
    CubePrimitive {
        required message pose: Pose = 1,
        required message size: Vector3 = 2,
        required message color: Color = 3,
    }
    SpherePrimitive {
        required message pose: Pose = 1,
        required message size: Vector3 = 2,
        required message color: Color = 3,
    }
    CylinderPrimitive {
        required message pose: Pose = 1,
        required message size: Vector3 = 2,
        required double bottom_scale: f64 = 3,
        required double top_scale: f64 = 4,
        required message color: Color = 5,
    }
    ModelPrimitive {
        required message pose: Pose = 1,
        required message scale: Vector3 = 2,
        required message color: Color = 3,
        required bool override_color: bool = 4,
        required string media_type: String = 6,
        required bytes data: Vec<u8> = 7,
    }
    SceneEntity {
        required message timestamp: Timestamp = 1,
        required string frame_id: String = 2,
        required string id: String = 3,
        required bool frame_locked: bool = 5,
        repeated message metadata: Vec<KeyValuePair> = 6,
        repeated message cubes: Vec<CubePrimitive> = 8,
        repeated message spheres: Vec<SpherePrimitive> = 9,
        repeated message cylinders: Vec<CylinderPrimitive> = 10,
        repeated message models: Vec<ModelPrimitive> = 14,
    }
    SceneEntityDeletion {
        required message timestamp: Timestamp = 1,
        required int32 kind: i32 = 2,
    }
    SceneUpdate {
        repeated message deletions: Vec<SceneEntityDeletion> = 1,
        repeated message entities: Vec<SceneEntity> = 2,
    }
    Log {
        required message timestamp: Timestamp = 1,
        required int32 level: i32 = 2,
        required string message: String = 3,
        required string name: String = 4,
    }
    FrameTransform {
        required message timestamp: Timestamp = 1,
        required string parent_frame_id: String = 2,
        required string child_frame_id: String = 3,
        required message translation: Vector3 = 4,
        required message rotation: Quaternion = 5,
    }
}
