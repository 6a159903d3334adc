//! What a recording brings along of a scene.

use std::fmt;
use std::path::{Path, PathBuf};

use serde_json::{Map, Value, json};

use crate::config::scene::{MeshSource, StaticConfig, ToolConfig};
use crate::config::{LoadOptions, SceneConfig};
use arms::profile;
use haptics::{
    ArmParameters, ContactParameters, CouplingParameters, DeviceMapping, FilterParameters,
    FrictionParameters, LimitParameters, Parameters, SafetyParameters,
};
use recording::file::{DisplayObject, DisplayShape, NamedFile, SceneFiles};
use vps::mesh::{self, primitives::Shape};
use vps::spatial::Pose;
use vps::storage::regular;

/// Everything that makes up a checked scene. Reads the scene file and the profile once more.
pub fn scene_files(config: &SceneConfig, options: &LoadOptions) -> SceneFiles {
    let toml = regular::written(&config.path).unwrap_or_default();
    let folder = config.path.parent().unwrap_or(Path::new(""));
    let table = toml.parse::<toml::Table>().unwrap_or_default();
    let named = files(&table).into_iter().map(|written| {
        let path = folder.join(&written);
        let beside = |companion: PathBuf| {
            companion.strip_prefix(path.parent().unwrap_or(Path::new(""))).map(Path::to_owned).ok()
        };
        let companions =
            mesh::companions(&path).unwrap_or_default().into_iter().filter_map(beside).collect();
        NamedFile::new(written, path, companions)
    });
    let profile = match &options.device {
        Some(given) => profile::text(given, Path::new("")),
        None => {
            profile::text(written_profile(&table).unwrap_or(&config.device.profile.name), folder)
        }
    };
    let statics = config
        .statics
        .iter()
        .map(|StaticConfig { name, source, pose, .. }| shown(name, source, *pose, false));
    let tool = shown("tool", &config.tool.source, config.parameters.mapping.start, true);
    SceneFiles {
        name: config.name.clone(),
        path: config.path.clone(),
        resolved_json: resolved(config).to_string(),
        profile_toml: profile.unwrap_or_default(),
        enforce: config.realtime.enforce,
        starts_anew: false,
        named: named.collect(),
        shown: statics.chain([tool]).collect(),
        toml,
    }
}

fn written_profile(table: &toml::Table) -> Option<&str> {
    table.get("device")?.get("profile")?.as_str()
}

/// The keys of a scene that name files.
pub(super) fn file_keys(table: &mut toml::Table) -> Vec<&mut toml::Value> {
    let mut keys = Vec::new();
    for (name, value) in table {
        match (name.as_str(), value) {
            ("static", toml::Value::Array(objects)) => {
                keys.extend(objects.iter_mut().filter_map(|object| object.get_mut("mesh")))
            }
            ("tool", tool) => keys.extend(tool.get_mut("mesh")),
            ("device", device) => keys.extend(device.get_mut("hand")),
            ("sculpt", toml::Value::Table(sculpt)) => {
                let named = ["points", "mesh", "session", "image", "strokes"];
                keys.extend(
                    sculpt
                        .iter_mut()
                        .filter(|(key, _)| named.contains(&key.as_str()))
                        .map(|(_, value)| value),
                );
            }
            _ => {}
        }
    }
    keys
}

fn files(table: &toml::Table) -> Vec<String> {
    let mut table = table.clone();
    let mut files: Vec<String> = file_keys(&mut table)
        .into_iter()
        .filter_map(|key| key.as_str().map(str::to_owned))
        .collect();
    files.sort();
    files.dedup();
    files
}

fn shown(name: &str, source: &MeshSource, pose: Pose, is_tool: bool) -> DisplayObject {
    let form = match source {
        MeshSource::File { path, metres_per_unit } => {
            DisplayShape::Mesh(path.clone(), *metres_per_unit)
        }
        MeshSource::Shape(shape) => match *shape {
            Shape::Box { size_m } => DisplayShape::Box(size_m.to_array(), [0.0; 3]),
            Shape::Sphere { radius_m } => DisplayShape::Ellipsoid([radius_m; 3]),
            Shape::Ellipsoid { radii_m } => DisplayShape::Ellipsoid(radii_m.to_array()),
            Shape::Cylinder { radius_m, height_m } => {
                DisplayShape::Cylinder(radius_m, 1.0, height_m)
            }
            Shape::Cone { radius_m, height_m } => DisplayShape::Cylinder(radius_m, 0.0, height_m),
            Shape::Plane { x_m, y_m, thickness_m } => {
                DisplayShape::Box([x_m, y_m, thickness_m], [0.0, 0.0, -0.5 * thickness_m])
            }
            Shape::Capsule { .. } | Shape::Torus { .. } => DisplayShape::Other,
        },
    };
    DisplayObject { name: name.to_owned(), pose, is_tool, form }
}

