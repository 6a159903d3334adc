//! The flight recorder's files: what happened before each fault, and for a moment after it.

use std::collections::VecDeque;
use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, SystemTime};

use crossbeam::channel::{Receiver, Sender, bounded, unbounded};

use super::Recorder;
use super::messages::zero_ns;
use super::write::{RecordingError, RecordingFile};
use crate::{Subscriber, TickRecord};
use haptics::Faults;
use rt::utc::timestamp;

/// Ticks before a fault: two seconds at 1 kHz.
const TICKS_BEFORE: usize = 2000;
/// Ticks from the fault on.
const TICKS_AFTER: usize = 500;
/// Files that are kept.
const FILES_KEPT: usize = 20;
/// Files of a scene that are brought along, bytes in all; what does not fit is named.
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

/// Called with every file, on a thread of their own.
pub type FaultFileHandler = Box<dyn FnMut(&FaultFile) + Send>;

/// Watches a run for faults and writes a recording of each.
#[derive(Debug)]
pub struct FaultFiles {
    incidents: Sender<Incident>,
    /// Never sends: it disconnects when everything has been written.
    ended: Receiver<()>,
    /// Complete when the subscribers are closed.
    left: Arc<Mutex<Left>>,
}

/// What the subscriber leaves behind.
#[derive(Debug, Default)]
struct Left {
    /// Faults that were handed over.
    covered: Faults,
    /// The last ticks of the run.
    records: Vec<TickRecord>,
    /// What the wall clock showed at loop time zero, as of the last tick.
    zero_ns: Option<u64>,
}

struct Incident {
    faults: Faults,
    records: Vec<TickRecord>,
    /// What the wall clock showed at loop time zero.
    zero_ns: Option<u64>,
}

impl FaultFiles {
    /// Begins to watch. The folder is created with the first file.
    ///
    /// # Errors
    /// There is no thread for it.
    pub fn watch(
        recorder: &Recorder,
        folder: PathBuf,
        mut handler: FaultFileHandler,
    ) -> Result<Self, RecordingError> {
        let (incidents, received) = unbounded::<Incident>();
        let (alive, ended) = bounded(1);
        let left = Arc::new(Mutex::new(Left::default()));
        let writer = recorder.clone();
        let run = move || {
            let _alive = alive;
            for incident in received {
                let file = write(&writer, &folder, &incident);
                keep_newest(&folder);
                handler(&FaultFile { faults: incident.faults, file });
            }
        };
        std::thread::Builder::new()
            .name("fault-files".to_owned())
            .spawn(run)
            .map_err(RecordingError::Thread)?;
        recorder.subscribers().add(subscriber(incidents.clone(), left.clone()));
        Ok(Self { incidents, ended, left })
    }

    /// When the run is over: if something came that no record shows, such as a panic, writes the
    /// last ticks; or what the loop itself has `kept` at its first fault, where that was the one
    /// and has gone from the last ticks. Waits for the files.
    pub fn finish<'r>(self, faults: Faults, kept: impl Iterator<Item = &'r TickRecord>) {
        let Self { incidents, ended, left } = self;
        let Left { covered, records, zero_ns } =
            core::mem::take(&mut *left.lock().unwrap_or_else(PoisonError::into_inner));
        let uncovered = faults.without(covered);
        if !uncovered.is_empty() {
            let kept: Vec<TickRecord> = kept.copied().collect();
            let is_earlier = kept
                .last()
                .is_some_and(|kept| records.first().is_none_or(|first| kept.tick < first.tick));
            let records = if covered.is_empty() && is_earlier { kept } else { records };
            // The writer outlives this sender.
            let _ = incidents.send(Incident { faults: uncovered, records, zero_ns });
        }
        drop(incidents);
        let _ = ended.recv_timeout(FINISH_PATIENCE);
    }
}

/// A ring of the last records that is handed over some time after a fault appeared, or when the run
/// is over before.
struct Watch {
    ring: VecDeque<TickRecord>,
    pending: Option<(Faults, usize)>,
    had_faults: bool,
    incidents: Sender<Incident>,
    left: Arc<Mutex<Left>>,
}

fn subscriber(incidents: Sender<Incident>, left: Arc<Mutex<Left>>) -> Subscriber {
    let ring = VecDeque::with_capacity(TICKS_BEFORE + TICKS_AFTER);
    let mut watch = Watch { ring, pending: None, had_faults: false, incidents, left };
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

    /// What the wall clock showed at loop time zero: the last record has come just now.
    fn zero_ns(&self) -> Option<u64> {
        self.ring.back().map(zero_ns)
    }

    fn hand_over(&mut self) {
        if let Some((faults, _)) = self.pending.take() {
            self.left.lock().unwrap_or_else(PoisonError::into_inner).covered |= faults;
            // A writer that has gone writes nothing.
            let records = self.ring.iter().copied().collect();
            let _ = self.incidents.send(Incident { faults, records, zero_ns: self.zero_ns() });
            // What follows another fault may begin in this one.
            let surplus = self.ring.len().saturating_sub(TICKS_BEFORE);
            self.ring.drain(..surplus);
        }
    }
}

