//! From the triangles of a file to the border of the solid that they bound.

use glam::DVec3;

use super::cracks::join_cracks;
use super::cut::{Cut, Limits, cut};
use super::faces::Faces;
use super::judge::judge;
use super::lids::{Lids, lids};
use super::nesting::{Nesting, nest};
use super::pieces::{NO_PIECE, Pieces};
use super::report::{Cavity, SolidReport};
use super::self_meets::pass_through_themselves;
use super::verify::{self, Difference};
use crate::mesh::TriangleMesh;
use crate::mesh::boxes::Boxes;
use crate::mesh::mass::{
    MassProperties, mass_properties, mass_properties_of_inspected, of_all, of_closed,
};
use crate::mesh::validate::{MeshReport, WELD_SHARE};
use crate::parallel;

/// Settings. All that makes a solid of triangles takes them from [`Self::resolved_by`], so that
/// two of them never tell different things of one file.
#[derive(Clone, Copy, Debug)]
pub struct SolidOptions {
    /// What lies closer than this, m, lies on each other: vertices are one, faces cancel. `None`:
    /// [`WELD_SHARE`] of the diagonal of the bounding box, which the six digits of a text file, or
    /// an `f32`, keep.
    pub(super) tolerance_m: Option<f64>,
    /// Open edges with no more than this between them, m, are joined. 0: none are.
    pub(super) crack_m: f64,
}

impl SolidOptions {
    /// For a part that is sampled so finely, m: by voxels of this edge, or points so far apart. A
    /// gap up to a tenth of that is a crack, not a hole, and its edges are joined. `None`: it is
    /// not known how finely, and no edges are.
    pub fn resolved_by(spacing_m: Option<f64>) -> Self {
        let crack_m = spacing_m.map_or(0.0, |spacing_m| CRACK_SHARE * spacing_m);
        Self { tolerance_m: None, crack_m }
    }
}

/// Cracks narrower than this part of a voxel are joined.
const CRACK_SHARE: f64 = 0.1;

/// Lids wider than this many tolerances are counted as openings: what tolerances and rounding leave
/// open is narrower.
const LID_TOLERANCES: f64 = 32.0;

/// Where the border is wrong, or was closed by a guess, the same is tried within these parts of the
/// tolerance: what is confused by one is mostly clear within another. What is near is kept apart
/// before it is joined.
const OTHER_TOLERANCES: [f64; 4] = [0.1, 10.0, 0.01, 0.3];

/// In larger files a border that is right but for narrow guesses stays: another attempt would take
/// as long as the first, seconds.
const GUESSES_TRIANGLES: usize = 100_000;

/// What is wrong with a border, in the order in which it counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, PartialOrd)]
struct Flaws {
    off_m3: f64,
    open_edges: usize,
}

/// What the triangles of a file mean.
#[derive(Clone, Debug)]
pub struct Solid {
    /// Border of the solid: closed, outward. Its vertices begin with those of the file; a triangle
    /// that is kept whole is that of the file, and in its order, but for corners that lie within
    /// the tolerance of others: of pieces that meet others, they are one. Triangles that close what
    /// tolerances and rounding left open come last.
    pub border: TriangleMesh,
    /// Triangles of pieces that are not closed, as far as they lie outside of the solid.
    pub skins: TriangleMesh,
    /// What was found.
    pub report: SolidReport,
}

impl Solid {
    /// Makes a solid of triangles. Vertices must be finite, and indices in range.
    pub fn of(mesh: &TriangleMesh, options: &SolidOptions) -> Self {
        Self::within(mesh, options, Limits::default())
    }

    /// Volume, centre and inertia of the solid, and of open pieces beside it whose holes can only
    /// hide little; of the file, with what its inspection found, where nothing is a solid. Frame
    /// and units of [`MassProperties`].
    pub fn mass(&self, file: &TriangleMesh, inspected: &MeshReport) -> MassProperties {
        if self.border.triangles.is_empty() {
            return mass_properties_of_inspected(file, inspected);
        }
        let open = self.open_parts(0.0);
        let open = open.iter().map(mass_properties).filter(|mass| !mass.from_surface);
        of_all(std::iter::once(self.report.mass).chain(open))
    }

