//! The sum over touching blocks, sixteen lanes at a time.
//!
//! A few blocks are added up in `f32`, sixteen lane sums per quantity, then these sums in `f64`,
//! every fourth lane together.

use glam::{DMat3, DVec3};

use super::contact_block::{ContactBlock, ContactDirections};
use crate::pointshell::shell::{LANES, Lanes, Lanes3};
use crate::simd::{AHEAD, F32s, F32x8, I32s, Kernel};
use crate::spatial::Mat6;

/// Force, moment, stiffness (of translations, between turns and translations, of turns), force ×
/// gradient, depth, depth × arm, effective count.
const QUANTITIES: usize = 3 + 3 + (6 + 9 + 6) + 3 + 1 + 3 + 1;
/// Blocks that are added up in `f32`: sixteen numbers per lane, which takes no more from them than
/// the rounding of positions does.
const BLOCKS_PER_PART: u32 = 16;

/// What one face adds, tool axes, metres instead of newtons (stiffness is multiplied in later). No
/// vector of it lies in two cache lines.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
pub(super) struct Sums {
    part: [[f32; LANES]; QUANTITIES],
    n_blocks_in_part: u32,
    lanes: [[f64; LANES / 4]; QUANTITIES],
}

/// How a point's depth becomes force.
#[derive(Clone, Copy, Debug)]
pub(super) struct Weighting {
    per_half_voxel: f32,
    per_quarter_voxel: f32,
    spatial: bool,
}

impl Weighting {
    /// `spatial`: stage S, smooth entry over the first half voxel.
    pub(super) fn new(voxel_size_m: f32, spatial: bool) -> Self {
        Self { per_half_voxel: 2.0 / voxel_size_m, per_quarter_voxel: 4.0 / voxel_size_m, spatial }
    }
}

/// What the lanes of a block add.
#[derive(Clone, Copy)]
struct Addends<L> {
    /// n and r × n.
    normal: [L; 3],
    moment: [L; 3],
    /// g and r × g, g the gradient of the depth.
    gradient: [L; 3],
    gradient_moment: [L; 3],
    arm: [L; 3],
    depth: L,
    force: L,
    stiffness: L,
    effective: L,
}

impl<L: F32s<LANES>> Addends<L> {
    #[inline(always)]
    fn of(
        touched: &ContactBlock,
        (positions, normals): (&Lanes3, &Lanes3),
        (areas, weights): (&Lanes, &Lanes),
        count: f32,
        by: Weighting,
    ) -> Self {
        let wanted = L::Int::mask(touched.lanes.into());
        let one = L::splat(1.0);
        let stands_for = L::load(&weights.0).only(wanted) * L::splat(count);
        let area = L::load(&areas.0).only(wanted) * L::splat(count);
        let depth = L::load(&touched.depths_m).only(wanted);
        let [nx, ny, nz] = [
            L::load(&normals.x.0).only(wanted),
            L::load(&normals.y.0).only(wanted),
            L::load(&normals.z.0).only(wanted),
        ];
        let [rx, ry, rz] = [
            L::load(&positions.x.0).only(wanted),
            L::load(&positions.y.0).only(wanted),
            L::load(&positions.z.0).only(wanted),
        ];
        let [mut gx, mut gy, mut gz] = [
            L::load(&touched.gradients.x.0).only(wanted),
            L::load(&touched.gradients.y.0).only(wanted),
            L::load(&touched.gradients.z.0).only(wanted),
        ];
        let zero = L::splat(0.0);
        let is_known = zero.lt(gx * gx + gy * gy + gz * gz);
        gx = L::select(is_known, gx, zero - nx);
        gy = L::select(is_known, gy, zero - ny);
        gz = L::select(is_known, gz, zero - nz);
        // Lanes without contact have a depth of 0, and a normal, a gradient and an arm of 0:
        // whatever their factors are, they add nothing.
        let (share, slope) = if by.spatial {
            // w = t²(3 − 2t), d·w' = 6t²(1 − t), with t = d/(s/2) up to 1: the entry weight of
            // stage S.
            let t = (depth * L::splat(by.per_half_voxel)).min(one);
            let squared = t * t;
            let smooth = squared * (L::splat(3.0) - (t + t));
            (smooth, smooth + squared * L::splat(6.0) * (one - t))
        } else {
            (one, one)
        };
        let depth_weighted = depth * stands_for;
        Self {
            normal: [nx, ny, nz],
            moment: [ry * nz - rz * ny, rz * nx - rx * nz, rx * ny - ry * nx],
            gradient: [gx, gy, gz],
            gradient_moment: [ry * gz - rz * gy, rz * gx - rx * gz, rx * gy - ry * gx],
            arm: [rx, ry, rz],
            depth: depth_weighted,
            force: depth_weighted * share,
            stiffness: slope * stands_for,
            // Our smooth count: what a contact stands for counts fully from a quarter voxel on, so
            // that normalisation has no steps.
            effective: (depth * L::splat(by.per_quarter_voxel)).min(one) * area,
        }
    }
}

