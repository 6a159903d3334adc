//! The numbers of a glTF file: from the binary part, from base64 text, or from a file beside it,
//! checked before they are read.

use std::cell::{Cell, OnceCell, RefCell};
use std::collections::HashMap;
use std::ops::Deref;
use std::path::{Component, Path, PathBuf};
use std::rc::Rc;

use base64::Engine;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};

use super::document::{Accessor, Document, refusal};
use crate::mesh::{Foreign, MeshError, source};

/// Some programs leave the `=` at the end out.
const BASE64: GeneralPurpose = GeneralPurpose::new(
    &base64::alphabet::STANDARD,
    GeneralPurposeConfig::new().with_decode_padding_mode(DecodePaddingMode::Indifferent),
);

enum BufferSource<'a> {
    Part(&'a [u8]),
    Inline(Vec<u8>),
    File(Rc<source::Bytes>),
}

impl Deref for BufferSource<'_> {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        match self {
            Self::Part(bytes) => bytes,
            Self::Inline(bytes) => bytes,
            Self::File(bytes) => bytes,
        }
    }
}

/// The buffers of a document, each read when it is first asked for.
pub(super) struct Buffers<'a> {
    document: &'a Document,
    path: &'a Path,
    /// The binary part of a GLB file.
    binary: Option<&'a [u8]>,
    /// Size of the file itself.
    file_bytes: usize,
    loaded: Vec<OnceCell<BufferSource<'a>>>,
    /// Read once, however many buffers name them.
    files: RefCell<HashMap<PathBuf, Rc<source::Bytes>>>,
    /// Bytes of other files that were read.
    read_bytes: Cell<usize>,
    new_bytes: Cell<usize>,
}

impl<'a> Buffers<'a> {
    pub(super) fn new(
        document: &'a Document,
        binary: Option<&'a [u8]>,
        file_bytes: usize,
        path: &'a Path,
    ) -> Self {
        Self {
            document,
            path,
            binary,
            file_bytes,
            loaded: document.buffers.iter().map(|_| OnceCell::new()).collect(),
            files: RefCell::default(),
            read_bytes: Cell::new(0),
            new_bytes: Cell::new(0),
        }
    }

    /// Bytes that were read from other files since this was last asked.
    pub(super) fn take_new_bytes(&self) -> usize {
        self.new_bytes.take()
    }

    /// The numbers of an accessor, flattened: `n_components` per element.
    pub(super) fn numbers(
        &self,
        accessor_idx: u32,
        n_components: usize,
    ) -> Result<Vec<f64>, MeshError> {
        let refuse =
            |what: String| refusal(self.path, format!("accessors[{accessor_idx}]: {what}"));
        let accessor = self
            .document
            .accessors
            .get(accessor_idx as usize)
            .ok_or_else(|| refuse("is not there".to_owned()))?;
        let wanted = if n_components == 1 { "SCALAR" } else { "VEC3" };
        if accessor.kind != wanted {
            return Err(refuse(format!(
                "type {wanted} is needed here, found `{:.40}`",
                accessor.kind
            )));
        }
        let kind = ComponentKind::of(accessor.component_type)
            .ok_or_else(|| refuse(unknown_kind(accessor.component_type)))?;
        let mut numbers = match accessor.buffer_view {
            Some(view) => {
                self.read(view, accessor.byte_offset, accessor.count, n_components, kind, &refuse)?
            }
            // Without a view they are zero, and the number of them rests on the file's word.
            None if accessor.count <= (self.file_bytes + self.read_bytes.get()) as u64 => {
                vec![0.0; accessor.count as usize * n_components]
            }
            None => return Err(refuse(format!("{} elements without a buffer", accessor.count))),
        };
        if let Some(sparse) = &accessor.sparse {
            // Each element at most once; else a mesh of one vertex costs any number of them.
            if sparse.count > accessor.count {
                let most = accessor.count;
                return Err(refuse(format!("{} sparse elements of {most}", sparse.count)));
            }
            let index_kind = ComponentKind::of(sparse.indices.component_type)
                .filter(|kind| kind.is_index())
                .ok_or_else(|| refuse(unknown_kind(sparse.indices.component_type)))?;
            let places = &sparse.indices;
            let values = &sparse.values;
            let places = self.read(
                places.buffer_view,
                places.byte_offset,
                sparse.count,
                1,
                index_kind,
                &refuse,
            )?;
            let values = self.read(
                values.buffer_view,
                values.byte_offset,
                sparse.count,
                n_components,
                kind,
                &refuse,
            )?;
            for (place, value) in places.into_iter().zip(values.chunks_exact(n_components)) {
                let element = numbers.chunks_exact_mut(n_components).nth(place as usize);
                element
                    .ok_or_else(|| refuse(format!("sparse element {place} of {}", accessor.count)))?
                    .copy_from_slice(value);
            }
        }
        if accessor.normalized {
            numbers.iter_mut().for_each(|number| *number = kind.normalized(*number));
        }
        Ok(numbers)
    }

