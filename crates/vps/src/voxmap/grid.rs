//! Index arithmetic: metres ↔ cells ↔ bricks.
//!
//! A voxel (cell) `[i, j, k]` covers `origin + s·[i..i+1, j..j+1, k..k+1]`. Eight cells on an edge
//! make a brick; bricks are numbered with z fastest, like the cells of a NumPy array in C order.

use glam::DVec3;
use thiserror::Error;

use super::memory_limit::{MemoryLimit, show_bytes};
use crate::setting_names::SettingNames;

/// Cells on a brick's edge.
pub const BRICK_EDGE: usize = 8;
/// Cells in a brick.
pub const BRICK_CELLS: usize = BRICK_EDGE * BRICK_EDGE * BRICK_EDGE;
/// Cells per axis up to which an `f32` cell coordinate still resolves 1/256 of a voxel.
pub const CELLS_PER_AXIS_MAX: u64 = 32_768;
/// Bricks up to which the top grid (4 bytes each) stays below half a gigabyte.
pub const BRICKS_MAX: u64 = 1 << 27;

/// Surface voxels up to which a `u32` numbers them, here and in the pointshell.
pub const SURFACE_VOXELS_MAX: u64 = u32::MAX as u64;

/// A grid that cannot be built.
#[derive(Debug, Error, PartialEq)]
pub enum GridError {
    /// Too many voxels for one map.
    #[error("a grid of {} x {} x {} voxels is too large (at most {CELLS_PER_AXIS_MAX} per axis and \
        {BRICKS_MAX} bricks of 8³)", dims[0], dims[1], dims[2])]
    TooLarge {
        /// Voxels per axis that the voxel size asks for.
        dims: [u64; 3],
        /// Smallest voxel size that fits, m: into one map, and into the memory where the caller
        /// judged that.
        voxel_size_m: f64,
    },
    /// More surface voxels than can be numbered.
    #[error("{n_voxels} surface voxels are too many (at most {SURFACE_VOXELS_MAX})")]
    Surface {
        /// Surface voxels.
        n_voxels: u64,
        /// A voxel size with which they can be numbered, m.
        voxel_size_m: f64,
    },
    /// More memory than allowed.
    #[error("baking takes about {}{}", limit.exceeded_by(*needed_bytes), kept_text(*kept_bytes))]
    Memory {
        /// Most bytes held at a time, by estimate, `kept_bytes` among them.
        needed_bytes: u64,
        /// What parts that were baked before keep of them.
        kept_bytes: u64,
        /// What may be taken.
        limit: MemoryLimit,
        /// Voxel size asked for, m.
        asked_m: f64,
        /// Smallest voxel size that fits, m; `None` where coarser voxels do not help.
        voxel_size_m: Option<f64>,
    },
    /// Voxel size not a positive number.
    #[error("voxel size must be greater than 0, found {0} m")]
    VoxelSize(f64),
    /// The caller ended the bake.
    #[error("the bake was cancelled")]
    Cancelled,
}

impl GridError {
    /// A voxel size that fits, m, where there is one.
    pub fn fitting_voxel_size_m(&self) -> Option<f64> {
        match self {
            Self::TooLarge { voxel_size_m, .. } | Self::Surface { voxel_size_m, .. } => {
                Some(*voxel_size_m)
            }
            Self::Memory { voxel_size_m, .. } => *voxel_size_m,
            Self::VoxelSize(_) | Self::Cancelled => None,
        }
    }

    /// What to do about it.
    pub fn hint(&self, names: &SettingNames) -> String {
        let hint = self.hint_at_this_size(names);
        match self {
            Self::TooLarge { .. } => format!("{hint}, or check {}", names.unit),
            _ => hint,
        }
    }

    /// The same of a part that is as large as its mesh says.
    pub fn hint_at_this_size(&self, names: &SettingNames) -> String {
        match self {
            Self::TooLarge { voxel_size_m, .. } | Self::Surface { voxel_size_m, .. } => {
                format!("use a voxel size of at least {} mm", round_up(voxel_size_m * 1e3))
            }
            Self::Memory { voxel_size_m: Some(voxel_size_m), limit, .. } => {
                format!(
                    "use a voxel size of at least {} mm, fewer layers, or {}",
                    round_up(voxel_size_m * 1e3),
                    limit.remedy(names)
                )
            }
            Self::Memory { voxel_size_m: None, limit, .. } => {
                let verb = if let MemoryLimit::Given(_) = limit { "use " } else { "" };
                format!("coarser voxels alone do not help: {verb}{}", limit.remedy(names))
            }
            Self::VoxelSize(_) => "give the edge of a voxel, such as 0.5 mm".to_owned(),
            Self::Cancelled => "bake it again".to_owned(),
        }
    }
}

