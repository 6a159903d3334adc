//! Volumes of slicers that are no part of what is printed: modifiers, which change settings within
//! them, negative volumes, and what blocks or enforces supports.
//!
//! The model has them as plain triangles or objects. What they are for stands in a part of its own,
//! which names triangles of an object (PrusaSlicer, Slic3r, SuperSlicer) or its components (Bambu
//! Studio, OrcaSlicer).

use std::collections::HashMap;
use std::ops::RangeInclusive;
use std::rc::Rc;

use super::package::{Element, Package};
use super::{Part, named, number};

/// One volume of an object.
#[derive(Default)]
pub(super) struct Volume {
    /// Numbers of its triangles in the object.
    pub(super) triangles: Option<RangeInclusive<usize>>,
    /// The component that it is.
    pub(super) component: Option<u32>,
    /// Shared by all components that it is.
    pub(super) name: Option<Rc<str>>,
    /// Why it is not printed.
    pub(super) purpose: Option<&'static str>,
}

/// Marks what slicers say is not printed in the part where the model begins, and takes its
/// triangles out. A list that cannot be read is said, and the model is read all the same.
pub(super) fn mark_volumes(package: &mut Package<'_>, root: &mut Part, notes: &mut Vec<String>) {
    let mut volumes: HashMap<u32, Vec<Volume>> = HashMap::new();
    for list in package.volume_lists() {
        match read(package, &list) {
            Ok(more) => {
                for (object, more) in more {
                    volumes.entry(object).or_default().extend(more);
                }
            }
            Err(why) => notes.push(format!(
                "modifiers and negative volumes of a slicer may be in the mesh, as their list \
                    cannot be read ({why})"
            )),
        }
    }
    // All lists at once: their numbers are those of the model, before triangles go.
    mark(&volumes, root);
}

/// Volumes that are not printed, by the number of their object.
fn read(package: &mut Package<'_>, list: &str) -> Result<HashMap<u32, Vec<Volume>>, String> {
    let mut volumes: HashMap<u32, Vec<Volume>> = HashMap::new();
    let mut object = None;
    let mut volume: Option<Volume> = None;
    let visited = package.read(list, |element| {
        match element {
            Element::Begin(element) => match (element.name(), &mut volume) {
                ("object", None) => object = Some(number(&element, "id")?),
                ("volume", None) => {
                    let triangles = number(&element, "firstid")?..=number(&element, "lastid")?;
                    volume = Some(Volume { triangles: Some(triangles), ..Volume::default() });
                }
                ("part", None) => {
                    let component = Some(number(&element, "id")?);
                    let purpose = element.attribute("subtype")?.and_then(|word| purpose(&word));
                    volume = Some(Volume { component, purpose, ..Volume::default() });
                }
                ("metadata", Some(volume)) => {
                    let value = element.attribute("value")?.unwrap_or_default();
                    match element.attribute("key")?.as_deref() {
                        Some("name") => volume.name = Some(value.into()),
                        Some("volume_type") => volume.purpose = purpose(&value),
                        // Files of 2018, before there were types.
                        Some("modifier") if value == "1" => volume.purpose = Some("modifier"),
                        _ => {}
                    }
                }
                _ => {}
            },
            Element::End("object") => object = None,
            Element::End("volume" | "part") => {
                let ended = volume.take().filter(|volume| volume.purpose.is_some());
                if let (Some(object), Some(volume)) = (object, ended) {
                    volumes.entry(object).or_default().push(volume);
                }
            }
            Element::End(_) | Element::Extension { .. } => {}
        }
        Ok(())
    });
    visited.map_err(|error| match error {
        crate::mesh::MeshError::Parse { what, .. } => what,
        error => error.to_string(),
    })?;
    Ok(volumes)
}

/// What a volume is for, where it is not printed; `None` for a part of the model.
fn purpose(word: &str) -> Option<&'static str> {
    Some(match word {
        "ParameterModifier" | "modifier_part" => "modifier",
        "NegativeVolume" | "negative_part" => "negative volume, not subtracted",
        "SupportBlocker" | "support_blocker" => "support blocker",
        "SupportEnforcer" | "support_enforcer" => "support enforcer",
        _ => return None,
    })
}

/// Marks and takes out what is not printed. The lists are as long as their writer likes, and so are
/// the lists of triangles and components: each is gone through once.
pub(super) fn mark(volumes: &HashMap<u32, Vec<Volume>>, root: &mut Part) {
    for (id, volumes) in volumes {
        let Some(object) = root.objects.get_mut(id) else { continue };
        let of_component: HashMap<u32, &Volume> =
            volumes.iter().filter_map(|volume| Some((volume.component?, volume))).collect();
        for placed in &mut object.components {
            if let Some(volume) = of_component.get(&placed.object) {
                placed.not_printed = volume.purpose;
                placed.name.clone_from(&volume.name);
            }
        }
        let n_triangles = object.mesh.triangles.len();
        let mut in_mesh: Vec<_> =
            volumes.iter().filter_map(|v| Some((v.triangles.as_ref()?, v))).collect();
        let names = in_mesh.iter().filter(|(triangles, _)| *triangles.start() < n_triangles);
        object.left_out.extend(
            names.map(|(_, v)| named(v.name.as_deref(), *id, v.purpose.unwrap_or_default())),
        );
        in_mesh.sort_unstable_by_key(|(triangles, _)| *triangles.start());
        let mut begins = in_mesh.into_iter().map(|(triangles, _)| triangles).peekable();
        let mut triangle_idx = 0;
        // Where the last of the volumes ends that have begun.
        let mut end = 0;
        object.mesh.triangles.retain(|_| {
            while let Some(range) = begins.next_if(|range| *range.start() <= triangle_idx) {
                end = end.max(range.end().saturating_add(1));
            }
            triangle_idx += 1;
            triangle_idx > end
        });
    }
}
