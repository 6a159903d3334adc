//! Curves that are drawn or pulled.

use glam::DVec3;

use super::super::resolve::MM;
use super::super::schema::Stroke;
use super::{Reader, TIME_S};
use clay::engine::{RopeCurves, SculptOrder};
use document::{FINITE, Interval, Numbers, POSITIVE};

impl Reader<'_> {
    pub(super) fn curves(&mut self, table: &str, stroke: &Stroke) -> Option<RopeCurves> {
        let key = format!("{table}.curves_mm");
        let accepted = "curves, each a list of places [x, y, z], such as [[[0, 0, 4], [5, 0, 4]]]";
        let curves = self.resolve.checks.given(&key, stroke.curves_mm.as_ref(), accepted)?;
        let place = |Numbers(mm): &Numbers<3>| DVec3::from_array(*mm) * MM;
        let curves_map: Vec<Vec<DVec3>> =
            curves.iter().map(|curve| curve.iter().map(place).collect()).collect();
        let n_corners: usize = curves_map.iter().map(Vec::len).sum();
        let is_sound =
            |curve: &Vec<DVec3>| !curve.is_empty() && curve.iter().all(|at| at.is_finite());
        let n_max = RopeCurves::CURVES_MAX;
        let corners_max = RopeCurves::CORNERS_MAX;
        if curves_map.is_empty()
            || curves_map.len() > n_max
            || n_corners > corners_max
            || !curves_map.iter().all(is_sound)
        {
            let accepted = format!(
                "1 to {n_max} curves of at least one place each, {corners_max} places in all"
            );
            self.resolve.checks.not_accepted(&key, accepted);
            return None;
        }
        Some(RopeCurves { curves_map, is_free: stroke.free.unwrap_or(false) })
    }

    pub(super) fn pull(
        &mut self,
        index: usize,
        table: &str,
        stroke: &Stroke,
        at_s: f64,
    ) -> Option<SculptOrder> {
        let curves = self.curves(table, stroke);
        let key = format!("{table}.force_n");
        let written = self.resolve.checks.given(
            &key,
            stroke.force_n,
            "the force on the clay as [x, y, z], N",
        );
        let force_map = self.resolve.checks.array(&key, written, FINITE).map(DVec3::from_array);
        let force_max_n = RopeCurves::FORCE_MAX_N;
        if force_map.is_some_and(|force| force == DVec3::ZERO || force.length() > force_max_n) {
            self.resolve
                .checks
                .not_accepted(&key, format_args!("a force above 0 and of {force_max_n} N at most"));
        }
        let key = format!("{table}.until_s");
        let until_s = self.resolve.checks.required(&key, stroke.until_s, TIME_S);
        let time_s = until_s - at_s;
        if time_s.is_finite() && !(time_s > 0.0 && time_s <= RopeCurves::TIME_MAX_S) {
            let most_s = RopeCurves::TIME_MAX_S;
            self.resolve.checks.not_accepted(
                &key,
                format_args!("later than at_s = {at_s} s, by {most_s} s at most"),
            );
        }
        self.holds.push((index, at_s, until_s));
        let interval: Interval = POSITIVE.to(1e3).unit("mm");
        let brush_m = self
            .resolve
            .checks
            .optional(&format!("{table}.brush_mm"), stroke.brush_mm, interval)
            .map(|mm| mm * MM);
        Some(SculptOrder::Pull { curves: curves?, force_map: force_map?, time_s, brush_m })
    }
}
