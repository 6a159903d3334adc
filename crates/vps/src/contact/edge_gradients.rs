//! The field's gradient beside the edges of the tool, sixteen places at a time.
//!
//! Edge points lie scattered over the blocks that touch, so they are gathered first: lanes without
//! an edge would be computed for nothing.

#![expect(unsafe_code, reason = "look-ups without checks, by the invariant of the bounds")]

use glam::Vec3;

use super::contact_block::{ContactBlock, Wall};
use super::kernel::{Grid, eighths, fractions};
use crate::pointshell::shell::{LANES, Lanes, Lanes3, Shell};
use crate::simd::{F32s, F32x8, I32s, Kernel, SimdLevel};
use crate::voxmap::field::brick_bounds::BrickBounds;
use crate::voxmap::field::{APRON_CELLS, APRON_EDGE};

/// Places that are looked up together: what they take stays in the first cache.
const GROUPS: usize = 16;
/// From one sample to the next along x, y, z.
const STRIDES: [usize; 3] = [APRON_EDGE * APRON_EDGE, APRON_EDGE, 1];

/// Places of edge points, and then the gradients there.
pub(super) struct EdgeGradients {
    lanes: [Lanes3; GROUPS],
    n: usize,
}

impl EdgeGradients {
    pub(super) fn new() -> Self {
        let zero = Lanes([0.0; LANES]);
        Self { lanes: [Lanes3 { x: zero, y: zero, z: zero }; GROUPS], n: 0 }
    }

    /// Looks up the gradient, m/m in map axes, at the bent lanes of the first of these blocks, in
    /// their order: of as many blocks as there is room for, whose number it gives. RT: safe.
    pub(super) fn look_up(
        &mut self,
        simd_level: SimdLevel,
        bounds: Option<&BrickBounds>,
        wall: &Wall<'_>,
        shell: &Shell,
        touched: &[ContactBlock],
    ) -> usize {
        self.n = 0;
        let mut n_blocks = 0;
        for touched in touched {
            if self.n + LANES > GROUPS * LANES {
                break;
            }
            n_blocks += 1;
            let Some(positions) = shell.positions().get(touched.block as usize) else { continue };
            for lane in touched.bent_lanes(wall.field, shell) {
                let position = positions.get(lane);
                if let Some(lanes) = self.lanes.get_mut(self.n / LANES) {
                    // The kernel writes differences where it has read places.
                    lanes.set(
                        self.n % LANES,
                        if bounds.is_some() { position } else { wall.gradient(position) },
                    );
                }
                self.n += 1;
            }
        }
        if let (Some(bounds), Some(lanes)) = (bounds, self.lanes.get_mut(..self.n.div_ceil(LANES)))
        {
            simd_level.run(MeanGradients { bounds, wall, lanes });
        }
        n_blocks
    }

    /// What was looked up.
    pub(super) fn iter(&self) -> impl Iterator<Item = Vec3> {
        let lanes = self.lanes.iter().flat_map(|lanes| (0..LANES).map(|lane| lanes.get(lane)));
        lanes.take(self.n)
    }
}

/// [`Field::mean_gradient`](crate::voxmap::field::Field::mean_gradient), bit for bit, at places
/// that it replaces.
struct MeanGradients<'a> {
    bounds: &'a BrickBounds,
    wall: &'a Wall<'a>,
    lanes: &'a mut [Lanes3],
}

impl Kernel for MeanGradients<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: F32x8>(self) {
        let Self { bounds, wall, lanes } = self;
        let grid = Grid::<L::Wide, LANES>::new(bounds, &wall.place);
        let voxel_size_m = L::Wide::splat(bounds.voxel_size_m());
        for Lanes3 { x, y, z } in lanes {
            let cells = grid.cells([L::Wide::load(&x.0), L::Wide::load(&y.0), L::Wide::load(&z.0)]);
            let [along_x, along_y, along_z] = grid.differences(cells);
            (along_x / voxel_size_m).store(&mut x.0);
            (along_y / voxel_size_m).store(&mut y.0);
            (along_z / voxel_size_m).store(&mut z.0);
        }
    }
}

