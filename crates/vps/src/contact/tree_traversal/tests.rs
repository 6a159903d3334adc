//! What a walk keeps from one tick to the next: proofs, depths and marks.
#![expect(clippy::expect_used, clippy::indexing_slicing, reason = "test code")]

use glam::{DQuat, DVec3};

use super::super::flat;
use super::super::tests::{block, plate};
use super::*;
use crate::mesh::primitives::Shape;
use crate::mesh::validate::inspect;
use crate::pointshell::{self, Points};
use crate::spatial::testing::Random;
use crate::voxmap::{Options, Volume};

/// The upper side of `plate()` in its own frame, m.
const TOP_M: f64 = 2e-3;
const VOXEL_M: f64 = 1e-3;

struct Fixture {
    field: Field,
    shell: Shell,
    walk: TreeTraversal,
    lists: Lists,
    touched: Vec<ContactBlock>,
}

impl Fixture {
    fn new() -> Self {
        Self::over(plate().field, 0.0)
    }

    fn over(field: Field, jump_cells: f32) -> Self {
        // A fine shell: three levels below the root.
        let (mesh, map) = block(DVec3::new(0.02, 0.014, 0.01), 4e-4);
        let shell = pointshell::build(&mesh, &map, DVec3::ZERO).0;
        let fixture = Self::of(field, jump_cells, shell);
        assert!(fixture.n_levels() >= 4, "{}", fixture.n_levels());
        fixture
    }

    /// A ball, whose points stand for more or less of its surface, in a block: all of it touches.
    fn in_a_block() -> Self {
        let mesh = Shape::Sphere { radius_m: 8e-3 }.tessellate(1e-5);
        let map = Volume::build(&mesh, &inspect(&mesh), &Options::new(5e-4), |_| ());
        let map = map.expect("a grid that fits");
        let shell = pointshell::build_with(Points::Facets, &mesh, &map, DVec3::ZERO).0;
        let (mesh, mut map) = block(DVec3::splat(0.03), VOXEL_M);
        let fixture = Self::of(map.field(&mesh, false), 0.0, shell);
        assert!(fixture.n_levels() >= 4, "{}", fixture.n_levels());
        fixture
    }

    fn of(field: Field, jump_cells: f32, shell: Shell) -> Self {
        let limit_m = limit_m(&field, FieldKind::Trilinear);
        let reach_m = shell.reach_m().min(limit_m);
        let bounds = BrickBounds::within(&field, reach_m).expect("bounds");
        assert!(bounds.jump_cells() < 1e-3, "{}", bounds.jump_cells());
        let walk =
            TreeTraversal::over(bounds.with_jump(jump_cells), &shell, limit_m).expect("a tree");
        let lists = Lists::new(&shell);
        let touched = Vec::with_capacity(shell.positions().len());
        Self { field, shell, walk, lists, touched }
    }

    fn find(&mut self, pose: Pose, budget: Budget) -> QueryResult {
        self.touched.clear();
        let place = Place::new(&self.field, pose);
        self.walk.find(
            SimdLevel::Portable,
            &self.shell,
            (&place, pose),
            budget,
            &mut self.lists,
            &mut self.touched,
        )
    }

    fn n_levels(&self) -> usize {
        self.walk.first_blocks.len()
    }

    /// Where a node's entries lie: its block and its lane.
    fn entry(&self, level: usize, node: usize) -> (usize, usize) {
        let n_blocks_before: usize =
            (0..level).map(|level| self.shell.tree().n_nodes(level).div_ceil(CHILDREN)).sum();
        (n_blocks_before + node / CHILDREN, node % CHILDREN)
    }

    /// Where a node's centre is, and its radius, cells.
    fn sphere(&self, level: usize, node: usize, pose: Pose) -> (DVec3, f64) {
        let spheres = &self.shell.tree().spheres(level)[node / CHILDREN];
        let lane = node % CHILDREN;
        let [x, y, z] = [spheres.x, spheres.y, spheres.z].map(|of| f64::from(of[lane]));
        let center = pose.transform_point(DVec3::new(x, y, z));
        (center, f64::from(spheres.radius[lane]) / VOXEL_M)
    }

