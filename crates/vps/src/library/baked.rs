//! The two parts of a contact query, ready to be asked, and their files.

use core::ops::ControlFlow;
use std::path::Path;
use std::sync::Arc;

use glam::DVec3;

use super::error::check;
use super::{Error, Mesh};
use crate::mesh::FARTHEST_M;
use crate::mesh::mass::MassProperties;
use crate::part::GENERATION;
use crate::pointshell::Points;
use crate::pointshell::shell::Shell;
use crate::storage::sections::{Reader, Refusal, Writer};
use crate::storage::whole_file::{Access, write_whole};
use crate::storage::{MappedFile, regular};
use crate::voxmap::accuracy::Accuracy;
use crate::voxmap::estimate::Products;
use crate::voxmap::field::{Field, FieldKind};
use crate::voxmap::{BakeStage, Options};

/// Sections of a file: sentences for the user, a line each, and the figures of the accuracy.
const WARNINGS: &str = "warnings";
const ACCURACY: &str = "accuracy";

/// The part that is touched: signed distances on a sparse grid around its surface, mesh frame. A
/// clone is another handle on the same memory.
///
/// # Examples
/// The examples of the calls have the same ball.
/// ```
/// # use vps::{DVec3, Mesh, Options, Shape, Voxmap};
/// let ball = Mesh::from_shape(&Shape::Sphere { radius_m: 10e-3 }, 1e-5)?;
/// let map = Voxmap::bake(&ball, &Options::new(1e-3))?;
/// let outside = map.distance(DVec3::X * 12e-3)?;
/// assert!((outside.distance_m - 2e-3).abs() < 0.01e-3);
/// assert!(outside.gradient.distance(DVec3::X) < 0.1);
/// # Ok::<(), vps::Error>(())
/// ```
#[derive(Clone, Debug)]
pub struct Voxmap {
    field: Field,
    accuracy: Accuracy,
    warnings: Arc<[String]>,
}

/// Distance of a point to a surface.
///
/// # Examples
/// ```
/// # use vps::{DVec3, Mesh, Options, Shape, Voxmap};
/// # let ball = Mesh::from_shape(&Shape::Sphere { radius_m: 10e-3 }, 1e-5)?;
///
/// # let map = Voxmap::bake(&ball, &Options::new(1e-3))?;
/// let inside = map.distance(DVec3::Z * 7e-3)?;
/// assert!((inside.distance_m + 3e-3).abs() < 0.01e-3, "less than 0 inside");
/// assert!(inside.gradient.z > 0.9, "inside it points to the surface");
/// # Ok::<(), vps::Error>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Distance {
    /// m; greater than 0 outside, less than 0 inside. Never beyond [`Voxmap::band_m`] on either
    /// side.
    pub distance_m: f64,
    /// Its gradient, mesh frame: points away from the surface outside and to it inside, about 1
    /// long; 0 beyond the band.
    pub gradient: DVec3,
}

impl Voxmap {
    /// Bakes a mesh. Cost: time and memory follow the voxels near the surface (layers × area /
    /// voxel size²), on the current rayon pool; the same bits for any number of threads.
    ///
    /// # Examples
    /// ```
    /// # use vps::{DVec3, Mesh, Options, Shape, Voxmap};
    /// # let ball = Mesh::from_shape(&Shape::Sphere { radius_m: 10e-3 }, 1e-5)?;
    /// let map = Voxmap::bake(&ball, &Options::new(1e-3))?;
    /// assert!(map.distance(DVec3::Y * 10e-3)?.distance_m.abs() < 0.1e-3, "on the surface");
    /// assert!(Voxmap::bake(&ball, &Options::new(0.0)).is_err(), "no voxel has the edge 0");
    /// # Ok::<(), vps::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::Value`] of an option, [`Error::Grid`] of too many voxels.
    pub fn bake(mesh: &Mesh, options: &Options) -> Result<Self, Error> {
        Self::bake_with(mesh, options, |_| ControlFlow::Continue(()))
    }

