//! Dense 6×6 matrices and their solve: small enough for the tick.

use super::Wrench;
use glam::{DMat3, DVec3};

/// A 6×6 matrix, row-major; rows and columns in the order linear x y z, angular x y z.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mat6(pub [[f64; 6]; 6]);

impl Mat6 {
    /// All zero.
    pub const ZERO: Self = Self([[0.0; 6]; 6]);

    /// Adds `scale · w wᵀ` with w = (linear, angular): the stiffness of one contact seen at the
    /// reduction point.
    #[inline]
    pub fn add_outer(&mut self, scale: f64, linear: DVec3, angular: DVec3) {
        let w = [linear.x, linear.y, linear.z, angular.x, angular.y, angular.z];
        for (row, wi) in self.0.iter_mut().zip(w) {
            for (entry, wj) in row.iter_mut().zip(w) {
                *entry += scale * wi * wj;
            }
        }
    }

    /// `self + scale · other`.
    #[must_use]
    pub fn plus_scaled(mut self, scale: f64, other: &Self) -> Self {
        for (row, other_row) in self.0.iter_mut().zip(&other.0) {
            for (entry, other_entry) in row.iter_mut().zip(other_row) {
                *entry += scale * other_entry;
            }
        }
        self
    }

    /// A matrix from its four 3×3 blocks: linear-linear, linear-angular, angular-linear,
    /// angular-angular.
    pub fn from_blocks(ll: DMat3, la: DMat3, al: DMat3, aa: DMat3) -> Self {
        let mut matrix = Self::ZERO;
        for row in 0..3 {
            for column in 0..3 {
                matrix.0[row][column] = ll.col(column)[row];
                matrix.0[row][column + 3] = la.col(column)[row];
                matrix.0[row + 3][column] = al.col(column)[row];
                matrix.0[row + 3][column + 3] = aa.col(column)[row];
            }
        }
        matrix
    }

    /// The 3×3 block whose first entry is at (`row`, `column`), each 0 or 3.
    fn block(&self, row: usize, column: usize) -> DMat3 {
        DMat3::from_cols_array_2d(&core::array::from_fn(|j| {
            core::array::from_fn(|i| self.0[row + i][column + j])
        }))
    }

    /// The same matrix seen in turned axes: R A Rᵀ on each block.
    #[must_use]
    pub fn rotated(&self, rotation: DMat3) -> Self {
        let turned = |row, column| rotation * self.block(row, column) * rotation.transpose();
        Self::from_blocks(turned(0, 0), turned(0, 3), turned(3, 0), turned(3, 3))
    }

    /// The second derivative of an energy by translations and rotation vectors about `from_point`,
    /// where minus its first one is `wrench`, as that by turns about another point: `to_point` goes
    /// along with the body, and a turn about it moves `from_point` to second order as well.
    #[must_use]
    pub fn moved(&self, wrench: Wrench, from_point: DVec3, to_point: DVec3) -> Self {
        let arm = from_point - to_point;
        // θ × arm = carried θ.
        let carried =
            DMat3::from_cols(arm.cross(DVec3::X), arm.cross(DVec3::Y), arm.cross(DVec3::Z)) * -1.0;
        let [ll, la, al, aa] =
            [(0, 0), (0, 3), (3, 0), (3, 3)].map(|(row, column)| self.block(row, column));
        let pull = outer(wrench.force, arm);
        let second = DMat3::from_diagonal(DVec3::splat(wrench.force.dot(arm)))
            - (pull + pull.transpose()) * 0.5;
        Self::from_blocks(
            ll,
            ll * carried + la,
            carried.transpose() * ll + al,
            carried.transpose() * (ll * carried + la) + al * carried + aa + second,
        )
    }

    /// Upper bounds of the largest eigenvalues of the linear and of the angular block of a positive
    /// semi-definite matrix: trace or largest absolute row sum, whichever is less. Exact for one
    /// direction along an axis or for any single direction, at most √3 of it for all three alike.
    pub fn bounds(&self) -> (f64, f64) {
        let bound = |first: usize| {
            let rows = || self.0[first..first + 3].iter().map(|row| &row[first..first + 3]);
            let trace: f64 = rows().enumerate().map(|(n, row)| row[n]).sum();
            rows().map(|row| row.iter().map(|a| a.abs()).sum()).fold(0.0, f64::max).min(trace)
        };
        (bound(0), bound(3))
    }

