use glam::DVec3;

use super::*;

const SPACING_M: f64 = 1e-3;

fn lattice(spacing_m: f64, n: usize) -> Lattice {
    Lattice {
        origin_map: DVec3::splat(-0.5 * spacing_m * (n - 1) as f64),
        spacing_m,
        dims: [n, n + 1, n + 2],
    }
}

fn dab(at_map: DVec3, radius_m: f64) -> Dab {
    Dab { at_map, normal_map: DVec3::Z, radius_m }
}

fn all_nodes(lattice: &Lattice) -> impl Iterator<Item = (usize, DVec3)> + '_ {
    let [nx, ny, nz] = lattice.dims;
    let nodes =
        (0..nx).flat_map(move |x| (0..ny).flat_map(move |y| (0..nz).map(move |z| [x, y, z])));
    nodes.map(|node| (lattice.index(node), lattice.position(node)))
}

fn stiff(value: f32) -> Painted {
    Painted { stiffness_n_per_m: Some(value), ..Painted::default() }
}

#[test]
fn the_fall_off_mixes_with_what_was_there_and_a_press_keeps_the_most() {
    let lattice = lattice(SPACING_M, 21);
    let clay = Material::default();
    let mut map = MaterialMap::default();
    let radius_m = 5e-3;
    let places = [DVec3::ZERO, DVec3::X * 3e-3, DVec3::ZERO];
    let mut under = clay.stiffness_n_per_m;
    for painted in [500.0_f32, 20.0] {
        let mut coat = MaterialCoat::over(&map, lattice.n_nodes(), stiff(painted));
        let before = map.clone();
        let n: Vec<usize> = places
            .map(|at| coat.dab(&mut map, (&lattice, &clay), &Falloff::Spherical, dab(at, radius_m)))
            .into_iter()
            .collect();
        assert!(n[0] > 400 && n[1] > 0 && n[2] == 0, "{n:?}: the same dab again adds nothing");
        for (node, at) in all_nodes(&lattice) {
            let weight = places
                .iter()
                .map(|place| Falloff::Spherical.weight(at.distance(*place) / radius_m))
                .fold(0.0, f64::max) as f32;
            let was = before.at(node, &clay).stiffness_n_per_m;
            let is = map.at(node, &clay);
            assert!(
                (is.stiffness_n_per_m - (painted * weight + was * (1.0 - weight))).abs() < 1e-3,
                "{at}: {is:?}"
            );
            assert_eq!((is.mass_kg, is.damping_n_s_per_m), (clay.mass_kg, clay.damping_n_s_per_m));
            if weight == 0.0 {
                assert_eq!(is, clay);
            }
        }
        // The middle is painted all through, whatever was there.
        let middle = lattice.index([10, 10, 10]);
        assert_ne!(map.at(middle, &clay).stiffness_n_per_m, under);
        under = map.at(middle, &clay).stiffness_n_per_m;
    }
}

#[test]
fn a_brush_finer_than_the_lattice_and_one_at_its_corner_paint_too() {
    let lattice = lattice(SPACING_M, 6);
    let clay = Material::default();
    let painted = |at: DVec3, radius_m: f64| {
        let mut map = MaterialMap::default();
        let mut coat = MaterialCoat::over(&map, lattice.n_nodes(), stiff(500.0));
        coat.dab(&mut map, (&lattice, &clay), &Falloff::Constant, dab(at, radius_m))
    };
    assert!((1..=8).contains(&painted(DVec3::splat(0.2e-3), 1e-5)));
    assert_eq!(
        painted(lattice.origin_map - 0.9 * SPACING_M, 2.5e-3),
        4,
        "a corner and the nodes beside it"
    );
    assert_eq!(painted(lattice.origin_map - 1.0, 2e-3), 0);
    for (at, radius_m) in [
        (DVec3::NAN, 1e-3),
        (DVec3::ZERO, 0.0),
        (DVec3::ZERO, f64::NAN),
        (DVec3::ZERO, f64::INFINITY),
    ] {
        assert_eq!(painted(at, radius_m), 0);
    }
}

#[test]
fn what_is_not_said_is_ten_times_as_hard() {
    let clay = Material { stiffness_n_per_m: 30.0, damping_n_s_per_m: 0.2, ..Material::default() };
    let harder =
        Painted { stiffness_n_per_m: Some(300.0), damping_n_s_per_m: Some(2.0), mass_kg: None };
    assert_eq!(Painted::default().or_harder(&clay), harder);
    let said = Painted { damping_n_s_per_m: Some(3.0), ..Painted::default() };
    assert_eq!(said.or_harder(&clay), said);
    let hardest = Material { stiffness_n_per_m: 9e5, damping_n_s_per_m: 9e3, ..clay };
    assert_eq!(Painted::default().or_harder(&hardest).unsound(), None);
    assert_eq!(Painted::default().unsound(), None);
    for (wrong, name) in [
        (Painted { mass_kg: Some(0.0), ..said }, "a mass"),
        (Painted { mass_kg: Some(f32::NAN), ..said }, "a mass"),
        (Painted { damping_n_s_per_m: Some(-1.0), ..said }, "a damping"),
        (stiff(0.0), "a stiffness"),
        (stiff(2e6), "a stiffness"),
    ] {
        assert_eq!(wrong.unsound().map(|(name, ..)| name), Some(name), "{wrong:?}");
    }
}

