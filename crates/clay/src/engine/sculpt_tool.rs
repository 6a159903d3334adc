//! What the tool does to the clay.

use std::fmt;
use std::sync::Arc;

use super::super::boolean::Boolean;
use super::super::emboss::GreyImage;
use super::super::falloff::Falloff;
use super::super::material_map::Painted;
use super::super::mesh_solid::MeshSolid;
use super::super::{SolidSource, SurfaceError, WorkMeter};
use vps::mesh::FileMesh;

/// What the tool does to the clay. Whatever it does, the hand feels the surface.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum SculptTool {
    /// Nothing: the hand feels the surface, and it stays as it is.
    Touch,
    /// The force of the hand dents the surface where the tool touches it.
    #[default]
    Push,
    /// Point rope: while it is held, a rope from the place that was grabbed to the tool pulls the
    /// material along.
    Pull,
    /// Curve rope: the first hold draws a curve over the surface, the next one pulls all of it
    /// along.
    PullCurve,
    /// Colours the surface where the tool presses; harder is wider.
    Paint,
    /// Paints mass, damping and stiffness of the mass points where the tool presses, and colours
    /// the surface there; harder is wider.
    Material,
    /// Raises the surface by an image where it is held.
    Emboss,
    /// Sinks an image into the surface where it is held.
    Engrave,
    /// Adds the tool's own shape where it is held.
    Union,
    /// Leaves what is inside of the tool's own shape.
    Intersection,
    /// Cuts the tool's own shape out.
    Difference,
    /// Chooses what deforms: the box from where it is held to where it is let go.
    Region,
}

impl SculptTool {
    /// The words in files, commands and menus, in the order of a menu.
    pub const NAMES: [(&'static str, Self); 12] = [
        ("touch", Self::Touch),
        ("push", Self::Push),
        ("pull", Self::Pull),
        ("pull-curve", Self::PullCurve),
        ("paint", Self::Paint),
        ("material", Self::Material),
        ("emboss", Self::Emboss),
        ("engrave", Self::Engrave),
        ("union", Self::Union),
        ("intersection", Self::Intersection),
        ("difference", Self::Difference),
        ("region", Self::Region),
    ];

    /// The tool of a word.
    pub fn of(word: &str) -> Option<Self> {
        Self::NAMES.iter().find(|(name, _)| *name == word).map(|(_, kind)| *kind)
    }

    /// The word for it in scenes and orders.
    pub fn name(self) -> &'static str {
        Self::NAMES.iter().find(|(_, kind)| *kind == self).map_or("touch", |(name, _)| name)
    }

    /// It works while the tool is held, or when it is taken hold of; the others work by touch.
    pub(crate) fn is_held(self) -> bool {
        !matches!(self, Self::Touch | Self::Push | Self::Paint | Self::Material)
    }

    /// What becomes of the tool's shape and the clay, for those three tools.
    pub(crate) fn boolean(self) -> Option<Boolean> {
        match self {
            Self::Union => Some(Boolean::Union),
            Self::Intersection => Some(Boolean::Intersection),
            Self::Difference => Some(Boolean::Difference),
            _ => None,
        }
    }
}

