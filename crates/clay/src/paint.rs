//! Paint: colours of samples under a brush that the hand presses.
//!
//! C = C_b I + C_p (1 − I), with the size of the brush proportional to the force (Guo2004, painting
//! tool). The paper's brush function I(R_p, R_b, f) is lost in print; here I is the weight of a
//! [`Falloff`] at R_p/R_b, as for the ropes, and that with a rate f is 1 − (R_p/R_b)^f. While a
//! brush is pressed a sample keeps the most that it was given: a brush that stands still leaves
//! what one dab leaves, at any rate of updates.
//!
//! A sample over which the colour changes much, at a rim or under a steep fall-off, is split where
//! the brush has passed and when it is lifted: samples are added in its disc and tried again, until
//! they are small enough.

use glam::DVec3;
use rayon::prelude::*;

use super::falloff::Falloff;
use super::resample::OccupiedPlaces;
use super::{Neighbours, PointSet};

/// Samples that are added around one that is half covered.
const SPLIT: u32 = 6;
/// Where they go, in radii of the disc that is split; and how large theirs are.
const SPLIT_AT: f64 = 0.62;
const SPLIT_RADIUS: f64 = 0.42;
/// Weight at the rim from which a brush is hard: discs that the rim cuts are split, even where it
/// cuts off little of them.
const HARD: f64 = 0.5;
/// A disc is split where the colour changes by more than this over it, of black to white: nearer
/// steps look even, because discs are blended.
const COARSE: f64 = 0.35;
/// While the brush is pressed, discs are split that it has left so far behind, in its radii; and
/// none that are nearer to it than the second number.
const LEFT_RADII: f64 = 2.5;
const AT_WORK_RADII: f64 = 1.3;
/// Samples that are added are at least so far from all others, in the smallest radii.
const APART: f64 = 1.0;
/// A dab that is nearer to the last one than this, in its radii, adds nothing to the rim.
const SAME: f64 = 0.02;

/// What paints.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Brush {
    /// sRGB.
    pub(super) color: [u8; 3],
    /// Radius per force of the hand, m/N.
    pub(super) radius_m_per_n: f64,
    /// The radius does not grow beyond this, m.
    pub(super) radius_max_m: f64,
    /// How the colour fades towards the rim.
    pub(super) falloff: Falloff,
    /// Samples are not split into discs smaller than this, m.
    pub(super) smallest_m: f64,
}

impl Brush {
    /// Radius under a force, m; 0 without one.
    pub(super) fn radius_m(&self, force_n: f64) -> f64 {
        let radius_m = self.radius_m_per_n * force_n;
        if radius_m > 0.0 { radius_m.min(self.radius_max_m) } else { 0.0 }
    }

    /// The colour that covers another with an intensity from 0 to 1.
    pub(super) fn over(&self, under: [u8; 3], intensity: f64) -> [u8; 3] {
        let mixed = |n: usize| {
            f64::from(self.color[n]) * intensity + f64::from(under[n]) * (1.0 - intensity)
        };
        [0, 1, 2].map(|n| mixed(n).round().clamp(0.0, 255.0) as u8)
    }

    fn is_hard(&self) -> bool {
        self.falloff.weight(1.0) >= HARD
    }
}

/// A brush at one moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Dab {
    /// Middle, map frame, m.
    pub(super) at_map: DVec3,
    /// Normal of the surface there: the other side of a thin wall is not painted.
    pub(super) normal_map: DVec3,
    /// m.
    pub(super) radius_m: f64,
}

impl Dab {
    /// A sample is under the brush.
    pub(super) fn covers(&self, points: &PointSet, sample: u32) -> bool {
        self.beyond_m(points.positions_map[sample as usize], points.normals_map[sample as usize])
            < 0.0
    }

    /// How far beyond the rim a place is, m; below 0 under the brush.
    fn beyond_m(&self, at_map: DVec3, normal_map: DVec3) -> f64 {
        if self.normal_map.dot(normal_map) > 0.0 {
            at_map.distance(self.at_map) - self.radius_m
        } else {
            f64::INFINITY
        }
    }
}

/// A sample and the radius of its disc, m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Surfel {
    /// Number of the sample.
    pub(super) sample: u32,
    /// m.
    pub(super) radius_m: f64,
}

/// What one press of a brush has put over the colours before.
#[derive(Clone, Debug)]
pub(super) struct Coat {
    /// `[n]`: colours before.
    under: Vec<[u8; 3]>,
    /// `[n]`: 0 to 1.
    intensities: Vec<f64>,
    dabs: Vec<Dab>,
    /// Of the dabs, from the first: what is around them has been split.
    n_refined: usize,
}

