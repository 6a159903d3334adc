//! How far a query says that it may be off, against exact integrals.

use vps::spatial::testing::Random;
use vps::{
    ContactQuery, DQuat, DVec3, FieldKind, Mesh, Options, PointShell, Points, Pose, Shape, Voxmap,
};

fn turn(random: &mut Random) -> DQuat {
    DQuat::from_xyzw(random.signed(), random.signed(), random.signed(), random.signed()).normalize()
}

/// Depth in a convex part about the origin, m: greater than 0 inside, and no more than the distance
/// outside is it less.
fn depth_m(shape: &Shape, at: DVec3) -> f64 {
    match *shape {
        Shape::Box { size_m } => (0.5 * size_m - at.abs()).min_element(),
        Shape::Sphere { radius_m } => radius_m - at.length(),
        Shape::Cylinder { radius_m, height_m } => {
            (radius_m - at.truncate().length()).min(0.5 * height_m - at.z.abs())
        }
        _ => unreachable!("no other shapes here"),
    }
}

/// Greatest depth, and the integral of depth over the immersed surface along its inward normal.
struct Exact {
    depth_m: f64,
    force: DVec3,
}

fn add(corners: [DVec3; 3], normal: DVec3, shape: &Shape, fine_m: f64, exact: &mut Exact) {
    let middle = (corners[0] + corners[1] + corners[2]) / 3.0;
    let reach_m = corners.iter().map(|at| at.distance(middle)).fold(0.0, f64::max);
    let here_m = depth_m(shape, middle);
    if here_m + reach_m <= 0.0 {
        return;
    }
    if reach_m > fine_m {
        let [a, b, c] = corners;
        let [ab, bc, ca] = [(a + b) * 0.5, (b + c) * 0.5, (c + a) * 0.5];
        for part in [[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]] {
            add(part, normal, shape, fine_m, exact);
        }
        return;
    }
    for corner in corners {
        exact.depth_m = exact.depth_m.max(depth_m(shape, corner));
    }
    if here_m > 0.0 {
        let area = 0.5 * (corners[1] - corners[0]).cross(corners[2] - corners[0]).length();
        exact.force -= normal * (area * here_m);
    }
}