impl Sums {
    pub(super) const ZERO: Self = Self {
        part: [[0.0; LANES]; QUANTITIES],
        n_blocks_in_part: 0,
        lanes: [[0.0; LANES / 4]; QUANTITIES],
    };

    /// Adds the lanes of a block that touch, each by its weight so often.
    #[inline(always)]
    pub(super) fn add<L: F32s<LANES>>(
        &mut self,
        touched: &ContactBlock,
        at: (&Lanes3, &Lanes3),
        (weights, count): ((&Lanes, &Lanes), f32),
        by: Weighting,
    ) {
        let addends = Addends::<L>::of(touched, at, weights, count, by);
        let Addends { normal, moment, gradient, gradient_moment, .. } = addends;
        let Addends { arm, depth, force, stiffness, effective, .. } = addends;
        let mut sums = self.part.iter_mut();
        put(&mut sums, force, normal);
        put(&mut sums, force, moment);
        let [nx, ny, nz] = normal;
        let [mx, my, mz] = moment;
        put_symmetric(&mut sums, [stiffness * nx, stiffness * ny, stiffness * nz], gradient);
        put(&mut sums, stiffness * mx, gradient);
        put(&mut sums, stiffness * my, gradient);
        put(&mut sums, stiffness * mz, gradient);
        put_symmetric(&mut sums, [stiffness * mx, stiffness * my, stiffness * mz], gradient_moment);
        put(&mut sums, force, gradient);
        let one = L::splat(1.0);
        put(&mut sums, one, [depth]);
        put(&mut sums, depth, arm);
        put(&mut sums, one, [effective]);
        self.n_blocks_in_part += 1;
        if self.n_blocks_in_part == BLOCKS_PER_PART {
            self.settle();
        }
    }

    /// Adds the part to the sums.
    #[inline(always)]
    fn settle(&mut self) {
        for (sums, part) in self.lanes.iter_mut().zip(&mut self.part) {
            let (quarters, _) = part.as_chunks::<{ LANES / 4 }>();
            if let [a, b, c, d] = quarters {
                for ((((sum, a), b), c), d) in sums.iter_mut().zip(a).zip(b).zip(c).zip(d) {
                    *sum += f64::from((a + c) + (b + d));
                }
            }
            *part = [0.0; LANES];
        }
        self.n_blocks_in_part = 0;
    }

    /// The totals.
    pub(super) fn total(mut self) -> Total {
        self.settle();
        let mut totals = self.lanes.iter().map(|[a, b, c, d]| (a + b) + (c + d));
        let mut next = || totals.next().unwrap_or(0.0);
        let mut vector = || DVec3::new(next(), next(), next());
        let depth_normal = vector();
        let depth_moment = vector();
        let translation = symmetric([vector(), vector()]);
        // Its columns are the rows of what turns do to the moment of translations.
        let between = DMat3::from_cols(vector(), vector(), vector());
        let turn = symmetric([vector(), vector()]);
        let stiffness = Mat6::from_blocks(-translation, -between, -between.transpose(), -turn);
        let depth_gradient = vector();
        let depth = next();
        let depth_arm = DVec3::new(next(), next(), next());
        let effective = next();
        Total { depth_normal, depth_moment, stiffness, depth_gradient, depth, depth_arm, effective }
    }
}

/// Adds factor · column to the next sums.
#[inline(always)]
fn put<'a, L: F32s<LANES>, const N: usize>(
    sums: &mut impl Iterator<Item = &'a mut [f32; LANES]>,
    factor: L,
    columns: [L; N],
) {
    for (column, sum) in columns.into_iter().zip(sums) {
        (L::load(sum) + factor * column).store(sum);
    }
}

/// Adds the symmetric part of one · otherᵀ to the next sums: three on the diagonal, and twice three
/// beside it.
#[inline(always)]
fn put_symmetric<'a, L: F32s<LANES>>(
    sums: &mut impl Iterator<Item = &'a mut [f32; LANES]>,
    [ax, ay, az]: [L; 3],
    [bx, by, bz]: [L; 3],
) {
    let one = L::splat(1.0);
    put(sums, one, [ax * bx, ay * by, az * bz]);
    put(sums, one, [ay * bz + az * by, az * bx + ax * bz, ax * by + ay * bx]);
}

/// The matrix of such sums.
fn symmetric([diagonal, twice_beside]: [DVec3; 2]) -> DMat3 {
    let [yz, zx, xy] = (0.5 * twice_beside).to_array();
    DMat3::from_cols_array(&[diagonal.x, xy, zx, xy, diagonal.y, yz, zx, yz, diagonal.z])
}

