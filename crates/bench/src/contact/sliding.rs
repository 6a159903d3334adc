//! Smoothness of the force law alone: the parts of every shipped scene slide over each other at
//! constant depth, whatever a hand would do.
//!
//! | scene | slide, 50 mm/s where it touches |
//! |---|---|
//! | block-on-plane | tilted by 2°, across the grid |
//! | peg-in-hole | pressed to one side, turning and going down the hole |
//! | gear-on-shaft | bore pressed against the shaft, turning and going down it |
//! | nut-on-bolt | pulled up against the flanks, screwed along the thread |
//!
//! *As shipped* is the contact sum of the scene behind its low-pass, as an arm without a virtual
//! tool would get it: the whole delay of the filter. *Raw* is the voxel plane of 2008: a point for
//! each voxel, `layers`, no low-pass, otherwise the same. Both are related to
//! their own mean: a force that is only smaller is no smoother.

use core::f64::consts::{PI, TAU};
use std::path::{Path, PathBuf};

use glam::{DQuat, DVec3};

use super::super::{BenchError, Row};
use super::ripple::{lag_s, ripple_rms};
use super::scenarios::{RATE_HZ, SPEED_M_PER_S};
use super::{Csv, scenes};
use hapticd::config::SceneConfig;
use hapticd::daemon::prepare_with;
use hapticd::scene::BakeOptions;
use hapticd::scene::cache::Cache;
use haptics::RenderScene;
use haptics::filter::{ShapingFilter, Slide};
use haptics::stability::filter_delay_s;
use vps::contact::ContactSum;
use vps::contact::ForceLaw;
use vps::pointshell::Points;
use vps::spatial::{Pose, Wrench};
use vps::voxmap::field::FieldKind;

const MM: f64 = 1e-3;
/// Depths of the deepest point of a slide, voxels of the finest part that is touched. The first is
/// what a tool gets to in the shipped scenes as they run (0.08 to 0.3), and what is asked about;
/// the second says what becomes of it.
pub const DEPTHS_VOXELS: [f64; 2] = [0.25, 0.5];
/// What is left out at both ends of a slide: the filter's start, s.
const SETTLED_S: f64 = 0.05;
/// Pressing at rest, for the delay: a third of the depth more and less.
const PRESS_HZ: f64 = 5.0;
const PRESS_S: f64 = 1.2;
const PRESS_SHARE: f64 = 0.33;

/// A slide over one scene.
struct Track {
    scene: &'static str,
    long_s: f64,
    /// Unit direction in which the tool is pressed, and bounds of how far, m.
    press: DVec3,
    far_m: [f64; 2],
    /// Pose of the tool frame before it is pressed, by time.
    at: fn(f64) -> Pose,
}

const TRACKS: [Track; 4] = [
    Track {
        scene: "block-on-plane",
        long_s: 0.8,
        press: DVec3::NEG_Z,
        far_m: [0.0, 2.0 * MM],
        at: |time_s| {
            let tilt = DQuat::from_axis_angle(DVec3::new(0.7, 1.0, 0.0).normalize(), PI / 90.0);
            let along = DVec3::new(1.0, 0.3, 0.0).normalize() * (SPEED_M_PER_S * (time_s - 0.4));
            Pose::new(tilt, along + DVec3::Z * 11.0 * MM)
        },
    },
    Track {
        scene: "peg-in-hole",
        long_s: 0.8,
        press: DVec3::new(0.8, 0.6, 0.0),
        far_m: [0.0, 0.5 * MM],
        at: |time_s| down_and_around(4.0 * MM, time_s, -10.0 * MM, 8.0 * MM),
    },
    Track {
        scene: "gear-on-shaft",
        long_s: 0.8,
        press: DVec3::new(0.8, 0.6, 0.0),
        far_m: [0.0, 0.6 * MM],
        at: |time_s| down_and_around(4.0 * MM, time_s, 14.5 * MM, 2.0 * MM),
    },
    Track {
        scene: "nut-on-bolt",
        long_s: 0.8,
        press: DVec3::Z,
        far_m: [0.0, 0.3 * MM],
        at: |time_s| {
            let turns = -SPEED_M_PER_S / (7.4 * MM) * time_s / TAU;
            Pose::new(DQuat::from_rotation_z(TAU * turns), DVec3::Z * (32.0 + 2.0 * turns) * MM)
        },
    },
];

/// Turns about z with the speed of the slides at a radius, and goes down by some millimetres within
/// a second.
fn down_and_around(radius_m: f64, time_s: f64, from_m: f64, down_m: f64) -> Pose {
    Pose::new(
        DQuat::from_rotation_z(SPEED_M_PER_S / radius_m * time_s),
        DVec3::Z * (from_m - down_m * time_s),
    )
}

