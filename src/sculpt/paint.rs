//! Paint: colours of samples under a brush that the hand presses.
//!
//! C = C_b I + C_p (1 − I), with the size of the brush proportional to the force (Guo2004, painting tool). The paper's brush function
//! I(R_p, R_b, f) is lost in print; here I = max(0, 1 − R_p/R_b)^f: 1 in the middle, 0 at the rim, and with f = 0 a hard edge.
//!
//! A sample that the rim only half covers is split: samples are added in its disc and tried again, until they are as small as a pixel.

use glam::DVec3;

use super::PointSet;

/// Samples that are added around one that is half covered.
const SPLIT: u32 = 6;
/// Where they go, in radii of the disc that is split; and how large theirs are.
const SPLIT_AT: f64 = 0.62;
const SPLIT_RADIUS: f64 = 0.42;

/// What paints.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Brush {
    /// sRGB.
    pub color: [u8; 3],
    /// Radius per force of the hand, m/N.
    pub radius_m_per_n: f64,
    /// The radius does not grow beyond this, m.
    pub radius_max_m: f64,
    /// f: 0 for a hard edge, 1 for a cone, more for a point.
    pub falloff_rate: f64,
    /// Samples are not split into discs smaller than this, m.
    pub smallest_m: f64,
}

impl Brush {
    /// Radius under a force, m; 0 without one.
    pub fn radius_m(&self, force_n: f64) -> f64 {
        let radius_m = self.radius_m_per_n * force_n;
        if radius_m > 0.0 { radius_m.min(self.radius_max_m) } else { 0.0 }
    }

    /// I at a distance from the middle of a brush with this radius.
    pub fn intensity(&self, distance_m: f64, radius_m: f64) -> f64 {
        if !(radius_m > 0.0 && distance_m < radius_m) {
            return 0.0;
        }
        (1.0 - distance_m / radius_m).powf(self.falloff_rate)
    }

    /// The colour that covers another with an intensity from 0 to 1.
    pub fn over(&self, under: [u8; 3], intensity: f64) -> [u8; 3] {
        let mixed = |n: usize| f64::from(self.color[n]) * intensity + f64::from(under[n]) * (1.0 - intensity);
        [0, 1, 2].map(|n| mixed(n).round().clamp(0.0, 255.0) as u8)
    }
}

/// A sample to be painted: number and the radius of its disc, m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surfel {
    /// Number of the sample.
    pub sample: u32,
    /// m.
    pub radius_m: f64,
}

/// Paints the samples near the brush, which stands at `at_map` and is pressed with `force_n`.
///
/// `near`: the samples within the brush's radius and their own, in the order of their numbers. `onto`: puts a point onto the surface, and
/// gives the normal there. Samples that are added come behind all others. Gives the discs of those that were added.
pub fn paint(
    points: &mut PointSet,
    near: &[Surfel],
    brush: &Brush,
    (at_map, force_n): (DVec3, f64),
    onto: impl Fn(DVec3) -> Option<(DVec3, DVec3)>,
) -> Vec<Surfel> {
    let radius_m = brush.radius_m(force_n);
    let mut added = Vec::new();
    if !(radius_m > 0.0 && at_map.is_finite()) {
        return added;
    }
    // What is split comes behind, and is tried in its turn.
    let mut waiting: Vec<Surfel> = near.to_vec();
    let mut n = 0;
    while let Some(&Surfel { sample, radius_m: disc_m }) = waiting.get(n) {
        n += 1;
        let (at, normal, under) =
            (points.positions_map[sample as usize], points.normals_map[sample as usize], points.colors[sample as usize]);
        let distance_m = at.distance(at_map);
        let is_cut = (distance_m - radius_m).abs() < disc_m && brush.is_hard();
        if is_cut && disc_m * SPLIT_RADIUS >= brush.smallest_m {
            let (u, v) = normal.any_orthonormal_pair();
            for turn in 0..SPLIT {
                let (sin, cos) = (core::f64::consts::TAU * f64::from(turn) / f64::from(SPLIT)).sin_cos();
                let Some((place, normal)) = onto(at + (u * cos + v * sin) * (SPLIT_AT * disc_m)) else { continue };
                let surfel = Surfel { sample: points.len() as u32, radius_m: SPLIT_RADIUS * disc_m };
                points.push(place, normal, under);
                added.push(surfel);
                waiting.push(surfel);
            }
        }
        points.colors[sample as usize] = brush.over(under, brush.intensity(distance_m, radius_m));
    }
    added
}

