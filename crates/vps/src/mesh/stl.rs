//! STL, binary and text.
//!
//! Data in: bytes. Data out: triangles over shared vertices: corners at bitwise equal positions are
//! joined (0 and -0 are equal). The normals and attributes of the file are not read.
//!
//! Which of the two a file is, is decided by its size first: many binary files begin with the word
//! "solid". A number of triangles that was never filled in is taken from the size, and said. Text
//! may have any line ends, or all in one line. Cost: linear, binary files in parallel; text is read
//! by one thread.

use std::path::Path;

use super::format::without_mark;
use super::weld::weld_exact;
use super::{FileMesh, MeshError, Rounding, TriangleMesh};

/// Free text and number of triangles.
const HEADER_BYTES: usize = 84;
/// Normal, three corners, attribute.
const TRIANGLE_BYTES: usize = 50;

/// Reads an STL file; `path` is for messages only.
pub(super) fn parse(bytes: &[u8], path: &Path) -> Result<FileMesh, MeshError> {
    let mut announced = announced_triangles(bytes);
    let mut notes = Vec::new();
    let expected_bytes = announced.map(size_of_triangles);
    let found_bytes = bytes.len() as u64;
    if expected_bytes != Some(found_bytes) && looks_like_text(bytes) {
        return parse_text(bytes, path).map(FileMesh::from);
    }
    // Programs that write while they compute leave the number as it was at the beginning.
    if let Some(number @ (0 | u32::MAX)) = announced
        && let Some(n_triangles) = whole_triangles(found_bytes)
    {
        notes.push(format!(
            "the number of triangles in the header is {number}, and was not filled in: all {n_triangles} \
                that the file has room for were read"
        ));
        announced = Some(n_triangles);
    }
    let expected_bytes = announced.map(size_of_triangles);
    let expected_bytes = expected_bytes.unwrap_or(HEADER_BYTES as u64);
    let triangles = u64::from(announced.unwrap_or(0));
    if found_bytes < expected_bytes {
        return Err(MeshError::Truncated {
            path: path.to_owned(),
            triangles,
            expected_bytes,
            found_bytes,
        });
    }
    // A few bytes of padding are usual; room for more triangles means that the number is wrong.
    if found_bytes - expected_bytes >= TRIANGLE_BYTES as u64 {
        let room = (found_bytes - HEADER_BYTES as u64) / TRIANGLE_BYTES as u64;
        let what =
            format!("the header announces {triangles} triangles, the file has room for {room}");
        return Err(MeshError::Parse { path: path.to_owned(), line: None, what });
    }
    let mesh = parse_binary(&bytes[HEADER_BYTES..expected_bytes as usize], path)?;
    let rounding = Some(Rounding::of_f32_vertices(&mesh.vertices));
    Ok(FileMesh { mesh, notes, rounding })
}

fn announced_triangles(bytes: &[u8]) -> Option<u32> {
    bytes.get(HEADER_BYTES - 4..)?.first_chunk().copied().map(u32::from_le_bytes)
}

fn size_of_triangles(n_triangles: u32) -> u64 {
    HEADER_BYTES as u64 + TRIANGLE_BYTES as u64 * u64::from(n_triangles)
}

/// The triangles of a file that has nothing else behind its header; `None` for none, and where bytes
/// are left over.
fn whole_triangles(file_bytes: u64) -> Option<u32> {
    let n_bytes = file_bytes.checked_sub(HEADER_BYTES as u64)?;
    let n_triangles = u32::try_from(n_bytes / TRIANGLE_BYTES as u64).ok()?;
    (n_triangles > 0 && n_bytes.is_multiple_of(TRIANGLE_BYTES as u64)).then_some(n_triangles)
}

/// Begins with "solid", and what follows within the first kilobyte is text that goes on like one.
fn looks_like_text(bytes: &[u8]) -> bool {
    let head = without_mark(bytes).trim_ascii_start();
    let head = &head[..head.len().min(1024)];
    let has =
        |word: &[u8]| head.windows(word.len()).any(|window| window.eq_ignore_ascii_case(word));
    let begins = head.len() >= 5 && head[..5].eq_ignore_ascii_case(b"solid");
    begins
        && !head.contains(&0)
        && (has(b"facet") || has(b"endsolid") || bytes.len() < HEADER_BYTES)
}

