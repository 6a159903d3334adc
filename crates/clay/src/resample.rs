//! Samples where the surface was stretched, fewer where it was squeezed.
//!
//! Up: the neighbours of a sample are projected onto its tangent plane; the vertex of their Voronoi
//! diagram with the largest empty circle is where one is missing, if the circle is larger than a
//! threshold; it is put onto the isosurface (Guo2004, dynamic sampling). Down: the paper describes
//! it and does not build it; here a sample goes that was squeezed closer to a kept one than a
//! second threshold.
//!
//! Invariant: the result does not depend on the number of threads.

use std::collections::HashMap;

use delaunator::{Point, triangulate};
use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::advect::{AdvectedSamples, onto_level};
use super::neighbours::{Neighbour, Neighbours};
use super::work_meter::TREE_STEPS;
use super::{PointSet, WorkError, WorkMeter};
use vps::density::Raster;

/// Neighbours are looked for as far as this many thresholds: what is further bounds no circle that
/// is filled in one go.
const SEEN_GAPS: f64 = 3.0;
/// And so many are looked at in any case: a stretched place has none nearer.
const SEEN_LEAST: usize = 16;
/// A circle's middle is filled at most this many thresholds away: no further is it known to be
/// empty.
const FILLED_GAPS: f64 = 1.5;
/// Neighbours whose normals are further apart than this (cosine) are the other side of a thin part.
const SAME_SIDE: f64 = 0.3;
/// Steps of a neighbour in the triangles around a sample.
const TRIANGLE_STEPS: u64 = 4;
/// Rounds of filling at most.
const ROUNDS: u32 = 12;
/// Two samples were squeezed together if a stroke left this share of their distance, or less.
const SQUEEZED: f64 = 0.8;
/// The same for two that were nearer than the threshold already, as at the rim of paint.
const SQUEEZED_FINE: f64 = 0.6;
/// What is closer than this share of the threshold goes in any case: many strokes may each squeeze
/// by a little.
const CRAMMED: f64 = 0.25;
/// A new sample keeps this share of the threshold from the others that are new.
const APART: f64 = 0.9;

/// Where a sample is missing.
#[derive(Clone, Copy, Debug)]
struct Gap {
    /// Middle of the circle, on the tangent plane.
    middle_map: DVec3,
    radius_m: f64,
    /// The samples on the circle.
    around: [u32; 3],
}

/// What is remembered while gaps are looked for, one per thread.
#[derive(Default)]
struct Seen {
    neighbours: Vec<Neighbour>,
    nearest: Vec<Neighbour>,
    plane: Vec<Point>,
    samples: Vec<u32>,
}

/// The largest empty circle on the tangent plane of a sample that passes through it; `None` where
/// its neighbours lie on a line.
fn gap_at(
    points: &PointSet,
    neighbours: &Neighbours,
    sample: u32,
    seen_m: f64,
    seen: &mut Seen,
) -> Option<Gap> {
    let at = points.positions_map[sample as usize];
    let normal = points.normals_map[sample as usize];
    neighbours.within(at, seen_m, &mut seen.neighbours);
    if seen.neighbours.len() < SEEN_LEAST {
        neighbours.nearest_n(at, SEEN_LEAST, &mut seen.nearest);
        seen.neighbours.clone_from(&seen.nearest);
    }
    let (u, v) = normal.any_orthonormal_pair();
    let Seen { neighbours, plane, samples, .. } = seen;
    samples.clear();
    samples.push(sample);
    let is_beside =
        |other: u32| other != sample && points.normals_map[other as usize].dot(normal) > SAME_SIDE;
    samples.extend(
        neighbours.iter().map(|neighbour| neighbour.sample).filter(|other| is_beside(*other)),
    );
    plane.clear();
    plane.extend(samples.iter().map(|other| {
        let away = points.positions_map[*other as usize] - at;
        Point { x: away.dot(u), y: away.dot(v) }
    }));
    let triangles = triangulate(plane).triangles;
    let mut largest: Option<Gap> = None;
    for triangle in triangles.chunks_exact(3).filter(|triangle| triangle.contains(&0)) {
        let [a, b, c] = [0, 1, 2].map(|n| DVec2::new(plane[triangle[n]].x, plane[triangle[n]].y));
        let Some(middle) = circumcentre(a, b, c) else { continue };
        // The sample itself is the origin, and on the circle.
        let radius_m = middle.length();
        if largest.is_none_or(|largest| radius_m > largest.radius_m) {
            let around = [0, 1, 2].map(|n| samples[triangle[n]]);
            largest = Some(Gap { middle_map: at + u * middle.x + v * middle.y, radius_m, around });
        }
    }
    largest
}

