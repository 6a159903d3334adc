//! Clients that do not behave: each is answered as documented, and the loop does not notice.

use std::io::{Read as _, Write as _};
use std::net::{SocketAddr, TcpStream};
use std::time::{Duration, Instant};

use rt::control::Order;
use serde_json::json;
use tokio_tungstenite::tungstenite::Message;

use super::off::Server;
use super::{Client, Daemon, HUNG, http, no_record_lost};

#[test]
fn what_is_no_request_is_refused_in_words() {
    let daemon = Daemon::enabled("", "");
    let mut client = daemon.connect();
    for (text, word) in [
        ("", "JSON"),
        ("\u{0}", "JSON"),
        ("[]", "object"),
        ("{\"do\":\"explode\"}", "explode"),
        ("{\"do\":\"set\",\"parameter\":\"x\",\"value\":1,\"force\":9}", "force"),
        (
            "{\"do\":\"place\",\"object\":\"plate\",\"pose\":{\"p\":[1,2],\"q\":[0,0,0,1]}}",
            "length",
        ),
    ] {
        client.socket.send(Message::from(text)).unwrap();
        let reply = client.json();
        assert_eq!(
            (reply["type"].as_str(), reply["ok"].as_bool()),
            (Some("reply"), Some(false)),
            "{text}: {reply}"
        );
        assert!(reply["error"].as_str().unwrap().contains(word), "{text}: {reply}");
    }
    client.socket.send(Message::from("[".repeat(60_000))).unwrap();
    assert_eq!(client.json()["ok"], false, "deep nesting is no request either");
    client.does(json!({ "do": "ping" }));
    client.socket.send(Message::from(vec![0_u8; 10])).unwrap();
    assert_eq!(client.close_code(), Some(1003));
    no_record_lost(&daemon.end());
}

