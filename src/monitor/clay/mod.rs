//! Clay, for clients: what it is like, its samples, the tool that works it, and files of it.
//!
//! ```text
//!  clients ──clay_take, clay_hold, clay_undo, …──► here ──SculptOrder──► clay thread ──answer──► clients
//!  clients ◄──facts, samples────────────────────── here ◄──View── clay thread
//! ```
//! Invariant: a hold lasts no longer than the client that asked for it gives signs of life, and no
//! longer than force flows.

mod files;
mod hold_watchdog;
mod requests;
mod select_tool;
mod shaping;
mod splats;
mod uploads;

use core::time::Duration;
use std::collections::HashSet;
use std::path::PathBuf;
use std::sync::{Arc, Mutex};

use axum::http::StatusCode;
use glam::DVec3;
use serde_json::{Value, json};

pub use files::plain_name;
pub(super) use files::{SaveKind, save};
pub(super) use hold_watchdog::HoldWatchdog;
pub(super) use requests::{hold, order, step, take};
pub(super) use select_tool::TakeAsked;
pub(super) use shaping::{CombineAsked, DrawAsked, LayAsked, PullAsked, RegionAsked};
pub(super) use splats::Splats;
pub(super) use uploads::{
    IMAGE_BYTES_MAX, SOLID_BYTES_MAX, SolidAsked, VALUES_BYTES_MAX, ValuesAsked, image_of,
    solid_of, values_of,
};

use super::encode::WirePose;
use super::problem::RequestError;
use crate::daemon::sculpting::{ClayHandle, Reply};
use clay::engine::{ClayView, SculptOrder, SculptTool};
use clay::material_map::Painted;
use vps::spatial::Pose;

/// How often, and how many times, a request looks for a view that is made because of it.
const BETWEEN_LOOKS: Duration = Duration::from_millis(20);
const LOOKS: u32 = 15;

/// The way to the clay.
pub trait ClayAccess: Send + Sync {
    /// The newest view; `None` before the first. Never waits for the material.
    fn view(&self) -> Option<Arc<ClayView>>;

    /// Asks for something; the answer comes from another thread, or at once. Never waits.
    fn ask(&self, order: SculptOrder, reply: Reply);

    /// Cancels what is carried out and what waits.
    fn cancel(&self);
}

impl ClayAccess for ClayHandle {
    fn view(&self) -> Option<Arc<ClayView>> {
        self.view()
    }

    fn ask(&self, order: SculptOrder, reply: Reply) {
        self.ask(order, reply);
    }

    fn cancel(&self) {
        self.cancel();
    }
}

/// The clay of a run, for [`Hub::sculpts`](super::Hub::sculpts).
pub struct ClayParts {
    /// The way to it.
    pub access: Box<dyn ClayAccess>,
    /// Where it stands.
    pub world_from_map: Pose,
    /// What the tool does at the start.
    pub kind: SculptTool,
    /// Where clients may save; `None`: nowhere.
    pub folder: Option<PathBuf>,
    /// The session that is written when the run ends, if one is.
    pub session_at_end: Option<PathBuf>,
}

/// What the clients of a run share of its clay.
pub(super) struct ClayService {
    access: Box<dyn ClayAccess>,
    world_from_map: Pose,
    folder: Option<PathBuf>,
    session_at_end: Option<PathBuf>,
    /// Files that are being written.
    saving: Mutex<HashSet<PathBuf>>,
    /// Files that were written for clients.
    saved: Mutex<Vec<PathBuf>>,
    /// What clients know of the last view.
    last_view: Mutex<LastView>,
    pub(super) splats: Splats,
}

struct LastView {
    kind: SculptTool,
    trouble: Option<Arc<str>>,
}

