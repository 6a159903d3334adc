//! Triangle meshes: readers, primitive shapes, validation, exact closest points.
//!
//! Data in: mesh files, shape parameters. Data out: one [`TriangleMesh`] in metres, a report on it ([`validate::inspect`]) and its
//! mass properties ([`mass::mass_properties`]).
//!
//! ```text
//!  file ─► source ─┬─► obj, ply, gltf, 3mf ─┐
//!   (mapped, read) └─► stl ─► weld ─────────┴─► TriangleMesh ─► validate ─► mass
//!            Shape ─► primitives ───────────────────┘    └────► closest_point (asked by the pointshell)
//! ```
//!
//! | format | read | not read |
//! |---|---|---|
//! | OBJ | every group, polygons, negative indices | free-form surfaces |
//! | STL | text and binary; equal corners are joined | normals, attributes |
//! | PLY | text and binary of both byte orders, numbers of any type, polygons, `tristrips` | attributes |
//! | glTF, GLB | default scene with its transforms; triangles, strips, fans; embedded and external buffers; sparse, quantized | skins, morph targets, Draco and meshopt compression |
//! | 3MF | what is built, with transforms; the production extension | beam lattices, slices, boolean operations, encryption |
//!
//! Points without faces are read by [`cloud`], from PLY, OBJ and plain text.
//!
//! Coordinates keep the axes of the file, and are multiplied by `units`, whatever a format says of metres; only 3MF names a unit in
//! the file, which then must be the same.
//!
//! Invariants: cold, nothing here runs while forces are rendered. Nothing here repairs a mesh: what is wrong with it is said,
//! and generation copes. No file, however damaged, ends the program: numbers that a file announces are checked against the bytes
//! that are there before room is made for them. Results do not depend on the number of threads. Cost: every step is linear in the
//! file; binary STL and the inspection run in parallel.

pub mod closest_point;
pub mod cloud;
mod edges;
mod error;
mod gltf;
pub mod mass;
mod obj;
mod ply;
pub(crate) mod polygon;
pub mod primitives;
mod room;
mod shards;
mod source;
mod stl;
mod threemf;
pub mod validate;
mod weld;
mod xyz;

use std::path::{Path, PathBuf};

use glam::DVec3;
use rayon::prelude::*;

pub use error::MeshError;

/// File name extensions that [`load`] reads, lower case.
pub const EXTENSIONS: &[&str] = &["obj", "stl", "ply", "gltf", "glb", "3mf"];

/// No part is this far from its origin; squares and fifth powers of what is nearer stay far inside the range of `f64`.
const FARTHEST_M: f64 = 1e9;

/// Sums over triangles are taken in pieces of this many, in parallel, and the pieces added in order: the rounding is then the same
/// for any number of threads.
const SUM_TRIANGLES: usize = 1 << 16;

/// A file format. Which of its encodings a file has is found in the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// Wavefront OBJ, text.
    Obj,
    /// STL, text or binary.
    Stl,
    /// PLY, text or binary.
    Ply,
    /// glTF 2.0, JSON or binary.
    Gltf,
    /// 3MF package.
    ThreeMf,
}

impl Format {
    /// The format that the extension of `path` names, in any case.
    ///
    /// # Errors
    /// [`MeshError::UnknownExtension`].
    pub fn of(path: &Path) -> Result<Self, MeshError> {
        let extension = path.extension().map(|extension| extension.to_string_lossy().to_lowercase()).unwrap_or_default();
        Ok(match extension.as_str() {
            "obj" => Self::Obj,
            "stl" => Self::Stl,
            "ply" => Self::Ply,
            "gltf" | "glb" => Self::Gltf,
            "3mf" => Self::ThreeMf,
            _ => return Err(MeshError::UnknownExtension { path: path.to_owned(), extension }),
        })
    }

    /// What a file is by its first bytes; `None` where they do not say: binary STL begins with free text, OBJ with anything.
    fn recognise(bytes: &[u8]) -> Option<Self> {
        let head = &bytes[..bytes.len().min(1024)];
        let has = |word: &[u8]| head.windows(word.len()).any(|window| window == word);
        let text = head.trim_ascii_start();
        if head.starts_with(b"ply\n") || head.starts_with(b"ply\r") {
            Some(Self::Ply)
        } else if head.starts_with(b"glTF") || text.starts_with(b"{") && has(b"\"asset\"") {
            Some(Self::Gltf)
        } else if head.starts_with(b"PK\x03\x04") && has(b".model") {
            Some(Self::ThreeMf)
        } else if text.starts_with(b"solid") && has(b"facet") && !head.contains(&0) {
            Some(Self::Stl)
        } else {
            // Comments may come first.
            let mut lines = text.split(|byte| *byte == b'\n').filter(|line| !line.trim_ascii().is_empty() && line[0] != b'#');
            let is_obj = |line: &[u8]| [&b"v "[..], b"o ", b"g ", b"mtllib "].iter().any(|word| line.starts_with(word));
            lines.next().is_some_and(is_obj).then_some(Self::Obj)
        }
    }

