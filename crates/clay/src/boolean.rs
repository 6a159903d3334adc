//! Booleans of two solids that point sets bound.
//!
//! A sample of one surface stays where the field of the other says so (Guo2004, table 1; s > 0
//! inside):
//!
//! | operation | of the first | of the second |
//! |---|---|---|
//! | union | s₂ < 0 | s₁ < 0 |
//! | intersection | s₂ ≥ 0 | s₁ ≥ 0 |
//! | difference | s₂ < 0 | s₁ ≥ 0, turned round |
//!
//! That the normals of the second turn round in a difference is ours to add: they have to point out
//! of what is left.
//!
//! The edge where both meet is kept sharp where it is asked for: what came from the second is then
//! a `Patch` of its own, with fits of its own; the field is the smaller or larger of both (what the
//! paper calls two patches of an implicit surface), and samples are added on both sides up to the
//! edge, as the paper does for rendering (figure 4). Otherwise one field is fitted over all
//! samples, which rounds the edge by about their spacing; away from the edge densities stay what
//! they were.

use glam::DVec3;
use rayon::prelude::*;

use super::work_meter::TREE_STEPS;
use super::{Patch, PointSet, PointSurface, WorkError, WorkMeter};
use vps::density::Raster;

/// Rings of added samples around a sample at the edge, and how far out, in its spacings.
const EDGE_RINGS: [(u32, f64); 2] = [(6, 0.33), (12, 0.66)];
/// Samples this near to the other surface (spacings) have the edge in their ring.
const EDGE_SPACINGS: f64 = 1.0;
/// Samples of both solids that are this near to each other (spacings) are at one place.
const MEET_SPACINGS: f64 = 1e-3;
/// One smooth surface goes over an edge so far to both sides, spacings: fits reach no farther.
const BLENDED_SPACINGS: f64 = 4.0;
/// Samples that are nearer to another (spacings) are not added.
const APART_SPACINGS: f64 = 0.25;

/// What is left of two solids.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Boolean {
    /// What is in one of them.
    Union,
    /// What is in both.
    Intersection,
    /// What is in the first and not in the second.
    Difference,
}

impl Boolean {
    /// A sample of the first stays where the second has this density, m.
    fn keeps_of_first(self, of_second_m: f64) -> bool {
        match self {
            Self::Union | Self::Difference => of_second_m < 0.0,
            Self::Intersection => of_second_m >= 0.0,
        }
    }

    /// A sample of the second stays where the first has this density, m.
    fn keeps_of_second(self, of_first_m: f64) -> bool {
        match self {
            Self::Union => of_first_m < 0.0,
            Self::Intersection | Self::Difference => of_first_m >= 0.0,
        }
    }

    /// The density of what is left, m: the two patches of a sharp result.
    pub(super) fn density_m(self, of_first_m: f32, of_second_m: f32) -> f32 {
        match self {
            Self::Union => of_first_m.max(of_second_m),
            Self::Intersection => of_first_m.min(of_second_m),
            Self::Difference => of_first_m.min(-of_second_m),
        }
    }

    /// The samples of what is left: those of the first before those of the second, each in their
    /// order.
    ///
    /// `is_sharp`: with samples up to the edge. Cost: one look-up of the other field per sample.
    pub(super) fn samples(
        self,
        first: &PointSurface,
        second: &PointSurface,
        is_sharp: bool,
        meter: &WorkMeter,
    ) -> Result<PointSet, WorkError> {
        let mut of_first =
            kept(first, second, |density_m| self.keeps_of_first(density_m), is_sharp, meter)?;
        let mut of_second =
            kept(second, first, |density_m| self.keeps_of_second(density_m), is_sharp, meter)?;
        if self == Self::Difference {
            of_second.normals_map.iter_mut().for_each(|normal| *normal = -*normal);
        }
        meter.take(2 * TREE_STEPS * (of_first.len() + of_second.len()) as u64)?;
        let patch = if is_sharp {
            of_first.last_patch().next(self != Self::Union)
        } else {
            one_patch(
                &mut of_first,
                &of_second,
                BLENDED_SPACINGS * first.spacing_m().max(second.spacing_m()),
            )
        };
        of_second.patches = vec![patch; of_second.len()];
        // Where both surfaces are the same, samples of both may be at one place: no surface goes
        // through two of them.
        let mut taken = super::resample::OccupiedPlaces::new(
            MEET_SPACINGS * first.spacing_m().min(second.spacing_m()),
        );
        of_first.positions_map.iter().for_each(|at| taken.take(*at));
        let apart = (0..of_second.len() as u32)
            .filter(|sample| taken.is_free(of_second.positions_map[*sample as usize]));
        of_first.append(&of_second.select(apart));
        Ok(of_first)
    }

