//! From a mesh file to its voxmap, and nothing more: what table 1 of the paper of 2008 takes the
//! time of.
//!
//! `cargo run --release -p vps --example voxmap [PART.stl VOXEL_MM]`, files in millimetres.
#![expect(clippy::print_stdout, reason = "what an example is for")]

use std::error::Error;
use std::path::Path;

use vps::Shape;
use vps::part::Part;
use vps::voxmap::Options;

pub(crate) fn main() -> Result<(), Box<dyn Error>> {
    let asked: Vec<String> = std::env::args().skip(1).collect();
    let (part, voxel_size_mm) = match asked.as_slice() {
        [path, voxel_size_mm] if path.ends_with(".stl") => {
            (Part::load("part", Path::new(path), 1e-3)?, voxel_size_mm.parse()?)
        }
        _ => (Part::of_shape("ball", &Shape::Sphere { radius_m: 10e-3 }, 0.5e-3), 0.5),
    };
    let map = part.voxmap(&Options::new(voxel_size_mm * 1e-3), |_| {})?;
    let [nx, ny, nz] = map.surface.grid.dims;
    println!(
        "{nx} × {ny} × {nz} voxels, {} of them surface, {} inside",
        map.surface.n_voxels,
        map.sides.count_inside(&map.surface)
    );
    Ok(())
}
