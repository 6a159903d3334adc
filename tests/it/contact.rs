//! Acceptance tests 9, 10, 12, 15 and 18 (contact and force), under their numbers.

use glam::{DQuat, DVec3};
use haptics::FilterParameters;
use haptics::filter::{ShapingFilter, Slide};
use vps::contact::{ContactSum, Obstacle};
use vps::contact::{ForceLaw, Normalization};
use vps::mesh::TriangleMesh;
use vps::mesh::primitives::Shape;
use vps::mesh::validate::inspect;
use vps::pointshell::{self, shell::Shell};
use vps::spatial::{Pose, Wrench};
use vps::voxmap::field::FieldKind;
use vps::voxmap::inside_test::InsideTest;
use vps::voxmap::{Options, Volume};

use super::rig;

const STIFFNESS_N_PER_M: f64 = 1000.0;

fn contact(field: FieldKind) -> ForceLaw {
    ForceLaw { field, stiffness_n_per_m: STIFFNESS_N_PER_M, ..ForceLaw::PLAIN }
}

/// An obstacle with its origin at the world's, and the height of the plane through the centres of
/// its top surface voxels.
fn obstacle(mesh: &TriangleMesh, voxel_size_m: f64) -> (Obstacle, f64) {
    let mut map = rig::volume(mesh, voxel_size_m, 8);
    let grid = map.surface.grid;
    let (_, high) = mesh.bounds().expect("not empty");
    let center_plane_m = grid.origin_m.z + (grid.to_cells(high).z.floor() + 0.5) * voxel_size_m;
    (Obstacle { field: map.field(mesh, true), world_from_map: Pose::IDENTITY }, center_plane_m)
}

fn shell(mesh: &TriangleMesh, voxel_size_m: f64) -> Shell {
    pointshell::build(mesh, &rig::volume(mesh, voxel_size_m, 4), DVec3::ZERO).0
}

fn block(edge_m: f64) -> TriangleMesh {
    Shape::Box { size_m: DVec3::splat(edge_m) }.tessellate(1e-5)
}

fn at(x_m: f64, y_m: f64, z_m: f64) -> Pose {
    Pose::from_translation(DVec3::new(x_m, y_m, z_m))
}

#[test]
fn acceptance_9_a_flat_face_gives_stiffness_times_depth_times_area() {
    const S: f64 = 4e-4;
    const EDGE: f64 = 0.02;
    let shell = shell(&block(EDGE), S);
    let slab = Shape::Plane { x_m: 0.05, y_m: 0.05, thickness_m: 0.02 }.tessellate(1e-5);
    let (obstacle, center_plane_m) = obstacle(&slab, 5e-4);
    let obstacles = [obstacle];
    for kind in
        [FieldKind::Trilinear, FieldKind::Octant, FieldKind::SurfacePoint, FieldKind::Layers]
    {
        // V_L is zero on the plane of the surface voxels' centres, the others on the true surface.
        let zero_m = if kind == FieldKind::Layers { center_plane_m } else { 0.0 };
        // V_L of the tilted normals along the face's edges depends on where a point lies in its
        // voxel; it cancels only where the face stands symmetrically on the grid.
        let (x_m, y_m) = if kind == FieldKind::Layers { (0.0, 0.0) } else { (1.3e-4, -2.1e-4) };
        for depth_m in [3e-4, 5e-4, 1e-3, 1.3e-3, 1.6e-3] {
            let pose = at(x_m, y_m, 0.5 * EDGE + zero_m - depth_m);
            let sum = ContactSum::flat(&obstacles, &shell, pose, contact(kind));
            let expected_n = STIFFNESS_N_PER_M * (EDGE / S).powi(2) * depth_m;
            let force = sum.wrench.force;
            let ratio = force.z / expected_n;
            assert!((ratio - 1.0).abs() <= 0.05, "{kind:?} at {depth_m} m: {ratio}");
            assert!(
                force.angle_between(DVec3::Z).to_degrees() < 1.0,
                "{kind:?} at {depth_m} m: {force}"
            );
            // Torque about the centre: below what one row of points at the edge would make.
            assert!(
                sum.wrench.torque.length() < 0.01 * force.z * EDGE,
                "{kind:?} at {depth_m} m: {:?}",
                sum.wrench
            );
            // The same sum as a volume: s² Σ d ~ overlap volume.
            let volume_m3 = S * S * force.z / STIFFNESS_N_PER_M;
            assert!((volume_m3 / (EDGE * EDGE * depth_m) - 1.0).abs() <= 0.05, "{kind:?}");
            if kind != FieldKind::Layers {
                assert!(
                    (sum.max_value_m - depth_m).abs() < 1e-6,
                    "{kind:?}: depth {} for {depth_m}",
                    sum.max_value_m
                );
            }
        }
        // V_L may reach half a voxel's diagonal above its zero plane where a normal is tilted; the
        // others end at the surface.
        let margin_m = if kind == FieldKind::Layers { 0.5 * 3_f64.sqrt() * 5e-4 } else { 1e-6 };
        let apart = ContactSum::flat(
            &obstacles,
            &shell,
            at(0.0, 0.0, 0.5 * EDGE + zero_m + margin_m),
            contact(kind),
        );
        assert_eq!(
            (apart.contacts, apart.wrench),
            (0, Wrench::ZERO),
            "{kind:?}: exactly zero when nothing touches"
        );
    }
}

