//! Clay, as clients meet it.

use serde_json::json;

use super::Daemon;

#[test]
fn a_rigid_scene_has_no_clay_and_says_which_command_has() {
    let daemon = Daemon::enabled("", "");
    for (method, path, body) in [
        ("GET", "clay", ""),
        ("GET", "clay/points", ""),
        ("GET", "clay/points?since=4", ""),
        ("POST", "clay/tool", r#"{"craft": "paint"}"#),
        ("POST", "clay/undo", ""),
        ("POST", "clay/redo", ""),
        ("POST", "clay/save", r#"{"kind": "points"}"#),
    ] {
        let (status, answer) = daemon.http(method, &format!("/api/v1/{path}"), &[], body);
        assert_eq!(status, 404, "{path}: {answer}");
        assert!(answer["hint"].as_str().is_some_and(|hint| hint.contains("hapticd sculpt")), "{answer}");
    }
    for (method, path, body, expected) in [
        ("GET", "clay/points?since=new", "", 400),
        ("POST", "clay/tool", r#"{"brush": 1}"#, 400),
        ("POST", "clay/undo", r#"{"strokes": 2}"#, 400),
        ("POST", "clay/save", r#"{"kind": "photo"}"#, 400),
        ("GET", "clay/undo", "", 405),
    ] {
        let (status, answer) = daemon.http(method, &format!("/api/v1/{path}"), &[], body);
        assert_eq!(status, expected, "{path} {body}: {answer}");
        assert!(answer["error"].is_string(), "{answer}");
    }
    let mut client = daemon.connect();
    for request in [
        json!({ "do": "clay_take", "craft": "paint" }),
        json!({ "do": "clay_hold", "held": true }),
        json!({ "do": "clay_undo" }),
        json!({ "do": "clay_save", "kind": "export" }),
    ] {
        let reply = client.ask(request.clone());
        assert_eq!((&reply["ok"], &reply["status"]), (&false.into(), &404.into()), "{request}: {reply}");
    }
}
