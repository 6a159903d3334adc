//! The corpora of the fuzz targets, seeds and past findings, through the same functions on any
//! toolchain.

use std::path::Path;

use vps::mesh::Format;

#[path = "../../fuzz/src/cache.rs"]
pub(super) mod cache;
#[path = "../../fuzz/src/mesh.rs"]
mod mesh;
#[path = "../../fuzz/src/protocol.rs"]
mod protocol;
#[path = "../../fuzz/src/recording.rs"]
pub(super) mod recording;

/// The files of a corpus, by name.
pub(super) fn corpus(target: &str) -> Vec<(String, Vec<u8>)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/corpus").join(target);
    let entries =
        std::fs::read_dir(folder).expect(target).map(|entry| entry.expect("an entry").path());
    let name = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let mut files: Vec<_> =
        entries.map(|path| (name(&path), std::fs::read(&path).expect("a file"))).collect();
    files.sort();
    files
}

#[test]
fn corpora_of_the_mesh_readers_do_no_harm() {
    let formats = [
        ("obj", Format::Obj),
        ("stl", Format::Stl),
        ("ply", Format::Ply),
        ("gltf", Format::Gltf),
        ("threemf", Format::ThreeMf),
    ];
    for (folder, format) in formats {
        let mut n_files = 0;
        let mut n_meshes = 0;
        for (_, bytes) in corpus(folder) {
            let is_mesh = mesh::exercise(&bytes, format);
            // Whatever a file is taken for, it does no harm.
            for (_, other) in formats {
                mesh::exercise(&bytes, other);
            }
            // And wherever it is cut.
            for length in (0..bytes.len()).step_by(bytes.len() / 64 + 1) {
                mesh::exercise(&bytes[..length], format);
            }
            n_files += 1;
            n_meshes += usize::from(is_mesh);
        }
        assert!(
            n_files >= 2 && n_meshes >= 2,
            "{folder}: {n_meshes} meshes in {n_files} files, so the seeds do not reach the readers"
        );
    }
}

#[test]
fn the_corpus_of_the_bake_cache_does_no_harm() {
    let mut sound = Vec::new();
    for (name, bytes) in corpus("cache") {
        match cache::exercise(&bytes) {
            2 => sound.push(name),
            n => assert_eq!(
                (n, name.as_str()),
                if name == "other-version" { (1, "other-version") } else { (0, "head") }
            ),
        }
        for length in (0..bytes.len()).step_by(bytes.len() / 64 + 1) {
            cache::exercise(&bytes[..length]);
        }
    }
    assert_eq!(
        sound,
        ["mesh", "static-with-gradients", "tool"],
        "files of an older format do not reach the arrays; see `refresh`"
    );
}

#[test]
fn the_corpus_of_the_reader_of_recordings_does_no_harm() {
    let mut read = Vec::new();
    for (name, bytes) in corpus("recording") {
        if recording::exercise(&bytes) > 0 {
            read.push(name);
        }
        for length in (0..bytes.len()).step_by(bytes.len() / 64 + 1) {
            recording::exercise(&bytes[..length]);
        }
        // Wherever one byte is another.
        for at in (0..bytes.len()).step_by(bytes.len() / 256 + 1) {
            let mut broken = bytes.clone();
            broken[at] ^= 0xFF;
            recording::exercise(&broken);
        }
    }
    assert_eq!(
        read,
        ["packed", "plain"],
        "seeds of an older form do not reach the messages; see `rewrite_the_recordings`"
    );
}

#[test]
fn the_corpus_of_the_protocols_does_no_harm() {
    let mut reached = vec![[false; 2]; protocol::N.into()];
    for (name, bytes) in corpus("protocol") {
        let n = protocol::exercise(&bytes);
        if !name.starts_with("found-") {
            assert!(
                n > 0,
                "{name}: nothing was understood, so the seed does not reach behind the framing"
            );
            reached[usize::from(bytes[0])][usize::from(bytes[1] >> 7)] = true;
        }
        // Whichever protocol the bytes are taken for, in whatever pieces, on either side.
        for number in 0..protocol::N {
            for pieces in [0, 2, 63, 127, 0x80, 0xFF] {
                protocol::exercise(&[&[number, pieces], &bytes[2..]].concat());
            }
        }
    }
    let missing: Vec<_> =
        (0..protocol::N).filter(|number| !reached[usize::from(*number)][0]).collect();
    assert!(missing.is_empty(), "no seed for the host of {missing:?}");
}
