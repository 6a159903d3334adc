//! Pictures of what was baked, three cuts through the map with the shell on them on one sheet; of
//! clay; and of rigid scenes.
//!
//! `sheet` lays the cuts out, `panel` draws one of them, `marks` finds what is marked in them,
//! `palette` gives layer values their colours, `canvas` draws lines and words, [`splats`] the
//! samples of clay, [`parts`] the meshes of a scene; both look through a `view`, and `shade` lights
//! it. [`film`] writes frames as one file.
//! Pure Rust with a font of its own: the same picture on every machine.
//!
//! Invariants: cold; reads a finished map and changes nothing. Cost: O(pixels + surface voxels +
//! points).

mod canvas;
pub mod film;
mod marks;
mod palette;
mod panel;
pub mod parts;
mod shade;
mod sheet;
pub mod splats;
mod subject;
mod view;

pub use marks::Marks;
pub use sheet::write;
pub use subject::BakedObject;