    /// The densities of what is left, node by node, with both on one lattice. The edge is as sharp
    /// as the lattice holds it.
    ///
    /// # Panics
    /// On rasters of two lattices.
    pub(super) fn densities(self, first: &Raster, second: &Raster) -> Raster {
        assert_eq!(first.lattice(), second.lattice(), "rasters of one lattice");
        let mut left = first.clone();
        let both = left.values_m_mut().par_iter_mut().zip(second.values_m());
        both.for_each(|(first_m, second_m)| *first_m = self.density_m(*first_m, *second_m));
        left
    }
}

/// Lets one smooth surface go over the edge: nodes within a distance of both solids' surfaces
/// become those of `smooth`. All on one lattice.
///
/// # Panics
/// On rasters of several lattices.
pub(super) fn blend(
    left: &mut Raster,
    [first, second]: [&Raster; 2],
    smooth: &Raster,
    width_m: f64,
) {
    assert!(
        [first, second, smooth].iter().all(|raster| raster.lattice() == left.lattice()),
        "rasters of one lattice"
    );
    let both = left
        .values_m_mut()
        .par_iter_mut()
        .zip(first.values_m())
        .zip(second.values_m())
        .zip(smooth.values_m());
    both.for_each(|(((left_m, first_m), second_m), smooth_m)| {
        if f64::from(first_m.abs().max(second_m.abs())) < width_m {
            *left_m = *smooth_m;
        }
    });
}

/// The patch that samples of another solid join where one smooth surface is to go over the edge.
/// Patches that come near them become one: their edges are rounded from now on.
fn one_patch(of_first: &mut PointSet, of_second: &PointSet, within_m: f64) -> Patch {
    let second = super::Neighbours::new(&of_second.positions_map);
    let is_near = |at: &DVec3| {
        second.nearest(*at).is_some_and(|near| near.distance_squared_m2 <= within_m * within_m)
    };
    let near = (0..of_first.len() as u32)
        .filter(|sample| is_near(&of_first.positions_map[*sample as usize]));
    let mut met: Vec<Patch> = near.map(|sample| of_first.patch(sample)).collect();
    met.sort_unstable();
    met.dedup();
    let [lowest, others @ ..] = &met[..] else { return Patch::default() };
    of_first
        .patches
        .iter_mut()
        .filter(|patch| others.contains(patch))
        .for_each(|patch| *patch = *lowest);
    *lowest
}

