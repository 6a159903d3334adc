//! Parts, trajectories and closed forms of the benchmark. Lengths in metres; the part stands at the
//! origin of the scene.

use core::f64::consts::{FRAC_PI_2, PI, TAU};

use glam::{DQuat, DVec2, DVec3};

use super::super::curved;
use super::super::fixture::{self, Tube};
use super::super::law::{Solid, Surface};
use super::laws;
use crate::random::Random;
use vps::mesh::primitives::Shape;
use vps::mesh::{TriangleMesh, validate};
use vps::spatial::Pose;

/// Force of the closed forms for each m³ of [`laws`], N: 1 mm deep on 1 mm² is 0.01 N.
pub(super) const PRESSURE_N_PER_M3: f64 = 1e10;
/// Ticks of a trajectory, at 1 kHz.
pub(super) const TICKS: usize = 300;
/// How near a near miss is, m: a twentieth of the voxels of hapticd.
const NEAR_M: f64 = 1e-5;
/// Meshes are as near to their shapes as scenes with voxels of 0.1 mm ask for: 2 µm.
const FINE_M: f64 = 1e-4;

/// A force that is known, and a point of its line of action, at the contact.
#[derive(Clone, Copy, Debug)]
pub(super) struct Law {
    pub(super) force: DVec3,
    pub(super) point: DVec3,
}

impl Law {
    fn new(volume_m3: f64, direction: DVec3, point: DVec3) -> Self {
        Self { force: direction * (volume_m3 * PRESSURE_N_PER_M3), point }
    }

    /// What it does about a point, N·m.
    pub(super) fn torque(self, origin: DVec3) -> DVec3 {
        (self.point - origin).cross(self.force)
    }
}

/// One millisecond.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tick {
    pub(super) pose: Pose,
    pub(super) depth_m: f64,
    pub(super) law: Option<Law>,
}

/// What a trajectory is judged by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// The wrench changes slowly: ripple and steps.
    Steady,
    /// Pressed in and released: depth at a load.
    Press,
    /// Ends where it begins: work.
    Loop,
    /// Passes by without a contact: a force is wrong.
    NearMiss,
}

#[derive(Debug)]
pub(super) struct Trajectory {
    pub(super) name: &'static str,
    pub(super) kind: Kind,
    pub(super) ticks: Vec<Tick>,
}

impl Trajectory {
    /// `at`: what the tool does where this share of the trajectory, from 0 to 1, is over.
    fn new(name: &'static str, at: impl Fn(f64) -> Tick) -> Self {
        let kind = match name {
            "press" => Kind::Press,
            "near miss" => Kind::NearMiss,
            _ => Kind::Steady,
        };
        Self { name, kind, ticks: (0..TICKS).map(|n| at(n as f64 / (TICKS - 1) as f64)).collect() }
    }

    /// Around a closed path in contact: `aside` to each side and a turn of half a degree, while the
    /// depth goes from a third to five thirds.
    fn around(middle: Tick, into_part: DVec3, aside: DVec3) -> Self {
        let at = |share: f64| {
            let (sin, cos) = (TAU * share).sin_cos();
            let depth_m = middle.depth_m * (1.0 + 2.0 / 3.0 * sin);
            let turn = DQuat::from_axis_angle(
                into_part.any_orthonormal_vector(),
                0.5_f64.to_radians() * cos,
            );
            let moved =
                middle.pose.translation + aside * cos + into_part * (depth_m - middle.depth_m);
            Tick { pose: Pose::new(turn * middle.pose.rotation, moved), depth_m, law: None }
        };
        Self { kind: Kind::Loop, ..Self::new("loop", at) }
    }
}

#[derive(Debug)]
pub(super) struct Scene {
    pub(super) name: &'static str,
    pub(super) part: TriangleMesh,
    pub(super) tool: TriangleMesh,
    pub(super) trajectories: Vec<Trajectory>,
}

impl Scene {
    pub(super) fn ticks(&self) -> impl Iterator<Item = &Tick> {
        self.trajectories.iter().flat_map(|trajectory| &trajectory.ticks)
    }

    /// Whether a trajectory is judged with the closed form of its scene: the loop is, for its work.
    pub(super) fn has_law(&self, trajectory: &Trajectory) -> bool {
        let is_known = |of: &Trajectory| of.ticks[0].law.is_some();
        is_known(trajectory)
            || trajectory.kind == Kind::Loop && self.trajectories.iter().any(is_known)
    }

    /// Whether a tip, an edge or a wedge touches.
    pub(super) fn is_sharp(&self) -> bool {
        SHARP.contains(&self.name)
    }

