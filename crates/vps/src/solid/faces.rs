//! The triangles that take part in a union, with their planes, edges and boxes.

use glam::DVec3;

use super::columns;
use super::lines::Lines;
use super::pieces::{NO_PIECE, Pieces};
use crate::mesh::TriangleMesh;
use crate::mesh::boxes::Boxes;
use crate::parallel;

/// A triangle.
#[derive(Clone, Copy, Debug)]
pub(super) struct Face {
    /// Welded corners.
    pub(super) vertices: [u32; 3],
    pub(super) corners: [DVec3; 3],
    /// Unit length.
    pub(super) normal: DVec3,
    /// Numbers of the lines from each corner to the next.
    pub(super) edges: [u32; 3],
    pub(super) piece: u32,
    /// Number of the triangle in the file.
    pub(super) file_idx: u32,
    pub(super) closed: bool,
    /// Its piece meets itself.
    pub(super) meets_itself: bool,
}

impl Face {
    /// Height of a point over the plane, m.
    pub(super) fn height(&self, point: DVec3) -> f64 {
        (point - self.corners[0]).dot(self.normal)
    }

    pub(super) fn low(&self) -> DVec3 {
        self.corners[0].min(self.corners[1]).min(self.corners[2])
    }

    pub(super) fn high(&self) -> DVec3 {
        self.corners[0].max(self.corners[1]).max(self.corners[2])
    }

    /// The foot of a point on the plane lies within the triangle.
    pub(super) fn is_over(&self, point: DVec3) -> bool {
        (0..3).all(|k| {
            let from = self.corners[k];
            let to = self.corners[(k + 1) % 3];
            (to - from).cross(point - from).dot(self.normal) >= 0.0
        })
    }

    fn ends_of_edge(&self, k: usize) -> [u32; 2] {
        [self.vertices[k], self.vertices[(k + 1) % 3]]
    }
}

/// What takes part.
#[derive(Debug)]
pub(super) struct Faces {
    /// In the order of the file. A triangle without area is none: its middle corner lies on the
    /// line between the other two, and that says all.
    pub(super) faces: Vec<Face>,
    pub(super) by_piece: Vec<PieceFaces>,
    /// Of `by_piece`.
    pub(super) piece_boxes: Boxes,
}

/// The faces of one piece.
#[derive(Debug)]
pub(super) struct PieceFaces {
    pub(super) piece: u32,
    pub(super) closed: bool,
    /// In rising order.
    pub(super) faces: Vec<u32>,
    pub(super) low: DVec3,
    pub(super) high: DVec3,
    /// Of `faces`; none for a few faces, which are looked at one by one.
    boxes: Option<Boxes>,
}

/// A loop over so many faces takes as long as a tree.
const FEW_FACES: usize = 24;

impl Faces {
    /// The triangles of the pieces that take part, and the lines of their edges.
    pub(super) fn of(
        mesh: &TriangleMesh,
        pieces: &Pieces,
        takes_part: &[bool],
        tolerance_m: f64,
    ) -> (Self, Lines) {
        let which: Vec<u32> = (0..pieces.piece_of.len() as u32)
            .filter(|file_idx| {
                let piece = pieces.piece_of[*file_idx as usize];
                piece != NO_PIECE && takes_part[piece as usize]
            })
            .collect();
        let made = parallel::map(which.len(), 64, |k| {
            let file_idx = which[k];
            let vertices = pieces.corners[file_idx as usize];
            let corners = vertices.map(|vertex| mesh.vertices[vertex as usize]);
            let piece = pieces.piece_of[file_idx as usize];
            let [a, b, c] = corners;
            let cross = (b - a).cross(c - a);
            let longest = a.distance(b).max(b.distance(c)).max(c.distance(a));
            let of_piece = &pieces.pieces[piece as usize];
            let face = Face {
                vertices,
                corners,
                normal: cross.normalize_or_zero(),
                edges: [0; 3],
                piece,
                file_idx,
                closed: of_piece.closed,
                meets_itself: of_piece.meets_itself,
            };
            let has_area = cross.length() > tolerance_m * longest && face.normal != DVec3::ZERO;
            (face, has_area)
        });
        let edges: Vec<[u32; 2]> =
            made.iter().flat_map(|(face, _)| [0, 1, 2].map(|k| face.ends_of_edge(k))).collect();
        let mut lines = Lines::of(edges);
        let mut faces = Vec::with_capacity(made.len());
        let numbers = parallel::map(made.len(), 64, |k| {
            [0, 1, 2].map(|edge| lines.number_of(made[k].0.ends_of_edge(edge)))
        });
        for ((mut face, has_area), edges) in made.into_iter().zip(numbers) {
            face.edges = edges.map(|number| number.unwrap_or_default());
            if has_area {
                faces.push(face);
                continue;
            }
            let length = |k: usize| face.corners[k].distance(face.corners[(k + 1) % 3]);
            let longest = [1, 2]
                .into_iter()
                .fold(0, |best, k| if length(k) > length(best) { k } else { best });
            lines.put_on(face.edges[longest], face.vertices[(longest + 2) % 3]);
        }
        let by_piece = faces_by_piece(&faces, pieces.pieces.len());
        let piece_boxes = Boxes::new(by_piece.len(), |k| (by_piece[k].low, by_piece[k].high));
        (Self { faces, by_piece, piece_boxes }, lines)
    }

