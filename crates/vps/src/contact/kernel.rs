//! Sixteen points, or eight spheres, against a field at once.
//!
//! Most points are never interpolated, because the bound of their brick says that they cannot
//! touch.
//!
//! # Measured
//! Where one brick holds all points of a block, which is mostly so, it is asked once: its largest
//! depth answers for all of them, or its samples are read in pairs along z, which lie side by side.
//! What the third cache holds is fetched four blocks before its turn.

#![expect(unsafe_code, reason = "look-ups without checks, by the invariant of the bounds")]

use glam::{Mat3, Vec3};

use super::clip::CreasesAt;
use super::contact_block::ContactBlock;
use super::immersion::{Extents, Range};
use crate::pointshell::shell::{LANES, Lanes3};
use crate::pointshell::tree::{CHILDREN, Spheres};
use crate::simd::{AHEAD, F32s, F32x8, I32s, Kernel};
use crate::spatial::Pose;
use crate::voxmap::field::brick_bounds::BrickBounds;
use crate::voxmap::field::{APRON_CELLS, APRON_EDGE, Field};

const ROW: usize = APRON_EDGE;
const PLANE: usize = APRON_EDGE * APRON_EDGE;
/// What two interpolations take from a distance: the variance of a corner about the place it is
/// interpolated for is at most ¼ per axis, and there are three axes and two places; cells².
const SPREAD_CELLS_SQUARED: f32 = 1.5;
/// A ball of this radius about a place in a brick, and what rounding may add, lie in the brick and
/// its 26 neighbours, cells.
const AROUND_CELLS: f32 = 8.0;
/// 1/√3, a little less: an interpolation of values that grow by no more than their distance is at
/// most √3 times as steep.
const LEAST_SLOPE: f32 = 0.577;

/// Where the tool stands on a field's grid: body axes about the centre of mass to cells.
#[derive(Clone, Copy, Debug)]
pub(super) struct Place {
    /// Cells per metre, columns are the images of the body axes.
    axes: Mat3,
    /// The centre of mass, cells.
    pub(super) origin: Vec3,
}

impl Place {
    pub(super) fn new(field: &Field, map_from_body: Pose) -> Self {
        let per_metre = 1.0 / f64::from(field.voxel_size_m());
        // The subtraction in f64: what is left is small, whatever the origin.
        let origin = (map_from_body.translation - field.origin_map().as_dvec3()) * per_metre;
        Self {
            axes: (map_from_body.rotation_matrix() * per_metre).as_mat3(),
            origin: origin.as_vec3(),
        }
    }

    /// Where a point of the tool is, cells.
    #[inline]
    pub(super) fn cells(&self, position: Vec3) -> Vec3 {
        let Mat3 { x_axis, y_axis, z_axis } = self.axes;
        x_axis * position.x + y_axis * position.y + z_axis * position.z + self.origin
    }

    /// Slopes per cell along the grid as a gradient in tool axes, per metre.
    #[inline]
    pub(super) fn gradient(&self, slopes: Vec3) -> Vec3 {
        let Mat3 { x_axis, y_axis, z_axis } = self.axes;
        Vec3::new(x_axis.dot(slopes), y_axis.dot(slopes), z_axis.dot(slopes))
    }

    pub(super) fn is_finite(&self) -> bool {
        self.axes.is_finite() && self.origin.is_finite()
    }
}

/// V of the points of a block.
#[derive(Clone, Copy, Debug)]
pub(super) struct Depths {
    /// The block as it touches, if any of its lanes does. V of a point that was not interpolated is
    /// its brick's largest depth, which is no more than the floor asked for; gradients are there
    /// where some lane touches.
    pub(super) touched: ContactBlock,
    /// Largest of the depths, m; lanes that are not a number do not count.
    pub(super) max_m: f32,
}

/// Looks up blocks of points one after the other, and tells what it `found` of each. `floor` gives,
/// from the largest V so far, the depth up to which a point's own V is of no interest; what the
/// extents of facets reach is always. Gives the largest V. RT: safe; allocates nothing.
pub(super) struct Blocks<'a, Which, Floor, Found> {
    pub(super) bounds: &'a BrickBounds,
    pub(super) place: &'a Place,
    pub(super) positions: &'a [Lanes3],
    pub(super) extents: Extents<'a>,
    pub(super) which: Which,
    pub(super) floor: Floor,
    pub(super) found: Found,
}

impl<Which, Floor, Found> Kernel for Blocks<'_, Which, Floor, Found>
where
    Which: Iterator<Item = u32> + Clone,
    Floor: Fn(f32) -> f32,
    Found: FnMut(u32, &Depths),
{
    type Output = f32;

    #[inline(always)]
    fn run<L: F32x8>(self) -> f32 {
        let Self { bounds, place, positions, extents, which, floor, mut found } = self;
        let grid = Grid::<L::Wide, LANES>::new(bounds, place);
        let mut max_m = f32::NEG_INFINITY;
        let mut soon = which.clone().skip(AHEAD);
        for block in which {
            if let Some(points) = soon.next().and_then(|block| positions.get(block as usize)) {
                points.prefetch();
            }
            let Some(points) = positions.get(block as usize) else { continue };
            let depths = grid.depths(block, points, extents, floor(max_m));
            max_m = if depths.max_m > max_m { depths.max_m } else { max_m };
            found(block, &depths);
        }
        max_m
    }
}

/// Which of eight spheres may hold a point whose V is above the floor: one bit each. RT: safe.
pub(super) struct Above<'a> {
    pub(super) bounds: &'a BrickBounds,
    pub(super) place: &'a Place,
    pub(super) spheres: &'a Spheres,
    pub(super) floor_m: f32,
    /// What rounding may take.
    pub(super) margin_cells: f32,
}

