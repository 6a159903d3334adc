//! A first scene for a folder of meshes: which part moves, what the numbers mean, how fine, and
//! where to begin.
//!
//! Data in: meshes as their files have them. Data out: the text of a scene that passes every check.
//! Nothing here touches files.
//!
//! What is guessed is said in the scene, beside the key that changes it.

mod clay;

use std::fmt::Write as _;

use glam::DVec3;
use serde::Deserialize;

pub use self::clay::ClayDraft;

use vps::mesh::TriangleMesh;
use vps::voxmap::estimate::{Estimate, MeshMeasures, Products, voxel_size_within};
use vps::voxmap::grid::Grid;
use vps::voxmap::memory_limit::show_bytes;

/// Numbers up to this long are read as metres, longer ones as millimetres: few things that are felt
/// with an arm are longer than two metres, or shorter than two millimetres.
const LONGEST_IN_METRES: f64 = 2.0;
/// Voxels on the longest edge of the tool.
const TOOL_VOXELS: f64 = 100.0;
/// The same of a ball that touches a part: it has no features of its own.
const BALL_VOXELS: f64 = 20.0;
/// Stiffness of a point of the tool, N/mm. Tools of any size have about as many points, so that they
/// are about as hard.
const POINT_N_PER_MM: f64 = 5.0;
/// N/mm³ that a scene may have without a warning.
const MODULI_N_PER_MM3: [f64; 2] = [1.0, 400.0];
/// Finest voxels, m: a hundredth of a millimetre is finer than any arm resolves.
const FINEST_M: f64 = 1e-5;
/// Coarsest, m: the most that a scene takes.
const COARSEST_M: f64 = 1.0;
/// What baking one part may take, bytes.
const PART_BYTES: u64 = 512 << 20;
/// Layers of a static part and of the tool, the defaults of a scene.
const LAYERS: [u32; 2] = [8, 4];
/// Air between tool and parts at the start, as a share of the tool's longest edge.
const GAP_SHARE: f64 = 0.25;
/// Radius of the ball that touches a part where there is no second one, as a share of the part's
/// longest edge.
const BALL_SHARE: f64 = 0.05;
/// Radius of the space in which the grip of `sim-sigma7` moves, m.
const ARM_RADIUS_M: f64 = 0.075;
/// How fast the hand of a draft goes, m/s of the grip, and how long it rests where it turns, s.
const HAND_M_PER_S: f64 = 0.02;
const HAND_RESTS_S: f64 = 0.5;
/// Two places that the hand reaches within a shorter time are one: times are written to the
/// millisecond.
const SHORTEST_S: f64 = 0.01;
/// How far beyond the boxes of the parts a tour presses, as a share of the tool's longest edge:
/// what is felt is a part, which may be smaller.
const PRESS_SHARE: f64 = 0.1;
/// Boxes of tool and parts that reach into each other by this share of the tool's height, or more,
/// are parts in their assembled places.
const MATED_SHARE: f64 = 0.02;
/// Largest scale that a scene takes.
const MOST_SCALE: f64 = 1000.0;

/// A unit of length of a mesh file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Unit {
    /// Metre.
    M,
    /// Millimetre.
    Mm,
    /// Centimetre.
    Cm,
    /// Inch.
    In,
}

impl Unit {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Mm, Self::M, Self::Cm, Self::In];

    /// The unit of a name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|unit| unit.name() == name)
    }

    /// The word that scenes write: `mm`, `m`, `cm` or `in`.
    pub const fn name(self) -> &'static str {
        match self {
            Self::M => "m",
            Self::Mm => "mm",
            Self::Cm => "cm",
            Self::In => "in",
        }
    }

    /// How long it is, m.
    pub const fn metres(self) -> f64 {
        match self {
            Self::M => 1.0,
            Self::Mm => 1e-3,
            Self::Cm => 1e-2,
            Self::In => 0.0254,
        }
    }

    /// The likely one of parts of which the longest edge of a box has this many units.
    pub fn guess(longest: f64) -> Self {
        if longest <= LONGEST_IN_METRES { Self::M } else { Self::Mm }
    }
}

/// One mesh file.
#[derive(Clone, Debug)]
pub struct DraftPart {
    /// Path as the scene is to name it: relative to the scene file.
    pub file: String,
    /// Name of the object.
    pub name: String,
    /// Unit of its numbers.
    pub unit: Unit,
    /// What is to be known of it, m.
    pub measures: MeshMeasures,
}

