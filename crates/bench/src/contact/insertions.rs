//! What voxel size an insertion needs: peg into hole, nut down its thread, gear into mesh, each
//! with a hand that goes straight, and with one that is 0.2 mm beside the axis and 1° tilted.
//!
//! The parts are those of the shipped scenes. Clearances of the peg are set by its radius; below
//! zero the peg is larger than the hole, and goes in where the hand presses with more than the
//! law's ½ κ overlap² for each length of the rim. Everything runs on the virtual clock, so that the
//! table is the same on every machine.

use core::fmt::Write as _;
use std::path::{Path, PathBuf};

use document::poses;
use glam::{DQuat, DVec3};
use recording::TickRecord;
use toml::Value;

use super::super::export::{TemporaryFolder, write_stl};
use super::super::{BenchError, Row};
use super::Options;
use super::scenarios::RATE_HZ;
use super::scenes::{self, Edit, Played};
use hapticd::scene::cache::{Cache, CachePolicy};
use haptics::Faults;
use vps::spatial::Pose;

/// A hand that is not where it should be: beside the axis along x, m, and tilted about (1, 1, 0),
/// rad.
const MISALIGNED: (f64, f64) = (0.2e-3, core::f64::consts::PI / 180.0);
/// Voxel sizes of fixed parts, mm; a tool has points at twice that, as in the shipped scenes.
const VOXELS_MM: [f64; 3] = [0.1, 0.2, 0.4];
/// Clearances of the peg, mm in radius.
const CLEARANCES_MM: [f64; 8] = [-0.1, -0.05, -0.02, -0.01, -0.005, 0.02, 0.05, 0.1];
/// Radius of the hole, mm.
const HOLE_MM: f64 = 4.05;
/// Radius of the shipped peg, mm.
const PEG_MM: f64 = 4.0;

const GROUP: &str = "insertions, simulated sigma.7-class arm";

/// One insertion at one voxel size.
#[derive(Clone, Debug)]
struct Insertion {
    case: String,
    voxel_mm: f64,
    is_misaligned: bool,
    is_in: bool,
    /// On the hand.
    peak_n: f64,
    /// Of the deepest point.
    depth_m: f64,
    faults: Faults,
}

/// A scene of the shipped ones, the way of its hand, and how far in counts as in.
struct Case<'a> {
    scene: &'static str,
    name: String,
    edits: Vec<Edit>,
    path: &'a dyn Fn(f64) -> Pose,
    end_s: f64,
    is_in: &'a dyn Fn(&Pose) -> bool,
}