    /// Elements of a buffer view; `refuse` says which accessor asks for them.
    fn read(
        &self,
        view_idx: u32,
        byte_offset: u64,
        count: u64,
        n_components: usize,
        kind: ComponentKind,
        refuse: &dyn Fn(String) -> MeshError,
    ) -> Result<Vec<f64>, MeshError> {
        let view = self.document.buffer_views.get(view_idx as usize);
        let view = view.ok_or_else(|| refuse(format!("bufferViews[{view_idx}] is not there")))?;
        let buffer = self.buffer(view.buffer)?;
        let bytes = part_of(buffer, view.byte_offset, view.byte_length).ok_or_else(|| {
            let end = view.byte_offset.saturating_add(view.byte_length);
            refuse(format!(
                "bufferViews[{view_idx}] ends at byte {end}, buffers[{}] has {}",
                view.buffer,
                buffer.len()
            ))
        })?;
        let size = (kind.size_bytes() * n_components) as u64;
        let stride = view.byte_stride.unwrap_or(size);
        if stride < size {
            return Err(refuse(format!(
                "bufferViews[{view_idx}]: byteStride {stride} is below {size}, the size of an \
                    element"
            )));
        }
        let Some(last) = count.checked_sub(1) else { return Ok(Vec::new()) };
        let end = last
            .checked_mul(stride)
            .and_then(|bytes| bytes.checked_add(size))
            .and_then(|bytes| bytes.checked_add(byte_offset));
        if end.is_none_or(|end| end > bytes.len() as u64) {
            return Err(refuse(format!(
                "{count} elements announced, bufferViews[{view_idx}] has {} bytes",
                bytes.len()
            )));
        }
        let elements = bytes[byte_offset as usize..].chunks(stride as usize).take(count as usize);
        let mut numbers = Vec::with_capacity(count as usize * n_components);
        for element in elements {
            numbers.extend(
                element[..size as usize]
                    .chunks_exact(kind.size_bytes())
                    .map(|bytes| kind.number(bytes)),
            );
        }
        Ok(numbers)
    }

    fn buffer(&self, buffer_idx: u32) -> Result<&[u8], MeshError> {
        let refuse = |what: String| refusal(self.path, format!("buffers[{buffer_idx}]: {what}"));
        let cell = self
            .loaded
            .get(buffer_idx as usize)
            .ok_or_else(|| refuse("is not there".to_owned()))?;
        if cell.get().is_none() {
            let buffer = &self.document.buffers[buffer_idx as usize];
            let bytes = match &buffer.uri {
                None if buffer_idx == 0 => BufferSource::Part(
                    self.binary
                        .ok_or_else(|| refuse("has no uri and no binary part".to_owned()))?,
                ),
                None => return Err(refuse("has no uri".to_owned())),
                Some(uri) => match uri.strip_prefix("data:") {
                    Some(data) => BufferSource::Inline(inline(data).map_err(refuse)?),
                    None => BufferSource::File(self.file(beside(self.path, uri).map_err(refuse)?)?),
                },
            };
            if (bytes.len() as u64) < buffer.byte_length {
                // A pointer is shorter than what it stands for.
                if let (BufferSource::File(bytes), Some(uri)) = (&bytes, &buffer.uri)
                    && let Some(found) = Foreign::recognise(bytes)
                {
                    let path = beside(self.path, uri).map_err(refuse)?;
                    return Err(MeshError::NotAMesh { path, found });
                }
                return Err(refuse(format!(
                    "cut, {} bytes announced, {} found",
                    buffer.byte_length,
                    bytes.len()
                )));
            }
            _ = cell.set(bytes);
        }
        Ok(cell.get().map_or(&[], |bytes| &**bytes))
    }

    fn file(&self, path: PathBuf) -> Result<Rc<source::Bytes>, MeshError> {
        if let Some(bytes) = self.files.borrow().get(&path) {
            return Ok(Rc::clone(bytes));
        }
        let bytes = Rc::new(source::read(&path)?);
        self.read_bytes.set(self.read_bytes.get().saturating_add(bytes.len()));
        self.new_bytes.set(self.new_bytes.get().saturating_add(bytes.len()));
        self.files.borrow_mut().insert(path, Rc::clone(&bytes));
        Ok(bytes)
    }
}

