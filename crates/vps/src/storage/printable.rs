//! Foreign text on a terminal: a name may hold bytes that move the cursor, recolour what was said,
//! or begin a line of their own.

use std::borrow::Cow;
use std::path::Path;

/// Characters that a terminal, or the eye, takes for more than themselves: control characters,
/// separators of lines, and those that turn the direction of writing.
pub fn is_control(c: char) -> bool {
    c.is_control()
        || matches!(
            c,
            '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}'
        )
}

/// Text of several lines: control characters escaped (`\u001b`), but for line breaks and tabs. In
/// a text of JSON the escapes mean the same characters.
pub fn printable(text: &str) -> Cow<'_, str> {
    escaped(text, |c| is_control(c) && !matches!(c, '\n' | '\t'))
}

/// Text of one line: every control character escaped.
pub fn one_line(text: &str) -> Cow<'_, str> {
    escaped(text, is_control)
}

/// The name of a file, in one line.
pub fn shown(path: &Path) -> String {
    one_line(&path.to_string_lossy()).into_owned()
}

fn escaped(text: &str, is_escaped: impl Fn(char) -> bool) -> Cow<'_, str> {
    if !text.contains(&is_escaped) {
        return Cow::Borrowed(text);
    }
    let mut escaped = String::with_capacity(text.len() + 16);
    for c in text.chars() {
        if !is_escaped(c) {
            escaped.push(c);
            continue;
        }
        match c {
            '\n' => escaped.push_str("\\n"),
            '\r' => escaped.push_str("\\r"),
            '\t' => escaped.push_str("\\t"),
            _ => escaped += &format!("\\u{:04x}", u32::from(c)),
        }
    }
    Cow::Owned(escaped)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_of_a_name_reaches_a_terminal_but_letters() {
        for (text, several_lines, line) in [
            ("gear Schüssel 歯車", "gear Schüssel 歯車", "gear Schüssel 歯車"),
            (
                "a\x1b[2Jb\x07\u{9b}31m",
                "a\\u001b[2Jb\\u0007\\u009b31m",
                "a\\u001b[2Jb\\u0007\\u009b31m",
            ),
            ("a\nstate: disabled\tb", "a\nstate: disabled\tb", "a\\nstate: disabled\\tb"),
            ("a\r\u{7f}", "a\\r\\u007f", "a\\r\\u007f"),
            ("lmo.\u{202e}jbo\u{2028}", "lmo.\\u202ejbo\\u2028", "lmo.\\u202ejbo\\u2028"),
        ] {
            assert_eq!((&*printable(text), &*one_line(text)), (several_lines, line));
        }
        assert!(matches!(printable("plain\n"), Cow::Borrowed(_)));
        assert_eq!(shown(Path::new("a\nb.toml")), "a\\nb.toml");
    }
}
