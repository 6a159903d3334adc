//! Half of the energy of each part's points in the other one.

use vps::spatial::testing::Random;
use vps::{ContactQuery, DQuat, DVec3, Mesh, Options, PointShell, Pose, Shape, Voxmap};

use super::differences;

const STIFFNESS_N_PER_M: f64 = 1000.0;

struct Part {
    mesh: Mesh,
    voxmap: Voxmap,
    shell: PointShell,
}

impl Part {
    fn new(shape: &Shape, voxel_size_m: f64) -> Self {
        let mesh = Mesh::from_shape(shape, 2e-6).unwrap();
        let options = Options::new(voxel_size_m);
        let voxmap = Voxmap::bake(&mesh, &options).unwrap();
        let shell = PointShell::bake(&mesh, &options).unwrap();
        Self { mesh, voxmap, shell }
    }

    fn both(&self) -> (&Voxmap, &PointShell) {
        (&self.voxmap, &self.shell)
    }
}

fn block(size_mm: [f64; 3], voxel_size_m: f64) -> Part {
    Part::new(&Shape::Box { size_m: DVec3::from_array(size_mm) * 1e-3 }, voxel_size_m)
}

fn turn(random: &mut Random) -> DQuat {
    DQuat::from_xyzw(random.signed(), random.signed(), random.signed(), random.signed()).normalize()
}

/// The two blocks, each with voxels of its own, and a pose of the one at which it is so deep in the
/// other that stands at the origin, along some direction.
fn meet(random: &mut Random, fixed: &Part, moving: &Part, depth_m: f64) -> Pose {
    let rotation = turn(random);
    let vertices = moving.mesh.vertices().iter().map(|vertex| rotation * *vertex);
    // Some face, edge or corner of the fixed block.
    let (_, high) = fixed.mesh.bounds();
    let way = high * DVec3::new(random.signed(), random.signed(), random.signed()).round();
    let way = if way == DVec3::ZERO { DVec3::Z * high.z } else { way };
    let out = way.normalize();
    let lowest = vertices.min_by(|a, b| a.dot(out).total_cmp(&b.dot(out))).unwrap();
    let aside = out.any_orthonormal_vector() * (0.3e-3 * random.signed());
    Pose::new(rotation, way - lowest - out * depth_m + aside)
}

/// Force of the law with 1 N/m³ on a block of this half size, and moment about the origin of the
/// frame in which both blocks stand at a pose each, by sums over a grid on each of its faces.
fn law(tool: DVec3, place: Pose, obstacle: DVec3, obstacle_place: Pose) -> (DVec3, DVec3) {
    const STEPS: u32 = 500;
    let obstacle_from_tool = obstacle_place.inverse() * place;
    let mut force = DVec3::ZERO;
    let mut moment = DVec3::ZERO;
    for axis in 0..3 {
        let [along, across] = [DVec3::AXES[(axis + 1) % 3], DVec3::AXES[(axis + 2) % 3]];
        let [half_along, half_across] = [along.dot(tool), across.dot(tool)];
        let area = 4.0 * half_along * half_across / f64::from(STEPS * STEPS);
        for side in [-1.0, 1.0] {
            let normal = DVec3::AXES[axis] * side;
            for step in 0..STEPS * STEPS {
                let at = |step: u32| 2.0 * (f64::from(step) + 0.5) / f64::from(STEPS) - 1.0;
                let on_tool = normal * tool
                    + along * half_along * at(step / STEPS)
                    + across * half_across * at(step % STEPS);
                let depth_m =
                    (obstacle - obstacle_from_tool.transform_point(on_tool).abs()).min_element();
                if depth_m > 0.0 {
                    let own = place.transform_vector(-normal) * (depth_m * area);
                    force += own;
                    moment += place.transform_point(on_tool).cross(own);
                }
            }
        }
    }
    (force, moment)
}

