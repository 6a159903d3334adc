//! The bake cache as a library: what it gives is what baking gives, and no file, however wrong, is
//! believed.

use std::fs;
use std::path::{Path, PathBuf};

use glam::DVec3;
use hapticd::config::SceneConfig;
use hapticd::config::scene::MeshSource;
use hapticd::scene::CacheUse;
use hapticd::scene::cache::{
    Baked, Cache, CachePolicy, GENERATION, Lookup, Request, Spacing, read,
};
use hapticd::scene::{self, BakeOptions, ObjectReport, PartRole};
use tempfile::TempDir;
use vps::mesh::primitives::Shape;
use vps::pointshell::Points;
use vps::storage::MappedFile;
use vps::storage::sections::{FORMAT, Reader, reseal};
use vps::voxmap::field::FieldKind;
use vps::voxmap::inside_test::InsideTest;

use super::determinism::bits;
use super::fuzz_corpus::{cache, corpus};
use super::rig;

const BOTH: [CachePolicy; 2] = [CachePolicy::Mapped, CachePolicy::Copy];

/// Offsets in the head.
const FORMAT_AT: usize = 20;
const GENERATION_AT: usize = 24;
const HEAD_BYTES: usize = 64;
const ENTRY_BYTES: usize = 48;

/// A scene that bakes in milliseconds: a corner as a mesh file and a box.
fn small_scene(folder: &Path, more: &str) -> SceneConfig {
    fs::write(folder.join("corner.obj"), CORNER).unwrap();
    let text = format!(
        r#"version = 1
[rendering]
field = "trilinear"
[[static]]
name = "corner"
mesh = {:?}
units = "mm"
voxel_size_mm = 1.0
layers = 3
[tool]
shape = {{ box_mm = [5.0, 4.0, 3.0] }}
voxel_size_mm = 1.0
layers = 2
mass_g = 50.0
start_position_mm = [30, 0, 0]
[device]
profile = "sim-sigma7"
{more}"#,
        folder.join("corner.obj")
    );
    rig::written(&text)
}

const CORNER: &str =
    "v 0 0 0\nv 11.3 0 0\nv 0 9.7 0\nv 1 2 8.1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n";

/// Bakes a scene through the cache; what the cache did for each object, and what it said.
fn bake(config: &SceneConfig, folder: &Path, policy: CachePolicy) -> (Vec<CacheUse>, Vec<String>) {
    let mut cache = Cache::at(folder.to_owned(), policy);
    let (_, reports) =
        scene::build_with(config, &mut BakeOptions::from(&mut cache), |_| ()).unwrap();
    (reports.iter().map(|report| report.cache).collect(), cache.take_notes())
}

fn files(folder: &Path) -> Vec<PathBuf> {
    let mut files: Vec<_> =
        fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    assert!(
        files.iter().all(|file| file.extension().is_some_and(|extension| extension == "bake")),
        "{files:?}"
    );
    files
}

/// Puts other bytes in place of a file of the cache, which is read-only.
fn put(path: &Path, bytes: &[u8]) {
    fs::remove_file(path).unwrap();
    fs::write(path, bytes).unwrap();
}

/// The file of a baked object without what differs from run to run.
fn contents(baked: &Baked) -> Vec<u8> {
    let mut bytes = Vec::new();
    baked.write_to([0; 16], &mut bytes).unwrap();
    bytes
}

/// Everything but what differs from run to run.
fn figures(report: &ObjectReport) -> serde_json::Value {
    let mut json = serde_json::to_value(report).unwrap();
    for key in ["timings_s", "threads", "cache"] {
        json.as_object_mut().unwrap().remove(key).unwrap();
    }
    json
}

