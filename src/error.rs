//! The exit-code table: one number for each kind of ending.

use std::process::ExitCode;

/// How a command ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Exit {
    /// Everything asked for was done.
    Ok = 0,
    /// The command line makes no sense (clap prints why).
    Usage = 2,
    /// A scene or profile is wrong.
    Configuration = 3,
    /// A mesh, cache or recording cannot be used.
    Asset = 4,
    /// The arm cannot be opened or was lost before rendering.
    Device = 5,
    /// `realtime = "enforce"` and a preflight check failed.
    RealtimeRefused = 6,
    /// A fault happened while rendering.
    Fault = 7,
    /// A bug of ours.
    Internal = 70,
}

impl From<Exit> for ExitCode {
    fn from(exit: Exit) -> Self {
        Self::from(exit as u8)
    }
}
