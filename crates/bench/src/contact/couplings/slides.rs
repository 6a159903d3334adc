//! Q1 up the slope of 10° through every coupling, on the ideal arm: how rough, how late.

use core::f64::consts::TAU;
use core::fmt::Write as _;
use std::path::PathBuf;

use glam::DVec3;

use super::super::super::export::write_stl;
use super::super::super::{BenchError, Row};
use super::super::ripple::{lag_s, ripple_rms};
use super::super::scenarios::{RATE_HZ, SPEED_M_PER_S, VOXEL_M, slab};
use super::super::scenes::{Edit, Played};
use super::{Bench, COUPLINGS, Tried, commanded, coupled, raw};
use recording::TickRecord;

/// Q1 up the slope of 10°, guided by a stiff hand on the ideal arm.
pub(super) struct SlideResult {
    pub(super) coupling: &'static str,
    pub(super) what: &'static str,
    pub(super) figures: Tried<SlideFigures>,
}

pub(super) struct SlideFigures {
    pub(super) force_n: f64,
    pub(super) ripple_percent: Option<f64>,
    pub(super) delay_s: Option<f64>,
}

/// Phases of the guided slide, s: down, rest, slide, rest, press.
const DOWN_S: f64 = 0.3;
const REST_S: f64 = 0.2;
const PRESS_HZ: f64 = 5.0;

impl Bench<'_> {
    pub(super) fn slides(&mut self) -> Result<Vec<SlideResult>, BenchError> {
        let slide_s = if self.options.quick { 0.5 } else { 1.0 };
        let press_s = if self.options.quick { 0.4 } else { 1.0 };
        let (scene, normal) = self.slope(slide_s, press_s)?;
        let variants: [(&str, Vec<Edit>); 3] = [
            ("trilinear", Vec::new()),
            ("trilinear, low-pass off", vec![("filter.cutoff_hz", "off".into())]),
            ("raw, as in 2008", raw()),
        ];
        let mut slides = Vec::new();
        let mut series = self
            .csv
            .file("q1-couplings.csv", "coupling,what,t_s,depth_of_hand_m,fx_n,fy_n,fz_n")?;
        for coupling in COUPLINGS {
            for (what, edits) in &variants {
                self.tell(&format!("Q1 through the coupling {coupling}: {what}"));
                let edits: Vec<Edit> = edits.iter().cloned().chain([coupled(coupling)]).collect();
                let figures = self.played(&scene, &edits)?.map(|played| {
                    // The sphere starts with its lowest point on the plane.
                    let depth =
                        |record: &TickRecord| -record.input.sample.pose.translation.dot(normal);
                    let force = |record: &TickRecord| record.output.commanded_device.force;
                    (slide_figures(&played, slide_s, press_s, depth, force, normal), played)
                });
                let figures = match figures {
                    Ok((figures, played)) => {
                        for record in played.before_stop() {
                            let t_s = record.tick as f64 / RATE_HZ;
                            let depth_m = -record.input.sample.pose.translation.dot(normal);
                            let [x, y, z] = commanded(record).to_array();
                            series.line(format_args!(
                                "{coupling},\"{what}\",{t_s},{depth_m},{x},{y},{z}"
                            ))?;
                        }
                        figures
                    }
                    Err(why) => Err(why),
                };
                let lacking = figures.is_err();
                slides.push(SlideResult { coupling, what, figures });
                if lacking {
                    break;
                }
            }
        }
        series.finish()?;
        Ok(slides)
    }

    /// Writes the scene of Q1 up the slope; also gives the normal of the slope.
    fn slope(&self, slide_s: f64, press_s: f64) -> Result<(PathBuf, DVec3), BenchError> {
        let write = |name: &str, text: String| {
            let path = self.folder.join(name);
            std::fs::write(&path, text)
                .map_err(|source| BenchError::Write { path: path.clone(), source })
                .map(|()| path)
        };
        let (mesh, tilt) = slab(true);
        let stl = self.folder.join("slope.stl");
        write_stl(&stl, &mesh).map_err(|source| BenchError::Write { path: stl, source })?;
        let normal = tilt * DVec3::Z;
        let radius_m = 20.0 * VOXEL_M;
        // Starts on the plane, goes 2 voxels down, slides, presses by half a voxel more and less.
        let start = normal * radius_m - tilt * DVec3::X * (0.5 * SPEED_M_PER_S * slide_s);
        let end_s = DOWN_S + REST_S + slide_s + REST_S + press_s;
        let mut hand = String::from("t_s,x_m,y_m,z_m,qx,qy,qz,qw\n");
        for tick in 0..=(end_s * RATE_HZ).round() as usize {
            let t_s = tick as f64 / RATE_HZ;
            let share = (t_s / DOWN_S).min(1.0);
            let slid_s = (t_s - DOWN_S - REST_S).clamp(0.0, slide_s);
            let pressed_s = (t_s - DOWN_S - REST_S - slide_s - REST_S).max(0.0);
            let depth_m = 2.0 * VOXEL_M * share * share * (3.0 - 2.0 * share)
                + 0.5 * VOXEL_M * (TAU * PRESS_HZ * pressed_s).sin();
            let [x, y, z] =
                (start - normal * depth_m + tilt * DVec3::X * (SPEED_M_PER_S * slid_s)).to_array();
            let _ = writeln!(hand, "{t_s:.3},{x:.9},{y:.9},{z:.9},0,0,0,1");
        }
        write("slope-hand.csv", hand)?;
        let [x, y, z] = (start * 1e3).to_array();
        let text = format!(
            "version = 1\n[[static]]\nmesh = \"slope.stl\"\nunits = \"mm\"\nvoxel_size_mm = \
                1.0\n[tool]\nshape = {{ sphere_mm = 20.0 }}\nvoxel_size_mm = \
                1.0\nstart_position_mm = [{x:.6}, {y:.6}, {z:.6}]\n[contact]\nstiffness_n_per_mm3 = \
                0.02\n[device]\nprofile = \"sim-ideal\"\nhand = \
                \"slope-hand.csv\"\n[device.sim]\nhand_stiffness_n_per_m = \
                5000.0\nhand_damping_n_s_per_m = 50.0\n"
        );
        Ok((write("slope.toml", text)?, normal))
    }
}