impl<L: F32s<N>, const N: usize> Grid<'_, L, N> {
    /// Along each axis, V half a cell behind a place less V half a cell before it.
    #[inline(always)]
    fn differences(&self, cells: [L; 3]) -> [L; 3] {
        let zero = L::Int::splat(0);
        let half = L::splat(0.5);
        let one = L::splat(1.0);
        let lattice = [cells[0] - half, cells[1] - half, cells[2] - half];
        let base = [lattice[0].floored(), lattice[1].floored(), lattice[2].floored()];
        let t = fractions(lattice, base);
        let off = self.off(eighths(base));
        // SAFETY: lanes that are not on the grid read entry 0; by the invariant of the bounds there
        // is one entry per brick.
        let slots = unsafe {
            L::Int::gather(self.bounds.top(), L::Int::select(off, zero, self.brick(eighths(base))))
        };
        // The two marks are −1 and −2 as signed numbers; slots are not negative.
        let elsewhere = off | zero.gt(slots);
        let seven = L::Int::splat(7);
        let local = [base[0] & seven, base[1] & seven, base[2] & seven];
        let mut differences = [L::splat(0.0); 3];
        for (axis, difference) in differences.iter_mut().enumerate() {
            let b = (axis + 1) % 3;
            let c = (axis + 2) % 3;
            let is_early = t[axis].lt(half);
            let u = L::select(is_early, t[axis] + half, t[axis] - half);
            // The mask is −1 where it holds.
            let first = local[axis] + is_early;
            let beyond =
                elsewhere | zero.gt(first) | first.gt(L::Int::splat(APRON_EDGE as i32 - 3));
            if beyond.bits() != zero.eq(zero).bits() {
                let stride = |axis: usize| STRIDES[axis] as i32;
                let inside = first * L::Int::splat(stride(axis))
                    + local[b] * L::Int::splat(stride(b))
                    + local[c] * L::Int::splat(stride(c));
                let from = slots * L::Int::splat(APRON_CELLS as i32) + inside;
                let mut at = [0; N];
                L::Int::select(beyond, zero, from).store(&mut at);
                // SAFETY: as one lane is not beyond, there are samples; in its brick a lane reaches
                // to 8 along `axis` and along the others.
                let rows =
                    unsafe { rows::<L, N>(self.bounds.samples_m().as_flattened(), &at, axis) };
                let mut pairs = [L::splat(0.0); 2];
                for (pair, [near, far]) in pairs.iter_mut().zip(rows) {
                    *pair =
                        sloped(near, one - u, u) * (one - t[c]) + sloped(far, one - u, u) * t[c];
                }
                *difference = pairs[0] * (one - t[b]) + pairs[1] * t[b];
            }
            if beyond.bits() != 0 {
                let mut before = cells;
                let mut behind = cells;
                before[axis] = before[axis] - half;
                behind[axis] = behind[axis] + half;
                *difference =
                    L::select(beyond, self.value(behind) - self.value(before), *difference);
            }
        }
        differences
    }

    /// V at a place.
    #[inline(always)]
    fn value(&self, cells: [L; 3]) -> L {
        let half = L::splat(0.5);
        let lattice = [cells[0] - half, cells[1] - half, cells[2] - half];
        let base = [lattice[0].floored(), lattice[1].floored(), lattice[2].floored()];
        self.scattered(lattice, base, L::splat(f32::NEG_INFINITY))
    }
}

/// The step from the first of three samples to the second and from that to the third, mixed.
#[inline(always)]
fn sloped<L: F32s<N>, const N: usize>([first, second, third]: [L; 3], early: L, late: L) -> L {
    (second - first) * early + (third - second) * late
}

/// Three samples along an axis at the four corners of the other two, `[b][c]`, b the axis that
/// follows it.
///
/// # Safety
/// From each number on, `samples_m` has two more samples along the axis and one more along the
/// others.
#[inline(always)]
unsafe fn rows<L: F32s<N>, const N: usize>(
    samples_m: &[f32],
    at: &[u32; N],
    axis: usize,
) -> [[[L; 3]; 2]; 2] {
    let [plane, row, _] = STRIDES;
    let mut pairs = [(L::splat(0.0), L::splat(0.0)); 8];
    for (n, pair) in pairs.iter_mut().enumerate().take(if axis == 2 { 8 } else { 6 }) {
        // Two samples side by side along z come with one load.
        let offset = match axis {
            0 => n / 3 * row + n % 3 * plane,
            1 => n / 3 * plane + n % 3 * row,
            _ => n / 4 * plane + n / 2 % 2 * row + n % 2,
        };
        // SAFETY: by the caller's promise.
        *pair = unsafe { L::gather_pairs(samples_m, at, offset) };
    }
    let [p, q, r, s, t, u, v, w] = pairs;
    match axis {
        0 => [[[p.0, q.0, r.0], [p.1, q.1, r.1]], [[s.0, t.0, u.0], [s.1, t.1, u.1]]],
        1 => [[[p.0, q.0, r.0], [s.0, t.0, u.0]], [[p.1, q.1, r.1], [s.1, t.1, u.1]]],
        _ => [[[p.0, p.1, q.1], [r.0, r.1, s.1]], [[t.0, t.1, u.1], [v.0, v.1, w.1]]],
    }
}

