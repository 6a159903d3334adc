//! Makes the header of the C library and holds it against the one that is there; `--write` writes
//! it.
//!
//! `cargo run --manifest-path tests/capi-header/Cargo.toml [-- --write]`

use std::path::Path;
use std::process::ExitCode;

fn main() -> ExitCode {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../crates/capi");
    let path = root.join("include/vps.h");
    let mut made = Vec::new();
    match cbindgen::generate(&root) {
        Ok(header) => header.write(&mut made),
        Err(error) => {
            eprintln!("no header: {error}");
            return ExitCode::FAILURE;
        }
    }
    if std::env::args().any(|argument| argument == "--write")
        && let Err(error) = std::fs::write(&path, &made)
    {
        eprintln!("{}: cannot be written: {error}", path.display());
        return ExitCode::FAILURE;
    }
    if std::fs::read(&path).is_ok_and(|there| there == made) {
        return ExitCode::SUCCESS;
    }
    eprintln!(
        "{}: it is not the one of crates/capi/src: cargo run --manifest-path \
            tests/capi-header/Cargo.toml -- --write",
        path.display()
    );
    ExitCode::FAILURE
}
