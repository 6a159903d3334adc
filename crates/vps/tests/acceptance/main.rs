//! Acceptance tests of generation and contact, under the numbers of the mission; over real meshes
//! where `HAPTICD_MODELS` names their folder.
#![expect(clippy::print_stderr, reason = "tests say what they skip and measure")]

mod creases;
mod curved_edges;
mod data_structures;
mod decompositions;
mod distance_error;
mod force_law;
mod inside_test;
mod models;
mod solids;
mod traversal;
mod tree;

use vps::mesh::{TriangleMesh, validate};
use vps::voxmap::inside_test::InsideTest;
use vps::voxmap::{Options, Volume};

/// The voxmap of a mesh as it is in the file.
fn build_as(mesh: &TriangleMesh, voxel_size_m: f64, layers: u32, sides: InsideTest) -> Volume {
    let options = Options { voxel_size_m, layers, navigation: None, sides };
    Volume::build(mesh, &validate::inspect(mesh), &options, |_| ()).expect("a grid that fits")
}

fn build(mesh: &TriangleMesh, voxel_size_m: f64, layers: u32) -> Volume {
    build_as(mesh, voxel_size_m, layers, InsideTest::Auto)
}
