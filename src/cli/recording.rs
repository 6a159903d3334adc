//! `run --record` and `--flight`: what a run leaves on the disk.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::error::CliError;
use super::{OutputOptions, destination, lab_report, output, report};
use crate::config::{LoadOptions, SceneConfig};
use crate::daemon::scene_files;
use crate::error::Exit;
use crate::monitor::{self, MadeRecording, RecorderError, RecorderStatus};
use engine::servo::LoopReport;
use recording::RecordSubscribers;
use recording::file::{
    FailureHandler, FaultFile, FaultFiles, Recorder, RecorderHandle, RecordingError,
    RecordingSummary, now,
};
use rt::clock::ClockKind;
use rt::preflight::PreflightReport;
use vps::storage::printable::shown;

/// Arguments that leave recordings behind.
#[derive(Debug, clap::Args)]
pub(crate) struct RecordingArgs {
    /// Record every tick into an MCAP file: `hapticd replay` runs it again, `hapticd report` makes
    /// a page of it, Foxglove opens it, and `python -m hapticd.rerun` makes a file for Rerun of it.
    #[arg(long, value_name = "FILE.mcap")]
    record: Option<PathBuf>,
    /// Folder for a recording of the ticks around each fault, or `off` [default:
    /// $XDG_STATE_HOME/hapticd/faults, or ~/.local/state/hapticd/faults; under --clock virtual:
    /// off].
    #[arg(long, value_name = "DIR|off")]
    flight: Option<PathBuf>,
}

impl RecordingArgs {
    /// The file of --record.
    pub(super) fn file(&self) -> Option<&Path> {
        self.record.as_deref()
    }

    /// Creates the file of --record, so that a folder that cannot be written to is an error before
    /// anything is baked, and watches for faults.
    pub(crate) fn begin(
        &self,
        config: &SceneConfig,
        options: &LoadOptions,
        overwrite: bool,
        clock: ClockKind,
        subscribers: RecordSubscribers,
        output: OutputOptions,
    ) -> Result<Recordings, CliError> {
        let recorder = Recorder::new(subscribers, clock == ClockKind::Virtual);
        recorder.facts.note("rate_hz", config.rate_hz);
        recorder.facts.note("device", &config.device.profile.name);
        recorder.facts.note("processor", processor());
        recorder.scenes.add(scene_files(config, options));
        let refused = |error: RecordingError| {
            let (exit, hint) = match &error {
                RecordingError::Exists(_) => {
                    (Exit::Usage, Some("name another file, or give --overwrite"))
                }
                RecordingError::Create { source, .. } => (Exit::Asset, destination::hint(source)),
                RecordingError::Thread(_) => (Exit::Internal, None),
                _ => (Exit::Asset, None),
            };
            CliError::new(exit, format_args!("--record: {error}")).hint(hint)
        };
        let recording =
            self.record.as_ref().map(|file| recorder.start(file, overwrite, failed(output)));
        let recording = recording.transpose().map_err(refused)?;
        let fault_files = self.fault_folder(clock).map(|folder| {
            let reported = move |file: &FaultFile| match &file.file {
                Ok(path) if !output.quiet => {
                    output::message(format_args!("flight recorder: {}\n", shown(path)))
                }
                Ok(_) => {}
                Err(error) => report::warning(&format!("flight recorder: {error}"), output),
            };
            FaultFiles::watch(&recorder, folder, Box::new(reported))
        });
        let fault_files = fault_files.transpose().map_err(refused)?;
        let session = Arc::new(Session::of(recording));
        Ok(Recordings { recorder, session, fault_files })
    }

    /// Where recordings of faults go; simulated time can be had again, so there they are written
    /// only if asked for.
    fn fault_folder(&self, clock: ClockKind) -> Option<PathBuf> {
        match &self.flight {
            Some(folder) if folder.as_os_str() == "off" => None,
            Some(folder) => Some(folder.clone()),
            None if clock == ClockKind::Virtual => None,
            None => state_folder().map(|state| state.join("faults")),
        }
    }
}

/// As the XDG base directory specification has it: relative paths are ignored.
pub(super) fn state_folder() -> Option<PathBuf> {
    let folder =
        |variable| std::env::var_os(variable).map(PathBuf::from).filter(|path| path.is_absolute());
    folder("XDG_STATE_HOME")
        .or_else(|| Some(folder("HOME")?.join(".local/state")))
        .map(|state| state.join("hapticd"))
}

