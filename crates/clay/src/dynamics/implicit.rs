//! Backward Euler: (M + T D + T² K) ḋ' = M ḋ + T (f − K (d − d₀)), by conjugate gradients.
//!
//! The matrix is symmetric and positive definite whatever the step, so the step is stable whatever
//! the step; with 12 k T² well above m it also damps, as every implicit step does. Source: Baraff
//! and Witkin 1998 for the form of the step; Shewchuk 1994 for the method.

use rayon::prelude::*;

use super::{Material, Quantity, springs};
use vps::density::Lattice;

/// The residual that is left, as a share of what was asked for.
const TOLERANCE: f64 = 1e-4;
/// Iterations of one step at most.
const ITERATIONS_MAX: u32 = 60;
/// Nodes in one part of a sum: parts are added in their order, so the bits do not depend on the
/// number of threads.
const PART: usize = 4096;

/// Scratch of the solver, `[n_nodes]` each.
#[derive(Clone, Debug)]
pub(super) struct Solver {
    residual: Box<[f32]>,
    direction: Box<[f32]>,
    product: Box<[f32]>,
    /// M + T D, and about 1 over the diagonal.
    inertia: Box<[f32]>,
    inverse: Box<[f32]>,
}

impl Solver {
    pub(super) fn new(n_nodes: usize) -> Self {
        let zeros = || vec![0.0; n_nodes].into_boxed_slice();
        Self {
            residual: zeros(),
            direction: zeros(),
            product: zeros(),
            inertia: zeros(),
            inverse: zeros(),
        }
    }

    /// Velocities after a step of T = `time_s`, from those before. Returns the iterations, and
    /// whether they ended early.
    pub(super) fn step(
        &mut self,
        (lattice, material): (&Lattice, &Material<Quantity>),
        (rest_m, forces_n, densities_m): (&[f32], &[f32], &[f32]),
        velocities: &mut [f32],
        time_s: f64,
    ) -> (u32, bool) {
        let t = time_s as f32;
        let Material { mass_kg, damping_n_s_per_m, stiffness_n_per_m, .. } = material;
        let Self { residual, direction, product, inertia, inverse } = self;

        // r = M v + T (f − K (d − d₀)) − A v, from v as the first guess: M v − A v = −T D v − T² K
        // v.
        let ahead = direction
            .par_chunks_mut(PART)
            .zip(densities_m.par_chunks(PART))
            .zip(rest_m.par_chunks(PART));
        ahead.zip(velocities.par_chunks(PART)).for_each(
            |(((ahead, densities), rest), velocities)| {
                for (((ahead, density), rest), velocity) in
                    ahead.iter_mut().zip(densities).zip(rest).zip(velocities)
                {
                    *ahead = density - rest + t * velocity;
                }
            },
        );
        springs(lattice, stiffness_n_per_m, direction, residual, |node, stretch, _| {
            t * (forces_n[node] - damping_n_s_per_m.at(node) * velocities[node] - stretch)
        });
        inertia.par_chunks_mut(PART).zip(inverse.par_chunks_mut(PART)).enumerate().for_each(
            |(part, (inertia, inverse))| {
                for (n, (inertia, inverse)) in inertia.iter_mut().zip(inverse).enumerate() {
                    let node = part * PART + n;
                    *inertia = mass_kg.at(node) + t * damping_n_s_per_m.at(node);
                    // Near the diagonal where stiffness was painted, which is near enough.
                    *inverse = 1.0 / (*inertia + 6.0 * t * t * stiffness_n_per_m.at(node));
                }
            },
        );
        let preconditioned = direction
            .par_chunks_mut(PART)
            .zip(residual.par_chunks(PART))
            .zip(inverse.par_chunks(PART));
        let energies: Vec<f64> = preconditioned
            .map(|((p, r), inverse)| {
                let mut sum = 0.0;
                for ((p, r), inverse) in p.iter_mut().zip(r).zip(inverse) {
                    *p = r * inverse;
                    sum += f64::from(*p) * f64::from(*r);
                }
                sum
            })
            .collect();
        let mut energy: f64 = energies.into_iter().sum();
        let enough = TOLERANCE * TOLERANCE * energy;
        for iteration in 0..ITERATIONS_MAX {
            // Also where nothing acts, and where something is not a number.
            let is_left = energy > enough;
            if !is_left {
                return (iteration, false);
            }
            let bent: f64 = {
                let direction = &*direction;
                let inertia = &*inertia;
                let of_planes = springs(
                    lattice,
                    stiffness_n_per_m,
                    direction,
                    product,
                    |node, stretch, sum| {
                        let product = inertia[node] * direction[node] + t * t * stretch;
                        *sum += f64::from(product) * f64::from(direction[node]);
                        product
                    },
                );
                of_planes.into_iter().sum()
            };
            let length = (energy / bent) as f32;
            let parts = velocities
                .par_chunks_mut(PART)
                .zip(residual.par_chunks_mut(PART))
                .zip(direction.par_chunks(PART));
            let next: Vec<f64> = parts
                .zip(product.par_chunks(PART))
                .zip(inverse.par_chunks(PART))
                .map(|((((v, r), p), q), inverse)| {
                    let mut sum = 0.0;
                    for ((((v, r), p), q), inverse) in
                        v.iter_mut().zip(r).zip(p).zip(q).zip(inverse)
                    {
                        *v += length * p;
                        *r -= length * q;
                        sum += f64::from(*r) * f64::from(*r * inverse);
                    }
                    sum
                })
                .collect();
            let next: f64 = next.into_iter().sum();
            let turn = (next / energy) as f32;
            let parts = direction
                .par_chunks_mut(PART)
                .zip(residual.par_chunks(PART))
                .zip(inverse.par_chunks(PART));
            parts.for_each(|((p, r), inverse)| {
                for ((p, r), inverse) in p.iter_mut().zip(r).zip(inverse) {
                    *p = r * inverse + turn * *p;
                }
            });
            energy = next;
        }
        (ITERATIONS_MAX, true)
    }
}