#[test]
fn acceptance_9_sideways_forces_cancel_to_rounding_for_a_centred_face() {
    let shell = shell(&block(0.02), 4e-4);
    let slab = Shape::Plane { x_m: 0.05, y_m: 0.05, thickness_m: 0.02 }.tessellate(1e-5);
    let obstacles = [obstacle(&slab, 5e-4).0];
    for depth_m in [3e-4, 9e-4, 1.6e-3] {
        let force = ContactSum::flat(
            &obstacles,
            &shell,
            at(0.0, 0.0, 0.01 - depth_m),
            contact(FieldKind::Trilinear),
        )
        .wrench
        .force;
        assert!(force.x.abs().max(force.y.abs()) < 1e-3 * force.z, "{force}");
    }
}

#[test]
fn acceptance_10_averaging_divides_by_a_tenth_of_the_contacts_from_ten_on() {
    let slab = Shape::Plane { x_m: 0.02, y_m: 0.02, thickness_m: 0.02 }.tessellate(1e-5);
    let obstacles = [obstacle(&slab, 1e-3).0];
    let averaged =
        ForceLaw { normalization: Normalization::Average, ..contact(FieldKind::Trilinear) };
    for (n, factor) in [(5, 1.0), (10, 1.0), (20, 0.5), (100, 0.1)] {
        let shell = Shell::new(&vec![(DVec3::ZERO, DVec3::Z); n], 1e-3);
        let pose = at(0.0, 0.0, -5e-4);
        let plain = ContactSum::flat(&obstacles, &shell, pose, contact(FieldKind::Trilinear));
        let scaled = ContactSum::flat(&obstacles, &shell, pose, averaged);
        assert_eq!(plain.contacts as usize, n);
        assert!(
            (plain.wrench.force.z - n as f64 * 0.5).abs() < 1e-4 * n as f64,
            "{:?}",
            plain.wrench
        );
        assert!(
            (scaled.wrench.force.z / plain.wrench.force.z - factor).abs() < 1e-9,
            "{n} contacts"
        );
        assert!(
            (scaled.stiffness.0[2][2] / plain.stiffness.0[2][2] - factor).abs() < 1e-9,
            "{n} contacts"
        );
    }
}

#[test]
fn acceptance_12_free_space_is_bit_exactly_zero() {
    let shell = shell(&block(0.01), 5e-4);
    let obstacles = [obstacle(&block(0.02), 5e-4).0];
    let mut seed = 5_u64;
    let mut random = || {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (seed >> 11) as f64 / (1_u64 << 53) as f64
    };
    let mut apart = 0;
    let mut touching = 0;
    for _ in 0..300 {
        let axis = DVec3::new(random() - 0.5, random() - 0.5, random() - 0.5).normalize();
        let pose = Pose::new(
            DQuat::from_axis_angle(axis, 6.0 * random()),
            axis * (0.012 + 0.02 * random()),
        );
        let sum = ContactSum::flat(&obstacles, &shell, pose, contact(FieldKind::Trilinear));
        assert_eq!(
            sum.contacts > 0,
            sum.max_value_m > 0.0,
            "a contact is a point inside, and nothing else"
        );
        if sum.max_value_m <= 0.0 {
            apart += 1;
            let bits =
                [sum.wrench.force, sum.wrench.torque].map(|v| v.to_array().map(f64::to_bits));
            assert_eq!(bits, [[0; 3]; 2]);
        } else {
            touching += 1;
            assert!(sum.wrench.force.length() > 0.0);
        }
    }
    assert!(apart > 50 && touching > 50, "{apart} apart, {touching} touching");
}

