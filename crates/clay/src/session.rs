//! A session as a file: samples, densities, settings and the past of a clay model, to go on another
//! day.
//!
//! The container is [`vps::storage::sections`]: versions, little-endian SI, a checksum for each
//! array. Every moment (now, those that undo goes back to, those that redo goes on to) is one row
//! of `moments`; its samples and densities follow each other in the arrays. What was painted of a
//! material stands in `painted` once for all moments that share it. Fits are not kept: they follow
//! from the samples.

use std::collections::HashMap;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use bytemuck::{Pod, Zeroable};
use glam::DVec3;

use super::clay_model::{ClayModel, ClayModelError, Session, Settings, Snapshot};
use super::dynamics::{Integrator, Material};
use super::material_map::{Layer, MaterialMap};
use super::{Patch, PointSet};
use vps::density::{Lattice, Raster};
use vps::storage::sections::{Key, Reader, Refusal, Writer, key_of};
use vps::storage::whole_file::{Access, write_whole};
use vps::storage::{MappedFile, regular};

/// Counts up when the meaning of a section changes.
const GENERATION: u32 = 2;
/// Distinguishes a session from other files of sections.
const KEY: Key = *b"hapticd, session";
/// Past and future in a file at most, bytes: what is farther from now stays out.
const MOMENTS_BYTES_MAX: usize = 64 << 20;

/// A file that [`ClayModel::save_session`] wrote, as far as its first bytes show.
pub fn is_session(path: &Path) -> bool {
    key_of(path) == Some(KEY)
}

/// Why a session cannot be written or read.
#[derive(Debug, thiserror::Error)]
pub enum SessionFileError {
    /// The file system refuses.
    #[error("cannot {what} {path}: {source}")]
    Io {
        /// `read` or `write`.
        what: &'static str,
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// No session, another version's, or a damaged one.
    #[error("cannot open the session {path}: {reason}")]
    Refused {
        /// The file.
        path: PathBuf,
        /// Why.
        reason: Refusal,
    },
    /// Checksums fit, and yet it makes no clay model.
    #[error("the session {path} makes no clay model: {source}")]
    Model {
        /// The file.
        path: PathBuf,
        /// Why.
        source: ClayModelError,
    },
}

#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct SettingsRecord {
    n_neighbours: u64,
    raster: [u64; 3],
    air_m: f64,
    mass_kg: f64,
    damping_n_s_per_m: f64,
    stiffness_n_per_m: f64,
    creep_s: f64,
    acceleration_max_m_per_s2: f64,
    gap_m: f64,
    /// Of `moments`: how many lie before now; all others but the first come after it.
    n_past: u64,
    is_explicit: u64,
}

#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct MomentRecord {
    n_samples: u64,
    base: LatticeRecord,
    region: LatticeRecord,
    /// As it was chosen; not used where `is_chosen` is 0.
    region_map: [f64; 6],
    is_chosen: u64,
    /// Mass, damping, stiffness: where their values begin in `painted`, one for each node of the
    /// base; [`BARE`] where none were painted.
    painted: [u64; 3],
}

const BARE: u64 = u64::MAX;

/// Mass, damping and stiffness of what was not painted, one row for each moment. Sessions of
/// earlier versions have none: there it never changed.
type ClayRecord = [f64; 3];

fn clay_record(material: &Material) -> ClayRecord {
    [material.mass_kg.into(), material.damping_n_s_per_m.into(), material.stiffness_n_per_m.into()]
}

#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct LatticeRecord {
    origin_map: [f64; 3],
    spacing_m: f64,
    dims: [u64; 3],
}

impl LatticeRecord {
    fn of(lattice: &Lattice) -> Self {
        let Lattice { origin_map, spacing_m, dims } = *lattice;
        Self { origin_map: origin_map.to_array(), spacing_m, dims: dims.map(|n| n as u64) }
    }

    /// `None` for one without nodes or length, or with more nodes than numbers.
    fn lattice(&self) -> Option<(Lattice, usize)> {
        let dims = self.dims.map(|n| usize::try_from(n).unwrap_or(0));
        let n_nodes = dims.iter().try_fold(1_usize, |n, dim| n.checked_mul(*dim))?;
        let lattice = Lattice {
            origin_map: DVec3::from_array(self.origin_map),
            spacing_m: self.spacing_m,
            dims,
        };
        let is_sound = lattice.origin_map.is_finite()
            && lattice.spacing_m > 0.0
            && lattice.spacing_m.is_finite();
        (is_sound && dims.iter().all(|n| *n >= 4)).then_some((lattice, n_nodes))
    }
}

