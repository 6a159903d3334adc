//! The sum over touching blocks, sixteen lanes at a time.
//!
//! A few blocks are added up in `f32`, sixteen lane sums per quantity, then these sums in `f64`,
//! every fourth lane together.

use glam::{DMat3, DVec3, Vec3};

use super::clip::{CreasesAt, OverPlanes, midpoints, share_of_point};
use super::contact_block::ContactBlock;
use super::immersion::{Immersed, Range};
use crate::pointshell::shell::{LANES, Lanes, Lanes3, Shell};
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
    /// The most of the mean depths of facets.
    deepest: [f32; LANES],
    lanes: [[f64; LANES / 4]; QUANTITIES],
}

/// How depth becomes force.
#[derive(Clone, Copy, Debug)]
pub(super) struct Weighting {
    per_quarter_voxel: f32,
    /// Something pushes along the way out and not along its own normal: what touches a thin skin,
    /// and points that have none.
    is_thin: bool,
    bends: bool,
}

impl Weighting {
    /// Of voxels of this edge. `is_thin`: they are those of a thin skin; `is_skin`: some points have
    /// no normal.
    pub(super) fn new(voxel_size_m: f32, is_thin: bool, is_skin: bool) -> Self {
        Self { per_quarter_voxel: 4.0 / voxel_size_m, is_thin, bends: is_thin || is_skin }
    }
}

/// The points of a block.
#[derive(Clone, Copy)]
pub(super) struct Points<'a> {
    /// About the centre of mass, m.
    pub(super) positions: &'a Lanes3,
    /// Unit directions in which they push.
    pub(super) normals: &'a Lanes3,
    /// Surface that each stands for, s².
    pub(super) weights: &'a Lanes,
    /// Half axes of those that are facets, m.
    pub(super) half_axes: Option<&'a [Lanes3; 2]>,
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
    /// By how much more the moment counts, and the arm, of facets that are immersed in part.
    turn: [L; 3],
    lever: [L; 3],
    /// How deep each facet is in the mean; 0 of a point.
    deepest: L,
    force: L,
    stiffness: L,
    effective: L,
}

#[inline(always)]
fn load<L: F32s<LANES>>(lanes: &Lanes3, wanted: L::Int) -> [L; 3] {
    [
        L::load(&lanes.x.0).only(wanted),
        L::load(&lanes.y.0).only(wanted),
        L::load(&lanes.z.0).only(wanted),
    ]
}

#[inline(always)]
fn cross<L: F32s<LANES>>([ax, ay, az]: [L; 3], [bx, by, bz]: [L; 3]) -> [L; 3] {
    [ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx]
}

impl<L: F32s<LANES>> Addends<L> {
    #[inline(always)]
    fn of(touched: &ContactBlock, points: Points<'_>, by: Weighting) -> Self {
        let wanted = L::Int::mask((touched.lanes & !touched.clipped).into());
        let one = L::splat(1.0);
        let zero = L::splat(0.0);
        let area = L::load(&points.weights.0).only(wanted) * L::splat(touched.weight);
        // Lanes without contact have a depth of 0, and a normal, a gradient and an arm of 0:
        // whatever their factors are, they add nothing.
        let depth = L::load(&touched.depths_m).only(wanted);
        let [mut nx, mut ny, mut nz] = load::<L>(points.normals, wanted);
        let arm = load::<L>(points.positions, wanted);
        let [mut gx, mut gy, mut gz] = load::<L>(&touched.gradients, wanted);
        let squared = gx * gx + gy * gy + gz * gz;
        let is_known = zero.lt(squared);
        if by.bends {
            let length = squared.sqrt();
            let has_none = (nx * nx + ny * ny + nz * nz).le(zero);
            let all = L::Int::splat(if by.is_thin { -1 } else { 0 });
            let bends = is_known & (has_none | all);
            nx = L::select(bends, (zero - gx) / length, nx);
            ny = L::select(bends, (zero - gy) / length, ny);
            nz = L::select(bends, (zero - gz) / length, nz);
        }
        let normal = [nx, ny, nz];
        let (mean, share, lever, deepest) = match points.half_axes {
            Some(half_axes) => {
                let range = Range::of(half_axes, [gx, gy, gz], L::splat(touched.limit_m));
                let [near, far] = &touched.shortfalls_m;
                let shortfalls = [L::load(&near.0).only(wanted), L::load(&far.0).only(wanted)];
                let Immersed { mean, share, lever } = range.immersed(depth, shortfalls);
                (mean, share, [lever[0] * area, lever[1] * area, lever[2] * area], mean)
            }
            None => (depth, one, [zero; 3], zero),
        };
        gx = L::select(is_known, gx, zero - nx);
        gy = L::select(is_known, gy, zero - ny);
        gz = L::select(is_known, gz, zero - nz);
        let gradient = [gx, gy, gz];
        Self {
            normal,
            moment: cross(arm, normal),
            gradient,
            gradient_moment: cross(arm, gradient),
            arm,
            turn: cross(lever, normal),
            lever,
            deepest,
            force: mean * area,
            stiffness: share * area,
            // Our smooth count: what a contact stands for counts fully from a quarter voxel on, so
            // that normalisation has no steps.
            effective: (mean * L::splat(by.per_quarter_voxel)).min(one) * area,
        }
    }
}