fn kept_text(kept_bytes: u64) -> String {
    if kept_bytes == 0 {
        String::new()
    } else {
        format!(", of which the parts before it keep {}", show_bytes(kept_bytes))
    }
}

/// A voxel edge, m, with which a box fits; within a few per cent of the smallest.
fn smallest_size(extent: DVec3, pad: f64) -> f64 {
    // One voxel for the offset and one for the partial cell at the end.
    let around = 2.0 * pad + 2.0;
    let mut size = extent.max_element() / (CELLS_PER_AXIS_MAX as f64 - around);
    // At most a factor of eight from there; the padding forbids the cube root.
    while extent
        .to_array()
        .iter()
        .map(|edge| ((edge / size + around) / BRICK_EDGE as f64).ceil())
        .product::<f64>()
        > BRICKS_MAX as f64
    {
        size *= 1.01;
    }
    size
}

/// Three digits, never below the value, so that the advice works when it is copied.
pub(crate) fn round_up(value: f64) -> String {
    three_digits(value, f64::ceil)
}

/// The nearest three digits.
pub(crate) fn round_near(value: f64) -> String {
    // So that rounding of 0.1 does not give it a digit more.
    three_digits(value * (1.0 + 1e-9), f64::round)
}

fn three_digits(value: f64, round: fn(f64) -> f64) -> String {
    if !(value > 0.0 && value.is_finite()) {
        return value.to_string();
    }
    let decimals = (2.0 - value.log10().floor()).clamp(0.0, 15.0) as usize;
    let unit = 10_f64.powi(decimals as i32);
    format!("{:.decimals$}", round(value * unit) / unit)
}

/// A voxel grid in the map frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    /// Lowest corner of cell `[0, 0, 0]`, map frame, m.
    pub origin_m: DVec3,
    /// Voxel edge s, m.
    pub voxel_size_m: f64,
    /// Cells along x, y, z.
    pub dims: [u32; 3],
}

impl Grid {
    /// The grid around a box, padded by `layers + 1` cells on every side so that an outside corner
    /// exists for the fill and the band never leaves the grid.
    ///
    /// The low face of the box lies half a voxel inside its cell, so that an axis-aligned face of
    /// the model never lies on a voxel boundary, where it would mark two layers. When the box's
    /// extent makes the *high* face land on a boundary (fraction of extent/s within 10⁻³ of ½) the
    /// offset is a quarter voxel instead. Per axis, with e the extent: `o = s/2 or s/4`, `origin =
    /// low − o − (layers + 1)·s`, `dims = ⌊(e + o)/s⌋ + 1 + 2·(layers + 1)`.
    ///
    /// # Errors
    /// A voxel size that is not positive, or a grid beyond [`CELLS_PER_AXIS_MAX`] or
    /// [`BRICKS_MAX`].
    pub fn around(
        low_m: DVec3,
        high_m: DVec3,
        voxel_size_m: f64,
        layers: u32,
    ) -> Result<Self, GridError> {
        let s = voxel_size_m;
        if !(s > 0.0 && s.is_finite()) {
            return Err(GridError::VoxelSize(s));
        }
        let pad = f64::from(layers + 1);
        let extent = high_m - low_m;
        let mut origin_m = DVec3::ZERO;
        let mut dims = [0_u64; 3];
        for axis in 0..3 {
            let in_voxels = extent[axis] / s;
            let on_boundary = (in_voxels - in_voxels.floor() - 0.5).abs() < 1e-3;
            let offset = if on_boundary { 0.25 } else { 0.5 };
            origin_m[axis] = low_m[axis] - (offset + pad) * s;
            // Saturates: an absurd size is refused below.
            dims[axis] =
                ((in_voxels + offset).floor() as u64).saturating_add(1 + 2 * u64::from(layers + 1));
        }
        // Exact where it matters: the limit is far below 2⁵³.
        let bricks: f64 = dims.iter().map(|n| n.div_ceil(BRICK_EDGE as u64) as f64).product();
        if dims.iter().any(|n| *n > CELLS_PER_AXIS_MAX) || bricks > BRICKS_MAX as f64 {
            return Err(GridError::TooLarge { dims, voxel_size_m: smallest_size(extent, pad) });
        }
        Ok(Self { origin_m, voxel_size_m, dims: dims.map(|n| n as u32) })
    }

