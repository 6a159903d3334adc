//! Starts and stops recordings while a run goes on.
//!
//! ```text
//!  drain ──subscriber──► bounded queue ──► recorder thread ──► file
//!             └ full: dropped and counted; under the virtual clock the drain waits
//! ```
//! Nothing that a disk does reaches the drain or the loop.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::time::{Duration, SystemTime};

use crossbeam::channel::{Receiver, RecvTimeoutError, Sender, TrySendError, bounded, select};
use serde::Serialize;

use super::messages::zero_ns;
use super::scene_files::{ROOM_BYTES, SceneFiles, Scenes};
use super::write::{RecordingError, RecordingFile};
use crate::{RecordSubscribers, TickRecord};
use rt::utc::timestamp;

/// Records that may wait for the disk: eight seconds at 1 kHz, some megabytes.
const QUEUE_RECORDS: usize = 8192;
/// How often the recorder looks after its chunk while nothing comes.
const IDLE: Duration = Duration::from_millis(100);
/// How long a disk may take to end a file.
const FINISH_PATIENCE: Duration = Duration::from_secs(10);
/// The files of a scene are added within this time after its first tick.
const SCENE_PATIENCE: Duration = Duration::from_secs(1);

/// Name of the fact that says which force law ([`haptics::FORCE_LAW`]) gave the forces; version
/// 0.1.0 did not write it.
pub const FORCE_LAW_KEY: &str = "force_law";

/// Facts about a run and its machine, by name, for readers of the recording. Clones share them.
#[derive(Clone, Debug, Default)]
pub struct Facts(Arc<Mutex<BTreeMap<String, String>>>);

impl Facts {
    /// Takes note of a fact: a name, and its value as text.
    pub fn note(&self, name: &str, value: impl ToString) {
        self.0
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .insert(name.to_owned(), value.to_string());
    }

    pub(super) fn all(&self) -> BTreeMap<String, String> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

/// Everything that a recording of this run needs. Clones are cheap.
#[derive(Clone, Debug)]
pub struct Recorder {
    /// What is known of run and machine; a recording takes what is there when its first record
    /// comes.
    pub facts: Facts,
    /// The scenes of the run.
    pub scenes: Scenes,
    subscribers: RecordSubscribers,
    is_virtual: bool,
}

/// What a recording has come to.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct RecordingSummary {
    /// The file.
    pub file: PathBuf,
    /// Ticks in it; after an error those that can be read for certain.
    pub records: u64,
    /// Ticks that are missing: they found the queue full, or came after an error.
    pub dropped: u64,
    /// Why it ended early; null when it did not.
    pub error: Option<String>,
}

/// Called on the recorder's thread, at most once, with the reason why a recording ended early.
pub type FailureHandler = Box<dyn FnOnce(&RecordingError) + Send>;

#[derive(Debug, Default)]
struct Progress {
    /// What the wall clock showed at loop time zero; set by the first record before it waits for
    /// anything.
    zero_ns: OnceLock<u64>,
    records: AtomicU64,
    dropped: AtomicU64,
    error: Mutex<Option<String>>,
}

/// A recording that goes on; it ends when this goes.
#[derive(Debug)]
pub struct RecorderHandle {
    file: PathBuf,
    /// It was made for this recording.
    is_new: bool,
    progress: Arc<Progress>,
    stop: Sender<()>,
    /// Never sends: it disconnects when the thread has ended.
    ended: Receiver<()>,
}

impl Recorder {
    /// For a run whose records pass these subscribers. `is_virtual`: its time is simulated and
    /// waits for the disk, so that nothing is dropped.
    pub fn new(subscribers: RecordSubscribers, is_virtual: bool) -> Self {
        let facts = Facts::default();
        facts.note("program", concat!("hapticd ", env!("CARGO_PKG_VERSION")));
        facts.note(FORCE_LAW_KEY, haptics::FORCE_LAW);
        facts.note("begun", timestamp(SystemTime::now()));
        facts.note("clock", if is_virtual { "virtual" } else { "real" });
        Self { facts, scenes: Scenes::default(), subscribers, is_virtual }
    }

    /// The subscribers that the records pass.
    pub fn subscribers(&self) -> &RecordSubscribers {
        &self.subscribers
    }

    /// What time the messages of this run bear, from the next record on.
    pub(super) fn stamps(&self) -> super::messages::Stamps {
        super::messages::Stamps::new(self.is_virtual)
    }

    pub(super) fn create(
        &self,
        file: &Path,
        overwrites: bool,
    ) -> Result<RecordingFile, RecordingError> {
        RecordingFile::create(file, overwrites, self.is_virtual)
    }

