//! Images and solids that a client sends for the tool on clay, and values of material.

use std::path::Path;
use std::sync::Arc;

use serde::Deserialize;

use super::super::problem::RequestError;
use crate::config::draft::Unit;
use clay::emboss::GreyImage;
use clay::engine::{ChosenSolid, SculptOrder, ToolChange};
use clay::material_map::{MaterialPlace, Painted};
use vps::mesh::{self, Format};

/// An image and a solid have at most so many bytes.
pub(in crate::monitor) const IMAGE_BYTES_MAX: usize = 4 << 20;
pub(in crate::monitor) const SOLID_BYTES_MAX: usize = 16 << 20;
/// And values of material.
pub(in crate::monitor) const VALUES_BYTES_MAX: usize = 16 << 20;
/// Pixels along an edge of an image at most.
const EDGE_MAX: u32 = 4096;
/// A PNG begins with these, and says its width and height at byte 16.
const PNG_MAGIC: &[u8] = b"\x89PNG\r\n\x1a\n";

/// How a solid is written.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(in crate::monitor) enum SolidFormat {
    Stl,
    Obj,
    Ply,
}

/// What stands beside a solid in the address; a token may, too.
#[derive(Clone, Copy, Debug, Deserialize)]
pub(in crate::monitor) struct SolidAsked {
    format: SolidFormat,
    units: Unit,
}

/// An image for the tool.
///
/// # Errors
/// No PNG, or a too large one.
pub(in crate::monitor) fn image_of(bytes: &[u8]) -> Result<SculptOrder, RequestError> {
    let hint = "a PNG of at most 4096 x 4096 pixels and 4 MiB, whose white is deep";
    let number = |at: usize| {
        bytes.get(at..at + 4).map(|four| u32::from_be_bytes([four[0], four[1], four[2], four[3]]))
    };
    let (Some(width), Some(height), true) = (number(16), number(20), bytes.starts_with(PNG_MAGIC))
    else {
        return Err(RequestError::bad("the body is no PNG image", hint));
    };
    if width > EDGE_MAX || height > EDGE_MAX {
        return Err(RequestError::bad(format!("the image has {width} x {height} pixels"), hint));
    }
    match GreyImage::decode(bytes, Path::new("the image")) {
        Ok(image) => Ok(SculptOrder::Adjust(ToolChange {
            image: Some(Some(Arc::new(image))),
            ..ToolChange::default()
        })),
        Err(error) => Err(RequestError::bad(error.to_string(), hint)),
    }
}

/// A solid for the tool, centred on its box.
///
/// # Errors
/// No mesh of that format.
pub(in crate::monitor) fn solid_of(
    bytes: &[u8],
    asked: SolidAsked,
) -> Result<SculptOrder, RequestError> {
    let (format, name) = match asked.format {
        SolidFormat::Stl => (Format::Stl, "a solid.stl"),
        SolidFormat::Obj => (Format::Obj, "a solid.obj"),
        SolidFormat::Ply => (Format::Ply, "a solid.ply"),
    };
    let hint = "a closed mesh as STL, OBJ or PLY of at most 16 MiB, with its `format` and `units` \
        (m, cm, mm, in) in the address";
    let refused = |error: &dyn core::fmt::Display| RequestError::bad(error.to_string(), hint);
    let file = mesh::parse_with_notes(bytes, format, Path::new(name), asked.units.metres())
        .map_err(|error| refused(&error))?;
    let solid = ChosenSolid::centered(file).map_err(|error| refused(&error))?;
    Ok(SculptOrder::Adjust(ToolChange { solid: Some(Some(solid)), ..ToolChange::default() }))
}

/// What stands beside values of material in the address; a token may, too.
#[derive(Clone, Copy, Debug, Deserialize)]
pub(in crate::monitor) struct ValuesAsked {
    /// Farther places say nothing, m.
    within_m: Option<f64>,
}

