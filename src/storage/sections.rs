//! A file of named arrays: magic, version, key, table, checksums; little-endian SI, as the tick reads it.
//!
//! ```text
//!   0  magic "HAPTBAKE", units "SI m,kg\n", byte-order mark, format, generation, number of sections, key,
//!      bytes of the file, checksum of these 56 bytes                                                     64 bytes
//!  64  table: name, offset, bytes, checksum, bytes of an element, 0                                      48 bytes each
//!      checksum of the table                                                                              8 bytes
//!      sections, each on a multiple of 64, zeros between them
//! ```
//!
//! The first 64 bytes keep their shape in every format, so that an older and a newer program can tell a file that is not theirs from one
//! that is damaged. Checksums are XXH3 with 64 bits: they find accidents, not forgeries. A forged file gives wrong arrays, never an index
//! out of range: who reads an array checks what it indexes.

use std::fs::File;
use std::io::{self, Write};
use std::os::unix::fs::FileExt as _;
use std::sync::Arc;

use bytemuck::{Pod, Zeroable};
use thiserror::Error;
use twox_hash::XxHash3_64;

use super::{Mapping, Slab};

/// Format of the file; counts up when the head, the table or the meaning of a section changes.
pub const FORMAT: u32 = 1;

/// Sections start on a multiple of this: a cache line, and the alignment of the pointshell's blocks.
pub const ALIGNMENT: usize = 64;
/// More sections than any file has.
const SECTIONS_MAX: u32 = 64;
const MAGIC: [u8; 8] = *b"HAPTBAKE";
const UNITS: [u8; 8] = *b"SI m,kg\n";
const BYTE_ORDER: u32 = 0x0a0b_0c0d;

/// What a file is made from: equal keys, equal contents.
pub type Key = [u8; 16];

#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Head {
    magic: [u8; 8],
    units: [u8; 8],
    byte_order: u32,
    format: u32,
    generation: u32,
    n_sections: u32,
    key: Key,
    file_bytes: u64,
    checksum: u64,
}

#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Entry {
    /// Padded with zeros.
    name: [u8; 16],
    /// From the start of the file.
    offset: u64,
    bytes: u64,
    checksum: u64,
    element_bytes: u32,
    zero: u32,
}

const HEAD_BYTES: usize = size_of::<Head>();
const CHECKSUM_AT: usize = HEAD_BYTES - size_of::<u64>();

/// Why a file is not used.
#[derive(Debug, Error)]
pub enum Refusal {
    /// It cannot be read.
    #[error("{0}")]
    Io(#[from] io::Error),
    /// Made by an earlier version of this program.
    #[error("written by an older version (format {format}.{generation})")]
    Older {
        /// Format of the file.
        format: u32,
        /// Generation of the file.
        generation: u32,
    },
    /// Made by a later version of this program.
    #[error("written by a newer version (format {format}.{generation})")]
    Newer {
        /// Format of the file.
        format: u32,
        /// Generation of the file.
        generation: u32,
    },
    /// Cut off, changed, or not such a file at all; and where that shows.
    #[error("damaged ({0})")]
    Damaged(&'static str),
}

/// Collects arrays and writes them.
#[derive(Default)]
pub struct Writer<'a> {
    sections: Vec<(&'static str, usize, &'a [u8])>,
}

impl<'a> Writer<'a> {
    /// Adds an array. Names have 1 to 16 bytes and are used once.
    pub fn array<T: Pod>(&mut self, name: &'static str, values: &'a [T]) {
        debug_assert!((1..=16).contains(&name.len()) && self.sections.iter().all(|(other, ..)| *other != name), "{name}");
        self.sections.push((name, size_of::<T>(), bytemuck::cast_slice(values)));
    }

    /// Adds one record.
    pub fn record<T: Pod>(&mut self, name: &'static str, value: &'a T) {
        self.array(name, core::slice::from_ref(value));
    }

