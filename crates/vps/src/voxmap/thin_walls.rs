//! Walls, fins and pins that are thinner than the voxels resolve: where they are, and how thick.
//!
//! Data in: a map and its triangles. Data out: a [`ThinPlace`] for each of them, the largest first.
//! Metres, mesh frame.
//!
//! What is thinner than a voxel has no cell inside, whatever its attitude, and what is two voxels
//! thick has one everywhere. So cells of the surface far from all cells inside are looked at, and
//! there the triangles say how thick the part is. An edge has such cells too: its faces are not
//! opposite, and the next cell inside is not far.
//!
//! Cost: some 2 µs per brick with surface, and some per cell that is looked at, of which a sound
//! part has few.

use std::collections::HashMap;

use glam::{DVec3, IVec3};

use super::Volume;
use super::border::{Border, OPPOSITE_COSINE};
use super::fill::{Side, Sides};
use super::grid::{cell_of, round_near};
use super::growth;
use super::inside_test::InsideBasis;
use super::surface::{Mask, Surface, bits};
use crate::mesh::closest_point::TriangleProjector;
use crate::parallel;
use crate::sets::Sets;
use crate::setting_names::SettingNames;

/// Cells of the surface are looked at that are farther than this from all cells inside, by faces,
/// edges and corners. Beside a flat face the next cell inside is at most two away.
const NEAR_CELLS: i8 = 2;
/// Beyond this what is there is thin whatever its faces are; up to it only where they are opposite.
/// An edge of 40° holds a ball around a cell, whose radius is 0.87 cells, 2.5 cells from itself.
const FAR_CELLS: i8 = 4;
/// Thinner than so many voxels: in the middle of a wall of two the field reaches half a voxel
/// wherever its cells lie. Less what the tessellation of a shape takes off.
const RESOLVED_VOXELS: f64 = 1.95;
/// A place reaches over this many voxels, or there is nothing inside of the part at all: what is
/// smaller is a burr, or the tip of an edge.
const LEAST_VOXELS: f64 = 3.0;
/// Cells that are looked at, about, evenly spread over all that could be.
const LOOKED_AT: usize = 1 << 14;
/// Thin cells with no more than this between them, in cells, are one place.
const APART_CELLS: f64 = 4.0;
/// A place is as thick as this share of it is at most: at its edges it may be thinner.
const THINNEST_SHARE: f64 = 0.1;

/// A part of a solid that is thinner than its voxels resolve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ThinPlace {
    /// How thick it is, m; 0 of a sheet that is open.
    pub(crate) thickness_m: f64,
    /// A point on it, about in its middle, m.
    pub(crate) position_m: DVec3,
    /// How far it reaches along its longest side, about, m.
    pub(crate) length_m: f64,
    /// Cells of it that were looked at.
    n_cells: usize,
}

/// A cell of the surface where the part is too thin.
#[derive(Clone, Copy, Debug)]
struct ThinCell {
    cell: [i32; 3],
    /// On the surface, m.
    place_m: DVec3,
    thickness_m: f64,
}