impl Sums {
    pub(super) const ZERO: Self = Self {
        part: [[0.0; LANES]; QUANTITIES],
        n_blocks_in_part: 0,
        deepest: [0.0; LANES],
        lanes: [[0.0; LANES / 4]; QUANTITIES],
    };

    /// Adds the lanes of a block that touch.
    #[inline(always)]
    pub(super) fn add<L: F32s<LANES>>(
        &mut self,
        touched: &ContactBlock,
        points: Points<'_>,
        by: Weighting,
    ) {
        let addends = Addends::<L>::of(touched, points, by);
        let Addends { normal, moment, gradient, gradient_moment, .. } = addends;
        let Addends { arm, turn, lever, deepest, force, stiffness, effective, .. } = addends;
        let mut sums = self.part.iter_mut();
        put(&mut sums, force, normal);
        put_more(&mut sums, force, moment, turn);
        let [nx, ny, nz] = normal;
        let [mx, my, mz] = moment;
        put_symmetric(&mut sums, [stiffness * nx, stiffness * ny, stiffness * nz], gradient);
        put(&mut sums, stiffness * mx, gradient);
        put(&mut sums, stiffness * my, gradient);
        put(&mut sums, stiffness * mz, gradient);
        put_symmetric(&mut sums, [stiffness * mx, stiffness * my, stiffness * mz], gradient_moment);
        put(&mut sums, force, gradient);
        let one = L::splat(1.0);
        put(&mut sums, one, [force]);
        put_more(&mut sums, force, arm, lever);
        put(&mut sums, one, [effective]);
        L::load(&self.deepest).max(deepest).store(&mut self.deepest);
        self.n_blocks_in_part += 1;
        if self.n_blocks_in_part == BLOCKS_PER_PART {
            self.settle();
        }
    }

    /// Adds the facets of a block that lie over an edge of the obstacle, by points that press as they
    /// do.
    #[inline(always)]
    fn add_clipped<L: F32s<LANES>>(
        &mut self,
        touched: &ContactBlock,
        facets: Points<'_>,
        by: Weighting,
        at: &CreasesAt<'_>,
    ) {
        let Some([a, b]) = facets.half_axes else { return };
        let mut pressing = Pressing::new(touched);
        let mut over = OverPlanes::NONE;
        let mut deepest_m = 0.0_f32;
        for lane in (0..LANES).filter(|lane| touched.clipped >> lane & 1 == 1) {
            let middle = facets.positions.get(lane);
            let half_axes = [a.get(lane), b.get(lane)];
            if !at.over(middle, half_axes, &mut over) {
                continue;
            }
            let normal = facets.normals.get(lane);
            let weight = facets.weights.0.get(lane).copied().unwrap_or(0.0);
            let mut mean_depth_m = 0.0;
            for k in 0..over.n {
                let piece = over.piece(k);
                for triangle in piece.triangles() {
                    let share = share_of_point(triangle) * weight;
                    for on_facet in midpoints(triangle) {
                        let (depth_m, gradient) = over.depth_and_gradient(k, on_facet);
                        mean_depth_m += share_of_point(triangle) * depth_m;
                        let position =
                            middle + half_axes[0] * on_facet.x + half_axes[1] * on_facet.y;
                        pressing.push(position, normal, share, depth_m, gradient);
                        if pressing.is_full() {
                            self.add::<L>(&pressing.touched, pressing.points(), by);
                            pressing.clear();
                        }
                    }
                }
            }
            deepest_m = deepest_m.max(mean_depth_m);
        }
        if pressing.touched.lanes != 0 {
            self.add::<L>(&pressing.touched, pressing.points(), by);
        }
        let [first, ..] = &mut self.deepest;
        *first = first.max(deepest_m);
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
        let deepest = self.deepest.into_iter().fold(0.0, f32::max).into();
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
        Total {
            depth_normal,
            depth_moment,
            stiffness,
            depth_gradient,
            depth,
            depth_arm,
            effective,
            deepest,
        }
    }
}

