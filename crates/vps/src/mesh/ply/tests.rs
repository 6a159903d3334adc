use super::*;
use crate::setting_names::SettingNames;

const VERTICES: [[f64; 3]; 4] =
    [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 3.0]];
const FACES: [[u8; 3]; 4] = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];

fn read(bytes: &[u8]) -> Result<TriangleMesh, MeshError> {
    parse(bytes, Path::new("part.ply")).map(|file| file.mesh)
}

fn message(text: &str) -> String {
    read(text.as_bytes()).unwrap_err().to_string()
}

fn encode(word: &str, value: f64, big: bool) -> Vec<u8> {
    macro_rules! as_type {
        ($t:ty) => {
            if big {
                (value as $t).to_be_bytes().to_vec()
            } else {
                (value as $t).to_le_bytes().to_vec()
            }
        };
    }
    match word {
        "char" | "int8" => as_type!(i8),
        "uchar" | "uint8" => as_type!(u8),
        "short" | "int16" => as_type!(i16),
        "ushort" | "uint16" => as_type!(u16),
        "int" | "int32" => as_type!(i32),
        "uint" | "uint32" => as_type!(u32),
        "float" | "float32" => as_type!(f32),
        "double" | "float64" => as_type!(f64),
        _ => panic!("{word}"),
    }
}

/// A tetrahedron with things to skip: a camera before the vertices, colours, a list per vertex,
/// flags per face, and edges.
fn tetrahedron(encoding: &str, position: &str, count: &str, index: &str, end: &str) -> Vec<u8> {
    let header = format!(
        "ply\nformat {encoding} 1.0\ncomment made by hand\nobj_info none\nelement camera \
            1\nproperty float f\nelement vertex 4\nproperty uchar red\nproperty {position} \
            x\nproperty {position} z\nproperty list uchar double rest\nproperty {position} \
            y\nelement face 4\nproperty int flag\nproperty list {count} {index} \
            vertex_indices\nproperty list ushort short more\nelement nothing 9\nelement edge \
            1\nproperty int vertex1\nend_header\n"
    );
    let mut bytes = header.replace('\n', end).into_bytes();
    let mut put = |row: &[(&str, f64)]| match encoding {
        "ascii" => {
            let words: Vec<String> = row.iter().map(|(_, value)| value.to_string()).collect();
            bytes.extend(words.join(" ").bytes());
            bytes.extend(end.bytes());
        }
        _ => bytes.extend(
            row.iter()
                .flat_map(|(word, value)| encode(word, *value, encoding == "binary_big_endian")),
        ),
    };
    put(&[("float", 35.0)]);
    for (k, [x, y, z]) in VERTICES.into_iter().enumerate() {
        let mut row = vec![("uchar", 200.0), (position, x), (position, z), ("uchar", k as f64)];
        row.extend(std::iter::repeat_n(("double", 0.25), k));
        row.push((position, y));
        put(&row);
    }
    for [a, b, c] in FACES.map(|face| face.map(f64::from)) {
        put(&[
            ("int", -7.0),
            (count, 3.0),
            (index, a),
            (index, b),
            (index, c),
            ("ushort", 2.0),
            ("short", -1.0),
            ("short", 1.0),
        ]);
    }
    put(&[("int", 3.0)]);
    bytes
}

#[test]
fn every_encoding_and_type_gives_the_same_mesh() {
    let integers = [
        "char", "uchar", "short", "ushort", "int", "uint", "int8", "uint8", "int16", "uint16",
        "int32", "uint32",
    ];
    for encoding in ["ascii", "binary_little_endian", "binary_big_endian"] {
        for position in ["float", "double", "float32", "float64", "int", "short", "char", "uint8"] {
            for (k, count) in integers.iter().enumerate() {
                let index = integers[(k * 5 + 1) % integers.len()];
                for end in ["\n", "\r\n", "\r"] {
                    let mesh = read(&tetrahedron(encoding, position, count, index, end)).unwrap();
                    assert_eq!(
                        mesh.vertices,
                        VERTICES.map(DVec3::from_array),
                        "{encoding} {position}"
                    );
                    assert_eq!(
                        mesh.triangles,
                        FACES.map(|face| face.map(u32::from)),
                        "{encoding} {count} {index}"
                    );
                }
            }
        }
    }
}

#[test]
fn polygons_are_cut_and_strips_unrolled() {
    let header = "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float \
        y\nproperty float z\n";
    let vertices = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n0 2 0\n";
    let faces = "element face 4\nproperty list uchar int vertex_index\nend_header\n";
    let mesh = read(format!("{header}{faces}{vertices}4 0 1 2 3\n3 3 2 4\n2 0 1\n0\n").as_bytes())
        .unwrap();
    assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3], [3, 2, 4]]);
    let strips = "element tristrips 1\nproperty list int int vertex_indices\nend_header\n";
    let mesh =
        read(format!("{header}{strips}{vertices}10 0 1 3 2 4 -1 1 2 3 3\n").as_bytes()).unwrap();
    assert_eq!(mesh.triangles, [[0, 1, 3], [3, 1, 2], [3, 2, 4], [1, 2, 3]]);
    let behind = "ply\nformat ascii 1.0\nelement face 1\nproperty list uchar int \
        vertex_indices\nelement vertex 3\nproperty float x\nproperty float y\nproperty float \
        z\nend_header\n3 0 1 2 0 0 0 1 0 0 0 1 0";
    assert_eq!(read(behind.as_bytes()).unwrap().triangles, [[0, 1, 2]]);
}