    /// Calls `found` with the faces whose boxes meet the box from `low` to `high`.
    pub(super) fn meeting(&self, low: DVec3, high: DVec3, mut found: impl FnMut(u32)) {
        self.piece_boxes.meeting(low, high, |number| {
            self.meeting_in(&self.by_piece[number as usize], low, high, &mut found);
        });
    }

    /// The same with the faces of one piece.
    pub(super) fn meeting_in(
        &self,
        of_piece: &PieceFaces,
        low: DVec3,
        high: DVec3,
        mut found: impl FnMut(u32),
    ) {
        match &of_piece.boxes {
            Some(boxes) => {
                boxes.meeting(low, high, |place| found(of_piece.faces[place as usize]));
            }
            None => {
                for number in &of_piece.faces {
                    let face = &self.faces[*number as usize];
                    if face.low().cmple(high).all() && low.cmple(face.high()).all() {
                        found(*number);
                    }
                }
            }
        }
    }

    /// Turns the faces of whole pieces round.
    pub(super) fn turn_pieces(&mut self, which: &[bool]) {
        for face in self.faces.iter_mut().filter(|face| which[face.piece as usize]) {
            face.vertices.swap(1, 2);
            face.corners.swap(1, 2);
            face.edges.swap(0, 2);
            face.normal = -face.normal;
        }
    }

    /// Calls `found` with each closed piece whose box holds the point, and with what computes its
    /// winding number there.
    pub(super) fn windings(&self, point: DVec3, mut found: impl FnMut(u32, &dyn Fn() -> i32)) {
        self.closed_pieces_near(point, 0.0, |of_piece| {
            found(of_piece.piece, &|| self.winding_of(of_piece, point));
        });
    }

    /// Calls `found` with the closed pieces whose boxes come so near to a point.
    pub(super) fn closed_pieces_near(
        &self,
        point: DVec3,
        within_m: f64,
        mut found: impl FnMut(&PieceFaces),
    ) {
        self.piece_boxes.meeting(point - within_m, point + within_m, |number| {
            let of_piece = &self.by_piece[number as usize];
            if of_piece.closed {
                found(of_piece);
            }
        });
    }

    /// The winding number of a closed piece at a point.
    pub(super) fn winding_of(&self, of_piece: &PieceFaces, point: DVec3) -> i32 {
        let corners_of = |place: u32| self.faces[of_piece.faces[place as usize] as usize].corners;
        let mut winding = 0;
        match &of_piece.boxes {
            None => {
                for place in 0..of_piece.faces.len() as u32 {
                    winding += columns::crossing(&corners_of(place), point);
                }
            }
            Some(boxes) => columns::above(boxes, corners_of, point, |way| winding += way),
        }
        winding
    }
}

/// The faces by piece.
fn faces_by_piece(faces: &[Face], n_pieces: usize) -> Vec<PieceFaces> {
    let mut place_of = vec![usize::MAX; n_pieces];
    let mut by_piece: Vec<PieceFaces> = Vec::new();
    for (number, face) in (0_u32..).zip(faces) {
        let place = &mut place_of[face.piece as usize];
        if *place == usize::MAX {
            *place = by_piece.len();
            by_piece.push(PieceFaces {
                piece: face.piece,
                closed: face.closed,
                faces: Vec::new(),
                low: DVec3::INFINITY,
                high: DVec3::NEG_INFINITY,
                boxes: None,
            });
        }
        let piece = &mut by_piece[*place];
        piece.faces.push(number);
        piece.low = piece.low.min(face.low());
        piece.high = piece.high.max(face.high());
    }
    for piece in by_piece.iter_mut().filter(|piece| piece.faces.len() > FEW_FACES) {
        piece.boxes = Some(Boxes::new(piece.faces.len(), |place| {
            let face = &faces[piece.faces[place] as usize];
            (face.low(), face.high())
        }));
    }
    by_piece
}
