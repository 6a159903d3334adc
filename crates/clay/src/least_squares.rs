//! Weighted least squares over the 27 products of powers 0, 1, 2 of three coordinates, without
//! allocation.
//!
//! Place `9 i + 3 j + k` is the product xⁱ yʲ zᵏ. Every entry of the normal equations is a sum of
//! such products with powers up to 4: there are 125 of these, so they are summed, and the 27 × 27
//! entries taken from them in the end.

use glam::DVec3;

use super::spline::Cube;

/// Unknowns, and the right-hand side as one column more.
const COLUMNS: usize = 28;

/// Sums over constraints.
pub(super) struct Constraints {
    /// Σ w xⁱ yʲ zᵏ at `25 i + 5 j + k`.
    moments: [f64; 125],
    /// Σ w xⁱ yʲ zᵏ value at `9 i + 3 j + k`.
    values: Cube,
}

impl Constraints {
    /// None yet.
    pub(super) fn new() -> Self {
        Self { moments: [0.0; 125], values: [0.0; 27] }
    }

    /// One more: the polynomial has a value at a point.
    #[inline]
    pub(super) fn add(&mut self, point: DVec3, value: f64, weight: f64) {
        let powers = |c: f64| [1.0, c, c * c, c * c * c, c * c * c * c];
        let x = powers(point.x);
        let y = powers(point.y);
        let z = powers(point.z);
        for (plane, x) in self.moments.as_chunks_mut::<25>().0.iter_mut().zip(x) {
            let x = weight * x;
            for (row, y) in plane.as_chunks_mut::<5>().0.iter_mut().zip(y) {
                let xy = x * y;
                row.iter_mut().zip(z).for_each(|(sum, z)| *sum += xy * z);
            }
        }
        for (place, row) in self.values.as_chunks_mut::<3>().0.iter_mut().enumerate() {
            let xy = weight * value * x[place / 3] * y[place % 3];
            row.iter_mut().zip(z).for_each(|(sum, z)| *sum += xy * z);
        }
    }

    /// The coefficients with the least sum of squares; `ridge`, greater than 0, pulls each of them
    /// to zero, so there is one solution always. By elimination without pivots (L D Lᵀ), the
    /// right-hand side along as the last column.
    pub(super) fn solve(&self, ridge: &Cube) -> Cube {
        const PLACES: [usize; 27] = places();
        let mut rows = [[0.0; COLUMNS]; 27];
        for (k, row) in rows.iter_mut().enumerate() {
            for (entry, place) in row[k..27].iter_mut().zip(&PLACES[k..]) {
                // At most 4 + 20 + 100.
                *entry = self.moments[PLACES[k] + place];
            }
            row[k] += ridge[k];
            row[27] = self.values[k];
        }
        for k in 0..27 {
            let (done, rest) = rows.split_at_mut(k + 1);
            let pivot = &done[k];
            let inverse = 1.0 / pivot[k];
            for (i, row) in rest.iter_mut().enumerate().map(|(i, row)| (k + 1 + i, row)) {
                let factor = pivot[i] * inverse;
                row[i..]
                    .iter_mut()
                    .zip(&pivot[i..])
                    .for_each(|(entry, above)| *entry -= factor * above);
            }
        }
        let mut unknowns = [0.0; 27];
        for k in (0..27).rev() {
            let row = &rows[k];
            let known: f64 = row[k + 1..27]
                .iter()
                .zip(&unknowns[k + 1..])
                .map(|(entry, unknown)| entry * unknown)
                .sum();
            unknowns[k] = (row[27] - known) / row[k];
        }
        unknowns
    }
}

/// Where the product of each unknown is among the moments: places add up as powers do.
const fn places() -> [usize; 27] {
    let mut places = [0; 27];
    let mut k = 0;
    while k < 27 {
        places[k] = 25 * (k / 9) + 5 * (k / 3 % 3) + k % 3;
        k += 1;
    }
    places
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_polynomial_is_found_from_its_values() {
        let wanted: Cube = std::array::from_fn(|k| (k as f64 * 1.7).cos());
        let mut constraints = Constraints::new();
        for k in 0..125 {
            let point =
                DVec3::new(f64::from(k / 25), f64::from(k / 5 % 5), f64::from(k % 5)) * 0.5 - 1.0;
            let powers = |c: f64| [1.0, c, c * c];
            let x = powers(point.x);
            let y = powers(point.y);
            let z = powers(point.z);
            let value = (0..27).map(|k| wanted[k] * x[k / 9] * y[k / 3 % 3] * z[k % 3]).sum();
            constraints.add(point, value, 0.1 + f64::from(k % 7));
        }
        for (found, wanted) in constraints.solve(&[1e-12; 27]).iter().zip(wanted) {
            assert!((found - wanted).abs() < 1e-9, "{found} {wanted}");
        }
    }

    #[test]
    fn without_constraints_the_ridge_decides() {
        assert_eq!(Constraints::new().solve(&[1e-9; 27]), [0.0; 27]);
    }
}
