//! What a hand feels as roughness: the part of a force above 10 Hz, and how late a force follows.

use core::f64::consts::{PI, SQRT_2, TAU};

use glam::DVec3;

/// Below this a hand moves, above it the force is rough, Hz.
pub const HIGH_PASS_HZ: f64 = 10.0;

/// Shortest signal that says something about what is above [`HIGH_PASS_HZ`]: two of its periods, s.
pub(super) const SHORTEST_S: f64 = 2.0 / HIGH_PASS_HZ;

/// RMS length of what a signal, sampled at `rate_hz`, does above [`HIGH_PASS_HZ`]; `None` when it
/// is too short to tell.
///
/// # Source
/// Second-order Butterworth high-pass by the bilinear transform, run forwards and backwards so that
/// nothing is delayed: half the amplitude at 10 Hz, a ten-thousandth at 1 Hz.
pub fn ripple_rms(signal: &[DVec3], rate_hz: f64) -> Option<f64> {
    ripple_rms_above(signal, rate_hz, HIGH_PASS_HZ)
}

/// The same above another frequency, no lower than [`HIGH_PASS_HZ`].
pub(super) fn ripple_rms_above(signal: &[DVec3], rate_hz: f64, above_hz: f64) -> Option<f64> {
    ((signal.len() as f64) >= SHORTEST_S * rate_hz && signal.len() > 2)
        .then(|| rms(&above(signal, rate_hz, above_hz)))
}

fn rms(signal: &[DVec3]) -> f64 {
    (signal.iter().map(|value| value.length_squared()).sum::<f64>() / signal.len() as f64).sqrt()
}

/// The signal without what is below a frequency.
fn above(signal: &[DVec3], rate_hz: f64, above_hz: f64) -> Vec<DVec3> {
    let (Some(&first), Some(&last)) = (signal.first(), signal.last()) else { return Vec::new() };
    // Turned about its ends, the signal goes on without a step or a kink: the filter starts at
    // rest.
    let n_ends = ((4.0 * SHORTEST_S * rate_hz) as usize).min(signal.len() - 1);
    let before = signal[1..=n_ends].iter().rev().map(|value| 2.0 * first - *value);
    let behind = signal[signal.len() - 1 - n_ends..signal.len() - 1]
        .iter()
        .rev()
        .map(|value| 2.0 * last - *value);
    let mut extended: Vec<DVec3> = before.chain(signal.iter().copied()).chain(behind).collect();
    for _ in 0..2 {
        high_pass(&mut extended, rate_hz, above_hz);
        extended.reverse();
    }
    extended.drain(..n_ends);
    extended.truncate(signal.len());
    extended
}

fn high_pass(signal: &mut [DVec3], rate_hz: f64, above_hz: f64) {
    let k = (PI * above_hz / rate_hz).tan();
    let gain = 1.0 / (1.0 + SQRT_2 * k + k * k);
    let a1 = 2.0 * (k * k - 1.0) * gain;
    let a2 = (1.0 - SQRT_2 * k + k * k) * gain;
    let Some(&first) = signal.first() else { return };
    let mut x1 = first;
    let mut x2 = first;
    let mut y1 = DVec3::ZERO;
    let mut y2 = DVec3::ZERO;
    for value in signal {
        let x = *value;
        let y = (x - 2.0 * x1 + x2) * gain - y1 * a1 - y2 * a2;
        (x1, x2, y1, y2) = (x, x1, y, y1);
        *value = y;
    }
}

/// How long `output` lags behind `input` where both swing at `frequency_hz`, s; negative when it
/// leads. `None` where one does not.
///
/// The phases of the least-squares sines; exact for whole periods.
pub fn lag_s(input: &[f64], output: &[f64], frequency_hz: f64, rate_hz: f64) -> Option<f64> {
    let phasor = |signal: &[f64]| {
        let mean = signal.iter().sum::<f64>() / signal.len() as f64;
        signal.iter().enumerate().fold((0.0, 0.0), |(re, im), (n, value)| {
            let (sin, cos) = (TAU * frequency_hz * n as f64 / rate_hz).sin_cos();
            (re + (value - mean) * cos, im - (value - mean) * sin)
        })
    };
    let ((re_in, im_in), (re_out, im_out)) = (phasor(input), phasor(output));
    if re_in.hypot(im_in) < 1e-12 || re_out.hypot(im_out) < 1e-12 {
        return None;
    }
    // The angle of input over output.
    let lag = (im_in * re_out - re_in * im_out).atan2(re_in * re_out + im_in * im_out);
    Some(lag / (TAU * frequency_hz))
}

#[cfg(test)]
mod tests {
    use super::*;

    const RATE_HZ: f64 = 1000.0;

    fn swing(frequency_hz: f64, n: usize, late_s: f64) -> Vec<f64> {
        (0..n)
            .map(|tick| 3.0 + (TAU * frequency_hz * (tick as f64 / RATE_HZ - late_s)).sin())
            .collect()
    }

    fn along(axis: DVec3, values: &[f64]) -> Vec<DVec3> {
        values.iter().map(|value| axis * *value).collect()
    }

    #[test]
    fn only_what_is_above_ten_hertz_counts() {
        let full = 0.5_f64.sqrt();
        for (frequency_hz, low, high) in
            [(100.0, 0.999, 1.001), (50.0, 0.995, 1.001), (10.0, 0.45, 0.55), (1.0, 0.0, 1e-3)]
        {
            let ripple = ripple_rms(
                &along(DVec3::new(0.6, 0.0, 0.8), &swing(frequency_hz, 2000, 0.0)),
                RATE_HZ,
            )
            .unwrap();
            assert!((low..=high).contains(&(ripple / full)), "{frequency_hz} Hz: {ripple}");
        }
        // Neither a load nor a steady growth is rough.
        let ramp: Vec<f64> = (0..500).map(|tick| 5.0 + 0.01 * f64::from(tick)).collect();
        assert!(ripple_rms(&along(DVec3::X, &ramp), RATE_HZ).unwrap() < 1e-9);
        assert_eq!(ripple_rms(&along(DVec3::X, &ramp[..199]), RATE_HZ), None);
    }

    #[test]
    fn a_late_swing_is_late_by_so_much() {
        for late_s in [-0.004, 0.0, 0.0027, 0.02] {
            let lag =
                lag_s(&swing(5.0, 1000, 0.0), &swing(5.0, 1000, late_s), 5.0, RATE_HZ).unwrap();
            assert!((lag - late_s).abs() < 1e-9, "{late_s}: {lag}");
        }
        assert_eq!(lag_s(&[1.0; 100], &swing(5.0, 100, 0.0), 5.0, RATE_HZ), None);
    }
}
