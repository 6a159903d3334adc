use std::f64::consts::{PI, TAU};

use super::*;
use crate::sample;
use crate::shapes::{cube, shell_between, sphere, torus};
use vps::density::{Lattice, Raster};
use vps::mesh::primitives::Shape;

fn build(points: PointSet) -> PointSurface {
    PointSurface::build(points, PointSurface::DEFAULT_NEIGHBOURS).unwrap()
}

/// Volume inside, m³: a cell around a node counts by how deep the node is, which is exact where the
/// surface is flat and parallel to it.
fn volume_m3(raster: &Raster) -> f64 {
    let spacing_m = raster.lattice().spacing_m;
    let share = |value_m: &f32| (0.5 + f64::from(*value_m) / spacing_m).clamp(0.0, 1.0);
    raster.values_m().iter().map(share).sum::<f64>() * spacing_m.powi(3)
}

fn lattice_around(surface: &PointSurface, margin_m: f64, spacing_m: f64) -> Lattice {
    let (low, high) = surface.bounds();
    let dims = ((high - low + 2.0 * margin_m) / spacing_m)
        .to_array()
        .map(|extent| extent.ceil() as usize + 1);
    Lattice { origin_map: low - margin_m, spacing_m, dims }
}

fn nodes(raster: &Raster) -> impl Iterator<Item = (DVec3, f64)> {
    let lattice = *raster.lattice();
    let [_, ny, nz] = lattice.dims;
    let node = move |place: usize| lattice.position([place / nz / ny, place / nz % ny, place % nz]);
    raster
        .values_m()
        .iter()
        .enumerate()
        .map(move |(place, value_m)| (node(place), f64::from(*value_m)))
}

/// Nodes of a raster on the wrong side, of those that are farther from the surface than `near_m`.
fn n_wrong(raster: &Raster, near_m: f64, depth_m: impl Fn(DVec3) -> f64) -> usize {
    nodes(raster)
        .filter(|(at, value_m)| {
            depth_m(*at).abs() > near_m && (depth_m(*at) > 0.0) != (*value_m > 0.0)
        })
        .count()
}

fn depth_in_box(at: DVec3, size_m: DVec3) -> f64 {
    let off = at.abs() - size_m / 2.0;
    -(off.max(DVec3::ZERO).length() + off.max_element().min(0.0))
}

fn depth_in_torus(at: DVec3, major_m: f64, minor_m: f64) -> f64 {
    minor_m - (at.truncate().length() - major_m).hypot(at.z)
}

#[test]
fn acceptance_28_a_sphere_of_4500_samples_is_followed() {
    let surface = build(sphere(4500, 0.05));
    let (mut worst_m, mut worst_angle): (f64, f64) = (0.0, 0.0);
    for at in &surface.points().positions_map {
        let found = surface.at(*at);
        worst_m = worst_m.max(found.value_m.abs());
        worst_angle = worst_angle.max(found.gradient.angle_between(-*at));
    }
    assert!(worst_m <= 1e-3 * surface.spacing_m(), "{} spacings", worst_m / surface.spacing_m());
    assert!(worst_angle.to_degrees() <= 2.0, "{}°", worst_angle.to_degrees());
}

#[test]
fn acceptance_28_a_plane_is_reproduced_in_the_shell() {
    let normal = DVec3::new(1.0, -2.0, 4.0).normalize();
    let (u, v) = normal.any_orthonormal_pair();
    let mut points = PointSet::default();
    for k in 0..900 {
        let jitter = DVec3::new((f64::from(k) * 7.1).sin(), (f64::from(k) * 3.3).sin(), 0.0) * 0.3;
        points.push(
            (u * (f64::from(k / 30) + jitter.x) + v * (f64::from(k % 30) + jitter.y)) * 1e-3,
            normal,
            [0; 3],
        );
    }
    let surface = build(points);
    assert!(!surface.is_closed());
    for at in surface.points().positions_map.clone() {
        for height_m in [-1e-3, -3e-4, 0.0, 7e-4, 1.2e-3] {
            let found = surface.at(at + normal * height_m);
            assert!(
                (found.value_m + height_m).abs() < 1e-9
                    && (found.gradient + normal).length() < 1e-6,
                "{found:?} at {height_m}"
            );
        }
    }
    // Far below a sheet is inside, far above it outside.
    let middle = surface.points().positions_map[465];
    assert!(
        surface.at(middle - normal * 0.01).value_m > 0.0
            && surface.at(middle + normal * 0.01).value_m < 0.0
    );
}