impl Brush {
    /// Its rim is a step of colour: only then is there something to be gained from smaller samples.
    fn is_hard(&self) -> bool {
        self.falloff_rate < 0.5
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RED: Brush = Brush { color: [255, 0, 0], radius_m_per_n: 2e-3, radius_max_m: 8e-3, falloff_rate: 1.0, smallest_m: 1e-4 };

    fn plate() -> PointSet {
        let mut points = PointSet::default();
        for x in -20..=20 {
            for y in -20..=20 {
                points.push(DVec3::new(f64::from(x) * 1e-3, f64::from(y) * 1e-3, 0.0), DVec3::Z, [0, 0, 200]);
            }
        }
        points
    }

    fn all(points: &PointSet) -> Vec<Surfel> {
        (0..points.len() as u32).map(|sample| Surfel { sample, radius_m: 6e-4 }).collect()
    }

    fn flat(at: DVec3) -> Option<(DVec3, DVec3)> {
        Some((at.with_z(0.0), DVec3::Z))
    }

    #[test]
    fn the_brush_grows_with_the_force_up_to_its_largest() {
        assert_eq!([0.0, 1.0, 3.0, 10.0, -1.0].map(|force| RED.radius_m(force)), [0.0, 2e-3, 6e-3, 8e-3, 0.0]);
        assert_eq!(RED.radius_m(f64::NAN), 0.0);
    }

    #[test]
    fn colour_fades_from_the_middle_to_the_rim() {
        let mut points = plate();
        let near = all(&points);
        assert!(paint(&mut points, &near, &RED, (DVec3::ZERO, 3.0), flat).is_empty(), "a soft rim splits nothing");
        for (at, color) in points.positions_map.iter().zip(&points.colors) {
            let share = (1.0 - at.length() / 6e-3).max(0.0);
            let expected = [255.0 * share, 0.0, 200.0 * (1.0 - share)];
            assert!((0..3).all(|n| (f64::from(color[n]) - expected[n]).abs() <= 0.5 + 1e-9), "{at}: {color:?}, {expected:?}");
        }
    }

    #[test]
    fn a_hard_rim_splits_what_it_cuts_until_the_discs_are_small() {
        let brush = Brush { falloff_rate: 0.0, ..RED };
        let mut points = plate();
        let before = points.len();
        let near = all(&points);
        let added = paint(&mut points, &near, &brush, (DVec3::ZERO, 3.0), flat);
        assert_eq!(points.len(), before + added.len());
        assert!(added.len() > 100, "{}", added.len());
        assert!(added.iter().all(|surfel| surfel.radius_m >= brush.smallest_m));
        for (at, color) in points.positions_map.iter().zip(&points.colors) {
            let expected = if at.length() < 6e-3 { [255, 0, 0] } else { [0, 0, 200] };
            assert_eq!(*color, expected, "{at}");
        }
        // The smallest discs lie along the rim.
        let smallest = added.iter().map(|surfel| surfel.radius_m).fold(f64::INFINITY, f64::min);
        assert!(smallest < 2.4e-4);
        for surfel in &added {
            let at = points.positions_map[surfel.sample as usize];
            assert!((at.length() - 6e-3).abs() < 1.3e-3, "{at}");
        }
    }

    #[test]
    fn no_force_no_paint() {
        let mut points = plate();
        let near = all(&points);
        for force in [0.0, -3.0, f64::NAN] {
            assert!(paint(&mut points, &near, &RED, (DVec3::ZERO, force), flat).is_empty());
        }
        assert!(paint(&mut points, &near, &RED, (DVec3::NAN, 1.0), flat).is_empty());
        assert_eq!(points, plate());
    }
}