#[test]
fn too_much_at_once_is_refused() {
    let daemon = Daemon::enabled("", "");
    let mut client = daemon.connect();
    client.socket.send(Message::from(vec![b' '; 65_536])).err();
    client.socket.send(Message::from("x".repeat(300_000))).err();
    assert_eq!(client.close_code(), Some(1003), "binary comes first");
    let mut client = daemon.connect();
    client.socket.send(Message::from("x".repeat(300_000))).unwrap();
    assert_eq!(client.close_code(), Some(1009));
    let body = vec![b' '; 100_000];
    let (status, _) = http(daemon.address, "PUT", "/api/v1/parameters/x", &[], &body).unwrap();
    assert_eq!(status, 413);
    let (_, answer) = daemon.http("PUT", "/api/v1/parameters/x", &[], &" ".repeat(100_000));
    assert!(answer["error"].as_str().unwrap().contains("65536"), "{answer}");
    let long = format!("/api/v1/parameters/{}", "x".repeat(5000));
    assert_eq!(http(daemon.address, "GET", &long, &[], b"").unwrap().0, 414);
    no_record_lost(&daemon.end());
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn garbage_on_the_wire_ends_that_connection_only() {
    let daemon = Daemon::enabled("", "");
    let mut seed = 1_u64;
    let mut random = || {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (seed >> 33) as u8
    };
    for _ in 0..40 {
        // Instead of a request, and behind a proper handshake.
        let mut raw = TcpStream::connect(daemon.address).unwrap();
        raw.set_read_timeout(Some(HUNG)).unwrap();
        let noise: Vec<u8> = (0..200).map(|_| random()).collect();
        let _ = raw.write_all(&noise);
        let _ = raw.shutdown(std::net::Shutdown::Write);
        let _ = raw.read_to_end(&mut Vec::new());
        let mut client = daemon.connect();
        let _ = client.socket.get_mut().write_all(&noise);
        let _ = client.socket.get_mut().shutdown(std::net::Shutdown::Write);
        client.close_code();
    }
    // Half a request, and half a frame, that never go on.
    let mut half = TcpStream::connect(daemon.address).unwrap();
    half.write_all(b"GET / HTTP/1.1\r\nHost: ").unwrap();
    let mut client = daemon.connect();
    client.socket.get_mut().write_all(&[0x81, 0xFE]).unwrap();
    assert_eq!(daemon.http("GET", "/api/v1/info", &[], "").0, 200);
    no_record_lost(&daemon.end());
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn who_never_reads_is_let_go_and_who_reads_goes_on() {
    let daemon = Daemon::enabled("", "");
    let mut deaf = daemon.connect();
    deaf.subscribe(1000.0);
    let mut client = daemon.connect();
    client.subscribe(1000.0);
    let from = client.state()["tick"].as_u64().unwrap();
    // The kernel's buffers, then five seconds of patience.
    client.state_where(|state| state["tick"].as_u64() > Some(from + 12_000));
    deaf.socket.get_mut().set_nonblocking(false).unwrap();
    assert_eq!(deaf.close_code(), None, "closed without a good-bye: it would not have been read");
    no_record_lost(&daemon.end());
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn a_flood_of_requests_is_answered_in_turn() {
    let daemon = Daemon::enabled("", "");
    let mut client = daemon.connect();
    for n in 0..500 {
        let value = 4000 + n % 2;
        client.send(&json!({ "id": n, "do": "set", "parameter": "contact_stiffness_n_per_m", "value": value }));
    }
    let mut answered = std::collections::HashSet::new();
    let mut taken = Vec::new();
    while answered.len() < 500 {
        let message = client.json();
        if message["type"] == "reply" {
            let id = message["id"].as_u64().unwrap();
            assert!(answered.insert(id), "{message}");
            assert!(message["ok"] == true || message["status"] == 429, "{message}");
            if message["ok"] == true {
                taken.push(id);
            }
        }
    }
    assert!(!taken.is_empty() && taken.is_sorted(), "{taken:?}");
    let mut statuses: Vec<u16> = Vec::new();
    for _ in 0..1500 {
        statuses.push(
            http(daemon.address, "GET", "/api/v1/parameters", &[], b"")
                .map_or(0, |answer| answer.0),
        );
    }
    assert!(statuses.iter().all(|status| matches!(status, 200 | 429 | 503)), "{statuses:?}");
    assert_eq!(
        daemon.http("POST", "/api/v1/disable", &[], "").0,
        200,
        "what switches force off is always done"
    );
    no_record_lost(&daemon.end());
}

#[test]
fn requests_that_wait_for_an_answer_are_counted_and_what_takes_force_away_is_not_among_them() {
    let server = Server::new(None);
    let permit = server.control.permit();
    let mut client = server.connect();
    for id in 0..200 {
        client.send(&json!({ "id": id, "do": "record" }));
    }
    for (id, what) in (200..).zip(["ping", "heartbeat", "disable", "stop"]) {
        client.send(&json!({ "id": id, "do": what }));
    }
    for id in 64..204 {
        let reply = client.json();
        assert_eq!(reply["id"], id, "in turn, once 64 wait: {reply}");
        assert_eq!(reply["status"] == 429, id < 200, "{reply}");
        assert_eq!(reply["ok"] == true, id >= 200, "{reply}");
    }
    assert_ne!(server.control.permit(), permit, "disable");
    assert_eq!(server.control.order(), Order::Stop);
}

#[test]
fn the_bytes_of_one_file_for_the_clay_are_taken_at_a_time() {
    let server = Server::new(None);
    let mut slow = TcpStream::connect(server.address).unwrap();
    let request =
        b"PUT /api/v1/clay/values HTTP/1.1\r\nHost: localhost\r\nContent-Length: 9000000\r\n\r\nx";
    slow.write_all(request).unwrap();
    let wait_for = |expected: u16| {
        let began = Instant::now();
        loop {
            let (status, _) =
                http(server.address, "PUT", "/api/v1/clay/image", &[], b"no PNG").unwrap();
            if status == expected {
                return;
            }
            assert!(began.elapsed() < HUNG, "{status} and not {expected}");
            std::thread::sleep(Duration::from_millis(20));
        }
    };
    wait_for(429);
    drop(slow);
    wait_for(400);
}

/// Connections that never say a whole request, as many as this process may have.
fn half_open(address: SocketAddr, most: usize) -> Vec<TcpStream> {
    // This end may have no more of them.
    let open = || {
        let mut stream = TcpStream::connect(address).ok()?;
        stream.write_all(b"POST /api/v1/disable HTTP/1.1\r\nHost: ").ok()?;
        Some(stream)
    };
    let held: Vec<_> = (0..most).map_while(|_| open()).collect();
    assert!(held.len() > most / 2, "{}", held.len());
    held
}

#[test]
fn half_a_request_does_not_block_a_disable() {
    let token = "0123456789abcdef0123456789abcdef";
    let mut daemon = Daemon::of(super::folder(""), "", &[("HAPTICD_TOKEN", token)]);
    daemon.wait_for("state: enabled");
    let mut client = Client::connect(daemon.address, &format!("?token={token}"), &[]).unwrap();
    client.subscribe(100.0);
    let bearer = format!("Bearer {token}");
    for most in [240, 1000] {
        let held = half_open(daemon.address, most);
        // Clients without access that ask, and are refused, do no better; nor does a client that
        // only loads the page.
        for (path, expected) in [("/api/v1/info", 401), ("/", 200)] {
            assert_eq!(daemon.http("GET", path, &[], "").0, expected, "among {most}");
        }
        for order in ["disable", "enable", "disable"] {
            let asked = Instant::now();
            let (status, body) =
                daemon.http("POST", &format!("/api/v1/{order}"), &[("Authorization", &bearer)], "");
            assert_eq!(status, 200, "{order} among {most}: {body}");
            assert!(
                asked.elapsed() < Duration::from_secs(2),
                "{order} among {most}: after {:?}",
                asked.elapsed()
            );
        }
        client.state_where(|state| state["state"] == "DISABLED");
        let open = std::fs::read_dir(format!("/proc/{}/fd", daemon.id())).unwrap().count();
        assert!(open < 400, "{open} files are open");
        drop(held);
    }
    // The connections from before are there still.
    let tick = client.state()["tick"].as_u64().unwrap();
    client.state_where(|state| state["tick"].as_u64() > Some(tick + 100));
    no_record_lost(&daemon.end());
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn who_sends_no_whole_request_is_let_go_after_some_seconds() {
    let daemon = Daemon::enabled("", "");
    let mut silent = TcpStream::connect(daemon.address).unwrap();
    let [mut half] = <[_; 1]>::try_from(half_open(daemon.address, 1)).unwrap();
    let began = Instant::now();
    // A byte now and then is no request either.
    while half.write_all(b"x").is_ok() {
        assert!(began.elapsed() < HUNG, "it may go on for ever");
        std::thread::sleep(Duration::from_millis(300));
    }
    assert!(began.elapsed() > Duration::from_secs(4), "after {:?}", began.elapsed());
    silent.set_read_timeout(Some(HUNG)).unwrap();
    assert!(matches!(silent.read(&mut [0; 8]), Ok(0) | Err(_)));
    assert!(began.elapsed() < Duration::from_secs(20), "after {:?}", began.elapsed());
    no_record_lost(&daemon.end());
}

/// Thousands of connections: as many as this process may have.
#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn a_thousand_connections_find_what_places_there_are() {
    let daemon = Daemon::enabled("", "");
    let mut client = daemon.connect();
    let mut held = Vec::new();
    for _ in 0..1000 {
        match TcpStream::connect(daemon.address) {
            Ok(mut stream) => {
                // One that gave way is gone.
                let _ = stream.write_all(b"GET /api/v1/info HTTP/1.1\r\nHost: localhost\r\n\r\n");
                held.push(stream);
            }
            // This end has no more of them.
            Err(_) => break,
        }
    }
    assert!(held.len() > 500, "{}", held.len());
    // The client that was there first goes on.
    client.subscribe(100.0);
    let tick = client.state()["tick"].as_u64().unwrap();
    client.state_where(|state| state["tick"].as_u64() > Some(tick + 500));
    let open = std::fs::read_dir(format!("/proc/{}/fd", daemon.id())).unwrap().count();
    assert!(open < 400, "{open} files are open");
    // A client that connects then gets the place of an idle one, once this machine may ask again.
    loop {
        match http(daemon.address, "GET", "/api/v1/state", &[], b"").unwrap().0 {
            429 => std::thread::sleep(Duration::from_millis(20)),
            status => break assert_eq!(status, 200),
        }
    }
    assert_eq!(http(daemon.address, "POST", "/api/v1/disable", &[], b"").unwrap().0, 200);
    client.state_where(|state| state["state"] == "DISABLED");
    drop(held);
    no_record_lost(&daemon.end());
}

#[test]
fn the_sixty_fifth_web_socket_finds_no_seat() {
    let daemon = Daemon::enabled("", "");
    let seated: Vec<_> = (0..64).map(|_| daemon.connect()).collect();
    assert_eq!(Client::connect(daemon.address, "", &[]).map(|_| ()), Err("503".to_owned()));
    assert_eq!(daemon.http("GET", "/api/v1/info", &[], "").0, 200);
    drop(seated);
    while Client::connect(daemon.address, "", &[]).is_err() {
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    no_record_lost(&daemon.end());
}