fn slide_figures(
    played: &Played,
    slide_s: f64,
    press_s: f64,
    depth: impl Fn(&TickRecord) -> f64,
    force: impl Fn(&TickRecord) -> DVec3,
    normal: DVec3,
) -> Tried<SlideFigures> {
    if !played.faults.is_empty() {
        return Err(format!("fault: {:?}", played.faults));
    }
    let at = |from_s: f64, long_s: f64| {
        let from = (from_s * RATE_HZ).round() as usize;
        played
            .records
            .get(from..from + (long_s * RATE_HZ).round() as usize)
            .ok_or("the run is too short")
    };
    // The first and last moments of the slide are a start and a stop.
    let slid = at(DOWN_S + REST_S + 0.1, slide_s - 0.2)?;
    let forces: Vec<DVec3> = slid.iter().map(&force).collect();
    let force_n = forces.iter().sum::<DVec3>().length() / forces.len() as f64;
    // Whole swings, from the second on.
    let pressed =
        at(DOWN_S + REST_S + slide_s + REST_S + 1.0 / PRESS_HZ, press_s - 1.0 / PRESS_HZ)?;
    let depths: Vec<f64> = pressed.iter().map(depth).collect();
    let answers: Vec<f64> = pressed.iter().map(|record| force(record).dot(normal)).collect();
    Ok(SlideFigures {
        force_n,
        ripple_percent: ripple_rms(&forces, RATE_HZ).map(|rms_n| 100.0 * rms_n / force_n),
        delay_s: lag_s(&depths, &answers, PRESS_HZ, RATE_HZ),
    })
}

impl SlideResult {
    pub(super) fn rows(&self) -> Vec<Row> {
        const GROUP: &str = "Q1 up a slope of 10° through the couplings, ideal arm";
        let Self { coupling, what, figures } = self;
        match figures {
            Err(why) => {
                vec![Row::new(GROUP, format!("{coupling}, {what}: skipped: {why}"), None, "")]
            }
            Ok(figures) => vec![
                Row::new(GROUP, format!("{coupling}, {what}: mean force"), figures.force_n, "N"),
                Row::new(
                    GROUP,
                    format!("{coupling}, {what}: ripple above 10 Hz, RMS"),
                    figures.ripple_percent,
                    "%",
                ),
                Row::new(
                    GROUP,
                    format!("{coupling}, {what}: delay from depth to force, at 5 Hz"),
                    figures.delay_s.map(|delay_s| delay_s * 1e3),
                    "ms",
                ),
            ],
        }
    }
}
