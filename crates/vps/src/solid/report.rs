//! What was found in a file, in figures and in sentences.

use crate::mesh::mass::MassProperties;

/// A hollow inside of a body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cavity {
    /// What its shell encloses, m³.
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
    /// Closed pieces inside of bodies that face inward, and are empty; in the order of the file.
    pub cavities: Vec<Cavity>,
    /// Pieces that are not closed.
    pub skins: usize,
    /// Area of the skins that is left, m².
    pub skin_area_m2: f64,
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
    /// Closed pieces that faced inward outside of every body; turned.
    pub turned_pieces: usize,
    /// Area of triangles that lie inside of the solid or on others, left out, m².
    pub inside_area_m2: f64,
    /// Triangles of which a part was left out.
    pub cut_triangles: usize,
    /// Pieces meet in too many places: what lies inside of the solid was not left out.
    pub tangled: bool,
    /// Volume, centre and inertia of the solid; of its skins if it has no inside.
    pub mass: MassProperties,
}

impl SolidReport {
    /// One sentence per thing that a user should look at; empty for one closed piece.
    pub fn warnings(&self) -> Vec<String> {
        let mut warnings = Vec::new();
        let mut count = |n: usize, one: &str, many: &str| match n {
            0 => {}
            1 => warnings.push(format!("1 {one}")),
            n => warnings.push(format!("{n} {many}")),
        };
        count(
            self.degenerate_triangles,
            "triangle without area was left out",
            "triangles without area were left out",
        );
        count(
            self.repeated_triangles,
            "triangle repeats another and was left out",
            "triangles repeat others and were left out",
        );
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
            "piece faced inward outside of every body and was turned",
            "pieces faced inward outside of every body and were turned",
        );
        if self.inside_out {
            warnings.push("every closed piece faced inward: all were turned".to_owned());
        }
        for cavity in &self.cavities {
            warnings.push(format!("a hollow of {} is empty", volume_text(cavity.volume_m3)));
        }
        if self.inside_area_m2 > 0.0 {
            let area = area_text(self.inside_area_m2);
            warnings.push(format!("{area} of surface lie inside of the solid and were left out"));
        }
        if self.skins > 0 {
            let pieces = if self.skins == 1 { "piece is" } else { "pieces are" };
            let area = area_text(self.skin_area_m2);
            warnings.push(format!("{} {pieces} not closed: a skin of {area}", self.skins));
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