/// The mesh of a shape that lies askew in its grid.
fn askew(shape: &Shape, turn: DQuat) -> Mesh {
    let mesh = Mesh::from_shape(shape, 1e-5).unwrap();
    let vertices: Vec<_> = mesh.vertices().iter().map(|at| (turn * *at).to_array()).collect();
    Mesh::from_arrays(&vertices, mesh.triangles()).unwrap()
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn of_a_hundred_poses_at_most_five_are_off_by_more_than_a_query_says() {
    const VOXEL_M: f64 = 0.4e-3;
    let cube = Shape::Box { size_m: DVec3::new(6e-3, 7e-3, 8e-3) };
    let ball = Shape::Sphere { radius_m: 4e-3 };
    let rod = Shape::Cylinder { radius_m: 3e-3, height_m: 7e-3 };
    let cone = Shape::Cone { radius_m: 3e-3, height_m: 6e-3 };
    let mut random = Random(6);
    for (name, tool, obstacle, ratio) in [
        ("cube in cube", cube, cube, 1.0),
        ("ball in cube", ball, cube, 1.0),
        ("cone in cube", cone, cube, 0.5),
        ("ball in ball", ball, ball, 1.0),
        ("cone in ball", cone, ball, 1.0),
        ("cube in rod", cube, rod, 0.5),
        ("cone in rod", cone, rod, 1.0),
    ] {
        let spacing_m = ratio * VOXEL_M;
        // Exact error over what the query says, of depth and of force.
        let mut shares: Vec<[f64; 2]> = Vec::new();
        while shares.len() < 60 {
            let own = turn(&mut random);
            let obstacle_mesh = askew(&obstacle, own);
            let tool_mesh = askew(&tool, turn(&mut random));
            let voxmap = Voxmap::bake(&obstacle_mesh, &Options::new(VOXEL_M)).unwrap();
            let shell = PointShell::bake(&tool_mesh, &Options::new(spacing_m)).unwrap();
            let query = ContactQuery::new(&voxmap, &shell, spacing_m.powi(2)).unwrap();
            let error_m = query.error_m().unwrap();
            for _ in 0..15 {
                let way = DVec3::new(random.signed(), random.signed(), random.signed());
                let way = way.normalize_or(DVec3::X);
                let lowest = |mesh: &Mesh, turn: DQuat, way: DVec3| {
                    let vertices = mesh.vertices().iter().map(|at| turn * *at);
                    vertices.min_by(|a, b| a.dot(way).total_cmp(&b.dot(way))).unwrap()
                };
                // A corner or edge, or some place of the surface.
                let on = if random.unit() < 0.4 {
                    lowest(&obstacle_mesh, DQuat::IDENTITY, -way)
                } else {
                    let steps = (0..).map(|k| way * (f64::from(k) * 1e-5));
                    let mut outside =
                        steps.skip_while(|at| depth_m(&obstacle, own.inverse() * *at) > 0.0);
                    outside.next().unwrap()
                };
                let rotation = turn(&mut random);
                let asked_m = VOXEL_M * (0.1 + 1.9 * random.unit());
                let pose =
                    Pose::new(rotation, on - lowest(&tool_mesh, rotation, way) - way * asked_m);
                let mut exact = Exact { depth_m: 0.0, force: DVec3::ZERO };
                for triangle in tool_mesh.triangles() {
                    let corners = triangle.map(|vertex| {
                        own.inverse() * pose.transform_point(tool_mesh.vertices()[vertex as usize])
                    });
                    let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
                    add(corners, normal.normalize_or_zero(), &obstacle, asked_m / 25.0, &mut exact);
                }
                if exact.depth_m <= 0.02 * VOXEL_M {
                    continue;
                }
                let felt = query.wrench(pose).unwrap();
                let off_n = (felt.wrench.force - own * exact.force).length();
                shares.push([
                    (felt.penetration_m - exact.depth_m).abs() / error_m,
                    off_n / exact.force.length() / (error_m / felt.penetration_m).min(1.0),
                ]);
            }
        }
        for (what, which) in [("depth", 0), ("force", 1)] {
            let mut shares: Vec<f64> = shares.iter().map(|shares| shares[which]).collect();
            shares.sort_by(f64::total_cmp);
            let p95 = shares[shares.len() * 95 / 100];
            // A bound, and not one of another size.
            assert!(p95 < 1.0 + 1e-9 && p95 > 0.01, "{name}: {what}: {shares:?}");
        }
    }
}

#[test]
fn a_query_says_an_error_only_where_it_is_known() {
    let mesh = askew(&Shape::Sphere { radius_m: 4e-3 }, DQuat::IDENTITY);
    let options = Options::new(0.5e-3);
    let skin_options = Options { sides: vps::InsideTest::Thin, ..options };
    let go_on = |_| core::ops::ControlFlow::Continue(());
    let voxmap = Voxmap::bake(&mesh, &options).unwrap();
    let skin = Voxmap::bake(&mesh, &skin_options).unwrap();
    let shell = PointShell::bake(&mesh, &options).unwrap();
    let voxels = PointShell::bake_of(&mesh, &options, Points::Voxels, go_on).unwrap();
    let error_m = |voxmap, shell| ContactQuery::new(voxmap, shell, 1.0).unwrap().error_m();
    let own_m =
        voxmap.accuracy().surface_error_m.unwrap() + shell.accuracy().unseen_depth_m.unwrap();
    assert!((error_m(&voxmap, &shell).unwrap() - own_m - 0.05e-3).abs() < 1e-9);
    let loaded = PointShell::from_bytes(&voxels.to_bytes()).unwrap();
    for (voxmap, shell) in [(&skin, &shell), (&voxmap, &voxels), (&voxmap, &loaded)] {
        assert_eq!(error_m(voxmap, shell), None);
    }
    let mut query = ContactQuery::new(&voxmap, &shell, 1.0).unwrap();
    query.set_field(FieldKind::Octant).unwrap();
    assert_eq!(query.error_m(), None);
    let coarse = PointShell::bake(&mesh, &Options::new(1e-3)).unwrap();
    let both = ContactQuery::both_ways((&voxmap, &coarse), (&voxmap, &shell), 1.0).unwrap();
    assert_eq!(both.error_m(), error_m(&voxmap, &coarse));
}