fn a_hit_is_a_bake(what: &str, config: &SceneConfig, n_ticks: u64) {
    let dir = tempfile::tempdir().unwrap();
    let fresh = rig::run_ticks(config, n_ticks);
    assert!(
        fresh.records.iter().any(|record| record.output.contacts > 0),
        "{what}: nothing was touched"
    );
    let uses =
        |reports: &[ObjectReport]| reports.iter().map(|report| report.cache).collect::<Vec<_>>();
    assert!(uses(&fresh.reports).iter().all(|cache| *cache == CacheUse::Off));
    for (policy, expected) in
        [(BOTH[0], CacheUse::Miss), (BOTH[0], CacheUse::Hit), (BOTH[1], CacheUse::Hit)]
    {
        let mut cache = Cache::at(dir.path().to_owned(), policy);
        let run = rig::run_ticks_with(config, &mut cache, n_ticks);
        assert_eq!(cache.take_notes(), [""; 0]);
        assert!(
            uses(&run.reports).iter().all(|cache| *cache == expected),
            "{what}: {:?}",
            uses(&run.reports)
        );
        assert!(fresh.reports.iter().map(figures).eq(run.reports.iter().map(figures)), "{what}");
        let differs = fresh.records.iter().zip(&run.records).position(|(a, b)| bits(a) != bits(b));
        assert_eq!(
            (differs, run.records.len()),
            (None, fresh.records.len()),
            "{what}, {policy:?}: first tick that differs"
        );
    }
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn a_scene_from_the_cache_gives_the_bits_of_a_baked_one() {
    a_hit_is_a_bake("peg-in-hole", &rig::load(&rig::shipped("peg-in-hole")), 3000);
    for field in ["layers", "surface-point", "octant"] {
        let replacement = format!("field = \"{field}\"\nallow_unstable = true");
        a_hit_is_a_bake(
            field,
            &rig::rewritten("block-on-plane", &[("field = \"trilinear\"", &replacement)]),
            2000,
        );
    }
}

#[test]
fn the_key_knows_what_changes_a_bit_and_nothing_else() {
    let dir = tempfile::tempdir().unwrap();
    let cache = dir.path().join("cache");
    let uses = |config: &SceneConfig| bake(config, &cache, CachePolicy::Mapped).0;
    let base = small_scene(dir.path(), "");
    assert_eq!(uses(&base), [CacheUse::Miss; 2]);
    assert_eq!(uses(&base), [CacheUse::Hit; 2]);

    let mut same = base.clone();
    same.statics[0].name = "another name".to_owned();
    same.statics[0].pose.translation.x = 0.01;
    same.tool.mass_kg = 0.2;
    same.parameters.contact.stiffness_n_per_m *= 2.0;
    assert_eq!(uses(&same), [CacheUse::Hit; 2]);
    let mut copied = base.clone();
    fs::copy(dir.path().join("corner.obj"), dir.path().join("copy.OBJ")).unwrap();
    copied.statics[0].source =
        MeshSource::File { path: dir.path().join("copy.OBJ"), metres_per_unit: 1e-3 };
    assert_eq!(uses(&copied), [CacheUse::Hit; 2], "the bytes count, not the name");

    let statics: [&dyn Fn(&mut SceneConfig); 5] = [
        &|scene| scene.statics[0].voxel_size_m *= 1.0 + f64::EPSILON,
        &|scene| scene.statics[0].layers += 1,
        &|scene| scene.statics[0].sides = InsideTest::Flood,
        &|scene| scene.parameters.contact.field = FieldKind::SurfacePoint,
        &|scene| {
            scene.statics[0].source =
                MeshSource::File { path: dir.path().join("corner.obj"), metres_per_unit: 1.1e-3 }
        },
    ];
    for (idx, change) in statics.iter().enumerate() {
        let mut other = base.clone();
        change(&mut other);
        assert_eq!(uses(&other), [CacheUse::Miss, CacheUse::Hit], "change {idx}");
        assert_eq!(uses(&other), [CacheUse::Hit; 2], "change {idx}");
    }
    let tools: [&dyn Fn(&mut SceneConfig); 5] = [
        &|scene| scene.tool.sides = InsideTest::Thin,
        &|scene| scene.tool.voxel_size_m *= 0.9,
        &|scene| scene.tool.layers += 1,
        &|scene| scene.tool.center_of_mass_m = Some(DVec3::new(0.0, 0.0, 1e-9)),
        &|scene| {
            scene.tool.source =
                MeshSource::Shape(Shape::Box { size_m: DVec3::new(5e-3, 4e-3, 3.0001e-3) })
        },
    ];
    for (idx, change) in tools.iter().enumerate() {
        let mut other = base.clone();
        change(&mut other);
        assert_eq!(uses(&other), [CacheUse::Hit, CacheUse::Miss], "change {idx}");
    }
    fs::write(dir.path().join("corner.obj"), CORNER.replace("11.3", "11.4")).unwrap();
    assert_eq!(uses(&base), [CacheUse::Miss, CacheUse::Hit]);
}

/// A tetrahedron as glTF, its numbers in a file beside it.
const GLTF: &str = r#"{"asset": {"version": "2.0"},
"buffers": [{"byteLength": 60, "uri": "corner%20buffer.bin"}],
"bufferViews": [{"buffer": 0, "byteOffset": 0, "byteLength": 48}, {"buffer": 0, "byteOffset": 48, "byteLength": 12}],
"accessors": [{"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
              {"bufferView": 1, "componentType": 5121, "count": 12, "type": "SCALAR"}],
"meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}]}"#;

#[test]
fn the_key_knows_the_files_that_a_mesh_file_names() {
    let dir = tempfile::tempdir().unwrap();
    let buffer = |height: f32| {
        let corners = [[0.0_f32, 0.0, 0.0], [11.3, 0.0, 0.0], [0.0, 9.7, 0.0], [1.0, 2.0, height]];
        let bytes = corners.iter().flatten().flat_map(|number| number.to_le_bytes());
        fs::write(
            dir.path().join("corner buffer.bin"),
            bytes.chain([0, 2, 1, 0, 1, 3, 1, 2, 3, 2, 0, 3]).collect::<Vec<_>>(),
        )
        .unwrap();
    };
    fs::write(dir.path().join("corner.gltf"), GLTF).unwrap();
    let mut config = small_scene(dir.path(), "");
    config.statics[0].source =
        MeshSource::File { path: dir.path().join("corner.gltf"), metres_per_unit: 1e-3 };
    let uses = || bake(&config, &dir.path().join("cache"), CachePolicy::Copy);
    buffer(8.1);
    assert_eq!(uses(), (vec![CacheUse::Miss; 2], vec![]));
    assert_eq!(uses(), (vec![CacheUse::Hit; 2], vec![]));
    buffer(8.2);
    assert_eq!(uses(), (vec![CacheUse::Miss, CacheUse::Hit], vec![]));
    buffer(8.1);
    assert_eq!(uses(), (vec![CacheUse::Hit; 2], vec![]));
    // A buffer that is gone is refused by the bake.
    fs::remove_file(dir.path().join("corner buffer.bin")).unwrap();
    let mut cache = Cache::at(dir.path().join("cache"), CachePolicy::Copy);
    let error = scene::build_with(&config, &mut BakeOptions::from(&mut cache), |_| ()).unwrap_err();
    assert!(error.to_string().contains("corner buffer.bin"), "{error}");
    assert_eq!(cache.take_notes(), [""; 0]);
}

/// One damage: its name, what it does to a file, and what the message says.
type Damage = (String, Box<dyn Fn(&mut Vec<u8>)>, &'static str);

/// Every class of damage to a file with these sections.
fn damages(bytes: &[u8]) -> Vec<Damage> {
    let mut damages: Vec<Damage> = Vec::new();
    let mut flip = |what: &str, at: usize, says: &'static str| {
        damages.push((
            format!("{what} at {at}"),
            Box::new(move |bytes: &mut Vec<u8>| bytes[at] ^= 0x10),
            says,
        ));
    };
    for (what, at) in [("magic", 0), ("units", 9), ("byte order", 17)] {
        flip(what, at, "not a bake file");
    }
    for (what, at) in [
        ("format", FORMAT_AT),
        ("generation", GENERATION_AT),
        ("sections", 28),
        ("key", 35),
        ("length", 50),
        ("checksum", 57),
    ] {
        flip(what, at, "the head");
    }
    let mut ends = vec![0, 1, HEAD_BYTES - 1, HEAD_BYTES, HEAD_BYTES + 5, bytes.len() - 1];
    let n_sections = u32::from_le_bytes(bytes[28..32].try_into().unwrap()) as usize;
    for entry in (0..n_sections).map(|n| HEAD_BYTES + n * ENTRY_BYTES) {
        for field in [0, 17, 25, 33, 41, 45] {
            flip("table", entry + field, "the table");
        }
        let number = |at: usize| {
            u64::from_le_bytes(bytes[entry + at..entry + at + 8].try_into().unwrap()) as usize
        };
        let offset = number(16);
        let length = number(24);
        if length > 0 {
            [0, length / 2, length - 1].into_iter().for_each(|at| flip("payload", offset + at, ""));
            ends.extend([offset, offset + length / 2]);
        }
    }
    flip("checksum of the table", HEAD_BYTES + n_sections * ENTRY_BYTES, "the table");
    for end in ends {
        let says = if end < HEAD_BYTES { "shorter than its head" } else { "its length" };
        let says = if end == 0 { "" } else { says };
        damages.push((
            format!("cut at {end}"),
            Box::new(move |bytes: &mut Vec<u8>| bytes.truncate(end)),
            says,
        ));
    }
    damages.push((
        "a byte more".into(),
        Box::new(|bytes: &mut Vec<u8>| bytes.push(0)),
        "its length",
    ));
    damages.push((
        "another file".into(),
        Box::new(|bytes: &mut Vec<u8>| bytes.fill(b'x')),
        "not a bake file",
    ));
    damages
}

#[test]
fn a_damaged_file_is_reported_baked_anew_and_replaced() {
    let dir = tempfile::tempdir().unwrap();
    let config = small_scene(dir.path(), "");
    let cache = dir.path().join("cache");
    bake(&config, &cache, CachePolicy::Copy);
    for file in files(&cache) {
        let sound = fs::read(&file).unwrap();
        let figures = contents(&read(&sound).unwrap()).len();
        for (idx, (what, damage, says)) in damages(&sound).into_iter().enumerate() {
            let mut bytes = sound.clone();
            damage(&mut bytes);
            put(&file, &bytes);
            let (uses, notes) = bake(&config, &cache, BOTH[idx % 2]);
            let rebaked = uses.iter().filter(|cache| **cache == CacheUse::Rebaked).count();
            assert_eq!((rebaked, notes.len()), (1, 1), "{what}: {uses:?} {notes:?}");
            let name = file.file_name().unwrap().to_str().unwrap();
            for fragment in [name, "is damaged (", says, "is baked anew and the file replaced"] {
                assert!(notes[0].contains(fragment), "{what}: no `{fragment}` in {}", notes[0]);
            }
            let after = read(&fs::read(&file).unwrap())
                .unwrap_or_else(|refusal| panic!("{what}: {refusal}"));
            assert!(
                contents(&after).len().abs_diff(figures) < 256,
                "{what}: the timings are other numbers, no more"
            );
            assert_eq!(
                bake(&config, &cache, BOTH[idx % 2]),
                (vec![CacheUse::Hit; 2], vec![]),
                "{what}"
            );
        }
    }
}

#[test]
fn any_single_byte_that_matters_is_found() {
    let dir = tempfile::tempdir().unwrap();
    let config = small_scene(dir.path(), "");
    bake(&config, dir.path().join("cache").as_path(), CachePolicy::Copy);
    for file in files(&dir.path().join("cache")) {
        let sound = fs::read(&file).unwrap();
        let reference = contents(&read(&sound).unwrap());
        // Every byte of head and table, and every 97th of the rest.
        let mut refused = 0;
        let mut padding = 0;
        for at in (0..800).chain((800..sound.len()).step_by(97)) {
            let mut bytes = sound.clone();
            bytes[at] ^= 1 << (at % 8);
            match read(&bytes) {
                Err(_) => refused += 1,
                // The key, or one of the zeros between sections.
                Ok(baked) => {
                    padding += 1;
                    assert_eq!(contents(&baked), reference, "byte {at}");
                    assert_eq!(sound[at], 0, "byte {at}");
                }
            }
        }
        assert!(refused > 10 * padding, "{refused} refused, {padding} without effect");
    }
}

/// A sound file of another version.
fn of_version(sound: &[u8], format: u32, generation: u32) -> Vec<u8> {
    let mut bytes = sound.to_vec();
    bytes[FORMAT_AT..FORMAT_AT + 4].copy_from_slice(&format.to_le_bytes());
    bytes[GENERATION_AT..GENERATION_AT + 4].copy_from_slice(&generation.to_le_bytes());
    reseal(&mut bytes);
    bytes
}

#[test]
fn other_versions_are_reported_the_older_is_replaced_the_newer_left_alone() {
    let dir = tempfile::tempdir().unwrap();
    let config = small_scene(dir.path(), "");
    let cache = dir.path().join("cache");
    bake(&config, &cache, CachePolicy::Copy);
    let file = files(&cache).remove(0);
    let sound = fs::read(&file).unwrap();
    for policy in BOTH {
        for (format, generation) in
            [(FORMAT - 1, GENERATION), (FORMAT, GENERATION - 1), (FORMAT - 1, GENERATION + 1)]
        {
            put(&file, &of_version(&sound, format, generation));
            let (uses, notes) = bake(&config, &cache, policy);
            assert!(uses.contains(&CacheUse::Rebaked) && notes.len() == 1, "{notes:?}");
            assert!(
                notes[0].contains(&format!(
                    "was written by an older version (format {format}.{generation})"
                )),
                "{notes:?}"
            );
            assert_eq!(bake(&config, &cache, policy), (vec![CacheUse::Hit; 2], vec![]));
        }
        for (format, generation) in
            [(FORMAT + 1, GENERATION), (FORMAT, GENERATION + 1), (FORMAT + 1, 0)]
        {
            let newer = of_version(&sound, format, generation);
            put(&file, &newer);
            for _ in 0..2 {
                let (uses, notes) = bake(&config, &cache, policy);
                assert!(uses.contains(&CacheUse::Rebaked) && notes.len() == 1, "{notes:?}");
                assert!(
                    notes[0].contains(&format!(
                        "was written by a newer version (format {format}.{generation})"
                    )),
                    "{notes:?}"
                );
                assert!(notes[0].ends_with("is baked anew and the file left alone"), "{notes:?}");
                assert_eq!(fs::read(&file).unwrap(), newer);
            }
        }
        put(&file, &sound);
    }
}

#[test]
fn a_file_under_the_name_of_another_object_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let config = small_scene(dir.path(), "");
    let cache = dir.path().join("cache");
    bake(&config, &cache, CachePolicy::Copy);
    let [one, two] = files(&cache).try_into().unwrap();
    put(&two, &fs::read(one).unwrap());
    let (uses, notes) = bake(&config, &cache, CachePolicy::Mapped);
    assert!(uses.contains(&CacheUse::Hit) && uses.contains(&CacheUse::Rebaked), "{uses:?}");
    assert!(notes[0].contains("it belongs to another object"), "{notes:?}");
}

/// A file of each role: the static object, the tool, and a mesh that is both.
fn roles(config: &SceneConfig, folder: &Path) -> [Vec<u8>; 3] {
    bake(config, folder, CachePolicy::Copy);
    let baked: Vec<Baked> =
        files(folder).iter().map(|file| read(&fs::read(file).unwrap()).unwrap()).collect();
    let [mut one, mut two] = <[Baked; 2]>::try_from(baked).unwrap();
    if one.field.is_none() {
        (one, two) = (two, one);
    }
    let alone = [&one, &two].map(contents);
    let both = Baked { shell: two.shell, mass: two.mass, ..one };
    assert!(both.serves(PartRole::Mesh));
    let [one, two] = alone;
    [one, two, contents(&both)]
}

fn small_files() -> (TempDir, [Vec<u8>; 3]) {
    let dir = tempfile::tempdir().unwrap();
    let config = small_scene(dir.path(), "");
    let files = roles(&config, &dir.path().join("cache"));
    (dir, files)
}

/// Where a section begins and how long it is.
fn section(bytes: &[u8], name: &str) -> (usize, usize) {
    let number = |at: usize| u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap()) as usize;
    let mut padded = name.as_bytes().to_vec();
    padded.resize(16, 0);
    let is_it = |at: &usize| bytes[*at..*at + 16] == padded;
    let at = (0..64).map(|n| HEAD_BYTES + n * ENTRY_BYTES).find(is_it).unwrap();
    (number(at + 16), number(at + 24))
}

