//! Small enclosing spheres.
//!
//! # Source
//! Badoiu2003 ("Smaller core-sets for balls"): step from the centre towards the farthest point by
//! 1/(k + 1) of the way, k = 1, 2, … Ours: the walk starts at the middle of the box with a later,
//! shorter step, and keeps the best centre that it saw.

use glam::DVec3;

/// A sphere whose centre and radius are numbers that `f32` holds.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ball {
    pub(super) center: DVec3,
    pub(super) radius: f32,
}

/// Steps of the walk: the spheres are then within 2 % of the smallest on average (a test measures
/// it).
const STEPS: u32 = 16;

/// Encloses a set of which `farthest` gives the point farthest from a place, with the squared
/// distance.
pub(super) fn enclose(middle: DVec3, mut farthest: impl FnMut(DVec3) -> (f64, DVec3)) -> Ball {
    // Rounded before it is measured from: the radius belongs to the centre that is stored.
    let stored = |center: DVec3| center.as_vec3().as_dvec3();
    let mut center = stored(middle);
    let mut best = (f64::INFINITY, center);
    for step in 0..STEPS {
        let (distance_squared, point) = farthest(center);
        if distance_squared < best.0 {
            best = (distance_squared, center);
        }
        center = stored(center + (point - center) / f64::from(step + 4));
    }
    // The last bits of the square root and of the sums below it.
    let radius = best.0.sqrt() * (1.0 + 1e-12);
    let rounded = radius as f32;
    Ball {
        center: best.1,
        radius: if f64::from(rounded) < radius { rounded.next_up() } else { rounded },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spatial::testing::Random;

    fn farthest(points: &[DVec3], from: DVec3) -> (f64, DVec3) {
        let distances = points.iter().map(|point| ((*point - from).length_squared(), *point));
        distances.max_by(|a, b| a.0.total_cmp(&b.0)).expect("some point")
    }

    #[test]
    #[expect(clippy::print_stdout, reason = "reports the margin")]
    fn a_ball_holds_its_points_and_is_nearly_the_smallest() {
        let mut random = Random(5);
        let mut sum = 0.0;
        let mut worst = 0.0_f64;
        const SETS: u32 = 500;
        for set in 0..SETS {
            // Sixteen points on a patch that is bent and slanted, in numbers that `f32` holds.
            let bend = f64::from(set % 5) * 0.1;
            let points: Vec<DVec3> = (0..16)
                .map(|idx| {
                    let u = f64::from(idx % 4) + 0.7 * random.unit();
                    let v = f64::from(idx / 4) + 0.7 * random.unit();
                    (DVec3::new(u, v, 0.4 * u + bend * v * v) * 1e-3).as_vec3().as_dvec3()
                })
                .collect();
            let (low, high) = points
                .iter()
                .fold((points[0], points[0]), |(low, high), p| (low.min(*p), high.max(*p)));
            let ball = enclose(0.5 * (low + high), |from| farthest(&points, from));
            for point in &points {
                assert!((*point - ball.center).length() <= f64::from(ball.radius));
            }
            let mut center = points[0];
            let mut smallest = f64::INFINITY;
            for step in 1..20_000 {
                let (distance_squared, point) = farthest(&points, center);
                smallest = smallest.min(distance_squared.sqrt());
                center += (point - center) / f64::from(step + 1);
            }
            let ratio = f64::from(ball.radius) / smallest;
            (sum, worst) = (sum + ratio, worst.max(ratio));
        }
        let mean = sum / f64::from(SETS);
        println!("radius over the smallest: mean {mean:.4}, worst {worst:.4}");
        assert!(mean < 1.02 && worst < 1.1, "{mean} {worst}");
    }

    #[test]
    fn one_point_is_a_ball_of_no_size() {
        let point = glam::Vec3::new(0.1, -0.2, 0.3).as_dvec3();
        let ball = enclose(point, |from| farthest(&[point], from));
        assert_eq!((ball.center, ball.radius), (point, 0.0));
    }
}
