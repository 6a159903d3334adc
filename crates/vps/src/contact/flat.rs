//! Flat traversal: every point, every tick. The scalar specification that faster siblings are
//! tested against.

use glam::{Mat3, Vec3};

use super::clip::{CreasesAt, OverPlanes};
use super::contact_block::{Contact, ContactBlock};
use super::immersion::{Extents, FacetRange, limit_m, slack_m};
use super::kernel::Place;
use crate::pointshell::shell::{LANES, Lanes3, Shell};
use crate::spatial::Pose;
use crate::voxmap::field::{Field, FieldKind};

/// Calls `touch` for every facet that is immersed, be it in part, and every point with V > 0, in the
/// order of the points; returns the largest V, m.
///
/// `map_from_body`: from tool axes about the centre of mass to the obstacle's map frame. A pose
/// that is not finite touches nothing. RT: safe; O(points), one field look-up each.
#[inline]
pub fn visit(
    field: &Field,
    kind: FieldKind,
    shell: &Shell,
    map_from_body: Pose,
    mut touch: impl FnMut(&Contact),
) -> f32 {
    blocks(field, kind, shell, map_from_body, |touched| {
        touched.contacts(field, shell, map_from_body, &mut touch);
    })
}

/// The same, block by block.
#[inline]
pub(super) fn blocks(
    field: &Field,
    kind: FieldKind,
    shell: &Shell,
    map_from_body: Pose,
    mut touch: impl FnMut(&ContactBlock),
) -> f32 {
    let map_axes: Mat3 = map_from_body.rotation_matrix().as_mat3();
    let place = Place::new(field, map_from_body);
    let extents = Extents::of(shell, limit_m(field, kind), slack_m(field, kind));
    let mut over = OverPlanes::NONE;
    let creases = (kind == FieldKind::Trilinear).then(|| CreasesAt::new(field, &place));
    let mut max_value = f32::NEG_INFINITY;
    let mut n_left = shell.len();
    for (block, (positions, normals)) in shell.blocks().enumerate() {
        // The transform of a whole block first: it vectorises, the look-ups do not.
        let Lanes3 { x, y, z } = positions;
        let mut cells = [Vec3::ZERO; LANES];
        for (((cells, x), y), z) in cells.iter_mut().zip(x.0).zip(y.0).zip(z.0) {
            *cells = place.cells(Vec3::new(x, y, z));
        }
        let mut touched =
            ContactBlock { block: block as u32, limit_m: extents.limit_m(), ..ContactBlock::NONE };
        let mut depths_m = [f32::NEG_INFINITY; LANES];
        let reach_m = extents.reach_m(block);
        let whole_reach_m = extents.whole_reach_m(block);
        let half_axes = extents.half_axes(block);
        for (lane, (cells, depth)) in cells.into_iter().zip(&mut depths_m).enumerate().take(n_left)
        {
            let normal = normals.get(lane);
            let normal_map = if kind == FieldKind::Layers { map_axes * normal } else { Vec3::ZERO };
            let depth_m = field.value(kind, cells, normal_map);
            *depth = depth_m;
            let half_axes = half_axes.map(|[a, b]| [a.get(lane), b.get(lane)]);
            let met = creases
                .filter(|_| depth_m > -whole_reach_m && extents.meets_planes(block))
                .zip(half_axes)
                .and_then(|(creases, half_axes)| {
                    creases.meet(positions.get(lane), half_axes, extents.limit_m(), &mut over)
                });
            if let Some(met) = met {
                *depth = if met.touches { met.depth_m } else { depth_m.min(0.0) };
                if met.touches {
                    touched.lanes |= 1 << lane;
                    touched.clipped |= u16::from(met.is_clipped) << lane;
                    touched.gradients.set(lane, met.gradient);
                }
                continue;
            }
            if depth_m > -reach_m {
                // With other look-ups it says which way is out where no normal does, and no more.
                let gradient =
                    if kind == FieldKind::Trilinear || field.is_thin() || normal == Vec3::ZERO {
                        place.gradient(field.slopes(cells))
                    } else {
                        Vec3::ZERO
                    };
                let range = FacetRange::of(half_axes, gradient, extents.limit_m());
                let mut shortfalls_m = [0.0; 2];
                if range.is_near(depth_m) {
                    let shortfall_m = |sign: f32| {
                        let end = place.cells(positions.get(lane) + range.way * sign);
                        range.shortfall_m(depth_m, (sign, field.value(kind, end, normal_map)))
                    };
                    // The outer half of a facet whose centroid is outside does not count.
                    let outer_m = if depth_m > 0.0 { shortfall_m(-1.0) } else { 0.0 };
                    shortfalls_m = [outer_m, shortfall_m(1.0)];
                }
                if range.with_shortfalls(shortfalls_m).touches(depth_m) {
                    touched.lanes |= 1 << lane;
                    touched.gradients.set(lane, gradient);
                    touched.set_shortfalls(lane, shortfalls_m);
                }
            }
        }
        max_value = depths_m.into_iter().fold(max_value, f32::max);
        touched.depths_m = depths_m;
        if touched.lanes != 0 {
            touch(&touched);
        }
        n_left = n_left.saturating_sub(LANES);
    }
    max_value
}