#[test]
fn forged_files_with_sound_checksums_are_refused_or_harmless() {
    let (_dir, files) = small_files();
    let both = &files[2];
    assert_eq!(cache::exercise(both), 2);
    // (section, offset in it, bytes there, taken for sound)
    let huge = u32::MAX - 7;
    for (name, at, value, sound) in [
        ("field top", 0, &1_000_000_u32.to_le_bytes()[..], false),
        ("field top", 4, &huge.to_le_bytes(), false),
        ("field", 16, &(-1_i32).to_le_bytes(), false),
        ("field", 16, &0_i32.to_le_bytes(), false),
        ("field", 20, &i32::MAX.to_le_bytes(), false),
        ("field", 0, &f32::NAN.to_le_bytes(), false),
        ("field", 12, &0_f32.to_le_bytes(), false),
        ("field", 28, &f32::INFINITY.to_le_bytes(), false),
        ("field", 32, &(-1_f32).to_le_bytes(), false),
        ("shell", 0, &u64::MAX.to_le_bytes(), false),
        ("shell", 0, &0_u64.to_le_bytes(), false),
        ("shell", 8, &f64::NAN.to_le_bytes(), false),
        ("shell", 16, &(-1_f64).to_le_bytes(), false),
        ("mass", 8, &f64::INFINITY.to_le_bytes(), false),
        ("mass", 104, &2_u64.to_le_bytes(), false),
        ("report", 0, b"[", false),
        ("shell", 0, &(1_u64 << 33).to_le_bytes(), false),
        ("tree spheres", 0, &f32::NAN.to_le_bytes(), false),
        ("tree spheres", 96, &f32::INFINITY.to_le_bytes(), false),
        ("tree spheres", 96, &(-1_f32).to_le_bytes(), false),
        ("tree points", 0, &u32::MAX.to_le_bytes(), false),
        ("tree spheres", 0, &f32::MAX.to_le_bytes(), true),
        ("tree points", 4, &0_u32.to_le_bytes(), true),
        ("field samples", 400, &f32::NAN.to_le_bytes(), true),
        ("field samples", 404, &f32::MAX.to_le_bytes(), true),
        ("field layers", 17, &[0x80], true),
        ("crease bricks", 0, &1_000_000_u32.to_le_bytes(), false),
        ("crease cells", 0, &[0xff; 4], false),
        ("crease planes", 0, &f64::NAN.to_le_bytes(), false),
        ("crease planes", 8, &2_f64.to_le_bytes(), false),
        ("crease planes", 24, &f64::NEG_INFINITY.to_le_bytes(), false),
        ("crease planes", 24, &f64::INFINITY.to_le_bytes(), false),
        ("crease planes", 24, &1e30_f64.to_le_bytes(), false),
        ("shell positions", 4, &f32::INFINITY.to_le_bytes(), true),
        ("shell normals", 4, &f32::NAN.to_le_bytes(), true),
    ] {
        let mut bytes = both.clone();
        let (offset, length) = section(&bytes, name);
        assert!(at + value.len() <= length, "{name} has {length} bytes");
        bytes[offset + at..offset + at + value.len()].copy_from_slice(value);
        reseal(&mut bytes);
        assert_eq!(cache::exercise(&bytes), if sound { 2 } else { 0 }, "{name} at {at}: {value:?}");
    }
    // Sections that lie about where they are and of what.
    for (field, value) in
        [(16, u64::MAX - 10), (16, 8), (16, 1 << 40), (24, u64::MAX), (24, 1), (40, 3), (40, 0)]
    {
        for entry in (0..11).map(|n| HEAD_BYTES + n * ENTRY_BYTES) {
            let mut bytes = both.clone();
            let n = if field == 40 { 4 } else { 8 };
            bytes[entry + field..entry + field + n].copy_from_slice(&value.to_le_bytes()[..n]);
            reseal(&mut bytes);
            cache::exercise(&bytes);
        }
    }
}

