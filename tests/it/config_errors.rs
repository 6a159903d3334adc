//! The commonest mistakes in a scene, with the exact words that answer them.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use hapticd::config::scene::StiffnessKey;
use hapticd::config::{self, ConfigErrors, LoadOptions, ProblemKind, SceneConfig};
use haptics::CouplingMode;
use vps::mesh::primitives::Shape;
use vps::voxmap::inside_test::InsideTest;

const SCENE: &str = r#"version = 1

[rendering]
rate_hz = 1000

[[static]]
name = "base"
mesh = "base.obj"
units = "mm"
voxel_size_mm = 0.5
layers = 8
orientation_xyzw = [0, 0, 0, 1]

[[static]]
name = "floor"
shape = { plane_mm = [60, 40] }
voxel_size_mm = 1

[tool]
shape = { sphere_mm = 5 }
voxel_size_mm = 0.5
start_position_mm = [0, 0, 40]

[device]
profile = "sim-sigma7"
"#;

/// Loads a scene from a folder that holds a mesh.
fn load(scene: &str) -> Result<SceneConfig, ConfigErrors> {
    load_with(scene, &LoadOptions::default())
}

fn load_with(scene: &str, options: &LoadOptions) -> Result<SceneConfig, ConfigErrors> {
    let dir = tempfile::tempdir().unwrap();
    write_into(dir.path(), scene);
    config::load_with(&dir.path().join("scene.toml"), options)
}

fn write_into(dir: &Path, scene: &str) {
    fs::write(dir.join("base.obj"), "v 0 0 0\nv 9 0 0\nv 0 9 0\nf 1 2 3\n").unwrap();
    fs::write(dir.join("scene.toml"), scene).unwrap();
}

#[test]
fn a_table_that_there_is_once_is_not_written_as_one_of_many() {
    for table in [
        "rendering",
        "tool",
        "contact",
        "coupling",
        "filter",
        "limits",
        "safety",
        "device",
        "realtime",
        "monitor",
        "sculpt",
    ] {
        let rest = "[[static]]\nshape = { plane_mm = [60, 40] }\nvoxel_size_mm = 1\n";
        for (repeats, line) in [(1, 2), (2, 2), (30, 2)] {
            let tables = format!("[[{table}]]\n").repeat(repeats);
            let errors = load(&format!("version = 1\n{tables}{rest}")).unwrap_err();
            let problem = &errors.problems()[0];
            assert_eq!(problem.line, Some(line), "{errors}");
            let expected =
                format!("{table}: is one table: write [{table}], once, in place of [[{table}]]");
            assert!(problem.to_string().ends_with(&expected), "{errors}");
        }
    }
    let inner = refusal(
        "version = 1\n[device]\nprofile = \"sim-sigma7\"\n[[device.sim]]\nhand = \"none\"\n",
    );
    assert!(
        inner.contains(
            ":4: device.sim: is one table: write [device.sim], once, in place of [[device.sim]]"
        ),
        "{inner}"
    );
    // What is a list, and what is no table, has the words that it had.
    assert!(
        refusal("version = 1\ntool = 3\n").contains("tool = 3: must be a table, written [tool]")
    );
}

/// The message about a scene, without the folder of the test.
fn refusal(scene: &str) -> String {
    let dir = tempfile::tempdir().unwrap();
    write_into(dir.path(), scene);
    let errors = config::load(&dir.path().join("scene.toml")).unwrap_err();
    errors.to_string().replace(&format!("{}/", dir.path().display()), "")
}

/// The scene with one passage replaced.
fn with(passage: &str, replacement: &str) -> String {
    assert_eq!(SCENE.matches(passage).count(), 1, "`{passage}` stands once in the scene");
    SCENE.replace(passage, replacement)
}

#[test]
fn the_scene_that_the_mistakes_are_made_in_is_sound() {
    if let Err(errors) = load(SCENE) {
        panic!("{errors}");
    }
}

macro_rules! mistakes {
    ($($name:ident: $scene:expr => $message:expr;)+) => { $(
        #[test]
        fn $name() {
            let scene = $scene;
            assert_eq!(refusal(&scene), $message);
        }
    )+ };
}

