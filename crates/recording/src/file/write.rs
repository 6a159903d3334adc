//! Writes one recording.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{self, BufWriter, Read as _, Write as _};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use mcap::records::{AttachmentHeader, MessageHeader, Metadata};
use mcap::write::{NoSeek, WriteOptions};
use mcap::{Attachment, Compression, McapError, Writer};

use super::channels::Channel;
use super::messages::{self, Occasion, Stamps};
use super::scene_files::{self, MissingFile, SceneFiles};
use crate::TickRecord;
use crate::stamped_record::StampedRecord;
use haptics::Faults;
use vps::storage::whole_file::{Access, NewFile, growing};

/// A chunk is cut when it holds so many bytes before compression: less than a second at 1 kHz.
const CHUNK_BYTES: u64 = 512 << 10;
/// What a message takes in a chunk beside its own bytes.
const MESSAGE_HEAD_BYTES: u64 = 31;
/// ... or when it is so old.
const CHUNK_AGE: Duration = Duration::from_millis(400);
/// Viewers get the pose of the tool's frame so often: as often as they draw.
const TRANSFORM_EVERY_NS: u64 = 16_000_000;
/// Meshes of a scene are shown in the 3-D panels of viewers too, up to so many bytes together: they
/// make one message.
const SHOWN_BYTES: u64 = 32 << 20;

/// Why a recording cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    /// The file is there already.
    #[error("{} exists already", .0.display())]
    Exists(PathBuf),
    /// It cannot be created.
    #[error("cannot create {}: {source}", file.display())]
    Create {
        /// Which.
        file: PathBuf,
        /// Cause.
        source: io::Error,
    },
    /// It cannot be written any further.
    #[error("cannot write {}: {message}", file.display())]
    Write {
        /// Which.
        file: PathBuf,
        /// Cause.
        message: String,
    },
    /// Its thread cannot be started.
    #[error("cannot start a thread: {0}")]
    Thread(io::Error),
    /// The disk takes nothing for too long.
    #[error("{} was not finished: the disk takes no more", .0.display())]
    Hangs(PathBuf),
}

/// An open recording.
pub(super) struct RecordingFile {
    path: PathBuf,
    /// It takes the place of another one with the first tick that is in it; without a tick it goes,
    /// and the other one stays.
    replacement: Option<NewFile>,
    is_new: bool,
    mcap: Writer<NoSeek<BufWriter<File>>>,
    channels: Vec<(Channel, u16)>,
    occasions: [u16; Occasion::ALL.len()],
    next_transform_ns: u64,
    message: Vec<u8>,
    chunk_begun: Option<Instant>,
    chunk_bytes: u64,
    /// Ticks that were written, and those of them that can be read whatever happens.
    n_records: u64,
    n_safe: u64,
    stamps: Stamps,
    faults: Faults,
}

impl RecordingFile {
    /// Creates the file and writes what every recording begins with.
    pub(super) fn create(
        path: &Path,
        overwrites: bool,
        is_virtual: bool,
    ) -> Result<Self, RecordingError> {
        let is_new = fs::symlink_metadata(path).is_err();
        let opened = growing(path, Access::Private, overwrites);
        let (file, replacement) = opened.map_err(|source| match source.kind() {
            io::ErrorKind::AlreadyExists => RecordingError::Exists(path.to_owned()),
            _ => RecordingError::Create { file: path.to_owned(), source },
        })?;
        let failed = |error: McapError| RecordingError::Write {
            file: path.to_owned(),
            message: error.to_string(),
        };
        let mut mcap = WriteOptions::new()
            .compression(Some(Compression::Lz4))
            // Cut here, where it is known which ticks are in.
            .chunk_size(None)
            // Chunks are put together in memory and written as a whole: what a killed process
            // leaves behind can be read to the last of them.
            .disable_seeking(true)
            .library(concat!("hapticd ", env!("CARGO_PKG_VERSION")))
            .create(NoSeek::new(BufWriter::new(file)))
            .map_err(failed)?;
        let mut channels = Vec::new();
        let mut add = |topic: &str, (name, schema): (String, Vec<u8>)| {
            let schema_id = mcap.add_schema(&name, "protobuf", &schema)?;
            mcap.add_channel(schema_id, topic, "protobuf", &BTreeMap::new())
        };
        for channel in Channel::ALL {
            channels.push((channel, add(channel.topic(), channel.schema()).map_err(failed)?));
        }
        let mut occasions = [0; Occasion::ALL.len()];
        for (id, occasion) in occasions.iter_mut().zip(Occasion::ALL) {
            *id = add(occasion.topic(), occasion.schema()).map_err(failed)?;
        }
        let mut recording = Self {
            path: path.to_owned(),
            replacement,
            is_new,
            mcap,
            channels,
            occasions,
            next_transform_ns: 0,
            message: Vec::new(),
            chunk_begun: None,
            chunk_bytes: 0,
            n_records: 0,
            n_safe: 0,
            stamps: Stamps::new(is_virtual),
            faults: Faults::NONE,
        };
        // A disk that takes nothing says so now.
        recording.flush()?;
        Ok(recording)
    }

