//! Third pass: checks what is written, fills in what is not, and converts to SI.

mod arm;
mod contact_stiffness;
mod forces;
mod monitor;
mod objects;
mod sculpt;

use std::path::Path;

use glam::DVec3;

pub(super) use self::contact_stiffness::DEFAULT_CONTACT_N_PER_MM3;
pub(crate) use self::monitor::{FOXGLOVE_ACCEPTED, LISTEN_ACCEPTED, parse_foxglove, parse_listen};
pub(crate) use self::sculpt::{RASTER_AXIS, RASTER_NODES};
use super::scene::{DeviceConfig, SceneConfig};
use super::schema;
use super::setting_names::KEYS;
use arms::attached::nodes::Selector;
use arms::profile::{SlowLink, is_profile};
use clay::session::is_session;
use document::{Checks, ConfigErrors, Document, GoneKey, Interval, Problem, ProblemKind};
use engine::arm_rules::{StabilityBounds, arm_parameters};
use haptics::filter::low_pass_alpha;
use haptics::{CouplingMode, DeviceMapping, Parameters};
use vps::mesh::{self, Format};
use vps::spatial::Pose;
use vps::storage::regular;
use vps::voxmap::field::FieldKind;

/// What the command line sets over the scene.
#[derive(Clone, Debug, Default)]
pub struct LoadOptions {
    /// `run --device PROFILE`: instead of `device.profile`; a path is relative to the working
    /// directory.
    pub device: Option<String>,
    /// `run --selector`: instead of `device.selector`.
    pub selector: Option<Selector>,
    /// `run --realtime MODE`: instead of `realtime.mode`; true for `enforce`.
    pub enforce: Option<bool>,
    /// `run --hand-repeat`: the simulated hand goes its path there and back, again and again.
    pub hand_repeat: bool,
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
    if let Some(format) = mesh::cad_format(path) {
        let hint = Some(mesh::cad_hint(&KEYS));
        return Err(of_file(ProblemKind::Refused { why: mesh::curved_surfaces(format), hint }));
    }
    if is_session(path) {
        return Err(of_file(ProblemKind::IsSession));
    }
    let text =
        regular::written(path).map_err(|cause| of_file(ProblemKind::Unreadable { cause }))?;
    let mut document = Document::parse(path, &text)?;
    if is_profile(path) {
        return Err(of_file(ProblemKind::IsProfile));
    }
    if schema::holds_strokes(&document) {
        return Err(of_file(ProblemKind::IsStrokes));
    }
    let gone = document.take_gone(&GONE);
    let (scene, mut problems) = document.read_around::<schema::Scene>();
    problems.extend(gone);
    let Some(scene) = scene else { return Err(ConfigErrors::new(problems)) };
    let dir = path.parent().unwrap_or(Path::new(""));
    let mut resolve = Resolve { checks: Checks::new(&document), document: &document, dir };
    let config = resolve.scene(path, scene, options);
    let checked = resolve.checks.finish();
    if !problems.is_empty() {
        // What follows from a wrong key is not judged; a file that is not there is.
        let names = checked
            .err()
            .into_iter()
            .flat_map(ConfigErrors::into_problems)
            .filter(Problem::is_missing);
        return Err(ConfigErrors::new(problems.into_iter().chain(names).collect()));
    }
    checked?;
    match config {
        Some(config) => Ok(config),
        // What is not there is a problem, so `finish` has returned already.
        None => Err(ConfigErrors::new(vec![Problem::of_file(
            path,
            ProblemKind::Missing { accepted: "a device profile and a tool".into() },
        )])),
    }
}

/// Keys of version 0.1.0 that nothing varied, that said what a flag says, or whose rule follows from
/// the law.
const GONE: [GoneKey; 6] = [
    GoneKey {
        key: "device.sim.hand_repeat",
        now: "false",
        instead: "leave it out, and write --hand-repeat on the command line",
    },
    GoneKey {
        key: "device.sim.seed",
        now: "0",
        instead: "leave it out: chance has the seed 0, so that every run of a scene is the same",
    },
    GoneKey {
        key: "device.sim.jitter_us",
        now: "",
        instead: "leave it out: no version has read it",
    },
    GoneKey {
        key: "contact.geometric_awareness",
        now: "\"edges\"",
        instead: "leave it out: facets count by what of them is immersed, which edges push by; \
            tool.points = \"voxels\" pushes along the normals of points",
    },
    GoneKey {
        key: "filter.spatial",
        now: "true",
        instead: "leave it out: what a facet presses begins smoothly, as less of it is immersed; \
            tool.points = \"voxels\" has the sum over points",
    },
    GoneKey {
        key: "sculpt.integrator",
        now: "\"implicit\"",
        instead: "leave it out: mass points are stepped implicitly, which is stable at every \
            stiffness",
    },
];

const DEFAULT_RATE_HZ: u32 = 1000;

pub(super) const MM: f64 = 1e-3;
const SIZE_MM: Interval = Interval::above(0.0).to(1e6).unit("mm");

/// One document on its way through the third pass.
pub(super) struct Resolve<'d> {
    pub(super) checks: Checks<'d>,
    pub(super) document: &'d Document<'d>,
    /// Folder that paths of the document are relative to.
    pub(super) dir: &'d Path,
}

