//! PLY, text and binary of both byte orders.
//!
//! Data in: bytes. Data out: the vertices of the file, with normals and colours where it has no
//! faces, and triangles from its polygons (`face`) and strips (`tristrips`, where -1 begins the
//! next strip). Numbers of any type are read; other elements and properties are skipped. Invariant:
//! no allocation is larger than what the bytes at hand can fill, whatever the header announces.
//! Cost: linear.
//!
//! # Source
//! Greg Turk, "The PLY Polygon File Format" (1994); `tristrips` as in the files of the Stanford 3D
//! Scanning Repository.

mod header;

use std::path::Path;

use glam::DVec3;

use self::header::{Element, Encoding, Header, Scalar};
use super::format::without_mark;
use super::points::Cloud;
use super::{FileMesh, MeshError, Rounding, TriangleMesh, polygon};

/// Reads a PLY file; `path` is for messages only.
pub(super) fn parse(bytes: &[u8], path: &Path) -> Result<FileMesh, MeshError> {
    let bytes = without_mark(bytes);
    let header = Header::parse(bytes, |line, what| MeshError::Parse {
        path: path.to_owned(),
        line: Some(line),
        what,
    })?;
    let mut body =
        Body { bytes, at: header.body_at, line: header.body_line, encoding: header.encoding, path };
    let mut vertices = Vec::new();
    let mut rounding = None;
    let mut faces = Faces::default();
    for element in &header.elements {
        body.check_room(element)?;
        match element.name.as_str() {
            "vertex" => {
                vertices = body.vertices(element)?;
                // Text as well: programs write the numbers that they have, and say so.
                let is_f32 = element.places(["x", "y", "z"]).is_some_and(|places| {
                    places.iter().any(|place| element.properties[*place].scalar == Scalar::F32)
                });
                rounding = is_f32.then(|| Rounding::of_f32_vertices(&vertices));
            }
            "face" | "tristrips" => body.lists(element, &mut faces)?,
            _ if element.properties.is_empty() => {}
            _ => (0..element.count).try_for_each(|number| body.skip(element, number))?,
        }
    }
    let mesh = faces.into_mesh(vertices, path, header.encoding)?;
    Ok(FileMesh { mesh, notes: Vec::new(), rounding })
}

/// Reads the vertices of a PLY file as points, with normals and colours where the file has them;
/// `None` when the file has faces.
pub(super) fn parse_cloud(bytes: &[u8], path: &Path) -> Result<Option<Cloud>, MeshError> {
    let bytes = without_mark(bytes);
    let header = Header::parse(bytes, |line, what| MeshError::Parse {
        path: path.to_owned(),
        line: Some(line),
        what,
    })?;
    if header
        .elements
        .iter()
        .any(|element| matches!(element.name.as_str(), "face" | "tristrips") && element.count > 0)
    {
        return Ok(None);
    }
    let mut body =
        Body { bytes, at: header.body_at, line: header.body_line, encoding: header.encoding, path };
    let mut cloud = Cloud::default();
    for element in &header.elements {
        body.check_room(element)?;
        match element.name.as_str() {
            "vertex" => cloud = body.cloud(element)?,
            _ if element.properties.is_empty() => {}
            _ => (0..element.count).try_for_each(|number| body.skip(element, number))?,
        }
    }
    Ok(Some(cloud))
}

/// Lists of vertices as the file has them: vertices may come behind the faces.
#[derive(Default)]
struct Faces {
    corners: Vec<i64>,
    lists: Vec<List>,
}

struct List {
    /// One past its last corner.
    end: usize,
    is_strip: bool,
    /// Line of text or byte in the file.
    place: usize,
}

