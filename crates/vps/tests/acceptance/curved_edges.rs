//! The force on round edges and in inner edges of an obstacle, against the law by quadrature.

use core::f64::consts::TAU;

use glam::{DQuat, DVec2, DVec3};
use vps::contact::{ContactSum, ForceLaw, Obstacle};
use vps::mesh::TriangleMesh;
use vps::pointshell::{Points, build_with};
use vps::spatial::Pose;
use vps::spatial::testing::Random;

use super::build;
use super::creases::{assert_walked_alike, percentile, rotation};

const S: f64 = 5e-4;

/// A part over a profile, from z = -half to half; corners counter-clockwise.
struct Prism {
    profile: Vec<DVec2>,
    half: f64,
    /// Where it stands in its grid.
    turn: DQuat,
    aside: DVec3,
}

impl Prism {
    fn new(profile: &[[f64; 2]], half: f64, random: &mut Random) -> Self {
        Self {
            profile: profile.iter().map(|[x, y]| DVec2::new(*x, *y) * S).collect(),
            half: half * S,
            turn: rotation(random),
            aside: random.in_box(-S, S),
        }
    }

    /// `lids`: triangles of the profile.
    fn mesh(&self, lids: &[[u32; 3]]) -> TriangleMesh {
        let n = self.profile.len() as u32;
        let at = |z: f64| {
            self.profile.iter().map(move |p| self.turn * DVec3::new(p.x, p.y, z) + self.aside)
        };
        let vertices = at(-self.half).chain(at(self.half)).collect();
        let sides = (0..n).flat_map(|k| {
            let next = (k + 1) % n;
            [[k, next, n + next], [k, n + next, n + k]]
        });
        let lids = lids.iter().flat_map(|[a, b, c]| [[*a, *c, *b], [n + a, n + b, n + c]]);
        TriangleMesh { vertices, triangles: sides.chain(lids).collect() }
    }

    /// Inside, m; outside 0 or less.
    fn depth(&self, at: DVec3) -> f64 {
        let at = self.turn.inverse() * (at - self.aside);
        let p = at.truncate();
        let mut nearest = f64::INFINITY;
        let mut crossings = 0;
        for (a, b) in self.profile.iter().zip(self.profile.iter().cycle().skip(1)) {
            let t = ((p - *a).dot(*b - *a) / (*b - *a).length_squared()).clamp(0.0, 1.0);
            nearest = nearest.min(p.distance(a.lerp(*b, t)));
            if (a.y > p.y) != (b.y > p.y) && p.x < a.x + (p.y - a.y) / (b.y - a.y) * (b.x - a.x) {
                crossings += 1;
            }
        }
        let inside = if crossings % 2 == 1 { nearest } else { -nearest };
        inside.min(self.half - at.z.abs())
    }
}

/// Points of the surface of a tool with their areas times inward normals.
fn samples(tool: &TriangleMesh, h: f64) -> Vec<(DVec3, DVec3)> {
    let mut found = Vec::new();
    for triangle in 0..tool.triangles.len() {
        let mut left = vec![tool.corners(triangle)];
        while let Some([a, b, c]) = left.pop() {
            let sides = [[a, b, c], [b, c, a], [c, a, b]];
            let length = |side: &[DVec3; 3]| side[0].distance(side[1]);
            let long = sides.into_iter().max_by(|one, other| length(one).total_cmp(&length(other)));
            let Some([a, b, c]) = long else { continue };
            if a.distance(b) > h {
                let middle = (a + b) / 2.0;
                left.extend([[a, middle, c], [middle, b, c]]);
            } else {
                found.push(((a + b + c) / 3.0, -(b - a).cross(c - a) / 2.0));
            }
        }
    }
    found
}

/// What of a tool's surface is in an obstacle, in a field of its depths.
struct Exact<'a> {
    samples: Vec<(DVec3, DVec3)>,
    coarse: Vec<DVec3>,
    depth: &'a dyn Fn(DVec3) -> f64,
}

impl<'a> Exact<'a> {
    fn new(tool: &TriangleMesh, depth: &'a dyn Fn(DVec3) -> f64) -> Self {
        let coarse = samples(tool, S / 2.0).into_iter().map(|(at, _)| at).collect();
        Self { samples: samples(tool, S / 6.0), coarse, depth }
    }

    fn law(&self, pose: Pose) -> DVec3 {
        let mut force = DVec3::ZERO;
        for (at, area) in &self.samples {
            force += *area * (self.depth)(pose.transform_point(*at)).max(0.0);
        }
        pose.rotation * force * (ForceLaw::PLAIN.stiffness_n_per_m / (S * S))
    }