/// Points that press, until there are as many as a block has.
struct Pressing {
    positions: Lanes3,
    normals: Lanes3,
    weights: Lanes,
    touched: ContactBlock,
    n: usize,
}

impl Pressing {
    #[inline(always)]
    fn new(of: &ContactBlock) -> Self {
        Self {
            positions: Lanes3::ZERO,
            normals: Lanes3::ZERO,
            weights: Lanes([0.0; LANES]),
            touched: ContactBlock { block: of.block, weight: of.weight, ..ContactBlock::NONE },
            n: 0,
        }
    }

    #[inline(always)]
    fn push(&mut self, position: Vec3, normal: Vec3, weight: f32, depth_m: f32, gradient: Vec3) {
        if let (Some(own_weight), Some(own_depth_m)) =
            (self.weights.0.get_mut(self.n), self.touched.depths_m.get_mut(self.n))
        {
            *own_weight = weight;
            *own_depth_m = depth_m;
            self.positions.set(self.n, position);
            self.normals.set(self.n, normal);
            self.touched.gradients.set(self.n, gradient);
            self.touched.lanes |= 1 << self.n;
            self.n += 1;
        }
    }

    #[inline(always)]
    fn is_full(&self) -> bool {
        self.n == LANES
    }

    #[inline(always)]
    fn clear(&mut self) {
        self.touched.lanes = 0;
        self.n = 0;
    }

    #[inline(always)]
    fn points(&self) -> Points<'_> {
        let Self { positions, normals, weights, .. } = self;
        Points { positions, normals, weights, half_axes: None }
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

/// Adds factor · column and something more to the next sums.
#[inline(always)]
fn put_more<'a, L: F32s<LANES>, const N: usize>(
    sums: &mut impl Iterator<Item = &'a mut [f32; LANES]>,
    factor: L,
    columns: [L; N],
    more: [L; N],
) {
    for ((column, more), sum) in columns.into_iter().zip(more).zip(sums) {
        (L::load(sum) + (factor * column + more)).store(sum);
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
    /// Of one facet, in the mean over it.
    pub(super) deepest: f64,
}

/// Adds blocks of a shell to the sums.
pub(super) struct AddAll<'a> {
    pub(super) sums: &'a mut Sums,
    pub(super) touched: &'a [ContactBlock],
    pub(super) shell: &'a Shell,
    pub(super) by: Weighting,
    pub(super) at: CreasesAt<'a>,
}

impl Kernel for AddAll<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: F32x8>(self) {
        let shell = self.shell;
        let all_positions = shell.positions();
        let all_normals = shell.normals();
        let all_weights = shell.weights();
        let all_half_axes = shell.half_axes();
        let points = |touched: &ContactBlock| {
            let block = touched.block as usize;
            Some(Points {
                positions: all_positions.get(block)?,
                normals: all_normals.get(block)?,
                weights: all_weights.get(block)?,
                half_axes: all_half_axes.get(block),
            })
        };
        let mut soon = self.touched.iter().skip(AHEAD);
        for touched in self.touched {
            if let Some(Points { positions, normals, half_axes, .. }) = soon.next().and_then(points)
            {
                positions.prefetch();
                normals.prefetch();
                if let Some([a, b]) = half_axes {
                    a.prefetch();
                    b.prefetch();
                }
            }
            if let Some(points) = points(touched) {
                if touched.lanes != touched.clipped {
                    self.sums.add::<L::Wide>(touched, points, self.by);
                }
                if touched.clipped != 0 {
                    self.sums.add_clipped::<L::Wide>(touched, points, self.by, &self.at);
                }
            }
        }
    }
}

