//! Which closed pieces pass through themselves.
//!
//! Data in: the triangles by piece. Data out: the pieces of which an edge passes through a triangle
//! away from both, by more than the tolerance. Touching is no passing.
//!
//! Triangles that follow each other in a file mostly lie beside each other, so they are taken in
//! groups of [`GROUP`], with a box and a cone of normals each. Groups that share a vertex and face
//! nearly the same way are parts of one smooth sheet, which does not pass through itself; most
//! groups of a fine mesh that meet are such. Where the order of the file says nothing, triangles
//! are sorted by place first. Cost: about that of finding the edges of a file; n log n in groups.

use core::sync::atomic::{AtomicBool, Ordering};

use glam::DVec3;

use super::pieces::{NO_PIECE, Pieces};
use crate::mesh::TriangleMesh;
use crate::mesh::boxes::Boxes;
use crate::parallel;

/// Triangles that are looked at together.
const GROUP: usize = 16;

/// Largest angle between normals in one smooth sheet, rad.
const SMOOTH: f64 = 1.0;

/// Cells along each axis of the box of a file, by which triangles are sorted.
const CELLS: f64 = 1024.0;

/// A triangle: its piece and its corners. They are copied, as the file may have them in any order.
type Triangle = (u32, [u32; 3]);

/// Triangles of one piece, beside each other.
#[derive(Clone, Copy)]
struct Group<'a> {
    members: &'a [Triangle],
    low: DVec3,
    high: DVec3,
    /// The middle of the normals, and the largest angle of one with it, rad.
    axis: DVec3,
    angle: f64,
    /// The box is not longer than the triangles are in a row.
    is_together: bool,
}

impl Group<'_> {
    fn piece(&self) -> usize {
        self.members[0].0 as usize
    }
}

/// `[n_pieces]`: the closed pieces that pass through themselves.
pub(super) fn pass_through_themselves(
    mesh: &TriangleMesh,
    pieces: &Pieces,
    tolerance_m: f64,
) -> Vec<bool> {
    // Any two triangles of a tetrahedron share an edge.
    const TETRAHEDRON: usize = 4;
    let is_asked: Vec<bool> = pieces
        .pieces
        .iter()
        .map(|of| of.closed && !of.meets_itself && of.n_triangles > TETRAHEDRON)
        .collect();
    let all = pieces.piece_of.iter().copied().zip(pieces.corners.iter().copied());
    let mut order: Vec<Triangle> =
        all.filter(|(piece, _)| *piece != NO_PIECE && is_asked[*piece as usize]).collect();
    // Mostly it is sorted, which takes one pass.
    order.sort_by_key(|(piece, _)| *piece);
    let by_place: Vec<Triangle>;
    let mut groups = groups(&order, mesh);
    if 4 * groups.iter().filter(|group| !group.is_together).count() > groups.len() {
        by_place = sorted_by_place(&order, mesh);
        groups = self::groups(&by_place, mesh);
    }
    let passes: Vec<AtomicBool> = is_asked.iter().map(|_| AtomicBool::new(false)).collect();
    let compare = |one: &Group<'_>, other: &Group<'_>, is_same: bool| {
        let passes = &passes[one.piece()];
        if passes.load(Ordering::Relaxed)
            || is_smooth(one, other) && (is_same || share_a_vertex(one, other))
        {
            return;
        }
        // Few of each come near the other.
        let near = |of: &Group<'_>, to: &Group<'_>| -> Vec<[DVec3; 3]> {
            let corners = of.members.iter().map(|member| corners_of(mesh, member));
            corners.filter(|corners| boxes_meet(corners, &[to.low, to.high, to.low])).collect()
        };
        let first = near(one, other);
        let second = if is_same { Vec::new() } else { near(other, one) };
        let passes_any = first.iter().enumerate().any(|(place, corners)| {
            let others = if is_same { &first[place + 1..] } else { &second[..] };
            others.iter().any(|others| {
                boxes_meet(corners, others)
                    && (passes_through(corners, others, tolerance_m)
                        || passes_through(others, corners, tolerance_m))
            })
        });
        if passes_any {
            passes.store(true, Ordering::Relaxed);
        }
    };
    // A piece of one group meets no other.
    let is_alone = |group: &Group<'_>| pieces.pieces[group.piece()].n_triangles <= GROUP;
    let [alone, together]: [Vec<&Group<'_>>; 2] =
        [true, false].map(|alone| groups.iter().filter(|of| is_alone(of) == alone).collect());
    let boxes = Boxes::new(together.len(), |k| (together[k].low, together[k].high));
    parallel::map(alone.len(), 64, |place| compare(alone[place], alone[place], true));
    parallel::map(together.len(), 4, |place| {
        let one = together[place];
        boxes.meeting(one.low, one.high, |number| {
            let other = together[number as usize];
            if number as usize >= place && other.piece() == one.piece() {
                compare(one, other, number as usize == place);
            }
        });
    });
    passes.into_iter().map(AtomicBool::into_inner).collect()
}

fn corners_of(mesh: &TriangleMesh, (_, corners): &Triangle) -> [DVec3; 3] {
    corners.map(|vertex| mesh.vertices[vertex as usize])
}

/// The triangles in their order, in groups of one piece each.
fn groups<'a>(order: &'a [Triangle], mesh: &TriangleMesh) -> Vec<Group<'a>> {
    let of_group: Vec<&[Triangle]> = order
        .chunk_by(|one, other| one.0 == other.0)
        .flat_map(|of_piece| of_piece.chunks(GROUP))
        .collect();
    parallel::map(of_group.len(), 16, |k| {
        let mut group = Group {
            members: of_group[k],
            low: DVec3::INFINITY,
            high: DVec3::NEG_INFINITY,
            axis: DVec3::ZERO,
            angle: 0.0,
            is_together: true,
        };
        let mut normals = [DVec3::ZERO; GROUP];
        let mut length = 0.0;
        for (normal, triangle) in normals.iter_mut().zip(group.members) {
            let [a, b, c] = corners_of(mesh, triangle);
            group.low = group.low.min(a).min(b).min(c);
            group.high = group.high.max(a).max(b).max(c);
            *normal = (b - a).cross(c - a).normalize_or_zero();
            group.axis += *normal;
            length += a.distance(b);
        }
        group.axis = group.axis.normalize_or_zero();
        let least = normals[..group.members.len()]
            .iter()
            .map(|normal| normal.dot(group.axis))
            .fold(1.0, f64::min);
        group.angle = least.clamp(-1.0, 1.0).acos();
        group.is_together = group.low.distance(group.high) <= 2.0 * length;
        group
    })
}