    /// How far the nearest point of a leaf is from the plate, cells.
    fn nearest(&self, leaf: usize, pose: Pose) -> f64 {
        let points = self.shell.points().skip(leaf * LANES).take(LANES);
        let gaps = points.map(|(point, _)| gap(pose.transform_point(point.as_dvec3())));
        gaps.fold(f64::INFINITY, f64::min)
    }
}

/// From the plate, cells.
fn gap(place: DVec3) -> f64 {
    let beyond = place.abs() - DVec3::new(0.03, 0.03, TOP_M);
    beyond.max(DVec3::ZERO).length() / VOXEL_M
}

/// Turned a little, so that no two nodes are as high.
fn above(height_m: f64) -> Pose {
    Pose::new(
        DQuat::from_rotation_x(0.3) * DQuat::from_rotation_y(0.2),
        DVec3::new(1e-3, -2e-3, TOP_M + height_m),
    )
}

#[test]
fn the_margin_grows_with_the_distance_from_the_grid_and_the_reach_of_the_tool() {
    let Fixture { field, walk, .. } = Fixture::new();
    let at = |cells: DVec3| {
        let origin = field.origin_map().as_dvec3();
        let pose = Pose::from_translation(origin + cells * VOXEL_M);
        walk.margin_cells(&Place::new(&field, pose))
    };
    let near = at(DVec3::ZERO);
    assert!((MARGIN_CELLS..MARGIN_CELLS + 1e-4).contains(&near), "{near}");
    let far = at(DVec3::new(1e3, -2e3, 3e3));
    assert!((far - near - 6e-3).abs() < 1e-5, "{far} {near}");
}

#[test]
fn what_is_kept_of_a_node_is_how_far_its_centre_is_outside() {
    let mut fixture = Fixture::new();
    let pose = above(6e-3);
    fixture.find(pose, Budget::Points(1_000_000));
    let mut n_outside = 0;
    for level in 0..fixture.n_levels() {
        for node in 0..fixture.shell.tree().n_nodes(level) {
            let (at, lane) = fixture.entry(level, node);
            let kept = f64::from(fixture.walk.outside_cells[at][lane]);
            let (center, radius) = fixture.sphere(level, node, pose);
            let outside = gap(center);
            // What was looked at, within the band.
            if kept == f64::from(UNKNOWN) || outside > 6.0 {
                continue;
            }
            assert!((kept - outside).abs() < 1.3, "{level} {node}: {kept} for {outside}");
            n_outside += usize::from(radius > 2.0 && outside > 0.0);
        }
    }
    assert!(n_outside > 10, "{n_outside}");
}

#[test]
fn what_touched_comes_first_and_then_what_lies_deepest() {
    let mut fixture = Fixture::new();
    let budget = Budget::Points(1_000_000);
    fixture.find(above(6e-3), budget);
    let mut random = Random(5);
    for level in 1..fixture.n_levels() {
        let n_nodes = fixture.shell.tree().n_nodes(level);
        let mut open: Vec<u32> = (0..n_nodes as u32).collect();
        for from in (1..n_nodes).rev() {
            open.swap(from, (random.unit() * (from + 1) as f64) as usize);
        }
        fixture.walk.sort_by_depth(Some(level), &mut open);
        let keys: Vec<(bool, f32)> = open
            .iter()
            .map(|node| {
                let (at, lane) = fixture.entry(level, *node as usize);
                let is_touched = fixture.walk.touched_at[at][lane] == fixture.walk.now;
                (!is_touched, fixture.walk.outside_cells[at][lane])
            })
            .collect();
        assert!(keys.is_sorted(), "level {level}");
        let n_touched = keys.iter().filter(|(is_not_touched, _)| !is_not_touched).count();
        assert!(n_touched > 0 && n_touched < n_nodes, "{n_touched} of {n_nodes}");
    }
}