impl Coat {
    /// Nothing yet, over these colours, one per sample.
    pub(super) fn over(colors: &[[u8; 3]]) -> Self {
        Self {
            under: colors.to_vec(),
            intensities: vec![0.0; colors.len()],
            dabs: Vec::new(),
            n_refined: 0,
        }
    }

    /// Colours the samples with the numbers `near`, those at most that were there when the press
    /// began; places, normals and colours are of all samples. Gives how many took colour.
    pub(super) fn dab(
        &mut self,
        (positions_map, normals_map, colors): (&[DVec3], &[DVec3], &mut [[u8; 3]]),
        near: &[u32],
        brush: &Brush,
        dab: Dab,
    ) -> usize {
        let can_paint = dab.radius_m > 0.0 && dab.at_map.is_finite();
        if !can_paint {
            return 0;
        }
        let mut n_colored = 0;
        for sample in near.iter().map(|sample| *sample as usize) {
            if dab.beyond_m(positions_map[sample], normals_map[sample]) >= 0.0 {
                continue;
            }
            let intensity =
                brush.falloff.weight(positions_map[sample].distance(dab.at_map) / dab.radius_m);
            if intensity > self.intensities[sample] {
                self.intensities[sample] = intensity;
                colors[sample] = brush.over(self.under[sample], intensity);
                n_colored += 1;
            }
        }
        let is_same = |last: &Dab| {
            last.at_map.distance(dab.at_map) <= SAME * dab.radius_m && dab.radius_m <= last.radius_m
        };
        if !self.dabs.last().is_some_and(is_same) {
            self.dabs.push(dab);
        }
        n_colored
    }

    /// How far a brush that moves on has got since the last refinement, in dabs, and where it has
    /// left the surface behind.
    pub(super) fn waiting(&self) -> &[Dab] {
        let is_left = |dab: &&Dab| {
            self.dabs
                .last()
                .is_some_and(|last| dab.at_map.distance(last.at_map) > LEFT_RADII * last.radius_m)
        };
        let n_left = self.dabs[self.n_refined..].iter().take_while(is_left).count();
        &self.dabs[self.n_refined..self.n_refined + n_left]
    }

    /// So many dabs more are done with.
    pub(super) fn has_refined(&mut self, n_dabs: usize) {
        self.n_refined += n_dabs;
    }

    /// A disc is where the brush is still at work.
    pub(super) fn is_at_work(&self, at_map: DVec3) -> bool {
        self.dabs
            .last()
            .is_some_and(|last| at_map.distance(last.at_map) < AT_WORK_RADII * last.radius_m)
    }

    /// Samples were added behind all others.
    pub(super) fn extend(&mut self, refined: Refined) {
        self.under.extend(refined.under);
        self.intensities.extend(refined.intensities);
    }

