//! Clay, as clients meet it.

use std::cell::Cell;
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use super::{Client, Daemon, HUNG, http};

/// A ball of clay with a ball over it in the hand.
pub(crate) const SCENE: &str = r#"version = 1
[sculpt]
shape = { sphere_mm = 15 }
spacing_mm = 1.5
raster = [16, 16, 16]
brush_mm = 6
update_hz = 100
tool = "touch"
[tool]
shape = { sphere_mm = 3 }
voxel_size_mm = 1.0
start_position_mm = [0, 0, 20]
[limits]
force_n = 4
[device]
profile = "sim-sigma7"
hand = "hand.csv"
"#;
/// The force limit within 10 ms.
const SLEW_N_PER_S: f64 = 400.0;
/// Just over the ball, so that it is within the brush.
pub(crate) const STILL: &str =
    "t_s,x_m,y_m,z_m,qx,qy,qz,qw\n0,0,0,0.020,0,0,0,1\n1,0,0,0.020,0,0,0,1\n";
/// To and fro above it: what is held is pulled.
const PULLING: &str = "t_s,x_m,y_m,z_m,qx,qy,qz,qw\n0,0,0,0.019,0,0,0,1\n0.3,0,0,0.019,0,0,0,1\n0.8,0,0,0.026,0,0,0,1\n1.0,0,0,0.026,0,0,0,1\n";

/// After so long a hold that pulls nothing is taken again: within the second that a client may be
/// silent, and each time at another place of that path.
const HELD: Duration = Duration::from_millis(600);

fn clay_where(daemon: &Daemon, is_it: impl Fn(&Value) -> bool) -> Value {
    let started = Instant::now();
    loop {
        let facts = daemon.get("/api/v1/clay");
        if is_it(&facts) {
            return facts;
        }
        assert!(started.elapsed() < HUNG, "it did not come to that: {facts}");
        std::thread::sleep(Duration::from_millis(20));
    }
}

