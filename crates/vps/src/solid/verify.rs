//! Whether a border bounds what its pieces say, along lines through them.
//!
//! Data in: the closed faces and the border that was made of them. Data out: how much of the volume
//! lies in one of the two only. It knows nothing of cutting and judging: inside of the pieces is
//! where their windings add up to 1 or more, and inside of the border likewise.
//!
//! Lines along z pass through places that are spread evenly over the faces as seen along z. A line
//! that crosses `n` faces is as likely as `n` is large, so its lengths count one `n`-th. What
//! tolerances explain is no difference: a few of them at each crossing, or beside the line.
//!
//! Cost: n log n in the border; lines are fewer than faces, and at most [`LINES_MAX`].

use glam::DVec3;

use super::columns::crossing;
use super::faces::Faces;
use crate::mesh::boxes::Boxes;
use crate::parallel;

const LINES_MIN: usize = 256;
const LINES_MAX: usize = 4096;
/// Faces of one line.
const FACES: usize = 16;

/// So many tolerances a border may be off at each crossing.
const OFF_TOLERANCES: f64 = 32.0;

/// Lines beside one that differs are this many tolerances away: along a steep face, what lies
/// between the two borders can be long.
const BESIDE_TOLERANCES: f64 = 8.0;

/// What was found.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Difference {
    /// What lies in one of the two only, m³.
    pub(super) off_m3: f64,
    /// How much more the pieces enclose than the border, m³.
    pub(super) more_m3: f64,
}

/// Compares the closed pieces with the border that was made of them.
pub(super) fn difference(
    faces: &Faces,
    border: &[[u32; 3]],
    positions: &[DVec3],
    tolerance_m: f64,
) -> Difference {
    let mut area_m2 = 0.0;
    let sums: Vec<f64> = faces
        .faces
        .iter()
        .map(|face| {
            let [a, b, c] = face.corners;
            area_m2 += if face.closed { 0.5 * (b - a).cross(c - a).z.abs() } else { 0.0 };
            area_m2
        })
        .collect();
    let corners_of = |k: u32| border[k as usize].map(|point| positions[point as usize]);
    let boxes = Boxes::new(border.len(), |k| {
        let [a, b, c] = corners_of(k as u32);
        (a.min(b).min(c), a.max(b).max(c))
    });
    let (low, high) = (faces.by_piece.iter())
        .fold((0.0_f64, 0.0_f64), |(low, high), of| (low.min(of.low.z), high.max(of.high.z)));
    let lines = Lines { faces, boxes, corners_of, bottom_m: 2.0 * low - high - 1.0, tolerance_m };
    let n_lines = (faces.faces.len() / FACES).clamp(LINES_MIN, LINES_MAX);
    let found = parallel::map(n_lines, 4, |k| {
        let target = (k as f64 + 0.5) / n_lines as f64 * area_m2;
        let face = sums.partition_point(|sum| *sum <= target).min(sums.len() - 1);
        let [a, b, c] = faces.faces[face].corners;
        let [mut u, mut v] = spread(k);
        if u + v > 1.0 {
            (u, v) = (1.0 - u, 1.0 - v);
        }
        lines.lengths(a + u * (b - a) + v * (c - a))
    });
    let mut all = Difference::default();
    for lengths in found {
        let share_m2 = area_m2 / (n_lines * lengths.n_crossings.max(1)) as f64;
        all.off_m3 += share_m2 * lengths.off_m;
        all.more_m3 += share_m2 * lengths.more_m;
    }
    all
}

/// Pairs of numbers below 1 that are spread evenly over a square: multiples of the powers of the
/// root of x³ = x + 1.
fn spread(k: usize) -> [f64; 2] {
    const ROOT: f64 = 1.324_717_957_244_746;
    [1.0 / ROOT, 1.0 / (ROOT * ROOT)].map(|step| (0.5 + step * (k + 1) as f64).fract())
}

/// What was found along a line.
#[derive(Clone, Copy, Debug, Default)]
struct Lengths {
    off_m: f64,
    more_m: f64,
    /// Of faces of the pieces.
    n_crossings: usize,
}

/// Looks along lines.
struct Lines<'a, C> {
    faces: &'a Faces,
    boxes: Boxes,
    corners_of: C,
    /// Below everything.
    bottom_m: f64,
    tolerance_m: f64,
}

