//! Golden messages: those of the published pages and of the crate `haply` 1.3.1, shortened to what
//! is read, and what is made of them.

use super::record::{Heard, heard, put_command};
use super::*;
use crate::transport::Frame;

/// The first message, as the pages of 3.5 show it.
const INVENTORY: &str = r#"{"session_id": 7,
 "session": {"session_id": 7, "config": {"profile": {"name": "default"}}, "started_time": "2026-04-20 20:11:58.6121582"},
 "inverse3": [{"device_id": "049D",
   "config": {"type": "inverse3", "port": "COM12", "device_info": {"major_version": 7, "minor_version": 4, "id": "049D", "device_type": 4},
     "gravity_compensation": {"enabled": true, "scaling_factor": 1.0}, "handedness": "right", "streaming_mode": "USB",
     "torque_scaling": {"enabled": true}, "home_return": {"enabled": false}, "preset": "defaults", "basis": {"permutation": "XYZ"},
     "mount": {"position": {"x":0,"y":0,"z":0}, "rotation": {"w":1,"x":0,"y":0,"z":0}, "scale": {"x":1,"y":1,"z":1}},
     "filters": {"force_gate": {"gain": 0.3}, "damping": {"scalar": 0.0}}},
   "state": {"cursor_position": {"x":0.0,"y":-0.12,"z":0.15}, "cursor_velocity": {"x":0,"y":0,"z":0}, "control_mode": "idle", "transform": {}},
   "status": {"calibrated": true, "in_use": false, "power_supply": true, "ready": true, "started": true}}],
 "verse_grip": [],
 "wireless_verse_grip": [{"device_id": "1402", "config": {"type": "ruko"},
   "state": {"battery_level": 0.89, "buttons": {"a": false, "b": true, "c": false}, "hall": 15,
     "orientation": {"x":0.346,"y":0.661,"z":-0.348,"w":0.564}, "transform": {}},
   "status": {"connected": true, "awake": true, "ready": true}}],
 "custom_verse_grip": []}"#;

/// A message of version 3.1 to 3.4, from the tests of the crate: one grip sleeps, another is awake.
const OLDER: &str = r#"{"session_id": 176,
 "inverse3": [{"device_id": "04C3",
   "config": {"type": "inverse3", "device_info": {"major_version": 7, "minor_version": 1}, "gravity_compensation": {"enabled": true, "scaling_factor": 0.75},
     "torque_scaling": {"enabled": true}, "cursor_offset": {"x": 0, "y": 0, "z": 0}, "coordinate_origin": "device_base", "basis": {"permutation": "XYZ"}},
   "state": {"angular_position": {"a0": -89.66179, "a1": 222.81319, "a2": -22.783606},
     "cursor_position": {"x": 0.12794551, "y": 0.038903017, "z": -0.05089721}, "mode": "idle"},
   "status": {"calibrated": true, "in_use": false, "power_supply": true, "ready": true, "started": true}}],
 "verse_grip": [],
 "wireless_verse_grip": [{"device_id": "1102",
   "state": {"buttons": {"a": false, "b": false, "c": false}, "hall": 16,
     "orientation": {"x": -0.0016784668, "y": -0.037994385, "z": -0.74890137, "w": 0.65896606}},
   "status": {"connected": true, "awake": false, "ready": true}}],
 "custom_verse_grip": [{"device_id": "1272",
   "state": {"buttons": {"a": false, "b": false, "c": false}, "orientation": {"x": 0.6329651, "y": -0.32418823, "z": 0.60165405, "w": 0.35888672},
     "extension_data": [0,0,0,0,5,6,7,8,9,10,11,12]},
   "status": {"connected": true, "awake": true, "ready": true}}]}"#;

fn wanted() -> HaplyService {
    HaplyService {
        address: ADDRESS.to_owned(),
        arm: None,
        grip: None,
        has_grip: true,
        version: None,
    }
}

fn state(record: &[u8]) -> super::record::State {
    match heard(record) {
        Heard::State(state) => state,
        Heard::Greeting(_) | Heard::Garbled => panic!("no state: {record:?}"),
    }
}