    /// The same; `watch` hears of each stage before it begins, and may end the bake there.
    ///
    /// # Examples
    /// ```
    /// # use std::ops::ControlFlow;
    /// # use vps::{Error, Mesh, Options, Shape, Voxmap};
    /// # let ball = Mesh::from_shape(&Shape::Sphere { radius_m: 10e-3 }, 1e-5)?;
    /// let mut shares = Vec::new();
    /// Voxmap::bake_with(&ball, &Options::new(1e-3), |stage| {
    ///     shares.push(stage.share());
    ///     ControlFlow::Continue(())
    /// })?;
    /// assert!(shares.is_sorted() && shares.len() > 3);
    /// let ended = Voxmap::bake_with(&ball, &Options::new(1e-3), |_| ControlFlow::Break(()));
    /// assert!(matches!(ended, Err(Error::Cancelled)));
    /// # Ok::<(), vps::Error>(())
    /// ```
    ///
    /// # Errors
    /// Those of [`Self::bake`], and [`Error::Cancelled`].
    pub fn bake_with(
        mesh: &Mesh,
        options: &Options,
        watch: impl FnMut(BakeStage) -> ControlFlow<()>,
    ) -> Result<Self, Error> {
        Self::bake_for(mesh, options, FieldKind::Trilinear, watch)
    }

    /// The same for queries [with this field](super::ContactQuery::set_field): for
    /// [`FieldKind::SurfacePoint`] with a gradient beside each distance, 2.5 times the memory.
    ///
    /// # Examples
    /// ```
    /// # use std::ops::ControlFlow;
    /// # use vps::{FieldKind, Mesh, Options, Shape, Voxmap};
    /// # let ball = Mesh::from_shape(&Shape::Sphere { radius_m: 10e-3 }, 1e-5)?;
    /// # let options = Options::new(1e-3);
    /// let go_on = |_| ControlFlow::Continue(());
    /// let map = Voxmap::bake_for(&ball, &options, FieldKind::SurfacePoint, go_on)?;
    /// assert!(map.heap_bytes() > 2 * Voxmap::bake(&ball, &options)?.heap_bytes());
    /// # Ok::<(), vps::Error>(())
    /// ```
    ///
    /// # Errors
    /// Those of [`Self::bake_with`].
    pub fn bake_for(
        mesh: &Mesh,
        options: &Options,
        field: FieldKind,
        watch: impl FnMut(BakeStage) -> ControlFlow<()>,
    ) -> Result<Self, Error> {
        let gradients = field == FieldKind::SurfacePoint;
        let part = mesh.part_to_bake(options, Products { field: true, gradients, shell: false })?;
        let (field, report) = part.bake_field(options, gradients, watch)?;
        Ok(Self { field, accuracy: report.accuracy, warnings: report.warnings.into() })
    }

    /// Distance and gradient at a point of the mesh frame, m, interpolated between eight
    /// exact distances.
    /// Allocates nothing; some tens of nanoseconds.
    ///
    /// # Examples
    /// ```
    /// # use vps::{DVec3, Mesh, Options, Shape, Voxmap};
    /// # let ball = Mesh::from_shape(&Shape::Sphere { radius_m: 10e-3 }, 1e-5)?;
    /// # let map = Voxmap::bake(&ball, &Options::new(1e-3))?;
    /// let near = map.distance(DVec3::new(0.0, 9e-3, 12e-3))?; // 15 mm from the middle
    /// assert!((near.distance_m - 5e-3).abs() < 0.01e-3);
    /// assert!(near.gradient.distance(DVec3::new(0.0, 0.6, 0.8)) < 0.05);
    /// assert_eq!(map.distance(DVec3::X)?.distance_m, map.band_m(), "at least so far");
    /// assert!(map.distance(DVec3::NAN).is_err());
    /// # Ok::<(), vps::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::Value`]: a coordinate that is not finite or farther than 10⁹ m from the origin.
    pub fn distance(&self, point_m: DVec3) -> Result<Distance, Error> {
        for coordinate in point_m.to_array() {
            let wanted = "finite metres, at most 1e9 from the origin";
            check("a coordinate of the point", coordinate, -FARTHEST_M..=FARTHEST_M, wanted)?;
        }
        let cells = ((point_m - self.field.origin_map().as_dvec3())
            / f64::from(self.field.voxel_size_m()))
        .as_vec3();
        let (depth_m, gradient) = self.field.distance(cells);
        Ok(Distance { distance_m: -f64::from(depth_m), gradient: -gradient.as_dvec3() })
    }

