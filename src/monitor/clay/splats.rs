//! Samples of the clay for display: small, thinned out where there are too many, made once for all
//! clients.

use core::time::Duration;
use std::collections::HashSet;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use axum::body::Bytes;
use glam::DVec3;

use super::super::worker::Worker;
use crate::daemon::sculpting::DutyCycle;
use clay::PointSet;
use clay::engine::ClayView;

/// Version of the layout.
const FORMAT: u32 = 1;
/// Bytes before the first sample, and of each.
const HEAD_BYTES: usize = 32;
const SAMPLE_BYTES: usize = 20;
/// Samples on a page: 2 MB.
const MOST_SAMPLES: usize = 100_000;
/// The spacing around each sample is reported in units of which the mean one has this many, or up
/// to twice as many.
const MEAN_PARTS: f64 = 32.0;
/// By how much cells grow until few enough samples are left.
const GROWTH: f64 = 1.15;

/// What making samples ready may take of the time of its thread.
const SHARE: f64 = 0.2;
/// Each client gets at most so much of a clay model that changes all the time.
const MOST_BYTES_PER_S: f64 = 10e6;

/// The newest samples that a client asked for. During a stroke they are as new as making and
/// sending them is cheap: those of a large model are older than its newest view.
#[derive(Clone, Debug)]
pub(in crate::monitor) struct Splats {
    made: Arc<Mutex<Made>>,
    began: Instant,
}

#[derive(Debug)]
struct Made {
    newest: Option<(u64, Bytes)>,
    duty: DutyCycle,
}

impl Default for Splats {
    fn default() -> Self {
        Self { made: Arc::new(Mutex::new(Made::default())), began: Instant::now() }
    }
}

impl Default for Made {
    fn default() -> Self {
        Self { newest: None, duty: DutyCycle::new(SHARE, Duration::ZERO) }
    }
}

impl Made {
    /// What will do for this view at this time; `None`: it is to be made. Without a stroke only the
    /// view's own samples do: a client that has read that a stroke has ended, or was undone, reads
    /// what came of it.
    fn ready(&self, view: &ClayView, now: Duration) -> Option<(u64, Bytes)> {
        self.newest
            .clone()
            .filter(|(known, _)| *known == view.version || view.is_stroke && !self.duty.is_due(now))
    }

    /// It took from one time to another to make this.
    fn keep(&mut self, version: u64, bytes: Bytes, begin: Duration, end: Duration) {
        self.duty.worked(begin, end);
        self.duty
            .rest_until(begin + Duration::from_secs_f64(bytes.len() as f64 / MOST_BYTES_PER_S));
        self.newest = Some((version, bytes));
    }
}

impl Splats {
    /// The version of samples, and them as bytes: those of a view, or older ones where it is in a
    /// stroke and new ones would be too soon. Made on the worker's thread. `None`: that came to
    /// grief.
    pub(in crate::monitor) async fn get(
        &self,
        worker: &Worker,
        view: Arc<ClayView>,
    ) -> Option<(u64, Bytes)> {
        if let Some(ready) = self.made().ready(&view, self.began.elapsed()) {
            return Some(ready);
        }
        let splats = self.clone();
        worker
            .run(move || {
                let begin = splats.began.elapsed();
                // Another client may have asked meanwhile.
                if let Some(ready) = splats.made().ready(&view, begin) {
                    return ready;
                }
                let bytes = Bytes::from(encoded(&view, MOST_SAMPLES));
                splats.made().keep(view.version, bytes.clone(), begin, splats.began.elapsed());
                (view.version, bytes)
            })
            .await
    }