fn parse_binary(triangles: &[u8], path: &Path) -> Result<TriangleMesh, MeshError> {
    let (records, _) = triangles.as_chunks::<TRIANGLE_BYTES>();
    let corners_of = |triangle_idx: usize| {
        let record = &records[triangle_idx];
        // Adding zero turns -0 into 0 and leaves every other number as it is.
        let number = |at: usize| {
            (f32::from_le_bytes([record[at], record[at + 1], record[at + 2], record[at + 3]]) + 0.0)
                .to_bits()
        };
        [12, 24, 36].map(|at| [number(at), number(at + 4), number(at + 8)])
    };
    let mesh =
        weld_exact(records.len(), corners_of).ok_or_else(|| too_many(records.len(), path))?;
    // Vertices are numbered by first use: the first that is not finite belongs to the first such
    // corner.
    if let Some(wrong) = mesh.vertices.iter().position(|vertex| !vertex.is_finite()) {
        let corner = mesh
            .triangles
            .as_flattened()
            .iter()
            .position(|vertex| *vertex as usize == wrong)
            .unwrap_or_default();
        return Err(MeshError::NonFiniteVertex {
            path: path.to_owned(),
            vertex: corner + 1,
            line: None,
        });
    }
    Ok(mesh)
}

#[cold]
fn too_many(n_triangles: usize, path: &Path) -> MeshError {
    let what = format!("{n_triangles} triangles, at most {} can be used", u32::MAX / 3);
    MeshError::Parse { path: path.to_owned(), line: None, what }
}

fn parse_text(bytes: &[u8], path: &Path) -> Result<TriangleMesh, MeshError> {
    let refuse = |line: usize, what: String| MeshError::Parse {
        path: path.to_owned(),
        line: Some(line),
        what,
    };
    let mut triangles: Vec<[[u64; 3]; 3]> = Vec::new();
    let mut corners = [[0; 3]; 3];
    let mut n_corners = 0;
    let mut in_facet = false;
    let mut ended = false;
    let mut last_line = 0;
    for (line_number, statement) in lines(without_mark(bytes))
        .zip(1..)
        .flat_map(|(line, line_number)| statements(line).map(move |words| (line_number, words)))
    {
        let mut words = words_of(statement);
        let Some(keyword) = words.next() else { continue };
        last_line = line_number;
        let is = |known: &str| is(keyword, known);
        if is("vertex") {
            let mut number = || std::str::from_utf8(words.next()?).ok()?.parse::<f64>().ok();
            let (Some(x), Some(y), Some(z)) = (number(), number(), number()) else {
                return Err(refuse(
                    line_number,
                    format!("a vertex needs three numbers, found `{}`", shown(statement)),
                ));
            };
            if !in_facet || n_corners == 3 {
                return Err(refuse(
                    line_number,
                    "a facet has three vertices, found a further one".to_owned(),
                ));
            }
            corners[n_corners] = [x, y, z].map(|number| (number + 0.0).to_bits());
            n_corners += 1;
        } else if is("facet") {
            if in_facet {
                return Err(refuse(
                    line_number,
                    "a facet begins before the last one has ended".to_owned(),
                ));
            }
            (in_facet, n_corners) = (true, 0);
        } else if is("endfacet") {
            if !in_facet || n_corners != 3 {
                return Err(refuse(
                    line_number,
                    format!("a facet has three vertices, found {n_corners}"),
                ));
            }
            let is_finite =
                |corner: &[u64; 3]| corner.iter().all(|bits| f64::from_bits(*bits).is_finite());
            if let Some(k) = corners.iter().position(|corner| !is_finite(corner)) {
                let vertex = 3 * triangles.len() + k + 1;
                return Err(MeshError::NonFiniteVertex {
                    path: path.to_owned(),
                    vertex,
                    line: Some(line_number),
                });
            }
            triangles.push(corners);
            (in_facet, n_corners) = (false, 0);
        } else if is("solid") {
            ended = false;
        } else if is("endsolid") {
            ended = true;
        } else if !(is("outer") || is("endloop")) {
            return Err(refuse(line_number, format!("unknown keyword in `{}`", shown(statement))));
        }
    }
    // A file cut between two facets would be a part with a hole in it.
    if in_facet || !ended {
        return Err(refuse(
            last_line,
            "the text ends without `endsolid`, so the file was cut".to_owned(),
        ));
    }
    weld_exact(triangles.len(), |triangle_idx| triangles[triangle_idx])
        .ok_or_else(|| too_many(triangles.len(), path))
}

/// Lines that end in LF, CR LF or CR.
fn lines(text: &[u8]) -> impl Iterator<Item = &[u8]> {
    let mut rest = Some(text);
    std::iter::from_fn(move || {
        let text = rest?;
        let Some(end) = text.iter().position(|byte| matches!(byte, b'\n' | b'\r')) else {
            rest = None;
            return Some(text);
        };
        let end_bytes = if text[end..].starts_with(b"\r\n") { 2 } else { 1 };
        rest = Some(&text[end + end_bytes..]);
        Some(&text[..end])
    })
}

fn words_of(text: &[u8]) -> impl Iterator<Item = &[u8]> {
    text.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty())
}