/// `None` for corners on a line.
fn circumcentre(a: DVec2, b: DVec2, c: DVec2) -> Option<DVec2> {
    let b = b - a;
    let c = c - a;
    let twice = 2.0 * b.perp_dot(c);
    let middle = DVec2::new(
        c.y * b.length_squared() - b.y * c.length_squared(),
        b.x * c.length_squared() - c.x * b.length_squared(),
    );
    (twice.abs() > 1e-9 * (b.length_squared() + c.length_squared())).then(|| a + middle / twice)
}

/// The radius of the largest empty circle through any of these samples that is seen whole, m; 0
/// where there is none. Circles that reach beyond what is seen count with what is seen of them.
#[cfg(test)]
pub(super) fn largest_gap_m(points: &PointSet, samples: &[u32], gap_m: f64) -> f64 {
    let neighbours = Neighbours::new(&points.positions_map);
    samples
        .par_iter()
        .map_init(Seen::default, |seen, sample| {
            gap_at(points, &neighbours, *sample, SEEN_GAPS * gap_m, seen)
                .map_or(0.0, |gap| gap.radius_m.min(FILLED_GAPS * gap_m))
        })
        .reduce(|| 0.0, f64::max)
}

/// Puts samples into every empty circle with a radius above `gap_m` through samples that have
/// `moved` (some of those that are afloat), on the isosurface of `now`, and lets them float as
/// well. Returns how many came. Cost: O(samples that have moved) per round; each round fills all
/// circles that are apart.
pub(super) fn fill(
    points: &mut PointSet,
    afloat: &mut AdvectedSamples,
    moved: &[u32],
    now: &Raster,
    gap_m: f64,
    meter: &WorkMeter,
) -> Result<usize, WorkError> {
    let before = points.len();
    let mut level_of: HashMap<u32, f64> =
        afloat.samples().iter().copied().zip(afloat.levels_m().iter().copied()).collect();
    let mut looked_at = moved.to_vec();
    for _ in 0..ROUNDS {
        meter.take(TREE_STEPS * points.len() as u64)?;
        let neighbours = Neighbours::new(&points.positions_map);
        let gap = |seen: &mut Seen, sample: &u32| {
            let gap = gap_at(points, &neighbours, *sample, SEEN_GAPS * gap_m, seen);
            meter.take(TRIANGLE_STEPS * seen.neighbours.len() as u64)?;
            Ok(gap.filter(|gap| gap.radius_m > gap_m))
        };
        let gaps: Vec<Option<Gap>> =
            looked_at.par_iter().map_init(Seen::default, gap).collect::<Result<_, WorkError>>()?;
        let mut gaps: Vec<Gap> = gaps.into_iter().flatten().collect();
        // The worst first; the same gap is seen by all three samples around it.
        gaps.sort_by(|a, b| b.radius_m.total_cmp(&a.radius_m).then(a.around.cmp(&b.around)));
        let mut taken = OccupiedPlaces::new(APART * gap_m);
        let first_new = points.len() as u32;
        for gap in gaps {
            meter.take(TREE_STEPS)?;
            let [seer, ..] = gap.around;
            let from = points.positions_map[seer as usize];
            let middle =
                from + (gap.middle_map - from) * (FILLED_GAPS * gap_m / gap.radius_m).min(1.0);
            if !taken.is_free(middle) {
                continue;
            }
            let levels = gap.around.map(|sample| level_of.get(&sample).copied());
            let known = levels.iter().flatten();
            let level_m = known.clone().sum::<f64>() / known.clone().count().max(1) as f64;
            let found = onto_level(
                |at| now.at(at),
                now.lattice().spacing_m,
                (middle, level_m),
                FILLED_GAPS * gap_m,
            );
            let Some((at, normal)) = found else { continue };
            // Beyond a sharp edge lies another face, which has samples of its own.
            if normal.dot(points.normals_map[seer as usize]) <= SAME_SIDE {
                continue;
            }
            // It may have slid along a bent surface to where another sample is.
            let is_free = neighbours
                .nearest(at)
                .is_none_or(|nearest| nearest.distance_squared_m2 > (0.5 * gap_m).powi(2));
            if !(is_free && taken.is_free(at)) {
                continue;
            }
            taken.take(middle);
            taken.take(at);
            let sample = points.len() as u32;
            points.positions_map.push(at);
            points.normals_map.push(normal);
            points.colors.push(points.colors[seer as usize]);
            level_of.insert(sample, level_m);
            afloat.push(sample, level_m);
        }
        let new = first_new..points.len() as u32;
        if new.is_empty() {
            break;
        }
        // What is near a new sample, and the new ones.
        let neighbours = Neighbours::new(&points.positions_map);
        let mut found = Vec::new();
        let mut near: Vec<u32> = Vec::new();
        for sample in new {
            neighbours.within(points.positions_map[sample as usize], SEEN_GAPS * gap_m, &mut found);
            meter.take(found.len() as u64)?;
            near.extend(
                found
                    .iter()
                    .map(|neighbour| neighbour.sample)
                    .filter(|sample| level_of.contains_key(sample)),
            );
        }
        near.sort_unstable();
        near.dedup();
        looked_at = near;
    }
    Ok(points.len() - before)
}