/// A slab whose top face through the origin is tilted by 10° against its own grid, about an axis
/// between x and y.
fn tilted_slab() -> (TriangleMesh, DVec3) {
    let tilt = DQuat::from_axis_angle(DVec3::new(0.7, 1.0, 0.0).normalize(), 10_f64.to_radians());
    let mut mesh = Shape::Plane { x_m: 0.08, y_m: 0.03, thickness_m: 0.02 }.tessellate(1e-5);
    mesh.vertices.iter_mut().for_each(|vertex| *vertex = tilt * *vertex);
    (mesh, tilt * DVec3::Z)
}

#[test]
fn acceptance_15_continuous_fields_and_the_filter_smooth_a_slide() {
    const S: f64 = 1e-3;
    const DEPTH: f64 = 0.8 * S;
    let (mesh, outward) = tilted_slab();
    let obstacles = [obstacle(&mesh, S).0];
    let along = outward.cross(DVec3::Y).normalize() * -1.0;
    let shell = Shell::new(&[(DVec3::ZERO, outward)], S);
    // 50 mm/s for one second: 50 voxels.
    let slide = |kind: FieldKind| -> Vec<f64> {
        (0..1000)
            .map(|tick| {
                let position = along * (-0.025 + 5e-5 * f64::from(tick)) - outward * DEPTH;
                let sum = ContactSum::flat(
                    &obstacles,
                    &shell,
                    Pose::from_translation(position),
                    contact(kind),
                );
                sum.wrench.force.dot(outward)
            })
            .collect()
    };
    let ripple = |force: &[f64]| {
        let mean = force.iter().sum::<f64>() / force.len() as f64;
        (force.iter().map(|f| (f - mean).powi(2)).sum::<f64>() / force.len() as f64).sqrt()
    };
    let largest_step =
        |force: &[f64]| force.windows(2).map(|pair| (pair[1] - pair[0]).abs()).fold(0.0, f64::max);

    let raw = slide(FieldKind::Layers);
    let jump = largest_step(&raw);
    assert!(jump <= 0.866 * STIFFNESS_N_PER_M * S, "raw jump {jump} N");
    assert!(jump > 0.05 * STIFFNESS_N_PER_M * S, "the raw field must show its voxels: {jump} N");
    for kind in [FieldKind::Octant, FieldKind::Trilinear] {
        let smooth = slide(kind);
        assert!(
            ripple(&smooth) * 10.0 <= ripple(&raw),
            "{kind:?}: {} against {}",
            ripple(&smooth),
            ripple(&raw)
        );
        // The distance to a plane is linear, so both formulas are exact up to rounding, everywhere
        // on the way.
        for force in &smooth {
            assert!(
                (force / (STIFFNESS_N_PER_M * DEPTH) - 1.0).abs() < 0.002,
                "{kind:?}: {force} N"
            );
        }
    }

    // The filter on the raw force: each step at most (1 − α) of what is left, and a lag of α/(1 −
    // α) ticks on a slow ramp.
    let params = FilterParameters { cutoff_hz: [50.0, 300.0] };
    let sliding = |speed_m_per_s| Slide { speed_m_per_s, voxel_size_m: S, contact_rad_per_s: 0.0 };
    let mut filter = ShapingFilter::default();
    let filtered: Vec<f64> = raw
        .iter()
        .map(|force| {
            filter
                .update(
                    Wrench::new(outward * *force, DVec3::ZERO),
                    sliding(0.05),
                    true,
                    &params,
                    1e-3,
                )
                .force
                .dot(outward)
        })
        .collect();
    let alpha = filter.alpha();
    assert!(
        (alpha - (-2.0 * core::f64::consts::PI * 50.0 * 1e-3_f64).exp()).abs() < 1e-12,
        "0.3 · 50 Hz is below f_min"
    );
    for (tick, pair) in filtered.windows(2).enumerate() {
        let bound = (1.0 - alpha) * (raw[tick + 1] - pair[0]).abs();
        assert!((pair[1] - pair[0]).abs() <= bound + 1e-12);
    }
    let mut filter = ShapingFilter::default();
    let slope_n_per_tick = 1e-3;
    let mut output = 0.0;
    for tick in 0..2000 {
        let ramp = Wrench::new(DVec3::Z * (slope_n_per_tick * f64::from(tick)), DVec3::ZERO);
        output = filter.update(ramp, sliding(0.0), true, &params, 1e-3).force.z;
    }
    let lag_ticks = 1999.0 - output / slope_n_per_tick;
    assert!((lag_ticks - alpha / (1.0 - alpha)).abs() < 1e-6, "{lag_ticks} ticks");
}

