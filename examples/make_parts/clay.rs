//! The bowl of clay, and the hands that work the pieces of the clay scenes. All lengths in
//! millimetres, in the frame of the piece, which is the world.
//!
//! The clay of a letter, a character and a globe is made of shapes by their scenes. What those say
//! of sizes is said here again, for the hands; `tests` holds them against each other.

use glam::{DVec2, DVec3};

use crate::hand::Hand;
use crate::image::{ARCH_CENTER, ARCH_RADIUS, LETTER_PIXELS, STEM};
use crate::loft::{Ring, circle, even_angles, solid, tip};
use crate::mesh::Mesh;

/// How far a hand wants to be inside of what it presses; it and the coupling are springs, so it
/// presses with about three newtons, more than a brush takes to be full.
const PRESSED_MM: f64 = 6.5;
/// Between the ball in the hand and the surface where clay is grabbed but not touched.
const CLEAR_MM: f64 = 0.8;

// The bowl: two balls about one centre, cut off at a rim.

const BOWL_AROUND: usize = 72;
/// Middle of both balls.
pub(crate) const BOWL_CENTER_MM: DVec3 = DVec3::new(0.0, 0.0, 23.0);
pub(crate) const BOWL_OUTER_MM: f64 = 24.0;
pub(crate) const BOWL_INNER_MM: f64 = 20.0;
/// The rim lies so far below the middle, degrees.
const RIM_DEG: f64 = -10.0;
pub(crate) const BOWL_TOOL_MM: f64 = 3.0;

/// Bowl on a flat foot, with a round rim; axis z, foot at z = 0.
pub(crate) fn bowl() -> Mesh {
    let angles = even_angles(BOWL_AROUND);
    let on_ball = |radius_mm: f64, up_deg: f64| {
        let (sin, cos) = up_deg.to_radians().sin_cos();
        DVec2::new(radius_mm * cos, BOWL_CENTER_MM.z + radius_mm * sin)
    };
    let foot_deg = -(BOWL_CENTER_MM.z / BOWL_OUTER_MM).asin().to_degrees();
    let steps = |from: f64, to: f64, n: usize| {
        (0..=n).map(move |step| from + (to - from) * step as f64 / n as f64)
    };
    let outside = steps(foot_deg, RIM_DEG, 16).map(|up_deg| on_ball(BOWL_OUTER_MM, up_deg));
    let inside = steps(RIM_DEG, -90.0, 16).map(|up_deg| on_ball(BOWL_INNER_MM, up_deg));
    let middle = on_ball(0.5 * (BOWL_OUTER_MM + BOWL_INNER_MM), RIM_DEG);
    let rim = steps(RIM_DEG, RIM_DEG + 180.0, 14).skip(1).take(13).map(|turn_deg| {
        let (sin, cos) = turn_deg.to_radians().sin_cos();
        middle + DVec2::new(cos, sin) * (0.5 * (BOWL_OUTER_MM - BOWL_INNER_MM))
    });
    let rings = outside.chain(rim).chain(inside).map(|at| circle(&angles, at.x, at.y));
    let rings: Vec<Ring> = std::iter::once(tip(BOWL_AROUND, 0.0)).chain(rings).collect();
    solid(&rings, false)
}

/// Paints a band low around the bowl, one below its rim, and one inside.
pub(crate) fn around_the_bowl() -> Hand {
    let at = |radius_mm: f64, up_deg: f64| {
        let (sin, cos) = up_deg.to_radians().sin_cos();
        BOWL_CENTER_MM + DVec3::new(0.0, -cos, sin) * radius_mm
    };
    let outside =
        |pressed_mm: f64, up_deg: f64| at(BOWL_OUTER_MM + BOWL_TOOL_MM - pressed_mm, up_deg);
    let inside =
        |pressed_mm: f64, up_deg: f64| at(BOWL_INNER_MM - BOWL_TOOL_MM + pressed_mm, up_deg);
    Hand::new(outside(-4.0, -45.0), DVec3::Z)
        .to(400, outside(PRESSED_MM, -45.0))
        .circle(2900, BOWL_CENTER_MM, 360.0)
        .to(360, outside(-2.0, -40.0))
        .to(340, outside(-2.0, -20.0))
        .to(300, outside(PRESSED_MM, -20.0))
        .circle(3900, BOWL_CENTER_MM, 360.0)
        .to(400, outside(-4.0, -10.0))
        .to(500, at(BOWL_OUTER_MM, 20.0))
        .to(700, inside(-2.0, -40.0))
        .to(300, inside(PRESSED_MM, -40.0))
        .circle(3600, BOWL_CENTER_MM, 360.0)
        .to(400, inside(-4.0, -20.0))
}

// The letter on its plate.

/// Upper left corner and edge of its image, and the top of the plate.
pub(crate) const LETTER_CORNER_MM: DVec2 = DVec2::new(-24.0, 28.0);
pub(crate) const LETTER_EDGE_MM: f64 = 48.0;
pub(crate) const PLATE_TOP_MM: f64 = 4.0;
pub(crate) const LETTER_DEPTH_MM: f64 = 2.0;
pub(crate) const LETTER_TOOL_MM: f64 = 2.5;
/// Where the line below the letter runs.
const LINE_Y_MM: f64 = -22.0;
const LINE_X_MM: f64 = 15.0;

