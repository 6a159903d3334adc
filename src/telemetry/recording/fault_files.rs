//! The flight recorder's files: what happened before each fault, and for a moment after it.

use std::collections::VecDeque;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, SystemTime};

use crossbeam::channel::{Receiver, Sender, bounded, unbounded};

use super::Recorder;
use super::write::RecordingError;
use crate::haptics::Faults;
use crate::rt::utc::timestamp;
use crate::telemetry::{Tap, TickRecord};

/// Ticks before a fault.
const TICKS_BEFORE: usize = 2000;
/// Ticks from the fault on.
const TICKS_AFTER: usize = 500;
/// Files that are kept.
const FILES_KEPT: usize = 20;
/// Meshes up to this size are brought along; larger ones are named.
const ROOM_BYTES: u64 = 4 << 20;
/// How long the last file may take when a run is over.
const FINISH_PATIENCE: Duration = Duration::from_secs(10);
const PREFIX: &str = "fault-";

/// One file, or why there is none.
#[derive(Debug)]
pub struct FaultFile {
    /// What happened.
    pub faults: Faults,
    /// Where it is.
    pub file: Result<PathBuf, RecordingError>,
}

/// Hears of every file, on a thread of their own.
pub type Told = Box<dyn FnMut(&FaultFile) + Send>;

/// Watches a run for faults and writes a recording of each.
#[derive(Debug)]
pub struct FaultFiles {
    incidents: Sender<Incident>,
    /// Never sends: it disconnects when everything has been written.
    ended: Receiver<()>,
    /// Faults that were handed over. Complete when the taps are closed.
    covered: Arc<Mutex<Faults>>,
}

struct Incident {
    faults: Faults,
    records: Vec<TickRecord>,
}

impl FaultFiles {
    /// Begins to watch. The folder is created with the first file.
    ///
    /// # Errors
    /// There is no thread for it.
    pub fn watch(recorder: &Recorder, folder: PathBuf, mut told: Told) -> Result<Self, RecordingError> {
        let (incidents, received) = unbounded::<Incident>();
        let (alive, ended) = bounded(1);
        let covered = Arc::new(Mutex::new(Faults::NONE));
        let writer = recorder.clone();
        let run = move || {
            let _alive = alive;
            for Incident { faults, records } in received {
                told(&FaultFile { faults, file: write(&writer, &folder, faults, &records) });
            }
        };
        std::thread::Builder::new().name("fault-files".to_owned()).spawn(run).map_err(RecordingError::Thread)?;
        recorder.taps().add(tap(incidents.clone(), covered.clone()));
        Ok(Self { incidents, ended, covered })
    }

    /// When the run is over: writes what the loop itself has kept, if it ended by something that no record shows, and waits for the files.
    pub fn finish<'r>(self, faults: Faults, kept: impl Iterator<Item = &'r TickRecord>) {
        let Self { incidents, ended, covered } = self;
        let covered = *covered.lock().unwrap_or_else(PoisonError::into_inner);
        if !covered.contains(faults) {
            // The writer outlives this sender.
            let _ = incidents.send(Incident { faults, records: kept.copied().collect() });
        }
        drop(incidents);
        let _ = ended.recv_timeout(FINISH_PATIENCE);
    }
}

/// A ring of the last records that is handed over some time after a fault appeared, or when the run is over before.
struct Watch {
    ring: VecDeque<TickRecord>,
    pending: Option<(Faults, usize)>,
    had_faults: bool,
    incidents: Sender<Incident>,
    covered: Arc<Mutex<Faults>>,
}

fn tap(incidents: Sender<Incident>, covered: Arc<Mutex<Faults>>) -> Tap {
    let ring = VecDeque::with_capacity(TICKS_BEFORE + TICKS_AFTER);
    let mut watch = Watch { ring, pending: None, had_faults: false, incidents, covered };
    Box::new(move |record| {
        watch.take(record);
        true
    })
}

impl Watch {
    fn take(&mut self, record: &TickRecord) {
        let has_faults = !record.output.faults.is_empty();
        if has_faults && !self.had_faults && self.pending.is_none() {
            self.pending = Some((Faults::NONE, TICKS_AFTER));
        }
        self.had_faults = has_faults;
        if self.pending.is_none() && self.ring.len() >= TICKS_BEFORE {
            self.ring.pop_front();
        }
        self.ring.push_back(*record);
        if let Some((faults, left)) = &mut self.pending {
            *faults |= record.output.faults;
            *left -= 1;
            if *left == 0 {
                self.hand_over();
            }
        }
    }

    fn hand_over(&mut self) {
        if let Some((faults, _)) = self.pending.take() {
            *self.covered.lock().unwrap_or_else(PoisonError::into_inner) |= faults;
            // A writer that has gone writes nothing.
            let _ = self.incidents.send(Incident { faults, records: self.ring.iter().copied().collect() });
            // What follows another fault may begin in this one.
            let surplus = self.ring.len().saturating_sub(TICKS_BEFORE);
            self.ring.drain(..surplus);
        }
    }
}

impl Drop for Watch {
    fn drop(&mut self) {
        self.hand_over();
    }
}