/// No two normals of both groups are far apart.
fn is_smooth(one: &Group<'_>, other: &Group<'_>) -> bool {
    let angle = one.angle + other.angle;
    angle < SMOOTH && one.axis.dot(other.axis) > (SMOOTH - angle).cos()
}

/// Triangles by piece, and along a curve that fills space.
fn sorted_by_place(order: &[Triangle], mesh: &TriangleMesh) -> Vec<Triangle> {
    let (low, high) = mesh.bounds().unwrap_or_default();
    let per_m = (CELLS - 1.0) / (high - low).max_element();
    // Ten bits with two zeros between them.
    let spread = |cell: u64| (0..10).fold(0, |bits, bit| bits | ((cell >> bit & 1) << (3 * bit)));
    let mut keyed: Vec<(u64, u32)> = parallel::map(order.len(), 256, |k| {
        let middle = corners_of(mesh, &order[k]).iter().sum::<DVec3>() / 3.0;
        let cell = ((middle - low) * per_m).as_u64vec3();
        let key = spread(cell.x) | spread(cell.y) << 1 | spread(cell.z) << 2;
        (u64::from(order[k].0) << 32 | key, k as u32)
    });
    rayon::slice::ParallelSliceMut::par_sort_unstable(&mut keyed[..]);
    keyed.into_iter().map(|(_, k)| order[k as usize]).collect()
}

fn share_a_vertex(one: &Group<'_>, other: &Group<'_>) -> bool {
    let corners = |of: &Group<'_>| {
        let mut corners = [[u32::MAX; 3]; GROUP];
        for (corners, member) in corners.iter_mut().zip(of.members) {
            *corners = member.1;
        }
        corners
    };
    let [first, second] = [corners(one), corners(other)];
    let first = &first.as_flattened()[..3 * one.members.len()];
    first.iter().any(|vertex| second.as_flattened().contains(vertex))
}

fn boxes_meet([a, b, c]: &[DVec3; 3], [d, e, f]: &[DVec3; 3]) -> bool {
    let below = |one: DVec3, other: DVec3| one.cmple(other).all();
    below(a.min(*b).min(*c), d.max(*e).max(*f)) && below(d.min(*e).min(*f), a.max(*b).max(*c))
}

/// An edge of the first triangle passes through the second.
fn passes_through(edges: &[DVec3; 3], face: &[DVec3; 3], tolerance_m: f64) -> bool {
    let [a, b, c] = *face;
    let cross = (b - a).cross(c - a);
    // Most lie on one side; that is said without a root.
    let sides = edges.map(|corner| (corner - a).dot(cross));
    if sides.iter().all(|side| *side >= 0.0) || sides.iter().all(|side| *side <= 0.0) {
        return false;
    }
    let longest = a.distance(b).max(b.distance(c)).max(c.distance(a));
    if cross.length() <= tolerance_m * longest {
        return false;
    }
    let normal = cross.normalize_or_zero();
    let heights = edges.map(|corner| (corner - a).dot(normal));
    (0..3).any(|k| {
        let ends = [k, (k + 1) % 3];
        let [under, over] = ends.map(|end| heights[end]);
        if under.min(over) >= -tolerance_m || under.max(over) <= tolerance_m {
            return false;
        }
        let at = edges[ends[0]].lerp(edges[ends[1]], under / (under - over));
        (0..3).all(|k| {
            let start = face[k];
            (face[(k + 1) % 3] - start).cross(at - start).dot(normal) >= 0.0
        })
    })
}
