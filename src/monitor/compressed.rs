//! What is sent often and never changes: compressed once, for clients that accept it.

use std::io::Write as _;

use axum::body::Bytes;
use axum::http::{HeaderMap, HeaderValue, header};
use axum::response::{IntoResponse, Response};
use flate2::Compression;
use flate2::write::GzEncoder;

/// Bytes, and the same as gzip where that is shorter.
#[derive(Clone, Debug, Default)]
pub(super) struct Compressed {
    pub(super) plain: Bytes,
    gzip: Option<Bytes>,
}

impl Compressed {
    /// Compresses them, which takes about a second for 50 MB.
    pub(super) fn new(plain: Bytes) -> Self {
        let gzip = gzip(&plain).filter(|gzip| gzip.len() < plain.len()).map(Bytes::from);
        Self { plain, gzip }
    }

    /// The answer to a request with these headers.
    pub(super) fn response(&self, asked: &HeaderMap, kind: &'static str) -> Response {
        let gzip = self.gzip.clone().filter(|_| accepts_gzip(asked));
        let is_gzip = gzip.is_some();
        let mut response =
            ([(header::CONTENT_TYPE, kind)], gzip.unwrap_or_else(|| self.plain.clone()))
                .into_response();
        let headers = response.headers_mut();
        headers.insert(header::VARY, HeaderValue::from_static("accept-encoding"));
        if is_gzip {
            headers.insert(header::CONTENT_ENCODING, HeaderValue::from_static("gzip"));
        }
        response
    }
}

fn gzip(plain: &[u8]) -> Option<Vec<u8>> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(plain).ok()?;
    encoder.finish().ok()
}

/// RFC 9110, 12.5.3: a coding with the weight 0 is not acceptable.
fn accepts_gzip(headers: &HeaderMap) -> bool {
    let lists =
        headers.get_all(header::ACCEPT_ENCODING).iter().filter_map(|value| value.to_str().ok());
    let weight = |parameters: &str| {
        let weight = parameters
            .split(';')
            .find_map(|parameter| parameter.trim().strip_prefix("q=")?.trim().parse::<f32>().ok());
        weight.unwrap_or(1.0)
    };
    lists.flat_map(|list| list.split(',')).any(|coding| {
        let (name, parameters) = coding.split_once(';').unwrap_or((coding, ""));
        name.trim().eq_ignore_ascii_case("gzip") && weight(parameters) > 0.0
    })
}

#[cfg(test)]
mod tests {
    use std::io::Read as _;

    use flate2::read::GzDecoder;

    use super::*;

    fn asked(accepted: Option<&str>) -> HeaderMap {
        accepted
            .map(|value| (header::ACCEPT_ENCODING, HeaderValue::from_str(value).expect("a value")))
            .into_iter()
            .collect()
    }

    #[test]
    fn what_a_client_accepts_it_gets_compressed() {
        let plain = Bytes::from("the same words, again and again. ".repeat(100));
        let compressed = Compressed::new(plain.clone());
        let gzip = compressed.gzip.clone().expect("it is shorter");
        assert!(gzip.len() < plain.len() / 10, "{}", gzip.len());
        let mut read = Vec::new();
        GzDecoder::new(&gzip[..]).read_to_end(&mut read).expect("gzip");
        assert_eq!(read, plain);
        for (accepted, expected) in [
            (None, false),
            (Some("gzip"), true),
            (Some("br, GZip;q=0.5"), true),
            (Some("gzip;q=0"), false),
            (Some("deflate, br"), false),
            (Some("x-gzip"), false),
        ] {
            let response = compressed.response(&asked(accepted), "text/plain");
            assert_eq!(
                response.headers().contains_key(header::CONTENT_ENCODING),
                expected,
                "{accepted:?}"
            );
            assert_eq!(response.headers()[header::VARY], "accept-encoding");
        }
    }

    #[test]
    fn what_does_not_get_shorter_is_sent_as_it_is() {
        let compressed = Compressed::new(Bytes::from_static(b"short"));
        let response = compressed.response(&asked(Some("gzip")), "text/plain");
        assert!(!response.headers().contains_key(header::CONTENT_ENCODING));
    }
}