#[test]
fn the_gradient_is_the_slope_of_the_value_wherever_the_field_comes_from() {
    let surface = build(sphere(1500, 0.05));
    let mut n_far = 0;
    for (k, normal) in sphere(400, 1.0).normals_map.into_iter().enumerate() {
        let at = normal * (0.035 + 0.03 * (k % 23) as f64 / 22.0);
        let found = surface.at(at);
        let step_m = 1e-7;
        let differ = |axis: DVec3| {
            (surface.at(at + axis * step_m).value_m - surface.at(at - axis * step_m).value_m)
                / (2.0 * step_m)
        };
        let slope = DVec3::new(differ(DVec3::X), differ(DVec3::Y), differ(DVec3::Z));
        n_far += usize::from((found.gradient.length() - 1.0).abs() < 1e-12);
        assert!((slope - found.gradient).length() < 1e-4, "{at}: {slope} {found:?}");
    }
    assert!(n_far > 50 && n_far < 350, "{n_far}");
}

#[test]
fn a_field_that_interpolates_goes_through_noisy_samples_and_is_as_steep_there_as_beside_them() {
    let mut points = sphere(1500, 0.05);
    let spacing_m = build(points.clone()).spacing_m();
    for (k, (at, normal)) in points.positions_map.iter_mut().zip(&points.normals_map).enumerate() {
        *at += *normal * (0.1 * spacing_m * (k as f64 * 12.9898).sin());
    }
    let smooth = build(points.clone());
    let exact = build(points).interpolating();
    let off = |surface: &PointSurface| {
        let all = surface
            .points()
            .positions_map
            .iter()
            .map(|at| surface.at(*at).value_m.abs() / spacing_m);
        all.fold(0.0, f64::max)
    };
    assert!(
        off(&exact) < 1e-9 && off(&smooth) > 0.02,
        "{} and {} spacings",
        off(&exact),
        off(&smooth)
    );
    for at in exact.points().positions_map.iter().step_by(10) {
        let there = exact.at(*at).gradient;
        for side in [DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Z] {
            let beside = exact.at(*at + side * (1e-4 * spacing_m)).gradient;
            assert!(beside.distance(there) < 1e-2, "{at}: {beside} beside {there}");
        }
    }
    // The raster has the same field.
    let raster =
        exact.rasterize(lattice_around(&exact, 0.01, 0.005), &WorkMeter::unlimited()).unwrap();
    for (at, value_m) in nodes(&raster).filter(|(at, _)| (at.length() - 0.05).abs() < spacing_m) {
        assert!((exact.at(at).value_m - value_m).abs() < 1e-7, "{at}");
    }
    // Samples that move and come are met as well.
    let mut worked = exact;
    let moved = SampleMove {
        sample: 7,
        position_map: worked.points().positions_map[7] * 1.02,
        normal_map: worked.points().normals_map[7],
    };
    worked.move_and_refit(&[moved], &WorkMeter::unlimited()).unwrap();
    let mut added = PointSet::default();
    let between = 0.5 * (worked.points().positions_map[20] + worked.points().positions_map[33]);
    added.push(between, between.normalize(), [0; 3]);
    worked.replace(&[3], &added, &WorkMeter::unlimited()).unwrap();
    assert!(off(&worked) < 1e-9, "{} spacings", off(&worked));
}

