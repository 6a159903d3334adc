//! Makes the parts and hand paths of the shipped scenes.
//!
//! ```text
//! cargo run --release --example make_parts -- config
//! ```
//!
//! writes `config/models/*`, `config/scenes/hands/*.csv` and `config/clay/hands/*.csv`. The files
//! are committed; `cargo test --example make_parts` proves that they are what this program writes,
//! byte for byte, and that the parts are sound: closed, oriented outward, of the right size and
//! volume, and with the clearances that the scenes rely on.
//!
//! | module | makes |
//! |---|---|
//! | [`mesh`] | welded triangles, binary STL and OBJ |
//! | [`loft`] | solids from stacks of rings with equal point count |
//! | [`parts`] | peg, block, plate with shaft, gears, bolt, nut |
//! | [`gear`] | involute outlines |
//! | [`thread`] | ISO 68-1 thread surfaces |
//! | [`image`] | grey images that are embossed |
//! | [`hand`] | minimum-jerk paths of the simulated hand |
//! | [`clay`] | the bowl, and the hands that work clay |
//!
//! Geometry is in millimetres, in the files too. Nothing is random, so there is no seed: every
//! coordinate is rounded to 10 nm ([`mesh::GRID_PER_MM`]), which is far coarser than what
//! mathematical libraries of different machines disagree about.

#![expect(clippy::print_stdout, reason = "an example says what it wrote")]

mod clay;
mod gear;
mod hand;
mod image;
mod loft;
mod mesh;
mod parts;
#[cfg(test)]
mod tests;
mod thread;

use std::io::Error;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Every file that the generator owns: path below the configuration folder, and content.
fn outputs() -> Vec<(&'static str, Vec<u8>)> {
    vec![
        (
            "models/peg.obj",
            parts::peg().to_obj("peg: round, diameter 8.0 mm, tip face at z = 0, axis z"),
        ),
        (
            "models/block-hole.obj",
            parts::block_hole()
                .to_obj("block with a blind hole: diameter 8.1 mm, 20 mm deep, top face at z = 0"),
        ),
        (
            "models/block-plugged.obj",
            parts::block_plugged().to_obj("the block of block-hole.obj without its hole"),
        ),
        (
            "models/gear-base.obj",
            parts::gear_base()
                .to_obj("plate with a shaft: diameter 8.0 mm along z, plate top at z = 0"),
        ),
        (
            "models/gear-fixed.stl",
            parts::gear_fixed().to_stl("gear, module 1.25 mm, 30 teeth, on a hub"),
        ),
        (
            "models/gear-tool.stl",
            parts::gear_tool().to_stl("gear, module 1.25 mm, 20 teeth, bore 8.2 mm"),
        ),
        (
            "models/bolt-m16.stl",
            parts::bolt().to_stl("bolt M16 x 2, hexagon head at z = 0, tip at z = 40"),
        ),
        ("models/nut-m16.stl", parts::nut().to_stl("nut M16 x 2, radial clearance 0.15 mm")),
        ("models/bowl.obj", clay::bowl().to_obj("bowl: walls 4 mm, foot at z = 0, axis z")),
        ("models/letter-h.png", image::letter().to_png()),
        ("models/continents.png", image::continents().to_png()),
        ("clay/hands/letter.csv", clay::letter().to_csv()),
        ("clay/hands/character.csv", clay::character().to_csv()),
        ("clay/hands/globe.csv", clay::globe().to_csv()),
        ("clay/hands/bowl.csv", clay::around_the_bowl().to_csv()),
        ("scenes/hands/peg-in-hole.csv", hand::peg_in_hole().to_csv()),
        ("scenes/hands/gear-on-shaft.csv", hand::gear_on_shaft().to_csv()),
        ("scenes/hands/nut-on-bolt.csv", hand::nut_on_bolt().to_csv()),
        ("scenes/hands/nut-press.csv", hand::nut_press().to_csv()),
        ("scenes/hands/block-on-plane.csv", hand::block_on_plane().to_csv()),
    ]
}

fn write_all(config_dir: &Path) -> Result<(), (PathBuf, Error)> {
    for (name, content) in outputs() {
        let path = config_dir.join(name);
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder).map_err(|error| (folder.to_owned(), error))?;
        }
        std::fs::write(&path, &content).map_err(|error| (path.clone(), error))?;
        println!("{:>9} bytes  {}", content.len(), path.display());
    }
    Ok(())
}

fn main() -> ExitCode {
    let mut arguments = std::env::args_os().skip(1);
    let (Some(config_dir), None) = (arguments.next(), arguments.next()) else {
        println!(
            "usage: make_parts CONFIG_DIR   (writes CONFIG_DIR/models and the hands of \
                CONFIG_DIR/scenes and clay)"
        );
        return ExitCode::from(2);
    };
    match write_all(Path::new(&config_dir)) {
        Ok(()) => ExitCode::SUCCESS,
        Err((path, error)) => {
            println!("cannot write {}: {error}", path.display());
            ExitCode::FAILURE
        }
    }
}