mistakes! {
    malformed_toml: with("units = \"mm\"", "units = \"mm") => r#"error: scene.toml:9: not TOML: invalid basic string, expected `"`"#;
    a_decimal_comma: with("voxel_size_mm = 0.5\nlayers", "voxel_size_mm = 0,5\nlayers") => r"error: scene.toml:10: not TOML: unexpected key or value, expected newline, `#`
  hint: a decimal point, not a comma";
    a_comma_at_the_end: with("layers = 8", "layers = 8,") => "error: scene.toml:11: not TOML: \
        unexpected key or value, expected newline, `#`";
    a_key_given_twice: with("layers = 8", "layers = 8\nlayers = 9") => "error: scene.toml:12: not \
        TOML: duplicate key";
    missing_version: with("version = 1\n", "") => r"error: scene.toml: version: missing; this program reads version 1
  hint: write `version = 1` as the first line";
    wrong_version: with("version = 1\n", "version = 2\nfuture_key = true\n") => "error: \
        scene.toml:1: version = 2: unknown version; this program reads version 1";
    unknown_key: with("voxel_size_mm = 0.5\nlayers", "voxelsize_mm = 0.5\nlayers") => r"error: scene.toml:10: static[0].voxelsize_mm = 0.5: unknown key; did you mean `voxel_size_mm`?
  hint: known here: name, mesh, shape, units, voxel_size_mm, layers, position_mm, orientation_xyzw, movable, sides";
    unknown_key_like_no_other: with("[rendering]", "[rendering]\ncolour = \"red\"") => r#"error: scene.toml:4: rendering.colour = "red": unknown key
  hint: known here: rate_hz, coupling, field, gravity_m_per_s2, allow_unstable"#;
    files_that_are_not_there_are_reported_beside_unknown_keys: with("layers = 8", "laiers = 8").replace("base.obj", "gone.obj").replace("sim-sigma7", "sim-sigma") => r#"error: scene.toml:8: static[0].mesh = "gone.obj": no such file: gone.obj
  hint: paths are relative to the file that names them
error: scene.toml:11: static[0].laiers = 8: unknown key; did you mean `layers`?
  hint: known here: name, mesh, shape, units, voxel_size_mm, layers, position_mm, orientation_xyzw, movable, sides
error: scene.toml:25: device.profile = "sim-sigma": no device profile of this name; did you mean `sim-sigma7`?
  hint: known profiles: delta3, falcon-fd, hapkit, haply-2diy, haply-2diy-first, haply-2diy-v2, haptikfabriken-aluhaptics2, haptikfabriken-woodenhaptics, inverse3, inverse3-no-grip, lambda7, leader-arm-6, novint-falcon, omega3, omega6, omega7, open6-hid, open6-serial, phantom-desktop, phantom-omni, polhem-2019, polhem-2020, polhem-2022, polhem-v1, premium15-6dof, premium30-6dof, sigma7, sim-2diy, sim-delta3, sim-desktop, sim-falcon, sim-ideal, sim-inverse3, sim-lambda7, sim-omega3, sim-omega6, sim-omega7, sim-omni, sim-polhem, sim-premium15-6dof, sim-premium30-6dof, sim-sigma7, sim-touch, sim-woodenhaptics, spacemouse, spacenav, touch, touch-x, vintage-2022, virtuose-6d, woodenhaptics-2022, woodenhaptics-v15; a path has a `/` or ends in .toml"#;
    unknown_table: with("[tool]", "[tol]") => r"error: scene.toml:19: tol: unknown key; did you mean `tool`?
  hint: known here: version, name, rendering, static, tool, contact, coupling, filter, limits, safety, device, realtime, monitor, sculpt";
    static_as_a_single_table: "version = 1\n[static]\nname = \"base\"\n".to_owned() => r"error: scene.toml:2: static: must be an array
  hint: write each static object as its own [[static]] table";
    wrong_unit: with("units = \"mm\"", "units = \"millimetres\"") => r#"error: scene.toml:9: static[0].units = "millimetres": must be "m", "mm", "cm" or "in"; did you mean `mm`?"#;
    wrong_type: with("rate_hz = 1000", "rate_hz = \"1 kHz\"") => r#"error: scene.toml:4: rendering.rate_hz = "1 kHz": must be a whole number, 0 or more"#;
    fraction_where_a_count_is_wanted: with("layers = 8", "layers = 8.5") => "error: scene.toml:11: \
        static[0].layers = 8.5: must be a whole number, 0 or more";
    position_of_two_numbers: with("[0, 0, 40]", "[0, 40]") => "error: scene.toml:22: \
        tool.start_position_mm = [0, 40]: must be an array of 3 numbers";
    position_with_a_word: with("[0, 0, 40]", "[0, 0, \"forty\"]") => r#"error: scene.toml:22: tool.start_position_mm[2] = "forty": must be a number"#;
    orientation_of_five_numbers: with("[0, 0, 0, 1]", "[0, 0, 0, 1, 0]") => "error: scene.toml:12: \
        static[0].orientation_xyzw = [0, 0, 0, 1, 0]: must be an array of 4 numbers";
    zero_voxel_size: with("voxel_size_mm = 0.5\nlayers", "voxel_size_mm = 0.0\nlayers") => "error: scene.toml:10: static[0].voxel_size_mm = 0.0: must be greater than 0 and at most 1000 mm";
    negative_voxel_size: with("voxel_size_mm = 1\n", "voxel_size_mm = -1\n") => "error: \
        scene.toml:17: static[1].voxel_size_mm = -1: must be greater than 0 and at most 1000 mm";
    voxel_size_not_a_number: with("voxel_size_mm = 0.5\nlayers", "voxel_size_mm = nan\nlayers") => "error: scene.toml:10: static[0].voxel_size_mm = nan: must be greater than 0 and at most 1000 mm";
    voxel_size_in_the_wrong_unit: with("voxel_size_mm = 1\n", "voxel_size_mm = 2500\n") => "error: scene.toml:17: static[1].voxel_size_mm = 2500: must be greater than 0 and at most 1000 mm";
    missing_tool: SCENE[..SCENE.find("[tool]").unwrap()].to_owned() => "error: scene.toml: tool: \
        missing; give a [tool] table with the moving object: mesh and units, or shape; \
        voxel_size_mm";
    missing_voxel_size: with("voxel_size_mm = 1\n", "") => "error: scene.toml:14: \
        static[1].voxel_size_mm: missing; give a number: greater than 0 and at most 1000 mm";
    infinite_position: with("[0, 0, 40]", "[0, 0, inf]") => "error: scene.toml:22: \
        tool.start_position_mm[2] = inf: must be finite";
    missing_mesh_file: with("base.obj", "bse.obj") => r#"error: scene.toml:8: static[0].mesh = "bse.obj": no such file: bse.obj
  hint: did you mean `base.obj`? paths are relative to the file that names them"#;
    mesh_of_another_format: with("base.obj", "base.step") => r#"error: scene.toml:8: static[0].mesh = "base.step": STEP files hold curved surfaces, and a mesh of triangles is needed
  hint: convert it: `gmsh PART.step -2 -clmax 1 -o PART.stl` (edges of at most 1 mm), or FreeCAD with File, Export; then name the .stl, and mm as `units`"#;
    mesh_of_an_unknown_format: with("base.obj", "base.dae") => r#"error: scene.toml:8: static[0].mesh = "base.dae": must be a mesh file whose name ends in .obj, .stl, .ply, .gltf, .glb or .3mf"#;
    missing_mesh_file_of_another_format: with("base.obj", "base.GLB") => r#"error: scene.toml:8: static[0].mesh = "base.GLB": no such file: base.GLB
  hint: paths are relative to the file that names them"#;
    missing_units: with("units = \"mm\"\n", "") => r#"error: scene.toml:6: static[0].units: missing; give the unit of the mesh file: "m", "mm", "cm" or "in"
  hint: a mesh file does not say its unit; a wrong guess is a factor of 1000"#;
    both_mesh_and_shape: with("units = \"mm\"", "units = \"mm\"\nshape = { sphere_mm = 3 }") => "error: scene.toml:10: static[0].shape = { sphere_mm = 3 }: cannot stand beside static[0].mesh; give exactly one of the two";
    neither_mesh_nor_shape: with("shape = { plane_mm = [60, 40] }\n", "") => "error: \
        scene.toml:14: static[1].mesh: missing; give a mesh file, or a shape such as shape = { \
        box_mm = [60, 40, 10] }";
    two_shapes_at_once: with("{ sphere_mm = 5 }", "{ sphere_mm = 5, box_mm = [1, 2, 3] }") => "error: scene.toml:20: tool.shape = { sphere_mm = 5, box_mm = [1, 2, 3] }: must be exactly one of box_mm, sphere_mm, ellipsoid_mm, cylinder_mm, cone_mm, capsule_mm, torus_mm and plane_mm";
    unknown_shape: with("{ sphere_mm = 5 }", "{ spere_mm = 5 }") => r"error: scene.toml:20: tool.shape.spere_mm = 5: unknown key; did you mean `sphere_mm`?
  hint: known here: box_mm, sphere_mm, ellipsoid_mm, cylinder_mm, cone_mm, capsule_mm, torus_mm, plane_mm";
    shape_as_a_word: with("{ sphere_mm = 5 }", "\"sphere\"") => r#"error: scene.toml:20: tool.shape = "sphere": must be a table with one shape, such as { box_mm = [60, 40, 10] } or { sphere_mm = 8 }"#;
    flat_box: with("{ sphere_mm = 5 }", "{ box_mm = [20, 20, 0] }") => "error: scene.toml:20: \
        tool.shape.box_mm[2] = 0: must be greater than 0 and at most 1000000 mm";
    torus_without_a_hole: with("{ sphere_mm = 5 }", "{ torus_mm = [5, 20] }") => "error: \
        scene.toml:20: tool.shape.torus_mm = [5, 20]: must be [R, r] with the tube radius r below \
        the ring radius R";
    duplicate_names: with("\"floor\"", "\"base\"") => r#"error: scene.toml:15: static[1].name = "base": this name was given before, in line 7; names of static objects must differ"#;
    unknown_sides: with("layers = 8", "sides = \"windng\"") => r#"error: scene.toml:11: static[0].sides = "windng": must be "auto", "flood", "winding" or "thin"; did you mean `winding`?"#;
    sides_of_another_type: with("[tool]", "[tool]\nsides = 1") => r#"error: scene.toml:20: tool.sides = 1: must be "auto", "flood", "winding" or "thin""#;
    layers_out_of_range: with("layers = 8", "layers = 100") => "error: scene.toml:11: \
        static[0].layers = 100: must be a whole number from 2 to 60";
    part_with_one_layer: with("layers = 8", "layers = 1") => "error: scene.toml:11: \
        static[0].layers = 1: must be a whole number from 2 to 60";
    tool_with_one_layer: with("[tool]", "[tool]\nlayers = 1") => "error: scene.toml:20: \
        tool.layers = 1: must be a whole number from 2 to 60";
    quaternion_of_zeros: with("[0, 0, 0, 1]", "[0, 0, 0, 0]") => "error: scene.toml:12: \
        static[0].orientation_xyzw = [0, 0, 0, 0]: must be a unit quaternion [x, y, z, w]; its \
        length is 0, which may be off 1 by at most 0.001";
    quaternion_in_degrees: with("[0, 0, 0, 1]", "[0, 0, 90, 1]") => "error: scene.toml:12: \
        static[0].orientation_xyzw = [0, 0, 90, 1]: must be a unit quaternion [x, y, z, w]; its \
        length is 90.0056, which may be off 1 by at most 0.001";
    impossible_inertia: with("[tool]", "[tool]\ninertia_kg_mm2 = [1, 1, 3, 0, 0, 0]") => "error: scene.toml:20: tool.inertia_kg_mm2 = [1, 1, 3, 0, 0, 0]: must be [xx, yy, zz, xy, xz, yz] of a real body: positive, and no principal moment above the sum of the other two";
    missing_profile: with("sim-sigma7", "sim-sigma") => r#"error: scene.toml:25: device.profile = "sim-sigma": no device profile of this name; did you mean `sim-sigma7`?
  hint: known profiles: delta3, falcon-fd, hapkit, haply-2diy, haply-2diy-first, haply-2diy-v2, haptikfabriken-aluhaptics2, haptikfabriken-woodenhaptics, inverse3, inverse3-no-grip, lambda7, leader-arm-6, novint-falcon, omega3, omega6, omega7, open6-hid, open6-serial, phantom-desktop, phantom-omni, polhem-2019, polhem-2020, polhem-2022, polhem-v1, premium15-6dof, premium30-6dof, sigma7, sim-2diy, sim-delta3, sim-desktop, sim-falcon, sim-ideal, sim-inverse3, sim-lambda7, sim-omega3, sim-omega6, sim-omega7, sim-omni, sim-polhem, sim-premium15-6dof, sim-premium30-6dof, sim-sigma7, sim-touch, sim-woodenhaptics, spacemouse, spacenav, touch, touch-x, vintage-2022, virtuose-6d, woodenhaptics-2022, woodenhaptics-v15; a path has a `/` or ends in .toml"#;
    missing_profile_file: with("sim-sigma7", "arms/mine.toml") => r#"error: scene.toml:25: device.profile = "arms/mine.toml": no such file: arms/mine.toml
  hint: paths are relative to the file that names them"#;
    missing_hand_file: with("profile =", "hand = \"hands/insert.csv\"\nprofile =") => r#"error: scene.toml:25: device.hand = "hands/insert.csv": no such file: hands/insert.csv
  hint: paths are relative to the file that names them"#;
    unknown_fault: SCENE.to_owned() + "[device.sim]\nfault = \"unplugged@2s\"\n" => r#"error: scene.toml:27: device.sim.fault = "unplugged@2s": must be "drop", "stall", "deaf", "nan", "garbage", "unplug", "slow", "stuck", "jump", "truncate", "lost-byte", "repeat", "reorder", "sign-flip", "saturate", "unhome", "skip", "no-velocity" or "press"; did you mean `unplug`?"#;
    hand_and_no_hand: with("profile =", "hand = \"base.obj\"\nprofile =") + "[device.sim]\nhand = \"none\"\n" => r#"error: scene.toml:28: device.sim.hand = "none": cannot stand beside device.hand; give exactly one of the two"#;
    unknown_coupling: with("rate_hz = 1000", "coupling = \"implict\"") => r#"error: scene.toml:4: rendering.coupling = "implict": must be "implicit", "constraint" or "direct"; did you mean `implicit`?"#;
    coupling_of_0_1_0: with("rate_hz = 1000", "coupling = \"semi-implicit\"") => r#"error: scene.toml:4: rendering.coupling = "semi-implicit": must be "implicit", "constraint" or "direct"; did you mean `implicit`?"#;
    coupling_that_went: with("rate_hz = 1000", "coupling = \"static\"") => r#"error: scene.toml:4: rendering.coupling = "static": must be "implicit", "constraint" or "direct""#;
    bad_enum_value_of_another_type: SCENE.to_owned() + "[realtime]\nmode = true\n" => r#"error: scene.toml:27: realtime.mode = true: must be "best-effort" or "enforce""#;
    stiffness_above_the_bound: SCENE.to_owned() + "[coupling]\ntranslation_n_per_mm = \
        5\nrotation_nm_per_rad = 1.2\n" => r"error: scene.toml:27: coupling.translation_n_per_mm = 5: the arm would feel 5000 N/m, above its stability bound of 4000 N/m = min(0.8 b / (T/2 + delay), declared 4000) with b = 7.5, T = 1 ms, delay = 1 tick
  hint: write at most 4 N/mm, leave the key out to get the bound itself, or set rendering.allow_unstable = true
error: scene.toml:28: coupling.rotation_nm_per_rad = 1.2: the arm would feel 1.2 N·m/rad, above its stability bound of 1 N·m/rad = min(0.8 b / (T/2 + delay), declared 1) with b = 0.001875, T = 1 ms, delay = 1 tick
  hint: write at most 1 N·m/rad, leave the key out to get the bound itself, or set rendering.allow_unstable = true";
    stiffness_above_the_bound_of_a_scaled_and_delayed_arm: with("profile =", "world_from_device = \
        { scale = 2 }\nsim = { delay_ticks = 3 }\nprofile =") + "[coupling]\ntranslation_n_per_mm = 2\n" => r"error: scene.toml:29: coupling.translation_n_per_mm = 2: the arm would feel 4000 N/m, above its stability bound of 1714.29 N/m = min(0.8 b / (T/2 + delay), declared 4000) with b = 7.5, T = 1 ms, delay = 3 ticks
  hint: write at most 0.8571 N/mm, leave the key out to get the bound itself, or set rendering.allow_unstable = true";
    contact_stiffness_above_the_bound_in_direct_mode: with("rate_hz = 1000", "coupling = \"direct\"") + "[contact]\nstiffness_n_per_mm3 = 8\n" => r"error: scene.toml:27: contact.stiffness_n_per_mm3 = 8: the arm would feel 2000 N/m, above its stability bound of 1425.44 N/m = min(0.8 b / (T/2 + delay), declared 4000) with b = 7.5, T = 1 ms, delay = 1 tick + 2.70924 ms of filter
  hint: write at most 5.701 N/mm³, leave the key out to get the bound itself, or set rendering.allow_unstable = true";
    old_contact_stiffness_above_the_bound_in_direct_mode: with("rate_hz = 1000", "coupling = \"direct\"") + "[contact]\nstiffness_n_per_mm = 2\n" => r"error: scene.toml:27: contact.stiffness_n_per_mm = 2: the arm would feel 2000 N/m, above its stability bound of 1425.44 N/m = min(0.8 b / (T/2 + delay), declared 4000) with b = 7.5, T = 1 ms, delay = 1 tick + 2.70924 ms of filter
  hint: write at most 1.425 N/mm, leave the key out to get the bound itself, or set rendering.allow_unstable = true";
    both_stiffnesses_of_contact: SCENE.to_owned() + "[contact]\nstiffness_n_per_mm3 = 20\nstiffness_n_per_mm = 5\n" => "error: scene.toml:28: contact.stiffness_n_per_mm = 5: cannot stand beside contact.stiffness_n_per_mm3; give exactly one of the two";
    contact_stiffer_than_any: SCENE.to_owned() + "[contact]\nstiffness_n_per_mm3 = 4000001\n" => "error: scene.toml:27: contact.stiffness_n_per_mm3 = 4000001: must be greater than 0 and at most 4000000 N/mm³: times the square of the tool's voxel_size_mm = 0.5 it is at most 1000000 N/mm";
    old_contact_stiffer_than_any: SCENE.to_owned() + "[contact]\nstiffness_n_per_mm = 1000001\n" => "error: scene.toml:27: contact.stiffness_n_per_mm = 1000001: must be greater than 0 and at most 1000000 N/mm";
    contact_without_stiffness: SCENE.to_owned() + "[contact]\nstiffness_n_per_mm3 = 0\n" => "error: scene.toml:27: contact.stiffness_n_per_mm3 = 0: must be finite and greater than 0 N/mm³";
    contact_of_a_tool_without_a_voxel: with("sphere_mm = 5 }\nvoxel_size_mm = 0.5", "sphere_mm = 5 }\nvoxel_size_mm = 0") + "[contact]\nstiffness_n_per_mm3 = 20\n" => "error: scene.toml:21: tool.voxel_size_mm = 0: must be greater than 0 and at most 1000 mm";
    damping_above_the_profile: SCENE.to_owned() + "[coupling]\ndamping_n_s_per_m = 31\n" => "error: scene.toml:27: coupling.damping_n_s_per_m = 31: must be from 0 to 30 N·s/m: the arm's profile takes 30 at most, and it feels this times scale";
    cutoff_the_wrong_way_round: SCENE.to_owned() + "[filter]\ncutoff_hz = [300, 50]\n" => "error: scene.toml:27: filter.cutoff_hz = [300, 50]: must be [lowest, highest] in Hz, the lowest first";
    overrun_of_none: SCENE.to_owned() + "[safety]\noverrun = 0\n" => r#"error: scene.toml:27: safety.overrun = 0: must be a whole number of consecutive missed ticks from 1 to 1000, which is a second of them, or "off""#;
    overrun_of_another_word: SCENE.to_owned() + "[safety]\noverrun = \"never\"\n" => r#"error: scene.toml:27: safety.overrun = "never": must be a whole number of consecutive missed ticks or "off""#;
    several_problems_together: with("layers = 8", "layers = 0").replace("sphere_mm = 5", "sphere_mm = -5").replace("sim-sigma7", "sim-sigma77") => r#"error: scene.toml:11: static[0].layers = 0: must be a whole number from 2 to 60
error: scene.toml:20: tool.shape.sphere_mm = -5: must be greater than 0 and at most 1000000 mm
error: scene.toml:25: device.profile = "sim-sigma77": no device profile of this name; did you mean `sim-sigma7`?
  hint: known profiles: delta3, falcon-fd, hapkit, haply-2diy, haply-2diy-first, haply-2diy-v2, haptikfabriken-aluhaptics2, haptikfabriken-woodenhaptics, inverse3, inverse3-no-grip, lambda7, leader-arm-6, novint-falcon, omega3, omega6, omega7, open6-hid, open6-serial, phantom-desktop, phantom-omni, polhem-2019, polhem-2020, polhem-2022, polhem-v1, premium15-6dof, premium30-6dof, sigma7, sim-2diy, sim-delta3, sim-desktop, sim-falcon, sim-ideal, sim-inverse3, sim-lambda7, sim-omega3, sim-omega6, sim-omega7, sim-omni, sim-polhem, sim-premium15-6dof, sim-premium30-6dof, sim-sigma7, sim-touch, sim-woodenhaptics, spacemouse, spacenav, touch, touch-x, vintage-2022, virtuose-6d, woodenhaptics-2022, woodenhaptics-v15; a path has a `/` or ends in .toml"#;
    several_schema_problems_together: with("layers = 8", "layers = true").replace("sphere_mm", "sfere_mm").replace("profile", "profil") => r#"error: scene.toml:11: static[0].layers = true: must be a whole number, 0 or more
error: scene.toml:20: tool.shape.sfere_mm = 5: unknown key; did you mean `sphere_mm`?
  hint: known here: box_mm, sphere_mm, ellipsoid_mm, cylinder_mm, cone_mm, capsule_mm, torus_mm, plane_mm
error: scene.toml:25: device.profil = "sim-sigma7": unknown key; did you mean `profile`?
  hint: known here: profile, selector, world_from_device, hand, sim"#;
}

