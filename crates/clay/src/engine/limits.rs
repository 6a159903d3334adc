//! Orders that take long: refused before they begin, ended when asked, and never longer than was
//! estimated.

use core::f64::consts::TAU;
use core::sync::atomic::{AtomicU64, Ordering};

use glam::{DQuat, DVec3};
use vps::mesh::primitives::Shape;
use vps::setting_names::SettingNames;
use vps::spatial::Pose;

use super::*;
use crate::SolidSource;
use crate::boolean::Boolean;
use crate::clay_model::{ClayModelError, Settings};
use crate::emboss::{GreyImage, ImagePlacement};
use crate::falloff::Falloff;
use crate::material_map::{MaterialPlace, Painted};
use crate::shapes::sphere;
use crate::{SurfaceError, WorkError};

/// Clay of 57 mm.
const R: f64 = 0.0285;
/// Random clay, with two orders each.
const N_CASES: u32 = 16;
/// Checks that may come after a cancel: one of each loop that runs beside others.
const CHECKS_AFTER: u64 = 64;

fn engine(n_samples: usize, settings: Settings) -> SculptEngine {
    let model = ClayModel::new(sphere(n_samples, R), settings).unwrap();
    SculptEngine::new(model, ToolSettings::default(), ToolBody::default())
}

fn combine(boolean: Boolean, shape: Shape, place: Pose, is_sharp: bool) -> SculptOrder {
    let with = Arc::new(SolidSource::Shape(shape, DVec3::ONE));
    SculptOrder::Combine { boolean, with, map_from_body: place, is_sharp }
}

fn image(greys: impl Fn(usize) -> f32) -> Arc<GreyImage> {
    GreyImage::new(16, 16, (0..256).map(greys).collect()).unwrap().into()
}

fn stamp(half_m: f64, depth_m: f64, image: Arc<GreyImage>) -> SculptOrder {
    let placement = ImagePlacement::Flat {
        middle_map: DVec3::Z * R,
        right_map: DVec3::X * half_m,
        up_map: DVec3::Y * half_m,
    };
    SculptOrder::Emboss { image, placement, depth_m }
}

/// All that is worth keeping of clay.
#[derive(Debug, PartialEq)]
struct Kept {
    points: PointSet,
    base_m: Vec<f32>,
    region_m: Vec<f32>,
    dims: [usize; 3],
    history: (usize, usize),
    strokes: u64,
}

fn state(engine: &SculptEngine) -> Kept {
    let model = engine.model();
    Kept {
        points: model.points().clone(),
        base_m: model.base().values_m().to_vec(),
        region_m: model.region().values_m().to_vec(),
        dims: model.region().lattice().dims,
        history: model.history(),
        strokes: model.strokes(),
    }
}

fn is_cancelled(error: &EngineError) -> bool {
    matches!(
        error,
        EngineError::Surface(SurfaceError::Work(WorkError::Cancelled))
            | EngineError::Model(ClayModelError::Surface(SurfaceError::Work(WorkError::Cancelled)))
    )
}

#[test]
fn what_would_take_minutes_is_refused_with_numbers_before_it_begins() {
    let mut engine = engine(4000, Settings::default());
    let before = state(&engine);
    let ball = Shape::Sphere { radius_m: 0.5 };
    let checkers = image(|n| ((n + n / 16) % 2) as f32);
    for (order, expected) in [
        (combine(Boolean::Union, ball, Pose::IDENTITY, false), "samples"),
        (combine(Boolean::Intersection, ball, Pose::IDENTITY, true), "steps of work"),
        (stamp(R, 1e3, checkers.clone()), "steps of work"),
        (stamp(R, -1e12, checkers), "steps of work"),
    ] {
        // Before the first look at whether it is to end.
        engine.cancel_when(Cancel::default());
        let error = engine.order(order).unwrap_err();
        assert!(matches!(error, EngineError::Model(ClayModelError::TooMuchWork { .. })), "{error}");
        let said = error.to_string();
        assert!(
            said.contains(expected) && error.hint(&SettingNames::PLAIN).contains("smaller"),
            "{said}"
        );
        assert_eq!(state(&engine), before);
    }
}

/// Cancels at each of some checks from the first to the last; gives how often it did.
fn cancelled_at_each(mut engine: SculptEngine, order: &SculptOrder) -> u32 {
    let before = state(&engine);
    let mut n_cancelled = 0;
    let mut at = 1;
    loop {
        let checks = Arc::new(AtomicU64::new(0));
        let counted = checks.clone();
        engine.cancel_when(Cancel::when(move || counted.fetch_add(1, Ordering::Relaxed) >= at));
        let Err(error) = engine.order(order.clone()) else { return n_cancelled };
        assert!(is_cancelled(&error), "{order:?} at check {at}: {error}");
        assert_eq!(state(&engine), before, "{order:?} at check {at}");
        let after = checks.load(Ordering::Relaxed) - at;
        assert!(after <= CHECKS_AFTER, "{order:?} at check {at}: {after} checks after that");
        n_cancelled += 1;
        // Denser at first, where the kinds of loops follow each other; all over at last.
        at += at.div_ceil(4);
    }
}