#[test]
fn a_thin_skin_pushes_out_on_the_side_that_it_was_entered_from() {
    // A sheet: open, so it is thin by the decision on open objects; one voxel of skin on either
    // side.
    const S: f64 = 5e-4;
    let corners = [(-0.01, -0.01), (0.01, -0.01), (0.01, 0.01), (-0.01, 0.01)];
    let sheet = TriangleMesh {
        vertices: corners.iter().map(|(x, y)| DVec3::new(*x, *y, 0.0)).collect(),
        triangles: vec![[0, 1, 2], [0, 2, 3]],
    };
    let mut map = rig::volume(&sheet, S, 4);
    assert!(map.thin && !map.watertight);
    let obstacles = [Obstacle { field: map.field(&sheet, false), world_from_map: Pose::IDENTITY }];
    for (height_m, normal) in [(0.6 * S, DVec3::Z), (-0.6 * S, DVec3::NEG_Z)] {
        // The point's own normal is useless here on purpose: the skin's gradient decides.
        let shell = Shell::new(&[(DVec3::ZERO, DVec3::X)], S);
        let sum = ContactSum::flat(
            &obstacles,
            &shell,
            at(1e-3, 1e-3, height_m),
            contact(FieldKind::Trilinear),
        );
        assert_eq!(sum.contacts, 1);
        assert!((sum.max_value_m - 0.4 * S).abs() < 0.02 * S, "{}", sum.max_value_m);
        assert!(sum.wrench.force.angle_between(normal).to_degrees() < 1.0, "{}", sum.wrench.force);
    }
    let shell = Shell::new(&[(DVec3::ZERO, DVec3::X)], S);
    let apart =
        ContactSum::flat(&obstacles, &shell, at(0.0, 0.0, 1.2 * S), contact(FieldKind::Trilinear));
    assert_eq!(apart.wrench, Wrench::ZERO);
}

#[test]
fn a_closed_plate_thinner_than_a_voxel_is_a_skin_where_that_is_asked_for() {
    const S: f64 = 5e-4;
    let shell = Shell::new(&[(DVec3::ZERO, DVec3::Z)], S);
    for thickness_m in [1e-4, 3e-4, 5e-4] {
        let plate = Shape::Box { size_m: DVec3::new(0.02, 0.02, thickness_m) }.tessellate(1e-5);
        assert!(!rig::volume(&plate, S, 4).thin, "{thickness_m} m");
        let options =
            Options { voxel_size_m: S, layers: 4, navigation: None, sides: InsideTest::Thin };
        let mut map = Volume::build(&plate, &inspect(&plate), &options, |_| ()).unwrap();
        assert!(map.thin && map.watertight && map.leak.is_none(), "{thickness_m} m");
        let obstacles =
            [Obstacle { field: map.field(&plate, false), world_from_map: Pose::IDENTITY }];
        let pose = at(1e-3, 1e-3, 0.5 * thickness_m + 0.5 * S);
        let sum = ContactSum::flat(&obstacles, &shell, pose, contact(FieldKind::Trilinear));
        assert!(
            sum.contacts == 1 && (sum.max_value_m - 0.5 * S).abs() < 0.1 * S,
            "{thickness_m} m: {}",
            sum.max_value_m
        );
        assert!(sum.wrench.force.angle_between(DVec3::Z).to_degrees() < 1.0);
    }
}

/// A contact as the Jacobian of its wrench needs it, world axes, about the centre of mass.
struct Pushed {
    arm: DVec3,
    /// Direction of the push; turns with the tool.
    normal: DVec3,
    depth_m: f64,
    /// grad V.
    gradient: DVec3,
}