#[test]
fn sides_are_reported_as_written() {
    for (word, rule) in InsideTest::NAMES {
        let sides = format!("sides = \"{word}\"");
        let scene = with("layers = 8", &sides).replace("[tool]", &format!("[tool]\n{sides}"));
        let config = load(&scene).unwrap();
        assert_eq!(
            (config.statics[0].sides, config.statics[1].sides, config.tool.sides),
            (rule, InsideTest::Auto, rule)
        );
    }
}

#[test]
fn an_object_is_movable_as_written() {
    let config = load(&SCENE.replacen("layers = 8", "movable = true", 1)).unwrap();
    assert!(config.statics[0].movable && !config.statics[1].movable);
}

/// Keys of other versions are accepted with the value that holds, and else refused by name; nothing
/// is read and ignored.
#[test]
fn keys_that_this_version_lacks_say_what_holds_or_are_refused_by_name() {
    let same = "[device.sim]\nhand_repeat = false\nseed = 0\n[contact]\ngeometric_awareness = \
        \"edges\"\n[filter]\nspatial = true\n";
    load(&format!("{SCENE}{same}")).unwrap_or_else(|errors| panic!("{errors}"));
    let other = "[device.sim]\njitter_us = 20\nhand_repeat = true\nseed = 3\nhand_maas_g = 1\n\
        [contact]\ngeometric_awareness = \"off\"\n[filter]\nspatial = false\n";
    let errors = load(&format!("{SCENE}{other}")).unwrap_err();
    let lines: Vec<String> = errors
        .problems()
        .iter()
        .map(|problem| format!("{}: {}", problem.key.as_deref().unwrap(), problem.kind))
        .collect();
    assert_eq!(
        lines,
        [
            "device.sim.jitter_us: is no longer a key; leave it out: no version has read it",
            "device.sim.hand_repeat: is no longer a key; leave it out, and write --hand-repeat on \
                the command line",
            "device.sim.seed: is no longer a key; leave it out: chance has the seed 0, so that \
                every run of a scene is the same",
            "device.sim.hand_maas_g: unknown key; did you mean `hand_mass_g`?",
            "contact.geometric_awareness: is no longer a key; leave it out: facets count by what \
                of them is immersed, which edges push by; tool.points = \"voxels\" pushes along \
                the normals of points",
            "filter.spatial: is no longer a key; leave it out: what a facet presses begins \
                smoothly, as less of it is immersed; tool.points = \"voxels\" has the sum over \
                points",
        ]
    );
}