    /// Edge of a voxel, m.
    ///
    /// # Examples
    /// ```
    /// # use vps::{Mesh, Options, Shape, Voxmap};
    /// # let ball = Mesh::from_shape(&Shape::Sphere { radius_m: 10e-3 }, 1e-5)?;
    /// # let map = Voxmap::bake(&ball, &Options::new(1e-3))?;
    /// assert!((map.voxel_size_m() - 1e-3).abs() < 1e-9);
    /// # Ok::<(), vps::Error>(())
    /// ```
    pub fn voxel_size_m(&self) -> f64 {
        self.field.voxel_size_m().into()
    }

    /// How far outside the surface distances are known, m; farther away all is at this distance.
    ///
    /// # Examples
    /// ```
    /// # use vps::{Mesh, Options, Shape, Voxmap};
    /// # let ball = Mesh::from_shape(&Shape::Sphere { radius_m: 10e-3 }, 1e-5)?;
    /// let map = Voxmap::bake(&ball, &Options { layers: 4, ..Options::new(1e-3) })?;
    /// assert!((map.band_m() - 3.5e-3).abs() < 1e-8);
    /// # Ok::<(), vps::Error>(())
    /// ```
    pub fn band_m(&self) -> f64 {
        self.field.known_outside_m().into()
    }

