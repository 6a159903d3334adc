//! The force of facets against the law that it approximates: K/s² times the integral of depth over
//! the immersed surface, which over a plane is K/s² times the volume of the overlap, along the
//! plane's normal.

use glam::{DQuat, DVec3};
use vps::contact::{ContactSum, ForceLaw, Obstacle};
use vps::mesh::TriangleMesh;
use vps::mesh::primitives::Shape;
use vps::pointshell::{Points, build_with, shell::Shell};
use vps::spatial::Pose;
use vps::spatial::testing::Random;

use super::{Work, build, work_of_closed_path};

const K: f64 = ForceLaw::PLAIN.stiffness_n_per_m;

/// A plate whose upper side is z = 0, off the boundaries of its voxels.
fn plane() -> Vec<Obstacle> {
    let plate = Shape::Box { size_m: DVec3::new(0.08, 0.08, 0.01) }.tessellate(0.0);
    let field = build(&plate, 1.03e-3, 4).field(&plate, false);
    vec![Obstacle { field, world_from_map: Pose::from_translation(DVec3::Z * -0.005) }]
}

fn shell_of(mesh: &TriangleMesh, voxel_size_m: f64, points: Points) -> Shell {
    build_with(points, mesh, &build(mesh, voxel_size_m, 3), DVec3::ZERO).0
}

fn turned(mesh: &TriangleMesh, rotation: DQuat) -> TriangleMesh {
    let mut mesh = mesh.clone();
    mesh.vertices.iter_mut().for_each(|vertex| *vertex = rotation * *vertex);
    mesh
}

fn rotation(random: &mut Random) -> DQuat {
    DQuat::from_xyzw(random.signed(), random.signed(), random.signed(), random.signed()).normalize()
}

/// Force of the mesh at this pose on the plane z = 0, by the law: N.
fn law_n(mesh: &TriangleMesh, pose: Pose, voxel_size_m: f64) -> DVec3 {
    let mut sum = DVec3::ZERO;
    for triangle_idx in 0..mesh.triangles.len() {
        let corners = mesh.corners(triangle_idx).map(|corner| pose.transform_point(corner));
        let outward = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize_or_zero();
        let mut below: Vec<DVec3> = Vec::new();
        for (from, to) in [(0, 1), (1, 2), (2, 0)].map(|(from, to)| (corners[from], corners[to])) {
            if from.z * to.z < 0.0 {
                below.push(from.lerp(to, from.z / (from.z - to.z)));
            }
            if to.z <= 0.0 {
                below.push(to);
            }
        }
        for pair in below.get(1..).unwrap_or(&[]).windows(2) {
            let area = 0.5 * (pair[0] - below[0]).cross(pair[1] - below[0]).length();
            sum -= outward * area * -(below[0].z + pair[0].z + pair[1].z) / 3.0;
        }
    }
    sum * K / (voxel_size_m * voxel_size_m)
}

fn deepest_m(mesh: &TriangleMesh, rotation: DQuat) -> f64 {
    mesh.vertices.iter().map(|vertex| -(rotation * *vertex).z).fold(f64::NEG_INFINITY, f64::max)
}

struct Errors {
    angle_deg: Vec<f64>,
    ratio: Vec<f64>,
}

/// The mesh pressed `depth_m` deep in random orientations.
fn errors(
    mesh: &TriangleMesh,
    voxel_size_m: f64,
    depth_m: f64,
    points: Points,
    n: usize,
) -> Errors {
    let obstacles = plane();
    let mut random = Random(7);
    let mut found = Errors { angle_deg: Vec::new(), ratio: Vec::new() };
    for _ in 0..n {
        let mesh = turned(mesh, rotation(&mut random));
        let shell = shell_of(&mesh, voxel_size_m, points);
        for _ in 0..5 {
            let turn = rotation(&mut random);
            let pose = Pose::new(turn, DVec3::new(3e-4, -2e-4, deepest_m(&mesh, turn) - depth_m));
            let sum = ContactSum::flat(&obstacles, &shell, pose, ForceLaw::PLAIN);
            let law = law_n(&mesh, pose, voxel_size_m);
            found.angle_deg.push(sum.wrench.force.angle_between(DVec3::Z).to_degrees());
            found.ratio.push(sum.wrench.force.z / law.z);
        }
    }
    found.angle_deg.sort_by(f64::total_cmp);
    found.ratio.sort_by(f64::total_cmp);
    found
}

