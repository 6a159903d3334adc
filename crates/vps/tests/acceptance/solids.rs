//! Files of several shells, sheets and hollows: what a user feels of them.

use glam::{DQuat, DVec3, Vec3};
use vps::contact::{ContactSum, ForceLaw, Obstacle};
use vps::mesh::TriangleMesh;
use vps::mesh::primitives::Shape;
use vps::mesh::validate::inspect;
use vps::part::Part;
use vps::pointshell::shell::Shell;
use vps::pointshell::{Points, build_with};
use vps::solid::{Solid, SolidOptions};
use vps::spatial::Pose;
use vps::spatial::testing::Random;
use vps::voxmap::field::FieldKind;
use vps::voxmap::inside_test::InsideTest;
use vps::voxmap::{Options, Volume};

/// mm
const S: f64 = 0.25;
const K: f64 = ForceLaw::PLAIN.stiffness_n_per_m;

/// A box of edges in mm around a centre in mm.
fn cuboid(edges: [f64; 3], center: [f64; 3]) -> TriangleMesh {
    let mut mesh = Shape::Box { size_m: DVec3::from_array(edges) * 1e-3 }.tessellate(1e-5);
    mesh.vertices.iter_mut().for_each(|vertex| *vertex += DVec3::from_array(center) * 1e-3);
    mesh
}

fn joined(parts: &[TriangleMesh]) -> TriangleMesh {
    let mut whole = TriangleMesh::default();
    for part in parts {
        let first = whole.vertices.len() as u32;
        whole.vertices.extend(&part.vertices);
        let later = |triangle: &[u32; 3]| triangle.map(|vertex| vertex + first);
        whole.triangles.extend(part.triangles.iter().map(later));
    }
    whole
}

fn inverted(mut mesh: TriangleMesh) -> TriangleMesh {
    mesh.triangles.iter_mut().for_each(|triangle| triangle.swap(0, 1));
    mesh
}

/// A rectangle at a height in mm.
fn sheet(edges: [f64; 2], [x, y, z]: [f64; 3]) -> TriangleMesh {
    let corner = |u: f64, v: f64| DVec3::new(x + u * edges[0], y + v * edges[1], z) * 1e-3;
    TriangleMesh {
        vertices: vec![corner(-0.5, -0.5), corner(0.5, -0.5), corner(0.5, 0.5), corner(-0.5, 0.5)],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
    }
}

fn volume_of(mesh: &TriangleMesh, voxel_size_mm: f64, sides: InsideTest) -> Volume {
    let options = Options { sides, ..Options::new(voxel_size_mm * 1e-3) };
    Volume::build(mesh, &inspect(mesh), &options, |_| ()).expect("a small grid")
}

fn obstacle(mesh: &TriangleMesh) -> Vec<Obstacle> {
    obstacle_as(mesh, InsideTest::Auto)
}

fn obstacle_as(mesh: &TriangleMesh, sides: InsideTest) -> Vec<Obstacle> {
    let field = volume_of(mesh, S, sides).field(mesh, false);
    vec![Obstacle { field, world_from_map: Pose::IDENTITY }]
}

fn tool(mesh: &TriangleMesh, voxel_size_mm: f64) -> Shell {
    let map = volume_of(mesh, voxel_size_mm, InsideTest::Auto);
    build_with(Points::Facets, mesh, &map, DVec3::ZERO).0
}

/// Force of a tool whose origin is at a place in mm, N.
fn force_n(obstacles: &[Obstacle], shell: &Shell, at_mm: [f64; 3]) -> DVec3 {
    let pose = Pose::from_translation(DVec3::from_array(at_mm) * 1e-3);
    ContactSum::flat(obstacles, shell, pose, ForceLaw::PLAIN).wrench.force
}

fn plate() -> TriangleMesh {
    cuboid([40.0, 40.0, 10.0], [0.0, 0.0, -5.0])
}