/// Past, now and future as they stand in a file, the nearest to now as far as they fit: now, the
/// past from its begin, what was undone.
fn kept<'m>(
    now: &'m Snapshot,
    past: &'m [Snapshot],
    undone: &'m [Snapshot],
) -> (Vec<&'m Snapshot>, usize) {
    let mut left = MOMENTS_BYTES_MAX;
    let mut newest = |moments: &'m [Snapshot]| {
        let n = moments.iter().rev().take_while(|moment| {
            let fits = moment.n_bytes_in_session() <= left;
            left -= if fits { moment.n_bytes_in_session() } else { 0 };
            fits
        });
        &moments[moments.len() - n.count()..]
    };
    let past = newest(past);
    let undone = newest(undone);
    (core::iter::once(now).chain(past).chain(undone).collect(), past.len())
}

impl ClayModel {
    /// Writes the clay with its past. A stroke under way is not part of it. What was there under
    /// that name stays until all is written.
    ///
    /// # Errors
    /// [`SessionFileError::Io`].
    pub fn save_session(&self, path: &Path) -> Result<(), SessionFileError> {
        let now = self.moment();
        let (past, undone) = self.moments();
        let (moments, n_past) = kept(&now, past, undone);
        let Settings {
            n_neighbours,
            interpolates,
            raster,
            air_m,
            material,
            integrator,
            region_map: _,
        } = self.settings();
        let settings = SettingsRecord {
            n_neighbours: *n_neighbours as u64,
            raster: raster.map(|n| n as u64),
            air_m: *air_m,
            mass_kg: material.mass_kg.into(),
            damping_n_s_per_m: material.damping_n_s_per_m.into(),
            stiffness_n_per_m: material.stiffness_n_per_m.into(),
            creep_s: material.creep_s,
            acceleration_max_m_per_s2: material.acceleration_max_m_per_s2,
            gap_m: self.gap_m(),
            n_past: n_past as u64,
            is_explicit: u64::from(*integrator == Integrator::Explicit),
        };
        let mut layers = Layers::default();
        let records: Vec<MomentRecord> = moments
            .iter()
            .map(|moment| {
                let (low, high) = moment.region_map.unwrap_or_default();
                MomentRecord {
                    n_samples: moment.samples.points().len() as u64,
                    base: LatticeRecord::of(moment.base.lattice()),
                    region: LatticeRecord::of(&moment.region),
                    region_map: [low.x, low.y, low.z, high.x, high.y, high.z],
                    is_chosen: u64::from(moment.region_map.is_some()),
                    painted: moment
                        .material_map
                        .layers()
                        .each_ref()
                        .map(|layer| layers.place(layer.as_ref())),
                }
            })
            .collect();
        let points = || moments.iter().map(|moment| moment.samples.points());
        let positions: Vec<[f64; 3]> =
            points().flat_map(|points| points.positions_map.iter().map(DVec3::to_array)).collect();
        let normals: Vec<[f64; 3]> =
            points().flat_map(|points| points.normals_map.iter().map(DVec3::to_array)).collect();
        let colors: Vec<[u8; 3]> =
            points().flat_map(|points| points.colors.iter().copied()).collect();
        let patches: Vec<Patch> = points()
            .flat_map(|points| (0..points.len() as u32).map(|sample| points.patch(sample)))
            .collect();
        let clays: Vec<ClayRecord> =
            moments.iter().map(|moment| clay_record(&moment.material)).collect();
        let densities: Vec<f32> =
            moments.iter().flat_map(|moment| moment.base.values_m().iter().copied()).collect();

        let mut file = Writer::default();
        file.record("settings", &settings);
        file.array("moments", &records);
        file.array("positions_m", &positions);
        file.array("normals", &normals);
        file.array("colors", &colors);
        // A clay model without sharp edges needs none.
        if patches.iter().any(|patch| *patch != Patch::default()) {
            file.array("patches", &patches);
        }
        // Nor does a field that goes by least squares, as in earlier versions.
        if *interpolates {
            file.array("interpolates", &[1_u8]);
        }
        file.array("densities_m", &densities);
        file.array("painted", &layers.values);
        file.array("clays", &clays);
        write_whole(path, Access::Private, |out| file.write_to(KEY, GENERATION, out))
            .map_err(|source| SessionFileError::Io { what: "write", path: path.to_owned(), source })
    }