impl DraftPart {
    /// A part of a mesh in metres.
    pub fn new(file: String, name: String, unit: Unit, mesh: &TriangleMesh) -> Self {
        Self { file, name, unit, measures: MeshMeasures::of(mesh) }
    }

    /// Edges of its box, m.
    pub(super) fn size_m(&self) -> DVec3 {
        let (low, high) = self.measures.bounds_m;
        high - low
    }
}

/// What moves.
#[derive(Clone, Debug)]
pub enum DraftTool {
    /// A part of the folder.
    Part(DraftPart),
    /// A ball, where the folder has one part only; its radius, m.
    Ball(f64),
}

/// What the hand of a draft does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DraftPath {
    /// Into the place where its file puts the tool, and out again: the parts are drawn as they are
    /// assembled.
    Assembly,
    /// Onto the parts from above and from four sides.
    Tour,
}

/// A scene that is yet to be written.
#[derive(Clone, Debug)]
pub struct Draft {
    name: String,
    statics: Vec<(DraftPart, f64)>,
    tool: DraftTool,
    tool_voxel_m: f64,
    start_m: DVec3,
    scale: f64,
    path: DraftPath,
    /// Where the hand wants the tool's origin to be over time: s, m.
    hand: Vec<(f64, DVec3)>,
    /// Of all objects together, and what the scene keeps, bytes.
    memory: [u64; 2],
}

impl Draft {
    /// The smallest part moves, or the one of this index; the others stand where their files put
    /// them. `None` without parts.
    pub fn new(name: &str, mut parts: Vec<DraftPart>, tool_idx: Option<usize>) -> Option<Self> {
        let smallest = |parts: &[DraftPart]| {
            let by_size = |(_, a): &(usize, &DraftPart), (_, b): &(usize, &DraftPart)| {
                a.size_m().length().total_cmp(&b.size_m().length())
            };
            parts.iter().enumerate().min_by(by_size).map(|(idx, _)| idx)
        };
        let tool = if parts.len() > 1 {
            DraftTool::Part(parts.remove(tool_idx.or_else(|| smallest(&parts))?))
        } else {
            DraftTool::Ball(two_digits(BALL_SHARE * parts.first()?.size_m().max_element()))
        };
        let (tool_low, tool_high) = match &tool {
            DraftTool::Part(part) => part.measures.bounds_m,
            DraftTool::Ball(radius_m) => (DVec3::splat(-radius_m), DVec3::splat(*radius_m)),
        };
        let tool_m = (tool_high - tool_low).max_element();
        let n_voxels = if matches!(tool, DraftTool::Ball(_)) { BALL_VOXELS } else { TOOL_VOXELS };
        let wanted =
            |longest_m: f64| two_digits((longest_m / n_voxels).clamp(FINEST_M, COARSEST_M));
        let mut memory = [0, 0];
        let mut within = |measures: &MeshMeasures, layers, products| {
            let (low, high) = measures.bounds_m;
            // As fine as the tool, and finer where a part is smaller than that.
            let wanted_m = wanted(tool_m.min((high - low).max_element()));
            let voxel_m = voxel_size_within(measures, wanted_m, layers, products, PART_BYTES)
                .map_or(COARSEST_M, |fits_m| {
                    // Rounded up: what fits goes on fitting.
                    if fits_m > wanted_m {
                        two_digits(fits_m * 1.05).min(COARSEST_M)
                    } else {
                        wanted_m
                    }
                });
            if let Ok(grid) = Grid::around(low, high, voxel_m, layers) {
                let estimate = Estimate::new(measures, &grid, layers, products);
                memory = [
                    memory[0].max(memory[1] + estimate.peak_bytes),
                    memory[1] + estimate.kept_bytes,
                ];
            }
            voxel_m
        };
        let statics: Vec<(DraftPart, f64)> = parts
            .into_iter()
            .map(|part| {
                let voxel_m = within(
                    &part.measures,
                    LAYERS[0],
                    Products { field: true, gradients: false, shell: false },
                );
                (part, voxel_m)
            })
            .collect();
        let tool_voxel_m = match &tool {
            DraftTool::Part(part) => within(
                &part.measures,
                LAYERS[1],
                Products { field: false, gradients: false, shell: true },
            ),
            DraftTool::Ball(_) => wanted(tool_m),
        };
        let boxes = statics.iter().map(|(part, _)| part.measures.bounds_m);
        let (low, high) = boxes.reduce(|(low, high), (other_low, other_high)| {
            (low.min(other_low), high.max(other_high))
        })?;
        let gap_m = GAP_SHARE * tool_m;
        // Above everything: the boxes do not meet, so nothing touches.
        let place = DVec3::new(0.5 * (low.x + high.x), 0.5 * (low.y + high.y), high.z + gap_m);
        let held = DVec3::new(
            0.5 * (tool_low.x + tool_high.x),
            0.5 * (tool_low.y + tool_high.y),
            tool_low.z,
        );
        let start_m = place - held;
        let reach_m = 0.5 * (high - low).max_element() + gap_m;
        let scale = arm_scale(reach_m);
        let is_mated = matches!(tool, DraftTool::Part(_)) && {
            let shared = tool_high.min(high) - tool_low.max(low);
            shared.min_element() > MATED_SHARE * (tool_high - tool_low).z
        };
        let path = if is_mated { DraftPath::Assembly } else { DraftPath::Tour };
        let way = match path {
            DraftPath::Assembly => {
                vec![
                    start_m,
                    DVec3::new(0.0, 0.0, start_m.z),
                    DVec3::ZERO,
                    DVec3::new(0.0, 0.0, start_m.z),
                    start_m,
                ]
            }
            DraftPath::Tour => {
                tour((tool_low, tool_high), (low, high), start_m, gap_m, PRESS_SHARE * tool_m)
            }
        };
        let hand = timed(&way, HAND_M_PER_S * scale);
        Some(Self {
            name: name.to_owned(),
            statics,
            tool,
            tool_voxel_m,
            start_m,
            scale,
            path,
            hand,
            memory,
        })
    }