impl Kernel for Above<'_> {
    type Output = u8;

    #[inline(always)]
    fn run<L: F32x8>(self) -> u8 {
        let Self { bounds, place, spheres: Spheres { x, y, z, radius }, floor_m, margin_cells } =
            self;
        let grid = Grid::<L, CHILDREN>::new(bounds, place);
        let lattice = grid.lattice([L::load(x), L::load(y), L::load(z)]);
        let (on_grid, base) = grid.nearest(lattice);
        let extent = L::load(radius) / L::splat(bounds.voxel_size_m()) + L::splat(margin_cells);
        // SAFETY: each is a brick of the grid, and by the invariant of the bounds there is one
        // entry for it.
        let around = unsafe { L::gather(bounds.max_depth_nearby_m(), grid.brick(eighths(base))) };
        let mut off = L::Int::splat(0);
        for axis in 0..3 {
            let away = (lattice[axis] - on_grid[axis]).max(on_grid[axis] - lattice[axis]);
            off = off | extent.lt(away);
        }
        let below = L::select(off, grid.outside, around).le(L::splat(floor_m));
        !(below & (off | extent.lt(L::splat(AROUND_CELLS)))).byte()
    }
}

/// For each of eight spheres, how far it may move in any way before one of its points can be within
/// the bounds' reach of touching, cells; not above 0 when nothing is proven. RT: safe.
pub(super) struct Clearance<'a> {
    pub(super) bounds: &'a BrickBounds,
    pub(super) place: &'a Place,
    pub(super) spheres: &'a Spheres,
    /// What rounding may take.
    pub(super) margin_cells: f32,
}

impl Kernel for Clearance<'_> {
    type Output = [f32; CHILDREN];

    #[inline(always)]
    fn run<L: F32x8>(self) -> [f32; CHILDREN] {
        let Self { bounds, place, spheres: Spheres { x, y, z, radius }, margin_cells } = self;
        let grid = Grid::<L, CHILDREN>::new(bounds, place);
        let lattice = grid.lattice([L::load(x), L::load(y), L::load(z)]);
        let (on_grid, base) = grid.nearest(lattice);
        let brick = grid.brick(eighths(base));
        // SAFETY: each is a brick of the grid, and by the invariant of the bounds there is one
        // entry for it.
        let clearance = unsafe { L::gather(bounds.clearance_cells(), brick) };
        let values = grid.no_more_than(on_grid, base, brick);
        let zero = L::splat(0.0);
        let size = bounds.voxel_size_m();
        let touching = values + L::splat(bounds.reach_m());
        let outside = (touching / L::splat(-size) - L::splat(bounds.jump_cells())).max(zero);
        let by_spread = (outside * outside - L::splat(SPREAD_CELLS_SQUARED)).max(zero).sqrt();
        let free = clearance.max(by_spread.max(outside * L::splat(LEAST_SLOPE)));
        let squared = distance_squared(lattice, on_grid);
        let taken = L::load(radius) / L::splat(size) + L::splat(margin_cells);
        let mut cells = [0.0; CHILDREN];
        ((squared + free * free).sqrt() - taken).store(&mut cells);
        cells
    }
}

/// For each of eight spheres, what V of no point in it exceeds, m, if V of none is above 0; and how
/// high the field at its centre lets it reach, which tells spheres apart of which the first says the
/// same. RT: safe.
pub(super) struct Ceilings<'a> {
    pub(super) bounds: &'a BrickBounds,
    pub(super) place: &'a Place,
    pub(super) spheres: &'a Spheres,
    /// What rounding may take.
    pub(super) margin_cells: f32,
}

impl Kernel for Ceilings<'_> {
    type Output = [[f32; CHILDREN]; 2];

    #[inline(always)]
    fn run<L: F32x8>(self) -> [[f32; CHILDREN]; 2] {
        let Self { bounds, place, spheres: Spheres { x, y, z, radius }, margin_cells } = self;
        let grid = Grid::<L, CHILDREN>::new(bounds, place);
        let lattice = grid.lattice([L::load(x), L::load(y), L::load(z)]);
        // What of the sphere lies on the grid is no farther from here than from its centre.
        let (on_grid, base) = grid.nearest(lattice);
        let brick = grid.brick(eighths(base));
        let size = L::splat(bounds.voxel_size_m());
        let extent = L::load(radius) / size + L::splat(margin_cells);
        // SAFETY: each is a brick of the grid, and by the invariant of the bounds there is one
        // entry for it.
        let (around, clearance, far) = unsafe {
            (
                L::gather(bounds.max_depth_nearby_m(), brick),
                L::gather(bounds.clearance_cells(), brick),
                L::gather(bounds.far_cells(), brick),
            )
        };
        let by_spread = (extent * extent + L::splat(SPREAD_CELLS_SQUARED)).sqrt();
        let rises = by_spread.min(extent / L::splat(LEAST_SLOPE)) + L::splat(bounds.jump_cells());
        let by_field = grid.no_more_than(on_grid, base, brick) + rises * size;
        let near = L::select(extent.lt(L::splat(AROUND_CELLS)), around.min(by_field), by_field);
        let off_grid = distance_squared(lattice, on_grid);
        let is_far = extent.lt((off_grid + far * far).sqrt());
        let mut ceilings = [[0.0; CHILDREN]; 2];
        let [highest, reached] = &mut ceilings;
        L::select(is_far, grid.outside, grid.outside.max(near)).store(highest);
        let free = (off_grid + clearance * clearance).sqrt();
        by_field.min((extent - free) * size).store(reached);
        ceilings
    }
}

#[inline(always)]
fn distance_squared<L: F32s<N>, const N: usize>(from: [L; 3], to: [L; 3]) -> L {
    let [x, y, z] = [from[0] - to[0], from[1] - to[1], from[2] - to[2]];
    x * x + y * y + z * z
}

/// How far a place with V = −`depth_cells` is from anything with V > 0, cells, by the field itself.
///
/// # Source
/// Ours. Samples are distances, so they differ by no more than they are apart, and by
/// [`BrickBounds::jump_cells`] more where they are moved. V at two places are
/// means of such samples, hence V(b) − V(a) ≤ E|X − Y| ≤ √(E|X − Y|²) = √(|b − a|² + Var X + Var
/// Y), X and Y the corners with their weights; also V(b) − V(a) ≤ √3·|b − a|, as no partial
/// derivative exceeds 1. The better of the two counts.
#[inline(always)]
pub(super) fn free_cells(depth_cells: f32) -> f32 {
    let outside_cells = depth_cells.max(0.0);
    let by_spread = (outside_cells * outside_cells - SPREAD_CELLS_SQUARED).max(0.0).sqrt();
    by_spread.max(outside_cells * LEAST_SLOPE)
}

