//! Tools at random in their grids: what a face presses with, when a corner is first felt, and how
//! forces come to the law with the voxel.
//!
//! The law and its exact reference: `law`. Forces are trilinear.

use glam::{DQuat, DVec3};
use rayon::prelude::*;

use super::super::random::Random;
use super::super::statistics::{median, quantile};
use super::super::{BenchError, Row};
use super::Options;
use super::curved::{step_m, turn};
use super::fixture::{self, Tube};
use super::law::{Solid, Surface};
use super::scenarios::STIFFNESS_N_PER_M;
use vps::contact::{ContactSum, ForceLaw, Obstacle};
use vps::mesh::TriangleMesh;
use vps::mesh::primitives::Shape;
use vps::pointshell::Points;
use vps::pointshell::shell::Shell;
use vps::spatial::Pose;

const KINDS: [(&str, Points); 2] = [("facets", Points::Facets), ("voxels", Points::Voxels)];
/// s of the tool of faces and corners, m.
const VOXEL_M: f64 = 5e-4;
const EDGE_M: f64 = 0.01;
const FACES: usize = 150;
const CUBES: usize = 25;

/// A plate whose upper side is z = 0, and its place.
fn plate() -> (TriangleMesh, Pose) {
    (
        Shape::Box { size_m: DVec3::new(0.026, 0.026, 0.006) }.tessellate(0.0),
        Pose::from_translation(DVec3::Z * -0.003),
    )
}

fn plate_of(voxel_size_m: f64) -> Result<Obstacle, BenchError> {
    let (mesh, world_from_map) = plate();
    Ok(Obstacle { world_from_map, ..fixture::obstacle("a plate", &mesh, voxel_size_m, false)? })
}

fn cube() -> TriangleMesh {
    Shape::Box { size_m: DVec3::splat(EDGE_M) }.tessellate(0.0)
}

pub(super) fn rows(options: &Options, tell: &mut dyn FnMut(&str)) -> Result<Vec<Row>, BenchError> {
    tell("tools at random in their grids: faces, corners");
    let mut rows = faces_and_corners(if options.quick { CUBES } else { FACES })?;
    if !options.quick {
        tell("tools at random in their grids: convergence");
        rows.extend(convergence()?);
    }
    Ok(rows)
}

fn faces_and_corners(n_faces: usize) -> Result<Vec<Row>, BenchError> {
    const GROUP: &str = "a cube of 10 mm at random in its grid, voxels of 0.5 mm, on a plane";
    let plate = [plate_of(VOXEL_M * 2.06)?];
    let mut rows = Vec::new();
    for (name, points) in KINDS {
        let mut random = Random::new(150);
        let turns: Vec<DQuat> = (0..n_faces).map(|_| turn(&mut random)).collect();
        let shell = |turn: DQuat| {
            fixture::shell_of("a cube", &fixture::turned(cube(), turn), VOXEL_M, points)
        };
        let depth_m = 0.25 * VOXEL_M;
        let law_n = STIFFNESS_N_PER_M * EDGE_M * EDGE_M * depth_m / (VOXEL_M * VOXEL_M);
        let of_face = |turn: &DQuat| {
            let pose = Pose::new(turn.inverse(), DVec3::Z * (0.5 * EDGE_M - depth_m));
            Ok(ContactSum::flat(&plate, &shell(*turn)?, pose, ForceLaw::PLAIN).wrench.force.z
                / law_n)
        };
        let mut shares = turns.par_iter().map(of_face).collect::<Result<Vec<f64>, BenchError>>()?;
        shares.sort_by(f64::total_cmp);
        let share = |what: &str, value: Option<&f64>| {
            Row::new(
                GROUP,
                format!("{name}: a face in {n_faces} attitudes: force / law, {what}"),
                value.copied(),
                "",
            )
        };
        let least = share("least", shares.first());
        let most = share("most", shares.last());
        let is_judged = points == Points::Facets;
        rows.extend(if is_judged {
            [least.at_least(0.98), most.at_most(1.02)]
        } else {
            [least, most]
        });
        let of_cube = |turn: &DQuat| {
            let shell = shell(*turn)?;
            Ok(cube()
                .vertices
                .iter()
                .map(|corner| felt_from(&plate, &shell, *turn * *corner))
                .collect())
        };
        let found = turns[..CUBES]
            .par_iter()
            .map(of_cube)
            .collect::<Result<Vec<Vec<f64>>, BenchError>>()?;
        let mut felt: Vec<f64> = found.concat();
        felt.sort_by(f64::total_cmp);
        let first = |what: &str, value: Option<f64>| {
            Row::new(GROUP, format!("{name}: a corner is first felt at, {what}"), value, "voxel")
        };
        rows.push(first("median", median(&felt)));
        rows.push(first("p95", quantile(&felt, 0.95)));
        let worst = first("worst", felt.last().copied());
        rows.push(if is_judged { worst.at_most(0.05) } else { worst });
    }
    Ok(rows)
}