    /// Sum of the diagonal of the linear block and of the angular block.
    pub fn traces(&self) -> (f64, f64) {
        let a = &self.0;
        (a[0][0] + a[1][1] + a[2][2], a[3][3] + a[4][4] + a[5][5])
    }

    /// Matrix times the stacked vector (linear, angular).
    pub fn mul(&self, linear: DVec3, angular: DVec3) -> (DVec3, DVec3) {
        let x = [linear.x, linear.y, linear.z, angular.x, angular.y, angular.z];
        let mut y = [0.0; 6];
        for (out, row) in y.iter_mut().zip(&self.0) {
            *out = row.iter().zip(x).map(|(a, b)| a * b).sum();
        }
        let [lx, ly, lz, ax, ay, az] = y;
        (DVec3::new(lx, ly, lz), DVec3::new(ax, ay, az))
    }

    /// Solves `self · x = rhs` for a symmetric positive definite matrix by LDLᵀ; `None` when a
    /// pivot is not positive and finite.
    ///
    /// RT: safe; about 100 multiply-adds, no branch on data but the pivot check.
    pub fn solve_spd(&self, rhs: Wrench) -> Option<(DVec3, DVec3)> {
        let a = &self.0;
        let mut l = [[0.0; 6]; 6];
        let mut d = [0.0; 6];
        for j in 0..6 {
            let mut pivot = a[j][j];
            for k in 0..j {
                pivot -= l[j][k] * l[j][k] * d[k];
            }
            if !(pivot > 0.0 && pivot.is_finite()) {
                return None;
            }
            d[j] = pivot;
            for i in j + 1..6 {
                let mut entry = a[i][j];
                for k in 0..j {
                    entry -= l[i][k] * l[j][k] * d[k];
                }
                l[i][j] = entry / pivot;
            }
        }
        let mut x =
            [rhs.force.x, rhs.force.y, rhs.force.z, rhs.torque.x, rhs.torque.y, rhs.torque.z];
        for i in 0..6 {
            for k in 0..i {
                x[i] -= l[i][k] * x[k];
            }
        }
        for i in 0..6 {
            x[i] /= d[i];
        }
        for i in (0..6).rev() {
            for k in i + 1..6 {
                x[i] -= l[k][i] * x[k];
            }
        }
        let [lx, ly, lz, ax, ay, az] = x;
        Some((DVec3::new(lx, ly, lz), DVec3::new(ax, ay, az)))
    }

    /// The positive semi-definite part of a symmetric matrix in the metric of a mass: with
    /// M = L Lᵀ and L⁻¹ A L⁻ᵀ = Σ λ u uᵀ it is L (Σ max(λ, 0) u uᵀ) Lᵀ. Eigenvalues above
    /// −10⁻⁶ of their sum count as zero: then the matrix is its own part. `None` where `mass` is
    /// not positive definite, or something not finite.
    ///
    /// RT: safe; some 150 multiply-adds where nothing is negative, about 5,000 elsewhere.
    pub fn positive_part(&self, mass: &Self) -> Option<Self> {
        let root = mass.root()?;
        // Rows, then columns, of L⁻¹ A L⁻ᵀ.
        let rows = root.forward_rows(&self.0);
        let scaled = root.forward_rows(&transposed(&rows));
        let trace: f64 = (0..6).map(|n| scaled[n][n]).sum();
        let mut shifted = Self(scaled);
        for (n, row) in shifted.0.iter_mut().enumerate() {
            row[n] += NO_LESS * trace;
        }
        if trace == 0.0 || shifted.root().is_some() {
            return trace.is_finite().then_some(*self);
        }
        let (values, vectors) = eigen(scaled)?;
        let mut part = [[0.0; 6]; 6];
        for (value, vector) in values.into_iter().zip(transposed(&vectors)) {
            // L u.
            let column: [f64; 6] =
                core::array::from_fn(|i| (0..=i).map(|k| root.0[i][k] * vector[k]).sum());
            for (row, along) in part.iter_mut().zip(column) {
                for (entry, other) in row.iter_mut().zip(column) {
                    *entry += value.max(0.0) * along * other;
                }
            }
        }
        Some(Self(part))
    }

