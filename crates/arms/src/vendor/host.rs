//! The host's end: a link to a worker, which is started with it and ends with it.

use core::time::Duration;
use std::collections::VecDeque;
use std::io::{self, Read as _, Write as _};
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixStream;
use std::os::unix::process::CommandExt as _;
use std::path::Path;
use std::process::{Child, Command};
use std::thread::sleep;
use std::time::Instant;

use super::page::Page;
use super::{Assignment, NAME, VendorProtocol, unsuitable_file};
use crate::transport::{Transport, TransportError};
use rt::process;
use rt::schedule::ThreadRequest;

/// How long a maker's library may take to open its arm, and to find its zero by moving.
const OPEN_PATIENCE: Duration = Duration::from_secs(20);
const HOME_PATIENCE: Duration = Duration::from_secs(120);
/// How long a worker may take to end by itself: zero, the library's stop and its close.
const END_PATIENCE: Duration = Duration::from_millis(1500);

/// Why there is no worker, or no arm behind it.
#[derive(Debug, thiserror::Error)]
pub enum VendorError {
    /// The library is nowhere.
    #[error("{what}")]
    Missing {
        /// In one line.
        what: String,
        /// Where it was looked for and what to do, line by line.
        advice: String,
    },
    /// The opening program names no `hapticd`.
    #[error(
        "the maker's library runs in a process of its own, which is a `hapticd`, and \
            OpenOptions::guard names none"
    )]
    NoProgram,
    /// The system starts none.
    #[error("cannot start the worker for the maker's library: {0}")]
    Worker(io::Error),
    /// The library, or the arm.
    #[error("{0}")]
    Refused(String),
    /// The worker has ended without a word: the library has ended it.
    #[error(
        "the maker's library ended its process ({0}): hapticd is untouched; see whether the \
            maker's own program works"
    )]
    Ended(String),
    /// The library hangs.
    #[error("the maker's library did not open its arm within {} s: unplug the arm and switch it \
        off and on", .0.as_secs())]
    Silent(Duration),
}

impl VendorError {
    /// What to do, line by line, where there is more to say than what is wrong.
    pub fn hint(&self) -> Option<&str> {
        match self {
            Self::Missing { advice, .. } => Some(advice),
            Self::NoProgram => Some("name the file of an installed hapticd of the same version"),
            _ => None,
        }
    }
}

/// Whether there is a library to start a worker for. Nothing is loaded.
///
/// # Errors
/// [`VendorError::Missing`], and [`VendorError::Refused`] where no file that is there can be
/// loaded.
pub(crate) fn look_for(protocol: &VendorProtocol) -> Result<(), VendorError> {
    let VendorProtocol { family, library, .. } = protocol;
    let places = family.places_here(library.as_deref());
    let mut causes = Vec::new();
    for path in places.iter().filter(|path| path.exists()) {
        let Some(why) = unsuitable_file(path) else { return Ok(()) };
        causes.push(format!("{} {why}", path.display()));
    }
    if causes.is_empty() {
        return Err(VendorError::Missing {
            what: family.missing_text(&places),
            advice: family.missing_advice(&places),
        });
    }
    Err(VendorError::Refused(causes.join("; ")))
}

/// What a worker says, line by line. Cold.
#[derive(Debug)]
pub(crate) struct Words {
    socket: UnixStream,
    bytes: Vec<u8>,
    /// Lines that came while the arm was opened, and were not reported yet.
    early: VecDeque<String>,
}

impl Words {
    /// The next whole line, if one has come.
    fn next(&mut self) -> Option<String> {
        let mut buffer = [0; 512];
        while let Ok(n @ 1..) = self.socket.read(&mut buffer) {
            self.bytes.extend(&buffer[..n]);
        }
        let end = self.bytes.iter().position(|byte| *byte == b'\n')?;
        let line: Vec<u8> = self.bytes.drain(..=end).collect();
        Some(String::from_utf8_lossy(&line[..end]).into_owned())
    }

