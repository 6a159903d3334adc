//! Q1 to Q3 per field: how far a force is from the ideal one, how rough it is, how long it takes.

use std::time::Instant;

use super::super::Row;
use super::super::statistics::Spread;
use super::Csv;
use super::ripple::ripple_rms;
use super::scenarios::{Ideal, RATE_HZ, STIFFNESS_N_PER_M, Scenario, VOXEL_M};
use vps::contact::ContactSum;
use vps::contact::ForceLaw;
use vps::spatial::Wrench;
use vps::voxmap::field::FieldKind;

/// What gives the depth of a point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Depths {
    /// A field.
    Of(FieldKind),
    /// The exact distance: the error of the shell alone.
    Exact,
}

impl Depths {
    /// In the order of the tables.
    pub const ALL: [Self; 5] = [
        Self::Of(FieldKind::Layers),
        Self::Of(FieldKind::SurfacePoint),
        Self::Of(FieldKind::Octant),
        Self::Of(FieldKind::Trilinear),
        Self::Exact,
    ];

    /// As in the tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Exact => "exact distance",
            Self::Of(kind) => FieldKind::NAMES
                .iter()
                .find(|(_, named)| *named == kind)
                .map_or("?", |(name, _)| name),
        }
    }
}

/// One scenario with one field.
#[derive(Clone, Debug)]
pub struct Measured {
    /// Q1, Q2 or Q3.
    pub family: &'static str,
    /// The path.
    pub path: &'static str,
    /// The field.
    pub depths: Depths,
    /// Points with V > 0, mean.
    pub contacts: f64,
    /// From the ideal direction, degrees; `None` where the ideal is zero.
    pub angle_deg: Option<Spread>,
    /// |F| from its mean over the path, % of the mean; where the ideal is zero, |F| itself, % of Σ |fᵢ|.
    pub magnitude_percent: Spread,
    /// Mean |F| above the one with exact depths, % of that; `None` where the ideal is zero.
    pub bias_percent: Option<f64>,
    /// RMS above 10 Hz at 50 mm/s, % of the mean |F| or of Σ |fᵢ|; `None` for a path that is too
    /// short.
    pub ripple_percent: Option<f64>,
    /// |τ − ideal|, as an arm of the same force (or of Σ |fᵢ|), voxels.
    pub torque_voxels: Spread,
    /// One query, µs; `None` for the exact distance.
    pub query_us: Option<Spread>,
}

/// Runs every scenario with every field, and writes `q1-q3.csv` (each path) and `q1-q3-series.csv`
/// (each tick) where a folder is given.
///
/// # Errors
/// A file that cannot be written.
pub fn measure(
    scenarios: &[Scenario],
    csv: &mut Csv,
) -> Result<Vec<Measured>, super::super::BenchError> {
    let mut all = Vec::new();
    let mut series = csv.file(
        "q1-q3-series.csv",
        "family,path,field,t_s,fx_n,fy_n,fz_n,tx_nm,ty_nm,tz_nm,contacts",
    )?;
    for scenario in scenarios {
        for depths in Depths::ALL {
            let run = Run::of(scenario, depths);
            for (tick, (wrench, contacts)) in run.wrenches.iter().zip(&run.contacts).enumerate() {
                let ([fx, fy, fz], [tx, ty, tz]) =
                    (wrench.force.to_array(), wrench.torque.to_array());
                let family = scenario.family;
                let path = scenario.path;
                let field = depths.name();
                let t_s = tick as f64 / RATE_HZ;
                series.line(format_args!(
                    "{family},{path},\"{field}\",{t_s},{fx},{fy},{fz},{tx},{ty},{tz},{contacts}"
                ))?;
            }
            all.push(run.measured(scenario, depths));
        }
    }
    series.finish()?;
    let mut figures = csv.file(
        "q1-q3.csv",
        "family,path,field,contacts,angle_mean_deg,angle_p99_deg,angle_max_deg,magnitude_mean_percent,magnitude_p99_percent,\
         magnitude_max_percent,bias_percent,ripple_percent,torque_mean_voxels,torque_p99_voxels,torque_max_voxels,query_mean_us,\
         query_p99_us,query_max_us",
    )?;
    for measured in &all {
        figures.line(format_args!("{}", measured.csv()))?;
    }
    figures.finish()?;
    Ok(all)
}

/// What a path gave.
struct Run {
    wrenches: Vec<Wrench>,
    contacts: Vec<u32>,
    query_us: Vec<f64>,
}

impl Run {
    fn of(scenario: &Scenario, depths: Depths) -> Self {
        let mut run = Self { wrenches: Vec::new(), contacts: Vec::new(), query_us: Vec::new() };
        for pose in &scenario.poses {
            let Depths::Of(field) = depths else {
                run.wrenches.push(scenario.exact(*pose).0);
                run.contacts.push(0);
                continue;
            };
            let law = contact(field);
            let since = Instant::now();
            let sum = ContactSum::flat(&scenario.obstacles, &scenario.shell, *pose, law);
            run.query_us.push(since.elapsed().as_secs_f64() * 1e6);
            run.wrenches.push(sum.wrench);
            run.contacts.push(sum.contacts);
        }
        run
    }