    /// The bricks of this grid around a box that lies in it, padded as [`Self::around`] pads, as a
    /// grid of their own; and the coordinate of the first of them here.
    pub(super) fn part_around(&self, low_m: DVec3, high_m: DVec3, layers: u32) -> (Self, [u32; 3]) {
        let pad = f64::from(layers + 1);
        let low = (self.to_cells(low_m) - pad).floor();
        let high = (self.to_cells(high_m) + pad).floor();
        let edge = BRICK_EDGE as u32;
        // Casts saturate: the low side of the padding ends in cell 0.
        let first = low.to_array().map(|cell| cell as u32 / edge);
        let ends = high.to_array().map(|cell| (cell as u32 / edge + 1) * edge);
        let dims =
            core::array::from_fn(|axis| ends[axis].min(self.dims[axis]) - first[axis] * edge);
        let [x, y, z] = brick_origin(first).map(f64::from);
        let origin_m = self.origin_m + self.voxel_size_m * DVec3::new(x, y, z);
        (Self { origin_m, voxel_size_m: self.voxel_size_m, dims }, first)
    }

    /// Continuous cell coordinates of a point of the map frame: cell `[i, j, k]` covers `[i..i+1,
    /// j..j+1, k..k+1]`.
    pub fn to_cells(&self, point_map: DVec3) -> DVec3 {
        (point_map - self.origin_m) / self.voxel_size_m
    }

    /// Centre of a cell in the map frame, m.
    pub fn center_map(&self, cell: [i32; 3]) -> DVec3 {
        self.origin_m
            + self.voxel_size_m * (DVec3::new(cell[0].into(), cell[1].into(), cell[2].into()) + 0.5)
    }

    /// Cells in the box.
    pub fn n_cells(&self) -> u64 {
        self.dims.iter().map(|n| u64::from(*n)).product()
    }

    /// Bricks along x, y, z; the last may stick out of the box.
    pub fn brick_dims(&self) -> [u32; 3] {
        self.dims.map(|n| n.div_ceil(BRICK_EDGE as u32))
    }

    /// Bricks in the box.
    pub fn n_bricks(&self) -> usize {
        self.brick_dims().iter().map(|n| *n as usize).product()
    }

    /// Number of a brick; the coordinate must lie in the grid.
    pub fn brick_index(&self, brick: [u32; 3]) -> usize {
        let [_, ny, nz] = self.brick_dims();
        (brick[0] as usize * ny as usize + brick[1] as usize) * nz as usize + brick[2] as usize
    }

    /// Coordinate of brick number `index`.
    pub fn brick_coord(&self, index: usize) -> [u32; 3] {
        let [_, ny, nz] = self.brick_dims().map(|n| n as usize);
        [(index / (ny * nz)) as u32, (index / nz % ny) as u32, (index % nz) as u32]
    }

    /// The neighbour of a brick at `offset`, or `None` beyond the grid.
    pub fn brick_neighbour(&self, brick: [u32; 3], offset: [i32; 3]) -> Option<usize> {
        let dims = self.brick_dims();
        let mut neighbour = [0_u32; 3];
        for axis in 0..3 {
            let moved = brick[axis] as i32 + offset[axis];
            if moved < 0 || moved >= dims[axis] as i32 {
                return None;
            }
            neighbour[axis] = moved as u32;
        }
        Some(self.brick_index(neighbour))
    }

    /// Brick number and cell number inside it; the cell must lie in the grid.
    pub fn locate(&self, cell: [i32; 3]) -> (usize, usize) {
        let brick = cell.map(|i| i as u32 / BRICK_EDGE as u32);
        (self.brick_index(brick), cell_in_brick(cell))
    }

