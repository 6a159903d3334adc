use std::path::Path;

use glam::DVec3;

use super::*;
use crate::setting_names::SettingNames;
use crate::voxmap::inside_test::InsideTest;

#[test]
fn extension_decides_in_any_case_and_scales() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("corner.OBJ");
    std::fs::write(&path, "v 0 0 0\nv 1000 0 0\nv 0 1000 0\nf 1 2 3\n").unwrap();
    let mesh = load(&path, 1e-3).unwrap();
    assert_eq!(mesh.bounds(), Some((DVec3::ZERO, DVec3::new(1.0, 1.0, 0.0))));
    assert_eq!(mesh.corners(0)[1], DVec3::X);
}

#[test]
fn files_that_cannot_be_used_say_why() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str, text: &str| {
        let path = dir.path().join(name);
        std::fs::write(&path, text).unwrap();
        load(&path, 1.0).unwrap_err()
    };
    assert!(matches!(load(&dir.path().join("none.stl"), 1.0), Err(MeshError::Missing { .. })));
    let error = at("part.dae", "");
    assert!(
        error.to_string().ends_with(
            "part.dae: unknown mesh extension `dae`, known: obj, stl, ply, gltf, glb, 3mf"
        ),
        "{error}"
    );
    for (name, format) in
        [("part.step", "STEP"), ("part.STP", "STEP"), ("part.igs", "IGES"), ("part.brep", "BREP")]
    {
        let error = at(name, "");
        let expected = format!(
            "{name}: {format} files hold curved surfaces, and a mesh of triangles is needed"
        );
        assert!(
            error.to_string().ends_with(&expected)
                && error
                    .hint(&SettingNames::PLAIN)
                    .is_some_and(|hint| hint.contains("gmsh PART.step")),
            "{error}"
        );
    }
    assert!(matches!(at("part", ""), MeshError::UnknownExtension { .. }));
    assert!(matches!(at("empty.obj", "# nothing\n"), MeshError::Empty { .. }));
    assert!(matches!(
        at("empty.stl", "solid nothing\nendsolid nothing\n"),
        MeshError::Empty { .. }
    ));
    std::fs::create_dir(dir.path().join("folder.obj")).unwrap();
    let error = load(&dir.path().join("folder.obj"), 1.0).unwrap_err();
    assert!(
        matches!(error, MeshError::Unreadable { .. }) && error.hint(&SettingNames::PLAIN).is_some(),
        "{error}"
    );
    let path = dir.path().join("huge.obj");
    std::fs::write(&path, "v 0 0 0\nv 1e308 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    assert!(matches!(load(&path, 1e3), Err(MeshError::NonFiniteVertex { vertex: 2, .. })));
}