/// Keywords that begin a statement anywhere in a line.
const STATEMENTS: [&str; 7] =
    ["vertex", "outer", "endloop", "endfacet", "facet", "endsolid", "solid"];

/// The statements of a line: all of a file may stand in one.
fn statements(line: &[u8]) -> impl Iterator<Item = &[u8]> {
    let mut rest = line.trim_ascii();
    std::iter::from_fn(move || {
        let keyword = words_of(rest).next()?;
        let has_name = is(keyword, "solid") || is(keyword, "endsolid");
        let mut end = keyword.len();
        loop {
            let more = rest[end..].trim_ascii_start();
            let Some(word) = words_of(more).next() else {
                return Some(std::mem::take(&mut rest));
            };
            let begin = rest.len() - more.len();
            let begins = if has_name {
                ends_name(keyword, more)
            } else {
                STATEMENTS.iter().any(|known| is(word, known))
            };
            if begins {
                let statement = &rest[..begin];
                rest = more;
                return Some(statement);
            }
            end = begin + word.len();
        }
    })
}

/// The name behind `solid` or `endsolid`, which may be any words, ends where `more` begins: before
/// the first facet or the end of the solid, or before a solid that has a facet.
fn ends_name(keyword: &[u8], more: &[u8]) -> bool {
    /// Of a name; what follows is looked at once for each word.
    const MOST_WORDS: usize = 32;
    let has_facet = |n_words: usize| {
        let mut words = words_of(more).take(n_words).peekable();
        std::iter::from_fn(|| Some((words.next()?, words.peek().copied().unwrap_or_default())))
            .any(|(word, next)| is(word, "facet") && is(next, "normal"))
    };
    let first = words_of(more).next().unwrap_or_default();
    if is(keyword, "solid") {
        has_facet(2) || is(first, "endsolid")
    } else {
        is(first, "solid") && has_facet(MOST_WORDS)
    }
}

fn is(word: &[u8], known: &str) -> bool {
    word.eq_ignore_ascii_case(known.as_bytes())
}

