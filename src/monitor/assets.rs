//! The page, embedded in the program: one line for each file of `web/`.

/// Name below `/web/`, content type, bytes.
pub(super) const FILES: &[(&str, &str, &[u8])] = &[("index.html", HTML, include_bytes!("web/index.html"))];

const HTML: &str = "text/html; charset=utf-8";

/// Content type and bytes of a file.
pub(super) fn find(name: &str) -> Option<(&'static str, &'static [u8])> {
    FILES.iter().find(|(known, ..)| *known == name).map(|(_, kind, bytes)| (*kind, *bytes))
}
