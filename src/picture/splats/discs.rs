//! What each pixel of a view sees of the samples.

use glam::{DVec2, DVec3, Vec3};

use super::super::palette::to_linear;
use super::super::view::{Camera, PixelSample, RenderedView};
use clay::{Neighbours, PointSet};

/// A sample's disc reaches this much farther than its [`AROUND`]th neighbour, so that discs overlap.
const REACH: f64 = 0.8;
const AROUND: usize = 6;
/// A radius is at most this many times the usual one, and at least one of its parts: single samples cover no holes.
const RADIUS_MOST: f64 = 2.0;
/// Discs nearer together than this share of the usual radius, along the view, are one surface.
const ONE_SURFACE: f64 = 0.8;
/// An edge is where neighbours turn away from each other by more than this (cosine).
const EDGE: f64 = 0.8;
/// Discs end at an edge, but for this share of their radius.
const OVER_EDGE: f64 = 0.05;
/// Neighbours that turn away less than this are of one face of the surface, and share a normal: samples of a mesh have those of its triangles.
const ONE_FACE: f64 = 0.9;
/// Discs are seen from the side no flatter than this (cosine): they stand for a surface that bends away.
const FLATTEST: f64 = 0.15;

/// Samples with the radii of their discs.
pub(super) struct Discs<'a> {
    points: &'a PointSet,
    radii_m: Vec<f64>,
    usual_m: f64,
    /// `[n]`, map frame, unit.
    normals_map: Vec<DVec3>,
    /// Neighbours beyond a ridge: discs must not stand out over their planes.
    beyond: Vec<Vec<u32>>,
}

impl<'a> Discs<'a> {
    /// Discs that cover the surface between the samples.
    pub(super) fn of(points: &'a PointSet) -> Self {
        let near = Neighbours::new(&points.positions_map);
        let mut found = Vec::new();
        let mut radii_m = Vec::with_capacity(points.len());
        let mut beyond = Vec::with_capacity(points.len());
        let mut normals_map = Vec::with_capacity(points.len());
        for (at, normal) in points.positions_map.iter().zip(&points.normals_map) {
            near.nearest_n(*at, AROUND + 1, &mut found);
            radii_m.push(REACH * found.last().map_or(0.0, |farthest| farthest.distance_squared_m2).sqrt());
            let is_beyond = |other: &u32| {
                let (place, way) = (points.positions_map[*other as usize], points.normals_map[*other as usize]);
                way.dot(*normal) < EDGE && way.dot(*at - place) < 0.0
            };
            let around = found.iter().map(|other| points.normals_map[other.sample as usize]);
            normals_map.push(around.filter(|way| way.dot(*normal) > ONE_FACE).sum::<DVec3>().normalize_or(*normal));
            beyond.push(found.iter().map(|other| other.sample).filter(is_beyond).collect());
        }
        let mut sorted = radii_m.clone();
        sorted.sort_unstable_by(f64::total_cmp);
        let usual_m = sorted.get(sorted.len() / 2).copied().unwrap_or_default();
        radii_m.iter_mut().for_each(|radius_m| *radius_m = radius_m.clamp(usual_m / RADIUS_MOST, usual_m * RADIUS_MOST));
        Self { points, radii_m, usual_m, normals_map, beyond }
    }
}

/// Looks at the discs whose front is towards the viewer: first how near the nearest are, then what they are like.
pub(super) fn seen(camera: &Camera, discs: &Discs<'_>, [width, height]: [usize; 2]) -> RenderedView {
    let mut heights = vec![f32::NEG_INFINITY; width * height];
    for sample in 0..discs.points.len() {
        cover(camera, discs, sample, [width, height], |pixel, height, _| heights[pixel] = heights[pixel].max(height));
    }
    let together = (ONE_SURFACE * discs.usual_m * camera.pixels_per_m()) as f32;
    let mut sums = vec![(Vec3::ZERO, [0.0; 3], 0.0); width * height];
    for sample in 0..discs.points.len() {
        let normal = camera.turned(discs.normals_map[sample]).as_vec3();
        let color = discs.points.colors[sample].map(to_linear);
        cover(camera, discs, sample, [width, height], |pixel, height, weight| {
            if height > heights[pixel] - together {
                let (normals, colors, weights) = &mut sums[pixel];
                *normals += normal * weight;
                *weights += weight;
                colors.iter_mut().zip(color).for_each(|(sum, color)| *sum += color * weight);
            }
        });
    }
    let pixel = |(height, (normals, colors, weights)): (f32, (Vec3, [f32; 3], f32))| PixelSample {
        height,
        normal: normals.normalize_or(Vec3::Z),
        color: colors.map(|sum| sum / weights.max(f32::MIN_POSITIVE)),
    };
    RenderedView { width, pixels: heights.into_iter().zip(sums).map(pixel).collect() }
}

/// Calls `on` with each pixel that a disc covers: its number, the height there in pixels, and a weight that fades towards the rim.
fn cover(camera: &Camera, discs: &Discs<'_>, sample: usize, [width, height]: [usize; 2], mut on: impl FnMut(usize, f32, f32)) {
    let normal = camera.turned(discs.points.normals_map[sample]);
    if normal.z <= 0.0 {
        return;
    }
    let (middle, middle_height_m) = camera.place(discs.points.positions_map[sample]);
    let radius = discs.radii_m[sample] * camera.pixels_per_m();
    let middle_height = middle_height_m * camera.pixels_per_m();
    let slope = DVec2::new(-normal.x, normal.y) / normal.z.max(FLATTEST);
    let reach = DVec2::new((1.0 - normal.x * normal.x).max(0.0).sqrt(), (1.0 - normal.y * normal.y).max(0.0).sqrt()) * radius;
    let range = |middle: f64, reach: f64, n_pixels: usize| {
        let clamped = |pixel: f64| pixel.clamp(0.0, n_pixels as f64) as usize;
        clamped((middle - reach).floor())..clamped((middle + reach).ceil())
    };
    // The planes of neighbours beyond a ridge, in pixels: normal, and how far this sample is behind them.
    let planes: Vec<(DVec3, f64)> = discs.beyond[sample]
        .iter()
        .map(|other| {
            let (place, way) = (discs.points.positions_map[*other as usize], discs.points.normals_map[*other as usize]);
            let behind_m = way.dot(place - discs.points.positions_map[sample]) + OVER_EDGE * discs.radii_m[sample];
            (camera.turned(way), behind_m * camera.pixels_per_m())
        })
        .collect();
    for y in range(middle.y, reach.y, height) {
        for x in range(middle.x, reach.x, width) {
            let away = DVec2::new(x as f64 + 0.5, y as f64 + 0.5) - middle;
            let rise = slope.dot(away);
            let share = (away.length_squared() + rise * rise) / (radius * radius);
            let on_disc = DVec3::new(away.x, -away.y, rise);
            if share < 1.0 && planes.iter().all(|(way, behind)| way.dot(on_disc) <= *behind) {
                on(y * width + x, (middle_height + rise) as f32, ((1.0 - share) * (1.0 - share)) as f32 + 1e-6);
            }
        }
    }
}
