//! 3MF: the objects that the package builds, with the transforms of items and components.
//!
//! Data in: bytes of the package (a ZIP archive of XML parts). Data out: one mesh. Parts of the
//! production extension are followed; colours, materials and textures are skipped. Any other
//! extension may change the shape (beam lattices, slices, boolean operations): one that the package
//! requires is refused, elements of one that it does not require are left out, and named.
//! Invariants: what is unpacked is bounded by the size of the package, and copies of objects are
//! counted ([`CopyBudget`]), also of those that are left out; nothing is gone through once for each
//! of other things.
//!
//! What is no part of the thing that is printed is left out, and named: supports and objects of the
//! type `other`, what `printable` says no to, and modifiers and negative volumes of slicers
//! ([`slicer`]).
//!
//! # Units and frames
//! The file names its own unit. It must be the one of `units`: a part that is 25.4 times too large
//! is a danger, not a detail.
//!
//! # Source
//! 3MF Consortium, "3D Manufacturing Format, Core Specification" 1.3, sections 3 and 4; "Production
//! Extension" 1.1.

mod package;
mod slicer;

use std::collections::{BTreeMap, HashMap, HashSet};
use std::path::Path;
use std::rc::Rc;

use glam::{DMat4, DVec3, DVec4};

use self::package::{Begin, Element, Package, part_name, refusal};
use super::copy_budget::CopyBudget;
use super::file_mesh::listed;
use super::{FileMesh, MeshError, TriangleMesh};
use crate::storage::printable::one_line;

/// Objects within objects; real files have two or three levels.
const MOST_LEVELS: usize = 32;

/// Reads a 3MF package; `path` is for messages only.
pub(super) fn parse(
    bytes: &[u8],
    path: &Path,
    metres_per_unit: f64,
) -> Result<FileMesh, MeshError> {
    let mut package = Package::open(bytes, path)?;
    let mut found = Found::default();
    found.part_idx(package.model_name()?);
    let mut parts = Vec::new();
    while let Some(name) = found.part_names.get(parts.len()).cloned() {
        parts.push(Part::read(&mut package, &name, &mut found)?);
    }
    let (unit, file_metres_per_unit) = parts[ROOT].unit;
    if (file_metres_per_unit / metres_per_unit - 1.0).abs() > 1e-9 {
        return Err(MeshError::UnitConflict {
            path: path.to_owned(),
            unit,
            file_metres_per_unit,
            metres_per_unit,
        });
    }
    let mut notes = Vec::new();
    slicer::mark_volumes(&mut package, &mut parts[ROOT], &mut notes);
    let mut build = Build {
        parts: &parts,
        part_names: &found.part_names,
        path,
        budget: CopyBudget::of_file(bytes.len()),
        mesh: TriangleMesh::default(),
        left_out: Vec::new(),
        is_named: HashSet::new(),
    };
    for item in &parts[ROOT].items {
        build.place(item, ROOT, DMat4::IDENTITY, 0)?;
    }
    let Build { mesh, left_out, .. } = build;
    if !left_out.is_empty() {
        let note = left_out_note(&left_out);
        if mesh.triangles.is_empty() {
            return Err(refusal(path, format!("nothing of it is printed: {note}")));
        }
        notes.push(note);
    }
    if !found.extensions.is_empty() {
        let note = extensions_note(&found.extensions);
        if mesh.triangles.is_empty() {
            return Err(refusal(path, format!("there is no plain mesh in it: {note}")));
        }
        notes.push(note);
    }
    Ok(FileMesh { mesh, notes, rounding: None })
}

/// Number of the part in which the model begins.
const ROOT: usize = 0;

/// What parts have beyond their objects.
#[derive(Default)]
struct Found {
    /// In the order in which they are read.
    part_names: Vec<Rc<str>>,
    part_numbers: HashMap<Rc<str>, usize>,
    /// Namespaces of extensions that are not read, each with its first element.
    extensions: BTreeMap<String, String>,
}

impl Found {
    /// Number of a part; one that was not named before is read after the others.
    fn part_idx(&mut self, name: String) -> usize {
        let next = self.part_names.len();
        *self.part_numbers.entry(name.into()).or_insert_with_key(|name| {
            self.part_names.push(Rc::clone(name));
            next
        })
    }

    fn note_extension(&mut self, element: &str, namespace: &str) {
        if !is_harmless(namespace) && !self.extensions.contains_key(namespace) {
            self.extensions.insert(namespace.to_owned(), short_name(element));
        }
    }
}

/// One sentence on extensions that are not in the mesh.
fn extensions_note(extensions: &BTreeMap<String, String>) -> String {
    let names: Vec<_> = extensions
        .iter()
        .map(|(namespace, element)| format!("`{element}` ({:.80})", one_line(namespace)))
        .collect();
    format!("left out, as their extensions are not read: {}; export plain meshes", listed(&names))
}

/// One sentence on what is not in the mesh.
fn left_out_note(left_out: &[String]) -> String {
    let n_objects = match left_out.len() {
        1 => "1 object is".to_owned(),
        n => format!("{n} objects are"),
    };
    format!("{n_objects} left out, as no part of what is printed: {}", listed(left_out))
}