#[test]
fn a_wrong_extension_and_an_empty_file_are_named() {
    let refusal = |bytes: &[u8], name: &str| {
        let error =
            parse(bytes, Format::of(Path::new(name)).unwrap(), Path::new(name), 1.0).unwrap_err();
        (error.to_string(), error.hint(&SettingNames::PLAIN).unwrap())
    };
    let files: [(&[u8], &str, &str); 6] = [
        (b"ply\nformat ascii 1.0\nelement vertex 0\nend_header\n", "PLY", ".ply"),
        (b"glTF\x02\0\0\0", "glTF", ".gltf or .glb"),
        (b"  {\"asset\": {\"version\": \"2.0\"}}", "glTF", ".gltf or .glb"),
        (b"PK\x03\x04............3D/3dmodel.model", "3MF", ".3mf"),
        (b"# by hand\n\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "OBJ", ".obj"),
        (b"solid part\nfacet normal 0 0 1\nouter loop\n", "STL", ".stl"),
    ];
    for (bytes, format, ending) in files {
        let name = if format == "STL" { "part.obj" } else { "part.stl" };
        let says = if format == "STL" { "OBJ" } else { "STL" };
        let expected =
            format!("{name}: this is a file of the format {format}, and its name says {says}");
        assert_eq!(
            refusal(bytes, name),
            (expected, format!("rename it so that it ends in {ending}"))
        );
    }
    for extension in EXTENSIONS {
        let name = format!("part.{extension}");
        assert_eq!(refusal(b"", &name).0, format!("{name}: no triangles: the file is empty"));
    }
}

#[test]
fn files_that_are_no_mesh_are_called_by_their_names_in_every_format() {
    use std::io::Write as _;
    let mut archive = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    archive.start_file("part.stl", zip::write::SimpleFileOptions::default()).unwrap();
    archive.write_all(&[7; 3000]).unwrap();
    let archive = archive.finish().unwrap().into_inner();
    let pointer = "version https://git-lfs.github.com/spec/v1\noid \
        sha256:4d7a214614ab2935c943f9e0ff69d22eadbb8f32b1258daaa5e2ca24d17e2393\nsize 12345\n";
    let utf16 = "\u{feff}solid part\nfacet normal 0 0 1\n".encode_utf16();
    let files: [(Vec<u8>, &str, &str); 8] = [
        (pointer.into(), "a git-lfs pointer, not the file", "git lfs pull"),
        (b"\x1f\x8b\x08\0\0\0\0\0\0\x03K\xcb\xcfO\xe2\x02\0".to_vec(), "a gzip file", "gunzip"),
        (archive.clone(), "a zip archive without a 3MF model", "unpack it"),
        (b"\n<!DOCTYPE html>\n<html><body>Sign in".to_vec(), "an HTML page", "browser"),
        (b"\xef\xbb\xbf<HTML lang=\"de\"><head>".to_vec(), "an HTML page", "browser"),
        (utf16.flat_map(u16::to_le_bytes).collect(), "text in UTF-16", "UTF-8"),
        (b"7z\xbc\xaf\x27\x1c\0\x04rest".to_vec(), "a compressed file", "unpack it"),
        (b"ISO-10303-21;\nHEADER;\n".to_vec(), "a STEP file, which holds curved surfaces", "gmsh"),
    ];
    for extension in EXTENSIONS.iter().chain(cloud::EXTENSIONS) {
        let name = format!("part.{extension}");
        let path = Path::new(&name);
        for (bytes, what, remedy) in &files {
            let error = match Format::of(path) {
                Ok(format) => parse(bytes, format, path, 1.0).unwrap_err(),
                Err(_) => cloud::read(bytes, path, 1.0).unwrap_err(),
            };
            assert_eq!(error.to_string(), format!("{name}: this is {what}"));
            assert!(
                error.hint(&SettingNames::PLAIN).is_some_and(|hint| hint.contains(remedy)),
                "{error}"
            );
            let of_points = cloud::read(bytes, path, 1.0).unwrap_err().to_string();
            assert_eq!(of_points, error.to_string());
        }
    }
    // What may be a package that was cut is not called an archive of something else.
    let cut = &archive[..archive.len() - 30];
    let error = parse(cut, Format::ThreeMf, Path::new("part.3mf"), 1.0).unwrap_err();
    assert!(matches!(error, MeshError::Parse { .. }), "{error}");
}

#[test]
fn a_byte_order_mark_and_old_line_ends_are_read_in_every_text() {
    let obj = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    let ply = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
        property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n\
        0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
    let gltf = r#"{"asset": {"version": "2.0"}, "meshes": [{"primitives": [{"attributes":
        {"POSITION": 0}}]}], "accessors": [{"bufferView": 0, "componentType": 5121, "count": 3,
        "type": "VEC3"}], "bufferViews": [{"buffer": 0, "byteLength": 9}], "buffers":
        [{"byteLength": 9, "uri": "data:;base64,AAAAAQAAAAEA"}]}"#;
    for (text, format) in [(obj, Format::Obj), (ply, Format::Ply), (gltf, Format::Gltf)] {
        let path = Path::new("part");
        let read = |text: &str| parse(text.as_bytes(), format, path, 1.0).unwrap();
        let mesh = read(text);
        assert_eq!(mesh.triangles, [[0, 1, 2]]);
        for variant in
            [format!("\u{feff}{text}"), text.replace('\n', "\r"), text.replace('\n', "\r\n")]
        {
            let same = read(&variant);
            assert_eq!(
                (same.triangles, same.vertices),
                (mesh.triangles.clone(), mesh.vertices.clone())
            );
        }
    }
    let points = cloud::read(b"v 0 0 0\rv 1 0 0\r", Path::new("part.obj"), 1.0).unwrap();
    assert!(matches!(points, cloud::Contents::Cloud(cloud) if cloud.positions.len() == 2));
}

