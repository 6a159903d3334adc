//! Meshes.

use std::ffi::{CString, c_char, c_int};
use std::mem::MaybeUninit;

use vps::{DVec3, MassProperties, Mesh, Shape};

use crate::border::{
    Failure, call, free, given, lines, make, path, place, places, slice, text, triple, vps_status,
};

/// Triangles of a part, ready to be baked.
pub struct vps_mesh {
    pub(crate) mesh: Mesh,
    warnings: CString,
}

impl From<Mesh> for vps_mesh {
    fn from(mesh: Mesh) -> Self {
        Self { warnings: lines(&mesh.warnings()), mesh }
    }
}

/// A shape around the origin, its axis z, and what its sizes_m are.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum vps_shape {
    /// Edges along x, y and z.
    VPS_BOX = 0,
    /// Radius.
    VPS_SPHERE = 1,
    /// Radius and height.
    VPS_CYLINDER = 2,
    /// Radius of the base and height, apex at +z.
    VPS_CONE = 3,
    /// Radius, and height without the caps.
    VPS_CAPSULE = 4,
    /// Radius of the centre line, and of the tube.
    VPS_TORUS = 5,
}

/// A part of even density, in the mesh frame.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct vps_mass {
    /// m³; 0 of a mesh that bounds no volume, whose mass lies on its surface.
    pub volume_m3: f64,
    /// Centre of mass, m.
    pub center_m: [f64; 3],
    /// Inertia about the centre of mass per kilogram, m², symmetric, row by row.
    pub inertia_m2: [f64; 9],
}

impl From<&MassProperties> for vps_mass {
    fn from(mass: &MassProperties) -> Self {
        Self {
            volume_m3: mass.volume_m3,
            center_m: mass.center_m.to_array(),
            inertia_m2: mass.inertia_per_mass.to_cols_array(),
        }
    }
}

/// `[n][3]`.
type Triples<'a, T> = &'a [[T; 3]];

/// Vertices and triangles, three numbers each.
///
/// # Safety
/// The arrays have three times as many elements.
unsafe fn arrays<'a, T>(
    vertices_m: *const T,
    n_vertices: usize,
    triangles: *const u32,
    n_triangles: usize,
) -> Result<(Triples<'a, T>, Triples<'a, u32>), Failure> {
    // SAFETY: as the caller promises.
    unsafe {
        Ok((
            slice("vertices_m", vertices_m.cast(), n_vertices)?,
            slice("triangles", triangles.cast(), n_triangles)?,
        ))
    }
}

/// Reads an OBJ, STL, PLY, glTF or 3MF file whose numbers count metres_per_unit: 0.001 for
/// millimetres.
///
/// # Safety
/// `file_name`: null, or ends with a zero byte.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vps_mesh_load(
    file_name: *const c_char,
    metres_per_unit: f64,
    out: Option<&mut MaybeUninit<*mut vps_mesh>>,
) -> vps_status {
    // SAFETY: as the caller promises.
    make(out, || Ok(Mesh::load(unsafe { path(file_name) }?, metres_per_unit)?.into()))
}

/// A mesh of vertices `[n_vertices][3]`, m, and triangles `[n_triangles][3]`, numbers of vertices
/// from 0, counter-clockwise seen from outside.
///
/// # Safety
/// The arrays have so many elements.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vps_mesh_from_f64(
    vertices_m: *const f64,
    n_vertices: usize,
    triangles: *const u32,
    n_triangles: usize,
    out: Option<&mut MaybeUninit<*mut vps_mesh>>,
) -> vps_status {
    make(out, || {
        // SAFETY: as the caller promises.
        let (vertices, triangles) =
            unsafe { arrays(vertices_m, n_vertices, triangles, n_triangles) }?;
        Ok(Mesh::from_arrays(vertices, triangles)?.into())
    })
}

/// The same of vertices in single precision.
///
/// # Safety
/// The arrays have so many elements.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vps_mesh_from_f32(
    vertices_m: *const f32,
    n_vertices: usize,
    triangles: *const u32,
    n_triangles: usize,
    out: Option<&mut MaybeUninit<*mut vps_mesh>>,
) -> vps_status {
    make(out, || {
        // SAFETY: as the caller promises.
        let (vertices, triangles) =
            unsafe { arrays(vertices_m, n_vertices, triangles, n_triangles) }?;
        let vertices: Vec<[f64; 3]> = vertices.iter().map(|vertex| vertex.map(f64::from)).collect();
        Ok(Mesh::from_arrays(&vertices, triangles)?.into())
    })
}

