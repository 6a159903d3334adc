//! Forces on the hand: Q1 through the couplings, a peg that is inserted, slides over the shipped scenes; and what to choose.

use core::f64::consts::TAU;
use core::fmt::Write as _;
use std::path::Path;

use glam::DVec3;
use toml::Value;

use super::super::export::write_stl;
use super::super::report::figure;
use super::super::{BenchError, Row};
use super::fields::{Depths, Measured};
use super::ripple::{SHORTEST_S, lag_s, ripple_rms};
use super::scenarios::{RATE_HZ, SPEED_M_PER_S, VOXEL_M, slab};
use super::scenes::{self, Edit, Played};
use super::{Csv, Options, Walk, query};
use crate::haptics::stability::filter_delay_s;
use crate::haptics::{ContactParameters, FilterParameters, Normalization};
use crate::scene::cache::{Cache, Residence};
use crate::spatial::Pose;
use crate::telemetry::TickRecord;
use crate::voxmap::field::FieldKind;

/// The words of a scene file; one that this version lacks is a row that says so.
const COUPLINGS: [&str; 4] = ["implicit", "semi-implicit", "static", "direct"];

/// The force of 2008: the plane through the voxel, no entry weight, no filter.
fn raw() -> Vec<Edit> {
    vec![("rendering.field", "layers".into()), ("filter.spatial", false.into()), ("filter.cutoff_hz", "off".into())]
}

fn coupled(coupling: &str) -> Edit {
    ("rendering.coupling", coupling.into())
}

pub(super) fn rows(
    options: &Options,
    measured: &[Measured],
    folder: &Path,
    csv: &mut Csv,
    tell: &mut dyn FnMut(&str),
) -> Result<(Vec<Row>, String), BenchError> {
    let mut cache = Cache::at(folder.join("cache"), Residence::Owned);
    let mut bench = Bench { options, folder, csv, cache: &mut cache, tell };
    let slides = bench.slides()?;
    let insertions = bench.insertions()?;
    let smoothness = bench.smoothness()?;
    let mut rows: Vec<Row> = slides.iter().flat_map(Slid::rows).collect();
    rows.extend(insertions.iter().flat_map(Inserted::rows));
    rows.extend(smoothness.iter().flat_map(Smooth::rows));
    Ok((rows, choice(measured, &slides, &insertions)))
}

struct Bench<'a> {
    options: &'a Options,
    folder: &'a Path,
    csv: &'a mut Csv,
    cache: &'a mut Cache,
    tell: &'a mut dyn FnMut(&str),
}

/// What a variant of a scene gave, or why it did not run.
type Tried<T> = Result<T, String>;

/// Q1 up the slope of 10°, guided by a stiff hand on the ideal arm.
struct Slid {
    coupling: &'static str,
    what: &'static str,
    figures: Tried<SlideFigures>,
}

struct SlideFigures {
    force_n: f64,
    ripple_percent: Option<f64>,
    delay_s: Option<f64>,
}

/// Phases of the guided slide, s: down, rest, slide, rest, press.
const DOWN_S: f64 = 0.3;
const REST_S: f64 = 0.2;
const PRESS_HZ: f64 = 5.0;