/// The rows, and the table as markdown. Cost: five minutes; quick, some seconds.
pub(super) fn measure(
    options: &Options,
    tell: &mut dyn FnMut(&str),
) -> Result<(Vec<Row>, String), BenchError> {
    if scenes::shipped(&options.scenes).is_empty() {
        let skipped = format!("skipped: no scenes in {} (--scenes)", options.scenes.display());
        return Ok((vec![Row::new(GROUP, skipped, None, "")], String::new()));
    }
    let folder = TemporaryFolder::create()
        .map_err(|source| BenchError::Write { path: std::env::temp_dir(), source })?;
    let mut cache = Cache::at(folder.path().join("cache"), CachePolicy::Copy);
    let (voxels, clearances): (&[f64], &[f64]) =
        if options.quick { (&[0.2], &[-0.1, 0.1]) } else { (&VOXELS_MM, &CLEARANCES_MM) };
    let mut found = Vec::new();
    let mut play = |case: &Case<'_>| -> Result<(), BenchError> {
        for &voxel_mm in voxels {
            for is_misaligned in [false, true] {
                tell(&format!(
                    "{}, voxels of {voxel_mm} mm{}",
                    case.name,
                    if is_misaligned { ", misaligned" } else { "" }
                ));
                found.extend(insert(
                    options,
                    case,
                    voxel_mm,
                    is_misaligned,
                    folder.path(),
                    &mut cache,
                )?);
            }
        }
        Ok(())
    };
    // 5 mm above the block, down to 2 mm below the floor of the hole.
    let down = |from_m: f64, to_m: f64, in_s: f64| {
        move |t: f64| {
            Pose::from_translation(DVec3::Z * (from_m + (to_m - from_m) * smooth(t / in_s)))
        }
    };
    let peg_path = down(5e-3, -22e-3, 3.0);
    for &clearance_mm in clearances {
        let mesh = peg_of(options, HOLE_MM - clearance_mm, folder.path())?;
        play(&Case {
            scene: "peg-in-hole",
            name: format!("peg, {clearance_mm} mm of clearance"),
            edits: vec![("tool.mesh", mesh.to_string_lossy().into_owned().into()), start(5.0)],
            path: &peg_path,
            end_s: 4.0,
            is_in: &|tool| tool.translation.z < -19.5e-3,
        })?;
    }
    if !options.quick {
        const TURNS: f64 = 1.5;
        const PITCH_M: f64 = 2e-3;
        play(&Case {
            scene: "nut-on-bolt",
            name: "nut, 0.075 mm between the flanks".to_owned(),
            edits: Vec::new(),
            path: &|t| {
                let turns = TURNS * smooth((t - 0.5) / 7.0);
                Pose::new(
                    DQuat::from_rotation_z(-turns * core::f64::consts::TAU),
                    DVec3::Z * (34e-3 - turns * PITCH_M),
                )
            },
            end_s: 8.0,
            // Within a tenth of the pitch of where 1.5 turns lead, and turned by them to 5°.
            is_in: &|tool| {
                let half_turn = DQuat::from_rotation_z(core::f64::consts::PI);
                (tool.translation.z - 31e-3).abs() < 0.1 * PITCH_M
                    && tool.rotation.angle_between(half_turn).to_degrees() < 5.0
            },
        })?;
        // 3 mm straight down, which the thread must not allow.
        let pressed = down(34e-3, 31e-3, 2.0);
        play(&Case {
            scene: "nut-on-bolt",
            name: "nut, pressed without a turn".to_owned(),
            edits: Vec::new(),
            path: &pressed,
            end_s: 3.0,
            is_in: &|tool| tool.translation.z < 33.8e-3,
        })?;
        let gear_path = down(36e-3, 2e-3, 4.0);
        play(&Case {
            scene: "gear-on-shaft",
            name: "gear, 0.2 mm of backlash".to_owned(),
            edits: vec![start(36.0)],
            path: &gear_path,
            end_s: 5.0,
            is_in: &|tool| tool.translation.z < 4.2e-3,
        })?;
    }
    Ok((found.iter().flat_map(Insertion::rows).collect(), table(&found)))
}