impl Drop for Watch {
    fn drop(&mut self) {
        self.hand_over();
        let mut left = self.left.lock().unwrap_or_else(PoisonError::into_inner);
        left.zero_ns = self.zero_ns();
        left.records = self.ring.drain(..).collect();
    }
}

/// Writes one file; of one that could not be finished nothing stays.
fn write(
    recorder: &Recorder,
    folder: &Path,
    incident: &Incident,
) -> Result<PathBuf, RecordingError> {
    let create = |source| RecordingError::Create { file: folder.to_owned(), source };
    fs::create_dir_all(folder).map_err(create)?;
    let cause = incident.faults.names().next().unwrap_or("unknown");
    let path = folder.join(format!("{PREFIX}{}-{}-{cause}.mcap", now(), std::process::id()));
    let file = recorder.create(&path, false)?;
    fill(recorder, file, incident).inspect_err(|_| {
        // What cannot be removed stays.
        let _ = fs::remove_file(&path);
    })?;
    Ok(path)
}

fn fill(
    recorder: &Recorder,
    mut file: RecordingFile,
    incident: &Incident,
) -> Result<(), RecordingError> {
    if let Some(zero_ns) = incident.zero_ns {
        file.begins_at(zero_ns);
    }
    let mut before = None;
    for record in &incident.records {
        recorder.record(&mut file, record, 0, ROOM_BYTES, &mut before)?;
    }
    let named = incident.faults.names().collect::<Vec<_>>().join(", ");
    file.metadata("fault", [("faults".to_owned(), named)].into())?;
    file.finish()
}

/// Removes the oldest of our files. What cannot be removed stays.
fn keep_newest(folder: &Path) {
    let entries =
        fs::read_dir(folder).into_iter().flatten().filter_map(Result::ok).map(|entry| entry.path());
    // Names begin with the time.
    let mut files: Vec<PathBuf> = entries
        .filter(|path| path.file_name().and_then(OsStr::to_str).is_some_and(is_ours))
        .collect();
    files.sort();
    let n_surplus = files.len().saturating_sub(FILES_KEPT);
    for file in files.iter().take(n_surplus) {
        let _ = fs::remove_file(file);
    }
}

/// A name that [`write`] gives: time, process, fault.
fn is_ours(name: &str) -> bool {
    let inner =
        name.strip_prefix(PREFIX).and_then(|name| name.strip_suffix(".mcap")).unwrap_or_default();
    let mut parts = inner.splitn(3, '-');
    let time = parts.next().unwrap_or_default();
    let process = parts.next().unwrap_or_default();
    let is_number = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    let is_time = time.len() == now().len()
        && time.ends_with('Z')
        && is_number(&time.replace(['T', '.', 'Z'], ""));
    is_time && is_number(process) && parts.next().is_some_and(|cause| !cause.is_empty())
}

