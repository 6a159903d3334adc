//! What an object is baked from, and the key that follows from it.

use std::fmt::Write as _;
use std::io::{self, Read as _};
use std::path::Path;

use glam::DVec3;
use twox_hash::XxHash3_128;

use crate::config::scene::MeshSource;
use vps::mesh;
use vps::part::{Part, PartRole};
use vps::pointshell::Points;
use vps::storage::regular;
use vps::storage::sections::Key;
use vps::voxmap::Options;
use vps::voxmap::estimate::Products;
use vps::voxmap::inside_test::InsideTest;

/// How large a voxel is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Spacing {
    /// s, m.
    Size(f64),
    /// So many on the longest edge of the mesh's box.
    LongestAxis(u32),
}

/// Everything that decides what is baked of an object, and its name.
///
/// Navigation and number of threads are not here: they change no bit.
#[derive(Clone, Debug)]
pub struct Request<'a> {
    /// For messages and the report.
    pub name: &'a str,
    /// Which products are wanted.
    pub role: PartRole,
    /// The mesh file or the shape.
    pub source: &'a MeshSource,
    /// The voxel edge, or what it follows from.
    pub spacing: Spacing,
    /// Layers on each side.
    pub layers: u32,
    /// How inside and outside are distinguished.
    pub sides: InsideTest,
    /// The field holds gradients.
    pub with_gradients: bool,
    /// Which points the shell has.
    pub points: Points,
    /// Origin of the shell, mesh frame, m; `None`: the mesh's own centre of mass.
    pub center_of_mass: Option<DVec3>,
}

impl Request<'_> {
    /// What is to be baked.
    pub fn products(&self) -> Products {
        let Self { role, with_gradients, .. } = *self;
        Products {
            field: role != PartRole::Tool,
            gradients: with_gradients,
            shell: role != PartRole::Static,
        }
    }

    /// How a part is voxelised.
    pub(crate) fn options(&self, part: &Part) -> Options {
        let voxel_size_m = match self.spacing {
            Spacing::Size(voxel_size_m) => voxel_size_m,
            Spacing::LongestAxis(n) => {
                part.mesh.bounds().map_or(0.0, |(low, high)| (high - low).max_element())
                    / f64::from(n.max(1))
            }
        };
        Options { voxel_size_m, layers: self.layers, navigation: None, sides: self.sides }
    }

    /// Hash of all that the result depends on; `None` when the mesh file, or one that it takes
    /// triangles from, cannot be read. Cost: one pass over these files, about 10 GB/s from the page
    /// cache, no memory; of glTF also its JSON text.
    pub(in crate::scene) fn key(&self) -> Option<Key> {
        let Self {
            name: _,
            role,
            source,
            spacing,
            layers,
            sides,
            with_gradients,
            points,
            center_of_mass,
        } = self;
        let mut recipe = String::new();
        // Debug of a float prints as many digits as tell it from its neighbours. Writing to a
        // string cannot fail.
        let _ = match source {
            MeshSource::File { path, metres_per_unit } => {
                let format = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
                let hash = hash_file(path).ok()?;
                for companion in mesh::companions(path).ok()? {
                    let _ = write!(recipe, "{:032x} ", hash_file(&companion).ok()?);
                }
                write!(recipe, "{format} {hash:032x} in units of {metres_per_unit:?} m")
            }
            MeshSource::Shape(shape) => write!(recipe, "{shape:?}"),
        };
        let _ = write!(
            recipe,
            "\n{role:?}\n{spacing:?}\nlayers {layers}\nsides {sides:?}\ngradients \
                {with_gradients}\npoints {points:?}\nabout {center_of_mass:?}\n"
        );
        Some(XxHash3_128::oneshot(recipe.as_bytes()).to_be_bytes())
    }
}

fn hash_file(path: &Path) -> io::Result<u128> {
    let mut file = regular::open(path)?;
    let mut hasher = XxHash3_128::new();
    let mut buffer = vec![0; 1 << 18];
    loop {
        match file.read(&mut buffer) {
            Ok(0) => return Ok(hasher.finish_128()),
            Ok(n) => hasher.write(&buffer[..n]),
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
}
