//! Pictures of what was baked, three cuts through the map with the shell on them on one sheet; and of clay.
//!
//! `sheet` lays the cuts out, `panel` draws one of them, `palette` gives layer values their colours, `canvas` draws
//! lines and words, [`splats`] the samples of clay. Pure Rust with a font of its own: the same picture on every machine.
//!
//! Invariants: cold; reads a finished map and changes nothing. Cost: O(pixels + surface voxels + points).

mod canvas;
mod palette;
mod panel;
mod sheet;
pub mod splats;
mod subject;

pub use sheet::write;
pub use subject::BakedObject;