/// A tetrahedron with an edge of 30 mm, so far from the origin, in binary STL; mm.
fn far_stl(away_mm: f32) -> Vec<u8> {
    let corners = [[0.0, 0.0, 0.0], [30.0, 0.0, 0.0], [0.0, 30.0, 0.0], [0.0, 0.0, 30.0_f32]];
    let mut bytes = [&[0_u8; 80][..], &4_u32.to_le_bytes()].concat();
    for triangle in [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]] {
        bytes.extend([0; 12]);
        for [x, y, z] in triangle.map(|k: usize| corners[k]) {
            bytes.extend([x, y - away_mm, z].iter().flat_map(|number| number.to_le_bytes()));
        }
        bytes.extend([0; 2]);
    }
    bytes
}

#[test]
fn numbers_of_32_bits_far_from_the_origin_are_too_coarse_for_small_voxels() {
    use crate::part::Part;
    let dir = tempfile::tempdir().unwrap();
    let warnings = |name: &str, bytes: &[u8], voxel_size_m: f64| {
        let path = dir.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        Part::load("part", &path, 1e-3).unwrap().mesh_warnings(InsideTest::Auto, Some(voxel_size_m))
    };
    // From 2^20 mm on numbers are an eighth of a millimetre apart.
    let step_m = 0.125e-3;
    let bytes = far_stl(1_048_700.0);
    let said = warnings("far.stl", &bytes, 9.9 * step_m);
    assert_eq!(
        said,
        ["its coordinates reach 1049 m from the origin of the file, where numbers of 32 bits are \
            125 µm apart, more than a tenth of a voxel of 1.24 mm: move the part to the origin \
            before it is exported"]
    );
    assert!(warnings("far.stl", &bytes, 10.1 * step_m).is_empty());
    assert!(warnings("near.stl", &far_stl(0.0), 0.1e-3).is_empty());
    // Without voxels nothing is too coarse.
    let path = dir.path().join("far.stl");
    assert!(
        Part::load("part", &path, 1e-3).unwrap().mesh_warnings(InsideTest::Auto, None).is_empty()
    );
    // The type is that of the file, in text too; decimals and 64 bits are as fine as they are.
    for (kind, n_warnings) in [("float", 1), ("double", 0)] {
        let ply = format!(
            "ply\nformat ascii 1.0\nelement vertex 4\nproperty {kind} x\nproperty {kind} y\n\
                property {kind} z\nelement face 4\nproperty list uchar int vertex_indices\n\
                end_header\n0 1048700 0\n30 1048700 0\n0 1048730 0\n0 1048700 30\n3 0 2 1\n\
                3 0 1 3\n3 0 3 2\n3 1 2 3\n"
        );
        assert_eq!(warnings("far.ply", ply.as_bytes(), 1e-3).len(), n_warnings);
    }
    let obj = "v 0 1048700 0\nv 30 1048700 0\nv 0 1048730 0\nv 0 1048700 30\nf 1 3 2\nf 1 2 4\n\
        f 1 4 3\nf 2 3 4\n";
    assert!(warnings("far.obj", obj.as_bytes(), 1e-3).is_empty());
}

/// The corners of every triangle, in an order that the numbering of vertices does not change.
fn corner_set(mesh: &TriangleMesh) -> Vec<[[u64; 3]; 3]> {
    let mut triangles: Vec<_> = (0..mesh.triangles.len())
        .map(|k| {
            let mut corners = mesh.corners(k).map(|corner| corner.to_array().map(f64::to_bits));
            let first = (0..3).min_by_key(|k| corners[*k]).unwrap();
            corners.rotate_left(first);
            corners
        })
        .collect();
    triangles.sort_unstable();
    triangles
}

