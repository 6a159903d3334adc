//! glTF 2.0, as JSON (`.gltf`) and binary (`.glb`).
//!
//! Data in: bytes, and the buffers that they name beside the file. Data out: the triangles, strips
//! and fans of all meshes of the default scene, with the transforms of their nodes. Sparse
//! accessors and `KHR_mesh_quantization` are read; skins, morph targets and instances
//! (`EXT_mesh_gpu_instancing`) are not, so a posed figure comes out in its rest pose; a note says
//! so. Coordinates keep the axes of the file (y points up by convention).
//!
//! Invariants: every number that a file announces is checked against the bytes at hand before
//! memory is allocated for it; copies of a mesh by many nodes are counted ([`CopyBudget`]).
//!
//! # Units and frames
//! The standard says metres, programs write what they like: `units` rules here as for every format.
//!
//! # Source
//! Khronos Group, "glTF 2.0 Specification" (2021), sections 3.5 (scenes), 3.6 (buffers), 3.7
//! (meshes), 4.4 (GLB).

mod buffers;
mod document;

use std::path::{Path, PathBuf};

use glam::{DMat3, DMat4, DQuat, DVec3};

use self::buffers::{Buffers, is_f32, is_index};
use self::document::{Document, Mesh, Node, Primitive, refusal};
use super::copy_budget::CopyBudget;
use super::file_mesh::listed;
use super::format::without_mark;
use super::{FileMesh, MeshError, Rounding, TriangleMesh, ply};

/// Reads a glTF file of either kind; `path` is for messages, and where further files are looked
/// for.
pub(super) fn parse(bytes: &[u8], path: &Path) -> Result<FileMesh, MeshError> {
    let (document, binary) = document_of(bytes, path)?;
    if document.asset.version.split('.').next() != Some("2") {
        return Err(refusal(
            path,
            format!("version 2 of the format is read, found `{:.20}`", document.asset.version),
        ));
    }
    if let Some(name) =
        document.extensions_required.iter().find(|name| !leaves_triangles_alone(name))
    {
        let what = format!(
            "needs the extension {name:.60}, which is not read; export without it (no compression)"
        );
        return Err(refusal(path, what));
    }
    let meshes: Vec<_> = document.meshes.iter().map(PlacedMesh::of).collect();
    let buffers = Buffers::new(&document, binary, bytes.len(), path);
    let budget = CopyBudget::of_file(bytes.len());
    let mut walk = NodeTraversal {
        document: &document,
        meshes: &meshes,
        buffers,
        path,
        budget,
        mesh: TriangleMesh::default(),
        not_applied: Vec::new(),
        rounding: None,
    };
    walk.run()?;
    let NodeTraversal { mesh, not_applied, rounding, .. } = walk;
    let notes = match &not_applied[..] {
        [] => Vec::new(),
        names => {
            vec![format!("not applied are {}: export the mesh with them applied", listed(names))]
        }
    };
    Ok(FileMesh { mesh, notes, rounding })
}

/// The files beside this one that it names as buffers.
pub(super) fn companions(bytes: &[u8], path: &Path) -> Result<Vec<PathBuf>, MeshError> {
    buffers::files(&document_of(bytes, path)?.0, path)
}

/// The document of a file of either kind, and the binary part of one that has it.
fn document_of<'a>(
    bytes: &'a [u8],
    path: &Path,
) -> Result<(Document, Option<&'a [u8]>), MeshError> {
    let bytes = without_mark(bytes);
    let (json, binary) =
        if bytes.starts_with(b"glTF") { parts_of_glb(bytes, path)? } else { (bytes, None) };
    let document = serde_json::from_slice(json).map_err(|error| {
        // Lines are of use where the whole file is text.
        let line = (json.len() == bytes.len()).then_some(error.line());
        let what = error.to_string();
        let what = what.split(" at line ").next().unwrap_or(&what).to_owned();
        MeshError::Parse {
            path: path.to_owned(),
            line,
            what: format!("not a glTF document: {what}"),
        }
    })?;
    Ok((document, binary))
}

