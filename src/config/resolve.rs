//! Third pass: the scene as the rest of the program sees it. SI, typed, checked.

use std::fs;
use std::path::{Path, PathBuf};

use glam::{DMat3, DVec3};

use super::bound::StiffnessBound;
use super::checks::{Checks, FINITE, Interval};
use super::document::Document;
use super::problem::{ConfigErrors, Problem, ProblemKind, nearest};
use super::schema::{self, Cutoff, Numbers, Overrun};
use crate::device::fault;
use crate::device::profile::{self, Plant, Profile, ProfileError};
use crate::haptics::contact::AVERAGED_CONTACTS;
use crate::haptics::filter::low_pass_alpha;
use crate::haptics::stability::SampledWall;
use crate::haptics::{
    ArmParameters, ContactParameters, CouplingMode, CouplingParameters, FilterParameters, FreeSpace, FrictionParameters,
    LimitParameters, Normalization, Parameters, PortParameters, SpringClamp,
};
use crate::mesh::Format;
use crate::mesh::primitives::Shape;
use crate::spatial::{Axes, Pose};
use crate::voxmap::field::FieldKind;
use crate::voxmap::sides::SidesRule;

/// A checked scene.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneConfig {
    /// Path of the scene file.
    pub path: PathBuf,
    /// Human name.
    pub name: String,
    /// Ticks per second.
    pub rate_hz: u32,
    /// What a contact query may take in one tick, s; `None`: as long as it takes.
    pub time_budget_s: Option<f64>,
    /// Points on edges of the tool push the way that the obstacle says.
    pub knows_edges: bool,
    /// One voxmap each.
    pub statics: Vec<StaticConfig>,
    /// The moving object.
    pub tool: ToolConfig,
    /// What the tick reads.
    pub parameters: Parameters,
    /// The arm.
    pub device: DeviceConfig,
    /// Scheduling.
    pub realtime: RealtimeConfig,
    /// What the arm can take.
    pub stability: StabilityConfig,
}

/// The stability bounds that the scene was held against.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StabilityConfig {
    /// Translational stiffness that the arm may feel, N/m; the world's stiffness times `scale`.
    pub translation: StiffnessBound,
    /// Rotational stiffness that the arm may feel, N·m/rad.
    pub rotation: StiffnessBound,
    /// The scene overrides the bounds: nothing is refused and the tick's own bounds are infinite.
    pub allow_unstable: bool,
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
    /// How inside and outside are told.
    pub sides: SidesRule,
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
    /// How inside and outside are told.
    pub sides: SidesRule,
    /// Mass, kg.
    pub mass_kg: f64,
    /// Centre of mass in the tool frame, m; `None`: from the mesh.
    pub center_of_mass_m: Option<DVec3>,
    /// Inertia about the centre of mass in tool axes, kg·m²; `None`: from the mesh.
    pub inertia_kg_m2: Option<DMat3>,
}

/// The attached arm.
#[derive(Clone, Debug, PartialEq)]
pub struct DeviceConfig {
    /// The loaded profile.
    pub profile: Profile,
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
    /// False: nobody holds the arm.
    pub hand_present: bool,
    /// Command delay in ticks; `None`: the profile's.
    pub delay_ticks: Option<u32>,
    /// Fault to inject, as written (`nan@2s`); `None`: none.
    pub fault: Option<String>,
    /// Seed of everything random.
    pub seed: u64,
}

/// What the loop asks of the operating system.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RealtimeConfig {
    /// Refuse to run when a preflight check fails.
    pub enforce: bool,
    /// Processor to pin to; `None`: the last one that this process may use.
    pub cpu: Option<usize>,
    /// SCHED_FIFO priority.
    pub priority: u8,
}

/// What the command line sets over the scene.
#[derive(Clone, Debug, Default)]
pub struct LoadOptions {
    /// `run --device PROFILE`: instead of `device.profile`; a path is relative to the working directory.
    pub device: Option<String>,
    /// `run --realtime MODE`: instead of `realtime.mode`; true for `enforce`.
    pub enforce: Option<bool>,
}

/// Loads a scene file through all passes.
///
/// # Errors
/// Every problem of the first pass that found any.
pub fn load(path: &Path) -> Result<SceneConfig, ConfigErrors> {
    load_with(path, &LoadOptions::default())
}

/// Loads a scene file through all passes, with overrides from the command line.
///
/// # Errors
/// Every problem of the first pass that found any.
pub fn load_with(path: &Path, options: &LoadOptions) -> Result<SceneConfig, ConfigErrors> {
    let of_file = |kind| ConfigErrors::new(vec![Problem::of_file(path, kind)]);
    if Format::of(path).is_ok() && path.is_file() {
        return Err(of_file(ProblemKind::IsMesh));
    }
    let text = fs::read_to_string(path).map_err(|cause| of_file(ProblemKind::Unreadable { cause }))?;
    let document = Document::parse(path, &text)?;
    let scene: schema::Scene = document.read()?;
    let dir = path.parent().unwrap_or(Path::new(""));
    let mut resolve = Resolve { checks: Checks::new(&document), document: &document, dir };
    let config = resolve.scene(path, scene, options);
    resolve.checks.finish()?;
    match config {
        Some(config) => Ok(config),
        // What is not there is a problem, so `finish` has returned already.
        None => Err(ConfigErrors::new(vec![Problem::of_file(
            path,
            ProblemKind::Missing { accepted: "a device profile and a tool".into() },
        )])),
    }
}

