//! The clay as a closed triangle mesh, for rigid scenes.
//!
//! Naive surface nets (the crate `fast-surface-nets`; Gibson 1998): one corner per cell that the
//! surface crosses, at the mean of the crossings on its edges. The mesh is closed wherever the
//! surface stays inside the raster, and lies within a fraction of the spacing of the surface; edges
//! are rounded by about the spacing.
//!
//! Where two nodes across the diagonal of a face of a cell are inside and the other two outside,
//! four sheets would meet in one edge. There the weakest node changes sides first, as the mean of
//! all four says: it moves the surface by less than a spacing, and the mesh is a manifold along its
//! edges.

use std::io::{self, Write};
use std::path::Path;

use fast_surface_nets::ndshape::{RuntimeShape, Shape};
use fast_surface_nets::{SurfaceNetsBuffer, surface_nets};
use glam::DVec3;

use super::ClayModel;
use vps::density::{Lattice, Raster};
use vps::mesh::TriangleMesh;
use vps::storage::whole_file::{Access, write_whole};

/// Density of a node that has changed sides, in spacings.
const SIDE_SPACINGS: f64 = 0.05;
/// Rounds in which material may come as well.
const ROUNDS: u32 = 8;

/// Why densities make no closed mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ExportError {
    /// Nothing is inside.
    #[error("there is no material: every density is below 0, so there is nothing to export")]
    Empty,
    /// The surface leaves the raster.
    #[error(
        "the material reaches the faces of its raster, and a mesh of it would be open; leave more \
            air around the clay"
    )]
    Open,
    /// Too many nodes for the numbers of corners.
    #[error("a raster of {0} nodes has more than a mesh can number")]
    TooLarge(usize),
}

impl ClayModel {
    /// The clay as a closed mesh, map frame, with normals outward. A stroke under way is not part
    /// of it. Cost: O(nodes of the base).
    ///
    /// # Errors
    /// [`ExportError`].
    pub fn mesh(&self) -> Result<TriangleMesh, ExportError> {
        surface_of(self.base())
    }

    /// What is inside of that mesh, m³; `None` where there is none.
    pub fn volume_m3(&self) -> Option<f64> {
        let mesh = self.mesh().ok()?;
        let of = |[a, b, c]: [DVec3; 3]| a.dot(b.cross(c)) / 6.0;
        Some((0..mesh.triangles.len()).map(|triangle| of(mesh.corners(triangle))).sum())
    }
}

/// The surface s = 0 of a raster as a closed mesh.
///
/// # Errors
/// [`ExportError`].
fn surface_of(raster: &Raster) -> Result<TriangleMesh, ExportError> {
    let Lattice { origin_map, spacing_m, dims: [nx, ny, nz] } = *raster.lattice();
    let n_nodes = raster.values_m().len();
    if u32::try_from(n_nodes).is_err() {
        return Err(ExportError::TooLarge(n_nodes));
    }
    let is_face = |n: usize| {
        let x = n / (ny * nz);
        let y = n / nz % ny;
        let z = n % nz;
        // The crate leaves out what crosses the last layer of cells.
        x == 0 || y == 0 || z == 0 || x + 2 >= nx || y + 2 >= ny || z + 2 >= nz
    };
    if raster.values_m().iter().enumerate().any(|(n, value_m)| *value_m >= 0.0 && is_face(n)) {
        return Err(ExportError::Open);
    }
    let mut values_m = raster.values_m().to_vec();
    take_sides(raster.lattice(), &mut values_m);
    // Theirs counts x fastest and has the inside negative. With axes in reverse, corners come out
    // mirrored.
    let shape = RuntimeShape::<u32, 3>::new([nz as u32, ny as u32, nx as u32]);
    let last = shape.as_array().map(|n| n - 1);
    let outside_m: Vec<f32> = values_m.iter().map(|value_m| -value_m).collect();
    let mut buffer = SurfaceNetsBuffer::default();
    surface_nets(&outside_m, &shape, [0; 3], last, &mut buffer);
    if buffer.indices.is_empty() {
        return Err(ExportError::Empty);
    }
    let place = |[z, y, x]: &[f32; 3]| {
        origin_map + DVec3::new(f64::from(*x), f64::from(*y), f64::from(*z)) * spacing_m
    };
    Ok(TriangleMesh {
        vertices: buffer.positions.iter().map(place).collect(),
        triangles: buffer
            .indices
            .chunks_exact(3)
            .map(|corners| [corners[0], corners[2], corners[1]])
            .collect(),
    })
}

