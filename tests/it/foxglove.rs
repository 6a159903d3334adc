//! A run as the Foxglove app meets it.

use std::net::TcpListener;

use super::monitor::{command, folder};

#[test]
fn only_this_machine_can_watch() {
    for address in ["0.0.0.0:8765", "192.168.0.1:8765", "8765"] {
        let folder = folder("");
        let output =
            command(folder.path(), &format!("press.toml --foxglove {address}")).output().unwrap();
        let reported = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{reported}");
        assert!(
            reported.contains("only this machine can reach") && reported.contains("127.0.0.1:8765"),
            "{reported}"
        );
    }
}

#[test]
fn a_scene_that_lets_others_watch_is_refused() {
    let folder = folder("[monitor]\nfoxglove = \"0.0.0.0:8765\"\n");
    let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_hapticd"));
    let output = command.args(["check", "press.toml"]).current_dir(folder.path()).output().unwrap();
    let reported = String::from_utf8_lossy(&output.stdout).into_owned()
        + &String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(3), "{reported}");
    for wanted in ["monitor.foxglove", "0.0.0.0:8765", "only this machine can reach", "press.toml"]
    {
        assert!(reported.contains(wanted), "{wanted}: {reported}");
    }
}

#[test]
fn what_cannot_be_served_is_reported_before_anything_is_baked() {
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let folder = folder("");
    let address = taken.local_addr().unwrap();
    let line = format!("press.toml --duration 100ms --record r.mcap --foxglove {address}");
    let output = command(folder.path(), &line).output().unwrap();
    let reported = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{reported}");
    let remedy = "--foxglove, such as 127.0.0.1:0";
    assert!(reported.contains(&address.to_string()) && reported.contains(remedy), "{reported}");
    assert!(!reported.contains("state: baking"), "{reported}");
    assert!(!folder.path().join("r.mcap").exists(), "an empty recording stayed behind");
}

mod live {
    use std::collections::BTreeMap;
    use std::io::{Read as _, Write as _};
    use std::net::{SocketAddr, TcpStream};
    use std::time::{Duration, Instant};

    use base64::Engine as _;
    use base64::prelude::BASE64_STANDARD;
    use prost::Message as _;
    use serde_json::{Value, json};
    use tokio_tungstenite::tungstenite::client::IntoClientRequest as _;
    use tokio_tungstenite::tungstenite::{self, Message, WebSocket};

    use super::super::monitor::{Daemon, folder};

