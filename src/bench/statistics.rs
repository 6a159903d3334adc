//! Medians and slopes.

/// The middle value, the mean of the two middle ones for an even number; `None` for nothing.
pub(super) fn median(values: &[f64]) -> Option<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let (low, high) = (sorted.get(sorted.len().checked_sub(1)? / 2)?, sorted.get(sorted.len() / 2)?);
    Some(0.5 * (low + high))
}

/// Exponent p of the least-squares fit y ∝ xᵖ; `None` for fewer than two different x, or where a number is not positive.
pub(super) fn growth_exponent(points: &[(f64, f64)]) -> Option<f64> {
    if points.iter().any(|(x, y)| !(*x > 0.0 && *y > 0.0)) {
        return None;
    }
    let n = points.len() as f64;
    let logs: Vec<(f64, f64)> = points.iter().map(|(x, y)| (x.ln(), y.ln())).collect();
    let (mean_x, mean_y) = (logs.iter().map(|p| p.0).sum::<f64>() / n, logs.iter().map(|p| p.1).sum::<f64>() / n);
    let along: f64 = logs.iter().map(|(x, y)| (x - mean_x) * (y - mean_y)).sum();
    let spread: f64 = logs.iter().map(|(x, _)| (x - mean_x).powi(2)).sum();
    (spread > 0.0).then(|| along / spread)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn medians_and_exponents() {
        assert_eq!(median(&[]), None);
        assert_eq!(median(&[3.0, 1.0, 2.0]), Some(2.0));
        assert_eq!(median(&[4.0, 1.0, 2.0, 9.0]), Some(3.0));
        let squares: Vec<(f64, f64)> = (1..6).map(|x| (f64::from(x), 0.3 * f64::from(x * x))).collect();
        assert!((growth_exponent(&squares).unwrap() - 2.0).abs() < 1e-12);
        assert_eq!(growth_exponent(&[(1.0, 2.0)]), None);
        assert_eq!(growth_exponent(&[(1.0, 2.0), (2.0, 0.0)]), None);
    }
}