    /// Both meshes turned at random about their origins and the poses with them: no grid lies along
    /// a face.
    fn turned(mut self, seed: u64) -> Self {
        let mut random = Random::new(seed);
        let of_part = curved::turn(&mut random);
        let of_tool = curved::turn(&mut random);
        self.part = fixture::turned(self.part, of_part);
        self.tool = fixture::turned(self.tool, of_tool);
        let world_from_scene = Pose::new(of_part, DVec3::ZERO);
        let tool_from_turned = Pose::new(of_tool.inverse(), DVec3::ZERO);
        for tick in self.trajectories.iter_mut().flat_map(|trajectory| &mut trajectory.ticks) {
            tick.pose = world_from_scene * tick.pose * tool_from_turned;
            tick.law =
                tick.law.map(|law| Law { force: of_part * law.force, point: of_part * law.point });
        }
        self
    }
}

/// Scenes in which a tip, an edge or a wedge touches.
const SHARP: [&str; 5] =
    ["wedge-in-groove", "cone-on-plane", "corner-on-plane", "box-on-cone", "crossed-edges"];

/// Every scene with a closed form.
pub(super) fn closed_forms() -> Vec<Scene> {
    let scenes = [
        cone_in_pit(),
        cylinder_in_slot(),
        ball_in_half_pipe(),
        box_on_edge(),
        pin_in_bore(),
        ball_on_ball(),
        wedge_in_groove(),
        cone_on_plane(),
        corner_on_plane(),
        box_on_cone(),
        crossed_edges(),
    ];
    scenes.into_iter().zip(2024..).map(|(scene, seed)| scene.turned(seed)).collect()
}

/// Scenes of shapes for which no closed form is known.
pub(super) fn without_closed_form() -> Vec<Scene> {
    vec![cylinder_rims().turned(4024)]
}

/// From 0 to 1 and back, without a corner.
fn there_and_back(share: f64) -> f64 {
    0.5 * (1.0 - (TAU * share).cos())
}

fn cone_in_pit() -> Scene {
    const HALF_ANGLE: f64 = 20.0 * PI / 180.0;
    const HEIGHT: f64 = 8e-3;
    const BOTTOM: f64 = 3e-3;
    let radius = |z: f64| BOTTOM + z * HALF_ANGLE.tan();
    // The flank of the pit is longer than that of the cone at both ends, and the apex is cut off:
    // depth is that of the flank.
    let tube = Tube {
        inner_m: 4e-3,
        outer_m: 0.012,
        height_m: 0.012,
        sides: Tube::sides_for(radius(HEIGHT), FINE_M),
        pieces: [1, 1],
    };
    let mut part = tube.mesh();
    for vertex in part.vertices.iter_mut() {
        vertex.z += 0.5 * HEIGHT;
        let around = vertex.truncate();
        if around.length() < 8e-3 {
            *vertex = (around.normalize() * radius(vertex.z)).extend(vertex.z);
        }
    }
    let mut tool = fixture::tessellated(
        Shape::Cylinder { radius_m: radius(HEIGHT), height_m: HEIGHT },
        FINE_M,
    );
    for vertex in &mut tool.vertices {
        *vertex =
            (vertex.truncate() * radius(vertex.z + 0.5 * HEIGHT) / radius(HEIGHT)).extend(vertex.z);
    }
    let at = |lowered: f64, angle: f64| {
        let volume = laws::frustum_in_hole([BOTTOM, radius(HEIGHT)], HALF_ANGLE, lowered);
        let middle = DVec3::Z * (0.5 * HEIGHT);
        let pose = Pose::new(DQuat::from_rotation_z(angle), middle - DVec3::Z * lowered);
        Tick {
            pose,
            depth_m: lowered * HALF_ANGLE.sin(),
            law: Some(Law::new(volume, DVec3::Z, middle)),
        }
    };
    let trajectories = vec![
        Trajectory::new("press", |share| at(0.6e-3 * there_and_back(share), 0.3)),
        Trajectory::new("spin", |share| at(0.4e-3, PI * share)),
        Trajectory::around(at(0.4e-3, 0.0), DVec3::NEG_Z, DVec3::X * 4e-5),
    ];
    Scene { name: "cone-in-pit", part, tool, trajectories }
}