#[cfg(test)]
#[expect(clippy::expect_used, reason = "test code")]
mod tests {
    use glam::{DQuat, DVec3};

    use super::*;
    use crate::contact::tests::block;
    use crate::mesh::primitives::Shape;
    use crate::mesh::validate::inspect;
    use crate::pointshell::{Points, build_with};
    use crate::spatial::Pose;
    use crate::spatial::testing::Random;
    use crate::voxmap::inside_test::InsideTest;
    use crate::voxmap::{Options, Volume};

    #[test]
    fn every_kernel_gives_the_bits_of_the_field_on_borders_of_bricks_and_off_the_grid_too() {
        let mesh = Shape::Torus { major_m: 0.012, minor_m: 0.004 }.tessellate(1e-5);
        let options =
            Options { voxel_size_m: 5e-4, layers: 4, navigation: None, sides: InsideTest::Auto };
        let field = Volume::build(&mesh, &inspect(&mesh), &options, |_| ())
            .expect("a grid that fits")
            .field(&mesh, false);
        let bounds = BrickBounds::of(&field).expect("a field that kernels read");
        let pose = Pose::new(
            DQuat::from_scaled_axis(DVec3::new(0.3, 1.1, -0.4)),
            DVec3::new(1e-3, -2e-3, 5e-4),
        );
        let wall = Wall::new(&field, pose);
        let mut random = Random(7);
        let mut n_inside = 0;
        for _ in 0..500 {
            let mut places = EdgeGradients::new().lanes;
            for lane in 0..LANES {
                places[0]
                    .set(lane, (random.in_box(-1.0, 1.0) * DVec3::new(0.02, 0.02, 0.01)).as_vec3());
            }
            let expected: Vec<Vec3> =
                (0..LANES).map(|lane| wall.gradient(places[0].get(lane))).collect();
            n_inside += expected.iter().filter(|gradient| **gradient != Vec3::ZERO).count();
            for level in SimdLevel::available() {
                let mut found = places[0];
                level.run(MeanGradients {
                    bounds: &bounds,
                    wall: &wall,
                    lanes: core::slice::from_mut(&mut found),
                });
                for (lane, expected) in expected.iter().enumerate() {
                    assert_eq!(
                        found.get(lane).to_array().map(f32::to_bits),
                        expected.to_array().map(f32::to_bits),
                        "{level:?} {expected}"
                    );
                }
            }
        }
        assert!(n_inside > 1000, "{n_inside}");
    }

    #[test]
    fn more_edge_points_than_there_is_room_for_are_looked_up_one_part_after_the_other() {
        let (mesh, map) = block(DVec3::splat(0.02), 5e-4);
        let shell = build_with(Points::Facets, &mesh, &map, DVec3::ZERO).0;
        // Its sides are two voxels beyond those of the tool.
        let (mesh, mut map) = block(DVec3::splat(0.024), 1e-3);
        let field = map.field(&mesh, false);
        let bounds = BrickBounds::of(&field).expect("a field that kernels read");
        let wall = Wall::new(&field, Pose::IDENTITY);
        // Not deep: all of its edges bend.
        let depths_m = [0.0; LANES];
        let touched: Vec<ContactBlock> = (0..shell.positions().len() as u32)
            .map(|block| {
                let gradients = Lanes3::ZERO;
                ContactBlock { block, lanes: u16::MAX, weight: 1.0, depths_m, gradients }
            })
            .collect();
        let mut expected = Vec::new();
        for (touched, positions) in touched.iter().zip(shell.positions()) {
            let lanes = touched.bent_lanes(&field, &shell);
            expected.extend(lanes.map(|lane| wall.gradient(positions.get(lane))));
        }
        assert!(expected.len() > 2 * GROUPS * LANES, "{}", expected.len());
        for bounds in [None, Some(&bounds)] {
            let mut edges = EdgeGradients::new();
            let mut found = Vec::new();
            let mut left = touched.as_slice();
            while !left.is_empty() {
                let n_blocks = edges.look_up(SimdLevel::best(), bounds, &wall, &shell, left);
                assert!(n_blocks > 0, "nothing is looked up");
                found.extend(edges.iter());
                left = left.split_at(n_blocks).1;
            }
            assert!(found == expected, "{} of {}", found.len(), expected.len());
        }
    }
}
