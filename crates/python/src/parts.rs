//! Meshes and baked parts.

use std::collections::HashMap;
use std::path::PathBuf;
use std::sync::Arc;

use glam::DVec3;
use pyo3::PyTypeInfo;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyString};
use vps::parallel;
use vps::pointshell::shell::{LANES, Lanes, Lanes3};
use vps::voxmap::Options;
use vps::voxmap::field::APRON_EDGE;
use vps::{Accuracy, FieldKind, Points};

use crate::arrays;
use crate::errors::{InvalidInput, raise, warn};
use crate::pool;

/// Points that one task looks up.
const POINTS_PER_TASK: usize = 1024;

// Signatures and stubs show the number itself.
const _: () = assert!(Options::DEFAULT_LAYERS == 8);

fn by_name(accuracy: &Accuracy) -> HashMap<&'static str, Option<f64>> {
    Accuracy::NAMES.into_iter().zip(accuracy.figures()).collect()
}

fn options(voxel_size_m: f64, layers: i64) -> PyResult<Options> {
    let layers = u32::try_from(layers).map_err(|_| {
        InvalidInput::new_err(format!(
            "layers is {layers}: give a number of layers of voxels from 2 to 126"
        ))
    })?;
    Ok(Options { layers, ..Options::new(voxel_size_m) })
}

/// What a scene calls by this name.
pub(crate) fn named<T: Copy>(
    argument: &str,
    names: &[(&'static str, T)],
    name: &str,
) -> PyResult<T> {
    let found = names.iter().find(|(known, _)| *known == name);
    found.map(|(_, value)| *value).ok_or_else(|| {
        let known: Vec<_> = names.iter().map(|(known, _)| format!("{known:?}")).collect();
        InvalidInput::new_err(format!("{argument} is {name:?}: give {}", known.join(" or ")))
    })
}

/// What `__reduce__` gives of a baked part.
fn unpickled<'py, Part: PyTypeInfo>(py: Python<'py>, bytes: &[u8]) -> PyResult<Bound<'py, PyAny>> {
    let from_bytes = Part::type_object(py).getattr("_from_bytes")?;
    Ok((from_bytes, (PyBytes::new(py, bytes),)).into_pyobject(py)?.into_any())
}

fn vector<'py>(vector: DVec3, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
    arrays::numbers(&vector.to_array(), &[3], py)
}

/// Triangles of a part, in metres and in a frame of their own, the mesh frame. They need not be
/// closed.
///
/// Mesh(vertices, faces): vertices (n, 3), m; faces (m, 3), whole numbers: vertices from 0,
/// counter-clockwise seen from outside. Both are copied. Raises InvalidInput: a wrong shape or
/// dtype, an index out of range, a coordinate that is not finite or farther than 1e9 m from the
/// origin, no triangle with an area. Cost: linear.
///
///     >>> corners = [[0, 0, 0], [0.03, 0, 0], [0, 0.03, 0], [0, 0, 0.03]]
///     >>> wedge = Mesh(corners, [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
///     >>> round(wedge.volume_m3 * 1e6, 6)  # cm³: a sixth of the cube over its edges
///     4.5
///     >>> wedge.warnings
///     []
#[pyclass(frozen, module = "hapticd_vps")]
pub(crate) struct Mesh {
    mesh: Arc<vps::Mesh>,
}

#[pymethods]
impl Mesh {
    #[new]
    fn new(
        py: Python<'_>,
        vertices: &Bound<'_, PyAny>,
        faces: &Bound<'_, PyAny>,
    ) -> PyResult<Self> {
        let (vertices, _) = arrays::points(vertices, "vertices")?;
        let faces = arrays::faces(faces)?;
        let mesh = py.detach(|| vps::Mesh::from_arrays(&vertices, &faces)).map_err(raise)?;
        Ok(Self { mesh: Arc::new(mesh) })
    }

    /// Reads an OBJ, STL, PLY, glTF or 3MF file whose numbers count `metres_per_unit`: 1e-3 for
    /// millimetres.
    ///
    /// Raises FileError where the file cannot be read, InvalidInput where its content is no mesh.
    /// Cost: linear in the file.
    ///
    ///     >>> size = (folder / "one.obj").write_text("v 0 0 0\nv 30 0 0\nv 0 30 0\nf 1 2 3\n")
    ///     >>> Mesh.load(folder / "one.obj", 1e-3).vertices.max()
    ///     0.03
    #[staticmethod]
    #[pyo3(signature = (path, metres_per_unit))]
    fn load(py: Python<'_>, path: PathBuf, metres_per_unit: f64) -> PyResult<Self> {
        let mesh = py.detach(|| vps::Mesh::load(path, metres_per_unit)).map_err(raise)?;
        Ok(Self { mesh: Arc::new(mesh) })
    }

