use serde_json::{Value, json};

use super::*;
use crate::mesh::primitives::Shape;
use crate::setting_names::SettingNames;

const VERTICES: [[f32; 3]; 4] =
    [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 3.0]];
const FACES: [u32; 12] = [0, 2, 1, 0, 1, 3, 1, 2, 3, 2, 0, 3];

fn read(bytes: &[u8]) -> Result<TriangleMesh, MeshError> {
    parse(bytes, Path::new("folder/part.gltf")).map(|file| file.mesh)
}

fn read_value(document: &Value) -> Result<TriangleMesh, MeshError> {
    read(document.to_string().as_bytes())
}

fn message(document: &Value) -> String {
    read_value(document).unwrap_err().to_string()
}

fn embedded(buffer: &[u8]) -> String {
    use base64::Engine;
    format!(
        "data:application/octet-stream;base64,{}",
        base64::engine::general_purpose::STANDARD.encode(buffer)
    )
}

fn positions() -> Vec<u8> {
    VERTICES.as_flattened().iter().flat_map(|number| number.to_le_bytes()).collect()
}

fn indices(component_type: u32, corners: &[u32]) -> Vec<u8> {
    let number = |corner: &u32| match component_type {
        5121 => vec![*corner as u8],
        5123 => (*corner as u16).to_le_bytes().to_vec(),
        _ => corner.to_le_bytes().to_vec(),
    };
    corners.iter().flat_map(number).collect()
}

/// A document with one mesh; the buffer has its positions and then its indices.
fn document(component_type: u32, mode: u32, corners: &[u32]) -> (Value, Vec<u8>) {
    let positions = positions();
    let indices = indices(component_type, corners);
    let buffer = [positions.clone(), indices.clone()].concat();
    let document = json!({
        "asset": {"version": "2.0", "generator": "a test"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": "part"}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "NORMAL": 7}, "indices": 1, "mode": mode, "material": 3}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": VERTICES.len(), "type": "VEC3"},
            {"bufferView": 1, "componentType": component_type, "count": corners.len(), "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteLength": positions.len()},
            {"buffer": 0, "byteOffset": positions.len(), "byteLength": indices.len()},
        ],
        "buffers": [{"byteLength": buffer.len(), "uri": embedded(&buffer)}],
        "images": [{"uri": "not-there.png"}],
    });
    (document, buffer)
}

fn tetrahedron() -> Value {
    document(5123, 4, &FACES).0
}

fn glb(document: &Value, buffer: Option<&[u8]>) -> Vec<u8> {
    let mut json = document.to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut parts = [&(json.len() as u32).to_le_bytes()[..], b"JSON", &json].concat();
    if let Some(buffer) = buffer {
        parts.extend([&(buffer.len() as u32).to_le_bytes()[..], b"BIN\0", buffer].concat());
    }
    [b"glTF", &2_u32.to_le_bytes()[..], &(12 + parts.len() as u32).to_le_bytes(), &parts].concat()
}

fn same_as_tetrahedron(mesh: &TriangleMesh) {
    assert_eq!(mesh.vertices, VERTICES.map(|vertex| DVec3::from_array(vertex.map(f64::from))));
    assert_eq!(mesh.triangles.as_flattened(), FACES);
}

#[test]
fn every_index_type_and_container_gives_the_same_mesh() {
    for component_type in [5121, 5123, 5125] {
        let (mut document, buffer) = document(component_type, 4, &FACES);
        same_as_tetrahedron(&read_value(&document).unwrap());
        document["buffers"][0].as_object_mut().unwrap().remove("uri");
        same_as_tetrahedron(&read(&glb(&document, Some(&buffer))).unwrap());

        let dir = tempfile::tempdir().unwrap();
        std::fs::create_dir(dir.path().join("data")).unwrap();
        std::fs::write(dir.path().join("data/part 1.bin"), &buffer).unwrap();
        document["buffers"][0]["uri"] = json!("data/part%201.bin");
        let path = dir.path().join("part.gltf");
        same_as_tetrahedron(&parse(document.to_string().as_bytes(), &path).unwrap().mesh);
        std::fs::write(dir.path().join("data/part 1.bin"), &buffer[1..]).unwrap();
        let error = parse(document.to_string().as_bytes(), &path).unwrap_err().to_string();
        assert!(
            error.ends_with(&format!(
                "buffers[0]: cut, {} bytes announced, {} found",
                buffer.len(),
                buffer.len() - 1
            )),
            "{error}"
        );
    }
}

