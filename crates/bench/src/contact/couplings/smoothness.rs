//! What a hand feels of the shipped scenes, beside the raw force of 2008.

use glam::DVec3;
use toml::Value;

use super::super::super::{BenchError, Row};
use super::super::scenes::{self, Played};
use super::{Bench, ForceSeries, Tried, changes, commanded, coupled, raw, ripple_over, windows};
use haptics::stability::filter_delay_s;
use vps::contact::ContactSum;
use vps::contact::{ForceLaw, Normalization};
use vps::spatial::Pose;
use vps::voxmap::field::FieldKind;

/// A shipped scene as it is beside the force of 2008.
pub(super) struct Smooth {
    pub(super) scene: String,
    pub(super) figures: Tried<SmoothFigures>,
}

pub(super) struct SmoothFigures {
    /// On the hand, as shipped, N and % of the mean.
    felt: Roughness,
    /// Raw force at the same poses of the tool.
    same_poses: Roughness,
    /// On the hand, raw field through the shipped coupling.
    through_coupling: Tried<Roughness>,
    /// On the hand, raw field, no virtual tool, the stiffest point that the arm takes: the loop
    /// of 2008. None on an arm that takes every stiffness.
    direct: Option<Tried<Roughness>>,
    /// The most that the shipped filter delays a slow force, s.
    stated_delay_s: f64,
    /// How often contact came or went in the whole run.
    changes: usize,
}

/// Roughness of a force in contact.
#[derive(Clone, Copy)]
struct Roughness {
    ripple_n: Option<f64>,
    mean_n: f64,
    faulted: bool,
}

impl Roughness {
    fn of(windows: &[(usize, usize)], forces: &[DVec3], faulted: bool) -> Self {
        let inside: Vec<f64> = windows
            .iter()
            .flat_map(|(from, to)| &forces[*from..*to])
            .map(|force| force.length())
            .collect();
        Self {
            ripple_n: ripple_over(windows, forces),
            mean_n: inside.iter().sum::<f64>() / inside.len().max(1) as f64,
            faulted,
        }
    }

    /// Of a run in given ticks, as far as it came.
    fn within(ticks: &[(usize, usize)], played: &Played) -> Self {
        let forces: Vec<DVec3> = played.before_stop().iter().map(commanded).collect();
        let ticks: Vec<(usize, usize)> = ticks
            .iter()
            .map(|(from, to)| (*from, (*to).min(forces.len())))
            .filter(|(from, to)| from < to)
            .collect();
        Self::of(&ticks, &forces, !played.faults.is_empty())
    }

    fn percent(self) -> Option<f64> {
        self.ripple_n.filter(|_| self.mean_n > 0.0).map(|ripple_n| 100.0 * ripple_n / self.mean_n)
    }
}

impl SmoothFigures {
    fn of(
        default: &Played,
        through_coupling: Tried<Roughness>,
        direct: Option<Tried<Roughness>>,
    ) -> Self {
        let records = default.before_stop();
        let parameters = &default.scene.parameters;
        let law = ForceLaw {
            field: FieldKind::Layers,
            normalization: Normalization::None,
            ..parameters.contact.force_law()
        };
        let tool = &default.scene.tool;
        let at_poses: Vec<DVec3> = records
            .iter()
            .map(|record| {
                let body = record.output.world_from_tool
                    * Pose::from_translation(tool.center_of_mass_tool);
                ContactSum::flat(&default.scene.obstacles, &tool.shell, body, law).wrench.force
            })
            .collect();
        Self {
            felt: Roughness::within(&windows(records), default),
            same_poses: Roughness::of(&windows(records), &at_poses, false),
            through_coupling,
            direct,
            changes: changes(records),
            stated_delay_s: filter_delay_s(parameters.filter.cutoff_hz[0], parameters.period_s),
        }
    }
}

