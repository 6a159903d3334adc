use core::f64::consts::PI;
use std::sync::Arc;

use glam::DVec3;

use super::*;
use crate::SolidSource;
use crate::boolean::Boolean;
use crate::clay_model::Settings;
use crate::dynamics::Material;
use crate::emboss::{GreyImage, ImagePlacement};
use crate::falloff::Falloff;
use crate::material_map::{MaterialPlace, Painted};
use crate::shapes::sphere;
use vps::mesh::mass::mass_properties;
use vps::spatial::Pose;

const R: f64 = 0.02;
const UPDATE_S: f64 = 4e-3;
const TICKS: usize = 4;

fn model() -> ClayModel {
    let settings = Settings {
        region_map: Some((DVec3::new(-0.012, -0.012, 0.006), DVec3::new(0.012, 0.012, 0.030))),
        raster: [31; 3],
        air_m: 5e-3,
        material: Material { creep_s: 0.05, ..Material::default() },
        ..Settings::default()
    };
    ClayModel::new(sphere(4000, R), settings).unwrap()
}

fn tool(kind: SculptTool) -> ToolSettings {
    ToolSettings { kind, brush_m: 4e-3, ..ToolSettings::default() }
}

/// A point in a hand, with the springs of the tick.
struct Hand {
    engine: SculptEngine,
    at: DVec3,
    is_held: bool,
    has_force: bool,
}

impl Hand {
    fn with(kind: SculptTool) -> Self {
        Self::of(SculptEngine::new(model(), tool(kind), ToolBody::default()))
    }

    fn of(engine: SculptEngine) -> Self {
        Self { engine, at: DVec3::Z * (R + 8e-3), is_held: false, has_force: true }
    }

    /// Updates with the hand on its way to a place.
    fn go(&mut self, to: DVec3, n_updates: usize) {
        let from = self.at;
        for update in 0..n_updates {
            for tick in 1..=TICKS {
                let share = (update * TICKS + tick) as f64 / (n_updates * TICKS) as f64;
                self.at = from + (to - from) * share;
                let model = self.engine.model();
                let depth_m = model.density_m(self.at).unwrap_or(-1.0);
                let out = model.onto(self.at, 0.02).map_or(DVec3::ZERO, |(_, normal)| normal);
                let force_map =
                    if depth_m > 0.0 { out * (1500.0 * depth_m).min(8.0) } else { DVec3::ZERO };
                let stretch = self.engine.rope_map().map_or(DVec3::ZERO, |anchor| anchor - self.at);
                self.engine.take_motion(&ToolMotion {
                    map_from_tool: Pose::from_translation(self.at),
                    force_map,
                    rope_map: (stretch * 1000.0).clamp_length_max(6.0),
                    touches: depth_m > 0.0,
                    is_held: self.is_held,
                    has_force: self.has_force,
                });
            }
            self.engine.advance(UPDATE_S);
        }
    }

    /// Where a ray from above meets the surface.
    fn top_m(&self) -> f64 {
        let step_m = 2e-5;
        let inside = |n: &u32| {
            self.engine
                .model()
                .density_m(DVec3::Z * (R + 9e-3 - step_m * f64::from(*n)))
                .unwrap_or(-1.0)
                > 0.0
        };
        R + 9e-3 - step_m * f64::from((0..1000).find(inside).unwrap())
    }

    fn history(&self) -> (usize, usize) {
        self.engine.model().history()
    }

