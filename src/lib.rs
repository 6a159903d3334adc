//! `hapticd`: open, device-agnostic, 6-DoF haptic rendering with the voxmap-pointshell algorithm.
//!
//! The rooms, in the order in which the data walks them:
//!
//! | room | does |
//! |---|---|
//! | [`spatial`] | poses, twists, wrenches, frames, signs: the shared vocabulary |
//! | [`storage`] | arrays that are owned or lie in a mapped file; files of them |
//! | [`config`] | TOML scene → checked, SI, typed |
//! | [`mesh`] | files and shapes → triangles |
//! | [`voxmap`] | triangles → bricked voxel map: surface, sides, layers, distance, field |
//! | [`pointshell`] | surface voxels → points with inward normals |
//! | [`scene`] | everything baked or taken from the bake cache, immutable, in one place |
//! | [`sculpt`] | point samples → a surface that a hand deforms |
//! | [`haptics`] | the tick: contact, filter, coupling, limits |
//! | [`device`] | arms: trait, profiles, the simulated arm |
//! | [`rt`] | every operating-system call of the loop |
//! | [`network`] | sessions with other machines |
//! | [`servo`] | the 1 kHz loop: wait → read → tick → write → publish |
//! | [`telemetry`] | records out of the loop → histograms and summaries |
//! | [`ros`] | records as messages of ROS 2, without ROS |
//! | [`publish`] | what a run tells a network, and worlds that runs share |
//! | [`monitor`] | HTTP, WebSocket and the page of a run |
//! | [`daemon`] | supervisor: bake, preflight, enable, stop |
//! | [`picture`] | cuts through a map with its shell, as PNG |
//! | [`mod@bench`] | stand-in models and figures of generation |
//! | [`cli`] | one file per command; the only printer |

pub mod bench;
pub mod cli;
pub mod config;
pub mod daemon;
pub mod device;
pub mod error;
pub mod haptics;
pub mod mesh;
pub mod monitor;
pub mod network;
pub mod picture;
pub mod pointshell;
pub mod publish;
pub mod ros;
pub mod rt;
pub mod scene;
pub mod sculpt;
pub mod servo;
pub mod spatial;
pub mod storage;
pub mod telemetry;
pub mod voxmap;
