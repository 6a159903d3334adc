//! A node that exists: the arm's end of a USB gadget, `/dev/ttyGS0` or `/dev/hidg0`.

use core::time::Duration;
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};

use rustix::fs::{Mode, OFlags};
use rustix::io::Errno;
use rustix::termios::isatty;

use super::link::{ArmLink, LinkError};
use super::pty::{make_raw, wait_for};

/// How long a node that fails is left alone.
const REST: Duration = Duration::from_millis(20);

/// The arm's end of a gadget.
pub struct Gadget {
    path: PathBuf,
    fd: Option<OwnedFd>,
    spoken: bool,
    gone: bool,
}

impl Gadget {
    /// Opens it.
    ///
    /// # Errors
    /// It is not there, or may not be opened.
    pub fn open(path: &Path) -> Result<Self, LinkError> {
        let fd = open(path).map_err(|errno| LinkError::Node {
            what: format!("open {}", path.display()),
            cause: errno.into(),
        })?;
        Ok(Self { path: path.to_owned(), fd: Some(fd), spoken: false, gone: false })
    }
}

fn open(path: &Path) -> Result<OwnedFd, Errno> {
    let fd = rustix::fs::open(
        path,
        OFlags::RDWR | OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC,
        Mode::empty(),
    )?;
    if isatty(&fd) {
        make_raw(&fd)?;
    } else if !path.file_name().is_some_and(|name| name.to_string_lossy().starts_with("hidg")) {
        return Err(Errno::NOTTY);
    }
    Ok(fd)
}

impl ArmLink for Gadget {
    fn wait(&mut self, timeout: Duration) {
        match &self.fd {
            Some(fd) => wait_for(fd, timeout),
            None => {
                std::thread::sleep(timeout.min(REST));
                self.fd = open(&self.path).ok();
            }
        }
    }

    fn receive(&mut self, buffer: &mut [u8]) -> usize {
        let Some(fd) = &self.fd else { return 0 };
        match rustix::io::read(fd, buffer) {
            Ok(n) => {
                self.spoken |= n > 0;
                n
            }
            Err(Errno::AGAIN | Errno::INTR) => 0,
            // The cable is out: the node may come back.
            Err(_) => {
                self.gone |= self.spoken;
                self.fd = None;
                0
            }
        }
    }

    fn send(&mut self, frame: &[u8]) -> bool {
        let Some(fd) = &self.fd else { return false };
        matches!(rustix::io::write(fd, frame), Ok(n) if n == frame.len())
    }

    fn unplug(&mut self) -> Result<(), LinkError> {
        Err(LinkError::NoPlug(self.path.display().to_string()))
    }

    fn replug(&mut self) -> Result<(), LinkError> {
        Ok(())
    }

    fn is_host_gone(&self) -> bool {
        self.gone
    }
}
