//! Voxmap-pointshell contact.
pub mod contact;
pub mod density;
pub mod mesh;
pub mod part;
mod part_report;
pub mod pointshell;
pub mod spatial;
pub mod storage;
pub mod voxmap;