    /// Nothing was there before.
    pub(super) fn is_new(&self) -> bool {
        self.is_new
    }

    /// Ticks that can be read, whatever happens.
    pub(super) fn n_safe(&self) -> u64 {
        self.n_safe
    }

    /// Writes what the wall clock showed at loop time zero ([`zero_ns`](super::messages::zero_ns)).
    /// Counts before the first row, and not under the virtual clock.
    pub(super) fn begins_at(&mut self, zero_ns: u64) {
        self.stamps.begin_at(zero_ns);
    }

    /// Names and values for readers of the file.
    pub(super) fn metadata(
        &mut self,
        name: &str,
        values: BTreeMap<String, String>,
    ) -> Result<(), RecordingError> {
        let written =
            self.mcap.write_metadata(&Metadata { name: name.to_owned(), metadata: values });
        written.map_err(|error| self.failed(&error))
    }

    /// One tick.
    pub(super) fn record(
        &mut self,
        record: &TickRecord,
        dropped: u64,
    ) -> Result<(), RecordingError> {
        if let Some(new) = self.replacement.take() {
            let create = |source| RecordingError::Create { file: self.path.clone(), source };
            new.place().map_err(create)?;
        }
        let row = self.stamps.row(record, dropped);
        for (channel, id) in &self.channels {
            if channel.has_message(&row) {
                channel.write(&row, &mut self.message);
                let header = header(*id, &row);
                let written = self.mcap.write_to_known_channel(&header, &self.message);
                written.map_err(|error| failed(&self.path, &error))?;
                self.chunk_bytes += self.message.len() as u64 + MESSAGE_HEAD_BYTES;
            }
        }
        if row.stamp_ns >= self.next_transform_ns {
            self.next_transform_ns = row.stamp_ns + TRANSFORM_EVERY_NS;
            self.write(Occasion::Frame, &row, &messages::frame(&row))?;
        }
        let faults = record.output.faults;
        if faults != self.faults {
            self.faults = faults;
            self.write(Occasion::Faults, &row, &messages::faults(&row))?;
        }
        self.n_records += 1;
        self.chunk_begun.get_or_insert_with(Instant::now);
        self.flush_if_due()
    }

    /// Brings along what a scene is made of, before the first tick of it.
    pub(super) fn scene(
        &mut self,
        scene: &SceneFiles,
        first: &TickRecord,
        room_bytes: u64,
    ) -> Result<(), RecordingError> {
        let scene_idx = first.scene_idx;
        let folder = format!("scenes/{scene_idx}");
        let mut manifest = BTreeMap::from([
            ("name".to_owned(), scene.name.clone()),
            ("path".to_owned(), scene.path.display().to_string()),
            ("enforce".to_owned(), scene.enforce.to_string()),
        ]);
        if scene.starts_anew {
            manifest.insert("starts_anew".to_owned(), "true".to_owned());
        }
        for (name, media_type, text) in [
            ("scene.toml", "application/toml", &scene.toml),
            ("resolved.json", "application/json", &scene.resolved_json),
            ("profile.toml", "application/toml", &scene.profile_toml),
        ] {
            self.attach(&format!("{folder}/{name}"), media_type, text.as_bytes())?;
        }
        let mut left_bytes = room_bytes;
        for (n, named) in scene.named.iter().enumerate() {
            manifest.insert(format!("file.{n}.written"), named.written.clone());
            for (part, (beside, opened)) in named.opened().enumerate() {
                let key = |what: &str| format!("file.{n}.{part}.{what}");
                let name = format!("{folder}/files/{n}/{}", beside.display());
                manifest.insert(key("name"), beside.display().to_string());
                match opened {
                    Ok((mut file, n_bytes)) if n_bytes <= left_bytes => {
                        left_bytes -= n_bytes;
                        if self.attach_file(&name, &mut file, n_bytes)? {
                            manifest.insert(key("attachment"), name);
                        } else {
                            manifest
                                .insert(key("missing"), MissingFile::ChangedMeanwhile.to_string());
                        }
                    }
                    Ok((mut file, _)) => {
                        let hash = scene_files::hash(&mut file)
                            .map_or_else(|error| error.to_string(), |hash| format!("{hash:032x}"));
                        manifest.insert(key("xxh3"), hash);
                        manifest.insert(
                            key("missing"),
                            format!("{} MiB are the most that is brought along", room_bytes >> 20),
                        );
                    }
                    Err(gone) => {
                        manifest.insert(key("missing"), gone.to_string());
                    }
                }
            }
        }
        self.metadata(&folder, manifest)?;
        let row = self.stamps.row(first, 0);
        let update =
            messages::scene_update(scene, scene_idx, row.stamp_ns, room_bytes.min(SHOWN_BYTES));
        self.write(Occasion::Scene, &row, &update)?;
        self.flush()
    }

