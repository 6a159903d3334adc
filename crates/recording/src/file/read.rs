//! Reads a recording, from begin to end, whole or cut off.

use std::collections::BTreeMap;
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use mcap::McapError;
use mcap::records::Record;
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};

use super::channels::Channel;
use super::scene_files::ROOM_BYTES;
use crate::TickRecord;
use crate::stamped_record::StampedRecord;
use vps::storage::regular;

/// A longer record is a mistake: the longest that is written is an attachment, with its name.
const LONGEST_RECORD: usize = (ROOM_BYTES + (1 << 20)) as usize;
/// The same for a message of a tick. They take some hundred bytes.
const LONGEST_MESSAGE: usize = 64 << 10;
/// What an attachment takes beside its name and data, bytes: so many empty ones are no attachments
/// either.
const LEAST_ATTACHMENT: usize = 40;
/// Texts that are brought along are not longer, bytes.
pub const LONGEST_TEXT: usize = 16 << 20;

/// Why a file cannot be read as a recording.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// The file itself.
    #[error("cannot read {}: {source}", file.display())]
    File {
        /// Which.
        file: PathBuf,
        /// Cause.
        source: io::Error,
    },
    /// It is something else, or damaged.
    #[error("{} is no recording that can be read: {message}", file.display())]
    Format {
        /// Which.
        file: PathBuf,
        /// Cause.
        message: String,
    },
}

/// What a recording holds, in the order in which it was written.
#[derive(Debug)]
pub enum Entry {
    /// Names and values.
    Metadata {
        /// What of: `run`, `scenes/0`, `end` ...
        name: String,
        /// Themselves.
        values: BTreeMap<String, String>,
    },
    /// A file that was brought along.
    Attachment {
        /// Its path in the recording.
        name: String,
        /// Its contents.
        data: Vec<u8>,
    },
    /// A tick.
    Tick {
        /// What entered and left it.
        record: Box<TickRecord>,
        /// Records that were dropped before it.
        dropped: u64,
    },
}

/// An open recording. Gives its entries one after another and holds one chunk in memory.
pub struct Recording {
    path: PathBuf,
    file: Box<dyn Read>,
    reader: LinearReader,
    /// Bytes that were read, and bytes that files and values came to: these are never packed, so
    /// they cannot be more.
    n_read: usize,
    n_brought: usize,
    /// By number.
    channels: BTreeMap<u16, Channel>,
    row: StampedRecord,
    is_whole: bool,
    is_over: bool,
    /// Of the first message, ns since 1970.
    first_stamp_ns: Option<u64>,
}

impl Recording {
    /// Opens a file and reads how it begins.
    ///
    /// # Errors
    /// See [`ReadError`].
    pub fn open(path: &Path) -> Result<Self, ReadError> {
        let refused = |source| ReadError::File { file: path.to_owned(), source };
        let mut file = regular::open(path).map_err(refused)?;
        let mut begin = Vec::with_capacity(mcap::MAGIC.len());
        file.by_ref().take(mcap::MAGIC.len() as u64).read_to_end(&mut begin).map_err(refused)?;
        if begin != mcap::MAGIC {
            let message = if begin.is_empty() {
                "it is empty"
            } else {
                "it does not begin as an MCAP file does"
            };
            return Err(ReadError::Format { file: path.to_owned(), message: message.to_owned() });
        }
        Ok(Self::of(io::Cursor::new(begin).chain(file), path))
    }

    /// A recording from somewhere else, called so in what is said of it.
    pub fn of(file: impl Read + 'static, path: &Path) -> Self {
        let options = LinearReaderOptions::default()
            .with_record_length_limit(LONGEST_RECORD)
            .with_validate_chunk_crcs(true);
        Self {
            path: path.to_owned(),
            file: Box::new(file),
            reader: LinearReader::new_with_options(options),
            n_read: 0,
            n_brought: 0,
            channels: BTreeMap::new(),
            row: StampedRecord::default(),
            is_whole: false,
            is_over: false,
            first_stamp_ns: None,
        }
    }

    /// After the last entry: the file has an end. A recorder that was killed leaves one without.
    pub fn is_whole(&self) -> bool {
        self.is_whole
    }