const DEFAULT_PROFILE: &str = "sim-sigma7";
const DEFAULT_RATE_HZ: u32 = 1000;
const DEFAULT_STATIC_LAYERS: u32 = 8;
const DEFAULT_TOOL_LAYERS: u32 = 4;
/// The quantised layer value of a voxel is an `i8`; 60 layers on each side stay well inside and keep the band affordable.
const LAYERS_MAX: u32 = 60;
/// Normals come from the layers around a point, two deep.
const TOOL_LAYERS_MIN: u32 = 2;
const DEFAULT_TOOL_MASS_G: f64 = 100.0;
const DEFAULT_CONTACT_N_PER_MM: f64 = 5.0;
const DEFAULT_DAMPING_RATIO: f64 = 0.7;
/// Coupling of an arm that bounds nothing: as stiff as the stiffest common arm.
const UNBOUNDED_N_PER_M: f64 = 4000.0;
const UNBOUNDED_NM_PER_RAD: f64 = 4.0;
/// Torque limit of the virtual tool where the arm renders no torque at all, N·m: the coupling still has to turn the tool.
const UNACTUATED_TORQUE_NM: f64 = 1.0;
/// Force limit of the virtual tool where the arm renders no force at all, N.
const UNACTUATED_FORCE_N: f64 = 10.0;
const DEFAULT_CUTOFF_HZ: [f64; 2] = [50.0, 300.0];
const DEFAULT_SPEED_MM_PER_S: f64 = 1000.0;
/// Slew: from zero to the limit in 10 ms (devices reference, safety rule 7).
const FULL_SLEW_S: f64 = 0.010;
const DEFAULT_POWER_W: f64 = 5.0;
const DEFAULT_RAMP_MS: f64 = 100.0;
const STALE_TICKS_MAX: u32 = 3;
const STALE_FAULT_S: f64 = 0.020;
const ENFORCED_OVERRUN_TICKS: u32 = 20;
const DEFAULT_PRIORITY: u32 = 80;
const DEFAULT_HAND_N_PER_M: f64 = 500.0;
const DEFAULT_HAND_N_S_PER_M: f64 = 5.0;
const DEFAULT_HAND_MASS_G: f64 = 150.0;

const MM: f64 = 1e-3;
const SIZE_MM: Interval = Interval::above(0.0).to(1e6).unit("mm");
const POSITIVE: Interval = Interval::above(0.0);

/// The faults that a simulated arm can be told to have, before any `@TIME`.
const FAULT_WORDS: [&str; 11] =
    ["drop", "stall", "nan", "garbage", "unplug", "slow", "stuck", "jump", "truncate", "sign-flip", "saturate"];

struct Resolve<'d> {
    checks: Checks<'d>,
    document: &'d Document<'d>,
    /// Folder that paths of the scene are relative to.
    dir: &'d Path,
}

