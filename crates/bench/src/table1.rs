//! What the paper of 2008 says in figures: table 1 and the crossovers.
//!
//! # Source
//! Sagardia2008, section 5 (Intel D of 3.4 GHz, 2 GB). t_old is of the generator before it, on the
//! library SOLID.

use super::stand_ins::StandIn;

/// One of the cases (a) to (e).
#[derive(Clone, Copy, Debug)]
pub(super) struct VoxmapCase {
    pub(super) name: char,
    pub(super) stand_in: StandIn,
    pub(super) size_mm: f64,
    pub(super) voxels: f64,
    pub(super) load_s: f64,
    pub(super) init_s: f64,
    pub(super) old_s: f64,
    pub(super) new_s: f64,
    pub(super) fill_s: f64,
}

/// One of the cases (f) to (j).
#[derive(Clone, Copy, Debug)]
pub(super) struct PointshellCase {
    pub(super) name: char,
    pub(super) stand_in: StandIn,
    pub(super) size_mm: f64,
    pub(super) points: f64,
    pub(super) old_s: f64,
    pub(super) new_s: f64,
}

pub(super) const VOXMAPS: [VoxmapCase; 5] = [
    voxmap('a', StandIn::Bracket, 0.5, 237_717_488.0, [0.119_0, 1.185_6, 338.24, 16.562, 2.342_3]),
    voxmap('b', StandIn::Brake, 1.0, 38_524_026.0, [0.395_4, 0.191_9, 104.1, 3.614, 0.499_4]),
    voxmap('c', StandIn::Brake, 0.5, 302_685_600.0, [0.395_4, 1.511_2, 821.5, 15.684, 3.751_2]),
    voxmap('d', StandIn::Car, 5.0, 44_311_554.0, [18.972, 0.229_0, 614.7, 69.179, 0.699_2]),
    voxmap('e', StandIn::Car, 2.0, 680_652_000.0, [18.972, 3.618_8, 9860.0, 442.29, 9.948_6]),
];

pub(super) const POINTSHELLS: [PointshellCase; 5] = [
    pointshell('f', StandIn::Bracket, 8.0, 10_954.0, [3.215, 0.631_9]),
    pointshell('g', StandIn::Bracket, 2.0, 182_464.0, [244.75, 137.412]),
    pointshell('h', StandIn::Brake, 6.0, 7_287.0, [6.107, 0.446_5]),
    pointshell('i', StandIn::Brake, 1.5, 207_490.0, [559.9, 302.974]),
    pointshell('j', StandIn::Car, 40.0, 12_161.0, [203.2, 11.223]),
];

/// Columns: load, initialise, t_old, t_new, filling.
const fn voxmap(
    name: char,
    stand_in: StandIn,
    size_mm: f64,
    voxels: f64,
    seconds: [f64; 5],
) -> VoxmapCase {
    let [load_s, init_s, old_s, new_s, fill_s] = seconds;
    VoxmapCase { name, stand_in, size_mm, voxels, load_s, init_s, old_s, new_s, fill_s }
}

/// Columns: t_old, t_new.
const fn pointshell(
    name: char,
    stand_in: StandIn,
    size_mm: f64,
    points: f64,
    [old_s, new_s]: [f64; 2],
) -> PointshellCase {
    PointshellCase { name, stand_in, size_mm, points, old_s, new_s }
}

/// Voxels from which on the second navigation was the faster one.
pub(super) fn crossover_voxels(stand_in: StandIn) -> f64 {
    match stand_in {
        StandIn::Bracket => 1.98e8,
        StandIn::Brake => 6.1e7,
        StandIn::Car => 4.66e7,
    }
}

impl VoxmapCase {
    /// Δ = t_old / t_new.
    pub(super) fn delta(&self) -> f64 {
        self.old_s / self.new_s
    }
}

impl PointshellCase {
    /// Δ = t_old / t_new.
    pub(super) fn delta(&self) -> f64 {
        self.old_s / self.new_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The paper prints Δ beside the times: a slip in copying either would show.
    #[test]
    fn the_times_give_the_printed_ratios() {
        let printed = [20.42, 28.8, 52.4, 8.9, 22.3, 5.09, 1.78, 13.68, 1.85, 18.11];
        let ours = VOXMAPS
            .iter()
            .map(VoxmapCase::delta)
            .chain(POINTSHELLS.iter().map(PointshellCase::delta));
        for (ours, printed) in ours.zip(printed) {
            assert!((ours / printed - 1.0).abs() < 3e-3, "{ours} for {printed}");
        }
    }
}
