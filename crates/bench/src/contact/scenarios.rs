//! Q1 to Q3: contacts whose force is known.
//!
//! | | contact | ideal force | ideal torque |
//! |---|---|---|---|
//! | Q1 | sphere (R = 20 s) slides 2 s deep over a plane: along the grid, along its diagonal, up a slope of 10° | constant, along the plane's normal | 0 |
//! | Q2 | cone, apex first, likewise | constant, along the normal | 0 |
//! | Q3 | square pin turns in a round bore, its edges 2 s in the wall: bore along the grid, and tilted by 10° | 0 | 0 |
//!
//! Lengths in voxels of s = 1 mm, points one to a voxel, 50 mm/s at 1 kHz, 1 N/mm for a point.
//!
//! # Source
//! Weller2010 (force and torque beside analytic models, in direction and magnitude). Why the force
//! follows the normal: for points of even density ρ, Σ dᵢ nᵢ is ρ ∮ d n dA = ρ ∫ grad d dV over the
//! overlap (Gauss), so a plane pushes along its normal with k ρ · volume and, about a point on the
//! axis through the middle of the overlap, without torque. Shells are not quite even: the same sum
//! with exact depths says what that costs, and is what sizes of forces are held against.

use core::f64::consts::{PI, SQRT_2, TAU};

use glam::{DQuat, DVec3};

use super::super::BenchError;
use super::fixture::{self, Tube};
use vps::contact::Obstacle;
use vps::mesh::TriangleMesh;
use vps::mesh::primitives::Shape;
use vps::pointshell::shell::Shell;
use vps::spatial::{Pose, Wrench};

/// s, m.
pub const VOXEL_M: f64 = 1e-3;
/// Ticks per second.
pub(super) const RATE_HZ: f64 = 1000.0;
/// Speed of the slide, m/s.
pub(super) const SPEED_M_PER_S: f64 = 0.05;
/// Stiffness of one point, N/m.
pub(super) const STIFFNESS_N_PER_M: f64 = 1000.0;
const DEPTH_M: f64 = 2.0 * VOXEL_M;
const RADIUS_M: f64 = 20.0 * VOXEL_M;
const BORE_M: f64 = 10.0 * VOXEL_M;
const TILT_RAD: f64 = PI / 18.0;

/// A static part whose depth is known everywhere near its surface.
#[derive(Clone, Copy, Debug)]
enum Solid {
    /// Below the plane through the origin.
    HalfSpace { normal: DVec3 },
    /// Outside the bore along `axis` through the origin.
    Bore { axis: DVec3 },
}

impl Solid {
    /// V, m.
    fn depth_m(self, point: DVec3) -> f64 {
        match self {
            Self::HalfSpace { normal } => -point.dot(normal),
            Self::Bore { axis } => point.reject_from_normalized(axis).length() - BORE_M,
        }
    }
}

/// What the force ought to be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Ideal {
    /// Constant, along this direction (unit, world).
    Along(DVec3),
    /// In balance.
    Zero,
}

/// One contact along one path.
#[derive(Debug)]
pub struct Scenario {
    /// Q1, Q2 or Q3.
    pub family: &'static str,
    /// The path.
    pub path: &'static str,
    /// The force that an exact renderer gives.
    pub ideal: Ideal,
    pub(super) obstacles: Vec<Obstacle>,
    pub(super) shell: Shell,
    /// `world_from_body` at each tick.
    pub(super) poses: Vec<Pose>,
    solid: Solid,
}

impl Scenario {
    /// The same sum over points with the exact depth: what is left of an error is the shell's. Also
    /// Σ |fᵢ|, N.
    pub(super) fn exact(&self, pose: Pose) -> (Wrench, f64) {
        let mut sum = (Wrench::ZERO, 0.0);
        for (point, normal) in self.shell.points() {
            let arm = pose.rotation * point.as_dvec3();
            let normal = pose.rotation * normal.as_dvec3();
            let force_n = self.solid.depth_m(pose.translation + arm).max(0.0) * STIFFNESS_N_PER_M;
            let force = normal * force_n;
            sum.0 = sum.0 + Wrench::new(force, arm.cross(force));
            sum.1 += force_n;
        }
        sum
    }
}

/// All of them. `n_ticks`: length of each path, of at most [`LONGEST_TICKS`]; cost: bakes of a
/// second.
///
/// # Errors
/// A part that cannot be baked.
pub fn all(n_ticks: usize) -> Result<Vec<Scenario>, BenchError> {
    let n_ticks = n_ticks.min(LONGEST_TICKS);
    let mut scenarios = Vec::new();
    for tool in [Tool::Sphere, Tool::Cone] {
        for (path, along, tilted) in [
            ("along the grid", DVec3::X, false),
            ("diagonal", DVec3::new(1.0, 1.0, 0.0), false),
            ("10° slope", DVec3::X, true),
        ] {
            scenarios.push(slide(tool, path, along.normalize(), tilted, n_ticks)?);
        }
    }
    for (path, tilted) in [("bore along the grid", false), ("bore tilted by 10°", true)] {
        scenarios.push(turn(path, tilted, n_ticks)?);
    }
    Ok(scenarios)
}

/// A slide of 1.2 s: 60 voxels.
pub const LONGEST_TICKS: usize = 1200;

#[derive(Clone, Copy, Debug)]
enum Tool {
    Sphere,
    Cone,
}

