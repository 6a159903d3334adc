//! What the triangles of a file mean: one solid, and skins beside it.
//!
//! Data in: triangles as a file has them: pieces that touch, overlap or lie in each other, hollows,
//! loose sheets, faces that stand twice or face inward. Data out: a [`Solid`]: the border of the
//! union of all bodies without their cavities, the skins of pieces that are not closed, and a
//! report. Metres, in the frame of the file.
//!
//! ```text
//!  triangles ─► pieces ─► nesting ─► contacts ─► cut ─► judge ─► lids ─► border, skins
//!                weld,    bodies,    points and  frag-  which
//!                winding  cavities   lines       ments  stay
//! ```
//!
//! | module | owns |
//! |---|---|
//! | `pieces` | welding, repeats, connected pieces, their winding |
//! | `damage` | single triangles that stand once too often or face the wrong way |
//! | `around_edge` | the order of triangles around an edge |
//! | `nesting` | bodies, cavities, pieces that face the wrong way |
//! | `faces`, `lines` | triangles that take part, their edges and what lies on them |
//! | `cracks` | open edges beside each other |
//! | `self_meets` | pieces that pass through themselves |
//! | `contacts` | what two triangles have in common |
//! | `cut`, `triangulate` | fragments |
//! | `judge`, `columns` | winding numbers on both sides of fragments |
//! | `lids` | closing what is left open in the border |
//! | `verify` | whether the border bounds what its pieces say |
//! | `build`, `report` | the result |
//!
//! # The definition
//! A closed piece is a body if it faces outward, a cavity if it faces inward inside of a body, and
//! turned round if it faces inward elsewhere. Inside is where the winding number of all of them is 1
//! or more; the border is where inside ends.
//!
//! # Invariants
//! Cold. The same bits for any number of threads; no panic, whatever the triangles. The border is
//! closed: what judging leaves open is closed by lids, and said where these are wider than
//! tolerances and rounding explain. A piece whose box meets no other and that does not pass through
//! itself is not cut: of a file of one such piece, the border is the file.
//!
//! # Cost
//! Linear in the file, in parallel, about that of two inspections; for pieces whose boxes meet,
//! n log n, and linear in what meets. What is cut at most is bounded (`cut::Limits`).
//!
//! # Limits
//! What is thinner than a few tolerances, or two places nearer than that, may be on the wrong side
//! of the border. Where triangles without area lie in an edge of two bodies that touch and face
//! opposite ways, the two are not told apart. A body that faces inward and is walled in by others on
//! all sides is a cavity: from its triangles alone it is one. Of a body that stands twice, once
//! facing inward, and shares walls with others, triangle by triangle, those that stand three times
//! count once.
//!
//! # Source
//! Zhou2016, sections 3 and 4: the winding number as the measure of inside, asked once per patch
//! between the curves where surfaces meet. We work within a tolerance instead of exactly, as faces
//! that were meant to lie on each other do so nearly.

mod around_edge;
mod build;
mod columns;
mod contacts;
mod cracks;
mod cut;
mod damage;
#[cfg(test)]
mod damage_tests;
mod faces;
mod judge;
mod lids;
mod lines;
#[cfg(test)]
mod near_faces;
mod nesting;
mod open_parts;
mod pieces;
mod report;
mod self_meets;
#[cfg(test)]
mod tests;
mod triangulate;
mod verify;

pub use build::{Solid, SolidOptions};
pub use report::{Cavity, SolidReport};
