//! A mesh that can be baked.

use std::path::Path;

use glam::DVec3;

use super::Error;
use super::error::check;
use crate::mesh::mass::MassProperties;
use crate::mesh::primitives::Shape;
use crate::mesh::{FARTHEST_M, TriangleMesh};
use crate::part::Part;
use crate::solid::SolidReport;
use crate::voxmap::Options;
use crate::voxmap::estimate::Products;
use crate::voxmap::inside_test::InsideTest;

/// Triangles of a part, m, in a frame of their own: the *mesh frame*. They need not be closed; what
/// is wrong with them is in [`warnings`](Self::warnings).
///
/// Vertices are finite and at most 10⁹ m from the origin, indices are in range, and some triangle
/// has an area.
#[derive(Debug)]
pub struct Mesh {
    part: Part,
}

impl Mesh {
    /// Reads an OBJ, STL or PLY file, with the features `gltf` and `threemf` those formats too,
    /// whose numbers count `metres_per_unit`: 1e-3 for mm. Cost: linear in the file.
    ///
    /// # Errors
    /// [`Error::Mesh`], naming the file and where it is known the line; [`Error::Value`].
    pub fn load(path: impl AsRef<Path>, metres_per_unit: f64) -> Result<Self, Error> {
        check(
            "metres_per_unit",
            metres_per_unit,
            1e-12..=1e6,
            "the length of one unit of the file: 0.001 for millimetres",
        )?;
        let path = path.as_ref();
        Ok(Self { part: Part::load(&path.display().to_string(), path, metres_per_unit)? })
    }

    /// A mesh of vertices `[n][3]`, m, and triangles `[m][3]`, numbers of vertices from 0,
    /// counter-clockwise seen from outside. Cost: linear.
    ///
    /// # Errors
    /// [`Error::Arrays`]: no triangle with an area, an index out of range, a coordinate that is not
    /// finite or farther than 10⁹ m from the origin.
    pub fn from_arrays(vertices_m: &[[f64; 3]], triangles: &[[u32; 3]]) -> Result<Self, Error> {
        let refused = |what: String| Err(Error::Arrays { what });
        for (idx, vertex) in vertices_m.iter().enumerate() {
            if !vertex.iter().all(|coordinate| coordinate.abs() <= FARTHEST_M) {
                return refused(format!(
                    "vertex {idx} is {vertex:?}: give metres, finite and at most {FARTHEST_M:e} \
                        from the origin"
                ));
            }
        }
        for (idx, triangle) in triangles.iter().enumerate() {
            if let Some(vertex) =
                triangle.iter().find(|vertex| **vertex as usize >= vertices_m.len())
            {
                let n_vertices = vertices_m.len();
                return refused(format!(
                    "triangle {idx} names vertex {vertex}, there are {n_vertices}: count vertices \
                        from 0"
                ));
            }
        }
        let vertices = vertices_m.iter().map(|vertex| DVec3::from_array(*vertex)).collect();
        Self::of(Part::new(
            "mesh from arrays",
            TriangleMesh { vertices, triangles: triangles.to_vec() },
        ))
    }

    /// A shape around the origin, its triangles no farther than `tolerance_m` from it; a twentieth
    /// of a voxel loses nothing.
    ///
    /// # Errors
    /// [`Error::Value`]: a size or the tolerance is not between 1 nm and 10⁶ m.
    pub fn from_shape(shape: &Shape, tolerance_m: f64) -> Result<Self, Error> {
        for (name, size_m) in shape
            .sizes_m()
            .into_iter()
            .map(|size_m| ("a size of the shape", size_m))
            .chain([("tolerance_m", tolerance_m)])
        {
            check(name, size_m, 1e-9..=1e6, "metres, from 1 nm to 1000 km")?;
        }
        Self::of(Part::new("shape", shape.tessellate(tolerance_m)))
    }

    fn of(part: Part) -> Result<Self, Error> {
        if part.has_area() {
            return Ok(Self { part });
        }
        let n_triangles = part.mesh.triangles.len();
        Err(Error::Arrays {
            what: format!(
                "none of the {n_triangles} triangles has an area: give the surface of the part"
            ),
        })
    }

    /// `[n]`, m, mesh frame.
    pub fn vertices(&self) -> &[DVec3] {
        &self.part.mesh.vertices
    }

    /// `[m]`: numbers of three vertices each.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.part.mesh.triangles
    }

    /// Lowest and highest corner of the box around the triangles, m, mesh frame.
    pub fn bounds(&self) -> (DVec3, DVec3) {
        // Some triangle has an area.
        self.part.mesh.bounds().unwrap_or_default()
    }

    /// Volume, m³, centre of mass, m, and inertia per kilogram, m², of a part of even density; mesh
    /// frame.
    pub fn mass_properties(&self) -> MassProperties {
        self.part.mass_properties()
    }

    /// What the triangles were taken for: pieces, bodies, cavities, skins. Cost: some inspections of
    /// the mesh for the first call of this, [`Self::mass_properties`] or [`Self::warnings`].
    pub fn solid(&self) -> &SolidReport {
        self.part.solid()
    }

    /// What a user should look at, a sentence each; empty of a sound mesh.
    pub fn warnings(&self) -> Vec<String> {
        self.part.mesh_warnings(InsideTest::Auto, None)
    }

    /// The part, where these options can be baked within the memory that the system has left.
    pub(super) fn part_to_bake(
        &self,
        options: &Options,
        products: Products,
    ) -> Result<&Part, Error> {
        check(
            "voxel_size_m",
            options.voxel_size_m,
            1e-9..=1e6,
            "the edge of a voxel in metres, between 1 nm and 1000 km",
        )?;
        // Normals of points look two layers deep, and one layer of a thin skin, whose surface is a
        // voxel away from its middle, would reach nowhere outside.
        check(
            "layers",
            options.layers.into(),
            2.0..=126.0,
            "a number of layers of voxels from 2 to 126",
        )?;
        self.part.fits(options, products)?;
        Ok(&self.part)
    }
}
