//! Inside and outside of meshes that are not one closed, outward shell: what a user expects from a
//! solid.

use glam::{DQuat, DVec3};
use vps::mesh::primitives::Shape;
use vps::mesh::{TriangleMesh, mass, validate};
use vps::pointshell;
use vps::voxmap::fill::Side;
use vps::voxmap::grid::cell_of;
use vps::voxmap::inside_test::{InsideBasis, InsideTest};
use vps::voxmap::{Options, Volume};

use super::models;

const S: f64 = 1e-3;
const LAYERS: u32 = 4;

fn build(mesh: &TriangleMesh) -> Volume {
    build_as(mesh, InsideTest::Auto)
}

fn build_as(mesh: &TriangleMesh, sides: InsideTest) -> Volume {
    super::build_as(mesh, S, LAYERS, sides)
}

/// A box of edges in voxels around a centre in voxels.
fn cuboid(edges: [f64; 3], center: [f64; 3]) -> TriangleMesh {
    let mut mesh = Shape::Box { size_m: DVec3::from_array(edges) * S }.tessellate(1e-5);
    mesh.vertices.iter_mut().for_each(|vertex| *vertex += DVec3::from_array(center) * S);
    mesh
}

fn sphere(radius: f64) -> TriangleMesh {
    Shape::Sphere { radius_m: radius * S }.tessellate(0.02 * S)
}

fn joined(parts: &[TriangleMesh]) -> TriangleMesh {
    let mut whole = TriangleMesh::default();
    for part in parts {
        let first = whole.vertices.len() as u32;
        whole.vertices.extend(&part.vertices);
        whole
            .triangles
            .extend(part.triangles.iter().map(|triangle| triangle.map(|vertex| vertex + first)));
    }
    whole
}

fn inverted(mut mesh: TriangleMesh) -> TriangleMesh {
    mesh.triangles.iter_mut().for_each(|triangle| triangle.swap(0, 1));
    mesh
}

/// In general position, so that no face lies along the grid.
fn turned(mut mesh: TriangleMesh) -> TriangleMesh {
    let turn = DQuat::from_axis_angle(DVec3::new(0.3, -0.5, 0.8).normalize(), 0.7);
    mesh.vertices.iter_mut().for_each(|vertex| *vertex = turn * *vertex);
    mesh
}

/// A sphere without the triangles within `hole` voxels of its top.
fn holed_sphere(radius: f64, hole: f64) -> TriangleMesh {
    let mut mesh = turned(sphere(radius));
    let top = DVec3::Z * radius * S;
    let vertices = mesh.vertices.clone();
    mesh.triangles.retain(|corners| {
        corners.iter().any(|vertex| vertices[*vertex as usize].distance(top) > hole * S)
    });
    mesh
}

fn each_band_cell(map: &Volume) -> impl Iterator<Item = ([i32; 3], usize, usize)> + '_ {
    map.layers.bricks.iter().enumerate().flat_map(move |(slot, brick)| {
        let coord = map.layers.grid.brick_coord(*brick as usize);
        (0..512)
            .filter(move |inside| map.layers.values[slot][*inside].unsigned_abs() <= LAYERS as u8)
            .map(move |inside| (cell_of(coord, inside), slot, inside))
    })
}

/// Neighbours differ by one layer, signs are those of the sides, and next to the surface, where
/// forces begin, the field changes by no more than the way between two cells. Where a lid meets the
/// rim a gap of less than a voxel may remain.
fn assert_continuous(name: &str, map: &Volume, mesh: &TriangleMesh) {
    let distances = map.distances(mesh, false);
    let mut worst = 0.0_f64;
    for (cell, slot, inside) in each_band_cell(map) {
        let layer = map.layers.values[slot][inside];
        let value = f64::from(distances.values_m[slot][inside]) / S;
        match map.sides.side(&map.surface, cell) {
            Side::Surface => assert_eq!(layer, 0),
            Side::Inside => assert!(layer > 0 && value > 0.0, "{name} {cell:?}: {layer} {value}"),
            Side::Outside => assert!(layer < 0 && value < 0.0, "{name} {cell:?}: {layer} {value}"),
        }
        for offset in (0..27).map(|i| [i / 9 - 1, i / 3 % 3 - 1, i % 3 - 1]) {
            let other: [i32; 3] = core::array::from_fn(|axis| cell[axis] + offset[axis]);
            let (brick, there) = map.layers.grid.locate(other);
            let Some(slot) = map.layers.slot(brick) else { continue };
            let next = map.layers.values[slot][there];
            assert!((next - layer).abs() <= 1, "{name} {cell:?}: {layer} beside {next}");
            if layer.abs() <= 1 && next.abs() <= 1 {
                let way = f64::from(offset.iter().map(|step| step * step).sum::<i32>()).sqrt();
                worst =
                    worst.max((f64::from(distances.values_m[slot][there]) / S - value).abs() - way);
            }
        }
    }
    let allowed = if map.capped.is_some() { 1.0 } else { 1e-3 };
    eprintln!("{name}: the field jumps by {worst:.3} voxels more than the way");
    assert!(worst < allowed, "{name}: the field jumps by {worst} voxels more than the way");
}