/// Forces of one slide, N, tick by tick.
#[derive(Clone, Debug)]
pub struct SlideForces {
    /// Name of the scene.
    pub scene: String,
    /// Depth of the deepest point, voxels.
    pub depth_voxels: f64,
    /// Of 2008.
    pub raw: Vec<DVec3>,
    /// The shipped field, without the low-pass: no delay.
    pub unfiltered: Vec<DVec3>,
    /// As shipped.
    pub shipped: Vec<DVec3>,
    /// How late the shipped force follows the depth at 5 Hz, s.
    pub delay_s: f64,
    /// The most that it may: what the filter states for a slow force, s.
    pub stated_delay_s: f64,
}

/// RMS above 10 Hz, % of the mean force; `None` without a force.
pub fn ripple_percent(forces: &[DVec3]) -> Option<f64> {
    let mean_n = forces.iter().map(|force| force.length()).sum::<f64>() / forces.len() as f64;
    ripple_rms(forces, RATE_HZ).filter(|_| mean_n > 0.0).map(|rms_n| 100.0 * rms_n / mean_n)
}

impl SlideForces {
    /// How many times rougher the raw force is.
    pub fn times_smoother(&self) -> Option<f64> {
        Some(ripple_percent(&self.raw)? / ripple_percent(&self.shipped)?)
    }
}

/// Slides over the shipped scenes of a folder at each of some depths, in the order of the table;
/// scenes that are not there are left out.
///
/// # Errors
/// A scene that cannot be baked.
pub fn slides(scenes_folder: &Path, depths_voxels: &[f64]) -> Result<Vec<SlideForces>, BenchError> {
    slides_with(scenes_folder, depths_voxels, &mut Cache::off(), &mut |_| ())
}

pub(super) fn slides_with(
    folder: &Path,
    depths_voxels: &[f64],
    cache: &mut Cache,
    tell: &mut dyn FnMut(&str),
) -> Result<Vec<SlideForces>, BenchError> {
    let shipped: Vec<PathBuf> = scenes::shipped(folder);
    let mut slid = Vec::new();
    for track in &TRACKS {
        let Some(path) = shipped.iter().find(|path| scenes::name(path) == track.scene) else {
            continue;
        };
        tell(&format!("{}: sliding at constant depth", track.scene));
        let failed = |why: String| BenchError::Prepare { what: track.scene.to_owned(), why };
        let config = hapticd::config::load(path).map_err(|errors| failed(errors.to_string()))?;
        let mut of_2008 = config.clone();
        of_2008.tool.points = Points::Voxels;
        let mut bake = |config: &SceneConfig| {
            let baked = prepare_with(config, &mut BakeOptions::from(&mut *cache), |_| ());
            baked.map(|(prepared, _)| prepared.scene).map_err(|error| failed(error.to_string()))
        };
        let scene = bake(&config)?;
        let of_2008 = bake(&of_2008)?;
        slid.extend(
            depths_voxels.iter().map(|depth_voxels| track.slide(&scene, &of_2008, *depth_voxels)),
        );
    }
    Ok(slid)
}

