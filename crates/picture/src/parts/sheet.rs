//! A scene at one moment: all of it, and its tool closely.

use std::io;

use super::super::canvas::{Align, Canvas};
use super::super::palette::{FAINT, Rgb};
use super::super::shade::FINER;
use super::super::view::Camera;
use super::{PATH_FREE, PATH_TOUCHES, PartsView, SceneParts, TOWARD};
use recording::report::PathPose;
use vps::spatial::Pose;

/// The views, and what is between them, pixels.
const HEIGHT: i32 = 460;
const WIDTHS: [i32; 2] = [660, 428];
const GAP: i32 = 12;
/// Shares of the views that the scene, and the tool, take up at most.
const FILLED: [f64; 2] = [0.88, 0.62];

/// A scene at one moment.
#[derive(Clone, Copy, Debug)]
pub struct SceneSnapshot<'a> {
    /// Its meshes.
    pub parts: &'a SceneParts,
    /// Where the static parts stand, in their order.
    pub world_from_objects: &'a [Pose],
    /// Where the tool is.
    pub world_from_tool: Pose,
    /// Its path.
    pub path: &'a [PathPose],
}

/// Draws all parts with the path of the tool's middle, and beside it the tool closely, 1100 pixels
/// wide; a PNG file.
///
/// # Errors
/// There is no memory for its pixels.
pub fn sheet(snapshot: &SceneSnapshot<'_>) -> io::Result<Vec<u8>> {
    let SceneSnapshot { parts, world_from_objects, world_from_tool, path } = *snapshot;
    let no_memory = || io::Error::other("no memory for a sheet of pixels");
    let mut canvas =
        Canvas::new((WIDTHS[0] + GAP + WIDTHS[1]) as u32, HEIGHT as u32).ok_or_else(no_memory)?;
    let middle = parts.tool_middle();
    let middles: Vec<_> = path
        .iter()
        .map(|pose| (pose.world_from_tool.transform_point(middle), pose.touches))
        .collect();
    let tool = || parts.tool_corners(world_from_tool);
    let all = parts
        .static_corners(world_from_objects)
        .into_iter()
        .chain(tool())
        .chain(middles.iter().map(|(at, _)| *at));
    let sizes = WIDTHS.map(|width| [width, HEIGHT]);
    let fine = sizes.map(|size| size.map(|edge| (edge * FINER) as usize));
    let cameras = [
        Camera::over(TOWARD, all, fine[0], FILLED[0]),
        Camera::over(TOWARD, tool(), fine[1], FILLED[1]),
    ];
    let mut left = 0;
    for (n, word) in ["", "the tool, closely"].into_iter().enumerate() {
        let view = PartsView::new(parts, world_from_objects, cameras[n], fine[n]);
        let corner = [left, 0];
        canvas.image(corner, sizes[n], &view.with_tool(parts, world_from_tool));
        let places: Vec<_> =
            middles.iter().map(|(at, touches)| (view.place(*at), *touches)).collect();
        draw_path(&mut canvas, corner, sizes[n], &places);
        canvas.scale_bar(corner, sizes[n], cameras[n].pixels_per_m() / f64::from(FINER));
        canvas.text([f64::from(left + sizes[n][0]) - 10.0, 20.0], 13.0, Align::Right, FAINT, word);
        left += sizes[n][0] + GAP;
    }
    canvas.png()
}

/// Lines from pose to pose; pale where a part is in front of them, left out beyond the view.
pub(super) fn draw_path(
    canvas: &mut Canvas,
    corner: [i32; 2],
    size: [i32; 2],
    places: &[(([f64; 2], bool), bool)],
) {
    let is_inside = |at: [f64; 2]| {
        (0..2).all(|side| at[side] >= 1.0 && at[side] <= f64::from(size[side]) - 1.0)
    };
    let on_sheet = |at: [f64; 2]| [0, 1].map(|side| at[side] + f64::from(corner[side]));
    let mut last: Option<[f64; 2]> = None;
    for ((at, is_hidden), touches) in places.iter().copied() {
        let Some(from) = last.replace(at) else { continue };
        if from[0].hypot(from[1]).is_finite() && is_inside(from) && is_inside(at) {
            let color = if touches { PATH_TOUCHES } else { PATH_FREE };
            canvas.line(
                on_sheet(from),
                on_sheet(at),
                1.8,
                if is_hidden { paled(color) } else { color },
            );
        }
    }
}

fn paled(color: Rgb) -> Rgb {
    color.map(|channel| ((u16::from(channel) + 2 * 235) / 3) as u8)
}
