//! Weighted least squares in 27 unknowns, without allocation.

use super::spline::Cube;

/// Unknowns, and the right-hand side as one column more.
const COLUMNS: usize = 28;

/// Normal equations, upper half: Σ w φ φᵀ and Σ w φ d.
pub(super) struct NormalEquations {
    rows: [[f64; COLUMNS]; 27],
}

impl NormalEquations {
    /// No constraint, and a ridge that pulls every unknown to zero: with ridges greater than zero there is always one solution.
    pub(super) fn new(ridge: &Cube) -> Self {
        let mut rows = [[0.0; COLUMNS]; 27];
        for (k, row) in rows.iter_mut().enumerate() {
            row[k] = ridge[k];
        }
        Self { rows }
    }

    /// One more constraint: Σ unknown · factor = value.
    #[inline]
    pub(super) fn add(&mut self, factors: &Cube, value: f64, weight: f64) {
        let mut columns = [0.0; COLUMNS];
        columns[..27].copy_from_slice(factors);
        columns[27] = value;
        for (k, row) in self.rows.iter_mut().enumerate() {
            let factor = weight * factors[k];
            for (entry, column) in row[k..].iter_mut().zip(&columns[k..]) {
                *entry += factor * column;
            }
        }
    }

    /// The unknowns, by elimination without pivots (L D Lᵀ); the right-hand side goes along as the last column.
    pub(super) fn solve(mut self) -> Cube {
        for k in 0..27 {
            let (done, rest) = self.rows.split_at_mut(k + 1);
            let pivot = &done[k];
            let inverse = 1.0 / pivot[k];
            for (i, row) in rest.iter_mut().enumerate().map(|(i, row)| (k + 1 + i, row)) {
                let factor = pivot[i] * inverse;
                for (entry, above) in row[i..].iter_mut().zip(&pivot[i..]) {
                    *entry -= factor * above;
                }
            }
        }
        let mut unknowns = [0.0; 27];
        for k in (0..27).rev() {
            let row = &self.rows[k];
            let known: f64 = (k + 1..27).map(|j| row[j] * unknowns[j]).sum();
            unknowns[k] = (row[27] - known) / row[k];
        }
        unknowns
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unknowns_that_fulfil_every_constraint_are_found() {
        let wanted: Cube = std::array::from_fn(|k| (k as f64 * 1.7).cos());
        let mut equations = NormalEquations::new(&[1e-12; 27]);
        let mut bits = 1_u64;
        for _ in 0..60 {
            let factors: Cube = std::array::from_fn(|_| {
                bits = bits.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (bits >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
            });
            let value = factors.iter().zip(wanted).map(|(a, b)| a * b).sum();
            equations.add(&factors, value, 0.5);
        }
        for (found, wanted) in equations.solve().iter().zip(wanted) {
            assert!((found - wanted).abs() < 1e-9, "{found} {wanted}");
        }
    }

    #[test]
    fn without_constraints_the_ridge_decides() {
        assert_eq!(NormalEquations::new(&[1e-9; 27]).solve(), [0.0; 27]);
    }
}