/// Required extensions that do not change where triangles are, and the one that is read.
fn leaves_triangles_alone(name: &str) -> bool {
    name == "KHR_mesh_quantization"
        || [
            "KHR_materials_",
            "KHR_texture_",
            "KHR_lights_",
            "EXT_texture_",
            "MSFT_texture_",
            "KHR_animation_",
        ]
        .iter()
        .any(|family| name.starts_with(family))
}

/// The JSON text of a GLB file and its binary part.
fn parts_of_glb<'a>(
    bytes: &'a [u8],
    path: &Path,
) -> Result<(&'a [u8], Option<&'a [u8]>), MeshError> {
    const HEADER_BYTES: usize = 12;
    let refuse = |offset_bytes: usize, what: String| MeshError::Binary {
        path: path.to_owned(),
        offset_bytes: offset_bytes as u64,
        what,
    };
    let word =
        |at: usize| bytes.get(at..).and_then(<[u8]>::first_chunk).copied().map(u32::from_le_bytes);
    let (Some(version), Some(length)) = (word(4), word(8)) else {
        return Err(refuse(bytes.len(), "the file ends in its header, so it was cut".to_owned()));
    };
    if version != 2 {
        return Err(refuse(4, format!("version 2 of the format is read, found {version}")));
    }
    if length as usize > bytes.len() {
        return Err(refuse(8, format!("cut, {length} bytes announced, {} found", bytes.len())));
    }
    let mut json = None;
    let mut binary = None;
    let mut at = HEADER_BYTES;
    while let (Some(length), Some(kind)) = (word(at), word(at + 4)) {
        let part = bytes.get(at + 8..).and_then(|rest| rest.get(..length as usize));
        let part = part.ok_or_else(|| {
            refuse(at, format!("a part of {length} bytes, the file has {}", bytes.len() - at - 8))
        })?;
        match &kind.to_le_bytes() {
            b"JSON" => _ = json.get_or_insert(part),
            b"BIN\0" => _ = binary.get_or_insert(part),
            _ => {}
        }
        at += 8 + part.len();
    }
    json.map(|json| (json, binary)).ok_or_else(|| refuse(HEADER_BYTES, "no JSON part".to_owned()))
}

/// What nodes that place a mesh ask of it, worked out once: a file of a few megabytes can place one
/// a million times.
struct PlacedMesh<'a> {
    /// Primitives that have triangles, with their numbers and the accessors of their positions.
    primitives: Vec<(usize, u32, &'a Primitive)>,
    is_morphed: bool,
}

impl<'a> PlacedMesh<'a> {
    fn of(mesh: &'a Mesh) -> Self {
        let primitives = mesh.primitives.iter().enumerate();
        let primitives = primitives.filter_map(|(primitive_idx, primitive)| {
            let has_triangles = matches!(primitive.mode, None | Some(4..=6));
            let position = primitive.attributes.position.filter(|_| has_triangles)?;
            Some((primitive_idx, position, primitive))
        });
        Self { primitives: primitives.collect(), is_morphed: is_morphed(&mesh.weights) }
    }
}

/// Collects the triangles of a scene.
struct NodeTraversal<'a> {
    document: &'a Document,
    /// In the order of those of the document.
    meshes: &'a [PlacedMesh<'a>],
    buffers: Buffers<'a>,
    path: &'a Path,
    budget: CopyBudget,
    mesh: TriangleMesh,
    /// What the file does to its triangles beyond what is read, for the user.
    not_applied: Vec<String>,
    /// The coarsest of what was read.
    rounding: Option<Rounding>,
}