/// The bounds and the place in lanes.
struct Grid<'a, L: F32s<N>, const N: usize> {
    bounds: &'a BrickBounds,
    place: &'a Place,
    axes: [[L; 3]; 3],
    origin: [L; 3],
    dims: [L::Int; 3],
    low: L,
    high: L,
    skin: L,
    outside: L,
}

impl<'a, L: F32s<N>, const N: usize> Grid<'a, L, N> {
    #[inline(always)]
    fn new(bounds: &'a BrickBounds, place: &'a Place) -> Self {
        let [nx, ny, nz] = bounds.dims();
        let Mat3 { x_axis, y_axis, z_axis } = place.axes;
        Self {
            bounds,
            place,
            axes: [splat(x_axis), splat(y_axis), splat(z_axis)],
            origin: splat(place.origin),
            dims: [L::Int::splat(nx), L::Int::splat(ny), L::Int::splat(nz)],
            low: L::splat(-bounds.band_m()),
            high: L::splat(bounds.band_m()),
            skin: L::splat(bounds.skin_m()),
            outside: L::splat(bounds.skin_m() - bounds.band_m()),
        }
    }

    /// Where points of the tool are, cells.
    #[inline(always)]
    fn cells(&self, [x, y, z]: [L; 3]) -> [L; 3] {
        let mut cells = self.origin;
        for (k, along) in cells.iter_mut().enumerate() {
            *along = self.axes[0][k] * x + self.axes[1][k] * y + self.axes[2][k] * z + *along;
        }
        cells
    }

    /// Coordinates on the lattice of cell centres.
    #[inline(always)]
    fn lattice(&self, point: [L; 3]) -> [L; 3] {
        let [x, y, z] = self.cells(point);
        [x - L::splat(0.5), y - L::splat(0.5), z - L::splat(0.5)]
    }

    /// Number of a brick. The product of the sizes fits, by the invariant of the bounds.
    #[inline(always)]
    fn brick(&self, [bx, by, bz]: [L::Int; 3]) -> L::Int {
        (bx * self.dims[1] + by) * self.dims[2] + bz
    }

    /// The place of the grid that is nearest to one on the lattice, and its cell: all that can
    /// touch lies there, and the grid is convex. What is not a number becomes 0.
    #[inline(always)]
    fn nearest(&self, lattice: [L; 3]) -> ([L; 3], [L::Int; 3]) {
        let mut on_grid = lattice;
        let mut base = self.dims;
        for (at, base) in on_grid.iter_mut().zip(&mut base) {
            let end = *base * L::Int::splat(8);
            *at = at.max(L::splat(0.0)).min(L::of_int(end));
            // The far end belongs to the last cell.
            *base = at.truncated().min(end + L::Int::splat(-1));
        }
        (on_grid, base)
    }

    /// V of places on the grid, in cells and bricks that are known, or more than that. Beyond the
    /// band samples are not distances any more, only no nearer than it: those count as at its end.
    #[inline(always)]
    fn no_more_than(&self, on_grid: [L; 3], base: [L::Int; 3], brick: L::Int) -> L {
        // SAFETY: each is a brick of the grid, and by the invariant of the bounds there is one
        // entry for it in each array.
        let (values, slots) = unsafe {
            (L::gather(self.bounds.max_depth_m(), brick), L::Int::gather(self.bounds.top(), brick))
        };
        let is_slot = slots.gt(L::Int::splat(-1));
        if is_slot.bits() == 0 {
            return values;
        }
        // SAFETY: a slot of `top`, or 0 beside one.
        let mut corners = unsafe { self.corners(slots & is_slot, base) };
        for (first, second) in &mut corners {
            (*first, *second) = (self.low.max(*first), self.low.max(*second));
        }
        L::select(is_slot, mixed(corners, fractions(on_grid, base)) + self.skin, values)
    }

    /// A mask: bricks that are not on the grid.
    #[inline(always)]
    fn off(&self, bricks: [L::Int; 3]) -> L::Int {
        let zero = L::Int::splat(0);
        let mut off = zero;
        for (brick, dim) in bricks.into_iter().zip(self.dims) {
            off = off | zero.gt(brick) | brick.gt(dim + L::Int::splat(-1));
        }
        off
    }

    /// Those off the grid, slots and largest depths of the bricks of points anywhere.
    #[inline(always)]
    fn apart(&self, base: [L::Int; 3]) -> (L::Int, L::Int, L) {
        let bricks = eighths(base);
        let zero = L::Int::splat(0);
        let off = self.off(bricks);
        let brick = L::Int::select(off, zero, self.brick(bricks));
        // SAFETY: lanes that are not on the grid read entry 0; by the invariant of the bounds there
        // is one entry per brick.
        let max_depths =
            L::select(off, self.outside, unsafe { L::gather(self.bounds.max_depth_m(), brick) });
        // SAFETY: as above.
        let slots = unsafe { L::Int::gather(self.bounds.top(), brick) };
        (off, slots, max_depths)
    }

    /// V of points whose bricks have these slots and largest depths, and its gradient where some of
    /// them are deeper than minus the reach.
    #[inline(always)]
    fn interpolated(
        &self,
        (known, slots, max_depths): (L::Int, L::Int, L),
        lattice: [L; 3],
        base: [L::Int; 3],
        (floor_m, reach_m): (L, L),
    ) -> (L, [L; 3]) {
        let nothing = L::splat(0.0);
        let zero = L::Int::splat(0);
        let all = zero.eq(zero).bits();
        // The two marks are −1 and −2 as signed numbers; slots are not negative.
        let known = known | max_depths.le(floor_m) | zero.gt(slots);
        if known.bits() == all {
            return (max_depths, [nothing; 3]);
        }
        // SAFETY: a slot of `top`, or 0 where none is wanted; as one is wanted, there are samples.
        let corners = unsafe { self.corners(L::Int::select(known, zero, slots), base) };
        let (values, mut gradient) = self.finished(corners, fractions(lattice, base), reach_m);
        for along in &mut gradient {
            *along = L::select(known, nothing, *along);
        }
        (L::select(known, max_depths, values), gradient)
    }