/// Cells inside and half of the surface, in cells.
fn volume(map: &Volume) -> f64 {
    map.sides.count_inside(&map.surface) as f64 + 0.5 * map.surface.n_voxels as f64
}

/// The points of the shell that lie on the outer hull of a box, and whether their normals point
/// into it.
fn assert_box_normals(name: &str, map: &Volume, mesh: &TriangleMesh, half: DVec3, center: DVec3) {
    let mut on_hull = 0;
    for (position, normal) in pointshell::build(mesh, map, DVec3::ZERO).0.points() {
        let arm = (position.as_dvec3() / S - center) / half;
        let outermost = arm.abs().max_element();
        // Faces, away from edges, where the inward normal is known.
        let axis = (0..3).find(|axis| arm[*axis].abs() == outermost).expect("an axis");
        let others = [(axis + 1) % 3, (axis + 2) % 3];
        if outermost < 0.999
            || others.iter().any(|other| (1.0 - arm[*other].abs()) * half[*other] < 4.0)
        {
            continue;
        }
        on_hull += 1;
        let inward = -arm[axis].signum() * f64::from(normal[axis]);
        assert!(inward > 0.7, "{name}: normal {normal} at {arm}");
    }
    assert!(on_hull > 100, "{name}: {on_hull} points on the hull");
}

#[test]
fn parts_that_face_anyhow_overlap_touch_or_repeat_are_one_solid() {
    let one = || cuboid([20.0, 14.0, 16.0], [0.0; 3]);
    let mut every_third = one();
    every_third.triangles.iter_mut().step_by(3).for_each(|triangle| triangle.swap(0, 1));
    let mut repeated = one();
    repeated.triangles.extend(one().triangles.iter().step_by(2));
    let mut both_ways = one();
    both_ways.triangles.extend(inverted(one()).triangles);
    let twice =
        |second: TriangleMesh| joined(&[cuboid([12.0, 14.0, 16.0], [-4.0, 0.0, 0.0]), second]);
    let hundred: Vec<TriangleMesh> = (0..100)
        .map(|i| {
            cuboid(
                [4.0; 3],
                [
                    f64::from(i / 20 - 2) * 4.0,
                    f64::from(i / 5 % 4) * 4.0 - 6.0,
                    f64::from(i % 5 - 2) * 4.0,
                ],
            )
        })
        .collect();
    let cases = [
        ("a box", one(), [20.0, 14.0, 16.0]),
        ("inside out", inverted(one()), [20.0, 14.0, 16.0]),
        ("some faces inside out", every_third, [20.0, 14.0, 16.0]),
        ("some faces twice", repeated, [20.0, 14.0, 16.0]),
        ("all faces twice, both ways", both_ways, [20.0, 14.0, 16.0]),
        (
            "two that overlap",
            twice(cuboid([12.0, 14.0, 16.0], [4.0, 0.0, 0.0])),
            [20.0, 14.0, 16.0],
        ),
        (
            "two that overlap, one inside out",
            twice(inverted(cuboid([12.0, 14.0, 16.0], [4.0, 0.0, 0.0]))),
            [20.0, 14.0, 16.0],
        ),
        (
            "two that share a face",
            twice(cuboid([8.0, 14.0, 16.0], [6.0, 0.0, 0.0])),
            [20.0, 14.0, 16.0],
        ),
        (
            "one within another",
            joined(&[one(), cuboid([8.0, 4.0, 6.0], [0.0; 3])]),
            [20.0, 14.0, 16.0],
        ),
        ("a hundred that touch", joined(&hundred), [20.0, 16.0, 20.0]),
    ];
    for (name, mesh, edges) in cases {
        let map = build(&mesh);
        assert_eq!(
            (map.watertight, map.basis, map.capped.is_none()),
            (true, InsideBasis::Flood, true),
            "{name}"
        );
        assert_continuous(name, &map, &mesh);
        // Walls within the solid are surface voxels, counted half; so compare what is enclosed.
        let hull = map.sides.count_inside(&map.surface) + map.surface.n_voxels as u64;
        let expected = build(&cuboid(edges, [0.0; 3]));
        let filled =
            expected.sides.count_inside(&expected.surface) + expected.surface.n_voxels as u64;
        assert_eq!(hull, filled, "{name}");
        let low = mesh.bounds().expect("triangles").0 / S;
        let half = DVec3::from_array(edges) / 2.0;
        assert_box_normals(name, &map, &mesh, half, low + half);
        // Faces of the hull know which way is out.
        let border = map.mesh(&mesh);
        for triangle_idx in 0..border.triangles.len() {
            let [a, b, c] = border.corners(triangle_idx).map(|corner| corner / S - low - half);
            let normal = (b - a).cross(c - a).normalize();
            let middle = (a + b + c) / 3.0;
            let on_hull = (0..3)
                .any(|axis| normal[axis].abs() > 0.5 && middle[axis].abs() > half[axis] - 1e-6);
            if on_hull && name != "a hundred that touch" {
                let sign = map.orientation.sign(triangle_idx as u32);
                assert!(sign * normal.dot(middle) > 0.0, "{name}: triangle {triangle_idx}");
            }
        }
    }
}

