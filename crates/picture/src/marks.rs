//! What of a file is no border of its solid: surface inside of it, skins beside it, its hollows.

use super::palette::Rgb;
use vps::mesh::TriangleMesh;
use vps::voxmap::Volume;
use vps::voxmap::fill::{Side, Sides};
use vps::voxmap::grid::cell_of;
use vps::voxmap::layers::Layers;
use vps::voxmap::surface::{Navigation, Surface};

/// Pixels from one line of a hollow's hatching to the next.
const HATCH: i32 = 6;

/// A kind of mark.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Mark {
    LeftOut,
    Skin,
    Hollow,
}

impl Mark {
    pub(super) const ALL: [Self; 3] = [Self::LeftOut, Self::Skin, Self::Hollow];

    /// Of its voxels; of a hollow that of the hatching.
    pub(super) fn color(self) -> Rgb {
        match self {
            Self::LeftOut => [196, 30, 96],
            Self::Skin => [0, 130, 90],
            Self::Hollow => [84, 52, 128],
        }
    }

    pub(super) fn words(self) -> &'static str {
        match self {
            Self::LeftOut => "surface inside of the solid, left out",
            Self::Skin => "skin beside the solid",
            Self::Hollow => "hollow, empty",
        }
    }
}

/// Which marks there are, by [`Mark`].
pub(super) type Present = [bool; Mark::ALL.len()];

/// What is marked of one object.
#[derive(Debug, Default)]
pub struct Marks {
    left_out: Vec<[i32; 3]>,
    skins: Vec<[i32; 3]>,
    /// What a flood from outside reaches, where there can be hollows.
    reached: Option<Sides>,
}

impl Marks {
    /// Those of a map of the triangles of a file; none where these were taken as they are. Cost: at
    /// most that of marking the surface and of the fill once more.
    pub fn of(mesh: &TriangleMesh, map: &Volume) -> Self {
        let Some(solid) = map.solid.as_ref().filter(|_| !map.thin) else {
            return Self::default();
        };
        let left_out = if solid.inside_area_m2 > 0.0 {
            let file = Surface::mark(mesh, &map.surface.grid, Navigation::AUTO);
            let is_left_out =
                |cell: &[i32; 3]| !map.surface.contains(*cell) && map.layers.value(*cell) > 0;
            file.cells().filter(is_left_out).collect()
        } else {
            Vec::new()
        };
        let thin = map.beside.iter().filter(|beside| beside.map.thin);
        Self {
            left_out,
            skins: thin.flat_map(|beside| beside.surface_cells()).collect(),
            reached: (solid.bodies > 1 || !solid.cavities.is_empty())
                .then(|| Sides::flood(&map.surface)),
        }
    }

    /// The surface voxels that are marked, with their marks.
    pub(super) fn voxels(&self) -> impl Iterator<Item = ([i32; 3], Mark)> + '_ {
        let left_out = self.left_out.iter().map(|cell| (*cell, Mark::LeftOut));
        left_out.chain(self.skins.iter().map(|cell| (*cell, Mark::Skin)))
    }

    /// A cell without surface that is outside of the solid and cannot be reached from outside.
    fn is_hollow(&self, surface: &Surface, layers: &Layers, cell: [i32; 3]) -> bool {
        let Some(reached) = &self.reached else { return false };
        layers.value(cell) < 0 && reached.side(surface, cell) == Side::Inside
    }

    /// A pixel of the sheet over this cell belongs to the hatching of a hollow.
    pub(super) fn is_hatched(
        &self,
        surface: &Surface,
        layers: &Layers,
        cell: [i32; 3],
        pixel: [i32; 2],
    ) -> bool {
        is_hatch(pixel) && self.is_hollow(surface, layers, cell)
    }

    /// Which marks there are in each slice across each axis. Cost: linear in the marked voxels, and
    /// in the band where there can be hollows.
    pub(super) fn by_slice(&self, surface: &Surface, layers: &Layers) -> [Vec<Present>; 3] {
        let mut slices = surface.grid.dims.map(|n| vec![Present::default(); n as usize]);
        let mut note = |cell: [i32; 3], mark: Mark| {
            for (slices, place) in slices.iter_mut().zip(cell) {
                if let Some(present) = slices.get_mut(place as usize) {
                    present[mark as usize] = true;
                }
            }
        };
        self.voxels().for_each(|(cell, mark)| note(cell, mark));
        if self.reached.is_some() {
            for (brick, values) in layers.bricks.iter().zip(layers.values.iter()) {
                let coord = layers.grid.brick_coord(*brick as usize);
                let outside = (0..values.len()).filter(|inside| values[*inside] < 0);
                outside
                    .map(|inside| cell_of(coord, inside))
                    .filter(|cell| self.is_hollow(surface, layers, *cell))
                    .for_each(|cell| note(cell, Mark::Hollow));
            }
        }
        slices
    }
}

/// A pixel lies on a line of the hatching.
pub(super) fn is_hatch([column, row]: [i32; 2]) -> bool {
    (column + row) % HATCH == 0
}