    /// The lower triangle L of a positive definite matrix L Lᵀ.
    fn root(&self) -> Option<Self> {
        let mut root = [[0.0; 6]; 6];
        for i in 0..6 {
            for j in 0..=i {
                let inner: f64 = (0..j).map(|k| root[i][k] * root[j][k]).sum();
                let left = self.0[i][j] - inner;
                root[i][j] = if i == j {
                    if !(left > 0.0 && left.is_finite()) {
                        return None;
                    }
                    left.sqrt()
                } else {
                    left / root[j][j]
                };
            }
        }
        Some(Self(root))
    }

    /// Of a lower triangle L: L⁻¹ times each column of a matrix.
    fn forward_rows(&self, of: &[[f64; 6]; 6]) -> [[f64; 6]; 6] {
        let mut solved = *of;
        for i in 0..6 {
            let mut row = solved[i];
            for (above, factor) in solved[..i].iter().zip(self.0[i]) {
                for (entry, known) in row.iter_mut().zip(above) {
                    *entry -= factor * known;
                }
            }
            solved[i] = row.map(|entry| entry / self.0[i][i]);
        }
        solved
    }
}

/// The share of its trace below zero that an eigenvalue may have and count as none: sums in `f32`
/// leave as much.
const NO_LESS: f64 = 1e-6;

/// Most sweeps over all entries of [`eigen`]; it takes five to seven.
const SWEEPS: usize = 16;

fn transposed(of: &[[f64; 6]; 6]) -> [[f64; 6]; 6] {
    core::array::from_fn(|i| core::array::from_fn(|j| of[j][i]))
}

/// Eigenvalues of a symmetric matrix, and their vectors in columns, by Jacobi's rotations (Golub,
/// Van Loan, "Matrix Computations", 8.5). `None` on what is not finite.
fn eigen(mut a: [[f64; 6]; 6]) -> Option<([f64; 6], [[f64; 6]; 6])> {
    let mut vectors = [[0.0; 6]; 6];
    (0..6).for_each(|n| vectors[n][n] = 1.0);
    let scale: f64 = a.as_flattened().iter().map(|entry| entry * entry).sum();
    if !scale.is_finite() {
        return None;
    }
    for _ in 0..SWEEPS {
        let beside: f64 = (0..6)
            .flat_map(|i| (0..i).map(move |j| (i, j)))
            .fold(0.0, |sum, (i, j)| sum + a[i][j] * a[i][j]);
        if beside <= 1e-28 * scale {
            break;
        }
        for p in 0..5 {
            for q in p + 1..6 {
                if a[p][q] == 0.0 {
                    continue;
                }
                let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
                let t = theta.signum() / (theta.abs() + theta.hypot(1.0));
                let c = 1.0 / t.hypot(1.0);
                let s = t * c;
                for row in &mut a {
                    (row[p], row[q]) = (c * row[p] - s * row[q], s * row[p] + c * row[q]);
                }
                let (above, from_q) = a.split_at_mut(q);
                for (one, other) in above[p].iter_mut().zip(&mut from_q[0]) {
                    (*one, *other) = (c * *one - s * *other, s * *one + c * *other);
                }
                for row in &mut vectors {
                    (row[p], row[q]) = (c * row[p] - s * row[q], s * row[p] + c * row[q]);
                }
            }
        }
    }
    Some((core::array::from_fn(|n| a[n][n]), vectors))
}

/// a bᵀ.
fn outer(a: DVec3, b: DVec3) -> DMat3 {
    DMat3::from_cols(a * b.x, a * b.y, a * b.z)
}

#[cfg(test)]
mod tests {
    use super::super::testing::Random;
    use super::*;

