//! Are the parts sound, do they fit, and are the committed files these parts?

use std::collections::HashMap;
use std::f64::consts::{PI, TAU};
use std::path::{Path, PathBuf};

use glam::{DMat3, DQuat, DVec2, DVec3};

use vps::mesh::closest_point::TriangleProjector;

use crate::hand::{self, Hand};
use crate::mesh::Mesh;
use crate::parts::*;
use crate::thread::{self, N_COLUMNS, PITCH_MM};
use crate::{clay, gear::Gear, image, loft, outputs};

fn config_dir() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("config")
}

fn all_parts() -> [(&'static str, Mesh); 9] {
    [
        ("peg", peg()),
        ("block-hole", block_hole()),
        ("block-plugged", block_plugged()),
        ("gear-base", gear_base()),
        ("gear-fixed", gear_fixed()),
        ("gear-tool", gear_tool()),
        ("bolt", bolt()),
        ("nut", nut()),
        ("bowl", clay::bowl()),
    ]
}

fn volume_mm3(mesh: &Mesh) -> f64 {
    (0..mesh.triangles.len())
        .map(|triangle| mesh.corners(triangle))
        .map(|[a, b, c]| a.dot(b.cross(c)) / 6.0)
        .sum()
}

fn area_mm2(mesh: &Mesh) -> f64 {
    (0..mesh.triangles.len())
        .map(|triangle| mesh.corners(triangle))
        .map(|[a, b, c]| (b - a).cross(c - a).length() / 2.0)
        .sum()
}

fn bounds(mesh: &Mesh) -> (DVec3, DVec3) {
    let first = mesh.vertices[0];
    mesh.vertices
        .iter()
        .fold((first, first), |(low, high), vertex| (low.min(*vertex), high.max(*vertex)))
}

fn assert_close(what: &str, got: f64, expected: f64, tolerance: f64) {
    assert!(
        (got - expected).abs() <= tolerance,
        "{what}: {got}, expected {expected} ± {tolerance}"
    );
}

// Soundness.

#[test]
fn every_part_is_closed_and_oriented_outward() {
    for (name, mesh) in all_parts() {
        let mut edges: HashMap<[u32; 2], u32> = HashMap::new();
        for [a, b, c] in &mesh.triangles {
            for edge in [[*a, *b], [*b, *c], [*c, *a]] {
                *edges.entry(edge).or_default() += 1;
            }
        }
        for ([from, to], count) in &edges {
            assert_eq!(*count, 1, "{name}: edge {from}-{to} is walked twice in one direction");
            assert!(edges.contains_key(&[*to, *from]), "{name}: edge {from}-{to} is open");
        }
        assert!(volume_mm3(&mesh) > 0.0, "{name} is inside out");
        let mut used = vec![false; mesh.vertices.len()];
        mesh.triangles.iter().flatten().for_each(|vertex| used[*vertex as usize] = true);
        assert!(used.iter().all(|used| *used), "{name} has vertices without triangles");
        // Euler: V − E + T = 2 for a ball, 0 for a ring.
        let euler =
            mesh.vertices.len() as i64 - edges.len() as i64 / 2 + mesh.triangles.len() as i64;
        let expected = if ["gear-tool", "nut"].contains(&name) { 0 } else { 2 };
        assert_eq!(euler, expected, "{name}");
    }
}

#[test]
fn no_triangle_is_a_needle_of_no_area() {
    for (name, mesh) in all_parts() {
        for triangle in 0..mesh.triangles.len() {
            let [a, b, c] = mesh.corners(triangle);
            let doubled_mm2 = (b - a).cross(c - a).length();
            assert!(
                doubled_mm2 > 1e-7,
                "{name}: triangle {triangle} has twice the area {doubled_mm2:e} mm²"
            );
        }
    }
}

#[test]
fn sizes_are_those_of_the_drawing() {
    let corner_mm = ACROSS_FLATS_MM / 3.0_f64.sqrt();
    let tip_mm = tool_gear().tip_radius_mm();
    let cases = [
        ("peg", [-6.5, -6.5, 0.0], [6.5, 6.5, 40.0]),
        ("block-hole", [-20.0, -20.0, -25.0], [20.0, 20.0, 0.0]),
        ("block-plugged", [-20.0, -20.0, -25.0], [20.0, 20.0, 0.0]),
        ("gear-base", [-47.0, -24.0, -6.0], [17.0, 24.0, 24.0]),
        ("gear-fixed", [-20.0, -20.0, 0.0], [20.0, 20.0, 12.0]),
        ("gear-tool", [-tip_mm, -tip_mm, 0.0], [tip_mm, tip_mm, 8.0]),
        ("bolt", [-corner_mm, -12.0, 0.0], [corner_mm, 12.0, 40.0]),
        ("nut", [-corner_mm, -12.0, 0.0], [corner_mm, 12.0, 13.0]),
    ];
    for ((name, mesh), (case, low, high)) in all_parts().into_iter().zip(cases) {
        assert_eq!(name, case);
        let bounds = bounds(&mesh);
        // Round outlines are polygons: they may stay short of the circle, never beyond it.
        let slack_mm = if name.starts_with("gear-") && name != "gear-base" { 0.6 } else { 2e-5 };
        for axis in 0..3 {
            let slack_mm = if axis == 2 { 0.0 } else { slack_mm };
            assert!(
                bounds.0[axis] >= low[axis] - 1e-5 && bounds.0[axis] <= low[axis] + slack_mm,
                "{name}: {bounds:?}"
            );
            assert!(
                bounds.1[axis] <= high[axis] + 1e-5 && bounds.1[axis] >= high[axis] - slack_mm,
                "{name}: {bounds:?}"
            );
        }
    }
}

// Volumes.

/// Area of the polygon inscribed in the unit circle at these angles.
fn unit_polygon(angles: &[f64]) -> f64 {
    (0..angles.len())
        .map(|point| (angles[(point + 1) % angles.len()] - angles[point]).sin() / 2.0)
        .sum()
}

/// Integral of r² over a cone frustum's height: its volume in units of the unit polygon.
fn frustum(low_mm: f64, high_mm: f64, height_mm: f64) -> f64 {
    height_mm * (low_mm * low_mm + low_mm * high_mm + high_mm * high_mm) / 3.0
}

#[test]
fn round_parts_have_the_closed_form_volume() {
    let round = unit_polygon(&loft::even_angles(128));
    let expected =
        round * (frustum(3.0, 4.0, 1.0) + frustum(4.0, 4.0, 31.0) + frustum(6.5, 6.5, 8.0));
    assert_close("peg", volume_mm3(&peg()), expected, 1e-3 * expected.sqrt());
    assert_close(
        "peg against a true circle",
        volume_mm3(&peg()),
        expected * PI / round,
        1e-3 * expected,
    );

    let hole = unit_polygon(&loft::square(40.0).angles(128))
        * (frustum(4.8, 4.05, 0.75) + frustum(4.05, 4.05, 19.25));
    assert_close("block", volume_mm3(&block_hole()), 40.0 * 40.0 * 25.0 - hole, 0.02);
    assert_close("plugged block", volume_mm3(&block_plugged()), 40_000.0, 1e-9);

    let shaft = frustum(7.0, 7.0, 4.0) + frustum(4.0, 4.0, 19.0) + frustum(4.0, 3.0, 1.0);
    let expected = 64.0 * 48.0 * 6.0 + unit_polygon(&PLATE.angles(128)) * shaft;
    assert_close("plate", volume_mm3(&gear_base()), expected, 0.02);
}

#[test]
fn the_bowl_is_between_two_balls() {
    let bowl = clay::bowl();
    let [outer_mm, inner_mm] = [clay::BOWL_OUTER_MM, clay::BOWL_INNER_MM];
    let (sin, cos) = 10.0_f64.to_radians().sin_cos();
    // The shell of a sector of 80° about −z, without the cap below the foot, with half a torus as
    // its rim (Pappus).
    let shell_mm3 = 2.0 / 3.0 * PI * (outer_mm.powi(3) - inner_mm.powi(3)) * (1.0 - sin);
    let below_mm = outer_mm - clay::BOWL_CENTER_MM.z;
    let cap_mm3 = PI * below_mm * below_mm * (3.0 * outer_mm - below_mm) / 3.0;
    let middle_mm = 0.5 * (outer_mm + inner_mm);
    let half_mm = 0.5 * (outer_mm - inner_mm);
    let centroid_mm = middle_mm * cos + 4.0 * half_mm / (3.0 * PI) * sin;
    let rim_mm3 = 0.5 * PI * half_mm * half_mm * TAU * centroid_mm;
    let expected = shell_mm3 - cap_mm3 + rim_mm3;
    assert_close("bowl", volume_mm3(&bowl), expected, 0.01 * expected);
    let (low, high) = bounds(&bowl);
    assert_eq!(low.z, 0.0);
    assert_close("rim", high.z, clay::BOWL_CENTER_MM.z - middle_mm * sin + half_mm, 0.01);
    assert_close("width", high.x, middle_mm * cos + half_mm, 0.01);
}

#[test]
fn images_show_what_they_are_to_show() {
    let letter = image::letter();
    let grey = |x: usize, y: usize| letter.greys[y * letter.width + x];
    assert_eq!(
        [grey(40, 30), grey(40, 100), grey(64, 50), grey(88, 100)],
        [255; 4],
        "stem, arch and leg"
    );
    assert_eq!([grey(64, 100), grey(88, 30), grey(2, 64)], [0; 3], "between, beside and around");
    let world = image::continents();
    let at = |longitude: f64, latitude: f64| {
        let x = (longitude + 180.0) / 360.0 * world.width as f64;
        let y = (90.0 - latitude) / 180.0 * world.height as f64;
        world.greys[y as usize * world.width + x as usize]
    };
    let land = [
        (20.0, 5.0),
        (-55.0, -10.0),
        (-100.0, 45.0),
        (90.0, 50.0),
        (134.0, -25.0),
        (0.0, -85.0),
        (-40.0, 72.0),
    ];
    let sea = [(-30.0, 30.0), (-140.0, 0.0), (80.0, -20.0), (0.0, -45.0), (180.0, 20.0)];
    assert!(land.iter().all(|(longitude, latitude)| at(*longitude, *latitude) == 255));
    assert!(sea.iter().all(|(longitude, latitude)| at(*longitude, *latitude) == 0));
    for image in [letter, world] {
        let decoded = tiny_skia::Pixmap::decode_png(&image.to_png()).expect("a sound PNG");
        assert_eq!(
            [decoded.width() as usize, decoded.height() as usize],
            [image.width, image.height]
        );
        assert!(decoded.pixels().iter().map(|pixel| pixel.red()).eq(image.greys.iter().copied()));
    }
}

/// Area between the gear's axis and its true outline: the root disc and, above it, ∫ 2 ψ(r) r dr
/// per tooth.
fn gear_area_mm2(gear: &Gear) -> f64 {
    let root_mm = gear.root_radius_mm();
    let tip_mm = gear.tip_radius_mm();
    let n_steps = 20_000;
    let step_mm = (tip_mm - root_mm) / f64::from(n_steps);
    let teeth: f64 = (0..n_steps)
        .map(|step| root_mm + step_mm * (f64::from(step) + 0.5))
        .map(|radius_mm| 2.0 * gear.half_angle(radius_mm) * radius_mm * step_mm)
        .sum();
    PI * root_mm * root_mm + gear.n_teeth as f64 * teeth
}

#[test]
fn gears_have_the_volume_of_their_true_outline() {
    let [inset_mm, chamfer_mm] = TOOTH_CHAMFER_MM;
    let rim = |gear: &Gear| {
        let full = gear_area_mm2(gear);
        let inset = gear_area_mm2(&gear.inset(inset_mm));
        full * (FACE_WIDTH_MM - 2.0 * chamfer_mm) + (full + inset) * chamfer_mm
    };
    let expected = rim(&fixed_gear()) + PI * HUB_RADIUS_MM * HUB_RADIUS_MM * SEAT_MM;
    assert_close("fixed gear", volume_mm3(&gear_fixed()), expected, 3e-3 * expected);
    let bore = PI * (frustum(4.1, 4.1, 7.0) + 2.0 * frustum(4.1, 4.6, 0.5));
    let expected = rim(&tool_gear()) - bore;
    assert_close("tool gear", volume_mm3(&gear_tool()), expected, 3e-3 * expected);
}

/// Mean over one pitch of the squared radius of the basic profile grown by `offset_mm`: crest P/8,
/// root P/4, two flanks of 5P/16.
fn thread_mean_square(offset_mm: f64) -> f64 {
    let crest_mm = thread::MAJOR_RADIUS_MM + offset_mm;
    let root_mm = crest_mm - thread::depth_mm();
    crest_mm * crest_mm / 8.0 + root_mm * root_mm / 4.0 + frustum(root_mm, crest_mm, 0.625)
}

#[test]
fn threads_have_the_closed_form_volume() {
    let hexagon = 3.0_f64.sqrt() / 2.0 * ACROSS_FLATS_MM * ACROSS_FLATS_MM;
    // Chamfers cut a profile whose phase differs around: midpoint rule over one pitch of phases.
    let cut = |height_mm: f64, radius_mm: &dyn Fn(f64, f64) -> f64| {
        let n_phases = 96;
        let n_heights = 2000;
        let mut sum = 0.0;
        for phase in 0..n_phases {
            for step in 0..n_heights {
                let z_mm = height_mm * (f64::from(step) + 0.5) / f64::from(n_heights);
                let basic_mm =
                    thread::profile_mm(z_mm - PITCH_MM * f64::from(phase) / f64::from(n_phases));
                sum += radius_mm(basic_mm, z_mm).powi(2);
            }
        }
        PI * sum * height_mm / f64::from(n_phases * n_heights)
    };
    let expected = hexagon * 10.0
        + PI * 28.0 * thread_mean_square(0.0)
        + cut(2.0, &|basic_mm, z_mm| bolt_radius_mm(basic_mm, 38.0 + z_mm));
    assert_close("bolt", volume_mm3(&bolt()), expected, 2e-3 * expected);
    let hole = PI * 11.0 * thread_mean_square(THREAD_CLEARANCE_MM) + 2.0 * cut(1.0, &nut_radius_mm);
    assert_close("nut", volume_mm3(&nut()), hexagon * 13.0 - hole, 2e-3 * hole);
    assert_close(
        "minor diameter",
        2.0 * (8.0 - thread::depth_mm()),
        16.0 - 1.082_532 * PITCH_MM,
        1e-5,
    );
}

#[test]
fn tools_stay_small_as_pointshells() {
    for (name, mesh, voxel_mm) in
        [("peg", peg(), 0.4), ("gear-tool", gear_tool(), 0.5), ("nut", nut(), 0.5)]
    {
        let n_points = 1.5 * area_mm2(&mesh) / (voxel_mm * voxel_mm);
        println!("{name}: {:.0} mm², about {n_points:.0} points at {voxel_mm} mm", area_mm2(&mesh));
        assert!(n_points < 20_000.0, "{name}: {n_points}");
    }
}

// Fits.

#[test]
fn the_seated_peg_clears_the_hole() {
    let facet = (PI / 120.0).cos();
    for vertex in peg().vertices.iter().filter(|vertex| vertex.z - HOLE_DEPTH_MM < 0.0) {
        let clearance_mm = HOLE_RADIUS_MM * facet - vertex.truncate().length();
        assert!(clearance_mm > 0.045, "{vertex}: {clearance_mm}");
    }
}

fn turned(points: &[DVec2], angle: f64, shift: DVec2) -> Vec<DVec2> {
    let turn = DVec2::from_angle(angle);
    points.iter().map(|point| turn.rotate(*point) + shift).collect()
}

/// Distance from `point` to the polygon's outline, negative inside.
fn outline_distance(polygon: &[DVec2], point: DVec2) -> f64 {
    let mut nearest = f64::INFINITY;
    let mut inside = false;
    for (index, a) in polygon.iter().enumerate() {
        let b = polygon[(index + 1) % polygon.len()];
        let along = ((point - *a).dot(b - *a) / (b - *a).length_squared()).clamp(0.0, 1.0);
        nearest = nearest.min(point.distance(a.lerp(b, along)));
        if (a.y > point.y) != (b.y > point.y)
            && point.x < a.x + (b.x - a.x) * (point.y - a.y) / (b.y - a.y)
        {
            inside = !inside;
        }
    }
    if inside { -nearest } else { nearest }
}

/// Smallest distance between the outlines of both gears at the centre distance with the tool gear
/// turned by `angle` and the fixed gear rolled along, the tool `offset` off its axis; negative when
/// they overlap.
fn mesh_clearance(angle: f64, lead: f64, offset: DVec2) -> f64 {
    let fixed =
        turned(&fixed_gear().outline(), -angle * 20.0 / 30.0, DVec2::new(-CENTRE_DISTANCE_MM, 0.0));
    let tool = turned(&tool_gear().outline(), angle + lead, offset);
    let near = |points: &[DVec2]| {
        points.iter().copied().filter(|point| (point.x + 12.5).abs() < 4.0).collect::<Vec<_>>()
    };
    let tool_in_fixed = near(&tool)
        .into_iter()
        .map(|point| outline_distance(&fixed, point))
        .fold(f64::INFINITY, f64::min);
    near(&fixed)
        .into_iter()
        .map(|point| outline_distance(&tool, point))
        .fold(tool_in_fixed, f64::min)
}

#[test]
fn the_seated_gears_mesh_without_touching() {
    let seated_mm = mesh_clearance(0.0, 0.0, DVec2::ZERO);
    println!("gear clearance at the seat: {seated_mm:.4} mm");
    assert!(seated_mm > 0.08, "{seated_mm}");
    // Conjugate action: the clearance stays the same while they roll through two teeth.
    for step in 0..40 {
        let clearance_mm = mesh_clearance(step as f64 * TAU / 20.0 / 20.0, 0.0, DVec2::ZERO);
        assert!((0.08..0.1).contains(&clearance_mm), "step {step}: {clearance_mm}");
    }
    // The backlash: total 0.2 mm on the pitch circle, ±0.1 mm are ±0.46° of the tool gear.
    assert!(mesh_clearance(0.0, 0.40_f64.to_radians(), DVec2::ZERO) > 0.0);
    assert!(mesh_clearance(0.0, 0.55_f64.to_radians(), DVec2::ZERO) < 0.0);
    // The play of the bore does not jam the teeth.
    for step in 0..12 {
        let offset =
            DVec2::from_angle(step as f64 * TAU / 12.0) * (BORE_RADIUS_MM - SHAFT_RADIUS_MM);
        assert!(offset.y.abs() > 0.07 || mesh_clearance(0.0, 0.0, offset) > 0.0, "offset {offset}");
    }
}

#[test]
fn the_hand_meets_the_lead_in_of_the_gears() {
    // Where the tooth ends meet, both outlines are inset: the hand's error must fit between them.
    let inset = TOOTH_CHAMFER_MM[0];
    let tool =
        turned(&tool_gear().inset(inset).outline(), 0.4_f64.to_radians(), DVec2::new(0.1, -0.1));
    let fixed =
        turned(&fixed_gear().inset(inset).outline(), 0.0, DVec2::new(-CENTRE_DISTANCE_MM, 0.0));
    let near = tool.iter().filter(|point| (point.x + 12.5).abs() < 4.0);
    let clearance_mm =
        near.map(|point| outline_distance(&fixed, *point)).fold(f64::INFINITY, f64::min);
    assert!(clearance_mm > 0.2, "{clearance_mm}");
}

/// Triangles by their lowest z.
struct Surface {
    triangles: Vec<[DVec3; 3]>,
    tallest_mm: f64,
}

impl Surface {
    /// The triangles of a mesh whose first corner lies above this height.
    fn above(mesh: &Mesh, z_mm: f64) -> Self {
        let all = (0..mesh.triangles.len()).map(|triangle| mesh.corners(triangle));
        let mut triangles: Vec<_> = all.filter(|[first, ..]| first.z > z_mm).collect();
        triangles.sort_by(|one, other| Self::extent(one).0.z.total_cmp(&Self::extent(other).0.z));
        let heights = triangles.iter().map(Self::extent).map(|(low, high)| high.z - low.z);
        Self { tallest_mm: heights.fold(0.0, f64::max), triangles }
    }

    fn extent([a, b, c]: &[DVec3; 3]) -> (DVec3, DVec3) {
        (a.min(*b).min(*c), a.max(*b).max(*c))
    }

    /// Distance to the nearest of the triangles that come within `band_mm`; `band_mm` when none
    /// does.
    fn distance_mm(&self, point: DVec3, band_mm: f64) -> f64 {
        let first = self.triangles.partition_point(|corners| {
            Self::extent(corners).0.z < point.z - band_mm - self.tallest_mm
        });
        let level = self.triangles[first..]
            .iter()
            .take_while(|corners| Self::extent(corners).0.z <= point.z + band_mm);
        let near = level.filter(|corners| {
            let (low, high) = Self::extent(corners);
            point.cmpge(low - band_mm).all() && point.cmple(high + band_mm).all()
        });
        near.map(|corners| TriangleProjector::new(corners).project(point).distance_squared.sqrt())
            .fold(band_mm, f64::min)
    }
}

/// Corners, edge middles and centres of the triangles, as a cheap sampling of the surface.
fn samples(mesh: &Mesh) -> Vec<DVec3> {
    let mut points = mesh.vertices.clone();
    for triangle in 0..mesh.triangles.len() {
        let [a, b, c] = mesh.corners(triangle);
        points.extend([(a + b) / 2.0, (b + c) / 2.0, (c + a) / 2.0, (a + b + c) / 3.0]);
    }
    points
}

/// The nut `turns` clockwise turns after the start of its hand, millimetres.
fn nut_pose(turns: f64) -> (DMat3, DVec3) {
    (
        DMat3::from_rotation_z(-turns * TAU),
        DVec3::new(0.0, 0.0, hand::NUT_START_MM - turns * PITCH_MM),
    )
}

fn bolt_true_radius_mm(point: DVec3) -> f64 {
    bolt_radius_mm(thread::basic_radius_mm(point.y.atan2(point.x), point.z), point.z)
}

#[test]
fn the_nut_clears_the_bolt_all_around() {
    let bolt = bolt();
    let nut = nut();
    let bolt_surface = Surface::above(&bolt, 28.0);
    let nut_surface = Surface::above(&nut, f64::NEG_INFINITY);
    for turns in [0.0, 0.4, 1.5] {
        let (rotation, shift) = nut_pose(turns);
        let mut radial_mm = f64::INFINITY;
        let mut normal_mm = f64::INFINITY;
        let in_world = samples(&nut).into_iter().map(|point| rotation * point + shift);
        for point in in_world.filter(|point| point.z < 40.0 && point.truncate().length() < 9.0) {
            radial_mm = radial_mm.min(point.truncate().length() - bolt_true_radius_mm(point));
            normal_mm = normal_mm.min(bolt_surface.distance_mm(point, 0.2));
        }
        for point in bolt.vertices.iter().filter(|point| point.z > shift.z && point.z > 28.0) {
            let local = rotation.transpose() * (*point - shift);
            let nut_mm =
                nut_radius_mm(thread::basic_radius_mm(local.y.atan2(local.x), local.z), local.z);
            radial_mm = radial_mm.min(nut_mm - point.truncate().length());
            normal_mm = normal_mm.min(nut_surface.distance_mm(local, 0.2));
        }
        println!(
            "after {turns} turns: radial clearance {radial_mm:.4} mm, along the normal \
                {normal_mm:.4} mm"
        );
        assert!(radial_mm > 0.12, "{radial_mm}");
        assert!(normal_mm > 0.05, "{normal_mm}");
    }
}

#[test]
fn a_voxel_map_of_the_bolt_resolves_the_clearance() {
    // The exact distance at the corners of cells of the scene's voxel size, interpolated: as the
    // renderer will see it.
    let bolt = bolt();
    let nut = nut();
    let surface = Surface::above(&bolt, 32.0);
    let signed = |point: DVec3| {
        let outside = point.z > 40.0 || point.truncate().length() > bolt_true_radius_mm(point);
        let distance_mm = surface.distance_mm(point, 1.0);
        if outside { distance_mm } else { -distance_mm }
    };
    let voxel_mm = 0.2;
    let (rotation, shift) = nut_pose(0.0);
    let in_world = samples(&nut).into_iter().map(|point| rotation * point + shift);
    let inner: Vec<_> =
        in_world.filter(|point| point.z < 40.0 && point.truncate().length() < 9.0).collect();
    let mut lowest_mm = f64::INFINITY;
    for point in inner.iter().step_by(23) {
        let scaled = *point / voxel_mm - 0.37;
        let base = scaled.floor();
        let part = scaled - scaled.floor();
        let mut value_mm = 0.0;
        for corner in 0..8 {
            let step = DVec3::new(
                f64::from(corner & 1),
                f64::from(corner >> 1 & 1),
                f64::from(corner >> 2 & 1),
            );
            let weight = (DVec3::ONE - step - part).abs();
            value_mm += weight.element_product() * signed((base + step + 0.37) * voxel_mm);
        }
        lowest_mm = lowest_mm.min(value_mm);
    }
    println!("lowest interpolated clearance of the nut: {lowest_mm:.4} mm");
    assert!(lowest_mm > 0.02, "{lowest_mm}");
}

#[test]
fn the_thread_is_right_handed() {
    // A quarter turn counter-clockwise from above lifts the crest by a quarter pitch.
    assert_close(
        "crest",
        thread::basic_radius_mm(PI / 2.0, PITCH_MM / 4.0),
        thread::MAJOR_RADIUS_MM,
        1e-12,
    );
    let crest_mm = thread::MAJOR_RADIUS_MM;
    let at = |column: usize, z_mm: f64| {
        let turn = DVec2::from_angle(TAU * column as f64 / N_COLUMNS as f64) * crest_mm;
        bolt().vertices.iter().any(|vertex| vertex.distance(turn.extend(z_mm)) < 2e-5)
    };
    assert!(at(0, 20.0 + 0.125) && at(24, 20.5 + 0.125) && !at(24, 19.5 + 0.125 + 0.25));
}

// Files.

#[test]
fn committed_files_are_what_the_generator_writes() {
    let mut total = 0;
    for (name, content) in outputs() {
        let path = config_dir().join(name);
        let committed =
            std::fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        assert!(
            committed == content,
            "{name} differs: run `cargo run --release --example make_parts -- config`"
        );
        assert!(content.len() < 1_500_000, "{name}: {} bytes", content.len());
        total += content.len();
    }
    assert!(total < 4_000_000, "{total} bytes");
}

#[test]
fn an_stl_file_has_its_length_and_welds_again() {
    for (name, mesh) in all_parts() {
        let bytes = mesh.to_stl(name);
        assert_eq!(bytes.len(), 84 + 50 * mesh.triangles.len());
        let mut welded = std::collections::HashSet::new();
        for triangle in bytes[84..].as_chunks::<50>().0 {
            for corner in triangle[12..48].as_chunks::<12>().0 {
                welded.insert(*corner);
            }
        }
        assert_eq!(welded.len(), mesh.vertices.len(), "{name}");
    }
}

/// Scene, hand and the pose in which the hand leaves it: millimetres, degrees about z.
fn scenes() -> [(&'static str, Hand); 4] {
    [
        ("peg-in-hole", hand::peg_in_hole()),
        ("gear-on-shaft", hand::gear_on_shaft()),
        ("nut-on-bolt", hand::nut_on_bolt()),
        ("block-on-plane", hand::block_on_plane()),
    ]
}

/// Clay scene and hand.
fn clay_scenes() -> [(&'static str, Hand); 4] {
    [
        ("letter", clay::letter()),
        ("character", clay::character()),
        ("globe", clay::globe()),
        ("bowl", clay::around_the_bowl()),
    ]
}

fn rows(hand: &Hand) -> Vec<[f64; 8]> {
    let text = String::from_utf8(hand.to_csv()).expect("CSV is text");
    let mut lines = text.lines();
    assert_eq!(lines.next(), Some("t_s,x_m,y_m,z_m,qx,qy,qz,qw"));
    lines
        .map(|line| {
            assert!(!line.contains("-0.000000000"), "{line}");
            let numbers: Vec<f64> =
                line.split(',').map(|field| field.parse().expect("a number")).collect();
            numbers.try_into().expect("eight columns")
        })
        .collect()
}

#[test]
fn hands_are_smooth_and_stay_in_the_workspace() {
    for (name, hand) in
        scenes().into_iter().chain(clay_scenes()).chain([("nut-press", hand::nut_press())])
    {
        let rows = rows(&hand);
        let place = |row: &[f64; 8]| DVec3::new(row[1], row[2], row[3]) * 1000.0;
        let turn = |row: &[f64; 8]| DQuat::from_xyzw(row[4], row[5], row[6], row[7]);
        assert_eq!(rows[0][0], 0.0);
        for row in &rows {
            assert!(place(row).distance(place(&rows[0])) < 75.0, "{name}: {row:?}");
            assert!((turn(row).length() - 1.0).abs() < 2e-9, "{name}: {row:?}");
        }
        for pair in rows.windows(2) {
            let step_s = pair[1][0] - pair[0][0];
            assert!(step_s > 0.0 && step_s < 0.0201, "{name}: {pair:?}");
            assert!(
                place(&pair[1]).distance(place(&pair[0])) / step_s < 60.0,
                "{name}: faster than 60 mm/s: {pair:?}"
            );
            assert!(turn(&pair[0]).dot(turn(&pair[1])) > 0.999, "{name}: {pair:?}");
        }
    }
    assert_eq!(hand::nut_on_bolt().end(), (DVec3::new(0.0, 0.0, 31.0), -540.0));
}

#[test]
fn the_turning_nut_advances_one_pitch_per_turn() {
    let hand = hand::nut_on_bolt();
    for time_ms in (0..hand.duration_ms()).step_by(hand::STEP_MS as usize) {
        let (position_mm, turn_deg) = hand.at(time_ms);
        assert_close(
            "advance",
            hand::NUT_START_MM - position_mm.z,
            -turn_deg / 360.0 * PITCH_MM,
            1e-12,
        );
    }
}

#[test]
fn scenes_name_these_files_and_start_where_their_hands_start() {
    let numbers = |value: &toml::Value| -> Vec<f64> {
        let list = value.as_array().expect("a list");
        list.iter()
            .map(|number| number.as_float().expect("numbers are written with a point"))
            .collect()
    };
    let names: Vec<&str> = outputs().into_iter().map(|(name, _)| name).collect();
    let folder = config_dir().join("scenes");
    for (name, hand) in scenes() {
        let text = std::fs::read_to_string(folder.join(name).with_extension("toml"))
            .expect("the scene is there");
        let scene: toml::Table = text.parse().expect("the scene is TOML");
        let tool = scene["tool"].as_table().expect("a table");
        let objects = scene["static"]
            .as_array()
            .expect("a list")
            .iter()
            .map(|object| object.as_table().expect("a table"));
        for object in objects.chain([tool]) {
            if let Some(mesh) = object.get("mesh") {
                let mesh =
                    mesh.as_str().expect("a path").strip_prefix("../").expect("beside the scenes");
                assert!(names.contains(&mesh), "{name}: {mesh}");
                assert_eq!(object["units"].as_str(), Some("mm"), "{name}");
            }
        }
        assert_eq!(scene["device"]["hand"].as_str(), Some(format!("hands/{name}.csv").as_str()));
        let start_mm = numbers(&tool["start_position_mm"]);
        let first = rows(&hand)[0];
        for axis in 0..3 {
            assert_eq!(start_mm[axis] / 1000.0, first[axis + 1], "{name}");
        }
        assert_eq!(first[4..], [0.0, 0.0, 0.0, 1.0], "{name} starts without a turn");
        assert!(!tool.contains_key("start_orientation_xyzw"));
        if name == "gear-on-shaft" {
            let fixed = scene["static"][1].as_table().expect("a table");
            assert_eq!(numbers(&fixed["position_mm"]), [-CENTRE_DISTANCE_MM, 0.0, 0.0]);
        }
    }
}

#[test]
fn clay_scenes_name_these_files_and_have_the_sizes_that_their_hands_rely_on() {
    let numbers = |value: &toml::Value| -> Vec<f64> {
        value
            .as_array()
            .expect("a list")
            .iter()
            .map(|number| number.as_float().expect("numbers are written with a point"))
            .collect()
    };
    let read = |path: PathBuf| -> toml::Table {
        std::fs::read_to_string(path).expect("it is there").parse().expect("it is TOML")
    };
    let folder = config_dir().join("clay");
    let sphere = |shape: &toml::Value| shape["sphere_mm"].as_float().expect("a ball");
    for (name, hand) in clay_scenes() {
        let scene = read(folder.join(name).with_extension("toml"));
        let strokes = read(folder.join("strokes").join(name).with_extension("toml"));
        let strokes = strokes["stroke"].as_array().expect("a list");
        assert_eq!(scene["device"]["hand"].as_str(), Some(format!("hands/{name}.csv").as_str()));
        assert_eq!(
            scene["sculpt"]["strokes"].as_str(),
            Some(format!("strokes/{name}.toml").as_str())
        );
        let start_mm = numbers(&scene["tool"]["start_position_mm"]);
        let first = rows(&hand)[0];
        for axis in 0..3 {
            assert_close(name, start_mm[axis] / 1000.0, first[axis + 1], 1e-9);
        }
        let tool_mm = sphere(&scene["tool"]["shape"]);
        let clay = &scene["sculpt"];
        let expected_tool_mm = match name {
            "letter" => {
                assert_eq!(numbers(&clay["shape"]["box_mm"])[2], 2.0 * clay::PLATE_TOP_MM);
                assert_eq!(strokes[0]["depth_mm"].as_float(), Some(clay::LETTER_DEPTH_MM));
                let corner = clay::LETTER_CORNER_MM;
                assert_eq!(
                    numbers(&strokes[0]["corner_mm"]),
                    [corner.x, corner.y, clay::PLATE_TOP_MM]
                );
                assert_eq!(numbers(&strokes[0]["across_mm"]), [clay::LETTER_EDGE_MM, 0.0, 0.0]);
                clay::LETTER_TOOL_MM
            }
            "character" => {
                assert_eq!(sphere(&clay["shape"]), clay::BODY_MM);
                assert_eq!(sphere(&strokes[0]["shape"]), clay::HEAD_MM);
                assert_eq!(numbers(&strokes[0]["position_mm"]), clay::HEAD_CENTER_MM.to_array());
                clay::CHARACTER_TOOL_MM
            }
            "globe" => {
                assert_eq!(sphere(&clay["shape"]), clay::GLOBE_MM);
                assert_eq!(strokes[0]["depth_mm"].as_float(), Some(clay::LAND_MM));
                clay::GLOBE_TOOL_MM
            }
            _ => {
                assert_eq!(clay["mesh"].as_str(), Some("../models/bowl.obj"));
                clay::BOWL_TOOL_MM
            }
        };
        assert_eq!(tool_mm, expected_tool_mm, "{name}");
    }
}
