//! What the library refuses, and with which words.

use vps::mesh::MeshError;
use vps::spatial::testing::Random;
use vps::{
    ContactQuery, DQuat, DVec3, Error, InsideTest, Mesh, Options, PointShell, Pose, Shape, Voxmap,
};

/// The text of an error that has to come.
fn said<T>(result: Result<T, Error>) -> String {
    match result {
        Ok(_) => panic!("it should be refused"),
        Err(error) => error.to_string(),
    }
}

const CORNERS: [[f64; 3]; 4] = [[0.0; 3], [0.03, 0.0, 0.0], [0.0, 0.03, 0.0], [0.0, 0.0, 0.03]];
const FACES: [[u32; 3]; 4] = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];

#[test]
fn arrays_that_are_no_mesh() {
    let mesh = Mesh::from_arrays(&CORNERS, &FACES).unwrap();
    assert!(mesh.warnings().is_empty() && mesh.bounds() == (DVec3::ZERO, DVec3::splat(0.03)));
    assert_eq!(
        said(Mesh::from_arrays(&[], &[])),
        "mesh from arrays: none of the 0 triangles has an area: give the surface of the part"
    );
    assert!(
        said(Mesh::from_arrays(&CORNERS, &[[0, 1, 1], [2, 2, 2]]))
            .contains("none of the 2 triangles")
    );
    let beyond = said(Mesh::from_arrays(&CORNERS, &[[0, 1, 2], [1, 2, 4]]));
    assert_eq!(
        beyond,
        "mesh from arrays: triangle 1 names vertex 4, there are 4: count vertices from 0"
    );
    assert!(said(Mesh::from_arrays(&[], &[[u32::MAX; 3]])).contains("names vertex 4294967295"));
    for wrong in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e10, -1e300] {
        let mut corners = CORNERS;
        corners[2][1] = wrong;
        assert!(
            said(Mesh::from_arrays(&corners, &FACES))
                .starts_with("mesh from arrays: vertex 2 is [0.0, "),
            "{wrong}"
        );
    }
}

#[test]
fn files_that_are_no_mesh() {
    let folder = tempfile::tempdir().unwrap();
    let missing = folder.path().join("missing.stl");
    assert_eq!(said(Mesh::load(&missing, 1.0)), format!("{}: no such file", missing.display()));
    let text = folder.path().join("part.obj");
    std::fs::write(&text, "v 0 0 0\nv 1 0 zero\n").unwrap();
    assert!(
        said(Mesh::load(&text, 1.0)).contains("part.obj:2"),
        "{}",
        said(Mesh::load(&text, 1.0))
    );
    for wrong in [f64::NAN, 0.0, -1e-3, f64::INFINITY] {
        assert!(said(Mesh::load(&missing, wrong)).starts_with("metres_per_unit is "), "{wrong}");
    }
    assert!(said(Mesh::from_shape(&Shape::Sphere { radius_m: f64::NAN }, 1e-5)).contains("NaN"));
    assert!(
        said(Mesh::from_shape(&Shape::Box { size_m: DVec3::new(1.0, 0.0, 1.0) }, 1e-5))
            .contains("is 0: give metres")
    );
}

#[test]
fn voxels_that_cannot_be() {
    let mesh = Mesh::from_arrays(&CORNERS, &FACES).unwrap();
    for wrong in [0.0, -1e-3, f64::NAN, f64::INFINITY, 1e-300] {
        assert!(
            said(Voxmap::bake(&mesh, &Options::new(wrong))).starts_with("voxel_size_m is "),
            "{wrong}"
        );
        assert!(
            said(PointShell::bake(&mesh, &Options::new(wrong))).starts_with("voxel_size_m is "),
            "{wrong}"
        );
    }
    for layers in [0, 1, 127, u32::MAX] {
        assert!(
            said(Voxmap::bake(&mesh, &Options { layers, ..Options::new(1e-3) }))
                .starts_with("layers is "),
            "{layers}"
        );
    }
    let fine = said(Voxmap::bake(&mesh, &Options::new(1e-8)));
    assert!(
        fine.starts_with("mesh from arrays: a grid of ")
            && fine.contains("use a voxel size of at least"),
        "{fine}"
    );
    assert!(fine.contains("voxel_size_m = ") && fine.contains("or check the unit"), "{fine}");
    // Larger than the part is coarse, not wrong.
    Voxmap::bake(&mesh, &Options::new(1.0)).unwrap();
    PointShell::bake(&mesh, &Options::new(1e6)).unwrap();
}