    /// Reads a clay model that [`Self::save_session`] wrote, with the settings and the material
    /// that it had.
    ///
    /// # Errors
    /// [`SessionFileError`].
    pub fn load_session(path: &Path) -> Result<Self, SessionFileError> {
        let read = |source| SessionFileError::Io { what: "read", path: path.to_owned(), source };
        let region = MappedFile::read(&regular::open(path).map_err(read)?).map_err(read)?;
        let session = decode(region)
            .map_err(|reason| SessionFileError::Refused { path: path.to_owned(), reason })?;
        Self::resume(session)
            .map_err(|source| SessionFileError::Model { path: path.to_owned(), source })
    }
}

fn decode(region: Arc<MappedFile>) -> Result<Session, Refusal> {
    let file = Reader::new(region, Some(KEY), GENERATION)?;
    let settings: SettingsRecord = file.record("settings")?;
    let records = file.array::<MomentRecord>("moments")?;
    let positions = file.array::<[f64; 3]>("positions_m")?;
    let normals = file.array::<[f64; 3]>("normals")?;
    let colors = file.array::<[u8; 3]>("colors")?;
    let patches = if file.has("patches") {
        file.array::<Patch>("patches")?.to_vec()
    } else {
        vec![Patch::default(); positions.len()]
    };
    let densities = file.array::<f32>("densities_m")?;
    let painted = file.array::<f32>("painted")?;
    let clays = if file.has("clays") { Some(file.array::<ClayRecord>("clays")?) } else { None };
    if clays.as_ref().is_some_and(|clays| clays.len() != records.len()) {
        return Err(Refusal::Damaged("clays"));
    }
    let of_settings = [settings.mass_kg, settings.damping_n_s_per_m, settings.stiffness_n_per_m];
    let clay = |[mass_kg, damping_n_s_per_m, stiffness_n_per_m]: ClayRecord| Material {
        mass_kg: mass_kg as f32,
        damping_n_s_per_m: damping_n_s_per_m as f32,
        stiffness_n_per_m: stiffness_n_per_m as f32,
        creep_s: settings.creep_s,
        acceleration_max_m_per_s2: settings.acceleration_max_m_per_s2,
    };
    let is_clay = |record: &ClayRecord| {
        record.iter().enumerate().all(|(property, value)| is_property(property, *value as f32))
    };
    let mut layers = HashMap::new();
    let mut from = (0, 0);
    let mut moments = Vec::new();
    for (row, record) in records.iter().enumerate() {
        let of_moment = clays.as_ref().map_or(of_settings, |clays| clays[row]);
        if !is_clay(&of_moment) {
            return Err(Refusal::Damaged("clays"));
        }
        let samples = samples_of(record, from.0, (&positions, &normals, &colors, &patches));
        let values_m = densities.get(from.1..).unwrap_or_default();
        let moment = samples.and_then(|points| moment(record, points, values_m));
        let map = map_of(record, &painted, &mut layers).ok_or(Refusal::Damaged("painted"))?;
        let moment = moment.map(|moment| Snapshot {
            material_map: map,
            material: clay(of_moment),
            ..moment
        });
        let moment = moment.ok_or(Refusal::Damaged("moments"))?;
        from = (from.0 + moment.samples.points().len(), from.1 + moment.base.values_m().len());
        moments.push(moment);
    }
    let is_whole = from == (positions.len(), densities.len())
        && [normals.len(), colors.len(), patches.len()] == [positions.len(); 3];
    let n_past = usize::try_from(settings.n_past).unwrap_or(usize::MAX);
    if !is_whole || moments.len() <= n_past {
        return Err(Refusal::Damaged("moments"));
    }
    let undone = moments.split_off(n_past + 1);
    let past = moments.split_off(1);
    let now = moments.pop().ok_or(Refusal::Damaged("moments"))?;

    let gap_m = settings.gap_m;
    let raster = settings.raster.map(|n| usize::try_from(n).unwrap_or(0));
    let is_sound = settings.air_m >= 0.0
        && settings.gap_m > 0.0
        && settings.creep_s > 0.0
        && settings.acceleration_max_m_per_s2 > 0.0
        && is_clay(&of_settings);
    let fits = |moment: &Snapshot| moment.region.dims == raster;
    if !is_sound
        || settings.is_explicit > 1
        || ![&now].into_iter().chain(&past).chain(&undone).all(fits)
    {
        return Err(Refusal::Damaged("settings"));
    }
    let settings = Settings {
        n_neighbours: usize::try_from(settings.n_neighbours).unwrap_or(0),
        interpolates: file.has("interpolates"),
        region_map: now.region_map,
        raster,
        air_m: settings.air_m,
        material: now.material.clone(),
        integrator: if settings.is_explicit == 1 {
            Integrator::Explicit
        } else {
            Integrator::Implicit
        },
    };
    Ok(Session { now, past, undone, settings, gap_m })
}