#[test]
fn two_blocks_press_with_half_of_the_law_of_each_in_the_other() {
    let fixed = block([8.0, 7.0, 6.0], 0.3e-3);
    let moving = block([5.0, 6.0, 7.0], 0.2e-3);
    let query = ContactQuery::both_ways(fixed.both(), moving.both(), STIFFNESS_N_PER_M).unwrap();
    let [fixed_half, moving_half] = [&fixed, &moving].map(|part| part.mesh.bounds().1);
    let mut random = Random(21);
    let mut angles_deg = Vec::new();
    let mut sizes = Vec::new();
    let mut turns = Vec::new();
    for _ in 0..60 {
        let pose = meet(&mut random, &fixed, &moving, 0.4e-3);
        let (there, about) = law(moving_half, pose, fixed_half, Pose::IDENTITY);
        let (back, back_about) = law(fixed_half, Pose::IDENTITY, moving_half, pose);
        let per_volume = STIFFNESS_N_PER_M / 0.2e-3_f64.powi(2);
        let force = (there - back) * (0.5 * per_volume);
        let torque = (about - back_about) * (0.5 * per_volume) - pose.translation.cross(force);
        let felt = query.wrench(pose).unwrap();
        if force.length() < 0.05 {
            continue;
        }
        angles_deg.push(felt.wrench.force.angle_between(force).to_degrees());
        sizes.push((felt.wrench.force.length() / force.length() - 1.0).abs());
        let arm_m = moving_half.length();
        turns.push((felt.wrench.torque - torque).length() / (force.length() * arm_m));
    }
    for (name, mut errors, most) in
        [("angle", angles_deg, 1.0), ("size", sizes, 0.05), ("torque", turns, 0.02)]
    {
        errors.sort_by(f64::total_cmp);
        let p95 = errors[errors.len() * 95 / 100];
        assert!(
            errors.len() > 50 && p95 < most,
            "{name}: {p95} at the 95th percentile of {errors:?}"
        );
    }
}

/// Random parts and poses.
fn pairs() -> Vec<(Part, Part)> {
    let cone = Shape::Cone { radius_m: 4e-3, height_m: 8e-3 };
    let rod = Shape::Cylinder { radius_m: 2e-3, height_m: 9e-3 };
    vec![
        (block([8.0, 7.0, 6.0], 0.3e-3), Part::new(&Shape::Sphere { radius_m: 4e-3 }, 0.25e-3)),
        (Part::new(&cone, 0.35e-3), block([5.0, 6.0, 7.0], 0.2e-3)),
        (Part::new(&rod, 0.25e-3), Part::new(&cone, 0.3e-3)),
    ]
}

fn near(random: &mut Random) -> Pose {
    let way = DVec3::new(random.signed(), random.signed(), random.signed());
    Pose::new(turn(random), way.normalize_or(DVec3::X) * (4e-3 + 4e-3 * random.unit()))
}

#[test]
fn parts_that_change_places_feel_the_opposite_and_touch_at_the_same_places() {
    let mut random = Random(5);
    let mut touching = 0;
    let mut apart = 0;
    for (one, other) in pairs() {
        let query = ContactQuery::both_ways(one.both(), other.both(), STIFFNESS_N_PER_M).unwrap();
        // The same stiffness of an area.
        let squares = (one.shell.voxel_size_m() / other.shell.voxel_size_m()).powi(2);
        let swapped =
            ContactQuery::both_ways(other.both(), one.both(), STIFFNESS_N_PER_M * squares).unwrap();
        for _ in 0..150 {
            let pose = near(&mut random);
            let felt = query.wrench(pose).unwrap();
            let there = swapped.wrench(pose.inverse()).unwrap();
            let force = -pose.transform_vector(there.wrench.force);
            let torque = -pose.transform_vector(there.wrench.torque);
            // About the origin of the world there, about that of the moving part here.
            let torque = torque - pose.translation.cross(force);
            let size_n = force.length();
            assert!(
                (felt.wrench.force - force).length() <= 2e-5 * size_n
                    && (felt.wrench.torque - torque).length() <= 2e-7 * size_n
                    && felt.contacts == there.contacts
                    && (felt.penetration_m - there.penetration_m).abs() < 1e-8
                    && (felt.clearance_m - there.clearance_m).abs() < 1e-8,
                "{felt:?} and {force} {torque} {there:?}"
            );
            let nearest = query.nearest(pose).unwrap();
            let of_swapped = swapped.nearest(pose.inverse()).unwrap();
            assert_eq!(nearest.is_some(), of_swapped.is_some());
            if let (Some(nearest), Some(of_swapped)) = (nearest, of_swapped) {
                apart += 1;
                let off = nearest.on_part_m - pose.transform_point(of_swapped.on_shell_m);
                // Two places may be as near to rounding.
                assert!(
                    nearest.distance_m == felt.clearance_m
                        && (off.length() < 1e-6
                            || (nearest.distance_m - of_swapped.distance_m).abs() < 1e-9),
                    "{nearest:?} and {of_swapped:?}"
                );
            }
            touching += u32::from(size_n > 0.0);
        }
    }
    assert!(touching > 100 && apart > 50, "{touching} and {apart}");
}

