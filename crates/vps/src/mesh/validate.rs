//! What is wrong with a mesh, counted and said; nothing is repaired.
//!
//! Vertices are welded first, within [`WELD_SHARE`] of the diagonal of the bounding box, so that
//! edges are compared as a reader of the part would: exporters write the same corner once per face.
//! Collapsed and repeated triangles are left out of the count of edges. Cost: linear, in parallel;
//! edges are matched among neighbours in number, in pieces that the cache holds.

use glam::DVec3;

use super::edges::{OddEdges, drop_duplicates, odd_edges};
use super::weld::weld_within;
use super::{SUM_TRIANGLES, TriangleMesh};
use crate::parallel;
use crate::setting_names::SettingNames;

/// Vertices closer than this part of the diagonal of the bounding box are one.
pub const WELD_SHARE: f64 = 1e-6;

/// A triangle is degenerate when its height over its longest edge is below this part of that edge.
const FLAT_SHARE: f64 = 1e-6;

/// A rim smaller than this part of the diagonal is called a slit: areas of slits are the rounding
/// of coordinates, and the size is the root of the area.
const SLIT_SHARE: f64 = 1e-4;

/// A part longer than this is more likely a wrong unit.
const LONG_M: f64 = 5.0;
/// A part whose longest edge is shorter than this is more likely a wrong unit.
const SHORT_M: f64 = 1e-3;

/// What is said of a closed mesh that is inside out.
pub const FACES_INWARD: &str = "the triangles face inward";

/// Open edges that follow each other: the rim of a hole, or of a slit between faces that do not
/// match.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoundaryLoop {
    /// Mean of the edges, weighted by their length, m.
    pub center_m: DVec3,
    /// Diameter of the circle with the same (vector) area, m: about 0 for a slit.
    pub size_m: f64,
    /// How wide it is, m, however long: of a crack the distance of its two sides, of a round hole
    /// its diameter.
    pub width_m: f64,
}

/// The state of a mesh.
#[derive(Clone, Debug)]
pub struct MeshReport {
    /// All of them, degenerate and duplicate ones included.
    pub triangles: usize,
    /// Triangles without area, or whose corners fall together when welded.
    pub degenerate_triangles: usize,
    /// Triangles with the same three welded corners as an earlier one, in any order.
    pub duplicate_triangles: usize,
    /// Edges of one triangle only.
    pub open_edges: usize,
    /// Edges of three triangles or more.
    pub non_manifold_edges: usize,
    /// Edges whose two triangles run along them in the same direction: one of the two is inside
    /// out.
    pub inconsistent_edges: usize,
    /// `[open_edges]`: their vertices, in the direction of their triangle; of welded vertices the
    /// one that stands for them.
    pub open_edge_vertices: Vec<[u32; 2]>,
    /// Rims of open edges, largest first.
    pub boundary_loops: Vec<BoundaryLoop>,
    /// Positive when triangles face outward, m³; means little for an open mesh.
    pub signed_volume_m3: f64,
    /// Surface, m².
    pub area_m2: f64,
    /// Lowest and highest corner, m; `None` without triangles.
    pub bounds_m: Option<(DVec3, DVec3)>,
    /// There are triangles, and no edge is open or has three triangles or more.
    pub closed: bool,
}

impl MeshReport {
    /// The hole that lets most through: a long crack may have more area and let less through.
    pub fn widest_hole(&self) -> Option<&BoundaryLoop> {
        self.boundary_loops
            .iter()
            .reduce(|best, rim| if rim.width_m > best.width_m { rim } else { best })
    }