    /// Writes the file. Cost: one pass for the checksums, one for writing; nothing is copied.
    ///
    /// # Errors
    /// Any error of `out`.
    pub fn write_to(&self, key: Key, generation: u32, out: &mut impl Write) -> io::Result<()> {
        let mut end = (HEAD_BYTES + self.sections.len() * size_of::<Entry>() + size_of::<u64>()) as u64;
        let table: Vec<Entry> = self
            .sections
            .iter()
            .map(|(name, element_bytes, bytes)| {
                let offset = end.next_multiple_of(ALIGNMENT as u64);
                end = offset + bytes.len() as u64;
                let mut padded = [0; 16];
                padded.iter_mut().zip(name.bytes()).for_each(|(to, from)| *to = from);
                let checksum = XxHash3_64::oneshot(bytes);
                Entry { name: padded, offset, bytes: bytes.len() as u64, checksum, element_bytes: *element_bytes as u32, zero: 0 }
            })
            .collect();
        let mut head = Head {
            magic: MAGIC,
            units: UNITS,
            byte_order: BYTE_ORDER,
            format: FORMAT,
            generation,
            n_sections: table.len() as u32,
            key,
            file_bytes: end,
            checksum: 0,
        };
        head.checksum = head_checksum(&head);
        out.write_all(bytemuck::bytes_of(&head))?;
        let table_bytes = bytemuck::cast_slice(&table);
        out.write_all(table_bytes)?;
        out.write_all(&XxHash3_64::oneshot(table_bytes).to_ne_bytes())?;
        let mut position = (HEAD_BYTES + table_bytes.len() + size_of::<u64>()) as u64;
        for (entry, (.., bytes)) in table.iter().zip(&self.sections) {
            out.write_all(&[0; ALIGNMENT][..(entry.offset - position) as usize])?;
            out.write_all(bytes)?;
            position = entry.offset + entry.bytes;
        }
        Ok(())
    }
}

fn head_checksum(head: &Head) -> u64 {
    XxHash3_64::oneshot(&bytemuck::bytes_of(head)[..CHECKSUM_AT])
}

/// Where the bytes of a file are.
#[derive(Debug)]
pub enum Source {
    /// In memory, as pages of the file: arrays become windows.
    Mapped(Arc<Mapping>),
    /// On disk: arrays are read into memory of their own.
    File(File),
    /// Somewhere else; for tests of damaged files.
    Memory(Vec<u8>),
}

impl Source {
    fn bytes(&self) -> io::Result<u64> {
        Ok(match self {
            Self::Mapped(mapping) => mapping.bytes().len() as u64,
            Self::File(file) => file.metadata()?.len(),
            Self::Memory(bytes) => bytes.len() as u64,
        })
    }

    /// `n` elements from `offset` on, which the caller has found to lie within the file.
    fn array<T: Pod>(&self, offset: usize, n: usize) -> Result<Slab<T>, Refusal> {
        const ELSEWHERE: Refusal = Refusal::Damaged("a section that lies elsewhere");
        let range = offset..offset + n * size_of::<T>();
        if let Self::Mapped(mapping) = self {
            return Slab::mapped(mapping, range).ok_or(ELSEWHERE);
        }
        let mut values: Vec<T> = bytemuck::allocation::try_zeroed_vec(n).map_err(|()| io::Error::from(io::ErrorKind::OutOfMemory))?;
        match self {
            Self::File(file) => file.read_exact_at(bytemuck::cast_slice_mut(&mut values), offset as u64)?,
            Self::Memory(bytes) => {
                bytemuck::cast_slice_mut(&mut values).copy_from_slice(bytes.get(range).ok_or(ELSEWHERE)?);
            }
            Self::Mapped(_) => {}
        }
        Ok(values.into())
    }
}

/// A file whose head and table have been checked.
#[derive(Debug)]
pub struct Reader {
    source: Source,
    table: Slab<Entry>,
}

impl core::fmt::Debug for Entry {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "{} ({} bytes)", self.name.escape_ascii(), self.bytes)
    }
}

