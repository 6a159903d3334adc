//! Samples that go with the surface when the densities change.
//!
//! A sample stays on its level set: ∇s·ẋ + ∂s/∂t = 0. No tangential motion can be distinguished
//! from that, so it moves along the normal alone (Guo2004, equations 6 and 7): n = −∇s/|∇s| out of
//! the material, v_n = (∂s/∂t)/|∇s|, x ← x + T v_n n. What the step leaves over is taken back along
//! the same line, so a long stroke does not add up what each step is short of.

use glam::DVec3;
use rayon::prelude::*;

use super::PointSet;
use vps::density::{Density, Raster};

/// Corrections after a step at most.
const CORRECTIONS: u32 = 8;
/// A sample is on its level when it is nearer than this, spacings of the raster.
const ON_LEVEL_SPACINGS: f64 = 1e-5;
/// Slopes below this have no direction: a sample there stays. An undeformed density has slope 1.
const SLOPE_MIN: f64 = 1e-2;
/// A line is across a surface when the cosine of its angle with the normal is this at least.
const ACROSS_MIN: f64 = 0.5;
/// No sample goes further in one step than this, spacings of the raster.
const STEP_MAX_SPACINGS: f64 = 1.0;
/// Samples handed to a thread at once.
const PART: usize = 512;

/// Samples of a surface that lie in the region, each on its own level.
///
/// A raster cannot hold an edge, and rounds a curved surface a little: what its density is at a
/// sample before anything moves is the sample's level, which it keeps. So nothing jumps when a
/// region is chosen, and edges stay edges.
#[derive(Clone, Debug, Default)]
pub(super) struct AdvectedSamples {
    samples: Vec<u32>,
    /// m, one per sample.
    levels_m: Vec<f64>,
}

impl AdvectedSamples {
    /// The samples that lie within a raster at rest, further than `margin_m` from its faces. Cost:
    /// O(samples).
    pub(super) fn new(points: &PointSet, at_rest: &Raster, margin_m: f64) -> Self {
        let (low, high) = at_rest.lattice().bounds();
        let inside = |at: &DVec3| at.cmpge(low + margin_m).all() && at.cmple(high - margin_m).all();
        let level = |(sample, at): (usize, &DVec3)| {
            let density = inside(at).then(|| at_rest.at(*at)).flatten()?;
            Some((sample as u32, f64::from(density.value_m)))
        };
        let (samples, levels_m) =
            points.positions_map.par_iter().enumerate().filter_map(level).unzip();
        Self { samples, levels_m }
    }

    /// Numbers of the samples, ascending.
    pub(super) fn samples(&self) -> &[u32] {
        &self.samples
    }

    /// The level of each, m.
    pub(super) fn levels_m(&self) -> &[f64] {
        &self.levels_m
    }

    /// Samples that no surface is left for, ascending: the density where they are is off their
    /// level by more than a distance, as where a hole has opened, two fronts have met or a neck has
    /// broken.
    pub(super) fn lost(&self, points: &PointSet, now: &Raster, farther_m: f64) -> Vec<u32> {
        let is_lost = |(sample, level_m): &(&u32, &f64)| {
            let density = now.at(points.positions_map[**sample as usize]);
            density
                .is_some_and(|density| (f64::from(density.value_m) - **level_m).abs() > farther_m)
        };
        self.samples.iter().zip(&self.levels_m).filter(is_lost).map(|(sample, _)| *sample).collect()
    }

    /// A sample more, with a number above all others.
    pub(super) fn push(&mut self, sample: u32, level_m: f64) {
        self.samples.push(sample);
        self.levels_m.push(level_m);
    }

    /// Moves the samples for a time T, with the densities at its end and their rates. Returns the
    /// longest way that one went, m.
    ///
    /// A sample from which no direction leads to its level stays where it is. Cost: two look-ups
    /// and some corrections per sample that moves, one for each that does not.
    pub(super) fn follow(
        &self,
        points: &mut PointSet,
        now: &Raster,
        rates_per_s: &Raster,
        time_s: f64,
    ) -> f64 {
        let before = &*points;
        let spacing_m = now.lattice().spacing_m;
        let moved: Vec<Option<(DVec3, DVec3)>> = self
            .samples
            .par_iter()
            .zip(&self.levels_m)
            .with_min_len(PART)
            .map(|(sample, level_m)| {
                let at = before.positions_map[*sample as usize];
                let density = now.at(at)?;
                if (f64::from(density.value_m) - level_m).abs() <= ON_LEVEL_SPACINGS * spacing_m {
                    return None;
                }
                let rate = f64::from(rates_per_s.at(at)?.value_m);
                moved(now, at, density, rate * time_s, *level_m)
            })
            .collect();
        let mut longest_m: f64 = 0.0;
        for (sample, moved) in self.samples.iter().zip(moved) {
            let Some((at, normal)) = moved else { continue };
            let place = &mut points.positions_map[*sample as usize];
            longest_m = longest_m.max(place.distance(at));
            *place = at;
            points.normals_map[*sample as usize] = normal;
        }
        longest_m
    }
}