    /// (n, 3) float64, m, mesh frame: a read-only view.
    #[getter]
    fn vertices<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        arrays::view(
            &self.mesh,
            |mesh| mesh.vertices(),
            &[self.mesh.vertices().len(), 3],
            "=f8",
            py,
        )
    }

    /// (m, 3) uint32: numbers of vertices, a read-only view.
    #[getter]
    fn faces<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        arrays::view(
            &self.mesh,
            |mesh| mesh.triangles(),
            &[self.mesh.triangles().len(), 3],
            "=u4",
            py,
        )
    }

    /// Volume, m³; 0 of a mesh that bounds none.
    #[getter]
    fn volume_m3(&self) -> f64 {
        self.mesh.mass_properties().volume_m3
    }

    /// (3,), m, mesh frame: centre of mass of a part of even density; of its surface where it
    /// bounds no volume.
    #[getter]
    fn center_of_mass_m<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        vector(self.mesh.mass_properties().center_m, py)
    }

    /// Connected pieces.
    #[getter]
    fn n_pieces(&self) -> usize {
        self.mesh.solid().pieces
    }

    /// Closed pieces that are material inside; their union, without the cavities, is the solid.
    #[getter]
    fn n_bodies(&self) -> usize {
        self.mesh.solid().bodies
    }

    /// Volumes of closed pieces that face inward inside of bodies and are empty, m³.
    #[getter]
    fn cavities_m3(&self) -> Vec<f64> {
        self.mesh.solid().cavities.iter().map(|cavity| cavity.volume_m3).collect()
    }

    /// Pieces that are not closed.
    #[getter]
    fn n_open_pieces(&self) -> usize {
        self.mesh.solid().open_pieces
    }

    /// What a user should look at, a sentence each; empty of a sound mesh.
    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.mesh.warnings()
    }

    /// Pickles by its arrays: the parts that are baked of it are the same to the bit.
    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let copied = |view: Bound<'py, PyAny>| view.call_method0("copy");
        let arrays = (copied(self.vertices(py)?)?, copied(self.faces(py)?)?);
        Ok((Self::type_object(py), arrays).into_pyobject(py)?.into_any())
    }

    fn __repr__(&self) -> String {
        format!(
            "<Mesh of {} vertices, {} faces>",
            self.mesh.vertices().len(),
            self.mesh.triangles().len()
        )
    }
}

/// The part that is touched: signed distances on a sparse grid around its surface, mesh frame. It
/// never changes; threads may share it.
///
///     >>> round(block.distance([0, 0, 0.012])[0], 6)  # 2 mm above the block
///     0.002
#[pyclass(frozen, module = "hapticd_vps")]
pub(crate) struct Voxmap {
    pub(crate) voxmap: Arc<vps::Voxmap>,
}

#[pymethods]
impl Voxmap {
    /// Bakes a mesh with voxels of this edge, m, and so many layers of them on each side of the
    /// surface (2 to 126).
    ///
    /// progress: called with the name of each stage ("surface", "fill", "layers", "distance",
    /// "field", "report") before it begins and the share of the bake that is over, which grows from
    /// 0, by what stages take of other parts; at last with "done" and 1. An exception that it
    /// raises, or Ctrl-C, is raised at once; threads go on until the current stage is over. field:
    /// of the queries that the voxmap is for; "surface-point" takes 2.5 times the memory. Warns
    /// with each sentence of `warnings`. Raises InvalidInput: an option out of range, more voxels
    /// than memory holds. Cost: time and memory follow layers x area / voxel size²; all processors;
    /// the same bits for any number of threads.
    ///
    ///     >>> round(Voxmap.bake(cube_mesh, 1e-3, layers=4).band_m, 6)  # 3.5 voxels
    ///     0.0035
    ///     >>> stages = []
    ///     >>> shell = Voxmap.bake(cube_mesh, 1e-3, progress=lambda *stage: stages.append(stage))
    ///     >>> stages[-1]
    ///     ('done', 1.0)
    #[staticmethod]
    #[pyo3(signature = (mesh, voxel_size_m, *, layers = 8, field = "trilinear", progress = None))]
    fn bake(
        py: Python<'_>,
        mesh: &Mesh,
        voxel_size_m: f64,
        layers: i64,
        field: &str,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let options = options(voxel_size_m, layers)?;
        let field = named("field", &FieldKind::NAMES, field)?;
        let mesh = Arc::clone(&mesh.mesh);
        let voxmap = pool::bake(py, progress, move |watch| {
            vps::Voxmap::bake_for(&mesh, &options, field, watch)
        })?;
        warn(py, voxmap.warnings())?;
        Ok(Self { voxmap: Arc::new(voxmap) })
    }