impl Faces {
    fn into_mesh(
        self,
        vertices: Vec<DVec3>,
        path: &Path,
        encoding: Encoding,
    ) -> Result<TriangleMesh, MeshError> {
        let mut triangles = Vec::with_capacity(self.lists.len());
        let mut corners: Vec<u32> = Vec::new();
        let mut begin = 0;
        for List { end, is_strip, place } in self.lists {
            corners.clear();
            for index in &self.corners[begin..end] {
                match u32::try_from(*index) {
                    Ok(vertex) if (vertex as usize) < vertices.len() => corners.push(vertex),
                    Err(_) if is_strip && *index == -1 => {
                        strip(&corners, &mut triangles);
                        corners.clear();
                    }
                    _ => {
                        let what = format!(
                            "a face names vertex {index} (counted from 0), the file has {}",
                            vertices.len()
                        );
                        return Err(refusal(path, encoding, place, what));
                    }
                }
            }
            if is_strip {
                strip(&corners, &mut triangles);
            } else {
                polygon::triangulate(&vertices, &corners, &mut triangles);
            }
            begin = end;
        }
        Ok(TriangleMesh { vertices, triangles })
    }
}

/// Triangles of a strip, every second one turned round; those that only lead on to the next piece
/// have no area and are left out.
pub(super) fn strip(corners: &[u32], triangles: &mut Vec<[u32; 3]>) {
    for (k, corner) in corners.windows(3).enumerate() {
        let (a, b, c) = if k % 2 == 0 {
            (corner[0], corner[1], corner[2])
        } else {
            (corner[1], corner[0], corner[2])
        };
        if a != b && b != c && c != a {
            triangles.push([a, b, c]);
        }
    }
}

#[cold]
fn refusal(path: &Path, encoding: Encoding, place: usize, what: String) -> MeshError {
    let path = path.to_owned();
    match encoding {
        Encoding::Text => MeshError::Parse { path, line: Some(place), what },
        _ => MeshError::Binary { path, offset_bytes: place as u64, what },
    }
}

/// The numbers behind the header.
struct Body<'a> {
    bytes: &'a [u8],
    at: usize,
    /// Line of text at `at`.
    line: usize,
    encoding: Encoding,
    path: &'a Path,
}