/// Material by a text of values.
///
/// # Errors
/// No such text.
pub(in crate::monitor) fn values_of(
    bytes: &[u8],
    asked: ValuesAsked,
) -> Result<SculptOrder, RequestError> {
    let refused = |why: &str| RequestError::bad(why, MaterialPlace::values_hint());
    let place = MaterialPlace::values(bytes, asked.within_m.unwrap_or(1e-3))
        .map_err(|why| refused(&why))?;
    place.unsound().map_or(Ok(SculptOrder::Lay { painted: Painted::default(), place }), |why| {
        Err(refused(&why))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const CUBE: &str =
        "v 10 0 0\nv 20 0 0\nv 10 10 0\nv 10 0 10\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";

    fn asked(format: SolidFormat) -> SolidAsked {
        SolidAsked { format, units: Unit::Mm }
    }

    #[test]
    fn a_solid_stands_with_its_middle_where_the_tool_is() {
        let Ok(SculptOrder::Adjust(ToolChange { solid: Some(Some(solid)), .. })) =
            solid_of(CUBE.as_bytes(), asked(SolidFormat::Obj))
        else {
            panic!("it is taken")
        };
        let (low, high) = solid.source.bounds_map(&vps::spatial::Pose::IDENTITY).unwrap();
        assert!((low + high).length() < 1e-12 && (high.x - 5e-3).abs() < 1e-12, "{low} {high}");
        assert_eq!(&*solid.name, "4 triangles, 10.0 x 10.0 x 10.0 mm");
    }

    #[test]
    fn what_was_found_in_a_solid_stands_in_its_name() {
        let inward = CUBE
            .replace("f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4", "f 1 2 3\nf 1 4 2\nf 1 3 4\nf 2 4 3");
        let Ok(SculptOrder::Adjust(ToolChange { solid: Some(Some(solid)), .. })) =
            solid_of(inward.as_bytes(), asked(SolidFormat::Obj))
        else {
            panic!("it is taken")
        };
        assert_eq!(
            &*solid.name,
            "4 triangles, 10.0 x 10.0 x 10.0 mm; every closed piece faced inward: all were turned"
        );
    }

    #[test]
    fn what_is_no_image_or_no_solid_is_refused_in_words() {
        for bytes in [&b""[..], b"GIF89a", &PNG_MAGIC[..6]] {
            assert!(image_of(bytes).is_err_and(|problem| problem.said.error.contains("no PNG")));
        }
        let mut large = PNG_MAGIC.to_vec();
        large.extend([0, 0, 0, 13, b'I', b'H', b'D', b'R', 0, 1, 0, 0, 0, 0, 0, 8]);
        assert!(image_of(&large).is_err_and(|problem| problem.said.error.contains("65536 x 8")));
        large[16..20].copy_from_slice(&8_u32.to_be_bytes());
        assert!(
            image_of(&large)
                .is_err_and(|problem| problem.said.error.contains("no PNG image that can be read"))
        );
        for (text, format) in
            [("", SolidFormat::Obj), ("v 1 2", SolidFormat::Obj), ("solid", SolidFormat::Ply)]
        {
            assert!(
                solid_of(text.as_bytes(), asked(format))
                    .is_err_and(|problem| !problem.said.error.is_empty()),
                "{text}"
            );
        }
    }

    #[test]
    fn values_of_material_are_a_text_with_a_line_for_each_place() {
        let read = |text: &str, within_m| values_of(text.as_bytes(), ValuesAsked { within_m });
        let header = MaterialPlace::VALUES_HEADER;
        let Ok(SculptOrder::Lay {
            place: MaterialPlace::Values { places_map, painted, within_m },
            ..
        }) = read(&format!("{header}\n1,2,3,,,700\n\n-1,0,0,1e-3,2,\n"), Some(2e-3))
        else {
            panic!("it is laid")
        };
        assert!(
            places_map[0].distance(glam::DVec3::new(1e-3, 2e-3, 3e-3)) < 1e-15 && within_m == 2e-3
        );
        assert_eq!(painted[0], Painted { stiffness_n_per_m: Some(700.0), ..Painted::default() });
        assert_eq!(
            (painted[1].mass_kg, painted[1].damping_n_s_per_m, painted[1].stiffness_n_per_m),
            (Some(1e-3), Some(2.0), None)
        );
        for (text, within_m, expected) in [
            ("", None, "the first line"),
            (&format!("{header}\n"), None, "no place"),
            (&format!("{header}\n0,0,0,,,1\n1,2,x,,,1\n"), None, "line 3"),
            (&format!("{header}\n0,0,0,9,,\n"), None, "a mass of 9 kg"),
            (&format!("{header}\n0,0,0,,,1\n"), Some(0.0), "one at no place"),
        ] {
            let error = read(text, within_m).expect_err(text).said.error;
            assert!(error.contains(expected), "{text}: {error}");
        }
    }
}