#[test]
fn edits_of_sound_files_do_no_harm() {
    let mut seeds: Vec<Vec<u8>> = corpus("cache").into_iter().map(|(_, bytes)| bytes).collect();
    seeds.extend(small_files().1);
    // A generator of our own: the edits must be the same every time, not clever.
    let mut state = 0x9e37_79b9_7f4a_7c15_u64;
    let mut random = |below: usize| {
        state =
            state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize % below
    };
    for _ in 0..2000 {
        let mut bytes = seeds[random(seeds.len())].clone();
        for _ in 0..=random(4) {
            if bytes.is_empty() {
                break;
            }
            let near = if random(3) == 0 { bytes.len() } else { bytes.len().min(700) };
            let at = random(near);
            match random(4) {
                0 => bytes[at] = random(256) as u8,
                1 => bytes[at] = [0, 1, 0x7f, 0x80, 0xff][random(5)],
                2 => bytes.truncate(at),
                _ => {
                    bytes.insert(at, 0);
                }
            }
        }
        cache::exercise(&bytes);
    }
}

#[test]
fn a_mesh_that_changes_while_it_is_baked_is_not_kept() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("part.obj");
    fs::write(&path, CORNER).unwrap();
    let source = MeshSource::File { path: path.clone(), metres_per_unit: 1e-3 };
    let request = Request {
        name: "part",
        role: PartRole::Tool,
        source: &source,
        spacing: Spacing::Size(1e-3),
        layers: 2,
        sides: InsideTest::Auto,
        with_gradients: false,
        points: Points::Facets,
        center_of_mass: None,
    };
    let (_guard, files) = small_files();
    let baked = read(&files[2]).unwrap();
    let mut cache = Cache::at(dir.path().join("cache"), CachePolicy::Copy);
    let Lookup::Bake(slot) = cache.look_up(&request, u64::MAX) else { panic!("an empty cache") };
    fs::write(&path, CORNER.replace('9', "8")).unwrap();
    cache.store(&slot, &request, &baked);
    assert!(cache.take_notes()[0].contains("the mesh of part changed while it was baked"));
    assert!(!dir.path().join("cache").exists());
    assert!(matches!(cache.look_up(&request, u64::MAX), Lookup::Bake(_)));
}