#[test]
fn poses_and_points_that_are_none() {
    let mesh = Mesh::from_arrays(&CORNERS, &FACES).unwrap();
    let options = Options::new(2e-3);
    let voxmap = Voxmap::bake(&mesh, &options).unwrap();
    let shell = PointShell::bake(&mesh, &options).unwrap();
    let query = ContactQuery::new(&voxmap, &shell, 1e3).unwrap();
    let turned = |x, y, z, w| Pose::new(DQuat::from_xyzw(x, y, z, w), DVec3::ZERO);
    for wrong in [
        turned(0.0, 0.0, 0.0, 0.0),
        turned(0.0, 0.0, 0.0, 1.1),
        turned(f64::NAN, 0.0, 0.0, 1.0),
        turned(f64::INFINITY, 0.0, 0.0, 1.0),
    ] {
        assert!(said(query.wrench(wrong)).starts_with("pose 0: rotation "), "{wrong:?}");
    }
    for wrong in [f64::NAN, f64::INFINITY, 1e10] {
        let at = DVec3::new(0.0, wrong, 0.0);
        assert!(
            said(query.contacts(Pose::from_translation(at), |_| ()))
                .starts_with("pose 0: translation "),
            "{wrong}"
        );
        assert!(
            said(query.wrenches(&[Pose::IDENTITY, Pose::from_translation(at)]))
                .starts_with("pose 1: translation "),
            "{wrong}"
        );
        assert!(said(voxmap.distance(at)).starts_with("a coordinate of the point is "), "{wrong}");
    }
    for wrong in [f64::NAN, -1.0, f64::INFINITY] {
        assert!(
            said(ContactQuery::new(&voxmap, &shell, wrong)).starts_with("stiffness_n_per_m is "),
            "{wrong}"
        );
    }
    // As far as it may be, and rotations as `f32` rounds them, are answered.
    assert_eq!(
        query.wrench(Pose::from_translation(DVec3::splat(1e9))).unwrap().clearance_m,
        voxmap.band_m()
    );
    let rounded = DQuat::from_scaled_axis(DVec3::new(0.3, -1.2, 0.7)).as_quat().as_dquat();
    query.wrench(Pose::new(rounded, DVec3::ZERO)).unwrap();
}

fn obj(folder: &tempfile::TempDir) -> std::path::PathBuf {
    let path = folder.path().join("part.obj");
    std::fs::write(
        &path,
        "v 0 0 0\nv 0.03 0 0\nv 0 0.03 0\nv 0 0 0.03\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n",
    )
    .unwrap();
    path
}