/// Settles every face of a cell that is inside at two opposite corners and outside at the others. A
/// node that changes sides may unsettle another face, which has its turn in the next round.
fn take_sides(lattice: &Lattice, values_m: &mut [f32]) {
    let [nx, ny, nz] = lattice.dims;
    let least_m = (SIDE_SPACINGS * lattice.spacing_m) as f32;
    for round in 0.. {
        let mut n_changed = 0;
        for x in 0..nx {
            for y in 0..ny {
                for z in 0..nz {
                    for [u, v] in
                        [[[1, 0, 0], [0, 1, 0]], [[1, 0, 0], [0, 0, 1]], [[0, 1, 0], [0, 0, 1]]]
                    {
                        let far = [x + u[0] + v[0], y + u[1] + v[1], z + u[2] + v[2]];
                        if far[0] >= nx || far[1] >= ny || far[2] >= nz {
                            continue;
                        }
                        let node = |step: [usize; 3]| {
                            lattice.index([x + step[0], y + step[1], z + step[2]])
                        };
                        let [a, b, c, d] =
                            [lattice.index([x, y, z]), node(u), node(v), lattice.index(far)];
                        let is_in = [a, b, c, d].map(|n| values_m[n] >= 0.0);
                        if is_in[0] != is_in[3] || is_in[1] != is_in[2] || is_in[0] == is_in[1] {
                            continue;
                        }
                        let mean_m = 0.25 * [a, b, c, d].iter().map(|n| values_m[*n]).sum::<f32>();
                        // Material that only goes cannot do so for ever.
                        let becomes_in = mean_m >= 0.0 && round < ROUNDS;
                        let changes = if becomes_in == is_in[0] { [b, c] } else { [a, d] };
                        let weakest = if values_m[changes[0]].abs() <= values_m[changes[1]].abs() {
                            changes[0]
                        } else {
                            changes[1]
                        };
                        values_m[weakest] = if becomes_in { least_m } else { -least_m };
                        n_changed += 1;
                    }
                }
            }
        }
        if n_changed == 0 {
            return;
        }
    }
}