/// What is being recorded.
pub(crate) struct Recordings {
    pub(crate) recorder: Recorder,
    session: Arc<Session>,
    fault_files: Option<FaultFiles>,
}

/// At most one recording at a time, and what the last one came to.
#[derive(Default)]
struct Session {
    /// Held while a recording begins or ends, for as long as a disk takes for it.
    turn: Mutex<()>,
    /// Held to look, to put and to take: the thread that serves every client reads its state.
    now: Mutex<Now>,
}

#[derive(Default)]
struct Now {
    recording: Option<RecorderHandle>,
    /// How many were begun.
    begun: u32,
    /// Those that have ended, oldest first.
    ended: Vec<(u32, RecordingSummary)>,
}

/// Recordings that have ended and are remembered: a client may begin and end one after the other.
const MOST_ENDED: usize = 256;

impl Now {
    fn begin(&mut self, recording: RecorderHandle) {
        self.recording = Some(recording);
        self.begun += 1;
    }

    fn end(&mut self, summary: RecordingSummary) {
        if self.ended.len() == MOST_ENDED {
            self.ended.remove(0);
        }
        self.ended.push((self.begun, summary));
    }
}

impl Session {
    fn of(recording: Option<RecorderHandle>) -> Self {
        let mut now = Now::default();
        recording.into_iter().for_each(|recording| now.begin(recording));
        Self { turn: Mutex::default(), now: Mutex::new(now) }
    }

    fn turn(&self) -> MutexGuard<'_, ()> {
        self.turn.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn now(&self) -> MutexGuard<'_, Now> {
        self.now.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn take(&self) -> Option<RecorderHandle> {
        self.now().recording.take()
    }
}

impl Recordings {
    /// For clients, which may begin and end recordings too.
    pub(crate) fn for_clients(&self, output: OutputOptions) -> ClientRecordings {
        ClientRecordings { recorder: self.recorder.clone(), session: self.session.clone(), output }
    }

    /// After the last tick: ends the files. What the last recording came to.
    pub(crate) fn end(mut self, last: &LoopReport) -> Option<RecordingSummary> {
        if let Some(fault_files) = self.fault_files.take() {
            fault_files.finish(last.faults, last.flight.records());
        }
        let _turn = self.session.turn();
        let recording = self.session.take();
        recording
            .map(RecorderHandle::stop)
            .or_else(|| self.session.now().ended.pop().map(|(_, last)| last))
    }
}

/// Where nothing was rendered no empty file stays.
impl Drop for Recordings {
    fn drop(&mut self) {
        let _turn = self.session.turn();
        if let Some(recording) = self.session.take() {
            recording.abandon();
        }
    }
}

/// Recordings that clients of the monitor begin and end.
pub(crate) struct ClientRecordings {
    recorder: Recorder,
    session: Arc<Session>,
    output: OutputOptions,
}

impl monitor::RecordingControl for ClientRecordings {
    /// Into a folder of our own, never over a file that is there: a client that may watch a run
    /// must not write to any place.
    fn start(&self, file: Option<&str>) -> Result<RecorderStatus, RecorderError> {
        let _turn = self.session.turn();
        if let Some(RecorderStatus { file, .. }) = self.status() {
            return Err(RecorderError::State(format!(
                "a recording is under way into {}",
                file.display()
            )));
        }
        let refused = |message: String| RecorderError::File(message);
        let chosen = file.map_or_else(|| format!("session-{}", now()), str::to_owned);
        let name = monitor::plain_name(&chosen, ".mcap").map_err(|accepted| {
            refused(format!("a recording takes {accepted}, such as session.mcap"))
        })?;
        let folder = state_folder()
            .ok_or_else(|| refused("neither XDG_STATE_HOME nor HOME names a folder".to_owned()))?;
        let folder = folder.join("recordings");
        fs::create_dir_all(&folder)
            .map_err(|error| refused(format!("cannot create {}: {error}", folder.display())))?;
        let file = folder.join(name);
        let started =
            self.recorder.start(&file, false, failed(self.output)).map_err(
                |error| match error {
                    RecordingError::Exists(_) => RecorderError::State(error.to_string()),
                    error => refused(error.to_string()),
                },
            )?;
        self.session.now().begin(started);
        Ok(RecorderStatus { file, records: 0, dropped: 0 })
    }

    fn stop(&self) -> Result<RecorderStatus, RecorderError> {
        let _turn = self.session.turn();
        let recording = self
            .session
            .take()
            .ok_or_else(|| RecorderError::State("nothing is being recorded".to_owned()))?;
        let summary = recording.stop();
        let status = status_of(summary.clone());
        self.session.now().end(summary);
        Ok(status)
    }

