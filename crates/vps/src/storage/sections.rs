//! A file of named arrays: magic, version, key, table, checksums; little-endian SI, as the tick
//! reads it.
//!
//! ```text
//!   0  magic "HAPTBAKE", units "SI m,kg\n", byte-order mark, format, generation, number of sections, key,
//!      bytes of the file, checksum of these 56 bytes                                                     64 bytes
//!  64  table: name, offset, bytes, checksum, bytes of an element, 0                                      48 bytes each
//!      checksum of the table                                                                              8 bytes
//!      sections, each on a multiple of 64, zeros between them
//! ```
//!
//! The first 64 bytes keep their shape in every format, so that an older and a newer program can
//! tell a file that is not theirs from one that is damaged. Checksums are XXH3 with 64 bits: they
//! find accidents, not forgeries. A forged file gives wrong arrays, never an index out of range:
//! the reader of an array checks what it indexes.

use std::io::{self, Read, Write};
use std::path::Path;
use std::sync::Arc;

use bytemuck::{Pod, Zeroable};
use thiserror::Error;
use twox_hash::XxHash3_64;

use super::{MappedFile, SharedSlice, regular};

/// Format of the file; counts up when the head, the table or the meaning of a section changes.
pub const FORMAT: u32 = 1;

/// Sections start on a multiple of this: a cache line, and the alignment of the pointshell's
/// blocks.
pub const ALIGNMENT: usize = 64;
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
/// Where format and generation are, in every format.
pub const VERSIONS_AT: core::ops::Range<usize> =
    core::mem::offset_of!(Head, format)..core::mem::offset_of!(Head, n_sections);
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
    /// Made on a machine that writes the bytes of a number in the other order.
    #[error("written on a machine of the other byte order")]
    Foreign,
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
        debug_assert!(
            (1..=16).contains(&name.len())
                && self.sections.iter().all(|(other, ..)| *other != name),
            "{name}"
        );
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
        let mut end =
            (HEAD_BYTES + self.sections.len() * size_of::<Entry>() + size_of::<u64>()) as u64;
        let table: Vec<Entry> = self
            .sections
            .iter()
            .map(|(name, element_bytes, bytes)| {
                let offset = end.next_multiple_of(ALIGNMENT as u64);
                end = offset + bytes.len() as u64;
                let mut padded = [0; 16];
                padded.iter_mut().zip(name.bytes()).for_each(|(to, from)| *to = from);
                let checksum = XxHash3_64::oneshot(bytes);
                Entry {
                    name: padded,
                    offset,
                    bytes: bytes.len() as u64,
                    checksum,
                    element_bytes: *element_bytes as u32,
                    zero: 0,
                }
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

/// A file whose head and table have been checked.
#[derive(Debug)]
pub struct Reader {
    mapped: Arc<MappedFile>,
    table: SharedSlice<Entry>,
}

impl core::fmt::Debug for Entry {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "{} ({} bytes)", self.name.escape_ascii(), self.bytes)
    }
}

/// `n` elements from `offset` on, where they are all there.
fn window<T: Pod>(mapped: &Arc<MappedFile>, offset: usize, n: usize) -> Option<SharedSlice<T>> {
    SharedSlice::window(mapped, offset..offset.checked_add(n.checked_mul(size_of::<T>())?)?)
}

/// The key in the head of a file of arrays; `None` for any other file, and for one that cannot be
/// read.
pub fn key_of(path: &Path) -> Option<Key> {
    let mut bytes = [0; HEAD_BYTES];
    regular::open(path).ok()?.read_exact(&mut bytes).ok()?;
    let head: Head = bytemuck::pod_read_unaligned(&bytes);
    (head.magic == MAGIC).then_some(head.key)
}

impl Reader {
    /// Checks head and table. `key: None` takes any, and so does `generation: None`.
    ///
    /// # Errors
    /// See [`Refusal`]: a file of another version, a damaged one, or one of another key.
    pub fn new(
        mapped: Arc<MappedFile>,
        key: Option<Key>,
        generation: impl Into<Option<u32>>,
    ) -> Result<Self, Refusal> {
        let Some([head]) = window::<Head>(&mapped, 0, 1)
            .as_deref()
            .map(<[Head; 1]>::try_from)
            .and_then(Result::ok)
        else {
            return Err(Refusal::Damaged("shorter than its head"));
        };
        // Swapped as a whole, and with a checksum that fits, it is no accident.
        if (head.byte_order, head.checksum)
            == (BYTE_ORDER.swap_bytes(), head_checksum(&head).swap_bytes())
        {
            return Err(Refusal::Foreign);
        }
        if head.magic != MAGIC || head.units != UNITS || head.byte_order != BYTE_ORDER {
            return Err(Refusal::Damaged("its first bytes are not a bake file's"));
        }
        if head.checksum != head_checksum(&head) {
            return Err(Refusal::Damaged("the head"));
        }
        let found = (head.format, head.generation);
        let own = (FORMAT, generation.into().unwrap_or(head.generation));
        if found != own {
            let (format, generation) = found;
            return Err(if found < own {
                Refusal::Older { format, generation }
            } else {
                Refusal::Newer { format, generation }
            });
        }
        if key.is_some_and(|key| key != head.key) {
            return Err(Refusal::Damaged("it belongs to another object"));
        }
        if head.file_bytes != mapped.bytes().len() as u64 {
            return Err(Refusal::Damaged("its length"));
        }
        let n_sections = head.n_sections as usize;
        let table = window::<Entry>(&mapped, HEAD_BYTES, n_sections);
        let checksum = window::<u64>(&mapped, HEAD_BYTES + n_sections * size_of::<Entry>(), 1);
        let sound = |table: &SharedSlice<Entry>| {
            checksum.is_some_and(|checksum| {
                *checksum == [XxHash3_64::oneshot(bytemuck::cast_slice(table))]
            })
        };
        let table = table.filter(sound).ok_or(Refusal::Damaged("the table"))?;
        Ok(Self { mapped, table })
    }