    /// Corners of interpolation cells of any bricks.
    ///
    /// # Safety
    /// Each slot is below the number of bricks with samples.
    #[inline(always)]
    unsafe fn corners(&self, slots: L::Int, base: [L::Int; 3]) -> [(L, L); 4] {
        let first = slots * L::Int::splat(APRON_CELLS as i32) + inside::<L, N>(base);
        // SAFETY: whole bricks, by the caller's word; the sum is an `i32` by the invariant of the
        // bounds.
        unsafe { corners(self.bounds.samples_m().as_flattened(), first) }
    }

    /// V from the corners and the place between them, and its gradient, m/m in tool axes, where
    /// some lane is deeper than minus the reach.
    #[inline(always)]
    fn finished(&self, corners: [(L, L); 4], t: [L; 3], reach_m: L) -> (L, [L; 3]) {
        // Limit first: what is not a number stays what it is.
        let values = self.high.min(self.low.max(mixed(corners, t))) + self.skin;
        let mut gradient = [L::splat(0.0); 3];
        if (L::splat(0.0) - reach_m).lt(values).bits() != 0 {
            let [x, y, z] = slopes(corners, t);
            for (along, axis) in gradient.iter_mut().zip(self.axes) {
                *along = axis[0] * x + axis[1] * y + axis[2] * z;
            }
        }
        (values, gradient)
    }
}

impl<'a, L: F32s<LANES>> Grid<'a, L, LANES> {
    /// V of the points of a block.
    #[inline(always)]
    fn depths(
        &self,
        number: u32,
        positions: &Lanes3,
        extents: Extents<'_>,
        floor_m: f32,
    ) -> Depths {
        let block = number as usize;
        let reach_m = extents.reach_m(block);
        let reach = L::splat(reach_m);
        let Lanes3 { x, y, z } = positions;
        let points = [L::load(&x.0), L::load(&y.0), L::load(&z.0)];
        let whole_reach_m = extents.whole_reach_m(block);
        let (values, gradient) = self.look_up(points, (floor_m.min(-whole_reach_m), reach));
        let limit_m = extents.limit_m();
        let mut touched = ContactBlock { block: number, limit_m, ..ContactBlock::NONE };
        let none = L::splat(0.0);
        if (none - reach).lt(values).bits() != 0 {
            let deepest = match extents.half_axes(block) {
                Some(half_axes) => {
                    let range = Range::of(half_axes, gradient, L::splat(extents.limit_m()));
                    let near = range.near(values);
                    let mut far = none;
                    if near.bits() != 0 {
                        let [at_near, at_far] = &mut touched.shortfalls_m;
                        // The outer half of a facet whose centroid is outside does not count.
                        let inside = near & none.lt(values);
                        let ends = self.look_up_ends(positions, points, &range, [inside, near]);
                        range.shortfall(inside, values, (-1.0, ends[0])).store(&mut at_near.0);
                        far = range.shortfall(near, values, (1.0, ends[1]));
                        far.store(&mut at_far.0);
                    }
                    range.deepest(values, far)
                }
                None => values,
            };
            touched.lanes = none.lt(deepest).bits() as u16;
        }
        if touched.lanes != 0 {
            let [x, y, z] = gradient;
            x.store(&mut touched.gradients.x.0);
            y.store(&mut touched.gradients.y.0);
            z.store(&mut touched.gradients.z.0);
        }
        let mut max_m = values.max(L::splat(f32::NEG_INFINITY)).max_lane();
        values.store(&mut touched.depths_m);
        let near = L::splat(-whole_reach_m).lt(values);
        if near.bits() != 0
            && extents.meets_planes(block)
            && let Some(half_axes) = extents.half_axes(block)
        {
            let creased = near & self.creased(points);
            if creased.bits() != 0 {
                let at = CreasesAt::of(self.bounds, self.place);
                max_m = at.meet_all(creased.bits() as u16, positions, half_axes, &mut touched);
            }
        }
        Depths { touched, max_m }
    }

    /// A mask: points in cells that have planes or patches.
    #[inline(always)]
    fn creased(&self, points: [L; 3]) -> L::Int {
        let creases = self.bounds.creases();
        let lattice = self.lattice(points);
        let base = [lattice[0].floored(), lattice[1].floored(), lattice[2].floored()];
        let zero = L::Int::splat(0);
        let (entries, has_entry) = match only_brick::<L, LANES>(base) {
            Some(brick) => {
                let entry = self.number(brick).and_then(|brick| creases.of_brick().get(brick));
                let entries = L::Int::splat(entry.map_or(-1, |entry| *entry as i32));
                (entries, entries.gt(L::Int::splat(-1)))
            }
            None => {
                let bricks = eighths(base);
                let off = self.off(bricks);
                let brick = L::Int::select(off, zero, self.brick(bricks));
                // SAFETY: lanes that are not on the grid read entry 0; by the invariant of the
                // bounds there is one entry per brick, as there are creases.
                let entries = unsafe { L::Int::gather(creases.of_brick(), brick) };
                (entries, L::Int::select(off, zero, entries.gt(L::Int::splat(-1))))
            }
        };
        if has_entry.is_zero() {
            return zero;
        }
        let seven = L::Int::splat(7);
        let [x, y, z] = [base[0] & seven, base[1] & seven, base[2] & seven];
        let eight = L::Int::splat(8);
        let cell = (((entries & has_entry) * eight + x) * eight + y) * eight + z;
        // SAFETY: an entry of the creases, or their first, and a cell in it.
        let own = unsafe { L::Int::gather(creases.cells().as_flattened(), cell) };
        L::Int::select(own.eq(zero), zero, has_entry)
    }

