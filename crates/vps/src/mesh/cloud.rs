//! Points without faces: scans and samples.
//!
//! | format | read |
//! |---|---|
//! | PLY | `x y z`, and `nx ny nz`, `red green blue` where all three are there; text and binary of both byte orders |
//! | OBJ | `v`, with colours as numbers four to six, and `vn` where there are as many |
//! | XYZ (`.xyz`, `.txt`, `.asc`) | a point in each line: `x y z [nx ny nz [red green blue]]` or `x y z red green blue`, by blanks or commas |
//!
//! Normals and colours are as the file has them: nothing is checked but that positions are finite.

use std::path::Path;

use super::load::{named_for_what_it_is, scale};
pub use super::points::Cloud;
use super::{Foreign, Format, MeshError, TriangleMesh, obj, parse, ply, source, xyz};

/// File name extensions that hold points only, lower case.
pub const EXTENSIONS: &[&str] = &["xyz", "txt", "asc"];

/// What a file holds.
#[derive(Clone, Debug)]
pub enum Contents {
    /// Points without faces.
    Cloud(Cloud),
    /// A mesh, in any format that [`super::load()`] reads.
    Mesh(TriangleMesh),
}

/// Reads a file of points or a mesh, the format chosen by its extension (any case), and scales it
/// to metres.
///
/// # Errors
/// [`MeshError`], naming the path and, where it is known, the line.
pub fn load(path: &Path, metres_per_unit: f64) -> Result<Contents, MeshError> {
    if !is_text(path) {
        // A wrong name before a missing file.
        Format::of(path)?;
    }
    let bytes = source::read(path)?;
    bytes.confirm(read(&bytes, path, metres_per_unit), path)
}

/// The same for a file whose bytes are at hand.
///
/// # Errors
/// [`MeshError`].
pub fn read(bytes: &[u8], path: &Path, metres_per_unit: f64) -> Result<Contents, MeshError> {
    let (format, cloud) = if is_text(path) {
        (None, xyz::parse(bytes, path).map(Some))
    } else {
        let format = Format::of(path)?;
        let cloud = match format {
            Format::Ply => ply::parse_cloud(bytes, path),
            Format::Obj => obj::parse_cloud(bytes, path),
            Format::Stl | Format::Gltf | Format::ThreeMf => Ok(None),
        };
        (Some(format), cloud)
    };
    // Text of another kind has no vertex in the eyes of a reader of OBJ.
    let cloud = match cloud {
        Ok(Some(cloud)) if cloud.positions.is_empty() && Foreign::recognise(bytes).is_some() => {
            Err(MeshError::Empty { path: path.to_owned() })
        }
        cloud => cloud,
    };
    match cloud.map_err(|error| named_for_what_it_is(error, bytes, format, path))? {
        Some(mut cloud) => {
            scale(&mut cloud.positions, metres_per_unit, path)?;
            Ok(Contents::Cloud(cloud))
        }
        None => parse(bytes, Format::of(path)?, path, metres_per_unit).map(Contents::Mesh),
    }
}