    /// What a user should know of the bake, a sentence each: holes, leaks, skins thinner than a
    /// voxel.
    ///
    /// # Examples
    /// ```
    /// # use vps::{Mesh, Options, Shape, Voxmap};
    /// let plane = Shape::Plane { x_m: 20e-3, y_m: 20e-3, thickness_m: 0.2e-3 };
    /// let sheet = Mesh::from_shape(&plane, 1e-5)?;
    /// assert!(!Voxmap::bake(&sheet, &Options::new(1e-3))?.warnings().is_empty());
    /// assert!(Voxmap::bake(&sheet, &Options::new(0.05e-3))?.warnings().is_empty());
    /// # Ok::<(), vps::Error>(())
    /// ```
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }

    /// What the bake measured: how far the field is from the surface, walls and edges.
    ///
    /// # Examples
    /// ```
    /// # use vps::{Mesh, Options, Shape, Voxmap};
    /// # let ball = Mesh::from_shape(&Shape::Sphere { radius_m: 10e-3 }, 1e-5)?;
    /// # let map = Voxmap::bake(&ball, &Options::new(1e-3))?;
    /// let error_m = map.accuracy().surface_error_m.unwrap();
    /// assert!(error_m < 0.05e-3, "a twentieth of a voxel");
    /// # Ok::<(), vps::Error>(())
    /// ```
    pub fn accuracy(&self) -> &Accuracy {
        &self.accuracy
    }

    /// Size of the arrays, bytes.
    pub fn heap_bytes(&self) -> usize {
        self.field.heap_bytes()
    }

    /// The arrays themselves, for readers of their layout.
    #[doc(hidden)]
    pub fn field(&self) -> &Field {
        &self.field
    }

    /// Writes a file that appears whole or not at all; [`Self::load`] gives the same bits. One of a
    /// [`PointShell`] is another file.
    ///
    /// # Examples
    /// ```
    /// # use vps::{DVec3, Mesh, Options, Shape, Voxmap};
    /// # let ball = Mesh::from_shape(&Shape::Sphere { radius_m: 10e-3 }, 1e-5)?;
    /// # let map = Voxmap::bake(&ball, &Options::new(1e-3))?;
    /// # let folder = tempfile::tempdir().unwrap();
    /// # let path = folder.path().join("ball.voxmap");
    /// map.save(&path)?;
    /// let at = DVec3::X * 12e-3;
    /// assert_eq!(Voxmap::load(&path)?.distance(at)?, map.distance(at)?);
    /// # Ok::<(), vps::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::File`].
    pub fn save(&self, path: impl AsRef<Path>) -> Result<(), Error> {
        self.with_file(|file| write(path.as_ref(), file))
    }

    /// The bytes of a file of [`Self::save`].
    ///
    /// # Examples
    /// ```
    /// # use vps::{DVec3, Mesh, Options, Shape, Voxmap};
    /// # let ball = Mesh::from_shape(&Shape::Sphere { radius_m: 10e-3 }, 1e-5)?;
    /// # let map = Voxmap::bake(&ball, &Options::new(1e-3))?;
    /// let at = DVec3::X * 12e-3;
    /// assert_eq!(Voxmap::from_bytes(&map.to_bytes())?.distance(at)?, map.distance(at)?);
    /// # Ok::<(), vps::Error>(())
    /// ```
    pub fn to_bytes(&self) -> Vec<u8> {
        self.with_file(bytes)
    }

    /// Reads a file of [`Self::save`], or of hapticd's bake cache. It is checked as a whole: no
    /// file gives an index out of range.
    ///
    /// # Examples
    /// ```
    /// # use std::io;
    /// # use vps::{Error, Voxmap};
    /// let refused = Voxmap::load("missing.voxmap").unwrap_err();
    /// assert!(matches!(refused, Error::File { .. }));
    /// assert_eq!(refused.os_error().map(io::Error::kind), Some(io::ErrorKind::NotFound));
    /// ```
    ///
    /// # Errors
    /// [`Error::File`]: no such file, one that is damaged or holds something else, or one of
    /// another format.
    pub fn load(path: impl AsRef<Path>) -> Result<Self, Error> {
        read(path.as_ref(), Self::of_file)
    }

    /// The same of [`Self::to_bytes`], which are copied.
    ///
    /// # Examples
    /// ```
    /// # use vps::{Error, Voxmap};
    /// assert!(matches!(Voxmap::from_bytes(b"no voxmap"), Err(Error::Bytes { .. })));
    /// ```
    ///
    /// # Errors
    /// [`Error::Bytes`].
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, Error> {
        read_bytes(bytes, Self::of_file)
    }

    fn with_file<T>(&self, take: impl FnOnce(&Writer<'_>) -> T) -> T {
        let head = self.field.head();
        let about = About::of(&self.warnings, &self.accuracy);
        let mut file = about.file();
        self.field.store(&head, &mut file);
        take(&file)
    }

    fn of_file(file: &Reader) -> Result<Self, String> {
        if !Field::is_in(file) {
            return Err("holds no voxmap: give what one was saved to".to_owned());
        }
        let field = Field::load(file).map_err(|refusal| remedy(&refusal))?;
        if field.known_outside_m() <= 0.0 {
            return Err(
                "holds a thin skin with one layer of voxels: bake the part again with two \
                or more"
                    .to_owned(),
            );
        }
        Ok(Self { field, accuracy: accuracy(file), warnings: warnings(file) })
    }
}

/// The part that touches: points on its surface with inward normals, mesh frame. A clone is another
/// handle on the same memory.
///
/// # Examples
/// The examples of the calls have the same ball.
/// ```
/// # use vps::{Mesh, Options, PointShell, Shape};
/// let ball = Mesh::from_shape(&Shape::Sphere { radius_m: 10e-3 }, 1e-5)?;
/// let shell = PointShell::bake(&ball, &Options::new(1e-3))?;
/// // Each square millimetre of the surface has some one or two points.
/// let squares = 4.0 * core::f64::consts::PI * 10.0 * 10.0;
/// assert!((1.0..3.0).contains(&(shell.len() as f64 / squares)));
/// # Ok::<(), vps::Error>(())
/// ```
#[derive(Clone, Debug)]
pub struct PointShell {
    shell: Shell,
    mass: MassProperties,
    accuracy: Accuracy,
    warnings: Arc<[String]>,
}

