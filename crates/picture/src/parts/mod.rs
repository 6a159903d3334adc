//! Pictures of rigid scenes: the parts where they stand, the tool among them, and its path.
//!
//! `raster` says which triangle each pixel sees, `shade` lights it as it lights clay, [`sheet()`]
//! draws a scene and its tool closely, [`FrameDrawer`] one frame of a film after the other,
//! [`write_structures`] a mesh beside what was baked of it. A tool behind a part shines through it,
//! so that a peg is seen in its hole.
//!
//! Invariants: one thread, no randomness; the same picture on every machine. Cost: O(pixels +
//! triangles · pixels of one).

mod frames;
mod raster;
mod sheet;
mod structures;

use glam::{DVec2, DVec3};

pub use self::frames::{FRAME_SIZE, FrameDrawer};
pub use self::sheet::{SceneSnapshot, sheet};
pub use self::structures::write_structures;

use super::palette::{BACKDROP, INK, Rgb, to_linear};
use super::shade::{self, FINER, halved};
use super::view::{Camera, RenderedView};
use vps::mesh::TriangleMesh;
use vps::spatial::Pose;

/// From where scenes are looked at, as clay is.
const TOWARD: DVec3 = DVec3::new(0.45, -0.75, 0.5);
/// Static parts, in turn.
const PART_COLORS: [Rgb; 5] =
    [[176, 186, 197], [205, 192, 164], [166, 190, 172], [190, 174, 198], [203, 176, 166]];
const TOOL_COLOR: Rgb = [52, 128, 160];
/// Of the tool where a part is in front of it.
const SHINES_THROUGH: f32 = 0.5;
/// The path of the tool: free, and in contact, as on the page of a report.
const PATH_FREE: Rgb = [31, 111, 235];
const PATH_TOUCHES: Rgb = [214, 96, 20];
/// Neighbours that turn away from each other by more than this (cosine), or are so many pixels
/// apart towards the viewer, have an edge between them.
const EDGE_TURN: f32 = 0.8;
const EDGE_STEP: f32 = 9.0;
/// Of the surface's light at an edge.
const EDGE_LIGHT: f32 = 0.45;

/// The meshes of a scene, each in its own frame, m.
#[derive(Debug)]
pub struct SceneParts {
    statics: Vec<TriangleMesh>,
    tool: TriangleMesh,
}

impl SceneParts {
    /// Static parts in the order in which their poses are given, and the tool.
    pub fn new(statics: Vec<TriangleMesh>, tool: TriangleMesh) -> Self {
        Self { statics, tool }
    }

    /// The middle of the tool's box, tool frame.
    fn tool_middle(&self) -> DVec3 {
        self.tool.bounds().map_or(DVec3::ZERO, |(low, high)| 0.5 * (low + high))
    }

    fn tool_corners(&self, world_from_tool: Pose) -> impl Iterator<Item = DVec3> + use<> {
        corners(&self.tool, world_from_tool)
    }

    /// Corners of the boxes of all static parts, world.
    fn static_corners(&self, world_from_objects: &[Pose]) -> Vec<DVec3> {
        self.statics
            .iter()
            .zip(world_from_objects)
            .flat_map(|(mesh, pose)| corners(mesh, *pose))
            .collect()
    }
}

fn corners(mesh: &TriangleMesh, world_from_mesh: Pose) -> impl Iterator<Item = DVec3> + use<> {
    let [low, high] = mesh.bounds().map_or([DVec3::ZERO; 2], |(low, high)| [low, high]);
    let n_corners = if mesh.triangles.is_empty() { 0 } else { 8 };
    (0..n_corners).map(move |corner| {
        let is_high = |axis: u32| f64::from(corner >> axis & 1);
        let share = DVec3::new(is_high(0), is_high(1), is_high(2));
        world_from_mesh.transform_point(low + share * (high - low))
    })
}

/// Static parts as one camera sees them: drawn once, and again only when one moves.
struct PartsView {
    camera: Camera,
    statics: RenderedView,
    /// Without the tool.
    picture: Vec<Rgb>,
}