fn is_text(path: &Path) -> bool {
    path.extension().is_some_and(|extension| {
        EXTENSIONS.iter().any(|known| extension.eq_ignore_ascii_case(known))
    })
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    fn cloud(bytes: &[u8], name: &str) -> Cloud {
        match read(bytes, Path::new(name), 1e-3).unwrap() {
            Contents::Cloud(cloud) => cloud,
            Contents::Mesh(_) => panic!("{name} is a mesh"),
        }
    }

    fn message(bytes: &[u8], name: &str) -> String {
        read(bytes, Path::new(name), 1.0).unwrap_err().to_string()
    }

    #[test]
    fn the_same_points_in_every_format_are_the_same_points() {
        let expected = Cloud {
            positions: vec![DVec3::new(1.0, 2.0, 3.0) * 1e-3, DVec3::new(-4.0, 0.5, 6.0) * 1e-3],
            normals: Some(vec![DVec3::X, DVec3::new(0.0, 0.6, -0.8)]),
            colors: Some(vec![[255, 0, 51], [0, 102, 255]]),
        };
        let rows = "1 2 3 1 0 0 255 0 51\n-4 0.5 6 0 0.6 -0.8 0 102 255\n";
        for text in [
            rows.to_owned(),
            rows.replace(' ', ","),
            rows.replace(' ', " ;\t"),
            format!("# scan\n//x y z\n\n2\n{rows}"),
            format!("x y z nx ny nz r g b\n{}", rows.replace('\n', "\r\n")),
        ] {
            for name in ["a.xyz", "a.TXT", "a.asc"] {
                assert_eq!(cloud(text.as_bytes(), name), expected, "{text}");
            }
        }
        let obj = "v 1 2 3 1 0 0.2\nvn 1 0 0\nv -4 0.5 6 0 0.4 1 # last\nvn 0 0.6 -0.8\n";
        assert_eq!(cloud(obj.as_bytes(), "a.obj"), expected);
        let header = |encoding: &str, color: &str| {
            format!(
                "ply\nformat {encoding} 1.0\nelement vertex 2\nproperty double x\nproperty double \
                    y\nproperty double z\nproperty {color} red\nproperty {color} green\nproperty \
                    {color} blue\nproperty float confidence\nproperty double nx\nproperty double \
                    ny\nproperty double nz\nelement face 0\nproperty list uchar int \
                    vertex_indices\nend_header\n"
            )
        };
        let text = header("ascii", "uchar")
            + "1 2 3 255 0 51 0.5 1 0 0\n-4 0.5 6 0 102 255 0.5 0 0.6 -0.8\n";
        assert_eq!(cloud(text.as_bytes(), "a.ply"), expected);
        let text =
            header("ascii", "float") + "1 2 3 1 0 0.2 0.5 1 0 0\n-4 0.5 6 0 0.4 1 0.5 0 0.6 -0.8\n";
        assert_eq!(cloud(text.as_bytes(), "a.ply"), expected);
        for encoding in ["binary_little_endian", "binary_big_endian"] {
            let mut bytes = header(encoding, "uchar").into_bytes();
            let is_big = encoding == "binary_big_endian";
            let double =
                |value: f64| if is_big { value.to_be_bytes() } else { value.to_le_bytes() };
            for (at, color, normal) in [
                ([1.0, 2.0, 3.0], [255_u8, 0, 51], [1.0, 0.0, 0.0]),
                ([-4.0, 0.5, 6.0], [0, 102, 255], [0.0, 0.6, -0.8]),
            ] {
                bytes.extend(at.iter().flat_map(|value| double(*value)));
                bytes.extend(color);
                bytes.extend([0; 4]);
                bytes.extend(normal.iter().flat_map(|value| double(*value)));
            }
            assert_eq!(cloud(&bytes, "a.ply"), expected, "{encoding}");
        }
    }

    #[test]
    fn columns_of_text_are_reported_apart() {
        let colors = cloud(b"0 0 0 255 255 0\n1 1 1 10 20 30\n", "a.xyz");
        assert_eq!(
            (colors.normals, colors.colors),
            (None, Some(vec![[255, 255, 0], [10, 20, 30]]))
        );
        let normals = cloud(b"0 0 0 0 0 1\n1 1 1 1 0 0\n", "a.xyz");
        assert_eq!((normals.normals, normals.colors), (Some(vec![DVec3::Z, DVec3::X]), None));
        assert_eq!(cloud(b"0 0 0\n1 1 1\n", "a.xyz").normals, None);
        assert_eq!(cloud(b"v 0 0 0\nv 1 1 1\nvn 0 0 1\n", "a.obj").normals, None);
    }

    #[test]
    fn files_with_faces_are_meshes() {
        let obj = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
        assert!(
            matches!(read(obj, Path::new("a.obj"), 1.0), Ok(Contents::Mesh(mesh)) if mesh.triangles.len() == 1)
        );
        let ply =
            b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n\
                    property list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
        assert!(
            matches!(read(ply, Path::new("a.ply"), 1.0), Ok(Contents::Mesh(mesh)) if mesh.triangles.len() == 1)
        );
    }

    #[test]
    fn errors_name_line_and_value() {
        assert_eq!(message(b"0 0 0\n1 x 0\n", "a.xyz"), "a.xyz:2: `x` is no number");
        assert_eq!(
            message(b"0 0 0\n1 0\n", "a.xyz"),
            "a.xyz:2: 2 numbers, the lines before have 3"
        );
        assert!(
            message(b"0 0\n", "a.xyz")
                .starts_with("a.xyz:1: 2 columns of numbers found, understood are 3 (x y z), 6 ")
        );
        assert_eq!(message(b"0 0 0\n0 nan 0\n", "a.xyz"), "a.xyz:2: vertex 2 is not finite");
        assert_eq!(message(b"v 0 0 0\nv 0 inf 0\n", "a.obj"), "a.obj:2: vertex 2 is not finite");
        assert_eq!(
            message(b"v 0 0 0\nvn 0 0\n", "a.obj"),
            "a.obj:2: a normal needs three numbers, found `vn 0 0`"
        );
        assert_eq!(
            message(b"1e300 0 0\n", "a.xyz"),
            "a.xyz: vertex 1 is 1.0e300 m away from the origin"
        );
        assert!(message(b"", "a.shape").contains("unknown mesh extension `shape`"));
        let cut = b"ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\nend_header\n0 0 0\n1 1";
        assert_eq!(
            message(cut, "a.ply"),
            "a.ply:8: the header announces 2 of `vertex`, the file has room for 1"
        );
    }
}
