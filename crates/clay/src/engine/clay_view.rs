//! What clients see of the clay.

use std::sync::Arc;

use glam::DVec3;

use super::super::PointSet;
use super::super::dynamics::Material;
use super::ToolSettings;

/// The clay at one moment. Cheap to clone. During a stroke its samples may be older than the rest:
/// they are copied as often as that is cheap. Without one they are as new as the rest.
#[derive(Clone, Debug)]
pub struct ClayView {
    /// Counts up whenever `points` is another set than before; begins at 1.
    pub version: u64,
    /// The samples, those of a stroke under way among them, map frame.
    pub points: Arc<PointSet>,
    /// How far apart samples are around each of them, m: those of the last stroke that ended.
    /// Samples that a stroke under way adds have none, and come last.
    pub spacings_m: Arc<[f32]>,
    /// Mean distance of neighbouring samples, m: discs of this diameter cover the surface.
    pub spacing_m: f64,
    /// Lowest and highest corner of the region that deforms, map frame, m.
    pub region_map: (DVec3, DVec3),
    /// Mass points along x, y, z of the region.
    pub raster: [usize; 3],
    /// Curves that were drawn or are being pulled, map frame, m.
    pub curves_map: Arc<[Vec<DVec3>]>,
    /// What the tool does, and how.
    pub tool: ToolSettings,
    /// What the clay is made of where nothing was painted.
    pub material: Material,
    /// A stroke is under way.
    pub is_stroke: bool,
    /// Strokes were made, taken back or done again since a session was saved, or since the start.
    pub is_unsaved: bool,
    /// Sculpting has ended early: the clay stays as it is, and takes no orders.
    pub is_over: bool,
    /// Strokes that can be taken back.
    pub n_undo: usize,
    /// Strokes that can be done again.
    pub n_redo: usize,
    /// Updates of the material so far.
    pub updates: u64,
    /// How long the last update took, s; 0 under simulated time, which shows the same every time.
    pub update_s: f64,
    /// Updates that were left out because they would have come too late.
    pub late: u64,
    /// What went wrong last, for people; empty when nothing did since.
    pub trouble: Arc<str>,
}