fn cylinder_in_slot() -> Scene {
    const RADIUS: f64 = 4e-3;
    const LENGTH: f64 = 0.012;
    const HALF_WIDTH: f64 = 4.2e-3;
    const FLOOR: f64 = 4e-3;
    const TOP: f64 = 0.012;
    const OUTER: f64 = 0.01;
    let at_xz = |places: [[f64; 2]; 4]| places.map(DVec2::from_array);
    let part = channel(
        &at_xz([[-HALF_WIDTH, TOP], [-HALF_WIDTH, FLOOR], [HALF_WIDTH, FLOOR], [HALF_WIDTH, TOP]]),
        &at_xz([[-OUTER, TOP], [-OUTER, 0.0], [OUTER, 0.0], [OUTER, TOP]]),
        0.036,
    );
    let lying = DQuat::from_rotation_x(FRAC_PI_2);
    let at = |[in_floor, in_wall]: [f64; 2], along: f64, angle: f64| {
        let axis = DVec3::new(HALF_WIDTH - RADIUS + in_wall, along, FLOOR + RADIUS - in_floor);
        let push =
            DVec3::new(-laws::segment(RADIUS, in_wall), 0.0, laws::segment(RADIUS, in_floor))
                * LENGTH;
        let pose = Pose::new(DQuat::from_rotation_y(angle) * lying, axis);
        Tick { pose, depth_m: in_floor.max(in_wall), law: Some(Law::new(1.0, push, axis)) }
    };
    let depths = [1.5e-4, 1e-4];
    let trajectories = vec![
        Trajectory::new("press", |share| {
            at([2e-4 * there_and_back(share), 1e-4 * there_and_back(share)], 0.0, 0.3)
        }),
        Trajectory::new("slide", |share| at(depths, 0.015 * (share - 0.5), 0.7)),
        Trajectory::new("spin", |share| at(depths, 1e-3, PI * share)),
        Trajectory::around(at(depths, 0.0, 0.0), DVec3::NEG_Z, DVec3::X * 8e-5),
    ];
    let tool = fixture::tessellated(Shape::Cylinder { radius_m: RADIUS, height_m: LENGTH }, FINE_M);
    Scene { name: "cylinder-in-slot", part, tool, trajectories }
}

fn ball_in_half_pipe() -> Scene {
    const BALL: f64 = 5e-3;
    const PIPE: f64 = 6.5e-3;
    const OUTER: f64 = 0.01;
    let n = Tube::sides_for(PIPE, FINE_M) / 2;
    let arc = |radius: f64| -> Vec<DVec2> {
        (0..=n).map(|k| DVec2::from_angle(PI * (1.0 + k as f64 / n as f64)) * radius).collect()
    };
    let part = channel(&arc(PIPE), &arc(OUTER), 0.04);
    let at = |depth: f64, along: f64, angle: f64, rotation: DQuat| {
        let into_wall = DVec3::new(angle.sin(), 0.0, -angle.cos());
        let offset = PIPE - BALL + depth;
        let center = into_wall * offset + DVec3::Y * along;
        let volume = laws::ball_in_groove(BALL, PIPE, offset);
        let law = Law::new(volume, -into_wall, into_wall * PIPE + DVec3::Y * along);
        Tick { pose: Pose::new(rotation, center), depth_m: depth, law: Some(law) }
    };
    let trajectories = vec![
        Trajectory::new("press", |share| {
            at(2e-4 * there_and_back(share), 0.0, 0.2, DQuat::IDENTITY)
        }),
        Trajectory::new("slide", |share| at(1.5e-4, 0.015 * (share - 0.5), 0.2, DQuat::IDENTITY)),
        Trajectory::new("spin", |share| at(1.5e-4, 1e-3, 0.0, DQuat::from_rotation_z(PI * share))),
        Trajectory::new("tumble", |share| {
            at(1.5e-4, 1e-3, 1.2 * (share - 0.5), oblique(PI * share))
        }),
        Trajectory::around(at(1.5e-4, 0.0, 0.0, DQuat::IDENTITY), DVec3::NEG_Z, DVec3::X * 2e-4),
    ];
    Scene { name: "sphere-in-half-pipe", part, tool: ball(BALL), trajectories }
}

fn box_on_edge() -> Scene {
    const SIZE: DVec3 = DVec3::new(0.012, 0.008, 0.01);
    let part = Shape::Box { size_m: DVec3::new(0.04, 0.04, 0.006) }.tessellate(0.0);
    let top = DVec3::Z * 3e-3;
    // The edge along x that is lowest, in the axes of the box.
    let of_box = DVec3::new(0.0, -0.5 * SIZE.y, -0.5 * SIZE.z);
    let at = |depth: f64, angle: f64, place: DVec3, yaw: f64| {
        let rotation = DQuat::from_rotation_z(yaw) * DQuat::from_rotation_x(angle);
        let edge = top + place - DVec3::Z * depth;
        let (area, aside) = laws::edge(depth, angle);
        // Of a triangle with one corner at the edge and two in the plane.
        let centroid = DVec3::new(0.0, aside, 2.0 / 3.0 * depth);
        let law = Law::new(area * SIZE.x, DVec3::Z, edge + DQuat::from_rotation_z(yaw) * centroid);
        Tick { pose: Pose::new(rotation, edge - rotation * of_box), depth_m: depth, law: Some(law) }
    };
    let angle = 35.0_f64.to_radians();
    let slid = |share: f64| DVec3::new(0.8, 0.6, 0.0) * 0.015 * (share - 0.5);
    let trajectories = vec![
        Trajectory::new("press", |share| at(4e-4 * there_and_back(share), angle, DVec3::ZERO, 0.2)),
        Trajectory::new("slide", |share| at(3e-4, angle, slid(share), 0.2)),
        Trajectory::new("spin", |share| at(3e-4, angle, DVec3::ZERO, PI * share)),
        Trajectory::new("tumble", |share| {
            at(3e-4, (20.0 + 50.0 * share).to_radians(), DVec3::ZERO, 0.2)
        }),
        Trajectory::around(at(3e-4, angle, DVec3::ZERO, 0.2), DVec3::NEG_Z, DVec3::Y * 3e-4),
    ];
    Scene {
        name: "box-on-edge",
        part,
        tool: Shape::Box { size_m: SIZE }.tessellate(0.0),
        trajectories,
    }
}

