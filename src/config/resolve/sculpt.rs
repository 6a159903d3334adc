//! `[sculpt]`: the clay of a scene, and the tool in the hand that works it. Files of strokes share
//! what they have in common.

use std::ops::RangeInclusive;
use std::path::PathBuf;
use std::sync::Arc;

use glam::DVec3;

use super::super::scene::{ClaySource, SculptConfig};
use super::super::schema::{
    self, Creep, FalloffRate, FalloffWritten, PaintedWritten, WrittenSolid, WrittenTool,
};
use super::objects::WrittenSource;
use super::{MM, Resolve};
use clay::clay_model::Settings;
use clay::dynamics::{Integrator, Material};
use clay::emboss::GreyImage;
use clay::engine::ToolSettings;
use clay::falloff::Falloff;
use clay::material_map::Painted;
use clay::{PointSurface, Solid};
use document::{FINITE, Interval, Numbers, POSITIVE, ProblemKind, show};
use haptics::CouplingMode;
use vps::mesh::primitives::Shape;
use vps::mesh::{self, cloud};
use vps::spatial::Pose;

/// Updates of the material per second where none are asked for: what a raster of 40³ takes on two
/// cores, with a margin.
const DEFAULT_UPDATE_HZ: f64 = 100.0;
const LEAST_UPDATE_HZ: f64 = 10.0;
/// Whole ticks between updates may be off the rate that was asked for by this share.
const UPDATE_TOLERANCE: f64 = 0.05;
/// Mass points along an axis, and in all: an update of so many takes a second.
pub(crate) const RASTER_AXIS: RangeInclusive<f64> = 4.0..=256.0;
pub(crate) const RASTER_NODES: f64 = 2_097_152.0;
/// What the clay may be made of, at first and where it is painted.
const MASS_KG: Interval =
    Interval::from(*Material::MASS_KG.start()).to(*Material::MASS_KG.end()).unit("kg");
const DAMPING_N_S_PER_M: Interval = Interval::from(*Material::DAMPING_N_S_PER_M.start())
    .to(*Material::DAMPING_N_S_PER_M.end())
    .unit("N·s/m");
const STIFFNESS_N_PER_M: Interval = POSITIVE.to(Material::STIFFNESS_MAX_N_PER_M).unit("N/m");

/// What a session does not bring: how the clay stands, its tool, and how it is worked.
const BESIDE_SESSION: [&str; 14] = [
    "session",
    "position_mm",
    "orientation_xyzw",
    "update_hz",
    "smoothing",
    "strokes",
    "tool",
    "brush_mm",
    "falloff",
    "color",
    "painted",
    "depth_mm",
    "image",
    "sharp",
];

