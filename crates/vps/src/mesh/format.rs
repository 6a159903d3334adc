//! Formats of mesh files, and how they are recognised.

use std::path::Path;

use super::MeshError;
use crate::setting_names::SettingNames;

/// File name extensions that [`load`](super::load()) reads, lower case.
pub const EXTENSIONS: &[&str] = &["obj", "stl", "ply", "gltf", "glb", "3mf"];

/// What to do with a file of curved surfaces. The length of `-clmax` is in the unit of what gmsh
/// reads: mm.
pub fn cad_hint(names: &SettingNames) -> String {
    format!(
        "convert it: `gmsh PART.step -2 -clmax 1 -o PART.stl` (edges of at most 1 mm), or FreeCAD \
            with File, Export; then name the .stl, and mm as {}",
        names.unit
    )
}

/// The name of the format of a file of curved surfaces, by its extension; `None`: it is none.
pub fn cad_format(path: &Path) -> Option<&'static str> {
    let extension = path.extension()?.to_string_lossy().to_lowercase();
    match extension.as_str() {
        "step" | "stp" => Some("STEP"),
        "iges" | "igs" => Some("IGES"),
        "brep" | "brp" => Some("BREP"),
        _ => None,
    }
}

/// A file format. Which of its encodings a file has is found in the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// Wavefront OBJ, text.
    Obj,
    /// STL, text or binary.
    Stl,
    /// PLY, text or binary.
    Ply,
    /// glTF 2.0, JSON or binary.
    Gltf,
    /// 3MF package.
    ThreeMf,
}

impl Format {
    /// The format that the extension of `path` names, in any case.
    ///
    /// # Errors
    /// [`MeshError::UnknownExtension`].
    pub fn of(path: &Path) -> Result<Self, MeshError> {
        let extension = path
            .extension()
            .map(|extension| extension.to_string_lossy().to_lowercase())
            .unwrap_or_default();
        Ok(match extension.as_str() {
            "obj" => Self::Obj,
            "stl" => Self::Stl,
            "ply" => Self::Ply,
            "gltf" | "glb" => Self::Gltf,
            "3mf" => Self::ThreeMf,
            _ => {
                let path = path.to_owned();
                return Err(match cad_format(&path) {
                    Some(format) => MeshError::CurvedSurfaces { path, format },
                    None => MeshError::UnknownExtension { path, extension },
                });
            }
        })
    }

    /// What a file is by its first bytes; `None` where they do not say: binary STL begins with free
    /// text, OBJ with anything.
    pub(super) fn recognise(bytes: &[u8]) -> Option<Self> {
        let bytes = without_mark(bytes);
        let head = &bytes[..bytes.len().min(1024)];
        let has = |word: &[u8]| head.windows(word.len()).any(|window| window == word);
        let text = head.trim_ascii_start();
        if head.starts_with(b"ply\n") || head.starts_with(b"ply\r") {
            Some(Self::Ply)
        } else if head.starts_with(b"glTF") || text.starts_with(b"{") && has(b"\"asset\"") {
            Some(Self::Gltf)
        } else if head.starts_with(b"PK\x03\x04") && (has(b".model") || lists_model(bytes)) {
            Some(Self::ThreeMf)
        } else if text.starts_with(b"solid") && has(b"facet") && !head.contains(&0) {
            Some(Self::Stl)
        } else {
            // Comments may come first.
            let mut lines = text
                .split(|byte| *byte == b'\n')
                .filter(|line| !line.trim_ascii().is_empty() && line[0] != b'#');
            let is_obj = |line: &[u8]| {
                [&b"v "[..], b"o ", b"g ", b"mtllib "].iter().any(|word| line.starts_with(word))
            };
            lines.next().is_some_and(is_obj).then_some(Self::Obj)
        }
    }

    /// The name that people know it by.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Obj => "OBJ",
            Self::Stl => "STL",
            Self::Ply => "PLY",
            Self::Gltf => "glTF",
            Self::ThreeMf => "3MF",
        }
    }

    /// What to do with a file of this format under another one's extension.
    pub(super) fn rename_hint(self) -> &'static str {
        match self {
            Self::Obj => "rename it so that it ends in .obj",
            Self::Stl => "rename it so that it ends in .stl",
            Self::Ply => "rename it so that it ends in .ply",
            Self::Gltf => "rename it so that it ends in .gltf or .glb",
            Self::ThreeMf => "rename it so that it ends in .3mf",
        }
    }
}

/// The bytes behind a byte order mark of UTF-8, with which some programs begin a text.
pub(super) fn without_mark(bytes: &[u8]) -> &[u8] {
    bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes)
}

/// A zip archive lists what it has at its end: the model may be behind pictures of it.
fn lists_model(bytes: &[u8]) -> bool {
    const MOST_OF_LIST: usize = 1 << 16;
    let list = &bytes[bytes.len().saturating_sub(MOST_OF_LIST)..];
    list.windows(6).any(|window| window == b".model")
}
