//! `run --record` and `--flight`: what a run leaves on the disk.

use std::fs;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::{Talk, report, say};
use crate::config::{LoadOptions, SceneConfig};
use crate::daemon::scene_files;
use crate::error::Exit;
use crate::monitor::{self, RecorderError, RecorderStatus};
use crate::rt::clock::ClockKind;
use crate::rt::preflight::Report;
use crate::servo::LoopReport;
use crate::telemetry::Taps;
use crate::telemetry::recording::{Failed, FaultFile, FaultFiles, Recorder, RecorderHandle, RecordingError, RecordingSummary, now};

/// Arguments that leave recordings behind.
#[derive(Debug, clap::Args)]
pub(crate) struct RecordingArgs {
    /// Record every tick into an MCAP file: `hapticd replay` runs it again, `hapticd report` makes a page of it, Foxglove and Rerun show it.
    #[arg(long, value_name = "FILE.mcap")]
    record: Option<PathBuf>,
    /// Let --record write over a file that is there already.
    #[arg(long, requires = "record")]
    overwrite: bool,
    /// Folder for a recording of the seconds around each fault, or `off` [default: $XDG_STATE_HOME/hapticd/faults, or
    /// ~/.local/state/hapticd/faults; under --clock virtual: off].
    #[arg(long, value_name = "DIR|off")]
    flight: Option<PathBuf>,
}

impl RecordingArgs {
    /// Creates the file of --record, so that a folder that cannot be written to is told before anything is baked, and watches for faults.
    pub(crate) fn begin(
        &self,
        config: &SceneConfig,
        options: &LoadOptions,
        clock: ClockKind,
        taps: Taps,
        talk: Talk,
    ) -> Result<Recordings, Exit> {
        let recorder = Recorder::new(taps, clock == ClockKind::Virtual);
        recorder.facts.note("rate_hz", config.rate_hz);
        recorder.facts.note("device", &config.device.profile.name);
        recorder.scenes.add(scene_files(config, options));
        let refused = |error: RecordingError| {
            let hint = match &error {
                RecordingError::Exists(_) => Some("name another file, or give --overwrite"),
                RecordingError::Create { .. } => Some("--record takes a file in a folder that can be written to"),
                _ => None,
            };
            report::error(&format!("--record: {error}"), hint, talk);
            if matches!(error, RecordingError::Thread(_)) { Exit::Internal } else { Exit::Asset }
        };
        let failed =
            move |error: &RecordingError| report::warning(&format!("recording ended early: {error}; the run goes on"), talk);
        let recording = self.record.as_ref().map(|file| recorder.start(file, self.overwrite, Box::new(failed)));
        let recording = recording.transpose().map_err(refused)?;
        let fault_files = self.fault_folder(clock).map(|folder| {
            let told = move |file: &FaultFile| match &file.file {
                Ok(path) if !talk.quiet => say::talk(format_args!("flight recorder: {}\n", path.display())),
                Ok(_) => {}
                Err(error) => report::warning(&format!("flight recorder: {error}"), talk),
            };
            FaultFiles::watch(&recorder, folder, Box::new(told))
        });
        let fault_files = fault_files.transpose().map_err(refused)?;
        let session = Arc::new(Mutex::new(Session { recording, last: None }));
        Ok(Recordings { recorder, session, fault_files })
    }

    /// Where recordings of faults go; simulated time can be had again, so there they are for those who ask.
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
fn state_folder() -> Option<PathBuf> {
    let folder = |variable| std::env::var_os(variable).map(PathBuf::from).filter(|path| path.is_absolute());
    folder("XDG_STATE_HOME").or_else(|| Some(folder("HOME")?.join(".local/state"))).map(|state| state.join("hapticd"))
}

/// What is being recorded.
pub(crate) struct Recordings {
    pub(crate) recorder: Recorder,
    session: Arc<Mutex<Session>>,
    fault_files: Option<FaultFiles>,
}

/// At most one recording at a time, and what the last one came to.
#[derive(Default)]
struct Session {
    recording: Option<RecorderHandle>,
    last: Option<RecordingSummary>,
}

impl Recordings {
    /// For clients, who may begin and end recordings too.
    pub(crate) fn for_clients(&self, talk: Talk) -> ClientRecordings {
        ClientRecordings { recorder: self.recorder.clone(), session: self.session.clone(), talk }
    }

