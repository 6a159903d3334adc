//! Samples that move, come and go.
//!
//! Look-ups answer for the new samples as soon as a call returns. Cost: the tree is built again
//! (some milliseconds for 67,038 samples); fits are made again where it matters.

use glam::DVec3;
use rayon::prelude::*;

use super::super::local_fit::{LocalFit, OrientedPoint};
use super::super::neighbours::{Neighbour, Neighbours};
use super::super::work_meter::TREE_STEPS;
use super::super::{Patch, PointSet, SurfaceError, WorkError, WorkMeter};
use super::{MOST_OF_MEDIAN, PointSurface, median};

/// Samples nearby that are asked which patch a new one is of; those whose normals are within this
/// cosine first.
const ASKED_FOR_PATCH: usize = 12;
const SAME_FACE: f64 = 0.8;

/// A sample and where it goes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct SampleMove {
    /// Number of the sample.
    pub(crate) sample: u32,
    /// Where it goes, map frame, m.
    pub(crate) position_map: DVec3,
    /// Its normal there: unit, out of the material.
    pub(crate) normal_map: DVec3,
}

impl PointSurface {
    /// Moves samples. Their fits go along, unchanged: [`Self::refresh`] or [`Self::refit`] follows
    /// when the movement is over.
    ///
    /// # Errors
    /// [`SurfaceError`] for a place or a normal that cannot be used; nothing has moved then.
    pub(crate) fn move_samples(&mut self, moved: &[SampleMove]) -> Result<(), SurfaceError> {
        for SampleMove { sample, position_map, normal_map } in moved {
            PointSet::check_sample(*sample as usize, *position_map, *normal_map)?;
        }
        for SampleMove { sample, position_map, normal_map } in moved {
            let sample = *sample as usize;
            self.points.positions_map[sample] = *position_map;
            self.points.normals_map[sample] = *normal_map;
            self.fits[sample].center_map = *position_map;
        }
        self.near = Neighbours::new(&self.points.positions_map);
        self.measure();
        Ok(())
    }

    /// Takes the fits of samples from a field that has changed, m: values at 27 places each, no
    /// least squares. Where the field does not cover a domain, neighbours are fitted.
    ///
    /// # Errors
    /// [`SurfaceError::Coincident`] where neighbours would have to be fitted and are at one place.
    ///
    /// # Source
    /// Guo2004, equation 5.
    pub(crate) fn refresh(
        &mut self,
        samples: &[u32],
        field: impl Fn(DVec3) -> Option<f64> + Sync,
        meter: &WorkMeter,
    ) -> Result<(), SurfaceError> {
        let refreshed: Vec<Option<LocalFit>> = samples
            .par_iter()
            .map_init(Vec::new, |found, sample| {
                let LocalFit { center_map, half_m, .. } = self.fits[*sample as usize];
                // The field is as fine as its lattice, and an edge between patches finer.
                let is_at_edge = self.has_patches && {
                    self.near.within(center_map, half_m, found);
                    found
                        .iter()
                        .any(|other| self.points.patch(other.sample) != self.points.patch(*sample))
                };
                if is_at_edge { None } else { LocalFit::to_field(center_map, half_m, &field) }
            })
            .collect();
        let mut left = Vec::new();
        for (sample, fit) in samples.iter().zip(refreshed) {
            match fit {
                Some(fit) if self.interpolates => {
                    self.fits[*sample as usize] = fit.meeting_its_sample()
                }
                Some(fit) => self.fits[*sample as usize] = fit,
                None => left.push(*sample),
            }
        }
        self.refit(&left, meter)
    }

    /// Fits samples to their neighbours again.
    ///
    /// # Errors
    /// [`SurfaceError::Coincident`] for samples at one place; no fit has changed then.
    pub(crate) fn refit(&mut self, samples: &[u32], meter: &WorkMeter) -> Result<(), SurfaceError> {
        // New samples have no domain yet.
        let known = median(self.domains_m().filter(|half_m| *half_m > 0.0));
        let most_m = if known > 0.0 { MOST_OF_MEDIAN * known } else { f64::INFINITY };
        let domains = self.domains(samples, meter)?;
        let fits: Vec<LocalFit> = samples
            .par_iter()
            .zip(&domains)
            .map(|(sample, domain)| self.fit(*sample, domain, most_m, meter))
            .collect::<Result<_, _>>()?;
        for ((sample, domain), fit) in samples.iter().zip(&domains).zip(fits) {
            self.spacings_m[*sample as usize] = domain.spacing_m;
            self.fits[*sample as usize] = fit;
        }
        if !samples.is_empty() {
            self.measure();
        }
        Ok(())
    }

