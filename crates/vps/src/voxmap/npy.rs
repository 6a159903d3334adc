//! Dense exports for NumPy: `.npy`, C order, written slab by slab so that memory follows the
//! surface and not the box.

use std::io::{self, Write};
use std::path::Path;

use super::distance::Distances;
use super::grid::{BRICK_EDGE, Grid};
use super::layers::Layers;
use crate::storage::whole_file::{Access, write_whole};

/// Voxels up to which a dense export is written.
pub const DENSE_CELLS_MAX: u64 = 1 << 32;

/// Writes the layer values as int8, shape `dims`.
///
/// # Errors
/// Any error of the file system; `InvalidInput` above [`DENSE_CELLS_MAX`] cells.
pub fn write_layers(path: &Path, layers: &Layers) -> io::Result<()> {
    write(path, &layers.grid, "|i1", |cell| layers.value(cell).to_le_bytes())
}

/// Writes the signed distances as float32 in metres, shape `dims`, NaN beyond the band.
///
/// # Errors
/// Any error of the file system; `InvalidInput` above [`DENSE_CELLS_MAX`] cells.
pub fn write_distances(path: &Path, layers: &Layers, distances: &Distances) -> io::Result<()> {
    let beyond = layers.n_layers as i8 + 1;
    write(path, &layers.grid, "<f4", |cell| {
        let (brick, inside) = layers.grid.locate(cell);
        let value = match layers.slot(brick) {
            Some(slot) if layers.values[slot][inside].abs() < beyond => {
                distances.values_m[slot][inside]
            }
            _ => f32::NAN,
        };
        value.to_le_bytes()
    })
}

fn write<const N: usize>(
    path: &Path,
    grid: &Grid,
    dtype: &str,
    value: impl Fn([i32; 3]) -> [u8; N],
) -> io::Result<()> {
    if grid.n_cells() > DENSE_CELLS_MAX {
        let [nx, ny, nz] = grid.dims;
        return Err(io::Error::new(
            io::ErrorKind::InvalidInput,
            format!(
                "a dense export of {nx} x {ny} x {nz} voxels is above the limit of 2^32; use \
                    larger voxels"
            ),
        ));
    }
    write_whole(path, Access::Shared, |file| write_to(file, grid, dtype, value))
}

fn write_to<const N: usize>(
    file: &mut impl Write,
    grid: &Grid,
    dtype: &str,
    value: impl Fn([i32; 3]) -> [u8; N],
) -> io::Result<()> {
    let [nx, ny, nz] = grid.dims;
    let mut header =
        format!("{{'descr': '{dtype}', 'fortran_order': False, 'shape': ({nx}, {ny}, {nz}), }}");
    // Magic, version and length take 10 bytes; the data starts at a multiple of 64.
    let padded = (10 + header.len() + 1).next_multiple_of(64) - 10;
    while header.len() + 1 < padded {
        header.push(' ');
    }
    header.push('\n');
    file.write_all(b"\x93NUMPY\x01\x00")?;
    file.write_all(&(header.len() as u16).to_le_bytes())?;
    file.write_all(header.as_bytes())?;
    let mut row = Vec::with_capacity(nz as usize * N + BRICK_EDGE);
    for x in 0..nx as i32 {
        for y in 0..ny as i32 {
            row.clear();
            for z in 0..nz as i32 {
                row.extend_from_slice(&value([x, y, z]));
            }
            file.write_all(&row)?;
        }
    }
    Ok(())
}