#[test]
fn a_hole_of_several_voxels_gets_a_lid() {
    for (radius, hole) in [(16.0, 3.0), (20.0, 5.0), (16.0, 2.0)] {
        for invert in [false, true] {
            let mesh = if invert {
                inverted(holed_sphere(radius, hole))
            } else {
                holed_sphere(radius, hole)
            };
            let name = format!("radius {radius}, hole {hole}, inverted {invert}");
            let map = build(&mesh);
            assert!(
                !map.watertight && map.leak.is_some() && !map.thin,
                "{name}: {:?}",
                map.clear_share
            );
            assert_eq!(map.basis, InsideBasis::Winding, "{name}");
            let capped = map.capped.as_ref().expect("a lid");
            let disc_mm2 = core::f64::consts::PI * hole * hole;
            let area_mm2 = capped.area_m2 * 1e6;
            // It ends at the voxels of the rim.
            assert!(
                capped.n_lids == 1 && area_mm2 > 0.15 * disc_mm2 && area_mm2 < 1.5 * disc_mm2,
                "{name}: {area_mm2} for {disc_mm2}"
            );
            let exact = 4.0 / 3.0 * core::f64::consts::PI * radius.powi(3);
            assert!((volume(&map) / exact - 1.0).abs() < 0.03, "{name}: {}", volume(&map) / exact);
            assert_continuous(&name, &map, &mesh);
            // The lid has points like the rest, and all normals point inward.
            let shell = pointshell::build(&mesh, &map, DVec3::ZERO).0;
            let near_top =
                |position: DVec3| position.distance(DVec3::Z * radius * S) < 0.5 * hole * S;
            assert!(shell.points().any(|(position, _)| near_top(position.as_dvec3())), "{name}");
            for (position, normal) in shell.points() {
                let angle = normal.as_dvec3().angle_between(-position.as_dvec3()).to_degrees();
                assert!(angle < 40.0, "{name}: {angle}° at {position}");
            }
        }
    }
}

#[test]
fn a_box_of_loose_faces_with_gaps_is_closed() {
    // Six sheets that neither meet nor share a corner: gaps of two voxels along all edges.
    let mut mesh = TriangleMesh::default();
    let sheet = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
    for axis in 0..3 {
        for side in [-1.0, 1.0] {
            let first = mesh.vertices.len() as u32;
            mesh.vertices.extend(sheet.map(|[u, v]| {
                let mut corner = DVec3::ZERO;
                (corner[axis], corner[(axis + 1) % 3], corner[(axis + 2) % 3]) =
                    (16.0 * side, 14.0 * u * side, 14.0 * v);
                S * corner
            }));
            mesh.triangles.extend(
                [[0, 1, 2], [0, 2, 3]].map(|triangle| triangle.map(|vertex: u32| vertex + first)),
            );
        }
    }
    let mesh = turned(mesh);
    let map = build_as(&mesh, InsideTest::Winding);
    assert_eq!((map.watertight, map.basis), (false, InsideBasis::Winding));
    assert_continuous("loose faces", &map, &mesh);
    assert!(
        (volume(&map) / 32.0_f64.powi(3) - 1.0).abs() < 0.05,
        "{}",
        volume(&map) / 32.0_f64.powi(3)
    );
    assert_eq!(map.sides.side(&map.surface, cell_at(&map, DVec3::ZERO)), Side::Inside);
}

