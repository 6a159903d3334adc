//! What distinguishes inside from outside: the fill where it holds, winding numbers where it leaks
//! and they are clear, else nothing.
//!
//! Of the border of a solid, what the fill does not reach is inside but for hollows. Of other
//! triangles it is inside too, also the hollow of a nested shell: nothing can get there.

use super::fill::Sides;
use super::hole_cap::{self, CappedMesh};
use super::leak::{FaceProbe, FaceSamples, LEAKING, Leak, MOSTLY_THIN};
use super::surface::Surface;
use super::winding::{WindingTree, winding_number};
use crate::mesh::TriangleMesh;
use crate::mesh::validate::MeshReport;

/// How to distinguish inside and outside.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum InsideTest {
    /// Closed pieces are one solid, without hollows. What is not closed: by the fill; where it
    /// leaks by winding numbers if they are clear, else a thin skin; a thin skin too where most of
    /// its surface is thinner than its voxels.
    #[default]
    Auto,
    /// All triangles as they are: only what the fill leaves is inside, whatever is left.
    Flood,
    /// As `Auto`, but holes get lids where the winding number is ½, whatever is made of it.
    Winding,
    /// A thin two-sided skin, also of a closed part.
    Thin,
}

impl InsideTest {
    /// The names of the scene file and of the command line.
    ///
    /// # Examples
    /// ```
    /// # use vps::InsideTest;
    /// let of_text = InsideTest::NAMES.into_iter().find(|(name, _)| *name == "thin");
    /// assert_eq!(of_text, Some(("thin", InsideTest::Thin)));
    /// ```
    pub const NAMES: [(&'static str, Self); 4] = [
        ("auto", Self::Auto),
        ("flood", Self::Flood),
        ("winding", Self::Winding),
        ("thin", Self::Thin),
    ];
}

/// How inside and outside were distinguished.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InsideBasis {
    /// By the fill alone.
    Flood,
    /// By the fill, stopped by lids where winding numbers put them.
    Winding,
    /// Everything is outside.
    Thin,
}

impl InsideBasis {
    /// The name in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Flood => "flood",
            Self::Winding => "winding",
            Self::Thin => "thin",
        }
    }
}

/// Share of the places beside the surface whose winding number must be near a whole number before
/// it is trusted unasked.
///
/// A hole spoils the places from which it is seen large. Measured: spheres with a hole of a quarter
/// of their radius are above this, the Stanford bunny, open at the bottom, has 99 %; a tube of
/// three diameters, closed at one end, has 89 %, a cube without one of its faces 61 %, half a
/// sphere 3 %.
const CLEAR_SHARE: f64 = 0.95;

/// Places whose winding numbers are summed over all triangles: for more of them a tree pays.
const FEW: usize = 8;

/// Inside and outside of one object, and how they were found.
#[derive(Debug)]
pub(super) struct Verdict {
    /// Surface voxels, those of the lids included.
    pub(super) surface: Surface,
    pub(super) sides: Sides,
    pub(super) basis: InsideBasis,
    /// Where the fill of the mesh as it is got in.
    pub(super) leak: Option<Leak>,
    pub(super) thin_share: f64,
    /// Share of clear winding numbers beside the surface; `None` when it was not measured.
    pub(super) clear_share: Option<f64>,
    pub(super) capped: Option<CappedMesh>,
}

impl Verdict {
    /// Of the border of a solid: what the fill does not reach is inside, but for hollows, where
    /// the border does not wind around: in cavities, between several bodies, and behind slits that
    /// are too narrow for the fill.
    pub(super) fn of_border(border: &TriangleMesh, surface: Surface, rule: InsideTest) -> Self {
        let mut sides = Sides::flood(&surface);
        let grid = surface.grid;
        let mut n_asked = 0;
        let mut tree = None;
        sides.empty_hollows(&surface, |cell| {
            let place = grid.center_map(cell);
            n_asked += 1;
            let winding = if n_asked <= FEW {
                winding_number(border, place)
            } else {
                let tree = tree.get_or_insert_with(|| WindingTree::new(border));
                tree.at(&[place]).into_iter().sum()
            };
            winding < 0.5
        });
        Self {
            surface,
            sides,
            basis: match rule {
                InsideTest::Winding => InsideBasis::Winding,
                InsideTest::Auto | InsideTest::Flood | InsideTest::Thin => InsideBasis::Flood,
            },
            leak: None,
            thin_share: 0.0,
            clear_share: None,
            capped: None,
        }
    }

    /// Fills, looks for leaks and closes them. Winding numbers are asked only where the fill leaks,
    /// or on demand.
    pub(super) fn reach(
        mesh: &TriangleMesh,
        report: &MeshReport,
        surface: Surface,
        rule: InsideTest,
    ) -> Self {
        let sides = Sides::flood(&surface);
        let samples = FaceSamples::draw(mesh);
        let FaceProbe { leak, thin_share, winding } = samples.probe(report, &surface, &sides);
        let winding = match rule {
            InsideTest::Winding => Some(winding.unwrap_or_else(|| WindingTree::new(mesh))),
            InsideTest::Auto => winding.filter(|_| leak.is_some()),
            InsideTest::Flood | InsideTest::Thin => None,
        };
        let clear_share =
            winding.as_ref().map(|winding| samples.clear_share(&surface, &sides, winding));
        let closed = winding
            .filter(|_| rule == InsideTest::Winding || clear_share >= Some(CLEAR_SHARE))
            .and_then(|winding| Closed::new(&samples, mesh, report, &surface, &winding));
        let mut verdict = Self {
            surface,
            sides,
            basis: InsideBasis::Flood,
            leak,
            thin_share,
            clear_share,
            capped: None,
        };
        match (rule, closed) {
            (InsideTest::Winding, closed) => {
                if let Some(closed) = closed {
                    verdict.adopt(closed);
                }
                verdict.basis = InsideBasis::Winding;
            }
            (InsideTest::Auto, Some(closed)) if closed.holds => verdict.adopt(closed),
            (InsideTest::Auto, _) if leak.is_some() || thin_share > MOSTLY_THIN => {
                verdict.become_thin()
            }
            (InsideTest::Thin, _) => verdict.become_thin(),
            (InsideTest::Auto | InsideTest::Flood, _) => {}
        }
        verdict
    }

    fn adopt(&mut self, closed: Closed) {
        self.basis = InsideBasis::Winding;
        self.surface = closed.surface;
        self.sides = closed.sides;
        self.thin_share = closed.thin_share;
        self.capped = Some(closed.capped);
    }

    fn become_thin(&mut self) {
        self.basis = InsideBasis::Thin;
        self.sides = Sides::without_inside(&self.surface);
    }
}

/// An object with lids on its holes, filled again.
struct Closed {
    surface: Surface,
    sides: Sides,
    capped: CappedMesh,
    thin_share: f64,
    /// The fill does not leak any more, and what it left is not mostly a skin.
    holds: bool,
}

impl Closed {
    /// `None` when there was nothing to put a lid on.
    fn new(
        samples: &FaceSamples<'_>,
        mesh: &TriangleMesh,
        report: &MeshReport,
        open: &Surface,
        winding: &WindingTree,
    ) -> Option<Self> {
        let (capped, surface) = hole_cap::close(mesh, report, open, winding)?;
        let sides = Sides::flood(&surface);
        let (flooded_share, thin_share) = samples.flooded_and_thin(&surface, &sides, winding);
        Some(Self {
            surface,
            sides,
            capped,
            thin_share,
            holds: flooded_share < LEAKING && thin_share <= MOSTLY_THIN,
        })
    }
}