impl Reader {
    /// Checks head and table. `key: None` takes any.
    ///
    /// # Errors
    /// See [`Refusal`]: a file of another version, a damaged one, one that is somebody else's, or one that cannot be read.
    pub fn new(source: Source, key: Option<Key>, generation: u32) -> Result<Self, Refusal> {
        let file_bytes = source.bytes()?;
        if file_bytes < HEAD_BYTES as u64 {
            return Err(Refusal::Damaged("shorter than its head"));
        }
        let head = *source.array::<Head>(0, 1)?.first().ok_or(Refusal::Damaged("no head"))?;
        if head.magic != MAGIC || head.units != UNITS || head.byte_order != BYTE_ORDER {
            return Err(Refusal::Damaged("not a bake file of this kind of machine"));
        }
        if head.checksum != head_checksum(&head) {
            return Err(Refusal::Damaged("the head"));
        }
        let (found, own) = ((head.format, head.generation), (FORMAT, generation));
        if found != own {
            let (format, generation) = found;
            return Err(if found < own { Refusal::Older { format, generation } } else { Refusal::Newer { format, generation } });
        }
        if key.is_some_and(|key| key != head.key) {
            return Err(Refusal::Damaged("it belongs to another object"));
        }
        if head.file_bytes != file_bytes {
            return Err(Refusal::Damaged("its length"));
        }
        let n_sections = head.n_sections as usize;
        let table_end = HEAD_BYTES + n_sections * size_of::<Entry>();
        if head.n_sections > SECTIONS_MAX || ((table_end + size_of::<u64>()) as u64) > file_bytes {
            return Err(Refusal::Damaged("the table"));
        }
        let table = source.array::<Entry>(HEAD_BYTES, n_sections)?;
        let checksum = source.array::<[u8; 8]>(table_end, 1)?;
        if checksum.first().copied().map(u64::from_ne_bytes) != Some(XxHash3_64::oneshot(bytemuck::cast_slice(&table))) {
            return Err(Refusal::Damaged("the table"));
        }
        Ok(Self { source, table })
    }

    fn entry(&self, name: &str) -> Option<&Entry> {
        let is_it = |entry: &&Entry| entry.name.strip_prefix(name.as_bytes()).is_some_and(|rest| rest.iter().all(|byte| *byte == 0));
        self.table.iter().find(is_it)
    }

    /// True when there is a section of this name.
    pub fn has(&self, name: &str) -> bool {
        self.entry(name).is_some()
    }

    /// One array, its checksum verified on the memory that is handed out. Cost: one pass over it.
    ///
    /// # Errors
    /// No such section, one of other elements or beyond the end of the file, or one that does not match its checksum.
    pub fn array<T: Pod>(&self, name: &'static str) -> Result<Slab<T>, Refusal> {
        let damaged = Refusal::Damaged(name);
        let Some(entry) = self.entry(name) else { return Err(damaged) };
        let within = entry.offset.checked_add(entry.bytes).is_some_and(|end| self.source.bytes().is_ok_and(|bytes| end <= bytes));
        let (Ok(offset), Ok(bytes)) = (usize::try_from(entry.offset), usize::try_from(entry.bytes)) else { return Err(damaged) };
        if !within || entry.element_bytes as usize != size_of::<T>() || !bytes.is_multiple_of(size_of::<T>()) || offset % ALIGNMENT != 0 {
            return Err(damaged);
        }
        let values = self.source.array::<T>(offset, bytes / size_of::<T>())?;
        if XxHash3_64::oneshot(bytemuck::cast_slice(&values)) != entry.checksum {
            return Err(damaged);
        }
        Ok(values)
    }

    /// One record.
    ///
    /// # Errors
    /// As [`Self::array`], or there is not exactly one.
    pub fn record<T: Pod>(&self, name: &'static str) -> Result<T, Refusal> {
        match *self.array::<T>(name)? {
            [record] => Ok(record),
            _ => Err(Refusal::Damaged(name)),
        }
    }
}