impl Resolve<'_> {
    /// `None` without a usable profile or a tool, which is then among the problems.
    fn scene(&mut self, path: &Path, scene: schema::Scene, options: &LoadOptions) -> Option<SceneConfig> {
        self.later_keys(&scene);
        let name = scene.name.unwrap_or_else(|| path.file_stem().unwrap_or_default().to_string_lossy().into_owned());
        let rate_hz = self.checks.whole("rendering.rate_hz", scene.rendering.rate_hz, DEFAULT_RATE_HZ, 100, 10_000);
        let period_s = f64::from(rate_hz).recip();

        self.unique_names(&scene.statics);
        let statics = scene.statics.iter().enumerate().map(|(index, object)| self.static_object(index, object)).collect();
        let tool_written = scene.tool.as_ref();
        let tool = tool_written.map(|tool| self.tool(tool));
        if tool.is_none() {
            self.checks.missing("tool", "a [tool] table with the moving object: mesh and units, or shape; voxel_size_mm");
        }
        let realtime = self.realtime(&scene.realtime, options);
        let filter = self.filter(&scene.filter);
        let sim = self.sim(&scene.device);
        let hand = scene.device.hand.as_deref().and_then(|hand| self.checks.file("device.hand", hand, self.dir));
        let profile = self.profile(&scene.device, options);
        let port_scale = self.scale(&scene.device.world_from_device);
        let world_from_device = Pose::new(
            self.checks.orientation("device.world_from_device.orientation_xyzw", scene.device.world_from_device.orientation_xyzw),
            self.checks.position("device.world_from_device.position_mm", scene.device.world_from_device.position_mm) * MM,
        );
        let start = Pose::new(
            self.checks.orientation("tool.start_orientation_xyzw", tool_written.and_then(|tool| tool.start_orientation_xyzw)),
            self.checks.position("tool.start_position_mm", tool_written.and_then(|tool| tool.start_position_mm)) * MM,
        );
        let gravity = Interval::from(-100.0).to(100.0).unit("m/s²");
        let gravity_m_per_s2 = self
            .checks
            .array("rendering.gravity_m_per_s2", scene.rendering.gravity_m_per_s2, gravity)
            .map_or(DVec3::ZERO, DVec3::from_array);

        // Without a profile, the keys that need one are still checked for themselves, against an arm that bounds nothing.
        let mode = match scene.rendering.coupling {
            Some(schema::CouplingWord::SemiImplicit) => CouplingMode::SemiImplicit,
            Some(schema::CouplingWord::Direct) => CouplingMode::Direct,
            Some(schema::CouplingWord::Static) => CouplingMode::Static,
            Some(schema::CouplingWord::Constraint) => CouplingMode::Constraint,
            Some(schema::CouplingWord::Implicit) | None => CouplingMode::Implicit,
        };
        if mode == CouplingMode::Direct && gravity_m_per_s2 != DVec3::ZERO {
            let accepted = "zero: without a virtual tool, nothing has weight in \"direct\"";
            self.checks.not_available("rendering.gravity_m_per_s2", accepted);
        }
        let allow_unstable = scene.rendering.allow_unstable.unwrap_or(false);
        // The filter lies in the arm's loop in `direct` only; its lowest cut-off lags most.
        let filter_alpha = if mode == CouplingMode::Direct { low_pass_alpha(filter.cutoff_hz[0], period_s) } else { 0.0 };
        let stability = stability(profile.as_ref(), period_s, sim.delay_ticks, filter_alpha, allow_unstable);
        let coupling = self.coupling(&scene.coupling, mode, &stability, port_scale, profile.as_ref());
        let field = match scene.rendering.field {
            Some(schema::FieldWord::Layers) => FieldKind::Layers,
            Some(schema::FieldWord::SurfacePoint) => FieldKind::SurfacePoint,
            Some(schema::FieldWord::Octant) => FieldKind::Octant,
            Some(schema::FieldWord::Trilinear) | None => FieldKind::Trilinear,
        };
        let contact = self.contact(&scene.contact, field, mode, &stability, port_scale);
        let limits = self.limits(&scene.limits, &scene.safety, profile.as_ref(), rate_hz, realtime.enforce);

        let time_budget_s = self
            .checks
            .optional("contact.time_budget_us", scene.contact.time_budget_us, Interval::from(10.0).to(1e4).unit("µs"))
            .map(|us| us * 1e-6);
        if time_budget_s.is_some() && field != FieldKind::Trilinear {
            self.checks.not_available("contact.time_budget_us", "remove it, or use rendering.field = \"trilinear\"");
        }

        let (profile, tool) = (profile?, tool?);
        let arm = arm_parameters(&profile, &stability, port_scale);
        let port =
            PortParameters { world_from_device, scale: port_scale, sensed: profile.sensed, actuated: profile.actuated, start };
        Some(SceneConfig {
            path: path.to_path_buf(),
            name,
            rate_hz,
            time_budget_s,
            knows_edges: scene.contact.geometric_awareness != Some(schema::AwarenessWord::Off),
            statics,
            tool,
            parameters: Parameters { period_s, gravity_m_per_s2, contact, coupling, filter, limits, port, arm },
            device: DeviceConfig { profile, hand, sim },
            realtime,
            stability,
        })
    }

    /// Keys and values that the format has and this version lacks. Nothing is read and ignored.
    fn later_keys(&mut self, scene: &schema::Scene) {
        let checks = &mut self.checks;
        if scene.monitor.listen.as_deref().is_some_and(|listen| listen != "off") {
            checks.not_available("monitor.listen", "use \"off\"");
        }
        if scene.rendering.coupling == Some(schema::CouplingWord::Constraint) && scene.contact.friction.is_some() {
            checks.not_available("contact.friction", "leave it out, or use another rendering.coupling");
        }
        checks.later("safety.deadman", scene.safety.deadman.is_some());
        checks.later("safety.heartbeat_ms", scene.safety.heartbeat_ms.is_some());
        checks.later("device.selector", scene.device.selector.is_some());
        checks.later("device.sim.jitter_us", scene.device.sim.jitter_us.is_some());
        checks.later("sculpt", scene.sculpt.is_some());
    }

    fn unique_names(&mut self, statics: &[schema::Static]) {
        for (index, object) in statics.iter().enumerate() {
            let Some(name) = &object.name else { continue };
            let first = statics[..index].iter().position(|earlier| earlier.name.as_ref() == Some(name));
            if let Some(first) = first {
                let first_line = self.document.line(&format!("static[{first}].name")).unwrap_or_default();
                self.checks.refuse(&format!("static[{index}].name"), ProblemKind::DuplicateName { first_line });
            }
        }
    }

    fn static_object(&mut self, index: usize, object: &schema::Static) -> StaticConfig {
        let table = format!("static[{index}]");
        let key = |name: &str| format!("{table}.{name}");
        let voxel_size_m = self.voxel_size_m(&table, object.voxel_size_mm);
        let layers = self.checks.whole(&key("layers"), object.layers, DEFAULT_STATIC_LAYERS, 1, LAYERS_MAX);
        let written = WrittenSource { mesh: object.mesh.as_deref(), shape: object.shape.as_ref(), units: object.units };
        StaticConfig {
            name: object.name.clone().unwrap_or_else(|| table.clone()),
            source: self.source(&table, written, voxel_size_m, layers),
            voxel_size_m,
            layers,
            sides: sides(object.sides),
            pose: Pose::new(
                self.checks.orientation(&key("orientation_xyzw"), object.orientation_xyzw),
                self.checks.position(&key("position_mm"), object.position_mm) * MM,
            ),
            movable: object.movable.unwrap_or(false),
        }
    }

    fn tool(&mut self, tool: &schema::Tool) -> ToolConfig {
        let voxel_size_m = self.voxel_size_m("tool", tool.voxel_size_mm);
        let layers = self.checks.whole("tool.layers", tool.layers, DEFAULT_TOOL_LAYERS, TOOL_LAYERS_MIN, LAYERS_MAX);
        let written = WrittenSource { mesh: tool.mesh.as_deref(), shape: tool.shape.as_ref(), units: tool.units };
        let center_of_mass_m = self
            .checks
            .array("tool.center_of_mass_mm", tool.center_of_mass_mm, FINITE)
            .map(|center_mm| DVec3::from_array(center_mm) * MM);
        ToolConfig {
            source: self.source("tool", written, voxel_size_m, layers),
            voxel_size_m,
            layers,
            sides: sides(tool.sides),
            mass_kg: self.checks.number("tool.mass_g", tool.mass_g, DEFAULT_TOOL_MASS_G, POSITIVE.to(1e5).unit("g")) * 1e-3,
            center_of_mass_m,
            inertia_kg_m2: self.inertia_kg_m2(tool.inertia_kg_mm2),
        }
    }

    fn voxel_size_m(&mut self, table: &str, written_mm: Option<f64>) -> f64 {
        self.checks.required(&format!("{table}.voxel_size_mm"), written_mm, POSITIVE.to(1000.0).unit("mm")) * MM
    }

    /// `[xx, yy, zz, xy, xz, yz]`, the entries of the symmetric matrix itself.
    fn inertia_kg_m2(&mut self, written: Option<Numbers<6>>) -> Option<DMat3> {
        let [xx, yy, zz, xy, xz, yz] = self.checks.array("tool.inertia_kg_mm2", written, FINITE)?;
        let inertia = DMat3::from_cols(DVec3::new(xx, xy, xz), DVec3::new(xy, yy, yz), DVec3::new(xz, yz, zz));
        // No body has another: J itself and the second moments of mass, tr(J)/2 − J, are positive.
        let second_moments = DMat3::from_diagonal(DVec3::splat((xx + yy + zz) / 2.0 * (1.0 + 1e-9))) - inertia;
        if is_positive_definite(inertia) && is_positive_definite(second_moments) {
            return Some(inertia * (MM * MM));
        }
        self.checks.not_accepted(
            "tool.inertia_kg_mm2",
            "[xx, yy, zz, xy, xz, yz] of a real body: positive, and no principal moment above the sum of the other two",
        );
        None
    }

    /// Exactly one of a mesh and a shape. After a problem, some shape, so that the pass goes on.
    fn source(&mut self, table: &str, written: WrittenSource<'_>, voxel_size_m: f64, layers: u32) -> MeshSource {
        let fallback = MeshSource::Shape(Shape::Sphere { radius_m: 1.0 });
        let WrittenSource { mesh, shape, units } = written;
        match (mesh, shape) {
            (Some(_), Some(_)) => {
                let other = format!("{table}.mesh");
                self.checks.refuse(&format!("{table}.shape"), ProblemKind::Exclusive { other });
                fallback
            }
            (None, None) => {
                self.checks.missing(&format!("{table}.mesh"), "a mesh file, or a shape such as shape = { box_mm = [60, 40, 10] }");
                fallback
            }
            (None, Some(shape)) => {
                if units.is_some() {
                    self.checks.not_accepted(&format!("{table}.units"), "left out beside a shape, whose numbers are in mm");
                }
                self.shape(&format!("{table}.shape"), shape, voxel_size_m, layers).map_or(fallback, MeshSource::Shape)
            }
            (Some(mesh), None) => {
                let metres_per_unit = match units {
                    Some(schema::UnitWord::Metre) => 1.0,
                    Some(schema::UnitWord::Millimetre) => 1e-3,
                    Some(schema::UnitWord::Centimetre) => 1e-2,
                    Some(schema::UnitWord::Inch) => 0.0254,
                    None => {
                        self.checks
                            .missing(&format!("{table}.units"), "the unit of the mesh file: \"m\", \"mm\", \"cm\" or \"in\"");
                        1.0
                    }
                };
                match self.mesh_path(&format!("{table}.mesh"), mesh) {
                    Some(path) => MeshSource::File { path, metres_per_unit },
                    None => fallback,
                }
            }
        }
    }

    fn mesh_path(&mut self, key: &str, written: &str) -> Option<PathBuf> {
        if Format::of(Path::new(written)).is_err() {
            self.checks.refuse(key, ProblemKind::MeshFormat);
            return None;
        }
        self.checks.file(key, written, self.dir)
    }

    fn shape(&mut self, key: &str, written: &schema::Shape, voxel_size_m: f64, layers: u32) -> Option<Shape> {
        let schema::Shape { box_mm, sphere_mm, cylinder_mm, cone_mm, capsule_mm, torus_mm, plane_mm } = *written;
        let n_given = [
            box_mm.is_some(),
            sphere_mm.is_some(),
            cylinder_mm.is_some(),
            cone_mm.is_some(),
            capsule_mm.is_some(),
            torus_mm.is_some(),
            plane_mm.is_some(),
        ];
        if n_given.into_iter().filter(|is_given| *is_given).count() != 1 {
            self.checks
                .not_accepted(key, "exactly one of box_mm, sphere_mm, cylinder_mm, cone_mm, capsule_mm, torus_mm and plane_mm");
            return None;
        }
        let name = |shape: &str| format!("{key}.{shape}");
        if let Some(edges_mm) = self.checks.array(&name("box_mm"), box_mm, SIZE_MM) {
            return Some(Shape::Box { size_m: DVec3::from_array(edges_mm) * MM });
        }
        if let Some(radius_mm) = self.checks.optional(&name("sphere_mm"), sphere_mm, SIZE_MM) {
            return Some(Shape::Sphere { radius_m: radius_mm * MM });
        }
        if let Some([radius_mm, height_mm]) = self.checks.array(&name("cylinder_mm"), cylinder_mm, SIZE_MM) {
            return Some(Shape::Cylinder { radius_m: radius_mm * MM, height_m: height_mm * MM });
        }
        if let Some([radius_mm, height_mm]) = self.checks.array(&name("cone_mm"), cone_mm, SIZE_MM) {
            return Some(Shape::Cone { radius_m: radius_mm * MM, height_m: height_mm * MM });
        }
        if let Some([radius_mm, height_mm]) = self.checks.array(&name("capsule_mm"), capsule_mm, SIZE_MM) {
            return Some(Shape::Capsule { radius_m: radius_mm * MM, height_m: height_mm * MM });
        }
        if let Some([major_mm, minor_mm]) = self.checks.array(&name("torus_mm"), torus_mm, SIZE_MM) {
            if minor_mm >= major_mm {
                self.checks.not_accepted(&name("torus_mm"), "[R, r] with the tube radius r below the ring radius R");
                return None;
            }
            return Some(Shape::Torus { major_m: major_mm * MM, minor_m: minor_mm * MM });
        }
        let [x_mm, y_mm] = self.checks.array(&name("plane_mm"), plane_mm, SIZE_MM)?;
        // Thicker than the band on both faces, so that the middle is inside for every field and nothing falls through.
        let band_m = (f64::from(layers) + 1.5) * voxel_size_m;
        let thickness_m = (4.0 * band_m).max(0.1 * x_mm.max(y_mm) * MM);
        Some(Shape::Plane { x_m: x_mm * MM, y_m: y_mm * MM, thickness_m })
    }

    fn realtime(&mut self, written: &schema::Realtime, options: &LoadOptions) -> RealtimeConfig {
        let enforce = options.enforce.unwrap_or(written.mode == Some(schema::RealtimeWord::Enforce));
        let priority = self.checks.whole("realtime.priority", written.priority, DEFAULT_PRIORITY, 1, 99);
        let cpu = written.cpu.map(|cpu| self.checks.whole("realtime.cpu", Some(cpu), 0, 0, 1023) as usize);
        RealtimeConfig { enforce, cpu, priority: u8::try_from(priority).unwrap_or(u8::MAX) }
    }

    fn filter(&mut self, written: &schema::Filter) -> FilterParameters {
        let cutoff_hz = match written.cutoff_hz {
            None => DEFAULT_CUTOFF_HZ,
            Some(Cutoff::Off) => [f64::INFINITY; 2],
            Some(Cutoff::Range(range)) => {
                let range = self.checks.array("filter.cutoff_hz", Some(Numbers(range)), POSITIVE.unit("Hz"));
                let range = range.unwrap_or(DEFAULT_CUTOFF_HZ);
                if range[0] > range[1] {
                    self.checks.not_accepted("filter.cutoff_hz", "[lowest, highest] in Hz, the lowest first");
                }
                range
            }
        };
        FilterParameters { spatial: written.spatial.unwrap_or(true), cutoff_hz }
    }

    fn sim(&mut self, device: &schema::Device) -> SimConfig {
        let written = &device.sim;
        let hand_present = written.hand != Some(schema::HandWord::None);
        if !hand_present && device.hand.is_some() {
            self.checks.refuse("device.sim.hand", ProblemKind::Exclusive { other: "device.hand".into() });
        }
        if let Some(fault) = &written.fault {
            let word = fault.split(['@', ':', '=', ' ']).next().unwrap_or_default();
            if !FAULT_WORDS.contains(&word) {
                let known = FAULT_WORDS.map(str::to_owned).to_vec();
                self.checks.refuse("device.sim.fault", ProblemKind::UnknownWord { nearest: nearest(word, FAULT_WORDS), known });
            } else if let Err(error) = fault::parse(fault) {
                self.checks.refuse("device.sim.fault", ProblemKind::Fault(error));
            }
        }
        let checks = &mut self.checks;
        let not_negative = Interval::from(0.0);
        SimConfig {
            hand_stiffness_n_per_m: checks.number(
                "device.sim.hand_stiffness_n_per_m",
                written.hand_stiffness_n_per_m,
                DEFAULT_HAND_N_PER_M,
                not_negative.to(1e5).unit("N/m"),
            ),
            hand_damping_n_s_per_m: checks.number(
                "device.sim.hand_damping_n_s_per_m",
                written.hand_damping_n_s_per_m,
                DEFAULT_HAND_N_S_PER_M,
                not_negative.to(1e4).unit("N·s/m"),
            ),
            hand_mass_kg: checks.number(
                "device.sim.hand_mass_g",
                written.hand_mass_g,
                DEFAULT_HAND_MASS_G,
                not_negative.to(1e5).unit("g"),
            ) * 1e-3,
            hand_present,
            delay_ticks: written.delay_ticks.map(|ticks| checks.whole("device.sim.delay_ticks", Some(ticks), 0, 0, 100)),
            fault: written.fault.clone(),
            seed: written.seed.unwrap_or(0),
        }
    }

    fn profile(&mut self, written: &schema::Device, options: &LoadOptions) -> Option<Profile> {
        let (found, key, shown) = match (&options.device, &written.profile) {
            (Some(name), _) => (profile::find(name, Path::new("")), "--device", Some(name)),
            (None, Some(name)) => (profile::find(name, self.dir), "device.profile", None),
            (None, None) => (profile::find(DEFAULT_PROFILE, self.dir), "device.profile", None),
        };
        let kind = match found {
            Ok(profile) => return Some(profile),
            Err(ProfileError::Unknown { nearest, known }) => ProblemKind::UnknownProfile { nearest, known },
            Err(ProfileError::FileMissing { path }) => ProblemKind::FileMissing { path },
            Err(ProfileError::Invalid(errors)) => {
                self.checks.append(errors);
                return None;
            }
        };
        self.checks.refuse_as(key, shown.map(String::as_str), kind);
        None
    }

    fn scale(&mut self, written: &schema::WorldFromDevice) -> f64 {
        let interval = POSITIVE.to(1000.0).unit("world metres per device metre");
        self.checks.number("device.world_from_device.scale", written.scale, 1.0, interval)
    }

    fn coupling(
        &mut self,
        written: &schema::Coupling,
        mode: CouplingMode,
        stability: &StabilityConfig,
        scale: f64,
        profile: Option<&Profile>,
    ) -> CouplingParameters {
        let StabilityConfig { translation, rotation, allow_unstable } = *stability;
        let stiffness_n_per_m = match self.checks.optional("coupling.translation_n_per_mm", written.translation_n_per_mm, POSITIVE)
        {
            Some(n_per_mm) => n_per_mm / MM,
            None => or_if_infinite(translation.value() / scale, UNBOUNDED_N_PER_M),
        };
        let stiffness_nm_per_rad = match self.checks.optional("coupling.rotation_nm_per_rad", written.rotation_nm_per_rad, POSITIVE)
        {
            Some(nm_per_rad) => nm_per_rad,
            None => or_if_infinite(rotation.value(), UNBOUNDED_NM_PER_RAD),
        };
        // In `direct` mode the arm does not feel the coupling.
        if !allow_unstable && mode != CouplingMode::Direct {
            self.bounded("coupling.translation_n_per_mm", stiffness_n_per_m, &translation, TRANSLATION_UNITS, scale);
            self.bounded("coupling.rotation_nm_per_rad", stiffness_nm_per_rad, &rotation, ROTATION_UNITS, 1.0);
        }
        let damping = profile.and_then(|profile| profile.limits.damping_n_s_per_m);
        let damping_rotation = profile.and_then(|profile| profile.limits.damping_nm_s_per_rad);
        CouplingParameters {
            mode,
            stiffness_n_per_m,
            stiffness_nm_per_rad,
            felt_damping_n_s_per_m: self.felt_damping(
                "coupling.damping_n_s_per_m",
                written.damping_n_s_per_m,
                damping,
                "N·s/m",
                scale,
            ),
            felt_damping_nm_s_per_rad: self.felt_damping(
                "coupling.damping_nm_s_per_rad",
                written.damping_nm_s_per_rad,
                damping_rotation,
                "N·m·s/rad",
                1.0,
            ),
            clamp: match written.clamp {
                Some(schema::ClampWord::HalfVoxel) => SpringClamp::HalfVoxel,
                Some(schema::ClampWord::Saturate) | None => SpringClamp::Saturate,
            },
            free_space: match written.free_space {
                Some(schema::FreeSpaceWord::Drag) => FreeSpace::Drag,
                Some(schema::FreeSpaceWord::Zero) | None => FreeSpace::Zero,
            },
            // In world units, like the stiffness that they bound.
            bound_n_per_m: if allow_unstable { f64::INFINITY } else { translation.value() / scale },
            bound_nm_per_rad: if allow_unstable { f64::INFINITY } else { rotation.value() },
        }
    }

    /// Refuses a stiffness (SI, world) that the arm would feel above its bound.
    fn bounded(&mut self, key: &str, stiffness: f64, bound: &StiffnessBound, units: StiffnessUnits, scale: f64) {
        let felt = scale * stiffness;
        if bound.admits(felt) {
            return;
        }
        let accepted = bound.value() / scale * units.key_per_si;
        let kind = ProblemKind::StiffnessAboveBound { felt, felt_unit: units.si, bound: *bound, accepted, unit: units.key };
        self.checks.refuse(key, kind);
    }

    fn felt_damping(&mut self, key: &str, written: Option<f64>, declared: Option<f64>, unit: &'static str, scale: f64) -> f64 {
        let damping = self.checks.number(key, written, 0.0, Interval::from(0.0).unit(unit));
        if let Some(declared) = declared
            && scale * damping > declared
        {
            self.checks.refuse(key, ProblemKind::DampingAboveProfile { accepted: declared / scale, declared, unit });
        }
        damping
    }

    fn contact(
        &mut self,
        written: &schema::Contact,
        field: FieldKind,
        mode: CouplingMode,
        stability: &StabilityConfig,
        scale: f64,
    ) -> ContactParameters {
        let key = "contact.stiffness_n_per_mm";
        let is_bounded = mode == CouplingMode::Direct && !stability.allow_unstable;
        let default = DEFAULT_CONTACT_N_PER_MM / MM;
        let stiffness_n_per_m = match self.checks.optional(key, written.stiffness_n_per_mm, POSITIVE.to(1e6).unit("N/mm")) {
            Some(n_per_mm) => n_per_mm / MM,
            None if is_bounded => default.min(stability.translation.value() / scale),
            None => default,
        };
        if is_bounded {
            self.bounded(key, stiffness_n_per_m, &stability.translation, TRANSLATION_UNITS, scale);
        }
        let range = Interval::from(0.0).to(1e4).unit("N·s/m");
        let damping_n_s_per_m = self.checks.number("contact.damping_n_s_per_m", written.damping_n_s_per_m, 0.0, range);
        let braking = written.braking.unwrap_or(false);
        ContactParameters {
            field,
            stiffness_n_per_m,
            damping_ratio: self.checks.number(
                "contact.damping_ratio",
                written.damping_ratio,
                DEFAULT_DAMPING_RATIO,
                Interval::from(0.0).to(10.0),
            ),
            normalization: match written.normalize {
                Some(schema::NormalizeWord::Average) => Normalization::Average,
                Some(schema::NormalizeWord::Cluster) => Normalization::Cluster,
                Some(schema::NormalizeWord::None) | None => Normalization::None,
            },
            friction: self.friction(written.friction.as_ref(), stiffness_n_per_m),
            damping_n_s_per_m: self.of_a_mass(mode, "contact.damping_n_s_per_m", damping_n_s_per_m, damping_n_s_per_m > 0.0),
            braking: self.of_a_mass(mode, "contact.braking", braking, braking),
        }
    }

    /// A value that acts on the velocity of the virtual tool: without mass it has none of its own.
    fn of_a_mass<T>(&mut self, mode: CouplingMode, key: &str, value: T, acts: bool) -> T {
        if acts && !mode.has_mass() {
            let accepted = "left out with this rendering.coupling, whose virtual tool has no mass and so no velocity to take from; \
                            \"implicit\" and \"semi-implicit\" have one";
            self.checks.not_accepted(key, accepted);
        }
        value
    }

    /// No friction unless it is written. One coefficient counts for both.
    fn friction(&mut self, written: Option<&schema::Friction>, stiffness_n_per_m: f64) -> FrictionParameters {
        let Some(written) = written else { return FrictionParameters::NONE };
        let range = Interval::from(0.0).to(5.0);
        let holding = written.holding.or(written.sliding);
        let holding = self.checks.number("contact.friction.static", holding, 0.0, range);
        let sliding = self.checks.number("contact.friction.dynamic", written.sliding, holding, Interval::from(0.0).to(holding));
        // A face that holds is as stiff along the wall as ten of its points are into it.
        FrictionParameters { r#static: holding, dynamic: sliding, stiffness_n_per_m: AVERAGED_CONTACTS * stiffness_n_per_m }
    }

    fn limits(
        &mut self,
        limits: &schema::Limits,
        safety: &schema::Safety,
        profile: Option<&Profile>,
        rate_hz: u32,
        enforce: bool,
    ) -> LimitParameters {
        let actuated = profile.map_or(Axes::SIX, |profile| profile.actuated);
        let declared = profile.map(|profile| profile.limits);
        let force_max =
            declared.filter(|_| has_any(actuated, Axes::TRANSLATION)).map_or(UNACTUATED_FORCE_N, |limits| limits.force_n);
        let torque_max =
            declared.filter(|_| has_any(actuated, Axes::ROTATION)).map_or(UNACTUATED_TORQUE_NM, |limits| limits.torque_nm);
        let checks = &mut self.checks;
        let force_n = checks.number("limits.force_n", limits.force_n, force_max, POSITIVE.unit("N")).min(force_max);
        let torque_nm = checks.number("limits.torque_nm", limits.torque_nm, torque_max, POSITIVE.unit("N·m")).min(torque_max);
        let overrun_fault_ticks = match safety.overrun {
            Some(Overrun::Off) => 0,
            Some(Overrun::Consecutive(count)) => match u32::try_from(count) {
                Ok(count) if count > 0 => count,
                _ => {
                    checks.not_accepted(
                        "safety.overrun",
                        "a whole number of consecutive missed ticks from 1 to 4294967295, or \"off\"",
                    );
                    0
                }
            },
            None if enforce => ENFORCED_OVERRUN_TICKS,
            None => 0,
        };
        let stale_fault_ticks = ((STALE_FAULT_S * f64::from(rate_hz)).round() as u32).max(STALE_TICKS_MAX + 1);
        LimitParameters {
            force_n,
            torque_nm,
            speed_m_per_s: checks.number(
                "limits.speed_mm_per_s",
                limits.speed_mm_per_s,
                DEFAULT_SPEED_MM_PER_S,
                POSITIVE.unit("mm/s"),
            ) * MM,
            slew_n_per_s: checks.number("safety.slew_n_per_s", safety.slew_n_per_s, force_n / FULL_SLEW_S, POSITIVE.unit("N/s")),
            slew_nm_per_s: torque_nm / FULL_SLEW_S,
            power_w: checks.number("safety.power_w", safety.power_w, DEFAULT_POWER_W, POSITIVE.unit("W")),
            ramp_s: checks.number("safety.ramp_ms", safety.ramp_ms, DEFAULT_RAMP_MS, POSITIVE.to(10_000.0).unit("ms")) * 1e-3,
            stale_ticks_max: STALE_TICKS_MAX,
            stale_fault_ticks,
            overrun_fault_ticks,
        }
    }
}