/// Adds a block to the sums whose points push as is said here.
pub(super) struct Add<'a> {
    pub(super) sums: &'a mut Sums,
    pub(super) touched: &'a ContactBlock,
    pub(super) points: Points<'a>,
    pub(super) by: Weighting,
}

impl Kernel for Add<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: F32x8>(self) {
        self.sums.add::<L::Wide>(self.touched, self.points, self.by);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::SimdLevel;
    use crate::spatial::testing::Random;

    const VOXEL_SIZE_M: f64 = 1.0;
    const BLOCKS: u32 = 40;
    const LIMIT_M: f32 = 0.8;

    /// The points of a block.
    struct Block {
        positions: Lanes3,
        normals: Lanes3,
        weights: Lanes,
        half_axes: [Lanes3; 2],
    }

    impl Block {
        fn points(&self, with_extent: bool) -> Points<'_> {
            let Self { positions, normals, weights, half_axes } = self;
            Points { positions, normals, weights, half_axes: with_extent.then_some(half_axes) }
        }
    }

    /// Touching blocks; whatever does not touch is not a number, but for half axes.
    fn blocks() -> Vec<(ContactBlock, Block)> {
        let mut chance = Random(11);
        let unknown = Lanes([f32::NAN; LANES]);
        let nowhere = Lanes3 { x: unknown, y: unknown, z: unknown };
        let mut blocks = Vec::new();
        for block in 0..BLOCKS {
            let mut touched = ContactBlock {
                block,
                lanes: 0,
                clipped: 0,
                weight: 1.0 + chance.unit() as f32,
                limit_m: LIMIT_M,
                depths_m: [f32::NAN; LANES],
                gradients: nowhere,
                shortfalls_m: [unknown; 2],
            };
            let mut points = Block {
                positions: nowhere,
                normals: nowhere,
                weights: Lanes(core::array::from_fn(|_| 1.0 + chance.unit() as f32)),
                half_axes: [Lanes3::ZERO; 2],
            };
            for lane in 0..LANES {
                for axis in &mut points.half_axes {
                    axis.set(lane, chance.in_box(-0.5, 0.5).as_vec3());
                }
                if chance.unit() < 0.5 {
                    touched.lanes |= 1 << lane;
                    touched.depths_m[lane] = (VOXEL_SIZE_M * (chance.unit() - 0.2)) as f32;
                    touched.set_shortfalls(
                        lane,
                        [(); 2].map(|()| (-0.3 * VOXEL_SIZE_M * chance.unit()) as f32),
                    );
                    // Of some it is not known.
                    let is_known = if lane % 5 == 0 { 0.0 } else { 1.0 };
                    touched.gradients.set(lane, (chance.in_box(-1.0, 1.0) * is_known).as_vec3());
                    points.positions.set(lane, chance.in_box(-1.0, 1.0).as_vec3());
                    let has_normal = if lane % 7 == 3 { 0.0 } else { 1.0 };
                    let normal = chance.in_box(-1.0, 1.0).normalize() * has_normal;
                    points.normals.set(lane, normal.as_vec3());
                }
            }
            blocks.push((touched, points));
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
        deepest: 0.0,
    };

    /// Mean, share and first moment of what is above zero on a line from p to q of length 1.
    fn above(p: f64, q: f64) -> (f64, f64, f64) {
        match (p > 0.0, q > 0.0) {
            (true, true) => (0.5 * (p + q), 1.0, p / 6.0 + q / 3.0),
            (false, false) => (0.0, 0.0, 0.0),
            // A triangle that begins at the zero: its middle is two thirds on.
            (false, true) => {
                let zero = p / (p - q);
                let area = 0.5 * q * (1.0 - zero);
                (area, 1.0 - zero, area * (zero + (1.0 - zero) * 2.0 / 3.0))
            }
            (true, false) => {
                let zero = p / (p - q);
                let area = 0.5 * p * zero;
                (area, zero, area * zero / 3.0)
            }
        }
    }

    /// The same by the formula, point by point.
    fn add_plainly(
        total: &mut Total,
        touched: &ContactBlock,
        points: Points<'_>,
        (is_thin, is_skin): (bool, bool),
    ) {
        for lane in touched.lanes() {
            let depth = f64::from(touched.depths_m[lane]);
            let area = f64::from(points.weights.0[lane] * touched.weight);
            let known = touched.gradients.get(lane).as_dvec3();
            let own = points.normals.get(lane).as_dvec3();
            let bends = is_thin || is_skin && own == DVec3::ZERO;
            let normal = if bends { (-known).try_normalize().unwrap_or(own) } else { own };
            let arm = points.positions.get(lane).as_dvec3();
            let [a, b] = points.half_axes.map_or([DVec3::ZERO; 2], |[a, b]| {
                [a.get(lane).as_dvec3(), b.get(lane).as_dvec3()]
            });
            let alpha = a.dot(known);
            let beta = b.dot(known);
            let whole = alpha.hypot(beta);
            let w = whole.min(LIMIT_M.into());
            let [near, far] = touched.shortfalls_m.map(|of| f64::from(of.0[lane]));
            let outward = above(depth, depth - w + near);
            let inward = above(depth, depth + w + far);
            let has_extent = points.half_axes.is_some();
            let (mean, t) = if has_extent {
                (0.5 * (outward.0 + inward.0), 0.5 * (outward.1 + inward.1))
            } else {
                (depth, 1.0)
            };
            let way = if whole > 1e-9 {
                (a * alpha + b * beta) * (w / whole / whole)
            } else {
                DVec3::ZERO
            };
            let lever = way * (0.5 * (inward.2 - outward.2));
            total.depth_normal += normal * (mean * area);
            total.depth_moment += (arm.cross(normal) * mean + lever.cross(normal)) * area;
            let gradient = if known == DVec3::ZERO { -normal } else { known };
            let moment = arm.cross(normal);
            let outer = |one: DVec3, other: DVec3| {
                DMat3::from_cols(one * other.x, one * other.y, one * other.z)
            };
            let halved = |one, other| (outer(one, other) + outer(other, one)) * -0.5;
            let between = outer(gradient, moment) * -1.0;
            let turned = arm.cross(gradient);
            total.stiffness = total.stiffness.plus_scaled(
                t * area,
                &Mat6::from_blocks(
                    halved(normal, gradient),
                    between,
                    between.transpose(),
                    halved(moment, turned),
                ),
            );
            total.depth_gradient += gradient * (mean * area);
            total.depth += mean * area;
            total.depth_arm += (arm * mean + lever) * area;
            // Full from a quarter of a voxel on.
            total.effective += (mean / (0.25 * VOXEL_SIZE_M)).min(1.0) * area;
            if has_extent {
                total.deepest = total.deepest.max(mean);
            }
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
            numbers.extend([total.depth, total.effective, total.deepest]);
            numbers
        };
        // Some three hundred points of about one each, in `f32`.
        for (found, expected) in numbers(found).into_iter().zip(numbers(expected)) {
            assert!((found - expected).abs() < 1e-2, "{what}: {found} and not {expected}");
        }
    }

    #[test]
    fn blocks_add_up_to_the_sum_over_their_facets_by_the_formula() {
        let blocks = blocks();
        let ways = [(false, false), (false, true), (true, false)];
        for (level, (is_thin, is_skin)) in
            SimdLevel::available().flat_map(|level| ways.map(|way| (level, way)))
        {
            for with_extent in [false, true] {
                let by = Weighting::new(VOXEL_SIZE_M as f32, is_thin, is_skin);
                let mut sums = Sums::ZERO;
                let mut expected = NOTHING;
                for (touched, block) in &blocks {
                    let points = block.points(with_extent);
                    level.run(Add { sums: &mut sums, touched, points, by });
                    // Sixteen blocks are added up in `f32`, and then settled.
                    assert_eq!(sums.n_blocks_in_part, (touched.block + 1) % BLOCKS_PER_PART);
                    add_plainly(&mut expected, touched, points, (is_thin, is_skin));
                }
                let what = format!("{level:?}, {is_thin} {is_skin} {with_extent}");
                assert_same(&sums.total(), &expected, &what);
            }
        }
    }
}