impl Track {
    fn slide(&self, scene: &RenderScene, of_2008: &RenderScene, depth_voxels: f64) -> SlideForces {
        let p = &scene.parameters;
        let force_law = |scene: &RenderScene, law: ForceLaw, pose: Pose| {
            let body = pose * Pose::from_translation(scene.tool.center_of_mass_tool);
            ContactSum::flat(&scene.obstacles, &scene.tool.shell, body, law)
        };
        let shipped_law = |pose: Pose| force_law(scene, p.force_law(), pose);
        let raw_law = ForceLaw { field: FieldKind::Layers, ..p.contact.force_law() };
        let pressed = |pose: Pose, far_m: f64| {
            Pose::new(pose.rotation, pose.translation + self.press * far_m)
        };
        let middle = (self.at)(0.5 * self.long_s);
        let far_m = |wanted_voxels: f64| {
            let [mut low_m, mut high_m] = self.far_m;
            for _ in 0..40 {
                let far_m = 0.5 * (low_m + high_m);
                let sum = shipped_law(pressed(middle, far_m));
                if sum.max_value_m < wanted_voxels * sum.voxel_size_m {
                    low_m = far_m
                } else {
                    high_m = far_m
                }
            }
            high_m
        };
        let filtered = |poses: &mut dyn Iterator<Item = Pose>, speed_m_per_s: f64| -> Vec<DVec3> {
            let mut filter = ShapingFilter::default();
            poses
                .map(|pose| {
                    let sum = shipped_law(pose);
                    let slide = Slide {
                        speed_m_per_s,
                        voxel_size_m: sum.voxel_size_m,
                        contact_rad_per_s: 0.0,
                    };
                    let wrench: Wrench =
                        filter.update(sum.wrench, slide, sum.contacts > 0, &p.filter, p.period_s);
                    wrench.force
                })
                .collect()
        };
        let depth_m = far_m(depth_voxels);
        let n_ticks = (self.long_s * RATE_HZ) as usize;
        let poses = || (0..n_ticks).map(|tick| pressed((self.at)(tick as f64 / RATE_HZ), depth_m));
        let n_ends = (SETTLED_S * RATE_HZ) as usize;
        let settled = |forces: Vec<DVec3>| forces[n_ends..n_ticks - n_ends].to_vec();
        let raw =
            settled(poses().map(|pose| force_law(of_2008, raw_law, pose).wrench.force).collect());
        let unfiltered = settled(poses().map(|pose| shipped_law(pose).wrench.force).collect());
        let shipped = settled(filtered(&mut poses(), SPEED_M_PER_S));
        // At rest the filter is slowest.
        let swing: Vec<f64> = (0..(PRESS_S * RATE_HZ) as usize)
            .map(|tick| (TAU * PRESS_HZ * tick as f64 / RATE_HZ).sin())
            .collect();
        let step_m = far_m(depth_voxels * (1.0 + PRESS_SHARE)) - depth_m;
        let answer =
            filtered(&mut swing.iter().map(|swing| pressed(middle, depth_m + step_m * swing)), 0.0);
        let at_once: Vec<f64> = swing
            .iter()
            .map(|swing| {
                shipped_law(pressed(middle, depth_m + step_m * swing)).wrench.force.dot(-self.press)
            })
            .collect();
        let answer: Vec<f64> = answer.iter().map(|force| force.dot(-self.press)).collect();
        // Whole swings, from the second on.
        let from = (RATE_HZ / PRESS_HZ) as usize;
        let delay_s =
            lag_s(&at_once[from..], &answer[from..], PRESS_HZ, RATE_HZ).unwrap_or(f64::NAN);
        let stated_delay_s = filter_delay_s(p.filter.cutoff_hz[0], p.period_s);
        SlideForces {
            scene: self.scene.to_owned(),
            depth_voxels,
            raw,
            unfiltered,
            shipped,
            delay_s,
            stated_delay_s,
        }
    }
}

pub(super) fn rows(slides: &[SlideForces], csv: &mut Csv) -> Result<Vec<Row>, BenchError> {
    const GROUP: &str = "smoothness of the force law: sliding at constant depth, as shipped beside \
        the raw force of 2008";
    let mut series = csv.file("slides.csv", "scene,depth_voxels,law,t_s,fx_n,fy_n,fz_n")?;
    let mut rows = Vec::new();
    for slid in slides {
        let SlideForces { scene, depth_voxels, raw, unfiltered, shipped, delay_s, stated_delay_s } =
            slid;
        for (law, forces) in [("raw", raw), ("unfiltered", unfiltered), ("shipped", shipped)] {
            for (tick, force) in forces.iter().enumerate() {
                let [x, y, z] = force.to_array();
                series.line(format_args!(
                    "{scene},{depth_voxels},{law},{},{x},{y},{z}",
                    tick as f64 / RATE_HZ
                ))?;
            }
        }
        let raw = ripple_percent(raw).ok_or_else(|| "no contact".to_owned());
        let ripple = |what: &str, forces: &[DVec3]| {
            Row::new(
                GROUP,
                format!("{scene}, {depth_voxels} voxels deep: ripple above 10 Hz, RMS, {what}"),
                ripple_percent(forces),
                "%",
            )
            .beside_peer("raw", &raw)
        };
        let as_shipped = ripple("as shipped", shipped);
        rows.push(if *depth_voxels == DEPTHS_VOXELS[0] {
            as_shipped.at_least_times(10.0)
        } else {
            as_shipped
        });
        rows.push(ripple("without the low-pass", unfiltered));
        let delay = Row::new(
            GROUP,
            format!("{scene}, {depth_voxels} voxels deep: delay from depth to force at 5 Hz"),
            delay_s * 1e3,
            "ms",
        );
        rows.push(delay.at_most(stated_delay_s * 1e3));
    }
    series.finish()?;
    Ok(rows)
}