fn at(sorted: &[f64], share: f64) -> f64 {
    sorted[((sorted.len() - 1) as f64 * share) as usize]
}

#[test]
fn a_face_presses_with_its_area_however_it_lies_in_its_grid() {
    const S: f64 = 5e-4;
    let obstacles = plane();
    let mut random = Random(150);
    let cube = Shape::Box { size_m: DVec3::splat(0.01) }.tessellate(0.0);
    let depth_m = 0.25 * S;
    let mut least = f64::INFINITY;
    let mut most = 0.0_f64;
    for _ in 0..150 {
        let turn = rotation(&mut random);
        let shell = shell_of(&turned(&cube, turn), S, Points::Facets);
        let pose = Pose::new(turn.inverse(), DVec3::Z * (0.005 - depth_m));
        let sum = ContactSum::flat(&obstacles, &shell, pose, ForceLaw::PLAIN);
        let ratio = sum.wrench.force.z / (K * 1e-4 * depth_m / (S * S));
        (least, most) = (least.min(ratio), most.max(ratio));
        assert!(
            sum.wrench.force.angle_between(DVec3::Z) < 1e-3
                && sum.arm_world.truncate().length() < 1e-5,
            "{turn}: {sum:?}"
        );
    }
    eprintln!("a face in 150 attitudes: {least:.4} to {most:.4} of the law");
    assert!(least > 0.9999 && most < 1.0001, "{least} to {most}");
}

#[test]
fn a_corner_is_noted_at_a_fiftieth_of_a_voxel_and_felt_at_a_tenth() {
    const S: f64 = 5e-4;
    let obstacles = plane();
    let mut random = Random(25);
    let cube = Shape::Box { size_m: DVec3::splat(0.01) }.tessellate(0.0);
    for _ in 0..25 {
        let turn = rotation(&mut random);
        let mesh = turned(&cube, turn);
        let shell = shell_of(&mesh, S, Points::Facets);
        for corner in &mesh.vertices {
            let down = DQuat::from_rotation_arc(corner.normalize(), -DVec3::Z);
            let at_depth = |depth_m: f64| {
                let pose = Pose::new(down, DVec3::Z * (corner.length() - depth_m));
                ContactSum::flat(&obstacles, &shell, pose, ForceLaw::PLAIN)
            };
            let noted = at_depth(0.02 * S);
            let off_m = noted.max_value_m - 0.02 * S;
            assert!(noted.contacts > 0 && off_m.abs() < 1e-8, "{turn}, {corner}: {noted:?}");
            let felt = at_depth(0.1 * S);
            assert!(felt.wrench.force.z > 0.0, "{turn}, {corner}: {felt:?}");
        }
    }
}

#[test]
fn the_force_on_round_parts_comes_to_the_law_with_the_voxel() {
    let ball = Shape::Sphere { radius_m: 0.005 }.tessellate(1e-6);
    let mut last = None;
    for voxel_size_m in [1e-3, 5e-4, 2.5e-4] {
        let Errors { angle_deg, ratio } = errors(&ball, voxel_size_m, 4e-4, Points::Facets, 4);
        let worst = (at(&ratio, 0.0) - 1.0).abs().max((at(&ratio, 1.0) - 1.0).abs());
        let found = [worst, at(&angle_deg, 1.0)];
        eprintln!(
            "ball, voxels of {:.2} mm: {:.1} % and {:.2}° off the law",
            1e3 * voxel_size_m,
            100.0 * worst,
            found[1]
        );
        if let Some([was, was_deg]) = last.replace(found) {
            assert!(worst < 0.5 * was && found[1] < 0.5 * was_deg, "{found:?} after {last:?}");
        }
    }
    let [worst, angle_deg] = last.unwrap_or([1.0; 2]);
    assert!(worst < 0.01 && angle_deg < 0.1, "{worst} {angle_deg}");
}

