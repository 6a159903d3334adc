//! HTTP, WebSocket and the page, for clients that watch and drive a run.
//!
//! ```text
//!  drain ──ring──► state publisher ──► groups of clients (one encoding per rate and format) ──► outboxes ──► WebSockets
//!  supervisor ──notices──► hub ──events──► outboxes
//!  clients ──asks──► hub ──► session (daemon), orders (supervisor)
//!  clients ──heartbeats──► drive watchdog (thread): silence ──► disable
//! ```
//! Data in: every record of the run, notices, what the session shows. Data out: state streams,
//! events, replies, and what clients ask for.
//!
//! Invariants: the drain never waits for anything here, and the loop is not even known. Whatever a
//! client sends or does not read costs a bounded amount of memory. No client sends a force: clients
//! say when force may flow, set parameters within their ranges, move objects, and choose what the
//! tool does to clay.
//!
//! | thread | does |
//! |---|---|
//! | `monitor` | everything on the wire; one tokio runtime of one thread, not pinned, of normal priority |
//! | `drive-watchdog` | switches force off when a client that drives falls silent, even when `monitor` stands still |
//! | `hold-watchdog` | lets clay go when the client that holds it falls silent |
//! | `monitor-mesh`, `monitor-points`, `monitor-file`, `monitor-upload` | meshes, structures and samples for display (structures are baked in a pool of threads that give way); points in contact; recordings that begin and end, files of clay; files that clients send |

pub mod access;
mod answer;
mod app_state;
mod asks;
mod assets;
mod clay;
mod clearance;
mod client;
mod compressed;
mod connection;
mod connection_slots;
mod download;
mod encode;
mod feed;
mod forms;
mod hub;
mod index_origin;
mod info;
mod object_cache;
mod observer;
mod outbox;
mod problem;
mod rate_limiter;
mod recorder;
mod recordings;
mod rest;
mod rows;
mod scene_tracker;
mod server;
mod state_publisher;
mod structure;
mod visual;
mod worker;
mod ws;

pub use access::{Access, Token, TokenError};
pub use clay::{ClayAccess, ClayParts, plain_name};
pub use hub::{Hub, HubParts};
pub use observer::{Observation, Observer};
pub use recorder::{MadeRecording, RecorderError, RecorderStatus, RecordingControl};
pub use server::{BoundMonitor, Monitor};
