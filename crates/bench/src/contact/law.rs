//! The exact law: K/s² times the integral of depth over the immersed surface of the tool, both
//! parts as their meshes are.
//!
//! [`Solid`] knows the distance to the closest triangle of a mesh, and its sign by the normals of
//! the feature on which the closest point lies. [`Surface`] cuts the triangles of a tool until the
//! integral converges: an edge of at most the step, quadratic where a piece is immersed as a whole,
//! clipped along the boundary of the contact. Halving the step changes the force by less than a
//! thousandth, which a test proves.
//!
//! # Source
//! The law: the divergence theorem, as in `vps::pointshell`. Signs: Bærentzen and Aanæs 2005,
//! normals weighted by angle.

use core::ops::Range;
use std::collections::HashMap;

use glam::DVec3;

use vps::mesh::TriangleMesh;
use vps::mesh::closest_point::{TriangleFeature, TriangleProjector};
use vps::spatial::Pose;

/// Boxes around triangles, halved until few are left.
struct Tree {
    nodes: Vec<Node>,
    /// Triangles, node by node.
    order: Vec<u32>,
}

struct Node {
    low: DVec3,
    high: DVec3,
    range: Range<usize>,
    /// The second child, the first is the next node; none: a leaf.
    second: Option<usize>,
}

const LEAF_TRIANGLES: usize = 2;

impl Tree {
    fn new(mesh: &TriangleMesh) -> Self {
        let mut tree =
            Self { nodes: Vec::new(), order: (0..mesh.triangles.len() as u32).collect() };
        tree.split(mesh, 0..mesh.triangles.len());
        tree
    }

    fn split(&mut self, mesh: &TriangleMesh, range: Range<usize>) -> usize {
        let corners = self.order[range.clone()].iter().flat_map(|idx| mesh.corners(*idx as usize));
        let (low, high) = corners
            .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), at| {
                (low.min(at), high.max(at))
            });
        let idx = self.nodes.len();
        self.nodes.push(Node { low, high, range: range.clone(), second: None });
        if range.len() > LEAF_TRIANGLES {
            let size = high - low;
            let axis =
                if size.x >= size.max_element() { 0 } else { if size.y >= size.z { 1 } else { 2 } };
            let middle = |idx: &u32| {
                mesh.corners(*idx as usize).iter().map(|corner| corner[axis]).sum::<f64>()
            };
            let half = range.len() / 2;
            self.order[range.clone()]
                .select_nth_unstable_by(half, |one, other| middle(one).total_cmp(&middle(other)));
            self.split(mesh, range.start..range.start + half);
            self.nodes[idx].second = Some(self.split(mesh, range.start + half..range.end));
        }
        idx
    }
}

impl Node {
    fn distance_squared(&self, point: DVec3) -> f64 {
        (point.clamp(self.low, self.high) - point).length_squared()
    }

    fn center(&self) -> DVec3 {
        0.5 * (self.low + self.high)
    }

    fn radius(&self) -> f64 {
        0.5 * (self.high - self.low).length()
    }
}

/// A closed mesh with its exact distances.
pub(super) struct Solid {
    tree: Tree,
    triangles: Vec<TriangleProjector>,
    /// Outward, of the interior, the three edges and the three corners of each triangle.
    normals: Vec<[DVec3; 7]>,
}

/// What a solid is at a point.
#[derive(Clone, Copy)]
pub(super) struct Nearest {
    /// Positive inside, m.
    pub(super) depth_m: f64,
    /// Unit, at the closest point of the surface.
    pub(super) outward: DVec3,
}

