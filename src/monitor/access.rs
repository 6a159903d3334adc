//! Who may do what: every client that reaches the server may switch force off; all else takes the
//! token, where there is one; and no page of another server may do anything.
//!
//! A web page that the operator has open can send requests to this machine too. It betrays itself
//! by its `Origin`; and where its name was bent to point here (DNS rebinding), by the `Host` that
//! it asked for.

use std::net::{IpAddr, SocketAddr};
use std::path::{Path, PathBuf};

use axum::http::{HeaderMap, StatusCode, header};

use super::problem::RequestError;
use vps::storage::regular;

/// Fewest characters of a token: 96 bits even of hexadecimal digits would be 24, and no person
/// types these.
const LEAST_TOKEN: usize = 16;
/// Most, so that a file that is something else is noticed.
const MOST_TOKEN: usize = 512;
/// Bytes of a file with a token at most: there may be blanks around it.
const LONGEST_TOKEN_FILE: u64 = 4096;
/// 122 random bits of the kernel, as text; others with every reading.
const RANDOM: &str = "/proc/sys/kernel/random/uuid";
/// Name of this machine.
const HOST_NAME: &str = "/proc/sys/kernel/hostname";

/// A secret that lets a client in.
#[derive(Clone, PartialEq, Eq)]
pub struct Token(String);

impl core::fmt::Debug for Token {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str("Token(…)")
    }
}

/// Why a token will not do.
#[derive(Debug, thiserror::Error)]
pub enum TokenError {
    /// Its file.
    #[error("cannot read the token file {}: {cause}", path.display())]
    Unreadable {
        /// Which.
        path: PathBuf,
        /// Why.
        cause: std::io::Error,
    },
    /// What is in it.
    #[error(
        "the token of {from} is no token: {LEAST_TOKEN} to {MOST_TOKEN} printable ASCII characters \
            without spaces"
    )]
    Malformed {
        /// A file, or a variable of the environment.
        from: String,
    },
}

impl Token {
    /// A token as it is written; `from` is for messages.
    ///
    /// # Errors
    /// [`TokenError::Malformed`].
    pub fn new(text: &str, from: &str) -> Result<Self, TokenError> {
        let text = text.trim();
        let is_sound = (LEAST_TOKEN..=MOST_TOKEN).contains(&text.len())
            && text.bytes().all(|byte| byte.is_ascii_graphic());
        if is_sound {
            Ok(Self(text.to_owned()))
        } else {
            Err(TokenError::Malformed { from: from.to_owned() })
        }
    }

    /// The token that a file holds.
    ///
    /// # Errors
    /// See [`TokenError`].
    pub fn read(path: &Path) -> Result<Self, TokenError> {
        let text = regular::text(path, LONGEST_TOKEN_FILE)
            .map_err(|cause| TokenError::Unreadable { path: path.to_owned(), cause })?;
        Self::new(&text, &path.display().to_string())
    }

    /// A new token that nothing else knows.
    ///
    /// # Errors
    /// [`TokenError::Unreadable`]: the kernel gives no random bits.
    pub fn random() -> Result<Self, TokenError> {
        Self::read(Path::new(RANDOM))
    }

    /// The token, for the person who starts the run.
    pub fn text(&self) -> &str {
        &self.0
    }

    /// In a time that says nothing of how much of it was right.
    fn is(&self, other: &str) -> bool {
        let ours = self.0.as_bytes();
        let theirs = other.as_bytes();
        let differs = ours
            .iter()
            .zip(theirs)
            .fold(0, |differs, (a, b)| core::hint::black_box(differs | (a ^ b)));
        ours.len() == theirs.len() && differs == 0
    }
}

/// The rule of one server.
#[derive(Clone, Debug)]
pub struct Access {
    address: SocketAddr,
    token: Option<Token>,
    origins: Vec<String>,
    /// Names by which clients may ask for this server.
    names: Vec<String>,
}

impl Access {
    /// For a server that listens at `address`. `origins`: pages of other servers that are welcome,
    /// such as `http://localhost:8000`; their names are names of this server, too.
    pub fn new(address: SocketAddr, token: Option<Token>, origins: Vec<String>) -> Self {
        let mut names = vec!["localhost".to_owned()];
        names.extend(
            origins.iter().filter_map(|origin| Some(split_port(host_of(origin)?).0.to_owned())),
        );
        if !address.ip().is_loopback() {
            // A machine without a name is asked for by its address.
            let own = regular::text(Path::new(HOST_NAME), LONGEST_TOKEN_FILE).unwrap_or_default();
            names.push(own.trim().to_owned());
        }
        Self { address, token, origins, names }
    }

    /// True when every address but the loopback ones is out of reach, or a token is asked for.
    pub fn is_safe(address: SocketAddr, token: Option<&Token>) -> bool {
        address.ip().is_loopback() || token.is_some()
    }

    /// Every client may read what this page is made of; it holds no secret.
    pub(super) fn may_see_page(&self, headers: &HeaderMap) -> Result<(), RequestError> {
        self.host(headers)
    }