/// A shape, its triangles no farther than tolerance_m from it: a twentieth of a voxel loses
/// nothing. shape is a vps_shape; sizes_m has three elements, and those that the shape lacks may
/// have any value.
///
/// # Safety
/// `sizes_m` has three elements.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vps_mesh_shape(
    shape: c_int,
    sizes_m: *const f64,
    tolerance_m: f64,
    out: Option<&mut MaybeUninit<*mut vps_mesh>>,
) -> vps_status {
    use vps_shape::*;
    make(out, || {
        // SAFETY: as the caller promises.
        let [x_m, y_m, z_m] = unsafe { triple("sizes_m", sizes_m) }?;
        let shapes = [
            (VPS_BOX, Shape::Box { size_m: DVec3::new(x_m, y_m, z_m) }),
            (VPS_SPHERE, Shape::Sphere { radius_m: x_m }),
            (VPS_CYLINDER, Shape::Cylinder { radius_m: x_m, height_m: y_m }),
            (VPS_CONE, Shape::Cone { radius_m: x_m, height_m: y_m }),
            (VPS_CAPSULE, Shape::Capsule { radius_m: x_m, height_m: y_m }),
            (VPS_TORUS, Shape::Torus { major_m: x_m, minor_m: y_m }),
        ];
        let known = shapes.into_iter().find(|(known, _)| *known as c_int == shape);
        let (_, shape) = known.ok_or_else(|| {
            Failure::argument(format!("shape is {shape}: give a vps_shape, 0 to 5"))
        })?;
        Ok(Mesh::from_shape(&shape, tolerance_m)?.into())
    })
}

/// Number of vertices and of triangles; either place may be null.
#[unsafe(no_mangle)]
pub extern "C" fn vps_mesh_counts(
    mesh: Option<&vps_mesh>,
    n_vertices: Option<&mut MaybeUninit<usize>>,
    n_triangles: Option<&mut MaybeUninit<usize>>,
) -> vps_status {
    call(|| {
        let mesh = &given("mesh", mesh)?.mesh;
        for (place, n) in
            [(n_vertices, mesh.vertices().len()), (n_triangles, mesh.triangles().len())]
        {
            if let Some(place) = place {
                place.write(n);
            }
        }
        Ok(())
    })
}

/// Lowest and highest corner of the box around the triangles, m.
///
/// # Safety
/// There is room for three numbers in each.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vps_mesh_bounds(
    mesh: Option<&vps_mesh>,
    low_m: *mut f64,
    high_m: *mut f64,
) -> vps_status {
    call(|| {
        let (low, high) = given("mesh", mesh)?.mesh.bounds();
        for (name, first, corner) in [("low_m", low_m, low), ("high_m", high_m, high)] {
            // SAFETY: as the caller promises.
            let places = unsafe { places(name, first, 3) }?;
            places
                .iter_mut()
                .zip(corner.to_array())
                .for_each(|(place, value)| _ = place.write(value));
        }
        Ok(())
    })
}

/// Volume, centre of mass and inertia.
#[unsafe(no_mangle)]
pub extern "C" fn vps_mesh_mass(
    mesh: Option<&vps_mesh>,
    out: Option<&mut MaybeUninit<vps_mass>>,
) -> vps_status {
    call(|| {
        place("out", out)?.write((&given("mesh", mesh)?.mesh.mass_properties()).into());
        Ok(())
    })
}

/// What the triangles of a mesh were taken for.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct vps_solid {
    /// Connected pieces.
    pub n_pieces: usize,
    /// Closed pieces that are material inside; their union, without the cavities, is the solid.
    pub n_bodies: usize,
    /// Closed pieces that face inward inside of bodies and are empty.
    pub n_cavities: usize,
    /// What these enclose together, m³.
    pub cavities_m3: f64,
    /// Pieces that are not closed.
    pub n_open_pieces: usize,
    /// Area of these, m².
    pub open_area_m2: f64,
}

/// What the triangles of a mesh were taken for.
#[unsafe(no_mangle)]
pub extern "C" fn vps_mesh_solid(
    mesh: Option<&vps_mesh>,
    out: Option<&mut MaybeUninit<vps_solid>>,
) -> vps_status {
    call(|| {
        let solid = given("mesh", mesh)?.mesh.solid();
        place("out", out)?.write(vps_solid {
            n_pieces: solid.pieces,
            n_bodies: solid.bodies,
            n_cavities: solid.cavities.len(),
            cavities_m3: solid.cavities.iter().map(|cavity| cavity.volume_m3).sum(),
            n_open_pieces: solid.open_pieces,
            open_area_m2: solid.open_area_m2,
        });
        Ok(())
    })
}

/// What a user should look at, a line each; empty of a sound mesh. Lives as long as the mesh.
#[unsafe(no_mangle)]
pub extern "C" fn vps_mesh_warnings(mesh: Option<&vps_mesh>) -> *const c_char {
    text(mesh.map(|mesh| &mesh.warnings))
}

/// Frees a mesh; what was baked of it stays.
///
/// # Safety
/// Null, or a mesh that nothing uses any more.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vps_mesh_free(mesh: *mut vps_mesh) {
    // SAFETY: as the caller promises.
    unsafe { free(mesh) }
}
