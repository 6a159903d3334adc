//! Densities on a regular lattice of mass points, and their look-up between them.
//!
//! DensityFrame: map, the frame of the point set. Sign: outside negative, inside positive (Guo2004,
//! table 1). A density starts as a signed distance in metres; after deformation it is one near the
//! surface only, but its zero-level set is the surface always.

use glam::{DVec3, Vec3};

/// Where the mass points lie, map frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lattice {
    /// Place of node `[0, 0, 0]`, m.
    pub origin_map: DVec3,
    /// Distance of neighbours along every axis, m.
    pub spacing_m: f64,
    /// Nodes along x, y, z; at least 2 each.
    pub dims: [usize; 3],
}

impl Lattice {
    /// Number of nodes.
    pub fn n_nodes(&self) -> usize {
        self.dims.iter().product()
    }

    /// Place of a node in an array of all, z fastest.
    #[inline]
    pub fn index(&self, [x, y, z]: [usize; 3]) -> usize {
        (x * self.dims[1] + y) * self.dims[2] + z
    }

    /// Place of a node, map frame, m.
    #[inline]
    pub fn position(&self, node: [usize; 3]) -> DVec3 {
        self.origin_map + DVec3::from_array(node.map(|n| n as f64)) * self.spacing_m
    }

    /// A point in node coordinates: whole numbers are nodes.
    pub fn nodes(&self, point_map: DVec3) -> Vec3 {
        ((point_map - self.origin_map) / self.spacing_m).as_vec3()
    }

    /// Lowest and highest node, map frame, m.
    pub fn bounds(&self) -> (DVec3, DVec3) {
        (self.origin_map, self.position(self.dims.map(|n| n.saturating_sub(1))))
    }
}

/// Value and slope of a density.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Density {
    /// s, m; greater than 0 inside.
    pub value_m: f32,
    /// ∇s, m/m, map axes: points **into** the material.
    pub gradient: Vec3,
}

/// Densities of all nodes of a lattice.
#[derive(Clone, Debug)]
pub struct Raster {
    lattice: Lattice,
    /// `[n_nodes]`, z fastest, m.
    #[expect(clippy::disallowed_types, reason = "sized on the cold side, never resized")]
    values_m: Box<[f32]>,
    steepest: f32,
}

impl PartialEq for Raster {
    /// The same densities at the same places, measured or not.
    fn eq(&self, other: &Self) -> bool {
        self.lattice == other.lattice && self.values_m == other.values_m
    }
}

impl Raster {
    /// The same density everywhere. Allocates.
    #[expect(clippy::disallowed_macros, reason = "cold side")]
    pub fn uniform(lattice: Lattice, value_m: f32) -> Self {
        Self {
            lattice,
            values_m: vec![value_m; lattice.n_nodes()].into_boxed_slice(),
            steepest: 0.0,
        }
    }

    /// Where the nodes lie.
    pub fn lattice(&self) -> &Lattice {
        &self.lattice
    }

    /// `[n_nodes]`, z fastest, m.
    pub fn values_m(&self) -> &[f32] {
        &self.values_m
    }

    /// `[n_nodes]`, z fastest, m. How steep they are is unknown from then on, until they are
    /// [measured](Self::measure).
    pub fn values_m_mut(&mut self) -> &mut [f32] {
        self.steepest = f32::INFINITY;
        &mut self.values_m
    }

    /// No slope between the nodes is steeper than this, m/m; infinite when it was not measured
    /// since the last change.
    pub fn steepest(&self) -> f32 {
        self.steepest
    }

    /// Measures how steep the densities are, which is what turns a density into a proven distance.
    /// Cold; O(nodes).
    ///
    /// # Source
    /// Ours: a component of the gradient of eight-corner interpolation is a mean of differences
    /// along four edges of the cell, so none exceeds the largest difference along its axis.
    pub fn measure(&mut self) {
        let [_, ny, nz] = self.lattice.dims;
        let shifted = |values: &[f32], by: usize| {
            greatest_difference(values, values.get(by..).unwrap_or_default())
        };
        let along_x = shifted(&self.values_m, ny * nz);
        let planes = self.values_m.chunks_exact((ny * nz).max(1));
        let along_y = planes.map(|plane| shifted(plane, nz)).fold(0.0, f32::max);
        let along_z =
            self.values_m.chunks_exact(nz.max(1)).map(|row| shifted(row, 1)).fold(0.0, f32::max);
        self.steepest =
            Vec3::new(along_x, along_y, along_z).length() / self.lattice.spacing_m as f32;
    }

    /// The density at a place in node coordinates; `None` outside the lattice, and where it is not
    /// a number. RT: safe; O(1).
    #[inline]
    pub(super) fn value_at_nodes(&self, nodes: Vec3) -> Option<f32> {
        let Cell { t, corners: [c000, c001, c010, c011, c100, c101, c110, c111] } =
            self.cell(nodes)?;
        let z00 = mix(c000, c001, t.z);
        let z01 = mix(c010, c011, t.z);
        let z10 = mix(c100, c101, t.z);
        let z11 = mix(c110, c111, t.z);
        Some(mix(mix(z00, z01, t.y), mix(z10, z11, t.y), t.x))
    }

