//! The clay of a scene: from its source to a clay model that can be worked, and to what the tick
//! touches.

use std::collections::VecDeque;
use std::ops::RangeInclusive;
use std::sync::Arc;
use std::time::Instant;

use glam::DVec3;
use serde::Serialize;
use thiserror::Error;

use super::object::MemoryPlan;
use crate::config::scene::{ClaySource, MeshSource, SculptConfig};
use crate::config::setting_names::KEYS;
use crate::config::{RASTER_AXIS, RASTER_NODES, SceneConfig};
use clay::clay_model::{ClayModelError, MemoryEstimate};
use clay::session::SessionFileError;
use clay::{ClayModel, LoadError, Neighbours, NormalSource, PointSet, PointSurface, Solid};
use haptics::clay::Clay;
use vps::density::{FrameError, Lattice};
use vps::spatial::Metres;

/// Few things that are felt with an arm are shorter, or longer.
const HANDY_M: RangeInclusive<f64> = 2e-3..=2.0;
/// Mass points farther apart than this many spacings of the samples miss what the samples show.
const COARSE: f64 = 6.0;
/// Samples of a border nearer to each other than this, in spacings, are of one border: of a small
/// hole some are not seen as such.
const BORDER_STEP: f64 = 6.0;

/// Why clay cannot be built.
#[derive(Debug, Error)]
pub enum ClayError {
    /// The source of the clay, or of the tool as a solid.
    #[error(transparent)]
    Load(#[from] LoadError),
    /// The clay itself.
    #[error(transparent)]
    Model(#[from] ClayModelError),
    /// A session that was saved.
    #[error(transparent)]
    Session(#[from] SessionFileError),
    /// What the tick would touch of it.
    #[error(transparent)]
    Frame(#[from] FrameError),
}

impl ClayError {
    /// What to do about it.
    pub fn hint(&self) -> Option<String> {
        match self {
            Self::Load(problem) => problem.hint(&KEYS),
            Self::Model(ClayModelError::Surface(problem)) => Some(problem.hint(&KEYS)),
            Self::Session(_) => Some(
                "give a file of `hapticd sculpt --session`, or another source \
                of clay"
                    .to_owned(),
            ),
            Self::Model(ClayModelError::Beside(..)) => Some(
                "give `sculpt.region_mm` in the frame of the clay's file, and check \
                    `sculpt.units`"
                    .to_owned(),
            ),
            Self::Model(ClayModelError::Memory { limit, .. }) => Some(format!(
                "take fewer mass points in `sculpt.raster`, a larger \
                    `sculpt.spacing_mm`, or {}",
                limit.remedy(&KEYS)
            )),
            Self::Model(ClayModelError::TooFine { .. }) => Some(
                "take fewer mass points in `sculpt.raster`, or a larger `sculpt.region_mm`"
                    .to_owned(),
            ),
            Self::Model(ClayModelError::ThinWalls {
                needed,
                apart_m,
                mass_points_m,
                samples_m,
                ..
            }) => {
                let raster = (mass_points_m > apart_m).then(|| raster_hint(*needed));
                let spacing = (samples_m > apart_m)
                    .then(|| format!("give a `sculpt.spacing_mm` of at most {}", Metres(*apart_m)));
                Some(raster.into_iter().chain(spacing).collect::<Vec<_>>().join("; "))
            }
            Self::Model(_) | Self::Frame(_) => None,
        }
    }
}

/// What to do about mass points too far apart for walls: a raster, where there can be such a fine
/// one.
fn raster_hint(needed: [usize; 3]) -> String {
    let most = RASTER_AXIS.end();
    let numbers = needed.map(|n| n as f64);
    if numbers.iter().all(|n| n <= most) && numbers.iter().product::<f64>() <= RASTER_NODES {
        format!("give `sculpt.raster = {needed:?}`, or a smaller part in `sculpt.region_mm`")
    } else {
        format!(
            "they would take {needed:?} mass points, and at most {most} along an axis and \
                {RASTER_NODES} in all are possible: choose a smaller part in `sculpt.region_mm`"
        )
    }
}

/// A clay model, ready to be worked.
#[derive(Debug)]
pub struct LoadedClay {
    /// The clay.
    pub clay: ClayModel,
    /// The tool as a solid, tool frame: what Booleans of the tool join and cut.
    pub tool_shape: Arc<PointSet>,
    /// What it was made of.
    pub report: ClayReport,
}

/// Where samples end: a hole, or the rim of a sheet.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct BorderReport {
    /// Its middle, frame of the clay, m.
    pub position_m: [f64; 3],
    /// Its length, by the spacing of its samples, m.
    pub length_m: f64,
}

/// What a clay model was made of.
#[derive(Clone, Debug, Serialize)]
pub struct ClayReport {
    /// Samples.
    pub samples: usize,
    /// Mean distance of neighbouring samples, m.
    pub spacing_m: f64,
    /// Where normals came from: `file`, `file, turned`, `estimated`, `faces` or `session`.
    pub normals: &'static str,
    /// Points at the place of another one, left out.
    pub merged: usize,
    /// The samples go around a body.
    pub closed: bool,
    /// Borders, the longest first.
    pub borders: Vec<BorderReport>,
    /// Mass points along x, y, z of the region that deforms.
    pub raster: [usize; 3],
    /// Between mass points, m.
    pub raster_spacing_m: f64,
    /// Nodes of the raster over the whole model.
    pub nodes: usize,
    /// What is inside, m³; `None` where the surface is not closed in its raster.
    pub volume_m3: Option<f64>,
    /// Reading and fitting, s.
    pub seconds: f64,
    /// What a user should know.
    pub warnings: Vec<String>,
}

impl LoadedClay {
    /// Reads or samples the clay and fits its surface. Cost: a fit per sample and the nodes of its
    /// raster.
    ///
    /// # Errors
    /// A source that cannot be read, samples that make no surface, or too much memory.
    pub(super) fn build(
        config: &SceneConfig,
        sculpt: &SculptConfig,
        memory: &MemoryPlan<'_>,
    ) -> Result<Self, ClayError> {
        let since = Instant::now();
        let (clay, normals, merged, of_file) = match &sculpt.source {
            ClaySource::Solid(solid) => {
                let opened = solid.open()?;
                if memory.is_limited() {
                    let (n_samples, bounds) = opened.size();
                    memory.judge_clay(MemoryEstimate::of(n_samples, bounds, &sculpt.settings)?)?;
                }
                opened.check_walls(&sculpt.settings)?;
                let loaded = opened.load()?;
                let clay = ClayModel::new(loaded.points, sculpt.settings.clone())?;
                (clay, name(loaded.normals), loaded.merged, loaded.warnings)
            }
            ClaySource::Session(path) => {
                let clay = ClayModel::load_session(path)?;
                let surface = clay.surface();
                let settings = clay.settings();
                memory.judge_clay(MemoryEstimate::of(
                    surface.points().len() as u64,
                    surface.bounds(),
                    settings,
                )?)?;
                (clay, "session", 0, Vec::new())
            }
        };
        let surface = clay.surface();
        let lattice = *clay.region().lattice();
        let mut report = ClayReport {
            samples: surface.points().len(),
            spacing_m: surface.spacing_m(),
            normals,
            merged,
            closed: surface.is_closed(),
            borders: borders(surface),
            raster: lattice.dims,
            raster_spacing_m: lattice.spacing_m,
            nodes: clay.base().lattice().n_nodes(),
            volume_m3: clay.volume_m3(),
            seconds: 0.0,
            warnings: of_file,
        };
        let has_unit = matches!(sculpt.source, ClaySource::Solid(Solid::File { .. }));
        let across_m =
            surface.points().bounds().map_or(0.0, |(low, high)| (high - low).max_element());
        if has_unit && !HANDY_M.contains(&across_m) {
            report
                .warnings
                .push(format!("the clay is {} across; is `sculpt.units` right?", Metres(across_m)));
        }
        report.warnings.extend(warnings(&report, &lattice));
        let tool_shape = tool_shape(&config.tool.source, report.spacing_m)?;
        report.seconds = since.elapsed().as_secs_f64();
        Ok(Self { clay, tool_shape, report })
    }

    /// What the tick touches before the first update.
    pub(super) fn clay(
        &self,
        config: &SceneConfig,
        sculpt: &SculptConfig,
    ) -> Result<Clay, ClayError> {
        let frame = self.clay.frame()?;
        let update_period_s = sculpt.update_ticks as f64 * config.parameters.period_s;
        let clay = Clay::new(sculpt.world_from_map, frame, update_period_s, &config.parameters);
        Ok(Clay { smoothing: sculpt.smoothing.unwrap_or(clay.smoothing), ..clay })
    }
}

/// Looks at clay as [`super::build_all`] does before its work: reads it, and judges its raster by its
/// walls. Gives what a user should know of its file.
///
/// # Errors
/// A source that cannot be read, or walls that the raster does not hold.
pub fn look_at_clay(sculpt: &SculptConfig) -> Result<Vec<String>, ClayError> {
    let ClaySource::Solid(solid) = &sculpt.source else { return Ok(Vec::new()) };
    let opened = solid.open()?;
    opened.check_walls(&sculpt.settings)?;
    Ok(opened.warnings)
}

/// The samples of the tool, as dense as those of the clay where that is enough of them.
fn tool_shape(source: &MeshSource, spacing_m: f64) -> Result<Arc<PointSet>, ClayError> {
    let solid = match source.clone() {
        MeshSource::File { path, metres_per_unit } => {
            Solid::File { path, metres_per_unit, scale: DVec3::ONE, spacing_m: None }
        }
        MeshSource::Shape(shape) => Solid::Shape { shape, scale: DVec3::ONE, spacing_m: None },
    };
    Ok(Arc::new(solid.load_beside(spacing_m)?))
}

fn name(source: NormalSource) -> &'static str {
    match source {
        NormalSource::File => "file",
        NormalSource::FileTurned => "file, turned",
        NormalSource::Estimated => "estimated",
        NormalSource::Faces => "faces",
    }
}

fn warnings(report: &ClayReport, lattice: &Lattice) -> Vec<String> {
    let mut warnings = Vec::new();
    if report.merged > 0 {
        warnings
            .push(format!("{} points at the place of another one were left out", report.merged));
    }
    if let Some(BorderReport { position_m: [x, y, z], length_m }) = report.borders.first() {
        let x = x * 1e3;
        let y = y * 1e3;
        let z = z * 1e3;
        let length = length_m * 1e3;
        let more = match report.borders.len() - 1 {
            0 => String::new(),
            1 => ", and 1 more".to_owned(),
            n => format!(", and {n} more"),
        };
        let becomes = if report.closed {
            "the surface goes on there as a cap of no certain shape, in an export too"
        } else {
            "the samples do not go around a body, so what is inside is guessed from the nearest \
                sample"
        };
        warnings.push(format!(
            "the surface is open: a border about {length:.1} mm long around ({x:.1}, {y:.1}, \
                {z:.1}) mm{more}; {becomes}"
        ));
    } else if !report.closed {
        warnings.push(
            "the samples do not go around a body: what is inside is guessed from the \
            nearest sample"
                .to_owned(),
        );
    }
    let ratio = report.raster_spacing_m / report.spacing_m;
    if ratio > COARSE {
        warnings.push(format!(
            "mass points stand {:.2} mm apart, {ratio:.0} times as far as samples ({:.3} mm): what \
                is finer than that can neither be felt nor shaped; take more in `sculpt.raster` \
                ({:?} now) or a smaller `sculpt.region_mm`",
            report.raster_spacing_m * 1e3,
            report.spacing_m * 1e3,
            lattice.dims,
        ));
    }
    if report.volume_m3.is_none() && report.closed {
        warnings.push(
            "it cannot be exported as it is: its surface leaves the raster, or nothing is inside; \
                raise `sculpt.air_mm`"
                .to_owned(),
        );
    }
    warnings
}

/// The borders of a surface, the longest first.
fn borders(surface: &PointSurface) -> Vec<BorderReport> {
    let samples = surface.border();
    let at: Vec<DVec3> =
        samples.iter().map(|sample| surface.points().positions_map[*sample as usize]).collect();
    let near = Neighbours::new(&at);
    let reach_m = BORDER_STEP * surface.spacing_m();
    let mut is_free = vec![true; at.len()];
    let mut found = Vec::new();
    let mut borders = Vec::new();
    for first in 0..at.len() {
        if !std::mem::take(&mut is_free[first]) {
            continue;
        }
        let mut members = vec![first];
        let mut queue = VecDeque::from([first]);
        while let Some(member) = queue.pop_front() {
            near.within(at[member], reach_m, &mut found);
            for other in &found {
                if std::mem::take(&mut is_free[other.sample as usize]) {
                    members.push(other.sample as usize);
                    queue.push_back(other.sample as usize);
                }
            }
        }
        // A sample or two are a crease that looks like a border.
        if members.len() >= 3 {
            let middle =
                members.iter().map(|member| at[*member]).sum::<DVec3>() / members.len() as f64;
            let spacings_m =
                members.iter().map(|member| surface.spacings_m()[samples[*member] as usize]);
            borders
                .push(BorderReport { position_m: middle.to_array(), length_m: spacings_m.sum() });
        }
    }
    borders.sort_by(|one, other| other.length_m.total_cmp(&one.length_m));
    borders
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ball(keep: impl Fn(DVec3) -> bool) -> PointSurface {
        let mut points = PointSet::default();
        let n = 6000;
        for i in 0..n {
            let z = 1.0 - (2.0 * f64::from(i) + 1.0) / f64::from(n);
            let turn = f64::from(i) * 2.399_963_229_728_653;
            let normal =
                DVec3::new((1.0 - z * z).sqrt() * turn.cos(), (1.0 - z * z).sqrt() * turn.sin(), z)
                    .normalize();
            if keep(normal) {
                points.push(normal * 0.02, normal, [0; 3]);
            }
        }
        PointSurface::build(points, PointSurface::DEFAULT_NEIGHBOURS).unwrap()
    }

    #[test]
    fn borders_are_found_with_their_place_and_length() {
        assert_eq!(borders(&ball(|_| true)), []);
        // Two holes: one around +z, 8 mm wide, and a smaller one around -x.
        let found = borders(&ball(|normal| normal.z < 0.96 && normal.x > -0.99));
        assert_eq!(found.len(), 2, "{found:?}");
        for (border, (height, way)) in found.iter().zip([(0.96, DVec3::Z), (0.99, DVec3::NEG_X)]) {
            let radius_m = 0.02 * (1.0_f64 - height * height).sqrt();
            let length_m = std::f64::consts::TAU * radius_m;
            assert!(
                DVec3::from_array(border.position_m).distance(way * height * 0.02) < 0.3 * radius_m,
                "{border:?}"
            );
            assert!((border.length_m / length_m - 1.0).abs() < 0.5, "{border:?} of {length_m}");
        }
    }
}
