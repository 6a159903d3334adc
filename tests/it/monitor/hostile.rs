//! Clients that do not behave: each is answered as documented, and the loop does not notice.

use std::io::{Read as _, Write as _};
use std::net::TcpStream;

use serde_json::json;
use tokio_tungstenite::tungstenite::Message;

use super::{Daemon, HUNG, http, no_record_lost};

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
        ("{\"do\":\"place\",\"object\":\"plate\",\"pose\":{\"p\":[1,2],\"q\":[0,0,0,1]}}", "length"),
    ] {
        client.socket.send(Message::from(text)).unwrap();
        let reply = client.json();
        assert_eq!((reply["type"].as_str(), reply["ok"].as_bool()), (Some("reply"), Some(false)), "{text}: {reply}");
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
    let long = format!("/api/v1/parameters/{}", "x".repeat(5000));
    assert_eq!(http(daemon.address, "GET", &long, &[], b"").unwrap().0, 414);
    no_record_lost(&daemon.end());
}

#[test]
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
fn a_flood_of_requests_is_answered_in_turn() {
    let daemon = Daemon::enabled("", "");
    let mut client = daemon.connect();
    for n in 0..500 {
        let value = 4000 + n % 2;
        client.send(&json!({ "id": n, "do": "set", "parameter": "contact_stiffness_n_per_m", "value": value }));
    }
    let mut answered = 0;
    while answered < 500 {
        let message = client.json();
        if message["type"] == "reply" {
            assert_eq!(message["id"], answered);
            assert!(message["ok"] == true || message["status"] == 429, "{message}");
            answered += 1;
        }
    }
    let mut statuses: Vec<u16> = Vec::new();
    for _ in 0..1500 {
        statuses.push(http(daemon.address, "GET", "/api/v1/parameters", &[], b"").map_or(0, |answer| answer.0));
    }
    assert!(statuses.iter().all(|status| matches!(status, 200 | 429 | 503)), "{statuses:?}");
    assert_eq!(daemon.http("POST", "/api/v1/disable", &[], "").0, 200, "what takes force away is always heard");
    no_record_lost(&daemon.end());
}

/// Thousands of connections: as many as this process may have.
#[test]
fn a_thousand_connections_find_what_places_there_are() {
    let daemon = Daemon::enabled("", "");
    let mut client = daemon.connect();
    let mut held = Vec::new();
    for _ in 0..1000 {
        match TcpStream::connect(daemon.address) {
            Ok(stream) => held.push(stream),
            // This end has no more of them.
            Err(_) => break,
        }
    }
    assert!(held.len() > 500, "{}", held.len());
    // The client that was there first goes on.
    client.subscribe(100.0);
    let tick = client.state()["tick"].as_u64().unwrap();
    client.state_where(|state| state["tick"].as_u64() > Some(tick + 500));
    // The last one was told why.
    let mut last = held.pop().unwrap();
    last.set_read_timeout(Some(HUNG)).unwrap();
    let mut answer = String::new();
    let _ = last.read_to_string(&mut answer);
    assert!(answer.is_empty() || answer.starts_with("HTTP/1.1 503 ") && answer.contains("too many connections"), "{answer}");
    let open = std::fs::read_dir(format!("/proc/{}/fd", daemon.id())).unwrap().count();
    assert!(open < 400, "{open} files are open");
    drop((held, last));
    // As soon as places are free again.
    while !matches!(http(daemon.address, "GET", "/api/v1/info", &[], b""), Ok((200, _))) {
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    no_record_lost(&daemon.end());
}

#[test]
fn the_sixty_fifth_web_socket_finds_no_seat() {
    let daemon = Daemon::enabled("", "");
    let seated: Vec<_> = (0..64).map(|_| daemon.connect()).collect();
    assert_eq!(super::Client::connect(daemon.address, "", &[]).map(|_| ()), Err("503".to_owned()));
    assert_eq!(daemon.http("GET", "/api/v1/info", &[], "").0, 200);
    drop(seated);
    while super::Client::connect(daemon.address, "", &[]).is_err() {
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    no_record_lost(&daemon.end());
}
