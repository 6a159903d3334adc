//! What the target of the bake cache does with its bytes. The tests of the program include this
//! file and replay the corpus.

use glam::{DVec3, Vec3};
use hapticd::scene::cache;
use vps::contact;
use vps::pointshell::tree::CHILDREN;
use vps::spatial::Pose;
use vps::storage::sections;
use vps::voxmap::field::FieldKind;

/// Reads the bytes as a file of the cache, once as they are and once with versions and checksums
/// that fit (nothing would come past them by chance), and looks up what a tick looks up. Gives how
/// many of the two were taken for sound.
///
/// # Panics
/// Whenever a file, however wrong, leads to a panic.
pub(crate) fn exercise(bytes: &[u8]) -> usize {
    let mut sealed = bytes.to_vec();
    let versions = [sections::FORMAT.to_le_bytes(), cache::GENERATION.to_le_bytes()].concat();
    if let Some(found) = sealed.get_mut(sections::VERSIONS_AT) {
        found.copy_from_slice(&versions);
    }
    sections::reseal(&mut sealed);
    [bytes, &sealed].into_iter().filter(|bytes| read(bytes)).count()
}

fn read(bytes: &[u8]) -> bool {
    let Ok(baked) = cache::read(bytes) else { return false };
    let kinds = FieldKind::NAMES.map(|(_, kind)| kind);
    if let Some(field) = &baked.field {
        for kind in kinds {
            // Beyond the grid on both sides, and whatever lies between.
            for at in [
                -1e30,
                -1.0,
                0.0,
                0.3,
                7.9,
                8.0,
                12.5,
                20.1,
                63.9,
                1e4,
                3e9,
                f32::INFINITY,
                f32::NAN,
            ] {
                for cells in [
                    Vec3::splat(at),
                    Vec3::new(at, 9.5, 9.5),
                    Vec3::new(9.5, at, 9.5),
                    Vec3::new(9.5, 9.5, at),
                ] {
                    std::hint::black_box((
                        field.value(kind, cells, Vec3::X),
                        field.gradient(cells),
                    ));
                }
            }
        }
    }
    if let Some(shell) = &baked.shell {
        assert_eq!(shell.points().count(), shell.len());
        let tree = shell.tree();
        for level in 0..tree.n_levels() {
            assert_eq!(tree.spheres(level).len(), tree.representatives(level).len());
            assert_eq!(tree.spheres(level).len(), tree.n_nodes(level).div_ceil(CHILDREN));
            assert!(
                tree.representatives(level)
                    .iter()
                    .flatten()
                    .all(|point| (*point as usize) < shell.len())
            );
            for node in 0..tree.n_nodes(level) {
                assert!(!tree.points_below(level, node, shell.len()).is_empty());
            }
        }
    }
    if let (Some(field), Some(shell)) = (&baked.field, &baked.shell) {
        for kind in kinds {
            for pose in [
                Pose::IDENTITY,
                Pose::from_translation(DVec3::splat(1e-3)),
                Pose::from_translation(DVec3::splat(f64::MAX)),
            ] {
                contact::visit(field, kind, shell, pose, |contact| {
                    assert!((contact.point_idx as usize) < shell.len());
                });
            }
        }
    }
    true
}