#[test]
fn a_rasterized_sphere_has_its_volume_and_the_values_of_the_field() {
    let surface = build(sphere(4500, 0.05));
    let raster =
        surface.rasterize(lattice_around(&surface, 0.01, 0.0025), &WorkMeter::unlimited()).unwrap();
    let share = volume_m3(&raster) / (4.0 / 3.0 * PI * 0.05_f64.powi(3));
    assert!((share - 1.0).abs() < 2e-3, "{share}");
    assert_eq!(n_wrong(&raster, 1e-4, |at| 0.05 - at.length()), 0);
    for (at, value_m) in nodes(&raster) {
        let found = surface.at(at);
        let is_shell = (at.length() - 0.05).abs() < surface.spacing_m();
        let most_m = if is_shell { 1e-8 } else { 0.2 * 0.0025 };
        assert!((found.value_m - value_m).abs() < most_m, "{at}: {found:?} {value_m}");
    }
}

#[test]
fn sides_are_right_of_torus_cube_hollow_ball_and_thin_plate() {
    let ring = build(torus(6000, 0.05, 0.02));
    let raster =
        ring.rasterize(lattice_around(&ring, 0.02, 0.003), &WorkMeter::unlimited()).unwrap();
    assert_eq!(n_wrong(&raster, 1e-4, |at| depth_in_torus(at, 0.05, 0.02)), 0);
    let share = volume_m3(&raster) / (2.0 * PI * PI * 0.05 * 0.02 * 0.02);
    assert!((share - 1.0).abs() < 5e-3, "{share}");

    let block = build(cube(30, 0.1));
    let raster =
        block.rasterize(lattice_around(&block, 0.05, 0.004), &WorkMeter::unlimited()).unwrap();
    assert_eq!(
        n_wrong(&raster, 0.3 * block.spacing_m(), |at| depth_in_box(at, DVec3::splat(0.1))),
        0
    );
    let share = volume_m3(&raster) / 1e-3;
    assert!((share - 1.0).abs() < 1e-2, "{share}");

    let hollow = build(shell_between(4000, 0.05, 0.03));
    let raster =
        hollow.rasterize(lattice_around(&hollow, 0.01, 0.003), &WorkMeter::unlimited()).unwrap();
    assert_eq!(n_wrong(&raster, 1e-4, |at| (0.05 - at.length()).min(at.length() - 0.03)), 0);

    // Twice as thick as the spacing, and thinner than the lattice: far nodes are beyond the other
    // side.
    let size_m = DVec3::new(0.1, 0.08, 0.004);
    let plate = build(sample(&Shape::Box { size_m }.tessellate(1e-3), 0.002).unwrap());
    for spacing_m in [0.001, 0.003, 0.011] {
        let raster = plate
            .rasterize(lattice_around(&plate, 0.03, spacing_m), &WorkMeter::unlimited())
            .unwrap();
        assert_eq!(
            n_wrong(&raster, 0.4 * plate.spacing_m(), |at| depth_in_box(at, size_m)),
            0,
            "{spacing_m}"
        );
    }
    for at in &plate.points().positions_map {
        let inner = (at.abs() - size_m / 2.0).cmplt(DVec3::new(-0.006, -0.006, 1.0)).all();
        assert!(
            !inner || plate.at(*at).value_m.abs() < 0.05 * plate.spacing_m(),
            "{at}: {:?}",
            plate.at(*at)
        );
    }
}

#[test]
fn beyond_the_edge_of_a_blade_is_air() {
    // A wedge of 20°, its edge along y at the origin, opening towards −x.
    let (sin, cos) = 10.0_f64.to_radians().sin_cos();
    let mut points = PointSet::default();
    for k in 0..40 {
        for j in 0..60 {
            let along = (f64::from(k) + 0.3) * 1e-3;
            let y = f64::from(j) * 1e-3;
            for side in [1.0, -1.0] {
                // Not opposite each other.
                let along = along + if side > 0.0 { 0.0 } else { 4e-4 };
                points.push(
                    DVec3::new(-along * cos, y, side * along * sin),
                    DVec3::new(sin, 0.0, side * cos),
                    [0; 3],
                );
            }
        }
    }
    for j in 0..60 {
        for k in 0..14 {
            let z = (f64::from(k) / 13.0 - 0.5) * 2.0 * 0.04 * sin;
            points.push(DVec3::new(-0.0402 * cos, f64::from(j) * 1e-3, z), -DVec3::X, [0; 3]);
        }
    }
    let blade = build(points);
    assert!(blade.is_closed());
    for k in 0..200 {
        let (sin, cos) = (f64::from(k) / 199.0 * 2.8 - 1.4).sin_cos();
        for distance_m in [0.004, 0.01, 0.03] {
            let at = DVec3::new(cos * distance_m, 0.03, sin * distance_m);
            assert!(blade.at(at).value_m < 0.0, "{at}: {:?}", blade.at(at));
        }
    }
}

