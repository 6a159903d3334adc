//! Two parts that both move: a peg over a tube, asked for wrench, contacts and clearance; the baked
//! parts kept in files.
//!
//! `cargo run -p vps --example two_parts`
#![expect(clippy::print_stdout, reason = "what an example is for")]

use std::ops::ControlFlow;

use vps::{
    BakeStage, ContactQuery, DQuat, DVec3, Error, Mesh, Options, PointShell, Pose, Shape, Voxmap,
};

pub(crate) fn main() -> Result<(), Error> {
    let options = Options::new(0.4e-3);
    let folder = std::env::temp_dir().join(format!("vps-two-parts-{}", std::process::id()));
    std::fs::create_dir_all(&folder).map_err(|error| Error::File {
        path: folder.clone(),
        what: error.to_string(),
        source: Some(error),
    })?;

    // Progress: each stage says that it begins, and `Break` would end the bake.
    let ring = Mesh::from_shape(&Shape::Torus { major_m: 14e-3, minor_m: 4e-3 }, 2e-5)?;
    let reported = |stage: BakeStage| {
        println!("ring: {stage:?}");
        ControlFlow::Continue(())
    };
    Voxmap::bake_with(&ring, &options, reported)?.save(folder.join("ring.bake"))?;
    PointShell::bake(
        &Mesh::from_shape(&Shape::Cylinder { radius_m: 9.8e-3, height_m: 30e-3 }, 2e-5)?,
        &options,
    )?
    .save(folder.join("peg.bake"))?;

    let ring = Voxmap::load(folder.join("ring.bake"))?;
    let peg = PointShell::load(folder.join("peg.bake"))?;
    let query = ContactQuery::new(&ring, &peg, 500.0)?;

    // Both stand somewhere in the world; the query asks for one in the frame of the other.
    let world_from_ring = Pose::new(DQuat::from_rotation_x(0.3), DVec3::new(0.1, 0.0, 0.2));
    for aside_m in [0.0, 0.3e-3, 0.6e-3] {
        let world_from_peg = world_from_ring * Pose::from_translation(DVec3::X * aside_m);
        let ring_from_peg = world_from_ring.inverse() * world_from_peg;
        let mut deepest_m = 0.0_f64;
        let felt =
            query.contacts(ring_from_peg, |contact| deepest_m = deepest_m.max(contact.depth_m))?;
        let world_force_n = world_from_ring.transform_vector(felt.wrench.force);
        println!(
            "{:.1} mm aside: {:?} N, {} contacts, {:.3} mm deep, {:.3} mm clear",
            aside_m * 1e3,
            world_force_n.to_array().map(|f| (f * 1e3).round() / 1e3),
            felt.contacts,
            deepest_m * 1e3,
            felt.clearance_m * 1e3
        );
    }
    let middle = ring.distance(DVec3::X * 14e-3)?;
    println!("the middle of the tube is {:.2} mm inside", -middle.distance_m * 1e3);
    let _ = std::fs::remove_dir_all(&folder);
    Ok(())
}
