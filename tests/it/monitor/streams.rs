//! States and events as they stream, facts as they are asked for.

use std::time::Duration;

use serde_json::json;
use tokio_tungstenite::tungstenite::Message;

use super::{Client, Daemon, http, length, no_record_lost};

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn a_client_at_full_rate_sees_every_tick_or_hears_how_many_it_did_not() {
    let daemon = Daemon::enabled("", "");
    let mut client = daemon.connect();
    client.subscribe(1000.0);
    let first = client.state();
    let (mut tick, mut seq, mut dropped) = (
        first["tick"].as_u64().unwrap(),
        first["seq"].as_u64().unwrap(),
        first["dropped"].as_u64().unwrap(),
    );
    for _ in 0..500 {
        let state = client.state();
        let lost = state["dropped"].as_u64().unwrap() - dropped;
        assert_eq!(state["tick"].as_u64().unwrap(), tick + 1 + lost, "{state}");
        assert_eq!(state["seq"].as_u64().unwrap(), seq + 1);
        (tick, seq, dropped) = (tick + 1 + lost, seq + 1, dropped + lost);
        // One row for every tick since the last message.
        assert!(!state["history"].as_array().unwrap().is_empty());
    }
    // Pressed on the plate: what the hand feels, where it touches, and where the arm is behind the
    // tool.
    let state = client.state_where(|state| {
        state["contacts"].as_u64() > Some(0) && length(&state["measured_cf"]["f"]) > 0.1
    });
    assert_eq!(
        (state["state"].as_str(), state["phase"].as_str()),
        (Some("ENABLED"), Some("enabled"))
    );
    assert!(state["max_depth_m"].as_f64().unwrap() > 0.0);
    assert!(state["contact_cf"]["f"][2].as_f64().unwrap() > 0.0, "up, out of the plate: {state}");
    let [tool_z, device_z] =
        ["tool_cp", "device_cp_world"].map(|key| state[key]["p"][2].as_f64().unwrap());
    assert!(device_z < tool_z, "the arm is pressed in deeper than the tool goes: {state}");
    assert_eq!(
        state["objects"],
        json!([{ "idx": 0, "p": [0.0, 0.0, -0.01], "q": [0.0, 0.0, 0.0, 1.0] }])
    );
    let ended = daemon.end();
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    no_record_lost(&ended);
    assert_eq!(client.close_code(), Some(1001), "a good-bye at the end of the run");
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn who_reads_late_hears_the_good_bye_too() {
    let mut daemon = Daemon::enabled("", "");
    let mut slow = daemon.connect();
    slow.does(json!({ "do": "subscribe", "rate_hz": 1000, "contacts": true }));
    // The kernel's buffers fill: what comes after them waits in the server.
    std::thread::sleep(Duration::from_secs(3));
    assert_eq!(daemon.http("POST", "/api/v1/stop", &[], "").0, 200);
    let mut is_reported = false;
    let mut code = None;
    while let Ok(message) = slow.socket.read() {
        match message {
            Message::Text(text) => {
                is_reported |= text.contains("\"event\":\"state\"") && text.contains("stopped")
            }
            Message::Close(frame) => code = frame.map(|frame| u16::from(frame.code)),
            _ => {}
        }
        std::thread::sleep(Duration::from_millis(8));
    }
    assert_eq!((is_reported, code), (true, Some(1001)));
    assert_eq!(daemon.ended().code, Some(0));
}

#[test]
fn a_slower_client_gets_the_newest_state_and_the_points_that_touch() {
    let daemon = Daemon::enabled("", "");
    let mut client = daemon.connect();
    client.does(json!({ "do": "subscribe", "rate_hz": 50, "contacts": true }));
    let ticks: Vec<u64> = (0..20).map(|_| client.state()["tick"].as_u64().unwrap()).collect();
    let event = json!({ "do": "set", "parameter": "contact_stiffness_n_per_m", "value": 4000 });
    client.does(event);
    assert!(client.event("parameter", "")["tick"].as_u64() >= ticks.last().copied());
    assert!(ticks.windows(2).skip(1).all(|pair| pair[1] - pair[0] >= 20), "{ticks:?}");
    let state = client
        .state_where(|state| state["points"].as_array().is_some_and(|points| !points.is_empty()));
    for point in state["points"].as_array().unwrap() {
        let [x, y, z, depth_m] = [0, 1, 2, 3].map(|n| point[n].as_f64().unwrap());
        assert!(x.abs() < 0.0105 && y.abs() < 0.0105 && z.abs() < 3e-3 && depth_m > 0.0, "{point}");
    }
    client.does(json!({ "do": "subscribe", "rate_hz": 0 }));
    let mut other = daemon.connect();
    other.subscribe(100.0);
    let tick = other.state()["tick"].as_u64().unwrap();
    other.state_where(|state| state["tick"].as_u64() > Some(tick + 400));
    client.send(&json!({ "id": "after", "do": "ping" }));
    let mut late = 0;
    loop {
        match client.json() {
            message if message["id"] == "after" => break,
            message => late += usize::from(message["type"] == "state"),
        }
    }
    assert!(late <= 3, "{late} states after the end of the stream: more than were under way");
    assert_eq!(client.ask(json!({ "do": "subscribe", "rate_hz": 5000 }))["status"], 400);
}

#[test]
fn binary_states_say_the_same() {
    let daemon = Daemon::enabled("", "");
    let mut client = daemon.connect();
    client.does(json!({ "do": "subscribe", "rate_hz": 200, "format": "binary" }));
    let mut last_tick = 0;
    for n in 1..50 {
        let bytes = loop {
            if let Message::Binary(bytes) = client.socket.read().unwrap() {
                break bytes;
            }
        };
        let u64_at = |at: usize| u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap());
        assert_eq!((bytes.len(), &bytes[..4]), (344, &b"HSTA"[..]));
        assert_eq!(u64_at(24), n, "seq");
        assert!(u64_at(8) > last_tick);
        last_tick = u64_at(8);
        assert_eq!(bytes[40] & 3, 1, "ENABLED");
        assert!((f64::from_bits(u64_at(48 + 6 * 8)).abs() - 1.0).abs() < 0.1, "qw of measured_cp");
    }
}