    /// After the last tick: ends the files. What the last recording came to.
    pub(crate) fn end(self, last: &LoopReport) -> Option<RecordingSummary> {
        if let Some(fault_files) = self.fault_files {
            fault_files.finish(last.faults, last.flight.records());
        }
        let mut session = open(&self.session);
        let ended = session.recording.take().map(RecorderHandle::stop);
        ended.or_else(|| session.last.take())
    }

    /// Instead of a first tick: leaves no file behind in which there is nothing.
    pub(crate) fn abandon(self) {
        let recording = open(&self.session).recording.take();
        if let Some(summary) = recording.map(RecorderHandle::stop)
            && summary.records == 0
        {
            // What cannot be removed stays.
            let _ = fs::remove_file(summary.file);
        }
    }
}

fn open(session: &Mutex<Session>) -> MutexGuard<'_, Session> {
    session.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Recordings that clients of the monitor begin and end.
pub(crate) struct ClientRecordings {
    recorder: Recorder,
    session: Arc<Mutex<Session>>,
    talk: Talk,
}

/// Longest name of a file that a client may choose, bytes.
const LONGEST_NAME: usize = 120;

impl monitor::Recorder for ClientRecordings {
    /// Into a folder of our own, never over a file that is there: whoever may watch a run is not to write where he likes.
    fn start(&self, file: Option<&str>) -> Result<(), RecorderError> {
        let mut session = open(&self.session);
        if let Some(recording) = &session.recording
            && recording.status().error.is_none()
        {
            let message = format!("a recording is under way into {}", recording.status().file.display());
            return Err(RecorderError::State(message));
        }
        let refused = |message: String| RecorderError::File(message);
        let name = file.map_or_else(|| format!("session-{}.mcap", now()), str::to_owned);
        let is_plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.' | ' ');
        if !name.ends_with(".mcap") || name.starts_with('.') || !name.chars().all(is_plain) || name.len() > LONGEST_NAME {
            let accepted = "a name of letters, digits, `-`, `_`, `.` and spaces that ends in .mcap";
            return Err(refused(format!("a recording takes {accepted}, such as session.mcap")));
        }
        let folder = state_folder().ok_or_else(|| refused("neither XDG_STATE_HOME nor HOME names a folder".to_owned()))?;
        let folder = folder.join("recordings");
        fs::create_dir_all(&folder).map_err(|error| refused(format!("cannot create {}: {error}", folder.display())))?;
        let talk = self.talk;
        let started = self.recorder.start(&folder.join(name), false, failed(talk));
        session.recording = Some(started.map_err(|error| refused(error.to_string()))?);
        Ok(())
    }

    fn stop(&self) -> Result<(), RecorderError> {
        let mut session = open(&self.session);
        let recording = session.recording.take().ok_or_else(|| RecorderError::State("nothing is being recorded".to_owned()))?;
        session.last = Some(recording.stop());
        Ok(())
    }

    fn status(&self) -> Option<RecorderStatus> {
        let status = open(&self.session).recording.as_ref()?.status();
        let RecordingSummary { file, records, dropped, error } = status;
        error.is_none().then_some(RecorderStatus { file, records, dropped })
    }
}

fn failed(talk: Talk) -> Failed {
    Box::new(move |error| report::warning(&format!("recording ended early: {error}; the run goes on"), talk))
}

/// What the machine offers, for whoever looks at a recording.
pub(crate) fn note_machine(recorder: &Recorder, machine: &Report) {
    for check in &machine.rows {
        recorder.facts.note(&format!("machine.{}", check.name), format!("{:?}: {}", check.outcome, check.found));
    }
}