fn pin_in_bore() -> Scene {
    const PIN: f64 = 4e-3;
    const BORE: f64 = 4.2e-3;
    const LENGTH: f64 = 0.014;
    const HEIGHT: f64 = 0.024;
    let part = Tube {
        inner_m: BORE,
        outer_m: 9e-3,
        height_m: HEIGHT,
        sides: Tube::sides_for(BORE, FINE_M),
        pieces: [1, 1],
    }
    .mesh();
    let at = |depth: f64, along: f64, toward: f64, angle: f64| {
        let into_wall = DQuat::from_rotation_z(toward) * DVec3::X;
        let offset = BORE - PIN + depth;
        let volume = laws::crescent(PIN, BORE, offset) * LENGTH;
        let law = Law::new(volume, -into_wall, into_wall * BORE + DVec3::Z * along);
        Tick {
            pose: Pose::new(DQuat::from_rotation_z(angle), into_wall * offset + DVec3::Z * along),
            depth_m: depth,
            law: Some(law),
        }
    };
    let tilted = |aside: f64, along: f64, tilt_deg: f64| Tick {
        pose: Pose::new(
            DQuat::from_rotation_y(tilt_deg.to_radians()),
            DVec3::new(aside, 0.0, along),
        ),
        depth_m: f64::NAN,
        law: None,
    };
    let above = 0.5 * (HEIGHT + LENGTH);
    let trajectories = vec![
        Trajectory::new("press", |share| at(1.5e-4 * there_and_back(share), 0.0, 0.4, 0.0)),
        Trajectory::new("slide", |share| at(1e-4, 9e-3 * (share - 0.5), 0.4, 0.0)),
        Trajectory::new("spin", |share| at(1e-4, 1e-3, 0.4, PI * share)),
        Trajectory::new("tumble", |share| at(1e-4, 1e-3, PI * share, -0.5 * PI * share)),
        Trajectory::new("insertion", |share| tilted(2e-4, above - 0.012 * share, 0.5)),
        Trajectory::new("jam", |share| tilted(2.5e-4, 1e-3, 2.0 * there_and_back(share))),
        Trajectory::around(at(1e-4, 0.0, 0.0, 0.0), DVec3::X, DVec3::Y * 8e-5),
    ];
    let tool = fixture::tessellated(Shape::Cylinder { radius_m: PIN, height_m: LENGTH }, FINE_M);
    Scene { name: "pin-in-bore", part, tool, trajectories }
}

fn ball_on_ball() -> Scene {
    const BALL: f64 = 5e-3;
    const OTHER: f64 = 0.01;
    let at = |depth: f64, outward: DVec3, rotation: DQuat| {
        let law = Law::new(laws::ball_in_ball(BALL, OTHER, depth), outward, outward * OTHER);
        Tick {
            pose: Pose::new(rotation, outward * (BALL + OTHER - depth)),
            depth_m: depth,
            law: Some(law),
        }
    };
    let trajectories = vec![
        Trajectory::new("press", |share| {
            at(2.5e-4 * there_and_back(share), DVec3::Z, DQuat::IDENTITY)
        }),
        Trajectory::new("slide", |share| {
            at(1.5e-4, oblique(1.3 * share) * DVec3::Z, DQuat::IDENTITY)
        }),
        Trajectory::new("spin", |share| at(1.5e-4, DVec3::Z, DQuat::from_rotation_z(PI * share))),
        Trajectory::new("tumble", |share| at(1.5e-4, DVec3::Z, oblique(PI * share))),
        Trajectory::around(at(1.5e-4, DVec3::Z, DQuat::IDENTITY), DVec3::NEG_Z, DVec3::X * 3e-4),
    ];
    Scene { name: "sphere-on-sphere", part: ball(OTHER), tool: ball(BALL), trajectories }
}