#[test]
fn contacts_and_patches_of_both_ways_add_up() {
    let mut random = Random(8);
    let mut of_parts = [0; 2];
    for (one, other) in pairs() {
        let query = ContactQuery::both_ways(one.both(), other.both(), STIFFNESS_N_PER_M).unwrap();
        for _ in 0..60 {
            let pose = near(&mut random);
            let mut force = DVec3::ZERO;
            let mut torque = DVec3::ZERO;
            let mut deepest_m = 0.0_f64;
            let felt = query
                .contacts(pose, |contact| {
                    force += contact.force_n;
                    torque += (contact.position_m - pose.translation).cross(contact.force_n);
                    deepest_m = deepest_m.max(contact.depth_m);
                    of_parts[contact.part as usize] += 1;
                    // Along the normal of what touches, which is not far from the way out.
                    assert!(contact.force_n.dot(contact.normal) >= 0.0, "{contact:?}");
                })
                .unwrap();
            assert_eq!(felt, query.wrench(pose).unwrap());
            let patches = query.patches(pose).unwrap();
            let of_patches: DVec3 = patches.iter().map(|patch| patch.force_n).sum();
            let size_n = patches.iter().map(|patch| patch.force_n.length()).sum::<f64>();
            assert!(
                (felt.wrench.force - force).length() <= 1e-4 * size_n
                    && (felt.wrench.torque - torque).length() <= 1e-6 * size_n
                    && (felt.wrench.force - of_patches).length() <= 1e-4 * size_n
                    && felt.penetration_m == deepest_m,
                "{felt:?} and {force} {torque} {of_patches} {deepest_m}"
            );
        }
    }
    assert!(of_parts.iter().all(|n| *n > 1000), "{of_parts:?}");
}

#[test]
fn a_needle_is_seen_that_slips_between_the_points_of_the_other_part() {
    let needle = Part::new(&Shape::Cone { radius_m: 1e-3, height_m: 5e-3 }, 0.1e-3);
    let plate = block([12.0, 12.0, 4.0], 1e-3);
    let one_way = ContactQuery::new(&needle.voxmap, &plate.shell, STIFFNESS_N_PER_M).unwrap();
    let query = ContactQuery::both_ways(needle.both(), plate.both(), STIFFNESS_N_PER_M).unwrap();
    let tip = needle.mesh.vertices().iter().max_by(|a, b| a.z.total_cmp(&b.z)).unwrap();
    let mut random = Random(3);
    let mut unseen = 0;
    for _ in 0..40 {
        let depth_m = 0.3e-3 + 0.3e-3 * random.unit();
        let aside = DVec3::new(random.signed(), random.signed(), 0.0) * 3e-3;
        let pose = Pose::from_translation(*tip + aside + DVec3::Z * (2e-3 - depth_m));
        let is_unseen = one_way.wrench(pose).unwrap().contacts == 0;
        unseen += u32::from(is_unseen);
        let felt = query.wrench(pose).unwrap();
        // Half of the law of the tip in a plane, which is the volume that is immersed, and what the
        // few facets that see the needle make of the reverse.
        let volume = core::f64::consts::PI / 3.0 * depth_m * (depth_m / 5.0).powi(2);
        let of_tip_n = 0.5 * STIFFNESS_N_PER_M / 1e-3_f64.powi(2) * volume;
        let share = felt.wrench.force.z / of_tip_n;
        let most = if is_unseen { 1.05 } else { f64::INFINITY };
        assert!((0.95..most).contains(&share), "{share} of {of_tip_n} N: {felt:?}");
        assert!((felt.penetration_m / depth_m - 1.0).abs() < 0.05, "{depth_m}: {felt:?}");
    }
    assert!(unseen > 20, "{unseen} of 40");
}

