//! A scene as the rest of the program sees it: SI, typed, checked.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::time::Duration;

use glam::{DMat3, DVec3};

use arms::attached::nodes::Selector;
use arms::profile::Profile;
use clay::engine::ToolSettings;
use clay::{Solid, clay_model};
use engine::arm_rules::StabilityBounds;
use haptics::Parameters;
use rt::schedule::RealtimeConfig;
use vps::mesh::primitives::Shape;
use vps::pointshell::Points;
use vps::spatial::Pose;
use vps::voxmap::inside_test::InsideTest;

/// A checked scene.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneConfig {
    /// Path of the scene file.
    pub path: PathBuf,
    /// The files that it names and that are read with it.
    pub files: Vec<PathBuf>,
    /// Name for people; the scene's own, else the stem of its file.
    pub name: String,
    /// Ticks per second, Hz.
    pub rate_hz: u32,
    /// What a contact query may take in one tick, s; `None`: as long as it takes.
    pub time_budget_s: Option<f64>,
    /// How the stiffness of contact was written.
    pub stiffness_key: StiffnessKey,
    /// Objects that the tool can touch; each becomes one voxmap.
    pub statics: Vec<StaticConfig>,
    /// The moving object, which becomes the pointshell.
    pub tool: ToolConfig,
    /// Clay, for `hapticd sculpt`; `None`: a rigid scene.
    pub sculpt: Option<SculptConfig>,
    /// What the tick reads.
    pub parameters: Parameters,
    /// The arm: its profile, and which one of several.
    pub device: DeviceConfig,
    /// What the loop asks of the operating system.
    pub realtime: RealtimeConfig,
    /// What the arm can take.
    pub stability: StabilityBounds,
    /// Access of clients.
    pub monitor: MonitorConfig,
    /// Longest silence of the client that drives: without a client that beats no force flows.
    /// `None`: no client has to.
    pub heartbeat: Option<Duration>,
}

/// How the stiffness of contact was written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum StiffnessKey {
    /// For each volume that overlaps (`contact.stiffness_n_per_mm3`), or not at all.
    OfVolume,
    /// For each s² of the tool (`contact.stiffness_n_per_mm`), as version 0.1.0 had it.
    OfPoint {
        /// What `contact.stiffness_n_per_mm3` would have to be, N/mm³.
        n_per_mm3: f64,
    },
}

/// `[monitor]`: the page and its API.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MonitorConfig {
    /// Where it listens; `None`: off.
    pub listen: Option<SocketAddr>,
    /// File with the token that clients have to know.
    pub token_file: Option<PathBuf>,
    /// Pages of other servers that are welcome, such as `http://localhost:8000`.
    pub origins: Vec<String>,
    /// Where the Foxglove app finds the run, on this machine alone; `None`: off.
    pub foxglove: Option<SocketAddr>,
}

/// Where a triangle mesh comes from.
#[derive(Clone, Debug, PartialEq)]
pub enum MeshSource {
    /// A file; `metres_per_unit` scales its numbers.
    File {
        /// Absolute, or relative to the working directory.
        path: PathBuf,
        /// 1 for m, 1e-3 for mm, 1e-2 for cm, 0.0254 for in.
        metres_per_unit: f64,
    },
    /// A primitive shape.
    Shape(Shape),
}

/// A static object.
#[derive(Clone, Debug, PartialEq)]
pub struct StaticConfig {
    /// Name, unique in the scene.
    pub name: String,
    /// Geometry.
    pub source: MeshSource,
    /// Voxel edge s, m.
    pub voxel_size_m: f64,
    /// Layers on each side of the surface.
    pub layers: u32,
    /// How inside and outside are reported.
    pub sides: InsideTest,
    /// `world_from_map`; of a movable one where it stands at the start.
    pub pose: Pose,
    /// Its pose may be set while running.
    pub movable: bool,
}

/// The tool.
#[derive(Clone, Debug, PartialEq)]
pub struct ToolConfig {
    /// Geometry.
    pub source: MeshSource,
    /// Voxel edge s, m: the spacing of the points.
    pub voxel_size_m: f64,
    /// Layers on each side (at least 2, for normals).
    pub layers: u32,
    /// How inside and outside are reported.
    pub sides: InsideTest,
    /// Which points it has.
    pub points: Points,
    /// Mass, kg.
    pub mass_kg: f64,
    /// Centre of mass in the tool frame, m; `None`: from the mesh.
    pub center_of_mass_m: Option<DVec3>,
    /// Inertia about the centre of mass in tool axes, kg·m²; `None`: from the mesh.
    pub inertia_kg_m2: Option<DMat3>,
}

/// `[sculpt]`: the clay.
#[derive(Clone, Debug, PartialEq)]
pub struct SculptConfig {
    /// What it is at the start.
    pub source: ClaySource,
    /// Where it stands in the world; the map frame is the file's own.
    pub world_from_map: Pose,
    /// How it is worked. A session brings its own.
    pub settings: clay_model::Settings,
    /// Ticks from one update of the material to the next.
    pub update_ticks: u64,
    /// α of the force between updates, from one tick to the next; `None`: nine tenths of a change
    /// are felt when the next update comes.
    pub smoothing: Option<f64>,
    /// What is in the hand at the start.
    pub tool: ToolSettings,
    /// Scripted strokes; see [`super::strokes`].
    pub strokes: Option<PathBuf>,
}

/// Where clay comes from.
#[derive(Clone, Debug, PartialEq)]
pub enum ClaySource {
    /// Samples of a solid.
    Solid(Solid),
    /// A session that was saved.
    Session(PathBuf),
}

/// The attached arm.
#[derive(Clone, Debug, PartialEq)]
pub struct DeviceConfig {
    /// The loaded profile.
    pub profile: Profile,
    /// Which of several real arms; `None`: the only one that fits the profile.
    pub selector: Option<Selector>,
    /// Hand path of a simulated arm.
    pub hand: Option<PathBuf>,
    /// Overrides of the simulated hand and plant.
    pub sim: SimConfig,
}

/// `[device.sim]`: overrides for the simulated arm.
#[derive(Clone, Debug, PartialEq)]
pub struct SimConfig {
    /// Stiffness of the hand, N/m.
    pub hand_stiffness_n_per_m: f64,
    /// Damping of the hand, N·s/m.
    pub hand_damping_n_s_per_m: f64,
    /// Mass of the hand, kg.
    pub hand_mass_kg: f64,
    /// False: no hand holds the arm.
    pub hand_present: bool,
    /// The hand goes its path there and back, again and again.
    pub hand_repeats: bool,
    /// Command delay in ticks; `None`: the profile's.
    pub delay_ticks: Option<u32>,
    /// Fault to inject, as written (`nan@2s`); `None`: none.
    pub fault: Option<String>,
}
