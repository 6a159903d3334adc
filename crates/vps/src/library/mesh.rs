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
///
/// # Examples
/// ```
/// # use vps::{DVec3, Mesh, Shape};
/// let cube = Mesh::from_shape(&Shape::Box { size_m: DVec3::splat(20e-3) }, 1e-5)?;
/// assert_eq!(cube.triangles().len(), 12);
/// assert!((cube.mass_properties().volume_m3 - 8e-6).abs() < 1e-15);
/// assert!(cube.warnings().is_empty());
/// # Ok::<(), vps::Error>(())
/// ```
#[derive(Debug)]
pub struct Mesh {
    part: Part,
}

impl Mesh {
    /// Reads an OBJ, STL or PLY file, with the features `gltf` and `threemf` those formats too,
    /// whose numbers count `metres_per_unit`: 1e-3 for mm. Cost: linear in the file.
    ///
    /// # Examples
    /// ```
    /// # use vps::Mesh;
    /// # let folder = tempfile::tempdir().unwrap();
    /// # let path = folder.path().join("wedge.obj");
    /// # let text = "v 0 0 0\nv 30 0 0\nv 0 30 0\nv 0 0 30\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";
    /// # std::fs::write(&path, text).unwrap();
    /// let wedge = Mesh::load(&path, 1e-3)?; // the file says `v 30 0 0`, in millimetres
    /// assert_eq!(wedge.bounds().1.x, 30e-3);
    /// assert!(Mesh::load("missing.stl", 1e-3).unwrap_err().to_string().contains("no such file"));
    /// # Ok::<(), vps::Error>(())
    /// ```
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
    /// # Examples
    /// ```
    /// # use vps::{Mesh};
    /// let corners = [[0.0; 3], [30e-3, 0.0, 0.0], [0.0, 30e-3, 0.0], [0.0, 0.0, 30e-3]];
    /// let wedge = Mesh::from_arrays(&corners, &[[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])?;
    /// // A sixth of the cube over its edges.
    /// assert!((wedge.mass_properties().volume_m3 - 30e-3_f64.powi(3) / 6.0).abs() < 1e-15);
    /// assert!(Mesh::from_arrays(&corners, &[[0, 1, 4]]).is_err(), "there is no vertex 4");
    /// # Ok::<(), vps::Error>(())
    /// ```
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
    /// # Examples
    /// ```
    /// # use vps::{Mesh, Shape};
    /// let ring = Mesh::from_shape(&Shape::Torus { major_m: 20e-3, minor_m: 5e-3 }, 1e-5)?;
    /// let volume_m3 = 2.0 * core::f64::consts::PI.powi(2) * 20e-3 * 5e-3 * 5e-3;
    /// assert!((ring.mass_properties().volume_m3 / volume_m3 - 1.0).abs() < 0.01);
    /// assert!(Mesh::from_shape(&Shape::Sphere { radius_m: -1.0 }, 1e-5).is_err());
    /// # Ok::<(), vps::Error>(())
    /// ```
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
    ///
    /// # Examples
    /// ```
    /// # use vps::{DVec3, Mesh, Shape};
    /// let plane = Shape::Plane { x_m: 0.2, y_m: 0.1, thickness_m: 0.01 };
    /// let (low, high) = Mesh::from_shape(&plane, 1e-5)?.bounds();
    /// assert_eq!(low, DVec3::new(-0.1, -0.05, -0.01));
    /// assert_eq!(high, DVec3::new(0.1, 0.05, 0.0));
    /// # Ok::<(), vps::Error>(())
    /// ```
    pub fn bounds(&self) -> (DVec3, DVec3) {
        // Some triangle has an area.
        self.part.mesh.bounds().unwrap_or_default()
    }

    /// Volume, m³, centre of mass, m, and inertia per kilogram, m², of a part of even density; mesh
    /// frame.
    ///
    /// # Examples
    /// ```
    /// # use vps::{DVec3, Mesh, Shape};
    /// let [a, b, c] = [20e-3, 30e-3, 40e-3];
    /// let cuboid = Mesh::from_shape(&Shape::Box { size_m: DVec3::new(a, b, c) }, 1e-5)?;
    /// let mass = cuboid.mass_properties();
    /// assert!((mass.volume_m3 - a * b * c).abs() < 1e-12);
    /// assert!((mass.inertia_per_mass.x_axis.x - (b * b + c * c) / 12.0).abs() < 1e-12);
    /// # Ok::<(), vps::Error>(())
    /// ```
    pub fn mass_properties(&self) -> MassProperties {
        self.part.mass_properties()
    }

    /// What the triangles were taken for: pieces, bodies, cavities, skins. Cost: some inspections of
    /// the mesh for the first call of this, [`Self::mass_properties`] or [`Self::warnings`].
    ///
    /// # Examples
    /// ```
    /// # use vps::{DVec3, Mesh, Shape};
    /// // A ball of 10 mm beside a ball of 5 mm.
    /// # let ball = |radius_m| Mesh::from_shape(&Shape::Sphere { radius_m }, 1e-4);
    /// # let large = ball(10e-3)?;
    /// # let small = ball(5e-3)?;
    /// # let moved = small.vertices().iter().map(|at| *at + DVec3::X * 20e-3);
    /// # let vertices = large.vertices().iter().copied().chain(moved);
    /// # let vertices: Vec<_> = vertices.map(Into::into).collect();
    /// # let n = large.vertices().len() as u32;
    /// # let second = small.triangles().iter().map(|corners| corners.map(|corner| corner + n));
    /// # let triangles: Vec<_> = large.triangles().iter().copied().chain(second).collect();
    /// let balls = Mesh::from_arrays(&vertices, &triangles)?;
    /// assert_eq!((balls.solid().pieces, balls.solid().bodies), (2, 2));
    /// assert!(balls.solid().cavities.is_empty());
    /// # Ok::<(), vps::Error>(())
    /// ```
    pub fn solid(&self) -> &SolidReport {
        self.part.solid()
    }

    /// What a user should look at, a sentence each; empty of a sound mesh.
    ///
    /// # Examples
    /// ```
    /// # use vps::{DVec3, Mesh, Shape};
    /// # let cube = Mesh::from_shape(&Shape::Box { size_m: DVec3::splat(20e-3) }, 1e-5)?;
    /// assert!(cube.warnings().is_empty());
    /// let corners: Vec<_> = cube.vertices().iter().map(|at| at.to_array()).collect();
    /// let open = Mesh::from_arrays(&corners, &cube.triangles()[..10])?; // one face is missing
    /// assert!(!open.warnings().is_empty());
    /// # Ok::<(), vps::Error>(())
    /// ```
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
