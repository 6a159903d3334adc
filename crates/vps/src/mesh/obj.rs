//! Wavefront OBJ: every group of a file as one mesh.
//!
//! The text is parsed by `tobj`, behind a filter that lets only vertices (`v`) and faces (`f`)
//! through. So materials, texture coordinates, normals, curves, points and lines cannot make a file
//! unreadable, groups share the vertices of the file, and the filter knows the line at which the
//! parser stopped. Joined lines (`\` at the end) and text that is not UTF-8 are accepted.
//!
//! Data in: bytes. Data out: triangles over the file's positions, those that faces use, in the
//! order of first use.

use std::borrow::Cow;
use std::io::{self, BufRead, Read};
use std::path::Path;

use glam::DVec3;
use tobj::LoadError;

use super::points::Cloud;
use super::{MeshError, TriangleMesh, polygon};

/// Reads the text of an OBJ file; `path` is for messages only.
pub(super) fn parse(bytes: &[u8], path: &Path) -> Result<TriangleMesh, MeshError> {
    let text = text_of(bytes);
    let mut lines = GeometryLines::new(&text);
    // Faces keep their corners here: the parser would cut hollow polygons into fans.
    let options = tobj::LoadOptions {
        triangulate: false,
        ignore_points: true,
        ignore_lines: true,
        ..Default::default()
    };
    let loaded = tobj::load_obj_buf(&mut lines, &options, |_| Err(LoadError::OpenFileFailed));
    if let Some((vertex, line)) = lines.non_finite {
        return Err(MeshError::NonFiniteVertex { path: path.to_owned(), vertex, line: Some(line) });
    }
    let models = match loaded {
        Ok((models, _)) => models,
        Err(LoadError::FaceVertexOutOfBounds) => return Err(bad_index(&text, path)),
        Err(error) => return Err(parse_error(error, &lines, path)),
    };

    let mut mesh = TriangleMesh::default();
    for tobj::Model { mesh: model, .. } in models {
        // One model at most, as no group passes the filter; the loop costs nothing and does not
        // depend on that.
        let base = u32::try_from(mesh.vertices.len()).unwrap_or(u32::MAX);
        mesh.vertices.extend(model.positions.chunks_exact(3).map(DVec3::from_slice));
        let indices: Vec<u32> =
            model.indices.iter().map(|index| base.saturating_add(*index)).collect();
        if model.face_arities.is_empty() {
            mesh.triangles.extend(
                indices.chunks_exact(3).map(|corners| [corners[0], corners[1], corners[2]]),
            );
        } else {
            let mut rest = &indices[..];
            for arity in model.face_arities {
                let (face, later) = rest.split_at_checked(arity as usize).unwrap_or((rest, &[]));
                polygon::triangulate(&mesh.vertices, face, &mut mesh.triangles);
                rest = later;
            }
        }
    }
    Ok(mesh)
}

/// Reads the vertices of an OBJ file as points; `None` when the file has faces. Normals (`vn`) are
/// those of the vertices when there are as many of them; colours are numbers four to six of a
/// vertex, 0 to 1.
pub(super) fn parse_cloud(bytes: &[u8], path: &Path) -> Result<Option<Cloud>, MeshError> {
    let text = text_of(bytes);
    let mut cloud = Cloud::default();
    let mut normals = Vec::new();
    let mut colors = Vec::new();
    for (number, line) in LogicalLines::new(&text) {
        let line = line.split('#').next().unwrap_or_default();
        let kind = keyword(line);
        if kind == "f" {
            return Ok(None);
        }
        if kind != "v" && kind != "vn" {
            continue;
        }
        let numbers: Option<Vec<f64>> =
            line.split_whitespace().skip(1).map(|word| word.parse().ok()).collect();
        let numbers = numbers.filter(|numbers| numbers.len() >= 3).ok_or_else(|| {
            let what = if kind == "v" { "vertex" } else { "normal" };
            let shown: String = line.trim().chars().take(60).collect();
            let what = format!("a {what} needs three numbers, found `{shown}`");
            MeshError::Parse { path: path.to_owned(), line: Some(number), what }
        })?;
        let vector = DVec3::from_slice(&numbers);
        if kind == "vn" {
            normals.push(vector);
            continue;
        }
        if !vector.is_finite() {
            let vertex = cloud.positions.len() + 1;
            return Err(MeshError::NonFiniteVertex {
                path: path.to_owned(),
                vertex,
                line: Some(number),
            });
        }
        cloud.positions.push(vector);
        if let [_, _, _, red, green, blue] = numbers[..] {
            colors.push([red, green, blue].map(|part| (part * 255.0).round() as u8));
        }
    }
    cloud.normals = (normals.len() == cloud.positions.len()).then_some(normals);
    cloud.colors = (colors.len() == cloud.positions.len()).then_some(colors);
    Ok(Some(cloud))
}

/// The text, in lines that end in LF: programs of old Macs end them in CR alone.
fn text_of(bytes: &[u8]) -> Cow<'_, str> {
    let text = String::from_utf8_lossy(bytes);
    if text.contains('\r') && !text.contains('\n') { text.replace('\r', "\n").into() } else { text }
}

