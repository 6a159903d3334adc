//! From two meshes to a wrench: a ball a quarter of a millimetre deep in a block.
//!
//! `cargo run -p vps --example query [BLOCK.stl BALL.stl]`, files in millimetres.
#![expect(clippy::print_stdout, reason = "what an example is for")]

use vps::{ContactQuery, DVec3, Error, Mesh, Options, PointShell, Pose, Shape, Voxmap};

pub(crate) fn main() -> Result<(), Error> {
    let files: Vec<String> =
        std::env::args().skip(1).filter(|name| name.ends_with(".stl")).collect();
    let (block, ball) = match files.as_slice() {
        [block, ball] => (Mesh::load(block, 1e-3)?, Mesh::load(ball, 1e-3)?),
        _ => (
            Mesh::from_shape(&Shape::Box { size_m: DVec3::splat(40e-3) }, 1e-5)?,
            Mesh::from_shape(&Shape::Sphere { radius_m: 10e-3 }, 1e-5)?,
        ),
    };
    let options = Options::new(0.5e-3);
    let query = ContactQuery::new(
        &Voxmap::bake(&block, &options)?,
        &PointShell::bake(&ball, &options)?,
        1000.0,
    )?;
    let felt = query.wrench(Pose::from_translation(DVec3::Z * 29.75e-3))?;
    println!(
        "force {} N, torque {} N·m, {} m deep, {} points",
        felt.wrench.force, felt.wrench.torque, felt.penetration_m, felt.contacts
    );
    Ok(())
}