/// Checksums of what two reference objects bake to, after the generation that they belong to. They
/// hold on every machine: box and corner take nothing but IEEE arithmetic and square roots, no
/// library functions that round as they like.
///
/// Other numbers mean that baking gives other bits than before: count [`GENERATION`] up, so that no
/// cache mixes both, and [`refresh`] the numbers.
const REFERENCE: &str = include_str!("bake_reference.txt");

/// A prism of twenty sides in whole numbers, so that its bits are those of every machine: curved
/// enough to be felt as one patch.
fn round_prism() -> String {
    let quarter = [(20, 0), (19, 6), (16, 12), (12, 16), (6, 19)];
    let turned = (0..4).flat_map(|turns| {
        quarter.map(|corner| (0..turns).fold(corner, |(x, y): (i32, i32), _| (-y, x)))
    });
    let corners: Vec<(i32, i32)> = turned.collect();
    let n = corners.len();
    let vertices = [-10, 10]
        .map(|z| corners.iter().map(|(x, y)| format!("v {x} {y} {z}\n")).collect::<String>());
    let sides = (0..n).map(|k| {
        let a = k + 1;
        let b = (k + 1) % n + 1;
        format!("f {a} {b} {}\nf {a} {} {}\n", b + n, b + n, a + n)
    });
    let ends = (2..n).map(|k| format!("f 1 {} {k}\nf {} {} {}\n", k + 1, n + 1, n + k, n + k + 1));
    vertices.concat() + &sides.collect::<String>() + &ends.collect::<String>()
}