    /// One sentence per thing that a user should look at; empty for a sound part of usual size.
    pub fn warnings(&self, names: &SettingNames) -> Vec<String> {
        let mut warnings = Vec::new();
        let Some((low, high)) = self.bounds_m else {
            return vec!["the mesh has no triangles".to_owned()];
        };
        let length_m = (high - low).max_element();
        if !(SHORT_M..=LONG_M).contains(&length_m) {
            let length = length_text(length_m);
            warnings.push(format!("the box is {length} long: is {} right?", names.unit));
        }
        let mut count = |n: usize, one: &str, many: &str| match n {
            0 => {}
            1 => warnings.push(format!("1 {one}")),
            n => warnings.push(format!("{n} {many}")),
        };
        count(self.degenerate_triangles, "triangle has no area", "triangles have no area");
        count(self.duplicate_triangles, "triangle repeats another", "triangles repeat others");
        count(
            self.non_manifold_edges,
            "edge has three or more triangles",
            "edges have three or more triangles",
        );
        count(
            self.inconsistent_edges,
            "edge lies between triangles that face opposite ways",
            "edges lie between triangles that face opposite ways",
        );
        if self.open_edges > 0 {
            let edges = if self.open_edges == 1 { "edge is" } else { "edges are" };
            let is_hole = |rim: &&BoundaryLoop| rim.size_m > SLIT_SHARE * low.distance(high);
            let width = match self.widest_hole().filter(is_hole) {
                Some(rim) => format!("the widest hole is {} wide", length_text(rim.width_m)),
                None => "all along slits without width".to_owned(),
            };
            warnings.push(format!("{} {edges} open, {width}", self.open_edges));
        } else if self.closed && self.signed_volume_m3 < 0.0 {
            warnings.push(FACES_INWARD.to_owned());
        }
        warnings
    }
}

/// Three significant digits, in the unit in which the length reads best.
pub(super) fn length_text(length_m: f64) -> String {
    let (value, unit) = match length_m {
        l if l >= 1.0 => (l, "m"),
        l if l >= 1e-3 => (l * 1e3, "mm"),
        l => (l * 1e6, "µm"),
    };
    let digits = if value >= 100.0 {
        0
    } else if value >= 10.0 {
        1
    } else {
        2
    };
    format!("{value:.digits$} {unit}")
}

/// Inspects a mesh. Indices must be in range.
pub fn inspect(mesh: &TriangleMesh) -> MeshReport {
    let bounds_m = mesh.bounds();
    let (low, high) = bounds_m.unwrap_or_default();
    let welded = weld_within(&mesh.vertices, WELD_SHARE * low.distance(high));

    let mut report = MeshReport {
        triangles: mesh.triangles.len(),
        degenerate_triangles: 0,
        duplicate_triangles: 0,
        open_edges: 0,
        non_manifold_edges: 0,
        inconsistent_edges: 0,
        open_edge_vertices: Vec::new(),
        boundary_loops: Vec::new(),
        signed_volume_m3: 0.0,
        area_m2: 0.0,
        bounds_m,
        closed: false,
    };
    // Volumes are taken from the middle of the box: far from the part, their sum would lose digits.
    let center = 0.5 * (low + high);
    let sums = parallel::map_chunks(&mesh.triangles, SUM_TRIANGLES, |triangles| {
        Sums::of(triangles, &mesh.vertices, center, &welded)
    });
    let mut triangles = Vec::with_capacity(mesh.triangles.len());
    for sums in sums {
        report.area_m2 += sums.area_m2;
        report.signed_volume_m3 += sums.signed_volume_m3;
        report.degenerate_triangles += sums.degenerate_triangles;
        triangles.extend(sums.not_collapsed);
    }
    report.duplicate_triangles = drop_duplicates(&mut triangles, mesh.vertices.len());
    let OddEdges { open, inconsistent, non_manifold } = odd_edges(&triangles, mesh.vertices.len());
    report.open_edges = open.len();
    report.inconsistent_edges = inconsistent;
    report.non_manifold_edges = non_manifold;
    report.boundary_loops = boundary_loops(&open, &mesh.vertices);
    report.open_edge_vertices = open;
    report.closed =
        !mesh.triangles.is_empty() && report.open_edges == 0 && report.non_manifold_edges == 0;
    report
}

/// What one piece of the triangles adds to the report.
struct Sums {
    area_m2: f64,
    signed_volume_m3: f64,
    degenerate_triangles: usize,
    /// Welded corners of the triangles that still have three of them.
    not_collapsed: Vec<[u32; 3]>,
}

