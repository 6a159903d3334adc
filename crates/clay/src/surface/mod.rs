//! The surface that goes through the samples: one field, blended from a fit around each of them.
//!
//! Sign: greater than 0 inside. In the shell around the samples the field is that of the fits;
//! beyond, the distance to the nearest sample with the sign of the side of the surface. Between the
//! two it fades over, so it is continuous everywhere.
//!
//! Invariant: same samples, same bits, on any number of threads.
//!
//! # Source
//! Guo2004, local and global surface distance fields: equations 2, 3 and 5. Ours: the domain of a
//! sample ends before samples that face the other way (thin walls), and is never much larger than
//! the domains of most samples (strays).

mod blend;
mod border;
mod edit;
mod rasterize;
mod side;
mod voronoi;

use glam::DVec3;
use rayon::prelude::*;

use self::blend::Blend;
pub(super) use self::edit::SampleMove;
pub(super) use self::rasterize::NODE_STEPS;
use self::side::DipoleTree;
use super::local_fit::{LocalFit, OrientedPoint};
use super::neighbours::{Neighbour, Neighbours};
use super::work_meter::{FIT_STEPS, SIDE_STEPS, TREE_STEPS};
use super::{Patch, PointSet, SurfaceError, WorkError, WorkMeter};

/// Nearest others whose mean distance is the spacing: a sample amid even ones has six around it.
const RING: usize = 6;
/// Area of a sample over its squared spacing, for samples that are even (0.87) or random with a
/// least distance (0.8).
const AREA_PER_SPACING: f64 = 0.85;
/// Cosine of the angle between normals below which two samples belong to different sides of a wall.
const OPPOSITE_COSINE: f64 = -0.3;
/// Share of the way to the other side of a wall at which a domain ends.
const WALL_SHARE: f64 = 0.8;
/// A domain has this many spacings at least, or the surface would have gaps between samples.
const LEAST_SPACINGS: f64 = 1.3;
/// Domains are at most this many times as large as the middle one of all.
const MOST_OF_MEDIAN: f64 = 4.0;
/// Steps of a projection. From within the shell five are enough.
const PROJECTION_STEPS: usize = 30;
/// A projection ends this close to the surface, in spacings.
const PROJECTION_TOLERANCE: f64 = 1e-9;

/// Value and slope of the field.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Distance {
    /// s, m; greater than 0 inside.
    pub value_m: f64,
    /// ∇s, m/m, map axes: points **into** the material.
    pub gradient: DVec3,
}

impl Distance {
    /// Unit, out of the material; zero where the field is flat.
    pub fn normal(&self) -> DVec3 {
        -self.gradient.normalize_or_zero()
    }
}

/// An implicit surface through samples.
#[derive(Clone, Debug)]
pub struct PointSurface {
    points: PointSet,
    n_neighbours: usize,
    near: Neighbours,
    side: DipoleTree,
    /// `[n]`, m: how far apart samples are around each of them.
    spacings_m: Vec<f64>,
    /// `[n]`.
    fits: Vec<LocalFit>,
    /// The middle one of `spacings_m`.
    spacing_m: f64,
    /// The largest domain.
    reach_m: f64,
    /// Of each node of the tree, m: the largest domain of its samples.
    reaches_m: Vec<f64>,
    /// Not all samples are of one patch.
    has_patches: bool,
    /// The field is 0 at every sample.
    interpolates: bool,
}

/// What a sample and its neighbours say of its domain.
struct Domain {
    spacing_m: f64,
    half_m: f64,
    /// Those on the same side of a wall, nearest first.
    neighbours: Vec<u32>,
}

impl PointSurface {
    /// How many neighbours a fit can have.
    pub const NEIGHBOURS: std::ops::RangeInclusive<usize> = 8..=128;
    /// How many suit most surfaces.
    pub const DEFAULT_NEIGHBOURS: usize = 24;

    /// Fits a field to every sample and its `n_neighbours` nearest, itself among them. Parallel;
    /// 67,038 samples take about a second on two cores.
    ///
    /// # Errors
    /// [`SurfaceError`] for samples that make no surface, naming the first one that is wrong.
    pub fn build(points: PointSet, n_neighbours: usize) -> Result<Self, SurfaceError> {
        Self::build_within(points, n_neighbours, &WorkMeter::unlimited())
    }

