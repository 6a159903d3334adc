//! Arrays that outlive the program that filled them.
//!
//! `SharedSlice` is an array that is owned or is a window into the bytes of a file, mapped or read;
//! the tick cannot tell which. `sections` is a file of named arrays with a version, a key and
//! checksums. What is in them, and where the files are, is the business of `scene`. `regular` opens
//! what others name, `memory` says what can still be taken, `printable` is names of others on a
//! terminal, `whole_file` writes files that are never half there.
//!
//! Invariant: a leaf; knows nothing of any other module. Nothing that is read from a file is
//! believed before it is checked.

pub mod memory;
pub mod printable;
pub mod regular;
pub mod sections;
mod shared_slice;
pub mod whole_file;

pub use shared_slice::{MappedFile, SharedSlice};