    /// V at the outer and at the inner ends of the facets of some lanes; of few at once.
    #[inline(always)]
    fn look_up_ends(
        &self,
        positions: &Lanes3,
        points: [L; 3],
        range: &Range<L>,
        [outer, inner]: [L::Int; 2],
    ) -> [L; 2] {
        let [outer_lanes, inner_lanes] = [outer.bits(), inner.bits()];
        let n_inner = inner_lanes.count_ones();
        if !L::PACKS || outer_lanes.count_ones() + n_inner > LANES as u32 {
            let found_inner = self.look_up_end(points, range, inner, 1.0);
            if outer_lanes == 0 {
                return [L::splat(0.0), found_inner];
            }
            return [self.look_up_end(points, range, outer, -1.0), found_inner];
        }
        let behind = u32::from(u16::MAX) & u32::from(u16::MAX) << n_inner;
        // Lanes that are left over look where one of the others does.
        let mut ends = splat(positions.get(inner_lanes.trailing_zeros() as usize));
        for ((end, point), along) in ends.iter_mut().zip(points).zip(range.way) {
            let inner_ends = (point + along).packed(inner_lanes, *end);
            let outer_ends = (point - along).packed(outer_lanes, *end).unpacked(behind);
            *end = L::select(L::Int::mask(behind), outer_ends, inner_ends);
        }
        let found = self.look_up(ends, no_floor()).0;
        [found.packed(behind, found).unpacked(outer_lanes), found.unpacked(inner_lanes)]
    }

    /// V at one end of the facets of some lanes.
    #[inline(always)]
    fn look_up_end(&self, [x, y, z]: [L; 3], range: &Range<L>, lanes: L::Int, sign: f32) -> L {
        let [along_x, along_y, along_z] = range.way;
        let sign = L::splat(sign);
        let end = [
            x + along_x.only(lanes) * sign,
            y + along_y.only(lanes) * sign,
            z + along_z.only(lanes) * sign,
        ];
        self.look_up(end, no_floor()).0
    }

    /// V of the points of a block, of no interest up to the floor, and its gradient where some of
    /// them are deeper than minus the reach.
    #[inline(always)]
    fn look_up(&self, points: [L; 3], (floor_m, reach): (f32, L)) -> (L, [L; 3]) {
        let lattice = self.lattice(points);
        let base = [lattice[0].floored(), lattice[1].floored(), lattice[2].floored()];
        // Points of a block are neighbours: often one brick holds them all, and one load is cheaper
        // than sixteen.
        match only_brick::<L, LANES>(base) {
            None => {
                let bricks = match self.near(base) {
                    Some(bricks) => bricks,
                    None => self.apart(base),
                };
                self.interpolated(bricks, lattice, base, (L::splat(floor_m), reach))
            }
            Some(brick) => match self.alone(brick, floor_m) {
                Alone::Uniform(value_m) => (L::splat(value_m), [L::splat(0.0); 3]),
                Alone::Samples(samples) => {
                    // SAFETY: one whole brick, and numbers of cells in it.
                    let corners = unsafe { corners(samples, inside::<L, LANES>(base)) };
                    self.finished(corners, fractions(lattice, base), reach)
                }
            },
        }
    }

    /// Slots and largest depths of the bricks of points that lie in two bricks along each axis at
    /// most.
    #[inline(always)]
    fn near(&self, base: [L::Int; 3]) -> Option<(L::Int, L::Int, L)> {
        let zero = L::Int::splat(0);
        let mut first = [0; 3];
        let mut which = zero;
        let mut beyond = zero;
        for (brick, first) in eighths::<L::Int, LANES>(base).into_iter().zip(&mut first) {
            let some = brick.first();
            *first = some - i32::from(L::Int::splat(some).gt(brick).bits() != 0);
            let after = brick + L::Int::splat(-*first);
            beyond = beyond | after;
            which = which + which + after;
        }
        if !(beyond & L::Int::splat(!1)).is_zero() {
            return None;
        }
        let (slots, max_depths) = L::pick(self.bounds.eight(first)?, which);
        Some((zero, slots, max_depths))
    }

    /// Number of a brick of the grid.
    #[inline(always)]
    fn number(&self, [bx, by, bz]: [i32; 3]) -> Option<usize> {
        let [nx, ny, nz] = self.bounds.dims();
        let is_off = bx as u32 >= nx as u32 || by as u32 >= ny as u32 || bz as u32 >= nz as u32;
        (!is_off).then(|| ((bx * ny + by) * nz + bz) as usize)
    }

    /// What a brick says of points in it, of interest only above the floor.
    #[inline(always)]
    fn alone(&self, brick: [i32; 3], floor_m: f32) -> Alone<'a> {
        let bounds = self.bounds;
        let Some(brick) = self.number(brick) else {
            return Alone::Uniform(bounds.skin_m() - bounds.band_m());
        };
        let max_depth_m = bounds.max_depth_m().get(brick).copied().unwrap_or(f32::INFINITY);
        let samples = || bounds.samples_m().get(bounds.top().get(brick).copied()? as usize);
        if max_depth_m <= floor_m { None } else { samples() }
            .map_or(Alone::Uniform(max_depth_m), Alone::Samples)
    }
}

/// What one brick says of all points of a block.
#[derive(Clone, Copy)]
enum Alone<'a> {
    Uniform(f32),
    Samples(&'a [f32; APRON_CELLS]),
}

/// Every V is of interest, and no gradient: nothing is deeper than minus this.
#[inline(always)]
fn no_floor<L: F32s<N>, const N: usize>() -> (f32, L) {
    (f32::NEG_INFINITY, L::splat(f32::NEG_INFINITY))
}

#[inline(always)]
fn splat<L: F32s<N>, const N: usize>(v: Vec3) -> [L; 3] {
    [L::splat(v.x), L::splat(v.y), L::splat(v.z)]
}

