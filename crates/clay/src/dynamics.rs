//! The material's motion: densities as masses on springs.
//!
//! M d̈ + D ḋ + K (d − d₀) = f over the nodes of the region (Guo2004, dynamic global volumetric
//! model). The masses do not move in space: a spring between two neighbours pulls on the
//! *difference of their densities*, back to what it was at rest. The outermost nodes are held, so
//! the region stays of one model with the material around it.
//!
//! Units: densities m, mass kg, damping N·s/m, stiffness N/m, forces N. Cost: O(nodes) per step, 7
//! reads each; parallel, with the same bits on any number of threads.

mod implicit;

use core::ops::RangeInclusive;

use rayon::prelude::*;

use vps::density::{Lattice, Raster};

/// Share of the stable step that an explicit step takes.
const EXPLICIT_MARGIN: f64 = 0.8;
/// Nodes that a thread takes at once where each stands for itself.
const NODES: usize = 8192;
/// Planes that a thread takes at once.
const PLANES: usize = 4;
/// Explicit steps in one update at most: the material is slower than reported rather than the
/// update late.
const STEPS_MAX: u32 = 64;

/// How the equation of motion is stepped.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Integrator {
    /// Forward Euler with halved steps, as in the paper. The new velocity moves the density; the
    /// paper does not say which does.
    Explicit,
    /// Backward Euler, solved by conjugate gradients: any step is stable.
    #[default]
    Implicit,
}

/// A quantity of the mass points.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Quantity {
    /// The same everywhere.
    Constant(f32),
    /// `[n_nodes]`, as it was painted.
    PerNode(Box<[f32]>),
}

impl Quantity {
    #[inline]
    fn at(&self, node: usize) -> f32 {
        match self {
            Self::Constant(value) => *value,
            Self::PerNode(values) => values[node],
        }
    }

    fn extremes(&self) -> (f32, f32) {
        match self {
            Self::Constant(value) => (*value, *value),
            Self::PerNode(values) => {
                values.iter().fold((f32::INFINITY, 0.0), |(low, high), value| {
                    (low.min(*value), high.max(*value))
                })
            }
        }
    }

    /// Sets a node; a constant becomes one value per node.
    #[cfg(test)]
    pub(super) fn set(&mut self, node: usize, n_nodes: usize, value: f32) {
        if let Self::Constant(constant) = self {
            *self = Self::PerNode(vec![*constant; n_nodes].into_boxed_slice());
        }
        if let Self::PerNode(values) = self {
            values[node] = value;
        }
    }
}

/// What the clay is made of: the same everywhere, or, as the dynamics have it, with a quantity for
/// each property.
#[derive(Clone, Debug, PartialEq)]
pub struct Material<Q = f32> {
    /// Of a mass point, kg.
    pub mass_kg: Q,
    /// Of a mass point, N·s/m.
    pub damping_n_s_per_m: Q,
    /// Of the spring between two neighbours, N/m; the mean of both.
    pub stiffness_n_per_m: Q,
    /// Time in which what is held becomes the new rest, s; infinite: elastic.
    pub creep_s: f64,
    /// An explicit step is halved while a density is accelerated more than this, m/s².
    pub acceleration_max_m_per_s2: f64,
}

impl Default for Material {
    /// Soft clay, which creeps within a tenth of a second.
    fn default() -> Self {
        Self {
            mass_kg: 1e-4,
            damping_n_s_per_m: 0.5,
            stiffness_n_per_m: 50.0,
            creep_s: 0.1,
            acceleration_max_m_per_s2: 1e4,
        }
    }
}

impl Material {
    /// Mass of a mass point, kg.
    pub const MASS_KG: RangeInclusive<f64> = 1e-9..=1.0;
    /// Damping of a mass point, N·s/m. Without damping a material still moves; without mass or
    /// springs it does not.
    pub const DAMPING_N_S_PER_M: RangeInclusive<f64> = 0.0..=1e4;
    /// The stiffest spring, N/m; the least is above 0.
    pub const STIFFNESS_MAX_N_PER_M: f64 = 1e6;
}

impl From<Material> for Material<Quantity> {
    fn from(same: Material) -> Self {
        let Material {
            mass_kg,
            damping_n_s_per_m,
            stiffness_n_per_m,
            creep_s,
            acceleration_max_m_per_s2,
        } = same;
        Self {
            mass_kg: Quantity::Constant(mass_kg),
            damping_n_s_per_m: Quantity::Constant(damping_n_s_per_m),
            stiffness_n_per_m: Quantity::Constant(stiffness_n_per_m),
            creep_s,
            acceleration_max_m_per_s2,
        }
    }
}

/// Densities under way.
#[derive(Clone, Debug)]
pub(super) struct Dynamics {
    material: Material<Quantity>,
    integrator: Integrator,
    now: Raster,
    /// `[n_nodes]`: rest densities, and the forces of the update; rates of the densities.
    rest_m: Box<[f32]>,
    velocities_m_per_s: Raster,
    forces_n: Box<[f32]>,
    /// Scratch of the explicit steps: d̈, and d − d₀.
    accelerations: Box<[f32]>,
    away: Box<[f32]>,
    solver: implicit::Solver,
    /// Explicit step of the last update, s; 0 before the first.
    step_s: f64,
}