impl Bench<'_> {
    fn tell(&mut self, what: &str) {
        (self.tell)(what);
    }

    fn played(&mut self, scene: &Path, edits: &[Edit]) -> Result<Tried<Played>, BenchError> {
        match scenes::load(scene, edits, self.folder) {
            Ok(config) => {
                let longest_s = if self.options.quick { 3.0 } else { f64::INFINITY };
                scenes::play(&config, self.cache, longest_s).map(Ok)
            }
            Err(why) => Ok(Err(why)),
        }
    }

    fn slides(&mut self) -> Result<Vec<Slid>, BenchError> {
        let slide_s = if self.options.quick { 0.5 } else { 1.0 };
        let press_s = if self.options.quick { 0.4 } else { 1.0 };
        let (scene, normal) = self.slope(slide_s, press_s)?;
        let variants: [(&str, Vec<Edit>); 3] = [
            ("trilinear", Vec::new()),
            ("trilinear, low-pass off", vec![("filter.cutoff_hz", "off".into())]),
            ("raw, as in 2008", raw()),
        ];
        let mut slides = Vec::new();
        let mut series = self.csv.file("q1-couplings.csv", "coupling,what,t_s,depth_of_hand_m,fx_n,fy_n,fz_n")?;
        for coupling in COUPLINGS {
            for (what, edits) in &variants {
                self.tell(&format!("Q1 through the coupling {coupling}: {what}"));
                let edits: Vec<Edit> = edits.iter().cloned().chain([coupled(coupling)]).collect();
                let figures = self.played(&scene, &edits)?.map(|played| {
                    // The sphere starts with its lowest point on the plane.
                    let depth = |record: &TickRecord| -record.input.sample.pose.translation.dot(normal);
                    let force = |record: &TickRecord| record.output.commanded_device.force;
                    (slide_figures(&played, slide_s, press_s, depth, force, normal), played)
                });
                let figures = match figures {
                    Ok((figures, played)) => {
                        for record in played.before_stop() {
                            let t_s = record.tick as f64 / RATE_HZ;
                            let depth_m = -record.input.sample.pose.translation.dot(normal);
                            let [x, y, z] = commanded(record).to_array();
                            series.line(format_args!("{coupling},\"{what}\",{t_s},{depth_m},{x},{y},{z}"))?;
                        }
                        figures
                    }
                    Err(why) => Err(why),
                };
                let lacking = figures.is_err();
                slides.push(Slid { coupling, what, figures });
                if lacking {
                    break;
                }
            }
        }
        series.finish()?;
        Ok(slides)
    }

    /// Writes the scene of Q1 up the slope; also gives the normal of the slope.
    fn slope(&self, slide_s: f64, press_s: f64) -> Result<(std::path::PathBuf, DVec3), BenchError> {
        let write = |name: &str, text: String| {
            let path = self.folder.join(name);
            std::fs::write(&path, text).map_err(|source| BenchError::Write { path: path.clone(), source }).map(|()| path)
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
            let depth_m = 2.0 * VOXEL_M * share * share * (3.0 - 2.0 * share) + 0.5 * VOXEL_M * (TAU * PRESS_HZ * pressed_s).sin();
            let [x, y, z] = (start - normal * depth_m + tilt * DVec3::X * (SPEED_M_PER_S * slid_s)).to_array();
            let _ = writeln!(hand, "{t_s:.3},{x:.9},{y:.9},{z:.9},0,0,0,1");
        }
        write("slope-hand.csv", hand)?;
        let [x, y, z] = (start * 1e3).to_array();
        let text = format!(
            "version = 1\n[[static]]\nmesh = \"slope.stl\"\nunits = \"mm\"\nvoxel_size_mm = 1.0\n\
             [tool]\nshape = {{ sphere_mm = 20.0 }}\nvoxel_size_mm = 1.0\nstart_position_mm = [{x:.6}, {y:.6}, {z:.6}]\n\
             [contact]\nstiffness_n_per_mm = 0.02\n\
             [device]\nprofile = \"sim-ideal\"\nhand = \"slope-hand.csv\"\n\
             [device.sim]\nhand_stiffness_n_per_m = 5000.0\nhand_damping_n_s_per_m = 50.0\n"
        );
        Ok((write("slope.toml", text)?, normal))
    }

    fn insertions(&mut self) -> Result<Vec<Inserted>, BenchError> {
        let Some(scene) = scenes::shipped(&self.options.scenes).into_iter().find(|path| scenes::name(path) == "peg-in-hole") else {
            return Ok(vec![Inserted { coupling: "-", spatial: true, figures: Err(self.no_scenes()) }]);
        };
        if self.options.quick {
            return Ok(vec![Inserted { coupling: "-", spatial: true, figures: Err("--quick".to_owned()) }]);
        }
        let mut insertions = Vec::new();
        for coupling in COUPLINGS {
            for spatial in [true, false] {
                self.tell(&format!("peg in hole, {coupling}, spatial {spatial}"));
                let edits = self.as_stiff_as_allowed(&scene, vec![coupled(coupling), ("filter.spatial", Value::Boolean(spatial))]);
                let played = self.played(&scene, &edits)?;
                let lacking = played.is_err();
                insertions.push(Inserted { coupling, spatial, figures: played.map(|played| InsertionFigures::of(&played)) });
                if lacking {
                    break;
                }
            }
        }
        Ok(insertions)
    }

    /// In `direct` the arm feels each point: a scene for another coupling gets the stiffest point that the arm takes.
    fn as_stiff_as_allowed(&self, scene: &Path, mut edits: Vec<Edit>) -> Vec<Edit> {
        const KEY: &str = "contact.stiffness_n_per_mm";
        if scenes::load(scene, &edits, self.folder).is_err() {
            let soft: Vec<Edit> = edits.iter().cloned().chain([(KEY, Value::Float(1e-3))]).collect();
            if let Ok(config) = scenes::load(scene, &soft, self.folder) {
                // Rounded down: the text holds fewer digits than the bound.
                edits.push((KEY, Value::Float(config.parameters.coupling.bound_n_per_m.floor() * 1e-3)));
            }
        }
        edits
    }

    fn no_scenes(&self) -> String {
        format!("no such scene in {} (--scenes)", self.options.scenes.display())
    }

    fn smoothness(&mut self) -> Result<Vec<Smooth>, BenchError> {
        let mut found = Vec::new();
        let scenes = scenes::shipped(&self.options.scenes);
        if scenes.is_empty() {
            found.push(Smooth { scene: "shipped scenes".to_owned(), figures: Err(self.no_scenes()) });
        }
        for scene in scenes.into_iter().take(if self.options.quick { 1 } else { usize::MAX }) {
            let name = scenes::name(&scene);
            self.tell(&format!("{name}: as shipped and raw"));
            let default = self.played(&scene, &[])?;
            let through_coupling = self.played(&scene, &raw())?.map(|played| Rough::played(&played));
            let direct = self.as_stiff_as_allowed(&scene, raw().into_iter().chain([coupled("direct")]).collect());
            let direct = Some(self.played(&scene, &direct)?.map(|played| Rough::played(&played)));
            let figures = default.map(|default| SmoothFigures::of(&default, through_coupling, direct));
            found.push(Smooth { scene: name.clone(), figures });
            // The steps of an encoder, times the stiffness of the coupling, are roughness too, whatever the field.
            self.tell(&format!("{name}: on the ideal arm, and raw"));
            let ideal = || [("device.profile", Value::from("sim-ideal"))];
            let default = self.played(&scene, &ideal())?;
            let through_coupling = self.played(&scene, &raw().into_iter().chain(ideal()).collect::<Vec<_>>())?;
            let through_coupling = through_coupling.map(|played| Rough::played(&played));
            let figures = default.map(|default| SmoothFigures::of(&default, through_coupling, None));
            found.push(Smooth { scene: format!("{name}, ideal arm"), figures });
        }
        Ok(found)
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
        played.records.get(from..from + (long_s * RATE_HZ).round() as usize).ok_or("the run is too short")
    };
    // The first and last moments of the slide are a start and a stop.
    let slid = at(DOWN_S + REST_S + 0.1, slide_s - 0.2)?;
    let forces: Vec<DVec3> = slid.iter().map(&force).collect();
    let force_n = forces.iter().sum::<DVec3>().length() / forces.len() as f64;
    // Whole swings, from the second on.
    let pressed = at(DOWN_S + REST_S + slide_s + REST_S + 1.0 / PRESS_HZ, press_s - 1.0 / PRESS_HZ)?;
    let depths: Vec<f64> = pressed.iter().map(depth).collect();
    let answers: Vec<f64> = pressed.iter().map(|record| force(record).dot(normal)).collect();
    Ok(SlideFigures {
        force_n,
        ripple_percent: ripple_rms(&forces, RATE_HZ).map(|rms_n| 100.0 * rms_n / force_n),
        delay_s: lag_s(&depths, &answers, PRESS_HZ, RATE_HZ),
    })
}