    #[test]
    fn solve_inverts_mul_on_random_positive_definite_matrices() {
        let mut chance = Random(1);
        let mut random = || chance.unit() - 0.5;
        for _ in 0..1000 {
            let mut matrix = Mat6::ZERO;
            for (idx, row) in matrix.0.iter_mut().enumerate() {
                row[idx] = 0.1;
            }
            for _ in 0..8 {
                let linear = DVec3::new(random(), random(), random());
                matrix.add_outer(10.0, linear, DVec3::new(random(), random(), random()));
            }
            let (along, about) = matrix.bounds();
            for (row, bound) in [(0, along), (3, about)] {
                // The largest eigenvalue by power iteration, from below.
                let block = matrix.block(row, row);
                let direction =
                    (0..50).fold(DVec3::new(0.6, 0.5, -0.3), |v, _| (block * v).normalize());
                let largest = direction.dot(block * direction);
                assert!(
                    (largest * (1.0 - 1e-12)..=largest * 1.7321).contains(&bound),
                    "{largest} {bound}"
                );
            }
            let x = (
                DVec3::new(random(), random(), random()),
                DVec3::new(random(), random(), random()),
            );
            let (force, torque) = matrix.mul(x.0, x.1);
            let solved = matrix.solve_spd(Wrench { force, torque }).expect("positive definite");
            assert!((solved.0 - x.0).length() + (solved.1 - x.1).length() < 1e-10);
        }
    }

    fn random_vector(chance: &mut Random) -> DVec3 {
        chance.in_box(-1.0, 1.0)
    }

    #[test]
    fn the_positive_part_is_what_is_positive_in_the_metric_of_the_mass() {
        let mut chance = Random(3);
        let mut n_split = 0;
        for _ in 0..1000 {
            let mut mass = Mat6::ZERO;
            (0..6).for_each(|n| mass.0[n][n] = 0.05);
            (0..6).for_each(|_| {
                mass.add_outer(0.3, random_vector(&mut chance), random_vector(&mut chance));
            });
            let mut matrix = Mat6::ZERO;
            let n_terms = 1 + (chance.unit() * 8.0) as usize;
            let n_negative = (chance.unit() * (n_terms + 1) as f64) as usize;
            for n in 0..n_terms {
                let scale = 1e4 * chance.unit() * if n < n_negative { -1.0 } else { 1.0 };
                matrix.add_outer(scale, random_vector(&mut chance), random_vector(&mut chance));
            }
            let part = matrix.positive_part(&mass).expect("finite");
            let less = part.plus_scaled(-1.0, &matrix);
            let quadratic = |of: &Mat6, (linear, angular): (DVec3, DVec3)| {
                let (force, torque) = of.mul(linear, angular);
                force.dot(linear) + torque.dot(angular)
            };
            // Neither it nor what it leaves out has negative values, and in the metric of the mass
            // they have nothing in common: P M⁻¹ (P − A) = 0.
            for _ in 0..20 {
                let at = (random_vector(&mut chance), random_vector(&mut chance));
                assert!(quadratic(&part, at) > -0.05 && quadratic(&less, at) > -0.05);
                let (force, torque) = less.mul(at.0, at.1);
                let moved = mass.solve_spd(Wrench { force, torque }).expect("positive definite");
                let common = part.mul(moved.0, moved.1);
                let largest = 1e4 * 1e4 / 0.05;
                assert!(common.0.length() + common.1.length() < 1e-6 * largest, "{common:?}");
            }
            if n_negative == 0 {
                assert_eq!(part, matrix, "nothing is negative");
            }
            n_split += usize::from(n_negative > 0 && n_negative < n_terms);
        }
        assert!(n_split > 300, "{n_split}");
    }

    #[test]
    fn no_positive_part_is_found_of_what_is_not_finite_or_without_a_mass() {
        let mut matrix = Mat6::ZERO;
        assert_eq!(matrix.positive_part(&matrix), None);
        let mut mass = Mat6::ZERO;
        (0..6).for_each(|n| mass.0[n][n] = 1.0);
        assert_eq!(matrix.positive_part(&mass), Some(Mat6::ZERO));
        for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            matrix.0[2][2] = value;
            assert_eq!(matrix.positive_part(&mass), None, "{value}");
        }
    }

    #[test]
    fn an_indefinite_or_non_finite_matrix_is_refused() {
        assert!(Mat6::ZERO.solve_spd(Wrench::ZERO).is_none());
        let mut bad = Mat6::ZERO;
        bad.0[0][0] = f64::NAN;
        assert!(bad.solve_spd(Wrench::ZERO).is_none());
    }
}