    /// The part that moves.
    pub fn tool(&self) -> &DraftTool {
        &self.tool
    }

    /// The parts that stand, with their voxel edges, m.
    pub fn statics(&self) -> &[(DraftPart, f64)] {
        &self.statics
    }

    /// The tool's voxel edge, m.
    pub fn tool_voxel_m(&self) -> f64 {
        self.tool_voxel_m
    }

    /// World metres per device metre.
    pub fn scale(&self) -> f64 {
        self.scale
    }

    /// What its hand does.
    pub fn path(&self) -> DraftPath {
        self.path
    }

    /// The file of its hand.
    pub fn hand_csv(&self) -> String {
        let row = |(time_s, position_m): &(f64, DVec3)| {
            let [x, y, z] = position_m.to_array();
            format!("{time_s:.3},{x:.7},{y:.7},{z:.7},0,0,0,1\n")
        };
        format!("{}\n{}", document::poses::HEADER, self.hand.iter().map(row).collect::<String>())
    }

    /// About the most that baking will take, and what the scene will keep, bytes.
    pub fn memory_bytes(&self) -> [u64; 2] {
        self.memory
    }

    /// The scene. `file` is what it will be called, `units` a remark on why the units are what they
    /// are, `hand` the file of its hand, if there is one.
    pub fn text(&self, file: &str, units: &str, hand: Option<&str>) -> String {
        let mut text = String::new();
        // True invariant: writing to a string cannot fail.
        let _ = self.write(&mut text, file, units, hand);
        text
    }

