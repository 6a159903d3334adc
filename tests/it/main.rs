//! One integration binary; a module per concern.
#![expect(clippy::print_stderr, reason = "tests say what they skip and measure")]

mod architecture;
mod bake_cache;
mod bake_cache_cli;
mod bench;
mod braking;
mod cli;
mod config_errors;
mod contact;
mod coupling;
mod couplings;
mod data_structures;
mod determinism;
mod distance_error;
mod friction;
mod fuzz_corpus;
mod json_schemas;
mod meddled;
mod models;
mod monitor;
mod objects;
mod operate;
mod presets;
mod profiles;
mod quality;
mod real_scenes;
mod recording;
mod rest;
mod rig;
mod safety;
mod scenes;
mod sides;
mod traversal;
mod tree;
mod tuning;
mod tunnelling;
