//! What a stroke leaves to the surface.

use glam::DVec3;
use rayon::prelude::*;

use super::super::advect::AdvectedSamples;
use super::super::{
    Neighbours, PointSet, PointSurface, SampleMove, SurfaceError, WorkMeter, resample,
};
use super::CLOSE_SPACINGS;
use vps::density::{Lattice, Raster};

/// What moved by less, in spacings of the raster, has not moved.
const FAINT_SPACINGS: f64 = 0.02;

/// m.
pub(super) fn faint_m(lattice: &Lattice) -> f64 {
    FAINT_SPACINGS * lattice.spacing_m
}

/// Samples that are afloat and farther from where they were before than a distance; those that came
/// since are among them.
pub(super) fn moved_by(
    points: &PointSet,
    before: &PointSet,
    afloat: &AdvectedSamples,
    least_m: f64,
) -> Vec<u32> {
    let has_moved = |sample: &u32| {
        let was_map = before.positions_map.get(*sample as usize);
        was_map.is_none_or(|was_map| {
            points.positions_map[*sample as usize].distance(*was_map) > least_m
        })
    };
    afloat.samples().iter().copied().filter(has_moved).collect()
}

/// Takes faint motion back, of samples and of densities. A force reaches all of a region, most of
/// it next to not; what is taken from the raster again becomes as smooth as the raster, so relief
/// and edges far from the tool are better left alone.
///
/// `now`: the densities to become those of the region; `moved`: as the stroke left them; `rest`: as
/// it found them.
pub(super) fn forget_faint(
    points: &mut PointSet,
    before: &PointSet,
    now: &mut Raster,
    moved: &Raster,
    rest: &Raster,
) {
    let faint_m = faint_m(now.lattice());
    for (sample, (position, normal)) in
        before.positions_map.iter().zip(&before.normals_map).enumerate()
    {
        if points.positions_map[sample].distance(*position) < faint_m {
            points.positions_map[sample] = *position;
            points.normals_map[sample] = *normal;
        }
    }
    for ((now_m, moved_m), rest_m) in
        now.values_m_mut().iter_mut().zip(moved.values_m()).zip(rest.values_m())
    {
        if f64::from(moved_m - rest_m).abs() < faint_m {
            *now_m = *rest_m;
        }
    }
}

/// Fills empty circles beside samples that an image, a Boolean or another region has changed, and
/// takes those away that were squeezed together since `before`, whose numbers are those of the
/// surface. New samples lie on the densities of `base`.
///
/// # Errors
/// [`SurfaceError`]; nothing has changed then.
pub(super) fn make_even(
    surface: &mut PointSurface,
    before: &PointSet,
    looked_at: &[u32],
    base: &Raster,
    gap_m: f64,
    meter: &WorkMeter,
) -> Result<(), SurfaceError> {
    let mut points = surface.points().clone();
    let n_before = points.len() as u32;
    let mut afloat = AdvectedSamples::new(&points, base, 0.0);
    resample::fill(&mut points, &mut afloat, looked_at, base, gap_m, meter)?;
    let may_go: Vec<u32> = looked_at.iter().copied().chain(n_before..points.len() as u32).collect();
    let close_m = CLOSE_SPACINGS * surface.spacing_m();
    let kept = resample::thinned(&points, before, &may_go, close_m, meter)?;
    if kept.len() == n_before as usize && points.len() == kept.len() {
        return Ok(());
    }
    let mut stays = vec![false; points.len()];
    kept.iter().for_each(|sample| stays[*sample as usize] = true);
    let removed: Vec<u32> = (0..n_before).filter(|sample| !stays[*sample as usize]).collect();
    surface.replace(
        &removed,
        &points.select(kept.iter().copied().filter(|sample| *sample >= n_before)),
        meter,
    )
}

/// Samples with one of a tree within a distance, ascending.
pub(super) fn near_to(points: &PointSet, tree: &Neighbours, within_m: f64) -> Vec<u32> {
    let is_near = |at: &DVec3| {
        tree.nearest(*at).is_some_and(|nearest| nearest.distance_squared_m2 <= within_m * within_m)
    };
    let are_near: Vec<bool> = points.positions_map.par_iter().map(is_near).collect();
    (0..points.len() as u32).filter(|sample| are_near[*sample as usize]).collect()
}

/// Lets a surface have the samples of a stroke: those that moved, without those that go, and with
/// those that came.
pub(super) fn adopt(
    surface: &mut PointSurface,
    points: &PointSet,
    kept: &[u32],
    n_before: usize,
    base: &Raster,
) -> Result<(), SurfaceError> {
    let before = surface.points();
    let moved: Vec<SampleMove> = (0..n_before)
        .filter(|sample| before.positions_map[*sample] != points.positions_map[*sample])
        .map(|sample| SampleMove {
            sample: sample as u32,
            position_map: points.positions_map[sample],
            normal_map: points.normals_map[sample],
        })
        .collect();
    let mut stays = vec![false; points.len()];
    kept.iter().for_each(|sample| stays[*sample as usize] = true);
    let removed: Vec<u32> =
        (0..n_before as u32).filter(|sample| !stays[*sample as usize]).collect();
    let added = points.select(kept.iter().copied().filter(|sample| *sample as usize >= n_before));
    surface.move_samples(&moved)?;
    let meter = WorkMeter::unlimited();
    surface.replace(&removed, &added, &meter)?;
    // Those that moved have numbers of their own now: those that stay kept their order.
    let mut number = 0;
    let mut refreshed = Vec::new();
    let mut moved = moved.iter().map(|moved| moved.sample).peekable();
    for sample in 0..n_before as u32 {
        let has_moved = moved.next_if_eq(&sample).is_some();
        if stays[sample as usize] {
            if has_moved {
                refreshed.push(number);
            }
            number += 1;
        }
    }
    let field = |at| base.at(at).map(|density| f64::from(density.value_m));
    surface.refresh(&refreshed, field, &meter)
}