#[test]
fn strips_fans_and_bare_vertices_are_triangles() {
    let triangles =
        |mode, corners: &[u32]| read_value(&document(5121, mode, corners).0).unwrap().triangles;
    assert_eq!(triangles(5, &[0, 1, 2, 3, 3, 0]), [[0, 1, 2], [2, 1, 3]]);
    assert_eq!(triangles(6, &[3, 0, 1, 2]), [[3, 0, 1], [3, 1, 2]]);
    assert!(triangles(1, &[0, 1, 2, 3]).is_empty(), "lines are left out");
    let mut bare = tetrahedron();
    bare["meshes"][0]["primitives"][0].as_object_mut().unwrap().remove("indices");
    bare["accessors"][0]["count"] = json!(3);
    assert_eq!(read_value(&bare).unwrap().triangles, [[0, 1, 2]]);
}

#[test]
fn nodes_place_meshes_and_mirrors_turn_triangles() {
    let mut placed = tetrahedron();
    let half = std::f64::consts::FRAC_1_SQRT_2;
    placed["scenes"] = json!([{"nodes": [9]}, {"nodes": [0]}]);
    placed["scene"] = json!(1);
    placed["nodes"] = json!([
        {"children": [1, 2], "translation": [10, 0, 0], "rotation": [0, 0, half, half], "scale": [1, 1, 2]},
        {"mesh": 0, "scale": [-1, 1, 1]},
        {"mesh": 0, "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 5, 0, 1]},
        {"mesh": 0},
    ]);
    let mesh = read_value(&placed).unwrap();
    assert_eq!((mesh.vertices.len(), mesh.triangles.len()), (8, 8));
    // A quarter turn about z takes x to y and y to -x.
    let expected = [[10.0, 0.0, 0.0], [10.0, -1.0, 0.0], [8.0, 0.0, 0.0], [10.0, 0.0, 6.0]];
    for (found, expected) in mesh.vertices.iter().zip(expected) {
        assert!(found.distance(DVec3::from_array(expected)) < 1e-12, "{found}");
    }
    assert!(mesh.vertices[5].distance(DVec3::new(5.0, 1.0, 0.0)) < 1e-12);
    let report = crate::mesh::validate::inspect(&mesh);
    assert!(
        report.closed
            && report.inconsistent_edges == 0
            && (report.signed_volume_m3 - 4.0).abs() < 1e-12,
        "{report:?}"
    );
    placed.as_object_mut().unwrap().remove("scene");
    placed.as_object_mut().unwrap().remove("scenes");
    assert_eq!(
        read_value(&placed).unwrap().triangles.len(),
        12,
        "every node without a parent begins"
    );
    placed["nodes"] = json!([]);
    same_as_tetrahedron(&read_value(&placed).unwrap());
}

#[test]
fn sparse_and_quantized_positions_are_read() {
    let mut sparse = tetrahedron();
    let changes =
        [&[1_u8, 0, 3, 0][..], &[7.0_f32, 8.0, 9.0, 0.0, 0.0, 4.0].map(f32::to_le_bytes).concat()]
            .concat();
    sparse["buffers"]
        .as_array_mut()
        .unwrap()
        .push(json!({"byteLength": 28, "uri": embedded(&changes)}));
    let views = sparse["bufferViews"].as_array_mut().unwrap();
    views.extend([
        json!({"buffer": 1, "byteLength": 4}),
        json!({"buffer": 1, "byteOffset": 4, "byteLength": 24}),
    ]);
    sparse["accessors"][0]["sparse"] = json!({"count": 2, "indices": {"bufferView": 2, "componentType": 5123}, "values": {"bufferView": 3}});
    let mesh = read_value(&sparse).unwrap();
    assert_eq!(
        mesh.vertices[1..],
        [DVec3::new(7.0, 8.0, 9.0), DVec3::new(0.0, 2.0, 0.0), DVec3::new(0.0, 0.0, 4.0)]
    );
    sparse["accessors"][0].as_object_mut().unwrap().remove("bufferView");
    assert_eq!(read_value(&sparse).unwrap().vertices[2], DVec3::ZERO);
    sparse["accessors"][0]["sparse"]["count"] = json!(5);
    assert_eq!(message(&sparse), "folder/part.gltf: accessors[0]: 5 sparse elements of 4");

    // Signed bytes, four apart, as parts of 127.
    let mut quantized = tetrahedron();
    let bytes: Vec<u8> =
        VERTICES.iter().flat_map(|[x, y, z]| [*x as u8 * 127, *y as u8, *z as u8, 99]).collect();
    quantized["extensionsRequired"] = json!(["KHR_mesh_quantization", "KHR_materials_unlit"]);
    quantized["buffers"]
        .as_array_mut()
        .unwrap()
        .push(json!({"byteLength": 16, "uri": embedded(&bytes)}));
    quantized["bufferViews"]
        .as_array_mut()
        .unwrap()
        .push(json!({"buffer": 1, "byteLength": 16, "byteStride": 4}));
    quantized["accessors"][0] = json!({"bufferView": 2, "componentType": 5120, "normalized": true, "count": 4, "type": "VEC3"});
    let mesh = read_value(&quantized).unwrap();
    assert_eq!(mesh.vertices[1], DVec3::X);
    assert_eq!(mesh.vertices[2].y, 2.0 / 127.0);
    assert_eq!(mesh.vertices[3].z, 3.0 / 127.0);
}

#[test]
fn a_box_survives_the_journey() {
    let shape = Shape::Box { size_m: DVec3::new(0.1, 0.2, 0.3) }.tessellate(1.0);
    let positions: Vec<u8> = shape
        .vertices
        .iter()
        .flat_map(|v| v.as_vec3().to_array())
        .flat_map(f32::to_le_bytes)
        .collect();
    let indices: Vec<u8> =
        shape.triangles.as_flattened().iter().flat_map(|corner| corner.to_le_bytes()).collect();
    let mut document = document(5125, 4, &[0, 1, 2]).0;
    document["accessors"][0]["count"] = json!(shape.vertices.len());
    document["accessors"][1]["count"] = json!(3 * shape.triangles.len());
    document["bufferViews"] = json!([{"buffer": 0, "byteLength": positions.len()}, {"buffer": 1, "byteLength": indices.len()}]);
    document["buffers"] = json!([
        {"byteLength": positions.len(), "uri": embedded(&positions)},
        {"byteLength": indices.len(), "uri": embedded(&indices)},
    ]);
    let mesh = read_value(&document).unwrap();
    assert_eq!(mesh.triangles, shape.triangles);
    assert!(
        mesh.vertices
            .iter()
            .zip(&shape.vertices)
            .all(|(found, vertex)| found.distance(*vertex) < 1e-8)
    );
}

#[test]
fn errors_name_the_key_and_the_value() {
    let with = |pointer: &str, value: Value| {
        let mut document = tetrahedron();
        *document.pointer_mut(pointer).unwrap() = value;
        message(&document)
    };
    let file = "folder/part.gltf";
    assert_eq!(
        with("/asset/version", json!("1.0")),
        format!("{file}: version 2 of the format is read, found `1.0`")
    );
    assert_eq!(with("/scene", json!(1)), format!("{file}: scenes[1] is not there"));
    assert_eq!(with("/scenes/0/nodes", json!([4])), format!("{file}: nodes[4] is not there"));
    assert_eq!(
        with("/scenes/0/nodes", json!([0, 0])),
        format!("{file}: nodes[0] stands in the scene twice, or in a loop")
    );
    assert_eq!(
        with("/nodes", json!([{"children": [0]}])),
        format!("{file}: nodes[0] stands in the scene twice, or in a loop")
    );
    assert_eq!(with("/nodes/0/mesh", json!(2)), format!("{file}: meshes[2] is not there"));
    assert_eq!(
        with("/accessors/0/count", json!(u64::MAX)),
        format!(
            "{file}: accessors[0]: 18446744073709551615 elements announced, bufferViews[0] has 48 \
                bytes"
        )
    );
    assert_eq!(
        with("/accessors/1/count", json!(11)),
        format!("{file}: meshes[0].primitives[0]: 11 corners are no whole number of triangles")
    );
    assert_eq!(
        with("/accessors/0/type", json!("VEC4")),
        format!("{file}: accessors[0]: type VEC3 is needed here, found `VEC4`")
    );
    assert_eq!(
        with("/accessors/0/componentType", json!(9)),
        format!("{file}: accessors[0]: componentType 9 cannot be used here")
    );
    assert_eq!(
        with("/accessors/1/componentType", json!(5122)),
        format!(
            "{file}: meshes[0].primitives[0]: accessors[1] has no unsigned integers, as indices \
                must be"
        )
    );
    assert_eq!(
        with("/accessors/0/count", json!(3)),
        format!("{file}: meshes[0].primitives[0]: names vertex 3 (counted from 0), it has 3")
    );
    assert_eq!(
        with("/bufferViews/1/byteLength", json!(100)),
        format!("{file}: accessors[1]: bufferViews[1] ends at byte 148, buffers[0] has 72")
    );
    assert_eq!(
        with("/buffers/0/byteLength", json!(73)),
        format!("{file}: buffers[0]: cut, 73 bytes announced, 72 found")
    );
    assert_eq!(
        with("/buffers/0/uri", json!("../part.bin")),
        format!("{file}: buffers[0]: uri `../part.bin` must name a file beside this one")
    );
    assert_eq!(with("/buffers/0/uri", json!("none.bin")), "folder/none.bin: no such file");
    assert_eq!(
        with("/buffers/0/uri", json!("data:text/plain,abc")),
        format!("{file}: buffers[0]: a data uri must be base64")
    );
    let mut compressed = tetrahedron();
    compressed["extensionsRequired"] = json!(["KHR_draco_mesh_compression"]);
    assert!(message(&compressed).contains("KHR_draco_mesh_compression"));
    let mut nowhere = tetrahedron();
    nowhere["accessors"][0].as_object_mut().unwrap().remove("bufferView");
    nowhere["accessors"][0]["count"] = json!(4_000_000_000_u32);
    assert_eq!(
        message(&nowhere),
        format!("{file}: accessors[0]: 4000000000 elements without a buffer")
    );
    let error = read(b"{\"asset\":\n{\"version\": 2}}").unwrap_err().to_string();
    assert_eq!(
        error,
        format!("{file}:2: not a glTF document: invalid type: integer `2`, expected a string")
    );
}

#[test]
fn every_cut_of_a_binary_file_is_an_error() {
    let (mut document, buffer) = document(5123, 4, &FACES);
    document["buffers"][0].as_object_mut().unwrap().remove("uri");
    let whole = glb(&document, Some(&buffer));
    same_as_tetrahedron(&read(&whole).unwrap());
    for length in 4..whole.len() {
        let mut cut = whole[..length].to_vec();
        assert!(read(&cut).is_err(), "{length}");
        // The same with a header that agrees with the size.
        if length >= 12 {
            cut[8..12].copy_from_slice(&(length as u32).to_le_bytes());
            assert!(read(&cut).is_err(), "{length}");
        }
    }
    assert_eq!(
        read(&whole[..whole.len() - 1]).unwrap_err().to_string(),
        format!(
            "folder/part.gltf: byte 8: cut, {} bytes announced, {} found",
            whole.len(),
            whole.len() - 1
        )
    );
}

#[test]
fn copies_beyond_all_measure_are_refused() {
    // 300 vertices and 100 triangles, placed 60,000 times.
    let mut many = tetrahedron();
    let positions = vec![0_u8; 300 * 12];
    many["buffers"] = json!([{"byteLength": positions.len(), "uri": embedded(&positions)}]);
    many["bufferViews"] = json!([{"buffer": 0, "byteLength": positions.len()}]);
    many["accessors"] =
        json!([{"bufferView": 0, "componentType": 5126, "count": 300, "type": "VEC3"}]);
    many["meshes"] = json!([{"primitives": [{"attributes": {"POSITION": 0}}]}]);
    many["nodes"] = json!(vec![json!({"mesh": 0}); 60_000]);
    many["scenes"][0]["nodes"] = json!((0..60_000).collect::<Vec<_>>());
    let error = read_value(&many).unwrap_err();
    assert!(
        matches!(error, MeshError::TooManyCopies { .. })
            && error.hint(&SettingNames::PLAIN).is_some(),
        "{error}"
    );
}

/// The tetrahedron, and so many nodes that place a second mesh.
fn beside_many_nodes(mesh: Value, n_nodes: usize) -> Value {
    let mut document = tetrahedron();
    document["meshes"].as_array_mut().unwrap().push(mesh);
    let mut nodes = vec![json!({"mesh": 1}); n_nodes];
    nodes[0] = json!({"mesh": 0});
    document["nodes"] = json!(nodes);
    document["scenes"][0]["nodes"] = json!((0..n_nodes).collect::<Vec<_>>());
    document
}

#[test]
fn nodes_do_not_go_through_what_a_mesh_has_beside_triangles() {
    // Each weight, or primitive, for each node would be 4·10⁹ steps.
    const N: usize = 60_000;
    let weights = json!({"primitives": [], "weights": vec![0; N]});
    same_as_tetrahedron(&read_value(&beside_many_nodes(weights, N)).unwrap());
    let mut primitives = vec![json!({"attributes": {}}); N];
    primitives[1] = json!({"attributes": {"POSITION": 0}, "mode": 1});
    let lines = json!({ "primitives": primitives });
    same_as_tetrahedron(&read_value(&beside_many_nodes(lines, N)).unwrap());
    // Those that are left keep their numbers.
    let wrong = json!({"primitives": [
        {"attributes": {}}, {"attributes": {"POSITION": 0}, "indices": 0},
    ]});
    assert!(message(&beside_many_nodes(wrong, 2)).contains("meshes[1].primitives[1]: "));
}

#[test]
fn a_file_that_many_buffers_name_is_read_once() {
    let (mut document, buffer) = document(5123, 4, &FACES);
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("part.bin"), &buffer).unwrap();
    document["buffers"] = json!([
        {"byteLength": buffer.len(), "uri": "part.bin"},
        {"byteLength": buffer.len(), "uri": "./part.bin"},
    ]);
    document["bufferViews"][1]["buffer"] = json!(1);
    let path = dir.path().join("part.gltf");
    same_as_tetrahedron(&parse(document.to_string().as_bytes(), &path).unwrap().mesh);
    let document = serde_json::from_value(document).unwrap();
    let buffers = Buffers::new(&document, None, 0, &path);
    for (accessor, n_components) in [(0, 3), (1, 1)] {
        assert_eq!(buffers.numbers(accessor, n_components).unwrap().len(), 12);
    }
    assert_eq!(buffers.take_new_bytes(), buffer.len());
}