/// A box of 4 × 4 mm pressed 1 mm into the top of the plate.
fn pressed_n(mesh: &TriangleMesh, at_mm: [f64; 2]) -> DVec3 {
    let shell = tool(&cuboid([4.0; 3], [0.0; 3]), S);
    force_n(&obstacle(mesh), &shell, [at_mm[0], at_mm[1], 1.0])
}

#[test]
fn what_lies_inside_of_a_body_does_not_change_its_force() {
    let alone_n = pressed_n(&plate(), [0.0; 2]);
    // 16 mm² a millimetre deep, at K for each s².
    let law_n = K * 1e-3 * 16.0 / (S * S);
    assert!((alone_n.z / law_n - 1.0).abs() < 0.02, "{alone_n} for {law_n} N");
    let within = cuboid([6.0, 6.0, 5.0], [0.0, 0.0, -3.5]);
    for (name, parts) in [
        ("a block", vec![plate(), within.clone()]),
        ("before the plate in the file", vec![within.clone(), plate()]),
        ("a block twice", vec![plate(), within.clone(), within.clone()]),
        ("a sheet", vec![plate(), sheet([20.0; 2], [0.0, 0.0, -0.6])]),
    ] {
        assert_eq!(pressed_n(&joined(&parts), [0.0; 2]), alone_n, "{name}");
    }
}

#[test]
fn blocks_that_touch_or_overlap_are_as_stiff_as_the_one_that_they_make() {
    let alone_n = pressed_n(&plate(), [0.0; 2]);
    let stacked = |height: f64, overlap: f64| {
        joined(&[
            cuboid([40.0, 40.0, height], [0.0, 0.0, -0.5 * height]),
            cuboid(
                [40.0, 40.0, 10.0 - height + overlap],
                [0.0, 0.0, -height - 0.5 * (10.0 - height - overlap)],
            ),
        ])
    };
    let beside = |overlap: f64| {
        joined(&[
            cuboid([20.0 + overlap, 40.0, 10.0], [-10.0 + 0.5 * overlap, 0.0, -5.0]),
            cuboid([20.0, 40.0, 10.0], [10.0, 0.0, -5.0]),
        ])
    };
    for (name, mesh) in [
        ("a layer of 0.4 mm", stacked(0.4, 0.0)),
        ("a layer of 5 mm", stacked(5.0, 0.0)),
        ("a layer that overlaps", stacked(0.4, 0.3)),
        ("side by side", beside(0.0)),
        ("side by side, overlapping", beside(3.0)),
    ] {
        let found_n = pressed_n(&mesh, [0.0; 2]);
        assert!((found_n - alone_n).length() < 1e-4 * alone_n.z, "{name}: {found_n}");
    }
}

#[test]
fn a_hollow_is_empty_unless_the_fill_is_asked_for() {
    let hollow = joined(&[cuboid([40.0; 3], [0.0; 3]), inverted(cuboid([30.0; 3], [0.0; 3]))]);
    let part = Part::new("housing", hollow.clone());
    let volume_mm3 = part.mass_properties().volume_m3 * 1e9;
    assert!((volume_mm3 - 37_000.0).abs() < 1e-3, "{volume_mm3}");
    let ball = tool(&Shape::Sphere { radius_m: 8e-3 }.tessellate(1e-5), S);
    for sides in [InsideTest::Auto, InsideTest::Winding] {
        let sum =
            ContactSum::flat(&obstacle_as(&hollow, sides), &ball, Pose::IDENTITY, ForceLaw::PLAIN);
        assert_eq!(sum.contacts, 0, "{sides:?}");
        // A millimetre into the wall, from the inside.
        let force = force_n(&obstacle_as(&hollow, sides), &ball, [8.0, 0.0, 0.0]);
        assert!(force.x < 0.0 && force.x.abs() > 10.0 * force.y.hypot(force.z), "{force}");
        let said = part.mesh_warnings(sides, None).join("\n");
        assert!(said.contains("a hollow of 27000 mm³: empty"), "{said}");
    }
    let filled = obstacle_as(&hollow, InsideTest::Flood);
    let sum = ContactSum::flat(&filled, &ball, Pose::IDENTITY, ForceLaw::PLAIN);
    assert!(sum.contacts > 500, "{}", sum.contacts);
    let said = part.mesh_warnings(InsideTest::Flood, None).join("\n");
    assert!(said.contains("a hollow of 27000 mm³: solid, by the flood fill"), "{said}");
}