impl ThinPlace {
    /// Those of maps, each with the triangles that it is of, facing outward. Skins have none.
    pub(super) fn of<'a>(members: impl Iterator<Item = (&'a Volume, &'a Border<'a>)>) -> Vec<Self> {
        let mut places: Vec<Self> =
            members.flat_map(|(map, border)| Self::of_one(map, border)).collect();
        // Stable: equal ones stay in order.
        places.sort_by_key(|place| core::cmp::Reverse(place.n_cells));
        places
    }

    /// What a user should know of them; `None` where there are none.
    pub(crate) fn warning(places: &[Self], names: &SettingNames) -> Option<String> {
        let largest = places.first()?;
        let Self { thickness_m, position_m, length_m, n_cells: _ } = *largest;
        let [x, y, z] = (position_m * 1e3).to_array();
        let (what, are, which) = match places.len() {
            1 => ("1 place".to_owned(), "is", ""),
            n => (format!("{n} places"), "are", "the largest "),
        };
        let thickness = if thickness_m > 0.0 {
            format!("{} mm thick", round_near(thickness_m * 1e3))
        } else {
            "of no thickness".to_owned()
        };
        let thicknesses_m = places.iter().map(|place| place.thickness_m);
        let thinnest_m = thicknesses_m.filter(|thickness_m| *thickness_m > 0.0);
        let finer = thinnest_m.min_by(f64::total_cmp).map_or_else(String::new, |thinnest_m| {
            format!("voxels of {} mm, or ", round_near(0.5 * thinnest_m * 1e3))
        });
        Some(format!(
            "{what} {are} thinner than the voxels resolve and felt too weakly or not at all, \
                {which}{thickness} near ({x:.2}, {y:.2}, {z:.2}) mm and about {} mm long; use \
                {finer}{}",
            round_near(length_m * 1e3),
            names.thin_skin
        ))
    }

    fn of_one(map: &Volume, border: &Border<'_>) -> Vec<Self> {
        // Of what leaks it is not known what is inside, before lids close it.
        let leaks = map.leak.is_some() && map.capped.is_none();
        // Of triangles that enclose nothing at all that is said.
        let is_empty = map.sides.count_inside(&map.surface) == 0;
        let has_body = map.solid.as_ref().is_some_and(|solid| solid.bodies > 0);
        if map.basis == InsideBasis::Thin || leaks || is_empty && !has_body {
            return Vec::new();
        }
        let far = far_cells(&map.surface, &map.sides);
        if far.is_empty() {
            return Vec::new();
        }
        let stride = far.len().div_ceil(LOOKED_AT);
        let looked_at: Vec<FarCell> = far.into_iter().step_by(stride).collect();
        let thin = parallel::map(looked_at.len(), 16, |idx| thin_cell(border, map, looked_at[idx]));
        let thin: Vec<ThinCell> = thin.into_iter().flatten().collect();
        let voxel_size_m = map.surface.grid.voxel_size_m;
        // A surface has cells in two directions.
        let apart_cells = (APART_CELLS * (stride as f64).sqrt()) as i32;
        let mut places = places(&thin, apart_cells);
        if !is_empty {
            places.retain(|place| place.length_m >= LEAST_VOXELS * voxel_size_m);
        }
        places
    }
}

/// A cell of the surface without a cell inside near it.
#[derive(Clone, Copy, Debug)]
struct FarCell {
    cell: [i32; 3],
    /// Farther than [`FAR_CELLS`].
    is_very_far: bool,
}

/// In order of rank.
fn far_cells(surface: &Surface, sides: &Sides) -> Vec<FarCell> {
    let grid = &surface.grid;
    let per_brick = parallel::map(surface.bricks.len(), 16, |slot| {
        let coord = grid.brick_coord(surface.bricks[slot] as usize);
        let inside: [Option<Mask>; 27] = core::array::from_fn(|idx| {
            let neighbour = grid.brick_neighbour(coord, growth::offset(idx))?;
            let inside = sides.inside_mask(surface, neighbour);
            (inside != Mask::default()).then_some(inside)
        });
        let inside = inside.each_ref().map(Option::as_ref);
        let words = surface.masks[slot].iter().enumerate();
        let cells = words.flat_map(|(x, word)| bits(*word).map(move |bit| x << 6 | bit as usize));
        let distances = growth::distances(&inside, NEAR_CELLS as u32);
        let far: Vec<usize> = cells.filter(|cell| distances[*cell] > NEAR_CELLS).collect();
        if far.is_empty() {
            return Vec::new();
        }
        let distances = growth::distances(&inside, FAR_CELLS as u32);
        let far = far.into_iter().map(|inside| FarCell {
            cell: cell_of(coord, inside),
            is_very_far: distances[inside] > FAR_CELLS,
        });
        far.collect::<Vec<FarCell>>()
    });
    per_brick.concat()
}