    /// Reads a file of `save`. Raises FileError: no such file, or one that is damaged or holds
    /// something else.
    ///
    ///     >>> Voxmap.load(folder / "missing")
    ///     Traceback (most recent call last):
    ///     FileError: ...
    #[staticmethod]
    fn load(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let voxmap = py.detach(|| vps::Voxmap::load(path)).map_err(raise)?;
        Ok(Self { voxmap: Arc::new(voxmap) })
    }

    /// Writes a file that appears whole or not at all; `load` gives the same bits. Raises
    /// FileError.
    ///
    ///     >>> block.save(folder / "block.voxmap")
    ///     >>> Voxmap.load(folder / "block.voxmap").bricks.tobytes() == block.bricks.tobytes()
    ///     True
    fn save(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        py.detach(|| self.voxmap.save(path)).map_err(raise)
    }

    /// Pickles by the bytes of a file of `save`.
    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        unpickled::<Self>(py, &py.detach(|| self.voxmap.to_bytes()))
    }

    /// What `pickle` calls.
    #[staticmethod]
    fn _from_bytes(py: Python<'_>, bytes: &[u8]) -> PyResult<Self> {
        let voxmap = py.detach(|| vps::Voxmap::from_bytes(bytes)).map_err(raise)?;
        Ok(Self { voxmap: Arc::new(voxmap) })
    }

    /// Distances and gradients at points (n, 3) or (3,), m, mesh frame: two arrays, (n,) and (n,
    /// 3); a float and (3,) of one point.
    ///
    /// Distances in m: greater than 0 outside, less than 0 inside, never beyond `band_m`. Gradients
    /// point away from the surface outside and to it inside, about 1 long, 0 beyond the band.
    /// Raises InvalidInput: a coordinate that is not finite. Cost: some tens of nanoseconds for
    /// each point on each processor.
    ///
    ///     >>> distances, gradients = block.distance([[0, 0, 0.012], [0, 0, 0.009]])
    ///     >>> distances.round(6).tolist()
    ///     [0.002, -0.001]
    ///     >>> gradients.round(3)[:, 2].tolist()  # to the surface inside, away from it outside
    ///     [1.0, 1.0]
    fn distance<'py>(
        &self,
        py: Python<'py>,
        points: &Bound<'py, PyAny>,
    ) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
        let (points, is_single) = arrays::points(points, "points")?;
        let look_up = |index: usize| match points.get(index) {
            Some(point) => {
                self.voxmap.distance(DVec3::from_array(*point)).map_err(|error| (index, error))
            }
            None => Ok(vps::Distance { distance_m: 0.0, gradient: DVec3::ZERO }),
        };
        let n = points.len();
        let found = if n <= POINTS_PER_TASK {
            py.detach(|| (0..n).map(look_up).collect())
        } else {
            let pool = pool::pool(py)?;
            py.detach(|| pool.install(|| parallel::map(n, POINTS_PER_TASK, look_up)))
        };
        let found: Vec<vps::Distance> = found
            .into_iter()
            .collect::<Result<_, _>>()
            .map_err(|(index, error)| InvalidInput::new_err(format!("point {index}: {error}")))?;
        let distances: Vec<f64> = found.iter().map(|found| found.distance_m).collect();
        let gradients: Vec<[f64; 3]> =
            found.iter().map(|found| found.gradient.to_array()).collect();
        if is_single {
            let distance_m = distances.first().copied().unwrap_or(f64::NAN);
            return Ok((
                distance_m.into_pyobject(py)?.into_any(),
                arrays::numbers(&gradients, &[3], py)?,
            ));
        }
        Ok((arrays::numbers(&distances, &[n], py)?, arrays::numbers(&gradients, &[n, 3], py)?))
    }

    /// Edge of a voxel, m.
    #[getter]
    fn voxel_size_m(&self) -> f64 {
        self.voxmap.voxel_size_m()
    }

    /// How far outside the surface distances are known, m.
    #[getter]
    fn band_m(&self) -> f64 {
        self.voxmap.band_m()
    }

    /// (3,), m, mesh frame: lowest corner of the voxel [0, 0, 0].
    #[getter]
    fn origin_m<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        vector(self.voxmap.field().origin_map().as_dvec3(), py)
    }

    /// (nx, ny, nz) uint32: which of `bricks` holds the 8³ voxels of each place of the grid;
    /// `FAR_OUTSIDE` or `DEEP_INSIDE` where no surface is near. A read-only view.
    #[getter]
    fn brick_index<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        arrays::view(
            &self.voxmap,
            |voxmap| voxmap.field().top(),
            &self.voxmap.field().brick_dims(),
            "=u4",
            py,
        )
    }

    /// (n, 9, 9, 9) float32: depth at the centres of voxels, m, greater than 0 **inside**; the
    /// ninth of each axis is the first of the next brick. A new array each time.
    #[getter]
    fn bricks<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let field = self.voxmap.field();
        let shape = [field.n_bricks(), APRON_EDGE, APRON_EDGE, APRON_EDGE];
        let bricks: Vec<_> =
            (0..field.n_bricks()).filter_map(|slot| field.distances_m(slot)).collect();
        arrays::array(&bricks, &shape, PyString::new(py, "=f4").as_any())
    }

    /// Mark in `brick_index`: all voxels of this place are outside, farther than the band.
    #[classattr]
    const FAR_OUTSIDE: u32 = vps::voxmap::field::FAR_OUTSIDE;

    /// Mark in `brick_index`: all voxels of this place are inside, deeper than the band.
    #[classattr]
    const DEEP_INSIDE: u32 = vps::voxmap::field::DEEP_INSIDE;

    /// What the bake measured, by name, m and degrees; None: not measured of this kind.
    /// sample_error_m: largest error of the stored distances; surface_error_m: how far off the
    /// surface is felt, largest at edges; unseen_depth_m: how deep a flat face is entered before a
    /// point touches; thinnest_wall_m; sharpest_edge_deg: of the material.
    #[getter]
    fn accuracy(&self) -> HashMap<&'static str, Option<f64>> {
        by_name(self.voxmap.accuracy())
    }

    /// What a user should know of the bake, a sentence each: holes, leaks, skins thinner than a
    /// voxel.
    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.voxmap.warnings().to_vec()
    }

    /// Size of the arrays, bytes.
    #[getter]
    fn nbytes(&self) -> usize {
        self.voxmap.heap_bytes()
    }

    fn __repr__(&self) -> String {
        format!(
            "<Voxmap, voxels of {:.4} mm, {} bytes>",
            1e3 * self.voxmap.voxel_size_m(),
            self.voxmap.heap_bytes()
        )
    }
}

