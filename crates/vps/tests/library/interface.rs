//! The pages of the crate show the stable interface alone, with examples.

const ROOT: &str = include_str!("../../src/lib.rs");
/// The files whose public items are the stable interface, but for hidden ones.
const FILES: [(&str, &str); 4] = [
    ("baked.rs", include_str!("../../src/library/baked.rs")),
    ("error.rs", include_str!("../../src/library/error.rs")),
    ("mesh.rs", include_str!("../../src/library/mesh.rs")),
    ("query.rs", include_str!("../../src/library/query.rs")),
];

/// Each line that begins a public item, with the comments and attributes above it.
fn public_items(text: &str) -> Vec<(&str, String)> {
    let mut above = String::new();
    let mut items = Vec::new();
    for line in text.lines().map(str::trim) {
        if line.starts_with("///") || line.starts_with("#[") {
            above = above + line + "\n";
        } else {
            if line.starts_with("pub ") {
                items.push((line, above));
            }
            above = String::new();
        }
    }
    items
}

#[test]
fn modules_of_the_inside_have_no_pages() {
    for (item, above) in public_items(ROOT) {
        let is_hidden = above.contains(r#"not(feature = "inner-docs"), doc(hidden)"#);
        assert!(!item.starts_with("pub mod") || is_hidden, "`{item}` shows: hide it as the others");
    }
}

#[test]
fn calls_with_arguments_have_examples() {
    let mut calls = 0;
    for (file, text) in FILES {
        for (item, above) in public_items(text) {
            let is_call = item.starts_with("pub fn") && !item.contains("(&self)");
            if is_call && !above.contains("doc(hidden)") {
                assert!(above.contains("/// ```"), "{file}: `{item}` has no example");
                calls += 1;
            }
        }
    }
    assert!(calls > 20, "found only {calls} calls");
}