    /// The same, with steps from a meter.
    pub(super) fn build_within(
        points: PointSet,
        n_neighbours: usize,
        meter: &WorkMeter,
    ) -> Result<Self, SurfaceError> {
        if !Self::NEIGHBOURS.contains(&n_neighbours) {
            return Err(SurfaceError::Neighbours { found: n_neighbours });
        }
        points.check()?;
        meter.take(TREE_STEPS * points.len() as u64)?;
        let near = Neighbours::new(&points.positions_map);
        let mut surface = Self { points, near, ..Self::nothing(n_neighbours) };
        let samples: Vec<u32> = (0..surface.points.len() as u32).collect();
        let domains = surface.domains(&samples, meter)?;
        let most_m = MOST_OF_MEDIAN * median(domains.iter().map(|domain| domain.half_m));
        surface.fits = samples
            .par_iter()
            .zip(&domains)
            .map(|(sample, domain)| surface.fit(*sample, domain, most_m, meter))
            .collect::<Result<_, _>>()?;
        surface.spacings_m = domains.iter().map(|domain| domain.spacing_m).collect();
        surface.measure();
        Ok(surface)
    }

    /// The same samples, met exactly: each fit is 0 at its own sample, where its weight grows
    /// without bound (φ → ∞). The field then follows the noise of a scan as well.
    ///
    /// # Source
    /// Guo2004, equation 3.
    pub fn interpolating(mut self) -> Self {
        self.interpolates = true;
        self.fits = self.fits.into_par_iter().map(LocalFit::meeting_its_sample).collect();
        self
    }

    /// No sample yet.
    fn nothing(n_neighbours: usize) -> Self {
        Self {
            points: PointSet::default(),
            n_neighbours,
            near: Neighbours::default(),
            side: DipoleTree::default(),
            spacings_m: Vec::new(),
            fits: Vec::new(),
            spacing_m: 0.0,
            reach_m: 0.0,
            reaches_m: Vec::new(),
            has_patches: false,
            interpolates: false,
        }
    }

    /// How much a fit counts at a squared distance from its sample, and the slope of that over the
    /// distance.
    fn weight(&self, fit: &LocalFit, distance_squared_m2: f64) -> (f64, f64) {
        if self.interpolates {
            fit.unbounded_weight(distance_squared_m2)
        } else {
            fit.weight(distance_squared_m2)
        }
    }

    /// What it takes in memory, bytes; trees over the samples count as two samples each.
    pub(super) fn n_bytes(&self) -> usize {
        let of_sample = size_of::<LocalFit>() + size_of::<f64>();
        3 * self.points.n_bytes() + self.fits.len() * of_sample
    }

    /// The samples.
    pub fn points(&self) -> &PointSet {
        &self.points
    }

    /// Places and normals of the samples, and their colours, which may change at any time.
    pub(super) fn colors_mut(&mut self) -> (&[DVec3], &[DVec3], &mut [[u8; 3]]) {
        let PointSet { positions_map, normals_map, colors, .. } = &mut self.points;
        (positions_map, normals_map, colors)
    }

    /// Samples that a fit takes into account.
    pub(super) fn n_neighbours(&self) -> usize {
        self.n_neighbours
    }

    /// Where the samples are.
    pub(crate) fn neighbours(&self) -> &Neighbours {
        &self.near
    }

    /// How far apart samples are, m: the middle one of all distances.
    pub fn spacing_m(&self) -> f64 {
        self.spacing_m
    }

    /// `[n]`, m: how far apart samples are around each of them.
    pub fn spacings_m(&self) -> &[f64] {
        &self.spacings_m
    }

    /// `[n]`: half of the edge of each sample's domain, m.
    fn domains_m(&self) -> impl ExactSizeIterator<Item = f64> {
        self.fits.iter().map(|fit| fit.half_m)
    }

    /// Lowest and highest corner of the box around the samples, map frame, m.
    pub fn bounds(&self) -> (DVec3, DVec3) {
        self.points.bounds().unwrap_or_default()
    }

    /// The samples go around a body; false for a sheet, and for less than about half of a surface.
    pub fn is_closed(&self) -> bool {
        self.side.is_closed()
    }

    /// The field at a point: equation 3. NaN gives NaN.
    pub fn at(&self, point_map: DVec3) -> Distance {
        self.at_counted(point_map, &mut 0)
    }