fn refusal(inventory: &str, wanted: &HaplyService) -> String {
    Inventory::read(inventory).expect("read").choose(wanted).expect_err("refused").to_string()
}

#[test]
fn the_published_first_message_is_read() {
    let inventory = Inventory::read(INVENTORY).expect("read");
    let wanted = wanted();
    let (arm, grip) = inventory.choose(&wanted).expect("one of each");
    assert_eq!(
        (arm.id.as_str(), arm.kind.as_str(), grip.map(String::as_str)),
        ("049D", "inverse3", Some("1402"))
    );
    let said = arm.greeting(Version(3, 5), grip);
    assert_eq!(
        said,
        "Inverse service 3.5, inverse3 049D, firmware 7.4, grip 1402\nthe service changes the \
            force: filters.force_gate.gain is 0.3, torque_scaling.enabled is true"
    );
    let state = state(&Reader::new("049D", Some("1402")).record(INVENTORY.as_bytes()));
    assert_eq!(state.pose, [0.0, -0.12, 0.15, 0.346, 0.661, -0.348, 0.564]);
    assert_eq!((state.buttons, state.homed, state.error), (0b10, true, 0));
}

#[test]
fn an_older_message_is_read_and_a_grip_that_sleeps_keeps_its_orientation_and_is_reported() {
    let inventory = Inventory::read(OLDER).expect("read");
    assert_eq!(inventory.grips, ["1102", "1272"]);
    let several = refusal(OLDER, &wanted());
    assert!(several.contains("several: 1102, 1272; name one in protocol.grip"), "{several}");
    let awake = state(&Reader::new("04C3", Some("1272")).record(OLDER.as_bytes()));
    assert_eq!(
        awake.pose,
        [0.12794551, 0.038903017, -0.05089721, 0.6329651, -0.32418823, 0.60165405, 0.35888672]
    );
    assert_eq!(awake.error, 0);

    let mut reader = Reader::new("04C3", Some("1102"));
    let asleep = state(&reader.record(OLDER.as_bytes()));
    assert_eq!(
        (&asleep.pose[3..], asleep.error),
        (&[0.0, 0.0, 0.0, 1.0][..], 3),
        "it never was awake"
    );
    let woken = OLDER.replace("\"awake\": false", "\"awake\": true");
    assert_eq!(state(&reader.record(woken.as_bytes())).pose[6], 0.65896606);
    let turned_asleep = OLDER.replace("0.65896606", "0.1");
    let asleep = state(&reader.record(turned_asleep.as_bytes()));
    assert_eq!((asleep.pose[0], asleep.pose[6], asleep.error), (0.12794551, 0.65896606, 3));
    assert!(error_text(3).contains("sleeps"));
    // Who needs no grip hears of none.
    assert_eq!(state(&Reader::new("04C3", None).record(OLDER.as_bytes())).error, 0);
}