/// The first face that names a vertex which is not there. The parser only says that there is one.
#[cold]
fn bad_index(text: &str, path: &Path) -> MeshError {
    let vertices = LogicalLines::new(text).filter(|(_, line)| keyword(line) == "v").count();
    let mut seen = 0_i64;
    for (number, line) in LogicalLines::new(text) {
        match keyword(&line) {
            "v" => seen += 1,
            "f" => {
                let face = line.split('#').next().unwrap_or_default();
                let corners = face
                    .split_whitespace()
                    .skip(1)
                    .filter_map(|corner| corner.split('/').next()?.parse::<i64>().ok());
                for index in corners {
                    let absolute = if index < 0 { seen + index + 1 } else { index };
                    if absolute < 1
                        || usize::try_from(absolute).is_ok_and(|absolute| absolute > vertices)
                    {
                        return MeshError::IndexOutOfRange {
                            path: path.to_owned(),
                            line: Some(number),
                            index,
                            vertices,
                        };
                    }
                }
            }
            _ => {}
        }
    }
    MeshError::Parse {
        path: path.to_owned(),
        line: None,
        what: "a face lacks the number of a vertex".to_owned(),
    }
}

#[cold]
fn parse_error(error: LoadError, lines: &GeometryLines<'_>, path: &Path) -> MeshError {
    let shown: String = lines.current.trim().chars().take(60).collect();
    let what = match error {
        LoadError::PositionParseError => format!("a vertex needs three numbers, found `{shown}`"),
        LoadError::ScalingByZeroError => {
            format!("the fourth number of a vertex must not be zero, found `{shown}`")
        }
        LoadError::FaceParseError => format!("a face is a list of vertex numbers, found `{shown}`"),
        other => format!("{other}, found `{shown}`"),
    };
    MeshError::Parse { path: path.to_owned(), line: Some(lines.line), what }
}

fn keyword(line: &str) -> &str {
    line.split_whitespace().next().unwrap_or_default()
}

/// Lines with their number from 1, those that end in a backslash joined with the next.
struct LogicalLines<'a> {
    physical: std::iter::Enumerate<std::str::Lines<'a>>,
}

impl<'a> LogicalLines<'a> {
    fn new(text: &'a str) -> Self {
        // Some programs begin UTF-8 text with a byte order mark.
        Self { physical: text.trim_start_matches('\u{feff}').lines().enumerate() }
    }
}

impl<'a> Iterator for LogicalLines<'a> {
    type Item = (usize, Cow<'a, str>);

    fn next(&mut self) -> Option<Self::Item> {
        let (number, line) = self.physical.next()?;
        let Some(head) = line.strip_suffix('\\') else {
            return Some((number + 1, Cow::Borrowed(line)));
        };
        let mut joined = head.to_owned();
        for (_, more) in self.physical.by_ref() {
            joined.push(' ');
            match more.strip_suffix('\\') {
                Some(head) => joined.push_str(head),
                None => {
                    joined.push_str(more);
                    break;
                }
            }
        }
        Some((number + 1, Cow::Owned(joined)))
    }
}

/// A reader that shows vertices and faces only, one line per call, and remembers where it is.
struct GeometryLines<'a> {
    lines: LogicalLines<'a>,
    /// The line in the reader's hands, with its end of line.
    current: String,
    consumed: usize,
    /// Number of that line.
    line: usize,
    n_vertices: usize,
    /// First vertex that is not finite: its number and its line.
    non_finite: Option<(usize, usize)>,
}

impl<'a> GeometryLines<'a> {
    fn new(text: &'a str) -> Self {
        Self {
            lines: LogicalLines::new(text),
            current: String::new(),
            consumed: 0,
            line: 0,
            n_vertices: 0,
            non_finite: None,
        }
    }

    fn advance(&mut self) {
        self.current.clear();
        self.consumed = 0;
        for (number, line) in self.lines.by_ref() {
            // A comment may follow on the same line.
            let line = line.split('#').next().unwrap_or_default();
            let mut words = line.split_whitespace();
            match words.next() {
                Some("v") => {
                    self.n_vertices += 1;
                    // Four numbers are a weighted point; five and more are a position and a colour
                    // or a measure of trust.
                    let n_words = if words.clone().count() == 4 { 4 } else { 3 };
                    self.current.push('v');
                    for word in words.take(n_words) {
                        if self.non_finite.is_none()
                            && word.parse().is_ok_and(|number: f64| !number.is_finite())
                        {
                            self.non_finite = Some((self.n_vertices, number));
                        }
                        self.current.push(' ');
                        self.current.push_str(word);
                    }
                }
                // A face without a corner would stop the parser at the end of the file, too late to
                // name the line.
                Some("f") if words.next().is_some() => self.current.push_str(line),
                _ => continue,
            }
            self.current.push('\n');
            self.line = number;
            return;
        }
    }
}

