//! Light on what is seen: one lamp above the viewer's left shoulder, a weaker one to the right, the
//! sky, and less of it in hollows.

use glam::Vec3;

use super::palette::{Rgb, to_linear, to_srgb};
use super::view::RenderedView;

/// Pixels of a view along a pixel of its picture, which smooths edges.
pub(super) const FINER: i32 = 2;
/// Towards the lamps, camera axes, and how bright they are.
const LAMPS: [(Vec3, f32); 2] =
    [(Vec3::new(-0.5, 0.62, 0.6), 0.82), (Vec3::new(0.8, 0.05, 0.35), 0.17)];
/// Light from all sides, and how much more of it comes from above.
const SKY: [f32; 2] = [0.34, 0.1];
/// Of the lamp in the surface: how bright, and how sharp.
const GLOSS: (f32, f32) = (0.07, 28.0);
/// Where hollows are looked for, in pixels; and the rise over them that hides the sky there.
const RINGS: [f32; 3] = [4.0, 10.0, 20.0];
/// A pixel's light depends on pixels up to here, in whole pixels of the picture.
pub(super) const REACH: usize = 24;
const WAYS: usize = 8;
const HIDES: f32 = 1.6;
/// A rise beyond this many times the distance is another part in front, not a wall of the same
/// hollow.
const IN_FRONT: f32 = 4.0;
/// Light that is left where the sky is hidden on all sides.
const LEAST_SKY: f32 = 0.35;

/// Linear light of each pixel.
pub(super) fn lit(seeing: &RenderedView, backdrop: Rgb) -> Vec<[f32; 3]> {
    let backdrop = backdrop.map(to_linear);
    let ways: [(f32, f32); WAYS] =
        std::array::from_fn(|way| (core::f32::consts::TAU * way as f32 / WAYS as f32).sin_cos());
    let lamps = LAMPS.map(|(toward, brightness)| (toward.normalize(), brightness));
    let between = (lamps[0].0 + Vec3::Z).normalize();
    let of_pixel = |pixel: usize| {
        let seen = &seeing.pixels[pixel];
        if seen.height == f32::NEG_INFINITY {
            return backdrop;
        }
        let open = openness(seeing, pixel, &ways);
        let lamps: f32 = lamps
            .iter()
            .map(|(toward, brightness)| brightness * toward.dot(seen.normal).max(0.0))
            .sum();
        let light = open * (SKY[0] + SKY[1] * seen.normal.y) + (0.4 + 0.6 * open) * lamps;
        let gloss = GLOSS.0 * open * between.dot(seen.normal).max(0.0).powf(GLOSS.1);
        seen.color.map(|color| color * light + gloss)
    };
    (0..seeing.pixels.len()).map(of_pixel).collect()
}

/// Share of the sky that a pixel sees over its surroundings, above [`LEAST_SKY`].
fn openness(seeing: &RenderedView, pixel: usize, ways: &[(f32, f32); WAYS]) -> f32 {
    let x = (pixel % seeing.width) as f32;
    let y = (pixel / seeing.width) as f32;
    let own = &seeing.pixels[pixel];
    let mut hidden = 0.0;
    for (sin, cos) in ways {
        let mut highest = 0.0_f32;
        for reach in RINGS {
            let x = x + reach * cos;
            let y = y + reach * sin;
            if x < 0.0 || y < 0.0 || x >= seeing.width as f32 {
                continue;
            }
            let Some(other) = seeing.pixels.get(y as usize * seeing.width + x as usize) else {
                continue;
            };
            // Above the plane that the surface has here.
            let away = Vec3::new(reach * cos, -reach * sin, other.height - own.height);
            let rise = away.dot(own.normal) / reach;
            if rise < IN_FRONT {
                highest = highest.max(rise);
            }
        }
        hidden += (highest / HIDES).min(1.0);
    }
    1.0 - (1.0 - LEAST_SKY) * hidden / WAYS as f32
}

/// Means of 2 × 2 pixels, in linear light.
pub(super) fn halved(pixels: &[[f32; 3]], width: usize) -> Vec<Rgb> {
    let rows: Vec<&[[f32; 3]]> = pixels.chunks_exact(width).collect();
    let of_rows = |pair: &[&[[f32; 3]]]| -> Vec<Rgb> {
        let pairs = pair[0].chunks_exact(2).zip(pair[1].chunks_exact(2));
        let mean = |(a, b): (&[[f32; 3]], &[[f32; 3]])| {
            [0, 1, 2].map(|n| 0.25 * (a[0][n] + a[1][n] + b[0][n] + b[1][n]))
        };
        pairs.map(|four| mean(four).map(to_srgb)).collect()
    };
    rows.chunks_exact(FINER as usize).flat_map(of_rows).collect()
}