    /// [`Self::of`], with how much is cut at most.
    pub(super) fn within(file: &TriangleMesh, options: &SolidOptions, limits: Limits) -> Self {
        let (mut best, mut flaws) = Self::attempt(file, options, limits, 1.0);
        for share in OTHER_TOLERANCES {
            let guesses = flaws.open_edges > 0 && file.triangles.len() <= GUESSES_TRIANGLES;
            if flaws.off_m3 == 0.0 && !guesses {
                break;
            }
            let (other, of_other) = Self::attempt(file, options, limits, share);
            // Within less, corners of one piece may fall apart, and what is open has no border.
            let is_whole = other.report.open_pieces <= best.report.open_pieces;
            if of_other < flaws && is_whole && !other.report.tangled {
                (best, flaws) = (other, of_other);
            }
        }
        best
    }

    /// The solid within a part of the tolerance, and what is wrong with it.
    fn attempt(
        file: &TriangleMesh,
        options: &SolidOptions,
        limits: Limits,
        share: f64,
    ) -> (Self, Flaws) {
        let crack_m = options.crack_m;
        let (low, high) = file.bounds().unwrap_or_default();
        // Far from the origin, neighbouring numbers are farther apart than that.
        let least_m = 4.0 * f64::EPSILON * low.abs().max(high.abs()).max_element();
        let asked_m = options.tolerance_m.unwrap_or(WELD_SHARE * low.distance(high)).max(least_m);
        let tolerance_m = (share * asked_m).max(least_m);
        let mut pieces = Pieces::of(file, tolerance_m);
        let joined = (crack_m > 0.0 && pieces.n_open_edges > 0)
            .then(|| join_cracks(file, tolerance_m, crack_m))
            .flatten();
        let mesh = joined.as_ref().map_or(file, |joined| &joined.mesh);
        if joined.is_some() {
            pieces = Pieces::of(mesh, tolerance_m);
        }
        let passes = pass_through_themselves(mesh, &pieces, tolerance_m);
        for (piece, passes) in pieces.pieces.iter_mut().zip(passes) {
            piece.meets_itself |= passes;
        }
        let meets = Meets::of(&pieces, tolerance_m);
        let (mut faces, lines) = Faces::of(mesh, &pieces, &meets.any, tolerance_m);
        let nesting = nest(&pieces, &faces, 4.0 * tolerance_m);
        if nesting.to_turn.contains(&true) {
            pieces.turn_pieces(&nesting.to_turn);
            faces.turn_pieces(&nesting.to_turn);
        }
        // Lids on open pieces would be made here: what they close is a body.

        let mut picked = Picked { border: Picks::new(mesh), skins: Picks::new(mesh) };
        let mut tangled = false;
        let mut inside_area_m2 = 0.0;
        let mut cut_triangles = 0;
        let mut open_edges = 0;
        let mut empty_m3 = None;
        let mut difference = Difference::default();
        if faces.faces.is_empty() {
            picked.all(&pieces, |_| true);
        } else {
            match cut(&faces, lines, &mesh.vertices, tolerance_m, limits) {
                None => {
                    tangled = true;
                    picked.all(&pieces, |_| true);
                }
                Some(cut) => {
                    let judged = judge(&faces, &cut, &nesting, tolerance_m);
                    let parts = FaceParts::of(mesh, &faces, &cut, &judged.stays);
                    inside_area_m2 = parts.left_out_m2;
                    cut_triangles = parts.n_cut;
                    picked.of_cut(&pieces, &meets.any, &faces, &cut, &judged.stays, &parts);
                    let mut border = parts.border(&faces, &cut, &judged.stays);
                    let Lids { triangles, n_wide_edges } =
                        lids(&border, &cut.positions, LID_TOLERANCES * tolerance_m);
                    open_edges = n_wide_edges;
                    border.extend(&triangles);
                    difference = verify::difference(&faces, &border, &cut.positions, asked_m);
                    triangles.into_iter().for_each(|lid| picked.border.add_part(&cut, lid));
                    empty_m3 = Some(judged.empty_m3(&cut, &pieces.pieces));
                }
            }
        }
        let narrow_m = HOLLOW_TOLERANCES * asked_m;
        let cavities = cavities(&pieces, &nesting, empty_m3.as_deref(), narrow_m);
        let skin_pieces = pieces.pieces.iter().filter(|piece| !piece.closed).count();
        let n_closed = pieces.pieces.len() - skin_pieces;
        let n_cavities = nesting.is_cavity.iter().filter(|is_cavity| **is_cavity).count();
        let border = picked.border.finish(mesh, &pieces, true);
        let skins = picked.skins.finish(mesh, &pieces, false);
        let mass = if border.triangles.is_empty() {
            mass_properties(&skins)
        } else {
            of_closed(&border, 0.5 * (low + high))
        };
        let report = SolidReport {
            triangles: file.triangles.len(),
            pieces: pieces.pieces.len(),
            bodies: n_closed - n_cavities,
            cavities,
            open_pieces: skin_pieces,
            open_area_m2: area(&skins),
            degenerate_triangles: pieces.n_degenerate,
            repeated_triangles: pieces.n_repeats,
            inconsistent_triangles: pieces.n_inconsistent,
            not_orientable: pieces.n_not_orientable,
            inside_out: nesting.is_inside_out,
            turned_pieces: if nesting.is_inside_out {
                0
            } else {
                nesting.to_turn.iter().filter(|turned| **turned).count()
            },
            joined_cracks: joined.as_ref().map_or(0, |joined| joined.n_edges),
            inside_area_m2,
            cut_triangles,
            open_edges,
            tangled,
            volume_of_pieces_m3: (difference.off_m3 > 0.0)
                .then_some(mass.volume_m3 + difference.more_m3),
            mass,
        };
        let flaws = Flaws { off_m3: difference.off_m3, open_edges };
        (Self { border, skins, report }, flaws)
    }
}