#[test]
fn points_near_the_surface_are_projected_on_it() {
    let surface = build(torus(6000, 0.05, 0.02));
    for (k, at) in surface.points().positions_map.iter().enumerate().step_by(7) {
        let normal = surface.points().normals_map[k];
        let found = surface.project(*at + normal * (0.003 * ((k % 5) as f64 - 2.0))).unwrap();
        assert!(depth_in_torus(found, 0.05, 0.02).abs() < 1e-5, "{found}");
        assert!(found.distance(*at) < 1e-3);
    }
    assert_eq!(surface.project(DVec3::NAN), None);
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    let with = |n_threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().unwrap();
        pool.install(|| {
            let mut surface = build(torus(9000, 0.05, 0.02));
            surface.replace(&[3, 4, 500], &sphere(200, 0.01), &WorkMeter::unlimited()).unwrap();
            let raster = surface
                .rasterize(lattice_around(&surface, 0.02, 0.004), &WorkMeter::unlimited())
                .unwrap();
            let all: Vec<u32> = (0..500).collect();
            surface
                .refresh(
                    &all,
                    |at| raster.at(at).map(|density| f64::from(density.value_m)),
                    &WorkMeter::unlimited(),
                )
                .unwrap();
            let again = surface.rasterize(*raster.lattice(), &WorkMeter::unlimited()).unwrap();
            raster
                .values_m()
                .iter()
                .chain(again.values_m())
                .map(|value| value.to_bits())
                .collect::<Vec<u32>>()
        })
    };
    assert_eq!(with(1), with(4));
}

#[test]
fn refreshed_fits_follow_the_field_that_they_are_taken_from() {
    let mut surface = build(sphere(4500, 0.05));
    // Grown by a millimetre.
    let moved: Vec<SampleMove> = (0..4500)
        .map(|sample| {
            let normal_map = surface.points().normals_map[sample as usize];
            SampleMove { sample, position_map: normal_map * 0.051, normal_map }
        })
        .collect();
    surface.move_samples(&moved).unwrap();
    let all: Vec<u32> = (0..4500).collect();
    surface.refresh(&all, |at| Some(0.051 - at.length()), &WorkMeter::unlimited()).unwrap();
    for at in surface.points().positions_map.iter().step_by(10) {
        let found = surface.at(*at);
        assert!(found.value_m.abs() < 1e-3 * surface.spacing_m(), "{found:?}");
        assert!((found.gradient + at.normalize()).length() < 1e-2, "{found:?}");
    }
    // A field that ends leaves it to the neighbours.
    let before = surface.at(DVec3::X * 0.0512).value_m;
    surface.refresh(&all, |_| None, &WorkMeter::unlimited()).unwrap();
    assert!((surface.at(DVec3::X * 0.0512).value_m - before).abs() < 1e-5);
}

#[test]
fn replaced_samples_give_the_surface_that_is_built_of_all() {
    let points = torus(6000, 0.05, 0.02);
    let mut surface = build(points.clone());
    let (removed, kept): (Vec<u32>, Vec<u32>) =
        (0..points.len() as u32).partition(|sample| sample % 11 == 0 && *sample < 3000);
    surface.replace(&removed, &PointSet::default(), &WorkMeter::unlimited()).unwrap();
    assert_eq!(surface.points(), &points.select(kept.iter().copied()));
    surface.replace(&[], &points.select(removed.iter().copied()), &WorkMeter::unlimited()).unwrap();
    let order: Vec<u32> = kept.into_iter().chain(removed).collect();
    let whole = build(points.select(order.iter().copied()));
    assert_eq!(surface.points(), whole.points());
    for at in points.positions_map.iter().step_by(3) {
        let a = surface.at(*at * 1.001);
        let b = whole.at(*at * 1.001);
        assert!((a.value_m - b.value_m).abs() < 1e-6 * whole.spacing_m(), "{a:?} {b:?}");
    }
    // What cannot be leaves all as it was.
    let twice = points.select([7].into_iter());
    assert!(matches!(
        surface.replace(&[], &twice, &WorkMeter::unlimited()),
        Err(SurfaceError::Coincident { .. })
    ));
    assert_eq!(surface.points().len(), points.len());
    let all: Vec<u32> = (0..points.len() as u32).collect();
    assert_eq!(
        surface.replace(&all, &PointSet::default(), &WorkMeter::unlimited()),
        Err(SurfaceError::TooFew { found: 0 })
    );
}

