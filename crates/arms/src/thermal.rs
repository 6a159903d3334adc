//! Heat of the motors, from their commands: the I²t model, for arms without a sensor.
//!
//! A motor that may carry its continuous command for ever takes T = (I / I_c)² as its final
//! temperature rise, in units of the allowed one, and comes there with its time constant: θ' =
//! ((I/I_c)² − θ) / τ. At θ = 1 it is too hot.

use crate::axes::MAX_AXES;

/// Below this share of the allowed rise a motor that was too hot may be used again.
const COOLED: f64 = 0.9;

/// Heat of every motor. RT: safe.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Thermal {
    /// Command that each motor carries for ever, units of the wire; 0: no model for this motor.
    continuous_units: [f64; MAX_AXES],
    /// Time constant, s.
    time_constant_s: f64,
    /// Share of the allowed temperature rise.
    heat: [f64; MAX_AXES],
    overheated: bool,
}

impl Thermal {
    /// Cold motors. A motor whose continuous command is 0 has no model.
    pub(crate) fn new(continuous_units: [f64; MAX_AXES], time_constant_s: f64) -> Self {
        Self { continuous_units, time_constant_s, heat: [0.0; MAX_AXES], overheated: false }
    }

    /// One tick of `period_s` with these commands; true while a motor is too hot.
    pub(crate) fn advance(&mut self, commands: &[f64; MAX_AXES], period_s: f64) -> bool {
        let mut hottest = 0.0_f64;
        for ((heat, continuous), command) in
            self.heat.iter_mut().zip(self.continuous_units).zip(commands)
        {
            if continuous > 0.0 && self.time_constant_s > 0.0 {
                let load = command / continuous;
                *heat += (load * load - *heat) * (1.0 - (-period_s / self.time_constant_s).exp());
                hottest = hottest.max(*heat);
            }
        }
        self.overheated = hottest >= if self.overheated { COOLED } else { 1.0 };
        self.overheated
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD_S: f64 = 1e-3;

    /// Seconds until the model says too hot at a constant command; `None` within ten minutes.
    fn seconds_until_hot(thermal: &mut Thermal, command: f64) -> Option<f64> {
        let mut commands = [0.0; MAX_AXES];
        commands[1] = -command;
        (1..600_000).find(|_| thermal.advance(&commands, PERIOD_S)).map(|n| f64::from(n) * PERIOD_S)
    }

    #[test]
    fn twice_the_continuous_command_lasts_as_the_closed_form_says() {
        let mut thermal = Thermal::new([1000.0; MAX_AXES], 30.0);
        let hot_s = seconds_until_hot(&mut thermal, 2000.0).expect("hot");
        // θ(t) = 4 (1 − e^(−t/τ)) = 1
        let expected_s = -30.0 * (0.75_f64).ln();
        assert!((hot_s - expected_s).abs() < 0.01, "{hot_s} {expected_s}");
        assert!(thermal.advance(&[0.0; MAX_AXES], PERIOD_S), "stays hot until it has cooled");
        let cooled =
            (0..30_000).position(|_| !thermal.advance(&[0.0; MAX_AXES], PERIOD_S)).expect("cools");
        assert!(
            (f64::from(cooled as u32) * PERIOD_S - 30.0 * (1.0_f64 / COOLED).ln()).abs() < 0.01
        );
    }

    #[test]
    fn the_continuous_command_and_motors_without_a_model_stay_cold() {
        assert_eq!(seconds_until_hot(&mut Thermal::new([1000.0; MAX_AXES], 30.0), 999.0), None);
        assert_eq!(seconds_until_hot(&mut Thermal::default(), 1e6), None);
    }
}