/// Sums over all contacts of one face.
#[derive(Clone, Copy, Debug)]
pub(super) struct Total {
    pub(super) depth_normal: DVec3,
    pub(super) depth_moment: DVec3,
    /// Minus the derivative of the two above, see [`ContactSum::flat`](super::ContactSum::flat).
    pub(super) stiffness: Mat6,
    /// The gradient of the depth, as often as `depth_normal` counts the normal.
    pub(super) depth_gradient: DVec3,
    pub(super) depth: f64,
    pub(super) depth_arm: DVec3,
    pub(super) effective: f64,
}

/// Adds blocks to the sums, whose positions and normals are among these.
pub(super) struct AddAll<'a> {
    pub(super) sums: &'a mut Sums,
    pub(super) touched: &'a [ContactBlock],
    pub(super) positions: &'a [Lanes3],
    pub(super) normals: &'a [Lanes3],
    pub(super) weights: &'a [Lanes],
    pub(super) by: Weighting,
}

impl Kernel for AddAll<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: F32x8>(self) {
        let geometry = |touched: &ContactBlock| {
            let block = touched.block as usize;
            Some(((self.positions.get(block)?, self.normals.get(block)?), self.weights.get(block)?))
        };
        let mut soon = self.touched.iter().skip(AHEAD);
        for touched in self.touched {
            if let Some(((positions, normals), _)) = soon.next().and_then(geometry) {
                positions.prefetch();
                normals.prefetch();
            }
            if let Some((at, weights)) = geometry(touched) {
                self.sums.add::<L::Wide>(
                    touched,
                    at,
                    ((weights, weights), touched.weight),
                    self.by,
                );
            }
        }
    }
}

/// Adds a block to the sums, its lanes as they push.
pub(super) struct Add<'a> {
    pub(super) sums: &'a mut Sums,
    pub(super) touched: &'a ContactBlock,
    pub(super) pushes: &'a ContactDirections,
    pub(super) by: Weighting,
}

