//! The objects of a scene: geometry, voxels, mass.

use std::path::{Path, PathBuf};

use glam::{DMat3, DVec3};

use super::super::draft::Unit;
use super::super::scene::{MeshSource, StaticConfig, ToolConfig};
use super::super::schema;
use super::super::setting_names::KEYS;
use super::{MM, Resolve, SIZE_MM};
use document::{FINITE, Numbers, POSITIVE, ProblemKind};
use vps::mesh::primitives::Shape;
use vps::mesh::{self, EXTENSIONS, Format};
use vps::pointshell::Points;
use vps::spatial::Pose;
use vps::voxmap::inside_test::InsideTest;

const DEFAULT_STATIC_LAYERS: u32 = 8;
const DEFAULT_TOOL_LAYERS: u32 = 4;
/// The quantised layer value of a voxel is an `i8`; 60 layers on each side stay well inside and
/// keep the band affordable.
const LAYERS_MAX: u32 = 60;
/// Normals of a tool come from the layers around a point, two deep. Of a fixed part that is taken
/// as a thin skin, whose surface is a voxel away from its middle, one layer would reach nowhere
/// outside: all around it would count as contact.
const LAYERS_MIN: u32 = 2;
const DEFAULT_TOOL_MASS_G: f64 = 100.0;

