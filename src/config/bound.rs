//! How a bound of the stiffness reads.

use document::show;
use engine::arm_rules::StiffnessBound;
use haptics::stability::SampledWall;

/// The rule with its numbers: `min(0.8 b / (T/2 + delay), declared 4000) with b = 7.5, T = 1 ms,
/// delay = 1 tick`.
pub(super) fn rule(bound: &StiffnessBound) -> String {
    let Some(declared) = bound.declared else { return "none".to_owned() };
    let SampledWall { damping_n_s_per_m, period_s, delay_ticks, .. } = bound.wall;
    let ticks = if delay_ticks == 1 { "tick" } else { "ticks" };
    let mut rule = format!(
        "min(0.8 b / (T/2 + delay), declared {declared}) with b = {}, T = {} ms, delay = \
            {delay_ticks} {ticks}",
        show(damping_n_s_per_m),
        show(period_s * 1e3),
    );
    let filter_lag_s = bound.wall.filter_lag_s();
    if filter_lag_s > 0.0 {
        rule += &format!(" + {} ms of filter", show(filter_lag_s * 1e3));
    }
    rule
}