    fn entry(&self, name: &str) -> Option<&Entry> {
        let is_it = |entry: &&Entry| {
            entry
                .name
                .strip_prefix(name.as_bytes())
                .is_some_and(|rest| rest.iter().all(|byte| *byte == 0))
        };
        self.table.iter().find(is_it)
    }

    /// Name and checksum of every section, as the table has them.
    pub fn checksums(&self) -> impl Iterator<Item = (String, u64)> + '_ {
        self.table.iter().map(|entry| {
            (String::from_utf8_lossy(&entry.name).trim_end_matches('\0').to_owned(), entry.checksum)
        })
    }

    /// True when there is a section of this name.
    pub fn has(&self, name: &str) -> bool {
        self.entry(name).is_some()
    }

    /// One array, its checksum verified on the memory that is handed out. Cost: one pass over it.
    ///
    /// # Errors
    /// No such section, one of other elements or beyond the end of the file, or one that does not
    /// match its checksum.
    pub fn array<T: Pod>(&self, name: &'static str) -> Result<SharedSlice<T>, Refusal> {
        let checked = |entry: &Entry| {
            let offset = usize::try_from(entry.offset).ok()?;
            let n_bytes = usize::try_from(entry.bytes).ok()?;
            let whole = entry.element_bytes as usize == size_of::<T>()
                && n_bytes.is_multiple_of(size_of::<T>());
            let values =
                window::<T>(&self.mapped, offset, n_bytes / size_of::<T>()).filter(|_| whole)?;
            (XxHash3_64::oneshot(bytemuck::cast_slice(&values)) == entry.checksum).then_some(values)
        };
        self.entry(name).and_then(checked).ok_or(Refusal::Damaged(name))
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

/// Makes length and checksums fit what a file says now, as far as it can be understood: for tests
/// and fuzzing, which want to come past the checksums.
pub fn reseal(bytes: &mut [u8]) {
    let Some(mut head) = bytes.get(..HEAD_BYTES).map(bytemuck::pod_read_unaligned::<Head>) else {
        return;
    };
    head.file_bytes = bytes.len() as u64;
    head.checksum = head_checksum(&head);
    bytes[..HEAD_BYTES].copy_from_slice(bytemuck::bytes_of(&head));
    let table_end =
        HEAD_BYTES.saturating_add((head.n_sections as usize).saturating_mul(size_of::<Entry>()));
    if bytes.len() < table_end.saturating_add(size_of::<u64>()) {
        return;
    }
    for at in (HEAD_BYTES..table_end).step_by(size_of::<Entry>()) {
        let mut entry: Entry = bytemuck::pod_read_unaligned(&bytes[at..at + size_of::<Entry>()]);
        let section = entry
            .offset
            .checked_add(entry.bytes)
            .and_then(|end| bytes.get(entry.offset as usize..end as usize));
        if let Some(section) = section {
            entry.checksum = XxHash3_64::oneshot(section);
            bytes[at..at + size_of::<Entry>()].copy_from_slice(bytemuck::bytes_of(&entry));
        }
    }
    let checksum = XxHash3_64::oneshot(&bytes[HEAD_BYTES..table_end]);
    bytes[table_end..table_end + size_of::<u64>()].copy_from_slice(&checksum.to_ne_bytes());
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_of_the_other_byte_order_is_foreign_and_a_damaged_one_is_not() {
        let mut file = Writer::default();
        file.array("numbers", &[1_u32, 2, 3]);
        let mut bytes = Vec::new();
        file.write_to([7; 16], 1, &mut bytes).unwrap();
        let refusal = |bytes: &[u8]| {
            Reader::new(MappedFile::copy(bytes).unwrap(), None, 1).map(|_| ()).unwrap_err()
        };
        assert!(Reader::new(MappedFile::copy(&bytes).unwrap(), None, 1).is_ok());
        let mut head: Head = bytemuck::pod_read_unaligned(&bytes[..HEAD_BYTES]);
        head.byte_order = head.byte_order.swap_bytes();
        head.format = head.format.swap_bytes();
        head.generation = head.generation.swap_bytes();
        head.n_sections = head.n_sections.swap_bytes();
        head.file_bytes = head.file_bytes.swap_bytes();
        head.checksum = head_checksum(&head).swap_bytes();
        bytes[..HEAD_BYTES].copy_from_slice(bytemuck::bytes_of(&head));
        assert!(matches!(refusal(&bytes), Refusal::Foreign));
        bytes[40] ^= 1;
        assert!(matches!(refusal(&bytes), Refusal::Damaged(_)));
    }
}