#[test]
fn files_that_hold_no_part() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let mesh = Mesh::from_arrays(&CORNERS, &FACES).unwrap();
    let options = Options { layers: 2, ..Options::new(10e-3) };
    Voxmap::bake(&mesh, &options).unwrap().save(path("voxmap")).unwrap();
    PointShell::bake(&mesh, &options).unwrap().save(path("shell")).unwrap();
    assert!(
        said(Voxmap::load(path("shell"))).ends_with("holds no voxmap: give what one was saved to")
    );
    assert!(
        said(PointShell::load(path("voxmap")))
            .ends_with("holds no pointshell: give what one was saved to")
    );
    assert!(said(Voxmap::load(path("none"))).contains("none: cannot be read"));
    assert!(said(Voxmap::load(folder.path())).contains("cannot be read"));
    let unwritable = Voxmap::load(path("voxmap")).unwrap().save(path("no/such/folder"));
    assert!(said(unwritable).contains("cannot be written"));
    // What the bake cache may hold, and no query can answer.
    let thin = Options { layers: 1, sides: vps::InsideTest::Thin, ..Options::new(10e-3) };
    let (field, _) = vps::part::Part::load("skin", &obj(&folder), 1.0)
        .unwrap()
        .bake_field(&thin, false, |_| ())
        .unwrap();
    let mut file = vps::storage::sections::Writer::default();
    let head = field.head();
    field.store(&head, &mut file);
    file.write_to(
        [0; 16],
        vps::part::GENERATION,
        &mut std::fs::File::create(path("thin")).unwrap(),
    )
    .unwrap();
    assert!(said(Voxmap::load(path("thin"))).contains("two or more"));
    // Every bit of a file that is read is covered by a checksum: a changed or shorter file is
    // refused, but for the zeros between sections.
    let bytes = std::fs::read(path("voxmap")).unwrap();
    assert_eq!(Voxmap::load(path("voxmap")).unwrap().to_bytes(), bytes);
    assert_eq!(Voxmap::from_bytes(&bytes).unwrap().to_bytes(), bytes);
    assert!(
        said(PointShell::from_bytes(&bytes)).starts_with("baked part from bytes: holds no points")
    );
    let mut refused = 0;
    for at in (0..bytes.len()).step_by(bytes.len() / 200) {
        let mut changed = bytes.clone();
        changed[at] ^= 0x40;
        std::fs::write(path("changed"), &changed).unwrap();
        let is_refused = Voxmap::load(path("changed")).is_err();
        assert_eq!(Voxmap::from_bytes(&changed).is_err(), is_refused);
        refused += u32::from(is_refused);
        std::fs::write(path("changed"), &bytes[..at]).unwrap();
        assert!(said(Voxmap::load(path("changed"))).contains("bake the part again"), "{at} bytes");
    }
    assert!(refused > 150, "{refused} of 200 changes are seen");
}

/// What texts put into backticks: features of the crate, commands of a shell, and words that a format
/// wants in its files.
const QUOTED: [&str; 11] = [
    "vps",
    "gltf",
    "threemf",
    "git lfs pull",
    "gunzip",
    "gmsh PART.step -2 -clmax 1 -o PART.stl",
    "ply",
    "format",
    "vertex",
    "end_header",
    "endsolid",
];

/// A text names nothing that only another program has, such as keys or flags; it may quote the file
/// that it is about.
fn check_words(text: &str, file: &str) {
    for quoted in text.split('`').skip(1).step_by(2) {
        let is_of_file = || quoted.split_whitespace().all(|word| file.contains(word));
        assert!(QUOTED.contains(&quoted) || is_of_file(), "{text}");
    }
    for word in ["--", "scene", "toml", " = \"", "hapticd"] {
        assert!(!text.contains(word) || file.contains(word), "{text}");
    }
}