fn cell_at(map: &Volume, point: DVec3) -> [i32; 3] {
    map.surface.grid.to_cells(point).floor().as_ivec3().to_array()
}

#[test]
fn what_is_not_clear_becomes_a_thin_skin_and_says_how_unclear_it_is() {
    let mut tray = cuboid([20.0; 3], [0.0; 3]);
    let vertices = tray.vertices.clone();
    tray.triangles
        .retain(|corners| corners.iter().any(|vertex| vertices[*vertex as usize].z < 0.0));
    let mut bowl = turned(sphere(16.0));
    let vertices = bowl.vertices.clone();
    bowl.triangles
        .retain(|corners| corners.iter().any(|vertex| vertices[*vertex as usize].z < 0.0));
    // Closed at one end, three diameters long.
    let mut tube = Shape::Cylinder { radius_m: 8.0 * S, height_m: 48.0 * S }.tessellate(0.02 * S);
    let vertices = tube.vertices.clone();
    tube.triangles
        .retain(|corners| corners.iter().any(|vertex| vertices[*vertex as usize].z < 23.9 * S));
    let mut flipped = holed_sphere(16.0, 4.0);
    flipped.triangles.iter_mut().step_by(3).for_each(|triangle| triangle.swap(0, 1));
    for (name, mesh) in
        [("tray", tray), ("bowl", bowl), ("tube", tube), ("faces that contradict", flipped)]
    {
        let map = build(&mesh);
        eprintln!("{name}: clear {:?}", map.clear_share);
        assert!(
            map.thin && !map.watertight && map.capped.is_none(),
            "{name}: {:?} {:?}",
            map.basis,
            map.clear_share
        );
        assert!(map.clear_share.is_some_and(|share| share < 0.95), "{name}: {:?}", map.clear_share);
    }
}

#[test]
fn every_rule_does_what_it_says() {
    let ball = turned(sphere(12.0));
    let holed = holed_sphere(16.0, 4.0);
    let reported = |mesh: &TriangleMesh, rule| {
        let map = build_as(mesh, rule);
        (map.basis, map.sides.count_inside(&map.surface) > 0, map.watertight)
    };
    assert_eq!(reported(&ball, InsideTest::Auto), (InsideBasis::Flood, true, true));
    assert_eq!(reported(&ball, InsideTest::Flood), (InsideBasis::Flood, true, true));
    assert_eq!(reported(&ball, InsideTest::Winding), (InsideBasis::Winding, true, true));
    assert_eq!(reported(&ball, InsideTest::Thin), (InsideBasis::Thin, false, true));
    assert_eq!(reported(&holed, InsideTest::Auto), (InsideBasis::Winding, true, false));
    assert_eq!(reported(&holed, InsideTest::Flood), (InsideBasis::Flood, false, false));
    assert_eq!(reported(&holed, InsideTest::Winding), (InsideBasis::Winding, true, false));
    assert_eq!(reported(&holed, InsideTest::Thin), (InsideBasis::Thin, false, false));
    // A bowl on demand: filled to the brim.
    let mut bowl = turned(sphere(16.0));
    let vertices = bowl.vertices.clone();
    bowl.triangles
        .retain(|corners| corners.iter().any(|vertex| vertices[*vertex as usize].z < 0.0));
    let map = build_as(&bowl, InsideTest::Winding);
    assert_continuous("bowl", &map, &bowl);
    assert_eq!(map.sides.side(&map.surface, cell_at(&map, DVec3::Z * -4.0 * S)), Side::Inside);
    assert_eq!(map.sides.side(&map.surface, cell_at(&map, DVec3::Z * 10.0 * S)), Side::Outside);
}

#[test]
fn lids_are_the_same_on_one_and_two_threads() {
    let mesh = holed_sphere(20.0, 5.0);
    let bake = |n_threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().expect("a pool");
        pool.install(|| {
            let map = build(&mesh);
            let distances = map.distances(&mesh, false).values_m;
            let capped = map.capped.expect("a lid");
            (capped.mesh.triangles, capped.mesh.vertices, map.layers.values, distances)
        })
    };
    assert!(bake(1) == bake(2));
}