/// One model part of a package.
struct Part {
    /// Name of the unit, and metres in it.
    unit: (&'static str, f64),
    objects: HashMap<u32, Object>,
    /// What is built.
    items: Vec<Placement>,
}

#[derive(Default)]
struct Object {
    name: Option<String>,
    mesh: TriangleMesh,
    components: Vec<Placement>,
    /// Why it is no part of what is printed.
    not_printed: Option<&'static str>,
    /// Volumes that were taken out of its mesh, for the user.
    left_out: Vec<String>,
}

/// An object at a place.
struct Placement {
    object: u32,
    /// Number of the part that has the object; `None` for the same one.
    part: Option<usize>,
    parent_from_object: DMat4,
    /// Name that a slicer gave it.
    name: Option<Rc<str>>,
    /// Why it is no part of what is printed.
    not_printed: Option<&'static str>,
}

impl Part {
    fn read(package: &mut Package<'_>, name: &str, found: &mut Found) -> Result<Self, MeshError> {
        let mut part = Self { unit: UNITS[0], objects: HashMap::new(), items: Vec::new() };
        let mut object: Option<(u32, Object)> = None;
        package.read(name, |element| {
            match element {
                Element::Begin(element) => match (element.name(), &mut object) {
                    ("model", _) => {
                        refuse_unknown_extensions(&element)?;
                        if let Some(unit) = element.attribute("unit")? {
                            let known = UNITS.iter().find(|(name, _)| *name == unit);
                            part.unit = *known.ok_or_else(|| {
                                let names = UNITS.map(|(name, _)| name).join(", ");
                                format!("a unit is one of {names}: unknown unit `{unit:.20}`")
                            })?;
                        }
                    }
                    ("object", None) => {
                        let name = element.attribute("name")?;
                        let not_printed = why_not_printed(&element)?;
                        let begun = Object { name, not_printed, ..Object::default() };
                        object = Some((number(&element, "id")?, begun));
                    }
                    ("object", Some(_)) => return Err("an object inside another".to_owned()),
                    ("vertex", Some((_, object))) => {
                        let vertex = DVec3::new(
                            number(&element, "x")?,
                            number(&element, "y")?,
                            number(&element, "z")?,
                        );
                        if !vertex.is_finite() {
                            return Err(format!(
                                "vertex {} is not finite",
                                object.mesh.vertices.len()
                            ));
                        }
                        object.mesh.vertices.push(vertex);
                    }
                    ("triangle", Some((_, object))) => {
                        object.mesh.triangles.push([
                            number(&element, "v1")?,
                            number(&element, "v2")?,
                            number(&element, "v3")?,
                        ]);
                    }
                    ("component", Some((_, object))) => {
                        object.components.push(Placement::read(&element, found)?)
                    }
                    ("item", None) => part.items.push(Placement::read(&element, found)?),
                    _ => {}
                },
                Element::End("object") => {
                    if let Some((id, object)) = object.take() {
                        let n_vertices = object.mesh.vertices.len();
                        if let Some(wrong) = object
                            .mesh
                            .triangles
                            .as_flattened()
                            .iter()
                            .find(|v| **v as usize >= n_vertices)
                        {
                            return Err(format!(
                                "object {id}: a triangle names vertex {wrong} (counted from 0), it \
                                    has {n_vertices}"
                            ));
                        }
                        if part.objects.insert(id, object).is_some() {
                            return Err(format!("object {id} stands there twice"));
                        }
                    }
                }
                Element::End(_) => {}
                Element::Extension { name, namespace } => found.note_extension(name, namespace),
            }
            Ok(())
        })?;
        Ok(part)
    }
}

/// Names of the standard; the first is meant where none is given.
const UNITS: [(&str, f64); 6] = [
    ("millimeter", 1e-3),
    ("meter", 1.0),
    ("centimeter", 1e-2),
    ("inch", 0.0254),
    ("foot", 0.3048),
    ("micron", 1e-6),
];

/// Refuses extensions that the package requires and that may change the shape.
fn refuse_unknown_extensions(model: &Begin<'_>) -> Result<(), String> {
    let Some(required) = model.attribute("requiredextensions")? else { return Ok(()) };
    for prefix in required.split_whitespace() {
        let namespace = model.namespace(prefix)?;
        if !is_harmless(&namespace) {
            return Err(format!(
                "needs the extension `{namespace:.80}`, which is not read; export plain meshes"
            ));
        }
    }
    Ok(())
}

/// True for extensions that do not change the shape, and the one that is read.
fn is_harmless(namespace: &str) -> bool {
    // Production says in which part an object is; materials say nothing of the shape.
    [PRODUCTION, "/material/", "/trianglesets/"].iter().any(|word| namespace.contains(word))
}

/// In the namespaces of the production extension.
const PRODUCTION: &str = "/production/";

/// Why an object or its place is no part of what is printed. `printable` is a word of slicers, which
/// the standard lets them add.
fn why_not_printed(element: &Begin<'_>) -> Result<Option<&'static str>, String> {
    let kind = match element.attribute("type")?.as_deref() {
        Some("support") => Some("type support"),
        Some("solidsupport") => Some("type solidsupport"),
        Some("other") => Some("type other"),
        _ => None,
    };
    let printable = element.attribute("printable")?;
    let is_off = printable.is_some_and(|word| matches!(word.as_str(), "0" | "false"));
    Ok(kind.or(is_off.then_some("not printable")))
}

/// A thing of the file by its name.
fn named(name: Option<&str>, id: u32, why: &str) -> String {
    match name.filter(|name| !name.is_empty()) {
        Some(name) => format!("`{}` ({why})", short_name(name)),
        None => format!("object {id} ({why})"),
    }
}

/// A name as a sentence has it.
fn short_name(name: &str) -> String {
    one_line(name).chars().take(40).collect()
}

/// A number in an attribute that must be there.
fn number<T: std::str::FromStr>(element: &Begin<'_>, name: &str) -> Result<T, String> {
    let text = element.attribute(name)?.ok_or_else(|| format!("`{name}` is missing"))?;
    text.parse().map_err(|_| format!("`{name}` must be a number, found `{text:.40}`"))
}

impl Placement {
    fn read(element: &Begin<'_>, found: &mut Found) -> Result<Self, String> {
        let mut parent_from_object = DMat4::IDENTITY;
        if let Some(text) = element.attribute("transform")? {
            let wrong = || format!("`transform` must be twelve numbers, found `{text:.80}`");
            let numbers: Vec<f64> = text
                .split_whitespace()
                .map(str::parse)
                .collect::<Result<_, _>>()
                .map_err(|_| wrong())?;
            let [columns @ .., origin] = numbers.as_chunks::<3>().0 else { return Err(wrong()) };
            let ([x, y, z], 12) = (columns, numbers.len()) else { return Err(wrong()) };
            // The standard writes row vectors: its rows are our columns.
            let column = |column: &[f64; 3], w: f64| DVec4::new(column[0], column[1], column[2], w);
            parent_from_object = DMat4::from_cols(
                column(x, 0.0),
                column(y, 0.0),
                column(z, 0.0),
                column(origin, 1.0),
            );
        }
        let part = element.extension_attribute(PRODUCTION, "path")?;
        let part = part.map(|name| found.part_idx(part_name(&name)));
        let object = number(element, "objectid")?;
        let not_printed = why_not_printed(element)?;
        Ok(Self { object, part, parent_from_object, name: None, not_printed })
    }
}

/// Collects what is built.
struct Build<'a> {
    parts: &'a [Part],
    part_names: &'a [Rc<str>],
    path: &'a Path,
    budget: CopyBudget,
    mesh: TriangleMesh,
    /// Names of what is no part of what is printed.
    left_out: Vec<String>,
    /// Numbers of parts, objects in them, and why those were left out (`None`: volumes of them
    /// were). Each is named once, however often it is placed.
    is_named: HashSet<(usize, u32, Option<&'static str>)>,
}

impl Build<'_> {
    fn place(
        &mut self,
        placement: &Placement,
        part: usize,
        world_from_parent: DMat4,
        level: usize,
    ) -> Result<(), MeshError> {
        let part = placement.part.unwrap_or(part);
        let id = placement.object;
        let path = self.path;
        let part_name = &self.part_names[part];
        let refuse = |what: &str| refusal(path, format!("{part_name:.80}: object {id} {what}"));
        let object = self.parts[part].objects.get(&id).ok_or_else(|| refuse("is not there"))?;
        if level > MOST_LEVELS {
            return Err(refuse(&format!("is {MOST_LEVELS} levels down, or in a loop")));
        }
        if let Some(why) = placement.not_printed.or(object.not_printed) {
            self.budget.add(0, 0, path)?;
            if self.is_named.insert((part, id, Some(why))) {
                let name = placement.name.as_deref().or(object.name.as_deref());
                self.left_out.push(named(name, id, why));
            }
            return Ok(());
        }
        if !object.left_out.is_empty() && self.is_named.insert((part, id, None)) {
            self.left_out.extend(object.left_out.iter().cloned());
        }
        let world_from_object = world_from_parent * placement.parent_from_object;
        let base = self.mesh.vertices.len() as u32;
        self.budget.add(object.mesh.vertices.len(), object.mesh.triangles.len(), path)?;
        for vertex in &object.mesh.vertices {
            let vertex = world_from_object.transform_point3(*vertex);
            if !vertex.is_finite() {
                return Err(refuse("has a vertex that is not finite"));
            }
            self.mesh.vertices.push(vertex);
        }
        let mirrors = glam::DMat3::from_mat4(world_from_object).determinant() < 0.0;
        self.mesh.triangles.extend(object.mesh.triangles.iter().map(|corners| {
            let [a, b, c] = corners.map(|corner| base + corner);
            if mirrors { [a, c, b] } else { [a, b, c] }
        }));
        object
            .components
            .iter()
            .try_for_each(|component| self.place(component, part, world_from_object, level + 1))
    }
}

#[cfg(test)]
mod tests;
