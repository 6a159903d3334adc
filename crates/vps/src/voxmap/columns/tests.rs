use std::collections::BTreeSet;

use super::*;
use crate::spatial::testing::Random;

impl Random {
    /// Triangles of every kind that is hard on rounding, in turn, within about `spread` of
    /// `around`.
    fn triangle(&mut self, kind: usize, around: DVec3, spread: f64) -> [DVec3; 3] {
        let on_lattice = |point: DVec3| (2.0 * point).floor() / 2.0;
        let mut free = || around + self.in_box(-spread, spread);
        let [a, b, c] = [free(), free(), free()];
        let noise = [0.0, 1e-15, 1e-12, 1e-9][kind % 4];
        let mut shaken =
            |corners: [DVec3; 3]| corners.map(|corner| corner + self.in_box(-noise, noise));
        match kind / 4 % 8 {
            0 => [a, b, c],
            // Touching exactly: faces, edges and corners on cell boundaries.
            1 => shaken([a, b, c].map(on_lattice)),
            2 => shaken([a, b, c].map(DVec3::floor)),
            // In a plane of the lattice, in each direction.
            3 => {
                let axis = kind % 3;
                shaken([a, b, c].map(|mut corner| {
                    corner[axis] = around[axis].floor();
                    corner
                }))
            }
            // No area: a segment, a point.
            4 => shaken([a, b, a + (b - a) * 0.3]),
            5 => shaken([a.floor(), a.floor(), on_lattice(b)]),
            6 => shaken([a, a, a]),
            // A needle along an edge of cells.
            _ => {
                let mut tip = a.floor();
                tip[kind % 3] += spread;
                shaken([a.floor(), tip, a.floor() + DVec3::splat(1e-7)])
            }
        }
    }
}

#[test]
fn both_navigations_equal_the_specification_on_a_million_pairs_degenerate_ones_included() {
    let mut random = Random(5);
    let mut pairs = 0_u64;
    let mut hits = 0_u64;
    let dims = [32_768; 3];
    for kind in 0..40_000 {
        // Near the far end of the largest grid every other time.
        let middle =
            [DVec3::splat(20.0), DVec3::new(32_740.0, 9.0, 32_751.0), DVec3::splat(32_750.0)]
                [kind / 32 % 3];
        let spread = [0.3, 1.2, 4.0][kind / 96 % 3];
        let around = middle + random.in_box(-1.0, 1.0);
        let corners = random.triangle(kind, around, spread);
        let sat = TriangleSat::new(&corners);
        let mut expected = BTreeSet::new();
        let low = sat.bounds.0.floor() - 2.0;
        let high = sat.bounds.1.floor() + 2.0;
        for x in low.x as i32..=high.x as i32 {
            for y in low.y as i32..=high.y as i32 {
                for z in low.z as i32..=high.z as i32 {
                    pairs += 1;
                    if sat.hits([x, y, z]) {
                        expected.insert([x, y, z]);
                    }
                }
            }
        }
        hits += expected.len() as u64;
        let columns = Columns::new(&corners, dims);
        let mut tests = [0, 0];
        for (navigation, tests) in
            [Navigation::PlaneSpan, Navigation::TwoSided].into_iter().zip(&mut tests)
        {
            let mut found = BTreeSet::new();
            *tests = columns.walk(columns.slabs(), navigation, |run| {
                for w in run.first[run.axis]..=run.last {
                    let mut cell = run.first;
                    cell[run.axis] = w;
                    assert!(found.insert(cell), "{cell:?} twice");
                }
            });
            assert_eq!(found, expected, "{navigation:?}, kind {kind}: {corners:?}");
        }
        assert!(
            tests[1] <= tests[0] && tests[0] >= expected.len() as u64,
            "kind {kind}: {tests:?}"
        );
    }
    assert!(pairs > 4_000_000 && hits > 300_000, "{pairs} pairs, {hits} hits");
}

#[test]
fn hardly_any_voxel_is_left_to_the_specification() {
    // In general position no end of an interval comes within the margin, even far from the origin.
    let mut random = Random(9);
    for _ in 0..2000 {
        let corners = [(); 3].map(|()| DVec3::splat(30_000.0) + random.in_box(0.0, 40.0));
        let columns = Columns::new(&corners, [32_768; 3]);
        let margins = [&columns.outline, &columns.by_slab, &columns.by_row]
            .into_iter()
            .flat_map(|lines| &lines.0);
        for line in margins {
            if let Line::Slanted(Slanted { at_zero, .. }) = line {
                assert!(at_zero.first_certain - at_zero.first_possible < 2.0 * MARGIN_MAX_CELLS);
            }
        }
        assert!(columns.plane.at_zero.first_certain - columns.plane.at_zero.first_possible < 1e-8);
    }
}

#[test]
fn rounding_to_the_nearest_saturates() {
    for (x, expected) in [(0.4, 0), (0.6, 1), (-0.6, -1), (-2.4, -2), (32_767.49, 32_767)] {
        assert_eq!(nearest(x), expected);
    }
    assert_eq!([nearest(f64::NEG_INFINITY), nearest(1e300)], [-1_000_000_000, 1_000_000_000]);
}