fn write(recorder: &Recorder, folder: &Path, faults: Faults, records: &[TickRecord]) -> Result<PathBuf, RecordingError> {
    let create = |source| RecordingError::Create { file: folder.to_owned(), source };
    fs::create_dir_all(folder).map_err(create)?;
    let cause = faults.names().next().unwrap_or("unknown");
    let path = folder.join(format!("{PREFIX}{}-{}-{cause}.mcap", now(), std::process::id()));
    let mut file = recorder.create(&path, false)?;
    let mut before = None;
    for record in records {
        recorder.record(&mut file, record, 0, ROOM_BYTES, &mut before)?;
    }
    let named = faults.names().collect::<Vec<_>>().join(", ");
    file.metadata("fault", [("faults".to_owned(), named)].into())?;
    file.finish()?;
    keep_newest(folder);
    Ok(path)
}

/// Removes the oldest of our files. What cannot be removed stays.
fn keep_newest(folder: &Path) {
    let entries = fs::read_dir(folder).into_iter().flatten().filter_map(Result::ok).map(|entry| entry.path());
    let is_ours = |path: &PathBuf| {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        name.starts_with(PREFIX) && name.ends_with(".mcap")
    };
    // Names begin with the time.
    let mut files: Vec<PathBuf> = entries.filter(is_ours).collect();
    files.sort();
    let n_surplus = files.len().saturating_sub(FILES_KEPT);
    for file in files.iter().take(n_surplus) {
        let _ = fs::remove_file(file);
    }
}

/// The time of day for a file's name, UTC; sorts by time.
pub fn now() -> String {
    utc(SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default())
}

/// `20261122T080511.123Z`: sorts by time.
fn utc(since_1970: Duration) -> String {
    timestamp(SystemTime::UNIX_EPOCH + since_1970).replace(['-', ':'], "")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::haptics::TickOutput;
    use crate::telemetry::{Taps, drain};

    #[test]
    fn a_time_is_written_as_others_do() {
        for (seconds, text) in [
            (0, "19700101T000000.007Z"),
            (951_782_399, "20000228T235959.007Z"),
            (951_782_400, "20000229T000000.007Z"),
            (4_107_542_399, "21000228T235959.007Z"),
            (4_107_542_400, "21000301T000000.007Z"),
            (1_795_334_711, "20261122T080511.007Z"),
        ] {
            assert_eq!(utc(Duration::from_secs(seconds) + Duration::from_millis(7)), text);
        }
    }

    fn feed(tap: &mut Tap, ticks: core::ops::Range<u64>, faults: Faults) {
        for tick in ticks {
            let output = TickOutput { faults, ..TickOutput::default() };
            assert!(tap(&TickRecord { tick, output, ..TickRecord::default() }));
        }
    }

    #[test]
    fn every_fault_is_handed_over_with_what_was_before_and_after() {
        let (incidents, received) = unbounded();
        let mut tap = tap(incidents, Arc::default());
        feed(&mut tap, 0..5000, Faults::NONE);
        feed(&mut tap, 5000..5700, Faults::STALE);
        feed(&mut tap, 5700..5800, Faults::NONE);
        feed(&mut tap, 5800..5810, Faults::POWER);
        drop(tap);
        let told: Vec<_> = received
            .iter()
            .map(|Incident { faults, records }| (faults, records.first().map(|r| r.tick), records.last().map(|r| r.tick)))
            .collect();
        assert_eq!(told, [(Faults::STALE, Some(3000), Some(5499)), (Faults::POWER, Some(3800), Some(5809))]);
    }

    #[test]
    fn a_fault_that_no_record_shows_is_written_from_what_the_loop_kept() {
        let folder = tempfile::tempdir().expect("a folder");
        let recorder = Recorder::new(Taps::default(), false);
        let (told, heard) = std::sync::mpsc::channel();
        let watch = || {
            let told = told.clone();
            let told = move |file: &FaultFile| told.send((file.faults, file.file.is_ok())).expect("heard");
            FaultFiles::watch(&recorder, folder.path().join("faults"), Box::new(told)).expect("a thread")
        };
        let kept: Vec<TickRecord> = (0..3).map(|tick| TickRecord { tick, ..TickRecord::default() }).collect();
        // The run is over: its taps are gone.
        let files = watch();
        let (producer, consumer) = rtrb::RingBuffer::new(1);
        drop(producer);
        drain(consumer, recorder.taps(), |_| ());
        files.finish(Faults::PANIC, kept.iter());
        assert_eq!(heard.try_iter().collect::<Vec<_>>(), [(Faults::PANIC, true)]);
        watch().finish(Faults::NONE, kept.iter());
        assert!(heard.try_recv().is_err());
    }

    #[test]
    fn the_oldest_of_our_files_go() {
        let folder = tempfile::tempdir().expect("a folder");
        for n in 0..25 {
            fs::write(folder.path().join(format!("{PREFIX}2026112{n:02}-stale.mcap")), b"").expect("written");
        }
        fs::write(folder.path().join("a-notes.mcap"), b"").expect("written");
        keep_newest(folder.path());
        let mut left: Vec<String> = fs::read_dir(folder.path())
            .expect("a folder")
            .map(|entry| entry.expect("an entry").file_name().to_string_lossy().into_owned())
            .collect();
        left.sort();
        assert_eq!(left.len(), FILES_KEPT + 1);
        assert_eq!(left[..2], ["a-notes.mcap".to_owned(), format!("{PREFIX}202611205-stale.mcap")]);
    }
}