fn area(mesh: &TriangleMesh) -> f64 {
    // The sum of nothing would be -0.
    (0..mesh.triangles.len())
        .map(|idx| area_of(mesh.corners(idx)))
        .fold(0.0, |sum, area| sum + area)
}

fn area_of([a, b, c]: [DVec3; 3]) -> f64 {
    0.5 * (b - a).cross(c - a).length()
}

/// A cavity smaller than this part of its shell is full: bodies that fill it do so within the
/// tolerance.
const FULL_SHARE: f64 = 1e-6;

/// A cavity that is no more than this many tolerances thick, over all of its shell, is full too:
/// rounded decimals leave that much open.
const HOLLOW_TOLERANCES: f64 = 16.0;

/// Cavities that are not full; `empty_m3` is what is empty of each piece, if it is known. What is
/// narrower than `narrow_m`, over all of the shell, is full.
fn cavities(
    pieces: &Pieces,
    nesting: &Nesting,
    empty_m3: Option<&[f64]>,
    narrow_m: f64,
) -> Vec<Cavity> {
    let numbers = (0..pieces.pieces.len()).filter(|piece| nesting.is_cavity[*piece]);
    numbers
        .filter_map(|number| {
            let piece = &pieces.pieces[number];
            let shell_m3 = piece.volume_m3.abs();
            let volume_m3 = empty_m3.map_or(shell_m3, |empty_m3| empty_m3[number]);
            (volume_m3 > (FULL_SHARE * shell_m3).max(narrow_m * piece.area_m2))
                .then_some(Cavity { volume_m3, n_triangles: piece.n_triangles })
        })
        .collect()
}

/// Which pieces have to be looked at together.
struct Meets {
    /// `[n_pieces]`: the box meets that of another piece, one of them closed, or the piece meets
    /// itself.
    any: Vec<bool>,
}

impl Meets {
    fn of(pieces: &Pieces, tolerance_m: f64) -> Self {
        let pieces = &pieces.pieces;
        let boxes = Boxes::new(pieces.len(), |idx| (pieces[idx].low, pieces[idx].high));
        let any = parallel::map(pieces.len(), 16, |idx| {
            let piece = &pieces[idx];
            let mut meets = piece.closed && piece.meets_itself;
            boxes.meeting(piece.low - 4.0 * tolerance_m, piece.high + 4.0 * tolerance_m, |other| {
                meets |= other as usize != idx && (piece.closed || pieces[other as usize].closed);
            });
            meets
        });
        Self { any }
    }
}

/// What becomes of each face.
struct FaceParts {
    /// `[n_faces + 1]`, into the fragments.
    starts: Vec<u32>,
    /// `[n_faces]`: it stays as it is.
    is_whole: Vec<bool>,
    /// `[n_faces]`: its corners lie where those of the file do. Others were near corners of another
    /// triangle, and are taken from there: the border would have a crack otherwise.
    keeps_corners: Vec<bool>,
    n_cut: usize,
    left_out_m2: f64,
}