impl Resolve<'_> {
    pub(super) fn unique_names(&mut self, statics: &[schema::Static]) {
        for (index, object) in statics.iter().enumerate() {
            let Some(name) = &object.name else { continue };
            let first =
                statics[..index].iter().position(|earlier| earlier.name.as_ref() == Some(name));
            if let Some(first) = first {
                let first_line =
                    self.document.line(&format!("static[{first}].name")).unwrap_or_default();
                self.checks.refuse(
                    &format!("static[{index}].name"),
                    ProblemKind::DuplicateName { first_line },
                );
            }
        }
    }

    pub(super) fn static_object(&mut self, index: usize, object: &schema::Static) -> StaticConfig {
        let table = format!("static[{index}]");
        let key = |name: &str| format!("{table}.{name}");
        let voxel_size_m = self.voxel_size_m(&table, object.voxel_size_mm);
        let layers = self.checks.whole(
            &key("layers"),
            object.layers,
            DEFAULT_STATIC_LAYERS,
            LAYERS_MIN,
            LAYERS_MAX,
        );
        let written = WrittenSource {
            mesh: object.mesh.as_deref(),
            shape: object.shape.as_ref(),
            units: object.units,
        };
        StaticConfig {
            name: object.name.clone().unwrap_or_else(|| table.clone()),
            source: self.source(&table, written, voxel_size_m, layers),
            voxel_size_m,
            layers,
            sides: object.sides.map_or(InsideTest::Auto, Into::into),
            pose: Pose::new(
                self.checks.orientation(&key("orientation_xyzw"), object.orientation_xyzw),
                self.checks.position(&key("position_mm"), object.position_mm) * MM,
            ),
            movable: object.movable.unwrap_or(false),
        }
    }

    pub(super) fn tool(&mut self, tool: &schema::Tool) -> ToolConfig {
        let voxel_size_m = self.voxel_size_m("tool", tool.voxel_size_mm);
        let layers = self.checks.whole(
            "tool.layers",
            tool.layers,
            DEFAULT_TOOL_LAYERS,
            LAYERS_MIN,
            LAYERS_MAX,
        );
        let written = WrittenSource {
            mesh: tool.mesh.as_deref(),
            shape: tool.shape.as_ref(),
            units: tool.units,
        };
        let center_of_mass_m = self
            .checks
            .array("tool.center_of_mass_mm", tool.center_of_mass_mm, FINITE)
            .map(|center_mm| DVec3::from_array(center_mm) * MM);
        ToolConfig {
            source: self.source("tool", written, voxel_size_m, layers),
            voxel_size_m,
            layers,
            sides: tool.sides.map_or(InsideTest::Auto, Into::into),
            points: tool.points.map_or(Points::default(), Into::into),
            mass_kg: self.checks.number(
                "tool.mass_g",
                tool.mass_g,
                DEFAULT_TOOL_MASS_G,
                POSITIVE.to(1e5).unit("g"),
            ) * 1e-3,
            center_of_mass_m,
            inertia_kg_m2: self.inertia_kg_m2(tool.inertia_kg_mm2),
        }
    }

    fn voxel_size_m(&mut self, table: &str, written_mm: Option<f64>) -> f64 {
        self.checks.required(
            &format!("{table}.voxel_size_mm"),
            written_mm,
            POSITIVE.to(1000.0).unit("mm"),
        ) * MM
    }

    /// `[xx, yy, zz, xy, xz, yz]`, the entries of the symmetric matrix itself.
    fn inertia_kg_m2(&mut self, written: Option<Numbers<6>>) -> Option<DMat3> {
        let [xx, yy, zz, xy, xz, yz] = self.checks.array("tool.inertia_kg_mm2", written, FINITE)?;
        let inertia = DMat3::from_cols(
            DVec3::new(xx, xy, xz),
            DVec3::new(xy, yy, yz),
            DVec3::new(xz, yz, zz),
        );
        // No body has another: J itself and the second moments of mass, tr(J)/2 − J, are positive.
        let second_moments =
            DMat3::from_diagonal(DVec3::splat((xx + yy + zz) / 2.0 * (1.0 + 1e-9))) - inertia;
        if is_positive_definite(inertia) && is_positive_definite(second_moments) {
            return Some(inertia * (MM * MM));
        }
        self.checks.not_accepted(
            "tool.inertia_kg_mm2",
            "[xx, yy, zz, xy, xz, yz] of a real body: positive, and no principal moment above the \
                sum of the other two",
        );
        None
    }

    /// Exactly one of a mesh and a shape. After a problem, some shape, so that the pass goes on.
    pub(super) fn source(
        &mut self,
        table: &str,
        written: WrittenSource<'_>,
        voxel_size_m: f64,
        layers: u32,
    ) -> MeshSource {
        let fallback = MeshSource::Shape(Shape::Sphere { radius_m: 1.0 });
        let WrittenSource { mesh, shape, units } = written;
        match (mesh, shape) {
            (Some(_), Some(_)) => {
                let other = format!("{table}.mesh");
                self.checks.refuse(&format!("{table}.shape"), ProblemKind::Exclusive { other });
                fallback
            }
            (None, None) => {
                self.checks.missing(
                    &format!("{table}.mesh"),
                    "a mesh file, or a shape such as shape = { box_mm = [60, 40, 10] }",
                );
                fallback
            }
            (None, Some(shape)) => {
                if units.is_some() {
                    self.checks.not_accepted(
                        &format!("{table}.units"),
                        "left out beside a shape, whose numbers are in mm",
                    );
                }
                self.shape(&format!("{table}.shape"), shape, voxel_size_m, layers)
                    .map_or(fallback, MeshSource::Shape)
            }
            (Some(mesh), None) => {
                let metres_per_unit = self.metres_per_unit(table, units, "of the mesh file");
                match self.mesh_path(&format!("{table}.mesh"), mesh) {
                    Some(path) => MeshSource::File { path, metres_per_unit },
                    None => fallback,
                }
            }
        }
    }

    /// Units of a file, which must be given.
    pub(super) fn metres_per_unit(
        &mut self,
        table: &str,
        written: Option<schema::UnitWord>,
        of: &str,
    ) -> f64 {
        match written {
            Some(word) => Unit::from(word).metres(),
            None => {
                let accepted = format!("the unit {of}: \"m\", \"mm\", \"cm\" or \"in\"");
                self.checks.missing(&format!("{table}.units"), accepted);
                1.0
            }
        }
    }

    fn mesh_path(&mut self, key: &str, written: &str) -> Option<PathBuf> {
        if let Some(format) = mesh::cad_format(Path::new(written)) {
            self.checks.refuse(
                key,
                ProblemKind::Refused {
                    why: mesh::curved_surfaces(format),
                    hint: Some(mesh::cad_hint(&KEYS)),
                },
            );
            return None;
        }
        if Format::of(Path::new(written)).is_err() {
            self.checks.not_accepted(
                key,
                format_args!("a mesh file whose name ends in {}", mesh_endings()),
            );
            return None;
        }
        self.checks.file(key, written, self.dir)
    }

    fn shape(
        &mut self,
        key: &str,
        written: &schema::Shape,
        voxel_size_m: f64,
        layers: u32,
    ) -> Option<Shape> {
        let schema::Shape {
            box_mm,
            sphere_mm,
            ellipsoid_mm,
            cylinder_mm,
            cone_mm,
            capsule_mm,
            torus_mm,
            plane_mm,
        } = *written;
        let n_given = [
            box_mm.is_some(),
            sphere_mm.is_some(),
            ellipsoid_mm.is_some(),
            cylinder_mm.is_some(),
            cone_mm.is_some(),
            capsule_mm.is_some(),
            torus_mm.is_some(),
            plane_mm.is_some(),
        ];
        if n_given.into_iter().filter(|is_given| *is_given).count() != 1 {
            let accepted = "exactly one of box_mm, sphere_mm, ellipsoid_mm, cylinder_mm, cone_mm, \
                capsule_mm, torus_mm and plane_mm";
            self.checks.not_accepted(key, accepted);
            return None;
        }
        let name = |shape: &str| format!("{key}.{shape}");
        if let Some(edges_mm) = self.checks.array(&name("box_mm"), box_mm, SIZE_MM) {
            return Some(Shape::Box { size_m: DVec3::from_array(edges_mm) * MM });
        }
        if let Some(radius_mm) = self.checks.optional(&name("sphere_mm"), sphere_mm, SIZE_MM) {
            return Some(Shape::Sphere { radius_m: radius_mm * MM });
        }
        if let Some(radii_mm) = self.checks.array(&name("ellipsoid_mm"), ellipsoid_mm, SIZE_MM) {
            return Some(Shape::Ellipsoid { radii_m: DVec3::from_array(radii_mm) * MM });
        }
        if let Some([radius_mm, height_mm]) =
            self.checks.array(&name("cylinder_mm"), cylinder_mm, SIZE_MM)
        {
            return Some(Shape::Cylinder { radius_m: radius_mm * MM, height_m: height_mm * MM });
        }
        if let Some([radius_mm, height_mm]) = self.checks.array(&name("cone_mm"), cone_mm, SIZE_MM)
        {
            return Some(Shape::Cone { radius_m: radius_mm * MM, height_m: height_mm * MM });
        }
        if let Some([radius_mm, height_mm]) =
            self.checks.array(&name("capsule_mm"), capsule_mm, SIZE_MM)
        {
            return Some(Shape::Capsule { radius_m: radius_mm * MM, height_m: height_mm * MM });
        }
        if let Some([major_mm, minor_mm]) = self.checks.array(&name("torus_mm"), torus_mm, SIZE_MM)
        {
            if minor_mm >= major_mm {
                self.checks.not_accepted(
                    &name("torus_mm"),
                    "[R, r] with the tube radius r below the ring radius R",
                );
                return None;
            }
            return Some(Shape::Torus { major_m: major_mm * MM, minor_m: minor_mm * MM });
        }
        let [x_mm, y_mm] = self.checks.array(&name("plane_mm"), plane_mm, SIZE_MM)?;
        // Thicker than the band on both faces, so that the middle is inside for every field and
        // nothing falls through.
        let band_m = (f64::from(layers) + 1.5) * voxel_size_m;
        let thickness_m = (4.0 * band_m).max(0.1 * x_mm.max(y_mm) * MM);
        Some(Shape::Plane { x_m: x_mm * MM, y_m: y_mm * MM, thickness_m })
    }
}

/// Where the geometry of an object is written.
pub(super) struct WrittenSource<'s> {
    pub(super) mesh: Option<&'s str>,
    pub(super) shape: Option<&'s schema::Shape>,
    pub(super) units: Option<schema::UnitWord>,
}
/// Sylvester's criterion.
fn is_positive_definite(matrix: DMat3) -> bool {
    let minor = matrix.x_axis.x * matrix.y_axis.y - matrix.x_axis.y * matrix.y_axis.x;
    matrix.x_axis.x > 0.0 && minor > 0.0 && matrix.determinant() > 0.0
}

/// The endings of mesh files as a sentence lists them.
fn mesh_endings() -> String {
    let endings: Vec<String> = EXTENSIONS.iter().map(|extension| format!(".{extension}")).collect();
    match &endings[..] {
        [rest @ .., last] if !rest.is_empty() => format!("{} or {last}", rest.join(", ")),
        _ => endings.concat(),
    }
}
