//! How far the points of the tool are from the parts, for a picture of the tool in colours. Worked
//! out when a client asks.

use std::sync::Arc;

use axum::extract::State;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use glam::Vec3;

use super::app_state::AppState;
use super::hub::NewestState;
use super::problem::RequestError;
use crate::daemon::session::SceneView;
use haptics::RenderScene;
use vps::pointshell::shell::LANES;
use vps::spatial::Pose;

/// Points of an answer at most.
const MOST_POINTS: usize = 8192;
/// Version of the layout.
const VERSION: u32 = 1;
const HEAD_BYTES: usize = 32;
const POINT_BYTES: usize = 20;

pub(super) async fn clearance(
    State(state): State<Arc<AppState>>,
) -> Result<Response, RequestError> {
    let view = state.hub.session.view();
    let newest =
        state.hub.newest().clone().filter(|newest| newest.fed.record.scene_idx == view.scene_idx);
    let (Some(scene), Some(newest)) = (view.scene.clone(), newest) else {
        return Err(RequestError::unavailable(
            "no tick of this scene was rendered yet",
            "wait for the event `scene`",
        ));
    };
    if scene.obstacles.is_empty() {
        return Err(RequestError::new(StatusCode::NOT_FOUND, "this scene has no rigid parts", ""));
    }
    let poses = poses(&view, &newest);
    let spacing_m = view.config.tool.voxel_size_m as f32;
    let made = state
        .shapes
        .run(move || bytes(&scene, &poses, newest.fed.record.output.world_from_tool, spacing_m))
        .await;
    let bytes = made.ok_or_else(|| {
        RequestError::unavailable("the distances could not be worked out", "ask again")
    })?;
    Ok(([(header::CONTENT_TYPE, "application/octet-stream")], bytes).into_response())
}

/// Where the parts stand.
fn poses(view: &SceneView, newest: &NewestState) -> Vec<Pose> {
    let mut poses: Vec<_> = view.config.statics.iter().map(|object| object.pose).collect();
    for object in &*newest.objects {
        if let Some(pose) = poses.get_mut(object.idx as usize) {
            *pose = object.pose.into();
        }
    }
    poses
}

/// `HCLR`, version, how many points, their spacing, how far clearance is known; then of each
/// position (tool frame, m), normal, clearance m.
fn bytes(scene: &RenderScene, poses: &[Pose], world_from_tool: Pose, finest_m: f32) -> Vec<u8> {
    let center = scene.tool.center_of_mass_tool;
    let world_from_body = world_from_tool * Pose::from_translation(center);
    let kind = scene.parameters.contact.field;
    let places: Vec<_> = (scene.obstacles.iter().zip(poses))
        .map(|(obstacle, pose)| {
            let map_from_body = pose.inverse() * world_from_body;
            (&obstacle.field, map_from_body, map_from_body.rotation_matrix().as_mat3())
        })
        .collect();
    let known_m = scene
        .obstacles
        .iter()
        .map(|obstacle| obstacle.field.known_outside_m())
        .fold(f32::INFINITY, f32::min);
    let shell = &scene.tool.shell;
    let step = shell.len().div_ceil(MOST_POINTS).max(1);
    let n_points = shell.len().div_ceil(step);
    let spacing_m = finest_m * (step as f32).sqrt();

    let mut bytes = Vec::with_capacity(HEAD_BYTES + POINT_BYTES * n_points);
    bytes.extend(b"HCLR");
    bytes.extend(VERSION.to_le_bytes());
    bytes.extend((n_points as u32).to_le_bytes());
    bytes.extend(spacing_m.to_le_bytes());
    bytes.extend(known_m.to_le_bytes());
    bytes.resize(HEAD_BYTES, 0);
    for point in (0..shell.len()).step_by(step) {
        let block = point / LANES;
        let lane = point % LANES;
        let body = shell.positions()[block].get(lane);
        let inward = shell.normals()[block].get(lane);
        let deepest_m = places.iter().map(|(field, map_from_body, axes)| {
            let map = map_from_body.transform_point(body.as_dvec3()).as_vec3();
            field.value(kind, (map - field.origin_map()) / field.voxel_size_m(), *axes * inward)
        });
        let clearance_m = -deepest_m.fold(f32::NEG_INFINITY, f32::max);
        for coordinate in (body.as_dvec3() + center).as_vec3().to_array() {
            bytes.extend(coordinate.to_le_bytes());
        }
        let outward: Vec3 = -127.0 * inward;
        bytes.extend(outward.to_array().map(|part| (part.round() as i8).to_le_bytes()[0]));
        bytes.push(0);
        bytes.extend(clearance_m.to_le_bytes());
    }
    bytes
}