    /// The pose at which a tool is first so deep on its way.
    fn sunk(&self, mut pose: Pose, way: DVec3, depth_m: f64) -> Pose {
        // Depths change by no more than the way.
        for _ in 0..9 {
            let depths = self.coarse.iter().map(|at| (self.depth)(pose.transform_point(*at)));
            let left_m = depth_m - depths.fold(f64::NEG_INFINITY, f64::max);
            pose.translation += way * left_m;
        }
        pose
    }
}

/// Poses one, a half and a quarter of a voxel deep; direction within 2°, 3° and 4° of the law for
/// 95 %, size within 10 % for 90 %, and a tenth of a voxel before it touches less than a twentieth
/// of the force.
fn assert_by_the_law(
    name: &str,
    obstacle: &TriangleMesh,
    tool: &TriangleMesh,
    depth: &dyn Fn(DVec3) -> f64,
    start: &mut dyn FnMut() -> (Pose, DVec3),
) {
    const POSES: u32 = 12;
    let field = build(obstacle, S, 8).field(obstacle, false);
    let obstacles = vec![Obstacle { field, world_from_map: Pose::IDENTITY }];
    let exact = Exact::new(tool, depth);
    // Points of the tool so many voxels apart.
    for (apart, depth_voxels, most_deg) in [(1.0, 1.0, 2.0), (1.0, 0.5, 3.0), (0.5, 0.25, 4.0)] {
        let map = build(tool, apart * S, 3);
        let shell = build_with(Points::Facets, tool, &map, DVec3::ZERO).0;
        let force = |pose| {
            let sum = ContactSum::flat(&obstacles, &shell, pose, ForceLaw::PLAIN);
            sum.wrench.force * (apart * apart)
        };
        let mut angles_deg = Vec::new();
        let mut sizes = Vec::new();
        let mut early = Vec::new();
        for _ in 0..POSES {
            let (pose, way) = start();
            let pose = exact.sunk(pose, way, depth_voxels * S);
            let law = exact.law(pose);
            let felt = force(pose);
            assert_walked_alike(&obstacles, &shell, pose);
            angles_deg.push(felt.angle_between(law).to_degrees());
            sizes.push(felt.length() / law.length());
            let out = exact.sunk(pose, way, -0.1 * S);
            early.push(force(out).length() / law.length());
        }
        let p95_deg = percentile(&mut angles_deg, 0.95);
        let [least, most] = [0.05, 0.95].map(|share| percentile(&mut sizes, share));
        let early = percentile(&mut early, 0.95);
        eprintln!(
            "{name}, points {apart} voxels apart, {depth_voxels} voxels deep: p95 {p95_deg:.2}°, \
                {least:.3} to {most:.3} of the law, {early:.3} of it before it touches"
        );
        assert!(p95_deg < most_deg && least > 0.9 && most < 1.1 && early < 0.05, "{name}");
    }
}

/// A cylinder along z in facets.
fn cylinder(radius: f64, half: f64, random: &mut Random) -> (Prism, TriangleMesh) {
    let profile: Vec<[f64; 2]> = (0..SIDES)
        .map(|k| {
            let (sin, cos) = (TAU * f64::from(k) / f64::from(SIDES)).sin_cos();
            [radius * cos, radius * sin]
        })
        .collect();
    let lids: Vec<[u32; 3]> = (1..SIDES - 1).map(|k| [0, k, k + 1]).collect();
    let prism = Prism::new(&profile, half, random);
    let mesh = prism.mesh(&lids);
    (prism, mesh)
}

const SIDES: u32 = 64;

/// How deep a place is in a cylinder of so many voxels, in its own frame, m.
fn depth_in_cylinder(radius: f64, half: f64, at: DVec3) -> f64 {
    let sector = TAU / f64::from(SIDES);
    let angle = at.y.atan2(at.x).rem_euclid(sector) - sector / 2.0;
    let across = at.truncate().length() * angle.cos();
    (radius * S * (sector / 2.0).cos() - across).min(half * S - at.z.abs())
}

#[test]
fn rims_of_cylinders_press_on_each_other_by_the_law() {
    let mut random = Random(5);
    for radius in [12.0, 6.0] {
        let (prism, mesh) = cylinder(radius, 6.0, &mut random);
        let (_, tool) = cylinder(8.0, 4.0, &mut random);
        let Prism { turn, aside, .. } = prism;
        let depth = |at: DVec3| depth_in_cylinder(radius, 6.0, turn.inverse() * (at - aside));
        let mut start = || {
            let (sin, cos) = (TAU * random.unit()).sin_cos();
            let rim = turn * DVec3::new(radius * cos, radius * sin, 6.0) * S + aside;
            let out = turn * DVec3::new(cos, sin, 1.0).normalize();
            (Pose::new(rotation(&mut random), rim + out * 8e-3), -out)
        };
        assert_by_the_law(
            &format!("rim of {radius} on rim of 8"),
            &mesh,
            &tool,
            &depth,
            &mut start,
        );
    }
}