impl Sums {
    fn of(triangles: &[[u32; 3]], vertices: &[DVec3], center: DVec3, welded: &[u32]) -> Self {
        let not_collapsed = Vec::with_capacity(triangles.len());
        let mut sums =
            Self { area_m2: 0.0, signed_volume_m3: 0.0, degenerate_triangles: 0, not_collapsed };
        for numbers in triangles {
            let [a, b, c] = numbers.map(|vertex| vertices[vertex as usize] - center);
            let double_area = (b - a).cross(c - a).length();
            sums.area_m2 += 0.5 * double_area;
            sums.signed_volume_m3 += a.dot(b.cross(c)) / 6.0;
            let numbers = numbers.map(|vertex| welded[vertex as usize]);
            let collapsed =
                numbers[0] == numbers[1] || numbers[1] == numbers[2] || numbers[2] == numbers[0];
            let longest_squared =
                a.distance_squared(b).max(b.distance_squared(c)).max(c.distance_squared(a));
            if collapsed || double_area <= FLAT_SHARE * longest_squared {
                sums.degenerate_triangles += 1;
            }
            if !collapsed {
                sums.not_collapsed.push(numbers);
            }
        }
        sums
    }
}

/// Chains open edges into rims, largest first.
///
/// Where rims touch, the walk takes the edge that turns back most sharply: the two sides of a slit
/// between faces with different corners then close to a rim without area, instead of two large rims
/// that lie on each other. A walk that meets itself is cut there, so that holes which touch at a
/// vertex are counted apart; one that ends nowhere is closed by a straight line.
fn boundary_loops(open: &[[u32; 2]], positions: &[DVec3]) -> Vec<BoundaryLoop> {
    let mut walks = RimWalks::new(open, positions);
    let mut place_on_walk = vec![usize::MAX; walks.positions.len()];
    let mut loops = Vec::new();
    for start_idx in 0..walks.edges.len() {
        if walks.used[start_idx] {
            continue;
        }
        walks.used[start_idx] = true;
        let mut walk = walks.edges[start_idx].to_vec();
        walk.iter().enumerate().for_each(|(place, vertex)| place_on_walk[*vertex] = place);
        while let Some(vertex) = walk.last().copied() {
            // After a cut at the very first vertex there is no edge to come from.
            let previous = walk.len().checked_sub(2).map_or(vertex, |place| walk[place]);
            let Some(next) = walks.step(previous, vertex) else { break };
            let place = place_on_walk[next];
            if place == usize::MAX {
                place_on_walk[next] = walk.len();
                walk.push(next);
            } else {
                loops.push(rim(walk[place..].iter().map(|vertex| walks.positions[*vertex])));
                walk.drain(place + 1..).for_each(|vertex| place_on_walk[vertex] = usize::MAX);
            }
        }
        if walk.len() > 1 {
            loops.push(rim(walk.iter().map(|vertex| walks.positions[*vertex])));
        }
        walk.iter().for_each(|vertex| place_on_walk[*vertex] = usize::MAX);
    }
    loops.sort_by(|one, other| other.size_m.total_cmp(&one.size_m));
    loops
}

/// Open edges that are still to be walked, over renumbered vertices.
struct RimWalks {
    positions: Vec<DVec3>,
    edges: Vec<[usize; 2]>,
    used: Vec<bool>,
    /// Edges that begin at a vertex, and those that end there.
    leaving: Vec<Vec<usize>>,
    arriving: Vec<Vec<usize>>,
}

impl RimWalks {
    /// Edges compared at a vertex; more meet there only in broken files, which must not take
    /// forever.
    const MAX_CHOICES: usize = 16;