impl Slid {
    fn rows(&self) -> Vec<Row> {
        const GROUP: &str = "Q1 up a slope of 10° through the couplings, ideal arm";
        let Self { coupling, what, figures } = self;
        match figures {
            Err(why) => vec![Row::new(GROUP, format!("{coupling}, {what}: skipped: {why}"), None, "")],
            Ok(figures) => vec![
                Row::new(GROUP, format!("{coupling}, {what}: mean force"), figures.force_n, "N"),
                Row::new(GROUP, format!("{coupling}, {what}: ripple above 10 Hz, RMS"), figures.ripple_percent, "%"),
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

/// The shipped peg with one coupling.
struct Inserted {
    coupling: &'static str,
    spatial: bool,
    figures: Tried<InsertionFigures>,
}

struct InsertionFigures {
    depth_mm: f64,
    /// When the tip was half a millimetre above the floor first.
    inserted_s: Option<f64>,
    peak_n: f64,
    ripple_n: Option<f64>,
    /// How often contact came or went in the last 0.9 s, with the hand at rest.
    changes_at_rest: usize,
    faults: String,
}

impl InsertionFigures {
    const NEARLY_DOWN_M: f64 = -0.0195;

    fn of(played: &Played) -> Self {
        let records = played.before_stop();
        let height = |record: &TickRecord| record.output.world_from_tool.translation.z;
        let rest = &records[records.len().saturating_sub(900)..];
        Self {
            depth_mm: records.last().map_or(0.0, |record| -height(record) * 1e3),
            inserted_s: records.iter().position(|record| height(record) < Self::NEARLY_DOWN_M).map(|tick| tick as f64 / RATE_HZ),
            peak_n: records.iter().map(|record| commanded(record).length()).fold(0.0, f64::max),
            ripple_n: ripple_over(&windows(records), &records.iter().map(commanded).collect::<Vec<_>>()),
            changes_at_rest: changes(rest),
            faults: if played.faults.is_empty() { String::new() } else { format!("{:?}", played.faults) },
        }
    }
}

impl Inserted {
    fn rows(&self) -> Vec<Row> {
        const GROUP: &str = "peg in hole, simulated sigma.7-class arm";
        let name = format!("{}, spatial {}", self.coupling, if self.spatial { "on" } else { "off" });
        match &self.figures {
            Err(why) => vec![Row::new(GROUP, format!("{name}: skipped: {why}"), None, "")],
            Ok(figures) => {
                let InsertionFigures { depth_mm, inserted_s, peak_n, ripple_n, changes_at_rest, faults } = figures;
                let mut rows = vec![
                    Row::new(GROUP, format!("{name}: depth reached of 20 mm"), *depth_mm, "mm"),
                    Row::new(GROUP, format!("{name}: time to 19.5 mm"), *inserted_s, "s"),
                    Row::new(GROUP, format!("{name}: largest force on the hand"), *peak_n, "N"),
                    Row::new(GROUP, format!("{name}: ripple above 10 Hz in contact, RMS"), *ripple_n, "N"),
                    Row::new(GROUP, format!("{name}: contact came or went, last 0.9 s"), *changes_at_rest as f64, ""),
                ];
                if !faults.is_empty() {
                    rows.push(Row::new(GROUP, format!("{name}: ended by {faults}"), None, ""));
                }
                rows
            }
        }
    }
}

/// A shipped scene as it is beside the force of 2008.
struct Smooth {
    scene: String,
    figures: Tried<SmoothFigures>,
}

struct SmoothFigures {
    /// On the hand, as shipped, N and % of the mean.
    felt: Rough,
    /// Raw force at the same poses of the tool.
    same_poses: Rough,
    /// On the hand, raw field through the shipped coupling.
    through_coupling: Tried<Rough>,
    /// On the hand, raw field, no virtual tool, the stiffest point that the arm takes: the loop of 2008. None on an arm that
    /// takes every stiffness.
    direct: Option<Tried<Rough>>,
    /// The most that the shipped filter delays a slow force, s.
    stated_delay_s: f64,
    /// How often contact came or went in the whole run.
    changes: usize,
}

/// Roughness of a force in contact.
#[derive(Clone, Copy)]
struct Rough {
    ripple_n: Option<f64>,
    mean_n: f64,
    faulted: bool,
}

impl Rough {
    fn of(windows: &[(usize, usize)], forces: &[DVec3], faulted: bool) -> Self {
        let inside: Vec<f64> = windows.iter().flat_map(|(from, to)| &forces[*from..*to]).map(|force| force.length()).collect();
        Self { ripple_n: ripple_over(windows, forces), mean_n: inside.iter().sum::<f64>() / inside.len().max(1) as f64, faulted }
    }

    fn played(played: &Played) -> Self {
        let records = played.before_stop();
        Self::of(&windows(records), &records.iter().map(commanded).collect::<Vec<_>>(), !played.faults.is_empty())
    }

    fn percent(self) -> Option<f64> {
        self.ripple_n.filter(|_| self.mean_n > 0.0).map(|ripple_n| 100.0 * ripple_n / self.mean_n)
    }
}

impl SmoothFigures {
    fn of(default: &Played, through_coupling: Tried<Rough>, direct: Option<Tried<Rough>>) -> Self {
        let records = default.before_stop();
        let parameters = &default.scene.parameters;
        let contact = ContactParameters { field: FieldKind::Layers, normalization: Normalization::None, ..parameters.contact };
        let filter = FilterParameters { spatial: false, cutoff_hz: [f64::INFINITY; 2] };
        let tool = &default.scene.tool;
        let at_poses: Vec<DVec3> = records
            .iter()
            .map(|record| {
                let body = record.output.world_from_tool * Pose::from_translation(tool.center_of_mass_tool);
                query(Walk::Flat, &default.scene.obstacles, &tool.shell, body, &contact, &filter).wrench.force
            })
            .collect();
        Self {
            felt: Rough::played(default),
            same_poses: Rough::of(&windows(records), &at_poses, false),
            through_coupling,
            direct,
            changes: changes(records),
            stated_delay_s: filter_delay_s(parameters.filter.cutoff_hz[0], parameters.period_s),
        }
    }
}

impl Smooth {
    fn rows(&self) -> Vec<Row> {
        const GROUP: &str = "smoothness: ripple above 10 Hz in contact, as shipped beside the raw force of 2008";
        let figures = match &self.figures {
            Err(why) => return vec![Row::new(GROUP, format!("{}: skipped: {why}", self.scene), None, "")],
            Ok(figures) => figures,
        };
        let scene = &self.scene;
        let felt = figures.felt;
        let mut rows = vec![Row::new(GROUP, format!("{scene}: largest delay of the filter"), figures.stated_delay_s * 1e3, "ms")];
        rows.push(Row::new(GROUP, format!("{scene}: contact came or went, whole run"), figures.changes as f64, ""));
        let same_poses = Ok(figures.same_poses);
        let beside = [
            Some(("raw at the same poses", &same_poses)),
            Some(("raw through the same coupling", &figures.through_coupling)),
            figures.direct.as_ref().map(|direct| ("raw without a virtual tool", direct)),
        ];
        for (name, raw) in beside.into_iter().flatten() {
            let faulted = raw.as_ref().is_ok_and(|raw| raw.faulted);
            let name = if faulted { format!("{name}, which ends in a fault") } else { name.to_owned() };
            let peer =
                |of: fn(Rough) -> Option<f64>| raw.clone().and_then(|raw| of(raw).ok_or_else(|| "too short a contact".to_owned()));
            let row = |what: &str, value, unit, raw: &Result<f64, String>| {
                Row::new(GROUP, format!("{scene}: {what}"), value, unit).beside_peer(&name, raw).at_least_times(10.0)
            };
            rows.push(row("ripple on the hand", felt.ripple_n, "N", &peer(|raw| raw.ripple_n)));
            rows.push(row("ripple on the hand, share of the mean force", felt.percent(), "%", &peer(Rough::percent)));
        }
        rows
    }
}

/// How often contact came or went.
fn changes(records: &[TickRecord]) -> usize {
    let touches = |record: &TickRecord| record.output.contacts > 0;
    records.windows(2).filter(|pair| touches(&pair[0]) != touches(&pair[1])).count()
}

fn commanded(record: &TickRecord) -> DVec3 {
    record.output.commanded_device.force
}

/// Contacts that last long enough to be called rough or smooth, without the moments in which they come and go.
fn windows(records: &[TickRecord]) -> Vec<(usize, usize)> {
    const EDGE_TICKS: usize = 50;
    let mut windows = Vec::new();
    let mut from = None;
    for tick in 0..=records.len() {
        let touches = records.get(tick).is_some_and(|record| record.output.contacts > 0);
        match (from, touches) {
            (None, true) => from = Some(tick),
            (Some(begin), false) => {
                let (inside, end) = (begin + EDGE_TICKS, tick.saturating_sub(EDGE_TICKS));
                if end > inside && (end - inside) as f64 >= SHORTEST_S * RATE_HZ {
                    windows.push((inside, end));
                }
                from = None;
            }
            _ => {}
        }
    }
    windows
}

/// RMS over all windows together, N; `None` without any.
fn ripple_over(windows: &[(usize, usize)], forces: &[DVec3]) -> Option<f64> {
    let (mut squares, mut n) = (0.0, 0);
    for (from, to) in windows {
        if let Some(rms_n) = ripple_rms(&forces[*from..*to], RATE_HZ) {
            squares += rms_n * rms_n * (to - from) as f64;
            n += to - from;
        }
    }
    (n > 0).then(|| (squares / n as f64).sqrt())
}

/// Two short tables: fields, then couplings.
fn choice(measured: &[Measured], slides: &[Slid], insertions: &[Inserted]) -> String {
    let number = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), figure);
    let worst = |family: &str, depths: Depths, of: &dyn Fn(&Measured) -> Option<f64>| {
        let here = measured.iter().filter(|m| m.depths == depths && m.family.starts_with(family));
        number(here.filter_map(of).reduce(f64::max))
    };
    let mut text = String::from("\n## what to choose\n\nWorst paths of Q1 to Q3.\n\n");
    text.push_str("| field | Q1 angle, mean ° | Q1 ripple % | Q2 angle, mean ° | Q2 ripple % | Q3 force, mean % | Q3 ripple % | query, mean µs |\n");
    text.push_str("|---|---:|---:|---:|---:|---:|---:|---:|\n");
    for depths in Depths::ALL {
        let angle = |m: &Measured| m.angle_deg.map(|spread| spread.mean);
        let ripple = |m: &Measured| m.ripple_percent;
        let _ = writeln!(
            text,
            "| {} | {} | {} | {} | {} | {} | {} | {} |",
            depths.name(),
            worst("Q1", depths, &angle),
            worst("Q1", depths, &ripple),
            worst("Q2", depths, &angle),
            worst("Q2", depths, &ripple),
            worst("Q3", depths, &|m| Some(m.magnitude_percent.mean)),
            worst("Q3", depths, &ripple),
            worst("", depths, &|m| m.query_us.map(|spread| spread.mean)),
        );
    }
    text.push_str("\nQ1 up a slope of 10° on the ideal arm; the peg on the simulated sigma.7-class arm (spatial on).\n\n");
    text.push_str("| coupling | ripple, trilinear % | raw % | delay, trilinear ms | low-pass off ms | peg: depth mm | time s | peak N | ripple N | contact changes |\n");
    text.push_str("|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|\n");
    for coupling in COUPLINGS {
        let slid = |what: &str| {
            let here = slides.iter().find(|slid| slid.coupling == coupling && slid.what.starts_with(what));
            here.and_then(|slid| slid.figures.as_ref().ok())
        };
        let delay = |figures: &SlideFigures| figures.delay_s.map(|delay_s| delay_s * 1e3);
        let peg = insertions.iter().find(|peg| peg.coupling == coupling && peg.spatial).and_then(|peg| peg.figures.as_ref().ok());
        let _ = writeln!(
            text,
            "| {coupling} | {} | {} | {} | {} | {} | {} | {} | {} | {} |",
            number(slid("trilinear").and_then(|figures| figures.ripple_percent)),
            number(slid("raw").and_then(|figures| figures.ripple_percent)),
            number(slid("trilinear").and_then(delay)),
            number(slid("trilinear, low-pass off").and_then(delay)),
            number(peg.map(|peg| peg.depth_mm)),
            number(peg.and_then(|peg| peg.inserted_s)),
            number(peg.map(|peg| peg.peak_n)),
            number(peg.and_then(|peg| peg.ripple_n)),
            number(peg.map(|peg| peg.changes_at_rest as f64)),
        );
    }
    text
}