/// What an update did.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Progress {
    /// Steps, or iterations of the solver.
    pub steps: u32,
    /// Time that the material has gone through, s: less than asked where it would have taken too
    /// many steps.
    pub time_s: f64,
    /// Largest rate of a density |ḋ|, m/s.
    pub speed_m_per_s: f64,
    /// The solver stopped at its limit before it was exact.
    is_rough: bool,
}

impl Dynamics {
    /// Material at rest with these densities. Allocates.
    pub(super) fn new(
        at_rest: Raster,
        material: Material<Quantity>,
        integrator: Integrator,
    ) -> Self {
        let zeros = || vec![0.0; at_rest.values_m().len()].into_boxed_slice();
        Self {
            material,
            integrator,
            rest_m: at_rest.values_m().into(),
            velocities_m_per_s: Raster::uniform(*at_rest.lattice(), 0.0),
            forces_n: zeros(),
            accelerations: zeros(),
            away: zeros(),
            solver: implicit::Solver::new(at_rest.lattice().n_nodes()),
            now: at_rest,
            step_s: 0.0,
        }
    }

    /// Where the nodes lie.
    pub(super) fn lattice(&self) -> &Lattice {
        self.now.lattice()
    }

    /// Densities now.
    pub(super) fn now(&self) -> &Raster {
        &self.now
    }

    /// Rates of the densities, m/s.
    pub(super) fn velocities_m_per_s(&self) -> &Raster {
        &self.velocities_m_per_s
    }

    /// `[n_nodes]`, N: what acts in the next update, cleared by it.
    pub(super) fn forces_n_mut(&mut self) -> (&Raster, &mut [f32]) {
        (&self.now, &mut self.forces_n)
    }

    /// What it is made of.
    pub(super) fn material_mut(&mut self) -> &mut Material<Quantity> {
        self.step_s = 0.0;
        &mut self.material
    }

    /// What is there becomes the rest: the end of a stroke. Nothing moves any more.
    pub(super) fn settle(&mut self) {
        self.rest_m.copy_from_slice(self.now.values_m());
        self.velocities_m_per_s.values_m_mut().fill(0.0);
    }

    /// Other densities, at rest: after a refit, or a step back.
    ///
    /// # Panics
    /// Where the raster has another lattice.
    pub(super) fn replace(&mut self, at_rest: Raster) {
        assert_eq!(at_rest.lattice(), self.now.lattice(), "a raster of the same lattice");
        self.now = at_rest;
        self.settle();
    }

    /// Lets the material move for a time under the forces that were added since the last update,
    /// and clears them.
    pub(super) fn update(&mut self, time_s: f64) -> Progress {
        let mut progress = match self.integrator {
            Integrator::Explicit => self.update_explicit(time_s),
            Integrator::Implicit => self.update_implicit(time_s),
        };
        let gain = (1.0 - (-progress.time_s / self.material.creep_s).exp()) as f32;
        if gain > 0.0 {
            self.rest_m
                .par_iter_mut()
                .zip(self.now.values_m())
                .with_min_len(NODES)
                .for_each(|(rest, now)| *rest += (now - *rest) * gain);
        }
        self.forces_n.fill(0.0);
        progress.speed_m_per_s = f64::from(
            self.velocities_m_per_s
                .values_m()
                .par_iter()
                .with_min_len(NODES)
                .map(|v| v.abs())
                .reduce(|| 0.0, f32::max),
        );
        progress
    }

    /// The largest stable explicit step, s: 12 k T²/m + 2 c T/m < 4, the stiffest spring on the
    /// lightest mass. Ours: springs to six neighbours have no eigenvalue above 12 k.
    fn stable_step_s(&self) -> f64 {
        let Material { mass_kg, damping_n_s_per_m, stiffness_n_per_m, .. } = &self.material;
        let m = f64::from(mass_kg.extremes().0);
        let c = f64::from(damping_n_s_per_m.extremes().1);
        let k = f64::from(stiffness_n_per_m.extremes().1);
        // The root of 12 k T² + 2 c T − 4 m = 0, in the form that does not cancel.
        4.0 * m / (c + (c * c + 48.0 * k * m).sqrt())
    }