/// The samples to keep, ascending: without those of `looked_at` (ascending) that were squeezed
/// closer than `close_m` to a kept one of the same side. What was as fine `before`, as the rim of
/// paint is, stays so. Numbers up to the last of `before` mean the same samples in both. Cost:
/// O(samples that are looked at).
pub(super) fn thinned(
    points: &PointSet,
    before: &PointSet,
    looked_at: &[u32],
    close_m: f64,
    meter: &WorkMeter,
) -> Result<Vec<u32>, WorkError> {
    let neighbours = Neighbours::new(&points.positions_map);
    let was_apart = |one: u32, other: u32, apart_m: f64| {
        let (Some(one), Some(other)) =
            (before.positions_map.get(one as usize), before.positions_map.get(other as usize))
        else {
            return true;
        };
        let was_m = one.distance(*other);
        apart_m < was_m * if was_m > close_m { SQUEEZED } else { SQUEEZED_FINE }
    };
    let mut is_kept = vec![true; points.len()];
    let mut found = Vec::new();
    let mut may_go = vec![false; points.len()];
    for sample in looked_at {
        may_go[*sample as usize] = true;
    }
    for sample in looked_at {
        let at = points.positions_map[*sample as usize];
        let normal = points.normals_map[*sample as usize];
        neighbours.within(at, close_m, &mut found);
        meter.take(1 + found.len() as u64)?;
        let crowds = |other: u32| {
            // Of two that may go the later one does.
            let stays = is_kept[other as usize] && (other < *sample || !may_go[other as usize]);
            stays && other != *sample && points.normals_map[other as usize].dot(normal) > SAME_SIDE
        };
        let is_squeezed = |neighbour: &Neighbour| {
            let apart_m = neighbour.distance_squared_m2.sqrt();
            apart_m < CRAMMED * close_m || was_apart(*sample, neighbour.sample, apart_m)
        };
        if found.iter().any(|neighbour| crowds(neighbour.sample) && is_squeezed(neighbour)) {
            is_kept[*sample as usize] = false;
        }
    }
    Ok((0..points.len() as u32).filter(|sample| is_kept[*sample as usize]).collect())
}

