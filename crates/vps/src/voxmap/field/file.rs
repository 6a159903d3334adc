//! A field to and from a file of the bake cache.

use bytemuck::{Pod, Zeroable};
use glam::Vec3;

use super::creases::Creases;
use super::{DEEP_INSIDE, FAR_OUTSIDE, Field};
use crate::storage::sections::{Reader, Refusal, Writer};

/// Everything of a field but its arrays.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct FieldHead {
    origin: [f32; 3],
    voxel_size_m: f32,
    brick_dims: [i32; 3],
    band_m: f32,
    skin_m: f32,
}

impl Field {
    /// What [`Self::store`] needs beside the field itself.
    pub fn head(&self) -> FieldHead {
        let Self { origin, voxel_size_m, brick_dims, band_m, skin_m, .. } = *self;
        FieldHead { origin: origin.to_array(), voxel_size_m, brick_dims, band_m, skin_m }
    }

    /// Adds the field to a file.
    pub fn store<'a>(&'a self, head: &'a FieldHead, to: &mut Writer<'a>) {
        let Self {
            origin: _,
            voxel_size_m: _,
            brick_dims: _,
            band_m: _,
            skin_m: _,
            top,
            samples_m,
            moves,
            layers,
            gradients,
            creases: Creases { of_brick, cells, sets, patches },
        } = self;
        to.record("field", head);
        to.array("field top", top);
        to.array("field samples", samples_m);
        to.array("field moves", moves);
        to.array("field layers", layers);
        to.array("field gradients", gradients);
        to.array("crease bricks", of_brick);
        to.array("crease cells", cells);
        to.array("crease planes", sets);
        to.array("crease patches", patches);
    }

    /// True when a file holds a field.
    pub fn is_in(from: &Reader) -> bool {
        from.has("field")
    }

    /// Takes the field from a file. Every index in it is checked, and every plane; samples, moves, layers
    /// and gradients may be any numbers.
    ///
    /// # Errors
    /// A section that is missing or damaged, or arrays that do not belong together.
    pub fn load(from: &Reader) -> Result<Self, Refusal> {
        let FieldHead { origin, voxel_size_m, brick_dims, band_m, skin_m } =
            from.record("field")?;
        let field = Self {
            origin: Vec3::from_array(origin),
            voxel_size_m,
            brick_dims,
            top: from.array("field top")?,
            samples_m: from.array("field samples")?,
            moves: from.array("field moves")?,
            layers: from.array("field layers")?,
            gradients: from.array("field gradients")?,
            creases: Creases {
                of_brick: from.array("crease bricks")?,
                cells: from.array("crease cells")?,
                sets: from.array("crease planes")?,
                patches: from.array("crease patches")?,
            },
            band_m,
            skin_m,
        };
        if field.is_consistent() { Ok(field) } else { Err(Refusal::Damaged("field")) }
    }

    fn is_consistent(&self) -> bool {
        let Self {
            origin,
            voxel_size_m,
            brick_dims,
            top,
            samples_m,
            moves,
            layers,
            gradients,
            creases,
            band_m,
            skin_m,
        } = self;
        let n_bricks = brick_dims.iter().try_fold(1_usize, |n, dim| {
            n.checked_mul(usize::try_from(*dim).ok().filter(|dim| *dim > 0)?)
        });
        let n_slots = samples_m.len();
        let positive = |length_m: f32| length_m > 0.0 && length_m.is_finite();
        origin.is_finite()
            && positive(*voxel_size_m)
            && positive(*band_m)
            && (*skin_m == 0.0 || positive(*skin_m))
            && n_bricks == Some(top.len())
            && layers.len() == n_slots
            && (moves.is_empty() || moves.len() == n_slots)
            && (gradients.is_empty() || gradients.len() == n_slots)
            && creases.is_consistent(*brick_dims)
            && top.iter().all(|slot| {
                matches!(*slot, FAR_OUTSIDE | DEEP_INSIDE) || (*slot as usize) < n_slots
            })
    }
}
