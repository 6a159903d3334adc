//! The program `hapticd`: open, device-agnostic, 6-DoF haptic rendering with the voxmap-pointshell
//! algorithm.
//!
//! This package joins the crates below `crates/` to a program: scenes as files, the loop's thread,
//! a run from start to rest, clients. Code that embeds the geometry or the tick uses `vps` or
//! `haptics` alone.
//!
//! ```text
//!  scene.toml ─► config ─► scene ─► RenderScene ─► engine: wait ─► read ─► tick ─► write ─► ring of TickRecords
//!                          (bake cache)              ▲  ▲                                            │
//!  signals, heartbeats ─► control word (rt) ─────────┘  │ ring of commands                           ▼
//!  clients ◄─► monitor ─► daemon::session ──────────────┘                               recording ─► monitor, publish, files
//! ```
//!
//! # Units and frames
//! SI behind [`config`]; the frames of [`vps::spatial`]. Quaternions and vectors are those of
//! `glam`.
//!
//! # Cost
//! Baking takes what [`vps::part`] says, a start from the bake cache one pass over its files. From
//! the first tick on, the servo thread does not allocate, lock or print.
//!
//! # Example
//! ```
//! # let folder = tempfile::tempdir()?;
//! # let file = folder.path().join("ball.toml");
//! # let text = r#"version = 1
//! #     [[static]]
//! #     name = "plate"
//! #     shape = { plane_mm = [60.0, 60.0] }
//! #     voxel_size_mm = 1.0
//! #     [tool]
//! #     shape = { sphere_mm = 10.0 }
//! #     voxel_size_mm = 1.0"#;
//! std::fs::write(&file, text)?; // a plate, and a ball that starts in its surface
//! let config = hapticd::config::load(&file)?;
//! let (scene, reports) = hapticd::scene::build(&config, |_event| ())?;
//! let mut state = haptics::State::new(&scene);
//! let output = haptics::tick(&scene, &mut state, &haptics::TickInput::default());
//! assert!(output.contacts > 0 && reports.len() == 2);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Where to find what
//!
//! | crate | owns |
//! |---|---|
//! | [`vps`] | meshes, voxmaps, pointshells, the contact wrench of a pose |
//! | [`haptics`] | one tick: friction, damping, filter, couplings, passivity, limits of force and torque, faults |
//! | [`clay`] | clay that a tool deforms |
//! | [`arms`] | profiles, protocols, transports, kinematics, motor bounds, simulated arms |
//! | [`engine`] | the 1 kHz loop and its thread, a run from its first tick to rest, zero force on every way out |
//! | [`recording`] | records, the threads that write recordings, reading, reports, metrics |
//! | [`link`] | other machines: messages of ROS 2, sessions, what a run publishes |
//! | [`rt`] | clocks, scheduling, signals, the control word |
//! | [`picture`] | cuts through a map, clay, and rigid scenes as PNG; films |
//! | [`document`] | the form of TOML and CSV files, and how errors in them are reported |
//!
//! | module | owns |
//! |---|---|
//! | [`config`] | the keys of a scene: read, checked, in SI |
//! | [`scene`] | a checked scene → what the tick reads, through the bake cache |
//! | [`daemon`] | preparing a run, and the session that changes what is rendered; replay |
//! | [`monitor`] | HTTP, WebSocket and the page |
//! | `cli` | one file for each command; the only module that prints |
//! | [`error`] | exit codes |

#[doc(hidden)]
pub mod cli;
pub mod config;
pub mod daemon;
pub mod error;
pub mod monitor;
pub mod scene;