#[test]
fn the_same_box_in_every_format_is_the_same_box() {
    use std::fmt::Write as _;
    use std::io::Write as _;
    let shape = primitives::Shape::Box { size_m: DVec3::new(10.0, 20.5, 30.25) }.tessellate(1.0);
    let vertices = &shape.vertices;
    let triangles = &shape.triangles;
    let mut files: Vec<(&str, Vec<u8>)> = Vec::new();

    let mut obj = String::new();
    vertices.iter().for_each(|v| writeln!(obj, "v {} {} {}", v.x, v.y, v.z).unwrap());
    triangles
        .iter()
        .for_each(|t| writeln!(obj, "f {} {} {}", t[0] + 1, t[1] + 1, t[2] + 1).unwrap());
    files.push(("box.obj", obj.into_bytes()));

    let mut stl = [&[0_u8; 80][..], &(triangles.len() as u32).to_le_bytes()].concat();
    let mut text = "solid box\n".to_owned();
    for k in 0..triangles.len() {
        stl.extend([0; 12]);
        text += "facet normal 0 0 0\nouter loop\n";
        for corner in shape.corners(k) {
            stl.extend(corner.as_vec3().to_array().iter().flat_map(|number| number.to_le_bytes()));
            writeln!(text, "vertex {} {} {}", corner.x, corner.y, corner.z).unwrap();
        }
        stl.extend([0; 2]);
        text += "endloop\nendfacet\n";
    }
    files.extend([("box.stl", stl), ("text.STL", (text + "endsolid\n").into_bytes())]);

    for (name, encoding) in [
        ("big.ply", "binary_big_endian"),
        ("little.ply", "binary_little_endian"),
        ("box.ply", "ascii"),
    ] {
        let mut ply = format!(
            "ply\nformat {encoding} 1.0\nelement vertex {}\nproperty double x\nproperty double \
                y\nproperty double z\nelement face {}\nproperty list uchar uint \
                vertex_indices\nend_header\n",
            vertices.len(),
            triangles.len()
        )
        .into_bytes();
        let big = encoding == "binary_big_endian";
        for v in vertices {
            match encoding {
                "ascii" => ply.extend(format!("{} {} {}\n", v.x, v.y, v.z).bytes()),
                _ => ply.extend(
                    v.to_array()
                        .iter()
                        .flat_map(|n| if big { n.to_be_bytes() } else { n.to_le_bytes() }),
                ),
            }
        }
        for t in triangles {
            match encoding {
                "ascii" => ply.extend(format!("3 {} {} {}\n", t[0], t[1], t[2]).bytes()),
                _ => {
                    ply.push(3);
                    ply.extend(
                        t.iter().flat_map(|n| if big { n.to_be_bytes() } else { n.to_le_bytes() }),
                    );
                }
            }
        }
        files.push((name, ply));
    }

    let mut buffer: Vec<u8> =
        vertices.iter().flat_map(|v| v.as_vec3().to_array()).flat_map(f32::to_le_bytes).collect();
    let n_position_bytes = buffer.len();
    buffer
        .extend(triangles.as_flattened().iter().flat_map(|corner| (*corner as u16).to_le_bytes()));
    let document = |uri: serde_json::Value| {
        serde_json::json!({
            "asset": {"version": "2.0"},
            "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
            "accessors": [
                {"bufferView": 0, "componentType": 5126, "count": vertices.len(), "type": "VEC3"},
                {"bufferView": 0, "byteOffset": n_position_bytes, "componentType": 5123, "count": 3 * triangles.len(), "type": "SCALAR"},
            ],
            "bufferViews": [{"buffer": 0, "byteLength": buffer.len()}],
            "buffers": [{"byteLength": buffer.len(), "uri": uri}],
        })
        .to_string()
        .into_bytes()
    };
    let json = document(serde_json::Value::Null);
    let sizes = [12 + 8 + json.len() + 8 + buffer.len(), json.len(), buffer.len()]
        .map(|size| (size as u32).to_le_bytes());
    let glb =
        [b"glTF\x02\0\0\0", &sizes[0][..], &sizes[1], b"JSON", &json, &sizes[2], b"BIN\0", &buffer]
            .concat();
    files.extend([
        ("box.gltf", document("box.bin".into())),
        ("box.glb", glb),
        ("box.bin", buffer.clone()),
    ]);

    let mut model =
        "<model unit=\"millimeter\"><resources><object id=\"1\"><mesh><vertices>".to_owned();
    vertices.iter().for_each(|v| {
        write!(model, "<vertex x=\"{}\" y=\"{}\" z=\"{}\"/>", v.x, v.y, v.z).unwrap()
    });
    model += "</vertices><triangles>";
    triangles.iter().for_each(|t| {
        write!(model, "<triangle v1=\"{}\" v2=\"{}\" v3=\"{}\"/>", t[0], t[1], t[2]).unwrap()
    });
    model +=
        "</triangles></mesh></object></resources><build><item objectid=\"1\"/></build></model>";
    let mut archive = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    archive.start_file("3D/3dmodel.model", zip::write::SimpleFileOptions::default()).unwrap();
    archive.write_all(model.as_bytes()).unwrap();
    files.push(("box.3mf", archive.finish().unwrap().into_inner()));

    let dir = tempfile::tempdir().unwrap();
    files.iter().for_each(|(name, bytes)| std::fs::write(dir.path().join(name), bytes).unwrap());
    let mut scaled = shape.clone();
    scaled.vertices.iter_mut().for_each(|vertex| *vertex *= 1e-3);
    let formats: Vec<&str> =
        files.iter().map(|(name, _)| *name).filter(|name| *name != "box.bin").collect();
    for name in &formats {
        let mesh = load(&dir.path().join(name), 1e-3).unwrap();
        assert_eq!(corner_set(&mesh), corner_set(&scaled), "{name}");
    }
    let ending = |name: &&str| name.rsplit('.').next().unwrap().to_lowercase();
    assert!(
        EXTENSIONS.iter().all(|extension| formats.iter().any(|name| ending(name) == *extension))
    );
}