fn wedge_in_groove() -> Scene {
    const HALF_ANGLE: f64 = 30.0 * PI / 180.0;
    /// Where the flanks of the wedge begin and end, above the line in which they would meet.
    const ENDS: [f64; 2] = [4e-3, 0.01];
    const LENGTH: f64 = 0.012;
    let half_width = |z: f64| z * HALF_ANGLE.tan();
    let at_xz = |places: [[f64; 2]; 4]| places.map(DVec2::from_array);
    let [floor, top] = [2e-3, 0.012];
    let part = channel(
        &at_xz([
            [-half_width(top), top],
            [-half_width(floor), floor],
            [half_width(floor), floor],
            [half_width(top), top],
        ]),
        &at_xz([[-0.011, top], [-0.011, -2e-3], [0.011, -2e-3], [0.011, top]]),
        0.036,
    );
    let [low, high] = ENDS;
    let middle = DVec3::Z * (0.5 * (low + high));
    let size_m = DVec3::new(2.0, LENGTH, high - low);
    let mut tool = Shape::Box { size_m }.tessellate(0.0);
    tool.vertices.iter_mut().for_each(|vertex| vertex.x *= half_width(vertex.z + middle.z));
    let at = |lowered: f64, along: f64| {
        let area = laws::wedge_in_groove(high - low, HALF_ANGLE, lowered);
        let place = middle + DVec3::Y * along;
        Tick {
            pose: Pose::new(DQuat::IDENTITY, place - DVec3::Z * lowered),
            depth_m: lowered * HALF_ANGLE.sin(),
            law: Some(Law::new(area * LENGTH, DVec3::Z, place)),
        }
    };
    let trajectories = vec![
        Trajectory::new("press", |share| at(4e-4 * there_and_back(share), 0.0)),
        Trajectory::new("slide", |share| at(3e-4, 0.015 * (share - 0.5))),
        Trajectory::around(at(3e-4, 0.0), DVec3::NEG_Z, DVec3::X * 4e-5),
    ];
    Scene { name: "wedge-in-groove", part, tool, trajectories }
}

fn cone_on_plane() -> Scene {
    const HALF_ANGLE: f64 = 30.0 * PI / 180.0;
    let part = Shape::Box { size_m: DVec3::new(0.04, 0.04, 0.006) }.tessellate(0.0);
    let top = DVec3::Z * 3e-3;
    let at = |depth: f64, tilt: f64, place: DVec3, yaw: f64| {
        let rotation = DQuat::from_rotation_z(yaw) * DQuat::from_rotation_x(tilt);
        let tip = top + place - DVec3::Z * depth;
        let (volume, [along, across]) = laws::tip(HALF_ANGLE, depth, tilt);
        let law = Law::new(volume, DVec3::Z, tip + rotation * DVec3::new(0.0, across, along));
        Tick { pose: Pose::new(rotation, tip), depth_m: depth, law: Some(law) }
    };
    let slid = |share: f64| DVec3::new(0.8, 0.6, 0.0) * 0.015 * (share - 0.5);
    let tilt = 20.0_f64.to_radians();
    let trajectories = vec![
        Trajectory::new("press", |share| at(5e-4 * there_and_back(share), tilt, DVec3::ZERO, 0.2)),
        Trajectory::new("slide", |share| at(4e-4, tilt, slid(share), 0.2)),
        Trajectory::new("spin", |share| at(4e-4, tilt, DVec3::ZERO, PI * share)),
        Trajectory::new("tumble", |share| at(4e-4, (40.0 * share).to_radians(), DVec3::ZERO, 0.2)),
        Trajectory::new("near miss", |share| at(-NEAR_M, tilt, slid(share), 0.2)),
        Trajectory::around(at(4e-4, tilt, DVec3::ZERO, 0.2), DVec3::NEG_Z, DVec3::Y * 3e-4),
    ];
    Scene { name: "cone-on-plane", part, tool: cone(HALF_ANGLE, 8e-3), trajectories }
}

fn corner_on_plane() -> Scene {
    const SIZE: DVec3 = DVec3::new(0.012, 0.008, 0.01);
    let part = Shape::Box { size_m: DVec3::new(0.04, 0.04, 0.006) }.tessellate(0.0);
    let top = DVec3::Z * 3e-3;
    let of_box = -0.5 * SIZE;
    // The plane's normal in the axes of the box.
    let upright = |aside: f64| DVec3::new(0.5 + aside, 0.6, 0.62).normalize();
    let at = |depth: f64, normal: DVec3, place: DVec3, yaw: f64| {
        let rotation = DQuat::from_rotation_z(yaw) * DQuat::from_rotation_arc(normal, DVec3::Z);
        let corner = top + place - DVec3::Z * depth;
        let volume = laws::corner(depth, normal.to_array());
        let law = Law::new(volume, DVec3::Z, corner + rotation * (0.25 * depth / normal));
        let pose = Pose::new(rotation, corner - rotation * of_box);
        Tick { pose, depth_m: depth, law: Some(law) }
    };
    let slid = |share: f64| DVec3::new(0.8, 0.6, 0.0) * 0.015 * (share - 0.5);
    let middle = upright(0.0);
    let trajectories = vec![
        Trajectory::new("press", |share| {
            at(5e-4 * there_and_back(share), middle, DVec3::ZERO, 0.2)
        }),
        Trajectory::new("slide", |share| at(4e-4, middle, slid(share), 0.2)),
        Trajectory::new("spin", |share| at(4e-4, middle, DVec3::ZERO, PI * share)),
        Trajectory::new("tumble", |share| at(4e-4, upright(0.4 * share), DVec3::ZERO, 0.2)),
        Trajectory::new("near miss", |share| at(-NEAR_M, middle, slid(share), 0.2)),
        Trajectory::around(at(4e-4, middle, DVec3::ZERO, 0.2), DVec3::NEG_Z, DVec3::Y * 3e-4),
    ];
    let tool = Shape::Box { size_m: SIZE }.tessellate(0.0);
    Scene { name: "corner-on-plane", part, tool, trajectories }
}

