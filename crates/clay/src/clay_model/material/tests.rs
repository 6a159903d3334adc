use super::super::tests::{R, ball, stroke};
use super::super::{Boolean, PointSurface};
use super::*;
use crate::dynamics::Quantity;
use crate::falloff::Falloff;
use crate::shapes::sphere;

fn brush(radius_m: f64) -> Brush {
    Brush {
        color: [0, 0, 200],
        radius_m_per_n: radius_m,
        radius_max_m: radius_m,
        falloff: Falloff::Constant,
        smallest_m: 1e-3,
    }
}

fn stiff(value: f32) -> Painted {
    Painted { stiffness_n_per_m: Some(value), ..Painted::default() }
}

#[test]
fn painted_material_is_a_stroke_of_its_own_that_moves_nothing() {
    let mut model = ball();
    let before = model.points().clone();
    let clay = model.settings().material.clone();
    let n_painted = model.paint_material(&brush(4e-3), stiff(700.0), DVec3::Z * R, 1.0).unwrap();
    assert!(n_painted > 100, "{n_painted}");
    assert!(model.is_stroke());
    assert_eq!(
        model.paint_material(&brush(4e-3), stiff(700.0), DVec3::Z * R, 1.0).unwrap(),
        0,
        "twice in one press is once"
    );
    // Another material is another press.
    assert!(model.paint_material(&brush(2e-3), stiff(80.0), DVec3::Z * R, 1.0).unwrap() > 10);
    model.end_stroke().unwrap();
    assert_eq!((model.history(), model.strokes()), ((2, 0), 2));
    let stiffness = |model: &ClayModel, away_m: f64| {
        model.material_at(DVec3::Z * (R - away_m)).stiffness_n_per_m
    };
    assert_eq!(
        [0.0, 3e-3, 6e-3].map(|away_m| stiffness(&model, away_m)),
        [80.0, 700.0, clay.stiffness_n_per_m]
    );
    assert_eq!(model.material_at(DVec3::ONE), clay, "far from the clay");
    assert_eq!(model.density_m(DVec3::Z * R * 0.9), ball().density_m(DVec3::Z * R * 0.9));
    let blue = model
        .points()
        .positions_map
        .iter()
        .zip(&model.points().colors)
        .filter(|(_, color)| **color == [0, 0, 200]);
    let farthest_m = blue.map(|(at, _)| at.distance(DVec3::Z * R)).fold(0.0, f64::max);
    assert!((3.5e-3..4.1e-3).contains(&farthest_m), "{farthest_m}");

    assert!(model.undo().unwrap());
    assert_eq!([0.0, 3e-3].map(|away_m| stiffness(&model, away_m)), [700.0; 2]);
    assert!(model.undo().unwrap() && model.material_map().is_bare());
    assert!(*model.points() == before);
    assert!(model.redo().unwrap());
    assert_eq!(stiffness(&model, 0.0), 700.0);
    model.paint_material(&brush(4e-3), stiff(9.0), DVec3::Z * R, 1.0).unwrap();
    model.cancel_stroke();
    assert_eq!(stiffness(&model, 0.0), 700.0);
    assert_eq!(
        model.paint_material(&brush(4e-3), stiff(9.0), DVec3::Z, 1.0).unwrap(),
        0,
        "out of reach"
    );
    assert!(!model.is_stroke());
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn what_is_stiffer_gives_way_less_from_the_next_stroke_on_and_after_undo_as_before() {
    let dent_m = |model: &mut ClayModel| {
        stroke(model, -1.0);
        let dent_m = R - model.onto(DVec3::Z * R, 0.01).unwrap().0.z;
        assert!(model.undo().unwrap());
        dent_m
    };
    let mut model = ball();
    let soft_m = dent_m(&mut model);
    model.paint_material(&brush(8e-3), Painted::default(), DVec3::Z * R, 1.0).unwrap();
    let stiff_m = dent_m(&mut model);
    assert!(stiff_m < 0.5 * soft_m, "{stiff_m} m of {soft_m} m");
    // Undo of the dent leaves the material, that of the paint does not.
    assert_eq!(model.material_at(DVec3::Z * R).stiffness_n_per_m, 500.0);
    assert!(model.undo().unwrap());
    assert_eq!(dent_m(&mut model), soft_m);
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn painted_material_goes_along_to_another_region_and_through_a_boolean() {
    let mut model = ball();
    model.paint_material(&brush(4e-3), stiff(700.0), DVec3::Z * R, 1.0).unwrap();
    model.end_stroke().unwrap();
    let stiffness = |model: &ClayModel, away_m: f64| {
        model.material_at(DVec3::Z * (R - away_m)).stiffness_n_per_m
    };
    // Away from it, and back with mass points half as far apart.
    model
        .choose_region(DVec3::new(-0.03, -0.012, -0.012), DVec3::new(-0.006, 0.012, 0.012))
        .unwrap();
    assert_eq!([stiffness(&model, 2e-3), stiffness(&model, 8e-3)], [700.0, 50.0]);
    model
        .choose_region(DVec3::new(-0.006, -0.006, 0.014), DVec3::new(0.006, 0.006, 0.026))
        .unwrap();
    assert!((stiffness(&model, 2e-3) - 700.0).abs() < 0.1, "{}", stiffness(&model, 2e-3));
    assert_eq!(stiffness(&model, 8e-3), 50.0);
    let dynamics = model.region.dynamics.material_mut().clone();
    assert!(
        matches!(dynamics.stiffness_n_per_m, Quantity::PerNode(_))
            && matches!(dynamics.mass_kg, Quantity::Constant(_))
    );

    let mut bite = sphere(2000, 0.01);
    bite.positions_map.iter_mut().for_each(|at| *at += DVec3::X * R);
    let bite = PointSurface::build(bite, PointSurface::DEFAULT_NEIGHBOURS).unwrap();
    model.combine(Boolean::Union, &bite, false).unwrap();
    assert!((stiffness(&model, 2e-3) - 700.0).abs() < 0.1, "{}", stiffness(&model, 2e-3));
    while model.undo().unwrap() {}
    assert!(model.material_map().is_bare());
}