/// Samples of a surface where the field of another keeps them.
fn kept(
    surface: &PointSurface,
    other: &PointSurface,
    keeps: impl Fn(f64) -> bool + Sync,
    is_sharp: bool,
    meter: &WorkMeter,
) -> Result<PointSet, WorkError> {
    let points = surface.points();
    let of_place = |at: &DVec3| {
        let mut steps = 0;
        let value_m = other.at_counted(*at, &mut steps).value_m;
        meter.take(steps).map(|()| value_m)
    };
    let of_other: Vec<f64> =
        points.positions_map.par_iter().map(of_place).collect::<Result<_, _>>()?;
    let mut left =
        points.select((0..points.len() as u32).filter(|sample| keeps(of_other[*sample as usize])));
    if is_sharp {
        // Also around samples that go: the edge may be nearer to them.
        let at_edge = |sample: &u32| {
            of_other[*sample as usize].abs()
                <= EDGE_SPACINGS * surface.spacings_m()[*sample as usize]
        };
        let at_edge: Vec<u32> = (0..points.len() as u32).filter(at_edge).collect();
        let added: Vec<PointSet> = at_edge
            .par_iter()
            .map(|sample| around(surface, other, *sample, &keeps, meter))
            .collect::<Result<_, _>>()?;
        let apart_m = APART_SPACINGS * surface.spacing_m();
        let mut taken = super::resample::OccupiedPlaces::new(apart_m);
        left.positions_map.iter().for_each(|at| taken.take(*at));
        for added in &added {
            meter.take(added.len() as u64)?;
            for n in 0..added.len() {
                if taken.is_free(added.positions_map[n]) {
                    taken.take(added.positions_map[n]);
                    left.append(&added.select(core::iter::once(n as u32)));
                }
            }
        }
    }
    Ok(left)
}

/// More samples in the disc of one, on its surface, where the other field keeps them.
fn around(
    surface: &PointSurface,
    other: &PointSurface,
    sample: u32,
    keeps: &impl Fn(f64) -> bool,
    meter: &WorkMeter,
) -> Result<PointSet, WorkError> {
    let points = surface.points();
    let (at, normal, color) = (
        points.positions_map[sample as usize],
        points.normals_map[sample as usize],
        points.colors[sample as usize],
    );
    let spacing_m = surface.spacings_m()[sample as usize];
    let (u, v) = normal.any_orthonormal_pair();
    let mut added = PointSet::default();
    let mut steps = 0;
    for (n_on_ring, share) in EDGE_RINGS {
        for n in 0..n_on_ring {
            let (sin, cos) =
                (core::f64::consts::TAU * f64::from(n) / f64::from(n_on_ring)).sin_cos();
            let place = at + (u * cos + v * sin) * (share * spacing_m);
            let Some(on_surface) = surface.project_counted(place, &mut steps) else { continue };
            let normal = surface.at_counted(on_surface, &mut steps).normal();
            if keeps(other.at_counted(on_surface, &mut steps).value_m) && normal.is_normalized() {
                added.push(on_surface, normal, color);
                added.set_patch(added.len() as u32 - 1, points.patch(sample));
            }
        }
    }
    meter.take(steps)?;
    Ok(added)
}

#[cfg(test)]
mod tests {
    use core::f64::consts::PI;

    use super::*;
    use vps::density::Lattice;

    const R: f64 = 0.01;

    fn sphere(center: DVec3) -> PointSurface {
        let mut points = PointSet::default();
        let n = 3000;
        for i in 0..n {
            let z = 1.0 - (2.0 * f64::from(i) + 1.0) / f64::from(n);
            let turn = f64::from(i) * 2.399_963_229_728_653;
            let normal =
                DVec3::new((1.0 - z * z).sqrt() * turn.cos(), (1.0 - z * z).sqrt() * turn.sin(), z);
            points.push(center + normal * R, normal, [0; 3]);
        }
        PointSurface::build(points, PointSurface::DEFAULT_NEIGHBOURS).unwrap()
    }

    /// Two spheres a radius apart: (5/12) π R³ are in both.
    fn volumes() -> [(Boolean, f64); 3] {
        let one = 4.0 / 3.0 * PI * R.powi(3);
        let both = 5.0 / 12.0 * PI * R.powi(3);
        [
            (Boolean::Union, 2.0 * one - both),
            (Boolean::Intersection, both),
            (Boolean::Difference, one - both),
        ]
    }

    fn lattice() -> Lattice {
        let spacing_m = 4e-4;
        Lattice { origin_map: DVec3::new(-0.012, -0.012, -0.012), spacing_m, dims: [86, 61, 61] }
    }

    /// Volume inside, with the nodes beside the surface counted by their share.
    fn volume(raster: &Raster) -> f64 {
        let h = raster.lattice().spacing_m;
        raster
            .values_m()
            .iter()
            .map(|value| (f64::from(*value) / h + 0.5).clamp(0.0, 1.0))
            .sum::<f64>()
            * h.powi(3)
    }

