//! Backward Euler: (M + T D + T² K) ḋ' = M ḋ + T (f − K (d − d₀)), by conjugate gradients.
//!
//! The matrix is symmetric and positive definite whatever the step, so the step is stable whatever the step; with 12 k T² well above m it
//! also damps, as every implicit step does. Source: Baraff and Witkin 1998 for the form of the step; Shewchuk 1994 for the method.

use rayon::prelude::*;

use super::{Material, Quantity, by_plane, stretch};
use crate::haptics::clay::Lattice;

/// The residual that is left, as a share of what was asked for.
const TOLERANCE: f64 = 1e-4;
/// Iterations of one step at most.
const ITERATIONS_MAX: u32 = 60;
/// Nodes in one part of a sum: parts are added in their order, so the bits do not depend on the number of threads.
const PART: usize = 4096;

/// Scratch of the solver.
#[derive(Clone, Debug)]
pub(super) struct Solver {
    residual: Box<[f32]>,
    direction: Box<[f32]>,
    product: Box<[f32]>,
    /// 1 over the diagonal.
    inverse: Box<[f32]>,
}

impl Solver {
    pub(super) fn new(n_nodes: usize) -> Self {
        let zeros = || vec![0.0; n_nodes].into_boxed_slice();
        Self { residual: zeros(), direction: zeros(), product: zeros(), inverse: zeros() }
    }

    /// Velocities after a step of T = `time_s`, from those before. Returns the iterations, and whether they ended early.
    pub(super) fn step(
        &mut self,
        (lattice, material): (&Lattice, &Material),
        (rest_m, forces_n, densities_m): (&[f32], &[f32], &[f32]),
        velocities: &mut [f32],
        time_s: f64,
    ) -> (u32, bool) {
        let t = time_s as f32;
        let Material { mass_kg, damping_n_s_per_m, stiffness_n_per_m, .. } = material;
        let inertia = |node: usize| mass_kg.at(node) + t * damping_n_s_per_m.at(node);
        let Self { residual, direction, product, inverse } = self;

        // r = M v + T (f − K (d − d₀)) − A v, from v as the first guess: M v − A v = −T D v − T² K v.
        {
            let velocities = &*velocities;
            let ahead = |node: usize| densities_m[node] - rest_m[node] + t * velocities[node];
            by_plane(lattice, residual, |node, strides| {
                t * (forces_n[node]
                    - damping_n_s_per_m.at(node) * velocities[node]
                    - stretch(stiffness_n_per_m, node, strides, ahead))
            });
        }
        by_plane(lattice, inverse, |node, strides| {
            let springs = match stiffness_n_per_m {
                Quantity::Constant(k) => 6.0 * k,
                Quantity::PerNode(k) => {
                    strides.into_iter().map(|stride| k[node] + 0.5 * (k[node - stride] + k[node + stride])).sum()
                }
            };
            1.0 / (inertia(node) + t * t * springs)
        });
        direction.par_iter_mut().zip(&*residual).zip(&*inverse).for_each(|((p, r), inverse)| *p = r * inverse);
        let mut energy = dot(residual, direction);
        let enough = TOLERANCE * TOLERANCE * energy;
        for iteration in 0..ITERATIONS_MAX {
            // Also where nothing acts, and where something is not a number.
            let is_left = energy > enough;
            if !is_left {
                return (iteration, false);
            }
            {
                let direction = &*direction;
                let along = |node: usize| direction[node];
                by_plane(lattice, product, |node, strides| {
                    inertia(node) * direction[node] + t * t * stretch(stiffness_n_per_m, node, strides, along)
                });
            }
            let length = (energy / dot(direction, product)) as f32;
            velocities.par_iter_mut().zip(&*direction).for_each(|(v, p)| *v += length * p);
            residual.par_iter_mut().zip(&*product).for_each(|(r, q)| *r -= length * q);
            // The preconditioned residual takes the place of the product.
            product.par_iter_mut().zip(&*residual).zip(&*inverse).for_each(|((z, r), inverse)| *z = r * inverse);
            let next = dot(residual, product);
            let turn = (next / energy) as f32;
            direction.par_iter_mut().zip(&*product).for_each(|(p, z)| *p = z + turn * *p);
            energy = next;
        }
        (ITERATIONS_MAX, true)
    }
}

/// Σ a b in f64, part by part.
fn dot(a: &[f32], b: &[f32]) -> f64 {
    let of_part = |(a, b): (&[f32], &[f32])| a.iter().zip(b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum::<f64>();
    let parts: Vec<f64> = a.par_chunks(PART).zip(b.par_chunks(PART)).map(of_part).collect();
    parts.into_iter().sum()
}
