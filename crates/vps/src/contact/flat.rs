//! Flat traversal: every point, every tick. The scalar specification that faster siblings are
//! tested against.

use glam::{Mat3, Vec3};

use super::contact_block::{Contact, ContactBlock};
use super::kernel::Place;
use crate::pointshell::shell::{LANES, Lanes3, Shell};
use crate::spatial::Pose;
use crate::voxmap::field::{Field, FieldKind};

/// Calls `touch` for every point with V > 0, in the order of the points; returns the largest V, m.
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
        touched.contacts(field, shell, map_from_body, &mut touch)
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
    let mut max_value = f32::NEG_INFINITY;
    let mut n_left = shell.len();
    for (block, (positions, normals)) in shell.blocks().enumerate() {
        // The transform of a whole block first: it vectorises, the look-ups do not.
        let Lanes3 { x, y, z } = positions;
        let mut cells = [Vec3::ZERO; LANES];
        for (((cells, x), y), z) in cells.iter_mut().zip(x.0).zip(y.0).zip(z.0) {
            *cells = place.cells(Vec3::new(x, y, z));
        }
        let mut touched = ContactBlock {
            block: block as u32,
            lanes: 0,
            weight: 1.0,
            depths_m: [f32::NEG_INFINITY; LANES],
            gradients: Lanes3::ZERO,
        };
        for (lane, (cells, depth)) in
            cells.into_iter().zip(&mut touched.depths_m).enumerate().take(n_left)
        {
            let normal_map =
                if kind == FieldKind::Layers { map_axes * normals.get(lane) } else { Vec3::ZERO };
            let depth_m = field.value(kind, cells, normal_map);
            max_value = max_value.max(depth_m);
            *depth = depth_m;
            if depth_m > 0.0 {
                touched.lanes |= 1 << lane;
                if kind == FieldKind::Trilinear {
                    touched.gradients.set(lane, place.gradient(field.slopes(cells)));
                }
            }
        }
        if touched.lanes != 0 {
            touch(&touched);
        }
        n_left = n_left.saturating_sub(LANES);
    }
    max_value
}