    /// May the client that sent this switch force off? That takes no token.
    pub(super) fn may_switch_off(&self, headers: &HeaderMap) -> Result<(), RequestError> {
        self.host(headers)?;
        self.origin(headers)
    }

    /// May the client that sent this use the API?
    pub(super) fn may_ask(
        &self,
        headers: &HeaderMap,
        query: Option<&str>,
    ) -> Result<(), RequestError> {
        self.may_switch_off(headers)?;
        let Some(token) = &self.token else { return Ok(()) };
        match given_token(headers, query) {
            Some(given) if token.is(&given) => Ok(()),
            given => {
                let error = if given.is_some() { "wrong token" } else { "a token is needed" };
                let hint = "send it as `Authorization: Bearer TOKEN` or as `?token=TOKEN`; the \
                    page takes it as `/#token=TOKEN`";
                Err(RequestError::new(StatusCode::UNAUTHORIZED, error, hint))
            }
        }
    }

    /// Only names and addresses of this server: no name that others made point here.
    fn host(&self, headers: &HeaderMap) -> Result<(), RequestError> {
        let host = text(headers, header::HOST).unwrap_or_default();
        if self.is_own_host(host) {
            return Ok(());
        }
        let hint = format!(
            "this server answers as localhost:{port} and {}; another name of it stands in \
                `monitor.origins` of the scene, such as \"http://arm.example:{port}\"",
            self.address,
            port = self.address.port()
        );
        Err(RequestError::new(
            StatusCode::FORBIDDEN,
            format!("the host `{}` is not this server", shown(host)),
            hint,
        ))
    }

    fn is_own_host(&self, host: &str) -> bool {
        let (name, port) = split_port(host);
        let is_own = match name.trim_start_matches('[').trim_end_matches(']').parse::<IpAddr>() {
            // An address is no name that others could bend. Where only this machine comes in, it
            // has no other addresses.
            Ok(ip) => ip.is_loopback() || !self.address.ip().is_loopback(),
            Err(_) => self.names.iter().any(|own| own.eq_ignore_ascii_case(name)),
        };
        // Port 80 goes without saying; a forwarded port (ssh -L) has another number.
        is_own && !name.is_empty() && port.is_none_or(|port| port.parse::<u16>().is_ok())
    }

    /// Programs send no origin; pages always do.
    fn origin(&self, headers: &HeaderMap) -> Result<(), RequestError> {
        let Some(origin) = headers.get(header::ORIGIN) else { return Ok(()) };
        let origin = origin.to_str().unwrap_or_default();
        let own = text(headers, header::HOST).is_some_and(|host| {
            host_of(origin).is_some_and(|asked| asked.eq_ignore_ascii_case(host))
        });
        if own || self.origins.iter().any(|welcome| welcome == origin) {
            return Ok(());
        }
        let hint =
            "open the page of this server, or name the other one in `monitor.origins` of the scene";
        Err(RequestError::new(
            StatusCode::FORBIDDEN,
            format!("pages of `{}` may not use this server", shown(origin)),
            hint,
        ))
    }
}

fn text(headers: &HeaderMap, name: header::HeaderName) -> Option<&str> {
    headers.get(name)?.to_str().ok()
}

/// What others wrote, short and harmless.
fn shown(text: &str) -> String {
    text.chars().filter(|c| !c.is_control()).take(80).collect()
}

/// Host of an origin, with its port.
fn host_of(origin: &str) -> Option<&str> {
    origin.strip_prefix("http://").or(origin.strip_prefix("https://"))
}

fn split_port(host: &str) -> (&str, Option<&str>) {
    match host.rsplit_once(':') {
        // The colons of an IPv6 address stand in brackets.
        Some((name, port)) if !port.contains(']') => (name, Some(port)),
        _ => (host, None),
    }
}

fn given_token(headers: &HeaderMap, query: Option<&str>) -> Option<String> {
    let bearer = text(headers, header::AUTHORIZATION).and_then(|value| {
        let (scheme, token) = value.split_once(' ')?;
        scheme.eq_ignore_ascii_case("bearer").then(|| token.trim().to_owned())
    });
    bearer.or_else(|| {
        let value = query?.split('&').find_map(|pair| pair.strip_prefix("token="))?;
        Some(percent_encoding::percent_decode_str(value).decode_utf8_lossy().into_owned())
    })
}

#[cfg(test)]
mod tests {
    use axum::http::HeaderValue;

    use super::*;

    const SECRET: &str = "0123456789abcdef0123";

    fn headers(pairs: &[(header::HeaderName, &str)]) -> HeaderMap {
        pairs
            .iter()
            .map(|(name, value)| (name.clone(), HeaderValue::from_str(value).expect("a value")))
            .collect()
    }

    fn status(access: &Access, pairs: &[(header::HeaderName, &str)], query: Option<&str>) -> u16 {
        access
            .may_ask(&headers(pairs), query)
            .map_or_else(|problem| problem.status.as_u16(), |()| 200)
    }