    /// What the wall clock showed at the first tick, once that was read; the time of the simulated
    /// clock for a run under it.
    pub fn first_tick_at(&self) -> Option<SystemTime> {
        Some(SystemTime::UNIX_EPOCH + Duration::from_nanos(self.first_stamp_ns?))
    }

    /// The next entry; `None` at the end, also at that of a file that was cut off.
    ///
    /// # Errors
    /// See [`ReadError`]. What came before holds.
    pub fn next_entry(&mut self) -> Result<Option<Entry>, ReadError> {
        while !self.is_over {
            let event = match self.reader.next_event() {
                None => {
                    self.is_over = true;
                    break;
                }
                Some(Err(McapError::UnexpectedEof)) => {
                    // Whatever is missing, it was written after all that was read.
                    self.is_over = true;
                    break;
                }
                Some(Err(error)) => {
                    self.is_over = true;
                    return Err(ReadError::Format {
                        file: self.path.clone(),
                        message: error.to_string(),
                    });
                }
                Some(Ok(event)) => event,
            };
            match event {
                LinearReadEvent::ReadRequest(n_bytes) => {
                    let read = self.file.read(self.reader.insert(n_bytes));
                    let n_read =
                        read.map_err(|source| ReadError::File { file: self.path.clone(), source })?;
                    self.n_read += n_read;
                    self.reader.notify_read(n_read);
                }
                LinearReadEvent::Record { data, opcode } => {
                    let record = mcap::parse_record(opcode, data).map_err(|error| {
                        ReadError::Format { file: self.path.clone(), message: error.to_string() }
                    })?;
                    if let Record::Message { header, .. } = &record {
                        self.first_stamp_ns.get_or_insert(header.log_time);
                    }
                    let taken = take(record, &mut self.channels, &mut self.row, &mut self.is_whole);
                    let taken = taken.and_then(|entry| {
                        self.n_brought =
                            self.n_brought.saturating_add(entry.as_ref().map_or(0, brought));
                        let is_sound = self.n_brought <= self.n_read;
                        is_sound
                            .then_some(entry)
                            .ok_or_else(|| "it brings along more than it is long".to_owned())
                    });
                    if let Some(entry) = taken
                        .map_err(|message| ReadError::Format { file: self.path.clone(), message })?
                    {
                        return Ok(Some(entry));
                    }
                }
            }
        }
        Ok(None)
    }
}

/// Bytes of a file that this entry takes at least, where it is not packed.
fn brought(entry: &Entry) -> usize {
    match entry {
        Entry::Metadata { name, values } => {
            name.len() + values.iter().map(|(key, value)| key.len() + value.len()).sum::<usize>()
        }
        Entry::Attachment { name, data } => LEAST_ATTACHMENT + name.len() + data.len(),
        Entry::Tick { .. } => 0,
    }
}

fn take(
    record: Record<'_>,
    channels: &mut BTreeMap<u16, Channel>,
    row: &mut StampedRecord,
    is_whole: &mut bool,
) -> Result<Option<Entry>, String> {
    match record {
        Record::Channel(channel) => {
            if let Some(known) = Channel::of_topic(&channel.topic) {
                channels.insert(channel.id, known);
            }
        }
        Record::Message { header, data } => {
            let Some(channel) = channels.get(&header.channel_id) else { return Ok(None) };
            if row.record.tick as u32 != header.sequence {
                // What the last tick left behind is not part of this one.
                *row = StampedRecord::default();
                row.record.tick = u64::from(header.sequence);
            }
            let garbled =
                |why: String| format!("a message of {} is garbled: {why}", channel.topic());
            if data.len() > LONGEST_MESSAGE {
                return Err(garbled(format!("it has {} bytes, more than any", data.len())));
            }
            channel.read(&data, row).map_err(|error| garbled(error.to_string()))?;
            if *channel == Channel::LoopTiming {
                let StampedRecord { record, dropped, .. } = *row;
                return Ok(Some(Entry::Tick { record: Box::new(record), dropped }));
            }
        }
        Record::Attachment { header, data, .. } => {
            return Ok(Some(Entry::Attachment { name: header.name, data: data.into_owned() }));
        }
        Record::Metadata(metadata) => {
            return Ok(Some(Entry::Metadata { name: metadata.name, values: metadata.metadata }));
        }
        Record::DataEnd(_) => *is_whole = true,
        _ => {}
    }
    Ok(None)
}