/// Writes a mesh as binary little-endian PLY, metres, corners as 64-bit numbers: what
/// [`vps::mesh::load`] reads, and `bake`.
///
/// # Errors
/// Any error of the file system; what was there under that name is there still.
pub fn write_mesh(path: &Path, mesh: &TriangleMesh) -> io::Result<()> {
    write_whole(path, Access::Shared, |file| {
        let n_vertices = mesh.vertices.len();
        let n_triangles = mesh.triangles.len();
        write!(
            file,
            "ply\nformat binary_little_endian 1.0\ncomment clay, metres\nelement vertex \
                {n_vertices}\n"
        )?;
        write!(
            file,
            "property double x\nproperty double y\nproperty double z\nelement face {n_triangles}\n"
        )?;
        writeln!(file, "property list uchar uint vertex_indices\nend_header")?;
        for coordinate in mesh.vertices.iter().flat_map(|vertex| vertex.to_array()) {
            file.write_all(&coordinate.to_le_bytes())?;
        }
        for triangle in &mesh.triangles {
            file.write_all(&[3])?;
            for corner in triangle {
                file.write_all(&corner.to_le_bytes())?;
            }
        }
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    use core::f64::consts::PI;

    use super::*;
    use vps::mesh;
    use vps::mesh::mass::mass_properties;
    use vps::mesh::validate::inspect;

    fn raster(density: impl Fn(DVec3) -> f64) -> Raster {
        let lattice = Lattice {
            origin_map: DVec3::new(-0.012, -0.011, -0.013),
            spacing_m: 5e-4,
            dims: [49, 47, 53],
        };
        let mut raster = Raster::uniform(lattice, 0.0);
        for x in 0..49 {
            for y in 0..47 {
                for z in 0..53 {
                    raster.values_m_mut()[lattice.index([x, y, z])] =
                        density(lattice.position([x, y, z])) as f32;
                }
            }
        }
        raster
    }

    #[test]
    fn a_sphere_is_a_closed_mesh_that_faces_out_where_it_is() {
        let center = DVec3::new(1e-3, -2e-3, 5e-4);
        let mesh = surface_of(&raster(|at| 0.008 - at.distance(center))).unwrap();
        let report = inspect(&mesh);
        assert_eq!(
            (report.open_edges, report.non_manifold_edges, report.inconsistent_edges),
            (0, 0, 0)
        );
        let mass = mass_properties(&mesh);
        let expected = 4.0 / 3.0 * PI * 0.008_f64.powi(3);
        assert!((mass.volume_m3 / expected - 1.0).abs() < 0.01, "{} of {expected}", mass.volume_m3);
        assert!(mass.center_m.distance(center) < 1e-5, "{}", mass.center_m);
        let signed: f64 = (0..mesh.triangles.len())
            .map(|n| {
                let [a, b, c] = mesh.corners(n);
                a.dot(b.cross(c)) / 6.0
            })
            .sum();
        assert!(signed > 0.0, "the triangles face inward");
    }

    #[test]
    fn sheets_that_nearly_meet_share_no_edge() {
        // Spheres in a lattice that touch or nearly do, in all directions, at places that no node
        // knows of.
        for (n, apart_m) in [5.9e-3, 6.0e-3, 6.1e-3, 6.3e-3].into_iter().enumerate() {
            let middle = |x: f64, y: f64, z: f64| {
                DVec3::new(x, y, z) * apart_m + DVec3::new(1.3e-4, 0.7e-4, 2.1e-4) * n as f64
            };
            let all = [-1.0, 0.0, 1.0]
                .map(|x| [-1.0, 0.0, 1.0].map(|y| [-0.9, 0.0, 0.9].map(|z| middle(x, y, z))));
            let density = |at: DVec3| {
                all.iter()
                    .flatten()
                    .flatten()
                    .map(|middle| 3e-3 - at.distance(*middle))
                    .fold(-1.0, f64::max)
            };
            let mesh = surface_of(&raster(density)).unwrap();
            let report = inspect(&mesh);
            assert_eq!(
                (report.open_edges, report.non_manifold_edges, report.inconsistent_edges),
                (0, 0, 0),
                "{apart_m} m"
            );
            // Checkerboards meet everywhere.
            let mut noise = n as u32 + 1;
            let mut raster = raster(|_| -1.0);
            let lattice = *raster.lattice();
            for x in 1..47 {
                for y in 1..45 {
                    for z in 1..51 {
                        noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                        raster.values_m_mut()[lattice.index([x, y, z])] =
                            f64::from(noise >> 8) as f32 / (1 << 23) as f32 * 1e-3 - 1e-3;
                    }
                }
            }
            let report = inspect(&surface_of(&raster).unwrap());
            assert_eq!((report.open_edges, report.non_manifold_edges), (0, 0));
        }
    }

    #[test]
    fn a_file_of_it_is_read_back_as_it_was() {
        let written = surface_of(&raster(|at| 0.006 - at.length())).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("piece.ply");
        write_mesh(&path, &written).unwrap();
        let read = mesh::load(&path, 1.0).unwrap();
        assert_eq!((read.vertices, read.triangles), (written.vertices, written.triangles));
    }

    #[test]
    fn what_makes_no_closed_mesh_is_refused() {
        assert_eq!(surface_of(&raster(|_| -1.0)).unwrap_err(), ExportError::Empty);
        assert_eq!(surface_of(&raster(|at| at.x)).unwrap_err(), ExportError::Open);
    }
}