    fn attach(&mut self, name: &str, media_type: &str, data: &[u8]) -> Result<(), RecordingError> {
        let attachment = Attachment {
            log_time: 0,
            create_time: 0,
            name: name.to_owned(),
            media_type: media_type.to_owned(),
            data: Cow::Borrowed(data),
        };
        self.mcap.attach(&attachment).map_err(|error| self.failed(&error))
    }

    /// False when the file was written to meanwhile: the attachment is invalid then, as its length
    /// had to be written before.
    fn attach_file(
        &mut self,
        name: &str,
        file: &mut File,
        n_bytes: u64,
    ) -> Result<bool, RecordingError> {
        let stamp_now = |file: &File| file.metadata().ok().as_ref().and_then(scene_files::stamp);
        let before = stamp_now(file);
        let mut is_whole = true;
        let header = AttachmentHeader {
            log_time: 0,
            create_time: 0,
            name: name.to_owned(),
            media_type: "application/octet-stream".to_owned(),
        };
        self.mcap.start_attachment(n_bytes, header).map_err(|error| self.failed(&error))?;
        let mut left = n_bytes;
        let mut buffer = vec![0; 1 << 18];
        while left > 0 {
            let most = buffer.len().min(usize::try_from(left).unwrap_or(usize::MAX));
            let part = buffer.get_mut(..most).unwrap_or_default();
            // One that is cut short in this moment ends in zeros.
            let n = file.read(part).unwrap_or(0);
            let n = if n == 0 {
                is_whole = false;
                part.fill(0);
                part.len()
            } else {
                n
            };
            self.mcap
                .put_attachment_bytes(part.get(..n).unwrap_or_default())
                .map_err(|error| self.failed(&error))?;
            left -= n as u64;
        }
        self.mcap.finish_attachment().map_err(|error| self.failed(&error))?;
        Ok(is_whole && before.is_some() && stamp_now(file) == before)
    }

    fn write(
        &mut self,
        occasion: Occasion,
        row: &StampedRecord,
        message: &impl prost::Message,
    ) -> Result<(), RecordingError> {
        let bytes = message.encode_to_vec();
        let known =
            Occasion::ALL.into_iter().zip(self.occasions).find(|(known, _)| *known == occasion);
        if let (Some((_, channel_id)), false) = (known, bytes.is_empty()) {
            self.mcap
                .write_to_known_channel(&header(channel_id, row), &bytes)
                .map_err(|error| self.failed(&error))?;
            self.chunk_bytes += bytes.len() as u64 + MESSAGE_HEAD_BYTES;
        }
        Ok(())
    }

    /// Ends the chunk when it has waited long enough.
    pub(super) fn flush_if_due(&mut self) -> Result<(), RecordingError> {
        let is_old = self.chunk_begun.is_some_and(|begun| begun.elapsed() >= CHUNK_AGE);
        if is_old || self.chunk_bytes >= CHUNK_BYTES { self.flush() } else { Ok(()) }
    }

    /// Ends the chunk: what was written so far can be read, whatever happens.
    fn flush(&mut self) -> Result<(), RecordingError> {
        (self.chunk_begun, self.chunk_bytes) = (None, 0);
        self.mcap.flush().map_err(|error| self.failed(&error))?;
        self.n_safe = self.n_records;
        Ok(())
    }

    /// Ends the file.
    pub(super) fn finish(mut self) -> Result<(), RecordingError> {
        self.mcap.finish().map_err(|error| self.failed(&error))?;
        let Self { path, mcap, .. } = self;
        let finished = mcap.into_inner().into_inner().flush();
        finished.map_err(|error| RecordingError::Write { file: path, message: error.to_string() })
    }

    fn failed(&self, error: &McapError) -> RecordingError {
        failed(&self.path, error)
    }
}

fn failed(path: &Path, error: &McapError) -> RecordingError {
    let message =
        if let McapError::Io(cause) = error { cause.to_string() } else { error.to_string() };
    RecordingError::Write { file: path.to_owned(), message }
}

fn header(channel_id: u16, row: &StampedRecord) -> MessageHeader {
    // The lowest bits are what a reader needs to find what belongs together.
    MessageHeader {
        channel_id,
        sequence: row.record.tick as u32,
        log_time: row.stamp_ns,
        publish_time: row.stamp_ns,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_that_is_cut_short_while_it_is_attached_is_not_taken_for_whole() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("part.stl");
        fs::write(&path, [1; 5000]).expect("written");
        let mut recording =
            RecordingFile::create(&folder.path().join("r.mcap"), false, true).expect("created");
        let open = || File::open(&path).expect("there");
        assert!(recording.attach_file("whole", &mut open(), 5000).expect("written"));
        let mut file = open();
        File::options().write(true).open(&path).expect("there").set_len(10).expect("shorter");
        assert!(!recording.attach_file("short", &mut file, 5000).expect("written"));
        recording.finish().expect("finished");
    }
}