    fn write(
        &self,
        text: &mut String,
        file: &str,
        units: &str,
        hand: Option<&str>,
    ) -> std::fmt::Result {
        let mm = |metres: f64| shown(metres * 1e3);
        write_head(text, file, &self.name, "run", "renders it until Ctrl-C")?;
        writeln!(text, "# Parts that stand, each where its file puts it.")?;
        for (part, voxel_m) in &self.statics {
            writeln!(
                text,
                "[[static]]\nname = {}\nmesh = {}",
                quoted(&part.name),
                quoted(&part.file)
            )?;
            remarked(text, &format!("units = \"{}\"", part.unit.name()), units)?;
            remarked(text, &format!("voxel_size_mm = {}", mm(*voxel_m)), &box_text(part.size_m()))?;
            writeln!(
                text,
                "position_mm = [0.0, 0.0, 0.0]\norientation_xyzw = [0.0, 0.0, 0.0, 1.0]"
            )?;
            remarked(text, "movable = false", "true: its pose may be set while running")?;
            writeln!(text)?;
        }
        writeln!(text, "# The part in the hand.\n[tool]")?;
        let points = format!("voxel_size_mm = {}", mm(self.tool_voxel_m));
        match &self.tool {
            DraftTool::Part(part) => {
                writeln!(text, "mesh = {}", quoted(&part.file))?;
                remarked(text, &format!("units = \"{}\"", part.unit.name()), units)?;
                remarked(
                    text,
                    &points,
                    &format!("spacing of its points; {}", box_text(part.size_m())),
                )?;
            }
            DraftTool::Ball(radius_m) => {
                remarked(
                    text,
                    &format!("shape = {{ sphere_mm = {} }}", mm(*radius_m)),
                    "radius; the folder has one part only",
                )?;
                remarked(text, &points, "spacing of its points")?;
            }
        }
        remarked(text, "mass_g = 100.0", "of the virtual tool, not of the part")?;
        let [x, y, z] = self.start_m.to_array().map(mm);
        remarked(
            text,
            &format!("start_position_mm = [{x}, {y}, {z}]"),
            "above everything that stands",
        )?;
        writeln!(
            text,
            "\n# How hard things are. The coupling to the arm is derived from what the arm can \
                take.\n[contact]"
        )?;
        write_stiffness(text, self.tool_voxel_m)?;
        writeln!(text, "# friction = {{ static = 0.25, dynamic = 0.2 }}")?;
        remarked(
            text,
            "# time_budget_us = 500",
            "most that a contact query may take; for parts with many points",
        )?;
        writeln!(text, "\n[device]")?;
        remarked(
            text,
            "profile = \"sim-sigma7\"",
            "a simulated arm; `hapticd devices` lists those that are attached",
        )?;
        let does = match self.path {
            DraftPath::Assembly => "into the place where its file puts the tool, and out again",
            DraftPath::Tour => "onto the parts from above and from four sides",
        };
        match hand {
            Some(hand) => remarked(
                text,
                &format!("hand = {}", quoted(hand)),
                &format!("where the simulated hand goes: {does}"),
            )?,
            None => remarked(
                text,
                "# hand = \"path.csv\"",
                "where the simulated hand goes over time; without it, it stays",
            )?,
        }
        if self.scale != 1.0 {
            writeln!(text, "# The parts are larger than the space in which the arm's grip moves.")?;
        }
        remarked(
            text,
            &format!("world_from_device = {{ scale = {} }}", shown(self.scale)),
            "world metres per metre of the arm",
        )
    }
}

/// Onto the box of the parts from above and from its four sides, and back to the start; beside the
/// box the tool has `gap_m` of air. Places of the tool's origin.
fn tour(
    tool: (DVec3, DVec3),
    parts: (DVec3, DVec3),
    start_m: DVec3,
    gap_m: f64,
    press_m: f64,
) -> Vec<DVec3> {
    let ((tool_low, tool_high), (low, high)) = (tool, parts);
    let held = 0.5 * (tool_low + tool_high);
    let middle = 0.5 * (low + high) - held;
    let mut way = vec![start_m, start_m - DVec3::Z * (gap_m + press_m), start_m];
    for side in [DVec3::X, DVec3::Y, DVec3::NEG_X, DVec3::NEG_Y] {
        // How far out the tool's middle is when the boxes meet.
        let meets_m = (0.5 * (high - low) + 0.5 * (tool_high - tool_low)).dot(side.abs());
        let over = DVec3::new(middle.x, middle.y, start_m.z) + side * (meets_m + gap_m);
        let beside = DVec3::new(over.x, over.y, middle.z);
        way.extend([over, beside, beside - side * (gap_m + press_m), beside, over]);
    }
    way.push(start_m);
    way
}

/// The same way at a speed, with a rest at each of its places.
fn timed(way: &[DVec3], speed_m_per_s: f64) -> Vec<(f64, DVec3)> {
    let mut hand: Vec<(f64, DVec3)> = Vec::new();
    for &place in way {
        let (before_s, before) = hand.last().copied().unwrap_or((0.0, place));
        let way_s = (place - before).length() / speed_m_per_s;
        if way_s < SHORTEST_S && !hand.is_empty() {
            continue;
        }
        let arrives_s = before_s + way_s;
        hand.extend([(arrives_s, place), (arrives_s + HAND_RESTS_S, place)]);
    }
    hand
}