#[test]
fn a_contact_marks_its_leaf_and_what_is_above_it_and_nothing_else() {
    let mut fixture = Fixture::new();
    let last = fixture.n_levels() - 1;
    let n_leaves = fixture.shell.tree().n_nodes(last);
    for leaf in [0, 9, 70, n_leaves - 1] {
        fixture.walk.now += 1;
        fixture.walk.mark(leaf as u32);
        for level in 0..=last {
            let above = leaf / CHILDREN.pow((last - level) as u32);
            for node in 0..fixture.shell.tree().n_nodes(level) {
                assert_eq!(
                    fixture.walk.is_touched(Some(level), node as u32),
                    node == above,
                    "leaf {leaf}, level {level}, node {node}"
                );
            }
        }
    }
}

#[test]
fn what_was_deep_inside_is_looked_at_again_after_a_cell_of_motion() {
    let mut fixture = Fixture::new();
    let deep = fixture.find(above(0.0), Budget::Unlimited);
    assert!(!fixture.touched.is_empty());
    let far = fixture.find(above(0.05), Budget::Unlimited);
    assert!(fixture.touched.is_empty());
    // The root alone says that all of it is clear.
    assert_eq!(far.looked_at, CHILDREN as u32, "{} when deep", deep.looked_at);
}

/// Of a sound field, and of one whose side changes somewhere, where a proof reaches less far.
#[test]
fn a_leaf_is_clear_as_far_as_its_lowest_point_is_and_little_less() {
    for jump_cells in [0.0, 0.02, 0.1, 2.5] {
        let mut fixture = Fixture::over(plate().field, jump_cells);
        let jump = f64::from(jump_cells);
        let pose = above(0.0);
        fixture.find(pose, Budget::Unlimited);
        let last = fixture.n_levels() - 1;
        let mut n_by_points = 0;
        for leaf in 0..fixture.shell.tree().n_nodes(last) {
            let (at, lane) = fixture.entry(last, leaf);
            let clear = f64::from(fixture.walk.clear_until_cells[at][lane]);
            let nearest = fixture.nearest(leaf, pose);
            let (center, radius) = fixture.sphere(last, leaf, pose);
            if clear > 0.0 {
                assert!(clear <= nearest + 1e-3, "{leaf}: {clear} of {nearest}");
            }
            // Its sphere proves nothing, so its points did.
            if clear > 0.0 && gap(center) - radius - jump < 0.0 {
                assert!(clear + jump <= nearest + 1e-3, "{leaf}: {clear} of {nearest}");
                n_by_points += 1;
            }
            // Nothing was asked of it where a node above it is clear.
            let is_proven = clear > 0.0 || clear == f64::from(UNKNOWN);
            assert!(is_proven || nearest - jump < 1.3, "{leaf}: nothing proven of {nearest}");
        }
        assert!(n_by_points > 3, "{n_by_points}");
    }
}

#[test]
fn what_a_budget_leaves_out_is_stood_for_by_as_much_surface() {
    let mut fixture = Fixture::new();
    let whole: f32 = fixture.shell.weights().iter().flat_map(|Lanes(weights)| weights).sum();
    let shares: Vec<f32> = fixture.shell.weights().iter().flat_map(|of| of.0).collect();
    assert!(shares.iter().any(|share| (share - shares[0]).abs() > 0.1), "not all weigh the same");
    // Everything is in the plate.
    let (mesh, mut map) = block(DVec3::splat(0.06), VOXEL_M);
    fixture = Fixture::over(map.field(&mesh, false), 0.0);
    for n_points in [0, 1, 20, 100, 300, 1000] {
        let found = fixture.find(Pose::IDENTITY, Budget::Points(n_points));
        let felt: f32 = fixture
            .touched
            .iter()
            .map(|touched| {
                let of = fixture.shell.weights()[touched.block as usize];
                touched.weight * touched.lanes().map(|lane| of.0[lane]).sum::<f32>()
            })
            .sum();
        let missing = if fixture.touched.is_empty() { whole } else { 0.0 };
        assert!(
            (felt + missing - whole).abs() < 1e-3 * whole,
            "{n_points}: {felt} of {whole}, {found:?}"
        );
    }
}

