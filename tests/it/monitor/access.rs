//! Which clients have access, and at which address.

use std::net::TcpListener;
use std::time::{Duration, Instant};

use super::{Client, Daemon, HUNG, SCENE, command, command_to, folder};

const TOKEN: &str = "0123456789abcdef0123456789abcdef";

#[test]
fn other_pages_and_bent_names_stay_out() {
    let daemon = Daemon::enabled("[monitor]\norigins = [\"http://lab.example:8000\"]\n", "");
    let own = format!("http://{}", daemon.address);
    for (headers, expected) in [
        (vec![("Origin", own.as_str())], 200),
        (vec![("Origin", "http://evil.example")], 403),
        (vec![("Origin", "null")], 403),
        (vec![("Host", "evil.example")], 403),
        (vec![("Host", "evil.example"), ("Origin", "http://evil.example")], 403),
        (vec![("Host", "localhost:7878")], 200),
    ] {
        let (status, body) = daemon.http("GET", "/api/v1/info", &headers, "");
        assert_eq!(status, expected, "{headers:?}: {body}");
        assert!(status == 200 || body["error"].is_string() && body["hint"].is_string(), "{body}");
    }
    assert_eq!(
        daemon.http("POST", "/api/v1/stop", &[("Origin", "http://evil.example")], "").0,
        403
    );
    let connect =
        |headers: &[(&str, &str)]| Client::connect(daemon.address, "", headers).map(|_| ());
    assert_eq!(connect(&[("Origin", "http://evil.example")]), Err("403".to_owned()));
    assert_eq!(connect(&[("Host", "evil.example")]), Err("403".to_owned()));
    assert_eq!(connect(&[("Origin", &own)]), Ok(()));
    assert_eq!(connect(&[("Origin", "http://lab.example:8000")]), Ok(()));
    assert_eq!(daemon.end().code, Some(0));
}

#[test]
fn with_a_token_only_who_knows_it_comes_in() {
    let folder = folder("");
    std::fs::write(folder.path().join("token"), format!("{TOKEN}\n")).unwrap();
    let daemon = Daemon::of(folder, "--monitor-token token", &[]);
    assert_eq!(daemon.http("GET", "/", &[], "").0, 200, "the page holds no secret");
    let with = |token: &str| {
        daemon.http("GET", "/api/v1/info", &[("Authorization", &format!("Bearer {token}"))], "").0
    };
    assert_eq!((with(TOKEN), with(&TOKEN[1..]), with("")), (200, 401, 401));
    for (method, path) in [
        ("GET", "/api/v1/info"),
        ("GET", "/metrics"),
        ("POST", "/api/v1/enable"),
        ("GET", "/api/v1/scene/0/mesh/0"),
    ] {
        let (status, body) = daemon.http(method, path, &[], "");
        assert!(
            status == 401 && body["hint"].as_str().unwrap().contains("Bearer"),
            "{path}: {body}"
        );
    }
    // Off takes none, but for pages of other servers.
    let disable = |headers: &[(&str, &str)]| daemon.http("POST", "/api/v1/disable", headers, "").0;
    assert_eq!(disable(&[]), 200);
    assert_eq!(disable(&[("Authorization", "Bearer wrong")]), 200);
    assert_eq!(disable(&[("Origin", "http://evil.example")]), 403);
    assert_eq!(disable(&[("Host", "evil.example")]), 403);
    let connect = |query: &str| Client::connect(daemon.address, query, &[]).map(|_| ());
    assert_eq!(connect(""), Err("401".to_owned()));
    assert_eq!(connect("?token=wrong"), Err("401".to_owned()));
    assert_eq!(connect(&format!("?token={TOKEN}")), Ok(()));
    drop(daemon);

    // The same from the environment and from the scene.
    let daemon = Daemon::of(super::folder(""), "", &[("HAPTICD_TOKEN", TOKEN)]);
    assert_eq!(daemon.http("GET", "/api/v1/info", &[], "").0, 401);
    let folder = super::folder("[monitor]\ntoken_file = \"token\"\n");
    std::fs::write(folder.path().join("token"), TOKEN).unwrap();
    let daemon = Daemon::of(folder, "", &[]);
    assert_eq!(daemon.http("GET", "/api/v1/info", &[], "").0, 401);
}