/// Numbers of the bricks, per axis.
#[inline(always)]
fn eighths<I: I32s<N>, const N: usize>([x, y, z]: [I; 3]) -> [I; 3] {
    [x.shifted::<3>(), y.shifted::<3>(), z.shifted::<3>()]
}

#[inline(always)]
fn fractions<L: F32s<N>, const N: usize>(at: [L; 3], base: [L::Int; 3]) -> [L; 3] {
    [at[0] - L::of_int(base[0]), at[1] - L::of_int(base[1]), at[2] - L::of_int(base[2])]
}

/// The brick that all points lie in, if there is one. What is too large for a cell is in no brick
/// either.
#[inline(always)]
fn only_brick<L: F32s<N>, const N: usize>(base: [L::Int; 3]) -> Option<[i32; 3]> {
    let mut differing = L::Int::splat(0);
    let mut brick = [0; 3];
    for (base, brick) in base.into_iter().zip(&mut brick) {
        differing = differing | (base ^ L::Int::splat(base.first()));
        *brick = base.first() >> 3;
    }
    (differing & L::Int::splat(!7)).is_zero().then_some(brick)
}

/// Number of a cell's first sample within its brick: 9·(9·x + y) + z.
#[inline(always)]
fn inside<L: F32s<N>, const N: usize>([x, y, z]: [L::Int; 3]) -> L::Int {
    let seven = L::Int::splat(7);
    let edge = L::Int::splat(APRON_EDGE as i32);
    ((x & seven) * edge + (y & seven)) * edge + (z & seven)
}

/// Corners of interpolation cells, in pairs along z: `(first, second)` of rows 00, 01, 10, 11.
///
/// # Safety
/// `samples_m` are whole bricks, and each number is that of a cell's [`inside`] one of them.
#[inline(always)]
unsafe fn corners<L: F32s<N>, const N: usize>(samples_m: &[f32], first: L::Int) -> [(L, L); 4] {
    let mut at = [0; N];
    first.store(&mut at);
    // SAFETY: in a brick x, y, z are at most 7, so the last number read is 7·91 + 91 = 728 of its
    // 729.
    unsafe {
        [
            L::gather_pairs(samples_m, &at, 0),
            L::gather_pairs(samples_m, &at, ROW),
            L::gather_pairs(samples_m, &at, PLANE),
            L::gather_pairs(samples_m, &at, PLANE + ROW),
        ]
    }
}

/// Interpolation: z, then y, then x.
#[inline(always)]
fn mixed<L: F32s<N>, const N: usize>([c00, c01, c10, c11]: [(L, L); 4], [tx, ty, tz]: [L; 3]) -> L {
    let y0 = mix(mix(c00.0, c00.1, tz), mix(c01.0, c01.1, tz), ty);
    let y1 = mix(mix(c10.0, c10.1, tz), mix(c11.0, c11.1, tz), ty);
    mix(y0, y1, tx)
}

/// By how much [`mixed`] grows in a cell along each axis.
#[inline(always)]
fn slopes<L: F32s<N>, const N: usize>(
    [c00, c01, c10, c11]: [(L, L); 4],
    [tx, ty, tz]: [L; 3],
) -> [L; 3] {
    let z00 = mix(c00.0, c00.1, tz);
    let z01 = mix(c01.0, c01.1, tz);
    let z10 = mix(c10.0, c10.1, tz);
    let z11 = mix(c11.0, c11.1, tz);
    let near = mix(c00.1 - c00.0, c01.1 - c01.0, ty);
    let far = mix(c10.1 - c10.0, c11.1 - c11.0, ty);
    [mix(z10 - z00, z11 - z01, ty), mix(z01 - z00, z11 - z10, tx), mix(near, far, tx)]
}

#[inline(always)]
fn mix<L: F32s<N>, const N: usize>(a: L, b: L, t: L) -> L {
    a + (b - a) * t
}

#[cfg(test)]
mod tests {
    use glam::{DQuat, DVec3};

    use super::*;
    use crate::contact::tests::plate;
    use crate::pointshell::shell::Lanes;
    use crate::simd::SimdLevel;
    use crate::spatial::testing::Random;
    use crate::voxmap::field::{DEEP_INSIDE, FieldKind};

    const VOXEL_M: f64 = 1e-3;

    fn levels() -> [SimdLevel; 2] {
        [SimdLevel::Portable, SimdLevel::best()]
    }

    /// The same place of several bricks, cells.
    fn bricks_apart(random: &mut Random) -> Vec<Vec3> {
        let in_brick = 8.0 * random.in_box(0.1, 0.9) + 0.5;
        (0..LANES).map(|_| (in_brick + 8.0 * random.in_box(0.0, 3.0).floor()).as_vec3()).collect()
    }

    /// Around the middle of some brick, so many cells to each side, or anywhere on the grid and
    /// around it: places in cells.
    fn places(random: &mut Random, field: &Field, spread: Option<f64>) -> Vec<Vec3> {
        let dims = DVec3::from_array(field.brick_dims().map(|n| (8 * n) as f64));
        let anywhere = |random: &mut Random| random.in_box(0.0, 1.0) * (dims + 24.0) - 12.0;
        let middle = (anywhere(random) / 8.0).floor() * 8.0 + 4.5;
        (0..LANES)
            .map(|_| match spread {
                Some(spread) => middle + random.in_box(-spread, spread),
                None => anywhere(random),
            })
            .map(|cells| cells.as_vec3())
            .collect()
    }

    /// The tool stands so that its axes are those of the grid and it is measured from its corner.
    fn place(field: &Field) -> Place {
        Place::new(field, Pose::from_translation(field.origin_map().as_dvec3()))
    }

    fn block_of(cells: &[Vec3]) -> Lanes3 {
        let none = Lanes([0.0; LANES]);
        let mut block = Lanes3 { x: none, y: none, z: none };
        for (lane, at) in cells.iter().enumerate() {
            block.set(lane, *at * VOXEL_M as f32);
        }
        block
    }