    /// The name that people know it by.
    fn name(self) -> &'static str {
        match self {
            Self::Obj => "OBJ",
            Self::Stl => "STL",
            Self::Ply => "PLY",
            Self::Gltf => "glTF",
            Self::ThreeMf => "3MF",
        }
    }

    /// What to do with a file of this format under another one's extension.
    fn rename_hint(self) -> &'static str {
        match self {
            Self::Obj => "rename it so that it ends in .obj",
            Self::Stl => "rename it so that it ends in .stl",
            Self::Ply => "rename it so that it ends in .ply",
            Self::Gltf => "rename it so that it ends in .gltf or .glb",
            Self::ThreeMf => "rename it so that it ends in .3mf",
        }
    }
}

/// Triangles over shared vertices, metres, in the mesh file's own frame.
#[derive(Clone, Debug, Default)]
pub struct TriangleMesh {
    /// `[n_vertices]`, metres.
    pub vertices: Vec<DVec3>,
    /// `[n_triangles]`, counter-clockwise seen from outside when the file is sound; every index is below `vertices.len()`.
    pub triangles: Vec<[u32; 3]>,
}

impl TriangleMesh {
    /// The three corners of triangle `triangle_idx`, metres.
    pub fn corners(&self, triangle_idx: usize) -> [DVec3; 3] {
        self.triangles[triangle_idx].map(|vertex| self.vertices[vertex as usize])
    }

    /// Lowest and highest corner of the box around the vertices that triangles use; `None` for an empty mesh.
    pub fn bounds(&self) -> Option<(DVec3, DVec3)> {
        let around = |corners: &[[u32; 3]]| {
            let mut used = corners.iter().flatten().map(|vertex| self.vertices[*vertex as usize]);
            let first = used.next()?;
            Some(used.fold((first, first), |(low, high), vertex| (low.min(vertex), high.max(vertex))))
        };
        let boxes: Vec<_> = self.triangles.par_chunks(SUM_TRIANGLES).filter_map(around).collect();
        boxes.into_iter().reduce(|(low, high), (other_low, other_high)| (low.min(other_low), high.max(other_high)))
    }
}

/// Reads a mesh file, the format chosen by its extension (any case), and scales it to metres.
///
/// Groups and objects of a file become one mesh. Materials, normals and texture coordinates are not read: normals of CAD files
/// are unreliable, and nothing here needs the others.
///
/// # Errors
/// [`MeshError`], naming the path and, where it is known, the line.
pub fn load(path: &Path, metres_per_unit: f64) -> Result<TriangleMesh, MeshError> {
    let format = Format::of(path)?;
    let bytes = source::read(path)?;
    bytes.confirm(parse(&bytes, format, path, metres_per_unit), path)
}

/// The same for a file whose bytes are at hand. `path` is for messages, and where files that this one names are looked for.
///
/// Damaged bytes give an error, never a panic; no allocation is larger than a small multiple of `bytes`.
///
/// # Errors
/// [`MeshError`], naming the path and, where it is known, the line or the byte.
pub fn parse(bytes: &[u8], format: Format, path: &Path, metres_per_unit: f64) -> Result<TriangleMesh, MeshError> {
    if bytes.is_empty() {
        return Err(MeshError::NoBytes { path: path.to_owned() });
    }
    let read = match format {
        Format::Obj => obj::parse(bytes, path),
        Format::Stl => stl::parse(bytes, path),
        Format::Ply => ply::parse(bytes, path),
        Format::Gltf => gltf::parse(bytes, path),
        Format::ThreeMf => threemf::parse(bytes, path, metres_per_unit),
    };
    let read = match read {
        Ok(mesh) if mesh.triangles.is_empty() => Err(MeshError::Empty { path: path.to_owned() }),
        read => read,
    };
    let mut mesh = read.map_err(|error| match Format::recognise(bytes) {
        // Only now: the free text at the head of a binary STL may say anything.
        Some(found) if found != format => MeshError::OtherFormat { path: path.to_owned(), found, named: format },
        _ => error,
    })?;
    scale(&mut mesh.vertices, metres_per_unit, path)?;
    Ok(mesh)
}