/// The time of day for a file's name, UTC: `20261122T080511.123Z`, which sorts by time.
pub fn now() -> String {
    timestamp(SystemTime::now()).replace(['-', ':'], "")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::file::SceneFiles;
    use crate::{RecordSubscribers, drain};
    use haptics::TickOutput;

    fn feed(subscriber: &mut Subscriber, ticks: core::ops::Range<u64>, faults: Faults) {
        for tick in ticks {
            let output = TickOutput { faults, ..TickOutput::default() };
            assert!(subscriber(&TickRecord { tick, output, ..TickRecord::default() }));
        }
    }

    #[test]
    fn every_fault_is_handed_over_with_what_was_before_and_after() {
        let (incidents, received) = unbounded();
        let mut subscriber = subscriber(incidents, Arc::default());
        feed(&mut subscriber, 0..5000, Faults::NONE);
        feed(&mut subscriber, 5000..5700, Faults::STALE);
        feed(&mut subscriber, 5700..5800, Faults::NONE);
        feed(&mut subscriber, 5800..5810, Faults::POWER);
        drop(subscriber);
        let written: Vec<_> = received
            .iter()
            .map(|Incident { faults, records, .. }| {
                (faults, records.first().map(|r| r.tick), records.last().map(|r| r.tick))
            })
            .collect();
        assert_eq!(
            written,
            [(Faults::STALE, Some(3000), Some(5499)), (Faults::POWER, Some(3800), Some(5809))]
        );
    }

    /// Runs ticks of these faults through a watch, and finishes it: which ticks are in the last
    /// file, and of what.
    fn finished(
        ticks: u64,
        acknowledged: Faults,
        faults: Faults,
        kept: core::ops::Range<u64>,
    ) -> (Faults, [u64; 2]) {
        let (incidents, received) = unbounded();
        let (left, (alive, ended)) = (Arc::default(), bounded(1));
        let mut subscriber = subscriber(incidents.clone(), Arc::clone(&left));
        feed(&mut subscriber, 0..100, acknowledged);
        feed(&mut subscriber, 100..ticks, Faults::NONE);
        drop((subscriber, alive));
        let kept: Vec<TickRecord> =
            kept.map(|tick| TickRecord { tick, ..TickRecord::default() }).collect();
        FaultFiles { incidents, ended, left }.finish(faults, kept.iter());
        let Incident { faults, records, .. } = received.iter().last().expect("an incident");
        (faults, [&records[0], &records[records.len() - 1]].map(|record| record.tick))
    }

    #[test]
    fn what_no_record_shows_is_written_with_the_ticks_before_it() {
        let both = Faults::STALE | Faults::PANIC;
        // An hour after a fault that was acknowledged and has its file: not the ticks before that
        // one.
        assert_eq!(finished(9000, Faults::STALE, both, 0..100), (Faults::PANIC, [7000, 8999]));
        assert_eq!(
            finished(9000, Faults::NONE, Faults::PANIC, 8000..9000),
            (Faults::PANIC, [7000, 8999])
        );
        // The driver's own, with a loop that went on.
        assert_eq!(
            finished(9000, Faults::NONE, Faults::NON_FINITE, 0..1000),
            (Faults::NON_FINITE, [0, 999])
        );
    }

    #[test]
    fn what_is_written_late_has_the_time_at_which_it_came() {
        let folder = tempfile::tempdir().expect("a folder");
        let recorder = Recorder::new(RecordSubscribers::default(), false);
        recorder.scenes.add(SceneFiles::default());
        let handler = Box::new(|file: &FaultFile| assert!(file.file.is_ok()));
        let files =
            FaultFiles::watch(&recorder, folder.path().to_owned(), handler).expect("a thread");
        let (mut producer, consumer) = rtrb::RingBuffer::new(4000);
        for tick in 0..4000 {
            let faults = if tick < 3000 { Faults::NONE } else { Faults::STALE };
            let output = TickOutput { faults, ..TickOutput::default() };
            producer
                .push(TickRecord {
                    tick,
                    time_ns: tick as i64 * 1_000_000,
                    output,
                    ..TickRecord::default()
                })
                .expect("room");
        }
        drop(producer);
        drain(consumer, recorder.subscribers(), |_| ());
        files.finish(Faults::STALE, [].iter());
        let after = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).expect("after 1970");
        let file = fs::read_dir(folder.path())
            .expect("a folder")
            .next()
            .expect("a file")
            .expect("an entry")
            .path();
        let bytes = fs::read(file).expect("bytes");
        let stamps: Vec<u64> = mcap::MessageStream::new(&bytes)
            .expect("mcap")
            .map(|message| message.expect("sound").log_time)
            .collect();
        let last = stamps.iter().max().expect("messages");
        assert!(
            u128::from(*last) <= after.as_nanos(),
            "{} ms in the future",
            (u128::from(*last) - after.as_nanos()) / 1_000_000
        );
    }

    #[test]
    fn a_fault_that_no_record_shows_is_written_from_what_the_loop_kept() {
        let folder = tempfile::tempdir().expect("a folder");
        let recorder = Recorder::new(RecordSubscribers::default(), false);
        let (sender, heard) = std::sync::mpsc::channel();
        let watch = || {
            let sender = sender.clone();
            let handler = move |file: &FaultFile| {
                sender.send((file.faults, file.file.is_ok())).expect("heard")
            };
            FaultFiles::watch(&recorder, folder.path().join("faults"), Box::new(handler))
                .expect("a thread")
        };
        let kept: Vec<TickRecord> =
            (0..3).map(|tick| TickRecord { tick, ..TickRecord::default() }).collect();
        // The run is over: its subscribers are gone.
        let files = watch();
        let (producer, consumer) = rtrb::RingBuffer::new(1);
        drop(producer);
        drain(consumer, recorder.subscribers(), |_| ());
        files.finish(Faults::PANIC, kept.iter());
        assert_eq!(heard.try_iter().collect::<Vec<_>>(), [(Faults::PANIC, true)]);
        watch().finish(Faults::NONE, kept.iter());
        assert!(heard.try_recv().is_err());
    }

    #[test]
    fn the_oldest_of_our_files_go() {
        let folder = tempfile::tempdir().expect("a folder");
        for n in 0..25 {
            fs::write(
                folder.path().join(format!("{PREFIX}20261122T0805{n:02}.123Z-42-device-lost.mcap")),
                b"",
            )
            .expect("written");
        }
        let others = [
            "a-notes.mcap",
            "fault-first-try.mcap",
            "fault-20261122-stale.mcap",
            "fault-20261122T080511.123Z-me-stale.mcap",
        ];
        others.iter().for_each(|other| fs::write(folder.path().join(other), b"").expect("written"));
        keep_newest(folder.path());
        let mut left: Vec<String> = fs::read_dir(folder.path())
            .expect("a folder")
            .map(|entry| entry.expect("an entry").file_name().to_string_lossy().into_owned())
            .collect();
        left.sort();
        assert_eq!(left.len(), FILES_KEPT + others.len());
        assert!(others.iter().all(|other| left.iter().any(|left| left == other)), "{left:?}");
        assert!(
            left.contains(&format!("{PREFIX}20261122T080505.123Z-42-device-lost.mcap")),
            "{left:?}"
        );
    }
}