    fn new(open: &[[u32; 2]], positions: &[DVec3]) -> Self {
        let mut vertices: Vec<u32> = open.iter().flatten().copied().collect();
        vertices.sort_unstable();
        vertices.dedup();
        let edges: Vec<_> = open
            .iter()
            .map(|edge| edge.map(|vertex| vertices.partition_point(|other| *other < vertex)))
            .collect();
        let mut leaving = vec![Vec::new(); vertices.len()];
        let mut arriving = vec![Vec::new(); vertices.len()];
        for (edge_idx, [from, to]) in edges.iter().enumerate() {
            leaving[*from].push(edge_idx);
            arriving[*to].push(edge_idx);
        }
        let positions = vertices.iter().map(|vertex| positions[*vertex as usize]).collect();
        Self { positions, used: vec![false; edges.len()], edges, leaving, arriving }
    }

    /// Uses up one edge at `vertex` and returns its other end. Edges that leave come first: they
    /// keep the direction of the rim.
    fn step(&mut self, previous: usize, vertex: usize) -> Option<usize> {
        let here = self.positions[vertex];
        let back = (self.positions[previous] - here).normalize_or_zero();
        for (edges_at, far_end) in [(&mut self.leaving, 1), (&mut self.arriving, 0)] {
            edges_at[vertex].retain(|edge_idx| !self.used[*edge_idx]);
            let sharpness = |edge_idx: usize| {
                back.dot((self.positions[self.edges[edge_idx][far_end]] - here).normalize_or_zero())
            };
            let choices = edges_at[vertex].iter().take(Self::MAX_CHOICES).copied();
            if let Some(edge_idx) =
                choices.max_by(|one, other| sharpness(*one).total_cmp(&sharpness(*other)))
            {
                self.used[edge_idx] = true;
                return Some(self.edges[edge_idx][far_end]);
            }
        }
        None
    }
}

fn rim(corners: impl Iterator<Item = DVec3> + Clone) -> BoundaryLoop {
    let first = corners.clone().next().unwrap_or_default();
    let ends = corners.clone().cycle().skip(1);
    let mut double_area = DVec3::ZERO;
    let mut weighted = DVec3::ZERO;
    let mut length = 0.0;
    for (from, to) in corners.clone().zip(ends) {
        double_area += (from - first).cross(to - first);
        weighted += (0.5 * (from + to) - first) * from.distance(to);
        length += from.distance(to);
    }
    let center_m = if length > 0.0 { first + weighted / length } else { first };
    let area = 0.5 * double_area.length();
    // Diameter of the circle of that area.
    let size_m = (4.0 * area / std::f64::consts::PI).sqrt();
    BoundaryLoop { center_m, size_m, width_m: width(corners, area, size_m) }
}

/// How wide a rim of this area is. A compact hole has 4 A / L, L its length: right for circle,
/// square and every triangle, as for all whose sides touch one circle. A crack has the short side
/// of the rectangle of its area and length, which is half of that. Between them are shapes from
/// the equilateral triangle on, whose L² is 16 · 1.3 A, to rectangles of 14 : 1.
///
/// Teeth of a torn rim make it longer and the hole no narrower: of the rim only corners count that
/// are a part of `size_m` from the last one that counted. The two sides of a crack stay as long as
/// they are.
fn width(corners: impl Iterator<Item = DVec3>, area: f64, size_m: f64) -> f64 {
    const TOOTH_SHARE: f64 = 0.25;
    const COMPACT: f64 = 1.3;
    const CRACK: f64 = 4.0;
    let mut ends: Option<(DVec3, DVec3)> = None;
    let mut length = 0.0;
    for corner in corners {
        let (first, last) = ends.unwrap_or((corner, corner));
        let step = corner.distance(last);
        if step > TOOTH_SHARE * size_m {
            length += step;
            ends = Some((first, corner));
        } else {
            ends = Some((first, last));
        }
    }
    let half = 0.5 * (length + ends.map_or(0.0, |(first, last)| first.distance(last)));
    if half <= 0.0 {
        return size_m;
    }
    let slenderness = half * half / (4.0 * area);
    // Also of no area: that is as slender as can be.
    let share = ((slenderness - COMPACT) / (CRACK - COMPACT)).clamp(0.0, 1.0);
    let difference = (half * half - 4.0 * area).max(0.0).sqrt();
    (2.0 * area / (half + share * difference)).min(size_m)
}

