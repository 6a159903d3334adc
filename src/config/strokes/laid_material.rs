//! Material that is laid at once: everywhere, in a box or a ball, along a gradient, or by a file of
//! values.

use std::path::Path;

use glam::DVec3;

use super::super::resolve::MM;
use super::super::schema::Stroke;
use super::Reader;
use clay::engine::SculptOrder;
use clay::falloff::Falloff;
use clay::material_map::{MaterialPlace, Painted};
use document::{FINITE, Interval, Numbers, POSITIVE, ProblemKind};
use vps::storage::regular;

/// A file of values has at most so many bytes: a million lines.
const LONGEST_VALUES: u64 = 64 << 20;

impl Reader<'_> {
    pub(super) fn lay(&mut self, table: &str, stroke: &Stroke) -> Option<SculptOrder> {
        let n_before = self.resolve.checks.count();
        let painted = stroke.painted.map_or(Painted::default(), |painted| {
            self.resolve.painted(&format!("{table}.painted"), painted)
        });
        let place = self.place(table, stroke);
        if self.resolve.checks.count() > n_before {
            return None;
        }
        Some(SculptOrder::Lay { painted, place: place? })
    }

    fn place(&mut self, table: &str, stroke: &Stroke) -> Option<MaterialPlace> {
        let groups: [(&str, &[&'static str]); 4] = [
            ("low_mm", &["low_mm", "high_mm"]),
            ("center_mm", &["center_mm", "radius_mm", "falloff"]),
            ("from_mm", &["from_mm", "to_mm"]),
            ("values", &["values", "within_mm", "painted"]),
        ];
        let given = stroke.given();
        let named = groups.iter().find(|(first, _)| given.contains(first));
        let belongs = named.map_or(&[][..], |(_, keys)| keys);
        let strange = given.iter().copied().filter(|key| {
            groups.iter().any(|(_, keys)| keys.contains(key))
                && !belongs.contains(key)
                && *key != "painted"
        });
        let beside = named
            .map_or("where no place is given".to_owned(), |(first, _)| format!("beside {first}"));
        self.leave_out(table, strange, &beside);
        match named.map(|(first, _)| *first) {
            None => Some(MaterialPlace::Everywhere),
            Some("low_mm") => {
                let low_map = self.at(table, "low_mm", stroke.low_mm)?;
                let high_map = self.at(table, "high_mm", stroke.high_mm)?;
                if !low_map.cmplt(high_map).all() {
                    self.resolve.checks.not_accepted(
                        &format!("{table}.high_mm"),
                        "higher than low_mm along x, y and z",
                    );
                }
                Some(MaterialPlace::Box { low_map, high_map })
            }
            Some("center_mm") => {
                let center_map = self.at(table, "center_mm", stroke.center_mm)?;
                let key = format!("{table}.radius_mm");
                let radius_m = self.resolve.checks.required(&key, stroke.radius_mm, length()) * MM;
                let falloff =
                    self.resolve.tool_settings(table, &stroke.written_tool(), self.tool).falloff;
                let falloff = if stroke.falloff.is_some() { falloff } else { Falloff::Constant };
                Some(MaterialPlace::Ball { center_map, radius_m, falloff })
            }
            Some("from_mm") => {
                let from_map = self.at(table, "from_mm", stroke.from_mm)?;
                let to_map = self.at(table, "to_mm", stroke.to_mm)?;
                if from_map == to_map {
                    self.resolve
                        .checks
                        .not_accepted(&format!("{table}.to_mm"), "another place than from_mm");
                }
                Some(MaterialPlace::Gradient { from_map, to_map })
            }
            Some(_) => {
                if stroke.painted.is_some() {
                    self.leave_out(
                        table,
                        ["painted"],
                        "beside values, which say it for each place",
                    );
                }
                let within_m = self.resolve.checks.number(
                    &format!("{table}.within_mm"),
                    stroke.within_mm,
                    1.0,
                    length(),
                ) * MM;
                self.values(&format!("{table}.values"), stroke.values.as_deref()?, within_m)
            }
        }
    }

    fn at(&mut self, table: &str, name: &str, written: Option<Numbers<3>>) -> Option<DVec3> {
        let key = format!("{table}.{name}");
        let written = self.resolve.checks.given(&key, written, "a place as [x, y, z]");
        self.resolve.checks.array(&key, written, FINITE).map(|mm| DVec3::from_array(mm) * MM)
    }

    fn values(&mut self, key: &str, file: &str, within_m: f64) -> Option<MaterialPlace> {
        let path = self.resolve.checks.file(key, file, self.resolve.dir)?;
        match read_values(&path, within_m) {
            Ok(place) => Some(place),
            Err(why) => {
                let hint = Some(MaterialPlace::values_hint());
                self.resolve.checks.refuse(key, ProblemKind::Refused { why, hint });
                None
            }
        }
    }
}

fn length() -> Interval {
    POSITIVE.to(1e3).unit("mm")
}

fn read_values(path: &Path, within_m: f64) -> Result<MaterialPlace, String> {
    let name = path.display();
    let bytes = regular::bytes(path, LONGEST_VALUES)
        .map_err(|error| format!("cannot read {name}: {error}"))?;
    MaterialPlace::values(&bytes, within_m).map_err(|why| format!("{name}: {why}"))
}