#[test]
fn a_block_that_is_not_full_is_stood_for_by_one_of_its_points() {
    let (mesh, mut map) = block(DVec3::splat(0.06), VOXEL_M);
    let field = map.field(&mesh, false);
    let of_size = |k: u32| {
        let (mesh, map) = block(DVec3::new(0.02, 0.014, 0.01), 8e-4 + 1e-5 * f64::from(k));
        pointshell::build(&mesh, &map, DVec3::ZERO).0
    };
    let shell = (0..100).map(of_size).find(|shell| (1..4).contains(&(shell.len() % LANES)));
    let shell = shell.expect("a shell whose last block has few points");
    let whole: f32 = shell.weights().iter().flat_map(|Lanes(weights)| weights).sum();
    let mut fixture = Fixture::of(field, 0.0, shell);
    let n_points = fixture.shell.len() as u32 / 4;
    let mut n_left_out = 0;
    // Which of the points of a block are looked at changes from tick to tick.
    for _ in 0..40 {
        n_left_out += fixture.find(Pose::IDENTITY, Budget::Points(n_points)).left_out;
        let felt = fixture.touched.iter().map(|touched| {
            let of = fixture.shell.weights()[touched.block as usize];
            touched.weight * touched.lanes().map(|lane| of.0[lane]).sum::<f32>()
        });
        let felt: f32 = felt.sum();
        assert!((felt - whole).abs() < 1e-3 * whole, "{felt} of {whole}");
    }
    assert!(n_left_out > 0);
}

#[test]
fn a_way_is_what_was_gone_and_two_more_such_ticks() {
    let motion = Motion { last: None, along_cells: 3.0, about_rad: 0.5, step: (2.0, 0.25) };
    assert_eq!(motion.ways(), [(3.0, 0.5), (7.0, 1.0)]);
}

#[test]
fn no_point_reaches_farther_than_its_node() {
    let Fixture { shell, walk, .. } = Fixture::new();
    let blocks = (0..walk.first_blocks.len()).flat_map(|level| shell.tree().spheres(level));
    let mut n_nodes = 0;
    for (spheres, reaches) in blocks.zip(walk.reaches_cells.iter()) {
        for (lane, reach) in reaches.iter().enumerate() {
            let [x, y, z] = [spheres.x, spheres.y, spheres.z].map(|of| f64::from(of[lane]));
            let far_m = DVec3::new(x, y, z).length() + f64::from(spheres.radius[lane]);
            let far = far_m.max(0.0) / VOXEL_M;
            // And little more: what rounding may take.
            assert!((far..=far * 1.00001).contains(&f64::from(*reach)), "{reach} for {far_m} m");
            n_nodes += 1;
        }
    }
    assert!(n_nodes > 100, "{n_nodes}");
}

#[test]
fn a_tool_that_turns_where_it_is_forgets_its_proofs_too() {
    let mut fixture = Fixture::new();
    let reach = fixture.shell.radius_m() / VOXEL_M;
    let most_rad = FORGET_CELLS / reach;
    for turn in 0..(1.5 * most_rad) as usize {
        let pose = above(0.05) * Pose::new(DQuat::from_rotation_z(turn as f64), DVec3::ZERO);
        fixture.find(pose, Budget::Unlimited);
        let turned_rad = fixture.walk.motion.about_rad;
        assert!(turned_rad * reach <= FORGET_CELLS, "{turned_rad} rad of {most_rad}");
    }
    assert!(most_rad > 10.0);
}

#[test]
fn a_tool_that_turns_where_it_is_touches_as_soon_as_one_of_its_points_does() {
    let mut fixture = Fixture::new();
    let mut n_touching = Vec::new();
    // Its lower side is 5 mm below its middle, and an edge of that side 11 mm away.
    for tick in (0..40).map(f64::from) {
        let turn = DQuat::from_scaled_axis(DVec3::new(0.004, 0.02, -0.003) * tick);
        let pose = Pose::new(turn, DVec3::new(1e-3, -2e-3, TOP_M + 7e-3));
        fixture.find(pose, Budget::Unlimited);
        let lanes = |touched: &ContactBlock| (touched.block, touched.lanes);
        let found: Vec<(u32, u16)> = fixture.touched.iter().map(lanes).collect();
        let mut expected = Vec::new();
        let Fixture { field, shell, .. } = &fixture;
        flat::blocks(field, FieldKind::Trilinear, shell, pose, |touched| {
            expected.push(lanes(touched));
        });
        assert_eq!(found, expected, "tick {tick}");
        n_touching.push(found.len());
    }
    assert!(n_touching[0] == 0 && n_touching[39] > 3, "{n_touching:?}");
}

