//! The force law over curved parts: four tools slide over round, filleted and scanned obstacles at
//! constant depth, beside the exact law.
//!
//! | tools | sphere r 4, cylinder r 3 × 8, cube of 7, torus of 4 and 2 mm |
//! |---|---|
//! | obstacles | torus of 12 and 4, sphere r 10, cylinder r 8 × 40 with sharp rims, box of 24 × 20 × 16 with fillets of 2 mm, the rocker arm of `HAPTICD_MODELS` 40 mm long |
//!
//! Voxels of 0.5 mm. Tool and obstacle lie at random in their grids, the tool at random on the
//! obstacle; it keeps its attitude and follows the obstacle in a random plane, 50 mm/s at 1 kHz,
//! its deepest point always as deep. Meshes are within 1 µm of their shapes, so that flats are no
//! part of what is measured. Forces are contact sums without the low-pass, which would add its
//! delay to the error.
//!
//! *Error* is |force − law|, RMS over all paths, each in % of the mean of its law. *Lost* is where
//! there is no force and the law has more than 1 % of its mean.

use glam::{DQuat, DVec3};
use rayon::prelude::*;

use super::super::random::Random;
use super::super::statistics::{median, quantile};
use super::super::{BenchError, Row};
use super::lattice::{Interpolation, Lattice, spread};
use super::law::{Solid, Surface};
use super::ripple::ripple_rms;
use super::scenarios::{RATE_HZ, SPEED_M_PER_S, STIFFNESS_N_PER_M};
use super::{Csv, Options, fixture};
use vps::contact::{ContactSum, ForceLaw, Obstacle};
use vps::mesh::primitives::Shape;
use vps::mesh::{self, TriangleMesh};
use vps::pointshell::Points;
use vps::pointshell::shell::Shell;
use vps::spatial::Pose;
use vps::voxmap::field::FieldKind;

/// s of both parts, m.
const VOXEL_M: f64 = 5e-4;
/// Depths of the deepest point, voxels.
const DEPTHS_VOXELS: [f64; 2] = [0.25, 1.0];
/// How far a mesh is from its shape, m.
const FINE_M: f64 = 1e-6;
/// Paths of each pair of parts at each depth.
const DIRECTIONS: u64 = 1;
/// Ticks of a path, and of the way between two poses that were solved for and are held against the
/// law.
const TICKS: usize = 400;
const TICKS_PER_NODE: usize = 5;
/// Least force of the law for which a direction is asked for, of its mean.
const LEAST_SHARE: f64 = 0.01;

/// Longest edge of the pieces that the law is added up over at a depth: a tenth of the patch that
/// touches, m.
pub(super) fn step_m(depth_m: f64) -> f64 {
    2e-4 * (depth_m / 5e-4).sqrt()
}

/// How a force is made.
struct Setting {
    name: &'static str,
    points: Points,
    law: ForceLaw,
}

/// What is compared; targets ask of facets.
const SETTINGS: [Setting; 3] = [
    Setting { name: "facets", points: Points::Facets, law: ForceLaw::PLAIN },
    Setting { name: "voxels, interpolated", points: Points::Voxels, law: ForceLaw::PLAIN },
    Setting {
        name: "raw of 2008",
        points: Points::Voxels,
        law: ForceLaw { field: FieldKind::Layers, ..ForceLaw::PLAIN },
    },
];
const RAW: usize = 2;

/// Forces along one path, N; those of the law at every [`TICKS_PER_NODE`]th tick.
struct Slid {
    tool: &'static str,
    obstacle: usize,
    depth_idx: usize,
    law: Vec<DVec3>,
    forces: [Vec<DVec3>; SETTINGS.len()],
    ablation: Vec<Vec<DVec3>>,
}

/// A part with its mesh turned in its grid.
struct Tool {
    name: &'static str,
    surface: Surface,
    /// With facets, with the points of voxels, and, for the ablation, with facets of half the
    /// voxel.
    shells: Vec<Shell>,
}

struct Part {
    solid: Solid,
    /// With voxels of s, and, for the ablation, of half.
    fields: Vec<Vec<Obstacle>>,
    /// Samples of the first, for the ablation.
    lattice: Lattice,
}

