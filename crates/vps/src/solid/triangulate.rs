//! Triangulates a face with the lines across it as edges.

use glam::DVec3;
use spade::handles::FixedVertexHandle;
use spade::{ConstrainedDelaunayTriangulation, HasPosition, Point2, Triangulation};

use super::cut::{Axes, Fragment};
use super::faces::Face;
use super::lines::Lines;

/// Numbers below this count as zero: the library refuses them.
const TINY: f64 = 1e-40;

/// A point of a face.
#[derive(Clone, Copy)]
struct Corner {
    at: Point2<f64>,
    point: u32,
}

impl HasPosition for Corner {
    type Scalar = f64;

    fn position(&self) -> Point2<f64> {
        self.at
    }
}

/// Memory that is used again for the next face.
#[derive(Default)]
pub(super) struct Scratch {
    cdt: ConstrainedDelaunayTriangulation<Corner>,
    handles: Vec<Option<FixedVertexHandle>>,
    points: Vec<u32>,
    rim: Vec<[u32; 2]>,
    inner: Vec<[u32; 2]>,
    along: Vec<[u32; 2]>,
    corners: Vec<u32>,
}

fn lower_first(one: u32, other: u32) -> [u32; 2] {
    [one.min(other), one.max(other)]
}

/// Fragments of a face: of a triangulation of its corners, of the points on its edges and of those
/// on the lines across it. A line that cannot be an edge, as another one crosses it, is left out.
pub(super) fn triangulate(
    scratch: &mut Scratch,
    face: &Face,
    face_idx: u32,
    lines: &Lines,
    across: &[u32],
    positions: &[DVec3],
) -> Vec<Fragment> {
    let Scratch { cdt, handles, points, rim, inner, along, corners } = scratch;
    rim.clear();
    inner.clear();
    corners.clear();
    for edge in face.edges {
        lines.points(edge, points);
        corners.extend_from_slice(points);
        rim.extend(points.windows(2).map(|ends| lower_first(ends[0], ends[1])));
    }
    rim.sort_unstable();
    rim.dedup();
    for line in across {
        lines.points(*line, points);
        corners.extend_from_slice(points);
        inner.extend(points.windows(2).map(|ends| lower_first(ends[0], ends[1])));
    }
    inner.sort_unstable();
    inner.dedup();
    along.clear();
    along.extend(inner.iter().filter(|ends| rim.binary_search(ends).is_ok()));
    inner.retain(|ends| rim.binary_search(ends).is_err());
    corners.sort_unstable();
    corners.dedup();

    let axes = Axes::of(face);
    cdt.clear();
    handles.clear();
    for point in corners.iter() {
        let flat = axes.flat(positions[*point as usize]);
        let [x, y] = [flat.x, flat.y].map(|x| if x.abs() < TINY { 0.0 } else { x });
        handles.push(cdt.insert(Corner { at: Point2::new(x, y), point: *point }).ok());
    }
    let handle_of =
        |point: u32| corners.binary_search(&point).ok().and_then(|place| handles[place]);
    let mut rim_is_whole = true;
    for (edges, is_rim) in [(&*rim, true), (&*inner, false)] {
        for [from, to] in edges {
            let (Some(from), Some(to)) = (handle_of(*from), handle_of(*to)) else { continue };
            if from == to {
                continue;
            }
            let edge = cdt.get_edge_from_neighbors(from, to);
            let exists = edge.is_some();
            // What lies on the hull stays an edge without a word of it.
            if edge.is_some_and(|edge| edge.is_part_of_convex_hull()) {
                continue;
            }
            if exists || cdt.can_add_constraint(from, to) {
                cdt.add_constraint(from, to);
            } else if is_rim {
                rim_is_whole = false;
            }
        }
    }

    // Rounding can leave slivers between the rim and the hull of its points.
    let n_faces = cdt.num_all_faces();
    let mut is_outside = vec![false; n_faces];
    let mut waiting = Vec::new();
    if rim_is_whole {
        let is_on_rim = |ends: [u32; 2]| rim.binary_search(&ends).is_ok();
        for edge in cdt.convex_hull() {
            let ends = [edge.from(), edge.to()].map(|end| end.data().point);
            let inner_side = if edge.is_outer_edge() { edge.rev() } else { edge };
            if !is_on_rim(lower_first(ends[0], ends[1]))
                && let Some(sliver) = inner_side.face().as_inner()
            {
                waiting.push(sliver.fix());
            }
        }
        while let Some(sliver) = waiting.pop() {
            if std::mem::replace(&mut is_outside[sliver.index()], true) {
                continue;
            }
            for edge in cdt.face(sliver).adjacent_edges() {
                let ends = [edge.from(), edge.to()].map(|end| end.data().point);
                if let Some(next) = edge.rev().face().as_inner()
                    && !is_on_rim(lower_first(ends[0], ends[1]))
                {
                    waiting.push(next.fix());
                }
            }
        }
    }
    cdt.inner_faces()
        .filter(|part| !is_outside[part.fix().index()])
        .map(|part| {
            let points = part.vertices().map(|vertex| vertex.data().point);
            let mut meets = 0;
            for k in 0..3 {
                let ends = lower_first(points[k], points[(k + 1) % 3]);
                let is_met =
                    inner.binary_search(&ends).is_ok() || along.binary_search(&ends).is_ok();
                meets |= u8::from(is_met) << k;
            }
            Fragment { points, face: face_idx, meets }
        })
        .collect()
}