    /// Samples for the discs over which the colour changes too much to be shown by one: those that
    /// the rim of a hard brush cuts, and those with a steep fall-off. `onto`: puts a point onto the
    /// surface, and gives the normal there. Parallel; cost: O(discs · log dabs), and at the rim
    /// O(dabs that reach there).
    pub(super) fn refined(
        &self,
        points: &PointSet,
        discs: &[Surfel],
        brush: &Brush,
        onto: impl Fn(DVec3) -> Option<(DVec3, DVec3)> + Sync,
    ) -> Refined {
        let middles_map: Vec<DVec3> = self.dabs.iter().map(|dab| dab.at_map).collect();
        let reach_m = self.dabs.iter().map(|dab| dab.radius_m).fold(0.0, f64::max);
        let dabs = Neighbours::new(&middles_map);
        let is_hard = brush.is_hard();
        let split = |disc: &Surfel| {
            let sample = disc.sample as usize;
            let mut near = Vec::new();
            let mut new = Refined::default();
            let contrast = (0..3)
                .map(|n| brush.color[n].abs_diff(self.under[sample][n]))
                .max()
                .map_or(0.0, |most| f64::from(most) / 255.0);
            if contrast == 0.0 {
                return new;
            }
            let mut waiting =
                vec![(points.positions_map[sample], points.normals_map[sample], disc.radius_m)];
            while let Some((at, normal, disc_m)) = waiting.pop() {
                if disc_m * SPLIT_RADIUS < brush.smallest_m {
                    continue;
                }
                // Of the dabs that come near a disc.
                dabs.within(at, reach_m + disc_m, &mut near);
                if near.is_empty() {
                    continue;
                }
                let near_dabs = || near.iter().map(|dab| &self.dabs[dab.sample as usize]);
                let beyond_m = |at: DVec3| {
                    near_dabs().map(|dab| dab.beyond_m(at, normal)).fold(f64::INFINITY, f64::min)
                };
                let intensity = |at: DVec3, normal: DVec3| {
                    let of = |dab: &Dab| {
                        if dab.beyond_m(at, normal) < 0.0 {
                            brush.falloff.weight(at.distance(dab.at_map) / dab.radius_m)
                        } else {
                            0.0
                        }
                    };
                    near_dabs().map(of).fold(0.0, f64::max)
                };
                let (u, v) = normal.any_orthonormal_pair();
                let around = |turn: u32, share: f64| {
                    let (sin, cos) =
                        (core::f64::consts::TAU * f64::from(turn) / f64::from(SPLIT)).sin_cos();
                    at + (u * cos + v * sin) * (share * disc_m)
                };
                let is_cut = is_hard && beyond_m(at).abs() < disc_m;
                let changes = || {
                    let intensities = (0..SPLIT).map(|turn| intensity(around(turn, 1.0), normal));
                    let (least, most) = intensities
                        .fold((1.0_f64, 0.0_f64), |(least, most), one| {
                            (least.min(one), most.max(one))
                        });
                    (most - least) * contrast > COARSE
                };
                if !(is_cut || changes()) {
                    continue;
                }
                for turn in 0..SPLIT {
                    let Some((at, normal)) = onto(around(turn, SPLIT_AT)) else { continue };
                    let intensity = intensity(at, normal);
                    new.points.push(at, normal, brush.over(self.under[sample], intensity));
                    new.under.push(self.under[sample]);
                    new.intensities.push(intensity);
                    waiting.push((at, normal, SPLIT_RADIUS * disc_m));
                }
            }
            new
        };
        let new: Vec<Refined> = discs.par_iter().map(split).collect();
        // Discs overlap: what neighbours put at nearly one place is taken once.
        let mut taken = OccupiedPlaces::new(APART * brush.smallest_m);
        points.positions_map.iter().for_each(|at| taken.take(*at));
        let mut added = Refined::default();
        for Refined { points: new, under, intensities } in &new {
            for n in 0..new.len() {
                if taken.is_free(new.positions_map[n]) {
                    taken.take(new.positions_map[n]);
                    added.points.push(new.positions_map[n], new.normals_map[n], new.colors[n]);
                    added.under.push(under[n]);
                    added.intensities.push(intensities[n]);
                }
            }
        }
        added
    }
}

/// Samples that a rim needs.
#[derive(Clone, Debug, Default)]
pub(super) struct Refined {
    /// With the colours that they have.
    pub(super) points: PointSet,
    /// Colours before the press, and how far the brush covers them.
    under: Vec<[u8; 3]>,
    intensities: Vec<f64>,
}

#[cfg(test)]
mod tests {
    use super::*;

    fn red() -> Brush {
        let cone = Falloff::table(vec![1.0, 0.0]).unwrap();
        Brush {
            color: [255, 0, 0],
            radius_m_per_n: 2e-3,
            radius_max_m: 8e-3,
            falloff: cone,
            smallest_m: 1e-4,
        }
    }

    fn plate() -> PointSet {
        let mut points = PointSet::default();
        for x in -20..=20 {
            for y in -20..=20 {
                points.push(
                    DVec3::new(f64::from(x) * 1e-3, f64::from(y) * 1e-3, 0.0),
                    DVec3::Z,
                    [0, 0, 200],
                );
            }
        }
        points
    }

    fn dab(
        points: &mut PointSet,
        coat: &mut Coat,
        brush: &Brush,
        at_map: DVec3,
        force_n: f64,
    ) -> usize {
        let near: Vec<u32> = (0..points.len() as u32).collect();
        let PointSet { positions_map, normals_map, colors, .. } = points;
        let dab = Dab { at_map, normal_map: DVec3::Z, radius_m: brush.radius_m(force_n) };
        coat.dab((positions_map, normals_map, colors), &near, brush, dab)
    }

    fn discs(points: &PointSet) -> Vec<Surfel> {
        (0..points.len() as u32).map(|sample| Surfel { sample, radius_m: 6e-4 }).collect()
    }

    fn flat(at: DVec3) -> Option<(DVec3, DVec3)> {
        Some((at.with_z(0.0), DVec3::Z))
    }

    #[test]
    fn the_brush_grows_with_the_force_up_to_its_largest() {
        assert_eq!(
            [0.0, 1.0, 3.0, 10.0, -1.0].map(|force| red().radius_m(force)),
            [0.0, 2e-3, 6e-3, 8e-3, 0.0]
        );
        assert_eq!(red().radius_m(f64::NAN), 0.0);
    }

