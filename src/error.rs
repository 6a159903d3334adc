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

impl Exit {
    /// Every ending, with its text for users.
    pub const TABLE: [(Self, &str); 8] = [
        (Self::Ok, "Everything asked for was done."),
        (
            Self::Usage,
            "The command line makes no sense, or a file that is there already is to be kept.",
        ),
        (Self::Configuration, "A scene or profile is wrong."),
        (Self::Asset, "A mesh, cache or recording cannot be used, or a file cannot be written."),
        (Self::Device, "The arm cannot be opened, or was lost before rendering."),
        (Self::RealtimeRefused, "The scene enforces real time, and this machine does not keep it."),
        (Self::Fault, "A fault happened while rendering."),
        (Self::Internal, "A mistake of the program."),
    ];
}

impl From<Exit> for ExitCode {
    fn from(exit: Exit) -> Self {
        Self::from(exit as u8)
    }
}