fn box_on_cone() -> Scene {
    const HALF_ANGLE: f64 = 35.0 * PI / 180.0;
    const HEIGHT: f64 = 8e-3;
    // Its tip up, at the origin.
    let part = fixture::turned(cone(HALF_ANGLE, HEIGHT), DQuat::from_rotation_x(PI));
    let size_m = DVec3::new(0.03, 0.03, 6e-3);
    let at = |depth: f64, place: DVec3, yaw: f64| {
        let (volume, _) = laws::tip(HALF_ANGLE, depth, 0.0);
        let above = DVec3::Z * (0.5 * size_m.z - depth);
        Tick {
            pose: Pose::new(DQuat::from_rotation_z(yaw), place + above),
            depth_m: depth * HALF_ANGLE.sin(),
            law: Some(Law::new(volume * HALF_ANGLE.sin(), DVec3::Z, DVec3::ZERO)),
        }
    };
    let slid = |share: f64| DVec3::new(0.8, 0.6, 0.0) * 0.015 * (share - 0.5);
    let trajectories = vec![
        Trajectory::new("press", |share| at(5e-4 * there_and_back(share), DVec3::ZERO, 0.2)),
        Trajectory::new("slide", |share| at(4e-4, slid(share), 0.2)),
        Trajectory::new("spin", |share| at(4e-4, DVec3::X * 2e-3, PI * share)),
        Trajectory::new("near miss", |share| at(-NEAR_M, slid(share), 0.2)),
        Trajectory::around(at(4e-4, DVec3::ZERO, 0.2), DVec3::NEG_Z, DVec3::X * 3e-4),
    ];
    Scene { name: "box-on-cone", part, tool: Shape::Box { size_m }.tessellate(0.0), trajectories }
}

fn crossed_edges() -> Scene {
    const SIDE: f64 = 0.01;
    /// From the middle of a box to its edge.
    const EDGE: f64 = SIDE * core::f64::consts::FRAC_1_SQRT_2;
    let mesh = Shape::Box { size_m: DVec3::new(SIDE, 0.03, SIDE) }.tessellate(0.0);
    let on_edge = DQuat::from_rotation_y(0.25 * PI);
    let part = fixture::turned(mesh.clone(), on_edge);
    let at = |overlap: f64, slid: DVec3| {
        let law = Law::new(laws::crossed_edges(overlap), DVec3::Z, DVec3::Y * slid.y);
        let place = slid + DVec3::Z * (2.0 * EDGE - overlap);
        let depth_m = overlap * core::f64::consts::FRAC_1_SQRT_2;
        Tick {
            pose: Pose::new(DQuat::from_rotation_z(FRAC_PI_2) * on_edge, place),
            depth_m,
            law: Some(law),
        }
    };
    let slid = |share: f64| DVec3::new(0.8, 0.6, 0.0) * 0.015 * (share - 0.5);
    let trajectories = vec![
        Trajectory::new("press", |share| at(5e-4 * there_and_back(share), DVec3::ZERO)),
        Trajectory::new("slide", |share| at(4e-4, slid(share))),
        Trajectory::new("near miss", |share| at(-NEAR_M, slid(share))),
        Trajectory::around(at(4e-4, DVec3::ZERO), DVec3::NEG_Z, DVec3::X * 3e-4),
    ];
    Scene { name: "crossed-edges", part, tool: mesh, trajectories }
}

/// The rim of a cylinder, tilted, on that of another which stands upright.
fn cylinder_rims() -> Scene {
    const RADIUS: f64 = 5e-3;
    const HALF: f64 = 6e-3;
    let mesh =
        fixture::tessellated(Shape::Cylinder { radius_m: RADIUS, height_m: 2.0 * HALF }, FINE_M);
    // Across the rim of the part, and about as steep as that on both sides.
    let into_part = DVec3::new(-1.0, 0.0, -1.0).normalize();
    let rotation = DQuat::from_rotation_y(0.25 * PI) * DQuat::from_rotation_x(40.0 * PI / 180.0);
    let at = |depth: f64, around: f64| {
        let rim = DVec3::new(RADIUS, 0.0, HALF) + into_part * depth;
        let pose = Pose::new(rotation, rim - rotation * DVec3::new(0.0, -RADIUS, -HALF));
        let world_from_scene = Pose::new(DQuat::from_rotation_z(around), DVec3::ZERO);
        Tick { pose: world_from_scene * pose, depth_m: depth, law: None }
    };
    let trajectories = vec![
        Trajectory::new("press", |share| at(5e-4 * there_and_back(share), 0.0)),
        Trajectory::new("slide", |share| at(4e-4, PI * share)),
        Trajectory::around(at(4e-4, 0.0), into_part, DVec3::Y * 3e-4),
    ];
    Scene { name: "cylinder-rims", part: mesh.clone(), tool: mesh, trajectories }
}