/// dW/dx of K Σ d n with its moments, rows and columns linear before angular, by the product rule:
///
/// ```text
/// dF/dp = K n gᵀ        dF/dθ = −K n gᵀ [r]× − K d [n]×
/// dτ/dp = K [r]× n gᵀ   dτ/dθ = −K [r]× n gᵀ [r]× − K d [r]× [n]× + [f]× [r]×
/// ```
fn exact_jacobian(contacts: &[Pushed], stiffness_n_per_m: f64) -> [[f64; 6]; 6] {
    let mut jacobian = [[0.0; 6]; 6];
    for Pushed { arm, normal, depth_m, gradient } in contacts {
        let force = *normal * (stiffness_n_per_m * depth_m);
        for (column, axis) in [DVec3::X, DVec3::Y, DVec3::Z].into_iter().enumerate() {
            // How the point moves with a shift and with a turn about the axis.
            for (offset, moved, turned) in [(0, axis, DVec3::ZERO), (3, axis.cross(*arm), axis)] {
                let force_rate =
                    *normal * (stiffness_n_per_m * gradient.dot(moved)) + turned.cross(force);
                let arm_rate = if offset == 3 { moved } else { DVec3::ZERO };
                let torque_rate = arm.cross(force_rate) + arm_rate.cross(force);
                for row in 0..3 {
                    jacobian[row][offset + column] += force_rate[row];
                    jacobian[row + 3][offset + column] += torque_rate[row];
                }
            }
        }
    }
    jacobian
}

/// Central differences of a wrench over shifts of `way_m` and turns of `turn_rad` about the centre
/// of mass.
fn differences(
    pose: Pose,
    way_m: f64,
    turn_rad: f64,
    wrench: impl Fn(Pose) -> Wrench,
) -> [[f64; 6]; 6] {
    let mut jacobian = [[0.0; 6]; 6];
    for (column, axis) in [DVec3::X, DVec3::Y, DVec3::Z].into_iter().enumerate() {
        for (offset, step, linear, angular) in
            [(0, way_m, axis, DVec3::ZERO), (3, turn_rad, DVec3::ZERO, axis)]
        {
            let at = |sign: f64| wrench(pose.stepped(linear * sign * step, angular * sign * step));
            let rate = (at(1.0) + -at(-1.0)) * (0.5 / step);
            for row in 0..3 {
                jacobian[row][offset + column] = rate.force[row];
                jacobian[row + 3][offset + column] = rate.torque[row];
            }
        }
    }
    jacobian
}

/// Reach of the points: turns count by the way of a point so far out, moments by the force there.
const REACH_M: f64 = 0.01;

/// Largest difference of two Jacobians as a share of the largest entry, in newtons per metre.
fn apart(one: &[[f64; 6]; 6], other: &[[f64; 6]; 6]) -> f64 {
    let per_m =
        |row: usize, column: usize| REACH_M.powi(-i32::from(row >= 3) - i32::from(column >= 3));
    let entries = || (0..6).flat_map(|row| (0..6).map(move |column| (row, column)));
    let scale = entries()
        .map(|(row, column)| other[row][column].abs() * per_m(row, column))
        .fold(0.0, f64::max);
    let off = entries()
        .map(|(row, column)| (one[row][column] - other[row][column]).abs() * per_m(row, column));
    off.fold(0.0, f64::max) / scale
}

/// Where the middle of the ball lies that the points are on, tool axes.
const OFF_CENTER_M: DVec3 = DVec3::new(4e-3, -3e-3, 0.0);
const TURN: DVec3 = DVec3::new(0.02, -0.03, 0.4);

/// The tool turned, with the middle of that ball at a place.
fn ball_at(x_m: f64, y_m: f64, z_m: f64) -> Pose {
    let turn = DQuat::from_scaled_axis(TURN);
    Pose::new(turn, DVec3::new(x_m, y_m, z_m) - turn * OFF_CENTER_M)
}

/// Points on a cap of a ball off the centre of mass, their normals a little off, as those of a
/// shell are.
fn cap(n: usize, radius_m: f64, reach_rad: f64) -> Vec<(DVec3, DVec3)> {
    let golden = core::f64::consts::PI * (3.0 - 5_f64.sqrt());
    let point = |k: usize| {
        let polar = reach_rad * ((k as f64 + 0.5) / n as f64).sqrt();
        let (sin, cos) = polar.sin_cos();
        let around = golden * k as f64;
        let outward = DVec3::new(sin * around.cos(), sin * around.sin(), -cos);
        let off =
            DVec3::new((7.0 * around).sin(), (5.0 * around).cos(), (3.0 * around).sin()) * 0.1;
        (outward * radius_m + OFF_CENTER_M, (off - outward).normalize())
    };
    (0..n).map(point).collect()
}