impl fmt::Display for SculptTool {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// A tool with its settings.
#[derive(Clone, Debug, PartialEq)]
pub struct ToolSettings {
    /// What it does.
    pub kind: SculptTool,
    /// Radius around the tool within which material moves, is coloured (at [`Self::FULL_FORCE_N`])
    /// or embossed, m.
    pub brush_m: f64,
    /// How push, pull, paint and material fade towards that radius; constant paint has a sharp rim.
    pub falloff: Falloff,
    /// Of paint, and of the surface where material is painted, sRGB.
    pub color: [u8; 3],
    /// Of the tool material; where it says nothing, [so many times](Painted::HARDER) as hard as
    /// the clay.
    pub painted: Painted,
    /// Depth of white in an image, m.
    pub depth_m: f64,
    /// What is embossed and engraved; without one, a round dome.
    pub image: Option<Arc<GreyImage>>,
    /// What is joined with the clay, or cuts it; without one, the tool's own shape.
    pub solid: Option<ChosenSolid>,
    /// Edges of Booleans stay sharp, as far as the raster holds them.
    pub is_sharp: bool,
}

/// A solid in the place of the tool's own shape, in the tool's frame.
#[derive(Clone, Debug)]
pub struct ChosenSolid {
    /// The solid; sampled as densely as the clay is then.
    pub source: Arc<SolidSource>,
    /// What to call it, and what a user should know of its file.
    pub name: Arc<str>,
}

impl ChosenSolid {
    /// The solid of a mesh, with the middle of its box where the tool is, named by what it is.
    ///
    /// # Errors
    /// [`SurfaceError`] for a mesh without area.
    pub fn centered(file: FileMesh) -> Result<Self, SurfaceError> {
        let n_triangles = file.mesh.triangles.len();
        // As finely as the clay it will be sampled, which is not known yet.
        let MeshSolid { border: mut mesh, warnings } = MeshSolid::new(file, None);
        let (low, high) = mesh.bounds().unwrap_or_default();
        mesh.vertices.iter_mut().for_each(|at| *at -= 0.5 * (low + high));
        let size_mm = (high - low) * 1e3;
        let what = format!(
            "{n_triangles} triangles, {:.1} x {:.1} x {:.1} mm",
            size_mm.x, size_mm.y, size_mm.z
        );
        let name = [vec![what], warnings].concat().join("; ");
        let source = Arc::new(SolidSource::Mesh(mesh));
        // As it will be sampled: what makes no surface is refused now, not by the hand.
        source.beside(0.05 * (high - low).max_element(), &WorkMeter::unlimited())?;
        Ok(Self { source, name: name.into() })
    }
}

impl PartialEq for ChosenSolid {
    /// The very same one.
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.source, &other.source)
    }
}

impl ToolSettings {
    /// The force at which a brush has its full radius, N.
    pub const FULL_FORCE_N: f64 = 2.0;
}

/// Settings of the tool that change; what is `None` stays.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ToolChange {
    /// [`ToolSettings::kind`].
    pub kind: Option<SculptTool>,
    /// [`ToolSettings::brush_m`], m.
    pub brush_m: Option<f64>,
    /// [`ToolSettings::falloff`].
    pub falloff: Option<Falloff>,
    /// [`ToolSettings::color`].
    pub color: Option<[u8; 3]>,
    /// [`ToolSettings::painted`].
    pub painted: Option<Painted>,
    /// [`ToolSettings::depth_m`], m.
    pub depth_m: Option<f64>,
    /// [`ToolSettings::image`]; `Some(None)`: none.
    pub image: Option<Option<Arc<GreyImage>>>,
    /// [`ToolSettings::solid`]; `Some(None)`: none.
    pub solid: Option<Option<ChosenSolid>>,
    /// [`ToolSettings::is_sharp`].
    pub is_sharp: Option<bool>,
}

impl ToolChange {
    /// The settings with this change.
    pub fn onto(self, tool: &ToolSettings) -> ToolSettings {
        ToolSettings {
            kind: self.kind.unwrap_or(tool.kind),
            brush_m: self.brush_m.unwrap_or(tool.brush_m),
            falloff: self.falloff.unwrap_or_else(|| tool.falloff.clone()),
            color: self.color.unwrap_or(tool.color),
            painted: self.painted.unwrap_or(tool.painted),
            depth_m: self.depth_m.unwrap_or(tool.depth_m),
            image: self.image.unwrap_or_else(|| tool.image.clone()),
            solid: self.solid.unwrap_or_else(|| tool.solid.clone()),
            is_sharp: self.is_sharp.unwrap_or(tool.is_sharp),
        }
    }
}

impl Default for ToolSettings {
    /// A soft push, 5 mm wide.
    fn default() -> Self {
        Self {
            kind: SculptTool::default(),
            brush_m: 5e-3,
            falloff: Falloff::default(),
            color: [200, 60, 40],
            painted: Painted::default(),
            depth_m: 1e-3,
            image: None,
            solid: None,
            is_sharp: false,
        }
    }
}
