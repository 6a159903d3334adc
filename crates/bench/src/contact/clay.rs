//! Clay as the tick feels it: steps of the force while it recedes under a tool, and what a tick
//! costs.
//!
//! [`Receding`] is the scene in which updates are felt most: a plane of clay goes back at a steady
//! speed, a point follows it at the same depth, and the force would be the same all the time if the
//! clay were updated in every tick. Updated less often, the surface leaps back; in between the
//! point goes deeper.

use std::sync::Arc;

use glam::{DMat3, DQuat, DVec3};

use haptics::clay::{Clay, Rope};
use haptics::{
    CouplingMode, CouplingParameters, DriveRequest, FilterParameters, Inertia, Parameters,
    RenderScene, State, TickInput, TickOutput, Tool, tick,
};
use vps::density::{DensityFrame, FrameError, Lattice, Raster};
use vps::pointshell::shell::Shell;
use vps::spatial::{DeviceSample, Pose, SampleStatus, Twist};

/// Length of a tick, s.
const PERIOD_S: f64 = 1e-3;
/// Distance of the nodes, m.
const SPACING_M: f64 = 1e-3;
/// Ticks before anything moves: the ramp of the enable, and the way to where coupling and contact
/// balance.
const MOVES_FROM_TICK: u64 = 200;
/// Ticks before anything is judged: until updates follow each other as they will for good.
const JUDGED_FROM_TICK: u64 = 300;

/// A plane of clay that goes back under a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Receding {
    /// Speed of the plane and of the point, m/s.
    pub speed_m_per_s: f64,
    /// Updates per second.
    pub update_hz: f64,
    /// Whether the force is extrapolated between them.
    pub extrapolates: bool,
    /// How the tool follows the hand.
    pub coupling: CouplingMode,
}

/// The force tick by tick.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RecedingForce {
    /// Contact force along the normal, N; `[n_ticks]`.
    pub contact_n: Vec<f64>,
    /// Force on the hand along the normal, N; `[n_ticks]`.
    pub felt_n: Vec<f64>,
    /// Force that an update in every tick would give, N.
    pub steady_n: f64,
}

impl RecedingForce {
    /// Largest change of the contact force from one tick to the next, N.
    pub fn largest_contact_step_n(&self) -> f64 {
        largest_step(&self.contact_n)
    }

    /// The same of the force on the hand, N.
    pub fn largest_felt_step_n(&self) -> f64 {
        largest_step(&self.felt_n)
    }
}

fn largest_step(series: &[f64]) -> f64 {
    series.windows(2).map(|pair| (pair[1] - pair[0]).abs()).fold(0.0, f64::max)
}

/// Depth of the point below the true plane, m.
const DEPTH_M: f64 = 2e-3;
/// Where the plane is at first, m.
const TOP_M: f64 = 0.055;

impl Receding {
    /// Plays until updates follow each other as they will for good, and `n_ticks` more. The clay is
    /// 55 mm thick.
    ///
    /// # Errors
    /// None in practice: the frames are sound.
    pub fn play(&self, n_ticks: u64) -> Result<RecedingForce, FrameError> {
        let lattice = Lattice {
            origin_map: DVec3::new(-5e-3, -5e-3, 0.0),
            spacing_m: SPACING_M,
            dims: [11, 11, 61],
        };
        let plane = |top_m: f64| move |point: DVec3| top_m - point.z;
        let mut scene = scene(
            &frame(lattice, &plane(TOP_M))?,
            Shell::new(&[(DVec3::ZERO, DVec3::Z)], SPACING_M),
        );
        scene.parameters.coupling.mode = self.coupling;
        if let (Some(clay), true) = (&mut scene.clay, self.extrapolates) {
            clay.smoothing = Clay::smoothing_between(1.0 / self.update_hz, PERIOD_S);
        }
        // A hand on a spring of the same stiffness has to go as deep again.
        let stretch_m = if self.coupling == CouplingMode::Direct { 0.0 } else { DEPTH_M };
        let top_m = |tick: u64| {
            TOP_M - self.speed_m_per_s * PERIOD_S * tick.saturating_sub(MOVES_FROM_TICK) as f64
        };
        scene.parameters.mapping.start =
            Pose::from_translation(DVec3::Z * (TOP_M - DEPTH_M - stretch_m));
        let mut state = State::new(&scene);
        let mut force = RecedingForce { steady_n: 1e3 * DEPTH_M, ..RecedingForce::default() };
        let mut n_updates = 0;
        for tick_idx in 0..JUDGED_FROM_TICK + n_ticks {
            // The newest update that is not later than the tick, computed from where the plane is
            // at its own time.
            let due = (tick_idx as f64 * PERIOD_S * self.update_hz + 1e-9) as u64;
            if due > n_updates {
                n_updates = due;
                let at_tick = due as f64 / (self.update_hz * PERIOD_S);
                let late_m =
                    self.speed_m_per_s * PERIOD_S * (at_tick - MOVES_FROM_TICK as f64).max(0.0);
                state.exchange(Box::new(DensityFrame {
                    sequence: due,
                    ..frame(lattice, &plane(TOP_M - late_m))?
                }));
            }
            let pose = Pose::from_translation(DVec3::Z * (top_m(tick_idx) - TOP_M));
            let speed_m_per_s = if tick_idx > MOVES_FROM_TICK { self.speed_m_per_s } else { 0.0 };
            let twist = Twist { linear: DVec3::NEG_Z * speed_m_per_s, angular: DVec3::ZERO };
            let sequence = tick_idx + 1;
            let status = SampleStatus::Fresh;
            let sample = DeviceSample { sequence, status, pose, twist, ..DeviceSample::default() };
            let output = tick(
                &scene,
                &mut state,
                &TickInput { sample, request: DriveRequest::Enable, ..TickInput::default() },
            );
            if tick_idx >= JUDGED_FROM_TICK {
                force.contact_n.push(output.contact_world.force.z);
                force.felt_n.push(output.command_device.force.z);
            }
        }
        Ok(force)
    }
}