/// Depth from which a corner that points straight down is felt, voxels of the tool.
fn felt_from(plate: &[Obstacle], shell: &Shell, corner: DVec3) -> f64 {
    let down = DQuat::from_rotation_arc(corner.normalize(), DVec3::NEG_Z);
    let mut low = 0.0;
    let mut high = 1.0;
    for _ in 0..14 {
        let depth = 0.5 * (low + high);
        let pose = Pose::new(down, DVec3::Z * (corner.length() - depth * VOXEL_M));
        if ContactSum::flat(plate, shell, pose, ForceLaw::PLAIN).contacts > 0 {
            high = depth
        } else {
            low = depth
        }
    }
    high
}

/// Voxels of both parts, m.
const SIZES_M: [f64; 4] = [1e-3, 5e-4, 2.5e-4, 1.25e-4];
/// How far meshes are from their shapes, m: no part of the error, as the law is that of the same
/// meshes.
const TOLERANCE_M: f64 = 2e-6;
const OVERLAP_M: f64 = 4e-4;
const ATTITUDES: u64 = 6;
const POSES: usize = 3;
const PIN_M: f64 = 4e-3;
const GAP_M: f64 = 2e-4;

/// A tool on an obstacle, with an overlap that is held.
struct Pair {
    name: &'static str,
    tool: TriangleMesh,
    obstacle: TriangleMesh,
    world_from_obstacle: Pose,
    is_pin: bool,
}

fn pairs() -> [Pair; 3] {
    let (plate, world_from_plate) = plate();
    let bore_m = PIN_M + GAP_M;
    // Chord height r π²/(2 n²).
    let sides = (core::f64::consts::PI * (bore_m / (2.0 * TOLERANCE_M)).sqrt()).ceil() as usize;
    let bore =
        Tube { inner_m: bore_m, outer_m: 9e-3, height_m: 0.018, sides, pieces: [1, 1] }.mesh();
    let on_plate = |name, tool| Pair {
        name,
        tool,
        obstacle: plate.clone(),
        world_from_obstacle: world_from_plate,
        is_pin: false,
    };
    [
        on_plate("sphere on plane", Shape::Sphere { radius_m: 5e-3 }.tessellate(TOLERANCE_M)),
        on_plate("turned cube on plane", cube()),
        Pair {
            name: "pin in bore",
            tool: Shape::Cylinder { radius_m: PIN_M, height_m: 0.01 }.tessellate(TOLERANCE_M),
            obstacle: bore,
            world_from_obstacle: Pose::IDENTITY,
            is_pin: true,
        },
    ]
}