/// The part that touches: points on its surface with inward normals. It never changes; threads may
/// share it. `len` is the number of points.
///
///     >>> cube.center_of_mass_m.round(6).tolist()  # of 10 mm, in a frame at its corner
///     [0.005, 0.005, 0.005]
#[pyclass(frozen, module = "hapticd_vps")]
pub(crate) struct PointShell {
    pub(crate) shell: Arc<vps::PointShell>,
}

/// Three coordinates of points in blocks of 16, (blocks, 3, 16), as (blocks, 16, 3).
fn by_point<'py>(blocks: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
    blocks.call_method1("transpose", (0, 2, 1))
}

impl PointShell {
    fn vectors<'py>(
        &self,
        memory: fn(&vps::PointShell) -> &[Lanes3],
        py: Python<'py>,
    ) -> PyResult<Bound<'py, PyAny>> {
        by_point(&arrays::view(
            &self.shell,
            memory,
            &[memory(&self.shell).len(), 3, LANES],
            "=f4",
            py,
        )?)
    }
}

#[pymethods]
impl PointShell {
    /// Bakes a mesh: a point for each facet of the surface in each voxel of this edge, m.
    ///
    /// Arguments, errors and cost as of `Voxmap.bake`; the stages are "surface", "fill", "layers",
    /// "pointshell" and "report". points: "facets", or "voxels" of the surface, all alike.
    ///
    ///     >>> # 11³ voxels without the 9³ inside
    ///     >>> len(PointShell.bake(cube_mesh, 1e-3, points="voxels"))
    ///     602
    #[staticmethod]
    #[pyo3(signature = (mesh, voxel_size_m, *, layers = 8, points = "facets", progress = None))]
    fn bake(
        py: Python<'_>,
        mesh: &Mesh,
        voxel_size_m: f64,
        layers: i64,
        points: &str,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let options = options(voxel_size_m, layers)?;
        let points = named("points", &Points::NAMES, points)?;
        let mesh = Arc::clone(&mesh.mesh);
        let shell = pool::bake(py, progress, move |watch| {
            vps::PointShell::bake_of(&mesh, &options, points, watch)
        })?;
        warn(py, shell.warnings())?;
        Ok(Self { shell: Arc::new(shell) })
    }