fn reference() -> String {
    let dir = tempfile::tempdir().unwrap();
    let mut config = small_scene(dir.path(), "");
    let path = dir.path().join("round.obj");
    fs::write(&path, round_prism()).unwrap();
    let mut round = config.statics[0].clone();
    round.name = "round".to_owned();
    round.source = MeshSource::File { path, metres_per_unit: 1e-4 };
    round.voxel_size_m = 2e-4;
    round.layers = 8;
    config.statics.push(round);
    config.parameters.contact.field = FieldKind::SurfacePoint;
    bake(&config, &dir.path().join("cache"), CachePolicy::Copy);
    let mut sums: Vec<String> = files(&dir.path().join("cache"))
        .iter()
        .flat_map(|file| {
            let region = MappedFile::copy(&fs::read(file).unwrap()).unwrap();
            Reader::new(region, None, GENERATION).unwrap().checksums().collect::<Vec<_>>()
        })
        .filter(|(name, _)| name != "report")
        .map(|(name, sum)| format!("{name:<16} {sum:016x}\n"))
        .collect();
    sums.sort();
    format!("generation {GENERATION}\n{}", sums.concat())
}

#[test]
fn the_generation_counts_up_whenever_baking_gives_other_bits() {
    assert_eq!(reference(), REFERENCE, "see REFERENCE");
}

