//! Mass properties to and from a file of baked arrays.

use bytemuck::{Pod, Zeroable};
use glam::{DMat3, DVec3};

use super::MassProperties;
use crate::storage::sections::{Reader, Refusal, Writer};

/// The section of a file.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct MassRecord {
    volume_m3: f64,
    center_m: [f64; 3],
    inertia_per_mass: [f64; 9],
    from_surface: u64,
}

#[doc(hidden)]
impl MassProperties {
    /// What [`Self::store`] writes.
    pub fn record(&self) -> MassRecord {
        let Self { volume_m3, center_m, inertia_per_mass, from_surface } = *self;
        MassRecord {
            volume_m3,
            center_m: center_m.to_array(),
            inertia_per_mass: inertia_per_mass.to_cols_array(),
            from_surface: from_surface.into(),
        }
    }

    /// Adds the section to a file.
    pub fn store<'a>(record: &'a MassRecord, to: &mut Writer<'a>) {
        to.record("mass", record);
    }

    /// True when a file holds mass properties.
    pub fn is_in(from: &Reader) -> bool {
        from.has("mass")
    }

    /// Takes mass properties from a file.
    ///
    /// # Errors
    /// A section that is missing or damaged, or numbers that no part has.
    pub fn load(from: &Reader) -> Result<Self, Refusal> {
        let record: MassRecord = from.record("mass")?;
        let mass = Self {
            volume_m3: record.volume_m3,
            center_m: DVec3::from_array(record.center_m),
            inertia_per_mass: DMat3::from_cols_array(&record.inertia_per_mass),
            from_surface: record.from_surface == 1,
        };
        let sound = mass.volume_m3 >= 0.0
            && mass.volume_m3.is_finite()
            && mass.center_m.is_finite()
            && mass.inertia_per_mass.is_finite()
            && record.from_surface <= 1;
        if sound { Ok(mass) } else { Err(Refusal::Damaged("mass")) }
    }
}
