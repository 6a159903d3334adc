//! Metric screw threads, right-handed, as triangles.
//!
//! Profile after ISO 68-1 with H = (√3/2) P: crest flat P/8 at d/2, root flat P/4 at d/2 − 5H/8,
//! flanks 30° from the normal of the axis. A crest passes through angle 0 at z = 0.
//!
//! The rows of the mesh climb with the thread and run along the corners of the profile, so the
//! profile is exact in every column. One column step climbs P/96, and everything along z is counted
//! in that unit. Rows are cut off at both ends by clamping; what clamping collapses, welding
//! removes, and flat ends remain.

use std::f64::consts::TAU;

use glam::DVec3;

use crate::loft::Ring;
use crate::mesh::Mesh;

/// Pitch P, mm.
pub(crate) const PITCH_MM: f64 = 2.0;
/// Nominal radius d/2, mm.
pub(crate) const MAJOR_RADIUS_MM: f64 = 8.0;
/// Columns around, and units per pitch.
pub(crate) const N_COLUMNS: usize = 96;
/// Units per millimetre along z.
pub(crate) const UNITS_PER_MM: i64 = 48;
/// Rows of one turn, units from the middle of the crest: the corners of the profile and the middles
/// of the flanks.
const ROWS: [i64; 6] = [-36, -21, -6, 6, 21, 36];

/// Depth of the profile 5H/8, mm.
pub(crate) fn depth_mm() -> f64 {
    0.625 * 0.75_f64.sqrt() * PITCH_MM
}

/// Radius of the basic profile at the distance `axial_mm` along the axis from the middle of a
/// crest, mm.
pub(crate) fn profile_mm(axial_mm: f64) -> f64 {
    let from_crest_mm = (axial_mm - PITCH_MM * (axial_mm / PITCH_MM).round()).abs();
    let drop_mm = (from_crest_mm - PITCH_MM / 16.0) * 3.0_f64.sqrt();
    MAJOR_RADIUS_MM - drop_mm.clamp(0.0, depth_mm())
}

/// Radius of the basic thread surface at `angle` (rad) and height `z_mm`, mm.
#[cfg(test)]
pub(crate) fn basic_radius_mm(angle: f64, z_mm: f64) -> f64 {
    profile_mm(z_mm - PITCH_MM * angle / TAU)
}

/// A threaded surface between two heights.
pub(crate) struct Thread<F> {
    /// Lower and upper end, units.
    pub(crate) ends: [i64; 2],
    /// From the radius of the basic profile and z, both mm, to the radius wanted there: clearance,
    /// chamfers.
    pub(crate) shape: F,
}

impl<F: Fn(f64, f64) -> f64> Thread<F> {
    fn point(&self, column: usize, units: i64) -> DVec3 {
        let column = column % N_COLUMNS;
        let z_mm = units as f64 / UNITS_PER_MM as f64;
        let basic_mm = profile_mm((units - column as i64) as f64 / UNITS_PER_MM as f64);
        let radius_mm = (self.shape)(basic_mm, z_mm);
        let angle = TAU * column as f64 / N_COLUMNS as f64;
        DVec3::new(radius_mm * angle.cos(), radius_mm * angle.sin(), z_mm)
    }

    /// The loop at the height `units`.
    pub(crate) fn ring(&self, units: i64) -> Ring {
        (0..N_COLUMNS).map(|column| self.point(column, units)).collect()
    }

    /// Adds the surface; `internal` faces the axis.
    pub(crate) fn build(&self, mesh: &mut Mesh, internal: bool) {
        let units_per_turn = N_COLUMNS as i64;
        let [low, high] = self.ends;
        // One turn more at both ends: every column reaches both ends.
        let turns = low.div_euclid(units_per_turn) - 2..=high.div_euclid(units_per_turn) + 2;
        let rows: Vec<i64> =
            turns.flat_map(|turn| ROWS.map(|row| turn * units_per_turn + row)).collect();
        for (lower, upper) in rows.iter().zip(&rows[1..]) {
            for column in 0..N_COLUMNS {
                let corner = |row: i64, column: usize| {
                    self.point(column, (row + column as i64).clamp(low, high))
                };
                let mut corners = [
                    corner(*lower, column),
                    corner(*lower, column + 1),
                    corner(*upper, column + 1),
                    corner(*upper, column),
                ];
                if internal {
                    corners.reverse();
                }
                mesh.quad(corners);
            }
        }
    }
}