#[test]
fn stiffness_of_both_ways_is_the_derivative_of_the_wrench() {
    let slab = block([40.0, 40.0, 10.0], 0.25e-3);
    let ball = Part::new(&Shape::Sphere { radius_m: 5e-3 }, 0.25e-3);
    let large = Part::new(&Shape::Sphere { radius_m: 8e-3 }, 0.25e-3);
    let mut random = Random(13);
    for (name, fixed, moving, from, most) in [
        ("ball on slab", &slab, &ball, 9e-3, 0.02),
        ("slab on ball", &ball, &slab, 9e-3, 0.02),
        ("ball on ball", &large, &ball, 12e-3, 0.02),
    ] {
        let query =
            ContactQuery::both_ways(fixed.both(), moving.both(), STIFFNESS_N_PER_M).unwrap();
        let mut offs: Vec<f64> = (0..30)
            .map(|_| {
                let aside = DVec3::new(random.signed(), random.signed(), 0.3 * random.signed());
                // Off the centre of mass, so that moments are large.
                let turned = DQuat::from_scaled_axis(aside * 0.02);
                let pose = Pose::new(turned, aside * 5e-4 + DVec3::Z * from);
                let rows = query.stiffness(pose).unwrap();
                let found = differences(&query, pose);
                let scale = |k: usize| if k < 3 { 1.0 } else { 1.0 / 5e-3 };
                let mut size = 0.0_f64;
                let mut off = 0.0_f64;
                for row in 0..6 {
                    for column in 0..6 {
                        let own = rows[row][column];
                        // `differences` has a row for each motion.
                        let other = found[column][row];
                        let both = 0.5 * (other + found[row][column]);
                        let expected = if row >= 3 && column >= 3 { both } else { other };
                        let by = scale(row) * scale(column);
                        size = size.max(expected.abs() * by);
                        off = off.max((own - expected).abs() * by);
                    }
                }
                // Half of the force turns with the part: its share is large enough to be seen.
                let force_n = query.wrench(pose).unwrap().wrench.force.length();
                assert!(0.5 * force_n * scale(3) > 2.0 * most * size, "{force_n} N, {size}");
                off / size
            })
            .collect();
        offs.sort_by(f64::total_cmp);
        assert!(offs[27] < most, "{name}: {offs:?}");
    }
}

#[test]
fn a_motion_ends_where_either_part_first_touches() {
    let mut random = Random(17);
    let tolerance_m = 1e-5;
    let mut hits = 0;
    for (one, other) in pairs() {
        let query = ContactQuery::both_ways(one.both(), other.both(), STIFFNESS_N_PER_M).unwrap();
        let center = Pose::from_translation(other.shell.mass_properties().center_m);
        for _ in 0..25 {
            let [from, to] = [near(&mut random), near(&mut random)];
            let from = Pose { translation: from.translation.normalize() * 14e-3, ..from };
            let found = query.first_contact(from, to, tolerance_m).unwrap();
            let [begin, end] = [from, to].map(|pose| pose * center);
            let touches = |share: f64| {
                let body = Pose::new(
                    begin.rotation.slerp(end.rotation, share),
                    begin.translation.lerp(end.translation, share),
                );
                query.wrench(body * center.inverse()).unwrap().contacts > 0
            };
            if let Some(impact) = found {
                hits += 1;
                assert!(query.wrench(impact.pose).unwrap().contacts > 0, "{impact:?}");
            }
            // No point of either part goes faster than this.
            let way_m = begin.translation.distance(end.translation)
                + begin.rotation.angle_between(end.rotation) * 30e-3;
            let until = found.map_or(1.0, |impact| impact.share) - tolerance_m / way_m;
            let first =
                (0..300).map(|k| until * f64::from(k) / 300.0).find(|share| touches(*share));
            assert!(until <= 0.0 || first.is_none(), "{first:?} and {found:?}");
        }
    }
    assert!(hits > 20, "{hits}");
}
