//! A pseudo-terminal: what a serial port is to the host.
//!
//! The arm has the master. The slave's name changes with every plug, so the host is given a
//! symbolic link. While no host has spoken the arm keeps the slave open, raw, so that nothing is
//! echoed; then it lets go of it and sees by the hang-up when the host has gone.

use core::time::Duration;
use std::ffi::OsStr;
use std::fs;
use std::io;
use std::os::fd::{AsFd, OwnedFd};
use std::os::unix::ffi::OsStrExt;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{Mode, OFlags};
use rustix::io::Errno;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};

use super::link::{ArmLink, LinkError};

struct Pair {
    master: OwnedFd,
    /// Ours until the host has spoken.
    slave: Option<OwnedFd>,
}

/// The arm's end of a pseudo-terminal.
pub struct Pty {
    link: PathBuf,
    pair: Option<Pair>,
    /// The slave's; the link leads there as long as it is ours.
    name: PathBuf,
    gone: bool,
}

impl Pty {
    /// Makes the pair and the link to its slave.
    ///
    /// # Errors
    /// The system has none to give, or `link` cannot be made; what stands there is replaced only if
    /// it is a symbolic link that leads nowhere.
    pub fn new(link: &Path) -> Result<Self, LinkError> {
        let mut pty = Self { link: link.to_owned(), pair: None, name: PathBuf::new(), gone: false };
        pty.plug()?;
        Ok(pty)
    }

    fn plug(&mut self) -> Result<(), LinkError> {
        let of = |what: String| move |cause: io::Error| LinkError::Node { what, cause };
        // Before there is a new pair, which may have the number of the one that the link led to.
        if fs::symlink_metadata(&self.link).is_ok_and(|found| found.is_symlink()) {
            // What it leads to goes with the process that made it. What is still there is in use.
            if let (Ok(_), Ok(taken_by)) = (fs::metadata(&self.link), fs::read_link(&self.link)) {
                return Err(LinkError::Taken { link: self.link.clone(), taken_by });
            }
            fs::remove_file(&self.link).map_err(of(format!("replace {}", self.link.display())))?;
        }
        let (pair, name) =
            open_pair().map_err(|errno| of("make a pseudo-terminal".to_owned())(errno.into()))?;
        symlink(&name, &self.link).map_err(of(format!(
            "link {} to {}",
            self.link.display(),
            name.display()
        )))?;
        self.pair = Some(pair);
        self.name = name;
        Ok(())
    }

    fn pull(&mut self) {
        // The link first: a host that looks for its arm again must not find the dying node.
        if self.pair.is_some() && fs::read_link(&self.link).is_ok_and(|name| name == self.name) {
            let _ = fs::remove_file(&self.link);
        }
        self.pair = None;
    }
}

fn open_pair() -> Result<(Pair, PathBuf), Errno> {
    let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC)?;
    grantpt(&master)?;
    unlockpt(&master)?;
    let name = ptsname(&master, Vec::new())?;
    let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC;
    let slave = rustix::fs::open(name.as_c_str(), flags, Mode::empty())?;
    make_raw(&slave)?;
    rustix::fs::fcntl_setfl(&master, OFlags::NONBLOCK)?;
    Ok((Pair { master, slave: Some(slave) }, PathBuf::from(OsStr::from_bytes(name.to_bytes()))))
}

/// Bytes as they are: no echo, no lines, no signals.
pub(super) fn make_raw(fd: impl AsFd) -> Result<(), Errno> {
    let mut settings = tcgetattr(&fd)?;
    settings.make_raw();
    tcsetattr(&fd, OptionalActions::Now, &settings)
}

/// Waits for something to read, at most `timeout`.
pub(super) fn wait_for(fd: impl AsFd, timeout: Duration) {
    let timeout =
        Timespec { tv_sec: timeout.as_secs() as i64, tv_nsec: timeout.subsec_nanos().into() };
    // A signal ends it early, which is allowed.
    let _ = poll(&mut [PollFd::new(&fd, PollFlags::IN)], Some(&timeout));
}

impl ArmLink for Pty {
    fn wait(&mut self, timeout: Duration) {
        match &self.pair {
            Some(pair) => wait_for(&pair.master, timeout),
            None => std::thread::sleep(timeout),
        }
    }

    fn receive(&mut self, buffer: &mut [u8]) -> usize {
        let Some(pair) = &mut self.pair else { return 0 };
        match rustix::io::read(&pair.master, buffer) {
            Ok(n) => {
                if n > 0 {
                    pair.slave = None;
                }
                n
            }
            Err(Errno::AGAIN | Errno::INTR) => 0,
            // The last of the hosts has closed it. Its settings and its lock go with the pair; the
            // next one finds a new one.
            Err(_) => {
                self.gone = true;
                self.pull();
                // Without a node the arm goes on alone, and the next try is the next replug.
                let _ = self.plug();
                0
            }
        }
    }

    fn send(&mut self, frame: &[u8]) -> bool {
        let Some(pair) = &self.pair else { return false };
        matches!(rustix::io::write(&pair.master, frame), Ok(n) if n == frame.len())
    }

    fn unplug(&mut self) -> Result<(), LinkError> {
        self.pull();
        Ok(())
    }

    fn replug(&mut self) -> Result<(), LinkError> {
        if self.pair.is_none() { self.plug() } else { Ok(()) }
    }

    fn is_host_gone(&self) -> bool {
        self.gone
    }
}

impl Drop for Pty {
    fn drop(&mut self) {
        self.pull();
    }
}
