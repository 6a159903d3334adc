//! A client that drives and falls silent takes the force with it.

use serde_json::{Value, json};

use super::{Daemon, command, folder, length};

fn off(state: &Value) -> bool {
    state["state"] == "DISABLED" && length(&state["servo_cf"]["f"]) == 0.0
}

#[test]
fn silence_and_a_closed_connection_end_with_zero_force() {
    let daemon = Daemon::enabled("", "");
    let mut watcher = daemon.connect();
    watcher.subscribe(1000.0);
    for is_closed in [false, true] {
        let mut driver = daemon.connect();
        driver.does(json!({ "do": "enable" }));
        watcher.state_where(|state| state["phase"] == "enabled");
        let timeout_ms = if is_closed { 10_000 } else { 100 };
        driver.does(json!({ "do": "heartbeat", "timeout_ms": timeout_ms }));
        if is_closed {
            drop(driver);
        }
        let event = watcher.event("heartbeat", "");
        assert!(event["text"].as_str().unwrap().contains("force off"), "{event}");
        let state = watcher.state_where(off);
        assert_eq!(state["off_cause"], "heartbeat");
        assert!(state["advice"].as_str().unwrap().contains("silent"), "{state}");
    }
    // A client that signs off is not missed.
    let mut driver = daemon.connect();
    driver.does(json!({ "do": "enable" }));
    driver.does(json!({ "do": "heartbeat", "timeout_ms": 5000 }));
    watcher.state_where(|state| state["phase"] == "enabled");
    driver.does(json!({ "do": "heartbeat", "timeout_ms": 0 }));
    drop(driver);
    watcher.does(json!({ "do": "ping" }));
    let tick = watcher.state()["tick"].as_u64().unwrap();
    let later = watcher.state_where(|state| state["tick"].as_u64() > Some(tick + 300));
    assert_eq!(later["phase"], "enabled");
    for wrong in [1.0, 1e9, -5.0] {
        assert_eq!(watcher.ask(json!({ "do": "heartbeat", "timeout_ms": wrong }))["status"], 400);
    }
}

#[test]
fn a_client_that_was_silent_once_guards_again() {
    let daemon = Daemon::enabled("", "");
    let mut watcher = daemon.connect();
    watcher.subscribe(1000.0);
    let mut driver = daemon.connect();
    driver.does(json!({ "do": "heartbeat", "timeout_ms": 500 }));
    watcher.event("heartbeat", "");
    watcher.state_where(off);
    // Its next word, whatever it is, and it is on guard as before.
    driver.does(json!({ "do": "ping" }));
    driver.does(json!({ "do": "enable" }));
    while watcher.state()["phase"] != "enabled" {
        driver.does(json!({ "do": "ping" }));
    }
    drop(driver);
    watcher.event("heartbeat", "");
    let state = watcher.state_where(off);
    assert_eq!((&state["off_cause"], &state["last_fault"]), (&"heartbeat".into(), &Value::Null));
}

#[test]
fn a_silence_does_not_hide_that_there_was_a_fault() {
    let daemon = Daemon::start("[device.sim]\nfault = \"nan@700ms+100ms\"\n", "");
    let mut watcher = daemon.connect();
    let mut driver = daemon.connect();
    driver.does(json!({ "do": "heartbeat", "timeout_ms": 10_000 }));
    let fault = watcher.event("fault", "");
    drop(driver);
    watcher.subscribe(1000.0);
    let state = watcher.state_where(off);
    assert_eq!(state["faults"], json!([]), "the silence acknowledged it");
    let expected =
        json!({ "tick": fault["tick"], "time_ns": fault["time_ns"], "names": fault["names"] });
    assert_eq!(state["last_fault"], expected);
    assert_ne!(state["off_cause"], "heartbeat", "the fault took the force, not the silence");
    watcher.state_where(|state| state["time_ns"].as_i64() > Some(900_000_000));
    watcher.does(json!({ "do": "enable" }));
    watcher.state_where(|state| state["state"] == "ENABLED" && state["last_fault"].is_null());
}

#[test]
fn a_scene_that_wants_a_heartbeat_has_no_force_without() {
    let mut daemon = Daemon::start("[safety]\nheartbeat_ms = 300\n", "");
    let mut client = daemon.connect();
    client.subscribe(1000.0);
    // A simulated arm, and still no client has enabled it.
    let state = client.state_where(|state| state["tick"].as_u64() > Some(200));
    assert!(off(&state), "{state}");
    let reply = client.ask(json!({ "do": "enable" }));
    assert_eq!(
        (&reply["status"], reply["error"].as_str().unwrap().contains("heartbeat")),
        (&409.into(), true),
        "{reply}"
    );
    assert_eq!(daemon.http("POST", "/api/v1/enable", &[], "").0, 409);
    // Longer than the scene allows: the scene wins.
    client.does(json!({ "do": "heartbeat", "timeout_ms": 10_000 }));
    client.does(json!({ "do": "enable" }));
    daemon.wait_for("state: enabling");
    let mut other = daemon.connect();
    assert_eq!(
        other.ask(json!({ "do": "enable" }))["status"],
        409,
        "another client beats, not this one"
    );
    client.event("heartbeat", "");
    client.state_where(off);
    assert_eq!(daemon.end().code, Some(0));

    let folder = folder("[safety]\nheartbeat_ms = 300\n");
    let refused = command(folder.path(), "press.toml --monitor off").output().unwrap();
    assert_eq!(refused.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&refused.stderr).contains("heartbeat"));
}

#[test]
fn an_enable_from_elsewhere_does_not_last_without_a_heartbeat() {
    use std::io::Write as _;
    use std::process::Stdio;
    use std::sync::mpsc::{RecvError, RecvTimeoutError};
    use std::time::Duration;
    let folder = folder("[safety]\nheartbeat_ms = 300\n");
    let line = "press.toml --json --realtime best-effort --monitor 127.0.0.1:0 --console";
    let mut child = command(folder.path(), line)
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut stdin = child.stdin.take().unwrap();
    let lines = std::io::BufReader::new(child.stderr.take().unwrap());
    let mut states = Vec::new();
    let (orders, to_write) = std::sync::mpsc::channel::<&[u8]>();
    // A lapse takes back an enable that was asked for just before it, so it is asked for again
    // until it was seen.
    let writer = std::thread::spawn(move || {
        let mut order = to_write.recv();
        while let Ok(text) = order {
            if stdin.write_all(text).is_err() {
                return;
            }
            order = match to_write.recv_timeout(Duration::from_secs(1)) {
                Err(RecvTimeoutError::Timeout) => Ok(text),
                other => other.map_err(|_| RecvError),
            };
        }
    });
    for line in std::io::BufRead::lines(lines).map_while(Result::ok) {
        if let Some(state) = line.strip_prefix("state: ") {
            states.push(state.to_owned());
            match (state, states.len()) {
                ("disabled", 2) => orders.send(b"enable\n").unwrap(),
                ("disabled", n) if n > 2 => orders.send(b"stop\n").unwrap(),
                _ => {}
            }
        }
    }
    drop(orders);
    writer.join().unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(0));
    assert!(
        states.contains(&"enabling".to_owned()) && !states.contains(&"enabled".to_owned()),
        "{states:?}"
    );
}
