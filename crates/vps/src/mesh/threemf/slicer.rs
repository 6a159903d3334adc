//! Volumes of slicers that are no part of what is printed: modifiers, which change settings within
//! them, negative volumes, and what blocks or enforces supports.
//!
//! The model has them as plain triangles or objects. What they are for stands in a part of its own,
//! which names triangles of an object (PrusaSlicer, Slic3r, SuperSlicer) or its components (Bambu
//! Studio, OrcaSlicer).

use std::collections::HashMap;
use std::ops::RangeInclusive;

use super::package::{Element, Package, attribute};
use super::{Part, named, number};

/// One volume of an object.
#[derive(Default)]
struct Volume {
    /// Numbers of its triangles in the object.
    triangles: Option<RangeInclusive<usize>>,
    /// The component that it is.
    component: Option<u32>,
    name: Option<String>,
    /// Why it is not printed.
    purpose: Option<&'static str>,
}

/// Marks what slicers say is not printed in the part where the model begins, and takes its
/// triangles out. A list that cannot be read is said, and the model is read all the same.
pub(super) fn mark_volumes(package: &mut Package<'_>, root: &mut Part, notes: &mut Vec<String>) {
    for list in package.volume_lists() {
        match read(package, &list) {
            Ok(volumes) => mark(volumes, root),
            Err(why) => notes.push(format!(
                "modifiers and negative volumes of a slicer may be in the mesh, as their list \
                    cannot be read ({why})"
            )),
        }
    }
}

/// Volumes that are not printed, by the number of their object.
fn read(package: &mut Package<'_>, list: &str) -> Result<HashMap<u32, Vec<Volume>>, String> {
    let mut volumes: HashMap<u32, Vec<Volume>> = HashMap::new();
    let mut object = None;
    let mut volume: Option<Volume> = None;
    let visited = package.read(list, |element| {
        match element {
            Element::Begin(element) => match (element.local_name().as_ref(), &mut volume) {
                ("object", None) => object = Some(number(&element, "id")?),
                ("volume", None) => {
                    let triangles = number(&element, "firstid")?..=number(&element, "lastid")?;
                    volume = Some(Volume { triangles: Some(triangles), ..Volume::default() });
                }
                ("part", None) => {
                    let component = Some(number(&element, "id")?);
                    let purpose = attribute(&element, "subtype")?.and_then(|word| purpose(&word));
                    volume = Some(Volume { component, purpose, ..Volume::default() });
                }
                ("metadata", Some(volume)) => {
                    let value = attribute(&element, "value")?.unwrap_or_default();
                    match attribute(&element, "key")?.as_deref() {
                        Some("name") => volume.name = Some(value),
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
            Element::End(_) => {}
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

fn mark(volumes: HashMap<u32, Vec<Volume>>, root: &mut Part) {
    for (id, volumes) in volumes {
        let Some(object) = root.objects.get_mut(&id) else { continue };
        for Volume { component, name, purpose, .. } in &volumes {
            let of_volume = |placed: &&mut super::Placement| Some(placed.object) == *component;
            for placed in object.components.iter_mut().filter(of_volume) {
                placed.not_printed = *purpose;
                placed.name.clone_from(name);
            }
        }
        let in_mesh: Vec<_> =
            volumes.iter().filter_map(|v| Some((v.triangles.as_ref()?, v))).collect();
        let n_triangles = object.mesh.triangles.len();
        let mut triangle_idx = 0;
        object.mesh.triangles.retain(|_| {
            triangle_idx += 1;
            !in_mesh.iter().any(|(triangles, _)| triangles.contains(&(triangle_idx - 1)))
        });
        let names = in_mesh.iter().filter(|(triangles, _)| *triangles.start() < n_triangles);
        object.left_out.extend(
            names.map(|(_, v)| named(v.name.as_deref(), id, v.purpose.unwrap_or_default())),
        );
    }
}