impl Tool {
    fn mesh(self) -> TriangleMesh {
        let shape = match self {
            Self::Sphere => Shape::Sphere { radius_m: RADIUS_M },
            // Half a right angle at the apex.
            Self::Cone => Shape::Cone { radius_m: RADIUS_M, height_m: RADIUS_M },
        };
        let mesh = fixture::tessellated(shape, VOXEL_M);
        // The apex of a cone is at +z.
        if matches!(self, Self::Cone) {
            fixture::turned(mesh, DQuat::from_rotation_x(PI))
        } else {
            mesh
        }
    }

    /// From the middle to the lowest point, m.
    fn reach_m(self) -> f64 {
        match self {
            Self::Sphere => RADIUS_M,
            Self::Cone => 0.5 * RADIUS_M,
        }
    }

    fn family(self) -> &'static str {
        match self {
            Self::Sphere => "Q1 sphere on plane",
            Self::Cone => "Q2 cone on plane",
        }
    }
}

/// The slab of the slides, its top face through the origin, tilted against its own grid about an
/// axis between x and y.
pub(super) fn slab(tilted: bool) -> (TriangleMesh, DQuat) {
    let tilt = if tilted {
        DQuat::from_axis_angle(DVec3::new(0.7, 1.0, 0.0).normalize(), TILT_RAD)
    } else {
        DQuat::IDENTITY
    };
    let edge_m = 110.0 * VOXEL_M;
    let plane = Shape::Plane { x_m: edge_m, y_m: edge_m, thickness_m: 30.0 * VOXEL_M };
    (fixture::turned(fixture::tessellated(plane, VOXEL_M), tilt), tilt)
}

fn slide(
    tool: Tool,
    path: &'static str,
    along: DVec3,
    tilted: bool,
    n_ticks: usize,
) -> Result<Scenario, BenchError> {
    let (mesh, tilt) = slab(tilted);
    let normal = tilt * DVec3::Z;
    let obstacle = fixture::obstacle("the plane of Q1 and Q2", &mesh, VOXEL_M, true)?;
    let shell = fixture::shell(tool.family(), &tool.mesh(), VOXEL_M)?;
    let step_m = SPEED_M_PER_S / RATE_HZ;
    let middle = normal * (tool.reach_m() - DEPTH_M) + tilt * DVec3::new(1.3e-4, -2.1e-4, 0.0);
    let poses = (0..n_ticks)
        .map(|tick| {
            let travel_m = step_m * (tick as f64 - 0.5 * n_ticks as f64);
            // A tool that stands upright on the plane.
            Pose::new(tilt, middle + tilt * along * travel_m)
        })
        .collect();
    let ideal = Ideal::Along(normal);
    let solid = Solid::HalfSpace { normal };
    Ok(Scenario {
        family: tool.family(),
        path,
        ideal,
        obstacles: vec![obstacle],
        shell,
        poses,
        solid,
    })
}

fn turn(path: &'static str, tilted: bool, n_ticks: usize) -> Result<Scenario, BenchError> {
    let tilt = if tilted {
        DQuat::from_axis_angle(DVec3::new(0.7, 1.0, 0.0).normalize(), TILT_RAD)
    } else {
        DQuat::IDENTITY
    };
    let bore = Tube {
        inner_m: BORE_M,
        outer_m: BORE_M + 25.0 * VOXEL_M,
        height_m: 60.0 * VOXEL_M,
        sides: Tube::sides_for(BORE_M, VOXEL_M),
        pieces: [1, 1],
    };
    let obstacle =
        fixture::obstacle("the bore of Q3", &fixture::turned(bore.mesh(), tilt), VOXEL_M, true)?;
    let edge_m = (BORE_M + DEPTH_M) * SQRT_2;
    let pin = Shape::Box { size_m: DVec3::new(edge_m, edge_m, 30.0 * VOXEL_M) };
    let shell = fixture::shell("the pin of Q3", &fixture::tessellated(pin, VOXEL_M), VOXEL_M)?;
    // One turn; 1,200 ticks of it move the edges at a little more than the speed of the slides.
    let poses = (0..n_ticks)
        .map(|tick| {
            Pose::new(
                tilt * DQuat::from_rotation_z(TAU * tick as f64 / n_ticks as f64),
                DVec3::ZERO,
            )
        })
        .collect();
    let solid = Solid::Bore { axis: tilt * DVec3::Z };
    Ok(Scenario {
        family: "Q3 pin in bore",
        path,
        ideal: Ideal::Zero,
        obstacles: vec![obstacle],
        shell,
        poses,
        solid,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn with_exact_depths_the_ideal_comes_out_but_for_the_shell() {
        for scenario in all(8).unwrap() {
            let name = format!("{}, {}", scenario.family, scenario.path);
            for pose in &scenario.poses {
                let (wrench, load_n) = scenario.exact(*pose);
                match scenario.ideal {
                    // A cone of two voxels has some tens of points in it.
                    Ideal::Along(direction) => {
                        let off_deg = wrench.force.angle_between(direction).to_degrees();
                        assert!(
                            off_deg < if scenario.family.starts_with("Q1") { 1.0 } else { 10.0 },
                            "{name}: {off_deg}°"
                        );
                    }
                    Ideal::Zero => assert!(
                        wrench.force.length() < 0.02 * load_n && load_n > 0.0,
                        "{name}: {wrench:?} of {load_n}"
                    ),
                }
            }
        }
    }
}