#[test]
fn what_was_proven_is_not_looked_at_again_where_nothing_moves() {
    let mut fixture = Fixture::new();
    let first = fixture.find(above(6e-3), Budget::Unlimited);
    let second = fixture.find(above(6e-3), Budget::Unlimited);
    assert!(4 * second.looked_at < 3 * first.looked_at, "{second:?} after {first:?}");
}

#[test]
fn eight_spheres_count_one_where_all_is_known_of_them() {
    // All of it touches, or it is far away and nothing but its root is looked at.
    for (mut fixture, pose, all_open) in
        [(Fixture::in_a_block(), Pose::IDENTITY, true), (Fixture::new(), above(0.05), false)]
    {
        let n_blocks = if all_open { fixture.walk.clear_until_cells.len() } else { 1 };
        let n_leaves = if all_open { fixture.shell.positions().len() } else { 0 };
        for n_each in [CHILDREN, 1, 1] {
            let found = fixture.find(pose, Budget::Unlimited);
            assert_eq!(found.looked_at as usize, n_each * n_blocks + n_leaves * LANES);
        }
    }
}

#[test]
fn a_walk_says_no_more_is_clear_than_is_clear_while_the_tool_comes_nearer() {
    let mut fixture = Fixture::new();
    let mut n_left_out = 0;
    let start = above(0.02);
    // A quarter of a voxel down in each tick, and turned by about as much at its ends.
    for tick in (0..70).map(f64::from) {
        let turn = DQuat::from_rotation_y(0.02 * tick);
        let pose = Pose::new(turn * start.rotation, start.translation - DVec3::Z * 2.5e-4 * tick);
        let found = fixture.find(pose, Budget::Unlimited);
        let Fixture { field, shell, .. } = &fixture;
        let highest_m = flat::blocks(field, FieldKind::Trilinear, shell, pose, |_| ());
        if highest_m > 0.0 {
            assert_eq!(found.max_value_m, highest_m, "tick {tick}");
        } else {
            assert!(found.max_value_m >= highest_m, "tick {tick}: {found:?} for {highest_m}");
        }
        n_left_out += u32::from(highest_m < 0.0 && found.looked_at < shell.len() as u32);
    }
    assert!((20..70).contains(&n_left_out), "{n_left_out}");
}

#[test]
fn what_a_limited_walk_looks_at_and_what_it_leaves_out_are_all_points() {
    let mut fixture = Fixture::in_a_block();
    for n_points in [0, 1, 20, 100, 300, 1000, 3000] {
        // All spheres are looked at anew.
        fixture.walk.forget();
        let found = fixture.find(Pose::IDENTITY, Budget::Points(n_points));
        let n_touching: u32 =
            fixture.touched.iter().map(|touched| touched.lanes.count_ones()).sum();
        assert_eq!(n_touching + found.left_out, fixture.shell.len() as u32, "{n_points}");
        let is_known = |block: &&[f32; CHILDREN]| **block != [UNKNOWN; CHILDREN];
        let n_opened = fixture.walk.clear_until_cells.iter().filter(is_known).count();
        assert_eq!(found.looked_at, (CHILDREN * n_opened) as u32 + n_touching, "{n_points}");
        assert!(found.looked_at <= n_points, "{n_points}: {found:?}");
    }
}