/// Scans with a hole where they stood become solids, whatever the resolution.
#[test]
fn a_scan_that_is_open_at_the_bottom_is_a_solid() {
    for (name, mesh) in models::all() {
        let (low, high) = mesh.bounds().expect("triangles");
        let extent = (high - low).max_element();
        let voxel_size_m = extent / 100.0;
        let options =
            Options { voxel_size_m, layers: LAYERS, navigation: None, sides: InsideTest::Auto };
        let report = validate::inspect(&mesh);
        let map = Volume::build(&mesh, &report, &options, |_| ()).expect("a grid that fits");
        let area_mm2 = map.capped.as_ref().map(|capped| capped.area_m2 * 1e6);
        eprintln!(
            "{name}: {:?}, clear {:?}, lids {area_mm2:?} mm², leak {:?}",
            map.basis, map.clear_share, map.leak
        );
        assert!(!name.contains("bunny") || map.basis != InsideBasis::Thin, "{name}");
    }
}

/// What lids close has the mass of the whole, whichever way its triangles face, and however large
/// the hole is.
#[test]
fn a_ball_with_a_hole_has_the_mass_of_a_ball() {
    let radius = 12.0;
    let whole = mass::mass_properties(&turned(sphere(radius)));
    for hole in [3.0, 8.0, 12.0] {
        // The lid is flat: what is above it is missing.
        let height = hole * hole / (2.0 * radius);
        let cut_m3 = core::f64::consts::PI * height * height * (radius - height / 3.0) * S.powi(3);
        for mesh in [holed_sphere(radius, hole), inverted(holed_sphere(radius, hole))] {
            let map = build_as(&mesh, InsideTest::Winding);
            assert!(map.capped.is_some(), "{hole}");
            let found = map.mass.expect("a mass");
            assert!(!found.from_surface, "{hole}");
            let right_m3 = whole.volume_m3 - cut_m3;
            let share = found.volume_m3 / right_m3;
            assert!((share - 1.0).abs() < 0.02, "{hole}: {share}");
            // The middle of what is cut off, above that of the ball.
            let above = 0.75 * (2.0 * radius - height).powi(2) / (3.0 * radius - height);
            let center_m = -DVec3::Z * above * S * cut_m3 / right_m3;
            assert!(found.center_m.distance(center_m) < 0.02 * radius * S, "{hole}: {found:?}");
        }
    }
}

/// A cube of 20 mm without its upper face.
fn tray() -> TriangleMesh {
    let mut tray = cuboid([20.0; 3], [0.0; 3]);
    let vertices = tray.vertices.clone();
    tray.triangles
        .retain(|corners| corners.iter().any(|vertex| vertices[*vertex as usize].z < 0.0));
    tray
}

#[test]
fn a_lid_is_as_large_as_its_hole() {
    for voxel_size_mm in [2.0, 1.0, 0.75, 0.5, 0.4, 0.3] {
        for (pose, mesh) in [("along the grid", tray()), ("turned", turned(tray()))] {
            let options = Options {
                voxel_size_m: voxel_size_mm * 1e-3,
                layers: LAYERS,
                navigation: None,
                sides: InsideTest::Winding,
            };
            let map = Volume::build(&mesh, &validate::inspect(&mesh), &options, |_| ())
                .expect("a grid that fits");
            let capped = map.capped.as_ref().expect("a lid");
            let area_mm2 = capped.area_m2 * 1e6;
            eprintln!(
                "{pose}, voxels of {voxel_size_mm} mm: {} lids, {area_mm2:.1} mm²",
                capped.n_lids
            );
            assert_eq!(capped.n_lids, 1, "{pose}, {voxel_size_mm} mm");
            // The rim's own voxels need no lid: they are a larger part of a hole of ten voxels.
            let least = if voxel_size_mm > 1.0 { 0.7 } else { 0.8 };
            assert!(
                (least..1.2).contains(&(area_mm2 / 400.0)),
                "{pose}, {voxel_size_mm} mm: {area_mm2} mm²"
            );
            // Nothing stands out of the lid: no voxel lies wholly above the rim.
            let rim = map.surface.grid.to_cells(DVec3::Z * 10e-3).z;
            let stands_out = |cell: &[i32; 3]| pose == "along the grid" && f64::from(cell[2]) > rim;
            assert!(
                !map.surface.cells().any(|cell| stands_out(&cell)),
                "{pose}, {voxel_size_mm} mm: a nub"
            );
        }
    }
}