impl Body<'_> {
    fn place(&self) -> usize {
        if self.encoding == Encoding::Text { self.line } else { self.at }
    }

    #[cold]
    fn refuse(&self, what: String) -> MeshError {
        refusal(self.path, self.encoding, self.place(), what)
    }

    #[cold]
    fn cut(&self, element: &Element, number: u64) -> MeshError {
        self.refuse(format!(
            "the file ends in `{}` {} of {}, so it was cut",
            element.name,
            number + 1,
            element.count
        ))
    }

    /// Refuses a number of elements for which the rest of the file has no room.
    fn check_room(&self, element: &Element) -> Result<(), MeshError> {
        let least = element.least_bytes(self.encoding) as u64;
        // The last number of a text needs no blank behind it.
        let room = (self.bytes.len() - self.at) as u64 + u64::from(self.encoding == Encoding::Text);
        if element.count.checked_mul(least).is_none_or(|needed| needed > room) {
            let what = format!(
                "the header announces {} of `{}`, the file has room for {}",
                element.count,
                element.name,
                room / least
            );
            return Err(self.refuse(what));
        }
        Ok(())
    }

    fn vertices(&mut self, element: &Element) -> Result<Vec<DVec3>, MeshError> {
        let places = self.columns(element)?;
        let mut vertices = Vec::with_capacity(element.count as usize);
        for number in 0..element.count {
            let [x, y, z] = self.row(element, number, places)?;
            vertices.push(DVec3::new(x, y, z));
        }
        Ok(vertices)
    }

    /// Where the coordinates of a vertex are among its properties.
    fn columns(&self, element: &Element) -> Result<[usize; 3], MeshError> {
        let Some(places) = element.places(["x", "y", "z"]) else {
            return Err(self.refuse("`vertex` needs the properties x, y and z".to_owned()));
        };
        if u32::try_from(element.count).is_err() {
            return Err(self.refuse(format!(
                "{} vertices, at most {} can be used",
                element.count,
                u32::MAX
            )));
        }
        Ok(places)
    }

    fn cloud(&mut self, element: &Element) -> Result<Cloud, MeshError> {
        let places = self.columns(element)?;
        let normal_at = element.places(["nx", "ny", "nz"]);
        let color_at = element.places(["red", "green", "blue"]);
        let color_of = color_at.map(|[red, ..]| element.properties[red].scalar);
        let normal_at_or = normal_at.unwrap_or(places);
        let color_at_or = color_at.unwrap_or(places);
        let [x, y, z] = places;
        let ([nx, ny, nz], [red, green, blue]) = (normal_at_or, color_at_or);
        let n = element.count as usize;
        let mut cloud = Cloud { positions: Vec::with_capacity(n), normals: None, colors: None };
        let mut normals = Vec::new();
        let mut colors = Vec::new();
        for number in 0..element.count {
            let row = self.row(element, number, [x, y, z, nx, ny, nz, red, green, blue])?;
            let [x, y, z, nx, ny, nz, red, green, blue] = row;
            cloud.positions.push(DVec3::new(x, y, z));
            if normal_at.is_some() {
                normals.push(DVec3::new(nx, ny, nz));
            }
            if let Some(scalar) = color_of {
                colors.push([red, green, blue].map(|value| scalar.color(value)));
            }
        }
        cloud.normals = normal_at.map(|_| normals);
        cloud.colors = color_of.map(|_| colors);
        Ok(cloud)
    }

    /// The numbers of the next element that are at these places among its properties; the first
    /// three are its coordinates.
    fn row<const N: usize>(
        &mut self,
        element: &Element,
        number: u64,
        places: [usize; N],
    ) -> Result<[f64; N], MeshError> {
        let mut row = [0.0; N];
        let line = (self.encoding == Encoding::Text).then(|| self.next_line());
        for (place, property) in element.properties.iter().enumerate() {
            if let Some(count) = property.count {
                self.skip_list(count, property.scalar, element, number)?;
                continue;
            }
            let value = self.number(property.scalar, element, number)?;
            for (wanted, kept) in places.iter().zip(&mut row) {
                if *wanted == place {
                    *kept = value;
                }
            }
        }
        if row[..3].iter().any(|coordinate| !coordinate.is_finite()) {
            return Err(MeshError::NonFiniteVertex {
                path: self.path.to_owned(),
                vertex: number as usize + 1,
                line,
            });
        }
        Ok(row)
    }

    fn lists(&mut self, element: &Element, faces: &mut Faces) -> Result<(), MeshError> {
        let names = ["vertex_indices", "vertex_index"];
        let ours = element.properties.iter().position(|property| {
            names.contains(&property.name.as_str())
                && property.count.is_some()
                && property.scalar.is_integer()
        });
        let Some(ours) = ours else {
            if element.count == 0 {
                return Ok(());
            }
            return Err(self.refuse(format!(
                "`{}` needs a list of integers named vertex_indices",
                element.name
            )));
        };
        let is_strip = element.name == "tristrips";
        for number in 0..element.count {
            let place = if self.encoding == Encoding::Text { self.next_line() } else { self.at };
            for (k, property) in element.properties.iter().enumerate() {
                match property.count {
                    None => _ = self.number(property.scalar, element, number)?,
                    Some(count) if k != ours => {
                        self.skip_list(count, property.scalar, element, number)?
                    }
                    Some(count) => {
                        for _ in 0..self.list_length(count, property.scalar, element, number)? {
                            faces
                                .corners
                                .push(self.number(property.scalar, element, number)? as i64);
                        }
                    }
                }
            }
            let begin = faces.lists.last().map_or(0, |list| list.end);
            // Fewer make no triangle.
            if faces.corners.len() - begin < 3 {
                faces.corners.truncate(begin);
            } else {
                faces.lists.push(List { end: faces.corners.len(), is_strip, place });
            }
        }
        Ok(())
    }

    fn skip(&mut self, element: &Element, number: u64) -> Result<(), MeshError> {
        for property in &element.properties {
            match property.count {
                None => _ = self.number(property.scalar, element, number)?,
                Some(count) => self.skip_list(count, property.scalar, element, number)?,
            }
        }
        Ok(())
    }

    fn skip_list(
        &mut self,
        count: Scalar,
        scalar: Scalar,
        element: &Element,
        number: u64,
    ) -> Result<(), MeshError> {
        for _ in 0..self.list_length(count, scalar, element, number)? {
            self.number(scalar, element, number)?;
        }
        Ok(())
    }

    /// How many numbers follow; never more than the file has room for.
    fn list_length(
        &mut self,
        count: Scalar,
        scalar: Scalar,
        element: &Element,
        number: u64,
    ) -> Result<usize, MeshError> {
        let length = self.number(count, element, number)?;
        let size = if self.encoding == Encoding::Text { 2 } else { scalar.size_bytes() };
        let room = (self.bytes.len() - self.at + 1) / size;
        if !(0.0..=room as f64).contains(&length) {
            return Err(
                self.refuse(format!("a list of {length} numbers, the file has room for {room}"))
            );
        }
        Ok(length as usize)
    }

    /// The next number. Every integer type of the format fits into the 53 bits of `f64`.
    #[inline]
    fn number(&mut self, scalar: Scalar, element: &Element, number: u64) -> Result<f64, MeshError> {
        if self.encoding == Encoding::Text {
            return self.word(scalar, element, number);
        }
        let big = self.encoding == Encoding::BigEndian;
        let rest = &self.bytes[self.at..];
        let value = match scalar {
            Scalar::I8 => rest.first().map(|byte| f64::from(byte.cast_signed())),
            Scalar::U8 => rest.first().map(|byte| f64::from(*byte)),
            Scalar::I16 => rest.first_chunk().map(|b| {
                f64::from(if big { i16::from_be_bytes(*b) } else { i16::from_le_bytes(*b) })
            }),
            Scalar::U16 => rest.first_chunk().map(|b| {
                f64::from(if big { u16::from_be_bytes(*b) } else { u16::from_le_bytes(*b) })
            }),
            Scalar::I32 => rest.first_chunk().map(|b| {
                f64::from(if big { i32::from_be_bytes(*b) } else { i32::from_le_bytes(*b) })
            }),
            Scalar::U32 => rest.first_chunk().map(|b| {
                f64::from(if big { u32::from_be_bytes(*b) } else { u32::from_le_bytes(*b) })
            }),
            Scalar::F32 => rest.first_chunk().map(|b| {
                f64::from(if big { f32::from_be_bytes(*b) } else { f32::from_le_bytes(*b) })
            }),
            Scalar::F64 => rest
                .first_chunk()
                .map(|b| if big { f64::from_be_bytes(*b) } else { f64::from_le_bytes(*b) }),
        };
        match value {
            Some(value) => {
                self.at += scalar.size_bytes();
                Ok(value)
            }
            None => Err(self.cut(element, number)),
        }
    }

    /// Line of the next word.
    fn next_line(&mut self) -> usize {
        while let Some(byte) = self.bytes.get(self.at).filter(|byte| byte.is_ascii_whitespace()) {
            let is_end =
                *byte == b'\n' || (*byte == b'\r' && self.bytes.get(self.at + 1) != Some(&b'\n'));
            self.line += usize::from(is_end);
            self.at += 1;
        }
        self.line
    }

    fn word(&mut self, scalar: Scalar, element: &Element, number: u64) -> Result<f64, MeshError> {
        self.next_line();
        let rest = &self.bytes[self.at..];
        let length = rest.iter().position(u8::is_ascii_whitespace).unwrap_or(rest.len());
        if length == 0 {
            return Err(self.cut(element, number));
        }
        let word = std::str::from_utf8(&rest[..length]).ok();
        let value = word
            .and_then(|word| word.parse::<f64>().ok())
            .filter(|value| !scalar.is_integer() || value.fract() == 0.0);
        let Some(value) = value else {
            let shown: String = String::from_utf8_lossy(&rest[..length.min(60)]).into_owned();
            let kind = if scalar.is_integer() { "an integer" } else { "a number" };
            return Err(self.refuse(format!(
                "`{}` {} needs {kind}, found `{shown}`",
                element.name,
                number + 1
            )));
        };
        self.at += length;
        Ok(value)
    }
}

#[cfg(test)]
mod tests;
