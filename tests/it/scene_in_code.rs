//! A scene built in code is the scene that its file gives.

use glam::DVec3;
use hapticd::config::SceneConfig;
use haptics::{RenderScene, SceneBuilder, ToolOptions};
use vps::mesh::primitives::Shape;
use vps::mesh::{self, TriangleMesh};
use vps::part::Part;
use vps::voxmap::Options;

use super::rig;

/// Moves the tool of `config` into its parts and through them, a thousand ticks long; all bits that
/// the arm and a viewer see.
fn thousand_ticks(scene: &RenderScene) -> Vec<u64> {
    use haptics::{DriveRequest, State, TickInput, tick};
    use vps::spatial::{DeviceSample, Pose, SampleStatus};

    let mut state = State::new(scene);
    let mut bits = Vec::new();
    let mut contacts = 0;
    for n in 0..1000_u32 {
        let pose = Pose::from_translation(DVec3::new(1e-6, 2e-6, -12e-6) * f64::from(n));
        let sample = DeviceSample {
            pose,
            sequence: 1 + u64::from(n),
            status: SampleStatus::Fresh,
            ..DeviceSample::default()
        };
        let output = tick(
            scene,
            &mut state,
            &TickInput { sample, request: DriveRequest::Enable, ..TickInput::default() },
        );
        let tool = output.world_from_tool;
        let command = output.command_device;
        let contact = output.contact_world;
        let numbers =
            [command.force, command.torque, contact.force, contact.torque, tool.translation];
        bits.extend(
            numbers
                .iter()
                .flat_map(|vector| vector.to_array())
                .chain(tool.rotation.to_array())
                .map(f64::to_bits),
        );
        bits.push(u64::from(output.contacts) << 32 | u64::from(output.faults.bits()));
        contacts += output.contacts;
    }
    assert!(contacts > 0, "nothing was touched");
    bits
}

/// The same parts as those of `config`, by typed values alone.
fn in_code(
    config: &SceneConfig,
    wedge: TriangleMesh,
) -> (RenderScene, Vec<vps::part::ObjectReport>) {
    let mut builder = SceneBuilder::new(config.parameters);
    // As thick as the file makes it: four bands of eight layers.
    let plane = Shape::Plane { x_m: 60e-3, y_m: 60e-3, thickness_m: 4.0 * (9.5 * 1e-3) };
    let fine = Options::new(1e-3);
    builder
        .add_part(&Part::of_shape("plane", &plane, 1e-3), &fine, config.statics[0].pose)
        .unwrap();
    builder
        .add_part(
            &Part::new("wedge", wedge),
            &Options { layers: 4, ..fine },
            config.statics[1].pose,
        )
        .unwrap();
    let block =
        Part::of_shape("tool", &Shape::Box { size_m: DVec3::new(10e-3, 8e-3, 6e-3) }, 1.5e-3);
    builder
        .finish(&block, &Options { layers: 4, ..Options::new(1.5e-3) }, &ToolOptions::new(0.05))
        .unwrap()
}

#[test]
fn a_scene_in_code_gives_the_bits_of_its_file() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("wedge.obj");
    std::fs::write(
        &file,
        "v 0 0 0\nv 12 0 0\nv 0 9 0\nv 1 2 8\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n",
    )
    .unwrap();
    for field in ["trilinear", "surface-point"] {
        let config = rig::written(&format!(
            r#"version = 1
[rendering]
field = "{field}"
[[static]]
name = "plane"
shape = {{ plane_mm = [60.0, 60.0] }}
voxel_size_mm = 1.0
[[static]]
name = "wedge"
mesh = {file:?}
units = "mm"
voxel_size_mm = 1.0
layers = 4
position_mm = [2.0, 1.0, 0.0]
[tool]
shape = {{ box_mm = [10.0, 8.0, 6.0] }}
voxel_size_mm = 1.5
mass_g = 50.0
start_position_mm = [0.0, 0.0, 15.0]
[device]
profile = "sim-sigma7"
"#
        ));
        let (by_file, file_reports) = hapticd::scene::build(&config, |_| ()).unwrap();
        let (by_code, code_reports) = in_code(&config, mesh::load(&file, 1e-3).unwrap());
        assert_eq!(thousand_ticks(&by_file), thousand_ticks(&by_code), "{field}");
        let reported = |reports: &[vps::part::ObjectReport]| -> Vec<_> {
            reports
                .iter()
                .map(|report| {
                    (
                        report.name.clone(),
                        report.surface_voxels,
                        report.points,
                        report.warnings.clone(),
                    )
                })
                .collect()
        };
        assert_eq!(reported(&file_reports), reported(&code_reports), "{field}");
    }
}