#[test]
fn an_order_that_is_cancelled_at_any_check_leaves_the_clay_and_its_past() {
    let settings = || Settings { raster: [20; 3], ..Settings::default() };
    let ball = Shape::Sphere { radius_m: 0.015 };
    let place = Pose::from_translation(DVec3::new(0.02, 0.004, 0.012));
    let orders = [
        combine(Boolean::Union, ball, place, false),
        combine(Boolean::Difference, ball, place, true),
        stamp(0.01, 1.5e-3, image(|n| (n % 5) as f32 / 4.0)),
        SculptOrder::Region {
            low_map: DVec3::new(-0.01, -0.01, 0.015),
            high_map: DVec3::splat(0.03),
        },
        SculptOrder::Lay {
            painted: Painted::default(),
            place: MaterialPlace::Ball {
                center_map: DVec3::ZERO,
                radius_m: R,
                falloff: Falloff::Gaussian,
            },
        },
    ];
    for order in orders {
        let mut engine = engine(600, settings());
        // So that there is a past.
        let painted = Painted { mass_kg: Some(2e-4), ..Painted::default() };
        engine.order(SculptOrder::Lay { painted, place: MaterialPlace::Everywhere }).unwrap();
        let n_cancelled = cancelled_at_each(engine, &order);
        assert!(n_cancelled > 5, "{order:?}: {n_cancelled}");
    }
}

#[test]
fn a_step_back_in_a_session_is_cancelled_as_well() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("clay.session");
    let mut first = engine(600, Settings { raster: [20; 3], ..Settings::default() });
    let ball = Shape::Sphere { radius_m: 0.015 };
    first
        .order(combine(Boolean::Difference, ball, Pose::from_translation(DVec3::X * R), false))
        .unwrap();
    let save = SculptOrder::SaveSession(path.clone());
    first.order(save.clone()).unwrap();
    let again = || {
        let model = ClayModel::load_session(&path).unwrap();
        SculptEngine::new(model, ToolSettings::default(), ToolBody::default())
    };
    assert!(cancelled_at_each(again(), &SculptOrder::Undo) > 5);
    let mut undone = again();
    undone.order(SculptOrder::Undo).unwrap();
    undone.order(save.clone()).unwrap();
    assert!(cancelled_at_each(again(), &SculptOrder::Redo) > 5);
    // What is cancelled for good can still be saved.
    let mut ended = again();
    ended.cancel_when(Cancel::when(|| true));
    assert!(ended.order(SculptOrder::Redo).is_err_and(|error| is_cancelled(&error)));
    ended.order(save).unwrap();
}

/// Numbers from 0 to 1 without a pattern (SplitMix64).
struct Random(u64);

impl Random {
    fn share(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut bits = self.0;
        bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((bits ^ (bits >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Between two lengths, each order of magnitude as often as the others.
    fn length_m(&mut self, low_m: f64, high_m: f64) -> f64 {
        low_m * (high_m / low_m).powf(self.share())
    }

    fn direction(&mut self) -> DVec3 {
        let z = 2.0 * self.share() - 1.0;
        let (sin, cos) = (TAU * self.share()).sin_cos();
        DVec3::new(cos, sin, 0.0) * (1.0 - z * z).sqrt() + DVec3::Z * z
    }

    fn order(&mut self) -> SculptOrder {
        // Those between take long, and show no more.
        let most_m = if self.share() < 0.8 { 0.06 } else { 5.0 };
        let size_m = self.length_m(0.01 * most_m, most_m);
        let other_m = self.length_m(1e-3, 0.06);
        let shape = match (3.0 * self.share()) as u32 {
            0 => Shape::Sphere { radius_m: size_m },
            1 => Shape::Box { size_m: DVec3::new(size_m, other_m, other_m) },
            _ => Shape::Cylinder { radius_m: other_m, height_m: size_m },
        };
        let boolean = match (3.0 * self.share()) as u32 {
            0 => Boolean::Union,
            1 => Boolean::Intersection,
            _ => Boolean::Difference,
        };
        let turn = DQuat::from_axis_angle(self.direction(), TAU * self.share());
        let at = self.direction() * self.length_m(1e-3, size_m + R);
        let place = Pose { rotation: turn, translation: at };
        match (8.0 * self.share()) as u32 {
            0 => {
                let high_map = self.direction().abs() * R + 2e-3;
                SculptOrder::Region { low_map: high_map - self.length_m(2e-3, 0.1), high_map }
            }
            1 | 2 => {
                let step = 1 + (6.0 * self.share()) as usize;
                let grey = image(|n| (n % step) as f32 / step as f32);
                stamp(
                    self.length_m(2e-3, 0.1),
                    self.length_m(1e-4, 10.0) * (self.share() - 0.5),
                    grey,
                )
            }
            3 => {
                // Samples of their own, of any spacing.
                let n = self.length_m(200.0, 6000.0) as usize;
                let with = Arc::new(SolidSource::Samples(sphere(n, size_m)));
                SculptOrder::Combine {
                    boolean,
                    with,
                    map_from_body: place,
                    is_sharp: self.share() < 0.5,
                }
            }
            _ => combine(boolean, shape, place, self.share() < 0.5),
        }
    }
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn work_is_refused_by_its_estimate_or_within_four_times_of_it() {
    let mut random = Random(39);
    let mut n_done = 0;
    let mut n_refused = 0;
    for case in 0..N_CASES {
        let n_samples = random.length_m(200.0, 1500.0) as usize;
        let raster = [8 + (20.0 * random.share()) as usize; 3];
        let mut engine = engine(n_samples, Settings { raster, ..Settings::default() });
        for _ in 0..2 {
            let order = random.order();
            match engine.order(order.clone()) {
                Ok(()) => n_done += 1,
                Err(EngineError::Model(ClayModelError::TooMuchWork { .. })) => n_refused += 1,
                Err(error) => {
                    let is_long = error.to_string().contains("steps that were estimated");
                    assert!(!is_long, "case {case}, {order:?}: {error}");
                }
            }
        }
    }
    assert!(n_done > N_CASES / 2 && n_refused > N_CASES / 20, "{n_done} done, {n_refused} refused");
}