#[test]
fn what_is_wrong_with_arm_and_grip_has_a_number_and_words() {
    let mut reader = Reader::new("049D", Some("1402"));
    let with = |from: &str, to: &str| {
        assert!(INVENTORY.contains(from), "{from}");
        INVENTORY.replace(from, to)
    };
    for (text, homed, error) in [
        (with("\"power_supply\": true", "\"power_supply\": false"), true, 2),
        (with("\"started\": true", "\"started\": false"), true, 1),
        (with("\"calibrated\": true", "\"calibrated\": false"), false, 0),
        (with("\"device_id\": \"1402\"", "\"device_id\": \"1403\""), true, 4),
    ] {
        let state = state(&reader.record(text.as_bytes()));
        assert_eq!((state.homed, state.error), (homed, error), "{text}");
    }
    // What a frame leaves out stands as it was.
    let mut reader = Reader::new("049D", Some("1402"));
    reader.record(with("\"ready\": true, \"started\"", "\"ready\": false, \"started\"").as_bytes());
    let bare = r#"{"inverse3": [{"device_id": "049D", "state": {"cursor_position": {"x":null,"y":1e-3,"z":2}}}], "wireless_verse_grip": [{"device_id": "1402"}]}"#;
    let kept = state(&reader.record(bare.as_bytes()));
    assert!(kept.pose[0].is_nan() && kept.pose[1..3] == [1e-3, 2.0] && kept.error == 1, "{kept:?}");
    // What was never heard is not good: neither the status of the arm nor the direction of the
    // grip.
    let never = state(&Reader::new("049D", Some("1402")).record(bare.as_bytes()));
    assert_eq!((never.homed, never.error), (false, 1));
    let without_direction =
        bare.replace("\"state\"", "\"status\": {\"calibrated\": true}, \"state\"");
    let never = state(&Reader::new("049D", Some("1402")).record(without_direction.as_bytes()));
    assert_eq!((never.homed, never.error), (true, 3));
    assert!(is_gone(&reader.record(with("\"049D\"", "\"0001\"").as_bytes())), "the arm has left");
    for garbled in
        ["", "{", "[]", "{\"inverse3\": 3}", "{\"inverse3\": [{\"device_id\": \"049D\"}]}"]
    {
        assert!(matches!(heard(&reader.record(garbled.as_bytes())), Heard::Garbled), "{garbled}");
    }
}

#[test]
fn a_profile_names_arm_and_grip_and_a_turned_frame_is_refused() {
    let none = refusal(
        &INVENTORY.replace("049D", "049E"),
        &HaplyService { arm: Some("049D".to_owned()), ..wanted() },
    );
    assert!(
        none.contains("knows no arm 049D; it knows 049E: name one of them in protocol.arm"),
        "{none}"
    );
    let empty = refusal(r#"{"session_id": 1, "inverse3": []}"#, &wanted());
    assert!(empty.contains("the service knows no arm: plug it in"), "{empty}");
    let turned = refusal(&INVENTORY.replace("\"XYZ\"", "\"XZY\""), &wanted());
    assert!(turned.contains("basis.permutation is XZY; set it back"), "{turned}");
    let mounted =
        refusal(&INVENTORY.replace("\"scale\": {\"x\":1", "\"scale\": {\"x\":2"), &wanted());
    assert!(mounted.contains("mount or cursor_offset"), "{mounted}");
}

#[test]
fn a_command_is_written_in_the_dialect_of_the_version() {
    let mut frame = Frame::default();
    put_command([0.25, -1e-7, f64::NAN], &mut frame);
    let text = |version| {
        command_text(frame.as_slice(), "049D", Dialect::of(version).expect("known"))
            .expect("a command")
    };
    let expected = |key: &str| {
        format!(
            r#"{{"inverse3":[{{"device_id":"049D","commands":{{"set_cursor_force":{{"{key}":{{"x":0.25,"y":-0.0000001,"z":0}}}}}}}}]}}"#
        )
    };
    for minor in 1..=4 {
        assert_eq!(text(Version(3, minor)), expected("values"));
    }
    assert_eq!(text(Version(3, 5)), expected("vector"));
    for version in [Version(3, 0), Version(2, 9), Version(4, 0)] {
        let refused = Dialect::of(version).expect_err("neither").to_string();
        assert!(
            refused.contains(&format!("version {version}")) && refused.contains("3.1 to 3.5"),
            "{refused}"
        );
    }
    assert_eq!(command_text(b"x", "049D", Dialect::Vector), None);
}

#[test]
fn the_version_comes_bare_or_in_an_envelope() {
    let bare = r#"{"build_time": "2024-08-07T16:01:53Z", "git_tag": "3.0.0", "project_name": "haply-inverse-service", "project_version": "3.4.0.0"}"#;
    assert_eq!(Dialect::version_in(bare), Some(Version(3, 4)));
    assert_eq!(
        Dialect::version_in(&format!("{{\"ok\": true, \"data\": {bare}}}")),
        Some(Version(3, 4))
    );
    for other in ["", "{}", "{\"project_version\": 3}", "{\"project_version\": \"x\"}"] {
        assert_eq!(Dialect::version_in(other), None, "{other}");
    }
}
