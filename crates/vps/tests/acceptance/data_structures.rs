//! Acceptance tests 2, 3, 4, 6, 7 and 8 (data structures), under their numbers.

use std::collections::BTreeSet;

use glam::DVec3;
use vps::mesh::TriangleMesh;
use vps::mesh::primitives::Shape;
use vps::pointshell;
use vps::pointshell::project::{SurfacePoint, project};
use vps::voxmap::Volume;
use vps::voxmap::fill::Side;
use vps::voxmap::grid::Grid;
use vps::voxmap::surface::{Navigation, Surface, visit_hits, visit_hits_by_brute_force};

use super::{build, models};

const S: f64 = 1e-3;

fn sphere(radius_in_voxels: f64, shift_in_voxels: DVec3) -> TriangleMesh {
    let mut mesh = Shape::Sphere { radius_m: radius_in_voxels * S }.tessellate(0.01 * S);
    mesh.vertices.iter_mut().for_each(|vertex| *vertex += shift_in_voxels * S);
    mesh
}

/// A sphere with a distant fleck in one corner of its box, so that the grid's offset relative to
/// the sphere varies.
fn sphere_at_offset(radius_in_voxels: f64, offset: DVec3) -> TriangleMesh {
    let mut mesh = sphere(radius_in_voxels, DVec3::ZERO);
    let corner = -(DVec3::splat(radius_in_voxels + 3.0) + offset) * S;
    let first = mesh.vertices.len() as u32;
    mesh.vertices.extend([corner; 3]);
    mesh.triangles.push([first, first + 1, first + 2]);
    mesh
}

fn on_threads<T: Send>(n_threads: usize, work: impl FnOnce() -> T + Send) -> T {
    rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().expect("a pool").install(work)
}

fn grid_for(mesh: &TriangleMesh, cells_on_longest_axis: f64) -> Grid {
    let (low, high) = mesh.bounds().expect("not empty");
    Grid::around(low, high, (high - low).max_element() / cells_on_longest_axis, 2)
        .expect("a grid that fits")
}