    /// What there is to be reported, if anything.
    pub(crate) fn reported(&mut self) -> Option<String> {
        let line = self.early.pop_front().or_else(|| self.next())?;
        line.split_once(' ')
            .filter(|(word, _)| matches!(*word, "told" | "lost"))
            .map(|(_, text)| text.to_owned())
    }
}

/// A link to a worker.
pub(crate) struct PageLink {
    page: Page,
    socket: UnixStream,
    process: Child,
}

/// A started worker whose arm is open.
pub(crate) struct Started {
    pub(crate) link: PageLink,
    pub(crate) words: Words,
    /// What the arm is.
    pub(crate) identity: String,
}

/// Starts a worker and waits until its arm is open. `program`: a `hapticd`; never the calling
/// program by itself, which may be another one and would start over. Cold; takes seconds.
///
/// # Errors
/// See [`VendorError`].
pub(crate) fn start(
    program: Option<&Path>,
    protocol: &VendorProtocol,
    serial: Option<String>,
    request: Option<ThreadRequest>,
) -> Result<Started, VendorError> {
    look_for(protocol)?;
    let program = program.ok_or(VendorError::NoProgram)?;
    let assignment = Assignment::new(protocol, serial, request);
    let assignment =
        serde_json::to_string(&assignment).map_err(|error| VendorError::Worker(error.into()))?;
    let (page, shared) = Page::new().map_err(VendorError::Worker)?;
    let (socket, theirs) = UnixStream::pair().map_err(VendorError::Worker)?;
    socket.set_nonblocking(true).map_err(VendorError::Worker)?;
    let mut command = Command::new(program);
    command
        .arg0(NAME)
        .args(["vendor-arm", &assignment])
        .stdin(OwnedFd::from(theirs))
        .stdout(shared);
    let process = command.spawn().map_err(VendorError::Worker)?;
    // Its ends are closed here, so that its death is seen.
    drop(command);
    let mut words = Words {
        socket: socket.try_clone().map_err(VendorError::Worker)?,
        bytes: Vec::new(),
        early: VecDeque::new(),
    };
    let mut link = PageLink { page, socket, process };
    let patience = if protocol.home { HOME_PATIENCE } else { OPEN_PATIENCE };
    let begin = Instant::now();
    loop {
        // First whether it has ended: what it said before is read after.
        let ended = link.process.try_wait().map_err(VendorError::Worker)?;
        while let Some(line) = words.next() {
            match line.split_once(' ') {
                Some(("ready", identity)) => {
                    return Ok(Started { link, words, identity: identity.to_owned() });
                }
                Some(("refused", why)) => return Err(VendorError::Refused(why.to_owned())),
                _ => words.early.push_back(line),
            }
        }
        if let Some(status) = ended {
            return Err(VendorError::Ended(status.to_string()));
        }
        if begin.elapsed() > patience {
            return Err(VendorError::Silent(patience));
        }
        sleep(Duration::from_millis(2));
    }
}

impl Transport for PageLink {
    fn receive(&mut self, buffer: &mut [u8]) -> Result<usize, TransportError> {
        Ok(self.page.take(buffer))
    }

    fn send(&mut self, frame: &[u8]) -> Result<(), TransportError> {
        if !self.page.put(frame) {
            return Err(TransportError::Os(libc::EMSGSIZE));
        }
        match self.socket.write(&[0]) {
            Ok(_) => Ok(()),
            // Bytes that it has not taken yet wake it as well.
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => Ok(()),
            Err(_) => Err(TransportError::Lost),
        }
    }

    /// Each frame takes the place of the one before.
    fn unread(&mut self) -> usize {
        0
    }
}

impl Drop for PageLink {
    fn drop(&mut self) {
        // A second descriptor of it is with what reads its words.
        let _ = self.socket.shutdown(std::net::Shutdown::Write);
        process::end(&mut self.process, END_PATIENCE);
    }
}