impl Resolve<'_> {
    pub(super) fn sculpt(
        &mut self,
        written: &schema::Sculpt,
        rate_hz: u32,
        mode: CouplingMode,
    ) -> SculptConfig {
        if !mode.feels_clay() {
            let accepted = "another coupling: planes have no force that goes on smoothly from one \
                update of the clay to the next";
            self.checks.not_accepted("rendering.coupling", accepted);
        }
        let source = self.clay_source(written);
        let region_map = self.region_m("sculpt.region_mm", written.region_mm.as_deref());
        let settings = self.model(written, region_map);
        SculptConfig {
            source,
            world_from_map: self.pose("sculpt", written.position_mm, written.orientation_xyzw),
            settings,
            update_ticks: self.update_ticks(written.update_hz, rate_hz),
            tool: self.tool_settings("sculpt", &written.written_tool(), &ToolSettings::default()),
            smoothing: self.checks.optional(
                "sculpt.smoothing",
                written.smoothing,
                Interval::from(0.0).to(0.999).unit(""),
            ),
            strokes: written
                .strokes
                .as_deref()
                .and_then(|file| self.checks.file("sculpt.strokes", file, self.dir)),
        }
    }

    fn clay_source(&mut self, written: &schema::Sculpt) -> ClaySource {
        let Some(session) = &written.session else {
            return ClaySource::Solid(self.solid(
                "sculpt",
                &written.written_solid(),
                ", or session",
            ));
        };
        for name in written.given().into_iter().filter(|name| !BESIDE_SESSION.contains(name)) {
            self.checks.not_accepted(
                &format!("sculpt.{name}"),
                "left out beside sculpt.session, which brings its own",
            );
        }
        let path = self.checks.file("sculpt.session", session, self.dir);
        ClaySource::Session(path.unwrap_or_default())
    }

    fn model(&mut self, written: &schema::Sculpt, region_map: Option<(DVec3, DVec3)>) -> Settings {
        let own = Settings::default();
        let Material {
            mass_kg,
            damping_n_s_per_m,
            stiffness_n_per_m,
            creep_s,
            acceleration_max_m_per_s2,
        } = own.material;
        let mut quantity = |key: &str, written: Option<f64>, default: f32, interval: Interval| {
            self.checks.optional(key, written, interval).map_or(default, |value| value as f32)
        };
        let material = Material {
            mass_kg: quantity("sculpt.mass", written.mass, mass_kg, MASS_KG),
            damping_n_s_per_m: quantity(
                "sculpt.damping",
                written.damping,
                damping_n_s_per_m,
                DAMPING_N_S_PER_M,
            ),
            stiffness_n_per_m: quantity(
                "sculpt.stiffness",
                written.stiffness,
                stiffness_n_per_m,
                STIFFNESS_N_PER_M,
            ),
            creep_s: match written.creep_ms {
                None => creep_s,
                Some(Creep::Off(_) | Creep::Milliseconds(0.0)) => f64::INFINITY,
                Some(Creep::Milliseconds(ms)) => {
                    let interval = Interval::from(1.0).to(1e6).unit("ms, or \"off\"");
                    self.checks.number("sculpt.creep_ms", Some(ms), creep_s / MM, interval) * MM
                }
            },
            acceleration_max_m_per_s2: self.acceleration_max(written, acceleration_max_m_per_s2),
        };
        let least = *PointSurface::NEIGHBOURS.start() as u32;
        let most = *PointSurface::NEIGHBOURS.end() as u32;
        Settings {
            n_neighbours: self.checks.whole(
                "sculpt.neighbours",
                written.neighbours,
                own.n_neighbours as u32,
                least,
                most,
            ) as usize,
            interpolates: written.interpolate.unwrap_or(own.interpolates),
            region_map,
            raster: self.raster(written.raster).unwrap_or(own.raster),
            air_m: self.checks.number(
                "sculpt.air_mm",
                written.air_mm,
                own.air_m / MM,
                Interval::from(0.0).to(1e3).unit("mm"),
            ) * MM,
            material,
            integrator: written.integrator.map_or(Integrator::Implicit, Into::into),
        }
    }

    /// Only explicit steps are halved.
    fn acceleration_max(&mut self, written: &schema::Sculpt, default: f64) -> f64 {
        let key = "sculpt.acceleration_max";
        let is_explicit =
            written.integrator.is_some_and(|word| Integrator::from(word) == Integrator::Explicit);
        if written.acceleration_max.is_some() && !is_explicit {
            self.checks.not_accepted(
                key,
                "left out, or integrator = \"explicit\" beside it: only explicit steps are halved",
            );
        }
        self.checks.number(key, written.acceleration_max, default, POSITIVE.to(1e9).unit("m/s²"))
    }

    fn raster(&mut self, written: Option<Numbers<3>>) -> Option<[usize; 3]> {
        let Numbers(numbers) = written?;
        let is_sound = |n: &f64| n.fract() == 0.0 && RASTER_AXIS.contains(n);
        if !numbers.iter().all(is_sound) {
            let least = RASTER_AXIS.start();
            let most = RASTER_AXIS.end();
            self.checks.not_accepted(
                "sculpt.raster",
                format_args!("three whole numbers of mass points, each from {least} to {most}"),
            );
            return None;
        }
        let n_nodes: f64 = numbers.iter().product();
        if n_nodes > RASTER_NODES {
            let accepted = format!(
                "at most {RASTER_NODES} mass points in all, such as 128 along each axis; these are \
                    {n_nodes}"
            );
            self.checks.not_accepted("sculpt.raster", accepted);
            return None;
        }
        Some(numbers.map(|n| n as usize))
    }

    /// Whole ticks from one update to the next.
    fn update_ticks(&mut self, written: Option<f64>, rate_hz: u32) -> u64 {
        let rate_hz = f64::from(rate_hz);
        let interval = Interval::from(LEAST_UPDATE_HZ).to(rate_hz).unit("Hz");
        let update_hz =
            self.checks.number("sculpt.update_hz", written, DEFAULT_UPDATE_HZ, interval);
        let ticks = (rate_hz / update_hz).round().max(1.0);
        // Where none was asked for, the nearest will do.
        if written.is_some() && (rate_hz / (ticks * update_hz) - 1.0).abs() > UPDATE_TOLERANCE {
            let [slower, faster] =
                [(rate_hz / update_hz).ceil(), (rate_hz / update_hz).floor().max(1.0)]
                    .map(|n| show(rate_hz / n));
            let accepted = format!(
                "near to what whole ticks at {rate_hz} Hz make, such as {slower} or {faster}"
            );
            self.checks.not_accepted("sculpt.update_hz", accepted);
        }
        ticks as u64
    }

    /// Lowest and highest corner of a box, m.
    pub(in crate::config) fn region_m(
        &mut self,
        key: &str,
        written: Option<&[Numbers<3>]>,
    ) -> Option<(DVec3, DVec3)> {
        let written = written?;
        let corners: Vec<DVec3> =
            written.iter().map(|Numbers(corner)| DVec3::from_array(*corner) * MM).collect();
        match corners[..] {
            [low, high] if low.is_finite() && high.is_finite() && high.cmpgt(low).all() => {
                Some((low, high))
            }
            _ => {
                self.checks.not_accepted(
                    key,
                    "[[x, y, z], [x, y, z]], the lowest corner first and \
                    every edge longer than 0 mm",
                );
                None
            }
        }
    }

    pub(in crate::config) fn pose(
        &mut self,
        table: &str,
        position: Option<Numbers<3>>,
        turned: Option<Numbers<4>>,
    ) -> Pose {
        Pose::new(
            self.checks.orientation(&format!("{table}.orientation_xyzw"), turned),
            self.checks.position(&format!("{table}.position_mm"), position) * MM,
        )
    }

    /// Exactly one of points, a mesh and a shape; `or` names what else there may be. After a
    /// problem some solid, so that the pass goes on.
    pub(in crate::config) fn solid(
        &mut self,
        table: &str,
        written: &WrittenSolid<'_>,
        or: &str,
    ) -> Solid {
        let key = |name: &str| format!("{table}.{name}");
        let WrittenSolid { points, mesh, shape, units, spacing_mm, scale } = *written;
        let fallback = Solid::Shape {
            shape: Shape::Sphere { radius_m: 1.0 },
            scale: DVec3::ONE,
            spacing_m: None,
        };
        let given: Vec<&str> =
            [("points", points.is_some()), ("mesh", mesh.is_some()), ("shape", shape.is_some())]
                .into_iter()
                .filter_map(|(name, is_given)| is_given.then_some(name))
                .collect();
        if let [first, second, ..] = given[..] {
            self.checks.refuse(&key(second), ProblemKind::Exclusive { other: key(first) });
            return fallback;
        }
        let scale = self
            .checks
            .array(&key("scale"), scale, Interval::from(0.01).to(100.0).unit(""))
            .map_or(DVec3::ONE, DVec3::from_array);
        let interval = POSITIVE.to(100.0).unit("mm");
        let spacing_m =
            self.checks.optional(&key("spacing_mm"), spacing_mm, interval).map(|mm| mm * MM);
        if let Some(points) = points {
            if spacing_mm.is_some() {
                self.checks.not_accepted(
                    &key("spacing_mm"),
                    "left out beside points, which are taken as they are",
                );
            }
            let metres_per_unit = self.metres_per_unit(table, units, "of the points");
            return match self.points_path(&key("points"), points) {
                Some(path) => Solid::File { path, metres_per_unit, scale, spacing_m: None },
                None => fallback,
            };
        }
        if given.is_empty() {
            let accepted =
                format!("points, a mesh, a shape such as shape = {{ sphere_mm = 20 }}{or}");
            self.checks.missing(&key("points"), accepted);
            return fallback;
        }
        // Shapes have no voxels here.
        match self.source(table, WrittenSource { mesh, shape, units }, 0.0, 0) {
            super::super::scene::MeshSource::File { path, metres_per_unit } => {
                Solid::File { path, metres_per_unit, scale, spacing_m }
            }
            super::super::scene::MeshSource::Shape(shape) => {
                Solid::Shape { shape, scale, spacing_m }
            }
        }
    }

    fn points_path(&mut self, key: &str, written: &str) -> Option<PathBuf> {
        let ending =
            written.rsplit_once('.').map(|(_, ending)| ending.to_lowercase()).unwrap_or_default();
        let known = || mesh::EXTENSIONS.iter().chain(cloud::EXTENSIONS);
        if !known().any(|extension| *extension == ending) {
            let known: Vec<String> = known().map(|extension| format!(".{extension}")).collect();
            self.checks.not_accepted(
                key,
                format_args!("a file of points whose name ends in {}", known.join(", ")),
            );
            return None;
        }
        self.checks.file(key, written, self.dir)
    }

    /// A tool; what is not written is as before.
    pub(in crate::config) fn tool_settings(
        &mut self,
        table: &str,
        written: &WrittenTool<'_>,
        before: &ToolSettings,
    ) -> ToolSettings {
        let key = |name: &str| format!("{table}.{name}");
        let length = |most_mm: f64| POSITIVE.to(most_mm).unit("mm");
        ToolSettings {
            kind: written.tool.map_or(before.kind, Into::into),
            brush_m: self.checks.number(
                &key("brush_mm"),
                written.brush_mm,
                before.brush_m / MM,
                length(1e3),
            ) * MM,
            falloff: match written.falloff {
                None => before.falloff.clone(),
                Some(own) => {
                    let falloff = match own {
                        FalloffWritten::Rate(FalloffRate { rate }) => Falloff::rate(*rate),
                        FalloffWritten::Weights(weights) => Falloff::table(weights.clone()),
                        FalloffWritten::Word(word) => Ok((*word).into()),
                    };
                    falloff.unwrap_or_else(|problem| {
                        self.checks.refuse(&key("falloff"), ProblemKind::refused(problem));
                        before.falloff.clone()
                    })
                }
            },
            color: written.color.map_or(before.color, |text| {
                color(text).unwrap_or_else(|| {
                    self.checks.not_accepted(
                        &key("color"),
                        "a colour as \"#rrggbb\", such as \"#c83c28\"",
                    );
                    before.color
                })
            }),
            painted: written
                .painted
                .map_or(before.painted, |painted| self.painted(&key("painted"), painted)),
            depth_m: self.checks.number(
                &key("depth_mm"),
                written.depth_mm,
                before.depth_m / MM,
                length(100.0),
            ) * MM,
            image: self.image(&key("image"), written.image).or_else(|| before.image.clone()),
            solid: before.solid.clone(),
            is_sharp: written.sharp.unwrap_or(before.is_sharp),
        }
    }

    /// A material to paint, all of it as written.
    pub(in crate::config) fn painted(&mut self, table: &str, written: PaintedWritten) -> Painted {
        let mut property = |name: &str, written: Option<f64>, interval: Interval| {
            self.checks
                .optional(&format!("{table}.{name}"), written, interval)
                .map(|value| value as f32)
        };
        Painted {
            mass_kg: property("mass", written.mass, MASS_KG),
            damping_n_s_per_m: property("damping", written.damping, DAMPING_N_S_PER_M),
            stiffness_n_per_m: property("stiffness", written.stiffness, STIFFNESS_N_PER_M),
        }
    }

    /// A grey image; `None` when left out or after a problem.
    pub(in crate::config) fn image(
        &mut self,
        key: &str,
        written: Option<&str>,
    ) -> Option<Arc<GreyImage>> {
        let path = self.checks.file(key, written?, self.dir)?;
        match GreyImage::read(&path) {
            Ok(image) => Some(Arc::new(image)),
            Err(problem) => {
                self.checks.refuse(
                    key,
                    ProblemKind::Refused {
                        why: problem.to_string(),
                        hint: Some("save it as PNG".into()),
                    },
                );
                None
            }
        }
    }

    /// A direction, of any length above 0.
    pub(in crate::config) fn direction(
        &mut self,
        key: &str,
        written: Option<Numbers<3>>,
    ) -> Option<DVec3> {
        let direction = self.checks.array(key, written, FINITE).map(DVec3::from_array)?;
        let unit = direction.try_normalize();
        if unit.is_none() {
            self.checks.not_accepted(key, "a direction, which is longer than 0");
        }
        unit
    }
}

fn color(text: &str) -> Option<[u8; 3]> {
    let digits = text
        .strip_prefix('#')
        .filter(|digits| digits.len() == 6 && digits.bytes().all(|c| c.is_ascii_hexdigit()))?;
    let [_, red, green, blue] = u32::from_str_radix(digits, 16).ok()?.to_be_bytes();
    Some([red, green, blue])
}

#[cfg(test)]
mod tests {
    use super::*;
    use clay::engine::SculptTool;

    #[test]
    fn a_tool_has_the_word_of_the_scene() {
        use schema::CraftWord::*;
        for word in [
            Touch,
            Push,
            Pull,
            PullCurve,
            Paint,
            Material,
            Emboss,
            Engrave,
            Union,
            Intersection,
            Difference,
            Region,
        ] {
            assert_eq!(SculptTool::from(word).name(), word.to_string());
        }
        assert_eq!(SculptTool::NAMES.len(), 12);
    }

    #[test]
    fn colours_are_six_hexadecimal_digits() {
        assert_eq!(color("#c83c28"), Some([200, 60, 40]));
        for wrong in ["c83c28", "#c83c2", "#c83c288", "#c83cxx", "#+83c28", ""] {
            assert_eq!(color(wrong), None, "{wrong}");
        }
    }
}