impl ClayService {
    pub(super) fn new(parts: ClayParts) -> Self {
        let ClayParts { access, world_from_map, kind, folder, session_at_end } = parts;
        let last_view = LastView { kind, trouble: None };
        Self {
            access,
            world_from_map,
            folder,
            session_at_end,
            saving: Mutex::default(),
            saved: Mutex::default(),
            last_view: Mutex::new(last_view),
            splats: Splats::default(),
        }
    }

    /// A view of now. Views are made while clients look, so the first may be old where none has
    /// looked for a while.
    pub(super) async fn fresh_view(&self, is_watched: bool) -> Result<Arc<ClayView>, RequestError> {
        let mut view = self.view()?;
        if is_watched {
            return Ok(view);
        }
        let old = view.clone();
        for _ in 0..LOOKS {
            tokio::time::sleep(BETWEEN_LOOKS).await;
            view = self.view()?;
            if !Arc::ptr_eq(&view, &old) {
                break;
            }
        }
        Ok(view)
    }

    /// The newest view.
    pub(super) fn view(&self) -> Result<Arc<ClayView>, RequestError> {
        self.access.view().ok_or_else(|| {
            RequestError::unavailable("the clay is not ready yet", "ask again in a moment")
        })
    }

    /// `/api/v1/clay`.
    pub(super) fn facts(&self, view: &ClayView, is_held: bool) -> Value {
        let tool = &view.tool;
        let (low, high) = view.region_map;
        let (least_m, most_m) = select_tool::brush_range(view);
        json!({
            "version": view.version,
            "samples": view.points.len(),
            "spacing_m": view.spacing_m,
            "world_from_map": WirePose::from(self.world_from_map),
            "region_map": { "min": low.to_array(), "max": high.to_array() },
            "raster": view.raster,
            "curves_map": view.curves_map.iter().map(|curve| curve.iter().map(DVec3::to_array).collect()).collect::<Vec<Vec<_>>>(),
            "craft": tool.kind.name(),
            "crafts": SculptTool::NAMES.map(|(name, _)| name),
            "brush_m": tool.brush_m,
            "brush_range_m": [least_m, most_m],
            "falloff": tool.falloff.to_string(),
            "color": select_tool::color_text(tool.color),
            "painted": properties(tool.painted),
            "paints": properties(tool.painted.or_harder(&view.material)),
            "material": properties(Painted {
                mass_kg: Some(view.material.mass_kg),
                damping_n_s_per_m: Some(view.material.damping_n_s_per_m),
                stiffness_n_per_m: Some(view.material.stiffness_n_per_m),
            }),
            "has_image": tool.image.is_some(),
            "solid": tool.solid.as_ref().map(|solid| &*solid.name),
            "depth_m": tool.depth_m,
            "is_sharp": tool.is_sharp,
            "is_held": is_held,
            "is_stroke": view.is_stroke,
            "is_unsaved": view.is_unsaved,
            "session_at_end": self.session_at_end.as_ref().map(|file| file.to_string_lossy()),
            "is_over": view.is_over,
            "undo": view.n_undo,
            "redo": view.n_redo,
            "updates": view.updates,
            "update_s": view.update_s,
            "late": view.late,
            "trouble": &*view.trouble,
        })
    }
}

/// What a mass point is made of; null is not said.
fn properties(Painted { mass_kg, damping_n_s_per_m, stiffness_n_per_m }: Painted) -> Value {
    // As a person would write it: 0.0001, not the double nearest to the float nearest to it.
    let number = |value: Option<f32>| value.and_then(|value| value.to_string().parse::<f64>().ok());
    json!({
        "mass_kg": number(mass_kg),
        "damping_n_s_per_m": number(damping_n_s_per_m),
        "stiffness_n_per_m": number(stiffness_n_per_m),
    })
}

/// There is none.
pub(super) fn no_clay() -> RequestError {
    RequestError::new(
        StatusCode::NOT_FOUND,
        "this scene has no clay",
        "`hapticd sculpt SCENE` renders one that has a [sculpt] table",
    )
}

#[cfg(test)]
mod tests;
