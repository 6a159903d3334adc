//! A first scene for clay: how large the brush and the ball in the hand are, and where it begins.

use std::fmt::Write as _;

use glam::DVec3;

use super::{Unit, arm_scale, quoted, remarked, shown, two_digits, write_head, write_stiffness};

/// Radius of the ball in the hand, of the brush, and the air around the clay, as shares of its
/// longest edge.
const BALL_SHARE: f64 = 0.08;
const BRUSH_SHARE: f64 = 0.15;
const AIR_SHARE: f64 = 0.3;
/// Most of either, m: the bounds of a scene.
const MOST_M: f64 = 1.0;
/// Voxels of the ball along its radius.
const BALL_VOXELS: f64 = 6.0;

/// What a clay model is made of.
#[derive(Clone, Debug)]
pub struct ClayDraft {
    /// Path as the scene is to name it: relative to the scene file.
    pub file: String,
    /// Name of the scene.
    pub name: String,
    /// The file has faces.
    pub is_mesh: bool,
    /// Unit of its numbers.
    pub unit: Unit,
    /// Lowest and highest corner of the box around it, m.
    pub bounds_m: (DVec3, DVec3),
}

impl ClayDraft {
    /// The scene. `file` is what it will be called, `units` a remark on why the unit is what it is.
    pub fn text(&self, file: &str, units: &str) -> String {
        let mut text = String::new();
        // True invariant: writing to a string cannot fail.
        let _ = self.write(&mut text, file, units);
        text
    }

    fn write(&self, text: &mut String, file: &str, units: &str) -> std::fmt::Result {
        let mm = |metres: f64| shown(metres * 1e3);
        let (low, high) = self.bounds_m;
        let longest_m = (high - low).max_element();
        let share = |share: f64| two_digits((share * longest_m).min(MOST_M));
        let ball_m = share(BALL_SHARE);
        let start_m =
            DVec3::new(0.5 * (low.x + high.x), 0.5 * (low.y + high.y), high.z + 2.0 * ball_m);
        write_head(text, file, &self.name, "sculpt", "works it until Ctrl-C")?;
        writeln!(text, "# The clay.\n[sculpt]")?;
        writeln!(
            text,
            "{} = {}",
            if self.is_mesh { "mesh" } else { "points" },
            quoted(&self.file)
        )?;
        remarked(text, &format!("units = \"{}\"", self.unit.name()), units)?;
        if self.is_mesh {
            remarked(
                text,
                "# spacing_mm = 0.5",
                "between its samples; without it there are about 20,000",
            )?;
        }
        remarked(
            text,
            "tool = \"push\"",
            "or pull, pull-curve, paint, emboss, engrave, union, difference, …",
        )?;
        remarked(
            text,
            &format!("brush_mm = {}", mm(share(BRUSH_SHARE))),
            "radius within which the tool works",
        )?;
        remarked(
            text,
            &format!("air_mm = {}", mm(share(AIR_SHARE))),
            "around the clay, for what is pulled out of it",
        )?;
        remarked(
            text,
            "# strokes = \"strokes.toml\"",
            "what is done when, by itself; docs/reference/clay.md",
        )?;
        writeln!(text, "\n# The body in the hand.\n[tool]")?;
        remarked(text, &format!("shape = {{ sphere_mm = {} }}", mm(ball_m)), "radius")?;
        let voxel_m = two_digits(ball_m / BALL_VOXELS);
        remarked(text, &format!("voxel_size_mm = {}", mm(voxel_m)), "spacing of its points")?;
        let [x, y, z] = start_m.to_array().map(mm);
        remarked(text, &format!("start_position_mm = [{x}, {y}, {z}]"), "above the clay")?;
        writeln!(text, "\n[contact]")?;
        write_stiffness(text, voxel_m)?;
        writeln!(text, "\n[device]")?;
        remarked(
            text,
            "profile = \"sim-sigma7\"",
            "a simulated arm; `hapticd devices` lists those that are attached",
        )?;
        remarked(
            text,
            "# hand = \"path.csv\"",
            "where the simulated hand goes over time; without it, it stays",
        )?;
        let scale = arm_scale(0.5 * longest_m + 2.0 * ball_m);
        if scale != 1.0 {
            writeln!(text, "# The clay is larger than the space in which the arm's grip moves.")?;
        }
        remarked(
            text,
            &format!("world_from_device = {{ scale = {} }}", shown(scale)),
            "world metres per metre of the arm",
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_draft_is_a_scene() {
        for (is_mesh, size_m) in [(false, 0.1), (true, 2e-4), (true, 40.0)] {
            let folder = tempfile::tempdir().expect("a temporary folder");
            let file = if is_mesh { "ä b.obj" } else { "ä b.xyz" };
            std::fs::write(folder.path().join(file), "").expect("written");
            let draft = ClayDraft {
                file: file.to_owned(),
                name: "ä".to_owned(),
                is_mesh,
                unit: Unit::Mm,
                bounds_m: (DVec3::ZERO, DVec3::new(size_m, 0.5 * size_m, size_m)),
            };
            let path = folder.path().join("scene.toml");
            std::fs::write(&path, draft.text("scene.toml", "as the test says")).expect("written");
            let config = crate::config::load(&path)
                .unwrap_or_else(|errors| panic!("{errors}\n{}", draft.text("", "")));
            let sculpt = config.sculpt.expect("clay");
            assert!(
                sculpt.tool.brush_m > 0.0 && config.parameters.mapping.start.translation.z > size_m
            );
        }
    }
}
