//! The point-sphere tree: what a walk may rely on.

use glam::{DVec3, Vec3};
use proptest::prelude::*;
use vps::mesh::TriangleMesh;
use vps::mesh::primitives::Shape;
use vps::pointshell::shell::{LANES, Shell};
use vps::pointshell::tree::{CHILDREN, Tree};
use vps::pointshell::{self, ShellReport};
use vps::voxmap::inside_test::InsideTest;

use super::{build_as, models};

fn shell_of(mesh: &TriangleMesh, voxel_size_m: f64) -> (Shell, ShellReport) {
    let map = build_as(mesh, voxel_size_m, 3, InsideTest::Flood);
    pointshell::build(mesh, &map, DVec3::new(1e-3, -2e-3, 5e-4))
}

fn positions(shell: &Shell) -> Vec<Vec3> {
    shell.points().map(|(position, _)| position).collect()
}

/// Everything that must hold of any tree, whatever the order of its points.
fn assert_sound(shell: &Shell) {
    let tree = shell.tree();
    let points = positions(shell);
    if points.is_empty() {
        assert_eq!((tree.n_levels(), tree.n_nodes(0), tree.heap_bytes()), (0, 0, 0));
        assert!(tree.spheres(0).is_empty() && tree.representatives(0).is_empty());
        return;
    }
    let leaves = tree.n_levels() - 1;
    assert_eq!((tree.n_nodes(0), tree.n_nodes(leaves)), (1, points.len().div_ceil(LANES)));
    let mut finer: Option<Vec<u32>> = None;
    for level in (0..=leaves).rev() {
        let n_nodes = tree.n_nodes(level);
        assert_eq!(
            (tree.spheres(level).len(), tree.representatives(level).len()),
            [n_nodes.div_ceil(CHILDREN); 2].into()
        );
        let mut next_point = 0;
        let mut samples = Vec::new();
        for node in 0..n_nodes {
            let block = node / CHILDREN;
            let lane = node % CHILDREN;
            let spheres = &tree.spheres(level)[block];
            let center = Vec3::new(spheres.x[lane], spheres.y[lane], spheres.z[lane]).as_dvec3();
            let radius_m = f64::from(spheres.radius[lane]);
            let below = tree.points_below(level, node, points.len());
            assert_eq!(below.start, next_point, "each point lies under one node of a level");
            next_point = below.end;
            for point in &points[below.clone()] {
                let distance_m = (point.as_dvec3() - center).length();
                assert!(
                    distance_m <= radius_m,
                    "level {level}, node {node}: {distance_m} beyond {radius_m}"
                );
            }
            let sample = tree.representatives(level)[block][lane];
            assert!(
                below.contains(&(sample as usize)),
                "a node is represented by a point below it"
            );
            samples.push(sample);
        }
        assert_eq!(next_point, points.len(), "no point is missing");
        if let Some(spheres) = tree.spheres(level).last() {
            for lane in (n_nodes - 1) % CHILDREN + 1..CHILDREN {
                assert_eq!(spheres.radius[lane], f32::NEG_INFINITY);
                assert!(
                    spheres.x[lane].is_finite()
                        && spheres.y[lane].is_finite()
                        && spheres.z[lane].is_finite()
                );
            }
        }
        assert!(
            finer.is_none_or(|finer| samples
                .iter()
                .all(|sample| finer.binary_search(sample).is_ok())),
            "levels are nested"
        );
        // In rising order, because the points below successive nodes are.
        assert!(samples.is_sorted());
        finer = Some(samples);
    }
}

fn meshes() -> Vec<(String, TriangleMesh, f64)> {
    let mut meshes = vec![
        ("sphere".to_owned(), Shape::Sphere { radius_m: 0.02 }.tessellate(1e-5), 5e-4),
        ("torus".to_owned(), Shape::Torus { major_m: 0.02, minor_m: 0.006 }.tessellate(1e-5), 5e-4),
        (
            "plate".to_owned(),
            Shape::Box { size_m: DVec3::new(0.05, 0.04, 0.0021) }.tessellate(1e-5),
            5e-4,
        ),
    ];
    let wanted = ["factory_bolt_m16_tight.obj", "rocker-arm.obj", "stanford-bunny.obj"];
    meshes.extend(models::all().into_iter().filter(|(name, _)| wanted.contains(name)).map(
        |(name, mesh)| {
            let (low, high) = mesh.bounds().expect("not empty");
            let voxel_size_m = (high - low).max_element() / 150.0;
            (name.to_owned(), mesh, voxel_size_m)
        },
    ));
    meshes
}

