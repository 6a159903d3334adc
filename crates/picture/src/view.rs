//! A way of looking at things, and what each pixel sees of them; `splats` and `parts` fill it,
//! `shade` lights it.

use glam::{DVec2, DVec3, Vec3};

/// A way of looking, without perspective: x to the right, y up, z towards the viewer.
#[derive(Clone, Copy, Debug)]
pub(super) struct Camera {
    right: DVec3,
    up: DVec3,
    toward: DVec3,
    /// Pixels per metre; and the pixel of the origin, y down.
    scale: f64,
    origin: DVec2,
}

impl Camera {
    /// Looks against `toward` at all of these places, which then fill this share of the view.
    pub(super) fn over(
        toward: DVec3,
        places: impl Iterator<Item = DVec3>,
        size: [usize; 2],
        filled: f64,
    ) -> Self {
        let toward = toward.normalize();
        let right = DVec3::Z.cross(toward).try_normalize().unwrap_or(DVec3::X);
        let up = toward.cross(right);
        let (low, high) = places
            .map(|at| DVec2::new(at.dot(right), at.dot(up)))
            .fold((DVec2::INFINITY, DVec2::NEG_INFINITY), |(low, high), at| {
                (low.min(at), high.max(at))
            });
        let (middle, edges) = if low.cmple(high).all() {
            (0.5 * (low + high), high - low)
        } else {
            (DVec2::ZERO, DVec2::ONE)
        };
        let size = DVec2::new(size[0] as f64, size[1] as f64);
        let scale = (filled * size / edges.max(DVec2::splat(1e-9))).min_element();
        Self {
            right,
            up,
            toward,
            scale,
            origin: 0.5 * size + DVec2::new(-middle.x, middle.y) * scale,
        }
    }

    /// The same for a part of the view that begins at this pixel.
    pub(super) fn beginning_at(self, [x, y]: [usize; 2]) -> Self {
        Self { origin: self.origin - DVec2::new(x as f64, y as f64), ..self }
    }

    /// Along the view's plane.
    pub(super) fn pixels_per_m(&self) -> f64 {
        self.scale
    }

    /// Pixel, y down, and height towards the viewer, m.
    pub(super) fn place(&self, at: DVec3) -> (DVec2, f64) {
        (
            self.origin + DVec2::new(at.dot(self.right), -at.dot(self.up)) * self.scale,
            at.dot(self.toward),
        )
    }

    /// A direction in camera axes.
    pub(super) fn turned(&self, way: DVec3) -> DVec3 {
        DVec3::new(way.dot(self.right), way.dot(self.up), way.dot(self.toward))
    }
}

/// What a pixel sees.
#[derive(Clone, Copy, Debug)]
pub(super) struct PixelSample {
    /// Pixels towards the viewer; −∞ where there is nothing.
    pub(super) height: f32,
    /// Out of the surface, camera axes, unit.
    pub(super) normal: Vec3,
    /// Linear light.
    pub(super) color: [f32; 3],
}

/// A view, row by row from the top.
#[derive(Clone, Debug)]
pub(super) struct RenderedView {
    pub(super) width: usize,
    pub(super) pixels: Vec<PixelSample>,
}

impl RenderedView {
    /// A view of nothing, of a width and a height.
    pub(super) fn empty([width, height]: [usize; 2]) -> Self {
        let nothing = PixelSample { height: f32::NEG_INFINITY, normal: Vec3::Z, color: [0.0; 3] };
        Self { width, pixels: vec![nothing; width * height] }
    }

    /// A part of it, which lies within.
    pub(super) fn part(&self, [left, top]: [usize; 2], [width, height]: [usize; 2]) -> Self {
        let rows = self.pixels.chunks_exact(self.width.max(1)).skip(top).take(height);
        Self {
            width,
            pixels: rows.flat_map(|row| row[left..left + width].iter().copied()).collect(),
        }
    }

    pub(super) fn size(&self) -> [usize; 2] {
        [self.width, self.pixels.len() / self.width.max(1)]
    }
}