/// A part with a hole: the rim curves the other way.
#[test]
fn the_rim_of_a_hole_presses_by_the_law() {
    const RADIUS: f64 = 9.0;
    let mut random = Random(6);
    let ring = |radius: f64| -> Vec<[f64; 2]> {
        let angles = (0..SIDES).map(|k| TAU * f64::from(k) / f64::from(SIDES));
        angles.map(|angle| [radius * angle.cos(), radius * angle.sin()]).collect()
    };
    let hole = ring(RADIUS);
    let prism = Prism::new(&[ring(20.0), hole.clone()].concat(), 6.0, &mut random);
    let mesh = {
        let n = 2 * SIDES;
        let lids: Vec<[u32; 3]> = (0..SIDES)
            .flat_map(|k| {
                let next = (k + 1) % SIDES;
                [[k, next, SIDES + next], [k, SIDES + next, SIDES + k]]
            })
            .collect();
        let mut mesh = prism.mesh(&lids);
        // Sides of the outer and of the inner ring, which faces inwards.
        mesh.triangles.drain(..2 * n as usize);
        for k in 0..SIDES {
            let next = (k + 1) % SIDES;
            mesh.triangles.extend([[k, next, n + next], [k, n + next, n + k]]);
            let [k, next] = [SIDES + next, SIDES + k];
            mesh.triangles.extend([[k, next, n + next], [k, n + next, n + k]]);
        }
        mesh
    };
    let Prism { turn, aside, .. } = prism;
    let depth = |at: DVec3| {
        let at = turn.inverse() * (at - aside);
        let p = at.truncate() / S;
        let round = hole
            .iter()
            .zip(hole.iter().cycle().skip(1))
            .map(|(a, b)| {
                let [a, b] = [DVec2::from_array(*a), DVec2::from_array(*b)];
                let share = ((p - a).dot(b - a) / (b - a).length_squared()).clamp(0.0, 1.0);
                p.distance(a.lerp(b, share))
            })
            .fold(f64::INFINITY, f64::min);
        let sector = TAU / f64::from(SIDES);
        let angle = p.y.atan2(p.x).rem_euclid(sector) - sector / 2.0;
        let is_in_hole = p.length() * angle.cos() < RADIUS * (sector / 2.0).cos();
        let aside = if is_in_hole { -round } else { round };
        S * aside
            .min(6.0 - at.z.abs() / S)
            .min(20.0 * (sector / 2.0).cos() - p.length() * angle.cos())
    };
    let (_, tool) = cylinder(5.0, 4.0, &mut random);
    let mut start = || {
        let (sin, cos) = (TAU * random.unit()).sin_cos();
        let rim = turn * DVec3::new(RADIUS * cos, RADIUS * sin, 6.0) * S + aside;
        let out = turn * DVec3::new(-0.6 * cos, -0.6 * sin, 1.0).normalize();
        (Pose::new(rotation(&mut random), rim + out * 5e-3), -out)
    };
    assert_by_the_law("rim of a hole of 9", &mesh, &tool, &depth, &mut start);
}

/// In an inner edge interpolation pushed before anything touched, and sideways.
#[test]
fn a_wedge_in_a_groove_presses_by_the_law() {
    let mut random = Random(7);
    let groove = [
        [-16.0, -16.0],
        [16.0, -16.0],
        [16.0, 0.0],
        [8.0, 0.0],
        [0.0, -8.0],
        [-8.0, 0.0],
        [-16.0, 0.0],
    ];
    let lids = [[0, 1, 4], [1, 2, 3], [1, 3, 4], [0, 4, 5], [0, 5, 6]];
    let wedge = [[-4.0, 5.0], [0.0, -5.0], [4.0, 5.0]];
    let groove = Prism::new(&groove, 12.0, &mut random);
    let wedge = Prism::new(&wedge, 5.0, &mut random);
    let Prism { turn, aside, .. } = groove;
    let mut start = || {
        let tilt = DQuat::from_scaled_axis(random.in_box(-0.15, 0.15));
        let turned = turn * tilt * wedge.turn.inverse();
        let tip = DVec3::new(0.0, -8.0, 0.0) + DVec3::Y * 4.0 + random.in_box(-0.3, 0.3);
        let own_tip = wedge.turn * DVec3::new(0.0, -5.0, 0.0) * S + wedge.aside;
        (Pose::new(turned, turn * tip * S + aside - turned * own_tip), -(turn * DVec3::Y))
    };
    let meshes = [groove.mesh(&lids), wedge.mesh(&[[0, 1, 2]])];
    let depth = |at: DVec3| groove.depth(at);
    assert_by_the_law("wedge in a groove", &meshes[0], &meshes[1], &depth, &mut start);
}