impl PointShell {
    /// Bakes a mesh: a point for each facet of the surface in each voxel. Cost: as
    /// [`Voxmap::bake`].
    ///
    /// # Examples
    /// ```
    /// # use vps::{Mesh, Options, PointShell, Shape};
    /// # let ball = Mesh::from_shape(&Shape::Sphere { radius_m: 10e-3 }, 1e-5)?;
    /// let coarse = PointShell::bake(&ball, &Options::new(2e-3))?;
    /// let fine = PointShell::bake(&ball, &Options::new(1e-3))?;
    /// let ratio = fine.len() as f64 / coarse.len() as f64;
    /// assert!((ratio - 4.0).abs() < 0.5, "points follow area / voxel size²");
    /// # Ok::<(), vps::Error>(())
    /// ```
    ///
    /// # Errors
    /// As [`Voxmap::bake`].
    pub fn bake(mesh: &Mesh, options: &Options) -> Result<Self, Error> {
        Self::bake_with(mesh, options, |_| ControlFlow::Continue(()))
    }

    /// The same; `watch` hears of each stage before it begins, and may end the bake there.
    ///
    /// # Examples
    /// ```
    /// # use std::ops::ControlFlow;
    /// # use vps::{BakeStage, Error, Mesh, Options, PointShell, Shape};
    /// # let ball = Mesh::from_shape(&Shape::Sphere { radius_m: 10e-3 }, 1e-5)?;
    /// let ended = PointShell::bake_with(&ball, &Options::new(1e-3), |stage| match stage {
    ///     BakeStage::Pointshell => ControlFlow::Break(()),
    ///     _ => ControlFlow::Continue(()),
    /// });
    /// assert!(matches!(ended, Err(Error::Cancelled)));
    /// # Ok::<(), vps::Error>(())
    /// ```
    ///
    /// # Errors
    /// Those of [`Self::bake`], and [`Error::Cancelled`].
    pub fn bake_with(
        mesh: &Mesh,
        options: &Options,
        watch: impl FnMut(BakeStage) -> ControlFlow<()>,
    ) -> Result<Self, Error> {
        Self::bake_of(mesh, options, Points::default(), watch)
    }

    /// The same with points of this kind, as `tool.points` of a scene.
    ///
    /// # Examples
    /// ```
    /// # use std::ops::ControlFlow;
    /// # use vps::{DVec3, Mesh, Options, PointShell, Points, Shape};
    /// # let cube = Mesh::from_shape(&Shape::Box { size_m: DVec3::splat(10e-3) }, 1e-5)?;
    /// # let options = Options::new(1e-3);
    /// let go_on = |_| ControlFlow::Continue(());
    /// let voxels = PointShell::bake_of(&cube, &options, Points::Voxels, go_on)?;
    /// // The surface of a cube of 10 mm lies in 11³ voxels of 1 mm without the 9³ inside.
    /// assert_eq!(voxels.len(), 11_usize.pow(3) - 9_usize.pow(3));
    /// # Ok::<(), vps::Error>(())
    /// ```
    ///
    /// # Errors
    /// Those of [`Self::bake_with`].
    pub fn bake_of(
        mesh: &Mesh,
        options: &Options,
        points: Points,
        watch: impl FnMut(BakeStage) -> ControlFlow<()>,
    ) -> Result<Self, Error> {
        let part =
            mesh.part_to_bake(options, Products { field: false, gradients: false, shell: true })?;
        let (shell, mass, report) = part.bake_shell(options, points, None, watch)?;
        Ok(Self { shell, mass, accuracy: report.accuracy, warnings: report.warnings.into() })
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.shell.len()
    }

    /// True when there is no point: such a shell touches nothing.
    pub fn is_empty(&self) -> bool {
        self.shell.is_empty()
    }

    /// Volume, m³, centre of mass, m, and inertia per kilogram, m², of a part of even density; mesh
    /// frame.
    ///
    /// # Examples
    /// ```
    /// # use vps::{Mesh, Options, PointShell, Shape};
    /// # let ball = Mesh::from_shape(&Shape::Sphere { radius_m: 10e-3 }, 1e-5)?;
    /// # let shell = PointShell::bake(&ball, &Options::new(1e-3))?;
    /// let inertia = shell.mass_properties().inertia_per_mass; // of a ball 2/5 r²
    /// assert!((inertia.z_axis.z / (0.4 * 10e-3 * 10e-3) - 1.0).abs() < 0.01);
    /// # Ok::<(), vps::Error>(())
    /// ```
    pub fn mass_properties(&self) -> &MassProperties {
        &self.mass
    }

