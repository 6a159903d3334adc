//! `hapticd`: open, device-agnostic, 6-DoF haptic rendering with the voxmap-pointshell algorithm.
//!
//! Most people run the program. As a library it has three doors; vectors and quaternions are those of the crate `glam`.
//!
//! # Bake a scene, and ask it for a wrench
//!
//! ```
//! use glam::DVec3;
//! use vps::contact::ContactSum;
//! use vps::spatial::Pose;
//!
//! # let folder = tempfile::tempdir()?;
//! # let file = folder.path().join("ball.toml");
//! std::fs::write(&file, r#"
//!     version = 1
//!     [[static]]
//!     name = "plate"
//!     shape = { plane_mm = [60.0, 60.0] }
//!     voxel_size_mm = 1.0
//!     [tool]
//!     shape = { sphere_mm = 10.0 }
//!     voxel_size_mm = 1.0
//!     start_position_mm = [0.0, 0.0, 12.0]
//! "#)?;
//! let config = hapticd::config::load(&file)?;
//! let (scene, _reports) = hapticd::scene::build(&config, |_| {})?;
//!
//! // The ball half a millimetre deep in the plate.
//! let world_from_body = Pose::from_translation(DVec3::Z * 9.5e-3);
//! let parameters = &scene.parameters;
//! let sum = ContactSum::flat(&scene.obstacles, &scene.tool.shell, world_from_body, &parameters.contact, &parameters.filter);
//! assert!(sum.contacts > 0 && sum.wrench.force.z > 0.0);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Render it for an arm, tick by tick
//!
//! ```
//! use glam::DVec3;
//! use arms::Device;
//! use arms::simulated::hand::{GripPath, HandPath};
//! use arms::simulated::{HandParameters, SimArm, SimParameters};
//! use haptics::{DriveRequest, State, TickInput, TickOutput, tick};
//! use vps::spatial::Pose;
//!
//! # let folder = tempfile::tempdir()?;
//! # let file = folder.path().join("ball.toml");
//! # std::fs::write(&file, r#"
//! #     version = 1
//! #     [[static]]
//! #     name = "plate"
//! #     shape = { plane_mm = [60.0, 60.0] }
//! #     voxel_size_mm = 1.0
//! #     [tool]
//! #     shape = { sphere_mm = 10.0 }
//! #     voxel_size_mm = 1.0
//! #     start_position_mm = [0.0, 0.0, 12.0]
//! # "#)?;
//! # let config = hapticd::config::load(&file)?;
//! # let (scene, _reports) = hapticd::scene::build(&config, |_| {})?;
//! // A hand that wants the ball 5 mm further down; the plate is in the way.
//! let down = GripPath::in_device_frame(HandPath::fixed(Pose::from_translation(DVec3::Z * -5e-3)));
//! let hand = HandParameters { path: Some(down), ..HandParameters::default() };
//! let mut arm = SimArm::new(SimParameters { hand: Some(hand), ..SimParameters::ideal(scene.parameters.period_s) })?;
//!
//! let mut state = State::new(&scene);
//! let mut output = TickOutput::default();
//! for _ in 0..1000 {
//!     let sample = arm.read()?;
//!     output = tick(&scene, &mut state, &TickInput { sample, request: DriveRequest::Enable, ..TickInput::default() });
//!     arm.write(&output.command_device)?;
//! }
//! arm.stop();
//! assert!(output.faults.is_empty() && output.command_device.force.z > 0.0);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! The program does the same with a clock, a thread of its own and a way out that ends in zero force: [`servo`].
//!
//! # Read a recording
//!
//! ```
//! use recording::file::{Entry, Recording};
//!
//! let mut recording = Recording::open("tests/fixtures/block-on-plane.mcap".as_ref())?;
//! let mut largest_n = 0.0_f64;
//! while let Some(entry) = recording.next_entry()? {
//!     if let Entry::Tick { record, .. } = entry {
//!         largest_n = largest_n.max(record.output.command_device.force.length());
//!     }
//! }
//! assert!(recording.is_whole() && largest_n > 0.0);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Rooms
//!
//! In the order in which the data walks them:
//!
//! | room | does |
//! |---|---|
//! | [`spatial`] | poses, twists, wrenches, frames, signs: the shared vocabulary |
//! | [`document`] | files that people write: TOML in which every entry knows its line, poses; what is wrong with them |
//! | [`config`] | TOML scene → checked, SI, typed |
//! | [`mesh`] | files and shapes → triangles |
//! | [`voxmap`] | triangles → bricked voxel map: surface, sides, layers, distance, field |
//! | [`pointshell`] | surface voxels → points with inward normals |
//! | [`scene`] | everything baked or taken from the bake cache, immutable, in one place |
//! | [`sculpt`] | point samples → a surface that a hand deforms |
//! | [`haptics`] | the tick: contact, filter, coupling, limits |
//! | [`device`] | arms: trait, profiles, the simulated arm |
//! | [`telemetry`] | records out of the loop → histograms, summaries, recordings |
//!
//! The inside of the program, public for itself, its tests and its benchmarks; any version may change it:
//!
//! | room | does |
//! |---|---|
//! | [`storage`] | arrays that are owned or lie in a mapped file; files of them |
//! | [`rt`] | every operating-system call of the loop |
//! | [`network`] | sessions with other machines |
//! | [`servo`] | the 1 kHz loop: wait → read → tick → write → publish |
//! | [`ros`] | records as messages of ROS 2, without ROS |
//! | [`daemon`] | supervisor: bake, preflight, enable, stop |
//! | [`monitor`] | HTTP, WebSocket and the page of a run |
//! | `picture` | cuts through a map with its shell, as PNG |
//! | `cli` | one file per command; the only printer |

#[doc(hidden)]
pub mod cli;
pub mod config;
pub mod daemon;
pub mod error;
pub mod monitor;
#[doc(hidden)]
pub mod picture;
pub mod scene;
pub mod servo;