#[test]
fn trees_over_meshes_are_sound_compact_and_evenly_sampled() {
    for (name, mesh, voxel_size_m) in meshes() {
        let (shell, report) = shell_of(&mesh, voxel_size_m);
        assert_sound(&shell);
        let tree = shell.tree();
        let points = positions(&shell);
        assert_eq!(report.tree_levels.len(), tree.n_levels() + 1);
        assert_eq!(report.tree_levels.last().map(|level| level.points), Some(points.len()));
        for (level, figures) in report.tree_levels[..tree.n_levels()].iter().enumerate() {
            assert_eq!(figures.points, tree.n_nodes(level));
            let radii =
                tree.spheres(level).iter().flat_map(|spheres| spheres.radius).take(figures.points);
            assert!(radii.fold(0.0, f32::max) == figures.max_radius_m as f32);
            let samples: Vec<Vec3> = tree
                .representatives(level)
                .iter()
                .flatten()
                .take(figures.points)
                .map(|sample| points[*sample as usize])
                .collect();
            if samples.len() < 32 {
                continue;
            }
            let mut nearest: Vec<f32> = nearest_others(&samples);
            nearest.sort_by(f32::total_cmp);
            let mean = nearest.iter().sum::<f32>() / nearest.len() as f32;
            let [least, low, high] =
                [nearest[0], nearest[nearest.len() / 20], nearest[nearest.len() - 1]]
                    .map(|d| d / mean);
            eprintln!(
                "{name} level {level}: {} nodes, radius mean {:.2} max {:.2} voxels, spacing {:.2} \
                    voxels; nearest other over its mean: least {least:.2}, 5 % {low:.2}, most \
                    {high:.2}",
                figures.points,
                figures.mean_radius_m / voxel_size_m,
                figures.max_radius_m / voxel_size_m,
                f64::from(mean) / voxel_size_m,
            );
            // Roughly uniform: one sample in twenty has a neighbour nearer than 0.4 of the mean,
            // none is farther off than thrice.
            assert!(low > 0.4 && high < 3.0, "{name}, level {level}: {low} {high}");
        }
        // A block of sixteen points covers a patch of four by four or so; few straddle a gap.
        let leaves = report.tree_levels[tree.n_levels() - 1];
        let radii = tree
            .spheres(tree.n_levels() - 1)
            .iter()
            .flat_map(|spheres| spheres.radius)
            .take(leaves.points);
        let wide = radii.filter(|radius| f64::from(*radius) > 6.0 * voxel_size_m).count() as f64
            / leaves.points as f64;
        eprintln!("{name}: {:.2} % of the leaves are wider than 6 voxels", 100.0 * wide);
        assert!(
            leaves.mean_radius_m < 3.0 * voxel_size_m && wide < 0.05,
            "{name}: {leaves:?}, {wide}"
        );
    }
}

fn nearest_others(points: &[Vec3]) -> Vec<f32> {
    let others = |idx: usize| {
        points.iter().enumerate().filter(move |(other, _)| *other != idx).map(|(_, other)| *other)
    };
    (0..points.len())
        .map(|idx| {
            others(idx).map(|other| points[idx].distance(other)).fold(f32::INFINITY, f32::min)
        })
        .collect()
}

#[test]
fn the_tree_has_the_same_bits_on_one_and_three_threads() {
    let mesh = Shape::Torus { major_m: 0.02, minor_m: 0.006 }.tessellate(1e-5);
    let bake = || {
        let (shell, report) = shell_of(&mesh, 2e-4);
        let tree = shell.tree();
        assert!(shell.len() > 1 << 15, "large enough for more than one task");
        let levels: Vec<_> = (0..tree.n_levels())
            .map(|level| (tree.spheres(level).to_vec(), tree.representatives(level).to_vec()))
            .collect();
        (shell.points().collect::<Vec<_>>(), levels, report.tree_levels)
    };
    let on_threads = |n_threads| {
        rayon::ThreadPoolBuilder::new()
            .num_threads(n_threads)
            .build()
            .expect("a pool")
            .install(bake)
    };
    assert!(on_threads(1) == on_threads(3));
}

#[test]
fn a_shell_without_points_and_one_of_a_single_point_have_trees() {
    assert_sound(&Shell::new(&[], 1e-3));
    let one = Shell::new(&[(DVec3::new(0.01, 0.02, -0.03), DVec3::Z)], 1e-3);
    assert_sound(&one);
    let tree = one.tree();
    assert_eq!(
        (tree.n_levels(), tree.spheres(0)[0].radius[0], tree.representatives(0)[0]),
        (1, 0.0, [0; CHILDREN])
    );
    assert_eq!(tree.spheres(0)[0].z[0], -0.03);
    assert_eq!(Tree::default().n_levels(), 0);
}

#[test]
fn the_heap_of_a_shell_counts_its_tree() {
    let points = vec![(DVec3::X, DVec3::Z); 1000];
    let shell = Shell::new(&points, 1e-3);
    let blocks = 1000_usize.div_ceil(LANES);
    let nodes = [blocks, blocks.div_ceil(CHILDREN), 1];
    let tree_bytes: usize = nodes
        .iter()
        .map(|n| n.div_ceil(CHILDREN) * (4 * CHILDREN * 4 + 2 * CHILDREN * 4) + 8)
        .sum();
    assert_eq!(shell.tree().heap_bytes(), tree_bytes);
    assert_eq!(shell.heap_bytes(), blocks * LANES * (2 * 12 + 4) + tree_bytes);
}

proptest! {
    #[test]
    fn a_tree_over_any_points_in_any_order_is_sound(
        points in prop::collection::vec(prop::array::uniform3(-1.0..1.0_f64), 0..1200), coarse: bool,
    ) {
        // Coarse: many coincide.
        let snapped = |x: f64| if coarse { x.round() } else { x };
        let points: Vec<(DVec3, DVec3)> = points.into_iter().map(|p| (DVec3::from_array(p.map(snapped)), DVec3::Z)).collect();
        assert_sound(&Shell::new(&points, 1e-3));
    }
}
