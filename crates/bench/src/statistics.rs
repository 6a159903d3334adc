//! Medians, slopes and spreads.

/// The middle value, the mean of the two middle ones for an even number; `None` for nothing.
pub(super) fn median(values: &[f64]) -> Option<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let low = sorted.get(sorted.len().checked_sub(1)? / 2)?;
    let high = sorted.get(sorted.len() / 2)?;
    Some(0.5 * (low + high))
}

/// Exponent p of the least-squares fit y ∝ xᵖ; `None` for fewer than two different x, or where a
/// number is not positive.
pub(super) fn growth_exponent(points: &[(f64, f64)]) -> Option<f64> {
    if points.iter().any(|(x, y)| !(*x > 0.0 && *y > 0.0)) {
        return None;
    }
    let n = points.len() as f64;
    let logs: Vec<(f64, f64)> = points.iter().map(|(x, y)| (x.ln(), y.ln())).collect();
    let mean_x = logs.iter().map(|p| p.0).sum::<f64>() / n;
    let mean_y = logs.iter().map(|p| p.1).sum::<f64>() / n;
    let along: f64 = logs.iter().map(|(x, y)| (x - mean_x) * (y - mean_y)).sum();
    let spread: f64 = logs.iter().map(|(x, _)| (x - mean_x).powi(2)).sum();
    (spread > 0.0).then(|| along / spread)
}

/// Mean, 99 % and largest of some values.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Spread {
    /// The arithmetic mean.
    pub mean: f64,
    /// 99 of 100 values are no larger.
    pub p99: f64,
    /// The largest.
    pub max: f64,
}

impl Spread {
    /// `None` for nothing.
    pub(super) fn of(values: impl Iterator<Item = f64>) -> Option<Self> {
        let mut sorted: Vec<f64> = values.collect();
        sorted.sort_by(f64::total_cmp);
        let max = *sorted.last()?;
        let p99 = quantile(&sorted, 0.99)?;
        Some(Self { mean: sorted.iter().sum::<f64>() / sorted.len() as f64, p99, max })
    }
}

/// The smallest of some sorted values that a share of them does not exceed; `None` for nothing.
pub(super) fn quantile(sorted: &[f64], share: f64) -> Option<f64> {
    let rank = (share * sorted.len() as f64).ceil() as usize;
    sorted.get(rank.clamp(1, sorted.len().max(1)) - 1).copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn medians_and_exponents() {
        assert_eq!(median(&[]), None);
        assert_eq!(median(&[3.0, 1.0, 2.0]), Some(2.0));
        assert_eq!(median(&[4.0, 1.0, 2.0, 9.0]), Some(3.0));
        let squares: Vec<(f64, f64)> =
            (1..6).map(|x| (f64::from(x), 0.3 * f64::from(x * x))).collect();
        assert!((growth_exponent(&squares).unwrap() - 2.0).abs() < 1e-12);
        assert_eq!(growth_exponent(&[(1.0, 2.0)]), None);
        assert_eq!(growth_exponent(&[(1.0, 2.0), (2.0, 0.0)]), None);
    }
    #[test]
    fn spreads_and_quantiles() {
        assert_eq!(Spread::of([].into_iter()), None);
        let spread = Spread::of((1..=200).rev().map(f64::from)).unwrap();
        assert_eq!(spread, Spread { mean: 100.5, p99: 198.0, max: 200.0 });
        assert_eq!(quantile(&[1.0, 2.0, 3.0], 0.5), Some(2.0));
        assert_eq!(
            (quantile(&[4.0], 0.0), quantile(&[4.0], 1.0), quantile(&[], 0.5)),
            (Some(4.0), Some(4.0), None)
        );
    }
}