/// The place on a level that is found from near it, by steps along the gradient, and the normal
/// there; `None` where none is found within a distance.
pub(super) fn onto_level(
    now: impl Fn(DVec3) -> Option<Density>,
    spacing_m: f64,
    (start, level_m): (DVec3, f64),
    within_m: f64,
) -> Option<(DVec3, DVec3)> {
    let mut at = start;
    for _ in 0..2 * CORRECTIONS {
        let density = now(at)?;
        let (normal, slope) = out(&density)?;
        let off_m = f64::from(density.value_m) - level_m;
        if off_m.abs() <= ON_LEVEL_SPACINGS * spacing_m {
            return (at.distance(start) <= within_m).then_some((at, normal));
        }
        at += normal * (off_m / slope).clamp(-spacing_m, spacing_m);
    }
    None
}

/// The place of the surface on the line from `start` along a unit vector; `None` where the line
/// runs along the surface, or none is found within a distance.
pub(super) fn onto_level_along(
    now: impl Fn(DVec3) -> Option<Density>,
    spacing_m: f64,
    (start, direction): (DVec3, DVec3),
    within_m: f64,
) -> Option<DVec3> {
    let mut way_m: f64 = 0.0;
    for _ in 0..2 * CORRECTIONS {
        let density = now(start + direction * way_m)?;
        let (normal, slope) = out(&density)?;
        let across = normal.dot(direction);
        if across.abs() < ACROSS_MIN {
            return None;
        }
        let off_m = f64::from(density.value_m);
        if off_m.abs() <= ON_LEVEL_SPACINGS * spacing_m {
            return (way_m.abs() <= within_m).then_some(start + direction * way_m);
        }
        way_m += (off_m / (slope * across)).clamp(-spacing_m, spacing_m);
    }
    None
}

/// The normal out of the material, and the slope against it; `None` where the density is level.
fn out(density: &Density) -> Option<(DVec3, f64)> {
    let gradient = density.gradient.as_dvec3();
    let slope = gradient.length();
    (slope >= SLOPE_MIN).then(|| (-gradient / slope, slope))
}