#[test]
fn borders_are_found_at_holes_and_nowhere_else() {
    let size_m = DVec3::new(0.1, 0.08, 0.02);
    for points in [
        sphere(3000, 0.05),
        torus(6000, 0.05, 0.02),
        cube(30, 0.1),
        sample(&Shape::Sphere { radius_m: 0.05 }.tessellate(1e-4), 0.003).unwrap(),
        sample(&Shape::Box { size_m }.tessellate(1e-3), 0.002).unwrap(),
    ] {
        let surface = build(points);
        let border = surface.border();
        assert!(
            border.is_empty(),
            "{:?}",
            surface.points().select(border.into_iter()).positions_map
        );
    }
    let ball = sphere(4500, 0.05);
    let open =
        ball.select((0..4500).filter(|sample| ball.positions_map[*sample as usize].z < 0.045));
    let surface = build(open);
    assert!(surface.is_closed());
    let border = surface.border();
    let rim = TAU * (0.05_f64.powi(2) - 0.045_f64.powi(2)).sqrt() / surface.spacing_m();
    assert!((border.len() as f64 / rim - 1.0).abs() < 0.4, "{} of {rim}", border.len());
    for sample in border {
        assert!(
            surface.points().positions_map[sample as usize].z > 0.045 - 2.0 * surface.spacing_m()
        );
    }
    // A cap closes it: the middle of the ball is inside, what is above the hole is not.
    assert!(surface.at(DVec3::ZERO).value_m > 0.0 && surface.at(DVec3::Z * 0.06).value_m < 0.0);
}

#[test]
fn strays_do_not_reach_the_surface() {
    let mut points = sphere(2000, 0.05);
    points.push(DVec3::new(0.3, 0.1, 0.0), DVec3::X, [0; 3]);
    let surface = build(points);
    for at in surface.points().positions_map.iter().take(2000) {
        assert!(surface.at(*at).value_m.abs() < 1e-3 * surface.spacing_m());
    }
}

#[test]
fn samples_that_make_no_surface_are_named() {
    let ball = sphere(100, 0.05);
    let refused = |change: &dyn Fn(&mut PointSet)| {
        let mut points = ball.clone();
        change(&mut points);
        PointSurface::build(points, PointSurface::DEFAULT_NEIGHBOURS).unwrap_err()
    };
    assert_eq!(refused(&|points| *points = points.select(0..3)), SurfaceError::TooFew { found: 3 });
    let error = refused(&|points| points.positions_map[50] = points.positions_map[20]);
    assert!(matches!(error, SurfaceError::Coincident { first: 20, second: 50, .. }), "{error}");
    let error = refused(&|points| points.positions_map[9].x = f64::INFINITY);
    assert!(matches!(error, SurfaceError::NonFinite { sample: 9, .. }), "{error}");
    let error = refused(&|points| points.normals_map[9] *= 2.0);
    assert!(matches!(error, SurfaceError::BadNormal { sample: 9, .. }), "{error}");
    let error = refused(&|points| points.colors.truncate(4));
    assert_eq!(
        error.to_string(),
        "100 positions, 100 normals and 4 colours: every point needs one of each"
    );
    assert_eq!(
        PointSurface::build(ball, 4).unwrap_err().to_string(),
        "4 neighbours, 8 to 128 are possible"
    );
}
