//! The library as another program embeds it: what the root of the crate exports.
#![expect(unsafe_code, reason = "the trait of a global allocator is unsafe")]

#[path = "../../examples/motion.rs"]
mod motion;
#[path = "../../examples/query.rs"]
mod query;
#[path = "../../examples/slide.rs"]
mod slide;
#[path = "../../examples/two_parts.rs"]
mod two_parts;
#[path = "../../examples/voxmap.rs"]
mod voxmap;

mod both_ways;
mod errors;
mod interface;
mod laws;
mod refusals;

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::ops::ControlFlow;

use glam::DMat3;
use vps::contact::{ContactSum, ForceLaw, Obstacle};
use vps::{
    BakeStage, ContactQuery, DQuat, DVec3, Error, Mesh, Options, PointShell, Pose, Shape, Voxmap,
};

/// Counts what each thread allocates.
struct CountingAllocator;

thread_local! {
    // Constant and without a destructor: reading it allocates nothing.
    static ALLOCATIONS: Cell<u64> = const { Cell::new(0) };
}

// SAFETY: hands everything to the system's allocator.
unsafe impl GlobalAlloc for CountingAllocator {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.set(ALLOCATIONS.get() + 1);
        // SAFETY: as the caller promises.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        ALLOCATIONS.set(ALLOCATIONS.get() + 1);
        // SAFETY: as the caller promises.
        unsafe { System.dealloc(memory, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

fn block() -> Mesh {
    Mesh::from_shape(&Shape::Box { size_m: DVec3::splat(40e-3) }, 1e-5).unwrap()
}

fn ball() -> Mesh {
    Mesh::from_shape(&Shape::Sphere { radius_m: 10e-3 }, 1e-5).unwrap()
}

fn ball_on_block() -> ContactQuery {
    let options = Options::new(0.5e-3);
    let block = Voxmap::bake(&block(), &options).unwrap();
    let ball = PointShell::bake(&ball(), &options).unwrap();
    ContactQuery::new(&block, &ball, 1000.0).unwrap()
}

/// Poses around the block: touching, near and far.
fn poses(n: usize) -> Vec<Pose> {
    let pose = |k: usize| {
        let t = k as f64;
        let direction =
            DVec3::new((1.3 * t).sin(), (2.1 * t).cos(), (0.7 * t).sin()).normalize_or(DVec3::X);
        Pose::new(
            DQuat::from_scaled_axis(direction * t),
            direction * (0.032 + 0.014 * (0.37 * t).sin()),
        )
    };
    (0..n).map(pose).collect()
}

#[test]
fn examples_run() {
    query::main().unwrap();
    two_parts::main().unwrap();
    motion::main().unwrap();
    slide::main().unwrap();
    voxmap::main().unwrap();
}

#[test]
fn a_ball_in_a_block_is_pushed_out_as_an_elastic_foundation_says() {
    // The force of a foundation of K / s² under a sphere of radius r at depth d: K/s² · π r d² (1 −
    // d / 3r), and no torque.
    let query = ball_on_block();
    let depth_m = 2e-3_f64;
    let radius_m = 10e-3_f64;
    let felt = query.wrench(Pose::from_translation(DVec3::Z * (30e-3 - depth_m))).unwrap();
    let expected_n = 1000.0 / 0.5e-3_f64.powi(2)
        * std::f64::consts::PI
        * depth_m.powi(2)
        * (radius_m - depth_m / 3.0);
    assert!(
        (0.99..1.01).contains(&(felt.wrench.force.z / expected_n)),
        "{} N of {expected_n} N",
        felt.wrench.force.z
    );
    assert!(felt.wrench.force.truncate().length() < 0.01 * expected_n, "{felt:?}");
    assert!(felt.wrench.torque.length() < 0.01 * expected_n * radius_m, "{felt:?}");
    assert!((felt.penetration_m - depth_m).abs() < 0.1e-3 && felt.clearance_m == 0.0, "{felt:?}");
    // Free of the block, by a millimetre and by more than the band.
    let free = query.wrench(Pose::from_translation(DVec3::Z * 31e-3)).unwrap();
    assert!(
        free.contacts == 0 && free.penetration_m == 0.0 && (free.clearance_m - 1e-3).abs() < 0.1e-3,
        "{free:?}"
    );
    let far = query.wrench(Pose::from_translation(DVec3::Z * 0.5)).unwrap();
    assert_eq!((far.contacts, far.clearance_m), (0, f64::from(7.5_f32 * 0.5e-3_f32)));
}

#[test]
fn a_query_is_the_specification_bit_for_bit_and_its_contacts_add_up() {
    let options = Options::new(0.5e-3);
    let block = Voxmap::bake(&block(), &options).unwrap();
    let cube = Mesh::from_shape(&Shape::Box { size_m: DVec3::splat(15e-3) }, 1e-5).unwrap();
    for tool in [&ball(), &cube] {
        its_contacts_add_up(&block, &PointShell::bake(tool, &options).unwrap());
    }
}

fn its_contacts_add_up(block: &Voxmap, tool: &PointShell) {
    let query = ContactQuery::new(block, tool, 1000.0).unwrap();
    let obstacles = [Obstacle { field: block.field().clone(), world_from_map: Pose::IDENTITY }];
    let mut touching = 0;
    for pose in poses(600) {
        let body = pose * Pose::from_translation(tool.mass_properties().center_m);
        let sum = ContactSum::flat(&obstacles, tool.shell(), body, ForceLaw::PLAIN);
        let mut force_n = DVec3::ZERO;
        let mut torque_nm = DVec3::ZERO;
        let mut deepest_m = 0.0_f64;
        let mut n = 0;
        let felt = query
            .contacts(pose, |contact| {
                assert!(
                    (contact.normal.length() - 1.0).abs() < 1e-5 && contact.depth_m > 0.0,
                    "{contact:?}"
                );
                deepest_m = deepest_m.max(contact.depth_m);
                force_n += contact.force_n;
                torque_nm += (contact.position_m - pose.translation).cross(contact.force_n);
                n += 1;
            })
            .unwrap();
        assert_eq!(felt, query.wrench(pose).unwrap());
        assert_eq!(felt.wrench, sum.wrench.moved(body.translation, pose.translation));
        assert_eq!((felt.contacts, felt.penetration_m), (sum.contacts, sum.max_value_m.max(0.0)));
        if n > 0 {
            assert_eq!(felt.penetration_m, deepest_m, "{felt:?}");
        }
        let clearance_m = if sum.contacts > 0 { 0.0 } else { -sum.max_value_m };
        assert_eq!(felt.clearance_m, clearance_m, "{felt:?}");
        assert_eq!(n, felt.contacts);
        let size_n = felt.wrench.force.length();
        assert!(
            (force_n - felt.wrench.force).length() <= 1e-5 * size_n + 1e-9,
            "{force_n} and {felt:?}"
        );
        assert!(
            (torque_nm - felt.wrench.torque).length() <= 1e-6 * size_n + 1e-9,
            "{torque_nm} and {felt:?}"
        );
        touching += u32::from(n > 0);
    }
    assert!((60..540).contains(&touching), "{touching} of 600 poses touch");
}

/// A block, a plate of two voxels beside it, and a ball, each somewhere in the world.
fn three_parts() -> Vec<(Voxmap, Pose)> {
    let plate = Mesh::from_shape(&Shape::Box { size_m: DVec3::new(40e-3, 40e-3, 1e-3) }, 1e-5);
    let meshes = [block(), plate.unwrap(), ball()];
    let places = [
        Pose::IDENTITY,
        Pose::new(DQuat::from_rotation_y(0.8), DVec3::new(35e-3, 2e-3, 5e-3)),
        Pose::new(DQuat::from_rotation_x(2.0), DVec3::new(-5e-3, 3e-3, 32e-3)),
    ];
    let bake = |(mesh, pose)| (Voxmap::bake(&mesh, &Options::new(0.5e-3)).unwrap(), pose);
    meshes.into_iter().zip(places).map(bake).collect()
}

fn cube() -> PointShell {
    cube_of(0.5e-3)
}

fn cube_of(voxel_size_m: f64) -> PointShell {
    let cube = Mesh::from_shape(&Shape::Box { size_m: DVec3::splat(15e-3) }, 1e-5).unwrap();
    PointShell::bake(&cube, &Options::new(voxel_size_m)).unwrap()
}

#[test]
fn several_parts_press_as_each_of_them_does() {
    let (parts, cube) = (three_parts(), cube());
    let all: Vec<(&Voxmap, Pose)> = parts.iter().map(|(map, pose)| (map, *pose)).collect();
    let query = ContactQuery::of_parts(&all, &cube, 1000.0).unwrap();
    let alone: Vec<ContactQuery> =
        parts.iter().map(|(map, _)| ContactQuery::new(map, &cube, 1000.0).unwrap()).collect();
    let mut touched = [0; 3];
    for pose in poses(300) {
        let (mut force, mut torque) = (DVec3::ZERO, DVec3::ZERO);
        let (mut contacts, mut penetration_m, mut clearance_m) = (0, 0.0_f64, f64::INFINITY);
        for ((query, (_, world_from_map)), n) in alone.iter().zip(&parts).zip(&mut touched) {
            let felt = query.wrench(world_from_map.inverse() * pose).unwrap();
            force += world_from_map.transform_vector(felt.wrench.force);
            torque += world_from_map.transform_vector(felt.wrench.torque);
            contacts += felt.contacts;
            *n += u32::from(felt.contacts > 0);
            penetration_m = penetration_m.max(felt.penetration_m);
            clearance_m = clearance_m.min(felt.clearance_m);
        }
        let felt = query.wrench(pose).unwrap();
        let size_n = force.length() + 1e-3;
        assert!(
            felt.contacts == contacts
                && (felt.wrench.force - force).length() < 1e-4 * size_n
                && (felt.wrench.torque - torque).length() < 1e-5 * size_n
                && (felt.penetration_m - penetration_m).abs() < 1e-7
                && (felt.clearance_m - clearance_m).abs() < 1e-7,
            "{felt:?} and {force}, {torque}, {contacts}, {penetration_m}, {clearance_m}"
        );
        let mut of_parts = [0_u32; 3];
        query.contacts(pose, |contact| of_parts[contact.part as usize] += 1).unwrap();
        assert_eq!(of_parts.iter().sum::<u32>(), contacts);
    }
    assert!(touched.iter().all(|n| *n > 10), "{touched:?}");
    let nothing = ContactQuery::of_parts(&[], &cube, 1000.0).unwrap_err().to_string();
    assert_eq!(nothing, "the number of voxmaps is 0: give 1 to 1e6");
}

#[test]
fn the_nearest_point_is_as_far_as_the_clearance_says_and_lies_over_the_surface() {
    let (parts, cube) = (three_parts(), cube());
    let all: Vec<(&Voxmap, Pose)> = parts.iter().map(|(map, pose)| (map, *pose)).collect();
    let query = ContactQuery::of_parts(&all, &cube, 1000.0).unwrap();
    let mut found = [0; 3];
    for pose in poses(1500) {
        let felt = query.wrench(pose).unwrap();
        let Some(nearest) = query.nearest(pose).unwrap() else {
            assert!(
                felt.contacts > 0 || felt.clearance_m > parts[0].0.band_m() - 0.5e-3,
                "{felt:?}"
            );
            continue;
        };
        assert_eq!((felt.contacts, felt.clearance_m), (0, nearest.distance_m));
        let positions = cube.shell().positions();
        let point = positions[nearest.point as usize / 16].get(nearest.point as usize % 16);
        let body = pose * Pose::from_translation(cube.mass_properties().center_m);
        assert_eq!(body.transform_point(point.as_dvec3()), nearest.on_shell_m);
        let way_m = nearest.on_shell_m.distance(nearest.on_part_m);
        // Interpolation bends directions near edges.
        assert!((way_m - nearest.distance_m).abs() < 0.1 * 0.5e-3, "{nearest:?}");
        let (map, world_from_map) = &parts[nearest.part as usize];
        let on_map = world_from_map.inverse().transform_point(nearest.on_part_m);
        let off_m = map.distance(on_map).unwrap().distance_m;
        assert!(off_m.abs() < 1e-5, "{off_m} m: {nearest:?}");
        found[nearest.part as usize] += 1;
    }
    assert!(found.iter().all(|n| *n > 5), "{found:?}");
}

#[test]
fn patches_say_where_and_how_hard_what_presses_and_add_up() {
    let block = Voxmap::bake(&block(), &Options::new(0.5e-3)).unwrap();
    let query = ContactQuery::new(&block, &cube(), 1000.0).unwrap();
    let depth_m = 0.2e-3;
    let middle = DVec3::new(1e-3, -2e-3, 20e-3 - depth_m);
    let patches = query.patches(Pose::from_translation(middle + DVec3::Z * 7.5e-3)).unwrap();
    let [patch] = patches[..] else { panic!("{patches:?}") };
    let force_n = 1000.0 * (15.0 / 0.5_f64).powi(2) * depth_m;
    assert!(
        (patch.normal - DVec3::Z).length() < 1e-3
            && (patch.force_n - DVec3::Z * force_n).length() < 1e-2 * force_n
            && (patch.position_m - middle).length() < 0.05e-3
            // Facets of the sides are immersed in part.
            && (1.0..1.1).contains(&(patch.area_m2 / 15e-3_f64.powi(2)))
            && (patch.depth_m - depth_m).abs() < 1e-6,
        "{patch:?}"
    );
    let parts = three_parts();
    let all: Vec<(&Voxmap, Pose)> = parts.iter().map(|(map, pose)| (map, *pose)).collect();
    let query = ContactQuery::of_parts(&all, &cube(), 1000.0).unwrap();
    let mut touching = 0;
    for pose in poses(200) {
        let felt = query.wrench(pose).unwrap();
        let patches = query.patches(pose).unwrap();
        let sum: DVec3 = patches.iter().map(|patch| patch.force_n).sum();
        let size_n = felt.wrench.force.length();
        assert!((sum - felt.wrench.force).length() <= 1e-4 * size_n + 1e-9, "{sum} and {felt:?}");
        let (mut n, mut n_probes) = (0, 0);
        query
            .contacts(pose, |contact| {
                n += u32::from(contact.area_m2 > 0.0);
                n_probes += u32::from(contact.area_m2 == 0.0);
            })
            .unwrap();
        assert_eq!(patches.iter().map(|patch| patch.contacts).sum::<u32>(), n);
        assert_eq!(n + n_probes, felt.contacts);
        assert!(patches.iter().all(|patch| (patch.normal.length() - 1.0).abs() < 1e-9));
        touching += u32::from(patches.len() > 1);
    }
    assert!(touching > 20, "{touching}");
}

#[test]
fn a_motion_is_stopped_where_it_first_touches_however_thin_the_part() {
    // Facets as wide as the voxels of the parts, and much finer ones.
    for voxel_size_m in [0.5e-3, 0.15e-3] {
        motions_are_stopped(&cube_of(voxel_size_m));
    }
}

fn motions_are_stopped(cube: &PointShell) {
    let parts = three_parts();
    let all: Vec<(&Voxmap, Pose)> = parts.iter().map(|(map, pose)| (map, *pose)).collect();
    let query = ContactQuery::of_parts(&all, cube, 1000.0).unwrap();
    let tolerance_m = 1e-5;
    let (mut hits, mut misses) = (0, 0);
    let ends = poses(120);
    for (from, to) in ends.iter().zip(ends.iter().skip(1)) {
        // From outside, and often through and out again.
        let from = Pose { translation: from.translation * 2.0, ..*from };
        let to = Pose { translation: to.translation * -1.5, ..*to };
        let found = query.first_contact(from, to, tolerance_m).unwrap();
        let [begin, end] =
            [from, to].map(|pose| pose * Pose::from_translation(cube.mass_properties().center_m));
        let at = |share: f64| {
            let body = Pose::new(
                begin.rotation.slerp(end.rotation, share),
                begin.translation.lerp(end.translation, share),
            );
            body * Pose::from_translation(-cube.mass_properties().center_m)
        };
        let touches = |share: f64| query.wrench(at(share)).unwrap().contacts > 0;
        let until = found.map_or(1.0, |impact| impact.share);
        if let Some(impact) = found {
            hits += 1;
            assert!(query.wrench(impact.pose).unwrap().contacts > 0, "{impact:?}");
            let off = (at(impact.share).translation - impact.pose.translation).length();
            assert!(off < 1e-12, "{off}");
        } else {
            misses += 1;
        }
        // Points go no farther than this in the whole motion.
        let way_m = begin.translation.distance(end.translation)
            + begin.rotation.angle_between(end.rotation) * 14e-3;
        let before = until - tolerance_m / way_m;
        let first = (0..1000).map(|k| before * f64::from(k) / 1000.0).find(|share| touches(*share));
        assert!(before <= 0.0 || first.is_none(), "{first:?} and {found:?}");
    }
    assert!(hits > 50 && misses > 0, "{hits} and {misses}");
    let wrong = query.first_contact(ends[0], ends[1], 0.0).unwrap_err().to_string();
    assert_eq!(wrong, "tolerance_m is 0: give metres, greater than 1e-12");
}

#[test]
fn depths_change_against_the_gradient_of_the_distance_whatever_the_normal() {
    let options = Options::new(0.5e-3);
    let block = Voxmap::bake(&block(), &options).unwrap();
    let ball = PointShell::bake(&ball(), &options).unwrap();
    let query = ContactQuery::new(&block, &ball, 1000.0).unwrap();
    let found = |pose: Pose| {
        let mut contacts = Vec::new();
        query.contacts(pose, |contact| contacts.push(*contact)).unwrap();
        contacts
    };
    let (mut n, mut n_aside, mut n_less, mut n_other) = (0, 0, 0, 0);
    for pose in poses(200) {
        // As random as the poses.
        let way = pose.rotation * (DVec3::X * 1e-6);
        let moved = found(Pose { translation: pose.translation + way, ..pose });
        for contact in found(pose) {
            // Beyond the band all is as deep.
            if contact.depth_m > 0.99 * block.band_m() {
                continue;
            }
            assert!((contact.gradient.length() - 1.0).abs() < 1e-5, "{contact:?}");
            let Some(then) = moved.iter().find(|then| then.point == contact.point) else {
                continue;
            };
            let deeper_m = then.depth_m - contact.depth_m;
            n += 1;
            n_aside += u32::from(contact.gradient.dot(contact.normal) < 0.9);
            // Facets whose middle is outside get deeper in the mean by the share that is inside.
            let wholly_m = -way.dot(contact.gradient);
            n_less += u32::from((deeper_m - wholly_m).abs() > 0.1e-6);
            let between = wholly_m.min(0.0) - 0.1e-6..wholly_m.max(0.0) + 0.1e-6;
            n_other += u32::from(!between.contains(&deeper_m));
        }
    }
    // Near edges of the block the field has a fold within a cell, and its slope is less than 1.
    assert!(
        n > 1000 && 10 * n_aside > n && 10 * n_less < n && 20 * n_other < n,
        "{n_other}, {n_less}, {n_aside} of {n}"
    );
}

/// Wrenches by which a small motion to either side of a pose differs, for each of six motions:
/// translations, and turns about the origin of the shell's mesh frame; minus, and by the motion.
fn differences(query: &ContactQuery, pose: Pose) -> [[f64; 6]; 6] {
    let (way_m, turn) = (1e-6, 1e-4);
    let differs = |step: f64, moved: &dyn Fn(f64) -> Pose| {
        let [after, before] = [1.0, -1.0].map(|sign| query.wrench(moved(sign)).unwrap().wrench);
        let force = (before.force - after.force) / (2.0 * step);
        let torque = (before.torque - after.torque) / (2.0 * step);
        [force.x, force.y, force.z, torque.x, torque.y, torque.z]
    };
    let [a, b, c] = DVec3::AXES.map(|axis| {
        let moved =
            |sign: f64| Pose { translation: pose.translation + axis * (sign * way_m), ..pose };
        differs(way_m, &moved)
    });
    let [d, e, f] = DVec3::AXES.map(|axis| {
        let moved = |sign: f64| Pose {
            rotation: DQuat::from_axis_angle(axis, sign * turn) * pose.rotation,
            ..pose
        };
        differs(turn, &moved)
    });
    [a, b, c, d, e, f]
}

/// A cube with a hollow in it.
fn socket(radius_m: f64) -> Mesh {
    let cube = Shape::Box { size_m: DVec3::splat(4.0 * radius_m) };
    let (cube, hollow) = (
        Mesh::from_shape(&cube, 1e-5).unwrap(),
        Mesh::from_shape(&Shape::Sphere { radius_m }, 5e-6).unwrap(),
    );
    let vertices = |mesh: &Mesh| mesh.vertices().iter().map(|v| v.to_array()).collect::<Vec<_>>();
    let first = cube.vertices().len() as u32;
    let inward = hollow.triangles().iter().map(|[a, b, c]| [a + first, c + first, b + first]);
    let triangles: Vec<_> = cube.triangles().iter().copied().chain(inward).collect();
    Mesh::from_arrays(&[vertices(&cube), vertices(&hollow)].concat(), &triangles).unwrap()
}

/// Force of a foundation of 1 N/m³ over the ball of radius `tool_m` whose centre is `apart_m` from
/// that of a ball of radius `obstacle_m`, along the line between them, by quadrature.
fn foundation_of_balls_n(tool_m: f64, obstacle_m: f64, apart_m: f64) -> f64 {
    const STEPS: usize = 100_000;
    let step = core::f64::consts::FRAC_PI_2 / STEPS as f64;
    (0..STEPS)
        .map(|k| {
            let (sin, cos) = ((k as f64 + 0.5) * step).sin_cos();
            let depth_m = obstacle_m - (apart_m - tool_m * cos).hypot(tool_m * sin);
            depth_m.max(0.0) * cos * sin * core::f64::consts::TAU * tool_m * tool_m * step
        })
        .sum()
}

/// Interpolation between exact samples feels a convex part smaller than it is.
#[test]
fn a_curved_part_pushes_with_the_force_of_the_law_however_shallow() {
    const VOXEL_M: f64 = 1e-3;
    for (tool_voxels, obstacle_voxels, most_of) in
        [(10.0, 20.0, [0.002, 0.003, 0.005]), (10.0, 8.0, [0.005, 0.01, 0.02])]
    {
        let sphere = |voxels: f64| {
            Mesh::from_shape(&Shape::Sphere { radius_m: voxels * VOXEL_M }, 1e-6).unwrap()
        };
        let obstacle = Voxmap::bake(&sphere(obstacle_voxels), &Options::new(VOXEL_M)).unwrap();
        let tool = PointShell::bake(&sphere(tool_voxels), &Options::new(0.5 * VOXEL_M)).unwrap();
        let query = ContactQuery::new(&obstacle, &tool, 1000.0).unwrap();
        for (depth_voxels, most) in [1.0, 0.5, 0.25].into_iter().zip(most_of) {
            let apart_m = (tool_voxels + obstacle_voxels - depth_voxels) * VOXEL_M;
            let law_n = 1000.0 / (0.5 * VOXEL_M).powi(2)
                * foundation_of_balls_n(tool_voxels * VOXEL_M, obstacle_voxels * VOXEL_M, apart_m);
            let ratios: Vec<f64> = poses(60)
                .into_iter()
                .map(|pose| {
                    let pose = Pose::new(pose.rotation, pose.translation.normalize() * apart_m);
                    query.wrench(pose).unwrap().wrench.force.length() / law_n
                })
                .collect();
            let squares: f64 = ratios.iter().map(|ratio| (ratio - 1.0).powi(2)).sum();
            let off = (squares / ratios.len() as f64).sqrt();
            assert!(off < most, "{tool_voxels} on {obstacle_voxels}, {depth_voxels} deep: {off}");
        }
    }
}

/// What a facet counts changes with the gradient too, and by what is found at its ends, which the
/// stiffness leaves out: that is seen where two convex parts meet, within a few facets. Of crossed edges
/// a few facets are all that is immersed, and rectangles stand for what the tool's edge cuts off them.
#[test]
fn stiffness_is_the_derivative_of_the_wrench() {
    let shape = |shape: Shape| Mesh::from_shape(&shape, 5e-6).unwrap();
    let sphere = |radius_m| shape(Shape::Sphere { radius_m });
    let cylinder = |radius_m| shape(Shape::Cylinder { radius_m, height_m: 0.01 });
    let cube = || shape(Shape::Box { size_m: DVec3::splat(0.01) });
    let slab = || shape(Shape::Plane { x_m: 0.06, y_m: 0.06, thickness_m: 0.02 });
    let away = |z_m| DVec3::Z * z_m;
    // Across an edge of the slab, one of its own edges first.
    let out = DVec3::new(1.0, 0.0, 1.0).normalize();
    let across = DVec3::new(1.0, 0.0, -1.0).normalize();
    let side = (out + DVec3::Y).normalize();
    let turn = DQuat::from_mat3(&DMat3::from_cols(across, side, across.cross(side)));
    let corners = cube().vertices().iter().map(|at| (turn * *at).to_array()).collect::<Vec<_>>();
    let upright = Mesh::from_arrays(&corners, cube().triangles()).unwrap();
    let pairs = [
        ("cube on plane", slab(), cube(), away(4.9e-3), 0.03, (1e-3, 1e-3)),
        ("ball on plane", slab(), sphere(5e-3), away(4.8e-3), 3.0, (1e-3, 1.5e-3)),
        ("ball on ball", sphere(8e-3), sphere(5e-3), away(12.8e-3), 3.0, (4e-3, 1e-2)),
        ("ball in socket", socket(6e-3), sphere(5.9e-3), away(-0.3e-3), 3.0, (1e-3, 2e-3)),
        ("edges crossed", slab(), upright, DVec3::X * 0.03 + out * 6.9e-3, 0.3, (0.06, 0.15)),
        ("cylinders crossed", cylinder(4e-3), cylinder(3e-3), DVec3::Y * 6.8e-3, 0.5, (4e-3, 0.08)),
    ];
    for (name, obstacle, tool, from, tilt, (median, most_of)) in pairs {
        let options = Options::new(0.25e-3);
        let query = ContactQuery::new(
            &Voxmap::bake(&obstacle, &options).unwrap(),
            &PointShell::bake(&tool, &options).unwrap(),
            1000.0,
        )
        .unwrap();
        let mut offs = Vec::new();
        for k in 0..40_u32 {
            let t = f64::from(k);
            let direction = DVec3::new((1.3 * t).sin(), (2.1 * t).cos(), (0.7 * t).sin());
            let pose =
                Pose::new(DQuat::from_scaled_axis(direction * tilt), from + direction * 5e-5);
            let (rows, felt) = (query.stiffness(pose).unwrap(), query.wrench(pose).unwrap());
            if felt.contacts == 0 {
                assert_eq!(rows, [[0.0; 6]; 6]);
                continue;
            }
            let found = differences(&query, pose);
            // By the tool's length, so that all entries count alike.
            let scale = |k: usize| if k < 3 { 1.0 } else { 1.0 / 5e-3 };
            let (mut size, mut off) = (0.0_f64, 0.0_f64);
            for (row, (own, columns)) in rows.iter().zip(&found).enumerate() {
                for (column, (own, other)) in own.iter().zip(columns).enumerate() {
                    let transposed = found.get(column).and_then(|columns| columns.get(row));
                    let both = (other + transposed.unwrap()) / 2.0;
                    let expected = if row >= 3 && column >= 3 { both } else { *other };
                    let by = scale(row) * scale(column);
                    size = size.max(expected.abs() * by);
                    off = off.max((own - expected).abs() * by);
                }
            }
            offs.push(off / size);
        }
        offs.sort_by(f64::total_cmp);
        let at = |share: usize| offs[(offs.len() - 1) * share / 10];
        assert!(
            offs.len() > 30 && at(5) < median && at(9) < most_of,
            "{name}: off by {:.2e} in the median, {:.2e} at the 90th percentile of {}",
            at(5),
            at(9),
            offs.len()
        );
    }
}

/// Found with random input: a part that is smaller than a voxel has no cell inside, nothing touches
/// it, and the walk down the tree calls that far.
#[test]
fn a_clearance_is_a_distance_also_where_nothing_can_touch() {
    let options = Options { sides: vps::InsideTest::Winding, ..Options::new(15.26e-3) };
    let needle =
        Mesh::from_shape(&Shape::Cone { radius_m: 1e-3, height_m: 18.58e-3 }, 1e-4).unwrap();
    let voxmap = Voxmap::bake(&needle, &options).unwrap();
    let shell = PointShell::bake(&needle, &options).unwrap();
    assert!(voxmap.warnings()[0].contains("thinner than the voxels"), "{:?}", voxmap.warnings());
    let query = ContactQuery::new(&voxmap, &shell, 1e3).unwrap();
    let obstacles = [Obstacle { field: voxmap.field().clone(), world_from_map: Pose::IDENTITY }];
    for pose in [Pose::IDENTITY, Pose::from_translation(DVec3::X)].into_iter().chain(poses(20)) {
        let body = pose * Pose::from_translation(shell.mass_properties().center_m);
        let truth = ContactSum::flat(&obstacles, shell.shell(), body, ForceLaw::PLAIN);
        assert_eq!(query.wrench(pose).unwrap().clearance_m, -truth.max_value_m, "{pose:?}");
    }
}

/// On the border of the grid all sides are alike: what is farther than the band is at the band.
#[test]
fn a_clearance_beside_the_border_of_the_grid_is_that_of_the_band_on_all_sides() {
    let options = Options { layers: 10, ..Options::new(0.5e-3) };
    let voxmap = Voxmap::bake(&ball(), &options).unwrap();
    let bead = Mesh::from_shape(&Shape::Sphere { radius_m: 0.5e-3 }, 1e-5).unwrap();
    let bead = PointShell::bake(&bead, &Options::new(0.25e-3)).unwrap();
    let query = ContactQuery::new(&voxmap, &bead, 1e3).unwrap();
    // Eleven voxels and a half from the ball the grid ends, and distances are known up to 4.75 mm.
    for pose in poses(400) {
        for axis in 0..3 {
            for side in [-15.8e-3, 15.8e-3] {
                let mut at = pose.translation.clamp(DVec3::splat(-15e-3), DVec3::splat(15e-3));
                at[axis] = side;
                let clear = query.wrench(Pose::from_translation(at)).unwrap();
                assert_eq!((clear.contacts, clear.clearance_m), (0, voxmap.band_m()), "at {at}");
                let distance = voxmap.distance(at).unwrap();
                assert_eq!(distance.distance_m, voxmap.band_m(), "at {at}");
            }
        }
    }
}

#[test]
fn a_batch_gives_the_same_bits_on_any_number_of_threads_and_in_any_order() {
    let query = ball_on_block();
    let poses = poses(1000);
    let one_by_one: Vec<_> = poses.iter().map(|pose| query.wrench(*pose).unwrap()).collect();
    for n_threads in [1, 2, 5] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().unwrap();
        assert_eq!(
            pool.install(|| query.wrenches(&poses)).unwrap(),
            one_by_one,
            "{n_threads} threads"
        );
    }
    let backwards: Vec<Pose> = poses.iter().rev().copied().collect();
    assert!(query.wrenches(&backwards).unwrap().iter().rev().eq(&one_by_one));
    assert!(query.wrenches(&[]).unwrap().is_empty());
}

#[test]
fn a_query_allocates_nothing() {
    let query = ball_on_block();
    let poses = poses(100);
    let ask = |pose: &Pose| {
        let mut n = 0;
        query.contacts(*pose, |_| n += 1).unwrap();
        query.wrench(*pose).unwrap().contacts == n
    };
    let before = ALLOCATIONS.get();
    assert!(poses.iter().all(ask));
    assert_eq!(ALLOCATIONS.get(), before);
}

#[test]
fn threads_share_a_query() {
    let query = ball_on_block();
    let poses = poses(100);
    let alone = query.wrenches(&poses).unwrap();
    std::thread::scope(|scope| {
        let ask = || poses.iter().map(|pose| query.wrench(*pose).unwrap()).collect::<Vec<_>>();
        let threads: Vec<_> = (0..4).map(|_| scope.spawn(ask)).collect();
        threads.into_iter().for_each(|thread| assert_eq!(thread.join().unwrap(), alone));
    });
}

#[test]
fn distances_and_gradients_are_those_of_a_ball() {
    let ball = Voxmap::bake(&ball(), &Options::new(0.5e-3)).unwrap();
    for k in 0..200 {
        let direction = poses(200)[k].translation.normalize();
        let radius_m = 7e-3 + 6e-3 * k as f64 / 200.0;
        let found = ball.distance(direction * radius_m).unwrap();
        assert!((found.distance_m - (radius_m - 10e-3)).abs() < 0.05e-3, "{radius_m}: {found:?}");
        assert!((found.gradient - direction).length() < 0.1, "{direction}: {found:?}");
    }
    let far = ball.distance(DVec3::splat(1.0)).unwrap();
    assert_eq!((far.distance_m, far.gradient), (ball.band_m(), DVec3::ZERO));
}

#[test]
fn what_was_saved_is_loaded_bit_for_bit() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let options = Options::new(1e-3);
    // Without its last triangle, so that there is something to warn of.
    let whole = block();
    let vertices: Vec<[f64; 3]> = whole.vertices().iter().map(|vertex| vertex.to_array()).collect();
    let open = Mesh::from_arrays(&vertices, &whole.triangles()[1..]).unwrap();
    let block = Voxmap::bake(&open, &options).unwrap();
    let ball = PointShell::bake(&ball(), &options).unwrap();
    block.save(path("block")).unwrap();
    ball.save(path("ball")).unwrap();
    let block_again = Voxmap::load(path("block")).unwrap();
    let ball_again = PointShell::load(path("ball")).unwrap();
    assert!(!block.warnings().is_empty() && block.warnings() == block_again.warnings());
    assert_eq!(ball.mass_properties(), ball_again.mass_properties());
    let asked =
        |block, ball| ContactQuery::new(block, ball, 1e3).unwrap().wrenches(&poses(100)).unwrap();
    assert_eq!(asked(&block, &ball), asked(&block_again, &ball_again));
    assert!(
        (block.heap_bytes(), ball.heap_bytes())
            == (block_again.heap_bytes(), ball_again.heap_bytes())
    );
}

#[test]
fn a_bake_ends_where_its_callback_says_so() {
    let mesh = block();
    let options = Options::new(2e-3);
    let ends_at = |last: BakeStage| {
        let mut heard = Vec::new();
        let watch = |stage| {
            heard.push(stage);
            if stage == last { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        };
        let cancelled = match last {
            BakeStage::Pointshell | BakeStage::Report => {
                PointShell::bake_with(&mesh, &options, watch)
                    .is_err_and(|e| matches!(e, Error::Cancelled))
            }
            _ => Voxmap::bake_with(&mesh, &options, watch)
                .is_err_and(|e| matches!(e, Error::Cancelled)),
        };
        (cancelled, heard)
    };
    use BakeStage::{Distance, Field, Fill, Layers, Pointshell, Report, Surface};
    assert_eq!(ends_at(Surface), (true, vec![Surface]));
    assert_eq!(ends_at(Fill), (true, vec![Surface, Fill]));
    assert_eq!(ends_at(Layers), (true, vec![Surface, Fill, Layers]));
    assert_eq!(ends_at(Distance), (true, vec![Surface, Fill, Layers, Distance]));
    assert_eq!(ends_at(Field), (true, vec![Surface, Fill, Layers, Distance, Field]));
    assert_eq!(ends_at(Pointshell), (true, vec![Surface, Fill, Layers, Pointshell]));
    assert_eq!(ends_at(Report), (true, vec![Surface, Fill, Layers, Pointshell, Report]));
    for stages in [
        [Surface, Fill, Layers, Distance, Field, Report].as_slice(),
        &[Surface, Fill, Layers, Pointshell, Report],
    ] {
        assert!(stages.is_sorted_by(|a, b| a.share() < b.share()));
        assert!(stages.iter().all(|stage| (0.0..1.0).contains(&stage.share())));
    }
}