impl PartsView {
    /// `size`: of the view, [`FINER`] times that of the picture.
    fn new(
        parts: &SceneParts,
        world_from_objects: &[Pose],
        camera: Camera,
        size: [usize; 2],
    ) -> Self {
        let mut statics = RenderedView::empty(size);
        for (n, (mesh, pose)) in parts.statics.iter().zip(world_from_objects).enumerate() {
            raster::put(&mut statics, &camera, mesh, *pose, PART_COLORS[n % PART_COLORS.len()]);
        }
        let picture = halved(&outlined(&statics, shade::lit(&statics, BACKDROP)), size[0]);
        Self { camera, statics, picture }
    }

    /// The picture with the tool in its place, row by row. Only what the tool can change is drawn
    /// anew.
    fn with_tool(&self, parts: &SceneParts, world_from_tool: Pose) -> Vec<Rgb> {
        let mut picture = self.picture.clone();
        let size = self.statics.size();
        let pixels = parts.tool_corners(world_from_tool).map(|corner| self.camera.place(corner).0);
        let (low, high) = pixels.fold((DVec2::INFINITY, DVec2::NEG_INFINITY), |(low, high), at| {
            (low.min(at), high.max(at))
        });
        let Some((from, to)) = grown([low, high], shade::REACH, size) else { return picture };
        // What is around it darkens hollows at its rim.
        let Some((wide_from, wide_to)) = grown([low, high], 2 * shade::REACH, size) else {
            return picture;
        };
        let wide = [wide_to[0] - wide_from[0], wide_to[1] - wide_from[1]];
        let light = self.light_with_tool(parts, world_from_tool, wide_from, wide);
        let finer = FINER as usize;
        for (row, pixels) in halved(&light, wide[0]).chunks_exact(wide[0] / finer).enumerate() {
            let y = wide_from[1] / finer + row;
            if (from[1] / finer..to[1] / finer).contains(&y) {
                let columns = |edge: [usize; 2], start: usize| edge.map(|x| x / finer - start);
                let source = columns([from[0], to[0]], wide_from[0] / finer);
                let target = columns([from[0], to[0]], 0).map(|x| y * (size[0] / finer) + x);
                picture[target[0]..target[1]].copy_from_slice(&pixels[source[0]..source[1]]);
            }
        }
        picture
    }

    /// Linear light of the pixels of a part of the view.
    fn light_with_tool(
        &self,
        parts: &SceneParts,
        world_from_tool: Pose,
        from: [usize; 2],
        size: [usize; 2],
    ) -> Vec<[f32; 3]> {
        let mut tool = RenderedView::empty(size);
        raster::put(
            &mut tool,
            &self.camera.beginning_at(from),
            &parts.tool,
            world_from_tool,
            TOOL_COLOR,
        );
        let mut front = self.statics.part(from, size);
        for (pixel, tool) in front.pixels.iter_mut().zip(&tool.pixels) {
            if tool.height > pixel.height {
                *pixel = *tool;
            }
        }
        let mut light = outlined(&front, shade::lit(&front, BACKDROP));
        let tool_light = outlined(&tool, shade::lit(&tool, BACKDROP));
        for (n, tool) in tool.pixels.iter().enumerate() {
            if tool.height > f32::NEG_INFINITY && tool.height < front.pixels[n].height {
                let mixed = |channel: usize| {
                    light[n][channel]
                        + SHINES_THROUGH * (tool_light[n][channel] - light[n][channel])
                };
                light[n] = [0, 1, 2].map(mixed);
            }
        }
        light
    }

    fn pixels_per_m(&self) -> f64 {
        self.camera.pixels_per_m()
    }

