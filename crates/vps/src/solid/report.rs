//! What was found in a file, in figures and in sentences.

use crate::mesh::mass::MassProperties;

/// A hollow inside of a body.
///
/// # Examples
/// ```
/// # use vps::{DVec3, Mesh, Shape};
/// # let [outer, inner] = [20e-3, 10e-3].map(|edge_m| {
/// #     Mesh::from_shape(&Shape::Box { size_m: DVec3::splat(edge_m) }, 1e-5)
/// # });
/// # let outer = outer?;
/// # let inner = inner?;
/// # let corners = outer.vertices().iter().chain(inner.vertices());
/// # let corners: Vec<_> = corners.map(|at| at.to_array()).collect();
/// # let inward = inner.triangles().iter().map(|[a, b, c]| [a + 8, c + 8, b + 8]);
/// # let triangles: Vec<_> = outer.triangles().iter().copied().chain(inward).collect();
/// // A cube of 20 mm around a hollow cube of 10 mm.
/// let hollow = Mesh::from_arrays(&corners, &triangles)?;
/// let cavity = hollow.solid().cavities[0];
/// assert!((cavity.volume_m3 - 1e-6).abs() < 1e-12);
/// assert!((hollow.mass_properties().volume_m3 - 7e-6).abs() < 1e-12);
/// # Ok::<(), vps::Error>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cavity {
    /// What its shell encloses without the bodies in it, m³.
    pub volume_m3: f64,
    /// Triangles of its shell.
    pub n_triangles: usize,
}

/// What the triangles of a file were taken for.
#[derive(Clone, Debug)]
pub struct SolidReport {
    /// Triangles of the file.
    pub triangles: usize,
    /// Connected pieces.
    pub pieces: usize,
    /// Closed pieces that are material inside.
    pub bodies: usize,
    /// Closed pieces inside of bodies that face inward, and are not filled by others; in the order
    /// of the file.
    pub cavities: Vec<Cavity>,
    /// Pieces that are not closed.
    pub open_pieces: usize,
    /// Area of these outside of the solid, m².
    pub open_area_m2: f64,
    /// Triangles whose corners fall together; left out.
    pub degenerate_triangles: usize,
    /// Triangles with the same corners as an earlier one; left out.
    pub repeated_triangles: usize,
    /// Triangles that faced another way than the rest of their piece; turned.
    pub inconsistent_triangles: usize,
    /// Closed pieces that have no inside, like a Klein bottle; they are skins.
    pub not_orientable: usize,
    /// Every closed piece faced inward; all were turned.
    pub inside_out: bool,
    /// Closed pieces that faced the wrong way: inward, but not inside of a body, or outward in such
    /// a piece; turned.
    pub turned_pieces: usize,
    /// Edges that were open and were joined with others beside them.
    pub joined_cracks: usize,
    /// Area of triangles that lie inside of the solid or on others, left out, m².
    pub inside_area_m2: f64,
    /// Triangles of which a part was left out.
    pub cut_triangles: usize,
    /// Edges at which the border was open, and was closed by triangles of which the file says
    /// nothing.
    pub open_edges: usize,
    /// Pieces meet in too many places: what lies inside of the solid was not left out.
    pub tangled: bool,
    /// The volume that the pieces enclose, m³, where the border has another one, by more than
    /// tolerances explain.
    pub volume_of_pieces_m3: Option<f64>,
    /// Volume, centre and inertia of the solid; of its skins if it has no inside.
    pub mass: MassProperties,
}

impl SolidReport {
    /// How many hollows there are, and what they enclose; `None` without any.
    pub(crate) fn hollows_text(&self) -> Option<String> {
        let volume_m3 = self.cavities.iter().fold(0.0, |sum, cavity| sum + cavity.volume_m3);
        let volume = volume_text(volume_m3);
        match self.cavities.len() {
            0 => None,
            1 => Some(format!("a hollow of {volume}")),
            n => Some(format!("{n} hollows of {volume} together")),
        }
    }

    /// One sentence per thing that a user should look at, beyond what
    /// [`MeshReport::warnings`](crate::mesh::validate::MeshReport::warnings) says; empty for one
    /// closed piece. What becomes of open pieces is decided by the voxels.
    pub fn warnings(&self) -> Vec<String> {
        let mut warnings = Vec::new();
        let mut count = |n: usize, one: &str, many: &str| match n {
            0 => {}
            1 => warnings.push(format!("1 {one}")),
            n => warnings.push(format!("{n} {many}")),
        };
        count(
            self.inconsistent_triangles,
            "triangle faced another way than its neighbours and was turned",
            "triangles faced another way than their neighbours and were turned",
        );
        count(
            self.not_orientable,
            "closed piece has no inside and counts as a skin",
            "closed pieces have no inside and count as skins",
        );
        count(
            self.turned_pieces,
            "piece faced the wrong way for where it lies and was turned",
            "pieces faced the wrong way for where they lie and were turned",
        );
        count(
            self.joined_cracks,
            "open edge lies along another and was joined with it",
            "open edges lie along others and were joined with them",
        );
        count(
            self.open_edges,
            "edge of the border was open where pieces meet, and was closed by a guess",
            "edges of the border were open where pieces meet, and were closed by a guess",
        );
        if self.inside_out {
            warnings.push("every closed piece faced inward: all were turned".to_owned());
        }
        warnings.extend(self.hollows_text().map(|hollows| format!("{hollows}: empty")));
        if self.inside_area_m2 > 0.0 {
            let area = area_text(self.inside_area_m2);
            warnings.push(format!("{area} of surface lie inside of the solid and were left out"));
        }
        if let Some(right_m3) = self.volume_of_pieces_m3 {
            warnings.push(format!(
                "{} lie inside of the border and {right} inside of the pieces: where faces of two \
                 pieces nearly lie on each other, the wrong ones were left out",
                volume_text(self.mass.volume_m3),
                right = volume_text(right_m3),
            ));
        }
        if self.tangled {
            warnings.push(
                "pieces meet in too many places: surface inside of the solid was not left out"
                    .to_owned(),
            );
        }
        warnings
    }
}

/// Three digits, or all before the point.
fn digits(value: f64) -> String {
    let digits = match value.abs() {
        v if v >= 100.0 => 0,
        v if v >= 10.0 => 1,
        _ => 2,
    };
    format!("{value:.digits$}")
}

fn volume_text(volume_m3: f64) -> String {
    if volume_m3 >= 1e-3 {
        format!("{} m³", digits(volume_m3))
    } else {
        format!("{} mm³", digits(1e9 * volume_m3))
    }
}

fn area_text(area_m2: f64) -> String {
    if area_m2 >= 1.0 {
        format!("{} m²", digits(area_m2))
    } else {
        format!("{} mm²", digits(1e6 * area_m2))
    }
}
