//! Files that are no mesh whatever their name says, known by how they begin.

use super::format::without_mark;
use crate::setting_names::SettingNames;

/// A file in the place of a mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Foreign {
    /// What git checks out of a large file that was not fetched.
    GitLfsPointer,
    /// Compressed by gzip.
    Gzip,
    /// Compressed by another program than gzip.
    Compressed,
    /// A zip archive without a model of 3MF.
    Zip,
    /// A page, mostly one that says why there is no file.
    Html,
    /// Text of two bytes for each character.
    Utf16,
    /// A document.
    Pdf,
    /// Curved surfaces.
    Step,
}

impl Foreign {
    /// What a file is that no reader could read; `None` where it may be a damaged mesh.
    pub(super) fn recognise(bytes: &[u8]) -> Option<Self> {
        const COMPRESSED: [&[u8]; 5] =
            [b"\xfd7zXZ\0", b"7z\xbc\xaf\x27\x1c", b"Rar!\x1a\x07", b"\x28\xb5\x2f\xfd", b"BZh"];
        const HTML: [&[u8]; 4] = [b"<!doctype html", b"<html", b"<head", b"<body"];
        let text = without_mark(bytes).trim_ascii_start();
        let begins = |words: &[u8]| {
            text.get(..words.len()).is_some_and(|begin| begin.eq_ignore_ascii_case(words))
        };
        Some(if text.starts_with(b"version https://git-lfs.github.com/") {
            Self::GitLfsPointer
        } else if bytes.starts_with(b"\x1f\x8b") {
            Self::Gzip
        } else if COMPRESSED.iter().any(|begin| bytes.starts_with(begin)) {
            Self::Compressed
        } else if is_zip(bytes) {
            Self::Zip
        } else if HTML.iter().any(|begin| begins(begin)) {
            Self::Html
        } else if bytes.starts_with(b"\xff\xfe") || bytes.starts_with(b"\xfe\xff") {
            Self::Utf16
        } else if bytes.starts_with(b"%PDF-") {
            Self::Pdf
        } else if begins(b"ISO-10303-21") {
            Self::Step
        } else {
            return None;
        })
    }

    /// What it is, in words that follow "this is".
    pub(super) fn what(self) -> &'static str {
        match self {
            Self::GitLfsPointer => "a git-lfs pointer, not the file",
            Self::Gzip => "a gzip file",
            Self::Compressed => "a compressed file",
            Self::Zip => "a zip archive without a 3MF model",
            Self::Html => "an HTML page",
            Self::Utf16 => "text in UTF-16",
            Self::Pdf => "a PDF document",
            Self::Step => "a STEP file, which holds curved surfaces",
        }
    }

    pub(super) fn hint(self, names: &SettingNames) -> String {
        let hint = match self {
            Self::GitLfsPointer => "run `git lfs pull`",
            Self::Gzip => "unpack it with `gunzip`, and name the file that comes out",
            Self::Compressed | Self::Zip => "unpack it, and name the mesh that was in it",
            Self::Html => {
                "open it in a browser: it may say why there is no mesh; then download the file \
                    itself"
            }
            Self::Utf16 => "save it as UTF-8 or ASCII",
            Self::Pdf => "name the file of the mesh itself",
            Self::Step => return super::cad_hint(names),
        };
        hint.to_owned()
    }
}

/// A whole zip archive, which ends in a list of what it has; a cut one may have been 3MF.
fn is_zip(bytes: &[u8]) -> bool {
    /// The record at the end, with the longest comment.
    const MOST_AT_END: usize = 22 + u16::MAX as usize;
    let end = &bytes[bytes.len().saturating_sub(MOST_AT_END)..];
    [b"PK\x03\x04", b"PK\x05\x06"].iter().any(|begin| bytes.starts_with(*begin))
        && end.windows(4).any(|window| window == b"PK\x05\x06")
}