#[test]
fn facts_scene_and_meshes_are_there_to_draw() {
    let daemon = Daemon::enabled("", "");
    let info = daemon.get("/api/v1/info");
    assert_eq!(
        (&info["api"], &info["rate_hz"], &info["clock"]),
        (&1.into(), &1000.into(), &"real".into())
    );
    assert_eq!(
        (&info["device"]["profile"], &info["device"]["simulated"]),
        (&"sim-sigma7".into(), &true.into())
    );
    assert!(info["realtime"].as_array().unwrap().len() > 3);
    let scene = daemon.get("/api/v1/scene");
    let names: Vec<_> = scene["objects"]
        .as_array()
        .unwrap()
        .iter()
        .map(|object| object["name"].as_str().unwrap())
        .collect();
    assert_eq!((names, &scene["movable"]), (vec!["plate", "tool"], &json!(["plate"])));
    assert_eq!(scene["bounds"]["min"][2].as_f64().map(|z| (z * 1e3).round()), Some(-20.0));
    let (status, mesh) =
        http(daemon.address, "GET", scene["objects"][1]["mesh"].as_str().unwrap(), &[], b"")
            .unwrap();
    let word = |at: usize| u32::from_le_bytes(mesh[at..at + 4].try_into().unwrap()) as usize;
    assert_eq!(
        (status, &mesh[..4], mesh.len()),
        (200, &b"HMSH"[..], 16 + 12 * word(8) + 4 * word(12))
    );
    for structure in ["voxels", "pointshell"] {
        let (status, faces) =
            http(daemon.address, "GET", scene["objects"][1][structure].as_str().unwrap(), &[], b"")
                .unwrap();
        let word = |at: usize| u32::from_le_bytes(faces[at..at + 4].try_into().unwrap()) as usize;
        assert_eq!(
            (status, &faces[..4], faces.len()),
            (200, &b"HVPS"[..], 24 + 16 * word(8)),
            "{structure}"
        );
        assert!(word(8) > 500 && word(12) > 500, "{structure}: {} of {}", word(8), word(12));
    }
    for (path, expected) in [
        ("/", 200),
        ("/api/v1/scene/0/voxels/2", 404),
        ("/api/v1/scene/1/pointshell/0", 404),
        ("/api/v1/state", 200),
        ("/api/v1/scenes", 200),
        ("/api/v1/scene/0/mesh/2", 404),
        ("/api/v1/scene/1/mesh/0", 404),
        ("/api/v1/nothing", 404),
        ("/web/../Cargo.toml", 404),
        ("/favicon.ico", 204),
        ("/api/v1/ws", 400),
    ] {
        assert_eq!(daemon.http("GET", path, &[], "").0, expected, "{path}");
    }
    assert_eq!(daemon.http("DELETE", "/api/v1/info", &[], "").0, 405);
    assert_eq!(daemon.get("/api/v1/scenes"), json!(["press"]));
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn a_million_triangles_are_shown_as_a_hundred_thousand() {
    // A grid of 708 by 708 squares, a gentle wave.
    let folder = super::folder("");
    let n = 709;
    let mut text = String::new();
    for (row, column) in (0..n * n).map(|at| (at / n, at % n)) {
        let height = 0.5 * (f64::from(row) * 0.05).sin();
        text += &format!("v {} {} {height}\n", f64::from(column) * 0.1, f64::from(row) * 0.1);
    }
    for (row, column) in (0..(n - 1) * (n - 1)).map(|at| (at / (n - 1), at % (n - 1))) {
        let corner = row * n + column + 1;
        text += &format!(
            "f {} {} {}\nf {} {} {}\n",
            corner,
            corner + 1,
            corner + n,
            corner + 1,
            corner + n + 1,
            corner + n
        );
    }
    std::fs::write(folder.path().join("wave.obj"), text).unwrap();
    let scene = super::SCENE.replace(
        "shape = { box_mm = [60.0, 60.0, 20.0] }",
        "mesh = \"wave.obj\"\nunits = \"mm\"\nsides = \"thin\"",
    );
    std::fs::write(
        folder.path().join("press.toml"),
        scene.replace("[0, 0, -10]", "[-35, -35, -10]"),
    )
    .unwrap();
    let mut daemon = Daemon::of(folder, "", &[]);
    daemon.wait_for("state: enabled");
    let object = &daemon.get("/api/v1/scene")["objects"][0];
    let [triangles, shown] =
        ["triangles", "shown_triangles"].map(|key| object[key].as_u64().unwrap());
    assert!(triangles > 1_000_000 && shown <= 100_000 && shown > 20_000, "{triangles} {shown}");
}

#[test]
fn clients_are_served_while_the_scene_is_baked_and_hear_when_it_is_rendered() {
    let folder = super::folder("");
    // Fine enough to take a moment.
    let scene = super::SCENE.replace("voxel_size_mm = 2.0\nlayers", "voxel_size_mm = 0.2\nlayers");
    std::fs::write(folder.path().join("press.toml"), scene).unwrap();
    let mut daemon = Daemon::of(folder, "--cache off", &[]);
    let mut client = daemon.connect();
    if daemon.http("GET", "/api/v1/scene", &[], "").0 == 503 {
        for request in [
            json!({ "do": "enable" }),
            json!({ "do": "set", "parameter": "limit_force_n", "value": 1 }),
        ] {
            let reply = client.ask(request.clone());
            assert!(
                reply["ok"] == false && reply["error"].as_str().unwrap().contains("baked")
                    || reply["ok"] == true,
                "{request}: {reply}"
            );
        }
        client.event("scene", "rendered");
    }
    daemon.wait_for("state: enabled");
    assert_eq!(daemon.http("GET", "/api/v1/scene", &[], "").0, 200);
}

#[test]
fn a_run_under_the_virtual_clock_can_be_watched_too() {
    let daemon = Daemon::start("", "--clock virtual");
    let mut client = Client::connect(daemon.address, "", &[]).unwrap();
    client.subscribe(100.0);
    let first = client.state()["tick"].as_u64().unwrap();
    assert!(client.state()["tick"].as_u64().unwrap() > first);
    assert_eq!(daemon.end().code, Some(0));
}
