//! What each pixel of a view sees of the samples.

use glam::{DVec2, DVec3, Vec3};

use super::super::palette::to_linear;
use super::super::view::{Camera, PixelSample, RenderedView};
use clay::{Neighbours, PointSet};

/// A sample's disc reaches this much farther than its [`AROUND`]th neighbour, so that discs
/// overlap.
const REACH: f64 = 1.1;
const AROUND: usize = 6;
/// So many neighbours are looked at for a ridge: along one, the nearest are all of one side.
const AROUND_EDGE: usize = 18;
/// A radius is at most this many times the usual one, and at least one of its parts: single samples
/// cover no holes.
const RADIUS_MOST: f64 = 2.0;
/// Discs nearer together than this share of the usual radius, along the view, are one surface.
const ONE_SURFACE: f64 = 0.8;
/// An edge is where neighbours turn away from each other by more than this (cosine).
const EDGE: f64 = 0.8;
/// Discs end at an edge, but for this share of their radius.
const OVER_EDGE: f64 = 0.05;
/// Neighbours that turn away less than this are of one face of the surface, and share a normal:
/// samples of a mesh have those of its triangles.
const ONE_FACE: f64 = 0.9;
/// Discs are seen from the side no flatter than this (cosine): they stand for a surface that bends
/// away.
const FLATTEST: f64 = 0.15;

/// Gaps of so many pixels along are closed, where the surface is on so many of eight sides.
const GAP_PX: usize = 3;
const MOST_SIDES: usize = 5;
/// A sample that is drawn for itself reaches half of a spacing, as on the page: this share of the
/// distance to its [`AROUND`]th, which is 1.27 spacings away where samples are even.
const SINGLE_REACH: f64 = 0.4;

/// What is drawn of the samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SampleForm {
    /// One surface, blended from discs.
    #[default]
    Surface,
    /// Each as a disc across its normal.
    Discs,
    /// Each as a disc that faces the viewer.
    Sprites,
    /// Each as a ball.
    Spheres,
    /// The surface, with a ball for each mass point beside it.
    MassPoints,
}

/// Samples with the radii of their discs.
pub(super) struct Discs<'a> {
    form: SampleForm,
    points: &'a PointSet,
    radii_m: Vec<f64>,
    usual_m: f64,
    /// `[n]`, map frame, unit.
    normals_map: Vec<DVec3>,
    /// Neighbours beyond a ridge: discs must not stand out over their planes.
    beyond: Vec<Vec<u32>>,
}

impl<'a> Discs<'a> {
    /// Discs that cover the surface between the samples, or part of it.
    pub(super) fn of(points: &'a PointSet, form: SampleForm) -> Self {
        let is_surface = matches!(form, SampleForm::Surface | SampleForm::MassPoints);
        let reach = if is_surface { REACH } else { SINGLE_REACH };
        let near = Neighbours::new(&points.positions_map);
        let mut found = Vec::new();
        let mut radii_m = Vec::with_capacity(points.len());
        let mut beyond = Vec::with_capacity(points.len());
        let mut normals_map = Vec::with_capacity(points.len());
        for (at, normal) in points.positions_map.iter().zip(&points.normals_map) {
            near.nearest_n(*at, AROUND_EDGE + 1, &mut found);
            let radius_m = reach
                * found
                    .get(AROUND)
                    .or(found.last())
                    .map_or(0.0, |farthest| farthest.distance_squared_m2)
                    .sqrt();
            radii_m.push(radius_m);
            if !is_surface {
                normals_map.push(*normal);
                beyond.push(Vec::new());
                continue;
            }
            let is_beyond = |other: &u32| {
                let place = points.positions_map[*other as usize];
                let way = points.normals_map[*other as usize];
                way.dot(*normal) < EDGE && way.dot(*at - place) < 0.0
            };
            let around = found
                .iter()
                .take(AROUND + 1)
                .map(|other| points.normals_map[other.sample as usize]);
            normals_map.push(
                around
                    .filter(|way| way.dot(*normal) > ONE_FACE)
                    .sum::<DVec3>()
                    .normalize_or(*normal),
            );
            let within = found
                .iter()
                .take_while(|other| other.distance_squared_m2 < 4.0 * radius_m * radius_m);
            beyond.push(within.map(|other| other.sample).filter(is_beyond).collect());
        }
        let mut sorted = radii_m.clone();
        sorted.sort_unstable_by(f64::total_cmp);
        let usual_m = sorted.get(sorted.len() / 2).copied().unwrap_or_default();
        radii_m.iter_mut().for_each(|radius_m| {
            *radius_m = radius_m.clamp(usual_m / RADIUS_MOST, usual_m * RADIUS_MOST)
        });
        Self { form, points, radii_m, usual_m, normals_map, beyond }
    }
}

impl Discs<'_> {
    /// Discs are blended.
    fn is_surface(&self) -> bool {
        matches!(self.form, SampleForm::Surface | SampleForm::MassPoints)
    }
}