/// 0 to 1 over t = 0 to 1, starting and ending at rest.
fn smooth(t: f64) -> f64 {
    let t = t.clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// The tool starts on the axis, this high.
fn start(z_mm: f64) -> Edit {
    ("tool.start_position_mm", Value::Array(vec![0.0.into(), 0.0.into(), z_mm.into()]))
}

/// The shipped peg with another radius.
fn peg_of(options: &Options, radius_mm: f64, folder: &Path) -> Result<PathBuf, BenchError> {
    let shipped = options.scenes.join("../models/peg.obj");
    let mut mesh = vps::mesh::load(&shipped, 1e-3).map_err(|error| BenchError::Prepare {
        what: shipped.display().to_string(),
        why: error.to_string(),
    })?;
    let factor = radius_mm / PEG_MM;
    for vertex in &mut mesh.vertices {
        (vertex.x, vertex.y) = (vertex.x * factor, vertex.y * factor);
    }
    let path = folder.join(format!("peg-{radius_mm:.3}.stl"));
    write_stl(&path, &mesh).map_err(|source| BenchError::Write { path: path.clone(), source })?;
    Ok(path)
}

/// The way of the hand as a file, moved and tilted as a whole.
fn write_hand(path: &Path, case: &Case<'_>, is_misaligned: bool) -> Result<(), BenchError> {
    let (beside_m, tilt_rad) = if is_misaligned { MISALIGNED } else { (0.0, 0.0) };
    let tilt = DQuat::from_axis_angle(DVec3::new(1.0, 1.0, 0.0).normalize(), tilt_rad);
    let mut text = format!("{}\n", poses::HEADER);
    for k in 0..=(case.end_s * 100.0) as usize {
        let time_s = k as f64 / 100.0;
        let pose = (case.path)(time_s);
        let p = pose.translation + DVec3::X * beside_m;
        let q = tilt * pose.rotation;
        let _ = writeln!(
            text,
            "{time_s:.2},{:.9},{:.9},{:.9},{:.9},{:.9},{:.9},{:.9}",
            p.x, p.y, p.z, q.x, q.y, q.z, q.w
        );
    }
    std::fs::write(path, text).map_err(|source| BenchError::Write { path: path.to_owned(), source })
}

/// Plays it; nothing where there is no such scene.
fn insert(
    options: &Options,
    case: &Case<'_>,
    voxel_mm: f64,
    is_misaligned: bool,
    folder: &Path,
    cache: &mut Cache,
) -> Result<Option<Insertion>, BenchError> {
    let Some(scene) =
        scenes::shipped(&options.scenes).into_iter().find(|path| scenes::name(path) == case.scene)
    else {
        return Ok(None);
    };
    let hand = folder.join("hand.csv");
    write_hand(&hand, case, is_misaligned)?;
    let mut edits = case.edits.clone();
    edits.push(("device.hand", hand.to_string_lossy().into_owned().into()));
    edits.push(("static.voxel_size_mm", voxel_mm.into()));
    edits.push(("tool.voxel_size_mm", (2.0 * voxel_mm).into()));
    let refused = |why: String| BenchError::Prepare { what: case.name.clone(), why };
    let config = scenes::load(&scene, &edits, folder).map_err(refused)?;
    let played = scenes::play(&config, cache, case.end_s + 1.0)?;
    Ok(Some(judge(case, voxel_mm, is_misaligned, &played)))
}

fn judge(case: &Case<'_>, voxel_mm: f64, is_misaligned: bool, played: &Played) -> Insertion {
    let records = played.before_stop();
    let largest = |of: &dyn Fn(&TickRecord) -> f64| records.iter().map(of).fold(0.0, f64::max);
    // In, and still so after half a second.
    let last = &records[records.len().saturating_sub((0.5 * RATE_HZ) as usize)..];
    Insertion {
        case: case.name.clone(),
        voxel_mm,
        is_misaligned,
        is_in: !last.is_empty()
            && last.iter().all(|record| (case.is_in)(&record.output.world_from_tool)),
        peak_n: largest(&|record| record.output.commanded_device.force.length()),
        depth_m: largest(&|record| record.output.max_depth_m),
        faults: played.faults,
    }
}

impl Insertion {
    fn rows(&self) -> [Row; 3] {
        let Self { case, voxel_mm, is_misaligned, is_in, peak_n, depth_m, faults } = self;
        let hand = if *is_misaligned { "0.2 mm beside, 1° tilted" } else { "straight" };
        let name = format!("{case}, voxels of {voxel_mm} mm, {hand}");
        let ended =
            if faults.is_empty() { String::new() } else { format!(", ended by {faults:?}") };
        [
            Row::new(GROUP, format!("{name}: is in{ended}"), f64::from(u8::from(*is_in)), ""),
            Row::new(GROUP, format!("{name}: largest force on the hand"), *peak_n, "N"),
            Row::new(GROUP, format!("{name}: deepest point"), *depth_m * 1e3, "mm"),
        ]
    }
}

/// A line for each case and hand, a column for each voxel size.
fn table(found: &[Insertion]) -> String {
    let mut voxels: Vec<f64> = found.iter().map(|insertion| insertion.voxel_mm).collect();
    voxels.sort_by(f64::total_cmp);
    voxels.dedup();
    let mut text = String::from("\n| insertion | hand |");
    for voxel_mm in &voxels {
        let _ = write!(text, " voxels of {voxel_mm} mm |");
    }
    let _ = writeln!(text, "\n|---|---|{}", "---|".repeat(voxels.len()));
    let mut lines: Vec<(&str, bool)> = Vec::new();
    for insertion in found {
        let line = (insertion.case.as_str(), insertion.is_misaligned);
        if !lines.contains(&line) {
            lines.push(line);
        }
    }
    for (case, is_misaligned) in lines {
        let _ = write!(
            text,
            "| {case} | {} |",
            if is_misaligned { "beside, tilted" } else { "straight" }
        );
        for voxel_mm in &voxels {
            let one = |insertion: &&Insertion| {
                insertion.case == case
                    && insertion.is_misaligned == is_misaligned
                    && insertion.voxel_mm == *voxel_mm
            };
            match found.iter().find(one) {
                Some(Insertion { is_in, peak_n, depth_m, .. }) => {
                    let _ = write!(
                        text,
                        " {}, {peak_n:.1} N, {:.2} mm |",
                        if *is_in { "in" } else { "**out**" },
                        depth_m * 1e3
                    );
                }
                None => text.push_str(" |"),
            }
        }
        text.push('\n');
    }
    text
}
