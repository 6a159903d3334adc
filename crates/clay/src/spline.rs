//! One cube of a trivariate quadratic B-spline: 3 × 3 × 3 coefficients.
//!
//! The parameter u of an axis runs from 0 to 1 over the cube. With uniform knots the three
//! functions that live there are (1 − u)²/2, (1 + 2u − 2u²)/2 and u²/2.
//!
//! # Source
//! Guo2004, equations 2 (the spline), 4 and 5 (coefficients from values on the grid of the cube).

use glam::DVec3;

/// Coefficients, or values at nodes, of a cube: place `9 i + 3 j + k` is number i along x, j along
/// y, k along z.
pub(super) type Cube = [f64; 27];

/// Parameters of the grid of a cube, along every axis.
pub(super) const GRID: [f64; 3] = [0.0, 0.5, 1.0];

/// Inverse of the basis at [`GRID`]: values at 0, 1/2, 1 → coefficients. The 27 × 27 matrix of
/// equation 5 is the Kronecker product of three of these, as the grid has as many values as the
/// spline has coefficients.
const FROM_GRID: [[f64; 3]; 3] = [[2.5, -2.0, 0.5], [-0.5, 2.0, -0.5], [0.5, -2.0, 2.5]];

/// The three functions at u.
#[inline]
pub(super) fn basis(u: f64) -> [f64; 3] {
    let v = 1.0 - u;
    [0.5 * v * v, 0.5 + u * v, 0.5 * u * u]
}

/// Their slopes.
#[inline]
fn slopes(u: f64) -> [f64; 3] {
    [u - 1.0, 1.0 - 2.0 * u, u]
}

/// Value at a parameter, and its slope along the three parameters.
#[inline]
pub(super) fn at(coefficients: &Cube, u: DVec3) -> (f64, DVec3) {
    let x = basis(u.x);
    let y = basis(u.y);
    let z = basis(u.z);
    let dx = slopes(u.x);
    let dy = slopes(u.y);
    let dz = slopes(u.z);
    let mut value = 0.0;
    let mut slope = DVec3::ZERO;
    for i in 0..3 {
        let mut plane = 0.0;
        let mut plane_y = 0.0;
        let mut plane_z = 0.0;
        for j in 0..3 {
            let row = &coefficients[9 * i + 3 * j..][..3];
            let line = row[0] * z[0] + row[1] * z[1] + row[2] * z[2];
            plane += y[j] * line;
            plane_y += dy[j] * line;
            plane_z += y[j] * (row[0] * dz[0] + row[1] * dz[1] + row[2] * dz[2]);
        }
        value += x[i] * plane;
        slope += DVec3::new(dx[i] * plane, x[i] * plane_y, x[i] * plane_z);
    }
    (value, slope)
}

/// The coefficients of the spline that has the given values at the nodes of [`GRID`]: equation 5.
pub(super) fn from_grid(values: &Cube) -> Cube {
    along_axes(values, &FROM_GRID)
}

/// Applies a matrix along each of the three axes.
pub(super) fn along_axes(cube: &Cube, matrix: &[[f64; 3]; 3]) -> Cube {
    let mut cube = *cube;
    for stride in [1, 3, 9] {
        let mut turned = [0.0; 27];
        for (place, value) in turned.iter_mut().enumerate() {
            let number = place / stride % 3;
            let first = place - number * stride;
            *value = (0..3).map(|k| matrix[number][k] * cube[first + k * stride]).sum();
        }
        cube = turned;
    }
    cube
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The matrix of equation 4: values on the grid from coefficients.
    fn kronecker() -> Vec<Vec<f64>> {
        let b = GRID.map(basis);
        let digit = |n: usize, axis: usize| n / [9, 3, 1][axis] % 3;
        let entry = |row: usize, column: usize| {
            (0..3).map(|axis| b[digit(row, axis)][digit(column, axis)]).product()
        };
        (0..27).map(|row| (0..27).map(|column| entry(row, column)).collect()).collect()
    }

    fn numbers() -> Cube {
        std::array::from_fn(|k| ((k * 37 % 27) as f64 - 13.0) * 0.3 + (k as f64).sin())
    }

    #[test]
    fn acceptance_28_the_matrix_of_the_grid_is_invertible_and_this_is_its_inverse() {
        let matrix = kronecker();
        let values = numbers();
        let coefficients = from_grid(&values);
        for (row, value) in matrix.iter().zip(values) {
            let again: f64 = row.iter().zip(coefficients).map(|(a, p)| a * p).sum();
            assert!((again - value).abs() < 1e-13, "{again} {value}");
        }
        // Every unit vector is reached, so the rank is 27.
        for k in 0..27 {
            let mut unit = [0.0; 27];
            unit[k] = 1.0;
            let column = from_grid(&unit);
            for (j, row) in matrix.iter().enumerate() {
                let product: f64 = row.iter().zip(column).map(|(a, b)| a * b).sum();
                assert!(
                    (product - f64::from(u8::from(j == k))).abs() < 1e-13,
                    "{j} {k}: {product}"
                );
            }
        }
    }

    #[test]
    fn values_and_slopes_agree_with_the_sum_and_with_differences() {
        let coefficients = numbers();
        for u in [DVec3::ZERO, DVec3::ONE, DVec3::new(0.2, 0.7, 0.45)] {
            let (value, slope) = at(&coefficients, u);
            let x = basis(u.x);
            let y = basis(u.y);
            let z = basis(u.z);
            let sum: f64 =
                (0..27).map(|k| coefficients[k] * x[k / 9] * y[k / 3 % 3] * z[k % 3]).sum();
            assert!((sum - value).abs() < 1e-13);
            for axis in 0..3 {
                let mut step = DVec3::ZERO;
                step[axis] = 1e-5;
                let difference =
                    (at(&coefficients, u + step).0 - at(&coefficients, u - step).0) / 2e-5;
                assert!((difference - slope[axis]).abs() < 1e-8, "{difference} {slope}");
            }
            assert!((x.iter().sum::<f64>() - 1.0).abs() < 1e-15);
        }
    }
}
