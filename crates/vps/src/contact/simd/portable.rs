//! Lane by lane: the specification of the kernels.

use super::*;

pub(super) fn block(bounds: &BrickBounds, place: &Place, positions: &Lanes3, floor_m: f32) -> Depths {
    let mut depths = Depths { depths_m: Lanes([f32::NEG_INFINITY; LANES]), touching: 0, max_m: f32::NEG_INFINITY };
    for (lane, depth_m) in depths.depths_m.0.iter_mut().enumerate() {
        *depth_m = value(bounds, place, positions.get(lane), floor_m);
        depths.touching |= u16::from(*depth_m > 0.0) << lane;
        depths.max_m = greater(*depth_m, depths.max_m);
    }
    depths
}

fn value(bounds: &BrickBounds, place: &Place, position: Vec3, floor_m: f32) -> f32 {
    let lattice = cells(place, position) - 0.5;
    let base = [lattice.x as i32, lattice.y as i32, lattice.z as i32];
    let [bx, by, bz] = base.map(|cell| cell >> 3);
    let [nx, ny, nz] = bounds.dims();
    let outside_m = bounds.skin_m() - bounds.band_m();
    if bx as u32 >= nx as u32 || by as u32 >= ny as u32 || bz as u32 >= nz as u32 {
        return outside_m;
    }
    let brick = ((bx * ny + by) * nz + bz) as usize;
    let ceiling_m = bounds.max_depth_m().get(brick).copied().unwrap_or(outside_m);
    // So written, a lane that is not a number is as good as any other.
    if ceiling_m <= floor_m {
        return ceiling_m;
    }
    let slot = bounds.top().get(brick).copied().unwrap_or(FAR_OUTSIDE);
    let corners = match slot {
        FAR_OUTSIDE | DEEP_INSIDE => return ceiling_m,
        slot => corners(bounds, slot, base),
    };
    let t = lattice - Vec3::new(base[0] as f32, base[1] as f32, base[2] as f32);
    mixed(&corners, t).clamp(-bounds.band_m(), bounds.band_m()) + bounds.skin_m()
}

fn cells(place: &Place, position: Vec3) -> Vec3 {
    let Mat3 { x_axis, y_axis, z_axis } = place.axes;
    x_axis * position.x + y_axis * position.y + z_axis * position.z + place.origin
}

fn corners(bounds: &BrickBounds, slot: u32, [x, y, z]: [i32; 3]) -> [f32; 8] {
    let first = (x & 7) as usize * PLANE + (y & 7) as usize * ROW + (z & 7) as usize;
    let brick = bounds.samples_m().get(slot as usize).and_then(|brick| brick.get(first..));
    let Some(samples) = brick.and_then(|samples| samples.first_chunk::<{ PLANE + ROW + 2 }>()) else {
        return [-bounds.band_m(); 8];
    };
    [
        samples[0],
        samples[1],
        samples[ROW],
        samples[ROW + 1],
        samples[PLANE],
        samples[PLANE + 1],
        samples[PLANE + ROW],
        samples[PLANE + ROW + 1],
    ]
}

fn mixed(c: &[f32; 8], t: Vec3) -> f32 {
    let z00 = c[0] + (c[1] - c[0]) * t.z;
    let z01 = c[2] + (c[3] - c[2]) * t.z;
    let z10 = c[4] + (c[5] - c[4]) * t.z;
    let z11 = c[6] + (c[7] - c[6]) * t.z;
    let y0 = z00 + (z01 - z00) * t.y;
    let y1 = z10 + (z11 - z10) * t.y;
    y0 + (y1 - y0) * t.x
}

pub(super) fn spheres(bounds: &BrickBounds, place: &Place, spheres: &Spheres, margin_cells: f32) -> [f32; CHILDREN] {
    let Spheres { x, y, z, radius } = spheres;
    let mut rooms = [0.0; CHILDREN];
    for ((((room, x), y), z), radius) in rooms.iter_mut().zip(x).zip(y).zip(z).zip(radius) {
        *room = sphere(bounds, place, Vec3::new(*x, *y, *z)) - (radius / bounds.voxel_size_m() + margin_cells);
    }
    rooms
}

pub(super) fn above(bounds: &BrickBounds, place: &Place, spheres: &Spheres, floor_m: f32, margin_cells: f32) -> u8 {
    let Spheres { x, y, z, radius } = spheres;
    let mut above = 0;
    for (lane, (((x, y), z), radius)) in x.iter().zip(y).zip(z).zip(radius).enumerate() {
        let lattice = cells(place, Vec3::new(*x, *y, *z)) - 0.5;
        let (on_grid, base) = on_grid(bounds, lattice);
        let extent = radius / bounds.voxel_size_m() + margin_cells;
        let max_depth_nearby_m = bounds.max_depth_nearby_m().get(brick_of(bounds, base)).copied().unwrap_or(f32::INFINITY);
        let away = (lattice - on_grid).abs();
        let off = away.x > extent + 1.0 || away.y > extent + 1.0 || away.z > extent + 1.0;
        let highest_m = if off { bounds.skin_m() - bounds.band_m() } else { max_depth_nearby_m };
        above |= u8::from(!(highest_m <= floor_m && (off || extent < AROUND_CELLS))) << lane;
    }
    above
}

/// The place of the grid that is nearest to one on the lattice, and its cell: all that can touch lies there, and the grid is convex.
fn on_grid(bounds: &BrickBounds, lattice: Vec3) -> (Vec3, [i32; 3]) {
    let dims = bounds.dims();
    let inside = |at: f32, n: i32| lesser(greater(at, 0.0), (8 * n) as f32);
    let on_grid = Vec3::new(inside(lattice.x, dims[0]), inside(lattice.y, dims[1]), inside(lattice.z, dims[2]));
    // The far end belongs to the last cell.
    let cell_of = |at: f32, n: i32| (at as i32).min(8 * n - 1);
    (on_grid, [cell_of(on_grid.x, dims[0]), cell_of(on_grid.y, dims[1]), cell_of(on_grid.z, dims[2])])
}

fn brick_of(bounds: &BrickBounds, base: [i32; 3]) -> usize {
    let ([bx, by, bz], [_, ny, nz]) = (base.map(|cell| cell >> 3), bounds.dims());
    ((bx * ny + by) * nz + bz) as usize
}

fn sphere(bounds: &BrickBounds, place: &Place, center: Vec3) -> f32 {
    let lattice = cells(place, center) - 0.5;
    let (on_grid, base) = on_grid(bounds, lattice);
    let away = lattice - on_grid;
    let brick = brick_of(bounds, base);
    let room = bounds.clearance_cells().get(brick).copied().unwrap_or(0.0);
    let slot = bounds.top().get(brick).copied().unwrap_or(DEEP_INSIDE);
    let value_m = match slot {
        FAR_OUTSIDE | DEEP_INSIDE => bounds.max_depth_m().get(brick).copied().unwrap_or(0.0),
        slot => {
            let t = on_grid - Vec3::new(base[0] as f32, base[1] as f32, base[2] as f32);
            // Beyond the band samples are not distances any more, only no nearer than it.
            let clamped = corners(bounds, slot, base).map(|corner| greater(-bounds.band_m(), corner));
            mixed(&clamped, t) + bounds.skin_m()
        }
    };
    let depth_cells = -value_m / bounds.voxel_size_m() - bounds.jump_cells();
    let free = greater(room, free_cells(depth_cells));
    (away.x * away.x + away.y * away.y + away.z * away.z + free * free).sqrt()
}