fn tools() -> [(&'static str, Shape); 4] {
    [
        ("sphere", Shape::Sphere { radius_m: 4e-3 }),
        ("cylinder", Shape::Cylinder { radius_m: 3e-3, height_m: 8e-3 }),
        ("cube", Shape::Box { size_m: DVec3::splat(7e-3) }),
        ("torus", Shape::Torus { major_m: 4e-3, minor_m: 2e-3 }),
    ]
}

/// Names and meshes of the obstacles; the last is there for the ablation alone.
fn obstacles(options: &Options) -> Vec<(&'static str, TriangleMesh)> {
    let mut all = vec![
        ("torus", Shape::Torus { major_m: 0.012, minor_m: 0.004 }.tessellate(FINE_M)),
        ("sphere", Shape::Sphere { radius_m: 0.01 }.tessellate(FINE_M)),
        ("cylinder", Shape::Cylinder { radius_m: 0.008, height_m: 0.04 }.tessellate(FINE_M)),
        ("filleted box", fixture::filleted_box(DVec3::new(0.024, 0.02, 0.016), 0.002, FINE_M)),
    ];
    let rocker_arm = options
        .models
        .as_ref()
        .and_then(|folder| mesh::load(&folder.join("rocker-arm.obj"), 0.04).ok());
    let rocker_arm = rocker_arm.map(|mut mesh| {
        let middle = mesh.bounds().map_or(DVec3::ZERO, |(low, high)| 0.5 * (low + high));
        mesh.vertices.iter_mut().for_each(|vertex| *vertex -= middle);
        mesh
    });
    all.extend(rocker_arm.map(|mesh| ("rocker arm", mesh)));
    all.push((SHARP, Shape::Box { size_m: DVec3::new(0.024, 0.02, 0.016) }.tessellate(FINE_M)));
    all
}

const SHARP: &str = "sharp box";

pub(super) fn turn(random: &mut Random) -> DQuat {
    let [x, y, z, w] = [(); 4].map(|()| random.within(-1.0, 1.0));
    DQuat::from_xyzw(x, y, z, w).normalize()
}

fn direction(random: &mut Random) -> DVec3 {
    turn(random) * DVec3::Z
}

/// Poses solved for along a path: the tool keeps its attitude, moves along the obstacle in a plane,
/// and is pressed or lifted in that plane until its deepest point is as deep as it should be.
/// `None` where it hangs.
pub(super) fn path(
    solid: &Solid,
    tool: &Surface,
    depth_m: f64,
    reach_m: f64,
    random: &mut Random,
) -> Option<Vec<Pose>> {
    let rotation = turn(random);
    let from = direction(random);
    let mut pose = Pose::new(rotation, from * reach_m);
    // From outside, as far as is free.
    for _ in 0..60 {
        let deepest = tool.deepest(pose, solid);
        pose.translation -= from * (depth_m - deepest.depth_m);
        if (deepest.depth_m - depth_m).abs() < 0.05 * depth_m {
            break;
        }
    }
    let deepest = tool.deepest(pose, solid);
    let outward = tool.way_out(pose, solid, &deepest);
    let across = outward.cross(direction(random)).try_normalize()?;
    let mut along = across.cross(outward);
    let step_m = SPEED_M_PER_S / RATE_HZ * TICKS_PER_NODE as f64;
    let mut poses = Vec::new();
    // One node before the first tick and two behind the last, for the curve between them.
    while poses.len() < TICKS / TICKS_PER_NODE + 3 {
        let mut n_tries = 0;
        loop {
            let deepest = tool.deepest(pose, solid);
            let outward = tool.way_out(pose, solid, &deepest);
            let lift = outward.reject_from_normalized(across);
            let missing_m = deepest.depth_m - depth_m;
            if missing_m.abs() < 1e-3 * depth_m {
                let next = across.cross(lift.normalize_or_zero());
                along = if next.dot(along) < 0.0 { -next } else { next };
                break;
            }
            n_tries += 1;
            // A normal across the plane does not help.
            if n_tries > 15 || lift.length_squared() < 0.05 {
                return None;
            }
            pose.translation += lift / lift.length_squared() * missing_m;
        }
        poses.push(pose);
        pose.translation += along * step_m;
    }
    Some(poses)
}

/// The poses of all ticks: a smooth curve through the nodes (Catmull and Rom 1974).
pub(super) fn ticks(nodes: &[Pose]) -> Vec<Pose> {
    (0..TICKS)
        .map(|tick| {
            let at = tick / TICKS_PER_NODE;
            let t = (tick % TICKS_PER_NODE) as f64 / TICKS_PER_NODE as f64;
            let [a, b, c, d] = [0, 1, 2, 3].map(|step| nodes[at + step].translation);
            let middle = 2.0 * b
                + t * (c - a)
                + t * t * (2.0 * a - 5.0 * b + 4.0 * c - d)
                + t * t * t * (3.0 * (b - c) + d - a);
            Pose::new(nodes[0].rotation, 0.5 * middle)
        })
        .collect()
}

/// Bakes and slides everything: cost some ten seconds.
fn slide(
    obstacles: &[(&'static str, TriangleMesh)],
    tell: &mut dyn FnMut(&str),
) -> Result<Vec<Slid>, BenchError> {
    let mut slid = Vec::new();
    for n in 0..DIRECTIONS {
        tell(&format!("curved parts: paths {} of {DIRECTIONS}", n + 1));
        let mut random = Random::new(2026 + n);
        // Once is enough for the ablation and what only it has.
        let is_ablated = n == 0;
        let mut tools_here = Vec::new();
        for (name, shape) in tools() {
            let mesh = fixture::turned(shape.tessellate(FINE_M), turn(&mut random));
            let shell = |voxel_size_m: f64, points: Points| {
                fixture::shell_of(name, &mesh, voxel_size_m, points)
            };
            let mut shells = vec![shell(VOXEL_M, Points::Facets)?, shell(VOXEL_M, Points::Voxels)?];
            if is_ablated {
                shells.push(shell(0.5 * VOXEL_M, Points::Facets)?);
            }
            tools_here.push(Tool { name, shells, surface: Surface::new(mesh) });
        }
        let mut parts = Vec::new();
        for (name, mesh) in obstacles.iter().filter(|(name, _)| is_ablated || *name != SHARP) {
            let mesh = fixture::turned(mesh.clone(), turn(&mut random));
            let field = |voxel_size_m: f64| {
                fixture::obstacle(name, &mesh, voxel_size_m, false).map(|obstacle| vec![obstacle])
            };
            let mut fields = vec![field(VOXEL_M)?];
            if is_ablated {
                fields.push(field(0.5 * VOXEL_M)?);
            }
            let lattice = Lattice::new(&fields[0][0].field);
            parts.push(Part { fields, lattice, solid: Solid::new(&mesh) });
        }
        let mut wanted = Vec::new();
        for (obstacle, tool) in (0..parts.len())
            .flat_map(|obstacle| (0..tools_here.len()).map(move |tool| (obstacle, tool)))
        {
            wanted.extend(
                (0..DEPTHS_VOXELS.len())
                    .map(|depth_idx| (obstacle, tool, depth_idx, random.unit().to_bits())),
            );
        }
        let found: Vec<Option<Slid>> = wanted
            .into_par_iter()
            .map(|(obstacle, tool, depth_idx, seed)| {
                slide_one(&tools_here[tool], &parts[obstacle], (obstacle, depth_idx), seed)
            })
            .collect();
        slid.extend(found.into_iter().flatten());
    }
    Ok(slid)
}

fn slide_one(
    tool: &Tool,
    part: &Part,
    (obstacle, depth_idx): (usize, usize),
    seed: u64,
) -> Option<Slid> {
    const ATTEMPTS: usize = 8;
    const REACH_M: f64 = 0.04;
    let depth_m = DEPTHS_VOXELS[depth_idx] * VOXEL_M;
    let mut random = Random::new(seed);
    let nodes = (0..ATTEMPTS)
        .find_map(|_| path(&part.solid, &tool.surface, depth_m, REACH_M, &mut random))?;
    let per_area = STIFFNESS_N_PER_M / (VOXEL_M * VOXEL_M);
    let exact = |at: DVec3| part.solid.at(at).depth_m;
    let on_law = &nodes[1..=TICKS / TICKS_PER_NODE];
    let law = on_law
        .iter()
        .map(|pose| tool.surface.integral(*pose, step_m(depth_m), &exact) * per_area)
        .collect();
    let force = |field: &[Obstacle], shell: &Shell, law: ForceLaw, pose: Pose| {
        ContactSum::flat(field, shell, pose, law).wrench.force
    };
    let poses = ticks(&nodes);
    let forces = core::array::from_fn(|idx| {
        let Setting { points, law, .. } = &SETTINGS[idx];
        let shell = &tool.shells[usize::from(*points == Points::Voxels)];
        poses.iter().map(|pose| force(&part.fields[0], shell, *law, *pose)).collect()
    });
    let mut ablation = Vec::new();
    if let ([tool_s, _, tool_half], [field_s, field_half]) = (&tool.shells[..], &part.fields[..]) {
        let sums = [
            (field_s, tool_s),
            (field_half, tool_s),
            (field_s, tool_half),
            (field_half, tool_half),
        ];
        ablation.extend(sums.map(|(field, shell)| {
            // The same stiffness for an area: points of half the voxel stand for a quarter of it.
            let share = (shell.voxel_size_m() / VOXEL_M).powi(2);
            let law = ForceLaw { stiffness_n_per_m: STIFFNESS_N_PER_M * share, ..ForceLaw::PLAIN };
            on_law.iter().map(|pose| force(field, shell, law, *pose)).collect::<Vec<DVec3>>()
        }));
        let interpolated = |way: Interpolation| move |at: DVec3| part.lattice.at(way, at).0;
        // Far from the surface both are no contact.
        let near = |at: DVec3| {
            if interpolated(Interpolation::Linear)(at) > -VOXEL_M { exact(at) } else { 0.0 }
        };
        ablation.push(on_law.iter().map(|pose| with_exact_depths(tool_s, *pose, &near)).collect());
        for way in [Interpolation::Linear, Interpolation::Fitted, Interpolation::Cubic] {
            let integral = |pose: &Pose| {
                tool.surface.integral(*pose, step_m(depth_m), &interpolated(way)) * per_area
            };
            ablation.push(on_law.iter().map(integral).collect());
            ablation.push(
                on_law
                    .iter()
                    .map(|pose| with_spread_points(tool_s, *pose, &|at| part.lattice.at(way, at)))
                    .collect(),
            );
        }
    }
    Some(Slid { tool: tool.name, obstacle, depth_idx, law, forces, ablation })
}

/// What an ablation changes, in the order of [`Slid::ablation`].
const ABLATION: [&str; 11] = [
    "both of 0.5 mm",
    "field of 0.25, tool of 0.5 mm",
    "field of 0.5, tool of 0.25 mm",
    "both of 0.25 mm",
    "exact depths at the tool's points of 0.5 mm",
    "field of 0.5 mm on the tool's whole surface",
    "points that count what is immersed of their facets",
    "moved samples of 0.5 mm on the tool's whole surface",
    "points that count what is immersed of their facets, moved samples",
    "cubic field of 0.5 mm on the tool's whole surface",
    "points that count what is immersed of their facets, cubic field",
];

/// The sum over points with exact depths, each along its own normal, N.
fn with_exact_depths(shell: &Shell, pose: Pose, depth: &impl Fn(DVec3) -> f64) -> DVec3 {
    let weights = shell.weights().iter().flat_map(|weights| weights.0);
    let pushes = shell.points().zip(weights).map(|((point, normal), weight)| {
        let depth_m = depth(pose.transform_point(point.as_dvec3())).max(0.0);
        pose.transform_vector(normal.as_dvec3()) * (depth_m * f64::from(weight) * STIFFNESS_N_PER_M)
    });
    pushes.sum()
}

/// The sum over points each of which counts what is immersed of its facet, all along their own
/// normals, N. A facet reaches as far below and above its middle as a square of its area does on
/// the slope that the field has along it; `field`: depth and gradient.
fn with_spread_points(shell: &Shell, pose: Pose, field: &impl Fn(DVec3) -> (f64, DVec3)) -> DVec3 {
    let weights = shell.weights().iter().flat_map(|weights| weights.0);
    let pushes = shell.points().zip(weights).map(|((point, normal), weight)| {
        let (depth_m, gradient) = field(pose.transform_point(point.as_dvec3()));
        let normal = pose.transform_vector(normal.as_dvec3());
        let weight = f64::from(weight);
        let reach_m = 0.5
            * weight.sqrt()
            * shell.voxel_size_m()
            * gradient.reject_from_normalized(normal).length();
        normal * (spread(depth_m, reach_m) * weight * STIFFNESS_N_PER_M)
    });
    pushes.sum()
}

/// What is said of some paths.
#[derive(Default)]
struct Figures {
    ripple_percent: Vec<f64>,
    error_percent: Vec<f64>,
    angle_deg: Vec<f64>,
    n_lost: usize,
    n: usize,
}

fn rms(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| {
        (values.iter().map(|value| value * value).sum::<f64>() / values.len() as f64).sqrt()
    })
}

impl Figures {
    /// Adds one path: forces at the rate of the law.
    fn add(
        &mut self,
        law: &[DVec3],
        forces: impl Iterator<Item = DVec3>,
        ripple_percent: Option<f64>,
    ) {
        let mean_n = law.iter().map(|law| law.length()).sum::<f64>() / law.len() as f64;
        let mut errors = Vec::new();
        for (law, force) in law.iter().zip(forces) {
            errors.push(100.0 * (force - *law).length() / mean_n);
            if law.length() > LEAST_SHARE * mean_n {
                self.n += 1;
                if force == DVec3::ZERO {
                    self.n_lost += 1
                } else {
                    self.angle_deg.push(force.angle_between(*law).to_degrees())
                }
            }
        }
        self.error_percent.extend(rms(&errors));
        self.ripple_percent.extend(ripple_percent);
    }

    fn p95_deg(&self) -> Option<f64> {
        let mut sorted = self.angle_deg.clone();
        sorted.sort_by(f64::total_cmp);
        quantile(&sorted, 0.95)
    }

    fn lost_percent(&self) -> Option<f64> {
        (self.n > 0).then(|| 100.0 * self.n_lost as f64 / self.n as f64)
    }
}

/// RMS above 10 Hz, % of the mean force: what has lost half of its force is no smoother for it.
fn ripple_percent(forces: &[DVec3], rate_hz: f64) -> Option<f64> {
    let mean_n = forces.iter().map(|force| force.length()).sum::<f64>() / forces.len() as f64;
    ripple_rms(forces, rate_hz).filter(|_| mean_n > 0.0).map(|rms_n| 100.0 * rms_n / mean_n)
}

/// What of the ripple is not the law's: of the difference when both are related to their mean, at
/// the rate of the law.
fn own_ripple_percent(forces: &[DVec3], law: &[DVec3]) -> Option<f64> {
    let mean_n = |forces: &[DVec3]| {
        forces.iter().map(|force| force.length()).sum::<f64>() / forces.len() as f64
    };
    let of_forces = mean_n(forces);
    let of_law = mean_n(law);
    let difference: Vec<DVec3> =
        forces.iter().zip(law).map(|(force, law)| *force / of_forces - *law / of_law).collect();
    ripple_rms(&difference, RATE_HZ / TICKS_PER_NODE as f64)
        .filter(|_| of_forces > 0.0)
        .map(|rms| 100.0 * rms)
}

fn at_law(forces: &[DVec3]) -> Vec<DVec3> {
    forces.iter().step_by(TICKS_PER_NODE).copied().collect()
}

const GROUP: &str = "slides over curved parts at constant depth";

pub(super) fn rows(
    options: &Options,
    csv: &mut Csv,
    tell: &mut dyn FnMut(&str),
) -> Result<Vec<Row>, BenchError> {
    if options.quick {
        return Ok(vec![Row::new(GROUP, "skipped: --quick", None, "%")]);
    }
    let obstacles = obstacles(options);
    let slid = slide(&obstacles, tell)?;
    let mut file = csv.file(
        "curved.csv",
        "obstacle,tool,depth_voxels,t_s,law_x_n,law_y_n,law_z_n,setting,fx_n,fy_n,fz_n",
    )?;
    for slid in &slid {
        for (setting, forces) in SETTINGS.iter().zip(&slid.forces) {
            for (node, (law, force)) in
                slid.law.iter().zip(forces.iter().step_by(TICKS_PER_NODE)).enumerate()
            {
                let obstacle = obstacles[slid.obstacle].0;
                let depth = DEPTHS_VOXELS[slid.depth_idx];
                let name = setting.name;
                let time_s = (node * TICKS_PER_NODE) as f64 / RATE_HZ;
                let ([lx, ly, lz], [x, y, z]) = (law.to_array(), force.to_array());
                file.line(format_args!(
                    "{obstacle},{},{depth},{time_s},{lx},{ly},{lz},\"{name}\",{x},{y},{z}",
                    slid.tool
                ))?;
            }
        }
    }
    file.finish()?;
    let mut rows = Vec::new();
    for (depth_idx, depth) in DEPTHS_VOXELS.iter().enumerate() {
        let names =
            obstacles.iter().map(|(name, _)| *name).enumerate().filter(|(_, name)| *name != SHARP);
        let all = (None, "all obstacles");
        for (obstacle, name) in names.clone().map(|(idx, name)| (Some(idx), name)).chain([all]) {
            let group = format!("{GROUP}: {name}, {depth} voxels deep");
            let is_sharp = |slid: &Slid| obstacles[slid.obstacle].0 == SHARP;
            let here: Vec<&Slid> = slid
                .iter()
                .filter(|slid| {
                    slid.depth_idx == depth_idx
                        && obstacle.map_or(!is_sharp(slid), |idx| slid.obstacle == idx)
                })
                .collect();
            rows.extend(rows_of(&group, &here));
        }
    }
    if obstacles.iter().all(|(name, _)| *name != "rocker arm") {
        rows.push(Row::new(
            GROUP,
            "rocker arm: skipped: HAPTICD_MODELS not set or without rocker-arm.obj",
            None,
            "%",
        ));
    }
    for (depth_idx, depth) in DEPTHS_VOXELS.iter().enumerate() {
        for (idx, (name, _)) in obstacles.iter().enumerate() {
            let group = format!("what the error of facets is made of: {name}, {depth} voxels deep");
            for (which, what) in ABLATION.iter().enumerate() {
                let mut figures = Figures::default();
                let mut own = Vec::new();
                for slid in slid.iter().filter(|slid| {
                    (slid.obstacle, slid.depth_idx) == (idx, depth_idx) && !slid.ablation.is_empty()
                }) {
                    figures.add(&slid.law, slid.ablation[which].iter().copied(), None);
                    own.extend(own_ripple_percent(&slid.ablation[which], &slid.law));
                }
                rows.push(Row::new(
                    &group,
                    format!("{what}: error, RMS"),
                    rms(&figures.error_percent),
                    "%",
                ));
                rows.push(Row::new(&group, format!("{what}: angle, p95"), figures.p95_deg(), "°"));
                rows.push(Row::new(
                    &group,
                    format!("{what}: ripple that the law does not have"),
                    rms(&own),
                    "%",
                ));
            }
        }
    }
    Ok(rows)
}

fn rows_of(group: &str, slid: &[&Slid]) -> Vec<Row> {
    let of = |idx: usize| {
        let mut figures = Figures::default();
        for slid in slid {
            let ripple = ripple_percent(&slid.forces[idx], RATE_HZ);
            figures.add(
                &slid.law,
                slid.forces[idx].iter().step_by(TICKS_PER_NODE).copied(),
                ripple,
            );
        }
        figures
    };
    let raw = rms(&of(RAW).ripple_percent).ok_or_else(|| "no contact".to_owned());
    let law: Vec<f64> = slid
        .iter()
        .filter_map(|slid| ripple_percent(&slid.law, RATE_HZ / TICKS_PER_NODE as f64))
        .collect();
    let own = |idx: usize| {
        rms(&slid
            .iter()
            .filter_map(|slid| own_ripple_percent(&at_law(&slid.forces[idx]), &slid.law))
            .collect::<Vec<f64>>())
    };
    let raw_own = own(RAW).ok_or_else(|| "no contact".to_owned());
    let mut rows = vec![
        Row::new(group, "paths", slid.len() as f64, ""),
        Row::new(group, "the exact law: ripple above 10 Hz, RMS", rms(&law), "%"),
    ];
    for (idx, Setting { name, .. }) in SETTINGS.iter().enumerate() {
        let figures = of(idx);
        let ripple = Row::new(
            group,
            format!("{name}: ripple above 10 Hz, RMS"),
            rms(&figures.ripple_percent),
            "%",
        );
        let ripple = if idx == RAW { ripple } else { ripple.beside_peer("raw", &raw) };
        let error =
            Row::new(group, format!("{name}: error, RMS"), rms(&figures.error_percent), "%");
        let worst = figures.error_percent.iter().copied().reduce(f64::max);
        let p95 = Row::new(group, format!("{name}: angle to the law, p95"), figures.p95_deg(), "°");
        let is_judged = SETTINGS[idx].points == Points::Facets;
        rows.push(if is_judged { ripple.at_least_times(10.0) } else { ripple });
        let own =
            Row::new(group, format!("{name}: ripple that the law does not have"), own(idx), "%");
        rows.push(if idx == RAW { own } else { own.beside_peer("raw", &raw_own) });
        rows.push(if is_judged { error.at_most(2.0) } else { error });
        rows.push(Row::new(group, format!("{name}: error of the worst path"), worst, "%"));
        rows.push(Row::new(
            group,
            format!("{name}: angle to the law, median"),
            median(&figures.angle_deg),
            "°",
        ));
        rows.push(if is_judged { p95.at_most(2.0) } else { p95 });
        rows.push(Row::new(group, format!("{name}: lost"), figures.lost_percent(), "%"));
    }
    rows
}