impl NodeTraversal<'_> {
    fn run(&mut self) -> Result<(), MeshError> {
        let document = self.document;
        if document.nodes.is_empty() {
            // A library of meshes without a scene.
            return (0..self.meshes.len()).try_for_each(|mesh_idx| {
                if self.meshes[mesh_idx].is_morphed {
                    self.not_applied.push(format!("the morph weights of meshes[{mesh_idx}]"));
                }
                self.add_mesh(mesh_idx as u32, DMat4::IDENTITY)
            });
        }
        let mut open: Vec<(u32, DMat4)> =
            self.roots()?.into_iter().rev().map(|node| (node, DMat4::IDENTITY)).collect();
        let mut seen = vec![false; document.nodes.len()];
        while let Some((node_idx, world_from_parent)) = open.pop() {
            let node = document
                .nodes
                .get(node_idx as usize)
                .ok_or_else(|| self.refuse(format!("nodes[{node_idx}] is not there")))?;
            if std::mem::replace(&mut seen[node_idx as usize], true) {
                return Err(self
                    .refuse(format!("nodes[{node_idx}] stands in the scene twice, or in a loop")));
            }
            let world_from_node = world_from_parent * transform(node);
            if let Some(mesh_idx) = node.mesh {
                self.note_what_is_not_applied(node, node_idx, mesh_idx);
                self.add_mesh(mesh_idx, world_from_node)?;
            }
            open.extend(node.children.iter().rev().map(|child| (*child, world_from_node)));
        }
        Ok(())
    }

    fn note_what_is_not_applied(&mut self, node: &Node, node_idx: u32, mesh_idx: u32) {
        let of_mesh = self.meshes.get(mesh_idx as usize).is_some_and(|mesh| mesh.is_morphed);
        let has_weights = node.weights.as_deref().map_or(of_mesh, is_morphed);
        let has_instances =
            node.extensions.as_ref().is_some_and(|extensions| extensions.instances.is_some());
        for (what, is_there) in [
            ("morph weights", has_weights),
            ("instances (EXT_mesh_gpu_instancing)", has_instances),
            ("skin", node.skin.is_some()),
        ] {
            if is_there {
                self.not_applied.push(format!("the {what} of nodes[{node_idx}]"));
            }
        }
    }

    fn roots(&self) -> Result<Vec<u32>, MeshError> {
        let document = self.document;
        let scene_idx = document.scene.unwrap_or(0);
        match document.scenes.get(scene_idx as usize) {
            Some(scene) => Ok(scene.nodes.clone()),
            None if document.scene.is_some() => {
                Err(self.refuse(format!("scenes[{scene_idx}] is not there")))
            }
            None => {
                let mut is_child = vec![false; document.nodes.len()];
                for child in document.nodes.iter().flat_map(|node| &node.children) {
                    if let Some(is_child) = is_child.get_mut(*child as usize) {
                        *is_child = true;
                    }
                }
                Ok((0_u32..)
                    .zip(is_child)
                    .filter(|(_, is_child)| !is_child)
                    .map(|(node_idx, _)| node_idx)
                    .collect())
            }
        }
    }

    fn refuse(&self, what: String) -> MeshError {
        refusal(self.path, what)
    }

    fn add_mesh(&mut self, mesh_idx: u32, world_from_mesh: DMat4) -> Result<(), MeshError> {
        let mesh = self
            .meshes
            .get(mesh_idx as usize)
            .ok_or_else(|| self.refuse(format!("meshes[{mesh_idx}] is not there")))?;
        // Primitives of one mesh often share their vertices.
        let mut last: Option<(u32, u32, u32)> = None;
        for &(primitive_idx, position, primitive) in &mesh.primitives {
            let (base, n_vertices) = match last {
                Some((accessor, base, n_vertices)) if accessor == position => (base, n_vertices),
                _ => self.add_vertices(position, world_from_mesh)?,
            };
            last = Some((position, base, n_vertices));
            let first_triangle = self.mesh.triangles.len();
            self.add_triangles(
                primitive,
                &format!("meshes[{mesh_idx}].primitives[{primitive_idx}]"),
                base,
                n_vertices,
            )?;
            if DMat3::from_mat4(world_from_mesh).determinant() < 0.0 {
                self.mesh.triangles[first_triangle..]
                    .iter_mut()
                    .for_each(|corners| corners.swap(1, 2));
            }
        }
        Ok(())
    }

    /// Appends transformed positions; gives the number of the first and how many.
    fn add_vertices(
        &mut self,
        accessor: u32,
        world_from_mesh: DMat4,
    ) -> Result<(u32, u32), MeshError> {
        let numbers = self.buffers.numbers(accessor, 3)?;
        self.budget.grow(self.buffers.take_new_bytes());
        self.budget.add(numbers.len() / 3, 0, self.path)?;
        if self.document.accessors.get(accessor as usize).is_some_and(is_f32) {
            let axes = DMat3::from_mat4(world_from_mesh);
            let scale = axes.x_axis.length().max(axes.y_axis.length()).max(axes.z_axis.length());
            // What counts is where they are in the file: the transform is of 64 bits.
            let rounding = Rounding::of_f32(&numbers).scaled(scale);
            self.rounding = Rounding::coarser(self.rounding, rounding);
        }
        let base = self.mesh.vertices.len();
        for (k, position) in numbers.chunks_exact(3).enumerate() {
            let position = world_from_mesh.transform_point3(DVec3::from_slice(position));
            if !position.is_finite() {
                return Err(
                    self.refuse(format!("accessors[{accessor}]: position {k} is not finite"))
                );
            }
            self.mesh.vertices.push(position);
        }
        Ok((base as u32, (numbers.len() / 3) as u32))
    }

    /// Appends the triangles of a primitive, which stands at `place`.
    fn add_triangles(
        &mut self,
        primitive: &Primitive,
        place: &str,
        base: u32,
        n_vertices: u32,
    ) -> Result<(), MeshError> {
        let path = self.path;
        let refuse = |what: String| refusal(path, format!("{place}: {what}"));
        let corners: Vec<u32> = match primitive.indices {
            None => (base..base + n_vertices).collect(),
            Some(accessor) => {
                if self
                    .document
                    .accessors
                    .get(accessor as usize)
                    .is_some_and(|accessor| !is_index(accessor))
                {
                    return Err(refuse(format!(
                        "accessors[{accessor}] has no unsigned integers, as indices must be"
                    )));
                }
                let numbers = self.buffers.numbers(accessor, 1)?;
                if let Some(wrong) = numbers.iter().find(|number| **number >= f64::from(n_vertices))
                {
                    return Err(refuse(format!(
                        "names vertex {wrong} (counted from 0), it has {n_vertices}"
                    )));
                }
                numbers.into_iter().map(|number| base + number as u32).collect()
            }
        };
        // Strips make most triangles of a number of corners.
        self.budget.add(0, corners.len(), path)?;
        let triangles = &mut self.mesh.triangles;
        match primitive.mode {
            Some(5) => ply::strip(&corners, triangles),
            Some(6) => {
                if let [first, rest @ ..] = &corners[..] {
                    triangles.extend(rest.windows(2).map(|pair| [*first, pair[0], pair[1]]));
                }
            }
            _ if corners.len().is_multiple_of(3) => triangles
                .extend(corners.chunks_exact(3).map(|corner| [corner[0], corner[1], corner[2]])),
            _ => {
                return Err(refuse(format!(
                    "{} corners are no whole number of triangles",
                    corners.len()
                )));
            }
        }
        Ok(())
    }
}

/// Some target of a mesh is to be mixed in.
fn is_morphed(weights: &[f64]) -> bool {
    weights.iter().any(|weight| *weight != 0.0)
}

/// Parent from node.
fn transform(node: &Node) -> DMat4 {
    if let Some(matrix) = &node.matrix {
        return DMat4::from_cols_array(matrix);
    }
    let scale = node.scale.as_deref().map_or(DVec3::ONE, |scale| DVec3::from_array(*scale));
    let rotation =
        node.rotation.as_deref().map_or(DQuat::IDENTITY, |rotation| DQuat::from_array(*rotation));
    let translation = node
        .translation
        .as_deref()
        .map_or(DVec3::ZERO, |translation| DVec3::from_array(*translation));
    // A rotation of zero length is a mistake of its writer, not a part of no size.
    let rotation =
        if rotation.length_squared() > 0.0 { rotation.normalize() } else { DQuat::IDENTITY };
    DMat4::from_scale_rotation_translation(scale, rotation, translation)
}

#[cfg(test)]
mod tests;
