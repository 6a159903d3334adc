//! Voxmaps and pointshells.

use std::ffi::{CString, c_char, c_int, c_void};
use std::mem::MaybeUninit;
use std::ops::ControlFlow;

use vps::{Accuracy, BakeStage, DVec3, FieldKind, InsideTest, Options, PointShell, Points, Voxmap};

use crate::border::{
    Failure, call, free, given, lines, make, path, place, places, text, triple, vps_status,
};
use crate::mesh::{vps_mass, vps_mesh};

/// The part that is touched: signed distances around its surface.
pub struct vps_voxmap {
    pub(crate) voxmap: Voxmap,
    warnings: CString,
}

/// The part that touches: points on its surface.
pub struct vps_shell {
    pub(crate) shell: PointShell,
    warnings: CString,
}

impl From<Voxmap> for vps_voxmap {
    fn from(voxmap: Voxmap) -> Self {
        Self { warnings: lines(voxmap.warnings()), voxmap }
    }
}

impl From<PointShell> for vps_shell {
    fn from(shell: PointShell) -> Self {
        Self { warnings: lines(shell.warnings()), shell }
    }
}

/// How to tell inside from outside.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum vps_inside_test {
    /// By a fill from outside; where the mesh leaks, by winding numbers or as a thin skin.
    VPS_INSIDE_AUTO = 0,
    /// By the fill alone.
    VPS_INSIDE_FLOOD = 1,
    /// Holes get lids where the winding number is one half.
    VPS_INSIDE_WINDING = 2,
    /// A thin skin with two sides.
    VPS_INSIDE_THIN = 3,
}

/// How to bake. Begin with vps_options_default, so that later members have their values.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct vps_options {
    /// Edge of a voxel, m.
    pub voxel_size_m: f64,
    /// Layers of voxels on each side of the surface in which distances are known, 2 to 126.
    pub layers: u32,
    /// A vps_inside_test.
    pub inside_test: u32,
    /// A vps_field: of the queries that a voxmap is baked for.
    pub field: u32,
    /// A vps_points: which points a shell has.
    pub points: u32,
}

/// How the depth of a point is found, as rendering.field of a scene.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum vps_field {
    /// By interpolation of distances.
    VPS_FIELD_TRILINEAR = 0,
    /// By the layer of the voxel and the plane of the point.
    VPS_FIELD_LAYERS = 1,
    /// By the plane at the nearest point of the surface; takes two and a half times the memory.
    VPS_FIELD_SURFACE_POINT = 2,
    /// By the distances around an octant of the voxel.
    VPS_FIELD_OCTANT = 3,
}

/// The field of this number.
pub(crate) fn field(name: &str, number: u32) -> Result<FieldKind, Failure> {
    use FieldKind::*;
    let found = [Trilinear, Layers, SurfacePoint, Octant].get(number as usize).copied();
    found.ok_or_else(|| Failure::argument(format!("{name} is {number}: give a vps_field, 0 to 3")))
}

/// Which points a shell has, as tool.points of a scene.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum vps_points {
    /// One for each facet of the surface in a voxel.
    VPS_POINTS_FACETS = 0,
    /// One for each voxel of the surface, all alike.
    VPS_POINTS_VOXELS = 1,
}

impl vps_options {
    fn read(&self) -> Result<Options, Failure> {
        let tests = [InsideTest::Auto, InsideTest::Flood, InsideTest::Winding, InsideTest::Thin];
        let sides = *tests.get(self.inside_test as usize).ok_or_else(|| {
            Failure::argument(format!(
                "options->inside_test is {}: give a vps_inside_test, 0 to 3",
                self.inside_test
            ))
        })?;
        Ok(Options { layers: self.layers, sides, ..Options::new(self.voxel_size_m) })
    }

    fn read_points(&self) -> Result<Points, Failure> {
        [Points::Facets, Points::Voxels].get(self.points as usize).copied().ok_or_else(|| {
            Failure::argument(format!(
                "options->points is {}: give a vps_points, 0 or 1",
                self.points
            ))
        })
    }
}