impl Kernel for Add<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: F32x8>(self) {
        let ContactDirections { positions, normals, areas, weights } = self.pushes;
        self.sums.add::<L::Wide>(
            self.touched,
            (positions, normals),
            ((areas, weights), 1.0),
            self.by,
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::SimdLevel;
    use crate::spatial::testing::Random;

    const VOXEL_SIZE_M: f64 = 1.0;
    const BLOCKS: u32 = 40;

    /// Touching blocks; whatever does not touch is not a number.
    fn blocks() -> Vec<(ContactBlock, ContactDirections)> {
        let mut chance = Random(11);
        let unknown = Lanes([f32::NAN; LANES]);
        let nowhere = Lanes3 { x: unknown, y: unknown, z: unknown };
        let areas =
            |chance: &mut Random| Lanes(core::array::from_fn(|_| 1.0 + chance.unit() as f32));
        let mut blocks = Vec::new();
        for block in 0..BLOCKS {
            let weight = 1.0 + chance.unit() as f32;
            let depths_m = [f32::NAN; LANES];
            let mut touched =
                ContactBlock { block, lanes: 0, weight, depths_m, gradients: nowhere };
            let mut pushes = ContactDirections {
                positions: nowhere,
                normals: nowhere,
                areas: areas(&mut chance),
                weights: areas(&mut chance),
            };
            for lane in 0..LANES {
                if chance.unit() < 0.5 {
                    touched.lanes |= 1 << lane;
                    touched.depths_m[lane] = (VOXEL_SIZE_M * chance.unit()) as f32;
                    // Of some it is not known.
                    let is_known = if lane % 5 == 0 { 0.0 } else { 1.0 };
                    touched.gradients.set(lane, (chance.in_box(-1.0, 1.0) * is_known).as_vec3());
                    pushes.positions.set(lane, chance.in_box(-1.0, 1.0).as_vec3());
                    pushes.normals.set(lane, chance.in_box(-1.0, 1.0).normalize().as_vec3());
                }
            }
            blocks.push((touched, pushes));
        }
        blocks
    }

    const NOTHING: Total = Total {
        depth_normal: DVec3::ZERO,
        depth_moment: DVec3::ZERO,
        stiffness: Mat6::ZERO,
        depth_gradient: DVec3::ZERO,
        depth: 0.0,
        depth_arm: DVec3::ZERO,
        effective: 0.0,
    };

    /// The same by the formula, point by point.
    fn add_plainly(
        total: &mut Total,
        touched: &ContactBlock,
        pushes: &ContactDirections,
        (areas, count): (&Lanes, f64),
        smooth_entry: bool,
    ) {
        for lane in touched.lanes() {
            let depth = f64::from(touched.depths_m[lane]);
            let stands_for = f64::from(pushes.weights.0[lane]) * count;
            let area = f64::from(areas.0[lane]) * count;
            let normal = pushes.normals.get(lane).as_dvec3();
            let arm = pushes.positions.get(lane).as_dvec3();
            let moment = arm.cross(normal);
            // Stage S: d w(t), w = t² (3 − 2t), t = d / (s / 2) up to 1, has the slope
            // w + d w' = w + 6 t² (1 − t).
            let t = (depth / (0.5 * VOXEL_SIZE_M)).min(1.0);
            let entry = t * t * (3.0 - 2.0 * t);
            let (share, slope) =
                if smooth_entry { (entry, entry + 6.0 * t * t * (1.0 - t)) } else { (1.0, 1.0) };
            total.depth_normal += normal * (depth * stands_for * share);
            total.depth_moment += moment * (depth * stands_for * share);
            let gradient = match touched.gradients.get(lane).as_dvec3() {
                DVec3::ZERO => -normal,
                gradient => gradient,
            };
            let outer = |one: DVec3, other: DVec3| {
                DMat3::from_cols(one * other.x, one * other.y, one * other.z)
            };
            let halved = |one, other| (outer(one, other) + outer(other, one)) * -0.5;
            let between = outer(gradient, moment) * -1.0;
            let turned = arm.cross(gradient);
            total.stiffness = total.stiffness.plus_scaled(
                slope * stands_for,
                &Mat6::from_blocks(
                    halved(normal, gradient),
                    between,
                    between.transpose(),
                    halved(moment, turned),
                ),
            );
            total.depth_gradient += gradient * (depth * stands_for * share);
            total.depth += depth * stands_for;
            total.depth_arm += arm * (depth * stands_for);
            // Full from a quarter of a voxel on.
            total.effective += (depth / (0.25 * VOXEL_SIZE_M)).min(1.0) * area;
        }
    }

    fn assert_same(found: &Total, expected: &Total, what: &str) {
        let numbers = |total: &Total| {
            let mut numbers = total.stiffness.0.as_flattened().to_vec();
            for vector in
                [total.depth_normal, total.depth_moment, total.depth_gradient, total.depth_arm]
            {
                numbers.extend(vector.to_array());
            }
            numbers.extend([total.depth, total.effective]);
            numbers
        };
        // Some three hundred points of about one each, in `f32`.
        for (found, expected) in numbers(found).into_iter().zip(numbers(expected)) {
            assert!((found - expected).abs() < 1e-2, "{what}: {found} and not {expected}");
        }
    }

    #[test]
    fn blocks_add_up_to_the_sum_over_their_points_as_they_push() {
        let blocks = blocks();
        for (level, smooth_entry) in
            SimdLevel::available().flat_map(|level| [(level, false), (level, true)])
        {
            let by = Weighting::new(VOXEL_SIZE_M as f32, smooth_entry);
            let mut sums = Sums::ZERO;
            let mut expected = NOTHING;
            for (touched, pushes) in &blocks {
                level.run(Add { sums: &mut sums, touched, pushes, by });
                // Sixteen blocks are added up in `f32`, and then settled.
                assert_eq!(sums.n_blocks_in_part, (touched.block + 1) % BLOCKS_PER_PART);
                add_plainly(&mut expected, touched, pushes, (&pushes.areas, 1.0), smooth_entry);
            }
            let what = format!("{level:?}, smooth entry {smooth_entry}");
            assert_same(&sums.total(), &expected, &what);
        }
    }

    #[test]
    fn blocks_whose_points_have_their_own_normals_count_by_their_weight() {
        let blocks = blocks();
        let touched: Vec<ContactBlock> = blocks.iter().map(|(touched, _)| *touched).collect();
        let positions: Vec<Lanes3> = blocks.iter().map(|(_, pushes)| pushes.positions).collect();
        let normals: Vec<Lanes3> = blocks.iter().map(|(_, pushes)| pushes.normals).collect();
        let weights: Vec<Lanes> = blocks.iter().map(|(_, pushes)| pushes.weights).collect();
        for level in SimdLevel::available() {
            let mut sums = Sums::ZERO;
            level.run(AddAll {
                sums: &mut sums,
                touched: &touched,
                positions: &positions,
                normals: &normals,
                weights: &weights,
                by: Weighting::new(VOXEL_SIZE_M as f32, true),
            });
            let mut expected = NOTHING;
            for (touched, pushes) in &blocks {
                let areas = (&pushes.weights, f64::from(touched.weight));
                add_plainly(&mut expected, touched, pushes, areas, true);
            }
            assert_same(&sums.total(), &expected, &format!("{level:?}"));
        }
    }
}