#[test]
fn texts_are_in_the_words_of_the_library() {
    const TESTS: [InsideTest; 4] =
        [InsideTest::Auto, InsideTest::Flood, InsideTest::Winding, InsideTest::Thin];
    let mut random = Random(7);
    let mut pick = |n: usize| (random.unit() * n as f64) as usize;
    let mut texts = Vec::new();
    for case in 0..400 {
        // Soups of triangles of any size and shape, of which some are in order; a box in a box has
        // a hollow.
        let scale = 10_f64.powi(pick(12) as i32 - 7);
        let mut corners: Vec<[f64; 3]> = (0..3 + pick(12))
            .map(|_| [0; 3].map(|_| scale * (pick(9) as f64 - 4.0)))
            .chain(CORNERS.map(|corner| corner.map(|x| x * 100.0 * scale)))
            .collect();
        if case % 17 == 0 {
            corners[0][1] = [f64::NAN, 1e300][pick(2)];
        }
        let n_corners = corners.len() as u32;
        let mut faces: Vec<[u32; 3]> = (0..pick(9))
            .map(|_| [0; 3].map(|_| pick(corners.len() + usize::from(case % 13 == 0)) as u32))
            .collect();
        if case % 2 == 0 {
            faces.extend(FACES.map(|face| face.map(|corner| n_corners - 4 + corner)));
        }
        if case % 4 == 0 {
            faces = FACES.map(|face| face.map(|corner| n_corners - 4 + corner)).to_vec();
            let inner = CORNERS.map(|corner| corner.map(|x| (0.2 + 40.0 * x) * scale));
            faces.extend(FACES.map(|[a, b, c]| [a, c, b].map(|corner| n_corners + corner)));
            corners.extend(inner);
        }
        let mesh = match Mesh::from_arrays(&corners, &faces) {
            Ok(mesh) => mesh,
            Err(error) => {
                texts.push(error.to_string());
                continue;
            }
        };
        let (low, high) = mesh.bounds();
        let voxel_size_m = (high - low).max_element() / [1e9, 3.0, 8.0, 20.0, 0.0][pick(5)];
        let options = Options {
            sides: TESTS[pick(4)],
            layers: 1 + pick(6) as u32,
            ..Options::new(voxel_size_m)
        };
        texts.extend(mesh.warnings());
        match Voxmap::bake(&mesh, &options) {
            Ok(voxmap) => texts.extend_from_slice(voxmap.warnings()),
            Err(error) => texts.push(error.to_string()),
        }
        match PointShell::bake(&mesh, &options) {
            Ok(shell) => texts.extend_from_slice(shell.warnings()),
            Err(error) => texts.push(error.to_string()),
        }
    }
    let path = std::path::PathBuf::from("part.3mf");
    let conflict = MeshError::UnitConflict {
        path: path.clone(),
        unit: "inch",
        file_metres_per_unit: 0.0254,
        metres_per_unit: 1.0,
    };
    let far = MeshError::FarVertex { path, vertex: 1, distance_m: 1e12 };
    texts.extend([conflict, far].map(|source| Error::Mesh { source }.to_string()));
    texts.iter().for_each(|text| check_words(text, ""));
    // What a setting could have helped is among them.
    for said in [
        "is the unit right?",
        "or check the unit",
        "and check the unit",
        "set the unit to that of the file",
        "solid, by the flood fill",
        ", or a thin skin",
    ] {
        assert!(texts.iter().any(|text| text.contains(said)), "{said}");
    }
}

#[test]
fn texts_about_files_are_in_the_words_of_the_library() {
    let folder = tempfile::tempdir().unwrap();
    let corpus = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz/corpus");
    let mut seeds: Vec<Vec<u8>> = ["obj", "stl", "ply", "gltf"]
        .iter()
        .flat_map(|format| std::fs::read_dir(corpus.join(format)).unwrap())
        .map(|entry| std::fs::read(entry.unwrap().path()).unwrap())
        .collect();
    seeds.extend(
        [
            &b""[..],
            b"ISO-10303-21;\n",
            b"%PDF-",
            b"\x1f\x8b",
            b"version https://git-lfs.github.com/",
            b"<html>",
        ]
        .map(<[u8]>::to_vec),
    );
    let mut random = Random(11);
    let mut pick = |n: usize| (random.unit() * n as f64) as usize;
    let mut refused = 0;
    let mut is_cad = false;
    for _ in 0..2000 {
        let mut bytes = seeds[pick(seeds.len())].clone();
        for _ in 0..pick(6) {
            if let Some(byte) = bytes.len().checked_sub(1).map(|_| pick(bytes.len())) {
                bytes[byte] = b"x7-. \n{"[pick(7)];
            }
        }
        if pick(4) == 0 {
            bytes.truncate(pick(bytes.len() + 1));
        }
        let ending = ["obj", "stl", "ply", "gltf", "glb", "3mf", "step", "las"][pick(8)];
        let path = folder.path().join(format!("part.{ending}"));
        std::fs::write(&path, &bytes).unwrap();
        match Mesh::load(&path, [1e-3, 1.0, 1e6][pick(3)]) {
            Ok(mesh) => mesh.warnings().iter().for_each(|text| check_words(text, "")),
            Err(error) => {
                let text = error.to_string();
                // The name of the file is quoted where its ending is not known.
                let file = String::from_utf8_lossy(&bytes) + ending;
                // What is wrong with JSON is said by its reader.
                check_words(text.split("not a glTF document").next().unwrap_or_default(), &file);
                refused += 1;
                is_cad |= text.contains("mm as the unit");
            }
        }
    }
    assert!(refused > 1000 && is_cad, "{refused}");
}