/// Writes the reference checksums, and the seeds of the fuzzer in the present format: for a change
/// that is meant.
#[test]
#[ignore = "writes files of the repository: HAPTICD_REWRITE=1 cargo test --test it \
    bake_cache::refresh -- --ignored"]
fn refresh() {
    // Long tests are run with all ignored ones: files are written only where this variable asks for
    // it.
    if std::env::var_os("HAPTICD_REWRITE").is_none() {
        return;
    }
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    fs::write(root.join("tests/it/bake_reference.txt"), reference()).unwrap();
    let dir = tempfile::tempdir().unwrap();
    // As small as objects come, as every byte more makes a fuzzer slower.
    let mut config = small_scene(dir.path(), "");
    config.statics[0].source =
        MeshSource::Shape(Shape::Box { size_m: DVec3::new(2e-3, 2e-3, 1e-3) });
    config.statics[0].layers = 2;
    config.tool.source = config.statics[0].source.clone();
    let [_, tool, both] = roles(&config, &dir.path().join("plain"));
    config.parameters.contact.field = FieldKind::SurfacePoint;
    let [with_gradients, ..] = roles(&config, &dir.path().join("gradients"));
    let seeds = [
        ("head", both[..HEAD_BYTES].to_vec()),
        ("mesh", both.clone()),
        ("other-version", of_version(&tool, FORMAT, GENERATION + 1)),
        ("static-with-gradients", with_gradients),
        ("tool", tool),
    ];
    for (name, bytes) in seeds {
        fs::write(root.join("fuzz/corpus/cache").join(name), bytes).unwrap();
    }
}