/// Voxels of this edge, m, and for the rest what suits most parts.
#[unsafe(no_mangle)]
pub extern "C" fn vps_options_default(voxel_size_m: f64) -> vps_options {
    vps_options {
        voxel_size_m,
        layers: Options::DEFAULT_LAYERS,
        inside_test: vps_inside_test::VPS_INSIDE_AUTO as u32,
        field: vps_field::VPS_FIELD_TRILINEAR as u32,
        points: vps_points::VPS_POINTS_FACETS as u32,
    }
}

/// A stage of a bake. Later versions may have more.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum vps_stage {
    /// Reading a file.
    VPS_STAGE_LOAD = 0,
    /// Finding the voxels that the surface touches.
    VPS_STAGE_SURFACE = 1,
    /// Telling inside from outside.
    VPS_STAGE_FILL = 2,
    /// Growing layers around the surface.
    VPS_STAGE_LAYERS = 3,
    /// Measuring distances.
    VPS_STAGE_DISTANCE = 4,
    /// Placing points on the surface.
    VPS_STAGE_POINTS = 5,
    /// Preparing distances for queries.
    VPS_STAGE_FIELD = 6,
    /// Measuring what was baked.
    VPS_STAGE_REPORT = 7,
}

/// Share of a bake that is over when a stage begins, 0 to 1: the mean of some parts.
#[unsafe(no_mangle)]
pub extern "C" fn vps_stage_share(stage: u32) -> f64 {
    const STAGES: [BakeStage; 8] = [
        BakeStage::Load,
        BakeStage::Surface,
        BakeStage::Fill,
        BakeStage::Layers,
        BakeStage::Distance,
        BakeStage::Pointshell,
        BakeStage::Field,
        BakeStage::Report,
    ];
    STAGES.get(stage as usize).map_or(0.0, |stage| stage.share())
}

/// Hears of each stage before it begins, on the thread that bakes; anything but 0 ends the bake
/// there with VPS_ERROR_CANCELLED. It must return: no exception, no longjmp.
pub type vps_progress = Option<unsafe extern "C" fn(stage: vps_stage, user: *mut c_void) -> c_int>;

/// # Safety
/// `progress` may be called with `user`.
unsafe fn watch(
    progress: vps_progress,
    user: *mut c_void,
) -> impl FnMut(BakeStage) -> ControlFlow<()> {
    use vps_stage::*;
    move |stage| {
        let stage = match stage {
            BakeStage::Load => VPS_STAGE_LOAD,
            BakeStage::Surface => VPS_STAGE_SURFACE,
            BakeStage::Fill => VPS_STAGE_FILL,
            BakeStage::Layers => VPS_STAGE_LAYERS,
            BakeStage::Distance => VPS_STAGE_DISTANCE,
            BakeStage::Pointshell => VPS_STAGE_POINTS,
            BakeStage::Field => VPS_STAGE_FIELD,
            BakeStage::Report => VPS_STAGE_REPORT,
        };
        // SAFETY: as the caller promises.
        match progress.map_or(0, |progress| unsafe { progress(stage, user) }) {
            0 => ControlFlow::Continue(()),
            _ => ControlFlow::Break(()),
        }
    }
}

/// Bakes the part that is touched, on all processors (RAYON_NUM_THREADS in the environment: on so
/// many threads), to the same bits for any number of threads. progress may be null.
///
/// # Safety
/// `progress` may be called with `user`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vps_voxmap_bake(
    mesh: Option<&vps_mesh>,
    options: Option<&vps_options>,
    progress: vps_progress,
    user: *mut c_void,
    out: Option<&mut MaybeUninit<*mut vps_voxmap>>,
) -> vps_status {
    make(out, || {
        let given_options = given("options", options)?;
        let options = given_options.read()?;
        let field = field("options->field", given_options.field)?;
        // SAFETY: as the caller promises.
        let watch = unsafe { watch(progress, user) };
        Ok(Voxmap::bake_for(&given("mesh", mesh)?.mesh, &options, field, watch)?.into())
    })
}

