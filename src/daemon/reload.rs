//! The scene is read again while it is rendered: when SIGHUP asks for it, and where wished when one
//! of its files changes.
//!
//! ```text
//!  SIGHUP ─┐                    ┌─ wrong, or for another arm ─► refused; the old scene stays
//!  file  ──┴► read and check ───┼─ only parameters differ ────► set together, each along its ramp
//!  changed                      └─ anything else ─────────────► baked meanwhile, then exchanged at zero force
//! ```
//! Runs on the thread of scenes, between two bakes. Data in: the session, for what is rendered now.
//! Data out: changes of the session, and [`ReloadNotice`].

use core::time::Duration;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::{Instant, SystemTime};

use super::scene_keys::{fixed, unlike_at_the_arm};
use super::session::{Baker, SceneView, SessionHandle};
use super::session_error::SessionError;
use crate::config::scene::MeshSource;
use crate::config::{self, SceneConfig};
use engine::servo::FileChange;
use rt::signals::{Hangup, Hangups};
use vps::mesh;

/// How often signals are looked for.
const LISTEN: Duration = Duration::from_millis(100);
/// How often files are.
const LOOK: Duration = Duration::from_secs(1);
/// A file that is being written is left alone until it has stayed the same for so long.
const SETTLE: Duration = Duration::from_millis(300);

/// Reads scenes again.
pub struct Reloader {
    hangups: Hangups,
    watches: bool,
    known: KnownFiles,
    tell: Box<dyn Fn(&ReloadNotice) + Send>,
    next_listen: Instant,
    next_look: Instant,
    pending: Option<Cause>,
}

/// What a reload has to say.
#[derive(Debug)]
pub enum ReloadNotice {
    /// The scene is read again, and why.
    Begun(Cause),
    /// What came of it.
    Done(Reloaded),
    /// Nothing came of it: the old scene stays.
    Refused(SessionError),
    /// SIGHUP, and the terminal has gone: the run ends with a ramp.
    TerminalGone,
}

/// Why a scene is read again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cause {
    /// A signal.
    Signal,
    /// A file.
    File,
}

/// What came of a reload.
#[derive(Clone, Debug, PartialEq)]
pub enum Reloaded {
    /// What is rendered is what the file says.
    Unchanged,
    /// Parameters go to new values.
    Changed(Vec<FileChange>),
    /// The scene was baked, and takes the place of the old one at zero force.
    Baked(PathBuf),
}

impl Reloader {
    /// Reads the scene again when `hangups` says so, and where it `watches` when a file is not as
    /// it is `known` any more. `tell` gets what comes of it, on the thread of scenes.
    pub fn new(
        hangups: Hangups,
        watches: bool,
        known: KnownFiles,
        tell: Box<dyn Fn(&ReloadNotice) + Send>,
    ) -> Self {
        let now = Instant::now();
        Self { hangups, watches, known, tell, next_listen: now, next_look: now, pending: None }
    }

    /// Begins to read the scene of this session again when it is asked for.
    pub fn begin(mut self, session: &SessionHandle) {
        session.watch_with(Box::new(move |session, is_free, baker| {
            self.turn(session, is_free, baker)
        }));
    }

    /// Looks whether there is something to do, and does it. `is_free`: no other scene is on its
    /// way; what is asked for meanwhile is done afterwards.
    fn turn(&mut self, session: &SessionHandle, is_free: bool, baker: &mut Baker) {
        let now = Instant::now();
        if now < self.next_listen {
            return;
        }
        self.next_listen = now + LISTEN;
        match self.hangups.take() {
            // The signal has ended the run itself.
            Some(Hangup::TerminalGone) => return (self.tell)(&ReloadNotice::TerminalGone),
            Some(Hangup::Reload) => self.pending = Some(Cause::Signal),
            None if now >= self.next_look => {
                self.next_look = now + LOOK;
                let view = session.view();
                self.known.go_over(&view);
                if self.watches && self.known.have_changed(&view) {
                    self.pending = Some(Cause::File);
                }
            }
            None => {}
        }
        if let Some(cause) = self.pending.take_if(|_| is_free) {
            (self.tell)(&ReloadNotice::Begun(cause));
            let reloaded = self.reload(session, baker);
            (self.tell)(&reloaded.map_or_else(ReloadNotice::Refused, ReloadNotice::Done));
        }
    }