    /// Which samples have one of these places in their domain.
    fn have_one_of(
        &self,
        positions_map: &[DVec3],
        meter: &WorkMeter,
    ) -> Result<Vec<bool>, WorkError> {
        let reached: Vec<Vec<u32>> = positions_map
            .par_iter()
            .map_init(Vec::new, |found, position_map| {
                self.near.covering(*position_map, &self.reaches_m, found);
                meter.take(1 + found.len() as u64)?;
                let has_it = |sample: u32| {
                    let fit = &self.fits[sample as usize];
                    fit.center_map.distance_squared(*position_map) <= fit.half_m * fit.half_m
                };
                let found = found.iter().map(|other| other.sample);
                Ok(found.filter(|sample| has_it(*sample)).collect())
            })
            .collect::<Result<_, _>>()?;
        let mut have_one = vec![false; self.points.len()];
        reached.iter().flatten().for_each(|sample| have_one[*sample as usize] = true);
        Ok(have_one)
    }

    /// Moves samples, and fits again those that have where one was or is in their domain: the
    /// others stay as they are.
    ///
    /// # Errors
    /// As [`Self::move_samples`]; [`SurfaceError::Coincident`] for samples that have come to one
    /// place, and then they have moved.
    pub(crate) fn move_and_refit(
        &mut self,
        moved: &[SampleMove],
        meter: &WorkMeter,
    ) -> Result<(), SurfaceError> {
        let were_map: Vec<DVec3> =
            moved.iter().map(|moved| self.points.positions_map[moved.sample as usize]).collect();
        let had_one = self.have_one_of(&were_map, meter)?;
        self.move_samples(moved)?;
        let are_map: Vec<DVec3> = moved.iter().map(|moved| moved.position_map).collect();
        let have_one = self.have_one_of(&are_map, meter)?;
        let touched =
            had_one.iter().zip(have_one).zip(0_u32..).filter(|((had, has), _)| **had || *has);
        let touched: Vec<u32> = touched.map(|(_, sample)| sample).collect();
        self.refit(&touched, meter)
    }

    /// The patch of the nearest sample that faces the same way.
    fn patch_of(&self, (at_map, normal_map): OrientedPoint, found: &mut Vec<Neighbour>) -> Patch {
        self.near.nearest_n(at_map, ASKED_FOR_PATCH, found);
        let faces = |other: &&Neighbour| self.oriented(other.sample).1.dot(normal_map) > SAME_FACE;
        let nearest = found.iter().find(faces).or(found.first());
        nearest.map_or(Patch::default(), |nearest| self.points.patch(nearest.sample))
    }

    /// Takes samples away and adds others. The new ones are of the patches beside them. Those that
    /// stay keep their order and come first, then the new ones. Fits are made for the new ones, and
    /// for those that have one of either in their domain.
    ///
    /// # Errors
    /// [`SurfaceError`] when what is left makes no surface; nothing has changed then.
    pub(crate) fn replace(
        &mut self,
        removed: &[u32],
        added: &PointSet,
        meter: &WorkMeter,
    ) -> Result<(), SurfaceError> {
        let mut stays = vec![true; self.points.len()];
        for sample in removed {
            if let Some(stays) = stays.get_mut(*sample as usize) {
                *stays = false;
            }
        }
        let kept: Vec<u32> =
            (0..self.points.len() as u32).filter(|sample| stays[*sample as usize]).collect();
        let mut points = self.points.select(kept.iter().copied());
        points.append(added);
        if self.has_patches {
            let mut found = Vec::new();
            for sample in kept.len() as u32..points.len() as u32 {
                let of =
                    (points.positions_map[sample as usize], points.normals_map[sample as usize]);
                points.set_patch(sample, self.patch_of(of, &mut found));
            }
        }
        points.check()?;
        meter.take(TREE_STEPS * (points.len() + added.len()) as u64)?;
        let near = Neighbours::new(&points.positions_map);

        // Old samples that have a new or a lost one in their domain.
        let gone = stays
            .iter()
            .zip(&self.points.positions_map)
            .filter(|(stays, _)| !**stays)
            .map(|(_, position)| *position);
        let changed: Vec<DVec3> = gone.chain(added.positions_map.iter().copied()).collect();
        let is_touched = self.have_one_of(&changed, meter)?;
        let touched =
            kept.iter().zip(0..).filter(|(old, _)| is_touched[**old as usize]).map(|(_, new)| new);
        let touched: Vec<u32> = touched.chain(kept.len() as u32..points.len() as u32).collect();

        // New ones get their fit below.
        let fits = kept.iter().map(|sample| self.fits[*sample as usize].clone());
        let empty = added.positions_map.iter().map(|position| LocalFit::nothing(*position));
        let mut next = Self {
            fits: fits.chain(empty).collect(),
            spacings_m: kept
                .iter()
                .map(|sample| self.spacings_m[*sample as usize])
                .chain(vec![0.0; added.len()])
                .collect(),
            points,
            near,
            interpolates: self.interpolates,
            ..Self::nothing(self.n_neighbours)
        };
        next.refit(&touched, meter)?;
        if touched.is_empty() {
            next.measure();
        }
        *self = next;
        Ok(())
    }
}