/// The beginning of a line, for messages.
fn shown(line: &[u8]) -> String {
    String::from_utf8_lossy(line).trim().chars().take(60).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const TETRAHEDRON: [[[f32; 3]; 3]; 4] = [
        [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]],
        [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
        [[0.0, -0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]],
        [[1.0, 0.0, -0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
    ];

    fn binary(header: &str, triangles: &[[[f32; 3]; 3]]) -> Vec<u8> {
        let mut bytes = header.as_bytes().to_vec();
        bytes.resize(80, b' ');
        bytes.extend((triangles.len() as u32).to_le_bytes());
        for corners in triangles {
            bytes.extend([0; 12]);
            bytes.extend(corners.iter().flatten().flat_map(|number| number.to_le_bytes()));
            bytes.extend([0; 2]);
        }
        bytes
    }

    fn text(triangles: &[[[f32; 3]; 3]]) -> String {
        let mut text = "solid part facet\n".to_owned();
        for corners in triangles {
            text += " facet normal 0 0 0\n  outer loop\n";
            for [x, y, z] in corners {
                text += &format!("   vertex {x:e} {y} {z}\r\n");
            }
            text += "  endloop\n endfacet\n";
        }
        text + "endsolid part\n"
    }

    fn read(bytes: &[u8]) -> Result<TriangleMesh, MeshError> {
        parse(bytes, Path::new("part.stl")).map(|file| file.mesh)
    }

    #[test]
    fn binary_and_text_give_the_same_welded_mesh() {
        let binary = read(&binary("solid but binary", &TETRAHEDRON)).unwrap();
        let text = read(text(&TETRAHEDRON).as_bytes()).unwrap();
        assert_eq!(binary.vertices.len(), 4);
        assert_eq!(binary.vertices, text.vertices);
        assert_eq!(binary.triangles, text.triangles);
        let upper = read(self::text(&TETRAHEDRON).to_uppercase().as_bytes()).unwrap();
        assert_eq!(upper.triangles, text.triangles);
    }

    #[test]
    fn any_line_ends_a_byte_order_mark_and_all_in_one_line_give_the_same_mesh() {
        // The name of the solid has every keyword but the pair that begins a facet.
        let text = text(&TETRAHEDRON)
            .replace("solid part facet", "solid a solid facet vertex")
            .replace("endsolid part", "endsolid a solid vertex");
        let expected = read(text.as_bytes()).unwrap();
        assert_eq!(expected.triangles.len(), 4);
        let lf = text.replace("\r\n", "\n");
        let one_line = lf.replace('\n', " ");
        for variant in [
            lf.replace('\n', "\r\n"),
            lf.replace('\n', "\r"),
            format!("\u{feff}{lf}"),
            format!("\u{feff}{one_line}"),
            one_line.to_uppercase(),
            one_line.clone(),
        ] {
            let mesh = read(variant.as_bytes()).unwrap();
            assert_eq!(mesh.triangles, expected.triangles, "{variant}");
            assert_eq!(mesh.vertices, expected.vertices, "{variant}");
        }
        // Several solids, in one line and in lines that end in CR.
        let twice = format!("{one_line}{one_line}");
        assert_eq!(read(twice.as_bytes()).unwrap().triangles.len(), 8);
        let with_empty = format!("solid nothing endsolid nothing\r{one_line}");
        assert_eq!(read(with_empty.as_bytes()).unwrap().triangles.len(), 4);
        // A line is what an editor counts.
        let cr = lf.replace('\n', "\r").replacen("vertex 1e0", "vertex one", 1);
        let error = read(cr.as_bytes()).unwrap_err().to_string();
        assert!(error.starts_with("part.stl:6: a vertex needs three numbers"), "{error}");
    }

    #[test]
    fn a_name_of_many_keywords_takes_no_long_time() {
        let text = format!("solid a\nendsolid {}", "solid ".repeat(200_000));
        assert!(read(text.as_bytes()).unwrap().triangles.is_empty());
    }

    #[test]
    fn a_number_of_triangles_that_was_not_filled_in_is_taken_from_the_size_and_said() {
        for number in [0_u32, u32::MAX] {
            let mut bytes = binary("part", &TETRAHEDRON);
            bytes[80..84].copy_from_slice(&number.to_le_bytes());
            let file = parse(&bytes, Path::new("part.stl")).unwrap();
            assert_eq!(file.mesh.triangles.len(), 4);
            assert_eq!(
                file.notes,
                [format!(
                    "the number of triangles in the header is {number}, and was not filled in: all \
                        4 that the file has room for were read"
                )]
            );
            bytes.push(0);
            assert!(read(&bytes).is_err(), "no whole number of triangles");
        }
        assert!(read(&binary("part", &[])).unwrap().triangles.is_empty(), "0 may be the truth");
    }

    #[test]
    fn truncated_binary_names_both_sizes() {
        let bytes = binary("solid part", &TETRAHEDRON);
        let error = read(&bytes[..200]).unwrap_err();
        assert_eq!(
            error.to_string(),
            "part.stl: truncated, 284 bytes expected for 4 triangles, 200 found"
        );
        let error = read(&bytes[..40]).unwrap_err();
        assert!(error.to_string().contains("cut"), "{error}");
        assert!(matches!(
            read(b"\x01\x02"),
            Err(MeshError::Truncated { expected_bytes: 84, found_bytes: 2, .. })
        ));
        assert!(matches!(read(b""), Err(MeshError::Truncated { .. })));
    }

    #[test]
    fn padding_is_accepted_and_a_wrong_count_is_not() {
        let mut bytes = binary("part", &TETRAHEDRON);
        bytes.extend([0; 49]);
        assert_eq!(read(&bytes).unwrap().triangles.len(), 4);
        bytes.push(0);
        let message = read(&bytes).unwrap_err().to_string();
        assert_eq!(message, "part.stl: the header announces 4 triangles, the file has room for 5");
    }

    #[test]
    fn text_errors_name_the_line() {
        let message = |text: &str| read(text.as_bytes()).unwrap_err().to_string();
        let good = text(&TETRAHEDRON);
        assert_eq!(
            message(&good.replace("endsolid part\n", "")),
            "part.stl:29: the text ends without `endsolid`, so the file was cut"
        );
        assert_eq!(
            message("solid a\nfacet normal 0 0 1\nouter loop\nvertex 1 2\n"),
            "part.stl:4: a vertex needs three numbers, found `vertex 1 2`"
        );
        assert_eq!(
            message("solid a\nfacet\nvertex 0 0 0\nendfacet\n"),
            "part.stl:4: a facet has three vertices, found 1"
        );
        assert_eq!(
            message("solid a\nfacet\nfacet\n"),
            "part.stl:3: a facet begins before the last one has ended"
        );
        assert_eq!(message("solid a\nfacets\n"), "part.stl:2: unknown keyword in `facets`");
        assert_eq!(
            message("solid a\nvertex 0 0 0\n"),
            "part.stl:2: a facet has three vertices, found a further one"
        );
    }

    #[test]
    fn non_finite_corners_are_named() {
        let mut triangles = TETRAHEDRON;
        triangles[2][1][0] = f32::NAN;
        let error = read(&binary("part", &triangles)).unwrap_err();
        assert_eq!(error.to_string(), "part.stl: vertex 8 is not finite");
        assert!(matches!(
            read(text(&triangles).as_bytes()),
            Err(MeshError::NonFiniteVertex { vertex: 8, line: Some(22), .. })
        ));
    }
}
