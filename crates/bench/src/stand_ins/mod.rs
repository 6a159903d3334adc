//! Stand-ins for the models of Sagardia2008, which are private.
//!
//! Each fills the box that the paper's voxel counts imply, with the paper's number of triangles
//! and, within a fifth, of points. A closed mesh has an even number of triangles, so the two odd
//! counts are one below the paper's. One model unit is a millimetre, which the paper's car models
//! suggest. The same seed gives the same mesh.
//!
//! # Source
//! Sagardia2008, Table 1: triangles, voxel sizes, voxels, points.

mod bracket;
mod brake;
mod car;
mod solids;

use super::random::Random;
use vps::mesh::TriangleMesh;

/// A model of the paper.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StandIn {
    /// "Artificial" in the paper: 7,088 triangles; ours is a bracket with bores.
    Bracket,
    /// Brake: 24,251 triangles; ours is a brake disc with caliper and strut.
    Brake,
    /// VW Polo: 3,024,231 triangles; ours is the front half of a car.
    Car,
}

impl StandIn {
    /// All of them, small to large.
    pub const ALL: [Self; 3] = [Self::Bracket, Self::Brake, Self::Car];

    /// The name in tables and of files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Bracket => "bracket",
            Self::Brake => "brake",
            Self::Car => "car",
        }
    }

    /// Triangles of the paper's model.
    pub fn paper_triangles(self) -> usize {
        match self {
            Self::Bracket => 7_088,
            Self::Brake => 24_251,
            Self::Car => 3_024_231,
        }
    }

    /// The mesh, metres, its lowest corner at the origin. Closed parts, outward, that may touch or
    /// enter each other. Cost: linear; about a second for the car.
    pub fn mesh(self, seed: u64) -> TriangleMesh {
        let mut random = Random::new(seed);
        match self {
            Self::Bracket => bracket::bracket(&mut random),
            Self::Brake => brake::brake(&mut random),
            Self::Car => car::car(&mut random),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::hash::{DefaultHasher, Hash, Hasher};

    use glam::DVec3;

    use super::*;
    use vps::mesh::validate::inspect;
    use vps::setting_names::SettingNames;
    use vps::voxmap::grid::Grid;
    use vps::voxmap::surface::{Navigation, Surface};

    const SEED: u64 = 2008;

    fn hash(mesh: &TriangleMesh) -> u64 {
        let mut hasher = DefaultHasher::new();
        mesh.triangles.hash(&mut hasher);
        for vertex in &mesh.vertices {
            vertex.to_array().map(f64::to_bits).hash(&mut hasher);
        }
        hasher.finish()
    }

    #[test]
    fn stand_ins_are_sound_and_have_the_papers_triangles() {
        for stand_in in StandIn::ALL {
            let mesh = stand_in.mesh(SEED);
            assert_eq!(
                mesh.triangles.len(),
                stand_in.paper_triangles() / 2 * 2,
                "{}",
                stand_in.name()
            );
            let report = inspect(&mesh);
            assert!(
                report.closed,
                "{}: {:?}",
                stand_in.name(),
                report.warnings(&SettingNames::PLAIN)
            );
            let flaws = (
                report.degenerate_triangles,
                report.duplicate_triangles,
                report.inconsistent_edges,
            );
            assert_eq!(flaws, (0, 0, 0), "{}", stand_in.name());
            assert!(report.signed_volume_m3 > 0.0);
        }
    }

    #[test]
    fn the_seed_decides_every_bit() {
        for stand_in in [StandIn::Bracket, StandIn::Brake] {
            let meshes = [SEED, SEED, SEED + 1].map(|seed| stand_in.mesh(seed));
            let [a, b, c] = meshes.each_ref().map(hash);
            assert!(a == b && a != c, "{}", stand_in.name());
            assert_eq!(meshes[0].triangles.len(), meshes[2].triangles.len());
        }
    }

    /// Inside the padding our grids are the paper's, which pad by one voxel on each side.
    #[test]
    fn grids_and_points_are_the_papers() {
        let cases = [
            (StandIn::Bracket, 0.5, Some([488, 302, 1613]), None),
            (StandIn::Bracket, 8.0, None, Some(10_954)),
            (StandIn::Bracket, 2.0, None, Some(182_464)),
            (StandIn::Brake, 1.0, Some([302, 303, 421]), None),
            (StandIn::Brake, 0.5, Some([600, 602, 838]), None),
            (StandIn::Brake, 6.0, None, Some(7_287)),
            (StandIn::Brake, 1.5, None, Some(207_490)),
            (StandIn::Car, 5.0, Some([302, 357, 411]), None),
            (StandIn::Car, 2.0, Some([750, 888, 1022]), None),
            (StandIn::Car, 40.0, None, Some(12_161)),
        ];
        let mut off = Vec::new();
        for stand_in in StandIn::ALL {
            let mesh = stand_in.mesh(SEED);
            let (low, high) = mesh.bounds().unwrap();
            assert_eq!(low, DVec3::ZERO);
            for (_, size_mm, paper_dims, paper_points) in
                cases.into_iter().filter(|case| case.0 == stand_in)
            {
                let grid = Grid::around(low, high, size_mm * 1e-3, 1).unwrap();
                if let Some(dims) = paper_dims {
                    assert_eq!(grid.dims.map(|n| n - 2), dims, "{} at {size_mm}", stand_in.name());
                }
                if let Some(points) = paper_points {
                    let found = Surface::mark(&mesh, &grid, Navigation::PlaneSpan).n_voxels;
                    let share = found as f64 / f64::from(points);
                    if !(0.8..1.2).contains(&share) {
                        off.push(format!(
                            "{} at {size_mm}: {found} points for {points}, {share:.3}",
                            stand_in.name()
                        ));
                    }
                }
            }
        }
        assert!(off.is_empty(), "{}", off.join("\n"));
    }
}