    fn measured(&self, scenario: &Scenario, depths: Depths) -> Measured {
        let mean = |values: &mut dyn Iterator<Item = f64>| {
            values.sum::<f64>() / self.wrenches.len() as f64
        };
        let exact: Vec<(Wrench, f64)> =
            scenario.poses.iter().map(|pose| scenario.exact(*pose)).collect();
        let lengths = || self.wrenches.iter().map(|wrench| wrench.force.length());
        let (scale_n, angle_deg, magnitude_percent, bias_percent);
        match scenario.ideal {
            Ideal::Along(direction) => {
                scale_n = mean(&mut lengths());
                let off = self
                    .wrenches
                    .iter()
                    .map(|wrench| wrench.force.angle_between(direction).to_degrees());
                angle_deg = Spread::of(off);
                magnitude_percent =
                    Spread::of(lengths().map(|length| 100.0 * (length - scale_n).abs() / scale_n));
                bias_percent = Some(
                    100.0
                        * (scale_n
                            / mean(&mut exact.iter().map(|(wrench, _)| wrench.force.length()))
                            - 1.0),
                );
            }
            Ideal::Zero => {
                scale_n = mean(&mut exact.iter().map(|(_, load_n)| *load_n));
                angle_deg = None;
                magnitude_percent = Spread::of(lengths().map(|length| 100.0 * length / scale_n));
                bias_percent = None;
            }
        }
        let forces: Vec<_> = self.wrenches.iter().map(|wrench| wrench.force).collect();
        let arms = self.wrenches.iter().map(|wrench| wrench.torque.length() / scale_n / VOXEL_M);
        Measured {
            family: scenario.family,
            path: scenario.path,
            depths,
            contacts: mean(&mut self.contacts.iter().map(|contacts| f64::from(*contacts))),
            angle_deg,
            magnitude_percent: magnitude_percent.unwrap_or_default(),
            bias_percent,
            ripple_percent: ripple_rms(&forces, RATE_HZ).map(|rms_n| 100.0 * rms_n / scale_n),
            torque_voxels: Spread::of(arms).unwrap_or_default(),
            query_us: Spread::of(self.query_us.iter().copied()),
        }
    }
}

/// A plain contact with this field.
pub(super) fn contact(field: FieldKind) -> ForceLaw {
    ForceLaw { field, stiffness_n_per_m: STIFFNESS_N_PER_M, ..ForceLaw::PLAIN }
}

impl Measured {
    fn csv(&self) -> String {
        let spread = |spread: Option<Spread>| {
            spread.map_or_else(
                || ",,".to_owned(),
                |Spread { mean, p99, max }| format!("{mean},{p99},{max}"),
            )
        };
        let number = |value: Option<f64>| value.map(|value| value.to_string()).unwrap_or_default();
        format!(
            "{},{},\"{}\",{},{},{},{},{},{},{}",
            self.family,
            self.path,
            self.depths.name(),
            self.contacts,
            spread(self.angle_deg),
            spread(Some(self.magnitude_percent)),
            number(self.bias_percent),
            number(self.ripple_percent),
            spread(Some(self.torque_voxels)),
            spread(self.query_us)
        )
    }
}

/// The worst path of each family, field by field: one table each.
pub(super) fn rows(all: &[Measured]) -> Vec<Row> {
    let mut rows = Vec::new();
    let mut families: Vec<&str> = all.iter().map(|measured| measured.family).collect();
    families.dedup();
    for family in families {
        let group = format!("{family}, worst path");
        for depths in Depths::ALL {
            let here = || {
                all.iter().filter(|measured| measured.family == family && measured.depths == depths)
            };
            let mut figure = |name: &str, unit, of: &dyn Fn(&Measured) -> Option<f64>| {
                let worst =
                    here().filter_map(of).reduce(|a, b| if b.abs() > a.abs() { b } else { a });
                if worst.is_some() {
                    rows.push(Row::new(&group, format!("{}: {name}", depths.name()), worst, unit));
                }
            };
            figure("angle error, mean", "°", &|m| m.angle_deg.map(|spread| spread.mean));
            figure("angle error, p99", "°", &|m| m.angle_deg.map(|spread| spread.p99));
            figure("angle error, max", "°", &|m| m.angle_deg.map(|spread| spread.max));
            figure("magnitude error, mean", "%", &|m| Some(m.magnitude_percent.mean));
            figure("magnitude error, p99", "%", &|m| Some(m.magnitude_percent.p99));
            figure("magnitude error, max", "%", &|m| Some(m.magnitude_percent.max));
            figure("mean force above the exact one", "%", &|m| m.bias_percent);
            figure("ripple above 10 Hz, RMS", "%", &|m| m.ripple_percent);
            figure("torque error as an arm, mean", "voxel", &|m| Some(m.torque_voxels.mean));
            figure("torque error as an arm, p99", "voxel", &|m| Some(m.torque_voxels.p99));
            figure("torque error as an arm, max", "voxel", &|m| Some(m.torque_voxels.max));
            figure("one query, mean", "µs", &|m| m.query_us.map(|spread| spread.mean));
            figure("one query, p99", "µs", &|m| m.query_us.map(|spread| spread.p99));
            figure("one query, max", "µs", &|m| m.query_us.map(|spread| spread.max));
        }
    }
    rows
}