/// The formula against a distance that is curved and smooth, in f64: what is left is of second
/// order in the step.
#[test]
fn acceptance_18_the_exact_jacobian_is_that_of_finite_differences() {
    let center = DVec3::new(1e-3, -2e-3, -0.02);
    let radius_m = 0.0185;
    let points = cap(200, 0.01, 0.25);
    let push = |pose: Pose| -> Vec<Pushed> {
        let pushed = |(point, normal): &(DVec3, DVec3)| {
            let arm = pose.rotation * *point;
            let from_center = pose.translation + arm - center;
            let depth_m = radius_m - from_center.length();
            assert!(depth_m > 1e-4, "away from the kink at zero: {depth_m} m");
            Pushed {
                arm,
                normal: pose.rotation * *normal,
                depth_m,
                gradient: -from_center.normalize(),
            }
        };
        points.iter().map(pushed).collect()
    };
    let wrench = |pose: Pose| {
        push(pose).iter().fold(Wrench::ZERO, |sum, Pushed { arm, normal, depth_m, .. }| {
            let force = *normal * (STIFFNESS_N_PER_M * depth_m);
            sum + Wrench::new(force, arm.cross(force))
        })
    };
    let pose = ball_at(8e-4, -1.5e-3, 7.2e-3);
    let exact = exact_jacobian(&push(pose), STIFFNESS_N_PER_M);
    let error = apart(&differences(pose, 2e-7, 2e-5, wrench), &exact);
    eprintln!("exact Jacobian against differences, f64: {error:.1e}");
    assert!(error < 1e-6, "{error}");
}

/// The wrench of the tick, whose depths are of single precision, against the formula on its own
/// contacts; and its stiffness, which leaves out what the wrench itself makes.
#[test]
fn acceptance_18_the_wrench_of_the_tick_has_that_jacobian_and_its_stiffness_the_gradients() {
    let slab = Shape::Plane { x_m: 0.03, y_m: 0.03, thickness_m: 0.02 }.tessellate(1e-5);
    let obstacles = [obstacle(&slab, 5e-4).0];
    let field = &obstacles[0].field;
    let shell = Shell::new(&cap(2000, 0.01, 0.3), 5e-4);
    let parameters = contact(FieldKind::Trilinear);
    // Even the outermost point is half a millimetre deep, so none comes or goes.
    let pose = ball_at(8e-4, -1.5e-3, 8.7e-3);
    let sum = |pose: Pose| ContactSum::flat(&obstacles, &shell, pose, parameters);
    assert_eq!(sum(pose).contacts, 2000);
    let mut contacts = Vec::new();
    vps::contact::visit(field, FieldKind::Trilinear, &shell, pose, |contact| {
        let arm = pose.rotation * contact.arm_body.as_dvec3();
        let cells = (pose.translation + arm - field.origin_map().as_dvec3())
            / f64::from(field.voxel_size_m());
        contacts.push(Pushed {
            arm,
            normal: pose.rotation * contact.normal_body.as_dvec3(),
            depth_m: f64::from(contact.depth_m),
            gradient: field.gradient(cells.as_vec3()).as_dvec3(),
        });
    });
    let exact = exact_jacobian(&contacts, STIFFNESS_N_PER_M);
    let error = apart(&differences(pose, 1e-4, 1e-3, |pose| sum(pose).wrench), &exact);
    // −K Σ (n, r × n)(g, r × g)ᵀ as the second derivative of an energy.
    let mut held = [[0.0; 6]; 6];
    for Pushed { arm, normal, gradient, .. } in &contacts {
        let pushes = [*normal, arm.cross(*normal)].map(|vector| vector.to_array());
        let deepens = [*gradient, arm.cross(*gradient)].map(|vector| vector.to_array());
        for (i, j) in (0..6).flat_map(|i| (0..6).map(move |j| (i, j))) {
            let of = |row: usize, column: usize| {
                pushes.as_flattened()[row] * deepens.as_flattened()[column]
            };
            let entry = match (i < 3, j < 3) {
                (true, false) => of(j, i),
                (false, true) => of(i, j),
                _ => 0.5 * (of(i, j) + of(j, i)),
            };
            held[i][j] += STIFFNESS_N_PER_M * entry;
        }
    }
    let stiffness = sum(pose).stiffness.0.map(|row| row.map(|entry| -entry));
    let far = apart(&stiffness, &held);
    eprintln!(
        "Jacobian of the tick's wrench: {error:.1e} from the exact one; stiffness: {far:.1e}"
    );
    assert!(error < 2e-5, "{error}");
    assert!(far < 1e-5, "{far}");
}
