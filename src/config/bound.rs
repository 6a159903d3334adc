//! The largest stiffness that an arm may be made to feel: the stability rule of its sampled wall,
//! and what its maker declares.

use core::fmt;

use document::show;
use haptics::stability::SampledWall;

/// A bound on translational (N/m) or rotational (N·m/rad) stiffness felt by the arm, with the
/// numbers that gave it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StiffnessBound {
    /// One axis of the arm: its plant, period, delay, and the shaping filter where that lies in the
    /// loop. Virtual damping is not credited (decision: virtual damping).
    pub wall: SampledWall,
    /// The stiffness that the profile declares; `None`: the arm has no bound.
    pub declared: Option<f64>,
}

impl StiffnessBound {
    /// A bound that allows everything: for an ideal arm, and for axes that render nothing.
    pub(super) fn none(period_s: f64) -> Self {
        let wall = SampledWall {
            mass_kg: 1.0,
            damping_n_s_per_m: 0.0,
            wall_damping_n_s_per_m: 0.0,
            period_s,
            delay_ticks: 0,
            filter_alpha: 0.0,
        };
        Self { wall, declared: None }
    }

    /// The bound itself; infinite where none is declared.
    pub fn value(&self) -> f64 {
        let Some(declared) = self.declared else { return f64::INFINITY };
        let rule = self.wall.stiffness_bound();
        // A plant built to meet its declared stiffness exactly must not lose it to rounding.
        if rule > declared * (1.0 - 1e-9) { declared } else { rule }
    }

    /// True when a felt stiffness is within the bound, rounding aside.
    pub(super) fn admits(&self, felt_stiffness: f64) -> bool {
        felt_stiffness <= self.value() * (1.0 + 1e-9)
    }
}

/// The rule with its numbers: `min(0.8 b / (T/2 + delay), declared 4000) with b = 7.5, T = 1 ms,
/// delay = 1 tick`.
impl fmt::Display for StiffnessBound {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Some(declared) = self.declared else { return write!(f, "none") };
        let SampledWall { damping_n_s_per_m, period_s, delay_ticks, .. } = self.wall;
        let ticks = if delay_ticks == 1 { "tick" } else { "ticks" };
        write!(
            f,
            "min(0.8 b / (T/2 + delay), declared {declared}) with b = {}, T = {} ms, delay = \
                {delay_ticks} {ticks}",
            show(damping_n_s_per_m),
            show(period_s * 1e3),
        )?;
        let filter_lag_s = self.wall.filter_lag_s();
        if filter_lag_s > 0.0 {
            write!(f, " + {} ms of filter", show(filter_lag_s * 1e3))?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plant_built_for_its_declared_stiffness_keeps_it() {
        for declared in [0.3, 1.0, 400.0, 800.0, 2000.0, 4000.0] {
            let mut bound = StiffnessBound::none(1e-3);
            bound.wall.damping_n_s_per_m = 1.25 * declared * 1.5e-3;
            bound.wall.delay_ticks = 1;
            bound.declared = Some(declared);
            assert_eq!(bound.value(), declared);
            assert!(bound.admits(declared));
            assert!(!bound.admits(declared * 1.001));
        }
    }

    #[test]
    fn nothing_declared_means_no_bound() {
        assert_eq!(StiffnessBound::none(1e-3).value(), f64::INFINITY);
        assert!(StiffnessBound::none(1e-3).admits(1e12));
    }
}
