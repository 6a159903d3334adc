//! The crate `vps` for C: opaque handles, a status of each call, the text of the last error of each
//! thread.
//!
//! Data in: pointers and numbers of a C program. Data out: `libvps.so` and `libvps.a`; cbindgen
//! makes `include/vps.h` of this crate, and `include/vps.hpp` wraps that for C++. Units and frames
//! are those of [`vps`].
//!
//! ```text
//!  C ─► vps_* ─► border: null, length, panic ─► vps: everything else that can be wrong ─► status, text of the error
//! ```
//!
//! Invariants: a null pointer is an error and not a crash, a panic ends at the border, and nothing
//! that a call writes out is left as it was found: a handle of a call that failed is null. What no
//! library can check is that other pointers point at what they say; each function states it.
//!
//! Cost: a query crosses the border for some nanoseconds and allocates nothing. An error allocates
//! its text.
#![expect(
    unsafe_code,
    reason = "the border to C: symbols without mangling, pointers of the caller"
)]
#![expect(non_camel_case_types, reason = "the names of C")]

mod baked;
mod border;
mod mesh;
mod query;

pub use baked::*;
pub use border::{vps_last_error, vps_status};
pub use mesh::*;
pub use query::*;

/// Counts up with every change after which a program has to be compiled anew; also the number in
/// the name libvps.so.1.
pub const VPS_ABI_VERSION: u32 = 1;

/// VPS_ABI_VERSION of the library that runs; that of the header is the one that the program was
/// compiled with. They have to be equal.
#[unsafe(no_mangle)]
pub extern "C" fn vps_abi_version() -> u32 {
    VPS_ABI_VERSION
}