/// Where the geometry of an object is written.
struct WrittenSource<'s> {
    mesh: Option<&'s str>,
    shape: Option<&'s schema::Shape>,
    units: Option<schema::UnitWord>,
}

/// Units of a stiffness: inside, and in its key.
#[derive(Clone, Copy)]
struct StiffnessUnits {
    si: &'static str,
    key: &'static str,
    key_per_si: f64,
}

const TRANSLATION_UNITS: StiffnessUnits = StiffnessUnits { si: "N/m", key: "N/mm", key_per_si: MM };
const ROTATION_UNITS: StiffnessUnits = StiffnessUnits { si: "N·m/rad", key: "N·m/rad", key_per_si: 1.0 };

/// The bounds of an arm. Axes that render nothing cannot become unstable, so they have none.
fn stability(
    profile: Option<&Profile>,
    period_s: f64,
    delay_ticks: Option<u32>,
    filter_alpha: f64,
    allow_unstable: bool,
) -> StabilityConfig {
    let bound = |axes: Axes, plant: fn(&Plant) -> (f64, f64), declared: fn(&Profile) -> Option<f64>| match profile {
        Some(profile) if has_any(profile.actuated, axes) => {
            let (mass_kg, damping_n_s_per_m) = plant(&profile.plant);
            let wall = SampledWall {
                mass_kg,
                damping_n_s_per_m,
                wall_damping_n_s_per_m: 0.0,
                period_s,
                delay_ticks: delay_ticks.unwrap_or(profile.plant.delay_ticks),
                filter_alpha,
            };
            StiffnessBound { wall, declared: declared(profile) }
        }
        _ => StiffnessBound::none(period_s),
    };
    StabilityConfig {
        translation: bound(Axes::TRANSLATION, |p| (p.mass_kg, p.damping_n_s_per_m), |p| p.limits.stiffness_n_per_m),
        rotation: bound(Axes::ROTATION, |p| (p.inertia_kg_m2, p.damping_nm_s_per_rad), |p| p.limits.stiffness_nm_per_rad),
        allow_unstable,
    }
}