#[test]
fn the_monitor_listens_at_an_address_or_not_at_all() {
    let listens = |listen: &str| {
        load(&format!("{SCENE}[monitor]\nlisten = \"{listen}\"\n"))
            .map(|config| config.monitor.listen)
    };
    for (listen, expected) in [
        ("off", None),
        ("localhost:80", Some("127.0.0.1:80")),
        ("[::1]:7878", Some("[::1]:7878")),
        ("0.0.0.0:0", Some("0.0.0.0:0")),
    ] {
        assert_eq!(
            listens(listen).unwrap().map(|address| address.to_string()).as_deref(),
            expected
        );
    }
    for wrong in ["7878", "on", "127.0.0.1", "lab.example:7878", "localhost:http"] {
        let errors = listens(wrong).unwrap_err().to_string();
        assert!(
            errors.contains("monitor.listen") && errors.contains("127.0.0.1:7878"),
            "{wrong}: {errors}"
        );
    }
    let wrong = "[safety]\nheartbeat_ms = 5\n[monitor]\ntoken_file = \"none\"\norigins = \
        [\"http://lab:1\", \"lab\", \"http://lab/\"]\n";
    let errors = load(&format!("{SCENE}{wrong}")).unwrap_err();
    let keys: Vec<&str> =
        errors.problems().iter().filter_map(|problem| problem.key.as_deref()).collect();
    assert_eq!(
        keys,
        ["safety.heartbeat_ms", "monitor.token_file", "monitor.origins[1]", "monitor.origins[2]"],
        "{errors}"
    );
}