impl FaceParts {
    /// A face of which all fragments stay remains whole, unless a point on its edges is a corner
    /// of something else that stays, or one of its corners is none of a fragment: the border would
    /// have a crack there.
    fn of(mesh: &TriangleMesh, faces: &Faces, cut: &Cut, stays: &[bool]) -> Self {
        let mut starts = vec![0; faces.faces.len() + 1];
        cut.fragments.iter().for_each(|fragment| starts[fragment.face as usize + 1] += 1);
        for face in 0..faces.faces.len() {
            starts[face + 1] += starts[face];
        }
        let range = |face: usize| starts[face] as usize..starts[face + 1] as usize;
        let mut is_used = vec![false; cut.positions.len()];
        let mut is_whole = vec![false; faces.faces.len()];
        let mut undecided = Vec::new();
        let mut n_cut = 0;
        for (idx, face) in faces.faces.iter().enumerate() {
            let n_stay = stays[range(idx)].iter().filter(|stays| **stays).count();
            n_cut += usize::from(n_stay > 0 && n_stay < range(idx).len());
            // A corner that ends in a tip narrower than the tolerance is in no fragment.
            let has_corners = || {
                face.vertices.iter().all(|vertex| {
                    cut.fragments[range(idx)].iter().any(|part| part.points.contains(vertex))
                })
            };
            is_whole[idx] = n_stay == range(idx).len() && n_stay > 0 && has_corners();
            if is_whole[idx] && n_stay > 1 {
                undecided.push(idx);
            } else if is_whole[idx] {
                face.vertices.iter().for_each(|point| is_used[*point as usize] = true);
            } else {
                let fragments = range(idx).filter(|fragment| stays[*fragment]);
                fragments
                    .flat_map(|fragment| cut.fragments[fragment].points)
                    .for_each(|point| is_used[point as usize] = true);
            }
        }
        // Points on the edges are the ends of edges that have a fragment on one side only.
        let rim_points = |idx: usize| {
            let mut edges: Vec<[u32; 2]> = cut.fragments[range(idx)]
                .iter()
                .flat_map(|fragment| {
                    let [a, b, c] = fragment.points;
                    [[a, b], [b, c], [c, a]]
                })
                .collect();
            edges.sort_unstable();
            let is_rim = |[from, to]: &[u32; 2]| edges.binary_search(&[*to, *from]).is_err();
            let mut points: Vec<u32> =
                edges.iter().filter(|edge| is_rim(edge)).flatten().copied().collect();
            points.retain(|point| !faces.faces[idx].vertices.contains(point));
            points
        };
        let mut rims: Vec<(usize, Vec<u32>)> =
            undecided.into_iter().map(|idx| (idx, rim_points(idx))).collect();
        loop {
            let n_before = rims.len();
            rims.retain(|(idx, points)| {
                let is_met = points.iter().any(|point| is_used[*point as usize]);
                if is_met {
                    is_whole[*idx] = false;
                    cut.fragments[range(*idx)]
                        .iter()
                        .flat_map(|fragment| fragment.points)
                        .for_each(|point| is_used[point as usize] = true);
                }
                !is_met
            });
            if rims.len() == n_before {
                break;
            }
        }
        let left_out = cut.fragments.iter().zip(stays).filter(|(_, stays)| !**stays);
        let left_out_m2 = left_out
            .map(|(fragment, _)| {
                area_of(fragment.points.map(|point| cut.positions[point as usize]))
            })
            .fold(0.0, |sum, area| sum + area);
        let keeps_corners = parallel::map(faces.faces.len(), 256, |idx| {
            let face = &faces.faces[idx];
            let of_file = mesh.corners(face.file_idx as usize);
            face.corners.iter().all(|corner| of_file.contains(corner))
        });
        Self { starts, is_whole, keeps_corners, n_cut, left_out_m2 }
    }

    /// What stays of closed pieces, over the points of the cut.
    fn border(&self, faces: &Faces, cut: &Cut, stays: &[bool]) -> Vec<[u32; 3]> {
        let mut border = Vec::new();
        for (idx, face) in faces.faces.iter().enumerate().filter(|(_, face)| face.closed) {
            if self.is_whole[idx] {
                border.push(face.vertices);
                continue;
            }
            let range = self.starts[idx] as usize..self.starts[idx + 1] as usize;
            let staying = range.filter(|fragment| stays[*fragment]);
            border.extend(staying.map(|fragment| cut.fragments[fragment].points));
        }
        border
    }
}

/// Triangles for the border and for the skins.
struct Picked {
    border: Picks,
    skins: Picks,
}

impl Picked {
    /// All triangles of pieces that `takes`.
    fn all(&mut self, pieces: &Pieces, takes: impl Fn(u32) -> bool) {
        for file_idx in 0..pieces.piece_of.len() {
            let piece = pieces.piece_of[file_idx];
            if piece != NO_PIECE && takes(piece) {
                self.of(pieces, piece).whole.push(file_idx as u32);
            }
        }
    }

