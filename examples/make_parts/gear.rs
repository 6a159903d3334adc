//! Outlines of involute spur gears.
//!
//! With base radius r_b, the flank at radius r ≥ r_b stands at the half-angle ψ(r) = s / (2 r_p) +
//! inv α − inv α_r from the middle of its tooth, where s is the tooth thickness on the pitch
//! circle, cos α_r = r_b / r and inv x = tan x − x. Below r_b, where nothing touches, a parabola
//! widens the tooth towards its root.

use std::f64::consts::PI;

use glam::DVec2;

/// A gear's defining numbers.
#[derive(Clone, Copy)]
pub(crate) struct Gear {
    /// Module, mm: pitch diameter per tooth.
    pub(crate) module_mm: f64,
    /// Number of teeth.
    pub(crate) n_teeth: usize,
    /// Pressure angle α, rad.
    pub(crate) pressure_angle: f64,
    /// How much thinner than half a pitch each tooth is on the pitch circle, mm: this gear's share
    /// of the backlash.
    pub(crate) thinning_mm: f64,
    /// Shortening of the addendum, mm.
    pub(crate) topping_mm: f64,
    /// Angle of the middle of tooth 0, rad.
    pub(crate) phase: f64,
}

/// Width that the fillet adds to each side of the tooth at the root circle, mm.
const FILLET_MM: f64 = 0.3;
/// Steps along a fillet and along a flank.
const N_FILLET: usize = 3;
const N_FLANK: usize = 6;
/// Points of one tooth.
pub(crate) const POINTS_PER_TOOTH: usize = 2 * (N_FILLET + N_FLANK) + 4;

impl Gear {
    pub(crate) fn pitch_radius_mm(&self) -> f64 {
        self.module_mm * self.n_teeth as f64 / 2.0
    }

    pub(crate) fn tip_radius_mm(&self) -> f64 {
        self.pitch_radius_mm() + self.module_mm - self.topping_mm
    }

    pub(crate) fn root_radius_mm(&self) -> f64 {
        self.pitch_radius_mm() - 1.25 * self.module_mm
    }

    /// The same gear with thinner and shorter teeth: the outline at the end of a chamfer.
    pub(crate) fn inset(&self, inset_mm: f64) -> Self {
        Self {
            thinning_mm: self.thinning_mm + 2.0 * inset_mm,
            topping_mm: self.topping_mm + inset_mm,
            ..*self
        }
    }

    /// Half of the angle that a tooth fills at `radius_mm`.
    pub(crate) fn half_angle(&self, radius_mm: f64) -> f64 {
        let involute = |angle: f64| angle.tan() - angle;
        let pitch_mm = self.pitch_radius_mm();
        let root_mm = self.root_radius_mm();
        let base_mm = pitch_mm * self.pressure_angle.cos();
        let thickness_mm = PI * self.module_mm / 2.0 - self.thinning_mm;
        let at_base = thickness_mm / (2.0 * pitch_mm) + involute(self.pressure_angle);
        if radius_mm >= base_mm {
            at_base - involute((base_mm / radius_mm).acos())
        } else {
            let depth = (base_mm - radius_mm) / (base_mm - root_mm);
            at_base + FILLET_MM / root_mm * depth * depth
        }
    }

    /// The outline, counter-clockwise, at strictly increasing angles: [`POINTS_PER_TOOTH`] points
    /// per tooth.
    pub(crate) fn outline(&self) -> Vec<DVec2> {
        let root_mm = self.root_radius_mm();
        let tip_mm = self.tip_radius_mm();
        let base_mm = self.pitch_radius_mm() * self.pressure_angle.cos();
        assert!(
            root_mm < base_mm && base_mm < tip_mm,
            "fewer than 42 teeth: the base circle lies above the root circle"
        );
        let mut radii: Vec<f64> = (0..N_FILLET)
            .map(|step| root_mm + (base_mm - root_mm) * step as f64 / N_FILLET as f64)
            .collect();
        radii.extend(
            (0..=N_FLANK).map(|step| base_mm + (tip_mm - base_mm) * step as f64 / N_FLANK as f64),
        );
        let pitch_angle = 2.0 * PI / self.n_teeth as f64;

        let mut points = Vec::with_capacity(self.n_teeth * POINTS_PER_TOOTH);
        for tooth in 0..self.n_teeth {
            let middle = self.phase + pitch_angle * tooth as f64;
            let mut push = |radius_mm: f64, angle: f64| {
                points.push(DVec2::from_angle(middle + angle) * radius_mm)
            };
            push(root_mm, -pitch_angle / 2.0);
            radii.iter().for_each(|radius_mm| push(*radius_mm, -self.half_angle(*radius_mm)));
            push(tip_mm, 0.0);
            radii.iter().rev().for_each(|radius_mm| push(*radius_mm, self.half_angle(*radius_mm)));
        }
        points
    }
}
