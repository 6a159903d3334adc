//! Frames of a film, and single pictures of a run: all parts from one place, which steps back when
//! something leaves its view.

use glam::DVec3;

use super::super::canvas::{Align, Canvas};
use super::super::palette::{FAINT, INK, PAPER};
use super::super::shade::FINER;
use super::super::view::Camera;
use super::sheet::draw_path;
use super::{PartsView, SceneParts, TOWARD};
use recording::TickRecord;
use vps::spatial::Pose;

/// Width and height of a frame, pixels.
pub const FRAME_SIZE: [i32; 2] = [720, 540];
/// Of it, below the view, the words.
const WORDS: i32 = 30;
/// Share of the view that everything takes up at most.
const FILLED: f64 = 0.9;
/// Room on each side of the places of the tool when the camera is set, shares of the box of
/// everything: small movements do not set it again.
const MARGIN: f64 = 0.08;
/// Frames whose path is drawn: the last ones, so that a frame costs the same at any time.
const TRAIL: usize = 250;

/// Draws one scene again and again.
pub struct FrameDrawer {
    parts: SceneParts,
    world_from_objects: Vec<Pose>,
    /// Box of the places of the tool that are in view, m.
    tool_box_world: [DVec3; 2],
    /// `None` before the first frame, and when a part has moved or the box has grown.
    view: Option<PartsView>,
    trail: Vec<(DVec3, bool)>,
}

impl FrameDrawer {
    /// For these parts.
    pub fn new(parts: SceneParts) -> Self {
        let tool_box_world = [DVec3::INFINITY, DVec3::NEG_INFINITY];
        Self {
            parts,
            world_from_objects: Vec::new(),
            tool_box_world,
            view: None,
            trail: Vec::new(),
        }
    }

    /// Draws the scene as it is in a tick; `None`: there is no memory for it, or the tool is at no
    /// place.
    pub fn frame(
        &mut self,
        record: &TickRecord,
        world_from_objects: &[Pose],
    ) -> Option<tiny_skia::Pixmap> {
        let output = &record.output;
        let world_from_tool = Some(output.world_from_tool).filter(|pose| pose.is_finite())?;
        let touches = output.contacts > 0;
        if self.trail.len() == TRAIL {
            self.trail.remove(0);
        }
        self.trail.push((world_from_tool.transform_point(self.parts.tool_middle()), touches));
        self.look_at(world_from_tool, world_from_objects);
        let size = [FRAME_SIZE[0], FRAME_SIZE[1] - WORDS];
        let fine = size.map(|edge| (edge * FINER) as usize);
        let (parts, [low, high]) = (&self.parts, self.tool_box_world);
        let view = self.view.get_or_insert_with(|| {
            let corners = (0..8).map(|corner| {
                DVec3::select(
                    glam::BVec3::new(corner & 1 > 0, corner & 2 > 0, corner & 4 > 0),
                    high,
                    low,
                )
            });
            let all = parts.static_corners(world_from_objects).into_iter().chain(corners);
            PartsView::new(parts, world_from_objects, Camera::over(TOWARD, all, fine, FILLED), fine)
        });
        let mut canvas = Canvas::new(FRAME_SIZE[0] as u32, FRAME_SIZE[1] as u32)?;
        canvas.image([0, 0], size, &view.with_tool(parts, world_from_tool));
        let places: Vec<_> =
            self.trail.iter().map(|(at, touches)| (view.place(*at), *touches)).collect();
        draw_path(&mut canvas, [0, 0], size, &places);
        canvas.scale_bar([0, 0], size, view.pixels_per_m() / f64::from(FINER));
        draw_words(&mut canvas, record);
        Some(canvas.into_pixels())
    }

    /// Sets the camera where all parts and the tool are in view.
    fn look_at(&mut self, world_from_tool: Pose, world_from_objects: &[Pose]) {
        if self.world_from_objects != world_from_objects {
            self.world_from_objects = world_from_objects.to_vec();
            self.view = None;
        }
        let (low, high) = around(
            self.parts.tool_corners(world_from_tool),
            [DVec3::INFINITY, DVec3::NEG_INFINITY],
        );
        let seen = self.tool_box_world;
        if low.cmplt(seen[0]).any() || high.cmpgt(seen[1]).any() {
            let low = low.min(seen[0]);
            let high = high.max(seen[1]);
            let (all_low, all_high) =
                around(self.parts.static_corners(world_from_objects).into_iter(), [low, high]);
            let margin = MARGIN * (all_high - all_low);
            self.tool_box_world = [low - margin, high + margin];
            self.view = None;
        }
    }
}

/// A box with these places in it, which began as this one.
fn around(places: impl Iterator<Item = DVec3>, [low, high]: [DVec3; 2]) -> (DVec3, DVec3) {
    places.fold((low, high), |(low, high), at| (low.min(at), high.max(at)))
}