    /// Where a place is on the picture, and whether a static part is in front of it.
    fn place(&self, at_world: DVec3) -> ([f64; 2], bool) {
        let (pixel, height_m) = self.camera.place(at_world);
        let [width, _] = self.statics.size();
        let is_inside = pixel.x >= 0.0 && pixel.y >= 0.0 && pixel.x < width as f64;
        let in_front = self
            .statics
            .pixels
            .get(pixel.y.max(0.0) as usize * width + pixel.x.max(0.0) as usize)
            .filter(|_| is_inside);
        let is_hidden = in_front.is_some_and(|other| {
            f64::from(other.height) > height_m * self.camera.pixels_per_m() + 1.0
        });
        (pixel.to_array().map(|edge| edge / f64::from(FINER)), is_hidden)
    }
}

/// Pixels around a box, with a margin on each side, within a view: from and to, in whole pixels of
/// the picture. `None`: it is not in view.
fn grown(
    [low, high]: [DVec2; 2],
    margin: usize,
    size: [usize; 2],
) -> Option<([usize; 2], [usize; 2])> {
    let finer = FINER as usize;
    let whole =
        |pixel: f64, side: usize| pixel.clamp(0.0, size[side] as f64) as usize / finer * finer;
    let low = low.to_array();
    let high = high.to_array();
    let from = [0, 1].map(|side| whole(low[side] - margin as f64, side));
    let to = [0, 1].map(|side| whole(high[side] + (margin + finer) as f64, side));
    (from[0] < to[0] && from[1] < to[1]).then_some((from, to))
}

/// Draws the edges of what is seen: where neighbours to the right or below turn away, or are far
/// behind.
fn outlined(view: &RenderedView, mut light: Vec<[f32; 3]>) -> Vec<[f32; 3]> {
    let [width, _] = view.size();
    let ink = INK.map(to_linear);
    for n in 0..view.pixels.len() {
        let own = &view.pixels[n];
        let is_last_in_row = n % width + 1 == width;
        for beside in
            [Some(n + 1).filter(|_| !is_last_in_row), Some(n + width)].into_iter().flatten()
        {
            let Some(other) = view.pixels.get(beside) else { continue };
            let nearest = if own.height >= other.height { n } else { beside };
            let seen = &view.pixels[nearest];
            if seen.height == f32::NEG_INFINITY {
                continue;
            }
            let is_edge = (own.height - other.height).abs() > EDGE_STEP / seen.normal.z.max(0.1)
                || own.normal.dot(other.normal) < EDGE_TURN;
            if is_edge {
                let mixed = |channel: usize| {
                    EDGE_LIGHT * light[nearest][channel] + (1.0 - EDGE_LIGHT) * ink[channel]
                };
                light[nearest] = [0, 1, 2].map(mixed);
            }
        }
    }
    light
}

#[cfg(test)]
mod tests {
    use super::*;
    use vps::mesh::primitives::Shape;

    #[test]
    fn what_is_drawn_anew_is_all_that_the_tool_changes() {
        let block = |size_m: DVec3| Shape::Box { size_m }.tessellate(1e-3);
        let parts = SceneParts {
            statics: vec![block(DVec3::new(0.05, 0.05, 0.01))],
            tool: block(DVec3::splat(0.008)),
        };
        let size = [240, 160];
        let camera = Camera::over(TOWARD, corners(&parts.statics[0], Pose::IDENTITY), size, 0.9);
        let view = PartsView::new(&parts, &[Pose::IDENTITY], camera, size);
        // On the plate, half in it, behind it, at the rim of the view, and out of it.
        for (at, is_seen) in [
            (DVec3::new(0.0, 0.0, 0.01), true),
            (DVec3::new(0.01, -0.005, 0.005), true),
            (DVec3::new(0.0, 0.0, -0.01), true),
            (DVec3::new(0.03, -0.02, 0.0), true),
            (DVec3::new(1.0, 0.0, 0.0), false),
        ] {
            let pose = Pose::from_translation(at);
            let all = halved(&view.light_with_tool(&parts, pose, [0, 0], size), size[0]);
            let picture = view.with_tool(&parts, pose);
            assert!(
                picture == all,
                "{at}: {} pixels differ",
                picture.iter().zip(&all).filter(|(a, b)| a != b).count()
            );
            assert_eq!(picture != view.picture, is_seen, "{at}");
        }
    }
}
