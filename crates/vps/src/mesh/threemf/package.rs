//! The parts of a 3MF package: a ZIP archive, unpacked a piece at a time and never further than its
//! size makes likely.
//!
//! Names count with their namespace. A part is of the namespace of its outermost element; elements
//! of others are extensions, which may have vertices and triangles of their own.

use std::borrow::Cow;
use std::cell::Cell;
use std::io::{self, BufRead, BufReader, Cursor, Read};
use std::path::Path;
use std::rc::Rc;

use quick_xml::events::{BytesStart, Event};
use quick_xml::name::{NamespaceError, NamespaceResolver, QName, ResolveResult};
use quick_xml::{NsReader, XmlVersion};
use zip::ZipArchive;

use crate::mesh::MeshError;

/// Unpacked bytes per byte of the archive. Coordinates as text come out at four to thirty; a bomb
/// at a thousand.
const MOST_UNPACKED_PER_BYTE: u64 = 100;
/// Bytes of a namespace. It is written once and compared at every element.
const LONGEST_NAMESPACE: usize = 256;

pub(super) struct Package<'a> {
    archive: ZipArchive<Cursor<&'a [u8]>>,
    path: &'a Path,
    /// Bytes of the archive.
    n_bytes: u64,
    /// Bytes that may still be unpacked, over all parts.
    room: Rc<Cell<u64>>,
}

impl<'a> Package<'a> {
    pub(super) fn open(bytes: &'a [u8], path: &'a Path) -> Result<Self, MeshError> {
        let archive = ZipArchive::new(Cursor::new(bytes))
            .map_err(|error| refusal(path, format!("not a 3MF package, or a cut one ({error})")))?;
        let n_bytes = bytes.len() as u64;
        let room = Rc::new(Cell::new(n_bytes.saturating_mul(MOST_UNPACKED_PER_BYTE)));
        Ok(Self { archive, path, n_bytes, room })
    }

    /// Name of the part in which the model begins: the one that the package says, or the usual one.
    pub(super) fn model_name(&mut self) -> Result<String, MeshError> {
        const RELATIONS: &str = "_rels/.rels";
        const USUAL: &str = "3D/3dmodel.model";
        let mut found = None;
        if self.archive.index_for_name(RELATIONS).is_some() {
            self.read(RELATIONS, |element| {
                if let Element::Begin(element) = element
                    && element.name() == "Relationship"
                    && element.attribute("Type")?.is_some_and(|kind| kind.ends_with("/3dmodel"))
                    && found.is_none()
                {
                    found = element.attribute("Target")?;
                }
                Ok(())
            })?;
        }
        Ok(found.map_or(USUAL.to_owned(), |name| part_name(&name)))
    }

    /// Names of the parts in which slicers say what the volumes of an object are for.
    pub(super) fn volume_lists(&self) -> Vec<String> {
        let is_list = |name: &String| {
            let file = name.strip_prefix("Metadata/").unwrap_or_default();
            file == "model_settings.config" || file.ends_with("_model.config")
        };
        let names = self.archive.file_names().flatten().map(Cow::into_owned);
        let mut lists: Vec<_> = names.filter(is_list).collect();
        lists.sort_unstable();
        lists
    }

    /// Shows every element of an XML part, and where it ends, to `visit`; its errors get their
    /// place added.
    pub(super) fn read(
        &mut self,
        part: &str,
        visit: impl FnMut(Element<'_>) -> Result<(), String>,
    ) -> Result<(), MeshError> {
        let path = self.path;
        let refuse = |what: String| refusal(path, format!("{:.80}: {what}", part));
        let file = self.archive.by_name(part).map_err(|error| refuse(error.to_string()))?;
        let mut reader = NsReader::from_reader(BufReader::new(Bounded {
            inner: file,
            room: Rc::clone(&self.room),
            archive_bytes: self.n_bytes,
        }));
        reader.config_mut().expand_empty_elements = true;
        let mut filter = NamespaceFilter { visit, own: None, n_foreign: 0 };
        let mut buffer = Vec::new();
        loop {
            buffer.clear();
            let result = match next(&mut reader, &mut buffer) {
                Ok(Event::Eof) => return Ok(()),
                Ok(event) => filter.show(event, reader.resolver()),
                // Its own words would be "I/O error", of a file that was read long ago.
                Err(quick_xml::Error::Io(error)) => Err(error.to_string()),
                Err(quick_xml::Error::Namespace(NamespaceError::TooManyBindings(most))) => {
                    Err(format!("more than {most} namespaces in one place; export plain meshes"))
                }
                Err(error) => Err(error.to_string()),
            };
            result.map_err(|what| refuse(format!("byte {}: {what}", reader.buffer_position())))?;
        }
    }
}

fn next<'b>(
    reader: &mut NsReader<impl BufRead>,
    buffer: &'b mut Vec<u8>,
) -> Result<Event<'b>, quick_xml::Error> {
    reader.read_event_into(buffer)
}