    fn made(&self) -> MutexGuard<'_, Made> {
        self.made.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// `docs/reference/api.md` is the description. O(samples).
fn encoded(view: &ClayView, most: usize) -> Vec<u8> {
    let points = &*view.points;
    let kept = thinned(points, view.spacing_m, most);
    let n_kept = kept.as_ref().map_or(points.len(), Vec::len);
    let spacing_m = view.spacing_m * (points.len() as f64 / n_kept.max(1) as f64).sqrt();
    // A power of two: where the mean changes a little, no sample is reported anew.
    let unit_m =
        if spacing_m.is_normal() { spacing_m.log2().floor().exp2() / MEAN_PARTS } else { 0.0 };
    let mut bytes = Vec::with_capacity(HEAD_BYTES + SAMPLE_BYTES * n_kept);
    bytes.extend(b"HCLY");
    bytes.extend(FORMAT.to_le_bytes());
    bytes.extend(view.version.to_le_bytes());
    bytes.extend((n_kept as u32).to_le_bytes());
    bytes.extend((points.len() as u32).to_le_bytes());
    bytes.extend((spacing_m as f32).to_le_bytes());
    bytes.extend((unit_m as f32).to_le_bytes());
    // What is thinned out is even; what a stroke moves may be farther apart than it was.
    let least = if kept.is_some() || view.is_stroke { (spacing_m / unit_m).round() } else { 1.0 };
    let parts = |sample: usize| {
        let parts =
            view.spacings_m.get(sample).map_or(spacing_m, |spacing_m| f64::from(*spacing_m))
                / unit_m;
        if parts.is_finite() { parts.round().clamp(least, 255.0) as u8 } else { 0 }
    };
    let mut write = |sample: usize| {
        let (Some(position), Some(normal), Some(color)) = (
            points.positions_map.get(sample),
            points.normals_map.get(sample),
            points.colors.get(sample),
        ) else {
            return;
        };
        for coordinate in position.as_vec3().to_array() {
            bytes.extend(coordinate.to_le_bytes());
        }
        bytes.extend((*normal * 127.0).round().to_array().map(|part| part as i8 as u8));
        bytes.push(parts(sample));
        bytes.extend(color);
        bytes.push(0);
    };
    match kept {
        None => (0..points.len()).for_each(&mut write),
        Some(kept) => kept.into_iter().for_each(&mut write),
    }
    bytes
}

/// The first sample of each cell of a lattice that leaves at most `most` of them; `None`: all.
fn thinned(points: &PointSet, spacing_m: f64, most: usize) -> Option<Vec<usize>> {
    if points.len() <= most {
        return None;
    }
    let evenly = || (0..most).map(|n| n * points.len() / most).collect();
    let mut cell_m = spacing_m * (points.len() as f64 / most as f64).sqrt();
    loop {
        if !cell_m.is_normal() {
            return Some(evenly());
        }
        let cell =
            |at: &DVec3| (*at / cell_m).floor().to_array().map(|coordinate| coordinate as i64);
        let mut seen = HashSet::with_capacity(most);
        let kept: Vec<_> = (0..)
            .zip(&points.positions_map)
            .filter(|(_, at)| seen.insert(cell(at)))
            .map(|(n, _)| n)
            .collect();
        if kept.len() <= most {
            return Some(kept);
        }
        cell_m *= GROWTH;
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::view_of;
    use super::*;

    fn ball(n: usize) -> PointSet {
        let mut points = PointSet::default();
        for i in 0..n {
            let z = 1.0 - (2.0 * i as f64 + 1.0) / n as f64;
            let turn = i as f64 * 2.399_963_229_728_653;
            let normal =
                DVec3::new((1.0 - z * z).sqrt() * turn.cos(), (1.0 - z * z).sqrt() * turn.sin(), z);
            points.push(normal * 0.02, normal, [(i % 256) as u8, 7, 255]);
        }
        points
    }

    fn word(bytes: &[u8], at: usize) -> u32 {
        u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap())
    }

    #[test]
    fn every_sample_is_reported_as_it_is() {
        let view = view_of(ball(500), 3);
        let bytes = encoded(&view, 500);
        assert_eq!(bytes.len(), HEAD_BYTES + 500 * SAMPLE_BYTES);
        assert_eq!(
            (&bytes[..4], word(&bytes, 4), word(&bytes, 8), word(&bytes, 12)),
            (&b"HCLY"[..], 1, 3, 0)
        );
        assert_eq!((word(&bytes, 16), word(&bytes, 20)), (500, 500));
        assert_eq!(f32::from_bits(word(&bytes, 24)), view.spacing_m as f32);
        for (n, at) in (HEAD_BYTES..bytes.len()).step_by(SAMPLE_BYTES).enumerate() {
            let position = DVec3::from(
                [0, 4, 8].map(|axis| f64::from(f32::from_bits(word(&bytes, at + axis)))),
            );
            assert!(position.distance(view.points.positions_map[n]) < 1e-8, "{n}");
            let normal =
                DVec3::from([12, 13, 14].map(|axis| f64::from(bytes[at + axis] as i8) / 127.0));
            assert!(normal.distance(view.points.normals_map[n]) < 0.01, "{n}: {normal}");
            assert_eq!(bytes[at + 16..at + 19], [(n % 256) as u8, 7, 255], "{n}");
        }
    }

    #[test]
    fn the_spacing_around_each_sample_is_reported_in_a_unit_that_rarely_changes() {
        let mut view = view_of(ball(6), 1);
        view.spacings_m = [1e-3, 0.25e-3, 2e-3, 9e-3, 0.0].into();
        let reported = |view: &ClayView| {
            (0..6).map(|n| encoded(view, 6)[HEAD_BYTES + n * SAMPLE_BYTES + 15]).collect::<Vec<_>>()
        };
        let unit_m = |view: &ClayView| f32::from_bits(word(&encoded(view, 6), 28));
        // 1 mm is 32.768 of 2⁻¹⁵ m; the last sample has no spacing of its own.
        assert_eq!(
            (unit_m(&view), reported(&view)),
            (2.0_f32.powi(-15), vec![33, 8, 66, 255, 1, 33])
        );
        view.spacing_m = 1.2e-3;
        assert_eq!(
            (unit_m(&view), reported(&view)[..5].to_vec()),
            (2.0_f32.powi(-15), vec![33, 8, 66, 255, 1])
        );
        view.is_stroke = true;
        assert_eq!(reported(&view), [39, 39, 66, 255, 39, 39]);
    }

    #[test]
    fn too_many_samples_are_thinned_out_all_over_and_their_discs_grow() {
        let mut view = view_of(ball(40_000), 1);
        view.spacing_m = (4.0 * core::f64::consts::PI * 0.02 * 0.02 / 40_000.0_f64).sqrt();
        let bytes = encoded(&view, 1000);
        let n = word(&bytes, 16) as usize;
        assert!((500..=1000).contains(&n), "{n}");
        assert_eq!((word(&bytes, 20), bytes.len()), (40_000, HEAD_BYTES + n * SAMPLE_BYTES));
        let grown = f64::from(f32::from_bits(word(&bytes, 24))) / view.spacing_m;
        assert!((grown - (40_000.0 / n as f64).sqrt()).abs() < 1e-3, "{grown}");
        // Nowhere a hole wider than the discs hide.
        let kept: Vec<_> = (HEAD_BYTES..bytes.len())
            .step_by(SAMPLE_BYTES)
            .map(|at| {
                DVec3::from(
                    [0, 4, 8].map(|axis| f64::from(f32::from_bits(word(&bytes, at + axis)))),
                )
            })
            .collect();
        let reach_m = 2.0 * grown * view.spacing_m;
        for at in view.points.positions_map.iter().step_by(37) {
            assert!(kept.iter().any(|other| other.distance(*at) < reach_m), "{at}");
        }
    }

    #[test]
    fn samples_that_change_all_the_time_are_made_as_often_as_that_is_cheap() {
        let ms = Duration::from_millis;
        let mut view = view_of(ball(6), 0);
        view.is_stroke = true;
        let mut version = |made: &Made, newest: u64, now_ms: u64| {
            view.version = newest;
            made.ready(&view, ms(now_ms)).map(|(version, _)| version)
        };
        let mut made = Made::default();
        assert_eq!(version(&made, 1, 0), None, "there is nothing yet");
        // Ten milliseconds of work, a fifth of the time: nothing new before 50.
        made.keep(1, Bytes::new(), ms(0), ms(10));
        assert_eq!([49, 50].map(|now_ms| version(&made, 7, now_ms)), [Some(1), None]);
        assert_eq!(version(&made, 1, 9999), Some(1), "nothing has changed");
        // Two megabytes, and no work to speak of: five times a second.
        made.keep(7, Bytes::from(vec![0; 2_000_000]), ms(50), ms(51));
        assert_eq!([249, 250].map(|now_ms| version(&made, 8, now_ms)), [Some(7), None]);
        // A stroke that has ended is seen at once.
        view.is_stroke = false;
        view.version = 9;
        assert!(made.ready(&view, ms(60)).is_none());
    }

    #[test]
    fn samples_in_one_place_and_none_are_no_trouble() {
        let mut points = PointSet::default();
        (0..100).for_each(|_| points.push(DVec3::ZERO, DVec3::Z, [0; 3]));
        let mut view = view_of(points, 1);
        view.spacing_m = 0.0;
        assert_eq!(word(&encoded(&view, 10), 16), 10);
        assert_eq!(encoded(&view_of(PointSet::default(), 1), 10).len(), HEAD_BYTES);
    }
}