/// Less than a voxel of an edge or a corner in a wall: the direction is that of the wall
/// nevertheless, and right where more is immersed.
#[test]
fn the_force_on_edges_and_corners_points_out_of_the_wall_and_comes_to_the_law() {
    let cube = Shape::Box { size_m: DVec3::splat(0.01) }.tessellate(0.0);
    let rod = Shape::Cylinder { radius_m: 0.004, height_m: 0.012 }.tessellate(1e-6);
    for (name, mesh) in [("cube", &cube), ("rod", &rod)] {
        for (voxel_size_m, angle_max_deg, off_most) in
            [(1e-3, 3.0, 0.03), (5e-4, 1.0, 0.01), (1.25e-4, 0.1, 0.002)]
        {
            let Errors { angle_deg, ratio } = errors(mesh, voxel_size_m, 4e-4, Points::Facets, 4);
            let least = at(&ratio, 0.0);
            let most = at(&ratio, 1.0);
            eprintln!(
                "{name}, voxels of {:.3} mm, 0.4 mm deep: at most {:.2}°, {least:.3} to {most:.3} \
                    of the law",
                1e3 * voxel_size_m,
                at(&angle_deg, 1.0)
            );
            assert!(
                at(&angle_deg, 1.0) < angle_max_deg
                    && (least - 1.0).abs() < off_most
                    && (most - 1.0).abs() < off_most,
                "{name}: {angle_deg:?} {ratio:?}"
            );
        }
    }
}

/// The corner of a cube in 150 attitudes, a voxel deep, a half and a quarter.
#[test]
fn a_corner_presses_by_the_law_down_to_a_quarter_of_a_voxel() {
    const S: f64 = 5e-4;
    let cube = Shape::Box { size_m: DVec3::splat(0.01) }.tessellate(0.0);
    for share in [1.0, 0.5, 0.25] {
        let Errors { angle_deg, ratio } = errors(&cube, S, share * S, Points::Facets, 30);
        let p95 = at(&angle_deg, 0.95);
        let least = at(&ratio, 0.05);
        let most = at(&ratio, 0.95);
        eprintln!(
            "a corner {share} voxels deep: p95 {p95:.2}°, {least:.3} to {most:.3} of the law"
        );
        assert!(p95 < 2.0 && least > 0.95 && most < 1.05, "{share}: {angle_deg:?} {ratio:?}");
    }
}

/// The tips of cones, which have no sharp edge, and the ends of pins, in 150 attitudes each.
#[test]
fn a_tip_presses_by_the_law_down_to_a_quarter_of_a_voxel() {
    const S: f64 = 5e-4;
    let height_m = 0.008;
    let obstacles = plane();
    let cones = [15.0_f64, 30.0, 45.0, 60.0].map(|half_angle_deg| {
        let half_angle = half_angle_deg.to_radians();
        (Shape::Cone { radius_m: height_m * half_angle.tan(), height_m }, half_angle)
    });
    let pins = [0.25, 0.5, 1.0, 2.0]
        .map(|voxels| (Shape::Capsule { radius_m: voxels * S, height_m }, 0.0));
    let is_cone = |shape: &Shape| matches!(shape, Shape::Cone { .. });
    for (shape, half_angle) in cones.into_iter().chain(pins) {
        let mesh = shape.tessellate(2e-6);
        for share in [1.0, 0.5, 0.25] {
            let mut random = Random(29);
            let mut found = Errors { angle_deg: Vec::new(), ratio: Vec::new() };
            for _ in 0..30 {
                let lies = rotation(&mut random);
                let mesh = turned(&mesh, lies);
                let shell = shell_of(&mesh, S, Points::Facets);
                for _ in 0..5 {
                    // The tip is at +z, and comes down first.
                    let most_tilt = 0.8 * (core::f64::consts::FRAC_PI_2 - half_angle);
                    let tilt = most_tilt * random.signed() + core::f64::consts::PI;
                    let turn = DQuat::from_rotation_z(3.0 * random.signed())
                        * DQuat::from_rotation_x(tilt)
                        * lies.inverse();
                    let height_m = deepest_m(&mesh, turn) - share * S;
                    let pose = Pose::new(turn, DVec3::new(3e-4, -2e-4, height_m));
                    let sum = ContactSum::flat(&obstacles, &shell, pose, ForceLaw::PLAIN);
                    let law = law_n(&mesh, pose, S);
                    found.angle_deg.push(sum.wrench.force.angle_between(DVec3::Z).to_degrees());
                    found.ratio.push(sum.wrench.force.z / law.z);
                }
            }
            let squares: f64 = found.ratio.iter().map(|ratio| (ratio - 1.0).powi(2)).sum();
            let rms = (squares / found.ratio.len() as f64).sqrt();
            found.angle_deg.sort_by(f64::total_cmp);
            found.ratio.sort_by(f64::total_cmp);
            let p95 = at(&found.angle_deg, 0.95);
            let [least, most] = [0.05, 0.95].map(|part| at(&found.ratio, part));
            eprintln!(
                "{shape:?}, {share} voxels deep: p95 {p95:.2}°, {least:.3} to {most:.3} of the \
                    law, RMS {rms:.3}"
            );
            let is_met = if is_cone(&shape) { least > 0.95 && most < 1.05 } else { rms < 0.05 };
            assert!(p95 < 2.0 && is_met, "{shape:?}, {share} voxels deep");
        }
    }
}