#[test]
fn a_buffer_that_is_a_git_lfs_pointer_is_called_by_its_name() {
    let (mut document, buffer) = document(5123, 4, &FACES);
    let dir = tempfile::tempdir().unwrap();
    let pointer = "version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345\n";
    std::fs::write(dir.path().join("part.bin"), pointer).unwrap();
    document["buffers"][0] = json!({"byteLength": buffer.len() + 1000, "uri": "part.bin"});
    let path = dir.path().join("part.gltf");
    let error = parse(document.to_string().as_bytes(), &path).unwrap_err();
    assert!(
        error.to_string().ends_with("part.bin: this is a git-lfs pointer, not the file"),
        "{error}"
    );
    assert_eq!(error.hint(&SettingNames::PLAIN), Some("run `git lfs pull`".to_owned()));
}

#[test]
fn morph_weights_instances_and_skins_are_said_not_to_be_applied() {
    let notes = |document: &Value| {
        let file = parse(document.to_string().as_bytes(), Path::new("part.gltf")).unwrap();
        same_as_tetrahedron(&file.mesh);
        file.notes
    };
    let said = |what: &str| {
        [format!("not applied are {what}: export the mesh with them applied")].to_vec()
    };
    let mut of_mesh = tetrahedron();
    of_mesh["meshes"][0]["weights"] = json!([0, 0.25]);
    assert_eq!(notes(&of_mesh), said("the morph weights of nodes[0]"));
    // The node has the last word.
    of_mesh["nodes"][0]["weights"] = json!([0, 0]);
    assert!(notes(&of_mesh).is_empty());
    of_mesh["nodes"] = json!([]);
    of_mesh.as_object_mut().unwrap().remove("scene");
    assert_eq!(notes(&of_mesh), said("the morph weights of meshes[0]"));

    let mut of_node = tetrahedron();
    of_node["nodes"][0]["weights"] = json!([-0.5]);
    of_node["nodes"][0]["skin"] = json!(0);
    of_node["nodes"][0]["extensions"] =
        json!({"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": 7}}, "other": {}});
    assert_eq!(
        notes(&of_node),
        said(
            "the morph weights of nodes[0], the instances (EXT_mesh_gpu_instancing) of nodes[0], \
                the skin of nodes[0]"
        )
    );
    // What is not in the scene is not missed.
    of_node["nodes"] = json!([{"mesh": 0}, of_node["nodes"][0]]);
    assert!(notes(&of_node).is_empty());
}

#[test]
fn coordinates_are_as_coarse_as_their_own_numbers_not_as_where_a_node_puts_them() {
    let rounding = |document: &Value| {
        parse(document.to_string().as_bytes(), Path::new("part.gltf")).unwrap().rounding
    };
    let mut document = tetrahedron();
    document["nodes"][0]["translation"] = json!([1e7, 0, 0]);
    document["nodes"][0]["scale"] = json!([1, 4, 1]);
    // Numbers at 3 are 2^-22 apart.
    let expected = Rounding { distance_m: 12.0, step_m: 4.0 * 2.0_f64.powi(-22) };
    assert_eq!(rounding(&document), Some(expected));
}