impl Solid {
    /// Triangles of a closed mesh, counter-clockwise from outside.
    pub(super) fn new(mesh: &TriangleMesh) -> Self {
        let of_face = |idx: usize| {
            let [a, b, c] = mesh.corners(idx);
            (b - a).cross(c - a).normalize_or_zero()
        };
        let mut of_edges: HashMap<[u32; 2], DVec3> = HashMap::new();
        let mut of_vertices = vec![DVec3::ZERO; mesh.vertices.len()];
        let edge = |[from, to]: [u32; 2]| [from.min(to), from.max(to)];
        for (idx, vertices) in mesh.triangles.iter().enumerate() {
            let corners = mesh.corners(idx);
            let normal = of_face(idx);
            for k in 0..3 {
                let [at, next, last] = [0, 1, 2].map(|step| (k + step) % 3);
                *of_edges.entry(edge([vertices[at], vertices[next]])).or_default() += normal;
                let angle =
                    (corners[next] - corners[at]).angle_between(corners[last] - corners[at]);
                of_vertices[vertices[at] as usize] +=
                    normal * if angle.is_finite() { angle } else { 0.0 };
            }
        }
        let normals = mesh.triangles.iter().enumerate().map(|(idx, vertices)| {
            let [a, b, c] = *vertices;
            let [ab, bc, ca] = [[a, b], [b, c], [c, a]].map(|ends| of_edges[&edge(ends)]);
            let [a, b, c] = vertices.map(|vertex| of_vertices[vertex as usize]);
            [of_face(idx), ab, bc, ca, a, b, c].map(DVec3::normalize_or_zero)
        });
        Self {
            tree: Tree::new(mesh),
            normals: normals.collect(),
            triangles: (0..mesh.triangles.len())
                .map(|idx| TriangleProjector::new(&mesh.corners(idx)))
                .collect(),
        }
    }

    /// Cost: logarithmic in the number of triangles, near the surface.
    pub(super) fn at(&self, point: DVec3) -> Nearest {
        let mut best =
            (f64::INFINITY, Nearest { depth_m: f64::NEG_INFINITY, outward: DVec3::ZERO });
        self.search(0, point, &mut best);
        best.1
    }

    fn search(&self, idx: usize, point: DVec3, best: &mut (f64, Nearest)) {
        let node = &self.tree.nodes[idx];
        let Some(second) = node.second else {
            for triangle in &self.tree.order[node.range.clone()] {
                let found = self.triangles[*triangle as usize].project(point);
                if found.distance_squared < best.0 {
                    let feature = match found.feature {
                        TriangleFeature::Interior => 0,
                        TriangleFeature::Edge(k) => 1 + usize::from(k),
                        TriangleFeature::Vertex(k) => 4 + usize::from(k),
                    };
                    let outward = self.normals[*triangle as usize][feature];
                    let sign = if (point - found.point).dot(outward) > 0.0 { -1.0 } else { 1.0 };
                    *best = (
                        found.distance_squared,
                        Nearest { depth_m: sign * found.distance_squared.sqrt(), outward },
                    );
                }
            }
            return;
        };
        let mut children =
            [idx + 1, second].map(|child| (self.tree.nodes[child].distance_squared(point), child));
        if children[1].0 < children[0].0 {
            children.swap(0, 1);
        }
        for (distance_squared, child) in children {
            if distance_squared < best.0 {
                self.search(child, point, best);
            }
        }
    }
}

/// Depths change by at most so much per metre: 1 of exact distances, a little more of interpolated
/// ones.
const SLOPE: f64 = 1.2;
/// Every point of a triangle is at most so far from one of its corners, longest edges.
const COVER: f64 = 0.578;
/// Longest edge of the pieces among which the deepest point is looked for, m, and how often its
/// neighbourhood is halved.
const SEARCH_M: f64 = 4e-4;
const SEARCH_HALVINGS: usize = 8;

/// The triangles of a tool.
pub(super) struct Surface {
    tree: Tree,
    mesh: TriangleMesh,
}

/// The deepest point of a tool.
#[derive(Clone, Copy)]
pub(super) struct Deepest {
    pub(super) depth_m: f64,
    /// Tool axes.
    at: DVec3,
    triangle: usize,
}

impl Surface {
    pub(super) fn new(mesh: TriangleMesh) -> Self {
        Self { tree: Tree::new(&mesh), mesh }
    }

    pub(super) fn vertices(&self) -> &[DVec3] {
        &self.mesh.vertices
    }