/// A ball that turns in a plane of clay, tick by tick: what a tick costs.
#[derive(Debug)]
pub struct Turning {
    scene: RenderScene,
    state: State,
    sequence: u64,
}

impl Turning {
    /// A ball of 15 mm radius with so many points, so deep in the clay (negative: above it).
    ///
    /// # Errors
    /// None in practice: the frame is sound.
    pub fn new(n_points: u32, depth_m: f64) -> Result<Self, FrameError> {
        const RADIUS_M: f64 = 0.015;
        let lattice = Lattice {
            origin_map: DVec3::new(-0.04, -0.04, -0.02),
            spacing_m: SPACING_M,
            dims: [81, 81, 61],
        };
        let (shell, reach_m) = if n_points > 1 {
            (ball(RADIUS_M, n_points), RADIUS_M)
        } else {
            (Shell::new(&[(DVec3::ZERO, DVec3::Z)], SPACING_M), 0.0)
        };
        let mut scene = scene(&frame(lattice, &|point: DVec3| -point.z)?, shell);
        scene.parameters.mapping.start = Pose::from_translation(DVec3::Z * (reach_m - depth_m));
        let state = State::new(&scene);
        Ok(Self { scene, state, sequence: 0 })
    }

    /// The next tick, a tenth of a degree further.
    pub fn tick(&mut self) -> TickOutput {
        self.sequence += 1;
        let turn = DQuat::from_rotation_z(2e-3 * self.sequence as f64)
            * DQuat::from_rotation_x(1e-3 * self.sequence as f64);
        let pose = Pose::new(turn, DVec3::ZERO);
        let sample = DeviceSample {
            sequence: self.sequence,
            status: SampleStatus::Fresh,
            pose,
            ..DeviceSample::default()
        };
        tick(
            &self.scene,
            &mut self.state,
            &TickInput { sample, request: DriveRequest::Enable, ..TickInput::default() },
        )
    }
}

/// Points spread evenly over a sphere, their normals inwards; sixteen after the other lie side by
/// side.
fn ball(radius_m: f64, n_points: u32) -> Shell {
    let golden_rad = core::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    let mut points: Vec<DVec3> = (0..n_points)
        .map(|n| {
            let z = 1.0 - (2.0 * f64::from(n) + 1.0) / f64::from(n_points);
            let (sin, cos) = (golden_rad * f64::from(n)).sin_cos();
            DVec3::new(cos * (1.0 - z * z).sqrt(), sin * (1.0 - z * z).sqrt(), z)
        })
        .collect();
    // Bands, and around each band.
    let bands = f64::from(n_points / 16).sqrt().max(1.0);
    let band = |point: &DVec3| ((0.5 * (point.z + 1.0) * bands) as u32, point.y.atan2(point.x));
    points.sort_by(|one, other| {
        let ((one_band, one_rad), (other_band, other_rad)) = (band(one), band(other));
        one_band.cmp(&other_band).then(one_rad.total_cmp(&other_rad))
    });
    let points: Vec<(DVec3, DVec3)> =
        points.into_iter().map(|normal| (normal * radius_m, -normal)).collect();
    Shell::new(&points, SPACING_M)
}

/// A frame whose region is all of it.
fn frame(lattice: Lattice, density_m: &dyn Fn(DVec3) -> f64) -> Result<DensityFrame, FrameError> {
    let mut raster = Raster::uniform(lattice, 0.0);
    let [nx, ny, nz] = lattice.dims;
    let nodes = (0..nx).flat_map(|x| (0..ny).flat_map(move |y| (0..nz).map(move |z| [x, y, z])));
    for (value_m, node) in raster.values_m_mut().iter_mut().zip(nodes) {
        *value_m = density_m(lattice.position(node)) as f32;
    }
    raster.measure();
    let mut frame = DensityFrame {
        sequence: 0,
        base: Arc::new(raster.clone()),
        region: raster,
        rope_map: None,
        is_leap: false,
    };
    frame.make_ready(None)?;
    Ok(frame)
}

/// A tool and a piece of clay, nothing between the contact and the hand that would hide a step.
fn scene(frame: &DensityFrame, shell: Shell) -> RenderScene {
    let least_kg_m2 = 1e-6;
    RenderScene {
        parameters: Parameters {
            coupling: CouplingParameters {
                mode: CouplingMode::Direct,
                ..CouplingParameters::PLAIN
            },
            filter: FilterParameters { cutoff_hz: [f64::INFINITY; 2] },
            ..Parameters::unlimited(PERIOD_S)
        },
        obstacles: Vec::new(),
        clay: Some(Clay {
            world_from_map: Pose::IDENTITY,
            frame: frame.clone(),
            smoothing: 0.0,
            rope: Rope::default(),
        }),
        tool: Tool {
            shell,
            inertia: Inertia {
                mass_kg: 0.05,
                body_kg_m2: DMat3::IDENTITY * least_kg_m2,
                least_kg_m2,
            },
            center_of_mass_tool: DVec3::ZERO,
        },
    }
}