    fn volume_m3(&self) -> f64 {
        mass_properties(&self.engine.model().mesh().unwrap()).volume_m3
    }
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn push_dents_until_the_hand_is_not_resisted_and_ends_when_it_has_left() {
    let mut hand = Hand::with(SculptTool::Push);
    hand.go(DVec3::Z * R, 20);
    assert_eq!(hand.history(), (0, 0), "nothing was touched");
    hand.go(DVec3::Z * (R - 2e-3), 50);
    hand.go(DVec3::Z * (R - 2e-3), 250);
    let dented_m = hand.top_m();
    assert!((dented_m - (R - 2e-3)).abs() < 0.4e-3, "{dented_m}");
    hand.go(DVec3::Z * (R + 5e-3), 60);
    assert!(!hand.engine.model().is_stroke());
    assert_eq!(hand.history(), (1, 0));
    assert!(
        (hand.top_m() - dented_m).abs() < 0.5e-3,
        "clay stays where it was left: {} of {dented_m}",
        hand.top_m()
    );
    hand.engine.order(SculptOrder::Undo).unwrap();
    assert!((hand.top_m() - R).abs() < 5e-5);
}

#[test]
fn pull_leads_the_surface_to_the_hand_and_lets_go_with_it() {
    let mut hand = Hand::with(SculptTool::Pull);
    hand.go(DVec3::Z * (R + 1e-3), 10);
    hand.is_held = true;
    hand.go(DVec3::Z * (R + 1e-3), 1);
    let anchor = hand.engine.rope_map().unwrap();
    assert!((anchor - DVec3::Z * R).length() < 1e-4, "{anchor}");
    let length_m = 4e-3;
    hand.go(DVec3::Z * (R + length_m), 50);
    hand.go(DVec3::Z * (R + length_m), 300);
    let top_m = hand.top_m();
    let anchor = hand.engine.rope_map().unwrap();
    assert!((top_m - (R + length_m)).abs() < 0.6e-3, "{top_m}");
    assert!((anchor - DVec3::Z * top_m).length() < 0.2e-3, "{anchor} is on the surface at {top_m}");
    hand.is_held = false;
    hand.go(DVec3::Z * (R + 8e-3), 2);
    assert_eq!(
        (hand.engine.rope_map(), hand.engine.model().is_stroke(), hand.history()),
        (None, false, (1, 0))
    );
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn pull_curve_draws_first_and_then_lifts_all_of_it() {
    let mut hand = Hand::with(SculptTool::PullCurve);
    let along = |x: f64| DVec3::new(x, 0.0, (R * R - x * x).sqrt() + 0.5e-3);
    hand.go(along(-5e-3), 10);
    hand.is_held = true;
    for n in -10..=10 {
        hand.go(along(f64::from(n) * 0.5e-3), 2);
    }
    assert_eq!((hand.engine.rope_map(), hand.history()), (None, (0, 0)), "drawing moves nothing");
    hand.is_held = false;
    hand.go(along(0.0), 10);
    hand.is_held = true;
    hand.go(along(0.0), 1);
    assert!(hand.engine.rope_map().is_some());
    hand.go(along(0.0) + DVec3::Z * 3e-3, 250);
    hand.is_held = false;
    hand.go(along(0.0) + DVec3::Z * 8e-3, 2);
    assert_eq!(hand.history(), (1, 0));
    let raised_m = |at: DVec3| hand.engine.model().onto(at, 0.01).unwrap().0.length() - R;
    let heights: Vec<f64> =
        [-4e-3, -2e-3, 0.0, 2e-3, 4e-3].iter().map(|x| raised_m(along(*x))).collect();
    assert!(heights.iter().all(|height_m| *height_m > 0.7e-3), "{heights:?}");
    assert!(raised_m(DVec3::new(0.0, 8e-3, (R * R - 64e-6).sqrt())) < 0.2e-3);
}

/// Two short curves over the top of the ball, as chords that lie below the surface in their middle.
fn two_curves() -> RopeCurves {
    let on_ball = |x: f64, y: f64| DVec3::new(x, y, (R * R - x * x - y * y).sqrt());
    let along = |y: f64| vec![on_ball(-4e-3, y), on_ball(4e-3, y)];
    RopeCurves { curves_map: vec![along(-4e-3), along(4e-3)], is_free: false }
}

#[test]
fn curves_that_are_given_wait_for_a_hold_near_one_of_them_and_rise_together() {
    let mut hand = Hand::with(SculptTool::PullCurve);
    hand.engine.order(SculptOrder::Draw(two_curves())).unwrap();
    let shown = hand.engine.view().curves_map;
    assert_eq!(shown.len(), 2);
    assert!(
        shown.iter().flatten().all(|at| (at.length() - R).abs() < 1e-4),
        "they are laid onto the surface"
    );
    let pitch_m = hand.engine.model().region().lattice().spacing_m;
    assert!(
        shown
            .iter()
            .all(|curve| curve.windows(2).all(|ends| ends[0].distance(ends[1]) < 1.2 * pitch_m))
    );
    let over = |x: f64, y: f64| DVec3::new(x, y, (R * R - x * x - y * y).sqrt() + 0.5e-3);
    // Another tool in between does not lose them.
    let takes = |hand: &mut Hand, kind| {
        hand.engine
            .order(SculptOrder::Adjust(ToolChange { kind: Some(kind), ..ToolChange::default() }))
            .unwrap()
    };
    takes(&mut hand, SculptTool::Paint);
    hand.go(over(0.0, 8e-3) - DVec3::Z * 1.5e-3, 5);
    hand.go(over(0.0, 8e-3) + DVec3::Z * 5e-3, 60);
    let history = hand.history();
    takes(&mut hand, SculptTool::PullCurve);
    assert_eq!(hand.engine.view().curves_map.len(), 2);
    hand.has_force = false;
    hand.go(over(0.0, 4e-3), 5);
    hand.has_force = true;
    hand.go(over(0.0, 4e-3), 2);
    hand.is_held = true;
    hand.go(over(0.0, 4e-3), 1);
    let anchor = hand.engine.rope_map().expect("the curves were kept while no force flowed");
    assert!(anchor.y > 3e-3, "{anchor}");
    hand.go(over(0.0, 4e-3) + DVec3::Z * 3e-3, 60);
    hand.is_held = false;
    hand.go(over(0.0, 4e-3) + DVec3::Z * 8e-3, 2);
    assert_eq!((hand.history(), hand.engine.view().curves_map.len()), ((history.0 + 1, 0), 0));
    let raised_m = |y: f64| hand.engine.model().onto(over(0.0, y), 0.01).unwrap().0.length() - R;
    assert!(
        raised_m(4e-3) > 0.3e-3 && (raised_m(4e-3) - raised_m(-4e-3)).abs() < 0.1e-3,
        "{} {}",
        raised_m(4e-3),
        raised_m(-4e-3)
    );
    hand.engine.order(SculptOrder::Undo).unwrap();
    assert!((hand.top_m() - R).abs() < 5e-5);
}

#[test]
fn an_order_pulls_curves_for_its_time_as_one_stroke_that_can_be_undone() {
    let mut hand = Hand::with(SculptTool::Pull);
    let pull =
        |curves, force_map| SculptOrder::Pull { curves, force_map, time_s: 0.1, brush_m: None };
    hand.engine.order(pull(two_curves(), DVec3::Z * 4.0)).unwrap();
    hand.has_force = false;
    hand.go(DVec3::Z * (R + 8e-3), 10);
    assert!(hand.engine.model().is_stroke(), "no hand is needed");
    hand.go(DVec3::Z * (R + 8e-3), 30);
    assert_eq!((hand.engine.model().is_stroke(), hand.history()), (false, (1, 0)));
    let over = |y: f64| DVec3::new(0.0, y, (R * R - y * y).sqrt());
    let raised_m =
        |hand: &Hand, y: f64| hand.engine.model().onto(over(y), 0.01).unwrap().0.length() - R;
    let heights = [raised_m(&hand, -4e-3), raised_m(&hand, 4e-3)];
    assert!(heights[0] > 0.2e-3 && (heights[0] - heights[1]).abs() < 0.02e-3, "{heights:?}");
    hand.engine.order(SculptOrder::Undo).unwrap();
    assert!(raised_m(&hand, 4e-3).abs() < 2e-5);
    // While an order pulls, a hold is refused, and says why.
    hand.engine.order(pull(two_curves(), DVec3::Z)).unwrap();
    (hand.has_force, hand.is_held) = (true, true);
    hand.go(DVec3::Z * (R + 8e-3), 1);
    assert_eq!(hand.engine.grip(), HoldOutcome::Missed);
    assert!(hand.engine.trouble().contains("pulled by an order"), "{}", hand.engine.trouble());
}

#[test]
fn a_free_curve_inside_the_clay_lifts_the_surface_above_it() {
    let mut hand = Hand::with(SculptTool::Pull);
    let z_m = R - 2e-3;
    let inside = vec![DVec3::new(-3e-3, 0.0, z_m), DVec3::new(3e-3, 0.0, z_m)];
    let curves = RopeCurves { curves_map: vec![inside], is_free: true };
    hand.engine
        .order(SculptOrder::Pull {
            curves,
            force_map: DVec3::Z * 6.0,
            time_s: 0.15,
            brush_m: Some(5e-3),
        })
        .unwrap();
    hand.go(DVec3::Z * (R + 8e-3), 20);
    let first = hand.engine.view().curves_map[0][0];
    assert!(first.z > z_m + 1e-4, "the curve goes along with the clay around it: {first}");
    hand.go(DVec3::Z * (R + 8e-3), 60);
    assert!(hand.top_m() > R + 0.2e-3, "{}", hand.top_m());
}

#[test]
fn curves_that_make_no_sense_are_refused_in_words() {
    let mut engine = SculptEngine::new(model(), tool(SculptTool::PullCurve), ToolBody::default());
    let top = DVec3::Z * R;
    let laid = |curves_map| RopeCurves { curves_map, is_free: false };
    let pull = |curves, force_map, time_s, brush_m| SculptOrder::Pull {
        curves,
        force_map,
        time_s,
        brush_m,
    };
    let good = || laid(vec![vec![top]]);
    for (order, expected) in [
        (SculptOrder::Draw(laid(vec![vec![]])), "curve 1 has no place"),
        (SculptOrder::Draw(laid(vec![vec![DVec3::NAN]])), "curve 1 has no place"),
        (SculptOrder::Draw(laid(vec![vec![top]; 65])), "65 curves"),
        (
            SculptOrder::Draw(laid(vec![vec![DVec3::X * -1e6, DVec3::X * 1e6]])),
            "more than 4096 corners",
        ),
        (
            SculptOrder::Draw(laid(vec![vec![top + DVec3::Z * 9e-3]])),
            "no surface is within the brush",
        ),
        (SculptOrder::Draw(laid(vec![vec![DVec3::X * R]])), "outside of the region"),
        (
            SculptOrder::Draw(RopeCurves { curves_map: vec![vec![DVec3::ZERO]], is_free: true }),
            "outside of the region",
        ),
        (pull(laid(vec![]), DVec3::Z, 1.0, None), "0 curves"),
        (pull(good(), DVec3::ZERO, 1.0, None), "a pull of 0 N"),
        (pull(good(), DVec3::Z * 1001.0, 1.0, None), "a pull of 1001 N"),
        (pull(good(), DVec3::NAN, 1.0, None), "a pull of NaN N"),
        (pull(good(), DVec3::Z, 0.0, None), "a pull of 0 s"),
        (pull(good(), DVec3::Z, 61.0, None), "a pull of 61 s"),
        (pull(good(), DVec3::Z, 1.0, Some(-1.0)), "a brush of"),
    ] {
        let error = engine.order(order).unwrap_err();
        assert!(
            error.to_string().contains(expected) && !error.hint(&SettingNames::PLAIN).is_empty(),
            "{error}, not {expected}"
        );
        assert_eq!(engine.model().history(), (0, 0));
    }
    engine.order(SculptOrder::Draw(good())).unwrap();
    engine.order(SculptOrder::Draw(RopeCurves::default())).unwrap();
    assert!(engine.view().curves_map.is_empty());
}

/// How far an order's pull at the top lifts the surface, m; undone afterwards.
fn lifted_m(hand: &mut Hand) -> f64 {
    let curves = RopeCurves { curves_map: vec![vec![DVec3::Z * R]], is_free: false };
    hand.engine
        .order(SculptOrder::Pull { curves, force_map: DVec3::Z * 2.0, time_s: 0.1, brush_m: None })
        .unwrap();
    hand.go(DVec3::Z * (R + 8e-3), 40);
    let lifted_m = hand.top_m() - R;
    hand.engine.order(SculptOrder::Undo).unwrap();
    lifted_m
}

#[test]
fn material_is_laid_everywhere_in_a_box_a_ball_along_a_gradient_and_by_values_and_each_is_undone() {
    let mut hand = Hand::with(SculptTool::Touch);
    let soft_m = lifted_m(&mut hand);
    let clay = hand.engine.model().settings().material.clone();
    let hard = Painted {
        stiffness_n_per_m: Some(10.0 * clay.stiffness_n_per_m),
        damping_n_s_per_m: Some(10.0 * clay.damping_n_s_per_m),
        mass_kg: None,
    };
    let top = DVec3::Z * R;
    let below = DVec3::Z * (R - 4e-3);
    // The place, and the stiffness at the top and 4 mm below it, over that of the clay.
    let at_top: Vec<DVec3> = vec![top];
    for (place, expected) in [
        (MaterialPlace::Everywhere, [10.0, 10.0]),
        (MaterialPlace::Box { low_map: top - 2e-3, high_map: top + 8e-3 }, [10.0, 1.0]),
        (
            MaterialPlace::Ball { center_map: top, radius_m: 3e-3, falloff: Falloff::Constant },
            [10.0, 1.0],
        ),
        (MaterialPlace::Gradient { from_map: DVec3::Z * (R - 8e-3), to_map: top }, [10.0, 5.5]),
        (
            MaterialPlace::Values {
                places_map: at_top.into(),
                painted: vec![hard].into(),
                within_m: 3e-3,
            },
            [10.0, 1.0],
        ),
    ] {
        let order = SculptOrder::Lay { painted: hard, place: place.clone() };
        hand.engine.order(order).unwrap();
        assert_eq!(hand.history(), (1, 0), "{place:?} is one stroke");
        for (at, times) in [top, below].into_iter().zip(expected) {
            // The mass point nearest to a place is up to half a spacing away.
            let stiffness =
                hand.engine.model().material_at(at).stiffness_n_per_m / clay.stiffness_n_per_m;
            assert!(
                (f64::from(stiffness) - times).abs() < 0.6,
                "{place:?} at {at}: {stiffness} times"
            );
        }
        let lifted_m = lifted_m(&mut hand);
        assert!(lifted_m < 0.35 * soft_m, "{place:?}: {lifted_m} of {soft_m}");
        hand.engine.order(SculptOrder::Undo).unwrap();
        assert_eq!(hand.engine.model().material_at(top), clay, "{place:?} is undone");
        assert_eq!(hand.engine.view().material, clay);
    }
    hand.engine.order(SculptOrder::Redo).unwrap();
    assert!(hand.engine.model().material_at(top).stiffness_n_per_m > 9.0 * clay.stiffness_n_per_m);
}

#[test]
fn material_that_makes_no_sense_or_reaches_nothing_is_refused() {
    let mut engine = SculptEngine::new(model(), tool(SculptTool::Touch), ToolBody::default());
    let lay = |place| SculptOrder::Lay {
        painted: Painted { mass_kg: Some(1e-3), ..Painted::default() },
        place,
    };
    for (order, expected) in [
        (
            SculptOrder::Lay {
                painted: Painted { mass_kg: Some(9.0), ..Painted::default() },
                place: MaterialPlace::Everywhere,
            },
            "a mass of 9",
        ),
        (lay(MaterialPlace::Box { low_map: DVec3::Z, high_map: DVec3::ZERO }), "a box"),
        (
            lay(MaterialPlace::Ball {
                center_map: DVec3::ZERO,
                radius_m: f64::NAN,
                falloff: Falloff::Gaussian,
            }),
            "a ball",
        ),
        (lay(MaterialPlace::Gradient { from_map: DVec3::Z, to_map: DVec3::Z }), "a gradient"),
        (
            lay(MaterialPlace::Values {
                places_map: vec![DVec3::Z].into(),
                painted: vec![].into(),
                within_m: 1e-3,
            }),
            "0 values",
        ),
        (
            lay(MaterialPlace::Box { low_map: DVec3::splat(1.0), high_map: DVec3::splat(2.0) }),
            "no mass point",
        ),
    ] {
        let error = engine.order(order).unwrap_err();
        assert!(
            error.to_string().contains(expected) && !error.hint(&SettingNames::PLAIN).is_empty(),
            "{error}, not {expected}"
        );
        assert_eq!(engine.model().history(), (0, 0));
    }
}

#[test]
fn the_hand_chooses_the_region_by_two_corners_that_it_holds_between() {
    let mut hand = Hand::with(SculptTool::Region);
    let from = DVec3::new(-6e-3, -5e-3, R - 6e-3);
    let to = DVec3::new(6e-3, 7e-3, R + 4e-3);
    hand.go(from, 5);
    hand.is_held = true;
    hand.go(from, 1);
    hand.go(to, 10);
    hand.is_held = false;
    hand.go(to, 1);
    let (low, high) = hand.engine.model().region_map();
    // A raster of as many mass points along z as along x reaches beyond the box there.
    assert!(
        (low - from).truncate().abs().max_element() < 1e-9
            && (high - to).truncate().abs().max_element() < 1e-9,
        "{low} {high}"
    );
    assert!(low.z <= from.z && high.z >= to.z, "{low} {high}");
    // Corners that are one place make no box: it stays, and the page says why.
    hand.is_held = true;
    hand.go(to, 1);
    hand.is_held = false;
    hand.go(to, 1);
    assert_eq!(hand.engine.model().region_map(), (low, high));
    assert!(hand.engine.trouble().contains("is empty"), "{}", hand.engine.trouble());
}

#[test]
fn a_chosen_solid_takes_the_place_of_the_tools_own_shape() {
    let mut hand = Hand::with(SculptTool::Union);
    let source = Arc::new(SolidSource::Shape(
        vps::mesh::primitives::Shape::Sphere { radius_m: 5e-3 },
        DVec3::ONE,
    ));
    let solid = Some(Some(ChosenSolid { source, name: "a ball".into() }));
    hand.engine.order(SculptOrder::Adjust(ToolChange { solid, ..ToolChange::default() })).unwrap();
    hand.go(DVec3::Z * (R + 3e-3), 5);
    hand.is_held = true;
    hand.go(DVec3::Z * (R + 3e-3), 1);
    assert_eq!(hand.history(), (1, 0), "{}", hand.engine.trouble());
    assert!((hand.top_m() - (R + 8e-3)).abs() < 0.3e-3, "{}", hand.top_m());
}

#[test]
fn paint_is_as_wide_as_the_force_and_one_press_is_one_stroke() {
    let red = [250, 10, 20];
    let settings =
        ToolSettings { color: red, falloff: Falloff::Constant, ..tool(SculptTool::Paint) };
    let mut engine = SculptEngine::new(model(), settings, ToolBody::default());
    let before = engine.model().points().clone();
    // The densities are off the ball by some micrometres.
    let (middle_map, _) = engine.model().onto(DVec3::Z * (R - 1e-4), 4e-3).unwrap();
    let touch = |engine: &mut SculptEngine, force_n: f64| {
        engine.take_motion(&ToolMotion {
            map_from_tool: Pose::from_translation(DVec3::Z * (R - 1e-4)),
            force_map: DVec3::Z * force_n,
            touches: force_n > 0.0,
            has_force: true,
            ..ToolMotion::default()
        });
        engine.advance(UPDATE_S);
    };
    (0..25).for_each(|_| touch(&mut engine, 1.0));
    (0..100).for_each(|_| touch(&mut engine, 0.0));
    assert_eq!((engine.model().history(), engine.model().is_stroke()), ((1, 0), false));
    // 1 N of 2 N: half the brush.
    let mut n_red = 0;
    let points = engine.model().points();
    for (at, color) in points.positions_map.iter().zip(&points.colors) {
        let is_red = at.distance(middle_map) < 2e-3;
        assert_eq!(*color == red, is_red, "{at}: {color:?}");
        n_red += u32::from(is_red);
    }
    assert!(
        n_red > 10 && points.len() > before.len(),
        "{n_red} red ones, {} samples: the rim is finer",
        points.len()
    );
    engine.order(SculptOrder::Undo).unwrap();
    assert_eq!(*engine.model().points(), before);
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn an_image_is_raised_and_sunk_by_its_depth_where_the_tool_is() {
    for (kind, sign) in [(SculptTool::Emboss, 1.0), (SculptTool::Engrave, -1.0)] {
        let white = Arc::new(GreyImage::new(2, 2, vec![1.0; 4]).unwrap());
        let depth_m = 0.8e-3;
        for (image, depth_of_middle_m) in [(Some(white), depth_m), (None, depth_m)] {
            let settings = ToolSettings { image, depth_m, brush_m: 8e-3, ..tool(kind) };
            let mut hand = Hand::of(SculptEngine::new(model(), settings, ToolBody::default()));
            hand.go(DVec3::Z * (R + 1e-3), 5);
            hand.is_held = true;
            hand.go(DVec3::Z * (R + 1e-3), 30);
            assert_eq!(hand.history(), (1, 0), "once for each hold");
            assert!(
                (hand.top_m() - R - sign * depth_of_middle_m).abs() < 0.1e-3,
                "{kind}: {}",
                hand.top_m() - R
            );
            let side = hand.engine.model().onto(DVec3::X * R, 0.01).unwrap().0.x;
            assert!((side - R).abs() < 0.1e-3, "{side}");
        }
    }
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn the_tools_own_shape_is_joined_and_cut_out_with_the_volume_of_a_lens() {
    let r = 0.01;
    let away = 0.022;
    let body =
        ToolBody { shape: Some(Arc::new(sphere(2000, r))), center_of_mass_tool: DVec3::ZERO };
    let ball = |r: f64| 4.0 / 3.0 * PI * r.powi(3);
    // Two balls whose middles are `away` apart.
    let lens =
        PI * (R + r - away).powi(2) * (away * away + 2.0 * away * (R + r) - 3.0 * (R - r).powi(2))
            / (12.0 * away);
    for (kind, expected) in [
        (SculptTool::Union, ball(R) + ball(r) - lens),
        (SculptTool::Intersection, lens),
        (SculptTool::Difference, ball(R) - lens),
    ] {
        for is_sharp in [false, true] {
            let settings = Settings { raster: [48; 3], air_m: 5e-3, ..Settings::default() };
            let model = ClayModel::new(sphere(4000, R), settings).unwrap();
            let before = model.base().values_m().to_vec();
            let mut hand = Hand::of(SculptEngine::new(
                model,
                ToolSettings { is_sharp, ..tool(kind) },
                body.clone(),
            ));
            hand.at = DVec3::X * away;
            hand.go(hand.at, 1);
            hand.is_held = true;
            hand.go(hand.at, 3);
            assert_eq!(hand.history(), (1, 0), "{kind}: {}", hand.engine.trouble());
            let volume = hand.volume_m3();
            assert!(
                (volume / expected - 1.0).abs() < 0.03,
                "{kind}, sharp {is_sharp}: {volume} of {expected}"
            );
            // The region has become another one with the clay, and comes back as it was.
            hand.engine.order(SculptOrder::Undo).unwrap();
            assert_eq!(hand.engine.model().base().values_m(), before);
            assert!((hand.volume_m3() / ball(R) - 1.0).abs() < 0.02);
            hand.engine.order(SculptOrder::Redo).unwrap();
            assert!((hand.volume_m3() / volume - 1.0).abs() < 1e-9);
        }
    }
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn what_the_hand_does_not_feel_does_nothing() {
    for (_, kind) in SculptTool::NAMES {
        let mut hand = Hand::with(kind);
        let before = hand.engine.model().points().clone();
        hand.has_force = false;
        hand.go(DVec3::Z * (R - 1e-3), 20);
        hand.is_held = true;
        hand.go(DVec3::Z * (R - 1e-3), 20);
        assert_eq!((hand.engine.model().points(), hand.history()), (&before, (0, 0)), "{kind}");
        assert_eq!(
            hand.engine.trouble().contains("no force"),
            kind.is_held(),
            "{kind}: {}",
            hand.engine.trouble()
        );
        // Force alone takes hold of nothing: that takes a new press.
        hand.has_force = true;
        hand.go(DVec3::Z * (R + 1e-3), 5);
        assert_eq!(hand.engine.rope_map(), None, "{kind}");
    }
    // And force that goes lets go.
    let mut hand = Hand::with(SculptTool::Pull);
    hand.go(DVec3::Z * (R + 1e-3), 2);
    hand.is_held = true;
    hand.go(DVec3::Z * (R + 3e-3), 20);
    assert!(hand.engine.rope_map().is_some());
    hand.has_force = false;
    hand.go(hand.at, 1);
    assert_eq!((hand.engine.rope_map(), hand.engine.model().is_stroke()), (None, false));
}

#[test]
fn outside_of_the_region_the_clay_is_stiff_and_says_so() {
    for kind in [SculptTool::Push, SculptTool::Pull] {
        let mut hand = Hand::with(kind);
        hand.at = DVec3::X * (R + 1e-3);
        hand.is_held = kind == SculptTool::Pull;
        hand.go(DVec3::X * (R - 1e-3), 10);
        assert!(
            hand.engine.trouble().contains("outside of the region"),
            "{kind}: {}",
            hand.engine.trouble()
        );
        assert_eq!((hand.history(), hand.engine.rope_map()), ((0, 0), None), "{kind}");
        // The next stroke that works takes the complaint back.
        hand.is_held = false;
        hand.at = DVec3::Z * (R + 1e-3);
        hand.go(hand.at, 1);
        hand.is_held = kind == SculptTool::Pull;
        hand.go(DVec3::Z * (R - 0.5e-3), 10);
        assert_eq!((&**hand.engine.trouble(), hand.history()), ("", (1, 0)), "{kind}");
    }
}

#[test]
fn a_hold_that_is_ordered_before_anything_is_heard_waits_for_the_hand() {
    let mut hand = Hand::with(SculptTool::Pull);
    hand.engine.order(SculptOrder::Hold(true)).unwrap();
    hand.engine.advance(UPDATE_S);
    hand.engine.advance(UPDATE_S);
    assert_eq!((hand.engine.rope_map(), &**hand.engine.trouble()), (None, ""));
    hand.at = DVec3::Z * (R + 1e-3);
    hand.go(hand.at, 1);
    assert!(hand.engine.rope_map().is_some());
}

#[test]
fn orders_end_what_the_hand_does_and_say_why_they_fail() {
    let mut hand = Hand::with(SculptTool::Pull);
    let before = hand.engine.model().points().clone();
    assert!(matches!(hand.engine.order(SculptOrder::Undo), Err(EngineError::NothingToUndo)));
    assert!(matches!(hand.engine.order(SculptOrder::Redo), Err(EngineError::NothingToRedo)));
    let none = SculptOrder::Take(ToolSettings { brush_m: 0.0, ..tool(SculptTool::Push) });
    assert!(matches!(hand.engine.order(none), Err(EngineError::Length { .. })));
    let image = Arc::new(GreyImage::new(2, 2, vec![1.0; 4]).unwrap());
    let beside = ImagePlacement::Flat {
        middle_map: DVec3::ONE,
        right_map: DVec3::Y * 1e-3,
        up_map: DVec3::Z * 1e-3,
    };
    let refused = hand.engine.order(SculptOrder::Emboss {
        image: image.clone(),
        placement: beside,
        depth_m: 1e-3,
    });
    assert!(matches!(refused, Err(EngineError::Nothing(_))), "{refused:?}");
    let refused =
        hand.engine.order(SculptOrder::Emboss { image, placement: beside, depth_m: f64::NAN });
    assert!(matches!(refused, Err(EngineError::Length { .. })), "{refused:?}");
    let cut = |radius_m: f64, map_from_body: Pose| {
        let with = Arc::new(SolidSource::Samples(sphere(4000, radius_m)));
        SculptOrder::Combine { boolean: Boolean::Difference, with, map_from_body, is_sharp: false }
    };
    let refused = hand.engine.order(cut(2.0 * R, Pose::IDENTITY));
    assert!(matches!(refused, Err(EngineError::Model(_))), "{refused:?}");
    let refused = hand.engine.order(cut(R, Pose::from_translation(DVec3::X * 3.0 * R)));
    assert!(matches!(refused, Err(EngineError::Beside)), "{refused:?}");
    let refused =
        hand.engine.order(SculptOrder::Region { low_map: DVec3::ONE, high_map: DVec3::ZERO });
    assert!(matches!(refused, Err(EngineError::Model(_))));
    for order in [SculptOrder::SavePoints, SculptOrder::SaveSession, SculptOrder::Export] {
        let error = hand.engine.order(order("/no/such/folder/piece".into())).unwrap_err();
        assert!(error.to_string().contains("/no/such/folder/piece"), "{error}");
    }
    assert_eq!((hand.engine.model().points(), hand.history().0), (&before, 0));

    hand.go(DVec3::Z * (R + 1e-3), 2);
    hand.engine.order(SculptOrder::Hold(true)).unwrap();
    hand.go(DVec3::Z * (R + 4e-3), 50);
    assert!(hand.engine.rope_map().is_some() && hand.engine.model().is_stroke());
    hand.engine.order(SculptOrder::Take(tool(SculptTool::Push))).unwrap();
    assert_eq!(
        (hand.engine.rope_map(), hand.engine.model().is_stroke(), hand.history()),
        (None, false, (1, 0))
    );
    hand.engine.order(SculptOrder::Take(tool(SculptTool::Pull))).unwrap();
    hand.go(hand.at, 2);
    assert_eq!(hand.engine.rope_map(), None, "a hold that goes on is no new one");
    hand.engine.order(SculptOrder::Hold(false)).unwrap();
    hand.engine.order(SculptOrder::Hold(true)).unwrap();
    hand.go(hand.at, 2);
    assert!(hand.engine.rope_map().is_some());
    // An undo in the middle of a stroke takes that stroke back, and only it.
    hand.engine.order(SculptOrder::Undo).unwrap();
    assert_eq!((hand.engine.rope_map(), hand.history()), (None, (1, 1)));
}

#[test]
fn a_view_has_new_points_only_when_there_are_some() {
    let mut hand = Hand::with(SculptTool::Push);
    let first = hand.engine.view();
    hand.go(DVec3::Z * (R + 4e-3), 5);
    // Neither what is asked for nor what is refused makes other points.
    hand.engine.order(SculptOrder::Hold(true)).unwrap();
    hand.engine.order(SculptOrder::Hold(false)).unwrap();
    hand.engine.order(SculptOrder::Take(tool(SculptTool::Push))).unwrap();
    hand.engine.order(SculptOrder::Export("/no/such/folder/piece".into())).unwrap_err();
    hand.engine.order(SculptOrder::Undo).unwrap_err();
    assert!(hand.engine.advance(UPDATE_S), "but a view may show what the tool is now");
    let second = hand.engine.view();
    assert!(
        first.version == 1 && second.version == 1 && Arc::ptr_eq(&first.points, &second.points)
    );
    assert!(!hand.engine.has_new_samples());
    hand.go(DVec3::Z * (R - 1e-3), 20);
    // Samples of a stroke are copied when the caller says so; all else is new at once.
    let uncopied = hand.engine.view();
    assert!(hand.engine.has_new_samples() && uncopied.is_stroke && uncopied.updates == 26);
    assert!(uncopied.version == 1 && Arc::ptr_eq(&first.points, &uncopied.points));
    hand.engine.copy_samples();
    let third = hand.engine.view();
    assert!(third.version == 2 && third.is_stroke && third.points != first.points);
    assert_eq!((third.n_undo, third.tool.kind, third.updates), (1, SculptTool::Push, 26));
    hand.engine.copy_samples();
    assert!(!hand.engine.has_new_samples() && hand.engine.view().version == 2, "nothing is new");
    // A client that reads that a stroke was undone reads its samples as well, and so where it has
    // ended.
    hand.engine.order(SculptOrder::Undo).unwrap();
    let fourth = hand.engine.view();
    assert_eq!(
        (fourth.version, fourth.n_undo, fourth.n_redo, &*fourth.points),
        (3, 0, 1, &*first.points)
    );
    hand.go(DVec3::Z * (R - 1e-3), 20);
    hand.engine.finish();
    let fifth = hand.engine.view();
    assert!(
        !fifth.is_stroke && fifth.version == 4 && *fifth.points == *hand.engine.model().points()
    );
}

#[test]
fn what_no_session_has_is_known() {
    let folder = tempfile::tempdir().unwrap();
    let mut hand = Hand::with(SculptTool::Push);
    let session = |hand: &mut Hand| {
        hand.engine.order(SculptOrder::SaveSession(folder.path().join("piece.session"))).unwrap()
    };
    hand.engine.order(SculptOrder::Undo).unwrap_err();
    assert!(!hand.engine.is_unsaved(), "as it was opened");
    hand.go(DVec3::Z * (R - 1e-3), 20);
    assert!(hand.engine.view().is_unsaved, "in the middle of the stroke");
    hand.engine.order(SculptOrder::SavePoints(folder.path().join("piece.ply"))).unwrap();
    hand.engine
        .order(SculptOrder::SaveSession("/no/such/folder/piece.session".into()))
        .unwrap_err();
    assert!(hand.engine.is_unsaved(), "samples are not all of it, and what failed saved nothing");
    session(&mut hand);
    assert!(!hand.engine.view().is_unsaved);
    hand.engine.order(SculptOrder::Undo).unwrap();
    assert!(hand.engine.is_unsaved());
    hand.engine.order(SculptOrder::Redo).unwrap();
    assert!(!hand.engine.is_unsaved(), "back where it was saved");
}

#[test]
fn a_region_that_is_left_comes_back_with_the_stroke_that_was_made_in_it() {
    let mut hand = Hand::with(SculptTool::Push);
    let region = hand.engine.model().region_map();
    hand.go(DVec3::Z * (R - 1e-3), 60);
    let low_map = DVec3::new(-0.026, -0.01, -0.01);
    let high_map = DVec3::new(-0.006, 0.01, 0.01);
    hand.engine.order(SculptOrder::Region { low_map, high_map }).unwrap();
    assert_ne!(hand.engine.model().region_map(), region);
    hand.engine.order(SculptOrder::Undo).unwrap();
    assert_eq!(hand.engine.model().region_map(), region);
    hand.engine.order(SculptOrder::Redo).unwrap();
    assert!(hand.top_m() < R - 0.1e-3, "{}", hand.top_m());
    assert_ne!(hand.engine.model().region_map(), region);
}

#[test]
fn the_same_hand_leaves_the_same_bits_on_any_number_of_threads() {
    let on = |threads: usize| {
        rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(|| {
            let mut hand = Hand::with(SculptTool::Push);
            hand.go(DVec3::new(1e-3, 0.0, R - 2e-3), 40);
            hand.engine.order(SculptOrder::Take(tool(SculptTool::Pull))).unwrap();
            hand.is_held = true;
            hand.go(DVec3::new(2e-3, 0.0, R + 3e-3), 60);
            hand.engine.finish();
            (hand.engine.model().points().clone(), hand.engine.model().base().values_m().to_vec())
        })
    };
    assert!(on(1) == on(4));
}

/// The union with a ball somewhere.
fn with_ball(n: usize, radius_m: f64, at_map: DVec3) -> SculptOrder {
    let with = Arc::new(SolidSource::Samples(sphere(n, radius_m)));
    let map_from_body = Pose::from_translation(at_map);
    SculptOrder::Combine { boolean: Boolean::Union, with, map_from_body, is_sharp: false }
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn a_solid_is_joined_where_it_is_already() {
    let mut hand = Hand::with(SculptTool::Touch);
    hand.engine.order(with_ball(800, 5e-3, DVec3::Z * R)).unwrap();
    let once_m3 = hand.volume_m3();
    hand.engine.order(with_ball(800, 5e-3, DVec3::Z * R)).unwrap();
    assert!((hand.volume_m3() / once_m3 - 1.0).abs() < 0.01, "{} of {once_m3}", hand.volume_m3());
}

#[test]
fn a_clay_model_that_grows_beyond_its_mass_points_is_reported_of() {
    let model =
        ClayModel::new(sphere(1000, 0.01), Settings { raster: [25; 3], ..Settings::default() })
            .unwrap();
    let mut engine = SculptEngine::new(model, tool(SculptTool::Touch), ToolBody::default());
    engine.order(with_ball(500, 4e-3, DVec3::X * 0.01)).unwrap();
    assert_eq!(&**engine.trouble(), "");
    engine.order(with_ball(500, 4e-3, DVec3::X * 0.08)).unwrap();
    assert!(engine.trouble().contains("mm apart instead of"), "{}", engine.trouble());
    engine.order(SculptOrder::Undo).unwrap();
    assert_eq!(&**engine.trouble(), "");
}

#[test]
fn changes_of_the_tool_add_up_and_one_that_is_refused_changes_nothing() {
    let mut engine = SculptEngine::new(model(), tool(SculptTool::Push), ToolBody::default());
    for change in [
        ToolChange { kind: Some(SculptTool::Paint), ..ToolChange::default() },
        ToolChange { color: Some([1, 2, 3]), ..ToolChange::default() },
        ToolChange { is_sharp: Some(true), ..ToolChange::default() },
    ] {
        engine.order(SculptOrder::Adjust(change)).unwrap();
    }
    let expected = ToolSettings { color: [1, 2, 3], is_sharp: true, ..tool(SculptTool::Paint) };
    assert_eq!(engine.view().tool, expected);
    let refused = ToolChange {
        kind: Some(SculptTool::Push),
        depth_m: Some(f64::NAN),
        ..ToolChange::default()
    };
    assert!(matches!(engine.order(SculptOrder::Adjust(refused)), Err(EngineError::Length { .. })));
    assert_eq!(engine.view().tool, expected);
}
