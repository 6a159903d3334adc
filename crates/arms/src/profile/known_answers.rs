//! Known answers: the `[[check]]` tables, read, and held against everything else that a profile
//! says.

use glam::DVec3;

use super::packet::hex_bytes;
use super::written::ProfileFile;
use super::{Check, RealArm};
use crate::axes::MAX_AXES;
use crate::kinematics::{Configuration, Kinematics};
use document::{Checks, FINITE, POSITIVE, ProblemKind};

/// Tolerance of a check where it gives none, mm.
const DEFAULT_TOLERANCE_MM: f64 = 0.01;

/// Share of a reading, or of 1, by which a frame may differ from it: what single precision and a
/// scale leave.
const READ_ALIKE: f64 = 1e-6;

/// The tables as they are written.
pub(super) fn read(checks: &mut Checks<'_>, written: &ProfileFile) -> Vec<Check> {
    let mut known = Vec::new();
    for (idx, check) in written.check.iter().enumerate() {
        let frame = check
            .frame_hex
            .as_ref()
            .and_then(|hex| hex_bytes(checks, &format!("check[{idx}].frame_hex"), hex));
        if check.readings.is_none() && check.frame_hex.is_none() {
            checks.missing(&format!("check[{idx}]"), "frame_hex or readings");
        }
        if check.position_mm.is_none() {
            checks.missing(
                &format!("check[{idx}].position_mm"),
                "the position of the grip in the native frame",
            );
        }
        let tolerance = checks.number(
            &format!("check[{idx}].tolerance_mm"),
            check.tolerance_mm,
            DEFAULT_TOLERANCE_MM,
            POSITIVE.unit("mm"),
        );
        known.push(Check {
            frame,
            readings: check.readings.clone(),
            position_native: checks
                .array(&format!("check[{idx}].position_mm"), check.position_mm, FINITE)
                .map_or(DVec3::ZERO, DVec3::from_array)
                * 1e-3,
            tolerance_m: tolerance * 1e-3,
        });
    }
    known
}

/// Whether the arm of this profile gives the answers that its author knows. Judged last: whatever
/// else is wrong would spoil them.
pub(super) fn judge(checks: &mut Checks<'_>, real: &RealArm) {
    if !checks.is_clean() {
        return;
    }
    for (idx, check) in real.checks.iter().enumerate() {
        if let Some((key, kind)) = mistake(check, real) {
            checks.refuse(&format!("check[{idx}]{key}"), kind);
        }
    }
}

/// The key that is wrong, and how.
fn mistake(check: &Check, real: &RealArm) -> Option<(&'static str, ProblemKind)> {
    let not_accepted = |key, accepted| Some((key, ProblemKind::NotAccepted { accepted }));
    let disagrees = |key, found| Some((key, ProblemKind::Disagrees { found }));
    if matches!(real.kinematics, Kinematics::Rate(_)) {
        return not_accepted("", "left out: a rate input has no position".to_owned());
    }
    let least = readings_needed(real);
    let most = real.protocol.n_readings();
    let mut readings = [0.0; MAX_AXES];
    if let Some(given) = &check.readings {
        if !(least..=most).contains(&given.len()) {
            return not_accepted(
                ".readings",
                format!(
                    "from {least} to {most} readings, in the order of `{}`",
                    real.protocol.name()
                ),
            );
        }
        readings.iter_mut().zip(given).for_each(|(reading, given)| *reading = *given);
    }
    if let Some(frame) = &check.frame {
        let mut codec = real.protocol.codec(real.matching.transport.carriage());
        let fed = codec.feed(frame);
        if (fed.reports, fed.corrupt) != (1, 0) {
            let name = real.protocol.name();
            let reports = fed.reports;
            let corrupt = fed.corrupt;
            return not_accepted(
                ".frame_hex",
                format!(
                    "one sound report of `{name}`; it holds {reports} sound and {corrupt} garbled \
                        ones"
                ),
            );
        }
        let said = codec.newest().readings;
        if let Some(given) = &check.readings
            && said
                .iter()
                .zip(given)
                .any(|(said, given)| (said - given).abs() > READ_ALIKE * given.abs().max(1.0))
        {
            return disagrees(".readings", format!("the frame says {:?}", &said[..given.len()]));
        }
        readings = said;
    }
    let Some(solved) =
        real.kinematics.solve(&real.transmission.angles(&readings), &Configuration::default())
    else {
        return disagrees(
            "",
            "the arm cannot be where the readings put it: geometry, signs or offsets are wrong"
                .to_owned(),
        );
    };
    let found = solved.native_from_grip.translation;
    let away_m = found.distance(check.position_native);
    if away_m <= check.tolerance_m {
        return None;
    }
    let [x, y, z] = (found * 1e3).to_array();
    let away_mm = away_m * 1e3;
    disagrees(
        ".position_mm",
        format!(
            "the readings give ({x:.4}, {y:.4}, {z:.4}) mm, {away_mm:.4} mm away: geometry, signs, \
                offsets or this position are wrong"
        ),
    )
}

/// The readings without which the position is not known: those of a passive wrist and of a gripper
/// may be left out.
fn readings_needed(real: &RealArm) -> usize {
    let n = match real.kinematics {
        Kinematics::Capstan(_) | Kinematics::FiveLink(_) => 3,
        _ => real.kinematics.n_joints(),
    };
    let sensors = real.transmission.joints.iter().take(n).filter_map(|joint| joint.sensor);
    sensors.map(|sensor| sensor.reading_idx + 1).max().unwrap_or(0)
}