/// What the tick knows of the arm: how its stiffness bound falls with delay, and how much damping may be injected.
fn arm_parameters(profile: &Profile, stability: &StabilityConfig, scale: f64) -> ArmParameters {
    let StabilityConfig { translation, rotation, allow_unstable } = *stability;
    let stiffness_lag = |bound: &StiffnessBound| {
        if bound.declared.is_none() || allow_unstable { f64::INFINITY } else { bound.wall.stiffness_lag() }
    };
    let [window_s, window_angular_s] = profile.velocity_window_ms.map(|window_ms| window_ms * 1e-3);
    let period_s = translation.wall.period_s;
    // No more than the profile can render, and no more than keeps still an arm without a hand: the velocity that it is
    // made of is as old as half its window.
    let injected = |bound: &StiffnessBound, declared: Option<f64>, window_s: f64| match declared {
        Some(declared) if bound.declared.is_some() => declared.min(bound.wall.injectable_damping(window_s)),
        _ => 0.0,
    };
    ArmParameters {
        delay_ticks: translation.wall.delay_ticks.max(rotation.wall.delay_ticks),
        stiffness_lag_n_s_per_m: stiffness_lag(&translation) / scale,
        stiffness_lag_nm_s_per_rad: stiffness_lag(&rotation),
        injected_n_s_per_m: injected(&translation, profile.limits.damping_n_s_per_m, window_s),
        injected_nm_s_per_rad: injected(&rotation, profile.limits.damping_nm_s_per_rad, window_angular_s),
        velocity_step_m_per_s: profile.plant.encoder_step_m / window_s.max(period_s),
        velocity_step_rad_per_s: profile.plant.encoder_step_rad / window_angular_s.max(period_s),
    }
}

fn sides(written: Option<schema::SidesWord>) -> SidesRule {
    match written {
        Some(schema::SidesWord::Auto) | None => SidesRule::Auto,
        Some(schema::SidesWord::Flood) => SidesRule::Flood,
        Some(schema::SidesWord::Winding) => SidesRule::Winding,
        Some(schema::SidesWord::Thin) => SidesRule::Thin,
    }
}

fn has_any(axes: Axes, of: Axes) -> bool {
    (0..7).any(|axis_idx| axes.has(axis_idx) && of.has(axis_idx))
}

fn or_if_infinite(number: f64, default: f64) -> f64 {
    if number.is_finite() { number } else { default }
}

/// Sylvester's criterion.
fn is_positive_definite(matrix: DMat3) -> bool {
    let minor = matrix.x_axis.x * matrix.y_axis.y - matrix.x_axis.y * matrix.y_axis.x;
    matrix.x_axis.x > 0.0 && minor > 0.0 && matrix.determinant() > 0.0
}
