//! The stiffness of contact: written for each volume that overlaps, which belongs to the pair of
//! materials, and computed with for each point of the tool, which stands for s² of its surface (s:
//! its voxel edge).

use super::super::scene::StiffnessKey;
use super::super::schema;
use super::forces::{StiffnessUnits, TRANSLATION_UNITS};
use super::{MM, Resolve};
use document::{POSITIVE, ProblemKind, round_down};
use engine::arm_rules::StabilityBounds;

/// Contact modulus of a scene that does not write one.
pub(in crate::config) const DEFAULT_CONTACT_N_PER_MM3: f64 = 20.0;
/// The stiffest point that there is, whichever key gives it.
const MOST_N_PER_MM: f64 = 1e6;
/// Stands for the voxel edge of a tool that has none, which is a problem of its own.
const ANY_VOXEL_MM: f64 = 0.5;

const OF_VOLUME: &str = "contact.stiffness_n_per_mm3";
const OF_POINT: &str = "contact.stiffness_n_per_mm";

/// What one point has: SI, and how it was written.
pub(super) struct PointStiffness {
    pub(super) n_per_m: f64,
    pub(super) key: StiffnessKey,
}

impl Resolve<'_> {
    /// `bound`: of the arm, where it feels each point.
    pub(super) fn point_stiffness(
        &mut self,
        written: &schema::Contact,
        tool: Option<&schema::Tool>,
        bound: Option<&StabilityBounds>,
        scale: f64,
    ) -> PointStiffness {
        let voxel_mm = tool
            .and_then(|tool| tool.voxel_size_mm)
            .filter(|mm| mm.is_finite() && *mm > 0.0)
            .unwrap_or(ANY_VOXEL_MM);
        let of_volume = written
            .stiffness_n_per_mm3
            .and_then(|n_per_mm3| self.modulus(n_per_mm3, voxel_mm))
            .map(|n_per_mm3| of_point(n_per_mm3, voxel_mm) / MM);
        let range = POSITIVE.to(MOST_N_PER_MM).unit("N/mm");
        let old = self.checks.optional(OF_POINT, written.stiffness_n_per_mm, range);
        if written.stiffness_n_per_mm3.is_some() && written.stiffness_n_per_mm.is_some() {
            self.checks.refuse(OF_POINT, ProblemKind::Exclusive { other: OF_VOLUME.into() });
        }
        let (key, units) = match old {
            Some(_) => (OF_POINT, TRANSLATION_UNITS),
            None => (OF_VOLUME, units_of_volume(voxel_mm)),
        };
        let n_per_m = old.map(|n_per_mm| n_per_mm / MM).or(of_volume).unwrap_or_else(|| {
            let default = of_point(DEFAULT_CONTACT_N_PER_MM3, voxel_mm).min(MOST_N_PER_MM) / MM;
            bound.map_or(default, |bound| default.min(bound.translation.value() / scale))
        });
        if let Some(bound) = bound {
            self.bounded(key, n_per_m, &bound.translation, units, scale);
        }
        let key = match old {
            Some(n_per_mm) => {
                StiffnessKey::OfPoint { n_per_mm3: modulus_of_point(n_per_mm, voxel_mm) }
            }
            None => StiffnessKey::OfVolume,
        };
        PointStiffness { n_per_m, key }
    }

    /// A contact modulus that a point of the tool can have.
    fn modulus(&mut self, n_per_mm3: f64, voxel_mm: f64) -> Option<f64> {
        let n_per_mm3 = self.checks.optional(OF_VOLUME, Some(n_per_mm3), POSITIVE.unit("N/mm³"))?;
        let n_per_mm = of_point(n_per_mm3, voxel_mm);
        if n_per_mm > 0.0 && n_per_mm <= MOST_N_PER_MM {
            return Some(n_per_mm3);
        }
        let most = round_down(MOST_N_PER_MM / voxel_mm / voxel_mm);
        self.checks.not_accepted(
            OF_VOLUME,
            format_args!(
                "greater than 0 and at most {most} N/mm³: times the square of the tool's \
                    voxel_size_mm = {voxel_mm} it is at most {MOST_N_PER_MM} N/mm"
            ),
        );
        None
    }
}

/// N/mm of a point. In this order moduli such as 125 N/mm³ at 0.4 mm come to whole numbers.
fn of_point(n_per_mm3: f64, voxel_mm: f64) -> f64 {
    n_per_mm3 * voxel_mm * voxel_mm
}

/// The shortest contact modulus that gives a point this stiffness, to the bit where there is one,
/// so that a scene that writes it instead feels and records the same.
fn modulus_of_point(n_per_mm: f64, voxel_mm: f64) -> f64 {
    let quotient = n_per_mm / voxel_mm / voxel_mm;
    let rounded =
        (0..17).filter_map(|n_digits| format!("{quotient:.n_digits$e}").parse::<f64>().ok());
    // Two divisions are off by more than one step at times.
    let near = [quotient.next_down(), quotient.next_up()];
    rounded
        .chain(near)
        .find(|n_per_mm3| of_point(*n_per_mm3, voxel_mm) == n_per_mm)
        .unwrap_or(quotient)
}

/// N/mm³ of a point's N/m.
fn units_of_volume(voxel_mm: f64) -> StiffnessUnits {
    StiffnessUnits { key: "N/mm³", key_per_si: MM / voxel_mm / voxel_mm, ..TRANSLATION_UNITS }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn moduli_of_shipped_scenes_give_their_points_whole_numbers() {
        for (n_per_mm3, voxel_mm, n_per_mm) in
            [(20.0, 0.5, 5.0), (125.0, 0.4, 20.0), (2.222222222222222, 1.5, 5.0), (4.0, 0.5, 1.0)]
        {
            assert_eq!(of_point(n_per_mm3, voxel_mm), n_per_mm);
            assert_eq!(modulus_of_point(n_per_mm, voxel_mm), n_per_mm3);
        }
    }

    proptest! {
        #[test]
        fn the_suggested_modulus_gives_the_same_stiffness(
            log_voxel in -2.0..3.0f64,
            log_stiffness in -6.0..6.0f64,
        ) {
            let [voxel_mm, n_per_mm] = [log_voxel, log_stiffness].map(|log| 10f64.powf(log));
            // As the hint prints it.
            let line = format!("{:?}", modulus_of_point(n_per_mm, voxel_mm));
            let again = of_point(line.parse().expect("a number"), voxel_mm);
            prop_assert!((again / n_per_mm - 1.0).abs() <= 1e-15 * 2.0, "{line}: {again}, {n_per_mm}");
        }
    }
}