#[test]
fn a_selector_is_numbers_or_a_node() {
    for good in ["1209:7a01", "1209:7a01:42", "/dev/ttyACM0"] {
        let config = load(&format!("{SCENE}selector = \"{good}\"\n")).unwrap();
        assert_eq!(config.device.selector.unwrap().to_string(), good);
    }
    let errors = load(&format!("{SCENE}selector = \"ttyACM0\"\n")).unwrap_err();
    let problem = &errors.problems()[0];
    assert_eq!((problem.key.as_deref(), errors.problems().len()), (Some("device.selector"), 1));
    assert!(problem.to_string().contains("VID:PID"), "{problem}");
}

/// The gates and the brake of `[safety]`.
#[test]
fn safety_keys_are_ranges_and_words() {
    let with = |keys: &str| load(&format!("{SCENE}[safety]\n{keys}\n"));
    let safety = |keys: &str| with(keys).unwrap().parameters.safety;
    let default = safety("");
    assert_eq!((default.deadman, default.brake_s, default.workspace_radius_m), (None, 0.1, 0.075));
    assert_eq!(
        (
            safety("deadman = \"off\"").deadman,
            safety("deadman = 0").deadman,
            safety("deadman = 31").deadman
        ),
        (None, Some(0), Some(31))
    );
    assert_eq!(safety("brake_ms = 0").brake_s, 0.0);
    for (keys, key) in [
        ("deadman = 32", "safety.deadman"),
        ("deadman = -1", "safety.deadman"),
        ("brake_ms = 101", "safety.brake_ms"),
        ("brake_ms = -1", "safety.brake_ms"),
    ] {
        let errors = with(keys).unwrap_err();
        assert_eq!(
            errors.problems().iter().map(|problem| problem.key.as_deref()).collect::<Vec<_>>(),
            [Some(key)],
            "{keys}"
        );
    }
    let errors = with("deadman = true").unwrap_err().to_string();
    assert!(errors.contains("the number of a button or \"off\""), "{errors}");
}

/// To the bit: scenes of version 0.1.0, also those in recordings, feel as they did.
#[test]
fn the_stiffness_of_a_voxel_is_taken_as_it_is() {
    for n_per_mm in ["5.0", "0.3", "4.999999999999999", "1e-7", "123.456"] {
        for voxel_mm in ["0.5", "0.3", "1.7"] {
            let tool = format!("sphere_mm = 5 }}\nvoxel_size_mm = {voxel_mm}");
            let scene = with("sphere_mm = 5 }\nvoxel_size_mm = 0.5", &tool);
            let config = load(&format!("{scene}[contact]\nstiffness_n_per_mm = {n_per_mm}\n"))
                .unwrap_or_else(|errors| panic!("{errors}"));
            let expected = n_per_mm.parse::<f64>().unwrap() / 1e-3;
            assert_eq!(config.parameters.contact.stiffness_n_per_m, expected);
            let StiffnessKey::OfPoint { n_per_mm3 } = config.stiffness_key else { panic!() };
            let now = load(&format!("{scene}[contact]\nstiffness_n_per_mm3 = {n_per_mm3:?}\n"))
                .unwrap_or_else(|errors| panic!("{errors}"));
            assert_eq!(now.stiffness_key, StiffnessKey::OfVolume);
            let same = now.parameters.contact.stiffness_n_per_m / expected;
            assert!((same - 1.0).abs() < 1e-15, "{n_per_mm} at {voxel_mm}: {same}");
        }
    }
}