#[test]
fn points_whose_own_surface_is_not_a_square_voxel_stand_for_all_below_them_too() {
    let mut fixture = Fixture::in_a_block();
    let weight_of =
        |point: u32| fixture.shell.weights()[point as usize / LANES].0[point as usize % LANES];
    // The few that stand for all have more and less than that.
    let tops = fixture.shell.tree().representatives(2).as_flattened();
    let is_other = |point: &&u32| (weight_of(**point) - 1.0).abs() > 0.1;
    assert!(2 * tops.iter().filter(is_other).count() > tops.len());
    let whole: f32 = fixture.shell.weights().iter().flat_map(|Lanes(weights)| weights).sum();
    for n_points in [20, 100, 300, 1000] {
        fixture.find(Pose::IDENTITY, Budget::Points(n_points));
        let felt = fixture.touched.iter().map(|touched| {
            let of = fixture.shell.weights()[touched.block as usize];
            touched.weight * touched.lanes().map(|lane| of.0[lane]).sum::<f32>()
        });
        let felt: f32 = felt.sum();
        assert!((felt - whole).abs() < 1e-3 * whole, "{n_points}: {felt} of {whole}");
    }
}

#[test]
fn a_budget_that_refining_did_not_use_up_refines_more() {
    let mut fixture = Fixture::new();
    let level = fixture.n_levels() - 1;
    let pose = above(0.05);
    let Fixture { field, shell, walk, lists, .. } = &mut fixture;
    let n_open = shell.tree().n_nodes(level - 1) as u32;
    lists.open.clear();
    lists.open.extend(0..n_open);
    let place = Place::new(field, pose);
    let mut query = Query {
        simd_level: SimdLevel::Portable,
        shell,
        place: &place,
        spheres: &[],
        ways: walk.motion.ways(),
        margin_cells: walk.margin_cells(&place),
        clear_cells: PROOF_CELLS,
        max_m: f32::NEG_INFINITY,
        looked_at: 0,
        left_out: 0,
        passes_points: false,
        is_limited: true,
        per_voxel: 1.0 / VOXEL_M as f32,
        limit_m: walk.limit_m,
        slack_m: walk.slack_m,
    };
    // In the worst case each node takes fifteen beyond its own, so at first (10 n - n) / 15 of them
    // are refined. Far away all children are clear: each has taken eight, and opens none.
    walk.refine(level, Budget::Points(10 * n_open), &mut query, lists);
    assert_eq!((lists.open.len(), lists.next.len()), (0, 0));
    assert_eq!(query.looked_at, CHILDREN as u32 * n_open);
}

#[test]
fn of_leaves_that_do_not_touch_every_point_has_its_turn_within_sixteen_ticks() {
    let mut fixture = Fixture::in_a_block();
    // For all spheres, and for two or four points of each leaf.
    let n_blocks = fixture.walk.clear_until_cells.len();
    let n_leaves = fixture.shell.positions().len();
    let budget = Budget::Points((2 * CHILDREN * n_blocks + 2 * n_leaves) as u32);
    let mut seen: Vec<u16> = core::iter::repeat_n(0, n_leaves).collect();
    for tick in 0..LANES {
        // As if nothing had touched in the last tick.
        fixture.walk.touched_at.fill([0; CHILDREN]);
        let found = fixture.find(Pose::IDENTITY, budget);
        assert!(found.left_out > 2 * fixture.shell.len() as u32 / 3, "tick {tick}: {found:?}");
        fixture.touched.iter().for_each(|touched| seen[touched.block as usize] |= touched.lanes);
    }
    for (leaf, (lanes, positions)) in seen.iter().zip(fixture.shell.positions()).enumerate() {
        let is_point = |lane: &usize| !positions.get(*lane).is_nan();
        let points = (0..LANES).filter(is_point).fold(0, |points, lane| points | 1 << lane);
        assert_eq!(*lanes, points, "leaf {leaf}");
    }
}

