//! Flat traversal: every point, every tick. The scalar specification that faster siblings are tested against.

use glam::{Mat3, Vec3};

use crate::pointshell::shell::{LANES, Lanes3, Shell};
use crate::spatial::Pose;
use crate::voxmap::field::{Field, FieldKind};

/// One point in contact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contact {
    /// Number of the point in the shell.
    pub point_idx: u32,
    /// V at the point, m, greater than 0.
    pub depth_m: f32,
    /// Point about the centre of mass, tool axes, m.
    pub arm_body: Vec3,
    /// Unit direction that pushes the tool out, tool axes: the point's normal, or −grad V of a thin skin.
    pub normal_body: Vec3,
}

/// Calls `touch` for every point with V > 0, in the order of the points; returns the largest V, m.
///
/// `map_from_body`: from tool axes about the centre of mass to the obstacle's map frame. A pose that is not finite touches
/// nothing. RT: safe; O(points), one field look-up each.
#[inline]
pub fn visit(field: &Field, kind: FieldKind, shell: &Shell, map_from_body: Pose, mut touch: impl FnMut(&Contact)) -> f32 {
    let per_metre = 1.0 / f64::from(field.voxel_size_m());
    let map_axes: Mat3 = map_from_body.rotation_matrix().as_mat3();
    let cells_axes: Mat3 = (map_from_body.rotation_matrix() * per_metre).as_mat3();
    // The subtraction in f64: what is left is small, whatever the origin.
    let cells_origin = ((map_from_body.translation - field.origin_map().as_dvec3()) * per_metre).as_vec3();
    let mut max_value = f32::NEG_INFINITY;
    let mut point_idx = 0;
    for (positions, normals) in shell.blocks() {
        // The transform of a whole block first: it vectorises, the look-ups do not.
        let cells = transformed(positions, cells_axes, cells_origin);
        for (lane, cells) in cells.into_iter().enumerate() {
            if point_idx as usize >= shell.len() {
                return max_value;
            }
            let normal_map = if kind == FieldKind::Layers { map_axes * normals.get(lane) } else { Vec3::ZERO };
            let depth_m = field.value(kind, cells, normal_map);
            max_value = max_value.max(depth_m);
            if depth_m > 0.0 {
                let normal_body =
                    if field.is_thin() { out_of_skin(field, cells, map_axes, normals.get(lane)) } else { normals.get(lane) };
                touch(&Contact { point_idx, depth_m, arm_body: positions.get(lane), normal_body });
            }
            point_idx += 1;
        }
    }
    max_value
}

/// `axes · p + origin` for every lane of a block.
#[inline]
fn transformed(positions: &Lanes3, axes: Mat3, origin: Vec3) -> [Vec3; LANES] {
    let Lanes3 { x, y, z } = positions;
    let mut cells = [Vec3::ZERO; LANES];
    for (((cells, x), y), z) in cells.iter_mut().zip(x.0).zip(y.0).zip(z.0) {
        *cells = axes.x_axis * x + axes.y_axis * y + axes.z_axis * z + origin;
    }
    cells
}

/// −grad V of a thin skin in tool axes; on its mid-surface, where the gradient vanishes, the point's own normal.
fn out_of_skin(field: &Field, cells: Vec3, map_axes: Mat3, normal_body: Vec3) -> Vec3 {
    (map_axes.transpose() * -field.gradient(cells)).try_normalize().unwrap_or(normal_body)
}
