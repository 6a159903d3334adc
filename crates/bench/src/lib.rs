//! Measuring beside the paper and beside other programs.
//!
//! [`stand_ins`] makes the models of the paper's tables. [`generation`] bakes them, each bake a
//! process of its own. [`contact`] asks how right and how fast contacts are, [`loops`] how punctual
//! runs on the real clock are, [`sculpt`] how long clay takes, [`sagardia2008`] what the tables and
//! plots of the paper of 2008 look like here. All figures end up in a [`BenchReport`].
//!
//! Invariants: cold. Nothing here decides whether a test passes; a target that is missed is a line
//! that says so.

pub mod contact;
mod export;
pub mod generation;
pub mod loops;
mod peers;
mod process;
mod random;
mod report;
pub mod sagardia2008;
pub mod sculpt;
pub mod stand_ins;
mod statistics;
mod table1;

use std::path::PathBuf;

use thiserror::Error;

pub use process::HAPTICD;
pub use report::{BenchReport, MachineInfo, Row, commit_of};
pub use statistics::Spread;

/// Why a bench ended early.
#[derive(Debug, Error)]
pub enum BenchError {
    /// A process that is measured did not do its work.
    #[error("{command} failed: {why}")]
    Process {
        /// As it was started.
        command: String,
        /// What it said last.
        why: String,
    },
    /// A part of the bench could not be baked, or a scene not be played.
    #[error("{what}: {why}")]
    Prepare {
        /// The part or scene.
        what: String,
        /// Cause.
        why: String,
    },
    /// A stand-in or a result could not be written.
    #[error("cannot write {}: {source}", path.display())]
    Write {
        /// File or folder.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
}