    /// Spacing of the points: the edge of the voxels that they come from, m.
    pub fn voxel_size_m(&self) -> f64 {
        self.shell.voxel_size_m()
    }

    /// As [`Voxmap::warnings`].
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }

    /// What the bake measured: how deep a flat face is entered unseen, walls and edges.
    ///
    /// # Examples
    /// ```
    /// # use vps::{Mesh, Options, PointShell, Shape};
    /// # let ball = Mesh::from_shape(&Shape::Sphere { radius_m: 10e-3 }, 1e-5)?;
    /// # let shell = PointShell::bake(&ball, &Options::new(1e-3))?;
    /// let unseen_m = shell.accuracy().unseen_depth_m.unwrap();
    /// assert!(unseen_m < 0.1e-3, "a tenth of a voxel");
    /// # Ok::<(), vps::Error>(())
    /// ```
    pub fn accuracy(&self) -> &Accuracy {
        &self.accuracy
    }

    /// Size of the arrays, bytes.
    pub fn heap_bytes(&self) -> usize {
        self.shell.heap_bytes()
    }

    /// The arrays themselves, for readers of their layout: points about the centre of mass.
    #[doc(hidden)]
    pub fn shell(&self) -> &Shell {
        &self.shell
    }

    /// As [`Voxmap::save`].
    ///
    /// # Examples
    /// ```
    /// # use vps::{Mesh, Options, PointShell, Shape};
    /// # let ball = Mesh::from_shape(&Shape::Sphere { radius_m: 10e-3 }, 1e-5)?;
    /// # let shell = PointShell::bake(&ball, &Options::new(1e-3))?;
    /// # let folder = tempfile::tempdir().unwrap();
    /// # let path = folder.path().join("ball.shell");
    /// shell.save(&path)?;
    /// assert_eq!(PointShell::load(&path)?.to_bytes(), shell.to_bytes());
    /// # Ok::<(), vps::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::File`].
    pub fn save(&self, path: impl AsRef<Path>) -> Result<(), Error> {
        self.with_file(|file| write(path.as_ref(), file))
    }

    /// As [`Voxmap::to_bytes`].
    ///
    /// # Examples
    /// ```
    /// # use vps::{Mesh, Options, PointShell, Shape};
    /// # let ball = Mesh::from_shape(&Shape::Sphere { radius_m: 10e-3 }, 1e-5)?;
    /// # let shell = PointShell::bake(&ball, &Options::new(1e-3))?;
    /// assert_eq!(PointShell::from_bytes(&shell.to_bytes())?.len(), shell.len());
    /// # Ok::<(), vps::Error>(())
    /// ```
    pub fn to_bytes(&self) -> Vec<u8> {
        self.with_file(bytes)
    }

    /// As [`Voxmap::load`].
    ///
    /// # Examples
    /// ```
    /// # use vps::{DVec3, Mesh, Options, PointShell, Shape, Voxmap};
    /// # let ball = Mesh::from_shape(&Shape::Sphere { radius_m: 10e-3 }, 1e-5)?;
    /// # let map = Voxmap::bake(&ball, &Options::new(2e-3))?;
    /// # let folder = tempfile::tempdir().unwrap();
    /// # let path = folder.path().join("ball.voxmap");
    /// map.save(&path)?;
    /// let refused = PointShell::load(&path).unwrap_err();
    /// assert!(refused.to_string().contains("holds no pointshell"), "a voxmap is another file");
    /// # Ok::<(), vps::Error>(())
    /// ```
    ///
    /// # Errors
    /// As [`Voxmap::load`].
    pub fn load(path: impl AsRef<Path>) -> Result<Self, Error> {
        read(path.as_ref(), Self::of_file)
    }

    /// As [`Voxmap::from_bytes`].
    ///
    /// # Examples
    /// ```
    /// # use vps::{Error, PointShell};
    /// assert!(matches!(PointShell::from_bytes(&[]), Err(Error::Bytes { .. })));
    /// ```
    ///
    /// # Errors
    /// [`Error::Bytes`].
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, Error> {
        read_bytes(bytes, Self::of_file)
    }

    fn with_file<T>(&self, take: impl FnOnce(&Writer<'_>) -> T) -> T {
        let (head, mass) = (self.shell.head(), self.mass.record());
        let about = About::of(&self.warnings, &self.accuracy);
        let mut file = about.file();
        self.shell.store(&head, &mut file);
        MassProperties::store(&mass, &mut file);
        take(&file)
    }

    fn of_file(file: &Reader) -> Result<Self, String> {
        if !(Shell::is_in(file) && MassProperties::is_in(file)) {
            return Err("holds no pointshell: give what one was saved to".to_owned());
        }
        let (shell, mass) = Shell::load(file)
            .and_then(|shell| Ok((shell, MassProperties::load(file)?)))
            .map_err(|refusal| remedy(&refusal))?;
        Ok(Self { shell, mass, accuracy: accuracy(file), warnings: warnings(file) })
    }
}