#[test]
fn clients_see_the_clay_and_choose_what_the_tool_does_to_it() {
    let daemon = Daemon::sculpting(SCENE, STILL);
    assert_eq!(daemon.get("/api/v1/scene")["clay"], true);
    let facts = daemon.get("/api/v1/clay");
    assert_eq!(
        (&facts["craft"], &facts["falloff"], &facts["brush_m"]),
        (&json!("touch"), &json!("gaussian"), &json!(0.006)),
        "{facts}"
    );
    assert_eq!(facts["world_from_map"]["q"], json!([0.0, 0.0, 0.0, 1.0]));

    let points = |since: u64| {
        let path = format!("/api/v1/clay/points?since={since}");
        http(daemon.address, "GET", &path, &[], b"").unwrap()
    };
    let (status, bytes) = points(0);
    let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
    assert_eq!(
        (status, &bytes[..4], word(4), u64::from(word(16))),
        (200, &b"HCLY"[..], 1, facts["samples"].as_u64().unwrap())
    );
    assert_eq!(bytes.len(), 32 + 20 * word(16) as usize);
    for at in (32..bytes.len()).step_by(20) {
        let radius_m = [0, 4, 8]
            .map(|axis| f64::from(f32::from_bits(word(at + axis))).powi(2))
            .iter()
            .sum::<f64>()
            .sqrt();
        assert!((radius_m - 0.015).abs() < 1e-3, "{radius_m}");
    }
    assert_eq!(points(u64::from(word(8))), (204, Vec::new()));

    let mut client = daemon.connect();
    client.does(json!({ "do": "clay_take", "craft": "paint", "color": "#102030" }));
    client.event("clay", "paint");
    let (status, answer) = daemon.http(
        "POST",
        "/api/v1/clay/tool",
        &[],
        r#"{"brush_m": 0.004, "falloff": [1, 0.5, 0]}"#,
    );
    assert_eq!((status, &answer["ok"]), (200, &json!(true)), "{answer}");
    let facts = daemon.get("/api/v1/clay");
    let expected = (&json!("paint"), &json!("#102030"), &json!(0.004), &json!("table"));
    assert_eq!((&facts["craft"], &facts["color"], &facts["brush_m"], &facts["falloff"]), expected);
    for wrong in
        [json!({ "craft": "knit" }), json!({ "brush_m": 1 }), json!({ "color": "red" }), json!({})]
    {
        let (status, answer) = daemon.http("POST", "/api/v1/clay/tool", &[], &wrong.to_string());
        assert!(status == 400 && answer["hint"].is_string(), "{wrong}: {status} {answer}");
    }

    // A stroke, back, forth, and into files.
    let before = daemon.get("/api/v1/clay");
    let refused = client.ask(json!({ "do": "clay_undo" }));
    assert_eq!((&refused["status"], refused["hint"].is_string()), (&json!(409), true), "{refused}");
    client.does(json!({ "do": "clay_take", "craft": "emboss", "brush_m": 0.008 }));
    client.does(json!({ "do": "clay_hold", "held": true }));
    clay_where(&daemon, |facts| facts["undo"] == 1);
    client.does(json!({ "do": "clay_hold", "held": false }));
    client.does(json!({ "do": "clay_undo" }));
    client.event("clay", "undone");
    let undone = clay_where(&daemon, |facts| facts["redo"] == 1);
    assert_eq!(undone["samples"], before["samples"]);
    assert_ne!(undone["version"], before["version"]);
    client.does(json!({ "do": "clay_redo" }));
    clay_where(&daemon, |facts| facts["undo"] == 1 && facts["redo"] == 0);
    for (kind, ending) in [("points", "ply"), ("session", "session"), ("export", "ply")] {
        let reply =
            client.ask(json!({ "do": "clay_save", "kind": kind, "file": format!("ball {kind}") }));
        let file = daemon.state_folder().join(format!("clay/ball {kind}.{ending}"));
        assert_eq!(
            (&reply["ok"], reply["file"].as_str()),
            (&json!(true), file.to_str()),
            "{reply}"
        );
        assert!(std::fs::metadata(&file).unwrap().len() > 1000);
        client.event("clay", "saved");
        let again =
            client.ask(json!({ "do": "clay_save", "kind": kind, "file": format!("ball {kind}") }));
        assert_eq!(again["status"], 409, "{again}");
    }
    assert_eq!(
        client.ask(json!({ "do": "clay_save", "kind": "points", "file": "../ball" }))["status"],
        400
    );
    assert_eq!(daemon.end().code, Some(0));
}

