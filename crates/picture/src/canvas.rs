//! Lines, dots and words on pixels.

use tiny_skia::{
    Color, FillRule, LineCap, Paint, Path, PathBuilder, Pixmap, Rect, Stroke, Transform,
};
use ttf_parser::{Face, OutlineBuilder};

use super::palette::{INK, Rgb};
use recording::report::plots::short;

/// Share of a view's width that the bar of its scale takes up at most.
const BAR: f64 = 0.2;

/// Where a word begins, ends or has its middle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Align {
    Left,
    Middle,
    Right,
}

/// A sheet of pixels, x to the right, y down.
pub(super) struct Canvas {
    pixels: Pixmap,
    face: Face<'static>,
}

impl Canvas {
    /// A white sheet; `None` when it has no area or too much.
    pub(super) fn new(width: u32, height: u32) -> Option<Self> {
        let mut pixels = Pixmap::new(width, height)?;
        pixels.fill(Color::WHITE);
        let face = Face::parse(epaint_default_fonts::HACK_REGULAR, 0).ok()?;
        Some(Self { pixels, face })
    }

    /// The picture as a file.
    pub(super) fn png(&self) -> std::io::Result<Vec<u8>> {
        self.pixels.encode_png().map_err(std::io::Error::other)
    }

    /// The picture, to be put beside others.
    pub(super) fn into_pixels(self) -> Pixmap {
        self.pixels
    }

    /// Pixels `[x, x + width) × [y, y + height)` in one colour, edges sharp.
    pub(super) fn block(&mut self, [x, y]: [i32; 2], [width, height]: [i32; 2], color: Rgb) {
        if let Some(rect) = Rect::from_xywh(x as f32, y as f32, width as f32, height as f32) {
            let mut paint = paint(color);
            paint.anti_alias = false;
            self.pixels.fill_rect(rect, &paint, Transform::identity(), None);
        }
    }

    /// Puts finished pixels onto the sheet, row by row from the top; what lies beyond it is left
    /// out.
    pub(super) fn image(&mut self, [left, top]: [i32; 2], [width, _]: [i32; 2], pixels: &[Rgb]) {
        let n_columns = self.pixels.width() as usize;
        let (Ok(left), Ok(top), Ok(width)) =
            (usize::try_from(left), usize::try_from(top), usize::try_from(width))
        else {
            return;
        };
        let rows = self.pixels.data_mut().chunks_exact_mut(4 * n_columns).skip(top);
        for (row, colors) in rows.zip(pixels.chunks_exact(width.max(1))) {
            for (pixel, [red, green, blue]) in row.chunks_exact_mut(4).skip(left).zip(colors) {
                pixel.copy_from_slice(&[*red, *green, *blue, u8::MAX]);
            }
        }
    }

    pub(super) fn line(&mut self, [x0, y0]: [f64; 2], [x1, y1]: [f64; 2], width: f64, color: Rgb) {
        let mut path = PathBuilder::new();
        path.move_to(x0 as f32, y0 as f32);
        path.line_to(x1 as f32, y1 as f32);
        let stroke = Stroke { width: width as f32, line_cap: LineCap::Round, ..Stroke::default() };
        if let Some(path) = path.finish() {
            self.pixels.stroke_path(&path, &paint(color), &stroke, Transform::identity(), None);
        }
    }

    pub(super) fn frame(&mut self, [x, y]: [i32; 2], [width, height]: [i32; 2], color: Rgb) {
        self.block([x - 1, y - 1], [width + 2, 1], color);
        self.block([x - 1, y + height], [width + 2, 1], color);
        self.block([x - 1, y], [1, height], color);
        self.block([x + width, y], [1, height], color);
    }

    pub(super) fn dot(&mut self, [x, y]: [f64; 2], radius: f64, color: Rgb) {
        if let Some(path) = PathBuilder::from_circle(x as f32, y as f32, radius as f32) {
            self.fill(&path, color);
        }
    }