    /// The same; adds the steps that it takes.
    pub(super) fn at_counted(&self, point_map: DVec3, steps: &mut u64) -> Distance {
        let mut found = Vec::with_capacity(4 * self.n_neighbours);
        self.near.covering(point_map, &self.reaches_m, &mut found);
        *steps += 1 + found.len() as u64;
        let mut blend = Blend::default();
        if self.has_patches {
            let mut blends: Vec<(Patch, Blend)> = Vec::new();
            for Neighbour { sample, distance_squared_m2 } in &found {
                let patch = self.points.patch(*sample);
                let place = blends.partition_point(|(other, _)| *other < patch);
                if blends.get(place).is_none_or(|(other, _)| *other != patch) {
                    blends.insert(place, (patch, Blend::default()));
                }
                let fit = &self.fits[*sample as usize];
                blends[place].1.add(fit, point_map, self.weight(fit, *distance_squared_m2));
            }
            blend = Blend::joined(&blends);
        } else {
            for Neighbour { sample, distance_squared_m2 } in &found {
                let fit = &self.fits[*sample as usize];
                blend.add(fit, point_map, self.weight(fit, *distance_squared_m2));
            }
        }
        if blend.is_full() {
            return blend.distance();
        }
        *steps += SIDE_STEPS;
        match self.near.nearest(point_map) {
            Some(nearest) => blend.fade(self.far(nearest.sample, point_map)),
            None => Distance { value_m: f64::NAN, gradient: DVec3::NAN },
        }
    }

    /// The field beyond the shell, from the nearest sample.
    fn far(&self, nearest: u32, point_map: DVec3) -> Distance {
        let sign = if self.is_inside(nearest, point_map) { 1.0 } else { -1.0 };
        let (position_map, normal) = self.oriented(nearest);
        let way = point_map - position_map;
        Distance {
            value_m: sign * way.length(),
            gradient: way.try_normalize().map_or(-normal, |way| way * sign),
        }
    }

    fn is_inside(&self, nearest: u32, point_map: DVec3) -> bool {
        let (position_map, normal) = self.oriented(nearest);
        self.side.is_inside(&self.near, point_map, normal.dot(point_map - position_map) <= 0.0)
    }

    /// The point of the surface that steps along the gradient lead to; `None` when they lead
    /// nowhere.
    pub fn project(&self, point_map: DVec3) -> Option<DVec3> {
        self.project_counted(point_map, &mut 0)
    }

    /// The same; adds the steps that it takes.
    pub(super) fn project_counted(&self, point_map: DVec3, steps: &mut u64) -> Option<DVec3> {
        let mut at = point_map;
        for _ in 0..PROJECTION_STEPS {
            let Distance { value_m, gradient } = self.at_counted(at, steps);
            if value_m.abs() <= PROJECTION_TOLERANCE * self.spacing_m {
                return Some(at);
            }
            let step = gradient * (-value_m / gradient.length_squared());
            if !step.is_finite() {
                return None;
            }
            // A flat place must not throw the point off the shell.
            at += step.clamp_length_max(self.reach_m.max(1.5 * value_m.abs()));
        }
        None
    }

    fn oriented(&self, sample: u32) -> OrientedPoint {
        (self.points.positions_map[sample as usize], self.points.normals_map[sample as usize])
    }

    fn is_opposite(&self, sample: u32, other: u32) -> bool {
        self.oriented(sample).1.dot(self.oriented(other).1) < OPPOSITE_COSINE
    }

    /// Spacing and domain of a sample. `found` is for its neighbours.
    fn domain(&self, sample: u32, found: &mut Vec<Neighbour>) -> Result<Domain, SurfaceError> {
        let (position_map, _) = self.oriented(sample);
        self.near.nearest_n(position_map, self.n_neighbours, found);
        // The sample itself is the first, unless another one is at its place.
        if let [first, second, ..] = found[..]
            && second.distance_squared_m2 == 0.0
        {
            let first = first.sample as usize;
            let second = second.sample as usize;
            return Err(SurfaceError::Coincident { first, second, position_map });
        }
        let ring = &found[1..(1 + RING).min(found.len())];
        let spacing_m = ring.iter().map(|other| other.distance_squared_m2.sqrt()).sum::<f64>()
            / ring.len() as f64;
        let farthest_m = found.last().map_or(0.0, |last| last.distance_squared_m2.sqrt());
        // Other patches have fields of their own.
        let patch = self.points.patch(sample);
        let is_beside = |other: &&Neighbour| self.points.patch(other.sample) == patch;
        let wall =
            found.iter().filter(is_beside).find(|other| self.is_opposite(sample, other.sample));
        let wall_m =
            wall.map_or(f64::INFINITY, |other| WALL_SHARE * other.distance_squared_m2.sqrt());
        let beside = found.iter().filter(is_beside).map(|other| other.sample);
        let neighbours = beside.filter(|other| !self.is_opposite(sample, *other)).collect();
        Ok(Domain {
            spacing_m,
            half_m: farthest_m.min(wall_m.max(LEAST_SPACINGS * spacing_m)),
            neighbours,
        })
    }