/// A rough surface is no field of tips: most of what it has more are edges, as before.
#[test]
fn a_rough_ball_has_few_points_more_than_a_smooth_one() {
    const S: f64 = 5e-4;
    let ball = Shape::Sphere { radius_m: 0.008 }.tessellate(2e-6);
    let n_smooth = shell_of(&ball, S, Points::Facets).len();
    for roughness_m in [5e-6, 1e-5, 2e-5, 4e-5] {
        let mut random = Random(3);
        let mut mesh = ball.clone();
        let rough = |vertex: &DVec3| vertex.normalize() * (roughness_m * random.signed());
        let by: Vec<DVec3> = ball.vertices.iter().map(rough).collect();
        mesh.vertices.iter_mut().zip(by).for_each(|(vertex, by)| *vertex += by);
        let n_points = shell_of(&mesh, S, Points::Facets).len();
        eprintln!("rough by {roughness_m} m: {n_points} points for {n_smooth}");
        assert!(n_points < 16 * n_smooth, "{roughness_m}: {n_points} for {n_smooth}");
    }
}

/// A facet of the tool that reaches over the rim of an obstacle lies beside it in part: by the
/// gradient at its centroid it would be in it.
#[test]
fn a_face_on_a_smaller_one_presses_with_the_smaller_area_and_not_before_it_touches() {
    const S: f64 = 5e-4;
    const EDGE_M: f64 = 0.01;
    let size_m = DVec3::new(EDGE_M, EDGE_M, 0.006);
    let mut random = Random(41);
    let tool = Shape::Box { size_m: DVec3::new(0.022, 0.02, 0.004) }.tessellate(0.0);
    let shell = shell_of(&tool, S, Points::Facets);
    for _ in 0..12 {
        // As it happens to lie in its grid.
        let mut block = Shape::Box { size_m }.tessellate(0.0);
        let aside = DVec3::from_array([(); 3].map(|()| S * random.signed()));
        block.vertices.iter_mut().for_each(|vertex| *vertex += aside);
        let field = build(&block, S, 4).field(&block, false);
        let world_from_map = Pose::from_translation(DVec3::Z * (-0.5 * size_m.z) - aside);
        let obstacles = [Obstacle { field, world_from_map }];
        let turn = DQuat::from_rotation_z(random.signed());
        let aside = DVec3::new(2e-3 * random.signed(), 2e-3 * random.signed(), 0.0);
        let at = |depth_m: f64| {
            let pose = Pose::new(turn, aside + DVec3::Z * (0.002 - depth_m));
            ContactSum::flat(&obstacles, &shell, pose, ForceLaw::PLAIN)
        };
        for voxels in [0.01, 0.05, 0.1, 0.3, 0.8] {
            let sum = at(-voxels * S);
            assert!(sum.contacts == 0, "{voxels} voxels above: {sum:?}");
        }
        for (voxels, least) in [(0.25, 0.999), (0.5, 0.999), (1.0, 0.999)] {
            let depth_m = voxels * S;
            let sum = at(depth_m).wrench.force;
            // The depth is no more than the way to a side: a block without its slopes.
            let law = (EDGE_M - 2.0 * depth_m).mul_add(EDGE_M, 4.0 / 3.0 * depth_m * depth_m)
                * depth_m
                * K
                / (S * S);
            let ratio = sum.z / law;
            let angle_deg = sum.angle_between(DVec3::Z).to_degrees();
            eprintln!(
                "a face on a smaller one, {voxels} deep: {ratio:.4} of the law, {angle_deg:.2}°"
            );
            // The interpolated field rounds the rim of the block off.
            assert!(
                (least..1.01).contains(&ratio) && angle_deg < 0.5,
                "{voxels}: {ratio} {angle_deg}"
            );
        }
    }
}

