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

use vps::contact::{ContactSum, ForceLaw, Obstacle};
use vps::mesh::{TriangleMesh, validate};
use vps::pointshell::shell::Shell;
use vps::spatial::Pose;
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

/// Work of the contact around a path that ends where it begins.
struct Work {
    /// Of all of it, what is left.
    share: f64,
    /// Sum of what each tick takes or gives, J.
    amounts_j: f64,
}

fn work_of_closed_path(
    obstacles: &[Obstacle],
    shell: &Shell,
    n_ticks: u32,
    pose: impl Fn(u32) -> Pose,
) -> Work {
    let wrench = |pose| ContactSum::flat(obstacles, shell, pose, ForceLaw::PLAIN).wrench;
    let mut whole_j = 0.0;
    let mut amounts_j = 0.0;
    let mut last = (pose(0), wrench(pose(0)));
    for tick in 1..=n_ticks {
        let next = (pose(tick), wrench(pose(tick)));
        let turned = (next.0.rotation * last.0.rotation.inverse()).to_scaled_axis();
        let work_j = 0.5
            * ((last.1.force + next.1.force).dot(next.0.translation - last.0.translation)
                + (last.1.torque + next.1.torque).dot(turned));
        whole_j += work_j;
        amounts_j += work_j.abs();
        last = next;
    }
    Work { share: whole_j.abs() / amounts_j, amounts_j }
}