    /// Records from the next tick on. Creates the file before it returns; one that is to be
    /// overwritten stays until the first tick.
    ///
    /// # Errors
    /// The file cannot be created, or is there already and is not to be overwritten, or there is no
    /// thread for it.
    pub fn start(
        &self,
        file: &Path,
        overwrites: bool,
        failed: FailureHandler,
    ) -> Result<RecorderHandle, RecordingError> {
        let recording = self.create(file, overwrites)?;
        let is_new = recording.is_new();
        let progress = Arc::new(Progress::default());
        let (sender, records) = bounded(QUEUE_RECORDS);
        let (stop, stops) = bounded(1);
        let (alive, ended) = bounded(1);
        let recorder = self.clone();
        let noted = progress.clone();
        let run = move || {
            let _alive = alive;
            let mut recording = recording;
            let mut is_ordered_to_stop = false;
            let result =
                recorder.run(&mut recording, (&records, &stops, &mut is_ordered_to_stop), &noted);
            let n_safe = recording.n_safe();
            let result = match result {
                Ok(()) => recording.finish(),
                Err(error) => {
                    drop(recording);
                    Err(error)
                }
            };
            if let Err(error) = result {
                let n_taken = noted.records.swap(n_safe, Ordering::Relaxed);
                let missing = |n: u64| noted.dropped.fetch_add(n, Ordering::Relaxed);
                missing(n_taken.saturating_sub(n_safe));
                *noted.error.lock().unwrap_or_else(PoisonError::into_inner) =
                    Some(error.to_string());
                failed(&error);
                // What still comes is missing too, until the caller ends the recording.
                while !is_ordered_to_stop {
                    select! {
                        recv(records) -> message => match message {
                            Ok(_) => missing(1),
                            Err(_) => break,
                        },
                        recv(stops) -> _ => {
                            is_ordered_to_stop = true;
                            0
                        }
                    };
                }
                missing(records.try_iter().count() as u64);
            }
        };
        std::thread::Builder::new()
            .name("recorder".to_owned())
            .spawn(run)
            .map_err(RecordingError::Thread)?;
        let counted = progress.clone();
        let is_virtual = self.is_virtual;
        self.subscribers.add(Box::new(move |record| {
            counted.zero_ns.get_or_init(|| zero_ns(record));
            let dropped = counted.dropped.load(Ordering::Relaxed);
            if is_virtual {
                return sender.send((*record, dropped)).is_ok();
            }
            match sender.try_send((*record, dropped)) {
                Ok(()) => true,
                Err(TrySendError::Full(_)) => {
                    counted.dropped.fetch_add(1, Ordering::Relaxed);
                    true
                }
                Err(TrySendError::Disconnected(_)) => false,
            }
        }));
        Ok(RecorderHandle { file: file.to_owned(), is_new, progress, stop, ended })
    }

    fn run(
        &self,
        file: &mut RecordingFile,
        (records, stops, is_ordered_to_stop): (
            &Receiver<(TickRecord, u64)>,
            &Receiver<()>,
            &mut bool,
        ),
        progress: &Progress,
    ) -> Result<(), RecordingError> {
        let mut before = None;
        let mut take = |file: &mut RecordingFile, (record, dropped): (TickRecord, u64)| {
            if let Some(zero_ns) = progress.zero_ns.get() {
                file.begins_at(*zero_ns);
            }
            // Also one that cannot be written: after an error all are taken off again that are not
            // in the file.
            progress.records.fetch_add(1, Ordering::Relaxed);
            self.record(file, &record, dropped, ROOM_BYTES, &mut before)
        };
        loop {
            select! {
                recv(records) -> message => match message {
                    Ok(message) => take(file, message)?,
                    Err(_) => break,
                },
                recv(stops) -> _ => {
                    *is_ordered_to_stop = true;
                    // Those that are there now: under the virtual clock more may come as fast as
                    // these go.
                    records.try_iter().take(records.len()).try_for_each(|message| take(file, message))?;
                    break;
                }
                default(IDLE) => file.flush_if_due()?,
            }
        }
        let counts = [("records", &progress.records), ("dropped", &progress.dropped)];
        let counts = counts
            .map(|(name, count)| (name.to_owned(), count.load(Ordering::Relaxed).to_string()));
        file.metadata("end", BTreeMap::from(counts))
    }

    /// One record, with what has to stand before it.
    pub(super) fn record(
        &self,
        file: &mut RecordingFile,
        record: &TickRecord,
        dropped: u64,
        room_bytes: u64,
        before: &mut Option<TickRecord>,
    ) -> Result<(), RecordingError> {
        if before.is_none() {
            file.metadata("run", self.facts.all())?;
        }
        if before.is_none_or(|before| before.scene_idx != record.scene_idx)
            && let Some(scene) = self.scene(record.scene_idx)
        {
            file.scene(&scene, record, room_bytes)?;
        }
        *before = Some(*record);
        file.record(record, dropped)
    }

    /// The thread that offers a scene adds its files here after the loop may have taken it.
    fn scene(&self, scene_idx: u32) -> Option<Arc<SceneFiles>> {
        const PAUSE: Duration = Duration::from_millis(2);
        let mut waited = Duration::ZERO;
        loop {
            let scene = self.scenes.get(scene_idx);
            if scene.is_some() || waited >= SCENE_PATIENCE {
                return scene;
            }
            std::thread::sleep(PAUSE);
            waited += PAUSE;
        }
    }
}

impl RecorderHandle {
    /// Ends a recording to which no tick came: leaves no file behind in which there is nothing, and
    /// what was there before as it was.
    pub fn abandon(self) {
        let is_new = self.is_new;
        let RecordingSummary { file, records, .. } = self.stop();
        if is_new && records == 0 {
            // What cannot be removed stays.
            let _ = fs::remove_file(file);
        }
    }

    /// What the recording has come to so far.
    pub fn status(&self) -> RecordingSummary {
        RecordingSummary {
            file: self.file.clone(),
            records: self.progress.records.load(Ordering::Relaxed),
            dropped: self.progress.dropped.load(Ordering::Relaxed),
            error: self.progress.error.lock().unwrap_or_else(PoisonError::into_inner).clone(),
        }
    }

    /// Ends the recording with what has been taken until now, and waits for the file; not for ever.
    pub fn stop(self) -> RecordingSummary {
        // A thread that has ended takes nothing.
        let _ = self.stop.try_send(());
        let hangs = self.ended.recv_timeout(FINISH_PATIENCE) == Err(RecvTimeoutError::Timeout);
        let mut summary = self.status();
        if hangs {
            summary
                .error
                .get_or_insert_with(|| RecordingError::Hangs(self.file.clone()).to_string());
        }
        summary
    }
}