    /// Reads a file of `save`. Raises FileError: no such file, or one that is damaged or holds
    /// something else.
    ///
    ///     >>> block.save(folder / "block.voxmap")
    ///     >>> PointShell.load(folder / "block.voxmap")  # a voxmap is another file
    ///     Traceback (most recent call last):
    ///     FileError: ...
    #[staticmethod]
    fn load(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let shell = py.detach(|| vps::PointShell::load(path)).map_err(raise)?;
        Ok(Self { shell: Arc::new(shell) })
    }

    /// Writes a file that appears whole or not at all; `load` gives the same bits. Raises
    /// FileError.
    ///
    ///     >>> cube.save(folder / "cube.shell")
    ///     >>> len(PointShell.load(folder / "cube.shell")) == len(cube)
    ///     True
    fn save(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        py.detach(|| self.shell.save(path)).map_err(raise)
    }

    /// Pickles by the bytes of a file of `save`.
    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        unpickled::<Self>(py, &py.detach(|| self.shell.to_bytes()))
    }

    /// What `pickle` calls.
    #[staticmethod]
    fn _from_bytes(py: Python<'_>, bytes: &[u8]) -> PyResult<Self> {
        let shell = py.detach(|| vps::PointShell::from_bytes(bytes)).map_err(raise)?;
        Ok(Self { shell: Arc::new(shell) })
    }

    fn __len__(&self) -> usize {
        self.shell.len()
    }

    /// (blocks, 16, 3) float32: points about the centre of mass, axes of the mesh frame, m. Point i
    /// is [i // 16, i % 16]; places after the last point are NaN. A read-only view; `reshape(-1,
    /// 3)[:len(shell)]` copies it.
    #[getter]
    fn positions_m<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.vectors(|shell| shell.shell().positions(), py)
    }

    /// (blocks, 16, 3) float32: unit normals that point into the part, laid out as `positions_m`. A
    /// read-only view.
    #[getter]
    fn normals<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.vectors(|shell| shell.shell().normals(), py)
    }

    /// (blocks, 2, 16, 3) float32, m: half axes of the rectangle that each facet counts as, zero of
    /// points without extent; laid out as `positions_m`. A read-only view.
    #[getter]
    fn half_axes_m<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let memory: fn(&vps::PointShell) -> &[[Lanes3; 2]] = |shell| shell.shell().half_axes();
        let shape = [memory(&self.shell).len(), 2, 3, LANES];
        arrays::view(&self.shell, memory, &shape, "=f4", py)?
            .call_method1("transpose", ((0, 1, 3, 2),))
    }

    /// (blocks, 16) float32: area that each point stands for, in squares of the voxel edge; 0 of
    /// probes on edges and corners. A read-only view.
    #[getter]
    fn weights<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let memory: fn(&vps::PointShell) -> &[Lanes] = |shell| shell.shell().weights();
        arrays::view(&self.shell, memory, &[memory(&self.shell).len(), LANES], "=f4", py)
    }

    /// (3,), m, mesh frame: centre of mass of a part of even density.
    #[getter]
    fn center_of_mass_m<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        vector(self.shell.mass_properties().center_m, py)
    }

    /// Spacing of the points: the edge of the voxels that they come from, m.
    #[getter]
    fn voxel_size_m(&self) -> f64 {
        self.shell.voxel_size_m()
    }

    /// As that of Voxmap.
    #[getter]
    fn accuracy(&self) -> HashMap<&'static str, Option<f64>> {
        by_name(self.shell.accuracy())
    }

    /// What a user should know of the bake, a sentence each.
    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.shell.warnings().to_vec()
    }

    /// Size of the arrays, bytes.
    #[getter]
    fn nbytes(&self) -> usize {
        self.shell.heap_bytes()
    }

    fn __repr__(&self) -> String {
        format!(
            "<PointShell of {} points, {:.4} mm apart>",
            self.shell.len(),
            1e3 * self.shell.voxel_size_m()
        )
    }
}