    /// The cell that a place in node coordinates lies in.
    #[inline]
    fn cell(&self, nodes: Vec3) -> Option<Cell> {
        let [nx, ny, nz] = self.lattice.dims;
        let last = Vec3::new(
            nx.saturating_sub(1) as f32,
            ny.saturating_sub(1) as f32,
            nz.saturating_sub(1) as f32,
        );
        // False for NaN as well.
        if !(nodes.cmpge(Vec3::ZERO).all() && nodes.cmple(last).all()) {
            return None;
        }
        // A point on the upper face belongs to the last cell.
        let base = nodes.floor().min(last - 1.0);
        let first = self.lattice.index([base.x as usize, base.y as usize, base.z as usize]);
        let along_x = ny * nz;
        let along_y = nz;
        let pair = |offset: usize| match self.values_m.get(first + offset..first + offset + 2) {
            Some(&[low, high]) => Some((low, high)),
            _ => None,
        };
        let (c000, c001) = pair(0)?;
        let (c010, c011) = pair(along_y)?;
        let (c100, c101) = pair(along_x)?;
        let (c110, c111) = pair(along_x + along_y)?;
        Some(Cell { t: nodes - base, corners: [c000, c001, c010, c011, c100, c101, c110, c111] })
    }

    /// Eight-corner interpolation at a point; `None` outside the lattice, and where the point is
    /// not a number. RT: safe; O(1).
    #[inline]
    pub fn at(&self, point_map: DVec3) -> Option<Density> {
        let Cell { t, corners: [c000, c001, c010, c011, c100, c101, c110, c111] } =
            self.cell(self.lattice.nodes(point_map))?;
        let z00 = mix(c000, c001, t.z);
        let z01 = mix(c010, c011, t.z);
        let z10 = mix(c100, c101, t.z);
        let z11 = mix(c110, c111, t.z);
        let y0 = mix(z00, z01, t.y);
        let y1 = mix(z10, z11, t.y);
        let along_z =
            mix(mix(c001 - c000, c011 - c010, t.y), mix(c101 - c100, c111 - c110, t.y), t.x);
        let gradient = Vec3::new(y1 - y0, mix(z01 - z00, z11 - z10, t.x), along_z)
            / self.lattice.spacing_m as f32;
        Some(Density { value_m: mix(y0, y1, t.x), gradient })
    }
}

/// The largest difference of two numbers at the same place. A maximum apart for each of eight
/// lanes: one for all would wait for itself.
fn greatest_difference(low: &[f32], high: &[f32]) -> f32 {
    const APART: usize = 8;
    let mut greatest = [0.0_f32; APART];
    for (low, high) in low.chunks(APART).zip(high.chunks(APART)) {
        for ((greatest, low), high) in greatest.iter_mut().zip(low).zip(high) {
            *greatest = greatest.max((high - low).abs());
        }
    }
    greatest.into_iter().fold(0.0, f32::max)
}

/// Eight corners, z fastest, and where between them a place lies.
struct Cell {
    t: Vec3,
    corners: [f32; 8],
}

#[inline]
fn mix(low: f32, high: f32, t: f32) -> f32 {
    low + (high - low) * t
}

#[cfg(test)]
#[expect(clippy::indexing_slicing, clippy::unwrap_used, reason = "test code")]
mod tests {
    use super::*;
    use crate::spatial::testing::Random;

    /// s = 1 − 2x + 3y + 0.5z.
    fn sloped() -> Raster {
        let lattice =
            Lattice { origin_map: DVec3::new(-1.0, 2.0, 0.5), spacing_m: 0.25, dims: [5, 6, 7] };
        let mut raster = Raster::uniform(lattice, 0.0);
        for x in 0..5 {
            for y in 0..6 {
                for z in 0..7 {
                    let place = lattice.position([x, y, z]);
                    raster.values_m_mut()[lattice.index([x, y, z])] =
                        (1.0 - 2.0 * place.x + 3.0 * place.y + 0.5 * place.z) as f32;
                }
            }
        }
        raster
    }

    #[test]
    fn linear_densities_are_reproduced_up_to_every_face() {
        let raster = sloped();
        let (low, high) = raster.lattice().bounds();
        for share in
            [DVec3::ZERO, DVec3::ONE, DVec3::new(0.3, 0.99, 0.5), DVec3::new(1.0, 0.0, 0.77)]
        {
            let point = low + (high - low) * share;
            let density = raster.at(point).unwrap();
            let expected = 1.0 - 2.0 * point.x + 3.0 * point.y + 0.5 * point.z;
            assert!((f64::from(density.value_m) - expected).abs() < 1e-5, "{point}: {density:?}");
            assert!(
                (density.gradient - Vec3::new(-2.0, 3.0, 0.5)).length() < 1e-4,
                "{point}: {density:?}"
            );
        }
    }

    #[test]
    fn nothing_is_said_of_what_lies_outside_or_is_not_a_number() {
        let raster = sloped();
        let (low, high) = raster.lattice().bounds();
        for point in [
            low - 1e-3,
            high + 1e-3,
            DVec3::NAN,
            DVec3::INFINITY,
            DVec3::new(low.x, f64::NAN, low.z),
        ] {
            assert_eq!(raster.at(point), None, "{point}");
        }
    }

    #[test]
    fn no_slope_is_steeper_than_what_was_measured() {
        let mut raster = sloped();
        assert_eq!(raster.steepest(), f32::INFINITY, "changed since it was made");
        raster.measure();
        assert!(
            (raster.steepest() - Vec3::new(2.0, 3.0, 0.5).length()).abs() < 1e-4,
            "{}",
            raster.steepest()
        );
        let mut random = Random(5);
        for value_m in raster.values_m_mut() {
            *value_m = random.unit() as f32 * 0.17;
        }
        raster.measure();
        let (low, high) = raster.lattice().bounds();
        let mut steepest: f32 = 0.0;
        for n in 0..2000 {
            let share = DVec3::new(0.618_034, 0.754_878, 0.569_84) * f64::from(n);
            let density = raster.at(low + (high - low) * share.fract()).unwrap();
            steepest = steepest.max(density.gradient.length());
        }
        assert!(
            steepest <= raster.steepest() && steepest > 0.3 * raster.steepest(),
            "{steepest} of {}",
            raster.steepest()
        );
    }
}
