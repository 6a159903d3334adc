//! The corpora of the fuzz targets, seeds and past findings, through the same functions on any toolchain.

use std::path::Path;

use hapticd::mesh::Format;

#[path = "../../fuzz/src/lib.rs"]
#[expect(unreachable_pub, reason = "the file is a crate of its own beside the fuzz targets")]
mod target;

#[test]
fn corpora_of_the_mesh_readers_do_no_harm() {
    let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/corpus");
    let formats =
        [("obj", Format::Obj), ("stl", Format::Stl), ("ply", Format::Ply), ("gltf", Format::Gltf), ("threemf", Format::ThreeMf)];
    for (folder, format) in formats {
        let (mut n_files, mut n_meshes) = (0, 0);
        for entry in std::fs::read_dir(corpus.join(folder)).expect(folder) {
            let path = entry.expect("an entry").path();
            let bytes = std::fs::read(&path).expect("a file");
            let is_mesh = target::mesh(&bytes, format);
            // Whatever a file is taken for, it does no harm.
            for (_, other) in formats {
                target::mesh(&bytes, other);
            }
            // And wherever it is cut.
            for length in (0..bytes.len()).step_by(bytes.len() / 64 + 1) {
                target::mesh(&bytes[..length], format);
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