/// With its tip at the origin, along z.
fn cone(half_angle: f64, height: f64) -> TriangleMesh {
    let radius = height * half_angle.tan();
    let n = Tube::sides_for(radius, FINE_M) as u32;
    let rim = (0..n).map(|k| DVec2::from_angle(TAU * f64::from(k) / f64::from(n)) * radius);
    let vertices =
        [DVec3::ZERO, DVec3::Z * height].into_iter().chain(rim.map(|at| at.extend(height)));
    let sides = (0..n).flat_map(|k| {
        let [from, to] = [2 + k, 2 + (k + 1) % n];
        [[0, to, from], [1, from, to]]
    });
    TriangleMesh { vertices: vertices.collect(), triangles: sides.collect() }
}

fn ball(radius_m: f64) -> TriangleMesh {
    fixture::tessellated(Shape::Sphere { radius_m }, FINE_M)
}

/// About an axis that no grid and no symmetry has.
fn oblique(angle: f64) -> DQuat {
    DQuat::from_axis_angle(DVec3::new(0.48, -0.6, 0.64), angle)
}

/// What lies between two polylines in x and z, which end on a common top, along y.
fn channel(inner: &[DVec2], outer: &[DVec2], length: f64) -> TriangleMesh {
    let ring: Vec<DVec2> = inner.iter().chain(outer.iter().rev()).copied().collect();
    let n = ring.len() as u32;
    let vertices = [-0.5, 0.5]
        .into_iter()
        .flat_map(|side| ring.iter().map(move |at| DVec3::new(at.x, side * length, at.y)));
    let mut mesh = TriangleMesh { vertices: vertices.collect(), triangles: Vec::new() };
    for k in 0..n {
        let next = (k + 1) % n;
        mesh.triangles.extend([[k, next, n + next], [k, n + next, n + k]]);
        // Of the ends: the quadrilaterals between the polylines.
        if k + 1 < inner.len() as u32 {
            let far = n - 1 - k;
            let far_next = n - 2 - k;
            mesh.triangles.extend([[k, far_next, next], [k, far, far_next]]);
            mesh.triangles.extend(
                [[k, next, far_next], [k, far_next, far]].map(|corners| corners.map(|idx| idx + n)),
            );
        }
    }
    if validate::inspect(&mesh).signed_volume_m3 < 0.0 {
        mesh.triangles.iter_mut().for_each(|corners| corners.swap(1, 2));
    }
    mesh
}