    /// ∫ depth · inward normal dA over what is immersed, m³, world axes.
    pub(super) fn integral(
        &self,
        world_from_tool: Pose,
        step_m: f64,
        depth: &impl Fn(DVec3) -> f64,
    ) -> DVec3 {
        let mut sum = DVec3::ZERO;
        let mut known = self.unknown();
        self.integrate(0, world_from_tool, (step_m, depth), &mut known, &mut sum);
        sum
    }

    /// Depths of the vertices, several triangles each: not a number until a triangle asks.
    fn unknown(&self) -> Vec<f64> {
        vec![f64::NAN; self.mesh.vertices.len()]
    }

    /// Depths of the corners of a triangle, tool axes.
    fn depths(&self, triangle: u32, known: &mut [f64], depth: impl Fn(DVec3) -> f64) -> [f64; 3] {
        self.mesh.triangles[triangle as usize].map(|vertex| {
            let known = &mut known[vertex as usize];
            if known.is_nan() {
                *known = depth(self.mesh.vertices[vertex as usize]);
            }
            *known
        })
    }

    fn integrate(
        &self,
        idx: usize,
        pose: Pose,
        (step_m, depth): (f64, &impl Fn(DVec3) -> f64),
        known: &mut [f64],
        sum: &mut DVec3,
    ) {
        let node = &self.tree.nodes[idx];
        if depth(pose.transform_point(node.center())) + SLOPE * node.radius() <= 0.0 {
            return;
        }
        if let Some(second) = node.second {
            self.integrate(idx + 1, pose, (step_m, depth), known, sum);
            self.integrate(second, pose, (step_m, depth), known, sum);
            return;
        }
        for triangle in &self.tree.order[node.range.clone()] {
            let corners =
                self.mesh.corners(*triangle as usize).map(|corner| pose.transform_point(corner));
            let inward =
                (corners[2] - corners[0]).cross(corners[1] - corners[0]).normalize_or_zero();
            let depths = self.depths(*triangle, known, |at| depth(pose.transform_point(at)));
            *sum += inward * piece(corners, depths, step_m, depth);
        }
    }

    /// Where the tool is deepest in the solid, or nearest to it.
    pub(super) fn deepest(&self, world_from_tool: Pose, solid: &Solid) -> Deepest {
        let depth = |at: DVec3| solid.at(world_from_tool.transform_point(at)).depth_m;
        let mut best = Deepest { depth_m: f64::NEG_INFINITY, at: DVec3::ZERO, triangle: 0 };
        let root = &self.tree.nodes[0];
        self.seek(0, depth(root.center()) + root.radius(), &depth, &mut self.unknown(), &mut best);
        // Within the triangle that was found, along its edges.
        let corners = self.mesh.corners(best.triangle);
        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
        let edges = [0, 1, 2].map(|k| corners[(k + 1) % 3] - corners[k]);
        let is_inside =
            |at: DVec3| (0..3).all(|k| edges[k].cross(at - corners[k]).dot(normal) >= 0.0);
        let mut step_m = 0.5 * SEARCH_M;
        for _ in 0..SEARCH_HALVINGS {
            let ways = edges
                .map(DVec3::normalize_or_zero)
                .into_iter()
                .flat_map(|way| [way * step_m, -way * step_m]);
            for way in ways {
                while is_inside(best.at + way) && depth(best.at + way) > best.depth_m {
                    best = Deepest { depth_m: depth(best.at + way), at: best.at + way, ..best };
                }
            }
            step_m *= 0.5;
        }
        best
    }

    fn seek(
        &self,
        idx: usize,
        bound_m: f64,
        depth: &impl Fn(DVec3) -> f64,
        known: &mut [f64],
        best: &mut Deepest,
    ) {
        if bound_m <= best.depth_m {
            return;
        }
        let node = &self.tree.nodes[idx];
        let Some(second) = node.second else {
            for triangle in &self.tree.order[node.range.clone()] {
                let corners = self.mesh.corners(*triangle as usize);
                let depths = self.depths(*triangle, known, depth);
                seek_piece(corners, depths, *triangle as usize, depth, best);
            }
            return;
        };
        let mut children = [idx + 1, second].map(|child| {
            let node = &self.tree.nodes[child];
            (depth(node.center()) + node.radius(), child)
        });
        if children[1].0 > children[0].0 {
            children.swap(0, 1);
        }
        for (bound_m, child) in children {
            self.seek(child, bound_m, depth, known, best);
        }
    }