    fn update_explicit(&mut self, time_s: f64) -> Progress {
        let mut progress = Progress::default();
        let longest_s = (EXPLICIT_MARGIN * self.stable_step_s()).min(time_s);
        if self.step_s <= 0.0 {
            self.step_s = longest_s;
        }
        self.step_s = self.step_s.min(longest_s);
        self.away
            .par_iter_mut()
            .zip(self.now.values_m())
            .zip(&self.rest_m)
            .for_each(|((away, now), rest)| *away = now - rest);
        while progress.steps < STEPS_MAX && progress.time_s < time_s * (1.0 - 1e-9) {
            let is_wild = self.accelerate() > self.material.acceleration_max_m_per_s2;
            // Half of the previous step while the acceleration is beyond the threshold, and back up
            // again afterwards.
            self.step_s = if is_wild {
                (0.5 * self.step_s).max(longest_s / 1024.0)
            } else {
                (2.0 * self.step_s).min(longest_s)
            };
            let step_s = self.step_s.min(time_s - progress.time_s);
            let h = step_s as f32;
            let velocities = self.velocities_m_per_s.values_m_mut().par_iter_mut();
            let moving = velocities
                .zip(self.now.values_m_mut())
                .zip(&mut self.away)
                .zip(&self.accelerations);
            moving.with_min_len(NODES).for_each(|(((velocity, density), away), acceleration)| {
                *velocity += h * acceleration;
                *density += h * *velocity;
                *away += h * *velocity;
            });
            progress.steps += 1;
            progress.time_s += step_s;
        }
        progress
    }

    /// d̈ = (f − D ḋ − K (d − d₀))/m of every node; returns the largest |d̈|.
    fn accelerate(&mut self) -> f64 {
        let material = &self.material;
        let forces = &self.forces_n;
        let velocities = self.velocities_m_per_s.values_m();
        let largest = springs(
            self.now.lattice(),
            &material.stiffness_n_per_m,
            &self.away,
            &mut self.accelerations,
            |node, stretch, largest| {
                let pushed =
                    forces[node] - material.damping_n_s_per_m.at(node) * velocities[node] - stretch;
                let acceleration = pushed / material.mass_kg.at(node);
                *largest = largest.max(f64::from(acceleration.abs()));
                acceleration
            },
        );
        largest.into_iter().fold(0.0, f64::max)
    }

    fn update_implicit(&mut self, time_s: f64) -> Progress {
        let (iterations, is_rough) = self.solver.step(
            (self.now.lattice(), &self.material),
            (&self.rest_m, &self.forces_n, self.now.values_m()),
            self.velocities_m_per_s.values_m_mut(),
            time_s,
        );
        let h = time_s as f32;
        let densities = self.now.values_m_mut();
        densities
            .par_iter_mut()
            .zip(self.velocities_m_per_s.values_m())
            .with_min_len(NODES)
            .for_each(|(density, velocity)| *density += h * velocity);
        Progress { steps: iterations, time_s, speed_m_per_s: 0.0, is_rough }
    }
}

/// Gives each inner node to `finish` with (K u) there, Σ over the six neighbours of k (u − u'), and
/// stores what comes back; outermost nodes get 0. Plane by plane in parallel; gives the sums of
/// what `finish` adds up, plane by plane in their order.
///
/// Rows of a plane are looked at as slices, so that the constant case is computed several nodes at
/// a time.
fn springs(
    lattice: &Lattice,
    stiffness: &Quantity,
    u: &[f32],
    out: &mut [f32],
    finish: impl Fn(usize, f32, &mut f64) -> f32 + Sync,
) -> Vec<f64> {
    let [nx, ny, nz] = lattice.dims;
    let plane_nodes = ny * nz;
    let of_plane = |(x, plane): (usize, &mut [f32])| {
        let mut sum = 0.0;
        if x == 0 || x + 1 == nx {
            plane.fill(0.0);
            return sum;
        }
        for (y, row) in plane.chunks_exact_mut(nz).enumerate() {
            if y == 0 || y + 1 == ny {
                row.fill(0.0);
                continue;
            }
            let first = (x * ny + y) * nz;
            let beside = |from: usize| &u[from..from + nz];
            let own = beside(first);
            let [below, above, behind, ahead] =
                [first - nz, first + nz, first - plane_nodes, first + plane_nodes].map(beside);
            match stiffness {
                Quantity::Constant(k) => {
                    for z in 1..nz - 1 {
                        let around =
                            own[z - 1] + own[z + 1] + below[z] + above[z] + behind[z] + ahead[z];
                        row[z] = k * (6.0 * own[z] - around);
                    }
                }
                Quantity::PerNode(values) => {
                    for z in 1..nz - 1 {
                        let node = first + z;
                        let spring = |other: usize| {
                            0.5 * (values[node] + values[other]) * (own[z] - u[other])
                        };
                        let along = spring(node - 1)
                            + spring(node + 1)
                            + spring(node - nz)
                            + spring(node + nz);
                        row[z] = along + spring(node - plane_nodes) + spring(node + plane_nodes);
                    }
                }
            }
            row[0] = 0.0;
            row[nz - 1] = 0.0;
            for (z, place) in row.iter_mut().enumerate().take(nz - 1).skip(1) {
                *place = finish(first + z, *place, &mut sum);
            }
        }
        sum
    };
    out.par_chunks_mut(plane_nodes).with_min_len(PLANES).enumerate().map(of_plane).collect()
}

#[cfg(test)]
mod tests;