#[test]
fn six_plates_around_a_hollow_are_a_hollow_box() {
    let whole = joined(&[cuboid([40.0; 3], [0.0; 3]), inverted(cuboid([30.0; 3], [0.0; 3]))]);
    let plates: Vec<TriangleMesh> = [
        ([40.0, 40.0, 5.0], [0.0, 0.0, 17.5]),
        ([40.0, 40.0, 5.0], [0.0, 0.0, -17.5]),
        ([40.0, 5.0, 30.0], [0.0, 17.5, 0.0]),
        ([40.0, 5.0, 30.0], [0.0, -17.5, 0.0]),
        ([5.0, 30.0, 30.0], [17.5, 0.0, 0.0]),
        ([5.0, 30.0, 30.0], [-17.5, 0.0, 0.0]),
    ]
    .map(|(edges, center)| cuboid(edges, center))
    .to_vec();
    let ball = tool(&Shape::Sphere { radius_m: 8e-3 }.tessellate(1e-5), S);
    for at_mm in [[0.0; 3], [7.6, 0.3, -0.2], [0.1, -0.3, 8.0]] {
        let found = force_n(&obstacle(&joined(&plates)), &ball, at_mm);
        let expected = force_n(&obstacle(&whole), &ball, at_mm);
        assert!((found - expected).length() <= 1e-4 * expected.length(), "{found}, {expected}");
    }
}

/// `check` knows the voxels and bakes nothing, so it has to join the same cracks.
#[test]
fn what_a_bake_says_of_the_pieces_of_a_file_is_said_without_a_bake_too() {
    for (gap_mm, joins) in [(0.02, true), (0.2, false)] {
        // Each face of the outer box ends that far before its edges.
        let whole = cuboid([20.0; 3], [0.0; 3]);
        let faces = whole.triangles.iter().map(|triangle| {
            let mut corners = triangle.map(|vertex| whole.vertices[vertex as usize]);
            let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize();
            let inner_m = 10e-3 - gap_mm * 1e-3;
            let clamped = |at: DVec3| at.clamp(DVec3::splat(-inner_m), DVec3::splat(inner_m));
            corners = corners.map(|at| clamped(at) + normal * (10e-3 - inner_m));
            TriangleMesh { vertices: corners.to_vec(), triangles: vec![[0, 1, 2]] }
        });
        let hollow = inverted(cuboid([10.0; 3], [0.0; 3]));
        let part = Part::new("cracked", joined(&faces.chain([hollow]).collect::<Vec<_>>()));
        for voxel_size_mm in [0.5, 0.4] {
            for (_, sides) in InsideTest::NAMES {
                let options = Options { sides, ..Options::new(voxel_size_mm * 1e-3) };
                let before = part.mesh_warnings(sides, Some(options.voxel_size_m));
                let (_, report) = part.bake_field(&options, false, |_| ()).expect("a small grid");
                for said in &before {
                    // A bake says how many, instead.
                    let is_said = said.contains("face inward") || report.warnings.contains(said);
                    assert!(is_said, "{sides:?} {voxel_size_mm} {gap_mm}: {said:?} {report:?}");
                }
                let of_hollow = before.iter().any(|said| said.contains("a hollow of 1000 mm³"));
                let is_asked = sides != InsideTest::Thin;
                assert_eq!(of_hollow, joins && is_asked, "{sides:?} {gap_mm}: {before:?}");
            }
            let wall_m = part.walls_and_edges(voxel_size_mm * 1e-3).thinnest_wall_m;
            assert_eq!(wall_m.is_some_and(|wall_m| wall_m < 6e-3), joins, "{wall_m:?}");
        }
    }
}