    /// Spacings, domains and neighbours of samples.
    fn domains(&self, samples: &[u32], meter: &WorkMeter) -> Result<Vec<Domain>, SurfaceError> {
        let domain = |found: &mut Vec<Neighbour>, sample: &u32| {
            meter.take(self.n_neighbours as u64)?;
            self.domain(*sample, found)
        };
        samples.par_iter().map_init(Vec::new, domain).collect()
    }

    /// The fit of a sample, in a domain of `most_m` at most.
    fn fit(
        &self,
        sample: u32,
        domain: &Domain,
        most_m: f64,
        meter: &WorkMeter,
    ) -> Result<LocalFit, WorkError> {
        meter.take(FIT_STEPS * domain.neighbours.len() as u64)?;
        let neighbours =
            domain.neighbours.iter().map(|other| (self.oriented(*other), 0.0)).collect();
        let fit = LocalFit::to_neighbours(
            self.oriented(sample),
            domain.half_m.min(most_m),
            domain.spacing_m,
            neighbours,
        );
        Ok(if self.interpolates { fit.meeting_its_sample() } else { fit })
    }

    /// The fit of a sample to a distance that its neighbours are to have from the surface, m, its
    /// own met exactly; `None` where all of them are 0.
    ///
    /// # Errors
    /// [`SurfaceError::Coincident`].
    pub(crate) fn fit_to_distances(
        &self,
        sample: u32,
        distance_m: impl Fn(u32) -> f64,
    ) -> Result<Option<LocalFit>, SurfaceError> {
        let domain = self.domain(sample, &mut Vec::new())?;
        if domain.neighbours.iter().all(|other| distance_m(*other) == 0.0) {
            return Ok(None);
        }
        let half_m = self.fits[sample as usize].half_m;
        let neighbours = domain
            .neighbours
            .iter()
            .map(|other| (self.oriented(*other), distance_m(*other)))
            .collect();
        let fit =
            LocalFit::to_neighbours(self.oriented(sample), half_m, domain.spacing_m, neighbours);
        let off_m = distance_m(sample) - fit.at(self.oriented(sample).0).0;
        Ok(Some(fit.raised(off_m)))
    }

    /// What follows from samples, spacings and fits.
    fn measure(&mut self) {
        // Samples that lie at this distance from six others have so much of the surface each.
        let areas_m2: Vec<f64> = self
            .spacings_m
            .iter()
            .map(|spacing_m| AREA_PER_SPACING * spacing_m * spacing_m)
            .collect();
        self.side = DipoleTree::new(&self.near, &self.points.normals_map, &areas_m2);
        self.spacing_m = median(self.spacings_m.iter().copied());
        self.reach_m = self.domains_m().fold(0.0, f64::max);
        let mut reaches_m = vec![0.0; self.near.n_nodes()];
        self.near.for_each_node(|node, range, _, _| {
            let domains_m =
                self.near.samples()[range].iter().map(|sample| self.fits[*sample as usize].half_m);
            reaches_m[node] = domains_m.fold(0.0, f64::max);
        });
        self.reaches_m = reaches_m;
        self.has_patches = self.points.patches.iter().any(|patch| *patch != self.points.patch(0));
    }
}

/// The middle one of numbers; 0 when there are none.
pub(super) fn median(numbers: impl Iterator<Item = f64>) -> f64 {
    let mut numbers: Vec<f64> = numbers.collect();
    let middle = numbers.len() / 2;
    if numbers.is_empty() { 0.0 } else { *numbers.select_nth_unstable_by(middle, f64::total_cmp).1 }
}

#[cfg(test)]
mod tests;
