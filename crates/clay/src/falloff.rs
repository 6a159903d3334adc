//! How a tool's force spreads over the mass points around it.

use std::fmt;

/// Weight of a mass point by its distance from the tool. Guo2004, rope tool: Gaussian, constant,
/// spherical, or any other distribution.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Falloff {
    /// exp(−(3ρ)²/2): three standard deviations at the rim.
    #[default]
    Gaussian,
    /// 1 up to the rim.
    Constant,
    /// √(1 − ρ²): the height of a half sphere.
    Spherical,
    /// 1 − ρ^f, with the fall-off rate f of Guo2004's painting tool: 1 a cone, above it a broader
    /// brush with a steeper rim, below it a finer one.
    Rate(f64),
    /// Weights at even steps of ρ from the middle to the rim, at least two; straight lines between
    /// them.
    Table(Vec<f64>),
}

/// Why a table of weights cannot be used.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum FalloffError {
    /// Nothing to interpolate between.
    #[error(
        "a table of a fall-off needs at least 2 weights, from the middle to the rim; this one has \
            {0}"
    )]
    TooShort(usize),
    /// Not a weight.
    #[error("weight {number} of the fall-off is {weight}; weights are numbers from 0 to 1")]
    OutOfRange {
        /// Counted from 1.
        number: usize,
        /// What it is.
        weight: f64,
    },
    /// No rate.
    #[error("the rate of a fall-off is {0}; a rate is a number from {least} to {most}", least = RATES.start(), most = RATES.end())]
    Rate(f64),
    /// Nothing would move.
    #[error("all weights of the fall-off are 0; nothing would move")]
    AllZero,
}

/// Rates f of 1 − ρ^f: from a point with a wide foot to a rim as sharp as that of a constant brush.
const RATES: std::ops::RangeInclusive<f64> = 0.1..=100.0;

impl Falloff {
    /// A fall-off with a rate f: 1 − ρ^f.
    ///
    /// # Errors
    /// [`FalloffError::Rate`] where it is not a number from 0.1 to 100.
    pub fn rate(rate: f64) -> Result<Self, FalloffError> {
        if RATES.contains(&rate) { Ok(Self::Rate(rate)) } else { Err(FalloffError::Rate(rate)) }
    }

    /// A fall-off of the user's own: weights at even steps from the middle to the rim.
    ///
    /// # Errors
    /// [`FalloffError`] where the weights are fewer than two, outside 0 to 1, or all 0.
    pub fn table(weights: Vec<f64>) -> Result<Self, FalloffError> {
        if weights.len() < 2 {
            return Err(FalloffError::TooShort(weights.len()));
        }
        if let Some((n, weight)) =
            weights.iter().enumerate().find(|(_, weight)| !(0.0..=1.0).contains(*weight))
        {
            return Err(FalloffError::OutOfRange { number: n + 1, weight: *weight });
        }
        if weights.iter().all(|weight| *weight == 0.0) {
            return Err(FalloffError::AllZero);
        }
        Ok(Self::Table(weights))
    }

    /// Weight at a share ρ of the radius; 0 beyond the rim and where ρ is not a number.
    pub(super) fn weight(&self, rho: f64) -> f64 {
        if !(0.0..=1.0).contains(&rho) {
            return 0.0;
        }
        match self {
            Self::Gaussian => (-4.5 * rho * rho).exp(),
            Self::Constant => 1.0,
            Self::Spherical => (1.0 - rho * rho).sqrt(),
            Self::Rate(rate) => 1.0 - rho.powf(*rate),
            Self::Table(weights) => {
                let place = rho * (weights.len() - 1) as f64;
                let low = (place as usize).min(weights.len() - 2);
                weights[low] + (weights[low + 1] - weights[low]) * (place - low as f64)
            }
        }
    }
}

impl fmt::Display for Falloff {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Gaussian => "gaussian",
            Self::Constant => "constant",
            Self::Spherical => "spherical",
            Self::Rate(_) => "rate",
            Self::Table(_) => "table",
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_fall_off_is_heaviest_in_the_middle_and_nothing_beyond_the_rim() {
        let own = [
            Falloff::table(vec![1.0, 0.5, 0.0]).unwrap(),
            Falloff::rate(0.5).unwrap(),
            Falloff::rate(7.0).unwrap(),
        ];
        for falloff in
            [Falloff::Gaussian, Falloff::Constant, Falloff::Spherical].into_iter().chain(own)
        {
            assert_eq!(falloff.weight(0.0), 1.0, "{falloff}");
            assert!(
                (0..100).all(|n| falloff.weight(f64::from(n) / 100.0)
                    >= falloff.weight(f64::from(n + 1) / 100.0)),
                "{falloff}"
            );
            assert_eq!(falloff.weight(1.0 + 1e-9), 0.0, "{falloff}");
            assert_eq!(falloff.weight(f64::NAN), 0.0, "{falloff}");
        }
    }

    #[test]
    fn a_table_is_interpolated() {
        let ring = Falloff::table(vec![0.0, 1.0, 0.5]).unwrap();
        for (rho, weight) in [(0.0, 0.0), (0.25, 0.5), (0.5, 1.0), (0.75, 0.75), (1.0, 0.5)] {
            assert!((ring.weight(rho) - weight).abs() < 1e-12, "{rho}");
        }
    }

    #[test]
    fn a_rate_is_the_power_of_the_distance() {
        for (rate, rho, weight) in
            [(1.0, 0.3, 0.7), (2.0, 0.5, 0.75), (0.5, 0.25, 0.5), (3.0, 1.0, 0.0)]
        {
            assert!((Falloff::rate(rate).unwrap().weight(rho) - weight).abs() < 1e-12, "{rate}");
        }
        for refused in [0.0, -1.0, 1e3, f64::NAN] {
            assert!(Falloff::rate(refused).unwrap_err().to_string().contains("from 0.1 to 100"));
        }
    }

    #[test]
    fn a_table_that_says_nothing_is_refused() {
        assert_eq!(Falloff::table(vec![1.0]), Err(FalloffError::TooShort(1)));
        assert_eq!(
            Falloff::table(vec![1.0, -0.1]),
            Err(FalloffError::OutOfRange { number: 2, weight: -0.1 })
        );
        assert!(Falloff::table(vec![f64::NAN, 1.0]).is_err());
        assert_eq!(Falloff::table(vec![0.0, 0.0]), Err(FalloffError::AllZero));
    }
}