/// Looks at the discs whose front is towards the viewer: first how near the nearest are, then what
/// they are like.
pub(super) fn seen(
    camera: &Camera,
    discs: &Discs<'_>,
    [width, height]: [usize; 2],
) -> RenderedView {
    let mut heights = vec![f32::NEG_INFINITY; width * height];
    for sample in 0..discs.points.len() {
        cover(camera, discs, sample, [width, height], |pixel, height, _, _| {
            heights[pixel] = heights[pixel].max(height)
        });
    }
    // Of samples that are drawn each for itself, the nearest one is seen.
    let together = if discs.is_surface() {
        (ONE_SURFACE * discs.usual_m * camera.pixels_per_m()) as f32
    } else {
        0.0
    };
    let mut sums = vec![(Vec3::ZERO, [0.0; 3], 0.0); width * height];
    for sample in 0..discs.points.len() {
        let color = discs.points.colors[sample].map(to_linear);
        cover(camera, discs, sample, [width, height], |pixel, height, weight, normal| {
            if height >= heights[pixel] - together {
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
    let mut view =
        RenderedView { width, pixels: heights.into_iter().zip(sums).map(pixel).collect() };
    if discs.is_surface() {
        close_gaps(&mut view);
    }
    view
}

/// Discs end at edges, and leave pixels between them that belong to neither face: one with the
/// surface on most sides of it is of the surface, as its nearest neighbour is.
fn close_gaps(view: &mut RenderedView) {
    let [width, height] = view.size();
    for _ in 0..GAP_PX {
        let before = view.pixels.clone();
        for y in 1..height.saturating_sub(1) {
            for x in 1..width.saturating_sub(1) {
                if before[y * width + x].height > f32::NEG_INFINITY {
                    continue;
                }
                let around = [(-1, -1), (0, -1), (1, -1), (-1, 0), (1, 0), (-1, 1), (0, 1), (1, 1)];
                let seen = around.map(|(dx, dy)| {
                    before[y.wrapping_add_signed(dy) * width + x.wrapping_add_signed(dx)]
                });
                let covered = seen.iter().filter(|pixel| pixel.height > f32::NEG_INFINITY);
                if covered.clone().count() >= MOST_SIDES
                    && let Some(nearest) = covered.max_by(|a, b| a.height.total_cmp(&b.height))
                {
                    view.pixels[y * width + x] = *nearest;
                }
            }
        }
    }
}

/// Balls among what a view has seen, all of one size and colour.
pub(super) fn add_balls(
    camera: &Camera,
    view: &mut RenderedView,
    places_map: &[DVec3],
    radius_m: f64,
    color: [u8; 3],
) {
    let [width, height] = view.size();
    let radius = radius_m * camera.pixels_per_m();
    let color = color.map(to_linear);
    for place in places_map {
        let (middle, middle_height_m) = camera.place(*place);
        for y in pixels(middle.y, radius, height) {
            for x in pixels(middle.x, radius, width) {
                let away = (DVec2::new(x as f64 + 0.5, y as f64 + 0.5) - middle) / radius;
                let up = (1.0 - away.length_squared()).max(0.0).sqrt();
                let above = (middle_height_m * camera.pixels_per_m() + up * radius) as f32;
                if up > 0.0 && above > view.pixels[y * width + x].height {
                    let normal = DVec3::new(away.x, -away.y, up).as_vec3();
                    view.pixels[y * width + x] = PixelSample { height: above, normal, color };
                }
            }
        }
    }
}

/// Pixels that something around a middle may reach.
fn pixels(middle: f64, reach: f64, n_pixels: usize) -> core::ops::Range<usize> {
    let clamped = |pixel: f64| pixel.clamp(0.0, n_pixels as f64) as usize;
    clamped((middle - reach).floor())..clamped((middle + reach).ceil())
}

/// Calls `on` with each pixel that a sample covers: its number, the height there in pixels, a
/// weight that fades towards the rim, and the normal, camera axes.
fn cover(
    camera: &Camera,
    discs: &Discs<'_>,
    sample: usize,
    [width, height]: [usize; 2],
    mut on: impl FnMut(usize, f32, f32, Vec3),
) {
    let own = camera.turned(discs.points.normals_map[sample]);
    if own.z <= 0.0 {
        return;
    }
    let is_round = discs.form == SampleForm::Spheres;
    let normal = if is_round || discs.form == SampleForm::Sprites { DVec3::Z } else { own };
    let lit = camera.turned(discs.normals_map[sample]).as_vec3();
    let (middle, middle_height_m) = camera.place(discs.points.positions_map[sample]);
    let radius = discs.radii_m[sample] * camera.pixels_per_m();
    let middle_height = middle_height_m * camera.pixels_per_m();
    let slope = DVec2::new(-normal.x, normal.y) / normal.z.max(FLATTEST);
    let reach = DVec2::new(
        (1.0 - normal.x * normal.x).max(0.0).sqrt(),
        (1.0 - normal.y * normal.y).max(0.0).sqrt(),
    ) * radius;
    // The planes of neighbours beyond a ridge, in pixels: normal, and how far this sample is behind
    // them.
    let planes: Vec<(DVec3, f64)> = discs.beyond[sample]
        .iter()
        .map(|other| {
            let place = discs.points.positions_map[*other as usize];
            let way = discs.points.normals_map[*other as usize];
            let behind_m = way.dot(place - discs.points.positions_map[sample])
                + OVER_EDGE * discs.radii_m[sample];
            (camera.turned(way), behind_m * camera.pixels_per_m())
        })
        .collect();
    for y in pixels(middle.y, reach.y, height) {
        for x in pixels(middle.x, reach.x, width) {
            let away = DVec2::new(x as f64 + 0.5, y as f64 + 0.5) - middle;
            let rise = slope.dot(away);
            let share = (away.length_squared() + rise * rise) / (radius * radius);
            let on_disc = DVec3::new(away.x, -away.y, rise);
            if share < 1.0 && planes.iter().all(|(way, behind)| way.dot(on_disc) <= *behind) {
                let up = (1.0 - share).sqrt();
                let (rise, normal) = if is_round {
                    (up * radius, (on_disc / radius + DVec3::Z * up).as_vec3())
                } else {
                    (rise, lit)
                };
                on(
                    y * width + x,
                    (middle_height + rise) as f32,
                    ((1.0 - share) * (1.0 - share)) as f32 + 1e-6,
                    normal,
                );
            }
        }
    }
}
