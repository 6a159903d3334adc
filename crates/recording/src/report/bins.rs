//! Forces over a distance: the smallest and the largest of each bin, whatever the distance grows
//! to.

/// Bins at most: about as many as a chart has room for. Where more are needed every two become one.
const MOST: usize = 480;

/// Values of a bin: magnitudes of the contact force and of the commanded force, N.
pub(super) type Forces = [f64; 2];

/// Bins of equal width from 0 on.
#[derive(Debug)]
pub(super) struct Bins {
    width: f64,
    /// `None`: no value fell into it.
    bins: Vec<Option<(Forces, Forces)>>,
}

impl Bins {
    /// Bins that begin with this width.
    pub(super) fn new(width: f64) -> Self {
        Self { width, bins: Vec::new() }
    }

    /// Takes values at a distance; a distance or a force that is no number, or is negative, is left
    /// out.
    pub(super) fn add(&mut self, at: f64, forces: Forces) {
        if !at.is_finite() || at < 0.0 || forces.iter().any(|force| !force.is_finite()) {
            return;
        }
        while at >= self.width * MOST as f64 {
            self.halve();
        }
        let bin = (at / self.width) as usize;
        if bin >= self.bins.len() {
            self.bins.resize(bin + 1, None);
        }
        self.bins[bin] = join(self.bins[bin], Some((forces, forces)));
    }

    /// One of the values: the middle of each bin that has any, least and most.
    pub(super) fn rows(&self, value: usize) -> Vec<[f64; 3]> {
        let filled = self.bins.iter().enumerate().filter_map(|(bin, held)| Some((bin, (*held)?)));
        filled
            .map(|(bin, (least, most))| {
                [(bin as f64 + 0.5) * self.width, least[value], most[value]]
            })
            .collect()
    }

    fn halve(&mut self) {
        self.bins = self.bins.chunks(2).map(|pair| pair.iter().copied().fold(None, join)).collect();
        self.width *= 2.0;
    }
}

fn join(
    one: Option<(Forces, Forces)>,
    other: Option<(Forces, Forces)>,
) -> Option<(Forces, Forces)> {
    let (Some((least, most)), Some((other_least, other_most))) = (one, other) else {
        return one.or(other);
    };
    let each = |a: Forces, b: Forces, choose: fn(f64, f64) -> f64| {
        [choose(a[0], b[0]), choose(a[1], b[1])]
    };
    Some((each(least, other_least, f64::min), each(most, other_most, f64::max)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn however_far_it_goes_no_peak_is_lost_and_every_bin_is_where_its_values_were() {
        let mut bins = Bins::new(0.01);
        // Force is twice the distance, but for one peak.
        let n_steps: u32 = 20_000;
        for step in 0..n_steps {
            let at = f64::from(step) * 0.01;
            bins.add(at, [if step == 12_345 { 999.0 } else { 2.0 * at }, 1.0]);
        }
        for nonsense in [f64::NAN, f64::INFINITY, -1.0] {
            bins.add(nonsense, [1e6, 1e6]);
        }
        bins.add(3.0, [f64::NAN, 1e6]);
        let rows = bins.rows(0);
        assert!(rows.len() <= MOST && rows.len() > MOST / 3, "{}", rows.len());
        let width = rows[1][0] - rows[0][0];
        for [at, least, most] in &rows {
            assert!((least - 2.0 * at).abs() <= width + 1e-9, "{at}: {least}");
            let is_peak = (at - 123.45).abs() <= 0.5 * width;
            assert!(
                if is_peak { *most == 999.0 } else { (most - 2.0 * at).abs() <= width + 1e-9 },
                "{at}: {most}"
            );
        }
        assert!(bins.rows(1).iter().all(|[_, least, most]| (*least, *most) == (1.0, 1.0)));
    }

    #[test]
    fn a_bin_without_values_is_not_there() {
        let mut bins = Bins::new(1.0);
        bins.add(0.5, [1.0, 2.0]);
        bins.add(7.2, [3.0, 4.0]);
        assert_eq!(bins.rows(0), [[0.5, 1.0, 1.0], [7.5, 3.0, 3.0]]);
        assert_eq!(bins.rows(1), [[0.5, 2.0, 2.0], [7.5, 4.0, 4.0]]);
    }
}