/// Reads a file of vps_voxmap_save. It is checked as a whole; one that is damaged or of another
/// format is refused.
///
/// # Safety
/// `file_name`: null, or ends with a zero byte.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vps_voxmap_load(
    file_name: *const c_char,
    out: Option<&mut MaybeUninit<*mut vps_voxmap>>,
) -> vps_status {
    // SAFETY: as the caller promises.
    make(out, || Ok(Voxmap::load(unsafe { path(file_name) }?)?.into()))
}

/// Writes a file that appears whole or not at all; vps_voxmap_load gives the same bits.
///
/// # Safety
/// `file_name`: null, or ends with a zero byte.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vps_voxmap_save(
    voxmap: Option<&vps_voxmap>,
    file_name: *const c_char,
) -> vps_status {
    // SAFETY: as the caller promises.
    call(|| Ok(given("voxmap", voxmap)?.voxmap.save(unsafe { path(file_name) }?)?))
}

/// Distance of a point of the mesh frame to the surface, m: greater than 0 outside, less than 0
/// inside, never beyond band_m on either side. Its gradient points away from the surface outside
/// and to it inside; 0 beyond the band. Either place may be null. Allocates nothing.
///
/// # Safety
/// `point_m` has three elements, and `gradient` room for three, or is null.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vps_voxmap_distance(
    voxmap: Option<&vps_voxmap>,
    point_m: *const f64,
    distance_m: Option<&mut MaybeUninit<f64>>,
    gradient: *mut f64,
) -> vps_status {
    call(|| {
        // SAFETY: as the caller promises.
        let (point_m, gradient) = unsafe {
            (
                triple("point_m", point_m)?,
                places("gradient", gradient.cast::<[f64; 3]>(), usize::from(!gradient.is_null()))?,
            )
        };
        let found = given("voxmap", voxmap)?.voxmap.distance(DVec3::from_array(point_m))?;
        if let Some(place) = distance_m {
            place.write(found.distance_m);
        }
        for place in gradient {
            place.write(found.gradient.to_array());
        }
        Ok(())
    })
}

/// What a voxmap is like.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct vps_voxmap_info {
    /// Edge of a voxel, m.
    pub voxel_size_m: f64,
    /// How far outside the surface distances are known, m.
    pub band_m: f64,
    /// Size of its arrays, bytes.
    pub heap_bytes: usize,
}

/// What a voxmap is like.
#[unsafe(no_mangle)]
pub extern "C" fn vps_voxmap_describe(
    voxmap: Option<&vps_voxmap>,
    out: Option<&mut MaybeUninit<vps_voxmap_info>>,
) -> vps_status {
    call(|| {
        let voxmap = &given("voxmap", voxmap)?.voxmap;
        let voxel_size_m = voxmap.voxel_size_m();
        let band_m = voxmap.band_m();
        let heap_bytes = voxmap.heap_bytes();
        place("out", out)?.write(vps_voxmap_info { voxel_size_m, band_m, heap_bytes });
        Ok(())
    })
}

/// What a bake measured; NaN: not measured of this kind of part.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct vps_accuracy {
    /// Largest error of the stored distances that were measured again, m; of a voxmap.
    pub sample_error_m: f64,
    /// How far off the surface is felt, m, largest at edges; of a voxmap.
    pub surface_error_m: f64,
    /// How deep a flat face is entered before a point touches, m; of a shell.
    pub unseen_depth_m: f64,
    /// Thinnest wall found, m.
    pub thinnest_wall_m: f64,
    /// Smallest angle of material between two faces, degrees.
    pub sharpest_edge_deg: f64,
}

impl From<&Accuracy> for vps_accuracy {
    fn from(accuracy: &Accuracy) -> Self {
        let figures = accuracy.figures().map(|figure| figure.unwrap_or(f64::NAN));
        let [sample_error_m, surface_error_m, unseen_depth_m, thinnest_wall_m, sharpest_edge_deg] =
            figures;
        Self { sample_error_m, surface_error_m, unseen_depth_m, thinnest_wall_m, sharpest_edge_deg }
    }
}

/// What the bake of a voxmap measured.
#[unsafe(no_mangle)]
pub extern "C" fn vps_voxmap_accuracy(
    voxmap: Option<&vps_voxmap>,
    out: Option<&mut MaybeUninit<vps_accuracy>>,
) -> vps_status {
    call(|| {
        let voxmap = &given("voxmap", voxmap)?.voxmap;
        place("out", out)?.write(voxmap.accuracy().into());
        Ok(())
    })
}