    #[test]
    fn acceptance_27_samples_are_classified_as_the_analytic_spheres_say() {
        let first = sphere(DVec3::ZERO);
        let second = sphere(DVec3::X * R);
        let of_first = |at: DVec3| R - at.length();
        let of_second = |at: DVec3| R - at.distance(DVec3::X * R);
        for (boolean, _) in volumes() {
            let left = boolean.samples(&first, &second, false, &WorkMeter::unlimited()).unwrap();
            let expected_first = first
                .points()
                .positions_map
                .iter()
                .filter(|at| boolean.keeps_of_first(of_second(**at)))
                .count();
            let expected_second = second
                .points()
                .positions_map
                .iter()
                .filter(|at| boolean.keeps_of_second(of_first(**at)))
                .count();
            assert_eq!(left.len(), expected_first + expected_second, "{boolean:?}");
            for (at, normal) in left.positions_map.iter().zip(&left.normals_map) {
                // Out of what is left: a little way out the solid ends.
                let out = *at + *normal * 1e-4;
                let inside = boolean.density_m(of_first(out) as f32, of_second(out) as f32) > 0.0;
                assert!(!inside, "{boolean:?}: {at}");
            }
        }
    }

    #[test]
    fn acceptance_27_volumes_are_those_of_the_spheres() {
        let first = sphere(DVec3::ZERO);
        let second = sphere(DVec3::X * R);
        let first_m = first.rasterize(lattice(), &WorkMeter::unlimited()).unwrap();
        let second_m = second.rasterize(lattice(), &WorkMeter::unlimited()).unwrap();
        for (boolean, expected) in volumes() {
            let sharp = volume(&boolean.densities(&first_m, &second_m));
            assert!((sharp / expected - 1.0).abs() < 0.02, "{boolean:?}: {sharp} of {expected}");
            let blended = PointSurface::build(
                boolean.samples(&first, &second, false, &WorkMeter::unlimited()).unwrap(),
                PointSurface::DEFAULT_NEIGHBOURS,
            )
            .unwrap();
            let blended = volume(&blended.rasterize(lattice(), &WorkMeter::unlimited()).unwrap());
            assert!(
                (blended / expected - 1.0).abs() < 0.02,
                "{boolean:?}, blended: {blended} of {expected}"
            );
        }
    }

    #[test]
    fn a_sharp_edge_has_samples_right_up_to_it() {
        let first = sphere(DVec3::ZERO);
        let second = sphere(DVec3::X * R);
        let spacing = first.spacing_m();
        // The edge is a circle in the plane x = R/2.
        let nearest = |points: &PointSet| {
            let from_edge = |at: &DVec3| {
                DVec3::new(at.x - 0.5 * R, at.y.hypot(at.z) - 0.75_f64.sqrt() * R, 0.0).length()
            };
            let mut worst: f64 = 0.0;
            for n in 0..90 {
                let (sin, cos) = (f64::from(n) * PI / 45.0).sin_cos();
                let on_edge =
                    DVec3::new(0.5 * R, 0.75_f64.sqrt() * R * cos, 0.75_f64.sqrt() * R * sin);
                let beside = points.positions_map.iter().filter(|at| from_edge(at) < 2.0 * spacing);
                worst =
                    worst.max(beside.map(|at| at.distance(on_edge)).fold(f64::INFINITY, f64::min));
            }
            worst
        };
        let blunt = nearest(
            &Boolean::Union.samples(&first, &second, false, &WorkMeter::unlimited()).unwrap(),
        );
        let sharp = nearest(
            &Boolean::Union.samples(&first, &second, true, &WorkMeter::unlimited()).unwrap(),
        );
        assert!(
            sharp < 0.4 * spacing && sharp < 0.7 * blunt,
            "{sharp} against {blunt}, spacing {spacing}"
        );
    }
}