/// Places, m, normals, colours and patches of all moments.
type SampleArrays<'m> = (&'m [[f64; 3]], &'m [[f64; 3]], &'m [[u8; 3]], &'m [Patch]);

/// The samples of one row, from where they begin; `None` where they are not all there.
fn samples_of(
    record: &MomentRecord,
    from: usize,
    (positions, normals, colors, patches): SampleArrays,
) -> Option<PointSet> {
    let all = from..from.checked_add(usize::try_from(record.n_samples).ok()?)?;
    let vectors = |numbers: &[[f64; 3]]| {
        Some(numbers.get(all.clone())?.iter().copied().map(DVec3::from_array).collect())
    };
    Some(PointSet {
        positions_map: vectors(positions)?,
        normals_map: vectors(normals)?,
        colors: colors.get(all.clone())?.to_vec(),
        patches: patches.get(all)?.to_vec(),
    })
}

/// One row, with its samples, and densities from where they begin; `None` where they are not all
/// there, or fit nothing.
fn moment(record: &MomentRecord, points: PointSet, values_m: &[f32]) -> Option<Snapshot> {
    let (base, n_nodes) = record.base.lattice()?;
    let (region, _) = record.region.lattice()?;
    let values_m = values_m
        .get(..n_nodes)
        .filter(|values_m| values_m.iter().all(|value_m| value_m.is_finite()))?;
    let mut raster = Raster::uniform(base, 0.0);
    raster.values_m_mut().copy_from_slice(values_m);
    let [low_x, low_y, low_z, high_x, high_y, high_z] = record.region_map;
    let region_map = (record.is_chosen != 0)
        .then(|| (DVec3::new(low_x, low_y, low_z), DVec3::new(high_x, high_y, high_z)));
    let is_region = region_map
        .is_none_or(|(low, high)| low.is_finite() && high.is_finite() && low.cmplt(high).all());
    let moment = Snapshot::new(points, raster, MaterialMap::default(), region, region_map)?;
    is_region.then_some(moment)
}

/// Values that moments share, once each.
#[derive(Default)]
struct Layers<'m> {
    values: Vec<f32>,
    /// Where each begins.
    places: Vec<(&'m Layer, u64)>,
}

impl<'m> Layers<'m> {
    fn place(&mut self, layer: Option<&'m Layer>) -> u64 {
        let Some(layer) = layer else { return BARE };
        if let Some((_, place)) = self.places.iter().find(|(known, _)| Arc::ptr_eq(known, layer)) {
            return *place;
        }
        let place = self.values.len() as u64;
        self.values.extend_from_slice(layer);
        self.places.push((layer, place));
        place
    }
}

/// What was painted before a moment; `None` where it is not all there, or makes no material.
/// Moments that share values share them again.
fn map_of(
    record: &MomentRecord,
    painted: &[f32],
    layers: &mut HashMap<(u64, usize), Layer>,
) -> Option<MaterialMap> {
    let (_, n_nodes) = record.base.lattice()?;
    let mut map = [None, None, None];
    for (property, (layer, place)) in map.iter_mut().zip(record.painted).enumerate() {
        if place == BARE {
            continue;
        }
        let from = usize::try_from(place).ok()?;
        let values = painted.get(from..from.checked_add(n_nodes)?)?;
        let is_sound = |value: &f32| value.is_nan() || is_property(property, *value);
        let shared = match layers.get(&(place, n_nodes)) {
            Some(shared) => shared.clone(),
            None => layers.entry((place, n_nodes)).or_insert_with(|| Arc::from(values)).clone(),
        };
        *layer = values.iter().all(is_sound).then_some(shared);
        layer.as_ref()?;
    }
    Some(MaterialMap::new(map))
}

/// Without damping a material still moves; without mass or springs it does not.
fn is_property(property: usize, value: f32) -> bool {
    const DAMPING: usize = 1;
    value.is_finite() && (value > 0.0 || value == 0.0 && property == DAMPING)
}

#[cfg(test)]
mod tests;