/// What takes speed from the virtual tool needs one that has a speed of its own.
#[test]
fn brakes_and_dampers_are_for_couplings_with_mass() {
    let with = |coupling: &str| {
        let keys =
            "[contact]\nbraking = true\ndamping_n_s_per_m = 12.5\nstiffness_n_per_mm3 = 0.4\n";
        load(
            &(SCENE.replace("[rendering]", &format!("[rendering]\ncoupling = \"{coupling}\""))
                + keys),
        )
    };
    let coupling = "implicit";
    let config = with(coupling).expect("valid");
    let contact = config.parameters.contact;
    assert!(contact.braking && contact.damping_n_s_per_m == 12.5);
    for coupling in ["constraint", "direct"] {
        let errors = with(coupling).unwrap_err();
        let keys: Vec<&str> =
            errors.problems().iter().filter_map(|problem| problem.key.as_deref()).collect();
        assert_eq!(keys, ["contact.braking", "contact.damping_n_s_per_m"], "{errors}");
        assert!(
            errors.to_string().contains("has no mass")
                && errors.to_string().contains("\"implicit\" has one"),
            "{errors}"
        );
    }
    let plain = load(SCENE).expect("valid");
    assert!(!plain.parameters.contact.braking && plain.parameters.contact.damping_n_s_per_m == 0.0);
}