/// Scenes of real parts, without a closed form, and why some are missing.
pub(super) fn real_parts(models: &std::path::Path) -> Vec<Result<Scene, String>> {
    let load = |name: &str, unit_m: f64| {
        let mesh =
            vps::mesh::load(&models.join(name), unit_m).map_err(|error| error.to_string())?;
        let (low, high) = mesh.bounds().ok_or_else(|| format!("{name}: no vertices"))?;
        Ok::<_, String>((mesh, 0.5 * (low + high)))
    };
    let free = |pose: Pose, depth_m: f64| Tick { pose, depth_m, law: None };
    let peg = || {
        let hole = load("factory_round_hole_8mm_subdiv_3x.obj", 1.0)?.0;
        let peg = load("factory_round_peg_8mm_tight.obj", 1.0)?.0;
        let at = |aside: f64, along: f64, tilt_deg: f64| {
            let tilt = DQuat::from_rotation_y(tilt_deg.to_radians());
            free(Pose::new(tilt, DVec3::new(aside, 0.0, along)), aside)
        };
        let trajectories = vec![
            Trajectory::new("press", |share| at(2.5e-4 * there_and_back(share), 2e-3, 0.0)),
            Trajectory::new("slide", |share| at(2e-4, 5e-3 - 4e-3 * share, 0.0)),
            Trajectory::new("insertion", |share| at(2e-4, 9.5e-3 - 8e-3 * share, 0.5)),
            Trajectory::new("jam", |share| at(1e-4, 2e-3, 2.5 * there_and_back(share))),
            Trajectory::around(at(2e-4, 3e-3, 0.0), DVec3::X, DVec3::Y * 1e-4),
        ];
        Ok(Scene { name: "factory-peg-in-hole", part: hole, tool: peg, trajectories })
    };
    let nut = || {
        let bolt = load("factory_bolt_m16_tight.obj", 1.0)?.0;
        let nut = load("factory_nut_m16_tight_subdiv_3x.obj", 1.0)?.0;
        // The thread of M16 rises by 2 mm a turn; lifted by 0.2 mm its flanks touch.
        let at = |lift: f64, angle: f64| {
            let pose =
                Pose::new(DQuat::from_rotation_z(angle), DVec3::Z * (lift + 2e-3 * angle / TAU));
            free(pose, lift)
        };
        let trajectories = vec![
            Trajectory::new("press", |share| at(2.5e-4 * there_and_back(share), 0.0)),
            Trajectory::new("spin", |share| at(2e-4, PI * share)),
            Trajectory::around(at(2e-4, 0.0), DVec3::Z, DVec3::X * 3e-5),
        ];
        Ok(Scene { name: "factory-nut-on-bolt", part: bolt, tool: nut, trajectories })
    };
    let rocker_arm = || {
        let (mut mesh, middle) = load("rocker-arm.obj", 0.04)?;
        mesh.vertices.iter_mut().for_each(|vertex| *vertex -= middle);
        let solid = Solid::new(&mesh);
        let tool = ball(4e-3);
        let depth = 1.5e-4;
        let surface = Surface::new(tool.clone());
        let mut random = Random::new(24);
        let nodes = (0..8).find_map(|_| curved::path(&solid, &surface, depth, 0.04, &mut random));
        let nodes = nodes.ok_or_else(|| "rocker-arm.obj: no path of constant depth".to_owned())?;
        let poses = curved::ticks(&nodes);
        let deepest = surface.deepest(nodes[1], &solid);
        let into_part = -surface.way_out(nodes[1], &solid, &deepest);
        let aside = into_part.any_orthonormal_vector() * 2e-4;
        let trajectories = vec![
            Trajectory::new("slide", |share| {
                free(poses[(share * (poses.len() - 1) as f64).round() as usize], depth)
            }),
            Trajectory::around(free(nodes[1], depth), into_part, aside),
        ];
        Ok(Scene { name: "ball-on-rocker-arm", part: mesh, tool, trajectories })
    };
    let scenes: [(&str, Result<Scene, String>); 3] = [
        ("factory-peg-in-hole", peg()),
        ("factory-nut-on-bolt", nut()),
        ("ball-on-rocker-arm", rocker_arm()),
    ];
    let turned = scenes.into_iter().zip(3024..).map(|((name, scene), seed)| match scene {
        Ok(scene) => Ok(scene.turned(seed)),
        Err(why) => Err(format!("{name}: {why}")),
    });
    turned.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Meshes are inscribed: their surfaces are up to 2 µm off, of 100 µm of depth and more.
    const ALLOWED: f64 = 0.03;

    #[test]
    fn closed_forms_are_what_the_integral_over_the_meshes_says() {
        for scene in closed_forms() {
            for mesh in [&scene.part, &scene.tool] {
                let report = validate::inspect(mesh);
                assert!(
                    report.closed && report.signed_volume_m3 > 0.0,
                    "{}: {report:?}",
                    scene.name
                );
            }
            let solid = Solid::new(&scene.part);
            let surface = Surface::new(scene.tool.clone());
            // All trajectories of a scene are made by one function.
            let held = scene
                .trajectories
                .iter()
                .rfind(|of| of.kind == Kind::Steady && of.ticks[0].law.is_some())
                .unwrap();
            let Tick { pose, law, .. } = held.ticks[TICKS / 3];
            let law = law.unwrap();
            // What touches of a tip is a fraction of a millimetre.
            let step_m = if scene.is_sharp() { 3e-5 } else { 2e-3 };
            let found =
                surface.integral(pose, step_m, &|at| solid.at(at).depth_m) * PRESSURE_N_PER_M3;
            let error = (found - law.force).length() / law.force.length();
            assert!(error < ALLOWED, "{}, {}: {found} {}", scene.name, held.name, law.force);
        }
    }

    #[test]
    fn a_loop_ends_where_it_begins_and_every_tick_is_finite() {
        for scene in closed_forms().into_iter().chain(without_closed_form()) {
            for Trajectory { name, kind, ticks } in &scene.trajectories {
                assert_eq!(ticks.len(), TICKS);
                assert!(ticks.iter().all(|tick| tick.pose.is_finite()
                    && tick.law.is_none_or(|law| law.force.is_finite())));
                let moved = ticks[0].pose.inverse() * ticks[TICKS - 1].pose;
                let is_closed = moved.translation.length() < 1e-12
                    && moved.rotation.angle_between(DQuat::IDENTITY) < 1e-7;
                let is_open = matches!(kind, Kind::Steady | Kind::NearMiss);
                assert!(is_closed || is_open, "{}, {name}", scene.name);
            }
        }
    }
}