impl Read for GeometryLines<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let n = self.fill_buf()?.read(buffer)?;
        self.consume(n);
        Ok(n)
    }
}

impl BufRead for GeometryLines<'_> {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        if self.consumed == self.current.len() {
            self.advance();
        }
        Ok(&self.current.as_bytes()[self.consumed..])
    }

    fn consume(&mut self, amount: usize) {
        self.consumed = (self.consumed + amount).min(self.current.len());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<TriangleMesh, MeshError> {
        parse(text.as_bytes(), Path::new("part.obj"))
    }

    #[test]
    fn groups_share_vertices_and_missing_materials_do_not_matter() {
        let text = "mtllib not-there.mtl\no one\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvn 0 0 \
            1\nusemtl steel\nf 1/1/1 2/1/1 3/1/1\ng two\nv 1 1 0.1234567890123456\nusemtl\nf 2//1 \
            4//1 3//1\ng\ns off\n";
        let mesh = read(text).unwrap();
        assert_eq!(mesh.triangles, [[0, 1, 2], [1, 3, 2]]);
        assert_eq!(mesh.vertices.len(), 4);
        assert_eq!(mesh.vertices[3].z, 0.123_456_789_012_345_6);
    }

    #[test]
    fn negative_indices_count_back_from_the_face() {
        let mesh = read(
            "v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\nv 5 0 0\nv 6 0 0\nv 5 1 0\nf -3/-1 \
            -2/-1 -1/-1\n",
        )
        .unwrap();
        assert_eq!(
            mesh.corners(1),
            [DVec3::new(5.0, 0.0, 0.0), DVec3::new(6.0, 0.0, 0.0), DVec3::new(5.0, 1.0, 0.0)]
        );
    }

    #[test]
    fn quads_and_polygons_are_cut_points_and_lines_ignored() {
        let text = "v 0 0 0\nv 2 0 0\nv 2 1 0\nv 1 1 0\nv 1 2 0\nv 0 2 0\np 1\nl 1 2 3\nf 1\nf 1 \
            2\nf\nf 1 2 3 4\nf 1 2 3 4 5 6\n";
        let mesh = read(text).unwrap();
        assert_eq!(mesh.triangles.len(), 2 + 4);
        let area: f64 =
            (2..6).map(|k| mesh.corners(k)).map(|[a, b, c]| (b - a).cross(c - a).z / 2.0).sum();
        assert!((area - 3.0).abs() < 1e-15);
    }

    #[test]
    fn faces_may_come_before_their_vertices() {
        assert_eq!(read("f 1 2 3\nv 0 0 0\nv 1 0 0\nv 0 1 0\n").unwrap().triangles.len(), 1);
    }

    #[test]
    fn odd_but_usual_text_is_read() {
        let text = "\u{feff}# comment\r\nv 0 0 0 0.5 0.5 0.5\r\nv 1 0 0 0.9 12\r\nv 0 2 0 2 # \
            weighted\r\nvt 1\r\nf 1 \\\r\n  2 3 # face\r\n";
        let mesh = read(text).unwrap();
        assert_eq!(mesh.corners(0), [DVec3::ZERO, DVec3::X, DVec3::Y]);
        let latin1 = b"# pi\xe8ce\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
        assert_eq!(parse(latin1, Path::new("part.obj")).unwrap().triangles.len(), 1);
    }

    #[test]
    fn errors_name_the_line_and_the_value() {
        let message = |text: &str| read(text).unwrap_err().to_string();
        assert_eq!(
            message("v 0 0 0\n\nv 1 x 0\n"),
            "part.obj:3: a vertex needs three numbers, found `v 1 x 0`"
        );
        assert_eq!(message("v 0 0\n"), "part.obj:1: a vertex needs three numbers, found `v 0 0`");
        assert_eq!(
            message("v 0 0 0 0\n"),
            "part.obj:1: the fourth number of a vertex must not be zero, found `v 0 0 0 0`"
        );
        assert_eq!(
            message("# c\nf a b c\n"),
            "part.obj:2: a face is a list of vertex numbers, found `f a b c`"
        );
        let three = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
        assert_eq!(
            message(&format!("{three}f 1 2 3 # 8\nf 1 2 9\n")),
            "part.obj:5: face names vertex 9, the file has 3"
        );
        assert_eq!(
            message(&format!("{three}f 1 2 -4\n")),
            "part.obj:4: face names vertex -4, the file has 3"
        );
        assert_eq!(
            message(&format!("{three}f 0 1 2\n")),
            "part.obj:4: face names vertex 0, the file has 3"
        );
        assert_eq!(
            message(&format!("{three}f /1 2 3\n")),
            "part.obj: a face lacks the number of a vertex"
        );
        assert_eq!(message("v 0 0 0\nv 0 nan 0\n"), "part.obj:2: vertex 2 is not finite");
        assert_eq!(
            message("v 0 0 0\nv 0 0 0\nv 1e999 0 0\nf 1 2 3\n"),
            "part.obj:3: vertex 3 is not finite"
        );
    }
}