    #[test]
    fn depths_are_those_of_the_field_in_one_brick_or_two_or_many_and_beside_the_grid() {
        let field = plate().field;
        let bounds = BrickBounds::of(&field).expect("bounds");
        let place = place(&field);
        let mut random = Random(11);
        for n in 0..3000 {
            let block = block_of(&match n % 5 {
                0 => places(&mut random, &field, Some(3.4)),
                1 => places(&mut random, &field, Some(6.0)),
                2 => places(&mut random, &field, Some(9.0)),
                3 => places(&mut random, &field, None),
                _ => bricks_apart(&mut random),
            });
            let floor_m = [f32::NEG_INFINITY, -2e-3, 1e-3][n % 3];
            for level in levels() {
                let mut found = None;
                let max_m = level.run(Blocks {
                    bounds: &bounds,
                    place: &place,
                    positions: core::slice::from_ref(&block),
                    extents: Extents::NONE,
                    which: core::iter::once(0),
                    floor: |_| floor_m,
                    found: |_, depths: &Depths| found = Some(*depths),
                });
                let found = found.expect("one block");
                let mut most_m = f32::NEG_INFINITY;
                for (lane, depth_m) in found.touched.depths_m.into_iter().enumerate() {
                    let cells = place.cells(block.get(lane));
                    let value_m = field.value(FieldKind::Trilinear, cells, Vec3::ZERO);
                    let is_read = (depth_m - value_m).abs() < 1e-9;
                    // Or a bound of it that is of no interest.
                    let is_bound =
                        value_m <= depth_m + 1e-9 && depth_m <= floor_m.max(field.outside_m());
                    assert!(is_read || is_bound, "{cells}: {depth_m} for {value_m}");
                    assert_eq!(found.touched.lanes >> lane & 1 == 1, depth_m > 0.0);
                    most_m = most_m.max(depth_m);
                }
                assert_eq!([found.max_m, max_m], [most_m; 2]);
            }
        }
    }

    #[test]
    fn a_sphere_that_holds_a_point_above_the_floor_is_above_and_a_small_one_far_below_is_not() {
        let field = plate().field;
        let bounds = BrickBounds::of(&field).expect("bounds");
        let mut random = Random(12);
        let mut n_not_above = 0;
        let mut n_tight = 0;
        for n in 0..3000_usize {
            let turn = DQuat::from_scaled_axis(random.in_box(-2.0, 2.0));
            let pose = Pose::new(turn, random.in_box(-0.02, 0.02));
            let place = Place::new(&field, pose);
            let centers = places(&mut random, &field, Some(20.0));
            let mut spheres = Spheres {
                x: [0.0; CHILDREN],
                y: [0.0; CHILDREN],
                z: [0.0; CHILDREN],
                radius: [0.0; CHILDREN],
            };
            for (lane, center) in centers.iter().enumerate().take(CHILDREN) {
                let map = field.origin_map() + *center * VOXEL_M as f32;
                let body = turn.inverse() * (map.as_dvec3() - pose.translation);
                spheres.x[lane] = body.x as f32;
                spheres.y[lane] = body.y as f32;
                spheres.z[lane] = body.z as f32;
                spheres.radius[lane] = ([0.5, 3.0, 6.0, 20.0][n % 5 % 4] * VOXEL_M) as f32;
            }
            // The last is more than the plate is deep anywhere.
            let floor_m = [-2e-3, 0.0, 1e-3, 3e-3][n % 4];
            for level in levels() {
                let margin_cells = 0.01;
                let above = Above {
                    bounds: &bounds,
                    place: &place,
                    spheres: &spheres,
                    floor_m,
                    margin_cells,
                };
                let above = level.run(above);
                let ceilings =
                    Ceilings { bounds: &bounds, place: &place, spheres: &spheres, margin_cells };
                let [ceilings_m, _] = level.run(ceilings);
                let rooms = [0.0, 0.5].map(|margin_cells| {
                    let spheres = &spheres;
                    level.run(Clearance { bounds: &bounds, place: &place, spheres, margin_cells })
                });
                for (lane, center) in centers.iter().enumerate().take(CHILDREN) {
                    let radius = spheres.radius[lane] / VOXEL_M as f32;
                    let on_it = random.in_box(-1.0, 1.0).normalize_or(DVec3::X).as_vec3();
                    let cells = *center + on_it * radius;
                    let value_m = field.value(FieldKind::Trilinear, cells, Vec3::ZERO);
                    assert!((rooms[0][lane] - rooms[1][lane] - 0.5).abs() < 1e-4, "{rooms:?}");
                    let is_above = above >> lane & 1 == 1;
                    assert!(is_above || value_m <= floor_m, "{cells}: {value_m} of {radius}");
                    let ceiling_m = ceilings_m[lane];
                    assert!(value_m <= ceiling_m.max(0.0), "{cells}: {value_m}, {ceiling_m}");
                    // Nothing is nearer than two bricks and a half.
                    let half = Vec3::from_array(field.brick_dims().map(|n| 4.0 * n as f32));
                    let off = (*center - half).abs();
                    let value_m = field.value(FieldKind::Trilinear, *center, Vec3::ZERO);
                    // All corners are within the band.
                    let known_m = field.outside_m() + 2.0 * VOXEL_M as f32;
                    if (half - off).min_element() > 1.0 && (known_m..0.0).contains(&value_m) {
                        let rises = ((radius + 0.01).powi(2) + 1.5).sqrt() + bounds.jump_cells();
                        let rises_m = rises * VOXEL_M as f32;
                        assert!(ceiling_m <= value_m + rises_m + 1e-6, "{ceiling_m}, {value_m}");
                        n_tight += 1;
                    }
                    let gap = (off - Vec3::new(30.0, 30.0, 2.0)).max_element();
                    let is_far = gap > 20.0 + radius;
                    if radius < 7.0 && (is_far || floor_m > 2e-3) {
                        assert!(!is_above, "{center}, {gap} cells away");
                        n_not_above += 1;
                    }
                }
            }
        }
        assert!(n_not_above > 1000 && n_tight > 1000, "{n_not_above}, {n_tight}");
    }