/// What the triangle nearest to the middle of a cell says; `None` where the part is not thin.
fn thin_cell(border: &Border<'_>, map: &Volume, far: FarCell) -> Option<ThinCell> {
    let Volume { surface, sides, .. } = map;
    let FarCell { cell, is_very_far } = far;
    let grid = &surface.grid;
    let center_m = grid.center_map(cell);
    let half_m = 0.5 * grid.voxel_size_m;
    let mut nearest = (f64::INFINITY, [DVec3::ZERO; 3], DVec3::ZERO);
    border.boxes.meeting(center_m - half_m, center_m + half_m, |triangle| {
        let corners = border.mesh.corners(triangle as usize);
        let found = TriangleProjector::new(&corners).project(center_m);
        if found.distance_squared < nearest.0 {
            nearest = (found.distance_squared, corners, found.point);
        }
    });
    let (_, [a, b, c], place_m) = nearest;
    let normal = (b - a).cross(c - a).try_normalize()?;
    // A little off the edges, where the face beside would be met at once.
    let to_middle = (a + b + c) / 3.0 - place_m;
    let place_m = place_m + to_middle.clamp_length_max(0.5 * half_m);
    let resolved_m = RESOLVED_VOXELS * grid.voxel_size_m;
    // Along a fin, from its narrow face, the way goes through material only.
    let is_air = |at_m: DVec3| {
        let cell = grid.to_cells(at_m).floor().as_ivec3().to_array();
        sides.side(surface, cell) == Side::Outside
    };
    let thickness_m = match border.exit(place_m, -normal, resolved_m) {
        Some(exit) if is_very_far || exit.cosine > OPPOSITE_COSINE => exit.at_m,
        None if is_very_far && is_air(place_m - resolved_m * normal) => 0.0,
        _ => return None,
    };
    Some(ThinCell { cell, place_m, thickness_m })
}

/// Cells that lie together, by blocks of so many cells that are the same or neighbours.
fn places(thin: &[ThinCell], apart_cells: i32) -> Vec<ThinPlace> {
    let block = |thin: &ThinCell| IVec3::from(thin.cell).div_euclid(IVec3::splat(apart_cells));
    let mut first_in: HashMap<IVec3, u32> = HashMap::new();
    let mut sets = Sets::new(thin.len());
    for (number, cell) in (0..).zip(thin) {
        let block = block(cell);
        first_in.entry(block).or_insert(number);
        for offset in (0..27).map(growth::offset) {
            if let Some(other) = first_in.get(&(block + IVec3::from(offset))) {
                sets.join(*other, number);
            }
        }
    }
    let mut members: Vec<(u32, &ThinCell)> =
        (0..).zip(thin).map(|(number, cell)| (sets.lowest(number), cell)).collect();
    members.sort_by_key(|(set, _)| *set);
    members.chunk_by(|one, other| one.0 == other.0).filter_map(place).collect()
}