/// From the unit of the file to metres; refuses what is not finite, and what no part can be.
fn scale(vertices: &mut [DVec3], metres_per_unit: f64, path: &Path) -> Result<(), MeshError> {
    let wrong = vertices.par_iter_mut().enumerate().find_map_first(|(vertex_idx, vertex)| {
        *vertex *= metres_per_unit;
        (!vertex.is_finite() || vertex.abs().max_element() > FARTHEST_M).then_some((vertex_idx, *vertex))
    });
    match wrong {
        None => Ok(()),
        Some((vertex_idx, vertex)) if vertex.is_finite() => {
            let distance_m = vertex.abs().max_element();
            Err(MeshError::FarVertex { path: path.to_owned(), vertex: vertex_idx + 1, distance_m })
        }
        Some((vertex_idx, _)) => Err(MeshError::NonFiniteVertex { path: path.to_owned(), vertex: vertex_idx + 1, line: None }),
    }
}

/// From now on no mesh file is mapped into memory in this process, only copied: for a process that renders forces. A mapped file that another
/// program shortens would end it.
pub fn copy_only() {
    source::copy_only();
}

/// Other files that a mesh file takes its triangles from: the buffers that a glTF file names. Every other format has all in one.
///
/// # Errors
/// [`MeshError`] of a glTF file that cannot be read, or that names what it must not.
pub fn companions(path: &Path) -> Result<Vec<PathBuf>, MeshError> {
    match Format::of(path)? {
        Format::Gltf => {
            let bytes = source::read(path)?;
            bytes.confirm(gltf::companions(&bytes, path), path)
        }
        Format::Obj | Format::Stl | Format::Ply | Format::ThreeMf => Ok(Vec::new()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
        let error = at("part.step", "");
        assert!(
            error.to_string().ends_with("part.step: unknown mesh extension `step`, known: obj, stl, ply, gltf, glb, 3mf"),
            "{error}"
        );
        assert!(matches!(at("part", ""), MeshError::UnknownExtension { .. }));
        assert!(matches!(at("empty.obj", "# nothing\n"), MeshError::Empty { .. }));
        assert!(matches!(at("empty.stl", "solid nothing\nendsolid nothing\n"), MeshError::Empty { .. }));
        std::fs::create_dir(dir.path().join("folder.obj")).unwrap();
        let error = load(&dir.path().join("folder.obj"), 1.0).unwrap_err();
        assert!(matches!(error, MeshError::Unreadable { .. }) && error.hint().is_some(), "{error}");
        let path = dir.path().join("huge.obj");
        std::fs::write(&path, "v 0 0 0\nv 1e308 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
        assert!(matches!(load(&path, 1e3), Err(MeshError::NonFiniteVertex { vertex: 2, .. })));
    }

    #[test]
    fn a_wrong_extension_and_an_empty_file_are_named() {
        let refusal = |bytes: &[u8], name: &str| {
            let error = parse(bytes, Format::of(Path::new(name)).unwrap(), Path::new(name), 1.0).unwrap_err();
            (error.to_string(), error.hint().unwrap())
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
            let expected = format!("{name}: this is a file of the format {format}, and its name says {says}");
            assert_eq!(refusal(bytes, name), (expected, &*format!("rename it so that it ends in {ending}")));
        }
        for extension in EXTENSIONS {
            let name = format!("part.{extension}");
            assert_eq!(refusal(b"", &name).0, format!("{name}: no triangles: the file is empty"));
        }
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
        let (vertices, triangles) = (&shape.vertices, &shape.triangles);
        let mut files: Vec<(&str, Vec<u8>)> = Vec::new();

        let mut obj = String::new();
        vertices.iter().for_each(|v| writeln!(obj, "v {} {} {}", v.x, v.y, v.z).unwrap());
        triangles.iter().for_each(|t| writeln!(obj, "f {} {} {}", t[0] + 1, t[1] + 1, t[2] + 1).unwrap());
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

        for (name, encoding) in [("big.ply", "binary_big_endian"), ("little.ply", "binary_little_endian"), ("box.ply", "ascii")] {
            let mut ply = format!(
                "ply\nformat {encoding} 1.0\nelement vertex {}\nproperty double x\nproperty double y\nproperty double z\n\
                 element face {}\nproperty list uchar uint vertex_indices\nend_header\n",
                vertices.len(),
                triangles.len()
            )
            .into_bytes();
            let big = encoding == "binary_big_endian";
            for v in vertices {
                match encoding {
                    "ascii" => ply.extend(format!("{} {} {}\n", v.x, v.y, v.z).bytes()),
                    _ => ply.extend(v.to_array().iter().flat_map(|n| if big { n.to_be_bytes() } else { n.to_le_bytes() })),
                }
            }
            for t in triangles {
                match encoding {
                    "ascii" => ply.extend(format!("3 {} {} {}\n", t[0], t[1], t[2]).bytes()),
                    _ => {
                        ply.push(3);
                        ply.extend(t.iter().flat_map(|n| if big { n.to_be_bytes() } else { n.to_le_bytes() }));
                    }
                }
            }
            files.push((name, ply));
        }

        let mut buffer: Vec<u8> = vertices.iter().flat_map(|v| v.as_vec3().to_array()).flat_map(f32::to_le_bytes).collect();
        let n_position_bytes = buffer.len();
        buffer.extend(triangles.as_flattened().iter().flat_map(|corner| (*corner as u16).to_le_bytes()));
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
        let sizes = [12 + 8 + json.len() + 8 + buffer.len(), json.len(), buffer.len()].map(|size| (size as u32).to_le_bytes());
        let glb = [b"glTF\x02\0\0\0", &sizes[0][..], &sizes[1], b"JSON", &json, &sizes[2], b"BIN\0", &buffer].concat();
        files.extend([("box.gltf", document("box.bin".into())), ("box.glb", glb), ("box.bin", buffer.clone())]);

        let mut model = "<model unit=\"millimeter\"><resources><object id=\"1\"><mesh><vertices>".to_owned();
        vertices.iter().for_each(|v| write!(model, "<vertex x=\"{}\" y=\"{}\" z=\"{}\"/>", v.x, v.y, v.z).unwrap());
        model += "</vertices><triangles>";
        triangles.iter().for_each(|t| write!(model, "<triangle v1=\"{}\" v2=\"{}\" v3=\"{}\"/>", t[0], t[1], t[2]).unwrap());
        model += "</triangles></mesh></object></resources><build><item objectid=\"1\"/></build></model>";
        let mut archive = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
        archive.start_file("3D/3dmodel.model", zip::write::SimpleFileOptions::default()).unwrap();
        archive.write_all(model.as_bytes()).unwrap();
        files.push(("box.3mf", archive.finish().unwrap().into_inner()));

        let dir = tempfile::tempdir().unwrap();
        files.iter().for_each(|(name, bytes)| std::fs::write(dir.path().join(name), bytes).unwrap());
        let mut scaled = shape.clone();
        scaled.vertices.iter_mut().for_each(|vertex| *vertex *= 1e-3);
        let formats: Vec<&str> = files.iter().map(|(name, _)| *name).filter(|name| *name != "box.bin").collect();
        for name in &formats {
            let mesh = load(&dir.path().join(name), 1e-3).unwrap();
            assert_eq!(corner_set(&mesh), corner_set(&scaled), "{name}");
        }
        let ending = |name: &&str| name.rsplit('.').next().unwrap().to_lowercase();
        assert!(EXTENSIONS.iter().all(|extension| formats.iter().any(|name| ending(name) == *extension)));
    }

    proptest::proptest! {
        /// Damaged files give an error or a mesh with indices in range, never a panic.
        #[test]
        fn damaged_text_does_no_harm(text in "(v|f|l|solid|facet|vertex|endfacet|endsolid|[-0-9. /#\\\\]|nan|1e999|\n){0,80}") {
            for parse in [obj::parse, stl::parse] {
                for text in [text.clone(), format!("solid facet\n{text}"), format!("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 1\n{text}")] {
                    if let Ok(mesh) = parse(text.as_bytes(), Path::new("damaged")) {
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
    #[expect(clippy::print_stdout, reason = "the figures are for a reader; a test sets no limit on time")]
    fn millions_of_triangles_go_through() {
        let torus = primitives::Shape::Torus { major_m: 0.05, minor_m: 0.02 }.tessellate(0.0);
        let mut bytes = vec![0; 80];
        bytes.extend((torus.triangles.len() as u32).to_le_bytes());
        for triangle_idx in 0..torus.triangles.len() {
            bytes.extend([0; 12]);
            for corner in torus.corners(triangle_idx) {
                bytes.extend(corner.as_vec3().to_array().iter().flat_map(|number| number.to_le_bytes()));
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
        println!("{} triangles: load {loaded:.2?}, inspect {:.2?}", mesh.triangles.len(), start.elapsed() - loaded);
        assert_eq!((mesh.vertices.len(), mesh.triangles.len()), (torus.vertices.len(), torus.triangles.len()));
        assert!(report.closed && report.inconsistent_edges == 0, "{:?}", report.warnings());
    }

    /// Triangle counts and closedness of real files, which are not part of the project. Closed means: after welding, which also
    /// closes files that repeat the corners of their faces.
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
                "{name}: {} vertices, {report:?}, load {loaded:.1?}, inspect {inspected:.1?}, {mass:?}, {:?}",
                mesh.vertices.len(),
                report.warnings()
            );
            assert_eq!(mesh.triangles.len(), triangles, "{name}");
            assert_eq!(report.closed, closed, "{name}");
            assert!(mass.center_m.is_finite() && mass.inertia_per_mass.is_finite(), "{name}");
        }
    }
}