/// Where a sample goes when the density there has changed by `change_m`, and its new normal.
fn moved(
    now: &Raster,
    start: DVec3,
    density: Density,
    change_m: f64,
    level_m: f64,
) -> Option<(DVec3, DVec3)> {
    let spacing_m = now.lattice().spacing_m;
    let longest_m = STEP_MAX_SPACINGS * spacing_m;
    let (normal, slope) = out(&density)?;
    // The rate is that at the end of the step; the rest of the change is left to the corrections.
    let mut way_m = (change_m / slope).clamp(-longest_m, longest_m);
    let mut left_m = f64::INFINITY;
    for _ in 0..CORRECTIONS {
        let density = now.at(start + normal * way_m)?;
        let off_m = f64::from(density.value_m) - level_m;
        if off_m.abs() <= ON_LEVEL_SPACINGS * spacing_m {
            left_m = 0.0;
            break;
        }
        // Slope along the line of motion: the normal may turn on the way.
        let along = -density.gradient.as_dvec3().dot(normal);
        if along.abs() < SLOPE_MIN || off_m.abs() > 4.0 * left_m {
            return None;
        }
        left_m = off_m.abs();
        way_m = (way_m + off_m / along).clamp(-longest_m, longest_m);
    }
    let at = start + normal * way_m;
    let (normal, _) = out(&now.at(at)?)?;
    // The level lies further than one step reaches: the next goes on from there.
    (left_m == 0.0 || way_m.abs() >= longest_m).then_some((at, normal))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dynamics::{Dynamics, Integrator, Material};
    use crate::falloff::Falloff;
    use crate::pull::{PullForce, add_pull};
    use vps::density::Lattice;

    const SPACING_M: f64 = 1e-3;

    fn raster(density: impl Fn(DVec3) -> f64) -> Raster {
        let lattice =
            Lattice { origin_map: DVec3::splat(-0.02), spacing_m: SPACING_M, dims: [41; 3] };
        let mut raster = Raster::uniform(lattice, 0.0);
        for x in 0..41 {
            for y in 0..41 {
                for z in 0..41 {
                    raster.values_m_mut()[lattice.index([x, y, z])] =
                        density(lattice.position([x, y, z])) as f32;
                }
            }
        }
        raster
    }

    /// A plate of samples in the plane z = 0.3 mm.
    fn plate() -> PointSet {
        let mut points = PointSet::default();
        for x in -30..=30 {
            for y in -30..=30 {
                points.positions_map.push(DVec3::new(
                    f64::from(x) * 5e-4,
                    f64::from(y) * 5e-4,
                    3e-4,
                ));
                points.normals_map.push(DVec3::Z);
                points.colors.push([200; 3]);
            }
        }
        points
    }

    fn clay(at_rest: Raster) -> Dynamics {
        let material = Material {
            mass_kg: 1e-4,
            damping_n_s_per_m: 0.5,
            stiffness_n_per_m: 100.0,
            creep_s: f64::INFINITY,
            acceleration_max_m_per_s2: f64::INFINITY,
        };
        Dynamics::new(at_rest, material.into(), Integrator::Implicit)
    }

    #[test]
    fn acceptance_29_samples_stay_on_their_level_through_a_whole_stroke_and_go_along_the_normal_only()
     {
        let mut clay = clay(raster(|at| 3e-4 - at.z));
        let before = plate();
        let mut points = before.clone();
        let afloat = AdvectedSamples::new(&points, clay.now(), 2.0 * SPACING_M);
        assert_eq!(afloat.samples().len(), points.len());
        for _ in 0..100 {
            let pull = PullForce {
                along_map: vec![DVec3::new(0.0, 0.0, 3e-4)],
                force_n: DVec3::Z * 20.0,
                reach_m: 5e-3,
                radius_m: 8e-3,
                falloff: Falloff::Gaussian,
            };
            let (now, forces) = clay.forces_n_mut();
            add_pull(now, &pull, forces);
            clay.update(4e-3);
            let now = clay.now().clone();
            let rates = clay.velocities_m_per_s().clone();
            let turned: Vec<DVec3> = points.positions_map.clone();
            let normals: Vec<DVec3> = afloat
                .samples()
                .iter()
                .map(|n| -now.at(turned[*n as usize]).unwrap().gradient.as_dvec3().normalize())
                .collect();
            afloat.follow(&mut points, &now, &rates, 4e-3);
            for ((before, after), normal) in turned.iter().zip(&points.positions_map).zip(normals) {
                let way = *after - *before;
                assert!(way.reject_from_normalized(normal).length() <= 1e-12, "{way}");
            }
        }
        let highest = points.positions_map.iter().map(|at| at.z).fold(0.0, f64::max);
        assert!(highest > 1.5e-3, "the stroke lifted nothing: {highest}");
        for (at, level) in points.positions_map.iter().zip(afloat.levels_m()) {
            let off = f64::from(clay.now().at(*at).unwrap().value_m) - level;
            assert!(off.abs() <= 1e-3 * SPACING_M, "{at}: {off}");
        }
        for normal in &points.normals_map {
            assert!(normal.is_normalized() && normal.z > 0.0, "{normal}");
        }
    }

    #[test]
    fn a_sphere_that_grows_takes_its_samples_along() {
        let sphere = |radius: f64| raster(move |at| radius - at.length());
        let small = sphere(0.010);
        let large = sphere(0.0104);
        let mut points = PointSet::default();
        for n in 0..500 {
            // A spiral with even steps of height.
            let z = 1.0 - (2.0 * f64::from(n) + 1.0) / 500.0;
            let turn = f64::from(n) * 2.399_963;
            let normal =
                DVec3::new((1.0 - z * z).sqrt() * turn.cos(), (1.0 - z * z).sqrt() * turn.sin(), z);
            points.positions_map.push(normal * 0.010);
            points.normals_map.push(normal);
            points.colors.push([0; 3]);
        }
        let afloat = AdvectedSamples::new(&points, &small, SPACING_M);
        let rates = Raster::uniform(*small.lattice(), 0.1);
        afloat.follow(&mut points, &large, &rates, 4e-3);
        for (at, normal) in points.positions_map.iter().zip(&points.normals_map) {
            // A raster of 1 mm rounds a sphere of 10 mm by some hundredths of that.
            assert!((at.length() - 0.0104).abs() < 5e-5, "{}", at.length());
            // The slope between the nodes of a coarse raster turns by some degrees.
            assert!(normal.dot(at.normalize()) > 0.995, "{normal}");
        }
    }

    #[test]
    fn nothing_moves_where_nothing_changed_and_where_there_is_no_direction() {
        let flat = raster(|_| 1e-3);
        let still = raster(|at| 3e-4 - at.z);
        let before = plate();
        let mut points = before.clone();
        let afloat = AdvectedSamples::new(&points, &still, SPACING_M);
        let rates = Raster::uniform(*still.lattice(), 0.0);
        assert_eq!(afloat.follow(&mut points, &still, &rates, 4e-3), 0.0);
        assert_eq!(points, before);
        assert_eq!(afloat.follow(&mut points, &flat, &rates, 4e-3), 0.0);
        assert_eq!(points, before);
    }

    #[test]
    fn a_long_way_is_gone_in_steps() {
        let still = raster(|at| 3e-4 - at.z);
        let far = raster(|at| 5.3e-3 - at.z);
        let mut points = plate();
        let afloat = AdvectedSamples::new(&points, &still, SPACING_M);
        let rates = Raster::uniform(*still.lattice(), 0.0);
        let ways: Vec<f64> =
            (0..8).map(|_| afloat.follow(&mut points, &far, &rates, 4e-3)).collect();
        assert!(ways.iter().all(|way| *way <= SPACING_M * 1.000_001), "{ways:?}");
        assert!(points.positions_map.iter().all(|at| (at.z - 5.3e-3).abs() < 1e-6), "{ways:?}");
    }
}