#[test]
fn friction_wants_a_coefficient() {
    let errors = load(&(SCENE.to_owned() + "[contact]\nfriction = {}\n")).expect_err("refused");
    assert_eq!(errors.problems()[0].key.as_deref(), Some("contact.friction"), "{errors}");
    let one = load(&(SCENE.to_owned() + "[contact]\nfriction = { dynamic = 0.3 }\n"))
        .expect("one counts for both");
    assert_eq!(one.parameters.contact.friction.r#static, 0.3);
}

#[test]
fn a_time_budget_is_read_in_its_range_and_for_the_field_that_can_be_walked() {
    let with = |budget: &str, field: &str| {
        load(
            &(SCENE.replace("rate_hz = 1000", &format!("rate_hz = 1000\nfield = \"{field}\""))
                + &format!("[contact]\ntime_budget_us = {budget}\n")),
        )
    };
    let budget_s = with("250", "trilinear").expect("valid").time_budget_s.expect("a budget");
    assert!((budget_s - 250e-6).abs() < 1e-12);
    for (budget, field) in [("0", "trilinear"), ("1e6", "trilinear"), ("250", "layers")] {
        let errors = with(budget, field).unwrap_err();
        assert_eq!(errors.problems().len(), 1, "{errors}");
        assert_eq!(errors.problems()[0].key.as_deref(), Some("contact.time_budget_us"));
    }
}

/// The shipped reference of keys parses, gives the defaults that it claims, and leaves no key out.
#[test]
fn the_default_scene_says_the_truth() {
    let shipped = load(config::DEFAULT_SCENE).unwrap_or_else(|errors| panic!("{errors}"));
    let bare = "version = 1\n[[static]]\nname = \"floor\"\nshape = { plane_mm = [60, 40] \
        }\nvoxel_size_mm = 0.5\n[tool]\nshape = { sphere_mm = 5 }\nvoxel_size_mm = 0.5\n";
    let bare = load(bare).unwrap_or_else(|errors| panic!("{errors}"));
    assert_eq!(shipped.parameters, bare.parameters);
    assert_eq!(shipped.device, bare.device);
    assert_eq!(shipped.realtime, bare.realtime);
    assert_eq!(shipped.statics, bare.statics);
    assert_eq!(shipped.tool, bare.tool);
    assert_eq!((shipped.monitor, shipped.heartbeat), (bare.monitor, bare.heartbeat));

    // Each table lists its keys when it is asked for one that it does not have.
    let mut asking = String::from("version = 1\nzz = 0\n[[static]]\nzz = 0\nshape = { zz = 0 }\n");
    for table in [
        "rendering",
        "tool",
        "contact",
        "coupling",
        "filter",
        "limits",
        "safety",
        "device",
        "device.sim",
        "realtime",
        "monitor",
        "sculpt",
    ] {
        asking += &format!("[{table}]\nzz = 0\n");
    }
    asking += "[device.world_from_device]\nzz = 0\n";
    let errors = load(&asking).unwrap_err();
    assert_eq!(errors.problems().len(), 16, "{errors}");
    let mut keys = BTreeSet::new();
    for problem in errors.problems() {
        let ProblemKind::UnknownKey { known, .. } = &problem.kind else { panic!("{problem}") };
        keys.extend(known.iter().cloned());
    }
    let is_word = |character: char| character.is_ascii_alphanumeric() || character == '_';
    let words: BTreeSet<&str> =
        config::DEFAULT_SCENE.split(|character| !is_word(character)).collect();
    let left_out: Vec<&String> = keys.iter().filter(|key| !words.contains(key.as_str())).collect();
    assert!(left_out.is_empty(), "not in config/default.toml: {left_out:?}");
}

#[test]
fn gains_left_out_are_the_bounds_of_the_arm() {
    let coupling =
        |scene: &str| load(scene).unwrap_or_else(|errors| panic!("{errors}")).parameters.coupling;
    let sigma = coupling(SCENE);
    assert_eq!((sigma.stiffness_n_per_m, sigma.stiffness_nm_per_rad), (4000.0, 1.0));
    assert_eq!((sigma.bound_n_per_m, sigma.bound_nm_per_rad), (4000.0, 1.0));
    let ideal = coupling(&with("sim-sigma7", "sim-ideal"));
    assert_eq!((ideal.stiffness_n_per_m, ideal.stiffness_nm_per_rad), (4000.0, 4.0));
    assert_eq!((ideal.bound_n_per_m, ideal.bound_nm_per_rad), (f64::INFINITY, f64::INFINITY));
    // An arm that renders no torque bounds no rotation, and the virtual tool still turns.
    let touch = load(&with("sim-sigma7", "sim-touch"))
        .unwrap_or_else(|errors| panic!("{errors}"))
        .parameters;
    assert_eq!(
        (touch.coupling.stiffness_n_per_m, touch.coupling.stiffness_nm_per_rad),
        (400.0, 4.0)
    );
    assert!(touch.limits.torque_nm > 0.0);
    // The arm feels the world's stiffness times the scale.
    let scaled = coupling(&with("profile =", "world_from_device = { scale = 4.0 }\nprofile ="));
    assert_eq!((scaled.stiffness_n_per_m, scaled.bound_n_per_m), (1000.0, 1000.0));
    // Twice the period halves what the arm can take.
    let slow = coupling(&with("rate_hz = 1000", "rate_hz = 500"));
    assert!((slow.stiffness_n_per_m - 2000.0).abs() < 1e-9);
}

#[test]
fn allow_unstable_lifts_the_bound() {
    let scene =
        with("rate_hz = 1000", "allow_unstable = true") + "[coupling]\ntranslation_n_per_mm = 20\n";
    let config = load(&scene).unwrap_or_else(|errors| panic!("{errors}"));
    assert_eq!(config.parameters.coupling.stiffness_n_per_m, 20_000.0);
    assert_eq!(config.parameters.coupling.bound_n_per_m, f64::INFINITY);
    assert_eq!(config.stability.translation.value(), 4000.0);
}

#[test]
fn direct_mode_holds_the_contact_to_the_bound() {
    let config = load(&with("rate_hz = 1000", "coupling = \"direct\""))
        .unwrap_or_else(|errors| panic!("{errors}"));
    let parameters = config.parameters;
    assert_eq!(parameters.coupling.mode, CouplingMode::Direct);
    assert_eq!(parameters.contact.stiffness_n_per_m, parameters.coupling.bound_n_per_m);
    let unfiltered =
        with("rate_hz = 1000", "coupling = \"direct\"") + "[filter]\ncutoff_hz = \"off\"\n";
    let config = load(&unfiltered).unwrap_or_else(|errors| panic!("{errors}"));
    assert_eq!(config.parameters.contact.stiffness_n_per_m, 4000.0);
}

/// sim-sigma7 makes 12 N.
#[test]
fn no_number_switches_a_rule_off_and_the_message_names_the_ceiling() {
    let force = "the arm's largest force of 12 N";
    let nothing = "beyond that the rule would hold nothing back";
    for (table, key, absurd, ceiling, from) in [
        (
            "limits",
            "force_n",
            "1e9",
            "greater than 0 and at most 100 N",
            "no arm's profile has more",
        ),
        (
            "limits",
            "torque_nm",
            "1e9",
            "greater than 0 and at most 10 N·m",
            "no arm's profile has more",
        ),
        (
            "limits",
            "speed_mm_per_s",
            "1e30",
            "greater than 0 and at most 5000 mm/s",
            "no hand that holds an arm is faster",
        ),
        ("safety", "slew_n_per_s", "1e30", "from 120 to 12000 N/s", "within 1 ms"),
        ("safety", "slew_n_per_s", "119", "from 120 to 12000 N/s", "dampers come too late"),
        ("safety", "power_w", "1e9", "greater than 0 and at most 12 W", force),
        ("safety", "power_w", "12.001", "greater than 0 and at most 12 W", force),
        ("safety", "ramp_ms", "1e-9", "from 10 to 10000 ms", "a shorter one is a blow"),
        ("safety", "ramp_ms", "9.9", "from 10 to 10000 ms", "a shorter one is a blow"),
        ("safety", "brake_ms", "1e9", "from 0 to 100 ms", ""),
        ("safety", "overrun", "4000000000", "from 1 to 1000", "a second of them"),
        ("safety", "heartbeat_ms", "1e9", "from 20 to 10000 ms", ""),
        (
            "coupling",
            "translation_n_per_mm",
            "1e300",
            "greater than 0 and at most 1000000 N/mm",
            "",
        ),
        (
            "coupling",
            "rotation_nm_per_rad",
            "1e300",
            "greater than 0 and at most 1000000 N·m/rad",
            "",
        ),
    ] {
        let refused = refusal(&format!("{SCENE}[{table}]\n{key} = {absurd}\n"));
        let expected = format!("error: scene.toml:27: {table}.{key} = {absurd}: must be ");
        assert!(
            refused.starts_with(&expected) && refused.contains(ceiling) && refused.contains(from),
            "{refused}"
        );
        assert!(!refused.contains('(') || refused.contains(nothing), "{refused}");
    }
    // The ceilings themselves will do, allow_unstable lifts none of them, and a smaller arm has
    // lower ones.
    let most = "[safety]\nslew_n_per_s = 12000\npower_w = 12\nramp_ms = 10\noverrun = \
        1000\n[limits]\nspeed_mm_per_s = 5000\n";
    let limits = load(&format!("{SCENE}{most}"))
        .unwrap_or_else(|errors| panic!("{errors}"))
        .parameters
        .limits;
    assert_eq!(
        (limits.slew_n_per_s, limits.power_w, limits.overrun_fault_ticks),
        (12000.0, 12.0, 1000)
    );
    let unstable = with("rate_hz = 1000", "rate_hz = 1000\nallow_unstable = true")
        + "[safety]\npower_w = 1e9\n";
    assert!(refusal(&unstable).contains("at most 12 W"));
    let small = with("sim-sigma7", "sim-touch") + most;
    let refused = refusal(&small);
    assert!(
        refused.contains("from 33 to 3300 N/s") && refused.contains("at most 5 W"),
        "{refused}"
    );
    // A limit that the scene lowers takes the slew along: no force steps within a tick.
    for (slew, expected) in [("12000", 2000.0), ("20", 20.0)] {
        let low = format!("{SCENE}[safety]\nslew_n_per_s = {slew}\n[limits]\nforce_n = 2\n");
        let limits = load(&low).unwrap_or_else(|errors| panic!("{errors}")).parameters.limits;
        assert_eq!((limits.force_n, limits.slew_n_per_s), (2.0, expected));
    }
}

#[test]
fn units_become_si() {
    let scene = with("layers = 8", "layers = 8\nposition_mm = [1, 2, 3]")
        + "[limits]\nforce_n = 100\nspeed_mm_per_s = 250\n";
    let config = load(&scene).unwrap_or_else(|errors| panic!("{errors}"));
    let base = &config.statics[0];
    assert!((base.voxel_size_m - 5e-4).abs() < 1e-18);
    assert!((base.pose.translation - glam::DVec3::new(1e-3, 2e-3, 3e-3)).length() < 1e-15);
    assert!((config.parameters.mapping.start.translation.z - 0.04).abs() < 1e-15);
    // A slab thicker than its band of (8 + 1.5) voxels on both faces.
    let hapticd::config::scene::MeshSource::Shape(Shape::Plane { thickness_m, .. }) =
        config.statics[1].source
    else {
        panic!()
    };
    assert!((thickness_m - 4.0 * 9.5e-3).abs() < 1e-12);
    let limits = config.parameters.limits;
    // The profile's force limit is the lower one; slew is that limit within 10 ms.
    assert_eq!((limits.force_n, limits.speed_m_per_s), (12.0, 0.25));
    assert!(
        (limits.slew_n_per_s - 1200.0).abs() < 1e-9 && (limits.slew_nm_per_s - 20.0).abs() < 1e-9
    );
    assert_eq!(
        (limits.stale_ticks_max, limits.stale_fault_ticks, limits.overrun_fault_ticks),
        (3, 20, 0)
    );
}

#[test]
fn the_command_line_overrides_the_scene() {
    let options = LoadOptions {
        device: Some("sim-ideal".into()),
        enforce: Some(true),
        ..LoadOptions::default()
    };
    let config = load_with(SCENE, &options).unwrap_or_else(|errors| panic!("{errors}"));
    assert_eq!(config.device.profile.name, "sim-ideal");
    assert!(config.realtime.enforce);
    assert_eq!(config.parameters.limits.overrun_fault_ticks, 20);
    let options = LoadOptions { device: Some("ideal".into()), ..LoadOptions::default() };
    let errors = load_with(SCENE, &options).unwrap_err().to_string();
    assert!(
        errors.contains(
            "scene.toml: --device = \"ideal\": no device profile of this name; did you \
            mean `sim-ideal`?"
        ),
        "{errors}"
    );
}

fn hapticd(dir: &Path, args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_hapticd"))
        .current_dir(dir)
        .env("XDG_CACHE_HOME", dir.join("xdg-cache"))
        .args(args)
        .output()
        .unwrap()
}

#[test]
fn check_prints_results_on_stdout_and_problems_on_stderr() {
    let dir = tempfile::tempdir().unwrap();
    write_into(dir.path(), SCENE);
    fs::write(dir.path().join("wrong.toml"), with("layers = 8", "layers = 0")).unwrap();
    // The base is a skin, and a ball has no edge.
    let ok = "ok scene.toml: \"scene\", 2 static + tool, sim-sigma7 at 1000 Hz, implicit, 4000 N/m \
        (declared bound 4000), 1 N·m/rad (declared bound 1)\n  floor: thinnest wall 38 mm, \
        sharpest edge 90°\n  tool: thinnest wall 9.981 mm\n  a part 0.316 mm too large on each side is \
        pressed in by 1 N for each mm of its rim, one 0.158 mm too large by 0.25 N\n";

    let output = hapticd(dir.path(), &["check", "scene.toml"]);
    assert_eq!(output.status.code(), Some(0));
    assert_eq!(String::from_utf8_lossy(&output.stdout), ok);
    // One triangle by itself.
    let open = "warning: base: 3 edges are open, the widest hole is 5.11 mm wide\n";
    assert_eq!(String::from_utf8_lossy(&output.stderr), open);

    let output = hapticd(dir.path(), &["check", "wrong.toml", "scene.toml", "none.toml"]);
    assert_eq!(output.status.code(), Some(3));
    assert_eq!(String::from_utf8_lossy(&output.stdout), ok);
    let errors = [
        "error: wrong.toml:11: static[0].layers = 0: must be a whole number from 2 to 60\n",
        open,
        "error: none.toml: no such file\n  hint: on the command line, paths are relative to the \
            working directory\n",
    ];
    assert_eq!(String::from_utf8_lossy(&output.stderr), errors.concat());
}

#[test]
fn check_refuses_a_mesh_and_a_grid_that_run_would_refuse() {
    let dir = tempfile::tempdir().unwrap();
    write_into(dir.path(), SCENE);
    for (edge, code, said) in
        [("9e6", 3, "is too large (at most 32768 per axis and"), ("", 4, "base.obj")]
    {
        fs::write(
            dir.path().join("base.obj"),
            format!("v 0 0 0\nv {edge} 0 0\nv 0 {edge} 0\nf 1 2 3\n"),
        )
        .unwrap();
        for line in [
            &["check", "scene.toml"][..],
            &["run", "scene.toml", "--clock", "virtual", "--duration", "1s"],
        ] {
            let output = hapticd(dir.path(), line);
            let stderr = String::from_utf8_lossy(&output.stderr);
            assert!(
                output.status.code() == Some(code) && stderr.contains(said),
                "{line:?}: {stderr}"
            );
        }
    }
}

#[test]
fn a_wrong_command_line_exits_with_2() {
    let dir = tempfile::tempdir().unwrap();
    assert_eq!(hapticd(dir.path(), &["check"]).status.code(), Some(2));
    assert_eq!(
        hapticd(dir.path(), &["check", "--no-such-flag", "scene.toml"]).status.code(),
        Some(2)
    );
}

#[test]
fn colour_is_given_only_when_asked_for() {
    let dir = tempfile::tempdir().unwrap();
    let plain = hapticd(dir.path(), &["check", "none.toml"]);
    assert!(!plain.stderr.contains(&0x1b));
    let coloured = hapticd(dir.path(), &["--color", "always", "check", "none.toml"]);
    assert!(coloured.stderr.contains(&0x1b));
    assert_eq!(coloured.status.code(), Some(3));
}

#[test]
fn every_coupling_of_the_contract_is_read() {
    for (word, mode) in [
        ("implicit", CouplingMode::Implicit),
        ("constraint", CouplingMode::Constraint),
        ("direct", CouplingMode::Direct),
    ] {
        let config = load(&with("rate_hz = 1000", &format!("coupling = \"{word}\"")))
            .unwrap_or_else(|errors| panic!("{errors}"));
        assert_eq!(config.parameters.coupling.mode, mode);
    }
}

#[test]
fn the_tick_knows_what_the_arm_takes_at_which_delay() {
    let arm = |scene: &str| load(scene).unwrap_or_else(|errors| panic!("{errors}")).parameters.arm;
    let sigma = arm(SCENE);
    // b = 7.5 N·s/m one tick away; the velocity is half of 15 ms and one tick old: sin(π/38) · 0.3
    // kg / 1 ms < 30 N·s/m.
    assert_eq!((sigma.delay_ticks, sigma.stiffness_lag_n_s_per_m), (1, 6.0));
    assert!((sigma.injected_n_s_per_m - 24.77).abs() < 0.01, "{sigma:?}");
    // The profile declares less than the plant would take.
    assert_eq!(arm(&with("sim-sigma7", "sim-touch")).injected_n_s_per_m, 4.0);
    assert_eq!(arm(&with("sim-sigma7", "sim-touch")).injected_nm_s_per_rad, 0.0);
    assert_eq!(
        arm(&with("profile =", "world_from_device = { scale = 4.0 }\nprofile ="))
            .stiffness_lag_n_s_per_m,
        1.5
    );
    let unbounded = f64::INFINITY;
    assert_eq!(
        arm(&with("rate_hz = 1000", "allow_unstable = true")).stiffness_lag_n_s_per_m,
        unbounded
    );
    let ideal = arm(&with("sim-sigma7", "sim-ideal"));
    assert_eq!((ideal.stiffness_lag_n_s_per_m, ideal.injected_n_s_per_m), (unbounded, 0.0));
}