    /// Unit, out of the solid where the tool is deepest.
    pub(super) fn way_out(&self, world_from_tool: Pose, solid: &Solid, deepest: &Deepest) -> DVec3 {
        solid.at(world_from_tool.transform_point(deepest.at)).outward
    }
}

/// The longest edge of a triangle: its length, and the corner that it starts at.
fn longest(corners: &[DVec3; 3]) -> (f64, usize) {
    let length = |k: usize| (corners[(k + 1) % 3] - corners[k]).length();
    (0..3)
        .map(|k| (length(k), k))
        .fold((-1.0, 0), |best, next| if next.0 > best.0 { next } else { best })
}

/// The two halves of a triangle, cut across its longest edge, with the depths of their corners.
fn halves(
    corners: [DVec3; 3],
    depths: [f64; 3],
    first: usize,
    depth: &impl Fn(DVec3) -> f64,
) -> [([DVec3; 3], [f64; 3]); 2] {
    let [a, b, c] = [0, 1, 2].map(|step| (first + step) % 3);
    let middle = 0.5 * (corners[a] + corners[b]);
    let of_middle = depth(middle);
    [
        ([corners[a], middle, corners[c]], [depths[a], of_middle, depths[c]]),
        ([middle, corners[b], corners[c]], [of_middle, depths[b], depths[c]]),
    ]
}

fn seek_piece(
    corners: [DVec3; 3],
    depths: [f64; 3],
    triangle: usize,
    depth: &impl Fn(DVec3) -> f64,
    best: &mut Deepest,
) {
    for (at, depth_m) in corners.into_iter().zip(depths) {
        if depth_m > best.depth_m {
            *best = Deepest { depth_m, at, triangle };
        }
    }
    let (length_m, first) = longest(&corners);
    if length_m > SEARCH_M
        && depths.into_iter().fold(f64::MIN, f64::max) + COVER * length_m > best.depth_m
    {
        for (corners, depths) in halves(corners, depths, first, depth) {
            seek_piece(corners, depths, triangle, depth, best);
        }
    }
}

/// ∫ max(depth, 0) dA over a triangle.
fn piece(corners: [DVec3; 3], depths: [f64; 3], step_m: f64, depth: &impl Fn(DVec3) -> f64) -> f64 {
    let (length_m, first) = longest(&corners);
    if depths.into_iter().fold(f64::MIN, f64::max) + SLOPE * COVER * length_m <= 0.0 {
        return 0.0;
    }
    if length_m > step_m {
        return halves(corners, depths, first, depth)
            .map(|(corners, depths)| piece(corners, depths, step_m, depth))
            .iter()
            .sum();
    }
    let area = 0.5 * (corners[1] - corners[0]).cross(corners[2] - corners[0]).length();
    let [ab, bc, ca] = [0, 1, 2].map(|k| depth(0.5 * (corners[k] + corners[(k + 1) % 3])));
    let [a, b, c] = depths;
    if [a, b, c, ab, bc, ca].into_iter().all(|depth_m| depth_m >= 0.0) {
        return area / 3.0 * (ab + bc + ca);
    }
    0.25 * area
        * [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]].map(clipped).iter().sum::<f64>()
}