/// The law is the gradient of an energy: what a closed path of a tool on its corners, edges and tip
/// takes, it gives back.
#[test]
fn a_closed_path_over_a_plane_does_no_work() {
    const S: f64 = 5e-4;
    const TICKS: u32 = 2000;
    let obstacles = plane();
    let of_box = Shape::Box { size_m: DVec3::new(0.006, 0.005, 0.004) };
    let cone = Shape::Cone { radius_m: 0.0046, height_m: 0.008 };
    let upside_down = DQuat::from_rotation_x(core::f64::consts::PI);
    let tools =
        [(of_box, DQuat::IDENTITY, 1.0), (cone, upside_down, 0.35), (cone, upside_down, 0.0)];
    for (shape, start, turns) in tools {
        let tool = shape.tessellate(2e-6);
        let shell = shell_of(&tool, S, Points::Facets);
        let pose = |tick: u32| {
            let phase = core::f64::consts::TAU * f64::from(tick) / f64::from(TICKS);
            let turn = DVec3::new(
                0.6 + 0.4 * phase.cos(),
                0.5 + 0.5 * (2.0 * phase).sin(),
                0.7 * phase.sin(),
            );
            let turn = DQuat::from_scaled_axis(turn * turns) * start;
            let lowest_m = deepest_m(&tool, turn);
            let depth_m = S * (0.6 + 0.5 * phase.sin());
            let aside = DVec3::new(2e-3 * phase.cos(), 1e-3 * (2.0 * phase).cos(), 0.0);
            Pose::new(turn, aside + DVec3::Z * (lowest_m - depth_m))
        };
        let Work { share, amounts_j } = work_of_closed_path(&obstacles, &shell, TICKS, pose);
        let amounts_uj = 1e6 * amounts_j;
        eprintln!("{shape:?}: a closed path leaves {:.3} % of {amounts_uj:.3} µJ", 100.0 * share);
        assert!(share < 0.01 && amounts_j > 1e-7, "{shape:?}: {share} of {amounts_uj} µJ");
    }
}

/// Nothing of the surface is lost or counted twice, also where faces lie on the boundaries of
/// voxels.
#[test]
fn areas_add_up_to_the_surface_and_area_vectors_to_nothing() {
    let aligned = Shape::Box { size_m: DVec3::new(0.01, 0.006, 0.008) }.tessellate(0.0);
    let torus = Shape::Torus { major_m: 0.008, minor_m: 0.002 }.tessellate(2e-6);
    let mut random = Random(3);
    let meshes = [
        aligned.clone(),
        turned(&aligned, rotation(&mut random)),
        turned(&torus, rotation(&mut random)),
        stepped(),
    ];
    for (idx, mesh) in meshes.iter().enumerate() {
        let voxel_size_m = 5e-4;
        let shell = shell_of(mesh, voxel_size_m, Points::Facets);
        let weights = shell.weights().iter().flat_map(|weights| weights.0);
        let mut area = 0.0;
        let mut sum = DVec3::ZERO;
        for ((_, normal), weight) in shell.points().zip(weights) {
            assert!(
                (normal.length() - 1.0).abs() < 1e-5 && weight >= 0.0,
                "mesh {idx}: {normal} {weight}"
            );
            area += f64::from(weight);
            sum += normal.as_dvec3() * f64::from(weight);
        }
        let truth: f64 = (0..mesh.triangles.len())
            .map(|triangle_idx| {
                let [a, b, c] = mesh.corners(triangle_idx);
                0.5 * (b - a).cross(c - a).length() / (voxel_size_m * voxel_size_m)
            })
            .sum();
        // Bent facets have a little less area than their polygons.
        assert!(
            area < truth * (1.0 + 1e-6) && area > truth * 0.98,
            "mesh {idx}: {area} of {truth}"
        );
        assert!(sum.length() < 1e-4 * area, "mesh {idx}: {sum} of {area}");
    }
}

/// A box with a step whose faces lie on the boundaries of voxels: those of its grid start at its
/// lowest corner less a padding of whole voxels.
fn stepped() -> TriangleMesh {
    let profile = [[0.0, 0.0], [4e-3, 0.0], [4e-3, 2e-3], [2e-3, 2e-3], [2e-3, 4e-3], [0.0, 4e-3]];
    let n = profile.len() as u32;
    let at = |height: f64| profile.map(|[x, z]| DVec3::new(x, height, z));
    let vertices = [at(0.0), at(3e-3)].concat();
    let mut triangles: Vec<[u32; 3]> = (0..n)
        .flat_map(|k| [[k, n + k, n + (k + 1) % n], [k, n + (k + 1) % n, (k + 1) % n]])
        .collect();
    for [a, b, c] in [[0, 1, 3], [1, 2, 3], [0, 3, 5], [3, 4, 5]] {
        triangles.push([a, b, c]);
        triangles.push([n + c, n + b, n + a]);
    }
    TriangleMesh { vertices, triangles }
}
