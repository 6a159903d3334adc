//! Any way to cut one solid into shells gives the same field.

use glam::{DQuat, DVec3};
use vps::mesh::TriangleMesh;
use vps::mesh::validate::inspect;
use vps::spatial::testing::Random;
use vps::voxmap::grid::cell_of;
use vps::voxmap::{Options, Volume};

/// Corners of a box.
type Extent = [DVec3; 2];

fn uniform(random: &mut Random, low: f64, high: f64) -> f64 {
    low + (high - low) * 0.5 * (1.0 + random.signed())
}

fn below(random: &mut Random, n: usize) -> usize {
    (uniform(random, 0.0, n as f64) as usize).min(n - 1)
}

fn add_box(mesh: &mut TriangleMesh, [low, high]: Extent, inward: bool) {
    let first = mesh.vertices.len() as u32;
    for corner in 0..8 {
        let part = |axis: usize| if corner >> axis & 1 == 1 { high[axis] } else { low[axis] };
        mesh.vertices.push(DVec3::new(part(0), part(1), part(2)));
    }
    // Counter-clockwise seen from outside.
    for [a, b, c, d] in
        [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]]
    {
        for mut triangle in [[a, b, c], [a, c, d]] {
            if inward {
                triangle.swap(0, 1);
            }
            mesh.triangles.push(triangle.map(|corner: u32| corner + first));
        }
    }
}

/// A block, and a file that has it in touching, overlapping, nested, repeated or turned parts.
fn block_and_parts(random: &mut Random) -> (TriangleMesh, TriangleMesh) {
    let high = DVec3::from_array([0; 3].map(|_| uniform(random, 6.0, 20.0)));
    let whole = [DVec3::ZERO, high];
    let mut parts: Vec<Extent> = vec![whole];
    for _ in 0..1 + below(random, 4) {
        let [low, high] = parts.swap_remove(below(random, parts.len()));
        let axis = below(random, 3);
        let at = uniform(random, low[axis], high[axis]);
        let mut one = [low, high];
        let mut other = [low, high];
        one[1][axis] = at;
        other[0][axis] = at;
        parts.extend([one, other]);
    }
    let n_touching = parts.len();
    let mut inward = vec![false; n_touching];
    match below(random, 4) {
        // A part that touches others and faces inward was exported the wrong way round.
        0 if n_touching > 1 => inward[below(random, n_touching)] = true,
        1 => {
            // Some reach into others.
            for part in &mut parts {
                for corner in part.iter_mut() {
                    let by = DVec3::from_array([0; 3].map(|_| uniform(random, -2.0, 2.0)));
                    *corner = (*corner + by).clamp(DVec3::ZERO, high);
                }
                *part = [part[0].min(part[1]), part[0].max(part[1])];
            }
            // What they no longer cover is covered by the block itself.
            parts.push(whole);
        }
        2 => {
            // Nested.
            let inner = [0, 1]
                .map(|_| DVec3::from_array([0, 1, 2].map(|axis| uniform(random, 0.0, high[axis]))));
            parts.push([inner[0].min(inner[1]), inner[0].max(inner[1])]);
        }
        _ => {
            let again = parts[below(random, n_touching)];
            parts.push(again);
        }
    }
    inward.resize(parts.len(), false);
    let turn = DQuat::from_xyzw(random.signed(), random.signed(), random.signed(), random.signed())
        .normalize();
    let turn = if below(random, 3) == 0 { DQuat::IDENTITY } else { turn };
    let of = |boxes: &mut dyn Iterator<Item = (Extent, bool)>| {
        let mut mesh = TriangleMesh::default();
        boxes.for_each(|(extent, inward)| add_box(&mut mesh, extent, inward));
        mesh.vertices.iter_mut().for_each(|vertex| *vertex = turn * *vertex * 1e-3);
        mesh
    };
    (of(&mut std::iter::once((whole, false))), of(&mut parts.into_iter().zip(inward)))
}

#[test]
fn any_parts_of_a_block_give_the_field_of_the_block() {
    let mut random = Random(40);
    for case in 0..500 {
        let (whole, parts) = block_and_parts(&mut random);
        let voxel_size_mm = if case % 20 == 0 { 0.1 } else { uniform(&mut random, 0.2, 1.0) };
        let voxel_size_m = 1e-3 * voxel_size_mm;
        let options = Options { layers: 4, ..Options::new(voxel_size_m) };
        let [whole, parts] = [whole, parts].map(|mesh| {
            let map =
                Volume::build(&mesh, &inspect(&mesh), &options, |_| ()).expect("a small grid");
            assert!(map.beside.is_empty() && !map.thin, "case {case}: {:?}", map.solid);
            let distances = map.distances(&mesh, false);
            (map, distances)
        });
        assert_eq!(whole.0.layers.grid, parts.0.layers.grid, "case {case}");
        assert_eq!(whole.0.layers.bricks, parts.0.layers.bricks, "case {case}");
        assert_eq!(whole.0.layers.values, parts.0.layers.values, "case {case}");
        for (slot, brick) in whole.0.layers.bricks.iter().enumerate() {
            let coord = whole.0.layers.grid.brick_coord(*brick as usize);
            for inside in 0..512 {
                let [one, other] = [&whole, &parts].map(|of| of.1.values_m[slot][inside]);
                let voxels = f64::from((one - other).abs()) / voxel_size_m;
                assert!(
                    voxels < 1e-4,
                    "case {case}: {voxels} voxels at {:?}, {one} and {other} m: {:?}",
                    whole.0.layers.grid.center_map(cell_of(coord, inside)),
                    parts.0.solid
                );
            }
        }
        let [of_whole, of_parts] =
            [&whole.0, &parts.0].map(|map| map.solid.as_ref().expect("a solid").mass);
        let ratio = of_parts.volume_m3 / of_whole.volume_m3;
        assert!((ratio - 1.0).abs() < 1e-9, "case {case}: {ratio}");
    }
}