/// A ball of radius 4 mm with five times the default stiffness, in the middle.
fn ball(lattice: &Lattice) -> MaterialMap {
    let mut map = MaterialMap::default();
    let mut coat = MaterialCoat::over(&map, lattice.n_nodes(), stiff(250.0));
    coat.dab(&mut map, (lattice, &Material::default()), &Falloff::Constant, dab(DVec3::ZERO, 4e-3));
    map
}

#[test]
fn another_lattice_is_painted_where_the_one_before_was() {
    let coarse = lattice(SPACING_M, 21);
    let clay = Material::default();
    let map = ball(&coarse);
    // Half as far apart, somewhere else, and over only a part.
    let fine = Lattice {
        origin_map: DVec3::new(-3.2e-3, -6.1e-3, 0.3e-3),
        spacing_m: 0.5e-3,
        dims: [30, 31, 32],
    };
    let moved = map.onto(&coarse, &fine, &clay);
    for (node, at) in all_nodes(&fine) {
        let stiffness = moved.at(node, &clay).stiffness_n_per_m;
        if at.length() < 4e-3 - 3.0_f64.sqrt() * SPACING_M {
            assert!((stiffness - 250.0).abs() < 1e-3, "{at}: {stiffness}");
        } else if at.length() > 4e-3 + 3.0_f64.sqrt() * SPACING_M {
            assert_eq!(stiffness.to_bits(), 50.0_f32.to_bits(), "{at}");
        }
        assert!((50.0..250.001).contains(&stiffness), "{at}: {stiffness}");
    }
    assert!(
        map.onto(&coarse, &coarse, &clay).n_bytes_beside(&map) == 0,
        "the same lattice shares all values"
    );
    // Nodes that both have keep their values.
    let larger =
        Lattice { origin_map: coarse.origin_map - 3.0 * SPACING_M, dims: [27, 28, 29], ..coarse };
    let back = map.onto(&coarse, &larger, &clay).onto(&larger, &coarse, &clay);
    assert!(back.is_same(&map));
    let elsewhere = Lattice { origin_map: DVec3::splat(0.1), ..coarse };
    assert!(map.onto(&coarse, &elsewhere, &clay).is_bare());
}

#[test]
fn a_part_is_one_number_where_nothing_was_painted() {
    let whole = lattice(SPACING_M, 21);
    let clay = Material::default();
    let map = ball(&whole);
    let cut = |first: [usize; 3]| {
        let part = Lattice { origin_map: whole.position(first), dims: [5, 6, 7], ..whole };
        (part, map.of_part(&whole, first, &part, &clay))
    };
    assert_eq!(cut([0, 0, 0]).1, Material::from(clay.clone()));
    let (part, material) = cut([8, 8, 8]);
    let Quantity::PerNode(values) = &material.stiffness_n_per_m else { panic!("{material:?}") };
    for (node, at) in all_nodes(&part) {
        assert_eq!(values[node], if at.length() <= 4e-3 + 1e-12 { 250.0 } else { 50.0 }, "{at}");
    }
    assert_eq!(material.mass_kg, Quantity::Constant(clay.mass_kg));
}

#[test]
fn values_are_counted_once_where_they_are_shared() {
    let lattice = lattice(SPACING_M, 21);
    let map = ball(&lattice);
    assert_eq!((map.n_bytes(), map.n_bytes_beside(&map.clone())), (4 * lattice.n_nodes(), 0));
    let mut damped = map.clone();
    let damping = Painted { damping_n_s_per_m: Some(1.0), ..Painted::default() };
    let mut coat = MaterialCoat::over(&damped, lattice.n_nodes(), damping);
    coat.dab(
        &mut damped,
        (&lattice, &Material::default()),
        &Falloff::Constant,
        dab(DVec3::ZERO, 1e-3),
    );
    assert_eq!(
        (damped.n_bytes(), damped.n_bytes_beside(&map)),
        (8 * lattice.n_nodes(), 4 * lattice.n_nodes())
    );
    assert!(map.is_same(&ball(&lattice)) && !damped.is_same(&map));
}
