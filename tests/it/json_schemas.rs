//! The JSON schemas that editors read: up to date, and true of every shipped file.

use std::fs;
use std::path::{Path, PathBuf};

use hapticd::config::json_schema;
use serde_json::Value;

const ROOT: &str = env!("CARGO_MANIFEST_DIR");

fn schemas() -> [(PathBuf, String); 2] {
    let root = Path::new(ROOT);
    [
        (root.join("config/scene.schema.json"), json_schema::scene()),
        (root.join("devices/profile.schema.json"), json_schema::profile()),
    ]
}

#[test]
fn the_checked_in_schemas_are_those_of_the_parser() {
    for (path, schema) in schemas() {
        let checked_in = fs::read_to_string(&path).unwrap_or_default();
        assert!(
            checked_in == schema,
            "{} is out of date: run `HAPTICD_REWRITE=1 cargo test --test it \
                rewrite_the_json_schemas -- --ignored`",
            path.display()
        );
    }
}

#[test]
#[ignore = "writes files of the repository: HAPTICD_REWRITE=1 cargo test --test it \
    rewrite_the_json_schemas -- --ignored"]
fn rewrite_the_json_schemas() {
    // Long tests are run with all ignored ones: files are written only where this variable asks for
    // it.
    if std::env::var_os("HAPTICD_REWRITE").is_none() {
        return;
    }
    for (path, schema) in schemas() {
        fs::write(path, schema).unwrap();
    }
}

fn toml_files(folder: &str) -> Vec<PathBuf> {
    let entries =
        fs::read_dir(Path::new(ROOT).join(folder)).unwrap().map(|entry| entry.unwrap().path());
    entries.filter(|path| path.extension().is_some_and(|extension| extension == "toml")).collect()
}

fn as_json(text: &str) -> Value {
    serde_json::to_value(toml::from_str::<toml::Table>(text).unwrap()).unwrap()
}

/// What a schema says against a value: keys, types, words, lengths, minima. Covers what ours use,
/// and panics at anything else.
fn problems(root: &Value, schema: &Value, value: &Value, at: &str) -> Vec<String> {
    if let Some(target) = schema.get("$ref").and_then(Value::as_str) {
        let target = root
            .pointer(target.trim_start_matches('#'))
            .unwrap_or_else(|| panic!("{target} leads nowhere"));
        return problems(root, target, value, at);
    }
    if let Some(choices) = schema.get("anyOf").and_then(Value::as_array) {
        let mut found: Vec<Vec<String>> =
            choices.iter().map(|choice| problems(root, choice, value, at)).collect();
        found.sort_by_key(Vec::len);
        return found.swap_remove(0);
    }
    let mut found = Vec::new();
    if let Some(words) = schema.get("enum").and_then(Value::as_array)
        && !words.contains(value)
    {
        found.push(format!("{at}: {value} is none of {words:?}"));
    }
    if let Some(only) = schema.get("const")
        && only != value
    {
        found.push(format!("{at}: {value} is not {only}"));
    }
    let kind = match value {
        Value::Object(_) => "object",
        Value::Array(_) => "array",
        Value::String(_) => "string",
        Value::Bool(_) => "boolean",
        Value::Number(number) if number.is_f64() => "number",
        Value::Number(_) => "integer",
        Value::Null => "null",
    };
    match schema.get("type").and_then(Value::as_str) {
        Some(wanted) if wanted == kind || wanted == "number" && kind == "integer" => {}
        Some(wanted) => found.push(format!("{at}: {kind} and not {wanted}")),
        None => assert!(
            schema.get("const").or(schema.get("enum")).is_some(),
            "{at}: a schema without a type: {schema}"
        ),
    }
    if let (Some(number), Some(minimum)) =
        (value.as_f64(), schema.get("minimum").and_then(Value::as_f64))
        && number < minimum
    {
        found.push(format!("{at}: {number} is below {minimum}"));
    }
    match value {
        Value::Object(object) => {
            assert_eq!(
                schema.get("additionalProperties"),
                Some(&Value::Bool(false)),
                "{at}: unknown keys would pass"
            );
            for (key, value) in object {
                match schema.get("properties").and_then(|properties| properties.get(key)) {
                    Some(schema) => {
                        found.extend(problems(root, schema, value, &format!("{at}.{key}")))
                    }
                    None => found.push(format!("{at}.{key}: unknown key")),
                }
            }
        }
        Value::Array(array) => {
            let length =
                |key: &str| schema.get(key).and_then(Value::as_u64).map(|length| length as usize);
            if length("minItems").is_some_and(|least| array.len() < least)
                || length("maxItems").is_some_and(|most| array.len() > most)
            {
                found.push(format!("{at}: {} elements", array.len()));
            }
            let items = schema.get("items");
            for (idx, (value, items)) in array.iter().zip(items.into_iter().cycle()).enumerate() {
                found.extend(problems(root, items, value, &format!("{at}[{idx}]")));
            }
        }
        _ => {}
    }
    found
}

fn check(schema: &str, text: &str) -> Vec<String> {
    let schema: Value = serde_json::from_str(schema).unwrap();
    problems(&schema, &schema, &as_json(text), "")
}

#[test]
fn every_shipped_file_fits_its_schema() {
    let [(_, scene), (_, profile)] = schemas();
    let mut n_files = 0;
    for (schema, folder) in [
        (&scene, "config"),
        (&scene, "config/scenes"),
        (&scene, "config/clay"),
        (&profile, "devices"),
    ] {
        for path in toml_files(folder) {
            let found = check(schema, &fs::read_to_string(&path).unwrap());
            assert!(found.is_empty(), "{}: {found:#?}", path.display());
            n_files += 1;
        }
    }
    assert!(n_files > 30);
}

/// Every key of the commented-out lines of the default scene is known too: it lists all keys there
/// are.
#[test]
fn a_schema_refuses_what_the_parser_refuses() {
    let [(_, scene), (_, profile)] = schemas();
    let wrong = "version = 1\n[rendering]\ncoupling = \"magic\"\nrate_hz = -1\n[[static]]\nlayer = \
        8\n[filter]\ncutoff_hz = \"on\"\n";
    let found = check(&scene, wrong);
    for (key, n) in [
        (".rendering.coupling", 1),
        (".rendering.rate_hz", 1),
        (".static[0].layer", 1),
        (".filter.cutoff_hz", 1),
    ] {
        assert!(
            found.iter().filter(|problem| problem.starts_with(key)).count() >= n,
            "{key}: {found:#?}"
        );
    }
    let wrong = "version = 2\n[device]\nsensed = [\"x\", \"u\"]\n[frame]\ndevice_from_native = \
        [\"+x\"]\n[geometry]\norigin_m = [1, 2]\n";
    let found = check(&profile, wrong);
    for key in [".version", ".device.sensed[1]", ".frame.device_from_native", ".geometry.origin_m"]
    {
        assert!(found.iter().any(|problem| problem.starts_with(key)), "{key}: {found:#?}");
    }
}