fn convergence() -> Result<Vec<Row>, BenchError> {
    let mut rows = Vec::new();
    for pair in pairs() {
        let group = format!(
            "convergence: {}, 0.4 mm of overlap held, voxels of both parts halved",
            pair.name
        );
        for voxel_size_m in SIZES_M {
            let found = (0..ATTITUDES)
                .into_par_iter()
                .map(|n| pair.errors(voxel_size_m, n))
                .collect::<Result<Vec<Vec<[Error; 2]>>, BenchError>>()?
                .concat();
            for (idx, (name, _)) in KINDS.iter().enumerate() {
                let rms = |of: fn(&Error) -> f64| {
                    (found.iter().map(|errors| of(&errors[idx]).powi(2)).sum::<f64>()
                        / found.len() as f64)
                        .sqrt()
                };
                let what = format!("{name}, {} mm", 1e3 * voxel_size_m);
                rows.push(Row::new(
                    &group,
                    format!("{what}: error, RMS"),
                    rms(|error| error.percent),
                    "%",
                ));
                rows.push(Row::new(
                    &group,
                    format!("{what}: angle, RMS"),
                    rms(|error| error.angle_deg),
                    "°",
                ));
            }
        }
    }
    Ok(rows)
}

/// What one force is off the law.
#[derive(Clone, Copy)]
struct Error {
    percent: f64,
    angle_deg: f64,
}

impl Pair {
    /// In some poses, both parts turned in their grids: with points of each kind.
    fn errors(&self, voxel_size_m: f64, n: u64) -> Result<Vec<[Error; 2]>, BenchError> {
        let mut random = Random::new(400 + n);
        let turn_obstacle = turn(&mut random);
        let turn_tool = turn(&mut random);
        let mesh = fixture::turned(self.obstacle.clone(), turn_obstacle);
        let world_from_map =
            self.world_from_obstacle * Pose::new(turn_obstacle.inverse(), DVec3::ZERO);
        let obstacle = [Obstacle {
            world_from_map,
            ..fixture::obstacle(self.name, &mesh, voxel_size_m, false)?
        }];
        let solid = Solid::new(&self.obstacle);
        let obstacle_from_world = self.world_from_obstacle.inverse();
        let depth = |at: DVec3| solid.at(obstacle_from_world.transform_point(at)).depth_m;
        let tool = fixture::turned(self.tool.clone(), turn_tool);
        let shells = [
            fixture::shell_of(self.name, &tool, voxel_size_m, Points::Facets)?,
            fixture::shell_of(self.name, &tool, voxel_size_m, Points::Voxels)?,
        ];
        let surface = Surface::new(tool);
        let poses = (0..POSES).map(|_| {
            if self.is_pin {
                // Pressed to one side of the bore, whose axis is its own.
                let aside = DQuat::from_rotation_z(random.within(0.0, core::f64::consts::TAU))
                    * DVec3::X
                    * (GAP_M + OVERLAP_M);
                let around = DQuat::from_rotation_z(random.within(0.0, core::f64::consts::TAU));
                return Pose::new(around * turn_tool.inverse(), aside);
            }
            let rotation = turn(&mut random);
            let lowest_m = surface
                .vertices()
                .iter()
                .map(|vertex| (rotation * *vertex).z)
                .fold(f64::INFINITY, f64::min);
            let aside = DVec3::new(
                random.within(-1e-3, 1e-3),
                random.within(-1e-3, 1e-3),
                -lowest_m - OVERLAP_M,
            );
            Pose::new(rotation, aside)
        });
        let per_area = STIFFNESS_N_PER_M / (voxel_size_m * voxel_size_m);
        let errors = poses.map(|pose| {
            let law = surface.integral(pose, step_m(OVERLAP_M), &depth) * per_area;
            shells.each_ref().map(|shell| {
                let force = ContactSum::flat(&obstacle, shell, pose, ForceLaw::PLAIN).wrench.force;
                let percent = 100.0 * (force - law).length() / law.length();
                Error { percent, angle_deg: force.angle_between(law).to_degrees() }
            })
        });
        Ok(errors.collect())
    }
}