    /// True when the cell lies in the grid.
    pub fn contains(&self, cell: [i32; 3]) -> bool {
        (0..3).all(|axis| cell[axis] >= 0 && cell[axis] < self.dims[axis] as i32)
    }
}

/// Number of a cell inside its brick, z fastest.
fn cell_in_brick(cell: [i32; 3]) -> usize {
    let [x, y, z] = cell.map(|i| i as usize % BRICK_EDGE);
    (x * BRICK_EDGE + y) * BRICK_EDGE + z
}

/// First cell of a brick.
pub fn brick_origin(brick: [u32; 3]) -> [i32; 3] {
    brick.map(|i| (i as usize * BRICK_EDGE) as i32)
}

/// Cell of a brick by its number inside.
pub fn cell_of(brick: [u32; 3], inside: usize) -> [i32; 3] {
    let origin = brick_origin(brick);
    [
        origin[0] + (inside >> 6) as i32,
        origin[1] + (inside >> 3 & 7) as i32,
        origin[2] + (inside & 7) as i32,
    ]
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn cells_bricks_and_metres_round_trip(
            i in 0_i32..200, j in 0_i32..90, k in 0_i32..60, s in 1e-4_f64..1e-2, low in -0.5_f64..0.5,
        ) {
            let low_m = DVec3::splat(low);
            let grid = Grid::around(low_m, low_m + s * DVec3::new(210.0, 100.0, 70.0), s, 3).expect("small grid");
            let cell = [i, j, k];
            let (brick, inside) = grid.locate(cell);
            prop_assert_eq!(cell_of(grid.brick_coord(brick), inside), cell);
            let back = grid.to_cells(grid.center_map(cell)).floor();
            prop_assert_eq!([back.x as i32, back.y as i32, back.z as i32], cell);
        }

        #[test]
        fn no_face_of_the_box_lies_on_a_voxel_boundary(extent in 0.0_f64..300.0) {
            let s = 1.0;
            let grid = Grid::around(DVec3::ZERO, DVec3::splat(extent), s, 2).expect("small grid");
            for face in [0.0, extent] {
                let u = grid.to_cells(DVec3::splat(face)).x;
                prop_assert!((u - u.round()).abs() > 5e-4, "extent {} puts face {} at {}", extent, face, u);
                prop_assert!(u > 3.0 && u < f64::from(grid.dims[0]) - 3.0);
            }
        }
    }

    #[test]
    fn an_extent_of_half_a_voxel_more_moves_the_grid_by_a_quarter() {
        for extent in [0.5, 7.4995, 10.5, 10.5004, 299.5] {
            let grid = Grid::around(DVec3::ZERO, DVec3::splat(extent), 1.0, 2).expect("small grid");
            let face = grid.to_cells(DVec3::splat(extent)).x;
            assert!(
                (face - face.round()).abs() > 0.2,
                "extent {extent} puts its high face at {face}"
            );
            assert_eq!(grid.to_cells(DVec3::ZERO).x, 3.25);
        }
        assert_eq!(
            Grid::around(DVec3::ZERO, DVec3::splat(10.4), 1.0, 2)
                .expect("small grid")
                .to_cells(DVec3::ZERO)
                .x,
            3.5
        );
    }

    #[test]
    fn an_absurd_grid_is_refused_with_a_voxel_size_that_fits() {
        let boxes = [DVec3::ONE, DVec3::new(1.0, 0.01, 0.01), DVec3::new(0.124, 0.1, 0.02)];
        for (extent, size) in
            boxes.into_iter().flat_map(|extent| [1e-7, 1e-12, 1e-300].map(|size| (extent, size)))
        {
            let error =
                Grid::around(DVec3::ZERO, extent, size, 8).expect_err("10^7 voxels wide at least");
            let hint = error.hint(&SettingNames::PLAIN);
            let millimetres = hint
                .strip_prefix("use a voxel size of at least ")
                .and_then(|hint| hint.split(' ').next());
            let size_mm: f64 =
                millimetres.and_then(|word| word.parse().ok()).unwrap_or_else(|| panic!("{hint}"));
            Grid::around(DVec3::ZERO, extent, size_mm * 1e-3, 8)
                .unwrap_or_else(|error| panic!("{hint}: {error}"));
        }
        assert!(Grid::around(DVec3::ZERO, DVec3::ONE, 0.0, 8).is_err());
    }
}
