//! What a run publishes on a network; and what a program says that was built without a network.

use super::monitor::{command, folder};

/// How `run` ends with these arguments, and what it says.
fn refused(line: &str) -> (Option<i32>, String) {
    let folder = folder("");
    let output =
        command(folder.path(), &format!("press.toml --duration 100ms {line}")).output().unwrap();
    (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
}

#[test]
fn what_makes_no_sense_is_reported_before_anything_is_baked() {
    for (line, wanted) in [
        ("--connect tcp/127.0.0.1:1", "nothing is published"),
        ("--publish-hz 50", "--publish"),
        ("--publish 2d", "begins with a digit"),
    ] {
        let (code, reported) = refused(line);
        assert_eq!(code, Some(2), "{line}: {reported}");
        assert!(
            reported.contains(wanted) && !reported.contains("state: baking"),
            "{line}: {reported}"
        );
    }
}

#[cfg(not(feature = "zenoh"))]
#[test]
fn a_program_without_a_network_says_how_to_build_one() {
    let (code, reported) = refused("--publish");
    assert_eq!(code, Some(2), "{reported}");
    assert!(
        reported.contains("--features zenoh") && !reported.contains("state: baking"),
        "{reported}"
    );
}

#[cfg(feature = "zenoh")]
mod live {
    use std::collections::{BTreeMap, BTreeSet};
    use std::net::TcpListener;
    use std::time::{Duration, Instant, SystemTime};

    use crossbeam::channel::{Receiver, unbounded};
    use glam::DVec3;
    use link::network::{Endpoints, session};
    use link::{Header, Message, PoseStamped, Time, Topic, gid};
    use serde_json::{Value, json};
    use vps::spatial::Pose;
    use zenoh::sample::{Sample, SampleKind};
    use zenoh::{Session, Wait};

    use super::super::monitor::{Daemon, Ended, command, folder};

    /// A process that has not answered by then hangs.
    const HUNG: Duration = Duration::from_secs(120);

    /// An address of this machine where no process listens yet.
    fn free() -> String {
        let taken = TcpListener::bind("127.0.0.1:0").unwrap();
        format!("tcp/{}", taken.local_addr().unwrap())
    }

    /// A session that meets a run there.
    fn visit(endpoint: &str) -> Session {
        session::open(&Endpoints { connect: vec![endpoint.to_owned()], ..Endpoints::default() })
            .unwrap()
    }

    fn subscribe(session: &Session, key: &str) -> Receiver<Sample> {
        let (sender, samples) = unbounded();
        let heard = move |sample| drop(sender.send(sample));
        session.declare_subscriber(key.to_owned()).callback(heard).background().wait().unwrap();
        samples
    }

    /// Tokens that come and go.
    fn watch(session: &Session, key: &str) -> Receiver<(bool, String)> {
        let (sender, tokens) = unbounded();
        let heard = move |sample: Sample| {
            drop(sender.send((sample.kind() == SampleKind::Put, sample.key_expr().to_string())))
        };
        session
            .liveliness()
            .declare_subscriber(key.to_owned())
            .history(true)
            .callback(heard)
            .background()
            .wait()
            .unwrap();
        tokens
    }

    fn number(bytes: &[u8]) -> f64 {
        f64::from_le_bytes(bytes.try_into().unwrap())
    }

    /// Position of a pose in the frame `device` or `world`: it begins at byte 28
    /// (docs/reference/ros2.md).
    fn position(message: &[u8]) -> [f64; 3] {
        [0, 1, 2].map(|axis| number(&message[28 + 8 * axis..36 + 8 * axis]))
    }

    fn state(sample: &Sample) -> Value {
        serde_json::from_slice(&sample.payload().to_bytes()).unwrap()
    }

    fn bits(position: [f64; 3]) -> [u64; 3] {
        position.map(f64::to_bits)
    }

    fn ended(daemon: Daemon) -> Ended {
        let ended = daemon.end();
        assert_eq!(ended.code, Some(0), "{}", ended.stderr);
        assert_eq!(ended.json["faults"], json!([]));
        ended
    }

    /// A run that publishes, and where it listens.
    fn published(flags: &str) -> (Daemon, String) {
        let endpoint = free();
        let mut daemon = Daemon::start("", &format!("--listen {endpoint} {flags}"));
        daemon.wait_for("state: enabled");
        (daemon, endpoint)
    }

    #[test]
    fn ros_2_finds_every_topic_with_its_type_and_messages_say_what_the_state_says() {
        let (daemon, endpoint) = published("--publish left/arm --ros-domain 7");
        let session = visit(&endpoint);
        let tokens = watch(&session, "@ros2_lv/7/**");
        let states = subscribe(&session, "hapticd/left/arm/state");
        let samples = subscribe(&session, "7/left/arm/**");

        // The graph: a node, a publisher for each topic, and the subscriber of the hand.
        let mut graph = BTreeSet::new();
        while graph.len() < 2 + Topic::ALL.len() {
            let (is_there, token) = tokens.recv_timeout(HUNG).unwrap();
            assert!(is_there);
            graph.insert(token);
        }
        let pieces = |token: &str| token.split('/').map(str::to_owned).collect::<Vec<_>>();
        let node = graph.iter().find(|token| pieces(token)[5] == "NN").unwrap();
        let of_run = pieces(node)[2].clone();
        assert_eq!(*node, format!("@ros2_lv/7/{of_run}/0/0/NN/%/%left%arm/hapticd"));
        let mut publishers = BTreeMap::new();
        for token in graph.iter().filter(|token| *token != node && pieces(token)[5] != "MS") {
            let pieces = pieces(token);
            assert_eq!(
                (&pieces[2], &*pieces[5], &*pieces[7], &*pieces[8], pieces.len()),
                (&of_run, "MP", "%left%arm", "hapticd", 13),
                "{token}"
            );
            // A subscriber puts its key together from these.
            let key = format!(
                "7/{}/{}/{}",
                pieces[9].trim_start_matches('%').replace('%', "/"),
                pieces[10],
                pieces[11]
            );
            publishers.insert(key, token.clone());
        }

        // The messages: on those keys, counted, stamped, and from those publishers.
        let mut seen: BTreeMap<String, Vec<Sample>> = BTreeMap::new();
        let began = Instant::now();
        while seen.len() < publishers.len() || seen.values().any(|samples| samples.len() < 8) {
            assert!(began.elapsed() < HUNG, "{:?}", seen.keys());
            let sample = samples.recv_timeout(HUNG).unwrap();
            seen.entry(sample.key_expr().to_string()).or_default().push(sample);
        }
        assert_eq!(seen.keys().collect::<Vec<_>>(), publishers.keys().collect::<Vec<_>>());
        let now_ns =
            SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap().as_nanos() as i64;
        for (key, samples) in &seen {
            let mut before = None;
            for sample in samples {
                let attachment = sample.attachment().unwrap().to_bytes().into_owned();
                assert_eq!((attachment.len(), attachment[16]), (33, 16), "{key}");
                let count = i64::from_le_bytes(attachment[..8].try_into().unwrap());
                assert!(
                    before.is_none_or(|before| count == before + 1) && count > 0,
                    "{key}: {before:?}, {count}"
                );
                before = Some(count);
                let sent_ns = i64::from_le_bytes(attachment[8..16].try_into().unwrap());
                assert!((now_ns - sent_ns).abs() < HUNG.as_nanos() as i64, "{key}: {sent_ns}");
                assert_eq!(attachment[17..], gid(&publishers[key]), "{key}");
                assert_eq!(sample.payload().to_bytes()[..4], [0, 1, 0, 0], "{key}");
            }
        }

        // A pose of ROS 2 is that of a state, bit for bit.
        let reported: BTreeSet<_> = states
            .try_iter()
            .map(|sample| {
                bits(serde_json::from_value(state(&sample)["measured_cp"]["p"].clone()).unwrap())
            })
            .collect();
        let poses =
            seen.iter().find(|(key, _)| key.starts_with("7/left/arm/measured_cp/")).unwrap().1;
        let found = poses
            .iter()
            .filter(|sample| reported.contains(&bits(position(&sample.payload().to_bytes()))))
            .count();
        assert!(found > 4, "{found} of {}", poses.len());

        // Its end is seen too.
        ended(daemon);
        let gone = core::iter::from_fn(|| tokens.recv_timeout(HUNG).ok()).take(graph.len());
        assert_eq!(
            gone.filter(|(is_there, _)| !is_there).map(|(_, token)| token).collect::<BTreeSet<_>>(),
            graph
        );
    }

    #[test]
    fn the_hand_of_a_simulated_arm_follows_poses_of_ros_and_of_others() {
        let (mut daemon, endpoint) = published("--publish cell --ros-domain 7");
        let session = visit(&endpoint);
        let tokens = watch(&session, "@ros2_lv/7/**/MS/**");
        let (_, token) = tokens.recv_timeout(HUNG).unwrap();
        let pieces: Vec<_> = token.split('/').collect();
        assert_eq!(
            (pieces[4], pieces[9]),
            ("11", "%cell%tool%servo_cp"),
            "behind the ten publishers: {token}"
        );
        let ros = format!("7/cell/tool/servo_cp/{}/{}", pieces[10], pieces[11]);
        let states = subscribe(&session, "hapticd/cell/state");
        let message = |x: f64, frame_id| {
            let pose = Pose::from_translation(DVec3::new(x, 0.0, 0.02));
            PoseStamped { header: Header { stamp: Time::default(), frame_id }, pose }.to_cdr()
        };
        for (key, payload, wanted) in [
            (&*ros, message(0.004, "world"), 0.004),
            (
                "hapticd/cell/hand",
                br#"{"p": [-0.003, 0, 0.02], "q": [0, 0, 0, 1]}"#.to_vec(),
                -0.003,
            ),
        ] {
            let began = Instant::now();
            // A put before the sessions have met is lost.
            while !states.try_iter().last().is_some_and(|sample| {
                let x = state(&sample)["tool_cp"]["p"][0].as_f64().unwrap();
                // Friction of the arm holds a hand back by some 0.2 mm.
                (x - wanted).abs() < 5e-4
            }) {
                assert!(began.elapsed() < HUNG, "{key}");
                session.put(key.to_owned(), payload.clone()).wait().unwrap();
                std::thread::sleep(Duration::from_millis(30));
            }
        }
        session.put(ros, message(0.0, "device")).wait().unwrap();
        let said = daemon.wait_for("note: publishing: 7/cell/tool/servo_cp/");
        assert!(
            said.ends_with("`frame_id` is `device`; send poses of the tool in `world`"),
            "{said}"
        );
        session
            .put("hapticd/cell/hand", br#"{"p": [0, 0, 0.02], "q": [0, 0, 0, 0]}"#.to_vec())
            .wait()
            .unwrap();
        daemon.wait_for("note: publishing: hand: ");
        ended(daemon);
    }

    #[test]
    fn any_number_of_viewers_sees_the_state_without_a_monitor() {
        let endpoint = free();
        let folder = folder("");
        let line = format!(
            "press.toml --duration 4s --realtime best-effort --monitor off --publish --publish-hz \
                50 --listen {endpoint}"
        );
        let run = command(folder.path(), &line)
            .stdout(std::process::Stdio::null())
            .stderr(std::process::Stdio::null())
            .spawn()
            .unwrap();
        let began = Instant::now();
        let viewers: Vec<_> = (0..3).map(|_| visit(&endpoint)).collect();
        let streams: Vec<_> = viewers
            .iter()
            .flat_map(|viewer| {
                ["hapticd/hapticd/state", "hapticd/hapticd/state/binary"]
                    .map(|key| subscribe(viewer, key))
            })
            .collect();
        for (idx, stream) in streams.iter().enumerate() {
            let mut seqs = Vec::new();
            while seqs.len() < 20 {
                assert!(began.elapsed() < HUNG);
                let sample = stream.recv_timeout(HUNG).unwrap();
                let bytes = sample.payload().to_bytes();
                seqs.push(if idx % 2 == 0 {
                    let state = state(&sample);
                    assert_eq!((&state["type"], &state["dropped"]), (&json!("state"), &json!(0)));
                    assert_eq!(state["objects"][0]["p"], json!([0.0, 0.0, -0.01]));
                    state["seq"].as_u64().unwrap()
                } else {
                    assert_eq!((&bytes[..4], bytes.len()), (&b"HSTA"[..], 344));
                    u64::from_le_bytes(bytes[24..32].try_into().unwrap())
                });
            }
            assert!(seqs.is_sorted() && seqs[19] >= seqs[0] + 19, "{seqs:?}");
        }
        assert_eq!(run.wait_with_output().unwrap().status.code(), Some(0));
    }
}