proptest::proptest! {
    /// Damaged files give an error or a mesh with indices in range, never a panic.
    #[test]
    fn damaged_text_does_no_harm(text in "(v|f|l|solid|facet|vertex|endfacet|endsolid|[-0-9. \
        /#\\\\]|nan|1e999|\n){0,80}") {
        for format in [Format::Obj, Format::Stl] {
            for text in [text.clone(), format!("solid facet\n{text}"), format!("v 0 0 0\nv 1 0 \
                0\nv 0 1 0\nv 1 1 1\n{text}")] {
                if let Ok(mesh) = parse(text.as_bytes(), format, Path::new("damaged"), 1.0) {
                    let report = validate::inspect(&mesh);
                    mass::mass_properties_of_inspected(&mesh, &report);
                    proptest::prop_assert!(mesh.triangles.iter().flatten().all(|vertex| (*vertex as usize) < mesh.vertices.len()));
                }
            }
        }
    }

    /// Any tangle of triangles over few vertices can be inspected.
    #[test]
    fn tangled_triangles_do_no_harm(
        triangles in proptest::collection::vec(proptest::array::uniform3(0..12_u32), 0..60),
        vertices in proptest::collection::vec(proptest::array::uniform3(-2..2_i8), 12),
    ) {
        let vertices = vertices.into_iter().map(|corner| DVec3::from_array(corner.map(f64::from))).collect();
        let mesh = TriangleMesh { vertices, triangles };
        let report = validate::inspect(&mesh);
        let mass = mass::mass_properties_of_inspected(&mesh, &report);
        proptest::prop_assert!(mass.center_m.is_finite() && mass.inertia_per_mass.is_finite());
        proptest::prop_assert!(report.boundary_loops.iter().all(|rim| rim.size_m.is_finite() && rim.center_m.is_finite()));
        proptest::prop_assert_eq!(report.boundary_loops.is_empty(), report.open_edges == 0);
    }
}