/// What a file says beside the part itself.
struct About {
    warnings: String,
    figures: [f64; 5],
}

impl About {
    fn of(warnings: &[String], accuracy: &Accuracy) -> Self {
        let figures = accuracy.figures().map(|figure| figure.unwrap_or(f64::NAN));
        Self { warnings: warnings.join("\n"), figures }
    }

    fn file(&self) -> Writer<'_> {
        let mut file = Writer::default();
        file.array(WARNINGS, self.warnings.as_bytes());
        file.array(ACCURACY, &self.figures);
        file
    }
}

fn write(path: &Path, file: &Writer<'_>) -> Result<(), Error> {
    write_whole(path, Access::Shared, |out| file.write_to([0; 16], GENERATION, out)).map_err(
        |error| Error::File {
            path: path.to_owned(),
            what: format!("cannot be written: {error}"),
            source: Some(error),
        },
    )
}

/// What [`write`] writes.
fn bytes(file: &Writer<'_>) -> Vec<u8> {
    let mut bytes = Vec::new();
    // Memory refuses nothing.
    let _ = file.write_to([0; 16], GENERATION, &mut bytes);
    bytes
}

fn read<T>(path: &Path, take: impl FnOnce(&Reader) -> Result<T, String>) -> Result<T, Error> {
    let failed = |what, source| Error::File { path: path.to_owned(), what, source };
    let open = || Reader::new(MappedFile::read(&regular::open(path)?)?, None, None);
    let file = open().map_err(|refusal| {
        let what = remedy(&refusal);
        match refusal {
            Refusal::Io(error) => failed(what, Some(error)),
            _ => failed(what, None),
        }
    })?;
    take(&file).map_err(|what| failed(what, None))
}

fn read_bytes<T>(
    bytes: &[u8],
    take: impl FnOnce(&Reader) -> Result<T, String>,
) -> Result<T, Error> {
    let open = || Reader::new(MappedFile::copy(bytes)?, None, None);
    open()
        .map_err(|refusal| remedy(&refusal))
        .and_then(|file| take(&file))
        .map_err(|what| Error::Bytes { what })
}

fn remedy(refusal: &Refusal) -> String {
    match refusal {
        Refusal::Io(_) => format!("cannot be read: {refusal}"),
        _ => format!(
            "{refusal}: give a file that a baked part was saved to, or bake the part again and \
                save it"
        ),
    }
}

fn accuracy(file: &Reader) -> Accuracy {
    let figures = file.array::<f64>(ACCURACY).ok();
    let figures = figures.and_then(|figures| figures.first_chunk().copied());
    figures.map_or_else(Accuracy::default, Accuracy::of_figures)
}

fn warnings(file: &Reader) -> Arc<[String]> {
    let text = file.array::<u8>(WARNINGS).ok();
    text.map(|text| String::from_utf8_lossy(&text).lines().map(str::to_owned).collect())
        .unwrap_or_default()
}