/// The mean of max(depth, 0) over a triangle between whose corners depth is linear.
fn clipped(depths: [f64; 3]) -> f64 {
    let n_inside = depths.iter().filter(|depth_m| **depth_m > 0.0).count();
    // With one corner inside: what is immersed is a triangle there.
    let one = |[a, b, c]: [f64; 3]| a / 3.0 * (a / (a - b)) * (a / (a - c));
    let sorted = |depths: [f64; 3]| {
        let mut depths = depths;
        depths.sort_by(|one, other| other.total_cmp(one));
        depths
    };
    match n_inside {
        0 => 0.0,
        1 => one(sorted(depths)),
        2 => depths.iter().sum::<f64>() / 3.0 + one(sorted(depths.map(|depth_m| -depth_m))),
        _ => depths.iter().sum::<f64>() / 3.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f64::consts::PI;
    use glam::DQuat;
    use vps::mesh::primitives::Shape;

    const R: f64 = 4e-3;

    fn slab() -> Solid {
        Solid::new(&Shape::Plane { x_m: 0.04, y_m: 0.04, thickness_m: 0.01 }.tessellate(0.0))
    }

    #[test]
    fn depths_are_exact_on_both_sides_of_faces_edges_and_corners() {
        let solid = Solid::new(&Shape::Box { size_m: DVec3::splat(2.0) }.tessellate(0.0));
        for (point, depth_m) in [
            (DVec3::new(0.1, 0.2, 0.5), 0.5),
            (DVec3::new(0.1, 0.2, 1.5), -0.5),
            (DVec3::new(1.3, 1.4, 0.1), -0.5),
            (DVec3::new(2.0, 2.0, 2.0), -(3.0_f64.sqrt())),
            (DVec3::new(0.9, 0.95, 0.99), 0.01),
        ] {
            assert!(
                (solid.at(point).depth_m - depth_m).abs() < 1e-12,
                "{point}: {}",
                solid.at(point).depth_m
            );
        }
    }

    #[test]
    fn over_a_plane_the_integral_is_the_volume_of_the_overlap() {
        let solid = slab();
        let ball = Surface::new(Shape::Sphere { radius_m: R }.tessellate(2e-7));
        for depth_m in [1.25e-4, 5e-4] {
            let pose = Pose::new(DQuat::from_rotation_x(0.3), DVec3::new(1e-3, 2e-3, R - depth_m));
            let cap_m3 = PI * depth_m * depth_m * (R - depth_m / 3.0);
            let found = ball.integral(pose, 1e-4, &|at| solid.at(at).depth_m);
            assert!(
                (found.z / cap_m3 - 1.0).abs() < 4e-3 && found.truncate().length() < 1e-3 * cap_m3,
                "{found} {cap_m3}"
            );
            assert!((ball.deepest(pose, &solid).depth_m / depth_m - 1.0).abs() < 4e-3);
        }
        // A face on a round obstacle is deepest in its middle.
        let round = Solid::new(&Shape::Sphere { radius_m: 0.01 }.tessellate(4e-7));
        let cube = Surface::new(Shape::Box { size_m: DVec3::splat(7e-3) }.tessellate(0.0));
        let deepest =
            cube.deepest(Pose::from_translation(DVec3::new(6e-4, 3e-4, 13.5e-3 - 1.25e-4)), &round);
        assert!((deepest.depth_m - 1.25e-4).abs() < 1e-6, "{}", deepest.depth_m);
    }

    #[test]
    fn halving_the_step_changes_less_than_a_thousandth() {
        let solid = Solid::new(&Shape::Torus { major_m: 0.012, minor_m: 0.004 }.tessellate(4e-7));
        let tools = [
            Shape::Sphere { radius_m: R },
            Shape::Box { size_m: DVec3::splat(7e-3) },
            Shape::Cylinder { radius_m: 3e-3, height_m: 8e-3 },
        ];
        for (tool, depth_m) in
            tools.into_iter().flat_map(|tool| [1.25e-4, 5e-4].map(|depth_m| (tool, depth_m)))
        {
            let surface = Surface::new(tool.tessellate(4e-7));
            let mut pose = Pose::new(DQuat::from_rotation_y(0.4), DVec3::new(0.012, 0.0, 0.011));
            for _ in 0..30 {
                pose.translation.z -= depth_m - surface.deepest(pose, &solid).depth_m;
            }
            let of = |step_m: f64| surface.integral(pose, step_m, &|at| solid.at(at).depth_m);
            let whole = of(super::super::curved::step_m(depth_m));
            let half = of(0.5 * super::super::curved::step_m(depth_m));
            assert!(
                (whole - half).length() < 1e-3 * half.length(),
                "{tool:?}, {depth_m}: {whole} {half}"
            );
        }
    }
}