/// One line below the view.
fn draw_words(canvas: &mut Canvas, record: &TickRecord) {
    let output = &record.output;
    let [width, height] = FRAME_SIZE;
    canvas.block([0, height - WORDS], [width, WORDS], PAPER);
    let base = f64::from(height) - 10.0;
    canvas.text(
        [12.0, base],
        14.0,
        Align::Left,
        INK,
        &format!("{:.3} s", record.time_ns as f64 * 1e-9),
    );
    let contact_n = output.contact_world.force.length();
    let command_n = output.command_device.force.length();
    let state = if output.faults.is_empty() {
        format!(
            "contact {contact_n:.2} N \u{b7} command {command_n:.2} N \u{b7} depth {:.3} mm",
            output.max_depth_m * 1e3
        )
    } else {
        format!("fault: {}", output.faults.names().collect::<Vec<_>>().join(", "))
    };
    canvas.text([f64::from(width) - 12.0, base], 14.0, Align::Right, FAINT, &state);
}

#[cfg(test)]
mod tests {
    use super::super::TOOL_COLOR;
    use super::*;
    use vps::mesh::primitives::Shape;

    fn drawer() -> FrameDrawer {
        let statics = vec![Shape::Box { size_m: DVec3::new(0.08, 0.08, 0.01) }.tessellate(1e-3)];
        FrameDrawer::new(SceneParts {
            statics,
            tool: Shape::Box { size_m: DVec3::splat(0.01) }.tessellate(1e-3),
        })
    }

    fn at(place_world: DVec3) -> TickRecord {
        let mut record = TickRecord::default();
        record.output.world_from_tool = Pose::from_translation(place_world);
        record
    }

    /// Pixels that are more blue than red by far: the tool, as the plate is grey and the path is
    /// thin.
    fn tool_pixels(frame: &tiny_skia::Pixmap) -> Vec<[u32; 2]> {
        let width = frame.width();
        let is_tool = |pixel: &tiny_skia::PremultipliedColorU8| {
            i32::from(pixel.blue()) - i32::from(pixel.red()) > 50
        };
        frame
            .pixels()
            .iter()
            .enumerate()
            .filter(|(_, pixel)| is_tool(pixel))
            .map(|(n, _)| [n as u32 % width, n as u32 / width])
            .collect()
    }

    #[test]
    fn the_tool_moves_through_a_view_that_stands_and_shines_through_what_is_in_front() {
        assert!(i32::from(TOOL_COLOR[2]) - i32::from(TOOL_COLOR[0]) > 50);
        let mut drawer = drawer();
        let mut middle_of = |x_m: f64, z_m: f64| {
            let frame =
                drawer.frame(&at(DVec3::new(x_m, 0.0, z_m)), &[Pose::IDENTITY]).expect("a frame");
            assert_eq!([frame.width() as i32, frame.height() as i32], FRAME_SIZE);
            let pixels = tool_pixels(&frame);
            assert!(pixels.len() > 300, "{} pixels at {x_m}, {z_m}", pixels.len());
            let mean = |side: usize| {
                pixels.iter().map(|at| f64::from(at[side])).sum::<f64>() / pixels.len() as f64
            };
            [mean(0), mean(1)]
        };
        let first = middle_of(-0.02, 0.02);
        let second = middle_of(0.02, 0.02);
        let third = middle_of(0.02, 0.01);
        assert!(
            second[0] > first[0] + 50.0 && third[1] > second[1] + 10.0,
            "{first:?} {second:?} {third:?}"
        );
    }

    #[test]
    fn the_camera_steps_back_from_what_leaves_its_view() {
        let mut drawer = drawer();
        drawer.frame(&at(DVec3::ZERO), &[Pose::IDENTITY]).expect("a frame");
        let near = drawer.view.as_ref().expect("a view").pixels_per_m();
        drawer.frame(&at(DVec3::X * 0.005), &[Pose::IDENTITY]).expect("a frame");
        assert_eq!(drawer.view.as_ref().expect("a view").pixels_per_m(), near);
        let frame = drawer.frame(&at(DVec3::X * 0.3), &[Pose::IDENTITY]).expect("a frame");
        assert!(drawer.view.as_ref().expect("a view").pixels_per_m() < 0.5 * near);
        let pixels = tool_pixels(&frame);
        assert!(!pixels.is_empty() && pixels.iter().all(|[x, _]| *x < frame.width() - 10));
        // A part that moves is drawn where it is.
        let moved = drawer
            .frame(&at(DVec3::X * 0.3), &[Pose::from_translation(DVec3::X * 0.1)])
            .expect("a frame");
        assert!(moved.data() != frame.data());
        assert!(drawer.frame(&at(DVec3::NAN), &[Pose::IDENTITY]).is_none());
    }
}