    #[test]
    fn colour_fades_from_the_middle_to_the_rim_however_often_the_brush_dabs() {
        for n_dabs in [1, 50] {
            let mut points = plate();
            let mut coat = Coat::over(&points.colors);
            for _ in 0..n_dabs {
                dab(&mut points, &mut coat, &red(), DVec3::ZERO, 3.0);
            }
            assert!(
                coat.refined(&points, &discs(&points), &red(), flat).points.is_empty(),
                "a gentle slope splits nothing"
            );
            for (at, color) in points.positions_map.iter().zip(&points.colors) {
                let share = (1.0 - at.length() / 6e-3).max(0.0);
                let expected = [255.0 * share, 0.0, 200.0 * (1.0 - share)];
                assert!(
                    (0..3).all(|n| (f64::from(color[n]) - expected[n]).abs() <= 0.5 + 1e-9),
                    "{at}: {color:?}, {expected:?}"
                );
            }
        }
    }

    #[test]
    fn a_hard_rim_splits_what_it_cuts_until_the_discs_are_small() {
        let brush = Brush { falloff: Falloff::Constant, ..red() };
        let mut points = plate();
        let mut coat = Coat::over(&points.colors);
        // Two dabs: where they overlap there is no rim.
        let middles = [DVec3::ZERO, DVec3::X * 4e-3];
        for at in middles {
            dab(&mut points, &mut coat, &brush, at, 3.0);
        }
        let added = coat.refined(&points, &discs(&points), &brush, flat).points;
        assert!(added.len() > 100, "{}", added.len());
        let from_rim_m = |at: &DVec3| {
            middles
                .map(|middle| at.distance(middle) - 6e-3)
                .into_iter()
                .fold(f64::INFINITY, f64::min)
        };
        for (at, color) in points
            .positions_map
            .iter()
            .chain(&added.positions_map)
            .zip(points.colors.iter().chain(&added.colors))
        {
            let expected = if from_rim_m(at) < 0.0 { [255, 0, 0] } else { [0, 0, 200] };
            assert_eq!(*color, expected, "{at}");
        }
        assert!(added.positions_map.iter().all(|at| from_rim_m(at).abs() < 1.3e-3));
        let nothing_smaller = Brush { smallest_m: 6e-4, ..brush };
        assert!(coat.refined(&points, &discs(&points), &nothing_smaller, flat).points.is_empty());
    }

    #[test]
    fn a_steep_soft_rim_is_split_until_neighbours_differ_little() {
        // The whole change within a millimetre, over which samples are a millimetre apart.
        let brush = Brush { falloff: Falloff::rate(12.0).unwrap(), smallest_m: 5e-5, ..red() };
        let mut points = plate();
        let mut coat = Coat::over(&points.colors);
        dab(&mut points, &mut coat, &brush, DVec3::ZERO, 3.0);
        let added = coat.refined(&points, &discs(&points), &brush, flat).points;
        assert!(added.len() > 50, "{}", added.len());
        let share = |at: &DVec3| (1.0 - (at.length() / 6e-3).powf(12.0)).max(0.0);
        for (at, color) in added.positions_map.iter().zip(&added.colors) {
            assert!((f64::from(color[0]) - 255.0 * share(at)).abs() < 1.0, "{at}: {color:?}");
            assert!((at.length() - 5.5e-3).abs() < 2e-3, "only where the colour changes: {at}");
        }
        // Every place at the rim has a sample of about its colour nearby.
        let mut all = points.clone();
        all.append(&added);
        let worst = |points: &PointSet| {
            let near = Neighbours::new(&points.positions_map);
            let places = (0..200)
                .map(|k| DVec3::new(5.7e-3 * f64::from(k).cos(), 5.7e-3 * f64::from(k).sin(), 0.0));
            let off = places.map(|at| {
                (share(&at)
                    - f64::from(points.colors[near.nearest(at).unwrap().sample as usize][0])
                        / 255.0)
                    .abs()
            });
            off.fold(0.0, f64::max)
        };
        assert!(
            worst(&all) < COARSE && worst(&points) > 0.45,
            "{} against {}",
            worst(&all),
            worst(&points)
        );
    }

    #[test]
    fn the_other_side_of_a_wall_stays_clean() {
        let mut points = plate();
        points.normals_map.iter_mut().skip(800).for_each(|normal| *normal = -*normal);
        let mut coat = Coat::over(&points.colors);
        assert!(dab(&mut points, &mut coat, &red(), DVec3::ZERO, 3.0) > 0);
        assert!(points.colors[800..].iter().all(|color| *color == [0, 0, 200]));
    }

    #[test]
    fn no_force_no_paint() {
        let mut points = plate();
        let mut coat = Coat::over(&points.colors);
        for force in [0.0, -3.0, f64::NAN] {
            assert_eq!(dab(&mut points, &mut coat, &red(), DVec3::ZERO, force), 0);
        }
        assert_eq!(dab(&mut points, &mut coat, &red(), DVec3::NAN, 1.0), 0);
        assert_eq!(points, plate());
    }
}
