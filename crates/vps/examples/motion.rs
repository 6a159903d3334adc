//! A peg over two parts of one world: how far the nearest is, where a motion first touches, and what
//! presses a little deeper.
//!
//! `cargo run -p vps --example motion`
#![expect(clippy::print_stdout, reason = "what an example is for")]

use vps::{ContactQuery, DQuat, DVec3, Error, Mesh, Options, PointShell, Pose, Shape, Voxmap};

pub(crate) fn main() -> Result<(), Error> {
    let options = Options::new(0.5e-3);
    let bake = |size_m| Voxmap::bake(&Mesh::from_shape(&Shape::Box { size_m }, 1e-5)?, &options);
    let plate = bake(DVec3::new(60e-3, 60e-3, 10e-3))?;
    let rail = bake(DVec3::new(10e-3, 60e-3, 20e-3))?;
    let peg = Mesh::from_shape(&Shape::Box { size_m: DVec3::new(8e-3, 8e-3, 40e-3) }, 1e-5)?;

    // The top of the plate is z = 0; the rail stands on it.
    let parts = [
        (&plate, Pose::from_translation(DVec3::new(0.0, 0.0, -5e-3))),
        (&rail, Pose::from_translation(DVec3::new(20e-3, 0.0, 10e-3))),
    ];
    let query = ContactQuery::of_parts(&parts, &PointShell::bake(&peg, &options)?, 1000.0)?;

    let above = Pose::from_translation(DVec3::new(9e-3, 0.0, 22e-3));
    if let Some(nearest) = query.nearest(above)? {
        println!(
            "{:.2} mm from part {} at {:.2} mm",
            nearest.distance_m * 1e3,
            nearest.part,
            nearest.on_part_m * 1e3
        );
    }
    // Down, over to the rail, and a little turned.
    let end = Pose::new(DQuat::from_rotation_y(0.05), DVec3::new(12e-3, 0.0, 19e-3));
    let Some(impact) = query.first_contact(above, end, 1e-6)? else {
        println!("nothing in the way");
        return Ok(());
    };
    println!("touches after {:.1} % of the motion", impact.share * 100.0);
    for patch in query.patches(end)? {
        println!(
            "part {} pushes with {:.2} N, {:.2} mm deep, around {:.1} mm",
            patch.part,
            patch.force_n,
            patch.depth_m * 1e3,
            patch.position_m * 1e3
        );
    }
    Ok(())
}
