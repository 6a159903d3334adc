//! The force of a part on the edges and corners of another one, against the law: of two convex parts
//! it is an integral over polygons, which has no error.

use glam::{DQuat, DVec3};
use vps::contact::{ContactSum, ForceLaw, Obstacle, SimdLevel, Traversal, TraversalMode};
use vps::mesh::TriangleMesh;
use vps::mesh::primitives::Shape;
use vps::pointshell::{Points, build_with, shell::Shell};
use vps::spatial::testing::Random;
use vps::spatial::{Pose, Wrench};

use super::{Work, build, work_of_closed_path};

const S: f64 = 5e-4;

/// A convex part.
struct Part {
    mesh: TriangleMesh,
    /// Normals out of it, and offsets.
    planes: Vec<(DVec3, f64)>,
}

impl Part {
    fn new(mesh: TriangleMesh) -> Self {
        let mut planes: Vec<(DVec3, f64)> = Vec::new();
        for triangle_idx in 0..mesh.triangles.len() {
            let [a, b, c] = mesh.corners(triangle_idx);
            let normal = (b - a).cross(c - a).normalize();
            if !planes.iter().any(|(known, _)| known.dot(normal) > 1.0 - 1e-9) {
                planes.push((normal, normal.dot(a)));
            }
        }
        Self { mesh, planes }
    }

    /// A box as it happens to lie in its grid.
    fn block(size_m: DVec3, random: &mut Random) -> Self {
        let turn = rotation(random);
        let aside = random.in_box(-S, S);
        let mut mesh = Shape::Box { size_m }.tessellate(0.0);
        mesh.vertices.iter_mut().for_each(|vertex| *vertex = turn * *vertex + aside);
        Self::new(mesh)
    }

    /// A rod with six sides, which turn by 60°, likewise.
    fn rod(random: &mut Random) -> Self {
        let turn = rotation(random);
        let ring = |z: f64| {
            (0..6).map(move |k| {
                let angle = core::f64::consts::TAU * f64::from(k) / 6.0;
                DVec3::new(4e-3 * angle.cos(), 4e-3 * angle.sin(), z)
            })
        };
        let vertices = ring(-5e-3).chain(ring(5e-3)).map(|vertex| turn * vertex).collect();
        let sides = (0..6_u32)
            .flat_map(|k| [[k, (k + 1) % 6, 6 + k], [(k + 1) % 6, 6 + (k + 1) % 6, 6 + k]]);
        let lids = (1..5_u32).flat_map(|k| [[0, k + 1, k], [6, 6 + k, 7 + k]]);
        Self::new(TriangleMesh { vertices, triangles: sides.chain(lids).collect() })
    }

    fn obstacle(&self) -> Vec<Obstacle> {
        let field = build(&self.mesh, S, 8).field(&self.mesh, false);
        vec![Obstacle { field, world_from_map: Pose::IDENTITY }]
    }

    fn tool(&self) -> Shell {
        build_with(Points::Facets, &self.mesh, &build(&self.mesh, S, 3), DVec3::ZERO).0
    }