    #[test]
    fn a_sphere_is_as_clear_as_its_brick_or_the_field_at_its_centre_says_less_its_radius() {
        let field = plate().field;
        let place = &place(&field);
        let margin_cells = 0.25;
        let mut random = Random(13);
        let mut n_by_field = 0;
        for jump in [0.0, 0.75] {
            let bounds = &BrickBounds::of(&field).expect("bounds").with_jump(jump);
            let band = bounds.band_m() / VOXEL_M as f32;
            let [nx, ny, nz] = bounds.dims();
            let end = Vec3::new(nx as f32, ny as f32, nz as f32) * 8.0 - 1e-3;
            let with_samples: Vec<usize> = (0..bounds.top().len())
                .filter(|brick| bounds.top()[*brick] < DEEP_INSIDE)
                .collect();
            for n in 0..2 * with_samples.len() {
                // Anywhere, and in every brick that has samples.
                let centers = if n % 2 == 0 {
                    places(&mut random, &field, None)
                } else {
                    let brick = with_samples[n / 2] as i32;
                    let first = Vec3::new(
                        (brick / (ny * nz)) as f32,
                        (brick / nz % ny) as f32,
                        (brick % nz) as f32,
                    );
                    (0..LANES)
                        .map(|_| first * 8.0 + 0.5 + random.in_box(0.0, 8.0).as_vec3())
                        .collect()
                };
                let radius = (n % 3) as f32;
                let along = |axis: usize| {
                    core::array::from_fn(|lane| centers[lane].to_array()[axis] * VOXEL_M as f32)
                };
                let [x, y, z] = [0, 1, 2].map(along);
                let spheres = &Spheres { x, y, z, radius: [radius * VOXEL_M as f32; CHILDREN] };
                for level in levels() {
                    let rooms = level.run(Clearance { bounds, place, spheres, margin_cells });
                    for (center, room) in centers.iter().zip(rooms) {
                        let lattice = *center - 0.5;
                        let nearest = lattice.clamp(Vec3::ZERO, end);
                        let value_m = field.value(FieldKind::Trilinear, nearest + 0.5, Vec3::ZERO);
                        let outside = -value_m / VOXEL_M as f32;
                        let [bx, by, bz] = (nearest / 8.0).as_ivec3().to_array();
                        let brick = ((bx * ny + by) * nz + bz) as usize;
                        // Samples beyond the band count as if at its end.
                        if bounds.top()[brick] < DEEP_INSIDE && outside > band - 2.0 {
                            continue;
                        }
                        let of_brick = bounds.clearance_cells()[brick];
                        let by_field = free_cells(outside - jump);
                        let free = of_brick.max(by_field);
                        let expected =
                            (lattice - nearest).length().hypot(free) - radius - margin_cells;
                        assert!((room - expected).abs() < 1e-2, "{center}: {room} not {expected}");
                        n_by_field += u32::from(by_field > of_brick);
                    }
                }
            }
        }
        assert!(n_by_field > 500, "{n_by_field}");
    }

    #[test]
    fn points_of_two_bricks_across_an_edge_are_neither_of_one_brick_nor_of_neighbours() {
        let field = plate().field;
        let bounds = &BrickBounds::of(&field).expect("bounds");
        let place = &place(&field);
        let mut random = Random(14);
        // Across from the middle of the grid, one brick or two along either of two axes.
        let pairs = [Vec3::new(1.0, 1.0, 0.0), Vec3::new(1.0, 0.0, 1.0), Vec3::new(0.0, 1.0, 1.0)];
        for across in pairs.into_iter().flat_map(|across| [across * 8.0, across * 16.0]) {
            let first = random.in_box(8.5, 16.5).as_vec3();
            let cells: [Vec3; LANES] =
                core::array::from_fn(|lane| first + across * (lane % 2) as f32);
            let block = block_of(&cells);
            for level in levels() {
                level.run(Blocks {
                    bounds,
                    place,
                    positions: core::slice::from_ref(&block),
                    extents: Extents::NONE,
                    which: core::iter::once(0),
                    floor: |_| f32::NEG_INFINITY,
                    found: |_, depths: &Depths| {
                        for (depth_m, cells) in depths.touched.depths_m.iter().zip(cells) {
                            let value_m = field.value(FieldKind::Trilinear, cells, Vec3::ZERO);
                            assert!(
                                (depth_m - value_m).abs() < 1e-7,
                                "{cells}: {depth_m} {value_m}"
                            );
                        }
                    },
                });
            }
        }
    }

    #[test]
    fn a_margin_counts_as_much_as_a_larger_radius() {
        let field = plate().field;
        let bounds = &BrickBounds::of(&field).expect("bounds");
        let place = &place(&field);
        let mut random = Random(15);
        let mut n_by_margin = 0;
        for _ in 0..500 {
            let centers = places(&mut random, &field, None);
            let along = |axis: usize| {
                core::array::from_fn(|lane| centers[lane].to_array()[axis] * VOXEL_M as f32)
            };
            let [x, y, z] = [0, 1, 2].map(along);
            // Cells; the sums are exact.
            let above = |radius: f32, margin_cells: f32| {
                let spheres = &Spheres { x, y, z, radius: [radius * VOXEL_M as f32; CHILDREN] };
                SimdLevel::best().run(Above { bounds, place, spheres, floor_m: 0.0, margin_cells })
            };
            assert_eq!(above(1.0, 2.0), above(3.0, 0.0));
            n_by_margin += u32::from(above(1.0, 2.0) != above(1.0, 0.0));
        }
        assert!(n_by_margin > 10, "{n_by_margin}");
    }

    #[test]
    fn a_place_is_finite_where_all_of_it_is() {
        let field = plate().field;
        assert!(place(&field).is_finite());
        let nan = DVec3::new(0.0, f64::NAN, 0.0);
        assert!(!Place::new(&field, Pose::from_translation(nan)).is_finite());
        let turn = DQuat::from_xyzw(0.0, f64::INFINITY, 0.0, 1.0);
        assert!(!Place::new(&field, Pose::new(turn, DVec3::ZERO)).is_finite());
    }
}