#[test]
fn a_client_chooses_curves_region_material_image_and_solid_and_what_makes_no_sense_is_refused() {
    let daemon = Daemon::sculpting(SCENE, STILL);
    let top_m = 0.015;
    let post = |path: &str, body: Value| {
        daemon.http("POST", &format!("/api/v1/clay/{path}"), &[], &body.to_string())
    };
    let does = |path: &str, body: Value| {
        let (status, answer) = post(path, body);
        assert_eq!((status, &answer["ok"]), (200, &json!(true)), "{path}: {answer}");
    };
    does("tool", json!({ "craft": "pull-curve", "brush_m": 0.003 }));
    let curves =
        json!([[[-0.003, 0, top_m], [0.003, 0, top_m]], [[0, -0.003, top_m], [0, 0.003, top_m]]]);
    does("draw", json!({ "curves_m": curves }));
    let drawn = clay_where(&daemon, |facts| {
        facts["curves_map"].as_array().is_some_and(|curves| curves.len() == 2)
    });
    assert!(
        drawn["curves_map"][0].as_array().unwrap().len() > 2,
        "corners are put in between: {drawn}"
    );
    does("pull", json!({ "curves_m": curves, "force_n": [0, 0, 3], "time_s": 0.2 }));
    clay_where(&daemon, |facts| facts["undo"] == 1 && facts["is_stroke"] == false);
    does("lay", json!({ "painted": { "stiffness_n_per_m": 321 } }));
    let laid = clay_where(&daemon, |facts| facts["undo"] == 2);
    assert_eq!(laid["material"]["stiffness_n_per_m"], 321.0, "{laid}");
    does("lay", json!({ "ball": { "center": [0, 0, top_m], "radius_m": 0.004 } }));
    does(
        "combine",
        json!({ "boolean": "union", "shape": { "sphere_m": 0.004 }, "pose": { "p": [0, 0, top_m], "q": [0, 0, 0, 1] } }),
    );
    let joined = clay_where(&daemon, |facts| facts["undo"] == 4);
    let highest_m = |facts: &Value| facts["region_map"]["max"][2].as_f64().unwrap();
    assert!(
        highest_m(&joined) > highest_m(&laid) + 0.002,
        "the region has grown with the piece: {joined} after {laid}"
    );
    does("undo", json!({}));
    does("region", json!({ "min": [-0.006, -0.006, 0.008], "max": [0.006, 0.006, 0.02] }));
    let chosen = clay_where(&daemon, |facts| {
        facts["region_map"]["min"][0].as_f64().is_some_and(|low| low > -0.007)
    });
    assert!(chosen["region_map"]["min"][2].as_f64().unwrap() > 0.0, "{chosen}");

    // Files: an image and a solid.
    let put = |path: &str, bytes: &[u8]| {
        let (status, answer) =
            http(daemon.address, "PUT", &format!("/api/v1/clay/{path}"), &[], bytes).unwrap();
        (status, serde_json::from_slice::<Value>(&answer).unwrap_or_default())
    };
    let image = std::fs::read(
        super::Path::new(env!("CARGO_MANIFEST_DIR")).join("config/models/letter-h.png"),
    )
    .unwrap();
    assert_eq!(put("image", &image).0, 200);
    let corner = b"v 0 0 0\nv 6 0 0\nv 0 6 0\nv 0 0 6\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";
    assert_eq!(put("solid?format=obj&units=mm", corner).0, 200);
    let facts =
        clay_where(&daemon, |facts| facts["has_image"] == true && facts["solid"].is_string());
    assert_eq!(facts["solid"], "4 triangles, 6.0 x 6.0 x 6.0 mm");
    does(
        "combine",
        json!({ "boolean": "difference", "pose": { "p": [0, 0, top_m], "q": [0, 0, 0, 1] } }),
    );
    let before = daemon.get("/api/v1/clay")["undo"].as_u64().unwrap();
    assert_eq!(
        put("values?within_m=0.003", b"x_mm,y_mm,z_mm,mass,damping,stiffness\n0,0,15,,,700\n").0,
        200
    );
    clay_where(&daemon, |facts| facts["undo"] == before + 1);
    for path in ["image", "solid"] {
        assert_eq!(
            http(daemon.address, "DELETE", &format!("/api/v1/clay/{path}"), &[], b"").unwrap().0,
            200
        );
    }
    clay_where(&daemon, |facts| facts["has_image"] == false && facts["solid"].is_null());
    for (path, bytes, expected) in [
        ("image", &b"GIF89a"[..], 400),
        ("image", &vec![0; 5 << 20], 413),
        ("solid", corner, 400),
        ("solid?format=step&units=mm", corner, 400),
        ("solid?format=stl&units=mm", b"solid nothing", 400),
        ("values", b"x,y,z\n1,2,3\n", 400),
        ("values", b"x_mm,y_mm,z_mm,mass,damping,stiffness\n0,0,500,,,700\n", 409),
    ] {
        let (status, answer) = put(path, bytes);
        assert!(status == expected && answer["error"].is_string(), "{path}: {status} {answer}");
    }
    for (path, body, expected) in [
        ("draw", json!({ "curves_m": [[]] }), 409),
        ("draw", json!({ "curves_m": [[[0, 0, 1]]] }), 409),
        ("draw", json!({ "curves_m": 3 }), 400),
        ("pull", json!({ "curves_m": curves, "force_n": [0, 0, 0], "time_s": 0.2 }), 400),
        ("region", json!({ "min": [0, 0, 0], "max": [0, 1, 1] }), 400),
        ("region", json!({ "min": [1, 1, 1], "max": [2, 2, 2] }), 409),
        ("lay", json!({}), 400),
        ("lay", json!({ "box": { "min": [1, 1, 1], "max": [2, 2, 2] } }), 409),
        ("combine", json!({ "boolean": "union" }), 400),
    ] {
        let (status, answer) = post(path, body.clone());
        assert!(
            status == expected && answer["hint"].is_string(),
            "{path} {body}: {status} {answer}"
        );
    }
    assert_eq!(daemon.end().code, Some(0));
}