fn place(members: &[(u32, &ThinCell)]) -> Option<ThinPlace> {
    let mut thicknesses_m: Vec<f64> = members.iter().map(|(_, cell)| cell.thickness_m).collect();
    thicknesses_m.sort_unstable_by(f64::total_cmp);
    let positions = || members.iter().map(|(_, cell)| cell.place_m);
    let farther = |from: DVec3| {
        let distance = |at: &DVec3| at.distance_squared(from);
        positions().max_by(|one, other| distance(one).total_cmp(&distance(other)))
    };
    let middle = positions().sum::<DVec3>() / members.len() as f64;
    let distance = |at: &DVec3| at.distance_squared(middle);
    let position_m = positions().min_by(|one, other| distance(one).total_cmp(&distance(other)))?;
    let end = farther(middle)?;
    Some(ThinPlace {
        thickness_m: thicknesses_m[(THINNEST_SHARE * members.len() as f64) as usize],
        position_m,
        length_m: farther(end)?.distance(end),
        n_cells: members.len(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::TriangleMesh;
    use crate::mesh::primitives::Shape;
    use crate::mesh::validate::inspect;
    use crate::solid::{Solid, SolidOptions};
    use crate::spatial::testing::Random;
    use crate::voxmap::Options;
    use crate::voxmap::accuracy::Truth;
    use crate::voxmap::accuracy::tests::{block, with};
    use glam::DQuat;

    const MM: f64 = 1e-3;

    fn found(mesh: &TriangleMesh, voxel_mm: f64) -> Vec<ThinPlace> {
        let options = Options { layers: 4, ..Options::new(voxel_mm * MM) };
        let map = Volume::build(mesh, &inspect(mesh), &options, |_| ()).expect("a small grid");
        Truth::of(&map, mesh).thin_places()
    }

    fn moved(mut mesh: TriangleMesh, by_mm: DVec3) -> TriangleMesh {
        mesh.vertices.iter_mut().for_each(|at| *at += by_mm * MM);
        mesh
    }

    fn turned(mut mesh: TriangleMesh, turn: DQuat) -> TriangleMesh {
        mesh.vertices.iter_mut().for_each(|at| *at = turn * *at);
        mesh
    }

    fn without(mesh: TriangleMesh, leaves: impl Fn([DVec3; 3]) -> bool) -> TriangleMesh {
        let kept = (0..mesh.triangles.len()).filter(|idx| !leaves(mesh.corners(*idx)));
        let triangles = kept.map(|idx| mesh.triangles[idx]).collect();
        TriangleMesh { triangles, ..mesh }
    }

    /// In any attitude, or, one in four, as it lies.
    fn attitude(random: &mut Random) -> DQuat {
        if random.unit() < 0.25 {
            return DQuat::IDENTITY;
        }
        DQuat::from_scaled_axis(random.in_box(-2.0, 2.0))
    }

    #[test]
    fn a_fin_of_less_than_a_hundredth_of_the_surface_is_named_with_place_and_cure() {
        // Of the sum of both surfaces, 8,000 mm², the fin has 40.
        let fin = moved(block([0.1, 5.0, 4.5]), DVec3::new(5.0, 2.0, 11.75));
        let mesh = with(block([40.0, 40.0, 20.0]), fin);
        let places = found(&mesh, 0.5);
        let [place] = places[..] else { panic!("{places:?}") };
        assert!((place.thickness_m / MM - 0.1).abs() < 1e-9, "{place:?}");
        let off = (place.position_m / MM - DVec3::new(5.0, 2.0, 12.0)).abs();
        assert!(off.cmple(DVec3::new(0.06, 1.0, 1.5)).all(), "{place:?}");
        // Its edges, where the way goes along it, do not count.
        assert!((4.0..6.4).contains(&(place.length_m / MM)), "{place:?}");
        let warning = ThinPlace::warning(&places, &SettingNames::PLAIN).expect("a place");
        let (what, rest) = warning.split_once(" near (").expect("a place");
        assert_eq!(
            what,
            "1 place is thinner than the voxels resolve and felt too weakly or not at all, 0.100 \
                mm thick"
        );
        assert!(rest.ends_with(" mm long; use voxels of 0.0500 mm, or a thin skin"), "{rest}");
        // Two of them; what would do for the thinner one does for both.
        let other = moved(block([3.0, 0.08, 4.0]), DVec3::new(-9.0, 2.0, 11.0));
        let warning = ThinPlace::warning(&found(&with(mesh, other), 0.5), &SettingNames::PLAIN)
            .expect("two places");
        assert!(
            warning.starts_with("2 places are thinner")
                && warning.contains(", the largest 0.100 mm thick near (5.")
                && warning.contains("; use voxels of 0.0400 mm, or"),
            "{warning}"
        );
        assert_eq!(ThinPlace::warning(&[], &SettingNames::PLAIN), None);
    }

    #[test]
    fn a_fin_pin_or_rib_thinner_than_a_voxel_is_named_in_any_attitude() {
        let mut random = Random(40);
        for n in 0..300 {
            let mut from_to = |low: f64, high: f64| low + (high - low) * random.unit();
            // In voxels, which are mm here.
            let base = [from_to(14.0, 24.0), from_to(14.0, 24.0), from_to(8.0, 12.0)];
            let thick = from_to(0.1, 0.9);
            let (across, above) = match n % 3 {
                0 => ([thick, from_to(5.0, 12.0)], from_to(6.0, 12.0)),
                1 => ([thick, from_to(0.1, 1.0).max(thick)], from_to(8.0, 14.0)),
                _ => ([thick, from_to(10.0, 13.0)], from_to(4.5, 6.0)),
            };
            // One voxel of it is in the block.
            let size = DVec3::new(across[0], across[1], above + 1.0);
            let at =
                DVec3::new(from_to(-3.0, 3.0), from_to(-0.4, 0.4), 0.5 * (base[2] + above - 1.0));
            let turn = attitude(&mut random);
            let feature = moved(block(size.to_array()), at);
            let mesh = turned(with(block(base), feature), turn);
            let shift = random.in_box(-3.0, 3.0);
            let places = found(&moved(mesh, shift), 1.0);
            let what = format!("{n}: {size} {places:?}");
            let [place] = places[..] else { panic!("{what}") };
            // A pin has two thicknesses.
            let found_mm = place.thickness_m / MM;
            assert!(across.iter().any(|right_mm| (found_mm - right_mm).abs() < 1e-6), "{what}");
            let own = turn.inverse() * (place.position_m / MM - shift) - at;
            assert!(
                own.abs().cmple(0.5 * size + 1e-6).all() && own.z > 1.0 - 0.5 * size.z,
                "{what}"
            );
            let longest = size.with_z(above).length();
            assert!((0.4 * above..longest + 1e-6).contains(&(place.length_m / MM)), "{what}");
        }
    }

    #[test]
    fn what_is_two_voxels_thick_or_more_is_not_named_whatever_its_edges() {
        let mut random = Random(41);
        for n in 0..300 {
            let mut from_to = |low: f64, high: f64| low + (high - low) * random.unit();
            let mesh = match n % 6 {
                // Of exactly two voxels, too.
                0 => block([
                    from_to(8.0, 20.0),
                    from_to(8.0, 20.0),
                    from_to(2.0, 4.0).max(2.2) - 0.2,
                ]),
                1 => {
                    let fin = [from_to(2.0, 3.0).max(2.2) - 0.2, from_to(4.0, 12.0), 12.0];
                    let x = from_to(-4.0, 4.0);
                    let fin = moved(block(fin), DVec3::new(x, 0.3, 8.0));
                    with(block([16.0, 14.0, from_to(6.0, 9.0)]), fin)
                }
                2 => {
                    let radius_m = from_to(2.0, 9.0) * MM;
                    let height_m = from_to(3.0, 12.0) * MM;
                    Shape::Cylinder { radius_m, height_m }.tessellate(0.02 * MM)
                }
                3 => {
                    // An angle of 40° or more.
                    let height_mm = from_to(10.0, 20.0);
                    let radius_m = height_mm * from_to(0.364, 1.0) * MM;
                    let height_m = height_mm * MM;
                    Shape::Cone { radius_m, height_m }.tessellate(0.02 * MM)
                }
                4 => {
                    let major = from_to(6.0, 10.0);
                    let minor = from_to(1.5, 4.0);
                    Shape::Torus { major_m: major * MM, minor_m: minor * MM }.tessellate(0.02 * MM)
                }
                _ => {
                    let wall = from_to(2.0, 3.0);
                    let outer = DVec3::new(14.0, 12.0, 10.0);
                    let mut inner = block((outer - 2.0 * wall).to_array());
                    inner.triangles.iter_mut().for_each(|corners| corners.swap(0, 1));
                    with(block(outer.to_array()), inner)
                }
            };
            let turn = attitude(&mut random);
            let shift = random.in_box(-3.0, 3.0);
            let places = found(&moved(turned(mesh, turn), shift), 1.0);
            assert!(places.is_empty(), "{n}: {turn} {shift} {places:?}");
        }
    }

    #[test]
    fn the_voxels_that_are_advised_do() {
        for (thick, turn) in [(0.5, DQuat::IDENTITY), (0.7, DQuat::from_scaled_axis(DVec3::ONE))] {
            let fin = moved(block([thick, 6.0, 9.0]), DVec3::new(1.0, 0.0, 7.0));
            let mesh = turned(with(block([10.0, 10.0, 6.0]), fin), turn);
            assert_eq!(found(&mesh, 1.0).len(), 1);
            assert!(found(&mesh, 0.5 * thick).is_empty());
        }
    }

    #[test]
    fn a_fin_on_a_part_with_a_lid_is_named_and_a_skin_beside_a_part_is_not() {
        let ball = Shape::Sphere { radius_m: 6.0 * MM }.tessellate(0.02 * MM);
        let fin = moved(block([0.3, 5.0, 10.0]), DVec3::new(1.0, 0.2, 8.0));
        let options = SolidOptions::resolved_by(None);
        let whole = Solid::of(&with(ball, fin), &options).border;
        let is_cap = |[a, b, c]: [DVec3; 3]| a.z.max(b.z).max(c.z) < -5.8 * MM;
        let open = without(whole, is_cap);
        let options = Options::new(0.5 * MM);
        let map = Volume::build(&open, &inspect(&open), &options, |_| ()).expect("a small grid");
        assert_eq!(map.basis, InsideBasis::Winding);
        let places = Truth::of(&map, &open).thin_places();
        let [place] = places[..] else { panic!("{places:?}") };
        assert!((place.thickness_m / MM - 0.3).abs() < 1e-6, "{place:?}");

        let sheet = without(block([6.0, 6.0, 1.0]), |corners| corners.iter().any(|at| at.z < 0.0));
        let beside = with(block([10.0, 10.0, 6.0]), moved(sheet, DVec3::new(20.0, 0.0, 0.0)));
        assert!(found(&beside, 0.5).is_empty());
    }
}