/// World metres per metre of the arm with which its grip reaches so far.
fn arm_scale(reach_m: f64) -> f64 {
    if reach_m > ARM_RADIUS_M {
        two_digits(reach_m / ARM_RADIUS_M * 1.05).min(MOST_SCALE)
    } else {
        1.0
    }
}

/// A line with a remark beside it.
/// What every draft begins with: what is done with it, by `command` beside `check`, and its name.
fn write_head(
    text: &mut String,
    file: &str,
    name: &str,
    command: &str,
    does: &str,
) -> std::fmt::Result {
    let width = "check".len().max(command.len()) + 4;
    writeln!(
        text,
        "# Written by `hapticd init`. What was guessed says so; everything may be changed.\n#"
    )?;
    for (word, does) in [("check", "says what is wrong with it"), (command, does)] {
        writeln!(
            text,
            "#   hapticd {word} {file}{:blanks$}{does}",
            "",
            blanks = width - word.len()
        )?;
    }
    writeln!(
        text,
        "#\n# Keys that are not here have defaults: default.toml lists them all, in config/ of the \
            source and /usr/share/hapticd of the package.\n"
    )?;
    writeln!(text, "version = 1\nname = {}\n", quoted(name))
}

/// The contact modulus for a tool of these voxels, to three digits.
fn write_stiffness(text: &mut String, tool_voxel_m: f64) -> std::fmt::Result {
    let voxel_mm = tool_voxel_m * 1e3;
    let [least, most] = MODULI_N_PER_MM3;
    let n_per_mm3 = (POINT_N_PER_MM / (voxel_mm * voxel_mm)).clamp(least, most);
    let n_per_mm3: f64 = format!("{n_per_mm3:.2e}").parse().unwrap_or(n_per_mm3);
    remarked(
        text,
        &format!("stiffness_n_per_mm3 = {n_per_mm3:?}"),
        "pressure for each depth, of the pair of materials",
    )
}

fn remarked(text: &mut String, line: &str, remark: &str) -> std::fmt::Result {
    writeln!(text, "{line:<34} # {remark}")
}

/// `its box is 8 x 8 x 30 mm`.
fn box_text(size_m: DVec3) -> String {
    let [x, y, z] = size_m.to_array().map(|edge_m| two_digits(edge_m * 1e3));
    format!("its box is {x} x {y} x {z} mm")
}

/// What baking takes, for people.
pub fn memory_text([peak_bytes, kept_bytes]: [u64; 2]) -> String {
    format!(
        "baking takes about {}, and the scene keeps about {}",
        show_bytes(peak_bytes),
        show_bytes(kept_bytes)
    )
}

/// The number with two significant digits.
fn two_digits(number: f64) -> f64 {
    format!("{number:.1e}").parse().unwrap_or(number)
}

/// A number that TOML reads as a float, without the dust of arithmetic.
fn shown(number: f64) -> String {
    let rounded: f64 = format!("{number:.6e}").parse().unwrap_or(number);
    format!("{rounded:?}")
}