/// Paths of the buffers that are files of their own.
///
/// # Errors
/// What is wrong with the first one that may not be read.
pub(super) fn files(document: &Document, path: &Path) -> Result<Vec<PathBuf>, MeshError> {
    let uris = document
        .buffers
        .iter()
        .filter_map(|buffer| buffer.uri.as_deref())
        .filter(|uri| !uri.starts_with("data:"));
    uris.map(|uri| beside(path, uri).map_err(|what| refusal(path, what))).collect()
}

/// A file in the folder of `path`, or below.
fn beside(path: &Path, uri: &str) -> Result<PathBuf, String> {
    let shown = || uri.chars().take(60).collect::<String>();
    let name = percent_encoding::percent_decode_str(uri)
        .decode_utf8()
        .map_err(|_| format!("uri `{}` is not UTF-8", shown()))?;
    let name = PathBuf::from(name.as_ref());
    let is_below =
        name.components().all(|part| matches!(part, Component::Normal(_) | Component::CurDir));
    if !is_below || uri.contains("://") {
        return Err(format!("uri `{}` must name a file beside this one", shown()));
    }
    Ok(path.with_file_name(name))
}

fn part_of(bytes: &[u8], offset: u64, length: u64) -> Option<&[u8]> {
    let begin = usize::try_from(offset).ok()?;
    bytes.get(begin..begin.checked_add(usize::try_from(length).ok()?)?)
}

/// What follows `data:`, which must be base64: other text cannot carry numbers.
fn inline(data: &str) -> Result<Vec<u8>, String> {
    let (_, text) = data.split_once(";base64,").ok_or("a data uri must be base64")?;
    BASE64.decode(text).map_err(|error| format!("base64: {error}"))
}

fn unknown_kind(component_type: u32) -> String {
    format!("componentType {component_type} cannot be used here")
}

/// Type of the numbers of an accessor.
#[derive(Clone, Copy, PartialEq, Eq)]
enum ComponentKind {
    I8,
    U8,
    I16,
    U16,
    U32,
    F32,
}

impl ComponentKind {
    fn of(component_type: u32) -> Option<Self> {
        Some(match component_type {
            5120 => Self::I8,
            5121 => Self::U8,
            5122 => Self::I16,
            5123 => Self::U16,
            5125 => Self::U32,
            5126 => Self::F32,
            _ => return None,
        })
    }

    fn is_index(self) -> bool {
        matches!(self, Self::U8 | Self::U16 | Self::U32)
    }

    fn size_bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::U32 | Self::F32 => 4,
        }
    }

    /// `bytes` has the size of one number; the format is little-endian.
    fn number(self, bytes: &[u8]) -> f64 {
        match (self, bytes) {
            (Self::I8, [a]) => f64::from(a.cast_signed()),
            (Self::U8, [a]) => f64::from(*a),
            (Self::I16, [a, b]) => f64::from(i16::from_le_bytes([*a, *b])),
            (Self::U16, [a, b]) => f64::from(u16::from_le_bytes([*a, *b])),
            (Self::U32, [a, b, c, d]) => f64::from(u32::from_le_bytes([*a, *b, *c, *d])),
            (Self::F32, [a, b, c, d]) => f64::from(f32::from_le_bytes([*a, *b, *c, *d])),
            _ => f64::NAN,
        }
    }

    /// Whole numbers as parts of their range, as positions of `KHR_mesh_quantization` are.
    fn normalized(self, number: f64) -> f64 {
        match self {
            Self::I8 => (number / f64::from(i8::MAX)).max(-1.0),
            Self::U8 => number / f64::from(u8::MAX),
            Self::I16 => (number / f64::from(i16::MAX)).max(-1.0),
            Self::U16 => number / f64::from(u16::MAX),
            Self::U32 | Self::F32 => number,
        }
    }
}

/// True for numbers that may stand in a list of vertices.
pub(super) fn is_index(accessor: &Accessor) -> bool {
    ComponentKind::of(accessor.component_type).is_some_and(ComponentKind::is_index)
        && !accessor.normalized
}

/// True for coordinates of 32 bits; those of integers are exact.
pub(super) fn is_f32(accessor: &Accessor) -> bool {
    ComponentKind::of(accessor.component_type) == Some(ComponentKind::F32)
}