#[test]
#[expect(
    clippy::print_stdout,
    reason = "the figures are for a reader; a test sets no limit on time"
)]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn millions_of_triangles_go_through() {
    let torus = primitives::Shape::Torus { major_m: 0.05, minor_m: 0.02 }.tessellate(0.0);
    let mut bytes = vec![0; 80];
    bytes.extend((torus.triangles.len() as u32).to_le_bytes());
    for triangle_idx in 0..torus.triangles.len() {
        bytes.extend([0; 12]);
        for corner in torus.corners(triangle_idx) {
            bytes
                .extend(corner.as_vec3().to_array().iter().flat_map(|number| number.to_le_bytes()));
        }
        bytes.extend([0; 2]);
    }
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("torus.stl");
    std::fs::write(&path, bytes).unwrap();
    let start = std::time::Instant::now();
    let mesh = load(&path, 1.0).unwrap();
    let loaded = start.elapsed();
    let report = validate::inspect(&mesh);
    println!(
        "{} triangles: load {loaded:.2?}, inspect {:.2?}",
        mesh.triangles.len(),
        start.elapsed() - loaded
    );
    assert_eq!(
        (mesh.vertices.len(), mesh.triangles.len()),
        (torus.vertices.len(), torus.triangles.len())
    );
    assert!(
        report.closed && report.inconsistent_edges == 0,
        "{:?}",
        report.warnings(&SettingNames::PLAIN)
    );
}

/// Triangle counts and closedness of real files, which are not part of the project. Closed means:
/// after welding, which also closes files that repeat the corners of their faces.
#[test]
#[expect(clippy::print_stdout, reason = "says that it was skipped, and what the files contain")]
fn real_meshes_load() {
    let Some(models) = std::env::var_os("HAPTICD_MODELS").map(std::path::PathBuf::from) else {
        println!("skipped: HAPTICD_MODELS not set");
        return;
    };
    let cases = [
        ("factory_gear_base_tight_space_5e-4_subdiv_4x.obj", 10_518, false),
        ("factory_gear_medium_space_5e-4.obj", 35_212, true),
        ("factory_round_hole_8mm_subdiv_3x.obj", 900, false),
        ("factory_round_peg_8mm_tight.obj", 1_152, true),
        ("factory_round_peg_8mm_loose.obj", 1_152, true),
        ("factory_rectangular_hole_8mm_subdiv_3x.obj", 1_040, false),
        ("factory_rectangular_peg_8mm_tight_subdiv_3x.obj", 1_792, true),
        ("factory_bolt_m16_tight.obj", 25_672, true),
        ("factory_nut_m16_tight_subdiv_3x.obj", 15_078, false),
        ("stanford-bunny.obj", 69_451, false),
        ("rocker-arm.obj", 20_088, true),
        ("suzanne.obj", 968, false),
        ("ADIS16480.STL", 7_436, true),
        ("featuretype.STL", 3_476, true),
        ("busted.STL", 3_878, true),
    ];
    for (name, triangles, closed) in cases {
        let path = models.join(name);
        if !path.is_file() {
            println!("skipped: {name} is not there");
            continue;
        }
        let start = std::time::Instant::now();
        let mesh = load(&path, 1.0).unwrap();
        let loaded = start.elapsed();
        let report = validate::inspect(&mesh);
        let inspected = start.elapsed() - loaded;
        let mass = mass::mass_properties(&mesh);
        println!(
            "{name}: {} vertices, {report:?}, load {loaded:.1?}, inspect {inspected:.1?}, \
                {mass:?}, {:?}",
            mesh.vertices.len(),
            report.warnings(&SettingNames::PLAIN)
        );
        assert_eq!(mesh.triangles.len(), triangles, "{name}");
        assert_eq!(report.closed, closed, "{name}");
        assert!(mass.center_m.is_finite() && mass.inertia_per_mass.is_finite(), "{name}");
    }
}