/// A string that TOML reads back.
fn quoted(text: &str) -> String {
    toml::Value::String(text.to_owned()).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;
    use vps::mesh::primitives::Shape;

    fn part(name: &str, size_m: [f64; 3], at_m: [f64; 3]) -> DraftPart {
        let mut mesh = Shape::Box { size_m: DVec3::from_array(size_m) }.tessellate(1.0);
        mesh.vertices.iter_mut().for_each(|vertex| *vertex += DVec3::from_array(at_m));
        DraftPart::new(format!("{name}.obj"), name.to_owned(), Unit::Mm, &mesh)
    }

    #[test]
    fn the_smallest_part_moves_and_begins_above_the_others() {
        let parts = vec![
            part("plate", [0.1, 0.1, 0.01], [0.3, 0.0, 0.0]),
            part("pin", [0.01, 0.01, 0.03], [0.0, 0.2, 0.5]),
            part("post", [0.02, 0.02, 0.08], [0.3, 0.1, 0.04]),
        ];
        let draft = Draft::new("parts", parts.clone(), None).expect("parts");
        assert!(matches!(draft.tool(), DraftTool::Part(part) if part.name == "pin"));
        assert_eq!(draft.tool_voxel_m(), 3e-4);
        // The pin's box at the start: over the middle of the others, its lower end a quarter of its
        // length above the post.
        let (low, high) = parts[1].measures.bounds_m;
        let low = low + draft.start_m;
        let high = high + draft.start_m;
        assert!(
            (low.z - 0.0875).abs() < 1e-12 && ((low + high).x - 0.6).abs() < 1e-12,
            "{low} {high}"
        );
        let chosen = Draft::new("parts", parts, Some(0)).expect("parts");
        assert!(matches!(chosen.tool(), DraftTool::Part(part) if part.name == "plate"));
        assert_eq!(
            chosen.statics()[0].1,
            3e-4,
            "a part that is smaller than the tool has finer voxels"
        );
    }

    #[test]
    fn the_hand_goes_into_the_assembled_place_or_around_the_parts() {
        let block = part("block", [0.04, 0.04, 0.03], [0.0, 0.0, -0.015]);
        let pin = [0.008, 0.008, 0.03];
        let assembled =
            Draft::new("parts", vec![block.clone(), part("pin", pin, [0.0, 0.0, -0.005])], None)
                .expect("parts");
        assert_eq!(assembled.path(), DraftPath::Assembly);
        assert!(
            assembled.hand.iter().any(|(_, place)| *place == DVec3::ZERO),
            "{:?}",
            assembled.hand
        );
        let apart = Draft::new("parts", vec![block, part("pin", pin, [0.3, 0.0, 0.2])], None)
            .expect("parts");
        assert_eq!(apart.path(), DraftPath::Tour);
        for draft in [assembled, apart] {
            assert_eq!(
                (draft.hand[0].1, draft.hand[draft.hand.len() - 1].1),
                (draft.start_m, draft.start_m)
            );
            let poses = document::poses::parse(&draft.hand_csv(), "hand.csv".as_ref())
                .expect("a hand file");
            document::poses::check_order(&poses, "hand.csv".as_ref()).expect("times that rise");
            assert!(
                draft
                    .hand
                    .windows(2)
                    .all(|pair| pair[1].0 > pair[0].0 && pair[1].0 - pair[0].0 < 10.0),
                "{:?}",
                draft.hand
            );
        }
    }

    #[test]
    fn parts_that_would_take_too_much_memory_are_coarser() {
        let hall = part("hall", [40.0, 30.0, 8.0], [0.0; 3]);
        let draft =
            Draft::new("hall", vec![hall, part("screw", [0.005, 0.005, 0.02], [0.0; 3])], None)
                .expect("parts");
        let (_, voxel_m) = draft.statics()[0];
        assert!(voxel_m > 100.0 * draft.tool_voxel_m(), "{voxel_m}");
        assert!(draft.memory_bytes()[0] < 2 * PART_BYTES, "{:?}", draft.memory_bytes());
        assert!(draft.scale() > 200.0);
        assert!(Draft::new("none", Vec::new(), None).is_none());
    }

    #[test]
    fn every_draft_is_a_scene() {
        for (parts, tool) in [
            (vec![part("a \"b\" \\ c", [0.1; 3], [0.0; 3]), part("d", [0.07; 3], [0.0; 3])], None),
            (vec![part("one", [1e-4; 3], [0.0; 3])], None),
            (vec![part("one", [900.0; 3], [0.0; 3]), part("two", [1e-3; 3], [0.0; 3])], Some(0)),
        ] {
            let folder = tempfile::tempdir().expect("a temporary folder");
            let draft = Draft::new("a scene", parts.clone(), tool).expect("parts");
            for part in &parts {
                std::fs::write(folder.path().join(&part.file), "").expect("written");
            }
            let path = folder.path().join("scene.toml");
            std::fs::write(&path, draft.text("scene.toml", "as the test says", Some("hand.csv")))
                .expect("written");
            std::fs::write(folder.path().join("hand.csv"), draft.hand_csv()).expect("written");
            let config = crate::config::load(&path)
                .unwrap_or_else(|errors| panic!("{errors}\n{}", draft.text("", "", None)));
            assert_eq!(config.statics.len(), parts.len().max(2) - 1);
        }
    }

    #[test]
    fn units_are_those_in_which_parts_have_a_size_for_hands() {
        for (longest, unit) in [
            (0.12, Unit::M),
            (1.5, Unit::M),
            (8.0, Unit::Mm),
            (450.0, Unit::Mm),
            (2500.0, Unit::Mm),
        ] {
            assert_eq!(Unit::guess(longest), unit, "{longest}");
        }
    }
}