    fn reload(
        &mut self,
        session: &SessionHandle,
        baker: &mut Baker,
    ) -> Result<Reloaded, SessionError> {
        let view = session.view();
        let config = config::load_with(&view.config.path, session.options())
            .map_err(SessionError::Config)?;
        if let Some((key, its, ours)) =
            unlike_at_the_arm(&config, &view.config).or_else(|| fixed(&config, &view.config))
        {
            return Err(SessionError::Unlike { key, its, ours });
        }
        let meshes = self.known.companions.meshes(&config);
        if meshes == self.known.meshes
            && let Some(changes) = session.follow_file(view.scene_idx, &config)?
        {
            return Ok(if changes.is_empty() {
                Reloaded::Unchanged
            } else {
                Reloaded::Changed(changes)
            });
        }
        // The user's work on it would be lost.
        if view.config.sculpt.is_some() {
            return Err(SessionError::Clay {
                taken: view.settings.iter().map(|setting| setting.parameter.name()).collect(),
            });
        }
        if config.sculpt.is_some() {
            return Err(SessionError::Unlike {
                key: "sculpt",
                its: "clay".to_owned(),
                ours: "none".to_owned(),
            });
        }
        let path = config.path.clone();
        session.switch_to(config, baker)?;
        self.known.meshes = meshes;
        Ok(Reloaded::Baked(path))
    }
}

/// The files of a scene, as they were when they were last looked at.
#[derive(Clone, Debug)]
pub struct KnownFiles {
    scene_idx: u32,
    files: Files,
    /// Those that were baked.
    meshes: Files,
    companions: Companions,
}

impl KnownFiles {
    /// Of the first scene of a run.
    pub fn of(config: &SceneConfig) -> Self {
        let mut companions = Companions::default();
        Self {
            scene_idx: 0,
            files: companions.files(config),
            meshes: companions.meshes(config),
            companions,
        }
    }

    /// Goes over to another scene as soon as it is rendered: from then on its files may change.
    /// What is known of files that both have stays: they may have changed meanwhile.
    fn go_over(&mut self, view: &SceneView) {
        if view.scene_idx != self.scene_idx {
            self.scene_idx = view.scene_idx;
            self.files = self.companions.files(&view.config).knowing(&self.files);
            self.meshes = self.companions.meshes(&view.config).knowing(&self.meshes);
        }
    }

    /// Whether a file is another one than at the last look, and stays as it is.
    fn have_changed(&mut self, view: &SceneView) -> bool {
        let files = self.companions.files(&view.config);
        if files == self.files {
            return false;
        }
        std::thread::sleep(SETTLE);
        // One that is still being written is for the next look.
        let has_settled = self.companions.files(&view.config) == files;
        if has_settled {
            self.files = files;
        }
        has_settled
    }
}

/// When a file was written, and how long it is; `None`: it is not there.
type Stamp = Option<(SystemTime, u64)>;

/// Files and when each was written.
#[derive(Clone, Debug, PartialEq)]
struct Files(BTreeMap<PathBuf, Stamp>);

impl Files {
    /// The same files, as an earlier look knew them.
    fn knowing(mut self, earlier: &Self) -> Self {
        for (path, stamp) in &mut self.0 {
            if let Some(known) = earlier.0.get(path) {
                *stamp = *known;
            }
        }
        self
    }
}

/// The files that meshes take their contents from, kept until a mesh is written anew: to find them
/// a whole file has to be read.
#[derive(Clone, Debug, Default)]
struct Companions(BTreeMap<PathBuf, (Stamp, Vec<PathBuf>)>);

impl Companions {
    /// Of a scene as they are now: its own file and those of its meshes.
    fn files(&mut self, config: &SceneConfig) -> Files {
        let Files(mut files) = self.meshes(config);
        files.insert(config.path.clone(), stamp(&config.path));
        Files(files)
    }

    /// Those of its meshes only.
    fn meshes(&mut self, config: &SceneConfig) -> Files {
        let sources =
            config.statics.iter().map(|object| &object.source).chain([&config.tool.source]);
        let mut files = BTreeMap::new();
        for source in sources {
            let MeshSource::File { path, .. } = source else { continue };
            let now = stamp(path);
            files.extend(self.of(path, now).iter().map(|beside| (beside.clone(), stamp(beside))));
            files.insert(path.clone(), now);
        }
        Files(files)
    }

    fn of(&mut self, path: &Path, now: Stamp) -> &[PathBuf] {
        let (known, companions) = self.0.entry(path.to_owned()).or_default();
        if *known != now {
            // A file that cannot be read now names no others.
            (*known, *companions) = (now, mesh::companions(path).unwrap_or_default());
        }
        companions
    }
}

fn stamp(path: &Path) -> Stamp {
    let meta = std::fs::metadata(path).ok()?;
    Some((meta.modified().ok()?, meta.len()))
}

#[cfg(test)]
mod tests;
