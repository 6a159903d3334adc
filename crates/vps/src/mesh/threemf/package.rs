//! The parts of a 3MF package: a ZIP archive, unpacked a piece at a time and never further than its
//! size makes likely.

use std::borrow::Cow;
use std::cell::Cell;
use std::io::{self, BufRead, BufReader, Cursor, Read};
use std::path::Path;
use std::rc::Rc;

use quick_xml::events::{BytesStart, Event};
use quick_xml::{Reader, XmlVersion};
use zip::ZipArchive;

use crate::mesh::MeshError;

/// Unpacked bytes per byte of the archive. Coordinates as text come out at four to thirty; a bomb
/// at a thousand.
const MOST_UNPACKED_PER_BYTE: u64 = 100;

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
                    && element.local_name().as_ref() == "Relationship"
                    && attribute(&element, "Type")?.is_some_and(|kind| kind.ends_with("/3dmodel"))
                    && found.is_none()
                {
                    found = attribute(&element, "Target")?;
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
        mut visit: impl FnMut(Element<'_>) -> Result<(), String>,
    ) -> Result<(), MeshError> {
        let path = self.path;
        let refuse = |what: String| refusal(path, format!("{:.80}: {what}", part));
        let file = self.archive.by_name(part).map_err(|error| refuse(error.to_string()))?;
        let mut reader = Reader::from_reader(BufReader::new(Bounded {
            inner: file,
            room: Rc::clone(&self.room),
            archive_bytes: self.n_bytes,
        }));
        let mut buffer = Vec::new();
        loop {
            buffer.clear();
            let result = match next(&mut reader, &mut buffer) {
                Ok(Event::Eof) => return Ok(()),
                Ok(Event::Start(element)) => visit(Element::Begin(element)),
                Ok(Event::Empty(element)) => {
                    let name = element.local_name().as_ref().to_owned();
                    visit(Element::Begin(element)).and_then(|()| visit(Element::End(&name)))
                }
                Ok(Event::End(element)) => visit(Element::End(element.local_name().as_ref())),
                Ok(_) => Ok(()),
                // Its own words would be "I/O error", of a file that was read long ago.
                Err(quick_xml::Error::Io(error)) => Err(error.to_string()),
                Err(error) => Err(error.to_string()),
            };
            result.map_err(|what| refuse(format!("byte {}: {what}", reader.buffer_position())))?;
        }
    }
}

fn next<'b>(
    reader: &mut Reader<impl BufRead>,
    buffer: &'b mut Vec<u8>,
) -> Result<Event<'b>, quick_xml::Error> {
    reader.read_event_into(buffer)
}

/// What a visitor of a part sees.
pub(super) enum Element<'a> {
    Begin(BytesStart<'a>),
    /// Name without its prefix.
    End(&'a str),
}

/// The value of an attribute, by its name without prefix.
pub(super) fn attribute(element: &BytesStart<'_>, name: &str) -> Result<Option<String>, String> {
    for attribute in element.attributes() {
        let attribute = attribute.map_err(|error| error.to_string())?;
        if attribute.key.local_name().as_ref() == name {
            let value = attribute
                .normalized_value(XmlVersion::Implicit1_0)
                .map_err(|error| error.to_string())?;
            return Ok(Some(value.trim().to_owned()));
        }
    }
    Ok(None)
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