#[test]
fn a_run_on_a_real_arm_has_a_token() {
    let folder = folder("");
    let real = SCENE.replace("\"sim-sigma7\"\nhand = \"hand.csv\"", "\"open6-serial\"");
    std::fs::write(folder.path().join("press.toml"), real).unwrap();
    let arm = folder.path().join("arm");
    // The arm is not there yet. The token is printed to the quiet, too: they could not enable.
    let line = format!("press.toml -q --monitor 127.0.0.1:0 --selector {}", arm.display());
    let ended = command(folder.path(), &line).output().unwrap();
    let said = String::from_utf8_lossy(&ended.stderr);
    assert!(
        ended.status.code() == Some(5)
            && said.starts_with("monitor: http://127.0.0.1:")
            && said.contains("/#token="),
        "{said}"
    );
    let mut mock =
        command_to("mock", folder.path(), "open6-serial --pty arm --no-hand --duration 90s")
            .spawn()
            .unwrap();
    let began = Instant::now();
    while !arm.exists() {
        assert!(began.elapsed() < HUNG, "the mock arm does not start");
        std::thread::sleep(Duration::from_millis(5));
    }
    let mut daemon = Daemon::of(folder, &format!("--selector {}", arm.display()), &[]);
    let token = daemon.token.clone().expect("it is printed");
    daemon.wait_for("state: disabled");
    let bearer = format!("Bearer {token}");
    for (path, headers, expected) in [
        ("enable", &[][..], 401),
        ("enable", &[("Authorization", "Bearer 0123456789abcdef")], 401),
        ("enable", &[("Authorization", &bearer[..])], 200),
        ("disable", &[], 200),
        ("stop", &[], 200),
    ] {
        let (status, body) = daemon.http("POST", &format!("/api/v1/{path}"), headers, "");
        assert_eq!(status, expected, "{path}: {body}");
    }
    let ended = daemon.ended();
    assert!(ended.json["ticks"].as_u64() > Some(0), "{}", ended.stderr);
    // Gone already, where the run took it along.
    let _ = mock.kill();
    mock.wait().unwrap();
}

#[test]
fn other_machines_need_a_token_and_a_port_that_is_taken_is_said() {
    let folder = folder("");
    let run = |line: &str| {
        let ended = command(folder.path(), line).output().unwrap();
        (ended.status.code(), String::from_utf8_lossy(&ended.stderr).into_owned())
    };
    let (code, said) = run("press.toml --monitor 0.0.0.0:0");
    assert!(code == Some(2) && said.contains("--monitor-token"), "{said}");
    std::fs::write(folder.path().join("short"), "short").unwrap();
    let (code, said) = run("press.toml --monitor 0.0.0.0:0 --monitor-token short");
    assert!(code == Some(2) && said.contains("16 to 512"), "{said}");
    let (code, said) = run("press.toml --monitor 0.0.0.0:0 --monitor-token none");
    assert!(code == Some(2) && said.contains("cannot read"), "{said}");
    let (code, said) = run("press.toml --monitor 7878");
    assert!(code == Some(2) && said.contains("127.0.0.1:7878"), "{said}");

    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap();
    let (code, said) = run(&format!("press.toml --monitor {address}"));
    assert!(
        code == Some(2) && said.contains("cannot listen") && said.contains("127.0.0.1:0"),
        "{said}"
    );
    // Of the scene it is a wish.
    std::fs::write(
        folder.path().join("busy.toml"),
        format!("{}[monitor]\nlisten = \"{address}\"\n", super::SCENE),
    )
    .unwrap();
    let (code, said) = run("busy.toml --duration 100ms --realtime best-effort");
    assert!(code == Some(0) && said.contains("warning: no monitor: cannot listen"), "{said}");
    // Under the virtual clock there is none unless it is asked for.
    let (code, said) = run("busy.toml --duration 100ms --clock virtual");
    assert!(code == Some(0) && !said.contains("monitor"), "{said}");
    let wide = format!("{}[monitor]\nlisten = \"0.0.0.0:0\"\n", super::SCENE);
    std::fs::write(folder.path().join("wide.toml"), wide).unwrap();
    let (code, said) = run("wide.toml --duration 100ms --realtime best-effort");
    assert!(code == Some(3) && said.contains("token"), "{said}");
}
