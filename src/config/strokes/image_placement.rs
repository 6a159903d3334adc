//! Images that are embossed: how deep, and where they lie.

use glam::DVec3;

use super::super::resolve::MM;
use super::super::schema::{Deed, Stroke};
use super::Reader;
use clay::emboss::ImagePlacement;
use clay::engine::SculptOrder;
use document::{FINITE, Interval, ProblemKind};

/// Cosine of the largest angle by which the edges of an image may be off a right one.
const SKEW: f64 = 1e-3;

impl Reader<'_> {
    pub(super) fn emboss(
        &mut self,
        table: &str,
        stroke: &Stroke,
        deed: Deed,
    ) -> Option<SculptOrder> {
        let depth = Interval::above(0.0).to(100.0).unit("mm");
        let depth_m = self.resolve.checks.number(
            &format!("{table}.depth_mm"),
            stroke.depth_mm,
            self.tool.depth_m / MM,
            depth,
        ) * MM;
        let image_key = format!("{table}.image");
        let image = match &stroke.image {
            Some(image) => self.resolve.image(&image_key, Some(image)),
            None => self.resolve.checks.given(
                &image_key,
                self.tool.image.clone(),
                "a PNG file, whose white is deep",
            ),
        };
        let placement = match (stroke.corner_mm, stroke.center_mm) {
            (Some(_), Some(_)) => {
                let other = format!("{table}.corner_mm");
                self.resolve
                    .checks
                    .refuse(&format!("{table}.center_mm"), ProblemKind::Exclusive { other });
                None
            }
            (None, None) => {
                let accepted = "the place of its upper left corner, with across_mm and down_mm; or \
                    center_mm of a ball that it goes around";
                self.resolve.checks.missing(&format!("{table}.corner_mm"), accepted);
                None
            }
            (Some(_), None) => self.laid_flat(table, stroke),
            (None, Some(_)) => self.laid_around(table, stroke),
        };
        let depth_m = if deed == Deed::Engrave { -depth_m } else { depth_m };
        Some(SculptOrder::Emboss { image: image?, placement: placement?, depth_m })
    }

    fn laid_flat(&mut self, table: &str, stroke: &Stroke) -> Option<ImagePlacement> {
        self.leave_out(table, given(stroke, &["axis", "front"]), "beside corner_mm");
        let mut vector = |name: &str, written| {
            let key = format!("{table}.{name}");
            let written =
                self.resolve.checks.given(&key, written, "an edge of the image as [x, y, z]");
            self.resolve.checks.array(&key, written, FINITE).map(|mm| DVec3::from_array(mm) * MM)
        };
        let (corner, across, down) = (
            vector("corner_mm", stroke.corner_mm)?,
            vector("across_mm", stroke.across_mm),
            vector("down_mm", stroke.down_mm),
        );
        let across = across?;
        let down = down?;
        if across.length() * down.length() == 0.0
            || across.normalize().dot(down.normalize()).abs() > SKEW
        {
            let accepted = "an edge longer than 0, at a right angle to across_mm";
            self.resolve.checks.not_accepted(&format!("{table}.down_mm"), accepted);
            return None;
        }
        Some(ImagePlacement::Flat {
            middle_map: corner + 0.5 * (across + down),
            right_map: 0.5 * across,
            up_map: -0.5 * down,
        })
    }

    fn laid_around(&mut self, table: &str, stroke: &Stroke) -> Option<ImagePlacement> {
        self.leave_out(table, given(stroke, &["across_mm", "down_mm"]), "beside center_mm");
        let center_map =
            self.resolve.checks.position(&format!("{table}.center_mm"), stroke.center_mm) * MM;
        let north_map = match stroke.axis {
            None => DVec3::Z,
            axis => self.resolve.direction(&format!("{table}.axis"), axis)?,
        };
        let front_key = format!("{table}.front");
        let front = match stroke.front {
            None => north_map.any_orthonormal_vector(),
            front => self.resolve.direction(&front_key, front)?,
        };
        let front_map = front.reject_from_normalized(north_map).try_normalize();
        if front_map.is_none_or(|_| front.dot(north_map).abs() > 1.0 - 1e-9) {
            self.resolve.checks.not_accepted(&front_key, "another direction than axis");
            return None;
        }
        Some(ImagePlacement::Around { center_map, north_map, front_map: front_map? })
    }
}

/// Those of these keys that are written.
fn given(stroke: &Stroke, of: &[&str]) -> impl Iterator<Item = &'static str> {
    stroke.given().into_iter().filter(|key| of.contains(key))
}