    /// A bar of a round length in the lower left corner of a view.
    pub(super) fn scale_bar(
        &mut self,
        [left, top]: [i32; 2],
        [width, height]: [i32; 2],
        pixels_per_m: f64,
    ) {
        let most_m = BAR * f64::from(width) / pixels_per_m;
        let decade_m = 10_f64.powf(most_m.log10().floor());
        let Some(length_m) = [5.0, 2.0, 1.0]
            .into_iter()
            .map(|factor| factor * decade_m)
            .find(|length_m| *length_m <= most_m)
        else {
            return;
        };
        let x = f64::from(left) + 12.0;
        let y = f64::from(top + height) - 12.0;
        let end = x + length_m * pixels_per_m;
        self.line([x, y], [end, y], 2.0, INK);
        self.text([x, y - 6.0], 13.0, Align::Left, INK, &format!("{} mm", short(length_m * 1e3)));
    }

    /// One line of text; `y` is its base line, `size` the height of its line.
    pub(super) fn text(
        &mut self,
        [x, y]: [f64; 2],
        size: f64,
        align: Align,
        color: Rgb,
        text: &str,
    ) {
        let scale = size / f64::from(self.face.units_per_em());
        let mut at = match align {
            Align::Left => x,
            Align::Middle => x - 0.5 * self.text_width(size, text),
            Align::Right => x - self.text_width(size, text),
        };
        let mut outline =
            Outline { path: PathBuilder::new(), origin: [0.0; 2], scale: scale as f32 };
        for letter in text.chars() {
            let glyph = self.face.glyph_index(letter).unwrap_or_default();
            outline.origin = [at as f32, y as f32];
            let _ = self.face.outline_glyph(glyph, &mut outline);
            at += f64::from(self.face.glyph_hor_advance(glyph).unwrap_or_default()) * scale;
        }
        // Blanks have no outline.
        if let Some(path) = outline.path.finish() {
            self.fill(&path, color);
        }
    }

    pub(super) fn text_width(&self, size: f64, text: &str) -> f64 {
        let advance = |letter| {
            self.face
                .glyph_index(letter)
                .and_then(|glyph| self.face.glyph_hor_advance(glyph))
                .unwrap_or_default()
        };
        text.chars().map(|letter| f64::from(advance(letter))).sum::<f64>() * size
            / f64::from(self.face.units_per_em())
    }

    fn fill(&mut self, path: &Path, color: Rgb) {
        self.pixels.fill_path(path, &paint(color), FillRule::Winding, Transform::identity(), None);
    }
}

fn paint([red, green, blue]: Rgb) -> Paint<'static> {
    let mut paint = Paint::default();
    paint.set_color_rgba8(red, green, blue, 255);
    paint
}

/// Glyphs as paths: their y is up, ours is down.
struct Outline {
    path: PathBuilder,
    origin: [f32; 2],
    scale: f32,
}

impl Outline {
    fn at(&self, x: f32, y: f32) -> [f32; 2] {
        [self.origin[0] + self.scale * x, self.origin[1] - self.scale * y]
    }
}

impl OutlineBuilder for Outline {
    fn move_to(&mut self, x: f32, y: f32) {
        let [x, y] = self.at(x, y);
        self.path.move_to(x, y);
    }

    fn line_to(&mut self, x: f32, y: f32) {
        let [x, y] = self.at(x, y);
        self.path.line_to(x, y);
    }

    fn quad_to(&mut self, x1: f32, y1: f32, x: f32, y: f32) {
        let ([x1, y1], [x, y]) = (self.at(x1, y1), self.at(x, y));
        self.path.quad_to(x1, y1, x, y);
    }

    fn curve_to(&mut self, x1: f32, y1: f32, x2: f32, y2: f32, x: f32, y: f32) {
        let ([x1, y1], [x2, y2], [x, y]) = (self.at(x1, y1), self.at(x2, y2), self.at(x, y));
        self.path.cubic_to(x1, y1, x2, y2, x, y);
    }

    fn close(&mut self) {
        self.path.close();
    }
}