#[cfg(test)]
mod tests {
    use glam::DVec2;

    use super::super::primitives::Shape;
    use super::*;

    fn cube() -> TriangleMesh {
        Shape::Box { size_m: DVec3::splat(0.1) }.tessellate(1.0)
    }

    #[test]
    fn sound_cube_has_nothing_to_say() {
        let report = inspect(&cube());
        assert!(report.closed && report.warnings(&SettingNames::PLAIN).is_empty(), "{report:?}");
        assert!(
            (report.signed_volume_m3 - 1e-3).abs() < 1e-15 && (report.area_m2 - 0.06).abs() < 1e-15
        );
    }

    #[test]
    fn unshared_vertices_are_welded() {
        let cube = cube();
        let mut soup = TriangleMesh::default();
        for k in 0..cube.triangles.len() {
            let base = soup.vertices.len() as u32;
            // Jitter far below the tolerance, as exporters of decimal text leave it.
            soup.vertices.extend(cube.corners(k).map(|corner| corner * (1.0 + 1e-9 * k as f64)));
            soup.triangles.push([base, base + 1, base + 2]);
        }
        assert!(inspect(&soup).closed);
    }

    #[test]
    fn a_missing_face_is_one_hole_of_its_size() {
        let mut mesh = cube();
        mesh.triangles.drain(2..4);
        let report = inspect(&mesh);
        assert!(!report.closed);
        assert_eq!((report.open_edges, report.boundary_loops.len()), (4, 1));
        let hole = report.boundary_loops[0];
        assert!(hole.center_m.distance(DVec3::new(0.0, 0.0, 0.05)) < 1e-15);
        assert!((hole.size_m - (4.0 * 0.01 / std::f64::consts::PI).sqrt()).abs() < 1e-15);
        assert!((hole.width_m - 0.1).abs() < 1e-9);
        assert_eq!(
            report.warnings(&SettingNames::PLAIN),
            ["4 edges are open, the widest hole is 100 mm wide"]
        );
    }

    /// A hole with these corners, m.
    fn hole(corners: &[DVec2]) -> BoundaryLoop {
        rim(corners.iter().map(|corner| DVec3::new(corner.x, 0.3, corner.y)))
    }

    /// So many corners around the origin, their distances from it in turn.
    fn around(n: usize, radii: [f64; 2]) -> Vec<DVec2> {
        let angle = |k: usize| k as f64 * std::f64::consts::TAU / n as f64;
        (0..n).map(|k| DVec2::from_angle(angle(k)) * radii[k % 2]).collect()
    }

    #[test]
    fn a_crack_is_as_wide_as_its_sides_are_apart_however_long_it_is() {
        let length = 0.1;
        let apart = 0.2e-3;
        // Straight, with corners at every millimetre.
        let side = |y: f64| (0..=100).map(move |k| DVec2::new(1e-3 * f64::from(k), y));
        let straight: Vec<_> = side(0.0).chain(side(apart).rev()).collect();
        // The same around the corner of a box: an L of two arms.
        let arm = 0.5 * length;
        let bent = [
            DVec2::ZERO,
            DVec2::new(arm, 0.0),
            DVec2::new(arm, apart),
            DVec2::new(apart, apart),
            DVec2::new(apart, arm),
            DVec2::new(0.0, arm),
        ];
        // Along a bow of half a circle.
        let bow = |radius: f64| {
            (0..=90).map(move |k| DVec2::from_angle((2.0 * f64::from(k)).to_radians()) * radius)
        };
        let bowed: Vec<_> = bow(0.03).chain(bow(0.03 - apart).rev()).collect();
        for crack in [&straight[..], &bent, &bowed] {
            let found = hole(crack);
            assert!((found.width_m / apart - 1.0).abs() < 0.02, "{found:?}");
            assert!(found.size_m > 20.0 * apart, "its area is that of a large hole: {found:?}");
        }
        // A wedge is as wide as it is in the middle.
        let wedge = hole(&[DVec2::ZERO, DVec2::new(0.1, 0.0), DVec2::new(0.1, 2.0 * apart)]);
        assert!((wedge.width_m / apart - 1.0).abs() < 0.02, "{wedge:?}");
    }