#[test]
fn acceptance_2_navigations_and_brute_force_mark_the_same_voxels() {
    let (mesh, voxel_size_m) = faces_on_voxel_boundaries();
    let (low, high) = mesh.bounds().expect("not empty");
    let lattice = Grid::around(low, high, voxel_size_m, 2).expect("a grid that fits");
    navigations_mark_the_same(vec![("faces on voxel boundaries".to_owned(), mesh, lattice)]);
    navigations_mark_the_same(primitives_at(60.0));
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn acceptance_2_over_fine_grids_and_real_meshes() {
    navigations_mark_the_same(primitives_at(151.3));
    for cells in [60.0, 151.3] {
        navigations_mark_the_same(
            models::all()
                .into_iter()
                .map(|(name, mesh)| in_grid(name.to_owned(), mesh, cells))
                .collect(),
        );
    }
}

fn in_grid(name: String, mesh: TriangleMesh, cells: f64) -> (String, TriangleMesh, Grid) {
    let grid = grid_for(&mesh, cells);
    (format!("{name} at {cells}"), mesh, grid)
}

fn primitives_at(cells: f64) -> Vec<(String, TriangleMesh, Grid)> {
    let shapes = [
        Shape::Box { size_m: DVec3::new(0.02, 0.03, 0.01) },
        Shape::Cylinder { radius_m: 0.01, height_m: 0.02 },
        Shape::Cone { radius_m: 0.01, height_m: 0.02 },
        Shape::Torus { major_m: 0.02, minor_m: 0.005 },
    ];
    shapes
        .iter()
        .map(|shape| in_grid(format!("{shape:?}"), shape.tessellate(1e-5), cells))
        .collect()
}

fn navigations_mark_the_same(meshes: Vec<(String, TriangleMesh, Grid)>) {
    for (name, mesh, grid) in meshes {
        let mut hit = BTreeSet::new();
        let mut tests = 0;
        for triangle_idx in 0..mesh.triangles.len() {
            let corners = mesh.corners(triangle_idx).map(|corner| grid.to_cells(corner));
            tests += visit_hits_by_brute_force(&corners, grid.dims, |cell| {
                hit.insert(cell);
            });
        }
        assert!(hit.len() > 1000, "{name}");
        let [plane, two, auto, whole] =
            [Navigation::PlaneSpan, Navigation::TwoSided, Navigation::Auto, Navigation::WholeBox]
                .map(|navigation| Surface::mark(&mesh, &grid, navigation));
        for marked in [&plane, &two, &auto, &whole] {
            assert!(
                marked.n_voxels == hit.len() && marked.cells().all(|cell| hit.contains(&cell)),
                "{name}: {:?}",
                marked.navigation
            );
        }
        assert!(
            two.sat_tests <= plane.sat_tests
                && plane.sat_tests <= whole.sat_tests
                && whole.sat_tests <= tests,
            "{name}"
        );
    }
}

/// A box around a smaller one whose faces lie exactly on voxel boundaries: touching from both sides
/// counts.
fn faces_on_voxel_boundaries() -> (TriangleMesh, f64) {
    const S: f64 = 1.0 / 1024.0;
    let mut mesh = Shape::Box { size_m: DVec3::splat(32.0 * S) }.tessellate(1e-5);
    let inner = Shape::Box { size_m: DVec3::splat(8.0 * S) }.tessellate(1e-5);
    let first = mesh.vertices.len() as u32;
    mesh.vertices.extend(inner.vertices.iter().map(|vertex| *vertex + 0.5 * S));
    mesh.triangles
        .extend(inner.triangles.iter().map(|triangle| triangle.map(|vertex| vertex + first)));
    (mesh, S)
}

#[test]
fn acceptance_3_sphere_counts_fill_and_volume() {
    for offset in [DVec3::ZERO, DVec3::new(0.3, 0.7, 0.1), DVec3::splat(0.5)] {
        let map = build(&sphere_at_offset(16.0, offset), S, 2);
        let surface = &map.surface;
        let area_in_faces = 4.0 * core::f64::consts::PI * 16.0 * 16.0;
        let ratio = surface.n_voxels as f64 / area_in_faces;
        assert!((ratio - 1.5).abs() <= 0.02, "surface voxels per A/s²: {ratio}");
        assert!(map.watertight);
        assert_eq!(map.sides.side(surface, [0, 0, 0]), Side::Outside);
        let volume = map.sides.count_inside(surface) as f64 + 0.5 * surface.n_voxels as f64;
        let exact = 4.0 / 3.0 * core::f64::consts::PI * 16_f64.powi(3);
        assert!((volume / exact - 1.0).abs() < 0.03, "{volume} against {exact}");
    }
}

/// The fill of the paper, voxel by voxel on a dense box with a LIFO stack and 6 neighbours.
fn dense_fill(surface: &Surface) -> Vec<Side> {
    let dims = surface.grid.dims.map(|n| n as i32);
    let index = |[x, y, z]: [i32; 3]| ((x * dims[1] + y) * dims[2] + z) as usize;
    let mut sides = vec![Side::Inside; surface.grid.n_cells() as usize];
    for cell in surface.cells() {
        sides[index(cell)] = Side::Surface;
    }
    let mut stack = vec![[0, 0, 0]];
    while let Some(cell) = stack.pop() {
        if !surface.grid.contains(cell) || sides[index(cell)] != Side::Inside {
            continue;
        }
        sides[index(cell)] = Side::Outside;
        for axis in 0..3 {
            for step in [-1, 1] {
                let mut next = cell;
                next[axis] += step;
                stack.push(next);
            }
        }
    }
    sides
}

fn each_cell(grid: &Grid) -> impl Iterator<Item = [i32; 3]> {
    let [nx, ny, nz] = grid.dims.map(|n| n as i32);
    (0..nx).flat_map(move |x| (0..ny).flat_map(move |y| (0..nz).map(move |z| [x, y, z])))
}

#[test]
fn acceptance_3_brick_fill_equals_the_voxelwise_fill_and_is_6_connected() {
    let mut meshes = vec![
        ("torus", Shape::Torus { major_m: 0.02, minor_m: 0.006 }.tessellate(1e-5)),
        ("sphere", sphere(16.0, DVec3::ZERO)),
    ];
    meshes.extend(models::all());
    for (name, mesh) in &meshes {
        let grid = grid_for(mesh, 90.0);
        let surface = Surface::mark(mesh, &grid, Navigation::PlaneSpan);
        let sides = vps::voxmap::fill::Sides::flood(&surface);
        let dense = dense_fill(&surface);
        for (cell, expected) in each_cell(&grid).zip(&dense) {
            assert_eq!(sides.side(&surface, cell), *expected, "{name} {cell:?}");
        }
        let inside = dense.iter().filter(|side| **side == Side::Inside).count() as u64;
        assert_eq!(sides.count_inside(&surface), inside, "{name}");
    }
}

#[test]
fn acceptance_4_layers_are_chebyshev_distances_with_the_right_sign() {
    const LAYERS: i32 = 5;
    for mesh in [
        sphere(9.0, DVec3::ZERO),
        Shape::Box { size_m: DVec3::new(0.018, 0.011, 0.025) }.tessellate(1e-5),
    ] {
        let map = build(&mesh, S, LAYERS as u32);
        let grid = &map.surface.grid;
        let surface: Vec<[i32; 3]> = map.surface.cells().collect();
        let mut seen = [false; 2 * LAYERS as usize + 3];
        for cell in each_cell(grid) {
            let value = i32::from(map.layers.value(cell));
            seen[(value + LAYERS + 1) as usize] = true;
            let nearest = surface
                .iter()
                .map(|other| {
                    (0..3).map(|axis| (other[axis] - cell[axis]).abs()).max().expect("three axes")
                })
                .min()
                .expect("some surface");
            assert_eq!(value.abs(), nearest.min(LAYERS + 1), "{cell:?}");
            match map.sides.side(&map.surface, cell) {
                Side::Surface => assert_eq!(value, 0),
                Side::Outside => assert!(value < 0, "{cell:?}"),
                Side::Inside => assert!(value > 0, "{cell:?}"),
            }
            for neighbour in neighbours_26(cell).filter(|neighbour| grid.contains(*neighbour)) {
                let other = i32::from(map.layers.value(neighbour));
                assert!(
                    (other - value).abs() <= 1,
                    "{cell:?} {value} beside {neighbour:?} {other}"
                );
            }
        }
        assert!(
            seen[1..=2 * LAYERS as usize].iter().all(|seen| *seen),
            "every layer on both sides"
        );
    }
}

fn neighbours_26([x, y, z]: [i32; 3]) -> impl Iterator<Item = [i32; 3]> {
    (0..27)
        .map(move |i| [x + i / 9 - 1, y + i / 3 % 3 - 1, z + i % 3 - 1])
        .filter(move |cell| *cell != [x, y, z])
}

#[test]
fn distances_are_exact_on_a_sphere_and_a_box_and_signed_in_surface_voxels() {
    let shift = DVec3::new(0.21, 0.37, 0.43);
    for (name, mesh, exact) in [
        (
            "sphere",
            sphere_at_offset(14.0, shift),
            Box::new(|p: DVec3| 14.0 * S - p.length()) as Box<dyn Fn(DVec3) -> f64>,
        ),
        (
            "box",
            Shape::Box { size_m: DVec3::new(0.018, 0.011, 0.025) }.tessellate(1e-5),
            Box::new(|p: DVec3| {
                let q = p.abs() - DVec3::new(0.009, 0.0055, 0.0125);
                -(q.max(DVec3::ZERO).length() + q.max_element().min(0.0))
            }),
        ),
    ] {
        let map = build(&mesh, S, 4);
        let distances = map.distances(&mesh, false);
        let mut errors = Vec::new();
        let mut fleck = 0;
        for (slot, brick) in map.layers.bricks.iter().enumerate() {
            for inside in 0..512 {
                let layer = map.layers.values[slot][inside];
                if layer.abs() > 4 {
                    continue;
                }
                let cell = vps::voxmap::grid::cell_of(
                    map.surface.grid.brick_coord(*brick as usize),
                    inside,
                );
                let center = map.surface.grid.center_map(cell);
                let expected = exact(center) / S;
                if expected < -8.0 {
                    fleck += 1; // The band around the fleck that shifts the grid.
                    continue;
                }
                errors.push((f64::from(distances.values_m[slot][inside]) / S - expected).abs());
            }
        }
        errors.sort_by(f64::total_cmp);
        let worst = errors[errors.len() - 1];
        let p99 = errors[errors.len() * 99 / 100];
        assert!(
            errors.len() > 10_000 && fleck < 2000,
            "{name}: {} cells, {fleck} of the fleck",
            errors.len()
        );
        assert!(p99 < 0.02 && worst < 0.1, "{name}: p99 {p99}, worst {worst} voxels");
    }
}

#[test]
fn acceptance_6_every_surface_voxel_owns_one_point_on_the_mesh() {
    let mut meshes = vec![
        ("sphere", sphere(16.0, DVec3::ZERO)),
        ("box", Shape::Box { size_m: DVec3::splat(0.02) }.tessellate(1e-5)),
    ];
    meshes.extend(models::all());
    for (name, mesh) in &meshes {
        let grid = grid_for(mesh, 80.0);
        let surface = Surface::mark(mesh, &grid, Navigation::PlaneSpan);
        let points = on_threads(1, || project(mesh, &surface));
        assert_eq!(
            points,
            on_threads(2, || project(mesh, &surface)),
            "{name}: same points on one and two threads"
        );
        let cells: Vec<[i32; 3]> = surface.cells().collect();
        assert_eq!(
            points.iter().map(|point| point.cell).collect::<Vec<_>>(),
            cells,
            "{name}: one point per voxel"
        );
        let mut phase2 = 0;
        for point in &points {
            let center =
                DVec3::new(point.cell[0].into(), point.cell[1].into(), point.cell[2].into()) + 0.5;
            assert!(
                (point.cells - center).length() <= 0.5 * 3_f64.sqrt() + 1e-9,
                "{name} {point:?}"
            );
            let corners =
                mesh.corners(point.triangle_idx as usize).map(|corner| grid.to_cells(corner));
            let (projection, _) = nearest_by_search(&corners, point.cells);
            assert!(
                (projection - point.cells).length() <= 1e-6,
                "{name} {point:?}: not on its triangle"
            );
            phase2 += usize::from(point.on_boundary);
        }
        eprintln!(
            "{name}: {} points, phase 2: {:.2} %",
            points.len(),
            100.0 * phase2 as f64 / points.len() as f64
        );
    }
}

/// Distance of each point to the nearest other one, by a search over all of them.
fn nearest_distances(points: &[DVec3], of: impl Fn(DVec3) -> bool) -> Vec<f64> {
    let others = |own: usize| {
        points.iter().enumerate().filter(move |(idx, _)| *idx != own).map(|(_, other)| *other)
    };
    let nearest = |own: usize| {
        others(own).map(|other| other.distance(points[own])).fold(f64::INFINITY, f64::min)
    };
    (0..points.len()).filter(|own| of(points[*own])).map(nearest).collect()
}

/// In voxels, from what a plane does to the lattice of centres: a touched voxel has a touched
/// neighbour across one of its sides, whose centre is one voxel away and projects no farther; and
/// no two touched voxels are nearer than the shortest projection of a step between them.
#[test]
fn acceptance_6_neighbours_on_a_flat_face_are_at_most_a_voxel_apart_and_no_nearer_than_the_lattice_allows()
 {
    let steps = |reach: i32| {
        let edge = move || -reach..=reach;
        let all = edge().flat_map(move |x| {
            edge().flat_map(move |y| edge().map(move |z| DVec3::new(x.into(), y.into(), z.into())))
        });
        all.filter(|step| *step != DVec3::ZERO)
    };
    for normal in [
        DVec3::new(0.1, 0.2, 1.0),
        DVec3::new(-0.4, 0.9, 0.7),
        DVec3::new(1.0, 0.9, 1.1),
        DVec3::new(0.02, -1.0, 0.3),
    ] {
        let normal = normal.normalize();
        let (along, across) = normal.any_orthonormal_pair();
        let middle = DVec3::new(0.31, 0.77, 0.13);
        let corners = [-0.9, 1.2, 3.3]
            .map(|angle: f64| middle + 40.0 * (angle.cos() * along + angle.sin() * across));
        let mesh = TriangleMesh {
            vertices: corners.map(|corner| corner * S).to_vec(),
            triangles: vec![[0, 1, 2]],
        };
        let (low, high) = mesh.bounds().expect("not empty");
        let grid = Grid::around(low, high, S, 1).expect("a grid that fits");
        let surface = Surface::mark(&mesh, &grid, Navigation::AUTO);
        let points: Vec<DVec3> = project(&mesh, &surface).iter().map(|point| point.cells).collect();
        let in_cells = mesh.corners(0).map(|corner| grid.to_cells(corner));
        // Voxels at the rim project onto it.
        let distances = nearest_distances(&points, |point| distance_to_rim(&in_cells, point) > 2.0);
        let span = normal.abs().element_sum();
        let shortest = steps(2)
            .filter(|step| step.dot(normal).abs() <= span)
            .map(|step| (step - normal * step.dot(normal)).length())
            .fold(f64::INFINITY, f64::min);
        assert!(distances.len() > 1000, "{normal}: {} points", distances.len());
        for distance in distances {
            assert!(
                distance <= 1.0 + 1e-9 && distance >= shortest - 1e-9,
                "{normal}: {distance}, at least {shortest}"
            );
        }
    }
}

#[test]
fn acceptance_6_neighbours_on_curved_and_edged_parts_are_some_half_a_voxel_to_a_voxel_apart() {
    let turn = glam::DQuat::from_axis_angle(DVec3::new(0.3, -0.5, 0.8).normalize(), 0.7);
    let turned = |mut mesh: TriangleMesh| {
        mesh.vertices.iter_mut().for_each(|vertex| *vertex = turn * *vertex);
        mesh
    };
    let meshes = [
        ("sphere", sphere(16.0, DVec3::new(0.21, 0.37, 0.43))),
        ("torus", turned(Shape::Torus { major_m: 0.02, minor_m: 0.006 }.tessellate(1e-5))),
        ("box", turned(Shape::Box { size_m: DVec3::new(0.03, 0.02, 0.01) }.tessellate(1e-5))),
        ("cone", turned(Shape::Cone { radius_m: 0.012, height_m: 0.02 }.tessellate(1e-5))),
    ];
    for (name, mesh) in meshes {
        let (low, high) = mesh.bounds().expect("not empty");
        let surface = Surface::mark(
            &mesh,
            &Grid::around(low, high, S, 1).expect("a grid that fits"),
            Navigation::AUTO,
        );
        let points: Vec<DVec3> = project(&mesh, &surface).iter().map(|point| point.cells).collect();
        let mut distances = nearest_distances(&points, |_| true);
        distances.sort_by(f64::total_cmp);
        let at = |share: f64| distances[(share * (distances.len() - 1) as f64) as usize];
        eprintln!(
            "{name}: {} points, neighbours at {:.3} {:.3} {:.3} {:.3} {:.3} voxels (least, 1 %, \
                half, 99 %, largest)",
            points.len(),
            at(0.0),
            at(0.01),
            at(0.5),
            at(0.99),
            at(1.0)
        );
        assert!(
            at(0.01) > 0.1 && (0.4..0.8).contains(&at(0.5)) && at(0.99) < 1.05 && at(1.0) < 1.3,
            "{name}"
        );
    }
}

/// In general position no voxel's centre projects on an edge by symmetry, so the phases are beyond
/// doubt.
#[test]
fn acceptance_6_phase_2_serves_only_voxels_without_a_projection_inside_a_triangle() {
    let coarse = |offset| {
        let mut mesh = Shape::Sphere { radius_m: 12.0 * S }.tessellate(0.3 * S);
        let turn = glam::DQuat::from_axis_angle(DVec3::new(0.3, -0.5, 0.8).normalize(), 0.7);
        mesh.vertices.iter_mut().for_each(|vertex| *vertex = turn * *vertex + offset);
        mesh
    };
    let mut phase2 = 0;
    for mesh in
        [coarse(DVec3::new(3.13e-4, 1.71e-4, 4.37e-4)), coarse(DVec3::new(1.1e-4, 7.7e-4, 2.9e-4))]
    {
        let grid = grid_for(&mesh, 61.7);
        let surface = Surface::mark(&mesh, &grid, Navigation::TwoSided);
        let points = project(&mesh, &surface);
        assert_phases("sphere", &mesh, &surface, &points);
        phase2 += points.iter().filter(|point| point.on_boundary).count();
    }
    assert!(phase2 > 10, "both phases must occur: {phase2}");
}

/// The two phases by their definition, with a search of its own: a voxel that any touching triangle
/// projects into has the nearest such point; only the others have the nearest point of an edge or
/// corner.
fn assert_phases(name: &str, mesh: &TriangleMesh, surface: &Surface, points: &[SurfacePoint]) {
    let mut best = vec![[f64::INFINITY; 2]; points.len()];
    for triangle_idx in 0..mesh.triangles.len() {
        let corners = mesh.corners(triangle_idx).map(|corner| surface.grid.to_cells(corner));
        visit_hits(&corners, surface.grid.dims, Navigation::PlaneSpan, |cell| {
            let center = DVec3::new(cell[0].into(), cell[1].into(), cell[2].into()) + 0.5;
            let (point, distance_squared) = nearest_by_search(&corners, center);
            let on_boundary = distance_to_rim(&corners, point) < 1e-9;
            let rank = surface.rank(cell).expect("a surface voxel");
            let best = &mut best[rank][usize::from(on_boundary)];
            *best = best.min(distance_squared);
        });
    }
    for (point, [interior, boundary]) in points.iter().zip(best) {
        let center =
            DVec3::new(point.cell[0].into(), point.cell[1].into(), point.cell[2].into()) + 0.5;
        let distance_squared = (point.cells - center).length_squared();
        let expected = if point.on_boundary { boundary } else { interior };
        assert!(
            (distance_squared - expected).abs() < 1e-6,
            "{name} {point:?}: {distance_squared} for {expected}"
        );
        assert!(
            !point.on_boundary || interior.is_infinite(),
            "{name} {point:?}: phase 1 had a point"
        );
    }
}

fn distance_to_rim(corners: &[DVec3; 3], point: DVec3) -> f64 {
    (0..3)
        .map(|idx| {
            let u = corners[idx];
            let v = corners[(idx + 1) % 3];
            let along = ((point - u).dot(v - u) / (v - u).length_squared().max(f64::MIN_POSITIVE))
                .clamp(0.0, 1.0);
            (u + (v - u) * along - point).length()
        })
        .fold(f64::INFINITY, f64::min)
}

/// Closest point of a triangle by search over its features, independent of the project's projector.
fn nearest_by_search([a, b, c]: &[DVec3; 3], p: DVec3) -> (DVec3, f64) {
    let on_segment = |u: DVec3, v: DVec3| {
        let along =
            ((p - u).dot(v - u) / (v - u).length_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
        u + (v - u) * along
    };
    let normal = (*b - *a).cross(*c - *a);
    let mut candidates = vec![on_segment(*a, *b), on_segment(*b, *c), on_segment(*c, *a)];
    if normal.length_squared() > 0.0 {
        let foot = p - normal * (p - *a).dot(normal) / normal.length_squared();
        let inside = [(*a, *b), (*b, *c), (*c, *a)]
            .iter()
            .all(|(u, v)| (*v - *u).cross(foot - *u).dot(normal) >= 0.0);
        if inside {
            candidates.push(foot);
        }
    }
    candidates
        .into_iter()
        .map(|candidate| (candidate, (candidate - p).length_squared()))
        .min_by(|x, y| x.1.total_cmp(&y.1))
        .expect("some candidate")
}

#[test]
fn acceptance_7_normals_on_a_sphere_are_inward_and_close() {
    for (radius, mean_max, worst_max) in [(16.0, 3.0, 12.0), (8.0, 4.0, 15.0)] {
        for offset in
            [DVec3::ZERO, DVec3::new(0.3, 0.7, 0.1), DVec3::splat(0.5), DVec3::new(0.25, 0.5, 0.75)]
        {
            // The tessellation's own facets must not show: it is 100 times finer than a voxel.
            let mesh = sphere_at_offset(radius, offset);
            let map = build(&mesh, S, 4);
            let (shell, report) = pointshell::build(&mesh, &map, DVec3::ZERO);
            assert_eq!(report.points, map.surface.n_voxels);
            let mut angles: Vec<f64> = shell
                .points()
                .map(|(position, normal)| (position.as_dvec3(), normal.as_dvec3()))
                .filter(|(position, _)| position.length() < (radius + 1.0) * S)
                .map(|(position, normal)| {
                    assert!((normal.length() - 1.0).abs() < 1e-6);
                    normal.angle_between(-position).to_degrees()
                })
                .collect();
            angles.sort_by(f64::total_cmp);
            let mean = angles.iter().sum::<f64>() / angles.len() as f64;
            let worst = angles[angles.len() - 1];
            assert!(
                mean <= mean_max && worst <= worst_max,
                "R = {radius} s, offset {offset}: mean {mean}°, worst {worst}°"
            );
        }
    }
}

#[test]
fn acceptance_7_normals_do_not_depend_on_the_winding_of_the_file() {
    let mesh = sphere(12.0, DVec3::ZERO);
    let mut flipped = mesh.clone();
    for triangle in flipped.triangles.iter_mut().step_by(3) {
        triangle.swap(0, 1);
    }
    let mut inverted = mesh.clone();
    inverted.triangles.iter_mut().for_each(|triangle| triangle.swap(0, 1));
    let shell_of = |mesh: &TriangleMesh| {
        pointshell::build(mesh, &build(mesh, S, 4), DVec3::ZERO).0.points().collect::<Vec<_>>()
    };
    let expected = shell_of(&mesh);
    for other in [shell_of(&flipped), shell_of(&inverted)] {
        for (a, b) in expected.iter().zip(&other) {
            assert!((a.0 - b.0).length() < 1e-8 && (a.1 - b.1).length() < 1e-6);
        }
    }
    // The field too: the sign inside surface voxels comes from the fill's verdict on each triangle.
    let distances = |mesh: &TriangleMesh| build(mesh, S, 4).distances(mesh, false).values_m;
    let expected = distances(&mesh);
    for other in [distances(&flipped), distances(&inverted)] {
        for (a, b) in expected.iter().flatten().zip(other.iter().flatten()) {
            assert!((a - b).abs() < 1e-7);
        }
    }
}

#[test]
fn baking_gives_the_same_bits_on_one_and_two_threads() {
    let mesh = Shape::Torus { major_m: 0.02, minor_m: 0.006 }.tessellate(1e-5);
    let bake = || {
        let map = build(&mesh, 5e-4, 4);
        let distances = map.distances(&mesh, true);
        let shell: Vec<_> = pointshell::build(&mesh, &map, DVec3::ZERO).0.points().collect();
        (map.layers.values, distances.values_m, distances.gradients, shell)
    };
    assert!(on_threads(1, bake) == on_threads(2, bake));
}

#[test]
fn an_open_box_leaks_and_becomes_a_thin_skin_but_a_slit_does_not() {
    let mut open = Shape::Box { size_m: DVec3::splat(0.02) }.tessellate(1e-5);
    // Drop the two triangles of the top face.
    let top = |vertices: &[DVec3], triangle: &[u32; 3]| {
        triangle.iter().all(|v| vertices[*v as usize].z > 0.0099)
    };
    let vertices = open.vertices.clone();
    open.triangles.retain(|triangle| !top(&vertices, triangle));
    let map = build(&open, S, 3);
    assert!(!map.watertight && map.thin);
    let leak = map.leak.expect("a hole");
    assert!((leak.position_m - DVec3::new(0.0, 0.0, 0.01)).length() < 2e-3, "{leak:?}");
    assert!((leak.size_m - 0.02).abs() < 1e-6, "{leak:?}");
    assert_eq!(map.sides.count_inside(&map.surface), 0);

    // The same box with every triangle on vertices of its own: all edges open or welded, no hole.
    let closed = Shape::Box { size_m: DVec3::splat(0.02) }.tessellate(1e-5);
    let mut soup = TriangleMesh::default();
    for idx in 0..closed.triangles.len() {
        let first = soup.vertices.len() as u32;
        soup.vertices.extend(closed.corners(idx));
        soup.triangles.push([first, first + 1, first + 2]);
    }
    assert!(build(&soup, S, 3).watertight);
}

/// The counts only: how the time grows is a matter of measuring, not of a test.
#[test]
fn acceptance_8_half_the_voxel_size_gives_four_times_the_points_and_eight_times_the_voxels() {
    let mut meshes = vec![
        ("sphere".to_owned(), sphere(40.0, DVec3::new(0.3, 0.1, 0.7))),
        ("torus".to_owned(), Shape::Torus { major_m: 0.04, minor_m: 0.012 }.tessellate(1e-5)),
    ];
    let wanted = ["factory_gear_medium_space_5e-4.obj", "rocker-arm.obj", "suzanne.obj"];
    meshes.extend(
        models::all()
            .into_iter()
            .filter(|(name, _)| wanted.contains(name))
            .map(|(name, mesh)| (name.to_owned(), mesh)),
    );
    for (name, mesh) in &meshes {
        let (low, high) = mesh.bounds().expect("not empty");
        let coarse_m = (high - low).max_element() / 150.0;
        let [coarse, fine] =
            [coarse_m, 0.5 * coarse_m].map(|voxel_size_m| build(mesh, voxel_size_m, 2));
        let points = |map: &Volume| pointshell::build(mesh, map, DVec3::ZERO).1.points as f64;
        let ratio = points(&fine) / points(&coarse);
        assert!((ratio / 4.0 - 1.0).abs() <= 0.1, "{name}: {ratio} times the points");
        // The padding is a matter of layers, not of the object: its volume is what the voxels
        // measure.
        let voxels = |map: &Volume| {
            map.sides.count_inside(&map.surface) as f64 + 0.5 * map.surface.n_voxels as f64
        };
        let ratio = voxels(&fine) / voxels(&coarse);
        assert!((ratio / 8.0 - 1.0).abs() <= 0.05, "{name}: {ratio} times the voxels");
    }
}