/// One piece, whose hollow the fill cannot enter.
#[test]
fn a_hollow_behind_a_slit_is_empty_however_narrow_the_slit_is() {
    let ball = tool(&Shape::Sphere { radius_m: 8e-3 }.tessellate(1e-5), 2.0 * S);
    for slit_voxels in [0.1, 0.4, 1.0, 2.5] {
        let slit = slit_voxels * S;
        let half = 20.0 - 0.5 * slit;
        let beside = 0.5 * (half + slit);
        let plates = [
            ([half, 40.0, 5.0], [beside, 0.0, 17.5]),
            ([half, 40.0, 5.0], [-beside, 0.0, 17.5]),
            ([40.0, 40.0, 5.0], [0.0, 0.0, -17.5]),
            ([40.0, 5.0, 30.0], [0.0, 17.5, 0.0]),
            ([40.0, 5.0, 30.0], [0.0, -17.5, 0.0]),
            ([5.0, 30.0, 30.0], [17.5, 0.0, 0.0]),
            ([5.0, 30.0, 30.0], [-17.5, 0.0, 0.0]),
        ];
        let plates = joined(&plates.map(|(edges, center)| cuboid(edges, center)));
        let housing = Solid::of(&plates, &SolidOptions::resolved_by(None)).border;
        let found = Solid::of(&housing, &SolidOptions::resolved_by(None)).report;
        assert_eq!((found.bodies, found.cavities.len()), (1, 0), "{slit_voxels}");
        let housing = obstacle(&housing);
        let depth_m = housing[0].field.value(
            FieldKind::Trilinear,
            ((DVec3::ZERO - housing[0].field.origin_map().as_dvec3()) / (S * 1e-3)).as_vec3(),
            Vec3::ZERO,
        );
        assert!(depth_m < 0.0, "{slit_voxels}: {depth_m}");
        let force = force_n(&housing, &ball, [1.0, 2.0, -3.0]);
        assert_eq!(force, DVec3::ZERO, "{slit_voxels}");
    }
}

#[test]
fn a_sheet_beside_a_body_is_a_skin_and_the_body_stays_solid() {
    let alone_n = pressed_n(&plate(), [0.0; 2]);
    let block = tool(&cuboid([4.0; 3], [0.0; 3]), S);
    for (name, skin) in [
        ("apart", sheet([6.0; 2], [30.0, 0.0, 0.0])),
        ("a fin on the body", {
            let mut fin = sheet([6.0; 2], [12.0, 0.0, 0.0]);
            fin.vertices
                .iter_mut()
                .for_each(|vertex| *vertex = DVec3::new(12e-3, vertex.y, vertex.x - 12e-3));
            fin
        }),
    ] {
        let mesh = joined(&[plate(), skin]);
        let map = volume_of(&mesh, S, InsideTest::Auto);
        assert!(!map.thin && map.leak.is_none(), "{name}");
        assert_eq!(map.beside.len(), 1, "{name}");
        let found_n = pressed_n(&mesh, [-10.0, 0.0]);
        assert!(
            (found_n - pressed_n(&plate(), [-10.0, 0.0])).length() < 1e-4 * alone_n.z,
            "{name}: {found_n}"
        );
    }
    // The sheet is felt from both sides, and pushes away.
    let with_sheet = obstacle(&joined(&[plate(), sheet([12.0; 2], [40.0, 0.0, 0.0])]));
    let above = force_n(&with_sheet, &block, [40.0, 0.0, 2.1]);
    let below = force_n(&with_sheet, &block, [40.0, 0.0, -2.1]);
    assert!(above.z > 1.0 && below.z < -1.0, "{above}, {below}");
    assert!(above.truncate().length() < 0.02 * above.z, "{above}");
}