#[test]
fn an_image_that_a_client_sends_stands_out_by_its_depth() {
    let scene =
        SCENE.replace("spacing_mm = 1.5", "spacing_mm = 0.75").replace("\"touch\"", "\"emboss\"");
    let daemon = Daemon::sculpting(&scene, STILL);
    // White on the right: towards +x, as the surface faces up.
    let mut image = tiny_skia::Pixmap::new(64, 64).unwrap();
    for (n, pixel) in image.pixels_mut().iter_mut().enumerate() {
        let grey = if n % 64 < 32 { 0 } else { 255 };
        *pixel = tiny_skia::ColorU8::from_rgba(grey, grey, grey, 255).premultiply();
    }
    let (status, _) =
        http(daemon.address, "PUT", "/api/v1/clay/image", &[], &image.encode_png().unwrap())
            .unwrap();
    assert_eq!(status, 200);
    let depth_m = 0.0012;
    let mut client = daemon.connect();
    client.does(json!({ "do": "clay_take", "depth_m": depth_m }));
    client.does(json!({ "do": "clay_hold", "held": true }));
    clay_where(&daemon, |facts| facts["undo"] == 1);
    client.does(json!({ "do": "clay_hold", "held": false }));
    let (_, bytes) = http(daemon.address, "GET", "/api/v1/clay/points", &[], b"").unwrap();
    let number = |at: usize| f64::from(f32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()));
    let places = (32..bytes.len()).step_by(20).map(|at| [0, 4, 8].map(|axis| number(at + axis)));
    let mut n_raised = 0;
    let mut n_level = 0;
    for [x, y, z] in places.filter(|[_, y, z]| *z > 0.0 && y.abs() < 0.004) {
        let height_m = (x * x + y * y + z * z).sqrt() - 0.015;
        if (0.002..0.004).contains(&x) {
            n_raised += 1;
            assert!((height_m - depth_m).abs() < 1e-4, "{height_m} m at {x}, {y}");
        } else if (-0.008..-0.002).contains(&x) {
            n_level += 1;
            assert!(height_m.abs() < 1e-4, "{height_m} m at {x}, {y}");
        }
    }
    assert!(n_raised > 10 && n_level > 40, "{n_raised}, {n_level}");
    assert_eq!(daemon.end().code, Some(0));
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn a_hold_ends_with_the_client_with_its_silence_and_with_the_force() {
    let daemon = Daemon::sculpting(SCENE, STILL);
    let mut holder = daemon.connect();
    let mut other = daemon.connect();
    other.does(json!({ "do": "clay_take", "craft": "pull" }));
    let hold = json!({ "do": "clay_hold", "held": true });
    holder.does(hold.clone());
    assert_eq!(other.ask(hold.clone())["status"], 409, "one at a time");
    // What it says keeps the hold, for longer than a silence may be.
    for _ in 0..15 {
        std::thread::sleep(Duration::from_millis(100));
        holder.does(json!({ "do": "ping" }));
    }
    assert_eq!(daemon.get("/api/v1/clay")["is_held"], true);
    other.event("clay", "let-go");
    assert_eq!(daemon.get("/api/v1/clay")["is_held"], false, "after its silence");

    holder.does(hold.clone());
    drop(holder);
    other.event("clay", "let-go");
    assert_eq!(daemon.get("/api/v1/clay")["is_held"], false, "after it has gone");

    other.does(hold.clone());
    other.does(json!({ "do": "disable" }));
    other.event("clay", "let-go");
    assert_eq!(other.ask(hold.clone())["status"], 409, "without force");
    // The clay was pulled to where the hand still is, and a tool that starts in clay feels nothing
    // before it was outside.
    while other.ask(json!({ "do": "clay_undo" }))["ok"] == true {}
    other.does(json!({ "do": "enable" }));
    other.event("state", "enabled");
    assert_eq!(daemon.get("/api/v1/clay")["is_held"], false, "not by itself");
    other.does(hold);
    other.does(json!({ "do": "clay_hold", "held": false }));
    let (status, answer) = daemon.http("POST", "/api/v1/clay/hold", &[], r#"{"held": true}"#);
    assert_eq!(status, 404, "{answer}");
}

#[test]
fn every_command_says_what_is_wrong_with_it_and_what_would_do() {
    let daemon = Daemon::sculpting(SCENE, STILL);
    let mut client = daemon.connect();
    client.does(
        json!({ "do": "clay_take", "craft": "pull", "falloff": "constant", "depth_m": 0.002 }),
    );
    let before = daemon.get("/api/v1/clay");
    let take = |fields: Value| {
        let mut request = json!({ "do": "clay_take" });
        request.as_object_mut().unwrap().extend(fields.as_object().unwrap().clone());
        request
    };
    for (request, status, expected) in [
        (take(json!({})), 400, "nothing is to be taken"),
        (take(json!({ "craft": "knit" })), 400, "knit"),
        (take(json!({ "craft": 3 })), 400, "`craft`"),
        (take(json!({ "brush": 0.001 })), 400, "brush"),
        (take(json!({ "brush_m": "wide" })), 400, "`brush_m`"),
        (take(json!({ "brush_m": 0 })), 400, "`brush_m`"),
        (
            take(
                json!({ "brush_m": 1, "falloff": "spherical", "depth_m": 0.001, "is_sharp": true }),
            ),
            400,
            "`brush_m`",
        ),
        (take(json!({ "depth_m": -1 })), 400, "`depth_m`"),
        (take(json!({ "falloff": "square" })), 400, "square"),
        (take(json!({ "falloff": [2, 0] })), 400, "0 to 1"),
        (take(json!({ "color": "red" })), 400, "red"),
        (take(json!({ "is_sharp": "very" })), 400, "`is_sharp`"),
        (json!({ "do": "clay_hold" }), 400, "held"),
        (json!({ "do": "clay_hold", "held": "yes" }), 400, "`held`"),
        (json!({ "do": "clay_undo" }), 409, "no stroke"),
        (json!({ "do": "clay_undo", "strokes": 2 }), 400, "strokes"),
        (json!({ "do": "clay_redo" }), 409, "no stroke"),
        (json!({ "do": "clay_save" }), 400, "kind"),
        (json!({ "do": "clay_save", "kind": "photo" }), 400, "photo"),
        (json!({ "do": "clay_save", "kind": "points", "file": 7 }), 400, "`file`"),
        (json!({ "do": "clay_save", "kind": "points", "file": "../ball" }), 400, "letters"),
        (json!({ "do": "clay_save", "kind": "points", "file": "" }), 400, "letters"),
    ] {
        let reply = client.ask(request.clone());
        assert_eq!(
            (&reply["ok"], &reply["status"]),
            (&json!(false), &json!(status)),
            "{request}: {reply}"
        );
        let [error, hint] =
            ["error", "hint"].map(|key| reply[key].as_str().unwrap_or_default().to_owned());
        assert!(
            format!("{error}; {hint}").contains(expected) && !hint.is_empty(),
            "{request}: {reply}"
        );
    }
    for (path, body, expected) in [
        ("tool", r#"{"brush_m": "wide"}"#, "`brush_m`"),
        ("tool", "[]", "map"),
        ("save", r#"{"kind": "photo"}"#, "photo"),
        ("undo", r#"{"strokes": 2}"#, "strokes"),
    ] {
        let (status, answer) = daemon.http("POST", &format!("/api/v1/clay/{path}"), &[], body);
        assert_eq!(status, 400, "{answer}");
        assert!(
            answer["error"].as_str().unwrap().contains(expected) && answer["hint"].is_string(),
            "{path} {body}: {answer}"
        );
    }
    // None of it has changed anything.
    let after = daemon.get("/api/v1/clay");
    for key in [
        "version",
        "kind",
        "brush_m",
        "falloff",
        "color",
        "depth_m",
        "is_sharp",
        "is_held",
        "undo",
        "is_unsaved",
    ] {
        assert_eq!(after[key], before[key], "{key}");
    }

    // Where nothing can be written, that is said, and what was asked for can be asked for again.
    let folder = daemon.state_folder().join("clay");
    std::fs::write(&folder, "a file where the folder should be").unwrap();
    let save = json!({ "do": "clay_save", "kind": "session", "file": "ball" });
    let reply = client.ask(save.clone());
    assert_eq!(reply["status"], 409, "{reply}");
    assert!(
        reply["error"].as_str().unwrap().contains("clay") && reply["hint"].is_string(),
        "{reply}"
    );
    std::fs::remove_file(&folder).unwrap();
    client.does(save);
}

#[test]
fn what_no_session_has_is_reported_until_one_has_it() {
    let daemon = Daemon::sculpting(SCENE, STILL);
    let mut client = daemon.connect();
    let facts = daemon.get("/api/v1/clay");
    assert_eq!(
        (&facts["is_unsaved"], &facts["session_at_end"], &facts["is_over"]),
        (&json!(false), &json!(null), &json!(false))
    );
    client.does(json!({ "do": "clay_take", "craft": "emboss", "brush_m": 0.008 }));
    client.does(json!({ "do": "clay_hold", "held": true }));
    clay_where(&daemon, |facts| facts["undo"] == 1 && facts["is_unsaved"] == true);
    client.does(json!({ "do": "clay_hold", "held": false }));
    client.does(json!({ "do": "clay_save", "kind": "session" }));
    clay_where(&daemon, |facts| facts["is_unsaved"] == false);
    client.does(json!({ "do": "clay_undo" }));
    clay_where(&daemon, |facts| facts["is_unsaved"] == true);
}

#[test]
fn another_tool_in_the_middle_of_a_pull_takes_the_force_away_within_the_slew_limit() {
    let daemon = Daemon::sculpting(SCENE, PULLING);
    let mut client = daemon.connect();
    client.subscribe(1000.0);
    let force =
        |state: &Value| [0, 1, 2].map(|axis| state["servo_cf"]["f"][axis].as_f64().unwrap());
    let size = |f: [f64; 3]| f.iter().map(|part| part * part).sum::<f64>().sqrt();
    let felt_now = |force_n: f64| force_n > 0.3;
    let last: Cell<Option<(u64, [f64; 3])>> = Cell::new(None);
    // The force while something is waited for, tick by tick.
    let follow = |client: &mut Client, until: &dyn Fn(f64) -> bool| {
        client.state_where(|state| {
            let tick = state["tick"].as_u64().unwrap();
            let now = force(state);
            if let Some((before, was)) = last.replace(Some((tick, now))) {
                let step_n = size([0, 1, 2].map(|axis| now[axis] - was[axis]));
                let most_n = SLEW_N_PER_S * 1e-3 * (tick - before) as f64 + 1e-9;
                assert!(
                    state["state"] != "ENABLED" || step_n <= most_n,
                    "tick {tick}: {step_n} N after {before}, at most {most_n}"
                );
            }
            until(size(now))
        });
    };
    for _ in 0..3 {
        client.send(&json!({ "do": "clay_take", "craft": "pull" }));
        let began = Instant::now();
        let felt = Cell::new(false);
        while !felt.get() && began.elapsed() < HUNG {
            // A hold takes what is in reach when it begins: one that came too late takes nothing.
            client.send(&json!({ "do": "clay_hold", "held": false }));
            client.send(&json!({ "do": "clay_hold", "held": true }));
            let held = Instant::now();
            follow(&mut client, &|force_n| {
                felt.set(felt_now(force_n));
                felt.get() || held.elapsed() > HELD
            });
        }
        assert!(felt.get(), "the rope pulls");
        client.send(&json!({ "do": "clay_take", "craft": "touch" }));
        follow(&mut client, &|force_n| force_n == 0.0);
        client.send(&json!({ "do": "clay_hold", "held": false }));
    }
}

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
        assert!(
            answer["hint"].as_str().is_some_and(|hint| hint.contains("hapticd sculpt")),
            "{answer}"
        );
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
        assert_eq!(
            (&reply["ok"], &reply["status"]),
            (&false.into(), &404.into()),
            "{request}: {reply}"
        );
    }
}