    /// The law: K/s² times the integral of depth over what of a tool's surface is in this part.
    fn law(&self, tool: &TriangleMesh, pose: Pose) -> Wrench {
        let mut force = DVec3::ZERO;
        let mut torque = DVec3::ZERO;
        for triangle_idx in 0..tool.triangles.len() {
            let corners = tool.corners(triangle_idx).map(|corner| pose.transform_point(corner));
            let inward = -(corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize();
            for (own, offset) in &self.planes {
                let depth = |at: DVec3| offset - own.dot(at);
                let mut piece = clipped(&corners, depth);
                for (other, other_offset) in &self.planes {
                    piece = clipped(&piece, |at| other_offset - other.dot(at) - depth(at));
                }
                for pair in piece.get(1..).unwrap_or(&[]).windows(2) {
                    let [a, b, c] = [piece[0], pair[0], pair[1]];
                    let third = (b - a).cross(c - a).length() / 6.0;
                    for at in [(a + b) / 2.0, (b + c) / 2.0, (c + a) / 2.0] {
                        force += inward * (third * depth(at));
                        torque += (at - pose.translation).cross(inward) * (third * depth(at));
                    }
                }
            }
        }
        Wrench::new(force, torque) * (ForceLaw::PLAIN.stiffness_n_per_m / (S * S))
    }

    /// How deep the tool is at most, over its own corners and the crossings of its edges.
    fn deepest_m(&self, tool: &TriangleMesh, pose: Pose) -> f64 {
        let mut deepest_m = f64::NEG_INFINITY;
        for triangle_idx in 0..tool.triangles.len() {
            let corners = tool.corners(triangle_idx).map(|corner| pose.transform_point(corner));
            // Of concave depth on a triangle the most is found by halving it.
            let mut triangles = vec![corners];
            let depth = |at: DVec3| {
                self.planes.iter().map(|(n, c)| c - n.dot(at)).fold(f64::INFINITY, f64::min)
            };
            for _ in 0..14 {
                let mut halves: Vec<[DVec3; 3]> = Vec::new();
                for [a, b, c] in triangles {
                    let sides = [(a, b, c), (b, c, a), (c, a, b)];
                    let long = sides.into_iter().max_by(|one, other| {
                        one.0.distance(one.1).total_cmp(&other.0.distance(other.1))
                    });
                    let Some((a, b, c)) = long else { continue };
                    let middle = (a + b) / 2.0;
                    deepest_m = deepest_m.max(depth(a)).max(depth(b)).max(depth(c));
                    halves.extend([[a, middle, c], [middle, b, c]]);
                }
                halves.retain(|[a, b, c]| {
                    let center = (*a + *b + *c) / 3.0;
                    let radius = [a, b, c].map(|at| at.distance(center));
                    depth(center) + radius.into_iter().fold(0.0, f64::max) > deepest_m
                });
                triangles = halves;
            }
        }
        deepest_m
    }

    /// The pose, moved along `way`, at which a tool is so deep.
    fn sunk(&self, tool: &TriangleMesh, pose: Pose, way: DVec3, depth_m: f64) -> Pose {
        let moved = |by_m: f64| Pose::new(pose.rotation, pose.translation + way * by_m);
        let mut out_m = -0.02;
        let mut in_m = 0.02;
        for _ in 0..40 {
            let middle_m = (out_m + in_m) / 2.0;
            if self.deepest_m(tool, moved(middle_m)) < depth_m {
                out_m = middle_m;
            } else {
                in_m = middle_m;
            }
        }
        moved(out_m)
    }
}

pub(super) fn rotation(random: &mut Random) -> DQuat {
    DQuat::from_xyzw(random.signed(), random.signed(), random.signed(), random.signed()).normalize()
}

/// What of a convex polygon lies where `value`, which is linear, is not negative.
fn clipped(polygon: &[DVec3], value: impl Fn(DVec3) -> f64) -> Vec<DVec3> {
    let mut kept = Vec::new();
    for (from, to) in polygon.iter().zip(polygon.iter().cycle().skip(1)) {
        let from_value = value(*from);
        let to_value = value(*to);
        if from_value >= 0.0 {
            kept.push(*from);
        }
        if (from_value < 0.0) != (to_value < 0.0) {
            kept.push(from.lerp(*to, from_value / (from_value - to_value)));
        }
    }
    kept
}

/// Every bit is that of the specification, whatever instructions there are, all over and down the tree.
pub(super) fn assert_walked_alike(obstacles: &[Obstacle], shell: &Shell, pose: Pose) {
    let flat = ContactSum::flat(obstacles, shell, pose, ForceLaw::PLAIN);
    for level in SimdLevel::available() {
        for mode in [TraversalMode::Flat, TraversalMode::Tree] {
            let mut traversal = Traversal::new(level, mode, obstacles, shell);
            let walked =
                ContactSum::of(&mut traversal, obstacles, shell, pose, ForceLaw::PLAIN, None);
            assert_eq!(walked.contacts, flat.contacts, "{level:?} {mode:?} at {pose:?}");
            assert_eq!(walked.wrench, flat.wrench, "{level:?} {mode:?} at {pose:?}");
            assert_eq!(walked.stiffness, flat.stiffness, "{level:?} {mode:?} at {pose:?}");
            assert_eq!(walked.max_value_m, flat.max_value_m, "{level:?} {mode:?} at {pose:?}");
        }
    }
}

pub(super) fn percentile(of: &mut [f64], share: f64) -> f64 {
    of.sort_by(f64::total_cmp);
    of[((of.len() - 1) as f64 * share) as usize]
}

/// Boxes and a rod with six sides on the edges and corners of one another, in any attitude.
#[test]
fn edges_and_corners_on_edges_press_by_the_law_down_to_a_quarter_of_a_voxel() {
    // Points of the tool so many voxels apart.
    for (apart, depth_voxels, most_deg, off, torque_off) in [
        (1.0, 1.0, 1.0, 0.02, 0.03),
        (1.0, 0.5, 2.0, 0.03, 0.05),
        (1.0, 0.25, 3.0, 0.1, 0.1),
        (2.0, 1.0, 2.0, 0.03, 0.05),
        (2.0, 0.25, 4.0, 0.1, 0.15),
    ] {
        let mut random = Random(4118);
        let mut angles_deg = Vec::new();
        let mut sizes = Vec::new();
        let mut torques = Vec::new();
        for n in 0..12 {
            let block = Part::block(DVec3::new(12e-3, 10e-3, 9e-3), &mut random);
            let other = match n % 3 {
                0 => Part::rod(&mut random),
                _ => Part::block(DVec3::new(6e-3, 8e-3, 7e-3), &mut random),
            };
            let obstacles = block.obstacle();
            let map = build(&other.mesh, apart * S, 3);
            let shell = build_with(Points::Facets, &other.mesh, &map, DVec3::ZERO).0;
            for _ in 0..8 {
                let way = -random.in_box(-1.0, 1.0).normalize();
                let pose = Pose::new(rotation(&mut random), random.in_box(-1e-3, 1e-3));
                let pose = block.sunk(&other.mesh, pose, way, depth_voxels * S);
                let felt = ContactSum::flat(&obstacles, &shell, pose, ForceLaw::PLAIN).wrench;
                assert_walked_alike(&obstacles, &shell, pose);
                let law = block.law(&other.mesh, pose) * (1.0 / (apart * apart));
                angles_deg.push(felt.force.angle_between(law.force).to_degrees());
                sizes.push(felt.force.length() / law.force.length());
                torques.push((felt.torque - law.torque).length() / (4e-3 * law.force.length()));
            }
        }
        let p95_deg = percentile(&mut angles_deg, 0.95);
        let median_deg = percentile(&mut angles_deg, 0.5);
        let [least, most] = [0.05, 0.95].map(|share| percentile(&mut sizes, share));
        let torque = percentile(&mut torques, 0.95);
        eprintln!(
            "points {apart} voxels apart, edges and corners {depth_voxels} voxels deep: {median_deg:.3}° in the median, p95 \
                {p95_deg:.2}°, {least:.3} to {most:.3} of the law, torque {torque:.3}"
        );
        assert!(
            p95_deg < most_deg
                && (least - 1.0).abs().max((most - 1.0).abs()) < off
                && torque < torque_off
        );
    }
}

/// The law is the gradient of an energy: what a closed path over edges and corners takes, it gives
/// back.
#[test]
fn a_closed_path_over_the_edges_of_a_block_does_no_work() {
    const TICKS: u32 = 2000;
    let mut random = Random(12);
    let block = Part::block(DVec3::new(12e-3, 10e-3, 9e-3), &mut random);
    let other = Part::block(DVec3::new(6e-3, 8e-3, 7e-3), &mut random);
    let obstacles = block.obstacle();
    let shell = other.tool();
    for _ in 0..3 {
        let way = -random.in_box(-1.0, 1.0).normalize();
        let start = Pose::new(rotation(&mut random), random.in_box(-1e-3, 1e-3));
        let start = block.sunk(&other.mesh, start, way, 0.6 * S);
        let aside = way.any_orthonormal_vector();
        let pose = |tick: u32| {
            let phase = core::f64::consts::TAU * f64::from(tick) / f64::from(TICKS);
            let by = way * (0.5 * S * phase.sin()) + aside * (3.0 * S * (2.0 * phase).sin());
            let turn =
                DQuat::from_scaled_axis(aside * (0.1 * phase.cos()) + way * 0.2 * phase.sin());
            Pose::new(turn * start.rotation, start.translation + by)
        };
        let Work { share, amounts_j } = work_of_closed_path(&obstacles, &shell, TICKS, pose);
        eprintln!("a closed path over edges: {:.3} % of {:.2} µJ", 100.0 * share, 1e6 * amounts_j);
        assert!(share < 0.01 && amounts_j > 1e-9, "{share} of {amounts_j}");
    }
}

/// Planes are those of faces, which end: beyond the end of a bar that is thinner than a voxel nothing
/// is felt.
#[test]
fn nothing_is_felt_beyond_the_end_of_a_thin_bar() {
    let mut random = Random(77);
    for _ in 0..12 {
        let size_m = DVec3::new(10.0, 4.4 * random.unit(), 0.4 + 1.5 * random.unit()) * S;
        let aside = DVec3::from_array([(); 3].map(|()| S * random.signed()));
        let mut mesh = Shape::Box { size_m }.tessellate(0.0);
        mesh.vertices.iter_mut().for_each(|vertex| *vertex += aside);
        let obstacles = Part::new(mesh).obstacle();
        let shell = Part::block(DVec3::splat(8.0 * S), &mut random).tool();
        for _ in 0..40 {
            let turn = rotation(&mut random);
            let reach_m = shell.points().map(|(at, _)| (turn * at.as_dvec3()).x);
            let reach_m = reach_m.fold(f64::INFINITY, f64::min);
            // Beside the end, by up to a voxel and a half.
            let gap_m = S * (0.15 + 1.35 * random.unit());
            let x_m = 0.5 * size_m.x + aside.x + gap_m - reach_m;
            let pose = Pose::new(turn, DVec3::new(x_m, S * random.signed(), S * random.signed()));
            let sum = ContactSum::flat(&obstacles, &shell, pose, ForceLaw::PLAIN);
            assert!(sum.wrench.force.length() == 0.0, "{size_m} {aside}, {gap_m}: {sum:?}");
        }
    }
}

/// Facets of a coarse tool reach farther than planes are known about a cell: on a narrow rib they press
/// with what they have of it.
#[test]
fn a_coarse_tool_on_a_narrow_rib_presses_with_the_rib() {
    let mut random = Random(78);
    let tool = Part::new(Shape::Box { size_m: DVec3::splat(12e-3) }.tessellate(0.0));
    for coarse in [1.0, 2.0, 4.0] {
        let map = build(&tool.mesh, coarse * S, 3);
        let shell = build_with(Points::Facets, &tool.mesh, &map, DVec3::ZERO).0;
        for width_voxels in [3.0, 8.0] {
            let mut offs = Vec::new();
            for _ in 0..8 {
                let size_m = DVec3::new(30e-3, width_voxels * S, 12.0 * S);
                let mut rib = Shape::Box { size_m }.tessellate(0.0);
                let aside = random.in_box(-S, S);
                rib.vertices.iter_mut().for_each(|vertex| *vertex += aside);
                let rib = Part::new(rib);
                let turn = DQuat::from_scaled_axis(DVec3::new(0.0, 0.02, 1.0) * random.signed());
                let pose = Pose::new(turn, random.in_box(-1e-3, 1e-3));
                let pose = rib.sunk(&tool.mesh, pose, DVec3::NEG_Z, 0.5 * S);
                let felt = ContactSum::flat(&rib.obstacle(), &shell, pose, ForceLaw::PLAIN);
                let law = rib.law(&tool.mesh, pose).force * (1.0 / (coarse * coarse));
                offs.push((felt.wrench.force - law).length() / law.length());
            }
            let p90 = percentile(&mut offs, 0.9);
            eprintln!("points of {coarse} voxels on a rib of {width_voxels}: {p90:.3} off the law");
            assert!(p90 < 0.02, "{coarse} {width_voxels}: {offs:?}");
        }
    }
}