    #[test]
    fn a_hole_is_as_wide_as_it_is_across_however_torn_its_rim_is() {
        for (corners, expected) in [
            (around(64, [5e-3; 2]), 10e-3),
            // Teeth of a tenth of the radius, as torn scans have them.
            (around(200, [5e-3, 4.5e-3]), 9.5e-3),
            (around(4, [5e-3; 2]), 5e-3 * std::f64::consts::SQRT_2),
            // The circle within a triangle: half of the one around it, and less where it has a
            // right angle.
            (around(3, [5e-3; 2]), 5e-3),
            (vec![DVec2::ZERO, DVec2::X * 1e-2, DVec2::Y * 1e-2], (2.0 - 2.0_f64.sqrt()) * 1e-2),
        ] {
            let found = hole(&corners);
            assert!((found.width_m / expected - 1.0).abs() < 0.08, "{found:?}");
        }
    }

    #[test]
    fn the_widest_hole_is_told_and_not_the_one_of_most_area() {
        // A lid of a box that leaves a crack of 0.2 mm along one side, and a hole of 2 mm.
        let mut mesh = cube();
        mesh.triangles.retain(|corners| ![[4, 5, 7], [4, 7, 6]].contains(corners));
        let [a, b, c, d] = [4, 5, 7, 6].map(|k: usize| mesh.vertices[k]);
        let inward = (d - a).normalize() * 0.2e-3;
        let base = mesh.vertices.len() as u32;
        mesh.vertices.extend([a + inward, b + inward]);
        let hole = 0.002_f64;
        let x = (b - a).normalize() * hole;
        let y = (d - a).normalize() * hole;
        let middle = 0.25 * (a + b + c + d);
        mesh.vertices.extend([middle, middle + x, middle + x + y, middle + y]);
        let ring = [base, base + 1, 7, 6];
        let inner = [base + 2, base + 3, base + 4, base + 5];
        for k in 0..4 {
            let next = (k + 1) % 4;
            mesh.triangles
                .extend([[ring[k], ring[next], inner[next]], [ring[k], inner[next], inner[k]]]);
        }
        let report = inspect(&mesh);
        assert_eq!(report.boundary_loops.len(), 2, "{:?}", report.boundary_loops);
        assert!(report.boundary_loops[0].size_m > 5e-3, "the crack has more area");
        assert_eq!(
            report.warnings(&SettingNames::PLAIN),
            ["10 edges are open, the widest hole is 2.00 mm wide"]
        );
    }

    #[test]
    fn holes_that_touch_are_counted_apart() {
        let mut mesh = cube();
        // One triangle of the top and one of the bottom, which meet only across a side; then two
        // that share a corner.
        mesh.triangles.retain(|corners| ![[0, 2, 3], [4, 5, 7]].contains(corners));
        let report = inspect(&mesh);
        assert_eq!((report.open_edges, report.boundary_loops.len()), (6, 2));
        let mut mesh = cube();
        mesh.triangles.retain(|corners| ![[0, 2, 3], [0, 1, 5]].contains(corners));
        let report = inspect(&mesh);
        assert_eq!((report.open_edges, report.boundary_loops.len()), (6, 2));
        let size = (4.0 * 0.005 / std::f64::consts::PI).sqrt();
        assert!(
            report.boundary_loops.iter().all(|hole| (hole.size_m - size).abs() < 1e-15),
            "{report:?}"
        );
    }

