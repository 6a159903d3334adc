//! How far a query may be off.

use vps::spatial::testing::Random;
use vps::{ContactQuery, DQuat, DVec3, Mesh, Options, PointShell, Pose, Shape, Voxmap};

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

#[test]
fn explore() {
    let mut random = Random(1);
    let s = 0.4e-3;
    let cube = Shape::Box { size_m: DVec3::new(6e-3, 7e-3, 8e-3) };
    let ball = Shape::Sphere { radius_m: 4e-3 };
    let rod = Shape::Cylinder { radius_m: 3e-3, height_m: 7e-3 };
    let cone = Shape::Cone { radius_m: 3e-3, height_m: 6e-3 };
    for (on, obstacle) in [("cube", cube), ("ball", ball), ("rod", rod)] {
        for (tn, tool) in [("cube", cube), ("ball", ball), ("rod", rod), ("cone", cone)] {
            for ratio in [1.0, 0.5] {
                let mut rows: Vec<[f64; 6]> = Vec::new();
                for _ in 0..4 {
                    let baked = |shape: &Shape, turn: DQuat| {
                        let mesh = Mesh::from_shape(shape, 2e-6).unwrap();
                        let vertices: Vec<_> =
                            mesh.vertices().iter().map(|at| (turn * *at).to_array()).collect();
                        Mesh::from_arrays(&vertices, mesh.triangles()).unwrap()
                    };
                    let [own, other] = [turn(&mut random), turn(&mut random)];
                    let obstacle_mesh = baked(&obstacle, own);
                    let tool_mesh = baked(&tool, other);
                    let voxmap = Voxmap::bake(&obstacle_mesh, &Options::new(s)).unwrap();
                    let shell = PointShell::bake(&tool_mesh, &Options::new(s * ratio)).unwrap();
                    let query = ContactQuery::new(&voxmap, &shell, 1.0).unwrap();
                    let per = (s * ratio).powi(2);
                    for _ in 0..12 {
                        let way = DVec3::new(random.signed(), random.signed(), random.signed()).normalize();
                        let far = obstacle_mesh.vertices().iter().max_by(|a, b| a.dot(way).total_cmp(&b.dot(way))).unwrap();
                        // Between the extreme vertex and the place along the way.
                        let mut at = 0.0;
                        while depth_m(&obstacle, own.inverse() * (way * at)) > 0.0 { at += 1e-5; }
                        let on = if random.unit() < 0.4 { *far } else { way * at };
                        let rotation = turn(&mut random);
                        let low = tool_mesh.vertices().iter().map(|at| rotation * *at).min_by(|a, b| a.dot(way).total_cmp(&b.dot(way))).unwrap();
                        let deep = s * (0.1 + 1.9 * random.unit());
                        let pose = Pose::new(rotation, on - low - way * deep);
                        let mut exact = Exact { depth_m: 0.0, force: DVec3::ZERO };
                        for triangle in tool_mesh.triangles() {
                            let corners = triangle.map(|k| own.inverse() * pose.transform_point(tool_mesh.vertices()[k as usize]));
                            let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize_or_zero();
                            add(corners, normal, &obstacle, deep / 40.0, &mut exact);
                        }
                        if exact.depth_m <= 0.02 * s { continue; }
                        let force = own * exact.force / per;
                        let felt = query.wrench(pose).unwrap();
                        let rel = (felt.wrench.force - force).length() / force.length();
                        let d = exact.depth_m / s;
                        rows.push([(felt.penetration_m - exact.depth_m).abs() / s, rel, d, rel * d, voxmap.accuracy().surface_error_m.unwrap() / s, shell.accuracy().unseen_depth_m.unwrap() / s]);
                    }
                }
                let p = |k: usize, q: usize| { let mut v: Vec<f64> = rows.iter().map(|r| r[k]).collect(); v.sort_by(f64::total_cmp); v[(v.len() - 1) * q / 100] };
                eprintln!("{tn:5} in {on:5} {ratio}: n {} depth err/s p50 {:.3} p95 {:.3} max {:.3}; rel force p50 {:.4} p95 {:.4}; rel*d/s p50 {:.4} p95 {:.4} max {:.4}; surface {:.3} unseen {:.3}", rows.len(), p(0,50), p(0,95), p(0,100), p(1,50), p(1,95), p(3,50), p(3,95), p(3,100), p(4,95), p(5,95));
            }
        }
    }
}