impl Resolve<'_> {
    /// `None` without a usable profile or a tool, which is then among the problems.
    fn scene(
        &mut self,
        path: &Path,
        scene: schema::Scene,
        options: &LoadOptions,
    ) -> Option<SceneConfig> {
        let name = scene
            .name
            .unwrap_or_else(|| path.file_stem().unwrap_or_default().to_string_lossy().into_owned());
        let rate_hz = self.checks.whole(
            "rendering.rate_hz",
            scene.rendering.rate_hz,
            DEFAULT_RATE_HZ,
            100,
            10_000,
        );
        let period_s = f64::from(rate_hz).recip();

        self.unique_names(&scene.statics);
        let statics = scene
            .statics
            .iter()
            .enumerate()
            .map(|(index, object)| self.static_object(index, object))
            .collect();
        let tool_written = scene.tool.as_ref();
        let tool = tool_written.map(|tool| self.tool(tool));
        if tool.is_none() {
            self.checks.missing(
                "tool",
                "a [tool] table with the moving object: mesh and units, or shape; voxel_size_mm",
            );
        }
        let realtime = self.realtime(&scene.realtime, options);
        let filter = self.filter(&scene.filter);
        let sim = self.sim(&scene.device, options);
        let hand = scene
            .device
            .hand
            .as_deref()
            .and_then(|hand| self.checks.file("device.hand", hand, self.dir));
        let profile = self.profile(&scene.device, options);
        if let Some(slow @ SlowLink::Rate { most_hz, .. }) =
            profile.as_ref().and_then(|profile| profile.link_carries(rate_hz).err())
        {
            let hint = Some(format!("write {most_hz} or less"));
            let why = slow.to_string();
            self.checks.refuse("rendering.rate_hz", ProblemKind::Refused { why, hint });
        }
        let selector = self.selector(&scene.device, options);
        let port_scale = self.scale(&scene.device.world_from_device);
        let world_from_device = Pose::new(
            self.checks.orientation(
                "device.world_from_device.orientation_xyzw",
                scene.device.world_from_device.orientation_xyzw,
            ),
            self.checks.position(
                "device.world_from_device.position_mm",
                scene.device.world_from_device.position_mm,
            ) * MM,
        );
        let start = Pose::new(
            self.checks.orientation(
                "tool.start_orientation_xyzw",
                tool_written.and_then(|tool| tool.start_orientation_xyzw),
            ),
            self.checks.position(
                "tool.start_position_mm",
                tool_written.and_then(|tool| tool.start_position_mm),
            ) * MM,
        );
        let gravity = Interval::from(-100.0).to(100.0).unit("m/s²");
        let gravity_m_per_s2 = self
            .checks
            .array("rendering.gravity_m_per_s2", scene.rendering.gravity_m_per_s2, gravity)
            .map_or(DVec3::ZERO, DVec3::from_array);

        // Without a profile, the keys that need one are still checked for themselves, against an
        // arm that bounds nothing.
        let mode = scene.rendering.coupling.map_or(CouplingMode::Implicit, Into::into);
        if mode == CouplingMode::Direct && gravity_m_per_s2 != DVec3::ZERO {
            let accepted = "zero: without a virtual tool, nothing has weight in \"direct\"";
            self.checks.not_available("rendering.gravity_m_per_s2", accepted);
        }
        let allow_unstable = scene.rendering.allow_unstable.unwrap_or(false);
        // The filter lies in the arm's loop in `direct` only; its lowest cut-off lags most.
        let filter_alpha = if mode == CouplingMode::Direct {
            low_pass_alpha(filter.cutoff_hz[0], period_s)
        } else {
            0.0
        };
        let stability = StabilityBounds::of(
            profile.as_ref(),
            period_s,
            sim.delay_ticks,
            filter_alpha,
            allow_unstable,
        );
        let coupling =
            self.coupling(&scene.coupling, mode, &stability, port_scale, profile.as_ref());
        let field = scene.rendering.field.map_or(FieldKind::Trilinear, Into::into);
        // In `direct` the arm feels each point of the tool.
        let of_points =
            Some(&stability).filter(|_| mode == CouplingMode::Direct && !allow_unstable);
        let point_stiffness =
            self.point_stiffness(&scene.contact, tool_written, of_points, port_scale);
        let contact = self.contact(&scene.contact, field, mode, point_stiffness.n_per_m);
        let limits =
            self.limits(&scene.limits, &scene.safety, profile.as_ref(), rate_hz, realtime.enforce);
        let safety = self.safety(&scene.safety, profile.as_ref(), period_s);

        let time_budget_s = self
            .checks
            .optional(
                "contact.time_budget_us",
                scene.contact.time_budget_us,
                Interval::from(10.0).to(1e4).unit("µs"),
            )
            .map(|us| us * 1e-6);
        if time_budget_s.is_some() && field != FieldKind::Trilinear {
            self.checks.not_available(
                "contact.time_budget_us",
                "remove it, or use rendering.field = \"trilinear\"",
            );
        }

        let sculpt = scene.sculpt.as_ref().map(|sculpt| self.sculpt(sculpt, rate_hz, mode));
        let monitor = self.monitor(&scene.monitor);
        let heartbeat = self.heartbeat(&scene.safety);

        let profile = profile?;
        let tool = tool?;
        let arm = arm_parameters(&profile, &stability, port_scale);
        let mapping = DeviceMapping {
            world_from_device,
            scale: port_scale,
            sensed: profile.sensed,
            actuated: profile.actuated,
            start,
        };
        Some(SceneConfig {
            files: self.checks.files().to_vec(),
            path: path.to_path_buf(),
            name,
            rate_hz,
            time_budget_s,
            stiffness_key: point_stiffness.key,
            statics,
            tool,
            sculpt,
            parameters: Parameters {
                period_s,
                gravity_m_per_s2,
                contact,
                coupling,
                filter,
                limits,
                safety,
                mapping,
                arm,
            },
            device: DeviceConfig { profile, selector, hand, sim },
            realtime,
            stability,
            monitor,
            heartbeat,
        })
    }
}