impl Smooth {
    pub(super) fn rows(&self) -> Vec<Row> {
        const GROUP: &str =
            "smoothness: ripple above 10 Hz in contact, as shipped beside the raw force of 2008";
        let figures = match &self.figures {
            Err(why) => {
                return vec![Row::new(GROUP, format!("{}: skipped: {why}", self.scene), None, "")];
            }
            Ok(figures) => figures,
        };
        let scene = &self.scene;
        let felt = figures.felt;
        let mut rows = vec![Row::new(
            GROUP,
            format!("{scene}: largest delay of the filter"),
            figures.stated_delay_s * 1e3,
            "ms",
        )];
        rows.push(Row::new(
            GROUP,
            format!("{scene}: contact came or went, whole run"),
            figures.changes as f64,
            "",
        ));
        let same_poses = Ok(figures.same_poses);
        let beside = [
            Some(("raw at the same poses", &same_poses)),
            Some(("raw through the same coupling", &figures.through_coupling)),
            figures.direct.as_ref().map(|direct| ("raw without a virtual tool", direct)),
        ];
        for (name, raw) in beside.into_iter().flatten() {
            let faulted = raw.as_ref().is_ok_and(|raw| raw.faulted);
            let name =
                if faulted { format!("{name}, which ends in a fault") } else { name.to_owned() };
            let peer = |of: fn(Roughness) -> Option<f64>| {
                raw.clone().and_then(|raw| of(raw).ok_or_else(|| "too short a contact".to_owned()))
            };
            let row = |what: &str, value, unit, raw: &Result<f64, String>| {
                Row::new(GROUP, format!("{scene}: {what}"), value, unit)
                    .beside_peer(&name, raw)
                    .at_least_times(10.0)
            };
            rows.push(row("ripple on the hand", felt.ripple_n, "N", &peer(|raw| raw.ripple_n)));
            rows.push(row(
                "ripple on the hand, share of the mean force",
                felt.percent(),
                "%",
                &peer(Roughness::percent),
            ));
        }
        rows
    }
}

impl Bench<'_> {
    pub(super) fn smoothness(&mut self) -> Result<(Vec<Smooth>, Vec<ForceSeries>), BenchError> {
        let mut found = Vec::new();
        let mut series = Vec::new();
        let scenes = scenes::shipped(&self.options.scenes);
        if scenes.is_empty() {
            found.push(Smooth {
                scene: "shipped scenes".to_owned(),
                figures: Err(self.no_scenes()),
            });
        }
        for scene in scenes.into_iter().take(if self.options.quick { 1 } else { usize::MAX }) {
            let name = scenes::name(&scene);
            self.tell(&format!("{name}: as shipped and raw"));
            let default = self.played(&scene, &[])?;
            let raw_played = self.played(&scene, &raw())?;
            if let (Ok(default), Ok(raw)) = (&default, &raw_played) {
                series.extend(side_by_side(&name, default, raw));
            }
            // In the same ticks, so that a force which lets go of the wall and comes back is rough
            // too.
            let ticks =
                default.as_ref().map(|default| windows(default.before_stop())).unwrap_or_default();
            let through_coupling = raw_played.map(|played| Roughness::within(&ticks, &played));
            let direct = self.as_stiff_as_allowed(
                &scene,
                raw().into_iter().chain([coupled("direct")]).collect(),
            );
            let direct = Some(
                self.played(&scene, &direct)?.map(|played| Roughness::within(&ticks, &played)),
            );
            let figures =
                default.map(|default| SmoothFigures::of(&default, through_coupling, direct));
            found.push(Smooth { scene: name.clone(), figures });
            // The steps of an encoder, times the stiffness of the coupling, are roughness too,
            // whatever the field.
            self.tell(&format!("{name}: on the ideal arm, and raw"));
            let ideal = || [("device.profile", Value::from("sim-ideal"))];
            let default = self.played(&scene, &ideal())?;
            let through_coupling =
                self.played(&scene, &raw().into_iter().chain(ideal()).collect::<Vec<_>>())?;
            let ticks =
                default.as_ref().map(|default| windows(default.before_stop())).unwrap_or_default();
            let through_coupling =
                through_coupling.map(|played| Roughness::within(&ticks, &played));
            let figures =
                default.map(|default| SmoothFigures::of(&default, through_coupling, None));
            found.push(Smooth { scene: format!("{name}, ideal arm"), figures });
        }
        Ok((found, series))
    }
}

/// The first second of the longest contact, as shipped and raw; `None` where nothing touches for
/// long.
fn side_by_side(scene: &str, shipped: &Played, raw: &Played) -> Option<ForceSeries> {
    const LONGEST_TICKS: usize = 1000;
    let (from, to) =
        windows(shipped.before_stop()).into_iter().max_by_key(|(from, to)| to - from)?;
    let forces = |played: &Played| -> Vec<f64> {
        let records = played.before_stop().iter().take(to).skip(from).take(LONGEST_TICKS);
        records.map(|record| commanded(record).length()).collect()
    };
    Some(ForceSeries { scene: scene.to_owned(), shipped: forces(shipped), raw: forces(raw) })
}
