//! What clients change.

use serde_json::{Value, json};

use super::{Daemon, Ended, http, length, no_record_lost, scene_file};

fn pressed(state: &Value) -> bool {
    length(&state["measured_cf"]["f"]) > 0.5
}

#[test]
fn disable_takes_the_force_away_and_enable_brings_it_back_from_zero() {
    let mut daemon = Daemon::enabled("", "");
    let mut client = daemon.connect();
    client.subscribe(1000.0);
    client.state_where(pressed);
    client.does(json!({ "do": "disable" }));
    client.event("state", "disabled");
    let state = client.state_where(|state| state["state"] == "DISABLED");
    assert_eq!((length(&state["servo_cf"]["f"]), length(&state["measured_cf"]["f"])), (0.0, 0.0));
    assert_eq!(
        (state["off_cause"].as_str(), &state["device_cp_world"]),
        (Some("software"), &Value::Null)
    );
    client.does(json!({ "do": "enable" }));
    client.state_where(|state| state["state"] == "ENABLED" && state["is_busy"] == true);
    let (status, body) = daemon.http("POST", "/api/v1/stop", &[], "");
    assert_eq!(status, 200, "{body}");
    let ended = daemon.ended();
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    no_record_lost(&ended);
}

#[test]
fn a_parameter_goes_there_and_others_hear_of_it() {
    let daemon = Daemon::enabled("", "");
    let mut client = daemon.connect();
    let mut other = daemon.connect();
    other.subscribe(1000.0);
    let before = other.state_where(|state| length(&state["measured_cf"]["f"]) > 1.0);
    let name = "limit_force_n";
    let least = daemon
        .get("/api/v1/parameters")
        .as_array()
        .unwrap()
        .iter()
        .find(|parameter| parameter["name"] == name)
        .unwrap()["least"]
        .clone();
    client.does(json!({ "do": "set", "parameter": name, "value": least }));
    let event = other.event("parameter", name);
    assert!(event["text"].as_str().unwrap().contains(name));
    let after = other
        .state_where(|state| length(&state["measured_cf"]["f"]) <= least.as_f64().unwrap() + 1e-9);
    assert!(length(&before["measured_cf"]["f"]) > length(&after["measured_cf"]["f"]));
    let set = daemon
        .get("/api/v1/parameters")
        .as_array()
        .unwrap()
        .iter()
        .find(|parameter| parameter["name"] == name)
        .unwrap()["value"]
        .clone();
    assert_eq!(set, least);
    for (path, body, expected) in [
        ("limit_force_n", r#"{"value": 1e6}"#, 400),
        ("limit_force_n", r#"{"value": "much"}"#, 400),
        ("limit_force_n", r#"{"amount": 1}"#, 400),
        ("limit_force_n", "", 400),
        ("limit_force_n", "[6]", 400),
        ("limit_farce_n", r#"{"value": 1}"#, 404),
        ("contact_stiffness_n_per_m", r#"{"value": 4000}"#, 200),
    ] {
        let (status, answer) = daemon.http("PUT", &format!("/api/v1/parameters/{path}"), &[], body);
        assert_eq!(status, expected, "{path} {body}: {answer}");
        assert_eq!(status == 200, answer["ok"] == true, "{answer}");
    }
    for (method, path, body, expected) in [
        ("POST", "enable", r#"{"gently": true}"#, 400),
        ("POST", "enable", "[]", 400),
        ("POST", "disable", "what?", 200),
        ("PUT", "parameters/%ff", r#"{"value": 1}"#, 400),
        ("GET", "scene/zero/mesh/0", "", 400),
    ] {
        let (status, answer) = daemon.http(method, &format!("/api/v1/{path}"), &[], body);
        assert_eq!(status, expected, "{path} {body}: {answer}");
        assert_eq!(status == 200, answer["ok"] == true, "{answer}");
        assert!(status == 200 || answer["error"].is_string(), "{answer}");
    }
    let reply = client.ask(json!({ "do": "set", "parameter": "limit_farce_n", "value": 1 }));
    assert!(reply["error"].as_str().unwrap().contains("limit_force_n"), "{reply}");
}

#[test]
fn a_movable_object_goes_where_it_is_asked_to() {
    let daemon = Daemon::enabled("", "");
    let mut client = daemon.connect();
    client.subscribe(200.0);
    let at = |z: f64| json!({ "p": [0, 0, z], "q": [0, 0, 0, 1] });
    client.does(json!({ "do": "place", "object": "plate", "pose": at(-0.03) }));
    let z_m = |state: &Value| state["objects"][0]["p"][2].as_f64().unwrap();
    let mut seen = Vec::new();
    let arrived = loop {
        let state = client.state();
        seen.push(z_m(&state));
        if (z_m(&state) + 0.03).abs() < 1e-5 {
            break state;
        }
    };
    assert_eq!(arrived["contacts"], 0, "the plate has gone from under the tool");
    assert!(seen.windows(2).all(|pair| pair[1] <= pair[0]), "{seen:?}");
    let under_way = seen.iter().filter(|z_m| (-0.029..-0.011).contains(*z_m)).count();
    assert!(under_way > 3, "it goes there, it does not jump: {seen:?}");
    for (object, pose, expected) in [
        ("plat", at(0.0), 404),
        ("tool", at(0.0), 404),
        ("plate", json!({ "p": [0, 0, 0], "q": [0, 0, 0, 2] }), 400),
    ] {
        let (status, answer) =
            daemon.http("PUT", &format!("/api/v1/objects/{object}/pose"), &[], &pose.to_string());
        assert_eq!(status, expected, "{object}: {answer}");
    }
}

#[test]
fn the_hand_goes_where_it_is_asked_to_and_a_run_with_a_reset_is_replayed() {
    let mut daemon = Daemon::enabled("", "--record run.mcap");
    let mut client = daemon.connect();
    client.subscribe(200.0);
    client.state_where(pressed);
    assert_eq!(daemon.get("/api/v1/scene")["hand"], json!({ "path": true }));
    let reply =
        client.ask(json!({ "do": "hand", "pose": { "p": [0, 0, 0.02], "q": [0, 0, 0, 1] } }));
    assert_eq!(reply["order"], 1, "{reply}");
    let used = client.state_where(|state| state["hand"]["order"] == 1);
    assert!(used["hand"]["waited_us"].as_u64().is_some_and(|waited_us| waited_us > 0), "{used}");
    // The joints of the arm have friction: the grip rests where it is less than that away.
    client.state_where(|state| (state["tool_cp"]["p"][2].as_f64().unwrap() - 0.02).abs() < 5e-4);
    client.does(json!({ "do": "restart_hand" }));
    client.state_where(pressed);
    for (path, body, expected) in [
        ("hand", r#"{"pose": {"p": [0, 0, 0], "q": [0, 0, 0, 2]}}"#, 400),
        ("hand", r#"{"p": [0, 0, 0]}"#, 400),
        ("hand", r#"{"pose": {"p": [0, 0, 0.02], "q": [0, 0, 0, 1]}, "scene_idx": 1}"#, 409),
        ("hand", r#"{"pose": {"p": [0, 0, 0.02], "q": [0, 0, 0, 1]}, "scene_idx": 0}"#, 200),
        ("hand/restart", "", 200),
        ("scene/reset", "", 200),
    ] {
        let (status, answer) = daemon.http("POST", &format!("/api/v1/{path}"), &[], body);
        assert_eq!(status, expected, "{path} {body}: {answer}");
    }
    client.state_where(|state| state["scene_idx"] == 1 && pressed(state));
    let (status, body) = daemon.http("POST", "/api/v1/stop", &[], "");
    assert_eq!(status, 200, "{body}");
    let recorded = daemon.folder.path().join("run.mcap");
    let ended = daemon.ended();
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let replayed = std::process::Command::new(env!("CARGO_BIN_EXE_hapticd"))
        .arg("replay")
        .arg(&recorded)
        .arg("--json")
        .output()
        .unwrap();
    let replayed: Value = serde_json::from_slice(&replayed.stdout).unwrap();
    assert_eq!(
        (&replayed["identical"], &replayed["scenes"]),
        (&json!(true), &json!(2)),
        "{replayed}"
    );
}

#[test]
fn another_scene_takes_over_and_is_reported() {
    let folder = super::folder("");
    scene_file(&folder, "other.toml", "[contact]\nstiffness_n_per_mm3 = 0.5\n");
    scene_file(&folder, "faster.toml", "[rendering]\nrate_hz = 500\n");
    scene_file(&folder, "held.toml", "[safety]\ndeadman = 2\n");
    std::fs::write(folder.path().join("wrong.toml"), "version = 1\n").unwrap();
    let mut daemon = Daemon::of(folder, "", &[]);
    daemon.wait_for("state: enabled");
    assert_eq!(daemon.get("/api/v1/scenes"), json!(["faster", "held", "other", "press", "wrong"]));
    let mut client = daemon.connect();
    for (scene, expected, word) in [
        ("none", 404, "other"),
        ("wrong", 409, "tool"),
        ("faster", 409, "rate_hz"),
        ("held", 409, "safety.deadman = 2"),
    ] {
        let reply = client.ask(json!({ "do": "switch", "scene": scene }));
        assert_eq!(reply["status"], expected, "{reply}");
        assert!(reply["error"].as_str().unwrap().contains(word), "{reply}");
    }
    client.does(json!({ "do": "switch", "scene": "other" }));
    client.event("scene", "rendered");
    client.subscribe(100.0);
    let state = client.state_where(|state| state["scene_idx"] == 1);
    assert!(state["tick"].as_u64() > Some(0));
    let scene = daemon.get("/api/v1/scene");
    assert!(
        scene["scene_idx"] == 1 && scene["file"].as_str().unwrap().ends_with("other.toml"),
        "{scene}"
    );
    let stiffness = &daemon.get("/api/v1/parameters")[0];
    assert_eq!(
        (&stiffness["name"], &stiffness["value"]),
        (&"contact_stiffness_n_per_m".into(), &2000.0.into())
    );
    // A parameter of the new scene, and back over HTTP.
    client.does(json!({ "do": "set", "parameter": "contact_stiffness_n_per_m", "value": 3000 }));
    let (status, answer) = daemon.http("POST", "/api/v1/scene", &[], r#"{"scene": "press"}"#);
    assert!(status == 200 || status == 202, "{answer}");
    client.state_where(|state| state["scene_idx"] == 2);
    let ended = daemon.end();
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    no_record_lost(&ended);
}

#[test]
fn a_scene_says_what_its_files_were_taken_for_also_after_a_switch_and_a_reset() {
    let folder = super::folder("");
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/docs/pictures/solid-pieces.obj");
    let pieces = super::SCENE
        .replace(
            "shape = { box_mm = [60.0, 60.0, 20.0] }",
            &format!("mesh = \"{file}\"\nunits = \"mm\""),
        )
        .replace("[0, 0, -10]", "[0, 0, -30]");
    std::fs::write(folder.path().join("pieces.toml"), pieces).unwrap();
    let mut daemon = Daemon::of(folder, "", &[]);
    daemon.wait_for("state: enabled");
    let mut client = daemon.connect();
    client.subscribe(100.0);
    let reports = || {
        let scene = daemon.get("/api/v1/scene");
        [0, 1].map(|object| scene["objects"][object]["report"].clone())
    };
    let [plate, tool] = reports();
    let found = |report: &Value, keys: [&str; 4]| keys.map(|key| report["solid"][key].clone());
    let counts = ["pieces", "bodies", "open_pieces", "skins"];
    assert_eq!(found(&plate, counts), [json!(1), json!(1), json!(0), json!(0)]);
    assert_eq!((&plate["triangles"], &plate["warnings"]), (&json!(12), &json!([])));
    assert_eq!((&tool["name"], &tool["role"]), (&json!("tool"), &json!("tool")));
    client.does(json!({ "do": "switch", "scene": "pieces" }));
    client.state_where(|state| state["scene_idx"] == 1);
    let [pieces, _] = reports();
    assert_eq!(found(&pieces, counts), [json!(4), json!(2), json!(1), json!(1)]);
    let mm = |key: &str, factor: f64| pieces["solid"][key].as_f64().unwrap() * factor;
    assert!((mm("volume_m3", 1e9) - 11_896.0).abs() < 0.1, "{pieces}");
    assert!((mm("inside_area_m2", 1e6) - 448.0).abs() < 0.01, "{pieces}");
    assert!((mm("skin_area_m2", 1e6) - 400.0).abs() < 0.01, "{pieces}");
    assert_eq!(pieces["solid"]["cavities_m3"].as_array().map(Vec::len), Some(1));
    client.does(json!({ "do": "reset" }));
    client.state_where(|state| state["scene_idx"] == 2);
    assert_eq!(reports()[0], pieces);
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn a_limit_that_a_client_lowered_stays_lowered_in_every_scene_until_a_client_raises_it() {
    let folder = super::folder("");
    // Where the hand is when force comes back is the new zero: this one presses deeper each time,
    // and draws back in between.
    let press = |k: u32| {
        let t_s = 1.5 * f64::from(k);
        let z_m = 0.012 - 0.003 * f64::from(k + 2);
        format!(
            "{},0,0,0.012,0,0,0,1\n{},0,0,{z_m},0,0,0,1\n{},0,0,{z_m},0,0,0,1\n",
            t_s + 0.2,
            t_s + 0.5,
            t_s + 1.3
        )
    };
    let hand = "t_s,x_m,y_m,z_m,qx,qy,qz,qw\n0,0,0,0.012,0,0,0,1\n".to_owned()
        + &(0..30).map(press).collect::<String>();
    std::fs::write(folder.path().join("hand.csv"), hand).unwrap();
    scene_file(
        &folder,
        "other.toml",
        "[contact]\nstiffness_n_per_mm3 = 0.5\n[limits]\nforce_n = 1.8\n",
    );
    let mut daemon = Daemon::of(folder, "--watch --record run.mcap", &[]);
    daemon.wait_for("state: enabled");
    let mut client = daemon.connect();
    client.subscribe(1000.0);
    let force = |state: &Value| length(&state["servo_cf"]["f"]);
    let parameter = |daemon: &Daemon| {
        let parameters = daemon.get("/api/v1/parameters");
        parameters
            .as_array()
            .unwrap()
            .iter()
            .find(|parameter| parameter["name"] == "limit_force_n")
            .unwrap()
            .clone()
    };
    client.state_where(|state| force(state) > 1.0);
    client.does(json!({ "do": "set", "parameter": "limit_force_n", "value": 0.7 }));
    client.state_where(|state| (force(state) - 0.7).abs() < 1e-9);
    // Pressed on for half a second after each change, no state has more.
    let mut stays = |what: &str, scene_idx: u64| {
        let at_limit = client.state_where(|state| {
            assert!(force(state) <= 0.7 + 1e-9, "{what}: {state}");
            state["scene_idx"] == scene_idx && (force(state) - 0.7).abs() < 1e-9
        });
        let until = at_limit["tick"].as_u64().unwrap() + 500;
        client.state_where(|state| {
            assert!(force(state) <= 0.7 + 1e-9, "{what}: {state}");
            state["tick"].as_u64() > Some(until)
        });
    };
    assert_eq!(daemon.http("POST", "/api/v1/scene", &[], r#"{"scene": "other"}"#).0 / 100, 2);
    stays("switched", 1);
    assert_eq!(
        (&parameter(&daemon)["value"], &parameter(&daemon)["scene"]),
        (&json!(0.7), &json!(1.8))
    );
    // Parameters only, and then so that it is baked anew.
    scene_file(
        &daemon.folder,
        "other.toml",
        "[contact]\nstiffness_n_per_mm3 = 0.75\n[limits]\nforce_n = 1.8\n",
    );
    daemon.wait_for("reload: contact_stiffness_n_per_m");
    stays("read again", 1);
    scene_file(
        &daemon.folder,
        "other.toml",
        "[contact]\nstiffness_n_per_mm3 = 0.75\n[limits]\nforce_n = 2.5\n",
    );
    stays("baked again", 2);
    assert_eq!(
        (&parameter(&daemon)["value"], &parameter(&daemon)["scene"]),
        (&json!(0.7), &json!(2.5))
    );
    client.does(json!({ "do": "set", "parameter": "limit_force_n", "value": 1.2 }));
    client.state_where(|state| (force(state) - 1.2).abs() < 1e-9);
    let folder = daemon.folder.path().to_owned();
    let (status, _) = daemon.http("POST", "/api/v1/stop", &[], "");
    assert_eq!(status, 200);
    let ended = daemon.ended();
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    // The limits of a scene that took over are in what entered its ticks.
    let replayed = std::process::Command::new(env!("CARGO_BIN_EXE_hapticd"))
        .args(["replay", "run.mcap", "--cache", "off"])
        .current_dir(&folder)
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&replayed.stdout);
    assert!(
        replayed.status.success() && said.contains("bit-identical"),
        "{said}{}",
        String::from_utf8_lossy(&replayed.stderr)
    );
}

#[test]
fn a_scene_that_is_refused_when_it_is_read_again_is_reported_with_the_reason() {
    let mut daemon = Daemon::start("", "--watch");
    daemon.wait_for("state: enabled");
    let mut client = daemon.connect();
    scene_file(&daemon.folder, "press.toml", "[contact]\nstiffness_n_per_mm3 = -2.0\n");
    let event = client.event("scene", "refused");
    assert_eq!(event["names"], json!(["refused", "press"]));
    assert!(event["text"].as_str().unwrap().contains("contact.stiffness_n_per_mm3"), "{event}");
    assert!(event["tick"].as_u64() > Some(0), "{event}");
}

#[test]
fn after_a_fault_the_run_waits_for_a_client_to_enable() {
    let mut daemon = Daemon::start("[device.sim]\nfault = \"stall@700ms+300ms\"\n", "");
    let mut client = daemon.connect();
    let event = client.event("fault", "");
    assert!(
        !event["text"].as_str().unwrap().is_empty() && event["tick"].as_u64() > Some(0),
        "{event}"
    );
    client.subscribe(1000.0);
    let state = client.state_where(|state| state["state"] == "FAULT");
    assert_eq!(length(&state["servo_cf"]["f"]), 0.0);
    assert_eq!(state["faults"], event["names"]);
    // The arm sends nothing yet: a client that enables too early gets the same fault again.
    loop {
        client.does(json!({ "do": "enable" }));
        let state = client.state_where(|state| {
            matches!(state["phase"].as_str(), Some("enabled" | "fault"))
                && state["tick"].as_u64() > event["tick"].as_u64().map(|tick| tick + 100)
        });
        if state["phase"] == "enabled" {
            break;
        }
    }
    let Ended { code, json, .. } = {
        daemon.http("POST", "/api/v1/stop", &[], "");
        daemon.ended()
    };
    assert_eq!(code, Some(7), "a fault happened");
    assert!(!json["faults"].as_array().unwrap().is_empty());
}

#[test]
fn a_client_begins_and_ends_a_recording() {
    let daemon = Daemon::enabled("", "");
    let mut client = daemon.connect();
    assert_eq!(daemon.get("/api/v1/info")["recording"], Value::Null);
    assert_eq!(client.ask(json!({ "do": "end_recording" }))["status"], 409);
    for name in ["../session.mcap", "/tmp/session.mcap", "", ".mcap", "a/b.mcap"] {
        assert_eq!(client.ask(json!({ "do": "record", "file": name }))["status"], 400, "{name}");
    }
    let begun = client.ask(json!({ "do": "record", "file": "session" }));
    let file = begun["recording"]["file"].as_str().unwrap().to_owned();
    assert!(file.ends_with("/session.mcap"), "{begun}");
    assert_eq!(client.event("recording", "begun")["names"], json!(["begun", file]));
    assert_eq!(client.ask(json!({ "do": "record" }))["status"], 409);
    client.subscribe(1000.0);
    let from = client.state()["tick"].as_u64().unwrap();
    client.state_where(|state| state["tick"].as_u64() > Some(from + 300));
    let recording = &daemon.get("/api/v1/info")["recording"];
    assert!(recording["records"].as_u64() > Some(100), "{recording}");
    let (status, ended) = daemon.http("DELETE", "/api/v1/recording", &[], "");
    assert_eq!((status, ended["recording"]["file"].as_str()), (200, Some(&file[..])));
    assert!(ended["recording"]["records"].as_u64() > Some(100), "{ended}");
    assert_eq!(client.event("recording", "ended")["names"], json!(["ended", file]));
    assert_eq!(daemon.get("/api/v1/info")["recording"], Value::Null);
    let written = std::fs::read(recording["file"].as_str().unwrap()).unwrap();
    assert!(written.starts_with(b"\x89MCAP0\r\n") && written.ends_with(b"\x89MCAP0\r\n"));
    assert_eq!(
        client.ask(json!({ "do": "record", "file": "session.mcap" }))["status"],
        409,
        "never over a file that is there"
    );
    no_record_lost(&daemon.end());
}

#[test]
fn figures_are_there() {
    let daemon = Daemon::enabled("", "");
    let (status, answer) = http(daemon.address, "GET", "/metrics", &[], b"").unwrap();
    let answer = String::from_utf8_lossy(&answer);
    assert!(status == 200 && answer.contains("\nhapticd_ticks_total "), "{status} {answer}");
}