    macro_rules! messages {
        ($($message:ident { $($label:ident $kind:ident $field:ident: $type:ty = $number:literal,)+ })+) => {$(
            #[derive(Clone, PartialEq, prost::Message)]
            struct $message { $(#[prost($kind, $label, tag = $number)] $field: $type,)+ }
        )+};
    }
    // What is looked at of Foxglove's messages, by the numbers of its protobuf files.
    messages! {
        Vector3 { required double z: f64 = 3, }
        Pose { required message position: Vector3 = 1, }
        PoseInFrame { required string frame_id: String = 2, required message pose: Pose = 3, }
        Cube { required message pose: Pose = 1, }
        Entity {
            required string frame_id: String = 2,
            required bool frame_locked: bool = 5,
            repeated message cubes: Vec<Cube> = 8,
        }
        SceneUpdate { repeated message entities: Vec<Entity> = 2, }
        FrameTransform {
            required string parent_frame_id: String = 2,
            required string child_frame_id: String = 3,
        }
    }

    /// A process that has not answered by then hangs.
    const HUNG: Duration = Duration::from_secs(120);

    /// A run that can be watched.
    fn watched() -> (Daemon, SocketAddr) {
        // The line about the monitor, for which it waits, is older.
        let mut daemon = Daemon::start("", "--foxglove 127.0.0.1:0");
        let line = daemon.wait_for("foxglove: ws://");
        let address = line["foxglove: ws://".len()..].parse().unwrap();
        daemon.wait_for("state: enabled");
        (daemon, address)
    }

    /// A client with what it was ordered first.
    struct Viewer {
        socket: WebSocket<TcpStream>,
        /// What a server says of itself.
        info: Value,
        /// Channels by topic.
        channels: BTreeMap<String, Value>,
    }

    impl Viewer {
        fn connect(address: SocketAddr, headers: &[(&'static str, &str)]) -> Result<Self, String> {
            let mut request = format!("ws://{address}").into_client_request().unwrap();
            for (name, value) in headers {
                request.headers_mut().insert(*name, value.parse().unwrap());
            }
            let stream = TcpStream::connect(address).map_err(|error| error.to_string())?;
            stream.set_read_timeout(Some(HUNG)).unwrap();
            let (socket, answer) =
                tungstenite::client(request, stream).map_err(|error| match error {
                    tungstenite::HandshakeError::Failure(tungstenite::Error::Http(response)) => {
                        response.status().as_str().to_owned()
                    }
                    error => error.to_string(),
                })?;
            assert_eq!(answer.headers()["sec-websocket-protocol"], "foxglove.sdk.v1");
            let mut viewer = Self { socket, info: Value::Null, channels: BTreeMap::new() };
            while viewer.channels.len() < 10 {
                let message = viewer.text();
                match message["op"].as_str().unwrap() {
                    "serverInfo" => viewer.info = message,
                    "advertise" => {
                        let channels = message["channels"].as_array().unwrap().iter().cloned();
                        viewer.channels.extend(channels.map(|channel| {
                            (channel["topic"].as_str().unwrap().to_owned(), channel)
                        }));
                    }
                    other => panic!("{other}"),
                }
            }
            Ok(viewer)
        }

        fn of(address: SocketAddr) -> Self {
            Self::connect(address, &[PROTOCOL]).unwrap()
        }

        /// The subscription has the number of its channel.
        fn subscribe(&mut self, topic: &str) -> u64 {
            let id = self.channels[topic]["id"].as_u64().unwrap();
            self.send(
                &json!({ "op": "subscribe", "subscriptions": [{ "id": id, "channelId": id }] }),
            );
            id
        }

        fn send(&mut self, message: &Value) {
            self.socket.send(Message::from(message.to_string())).unwrap();
        }

        fn text(&mut self) -> Value {
            loop {
                if let Message::Text(text) = self.socket.read().unwrap() {
                    return serde_json::from_str(&text).unwrap();
                }
            }
        }

        /// The next message of a subscription: its time, ns, and what it holds.
        fn message(&mut self, subscription: u64) -> (u64, Vec<u8>) {
            let started = Instant::now();
            while started.elapsed() < HUNG {
                if let Message::Binary(bytes) = self.socket.read().unwrap()
                    && bytes[0] == 1
                    && u64::from(u32::from_le_bytes(bytes[1..5].try_into().unwrap()))
                        == subscription
                {
                    return (
                        u64::from_le_bytes(bytes[5..13].try_into().unwrap()),
                        bytes[13..].to_vec(),
                    );
                }
            }
            panic!("nothing came");
        }

        fn tool_height(&mut self, subscription: u64) -> f64 {
            let pose = PoseInFrame::decode(&self.message(subscription).1[..]).unwrap();
            assert_eq!(pose.frame_id, "world");
            pose.pose.position.z
        }
    }

    const PROTOCOL: (&str, &str) = ("sec-websocket-protocol", "foxglove.sdk.v1");

    #[test]
    fn a_client_sees_the_scene_and_the_tool_move() {
        let (daemon, address) = watched();
        let mut viewer = Viewer::of(address);
        assert_eq!(
            (&viewer.info["name"], &viewer.info["capabilities"]),
            (&"hapticd".into(), &json!([]))
        );
        let topics: Vec<&str> = viewer.channels.keys().map(String::as_str).collect();
        let wanted = [
            "/device/sample",
            "/faults",
            "/loop/timing",
            "/object/pose",
            "/scene",
            "/tf",
            "/tool/pose",
            "/wrench/command",
            "/wrench/contact",
            "/wrench/rendered",
        ];
        assert_eq!(topics, wanted);
        let channel = &viewer.channels["/tool/pose"];
        let reported =
            ["encoding", "schemaName", "schemaEncoding"].map(|key| channel[key].as_str().unwrap());
        assert_eq!(reported, ["protobuf", "foxglove.PoseInFrame", "protobuf"]);
        let schema = BASE64_STANDARD.decode(channel["schema"].as_str().unwrap()).unwrap();
        let descriptors = prost_types::FileDescriptorSet::decode(&schema[..]).unwrap();
        let files: Vec<&str> = descriptors.file.iter().map(|file| file.name()).collect();
        assert!(files.contains(&"foxglove/PoseInFrame.proto"), "{files:?}");
        assert_eq!(viewer.channels["/wrench/contact"]["schemaName"], "hapticd.ContactWrench");

        let scene = viewer.subscribe("/scene");
        let scene = SceneUpdate::decode(&viewer.message(scene).1[..]).unwrap();
        let shown: Vec<_> = scene
            .entities
            .iter()
            .map(|entity| (entity.frame_id.as_str(), entity.cubes.len()))
            .collect();
        assert_eq!(shown, [("world", 1), ("tool", 1)]);
        assert!(
            scene.entities.iter().all(|entity| entity.frame_locked),
            "the tool would stay where it was"
        );

        // The hand goes down to 6 mm, where the plate is met at 10 mm.
        let pose = viewer.subscribe("/tool/pose");
        let mut heights = vec![viewer.tool_height(pose)];
        while heights.last().is_some_and(|height| *height > 0.0101) {
            heights.push(viewer.tool_height(pose));
        }
        assert!(heights.iter().all(|height| (0.005..0.0125).contains(height)), "{heights:?}");

        let frame = viewer.subscribe("/tf");
        let (first_ns, bytes) = viewer.message(frame);
        let transform = FrameTransform::decode(&bytes[..]).unwrap();
        assert_eq!(
            (transform.parent_frame_id.as_str(), transform.child_frame_id.as_str()),
            ("world", "tool")
        );
        let last_ns = (0..5).map(|_| viewer.message(frame).0).last().unwrap();
        assert!(last_ns - first_ns >= 5 * 5_000_000, "five messages in {} ns", last_ns - first_ns);
        let ended = daemon.end();
        assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    }

    #[test]
    #[ignore = "takes long: `cargo test -- --include-ignored`"]
    fn a_client_that_reconnects_gets_the_scene_again_but_not_for_ever() {
        let (daemon, address) = watched();
        let mut viewer = Viewer::of(address);
        let mut shown = 0;
        for _ in 0..20 {
            let scene = viewer.subscribe("/scene");
            let pose = viewer.subscribe("/tool/pose");
            // The scene is on its way before ticks that are later.
            for _ in 0..4 {
                loop {
                    let Message::Binary(bytes) = viewer.socket.read().unwrap() else { continue };
                    match u64::from(u32::from_le_bytes(bytes[1..5].try_into().unwrap())) {
                        id if id == scene => shown += 1,
                        id if id == pose => break,
                        _ => {}
                    }
                }
            }
            viewer.send(&json!({ "op": "unsubscribe", "subscriptionIds": [scene, pose] }));
        }
        assert_eq!(shown, 8);
        assert_eq!(daemon.end().code, Some(0));
    }

    #[test]
    #[ignore = "takes long: `cargo test -- --include-ignored`"]
    fn clients_that_never_read_or_make_no_sense_change_nothing() {
        let (daemon, address) = watched();
        let mut silent = Viewer::of(address);
        let topics: Vec<String> = silent.channels.keys().cloned().collect();
        for topic in &topics {
            silent.subscribe(topic);
        }

        let mut wild = Viewer::of(address);
        for nonsense in [
            "",
            "{",
            "[1]",
            r#"{"op":"subscribe","subscriptions":[{"id":1,"channelId":999999}]}"#,
            r#"{"op":"advertise"}"#,
        ] {
            wild.socket.send(Message::from(nonsense)).unwrap();
        }
        wild.socket.send(Message::binary(vec![0xff; 4096])).unwrap();
        wild.socket.get_mut().write_all(&[0xff; 64]).unwrap();
        // A message without end: it is cut off after a mebibyte.
        let mut endless = Viewer::of(address);
        let mut frame = vec![0x82, 0xff];
        frame.extend((32u64 << 20).to_be_bytes());
        frame.extend([0; 4]);
        let stream = endless.socket.get_mut();
        let block = [0; 1 << 16];
        let sent = stream
            .write_all(&frame)
            .and_then(|()| (0..512).try_for_each(|_| stream.write_all(&block)));
        let is_over = sent.is_err() || matches!(stream.read(&mut [0; 64]), Ok(0) | Err(_));
        assert!(is_over, "32 MiB were taken");

        let mut viewer = Viewer::of(address);
        let timing = viewer.subscribe("/loop/timing");
        let first_ns = viewer.message(timing).0;
        while viewer.message(timing).0 < first_ns + 2_000_000_000 {}
        drop(silent);
        let ended = daemon.end();
        assert_eq!(ended.code, Some(0), "{}", ended.stderr);
        assert_eq!(ended.json["faults"], json!([]));
        assert!(!ended.stderr.contains("ticks dropped"), "{}", ended.stderr);
    }

    #[test]
    fn strangers_do_not_come_in() {
        let (daemon, address) = watched();
        let refused = |headers: &[(&'static str, &str)]| {
            Viewer::connect(address, headers).map(drop).unwrap_err()
        };
        assert_eq!(refused(&[PROTOCOL, ("origin", "http://evil.example")]), "403");
        assert_eq!(refused(&[("sec-websocket-protocol", "chat")]), "400");
        drop(
            Viewer::connect(address, &[PROTOCOL, ("origin", "https://app.foxglove.dev")]).unwrap(),
        );
        // Those that went just now may still be on their way out.
        let mut seated = Vec::new();
        let started = Instant::now();
        while seated.len() < 8 && started.elapsed() < HUNG {
            seated.extend(Viewer::connect(address, &[PROTOCOL]));
        }
        assert_eq!(seated.len(), 8);
        assert!(Viewer::connect(address, &[PROTOCOL]).is_err(), "a ninth client");
        // The others see the end of the run.
        let ended = daemon.end();
        assert_eq!(ended.code, Some(0), "{}", ended.stderr);
        assert!(ended.stderr.contains("connections turned away"), "{}", ended.stderr);
        let last = &mut seated[0].socket;
        while last.read().is_ok() {}
    }

    #[test]
    fn a_scene_can_ask_for_it() {
        let mut daemon = Daemon::of(folder("[monitor]\nfoxglove = \"localhost:0\"\n"), "", &[]);
        let line = daemon.wait_for("foxglove: ws://127.0.0.1:");
        drop(Viewer::of(line["foxglove: ws://".len()..].parse().unwrap()));
        daemon.wait_for("state: enabled");
        assert_eq!(daemon.end().code, Some(0));
    }
}