    #[test]
    fn on_loopback_names_of_this_machine_and_its_own_pages_come_in() {
        let access = Access::new(
            "127.0.0.1:7878".parse().expect("an address"),
            None,
            vec!["http://lab:8000".to_owned()],
        );
        use header::{HOST, ORIGIN};
        for (host, origin, expected) in [
            ("127.0.0.1:7878", None, 200),
            ("localhost:7878", None, 200),
            ("LocalHost", None, 200),
            ("[::1]:7878", Some("http://[::1]:7878"), 200),
            ("localhost:9000", Some("http://localhost:9000"), 200),
            ("localhost:7878", Some("http://lab:8000"), 200),
            ("lab:7878", None, 200),
            ("Lab:7878", Some("http://lab:7878"), 200),
            ("localhost:7878", Some("http://localhost:8000"), 403),
            ("localhost:7878", Some("null"), 403),
            ("localhost:7878", Some("http://evil.example"), 403),
            ("evil.example:7878", Some("http://evil.example:7878"), 403),
            ("127.0.0.1.evil.example:7878", None, 403),
            ("localhost:evil", None, 403),
            ("10.0.0.7:7878", None, 403),
            ("", None, 403),
        ] {
            let mut pairs = vec![(HOST, host)];
            pairs.extend(origin.map(|origin| (ORIGIN, origin)));
            assert_eq!(status(&access, &pairs, None), expected, "{host} {origin:?}");
        }
        assert_eq!(status(&access, &[], None), 403);
    }

    #[test]
    fn a_token_is_asked_for_and_compared_whole() {
        let token = Token::new(SECRET, "here").expect("a token");
        let access = Access::new(
            "192.0.2.1:7878".parse().expect("an address"),
            Some(token),
            vec!["http://arm:7878".to_owned()],
        );
        use header::{AUTHORIZATION, HOST, ORIGIN};
        let bearer = |token: &str| format!("Bearer {token}");
        assert_eq!(status(&access, &[(HOST, "arm:7878")], None), 401);
        let given = |token: &str| {
            status(&access, &[(HOST, "192.0.2.1:7878"), (AUTHORIZATION, &bearer(token))], None)
        };
        assert_eq!(given(SECRET), 200);
        assert_eq!(given(&SECRET[1..]), 401);
        assert_eq!(given(&format!("{SECRET}0")), 401);
        assert_eq!(given(""), 401);
        assert_eq!(
            status(&access, &[(HOST, "arm:7878")], Some(&format!("a=b&token={SECRET}"))),
            200
        );
        assert_eq!(
            status(
                &access,
                &[(HOST, "arm:7878"), (ORIGIN, "http://arm:7878")],
                Some(&format!("token={SECRET}"))
            ),
            200
        );
        assert_eq!(
            status(
                &access,
                &[(HOST, "arm:7878"), (ORIGIN, "http://evil")],
                Some(&format!("token={SECRET}"))
            ),
            403
        );
    }

    #[test]
    fn a_bent_name_stays_out_of_every_address_and_off_takes_no_token() {
        let token = Token::random().expect("a kernel with random bits");
        assert_ne!(token, Token::random().expect("again"));
        let wide = Access::new("0.0.0.0:7878".parse().expect("an address"), Some(token), vec![]);
        let own = regular::text(Path::new(HOST_NAME), 256).expect("a machine with a name");
        use header::{HOST, ORIGIN};
        let off = |pairs: &[(header::HeaderName, &str)]| {
            wide.may_switch_off(&headers(pairs)).map_err(|problem| problem.status.as_u16())
        };
        for host in ["localhost:7878", "10.0.0.7:7878", "[fe80::1]:7878", own.trim()] {
            assert_eq!(off(&[(HOST, host)]), Ok(()), "{host}");
            assert_eq!(status(&wide, &[(HOST, host)], None), 401, "{host}");
        }
        assert_eq!(off(&[(HOST, "evil.example:7878")]), Err(403));
        assert_eq!(off(&[(HOST, "10.0.0.7:7878"), (ORIGIN, "http://evil.example")]), Err(403));
        let evil = [(HOST, "evil.example:7878"), (ORIGIN, "http://evil.example:7878")];
        assert_eq!((off(&evil), status(&wide, &evil, None)), (Err(403), 403));
    }

    #[test]
    fn tokens_are_long_and_plain() {
        assert!(Token::new(" 0123456789abcdef\n", "here").is_ok());
        for wrong in ["", "short", "0123456789 abcdef", "0123456789äbcdef"] {
            assert!(
                matches!(Token::new(wrong, "here"), Err(TokenError::Malformed { .. })),
                "{wrong}"
            );
        }
        assert!(!Access::is_safe("0.0.0.0:1".parse().expect("an address"), None));
        assert!(Access::is_safe("[::1]:1".parse().expect("an address"), None));
    }
}