    fn status(&self) -> Option<RecorderStatus> {
        let status = self.session.now().recording.as_ref()?.status();
        status.error.is_none().then(|| status_of(status))
    }

    fn made(&self) -> Vec<MadeRecording> {
        let now = self.session.now();
        let ended = now.ended.iter().map(|(number, summary)| (*number, false, summary.clone()));
        let under_way =
            now.recording.as_ref().map(|recording| (now.begun, true, recording.status()));
        let made = |(number, is_under_way, summary)| MadeRecording {
            number,
            is_under_way,
            status: status_of(summary),
        };
        ended.chain(under_way).map(made).collect()
    }

    fn report(&self, file: &Path) -> Result<String, RecorderError> {
        let page = lab_report::of_recording(file)
            .map_err(|error| RecorderError::File(error.to_string()))?;
        match page.ticks() {
            0 => Err(RecorderError::File(format!("{} ends before its first tick", file.display()))),
            _ => Ok(page.page()),
        }
    }
}

fn status_of(RecordingSummary { file, records, dropped, .. }: RecordingSummary) -> RecorderStatus {
    RecorderStatus { file, records, dropped }
}

fn failed(output: OutputOptions) -> FailureHandler {
    Box::new(move |error| {
        report::warning(&format!("recording ended early: {error}; the run goes on"), output)
    })
}

/// What a C library chooses its mathematics by: another choice may round the last bit otherwise.
fn processor() -> String {
    #[cfg(target_arch = "x86_64")]
    let features = [
        ("fma", std::is_x86_feature_detected!("fma")),
        ("avx2", std::is_x86_feature_detected!("avx2")),
    ];
    #[cfg(not(target_arch = "x86_64"))]
    let features: [(&str, bool); 0] = [];
    let has = features.into_iter().filter(|(_, has)| *has).map(|(name, _)| name);
    std::iter::once(std::env::consts::ARCH).chain(has).collect::<Vec<_>>().join(" ")
}

/// What the machine offers, for readers of the recording.
pub(crate) fn note_machine(recorder: &Recorder, machine: &PreflightReport) {
    for check in &machine.rows {
        recorder.facts.note(
            &format!("machine.{}", check.name),
            format!("{}: {}", check.outcome.name(), check.found),
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::When;
    use crate::cli::output::LogFormat;
    use crate::monitor::RecordingControl as _;
    use recording::file::SceneFiles;
    use recording::{TickRecord, drain};

    const QUIET: OutputOptions =
        OutputOptions { verbose: 0, quiet: true, color: When::Never, log_format: LogFormat::Text };

    #[test]
    fn how_a_recording_goes_is_known_while_a_disk_keeps_its_end_waiting() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("pipe.mcap");
        rustix::fs::mkfifoat(rustix::fs::CWD, &path, rustix::fs::Mode::RWXU).expect("a pipe");
        // Opened by a reader that does not read: the pipe takes 64 KiB and no more.
        let reader = fs::OpenOptions::new().read(true).write(true).open(&path).expect("opened");
        let recorder = Recorder::new(RecordSubscribers::default(), false);
        recorder
            .scenes
            .add(SceneFiles { toml: "# long\n".repeat(1 << 16), ..SceneFiles::default() });
        let recording = recorder.start(&path, true, Box::new(|_| ())).expect("started");
        let (mut producer, records) = rtrb::RingBuffer::new(1);
        producer.push(TickRecord::default()).expect("room");
        drop(producer);
        drain(records, recorder.subscribers(), |_| ());
        let session = Arc::new(Session::of(Some(recording)));
        let clients = || ClientRecordings {
            recorder: recorder.clone(),
            session: session.clone(),
            output: QUIET,
        };
        assert_eq!(clients().status().map(|status| status.file), Some(path));
        let stopping = clients();
        let stopped = std::thread::spawn(move || stopping.stop());
        while clients().status().is_some() {
            std::thread::yield_now();
        }
        assert!(!stopped.is_finished(), "the caller waited for the disk");
        drop(reader);
        assert!(stopped.join().expect("no panic").is_ok());
        assert!(
            session
                .now()
                .ended
                .last()
                .is_some_and(|(number, last)| *number == 1 && last.error.is_some())
        );
        let made: Vec<_> =
            clients().made().into_iter().map(|made| (made.number, made.is_under_way)).collect();
        assert_eq!(made, [(1, false)]);
    }
}
