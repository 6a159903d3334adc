//! Bodies that share walls, of which single triangles stand twice or face the wrong way.

use proptest::prelude::*;

use super::tests::{Parts, askew, assert_same, block, exactly, in_parts, parts, together};
use crate::mesh::TriangleMesh;

/// What happens to a triangle of the file.
#[derive(Clone, Copy, Debug)]
enum Damage {
    Repeat,
    TurnedRepeat,
    Turn,
}

fn damage() -> impl Strategy<Value = (Damage, u64)> {
    let kind = prop_oneof![Just(Damage::Repeat), Just(Damage::TurnedRepeat), Just(Damage::Turn)];
    (kind, any::<u64>())
}

fn damaged(mut mesh: TriangleMesh, damages: &[(Damage, u64)]) -> TriangleMesh {
    let n = mesh.triangles.len();
    for (kind, place) in damages {
        let place = (*place % n as u64) as usize;
        let [a, b, c] = mesh.triangles[place];
        match kind {
            Damage::Repeat => mesh.triangles.push([a, b, c]),
            Damage::TurnedRepeat => mesh.triangles.push([a, c, b]),
            Damage::Turn => mesh.triangles[place] = [a, c, b],
        }
    }
    mesh
}

/// A block of 2 × 2 × 2 others, and those in one file.
fn eight(sizes_mm: [[f64; 2]; 3], is_turned: bool) -> [TriangleMesh; 2] {
    let parts = (0..8).map(|k| {
        let low = [0, 1, 2].map(|axis| if k >> axis & 1 == 0 { 0.0 } else { sizes_mm[axis][0] });
        let size = [0, 1, 2].map(|axis| sizes_mm[axis][k >> axis & 1]);
        block(low, [0, 1, 2].map(|axis| low[axis] + size[axis]))
    });
    let whole = block([0.0; 3], sizes_mm.map(|[one, other]| one + other));
    [whole, together(parts)].map(|mesh| if is_turned { askew(mesh) } else { mesh })
}

/// Kinds of random files, each with what the one before has.
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
enum Kind {
    TouchInPart,
    Overlap,
    BodiesInside,
    InwardRepeats,
}

impl Kind {
    fn of(self, mut parts: Parts) -> Parts {
        if self < Self::Overlap {
            parts.cuts.iter_mut().for_each(|(_, _, overlap)| *overlap = 0.0);
        }
        if self < Self::BodiesInside {
            parts.extra.clear();
            parts.repeats.clear();
        }
        if self < Self::InwardRepeats {
            parts.inward_repeats.clear();
        }
        parts
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, ..ProptestConfig::default() })]

    #[test]
    fn single_triangles_that_repeat_or_are_turned_change_nothing(
        sizes_mm in proptest::array::uniform3(proptest::array::uniform2(3.0..9.0_f64)),
        is_turned: bool,
        damages in proptest::collection::vec(damage(), 1..6),
        seed: u64,
    ) {
        let [whole, parts] = eight(sizes_mm, is_turned);
        let found = exactly(&damaged(parts, &damages));
        prop_assert!(found.skins.triangles.is_empty(), "{:?}", found.report);
        assert_same(&found.border, &whole, seed);
    }

    #[test]
    fn damaged_triangles_of_random_parts_change_nothing(
        kind in prop_oneof![
            Just(Kind::TouchInPart),
            Just(Kind::Overlap),
            Just(Kind::BodiesInside),
            Just(Kind::InwardRepeats),
        ],
        parts in parts(),
        damages in proptest::collection::vec(damage(), 1..6),
        seed: u64,
    ) {
        let (whole, mesh) = in_parts(&kind.of(parts));
        let found = exactly(&damaged(mesh, &damages));
        prop_assert!(found.skins.triangles.is_empty(), "{:?}", found.report);
        assert_same(&found.border, &whole, seed);
    }
}