/// What a visitor of a part sees.
pub(super) enum Element<'a> {
    Begin(Begin<'a>),
    /// Name without its prefix.
    End(&'a str),
    /// An element of an extension; what it holds, and where it ends, is not shown.
    Extension {
        /// Without its prefix.
        name: &'a str,
        namespace: &'a str,
    },
}

/// The beginning of an element.
pub(super) struct Begin<'a> {
    element: BytesStart<'a>,
    resolver: &'a NamespaceResolver,
}

impl Begin<'_> {
    /// Without its prefix.
    pub(super) fn name(&self) -> &str {
        self.element.local_name().into_inner()
    }

    /// The value of an attribute without a prefix: it belongs to the element.
    pub(super) fn attribute(&self, name: &str) -> Result<Option<String>, String> {
        self.find(|key| Ok(key.as_ref() == name))
    }

    /// The value of an attribute of an extension, by a word in the namespace of that.
    pub(super) fn extension_attribute(
        &self,
        extension: &str,
        name: &str,
    ) -> Result<Option<String>, String> {
        self.find(|key| {
            if key.local_name().as_ref() != name {
                return Ok(false);
            }
            let resolved = self.resolver.resolve_attribute(key).0;
            if let ResolveResult::Unknown(prefix) = resolved {
                return Err(format!("the prefix of `{prefix:.20}:{name}` is declared nowhere"));
            }
            Ok(namespace(&resolved)?.contains(extension))
        })
    }

    /// The namespace that a prefix stands for, or itself where it is not declared.
    pub(super) fn namespace(&self, prefix: &str) -> Result<String, String> {
        let name = format!("{prefix}:name");
        let resolved = self.resolver.resolve_attribute(QName(&name)).0;
        if matches!(resolved, ResolveResult::Unknown(_)) {
            return Ok(prefix.to_owned());
        }
        namespace(&resolved).map(str::to_owned)
    }

    fn find(
        &self,
        is_it: impl Fn(QName<'_>) -> Result<bool, String>,
    ) -> Result<Option<String>, String> {
        for attribute in self.element.attributes() {
            let attribute = attribute.map_err(|error| error.to_string())?;
            if is_it(attribute.key)? {
                let value = attribute
                    .normalized_value(XmlVersion::Implicit1_0)
                    .map_err(|error| error.to_string())?;
                return Ok(Some(value.trim().to_owned()));
            }
        }
        Ok(None)
    }
}

/// Shows a visitor what is of the namespace of the outermost element.
struct NamespaceFilter<F> {
    visit: F,
    /// Namespace of the outermost element.
    own: Option<String>,
    /// Open elements, from one of an extension inwards.
    n_foreign: usize,
}

impl<F: FnMut(Element<'_>) -> Result<(), String>> NamespaceFilter<F> {
    fn show(&mut self, event: Event<'_>, resolver: &NamespaceResolver) -> Result<(), String> {
        match event {
            Event::Start(_) if self.n_foreign > 0 => self.n_foreign += 1,
            Event::Start(element) => {
                let (resolved, name) = resolver.resolve_element(element.name());
                let namespace = namespace(&resolved)?;
                if self.own.get_or_insert_with(|| namespace.to_owned()) != namespace {
                    self.n_foreign = 1;
                    let name = name.into_inner();
                    return (self.visit)(Element::Extension { name, namespace });
                }
                (self.visit)(Element::Begin(Begin { element, resolver }))?;
            }
            Event::End(_) if self.n_foreign > 0 => self.n_foreign -= 1,
            Event::End(element) => (self.visit)(Element::End(element.local_name().as_ref()))?,
            _ => {}
        }
        Ok(())
    }
}

/// The name of a namespace: empty for none, and a prefix that is declared nowhere is its own.
fn namespace<'a>(resolved: &'a ResolveResult<'_>) -> Result<&'a str, String> {
    let name = match resolved {
        ResolveResult::Bound(namespace) => namespace.into_inner(),
        ResolveResult::Unbound => "",
        ResolveResult::Unknown(prefix) => prefix,
    };
    if name.len() > LONGEST_NAMESPACE {
        return Err(format!(
            "the namespace `{name:.80}` is longer than {LONGEST_NAMESPACE} bytes; export plain \
                meshes"
        ));
    }
    Ok(name)
}

/// Names in a package begin with a slash, those in the archive do not.
pub(super) fn part_name(name: &str) -> String {
    name.trim_start_matches('/').to_owned()
}

#[cold]
pub(super) fn refusal(path: &Path, what: String) -> MeshError {
    MeshError::Parse { path: path.to_owned(), line: None, what }
}

/// Stops a part that unpacks to more than there is room for.
struct Bounded<R> {
    inner: R,
    room: Rc<Cell<u64>>,
    /// For the message.
    archive_bytes: u64,
}

impl<R: Read> Read for Bounded<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let n_bytes = self.inner.read(buffer)?;
        let rest = self.room.get().checked_sub(n_bytes as u64);
        self.room.set(rest.ok_or_else(|| {
            let archive_bytes = self.archive_bytes;
            io::Error::other(format!(
                "the package unpacks to far more than its size, as no model does: the limit is \
                    {MOST_UNPACKED_PER_BYTE} times its {archive_bytes} bytes"
            ))
        })?);
        Ok(n_bytes)
    }
}