/// Paints along the letter, draws a line below it, and pulls that line out of the plate.
pub(crate) fn letter() -> Hand {
    let mm_per_pixel = LETTER_EDGE_MM / LETTER_PIXELS as f64;
    let at = |pixel: DVec2, above_mm: f64| {
        let place = LETTER_CORNER_MM + DVec2::new(pixel.x, -pixel.y) * mm_per_pixel;
        place.extend(PLATE_TOP_MM + LETTER_DEPTH_MM + LETTER_TOOL_MM + above_mm)
    };
    let line = |x_mm: f64, above_mm: f64| {
        DVec3::new(x_mm, LINE_Y_MM, PLATE_TOP_MM + LETTER_TOOL_MM + above_mm)
    };
    let arch_left = ARCH_CENTER - DVec2::new(ARCH_RADIUS, 0.0);
    let leg_foot = DVec2::new(ARCH_CENTER.x + ARCH_RADIUS, STEM[1].y);
    Hand::new(at(STEM[0], 8.0), DVec3::Z)
        .hold(500)
        .to(500, at(STEM[0], -PRESSED_MM))
        .to(1500, at(STEM[1], -PRESSED_MM))
        .to(300, at(STEM[1], 1.0))
        .to(500, at(arch_left, 1.0))
        .to(300, at(arch_left, -PRESSED_MM))
        .circle(1200, at(ARCH_CENTER, 0.0), -180.0)
        .to(700, at(leg_foot, -PRESSED_MM))
        .to(400, at(leg_foot, 4.0))
        .to(850, line(-LINE_X_MM, 4.0))
        .to(300, line(-LINE_X_MM, CLEAR_MM))
        .hold(150)
        .to(1400, line(LINE_X_MM, CLEAR_MM))
        .hold(200)
        .to(700, line(0.0, CLEAR_MM))
        .hold(200)
        .to(1200, line(0.0, 8.0))
        .hold(600)
}

// The character.

pub(crate) const HEAD_CENTER_MM: DVec3 = DVec3::new(0.0, 0.0, 18.0);
pub(crate) const HEAD_MM: f64 = 9.5;
pub(crate) const BODY_MM: f64 = 12.0;
pub(crate) const CHARACTER_TOOL_MM: f64 = 2.0;

/// Pulls out a nose, presses two eyes, and pokes the belly.
pub(crate) fn character() -> Hand {
    let head = |way: DVec3, above_mm: f64| {
        HEAD_CENTER_MM + way.normalize() * (HEAD_MM + CHARACTER_TOOL_MM + above_mm)
    };
    let nose = |above_mm: f64| head(DVec3::NEG_Y, above_mm);
    let eye = |side: f64, above_mm: f64| head(DVec3::new(side * 0.42, -0.8, 0.42), above_mm);
    let belly = |above_mm: f64| DVec3::new(0.0, -BODY_MM - CHARACTER_TOOL_MM - above_mm, -1.0);
    Hand::new(nose(12.0), DVec3::Z)
        .hold(2600)
        .to(500, nose(CLEAR_MM))
        .hold(300)
        .to(1000, nose(9.0))
        .hold(400)
        .to(500, HEAD_CENTER_MM + DVec3::new(-8.0, -19.0, 9.0))
        .to(500, eye(-1.0, 3.0))
        .to(300, eye(-1.0, -PRESSED_MM))
        .hold(200)
        .to(300, eye(-1.0, 3.0))
        .to(400, eye(1.0, 3.0))
        .to(300, eye(1.0, -PRESSED_MM))
        .hold(200)
        .to(400, eye(1.0, 5.0))
        .to(900, belly(5.0))
        .to(500, belly(-7.0))
        .hold(600)
        .to(500, belly(6.0))
        .hold(200)
}

// The globe.

pub(crate) const GLOBE_MM: f64 = 25.0;
pub(crate) const GLOBE_TOOL_MM: f64 = 3.0;
/// Height of land.
pub(crate) const LAND_MM: f64 = 1.0;

/// Paints ice around the north pole and a desert across northern Africa, and pulls up the
/// Himalayas.
pub(crate) fn globe() -> Hand {
    // Longitude 0° is in front, towards −y.
    let at = |longitude_deg: f64, latitude_deg: f64, above_mm: f64| {
        let ((sin, cos), (up, out)) =
            (longitude_deg.to_radians().sin_cos(), latitude_deg.to_radians().sin_cos());
        DVec3::new(out * sin, -out * cos, up) * (GLOBE_MM + GLOBE_TOOL_MM + above_mm)
    };
    Hand::new(at(0.0, 80.0, 6.0), DVec3::Z)
        .hold(900)
        .to(400, at(0.0, 80.0, -PRESSED_MM))
        .circle(1800, DVec3::ZERO, 360.0)
        .to(400, at(0.0, 70.0, 4.0))
        .to(1100, at(-5.0, 22.0, 4.0))
        .to(400, at(-5.0, 22.0, LAND_MM - PRESSED_MM))
        .circle(1200, DVec3::ZERO, 33.0)
        .to(400, at(28.0, 22.0, 5.0))
        .to(1100, at(86.0, 30.0, 5.0))
        .to(400, at(86.0, 30.0, LAND_MM + CLEAR_MM))
        .hold(200)
        .to(1000, at(86.0, 30.0, 6.0))
        .hold(600)
}