/// Places that are taken, in cells of the distance that they keep.
pub(super) struct OccupiedPlaces {
    apart_m: f64,
    cells: HashMap<[i64; 3], Vec<DVec3>>,
}

impl OccupiedPlaces {
    pub(super) fn new(apart_m: f64) -> Self {
        Self { apart_m, cells: HashMap::new() }
    }

    fn cell(&self, at: DVec3) -> [i64; 3] {
        (at / self.apart_m).floor().to_array().map(|x| x as i64)
    }

    pub(super) fn is_free(&self, at: DVec3) -> bool {
        let [x, y, z] = self.cell(at);
        (-1..=1).all(|i| {
            (-1..=1).all(|j| {
                (-1..=1).all(|k| {
                    let there = self.cells.get(&[x + i, y + j, z + k]);
                    there.is_none_or(|places| {
                        places.iter().all(|place| place.distance(at) >= self.apart_m)
                    })
                })
            })
        })
    }

    pub(super) fn take(&mut self, at: DVec3) {
        self.cells.entry(self.cell(at)).or_default().push(at);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vps::density::Lattice;

    const GAP_M: f64 = 1e-3;

    /// Even steps over a sphere.
    fn spiral(n: u32, radius: f64) -> PointSet {
        let mut points = PointSet::default();
        for i in 0..n {
            let z = 1.0 - (2.0 * f64::from(i) + 1.0) / f64::from(n);
            let turn = f64::from(i) * 2.399_963_229_728_653;
            let normal =
                DVec3::new((1.0 - z * z).sqrt() * turn.cos(), (1.0 - z * z).sqrt() * turn.sin(), z);
            points.positions_map.push(normal * radius);
            points.normals_map.push(normal);
            points.colors.push([(i % 250) as u8, 0, 0]);
        }
        points
    }

    fn ball(radius: f64) -> Raster {
        let lattice = Lattice { origin_map: DVec3::splat(-0.015), spacing_m: 5e-4, dims: [61; 3] };
        let mut raster = Raster::uniform(lattice, 0.0);
        for x in 0..61 {
            for y in 0..61 {
                for z in 0..61 {
                    raster.values_m_mut()[lattice.index([x, y, z])] =
                        (radius - lattice.position([x, y, z]).length()) as f32;
                }
            }
        }
        raster
    }

    #[test]
    fn acceptance_31_a_sphere_that_has_too_few_is_filled_until_no_circle_is_larger_than_the_threshold()
     {
        let now = ball(0.01);
        // 100 samples on 4π cm²: circles of several millimetres.
        let mut points = spiral(100, 0.01);
        let mut afloat = AdvectedSamples::new(&points, &now, 0.0);
        let all = afloat.samples().to_vec();
        let n = fill(&mut points, &mut afloat, &all, &now, GAP_M, &WorkMeter::unlimited()).unwrap();
        assert!(n > 200, "{n}");
        assert!(largest_gap_m(&points, afloat.samples(), GAP_M) <= GAP_M);
        for (at, normal) in points.positions_map.iter().zip(&points.normals_map) {
            assert!((at.length() - 0.01).abs() < 5e-5, "{}", at.length());
            assert!(normal.dot(at.normalize()) > 0.995, "{normal}");
        }
        // No more than it takes: two samples are never very close.
        let neighbours = Neighbours::new(&points.positions_map);
        let mut found = Vec::new();
        for at in &points.positions_map[100..] {
            neighbours.within(*at, 0.4 * GAP_M, &mut found);
            assert_eq!(found.len(), 1, "{at}");
        }
    }

    #[test]
    fn a_dense_sphere_gets_none_and_one_that_has_not_moved_neither() {
        let now = ball(0.01);
        let mut points = spiral(4000, 0.01);
        let before = points.clone();
        let mut afloat = AdvectedSamples::new(&points, &now, 0.0);
        let all = afloat.samples().to_vec();
        assert_eq!(
            fill(&mut points, &mut afloat, &all, &now, GAP_M, &WorkMeter::unlimited()),
            Ok(0)
        );
        assert_eq!(points, before);
        let mut sparse = spiral(100, 0.01);
        let mut afloat = AdvectedSamples::new(&sparse, &now, 0.0);
        assert_eq!(
            fill(&mut sparse, &mut afloat, &[], &now, GAP_M, &WorkMeter::unlimited()),
            Ok(0),
            "none has moved"
        );
    }

    #[test]
    fn crowded_samples_go_and_the_rest_covers_the_surface() {
        let before = spiral(4000, 0.02);
        let points = spiral(4000, 0.01);
        let afloat = AdvectedSamples::new(&points, &ball(0.01), 0.0);
        let kept =
            thinned(&points, &before, afloat.samples(), 0.6 * GAP_M, &WorkMeter::unlimited())
                .unwrap();
        assert!(kept.len() < 3000, "{}", kept.len());
        let left = points.select(kept.iter().copied());
        let all: Vec<u32> = (0..left.len() as u32).collect();
        assert!(largest_gap_m(&left, &all, GAP_M) <= GAP_M);
        assert_eq!(
            thinned(&points, &before, &[], 0.6 * GAP_M, &WorkMeter::unlimited()).unwrap().len(),
            4000
        );
        // Samples that came with the stroke crowd as well.
        assert!(
            thinned(
                &points,
                &PointSet::default(),
                afloat.samples(),
                0.6 * GAP_M,
                &WorkMeter::unlimited()
            )
            .unwrap()
            .len()
                < 3000
        );
    }

    #[test]
    fn what_was_as_fine_before_stays_unless_samples_all_but_meet() {
        let points = spiral(4000, 0.01);
        let afloat = AdvectedSamples::new(&points, &ball(0.01), 0.0);
        assert_eq!(
            thinned(&points, &points, afloat.samples(), 0.6 * GAP_M, &WorkMeter::unlimited())
                .unwrap()
                .len(),
            4000
        );
        assert!(
            thinned(&points, &points, afloat.samples(), 10.0 * GAP_M, &WorkMeter::unlimited())
                .unwrap()
                .len()
                < 500
        );
    }

    #[test]
    fn both_sides_of_a_thin_sheet_are_kept() {
        let mut points = PointSet::default();
        for x in 0..20 {
            for y in 0..20 {
                for (z, normal) in [(1e-4, DVec3::Z), (-1e-4, -DVec3::Z)] {
                    points.positions_map.push(DVec3::new(
                        f64::from(x) * GAP_M,
                        f64::from(y) * GAP_M,
                        z,
                    ));
                    points.normals_map.push(normal);
                    points.colors.push([0; 3]);
                }
            }
        }
        let afloat = AdvectedSamples::new(&points, &ball(0.01), 0.0);
        assert_eq!(
            thinned(
                &points,
                &PointSet::default(),
                afloat.samples(),
                0.6 * GAP_M,
                &WorkMeter::unlimited()
            )
            .unwrap()
            .len(),
            points.len()
        );
    }

    #[test]
    fn samples_on_a_line_or_alone_have_no_gap() {
        let mut points = PointSet::default();
        for x in 0..10 {
            points.positions_map.push(DVec3::X * f64::from(x) * GAP_M);
            points.normals_map.push(DVec3::Z);
            points.colors.push([0; 3]);
        }
        assert_eq!(largest_gap_m(&points, &[0, 5], GAP_M), 0.0);
    }
}