#[test]
fn a_tool_of_shells_that_overlap_or_repeat_presses_as_the_solid_does() {
    let plate = obstacle(&plate());
    let whole = cuboid([6.0, 4.0, 4.0], [0.0; 3]);
    let twice = joined(&[whole.clone(), whole.clone()]);
    let overlapping =
        joined(&[cuboid([4.0; 3], [-1.0, 0.0, 0.0]), cuboid([4.0; 3], [1.0, 0.0, 0.0])]);
    for depth_mm in [0.3, 0.7, 1.0, 1.5] {
        let law_n = K * 1e-3 * depth_mm * 24.0 / (S * S);
        for (name, mesh) in [("one", &whole), ("twice", &twice), ("overlapping", &overlapping)] {
            let found = force_n(&plate, &tool(mesh, S), [0.0, 0.0, 2.0 - depth_mm]);
            assert!((found.z / law_n - 1.0).abs() < 0.02, "{name}, {depth_mm}: {found}, {law_n}");
        }
    }
}

#[test]
fn a_closed_thin_plate_presses_along_its_normal() {
    let plate = obstacle(&plate());
    let thin = cuboid([12.0, 10.0, 0.6], [0.0; 3]);
    for voxel_size_mm in [0.5, 1.0] {
        let shell = tool(&thin, voxel_size_mm);
        for depth_mm in [0.1, 0.3, 0.5] {
            let found = force_n(&plate, &shell, [0.1, -0.2, 0.3 - depth_mm]);
            let law_n = K * 1e-3 * depth_mm * 120.0 / (voxel_size_mm * voxel_size_mm);
            let angle = found.angle_between(DVec3::Z).to_degrees();
            assert!(angle < 2.0, "{voxel_size_mm} mm, {depth_mm} mm deep: {angle}°");
            let ratio = found.z / law_n;
            assert!((ratio - 1.0).abs() < 0.02, "{voxel_size_mm} mm, {depth_mm} mm deep: {ratio}");
        }
    }
}

/// Rods, plates and lattices from 0.3 to 3 voxels thick.
#[test]
fn no_thin_closed_tool_is_pulled_into_a_plane() {
    const VOXEL_MM: f64 = 1.0;
    let plate = obstacle(&plate());
    let mut random = Random(11);
    let mut worst = f64::INFINITY;
    for case in 0..60 {
        let thick = VOXEL_MM * (0.3 + 2.7 * (0.5 + 0.5 * random.signed()));
        let mesh = match case % 3 {
            0 => cuboid([14.0, thick, thick], [0.0; 3]),
            1 => cuboid([10.0, 8.0, thick], [0.0; 3]),
            _ => joined(&[
                cuboid([12.0, thick, thick], [0.0; 3]),
                cuboid([thick, 12.0, thick], [0.0; 3]),
            ]),
        };
        let shell = tool(&mesh, VOXEL_MM);
        let turn =
            DQuat::from_xyzw(random.signed(), random.signed(), random.signed(), random.signed())
                .normalize();
        let lowest_m =
            mesh.vertices.iter().map(|vertex| (turn * *vertex).z).fold(f64::INFINITY, f64::min);
        for depth_mm in [0.05, 0.2, 0.5, 1.0, 2.0] {
            let pose = Pose::new(turn, DVec3::Z * (-lowest_m - depth_mm * 1e-3));
            let force = ContactSum::flat(&plate, &shell, pose, ForceLaw::PLAIN).wrench.force;
            worst = worst.min(force.z);
            assert!(force.z >= 0.0, "case {case}, {thick} mm, {depth_mm} mm deep: {force}");
        }
    }
    assert!(worst.is_finite());
}