impl<C: Fn(u32) -> [DVec3; 3] + Sync> Lines<'_, C> {
    /// Along the line through a point, or beside it where that differs less.
    fn lengths(&self, through: DVec3) -> Lengths {
        let mut least = self.lengths_at(through);
        let beside_m = BESIDE_TOLERANCES * self.tolerance_m;
        for beside in [DVec3::X, -DVec3::X, DVec3::Y, -DVec3::Y] {
            if least.off_m == 0.0 {
                break;
            }
            let other = self.lengths_at(through + beside_m * beside);
            if other.off_m < least.off_m {
                least = Lengths { n_crossings: least.n_crossings, ..other };
            }
        }
        least
    }

    fn lengths_at(&self, through: DVec3) -> Lengths {
        let start = through.with_z(self.bottom_m);
        let [low, high] = [f64::NEG_INFINITY, f64::INFINITY].map(|z| through.with_z(z));
        // Heights, and what is entered there of the pieces and of the border.
        let mut events: Vec<(f64, [i32; 2])> = Vec::new();
        let mut cross = |corners: &[DVec3; 3], side: usize| {
            let leaves = crossing(corners, start);
            if leaves != 0 {
                let mut enters = [0; 2];
                enters[side] = -leaves;
                events.push((height(corners, start), enters));
            }
        };
        self.faces.meeting(low, high, |number| {
            let face = &self.faces.faces[number as usize];
            if face.closed {
                cross(&face.corners, 0);
            }
        });
        self.boxes.meeting(low, high, |number| cross(&(self.corners_of)(number), 1));
        events.sort_unstable_by(|one, other| one.0.total_cmp(&other.0).then(one.1.cmp(&other.1)));
        let mut lengths = Lengths::default();
        let mut sums = [0; 2];
        let mut last_m = self.bottom_m;
        for (at_m, enters) in &events {
            let is_in = sums[0] >= 1;
            let is_in_border = sums[1] >= 1;
            // Two borders around each other are no border.
            let is_plain = (0..=1).contains(&sums[1]);
            if is_in != is_in_border || !is_plain {
                lengths.off_m += at_m - last_m;
                lengths.more_m += (at_m - last_m) * (f64::from(is_in) - f64::from(sums[1]));
            }
            lengths.n_crossings += usize::from(enters[0] != 0);
            sums[0] += enters[0];
            sums[1] += enters[1];
            last_m = *at_m;
        }
        if lengths.off_m <= OFF_TOLERANCES * self.tolerance_m * events.len() as f64 {
            return Lengths { n_crossings: lengths.n_crossings, ..Lengths::default() };
        }
        lengths
    }
}

/// Where a line along z passes through a triangle that it crosses.
fn height([a, b, c]: &[DVec3; 3], line: DVec3) -> f64 {
    let normal = (b - a).cross(c - a);
    let rise = (normal.x * (a.x - line.x) + normal.y * (a.y - line.y)) / normal.z;
    let height = a.z + if rise.is_finite() { rise } else { 0.0 };
    height.clamp(a.z.min(b.z).min(c.z), a.z.max(b.z).max(c.z))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::primitives::Shape;
    use crate::solid::pieces::Pieces;

    #[test]
    fn what_a_border_lacks_or_has_twice_is_measured() {
        let mesh = Shape::Sphere { radius_m: 1.0 }.tessellate(0.01);
        let pieces = Pieces::of(&mesh, 1e-9);
        let (faces, _) = Faces::of(&mesh, &pieces, &[true], 1e-9);
        let measured =
            |border: &[[u32; 3]], positions: &[DVec3]| difference(&faces, border, positions, 1e-6);
        let same = measured(&mesh.triangles, &mesh.vertices);
        assert_eq!((same.off_m3, same.more_m3), (0.0, 0.0));
        let narrower: Vec<DVec3> = mesh.vertices.iter().map(|vertex| 0.9 * *vertex).collect();
        let right = pieces.pieces[0].volume_m3 * (1.0 - 0.9_f64.powi(3));
        let less = measured(&mesh.triangles, &narrower);
        assert!((less.off_m3 / right - 1.0).abs() < 0.05, "{less:?} {right}");
        assert_eq!(less.off_m3, less.more_m3);
        let twice = [&mesh.triangles[..], &mesh.triangles[..]].concat();
        let more = measured(&twice, &mesh.vertices);
        assert!((more.more_m3 / pieces.pieces[0].volume_m3 + 1.0).abs() < 0.05, "{more:?}");
        let shifted: Vec<DVec3> =
            mesh.vertices.iter().map(|vertex| *vertex + DVec3::X * 3e-6).collect();
        assert_eq!(measured(&mesh.triangles, &shifted).off_m3, 0.0);
    }
}
