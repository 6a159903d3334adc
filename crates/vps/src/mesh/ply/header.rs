//! The header of a PLY file: which elements follow, with which properties, in which encoding.

use super::super::MeshError;

/// How numbers are written behind the header.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Encoding {
    Text,
    LittleEndian,
    BigEndian,
}

/// Type of a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Scalar {
    /// Both families of names are in use.
    fn of(word: &str) -> Option<Self> {
        Some(match word {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }

    pub(super) fn size_bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// A part of a colour, 0 to 255: integers have their whole range for it, others 0 to 1.
    pub(super) fn color(self, value: f64) -> u8 {
        let full = match self {
            Self::I8 => f64::from(i8::MAX),
            Self::U8 => f64::from(u8::MAX),
            Self::I16 => f64::from(i16::MAX),
            Self::U16 => f64::from(u16::MAX),
            Self::I32 => f64::from(i32::MAX),
            Self::U32 => f64::from(u32::MAX),
            Self::F32 | Self::F64 => 1.0,
        };
        (value / full * 255.0).round() as u8
    }

    pub(super) fn is_integer(self) -> bool {
        !matches!(self, Self::F32 | Self::F64)
    }
}

#[derive(Clone, Debug)]
pub(super) struct Property {
    pub(super) name: String,
    pub(super) scalar: Scalar,
    /// Type of the number that says how many follow; `None` for a single number.
    pub(super) count: Option<Scalar>,
}

#[derive(Clone, Debug)]
pub(super) struct Element {
    pub(super) name: String,
    pub(super) count: u64,
    pub(super) properties: Vec<Property>,
}

impl Element {
    /// Where single numbers of these names are among the properties.
    pub(super) fn places(&self, names: [&str; 3]) -> Option<[usize; 3]> {
        let place = |name: &str| {
            self.properties
                .iter()
                .position(|property| property.name == name && property.count.is_none())
        };
        Some([place(names[0])?, place(names[1])?, place(names[2])?])
    }

    /// Fewest bytes that one of them takes: every list may be empty, every number of text needs a
    /// digit and a blank.
    pub(super) fn least_bytes(&self, encoding: Encoding) -> usize {
        let least = |property: &Property| match encoding {
            Encoding::Text => 2,
            _ => property.count.unwrap_or(property.scalar).size_bytes(),
        };
        self.properties.iter().map(least).sum()
    }
}

#[derive(Clone, Debug)]
pub(super) struct Header {
    pub(super) encoding: Encoding,
    /// In the order of the file.
    pub(super) elements: Vec<Element>,
    /// Where the numbers begin.
    pub(super) body_at: usize,
    /// Line of text on which they begin, from 1.
    pub(super) body_line: usize,
}

impl Header {
    /// Reads the header; `refuse` makes the error for a line.
    pub(super) fn parse(
        bytes: &[u8],
        refuse: impl Fn(usize, String) -> MeshError,
    ) -> Result<Self, MeshError> {
        let mut lines = Lines::new(bytes);
        if lines.next().is_none_or(|(_, line)| line.trim() != "ply") {
            return Err(refuse(1, "a PLY file begins with the line `ply`".to_owned()));
        }
        let mut encoding = None;
        let mut elements: Vec<Element> = Vec::new();
        while let Some((number, line)) = lines.next() {
            let words: Vec<&str> = line.split_whitespace().collect();
            let wrong = || {
                refuse(
                    number,
                    format!(
                        "wrong header line `{}`",
                        line.trim().chars().take(60).collect::<String>()
                    ),
                )
            };
            match words[..] {
                ["format", kind, version] => {
                    if version != "1.0" {
                        return Err(refuse(
                            number,
                            format!("version 1.0 of the format is read, found `{version}`"),
                        ));
                    }
                    encoding = Some(match kind {
                        "ascii" => Encoding::Text,
                        "binary_little_endian" => Encoding::LittleEndian,
                        "binary_big_endian" => Encoding::BigEndian,
                        _ => return Err(wrong()),
                    });
                }
                ["element", name, count] => {
                    let count = count.parse().map_err(|_| wrong())?;
                    if elements.iter().any(|element| element.name == name) {
                        return Err(refuse(number, format!("element `{name}` is announced twice")));
                    }
                    elements.push(Element { name: name.to_owned(), count, properties: Vec::new() });
                }
                ["property", "list", count, scalar, name] => {
                    let element = elements.last_mut().ok_or_else(wrong)?;
                    let count =
                        Scalar::of(count).filter(|count| count.is_integer()).ok_or_else(wrong)?;
                    let scalar = Scalar::of(scalar).ok_or_else(wrong)?;
                    element.properties.push(Property {
                        name: name.to_owned(),
                        scalar,
                        count: Some(count),
                    });
                }
                ["property", scalar, name] => {
                    let element = elements.last_mut().ok_or_else(wrong)?;
                    let scalar = Scalar::of(scalar).ok_or_else(wrong)?;
                    element.properties.push(Property {
                        name: name.to_owned(),
                        scalar,
                        count: None,
                    });
                }
                ["end_header"] => {
                    let encoding = encoding.ok_or_else(|| {
                        refuse(number, "the header has no line `format`".to_owned())
                    })?;
                    return Ok(Self {
                        encoding,
                        elements,
                        body_at: lines.at,
                        body_line: number + 1,
                    });
                }
                [] | ["comment" | "obj_info", ..] => {}
                _ => return Err(wrong()),
            }
        }
        Err(refuse(
            lines.number,
            "the header ends without `end_header`, so the file was cut".to_owned(),
        ))
    }
}

/// Lines of the header. The first line shows how lines end: numbers follow at once, and they may
/// look like an end of line.
struct Lines<'a> {
    bytes: &'a [u8],
    at: usize,
    number: usize,
    end: &'static [u8],
}

impl<'a> Lines<'a> {
    /// A longer line is not one of a header.
    const MAX_BYTES: usize = 4096;

    fn new(bytes: &'a [u8]) -> Self {
        let first = bytes.iter().position(|byte| matches!(byte, b'\r' | b'\n'));
        let end: &[u8] = match first.map(|at| &bytes[at..]) {
            Some([b'\r', b'\n', ..]) => b"\r\n",
            Some([b'\r', ..]) => b"\r",
            _ => b"\n",
        };
        Self { bytes, at: 0, number: 0, end }
    }

    fn next(&mut self) -> Option<(usize, String)> {
        let rest = &self.bytes[self.at..];
        let window = &rest[..rest.len().min(Self::MAX_BYTES)];
        let length = window.windows(self.end.len()).position(|bytes| bytes == self.end)?;
        self.at += length + self.end.len();
        self.number += 1;
        Some((self.number, String::from_utf8_lossy(&rest[..length]).into_owned()))
    }
}