    #[test]
    fn a_vertex_on_one_side_of_an_edge_is_a_slit_without_size() {
        let mut mesh = cube();
        let middle = mesh.vertices.len() as u32;
        let a = mesh.vertices[0];
        let b = mesh.vertices[3];
        mesh.vertices.push(0.5 * (a + b));
        // The diagonal 0-3 of the bottom is split on one of its two sides only.
        let place = mesh.triangles.iter().position(|corners| *corners == [0, 2, 3]).unwrap();
        mesh.triangles[place] = [0, 2, middle];
        mesh.triangles.push([middle, 2, 3]);
        let report = inspect(&mesh);
        assert_eq!((report.open_edges, report.boundary_loops.len()), (3, 1));
        assert!(report.boundary_loops[0].size_m < 1e-9, "{report:?}");
    }

    #[test]
    fn faces_with_different_corners_leave_slits_not_large_holes() {
        // The lid of the cube has its own corners on all four edges; the sides have none.
        let mut mesh = cube();
        mesh.triangles.retain(|corners| ![[4, 5, 7], [4, 7, 6]].contains(corners));
        let around = [4, 5, 7, 6];
        let center = mesh.vertices.len() as u32;
        mesh.vertices.push(DVec3::new(0.0, 0.0, 0.05));
        for k in 0..4 {
            let from = around[k];
            let to = around[(k + 1) % 4];
            let middle = mesh.vertices.len() as u32;
            mesh.vertices.push(0.5 * (mesh.vertices[from as usize] + mesh.vertices[to as usize]));
            mesh.triangles.extend([[from, middle, center], [middle, to, center]]);
        }
        let report = inspect(&mesh);
        assert_eq!((report.open_edges, report.boundary_loops.len()), (12, 4), "{report:?}");
        assert!(report.boundary_loops[0].size_m < 1e-9, "{report:?}");
        assert_eq!(report.inconsistent_edges, 0);
        assert_eq!(
            report.warnings(&SettingNames::PLAIN),
            ["12 edges are open, all along slits without width"]
        );
    }

    #[test]
    fn bad_triangles_are_counted_and_said() {
        let mut mesh = cube();
        mesh.triangles.push([0, 0, 1]);
        mesh.triangles.push([3, 0, 2]);
        mesh.triangles[11].swap(0, 1);
        let report = inspect(&mesh);
        assert_eq!(
            (report.degenerate_triangles, report.duplicate_triangles, report.inconsistent_edges),
            (1, 1, 3)
        );
        assert!(report.closed);
        assert_eq!(
            report.warnings(&SettingNames::PLAIN),
            [
                "1 triangle has no area",
                "1 triangle repeats another",
                "3 edges lie between triangles that face opposite ways"
            ]
        );
        // A wall inside: its edges have three triangles, or one where it meets a diagonal's ends.
        let mut mesh = cube();
        mesh.triangles.push([0, 3, 7]);
        let report = inspect(&mesh);
        assert!(report.non_manifold_edges >= 2 && !report.closed, "{report:?}");
    }

    #[test]
    fn inverted_and_odd_sized_parts_are_said() {
        let mut mesh = cube();
        mesh.triangles.iter_mut().for_each(|corners| corners.swap(0, 1));
        assert_eq!(inspect(&mesh).warnings(&SettingNames::PLAIN), ["the triangles face inward"]);
        let scaled = |scale: f64| {
            let mut mesh = cube();
            mesh.vertices.iter_mut().for_each(|vertex| *vertex *= scale);
            inspect(&mesh).warnings(&SettingNames::PLAIN)
        };
        assert_eq!(scaled(123.0), ["the box is 12.3 m long: is the unit right?"]);
        assert_eq!(scaled(1e-3), ["the box is 100 µm long: is the unit right?"]);
        assert!(scaled(1.0).is_empty());
        assert_eq!(
            inspect(&TriangleMesh::default()).warnings(&SettingNames::PLAIN),
            ["the mesh has no triangles"]
        );
    }

    #[test]
    fn a_point_of_triangles_does_no_harm() {
        let mesh = TriangleMesh { vertices: vec![DVec3::X; 3], triangles: vec![[0, 1, 2]; 2] };
        let report = inspect(&mesh);
        assert_eq!((report.degenerate_triangles, report.open_edges), (2, 0));
    }
}