/// What a user should know of the bake, a line each: holes, leaks, skins thinner than a voxel.
/// Lives as long as the voxmap.
#[unsafe(no_mangle)]
pub extern "C" fn vps_voxmap_warnings(voxmap: Option<&vps_voxmap>) -> *const c_char {
    text(voxmap.map(|voxmap| &voxmap.warnings))
}

/// Frees a voxmap; queries that were made of it stay.
///
/// # Safety
/// Null, or a voxmap that nothing uses any more.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vps_voxmap_free(voxmap: *mut vps_voxmap) {
    // SAFETY: as the caller promises.
    unsafe { free(voxmap) }
}

/// Bakes the part that touches; as vps_voxmap_bake.
///
/// # Safety
/// `progress` may be called with `user`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vps_shell_bake(
    mesh: Option<&vps_mesh>,
    options: Option<&vps_options>,
    progress: vps_progress,
    user: *mut c_void,
    out: Option<&mut MaybeUninit<*mut vps_shell>>,
) -> vps_status {
    make(out, || {
        let given_options = given("options", options)?;
        let options = given_options.read()?;
        let points = given_options.read_points()?;
        // SAFETY: as the caller promises.
        let watch = unsafe { watch(progress, user) };
        Ok(PointShell::bake_of(&given("mesh", mesh)?.mesh, &options, points, watch)?.into())
    })
}

/// Reads a file of vps_shell_save; as vps_voxmap_load.
///
/// # Safety
/// `file_name`: null, or ends with a zero byte.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vps_shell_load(
    file_name: *const c_char,
    out: Option<&mut MaybeUninit<*mut vps_shell>>,
) -> vps_status {
    // SAFETY: as the caller promises.
    make(out, || Ok(PointShell::load(unsafe { path(file_name) }?)?.into()))
}

/// Writes a file; as vps_voxmap_save.
///
/// # Safety
/// `file_name`: null, or ends with a zero byte.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vps_shell_save(
    shell: Option<&vps_shell>,
    file_name: *const c_char,
) -> vps_status {
    // SAFETY: as the caller promises.
    call(|| Ok(given("shell", shell)?.shell.save(unsafe { path(file_name) }?)?))
}

/// What a shell is like.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct vps_shell_info {
    /// Number of points; 0: it touches nothing.
    pub n_points: usize,
    /// Spacing of the points, m.
    pub voxel_size_m: f64,
    /// The part, in its mesh frame.
    pub mass: vps_mass,
    /// Size of its arrays, bytes.
    pub heap_bytes: usize,
}

/// What a shell is like.
#[unsafe(no_mangle)]
pub extern "C" fn vps_shell_describe(
    shell: Option<&vps_shell>,
    out: Option<&mut MaybeUninit<vps_shell_info>>,
) -> vps_status {
    call(|| {
        let shell = &given("shell", shell)?.shell;
        place("out", out)?.write(vps_shell_info {
            n_points: shell.len(),
            voxel_size_m: shell.voxel_size_m(),
            mass: shell.mass_properties().into(),
            heap_bytes: shell.heap_bytes(),
        });
        Ok(())
    })
}

/// What the bake of a shell measured.
#[unsafe(no_mangle)]
pub extern "C" fn vps_shell_accuracy(
    shell: Option<&vps_shell>,
    out: Option<&mut MaybeUninit<vps_accuracy>>,
) -> vps_status {
    call(|| {
        let shell = &given("shell", shell)?.shell;
        place("out", out)?.write(shell.accuracy().into());
        Ok(())
    })
}

/// As vps_voxmap_warnings.
#[unsafe(no_mangle)]
pub extern "C" fn vps_shell_warnings(shell: Option<&vps_shell>) -> *const c_char {
    text(shell.map(|shell| &shell.warnings))
}

/// Frees a shell; queries that were made of it stay.
///
/// # Safety
/// Null, or a shell that nothing uses any more.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vps_shell_free(shell: *mut vps_shell) {
    // SAFETY: as the caller promises.
    unsafe { free(shell) }
}