#[test]
fn every_cut_is_an_error() {
    for encoding in ["ascii", "binary_little_endian", "binary_big_endian"] {
        let bytes = tetrahedron(encoding, "float", "uchar", "int", "\n");
        // Text may lose its last line end.
        for length in 0..bytes.len() - 2 {
            let error = read(&bytes[..length]).unwrap_err();
            assert!(
                matches!(error, MeshError::Parse { .. } | MeshError::Binary { .. }),
                "{length}: {error}"
            );
            assert!(error.hint(&SettingNames::PLAIN).is_some());
        }
    }
}

#[test]
fn announced_numbers_are_checked_before_room_is_made() {
    let header = |encoding: &str, n_vertices: &str, n_faces: &str| {
        format!(
            "ply\nformat {encoding} 1.0\nelement vertex {n_vertices}\nproperty float x\nproperty \
                float y\nproperty float z\nelement face {n_faces}\nproperty list uint int \
                vertex_indices\nend_header\n"
        )
    };
    let many = "18446744073709551615";
    assert_eq!(
        message(&header("ascii", many, "0")),
        format!("part.ply:10: the header announces {many} of `vertex`, the file has room for 0")
    );
    let mut bytes = header("binary_little_endian", "1", "4000000000").into_bytes();
    bytes.extend([0; 24]);
    let error = read(&bytes).unwrap_err().to_string();
    assert!(
        error.ends_with("the header announces 4000000000 of `face`, the file has room for 3"),
        "{error}"
    );
    let mut bytes = header("binary_little_endian", "1", "1").into_bytes();
    bytes.extend([0; 12]);
    bytes.extend(4_000_000_000_u32.to_le_bytes());
    let error = read(&bytes).unwrap_err().to_string();
    assert!(error.contains("a list of 4000000000 numbers, the file has room for 0"), "{error}");
    // An element without properties takes no bytes, so any number of them is there, and none is
    // counted.
    let empty = header("ascii", "0", "0")
        .replace("end_header", &format!("element nothing {many}\nend_header"));
    assert!(read(empty.as_bytes()).unwrap().triangles.is_empty());
}

#[test]
fn errors_name_the_place_and_the_value() {
    let good = String::from_utf8(tetrahedron("ascii", "float", "uchar", "int", "\n")).unwrap();
    let vertex = good.lines().position(|line| line.starts_with("200 1 0 1 0.25 0")).unwrap() + 1;
    assert_eq!(
        message(&good.replace("200 1 0 1 0.25 0", "200 1 x 1 0.25 0")),
        format!("part.ply:{vertex}: `vertex` 2 needs a number, found `x`")
    );
    assert_eq!(
        message(&good.replace("200 1 0 1 0.25 0", "200 1 nan 1 0.25 0")),
        format!("part.ply:{vertex}: vertex 2 is not finite")
    );
    assert_eq!(
        message(&good.replace("-7 3 1 2 3", "-7 3 1 4 3")),
        format!("part.ply:{}: a face names vertex 4 (counted from 0), the file has 4", vertex + 5)
    );
    assert_eq!(
        message(&good.replace("-7 3 1 2 3", "-7 3 1 2.5 3")),
        format!("part.ply:{}: `face` 3 needs an integer, found `2.5`", vertex + 5)
    );
    let mut binary = tetrahedron("binary_big_endian", "float", "uchar", "int", "\n");
    let place = binary.len() - 4 - (4 + 1 + 12 + 2 + 4);
    binary[place + 5] = 1;
    assert_eq!(
        read(&binary).unwrap_err().to_string(),
        format!(
            "part.ply: byte {place}: a face names vertex 16777218 (counted from 0), the file has 4"
        )
    );
    assert_eq!(message("solid\n"), "part.ply:1: a PLY file begins with the line `ply`");
    assert_eq!(
        message("ply\nformat ascii 2.0\n"),
        "part.ply:2: version 1.0 of the format is read, found `2.0`"
    );
    assert_eq!(
        message("ply\nformat asci 1.0\n"),
        "part.ply:2: wrong header line `format asci 1.0`"
    );
    assert_eq!(message("ply\nproperty int x\n"), "part.ply:2: wrong header line `property int x`");
    assert_eq!(message("ply\nend_header\n"), "part.ply:2: the header has no line `format`");
    assert_eq!(
        message("ply\nformat ascii 1.0\n"),
        "part.ply:2: the header ends without `end_header`, so the file was cut"
    );
    assert_eq!(
        message("ply\nelement vertex 1\nelement vertex 1\n"),
        "part.ply:3: element `vertex` is announced twice"
    );
    let header = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float \
        y\nend_header\n1 2\n";
    assert_eq!(message(header), "part.ply:7: `vertex` needs the properties x, y and z");
    let header = "ply\nformat ascii 1.0\nelement face 1\nproperty list uchar float \
        vertex_indices\nend_header\n1 2\n";
    assert_eq!(message(header), "part.ply:6: `face` needs a list of integers named vertex_indices");
}
