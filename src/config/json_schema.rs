//! JSON schemas of scenes and profiles, for editors: from the types that read them, so that they
//! cannot say anything else.
//!
//! The texts are checked in as `config/scene.schema.json` and `devices/profile.schema.json`; a test
//! holds them against these functions.

use schemars::Schema;
use serde_json::Value;

use super::schema;
use arms::profile;

/// Schema of a scene file, indented, with a line feed at the end.
pub fn scene() -> String {
    text(schemars::schema_for!(schema::Scene))
}

/// Schema of a device profile, indented, with a line feed at the end.
pub fn profile() -> String {
    text(profile::schema())
}

fn text(schema: Schema) -> String {
    let mut value = schema.to_value();
    without_null(&mut value);
    // A value of strings and numbers always has a text.
    let mut text = serde_json::to_string_pretty(&value).unwrap_or_default();
    text.push('\n');
    text
}

/// TOML has no null: a key that may be left out is simply not required.
fn without_null(value: &mut Value) {
    match value {
        Value::Object(object) => {
            if let Some(Value::Array(types)) = object.get_mut("type") {
                types.retain(|name| name != "null");
                if let [only] = &types[..] {
                    let only = only.clone();
                    object.insert("type".to_owned(), only);
                }
            }
            if let Some(Value::Array(choices)) = object.get_mut("anyOf") {
                choices.retain(|choice| choice.get("type").is_none_or(|name| name != "null"));
                if let [Value::Object(only)] = &choices[..] {
                    let only = only.clone();
                    object.remove("anyOf");
                    object.extend(only);
                }
            }
            object.remove("default");
            object.values_mut().for_each(without_null);
        }
        Value::Array(array) => array.iter_mut().for_each(without_null),
        _ => {}
    }
}