    fn of(&mut self, pieces: &Pieces, piece: u32) -> &mut Picks {
        if pieces.pieces[piece as usize].closed { &mut self.border } else { &mut self.skins }
    }

    fn of_cut(
        &mut self,
        pieces: &Pieces,
        takes_part: &[bool],
        faces: &Faces,
        cut: &Cut,
        stays: &[bool],
        parts: &FaceParts,
    ) {
        let mut next = 0;
        for file_idx in 0..pieces.piece_of.len() as u32 {
            let piece = pieces.piece_of[file_idx as usize];
            if piece == NO_PIECE {
                continue;
            }
            if !takes_part[piece as usize] {
                self.of(pieces, piece).whole.push(file_idx);
                continue;
            }
            // Triangles without area are no faces: the points on them are on their neighbours.
            let Some(face) = faces.faces.get(next).filter(|face| face.file_idx == file_idx) else {
                continue;
            };
            let picks = self.of(pieces, piece);
            let range = parts.starts[next] as usize..parts.starts[next + 1] as usize;
            if parts.is_whole[next] && parts.keeps_corners[next] {
                picks.whole.push(file_idx);
            } else if parts.is_whole[next] {
                picks.add_part(cut, face.vertices);
            } else {
                for fragment in range.filter(|fragment| stays[*fragment]) {
                    picks.add_part(cut, cut.fragments[fragment].points);
                }
            }
            next += 1;
        }
    }
}

/// Triangles of one mesh.
struct Picks {
    /// Numbers in the file; [`u32::MAX`] for the next part.
    whole: Vec<u32>,
    /// Triangles over the points of the file and the new ones.
    parts: Vec<[u32; 3]>,
    n_vertices: usize,
    new_points: Vec<DVec3>,
    /// New numbers of points by their numbers in the cut, from the count of vertices on.
    numbers: Vec<u32>,
}

impl Picks {
    fn new(mesh: &TriangleMesh) -> Self {
        Self {
            whole: Vec::new(),
            parts: Vec::new(),
            n_vertices: mesh.vertices.len(),
            new_points: Vec::new(),
            numbers: Vec::new(),
        }
    }

    fn add_part(&mut self, cut: &Cut, points: [u32; 3]) {
        self.whole.push(u32::MAX);
        self.numbers.resize(cut.positions.len() - self.n_vertices, u32::MAX);
        let points = points.map(|point| {
            let Some(new) = (point as usize).checked_sub(self.n_vertices) else { return point };
            if self.numbers[new] == u32::MAX {
                self.numbers[new] = (self.n_vertices + self.new_points.len()) as u32;
                self.new_points.push(cut.positions[point as usize]);
            }
            self.numbers[new]
        });
        self.parts.push(points);
    }

    /// The mesh; `with_all` keeps all vertices of the file, else only those in use.
    fn finish(self, mesh: &TriangleMesh, pieces: &Pieces, with_all: bool) -> TriangleMesh {
        if self.whole.is_empty() {
            return TriangleMesh::default();
        }
        let mut parts = self.parts.into_iter();
        let mut triangles: Vec<[u32; 3]> = Vec::with_capacity(self.whole.len());
        for file_idx in self.whole {
            if file_idx == u32::MAX {
                triangles.extend(parts.next());
                continue;
            }
            let mut corners = mesh.triangles[file_idx as usize];
            if pieces.is_welded {
                corners = pieces.corners[file_idx as usize];
            } else if pieces.turned[file_idx as usize] {
                corners.swap(1, 2);
            }
            triangles.push(corners);
        }
        let position = |point: u32| match (point as usize).checked_sub(self.n_vertices) {
            None => mesh.vertices[point as usize],
            Some(new) => self.new_points[new],
        };
        if with_all {
            let mut vertices = mesh.vertices.clone();
            vertices.extend(&self.new_points);
            return TriangleMesh { vertices, triangles };
        }
        let mut numbers = vec![u32::MAX; self.n_vertices + self.new_points.len()];
        let mut vertices = Vec::new();
        for point in triangles.as_flattened_mut() {
            let number = &mut numbers[*point as usize];
            if *number == u32::MAX {
                *number = vertices.len() as u32;
                vertices.push(position(*point));
            }
            *point = *number;
        }
        TriangleMesh { vertices, triangles }
    }
}