/// A word of the program as a scene file has it: `SurfacePoint` as `surface-point`.
fn scene_word(name: &impl fmt::Debug) -> String {
    let mut word = String::new();
    for letter in format!("{name:?}").chars() {
        if letter.is_uppercase() && !word.is_empty() {
            word.push('-');
        }
        word.extend(letter.to_lowercase());
    }
    word
}

/// What a scene comes to, SI. JSON has no infinity: null stands for it.
pub fn resolved(config: &SceneConfig) -> Value {
    let ToolConfig {
        source: _,
        voxel_size_m,
        layers,
        sides,
        points,
        mass_kg,
        center_of_mass_m,
        inertia_kg_m2,
    } = &config.tool;
    json!({
        "name": config.name,
        "rate_hz": config.rate_hz,
        "time_budget_s": config.time_budget_s,
        "statics": config.statics.iter().map(static_object).collect::<Vec<_>>(),
        "tool": {
            "voxel_size_m": voxel_size_m,
            "layers": layers,
            "sides": scene_word(sides),
            "points": scene_word(points),
            "mass_kg": mass_kg,
            "center_of_mass_m": center_of_mass_m.map(|center| center.to_array()),
            "inertia_kg_m2": inertia_kg_m2.map(|inertia| inertia.to_cols_array()),
        },
        "parameters": parameters(&config.parameters),
        "device": config.device.profile.name,
        "enforce": config.realtime.enforce,
    })
}

fn static_object(object: &StaticConfig) -> Value {
    let StaticConfig {
        name,
        source: _,
        voxel_size_m,
        layers,
        sides,
        pose: world_from_map,
        movable,
    } = object;
    json!({
        "name": name,
        "voxel_size_m": voxel_size_m,
        "layers": layers,
        "sides": scene_word(sides),
        "pose": pose(*world_from_map),
        "movable": movable,
    })
}

fn pose(pose: Pose) -> Value {
    json!({ "position_m": pose.translation.to_array(), "orientation_xyzw": pose.rotation.to_array() })
}

/// Every field of a group of parameters by its name, so that none is forgotten. `=` says what
/// stands for a value that JSON does not have.
macro_rules! object {
    ($group:ident($value:expr): $($field:ident $(= $shown:expr)?),+) => {{
        let $group { $($field),+ } = $value;
        $($(let $field = $shown;)?)+
        let name = |field: &str| field.trim_start_matches("r#").to_owned();
        Map::from_iter([$((name(stringify!($field)), json!($field))),+])
    }};
}

/// Every parameter of the tick.
fn parameters(p: &Parameters) -> Map<String, Value> {
    let mut parameters = object! { Parameters(p):
        period_s, gravity_m_per_s2 = gravity_m_per_s2.to_array(),
        contact = object! { ContactParameters(contact):
            field = scene_word(field), stiffness_n_per_m, damping_ratio,
            normalization = scene_word(normalization),
            friction = object! { FrictionParameters(friction):
                r#static, dynamic, stiffness_n_per_m
            },
            damping_n_s_per_m, braking
        },
        coupling = object! { CouplingParameters(coupling):
            mode = scene_word(mode), stiffness_n_per_m, stiffness_nm_per_rad,
            felt_damping_n_s_per_m, felt_damping_nm_s_per_rad, clamp = scene_word(clamp),
            free_space = scene_word(free_space), bound_n_per_m, bound_nm_per_rad
        },
        filter = object! { FilterParameters(filter): cutoff_hz },
        limits = object! { LimitParameters(limits):
            force_n, torque_nm, speed_m_per_s, slew_n_per_s, slew_nm_per_s, power_w, ramp_s,
            stale_ticks_max, stale_fault_ticks, overrun_fault_ticks, stall_s
        },
        safety = object! { SafetyParameters(safety):
            deadman, workspace_radius_m, brake_s, engage_share, engage_ticks, power_window_s,
            stuck_move_m, stuck_turn_rad
        },
        mapping = object! { DeviceMapping(mapping):
            world_from_device = pose(*world_from_device), scale,
            sensed = sensed.names().collect::<Vec<_>>(),
            actuated = actuated.names().collect::<Vec<_>>(), start = pose(*start)
        },
        arm = object! { ArmParameters(arm):
            delay_ticks, stiffness_lag_n_s_per_m, stiffness_lag_nm_s_per_rad, injected_n_s_per_m,
            injected_nm_s_per_rad, stable_damping_n_s_per_m, stable_damping_nm_s_per_rad,
            velocity_age_ticks, velocity_step_m_per_s, velocity_step_rad_per_s, encoder_step_m,
            encoder_step_rad
        }
    };
    // Its name in recordings of every version.
    let port = parameters.remove("mapping").map(|port| ("port".to_owned(), port));
    parameters.extend(port);
    parameters
}