/// Whatever the order of the leaves, of which the last is filled in part.
#[test]
fn a_leaf_of_which_some_points_touch_is_noted_once() {
    let (mesh, mut map) = block(DVec3::splat(0.06), VOXEL_M);
    let field = map.field(&mesh, false);
    for voxel_size_m in [8.1e-4, 8.2e-4, 8.5e-4] {
        let (mesh, map) = block(DVec3::new(0.02, 0.014, 0.01), voxel_size_m);
        let shell = pointshell::build(&mesh, &map, DVec3::ZERO).0;
        assert!(!shell.len().is_multiple_of(LANES), "{}", shell.len());
        let mut fixture = Fixture::of(field.clone(), 0.0, shell);
        let n_blocks = fixture.walk.clear_until_cells.len();
        let n_leaves = fixture.shell.positions().len();
        // For all spheres, and for half of the points of each leaf.
        let budget = Budget::Points((CHILDREN * n_blocks + LANES / 2 * n_leaves) as u32);
        for tick in 0..LANES {
            let pose = above(-4e-3 - 1e-4 * tick as f64);
            let found = fixture.find(pose, budget);
            assert!(found.left_out > 0, "{found:?}");
            let mut leaves: Vec<u32> =
                fixture.touched.iter().map(|touched| touched.block).collect();
            leaves.sort_unstable();
            // Each of them touches.
            assert!(leaves.into_iter().eq(0..n_leaves as u32), "tick {tick}: {found:?}");
        }
    }
}

#[test]
fn lanes_that_stand_for_all_are_as_many_as_asked_and_around_the_middle_of_four_rows() {
    assert_eq!(spread_lanes(1).len(), 1);
    for (n, turn) in [2, 4, 8].into_iter().flat_map(|n| (0..LANES).map(move |turn| (n, turn))) {
        let mut lanes: Vec<usize> = spread_lanes(n as u32).iter().map(|lane| lane ^ turn).collect();
        // The middle of 0, 1, 2, 3 is one and a half.
        assert_eq!(2 * lanes.iter().map(|lane| lane % 4).sum::<usize>(), 3 * n);
        assert_eq!(2 * lanes.iter().map(|lane| lane / 4).sum::<usize>(), 3 * n);
        lanes.sort_unstable();
        lanes.dedup();
        assert!(lanes.len() == n && lanes.iter().all(|lane| *lane < LANES), "{lanes:?}");
    }
}

#[test]
fn what_is_proven_holds_as_long_after_a_long_way_as_at_the_start() {
    let way = Motion { along_cells: 300.0, about_rad: 20.0, ..Motion::default() };
    let looked_at = |motion: Motion| {
        let mut fixture = Fixture::new();
        fixture.walk.motion = motion;
        [(); 3].map(|()| fixture.find(above(2e-3), Budget::Unlimited).looked_at)
    };
    let at_start = looked_at(Motion::default());
    assert_eq!(looked_at(way), at_start);
    assert!(at_start[1] < at_start[0], "{at_start:?}");
}

#[test]
fn a_budget_that_suffices_finds_what_a_walk_without_one_finds() {
    let mut limited = Fixture::new();
    let mut unlimited = Fixture::new();
    // In the first tick nothing is known to touch.
    for tick in 0..2 {
        let found = limited.find(above(0.0), Budget::Points(1_000_000));
        assert_eq!(found, unlimited.find(above(0.0), Budget::Unlimited), "tick {tick}");
        limited.touched.sort_by_key(|touched| touched.block);
        assert_eq!(limited.touched, unlimited.touched, "tick {tick}");
    }
}

#[test]
fn a_budget_is_kept_and_used_up_where_some_leaves_touch_and_others_do_not() {
    for n_points in [1000, 1500, 2000, 3000] {
        let mut fixture = Fixture::new();
        for tick in 0..3 {
            let found = fixture.find(above(0.0), Budget::Points(n_points));
            assert!(found.left_out > 0 && !fixture.touched.is_empty(), "{found:?}");
            // Twice as many points of one leaf more would take more than is left, or a leaf that is
            // not full has taken less.
            let left = n_points.checked_sub(found.looked_at).expect("no more than the budget");
            assert!(left < 2 * LANES as u32, "{left} of {n_points} in tick {tick}: {found:?}");
        }
    }
}

#[test]
fn far_away_a_walk_gives_what_the_field_has_outside() {
    let mut fixture = Fixture::new();
    for budget in [Budget::Unlimited, Budget::Unlimited, Budget::Points(100)] {
        let found = fixture.find(above(0.05), budget);
        assert_eq!(found.max_value_m, fixture.field.outside_m());
        assert_eq!((fixture.touched.len(), found.left_out), (0, 0));
    }
}
